"""A lake: Parquet files as historians and platforms write them, and the rows of one day of some loops in them.

A file is *long* (a row per tag and time: tag, time, value, and quality and unit where there are) or *wide* (a column
per signal, of one loop or of several). Names of folders such as `day=2026-03-01` or `tag=FIC101.PV` are columns, as
everywhere where Hive's convention is known; names that begin with `_` or `.` are not looked at. Files may overlap, and
their rows may be in any order: results depend on the rows alone.

Every file is looked at once (`index_file`): its columns, and of each million rows the first and the last moment and
the tags. So only what a question can touch is read, a million rows at a time, however large the file's own groups of
rows are.

A folder with a `_delta_log` is a Delta table: of its files only those are read that its log names.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from itertools import accumulate, groupby
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ..checked import nearest
from ..errors import InputError
from ..loop import Loop
from ..reading.cells import CellFault, is_text, plain, words
from ..reading.columns import LABELS, SignalColumns, choose
from ..reading.meaning import SURE, is_long, understand
from ..reading.names import folded
from ..reading.rows import Reader
from ..reading.times import Clock
from ..reading.values import Digits, Quality, digits_of, flags_of, text_of, words_for_bad
from .problems import DataIssue
from .settings import NAMES

__all__ = [
    "DAY",
    "SIGNALS",
    "File",
    "Group",
    "Places",
    "day_name",
    "files_of",
    "index_file",
    "loop_of_path",
    "places",
    "rows_of",
]

SIGNALS = ("pv", "sp", "op", "mode", "op_low_flag", "op_high_flag", "position")
"""Names of the signals by their numbers in the column `signal`."""

ROWS = pa.schema([("signal", pa.int8()), ("t", pa.int64()), ("value", pa.float64()), ("bad", pa.bool_())])
"""Rows of a loop, whatever file they came from.

The place of the signal in `SIGNALS`, microseconds since 1970 UTC, the value (NaN where missing; of a mode 1 where it is
automatic and 0 where it is not, of a limit flag 1 where it is at the limit), whether it is of bad quality."""

DAY = 86_400_000_000
"""[µs]."""

BATCH = 1 << 20
"""Rows that are decoded at once."""

_WORDS = ("mode", "op_low_flag", "op_high_flag")
_UNITS = {"unit", "units", "uom", "eu", "engunit", "engunits", "engineeringunit", "engineeringunits"}
_HEAD = 1000
"""First rows of a file, which show the notation of its numbers."""
_MOST_WORDS = 1000
"""Different words of quality in a file that are looked at."""
_YEARS = tuple(int(datetime(year, 1, 1, tzinfo=UTC).timestamp()) * 1_000_000 for year in (1971, 2101))
"""Range of times that a sample may have [µs since 1970]."""


@dataclass(frozen=True, slots=True)
class Group:
    """Rows of a file that are decoded at once: a group of its rows, or a part of a larger one.

    - `of`: the group of the file's own.
    - `rows`: how many.
    - `first`, `last`: first and last moment [µs since 1970 UTC]; the last before the first where they cannot be read.
    - `tags`: tags of a long file.
    """

    of: int
    rows: int
    first: int = 0
    last: int = -1
    tags: tuple[str, ...] = ()

    @property
    def readable(self) -> bool:
        """Whether its times could be read."""
        return self.last >= self.first


@dataclass(frozen=True, slots=True)
class File:
    """Facts on a file after a look at it.

    - `name`: relative to the lake, with `/`.
    - `size`, `mtime_ns`: by which a changed file is recognised [B, ns].
    - `long`: whether it has a row per tag and time.
    - `stem`: name of its loop where a wide file's columns have no prefix, see `_stem`.
    - `columns`: its columns, those of its folders included.
    - `folders`: columns that its folders name.
    - `groups`: its groups of rows, in their order.
    - `qualities`: the words of its quality column.
    - `digits`: how its texts write numbers.
    - `zone`: zone of its times where they have none of their own.
    """

    name: str
    size: int
    mtime_ns: int
    long: bool
    stem: str
    columns: tuple[str, ...]
    folders: Mapping[str, str]
    groups: tuple[Group, ...]
    qualities: tuple[str, ...]
    digits: Digits
    zone: str | None

    @classmethod
    def of(cls, known: Mapping[str, Any]) -> File:
        """A file from plain types."""
        groups = tuple(Group(**{**group, "tags": tuple(group["tags"])}) for group in known["groups"])
        lists = {name: tuple(known[name]) for name in ("columns", "qualities")}
        return cls(**{**known, **lists, "groups": groups, "digits": Digits(**known["digits"])})

    def column(self, role: str) -> str | None:
        """The file's column of this role: time, tag, value or quality."""
        having = [name for name in self.columns if understand(name).role == role]
        return next((name for name in having if folded(name) == SURE.get(role)), next(iter(having), None))

    @property
    def unit_column(self) -> str | None:
        """The column of units of a long file."""
        if not self.long:
            return None
        return next((c for c in self.columns if "".join(filter(str.isalnum, c.lower())) in _UNITS), None)

    @property
    def tags(self) -> set[str]:
        """All tags of a long file."""
        return {tag for group in self.groups for tag in group.tags}


def day_name(day: int) -> str:
    """A day by its number since 1970, as in ISO 8601.

    Examples
    --------
    >>> day_name(0)
    '1970-01-01'
    """
    return date.fromordinal(719163 + day).isoformat()


