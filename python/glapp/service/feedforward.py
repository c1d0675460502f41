"""u_FF of every loop: computed when a PV comes, written to the plant, read back."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress

from ..errors import InputError
from .compensation import Compensator
from .journal import Journal
from .signal import Event, Plant, Signal, WriteRefused, answered_within
from .watched import WatchedLoop

__all__ = ["CONNECTION_LOST", "PLANT_ANSWERS", "FeedForward"]

CONNECTION_LOST = "the connection to the plant was lost"
"""Why a loop is not compensated any more, where nothing can be written."""

PLANT_ANSWERS = 5.0
"""Longest time in which the plant answers a call [s]."""

_CAUGHT_UP = 2.0
"""Longest time for which a plant that hurries waits after a scan [s]."""


class FeedForward:
    """Computes and writes u_FF of all loops.

    - `loops`: the loops.
    - `journal`: gets what is enabled, withdrawn and not written.
    - `clock`: the time [s since 1970 UTC].
    - `hurries`: whether that is the time of a simulated plant that hurries; u_FF is then computed by its time.

    - `source`: the plant, as soon as there is one.
    - `ticks`: the time that u_FF is computed by, which only goes forward [s].
    """

    def __init__(
        self, loops: Mapping[str, WatchedLoop], journal: Journal, clock: Callable[[], float], *, hurries: bool
    ) -> None:
        self.source: Plant | None = None
        self.ticks = clock if hurries else time.monotonic
        self._loops, self._journal, self._clock, self._hurries = loops, journal, clock, hurries
        self._computed = asyncio.Event()

    @property
    def at_work(self) -> list[WatchedLoop]:
        """The loops whose u_FF has to be written: enabled, or u_FF in the plant is not 0 yet."""
        return [w for w in self._loops.values() if w.compensator is not None and w.compensator.at_work]

    async def run(self, watched: WatchedLoop, source: Plant) -> None:
        """Compute u_FF of one loop when a PV comes, or where none comes and the connection lives; and write it."""
        compensator, name = watched.compensator, watched.loop.name
        assert compensator is not None
        heard, heard_at = None, -math.inf
        while True:
            with suppress(TimeoutError):  # not `wait_for`, which may lose that it was cancelled
                async with asyncio.timeout(1.5 * watched.period):
                    await watched.pv_came.wait()
            watched.pv_came.clear()
            compensator = watched.compensator or compensator
            if self._hurries and not self._waited_for(watched):
                continue  # of many scans it would see the last
            if (latest := source.alive(name)) != heard:
                heard, heard_at = latest, self.ticks()
            if not compensator.read_back:
                with suppress(WriteRefused):
                    compensator.take(await answered_within(PLANT_ANSWERS, source.read_back(name)), self._clock())
                    compensator.read_back = True
            was, pv = compensator.enabled, watched.latest.get(Signal.PV)
            compensator.scan(self.ticks(), self.ticks() - heard_at <= 5.0 * max(watched.period, 1.0))
            u_ff = compensator.to_write
            if was and not compensator.enabled:
                self.allow_only_zero(name)
                self._journal.add_event(Event(self._clock(), name, "withdrawn", compensator.why_off_text))
            if watched.watchdog_tested:
                continue  # u_FF in the plant is for the plant to take away
            if compensator.at_work or (compensator.written is not None and compensator.written != u_ff):
                await self._write(watched, compensator, source, u_ff)
            if pv is not None:
                watched.u_ff_time = pv.time
                self._computed.set()

    async def _write(self, watched: WatchedLoop, compensator: Compensator, source: Plant, u_ff: float) -> None:
        """Write u_FF and read it back; where the plant refuses it, the loop is not compensated any more.

        Scans may come late, and u_FF has then more to go at once than the plant takes: it goes as far as it may, and
        the rest comes with the next scans.
        """
        name, began = watched.loop.name, time.monotonic()
        within = max(3.0 * watched.period, 1.0)
        try:
            try:
                await answered_within(within, source.write(name, u_ff))
            except WriteRefused as refused:
                if refused.nearest is None:
                    raise
                u_ff = refused.nearest
                await answered_within(within, source.write(name, u_ff))
            found = await answered_within(within, source.read_back(name))
        except WriteRefused as refused:
            gone = refused.reason == "not_connected"
            self.switch_off(watched, CONNECTION_LOST if gone else f"u_FF was not written: {refused}")
            if refused.reason == "other_writer":
                compensator.written = None  # nothing of ours is in the plant any more, and nothing would be written
            if not compensator.enabled:
                self._journal.add_event(Event(self._clock(), name, "not_written", f"u_FF {u_ff + 0.0:g}: {refused}"))
        else:
            compensator.wrote(u_ff, self.ticks(), time.monotonic() - began)
            compensator.take(found, self._clock())

    def _waited_for(self, watched: WatchedLoop) -> bool:
        """Whether a plant that hurries waits for this loop's u_FF: there is a width, or something to take away."""
        compensator = watched.compensator
        return compensator is not None and not watched.watchdog_tested and (compensator.at_work or compensator.sized)

    async def caught_up(self, moment: float) -> None:
        """Wait until u_FF of every loop with a width was computed from a PV of this moment or later, and written.

        For a simulated plant that hurries. It waits two seconds at most, so that it goes on where no PV comes.

        - `moment`: by the plant's time [s since 1970 UTC].
        """
        with suppress(TimeoutError):
            async with asyncio.timeout(_CAUGHT_UP):
                while any(w.u_ff_time < moment for w in self._loops.values() if self._waited_for(w)):
                    self._computed.clear()
                    await self._computed.wait()

    async def enable(self, watched: WatchedLoop, compensator: Compensator, source: Plant) -> None:
        """Let a loop be compensated from the next PV on.

        Raises InputError where u_FF cannot be read back, there is no width, or u_FF comes too late. Raises WriteRefused
        where the plant takes no u_FF, or its watchdog cannot be counted up.
        """
        name = watched.loop.name
        await answered_within(PLANT_ANSWERS, source.heartbeat())
        source.enable(name)
        # The value in the plant is written once more: that takes as long as any other u_FF.
        began = time.monotonic()
        found = await answered_within(PLANT_ANSWERS, source.read_back(name))
        if not found.good:
            raise InputError(f"u_FF cannot be read back: {found.note}", loop=name)
        await answered_within(PLANT_ANSWERS, source.write(name, found.value))
        compensator.wrote(found.value, self.ticks(), time.monotonic() - began)
        compensator.enable()

    def switch_off(self, watched: WatchedLoop, why: str) -> None:
        """Let u_FF of a loop that is compensated go to 0, and report why."""
        compensator = watched.compensator
        if compensator is not None and compensator.enabled:
            compensator.disable(why)
            self.allow_only_zero(watched.loop.name)
            watched.pv_came.set()
            self._journal.add_event(Event(self._clock(), watched.loop.name, "withdrawn", why))

    def switch_all_off(self, why: str) -> None:
        """Switch off all loops, as `switch_off` does one."""
        for watched in self._loops.values():
            self.switch_off(watched, why)

    def connection_lost(self, watched: WatchedLoop, why: str) -> None:
        """End the compensation of a loop whose connection was lost; the value found in the plant later goes to 0."""
        if watched.compensator is not None:
            self.switch_off(watched, why)
            watched.compensator.lost(why)

    def allow_only_zero(self, name: str) -> None:
        """Let u_FF of a loop only go to 0 in the plant from now on."""
        if self.source is not None:
            with suppress(WriteRefused):
                self.source.disable(name)

    async def stopped(self, goes_on: Callable[[], bool]) -> None:
        """End all compensations, and wait until u_FF is 0 in the plant, for as long as that may take.

        - `goes_on`: whether all that writes u_FF still runs: where it does not, there is nothing to wait for.
        """
        self.switch_all_off("the service was stopped")
        working = [w.compensator for w in self.at_work if w.compensator is not None]
        longest = max((compensator.away_within for compensator in working), default=0.0)
        until = time.monotonic() + min(longest + 3.0, 60.0)
        while any(compensator.at_work for compensator in working) and time.monotonic() < until and goes_on():
            await asyncio.sleep(0.1)
