"""Before and after a repair, of recordings: noted by a person, or seen as a fall of the width.

What counts as a fall, what the loop gained and how sure that is, is decided in `crates/analysis/src/repair.rs`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

from . import _glapp
from .estimate import analyze
from .fit import DAY, Fit, RecordingFit, Window
from .recording import Batch, Recording, joined
from .repair_split import moment_in, until_repair
from .repaired import Repair, Side
from .result import Result
from .several_recordings import analyze_recordings

__all__ = ["DAY", "DAYS", "compared", "ends_of", "fall_of", "rows_between", "with_repair"]

DAYS = 7.0
"""Days before the repair and after it that are compared."""

_WIDTH = ("verdict", "d", "low", "high")
_VERDICTS = ("backlash", "stiction", "both", "oscillation", "sound", "at_least", "cannot_tell")
"""Verdicts of a fit; where only zero crossings were looked at, the verdict is another one and has no width."""


def with_repair(recordings: Sequence[Recording], result: Result, *, trust: bool = False, fit: bool = True) -> Result:
    """The result with `Result.repair`: the valve before and after, where a repair is noted or the width has fallen.

    A repair is noted by `repaired` of the loop; the result is then that of what was recorded after it. Else the widths
    of the single recordings, or of the windows of one, are looked at: where they fall at once, the two sides are what
    was recorded before and after the fall, and the widths are the means of either.

    - `recordings`: all recordings of the loop.
    - `result`: the result of `glapp.analyze` for them.
    - `trust`, `fit`: as in `glapp.analyze`.

    Examples
    --------
    >>> import glapp
    >>> import numpy as np
    >>> from datetime import datetime
    >>> acting = {"setpoint": [(900 * i, i % 2) for i in range(8)], "noise": 0.1, "h": 2.0, "t_end": 7200}
    >>> days = [glapp.simulate.closed_loop(([0.8], [20, 1], 5), (0.5, 20), d=d, seed=1, **acting) for d in (2.0, 0.0)]
    >>> t = np.datetime64("2026-03-01T10:00") + np.arange(2 * len(days[0].t)) * np.timedelta64(2, "s")
    >>> loop = glapp.Loop(name="FIC101", op_span=(-50, 50), repaired=datetime(2026, 3, 1, 12, 0))
    >>> whole = glapp.recording_from({"t": t, **{s: np.concatenate([getattr(day, s) for day in days])
    ...                               for s in ("sp", "pv", "op")}}, loop)
    >>> result = with_repair([whole], glapp.analyze(whole))
    >>> result.answer.valve, result.repair.before.low < 2.0 < result.repair.before.high, result.repair.width.code
    ('no_gap', True, 'less')
    """
    noted = recordings[0].loop.repaired
    if noted is None:
        return _seen(recordings, result)
    earlier = until_repair(recordings)
    before = Side()
    if earlier:
        if len(earlier) > 1:
            then = analyze_recordings(earlier, trust=trust, fit=fit)
        else:
            then = analyze(earlier[0], trust=trust, fit=fit)
        before = _side(then)
    at = _since_1970(recordings[0]) + moment_in(recordings[0], noted)
    return replace(result, repair=_compared(recordings, noted, (before, _side(result)), (at, at)))


def _seen(recordings: Sequence[Recording], result: Result) -> Result:
    """The result with the repair that a fall of the width shows, and which is not noted in the settings."""
    if result.fit is None:
        return result
    each: list[tuple[float, float, Fit | Window]]
    if result.fit.recordings:
        if any(single.t0 is None for single in result.fit.recordings):
            return result
        counted = [single for single in result.fit.recordings if single.left_out is None]
        each = [(_since_1970(single), math.inf, single.fit) for single in counted]
    else:
        begin = _since_1970(recordings[0])
        each = [(begin + single.t_start, begin + single.t_end, single) for single in result.fit.windows]
    found = fall_of([{"t": t} | {name: getattr(single, name) for name in _WIDTH} for t, _, single in each])
    if found is None:
        return result
    end = next(end for t, end, _ in each if t == found["t"][0])
    cuts = (min(end, found["t"][1]), found["t"][1])
    sides = (_mean(found["before"]), _mean(found["after"]))
    return replace(result, repair=_compared(recordings, None, sides, cuts))


def fall_of(widths: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Whether the width has fallen from one recording, or window, to the next.

    - `widths`: of each its time `t` [s], `verdict`, `d`, `low` and `high` [OP unit].

    Returns: `t` of the last before and the first after; `before` and `after`, the mean widths with their 95 % limits.

    Examples
    --------
    >>> days = [{"t": t, "verdict": "backlash", "d": d, "low": d - 0.2, "high": d + 0.2}
    ...         for t, d in ((0, 2.0), (1, 2.1), (2, 0.4), (3, 0.3))]
    >>> found = fall_of(days)
    >>> found["t"], round(found["before"][0], 2), round(found["after"][0], 2)
    ([1.0, 2.0], 2.05, 0.35)
    """
    return _glapp.width_fall(json.dumps([_for_core(width) for width in widths if width["verdict"] in _VERDICTS]))


