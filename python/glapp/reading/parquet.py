"""Parquet, Arrow IPC and Feather files, a few row groups' pages at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import pyarrow as pa
import pyarrow.ipc as ipc
import pyarrow.parquet as pq

from ..errors import InputError
from .source import Source

__all__ = ["IpcSource", "ParquetSource"]


class ParquetSource(Source):
    """A Parquet file; only the needed columns are decoded, and rows are counted from 1."""

    def __init__(self, path: str, label: str) -> None:
        self.label = label
        self._path = path
        with self._open() as file:
            schema = file.schema_arrow
            self.rows = file.metadata.num_rows
        self.names = list(schema.names)
        self.units = [None] * len(self.names)
        self._head: dict[int, pa.Array] = {}

    def _open(self) -> pq.ParquetFile:
        try:
            # pre_buffer would hold a whole row group's bytes, which may be the whole file
            return pq.ParquetFile(self._path, pre_buffer=False, buffer_size=1 << 20)
        except (pa.ArrowException, OSError) as error:
            raise InputError(f"is not a readable Parquet file: {error}", file=self.label) from None

    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First rows of the columns; each is read once."""
        missing = [i for i in columns if i not in self._head]
        if missing:
            with self._open() as file:
                schema = file.schema_arrow
                for start in range(0, len(missing), 64):  # a page of each is in memory
                    part = missing[start : start + 64]
                    try:
                        batch = next(file.iter_batches(1000, columns=[self.names[i] for i in part]), None)
                    except (pa.ArrowException, OSError) as error:
                        raise InputError(f"is damaged: {error}", file=self.label) from None
                    for i in part:
                        nothing = pa.nulls(0, schema.field(i).type)
                        self._head[i] = nothing if batch is None else batch.column(self.names[i])
        return [self._head[i] for i in columns]

    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """Pass over the needed columns."""
        names = [self.names[i] for i in types]
        done = 0
        with self._open() as file:
            try:
                for batch in file.iter_batches(65536, columns=list(dict.fromkeys(names)), use_threads=True):
                    done += batch.num_rows
                    yield [batch.column(name) for name in names], done / max(self.rows or 1, 1)
            except (pa.ArrowException, OSError) as error:
                raise InputError(f"is damaged: {error}", file=self.label, row=done + 1) from None

    def row_number(self, record: int) -> int:
        """Rows are counted from 1."""
        return record + 1


class IpcSource(Source):
    """An Arrow IPC file or stream, or a Feather (version 2) file; rows are counted from 1."""

    def __init__(self, path: str, label: str) -> None:
        self.label = label
        self._path = path
        schema = self._open(None).schema
        self.names = list(schema.names)
        self.units = [None] * len(self.names)
        self.rows = None
        self._head: dict[int, pa.Array] = {}

    def _open(self, fields: list[int] | None) -> ipc.RecordBatchFileReader | ipc.RecordBatchStreamReader:
        try:
            file = pa.memory_map(self._path)
            options = ipc.IpcReadOptions(included_fields=fields)
            is_file = file.read(6) == b"ARROW1"
            file.seek(0)
            return ipc.open_file(file, options=options) if is_file else ipc.open_stream(file, options=options)
        except (pa.ArrowException, OSError) as error:
            raise InputError(f"is not a readable Arrow file: {error}", file=self.label) from None

    def _batches(self, fields: list[int] | None) -> Iterator[tuple[pa.RecordBatch, float]]:
        reader = self._open(fields)
        try:
            if isinstance(reader, ipc.RecordBatchFileReader):
                for i in range(reader.num_record_batches):
                    yield reader.get_batch(i), (i + 1) / reader.num_record_batches
            else:
                for batch in reader:
                    yield batch, 0.0
        except (pa.ArrowException, OSError) as error:
            raise InputError(f"is damaged: {error}", file=self.label) from None

    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First rows of the columns; each is read once."""
        missing = sorted(set(columns) - self._head.keys())
        if missing:
            first = next((batch for batch, _ in self._batches(missing) if batch.num_rows), None)
            found = [pa.nulls(0) for _ in missing] if first is None else first.columns
            self._head.update(zip(missing, (column.slice(0, 1000) for column in found), strict=True))
        return [self._head[i] for i in columns]

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