def files_of(lake: Path) -> tuple[list[str], list[DataIssue]]:
    """The Parquet files of a lake, by name; folders and files that begin with `_` or `.` are left out.

    Of a Delta table only the files that its log names are taken.

    Raises InputError where there is no such folder, or no Parquet file in it.
    """
    if not lake.is_dir():
        what = "is no folder" if lake.exists() else "is not there"
        raise InputError(what, file=str(lake), hint="name the folder of a lake of Parquet files")
    found, problems = _walked(lake)
    for log in sorted(lake.rglob("_delta_log")):
        table = "/".join(log.relative_to(lake).parts[:-1])
        files, wrong = _delta_files(lake, table)
        problems += wrong
        if files is not None:
            inside = {name for name in found if not table or name.startswith(f"{table}/")}
            found = (found - inside) | (inside & files)
            problems += [
                DataIssue("unreadable", "is named by the table's log and is not there", _COPY, file=name)
                for name in sorted(files - inside)
            ]
    if not found:
        what, hint = "holds no .parquet file", "glapp fleet make-demo writes a lake to try"
        if (other := next((one for one in problems if one.code == "not_read"), None)) is not None:
            what, hint = f"{what}, and {other.what}", other.todo
        raise InputError(what, file=str(lake), hint=hint)
    return sorted(found), problems


_COPY = "copy it again from its source"


def _walked(lake: Path) -> tuple[set[str], list[DataIssue]]:
    """The Parquet files below a folder, and what there is that is not read."""
    found: set[str] = set()
    problems: list[DataIssue] = []
    others: dict[str, list[str]] = {}

    def unread(error: OSError) -> None:
        name = Path(error.filename).relative_to(lake).as_posix()
        what = f"is a folder that cannot be read: {error.strerror}"
        problems.append(DataIssue("folder", what, "give the reader the right to it", file=name))

    for where, folders, files in os.walk(lake, onerror=unread):
        at = Path(where)
        folders[:] = sorted(name for name in folders if not name.startswith(("_", ".")))
        for name in folders:
            if (at / name).is_symlink():
                what = "is a link to a folder, and is not followed"
                place = (at / name).relative_to(lake).as_posix()
                problems.append(DataIssue("folder", what, "put the files themselves into the lake", file=place))
        for name in sorted(files):
            place = (at / name).relative_to(lake).as_posix()
            if name.startswith(("_", ".")) or (at == lake and name in NAMES):
                continue
            if not name.lower().endswith(".parquet"):
                others.setdefault(Path(name).suffix, []).append(place)
            elif (at / name).exists():
                found.add(place)
            else:
                problems.append(DataIssue("unreadable", "is a link to nowhere", _COPY, file=place))
    for ending, names in others.items():
        count = f"{len(names)} {'files' if len(names) > 1 else 'file'}"
        what = f"{count} with the ending {ending or '(none)'}, which is not read"
        todo = "convert what has signals to Parquet, or leave it; glapp analyze reads CSV, Excel and packed text"
        problems.append(DataIssue("not_read", what, todo, file=names[0]))
    return found, problems


def _delta_files(lake: Path, table: str) -> tuple[set[str] | None, list[DataIssue]]:
    """Data files of the newest version of a Delta table, relative to the lake; None without the package deltalake."""
    place = f"{table}/_delta_log" if table else "_delta_log"
    try:
        from deltalake import DeltaTable
    except ImportError:
        what = "is a Delta table, and deltalake is not installed: all its files are read, also those that it took out"
        return None, [DataIssue("delta", what, "pip install 'glapp[delta]', or vacuum the table first", file=place)]
    try:
        known = DeltaTable(lake / table)
        more = set(known.protocol().reader_features or ()) & {"deletionVectors", "columnMapping"}
        if more:
            what = f"is a Delta table with {' and '.join(sorted(more))}, which its files alone do not show: left out"
            todo = "purge its deletion vectors, or write it again without column mapping"
            return set(), [DataIssue("unreadable", what, todo, file=place)]
        root = (lake / table).resolve()
        paths = [Path(unquote(urlsplit(uri).path) if "://" in uri else uri) for uri in known.file_uris()]
        inside = [path.resolve().relative_to(root).as_posix() for path in paths]
    except Exception as error:  # the library has kinds of its own for a damaged log
        what = f"is a Delta table whose log cannot be read, and is left out: {_line(error)}"
        return set(), [DataIssue("unreadable", what, "copy the table again from its source", file=place)]
    return {f"{table}/{name}" if table else name for name in inside}, []


