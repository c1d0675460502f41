"""A table with a row per tag and time: how its tags become the columns of a recording.

The rows of a recording are the samples of PV, in the file's order: times that repeat or run backwards stay visible.
Every other tag is *sample and hold*: at the time of a row it has the value of its own last sample at or before that
time, and none before its first. How old a held value may be is not judged here.

Where OP has more than twice as many samples as PV, rows of PV alone would hide its moves: then the times of OP's
samples between the first and the last of PV are rows too, and there PV lies on the straight line between its samples,
which is what a historian shows. A finding, `own_times`, says which was done.

A sample of PV or SP whose quality is not good makes the row `BAD`; a bad sample of another tag counts as missing.

The tags of one loop lie scattered over the whole file, so the rows of the wanted tags are held in memory (17 bytes
each), for all loops of the file together after one pass over it. Recordings of more than some 10⁸ rows are better
written as wide Parquet.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from datetime import datetime
from threading import Lock
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import InputError
from ..loop import Loop
from ..quality import Finding, newest_first, own_times
from ..recording import BAD, MARKED, Batch, Recording, finished, without_value
from .cells import CellFault, plain, words
from .columns import LABELS, SignalColumns, each_with_columns
from .meaning import SURE, understand
from .names import UNIT_COLUMNS, folded
from .rows import OrderedRows, Reader
from .source import Source
from .wide import check_one_unit, unused_settings, with_units

__all__ = ["LongRecording", "long_recordings"]

_WORDS = ("mode", "op_low_flag", "op_high_flag")
_COMMON = 0.5
"""A signal that has a sample at less than this share of PV's has times of its own."""
_MORE = 2
"""Ratio of OP's samples to PV's from which OP's times are rows as well."""


@dataclass
class _Tag:
    """All samples of one tag."""

    t: NDArray[np.float64]
    value: NDArray[np.float64]  # flags of the mode and limit tags as numbers
    bad: NDArray[np.bool_]


