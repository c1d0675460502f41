"""The monitor: values from a source through the detectors into the store, the fits at night, and the compensations.

One step a second: what came since the last one is an entry, goes through the rows and the detectors of its loops, and
is put down with what it led to. u_FF does not wait for that: it is made when a PV comes, and written.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from array import array
from collections.abc import Callable, Collection, Coroutine, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from enum import IntEnum
from multiprocessing import get_context
from typing import Any, Protocol, TypeVar

import numpy as np
import pyarrow as pa

from ..errors import InputError
from ..estimate import Estimator
from ..loop import Loop
from .compensation import Compensator
from .fits import answer
from .recordings import SignalStore, table_of
from .rows import ALIVE, CODES, LOST, OP, PV, Resampler
from .settable import DETECTOR, SETTINGS, Bound, bounds_of, check
from .signal import Event, Signal, Source, Value, WriteRefused
from .store import COLUMNS, Entry, Half, Reader, Store, StoreFull

__all__ = ["Bounds", "Health", "Monitor", "Plant"]

T = TypeVar("T")

SEEN = "watchdog_seen"
"""The setting that holds when a watchdog test of the loop was passed."""

_FIELDS = 7
_SPAWN = get_context("spawn")
_HEARTBEAT = 1.0
"""Time between two counts of the plant's watchdog [s]."""

_FOLLOWED = 2.0
"""So long a plant that hurries waits for one scan at most [s]."""

_KEEP = 60
"""A thing that happens again and again is told once in so many seconds, with how often it did."""


class Health(IntEnum):
    """Health of a loop's valve by NAMUR NE 107, in the names and numbers of OPC UA's DeviceHealthEnumeration.

    Attributes
    ----------
    NORMAL
        No dead band was found, or all of it is acceptable; also where no fit could tell.
    FAILURE
        u_FF stands in the plant though it had to be 0 by now, and nobody here can take it away. A valve's gap, which is
        what is watched here, does not end its function.
    CHECK_FUNCTION
        The loop cannot be watched now: it was not heard of yet, its connection is lost, or PV is bad. Also where its
        answers were set aside with a damaged database and no fit has answered since.
    OFF_SPEC
        Never said.
    MAINTENANCE_REQUIRED
        The last fit found backlash or stiction, more than what is acceptable where that is known.
    """

    NORMAL = 0
    FAILURE = 1
    CHECK_FUNCTION = 2
    OFF_SPEC = 3
    MAINTENANCE_REQUIRED = 4


class Plant(Source, Protocol):
    """A source that writes u_FF of a loop only while that is enabled; else it may only go to 0."""

    def enable(self, loop: str) -> None:
        """Let u_FF of a loop be written.

        Raises
        ------
        WriteRefused
            Where there is no node or no connection.
        """

    def disable(self, loop: str) -> None:
        """Let u_FF of a loop only go to 0 from now on."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Times and sizes that the monitor goes by.

    Attributes
    ----------
    period : float
        Usual time between values of a PV, > 0 [s], where the loop's `sample_time` does not say another.
    wait : float
        How long a sample waits for values that come late, ≥ 0 [s].
    ahead : float
        How far ahead of our clock a source time may be [s].
    lost : float
        The longest time between two signs of life of a loop [s].
    step : float
        Time between two entries, > 0 [s].
    save : float
        Time between two saves of all states, > 0 [s].
    keep : int
        Days for which signals and rejected half-periods are kept, ≥ 1.
    fit_days : int
        Days that a fit looks back, ≥ 1.
    fit_hour : int
        Local hour at which the fits of the night begin, 0..23.
    fit_longest : float
        How long a fit may take, > 0 [s]; then it is ended.
    backlog : int
        So many entries wait in memory for a disk that is full; then they are given up.
    watchdog_test : float
        How long a watchdog test waits for the plant to take u_FF away, > 0 [s].
    """

    period: float = 1.0
    wait: float = 2.0
    ahead: float = 60.0
    lost: float = 15.0
    step: float = 1.0
    save: float = 300.0
    keep: int = 30
    fit_days: int = 7
    fit_hour: int = 2
    fit_longest: float = 600.0
    backlog: int = 600
    watchdog_test: float = 300.0

    def __post_init__(self) -> None:
        for name in ("period", "step", "save", "lost", "ahead", "fit_longest", "watchdog_test"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"is {value}, must be > 0 s", parameter=name, value=value, bound="> 0 s")
        if not (math.isfinite(self.wait) and self.wait >= 0):
            raise InputError(f"is {self.wait}, must be >= 0 s", parameter="wait", value=self.wait, bound=">= 0 s")
        for name in ("keep", "fit_days", "backlog"):
            value = getattr(self, name)
            if value < 1:
                raise InputError(f"is {value}, must be 1 or more", parameter=name, value=value, bound=">= 1")
        if not 0 <= self.fit_hour <= 23:
            hour = self.fit_hour
            raise InputError(f"is {hour}, must be 0 to 23", parameter="fit_hour", value=hour, bound="0..23")


@dataclass(slots=True)
class _Watched:
    """One loop under watch."""

    loop: Loop
    id: int
    period: float
    rows: Resampler
    detector: Estimator | None
    most: tuple[float, float] | None = None
    number: int = 0
    made_by: array[int] = field(default_factory=lambda: array("q"))
    samples: array[float] = field(default_factory=lambda: array("d"))
    latest: dict[Signal, Value] = field(default_factory=dict)
    lost: bool = True  # until it is heard of
    marked: float = -math.inf
    compensator: Compensator | None = None
    due: asyncio.Event = field(default_factory=asyncio.Event)
    made: float = -math.inf  # source time of the PV that u_FF was last made of
    stands: bool = False  # u_FF does, though it had to be 0 by now
    answer: dict[str, Any] | None = None