def index_file(lake: Path, name: str, zone: str | None) -> tuple[File | None, list[DataIssue]]:
    """Look at a file: its columns, and of each group of rows its time and tags. None where it cannot be used at all."""
    path = lake / name
    try:
        state = path.stat()
        with pq.ParquetFile(path) as file:
            columns = [str(field.name) for field in file.schema_arrow if str(field.type)]
            rows = [file.metadata.row_group(i).num_rows for i in range(file.metadata.num_row_groups)]
    except Exception as error:  # the library has no one kind for a damaged file
        what = f"is not a readable Parquet file: {_line(error)}"
        return None, [DataIssue("unreadable", what, _COPY, file=name)]
    folders = _folders(name)
    every = (*columns, *(key for key in folders if key not in columns))
    long = is_long(every)
    stem = folders.get("loop") or _stem(name)
    bare = File(name, state.st_size, state.st_mtime_ns, long, stem, every, folders, (), (), Digits(), zone)
    what = f"its columns are {', '.join(every[:12]) or 'none'}"
    if bare.column("time") is None:
        what += "; no time is among them"
        return None, [DataIssue("schema", what, "call its column of times time; or leave the file out", file=name)]
    if not long and not any(understand(column).role in SIGNALS for column in every):
        return None, [_no_signals(bare)]
    if not sum(rows):
        return None, [DataIssue("empty", "has no rows", "nothing, where nothing was recorded", file=name)]
    problems: list[DataIssue] = []
    groups: list[Group] = []
    qualities: dict[str, None] = {}
    without: Counter[str] = Counter()
    for i, n in enumerate(rows):
        done = 0
        try:
            for group, seen, fault, lacking in _inspected_parts(bare, path, i):
                groups.append(group)
                qualities.update(dict.fromkeys(seen[:_MOST_WORDS]))
                without.update(lacking)
                if fault is not None:
                    what = f"its times cannot be read: {fault.what}"
                    row = sum(rows[:i]) + done + 1
                    todo = fault.hint or "write them as timestamps"
                    problems.append(DataIssue("time", what, todo, name, row, rows=group.rows))
                done += group.rows
        except Exception as error:
            groups.append(Group(i, n - done))
            problems.append(_damaged(name, i, sum(rows[:i]) + done, n - done, error))
    for code, what in _LACKING.items():
        if n := without[code]:
            problems.append(DataIssue(code, f"{n} rows have no {what}: they are left out", _REPAIR, name, rows=n))
    if not any(group.readable for group in groups):  # its columns may still show which loops are lost
        return replace(bare, groups=tuple(groups)), problems
    if zone is None and _naive(path, bare):
        what = "its times have no zone, and are taken for UTC"
        problems.append(DataIssue("no_zone", what, "name it: --time-zone, or time_zone in [defaults]", file=name))
    try:
        digits = _digits(path, bare)
    except InputError as error:
        digits = Digits("")
        problems.append(DataIssue("value", error.what, error.hint or "write all numbers alike", file=name))
    return replace(bare, groups=tuple(groups), qualities=tuple(qualities)[:_MOST_WORDS], digits=digits), problems


def _no_signals(file: File) -> DataIssue:
    """Data issue of a wide file of no loop."""
    what = f"its columns are {', '.join(file.columns[:12])}; neither tag and value nor a PV with SP or OP is among them"
    todo = (
        "call its columns tag, time and value, or time, PV, SP and OP of a loop, whose files may be several in its "
        "folder; or leave the file out"
    )
    return DataIssue("schema", what, todo, file=file.name)


def _damaged(name: str, group: int, done: int, rows: int, error: Exception) -> DataIssue:
    """Data issue of a group of rows that cannot be read."""
    what = f"row group {group} is damaged, {rows} rows are left out: {_line(error)}"
    return DataIssue("damaged", what, "copy the file again from its source", name, done + 1, rows=rows)


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def _folders(name: str) -> dict[str, str]:
    """Folders `key=value` of a path."""
    pairs = (part.partition("=") for part in name.split("/")[:-1] if "=" in part)
    return {key: unquote(value) for key, _, value in pairs if value != "__HIVE_DEFAULT_PARTITION__"}


_MOMENT = re.compile(
    r"(?<!\d)(?:19|20)\d\d(?P<mark>[-_.]?)(?:0[1-9]|1[0-2])(?P=mark)(?:0[1-9]|[12]\d|3[01])"
    r"(?:[-_. T]?\d\d(?:[-_.:]?\d\d){0,2}[hZ]?)?(?!\d)"
)
"""A date in a file's name, and a time or an hour behind it."""
_PIECE = re.compile(r"(?:part|chunk|export|data|file)?[-_. \d]*|part-\d.*", re.IGNORECASE)
"""Names of parts of a table, which name no loop: 17, part-0, part-00000-3f1c-c000.snappy."""


def _stem(name: str) -> str:
    """Name of the loop that the path of a wide file shows: the file's own without a date, else that of its folder.

    A file that is called by a date, a number, or by its signals alone has the loop's name from its folder.

    Examples
    --------
    >>> _stem("FIC101.parquet"), _stem("north/FIC101_2026-03-01.parquet"), _stem("FIC101/2026/03/day=1/part-0.parquet")
    ('FIC101', 'FIC101', 'FIC101')
    >>> _stem("FIC101/2026-03-01_op.parquet"), _stem("FIC101_2026-03-01_18.parquet")
    ('FIC101', 'FIC101')
    >>> _stem("2026-03-01.parquet")
    '2026-03-01'
    """
    path = PurePosixPath(name)
    for part in (path.stem, *reversed(path.parts[:-1])):
        bare = _MOMENT.sub("", part).strip("-_. ")
        if "=" not in part and not _PIECE.fullmatch(bare) and understand(bare).role is None:
            return bare
    return path.stem


_LACKING = {"no_time": "time between 1971 and 2100", "no_tag": "tag"}
_REPAIR = "export them again with it"


