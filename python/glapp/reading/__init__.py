"""Reading recordings from files and tables."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from ..errors import InputError
from ..loop import Loop
from ..recording import Recording
from . import apart, bounds
from .cells import words
from .columns import described_one, each_with_columns, for_one
from .csv import PACKED, CsvSource, encoding_of
from .each import all_or_none
from .excel import sheets
from .files import check_file, name_of
from .influx import annotated, is_annotated, is_line_protocol, line_protocol
from .long import long_recordings
from .markup import is_markup, page
from .meaning import is_long
from .not_tables import check_beginning
from .parquet import IpcSource, ParquetSource
from .passes import Passes
from .shape import shaped, signals_of, tagged
from .source import Source
from .structured import parsed, table_of
from .tables import TableSource, to_table
from .wide import WideRecording

_BEGINNING = 1 << 16

__all__ = ["first_rows", "open_each", "open_recordings", "recording_from"]


def open_recordings(
    path: str | Path, loops: Sequence[Loop] | None = None, defaults: Mapping[str, Any] | None = None
) -> list[Recording]:
    r"""Open a CSV, Excel, OpenDocument, JSON, HTML, Parquet, Arrow IPC or Feather file and say which loops it holds.

    A *wide* file has a column per signal, of one loop (t, SP, PV, OP) or of several (FIC101.SP, FIC101.PV ...).
    A *long* file has a row per tag and time: `glapp.reading.long` joins its tags. What is a bit of both,
    with a time column for each tag or with tags on alternate rows, is brought to a long one (`glapp.reading.shape`).

    Parameters
    ----------
    path : str or Path
        File.
    loops : sequence of Loop, optional
        Settings of the loops that are wanted from this file. None: all loops that the column names show.
    defaults : mapping, optional
        Settings for the loops found when `loops` is None, as in [defaults] of a loops.toml.

    Returns
    -------
    list of Recording
        One per loop, in the order of `loops` or of the columns; a single loop without a prefix has the file's name.

    Raises
    ------
    InputError
        Where the file or its columns cannot be used.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "FIC101.csv")
    ...     _ = path.write_text("t,SP,PV,OP\n0,1,0.9,50\n1,1,1.1,51\n")
    ...     [recording.name for recording in open_recordings(path)]
    ['FIC101']
    """
    return all_or_none(open_each(path, loops, defaults))


def open_each(
    path: str | Path,
    loops: Sequence[Loop] | None = None,
    defaults: Mapping[str, Any] | None = None,
    only: Collection[str] | None = None,
) -> list[Recording | InputError]:
    """Open a file, with the error in the place of a loop that cannot be used: the others can go on.

    - `only`: names of loops that are wanted where `loops` is None, none for all. What `defaults` say of one loop, such
      as its column of PV or its controller, is said of the one that is wanted. None: it is said of each loop.

    Raises InputError where the file cannot be used, or `defaults` that describe one loop would be said of several.
    """
    sources = _open(Path(path), str(path))
    if len(sources) == 1:
        return _recordings(sources[0], name_of(path), loops, defaults, only)
    if loops is None:
        return _of_sheets(sources, name_of(path), defaults, only)
    return [_of_any(sources, loop) for loop in loops]


def _of_sheets(
    sources: Sequence[Source], stem: str, defaults: Mapping[str, Any] | None, only: Collection[str] | None
) -> list[Recording | InputError]:
    """The loops of all sheets.

    Raises InputError where `defaults` describe one loop, and several are wanted.
    """
    opened = [
        recording
        for source in sources
        for recording in _recordings(source, getattr(source, "sheet", stem), None, defaults, only)
    ]
    wanted = [one.name for one in opened if isinstance(one, Recording) and (not only or one.name in only)]
    # Sheets of the same columns are like files of the same columns: a name of one is the name of it in all.
    if only is not None and len(wanted) > 1 and (options := described_one({**(defaults or {}), "columns": {}})):
        raise for_one(options, f"holds {len(wanted)} loops", wanted, sources[0].label)
    return opened


def _of_any(sources: Sequence[Source], loop: Loop) -> Recording | InputError:
    """The loop from the first sheet that holds it; a sheet of its name goes first."""
    named = sorted(sources, key=lambda source: getattr(source, "sheet", "") != loop.name)
    found = [_recordings(source, loop.name, [loop], None)[0] for source in named]
    return next((entry for entry in found if isinstance(entry, Recording)), found[0])


def first_rows(path: str | Path, rows: int) -> tuple[list[str], list[list[str]]]:
    """Names of the columns of a file, and its first rows as text, for a person who assigns the columns.

    Raises InputError where the file cannot be used.
    """
    source = _open(Path(path), str(path))[0]
    source.tell_apart()
    columns = [
        words(column.slice(0, rows)) if not pa.types.is_temporal(column.type) else column.cast(pa.string())
        for column in source.head(range(len(source.names)))
    ]
    cells = [["" if cell is None else str(cell) for cell in column.slice(0, rows).to_pylist()] for column in columns]
    return source.names, [list(row) for row in zip(*cells, strict=False)]


def recording_from(data: Any, loop: Loop | None = None) -> Recording:
    """Recording of one loop in a table in memory: pandas, Polars, Arrow, a dict of arrays, a structured NumPy array.

    Parameters
    ----------
    data : table
        See `glapp.reading.tables.to_table`.
    loop : Loop, optional
        Settings; by default a loop named "loop" with guessed columns.

    Raises
    ------
    InputError
        Where the table cannot be used, or holds several loops and `loop` does not say which.

    Examples
    --------
    >>> import numpy as np
    >>> recording = recording_from({"t": np.arange(3.0), "SP": np.ones(3), "PV": [0.9, 1.1, None], "OP": np.zeros(3)})
    >>> batch = next(recording.batches())
    >>> batch.t.tolist(), batch.flags.tolist()
    ([0.0, 1.0, 2.0], [0, 0, 2])
    """
    source = TableSource(to_table(data))
    found = all_or_none(_recordings(source, "loop", None if loop is None else [loop], None))
    if len(found) > 1:
        raise InputError(
            f"holds {len(found)} loops: {', '.join(r.name for r in found)}",
            file=source.label,
            hint="give a Loop with the name of the one that is meant",
        )
    return found[0]


def _open(path: Path, label: str) -> list[Source]:
    """Sources in a file, by its first bytes and its ending."""
    check_file(path, label)
    try:
        with path.open("rb") as file:
            magic = file.read(20)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", file=label) from None
    if magic.startswith(b"PAR1"):
        return [apart.opened(ParquetSource, str(path), label)]
    if magic.startswith((b"ARROW1", b"\xff\xff\xff\xff")):
        return [apart.opened(IpcSource, str(path), label)]
    if magic.startswith(b"PK\x03\x04"):
        return sheets(str(path), label)
    if magic.startswith(b"\xd0\xcf\x11\xe0"):
        raise InputError("is an old or a locked Office file", file=label, hint="save it as .xlsx or CSV, unlocked")
    check_beginning(path, magic, label)
    return [_text(path, label)]


def _text(path: Path, label: str) -> Source:
    """A table of text, JSON, a web page or an export of InfluxDB, packed or not."""
    try:
        raw = _unpacked(path, _BEGINNING)
        encoding = encoding_of(raw, len(raw) < _BEGINNING, label)
    except (InputError, OSError, pa.ArrowException):  # the reader of text reports it
        return CsvSource(str(path), label)
    beginning = raw.decode(encoding, "replace").lstrip("\ufeff \t\r\n")

    def whole() -> str:
        try:
            data = _unpacked(path, bounds.WHOLE + 1)
        except (OSError, pa.ArrowException) as error:
            raise InputError(f"cannot be read: {error}", file=label) from None
        if len(data) > bounds.WHOLE:
            what = f"has more than the {bounds.WHOLE >> 20} MiB that are read whole"
            hint = "export less at a time, or write CSV or Parquet"
            raise InputError(what, file=label, bound=f"≤ {bounds.WHOLE >> 20} MiB", hint=hint)
        return data.decode(encoding, "replace")

    if is_annotated(beginning):
        return annotated(whole(), label)
    if is_line_protocol(beginning):
        return line_protocol(whole(), label)
    if is_markup(beginning):
        return page(whole(), label)
    if beginning.startswith(("{", "[{", "[[", "[ {", "[\n", "[\r")) and (data := parsed(whole(), label)) is not None:
        return table_of(data, label)
    return CsvSource(str(path), label)


def _unpacked(path: Path, most: int) -> bytes:
    """The first bytes of a file, unpacked where it has the ending of a packed file."""
    packing = PACKED.get(path.suffix.lower())
    with pa.OSFile(str(path)) as file:
        stream = pa.CompressedInputStream(file, packing) if packing else file
        data = bytearray()
        while len(data) < most and (more := stream.read(min(most - len(data), 1 << 22))):
            data += more
        return bytes(data)


def _recordings(
    source: Source,
    stem: str,
    loops: Sequence[Loop] | None,
    defaults: Mapping[str, Any] | None,
    only: Collection[str] | None = None,
) -> list[Recording | InputError]:
    """Recordings of a source, or the errors in their place."""
    if source.nameless is not None and not tagged(source) and not _pv_column_given(loops, defaults):
        raise source.nameless
    source = shaped(source, loops or (), defaults or {})
    if is_long(source.names) or any(loop.columns.tag for loop in loops or ()):
        return long_recordings(source, stem, loops, defaults, only)
    source.tell_apart()
    signals = signals_of(source)
    passes = Passes(source)

    def make(loop: Loop, chosen: dict[str, str]) -> Recording:
        return WideRecording(passes, loop, chosen)

    return each_with_columns(signals, loops, defaults, make, only=only, stem=stem, label=source.label)


def _pv_column_given(loops: Sequence[Loop] | None, defaults: Mapping[str, Any] | None) -> bool:
    """Whether the settings name the column of PV."""
    if loops is None:
        return Loop(**{**(defaults or {}), "name": "loop"}).columns.pv is not None
    return any(loop.columns.pv is not None for loop in loops)
