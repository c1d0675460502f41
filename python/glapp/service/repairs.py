"""Before and after a repair: the width, and what the loop gained.

A repair is noted by a person, with its time. From then on the fits of the loop look at what was recorded after it only.
Where the widths of single days fall from one day to the next, that is told, and a person may note the repair.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from .. import _glapp
from .._glapp import number, quantity
from ..loop import Loop
from ..recording import Batch, Recording, joined
from .recordings import SignalStore
from .store import Reader

__all__ = ["DAYS", "Compared", "Fall", "Gained", "compared", "fall_of", "repaired_at", "texts"]

DAYS = 7.0
"""So many days before the repair and after it are compared."""

DAY = 86400.0

TURN = 0.1
"""OP has turned where it went back by so much of the width before, …"""

TURN_OF_TRAVEL = 0.001
"""… or where that is not known of OP's range."""

Between = tuple[float, float, float]
"""A number with its 95 % interval."""


@dataclass(frozen=True, slots=True)
class Gained:
    """How the loop did on one side of the repair; all with a 95 % interval.

    Attributes
    ----------
    days : float
        Time in automatic that was looked at [d].
    deviation : Between
        Standard deviation of PV about SP [PV unit].
    travel, reversals : Between or None
        Travel [OP unit] and reversals of OP in a day.
    """

    days: float
    deviation: Between
    travel: Between | None
    reversals: Between | None


@dataclass(frozen=True, slots=True)
class Compared:
    """A valve before and after its repair.

    Attributes
    ----------
    at : float
        When it was repaired [s since 1970 UTC].
    widths : (mapping or None, mapping or None)
        The answers before and after: `verdict`, `d`, `low`, `high`; None where there is none.
    loop : (Gained or None, Gained or None)
        How the loop did before and after; None where too little was recorded in automatic.
    """

    at: float
    widths: tuple[Mapping[str, Any] | None, Mapping[str, Any] | None]
    loop: tuple[Gained | None, Gained | None]


@dataclass(frozen=True, slots=True)
class Fall:
    """A width that has fallen from one day to the next.

    Attributes
    ----------
    t : (float, float)
        The last day before and the first after [s since 1970 UTC].
    before, after : Between
        Mean widths [OP unit].
    """

    t: tuple[float, float]
    before: Between
    after: Between


def repaired_at(reader: Reader, loop: str, until: float = math.inf) -> float:
    """When the valve of a loop was last repaired before a moment [s since 1970 UTC]; minus infinity: never."""
    return max((row["time"] for row in reader.repairs(loop) if row["time"] <= until), default=-math.inf)


def fall_of(recordings: Sequence[Mapping[str, Any]]) -> Fall | None:
    """Whether the width has fallen between two days, by what each recording of a fit says alone.

    Parameters
    ----------
    recordings : sequence of mapping
        `fit.recordings` of the answer document.

    Examples
    --------
    >>> days = [{"t0": f"2026-11-{day}T00:00:00+00:00", "left_out": None, "verdict": "backlash", "d": d,
    ...          "low": d - 0.2, "high": d + 0.2} for day, d in ((20, 2.0), (21, 2.1), (22, 0.4), (23, 0.3))]
    >>> found = fall_of(days)
    >>> round(found.before[0], 2), round(found.after[0], 2)
    (2.05, 0.35)
    """
    rows = []
    for one in recordings:
        limits = one["low"], one["high"]
        if one["t0"] is None or one["left_out"] is not None or None in limits or one["d"] is None:
            continue
        if one["verdict"] in ("backlash", "both", "sound"):
            error = max((limits[1] - limits[0]) / 3.92, 1e-9)
            d = one["d"] if one["verdict"] != "sound" else 0.0
            rows.append((datetime.fromisoformat(one["t0"]).timestamp(), d, error))
    rows.sort()
    found = None if len(rows) < 2 else _glapp.width_fall(*(list(column) for column in zip(*rows, strict=True)))
    return None if found is None else Fall(**{name: tuple(value) for name, value in found.items()})


