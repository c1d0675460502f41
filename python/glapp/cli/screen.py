"""The terminal: standard output for answers, standard error for everything about them.

Names of files, loops, columns and tags come from outside, and a terminal obeys control characters: `glapp.escape` shows
them instead.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ..escape import escaped, one_line

__all__ = [
    "Column",
    "CommandError",
    "err",
    "event_line",
    "examples",
    "fitting",
    "key_values",
    "moment",
    "out",
    "say_error",
    "say_note",
    "show_table",
    "show_table_on",
    "styled",
]


def styled(text: str, style: str = "") -> Text:
    """Text in a style, escaped."""
    return Text(escaped(text), style=style)


class _Screen(Console):
    """A console that shows strings as they are, but for control characters: no markup, no emoji, no colouring."""

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, stderr=stderr)

    def render_str(self, text: str, **options: Any) -> Text:
        """Render every string that is printed, or is in a table."""
        return super().render_str(escaped(text), **options)


out = _Screen()
err = _Screen(stderr=True)


class CommandError(Exception):
    """The command line itself is wrong, whatever the files hold."""


def say_error(error: Exception | str) -> None:
    """One line on standard error; a terminal wraps it, nothing else does."""
    err.print(Text("error: ", style="bold red") + Text(one_line(str(error))), soft_wrap=True)


def say_note(text: str) -> None:
    """Print one line on standard error about a step that was done."""
    err.print(f"note: {one_line(text)}", soft_wrap=True)


def moment(at: float) -> str:
    """Local date and time of `at` [s since 1970 UTC]."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(at))


def event_line(at: float, kind: str, loop: str | None, text: str) -> Text:
    """An event on one line.

    - `at`: when it was [s since 1970 UTC].
    """
    return styled(one_line(f"{moment(at)} {kind}{f' {loop}' if loop else ''}: {text}"))


def key_values(rows: list[tuple[str, str]]) -> Table:
    """Names in one column, values in the next."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column()
    for row in rows:
        grid.add_row(*row)
    return grid


class Column(NamedTuple):
    """One column of a table of results."""

    header: str
    cells: Sequence[str | Text]
    number: bool = False
    """Numbers stand to the right and are never broken."""


_GAP = 2
_SHORTEST = 8
"""Characters that are left of a name on the narrowest screen."""
_READABLE = 12
"""Characters of a column of words, below which they break line after line."""
_LONGEST = 24
"""Characters of a word that is not broken, where the screen has room for them."""


def fitting(columns: Sequence[Column], needed: int) -> list[Column]:
    """The columns that stand side by side on this screen, and in any case so many of the first."""
    kept = list(columns[:needed])
    for column in columns[needed:]:
        least = _name_width(out, kept[0]) + sum(map(_least, [*kept[1:], column])) + _GAP * (len(kept) + 1)
        if least > out.width:
            break
        kept.append(column)
    return kept


def show_table(columns: Sequence[Column]) -> None:
    """A table of results on standard output: see `show_table_on`."""
    show_table_on(out, columns)


def show_table_on(screen: Console, columns: Sequence[Column]) -> None:
    """A table of results, with all its headers however narrow the screen is.

    What does not fit beside the first column goes below, in a table of its own that begins with that column too.
    """
    first, *others = columns
    table = [first]
    for column in others:
        least = _name_width(screen, first) + sum(map(_least, [*table[1:], column])) + _GAP * (len(table) + 1)
        if len(table) > 1 and least > screen.width:
            _print(screen, table)
            screen.print()
            table = [first]
        table.append(column)
    _print(screen, table)


def _print(screen: Console, columns: Sequence[Column]) -> None:
    """Print a table that fits the terminal."""
    table = Table(box=None, padding=(0, _GAP, 0, 0), header_style="bold", pad_edge=False)
    first, *others = columns
    widths = [_name_width(screen, first), *map(_least, others)]
    room = screen.width - sum(widths) - _GAP * len(columns)  # Rich counts a gap behind the last as well
    widths[0] = max(_SHORTEST, widths[0] + min(room, 0))
    for i in (*range(1, len(columns)), 0):  # names get what room is left
        more = max(0, min(room, _most(columns[i]) - widths[i]))
        widths[i] += more
        room -= more
    for column, width in zip(columns, widths, strict=True):
        justify: Literal["left", "right"] = "right" if column.number else "left"
        table.add_column(column.header, width=width, justify=justify, no_wrap=column.number, overflow="fold")
    for row in zip(*(column.cells for column in columns), strict=True):
        table.add_row(*row)
    screen.print(table)


def _most(column: Column) -> int:
    """Width of a column of which no cell is broken."""
    lines = [line for cell in (column.header, *map(str, column.cells)) for line in cell.split("\n")]
    return max(map(cell_len, lines), default=0)


def _name_width(screen: Console, column: Column) -> int:
    """Width of the first column: names are broken where they would take more than a third of the screen."""
    return min(_most(column), max(_LONGEST, screen.width // 3))


def _least(column: Column) -> int:
    """Smallest width at which a column can still be read [characters]."""
    if column.number:
        return _most(column)
    words = [word for cell in (column.header, *map(str, column.cells)) for word in cell.split()]
    return min(_most(column), max(_READABLE, min(_LONGEST, max(map(cell_len, words), default=0))))


def examples(*lines: str) -> str:
    """Command lines as help shows them: each on its own line."""
    return "\n".join(f"[cyan]{line}[/cyan]" for line in lines)
