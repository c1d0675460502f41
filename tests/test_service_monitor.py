"""The monitor beside a plant: u_FF only by name and only while all is well; fits beside it; commands put down."""

import asyncio
import itertools
import math
import multiprocessing
import sqlite3
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import service
from service import BEGIN, Clock, Table, fed, loops, values

from glapp import Loop
from glapp.errors import InputError
from glapp.service import compensation as of_compensation
from glapp.service import watchdog
from glapp.service.journal import Journal
from glapp.service.monitor import Monitor
from glapp.service.options import MonitorOptions
from glapp.service.settable import with_settings
from glapp.service.signal import Event, Signal, Value
from glapp.service.store import Reader, Store, backup, restore
from glapp.service.watchdog import WATCHDOG_SEEN

PERIOD = 0.02
WIDTH = 1.5
SIZED = {"comp_size": WIDTH, "comp_release": 0.5}
MOST = (3.0, 50.0)


async def after_watchdog_test(monitor: Monitor) -> None:
    """A state as after a watchdog test."""
    await monitor.journal.log("eve", "engineer", "drilled", "FIC0", None, None, settings={WATCHDOG_SEEN: {}})


class Swinging(Table):
    """A plant whose OP goes back and forth, with the u_FF in it that was written; it runs in real time."""

    mode = 1.0
    good = True
    silent = False
    lives = False  # whether the connection does, while it is silent
    told: Callable[[Event], None] = staticmethod(lambda event: None)

    async def run(self, take: Callable[[Sequence[Value]], None], tell: Callable[[Event], None]) -> None:
        self.told = tell
        k = 0
        while True:
            if not self.silent:
                self.heard = time.time()
                take(self.scan(k, self.heard))
                k += 1
            elif self.lives:
                self.heard = time.time()
            await asyncio.sleep(PERIOD)

    def scan(self, k: int, t: float) -> list[Value]:
        swing = (k % 20) * 0.2
        op = 50.0 + (swing if swing < 2.0 else 4.0 - swing) + self.u_ff.get("FIC0", 0.0)
        pv = 49.0 if swing < 2.0 else 51.0
        found = {
            Signal.SP: 50.0,
            Signal.OP: op,
            Signal.MODE: self.mode,
            Signal.U_FF: self.u_ff.get("FIC0", 0.0),
            Signal.PV: pv if self.good else math.nan,
        }
        return [Value("FIC0", s, t, x, x == x, "" if x == x else "BadSensorFailure") for s, x in found.items()]

    async def read_back(self, loop: str) -> Value:
        return Value(loop, Signal.U_FF, time.time(), self.u_ff.get(loop, 0.0), True)


def swinging(ti: float) -> Loop:
    controller = {"k": 0.5, "ti": ti}
    return Loop(name="FIC0", controller=controller, process={"kp": 2}, op_span=(0, 100), n=3, sample_time=PERIOD)


def beside(
    folder: Path,
    what: Callable[[Monitor, Swinging], Awaitable[None]],
    plant: Swinging | None = None,
    *,
    seen: bool = True,
    ti: float = 2.5,
    **options: float,
) -> Monitor:
    """Runs a monitor beside the plant while `what` is done.

    Ti is a hundred scans and more, so that u_FF does not come too late where this machine is slow.
    """
    made: list[Monitor] = []

    async def go() -> None:
        source = plant or Swinging()
        monitor = Monitor(
            [swinging(ti)],
            Store(folder),
            options=MonitorOptions(step=0.1, wait=0.0, **options),
            compensable={"FIC0": MOST},
        )
        made.append(monitor)
        task = asyncio.create_task(monitor.run(source))
        try:
            await until(lambda: Signal.PV in monitor.loops["FIC0"].latest, "no value came")
            if seen:
                await after_watchdog_test(monitor)
            await asyncio.wait_for(what(monitor, source), 300)
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            await monitor.step()
            monitor.store.close()

    asyncio.run(go())
    return made[0]


async def until(true: Callable[[], bool], why: str) -> None:
    """Wait for something, for two minutes at most: a machine may be slow."""
    end = time.monotonic() + 120.0
    while not true():
        assert time.monotonic() < end, why
        await asyncio.sleep(0.01)


async def in_force(monitor: Monitor, plant: Swinging) -> None:
    """Enabled by name, and u_FF is not 0."""
    await monitor.commands.change("FIC0", SIZED, "eve", "engineer")
    shown = await monitor.commands.enable("FIC0", "eve", "engineer")
    assert shown["enabled"] and shown["standing"] == "waiting"  # it said "not_enabled" until the next scan
    await until(lambda: abs(plant.u_ff.get("FIC0", 0.0)) > 0.3, f"u_FF never came: {monitor.status()}")


def shown(monitor: Monitor) -> dict[str, object]:
    found: dict[str, object] = monitor.status()["loops"]["FIC0"]["compensation"]
    return found


@pytest.mark.slow
def test_nothing_is_written_until_it_is_enabled_by_name(tmp_path: Path) -> None:
    async def look(monitor: Monitor, plant: Swinging) -> None:
        with pytest.raises(InputError, match="no width is given"):
            await monitor.commands.enable("FIC0", "eve", "engineer")
        await monitor.commands.change("FIC0", SIZED, "eve", "engineer")
        await asyncio.sleep(0.2)
        assert all(u_ff == 0.0 for _, u_ff in plant.writes) and not plant.may
        await monitor.commands.enable("FIC0", "eve", "engineer")
        await until(lambda: abs(plant.u_ff["FIC0"]) > 0.3, "u_FF never came")
        assert max(abs(u_ff) for _, u_ff in plant.writes) <= WIDTH / 2

    monitor = beside(tmp_path, look)
    found = {(row["person"], row["command"], row["refused"]) for row in monitor.reader.commands()}
    assert found >= {("eve", "change", None), ("eve", "enable", None)}


