"""The connection to a plant by OPC UA, against the simulated plant on this machine: every fault, and its event."""

import asyncio
import contextlib
import dataclasses
import math
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("asyncua", reason="the extra [opcua] is not installed")

import itertools

from asyncua import Client, ua
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

import glapp.cli
from glapp.errors import InputError
from glapp.loop import Loop, Tags
from glapp.reading.settings import parse_settings, read_settings
from glapp.service import opcua, opcua_client, opcua_u_ff, opcua_values
from glapp.service.connection import Connection, check_tags, read_connection
from glapp.service.opcua import OpcUa, browse
from glapp.service.opcua_events import EventFilter
from glapp.service.opcua_u_ff import UffNodes
from glapp.service.opcua_values import span_of, unit_of
from glapp.service.plant import FAULTS, NAMESPACE, Security, SimPlant, free_port
from glapp.service.signal import Signal, WriteRefused
from glapp.service.tags import as_settings, loops_of, ranges_of

ROOT = Path(__file__).parents[1]
GLAPP = (sys.executable, Path(__file__).parent / "command_line.py")
pytestmark = pytest.mark.usefixtures("impatient")


def served(test):
    """A test with the plant that many share: slow, and with the others in one process."""
    return pytest.mark.slow(pytest.mark.xdist_group("plant")(test))


class Watch:
    """A source that runs beside the test, with its values and events."""

    def __init__(self, plant, since=None, loops=None, **connection):
        self.loops = loops or parse_settings(plant.settings(), "loops.toml", Path())
        given = {"interval": 0.1, "timeout": 10.0, "watchdog": node("Watchdog"), **connection}
        self.source = OpcUa(Connection(url=plant.url, **given), self.loops, since=since)
        self.values, self.events = [], []

    async def __aenter__(self):
        self.task = asyncio.create_task(self.source.run(self.values.extend, self.events.append))
        return self

    async def __aexit__(self, *error):
        self.task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self.task

    def of(self, loop, which=Signal.PV):
        return [v for v in self.values if v.loop == loop and v.signal is which]

    def texts(self, kind, loop=None):
        return [e.text for e in self.events if e.kind == kind and (loop is None or e.loop == loop)]

    async def until(self, condition, seconds=120.0):
        """Wait for something, at most so long: a machine may be slow."""
        end = time.monotonic() + seconds
        while not condition():
            assert not self.task.done(), self.task
            assert time.monotonic() < end, self.events
            await asyncio.sleep(0.02)

    async def heard(self, loop, n, which=Signal.PV):
        have = len(self.of(loop, which))
        await self.until(lambda: len(self.of(loop, which)) >= have + n)


_PATIENT, _SHORT = 60.0, 0.5  # the plant's watchdog: while a machine may be slow, and where it has to run out [s]


