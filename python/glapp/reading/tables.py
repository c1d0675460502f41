"""Tables in memory: Arrow, pandas, Polars, and mappings or structured arrays of NumPy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from ..errors import InputError
from ..recording import MEMORY
from .source import Source

__all__ = ["TableSource", "to_table"]

_INDEX = "__index_level_0__"  # what Arrow calls the nameless index of a data frame


def to_table(data: Any) -> pa.Table:
    """Arrow table of anything that is one.

    Accepted: objects with `__arrow_c_stream__` or `__arrow_c_array__` (Arrow, Polars, pandas, DuckDB ...) or
    `__dataframe__`, mappings of name to array, structured NumPy arrays.

    Raises InputError for anything else, or columns of different length.

    Examples
    --------
    >>> import numpy as np
    >>> to_table({"t": np.arange(2.0), "PV": [1, 2]}).column_names
    ['t', 'PV']
    """
    try:
        if isinstance(data, pa.Table):
            return data
        if hasattr(data, "__arrow_c_stream__") or hasattr(data, "__arrow_c_array__"):
            try:
                table = pa.table(data)
            except pa.ArrowException:
                if not hasattr(data, "select_dtypes"):  # no data frame of pandas
                    raise
                table = pa.table(data.apply(_one_kind))
            if _INDEX in table.column_names:
                table = table.rename_columns(["time" if n == _INDEX else n for n in table.column_names])
            return table
        if hasattr(data, "__dataframe__"):
            from pyarrow.interchange import from_dataframe

            return from_dataframe(data)
        if isinstance(data, np.ndarray) and data.dtype.names:
            return pa.table({n: _array(data[n]) for n in data.dtype.names})
        if isinstance(data, Mapping):
            return pa.table({str(name): _array(column) for name, column in data.items()})
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise InputError(f"cannot be read as a table: {error}", file=MEMORY) from None
    raise InputError(
        f"a {type(data).__name__} is not a table with named columns",
        file=MEMORY,
        hint="give a pandas, Polars or Arrow table, or a dict such as {'t': ..., 'SP': ..., 'PV': ..., 'OP': ...}",
    )


def _array(column: Any) -> pa.Array | pa.ChunkedArray:
    """A column of a table in memory as Arrow."""
    if isinstance(column, pa.Array | pa.ChunkedArray):
        return column
    if hasattr(column, "__arrow_c_stream__"):
        return pa.chunked_array(column)
    if isinstance(column, np.ndarray):
        mask = np.ma.getmaskarray(column) if isinstance(column, np.ma.MaskedArray) else None
        return pa.array(np.ascontiguousarray(column), mask=mask)
    return pa.array(column)


def _one_kind(column: Any) -> Any:
    """A column of pandas that holds words among numbers, such as Bad, as text: Arrow has no type for both."""
    if column.dtype == object:
        try:
            pa.array(column, from_pandas=True)
        except pa.ArrowException:
            return column.map(str, na_action="ignore")
    return column


class TableSource(Source):
    """A table in memory; rows are counted from 1, or by the lines of the file that it was read from."""

    def __init__(self, table: pa.Table, label: str = MEMORY, lines: Sequence[int] | None = None) -> None:
        self.label = label
        self.names = list(table.column_names)
        self.units = [None] * len(self.names)
        self.rows = table.num_rows
        self._table = table
        self._lines = lines

    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First 1000 rows of the columns."""
        return [_whole(self._table.column(i).slice(0, 1000)) for i in columns]

    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """Pass over the columns in pieces of at most 65536 rows."""
        table = pa.table([self._table.column(i) for i in types], names=[str(i) for i in types])
        done = 0
        for batch in table.to_batches(max_chunksize=65536):
            done += batch.num_rows
            yield batch.columns, done / max(table.num_rows, 1)

    def row_number(self, record: int) -> int:
        """Number of a row as a person counts it: its line in a text file, else from 1."""
        return record + 1 if self._lines is None else self._lines[record]


def _whole(column: pa.ChunkedArray) -> pa.Array:
    joined = column.combine_chunks()
    return joined if isinstance(joined, pa.Array) else pa.concat_arrays(joined.chunks)
