"""One loop for one person: what the parts of its page share."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import numpy as np
from nicegui import ui

from ..errors import InputError
from ..service.recordings import SignalStore
from ..service.store import Reader
from .client import Gone, Refused, loop_path
from .pages import Station
from .sessions import Session

__all__ = ["WINDOWS", "OneLoop", "reporting"]

T = TypeVar("T")

WINDOWS = {900: "15 min", 7200: "2 h", 86400: "1 d", 604800: "7 d"}
"""Choices of the time shown in the charts [s]."""

MOST = 3000
"""Samples drawn at most."""


class OneLoop:
    """One loop, and the person who looks at it.

    - `pv_unit`, `op_unit`: units of its signals.
    - `window`: time shown in the charts [s].
    """

    def __init__(self, station: Station, session: Session, name: str) -> None:
        self.station, self.session, self.name = station, session, name
        self.view = station.view
        loop = station.view.loops[name]
        self.pv_unit, self.op_unit = loop.pv_unit or "", loop.op_label
        sample = loop.sample_time or 1.0
        self.window = next((window for window in WINDOWS if window >= 300.0 * sample), max(WINDOWS))

    @property
    def dark(self) -> bool:
        """Whether the person's charts are dark."""
        return self.session.dark

    @property
    def status(self) -> dict[str, Any]:
        """State of the loop in the database."""
        found: dict[str, Any] = self.view.shown["loops"].get(self.name, {})
        return found

    @property
    def answer(self) -> dict[str, Any] | None:
        """Answer of the loop; None before the first one."""
        return self.view.answer(self.name)

    @property
    def width(self) -> float | None:
        """Width of the answer [OP unit]; None without one."""
        answer = self.answer
        return None if answer is None else answer["width"]

    @property
    def unit(self) -> str:
        """Unit in which widths are shown."""
        return "% of span" if self.view.percent(self.name, 1.0) is not None else self.op_unit

    async def read(self, what: Callable[[Reader], T]) -> T:
        """Something from the database."""
        return await asyncio.to_thread(self.view.read, what)

    async def ask(self, path: str) -> Any:
        """Something from the API; None, and a message to the person, where it refuses."""
        try:
            return await self.station.api.asked("GET", path, self.session.token)
        except (Gone, Refused) as error:
            ui.notify(str(error), type="warning", timeout=0, close_button="Close", multi_line=True)
            return None

    async def signals(self, begin: float, end: float) -> dict[str, Any]:
        """Samples: from the service, and where that does not answer those on disk."""
        path = loop_path(self.name, f"signals?begin={begin}&end={end}&most={MOST}")
        try:
            found: dict[str, Any] = await self.station.api.asked("GET", path, self.session.token)
            return found
        except (Gone, Refused):
            return await asyncio.to_thread(self._from_disk, begin, end)

    async def newest(self, seconds: float | None = None) -> dict[str, Any]:
        """Samples of the last `seconds`, by default of the window."""
        end = self.view.now
        return await self.signals(end - (self.window if seconds is None else seconds), end)

    def _from_disk(self, begin: float, end: float) -> dict[str, Any]:
        """Recorded signals, thinned."""
        table = SignalStore(self.view.folder).read(self.name, begin, end)
        every = max(1, -(-len(table) // MOST))
        found: dict[str, Any] = table.take(np.arange(0, len(table), every)).to_pydict()
        found["time"] = [at.timestamp() for at in found["time"]]
        for name in ("SP", "PV", "OP", "U_FF"):
            found[name] = [None if x is None or not math.isfinite(x) else x for x in found[name]]
        return found


def reporting(what: Callable[[], Awaitable[None]]) -> Callable[[], Awaitable[None]]:
    """Handler of a button that reports errors at the button, also those of a database that cannot be read."""

    async def safely() -> None:
        try:
            await what()
        except InputError as error:
            ui.notify(str(error), type="warning", timeout=0, close_button="Close", multi_line=True)

    return safely