@pytest.fixture(scope="module")
def shared():
    """Nine loops in a thread of their own, for all tests that leave them as they were; call it with a coroutine."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    def run(function, seconds=300.0):
        return asyncio.run_coroutine_threadsafe(function(plant), loop).result(seconds)

    async def start(_):
        await plant.__aenter__()

    async def stop(_):
        await plant.__aexit__(None, None, None)

    plant = SimPlant(9, scan=0.1, watchdog=_PATIENT, ramp=0.5)
    try:
        run(start)
        yield run
    finally:
        run(stop)
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


def node(identifier):
    return f"nsu={NAMESPACE};s={identifier}"


def ascending(values):
    return all(a.time < b.time for a, b in itertools.pairwise(values))


def gaps(values, scan):
    return [(a.time, b.time) for a, b in itertools.pairwise(values) if b.time - a.time > 1.5 * scan]


# ---------------------------------------------------------------- faults of values


@pytest.fixture(scope="module")
def faulty(shared):
    """Results of a monitor while each of eight loops has another fault for a while."""
    kinds = ["bad", "stuck", "future", "late", "duplicate", "type", "back", "silent"]

    async def run(plant):
        async with Watch(plant) as watch:
            await watch.heard("FIC101", 10)
            names = dict(zip(kinds, plant.names, strict=False))
            for kind, loop in names.items():
                plant.fault(kind, loop)
            begun = plant.time  # not ours: it may be behind
            await watch.heard("LIC109", 15)
            await watch.until(lambda: watch.source.alive(names["silent"]) > begun + 1.0)
            for kind, loop in names.items():
                plant.fault(kind, loop, 0)
            ended = plant.time
            await watch.heard("LIC109", 10)
            return SimpleNamespace(watch=watch, names=names, begun=begun, ended=ended)

    return shared(run)


def during(faulty, kind):
    loop = faulty.names[kind]
    return loop, [v for v in faulty.watch.of(loop) if faulty.begun + 0.01 < v.time < faulty.ended - 0.01]


@served
def test_every_value_once_and_in_order(faulty):
    for loop in faulty.watch.loops:
        for which in Signal:
            # Of a tag whose clock is wrong a bad value has the time of ours.
            values = [v for v in faulty.watch.of(loop.name, which) if "clock" not in v.note]
            assert ascending(values), (loop.name, which)
    assert len(faulty.watch.of("LIC109")) > 25
    assert not gaps(faulty.watch.of("LIC109"), 0.1)


@served
def test_a_bad_status_is_no_number_and_says_why(faulty):
    _, values = during(faulty, "bad")
    assert values and all(not v.good and math.isnan(v.value) and v.note == "BadSensorFailure" for v in values)
    assert faulty.watch.of(faulty.names["bad"])[-1].good


@served
def test_a_stuck_value_is_handed_on_as_it_is(faulty):
    _, values = during(faulty, "stuck")
    assert len(values) > 5 and len({v.value for v in values}) == 1 and all(v.good for v in values)


@served
def test_a_still_value_is_told_from_a_lost_one(faulty):
    """The server said that it is there and has nothing new: that was waited for."""
    _loop, values = during(faulty, "silent")
    assert not values


@served
def test_a_time_stamp_from_the_future_is_a_bad_value_of_now(faulty):
    """Regression: it was left out, and the PV of before was held as good while OP moved, as of a valve that sticks."""
    loop, values = during(faulty, "future")
    assert len(values) > 5 and all(not v.good and "ahead of this computer's clock" in v.note for v in values)
    [first, *_] = faulty.watch.texts("future", loop)
    assert "ahead of this computer's clock; it counts as bad" in first
    assert faulty.watch.of(loop)[-1].time > faulty.ended, "and does not lock out what comes after it"


@served
def test_late_values_are_left_out(faulty):
    loop, values = during(faulty, "late")
    assert len(values) > 5 and not gaps(values, 0.1)
    assert "comes after that of" in faulty.watch.texts("late", loop)[0]


@served
def test_a_value_that_comes_twice_is_handed_on_once(faulty):
    loop, values = during(faulty, "duplicate")
    assert len(values) > 5 and not gaps(values, 0.1)
    assert "comes twice" in faulty.watch.texts("duplicate", loop)[0]


@served
def test_a_tag_that_changes_its_type(faulty):
    loop, values = during(faulty, "type")
    assert values and all(not v.good and v.note == "text, no number" for v in values)
    there, back = faulty.watch.texts("type_changed", loop)
    assert "from Double to String" in there and "from String to Double" in back
    assert faulty.watch.of(loop)[-1].good


@served
def test_a_clock_that_is_set_back(faulty):
    loop, values = during(faulty, "back")
    assert len(values) > 5 and all(not v.good and "its clock went back by 3" in v.note for v in values)
    assert (
        "clock went back by 3600 s; values count as bad until it has passed"
        in faulty.watch.texts("clock_back", loop)[0]
    )
    assert faulty.watch.of(loop)[-1].time > faulty.ended


@served
def test_a_sound_loop_is_not_spoken_of(faulty):
    assert [e for e in faulty.watch.events if e.loop == "LIC109"] == []


@served
def test_the_same_thing_is_not_told_again_and_again(faulty):
    assert len(faulty.watch.texts("future")) <= 2  # three values a second until it was over


# ---------------------------------------------------------------- faults of the connection


@pytest.mark.slow
def test_server_gone_and_back_with_other_namespace_indices():
    """No value is missing and none comes twice, though the server was away and its indices have moved."""

    async def run():
        async with SimPlant(2, scan=0.1) as plant:
            whole = parse_settings(plant.settings(), "loops.toml", Path())
            bare = {k: v.replace(f"nsu={NAMESPACE}", "ns=2") for k, v in whole[0].opcua.nodes.items()}
            by_index = Loop(name="A", opcua={"pv": bare["pv"], "sp": bare["sp"]})
            async with Watch(plant, loops=[by_index, whole[1]]) as watch:
                await watch.heard("A", 10)
                await plant.close()
                await watch.until(lambda: watch.texts("lost"))
                await asyncio.sleep(1.0)
                await plant.open(namespaces=3)
                await watch.until(lambda: watch.texts("backfilled"))
                await watch.heard("A", 15)
        return watch

    watch = asyncio.run(run())
    for loop in ("A", "PIC102"):
        values = [v for v in watch.of(loop) if v.note != "BadWaitingForInitialData"]
        assert ascending(values) and not gaps(values, 0.1)
        assert all(v.good for v in values)
    assert not watch.texts("duplicate") and not watch.texts("overflow") and not watch.texts("late")
    assert "it is tried again" in watch.texts("lost")[0]
    assert "were read from the history" in watch.texts("backfilled")[0]
    assert f"namespace {NAMESPACE} has moved from index 2 to 5" in watch.texts("namespace_moved")[0]


@pytest.mark.slow
def test_a_server_that_was_gone_for_an_hour():
    """3600 scans in which nobody could be asked: all of them are read from the history, once and in order."""

    async def run():
        plant = SimPlant(1, begin=0.1, history=2 * 3600.0)  # its time goes on where it is told to, by hand
        await plant.open()

        async def scans(count):
            for _ in range(count):
                await plant._one()

        try:
            async with Watch(plant) as watch:
                await watch.until(lambda: watch.texts("connected"))
                await scans(10)
                await watch.until(lambda: watch.of("FIC101") and watch.of("FIC101")[-1].time == plant.time)
                await plant.close()
                await watch.until(lambda: watch.texts("lost"))
                await scans(3600)
                await plant.open()
                await watch.until(lambda: watch.texts("backfilled"))
                await scans(10)
                await watch.until(lambda: watch.of("FIC101")[-1].time == plant.time)
        finally:
            await plant.close()
        return plant, watch

    plant, watch = asyncio.run(run())
    values = [v for v in watch.of("FIC101") if v.good]
    assert [v.time for v in values] == [plant._begin + k for k in range(1, 3621)]
    assert re.search(r"\d{4,} values", watch.texts("backfilled")[0])
    assert {e.kind for e in watch.events} == {"connected", "lost", "backfilled"}


@pytest.mark.slow
def test_without_a_history_the_break_is_a_gap():
    async def run():
        async with SimPlant(1, scan=0.1, history=0.0) as plant, Watch(plant) as watch:
            await watch.heard("FIC101", 5)
            await plant.close()
            await watch.until(lambda: watch.texts("lost"))
            await plant.open()
            await watch.until(lambda: len(watch.texts("connected")) >= 2)
            await watch.heard("FIC101", 5)
        return watch

    watch = asyncio.run(run())
    values = [v for v in watch.of("FIC101") if v.good]
    assert 1 <= len(gaps(values, 0.1)) <= len(watch.texts("lost")) and ascending(values)
    assert not watch.texts("backfilled")


@pytest.mark.slow
def test_a_watch_that_was_interrupted_has_what_one_that_was_not_has():
    async def run():
        async with SimPlant(2, scan=0.05, most=20) as plant, Watch(plant) as whole:
            await whole.heard("PIC102", 1)
            async with Watch(plant) as first:
                await first.heard("PIC102", 20)
            await asyncio.sleep(1.5)  # several answers of the history, 20 values each
            since = {(v.loop, v.signal): v.time for v in first.values}
            async with Watch(plant, since) as second:
                await second.until(lambda: second.texts("backfilled"))
                await second.heard("PIC102", 40)
                end = second.of("PIC102")[-1].time
                await whole.until(lambda: whole.of("PIC102")[-1].time >= end)
        return whole, first, second, end

    whole, first, second, end = asyncio.run(run())
    joined = first.values + second.values
    for loop in ("FIC101", "PIC102"):
        for which in (Signal.SP, Signal.PV, Signal.OP, Signal.MODE):
            mine = [v for v in joined if v.loop == loop and v.signal is which and v.good and v.time <= end - 0.2]
            theirs = [v for v in whole.of(loop, which) if v.good and mine[0].time <= v.time <= end - 0.2]
            assert mine == theirs


@served
def test_a_short_break_is_read_for_many_loops_at_once(shared, monkeypatch):
    """Asked loop by loop, a server of a thousand loops that answered slowly was not caught up with."""
    asked, read = [], OpcUa._history

    async def counted(self, link, handles, begin, end):
        asked.append(len(handles))
        return await read(self, link, handles, begin, end)

    monkeypatch.setattr(OpcUa, "_history", counted)

    async def run(plant):
        while any(loop.faults for loop in plant._loops.values()):  # of the tests before
            await asyncio.sleep(0.05)
        await asyncio.sleep(3.0)
        since = {(name, Signal.PV): plant.time - 2.0 for name in plant.names}
        async with Watch(plant, since) as watch:
            await watch.until(lambda: watch.texts("backfilled"))
            await watch.heard("LIC109", 3)
        return plant.names, since, watch

    names, since, watch = shared(run)
    assert asked[0] == 7 * len(names), "all tags of all loops"
    for name in names:
        values = watch.of(name)
        assert ascending(values) and not gaps(values, 0.1)
        assert since[name, Signal.PV] < values[0].time < since[name, Signal.PV] + 0.15


@pytest.mark.slow
def test_a_history_that_gives_more_than_was_asked(monkeypatch):
    """Values outside of the range, in the wrong order and twice: none of them is handed on."""

    async def more(self, node_id, start, end, most):
        values, _ = await right(self, node_id, start, end, most)
        if not values:
            return values, None
        outside = dataclasses.replace(values[0], SourceTimestamp=datetime.fromtimestamp(1e9, UTC))
        ahead = dataclasses.replace(values[0], SourceTimestamp=datetime.fromtimestamp(end.timestamp() + 5, UTC))
        return [outside, *values[::-1], *values, ahead], None

    from glapp.service.plant import _History

    right = _History.read_node_history
    monkeypatch.setattr(_History, "read_node_history", more)

    async def run():
        async with SimPlant(1, scan=0.1) as plant:
            await asyncio.sleep(1.0)
            since = {("FIC101", Signal.PV): plant.time - 0.65, ("FIC101", Signal.SP): plant.time - 0.65}
            async with Watch(plant, since) as watch:
                await watch.heard("FIC101", 10)
        return watch, since["FIC101", Signal.PV]

    watch, since = asyncio.run(run())
    values = watch.of("FIC101")
    assert ascending(values) and not gaps(values, 0.1)
    assert since < values[0].time <= since + 0.11
    assert "outside of what was asked" in watch.texts("outside")[0]


@pytest.mark.verify
def test_a_server_that_hangs_is_given_up_and_caught_up_with(tmp_path):
    """The server keeps its socket open and answers nothing: only its silence shows it."""
    port = free_port()
    settings = tmp_path / "loops.toml"
    command = [*GLAPP, "plant", "--loops", "1", "--scan", "0.1", "--port", str(port), "--settings", settings]
    with subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, text=True) as served:
        try:
            assert f":{port}/" in served.stdout.readline()

            async def run():
                plant = SimpleNamespace(url=read_connection(settings).url)
                async with Watch(plant, loops=read_settings(settings), timeout=1.0) as watch:
                    await watch.heard("FIC101", 10)
                    os.kill(served.pid, signal.SIGSTOP)
                    await watch.until(lambda: watch.texts("lost"))
                    os.kill(served.pid, signal.SIGCONT)
                    await watch.until(lambda: len(watch.texts("connected")) >= 2)
                    await watch.heard("FIC101", 10)
                return watch

            watch = asyncio.run(run())
        finally:
            os.kill(served.pid, signal.SIGCONT)
            served.terminate()
    values = [v for v in watch.of("FIC101") if v.good]
    assert ascending(values) and not gaps(values, 0.1)
    assert {e.kind for e in watch.events} <= {"connected", "lost", "backfilled"}


@pytest.mark.slow
def test_nobody_there_is_told_once(monkeypatch):
    tries, client = [], opcua.client_of

    async def counted(connection):
        tries.append(connection)
        return await client(connection)

    monkeypatch.setattr(opcua, "client_of", counted)

    async def run():
        plant = SimpleNamespace(url=f"opc.tcp://127.0.0.1:{free_port()}")
        async with Watch(plant, loops=[Loop(name="A", opcua={"pv": "i=1", "sp": "i=2"})], watchdog=None) as watch:
            await watch.until(lambda: len(tries) > 3)
        return watch.events

    events = asyncio.run(run())
    assert [e.kind for e in events] == ["lost"] and "nobody listens there: check host and port" in events[0].text


@served
def test_a_tag_that_is_not_there_and_a_mode_that_is_not_known(shared):
    async def run(plant):
        one, two, three, *_ = parse_settings(plant.settings(), "loops.toml", Path())
        tags = one.opcua.model_copy(update={"op": node("FIC101.NONE")})
        wrong = one.model_copy(update={"opcua": tags, "auto_values": None})
        of_none = two.model_copy(update={"opcua": two.opcua.model_copy(update={"op": "nsu=urn:none;s=x"})})
        by_text = {**three.opcua.nodes, "mode": three.opcua.pv.replace("PV", "SP"), "sp": three.opcua.op}
        unknown = Loop(name="TIC103", opcua={k: by_text[k] for k in ("sp", "pv", "mode")})
        async with Watch(plant, loops=[wrong, of_none, unknown]) as watch:
            await watch.heard("FIC101", 5)
        return watch

    watch = shared(run)
    assert "FIC101.NONE: BadNodeIdUnknown (the server has no such node)" in watch.texts("tag_missing", "FIC101")[0]
    assert {e.signal for e in watch.events if e.kind == "tag_missing"} == {Signal.OP}, "each says of which tag it is"
    assert "PIC102 OP: the server has no namespace urn:none" in watch.texts("tag_missing", "PIC102")[0]
    assert all(v.value == 1.0 for v in watch.of("FIC101", Signal.MODE) if v.good), "1 is automatic by itself"
    assert watch.of("TIC103", Signal.MODE)[-1].value == 0.0
    assert "is not a mode that glapp knows" in watch.texts("unknown_mode", "TIC103")[0]


@served
def test_a_taker_that_fails_is_not_the_connection(shared):
    async def run(plant):
        def take(values):
            raise KeyError("mine")

        watch = Watch(plant)
        await asyncio.wait_for(watch.source.run(take, watch.events.append), 120.0)

    with pytest.raises(KeyError, match="mine"):
        shared(run)


# ---------------------------------------------------------------- the queue


def message(n, number):
    seen = ua.DataValue(ua.Variant(1.0), SourceTimestamp=datetime.now(UTC))
    part = ua.DataChangeNotification(MonitoredItems=[ua.MonitoredItemNotification(ClientHandle=0, Value=seen)] * n)
    notification = ua.NotificationMessage(SequenceNumber=number, PublishTime=datetime.now(UTC), NotificationData=[part])
    return ua.PublishResult(SubscriptionId=1, NotificationMessage=notification)


def link(**connection):
    return opcua._Link(None, Connection(url="opc.tcp://x:1", **connection))


def test_nothing_stands_still_while_values_wait_to_be_handed_on():
    """After a break they wait for the history: until then PV was held to stand still, and what waited came too late."""
    fed = Fed()
    made = fed.source._link
    fed(10.0)
    made.heard = fed.begin + 50.0
    assert fed.source.alive("L0") == fed.begin + 10.0, "the history is still read"
    made.caught_up = True
    assert fed.source.alive("L0") == fed.begin + 50.0
    made.published(message(1, 1))
    assert fed.source.alive("L0") == fed.begin + 10.0


def test_the_server_is_asked_to_hold_nothing_back():
    """A dead band in the connection would hide the moves that tell a valve's gap."""
    made = link()
    made.nodes = {0: ua.NodeId(1), 1: ua.NodeId(2)}
    items = Fed().source._items(made, [0, 1], filtered=True).ItemsToCreate
    for asked in (item.RequestedParameters for item in items):
        assert (asked.Filter.DeadbandType, asked.Filter.DeadbandValue) == (0, 0.0)
        assert asked.Filter.Trigger == ua.DataChangeTrigger.StatusValueTimestamp
        assert (asked.QueueSize, asked.SamplingInterval) == (100, 1000.0)
    assert len(items) == 2


