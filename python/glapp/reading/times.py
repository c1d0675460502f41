"""The time column: what its cells mean, and seconds since the first row.

ISO stamps are parsed by Arrow. Every other way of writing is parsed by *layout*: a stamp with its digits blanked out,
such as ``00.00.0000 00:00:00``. A file has few layouts, each is understood once, and its rows are converted together.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from itertools import pairwise
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..quality import Finding, assumed_time
from .cells import CellFault, is_text, plain
from .names import MONTHS

__all__ = ["Clock", "is_date", "is_time_of_day", "looks_like_moment", "looks_like_stamp", "moment"]

_ISO = re.compile(r"\d{4}-\d\d-\d\d(?:[ T]\d\d:\d\d(?::\d\d(?:\.\d{1,9})?)?)?")
_ISO_ZONED = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d(?::\d\d(?:\.\d{1,9})?)?(?:Z|[+-]\d\d(?::?\d\d)?)")
HALF = "[ \u00a0\u202f]?{}\\.?[ \u00a0\u202f]?M\\.?"
"""AM and PM; Spanish puts a space between the letters, and newer Windows one that keeps lines together before them."""
_OF_DAY = re.compile(
    r"(?:[01]?\d|2[0-3])(?::[0-5]\d(?::[0-5]\d(?:[.,:]\d{1,9})?)?|\.[0-5]\d\.[0-5]\d(?:[.,]\d{1,9})?)"
    rf"(?:{HALF.format('[AP]')})?",
    re.IGNORECASE,
)
_NUMERIC = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?")

# Every digit of a layout is written 0.
_LAYOUT = re.compile(
    r"(?:(?P<y1>0000)(?P<s1>[-/.])(?P<m1>00?)(?P=s1)(?P<d1>00?)"  # 2024-01-31
    r"|(?P<a>00?)(?P<s2>[-/.])(?P<b>00?)(?P=s2)(?P<y2>0000|00)"  # 31/01/2024 or 01/31/2024
    r"|(?P<d3>00?)[- /](?P<n3>[A-Za-z]{3,9})[- /](?P<y3>0000|00)"  # 31-Jan-24
    r"|(?P<n4>[A-Za-z]{3,9}) (?P<d4>00?),? (?P<y4>0000)"  # Jan 31, 2024
    r"|(?P<y5>0000)(?P<m5>00)(?P<d5>00)(?=T))"  # 20240131T...
    r"(?:(?:T|,? +)(?P<H>00?)(?:(?P<c>[:.])(?P<M>00)(?:(?P=c)(?P<S>00)(?:[.,:](?P<F>0{1,9}))?)?|(?P<M2>00)(?P<S2>00))"
    rf"(?:{HALF.format('(?P<half>[AP])')})?"
    r"(?: ?(?P<zone>Z|UTC|GMT|(?:UTC|GMT)?(?P<sign>[+-])(?P<zh>00):?(?P<zm>00)?))?)?",
    re.IGNORECASE,
)
_ELAPSED = {"milliseconds": 1e-3, "seconds": 1.0, "minutes": 60.0, "hours": 3600.0, "days": 86400.0}
_UNITS = {
    unit: form
    for form, units in {
        "milliseconds": "ms msec millisecond milliseconds",
        "seconds": "s sec secs second seconds sek sekunden",
        "minutes": "min mins minute minutes minuten",
        "hours": "h hr hrs hour hours std stunden",
        "days": "d day days tage dygn",
    }.items()
    for unit in units.split()
}
_TO_1970 = {"excel": 25569.0, "matlab": 719529.0, "julian": 2440587.5}
"""1970-01-01 00:00 as each of them counts days."""
_CALENDARS = {"excel": "a spreadsheet's day numbers", "matlab": "MATLAB's datenum", "julian": "Julian dates"}
_YEARS = 3652.0, 29220.0
"""A day number between 1980 and 2050 [days since 1970] may be the date of a recording."""
_DATED = {"date", "datetime", "timestamp", "datum", "datumzeit", "zeitstempel", "tidpunkt"}
_USUAL = (600, 900, 1200, 1800, 3600)
"""Steps that recordings of more than five minutes a sample have [s]."""
_PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
_STATE_ORDER = "say which: --time-format 'day first' or 'month first', or in loops.toml time_format = \"day first\""
_STATE_COUNT = (
    "format the column as date and time, or say what it counts: --time-format, or in loops.toml time_format, "
    "'seconds', 'days', 'excel' ..."
)


@dataclass(frozen=True)
class Plan:
    """Layout of a stamp: each part's name with (first, last + 1) of its characters; constants of the layout."""

    parts: dict[str, tuple[int, int]]
    month: int | None
    half: int | None
    sign: int | None
    zoned: bool


