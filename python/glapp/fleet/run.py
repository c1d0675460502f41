"""A lake from beginning to end: in pieces, each made once, on all cores of this machine and in bounded memory.

::

    files ──index──→ groups of rows ──plan──→ units: a day (UTC) of some loops, or a part of one
    unit ──look──→ rows of DAYS ──choose──→ windows ──cut──→ their samples ──judge──→ rows of WINDOWS and LOOPS
    unit, its look and the state of the unit before ──follow──→ rows of CROSSINGS, and the state of the next

A piece is a file in `RESULTS/work` whose name is the checksum of all that it is made of: version, settings, and name,
size and time of change of the files; that of a unit's crossings tells those of all units before it too. What is there
already is not made again, so an interrupted run goes on where it was, and a later one makes only what a new or changed
file touches: its days, and the crossings from the earliest of them on. The tables are the same to the bit either way.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import pyarrow as pa
import pyarrow.compute as pc

from ..errors import InputError
from ..loop import Loop
from ..service.store import Lock
from ..writing import write_file
from .history import CROSSINGS, FOLLOWED, follow
from .lake import DAY, File, Places, files_of, index_file, loop_of_path, places, rows_of, touched
from .problems import LEFT_OUT, LOST, DataIssue, problem_table, problems_of
from .results import INPUTS, digest, publish, read_piece, write_piece
from .settings import NAMES, read_loops
from .windows import DAYS, FITS, LOOPS, SAMPLES, WINDOWS, choose, cut, judge, look, refused

__all__ = [
    "AT_ONCE",
    "Engine",
    "Plan",
    "Stage",
    "Unit",
    "analyze",
    "answers_of",
    "chosen_of",
    "crossings_of",
    "follow_paths",
    "judged_key",
    "looks_of",
    "plan_of",
    "problems_at",
    "read_again",
    "states_of",
    "tidy",
    "together",
    "unit_rows",
    "write_followed",
    "write_judged",
]

AT_ONCE = 4_000_000
"""Rows of a unit at most, as far as its files show it: some 0.5 GB of memory a process."""

_FORM = 3
"""Form of the pieces: a later one makes all of them anew."""


class Stage(Protocol):
    """Told how far a part of the run is: its name, how many pieces it has, how many are there."""

    def __call__(self, name: str, total: int, done: int) -> None:
        """Take the news."""


@dataclass(frozen=True, slots=True)
class Unit:
    """One day of some loops, or a part of one.

    Attributes
    ----------
    day, part : int
        The day since 1970 UTC, and which part of it.
    begin, end : int
        From when to before when [µs since 1970 UTC].
    loops : range
        Places in `Plan.places.loops`.
    files : tuple of File
        Those that may hold their rows.
    key : str
        Checksum of all that its rows are made of.
    before : tuple of int
        Of each of its loops the unit before, by its place in `Plan.units`; each once.
    """

    day: int
    part: int
    begin: int
    end: int
    loops: range
    files: tuple[File, ...]
    key: str
    before: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Plan:
    """What is to be done, before any signal was read.

    `given` are the loops of the settings, none where there are no settings.
    """

    lake: Path
    given: tuple[Loop, ...]
    places: Places
    units: tuple[Unit, ...]
    files: tuple[File, ...]
    problems: tuple[DataIssue, ...]
    fits: int
    settings: str


class Engine(Protocol):
    """Who does the work: it gives the rows of DAYS, CROSSINGS, WINDOWS and LOOPS by these names, and what was wrong."""

    def __call__(self, plan: Plan, out: Path, stage: Stage) -> tuple[dict[str, pa.Table], list[DataIssue]]:
        """Do all of it."""


def analyze(
    lake: str | Path,
    out: str | Path,
    *,
    loops: str | Path | None = None,
    time_zone: str | None = None,
    fits: int = FITS,
    engine: str = "local",
    workers: int | None = None,
    stage: Stage | None = None,
) -> dict[str, Any]:
    """Judge the valves of a lake, and write the results; what was made before is not made again.

    Parameters
    ----------
    lake : str or Path
        Folder of Parquet files, long or wide, in any folders below it.
    out : str or Path
        Folder of the results, made where it is missing; not within the lake.
    loops : str or Path, optional
        Settings: a loops.toml, or a CSV or Parquet table with a row a loop. By default the lake's own `loops.toml`,
        `loops.parquet` or `loops.csv`; where there is none, the loops that the names of tags show.
    time_zone : str, optional
        IANA name of the zone of times without one; by default the one that all loops' settings name.
    fits : int
        Windows that are fitted of a loop at most, 1 to 64: each takes about a second of one core.
    engine : {"local", "spark"}
        This machine's cores, or Spark (extra `spark`).
    workers : int, optional
        Processes; by default one a core.
    stage : callable, optional
        Told the name of each part of the run, how many pieces it has, and how many are there.

    Returns
    -------
    dict
        The manifest of the results.

    Raises
    ------
    InputError
        Where lake or settings cannot be used at all, results cannot be written, another process writes them, or one
        that works for this one ends. All else that is wrong is a row in the table `problems`.

    Examples
    --------
    >>> import tempfile
    >>> from glapp import fleet
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     fleet.analyze(folder, folder + "/results")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    glapp.errors.InputError: ...: holds no .parquet file; glapp fleet make-demo writes a lake to try
    """
    lake, out = Path(lake), Path(out)
    if not 1 <= fits <= 64:
        raise InputError(f"is {fits}, must be 1 to 64", parameter="fits", value=fits, bound="1 to 64")
    if engine not in ("local", "spark"):
        raise InputError(f"is {engine!r}, must be 'local' or 'spark'", parameter="engine", value=engine)
    names, wrong = files_of(lake)
    if out.resolve().is_relative_to(lake.resolve()) and not out.name.startswith(("_", ".")):
        hint = "name a folder outside the lake: what is in it would be read as part of the lake"
        raise InputError("lies within the lake", file=str(out), parameter="out", hint=hint)
    tell: Stage = stage if stage is not None else lambda name, total, done: None
    out.mkdir(parents=True, exist_ok=True)
    lock = Lock(out / "work")
    begun = time.monotonic()
    try:
        if engine == "spark":
            from .spark import run as run_on

            work: Engine = run_on
        else:
            work = _Local(workers or os.cpu_count() or 1)
        plan = plan_of(lake, names, out, loops, time_zone, fits, tell, workers or os.cpu_count() or 1)
        plan = replace(plan, problems=(*wrong, *plan.problems))
        made_of, problems = work(plan, out, tell)
        problems = [*plan.problems, *problems, *_changed(plan)]
        made_of["loops"], more = _whole(made_of["loops"], plan, problems)
        problems += more
        orders = {"days": ("day", "part"), "crossings": ("day", "part"), "windows": ("first",)}
        tables = {
            **{name: made_of[name].sort_by([(c, "ascending") for c in ("loop", *by)]) for name, by in orders.items()},
            "loops": _ranked(made_of["loops"]),
            "problems": problem_table(problems),
            "inputs": _inputs(plan.files),
        }
        about = {
            "provenance": {"glapp": version("glapp"), "settings": plan.settings, "fits": fits},
            "lake": str(lake),
            "lost": _lost(tables),
            "written": datetime.now(UTC).isoformat(timespec="seconds"),
            "engine": engine,
            "seconds": round(time.monotonic() - begun, 3),
        }
        made = publish(out, tables, about)
        from .report import write_report

        write_report(out)
        return made
    except BrokenProcessPool:
        hint = "give it fewer processes (--workers) or more memory, then run it again: it goes on where it stopped"
        raise InputError("a process ended in its work, as for want of memory", file=str(out), hint=hint) from None
    except OSError as error:
        hint = "make room, then run it again: it goes on where it stopped"
        raise InputError(f"cannot be written: {error.strerror or error}", file=str(out), hint=hint) from None
    finally:
        lock.release()


REFUSED = ("loop_tags", "no_tags", "settings", "unreadable")
"""Codes of problems of the plan that leave a loop without a row, the one to be told first."""


def _whole(loops: pa.Table, plan: Plan, problems: Sequence[DataIssue]) -> tuple[pa.Table, list[DataIssue]]:
    """The answers with a row of every loop that is known and was not judged, refused with its reason.

    Each row gets how many files with its signals, or parts of them, could not be read. A loop that only its files'
    names tell is one of those that were lost with all their files.
    """
    known = {loop.name: loop for loop in (*plan.given, *plan.places.loops)}
    more: list[DataIssue] = []
    judged = set(loops["loop"].to_pylist())
    lost = _parts_lost(plan, problems)
    why = {one.file: f": {one.file}: {one.what}" for one in reversed(problems) if one.code in LOST}
    rows = [loops]
    for loop in plan.places.loops:
        if loop.name not in judged:
            first = next(iter(lost.get(loop.name, [])), "")
            what = f"none of its rows can be used, and it is not judged{why.get(first, '')}"
            more.append(DataIssue("no_rows", what, "see what is wrong with its files", loop=loop.name))
            rows.append(refused(loop, "no_rows", what))
            judged.add(loop.name)
    for code in REFUSED:
        for one in (problem for problem in problems if problem.code == code):
            name = one.loop or (f"row {one.row} of {one.file}" if code == "settings" and one.row else "")
            if code == "unreadable" and not plan.given:
                name = loop_of_path(one.file, plan.files, plan.places) or ""
                lost.setdefault(name, []).append(one.file)
            if name and name not in judged:
                what = f"{one.file}: {one.what}" if one.file else one.what
                rows.append(refused(known.get(name) or Loop(name=name), code, what))
                judged.add(name)
    table = pa.concat_tables(rows)
    counts = [len(lost.get(name, ())) for name in table["loop"].to_pylist()]
    return table.set_column(LOOPS.get_field_index("lost"), LOOPS.field("lost"), pa.array(counts, pa.int64())), more


def _parts_lost(plan: Plan, problems: Sequence[DataIssue]) -> dict[str, list[str]]:
    """Files of every loop of which something could not be read, once a part that is lost."""
    of_file: dict[str, int] = {}
    for name, _ in {(one.file, one.row) for one in problems if one.code in LOST}:
        of_file[name] = of_file.get(name, 0) + 1
    found: dict[str, list[str]] = {}
    for file in plan.files:
        if parts := of_file.get(file.name):
            at = plan.places.of(file)
            for k in {at[name][0] for name in (file.tags if file.long else at) if name in at}:
                found.setdefault(plan.places.loops[k].name, []).extend([file.name] * parts)
    return found


def _changed(plan: Plan) -> list[DataIssue]:
    """Files that are others now than when they were looked at: what was read of them may be of either."""

    def state(file: File) -> tuple[int, int] | None:
        try:
            found = (plan.lake / file.name).stat()
        except OSError:
            return None
        return found.st_size, found.st_mtime_ns

    what, todo = "changed while it was read", "run it once more, when nothing writes into the lake"
    return [
        DataIssue("changed", what, todo, file.name) for file in plan.files if state(file) != (file.size, file.mtime_ns)
    ]


def _lost(tables: Mapping[str, pa.Table]) -> dict[str, int]:
    """What of the lake is not in the answers: the one count for the headline, the report and the exit code."""
    problems = problems_of(tables["problems"])
    parts = [one for one in problems if one.code in LOST]
    return {
        "loops": pc.sum(pc.equal(tables["loops"]["valve"], "refused")).as_py() or 0,
        "files": len({one.file for one in parts}),
        "rows": sum(one.rows for one in parts),
        "left_out": sum(one.rows for one in problems if one.code in LEFT_OUT),
    }


def plan_of(
    lake: Path,
    names: Sequence[str],
    out: Path,
    settings: str | Path | None,
    time_zone: str | None,
    fits: int,
    stage: Stage,
    workers: int,
) -> Plan:
    """Look at every file, and say which loops there are and in which units their days are read."""
    path = Path(settings) if settings is not None else next((lake / n for n in NAMES if (lake / n).is_file()), None)
    given, problems = (None, []) if path is None else read_loops(path)
    zones = {loop.time_zone for loop in given or ()}
    zone = time_zone or (zones.pop() if len(zones) == 1 else None)
    checked = Loop(name="lake", time_zone=zone).time_zone  # an unknown one is refused here, before anything is read
    files: list[File] = []
    stage("files", len(names), 0)
    for i, (file, wrong) in enumerate(_indexed(lake, names, out / "work" / "files", checked, workers), start=1):
        problems += wrong
        files += [] if file is None else [file]
        stage("files", len(names), i)
    if not files:
        raise InputError("holds no file that can be read", file=str(lake), hint=problems[0].what if problems else None)
    known, wrong = places(files, given, {})
    told = digest(
        version("glapp"), _FORM, [loop.model_dump(mode="json", exclude={"file", "files"}) for loop in known.loops]
    )
    units = _units(files, known)
    return Plan(lake, tuple(given or ()), known, tuple(units), tuple(files), (*problems, *wrong), fits, told)


def _indexed(
    lake: Path, names: Sequence[str], folder: Path, zone: str | None, workers: int
) -> Iterable[tuple[File | None, list[DataIssue]]]:
    """The look at every file, from the last run where it has not changed."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {}
    for name in names:
        state = (lake / name).stat()
        paths[name] = folder / digest(version("glapp"), _FORM, name, state.st_size, state.st_mtime_ns, zone)
    for old in set(folder.iterdir()) - set(paths.values()):
        old.unlink()

    def one(name: str) -> tuple[File | None, list[DataIssue]]:
        path = paths[name]
        if path.exists():
            known, told = json.loads(path.read_text(encoding="utf-8"))
            return None if known is None else File.of(known), [DataIssue(*problem) for problem in told]
        file, wrong = index_file(lake, name, zone)
        write_file(path, json.dumps([None if file is None else asdict(file), [list(one) for one in wrong]]))
        return file, wrong

    with ThreadPoolExecutor(workers) as pool:  # Arrow decodes without the interpreter's lock
        yield from pool.map(one, names)


