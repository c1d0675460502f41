"""Writing files: next to the old one, and then in its place, so that it is either the new one or the old one."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["GENERATOR", "write_file", "write_parquet"]

GENERATOR = '<meta name="generator" content="glapp">'
"""Mark in the head of every page of ours: no other page is overwritten."""


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file whole, or leave the old one as it was: a full disk or a lost connection destroys nothing.

    The content goes to a temporary file in the same folder, which then takes the name. A new file gets the usual
    permissions, a replaced one keeps its own; a link stays a link, to the new content. What is no regular file, such as
    /dev/stdout or a pipe, is written to directly.

    Raises OSError where it cannot be written.

    Examples
    --------
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "report.html")
    ...     write_file(path, "new")
    ...     path.read_text(), len(list(Path(folder).iterdir()))
    ('new', 1)
    """
    data = content.encode() if isinstance(content, str) else content
    target = path.resolve()
    try:
        old = target.stat()
    except FileNotFoundError:
        old = None
    if old is not None and not stat.S_ISREG(old.st_mode):
        path.write_bytes(data)
        return
    handle, name = tempfile.mkstemp(prefix=f".{target.name[:100]}.", suffix=".part", dir=target.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(name).chmod(stat.S_IMODE(old.st_mode) if old is not None else 0o666 & ~_umask())
        if old is not None and hasattr(os, "chown"):
            with suppress(PermissionError):
                os.chown(name, old.st_uid, old.st_gid)
        Path(name).replace(target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_parquet(path: Path, tables: Iterable[pa.Table], schema: pa.Schema) -> None:
    """Write a Parquet file that is whole, or not there; each table is a group of rows, to be read by itself.

    Folders are made where they are missing. What a killed process leaves of a file is written over by the next.

    Raises OSError where it cannot be written; the old file, if there is one, is as it was.

    Examples
    --------
    >>> import pyarrow as pa
    >>> table = pa.table({"x": [1.0, 2.0]})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "x.parquet")
    ...     write_parquet(path, [table, table], table.schema)
    ...     pa.parquet.read_metadata(path).num_row_groups
    2
    """
    import pyarrow as pa  # which what writes no more than a page does without
    import pyarrow.parquet as pq

    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("wb") as file:
            words = [field.name for field in schema if pa.types.is_string(field.type)]
            with pq.ParquetWriter(file, schema, compression="zstd", use_dictionary=words) as writer:
                for table in tables:
                    writer.write_table(table.cast(schema))
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def _umask() -> int:
    """The process' file mode mask."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask
