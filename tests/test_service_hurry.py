"""A plant that hurries, so that a day of it is over in seconds: compensation in its time, seen through to its end."""

import asyncio
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from service import Clock, Table

from glapp import Loop
from glapp.cli.watch_run import clock_of
from glapp.reading.settings import parse_settings
from glapp.service.connection import Connection
from glapp.service.monitor import Monitor
from glapp.service.opcua import OpcUa
from glapp.service.options import MonitorOptions
from glapp.service.plant import NAMESPACE, SimLoop, SimPlant
from glapp.service.plant import _kinds as kinds
from glapp.service.signal import Event, Signal, Value
from glapp.service.store import Store
from glapp.service.watchdog import WATCHDOG_SEEN

SCAN = 60.0
WIDTH, ENABLED, REPAIRED = 50, 70, 500
OPTIONS = MonitorOptions(period=SCAN, lost=10.0 * SCAN, wait=0.0)


async def seen(monitor: Monitor, loop: str, **settings: float) -> None:
    """A state as after a watchdog test, with a width that is typed."""
    await monitor.journal.log("eve", "engineer", "drilled", loop, None, None, settings={WATCHDOG_SEEN: {}})
    await monitor.commands.change(loop, settings, "eve", "engineer")


def test_a_service_takes_the_settings_of_a_plant_that_hurries(tmp_path: Path) -> None:
    """Regression: u_FF of `glapp station --demo --days 40 --scan 60` was faster than may be set."""
    plant = SimPlant(1, scan=SCAN, speed=20_000.0)
    [loop] = parse_settings(plant.settings(), "loops.toml", tmp_path)
    assert loop.opcua.u_ff_limit is not None and loop.opcua.u_ff_rate is not None
    most = {loop.name: (loop.opcua.u_ff_limit, loop.opcua.u_ff_rate)}
    monitor = Monitor([loop], Store(tmp_path), options=OPTIONS, compensable=most)
    assert monitor.loops[loop.name].compensator is not None


def test_the_clock_on_the_wall_counts_once_the_plant_has_caught_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """The window tells how old what the service wrote is: between two scans of a minute that is not a minute."""

    class Plant:
        time = 0.0

    plant, wall = Plant(), 1e6
    monkeypatch.setattr("time.time", lambda: wall)
    clock = clock_of(plant, SCAN)
    assert clock() == 0.0
    plant.time = wall - 2.0 * SCAN
    assert clock() == plant.time
    plant.time, wall = wall - SCAN, wall + 20.0
    assert clock() == wall
    # The value stays if the plant then falls behind: a clock does not go back.
    wall += 600.0
    assert clock() == wall


class Worn(Table):
    """The flow of `glapp plant` with a gap of 1.5 %: one person enables compensation, another repairs the valve."""

    def __init__(self, clock: Clock) -> None:
        super().__init__(clock=clock)
        self.time = clock
        self.sim = SimLoop(0, kinds(SCAN)[0], SCAN, seed=1)
        self.monitor: Monitor
        self.found: list[dict[str, Any]] = []

    async def run(self, take: Callable[[Sequence[Value]], None], tell: Callable[[Event], None]) -> None:
        for scan in range(700):
            if scan == WIDTH:
                await seen(self.monitor, "FIC101", comp_size=1.5, comp_share=1.0)
            if scan == ENABLED:
                await self.monitor.commands.enable("FIC101", "eve", "engineer")
            self.time.now += SCAN
            scan_values = self.sim.scan(40.0 if scan < REPAIRED else 0.0, self.u_ff.get("FIC101", 0.0))
            scan_values[Signal.U_FF] = self.u_ff.get("FIC101", 0.0)
            self.heard = self.time.now
            take([Value("FIC101", signal, self.time.now, float(x), True) for signal, x in scan_values.items()])
            await self.monitor.feedforward.caught_up(self.time.now)
            self.found.append({**self.monitor.status()["loops"]["FIC101"]["compensation"], "made": self._made()})

    def _made(self) -> bool:
        return self.monitor.loops["FIC101"].u_ff_time == self.time.now


