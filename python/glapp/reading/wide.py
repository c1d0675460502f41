"""A recording with one column per signal."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import InputError
from ..loop import Loop
from ..quality import Finding, newest_first, setting_unused
from ..recording import MARKED, MEMORY, Batch, Recording, finished, without_value
from .cells import CellFault, plain
from .columns import LABELS, naming
from .names import SAME_UNITS, UNITS, folded
from .passes import Passes
from .rows import OrderedRows, Reader
from .source import Source, ahead

__all__ = ["WideRecording", "check_one_unit", "unused_settings", "with_units"]

_NUMBERS = ("sp", "pv", "op", "position")
_SPARSE = 0.5
"""Share of rows without any number of the loop from which on they are another loop's, which is recorded more often."""


def with_units(loop: Loop, units: dict[str, str]) -> Loop:
    """The loop with the units found in the file where its settings have none."""
    found = {key: units[label] for key, label in (("pv_unit", "PV"), ("op_unit", "OP")) if label in units}
    return loop.model_copy(update={key: unit for key, unit in found.items() if getattr(loop, key) is None})


def check_one_unit(units: dict[str, str], loop: Loop, file: str, column: str | None, tag: str | None = None) -> None:
    """Refuse an SP in another unit than PV, where the file states both and the settings state none.

    - `units`: label of each signal to its unit.
    - `loop`: settings as they were given.
    - `column`, `tag`: that of SP.

    Raises InputError where the units differ in more than how they are written.
    """
    sp, pv = (units.get(label) for label in ("SP", "PV"))
    if loop.pv_unit is not None or sp is None or pv is None:
        return
    of_sp, of_pv = folded(sp), folded(pv)
    if not {of_sp, of_pv} <= UNITS - _ANY_UNIT or SAME_UNITS.get(of_sp, of_sp) == SAME_UNITS.get(of_pv, of_pv):
        return
    raise InputError(
        f"SP is in {sp} and PV in {pv}, must be in one unit",
        file=file,
        loop=loop.name,
        value=sp,
        bound=pv,
        hint="export both in one unit; where the file states a wrong one, write the unit of both in loops.toml: "
        f'pv_unit = "{pv}"',
        column=column,
        tag=tag,
    )


_ANY_UNIT = {"eu", "deg"}
"""Words that stand for more than one unit."""


def unused_settings(loop: Loop, columns: dict[str, str]) -> list[Finding]:
    """Say which settings a recording has no use for; `columns`: label of each signal to its column or tag."""
    found = []
    if loop.sample_time is not None and (time := columns.get(LABELS["time"])) is not None:
        found.append(setting_unused("sample_time", f"{loop.sample_time:g}", time))
    if loop.auto_values is not None and LABELS["mode"] not in columns:
        words = ", ".join(repr(word) if isinstance(word, str) else f"{word:g}" for word in loop.auto_values)
        found.append(setting_unused("auto_values", f"[{words}]"))
    return found


