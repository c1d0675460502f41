"""Data issues of a lake: each is a row with its place, and the run goes on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import pyarrow as pa

__all__ = ["LEFT_OUT", "LOST", "PROBLEMS", "DataIssue", "problem_table", "problems_of"]

LOST = frozenset({"changed", "damaged", "folder", "time", "unreadable"})
"""Codes of data that are there and could not be read: a file, a folder, or some rows of a file."""

LEFT_OUT = frozenset({"clock_change", "no_tag", "no_time", "unit", "value"})
"""Codes of rows that were read and not used."""


class DataIssue(NamedTuple):
    """One fault, and where it is.

    - `code`: a word that stays the same, see `docs/fleet.md`.
    - `what`, `todo`: the fault with its value, and what to do about it.
    - `file`: file, relative to the lake; empty where it is of no one file.
    - `row`: first row that is touched, counted from 1.
    - `tag`, `loop`, `day`: tag or column, loop and day (ISO, UTC); empty where it is of none.
    - `rows`: rows that are touched; 0 where it is not of rows.
    """

    code: str
    what: str
    todo: str
    file: str = ""
    row: int | None = None
    tag: str = ""
    loop: str = ""
    day: str = ""
    rows: int = 0


PROBLEMS = pa.schema(
    [
        pa.field(name, pa.int64() if name in ("row", "rows") else pa.string(), nullable=name == "row")
        for name in DataIssue._fields
    ]
)
"""Schema of `problems.parquet`."""


def problem_table(problems: Iterable[DataIssue]) -> pa.Table:
    """A row a problem, each once, in an order that does not depend on who found it first.

    Examples
    --------
    >>> twice = [DataIssue("damaged", "is damaged", "copy it again", file="a.parquet", row=1)] * 2
    >>> problem_table(twice).num_rows
    1
    """
    rows = sorted(set(problems), key=lambda p: (p.code, p.file, p.loop, p.tag, p.day, p.row or 0, p.what, p.rows))
    return pa.Table.from_pylist([p._asdict() for p in rows], schema=PROBLEMS)


def problems_of(table: pa.Table) -> list[DataIssue]:
    """The problems of such a table."""
    return [DataIssue(**row) for row in table.to_pylist()]
