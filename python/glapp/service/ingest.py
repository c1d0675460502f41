"""From a source's values to samples, and through the detectors to half-periods."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from .resampler import ALIVE, CODES, LOST, OP, PV
from .signal import Event, Plant, Signal, Tell, Value
from .store import COLUMNS, Entry, Half
from .watched import WatchedLoop

__all__ = ["Ingest"]


class Ingest:
    """Collects the values of a source, and takes them through resamplers and detectors, an entry at a time.

    - `loops`: the loops.
    - `clock`: the time [s since 1970 UTC].
    """

    def __init__(self, loops: Mapping[str, WatchedLoop], clock: Callable[[], float]) -> None:
        self.source: Plant | None = None
        self._loops, self._clock = loops, clock
        self._by_id = {watched.id: watched for watched in loops.values()}
        self._values: list[Value] = []
        self._lost: set[int] = set()

    async def run(self, source: Plant, tell: Tell) -> None:
        """Take the source's values, until cancelled; a source that ended with its connection is started again."""
        while True:
            task = asyncio.ensure_future(source.run(self.take, tell))
            try:
                await asyncio.wait({task})
                if not task.cancelled():
                    return task.result()
            finally:
                task.cancel()
                await asyncio.wait({task}, timeout=10.0)
            tell(Event(self._clock(), None, "lost", "the connection was ended; it is taken up again"))
            await asyncio.sleep(1.0)

    def take(self, values: Sequence[Value]) -> None:
        """Take values, in the order in which they came."""
        now = self._clock()
        for value in values:
            watched = self._loops.get(value.loop)
            if watched is not None:
                self._values.append(value)
                watched.take(value, now)

    def connected(self, watched: WatchedLoop) -> None:
        """Note that the connection of a loop is back; signals that have not changed meanwhile are not sent again."""
        watched.lost = Signal.PV not in watched.latest

    def lost(self, watched: WatchedLoop) -> None:
        """The connection of a loop was lost: until values come, there is a gap."""
        watched.lost = True
        self._lost.add(watched.id)

    def begin_with_gaps(self) -> None:
        """Begin the signals with a gap, unless a history fills the time before the start."""
        self._lost = {watched.id for watched in self._loops.values() if watched.resampler.known(PV)}

    def alive(self, loop: str) -> float | None:
        """Time of the source's last sign of a loop [s since 1970 UTC]; None where it does not know."""
        return None if self.source is None else self.source.alive(loop)

    def since(self) -> dict[tuple[str, Signal], float]:
        """Source time of the last value of each signal that was taken: a source with a history begins there."""
        found = {}
        for name, watched in self._loops.items():
            for signal, code in CODES.items():
                if (last := watched.resampler.latest(code)) is not None:
                    found[name, signal] = last[0]
        return found

    def entry(self, now: float, position: Callable[[float], int]) -> Entry | None:
        """All that came since the last entry, with losses and signs of life; None where nothing did.

        - `now`: the time [s since 1970 UTC].
        - `position`: gives the number of the entry that is made now.
        """
        # Losses come before the values, which are of the new connection.
        rows = [(id, LOST, True, now, 0.0) for id in sorted(self._lost, reverse=True)]
        self._lost.clear()
        values, self._values = self._values, []
        rows += [(self._loops[v.loop].id, CODES[v.signal], v.good, v.time, v.value) for v in values]
        for name, watched in self._loops.items():
            alive = self.alive(name)
            pv = watched.latest.get(Signal.PV)
            if alive is not None and pv is not None and alive - max(pv.time, watched.alive_entered) >= watched.period:
                watched.alive_entered = alive
                rows.append((watched.id, ALIVE, True, alive, 0.0))
        if not rows:
            return None
        loops, signals, goods, times, numbers = zip(*rows, strict=True)
        return Entry(
            position(now),
            now,
            np.array(loops, np.uint32),
            np.array(signals, np.uint8),
            np.array(goods, np.bool_),
            np.array(times, np.float64),
            np.array(numbers, np.float64),
        )

    def process(self, entry: Entry) -> tuple[list[Half], list[Event]]:
        """The half-periods that end in an entry, and its events; equal entries give equal results."""
        touched: dict[int, WatchedLoop] = {}
        columns = (entry.loop, entry.signal, entry.time, entry.value, entry.good)
        for id, signal, moment, value, good in zip(*(column.tolist() for column in columns), strict=True):
            watched = self._by_id.get(id)
            if watched is not None:
                touched[id] = watched
                watched.resampler.take(signal, moment, value, good, entry.now)
        halves: list[Half] = []
        events: list[Event] = []
        for watched in touched.values():
            resampler, detector = watched.resampler, watched.detector
            op_known = resampler.known(OP)
            for sample in resampler.release():
                op_known = op_known or sample.op == sample.op  # OP's first value may be in this same entry
                watched.entry_ids.append(entry.id)
                watched.samples.extend(sample)
                if detector is None:
                    continue
                half = detector.update(sample.t, sample.sp, sample.pv, sample.op if op_known else None, sample.flags)
                if half is not None:
                    watched.half_periods += 1
                    compensated = int(sample.u_ff == sample.u_ff and sample.u_ff != 0.0)
                    numbers = (getattr(half, name) for name in COLUMNS)
                    halves.append((watched.id, watched.half_periods, *numbers, compensated))
            events += [Event(entry.now, watched.loop.name, kind, text) for kind, text in resampler.events]
            resampler.events.clear()
        return halves, events

    def live(self, loop: str) -> dict[str, Any]:
        """The newest values of a loop: time, value, whether good, and why not."""
        return {
            str(signal): {
                "time": value.time,
                "value": value.value if math.isfinite(value.value) else None,
                "good": value.good,
                "note": value.note,
            }
            for signal, value in self._loops[loop].latest.items()
        }

    def newer(self, loop: str, than: float) -> bool:
        """Whether the newest PV of a loop is newer than a moment [s since 1970 UTC]."""
        pv = self._loops[loop].latest.get(Signal.PV)
        return pv is not None and pv.time > than
