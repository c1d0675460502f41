"""Tables whose newest row comes first, as many historians export them: their rows are taken from the last on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import InputError
from .passes import HELD
from .source import Source
from .times import Clock
from .values import CellFault, is_text, plain

__all__ = ["FromLast", "clock_from_last"]

_ROWS = 1000
"""So many rows tell how times are written."""
_NOTHING = frozenset({""})
"""Words for a missing cell, where only times and tags are read."""


def clock_from_last(
    source: Source, clock: Clock, time: int, again: Callable[[pa.Array], Clock], tag: int | None = None
) -> Clock | None:
    """The clock of a table whose newest row comes first, counted from its last row; None for any other table.

    No row may be newer than the row above it, of its tag where the table has a row per tag and time: a table in which
    some are is left as it is, to be refused. So is one whose times need more memory than a quarter of `HELD`.

    - `clock`: that of the first rows.
    - `time`, `tag`: columns.
    - `again`: makes a clock of other first rows.
    """
    try:
        steps = np.diff(clock.reader()(_written(source.head([time])[0])))
        if (steps < 0).sum() <= (steps > 0).sum():
            return None
        types = {time: clock.arrow_type} | ({} if tag is None else {tag: pa.string()})
        times: list[pa.Array] = []
        tags: list[pa.Array] = []
        for columns, _ in source.stream(types, _NOTHING):
            there = _there(columns[0])
            times.append(columns[0].filter(there))
            if tag is not None:
                tags.append(plain(columns[1]).filter(there))
            if sum(column.nbytes for column in times) > HELD // 4:
                return None
        from_last = [_turned(column) for column in reversed(times)]
        counted = again(next(column for column in from_last if len(column)).slice(0, _ROWS))
        read = counted.reader()
        t = np.concatenate([read(column) for column in from_last])
    except (CellFault, InputError):  # reported where the rows are read
        return None
    steps = np.diff(t) if tag is None else _steps_of_tags(t, [_turned(column) for column in reversed(tags)])
    return counted if (steps >= 0).all() else None


class FromLast:
    """The rows of one pass from the last to the first.

    - `stream`: the pass; all of it is read and held.
    - `progress`: receives the share that is read.
    """

    def __init__(self, stream: Iterable[tuple[list[pa.Array], float]], progress: Callable[[float], None]) -> None:
        self._blocks: list[list[pa.Array]] = []
        for columns, fraction in stream:
            self._blocks.append(columns)
            progress(fraction)
        self.rows = sum(len(columns[0]) for columns in self._blocks)

    def __iter__(self) -> Iterator[tuple[list[pa.Array], float]]:
        while self._blocks:  # what is handed on is no longer held
            yield [_turned(column) for column in self._blocks.pop()], 1.0


def _steps_of_tags(t: NDArray[np.float64], tags: Sequence[pa.Array]) -> NDArray[np.float64]:
    """Steps from each row to the next one of its tag."""
    names = pa.chunked_array([column.cast(pa.string()) for column in tags])
    codes = pc.fill_null(names.combine_chunks().dictionary_encode().indices, -1).to_numpy(zero_copy_only=False)
    order = np.argsort(codes, kind="stable")
    steps: NDArray[np.float64] = np.diff(t[order])[np.diff(codes[order]) == 0]
    return steps


def _turned(column: pa.Array) -> pa.Array:
    """The column from its last row to its first."""
    if pa.types.is_run_end_encoded(column.type):
        column = pc.run_end_decode(column)
    return column.take(pa.array(np.arange(len(column) - 1, -1, -1)))


def _there(column: pa.Array) -> pa.Array:
    """Which cells are not empty."""
    column = plain(column)
    there = pc.is_valid(column)
    if not is_text(column.type):
        return there
    return pc.and_(there, pc.fill_null(pc.not_equal(pc.utf8_trim_whitespace(column), ""), False))


def _written(column: pa.Array) -> pa.Array:
    return plain(column).filter(_there(column))
