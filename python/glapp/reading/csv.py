"""Text tables: their layout, and streaming them.

The first 64 KiB, or 20 lines where they are longer, (and the last, where they can be had) tell encoding, separator,
decimal comma, thousands, header and a row of units; the last block tells what stands below the rows. Arrow parses the
blocks, numbers and ISO times natively; a column that it cannot convert so is read as text, which knows all spellings
and finds the faulty cell.
"""

from __future__ import annotations

import codecs
import csv
import io
import os
import re
import sys
from bisect import bisect_right
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from itertools import chain, repeat
from pathlib import Path
from threading import Lock

import pyarrow as pa
import pyarrow.csv as pc

from ..errors import InputError
from . import bounds
from .heads import begins_with_data, body_end, head_of, holds_data, no_rows
from .source import Source

__all__ = ["PACKED", "CsvSource", "encoding_of"]

_SAMPLE = 1 << 16
_LINES = 20
_LARGEST_SAMPLE = bounds.LINE
_SHOWN = 80
"""Characters that are shown of a text that is no table."""
_BLOCK = 1 << 22
_AT_ONCE = 320
"""Columns that Arrow converts in one go: for each it keeps 300 kB of words for bad values."""
_THREADS = min(os.cpu_count() or 1, 4)
_IN_COLUMN = re.compile(r"In CSV column #(\d+)")
_FAULTS = 4  # columns of a block found not to be numbers one by one, before all of them are read as text
PACKED = {".gz": "gzip", ".bz2": "bz2", ".zst": "zstd", ".lz4": "lz4"}
"""Compression of a file by its ending."""


