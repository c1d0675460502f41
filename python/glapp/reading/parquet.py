"""Parquet, Arrow IPC and Feather files, a few row groups' pages at a time.

The libraries that read them trust what a file says of itself, and a damaged one can make them read beyond its end. So
every column is validated in full (offsets, indices of dictionaries, text as UTF-8) before anything else looks at it,
and files are read into memory of our own: a file that changes while it is mapped would be trusted after it was checked.
What they do wrong all the same costs a process apart (`glapp.reading.apart`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import pyarrow as pa
import pyarrow.ipc as ipc
import pyarrow.parquet as pq

from ..errors import InputError
from . import bounds
from .source import Head, Source

__all__ = ["IpcSource", "ParquetSource"]

_HEAD = 1000
_ROWS = 65536


@contextmanager
def _refused(what: str, label: str, row: int | None = None) -> Iterator[None]:
    """Any exception over a file as one line: the library has no one kind for a damaged file.

    ArrowException, OSError, UnicodeDecodeError, SystemError, MemoryError and OverflowError have all been seen.
    """
    try:
        yield
    except InputError:
        raise
    except MemoryError as error:
        what = f"asks for more memory than the {bounds.MEMORY >> 20} MiB that reading may take: {error}"
        hint = "it is damaged, or its row groups or record batches are too large: write it in smaller ones"
        raise InputError(what, file=label, row=row, hint=hint) from None
    except Exception as error:
        raise InputError(f"{what}: {error or type(error).__name__}", file=label, row=row) from None


def _names(schema: pa.Schema) -> list[str]:
    """The columns' names; it also makes text of every type, so that none fails later on a zone that is not UTF-8."""
    return [field.name for field in schema if str(field.type)]


def _checked(batch: pa.RecordBatch) -> pa.RecordBatch:
    """The batch, with every column checked against its stated length."""
    batch.validate(full=True)
    return batch


class ParquetSource(Source):
    """A Parquet file; only the needed columns are decoded, and rows are counted from 1."""

    typed = True

    def __init__(self, path: str, label: str) -> None:
        self.label = label
        self._path = path
        with _refused("is not a readable Parquet file", label), self._open() as file:
            bounds.check_columns(file.metadata.num_columns, label)
            self._stored = _names(file.schema_arrow)
            self.rows = file.metadata.num_rows
        self.names = list(self._stored)
        self.units = [None] * len(self.names)
        self._head = Head(self._first)

    def _open(self) -> pq.ParquetFile:
        # pre_buffer would hold a whole row group's bytes, which may be the whole file
        return pq.ParquetFile(self._path, pre_buffer=False, buffer_size=1 << 20)

    def _first(self, i: int) -> pa.Array:
        with _refused("is damaged", self.label), self._open() as file:
            name = self._stored[i]
            batch = next(file.iter_batches(_HEAD, columns=[name]), None)
            return pa.nulls(0, file.schema_arrow.field(i).type) if batch is None else _checked(batch).column(name)

    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First rows of the columns."""
        return self._head(columns)

    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """Pass over the needed columns."""
        names = [self._stored[i] for i in types]
        done = 0
        with _refused("is damaged", self.label), self._open() as file:
            columns = list(dict.fromkeys(names))
            rows = min(_ROWS, max(bounds.PIECE // (8 * max(len(columns), 1)), _HEAD))
            batches = file.iter_batches(rows, columns=columns, use_threads=True)
            while True:
                with _refused("is damaged", self.label, row=done + 1):
                    batch = next(batches, None)
                    if batch is None:
                        return
                    _checked(batch)
                done += batch.num_rows
                yield [batch.column(name) for name in names], done / max(self.rows or 1, 1)

    def row_number(self, record: int) -> int:
        """Row number of a record as a person counts: from 1."""
        return record + 1


class IpcSource(Source):
    """An Arrow IPC file or stream, or a Feather (version 2) file; rows are counted from 1."""

    typed = True

    def __init__(self, path: str, label: str) -> None:
        self.label = label
        self._path = path
        with _refused("is not a readable Arrow file", label):
            schema = self._open(None).schema
            bounds.check_columns(len(schema), label)
            self.names = _names(schema)
        self.units = [None] * len(self.names)
        self._head = Head(self._first)
        self.rows = None

    def _open(self, fields: list[int] | None) -> ipc.RecordBatchFileReader | ipc.RecordBatchStreamReader:
        file = pa.OSFile(self._path)
        options = ipc.IpcReadOptions(included_fields=fields)
        is_file = file.read(6) == b"ARROW1"
        file.seek(0)
        return ipc.open_file(file, options=options) if is_file else ipc.open_stream(file, options=options)

    def _batches(self, fields: list[int]) -> Iterator[tuple[pa.RecordBatch, float]]:
        """Batches of an Arrow file, with the fraction read."""
        with _refused("is damaged", self.label):
            reader = self._open(fields)
            if isinstance(reader, ipc.RecordBatchFileReader):
                for i in range(reader.num_record_batches):
                    yield _checked(reader.get_batch(i)), (i + 1) / reader.num_record_batches
            else:
                for batch in reader:
                    yield _checked(batch), 0.0

    def _first(self, i: int) -> pa.Array:
        for batch, _ in self._batches([i]):
            if batch.num_rows:
                return batch.column(0).slice(0, _HEAD)
        with _refused("is damaged", self.label):
            return pa.nulls(0, self._open(None).schema.field(i).type)

    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First rows of the columns."""
        return self._head(columns)

    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """Pass over the needed columns."""
        fields = sorted(types)
        order = [fields.index(i) for i in types]
        for batch, fraction in self._batches(fields):
            for start in range(0, batch.num_rows, 65536):
                part = batch.slice(start, 65536)
                yield [part.column(i) for i in order], fraction

    def row_number(self, record: int) -> int:
        """Rows are counted from 1."""
        return record + 1
