"""Cells of an Excel workbook that are shown in per cent: a cell that shows 45 % holds 0.45.

python-calamine hands out what cells hold and nothing of their formats, so these are looked up here: the formats in
`styles.xml`, and the cells that have one of them in the text of each sheet.
"""

from __future__ import annotations

import posixpath
import re
import zipfile
from collections.abc import Iterator
from typing import IO
from xml.etree import ElementTree

__all__ = ["PerCent", "cells_in_per_cent"]

_BUILT_IN = {9, 10}  # 0% and 0.00%, ECMA-376 18.8.30
_LITERAL = re.compile(r'"[^"]*"|[\\_*].')
"""Parts of a format in which a sign of per cent is only a sign."""
_ID = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}id"
_PIECE = 1 << 20


class PerCent(float):
    """A number as its cell shows it in per cent."""

    @classmethod
    def of(cls, share: float) -> PerCent:
        """Per cent of a share, in the 15 digits that Excel keeps: 0.57 is 57.

        Examples
        --------
        >>> PerCent.of(0.57), 0.57 * 100
        (57.0, 56.99999999999999)
        """
        return cls(f"{share * 100:.15g}")


def cells_in_per_cent(path: str) -> dict[str, list[tuple[int, int]]]:
    """Name of each sheet to the rows and columns, both from 0, of its numbers that are shown in per cent."""
    with zipfile.ZipFile(path) as whole:
        parts = set(whole.namelist())
        if not {"xl/styles.xml", "xl/workbook.xml", "xl/_rels/workbook.xml.rels"} <= parts:
            return {}
        styles = _styles(whole.read("xl/styles.xml"))
        if not styles:
            return {}
        relations = ElementTree.fromstring(whole.read("xl/_rels/workbook.xml.rels"))
        targets = {one.get("Id"): posixpath.join("/xl", one.get("Target", ""))[1:] for one in relations}
        sheets = ElementTree.fromstring(whole.read("xl/workbook.xml")).iter()
        at = {one.get("name", ""): targets.get(one.get(_ID)) for one in sheets if one.tag.endswith("}sheet")}
        found = {}
        for name, part in at.items():
            if part in parts:
                with whole.open(part) as file:
                    found[name] = list(_cells(file, styles))
        return found


def _styles(text: bytes) -> list[int]:
    """Numbers of the styles of cells that are shown in per cent."""
    root = ElementTree.fromstring(text)
    space = root.tag.partition("}")[0] + "}"
    formats = {int(one.get("numFmtId", -1)): one.get("formatCode", "") for one in root.iter(f"{space}numFmt")}
    per_cent = {one for one, code in formats.items() if "%" in _LITERAL.sub("", code).split(";")[0]} | (
        _BUILT_IN - set(formats)
    )
    cells = root.find(f"{space}cellXfs")
    return [i for i, one in enumerate(() if cells is None else cells) if int(one.get("numFmtId", 0)) in per_cent]


def _cells(file: IO[bytes], styles: list[int]) -> Iterator[tuple[int, int]]:
    """Row and column of the numbers of a sheet that have one of these styles."""
    numbers = "|".join(map(str, styles)).encode()
    cell = re.compile(
        rb"""<(?:\w+:)?c\s(?=[^>]*\bs\s*=\s*["'](?:%s)["'])(?![^>]*\bt\s*=\s*["'][^n"'])""" % numbers
        + rb"""[^>]*?\br\s*=\s*["']([A-Z]{1,3})([0-9]{1,7})["'][^>]*(?<!/)>"""
    )
    rest = b""
    while piece := file.read(_PIECE):
        text = rest + piece
        cut = text.rfind(b"<")
        rest = text[cut:] if cut >= 0 else text
        for letters, row in cell.findall(text, 0, max(cut, 0)):
            column = 0
            for letter in letters:
                column = 26 * column + letter - 64
            yield int(row) - 1, column - 1