def test_an_overflow_of_the_queue_ends_the_connection_so_that_the_history_fills_it():
    made = link(queue=100)
    made.published(message(60, 1))
    assert made.lost is None
    made.published(message(60, 2))
    assert made.overflow and made.lost == "more than 100 values wait to be taken; 60 are thrown away"
    made.published(message(1, 3))
    assert made.waiting == 60, "after the loss nothing is queued: it would come before what is missing"


def test_a_missing_message_of_the_server_ends_the_connection():
    made = link()
    made.published(message(1, 4_294_967_295))
    made.published(message(1, 1))
    assert made.lost is None, "after the greatest number comes 1"
    made.published(message(1, 3))
    assert made.overflow and made.lost == "messages 2 to 2 of the server are missing"


@served
def test_the_servers_own_overflow_is_told(shared):
    async def run(plant):
        async with Watch(plant) as watch:
            await watch.heard("FIC101", 3)
            await plant._write(("FIC101", Signal.SP), time.time(), 50.0, 0x480)
            await watch.until(lambda: watch.texts("overflow"))
        return watch

    assert "FIC101 SP: the server has thrown values away" in shared(run).texts("overflow", "FIC101")[0]


# ---------------------------------------------------------------- values, without a server


class Fed:
    """A source that is handed values as if they came from a server."""

    def __init__(self, tags=1, behind=1e9):
        loops = [Loop(name=f"L{i}", opcua={"pv": f"s=pv{i}", "sp": f"s=sp{i}"}) for i in range(tags)]
        self.source, self.events = OpcUa(Connection(url="opc.tcp://p:1", behind=behind), loops), []
        self.source._events.tell = self.events.append
        self.source._link = link()
        for tag in self.source._tags:
            tag.first = False
        self.begin = math.floor(time.time()) - 100.0

    def __call__(self, t, value=1.0, status=0, tag=0):
        at = datetime.fromtimestamp(self.begin + t, UTC)
        seen = ua.DataValue(ua.Variant(value), ua.StatusCode(status), at)
        [item] = [ua.MonitoredItemNotification(ClientHandle=2 * tag + 1, Value=seen)]
        return self.source._values([item], live=True)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_finite_number_is_not_good(value):
    [one] = Fed()(1.0, value)
    assert not one.good and math.isnan(one.value) and one.note == "not a finite number"


