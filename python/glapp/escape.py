"""Text from outside on its way out: characters that a terminal or a spreadsheet would obey are shown instead.

Names of files, loops, columns, tags and units come from outside. A terminal obeys control characters and turns of
direction; a spreadsheet computes a cell that begins like a formula.
"""

from __future__ import annotations

import re
import unicodedata
from typing import Any

__all__ = ["escaped", "for_spreadsheet", "in_quotes", "one_line"]

_FORMULA = (*"=+-@", *"\uff1d\uff0b\uff0d\uff20", "\t", "\r", "\n")  # the second four in full width, as Excel in Japan
_OTHER = re.compile(r"[^\n\x20-\x7e]")


def escaped(text: str) -> str:
    r"""The text with control characters, invisible marks and turns of direction shown; line breaks stay.

    Examples
    --------
    >>> print(escaped("FIC\x1b[31m101 d\u0302 \u202e"))
    FIC\x1b[31m101 d̂ \u202e
    """
    return _OTHER.sub(lambda found: _escaped(found.group()), text)


def one_line(text: str) -> str:
    r"""A text with line breaks shown too: for a name in a line or in a cell.

    Examples
    --------
    >>> print(one_line("FIC101\nFIC102"))
    FIC101\nFIC102
    """
    return escaped(text).replace("\n", "\\n")


def in_quotes(text: str) -> str:
    r"""JSON or TOML as it is, but with such characters in its strings written as \uXXXX, which means the same there.

    Examples
    --------
    >>> print(in_quotes('{"loop": "FIC\x9b31m"}'))
    {"loop": "FIC\u009b31m"}
    """

    def code(found: re.Match[str]) -> str:
        char = found.group()
        return f"\\u{ord(char):04x}" if ord(char) < 0xD800 and _escaped(char) != char else char

    return _OTHER.sub(code, text)


def for_spreadsheet(cell: Any) -> Any:
    """A cell of CSV that no spreadsheet takes for a formula: an apostrophe goes before it (OWASP, CSV injection).

    What is no text, as a number, stays what it is.

    Examples
    --------
    >>> for_spreadsheet("=cmd|' /C calc'!A0"), for_spreadsheet("FIC-101"), for_spreadsheet(-2.5)
    ("'=cmd|' /C calc'!A0", 'FIC-101', -2.5)
    """
    if not isinstance(cell, str):
        return cell
    return ("'" if cell.startswith(_FORMULA) else "") + one_line(cell)


def _escaped(char: str) -> str:
    """A control character as its escape, any other as itself."""
    if unicodedata.category(char) in ("Cc", "Cf", "Cs", "Zl", "Zp"):
        return char.encode("unicode_escape").decode()
    return char