class WideRecording(Recording):
    """One loop of a table with one column per signal.

    - `passes`: over the table.
    - `loop`: settings.
    - `chosen`: role to column name.

    Raises InputError where the first rows show that the table cannot be used.
    """

    def __init__(self, passes: Passes, loop: Loop, chosen: dict[str, str]) -> None:
        source = passes.source
        self.name, self.loop, self.source, self.rows = loop.name, loop, source.label, source.rows
        self._ordered = OrderedRows(source)
        self._at = {role: source.places[name][0] for role, name in chosen.items()}
        self.columns = {LABELS[role]: name for role, name in chosen.items()}
        self.units = {LABELS[r]: unit for r, i in self._at.items() if (unit := source.units[i])}
        given = loop
        self.loop = loop = with_units(loop, self.units)
        [head] = source.head([self._at.get("time", self._at["pv"])])
        if len(head) == 0:
            raise InputError("has no rows", file=source.label)
        if len(head) == 1:
            raise InputError("has only one row", file=source.label, hint="a recording needs many rows")
        clock = None
        if (at := self._at.get("time")) is not None:
            clock = self._ordered.read_clock(at, loop.time_format, loop.time_zone, once=passes.clock_from_last)
        elif loop.sample_time is None:
            apart = "--sample-time SECONDS, or sample_time in loops.toml"
            if source.label == MEMORY:
                apart = "sample_time=SECONDS in its place"
            raise InputError(
                f"no time column among: {', '.join(source.names[:20])}",
                file=source.label,
                loop=loop.name,
                hint=f"name it: {naming({'time': 'NAME'}, source.label)}; or say how far rows are apart: {apart}",
                asks="columns",
            )
        self._sparse = self._is_sparse(source)
        self._quality = self._ordered.quality_of(self._at.get("quality"), loop.bad_values)
        self._reader = Reader(loop, source.digits)
        self.t0: datetime | None = clock.t0 if clock else None
        self.zone = clock.zone if clock else None
        self.found = [*(clock.found if clock else ()), *unused_settings(loop, self.columns)]
        if self._ordered.from_last:
            self.found.insert(0, newest_first(chosen["time"]))
        self._ends = {
            role: end for role in _NUMBERS if role in self._at and (end := source.unit_in_cells(self._at[role]))
        }
        self.units = {LABELS[role]: end for role, end in self._ends.items()} | self.units
        self.loop = with_units(self.loop, self.units)
        check_one_unit(self.units, given, source.label, chosen.get("sp"))
        types = {
            i: pa.float64() if role in _NUMBERS and role not in self._ends and not self._sparse else pa.string()
            for role, i in self._at.items()
        }
        if clock is not None:
            types[self._at["time"]] = clock.arrow_type
        self._share = passes.share(types, self._reader.bad_words)

    def release(self) -> None:
        """See `Recording.release`."""
        self._share.release()

    def fraction_read(self) -> float | None:
        """Share of the file or table that the latest pass has read."""
        return self._ordered.fraction

    def batches(self, rows: int = 65536) -> Iterator[Batch]:
        """See `Recording.batches`."""
        for batch in ahead(self._pass()):
            if len(batch) <= rows:
                yield batch
            else:
                for start in range(0, len(batch), rows):
                    yield batch[start : start + rows]

    def _pass(self) -> Iterator[Batch]:
        """Batches of the recording, in one pass over the file."""
        reader, clock = self._reader, self._ordered.clock
        seconds = clock.reader() if clock else None
        order = list(self._share.types)
        done, alive, marked = 0, False, 0
        for columns in self._ordered.of(self._share.stream()):
            n = len(columns[0])
            if n == 0:
                continue
            rows = None
            if seconds is not None:
                columns, rows = self._without_empty_rows(columns, order)
            values: dict[str, NDArray[np.float64]] = {}
            flags: NDArray[np.uint8] | None = None
            role = "time"
            try:
                if seconds is None:
                    t = np.arange(done, done + n, dtype=np.float64) * (self.loop.sample_time or 0.0)
                else:
                    t = seconds(columns[order.index(self._at["time"])])
                for role, at in self._at.items():
                    if role in _NUMBERS:
                        values[role] = reader.number(self._without_unit(role, columns[order.index(at)]))
                    elif role != "time":
                        cells = columns[order.index(at)]
                        bits = self._quality(cells) if role == "quality" else reader.flag(role, cells)
                        flags = bits if flags is None else flags | bits
            except CellFault as fault:
                if rows is not None:
                    fault.index = int(rows[fault.index])
                raise self._ordered.fault(fault, done, self._at[role]) from None
            done += n
            if len(t):
                batch = finished(t, values, flags)
                alive = alive or bool(np.isfinite(batch.pv).any())
                marked += 0 if alive or batch.marks is None else int(np.count_nonzero(batch.marks & MARKED["pv"]))
                yield batch
        if not alive:
            raise without_value(done, marked, file=self.source, column=self.columns["PV"])

    def _is_sparse(self, source: Source) -> bool:
        """Whether most of the first rows hold no number of this loop: in its file another is recorded more often."""
        if "time" not in self._at:
            return False
        try:
            if self._filled(source, [self._at["pv"]]) > 1 - _SPARSE:
                return False
            signals = [i for role, i in self._at.items() if role in _NUMBERS]
            return 0 < self._filled(source, signals) < 1 - _SPARSE
        except InputError:  # reported by the pass that reads the column
            return False

    @staticmethod
    def _filled(source: Source, columns: list[int]) -> float:
        """Share of the first rows in which one of these columns holds something."""
        heads = source.head(columns)
        n = min(map(len, heads))
        filled = np.zeros(n, np.bool_)
        for head in heads:
            filled |= True if (empty := _empty(head.slice(0, n))) is None else ~empty
        return float(filled.mean())

    def _without_unit(self, role: str, column: pa.Array) -> pa.Array:
        """A column without the units written in its cells."""
        if role not in self._ends:
            return column
        return pc.replace_substring_regex(plain(column), rf" ?{re.escape(self._ends[role])}\s*$", "")

    def _without_empty_rows(
        self, columns: list[pa.Array], order: list[int]
    ) -> tuple[list[pa.Array], NDArray[np.intp] | None]:
        """Leave out rows that are empty in every column that we read, as spreadsheets append them.

        Where most rows are another loop's, those are left out that are empty in every signal.
        """
        asked = columns
        if self._sparse:
            asked = [columns[order.index(i)] for role, i in self._at.items() if role in _NUMBERS]
        empty = _empty(asked[0])
        if empty is None:
            return columns, None
        for column in asked:
            other = _empty(column)
            if other is None:
                return columns, None
            empty &= other
        if not empty.any():
            return columns, None
        rows = np.flatnonzero(~empty)
        return [column.take(pa.array(rows)) for column in columns], rows


def _empty(column: pa.Array) -> NDArray[np.bool_] | None:
    """Whether each cell is empty, None where none is."""
    if pa.types.is_dictionary(column.type):
        column = plain(column)
    if pa.types.is_string(column.type):
        mask = pc.fill_null(pc.equal(pc.utf8_trim_whitespace(column), ""), True)
    elif column.null_count:
        mask = pc.is_null(column)
    else:
        return None
    found: NDArray[np.bool_] = mask.to_numpy(zero_copy_only=False).copy()
    return found if found.any() else None
