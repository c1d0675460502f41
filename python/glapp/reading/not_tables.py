"""Files that hold no table of signals, whatever their ending: what they are, and what to do about them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from ..errors import InputError
from .csv import PACKED

__all__ = ["ARCHIVES", "BEGINNINGS", "LOGIN", "TITLE", "check_archive", "check_beginning"]

_SHOWN = "it shows the recording without its numbers: export them as CSV or .xlsx"
_UNPACK = "unpack it, and take the file in it"
_SAVE = "save its table as CSV or .xlsx"

BEGINNINGS = (
    ("%PDF-", "is a PDF", _SHOWN),
    ("\x89PNG\r\n", "is a picture (PNG)", _SHOWN),
    ("\xff\xd8\xff", "is a picture (JPEG)", _SHOWN),
    ("GIF87a", "is a picture (GIF)", _SHOWN),
    ("GIF89a", "is a picture (GIF)", _SHOWN),
    ("{\\rtf", "is a text document (RTF)", _SAVE),
    ("PK\x05\x06", "is a zip archive without a file", "export the recording again"),
    ("7z\xbc\xaf\x27\x1c", "is a 7z archive", _UNPACK),
    ("Rar!\x1a\x07", "is a RAR archive", _UNPACK),
    ("\xfd7zXZ\0", "is packed by xz", _UNPACK),
    ("SQLite format 3\0", "is a data base (SQLite)", "export the recording from it as CSV"),
    ("MATLAB 5.0 MAT-file", "is a MATLAB file", "write the table to CSV or .xlsx by writetable"),
    ("MATLAB 7.3 MAT-file", "is a MATLAB file", "write the table to CSV or .xlsx by writetable"),
    ("\x89HDF\r\n", "is an HDF5 file", "write its table to CSV or Parquet"),
)
"""First bytes, in Latin-1, of what they are the first, and what to do."""

_PACKED = {".gz": b"\x1f\x8b", ".bz2": b"BZh", ".zst": b"\x28\xb5\x2f\xfd", ".lz4": b"\x04\x22\x4d\x18"}
"""First bytes of a packed file, by its ending."""

ARCHIVES = (
    ("word/", "is a Word document", _SAVE),
    ("ppt/", "is a PowerPoint presentation", _SHOWN),
    ("", "is a zip archive of {files}", _UNPACK),
)
"""How the name of a file in an archive that is no workbook begins, what the archive is, and what to do."""

LOGIN = re.compile(r"<input[^>]*type\s*=\s*[\"']?password|name\s*=\s*[\"']?SAMLRequest", re.IGNORECASE)
"""What a page holds that asks for a login, or sends on to one."""

TITLE = re.compile(r"<title[^>]*>\s*([^<]{1,80})", re.IGNORECASE)


def check_beginning(path: Path, first: bytes, label: str) -> None:
    """Refuse a file whose first bytes are of no form that is read.

    - `first`: at least 20 of them, or all there are.

    Raises InputError where they are, and where the ending is that of a packed file and they are not, or the reverse.
    """
    for start, what, hint in BEGINNINGS:
        if first.startswith(start.encode("latin-1")):
            raise InputError(what, file=label, hint=hint)
    ending = path.suffix.lower()
    plain = all(8 < byte < 127 for byte in first)
    if ending in PACKED and first and plain and not first.startswith(_PACKED[ending]):
        what = f"is not packed, though its name ends in {path.suffix}"  # a browser may unpack what it loads
        raise InputError(what, file=label, hint=f"rename it to {path.stem}")
    if ending not in PACKED and not plain:
        for right, packed in _PACKED.items():
            if first.startswith(packed):
                what = f"is packed by {PACKED[right]}, and its name does not end in {right}"
                raise InputError(what, file=label, hint=f"rename it to {path.name}{right}")


def check_archive(names: Iterable[str], label: str) -> None:
    """Refuse a zip archive that is no workbook, by the names of the files in it.

    Raises InputError where it is none.
    """
    files = [name for name in names if not name.endswith("/")]
    if any(name.startswith("xl/") or name == "content.xml" for name in files):
        return
    for start, what, hint in ARCHIVES:
        if any(name.startswith(start) for name in files):
            more = ", ".join(files[:3]) + (" …" if len(files) > 3 else "")
            counted = f"{len(files)} file{'s' * (len(files) != 1)} ({more})"
            raise InputError(what.format(files=counted), file=label, hint=hint)
