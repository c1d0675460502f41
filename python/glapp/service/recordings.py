"""Signals on disk: Parquet by day and loop, which `glapp analyze` reads as it is.

::

    signals/open/2026-11-23.1795421234567.parquet     all loops of a day that is not over, as they were saved
    signals/2026-11-22/FIC101.parquet                 a loop of a day that is

A file is written beside and then takes its name, and is never changed: it is whole, or it is not there. The number in
the name of an open part is that of the last entry (`glapp.service.store.Entry`) in it. A part is put into the files of
its day when that is over, each file names the last entry in it, and the part goes when all have it: whatever is cut
short is done again, and no row is there twice.
"""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from urllib.parse import quote, unquote

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ..loop import Loop
from ..recording import AT_HIGH, AT_LOW, BAD, NOT_AUTO, Recording
from ..samples import Samples
from ..writing import write_parquet

__all__ = ["SignalStore", "loop_of", "table_of"]

Floats = NDArray[np.float64]

_PART = re.compile(r"(\d{4}-\d\d-\d\d)\.(\d+)\.parquet")
_DAY = re.compile(r"\d{4}-\d\d-\d\d")
_THROUGH = b"glapp.through"
_AT_ONCE = 10
"""Loops of a day that are written to their files at once."""

_FIELDS = pa.schema(
    [
        ("time", pa.timestamp("us", tz="UTC")),
        ("SP", pa.float64()),
        ("PV", pa.float64()),
        ("OP", pa.float64()),
        ("MODE", pa.string()),
        ("QUALITY", pa.string()),
        ("OP_LOW", pa.uint8()),
        ("OP_HIGH", pa.uint8()),
        ("POSITION", pa.float64()),
        ("U_FF", pa.float64()),
    ]
)
_OPEN = pa.schema([("loop", pa.string()), *_FIELDS])


