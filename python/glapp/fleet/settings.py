"""Settings of a lake's loops: a loops.toml, or a table with a row a loop."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from ..errors import InputError
from ..loop import Loop
from ..reading.settings import read_each
from .problems import DataIssue

__all__ = ["NAMES", "read_loops"]

NAMES = ("loops.toml", "loops.parquet", "loops.csv")
"""Names that are looked for in a lake where no settings are given."""


def read_loops(path: Path) -> tuple[list[Loop], list[DataIssue]]:
    """The loops of a loops.toml, or of a CSV or Parquet table with a row a loop; a loop with a fault is a problem.

    The columns of a table are the keys of a loops.toml with a dot for keys of an inner table
    (`controller.k`, `positioner.type`, `columns.pv`), spans as two columns (`pv_span.low`, `pv_span.high`) and the name
    as `loop`. An empty cell is a key that is not given.

    Raises InputError where the file cannot be used as a whole, or no loop in it can.
    """
    if path.suffix == ".toml":
        each = list(read_each(path))
    else:
        each = [_loop(row, i, path) for i, row in enumerate(_table(path).to_pylist(), start=2)]
    loops = [loop for loop in each if isinstance(loop, Loop)]
    twice = {loop.name for loop in loops if [other.name for other in loops].count(loop.name) > 1}
    problems = [
        DataIssue(
            "settings", error.what, error.hint or "correct the settings", path.name, error.row, loop=error.loop or ""
        )
        for error in each
        if isinstance(error, InputError)
    ]
    problems += [
        DataIssue("settings", "is there more than once, and is left out", "leave one", path.name, loop=name)
        for name in sorted(twice)
    ]
    problems += [
        DataIssue(
            "settings",
            "has the key repaired, which a fleet does not use: days before the repair count too",
            "analyse the loop by itself with glapp analyze, or leave the days before out of the lake",
            path.name,
            loop=loop.name,
        )
        for loop in loops
        if loop.repaired is not None
    ]
    if not loops:
        raise each[0] if each else InputError("names no loop", file=str(path))  # type: ignore[misc]
    kept = [loop for loop in loops if loop.name not in twice]
    return [loop if loop.repaired is None else loop.model_copy(update={"repaired": None}) for loop in kept], problems


def _table(path: Path) -> pa.Table:
    """Table of settings in CSV or Parquet."""
    try:
        if path.suffix == ".csv":
            return pyarrow.csv.read_csv(path)
        return pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        hint = "settings are a loops.toml, or a CSV or Parquet table with a row a loop"
        raise InputError(f"cannot be read: {error}", file=str(path), hint=hint) from None


def _loop(row: dict[str, Any], number: int, path: Path) -> Loop | InputError:
    """A loop from a row of the table, or the error in it."""
    made: dict[str, Any] = {}
    name = str(row.pop("loop", None) or "")
    for key, value in row.items():
        if value is None or value == "" or (isinstance(value, float) and math.isnan(value)):
            continue
        table, _, inner = key.partition(".")
        if not inner:
            made[key] = value
        elif inner in ("low", "high"):
            span = made.setdefault(table, [None, None])
            span[inner == "high"] = value
        else:
            made.setdefault(table, {})[inner] = value
    try:
        if not name:
            raise InputError("is empty", parameter="loop", hint="a row has the name of its loop in the column loop")
        for key, span in made.items():
            if isinstance(span, list) and None in span:
                raise InputError("has one end only", parameter=key, value=span, bound="low and high")
        loop = Loop(name=name, **made)
        loop.ideal()
        loop.kp()
    except InputError as error:
        what = f"{error.parameter}: {error.what}" if error.parameter else error.what
        return InputError(what, file=str(path), row=number, loop=name, hint=error.hint)
    return loop