@pytest.mark.slow
def test_it_is_0_when_it_is_disabled_and_when_the_service_ends(tmp_path: Path) -> None:
    plant = Swinging()

    async def look(monitor: Monitor, plant: Swinging) -> None:
        await in_force(monitor, plant)
        await monitor.commands.disable("FIC0", "olaf", "operator")
        await until(lambda: plant.u_ff["FIC0"] == 0.0, "it was not taken away")
        assert shown(monitor)["why_off"] == "olaf disabled it" and not plant.may
        await in_force(monitor, plant)

    beside(tmp_path, look, plant)
    assert plant.u_ff["FIC0"] == 0.0, "the end of the service took it away"


@pytest.mark.slow
@pytest.mark.parametrize("how", ["manual", "bad"])
def test_it_is_0_out_of_automatic_and_in_bad_quality(tmp_path: Path, how: str) -> None:
    async def look(monitor: Monitor, plant: Swinging) -> None:
        await in_force(monitor, plant)
        if how == "manual":
            plant.mode = 0.0
        else:
            plant.good = False
        await until(lambda: plant.u_ff["FIC0"] == 0.0, "it was not taken away")
        assert shown(monitor)["standing"] == {"manual": "not_auto", "bad": "bad_quality"}[how]

    beside(tmp_path, look)


@pytest.mark.slow
def test_a_pv_that_comes_no_more_ends_it_though_the_connection_lives(tmp_path: Path) -> None:
    """Regression: PV was taken as standing still, and u_FF stood with it."""

    async def look(monitor: Monitor, plant: Swinging) -> None:
        await in_force(monitor, plant)
        plant.silent = plant.lives = True
        await until(lambda: not shown(monitor)["enabled"], "it is still enabled")
        assert str(shown(monitor)["why_off"]).startswith("no PV came for")
        await until(lambda: plant.u_ff["FIC0"] == 0.0, "it was not taken away")
        plant.silent = False
        await asyncio.sleep(0.3)
        assert plant.u_ff["FIC0"] == 0.0, "nobody pressed again"

    monitor = beside(tmp_path, look)
    assert "withdrawn" in [event["kind"] for event in monitor.reader.events("FIC0")]


@pytest.mark.slow
def test_a_lost_connection_ends_it_and_what_is_found_afterwards_goes_to_0(tmp_path: Path) -> None:
    async def look(monitor: Monitor, plant: Swinging) -> None:
        await in_force(monitor, plant)
        plant.silent = True
        plant.told(Event(time.time(), None, "lost", "the server is gone"))
        left = plant.u_ff["FIC0"]
        assert not shown(monitor)["enabled"] and not plant.may
        await asyncio.sleep(0.1)
        plant.u_ff["FIC0"] = left or 0.4
        plant.silent = False
        await until(lambda: plant.u_ff["FIC0"] == 0.0, "what was found was not taken away")
        await asyncio.sleep(0.5)
        assert plant.u_ff["FIC0"] == 0.0 and not shown(monitor)["enabled"], "nobody pressed again"

    monitor = beside(tmp_path, look)
    texts = {event["kind"]: event["text"] for event in monitor.reader.events("FIC0")}
    assert texts["withdrawn"] == "the connection to the plant was lost"


@pytest.mark.slow
def test_after_a_restart_it_is_off_and_what_is_found_is_ramped_to_0(tmp_path: Path) -> None:
    async def leave(monitor: Monitor, plant: Swinging) -> None:
        await in_force(monitor, plant)

    beside(tmp_path, leave)
    with closing(sqlite3.connect(tmp_path / "glapp.db")) as db, db:  # a kill leaves no time to write that it ended
        db.execute("DELETE FROM events WHERE kind = 'withdrawn'")
    plant = Swinging(u_ff={"FIC0": 0.6})

    async def look(monitor: Monitor, plant: Swinging) -> None:
        # Regression: an event said that it was enabled, and none that it was so no more.
        assert str(shown(monitor)["why_off"]).startswith("the service was killed")
        await until(lambda: plant.u_ff["FIC0"] == 0.0, "what was found was not taken away")
        ramp = [u_ff for _, u_ff in plant.writes]
        assert len(ramp) > 5 and ramp == sorted(ramp, reverse=True) and ramp[0] > 0.4, "a ramp, not a step"
        assert not shown(monitor)["enabled"]
        await asyncio.sleep(0.3)
        assert plant.u_ff["FIC0"] == 0.0

    beside(tmp_path, look, plant)


