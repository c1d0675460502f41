"""The fleet on Spark: the functions of `glapp.fleet.windows` and `glapp.fleet.history` by `applyInArrow`.

::

    units ──mapInArrow──→ rows (unit, loop, …) ──groupBy(unit, loop).applyInArrow(look)──→ days
    units of a wave ──mapInArrow──→ rows ──groupBy(loop), cogroup(states).applyInArrow(follow)──→ crossings, states
    units with chosen windows ──mapInArrow──→ samples ──cogroup(days by loop).applyInArrow(judge)──→ loops, windows

A wave has as many days as keep every loop within `GROUP` rows: a loop too large for one group goes in waves that hand
on its state. Workers need glapp and the lake under the same path. A unit that is lost with its executor is read again
by Spark. The answer of a group travels as the bytes of an Arrow table, which no conversion touches.

The driver writes the pieces that a run on one machine writes, under the same names, wave by wave. So a run that was
stopped goes on, and a later one looks at what is new, and fits what has another name than before, on either engine.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from ..errors import InputError
from . import pieces
from .history import FOLLOWED, follow
from .lake import ROWS
from .plan import Plan, Stage
from .problems import DataIssue
from .results import write_piece
from .windows import DAYS, SAMPLES, cut, judge, look

__all__ = ["AT_A_TIME", "GROUP", "JUDGED_AT_A_TIME", "run"]

AT_A_TIME = 50_000
"""Loops and days that pass through the driver at a time: some 0.5 GB of states."""

JUDGED_AT_A_TIME = 5000
"""Loops whose answers pass through the driver at a time, and are kept then: some 18 hours of a core."""

GROUP = 8_000_000
"""Rows of PV of a loop in one wave at most, where it has more than one unit: some 1 GB of a worker's memory."""

_ROWS = "unit int, loop string, signal byte, t long, value double, bad boolean, problem string"
_LOOKED = "unit int, loop string, made binary, problem string"
_STATES = "loop string, state string, looks binary"
_FOLLOWED = "loop string, units array<int>, made binary"
_SAMPLES = "loop string, window long, t long, sp double, pv double, op double, position double, flags short"
_KNOWN = "loop string, days binary, crossings binary"
_LOOPS = "key string, loops binary, windows binary, problems string"


def run(plan: Plan, out: Path, stage: Stage) -> tuple[dict[str, pa.Table], list[DataIssue]]:
    """See `glapp.fleet.plan.Engine`; the session is the one that there is, else one of this machine.

    Raises InputError where PySpark is not installed.
    """
    try:
        from pyspark.sql import SparkSession
    except ImportError:
        raise InputError("needs PySpark", parameter="engine", hint="pip install 'glapp[spark]', and Java 17") from None
    os.environ.setdefault("PYSPARK_PYTHON", sys.executable)  # a worker of this machine has what we have
    spark = SparkSession.builder.appName("glapp fleet").getOrCreate()
    work, problems = out / "work", list[DataIssue]()
    looks = [work / "days" / f"{unit.key}.parquet" for unit in plan.units]
    _look_at(spark, plan, looks, stage)
    days = pieces.together(looks, DAYS, problems)
    follows = pieces.follow_paths(plan, work)
    _follow(spark, plan, looks, follows, stage)
    crossings = pieces.crossings_of(follows)
    keys = _judged(spark, plan, work, days, crossings, stage)
    loops, windows = pieces.answers_of(work, keys, problems)
    pieces.tidy(work, {*looks, *follows, *(work / "samples").glob("*")}, keys)
    return {"days": days, "crossings": crossings, "windows": windows, "loops": loops}, problems


def _units(spark: Any, plan: Plan, which: Sequence[int], known: dict[int, list[DataIssue]] | None = None) -> Any:
    """The rows of units; of such as were looked at the problems that were met then."""
    ids = spark.createDataFrame([(i,) for i in which], "id int").repartition(len(which))
    return ids.mapInArrow(_reader(plan, known), _ROWS)


