"""A simulated plant that other programs see by OPC UA: loops with noise, disturbances, wear, history and faults.

Every loop is a `glapp.modules.Graph`: controller, gap, process, noise. Around it here is the control
system: its tags, its history, its feed-forward input with a watchdog, and what can go wrong with them.

Needs the extra `glapp[opcua]`.
"""

from __future__ import annotations

import asyncio
import bisect
import contextlib
import math
import random
import socket
import time
from array import array
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from types import TracebackType
from typing import Any, Self

import numpy as np
from asyncua import Server, ua, uamethod
from asyncua.common.callback import CallbackType
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.history import HistoryManager, HistoryStorageInterface
from numpy.typing import NDArray

from ..errors import InputError
from ..modules import Backlash, Graph, Input, Mode, Module, Noise, Pid, Plant, ProcessSim, Sum
from .security import Security, secure
from .signal import Signal

__all__ = ["FAULTS", "NAMESPACE", "Kind", "Security", "SimLoop", "SimPlant", "free_port"]

NAMESPACE = "urn:glapp:plant"
"""URI of the namespace of the tags."""

FAULTS = {
    "silent": "no more values of the loop, neither live nor in the history",
    "bad": "PV has the status BadSensorFailure",
    "stuck": "PV stands still with fresh time stamps",
    "future": "PV comes with time stamps an hour ahead",
    "late": "after each PV comes the one of five scans ago",
    "duplicate": "each PV comes twice",
    "type": "PV is a String",
    "back": "time stamps are an hour behind what they were",
    "manual": "the controller is in manual",
    "repaired": "the gap is a tenth of what it was",
    "writer": "somebody else writes u_FF, 1 % above the present value",
}
"""Name of each fault that a loop can have, and its meaning."""