@pytest.mark.slow
def test_what_was_right_is_too_much_after_a_repair_and_is_warned_of_and_withdrawn(tmp_path: Path) -> None:
    clock = Clock()
    plant = Worn(clock)
    loop = Loop(name="FIC101", controller={"k": 0.6, "ti": 6 * SCAN}, process={"kp": 1}, op_span=(0, 100))
    most = {"FIC101": (3.0, 1000.0)}
    monitor = plant.monitor = Monitor(
        [loop], Store(tmp_path), options=OPTIONS, compensable=most, clock=clock, hurries=True
    )
    asyncio.run(monitor.run(plant))
    monitor.store.close()
    assert not any(one["made"] for one in plant.found[:WIDTH]), "before there is a width nothing waits"
    assert all(one["made"] for one in plant.found[WIDTH + 1 :]), "then every scan has the u_FF that was made of it"
    worn, repaired = plant.found[ENABLED + 1 : REPAIRED], plant.found[REPAIRED:]
    assert all(one["enabled"] for one in worn)
    assert any(abs(one["u_ff"]) > 0.59 for one in worn)
    off = next(k for k, one in enumerate(repaired) if not one["enabled"])
    assert {round(one["u_ff"], 6) for one in repaired[:off]} >= {-0.6, 0.6}, "the valve is driven to and fro"
    assert repaired[off]["withdrawn"] == "over_compensated"
    assert [one["u_ff"] for one in repaired[off + 10 :]] == [0.0] * len(repaired[off + 10 :])
    assert plant.u_ff["FIC101"] == 0.0, "and so it stands in the plant"
    [event] = [event for event in monitor.reader.events("FIC101") if event["kind"] == "withdrawn"]
    assert event["text"] == "Withdrawn: the loop swings as if too much was compensated."


@pytest.mark.slow
def test_a_plant_that_hurries_waits_for_every_u_ff(tmp_path: Path) -> None:
    """Tested by OPC UA: without waiting the plant would be hundreds of scans ahead when u_FF is there, and enabling be
    refused.
    """
    found: list[tuple[float, float, str]] = []
    written: list[float] = []

    async def run() -> None:
        async with SimPlant(1, scan=SCAN, begin=30.0, speed=20_000.0, watchdog=2.0, ramp=0.5) as plant:
            known = parse_settings(plant.settings(), "loops.toml", tmp_path)
            given = {"interval": 0.01, "samples": 10_000, "watchdog": f"nsu={NAMESPACE};s=Watchdog"}
            most = {"FIC101": (3.0, 1000.0)}
            now = {"clock": lambda: plant.time, "hurries": True}
            monitor = Monitor(known, Store(tmp_path), options=OPTIONS, compensable=most, **now)
            one = monitor.loops["FIC101"]

            async def follow(moment: float) -> None:
                await monitor.feedforward.caught_up(moment)
                made = one.compensator
                assert made is not None
                found.append((moment, one.u_ff_time, made.standing if made.enabled else ""))
                written.append(plant.u_ff("FIC101"))

            plant.follow = follow
            task = asyncio.create_task(monitor.run(OpcUa(Connection(url=plant.url, **given), known)))
            try:
                async with asyncio.timeout(120):
                    while Signal.PV not in one.latest or len(found) < 50:
                        await asyncio.sleep(0.01)
                    await seen(monitor, "FIC101", comp_size=2.0)
                    begin = len(found)
                    while len(found) < begin + 20:
                        await asyncio.sleep(0.01)
                    shown = await monitor.commands.enable("FIC101", "eve", "engineer")
                    assert shown["delay"] < SCAN
                    plant._loops["FIC101"].graph["sp.value"] = 60.0  # so that OP turns
                    while sum(bool(standing) for _, _, standing in found) < 150:
                        await asyncio.sleep(0.01)
            finally:
                task.cancel()
                await asyncio.gather(task, return_exceptions=True)
                monitor.store.close()

    asyncio.run(run())
    assert all(made == -math.inf for _, made, _ in found[:50])
    in_force = [(moment, made) for moment, made, standing in found if standing]
    assert len(in_force) >= 150 and all(moment == made for moment, made in in_force)
    assert {standing for _, _, standing in found} <= {"", "waiting", "active"}, "by its own clock all is fresh"
    assert max(map(abs, written)) == pytest.approx(0.6), (
        "and u_FF stands in the plant: 0.8 of 2 %, less the band, half of it"
    )