def _inspected_parts(
    file: File, path: Path, i: int
) -> Iterator[tuple[Group, list[str], CellFault | None, dict[str, int]]]:
    """Time and tags of a group of rows, part by part, and the words of its quality.

    With them what is wrong with its times, and how many rows have no time or no tag.
    """
    time, tag, quality = file.column("time"), file.column("tag"), file.column("quality")
    wanted = [c for c in (time, tag if file.long else None, quality) if c is not None and c not in file.folders]
    assert time is not None
    for table in _batches(path, i, wanted, [c for c in wanted if c in (tag, quality)]):
        seen = sorted(map(text_of, _distinct(table.column(quality)))) if quality in wanted else []
        try:
            t, good, doubtful = _micros(table.column(time), file)
            t = t[good]
            if not len(t):
                raise CellFault(0, "no row has a time")
        except CellFault as fault:
            yield Group(i, len(table)), seen, fault, {}
            continue
        lacking = {"no_time": len(table) - len(t) - doubtful}
        tags: tuple[str, ...] = ()
        if file.long and tag is not None and tag in file.folders:
            tags = (file.folders[str(tag)],)
        elif file.long:
            tags = tuple(sorted(_distinct(table.column(str(tag)))))
            lacking["no_tag"] = int(plain(table.column(str(tag))).null_count)
        yield Group(i, len(table), int(t.min()), int(t.max()), tags), seen, None, lacking


def _batches(
    path: Path, group: int, columns: Sequence[str], dictionary: Sequence[str] = ()
) -> Iterator[pa.RecordBatch]:
    """A group of rows, `BATCH` rows at a time, each column checked against its stated length."""
    with pq.ParquetFile(path, read_dictionary=list(dictionary), buffer_size=1 << 20) as parquet:
        for batch in parquet.iter_batches(BATCH, row_groups=[group], columns=list(columns), use_threads=False):
            batch.validate(full=True)
            yield batch


def _digits(path: Path, file: File) -> Digits:
    """Decimal and thousands separators of the numbers that a file stores as text, found in its first rows.

    Raises InputError where some have a decimal comma and others a decimal point.
    """
    others = {file.column(role) for role in ("time", "tag", "quality")}
    with pq.ParquetFile(path) as parquet:
        texts = [f.name for f in parquet.schema_arrow if _has_text(f.type) and f.name not in others]
        if not texts:
            return Digits()
        batch = next(parquet.iter_batches(_HEAD, columns=texts), None)
    cells = [] if batch is None else [cell for column in batch.columns for cell in plain(column).to_pylist()]
    return digits_of([cell.strip() for cell in cells if cell], file.name)


def _has_text(kind: pa.DataType) -> bool:
    return is_text(kind.value_type if pa.types.is_dictionary(kind) else kind)


def _distinct(column: pa.Array) -> list[str]:
    """Different texts of a column."""
    return [str(value) for value in pc.unique(words(column)).to_pylist() if value is not None]


def _naive(path: Path, file: File) -> bool:
    """Whether the file's times are without a zone."""
    kind = pq.read_schema(path).field(str(file.column("time"))).type
    return bool(pa.types.is_timestamp(kind) and kind.tz is None)


def _micros(column: pa.Array, file: File) -> tuple[NDArray[np.int64], NDArray[np.bool_], int]:
    """Microseconds since 1970 UTC, which of them are a time, and how many the clocks' change makes doubtful.

    These are in an hour that comes twice, or not at all.
    """
    column = plain(column)
    kind = column.type
    if pa.types.is_timestamp(kind) and (kind.tz is not None or file.zone is None):
        ticks = column.cast(pa.timestamp("us", kind.tz), safe=False)
        return _valid_times(ticks, 0)
    if pa.types.is_timestamp(kind):
        ticks = column.cast(pa.timestamp("us"), safe=False)
        early, late = (
            pc.assume_timezone(ticks, file.zone, ambiguous=end, nonexistent=end) for end in ("earliest", "latest")
        )
        plainly = pc.equal(early, late)
        doubtful = len(column) - column.null_count - (pc.sum(plainly).as_py() or 0)
        return _valid_times(pc.if_else(plainly, early, None), doubtful)
    clock = Clock(column.slice(0, 1000), None, None, file.zone)
    if clock.t0 is None:
        raise CellFault(0, "they are plain numbers, and no date")
    start = clock.t0 if clock.t0.tzinfo is not None else clock.t0.replace(tzinfo=UTC)
    seconds = clock.reader()(column)
    good = np.isfinite(seconds)
    begin = round(start.timestamp() * 1e6)
    return begin + np.rint(np.where(good, seconds, 0.0) * 1e6).astype(np.int64), good, 0


def _valid_times(ticks: pa.Array, doubtful: int) -> tuple[NDArray[np.int64], NDArray[np.bool_], int]:
    """Times, which of them are valid, and the number of doubtful ones."""
    t: NDArray[np.int64] = ticks.cast(pa.int64()).fill_null(0).to_numpy(zero_copy_only=False)
    good: NDArray[np.bool_] = ticks.is_valid().to_numpy(zero_copy_only=False)
    return t, good & (t > _YEARS[0]) & (t < _YEARS[1]), doubtful


@dataclass(frozen=True, slots=True)
class Places:
    """Places of the loops' signals.

    - `loops`: the loops that have a PV and an SP or OP somewhere, by name.
    - `long`: tag to (place of its loop in `loops`, place of its signal in `SIGNALS`).
    - `wide`: file name to the same of its columns.
    """

    loops: tuple[Loop, ...]
    long: Mapping[str, tuple[int, int]]
    wide: Mapping[str, Mapping[str, tuple[int, int]]]

    def of(self, file: File) -> Mapping[str, tuple[int, int]]:
        """Tags or columns of a file that are signals of loops."""
        return self.long if file.long else self.wide.get(file.name, {})


