"""Data of the plant for display, read from the service's database, which is never written here."""

from __future__ import annotations

import csv
import io
import json
import math
import sqlite3
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from .. import _glapp
from .._glapp import to_text
from ..errors import InputError
from ..escape import for_spreadsheet
from ..loop import Loop
from ..report.words import URGENCIES, VERDICTS, count, named, number
from ..service.settable import with_settings
from ..service.store import Reader

__all__ = ["LoopRow", "Trend", "View", "age", "as_csv", "summary", "trend"]

BEHIND = 20.0
"""Age from which the status is late: the service writes it every 5 s [s]."""

SILENT = 60.0
"""A loop is silent where its connection has given no sign of life for so long [s], …"""

STILL = 600.0
"""… or where it has, and yet no value of PV came for so long [s], or for five of its sample times."""

DAY = 86400.0
"""[s]"""

TREND_DAYS = 90
"""A trend is that of the fits, or of the detections, of so many days."""

INTERVAL = 3.92
"""A 95 % interval is so many standard errors wide."""

UNJUDGED = "Not judged yet"
"""Text on a loop before its first fit."""

HEALTH = {
    "NORMAL": "Good",
    "MAINTENANCE_REQUIRED": "Maintenance required",
    "CHECK_FUNCTION": "Check function",
    "FAILURE": "Failure",
}
"""NAMUR NE 107 in its own words; what `glapp.service.monitor.Health` never says is not here."""


@dataclass(frozen=True, slots=True)
class Trend:
    """Trend of a width.

    - `slope`: [OP unit per 30 days]
    - `spread`: half of its 95 % interval [the same].
    - `days`: over how many days it was seen.
    - `moves`: whether it is more than chance.
    """

    slope: float
    spread: float
    days: float
    moves: bool


def trend(days: Sequence[float], widths: Sequence[float], errors: Sequence[float] | None = None) -> Trend | None:
    """The straight line through widths, by the one rule that the fit and the fleet go by too (`crates/fit`, `Trend`).

    - `days`: when, in order [d].
    - `widths`: how wide [OP unit].
    - `errors`: their standard errors [OP unit], where they are known.

    Returns: None with fewer than five widths.

    Examples
    --------
    >>> found = trend(range(10), [1.0 + 0.03 * day for day in range(10)])
    >>> round(found.slope, 6), found.moves
    (0.9, True)
    >>> trend([0, 1, 2], [1.0, 2.0, 3.0]) is None
    True
    """
    found = _glapp.width_trend([DAY * day for day in days], list(widths), None if errors is None else list(errors))
    if found["code"] == "too_few":
        return None
    (first, last), slope = found["t"], found["per_day"]
    return Trend(30.0 * slope, 30.0 * (found["high"] - slope), (last - first) / DAY, found["code"] != "steady")


@dataclass(frozen=True, slots=True)
class LoopRow:
    """A loop in the overview.

    - `loop`: its name.
    - `rank`: its place in the list: what maintenance should do first comes first.
    - `width`: the one answer in a line: width with interval in % of span where that is known, else with its unit.
    - `percent`: the width that lists rank by [% of span].
    - `verdict`: the one verdict.
    - `urgency`: how soon: "high", "medium", "low", "none"; "signal" where its signal is bad or missing, "unjudged"
      before its first fit.
    - `soon`: the same in words.
    - `trend`: how the width moves.
    - `health`: NE 107, in its own words.
    - `seen`: how old the newest PV is.
    - `todo`: what to do.
    - `compensation`: what the compensation does; empty where there is none.
    """

    loop: str
    rank: int
    width: str
    percent: float | None
    verdict: str
    urgency: str
    soon: str
    trend: str
    health: str
    seen: str
    todo: str
    compensation: str