class Monitor:
    """The monitor over the loops of a plant.

    Parameters
    ----------
    loops : sequence of Loop
        What is known of them.
    store : Store
        Where everything is put down.
    bounds : Bounds
        Times and sizes.
    compensable : mapping of str to (float, float)
        Names of the loops whose u_FF has a node in the plant, with the greatest |u_FF| and rate that are written there
        [OP unit, OP unit per s].
    clock : callable
        The time [s since 1970 UTC].
    hurries : bool
        Whether that is the time of a simulated plant that hurries, so that u_FF is made by it, too, and not by our own.
        Such a plant has to wait for `caught_up` after every scan.

    Raises
    ------
    InputError
        Where a loop's settings are out of their bounds.
    """

    def __init__(
        self,
        loops: Sequence[Loop],
        store: Store,
        *,
        bounds: Bounds | None = None,
        compensable: Mapping[str, tuple[float, float]] | None = None,
        clock: Callable[[], float] = time.time,
        hurries: bool = False,
    ) -> None:
        self.store, self.bounds = store, bounds or Bounds()
        self.source: Plant | None = None
        self.reader = Reader(store.folder)
        self.signals = SignalStore(store.folder)
        self.begun = clock()
        self.failing: str | None = None
        self._clock, self._hurries = clock, hurries
        self._ticks = clock if hurries else time.monotonic  # the time by which u_FF is made [s]
        self._made = asyncio.Event()
        self._values: list[Value] = []
        self._events: list[Event] = []
        self._repeated: dict[tuple[str | None, str], tuple[float, int]] = {}
        self._backlog: list[tuple[Entry, list[Half]]] = []
        self._gave_up = False
        self._failing_since: float | None = None
        self._lost: set[int] = set()
        self._stepping = asyncio.Lock()
        self._saving = asyncio.Lock()
        self._save_now = asyncio.Event()
        self._asked: asyncio.Queue[tuple[str, str]] = asyncio.Queue()
        self._fitting: set[str] = set()
        self._fit_of: tuple[str, float] | None = None  # the loop that is fitted now, and since when on the wall
        self._took: dict[str, float] = {}  # how long the last fit of a loop took [s]
        self._started = self.begun, time.time()
        self._watchdog_test_task: asyncio.Task[None] | None = None
        self._given = {loop.name: loop for loop in loops}
        ids = store.know(loops)
        states = store.states()
        self._loops = {
            loop.name: self._watched(
                loop, ids[loop.name], states.get(ids[loop.name]), (compensable or {}).get(loop.name)
            )
            for loop in loops
        }
        self._by_id = {watched.id: watched for watched in self._loops.values()}
        self._position = store.position()
        if store.found is not None:
            self._tell(Event(self.begun, None, "database_damaged", store.found))
        self._replay()
        for watched in self._loops.values():
            self._hold(watched)
        # Nobody listened since: where no history fills that, it is a gap, and no PV that stood still.
        self._lost = {watched.id for watched in self._loops.values() if watched.rows.known(PV)}

    # Beginning

    def _watched(self, given: Loop, id: int, state: str | None, most: tuple[float, float] | None) -> _Watched:
        settings = self._sound(given, self.reader.settings(given.name), most)
        loop = with_settings(given, settings)
        period = loop.sample_time or self.bounds.period
        detector = None if loop.controller is None else Estimator(loop, period)
        watched = _Watched(loop, id, period, Resampler(period, **self._of_rows()), detector, most)
        if state is not None:
            saved = json.loads(state)
            watched.rows = Resampler.load(saved["rows"], period, **self._of_rows())
            watched.number = saved["number"]
            kept = saved["detector"]
            if kept is not None and detector is not None:
                if _settings_of(kept) == _settings_of(detector.save()):
                    watched.detector = Estimator.load(kept)
                else:
                    text = "its settings are not those of the saved detector, which begins anew"
                    self._tell(Event(self.begun, given.name, "detector_anew", text))
        if most is not None and loop.controller is not None:
            watched.compensator = Compensator(loop, period, _of_compensation(settings), *most)
        last = self.reader.answers(given.name, 1)
        watched.answer = last[0] if last else None
        return watched

    def _sound(self, given: Loop, saved: dict[str, Any], most: tuple[float, float] | None) -> dict[str, Any]:
        """What persons have set, less what is out of its bounds by now: that is told, put down, and not set any more.

        Such a value was saved by a version with other bounds, or beside other settings in the loops.toml.
        """
        found, gone, said = dict(saved), dict[str, Any](), list[str]()
        while True:
            try:
                _checked(given, found, given.sample_time or self.bounds.period, most)
                break
            except InputError as error:
                names = [name for name in (*DETECTOR, *SETTINGS) if found.get(name) is not None]
                if not names:
                    raise
                said.append(str(error))
                for name in [error.parameter] if error.parameter in names else names:
                    gone[name] = found.pop(name)
        if gone:
            text = f"what was saved is not used, and {', '.join(gone)} as by default: {'. '.join(said)}"
            self._tell(Event(self.begun, given.name, "setting_refused", text))
            none = dict.fromkeys(gone)
            with suppress(StoreFull):
                self.store.command(self.begun, "glapp", "", "change", given.name, gone, none, settings=none)
        return found

    def _of_rows(self) -> dict[str, float]:
        return {"wait": self.bounds.wait, "ahead": self.bounds.ahead, "lost": self.bounds.lost}

    def _replay(self) -> None:
        """What came in since the states were saved, once more: its half-periods are in the database already."""
        count = 0
        for entry in self.store.entries():
            self._work(entry, tell=False)
            self._position = entry.id
            count += 1
        if count:
            text = f"{count} entries since the last save were taken in again"
            self._tell(Event(self.begun, None, "replayed", text))

    def _hold(self, watched: _Watched) -> None:
        """Take the last value of each signal as the present one: a server does not tell again what has not changed."""
        for signal, code in CODES.items():
            held = watched.rows.held(code)
            if held is None:
                continue
            value = Value(watched.loop.name, signal, *held, "")
            watched.latest[signal] = value
            if watched.compensator is not None and signal not in (Signal.PV, Signal.U_FF):
                watched.compensator.take(value, self.begun)

    # Names and values

    @property
    def now(self) -> float:
        """The service's clock [s since 1970 UTC]."""
        return self._clock()

    @property
    def names(self) -> list[str]:
        """Names of the loops."""
        return list(self._loops)

    def since(self) -> dict[tuple[str, Signal], float]:
        """Source time of the last value of each signal that was taken in: a source that has history begins there."""
        found = {}
        for name, watched in self._loops.items():
            for signal, code in CODES.items():
                if (last := watched.rows.last(code)) > -math.inf:
                    found[name, signal] = last
        return found

    def take(self, values: Sequence[Value]) -> None:
        """Take what came, in the order in which it came."""
        now = self._clock()
        for value in values:
            watched = self._loops.get(value.loop)
            if watched is None:
                continue
            self._values.append(value)
            held = watched.latest.get(value.signal)
            if held is None or value.time >= held.time:
                watched.latest[value.signal] = value
            if value.signal is Signal.PV:
                watched.lost = False
            if watched.compensator is not None:
                watched.compensator.take(value, now)
                if watched.compensator.fresh_pv:
                    watched.due.set()

    def tell(self, event: Event) -> None:
        """Take an event of the source: where the connection is lost, so is every compensation."""
        self._tell(event)
        if event.kind not in ("connected", "lost", "clock_back"):
            return
        for watched in self._loops.values():
            if event.loop not in (None, watched.loop.name):
                continue
            if event.kind == "connected":  # what has not changed meanwhile is not told again
                watched.lost = Signal.PV not in watched.latest
                continue
            if event.kind == "lost":
                watched.lost = True
                self._lost.add(watched.id)
            if watched.compensator is not None:
                self._switch_off(watched, f"the connection was lost: {event.text}")
                watched.compensator.lost(f"the connection was lost: {event.text}")

    def _tell(self, event: Event) -> None:
        key = (event.loop, event.kind)
        first, count = self._repeated.get(key, (-math.inf, 0))
        if event.time - first < _KEEP and count:
            self._repeated[key] = (first, count + 1)
            return
        more = f" (and {count - 1} times more since)" if count > 1 else ""
        self._repeated[key] = (event.time, 1)
        self._events.append(Event(event.time, event.loop, event.kind, event.text + more))

    # A step

    def _entry(self, now: float) -> Entry | None:
        """What came since the last one, and of whom nothing came that lives all the same."""
        values, self._values = self._values, []
        loops = [self._loops[value.loop].id for value in values]
        kinds = [CODES[value.signal] for value in values]
        goods = [value.good for value in values]
        times = [value.time for value in values]
        numbers = [value.value for value in values]
        for id in sorted(self._lost):  # before what came since: that is of the new connection
            loops.insert(0, id)
            kinds.insert(0, LOST)
            goods.insert(0, True)
            times.insert(0, now)
            numbers.insert(0, 0.0)
        self._lost.clear()
        for watched in self._loops.values():
            lives = None if self.source is None else self.source.alive(watched.loop.name)
            pv = watched.latest.get(Signal.PV)
            if lives is not None and pv is not None and lives - max(pv.time, watched.marked) >= watched.period:
                watched.marked = lives
                loops.append(watched.id)
                kinds.append(ALIVE)
                goods.append(True)
                times.append(lives)
                numbers.append(0.0)
        if not loops:
            return None
        self._position = max(self._position + 1, int(now * 1000.0))
        return Entry(
            self._position,
            now,
            np.array(loops, np.uint32),
            np.array(kinds, np.uint8),
            np.array(goods, np.bool_),
            np.array(times, np.float64),
            np.array(numbers, np.float64),
        )

    def _work(self, entry: Entry, *, tell: bool = True) -> list[Half]:
        """An entry through rows and detectors; the same entries give the same, whenever they come."""
        touched: dict[int, _Watched] = {}
        columns = (entry.loop, entry.signal, entry.time, entry.value, entry.good)
        for id, signal, moment, value, good in zip(*(column.tolist() for column in columns), strict=True):
            watched = self._by_id.get(id)
            if watched is not None:
                touched[id] = watched
                watched.rows.take(signal, moment, value, good, entry.now)
        halves: list[Half] = []
        for watched in touched.values():
            rows, detector = watched.rows, watched.detector
            known = rows.known(OP)
            for sample in rows.release():
                known = known or sample.op == sample.op  # with the first values of all it may be in this same entry
                watched.made_by.append(entry.id)
                watched.samples.extend(sample)
                if detector is None:
                    continue
                half = detector.update(sample.t, sample.sp, sample.pv, sample.op if known else None, sample.flags)
                if half is not None:
                    watched.number += 1
                    u_ff = sample.u_ff
                    compensated = int(u_ff == u_ff and u_ff != 0.0)
                    told = (getattr(half, name) for name in COLUMNS)
                    halves.append((watched.id, watched.number, *told, compensated))
            if rows.told:
                if tell:
                    for kind, text in rows.told:
                        self.tell(Event(entry.now, watched.loop.name, kind, text))
                rows.told.clear()
        return halves

    async def step(self) -> None:
        """Take in what came, and put it down."""
        await _whole(self._step())

    async def _step(self) -> None:
        async with self._stepping:
            now = self._clock()
            entry = self._entry(now)
            if entry is not None:
                self._backlog.append((entry, self._work(entry)))
            await self._put_down(now)

    async def _put_down(self, now: float) -> None:
        backlog, events = list(self._backlog), list(self._events)
        if not backlog and not events:
            return
        entries = [entry for entry, _ in backlog]
        halves = [half for _, some in backlog for half in some]
        try:
            if self._gave_up:  # what is not among the entries must not be looked for there
                await self._save()
                self._gave_up = False
            await asyncio.to_thread(self.store.add, entries, halves, events)
        except (StoreFull, OSError) as error:
            self._failed(str(error), now)
            return
        del self._backlog[: len(backlog)]
        del self._events[: len(events)]
        self._recovered(now)

    def _failed(self, why: str, now: float) -> None:
        if self._failing_since is None:
            self._failing_since = now
        self.failing = why
        self._tell(Event(now, None, "memory_full", f"{why}: what comes waits in memory"))
        if len(self._backlog) > self.bounds.backlog and not self._saving.locked():
            lost = sum(len(entry.loop) for entry, _ in self._backlog)
            halves = [half for _, some in self._backlog for half in some]
            self._backlog.clear()
            self._gave_up = True
            for watched in self._loops.values():
                del watched.samples[:], watched.made_by[:]
            text = f"{lost} values and {len(halves)} half-periods were given up: the store could not be written"
            self._events = self._events[-1000:]
            self._tell(Event(now, None, "given_up", text))
        if now - self._failing_since > 60.0:
            for watched in self._loops.values():
                self._switch_off(watched, "what happens cannot be stored: the store cannot be written")

    def _recovered(self, now: float) -> None:
        if self._failing_since is not None:
            text = f"the store is written again, after {now - self._failing_since:.0f} s"
            self._failing_since = self.failing = None
            self._tell(Event(now, None, "memory_again", text))

    # Saving

    async def save(self) -> None:
        """Write the signals and the states up to here, now.

        Raises
        ------
        StoreFull, OSError
            Where it cannot be written; all of it waits for the next time.
        """
        await self.step()
        if self._backlog:
            raise StoreFull(self.failing or "the store cannot be written")
        await _whole(self._save())

    async def _save(self) -> None:
        async with self._saving:
            position = self._position
            samples, states = {}, {}
            sizes: dict[str, int] = {}
            for name, watched in self._loops.items():
                sizes[name] = len(watched.made_by)
                if sizes[name]:
                    made_by = np.array(watched.made_by, np.int64)
                    samples[name] = (made_by, np.array(watched.samples, np.float64).reshape(-1, _FIELDS))
                states[watched.id] = _state(watched)
            await asyncio.to_thread(self.signals.save, samples, position)
            await asyncio.to_thread(self.store.save, position, states)
            for name, size in sizes.items():
                watched = self._loops[name]
                del watched.made_by[:size], watched.samples[: size * _FIELDS]

    # Running

    async def run(self, source: Plant) -> None:
        """Watch a plant until cancelled; then everything is saved, and nothing is compensated any more."""
        self.source = source
        tasks = [
            asyncio.create_task(one, name=name)
            for name, one in {
                "source": self._values_of(source),
                "steps": self._steps(),
                "keep": self._keep(),
                "fits": self._fits(),
                "heartbeat": self._heartbeats(source),
            }.items()
        ]
        tasks += [
            asyncio.create_task(self._drive(watched, source), name=f"u_FF of {watched.loop.name}")
            for watched in self._loops.values()
            if watched.compensator is not None
        ]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                if (error := task.exception()) is not None:
                    raise error
        finally:
            await self._end(tasks)

    async def _values_of(self, source: Plant) -> None:
        """What the source hands over; begun anew where it was ended by a connection that was, and not by us."""
        while True:
            task = asyncio.ensure_future(source.run(self.take, self.tell))
            try:
                await asyncio.wait({task})
                if not task.cancelled():
                    return task.result()
            finally:
                task.cancel()
                await asyncio.wait({task}, timeout=10.0)
            self.tell(Event(self._clock(), None, "lost", "the connection was ended; it is taken up again"))
            await asyncio.sleep(1.0)

    async def _end(self, tasks: Sequence[asyncio.Task[None]]) -> None:
        """Take u_FF to 0, as far as the plant takes it, and store everything."""
        for watched in self._loops.values():
            self._switch_off(watched, "the service was stopped")
        working = [w for w in self._loops.values() if w.compensator is not None and w.compensator.at_work]
        longest = max((w.compensator.away_within for w in working if w.compensator), default=0.0)
        until = time.monotonic() + min(longest + 3.0, 60.0)
        with suppress(asyncio.CancelledError):
            while any(w.compensator.at_work for w in working if w.compensator) and time.monotonic() < until:
                if any(task.done() for task in tasks):
                    break
                await asyncio.sleep(0.1)
        if self._watchdog_test_task is not None:
            tasks = [*tasks, self._watchdog_test_task]
        left = {task for task in tasks if not task.done()}
        while left:  # once more where a task has not heard it: one that waited for something may have got just that
            for task in left:
                task.cancel()
            _, left = await asyncio.wait(left, timeout=1.0)
        with suppress(StoreFull, OSError):
            await self.save()

    async def _steps(self) -> None:
        saved = shown = time.monotonic()
        while True:
            began = time.monotonic()
            await self.step()
            if began - saved >= self.bounds.save or self._save_now.is_set():
                self._save_now.clear()
                saved = began
                try:
                    if not self._backlog:
                        await _whole(self._save())
                except (StoreFull, OSError) as error:
                    self._failed(f"the signals cannot be written: {error}", self._clock())
            if began - shown >= 5.0 or shown == saved:
                shown = began
                await self._show()
            await asyncio.sleep(max(0.0, self.bounds.step - (time.monotonic() - began)))

    async def _show(self) -> None:
        with suppress(StoreFull):
            await asyncio.to_thread(self.store.show, self._clock(), json.dumps(self.status()))

    async def _keep(self) -> None:
        """Days that are over into their files, and what is too old away."""
        while True:
            now = self._clock()
            try:
                closed = await asyncio.to_thread(self.signals.close_days, now - 3600.0)
                gone = await asyncio.to_thread(self.signals.forget, now, self.bounds.keep)
                await asyncio.to_thread(self.store.forget, now - self.bounds.keep * 86400.0)
                for what, days in (("closed", [str(day) for day in closed]), ("forgotten", gone)):
                    if days:
                        self._tell(Event(now, None, f"signals_{what}", f"signals of {', '.join(days)}: {what}"))
            except (StoreFull, OSError) as error:
                self._tell(Event(now, None, "memory_full", f"signals of past days cannot be put in order: {error}"))
            await asyncio.sleep(3600.0)

    # Fits

    def ask_fit(self, loop: str, person: str) -> None:
        """Have a loop fitted as soon as the one before it is done."""
        if loop not in self._fitting:
            self._fitting.add(loop)
            self._asked.put_nowait((loop, person))

    async def _fits(self) -> None:
        night = asyncio.create_task(self._nights())
        try:
            while True:
                name, person = await self._asked.get()
                began = time.time()
                self._fit_of = name, began
                try:
                    await self._show()
                    with suppress(StoreFull, OSError):
                        await self.save()
                    said = await self._fitted(name)
                    if isinstance(said, str):
                        self._tell(Event(self._clock(), name, "not_fitted", said))
                    else:
                        await self._answered(name, person, said)
                        self._took[name] = time.time() - began
                except StoreFull as error:
                    self._tell(Event(self._clock(), name, "not_fitted", str(error)))
                finally:
                    self._fitting.discard(name)
                    self._fit_of = None
                await self._show()
        finally:
            night.cancel()

    async def _fitted(self, name: str) -> dict[str, Any] | str:
        """What a fit says, or why it says nothing: in a process of its own, which is ended with us."""
        longest, end, began = self.bounds.fit_longest, self._clock(), time.monotonic()
        settings = self._loops[name].loop.model_dump_json(exclude_unset=True)
        receiver, sender = _SPAWN.Pipe(duplex=False)
        asked = (sender, self.store.folder, settings, end - self.bounds.fit_days * 86400.0, end, longest)
        process = _SPAWN.Process(target=answer, args=asked, daemon=True)
        process.start()
        sender.close()
        try:
            said: dict[str, Any] | str = await asyncio.to_thread(receiver.recv)
        except EOFError:
            late = time.monotonic() - began >= longest
            said = f"it took more than {longest:g} s, and was ended" if late else "its process was ended"
        finally:
            process.kill()
            process.join()
        return said

    async def _answered(self, name: str, person: str, answer: dict[str, Any]) -> None:
        row = {"time": self._clock(), "asked_by": person, **answer}
        await asyncio.to_thread(self.store.answer, name, row)
        self._loops[name].answer = (await asyncio.to_thread(self.reader.answers, name, 1))[0]
        self._tell(Event(row["time"], name, "answer", f"{answer['verdict']}: {answer['reason']}"))

    async def _nights(self) -> None:
        while True:
            begin = self._next_night()
            while (left := begin - self._clock()) > 0:  # that clock may hurry, or be set
                await asyncio.sleep(min(left, 1.0))
            # Who was answered longest ago comes first: what one night is too short for, the next begins with.
            ordered = sorted(self._loops.values(), key=lambda w: -math.inf if w.answer is None else w.answer["time"])
            for watched in ordered:
                self.ask_fit(watched.loop.name, "the night")

    def _next_night(self) -> float:
        """When the next fits of a night begin, by the service's clock [s since 1970 UTC]."""
        now = datetime.fromtimestamp(self._clock())
        begin = now.replace(hour=self.bounds.fit_hour, minute=0, second=0, microsecond=0)
        return (begin if begin > now else begin + timedelta(days=1)).timestamp()

    # Compensation

    async def _drive(self, watched: _Watched, source: Plant) -> None:
        """u_FF of one loop: made when a PV comes, or where none comes and the connection lives, and written."""
        compensator, name = watched.compensator, watched.loop.name
        assert compensator is not None
        heard, heard_at = None, -math.inf
        while True:
            with suppress(TimeoutError):  # not `wait_for`, which may lose that it was cancelled
                async with asyncio.timeout(1.5 * watched.period):
                    await watched.due.wait()
            watched.due.clear()
            compensator = watched.compensator or compensator
            if self._hurries and not self._followed(watched):
                continue  # of many scans it would see the last
            if (latest := source.alive(name)) != heard:
                heard, heard_at = latest, self._ticks()
            if not compensator.read_back:
                with suppress(WriteRefused):
                    compensator.take(await _asking(source.read_back(name)), self._clock())
                    compensator.read_back = True
            was, pv = compensator.enabled, watched.latest.get(Signal.PV)
            compensator.scan(self._ticks(), self._ticks() - heard_at <= 5.0 * max(watched.period, 1.0))
            u_ff = compensator.to_write
            if was and not compensator.enabled:
                self._no_more(name)
                self._tell(Event(self._clock(), name, "withdrawn", compensator.why_off_text))
            if self._watchdog_test_runs(name):
                continue  # what stands there is for the plant to take away
            if compensator.at_work or (compensator.written is not None and compensator.written != u_ff):
                await self._hand_over(watched, source, u_ff)
            if pv is not None:
                watched.made = pv.time
                self._made.set()

    def _followed(self, watched: _Watched) -> bool:
        """Whether a plant that hurries waits for this loop's u_FF: there is a width, or something to take away."""
        compensator = watched.compensator
        if compensator is None or self._watchdog_test_runs(watched.loop.name):
            return False
        return compensator.at_work or compensator.sized

    async def caught_up(self, moment: float) -> None:
        """Wait until u_FF of every loop that may be compensated was made of a PV of this moment or later, and written.

        For a simulated plant that hurries. It waits two seconds at most, so that it goes on where no PV comes.
        """
        with suppress(TimeoutError):
            async with asyncio.timeout(_FOLLOWED):
                while any(one.made < moment for one in self._loops.values() if self._followed(one)):
                    self._made.clear()
                    await self._made.wait()

    async def _hand_over(self, watched: _Watched, source: Plant, u_ff: float) -> None:
        name, compensator = watched.loop.name, watched.compensator
        assert compensator is not None
        began = time.monotonic()
        try:
            within = max(3.0 * watched.period, 1.0)
            await _asking(source.write(name, u_ff), within)
            found = await _asking(source.read_back(name), within)
        except WriteRefused as refused:
            if refused.reason == "too_fast":  # the last write was late: this one comes with the next scan
                return
            self._switch_off(watched, f"u_FF was not written: {refused}")
            if not compensator.enabled:
                self._tell(Event(self._clock(), name, "not_written", f"u_FF {u_ff:g}: {refused}"))
        else:
            compensator.wrote(u_ff, self._ticks(), time.monotonic() - began)
            compensator.take(found, self._clock())

    def _switch_off(self, watched: _Watched, why: str) -> None:
        compensator = watched.compensator
        if compensator is not None and compensator.enabled:
            compensator.disable(why)
            self._no_more(watched.loop.name)
            watched.due.set()
            self._tell(Event(self._clock(), watched.loop.name, "withdrawn", why))

    def _no_more(self, name: str) -> None:
        """Let the plant's u_FF only go to 0 from now on."""
        if self.source is not None:
            with suppress(WriteRefused):
                self.source.disable(name)

    async def _heartbeats(self, source: Plant) -> None:
        """The plant's watchdog hears of us only while u_FF of every loop that is compensated is fresh.

        And while none stands that had to be 0 by now: then the plant takes it away, and that of every other loop.
        """
        while True:
            now = self._ticks()
            self._look(now)
            working = [w for w in self._loops.values() if w.compensator is not None and w.compensator.at_work]
            fresh = all(w.compensator is not None and now - w.compensator.written_at <= 3.0 * w.period for w in working)
            if fresh and not self._not_taken_away():
                try:
                    await _asking(source.heartbeat(), 1.0)
                except WriteRefused as refused:
                    # Without one nothing can be enabled, and without a connection nothing is.
                    if refused.reason not in ("not_named", "not_connected"):
                        self._tell(Event(self._clock(), None, "no_beat", f"the watchdog was not counted up: {refused}"))
            await asyncio.sleep(_HEARTBEAT)

    def _look(self, now: float) -> None:
        """Whether any u_FF stands in the plant though it had to be 0 by now."""
        for name, watched in self._loops.items():
            compensator = watched.compensator
            if compensator is None or self._watchdog_test_runs(name):
                continue
            value = compensator.stands(now)
            if value is None and watched.stands:
                text = "u_FF is 0, and the watchdog is counted up again"
                self._tell(Event(self._clock(), name, "taken_away", text))
            elif value is not None and not watched.stands:
                text = (
                    f"u_FF is {value:g} in the plant, and had to be 0 within {compensator.away_within:.0f} s: the "
                    "watchdog is not counted up any more, so that the plant takes u_FF away, of every loop"
                )
                self._tell(Event(self._clock(), name, "not_taken_away", text))
                for other in self._loops.values():
                    self._switch_off(other, f"the watchdog is not counted up: u_FF of {name} is not 0")
            watched.stands = value is not None

    def _not_taken_away(self) -> list[str]:
        """Names of the loops whose u_FF stands in the plant though it had to be 0 by now."""
        return [name for name, watched in self._loops.items() if watched.stands]

    def _require_none_left(self, loop: str) -> None:
        if names := self._not_taken_away():
            raise InputError(
                f"u_FF of {', '.join(names)} is not 0 in the plant, and the watchdog is not counted up",
                loop=loop,
                hint="set it to 0 in the control system, and look who else writes it",
            )

    # What persons ask for

    def limits(self, loop: str) -> dict[str, Bound]:
        """The bounds of all that may be set of a loop, by what is set now."""
        watched = self._loops[loop]
        most = None if watched.compensator is None else watched.most
        return bounds_of(watched.loop, _of_compensation(self.reader.settings(loop)), most)

    def settings(self, loop: str) -> dict[str, Any]:
        """What may be set of a loop, as it is in force: of its detector, and of its compensation where it has one."""
        watched = self._loops[loop]
        ideal = watched.loop.ideal()
        values: dict[str, Any] = {
            "k": None if ideal is None else ideal.k,
            "ti": None if ideal is None else ideal.ti,
            "td": None if ideal is None else ideal.td,
            "setpoint_weight": None if ideal is None else ideal.b,
            "kp": watched.loop.kp(),
            "tf": watched.loop.tf,
            "n": watched.loop.n,
            "acceptable_dead_band": watched.loop.acceptable_dead_band,
        }
        if watched.compensator is not None:
            values |= {name: watched.compensator.setting(name) for name in SETTINGS}
        return values

    async def change(self, loop: str, values: Mapping[str, float | None], person: str, role: str) -> dict[str, Any]:
        """Set parameters of a loop's detector or compensation, all of them or none; gives what is in force then.

        A detector of which a parameter changes begins anew: no estimate stands on detections of two settings.

        Raises
        ------
        InputError
            For a name that is none, or a value out of its bounds.
        StoreFull
            Where it cannot be put down: then it is not done.
        """
        watched = self._loops[loop]
        before = self.settings(loop)
        for name in values:
            if name not in before:
                raise InputError(
                    "no such parameter of this loop", loop=loop, parameter=name, hint=f"there are {', '.join(before)}"
                )
        kept = self.reader.settings(loop) | dict(values)
        of_detector = any(name in DETECTOR for name in values)
        at_work = watched.compensator is not None and (watched.compensator.enabled or watched.compensator.u_ff != 0.0)
        if of_detector and at_work:
            raise InputError("is compensated: disable that first", loop=loop, parameter=next(iter(values)))
        # Tried on one of its own first: all of it is set, or nothing.
        most = watched.most if watched.compensator is not None else None
        changed, made = _checked(self._given[loop], kept, watched.period, most, values)
        detector = None if changed.controller is None or not of_detector else Estimator(changed, watched.period)
        shown = {name: before[name] for name in values}
        if not of_detector:
            assert watched.compensator is not None  # all other names are a compensation's
            watched.compensator.set_all(values)
            after = {name: self.settings(loop)[name] for name in values}
            try:
                await self.log(person, role, "change", loop, shown, after, settings=values)
            except StoreFull:
                watched.compensator.set_all(shown)
                raise
            return self.settings(loop)
        await self.save()  # so that what came before is not taken in again with other settings
        old = watched.loop, watched.detector, watched.compensator
        watched.loop, watched.detector = changed, detector
        if watched.compensator is not None:
            watched.compensator = made
        after = {name: self.settings(loop)[name] for name in values}
        try:
            await self.log(
                person, role, "change", loop, shown, after, settings=values, states={watched.id: _state(watched)}
            )
        except StoreFull:
            watched.loop, watched.detector, watched.compensator = old
            raise
        return self.settings(loop)

    async def enable(self, loop: str, person: str, role: str) -> dict[str, Any]:
        """Let a loop be compensated, by the name of the person who answers for it.

        Raises
        ------
        InputError
            Where the loop has no node for u_FF, no width, or is too slow.
        StoreFull
            Where it cannot be put down: then it is not done.
        """
        compensator, source = self._compensator(loop), self.source
        if self.failing is not None:
            raise StoreFull(self.failing)
        if source is None:
            raise InputError("there is no connection", loop=loop)
        if SEEN not in self.reader.settings(loop):
            raise InputError(
                "it was never seen that the plant takes u_FF away by itself when nobody counts its watchdog up",
                loop=loop,
                hint=f"glapp watch watchdog-test {loop}",
            )
        if self._watchdog_test_runs():
            raise InputError("a watchdog test is under way: wait until it is over", loop=loop)
        self._require_none_left(loop)
        before = compensator.status()
        try:
            await _asking(source.heartbeat())
            source.enable(loop)
            # What stands there is written once more: that takes as long as any other u_FF.
            began = time.monotonic()
            found = await _asking(source.read_back(loop))
            if not found.good:
                raise InputError(f"u_FF cannot be read back: {found.note}", loop=loop)
            await _asking(source.write(loop, found.value))
            compensator.wrote(found.value, self._ticks(), time.monotonic() - began)
            compensator.enable()
            await self.log(person, role, "enable", loop, before, compensator.status())
        except BaseException as error:
            compensator.disable("it could not be enabled")
            self._no_more(loop)
            if isinstance(error, WriteRefused):
                raise InputError(f"cannot be enabled: {error}", loop=loop) from None
            raise
        watched = self._loops[loop]
        self._tell(Event(self._clock(), loop, "enabled", f"{person} enabled compensation"))
        watched.due.set()
        return compensator.status()

    async def watchdog_test(self, loop: str, person: str, role: str) -> None:
        """Begin a watchdog test: a small u_FF is written, the watchdog is left alone, and the plant must take it away.

        A loop is only enabled after that was seen. Its end is told as an event.

        Raises
        ------
        InputError
            Where something is compensated, or cannot be.
        StoreFull
            Where it cannot be put down: then it is not done.
        """
        self._compensator(loop)
        source = self.source
        if source is None:
            raise InputError("there is no connection", loop=loop)
        if self._watchdog_test_runs():
            raise InputError("a watchdog test is under way: wait until it is over", loop=loop)
        if working := [n for n, w in self._loops.items() if w.compensator is not None and w.compensator.at_work]:
            names = ", ".join(working)
            raise InputError(f"the watchdog stands still in a watchdog test, and {names} would lose u_FF", loop=loop)
        self._require_none_left(loop)
        try:
            await _asking(source.heartbeat())
            source.enable(loop)
        except WriteRefused as refused:
            raise InputError(f"its watchdog cannot be tested: {refused}", loop=loop) from None
        await self.log(person, role, "drill", loop, None, None)
        self._watchdog_test_task = asyncio.create_task(
            self._watchdog_test(loop, source, person, role), name=f"watchdog test {loop}"
        )

    def _watchdog_test_runs(self, loop: str | None = None) -> bool:
        """Whether a watchdog test is under way, of a loop where it is named."""
        task = self._watchdog_test_task
        return task is not None and not task.done() and loop in (None, task.get_name().removeprefix("watchdog test "))

    async def _watchdog_test(self, loop: str, source: Plant, person: str, role: str) -> None:
        watched = self._loops[loop]
        assert watched.most is not None
        size = min(0.1 * watched.most[0], 0.25 * watched.most[1] * watched.period)
        try:
            # The rate is counted from when it was enabled, on the wall.
            await asyncio.sleep(1.0 if self._hurries else max(2.0 * watched.period, 1.0))
            began = time.monotonic()
            await _asking(source.write(loop, size))
            while (found := await _asking(source.read_back(loop))).value != 0.0 or not found.good:
                if time.monotonic() - began > self.bounds.watchdog_test:
                    source.disable(loop)
                    await _asking(source.write(loop, 0.0))
                    longest = self.bounds.watchdog_test
                    text = f"the plant left u_FF at {size:g} for {longest:g} s: its watchdog is not wired"
                    self._tell(Event(self._clock(), loop, "drill_failed", text))
                    return
                await asyncio.sleep(0.25)
            took = time.monotonic() - began
            seen = {"time": self._clock(), "person": person, "took": took}
            await self.log(person, role, "drilled", loop, None, seen, settings={SEEN: seen})
            text = f"the plant took u_FF of {size:g} away by itself in {took:.0f} s"
            self._tell(Event(self._clock(), loop, "drilled", text))
        except (WriteRefused, StoreFull) as error:
            self._tell(Event(self._clock(), loop, "drill_failed", str(error)))
        finally:
            self._no_more(loop)

    async def disable(self, loop: str, person: str, role: str) -> dict[str, Any]:
        """End the compensation of a loop; that is done even where it cannot be put down."""
        compensator = self._compensator(loop)
        before = compensator.status()
        self._switch_off(self._loops[loop], f"{person} disabled it")
        await self.log(person, role, "disable", loop, before, compensator.status())
        return compensator.status()

    async def take_over(self, loop: str, answer: int, person: str, role: str) -> dict[str, Any]:
        """Take over what a fit found: the width for compensation, Kp, and K, Ti, Td where the loop has none.

        Raises
        ------
        InputError
            Where there is no such answer, or it holds nothing to take over.
        """
        found = self.reader.one(
            "SELECT verdict, compensable, document FROM answers JOIN loops ON loops.id = answers.loop "
            "WHERE answers.id = ? AND loops.name = ?",
            *(answer, loop),
        )
        if found is None:
            raise InputError("no such answer of this loop", loop=loop, parameter="answer", value=answer)
        learnt = json.loads(found["document"])["learnt"]
        known = self.settings(loop)
        values = {name: value for name, value in learnt.items() if known[name] is None}
        if "comp_fitted" in known and found["compensable"] is not None:
            values["comp_fitted"] = found["compensable"]
        if not values:
            raise InputError(
                f"holds nothing to take over: its verdict is {found['verdict']}",
                loop=loop,
                parameter="answer",
                value=answer,
            )
        return await self.change(loop, values, person, role)

    async def asked_fit(self, loop: str, person: str, role: str) -> None:
        """Queue a fit; log who asked.

        Raises
        ------
        StoreFull
            Where it cannot be put down: then it is not done.
        """
        await self.log(person, role, "fit", loop, None, None)
        self.ask_fit(loop, person)

    async def refused(self, person: str, role: str, command: str, loop: str | None, asked: Any, why: str) -> None:
        """Log what somebody asked for and did not get."""
        with suppress(StoreFull):
            await self.log(person, role, command, loop, None, asked, refused=why)

    async def log(
        self, person: str, role: str, command: str, loop: str | None, before: Any, after: Any, **more: Any
    ) -> None:
        """Log who did what, and what it was before and after."""

        def put() -> None:
            self.store.command(self._clock(), person, role, command, loop, before, after, **more)

        await asyncio.to_thread(put)

    def _compensator(self, loop: str) -> Compensator:
        watched = self._loops[loop]
        if watched.compensator is None:
            why = "its controller is not known" if watched.loop.controller is None else "no node for u_FF is named"
            raise InputError(f"cannot be compensated: {why}", loop=loop)
        return watched.compensator

    # What is shown

    def recorded(self, loop: str, begin: float, end: float) -> pa.Table:
        """The samples of a loop within [begin, end] [s since 1970 UTC]: those on disk, and those not there yet.

        Returns
        -------
        pyarrow.Table
            As `SignalStore.read`.
        """
        # A copy, made at once: nothing may be added to an array at which another thread looks.
        rows = np.frombuffer(self._loops[loop].samples[:], np.float64).reshape(-1, _FIELDS)
        table = self.signals.read(loop, begin, end)
        after = table["time"][-1].as_py().timestamp() if len(table) else -math.inf
        rows = rows[(rows[:, 0] >= begin) & (rows[:, 0] <= end) & (rows[:, 0] > after)]
        return pa.concat_tables([table, table_of(rows)])

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

    def status(self) -> dict[str, Any]:
        """What is shown of the service and of every loop."""
        damaged = self.reader.damaged
        return {
            "now": self._clock(),
            "begun": self.begun,
            "failing": self.failing,
            "damaged": damaged,
            "waiting": len(self._backlog),
            "wall": time.time(),
            "behind": self._behind(),
            "fits_at": self._next_night(),
            "loops": {name: self._shown(watched, damaged is not None) for name, watched in self._loops.items()},
        }

    def _behind(self) -> dict[str, float | None] | None:
        """How far a plant that hurries is behind the clock on the wall [s], and how long it will take to catch up [s].

        None where it has caught up, or does not hurry.
        """
        began, wall = self._started
        clock, now = self._clock(), time.time()
        if not self._hurries or now - clock < 60.0:
            return None
        gained = (clock - began) - (now - wall)
        left = (now - clock) * (now - wall) / gained if gained > 0.0 else None
        return {"seconds": now - clock, "left": left}

    def _fit_shown(self, name: str) -> dict[str, Any] | None:
        """The fit of a loop that is under way or waits: since when, and how long such fits took; None without one."""
        if name not in self._fitting:
            return None
        took = self._took.get(name, max(self._took.values(), default=None))
        of, since = self._fit_of or (None, None)
        return {"since": since if of == name else None, "after": None if of == name else of, "about": took}

    def _shown(self, watched: _Watched, forgotten: bool) -> dict[str, Any]:
        detector, answer = watched.detector, watched.answer
        estimate = None if detector is None else detector.estimate
        pv = watched.latest.get(Signal.PV)
        shown: dict[str, Any] = {
            "seen": None if pv is None else pv.time,
            "heard": None if self.source is None else self.source.alive(watched.loop.name),
            "good": None if pv is None else pv.good,
            "note": "" if pv is None else pv.note,
            "lost": watched.lost,
            "estimate": None if estimate is None else estimate[0],
            "detections": 0 if detector is None or detector.median_mean is None else detector.median_mean[4],
            "half_periods": watched.number,
            "accepted": 0 if detector is None else detector.reasons["accepted"],
            "dropped": watched.rows.dropped,
            "unit": watched.loop.op_label,
            "why": "K and Ti are not known" if detector is None else "",
            "fitting": watched.loop.name in self._fitting,
            "fit": self._fit_shown(watched.loop.name),
            "answer": answer,
            "health": _health(watched, forgotten).name,
        }
        if watched.compensator is not None:
            shown["compensation"] = watched.compensator.status()
        return shown


