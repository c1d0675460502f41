"""Rows of a table in the order of time: one way in for tables with a column per signal and with a row per tag.

Many historians export the newest row first: the rows of such a table are taken from the last on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import InputError
from ..loop import Loop
from ..recording import AT_HIGH, AT_LOW
from .cells import CellFault, is_text, plain, words
from .passes import HELD
from .source import Source
from .times import Clock
from .values import Digits, Quality, flags_of, limit_flag, mode_flag, numbers, text_of, words_for_bad

__all__ = ["OrderedRows", "Reader"]

_ROWS = 1000
"""Number of rows that decide how times are written."""
_NOTHING = frozenset({""})
"""Words for a missing cell, where only times and tags are read."""


@dataclass(frozen=True)
class Reader:
    """Rules of one loop for turning cells into numbers and flags."""

    loop: Loop
    digits: Digits

    @property
    def bad_words(self) -> frozenset[str]:
        """Words that stand for a missing value, in lower case."""
        return words_for_bad(self.loop.bad_values)

    def number(self, column: pa.Array) -> NDArray[np.float64]:
        """Numbers, with NaN for everything that means missing."""
        x = numbers(column, self.bad_words, self.digits)
        for bad in self.loop.bad_values:
            if not isinstance(bad, str):
                x = np.where(x == bad, np.nan, x)
        return x

    def flag(self, role: str, column: pa.Array) -> NDArray[np.uint8]:
        """Bits of a mode or limit flag column."""
        if role == "mode":
            return flags_of(column, mode_flag(self.loop.auto_values, self.bad_words))
        return flags_of(column, limit_flag(AT_LOW if role == "op_low_flag" else AT_HIGH))


class OrderedRows:
    """Rows of a source in the order of time, one pass after the other.

    - `clock`: of the column of times, after `read_clock`.
    - `from_last`: whether the newest row comes first.
    - `fraction`: share of the source that the latest pass has read; None before the first.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self.clock: Clock | None = None
        self.from_last = False
        self.fraction: float | None = None
        self._last_row: int | None = None  # of the latest pass from the last row

    def read_clock(
        self,
        time: int,
        form: str | None,
        zone: str | None,
        tag: int | None = None,
        once: Callable[[object, Callable[[], Clock | None]], Clock | None] = lambda _, find: find(),
    ) -> Clock:
        """Learn from the first and last rows how times are written, and whether the newest row comes first.

        - `time`, `tag`: columns.
        - `form`, `zone`: how the settings say that times are written.
        - `once`: keeps what is found of a column of times for other loops.

        Raises InputError where they are no times.
        """
        source = self.source
        [head] = source.head([time])

        def clock_of(first: pa.Array, others: pa.Array | None) -> Clock:
            return Clock(first, others, form, zone, source.names[time], source.unit(time))

        try:
            clock = clock_of(head, source.tail(time))
        except CellFault as fault:
            raise self.fault(fault, 0, time) from None
        find = partial(_clock_from_last, source, clock, time, lambda first: clock_of(first, head), tag)
        late = once((time, form, zone), find)
        self.clock, self.from_last = late or clock, late is not None
        return self.clock

    def quality_of(
        self, column: int | None, bad_values: Iterable[str | float] = (), *, marked: bool = False
    ) -> Callable[[pa.Array], NDArray[np.uint8]]:
        """Reader of the column of qualities, by its first cells; `marked` as of `Quality`."""
        name, first = "", []
        if column is not None:
            name = self.source.names[column]
            try:
                first = words(self.source.head([column])[0]).to_pylist()
            except CellFault as fault:
                raise self.fault(fault, 0, column) from None
        quality = Quality(map(text_of, first), words_for_bad(bad_values), name, marked=marked)
        return partial(flags_of, bit_of=quality)

    def of(self, stream: Iterable[tuple[list[pa.Array], float]]) -> Iterator[list[pa.Array]]:
        """Columns of one pass, block by block; one from the last row on is read whole before its first block."""
        self.fraction = 0.0
        blocks: list[list[pa.Array]] = []
        for columns, self.fraction in stream:
            if self.from_last:
                blocks.append(columns)
            else:
                yield columns
        self._last_row = sum(len(columns[0]) for columns in blocks) - 1 if self.from_last else None
        while blocks:  # what is handed on is no longer held
            yield [_turned(column) for column in blocks.pop()]
        self.fraction = 1.0

    def fault(self, fault: CellFault, done: int, column: int | None, tag: str | None = None) -> InputError:
        """The error of a cell, with its place.

        - `done`: rows of the pass before the block with the cell.
        - `column`: None where it is called `tag`.
        """
        record = done + fault.index
        if self._last_row is not None:
            record = self._last_row - record
        name = None if column is None else self.source.names[column]
        if tag is not None and self.source.tags is not None:  # a column that is read as a tag
            name, tag = tag, None
        what, hint = fault.what, fault.hint
        if name is not None and str(fault.value).strip() == name:  # days that were joined with their headers
            what = f"the header is there once more: '{name}'"
            hint = "delete this row; or leave the parts in files of their own, and give all of them with --as-loop NAME"
        return InputError(
            what,
            file=self.source.label,
            row=self.source.row_number(record),
            column=name,
            tag=tag,
            value=fault.value,
            hint=hint,
            asks=fault.asks,
        )


def _clock_from_last(
    source: Source, clock: Clock, time: int, again: Callable[[pa.Array], Clock], tag: int | None
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
            filled = _filled(columns[0])
            times.append(columns[0].filter(filled))
            if tag is not None:
                tags.append(plain(columns[1]).filter(filled))
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


def _filled(column: pa.Array) -> pa.Array:
    """Which cells are not empty."""
    column = plain(column)
    filled = pc.is_valid(column)
    if not is_text(column.type):
        return filled
    return pc.and_(filled, pc.fill_null(pc.not_equal(pc.utf8_trim_whitespace(column), ""), False))


def _written(column: pa.Array) -> pa.Array:
    return plain(column).filter(_filled(column))