class View:
    """Present state of the service's database.

    - `folder`: the data folder.
    - `clock`: the time [s since 1970 UTC].
    """

    def __init__(self, folder: Path, clock: Callable[[], float] = time.time) -> None:
        self.folder, self._clock = folder, clock
        self._lock = threading.Lock()
        self._reader: Reader | None = None
        self._opened: tuple[int, int] | None = None
        self.at: float | None = None
        self.shown: dict[str, Any] = {"loops": {}}
        self.loops: dict[str, Loop] = {}
        self._given: dict[str, Loop] = {}
        self._set: dict[str, dict[str, Any]] = {}
        self.why: str | None = "the service has not written anything yet"
        self._answers: dict[str, tuple[int, dict[str, Any], Trend | None]] = {}
        self._trends: dict[str, Trend] = {}
        self._believed: dict[str, dict[str, Any]] = {}
        self._trended = -math.inf
        self._new_at = math.inf

    # Reading

    def read(self, what: Callable[[Reader], Any]) -> Any:
        """Something from the database, in the caller's thread.

        Raises InputError where there is none, or it cannot be read.
        """
        with self._lock:
            return self._read(what)

    def _read(self, what: Callable[[Reader], Any]) -> Any:
        """Result of a query; the database is opened again where it was replaced."""
        path = self.folder / "glapp.db"
        try:
            stat = path.stat()
            found = (stat.st_dev, stat.st_ino)
        except OSError:
            raise InputError("holds no glapp.db", file=str(self.folder), hint="start glapp watch on it") from None
        if self._reader is None or found != self._opened:  # the service has set the old one aside
            if self._reader is not None:
                self._reader.close()
            self._reader, self._opened = None, None
            self._reader, self._opened = Reader(self.folder), found
            self.loops.clear()
            self._answers.clear()
        try:
            return what(self._reader)
        except sqlite3.Error as error:
            self._reader.close()
            self._reader = None
            raise InputError(f"cannot be read: {error}", file=str(path)) from None

    def refresh(self) -> None:
        """Read the service's status; where that cannot be read, the last one stays, with its age."""
        try:
            self.read(self._take)
            self.why = None
        except InputError as error:
            self.why = str(error)

    def _take(self, reader: Reader) -> None:
        """Take the present state of the database."""
        if self.loops and reader.shown_at() == self.at:
            return
        shown = reader.shown()
        if shown is None:
            raise InputError("the service has not written anything yet", file=str(self.folder))
        (self.at, self.shown), self._new_at = shown, time.monotonic()
        names = self.shown["loops"].keys()
        if not names <= self.loops.keys():
            for name, given in reader.loops_given().items():
                self._given[name] = self.loops[name] = Loop(**given)
            self._set.clear()
        for name, settings in reader.all_settings().items():
            if name in self._given and self._set.get(name) != settings:
                self._set[name] = settings
                self.loops[name] = with_settings(self._given[name], settings)
        ids = {name: loop["answer"]["id"] for name, loop in self.shown["loops"].items() if loop["answer"] is not None}
        new = [id for name, id in ids.items() if name not in self._answers or self._answers[name][0] != id]
        for i in range(0, len(new), 500):
            for row in reader.answers_shown(new[i : i + 500]):
                if row["answer"] is not None:
                    self._answers[row["name"]] = (
                        row["id"],
                        json.loads(row["answer"]),
                        _trend_within(row["recordings"]),
                    )
                    self._believed[row["name"]] = {
                        "recordings": json.loads(row["recordings"] or "[]"),
                        "process": json.loads(row["process"] or "null"),
                        **{name: row[name] for name in ("file", "t_begin", "t_end", "time", "asked_by")},
                    }
        if self._clock() - self._trended > 3600.0:
            self._trended = self._clock()
            self._trends = _trends(reader, self._clock())

    def answer(self, loop: str) -> dict[str, Any] | None:
        """The one answer of a loop, as `glapp analyze --json` has it; None before the first fit."""
        found = self._answers.get(loop)
        return None if found is None else found[1]

    def believed(self, loop: str) -> dict[str, Any] | None:
        """Basis of a loop's answer: recordings, process, first and last time, and who asked for it when."""
        return self._believed.get(loop) if loop in self._answers else None

    def trend(self, loop: str) -> Trend | None:
        """Trend of a loop's width: from day to day within the last fit, from fit to fit, or by its detections."""
        own = None if loop not in self._answers else self._answers[loop][2]
        return own or self._trends.get(loop)

    @property
    def behind(self) -> float | None:
        """Time since the service last wrote [s], where that is too long; None where it is not.

        By this computer's clock, and by the time since it was seen, where that clock was set back meanwhile.
        """
        if self.at is None:
            return None
        past = max(self._clock() - self.shown.get("wall", self.at), time.monotonic() - self._new_at)
        return past if past > BEHIND else None

    @property
    def catching_up(self) -> dict[str, Any] | None:
        """Lag of a simulated fast plant behind the clock; None where it is not."""
        found: dict[str, Any] | None = self.shown.get("behind")
        return None if self.behind is not None else found

    @property
    def now(self) -> float:
        """The time of the shown data [s since 1970 UTC]: that of a plant that catches up, else the clock's."""
        return self._clock() if self.catching_up is None or self.at is None else self.at

    @property
    def fitting(self) -> bool:
        """Whether a loop is fitted."""
        return any(status["fitting"] for status in self.shown["loops"].values())

    def progress(self, loop: str) -> str:
        """Progress of a loop's fit; empty where none is under way.

        A guess is the time that the last fit of this loop took, or the longest of the others.
        """
        status = self.shown["loops"].get(loop) or {}
        fit = status.get("fit")
        if self.behind is not None:
            return ""  # a service that does not write may not be fitting either
        if fit is None:
            return "Being judged." if status.get("fitting") else ""
        if fit["since"] is None:
            return "Will be judged next." if fit["after"] is None else f"Will be judged after {fit['after']}."
        past = max(0.0, self._clock() - fit["since"])
        about = "" if fit["about"] is None else f" of about {max(fit['about'], 1.0):.0f} s"
        return f"Being judged: {past:.0f} s{about or ' so far'}."

    def judged_at(self) -> str:
        """Time at which new loops are judged next."""
        at = self.shown.get("fits_at")
        return "tonight" if at is None else f"at {time.strftime('%H:%M', time.localtime(at))}"

    def silent(self, loop: str) -> bool:
        """Whether nothing comes of a loop any more, as the service saw it last; its first value may take a while.

        Of a plant that catches up values come in bursts, hours of it at once: none of its loops is silent.
        """
        status = self.shown["loops"].get(loop)
        if status is None:
            return True
        if self.catching_up is not None:
            return False
        now = self.at or self._clock()
        if status["seen"] is None:
            return bool(now - self.shown["begun"] > SILENT)
        if status.get("lost"):
            return True
        sample = None if loop not in self.loops else self.loops[loop].sample_time
        seldom = 5.0 * (sample or 0.0)
        if now - max(status["seen"], status["heard"] or 0.0) > max(SILENT, seldom):
            return True
        return bool(now - status["seen"] > max(STILL, seldom))

    @property
    def unconnected(self) -> str | None:
        """Why the service is not connected to the plant; None where it is."""
        why: str | None = self.shown.get("unconnected")
        return why

    @property
    def newest(self) -> float | None:
        """Time of the newest PV of all loops [s since 1970 UTC]; None where none has come."""
        return max((one["seen"] for one in self.shown["loops"].values() if one["seen"] is not None), default=None)

    def _clocks_differ(self, status: Mapping[str, Any]) -> bool:
        """Whether values of a loop come, but with time stamps that are long past when they do."""
        behind: float | None = status.get("age")
        return behind is not None and behind > SILENT and (self.at or self._clock()) - status["seen"] - behind < SILENT

    def percent(self, loop: str, value: float | None) -> float | None:
        """A width in % of span; None where the span is not known."""
        span = None if loop not in self.loops else self.loops[loop].op_span
        if value is None:
            return None
        if span is None:
            return value if loop in self.loops and self.loops[loop].op_label == "%" else None
        return value * 100.0 / (span[1] - span[0])

    def unit(self, loop: str) -> str:
        """Unit of OP."""
        return self.loops[loop].op_label if loop in self.loops else "OP unit"

    # Parts of the page

    def rows(self) -> list[LoopRow]:
        """Every loop, what maintenance should do first before all else."""
        now = self.now
        found = []
        for name, status in self.shown["loops"].items():
            answer = self.answer(name)
            silent = self.silent(name)
            wrong = silent or status["good"] is False or status.get("missing") is not None
            urgency = "none" if answer is None else answer["urgency"]
            width = None if answer is None else answer["width_percent_span"]
            # A bad or missing signal comes after urgent loops, and before all others.
            place = [3.5] if answer is None else list(answer["rank"])
            if wrong:
                place[0] = 0.5
            found.append((place, name, status, answer, wrong, silent, urgency, width))
        found.sort(key=lambda one: one[:2])
        rows = []
        for rank, (_, name, status, answer, wrong, silent, urgency, width) in enumerate(found):
            never = "never" if silent else "not yet"
            seen = never if status["seen"] is None else age(now - status["seen"])
            if status["good"] is False:
                seen += f", bad: {status['note']}"
            rows.append(
                LoopRow(
                    loop=name,
                    rank=rank + 1,
                    width=self.headline(name),
                    percent=width,
                    verdict=self.verdict(name),
                    urgency="signal" if wrong else "unjudged" if answer is None else urgency,
                    soon="Signal" if wrong else UNJUDGED if answer is None else URGENCIES[urgency],
                    trend=self.trend_text(name),
                    health=_health(status, answer, silent),
                    seen=seen,
                    todo=self.todo(name),
                    compensation=_compensation(status, gone=self.behind is not None),
                )
            )
        return rows

    def todo(self, loop: str) -> str:
        """Next step on a loop."""
        status, answer = self.shown["loops"][loop], self.answer(loop)
        if self.silent(loop) and self.unconnected is not None:
            return "The plant's server is not connected: check the server and the network."
        if (missing := status.get("missing")) is not None:
            return f"{missing}. Correct the tag in loops.toml, or at the server."
        if self.silent(loop) and self._clocks_differ(status):
            return (
                f"The time stamps of its values are {age(status['age'])} behind this computer's clock: set the clock "
                "of the plant's server, or of this computer."
            )
        if self.silent(loop):
            return "Find out why no value comes: transmitter, tag, connection."
        if status["good"] is False:
            note = status["note"] or "no number"
            where = "Set the clocks of plant and service" if "clock" in note else "Look at the transmitter"
            return f"{where}: PV is bad ({note})."
        if status["fitting"]:
            return self.progress(loop)
        if answer is None:
            why = f"{status['why']}: write them into loops.toml. " if status["why"] else ""
            return f"{why}It will be judged {self.judged_at()}; Fit now does it at once."
        return str(answer["next"]["text"])

    def headline(self, loop: str) -> str:
        """The one answer in a line: width with its interval, or the one limit that is known."""
        answer, status = self.answer(loop), self.shown["loops"].get(loop)
        if answer is None:
            estimate = None if status is None else status["estimate"]
            percent = self.percent(loop, estimate)
            if percent is not None:
                return f"≈ {number(percent)} %"
            return "" if estimate is None else f"≈ {number(estimate)} {self.unit(loop)}"
        in_percent = answer["limit"] is not None and answer["limit"]["width"] is not None
        of_span = "_percent_span" if in_percent else ""
        low, high, width = (answer[f"{key}{of_span}"] for key in ("low", "high", "width"))
        unit = "%" if in_percent else self.unit(loop)
        if answer["verdict"] == "at_least":
            return f"> {number(low)} {unit}"
        if answer["verdict"] == "sound":
            return f"< {number(high)} {unit}"
        if width is None:
            return "" if low is None and high is None else f"{number(low)} to {number(high)} {unit}"
        if low is None and high is None:
            return f"≈ {number(width)} {unit}"
        if high is None:
            return f"> {number(low)} {unit}"
        return f"{number(width)} {unit} ({number(low)} to {number(high)})"

    def verdict(self, loop: str) -> str:
        """The one verdict in words; before the first fit that of the crossings."""
        answer, status = self.answer(loop), self.shown["loops"].get(loop)
        if answer is not None:
            return named(answer["confidence"], str(answer["verdict"]))
        if status is None or status["why"] or status["estimate"] is None:
            return UNJUDGED
        few = loop in self.loops and status["detections"] < self.loops[loop].n
        return "Provisional, by crossings" if few else "Estimate, by crossings"

    def trend_text(self, loop: str) -> str:
        """Trend of the width in a few words, and when it will have reached the acceptable limit."""
        found = self.trend(loop)
        if found is None:
            return "–"
        if not found.moves:
            return "→ steady"
        slope, spread = (self.percent(loop, value) for value in (found.slope, found.spread))
        unit = "%" if slope is not None else self.unit(loop)
        slope, spread = (found.slope, found.spread) if slope is None or spread is None else (slope, spread)
        arrow, sign = ("↗", "+") if slope > 0 else ("↘", "−")
        text = f"{arrow} {sign}{number(abs(slope), 2)} ± {number(spread, 1)} {unit}/month"
        answer = self.answer(loop)
        limit = None if answer is None else answer["limit"]
        width = None if answer is None else answer["width_percent_span"]
        if limit is not None and width is not None and slope > 0 and width < limit["percent_span"]:
            days = (limit["percent_span"] - width) / slope * 30.0
            text += f"; at {number(limit['percent_span'])} % in {number(days, 2)} d"
        return text