@pytest.mark.slow
def test_what_was_restored_is_not_in_force(tmp_path: Path) -> None:
    """A copy of the database, taken while u_FF was in force: nobody has pressed since."""
    folder, copy = tmp_path / "data", tmp_path / "copy.db"

    async def leave(monitor: Monitor, plant: Swinging) -> None:
        await in_force(monitor, plant)
        await monitor.save()
        await asyncio.to_thread(backup, folder, copy)

    beside(folder, leave)
    restore(folder, copy)
    plant = Swinging(u_ff={"FIC0": 0.6})

    async def look(monitor: Monitor, plant: Swinging) -> None:
        assert not shown(monitor)["enabled"] and not plant.may
        assert monitor.commands.settings("FIC0")["comp_size"] == WIDTH, "what was set is there"
        await until(lambda: plant.u_ff["FIC0"] == 0.0, "what was found was not taken away")
        assert not shown(monitor)["enabled"] and not plant.may

    beside(folder, look, plant, seen=False)
    assert max(u_ff for _, u_ff in plant.writes) < 0.6


@pytest.mark.slow
@pytest.mark.parametrize("killed", [False, True], ids=["stopped", "killed before its first save"])
def test_what_has_not_changed_is_not_told_again_and_known_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, killed: bool
) -> None:
    """A server tells SP, mode and u_FF when they change; after a restart they are those of before, and u_FF is read."""

    async def nothing(journal: Journal) -> None:
        """State left by a kill: the entries, and no state."""

    class Sparing(Swinging):
        sent: dict[Signal, float]

        def scan(self, k: int, t: float) -> list[Value]:
            found = super().scan(k, t)
            fresh = [v for v in found if v.signal in (Signal.PV, Signal.OP) or self.sent.get(v.signal) != v.value]
            self.sent |= {value.signal: value.value for value in found}
            return fresh

    plant = Sparing()
    plant.sent = {}
    with monkeypatch.context() as patched:
        if killed:
            patched.setattr(Journal, "_save", nothing)
        beside(tmp_path, in_force, plant)
    plant.u_ff["FIC0"] = plant.sent[Signal.U_FF] = 0.6  # it stands there, and nobody tells

    async def look(monitor: Monitor, plant: Swinging) -> None:
        await until(lambda: plant.u_ff["FIC0"] == 0.0, "what was found was not taken away")
        await in_force(monitor, plant)

    plant.writes.clear()
    beside(tmp_path, look, plant)
    assert 0.4 < plant.writes[0][1] < 0.6


@pytest.mark.parametrize("mode", [0.0, 1.0])
def test_what_changed_just_before_a_kill_is_known_after_it(tmp_path: Path, mode: float) -> None:
    """A mode that changed in the last seconds counts, though its sample still waits for what may come late.

    Regression: the server was not asked for it again, and the mode before it held until the next change.
    """
    clock = Clock()
    first = service.monitor(tmp_path, loops(), clock)
    before, changed = (Value("FIC0", Signal.MODE, BEGIN + t, x, True) for t, x in ((0.0, 1.0 - mode), (99.5, mode)))
    fed(first, clock, [before, changed, *(v for v in values("FIC0", 100) if v.signal is not Signal.MODE)])
    first.store.close()
    again = service.monitor(tmp_path, loops(), clock)
    assert again.ingest.since()["FIC0", Signal.MODE] == changed.time, "it is not told again"
    assert again.ingest.live("FIC0")["mode"]["value"] == mode
    again.store.close()


@pytest.mark.slow
def test_u_ff_comes_where_a_scan_asks_for_more_than_the_plant_takes_at_once(tmp_path: Path) -> None:
    """Regression: it was refused as too fast, had farther to go at the next scan, and was refused there, too.

    A busy computer has such scans one after the other: u_FF stayed 0, and was withdrawn as not followed.
    """
    pytest.importorskip("asyncua")
    from asyncua import ua

    from glapp.service.opcua_events import EventFilter
    from glapp.service.opcua_u_ff import UffNodes

    class Node:
        """A client with one node."""

        value = 0.0

        @property
        def uaclient(self) -> Any:
            return self

        async def read_attributes(self, nodes: Any, attribute: Any) -> list[Any]:
            return [ua.DataValue(ua.Variant(self.value, ua.VariantType.Double))]

        async def write_attributes(self, nodes: Any, values: Any, attribute: Any) -> list[Any]:
            self.value = values[0].Value.Value
            return [ua.StatusCode(ua.StatusCodes.Good)]

    class Limited(Swinging):
        """A plant that counts the rate over an eighth of a scan."""

        def __init__(self) -> None:
            super().__init__()
            limits = {"u_ff": "ns=2;s=FIC0.U_FF", "u_ff_limit": MOST[0], "u_ff_rate": MOST[1]}
            loop = Loop(name="FIC0", opcua={"pv": "ns=2;s=FIC0.PV", "sp": "ns=2;s=FIC0.SP"} | limits)
            self.nodes = UffNodes([loop], PERIOD / 8.0, EventFilter())
            self.nodes.client, self.nodes.nodes["FIC0"].node = Node(), ua.NodeId("FIC0.U_FF", 2)
            self.enable, self.disable = self.nodes.enable, self.nodes.disable

        async def write(self, loop: str, u_ff: float) -> None:
            await self.nodes.write(loop, u_ff)
            self.u_ff[loop] = u_ff
            self.writes.append((loop, u_ff))

    plant = Limited()
    beside(tmp_path, in_force, plant)
    written = [u_ff for _, u_ff in plant.writes]
    at_once = 2.0 * MOST[1] * PERIOD / 8.0
    grown = [abs(b - a) for a, b in itertools.pairwise(written) if abs(b) > abs(a)]
    assert max(grown) <= at_once < 0.02 * 0.6 * MOST[1]


