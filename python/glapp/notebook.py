"""HTML of a value for a notebook: a title and a small table, escaped."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from .escape import escaped

__all__ = ["table"]


def table(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """A title and rows of a word and its text, as HTML.

    Examples
    --------
    >>> table("FIC<1>", [("PV", "0 to 50")]).startswith("<b>FIC&lt;1&gt;</b><table><tr><th")
    True
    """
    left = 'style="text-align:left"'
    cells = "".join(f"<tr><th {left}>{_plain(word)}</th><td {left}>{_plain(text)}</td></tr>" for word, text in rows)
    return f"<b>{_plain(title)}</b><table>{cells}</table>"


def _plain(text: str) -> str:
    return escape(escaped(text), quote=False)
