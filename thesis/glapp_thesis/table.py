"""The table of docs/thesis.md: the items with what shows them, the numbers that differ, and those of equations.

All numbers of a figure are in the gallery, which the table links.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from .checks import CHECKS
from .figure import Number, anchor
from .gallery import text
from .items import ITEMS, Item

__all__ = ["BEGIN", "END", "Row", "replaced", "rows"]

BEGIN, END = "<!-- table -->", "<!-- end -->"
"""Marks before and after the table in its page."""

Figures = Mapping[str, Mapping[str, Any]]
"""Numbers of figures, as `gallery.as_json` writes them."""


class Row(NamedTuple):
    """An item with its numbers, and whether it is *same*, *differs* or *not here*."""

    item: Item
    says: str
    numbers: tuple[Number, ...]
    standing: str
    why: str


def rows(figures: Figures) -> Iterator[Row]:
    """The items in the thesis' order; `figures` are the numbers of the gallery."""
    for item in ITEMS:
        numbers = tuple(_numbers(item, figures))
        figure = figures[item.figure] if item.figure else {}
        differs = item.why or any(number.same is False for number in numbers)
        standing = "not here" if not item.where else "differs" if differs else "same"
        yield Row(item, item.says or figure["title"], numbers, standing, item.why or figure.get("why", ""))


def _numbers(item: Item, figures: Figures) -> Iterator[Number]:
    """Numbers that the thesis states."""
    if item.check:
        yield from CHECKS[item.check]()
    wanted = [(item.figure, what) for what in figures[item.figure]["numbers"]] if item.figure else []
    for figure, what in [*wanted, *([item.refers] if item.refers else [])]:
        number = figures[figure]["numbers"][what]
        if number["thesis"] is not None:
            yield Number(what, number["unit"], number["thesis"], number["glapp"], holds=number["same"])


def _told(number: Number) -> str:
    sides = f"{text(number.thesis)} → {text(number.ours)}"
    return f"{number.what}: {sides} {number.unit}".rstrip()


def markdown(figures: Figures) -> str:
    """The table, under a line that counts it."""
    found = list(rows(figures))
    counts = Counter(row.standing for row in found)
    numbers = [number for row in found for number in row.numbers]
    same = sum(number.same is True for number in numbers)
    lines = [
        f"{len(found)} items: {counts['same']} the same, {counts['differs']} differ, {counts['not here']} are not "
        "here. "
        f"{len(numbers)} numbers, of which {same} are the thesis'.",
        "",
        "| thesis | what it has | in glapp | what shows it | same or not; the thesis' number → ours |",
        "|---|---|---|---|---|",
    ]
    for row in found:
        result = "<br>".join(
            [
                f"*{row.standing}*" + (f": {row.why}" if row.why else ""),
                *(_told(number) for number in row.numbers if row.item.check or number.same is False),
            ]
        )
        where = row.item.where.replace("`glapp.", "`")  # the page says where names begin: cells are narrow
        cells = (row.item.place, row.says, where or "–", _shown(row.item.shown), result)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _shown(shown: str) -> str:
    """Evidence of an item, in a narrow cell: figures and equations have their command above the table."""
    if shown.startswith("`glapp thesis "):
        figures = shlex.split(shown.strip("`").removeprefix("glapp thesis "))
        return ", ".join(f"[{figure}](gallery/README.md#{anchor(figure)})" for figure in figures)
    return "computed" if shown == "`python -m glapp_thesis`" else shown


def replaced(page: str, figures: Figures) -> str:
    """The page with its table made again."""
    before, rest = page.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n\n{markdown(figures)}\n\n{END}{after}"