@pytest.mark.slow
def test_another_writer_withdraws_it(tmp_path: Path) -> None:
    class Counts(Swinging):
        tried = 0

        async def write(self, loop: str, u_ff: float) -> None:
            self.tried += 1
            await super().write(loop, u_ff)

    plant = Counts()

    async def look(monitor: Monitor, _: Swinging) -> None:
        await in_force(monitor, plant)
        plant.refuse = "other_writer"
        await until(lambda: not shown(monitor)["enabled"], "it goes on")
        assert "other_writer" in str(shown(monitor)["why_off"])
        plant.u_ff["FIC0"] = 0.0
        await until(lambda: not monitor.feedforward.at_work, "something is to be written still")
        await asyncio.sleep(0.2)
        tried = plant.tried
        await asyncio.sleep(0.5)
        assert plant.tried == tried, "u_FF is 0, and a write was tried at every PV for ever"
        plant.refuse = None

    beside(tmp_path, look, plant)


@pytest.mark.slow
def test_the_watchdog_hears_of_us_only_while_u_ff_is_fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "_HEARTBEAT", 0.05)

    async def look(monitor: Monitor, plant: Swinging) -> None:
        await until(lambda: plant.heartbeats >= 1, "no heartbeat without compensation")
        await in_force(monitor, plant)
        before = plant.heartbeats
        await until(lambda: plant.heartbeats > before, "no heartbeat with it")
        await until(lambda: abs(plant.u_ff["FIC0"]) > 0.3, "u_FF never came")
        plant.refuse = "not_connected"  # u_FF stands in the plant, and cannot be taken away
        await asyncio.sleep(0.3)
        before = plant.heartbeats
        await asyncio.sleep(0.5)
        assert plant.heartbeats == before, "the plant has to take it away by itself"
        plant.refuse = None

    beside(tmp_path, look)


@pytest.mark.slow
def test_a_u_ff_that_the_plant_keeps_stops_the_watchdog_and_every_loop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watchdog, "_HEARTBEAT", 0.05)
    monkeypatch.setattr(of_compensation, "LATE", 0.3)

    class Keeps(Swinging):
        keeps = False

        async def write(self, loop: str, u_ff: float) -> None:
            await super().write(loop, self.u_ff.get(loop, 0.0) if self.keeps else u_ff)

    async def look(monitor: Monitor, plant: Swinging) -> None:
        assert isinstance(plant, Keeps)
        await in_force(monitor, plant)
        plant.keeps = True  # it confirms every write, and does none of them
        await monitor.commands.disable("FIC0", "olaf", "operator")
        before = plant.heartbeats
        await until(lambda: monitor.status()["loops"]["FIC0"]["health"] == "FAILURE", "nobody saw it")
        assert plant.heartbeats > before, "so long the watchdog heard of us"
        before = plant.heartbeats
        await asyncio.sleep(0.5)
        assert plant.heartbeats == before, "the plant has to take it away by itself"
        with pytest.raises(
            InputError, match=r"u_FF of FIC0 is not 0 in the plant, .* set it to 0 in the control system"
        ):
            await monitor.commands.enable("FIC0", "eve", "engineer")
        assert plant.heartbeats == before, "nor does who tries to enable count it up"
        plant.u_ff["FIC0"] = 0.0
        await until(lambda: monitor.status()["loops"]["FIC0"]["health"] == "NORMAL", "it is 0 by now")
        await until(lambda: plant.heartbeats > before, "the watchdog hears of us again")

    monitor = beside(tmp_path, look, Keeps())
    with Reader(tmp_path) as reader:
        events = {row["kind"]: row["text"] for row in reader.events("FIC0")}
    assert "had to be 0 within" in events["not_taken_away"] and "of every loop" in events["not_taken_away"]
    assert "counted up again" in events["taken_away"]
    assert monitor.status()["loops"]["FIC0"]["compensation"]["u_ff"] == 0.0


def test_while_it_is_off_nothing_goes_to_the_plant_that_is_farther_from_0_than_what_stands_there() -> None:
    """Writes that come late leave less in the plant than was made; what was refused stopped every loop's watchdog."""
    for found, made, to in ((0.4, 0.5, 0.4), (0.4, 0.3, 0.3), (-0.4, 0.5, 0.0), (0.0, 0.5, 0.0), (0.4, -0.3, 0.0)):
        one = of_compensation.Compensator(swinging(2.5), PERIOD, SIZED | {"comp_release": 25.0}, *MOST)
        one._graph.scan(h=PERIOD, sp=50.0, pv=50.0, op=50.0, u_ff=made, flags=0.0)
        one._held[Signal.U_FF] = Value("FIC0", Signal.U_FF, 2.0, found, True)
        assert one.u_ff == pytest.approx(made, abs=0.01), "the block goes on from there"
        assert one.to_write == pytest.approx(to, abs=0.01), (found, made, one.u_ff)


def one_beside_an_enabled(
    folder: Path,
) -> tuple[Monitor, of_compensation.Compensator, of_compensation.Compensator]:
    """Two loops on one watchdog: one whose u_FF is read back, and one that is compensated."""
    both = [swinging(2.5), swinging(2.5).model_copy(update={"name": "FIC1"})]
    monitor = Monitor(both, Store(folder), compensable={"FIC0": MOST, "FIC1": MOST})
    one, other = (monitor.loops[name].compensator for name in ("FIC0", "FIC1"))
    assert one is not None and other is not None
    other._graph["watch.compensate"] = 1.0
    one.read_back = True
    return monitor, one, other