def _look_at(spark: Any, plan: Plan, paths: Sequence[Path], stage: Stage) -> None:
    """Look at the units that were not looked at before, and write their pieces."""
    missing = [i for i, path in enumerate(paths) if not path.exists()]
    stage("days", len(paths), len(paths) - len(missing))
    for some in _at_a_time(plan, missing):
        made: dict[int, dict[str, pa.Table]] = {i: {} for i in some}
        wrong: dict[int, list[DataIssue]] = {i: [] for i in some}
        groups = _units(spark, plan, some).groupBy("unit", "loop").applyInArrow(_looker(plan), _LOOKED)
        for unit, loop, table, problem in groups.collect():
            if problem is not None:
                wrong[unit].append(DataIssue(*json.loads(problem)))
            else:
                made[unit][loop] = _table(table)
        for i in some:
            names = [plan.places.loops[k].name for k in plan.units[i].loops]
            write_piece(paths[i], [made[i][name] for name in names if name in made[i]], DAYS, sorted(set(wrong[i])))
        missing = missing[len(some) :]
        stage("days", len(paths), len(paths) - len(missing))


def _at_a_time(plan: Plan, units: Sequence[int]) -> Iterator[list[int]]:
    """Units in the order of time, as many at once as may pass through the driver."""
    some: list[int] = []
    loops = 0
    for i in units:
        loops += len(plan.units[i].loops)
        if some and loops > AT_A_TIME:
            yield some
            some, loops = [], len(plan.units[i].loops)
        some.append(i)
    if some:
        yield some


def _follow(spark: Any, plan: Plan, looks: Sequence[Path], paths: Sequence[Path], stage: Stage) -> None:
    """Follow the crossings over the units that are new or after a new one, wave by wave, and write their pieces."""
    missing = [i for i, path in enumerate(paths) if not path.exists()]
    stage("crossings", len(paths), len(paths) - len(missing))
    states: dict[str, str] = {}
    for wave in _waves(plan, missing, looks):
        for one in sorted({b for i in wave for b in plan.units[i].before} - set(wave)):
            states.update(pieces.states_of(paths[one]))
        known = {i: pieces.looks_of(looks[i]) for i in wave}
        having: dict[str, list[pa.Table]] = {}
        for i in wave:
            for name, table in known[i].items():
                having.setdefault(name, []).append(table.append_column("unit", pa.array([i], pa.int32())))
        handed = [(name, states.get(name), _bytes(pa.concat_tables(of))) for name, of in having.items()]
        made: dict[int, dict[str, pa.Table]] = {i: {} for i in wave}
        if handed:
            met = {i: pieces.problems_at(looks[i]) for i in wave}
            rows = _units(spark, plan, wave, met).groupBy("loop")
            given = spark.createDataFrame(handed, _STATES).groupBy("loop")
            for name, units, table in rows.cogroup(given).applyInArrow(_follower(plan), _FOLLOWED).collect():
                every = _table(table)
                for row, unit in enumerate(units):
                    made[unit][name] = every.slice(row, 1)
        for i in wave:
            pieces.write_followed(plan, plan.units[i], made[i], states, paths[i])
            states.update((name, table["state"][0].as_py()) for name, table in made[i].items())
        missing = missing[len(wave) :]
        stage("crossings", len(paths), len(paths) - len(missing))


def _waves(plan: Plan, units: Sequence[int], looks: Sequence[Path]) -> Iterator[list[int]]:
    """Units in the order of time, as many at once as keep every loop below `GROUP` rows."""
    for some in _at_a_time(plan, units):
        wave: list[int] = []
        rows: dict[str, int] = {}
        for i in some:
            more = {name: table["rows"][0].as_py() for name, table in pieces.looks_of(looks[i]).items()}
            if wave and any(rows.get(name, 0) + n > GROUP for name, n in more.items()):
                yield wave
                wave, rows = [], {}
            wave.append(i)
            for name, n in more.items():
                rows[name] = rows.get(name, 0) + n
        yield wave


