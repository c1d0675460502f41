"""The queue of fits: of every loop at night, and of one as soon as a person asks for it; one at a time."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from datetime import datetime, timedelta
from typing import Any

from ..errors import InputError
from .apart import apart
from .fits import answered, event_text
from .journal import Journal
from .options import NIGHT, MonitorOptions
from .signal import Event
from .store import Reader, StoreFull
from .watched import WatchedLoop

__all__ = ["FitQueue"]


class FitQueue:
    """Fits the recordings that are kept of a loop, in a process of its own.

    - `loops`: the loops; each keeps its last answer.
    - `journal`: keeps answers and events.
    - `reader`: of the journal's store.
    - `options`: when the fits of the night begin, how far they look back, how long one may take.
    - `clock`: the time [s since 1970 UTC].
    - `save`: writes all that came in to the disk, where the fit reads it.
    - `show`: writes the status of the service for who reads it.
    """

    def __init__(
        self,
        loops: Mapping[str, WatchedLoop],
        journal: Journal,
        reader: Reader,
        options: MonitorOptions,
        clock: Callable[[], float],
        *,
        save: Callable[[], Awaitable[None]],
        show: Callable[[], Awaitable[None]],
    ) -> None:
        self.options = options
        self._loops, self._journal, self._reader, self._clock = loops, journal, reader, clock
        self._save, self._show = save, show
        self._queue: asyncio.Queue[tuple[str, str]] = asyncio.Queue()
        self._queued: set[str] = set()  # the loop that is fitted now only where it was asked for since
        self._current: tuple[str, float] | None = None  # the loop that is fitted now, and since when on the wall
        self._took: dict[str, float] = {}  # how long the last fit of a loop took [s]

    def ask(self, loop: str, person: str) -> None:
        """Queue the fit of a loop, unless it waits already; one under way does not know what came since it began."""
        if loop not in self._queued:
            self._queued.add(loop)
            self._queue.put_nowait((loop, person))

    async def run(self) -> None:
        """Fit one loop after another, until cancelled."""
        night = asyncio.create_task(self._nights())
        try:
            while True:
                name, person = await self._queue.get()
                began = time.time()
                self._queued.discard(name)
                self._current = name, began
                try:
                    await self._show()
                    with suppress(StoreFull, OSError):
                        await self._save()
                    await self.keep_answer(name, person, await self._fit(name))
                    self._took[name] = time.time() - began
                except (InputError, StoreFull) as error:
                    self._journal.add_event(Event(self._clock(), name, "not_fitted", str(error)))
                finally:
                    self._current = None
                await self._show()
        finally:
            night.cancel()

    async def _fit(self, name: str) -> dict[str, Any]:
        """A row of `answers`, from a process that ends with this one; without one an `InputError` gives the reason."""
        end = self._clock()
        settings = self._loops[name].loop.model_dump_json(exclude_unset=True)
        asked = (self._journal.store.folder, settings, end - self.options.fit_days * 86400.0, end)
        row: dict[str, Any] = await apart(answered, *asked, longest=self.options.fit_longest)
        return row

    async def keep_answer(self, name: str, person: str, answer: dict[str, Any]) -> None:
        """Store the answer of a loop, and report it.

        Raises StoreFull where it cannot be stored.
        """
        row = {"time": self._clock(), "asked_by": person, **answer}
        await asyncio.to_thread(self._journal.store.add_answer, name, row)
        self._loops[name].answer = (await asyncio.to_thread(self._reader.answers, name, 1))[0]
        self._journal.add_event(Event(row["time"], name, "answer", event_text(answer)))

    async def _nights(self) -> None:
        """Queue all loops once a night."""
        while True:
            begin = self.next_night()
            while (left := begin - self._clock()) > 0:  # that clock may hurry, or be set
                await asyncio.sleep(min(left, 1.0))
            # The loop with the oldest answer comes first: what one night is too short for, the next begins with.
            ordered = sorted(self._loops.values(), key=lambda w: -math.inf if w.answer is None else w.answer["time"])
            for watched in ordered:
                self.ask(watched.loop.name, NIGHT)

    def next_night(self) -> float:
        """Time of the next fits of a night, by the service's clock [s since 1970 UTC]."""
        now = datetime.fromtimestamp(self._clock())
        begin = now.replace(hour=self.options.fit_hour, minute=0, second=0, microsecond=0)
        return (begin if begin > now else begin + timedelta(days=1)).timestamp()

    def status(self, name: str) -> dict[str, Any] | None:
        """The fit of a loop that runs or waits: since when, after which loop, how long fits took; None without one."""
        of, since = self._current or (None, None)
        if name not in self._queued and name != of:
            return None
        took = self._took.get(name, max(self._took.values(), default=None))
        return {"since": since if of == name else None, "after": None if of == name else of, "about": took}