def test_where_one_u_ff_stands_every_other_is_withdrawn(tmp_path: Path) -> None:
    """All loops share one watchdog."""
    monitor, one, other = one_beside_an_enabled(tmp_path)
    one.take(Value("FIC0", Signal.U_FF, 1.0, 0.5, True), 1.0)
    one.scan(0.0, True)
    monitor.watchdog.look_for_stuck(one.away_within + 3.0 * PERIOD + of_compensation.LATE - 0.1)
    assert other.enabled and not monitor.watchdog.stuck, "it is on its way"
    monitor.watchdog.look_for_stuck(one.away_within + 3.0 * PERIOD + of_compensation.LATE + 0.1)
    assert not other.enabled and other.why_off == "the watchdog is not counted up: u_FF of FIC0 is not 0"
    assert [monitor.status()["loops"][name]["health"] for name in ("FIC0", "FIC1")] == ["FAILURE", "CHECK_FUNCTION"]
    monitor.store.close()


def test_a_u_ff_that_somebody_writes_where_nothing_is_in_force_is_ramped_to_0() -> None:
    """Regression: only what was found at the start or after a loss was ramped; this went to 0 in one step."""
    one = of_compensation.Compensator(swinging(2.5), PERIOD, SIZED, *MOST)
    one.read_back, u_ff, stood = True, 0.0, []
    for k in range(150):
        at, u_ff = k * PERIOD, 0.6 if k == 50 else u_ff
        now = {Signal.SP: 50.0, Signal.MODE: 1.0, Signal.OP: 50.0, Signal.U_FF: u_ff, Signal.PV: 50.0}
        for signal, value in now.items():
            one.take(Value("FIC0", signal, at, value, True), at)
        one.scan(at, True)
        if one.at_work:
            u_ff = one.to_write
            one.wrote(u_ff, at, 0.001)
        stood.append(u_ff)
    steps = [b - a for a, b in itertools.pairwise(stood[50:])]
    assert stood[:50] == [0.0] * 50 and 0.5 < stood[50] < 0.6 and stood[-1] == 0.0
    assert all(-0.03 < step <= 0.0 for step in steps), "a ramp of half a second"
    assert not one.at_work and not one.enabled


def test_a_u_ff_that_somebody_writes_by_hand_has_time_to_go_from_then_on(tmp_path: Path) -> None:
    """Regression: an hour after the last u_FF it counted as not taken away at once, and every other loop was off."""
    monitor, one, other = one_beside_an_enabled(tmp_path)
    for at, u_ff in ((0.0, 0.0), (3600.0, 0.0), (3600.1, 0.5)):
        one.take(Value("FIC0", Signal.U_FF, at, u_ff, True), at)
        one.scan(at, True)
    late = one.away_within + 3.0 * PERIOD + of_compensation.LATE
    monitor.watchdog.look_for_stuck(3600.0 + late)
    assert other.enabled and not monitor.watchdog.stuck
    monitor.watchdog.look_for_stuck(3600.2 + late)
    assert not other.enabled and monitor.watchdog.stuck == ["FIC0"]
    monitor.store.close()


def test_enabling_is_refused_where_u_ff_comes_too_late(tmp_path: Path) -> None:
    class Slow(Swinging):
        async def write(self, loop: str, u_ff: float) -> None:
            await asyncio.sleep(0.15)  # of a Ti of 0.5 s
            await super().write(loop, u_ff)

    async def look(monitor: Monitor, plant: Swinging) -> None:
        await monitor.commands.change("FIC0", SIZED, "eve", "engineer")
        with pytest.raises(
            InputError, match=r"u_FF comes \d\.\d+ s late, (\d+ scans .*)?more than (the core|32 scans)"
        ):
            await monitor.commands.enable("FIC0", "eve", "engineer")
        assert not shown(monitor)["enabled"] and not plant.may

    beside(tmp_path, look, Slow(), ti=0.5)


@pytest.mark.slow
def test_a_plant_without_a_watchdog_is_not_compensated(tmp_path: Path) -> None:
    class Deaf(Swinging):
        async def heartbeat(self) -> None:
            from glapp.service.signal import WriteRefused

            raise WriteRefused("not_named", "no watchdog is named")

    async def look(monitor: Monitor, plant: Swinging) -> None:
        await monitor.commands.change("FIC0", SIZED, "eve", "engineer")
        with pytest.raises(InputError, match="no watchdog is named"):
            await monitor.commands.enable("FIC0", "eve", "engineer")
        assert not plant.may
        before = monitor.ingest.live("FIC0")["pv"]["time"]
        await asyncio.sleep(0.3)
        assert monitor.ingest.live("FIC0")["pv"]["time"] > before, "it goes on watching"

    beside(tmp_path, look, Deaf())


class Wired(Swinging):
    """A plant that takes u_FF away when nobody has counted its watchdog up for 1.5 s."""

    wired = True
    beaten = math.inf

    async def heartbeat(self) -> None:
        self.beaten = time.monotonic()

    def scan(self, k: int, t: float) -> list[Value]:
        if self.wired and time.monotonic() - self.beaten > 1.5:
            self.u_ff["FIC0"] = 0.0
        return super().scan(k, t)


