"""The same work on Spark: the functions of `glapp.fleet.windows` by `applyInArrow`, with the same bits.

::

    units ──mapInArrow──→ rows (loop, day, …) ──groupBy(loop, day).applyInArrow(look)──→ days
    units with chosen windows ──mapInArrow──→ samples ──cogroup(days by loop).applyInArrow(judge)──→ loops, windows

Workers need glapp and the lake under the same path. A unit that is lost with its executor is read again by Spark. What
a group answers travels as the bytes of an Arrow table, which no conversion touches; the driver writes the results.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa

from ..errors import InputError
from .lake import ROWS, rows_of
from .problems import Problem
from .run import Plan, Stage, chosen_of
from .windows import DAYS, LOOPS, SAMPLES, WINDOWS, cut, judge, look

__all__ = ["run"]

_ROWS = "loop string, day int, signal byte, t long, value double, bad boolean, problem string"
_SAMPLES = "loop string, window long, t long, sp double, pv double, op double, position double, flags short"
_DAYS = "loop string, day int, made binary, problem string"
_LOOPS = "loop string, loops binary, windows binary, problems string"


def run(plan: Plan, out: Path, stage: Stage) -> tuple[pa.Table, pa.Table, pa.Table, list[Problem]]:
    """See `glapp.fleet.run.Engine`; the session is the one that there is, else one of this machine.

    Raises
    ------
    InputError
        Where PySpark is not installed.
    """
    try:
        from pyspark.sql import SparkSession
    except ImportError:
        raise InputError("needs PySpark", parameter="engine", hint="pip install 'glapp[spark]', and Java 17") from None
    os.environ.setdefault("PYSPARK_PYTHON", sys.executable)  # a worker of this machine has what we have
    spark = SparkSession.builder.appName("glapp fleet").getOrCreate()
    count = len(plan.units)
    stage("days", count, 0)
    units = spark.range(count).repartition(max(count, 1))
    rows = units.mapInArrow(_reader(plan), _ROWS)
    days = rows.groupBy("loop", "day").applyInArrow(_looker(plan), _DAYS).persist()
    problems: list[Problem] = []
    tables = []
    for _, _, made, problem in days.collect():
        if problem is not None:
            problems.append(Problem(*json.loads(problem)))
        else:
            tables.append(_table(made))
    every = pa.concat_tables(tables).cast(DAYS) if tables else DAYS.empty_table()
    stage("days", count, count)
    chosen = chosen_of(every, plan)
    asked = [i for i, unit in enumerate(plan.units) if any((k, unit.day) in chosen for k in unit.loops)]
    stage("loops", len(plan.places.loops), 0)
    if not asked:
        samples = spark.createDataFrame([], _SAMPLES)
    else:
        samples = spark.createDataFrame([(i,) for i in asked], "id long").repartition(len(asked))
        samples = samples.mapInArrow(_cutter(plan, chosen), _SAMPLES)
    grouped = samples.groupBy("loop").cogroup(days.filter("problem is null").groupBy("loop"))
    loops, windows = [], []
    for _, one, several, wrong in grouped.applyInArrow(_judge(plan), _LOOPS).collect():
        loops.append(_table(one))
        windows.append(_table(several))
        problems += [Problem(*problem) for problem in json.loads(wrong)]
    days.unpersist()
    stage("loops", len(plan.places.loops), len(plan.places.loops))
    return (
        every,
        pa.concat_tables(windows).cast(WINDOWS) if windows else WINDOWS.empty_table(),
        pa.concat_tables(loops).cast(LOOPS) if loops else LOOPS.empty_table(),
        problems,
    )


def _bytes(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    made: bytes = sink.getvalue().to_pybytes()
    return made


def _table(made: bytes) -> pa.Table:
    return pa.ipc.open_stream(made).read_all()


def _reader(plan: Plan) -> Callable[[Iterator[pa.RecordBatch]], Iterator[pa.RecordBatch]]:
    """Units to their rows; a problem is a row of no loop."""

    def read(batches: Iterator[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
        for batch in batches:
            for i in batch.column(0).to_pylist():
                unit = plan.units[i]
                tables, problems = rows_of(plan.lake, unit.files, plan.places, unit.loops, unit.day)
                for k, table in sorted(tables.items()):
                    n = len(table)
                    name = pa.array([plan.places.loops[k].name], pa.string()).take(pa.nulls(n, pa.int64()).fill_null(0))
                    day = pa.array([unit.day], pa.int32()).take(pa.nulls(n, pa.int64()).fill_null(0))
                    columns = [
                        name,
                        day,
                        *(table.column(c).combine_chunks() for c in ROWS.names),
                        pa.nulls(n, pa.string()),
                    ]
                    whole = pa.table(columns, names=["loop", "day", *ROWS.names, "problem"])
                    yield from whole.to_batches(max_chunksize=1 << 16)
                if problems:
                    yield _problem_rows(problems, unit.day)

    return read


def _problem_rows(problems: list[Problem], day: int) -> pa.RecordBatch:
    n = len(problems)
    none = [pa.nulls(n, field.type) for field in ROWS]
    told = pa.array([json.dumps(list(problem)) for problem in problems], pa.string())
    columns = [pa.array([""] * n), pa.array([day] * n, pa.int32()), *none, told]
    return pa.record_batch(columns, names=["loop", "day", *ROWS.names, "problem"])


def _looker(plan: Plan) -> Callable[[tuple[Any, ...], pa.Table], pa.Table]:
    loops = {loop.name: loop for loop in plan.places.loops}

    def looked(key: tuple[Any, ...], rows: pa.Table) -> pa.Table:
        name, day = (part.as_py() for part in key)
        if name == "":
            told = rows.column("problem").unique().to_pylist()
            n = len(told)
            columns = [pa.array([""] * n), pa.array([day] * n, pa.int32()), pa.nulls(n, pa.binary()), pa.array(told)]
        else:
            made = look(rows.select(ROWS.names).cast(ROWS), loops[name], day)
            columns = [
                pa.array([name]),
                pa.array([day], pa.int32()),
                pa.array([_bytes(made)]),
                pa.nulls(1, pa.string()),
            ]
        return pa.table(columns, names=["loop", "day", "made", "problem"])

    return looked


def _cutter(
    plan: Plan, chosen: dict[tuple[int, int], list[tuple[int, int]]]
) -> Callable[[Iterator[pa.RecordBatch]], Iterator[pa.RecordBatch]]:
    def cutted(batches: Iterator[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
        for batch in batches:
            for i in batch.column(0).to_pylist():
                unit = plan.units[i]
                rows, _ = rows_of(plan.lake, unit.files, plan.places, unit.loops, unit.day)
                for k, table in sorted(rows.items()):
                    if windows := chosen.get((k, unit.day)):
                        made = cut(table, plan.places.loops[k], windows)
                        flags = SAMPLES.get_field_index("flags")
                        yield from made.set_column(flags, "flags", made["flags"].cast(pa.int16())).to_batches()

    return cutted


def _judge(plan: Plan) -> Callable[[tuple[Any, ...], pa.Table, pa.Table], pa.Table]:
    loops = {loop.name: loop for loop in plan.places.loops}

    def judged(key: tuple[Any, ...], samples: pa.Table, days: pa.Table) -> pa.Table:
        name = key[0].as_py()
        every = pa.concat_tables([_table(made) for made in days.column("made").to_pylist()]).cast(DAYS)
        ordered = samples.cast(SAMPLES).sort_by([("window", "ascending"), ("t", "ascending")])
        row, windows, problems = judge(ordered, every, loops[name])
        told = json.dumps([list(problem) for problem in problems])
        columns = [pa.array([name]), pa.array([_bytes(row)]), pa.array([_bytes(windows)]), pa.array([told])]
        return pa.table(columns, names=["loop", "loops", "windows", "problems"])

    return judged
