"""Plans of tests that a person asks for: worked out in a process of its own, one after the other, and stored."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..checked import check_limits
from ..errors import InputError
from ..estimate import analyze
from ..loop import Loop
from ..plan import plan_from
from .apart import apart
from .monitor import Monitor
from .recordings import SignalStore
from .settable import with_settings
from .signal import Event
from .store import Reader, StoreFull

__all__ = ["DAYS", "LONGEST", "Plans", "loop_of", "planned", "width_in_question"]

DAYS = 7.0
"""A plan looks back this many days."""

LONGEST = 600.0
"""A plan may take so long [s]."""

NEWEST = 3
"""Number of newest days that are planned from."""


def loop_of(reader: Reader, name: str) -> Loop:
    """A loop as it is watched now: as given, with what persons have set.

    Raises InputError where there is no such loop.
    """
    given = reader.loops_given().get(name)
    if given is None:
        raise InputError("there is no such loop", loop=name)
    return with_settings(Loop(**given), reader.settings(name))


def width_in_question(answer: Mapping[str, Any] | None) -> float | None:
    """Width that a test is to decide on, by the answer of the loop: a likely one, else the widest acceptable one.

    Examples
    --------
    >>> width_in_question({"confidence": "likely", "width": 2.0, "limit": {"width": 1.0}})
    2.0
    >>> width_in_question({"confidence": "cannot_tell", "width": None, "limit": {"width": 1.0}})
    1.0
    """
    if answer is None:
        return None
    if answer["confidence"] in ("likely", "found") and answer["width"]:
        return float(answer["width"])
    limit = answer["limit"]
    return None if limit is None or not limit["width"] else float(limit["width"])


def planned(folder: Path, settings: str, begin: float, end: float, asked: Mapping[str, Any]) -> dict[str, Any]:
    """The plan of a loop from its newest recordings, in plain types.

    - `folder`: the data folder.
    - `settings`: the loop, as JSON.
    - `begin`, `end`: from when to when [s since 1970 UTC].
    - `asked`: `op_within`, `pv_within`, `minutes` and `width`, as `glapp.plan_test` takes them.

    Raises InputError where nothing is recorded, or nothing can be planned.
    """
    loop = Loop(**json.loads(settings))
    recordings = SignalStore(folder).recordings(loop, begin, end)[-NEWEST:]
    if not recordings:
        raise InputError("has no recording to plan from yet", loop=loop.name)
    limits = {name: tuple(asked[name]) for name in ("op_within", "pv_within")}
    plan = plan_from(recordings, analyze(recordings[-1]), width=asked["width"], minutes=asked["minutes"], **limits)
    return plan.to_dict()


class Plans:
    """Plans of the loops of a monitor.

    - `monitor`: whose loops they are of.
    """

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._asked = asyncio.Event()

    async def ask(self, loop: str, asked: Mapping[str, Any], person: str, role: str) -> None:
        """Have a test planned as soon as the plan before it is made.

        - `asked`: `op_within`, `pv_within` (each the lower limit before the upper), `minutes` > 0, and `width` or None:
          then it is that of the loop's answer.
        - `person`, `role`: who asks.

        Raises InputError for limits that cannot be, or where a plan of the loop is waiting already. Raises StoreFull
        where it cannot be stored: then nothing is planned.
        """
        for name in ("op_within", "pv_within"):
            check_limits(asked[name], name, loop=loop)
        if any(row["name"] == loop for row in self._monitor.reader.plans_waiting()):
            raise InputError("a test of it is planned already", loop=loop)
        monitor = self._monitor

        def put() -> None:
            answer = _answer(monitor.reader, loop)
            wanted = {**asked, "width": asked["width"] or width_in_question(answer)}
            monitor.store.ask_plan(loop, monitor.now, person, wanted)

        await monitor.journal.log(person, role, "plan", loop, None, dict(asked))
        await asyncio.to_thread(put)
        self._asked.set()

    async def run(self) -> None:
        """Make the plans that wait, one after the other, until cancelled."""
        while True:
            self._asked.clear()
            for row in await asyncio.to_thread(self._monitor.reader.plans_waiting):
                await self._make(row)
            await self._asked.wait()

    async def _make(self, row: Mapping[str, Any]) -> None:
        """Plan a test, and store the plan."""
        monitor, name = self._monitor, row["name"]
        plan, refused = None, None
        try:
            with suppress(StoreFull, OSError):
                await monitor.save()  # what came last is on disk before it is looked at
            settings = loop_of(monitor.reader, name).model_dump_json(exclude_unset=True)
            now = monitor.now
            words = (monitor.store.folder, settings, now - DAYS * 86400.0, now, json.loads(row["asked"]))
            plan = await apart(planned, *words, longest=LONGEST)
        except (InputError, OSError) as error:
            refused = str(error)
        try:
            await asyncio.to_thread(monitor.store.keep_plan, row["id"], plan, refused)
        except StoreFull as full:
            monitor.tell(Event(monitor.now, name, "not_planned", str(full)))
            await asyncio.sleep(60.0)  # it is made once more
            self._asked.set()
            return
        kind = "planned" if refused is None else "not_planned"
        monitor.tell(Event(monitor.now, name, kind, refused or "a test is planned"))


def _answer(reader: Reader, loop: str) -> dict[str, Any] | None:
    """The one answer of a loop by its last fit."""
    rows = reader.answers(loop, 1)
    document = reader.document(rows[0]["id"]) if rows else None
    return None if document is None else document["loops"][0]["answer"]