@pytest.mark.slow
def test_no_loop_is_enabled_before_its_plant_was_seen_to_take_u_ff_away(tmp_path: Path) -> None:
    async def look(monitor: Monitor, plant: Swinging) -> None:
        await monitor.commands.change("FIC0", SIZED, "eve", "engineer")
        with pytest.raises(InputError, match=r"never seen .* glapp watch watchdog-test FIC0"):
            await monitor.commands.enable("FIC0", "eve", "engineer")
        await monitor.commands.watchdog_test("FIC0", "eve", "engineer")
        for going in (monitor.commands.watchdog_test, monitor.commands.enable):
            with pytest.raises(InputError, match=r"watchdog.test"):
                await going("FIC0", "eve", "engineer")
        await until(lambda: plant.u_ff.get("FIC0", 0.0) == pytest.approx(0.25), "nothing was written")
        await until(lambda: not monitor.watchdog.tests, "it does not end")
        assert plant.u_ff["FIC0"] == 0.0 and len(plant.writes) == 1
        assert not plant.may
        await in_force(monitor, plant)

    monitor = beside(tmp_path, look, Wired(), seen=False)
    kinds = [event["kind"] for event in monitor.reader.events("FIC0")]
    assert "drilled" in kinds and "enabled" in kinds


@pytest.mark.slow
def test_a_watchdog_test_that_fails(tmp_path: Path) -> None:
    async def look(monitor: Monitor, plant: Swinging) -> None:
        await monitor.commands.change("FIC0", SIZED, "eve", "engineer")
        await monitor.commands.watchdog_test("FIC0", "eve", "engineer")
        await until(lambda: not monitor.watchdog.tests, "it does not end")
        assert plant.u_ff["FIC0"] == 0.0, "we took it away ourselves"
        with pytest.raises(InputError, match="never seen"):
            await monitor.commands.enable("FIC0", "eve", "engineer")

    plant = Wired()
    plant.wired = False
    monitor = beside(tmp_path, look, plant, seen=False, watchdog_test=1.0)
    assert "drill_failed" in [event["kind"] for event in monitor.reader.events("FIC0")]


@pytest.mark.slow
def test_a_watchdog_test_into_which_somebody_writes_fails(tmp_path: Path) -> None:
    """Regression: it was passed though it was not our u_FF that the plant took away."""

    async def look(monitor: Monitor, plant: Swinging) -> None:
        await monitor.commands.change("FIC0", SIZED, "eve", "engineer")
        await monitor.commands.watchdog_test("FIC0", "eve", "engineer")
        await until(lambda: plant.u_ff.get("FIC0", 0.0) > 0.0, "the test wrote nothing")
        plant.u_ff["FIC0"] = 1.0
        await until(lambda: not monitor.watchdog.tests, "it does not end")
        with pytest.raises(InputError, match="never seen"):
            await monitor.commands.enable("FIC0", "eve", "engineer")

    monitor = beside(tmp_path, look, Wired(), seen=False)
    [text] = [event["text"] for event in monitor.reader.events("FIC0") if event["kind"] == "drill_failed"]
    assert text.startswith("u_FF is 1 where 0.") and text.endswith("was written: somebody else writes it")