def with_settings(loop: Loop, settings: Mapping[str, Any]) -> Loop:
    """A loop with what persons have set of its detector.

    Raises
    ------
    InputError
        With the parameter, its value and its bound.
    """
    given = {name: settings[name] for name in DETECTOR if settings.get(name) is not None}
    if not given:
        return loop
    data = loop.model_dump(exclude_unset=True)
    ideal = loop.ideal()
    if given.keys() & {"k", "ti", "td", "setpoint_weight"}:
        known = {} if ideal is None else {"k": ideal.k, "ti": ideal.ti, "td": ideal.td, "setpoint_weight": ideal.b}
        known |= {name: given[name] for name in ("k", "ti", "td", "setpoint_weight") if name in given}
        if known.get("k") == 0.0:
            raise InputError("is 0, must not be 0", loop=loop.name, parameter="k", value=0.0, bound="≠ 0")
        k = known.pop("k", None)
        data["controller"] = {
            **known,
            **({} if k is None else {"k": abs(k), "action": "direct" if k < 0 else "reverse"}),
            "gain_unit": "OP/PV",
        }
    if "kp" in given:
        data["process"] = {**data.get("process", {}), "kp": given["kp"], "kp_unit": "PV/OP"}
    for name in ("tf", "n", "acceptable_dead_band"):
        if name in given:
            whole = name == "n" and float(given[name]).is_integer()
            data[name] = int(given[name]) if whole else given[name]
    try:
        return Loop(**data)
    except InputError as error:
        error.loop = loop.name
        if error.parameter is not None:
            error.parameter = error.parameter.rpartition(".")[2]
        raise


