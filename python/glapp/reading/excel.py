"""Workbooks of Excel (.xlsx) and LibreOffice (.ods), by python-calamine: each sheet that holds a table is a source.

python-calamine takes memory for every cell from the first to the last that is filled, whatever lies between: one cell
in the last corner of a sheet asks for half a terabyte. So what is packed is looked through first, a MiB at a time:
how much it is, how long one cell, and how far apart the cells are. What the file says of itself (`<dimension>`, sizes
in the directory of the zip) is not believed.

Cells come with their types: dates are dates, and numbers have no decimal comma. A number is what its cell shows: 45
where that is 45 %. A column of one type is an Arrow array
of it; any other is text, as it is in a text file.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa

from ..errors import InputError
from . import apart, bounds
from .heads import begins_with_data, body_end, head_of, holds_data, no_rows
from .meaning import is_long, understand
from .not_tables import check_archive
from .per_cent import PerCent, cells_in_per_cent
from .source import Source

__all__ = ["SheetSource", "sheets"]

_HEAD = 1000
_PIECE = 1 << 20
_CELL = re.compile(rb"""<(?:\w+:)?c\s[^>]*?\br\s*=\s*["']([A-Za-z]{1,20})([0-9]{1,20})["'][^>]*(?<!/)>""")
"""A cell that holds something; where it only has a look, it ends by a slash."""


def sheets(path: str, label: str) -> list[Source]:
    """The sheets of a workbook that hold a table, read in a process apart.

    Raises InputError where the package that reads workbooks is missing, or the file is no workbook, too large or holds
    no table.
    """
    try:
        import python_calamine  # noqa: F401
    except ImportError:
        hint = "pip install 'glapp[excel]', or save the sheet as CSV"
        raise InputError(
            "is a workbook, and python-calamine, which reads it, is not installed", file=label, hint=hint
        ) from None
    return apart.call(label, _sheets, str(Path(path).absolute()), label)


def _sheets(path: str, label: str) -> list[Source]:
    """Sheets of a workbook that hold signals."""
    from python_calamine import CalamineWorkbook, SheetTypeEnum

    made: list[Source] = []
    fault: InputError | None = None
    try:
        _check(path, label)
        workbook = CalamineWorkbook.from_path(path)
        in_per_cent = cells_in_per_cent(path)
        for name in [sheet.name for sheet in workbook.sheets_metadata if sheet.typ == SheetTypeEnum.WorkSheet]:
            sheet = workbook.get_sheet_by_name(name)
            if sheet.start is None:
                continue
            rows, (first, left) = sheet.to_python(), sheet.start
            del sheet
            _show_per_cent(rows, [(row - first, column - left) for row, column in in_per_cent.get(name, ())])
            try:
                made.append(SheetSource(rows, first, left, label, name))
            except InputError as error:
                fault = fault or error
    except (InputError, MemoryError, KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # a panic of the library is no Exception
        raise InputError(f"is not a readable workbook: {error}", file=label) from None
    readable = [source for source in made if _has_signals(source)] or made
    if not readable:
        raise fault or InputError("has no sheet with a table", file=label)
    return readable


def _show_per_cent(rows: Sequence[list[Any]], cells: Sequence[tuple[int, int]]) -> None:
    """Put what it shows in the place of the number in each of these cells."""
    for row, column in cells:  # one without a value may be beyond the last that has one
        inside = 0 <= row < len(rows) and 0 <= column < len(rows[row])
        if inside and type(share := rows[row][column]) in (int, float):
            rows[row][column] = PerCent.of(share)


def _check(path: str, label: str) -> None:
    """Refuse an archive that is no workbook, or exceeds `bounds` by its content, not by its own statements.

    Raises InputError where it does.
    """
    packed, size, cells = Path(path).stat().st_size, 0, 0
    with zipfile.ZipFile(path) as whole:
        parts = whole.infolist()
        check_archive((part.filename for part in parts), label)
        if len(parts) > bounds.PARTS:
            what = f"holds {len(parts)} files, a workbook of at most {bounds.PARTS} is read"
            raise InputError(what, file=label, value=len(parts), hint="save the sheet as CSV")
        for part in parts:
            if part.is_dir():
                continue
            with whole.open(part) as file:
                count = Reach(label)
                for piece in _from(file):
                    size += len(piece)
                    bounds.check_unpacked(size, packed, label, "save the sheet as CSV")
                    count(piece)
            if not part.filename.lower().endswith("calcchain.xml"):  # names the cells of a sheet once more
                cells += count.cells
                if cells > bounds.CELLS:
                    raise InputError(
                        f"has cells as far as {count.last}, {cells} cells from the first to the last that is filled; "
                        f"at most {bounds.CELLS} are read",
                        file=label,
                        value=cells,
                        bound=f"≤ {bounds.CELLS} cells",
                        hint="delete what stands outside the table, or save the sheet as CSV",
                    )


def _from(file: IO[bytes]) -> Iterator[bytes]:
    while piece := file.read(_PIECE):
        yield piece


class Reach:
    """Extent of the filled cells of a sheet, from its text piece by piece.

    - `cells`: rows by columns, from the first to the last.
    - `last`: the last of both.
    """

    def __init__(self, label: str) -> None:
        self._label = label
        self._rest = b""
        self._rows: set[int] = set()
        self._columns: set[int] = set()

    def __call__(self, piece: bytes) -> None:
        """Look at the next piece.

        Raises InputError where one cell is longer than `bounds.TEXT`.
        """
        text = self._rest + piece
        cut = text.rfind(b"<")
        self._rest = text[cut:] if cut >= 0 else text
        if len(self._rest) > bounds.TEXT:
            raise InputError(
                f"has a cell of more than {bounds.TEXT >> 10} KiB; Excel's own have at most 32 767 characters",
                file=self._label,
                bound=f"≤ {bounds.TEXT >> 10} KiB",
                hint="save the sheet as CSV",
            )
        found = _CELL.findall(text, 0, cut if cut >= 0 else 0)
        rows = {row for _, row in found}
        self._rows.update((int(min(rows, key=int)), int(max(rows, key=int))) if rows else ())
        self._columns.update(_column_number(letters) for letters in {letters for letters, _ in found})

    @property
    def cells(self) -> int:
        """Rows by columns."""
        if not self._rows:
            return 0
        return (max(self._rows) - min(self._rows) + 1) * (max(self._columns) - min(self._columns) + 1)

    @property
    def last(self) -> str:
        """The last row and column, as Excel names a cell."""
        column, letters = max(self._columns), ""
        while column:
            column, letter = divmod(column - 1, 26)
            letters = chr(65 + letter) + letters
        return f"{letters}{max(self._rows)}"


def _column_number(letters: bytes) -> int:
    """The number of a column by its letters: A is 1, XFD is 16384."""
    number = 0
    for letter in letters.upper():
        number = 26 * number + letter - 64
    return number


def _has_signals(source: Source) -> bool:
    return is_long(source.names) or any(understand(name).role in ("pv", "op") for name in source.names)


class SheetSource(Source):
    """One sheet; rows are counted as Excel numbers them.

    - `rows`: its cells.
    - `first`, `left`: rows above them, columns before them.
    - `label`, `sheet`: the file, and the sheet's name.

    Raises InputError where it holds no table.
    """

    def __init__(self, rows: Sequence[Sequence[Any]], first: int, left: int, label: str, sheet: str) -> None:
        self.label, self.sheet = label, sheet
        used = [i for i, column in enumerate(zip(*rows, strict=True)) if column.count("") < len(column)]
        if len(used) < len(rows[0]):  # one cell far to the right makes thousands of columns
            rows = [[row[i] for i in used] for row in rows]
        width = len(used)
        texts = [(first + i + 1, [_text(cell) for cell in row]) for i, row in enumerate(rows[:_HEAD])]
        filled = [i for i, (_, cells) in enumerate(texts) if any(cells)]
        if not filled or width < 2:
            hint = "export time, PV and OP of the loop, a column each" if filled else "export the recording again"
            raise InputError("has only one column" if filled else "is empty", file=label, hint=hint)
        head = head_of(texts, _widest(texts), width)
        self.names, self.units = head.names, head.units
        above = head.rows
        if holds_data(self.names):
            self.call_by_numbers(head.line)
            above = _widest(texts)
        end = len(rows)
        while end > above and not any(map(_text, rows[end - 1])):
            end -= 1
        start = max(above, end - _HEAD)
        ends = texts[start:end] + [(0, [_text(cell) for cell in row]) for row in rows[max(start, len(texts)) : end]]
        timed = begins_with_data(texts[above:], width)
        body = rows[above : start + body_end(ends, width, timed)]
        if not body:
            raise no_rows(label)
        self._first = first + above + 1
        self.rows = len(body)
        kept = [i for i in range(width) if self.names[i] or any(row[i] != "" for row in body)]
        self.names = [self.names[i] for i in kept]
        self.units = [self.units[i] for i in kept]
        self._numbers = [left + used[i] + 1 for i in kept]
        for i, at in enumerate(kept):
            if self.units[i] is None and any(isinstance(row[at], PerCent) for row in body):
                self.units[i] = "%"
        self._columns = [_array([row[i] for row in body]) for i in kept]
        written = [column for column in self._columns if pa.types.is_string(column.type)]
        self.learn_digits(text for column in written for text in column.to_pylist())

    def number(self, column: int) -> int:
        """Number of the column in the sheet: 1 is A."""
        return self._numbers[column]

    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First 1000 rows of the columns."""
        return [self._columns[i].slice(0, _HEAD) for i in columns]

    def tail(self, column: int) -> pa.Array:
        """Last 1000 rows of a column."""
        return self._columns[column].slice(max(0, len(self._columns[column]) - _HEAD))

    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """The columns, in pieces of at most 65536 rows."""
        total = len(self._columns[0])
        for start in range(0, total, 65536):
            part = [self._columns[i].slice(start, 65536) for i in types]
            yield part, min((start + 65536) / total, 1.0)

    def row_number(self, record: int) -> int:
        """Row as Excel numbers it."""
        return self._first + record


def _widest(texts: Sequence[tuple[int, Sequence[str]]]) -> int:
    """The first row that fills two columns: titles above it fill one. The tag of its signals may stand above it."""
    widest = next((i for i, (_, cells) in enumerate(texts) if sum(map(bool, cells)) > 1), 0)
    above = texts[widest - 1][1] if widest and not holds_data(texts[widest][1]) else [""]
    return widest - 1 if not above[0] and any(above) else widest


def _text(cell: Any) -> str:
    """A cell as a text file has it."""
    if isinstance(cell, str):
        return cell.strip()
    if isinstance(cell, bool):
        return "true" if cell else "false"
    if isinstance(cell, float):
        return f"{cell:.17g}" if not cell.is_integer() else f"{cell:.0f}"
    if isinstance(cell, timedelta):
        return f"{cell.total_seconds():.17g}"
    if isinstance(cell, datetime):
        return _whole(cell).isoformat(" ")
    return cell.isoformat() if isinstance(cell, date | time) else str(cell)


def _whole(moment: datetime) -> datetime:
    """A moment to the millisecond: Excel's numbers of days are no finer."""
    rounded = moment + timedelta(microseconds=500)
    return rounded.replace(microsecond=rounded.microsecond // 1000 * 1000)


def _array(cells: Sequence[Any]) -> pa.Array:
    """Cells of a column as an array of one type."""
    kinds = {type(cell) for cell in cells if cell != ""}
    if kinds <= {int, float, PerCent}:
        return pa.array([None if cell == "" else float(cell) for cell in cells], pa.float64())
    if kinds == {timedelta}:
        return pa.array([None if cell == "" else cell.total_seconds() for cell in cells], pa.float64())
    if datetime in kinds and kinds <= {date, datetime}:  # midnight comes as a date
        moments = [None if cell == "" else np.datetime64(_moment(cell), "ms") for cell in cells]
        return pa.array(moments, pa.timestamp("ms"))
    return pa.array([_text(cell) for cell in cells], pa.string())


def _moment(cell: date) -> datetime:
    return _whole(cell) if isinstance(cell, datetime) else datetime.combine(cell, time())
