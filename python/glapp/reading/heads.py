"""Beginning and end of a table in a text: titles, names of columns, units, first row, and the lines below the last.

Above the rows stand titles and what an export tells of itself. Of the lines of words alone just above the rows the one
with the most names that are understood has the names. A line of tags goes with the line below it where that says "time"
and "value", or repeats itself, as SP, PV and OP of several loops do, or where it is one tag of all signals. A column
without a name in that line may be called a time in another. Below the rows stand remarks, totals and empty lines.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import InputError
from .meaning import understand
from .names import FACTS, FOOTER, UNITS, folded
from .times import looks_like_moment, looks_like_stamp

__all__ = ["Head", "begins_with_data", "body_end", "head_of", "holds_data", "is_data", "no_rows"]

_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?\d{1,3}(?:[.,'’   ]\d{3})+(?:[.,]\d*)?")
_DIGIT = re.compile("[0-9]")
_LINES = 40
"""A head ends within so many lines of the first that is as wide as the table."""
_SHORT = 12
"""Characters of a unit that is not known here."""
_AHEAD = 10
"""Lines before the names of columns in which an export may describe itself with numbers."""
_RULE = frozenset("-+=| ")
_TYPES = "#types"
"""First cell of the line above one with the types of the columns (Ignition)."""

Row = tuple[int, Sequence[str]]
"""Last line of a record, and its cells."""


@dataclass(frozen=True)
class Head:
    """Lines above the rows.

    - `names`, `units`: of the columns.
    - `line`: line of the names.
    - `rows`: records before the first row.
    """

    names: list[str]
    units: list[str | None]
    line: int
    rows: int


def is_data(cell: str) -> bool:
    """Whether a cell is a number, a date or a time.

    Examples
    --------
    >>> is_data("9.700,00"), is_data("10:00:05"), is_data("FIC101")
    (True, True, False)
    """
    return bool(_NUMBER.fullmatch(cell.strip())) or looks_like_moment(cell)


def holds_data(names: Sequence[str]) -> bool:
    """Whether what should be names is the first row: numbers, and no signal or a date among them.

    Examples
    --------
    >>> holds_data(["0", "48.2"]), holds_data(["FIC101.PV", "14-Nov-2025 06:00:00", "48.2"]), holds_data(["t", "2024"])
    (True, True, False)
    """
    if not any(is_data(name) for name in names if name):
        return False
    return any(map(looks_like_stamp, names)) or not any(understand(name).role for name in names)


def head_of(rows: Sequence[Row], start: int, width: int) -> Head:
    """Names and units of a table whose first line of `width` cells is the record `start`."""
    lines: list[int] = []
    i = end = start
    while i < min(len(rows), start + _LINES):
        cells = rows[i][1]
        typed = i > 0 and rows[i - 1][1][0].strip().lower() == _TYPES
        if _words_alone(cells, width) and not typed:
            lines.append(i)
        elif not (typed or (lines and _is_remark(cells, width)) or _is_label(rows, i, width)):
            break
        i += 1
        if lines:
            end = i
    if not lines:  # the first line is all there is, and may hold years or numbers of columns
        lines, end = [start], start + 1
    lines = [i for i in lines if all(j in lines or _is_remark(rows[j][1], width) for j in range(i, lines[-1]))]
    named = max(lines, key=lambda i: (_understood(rows[i][1]), _filled_count(rows[i][1]), -i))
    names = [" ".join(cell.split()) for cell in rows[named][1]]  # a quoted name may be broken into lines
    units = [understand(name).unit for name in names]
    below = [i for i in lines if i > named]
    if below and _says_value(rows[below[0]][1]):
        names = _under(names, rows[below.pop(0)][1])
    elif named - 1 in lines:
        whole = _under([" ".join(cell.split()) for cell in rows[named - 1][1]], rows[named][1])
        if _says_value(rows[named][1]) or (_repeat(names) and not _repeat(whole)):
            names = whole
        elif tag := _one_tag(rows[named - 1][1], names):
            names = [f"{tag} {name}" if _signal(name) else name for name in names]
    unit_rows = [i for i in below if _are_units(rows[i][1])] or [i for i in below if _are_short(rows[i][1])]
    if unit_rows:
        units = [cell.strip(" []()") or None for cell in rows[unit_rows[-1]][1]]
    for i in [i for i in range(start, end) if i != named and len(rows[i][1]) == width]:
        for at, cell in enumerate(rows[i][1]):
            if not names[at] and understand(cell).role == "time":
                names[at], units[at] = cell.strip(), None
    if any(folded(cell) == "sampletime[ms]" for _, cells in rows[start:end] for cell in cells[:1]):
        line = names[0]
        for at in range(0, width, 2):  # TwinCAT's Scope calls its columns of times as it calls the line
            if names[at] == line:
                names[at], units[at] = "time", "ms"
    return Head(names, units, rows[named][0], end)


def begins_with_data(rows: Sequence[Row], width: int) -> bool:
    """Whether the rows begin with a number or a time: what does not is then no row."""
    firsts = [is_data(cells[0]) for _, cells in rows[:_LINES] if len(cells) == width]
    return sum(firsts) * 2 > len(firsts)


def body_end(rows: Sequence[Row], width: int, timed: bool) -> int:
    """Number of records before the remarks and totals below the last row.

    A row that is cut off in its middle, or has text for its time, is none of them. `timed`: see `begins_with_data`.
    """
    end = len(rows)
    while end and _is_footer(rows[end - 1][1], width, timed):
        end -= 1
    return end


def _is_footer(cells: Sequence[str], width: int, timed: bool) -> bool:
    """Whether a line below the table is no row of it."""
    filled = [i for i, cell in enumerate(cells) if cell.strip()]
    if not filled:
        return True
    first = cells[filled[0]]
    if is_data(first):
        return False
    if folded(first.strip(" :=")) in FOOTER:
        return True
    return timed and filled[0] == 0 and (len(cells) != width or (width > 1 and len(filled) == 1))


def _words_alone(cells: Sequence[str], width: int) -> bool:
    """Whether a line has as many cells as the table, and no number or time among them."""
    return len(cells) == width and any(c.strip() for c in cells) and not any(is_data(c) for c in cells if c.strip())


def _is_label(rows: Sequence[Row], at: int, width: int) -> bool:
    """Whether a line above the names describes the export or its columns: words first."""
    first = next((cell for cell in rows[at][1] if cell.strip()), "")
    return not is_data(first) and _names_follow(rows, at, width)


def _is_remark(cells: Sequence[str], width: int) -> bool:
    """Whether a line between the column names and the samples is a remark.

    It is empty, a rule (-----+-----), an annotation (#ROWS), or has a number of each column, such as its span.
    """
    filled = [cell for cell in cells if cell.strip()]
    if not filled or all(set(cell) <= _RULE for cell in filled):
        return not filled or not is_data(filled[0])
    return (cells[0].startswith("#") and len(cells) != width) or folded(cells[0].strip(" :")) in FACTS


def _names_follow(rows: Sequence[Row], at: int, width: int) -> bool:
    """Whether one of the next lines has the names of columns."""
    return any(_words_alone(cells, width) and _understood(cells) > 1 for _, cells in rows[at + 1 : at + 1 + _AHEAD])


def _understood(cells: Sequence[str]) -> int:
    """Number of cells that name a signal or a time."""
    meanings = [understand(cell) for cell in cells]
    return sum(m.role is not None or m.weak is not None for m in meanings)


def _says_value(cells: Sequence[str]) -> bool:
    """Whether a line names its columns only as time and value."""
    roles = [understand(cell).role for cell in cells if cell.strip()]
    return roles.count("value") > 1 and set(roles) <= {"time", "value", "quality"}


def _under(above: Sequence[str], below: Sequence[str]) -> list[str]:
    """Names of two lines: a tag stands above the first of its columns."""
    names, tag = [], ""
    for top, cell in zip(above, below, strict=False):
        tag = top or tag
        word = " ".join(cell.split())
        if not word and not top:  # an empty column parts two tags
            names.append("")
            continue
        names.append(tag if understand(word).role == "value" else f"{tag} {word}".strip())
    return names


def _one_tag(above: Sequence[str], names: Sequence[str]) -> str | None:
    """The tag that stands above signals without one, and above nothing before them; None where there is none.

    It has a digit, as a title above the first column or the word for an average need not have.
    """
    tags = {" ".join(cell.split()) for cell in above if cell.strip()}
    first = next(i for i, cell in enumerate(above) if cell.strip())
    if len(tags) > 1 or not any(map(_signal, names)) or any(map(_signal, names[:first])):
        return None
    [tag] = tags
    if first == 0 or folded(tag.strip(" []()")) in UNITS or not _DIGIT.search(tag) or understand(tag).role:
        return None
    return tag


def _signal(name: str) -> bool:
    """Whether a name is a signal's, of no loop."""
    meaning = understand(name)
    return not meaning.loop and (meaning.weak is not None or meaning.role not in (None, "time", "value", "tag"))


def _repeat(names: Sequence[str]) -> bool:
    """Whether two columns have the same name."""
    filled = [name for name in names if name]
    return len(set(filled)) < len(filled)


def _filled_count(cells: Sequence[str]) -> int:
    return sum(bool(cell.strip()) for cell in cells)


def _are_short(cells: Sequence[str]) -> bool:
    """Whether all cells are short enough for names."""
    return all(len(cell.strip()) <= _SHORT for cell in cells)


def _are_units(cells: Sequence[str]) -> bool:
    """Whether at least half of the filled cells are units."""
    filled = [folded(cell.strip(" []()")) for cell in cells if cell.strip()]
    return sum(cell in UNITS for cell in filled) * 2 >= len(filled)


def no_rows(label: str) -> InputError:
    """The error of a table that has a header and nothing below it."""
    hint = "take a time in which the historian has values, and export again"
    return InputError("has a header but no rows", file=label, hint=hint)