_DAY = 86_400.0
_HOUR = 3600.0
_SLICE = 50  # loops between two chances for others to run


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of loop; times in scans, everything else in % of span.

    - `prefix`: what its name begins with.
    - `k`, `ti`: of its controller.
    - `process`: a `ProcessSim`, or an integrating `Plant`.
    - `d`: total width of the gap at the beginning.
    - `wear`: what is added to it in a day.
    - `noise`: amplitude of the noise of PV.
    - `step`: how far the load is from its middle after a step at most, and ...
    - `often`: ... number of Ti between two steps, on average.
    - `moves`: how far SP is from 50 at most; it moves once in 300 Ti, on average.
    - `swing`: amplitude and period of a sine in the load.
    - `area`, `valve`: for `loops.toml`.
    """

    prefix: str
    k: float
    ti: float
    process: Module
    d: float
    wear: float
    noise: float
    step: float
    often: float = 30.0
    moves: float = 3.0
    swing: tuple[float, float] | None = None
    area: str | None = None
    valve: str | None = None


def _kinds(h: float) -> list[Kind]:
    """Kinds of simulated loops."""

    def lags(gain: float, t1: float, t2: float, dead: float) -> Module:
        return ProcessSim(gain=gain, t1=t1 * h, t2=t2 * h, dead_time=dead * h, start=50.0)

    level = Plant(([0.01], [h, 0.0]), start=50.0)
    return [
        Kind("FIC", 0.6, 6.0, lags(1.0, 4.0, 1.0, 1.0), 0.3, 0.03, 0.05, 4.0),
        Kind("PIC", 2.0, 20.0, lags(0.8, 20.0, 4.0, 2.0), 0.0, 0.0, 0.05, 5.0),
        Kind("TIC", 1.5, 60.0, lags(1.2, 60.0, 15.0, 8.0), 2.0, 0.0, 0.05, 8.0),
        # Tuned tightly, and always moved a little: the one loop here that cycles by its gap.
        Kind("LIC", 8.0, 40.0, level, 2.0, 0.0, 0.01, 3.0, often=8.0),
        Kind("FIC", 0.6, 6.0, lags(1.0, 4.0, 1.0, 1.0), 0.0, 0.0, 0.1, 4.0),
    ]


class SimLoop:
    """One loop: its graph, and what happens to it.

    - `number`: its place in the plant, from 0.
    - `kind`: what it is.
    - `h`: scan time, > 0 [s].
    - `seed`: of noise and disturbances.

    - `name`: its name.
    - `age`: how long its valve had worn when the plant's time began [d].

    Examples
    --------
    >>> flow = Kind("FIC", 0.6, 6.0, ProcessSim(gain=1.0, t1=4.0, start=50.0), 2.0, 0.0, 0.1, 4.0)
    >>> loop = SimLoop(0, flow, 1.0, seed=1)
    >>> sp, pv, op, valve = loop.record(3600)
    >>> loop.name, len(pv), bool(abs(op - valve).max() <= 1.0 + 1e-9)
    ('FIC101', 3600, True)
    """

    def __init__(self, number: int, kind: Kind, h: float, seed: int) -> None:
        self.name = f"{kind.prefix}{101 + number}"
        self.kind = kind
        self.age = 0.0
        self._rest = -50.0 if isinstance(kind.process, Plant) else 50.0 / _gain(kind.process) - 50.0
        modules: dict[str, Module] = {
            "sp": Input(50.0),
            "ff": Input(),
            "load": Input(self._rest),
            "pid": Pid(k=kind.k, ti=kind.ti * h, low=0.0, high=100.0, start=50.0, start_pv=50.0),
            "gap": Backlash(kind.d, start=50.0),
            "process": kind.process,
            "noise": Noise(kind.noise, seed=seed * 10_007 + number),
        }
        wires = ["sp -> pid.sp", "ff -> pid.ff", "pid -> gap -> process -> noise -> pid.pv"]
        if kind.swing is None:
            wires += ["load -> process.load"]
        else:
            size, period = kind.swing
            w2 = (2.0 * math.pi / (period * h)) ** 2  # an oscillator without damping, pushed once: size·(1 − cos ωt)
            modules |= {"push": Input(size), "swing": Plant(([w2], [1.0, 0.0, w2])), "all": Sum()}
            wires += ["push -> swing -> all", "load -> all.plus", "all -> process.load"]
        self.graph = Graph(h, modules, wires)
        self._random = random.Random(seed * 10_007 + number)
        self._scan = 0
        self._next_load, self._next_sp = self._wait(kind.often), self._wait(300)
        self.faults: dict[str, float] = {}

    def _wait(self, times: float) -> int:
        """Scans until an event that comes every `times` integral times on average."""
        return self._scan + 1 + int(self._random.expovariate(1.0 / (times * self.kind.ti)))

    def _happen(self, days: float) -> None:
        """Changes before the next scan: load, setpoint, wear."""
        graph, kind = self.graph, self.kind
        if self._scan >= self._next_load:
            graph["load.value"] = self._rest + self._random.uniform(-kind.step, kind.step)
            self._next_load = self._wait(kind.often)
        if self._scan >= self._next_sp:
            graph["sp.value"] = 50.0 + self._random.uniform(-kind.moves, kind.moves)
            self._next_sp = self._wait(300)
        if kind.d:
            graph["gap.d"] = (kind.d + kind.wear * (days + self.age)) * (0.1 if "repaired" in self.faults else 1.0)

    def record(self, scans: int) -> tuple[NDArray[np.float64], ...]:
        """SP, PV, OP and position of `scans` scans, the same as by `scan`; the valve does not wear meanwhile."""
        columns: list[list[NDArray[np.float64]]] = [[], [], [], []]
        end = self._scan + scans
        while self._scan < end:
            self._happen(0.0)
            n = min(self._next_load, self._next_sp, end) - self._scan
            found = self.graph.run(n * self.graph.h, record=["sp", "noise", "pid", "gap"])
            for column, name in zip(columns, ("sp", "noise", "pid", "gap"), strict=True):
                column.append(found[name])
            self._scan += n
        return tuple(np.concatenate(column) if column else np.empty(0) for column in columns)

    def scan(self, days: float, u_ff: float) -> dict[Signal, float]:
        """One scan; the values of the tags after it."""
        graph = self.graph
        self._happen(days)
        graph["pid.mode"] = Mode.MANUAL if "manual" in self.faults else Mode.EXTERNAL
        graph["ff.value"] = u_ff
        graph.scan()
        self._scan += 1
        op = graph["pid"]
        return {
            Signal.SP: graph["sp"],
            Signal.PV: graph["noise"],
            Signal.OP: op,
            Signal.MODE: 0.0 if "manual" in self.faults else 1.0,
            Signal.LOW: float(op <= 0.0),
            Signal.HIGH: float(op >= 100.0),
            Signal.POSITION: graph["gap"],
        }

    @property
    def width(self) -> float:
        """Total width of the gap now [% of OP]."""
        return float(self.graph["gap.d"])


def _gain(process: Module) -> float:
    assert isinstance(process, ProcessSim)
    return process.gain


class _Users:
    """Users that may connect, by name and password."""

    def __init__(self, users: Mapping[str, str]) -> None:
        self._users = users

    def get_user(
        self, iserver: Any, username: str | None = None, password: str | None = None, certificate: Any = None
    ) -> User | None:
        """The user, or None to refuse."""
        if username is None or self._users.get(username) != password:
            return None
        return User(role=UserRole.User, name=username)


class _Record:
    """History of one tag: times and values, ascending; older ones are forgotten."""

    __slots__ = ("times", "values")

    def __init__(self) -> None:
        self.times, self.values = array("d"), array("d")

    def add(self, t: float, value: float, keep: float) -> None:
        """Add a value, and forget those older than `keep` seconds."""
        self.times.append(t)
        self.values.append(value)
        if len(self.times) % 1024 == 0 and (old := bisect.bisect_left(self.times, t - keep)) > 1024:
            del self.times[: old - 1], self.values[: old - 1]  # the last value before stays: it still holds


class _History(HistoryStorageInterface):  # type: ignore[misc]
    """HistoryRead of the plant's own records. A value that is not a number was bad."""

    def __init__(self, most: int) -> None:
        super().__init__(most)
        self.records: dict[ua.NodeId, _Record] = {}
        self.types: dict[ua.NodeId, ua.VariantType] = {}

    async def init(self) -> None:
        """Does nothing: no connection to open."""

    async def stop(self) -> None:
        """Does nothing: no connection to close."""

    async def read_node_history(
        self, node_id: ua.NodeId, start: datetime | None, end: datetime | None, nb_values: int
    ) -> tuple[list[ua.DataValue], datetime | None]:
        """Values from `start` to `end`, both inclusive, and where to go on."""
        record = self.records.get(node_id)
        if record is None or start is None or end is None:
            return [], None
        first = bisect.bisect_left(record.times, start.timestamp() - 1e-7)
        last = bisect.bisect_right(record.times, end.timestamp() + 1e-7)
        most = min(nb_values or self.max_history_data_response_size, self.max_history_data_response_size)
        more = record.times[first + most] if first + most < last else None
        kind = self.types[node_id]
        values = [_data_value(record.times[i], record.values[i], kind) for i in range(first, min(last, first + most))]
        return values, None if more is None else datetime.fromtimestamp(more, UTC)


class _Histories(HistoryManager):  # type: ignore[misc]
    """A history that gives no values to a client that gives continuation points back; asyncua reads it in any case."""

    async def read_history(self, params: ua.HistoryReadParameters) -> list[ua.HistoryReadResult]:
        """Results, one for each node."""
        if params.ReleaseContinuationPoints:
            return [ua.HistoryReadResult() for _ in params.NodesToRead]
        results: list[ua.HistoryReadResult] = await super().read_history(params)
        return results


class _Held(ua.DataValue):  # type: ignore[misc]
    """A value that nobody changes: asyncua copies it for every subscription, which took most of a scan."""

    __slots__ = ()

    def __deepcopy__(self, memo: object) -> Self:
        return self


def _data_value(t: float, value: float, kind: ua.VariantType, status: int = ua.StatusCodes.Good) -> ua.DataValue:
    """A value in the form of OPC UA."""
    if math.isnan(value):
        status = ua.StatusCodes.BadSensorFailure
    bad = bool(status & 0x8000_0000)
    variant = ua.Variant(None, ua.VariantType.Null) if bad else ua.Variant(_PYTHON[kind](value), kind)
    return _Held(variant, ua.StatusCode(status), datetime.fromtimestamp(t, UTC), datetime.now(UTC))


_PYTHON = {ua.VariantType.Double: float, ua.VariantType.Int32: int, ua.VariantType.Boolean: bool}
_TYPES = {
    Signal.MODE: ua.VariantType.Int32,
    Signal.LOW: ua.VariantType.Boolean,
    Signal.HIGH: ua.VariantType.Boolean,
}
_STEADY = {Signal.SP, Signal.MODE, Signal.LOW, Signal.HIGH, Signal.U_FF}  # sent when they change
_NAMES = {signal: signal.name for signal in Signal}


