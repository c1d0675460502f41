"""A lake from beginning to end: in pieces, each made once, on all cores of this machine and in bounded memory.

::

    files ──index──→ groups of rows ──plan──→ units: a day (UTC) of some loops, or a part of one
    unit ──look──→ rows of DAYS ──choose──→ windows ──cut──→ their samples ──judge──→ rows of WINDOWS and LOOPS
    unit, its look and the state of the unit before ──follow──→ rows of CROSSINGS, and the state of the next

A piece is a file in `RESULTS/work` whose name is the checksum of all that it is made of: version, settings, and name,
size and time of change of the files; that of a unit's crossings names those of all units before it too. What is there
already is not made again, so an interrupted run goes on where it was, and a later one makes only what a new or changed
file touches: its days, and the crossings from the earliest of them on. The tables are the same to the bit either way.
"""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from ..checked import check_one_of
from ..errors import InputError
from ..folder_lock import FolderLock
from ..loop import Loop
from .lake import File, files_of, loop_of_path
from .local import Local
from .plan import Engine, Plan, Stage, plan_of
from .problems import LEFT_OUT, LOST, DataIssue, problem_table, problems_of
from .results import INPUTS, publish
from .windows import FITS, LOOPS, refused

__all__ = ["analyze"]


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
    """Judge the valves of a lake, and write the results; finished parts are not made again.

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
        Called with the name of each part of the run, how many pieces it has, and how many are there.

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
    check_one_of(engine, "engine", ("local", "spark"))
    names, wrong = files_of(lake)
    if out.resolve().is_relative_to(lake.resolve()) and not out.name.startswith(("_", ".")):
        hint = "name a folder outside the lake: what is in it would be read as part of the lake"
        raise InputError("is within the lake", file=str(out), parameter="out", hint=hint)
    tell: Stage = stage if stage is not None else lambda name, total, done: None
    lock = FolderLock(out / "work")
    begun = time.monotonic()
    try:
        if engine == "spark":
            from .spark import run as run_on

            work: Engine = run_on
        else:
            work = Local(workers or os.cpu_count() or 1)
        plan = plan_of(lake, names, out, loops, time_zone, fits, tell, workers or os.cpu_count() or 1)
        plan = replace(plan, problems=(*wrong, *plan.problems))
        made_of, problems = work(plan, out, tell)
        problems = [*plan.problems, *problems, *_changed_files(plan)]
        made_of["loops"], more = _with_refused_loops(made_of["loops"], plan, problems)
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
            "lost": _lost_counts(tables),
            "written": datetime.now(UTC).isoformat(timespec="seconds"),
            "engine": engine,
            "seconds": round(time.monotonic() - begun, 3),
        }
        made = publish(out, tables, about)
        from .report import write_csv, write_report

        write_report(out)
        write_csv(out)
        return made
    except BrokenProcessPool:
        hint = "give it fewer processes (--workers) or more memory, then run it again: it goes on where it stopped"
        raise InputError("a process ended in its work, as for want of memory", file=str(out), hint=hint) from None
    except OSError as error:
        raise _not_done(error, lake, out) from None
    finally:
        lock.release()


def _not_done(error: OSError, lake: Path, out: Path) -> InputError:
    """Message where the lake cannot be read any more, or the results cannot be written."""
    what = error.strerror or str(error)
    if error.filename is not None and (path := Path(error.filename)).is_relative_to(lake):
        hint = "run it again when nothing moves the files of the lake: it goes on where it stopped"
        return InputError(f"cannot be read any more: {what}", file=str(path), hint=hint)
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    todo = "make room" if full else "give this account the right to write there"
    return InputError(
        f"cannot be written: {what}", file=str(out), hint=f"{todo}, then run it again: it goes on where it stopped"
    )


REFUSED = ("loop_tags", "no_pv", "unreadable", "no_tags", "settings")
"""Codes of problems of the plan that leave a loop without a row, the first one to be named."""


def _with_refused_loops(loops: pa.Table, plan: Plan, problems: Sequence[DataIssue]) -> tuple[pa.Table, list[DataIssue]]:
    """The answers with a row of every loop that is known and was not judged, refused with its reason.

    Each row gets how many files with its signals, or parts of them, could not be read. A loop that only its files'
    names show is one of those that were lost with all their files.
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
            if code == "no_pv" and name not in known:  # nobody asked for it
                continue
            if code == "unreadable":
                name = loop_of_path(one.file, plan.files, plan.places) or ""
                lost.setdefault(name, []).append(one.file)
                if plan.given and name not in known:
                    continue
            if name and name not in judged:
                at = f"{one.file}, row {one.row}" if one.row else one.file
                what = f"{at}: {one.what}" if at else one.what
                rows.append(refused(known.get(name) or Loop(name=name), code, what))
                judged.add(name)
    table = pa.concat_tables(rows)
    counts = [len(lost.get(name, ())) for name in table["loop"].to_pylist()]
    return table.set_column(LOOPS.get_field_index("lost"), LOOPS.field("lost"), pa.array(counts, pa.int64())), more


def _parts_lost(plan: Plan, problems: Sequence[DataIssue]) -> dict[str, list[str]]:
    """Files of every loop that could not be read in full, once per lost part."""
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


def _changed_files(plan: Plan) -> list[DataIssue]:
    """Files that have changed since they were looked at: their rows may be of either version."""

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


def _lost_counts(tables: Mapping[str, pa.Table]) -> dict[str, int]:
    """Counts of the lake's parts that are not in the answers, for the headline, the report and the exit code."""
    problems = problems_of(tables["problems"])
    parts = [one for one in problems if one.code in LOST]
    return {
        "loops": pc.sum(pc.equal(tables["loops"]["valve"], "refused")).as_py() or 0,
        "files": len({one.file for one in parts}),
        "rows": sum(one.rows for one in parts),
        "left_out": sum(one.rows for one in problems if one.code in LEFT_OUT),
        "not_understood": sum(one.code == "schema" for one in problems),
    }


def _inputs(files: Sequence[File]) -> pa.Table:
    """Table of the files of a run."""
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
