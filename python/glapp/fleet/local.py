"""A run on all cores of this machine, in bounded memory: a process for each core."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from . import pieces
from .history import follow
from .plan import Plan, Stage, Unit
from .problems import DataIssue
from .results import digest, read_piece, write_piece
from .windows import DAYS, SAMPLES, cut, judge, look

__all__ = ["Local"]


class Local:
    """All cores of this machine."""

    def __init__(self, workers: int) -> None:
        self.workers = workers

    def __call__(self, plan: Plan, out: Path, stage: Stage) -> tuple[dict[str, pa.Table], list[DataIssue]]:
        """See `Engine`."""
        work = out / "work"
        problems: list[DataIssue] = []
        with ProcessPoolExecutor(
            self.workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_begin,
            initargs=(os.getpid(), plan, work),
        ) as pool:
            try:
                looks = [work / "days" / f"{unit.key}.parquet" for unit in plan.units]
                _run_tasks(
                    pool, _look, [(i,) for i, path in enumerate(looks) if not path.exists()], "days", len(looks), stage
                )
                days = pieces.together(looks, DAYS, problems)
                follows = pieces.follow_paths(plan, work)
                _chained(pool, plan, follows, stage)
                crossings = pieces.crossings_of(follows)
                chosen = pieces.chosen_of(days, plan)
                cuts, asked = [], []
                for i, unit in enumerate(plan.units):
                    here = {k: w for k in unit.loops if (w := chosen.get((k, i)))}
                    if here:
                        path = work / "samples" / f"{digest(unit.key, sorted(here.items()))}.parquet"
                        cuts.append((here, path))
                        asked += [] if path.exists() else [(i, here, path)]
                _run_tasks(pool, _cut, asked, "windows", len(cuts), stage)
                by_loop: dict[int, list[Path]] = {}
                for here, path in cuts:
                    for k in here:
                        by_loop.setdefault(k, []).append(path)
                having = set(days.column("loop").to_pylist())
                order = [k for k, loop in enumerate(plan.places.loops) if loop.name in having]
                names = [plan.places.loops[k].name for k in order]
                of = [tuple(t.filter(pc.equal(t["loop"], name)) for t in (days, crossings)) for name in names]
                tasks = [(k, *tables, by_loop.get(k, [])) for k, tables in zip(order, of, strict=True)]
                keys = _run_tasks(pool, _judge, tasks, "loops", len(order), stage)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
        loops, windows = pieces.answers_of(work, keys, problems)
        pieces.tidy(work, {*looks, *follows, *(path for _, path in cuts)}, keys)
        return {"days": days, "crossings": crossings, "windows": windows, "loops": loops}, problems


def _chained(pool: ProcessPoolExecutor, plan: Plan, paths: Sequence[Path], stage: Stage) -> None:
    """Follow the crossings over all units, each as soon as those before it are there."""
    there = [path.exists() for path in paths]
    after: dict[int, list[int]] = {}
    for i, unit in enumerate(plan.units):
        for one in unit.before:
            after.setdefault(one, []).append(i)
    left = {i: sum(not there[one] for one in plan.units[i].before) for i, made in enumerate(there) if not made}
    stage("crossings", len(paths), len(paths) - len(left))

    def begin(i: int) -> Future[None]:
        return pool.submit(_follow, i, [paths[one] for one in plan.units[i].before], paths[i])

    under_way = {begin(i): i for i, missing in left.items() if not missing}
    while under_way:
        ready, _ = wait(under_way, timeout=0.2, return_when="FIRST_COMPLETED")
        for future in ready:
            i = under_way.pop(future)
            future.result()
            del left[i]
            for one in after.get(i, ()):
                if one in left:
                    left[one] -= 1
                    if not left[one]:
                        under_way[begin(one)] = one
        stage("crossings", len(paths), len(paths) - len(left))


def _run_tasks(
    pool: ProcessPoolExecutor, work: Callable[..., Any], tasks: Sequence[Any], name: str, total: int, stage: Stage
) -> list[Any]:
    """Run all tasks; their results, in their order."""
    done = total - len(tasks)
    stage(name, total, done)
    futures: list[Future[Any]] = [pool.submit(work, *task) for task in tasks]
    left = set(futures)
    while left:
        ready, left = wait(left, timeout=0.2, return_when="FIRST_COMPLETED")
        for future in ready:
            future.result()
        stage(name, total, total - len(left))
    return [future.result() for future in futures]


_here: tuple[Plan, Path] | None = None


def _begin(parent: int, plan: Plan, work: Path) -> None:
    """A process: one core, the plan at hand, and an end when the one that began it ends, however that ends."""
    global _here
    os.environ["RAYON_NUM_THREADS"] = "1"
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
    _here = plan, work

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _plan() -> tuple[Plan, Path]:
    assert _here is not None
    return _here


def _look(i: int) -> None:
    """Look at the days of a unit, in a process of its own."""
    plan, work = _plan()
    unit = plan.units[i]
    tables, problems = looked(plan, unit)
    write_piece(work / "days" / f"{unit.key}.parquet", [pa.concat_tables(tables)] if tables else [], DAYS, problems)


def looked(plan: Plan, unit: Unit) -> tuple[list[pa.Table], list[DataIssue]]:
    """The look at every loop of a unit, in their order."""
    rows, problems = pieces.unit_rows(plan, unit)
    return [look(table, plan.places.loops[k], unit.day, unit.part) for k, table in sorted(rows.items())], problems


def _follow(i: int, before: Sequence[Path], path: Path) -> None:
    """Follow the crossings of a unit, in a process of its own."""
    plan, work = _plan()
    unit = plan.units[i]
    looked_at = work / "days" / f"{unit.key}.parquet"
    looks = pieces.looks_of(looked_at)
    states: dict[str, str] = {}
    for one in before:
        states.update(pieces.states_of(one))
    rows = pieces.read_again(plan, unit, pieces.problems_at(looked_at))
    made = {}
    for k, table in rows.items():
        loop = plan.places.loops[k]
        made[loop.name] = follow(table, looks[loop.name], loop, states.get(loop.name))
    pieces.write_followed(plan, unit, made, states, path)


def _cut(i: int, chosen: dict[int, list[tuple[int, int]]], path: Path) -> None:
    """Cut the chosen windows of a unit, in a process of its own."""
    plan, work = _plan()
    unit = plan.units[i]
    rows = pieces.read_again(plan, unit, pieces.problems_at(work / "days" / f"{unit.key}.parquet"))
    write_piece(path, (cut(rows[k], plan.places.loops[k], w) for k, w in sorted(chosen.items()) if k in rows), SAMPLES)


def _judge(k: int, days: pa.Table, crossings: pa.Table, paths: Sequence[Path]) -> str:
    """Judge a loop, or find that the same days and samples were judged before; the name of its pieces."""
    plan, work = _plan()
    loop = plan.places.loops[k]
    tables = [read_piece(path, filters=pc.field("loop") == loop.name)[0].cast(SAMPLES) for path in paths]
    samples = pa.concat_tables(tables) if tables else SAMPLES.empty_table()
    samples = samples.sort_by([("window", "ascending"), ("t", "ascending")])
    key = pieces.judged_key(samples, days, crossings, loop)
    if not (work / "loops" / f"{key}.parquet").exists():
        pieces.write_judged(work, key, *judge(samples, days, crossings, loop))
    return key