def summary(rows: Sequence[LoopRow], when: str = "tonight") -> str:
    """The plant in a line; `when` is when those are judged that are not yet.

    >>> summary([])
    '0 loops. Nothing is urgent.'
    >>> summary([LoopRow("FIC101", 1, "", None, UNJUDGED, "unjudged", UNJUDGED, "", "–", "now", "", "")], "at 02:00")
    '1 loop. 1 is not judged yet: at 02:00.'
    """
    swings = VERDICTS["oscillation"]
    needs = ["tuning" if row.urgency == "medium" and row.verdict == swings else row.urgency for row in rows]
    counted = [(key, needs.count(key)) for key in ("high", "signal", "tuning", "medium")]
    sentences = [to_text(f"answer.run {key}", {"n": n}) for key, n in counted if n]
    if unjudged := sum(row.urgency == "unjudged" for row in rows):
        sentences.append(f"{unjudged} {'is' if unjudged == 1 else 'are'} not judged yet: {when}.")
    return " ".join([f"{count(len(rows), 'loop')}.", *(sentences or [to_text("answer.run calm")])])


def _health(status: Mapping[str, Any], answer: Mapping[str, Any] | None, silent: bool) -> str:
    """NE 107 of a loop; a valve that nobody has judged yet is not called good."""
    if silent and status["health"] != "FAILURE":
        return HEALTH["CHECK_FUNCTION"]
    return "–" if answer is None and status["health"] == "NORMAL" else HEALTH[status["health"]]