def _judged(spark: Any, plan: Plan, work: Path, days: pa.Table, crossings: pa.Table, stage: Stage) -> list[str]:
    """Cut the chosen windows, judge every loop by its own, and write the answers that are new; the names of all."""
    chosen = pieces.chosen_of(days, plan)
    having = set(days.column("loop").to_pylist())
    order = [k for k, loop in enumerate(plan.places.loops) if loop.name in having]
    keys: list[str] = []
    stage("loops", len(order), 0)
    for at in range(0, len(order), JUDGED_AT_A_TIME):
        wave = set(order[at : at + JUDGED_AT_A_TIME])
        here = {which: windows for which, windows in chosen.items() if which[0] in wave}
        asked = sorted({i for _, i in here})
        if asked:
            ids = spark.createDataFrame([(i,) for i in asked], "id int").repartition(len(asked))
            met = {i: pieces.problems_at(work / "days" / f"{plan.units[i].key}.parquet") for i in asked}
            samples = ids.mapInArrow(_cutter(plan, here, met), _SAMPLES)
        else:
            samples = spark.createDataFrame([], _SAMPLES)
        names = [plan.places.loops[k].name for k in sorted(wave)]
        of = [(name, *(_bytes(t.filter(pc.equal(t["loop"], name))) for t in (days, crossings))) for name in names]
        known = spark.createDataFrame(of, _KNOWN).groupBy("loop")
        made = frozenset(path.stem for path in (work / "loops").glob("*.parquet"))
        groups = samples.groupBy("loop").cogroup(known).applyInArrow(_judge(plan, made), _LOOPS)
        for key, row, several, wrong in groups.collect():
            keys.append(key)
            if row is not None:
                problems = [DataIssue(*problem) for problem in json.loads(wrong)]
                pieces.write_judged(work, key, _table(row), _table(several), problems)
        stage("loops", len(order), len(keys))
    return sorted(keys)