def looks_like_stamp(text: str) -> bool:
    """Whether a cell holds a date and not a plain number.

    Examples
    --------
    >>> looks_like_stamp("31.01.2024 10:00"), looks_like_stamp("12.5")
    (True, False)
    """
    return _plan(re.sub(r"[0-9]", "0", text.strip())) is not None


def is_date(text: str) -> bool:
    """Whether a cell holds a day and no time of it.

    Examples
    --------
    >>> is_date("31.01.2024"), is_date("31.01.2024 10:00")
    (True, False)
    """
    plan = _plan(re.sub(r"[0-9]", "0", text.strip()))
    return plan is not None and "H" not in plan.parts


def is_time_of_day(text: str) -> bool:
    """Whether a cell holds the time of a day and no date.

    Examples
    --------
    >>> is_time_of_day("10:00:05"), is_time_of_day("10.00.05"), is_time_of_day("10.5")
    (True, True, False)
    """
    return bool(_OF_DAY.fullmatch(text.strip()))


def looks_like_moment(text: str) -> bool:
    """Whether a cell holds a date, a time of day, or both."""
    return looks_like_stamp(text) or is_time_of_day(text)


def moment(text: str, time_format: str | None) -> datetime | None:
    """A moment as a person writes it, in any form that a time column may have; aware where it names a zone.

    None where it is no date at all. CellFault where it can be read in two ways, or does not exist.

    Examples
    --------
    >>> moment("31.01.2024 10:00", None)
    datetime.datetime(2024, 1, 31, 10, 0)
    >>> moment("tomorrow", None)
    """
    if not looks_like_stamp(text):
        return None
    return Clock(pa.array([text.strip()]), None, time_format, None).t0


@lru_cache(maxsize=256)
def _plan(layout: str) -> Plan | None:
    """Layout of a time stamp; None where it is none."""
    found = _LAYOUT.fullmatch(layout)
    if found is None:
        return None
    name = found["n3"] or found["n4"]
    month = MONTHS.get(name[:3].lower()) if name else None
    if name and month is None:
        return None
    parts = {k.rstrip("12345"): found.span(k) for k in found.groupdict() if found[k] and k[0] in "ymdabHMSFz"}
    parts.pop("zone", None)
    half = {"a": 0, "p": 12}[found["half"].lower()] if found["half"] else None
    if found["zone"] and not layout.isascii():  # parts are recognised by their bytes
        return None
    sign = {"+": 1, "-": -1}[found["sign"]] if found["sign"] else None
    return Plan(parts, month, half, sign, found["zone"] is not None)