def _digits_in(name: str) -> str:
    return "".join(filter(str.isdigit, name))


_PASSED_OVER = {
    "sp": (
        "PV and OP and no SP: it is taken for no loop, because others have SP",
        "name it in the settings where it is one",
    ),
    "pv": (
        "SP and OP and no PV: it cannot be judged",
        "put its PV into the lake, or name the tag of its PV in the settings: columns.pv",
    ),
}


def places(
    files: Sequence[File], given: Sequence[Loop] | None, defaults: Mapping[str, Any]
) -> tuple[Places, list[DataIssue]]:
    """Signal and loop of each tag and column; without settings, the loops that the names show."""
    spellings: dict[str, list[str]] = {}  # historians do not tell fic101.pv from FIC101.PV
    for tag in sorted(set().union(*(file.tags for file in files if file.long))):
        spellings.setdefault(tag.lower(), []).append(tag)
    tags = SignalColumns([first for first, *_ in spellings.values()])
    assignment = _Assignment(given, defaults)
    found = assignment.of_tags(tags)
    columns, shown = assignment.of_columns([file for file in files if not file.long])
    assignment.report_passed_over([(tags, "", ""), *shown])
    having = sorted(set(found) | {name for file in columns.values() for name in file})
    if given is not None:
        assignment.report_unnamed(tags, found)
        assignment.report_without_tags(having)
    place = {name: i for i, name in enumerate(having)}

    def numbered(chosen: Mapping[str, Mapping[str, str]]) -> dict[str, tuple[int, int]]:
        return {
            name: (place[loop], SIGNALS.index(role)) for loop, roles in chosen.items() for role, name in roles.items()
        }

    wide = {file: numbered(chosen) for file, chosen in columns.items()}
    long = {tag: at for name, at in numbered(found).items() for tag in spellings[name.lower()]}
    return Places(tuple(assignment.loops[name] for name in having), long, wide), assignment.problems


class _Assignment:
    """Assigns the tags and columns of a lake to its loops.

    - `given`: the loops of the settings; None for those that the names show.
    - `defaults`: settings of these.

    - `loops`: name to loop, those of the settings and those that were found.
    - `problems`: data issues so far.
    """

    def __init__(self, given: Sequence[Loop] | None, defaults: Mapping[str, Any]) -> None:
        self.loops = {loop.name: loop for loop in given or ()}
        self.problems: list[DataIssue] = []
        self._given = None if given is None else dict(self.loops)
        self._defaults = defaults
        self._settings = {name.lower(): name for name in self.loops}

    def _shown(self, name: str) -> Loop:
        """A loop that the names show."""
        return Loop(**{**self._defaults, "name": name})

    def _choose(
        self, signals: SignalColumns, loop: Loop, group: str | None, label: str, *, long: bool
    ) -> dict[str, str] | None:
        """Role to tag or column of a loop; None where two fit one role, or one that is named is not there."""
        kind = "tag" if long else "column"
        try:
            chosen = choose(signals, loop, group, label, tags=long, kind=kind)
            return {role: name for role, name in chosen.items() if role in SIGNALS}
        except InputError as error:  # its hint names options of glapp analyze
            todo = f"name its {kind}s in the settings: columns.pv, columns.sp, columns.op"
            self.problems.append(DataIssue("loop_tags", error.what, todo, file="" if long else label, loop=loop.name))
            return None

    def of_tags(self, tags: SignalColumns) -> dict[str, dict[str, str]]:
        """Loop to role to tag."""
        found: dict[str, dict[str, str]] = {}
        if not tags.names:
            return found
        names = {name: self._shown(name) for name in tags.groups} if self._given is None else self._given
        for name, loop in names.items():
            # A lone loop in a lake is no reason to take its tags for those of a loop of another name.
            group = tags.own_group(loop)
            own = any(getattr(loop.columns, role) for role in ("pv", "sp", "op"))
            if (group is not None or own) and (chosen := self._choose(tags, loop, group, "the lake", long=True)):
                self.loops.setdefault(name, loop)
                found[name] = chosen
        return found

    def of_columns(
        self, files: Sequence[File]
    ) -> tuple[dict[str, dict[str, dict[str, str]]], list[tuple[SignalColumns, str, str]]]:
        """File to loop to role to column; and the columns of each file that has signals, with its name and stem."""
        found: dict[str, dict[str, dict[str, str]]] = {}
        shown: list[tuple[SignalColumns, str, str]] = []
        beside: dict[str, dict[str, None]] = {}  # stem to the columns of all its files
        for file in files:
            beside.setdefault(file.stem, {}).update(dict.fromkeys(file.columns))
        for file in files:
            signals = SignalColumns(file.columns)
            if not signals.groups:  # what it lacks may be in another file of its loop
                signals = SignalColumns(beside[file.stem], file.column("time"))
            if not signals.groups and not signals.passed_over:
                self.problems.append(_no_signals(file))
                continue
            shown.append((signals, file.name, file.stem))
            for name, group in self._loops_of(signals, file.stem).items():
                if (loop := self._named(name, file)) is None:
                    continue
                if chosen := self._choose(signals, loop, group, file.name, long=False):
                    mine = {role: column for role, column in chosen.items() if column in file.columns}
                    found.setdefault(file.name, {})[loop.name] = mine
        return found, shown

    def _loops_of(self, signals: SignalColumns, stem: str) -> dict[str, str]:
        """Name of each loop of a wide file, as it is written there, to its prefix."""
        named = {} if self._given is None else {n: n for n in signals.passed_over if n.lower() in self._settings}
        return (signals.loops(stem) if signals.groups else {}) | named

    def _named(self, written: str, file: File) -> Loop | None:
        """The loop of this name; None, with a data issue, where the settings do not name it."""
        name = written if written in self.loops else self._settings.get(written.lower(), written)
        if self._given is None:
            return self.loops.setdefault(name, self._shown(name))
        if name not in self.loops:
            what = f"has signals of {name}, which no settings name"
            self.problems.append(
                DataIssue("no_settings", what, "add the loop to the settings", file=file.name, loop=name)
            )
        return self.loops.get(name)

    def report_passed_over(self, shown: Iterable[tuple[SignalColumns, str, str]]) -> None:
        """Report names with OP that are taken for no loop; `shown` as of `of_columns`."""
        for signals, label, stem in shown:
            for prefix, lacks in sorted(signals.passed_over.items()):
                name = self._settings.get((prefix or stem).lower(), prefix or stem)
                if not prefix or name not in self.loops:
                    what, todo = _PASSED_OVER[lacks]
                    self.problems.append(DataIssue(f"no_{lacks}", f"{name} has {what}", todo, file=label, loop=name))

    def report_unnamed(self, tags: SignalColumns, found: Mapping[str, Mapping[str, str]]) -> None:
        """Report tags of loops that no settings name; `found` as of `of_tags`."""
        used = {tag for roles in found.values() for tag in roles.values()}
        for group in sorted(set(tags.groups) - set(found)):
            pv = set(tags.meant("pv", group))
            if not pv or not pv <= used:
                what = f"the lake holds the tags of {group}, which no settings name"
                self.problems.append(DataIssue("no_settings", what, "add the loop to the settings", loop=group))

    def report_without_tags(self, having: Iterable[str]) -> None:
        """Report loops of the settings of which nothing was found; `having`: those with tags or columns."""
        told = {problem.loop for problem in self.problems if problem.code in ("loop_tags", "no_pv")}
        unnamed: dict[str, dict[str, str]] = {}  # another number is another loop
        for problem in self.problems:
            if problem.code == "no_settings":
                unnamed.setdefault(_digits_in(problem.loop), {})[problem.loop.lower()] = problem.loop
        for name in sorted(set(self._given or ()) - set(having) - told):
            alike = unnamed.get(_digits_in(name), {})
            near = alike.get(nearest(name, alike) or "")
            what = "its settings are there, and none of its tags"
            what += f"; those of {near} are, which no settings name" if near else ""
            todo = "name it as its tags are, or its tags in the settings: columns.pv; or check the export"
            self.problems.append(DataIssue("no_tags", what, todo, loop=name))