@pytest.mark.slow
def test_an_answer_that_is_cancelled_with_its_connection_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A client that loses its connection cancels all that waits for an answer: that is not meant for us."""
    monkeypatch.setattr(watchdog, "_HEARTBEAT", 0.05)

    class Broken(Swinging):
        runs = 0

        async def run(self, take: Callable[[Sequence[Value]], None], tell: Callable[[Event], None]) -> None:
            self.runs += 1
            if self.runs == 1:
                raise asyncio.CancelledError
            await super().run(take, tell)

        async def heartbeat(self) -> None:
            self.heartbeats += 1
            if self.heartbeats < 3:
                raise asyncio.CancelledError

    async def look(monitor: Monitor, plant: Swinging) -> None:
        await until(lambda: plant.heartbeats >= 4 and monitor.ingest.live("FIC0") != {}, "it has ended")

    beside(tmp_path, look, Broken())


@pytest.mark.slow
def test_late_values_move_nothing(tmp_path: Path) -> None:
    async def look(monitor: Monitor, plant: Swinging) -> None:
        await in_force(monitor, plant)
        compensator = monitor.loops["FIC0"].compensator
        assert compensator is not None
        plant.silent = True
        await until(lambda: not compensator.fresh_pv, "the last PV was not used")
        monitor.ingest.take(plant.scan(7, time.time() - 100.0))
        assert not compensator.fresh_pv and not monitor.loops["FIC0"].pv_came.is_set()

    beside(tmp_path, look)


# Parameters


def test_parameters_are_changed_all_or_none_and_put_down(tmp_path: Path) -> None:
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(), clock)
    fed(monitor, clock, values("FIC0", 100))

    async def go() -> None:
        for name, value, bound in (
            ("n", 4, "odd"),
            ("tf", -1.0, "> 0"),
            ("k", 0.0, "and not 0"),
            ("x", 1, "no such"),
        ):
            with pytest.raises(InputError, match=bound):
                await monitor.commands.change("FIC0", {"kp": 3.0, name: value}, "eve", "engineer")
        assert monitor.commands.settings("FIC0")["kp"] == 2.0
        after = await monitor.commands.change("FIC0", {"kp": 3.0, "n": 5.0, "k": -0.7}, "eve", "engineer")
        assert (after["kp"], after["n"], after["k"], after["ti"]) == (3.0, 5, -0.7, 5.0)

    asyncio.run(go())
    [row] = monitor.reader.commands("FIC0")
    assert row["before"] == {"kp": 2.0, "n": 3, "k": 0.5} and row["after"] == {"kp": 3.0, "n": 5, "k": -0.7}
    assert (row["person"], row["role"], row["time"]) == ("eve", "engineer", clock.now)
    monitor.store.close()
    again = service.monitor(tmp_path, loops(), clock)
    assert again.commands.settings("FIC0")["k"] == -0.7, "it is kept"

    async def back() -> None:
        await again.commands.change("FIC0", {"k": None, "kp": None}, "eve", "engineer")

    asyncio.run(back())
    assert (again.commands.settings("FIC0")["k"], again.commands.settings("FIC0")["kp"]) == (0.5, 2.0), (
        "as in loops.toml"
    )


def test_settings_of_a_loop_without_a_controller() -> None:
    loop = Loop(name="F")
    with pytest.raises(InputError, match="ti: is required"):
        with_settings(loop, {"k": 2.0})
    assert with_settings(loop, {"k": -2.0, "ti": 30.0}).ideal() == (-2.0, 30.0, 0.0, 1.0)


@pytest.mark.parametrize("name", ["period", "step", "save", "wait", "keep", "fit_hour"])
def test_options(name: str) -> None:
    with pytest.raises(InputError, match=name):
        MonitorOptions(**{name: -1})


# Fits


@pytest.mark.verify
def test_a_fit_of_what_is_kept_is_asked_for_and_taken_over(tmp_path: Path) -> None:
    import numpy as np

    import glapp

    acting = {"setpoint": [(1, 1.0)], "load": [(50, 0.3), (100, -0.2)]}
    sim = glapp.simulate.closed_loop(
        "P3", (0.48, 0.3117, 0, 0), d=0.05, noise=0.005, h=0.1, t_end=200, seed=1, **acting, filter_in_loop=True
    )
    loop = Loop(name="P3", controller={"k": 0.48, "ti": 0.3117}, process={"kp": 1}, op_unit="%", sample_time=0.1)
    clock = Clock()
    monitor = Monitor(
        [loop], Store(tmp_path), options=MonitorOptions(wait=0.0), clock=clock, compensable={"P3": (1.0, 1.0)}
    )
    given = [
        Value("P3", signal, BEGIN + float(t), float(x), True)
        for name, signal in (("sp", Signal.SP), ("pv", Signal.PV), ("op", Signal.OP))
        for t, x in zip(sim.t, np.broadcast_to(getattr(sim, name), sim.t.shape), strict=True)
    ]
    fed(monitor, clock, given, pace=20.0)

    async def go() -> None:
        monitor.fits.ask("P3", "olaf")
        monitor.fits.ask("P3", "olaf")
        fits = asyncio.create_task(monitor.fits.run())
        while monitor.status()["loops"]["P3"]["fitting"]:
            await asyncio.sleep(0.1)
        fits.cancel()
        await asyncio.gather(fits, return_exceptions=True)
        [answer] = monitor.reader.answers("P3")
        assert (answer["verdict"], answer["asked_by"]) == ("backlash", "olaf")
        assert 0 < answer["low"] == answer["compensable"] < 0.05 < answer["high"]
        with pytest.raises(InputError, match="no such answer"):
            await monitor.commands.take_over("P3", answer["id"] + 1, "eve", "engineer")
        after = await monitor.commands.take_over("P3", answer["id"], "eve", "engineer")
        assert after["comp_fitted"] == answer["compensable"]

    asyncio.run(go())
    assert monitor.status()["loops"]["P3"]["health"] == "NORMAL", "a gap of 0.05 % is within the nominal limit of 1 %"
    direct = glapp.fit(t=sim.t, pv=sim.pv, op=sim.op, loop=loop)
    assert monitor.reader.answers("P3")[0]["d"] == pytest.approx(direct.d, rel=0.02)


@pytest.mark.slow
def test_a_fit_that_takes_too_long_is_ended_and_the_next_one_begins(tmp_path: Path) -> None:
    clock = Clock()
    monitor = Monitor(loops(2), Store(tmp_path), options=MonitorOptions(fit_longest=1e-6), clock=clock)
    fed(monitor, clock, values("FIC0", 400), pace=20.0)

    async def go() -> None:
        fits = asyncio.create_task(monitor.fits.run())
        for name, longest in (("FIC0", 1e-6), ("FIC1", 600.0)):
            monitor.fits.options = MonitorOptions(fit_longest=longest)
            monitor.fits.ask(name, "olaf")
            while monitor.status()["loops"][name]["fitting"]:
                await asyncio.sleep(0.05)
        fits.cancel()
        await asyncio.gather(fits, return_exceptions=True)
        await monitor.step()

    asyncio.run(go())
    events = {event["loop"]: event["text"] for event in monitor.reader.events() if event["kind"] == "not_fitted"}
    assert (
        events["FIC0"] == "it took more than 1e-06 s, and was ended" and "has no recording to fit yet" in events["FIC1"]
    )
    assert monitor.reader.answers("FIC0") == []
    monitor.store.close()


def test_what_is_asked_for_while_its_loop_is_fitted_is_fitted_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regression: a guided test or a repair during a fit of its loop asked for an answer that never came."""
    monitor = service.monitor(tmp_path, loops(), Clock())
    began = asyncio.Event()
    persons: list[str] = []

    async def fitted(name: str) -> dict[str, Any]:
        began.set()
        await asyncio.sleep(0)
        return {}

    async def keep(name: str, person: str, answer: dict[str, Any]) -> None:
        persons.append(person)

    monkeypatch.setattr(monitor.fits, "_fit", fitted)
    monkeypatch.setattr(monitor.fits, "keep_answer", keep)

    async def go() -> None:
        fits = asyncio.create_task(monitor.fits.run())
        monitor.fits.ask("FIC0", "olaf")
        await began.wait()
        for person in ("eve", "anna"):
            monitor.fits.ask("FIC0", person)
        while monitor.status()["loops"]["FIC0"]["fitting"]:
            await asyncio.sleep(0.01)
        fits.cancel()
        await asyncio.gather(fits, return_exceptions=True)

    asyncio.run(go())
    assert persons == ["olaf", "eve"], "one that waits already is not made twice"
    monitor.store.close()


