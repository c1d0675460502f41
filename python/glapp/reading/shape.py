"""Forms of a table that are brought to the two that all else reads: a column per signal, or a row per tag and time.

- Date and time of day in two columns become one column, and so do a time and its milliseconds.
- A column of times whose name does not say so is found by its cells.
- A time column for each tag, and tags on alternate rows, become a row per tag and time.
- A column that names the loop of each row beside a column per signal becomes a row per tag and time.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import InputError
from ..loop import Loop
from .cells import CellFault, plain, words
from .columns import SignalColumns
from .meaning import is_long, numbered, time_of, understand
from .names import MILLISECONDS, folded
from .source import Source
from .times import HALF, is_date, is_time_of_day, looks_like_stamp
from .values import is_number

__all__ = ["AloneSource", "shaped", "signals_of", "tagged"]

_PV_EMPTY, _HELD_EMPTY = 0.25, 0.5
"""Share of rows without PV, without SP or OP, from which on signals have rows of their own."""
_OWN = ("sp", "pv", "op", "mode")
_ROWS = 8
"""Fewer rows than this show nothing."""
_GROUPS = 20
"""Number of loops that are looked at."""
_WIDEST = 200
"""Number of columns above which only those without a name are looked at for times: each may be a page of a file."""
_DAYS, _DAY_STEP = (29221.0, 54789.0), 0.05
"""Days of a spreadsheet from 1980 to 2050, and the longest step between two rows [days]."""
_HALF = f"(?i:{HALF.format('[AP]')})"
_SECOND = re.compile(rf"\d[:.]\d\d[:.]\d\d{_HALF}?$")
"""A time of whole seconds."""
_MIDNIGHT = r"[ T]00:00(:00(\.0+)?)?$"
_DAY_ZERO = r"^(1899-12-3[01]|1900-01-0[01])[ T]"


def shaped(source: Source, loops: Sequence[Loop] = (), defaults: Mapping[str, Any] | None = None) -> Source:
    """The source as one that has a column per signal, or a row per tag and time.

    - `source`: a table as it is written.
    - `loops`: those that are wanted; a time column that one of them names is left as it is.
    - `defaults`: settings for loops that are found, where `loops` is empty.
    """
    loops = loops or [Loop(**{**(defaults or {}), "name": "loop"})]
    named = {loop.columns.time for loop in loops if loop.columns.time}
    times = [i for i, name in enumerate(source.names) if name in named]
    if not times:
        times = [i for i, name in enumerate(source.names) if understand(name).role == "time"]
        if len(times) == 2 and (pair := _date_and_time(source, *times)) is not None:
            source = _Joined(source, *pair)
            times = [source.at]
        elif len(times) != 1 and not named:
            stamped = _stamped(source, times)
            if len(stamped) > 1 and _each_leads(source, stamped):
                return AloneSource(source, _pairs(source, stamped), loops, shared=False)
            if len(stamped) > 1 and (pairs := _by_name(source, stamped)):
                return AloneSource(source, pairs, loops, shared=False)
            if not any(loop.sample_time for loop in loops):
                counted = [0] if not times and not stamped and _counts_time(source) else []
                if not times and len(stamped + counted) == 1:
                    [at] = times = stamped + counted
                    source.names[at] = source.time = source.names[at] or "time"
    if len(times) == 1 and (beside := _beside(source, times[0])) is not None:
        source = _Joined(source, times[0], *beside)
        times = [source.at]
        source.time = source.names[source.at]
    if len(times) == 1 and not is_long(source.names) and (key := _key(source, loops)) is not None:
        return _KeyedSource(source, times[0], key)
    if len(times) == 1 and _on_own_rows(source, loops):
        at = times[0]
        return AloneSource(source, [(at, i) for i in range(len(source.names)) if i != at], loops, shared=True)
    return source


def tagged(source: Source) -> bool:
    """Name the columns of a table without names where its cells say it: a time, a tag and a value.

    At least one tag must be understood as a signal.
    """
    if len(source.names) != 3:
        return False
    cells = [_texts(source, i) for i in range(3)]
    kinds = ["" if not texts else "time" if all(map(looks_like_stamp, texts)) else _kind(texts) for texts in cells]
    if sorted(kinds) != ["tag", "time", "value"]:
        return False
    source.names = kinds
    return True


def _kind(texts: Sequence[str]) -> str:
    """Kind of a column by its texts: values, tags, or neither."""
    if all(map(is_number, texts)):
        return "value"
    roles = {understand(text).role for text in texts if not is_number(text)}
    return "tag" if roles & {"sp", "pv", "op"} and not any(map(is_number, texts)) else ""


def signals_of(source: Source) -> SignalColumns:
    """The columns of a table with a column per signal."""
    return SignalColumns(source.names, source.time, lambda name: _texts(source, source.places[name][0]))


def _texts(source: Source, column: int) -> list[str]:
    """The first cells of a column that are not empty, as text."""
    try:
        [head] = source.head([column])
        cells = words(head) if not _temporal(head.type) else _as_text(plain(head))
    except (CellFault, InputError):  # reported for the loop that needs it
        return []
    return [text for cell in cells.to_pylist() if cell is not None and (text := str(cell).strip())]


def _temporal(kind: pa.DataType) -> bool:
    return bool(pa.types.is_temporal(kind))


def _as_text(column: pa.Array) -> pa.Array:
    column = plain(column)
    if pa.types.is_timestamp(column.type) and column.type.tz is not None:
        column = column.cast(pa.timestamp(column.type.unit, "UTC"))
    return column if pa.types.is_string(column.type) else column.cast(pa.string())


def _date_and_time(source: Source, first: int, second: int) -> tuple[int, int] | None:
    """Which of two columns has the dates and which the times of day."""
    cells = {i: _texts(source, i) for i in (first, second)}
    for date, time in ((first, second), (second, first)):
        days, moments = _dates(cells[date]), _of_day(cells[time])
        if days and moments and all(map(is_date, days)) and all(map(is_time_of_day, moments)):
            return date, time
    return None


def _dates(texts: Sequence[str]) -> list[str]:
    """Dates without the midnight that a spreadsheet adds."""
    return [re.sub(_MIDNIGHT, "", text) for text in texts]


def _of_day(texts: Sequence[str]) -> list[str]:
    """Times without the first day that a spreadsheet adds."""
    return [re.sub(_DAY_ZERO, "", text) for text in texts]


def _stamped(source: Source, times: Sequence[int]) -> list[int]:
    """Columns that hold times: by their name, or, where it is empty or no name is that of a time, by their cells."""
    names = source.names
    asked = [i for i, name in enumerate(names) if i in times or not times or understand(name).role is None]
    if len(names) > _WIDEST:
        asked = [i for i in asked if i in times or i == 0 or not names[i]]
    return [i for i in asked if i in times or ((texts := _texts(source, i)) and looks_like_stamp(texts[0]))]


def _counts_time(source: Source) -> bool:
    """Whether the first column, whose name is not that of a time, has numbers that can only be times.

    They rise, and are seconds to nanoseconds since 1970, or days as a spreadsheet counts them. Numbers of rows are not.
    """
    if not source.names or understand(source.names[0]).role not in (None, "tag"):
        return False
    try:
        x = np.array([float(text) for text in _texts(source, 0)])
    except ValueError:
        return False
    if len(x) < 2 or not np.isfinite(x).all() or not (np.diff(x) > 0).all():
        return False
    since_1970 = any(0.9e9 * scale < x[0] and x[-1] < 4e9 * scale for scale in (1, 1e3, 1e6, 1e9))
    return since_1970 or bool(_DAYS[0] < x[0] and x[-1] < _DAYS[1] and np.median(np.diff(x)) < _DAY_STEP)


def _by_name(source: Source, stamped: Sequence[int]) -> list[tuple[int, int]]:
    """Columns of times and of values that belong together by their names: FIC101_PV_TIMESTAMP, FIC101_PV_VALUE."""
    tags = {i: tag for i in stamped if (tag := time_of(source.names[i])) is not None}
    if len(tags) < len(stamped):
        return []
    pairs = []
    for i, name in enumerate(source.names):
        own = [at for at, tag in tags.items() if name.startswith(tag)]
        if i in tags or (not own and understand(name).role not in _OWN):
            continue
        if not own:
            return []
        pairs.append((max(own, key=lambda at: len(tags[at])), i))
    return pairs


def _key(source: Source, loops: Sequence[Loop]) -> int | None:
    """The column that names the loop of each row, in a table with a column per signal."""
    if any(getattr(loop.columns, role) for loop in loops for role in _OWN):
        return None
    meanings = [understand(name) for name in source.names]
    keys = [i for i, meaning in enumerate(meanings) if meaning.role == "tag"]
    if len(keys) != 1 or not any(m.role == "pv" and not m.loop for m in meanings):
        return None
    cells = _texts(source, keys[0])
    return keys[0] if cells and not any(map(is_number, cells)) else None


def _beside(source: Source, at: int) -> tuple[int, bool] | None:
    """The column that a time goes on in: times of day beside dates, or milliseconds; and whether it is these."""
    texts = _texts(source, at)
    if not texts:
        return None
    after = at + 1
    if after < len(source.names) and folded(source.names[after]) in MILLISECONDS:
        parts = _texts(source, after)
        whole = all(_SECOND.search(text) for text in texts)
        if whole and parts and all(part.isdecimal() and len(part) < 4 for part in parts):
            return after, True
    if all(map(is_date, _dates(texts))):
        for i in (after, at - 1):
            if 0 <= i < len(source.names) and understand(source.names[i]).role in (None, "time"):
                cells = _of_day(_texts(source, i))
                if cells and all(map(is_time_of_day, cells)):
                    return i, False
    return None


def _each_leads(source: Source, stamped: Sequence[int]) -> bool:
    """Whether every time column has a column of values right after it, and nothing stands before the first."""
    return stamped[0] == 0 and all(i + 1 < len(source.names) and i + 1 not in stamped for i in stamped)


def _pairs(source: Source, stamped: Sequence[int]) -> list[tuple[int, int]]:
    """Time column and value column of each signal."""
    pairs, time = [], stamped[0]
    for i, name in enumerate(source.names):
        if i in stamped:
            time = i
        elif name or (i - 1 == time and _texts(source, i)):  # an empty column parts two tags
            pairs.append((time, i))
    return pairs


def _on_own_rows(source: Source, loops: Sequence[Loop]) -> bool:
    """Whether the signals of some loop are written each on rows of its own."""
    groups: list[dict[str, str]]
    if named := [loop.columns for loop in loops if loop.columns.pv]:
        groups = [{role: name for role in _OWN if (name := getattr(columns, role))} for columns in named]
    else:
        signals = signals_of(source)
        meant = [{role: signals.meant(role, group) for role in _OWN} for group in signals.groups[:_GROUPS]]
        groups = [{role: names[0] for role, names in group.items() if len(names) == 1} for group in meant]
    for group in groups:
        at = {role: places[0] for role, name in group.items() if len(places := source.places.get(name, [])) == 1}
        if _alternate(source, at):
            return True
    return False


def _alternate(source: Source, at: Mapping[str, int]) -> bool:
    """Whether the rows of signals alternate, a signal a row."""
    if "pv" not in at or len(at) < 2:
        return False
    try:
        heads = source.head([*at.values()])
    except InputError:  # reported for the loop whose column it is
        return False
    rows = min(map(len, heads))  # a column of words may show fewer first rows than the others
    filled = {role: ~_empty(head.slice(0, rows)) for role, head in zip(at, heads, strict=True)}
    any_ = np.logical_or.reduce(list(filled.values()))
    if any_.sum() < _ROWS:
        return False
    share = {role: 1 - mask[any_].mean() for role, mask in filled.items()}
    return bool(share["pv"] > _PV_EMPTY and share["pv"] < 1) or any(
        _HELD_EMPTY < share[role] < 1 for role in share if role != "pv"
    )


def _empty(column: pa.Array) -> NDArray[np.bool_]:
    """Cells that hold nothing: not those that hold a word for a bad value."""
    column = plain(column)
    if pa.types.is_string(column.type):
        mask = pc.fill_null(pc.equal(pc.utf8_trim_whitespace(column), ""), True)
    else:
        mask = pc.is_null(column, nan_is_null=True)
    found: NDArray[np.bool_] = mask.to_numpy(zero_copy_only=False)
    return found


class _Joined(Source):
    """A source whose dates and times of day are one column, in the place of the first of them.

    With `fine` the second column has milliseconds.
    """

    def __init__(self, source: Source, date: int, time: int, fine: bool = False) -> None:
        self._fine = fine
        self._inner, self._date, self._time = source, date, time
        self.label, self.rows, self.digits, self.one_fault = source.label, source.rows, source.digits, source.one_fault
        self.at = min(date, time)
        gone = max(date, time)
        self._of = [i for i in range(len(source.names)) if i != gone]
        self.names = [source.names[i] for i in self._of]
        self.units = [source.units[i] for i in self._of]
        both = [source.names[date]] if fine else [source.names[date], source.names[time]]
        self.names[self.at] = " ".join(both).strip() or "time"
        self.units[self.at] = None
        self.nameless = source.nameless

    def _join(self, date: pa.Array, time: pa.Array) -> pa.Array:
        """Date and time of day, or milliseconds, as one text."""
        if self._fine:
            parts = pc.extract_regex(pc.utf8_trim_whitespace(_as_text(date)), rf"^(?P<to>.*?)(?P<half>{_HALF})?$")
            digits = pc.utf8_lpad(pc.utf8_trim_whitespace(_as_text(time)), 3, "0")
            joined = [pc.struct_field(parts, "to"), ".", digits, pc.struct_field(parts, "half")]
            return pc.binary_join_element_wise(*joined, "", null_handling="replace", null_replacement="")
        day = pc.replace_substring_regex(pc.utf8_trim_whitespace(_as_text(date)), _MIDNIGHT, "")
        moment = pc.replace_substring_regex(pc.utf8_trim_whitespace(_as_text(time)), _DAY_ZERO, "")
        joined = pc.binary_join_element_wise(day, moment, " ", null_handling="replace", null_replacement="")
        return pc.utf8_trim_whitespace(joined)

    def _columns(self, columns: Sequence[int]) -> list[int]:
        """Columns of the inner source, the date and the time last where the joined one is wanted."""
        inner = [self._of[i] for i in columns if i != self.at]
        return [*inner, self._date, self._time] if self.at in columns else inner

    def _made(self, columns: Sequence[int], arrays: Sequence[pa.Array]) -> list[pa.Array]:
        """The columns asked for, with date and time joined."""
        rest = iter(arrays)
        return [self._join(*arrays[-2:]) if i == self.at else next(rest) for i in columns]

    def number(self, column: int) -> int:
        """Number of the column, or of the first of the two that are joined."""
        return self._inner.number(self._of[column])

    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First rows of the columns."""
        return self._made(columns, self._inner.head(self._columns(columns)))

    def tail(self, column: int) -> pa.Array | None:
        """Last rows of a column."""
        if column != self.at:
            return self._inner.tail(self._of[column])
        date, time = self._inner.tail(self._date), self._inner.tail(self._time)
        return None if date is None or time is None else self._join(date, time)

    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """Pass over the columns."""
        columns = list(types)
        texts = dict.fromkeys((self._date, self._time), pa.string())
        inner = {i: texts.get(i) or types[self._of.index(i)] for i in self._columns(columns)}
        for arrays, fraction in self._inner.stream(inner, bad_words):
            yield self._made(columns, arrays), fraction

    def row_number(self, record: int) -> int:
        """The row of a record, as the source counts."""
        return self._inner.row_number(record)