class Clock:
    """Turns a time column into seconds.

    - `head`: first rows of the column.
    - `tail`: last rows where they are cheap to have: they may settle which number is the day.
    - `time_format`: as in `Loop`.
    - `time_zone`: zone of stamps without one.
    - `name`: name of the column.
    - `unit`: unit that stands beside it.

    - `arrow_type`: what a CSV parser should make of the column.
    - `t0`: time of the first row.
    - `zone`: time zone of the times.
    - `found`: what its numbers were taken for, where that was not plain.

    Raises CellFault where the first rows are no times, or can be read in two ways.
    """

    def __init__(
        self,
        head: pa.Array,
        tail: pa.Array | None,
        time_format: str | None,
        time_zone: str | None,
        name: str = "time",
        unit: str | None = None,
    ) -> None:
        head = plain(head)
        head = head.filter(pc.is_valid(head))
        if is_text(head.type):
            trimmed = pc.utf8_trim_whitespace(head)
            head = trimmed.filter(pc.not_equal(trimmed, ""))
        if len(head) == 0:
            raise CellFault(0, "the time is empty")
        self.zone = time_zone
        self.t0: datetime | None = None
        self.found: list[Finding] = []
        self.name, self._unit = name, _UNITS.get((unit or "").strip(" .").lower())
        self._format = time_format
        self._calendar: str | None = None
        self._seconds = 1.0
        self._day_first: bool | None = None
        self._zoned = False
        self._per_second = 10**9
        self._origin = 0
        self._numeric = False
        self.arrow_type: pa.DataType = pa.string()
        if is_text(head.type):
            texts = head.to_pylist()
            if _NUMERIC.fullmatch(texts[0]):  # a later cell that is no number is reported where it is
                numeric = [t.replace(",", ".") for t in texts if _NUMERIC.fullmatch(t)]
                self._numbers(np.array([float(t) for t in numeric]), numeric[0], head.slice(0, 1))
            else:
                self._stamps(head, texts, None if tail is None else plain(tail))
        elif pa.types.is_timestamp(head.type) or pa.types.is_date(head.type):
            column = (
                head.cast(pa.timestamp("s" if pa.types.is_date32(head.type) else "ms"))
                if pa.types.is_date(head.type)
                else head
            )
            self._per_second = _PER_SECOND[column.type.unit]
            self._zoned = column.type.tz is not None
            if self._zoned and time_zone is None:
                self.zone = column.type.tz
            self._start(column)
        elif pa.types.is_integer(head.type) or pa.types.is_floating(head.type) or pa.types.is_decimal(head.type):
            values = head.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
            self._numbers(values, str(head[0].as_py()), head.slice(0, 1))
        elif pa.types.is_duration(head.type):
            self._numeric, self._per_second = True, 0
            self._seconds = 1.0 / _PER_SECOND[head.type.unit]
            self.arrow_type = head.type
        else:
            raise CellFault(0, f"holds {head.type}, not times")

    def reader(self) -> Callable[..., NDArray[np.float64]]:
        """A function for one pass over the recording: column to seconds [s]; raises CellFault.

        Where the tags of a table stand one after the other, it takes as second the rows with which one begins.
        """
        if self._numeric:
            return lambda column, begins=None: self._read_numbers(column)
        fold = _Fold(self.zone) if self.zone is not None and not self._zoned else None

        def read(column: pa.Array, begins: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
            ticks = self._ticks(column)
            if fold is not None:
                ticks = fold(ticks, self._per_second, begins)
            return self._since(ticks)

        return read

    def _since(self, ticks: NDArray[np.int64]) -> NDArray[np.float64]:
        seconds = (ticks - self._origin).astype(np.float64)
        seconds /= self._per_second
        return seconds

    # --- numbers

    def _numbers(self, head: NDArray[np.float64], text: str, first: pa.Array) -> None:
        """Settle the unit of numeric times from the first values."""
        if not np.isfinite(head[0]):
            raise CellFault(0, f"'{text}' is not a time", value=text)
        form = self._format or self._form_of(head, text)
        self.arrow_type = pa.float64()
        if form in _CALENDARS:
            self._calendar, self._per_second = form, 1000  # as fine as the numbers of any of them
            self._start(first)
            return
        self._numeric = True
        if form in _ELAPSED:
            self._per_second, self._seconds = 0, _ELAPSED[form]
            return
        if not form.startswith("epoch"):
            raise CellFault(0, f"holds numbers, which cannot be read '{form}'", "leave out time_format")
        per_second = _PER_SECOND[form.removeprefix("epoch ")]
        self._per_second = per_second
        if per_second <= 1000:  # fractions of s and ms are kept to the microsecond, which float64 holds exactly
            self._scale = 10**6 // per_second
            self._per_second = 10**6
            self._origin = round(min(max(float(head[0]), -1e17), 1e17) * self._scale)
        else:
            self._scale = 1
            self.arrow_type = pa.int64()
            self._origin = int(text) if text.lstrip("+-").isdecimal() else int(head[0])
        if abs(self._origin) > 7 * 10**9 * self._per_second:  # years 1748 to 2191: where ns fit 64 bits
            raise CellFault(0, f"'{text}' is outside the range of times", value=text)
        zone = ZoneInfo(self.zone) if self.zone else UTC
        self.zone = self.zone or "UTC"
        self.t0 = _moment(self._origin, self._per_second).replace(tzinfo=UTC).astimezone(zone)

    def _form_of(self, head: NDArray[np.float64], text: str) -> str:
        """Unit of a time column's numbers, from their range, their steps, the column's name and its unit."""
        low, high = float(np.nanmin(head)), float(np.nanmax(head))
        for exponent, name in ((0, "epoch s"), (3, "epoch ms"), (6, "epoch us"), (9, "epoch ns")):
            if 0.67e9 * 10**exponent <= low and high <= 4.2e9 * 10**exponent:  # years 1991 to 2103
                return name
        steps = np.abs(np.diff(head))
        steps = steps[steps > 0]
        with np.errstate(over="ignore"):  # a number as large as 1e308 among them
            step = float(np.median(steps)) if len(steps) else None
        dated = self.name.strip().lower() in _DATED
        for calendar, zero in _TO_1970.items():
            if zero + _YEARS[0] <= low and high <= zero + _YEARS[1]:
                if self._unit is not None and self._unit != "days":
                    return self._unit
                # A sample every 0.004 s is faster than control loops are recorded, one every 0.05 days slower.
                usual = any(abs(step * 86400 / seconds - 1) < 0.001 for seconds in _USUAL) if step else False
                sure = self._unit == "days" or (
                    step is not None and (step < 0.004 or (step < 0.05 and (dated or usual)))
                )
                if sure or step is None or step < 0.05 or dated:
                    self._note_time_unit(calendar, sure, text, float(head[0]), step)
                return calendar if sure else "seconds"
        if self._unit is not None:
            return self._unit
        if step is not None and step < 0.004 and low > 25569 and high < 80000:
            what = f"{text} looks like a day number, but of which calendar?"
            raise CellFault(0, what, _STATE_COUNT, text, "time unit")
        if high > 1e11:
            raise CellFault(0, f"{text} is too large for seconds", _STATE_COUNT, text, "time unit")
        return "seconds"

    def _note_time_unit(self, calendar: str, sure: bool, text: str, first: float, step: float | None) -> None:
        """Keep the finding on the assumed unit of the times."""
        date = _moment(round((first - _TO_1970[calendar]) * 86_400_000), 1000)
        finding = assumed_time(
            self.name, text, step, calendar, f"{_CALENDARS[calendar]}, {date:%Y-%m-%d %H:%M:%S}", sure
        )
        self.found.append(finding)

    def _read_numbers(self, column: pa.Array) -> NDArray[np.float64]:
        column = self._as_numbers(column)
        if self._per_second == 0 or self._scale != 1:
            x = _finite(column)
            if self._per_second == 0:
                return x if self._seconds == 1.0 else x * self._seconds
            if float(np.abs(x).max(initial=0.0)) * self._scale > 9e18:
                raise CellFault(int(np.argmax(np.abs(x))), "is outside the range of times")
            return self._since(np.rint(x * self._scale).astype(np.int64))
        ticks: NDArray[np.int64] = column.cast(pa.int64(), safe=False).to_numpy(zero_copy_only=False)
        return self._since(ticks)

    def _as_numbers(self, column: pa.Array) -> pa.Array:
        """The column as numbers, none of them empty.

        A number is what Arrow reads as one, here and in the parser of a text file: rows beside it change nothing.
        """
        column = plain(column)
        if is_text(column.type):
            written = pc.replace_substring(pc.utf8_trim_whitespace(column), ",", ".")
            column = pc.replace_substring_regex(written, r"^\+([0-9.])", r"\1")
            column = pc.if_else(pc.equal(column, ""), None, column)
            cast = _cast(column, self.arrow_type)
            if cast is None:
                rows = range(len(column))
                at = bisect_left(rows, True, key=lambda k: _cast(column.slice(0, k + 1), self.arrow_type) is None)
                if column.slice(0, at).null_count == 0:
                    text = written[at].as_py()
                    hint = "correct or delete the row"
                    raise CellFault(at, f"'{text}' is not a time like those before", hint, value=text)
            else:
                column = cast
        if column.null_count:
            raise CellFault(pc.index(pc.is_null(column), True).as_py(), "the time is empty")
        return column

    # --- stamps

    def _stamps(self, head: pa.Array, texts: Sequence[str], tail: pa.Array | None) -> None:
        """Settle the layout of time stamps from the first and last texts."""
        if self._format in ("day first", "month first"):
            self._day_first = self._format == "day first"
        elif self._format is not None:
            raise CellFault(0, f"'{texts[0]}' cannot be read as '{self._format}'", "leave out time_format", texts[0])
        if all(_ISO.fullmatch(t) for t in texts):
            self.arrow_type = pa.timestamp("ns")
        elif all(_ISO_ZONED.fullmatch(t) for t in texts):
            self.arrow_type = pa.timestamp("ns", "UTC")
        plan = _plan(re.sub(r"[0-9]", "0", texts[0]))
        if plan is None:
            raise CellFault(0, f"'{texts[0]}' is not a time that glapp can read", _hint(texts[0]), texts[0])
        self._zoned = plan.zoned
        if plan.zoned and self.zone is None:
            self.zone = "UTC"
        if self._day_first is None and "a" in plan.parts:
            rows = list(texts) + ([] if tail is None else [t for t in tail.to_pylist() if t])
            self._day_first = _day_first(rows)
        self._start(head)

    def _start(self, head: pa.Array) -> None:
        """Take the first time as the beginning of the recording."""
        first = self._ticks(head.slice(0, 1))
        if self.zone is not None and not self._zoned:
            first = _Fold(self.zone)(first, self._per_second)
        self._origin = int(first[0])
        moment = _moment(self._origin, self._per_second)
        self.t0 = moment if self.zone is None else moment.replace(tzinfo=UTC).astimezone(_zone(self.zone))

    def _ticks(self, column: pa.Array) -> NDArray[np.int64]:
        """Integer time since 1970 in 1/per_second, local where no zone is known."""
        if self._calendar is not None:
            since = _finite(self._as_numbers(column)) - _TO_1970[self._calendar]
            far = np.abs(since) > 80_000  # years 1751 to 2189
            if far.any():
                at = int(np.argmax(far))
                raise CellFault(at, "is outside the range of times", value=float(since[at] + _TO_1970[self._calendar]))
            whole: NDArray[np.int64] = np.rint(since * 86_400_000).astype(np.int64)
            return whole
        column = plain(column)
        if is_text(column.type):
            return self._parse(column)
        if column.null_count:
            raise CellFault(pc.index(pc.is_null(column), True).as_py(), "the time is empty")
        if pa.types.is_date(column.type):
            column = column.cast(pa.timestamp("s" if pa.types.is_date32(column.type) else "ms"))
        ticks: NDArray[np.int64] = column.view(pa.int64()).to_numpy()
        return ticks

    def _parse(self, column: pa.Array) -> NDArray[np.int64]:
        column = pc.utf8_trim_whitespace(column)
        empty = pc.or_kleene(pc.is_null(column), pc.equal(column, ""))
        if pc.any(empty).as_py():
            raise CellFault(pc.index(empty, True).as_py(), "the time is empty")
        n = len(column)
        offsets = np.frombuffer(column.buffers()[1], np.int32)[column.offset : column.offset + n + 1]
        data = np.frombuffer(column.buffers()[2] or b"", np.uint8)
        lengths = np.diff(offsets)
        out = np.empty(n, np.int64)
        for length in np.unique(lengths):
            rows = np.flatnonzero(lengths == length)
            if length > 64:
                raise CellFault(int(rows[0]), f"'{column[int(rows[0])].as_py()}' is not a time")
            cells = data[offsets[rows][:, None] + np.arange(length)]
            digit = (cells >= 48) & (cells <= 57)
            layouts = np.where(digit, np.uint8(48), cells)
            while len(rows):
                same = (layouts == layouts[0]).all(axis=1)
                at = int(rows[0])
                text = column[at].as_py()
                plan = _plan(layouts[0].tobytes().decode("utf-8", "replace"))
                if plan is None:
                    raise CellFault(at, f"'{text}' is not a time that glapp can read", _hint(text), text)
                if plan.zoned != self._zoned:
                    has = "has a zone" if plan.zoned else "has no zone"
                    raise CellFault(at, f"'{text}' {has}, unlike the first row: mixed zones", value=text)
                if "a" in plan.parts and self._day_first is None:
                    raise CellFault(
                        at, f"'{text}' can be read day first or month first", _STATE_ORDER, text, "time_format"
                    )
                values, wrong = _convert(cells[same], plan, self._day_first)
                if wrong.any():
                    at = int(rows[same][np.argmax(wrong)])
                    text = column[at].as_py()
                    read = "" if "a" not in plan.parts else " day first" if self._day_first else " month first"
                    raise CellFault(at, f"'{text}' read{read} is not a date and time that exists", value=text)
                out[rows[same]] = values
                rows, cells, layouts = rows[~same], cells[~same], layouts[~same]
        return out


def _cast(column: pa.Array, kind: pa.DataType) -> pa.Array | None:
    """Text as numbers; None where some of it is none."""
    try:
        return column.cast(kind)
    except pa.ArrowInvalid:
        return None


def _finite(column: pa.Array) -> NDArray[np.float64]:
    """Times as numbers; an error at the first that is none."""
    if pa.types.is_duration(column.type):
        column = column.cast(pa.int64())
    x: NDArray[np.float64] = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    finite = np.isfinite(x)
    if not finite.all():
        at = int(np.argmin(finite))
        raise CellFault(at, f"'{x[at]}' is not a time", value=float(x[at]))
    return x


def _convert(
    cells: NDArray[np.uint8], plan: Plan, day_first: bool | None
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Stamps of one layout to ns since 1970, and which of them do not exist."""
    zero = np.zeros(len(cells), np.int64)

    def part(name: str) -> NDArray[np.int64]:
        value = zero
        first, last = plan.parts.get(name, (0, 0))
        for i in range(first, last):
            value = value * 10 + (cells[:, i].astype(np.int64) - 48)
        return value

    year = part("y")
    if "y" in plan.parts and plan.parts["y"][1] - plan.parts["y"][0] == 2:
        year = np.where(year < 70, 2000 + year, 1900 + year)
    if "a" in plan.parts:
        day, month = (part("a"), part("b")) if day_first else (part("b"), part("a"))
    else:
        day, month = part("d"), part("m") if plan.month is None else zero + plan.month
    hour, minute, second = part("H"), part("M"), part("S")
    wrong = (year < 1700) | (year > 2250) | (month < 1) | (month > 12) | (minute > 59) | (second > 59)
    if plan.half is None:
        wrong |= hour > 23
    else:
        wrong |= (hour < 1) | (hour > 12)
        hour = hour % 12 + plan.half
    months = (np.where(wrong, 1970, year) - 1970) * 12 + np.where(wrong, 1, month) - 1
    starts = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)
    ends = (months + 1).astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)
    wrong |= (day < 1) | (day > ends - starts)
    seconds = (starts + day - 1) * 86400 + hour * 3600 + minute * 60 + second
    if plan.sign is not None:
        zh, zm = part("zh"), part("zm")
        wrong |= (zh > 15) | (zm > 59)
        seconds = seconds - plan.sign * (zh * 3600 + zm * 60)
    first, last = plan.parts.get("F", (0, 9))
    fraction = part("F") * 10 ** (9 - (last - first))
    return np.where(wrong, 0, seconds) * 10**9 + fraction, wrong


def _day_first(texts: Sequence[str]) -> bool:
    """Which of the two leading numbers is the day, from the data alone; CellFault where it stays open."""
    dates = []
    for text in texts:
        if found := re.match(r"(\d{1,2})([-/.])(\d{1,2})\2(\d{4}|\d\d)", text.strip()):
            dates.append((int(found[1]), int(found[3]), int(found[4]), found[2]))
    if any(s == "." for *_, s in dates):
        return True
    first_over, second_over = any(a > 12 for a, *_ in dates), any(b > 12 for _, b, *_ in dates)
    if first_over != second_over:
        return first_over
    if not first_over:  # dates that follow each other day by day in one reading only
        steps = {}
        for day_first in (True, False):
            days = [
                np.datetime64(f"{2000 + y % 100:04d}-{b if day_first else a:02d}-{a if day_first else b:02d}", "D")
                for a, b, y, _ in dates
                if a >= 1 and b >= 1
            ]
            steps[day_first] = set(np.abs(np.diff(np.array(days)).astype(int)).tolist()) - {0} if days else set()
        consecutive = [day_first for day_first, s in steps.items() if s == {1}]
        if len(consecutive) == 1:
            return consecutive[0]
    raise CellFault(0, f"'{texts[0]}' can be read day first or month first", _STATE_ORDER, texts[0], "day order")


def _hint(text: str) -> str | None:
    """Advice for a time that cannot be read; None where there is none."""
    if re.search(r"\d [A-Z]{3,5}$", text):
        return (
            "a zone's letters are not unique: write an offset such as +01:00, or leave them out and name the zone "
            "(--time-zone, time_zone)"
        )
    if is_time_of_day(text):
        return (
            "the date is missing: put date and time in one column, or say how far rows are apart: "
            "--time '' --sample-time SECONDS"
        )
    return "write for instance 2024-01-31 13:45:00"


def _zone(name: str) -> ZoneInfo:
    """Zone by IANA name; an Arrow offset such as +01:00 has no such name and is shown in UTC."""
    try:
        return ZoneInfo(name)
    except (ValueError, OSError, KeyError):
        return ZoneInfo("UTC")


def _moment(ticks: int, per_second: int) -> datetime:
    """Date and time of ticks since 1970."""
    try:
        return datetime(1970, 1, 1) + timedelta(microseconds=ticks * 10**6 // per_second)
    except OverflowError:
        raise CellFault(0, "is outside the range of times") from None


@lru_cache(maxsize=4096)
def _changes(zone: str, year: int) -> tuple[tuple[int, int], ...]:
    """Changes of a zone's clocks in a year of UTC, its first moment too: (s since 1970, s ahead of UTC since then).

    Asked of zoneinfo and not of Arrow, which finds no database of zones on Windows and in bare containers.
    """
    clock = ZoneInfo(zone)

    def ahead(t: int) -> int:
        offset = (datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=t)).astimezone(clock).utcoffset()
        return 0 if offset is None else round(offset.total_seconds())

    first, end = (int(datetime(y, 1, 1, tzinfo=UTC).timestamp()) for y in (year, year + 1))
    found = [(first, ahead(first))]
    for day in range(first, end, 86400):
        low, high = day, min(day + 86400, end) - 1
        offset = ahead(high)
        if offset == found[-1][1]:
            continue
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if ahead(middle) == offset else (middle, high)
        found.append((low if ahead(low) == offset else high, offset))
    return tuple(found)


class _Fold:
    """Local times to UTC through one pass; in the hour that autumn repeats, the second run follows a step back.

    Where tags stand one after the other, each begins anew.
    """

    def __init__(self, zone: str) -> None:
        self._zone = zone
        self._last: int | None = None
        self._second = False

    def __call__(
        self, ticks: NDArray[np.int64], per_second: int, begins: NDArray[np.bool_] | None = None
    ) -> NDArray[np.int64]:
        if not len(ticks):
            return ticks
        begin, offset = self._clock(ticks, per_second)
        last = np.searchsorted(begin + offset, ticks, side="right") - 1  # the latest setting that shows this time
        late = ticks - offset[last]
        before = ticks - offset[last - 1]
        twice = before < begin[last]  # the setting before showed it too
        skipped = np.append(begin[1:], np.iinfo(np.int64).max)[last] <= late
        if skipped.any():
            at = int(np.argmax(skipped))
            moment = _moment(int(ticks[at]), per_second)
            raise CellFault(at, f"{moment} does not exist in {self._zone}", "check time_zone")
        early = np.where(twice, before, late)
        if not twice.any():
            self._second = False
        else:
            back = np.diff(ticks, prepend=ticks[0] if self._last is None else self._last) < 0
            second = self._second
            for i in np.flatnonzero(twice | np.concatenate(([False], twice[:-1]))):
                anew = begins is not None and begins[i]
                second = bool(twice[i] and not anew and (second or back[i]))
                if second:
                    early[i] = late[i]
            self._second = second and bool(twice[-1])
        self._last = int(ticks[-1])
        out: NDArray[np.int64] = early
        return out

    def _clock(self, ticks: NDArray[np.int64], per_second: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Changes of the clock from two years before these times to a year after: since when, how far ahead of UTC."""
        years = []
        for at in (int(np.argmin(ticks)), int(np.argmax(ticks))):
            years.append(int(ticks[at]) // per_second // 31556952 + 1970)
            if not 1700 <= years[-1] <= 2250:
                raise CellFault(at, "is outside the range of times")
        changes = [change for year in range(years[0] - 2, years[1] + 2) for change in _changes(self._zone, year)]
        kept = [changes[0], *(b for a, b in pairwise(changes) if a[1] != b[1])]
        begin, offset = (np.array(column, np.int64) * per_second for column in zip(*kept, strict=True))
        return begin, offset