class CsvSource(Source):
    """A CSV file, plain or compressed; the header is row 1 and rows are counted as an editor counts lines.

    Raises InputError where the file is empty, is not text, has no header or no rows.
    """

    def __init__(self, path: str, label: str) -> None:
        self.label = label
        self.rows = None
        self.one_fault = True
        self._path = path
        self._starts: list[tuple[int, int]] | None = None
        self._counting = Lock()
        self._compression = PACKED.get(Path(path).suffix.lower())
        self._size = Path(path).stat().st_size
        raw, whole = self._beginning()
        self._sampled = len(raw)
        if not raw.strip(b"\r\n\t \0"):
            if whole:
                raise InputError("is empty", file=label, hint="export the recording again")
            what = f"begins with {len(raw) >> 10} KiB of nothing but spaces and empty lines"
            raise InputError(what, file=label, hint="delete them, so that it begins with the columns' names")
        self._encoding = encoding_of(raw, whole, label)
        text = codecs.getincrementaldecoder(self._encoding)("replace").decode(raw, whole)
        if "\0" in text:
            raise _no_text(label)
        lines = list(io.StringIO(text, newline=None))
        if not whole and len(lines) > 1:
            lines.pop()  # cut off in its middle
        if not whole and len(lines) == 1:
            raise InputError(f"has a first line of more than {self._sampled >> 20} MiB", file=label, row=1)
        try:
            self._delimiter, rows = _separate(lines, label)
            tail = [] if whole else self._last_rows()
        except csv.Error as error:
            raise InputError(f"is not a table of text: {error}", file=label) from None
        width = Counter(len(cells) for _, cells in rows).most_common(1)[0][0]
        self._width, self._timed = width, begins_with_data(rows, width)
        if whole:
            rows = rows[: max(body_end(rows, width, self._timed), 1)]
        start = next(i for i, (_, cells) in enumerate(rows) if len(cells) == width)
        if any(len(cells) > width for _, cells in rows[:start]):
            start = 0  # not a title above the table, but a header with more names than cells: reported as a ragged row
            self._width = width = len(rows[0][1])
        head = head_of(rows, start, width)
        self.names, self.units = head.names, head.units
        if holds_data(self.names):
            self.call_by_numbers(head.line)
            self._skip, body = rows[start - 1][0] if start else 0, rows[start:]
        else:
            self._skip, body = rows[head.rows - 1][0], rows[head.rows :]
        if not body:
            raise no_rows(label)
        body_cells = [cells for _, cells in body if len(cells) == width]
        if not body_cells:
            raise self._ragged(None)
        self._head = body_cells
        self._tail = [cells for cells in tail if len(cells) == width]
        self.learn_digits(cell for row in body_cells + tail for cell in row)

    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First rows of the columns, as text."""
        return [_column(self._head, i) for i in columns]

    def tail(self, column: int) -> pa.Array | None:
        """Last rows of a column, as text."""
        return _column(self._tail, column) if self._tail else None

    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """Pass over the file, in blocks that are parsed side by side and handed out in order."""
        names = [str(i) for i in range(len(self.names))]
        nulls = _null_spellings(bad_words)

        def parse(block: bytes, skip: int, types: Mapping[int, pa.DataType]) -> list[pa.ChunkedArray]:
            items = list(types.items())
            parts = [dict(items[i : i + _AT_ONCE]) for i in range(0, len(items), _AT_ONCE)]
            return [column for part in parts for column in parse_some(block, skip, part).columns]

        def parse_some(block: bytes, skip: int, types: Mapping[int, pa.DataType]) -> pa.Table:
            if skip == 0 and block.startswith(codecs.BOM_UTF8):  # Arrow leaves out a mark that begins what it reads
                block = b"\n" + block
            return pc.read_csv(
                pa.BufferReader(block),
                pc.ReadOptions(use_threads=False, block_size=len(block) + 1, skip_rows=skip, column_names=names),
                pc.ParseOptions(delimiter=self._delimiter),
                pc.ConvertOptions(
                    column_types={str(i): kind for i, kind in types.items()},
                    include_columns=[str(i) for i in types],
                    null_values=nulls,
                    strings_can_be_null=False,
                    decimal_point=self.digits.decimal or ".",
                ),
            )

        def work(block: bytes, skip: int, fraction: float) -> tuple[list[pa.Array], float]:
            kinds = dict(types)
            for _ in range(_FAULTS):
                try:
                    columns = parse(block, skip, kinds)
                    break
                except pa.ArrowInvalid as error:
                    if not (found := _IN_COLUMN.match(str(error))):
                        raise
                    kinds[int(found[1])] = pa.string()
            else:
                columns = parse(block, skip, dict.fromkeys(types, pa.string()))
            return [pa.concat_arrays(c.chunks) if c.num_chunks else pa.nulls(0, c.type) for c in columns], fraction

        waiting: deque[Future[tuple[list[pa.Array], float]]] = deque()
        with ThreadPoolExecutor(_THREADS) as pool:
            try:
                for skip, (block, fraction) in zip(chain((self._skip,), repeat(0)), self._blocks(), strict=False):
                    waiting.append(pool.submit(work, block, skip, fraction))
                    if len(waiting) > 2 * _THREADS:
                        yield waiting.popleft().result()
                while waiting:
                    yield waiting.popleft().result()
            except pa.ArrowInvalid as error:
                raise self._ragged(error) from None
            except (OSError, UnicodeError) as error:
                raise self._unread(error) from None
            finally:
                for future in waiting:
                    future.cancel()

    def _blocks(self) -> Iterator[tuple[bytes, float]]:
        """The file's rows in pieces that end with a line, with the fraction read; without the lines below the table."""
        held: deque[tuple[bytes, float]] = deque()
        size, whole = 0, True  # what is held, and whether that is all of the file
        for piece in self._pieces():
            held.append(piece)
            size += len(piece[0])
            while size - len(held[0][0]) > _SAMPLE:
                size, whole = size - len(held[0][0]), False
                yield held.popleft()
        rest = size - self._footer(b"".join(block for block, _ in held), whole)
        for block, fraction in held:
            if rest > 0:
                yield block[:rest], fraction
            rest -= len(block)

    def _footer(self, end: bytes, whole: bool) -> int:
        """Bytes of the remarks and totals at the end of the file."""
        lines = end[-_SAMPLE:].splitlines(keepends=True)
        if not whole or len(end) > _SAMPLE:
            lines = lines[1:]  # it is cut
        try:
            records = list(csv.reader((line.decode("utf-8", "replace") for line in lines), delimiter=self._delimiter))
        except csv.Error:  # reported where it is read
            return 0
        rows = [(i, cells) for i, cells in enumerate(records) if cells]
        last = body_end(rows, self._width, self._timed)
        if last == len(rows) or len(records) != len(lines):  # no footer, or records broken into lines
            return 0
        return sum(map(len, lines[rows[last][0] :]))

    def _pieces(self) -> Iterator[tuple[bytes, float]]:
        with pa.OSFile(self._path) as file:
            stream, rest, size = self._text(file), b"", 0
            while data := stream.read(_BLOCK):
                size += len(data)
                if self._compression:
                    bounds.check_unpacked(size, self._size, self.label, "unpack it first")
                # A file may end its title by "\n" and its rows by "\r"; a last "\r" may be half of "\r\n".
                end = max(data.rfind(b"\n"), data.rfind(b"\r", 0, -1)) + 1
                if end:
                    yield b"".join((rest, memoryview(data)[:end])), min(file.tell() / max(self._size, 1), 1.0)
                    rest = data[end:]
                else:
                    rest += data
                if len(rest) > bounds.LINE:
                    what = f"has a row of more than {bounds.LINE >> 20} MiB, which ends not before byte {size}"
                    hint = "is it a table of text? save it anew"
                    raise InputError(what, file=self.label, bound=f"≤ {bounds.LINE >> 20} MiB", hint=hint)
            if rest.count(b'"') % 2 and not rest.endswith(b'"'):  # "44 that is cut to "4 would be a wrong number
                line = sum(1 for _ in self._lines())
                what, hint = "ends within a quoted cell", "the file is cut, is it still being written?"
                raise InputError(what, file=self.label, row=line, hint=hint)
            if rest.strip(b"\r\n"):
                yield rest, 1.0

    def _text(self, file: pa.NativeFile) -> pa.NativeFile:
        """Open the file decompressed and converted to UTF-8."""
        stream = pa.CompressedInputStream(file, self._compression) if self._compression else file
        if self._encoding in ("utf-8", "utf-8-sig"):
            return stream
        return pa.transcoding_input_stream(stream, self._encoding, "utf-8")

    def _beginning(self) -> tuple[bytes, bool]:
        """The beginning of the file, long enough to hold some lines, and whether that is all of it."""
        try:
            with pa.OSFile(self._path) as file:
                stream = pa.CompressedInputStream(file, self._compression) if self._compression else file
                raw = b""
                while len(raw) < _LARGEST_SAMPLE:
                    more = bytes(stream.read(max(_SAMPLE, len(raw))))
                    if not more:
                        return raw, True
                    raw += more
                    if len(raw) >= _SAMPLE and max(raw.count(b"\n"), raw.count(b"\r")) > _LINES:
                        break
                return raw, False
        except (OSError, pa.ArrowException) as error:
            raise self._unread(error) from None

    def _unread(self, error: Exception) -> InputError:
        """The error of a file that cannot be read to its end."""
        hint = "it may have been cut off: copy or export it again" if self._compression else None
        return InputError(f"cannot be read: {error}", file=self.label, hint=hint)

    def _last_rows(self) -> list[list[str]]:
        """Cells of the last rows; none where the end cannot be had without reading everything."""
        if self._compression or self._encoding not in ("utf-8", "utf-8-sig", "cp1252"):
            return []
        try:
            with pa.OSFile(self._path) as file:
                file.seek(max(0, self._size - self._sampled))
                text = bytes(file.read(self._sampled)).decode(self._encoding, "replace")
        except OSError as error:
            raise InputError(f"cannot be read: {error}", file=self.label) from None
        lines = io.StringIO(text, newline=None)
        next(lines, None)  # it is cut
        return [row for row in csv.reader(lines, delimiter=self._delimiter) if row]

    def _lines(self) -> Iterator[str]:
        """Lines of the file, as far as it can be read: the pass reports where it cannot."""
        with suppress(OSError, pa.ArrowException), pa.OSFile(self._path) as file:
            stream = pa.CompressedInputStream(file, self._compression) if self._compression else file
            text = io.TextIOWrapper(stream, encoding=self._encoding, errors="replace", newline=None)
            while line := text.readline(bounds.LINE):
                yield line

    def _records(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and cells of every record: the slow road, taken only to say where a fault is."""
        lines = self._lines()
        for _ in range(self._skip):
            next(lines, None)
        reader = csv.reader(lines, delimiter=self._delimiter)
        line = 0
        for cells in reader:
            if cells:
                yield self._skip + line + 1, cells
            line = reader.line_num

    def row_number(self, record: int) -> int:
        """Line on which the record with this index starts."""
        with self._counting:
            if self._starts is None:  # where lines and records part: many loops may ask
                self._starts, before = [(0, self._skip + 1)], self._skip
                try:
                    for i, (line, _) in enumerate(self._records()):
                        if line != before + 1:
                            self._starts.append((i, line))
                        before = line
                except csv.Error:
                    pass
        at, line = self._starts[bisect_right(self._starts, (record, sys.maxsize)) - 1]
        return line + record - at

    def _ragged(self, error: pa.ArrowInvalid | None) -> InputError:
        """Say which row has more or fewer cells than the header."""
        width = len(self.names)
        found: tuple[int, int] | None = None
        cut = False
        try:
            for line, cells in self._records():
                if cut := found is None and len(cells) != width:
                    found = line, len(cells)
                elif found is not None:  # it is not the last
                    break
        except csv.Error:
            pass
        if found is None:
            return InputError(f"is not a regular table: {error}", file=self.label)
        row, count = found
        cut = cut and count < width
        return InputError(
            f"has {count} cell{'s' * (count != 1)} where the header has {width}",
            file=self.label,
            row=row,
            value=count,
            bound=str(width),
            hint="the file ends in the middle of a row, is it still being written?"
            if cut
            else self._mended(count, width),
        )

    def _mended(self, count: int, width: int) -> str:
        """What to do about a row that is too short or too long."""
        if count > width and self._delimiter == ",":
            return "correct or delete the row; where numbers have a decimal comma, export with ';' between the columns"
        return "correct or delete the row"


def encoding_of(raw: bytes, whole: bool, label: str) -> str:
    """Encoding of a text, from its first bytes; `whole` where they are all of it.

    Raises InputError where they are no text.
    """
    for mark, name in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF32_LE, "utf-32"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if raw.startswith(mark):
            return name
    if b"\0" in raw:
        for name, zeros in (("utf-16-le", raw[1::2]), ("utf-16-be", raw[::2])):
            if zeros.count(0) > 0.9 * len(zeros):
                return name
        raise _no_text(label)
    control = sum(raw.count(bytes([c])) for c in range(32) if c not in (9, 10, 12, 13))
    if control > 0.01 * len(raw):
        raise _no_text(label)
    try:
        codecs.getincrementaldecoder("utf-8")().decode(raw, whole)
    except UnicodeDecodeError:
        return "cp1252" if not set(raw) & {0x81, 0x8D, 0x8F, 0x90, 0x9D} else "latin-1"
    return "utf-8"


def _separate(lines: list[str], label: str) -> tuple[str, list[tuple[int, list[str]]]]:
    """The separator that splits most rows into the same number of cells, and the rows so split with their last line."""
    best: tuple[tuple[float, int], str, list[tuple[int, list[str]]]] | None = None
    fault: csv.Error | None = None
    widest = 0
    for order, delimiter in enumerate(("\t", ";", "|", ",")):
        wide = lines[0].count(delimiter) + 1
        if wide > bounds.COLUMNS:
            widest = max(widest, wide)
            continue
        reader = csv.reader(lines, delimiter=delimiter)
        try:
            rows = [(reader.line_num, cells) for cells in reader if cells]
        except csv.Error as error:  # a wide line that this does not separate is one cell, longer than a cell may be
            fault = fault or error
            continue
        width, count = Counter(len(cells) for _, cells in rows).most_common(1)[0] if rows else (0, 0)
        score = (count / max(len(rows), 1), -order)
        if width > 1 and (best is None or score > best[0]):
            best = score, delimiter, rows
    if best is None:
        bounds.check_columns(widest, label)
        if fault is not None:
            raise fault
        begins = " ".join(next((line for line in lines if line.strip()), "").split())[:_SHOWN]
        hint = "separate the columns by comma, semicolon, tab or '|'; where this is a message, export again"
        raise InputError(f"has only one column and begins with '{begins}'", file=label, hint=hint)
    return best[1], best[2]


def _null_spellings(words: Iterable[str]) -> list[str]:
    """The spellings of `words` that a CSV parser compares bytewise; any other one takes the slower, exact road."""
    cases = {s for w in words for s in (w, w.upper(), w.capitalize(), w.title(), w.replace("nan", "NaN"))}
    return sorted(cases | {" " + s for s in cases})


def _column(rows: list[list[str]], column: int) -> pa.Array:
    return pa.array([row[column] for row in rows], pa.string())


def _no_text(label: str) -> InputError:
    """The error of a file in no form that is read."""
    hint = "export the recording as CSV, Excel, Parquet or Arrow"
    return InputError("is not text, Parquet or Arrow", file=label, hint=hint)
