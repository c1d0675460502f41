"""Every system, equation, figure, table and item of future work of the thesis, and where it is in glapp: `items.md`."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files
from typing import NamedTuple

__all__ = ["ITEMS", "Item"]


class Item(NamedTuple):
    """One thing that the thesis has, says or asks for: a row of `items.md`.

    - `place`: section, and what it is there: "2.1, equation (2.1)", "4.1, system P1", "8.2, table 8.1".
    - `says`: in our words; "" for a figure or table: its title.
    - `where`: names in glapp, in Markdown. "" where it is not here.
    - `shown`: a command, or a link to a snippet or page.
    - `check`: key in `CHECKS`, whose numbers belong to it; "" for none.
    - `figure`: key in `FIGURES`, whose numbers belong to it; "" for none.
    - `refers`: a figure and one of its numbers; () for none.
    - `why`: why it differs, or is not here; for a figure it is the reason of the figure.
    """

    place: str
    says: str
    where: str
    shown: str
    check: str = ""
    figure: str = ""
    refers: tuple[str, str] | tuple[()] = ()
    why: str = ""


def _items() -> Iterator[Item]:
    """The rows of `items.md`."""
    table = files(__package__).joinpath("items.md").read_text(encoding="utf-8").split("|\n")
    for row in table[2:-1]:
        place, says, where, shown, check, figure, refers, why = (cell.strip() for cell in row[1:].split("|"))
        of, _, number = refers.partition(": ")
        yield Item(place, says, where, shown, check, figure, (of, number) if number else (), why)


ITEMS = tuple(_items())
