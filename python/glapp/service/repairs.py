"""Before and after a repair that is noted in the service: answers and recordings on either side.

A repair is noted by a person, with its time. From then on the fits of the loop look at what was recorded after it only.
Where the widths of single days fall from one day to the next, that is reported, and a person may note the repair.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from .. import repair
from ..loop import Loop
from ..recording import Batch
from ..repaired import Repair, Side
from .recordings import SignalStore
from .store import Reader

__all__ = ["compared", "fall_of", "repaired_at"]


def repaired_at(reader: Reader, loop: str, until: float = math.inf) -> float:
    """Time of the last repair of a loop's valve before a moment [s since 1970 UTC]; minus infinity: never."""
    return max((row["time"] for row in reader.repairs(loop) if row["time"] <= until), default=-math.inf)


def fall_of(recordings: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """The fall of the width between two days, by the recordings of a fit alone; None where it has not fallen.

    - `recordings`: `fit.recordings` of the answer document.

    Returns as `glapp.repair.fall_of`, times in s since 1970 UTC.
    """
    counted = [one for one in recordings if one["t0"] is not None and one["left_out"] is None]
    return repair.fall_of(
        [
            {"t": datetime.fromisoformat(one["t0"]).timestamp()}
            | {name: one[name] for name in ("verdict", "d", "low", "high")}
            for one in counted
        ]
    )


def compared(folder: Path, settings: str, at: float, now: float) -> Repair:
    """A valve before and after a repair, by the recordings up to 7 days before and after it.

    - `folder`: the data folder.
    - `settings`: the loop, as JSON.
    - `at`, `now`: when it was repaired, and the end of what is looked at [s since 1970 UTC].
    """
    loop = Loop(**json.loads(settings))
    with Reader(folder) as reader:
        answers = reader.answers(loop.name, 1000)
        others = [row["time"] for row in reader.repairs(loop.name)]
    reach = repair.DAYS * repair.DAY
    begin = max([at - reach, *(time for time in others if time < at)])
    end = min([at + reach, now, *(time for time in others if time > at)])
    either = (
        next((row for row in answers if row["t_end"] <= at + 1.0 and row["t_end"] > begin), None),
        next((row for row in answers if row["t_begin"] >= at - 1.0 and row["t_begin"] < end), None),
    )
    rows = [repair.rows_between(SignalStore(folder).recordings(loop, a, b)) for a, b in ((begin, at), (at, end))]
    sides = [_side(answer, part) for answer, part in zip(either, rows, strict=True)]
    return repair.compared(datetime.fromtimestamp(at, UTC), (sides[0], sides[1]), (rows[0], rows[1]))


def _side(answer: Mapping[str, Any] | None, rows: Batch | None) -> Side:
    """One side of a repair, by an answer and its rows."""
    width = {} if answer is None else {name: answer[name] for name in ("verdict", "confidence", "d", "low", "high")}
    begin, end = (datetime.fromtimestamp(t, UTC) for t in repair.ends_of(rows)) if rows is not None else (None, None)
    return Side(begin, end, **width)
