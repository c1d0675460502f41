"""Writing files: beside the old one, and then in its place, so that it is whole or as it was."""

from __future__ import annotations

import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

__all__ = ["GENERATOR", "write_file"]

GENERATOR = '<meta name="generator" content="glapp">'
"""What every page of ours has in its head: no other is overwritten."""


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file whole, or leave the old one as it was: a full disk or a lost connection destroys nothing.

    The content goes to a temporary file in the same folder, which then takes the name. A new file gets the usual
    permissions, a replaced one keeps its own; a link stays a link, to the new content. What is no regular file, such as
    /dev/stdout or a pipe, is written to directly.

    Raises
    ------
    OSError
        Where it cannot be written.

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


def _umask() -> int:
    mask = os.umask(0o077)
    os.umask(mask)
    return mask