def loop_of_path(name: str, files: Iterable[File], known: Places) -> str | None:
    """The loop whose file this was, as far as its path shows it, without reading the file; None where it does not.

    A folder names it, `loop=FIC101` or `tag=FIC101.PV`; or other files in its folder have the names of their loops.
    """
    folders = _folders(name)
    if "loop" in folders:
        return folders["loop"]
    if "tag" in folders:
        return understand(folders["tag"]).loop or None
    folder, loops = PurePosixPath(name).parent, {loop.name for loop in known.loops}
    beside = (file for file in files if not file.long and PurePosixPath(file.name).parent == folder)
    return _stem(name) if any(file.stem in loops for file in beside) else None


@dataclass
class _Part:
    """Rows of some loops: place of the loop and the columns of `ROWS`."""

    loop: NDArray[np.int32]
    signal: NDArray[np.int8]
    t: NDArray[np.int64]
    value: NDArray[np.float64]
    bad: NDArray[np.bool_]


def rows_of(
    lake: Path, files: Iterable[File], known: Places, wanted: range, begin: int, end: int
) -> tuple[dict[int, pa.Table], list[DataIssue]]:
    """The rows of some loops from `begin` to before `end` [µs since 1970 UTC], a table of `ROWS` a loop.

    Damaged parts of a file are left out and reported with their place; the others are read.
    """
    parts: list[_Part] = []
    problems: list[DataIssue] = []
    for file in files:
        for part, wrong in _parts(lake, file, known, wanted, begin, end):
            problems += wrong
            if part is not None and len(part.t):
                parts.append(part)
    if not parts:
        return {}, problems
    loop, *columns = (np.concatenate([getattr(p, name) for p in parts]) for name in ("loop", *ROWS.names))
    parts.clear()
    order = np.argsort(loop, kind="stable")
    cuts = np.flatnonzero(np.diff(loop[order])) + 1
    tables = {}
    for rows in np.split(order, cuts):
        tables[int(loop[rows[0]])] = pa.table([pa.array(column[rows]) for column in columns], schema=ROWS)
    return tables, problems


def touched(file: File, group: Group, known: Places, wanted: range, begin: int, end: int) -> bool:
    """Whether some rows of a file may hold something of these loops within that time."""
    if not group.readable or group.last < begin or group.first >= end:
        return False
    at = known.of(file)
    names = group.tags if file.long else at
    return any(name in at and at[name][0] in wanted for name in names)