def _bytes(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    made: bytes = sink.getvalue().to_pybytes()
    return made


def _table(made: bytes) -> pa.Table:
    return pa.ipc.open_stream(made).read_all()


def _reader(
    plan: Plan, known: dict[int, list[DataIssue]] | None
) -> Callable[[Iterator[pa.RecordBatch]], Iterator[pa.RecordBatch]]:
    """Units to their rows; a problem is a row of no loop, where it is not known from the look at them."""

    def read(batches: Iterator[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
        """Rows of the units whose numbers come in."""
        for batch in batches:
            for i in batch.column(0).to_pylist():
                if known is None:
                    tables, problems = pieces.unit_rows(plan, plan.units[i])
                else:
                    tables, problems = pieces.read_again(plan, plan.units[i], known[i]), []
                for k, table in sorted(tables.items()):
                    n = len(table)
                    none = pa.array([0], pa.int32()).take(pa.nulls(n, pa.int64()).fill_null(0))
                    columns = [
                        pa.array([i], pa.int32()).take(none),
                        pa.array([plan.places.loops[k].name], pa.string()).take(none),
                        *(table.column(c).combine_chunks() for c in ROWS.names),
                        pa.nulls(n, pa.string()),
                    ]
                    whole = pa.table(columns, names=["unit", "loop", *ROWS.names, "problem"])
                    yield from whole.to_batches(max_chunksize=1 << 16)
                if problems:
                    yield _problem_rows(problems, i)

    return read


def _problem_rows(problems: list[DataIssue], unit: int) -> pa.RecordBatch:
    """Data issues as rows for Spark."""
    n = len(problems)
    none = [pa.nulls(n, field.type) for field in ROWS]
    texts = pa.array([json.dumps(list(problem)) for problem in problems], pa.string())
    columns = [pa.array([unit] * n, pa.int32()), pa.array([""] * n), *none, texts]
    return pa.record_batch(columns, names=["unit", "loop", *ROWS.names, "problem"])


def _looker(plan: Plan) -> Callable[[tuple[Any, ...], pa.Table], pa.Table]:
    """Function that looks at the days of a loop in a worker of Spark."""
    loops = {loop.name: loop for loop in plan.places.loops}

    def looked(key: tuple[Any, ...], rows: pa.Table) -> pa.Table:
        i, name = (part.as_py() for part in key)
        if name == "":
            texts = rows.column("problem").unique().to_pylist()
            n = len(texts)
            columns = [pa.array([i] * n, pa.int32()), pa.array([""] * n), pa.nulls(n, pa.binary()), pa.array(texts)]
        else:
            unit = plan.units[i]
            made = look(rows.select(ROWS.names).cast(ROWS), loops[name], unit.day, unit.part)
            columns = [
                pa.array([i], pa.int32()),
                pa.array([name]),
                pa.array([_bytes(made)]),
                pa.nulls(1, pa.string()),
            ]
        return pa.table(columns, names=["unit", "loop", "made", "problem"])

    return looked


def _follower(plan: Plan) -> Callable[[tuple[Any, ...], pa.Table, pa.Table], pa.Table]:
    """Function that follows the crossings of a loop in a worker of Spark."""
    loops = {loop.name: loop for loop in plan.places.loops}

    def followed(key: tuple[Any, ...], rows: pa.Table, known: pa.Table) -> pa.Table:
        name = key[0].as_py()
        state, looks = known["state"][0].as_py(), _table(known["looks"][0].as_py())
        units, tables = looks["unit"].to_pylist(), []
        for place, i in enumerate(units):
            here = rows.filter(pc.equal(rows["unit"], i)).select(ROWS.names).cast(ROWS)
            made = follow(here, looks.slice(place, 1).select(DAYS.names), loops[name], state)
            state = made["state"][0].as_py()
            tables.append(made)
        every = pa.concat_tables(tables).cast(FOLLOWED)
        columns = [pa.array([name]), pa.array([units], pa.list_(pa.int32())), pa.array([_bytes(every)])]
        return pa.table(columns, names=["loop", "units", "made"])

    return followed


def _cutter(
    plan: Plan, chosen: dict[tuple[int, int], list[tuple[int, int]]], known: dict[int, list[DataIssue]]
) -> Callable[[Iterator[pa.RecordBatch]], Iterator[pa.RecordBatch]]:
    """Function that cuts the chosen windows in a worker of Spark."""

    def cutted(batches: Iterator[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
        for batch in batches:
            for i in batch.column(0).to_pylist():
                rows = pieces.read_again(plan, plan.units[i], known[i])
                for k, table in sorted(rows.items()):
                    if windows := chosen.get((k, i)):
                        made = cut(table, plan.places.loops[k], windows)
                        flags = SAMPLES.get_field_index("flags")
                        yield from made.set_column(flags, "flags", made["flags"].cast(pa.int16())).to_batches()

    return cutted


def _judge(plan: Plan, made: frozenset[str]) -> Callable[[tuple[Any, ...], pa.Table, pa.Table], pa.Table]:
    """The answer of a loop; of one that is made already its name alone."""
    loops = {loop.name: loop for loop in plan.places.loops}

    def judged(key: tuple[Any, ...], samples: pa.Table, known: pa.Table) -> pa.Table:
        loop = loops[key[0].as_py()]
        days, crossings = (_table(known[column][0].as_py()) for column in ("days", "crossings"))
        ordered = samples.cast(SAMPLES).sort_by([("window", "ascending"), ("t", "ascending")])
        name = pieces.judged_key(ordered, days, crossings, loop)
        answer: list[Any] = [None, None, None]
        if name not in made:
            row, windows, problems = judge(ordered, days, crossings, loop)
            answer = [_bytes(row), _bytes(windows), json.dumps([list(problem) for problem in problems])]
        types = (pa.string(), pa.binary(), pa.binary(), pa.string())
        columns = [pa.array([value], kind) for value, kind in zip((name, *answer), types, strict=True)]
        return pa.table(columns, names=["key", "loops", "windows", "problems"])

    return judged
