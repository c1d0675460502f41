"""The pieces of a run: what each is made of, its name, and how it is written and read.

A piece is a file whose name is the checksum of all that it is made of: one that is there is not made again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from ..errors import InputError
from ..loop import Loop
from .history import CROSSINGS, FOLLOWED
from .lake import DAY, rows_of
from .plan import FORM, Plan, Unit
from .problems import DataIssue
from .results import digest, read_piece, write_piece
from .windows import LOOPS, SAMPLES, WINDOWS, choose

__all__ = [
    "answers_of",
    "chosen_of",
    "crossings_of",
    "follow_paths",
    "judged_key",
    "looks_of",
    "problems_at",
    "read_again",
    "states_of",
    "tidy",
    "together",
    "unit_rows",
    "write_followed",
    "write_judged",
]


def follow_paths(plan: Plan, work: Path) -> list[Path]:
    """The piece of each unit's crossings: its name holds the unit and all before it."""
    keys: list[str] = []
    for unit in plan.units:
        keys.append(digest(unit.key, [keys[i] for i in unit.before]))
    return [work / "crossings" / f"{key}.parquet" for key in keys]


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
    """Rows of CROSSINGS, from the first with settings on, without their states."""
    rows = together(paths, CROSSINGS, [])
    return rows.filter(pc.and_(pc.is_valid(rows["day"]), pc.is_valid(rows["crossings"])))


def together(paths: Iterable[Path], schema: pa.Schema, problems: list[DataIssue]) -> pa.Table:
    """The columns of a schema of several pieces, and the data issues in making them."""
    tables = []
    for path in paths:
        table, wrong = read_piece(path, columns=schema.names)
        tables.append(table)
        problems += wrong
    return pa.concat_tables(tables).cast(schema) if tables else schema.empty_table()


def tidy(work: Path, used: set[Path], keys: Iterable[str]) -> None:
    """Delete pieces that no longer belong to the results, and files that a stopped run left unfinished."""
    used = used | {work / folder / f"{key}.parquet" for key in keys for folder in ("loops", "of_loops")}
    for folder in ("days", "crossings", "samples", "loops", "of_loops"):
        for path in (work / folder).glob("*"):
            if path not in used:
                path.unlink(missing_ok=True)
        for path in (work / folder).glob(".*.part"):
            path.unlink(missing_ok=True)


def unit_rows(plan: Plan, unit: Unit) -> tuple[dict[int, pa.Table], list[DataIssue]]:
    """The rows of a unit, by the place of their loop."""
    return rows_of(plan.lake, unit.files, plan.places, unit.loops, unit.begin, unit.end)


def read_again(plan: Plan, unit: Unit, known: Iterable[DataIssue]) -> dict[int, pa.Table]:
    """The rows of a unit that was looked at, with the problems that were met then.

    Raises InputError where something cannot be read now that could be then: left out here it would be lost without a
    word.
    """
    rows, problems = unit_rows(plan, unit)
    for one in sorted(set(problems) - set(known)):
        hint = "see that the disk and the network hold, then run it again: it goes on where it stopped"
        raise InputError(f"could be read before, and not now: {one.what}", file=str(plan.lake / one.file), hint=hint)
    return rows


def problems_at(path: Path) -> list[DataIssue]:
    """The problems that were met in making a piece."""
    return read_piece(path, columns=["loop"])[1]


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


def judged_key(samples: pa.Table, days: pa.Table, crossings: pa.Table, loop: Loop) -> str:
    """The name of a loop's pieces: the checksum of all that its answer is made of, samples in the order of time.

    It depends on values, not on how they lie in memory: the same on every engine.
    """
    settings = loop.model_dump(mode="json", exclude={"file", "files"})
    signals = [hashlib.sha256(samples[name].to_numpy().tobytes()).hexdigest() for name in SAMPLES.names[1:]]
    of = [table.sort_by([("day", "ascending"), ("part", "ascending")]).to_pydict() for table in (days, crossings)]
    return digest(version("glapp"), FORM, settings, signals, of)


def write_judged(work: Path, key: str, row: pa.Table, windows: pa.Table, problems: Iterable[DataIssue]) -> None:
    """Write the answer of a loop, its windows first: where the piece of its row is, both are."""
    write_piece(work / "of_loops" / f"{key}.parquet", [windows], WINDOWS)
    write_piece(work / "loops" / f"{key}.parquet", [row], LOOPS, problems)


def answers_of(work: Path, keys: Sequence[str], problems: list[DataIssue]) -> tuple[pa.Table, pa.Table]:
    """Rows of LOOPS and WINDOWS, and the data issues in making them."""
    loops = together([work / "loops" / f"{key}.parquet" for key in keys], LOOPS, problems)
    return loops, together([work / "of_loops" / f"{key}.parquet" for key in keys], WINDOWS, [])