@dataclass(frozen=True, slots=True)
class _Tag:
    time: int
    value: int
    quality: int | None


class AloneSource(Source):
    """A source in which each signal has times, or rows, of its own, as a row per tag and time.

    A tag is a column of values; the rows on which it is empty are not its own. A column of the quality of PV goes with
    PV.

    - `source`: the table.
    - `pairs`: column of times and column of values of every tag.
    - `loops`: those that are wanted: one may say that there is no column of quality.
    - `shared`: whether all tags have one column of times.
    """

    TIME, TAG, VALUE, QUALITY = range(4)

    def __init__(
        self, source: Source, pairs: Sequence[tuple[int, int]], loops: Sequence[Loop], *, shared: bool
    ) -> None:
        self._inner = source
        self.label, self.rows, self.digits, self.one_fault = source.label, None, source.digits, source.one_fault
        self.names = [source.names[pairs[0][0]] if shared else "time", "tag", "value", "quality"]
        self.units = [source.units[pairs[0][0]], None, None, None]
        self.time = self.names[self.TIME] if shared else None
        times = {time for time, _ in pairs}
        numbers = [source.number(value) for _, value in pairs]
        names = numbered([self._name(time, value) for time, value in pairs], numbers)
        meanings = {value: understand(name) for (_, value), name in zip(pairs, names, strict=True)}
        qualities = {m.loop: value for value, m in meanings.items() if m.role == "quality"}
        if any(loop.columns.quality == "" for loop in loops):
            qualities = {}
        self._tags = {
            name: _Tag(time, value, qualities.get(meaning.loop) if meaning.role == "pv" else None)
            for (time, value), name in zip(pairs, names, strict=True)
            if (meaning := meanings[value]).role != "quality"
        }
        self.tags = list(self._tags)
        self.tag_units = {name: unit for name, tag in self._tags.items() if (unit := source.units[tag.value])}
        self._order = sorted(times | {value for _, value in pairs})

    def _name(self, time: int, value: int) -> str:
        """Name of a tag: that of its values, or, where those have none, that of its times without the word for them."""
        name = self._inner.names[value]
        if name and understand(name).role != "value":
            return name
        above = self._inner.names[time].split()
        return " ".join(word for word in above if understand(word).role != "time") or name or f"column {value + 1}"

    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First rows of the columns: of the tag that is written first."""
        table = self._long(dict(zip(self._order, self._inner.head(self._order), strict=True)), None)
        return [table[i] for i in columns]

    def tail(self, column: int) -> pa.Array | None:
        """Last rows of the times."""
        if column != self.TIME:
            return None
        return self._inner.tail(next(iter(self._tags.values())).time)

    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """Pass over the table, tag after tag within each stretch of it."""
        times = {tag.time for tag in self._tags.values()}
        kind = types.get(self.TIME, pa.string())
        inner = {i: kind if i in times else pa.string() for i in self._order}
        for arrays, fraction in self._inner.stream(inner, frozenset({""})):
            table = self._long(dict(zip(inner, arrays, strict=True)), kind)
            yield [table[i] for i in types], fraction

    def _long(self, arrays: Mapping[int, pa.Array], kind: pa.DataType | None) -> list[pa.Array]:
        times, tags, values, qualities = [], [], [], []
        for name, tag in self._tags.items():
            rows = pa.array(np.flatnonzero(~_empty(arrays[tag.value])))
            times.append(plain(arrays[tag.time]).take(rows))
            tags.append(pa.array([name], pa.string()).take(pa.array(np.zeros(len(rows), np.int64))))
            values.append(_as_text(arrays[tag.value].take(rows)))
            good = pa.array(["good"]).take(pa.array(np.zeros(len(rows), np.int64)))
            qualities.append(good if tag.quality is None else _as_text(arrays[tag.quality].take(rows)))
        if len({part.type for part in times}) > 1:
            times = [_as_text(part) for part in times]
        return [pa.concat_arrays(parts) for parts in (times, tags, values, qualities)]

    @cached_property
    def _places(self) -> NDArray[np.int64]:
        """Row of the table for every row of this source: the slow road, taken only to say where a fault is."""
        places, done = [], 0
        for arrays, _ in self._inner.stream(dict.fromkeys(self._order, pa.string()), frozenset({""})):
            table = dict(zip(self._order, arrays, strict=True))
            places += [done + np.flatnonzero(~_empty(table[tag.value])) for tag in self._tags.values()]
            done += len(arrays[0])
        return np.concatenate(places)

    def row_number(self, record: int) -> int:
        """The row of a record, as the table counts."""
        return self._inner.row_number(int(self._places[record]))


class _KeyedSource(Source):
    """A table with a column per signal, of which another names the loop of each row, as a row per tag and time.

    A tag is the name of the loop and the name of the signal's column: FIC101.pv.
    """

    def __init__(self, source: Source, time: int, key: int) -> None:
        self._inner, self._time, self._key = source, time, key
        self.label, self.digits, self.one_fault = source.label, source.digits, source.one_fault
        self.rows = None
        self.names = ["time", "tag", "value"]
        self.units = [source.units[time], None, None]
        kinds = [(i, understand(name)) for i, name in enumerate(source.names)]
        self._signals = [i for i, of in kinds if (of.role in (*_OWN, "position") or of.weak) and not of.loop]

    @property
    def _order(self) -> list[int]:
        """Columns of the inner source, in the order of reading."""
        return [self._time, self._key, *self._signals]

    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First rows of the columns."""
        arrays = self._inner.head(self._order)
        rows = min(map(len, arrays))
        table = self._long([array.slice(0, rows) for array in arrays])
        return [table[i] for i in columns]

    def tail(self, column: int) -> pa.Array | None:
        """Last rows of the times."""
        return self._inner.tail(self._time) if column == 0 else None

    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """Pass over the table, signal after signal within each of its rows."""
        inner = {i: pa.string() for i in self._order}
        inner[self._time] = types.get(0, pa.string())
        for arrays, fraction in self._inner.stream(inner, frozenset({""})):
            table = self._long(arrays)
            yield [table[i] for i in types], fraction

    def _long(self, arrays: Sequence[pa.Array]) -> list[pa.Array]:
        time, key, *signals = arrays
        n, m = len(time), len(signals)
        each = pa.array(np.repeat(np.arange(n), m))
        names = pa.array([self._inner.names[i] for i in self._signals], pa.string())
        name = names.take(pa.array(np.tile(np.arange(m), n)))
        tags = pc.binary_join_element_wise(pc.utf8_trim_whitespace(_as_text(key)).take(each), name, ".")
        values = pa.concat_arrays([_as_text(signal) for signal in signals])
        values = values.take(pa.array((np.arange(m) * n)[None, :].repeat(n, 0).ravel() + np.repeat(np.arange(n), m)))
        return [plain(time).take(each), tags, values]

    def row_number(self, record: int) -> int:
        """The row of a record, as the table counts."""
        return self._inner.row_number(record // len(self._signals))
