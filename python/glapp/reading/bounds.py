"""Limits on a file's demands: every bound of reading, in one place.

A file that breaks one of them is refused in a line that says what was found, what is allowed and what to do. The bounds
are checked before memory is asked for. `MEMORY` and `PATIENCE` hold whatever a library does (`glapp.reading.apart`).
"""

from __future__ import annotations

from ..errors import InputError

__all__ = [
    "CELLS",
    "COLUMNS",
    "LINE",
    "MEMORY",
    "PARTS",
    "PATIENCE",
    "PIECE",
    "RATIO",
    "TEXT",
    "UNPACKED",
    "WHOLE",
    "check_columns",
    "check_unpacked",
    "most_unpacked",
]

COLUMNS = 16_384
"""Columns of a table: Excel's own bound, and 4096 loops of four signals."""
LINE = 1 << 24
"""Bytes of one row of text."""
CELLS = 1 << 23
"""Cells of a workbook, from the first to the last that is filled: Excel's longest sheet of eight columns."""
TEXT = 1 << 20
"""Bytes of one cell of a workbook; Excel itself stops at 32 767 characters."""
PARTS = 10_000
"""Files within a workbook."""
UNPACKED = 1 << 30
"""Bytes that any file may unpack to."""
RATIO = 200
"""Largest ratio of unpacked to packed bytes, from `UNPACKED` on."""
WHOLE = 1 << 28
"""Bytes of a file that is read whole: JSON, a web page, an export of InfluxDB."""
MEMORY = 1 << 30
"""Bytes that the process which reads a file may take beyond those it has when it begins."""
PIECE = 1 << 27
"""Bytes of rows that the process which reads a file hands over at once, and that both then hold."""
PATIENCE = 25.0
"""Seconds of the processor that it may take until its next answer: a workbook's sheets, or a table's next rows."""


def check_columns(count: int, label: str) -> None:
    """Refuse a table that is too wide, before its columns are looked at.

    Raises InputError where it is.

    Examples
    --------
    >>> check_columns(1_000_000, "plant.csv")
    Traceback (most recent call last):
    glapp.errors.InputError: plant.csv: has 1000000 columns, at most 16384 are read; split it into files of fewer loops
    """
    if count > COLUMNS:
        what = f"has {count} columns, at most {COLUMNS} are read"
        hint = "split it into files of fewer loops"
        raise InputError(what, file=label, value=count, bound=f"≤ {COLUMNS} columns", hint=hint)


def most_unpacked(packed: int) -> int:
    """Bytes that a file of so many bytes may unpack to.

    Examples
    --------
    >>> most_unpacked(3_000_000) >> 20, most_unpacked(100_000_000) // 10**9
    (1024, 20)
    """
    return max(UNPACKED, RATIO * packed)


def check_unpacked(size: int, packed: int, label: str, hint: str) -> None:
    """Refuse a file that unpacks to too much.

    - `size`: what it unpacks to, as far as that is known [bytes].
    - `packed`: the file itself [bytes].
    - `label`: file as the user wrote it.
    - `hint`: what to do.

    Raises InputError where it does.
    """
    if size > (most := most_unpacked(packed)):
        what = f"has {packed} bytes and unpacks to more than {most >> 20} MiB, as far as it is read"
        raise InputError(what, file=label, value=size, bound=f"≤ {most >> 20} MiB", hint=hint)
