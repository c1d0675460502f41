"""A lake to try the fleet on: hundreds of simulated loops whose valves are known, and bad data of every kind.

::

    LAKE/historian/day=2025-10-01/part-0.parquet   long, times in UTC, qualities Good and Bad
    LAKE/opc/day=2025-10-01/part-0.parquet         long, local times without a zone, values as text, qualities of OPC DA
    LAKE/platform/loop=FIC107/2025-10-01.parquet   wide, qualities of OPC UA
    LAKE/loops.csv                                 settings and asset hierarchy, a row a loop
    LAKE/_truth/loops.parquet                      what is true of every valve; no reader looks here
    LAKE/_truth/problems.parquet                   what is wrong with the lake, by the code that has to be found

Every day of a loop is a run of `glapp.simulate` that begins at rest at midnight UTC; the gap of a valve that wears is
that of its day. The same arguments give the same files, but for the times that the file system gives them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from random import Random
from typing import Any, Literal
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ..controller import Controller
from ..errors import InputError
from ..plant import Plant
from ..recording import NOT_AUTO
from ..scenario import Friction, Manual, Scenario, Sine, Steps, Uniform, Walk
from ..simulate import Simulation, run_many
from ..writing import write_file

__all__ = ["BEGIN", "STEP", "make_demo"]

BEGIN = date(2025, 10, 1)
"""First day; the clocks of the plant go back on the 26th."""

STEP = 5
"""Time between two samples that the historian keeps [s]; the loops run at 1 s."""

_ZONE = "Europe/Stockholm"
_SECONDS = 86_400
_AT_ONCE = 16
"""Loops that are simulated at once: a day of one takes 4 MB."""

Kind = Literal["sound", "restless", "swinging", "tight", "gap", "small", "wear", "sticking", "both"]
Site = Literal["historian", "opc", "platform"]
Record = Literal["good", "no_op", "compressed", "coarse", "manual"]

_AREAS = ("Wood yard", "Digester", "Bleaching", "Recovery", "Paper machine 1", "Paper machine 2")
_LETTERS = ("FIC", "PIC", "TIC", "QIC")
# Number of valves of each kind in a hundred, by how well they are built.
_KINDS: dict[str, dict[Kind, int]] = {
    "globe": dict(sound=34, restless=16, swinging=8, tight=4, gap=12, small=14, wear=6, sticking=4, both=2),
    "segment": dict(sound=28, restless=14, swinging=8, tight=4, gap=18, small=10, wear=10, sticking=4, both=4),
    "butterfly": dict(sound=14, restless=10, swinging=6, tight=4, gap=30, small=6, wear=16, sticking=6, both=8),
}


@dataclass(frozen=True, slots=True)
class _Loop:
    """One loop as it was drawn."""

    name: str
    area: str
    valve: str
    positioner: str
    kind: Kind
    site: Site
    record: Record
    d: tuple[float, float]  # gap on the first and on the last day [%]
    friction: tuple[float, float]  # stick band s and jump j [%]
    kp: float
    lags: tuple[float, ...]
    dead_time: float
    integrating: bool
    k: float
    ti: float
    noise: float
    walk: float
    steps: float
    swing: tuple[float, float]  # amplitude [%] and period [s]
    moves: int  # setpoint changes a day
    sp: float
    op: float  # position of the valve without loads [%]
    known: bool  # whether the settings have K and Ti

    def gap(self, day: int, days: int) -> float:
        """Width of its gap on a day [%]."""
        begin, end = self.d
        return begin + (end - begin) * (day / (days - 1) if days > 1 else 1.0)

    @property
    def dead_band(self) -> float:
        """Move of OP after a turn before the valve moves, on the last day [%]."""
        return self.d[1] + self.friction[0]

    def scenario(self, day: int, days: int, seed: int) -> Scenario:
        """A day of it."""
        random = Random(f"{seed}/{self.name}/{day}")
        den = [1.0]
        for lag in self.lags:
            den = list(np.polymul(den, [lag, 1.0]))
        if self.integrating:
            den = [*den, 0.0]
        load: list[Any] = [Walk(rate=self.walk)] if self.walk else []
        if self.steps:
            at = sorted(random.uniform(600, _SECONDS) for _ in range(random.randint(6, 14)))
            load.append(Steps(steps=tuple((t, random.uniform(-self.steps, self.steps)) for t in at)))
        if self.swing[0]:
            load.append(Sine(amplitude=self.swing[0], period=self.swing[1], t=random.uniform(0, self.swing[1])))
        at = sorted({round(random.uniform(900, _SECONDS)) for _ in range(self.moves)})
        setpoint = [(0.0, self.sp), *((float(t), self.sp + random.uniform(-2.5, 2.5)) for t in at)]
        # The valve is near its middle, whatever the setpoint: a load makes up for the rest.
        balance = Steps(steps=((0.0, (0.0 if self.integrating else self.sp / self.kp) - self.op),))
        return Scenario(
            name=self.name,
            plant=Plant([self.kp], [float(c) for c in den], self.dead_time),
            controller=Controller(k=self.k, ti=self.ti),
            d=self.gap(day, days),
            friction=Friction(model="kano", s=self.friction[0], j=self.friction[1]) if self.friction[0] else None,
            noise=(Uniform(amplitude=self.noise),),
            setpoint=(Steps(steps=tuple(setpoint)),),
            load=(balance, *load),
            limits=(0.0, 100.0),
            manual=(Manual(begin=0.0, end=float(_SECONDS)),) if self.record == "manual" else (),
            h=1.0,
            t_end=float(_SECONDS - 1),
            seed=random.getrandbits(32),
        )


def make_demo(
    lake: str | Path,
    *,
    loops: int = 200,
    days: int = 30,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a lake of simulated loops, with the truth about their valves next to it.

    Parameters
    ----------
    lake : str or Path
        Folder, which must be empty or not there yet.
    loops : int
        Number of loops, 10 to 10 000.
    days : int
        Days of history, 1 to 3660; a loop and day takes some 70 kB.
    seed : int
        Seed of the simulated mill.
    progress : callable, optional
        Called with how many days of how many are written.

    Returns
    -------
    Path
        The lake.

    Raises
    ------
    InputError
        For a number out of its bounds, or a folder that holds something.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     lake = make_demo(folder + "/lake", loops=10, days=1)
    ...     sorted(path.name for path in lake.iterdir())[:3]
    ['_truth', 'historian', 'loops.csv']
    """
    lake = Path(lake)
    for name, value, most in (("loops", loops, 10_000), ("days", days, 3660)):
        least = 10 if name == "loops" else 1
        if not least <= value <= most:
            bound = f"{least} to {most}"
            raise InputError(f"is {value}, must be {bound}", parameter=name, value=value, bound=bound)
    if lake.exists() and (not lake.is_dir() or any(lake.iterdir())):
        raise InputError("exists already and holds something", file=str(lake), hint="name a folder of your own")
    drawn = [_random_loop(i, seed) for i in range(loops)]
    (lake / "_truth").mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(max(1, (os.cpu_count() or 1) // 2)) as pool:
        jobs = [pool.submit(_write_day, lake, drawn, day, days, seed) for day in range(days)]
        for done, job in enumerate(jobs, start=1):
            job.result()
            if progress is not None:
                progress(done, days)
    _write_settings(lake, drawn)
    _write_truth(lake, drawn)
    planted = list(_spoil(lake, drawn, days))
    schema = pa.schema([(name, pa.string()) for name in ("code", "file", "loop", "day")])
    rows = [dict(zip(schema.names, one, strict=True)) for one in planted]
    pq.write_table(pa.Table.from_pylist(rows, schema=schema), lake / "_truth" / "problems.parquet")
    return lake


def _random_loop(i: int, seed: int) -> _Loop:
    """Draw a loop; every one is its own, whatever the others are."""
    random = Random(f"{seed}/{i}")

    def between(low: float, high: float) -> float:
        return float(math.exp(random.uniform(math.log(low), math.log(high))))

    valve = random.choices(("globe", "segment", "butterfly"), (45, 30, 25))[0]
    kinds = _KINDS[valve]
    kind: Kind = random.choices(list(kinds), list(kinds.values()))[0]
    integrating = random.random() < 0.12
    letters = "LIC" if integrating else random.choice(_LETTERS)
    site: Site = random.choices(("historian", "opc", "platform"), (60, 25, 15))[0]
    record: Record = random.choices(("good", "no_op", "compressed", "coarse", "manual"), (88, 4, 3, 3, 2))[0]
    wide = between(1.3, 5.0)
    worn = (between(0.2, 0.6), between(2.0, 5.0))
    small = between(0.25, 0.8) if kind == "small" else 0.0
    gaps: dict[Kind, tuple[float, float]] = {
        "gap": (wide, wide),
        "small": (small, small),
        "both": (0.6 * wide, 0.6 * wide),
        "wear": worn,
    }
    stick = {"sticking": wide, "both": 0.4 * wide}.get(kind, 0.0)
    lag = between(40, 250)
    lags: tuple[float, ...] = (lag, lag * random.uniform(0.1, 0.6)) if not integrating else (0.3 * lag,)
    dead_time = float(round(lag * random.uniform(0.1, 0.4)))
    kp = between(0.5, 1.6)
    if integrating:
        kp /= 10 * lag
        k, ti = 0.35 / (kp * dead_time), 13.4 * dead_time  # AMIGO
        k, ti = 0.7 * k, ti
    else:
        slow, late = lags[0] + lags[1] / 2, dead_time + lags[1] / 2  # half rule, then SIMC
        tau = late * random.choice((1.0, 1.5, 3.0))
        k, ti = slow / (kp * (tau + late)), min(slow, 4 * (tau + late))
    if kind == "tight":
        k, ti = 1.5 * k, 0.7 * ti
    return _Loop(
        name=f"{letters}{101 + i}",
        area=random.choice(_AREAS),
        valve=valve,
        positioner=random.choice(("digital", "digital", "electro-pneumatic", "none")),
        kind=kind,
        site=site,
        record=record,
        d=gaps.get(kind, (0.0, 0.0)),
        friction=(stick, stick * random.uniform(0.3, 1.0)),
        kp=kp,
        lags=lags,
        dead_time=dead_time,
        integrating=integrating,
        k=float(f"{k:.3g}"),
        ti=float(f"{ti:.3g}"),
        noise=between(0.03, 0.15),
        walk=between(0.02, 0.05) if kind == "restless" else between(0.001, 0.006),
        steps=between(4.0, 8.0) if kind == "restless" else between(0.5, 3.0),
        swing=(between(0.5, 2.0), between(6, 20) * (lag + dead_time)) if kind == "swinging" else (0.0, 1.0),
        moves=random.choice((0, 0, 4, 8, 24)),
        sp=random.uniform(35, 65),
        op=random.uniform(35, 65),
        known=random.random() < 0.8,
    )


# --- a day


def _write_day(lake: Path, drawn: Sequence[_Loop], day: int, days: int, seed: int) -> None:
    """Write the files of a day."""
    name = (BEGIN + timedelta(days=day)).isoformat()
    for site in ("historian", "opc"):
        folder = lake / site / f"day={name}"
        folder.mkdir(parents=True, exist_ok=True)
        of = [loop for loop in drawn if loop.site == site]
        schema = _LONG if site == "historian" else _OPC
        with pq.ParquetWriter(folder / "part-0.parquet", schema, compression="zstd", **_encoded(schema)) as writer:
            for loops, made in _simulated(of, day, days, seed):
                writer.write_table(_long(loops, made, day, seed, site))
    for loops, made in _simulated([loop for loop in drawn if loop.site == "platform"], day, days, seed):
        for loop, simulation in zip(loops, made, strict=True):
            folder = lake / "platform" / f"loop={loop.name}"
            folder.mkdir(parents=True, exist_ok=True)
            pq.write_table(_wide(loop, simulation, day, seed), folder / f"{name}.parquet", compression="zstd")


def _encoded(schema: pa.Schema) -> dict[str, Any]:
    """Options that encode a table's columns for small files."""
    words = [field.name for field in schema if pa.types.is_string(field.type)]
    times = [field.name for field in schema if pa.types.is_timestamp(field.type)]
    return {"use_dictionary": words, "column_encoding": dict.fromkeys(times, "DELTA_BINARY_PACKED")}


def _simulated(
    drawn: Sequence[_Loop], day: int, days: int, seed: int
) -> Iterator[tuple[Sequence[_Loop], list[Simulation]]]:
    for at in range(0, len(drawn), _AT_ONCE):
        some = drawn[at : at + _AT_ONCE]
        yield some, run_many([loop.scenario(day, days, seed) for loop in some], progress=False)


_LONG = pa.schema(
    [("tag", pa.string()), ("time", pa.timestamp("us", tz="UTC")), ("value", pa.float64()), ("quality", pa.string())]
)
_OPC = pa.schema(
    [("PointName", pa.string()), ("Timestamp", pa.timestamp("ms")), ("Value", pa.string()), ("Status", pa.int32())]
)


@dataclass(frozen=True, slots=True)
class _Kept:
    """A historian's data of a day: rows of the simulation, values, and which of PV are bad."""

    k: NDArray[np.int64]
    pv: NDArray[np.float64]
    sp: NDArray[np.float64]
    op: NDArray[np.float64]
    manual: NDArray[np.bool_]
    bad: NDArray[np.bool_]


def _recorded_day(loop: _Loop, s: Simulation, day: int, seed: int) -> _Kept:
    """A simulated day as its historian keeps it."""
    k = np.arange(0, len(s.t), 60 if loop.record == "coarse" else STEP)
    pv = np.round(s.pv[k], 2)
    if loop.record == "compressed":
        pv = _drawn_as_lines(pv, 1.5)
    random = np.random.default_rng([seed, day, sum(map(ord, loop.name))])
    bad = random.random(len(k)) < 0.0005
    return _Kept(k, pv, np.round(s.sp[k], 2), np.round(s.op[k], 2), (s.flags[k] & NOT_AUTO) != 0, bad)


def _drawn_as_lines(x: NDArray[np.float64], band: float) -> NDArray[np.float64]:
    """Signal read back from a historian that keeps a value when it has moved by a band, and draws lines between."""
    kept = [0]
    for i in range(1, len(x)):
        if abs(x[i] - x[kept[-1]]) > band:
            kept.append(i)
    kept.append(len(x) - 1)
    lines: NDArray[np.float64] = np.interp(np.arange(len(x)), kept, x[kept])
    return lines


def _long(loops: Sequence[_Loop], made: Sequence[Simulation], day: int, seed: int, site: Site) -> pa.Table:
    """Rows of a long table: PV and OP at every sample, SP and MODE where they change."""
    tags: list[pa.Array] = []
    times: list[NDArray[np.int64]] = []
    values: list[NDArray[np.float64]] = []
    bad: list[NDArray[np.bool_]] = []
    for loop, simulation in zip(loops, made, strict=True):
        kept = _recorded_day(loop, simulation, day, seed)
        every = np.ones(len(kept.k), np.bool_)
        signals = {"PV": (kept.pv, every), "OP": (kept.op, every), "SP": (kept.sp, _changes(kept.sp))}
        signals["MODE"] = (np.where(kept.manual, 0.0, 1.0), _changes(kept.manual))
        if loop.record == "no_op":
            del signals["OP"]
        for name, (x, here) in signals.items():
            n = int(here.sum())
            tags.append(pa.array([f"{loop.name}.{name}"] * n, pa.string()))
            times.append(kept.k[here])
            values.append(x[here])
            bad.append((kept.bad if name == "PV" else np.zeros(len(every), np.bool_))[here])
    tag, at, value = pa.concat_arrays(tags), np.concatenate(times), np.concatenate(values)
    wrong = np.concatenate(bad)
    if site == "historian":
        words = pa.array(["Good", "Bad"]).take(pa.array(wrong.astype(np.int64)))
        return pa.table([tag, _utc(day, at), pa.array(value), words], schema=_LONG)
    text = pa.array(np.char.mod("%.2f", value))
    status = np.where(wrong, 24, 192).astype(np.int32)
    local = _utc(day, at).cast(pa.timestamp("ms", tz=_ZONE))
    return pa.table([tag, pa.compute.local_timestamp(local), text, pa.array(status)], schema=_OPC)


def _wide(loop: _Loop, simulation: Simulation, day: int, seed: int) -> pa.Table:
    """A day as a table with a column for each signal."""
    kept = _recorded_day(loop, simulation, day, seed)
    columns = {"time": _utc(day, kept.k), "SP": pa.array(kept.sp), "PV": pa.array(kept.pv), "OP": pa.array(kept.op)}
    if loop.record == "no_op":
        del columns["OP"]
    columns["MODE"] = pa.array(["AUTO", "MAN"]).take(pa.array(kept.manual.astype(np.int64)))
    columns["quality"] = pa.array(np.where(kept.bad, 0x80000000, 0).astype(np.int64))
    return pa.table(columns)


def _changes(x: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether each value differs from the one before."""
    changed: NDArray[np.bool_] = np.r_[True, x[1:] != x[:-1]]
    return changed


def _utc(day: int, seconds: NDArray[np.int64]) -> pa.Array:
    midnight = datetime.combine(BEGIN + timedelta(days=day), datetime.min.time(), UTC)
    micros = int(midnight.timestamp()) * 1_000_000 + seconds * 1_000_000
    return pa.array(micros).cast(pa.timestamp("us", tz="UTC"))


# --- settings and truth


def _write_settings(lake: Path, drawn: Sequence[_Loop]) -> None:
    """Write the settings of the lake's loops."""
    rows = []
    for loop in drawn:
        row: dict[str, Any] = {"loop": loop.name, "area": loop.area, "valve": loop.valve}
        row |= {"positioner.type": loop.positioner, "pv_span.low": 0, "pv_span.high": 100, "pv_unit": "bar"}
        row |= {"op_span.low": 0, "op_span.high": 100, "op_unit": "%", "acceptable_dead_band": 1.0}
        row |= {"time_zone": _ZONE, "process.type": "integrating" if loop.integrating else "self-regulating"}
        row |= {"controller.k": loop.k, "controller.ti": loop.ti} if loop.known else {}
        rows.append(row | ({"controller.setpoint_weight": 0.0} if loop.known else {}))
    gone = {**rows[0], "loop": "FIC9001"}  # settings without tags
    wrong = {**rows[0], "loop": "FIC9002", "controller.k": 1.0, "controller.ti": -30.0}
    table = pa.Table.from_pylist([*rows, gone, wrong], schema=_SETTINGS)
    sink = pa.BufferOutputStream()
    pyarrow.csv.write_csv(table, sink)
    write_file(lake / "loops.csv", sink.getvalue().to_pybytes())


_SETTINGS = pa.schema(
    [(name, pa.string()) for name in ("loop", "area", "valve", "positioner.type")]
    + [("pv_span.low", pa.float64()), ("pv_span.high", pa.float64()), ("pv_unit", pa.string())]
    + [("op_span.low", pa.float64()), ("op_span.high", pa.float64()), ("op_unit", pa.string())]
    + [("acceptable_dead_band", pa.float64()), ("time_zone", pa.string()), ("process.type", pa.string())]
    + [(f"controller.{name}", pa.float64()) for name in ("k", "ti", "setpoint_weight")]
)


def _write_truth(lake: Path, drawn: Sequence[_Loop]) -> None:
    """Write the truth of the valves."""
    rows = [
        {
            "loop": loop.name,
            "kind": loop.kind,
            "record": loop.record,
            "site": loop.site,
            "dead_band": loop.dead_band,
            "d_first": loop.d[0],
            "d_last": loop.d[1],
            "stick_band": loop.friction[0],
            "jump": loop.friction[1],
            "bad": loop.dead_band >= 1.0,
        }
        for loop in drawn
    ]
    pq.write_table(pa.Table.from_pylist(rows), lake / "_truth" / "loops.parquet")


# --- what is wrong with it


_Fault = tuple[str, str, str, str]
"""A planted fault: the code that has to be found, its file, loop and day; "" where there is none."""


def _spoil(lake: Path, drawn: Sequence[_Loop], days: int) -> Iterator[_Fault]:
    """Plant every kind of fault."""
    yield "no_tags", "", "FIC9001", ""
    yield "settings", "loops.csv", "FIC9002", ""
    yield from _spoil_historian(lake, drawn, days)
    yield from _spoil_opc(lake, days)
    yield from _spoil_platform(lake, drawn, days)
    yield from _hole(lake, days)


def _day(k: int, days: int) -> str:
    """A day of the lake, however short that is."""
    return (BEGIN + timedelta(days=k % days)).isoformat()


def _good(drawn: Sequence[_Loop], site: Site, skip: int = 0) -> _Loop | None:
    """A loop of the site whose recording is good."""
    return next(iter([loop for loop in drawn if loop.site == site and loop.record == "good"][skip:]), None)


def _spoil_historian(lake: Path, drawn: Sequence[_Loop], days: int) -> Iterator[_Fault]:
    """Add files that are of no use or contradict others, and change the unit of a day."""

    def write(k: int, name: str, table: pa.Table) -> str:
        place = f"historian/day={_day(k, days)}/{name}.parquet"
        pq.write_table(table, lake / place)
        return place

    # Another schema, in the same folder.
    notes = pa.table({"shift": ["A", "B"], "note": ["pump 3 out", "nothing"]})
    yield "schema", write(4, "shift-notes", notes), "", ""
    # Times that are plain numbers.
    counters = pa.table({"tag": ["X.PV"] * 3, "time": [0.0, 1.0, 2.0], "value": [1.0, 2.0, 3.0]})
    yield "time", write(4, "counters", counters), "", ""
    # Tags that no settings name, and a quality that no vendor has.
    at = _utc(5 % days, np.arange(0, _SECONDS, 60))
    n = len(at)
    tags = pa.array(["FIC9003.PV"] * n + ["FIC9003.SP"] * n)
    table = pa.table([tags, pa.concat_arrays([at, at]), np.full(2 * n, 50.0), pa.array(["Good"] * 2 * n)], schema=_LONG)
    write(5, "new-loop", table)
    yield "no_settings", "", "FIC9003", ""
    if (loop := _good(drawn, "historian")) is not None:
        # An hour of one loop came in twice, the second time with other numbers and a quality nobody knows.
        at = _utc(6 % days, np.arange(0, 3600, STEP))
        words = pa.array(["Good"] * (len(at) - 5) + ["Shaky"] * 5)
        table = pa.table([pa.array([f"{loop.name}.PV"] * len(at)), at, np.full(len(at), 12.34), words], schema=_LONG)
        place = write(6, "correction", table)
        yield "contradicting", "", loop.name, _day(6, days)
        yield "quality", place, "", ""
    if (loop := _good(drawn, "historian", 1)) is not None:
        # A day in another unit that no column states: 14.5 psi are a bar.
        yield from _in_psi(lake, loop, _day(7, days))


def _spoil_opc(lake: Path, days: int) -> Iterator[_Fault]:
    """Export a day twice, write a word in place of a number; the clocks change by themselves."""
    path = lake / "opc" / f"day={_day(8, days)}" / "part-0.parquet"
    table = pq.read_table(path, partitioning=None)
    if not len(table):
        return
    # Out of order the second time.
    pq.write_table(table.take(np.random.default_rng(8).permutation(len(table))), path.with_name("part-1.parquet"))
    named = {name.rpartition(".")[0] for name in table["PointName"].unique().to_pylist()}
    yield from (("doubled", "", name, _day(8, days)) for name in sorted(named))
    place = f"opc/day={_day(9, days)}/part-0.parquet"
    if (other := lake / place) != path:
        table = pq.read_table(other, partitioning=None)
        text = table["Value"].to_pylist()
        text[100] = "see shift log"
        pq.write_table(table.set_column(2, _OPC.field(2), pa.array(text)), other)
        yield "value", place, "", ""
    change = datetime(2025, 10, 26, tzinfo=ZoneInfo(_ZONE)).date()
    if (change - BEGIN).days < days:
        yield "clock_change", f"opc/day={change}/part-0.parquet", "", ""


def _spoil_platform(lake: Path, drawn: Sequence[_Loop], days: int) -> Iterator[_Fault]:
    """Cut a file off, as while it was copied, and state a unit that is not that of the settings."""
    if (loop := _good(drawn, "platform")) is None:
        return
    place = f"platform/loop={loop.name}/{_day(10, days)}.parquet"
    data = (lake / place).read_bytes()
    (lake / place).write_bytes(data[: len(data) // 2])
    yield "unreadable", place, "", ""
    if days > 1:
        place = f"platform/loop={loop.name}/{_day(11, days)}.parquet"
        table = pq.read_table(lake / place, partitioning=None)
        names = ["PV [psi]" if name == "PV" else name for name in table.column_names]
        pq.write_table(table.rename_columns(names), lake / place)
        yield "unit", place, loop.name, ""


def _hole(lake: Path, days: int) -> Iterator[_Fault]:
    """Overwrite some bytes in the middle of a file, within one group of rows."""
    place = f"historian/day={_day(3, days)}/part-0.parquet"
    meta = pq.read_metadata(lake / place)
    if meta.num_row_groups:
        chunk = meta.row_group(meta.num_row_groups // 2).column(2)
        with (lake / place).open("r+b") as file:
            file.seek(chunk.data_page_offset + chunk.total_compressed_size // 2)
            file.write(b"\x00" * 64)
        yield "damaged", place, "", ""


def _in_psi(lake: Path, loop: _Loop, day: str) -> Iterator[_Fault]:
    """Rewrite a day of a loop in psi."""
    path = lake / "historian" / f"day={day}" / "part-0.parquet"
    with pq.ParquetFile(path) as file:
        groups = [file.read_row_group(i) for i in range(file.metadata.num_row_groups)]
    with pq.ParquetWriter(path, _LONG, compression="zstd", **_encoded(_LONG)) as writer:
        for table in groups:
            other = pa.compute.equal(table["tag"], f"{loop.name}.PV")
            value = pa.compute.if_else(other, pa.compute.multiply(table["value"], 14.5), table["value"])
            writer.write_table(table.set_column(2, "value", value))
    yield "outside_span", "", loop.name, day