@pytest.mark.parametrize(
    ("status", "note"),
    [(0x8000_0000, "Bad"), (0x4093_0000, "UncertainSensorNotAccurate"), (0x8031_0000, "BadNoCommunication")],
)
def test_only_good_is_good(status, note):
    [one] = Fed()(1.0, 50.0, status)
    assert (one.good, one.note) == (False, note) and math.isnan(one.value)


def test_a_status_that_changes_without_a_new_time_is_handed_on():
    """A server that loses a device often leaves the time stamp as it was: the value must not stay good."""
    fed = Fed()
    [good], [bad], [again] = fed(1.0, 50.0), fed(1.0, 50.0, 0x8031_0000), fed(1.0, 50.0)
    assert (good.good, bad.good, again.good) == (True, False, True)
    assert good.time < bad.time < again.time < good.time + 0.01
    assert fed(1.0, 50.0) == [] and len(fed.events) == 1
    assert fed(2.0, 51.0)


def test_what_befalls_very_many_tags_is_told_together():
    fed = Fed(100)
    for tag in range(100):
        assert not fed(1e6, tag=tag)[0].good
    assert len(fed.events) == 20
    fed.source._events.flush(due=True)
    assert len(fed.events) == 21
    assert fed.events[-1].text.startswith("80 more tags, such as L99 PV: its time stamp is")


def test_what_goes_on_is_counted(monkeypatch):
    moment = 1000.0
    monkeypatch.setattr(opcua.time, "monotonic", lambda: moment)
    fed = Fed()
    for _ in range(30):
        fed(1e6)
    assert len(fed.events) == 1
    moment += 61.0
    fed.source._events.flush(due=True)
    assert fed.events[1].text.endswith("(29 values in all)")


def test_without_a_source_time_stamp_the_servers_is_taken():
    fed = Fed()
    at = datetime.fromtimestamp(fed.begin, UTC)
    seen = ua.DataValue(ua.Variant(1.0), ServerTimestamp=at)
    [one] = fed.source._values([ua.MonitoredItemNotification(ClientHandle=1, Value=seen)], live=True)
    assert one.time == fed.begin and one.good
    assert [e.kind for e in fed.events] == ["no_time"]


def test_a_history_that_is_shorter_than_the_break_or_is_not_there():
    """A day is read and no more; a PV without a history is told, and once for all where no tag has one."""
    fed = Fed(2)
    for tag in fed.source._tags:
        tag.last = fed.source._newest[tag.loop] = fed.begin - 2 * 86_400.0
    begins = []

    def answers(*without):
        """A server whose history lacks these tags."""

        async def history_read(asked):
            begins.append(asked.HistoryReadDetails.StartTime.timestamp())
            unsupported = ua.StatusCode(ua.StatusCodes.BadHistoryOperationUnsupported)
            right = ua.HistoryReadResult(HistoryData=ua.HistoryData())
            wrong = ua.HistoryReadResult(StatusCode=unsupported)
            return [wrong if node.NodeId.Identifier in without else right for node in asked.NodesToRead]

        one = link()
        one.client = SimpleNamespace(uaclient=SimpleNamespace(history_read=history_read))
        one.nodes = {handle: ua.NodeId(handle, 1) for handle in range(4)}
        asyncio.run(fed.source._backfill(one, lambda values: None, fed.begin))
        events = [(e.kind, e.loop) for e in fed.events]
        fed.events.clear()
        return events

    longer = [("not_backfilled", "L0"), ("not_backfilled", "L1")]
    assert answers() == longer and min(begins) == fed.begin - 86_400.0
    assert answers(1) == [*longer, ("no_history", "L0")], "of one PV"
    assert answers(0, 1, 2, 3) == [*longer, ("no_history", None)]


def test_a_server_that_takes_no_filter_and_is_slower():
    fed, asked = Fed(), []

    async def create_subscription(wanted, published):
        return SimpleNamespace(SubscriptionId=1, RevisedPublishingInterval=1000.0, RevisedMaxKeepAliveCount=3)

    async def create_monitored_items(items):
        asked.append([isinstance(item.RequestedParameters.Filter, ua.DataChangeFilter) for item in items.ItemsToCreate])
        refused = ua.StatusCodes.BadMonitoredItemFilterUnsupported if len(asked) == 1 else ua.StatusCodes.Good
        return [
            ua.MonitoredItemCreateResult(StatusCode=ua.StatusCode(refused), RevisedSamplingInterval=5000.0)
            for _ in items.ItemsToCreate
        ]

    one = link()
    session = SimpleNamespace(create_subscription=create_subscription, create_monitored_items=create_monitored_items)
    one.client = SimpleNamespace(uaclient=SimpleNamespace(session=session))
    one.nodes = {handle: ua.NodeId(handle, 1) for handle in range(2)}
    asyncio.run(fed.source._subscribe(one, range(2)))
    assert asked == [[True, True], [False, False]] and not one.missing
    assert [e.kind for e in fed.events] == ["no_filter", "slower"]
    assert "every 5 s at best, not every 1 s" in fed.events[1].text


@pytest.mark.parametrize(
    ("kind", "access", "kinds"),
    [
        (ua.VariantType.Double, 3, []),
        (ua.VariantType.Double, 1, ["not_writable"]),
        (ua.VariantType.Int32, 3, ["tag_missing"]),
    ],
)
def test_a_node_of_u_ff_that_cannot_be_written_is_told(kind, access, kinds):
    tags = {"pv": "s=pv", "sp": "s=sp", "u_ff": "s=u_ff", "u_ff_limit": 1.0, "u_ff_rate": 1.0}
    events, told_to = [], EventFilter()
    told_to.tell = events.append
    nodes = UffNodes([Loop(name="L", opcua=tags)], 1.0, told_to)

    async def read_attributes(asked, attribute):
        value = ua.Variant(0, kind) if attribute is ua.AttributeIds.Value else ua.Variant(access, ua.VariantType.Byte)
        return [ua.DataValue(value)]

    client = SimpleNamespace(uaclient=SimpleNamespace(read_attributes=read_attributes))
    nodes.nodes["L"].node = ua.NodeId("u_ff", 0)
    asyncio.run(nodes.check(client, 500))
    assert [e.kind for e in events] == kinds and (nodes.nodes["L"].node is None) == bool(kinds)


