"""Files that a command writes: never over its own inputs, nor over anything that glapp has not written."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path

from ..errors import InputError
from ..writing import GENERATOR, write_file
from .screen import CommandError

__all__ = ["PAGE", "TABLE", "check_output", "fault_of", "save"]

TABLE = ("a table that glapp wrote", rb"\Aloop,file,(answer_)?verdict,")
# Reports had this policy before they had the mark.
PAGE = (
    "a page that glapp wrote",
    re.escape(GENERATOR.encode()) + rb"|content=\"default-src 'none'; style-src 'unsafe-",
)


def check_output(option: str, path: Path, inputs: Iterable[Path], ours: tuple[str, bytes] | None) -> None:
    """Refuse a file to write that must not be written, before any work is done.

    - `option`: the option that names it.
    - `path`: the file.
    - `inputs`: files that the command reads.
    - `ours`: what an existing file must be to be replaced, and what then matches its beginning; None: anything.

    Raises CommandError where it is an input, something else than ours, or in no folder.
    """
    if not path.parent.is_dir():
        raise CommandError(f"{option}: there is no folder '{path.parent}'")
    if path.is_dir():
        raise CommandError(f"{option}: '{path}' is a folder; name a file in it")
    for other in inputs:
        if _same(path, other):
            raise CommandError(f"{option}: '{path}' is read by this command and is not overwritten; name another file")
    if ours is None:
        return
    what, mark = ours
    try:
        if path.is_file() and path.stat().st_size:
            with path.open("rb") as file:
                found = re.search(mark, file.read(4096))
            if found is None:
                raise CommandError(
                    f"{option}: '{path}' exists, is not {what}, and is not overwritten; name a new file "
                    f"(where the shell puts names for '*', the first stands behind {option})"
                )
    except OSError as error:
        raise CommandError(f"{option}: '{path}' cannot be written: {error.strerror}") from None


def fault_of(path: Path, write: Callable[[], object]) -> InputError | None:
    """The error of writing this file."""
    try:
        write()
    except OSError as error:
        return InputError(f"cannot be written: {error.strerror}", file=str(path))
    return None


def save(path: Path, content: str | bytes) -> None:
    """Write a file (`write_file`), with an InputError where that fails."""
    if (fault := fault_of(path, lambda: write_file(path, content))) is not None:
        raise fault


def _same(path: Path, other: Path) -> bool:
    """Whether two paths are the same file."""
    try:
        return path.samefile(other)
    except (OSError, ValueError):  # one of them does not exist
        return os.path.realpath(path) == os.path.realpath(other)
