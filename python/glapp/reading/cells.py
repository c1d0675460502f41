"""Cells of a column, and the fault of one that cannot be used."""

from __future__ import annotations

import pyarrow as pa
import pyarrow.compute as pc

__all__ = ["CellFault", "is_text", "plain", "words"]


class CellFault(Exception):  # noqa: N818 (it never leaves the package: InputError does)
    """A cell that cannot be used: its index in the present batch, its text, and the error."""

    def __init__(
        self, index: int, what: str, hint: str | None = None, value: object = None, asks: str | None = None
    ) -> None:
        super().__init__(what)
        self.index, self.what, self.hint, self.value, self.asks = index, what, hint, value, asks


def is_text(kind: pa.DataType) -> bool:
    """Whether values of this Arrow type are text."""
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind))


def plain(column: pa.Array) -> pa.Array:
    """The column without a dictionary or runs, and text always as `string`."""
    if pa.types.is_run_end_encoded(column.type):
        column = pc.run_end_decode(column)
    if pa.types.is_dictionary(column.type):
        column = column.dictionary_decode()
    return column.cast(pa.string()) if is_text(column.type) and not pa.types.is_string(column.type) else column


def words(column: pa.Array) -> pa.Array:
    """A column of words, or of numbers that stand for them, without a dictionary.

    Raises CellFault where it holds neither.
    """
    column = plain(column)
    kind = column.type
    if pa.types.is_null(kind):
        return column.cast(pa.string())
    if pa.types.is_float16(kind):  # which Arrow cannot compare
        return column.cast(pa.float32())
    numeric = pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)
    if not (is_text(kind) or numeric or pa.types.is_boolean(kind)):
        raise CellFault(0, f"holds {kind}, not words or numbers", value=str(kind))
    return column