@pytest.mark.parametrize("steps", range(5))
def test_a_cancellation_is_not_lost_where_a_message_comes_with_it(steps):
    """Regression: with wait_for of Python 3.11 the service went on listening after it was told to end."""

    async def run():
        fed = Fed()
        task = asyncio.create_task(fed.source._hand_on(fed.source._link, lambda values: None))
        await asyncio.sleep(0.01)
        fed.source._link.wake.set()
        for _ in range(steps):
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.wait([task], timeout=30.0)
        return task.cancelled()

    assert asyncio.run(run())


def test_a_clock_that_is_behind_is_told_and_its_values_are_used():
    """Regression: a plant whose clock was an hour behind sent everybody to look why no value comes."""
    fed = Fed(behind=60.0)
    assert [value.value for t in (10.0, 11.0, 45.0) for value in fed(t)] == [1.0, 1.0, 1.0]
    [event] = fed.events
    assert (event.kind, event.loop, event.signal) == ("behind", "L0", Signal.PV)
    assert re.search(r"is 9\d s behind this computer's clock; the value is used. Set the clocks", event.text)
    fed = Fed(behind=60.0)
    assert fed(45.0) and not fed.events, "55 s is not too much"


def test_one_late_value_does_not_look_like_a_clock_that_is_set_back():
    fed = Fed()
    for t in (10.0, 3.0, 11.0, 4.0, 12.0, 5.0, 13.0):
        fed(t)
    assert {e.kind for e in fed.events} == {"late"}


def test_the_clock_of_this_computer_never_goes_back(monkeypatch):
    now, moment = 1e9, 100.0
    monkeypatch.setattr(opcua.time, "time", lambda: now)
    monkeypatch.setattr(opcua.time, "monotonic", lambda: moment)
    clock = opcua._Clock()
    moment += 10.0
    now += 10.0 - 3600.0
    assert clock.now() == 1e9 + 10.0
    assert clock.set_back() == 3600.0
    assert clock.set_back() == 0.0, "told once"
    now += 7200.0
    assert clock.now() == 1e9 + 10.0 + 3600.0


# ---------------------------------------------------------------- writing


def refused(error):
    return error.value.reason


@served
def test_writing(shared):
    """Allowed writes, refused writes, and the plant without a heartbeat."""
    times = {}

    async def run(plant):
        async with Watch(plant) as watch:
            source = watch.source

            async def write(u_ff, loop="FIC101"):
                await source.heartbeat()
                await source.write(loop, u_ff)

            with pytest.raises(WriteRefused) as error:
                await source.write("FIC101", 0.1)
            assert refused(error) == "not_connected"
            await watch.heard("FIC101", 5)
            with pytest.raises(WriteRefused) as error:
                await write(0.1)
            assert refused(error) == "not_enabled"
            with pytest.raises(WriteRefused) as error:
                await write(0.1, "FIC999")
            assert refused(error) == "not_named"

            source.enable("FIC101")
            assert source.enabled("FIC101") and not source.enabled("PIC102")
            for wrong, why in ((math.nan, "not_a_number"), (math.inf, "not_a_number"), (3.1, "too_large")):
                with pytest.raises(WriteRefused) as error:
                    await write(wrong)
                assert refused(error) == why
            with pytest.raises(WriteRefused) as error:
                await write(1.0)  # 0.5 %/s are allowed
            assert refused(error) == "too_fast"
            assert error.value.nearest is not None and 0.0 <= error.value.nearest < 0.5
            await asyncio.sleep(0.15)
            await write(0.05)
            assert (await source.read_back("FIC101")).value == 0.05
            with pytest.raises(WriteRefused) as error:
                await write(0.05, "PIC102")
            assert refused(error) == "not_enabled"
            await asyncio.sleep(0.3)
            await write(0.1)
            await watch.until(lambda: plant.u_ff("FIC101") == 0.1)
            await write(0.0)  # towards 0 at any rate
            await watch.until(lambda: plant.u_ff("FIC101") == 0.0)
            await asyncio.sleep(0.2)
            begun = time.monotonic()  # before the last heartbeat
            await write(0.1)
            await watch.until(lambda: plant.u_ff("FIC101") == 0.1)

            # we fall silent: the plant ramps it out by itself
            plant._watchdog = _SHORT
            await watch.until(lambda: plant.u_ff("FIC101") < 0.1)
            await source.heartbeat()  # too late: a ramp that has begun goes on
            await watch.until(lambda: plant.u_ff("FIC101") == 0.0)
            times["zero"] = time.monotonic() - begun
            plant._watchdog = _PATIENT
            with pytest.raises(WriteRefused) as error:
                await write(0.1)
            assert refused(error) == "other_writer" and not source.enabled("FIC101")
            assert watch.texts("other_writer", "FIC101")
            with pytest.raises(WriteRefused) as error:
                await write(0.0)
            assert refused(error) == "other_writer", "until it is enabled anew"

            # somebody else writes it
            source.enable("FIC101")
            await asyncio.sleep(0.2)
            await write(0.05)
            plant.fault("writer", "FIC101")
            await watch.until(lambda: plant.u_ff("FIC101") >= 1.0)
            with pytest.raises(WriteRefused) as error:
                await write(0.05)
            assert refused(error) == "other_writer"

            # a lost connection takes the right away
            source.enable("FIC101")
            source._link.end("lost on purpose")
            await watch.until(lambda: len(watch.texts("connected")) == 2)
            # The monitor withdraws the loop when it hears of it: two events told of one withdrawal.
            assert watch.texts("lost") and not watch.texts("withdrawn", "FIC101")
            plant._watchdog = _SHORT
            await watch.until(lambda: plant.u_ff("FIC101") == 0.0)  # no heartbeat came: the plant has ramped it out
            plant._watchdog = _PATIENT
            await watch.heard("FIC101", 5)
            assert not source.enabled("FIC101")

            # what was found may only go to 0
            await source.heartbeat()
            plant.fault("writer", "FIC101")
            await watch.until(lambda: plant.u_ff("FIC101") >= 1.0)
            await source.heartbeat()
            for u_ff, why in ((2.5, "not_enabled"), (-0.1, "not_enabled")):
                with pytest.raises(WriteRefused) as error:
                    await write(u_ff)
                assert refused(error) == why
            for u_ff in (0.6, 0.0):
                await write(u_ff)
            await watch.until(lambda: plant.u_ff("FIC101") == 0.0)

    shared(run)
    assert times["zero"] >= _SHORT


def test_the_value_is_checked_as_the_node_holds_it():
    assert opcua_values.as_written(0.1, ua.VariantType.Float) != 0.1
    assert opcua_values.as_written(0.1, ua.VariantType.Double) == 0.1


@served
def test_a_plant_does_not_let_others_be_written(shared):
    """Only u_FF and the watchdog are writable at the plant's side, too."""

    async def run(plant):
        async with Client(plant.url) as client:
            index = await client.get_namespace_index(NAMESPACE)
            tag = client.get_node(ua.NodeId("FIC101.SP", index))
            with pytest.raises(ua.UaStatusCodeError, match="BadUserAccessDenied"):
                await tag.write_value(1.0)
            method = ua.NodeId("Fault", index)
            answer = await client.nodes.objects.call_method(method, "none", "", 1.0)
            assert "must be one of silent, bad" in answer

    shared(run)