@pytest.mark.slow
def test_a_fit_whose_process_is_killed_is_told_and_the_next_one_begins(tmp_path: Path) -> None:
    clock = Clock()
    monitor = Monitor(loops(2), Store(tmp_path), clock=clock)
    fed(monitor, clock, values("FIC0", 400), pace=20.0)

    async def go() -> None:
        fits = asyncio.create_task(monitor.fits.run())
        monitor.fits.ask("FIC0", "olaf")
        monitor.fits.ask("FIC1", "olaf")
        while not (children := multiprocessing.active_children()):
            await asyncio.sleep(0.01)
        children[0].kill()  # as a system does that has no more memory
        while any(monitor.status()["loops"][name]["fitting"] for name in ("FIC0", "FIC1")):
            await asyncio.sleep(0.05)
        fits.cancel()
        await asyncio.gather(fits, return_exceptions=True)
        await monitor.step()

    asyncio.run(go())
    events = {event["loop"]: event["text"] for event in monitor.reader.events() if event["kind"] == "not_fitted"}
    assert events["FIC0"] == "its process was ended" and "has no recording to fit yet" in events["FIC1"]
    monitor.store.close()


@pytest.mark.slow
def test_nights_go_by_the_clock_of_the_watch(tmp_path: Path) -> None:
    """Regression: a night of a fast plant is over in seconds, and the clock on the wall was waited for."""
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(2), clock)

    async def go() -> list[str]:
        nights = asyncio.create_task(monitor.fits._nights())
        await asyncio.sleep(0.1)
        assert monitor.fits._queue.empty()
        clock.now += 86_400.0
        found = [(await asyncio.wait_for(monitor.fits._queue.get(), 30))[0] for _ in range(2)]
        nights.cancel()
        await asyncio.gather(nights, return_exceptions=True)
        return found

    assert sorted(asyncio.run(go())) == ["FIC0", "FIC1"]
    monitor.store.close()


@pytest.mark.slow
def test_a_fit_under_way_ends_with_the_service(tmp_path: Path) -> None:
    """Regression: the fit was waited for, however long it took."""

    async def look(monitor: Monitor, plant: Swinging) -> None:
        monitor.fits.ask("FIC0", "olaf")
        while not multiprocessing.active_children():
            await asyncio.sleep(0.01)

    beside(tmp_path, look)
    assert not multiprocessing.active_children()


def test_each_missing_tag_is_told_and_known_until_its_value_comes(tmp_path: Path) -> None:
    """Regression: of several tags of one loop that the server does not have only the first was named."""
    clock, said = Clock(), []
    store = Store(tmp_path)
    monitor = Monitor(loops(), store, clock=clock, say=said.append)
    for signal in (Signal.PV, Signal.OP, Signal.OP):
        monitor.tell(Event(clock.now, "FIC0", "tag_missing", f"FIC0 {signal.name}: no such node", signal))
    asyncio.run(monitor.step())
    told = [event["text"] for event in monitor.reader.events("FIC0")]
    assert sorted(told) == ["FIC0 OP: no such node", "FIC0 PV: no such node"]
    assert sorted(event.text for event in said) == sorted(told), "the terminal hears the same"
    assert monitor.status()["loops"]["FIC0"]["missing"] == "FIC0 PV: no such node"
    monitor.ingest.take([Value("FIC0", Signal.PV, clock.now - 5.0, 50.0, True)])
    status = monitor.status()["loops"]["FIC0"]
    assert (
        status["missing"] == "FIC0 OP: no such node" and status["health"] == "CHECK_FUNCTION" and status["age"] == 5.0
    )
    monitor.ingest.take([Value("FIC0", Signal.OP, clock.now, 50.0, True)])
    status = monitor.status()["loops"]["FIC0"]
    assert status["missing"] is None and status["health"] == "NORMAL"
    store.close()


def test_the_status_says_why_the_plant_is_not_connected(tmp_path: Path) -> None:
    monitor = service.monitor(tmp_path, loops(), Clock())
    assert monitor.status()["unconnected"] is None
    monitor.tell(Event(BEGIN, None, "lost", "opc.tcp://p: nobody listens there"))
    assert monitor.status()["unconnected"] == "opc.tcp://p: nobody listens there"
    monitor.tell(Event(BEGIN, None, "connected", "opc.tcp://p: connected"))
    assert monitor.status()["unconnected"] is None
