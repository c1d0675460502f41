"""The guided step test: names each move, waits for it, judges it, and ends by a decision or near a limit.

A person moves OP, in manual, at the control system; nothing is written from here. Where the test is follows from the
signals that the service records (`glapp.service.guide`), so that a service that starts again goes on with it.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from .._glapp import number
from ..errors import InputError
from ..planned import Plan
from .guide import Asked, Guide, guide, result_text
from .monitor import Monitor
from .plans import loop_of
from .signal import Event
from .store import StoreFull

__all__ = ["GuidedTests"]

PAUSE = 4.0
"""The pause between two checks of the tests is this many times as long as the last check."""


class GuidedTests:
    """The guided tests of the loops of a monitor.

    - `monitor`: whose loops they are of.
    - `every`: a test is looked at so often [s].
    """

    def __init__(self, monitor: Monitor, every: float = 1.0) -> None:
        self._monitor, self._every = monitor, every
        self._begun = asyncio.Event()

    def going_on(self) -> list[dict[str, Any]]:
        """The tests that go on; they outlive the service."""
        return self._monitor.reader.guided_tests_going_on()

    async def begin(self, loop: str, person: str, role: str) -> None:
        """Begin the test with OP by hand of the loop's last plan.

        Raises InputError where there is no such plan, a test of the loop goes on, or nobody says when the controller is
        in manual. Raises StoreFull where it cannot be stored: then nothing begins.
        """
        monitor = self._monitor
        plan = monitor.reader.plan(loop)
        if plan is None or plan["plan"] is None:
            raise InputError("no test is planned", loop=loop, hint="plan one first")
        asked = Asked.of_plan(Plan.of(plan["plan"]))
        if any(row["name"] == loop for row in self.going_on()):
            raise InputError("a guided test of it goes on", loop=loop)
        if "mode" not in monitor.ingest.live(loop):
            raise InputError(
                "its mode does not come from the plant: nobody sees when it is in manual",
                loop=loop,
                hint="name its node: mode = ... in the loops.toml",
            )
        first = Guide("Put the controller in manual while the load is calm.")
        await monitor.journal.log(person, role, "guided_test", loop, None, {"width": asked.width})
        begun = (loop, monitor.now, person, asdict(asked), asdict(first))
        await asyncio.to_thread(monitor.store.begin_guided_test, *begun)
        self._begun.set()

    async def stop(self, loop: str, person: str, role: str) -> None:
        """End the test of a loop that goes on.

        Raises InputError where none does.
        """
        row = next((row for row in self.going_on() if row["name"] == loop), None)
        if row is None:
            raise InputError("no guided test of it goes on", loop=loop)
        await self._monitor.journal.log(person, role, "guided_test_stopped", loop, None, None)
        state = json.loads(row["state"]) | {"outcome": "stopped", "until": None}
        back = f" Put OP back to {number(state['levels'][0], 4)}." if state["levels"] else ""
        state["text"] = f"{person} stopped the test.{back} Put the controller in automatic."
        await self._put(row, state, self._monitor.now)

    async def run(self) -> None:
        """Look at the tests that go on, again and again, until cancelled."""
        while True:
            self._begun.clear()
            began = time.monotonic()
            rows = await asyncio.to_thread(self.going_on)
            for row in rows:
                with suppress(StoreFull, OSError):  # the monitor reports it
                    await self._look(row)
            if rows:  # late in the day there are many files to read: a fifth of one processor, no more
                await asyncio.sleep(max(self._every, PAUSE * (time.monotonic() - began)))
            else:
                await self._begun.wait()

    async def _look(self, row: Mapping[str, Any]) -> None:
        """Update the state of a running test."""
        monitor, name = self._monitor, row["name"]
        asked, now = Asked.of(json.loads(row["asked"])), monitor.now
        if name not in monitor.loops:
            stopped = json.loads(row["state"]) | {"outcome": "stopped", "text": "The loop is not watched any more."}
            return await self._put(row, stopped, now)

        def found() -> Guide:
            loop = loop_of(monitor.reader, name)
            return guide(asked, monitor.journal.recorded(name, row["begun"], now), loop, row["begun"], now)

        try:
            state = asdict(await asyncio.to_thread(found))
        except Exception as error:  # it must not end the monitor
            monitor.tell(Event(now, name, "guided_test", f"it cannot be followed: {type(error).__name__}: {error}"))
            return None
        if json.dumps(_plain(state)) != row["state"]:
            await self._put(row, state, None if state["outcome"] is None else now)
        return None

    async def _put(self, row: Mapping[str, Any], state: Mapping[str, Any], ended: float | None) -> None:
        """Store the state of a test."""
        monitor, name = self._monitor, row["name"]
        await asyncio.to_thread(monitor.store.keep_guided_test, row["id"], json.dumps(_plain(dict(state))), ended)
        if ended is None:
            return
        asked = Asked.of(json.loads(row["asked"]))
        unit = loop_of(monitor.reader, name).op_label
        monitor.tell(Event(ended, name, "guided_test", result_text(state, asked, unit)))
        if state["found"] is not None:
            monitor.fits.ask(name, row["person"])  # the answer takes it in


def _plain(of: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(of, dict):
        return {name: _plain(value) for name, value in of.items()}
    if isinstance(of, list | tuple):
        return [_plain(value) for value in of]
    return None if isinstance(of, float) and not math.isfinite(of) else of