def _units(files: Sequence[File], known: Places) -> list[Unit]:
    """Days of as many loops as `AT_ONCE` allows, and parts of days where one loop has more.

    A file takes part where a group of its rows may hold some of them.
    """
    settings = [loop.model_dump(mode="json", exclude={"file", "files"}) for loop in known.loops]
    by_day: dict[int, list[File]] = {}
    for file in files:
        for day in sorted({d for g in file.groups if g.readable for d in range(g.first // DAY, g.last // DAY + 1)}):
            by_day.setdefault(day, []).append(file)
    units: list[Unit] = []
    last: dict[int, int] = {}
    for day, here in sorted(by_day.items()):
        span, every = (day * DAY, (day + 1) * DAY), range(len(known.loops))
        pieces = min(max(-(-_expected(here, known, every, *span) // AT_ONCE), 1), max(len(known.loops), 1))
        ends = [round(i * len(known.loops) / pieces) for i in range(pieces + 1)]
        for loops in (range(*pair) for pair in pairwise(ends)):
            for part, (begin, end) in enumerate(_slices(here, known, loops, *span)):
                of = tuple(f for f in here if any(touched(f, g, known, loops, begin, end) for g in f.groups))
                if of:
                    made_of = [(file.name, file.size, file.mtime_ns, file.zone) for file in of]
                    told = (settings[loops.start : loops.stop], made_of, _columns(of, known, loops))
                    key = digest(version("glapp"), _FORM, day, begin, end, *told)
                    before = tuple(sorted({last[k] for k in loops if k in last}))
                    units.append(Unit(day, part, begin, end, loops, of, key, before))
                    last.update(dict.fromkeys(loops, len(units) - 1))
    return units


def _slices(files: Sequence[File], known: Places, loops: range, begin: int, end: int) -> list[tuple[int, int]]:
    """Slices of a time, halved until none has more than `AT_ONCE` rows."""
    if end - begin <= 1_000_000 or _expected(files, known, loops, begin, end) <= AT_ONCE:
        return [(begin, end)]
    middle = (begin + end) // 2
    return [*_slices(files, known, loops, begin, middle), *_slices(files, known, loops, middle, end)]


def _expected(files: Sequence[File], known: Places, loops: range, begin: int, end: int) -> int:
    """Rows that these loops have within that time, as far as groups of rows show it: where theirs lie evenly."""
    rows = 0.0
    for file in files:
        at = known.of(file)
        for group in file.groups:
            if touched(file, group, known, loops, begin, end):
                within = (min(group.last + 1, end) - max(group.first, begin)) / (group.last + 1 - group.first)
                names = group.tags if file.long else at
                wanted = sum(name in at and at[name][0] in loops for name in names)
                rows += group.rows * within * wanted / (len(names) if file.long else 1)
    return round(rows)


def _columns(files: Sequence[File], known: Places, loops: range) -> list[Any]:
    """What the settings make of the names in files: they may change while the files do not."""
    wide = [sorted(name for name, (i, _) in known.of(file).items() if i in loops) for file in files if not file.long]
    return [wide, sorted(name for name, (i, _) in known.long.items() if i in loops)]


def _inputs(files: Sequence[File]) -> pa.Table:
    rows = []
    for file in files:
        groups = [group for group in file.groups if group.readable]
        ends = (
            {"first": min(group.first for group in groups), "last": max(group.last for group in groups)}
            if groups
            else {}
        )
        rows.append(
            {
                "file": file.name,
                "size": file.size,
                "mtime_ns": file.mtime_ns,
                "layout": "long" if file.long else "wide",
                "rows": sum(group.rows for group in groups),
                "unreadable": sum(group.rows for group in file.groups if not group.readable),
                **ends,
            }
        )
    return pa.Table.from_pylist(rows, schema=INPUTS)


def _ranked(loops: pa.Table) -> pa.Table:
    """Loops in the order in which to repair them: by the rank of the answer."""
    return pa.Table.from_pylist(sorted(loops.to_pylist(), key=lambda row: (row["rank"], row["loop"])), schema=LOOPS)


# --- this machine


class _Local:
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
                _all(
                    pool, _look, [(i,) for i, path in enumerate(looks) if not path.exists()], "days", len(looks), stage
                )
                days = together(looks, DAYS, problems)
                follows = follow_paths(plan, work)
                _chained(pool, plan, follows, stage)
                crossings = crossings_of(follows)
                chosen = chosen_of(days, plan)
                cuts, asked = [], []
                for i, unit in enumerate(plan.units):
                    here = {k: w for k in unit.loops if (w := chosen.get((k, i)))}
                    if here:
                        path = work / "samples" / f"{digest(unit.key, sorted(here.items()))}.parquet"
                        cuts.append((here, path))
                        asked += [] if path.exists() else [(i, here, path)]
                _all(pool, _cut, asked, "windows", len(cuts), stage)
                by_loop: dict[int, list[Path]] = {}
                for here, path in cuts:
                    for k in here:
                        by_loop.setdefault(k, []).append(path)
                having = set(days.column("loop").to_pylist())
                order = [k for k, loop in enumerate(plan.places.loops) if loop.name in having]
                names = [plan.places.loops[k].name for k in order]
                of = [tuple(t.filter(pc.equal(t["loop"], name)) for t in (days, crossings)) for name in names]
                tasks = [(k, *tables, by_loop.get(k, [])) for k, tables in zip(order, of, strict=True)]
                keys = _all(pool, _judge, tasks, "loops", len(order), stage)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
        loops, windows = answers_of(work, keys, problems)
        tidy(work, {*looks, *follows, *(path for _, path in cuts)}, keys)
        return {"days": days, "crossings": crossings, "windows": windows, "loops": loops}, problems


def follow_paths(plan: Plan, work: Path) -> list[Path]:
    """The piece of each unit's crossings: its name tells the unit and all before it."""
    keys: list[str] = []
    for unit in plan.units:
        keys.append(digest(unit.key, [keys[i] for i in unit.before]))
    return [work / "crossings" / f"{key}.parquet" for key in keys]


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


def chosen_of(days: pa.Table, plan: Plan) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """The windows that are fitted, by the places of their loop and their unit."""
    of_day: dict[int, list[int]] = {}
    for i, unit in enumerate(plan.units):
        of_day.setdefault(unit.day, []).append(i)
    found: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for k, loop in enumerate(plan.places.loops):
        of = days.filter(pc.equal(days["loop"], loop.name))
        for first, last in choose(of, plan.fits) if len(of) else ():
            [i] = (
                i
                for i in of_day[first // DAY]
                if k in plan.units[i].loops and plan.units[i].begin <= first < plan.units[i].end
            )
            found.setdefault((k, i), []).append((first, last))
    return found


def crossings_of(paths: Iterable[Path]) -> pa.Table:
    """Rows of CROSSINGS, from the first that told settings, without the states beside them."""
    heard = together(paths, CROSSINGS, [])
    return heard.filter(pc.and_(pc.is_valid(heard["day"]), pc.is_valid(heard["crossings"])))


def together(paths: Iterable[Path], schema: pa.Schema, problems: list[DataIssue]) -> pa.Table:
    """The columns of a schema of several pieces, and what was wrong in making them."""
    tables = []
    for path in paths:
        table, wrong = read_piece(path, columns=schema.names)
        tables.append(table)
        problems += wrong
    return pa.concat_tables(tables).cast(schema) if tables else schema.empty_table()


def _all(
    pool: ProcessPoolExecutor, work: Callable[..., Any], tasks: Sequence[Any], name: str, total: int, stage: Stage
) -> list[Any]:
    """Have all tasks done; what they gave, in their order."""
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


def tidy(work: Path, used: set[Path], keys: Iterable[str]) -> None:
    """Take out pieces that are no longer part of the results, and what a stopped run left of one."""
    used = used | {work / folder / f"{key}.parquet" for key in keys for folder in ("loops", "of_loops")}
    for folder in ("days", "crossings", "samples", "loops", "of_loops"):
        for path in (work / folder).glob("*"):
            if path not in used:
                path.unlink(missing_ok=True)
        for path in (work / folder).glob(".*.part"):
            path.unlink(missing_ok=True)


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
    plan, work = _plan()
    unit = plan.units[i]
    tables, problems = looked(plan, unit)
    write_piece(work / "days" / f"{unit.key}.parquet", [pa.concat_tables(tables)] if tables else [], DAYS, problems)


def looked(plan: Plan, unit: Unit) -> tuple[list[pa.Table], list[DataIssue]]:
    """The look at every loop of a unit, in their order."""
    rows, problems = unit_rows(plan, unit)
    return [look(table, plan.places.loops[k], unit.day, unit.part) for k, table in sorted(rows.items())], problems


def unit_rows(plan: Plan, unit: Unit) -> tuple[dict[int, pa.Table], list[DataIssue]]:
    """The rows of a unit, by the place of their loop."""
    return rows_of(plan.lake, unit.files, plan.places, unit.loops, unit.begin, unit.end)


def read_again(plan: Plan, unit: Unit, known: Iterable[DataIssue]) -> dict[int, pa.Table]:
    """The rows of a unit that was looked at, with the problems that were met then.

    Raises
    ------
    InputError
        Where something cannot be read now that could be then: left out here it would be lost without a word.
    """
    rows, problems = unit_rows(plan, unit)
    for one in sorted(set(problems) - set(known)):
        hint = "see that the disk and the network hold, then run it again: it goes on where it stopped"
        raise InputError(f"could be read before, and not now: {one.what}", file=str(plan.lake / one.file), hint=hint)
    return rows


def problems_at(path: Path) -> list[DataIssue]:
    """The problems that were met in making a piece."""
    return read_piece(path, columns=["loop"])[1]


def _follow(i: int, before: Sequence[Path], path: Path) -> None:
    plan, work = _plan()
    unit = plan.units[i]
    looked_at = work / "days" / f"{unit.key}.parquet"
    looks = looks_of(looked_at)
    states: dict[str, str] = {}
    for one in before:
        states.update(states_of(one))
    rows = read_again(plan, unit, problems_at(looked_at))
    made = {}
    for k, table in rows.items():
        loop = plan.places.loops[k]
        made[loop.name] = follow(table, looks[loop.name], loop, states.get(loop.name))
    write_followed(plan, unit, made, states, path)


def write_followed(plan: Plan, unit: Unit, made: Mapping[str, pa.Table], states: Mapping[str, str], path: Path) -> None:
    """Write the crossings of a unit; the state of a loop that has no row in it goes on to the next."""
    tables = []
    for k in unit.loops:
        name = plan.places.loops[k].name
        if name in made:
            tables.append(made[name])
        elif name in states:
            tables.append(pa.Table.from_pylist([{"loop": name, "state": states[name]}], schema=FOLLOWED))
    write_piece(path, [pa.concat_tables(tables)] if tables else [], FOLLOWED)


def looks_of(path: Path) -> dict[str, pa.Table]:
    """The look at each loop of a unit."""
    days, _ = read_piece(path)
    return {name: days.slice(row, 1) for row, name in enumerate(days.column("loop").to_pylist())}


def states_of(path: Path) -> Iterable[tuple[str, str]]:
    """The state of each loop after a unit."""
    table, _ = read_piece(path, columns=["loop", "state"])
    return zip(table["loop"].to_pylist(), table["state"].to_pylist(), strict=True)


def _cut(i: int, chosen: dict[int, list[tuple[int, int]]], path: Path) -> None:
    plan, work = _plan()
    unit = plan.units[i]
    rows = read_again(plan, unit, problems_at(work / "days" / f"{unit.key}.parquet"))
    write_piece(path, (cut(rows[k], plan.places.loops[k], w) for k, w in sorted(chosen.items()) if k in rows), SAMPLES)


def _judge(k: int, days: pa.Table, crossings: pa.Table, paths: Sequence[Path]) -> str:
    """Judge a loop, or find that the same days and samples were judged before; the name of its pieces."""
    plan, work = _plan()
    loop = plan.places.loops[k]
    tables = [read_piece(path, filters=pc.field("loop") == loop.name)[0].cast(SAMPLES) for path in paths]
    samples = pa.concat_tables(tables) if tables else SAMPLES.empty_table()
    samples = samples.sort_by([("window", "ascending"), ("t", "ascending")])
    key = judged_key(samples, days, crossings, loop)
    if not (work / "loops" / f"{key}.parquet").exists():
        write_judged(work, key, *judge(samples, days, crossings, loop))
    return key


def judged_key(samples: pa.Table, days: pa.Table, crossings: pa.Table, loop: Loop) -> str:
    """The name of a loop's pieces: the checksum of all that its answer is made of, samples in the order of time.

    It is told by values, not by how they lie in memory: the same on every engine.
    """
    settings = loop.model_dump(mode="json", exclude={"file", "files"})
    signals = [hashlib.sha256(samples[name].to_numpy().tobytes()).hexdigest() for name in SAMPLES.names[1:]]
    of = [table.sort_by([("day", "ascending"), ("part", "ascending")]).to_pydict() for table in (days, crossings)]
    return digest(version("glapp"), _FORM, settings, signals, of)


def write_judged(work: Path, key: str, row: pa.Table, windows: pa.Table, problems: Iterable[DataIssue]) -> None:
    """Write the answer of a loop, its windows first: where the piece of its row is, both are."""
    write_piece(work / "of_loops" / f"{key}.parquet", [windows], WINDOWS)
    write_piece(work / "loops" / f"{key}.parquet", [row], LOOPS, problems)


def answers_of(work: Path, keys: Sequence[str], problems: list[DataIssue]) -> tuple[pa.Table, pa.Table]:
    """Rows of LOOPS and WINDOWS, and what was wrong in making them."""
    loops = together([work / "loops" / f"{key}.parquet" for key in keys], LOOPS, problems)
    return loops, together([work / "of_loops" / f"{key}.parquet" for key in keys], WINDOWS, [])
