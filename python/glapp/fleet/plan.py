"""Plan of a run over a lake: its loops, and the units of their days."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import pyarrow as pa

from ..errors import InputError
from ..loop import Loop
from ..writing import write_file
from .lake import DAY, File, Places, index_file, places, touched
from .problems import DataIssue
from .results import digest
from .settings import NAMES, read_loops

__all__ = ["AT_ONCE", "FORM", "Engine", "Plan", "Stage", "Unit", "plan_of"]

AT_ONCE = 4_000_000
"""Most rows of a unit, as far as its files show it: some 0.5 GB of memory a process."""

FORM = 6
"""Form of the pieces: with a later one all of them are made again."""


class Stage(Protocol):
    """Called with how far a part of the run is: its name, how many pieces it has, how many are there."""

    def __call__(self, name: str, total: int, done: int) -> None:
        """Take the news."""


@dataclass(frozen=True, slots=True)
class Unit:
    """One day of some loops, or a part of one.

    - `day`, `part`: the day since 1970 UTC, and which part of it.
    - `begin`, `end`: from when to before when [µs since 1970 UTC].
    - `loops`: places in `Plan.places.loops`.
    - `files`: those that may hold their rows.
    - `key`: checksum of all that its rows are made of.
    - `before`: of each of its loops the unit before, by its place in `Plan.units`; each once.
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
    """Plan of a run, before any signal was read.

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
    """Engine of a run: it gives the rows of DAYS, CROSSINGS, WINDOWS and LOOPS by these names, and the data issues."""

    def __call__(self, plan: Plan, out: Path, stage: Stage) -> tuple[dict[str, pa.Table], list[DataIssue]]:
        """Do all of it."""


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
        first = f"{problems[0].file}: {problems[0].what}" if problems else None
        raise InputError("holds no Parquet file that can be read", file=str(lake), hint=first)
    known, wrong = places(files, given, {})
    problems = _without_zone_once(problems)
    checksum = digest(
        version("glapp"), FORM, [loop.model_dump(mode="json", exclude={"file", "files"}) for loop in known.loops]
    )
    units = _units(files, known)
    return Plan(lake, tuple(given or ()), known, tuple(units), tuple(files), (*problems, *wrong), fits, checksum)


def _without_zone_once(problems: Sequence[DataIssue]) -> list[DataIssue]:
    """The data issues, those of files without a zone as one: a lake has thousands of such files, or none."""
    without = [one for one in problems if one.code == "no_zone"]
    if len(without) < 2:
        return [*problems]
    first, *more = without
    told = first._replace(what=f"{first.what}; so are those of {len(more)} other file{'s' * (len(more) > 1)}")
    return [told, *(one for one in problems if one.code != "no_zone")]


def _indexed(
    lake: Path, names: Sequence[str], folder: Path, zone: str | None, workers: int
) -> Iterable[tuple[File | None, list[DataIssue]]]:
    """The look at every file, from the last run where it has not changed."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {}
    for name in names:
        state = (lake / name).stat()
        paths[name] = folder / digest(version("glapp"), FORM, name, state.st_size, state.st_mtime_ns, zone)
    for old in set(folder.iterdir()) - set(paths.values()):
        old.unlink()

    def one(name: str) -> tuple[File | None, list[DataIssue]]:
        path = paths[name]
        if path.exists():
            known, problems = json.loads(path.read_text(encoding="utf-8"))
            return None if known is None else File.of(known), [DataIssue(*problem) for problem in problems]
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
                    contents = (settings[loops.start : loops.stop], made_of, _columns(of, known, loops))
                    key = digest(version("glapp"), FORM, day, begin, end, *contents)
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
    """Columns by the settings: they may change while the files do not."""
    wide = [sorted(name for name, (i, _) in known.of(file).items() if i in loops) for file in files if not file.long]
    return [wide, sorted(name for name, (i, _) in known.long.items() if i in loops)]