def test_nothing_but_the_service_can_reach_a_plant():
    """Nothing outside of the service imports a client: neither the laboratory nor the Python API."""
    package = ROOT / "python" / "glapp"
    reach = {
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        if re.search(r"^\s*(import|from) asyncua|from \.+service\.(opcua|plant)", path.read_text("utf-8"), re.MULTILINE)
    }
    outside = {path for path in reach if not path.startswith("service")}
    assert len(reach) > len(outside) and outside == {"cli/watch_run.py", "cli/plant.py"}


# ---------------------------------------------------------------- security


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    """Three pairs of certificate and key: ours, the plant's, a stranger's."""
    folder = tmp_path_factory.mktemp("pki")

    async def make():
        for name, use in (("ours", "CLIENT"), ("plant", "SERVER"), ("stranger", "SERVER")):
            key, certificate = folder / f"{name}.pem", folder / f"{name}.der"
            usage = [getattr(ExtendedKeyUsageOID, f"{use}_AUTH")]
            await setup_self_signed_certificate(key, certificate, f"urn:glapp:{name}", "localhost", usage, {})

    asyncio.run(make())
    return folder


@pytest.mark.slow
def test_security(certificates, monkeypatch):
    """Encrypted with the certificate that was carried here and the right password; anything else gets no value."""
    monkeypatch.setenv("GLAPP_OPCUA_PASSWORD", "from the environment")
    (certificates / "password").write_text("secret\n")
    (certificates / "wrong").write_text("guess\n")
    at = certificates
    own = {"certificate": at / "ours.der", "private_key": at / "ours.pem"}
    right = {"security": "Basic256Sha256", **own, "server_certificate": at / "plant.der", "user": "glapp"}

    async def attempt(plant, **connection):
        async with Watch(plant, **connection) as watch:
            await watch.until(lambda: watch.texts("lost") or len(watch.of("FIC101")) > 2)
        return watch

    async def run():
        shown = Security(at / "plant.der", at / "plant.pem", {"glapp": "secret"})
        async with SimPlant(1, scan=0.1, security=shown) as plant:
            good = await attempt(plant, **right, password_file=at / "password")
            assert good.values and not good.texts("lost")
            for policy in ("Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"):
                other = await attempt(plant, **{**right, "security": policy}, password_file=at / "password")
                assert other.values and not other.texts("lost"), policy
            signed = {k: v for k, v in right.items() if k != "user"} | {"mode": "Sign"}
            assert not (await attempt(plant, **signed)).values, "this plant asks for a user"
            wrong = await attempt(plant, **right, password_file=at / "wrong")
            assert not wrong.values and "BadUserAccessDenied" in wrong.texts("lost")[0]
            by_environment = await attempt(plant, **right)
            assert not by_environment.values and "BadUserAccessDenied" in by_environment.texts("lost")[0]
            nobody = await attempt(plant, **{k: v for k, v in right.items() if k != "user"})
            assert not nobody.values and nobody.texts("lost")
            readable = await attempt(plant)
            assert not readable.values
            assert (
                "does not offer no security; it offers Aes128Sha256RsaOaep (SignAndEncrypt),"
                in readable.texts("lost")[0]
            )
            signed = {k: v for k, v in right.items() if k != "user"} | {"mode": "Sign"}
            aes = await attempt(plant, **{**signed, "security": "Aes128Sha256RsaOaep"})
            assert "does not offer Aes128Sha256RsaOaep (Sign); it offers" in aes.texts("lost")[0]
            other = {**right, "server_certificate": at / "stranger.der", "password_file": at / "password"}
            stranger = await attempt(plant, **other)
            assert not stranger.values
            assert f"shows another certificate than {at / 'stranger.der'}" in stranger.texts("lost")[0]
            other = {**right, "server_certificate": at / "none.der", "password_file": at / "password"}
            missing = await attempt(plant, **other)
            assert "none.der: there is no such file" in missing.texts("lost")[0]

    asyncio.run(run())


def dated(folder, name, use, begin, end):
    """A pair of certificate and key that is valid from and until so many days from now."""
    key = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    who = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    day = datetime.now(UTC)
    made = (
        x509.CertificateBuilder(who, who, key.public_key(), x509.random_serial_number())
        .not_valid_before(day + timedelta(begin))
        .not_valid_after(day + timedelta(end, minutes=1))
        .add_extension(x509.SubjectAlternativeName([x509.UniformResourceIdentifier(f"urn:glapp:{name}")]), False)
        .add_extension(x509.KeyUsage(True, True, True, True, False, True, False, False, False), True)
        .add_extension(x509.ExtendedKeyUsage([use]), False)
        .sign(key, hashes.SHA256())
    )
    (folder / f"{name}.der").write_bytes(made.public_bytes(Encoding.DER))
    text = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    (folder / f"{name}.pem").write_bytes(text)
    return {"certificate": folder / f"{name}.der", "private_key": folder / f"{name}.pem"}


def test_certificates_that_expire_are_told(tmp_path):
    """Regression: ours and the server's were used beyond their dates without a word, until the server refused ours."""
    plant, client = ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH
    server = dated(tmp_path, "plant", plant, -9, -1)
    stranger = dated(tmp_path, "stranger", plant, -9, 300)
    valid = {"sound": (-9, 300), "future": (3, 300), "soon": (-9, 12), "old": (-9, -1)}
    ours = {name: dated(tmp_path, name, client, *days) for name, days in valid.items()}

    def secured(name, other):
        return {"security": "Basic256Sha256", **ours[name], "server_certificate": other["certificate"]}

    async def run():
        async def told(name):
            connection = Connection(url="opc.tcp://127.0.0.1:1", **secured(name, stranger))
            return " ".join(await opcua_client.expiring(connection))

        assert await told("sound") == ""
        assert "future.der is valid from 2" in await told("future")
        assert re.search(r"soon\.der expires on \S+, in 12 d: make a new one", await told("soon"))
        security = Security(server["certificate"], server["private_key"])
        async with SimPlant(1, scan=0.1, security=security) as sim, Watch(sim, **secured("old", server)) as watch:
            await watch.until(lambda: len(watch.of("FIC101")) > 2)
            # Where a server refuses it, it was said that the server may not trust it.
            assert "old.der has expired on" in await opcua_client._why(
                Connection(url=sim.url, **secured("old", server))
            )
        texts = watch.texts("certificate")
        assert len(texts) == 2 and "old.der has expired on 2" in texts[0] and "plant.der has expired" in texts[1]
        assert "get a new one from the server's administrator" in texts[1]

    asyncio.run(run())