def _for_core(width: Mapping[str, Any]) -> dict[str, Any]:
    """A width in JSON's types: a limit that is not finite is none."""
    numbers = {name: width[name] for name in ("d", "low", "high")}
    finite = {name: x if x is not None and math.isfinite(x) else None for name, x in numbers.items()}
    return {"t": width["t"], "verdict": width["verdict"], **finite}


def compared(noted: datetime | None, sides: tuple[Side, Side], rows: tuple[Batch | None, Batch | None]) -> Repair:
    """The repair with the loop's gain in performance.

    - `noted`: as in `Repair`.
    - `sides`: before and after, with their widths.
    - `rows`: what was recorded on either side.
    """
    widths = [
        _for_core({"t": 0.0} | {name: getattr(side, name) for name in _WIDTH}) if side.verdict in _VERDICTS else None
        for side in sides
    ]
    return Repair.from_core(noted, sides, _glapp.before_after(rows, json.dumps(widths)))


def _side(result: Result) -> Side:
    """One side of a repair, by the result of its recordings."""
    answer = result.answer
    low, high = (None, None) if answer.width_kind == "unsure" else (answer.low, answer.high)
    return Side(verdict=answer.verdict, confidence=answer.confidence, d=answer.width, low=low, high=high)


def _mean(width: Sequence[float]) -> Side:
    """The mean width on one side of a fall; none where its limits begin at 0."""
    d, low, high = width
    return Side(verdict="backlash" if low > 0.0 else "sound", d=d, low=low, high=high)


def _compared(
    recordings: Sequence[Recording], noted: datetime | None, sides: tuple[Side, Side], cuts: tuple[float, float]
) -> Repair:
    """The repair with performance by the rows `DAYS` days before the first cut and after the second one [s]."""
    first, last = (cuts[0] - DAYS * DAY, cuts[0]), (cuts[1], cuts[1] + DAYS * DAY)
    rows = [rows_between(recordings, begin, end) for begin, end in (first, last)]
    timed = []
    for side, part in zip(sides, rows, strict=True):
        begin, end = (None, None) if part is None else (_moment(recordings[0], t) for t in ends_of(part))
        timed.append(replace(side, begin=begin, end=end))
    return compared(noted, (timed[0], timed[1]), (rows[0], rows[1]))


def rows_between(recordings: Sequence[Recording], begin: float = -math.inf, end: float = math.inf) -> Batch | None:
    """The rows from `begin` on and before `end` [s], with times since 1970 where they have a date; None for none."""
    parts = []
    for recording in recordings:
        zero = _since_1970(recording)
        for batch in recording.batches():
            inside = (batch.t >= begin - zero) & (batch.t < end - zero)
            if inside.any():
                part = batch[inside]
                parts.append(replace(part, t=part.t + zero))
    parts.sort(key=lambda part: float(part.t[0]))
    return joined(parts) if parts else None


def ends_of(rows: Batch) -> tuple[float, float]:
    """The first and the last time among rows [s]."""
    return float(rows.t.min()), float(rows.t.max())


def _since_1970(recording: Recording | RecordingFit) -> float:
    """Time 0 of a recording [s since 1970], by its own clocks where it has no zone; 0 without a date."""
    if recording.t0 is None:
        return 0.0
    t0 = recording.t0 if recording.t0.tzinfo is not None else recording.t0.replace(tzinfo=UTC)
    return t0.timestamp()


def _moment(recording: Recording, t: float) -> datetime | float:
    """A time of a recording as date and time, or as seconds without a date."""
    if recording.t0 is None:
        return t
    zone = recording.t0.tzinfo
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=round(t, 3))
    return moment.replace(tzinfo=None) if zone is None else moment.astimezone(zone)
