"""Questions at the terminal where guessing fails: the first rows, a question, and a settings file."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..reading import first_rows
from ..reading.init import settings_of
from ..recording import Recording
from .inputs import Refused, Valve, opened_with
from .outputs import save
from .screen import Column, err, say_error, show_table_on

__all__ = ["asked", "can_ask"]

_ROWS = 3
_WIDEST = 40
"""Number of columns offered."""
_TIMES = 3
"""Number of questions about one file."""
_SIGNALS = (("time", "the time"), ("pv", "PV"), ("op", "OP"), ("sp", "SP"))
_FORMATS = {
    "day order": ("day first", "month first"),
    "time unit": ("milliseconds", "seconds", "minutes", "hours", "days", "excel", "matlab", "julian"),
}
"""Choices of `time_format`, by the question."""


def can_ask() -> bool:
    """Whether somebody sees a question and can answer it."""
    return sys.stdin is not None and sys.stdin.isatty() and err.is_terminal


def asked(opened: Sequence[Recording | Valve | Refused], settings: dict[str, Any]) -> list[Recording | Valve | Refused]:
    """Opened entries, with recordings in place of files that can be read after a question; the answers are written."""
    return [
        answered for entry in opened for answered in (_ask(entry, settings) if isinstance(entry, Refused) else [entry])
    ]


def _ask(entry: Refused, settings: dict[str, Any]) -> list[Recording | Valve | Refused]:
    """Ask for the missing settings of a file, and open it with the answers."""
    file, given, error = Path(entry.source), dict(settings), entry.error
    for _ in range(_TIMES):
        if error.asks is None:
            break
        try:
            given = (_columns if error.asks == "columns" else _time_format)(file, error, given)
        except (EOFError, InputError):
            break
        of = error.loop  # of several loops the one that is asked about; the others are opened already
        found = [one for one in opened_with(file, given, [of] if of else None) if of in (None, one.name)]
        if recordings := [opened for opened in found if isinstance(opened, Recording)]:
            _write(file, recordings)
            return found
        error = next(opened.error for opened in found if isinstance(opened, Refused))
    return [Refused(entry.name, entry.source, error, entry.loop)]


def _columns(file: Path, error: InputError, given: dict[str, Any]) -> dict[str, Any]:
    """Ask which columns are SP, PV and OP."""
    names, rows = first_rows(file, _ROWS)
    say_error(error)
    err.print(f"\n{file} begins so:")
    shown = names[:_WIDEST]
    cells = [[row[i] for row in rows] for i in range(len(shown))]
    show_table_on(
        err,
        [
            Column("", [str(i + 1) for i in range(len(shown))], True),
            Column("column", [name or "(no name)" for name in shown]),
            *(Column(f"row {k + 1}", [column[k] for column in cells]) for k in range(len(rows))),
        ],
    )
    columns: dict[str, str] = {}
    given = dict(given)
    for key, signal in _SIGNALS:
        if (at := _number(f"Which column is {signal}? A number, or nothing where there is none: ", len(shown))) is None:
            continue
        columns[key] = shown[at - 1]
    if "time" not in columns and "sample_time" not in given:
        given["sample_time"] = _positive("Seconds between two rows: ")
    return {**given, "columns": {**given.get("columns", {}), **columns}}


def _time_format(file: Path, error: InputError, given: dict[str, Any]) -> dict[str, Any]:
    """Ask how the time column is written."""
    err.print(f"\n{file}: {error.what}.")
    formats = _FORMATS[error.asks or ""]
    for i, one in enumerate(formats, start=1):
        err.print(f"  {i}  {one}")
    while (choice := _number("Which one? A number: ", len(formats))) is None:
        pass
    return {**given, "time_format": formats[choice - 1]}


def _number(question: str, most: int) -> int | None:
    """Ask for a number from 1 to `most`; None for no answer."""
    while text := _line(question):
        if text.isdecimal() and 1 <= int(text) <= most:
            return int(text)
        err.print(f"  a number from 1 to {most}")
    return None


def _positive(question: str) -> float:
    while True:
        try:
            if (value := float(_line(question))) > 0:
                return value
        except ValueError:
            pass
        err.print("  a number above 0")


def _line(question: str) -> str:
    """The person's answer to a question, without spaces around it."""
    err.print(question, end="")
    line = sys.stdin.readline()
    if not line:
        raise EOFError
    return line.strip()


def _write(file: Path, recordings: Sequence[Recording]) -> None:
    """The answers, to be used the next time: loops.toml, or a name of the file's own where that is taken."""
    path, number = Path("loops.toml"), 1
    while path.exists():
        path, number = Path(f"{file.stem}{'' if number == 1 else f'-{number}'}.toml"), number + 1
    save(path, settings_of(recordings, path.parent))
    err.print(f"Wrote {path}: the next time, type  glapp analyze {shlex.quote(str(path))}\n", soft_wrap=True)