class SignalStore:
    """The recordings of a data folder.

    - `folder`: the data folder; they are in `folder/signals`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "signals"
        self._saved: dict[date, int] = {}

    def save(self, samples: Mapping[str, tuple[NDArray[np.int64], Floats]], through: int) -> None:
        """Write the samples that came up to an entry, a part a day.

        What a file of its day has already is left out: after a kill samples are made once more.

        - `samples`: of each loop the numbers of the entries that made its samples, and the samples, a row of `Sample`
          each.
        - `through`: the last entry.

        Raises OSError where it cannot be written; it can be done once more with the same samples.
        """
        by_day: dict[date, list[pa.Table]] = {}
        for name, (made_by, rows) in samples.items():
            for day, which in _by_day(rows):
                fresh = which & (made_by > self._through(day))
                if fresh.any():
                    table = table_of(rows[fresh])
                    column = pa.array([name], pa.string()).take(pa.array(np.zeros(len(table), np.int64)))
                    by_day.setdefault(day, []).append(table.add_column(0, _OPEN.field("loop"), column))
        for day, tables in by_day.items():
            write_parquet(self.folder / "open" / f"{day}.{through}.parquet", tables, _OPEN)
            self._saved[day] = through

    def _through(self, day: date) -> int:
        """Number of the last entry of which all samples of a day are written; -1 without one."""
        if day not in self._saved:
            files = (self.folder / str(day)).glob("*.parquet")
            open_parts = (through for of, through, _ in self._parts() if of == day)
            self._saved[day] = max((*(_through(path) for path in files), *open_parts), default=-1)
        return self._saved[day]

    def close_days(self, now: float) -> list[date]:
        """Put the parts of days that are over into the files of their loops; gives those days.

        Raises OSError where it cannot be written; it is done anew the next time.
        """
        today = datetime.fromtimestamp(now, UTC).date()
        over: dict[date, list[tuple[int, Path]]] = {}
        for day, through, path in self._parts():
            if day < today:
                over.setdefault(day, []).append((through, path))
        for day, parts in over.items():
            parts.sort()
            self._close(day, parts)
            for _, path in parts:
                path.unlink()
        return sorted(over)

    def _close(self, day: date, parts: Sequence[tuple[int, Path]]) -> None:
        """Join the parts of a day into one file for each loop."""
        names: set[str] = set()
        for _, path in parts:
            names.update(pc.unique(pq.read_table(path, columns=["loop"])["loop"]).to_pylist())
        ordered = sorted(names)
        for at in range(0, len(ordered), _AT_ONCE):  # a day of a thousand loops does not fit into memory
            here = ordered[at : at + _AT_ONCE]
            tables = [(through, pq.read_table(path, filters=pc.field("loop").isin(here))) for through, path in parts]
            for name in here:
                self._add(self._path(day, name), name, tables)

    def _add(self, path: Path, name: str, tables: Sequence[tuple[int, pa.Table]]) -> None:
        """Put a loop's rows of the parts into its file, but for those that it has."""
        done, pieces = -1, []
        if path.exists():
            done = _through(path)
            pieces.append(pq.read_table(path).cast(_FIELDS))
        for through, table in tables:
            if through > done:
                pieces.append(table.filter(pc.equal(table["loop"], name)).drop_columns(["loop"]).cast(_FIELDS))
        if len(pieces) > (done >= 0):
            schema = _FIELDS.with_metadata({_THROUGH: str(tables[-1][0]).encode()})
            write_parquet(path, [pa.concat_tables(pieces)], schema)

    def forget(self, days: int) -> list[str]:
        """Take out the days before the newest `days` of those that are recorded; gives which.

        No clock decides: one that is years ahead for an hour, as of a computer whose battery is flat, would take all.
        """
        closed = sorted(one for one in self.folder.glob("*") if one.is_dir() and _DAY.fullmatch(one.name))
        gone = closed[: max(0, len(closed) - days)]
        for one in gone:
            shutil.rmtree(one)
        return [one.name for one in gone]

    def days(self, loop: str) -> list[date]:
        """The days of which there is something, in their order."""
        closed = [
            date.fromisoformat(path.parent.name)
            for path in self.folder.glob(f"*/{_file(loop)}")
            if _DAY.fullmatch(path.parent.name)
        ]
        return sorted({*closed, *(day for day, _, _ in self._parts())})

    def read(self, loop: str, begin: float, end: float) -> pa.Table:
        """The samples of a loop within [begin, end] [s since 1970 UTC], in the order in which they were taken in.

        Returns: time, SP, PV, OP, MODE, QUALITY, OP_LOW, OP_HIGH, POSITION, U_FF.
        """
        if not begin <= end:
            return _FIELDS.empty_table()
        first, last = (pa.scalar(_clipped(at), pa.int64()).cast(_FIELDS.field("time").type) for at in (begin, end))
        within = (pc.field("time") >= first) & (pc.field("time") <= last)
        days = [datetime.fromtimestamp(_clipped(at) / 1e6, UTC).date() for at in (begin, end)]
        for _ in range(3):  # a part may be put into its day meanwhile
            try:
                return self._read(loop, within, days[0], days[1])
            except FileNotFoundError:
                continue
        return self._read(loop, within, days[0], days[1])

    def _read(self, loop: str, within: pc.Expression, first: date, last: date) -> pa.Table:
        """Rows of a loop between two days."""
        through: dict[date, int] = {}
        pieces = []
        for day in self.days(loop):
            path = self._path(day, loop)
            if not first <= day <= last:
                continue
            if path.exists():
                through[day] = _through(path)
                pieces.append(pq.read_table(path, filters=within).cast(_FIELDS))
            for of, number, part in sorted(self._parts()):
                if of == day and number > through.get(day, -1):
                    table = pq.read_table(part, filters=within & (pc.field("loop") == loop))
                    pieces.append(table.drop_columns(["loop"]).cast(_FIELDS))
        return pa.concat_tables(pieces).replace_schema_metadata() if pieces else _FIELDS.empty_table()

    def recordings(self, loop: Loop, begin: float, end: float) -> list[Recording]:
        """Recordings for `glapp.fit`, a day each; anew where the source's clock was set back.

        - `loop`: settings that go with them.
        - `begin`, `end`: from when to when [s since 1970 UTC].

        Returns: In the order of time; stretches of fewer than two samples, or without a number in PV, are left out.
        """
        table = self.read(loop.name, begin, end)
        if not len(table):
            return []
        micros = table["time"].cast(pa.int64()).to_numpy()
        signals = {name.lower(): table[name].to_numpy() for name in ("SP", "PV", "OP", "POSITION")}
        flags = _flags(table)
        day = micros // 86_400_000_000
        cuts = np.flatnonzero((np.diff(micros) <= 0) | (np.diff(day) != 0)) + 1
        found: list[Recording] = []
        for a, b in zip([0, *cuts.tolist()], [*cuts.tolist(), len(micros)], strict=True):
            if b - a < 2 or not np.isfinite(signals["pv"][a:b]).any():
                continue
            here = {name: x[a:b] for name, x in signals.items() if name == "pv" or np.isfinite(x[a:b]).any()}
            one = Samples(loop, {"t": micros[a:b].astype("datetime64[us]"), **here, "flags": flags[a:b]})
            one.source = f"{loop.name} of {datetime.fromtimestamp(micros[a] / 1e6, UTC):%Y-%m-%d %H:%M}"
            if one.t0 is not None:
                one.t0, one.zone = one.t0.replace(tzinfo=UTC), "UTC"
            found.append(one)
        return found

    def _path(self, day: date, loop: str) -> Path:
        return self.folder / str(day) / _file(loop)

    def _parts(self) -> Iterator[tuple[date, int, Path]]:
        """Open parts with their days and numbers."""
        for path in (self.folder / "open").glob("*.parquet"):
            if found := _PART.fullmatch(path.name):
                yield date.fromisoformat(found[1]), int(found[2]), path