def _compensation(status: Mapping[str, Any], *, gone: bool = False) -> str:
    """State of the compensation; where the service is gone, one that was on is not known.

    >>> _compensation({"compensation": {"enabled": False, "withdrawn": "worse"}})
    'withdrawn'
    >>> _compensation({"compensation": {"enabled": False, "withdrawn": None}})
    'off'
    >>> _compensation({"compensation": {"enabled": True, "standing": "active"}}, gone=True)
    'not known'
    """
    made = status.get("compensation")
    if made is None:
        return ""
    if not made["enabled"]:
        return "off" if made["withdrawn"] is None else "withdrawn"
    if gone:
        return "not known"
    return "on" if made["standing"] == "active" else f"on, {made['standing'].replace('_', ' ')}"


def _trend_within(recordings: str | None) -> Trend | None:
    """The trend within one answer: of the widths that its recordings gave each by itself, where they did."""
    return _through(
        [
            (datetime.fromisoformat(one["t0"]).timestamp() / DAY, one["d"], one["low"], one["high"])
            for one in json.loads(recordings or "[]")
            if one["t0"] is not None and one["left_out"] is None and one["verdict"] in ("backlash", "both")
        ]
    )


def _through(rows: Sequence[tuple[float, float, float | None, float | None]]) -> Trend | None:
    """The trend of (day, width, and the limits of its interval); the limits count where all widths have them."""
    errors = [(high - low) / INTERVAL for _, _, low, high in rows if low is not None and high is not None]
    days, widths = [day for day, _, _, _ in rows], [d for _, d, _, _ in rows]
    return trend(days, widths, errors if len(errors) == len(rows) else None)


