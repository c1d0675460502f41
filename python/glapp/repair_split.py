"""Recordings before and after the repair of their valve, by the `repaired` of their loop."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime

import numpy as np

from .errors import InputError
from .recording import Batch, Recording

__all__ = ["RecordingPart", "moment_in", "since_repair", "until_repair"]


class RecordingPart(Recording):
    """The rows of a recording from one time on and before another.

    - `whole`: the recording.
    - `begin`, `end`: from when to before when, as `Batch.t` counts [s].
    """

    def __init__(self, whole: Recording, begin: float = -math.inf, end: float = math.inf) -> None:
        self._whole, self._begin, self._end = whole, begin, end
        self.name, self.source, self.t0, self.zone = whole.name, whole.source, whole.t0, whole.zone
        self.columns, self.units, self.found = whole.columns, whole.units, whole.found
        self.left_out = whole.left_out
        self.loop = whole.loop.model_copy(update={"repaired": None})  # it has been cut there
        self.rows: int | None = None

    def batches(self, rows: int = 65536) -> Iterator[Batch]:
        """See `Recording.batches`."""
        for batch in self._whole.batches(rows):
            inside = (batch.t >= self._begin) & (batch.t < self._end)
            if inside.any():
                yield batch if inside.all() else batch[inside]

    def fraction_read(self) -> float | None:
        """See `Recording.fraction_read`."""
        return self._whole.fraction_read()

    def release(self) -> None:
        """See `Recording.release`."""
        self._whole.release()


def since_repair(recordings: Sequence[Recording]) -> list[Recording]:
    """The part of the recording after the repair of the valve; all of it where none is noted.

    Raises InputError where nothing was, or a recording has no date to compare with.
    """
    found = []
    for recording in recordings:
        at = recording.loop.repaired
        if at is None:
            found.append(recording)
        elif _ends(recording) >= (begin := moment_in(recording, at)):
            found.append(RecordingPart(recording, begin=begin))
    if not found:
        loop, repaired = recordings[0].loop, recordings[0].loop.repaired
        raise InputError(
            f"is {repaired:%Y-%m-%d %H:%M}, and nothing was recorded after it",
            file=", ".join(recording.source for recording in recordings),
            loop=loop.name,
            parameter="repaired",
            value=repaired,
            hint="add a recording made after the repair, or leave the time of the repair out",
        )
    return found


def until_repair(recordings: Sequence[Recording]) -> list[Recording]:
    """The part of the recording before the repair of the valve; nothing where none is noted."""
    found: list[Recording] = []
    for recording in recordings:
        if (at := recording.loop.repaired) is not None:
            end = moment_in(recording, at)
            if _begins(recording) < end:
                found.append(RecordingPart(recording, end=end))
    return found


def moment_in(recording: Recording, at: datetime) -> float:
    """A moment as the times of a recording count [s]; without a zone it is by the recording's own clocks.

    Raises InputError where the recording has no date, or has no zone and the moment has one.
    """
    t0 = recording.t0
    if t0 is None or (t0.tzinfo is None and at.tzinfo is not None):
        has = "a date" if t0 is None else "a zone"
        raise InputError(
            f"is {at.isoformat(' ')}, and the times of the recording have no {has.removeprefix('a ')}",
            file=recording.source,
            loop=recording.loop.name,
            parameter="repaired",
            value=at,
            hint="give the recording times with a date" if t0 is None else "leave the zone out, or name the time_zone",
        )
    if t0.tzinfo is None:
        return (at - t0).total_seconds()
    at = at if at.tzinfo is not None else at.replace(tzinfo=t0.tzinfo)
    return (at.astimezone(UTC) - t0.astimezone(UTC)).total_seconds()


def _begins(recording: Recording) -> float:
    """Time of the first row [s]."""
    return min((float(np.nanmin(b.t)) for b in recording.batches() if np.isfinite(b.t).any()), default=math.inf)


def _ends(recording: Recording) -> float:
    """Time of the last row [s]."""
    return max((float(np.nanmax(b.t)) for b in recording.batches() if np.isfinite(b.t).any()), default=-math.inf)
