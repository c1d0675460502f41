"""Excel workbooks (.xlsx), by python-calamine: each sheet that holds a table is a source.

Cells come with their types: dates are dates, and numbers have no decimal comma. A column of one type is an Arrow array
of it; any other is text, as it is in a text file.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping, Sequence
from datetime import date, datetime, time, timedelta
from typing import Any

import numpy as np
import pyarrow as pa

from ..errors import InputError
from .columns import understand
from .heads import begins_with_data, body_end, head_of, is_data
from .source import Source
from .values import digits_of

__all__ = ["SheetSource", "sheets"]

_LARGEST = 1 << 31
"""Bytes that a workbook may unpack to: Excel's largest sheet of five columns is a tenth of it."""
_HEAD = 1000


def sheets(path: str, label: str) -> list[Source]:
    """The sheets of a workbook that hold a table.

    Raises
    ------
    InputError
        Where the package that reads workbooks is missing, or the file is no workbook or holds no table.
    """
    try:
        from python_calamine import CalamineWorkbook, SheetTypeEnum
    except ImportError:
        hint = "pip install 'glapp[excel]', or save the sheet as CSV"
        raise InputError(
            "is an Excel workbook, and python-calamine, which reads it, is not installed", file=label, hint=hint
        ) from None
    try:
        with zipfile.ZipFile(path) as packed:
            size = sum(part.file_size for part in packed.infolist())
        if size > _LARGEST:
            what = f"unpacks to {size >> 20} MiB, more than {_LARGEST >> 20} MiB"
            raise InputError(what, file=label, value=size, hint="save the sheet as CSV")
        workbook = CalamineWorkbook.from_path(path)
        names = [sheet.name for sheet in workbook.sheets_metadata if sheet.typ == SheetTypeEnum.WorkSheet]
        tables = {name: workbook.get_sheet_by_name(name) for name in names}
        held = {name: (sheet.start, sheet.to_python()) for name, sheet in tables.items() if sheet.start is not None}
    except (InputError, KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # a panic of the library is no Exception
        raise InputError(f"is not a readable Excel workbook: {error}", file=label) from None
    made: list[Source] = []
    fault: InputError | None = None
    for name, (start, rows) in held.items():
        try:
            made.append(SheetSource(rows, start[0], label, name))
        except InputError as error:
            fault = fault or error
    readable = [source for source in made if _has_signals(source)] or made
    if not readable:
        raise fault or InputError("has no sheet with a table", file=label)
    return readable


def _has_signals(source: Source) -> bool:
    return any(understand(name).role in ("pv", "op", "value") for name in source.names)


class SheetSource(Source):
    """One sheet; rows are counted as Excel numbers them.

    Parameters
    ----------
    rows : list of list
        Its cells.
    first : int
        Rows above them.
    label, sheet : str
        The file, and the sheet's name.

    Raises
    ------
    InputError
        Where it holds no table.
    """

    def __init__(self, rows: Sequence[Sequence[Any]], first: int, label: str, sheet: str) -> None:
        self.label, self.sheet = label, sheet
        width = len(rows[0])
        texts = [(first + i + 1, [_text(cell) for cell in row]) for i, row in enumerate(rows[:_HEAD])]
        filled = [i for i, (_, cells) in enumerate(texts) if any(cells)]
        if not filled or width < 2:
            raise InputError("has only one column" if filled else "is empty", file=label)
        head = head_of(texts, _widest(texts), width)
        names = head.names
        if any(is_data(name) for name in names if name) and not any(understand(n).role for n in names):
            hint = "write the columns' names in the first row, for instance t,SP,PV,OP,MODE"
            raise InputError("has no header: the first row holds data", file=label, row=head.line, hint=hint)
        ends = [(i, [_text(cell) for cell in row]) for i, row in enumerate(rows[head.rows :])]
        while ends and not any(ends[-1][1]):
            ends.pop()
        body = rows[head.rows : head.rows + body_end(ends, width, begins_with_data(ends, width))]
        if not body:
            raise InputError("has a header but no rows", file=label)
        self._first = first + head.rows + 1
        self.rows = len(body)
        kept = [i for i in range(width) if names[i] or any(row[i] != "" for row in body)]
        self.names = [names[i] for i in kept]
        self.units = [head.units[i] for i in kept]
        self._columns = [_array([row[i] for row in body]) for i in kept]
        words = [text for column in self._columns if pa.types.is_string(column.type) for text in column.to_pylist()]
        self.digits = digits_of([text.strip() for text in words if text], label)

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
    """The first row that fills two columns: titles above it fill one."""
    return next((i for i, (_, cells) in enumerate(texts) if sum(map(bool, cells)) > 1), 0)


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
    """To the millisecond: Excel's numbers of days are no finer."""
    rounded = moment + timedelta(microseconds=500)
    return rounded.replace(microsecond=rounded.microsecond // 1000 * 1000)


def _array(cells: Sequence[Any]) -> pa.Array:
    kinds = {type(cell) for cell in cells if cell != ""}
    if kinds <= {int, float}:
        return pa.array([None if cell == "" else float(cell) for cell in cells], pa.float64())
    if kinds == {timedelta}:
        return pa.array([None if cell == "" else cell.total_seconds() for cell in cells], pa.float64())
    if datetime in kinds and kinds <= {date, datetime}:  # midnight comes as a date
        moments = [None if cell == "" else np.datetime64(_moment(cell), "ms") for cell in cells]
        return pa.array(moments, pa.timestamp("ms"))
    return pa.array([_text(cell) for cell in cells], pa.string())


def _moment(cell: date) -> datetime:
    return _whole(cell) if isinstance(cell, datetime) else datetime.combine(cell, time())
