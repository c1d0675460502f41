"""Tables of web pages, which many systems save as .xls, and XML Spreadsheet of Excel 2003.

The largest table of the page is the one that is read; a cell that spans others leaves them empty. A file is read whole,
so it may have at most `bounds.WHOLE` bytes.
"""

from __future__ import annotations

import html
import re
from html.parser import HTMLParser

from ..errors import InputError
from . import bounds
from .excel import SheetSource
from .not_tables import LOGIN, TITLE
from .source import Source

__all__ = ["is_markup", "page"]

_DIGIT = re.compile("[0-9]")


def is_markup(beginning: str) -> bool:
    """Whether a text begins as a web page or an XML Spreadsheet with a table in it.

    Examples
    --------
    >>> is_markup("<html><body><table><tr>"), is_markup("<note>none</note>"), is_markup("t,SP,PV")
    (True, False, False)
    """
    text = beginning.lstrip("\ufeff \t\r\n").lower()
    return text.startswith("<") and any(
        mark in text for mark in ("<table", "<workbook", ":workbook", "<html", "<!doctype")
    )


def page(text: str, label: str) -> Source:
    """The largest table of a page.

    Raises InputError where there is none, or it asks for more than `bounds` allow.
    """
    reader = _Tables(label)
    reader.feed(text)
    reader.close()
    rows = max(reader.tables, key=len, default=[])
    if not any(_DIGIT.search(cell) for row in rows for cell in row):
        title = TITLE.search(text)
        called = f", '{' '.join(html.unescape(title[1]).split())}'," if title else ""
        if LOGIN.search(text):
            hint = "log in to the historian, and export again"
            raise InputError(f"is a web page{called} that asks for a login", file=label, hint=hint)
        hint = "open it in a browser to see what it says; save the table as CSV or .xlsx"
        raise InputError(f"is a web page{called} without a table of numbers", file=label, hint=hint)
    width = max(map(len, rows))
    bounds.check_columns(width, label)
    if width * len(rows) > bounds.CELLS:
        what = f"has a table of {len(rows)} rows and {width} columns; at most {bounds.CELLS} cells are read"
        raise InputError(what, file=label, value=width * len(rows), bound=f"≤ {bounds.CELLS} cells")
    return SheetSource([row + [""] * (width - len(row)) for row in rows], 0, 0, label, "table")


class _Tables(HTMLParser):
    """Rows of cells of every table, those of a table within a cell apart."""

    def __init__(self, label: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tables: list[list[list[str]]] = []
        self._label = label
        self._open: list[list[list[str]]] = []
        self._cell: list[str] | None = None
        self._across = 1
        self._below: list[dict[int, int]] = []
        self._down = 1

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """A table, a row or a cell begins."""
        tag, attributes = tag.rpartition(":")[2], {name.rpartition(":")[2]: value or "" for name, value in attrs}
        if tag == "table":
            self._ended()
            self.tables.append([])
            self._open.append(self.tables[-1])
            self._below.append({})
        elif tag in ("tr", "row") and self._open:
            self._ended()
            rows = self._open[-1]
            rows += [[] for _ in range(self._skipped(attributes, len(rows)))]
            rows.append([])
            self._cells(len(rows))
            self._spanned()
        elif tag in ("td", "th", "cell") and self._open and self._open[-1]:
            self._ended()
            row = self._open[-1][-1]
            row += [""] * self._skipped(attributes, len(row))
            self._cell = []
            self._across = self._number(attributes.get("colspan"), 1) + self._number(attributes.get("mergeacross"), 0)
            self._down = self._number(attributes.get("rowspan"), 1)
        elif tag in ("br", "p") and self._cell is not None:
            self._cell.append(" ")

    def handle_endtag(self, tag: str) -> None:
        """A cell or a table ends."""
        tag = tag.rpartition(":")[2]
        if tag in ("td", "th", "cell", "tr", "row"):
            self._ended()
        elif tag == "table" and self._open:
            self._ended()
            self._open.pop()
            self._below.pop()

    def handle_data(self, data: str) -> None:
        """Text of a cell."""
        if self._cell is not None:
            self._cell.append(data)

    def _ended(self) -> None:
        """The cell at hand, into its row."""
        if self._cell is None or not self._open or not self._open[-1]:
            self._cell = None
            return
        text = " ".join("".join(self._cell).replace("\xa0", " ").split())
        row, self._cell = self._open[-1][-1], None
        bounds.check_columns(len(row) + self._across, self._label)
        for i in range(self._across):
            if self._down > 1:
                self._below[-1][len(row)] = self._down - 1
            row.append("" if i else text)
        self._spanned()

    def _spanned(self) -> None:
        """Leave the cells empty that one above spans."""
        if not self._open or not self._open[-1]:
            return
        row, below = self._open[-1][-1], self._below[-1]
        while below.get(len(row), 0):
            below[len(row)] -= 1
            row.append("")
        bounds.check_columns(len(row), self._label)

    def _skipped(self, attributes: dict[str, str], have: int) -> int:
        """Rows or cells that an XML Spreadsheet leaves out before this one."""
        return max(self._number(attributes.get("index"), have + 1) - have - 1, 0)

    def _number(self, text: str | None, otherwise: int) -> int:
        """A number of rows or columns in an attribute, checked."""
        found = int(text) if text and text.isdecimal() and len(text) < 8 else otherwise
        self._cells(found)
        return found

    def _cells(self, count: int) -> None:
        """Refuse a table with too many cells."""
        if count > bounds.CELLS:
            what = f"has a table of {count} cells; at most {bounds.CELLS} are read"
            raise InputError(what, file=self._label, value=count, bound=f"≤ {bounds.CELLS} cells")