@dataclass(frozen=True, slots=True)
class _Asked:
    """Request to a group of rows: the loops, under their tags or columns, and a stretch of time."""

    known: Places
    names: Sequence[str]
    begin: int
    end: int


def _parts(
    lake: Path, file: File, known: Places, wanted: range, begin: int, end: int
) -> Iterator[tuple[_Part | None, list[DataIssue]]]:
    """Rows of a file for these loops and that time, a million at a time, and its data issues."""
    at, done = known.of(file), 0
    for i, several in groupby(file.groups, key=lambda group: group.of):
        groups = list(several)
        ends = list(accumulate(group.rows for group in groups))
        hits = [
            (group, upto)
            for group, upto in zip(groups, ends, strict=True)
            if touched(file, group, known, wanted, begin, end)
        ]
        if hits:
            there = {name for group, _ in hits for name in group.tags} if file.long else set(at)
            names = sorted(name for name in there if name in at and at[name][0] in wanted)
            places = [(upto - group.rows, upto) for group, upto in hits]
            yield from _of_group(lake, file, i, places, ends[-1], done, _Asked(known, names, begin, end))
        done += ends[-1]


def _of_group(
    lake: Path, file: File, i: int, places: Sequence[tuple[int, int]], rows: int, done: int, asked: _Asked
) -> Iterator[tuple[_Part | None, list[DataIssue]]]:
    """The parts and problems of one group of rows; only rows at `places` are wanted."""
    time, tag, value, quality = (file.column(role) for role in ("time", "tag", "value", "quality"))
    columns = [time, quality, *((tag, value, file.unit_column) if file.long else asked.names)]
    stored = list(dict.fromkeys(c for c in columns if c is not None and c not in file.folders))
    coded = [c for c in stored if c in (tag, quality, file.unit_column)]
    read, at = _long if file.long else _wide, 0
    try:
        for table in _batches(lake / file.name, i, stored, coded):
            upto = at + len(table)
            if any(first < upto and last > at for first, last in places):
                problems: list[DataIssue] = []
                try:
                    yield read(table, file, asked, done + at, problems), problems
                except CellFault as fault:
                    todo = fault.hint or "copy the file again from its source"
                    row = done + at + fault.index + 1
                    yield None, [DataIssue("damaged", fault.what, todo, file.name, row, rows=len(table))]
            at = upto
            if at >= places[-1][1]:
                return
    except Exception as error:
        yield None, [_damaged(file.name, i, done + at, rows - at, error)]


def _within(
    table: pa.RecordBatch, file: File, asked: _Asked, done: int, problems: list[DataIssue]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Times of the table's rows, and which of them are asked for."""
    t, good, doubtful = _micros(table.column(str(file.column("time"))), file)
    if doubtful:
        what = f"{doubtful} rows are in the hour in which the clocks of {file.zone} change, and are left out"
        problems.append(DataIssue("clock_change", what, "export with times in UTC", file.name, done + 1, rows=doubtful))
    return t, good & (t >= asked.begin) & (t < asked.end)


def _long(table: pa.RecordBatch, file: File, asked: _Asked, done: int, problems: list[DataIssue]) -> _Part:
    """Rows of a table with a tag in each row."""
    tag, value, quality, unit = file.column("tag"), file.column("value"), file.column("quality"), file.unit_column
    known, names = asked.known, asked.names
    t, keep = _within(table, file, asked, done, problems)
    if tag in file.folders:
        codes = np.zeros(len(t), np.int64)
    else:
        codes = pc.index_in(words(table.column(str(tag))), pa.array(names, pa.string())).fill_null(-1).to_numpy()
    keep = keep & (codes >= 0)
    rows = np.flatnonzero(keep)
    codes, t = codes[rows], t[rows]
    if unit is not None and unit not in file.folders:
        fits = _units(codes, table.column(unit).take(pa.array(rows)), asked, file, done, problems)
        rows, codes, t = rows[fits], codes[fits], t[fits]
    taken = pa.array(rows)
    where = np.array([known.long[name] for name in names], np.int32).reshape(-1, 2)
    loop, signal = where[codes, 0].astype(np.int32), where[codes, 1].astype(np.int8)
    bad = _bad(file, None if quality is None else table.column(quality).take(taken), done, problems, len(rows))
    cells = table.column(str(value)).take(taken)
    values = np.full(len(rows), np.nan)
    order = np.argsort(codes, kind="stable")
    for mine in np.split(order, np.flatnonzero(np.diff(codes[order])) + 1) if len(order) else ():
        name = names[codes[mine[0]]]  # the settings of its loop say what its cells mean
        place, role = known.long[name]
        values[mine] = _values(
            cells.take(pa.array(mine)), SIGNALS[role], known.loops[place], file, name, rows[mine] + done, problems
        )
    return _Part(loop, signal, t, values, bad)


def _wide(table: pa.RecordBatch, file: File, asked: _Asked, done: int, problems: list[DataIssue]) -> _Part:
    """Rows of a table with a column for each signal."""
    quality, known = file.column("quality"), asked.known
    t, keep = _within(table, file, asked, done, problems)
    rows = np.flatnonzero(keep)
    taken = pa.array(rows)
    bad = _bad(file, None if quality is None else table.column(quality).take(taken), done, problems, len(rows))
    parts = []
    for name in asked.names:
        place, signal = known.of(file)[name]
        loop, n = known.loops[place], len(rows)
        unit, wants = understand(name).unit, _unit_of(loop, signal)
        if unit and wants and _alike(unit) != _alike(wants):
            problems.append(_unit_problem(file, name, loop.name, unit, wants, n, done + 1))
            continue
        x = _values(table.column(name).take(taken), SIGNALS[signal], loop, file, name, rows + done, problems)
        parts.append(_Part(np.full(n, place, np.int32), np.full(n, signal, np.int8), t[rows], x, bad))
    if not parts:
        return _Part(*(np.empty(0, kind) for kind in (np.int32, np.int8, np.int64, np.float64, np.bool_)))  # type: ignore[arg-type]
    return _Part(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("loop", *ROWS.names)))


