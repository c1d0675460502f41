"""Work of `glapp watch run`: the service beside a plant, or beside a simulated one, until it is stopped."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import InputError
from ..loop import Loop
from ..reading.settings import parse_settings, read_settings
from ..service import demonstration
from ..service.api import ApiServer, app_of, hosts_of
from ..service.connection import Connection, check_tags, read_connection
from ..service.monitor import Monitor
from ..service.opcua import OpcUa
from ..service.opcua_client import client_of
from ..service.options import MonitorOptions
from ..service.plant import SimPlant
from ..service.server import AnswerServer
from ..service.signal import Event
from ..service.store import Store
from ..service.users import Users, first_user
from ..writing import write_file
from .screen import err, event_line, out
from .serving import say_first_login, until_stopped

__all__ = ["SimulatedPlant", "clock_of", "serve"]

_CATCH_UP_SPEED = 20_000.0
"""Seconds of a simulated plant per second, until it has caught up with the wall clock."""

_CATCH_UP_INTERVAL = 0.01
"""Sampling interval of a plant that catches up [s]: it waits for each u_FF."""


class SimulatedPlant(NamedTuple):
    """The simulated plant of `--demo`: the demonstration's own loops where no option is given.

    - `loops`: number of new loops.
    - `days`: how long ago the plant begins [d]; it then catches up with the wall clock.
    - `scan`: scan time [s].
    - `repair`: day on which the worn valves are repaired.
    """

    loops: int | None
    days: float | None
    scan: float | None
    repair: float | None

    @property
    def catches_up(self) -> bool:
        """Whether the plant begins in the past."""
        return (self.days or 0.0) > 0.0

    @property
    def scan_time(self) -> float:
        """Scan time [s], that of the demonstration where none is given."""
        return self.scan or demonstration.SCAN


async def serve(
    watched: Path | SimulatedPlant,
    data: Path,
    options: MonitorOptions,
    address: dict[str, Any],
    answer_server: dict[str, Any] | None,
) -> None:
    """Run the service, until stopped.

    - `watched`: a loops.toml with the connection to its server, or a plant to simulate.
    - `data`: folder of the database and the signals.
    - `options`: times of the monitor.
    - `address`: arguments of `ApiServer`.
    - `answer_server`: arguments of `AnswerServer`, our own OPC UA server; None: it is off.
    """
    async with AsyncExitStack() as stack:
        if isinstance(watched, SimulatedPlant):
            plant, loops, connection = await _simulate(watched, data, stack)
            catches_up = watched.catches_up
            clock = clock_of(plant, watched.scan_time) if catches_up else time.time
        else:
            plant, catches_up, clock = None, False, time.time
            loops, connection = read_settings(watched), _connection_of(watched)
            try:
                check_tags(connection, loops)
            except InputError as error:
                error.file = str(watched)
                raise
            await client_of(connection)  # refuses certificates, keys and passwords that cannot be used
        store = Store(data)
        stack.callback(store.close)
        first_user(store, time.time())
        monitor = Monitor(
            loops,
            store,
            options=options,
            compensable=_compensable(loops),
            clock=clock,
            hurries=catches_up,
            say=_say,
        )
        if plant is not None and catches_up:
            plant.follow = monitor.feedforward.caught_up
        app = app_of(monitor, Users(store), hosts=hosts_of(address["host"], address["names"]))
        api = ApiServer(app, **address)
        source = OpcUa(connection, loops, since=monitor.ingest.since())
        write_file(data / "api-url", api.url)  # whole or not at all: other programs wait for it
        text = f"Watching {len(loops)} loops at {connection.url}; data in {data}, API at {api.url}."
        out.print(text, soft_wrap=True)
        say_first_login(data)
        tasks = [monitor.run(source), api.open(), _tell_certificate(monitor, api), *app.state.proof.work()]
        if answer_server is not None:
            answers = await stack.enter_async_context(AnswerServer(monitor.status, **answer_server))
            out.print(f"Answers and DeviceHealth at {answers.url}, read-only.", soft_wrap=True)
            tasks.append(answers.run())
        await until_stopped(*tasks)


async def _tell_certificate(monitor: Monitor, api: ApiServer) -> None:
    """Report once a day a certificate of the API that has expired, or soon will."""
    while True:
        if (text := api.expiring()) is not None:
            monitor.tell(Event(time.time(), None, "certificate", text))
        await asyncio.sleep(86_400.0)


def _say(event: Event) -> None:
    """An event on standard error, where a terminal or the system's journal has it."""
    err.print(event_line(event.time, event.kind, event.loop, event.text), soft_wrap=True)


def _connection_of(settings: Path) -> Connection:
    """The connection of a loops.toml."""
    connection = read_connection(settings)
    if connection is None:
        raise InputError("has no table [opcua]", file=str(settings), hint="write its url: `glapp tags` does")
    return connection


async def _simulate(
    options: SimulatedPlant, data: Path, stack: AsyncExitStack
) -> tuple[SimPlant, list[Loop], Connection]:
    """Start a simulated plant, for as long as `stack` is open; its loops, and the connection to it.

    The demonstration's loops get their history first, where the folder has none.
    """
    demonstrated = demonstration.loops() if options == SimulatedPlant(None, None, None, None) else None
    plant = SimPlant(
        demonstrated or options.loops or 5,
        scan=options.scan_time,
        begin=options.days or 0.0,
        speed=_CATCH_UP_SPEED if options.catches_up else 1.0,
        watchdog=5.0,
        ramp=3.0,
        repair=options.repair,
    )
    loops = parse_settings(plant.settings(), "the simulated plant", Path())
    data.mkdir(parents=True, exist_ok=True)
    fresh = not (data / "glapp.db").exists() and not (data / "signals").exists()
    if demonstrated is not None and fresh:  # before the plant goes on from there
        store = Store(data)
        try:
            demonstration.begin(store, demonstrated, loops, time.time())
        finally:
            store.close()
    await stack.enter_async_context(plant)
    settings = data / "demo.toml"
    settings.write_text(plant.settings(), encoding="utf-8")
    connection = _connection_of(settings)
    if options.catches_up:  # a thousand values a second of each tag
        return (
            plant,
            loops,
            connection.model_copy(update={"samples": 10_000, "interval": _CATCH_UP_INTERVAL, "behind": math.inf}),
        )
    # Short against the scan time: a late value makes a late u_FF.
    return plant, loops, connection.model_copy(update={"interval": min(1.0, options.scan_time / 2.0)})


def clock_of(plant: SimPlant, scan: float) -> Callable[[], float]:
    """The time of a plant that catches up, and the wall clock from when it has caught up [s since 1970 UTC]."""
    present = False

    def clock() -> float:
        nonlocal present
        now = time.time()
        present = present or now - plant.time < 1.5 * scan
        return now if present else plant.time

    return clock


def _compensable(loops: Sequence[Loop]) -> dict[str, tuple[float, float]]:
    """The loops with a node for u_FF: its limit [OP unit] and its rate [OP unit per second]."""
    found = {}
    for loop in loops:
        tags = loop.opcua
        if tags.u_ff is not None and tags.u_ff_limit is not None and tags.u_ff_rate is not None:
            found[loop.name] = (tags.u_ff_limit, tags.u_ff_rate)
    return found
