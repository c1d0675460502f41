"""The right to write a folder, which one process has at a time."""

from __future__ import annotations

import errno
import json
import os
import socket
import sys
import time
from pathlib import Path
from typing import Any

from .errors import InputError

__all__ = ["FolderLock"]


class FolderLock:
    """The right to write a data folder: one process has it, and it ends with that process, however that ends.

    Raises InputError where another process has it: which one, on which computer and since when; or where the folder
    cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> lock = FolderLock(Path(folder.name))
    >>> FolderLock.holder(Path(folder.name))["pid"] == os.getpid()
    True
    >>> lock.release()
    >>> FolderLock.holder(Path(folder.name)) is None
    True
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / "lock"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = self._path.open("a+", encoding="utf-8")
        except OSError as error:
            raise _not_written(folder, error) from None
        if not _locked(self._file.fileno()):
            self._file.close()
            other = _holder_of(self._path)
            raise InputError(
                "is written by process {pid} on {host} since {since}".format_map(other),
                file=str(folder),
                hint="one process writes a data folder: stop that one, or name another folder",
            )
        since = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
        found = {"pid": os.getpid(), "host": socket.gethostname(), "since": since}
        try:
            os.truncate(self._file.fileno(), 0)
            os.write(self._file.fileno(), json.dumps(found).encode())  # a buffer would be flushed once more at the end
        except OSError as error:
            self._file.close()
            raise _not_written(folder, error) from None

    def release(self) -> None:
        """Give it back."""
        self._file.truncate(0)
        self._file.close()

    @staticmethod
    def holder(folder: Path) -> dict[str, Any] | None:
        """Holder of the lock: `pid`, `host`, `since`, "?" where it has not said; None where nobody holds it."""
        path = folder / "lock"
        if not path.is_file():
            return None
        with path.open("a+", encoding="utf-8") as file:
            if _locked(file.fileno()):
                return None
        return _holder_of(path)


def _not_written(folder: Path, error: OSError) -> InputError:
    """Message where the lock cannot be written."""
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    hint = "make room, then start it again" if full else "name a folder that this account may write"
    return InputError(f"cannot be written: {error.strerror or error}", file=str(folder), hint=hint)


_NOBODY = {"pid": "?", "host": "?", "since": "?"}


def _holder_of(path: Path) -> dict[str, Any]:
    """Text that the holder of a lock wrote into it; one that has just taken it, or found the disk full, wrote none."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        found = None
    return {**_NOBODY, **(found if isinstance(found, dict) else {})}


if sys.platform == "win32":
    import msvcrt

    def _locked(handle: int) -> bool:
        os.lseek(handle, 1 << 20, os.SEEK_SET)  # behind the text, which others may read
        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            os.lseek(handle, 0, os.SEEK_SET)
        return True

else:
    import fcntl

    def _locked(handle: int) -> bool:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True