@pytest.mark.parametrize(
    ("name", "file", "expected"),
    [
        ("certificate", "none.der", "none.der: there is no such file"),
        ("certificate", "word", "word: is no certificate in DER or PEM"),
        ("server_certificate", "word", "word: is no certificate in DER or PEM"),
        ("private_key", "ours.der", "ours.der: is no private key without a password, in DER or PEM"),
        ("private_key", "stranger.pem", "stranger.pem: is not the key of the certificate ours.der"),
    ],
)
def test_a_wrong_certificate_ends_the_service_at_once(certificates, tmp_path, monkeypatch, name, file, expected):
    """Regression: it ran on, said nothing on the terminal, and tried again for ever with words of the ASN.1 parser."""
    monkeypatch.chdir(certificates)
    (certificates / "word").write_text("secret")
    files = {"certificate": "ours.der", "private_key": "ours.pem", "server_certificate": "plant.der", name: file}
    keys = "".join(f"{key} = '{path}'\n" for key, path in files.items())
    text = f"[opcua]\nurl = 'opc.tcp://127.0.0.1:1'\nsecurity = 'Basic256Sha256'\n{keys}"
    Path("loops.toml").write_text(text + "[loops.A.opcua]\npv = 'i=1'\nsp = 'i=2'\n")
    for words in (["watch", "loops.toml", "--data", str(tmp_path / "data")], ["tags", "loops.toml"]):
        with pytest.raises(InputError) as error:
            glapp.cli.app(words, standalone_mode=False)
        assert expected in str(error.value)
    assert not (tmp_path / "data").exists(), "nothing is begun"


# ---------------------------------------------------------------- settings


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("pv = 'FIC101.PV'", "loop FIC101, opcua.pv: is 'FIC101.PV', must be a node such as"),
        ("position_ = 'i=1'", "loop FIC101, opcua.position_: no such key; did you mean position?"),
        ("pv = 'i=1'\nu_ff = 'i=2'", "opcua.u_ff_limit: is required with u_ff: nothing is written without it"),
        ("pv = 'i=1'\nu_ff = 'i=2'\nu_ff_limit = 1\nu_ff_rate = 0", "opcua.u_ff_rate: is 0, must be > 0"),
        ("pv = 'i=1'\nsp = 'i=1'", "opcua.sp: i=1 is named twice"),
    ],
)
def test_tags_that_are_wrong(text, expected):
    with pytest.raises(InputError) as error:
        parse_settings(f"[loops.FIC101.opcua]\n{text}", "loops.toml", Path())
    assert str(error.value).startswith("loops.toml, loop FIC101") and expected in str(error.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "opcua.url: is required"),
        ("url = 'http://plant'", "opcua.url: is 'http://plant', must be an address such as opc.tcp://plant:4840"),
        ("url = 'opc.tcp://user:word@plant'", "opcua.url: has an @, must be an address such as opc.tcp://plant:4840;"),
        ("url = 'opc.tcp://p:99999'", "opcua.url: is 'opc.tcp://p:99999', must have a port from 0 to 65535"),
        ("url = 'opc.tcp://p:48x9'", "opcua.url: is 'opc.tcp://p:48x9', must have a port from 0 to 65535"),
        ("ulr = 'opc.tcp://p:1'", "opcua.ulr: no such key; did you mean url?"),
        ("url = 'opc.tcp://p:1'\nsecurty = 'None'", "opcua.securty: no such key; did you mean security?"),
        ("url = 'opc.tcp://p:1'\nsecurity = 'Basic128'", "opcua.security: is 'Basic128', must be one of"),
        ("url = 'opc.tcp://p:1'\nsecurity = 'Basic256Sha256'", "opcua.certificate: is required with security"),
        ("url = 'opc.tcp://p:1'\ncertificate = 'a'", "opcua.certificate: is given without a security policy"),
        ("url = 'opc.tcp://p:1'\nuser = 'a'", "opcua.user: is 'a' without a security policy"),
        ("url = 'opc.tcp://p:1'\ninterval = 0", "opcua.interval: is 0, must be > 0"),
        ("url = 'opc.tcp://p:1'\nqueue = 1", "opcua.queue: is 1, must be ≥ 100"),
    ],
)
def test_connections_that_are_wrong(tmp_path, text, expected):
    path = tmp_path / "loops.toml"
    path.write_text(f"[opcua]\n{text}\n[loops.A]\n")
    with pytest.raises(InputError) as error:
        read_connection(path)
    assert str(error.value).startswith(str(path)) and expected in str(error.value)


def test_a_file_without_a_connection(tmp_path):
    path = tmp_path / "loops.toml"
    path.write_text("[loops.A]\n")
    assert read_connection(path) is None


def test_files_are_beside_the_settings(tmp_path):
    path = tmp_path / "loops.toml"
    keys = "".join(f"{name} = 'pki/x'\n" for name in ("certificate", "private_key", "server_certificate"))
    path.write_text(f"[opcua]\nurl = 'opc.tcp://p:1'\nsecurity = 'Basic256Sha256'\n{keys}")
    assert read_connection(path).private_key == tmp_path / "pki/x"


def test_nodes_that_are_written_are_nothing_else():
    made = {"pv": "i=1", "sp": "i=2", "u_ff": "i=3", "u_ff_limit": 1, "u_ff_rate": 1}
    connection = Connection(url="opc.tcp://p:1", watchdog="i=9")
    for other, expected in (
        ({"pv": "i=3", "sp": "i=5"}, "loop B, opcua.pv: i=3 is also u_ff of A"),
        ({**made, "pv": "i=4"}, "loop B, opcua.u_ff: i=3 is also u_ff of A"),
        ({**made, "u_ff": "i=9"}, "loop B, opcua.u_ff: i=9 is also opcua.watchdog"),
        ({"sp": "i=5"}, "loop B, opcua.pv: is required to watch a loop"),
    ):
        with pytest.raises(InputError) as error:
            check_tags(connection, [Loop(name="A", opcua=made), Loop(name="B", opcua=other)])
        assert str(error.value) == expected


def test_the_help_names_every_fault(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.setattr(sys, "argv", ["glapp", "plant", "--help"])
    with pytest.raises(SystemExit):
        glapp.cli.main()
    printed = capsys.readouterr().out.partition("--fault")[2]  # "repaired" stands with --repair, too
    assert all(re.search(rf"\b{kind}\b", printed) for kind in (*FAULTS, "gone", "moved"))


def test_the_page_names_every_key_every_fault_and_all_that_is_told():
    page = (ROOT / "docs/plant.md").read_text(encoding="utf-8")
    [example] = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    [loop] = parse_settings(example, "plant.md", Path())
    check_tags(Connection(url="opc.tcp://p:1"), [loop])
    sources = [Path(module.__file__).read_text(encoding="utf-8") for module in (opcua, opcua_u_ff)]
    kinds = set(re.findall(r"_events\.(?:event|often|once)\(\s*\"(\w+)\"", "".join(sources)))
    assert len(kinds) > 20
    for word in (*Connection.model_fields, *Tags.model_fields, *FAULTS, *kinds):
        assert f"`{word}`" in page, word


# ---------------------------------------------------------------- the plant and the command line


@pytest.mark.slow
def test_a_plant_whose_time_is_behind_catches_up_and_wears():
    async def run():
        async with SimPlant(2, scan=600.0, speed=1e7, begin=10.0, history=1e7) as plant:
            begun = time.time()
            while plant.time < begun - 600.0:
                assert time.time() - begun < 120.0
                await asyncio.sleep(0.05)
            times = plant._records["FIC101", Signal.PV].times
            assert times[-1] <= time.time() and len(times) == pytest.approx(10 * 144, abs=3)
            return plant.width("FIC101"), plant.width("PIC102")

    assert asyncio.run(run()) == (pytest.approx(0.3 + 10 * 0.03, abs=0.001), 0.0)


def test_a_valve_that_is_repaired_wears_on_from_there():
    plant = SimPlant(2, scan=3600.0, begin=10.0, history=0.0, repair=4.0)

    async def widths():
        """True width of FIC101 after each scan."""
        found = []
        for _ in range(6 * 24):
            await plant._one()
            found.append(plant.width("FIC101"))
        assert plant.width("PIC102") == 0.0
        return found

    found = asyncio.run(widths())
    assert found[4 * 24 - 2] == pytest.approx(0.3 + 0.03 * (4 - 1 / 24))
    assert found[4 * 24 - 1] == pytest.approx(0.3) and found[-1] == pytest.approx(0.3 + 0.03 * 2)


def test_a_repair_on_request_leaves_a_tenth_of_the_gap():
    plant = SimPlant(5, scan=3600.0, history=0.0)

    async def widths():
        found = []
        for seconds in (None, 1e9, 0.0):
            if seconds is not None:
                plant.fault("repaired", "LIC104", seconds)
            await plant._one()
            found.append((plant.width("LIC104"), plant.width("TIC103")))
        return found

    assert asyncio.run(widths()) == [(2.0, 2.0), (0.2, 2.0), (2.0, 2.0)]


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ({"loops": 0}, "loops: is 0"),
        ({"scan": 0.0}, "scan: is 0.0, must be > 0"),
        ({"begin": -1}, "begin: is -1"),
        ({"repair": 0.0}, "repair: is 0.0, must be > 0"),
    ],
)
def test_plants_that_cannot_be(wrong, expected):
    with pytest.raises(InputError, match=expected):
        SimPlant(**wrong)


