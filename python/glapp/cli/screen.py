"""The terminal: standard output for answers, standard error for everything about them."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

__all__ = ["CommandError", "err", "examples", "key_values", "out", "say_error"]

# Names of loops and files are shown as they are: no markup, no emoji codes, no colouring of numbers.
out = Console(markup=False, emoji=False, highlight=False)
err = Console(markup=False, emoji=False, highlight=False, stderr=True)


class CommandError(Exception):
    """The command line itself is wrong, whatever the files hold."""


def say_error(error: Exception | str) -> None:
    """One line on standard error; a terminal wraps it, nothing else does."""
    err.print(Text("error: ", style="bold red") + Text(str(error)), soft_wrap=True)


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
