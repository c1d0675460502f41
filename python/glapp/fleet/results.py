"""Results of a run: Parquet tables that are whole or not there, and what they were made of.

::

    RESULTS/manifest.json        the folder of the tables, their rows and checksums, version, settings; written last
    RESULTS/tables-<checksum>/   loops, windows, days, crossings, problems, inputs .parquet
    RESULTS/report.html          for the person who plans the maintenance
    RESULTS/loops.csv            the table of loops for a spreadsheet
    RESULTS/work/                what was made so far: an interrupted run goes on from here, the next one begins here

The folder of tables has the checksum of what is in it as its name, so the same input gives the same name.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ..errors import InputError
from ..writing import write_file, write_parquet
from .problems import DataIssue

__all__ = ["INPUTS", "TABLES", "digest", "manifest", "publish", "read", "read_piece", "write_piece"]

TABLES = ("loops", "windows", "days", "crossings", "problems", "inputs")
"""Names of the tables."""

INPUTS = pa.schema(
    [
        ("file", pa.string()),
        ("size", pa.int64()),
        ("mtime_ns", pa.int64()),
        ("layout", pa.string()),
        ("rows", pa.int64()),
        ("unreadable", pa.int64()),
        ("first", pa.timestamp("us", tz="UTC")),
        ("last", pa.timestamp("us", tz="UTC")),
    ]
)
"""A row a file of the lake that was read."""

_MANIFEST = "manifest.json"
_PROBLEMS = b"glapp.problems"


def digest(*parts: Any) -> str:
    """Checksum of plain values, the same in every run.

    Examples
    --------
    >>> digest("a", 1) == digest("a", 1), digest("a", 1) == digest("a", 2)
    (True, False)
    """
    text = json.dumps(parts, sort_keys=True, default=str, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def write_piece(path: Path, tables: Iterable[pa.Table], schema: pa.Schema, problems: Iterable[DataIssue] = ()) -> None:
    """A Parquet file that is whole, or not there; a group of rows a table.

    Raises InputError where it cannot be written, as on a full disk.
    """
    text = json.dumps([list(problem) for problem in problems], ensure_ascii=False)
    schema = schema.with_metadata({**(schema.metadata or {}), **({_PROBLEMS: text.encode()} if text != "[]" else {})})
    try:
        write_parquet(path, tables, schema)
    except OSError as error:
        raise InputError(
            f"cannot be written: {error.strerror or error}",
            file=str(path),
            hint="make room, then run it again: it goes on where it stopped",
        ) from None


def read_piece(path: Path, **how: Any) -> tuple[pa.Table, list[DataIssue]]:
    """A piece, and the problems that were met in making it."""
    table = pq.read_table(path, use_threads=False, partitioning=None, **how)
    problems = json.loads((table.schema.metadata or {}).get(_PROBLEMS, b"[]"))
    return table.replace_schema_metadata(), [DataIssue(*problem) for problem in problems]


def publish(out: Path, tables: Mapping[str, pa.Table], about: Mapping[str, Any]) -> dict[str, Any]:
    """Write the tables of a run and then, last, the manifest that makes them the results; the tables before go.

    The manifest holds `about`, and every table's metadata `about["provenance"]` too.
    """
    provenance = json.dumps(about["provenance"], sort_keys=True).encode()
    making = out / ".tables"
    shutil.rmtree(making, ignore_errors=True)
    try:
        making.mkdir()
        files = {}
        for name in TABLES:
            schema = tables[name].schema.with_metadata({b"glapp": provenance})
            path = making / f"{name}.parquet"
            write_piece(path, [tables[name]], schema)
            files[name] = {"rows": tables[name].num_rows, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
        folder = out / f"tables-{digest(files)}"
        if folder.exists():
            shutil.rmtree(making)
        else:
            making.replace(folder)
    except BaseException:
        shutil.rmtree(making, ignore_errors=True)
        raise
    made = {**about, "folder": folder.name, "tables": files}
    write_file(out / _MANIFEST, json.dumps(made, indent=1, sort_keys=True) + "\n")
    for old in out.glob("tables-*"):
        if old != folder:
            shutil.rmtree(old, ignore_errors=True)
    return made


def manifest(out: str | Path) -> dict[str, Any]:
    """Facts on the results in a folder: version, settings, time of writing, rows and checksums.

    Parameters
    ----------
    out : str or Path
        The folder that was given as `out`.

    Returns
    -------
    dict
        `folder` of the tables, `tables` (rows and checksum of each), `lost` (refused `loops`, `files` of which
        something could not be read, their `rows` as far as they are known, rows `left_out`), `provenance`, `lake`,
        `written`, `engine` and `seconds`.

    Raises
    ------
    InputError
        Where there are none, as while the first run is under way.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     manifest(folder)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    glapp.errors.InputError: ...: holds no results; ...
    """
    path = Path(out) / _MANIFEST
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        hint = "glapp fleet analyze LAKE --out RESULTS writes them, and goes on where it was stopped"
        raise InputError("holds no results", file=str(out), hint=hint) from None
    return found


def read(out: str | Path, table: str = "loops") -> pa.Table:
    """A table of the results in a folder.

    Parameters
    ----------
    out : str or Path
        The folder that was given as `out`.
    table : str
        *loops*, *windows*, *days*, *crossings*, *problems* or *inputs*.

    Returns
    -------
    pyarrow.Table
        Its columns are described in `docs/fleet.md`.

    Raises
    ------
    InputError
        Where there are no results, a table is not the one in the manifest, or there is none of that name.

    Examples
    --------
    >>> import tempfile
    >>> from glapp import fleet
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     fleet.read(folder)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    glapp.errors.InputError: ...: holds no results; ...
    """
    if table not in TABLES:
        raise InputError(f"is {table!r}, must be one of {', '.join(TABLES)}", parameter="table", value=table)
    known = manifest(out)
    path = Path(out) / known["folder"] / f"{table}.parquet"
    try:
        with pa.OSFile(str(path)) as file:
            # Memory of Arrow's own: one of its threads lets go of it last, and may do so after Python has ended.
            data = file.read_buffer()
    except FileNotFoundError:
        data = pa.allocate_buffer(0)
    if hashlib.sha256(data).hexdigest() != known["tables"][table]["sha256"]:
        raise InputError(
            "is not the one that the manifest names", file=str(path), hint="run glapp fleet analyze once more"
        )
    return pq.read_table(pa.BufferReader(data))
