"""The plant's watchdog, by which it takes u_FF away when the service is gone: counted up, and tested."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping

from ..errors import InputError
from .feedforward import PLANT_ANSWERS, FeedForward
from .journal import Journal
from .options import MonitorOptions
from .signal import Event, Plant, WriteRefused, answered_within
from .store import StoreFull
from .watched import WatchedLoop

__all__ = ["WATCHDOG_SEEN", "Watchdog"]

WATCHDOG_SEEN = "watchdog_seen"
"""The setting of a loop that says when its watchdog test was passed."""

_HEARTBEAT = 1.0
"""Time between two heartbeats [s]."""


class Watchdog:
    """Counts the plant's watchdog up while every u_FF is fresh, and tests that the plant looks at it.

    - `loops`: the loops.
    - `feedforward`: writes u_FF, and switches it off.
    - `journal`: gets how a test ended, and what is not 0 in the plant.
    - `options`: how long a test waits for the plant.
    - `clock`: the time [s since 1970 UTC].
    - `hurries`: whether that is the time of a simulated plant that hurries.
    """

    def __init__(
        self,
        loops: Mapping[str, WatchedLoop],
        feedforward: FeedForward,
        journal: Journal,
        options: MonitorOptions,
        clock: Callable[[], float],
        *,
        hurries: bool,
    ) -> None:
        self._loops, self._feedforward, self._journal = loops, feedforward, journal
        self._options, self._clock, self._hurries = options, clock, hurries
        self.test_task: asyncio.Task[None] | None = None

    async def run(self, source: Plant) -> None:
        """Send heartbeats while u_FF of every loop that is compensated is fresh, and none is stuck in the plant.

        Without heartbeats the plant takes u_FF of every loop away.
        """
        while True:
            now = self._feedforward.ticks()
            self.look_for_stuck(now)
            working = self._feedforward.at_work
            fresh = all(w.compensator is not None and now - w.compensator.written_at <= 3.0 * w.period for w in working)
            if fresh and not self.stuck:
                try:
                    await answered_within(1.0, source.heartbeat())
                except WriteRefused as refused:
                    # Without a watchdog nothing can be enabled, and without a connection nothing is.
                    if refused.reason not in ("not_named", "not_connected"):
                        text = f"the watchdog was not counted up: {refused}"
                        self._journal.add_event(Event(self._clock(), None, "no_beat", text))
            await asyncio.sleep(_HEARTBEAT)

    def look_for_stuck(self, now: float) -> None:
        """Find each u_FF that is not 0 in the plant though it had to be by now; then no loop is compensated.

        - `now`: by the clock of `FeedForward.ticks` [s].
        """
        for name, watched in self._loops.items():
            compensator = watched.compensator
            if compensator is None or watched.watchdog_tested:
                continue
            value = compensator.stuck_u_ff(now)
            if value is None and watched.u_ff_stuck:
                text = "u_FF is 0, and the watchdog is counted up again"
                self._journal.add_event(Event(self._clock(), name, "taken_away", text))
            elif value is not None and not watched.u_ff_stuck:
                text = (
                    f"u_FF is {value:g} in the plant, and had to be 0 within {compensator.away_within:.0f} s: the "
                    "watchdog is not counted up any more, so that the plant takes u_FF away, of every loop"
                )
                self._journal.add_event(Event(self._clock(), name, "not_taken_away", text))
                self._feedforward.switch_all_off(f"the watchdog is not counted up: u_FF of {name} is not 0")
            watched.u_ff_stuck = value is not None

    @property
    def stuck(self) -> list[str]:
        """Names of the loops whose u_FF is not 0 in the plant though it had to be by now."""
        return [name for name, watched in self._loops.items() if watched.u_ff_stuck]

    def require_none_stuck(self, loop: str) -> None:
        """Refuse to go on with a loop while any u_FF is stuck in the plant.

        Raises InputError with the names of the loops, and what to do.
        """
        if names := self.stuck:
            raise InputError(
                f"u_FF of {', '.join(names)} is not 0 in the plant, and the watchdog is not counted up",
                loop=loop,
                hint="set it to 0 in the control system, and look who else writes it",
            )

    # The test

    @property
    def tests(self) -> bool:
        """Whether a watchdog test is under way."""
        return self.test_task is not None and not self.test_task.done()

    def begin_test(self, watched: WatchedLoop, source: Plant, person: str, role: str) -> None:
        """Begin the test of a loop for which the plant takes u_FF by now; events and the log report how it ends."""
        watched.watchdog_tested = True
        self.test_task = asyncio.create_task(self._test(watched, source, person, role), name="watchdog test")

    async def _test(self, watched: WatchedLoop, source: Plant, person: str, role: str) -> None:
        """Test the plant's watchdog: stop the heartbeat, and watch u_FF."""
        loop, limits = watched.loop.name, watched.plant_limits
        assert limits is not None
        size = min(0.1 * limits[0], 0.25 * limits[1] * watched.period)
        try:
            # The plant counts the rate from when it was enabled, by its own clock.
            await asyncio.sleep(1.0 if self._hurries else max(2.0 * watched.period, 1.0))
            began = time.monotonic()
            await answered_within(PLANT_ANSWERS, source.write(loop, size))
            while (
                found := await answered_within(PLANT_ANSWERS, source.read_back(loop))
            ).value != 0.0 or not found.good:
                if found.good and not 0.0 <= found.value <= size * (1.0 + 1e-6):  # the node may hold a Float
                    text = f"u_FF is {found.value:g} where {size:g} was written: somebody else writes it"
                    raise WriteRefused("other_writer", text)
                if time.monotonic() - began > self._options.watchdog_test:
                    source.disable(loop)
                    await answered_within(PLANT_ANSWERS, source.write(loop, 0.0))
                    longest = self._options.watchdog_test
                    text = f"the plant left u_FF at {size:g} for {longest:g} s: its watchdog is not wired"
                    self._journal.add_event(Event(self._clock(), loop, "drill_failed", text))
                    return
                await asyncio.sleep(0.25)
            took = time.monotonic() - began
            seen = {"time": self._clock(), "person": person, "took": took}
            await self._journal.log(person, role, "drilled", loop, None, seen, settings={WATCHDOG_SEEN: seen})
            text = f"the plant took u_FF of {size:g} away by itself in {took:.0f} s"
            self._journal.add_event(Event(self._clock(), loop, "drilled", text))
        except (WriteRefused, StoreFull) as error:
            self._journal.add_event(Event(self._clock(), loop, "drill_failed", str(error)))
        finally:
            self._feedforward.allow_only_zero(loop)
            watched.watchdog_tested = False