def _trends(reader: Reader, now: float) -> dict[str, Trend]:
    """The trend of each loop, a mean a day: of the widths and limits that the fits found, else of the detections.

    Detections under compensation show what is left of the gap, and do not count.
    """
    found: dict[str, Trend] = {}
    since = now - TREND_DAYS * DAY
    for daily in (reader.daily_detections(since), reader.daily_widths(since)):
        by_loop: dict[str, list[tuple[float, float, float | None, float | None]]] = {}
        for row in daily:
            by_loop.setdefault(row["name"], []).append((row["day"], row["d"], row["low"], row["high"]))
        for name, rows in by_loop.items():
            if (one := _through(rows)) is not None:
                found[name] = one
    return found


def age(seconds: float) -> str:
    """Age, as coarse as a person reads it.

    >>> age(0.4), age(47), age(200), age(7500), age(400000)
    ('now', '40 s', '3 min', '2 h', '4 d')
    """
    if seconds < 10.0:
        return "now"
    if seconds < 60.0:
        return f"{seconds // 10 * 10:.0f} s"
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= size * (1 if unit == "min" else 2):
            return f"{seconds // size:.0f} {unit}"
    return f"{seconds // 60:.0f} min"


def as_csv(rows: Sequence[LoopRow] | Sequence[Mapping[str, Any]]) -> str:
    r"""A table as CSV; no text in it is a formula to a spreadsheet.

    >>> as_csv([{"loop": "=1+1", "width": "−2"}])
    "loop,width\r\n'=1+1,−2\r\n"
    """
    plain = [asdict(row) if isinstance(row, LoopRow) else dict(row) for row in rows]
    out = io.StringIO()
    if plain:
        writer = csv.DictWriter(out, list(plain[0]))
        writer.writeheader()
        for row in plain:
            writer.writerow({key: for_spreadsheet(x) for key, x in row.items()})
    return out.getvalue()