def compared(folder: Path, settings: str, at: float, now: float) -> Compared:
    """A valve before and after a repair, by what was recorded up to `DAYS` days before and after it.

    Parameters
    ----------
    folder : Path
        The data folder.
    settings : str
        The loop, as JSON.
    at, now : float
        When it was repaired, and the end of what is looked at [s since 1970 UTC].
    """
    loop = Loop(**json.loads(settings))
    with Reader(folder) as reader:
        answers = reader.answers(loop.name, 1000)
        others = [row["time"] for row in reader.repairs(loop.name)]
    begin = max([at - DAYS * DAY, *(time for time in others if time < at)])
    end = min([at + DAYS * DAY, now, *(time for time in others if time > at)])
    widths = (
        next((row for row in answers if row["t_end"] <= at + 1.0 and row["t_end"] > begin), None),
        next((row for row in answers if row["t_begin"] >= at - 1.0 and row["t_begin"] < end), None),
    )
    # What a turn of OP is must be the same on both sides.
    width = None if widths[0] is None else widths[0]["d"]
    turn = TURN * width if width else None
    sides = []
    for a, b in ((begin, at), (at, end)):
        recordings = SignalStore(folder).recordings(loop, a, b)
        sides.append([_at_its_time(one) for one in recordings])
    if turn is None:
        ops = [rows.op for side in sides for rows in side if rows.op is not None]
        spans = [float(np.nanmax(op) - np.nanmin(op)) for op in ops if np.isfinite(op).any()]
        turn = TURN_OF_TRAVEL * max(spans, default=0.0)
    return Compared(at, widths, (_gained(sides[0], turn), _gained(sides[1], turn)))


def _at_its_time(recording: Recording) -> Batch:
    """The rows of a recording with times since 1970."""
    rows = joined(list(recording.batches()))
    begin = 0.0 if recording.t0 is None else recording.t0.timestamp()
    return replace(rows, t=rows.t + begin)


def _gained(rows: Sequence[Batch], turn: float) -> Gained | None:
    """How the loop did in these recordings."""
    if not rows:
        return None
    found = _glapp.performance(joined(list(rows)), turn)
    if found is None:
        return None
    pairs = {name: None if found[name] is None else tuple(found[name]) for name in ("travel", "reversals")}
    return Gained(found["seconds"] / DAY, tuple(found["deviation"]), **pairs)


def texts(found: Compared, unit: str, pv_unit: str) -> list[tuple[str, str, str]]:
    """The comparison as a table: what, before, after."""
    before, after = found.loop
    rows = [("Gap", _width(found.widths[0], unit), _width(found.widths[1], unit))]
    for name, label, of in (
        ("deviation", "PV about SP, standard deviation", pv_unit),
        ("travel", "Travel of OP in a day", unit),
        ("reversals", "Reversals of OP in a day", ""),
    ):
        sides = [None if side is None else getattr(side, name) for side in (before, after)]
        rows.append((label, _between(sides[0], of), _between(sides[1], of)))
    rows.append(("Looked at, in automatic", _days(before), _days(after)))
    return rows


def _width(row: Mapping[str, Any] | None, unit: str) -> str:
    if row is None:
        return "not judged"
    if row["d"] is not None and row["low"] is not None and row["high"] is not None:
        return f"{quantity(row['d'], unit)} ({number(row['low'])} to {number(row['high'])})"
    if row["verdict"] == "sound" and row["high"] is not None:
        return f"< {quantity(row['high'], unit)}"
    return str(row["confidence"] or row["verdict"]).replace("_", " ")


def _between(value: Between | None, unit: str) -> str:
    if value is None:
        return "–"
    middle, low, high = (float(f"{x:.3g}") for x in value)
    return f"{quantity(middle, unit)} ({number(low)} to {number(high)})"


def _days(side: Gained | None) -> str:
    if side is None:
        return "too little"
    return f"{number(side.days)} d" if side.days >= 1.0 else f"{number(24.0 * side.days)} h"