def _checked(
    given: Loop,
    settings: Mapping[str, Any],
    period: float,
    most: tuple[float, float] | None,
    changed: Collection[str] = (),
) -> tuple[Loop, Compensator | None]:
    """A loop with what persons have set, and its compensation where it can have one; `changed` is what is named first.

    Raises
    ------
    InputError
        With the parameter, its value and its bounds.
    """
    alone = bounds_of(given, {}, None)
    for name, bound in alone.items():
        if settings.get(name) is not None:
            check(name, settings[name], bound, given.name)
    loop = with_settings(given, settings)
    if most is None or loop.controller is None:
        return loop, None
    of_compensation = _of_compensation(settings)
    bounds = bounds_of(loop, of_compensation, most)
    for name in sorted(of_compensation, key=lambda name: name not in changed):
        if of_compensation[name] is not None:
            check(name, of_compensation[name], bounds[name], given.name)
    return loop, Compensator(loop, period, of_compensation, *most)


def _of_compensation(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {name: settings[name] for name in SETTINGS if name in settings}


def _settings_of(saved: str) -> Any:
    return json.loads(saved)["settings"]


def _state(watched: _Watched) -> str:
    detector = None if watched.detector is None else watched.detector.save()
    return json.dumps({"rows": watched.rows.save(), "number": watched.number, "detector": detector})


def _health(watched: _Watched, forgotten: bool) -> Health:
    """Whether the loop can be watched, and what the one answer that a fit gave says of its valve.

    `forgotten`: the answers of before were set aside with a damaged database, so that none says nothing.
    """
    pv, answer = watched.latest.get(Signal.PV), watched.answer
    if watched.stands:
        return Health.FAILURE
    if watched.lost or pv is None or not pv.good or (forgotten and answer is None):
        return Health.CHECK_FUNCTION
    return Health.NORMAL if answer is None or answer["health"] is None else Health[answer["health"]]


async def _whole(work: Coroutine[Any, Any, None]) -> None:
    """Do something to its end, even where whoever waits for it is cancelled meanwhile."""
    task = asyncio.ensure_future(work)
    try:
        await asyncio.shield(task)
    except asyncio.CancelledError:
        with suppress(StoreFull, OSError):
            await task
        raise


async def _asking(answer: Coroutine[Any, Any, T], within: float = 5.0) -> T:
    """What the plant answers, within so many seconds.

    In a task of its own: a client that loses its connection cancels all that waits for it, which is not meant for us.

    Raises
    ------
    WriteRefused
        Also where there is no answer in time, or the connection is lost meanwhile.
    """
    task = asyncio.ensure_future(answer)
    task.add_done_callback(lambda done: done.cancelled() or done.exception())
    try:
        await asyncio.wait({task}, timeout=within)
        if not task.done():
            raise WriteRefused("no_answer", f"the plant has not answered in {within:g} s")
        if task.cancelled():
            raise WriteRefused("not_connected", "the connection was lost meanwhile")
        return task.result()
    finally:
        task.cancel()