def _values(
    cells: pa.Array, role: str, loop: Loop, file: File, name: str, rows: NDArray[np.int64], problems: list[DataIssue]
) -> NDArray[np.float64]:
    """Cells of a signal as everywhere (`Reader`); a word that is no number is missing, reported once a file and tag."""
    reader = Reader(loop, file.digits)
    flag = role in _WORDS
    missing = 0.0 if flag else np.nan
    for _ in range(_MOST_WORDS):
        try:
            if not flag:
                return reader.number(cells)
            raised: NDArray[np.bool_] = reader.flag(role, cells) != 0  # of a mode: not automatic
            values: NDArray[np.float64] = (raised != (role == "mode")).astype(np.float64)
            return values
        except CellFault as fault:
            if fault.value is None or not len(rows) or not is_text(plain(cells).type):
                row = int(rows[0]) + 1 if len(rows) else None
                todo, n = "export numbers", len(cells)
                problems.append(DataIssue("value", fault.what, todo, file.name, row, name, loop.name, rows=n))
                break
            texts = pc.utf8_trim_whitespace(plain(cells))
            wrong = pc.equal(texts, str(fault.value).strip()).fill_null(False)
            n, todo = pc.sum(wrong).as_py(), fault.hint or "name it in bad_values"
            row = int(rows[fault.index]) + 1
            problems.append(DataIssue("value", fault.what, todo, file.name, row, name, loop.name, rows=n))
            cells = pc.if_else(wrong, pa.scalar("MAN" if role == "mode" else "", pa.string()), texts)
    else:
        what = f"has more than {_MOST_WORDS} different words that are no number: all {len(cells)} rows count as missing"
        row = int(rows[0]) + 1
        problems.append(DataIssue("value", what, "export numbers", file.name, row, name, loop.name, rows=len(cells)))
    return np.full(len(cells), missing)


def _bad(file: File, cells: pa.Array | None, done: int, problems: list[DataIssue], rows: int) -> NDArray[np.bool_]:
    """Whether each row is of bad quality, by the one of three ways that the file uses; an unknown word is bad."""
    if cells is None or not len(cells):
        return np.zeros(rows, np.bool_)
    decide = Quality(file.qualities, words_for_bad(()), file.column("quality") or "")
    unknown: dict[str, None] = {}

    def bit(word: str) -> int:
        try:
            return decide(word)
        except ValueError:
            unknown[word] = None
            return 1

    found: NDArray[np.bool_] = flags_of(cells, bit) != 0
    for word in unknown:
        what = f"the quality {word!r} is not known, its rows count as bad"
        todo = "export qualities as Good and Bad, or as codes of OPC"
        problems.append(DataIssue("quality", what, todo, file.name, done + 1))
    return found


def _units(
    codes: NDArray[np.int64], cells: pa.Array, asked: _Asked, file: File, done: int, problems: list[DataIssue]
) -> NDArray[np.bool_]:
    """Whether each row is in the unit of the loop's settings; without a unit there, all are."""
    fits = np.ones(len(codes), np.bool_)
    texts = plain(cells).cast(pa.string())
    each = texts.dictionary_encode(null_encoding="encode")
    units, of = each.dictionary.to_pylist(), each.indices.to_numpy(zero_copy_only=False)
    for code in np.unique(codes):
        name = asked.names[code]
        loop, signal = asked.known.long[name]
        wants = _unit_of(asked.known.loops[loop], signal)
        for i, unit in enumerate(units):
            if not unit or not wants or _alike(unit) == _alike(wants):
                continue
            wrong = (codes == code) & (of == i)
            if n := int(wrong.sum()):
                fits &= ~wrong
                problems.append(_unit_problem(file, name, asked.known.loops[loop].name, unit, wants, n, done + 1))
    return fits


def _unit_problem(file: File, tag: str, loop: str, unit: str, wants: str, n: int, row: int) -> DataIssue:
    what = f"{n} rows are in {unit}, and the loop's settings say {wants}: they are left out"
    return DataIssue(
        "unit", what, "convert them, or correct the unit in the settings", file.name, row, tag, loop, rows=n
    )


def _unit_of(loop: Loop, signal: int) -> str | None:
    name = SIGNALS[signal]
    return loop.pv_unit if name in ("pv", "sp") else loop.op_unit if name == "op" else None


def _alike(unit: str) -> str:
    """A unit in the form in which units are compared."""
    return unit.strip().lower().replace("³", "3").replace("²", "2")


assert set(SIGNALS) <= set(LABELS)
