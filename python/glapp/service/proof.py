"""Part of the API on the proof of a gap and its repair: plans of tests, guided tests, repairs."""

# FastAPI reads the annotations as they are: no `from __future__ import annotations` here.
import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from typing import Annotated, Any

from fastapi import FastAPI
from fastapi import Path as InPath
from pydantic import BaseModel, ConfigDict, Field

from ..errors import InputError
from .guided import GuidedTests
from .monitor import Monitor
from .plans import Plans
from .users import Person

__all__ = ["Proof", "routes"]

AHEAD = 3600.0
"""A repair is noted for a time at most so far ahead [s]."""

Name = Annotated[str, InPath(description="Name of the loop.", max_length=200)]
Limits = Annotated[list[float], Field(min_length=2, max_length=2)]


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class PlanTest(_Asked):
    """A test that is to be planned, within the limits of a person."""

    op_within: Limits
    """Least and greatest OP [OP unit]."""
    pv_within: Limits
    """Least and greatest PV [PV unit]."""
    minutes: Annotated[float, Field(gt=0, le=1440)] = 60.0
    """Longest test [min]."""
    width: Annotated[float, Field(gt=0)] | None = None
    """Width in question [OP unit]; null: that of the loop's answer."""


class Repaired(_Asked):
    """A repair of the valve."""

    time: Annotated[float, Field(ge=0, le=1e11)]
    """Time [s since 1970 UTC]."""
    note: Annotated[str, Field(max_length=500)] = ""
    """Description of the work done."""


class Proof:
    """Plans and guided tests of a monitor, and the threads that work on them.

    - `monitor`: whose loops they are of.
    """

    def __init__(self, monitor: Monitor) -> None:
        self.monitor = monitor
        self.plans, self.guided = Plans(monitor), GuidedTests(monitor)

    def work(self) -> list[Coroutine[Any, Any, None]]:
        """Task that runs until the service ends."""
        return [self.plans.run(), self.guided.run()]

    async def repaired(self, loop: str, asked: Repaired, person: str, role: str) -> None:
        """Note a repair, and queue a fit of the recordings after it.

        Raises InputError for a time that has not come yet, or whose repair is noted already. Raises StoreFull where it
        cannot be stored.
        """
        monitor = self.monitor
        if asked.time > monitor.now + AHEAD:
            raise InputError("has not come yet", loop=loop, parameter="time", value=asked.time)
        noted = await asyncio.to_thread(monitor.reader.repairs, loop)
        if any(row["time"] == asked.time for row in noted):
            raise InputError("a repair of that time is noted already", loop=loop, parameter="time", value=asked.time)
        await monitor.journal.log(person, role, "repaired", loop, None, {"time": asked.time, "note": asked.note})
        await asyncio.to_thread(monitor.store.note_repair, loop, asked.time, monitor.now, person, asked.note)
        monitor.fits.ask(loop, person)


Done = Callable[[Person, str, str | None, Any, Coroutine[Any, Any, Any]], Awaitable[Any]]


def routes(
    app: FastAPI, proof: Proof, viewer: Any, operator: Any, known: Callable[[str], str], done: Done, looked: Any
) -> None:
    """Add the requests to an API.

    - `app`: of the service.
    - `proof`: what they are about.
    - `viewer`, `operator`: who may ask: dependencies that give a `Person`.
    - `known`: the name of a loop, or 404.
    - `done`: does a command, and puts it down where it is refused.
    - `looked`: reads something in a thread for that.
    """
    reader = proof.monitor.reader

    def who(person: Person) -> tuple[str, str]:
        return person.name, person.role.name.lower()

    @app.get("/loops/{name:path}/plan")
    async def plan(person: Annotated[Person, viewer], name: Name) -> dict[str, Any] | None:
        """The last plan of a test that was asked for; null where none was."""
        found: dict[str, Any] | None = await looked(reader.plan, known(name))
        return found

    @app.post("/loops/{name:path}/plan")
    async def ask_plan(person: Annotated[Person, operator], name: Name, asked: PlanTest) -> dict[str, Any]:
        """Have a test planned within limits; it takes up to some minutes."""
        wanted = asked.model_dump()
        await done(person, "plan", known(name), wanted, proof.plans.ask(name, wanted, *who(person)))
        return {"asked": name}

    @app.get("/loops/{name:path}/guided-test")
    async def guided_test(person: Annotated[Person, viewer], name: Name) -> dict[str, Any] | None:
        """The last guided step test, and where it is; null where none was made."""
        found: dict[str, Any] | None = await looked(reader.guided_test, known(name))
        return found

    @app.post("/loops/{name:path}/guided-test")
    async def begin(person: Annotated[Person, operator], name: Name) -> dict[str, Any]:
        """Begin the planned test with OP by hand: from now on each move is named, and the test is judged as it goes."""
        await done(person, "guided_test", known(name), None, proof.guided.begin(name, *who(person)))
        return {"begun": name}

    @app.post("/loops/{name:path}/guided-test-stop")
    async def stop(person: Annotated[Person, operator], name: Name) -> dict[str, Any]:
        """End a guided test that goes on."""
        await done(person, "guided_test_stopped", known(name), None, proof.guided.stop(name, *who(person)))
        return {"stopped": name}

    @app.get("/loops/{name:path}/repairs")
    async def repairs(person: Annotated[Person, viewer], name: Name) -> list[dict[str, Any]]:
        """The repairs of the valve that were noted, the newest first."""
        found: list[dict[str, Any]] = await looked(reader.repairs, known(name))
        return found

    @app.post("/loops/{name:path}/repaired")
    async def repaired(person: Annotated[Person, operator], name: Name, asked: Repaired) -> dict[str, Any]:
        """Note a repair of the valve: fits use the recordings after it from now on."""
        await done(person, "repaired", known(name), asked.model_dump(), proof.repaired(name, asked, *who(person)))
        return {"repaired": name}