def test_a_fault_that_there_is_not():
    plant = SimPlant(1)
    with pytest.raises(InputError, match="fault: is 'fire', must be one of silent, bad"):
        plant.fault("fire")
    with pytest.raises(InputError, match="loop: there is no loop 'X'"):
        plant.fault("bad", "X")


@served
def test_browsing_finds_the_loops(shared):
    async def run(plant):
        return plant, await browse(Connection(url=plant.url))

    plant, found = shared(run)
    loops, without = loops_of((one.path, one.node) for one in found)
    assert list(loops) == plant.names
    assert loops["FIC101"]["pv"] == node("FIC101.PV") and "u_ff" not in loops["FIC101"]
    assert without == 9 * 3 + 1  # low, high and u_FF, and the watchdog
    spans, units = ({one.node: getattr(one, of) for one in found if getattr(one, of)} for of in ("span", "unit"))
    text = as_settings(Connection(url=plant.url), loops, ranges_of(loops, spans, units))
    made = parse_settings(text, "x", Path())
    assert [loop.opcua.pv for loop in made] == [node(f"{n}.PV") for n in loops]
    # Spans and units were left to be typed, though the server has them.
    assert {(loop.pv_span, loop.pv_unit, loop.op_span, loop.op_unit) for loop in made} == {
        ((0, 100), "%", (0, 100), "%")
    }


@pytest.mark.parametrize("known", [{"pv": "n", "op": "o"}, {"sp": "n", "pv": "p", "op": "o"}])
def test_spans_and_units_of_a_server_are_those_of_pv_and_op(known):
    """SP has the span of PV where PV has none; what no signal of the loop has is left to be filled in."""
    ranges = ranges_of({"A": known, "B": {"pv": "x"}}, {"n": (0.0, 50.0), "o": (4.0, 20.0)}, {"o": "mA"})
    assert ranges == {"A": {"pv_span": (0.0, 50.0), "op_span": (4.0, 20.0), "op_unit": "mA"}}
    text = as_settings(Connection(url="opc.tcp://p:1"), {"A": {"pv": "s=a", "sp": "s=b"}}, ranges)
    [loop] = parse_settings(text, "x", Path())
    assert (loop.pv_span, loop.op_span, loop.op_unit, loop.pv_unit) == ((0, 50), (4, 20), "mA", None)


@pytest.mark.parametrize("raw", [ua.Range(0.0, 0.0), ua.Range(5.0, 1.0), ua.Range(0.0, float("inf")), None, 5.0])
def test_a_range_that_nobody_has_filled_in_is_no_span(raw):
    assert span_of(raw) is None and unit_of(ua.EUInformation()) is None and unit_of(raw) is None


@pytest.mark.verify
def test_the_command_serves_a_plant_and_finds_its_tags(tmp_path):
    port = free_port()
    settings = tmp_path / "loops.toml"
    words = ["plant", "--loops", 2, "--port", port, "--settings", settings, "--fault", "0.1,bad,FIC101,9"]
    with subprocess.Popen([*map(str, [*GLAPP, *words])], stdout=subprocess.PIPE, text=True) as served:
        try:
            assert "2 loops at opc.tcp://127.0.0.1" in served.stdout.readline()
            assert served.stdout.readline() == "fault: bad in FIC101 for 9 s\n"
            look = [*map(str, [*GLAPP, "tags", f"opc.tcp://127.0.0.1:{port}", "--find", "fic"])]
            found = subprocess.run(look, capture_output=True, text=True, timeout=60, check=True)
            none = subprocess.run([*look[:-1], "TIC"], capture_output=True, text=True, timeout=60, check=False)
            assert none.returncode == 1
            assert "--find: no loop has 'TIC' in its name; there are FIC101, PIC102" in none.stderr
            served.send_signal(signal.SIGINT)
            assert served.wait(20) == 0
        finally:
            served.kill()
    assert f'pv = "{node("FIC101.PV")}"' in found.stdout and "PIC102" not in found.stdout
    assert [loop.name for loop in read_settings(settings)] == ["FIC101", "PIC102"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["plant", "--fault", "x"], "--fault: is 'x', must be AFTER,KIND[,LOOP[,SECONDS]]"),
        (["plant", "--fault", "1,fire"], "--fault: there is no 'fire'; there are"),
        (["plant", "--port", "0"], "--port: is 0, must be 1 to 65535"),
        (["tags", "plant"], "'plant' is neither opc.tcp://host:port nor a loops.toml"),
    ],
)
def test_wrong_command_lines(words, expected, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["glapp", *words])
    with pytest.raises(SystemExit) as end:
        glapp.cli.main()
    assert end.value.code == 2 and expected in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_line_starts_without_asyncua():
    look = "import sys, glapp, glapp.cli; print('asyncua' in sys.modules, 'cryptography' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "False False\n"


@pytest.mark.slow
def test_a_port_that_is_taken_and_a_server_that_is_not_there(monkeypatch, capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        monkeypatch.setattr(sys, "argv", ["glapp", "plant", "--loops", "1", "--port", str(port)])
        with pytest.raises(SystemExit) as end:
            glapp.cli.main()
    told = capsys.readouterr().err
    assert end.value.code == 1 and f"nobody can listen at opc.tcp://127.0.0.1:{port}/" in told
    assert told.rstrip().endswith("give another --port")
    monkeypatch.setattr(sys, "argv", ["glapp", "tags", f"opc.tcp://127.0.0.1:{port}"])
    with pytest.raises(SystemExit) as end:
        glapp.cli.main()
    assert end.value.code == 1 and "cannot be looked through: nobody listens there" in capsys.readouterr().err


@pytest.mark.slow
def test_without_the_extra_it_says_what_to_install():
    block = "import sys; sys.modules['asyncua'] = None; sys.argv = ['glapp', 'plant']; import glapp.cli as c; c.main()"
    done = subprocess.run([sys.executable, "-c", block], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and "pip install 'glapp[opcua]'" in done.stderr
