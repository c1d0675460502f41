"""Settings of a lake's loops: a loops.toml, or a table with a row a loop."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ..errors import InputError
from ..loop import Loop
from ..reading.csv import encoding_of
from ..reading.files import separator_of
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
    if path.suffix.lower() == ".toml":
        each = list(read_each(path))
    else:
        each = [_loop(row, number, path) for number, row in _rows(path)]
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


_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")


def _rows(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """Rows of a table of settings in CSV or Parquet, each with the number of its line or row."""
    try:
        if path.suffix.lower() == ".csv":
            text = path.read_bytes()
            yield from _of_csv(text.decode(encoding_of(text, True, str(path))), str(path))
        else:
            yield from enumerate(pq.read_table(path).to_pylist(), start=1)
    except (OSError, UnicodeDecodeError, csv.Error, pa.ArrowException) as error:
        hint = "settings are a loops.toml, or a CSV or Parquet table with a row a loop"
        what = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise InputError(f"cannot be read: {what}", file=str(path), hint=hint) from None


def _of_csv(text: str, label: str) -> Iterator[tuple[int, dict[str, str]]]:
    """Rows of a CSV table as texts: a number's unit is that of its key, and a loop called 101 has a name.

    Semicolons, tabs and decimal commas are understood as spreadsheets write them in Europe.
    """
    separator = separator_of(text[: text.find("\n")])
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    names = [name.strip() for name in next(reader, [])]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError("is there twice", file=label, row=1, column=twice, hint="leave one")
    if "loop" not in names:
        what = f"has no column 'loop' for the names of the loops; its columns are {', '.join(names[:20])}"
        raise InputError(what, file=label, row=1, hint="the first row has the keys of a loops.toml, and loop")
    for cells in reader:
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(names):
            what = f"has {len(cells)} cells, and the first row has {len(names)}"
            hint = "put texts with the separator in them into quotes"
            raise InputError(what, file=label, row=reader.line_num, hint=hint)
        row = dict(zip(names, map(str.strip, cells), strict=True))
        if separator != ",":
            row = {
                key: cell.replace(",", ".") if key != "loop" and _DECIMAL_COMMA.fullmatch(cell) else cell
                for key, cell in row.items()
            }
        yield reader.line_num, row


def _loop(row: dict[str, Any], number: int, path: Path) -> Loop | InputError:
    """A loop from a row of the table, or the error in it."""
    made: dict[str, Any] = {}
    name = str(row.pop("loop", None) or "")
    given = {
        key: value
        for key, value in row.items()
        if not (value is None or value == "" or (isinstance(value, float) and math.isnan(value)))
    }
    try:
        if not name:
            raise InputError("is empty", parameter="loop", hint="a row has the name of its loop in the column loop")
        for key, value in given.items():
            table, _, inner = key.partition(".")
            if not inner:
                made[key] = value
            elif table in given:
                raise InputError(f"is there, and {key} too", parameter=table, value=given[table], hint="leave one")
            elif inner in ("low", "high"):
                made.setdefault(table, [None, None])[inner == "high"] = value
            else:
                made.setdefault(table, {})[inner] = value
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
