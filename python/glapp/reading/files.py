"""Checks of a path before its file is opened: whether it can be read at all, and the name of the recording."""

from __future__ import annotations

import stat
from pathlib import Path

from ..errors import InputError

__all__ = ["ENDINGS", "FORMS", "check_file", "name_of", "separator_of"]

FORMS = {
    "CSV": (".csv", ".tsv", ".tab", ".txt", ".asc", ".prn", ".dat", ".data", ".log"),
    "Excel": (".xlsx", ".xlsm"),
    "OpenDocument": (".ods",),
    "JSON": (".json", ".jsonl", ".ndjson"),
    "HTML": (".html", ".htm", ".xls", ".xml"),  # a web page is often saved as .xls; Excel's own of this name is refused
    "Parquet": (".parquet", ".pq"),
    "Arrow": (".arrow", ".arrows", ".ipc", ".feather"),
}
"""Forms of the files that are read, and the endings of each."""

_PLAIN = frozenset(ending for endings in FORMS.values() for ending in endings)
_COMPRESSED = frozenset((".gz", ".bz2", ".zst", ".lz4"))
ENDINGS = tuple(sorted(_PLAIN | _COMPRESSED))
"""Endings of the files that are read, packed or not."""


def name_of(path: str | Path) -> str:
    """Name of the recording in a file: the file's name without the endings that say how it is written.

    Examples
    --------
    >>> name_of("2026.03.01 FIC101.csv"), name_of("exports/FIC101.PV.csv.gz"), name_of("FIC101.A")
    ('2026.03.01 FIC101', 'FIC101.PV', 'FIC101.A')
    """
    whole = Path(path).name
    name = Path(whole)
    if name.suffix.lower() in _COMPRESSED:
        name = name.with_suffix("")
    if name.suffix.lower() in _PLAIN | {".toml"}:
        name = name.with_suffix("")
    return str(name) if whole else "loop"


def check_file(path: Path, label: str) -> None:
    """Refuse a path that is no ordinary file: reading a pipe or a device would wait for ever, or never end.

    Raises InputError where there is no such file, or it is a folder, a pipe, a socket or a device.
    """
    try:
        label.encode()
        mode = path.stat().st_mode
    except UnicodeEncodeError:
        raise InputError("has a name that is not UTF-8", file=label, hint="rename it") from None
    except FileNotFoundError:
        hint = "standard input is not read: write it to a file, and name that" if label == "-" else None
        raise InputError("no such file", file=label, hint=hint) from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(f"cannot be read: {getattr(error, 'strerror', None) or error}", file=label) from None
    if stat.S_ISREG(mode):
        return
    if stat.S_ISDIR(mode):
        raise InputError("is a directory", file=label, hint="name the files in it")
    kinds = ((stat.S_ISFIFO, "a pipe"), (stat.S_ISSOCK, "a socket"))
    what = next((kind for test, kind in kinds if test(mode)), "a device")
    hint = "a recording is read more than once: write it to a file, and name that"
    raise InputError(f"is {what}, not a file", file=label, hint=hint)


def separator_of(head: str) -> str:
    """Separator of a small table that a person keeps, from its first line.

    A spreadsheet of a country with decimal commas separates cells by semicolons.

    Examples
    --------
    >>> separator_of("file;found;width")
    ';'
    """
    return max(",;\t", key=head.count)