def _file(loop: str) -> str:
    """A file's name of a loop's, whatever characters that has."""
    name = quote(loop, safe=" ()+,@=#")
    return f"{name.replace('.', '%2E') if loop.startswith('.') else name}.parquet"


def loop_of(file: str) -> str:
    """The loop of a file's name.

    Examples
    --------
    >>> loop_of(_file("FIC 101/A")), _file("FIC 101/A")
    ('FIC 101/A', 'FIC 101%2FA.parquet')
    """
    return unquote(file.removesuffix(".parquet"))


def _clipped(seconds: float) -> int:
    """Microseconds since 1970, within the years that a date can be of."""
    return int(min(max(seconds, -6.2e10), 2.5e11) * 1e6) if not math.isnan(seconds) else 0


def _through(path: Path) -> int:
    """Number of the last journal entry whose samples the file of a day contains; -1 where it has none."""
    return int((pq.read_schema(path).metadata or {}).get(_THROUGH, b"-1"))


def table_of(columns: Floats) -> pa.Table:
    """Samples as a table; `columns` has a row a sample, with what a `Sample` has."""
    flags = columns[:, 4].astype(np.uint8)
    names = pa.array(["AUTO", "MAN", "good", "bad"])
    return pa.table(
        [
            pa.array(np.round(columns[:, 0] * 1e6).astype(np.int64)).cast(_FIELDS.field("time").type),
            *(pa.array(columns[:, i], from_pandas=True) for i in (1, 2, 3)),
            names.take(pa.array((flags & NOT_AUTO != 0).astype(np.int64))),
            names.take(pa.array(2 + (flags & BAD != 0).astype(np.int64))),
            *(pa.array((flags & flag != 0).astype(np.uint8)) for flag in (AT_LOW, AT_HIGH)),
            *(pa.array(columns[:, i], from_pandas=True) for i in (5, 6)),
        ],
        schema=_FIELDS,
    )


def _by_day(columns: Floats) -> Iterator[tuple[date, NDArray[np.bool_]]]:
    """Each day (UTC) that has samples, with a mask of its rows."""
    days = np.round(columns[:, 0] * 1e6).astype(np.int64) // 86_400_000_000
    for day in np.unique(days).tolist():
        yield date(1970, 1, 1) + timedelta(days=day), days == day


def _flags(table: pa.Table) -> NDArray[np.uint8]:
    """Flags of the rows."""

    def where(column: str, value: object) -> NDArray[np.uint8]:
        found: NDArray[np.uint8] = pc.equal(table[column], value).to_numpy().astype(np.uint8)
        return found

    return (
        where("MODE", "MAN") * NOT_AUTO
        + where("QUALITY", "bad") * BAD
        + where("OP_LOW", 1) * AT_LOW
        + where("OP_HIGH", 1) * AT_HIGH
    ).astype(np.uint8)