def free_port() -> int:
    """A port of this machine that nobody listens at."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


class SimPlant:
    """A simulated plant with its OPC UA server.

    - `loops`: how many, 1 to 10 000: flow, pressure, temperature, level, a sound flow, and again. Or the loops
      themselves.
    - `scan`: scan time [s of the plant], > 0. All time constants go by it.
    - `speed`: seconds of the plant per second, > 0, until it has caught up with the clock on the wall; then 1.
    - `begin`: how many days ago the plant's time begins, ≥ 0: no time stamp is ever ahead of the clock.
    - `seed`: of noise and disturbances.
    - `port`: where it listens; 0 for any free one.
    - `host`: the address it listens at.
    - `history`: how much HistoryRead has [s of the plant]; 0: the server has none.
    - `fresh`: whether SP, mode and limit flags get a new time stamp in every scan, too.
    - `watchdog`: how long the node Watchdog may stand still before u_FF is ramped to 0 [s].
    - `ramp`: how long that takes [s].
    - `security`: certificates and users.
    - `most`: values in one answer of HistoryRead.
    - `repair`: after how many days of the plant's time the valves that wear are repaired, > 0: their gap is that of the
      beginning, and wears on from there.

    - `follow`: awaited after every scan, with the plant's time: there a plant that hurries waits for who must keep up
      with it.

    Examples
    --------
    >>> plant = SimPlant(5)  # `async with plant:` serves it
    >>> plant.names, plant.width("TIC103")
    (['FIC101', 'PIC102', 'TIC103', 'LIC104', 'FIC105'], 2.0)
    """

    def __init__(
        self,
        loops: int | Sequence[SimLoop] = 5,
        *,
        scan: float = 1.0,
        speed: float = 1.0,
        begin: float = 0.0,
        seed: int = 1,
        port: int = 0,
        host: str = "127.0.0.1",
        history: float = _HOUR,
        fresh: bool = False,
        watchdog: float = 10.0,
        ramp: float = 30.0,
        security: Security | None = None,
        most: int = 10_000,
        repair: float | None = None,
    ) -> None:
        positive = {"scan": scan, "speed": speed, "watchdog": watchdog, "repair": 1.0 if repair is None else repair}
        for name, value in positive.items():
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"is {value}, must be > 0", parameter=name, value=value, bound="> 0")
        for name, value in (("begin", begin), ("history", history), ("ramp", ramp)):
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"is {value}, must be ≥ 0", parameter=name, value=value, bound="≥ 0")
        number = loops if isinstance(loops, int) else len(loops)
        if not 1 <= number <= 10_000:
            raise InputError(f"is {number}, must be 1 to 10000", parameter="loops", value=number, bound="1 to 10000")
        self._scan, self._speed, self._fresh = scan, speed, fresh
        self._host, self._port = host, port or free_port()
        self._keep, self._watchdog, self._ramp = history, watchdog, ramp
        self._security = security or Security()
        if isinstance(loops, int):
            kinds = _kinds(scan)
            loops = [SimLoop(i, kinds[i % len(kinds)], scan, seed) for i in range(loops)]
        self._loops = {loop.name: loop for loop in loops}
        self._now = begin == 0.0
        self._begin = math.floor((time.time() - begin * _DAY) / scan) * scan
        self._scans = 0
        self._most = most
        self._repair = math.inf if repair is None else repair
        self.follow: Callable[[float], Awaitable[None]] | None = None
        self._records: dict[tuple[str, Signal], _Record] = {}
        self._last = {(name, Signal.U_FF): (self._begin, 0.0) for name in self._loops}  # time and value of each tag
        self._recent: dict[str, list[tuple[float, float]]] = {}
        self._ids: dict[tuple[str, Signal], ua.NodeId] = {}
        self._u_ff = dict.fromkeys(self._loops, 0.0)
        self._slope: dict[str, float] = {}
        self._heartbeats: tuple[object, float] = (None, -math.inf)
        self._server: Server | None = None
        self._namespaces = 0
        self._task: asyncio.Task[None] | None = None

    @property
    def url(self) -> str:
        """URL of the server."""
        return f"opc.tcp://{self._host}:{self._port}/glapp/plant"

    @property
    def names(self) -> list[str]:
        """Names of the loops."""
        return list(self._loops)

    @property
    def time(self) -> float:
        """The plant's own time [s since 1970 UTC]."""
        return self._begin + self._scans * self._scan

    def width(self, loop: str) -> float:
        """True width of a loop's gap now [% of OP]."""
        return self._loop(loop).width

    def u_ff(self, loop: str) -> float:
        """The feed-forward that the controller adds now [% of OP]."""
        return self._u_ff[loop]

    def settings(self) -> str:
        """Text of a loops.toml for it."""
        lines = ["[defaults]", "pv_span = [0, 100]", 'pv_unit = "%"', "op_span = [0, 100]", "auto_values = [1]", ""]
        lines += ["[opcua]", f'url = "{self.url}"', f'watchdog = "{_text("Watchdog")}"', ""]
        # Rate in seconds on the wall; a service takes ten times OP's range.
        rate = min(0.5 * self._speed, 10.0 * 100.0)
        for loop in self._loops.values():
            kind, name = loop.kind, loop.name
            lines += [f"[loops.{name}]", f"controller = {{ k = {kind.k:g}, ti = {kind.ti * self._scan:g} }}"]
            if isinstance(kind.process, Plant):
                lines += ['process = { type = "integrating" }']
            else:
                lines += [f"process = {{ kp = {_gain(kind.process):g} }}"]
            lines += [f'{key} = "{x}"' for key, x in (("area", kind.area), ("valve", kind.valve)) if x is not None]
            lines += ["", f"[loops.{name}.opcua]"]
            tags = [s for s in Signal if s is not Signal.POSITION]
            lines += [f'{signal} = "{_text(f"{name}.{_NAMES[signal]}")}"' for signal in tags]
            lines += ["u_ff_limit = 3.0", f"u_ff_rate = {rate:g}", ""]
        return "\n".join(lines)

    def fault(self, kind: str, loop: str | None = None, seconds: float = math.inf) -> None:
        """Begin a fault in a loop, or in all, for a number of seconds; 0 ends it.

        Raises InputError for a fault or a loop that there is not.
        """
        if kind not in FAULTS:
            raise InputError(f"is {kind!r}, must be one of {', '.join(FAULTS)}", parameter="fault", value=kind)
        until = time.monotonic() + seconds
        for one in self._loops.values() if loop is None else [self._loop(loop)]:
            if seconds > 0:
                one.faults[kind] = until
            else:
                one.faults.pop(kind, None)

    def _loop(self, name: str) -> SimLoop:
        if name not in self._loops:
            raise InputError(f"there is no loop {name!r}", parameter="loop", value=name)
        return self._loops[name]

    async def failure(self) -> None:
        """Wait as long as the simulation runs; raise the error that it ends with."""
        if self._task is not None:
            await asyncio.shield(self._task)

    async def __aenter__(self) -> Self:
        if self._server is None:
            await self.open()
        self._task = asyncio.create_task(self._run())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
        await self.close()

    async def open(self, *, namespaces: int = 0) -> None:
        """Begin to serve, again after `close`.

        - `namespaces`: how many other namespaces come before the plant's own: its index moves on by as many.
        """
        users = self._security.users
        server = Server(user_manager=_Users(users) if users else None)
        await server.init()
        server.set_server_name("glapp plant")
        server.set_endpoint(self.url)
        await secure(server, self._security)
        for i in range(namespaces):
            await server.register_namespace(f"urn:glapp:other:{i}")
        index = await server.register_namespace(NAMESPACE)
        history = _History(self._most)
        server.iserver.history_manager = _Histories(server.iserver)
        server.iserver.history_manager.set_storage(history)
        await self._tags(server, index, history)
        server.subscribe_server_callback(CallbackType.PreWrite, self._stamp)
        await server.start()
        self._server = server
        for key, (t, value) in self._last.items():
            await self._write(key, t, value)

    async def close(self) -> None:
        """Stop serving; the plant itself and its history go on."""
        server, self._server = self._server, None
        if server is not None:
            await server.stop()

    def _stamp(self, written: Any, _: Any) -> None:
        """Time stamp for others' values in the time of a fast plant: after the last scan, and before the next one."""
        if written.is_external and time.time() - self.time > 2.0 * self._scan:
            at = datetime.fromtimestamp(self.time + 0.5 * self._scan, UTC)
            for one in written.request_params.NodesToWrite:
                one.Value = replace(one.Value, SourceTimestamp=at)

    async def _tags(self, server: Server, index: int, history: _History) -> None:
        """Create the nodes of all loops."""
        self._ids = {}
        percent = ua.EUInformation(DisplayName=ua.LocalizedText("%"))
        for loop in self._loops.values():
            folder = await server.nodes.objects.add_folder(ua.NodeId(loop.name, index), f"{index}:{loop.name}")
            for signal in Signal:
                kind = _TYPES.get(signal, ua.VariantType.Double)
                node_id = ua.NodeId(f"{loop.name}.{_NAMES[signal]}", index)
                first = ua.Variant(_PYTHON[kind](0), kind)
                node = await folder.add_variable(node_id, f"{index}:{_NAMES[signal]}", first)
                if signal in (Signal.SP, Signal.PV, Signal.OP):  # in % of spans that are 0 to 100
                    for name, said in (("EURange", ua.Range(0.0, 100.0)), ("EngineeringUnits", percent)):
                        described = ua.NodeId(f"{node_id.Identifier}.{name}", index)
                        await node.add_property(described, ua.QualifiedName(name), said)
                key = (loop.name, signal)
                self._ids[key] = node_id
                record = self._records.setdefault(key, _Record())
                if signal is Signal.U_FF:
                    await node.set_writable()
                if self._keep > 0:
                    await node.set_attr_bit(ua.AttributeIds.AccessLevel, ua.AccessLevel.HistoryRead)
                    await node.set_attr_bit(ua.AttributeIds.UserAccessLevel, ua.AccessLevel.HistoryRead)
                    history.records[node_id], history.types[node_id] = record, kind
                waiting = ua.StatusCodes.BadWaitingForInitialData
                await server.write_attribute_value(node_id, _data_value(self.time, 0.0, kind, waiting))
        self._heartbeat_id = ua.NodeId("Watchdog", index)
        heartbeat = await server.nodes.objects.add_variable(
            self._heartbeat_id, f"{index}:Watchdog", ua.Variant(0, ua.VariantType.UInt32)
        )
        await heartbeat.set_writable()

        @uamethod  # type: ignore[untyped-decorator]
        def fault(parent: ua.NodeId, kind: str, loop: str, seconds: float) -> str:
            try:
                self.fault(kind, loop or None, seconds)
            except InputError as error:
                return str(error)
            return ""

        text, number = ua.VariantType.String, ua.VariantType.Double
        await server.nodes.objects.add_method(
            ua.NodeId("Fault", index), f"{index}:Fault", fault, [text, text, number], [text]
        )

    async def _run(self) -> None:
        """Run the simulation in real time, until cancelled."""
        begun, waited = time.monotonic(), 0.0
        behind = time.time() - self._begin
        ahead = behind if self._now else 0.0
        while True:
            passed = time.monotonic() - begun
            due = min(self._speed * (passed - waited) + ahead, behind + passed)  # the plant's time since it began
            while (self._scans + 1) * self._scan <= due:
                await self._one()
                if self.follow is not None:
                    scanned = time.monotonic()
                    await self.follow(self.time)
                    waited += time.monotonic() - scanned
            await asyncio.sleep(min(max(self._scan / self._speed, 0.001), 0.05))

    async def _one(self) -> None:
        """One scan of every loop."""
        self._scans += 1
        t, now = self.time, time.monotonic()
        days = (t - self._begin) / _DAY
        if days >= self._repair:
            days -= self._repair
        alive = self._alive(now)
        for i, loop in enumerate(self._loops.values()):
            if i % _SLICE == 0:
                await asyncio.sleep(0)
            for kind in [kind for kind, until in loop.faults.items() if now >= until]:
                del loop.faults[kind]
            await self._feed_forward(loop, alive, t)
            values = loop.scan(days, self._u_ff[loop.name])
            if "silent" not in loop.faults:
                await self._tell(loop, values, t)

    def _alive(self, now: float) -> bool:
        """Whether the watchdog's count has changed within its time limit."""
        if self._server is not None:
            seen = self._server.iserver.aspace.read_attribute_value(self._heartbeat_id, ua.AttributeIds.Value)
            heartbeat = seen.Value.Value if seen.Value is not None else None
            if heartbeat != self._heartbeats[0]:
                self._heartbeats = (heartbeat, now if self._heartbeats[0] is not None else -math.inf)
        return now - self._heartbeats[1] <= self._watchdog

    async def _feed_forward(self, loop: SimLoop, alive: bool, t: float) -> None:
        """The control system's part with u_FF: it takes the written value, and ramps it out without a heartbeat."""
        key = (loop.name, Signal.U_FF)
        old = value = found = self._u_ff[loop.name]
        if self._server is not None:
            seen = self._server.iserver.aspace.read_attribute_value(self._ids[key], ua.AttributeIds.Value)
            found = float(seen.Value.Value) if seen.Value is not None and seen.Value.Value is not None else math.nan
            value = found if math.isfinite(found) else 0.0
            written = seen.SourceTimestamp or seen.ServerTimestamp
            t = t if written is None else max(t, written.timestamp() + 0.001)
        if "writer" in loop.faults:
            value = old + 1.0
            del loop.faults["writer"]
        elif value == 0.0:
            self._slope.pop(loop.name, None)
        elif not alive or loop.name in self._slope:  # once begun it goes on to 0: who was away finds it out there
            steps = max(1.0, self._ramp * self._speed / self._scan)
            slope = self._slope.setdefault(loop.name, abs(value) / steps)
            value = math.copysign(max(0.0, abs(value) - slope), value) if abs(value) > slope else 0.0
        if value != old:
            self._u_ff[loop.name] = value
            self._last[key] = (t, value)
            if self._keep > 0:
                self._records[key].add(t, value, self._keep)
        if value != found:  # what somebody wrote is there already, with its time
            await self._write(key, t, value)

    async def _tell(self, loop: SimLoop, values: Mapping[Signal, float], t: float) -> None:
        """Write the values of a scan to the nodes."""
        faults = loop.faults
        if "back" in faults:
            t -= _HOUR
        for signal, value in values.items():
            key = (loop.name, signal)
            _, last = self._last.get(key, (t, None))
            if signal is Signal.PV:
                if "stuck" in faults and last is not None:
                    value = last
                if "bad" in faults:
                    value = math.nan
            elif signal in _STEADY and value == last and not self._fresh:
                continue
            self._last[key] = (t, value)
            if self._keep > 0 and "back" not in faults:
                self._records[key].add(t, value, self._keep)
            if signal is Signal.PV and faults:
                await self._faulty(loop, key, value, t)
            else:
                await self._write(key, t, value)

    async def _faulty(self, loop: SimLoop, key: tuple[str, Signal], value: float, t: float) -> None:
        """Write a value with the simulated fault of its loop: of another type, in the future, twice or late."""
        faults = loop.faults
        if "type" in faults:
            await self._as(key, ua.VariantType.String, t, f"{value:.3f}")
            return
        await self._write(key, t + (_HOUR if "future" in faults else 0.0), value)
        if "duplicate" in faults:
            await self._write(key, t, value, ua.StatusCodes.GoodClamped)
        recent = self._recent.setdefault(loop.name, [])
        recent.append((t, value))
        if len(recent) > 5:
            late = recent.pop(0)
            if "late" in faults:
                await self._write(key, *late)

    async def _write(self, key: tuple[str, Signal], t: float, value: float, status: int = ua.StatusCodes.Good) -> None:
        if self._server is None:
            return
        kind = _TYPES.get(key[1], ua.VariantType.Double)
        done = await self._server.iserver.aspace.write_attribute_value(
            self._ids[key], ua.AttributeIds.Value, _data_value(t, value, kind, status)
        )
        if done.value == ua.StatusCodes.BadTypeMismatch:  # it was a String until now
            await self._as(key, kind, t, _PYTHON[kind](value))

    async def _as(self, key: tuple[str, Signal], kind: ua.VariantType, t: float, value: object) -> None:
        """Write a value of another type, and change the type of the tag."""
        if self._server is None:
            return
        node_id, aspace = self._ids[key], self._server.iserver.aspace
        of_type = ua.DataValue(ua.Variant(ua.NodeId(kind.value), ua.VariantType.NodeId))
        await aspace.write_attribute_value(node_id, ua.AttributeIds.DataType, of_type)
        held = aspace[node_id].attributes[ua.AttributeIds.Value]
        held.value = None
        at = datetime.fromtimestamp(t, UTC)
        changed = ua.DataValue(ua.Variant(value, kind), ua.StatusCode(ua.StatusCodes.Good), at, datetime.now(UTC))
        await aspace.write_attribute_value(node_id, ua.AttributeIds.Value, changed)


def _text(identifier: str) -> str:
    return f"nsu={NAMESPACE};s={identifier}"
