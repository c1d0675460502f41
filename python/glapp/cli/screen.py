"""The terminal: standard output for answers, standard error for everything about them.

Names of files, loops, columns and tags come from outside, and a terminal obeys control characters: `glapp.escape` shows
them instead.
"""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ..escape import escaped, one_line

__all__ = ["CommandError", "err", "examples", "key_values", "out", "say_error", "say_note", "styled"]


def styled(text: str, style: str = "") -> Text:
    """Text in a style, escaped."""
    return Text(escaped(text), style=style)


class _Screen(Console):
    """A console that shows strings as they are, but for control characters: no markup, no emoji, no colouring."""

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, stderr=stderr)

    def render_str(self, text: str, **options: Any) -> Text:
        """Every string that is printed, or stands in a table, comes through here."""
        return super().render_str(escaped(text), **options)


out = _Screen()
err = _Screen(stderr=True)


class CommandError(Exception):
    """The command line itself is wrong, whatever the files hold."""


def say_error(error: Exception | str) -> None:
    """One line on standard error; a terminal wraps it, nothing else does."""
    err.print(Text("error: ", style="bold red") + Text(one_line(str(error))), soft_wrap=True)


def say_note(text: str) -> None:
    """One line on standard error about what was done."""
    err.print(f"note: {one_line(text)}", soft_wrap=True)


def key_values(rows: list[tuple[str, str]]) -> Table:
    """Names in one column, values in the next."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column()
    for row in rows:
        grid.add_row(*row)
    return grid


def examples(*lines: str) -> str:
    """Command lines as help shows them: each on its own line."""
    return "\n".join(f"[cyan]{line}[/cyan]" for line in lines)
