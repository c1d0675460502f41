"""The monitor: from the loops of a plant through the detectors into the store; fits at night; compensation.

Each part does one thing: `Ingest` makes half-periods of values, `Journal` writes what came and what happened,
`FeedForward` writes u_FF, `Watchdog` sends the heartbeat, `FitQueue` fits, `Commands` is what persons ask for.

Once a second all that came is an entry: it goes through the detectors and is written with what it led to. u_FF does not
wait for that: it is computed when a PV comes, and written.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from ..errors import InputError
from ..estimate import Estimator
from ..loop import Loop
from .commands import Commands
from .feedforward import CONNECTION_LOST, FeedForward
from .fit_queue import FitQueue
from .ingest import Ingest
from .journal import Journal, to_the_end
from .options import MonitorOptions
from .resampler import Resampler
from .settable import DETECTOR, SETTINGS
from .signal import Event, Plant, Signal
from .store import Reader, Store, StoreFull
from .watchdog import Watchdog
from .watched import NEEDED, WatchedLoop, loop_with

__all__ = ["Monitor"]

_SHOWN = 5.0
"""Time between two writes of the status, for its readers [s]."""

_PATIENCE = 60.0
"""Time that the store may fail before all compensation ends [s]."""

KILLED = "the service was killed meanwhile: it was for the plant's watchdog to take u_FF away"
"""Why a loop is not compensated any more, where nobody could write that down."""


class Monitor:
    """The monitor over the loops of a plant.

    - `loops`: what is known of them.
    - `store`: where all is kept.
    - `options`: times and sizes.
    - `compensable`: names of the loops whose u_FF has a node in the plant, with the greatest |u_FF| and rate that are
      written there [OP unit, OP unit per s].
    - `clock`: the time [s since 1970 UTC].
    - `hurries`: whether that is the time of a simulated plant that hurries; u_FF is then computed by its time, too.
      Such a plant has to wait for `FeedForward.caught_up` after every scan.
    - `say`: gets every event as it is written.

    - `unconnected`: why there is no connection to the plant; None where there is, and before the first attempt.
    - `loops`: the loops by name.
    - `ingest`, `journal`, `feedforward`, `watchdog`, `fits`, `commands`: the parts.

    Raises InputError where a loop's settings are out of their bounds.
    """

    def __init__(
        self,
        loops: Sequence[Loop],
        store: Store,
        *,
        options: MonitorOptions | None = None,
        compensable: Mapping[str, tuple[float, float]] | None = None,
        clock: Callable[[], float] = time.time,
        hurries: bool = False,
        say: Callable[[Event], None] | None = None,
    ) -> None:
        self.unconnected: str | None = None
        self.store, self.options, self.reader = store, options or MonitorOptions(), Reader(store.folder)
        self.begun = clock()
        self._clock, self._hurries = clock, hurries
        self._started = self.begun, time.time()
        self._stepping = asyncio.Lock()
        self.loops: dict[str, WatchedLoop] = {}
        self.journal = Journal(store, self.loops, self.options, clock, say)
        ids, states = store.know(loops), store.states()
        for loop in loops:
            state = states.get(ids[loop.name])
            self.loops[loop.name] = self._restored(loop, ids[loop.name], state, (compensable or {}).get(loop.name))
        if store.found is not None:
            self.journal.add_event(Event(self.begun, None, "database_damaged", store.found))
        self.ingest = Ingest(self.loops, clock)
        self.feedforward = FeedForward(self.loops, self.journal, clock, hurries=hurries)
        self.watchdog = Watchdog(self.loops, self.feedforward, self.journal, self.options, clock, hurries=hurries)
        self.fits = FitQueue(
            self.loops, self.journal, self.reader, self.options, clock, save=self.save, show=self._show
        )
        self.commands = Commands(
            {loop.name: loop for loop in loops},
            self.loops,
            self.journal,
            self.reader,
            self.feedforward,
            self.watchdog,
            self.fits,
            clock,
            save=self.save,
        )
        self._replay()
        self._tell_ended()
        for watched in self.loops.values():
            watched.restore_latest(self.begun)
        self.ingest.begin_with_gaps()

    def _restored(
        self, given: Loop, id: int, state: str | None, plant_limits: tuple[float, float] | None
    ) -> WatchedLoop:
        """A loop with the settings that persons have set and the state that was saved."""
        settings = self._usable_settings(given, plant_limits)
        period = given.sample_time or self.options.period
        loop, compensator = loop_with(given, settings, period, plant_limits)
        waits = {"wait": self.options.wait, "ahead": self.options.ahead, "lost": self.options.lost}
        detector = None if loop.controller is None else Estimator(loop, period)
        watched = WatchedLoop(loop, id, period, Resampler(period, **waits), detector, plant_limits)
        watched.compensator = compensator
        if state is not None:
            saved = json.loads(state)
            watched.resampler = Resampler.load(saved["rows"], period, **waits)
            watched.half_periods = saved["number"]
            kept = saved["detector"]
            if kept is not None and detector is not None:
                if json.loads(kept)["settings"] == json.loads(detector.save())["settings"]:
                    watched.detector = Estimator.load(kept)
                else:
                    text = "its settings are not those of the saved detector, which starts again"
                    self.journal.add_event(Event(self.begun, given.name, "detector_anew", text))
        last = self.reader.answers(given.name, 1)
        watched.answer = last[0] if last else None
        return watched

    def _usable_settings(self, given: Loop, plant_limits: tuple[float, float] | None) -> dict[str, Any]:
        """Settings by persons, without those that are out of their bounds by now; these are reported and not set again.

        Such a value was saved by a version with other bounds, or under other settings in the loops.toml.
        """
        settings = self.reader.settings(given.name)
        gone, errors = dict[str, Any](), list[str]()
        while True:
            try:
                loop_with(given, settings, given.sample_time or self.options.period, plant_limits)
                break
            except InputError as error:
                names = [name for name in (*DETECTOR, *SETTINGS) if settings.get(name) is not None]
                if not names:
                    raise
                errors.append(str(error))
                for name in [error.parameter] if error.parameter in names else names:
                    gone[name] = settings.pop(name)
        if gone:
            text = f"what was saved is not used, and {', '.join(gone)} as by default: {'. '.join(errors)}"
            self.journal.add_event(Event(self.begun, given.name, "setting_refused", text))
            none = dict.fromkeys(gone)
            with suppress(StoreFull):
                self.store.command(self.begun, "glapp", "", "change", given.name, gone, none, settings=none)
        return settings

    def _replay(self) -> None:
        """Process the entries since the states were saved again; their half-periods are in the database already."""
        count = 0
        for entry in self.store.entries():
            self.ingest.process(entry)
            self.journal.position = entry.id
            count += 1
        if count:
            text = f"{count} entries since the last save were taken in again"
            self.journal.add_event(Event(self.begun, None, "replayed", text))

    def _tell_ended(self) -> None:
        """Report each loop that was compensated when the service before was killed: nobody wrote that it ended."""
        for name in self.reader.left_enabled():
            watched = self.loops.get(name)
            if watched is not None and watched.compensator is not None:
                watched.compensator.why_off = KILLED
                self.journal.add_event(Event(self.begun, name, "withdrawn", KILLED))

    def tell(self, event: Event) -> None:
        """Take an event of the source: where the connection is lost, nothing is compensated any more."""
        self.journal.add_event(event)
        if event.kind == "tag_missing" and event.loop in self.loops and event.signal is not None:
            self.loops[event.loop].missing[event.signal] = event.text
        if event.kind in ("connected", "lost") and event.loop is None:
            self.unconnected = event.text if event.kind == "lost" else None
        if event.kind not in ("connected", "lost", "clock_back"):
            return
        for watched in self.loops.values():
            if event.loop not in (None, watched.loop.name):
                continue
            if event.kind == "connected":
                self.ingest.connected(watched)
                continue
            if event.kind == "lost":
                self.ingest.lost(watched)
            why = CONNECTION_LOST if event.kind == "lost" else event.text
            self.feedforward.connection_lost(watched, why)

    @property
    def now(self) -> float:
        """The service's clock [s since 1970 UTC]."""
        return self._clock()

    # Running

    async def step(self) -> None:
        """Take in the new values, and write them."""
        await to_the_end(self._step())

    async def _step(self) -> None:
        """One step: values to detectors, feed-forward, journal."""
        async with self._stepping:
            now = self._clock()
            entry = self.ingest.entry(now, self.journal.next_position)
            if entry is not None:
                halves, events = self.ingest.process(entry)
                self.journal.add(entry, halves)
                for event in events:
                    self.tell(event)
            await self.journal.write(now)
            if self.journal.failing_for(now) > _PATIENCE:
                self.feedforward.switch_all_off("what happens cannot be stored: the store cannot be written")

    async def save(self) -> None:
        """Take in the new values, and write them, the signals and the states, now.

        Raises StoreFull, OSError where it cannot be written; all of it waits for the next time.
        """
        await self.step()
        async with self._stepping:  # the entry of the next step is no reason to fail
            await self.journal.save()

    async def run(self, source: Plant) -> None:
        """Watch a plant until cancelled; then everything is saved, and nothing is compensated any more."""
        self.ingest.source = self.feedforward.source = source
        work = {
            "source": self.ingest.run(source, self.tell),
            "steps": self._steps(),
            "tidy": self.journal.tidy(),
            "fits": self.fits.run(),
            "heartbeat": self.watchdog.run(source),
        }
        for name, watched in self.loops.items():
            if watched.compensator is not None:
                work[f"u_FF of {name}"] = self.feedforward.run(watched, source)
        tasks = [asyncio.create_task(one, name=name) for name, one in work.items()]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                if (error := task.exception()) is not None:
                    raise error
        finally:
            await self._end(tasks)

    async def _end(self, tasks: Sequence[asyncio.Task[None]]) -> None:
        """Take u_FF to 0, as far as the plant takes it, and store everything."""
        with suppress(asyncio.CancelledError):
            await self.feedforward.stopped(lambda: not any(task.done() for task in tasks))
        if self.watchdog.test_task is not None:
            tasks = [*tasks, self.watchdog.test_task]
        left = {task for task in tasks if not task.done()}
        while left:  # once more where a task has not heard it: one that waited for something may have got just that
            for task in left:
                task.cancel()
            _, left = await asyncio.wait(left, timeout=1.0)
        with suppress(StoreFull, OSError):
            await self.save()

    async def _steps(self) -> None:
        """Step, save and show in turns, until cancelled."""
        saved = shown = time.monotonic()
        while True:
            began = time.monotonic()
            await self.step()
            if began - saved >= self.options.save:
                saved = began
                await self.journal.try_save()
            if began - shown >= _SHOWN or shown == saved:
                shown = began
                await self._show()
            await asyncio.sleep(max(0.0, self.options.step - (time.monotonic() - began)))

    # Status for display

    async def _show(self) -> None:
        """Write the status for the readers."""
        with suppress(StoreFull):
            await asyncio.to_thread(self.store.show, self._clock(), json.dumps(self.status()))

    def status(self) -> dict[str, Any]:
        """State of the service and of every loop."""
        damaged = self.reader.damaged
        return {
            "now": self._clock(),
            "begun": self.begun,
            "failing": self.journal.failing,
            "damaged": damaged,
            "unconnected": self.unconnected,
            "waiting": self.journal.waiting,
            "wall": time.time(),
            "behind": self._behind(),
            "fits_at": self.fits.next_night(),
            "loops": {
                name: self._loop_status(one, answers_lost=damaged is not None) for name, one in self.loops.items()
            },
        }

    def _behind(self) -> dict[str, float | None] | None:
        """Lag of a simulated fast plant behind the clock [s], and the time it needs to catch up [s].

        None where it has caught up, or does not hurry.
        """
        began, wall = self._started
        clock, now = self._clock(), time.time()
        if not self._hurries or now - clock < 60.0:
            return None
        gained = (clock - began) - (now - wall)
        left = (now - clock) * (now - wall) / gained if gained > 0.0 else None
        return {"seconds": now - clock, "left": left}

    def _loop_status(self, watched: WatchedLoop, *, answers_lost: bool) -> dict[str, Any]:
        """Status of a loop, for display."""
        detector, name = watched.detector, watched.loop.name
        estimate = None if detector is None else detector.estimate
        pv, fit = watched.latest.get(Signal.PV), self.fits.status(name)
        shown: dict[str, Any] = {
            "seen": None if pv is None else pv.time,
            "heard": self.ingest.alive(name),
            "age": watched.pv_age,
            "good": None if pv is None else pv.good,
            "note": "" if pv is None else pv.note,
            "lost": watched.lost,
            "missing": next((watched.missing[key] for key in NEEDED if key in watched.missing), None),
            "estimate": None if estimate is None else estimate[0],
            "detections": 0 if detector is None or detector.median_mean is None else detector.median_mean[4],
            "half_periods": watched.half_periods,
            "accepted": 0 if detector is None else detector.reasons["accepted"],
            "dropped": watched.resampler.dropped,
            "unit": watched.loop.op_label,
            "why": "K and Ti are not known" if detector is None else "",
            "fitting": fit is not None,
            "fit": fit,
            "answer": watched.answer,
            "health": watched.health(answers_lost=answers_lost).name,
        }
        if watched.compensator is not None:
            shown["compensation"] = watched.compensator.status()
        return shown