class _Store:
    """Reads the wanted tags of a long table once, for all its recordings."""

    def __init__(self, source: Source, loops: Sequence[Loop]) -> None:
        self.source = source
        self.rows = OrderedRows(source)
        # Columns and the way of writing times belong to the file: the first loop with a setting decides.
        roles = ("time", "tag", "value", "quality")
        alone = source.tags is not None
        self.at = {role: i if alone else self._column(role, loops) for i, role in enumerate(roles)}
        if self.at["time"] is None:
            raise InputError(f"no time column among: {', '.join(source.names[:20])}", file=source.label)
        time = self.at["time"]
        [head] = source.head([time])
        if len(head) < 2:
            raise InputError("has only one row" if len(head) else "has no rows", file=source.label)
        self._types = {i: pa.string() for i in self.at.values() if i is not None}
        zone = next((loop.time_zone for loop in loops if loop.time_zone), None)
        form = next((loop.time_format for loop in loops if loop.time_format), None)
        self.clock = self.rows.read_clock(time, form, zone, self.at["tag"])
        self._types[time] = self.clock.arrow_type
        marked = any(folded(name) == "marker" for name in source.names)
        self._quality = self.rows.quality_of(self.at["quality"], marked=marked)
        self._tags: dict[str, _Tag] | InputError | None = None
        self._faults: dict[str, InputError] = {}
        self._reading = Lock()
        self.readers: dict[str, tuple[str, Reader]] = {}
        self.units = dict(source.tag_units)

    def _column(self, role: str, loops: Sequence[Loop]) -> int | None:
        """Column of a role, by the loops' settings or by its name."""
        names = self.source.names
        named = next((c for loop in loops if (c := getattr(loop.columns, role)) is not None), None)
        if named == "":
            return None
        fits = [i for i, name in enumerate(names) if (name == named if named else understand(name).role == role)]
        if role == "time" and not fits and not named and self.source.time is not None:
            fits = [names.index(self.source.time)]
        sure = [i for i in fits if folded(names[i]) == SURE.get(role)]
        if len(fits) == 1 or len(sure) == 1:
            return (sure or fits)[0]
        if fits:
            what = f"the columns {' and '.join(repr(names[i]) for i in fits)} could both be {role}"
            raise InputError(
                what, file=self.source.label, hint=f'name one: columns = {{ {role} = "{names[fits[0]]}" }}'
            )
        if named or role in ("tag", "value"):
            what = f"no column '{named or role}' among: {', '.join(names[:20])}"
            raise InputError(what, file=self.source.label, parameter=f"columns.{role}", value=named)
        return None

    def names(self) -> list[str]:
        """All tags there are, in the order in which they first appear, and their units: one pass over these columns."""
        if self.source.tags is not None:
            return self.source.tags
        seen: dict[str, set[str]] = {}
        at = self.at["tag"]
        assert at is not None
        beside = [i for i, name in enumerate(self.source.names) if folded(name) in UNIT_COLUMNS]
        types = dict.fromkeys([at, *(beside if len(beside) == 1 else ())], pa.string())
        for columns, _ in self.source.stream(types, frozenset()):
            try:
                tags, *units = map(words, columns)
            except CellFault as fault:
                raise self.rows.fault(fault, 0, at) from None
            for tag in pc.unique(tags).to_pylist():
                if tag is not None:
                    seen.setdefault(str(tag), set())
            for unit in units:
                for pair in pa.table([tags, unit], ["tag", "unit"]).group_by(["tag", "unit"]).aggregate([]).to_pylist():
                    if pair["tag"] is not None and (text := (pair["unit"] or "").strip()):
                        seen[str(pair["tag"])].add(text)
        self.units = {tag: units.pop() for tag, units in seen.items() if len(units) == 1}
        return list(seen)

    def first(self, tag: str) -> list[str]:
        """Values of a tag among the first rows, as text."""
        tags, values = self.source.head([i for role in ("tag", "value") if (i := self.at[role]) is not None])
        pairs = zip(tags.to_pylist(), values.to_pylist(), strict=False)
        return [str(value) for name, value in pairs if name == tag and value is not None]

    def tags(self, wanted: Iterable[str]) -> dict[str, _Tag]:
        """The samples of these tags; where several recordings ask at once, one reads for all and the others wait.

        Raises InputError where the table, or one of these tags, cannot be used.
        """
        with self._reading:
            if self._tags is None:
                try:
                    self._tags = self._read()
                except InputError as error:  # not to read it again for every loop
                    self._tags = error
        if isinstance(self._tags, InputError):
            raise copy(self._tags)
        for tag in wanted:
            if tag in self._faults:
                raise copy(self._faults[tag])
        return self._tags

    def _read(self) -> dict[str, _Tag]:
        """Samples of each tag in memory."""
        wanted = pa.array(list(self.readers), pa.string())
        parts: dict[str, list[_Tag]] = {tag: [] for tag in self.readers}
        clock = self.clock.reader()
        order = list(self._types)
        place = {role: order.index(i) for role, i in self.at.items() if i is not None}
        done, begun = 0, set[int]()
        for columns in self.rows.of(self.source.stream(self._types, frozenset({""}))):
            columns = [plain(column) for column in columns]  # rows are picked from them, words may go
            n = len(columns[0])
            role = "time"
            rows = np.empty(0, np.int64)
            try:
                tags = columns[place["tag"]]
                if not pa.types.is_string(tags.type):
                    tags = tags.cast(pa.string())
                codes = pc.index_in(tags, wanted).fill_null(-1).to_numpy(zero_copy_only=False)
                rows = np.flatnonzero(codes >= 0)
                codes, keep = codes[rows], pa.array(rows)
                found, first = np.unique(codes, return_index=True)
                begins = np.zeros(len(rows), np.bool_)
                if np.count_nonzero(np.diff(codes)) < len(found):  # one after the other
                    begins[first[~np.isin(found, list(begun))]] = True
                begun.update(found.tolist())
                t = clock(columns[place["time"]].take(keep), begins)
                role = "quality"
                bad = np.zeros(len(rows), np.bool_)
                if role in place:
                    bad = self._quality(columns[place[role]].take(keep)) != 0
                role = "value"
                values = columns[place[role]]
                for code in found:
                    tag = wanted[int(code)].as_py()
                    if tag in self._faults:
                        continue
                    of_tag = np.flatnonzero(codes == code)
                    kind, reader = self.readers[tag]
                    cells = values.take(pa.array(rows[of_tag]))
                    try:
                        x = reader.flag(kind, cells).astype(np.float64) if kind in _WORDS else reader.number(cells)
                    except CellFault as fault:  # harms the loop of this tag and no other
                        fault.index = int(rows[of_tag[fault.index]])
                        self._faults[tag] = self.rows.fault(fault, done, self.at[role], tag)
                        continue
                    parts[tag].append(_Tag(t[of_tag], x, bad[of_tag]))
            except CellFault as fault:
                if len(rows):
                    fault.index = int(rows[fault.index])
                raise self.rows.fault(fault, done, self.at[role]) from None
            done += n
        return {
            tag: _Tag(*(np.concatenate([getattr(p, f) for p in part]) for f in ("t", "value", "bad")))
            for tag, part in parts.items()
            if part
        }


