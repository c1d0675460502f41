"""The journal: entries and events, written to the store; while that fails, they wait in memory."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import pyarrow as pa

from .options import MonitorOptions
from .recordings import SignalStore, table_of
from .signal import Event, Signal
from .store import Entry, Half, Store, StoreFull
from .watched import WatchedLoop

__all__ = ["Journal", "to_the_end"]

_REPEATED = 60.0
"""An event that comes again and again is written once in this time, with how often it came [s]."""


@dataclass(slots=True)
class _Again:
    """Events of one kind that were only counted: since when [s since 1970 UTC], how many, the newest of them."""

    since: float
    count: int = 0
    last: Event | None = None


class Journal:
    """Entries, half-periods, events, states and signals of a monitor, on their way to the disk.

    - `store`: the database. Signals are kept next to it.
    - `loops`: the loops, which may be filled in later.
    - `options`: how much waits in memory, and how long signals are kept.
    - `clock`: the time [s since 1970 UTC].
    - `say`: gets every event, too, also while the store cannot be written.

    - `position`: number of the last entry.
    - `failing`: why the store cannot be written now; None where it can.
    """

    def __init__(
        self,
        store: Store,
        loops: Mapping[str, WatchedLoop],
        options: MonitorOptions,
        clock: Callable[[], float],
        say: Callable[[Event], None] | None = None,
    ) -> None:
        self.store, self.signals = store, SignalStore(store.folder)
        self.position = store.position()
        self.failing: str | None = None
        self._loops, self._options, self._clock, self._say = loops, options, clock, say
        self._events: list[Event] = []
        self._repeated: dict[tuple[str | None, str, Signal | None], _Again] = {}
        self._backlog: list[tuple[Entry, list[Half]]] = []
        self._failing_since: float | None = None
        self._gave_up = False
        self._saving = asyncio.Lock()

    @property
    def waiting(self) -> int:
        """Number of entries that wait in memory."""
        return len(self._backlog)

    def add_event(self, event: Event) -> None:
        """Add an event; one on the same tag that comes again within a minute is counted instead."""
        key = (event.loop, event.kind, event.signal)
        again = self._repeated.get(key)
        if again is not None and event.time - again.since < _REPEATED:
            again.count, again.last = again.count + 1, event
            return
        self._append(event, 0 if again is None else again.count)
        self._repeated[key] = _Again(event.time)

    def _append(self, event: Event, count: int) -> None:
        """Add an event to those that are written; it stands for so many others of its kind, too."""
        more = f" (and {'once' if count == 1 else f'{count} times'} more since)" if count else ""
        self._events.append(made := replace(event, text=event.text + more))
        if self._say is not None:
            self._say(made)

    def _flush(self, now: float) -> None:
        """Add the newest of the events that were only counted in a minute that is over: the last one is how it is."""
        for again in self._repeated.values():
            if again.last is not None and now - again.since >= _REPEATED:
                self._append(again.last, again.count - 1)
                again.since, again.count, again.last = now, 0, None

    def next_position(self, now: float) -> int:
        """The number of the next entry, greater than all before; it also says when that was made [ms]."""
        self.position = max(self.position + 1, int(now * 1000.0))
        return self.position

    def add(self, entry: Entry, halves: list[Half]) -> None:
        """Add an entry and the half-periods that ended in it."""
        self._backlog.append((entry, halves))

    async def write(self, now: float) -> None:
        """Write to the store all that was added; where that fails it waits, and `failing` says why."""
        self._flush(now)
        backlog, events = list(self._backlog), list(self._events)
        if not backlog and not events:
            return
        entries = [entry for entry, _ in backlog]
        halves = [half for _, some in backlog for half in some]
        try:
            if self._gave_up:  # the next start must not look among the entries for what was given up
                await self._save()
                self._gave_up = False
            await asyncio.to_thread(self.store.add, entries, halves, events)
        except (StoreFull, OSError) as error:
            self._failed(str(error), now)
            return
        del self._backlog[: len(backlog)]
        del self._events[: len(events)]
        if self._failing_since is not None:
            text = f"the store can be written again, after {now - self._failing_since:.0f} s"
            self._failing_since = self.failing = None
            self.add_event(Event(now, None, "memory_again", text))

    def failing_for(self, now: float) -> float:
        """Time since which the store cannot be written [s]; 0 where it can."""
        return 0.0 if self._failing_since is None else now - self._failing_since

    def _failed(self, why: str, now: float) -> None:
        """Note that the store cannot be written."""
        if self._failing_since is None:
            self._failing_since = now
        self.failing = why
        self.add_event(Event(now, None, "memory_full", f"{why}: what comes waits in memory"))
        if len(self._backlog) <= self._options.backlog or self._saving.locked():
            return
        values = sum(len(entry.loop) for entry, _ in self._backlog)
        halves = sum(len(some) for _, some in self._backlog)
        self._backlog.clear()
        self._gave_up = True
        for watched in self._loops.values():
            watched.forget_saved()
        self._events = self._events[-1000:]
        text = f"{values} values and {halves} half-periods were given up: the store could not be written"
        self.add_event(Event(now, None, "given_up", text))

    # Signals and states

    async def save(self) -> None:
        """Write the signals and the states as of the last entry; all entries have to be written before.

        Raises StoreFull, OSError where it cannot be written, or entries wait. All of it waits for the next time.
        """
        if self._backlog:
            raise StoreFull(self.failing or "the store cannot be written")
        await to_the_end(self._save())

    async def try_save(self) -> None:
        """Save if no entry waits; log a failure as an event."""
        try:
            if not self._backlog:
                await to_the_end(self._save())
        except (StoreFull, OSError) as error:
            self._failed(f"the signals cannot be written: {error}", self._clock())

    async def _save(self) -> None:
        """Write entries, events and states in one transaction."""
        async with self._saving:
            position = self.position
            samples = {name: watched.unsaved() for name, watched in self._loops.items()}
            states = {watched.id: watched.state() for watched in self._loops.values()}
            filled = {name: some for name, some in samples.items() if len(some[0])}
            await asyncio.to_thread(self.signals.save, filled, position)
            await asyncio.to_thread(self.store.save, position, states)
            for name, (entry_ids, _) in filled.items():
                self._loops[name].forget_saved(len(entry_ids))

    def recorded(self, loop: str, begin: float, end: float) -> pa.Table:
        """The samples of a loop within [begin, end] [s since 1970 UTC]: those on disk, and those not there yet.

        Returns as `SignalStore.read`.
        """
        _, rows = self._loops[loop].unsaved()
        table = self.signals.read(loop, begin, end)
        after = table["time"][-1].as_py().timestamp() if len(table) else -math.inf
        rows = rows[(rows[:, 0] >= begin) & (rows[:, 0] <= end) & (rows[:, 0] > after)]
        return pa.concat_tables([table, table_of(rows)])

    async def tidy(self) -> None:
        """Every hour: put the signals of past days into their files, and delete those older than the kept time."""
        while True:
            now = self._clock()
            try:
                closed = await asyncio.to_thread(self.signals.close_days, now - 3600.0)
                gone = await asyncio.to_thread(self.signals.forget, self._options.keep)
                await asyncio.to_thread(self.store.forget, now - self._options.keep * 86400.0)
                for what, days in (("closed", [str(day) for day in closed]), ("forgotten", gone)):
                    if days:
                        self.add_event(Event(now, None, f"signals_{what}", f"signals of {', '.join(days)}: {what}"))
            except (StoreFull, OSError) as error:
                text = f"signals of past days cannot be put in order: {error}"
                self.add_event(Event(now, None, "memory_full", text))
            await asyncio.sleep(3600.0)

    async def log(
        self, person: str, role: str, command: str, loop: str | None, before: Any, after: Any, **more: Any
    ) -> None:
        """Write at once the name of the person, the command, and the values before and after.

        Raises StoreFull where it cannot be written.
        """

        def write() -> None:
            self.store.command(self._clock(), person, role, command, loop, before, after, **more)

        await asyncio.to_thread(write)


async def to_the_end(work: Coroutine[Any, Any, None]) -> None:
    """Do something to its end, even where the task that waits for it is cancelled meanwhile."""
    task = asyncio.ensure_future(work)
    try:
        await asyncio.shield(task)
    except asyncio.CancelledError:
        with suppress(StoreFull, OSError):
            await task
        raise