class LongRecording(Recording):
    """One loop of a long table."""

    def __init__(self, store: _Store, loop: Loop, chosen: dict[str, str]) -> None:
        self.name, self.loop, self.source, self.rows = loop.name, loop, store.source.label, None
        self._store, self._chosen = store, chosen
        self.columns = {LABELS[role]: tag for role, tag in chosen.items()}
        time = store.at["time"]
        assert time is not None
        if store.source.tags is None or store.source.time is not None:
            self.columns["time"] = store.source.names[time]
        self.units = {
            LABELS[role]: unit for role, tag in chosen.items() if (unit := store.units.get(tag) or understand(tag).unit)
        }
        self.loop = with_units(loop, self.units)
        check_one_unit(self.units, loop, self.source, None, chosen.get("sp"))
        self._unused = unused_settings(loop, self.columns | {LABELS["time"]: store.source.names[time]})
        self.t0: datetime | None = store.clock.t0
        self.zone = store.clock.zone
        self._found_here: list[Finding] = []

    @property
    def found(self) -> Sequence[Finding]:  # type: ignore[override]
        """Findings of opening and reading."""
        clock = self._store.clock
        turned = [newest_first(clock.name)] if self._store.rows.from_last else []
        return [*turned, *clock.found, *self._unused, *self._found_here]

    def fraction_read(self) -> float | None:
        """Share of the file that is read; the file is read once for all its loops."""
        return self._store.rows.fraction

    def batches(self, rows: int = 65536) -> Iterator[Batch]:
        """See `Recording.batches`."""
        read = self._store.tags(self._chosen.values())
        tags = {role: read[tag] for role, tag in self._chosen.items() if tag in read}
        for role in ("sp", "pv"):
            if role in self._chosen and role not in tags:
                raise InputError("has no row", file=self.source, tag=self._chosen[role])
        pv = tags["pv"]
        if not np.isfinite(np.where(pv.bad, np.nan, pv.value)).any():
            raise without_value(len(pv.t), int(pv.bad.sum()), file=self.source, tag=self._chosen["pv"])
        sorted_tags = {role: _in_order(tag) for role, tag in tags.items() if role != "pv"}
        pv, self._found_here = _rows(pv, sorted_tags)
        for start in range(0, len(pv.t), rows):
            part = slice(start, start + rows)
            t = pv.t[part]
            values = {"pv": pv.value[part]}
            flags = (pv.bad[part] * np.uint8(BAD)).astype(np.uint8)
            marks = np.zeros(len(t), np.uint8)
            for role, tag in sorted_tags.items():
                at = np.searchsorted(tag.t, t, side="right") - 1
                none = (at < 0) | tag.bad[at]
                if role in _WORDS:  # an unknown mode is not automatic, an unknown limit flag is clear
                    reader = self._store.readers[self._chosen[role]][1]
                    missing = reader.flag(role, pa.array([""]))[0]
                    flags = flags | np.where(none, missing, tag.value[at].astype(np.uint8)).astype(np.uint8)
                else:
                    values[role] = np.where(none, np.nan, tag.value[at])
                    marks |= (none & (at >= 0)) * np.uint8(MARKED.get(role, 0))
            yield finished(t, values, flags, marks)


def _rows(pv: _Tag, others: Mapping[str, _Tag]) -> tuple[_Tag, list[Finding]]:
    """The rows, as samples of PV, and the finding where the signals have times of their own."""
    signals = [role for role in ("sp", "op") if role in others]
    own = any(np.isin(pv.t, others[role].t).mean() < _COMMON for role in signals)
    op, count = others.get("op"), len(pv.t)
    if op is not None and (pv.t[1:] > pv.t[:-1]).all():
        between = op.t[(op.t > pv.t[0]) & (op.t < pv.t[-1])]
        if len(between) > _MORE * count:
            pv, own = _joined(pv, between), True
    held = ", ".join(LABELS[role] for role in signals)
    return pv, [own_times(held, count, len(pv.t))] if own else []


def _joined(pv: _Tag, times: NDArray[np.float64]) -> _Tag:
    """PV at its own times and at these, on the straight line between two samples; missing beside a missing one."""
    t = np.union1d(pv.t, times)
    value = np.where(pv.bad, np.nan, pv.value)
    after = np.searchsorted(pv.t, t, side="left")
    before = np.where(pv.t[after] == t, after, after - 1)
    share = (t - pv.t[before]) / np.where(after > before, pv.t[after] - pv.t[before], 1.0)
    line = np.where(after > before, value[before] + share * (value[after] - value[before]), value[after])
    return _Tag(t, line, np.isnan(line) & (pv.bad[before] | pv.bad[after]))


def _in_order(tag: _Tag) -> _Tag:
    """Samples of a tag in the order of time."""
    if np.all(tag.t[1:] >= tag.t[:-1]):
        return tag
    order = np.argsort(tag.t, kind="stable")
    return _Tag(tag.t[order], tag.value[order], tag.bad[order])


def long_recordings(
    source: Source,
    stem: str,
    loops: Sequence[Loop] | None,
    defaults: Mapping[str, Any] | None,
    only: Collection[str] | None = None,
) -> list[Recording | InputError]:
    """Recordings of the loops of a long table, an error in the place of a loop whose tags cannot be used.

    Raises InputError where the table cannot be used.
    """
    store = _Store(source, loops or [Loop(**{**(defaults or {}), "name": stem})])

    def make(loop: Loop, chosen: dict[str, str]) -> Recording:
        reader = Reader(loop, source.digits)
        for role, tag in chosen.items():
            store.readers[tag] = (role, reader)
        return LongRecording(store, loop, chosen)

    signals, kind = SignalColumns(store.names(), first=store.first), "tag" if source.tags is None else "column"
    return each_with_columns(
        signals, loops, defaults, make, only=only, stem=stem, label=source.label, tags=True, kind=kind
    )
