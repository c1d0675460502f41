"""The service's database: SQLite, one process that writes it, any number that read it.

Values come in as *entries*: all that came since the last one, packed, with the moment at which they were taken in. An
entry and what it led to (half-periods, events) are one transaction. From time to time the state of every detector is
saved together with the number of the last entry in it, again in one transaction; the entries up to there are then no
longer needed. Whoever starts after a kill takes the saved states and hands them the entries since: the same bits come
out, and a half-period that is already there, known by its loop and its number, is not written again.
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import threading
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..errors import InputError
from ..folder_lock import FolderLock
from ..loop import Loop
from .signal import Event

__all__ = ["COLUMNS", "SCHEMA", "Entry", "Half", "Reader", "Store", "StoreFull", "backup", "restore"]

NAME = "glapp.db"

_FIRST = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE loops (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, settings TEXT NOT NULL);
CREATE TABLE entries (id INTEGER PRIMARY KEY, now REAL NOT NULL, body BLOB NOT NULL);
CREATE TABLE states (loop INTEGER PRIMARY KEY REFERENCES loops (id), body TEXT NOT NULL);
CREATE TABLE half_periods (
    loop INTEGER NOT NULL REFERENCES loops (id), number INTEGER NOT NULL,
    t_start REAL, t_end REAL, sign INTEGER, samples INTEGER, delta_t REAL, delta_y REAL, e_max REAL, delta_sp REAL,
    delta_u REAL, delta_u_d REAL, delta_u_sp REAL, op_travel REAL, free REAL, kp_part REAL, d REAL,
    previous_delta_y REAL, d_hat_before REAL, mask INTEGER, reason INTEGER, d_hat REAL, median_mean REAL,
    noise_floor REAL, detections INTEGER, compensated INTEGER NOT NULL,
    PRIMARY KEY (loop, number)
) WITHOUT ROWID;
CREATE INDEX half_periods_accepted ON half_periods (loop, t_end) WHERE reason = 0;
CREATE INDEX half_periods_rejected ON half_periods (t_end) WHERE reason > 0;
CREATE TABLE answers (
    id INTEGER PRIMARY KEY, loop INTEGER NOT NULL REFERENCES loops (id), time REAL NOT NULL, asked_by TEXT NOT NULL,
    t_begin REAL, t_end REAL, verdict TEXT NOT NULL, d REAL, low REAL, high REAL, unit TEXT NOT NULL,
    reason TEXT NOT NULL, compensable REAL, document TEXT NOT NULL
);
CREATE INDEX answers_loop ON answers (loop, time);
CREATE TABLE settings (
    loop INTEGER NOT NULL REFERENCES loops (id), name TEXT NOT NULL, value TEXT NOT NULL, time REAL NOT NULL,
    person TEXT NOT NULL, PRIMARY KEY (loop, name)
) WITHOUT ROWID;
CREATE TABLE events (
    id INTEGER PRIMARY KEY, time REAL NOT NULL, loop TEXT, kind TEXT NOT NULL, text TEXT NOT NULL
);
CREATE INDEX events_time ON events (time);
CREATE TABLE commands (
    id INTEGER PRIMARY KEY, time REAL NOT NULL, person TEXT NOT NULL, role TEXT NOT NULL, command TEXT NOT NULL,
    loop TEXT, before TEXT NOT NULL, after TEXT NOT NULL, refused TEXT
);
CREATE TABLE users (
    name TEXT PRIMARY KEY, role TEXT NOT NULL, password TEXT NOT NULL, time REAL NOT NULL
) WITHOUT ROWID;
CREATE TABLE tokens (
    digest TEXT PRIMARY KEY, person TEXT NOT NULL REFERENCES users (name) ON DELETE CASCADE, expires REAL NOT NULL
) WITHOUT ROWID;
CREATE TABLE shown (id INTEGER PRIMARY KEY CHECK (id = 1), time REAL NOT NULL, body TEXT NOT NULL);
"""

_SECOND = """
CREATE TABLE plans (
    id INTEGER PRIMARY KEY, loop INTEGER NOT NULL REFERENCES loops (id), time REAL NOT NULL, person TEXT NOT NULL,
    asked TEXT NOT NULL, plan TEXT, refused TEXT
);
CREATE INDEX plans_loop ON plans (loop, id);
CREATE TABLE guided_tests (
    id INTEGER PRIMARY KEY, loop INTEGER NOT NULL REFERENCES loops (id), begun REAL NOT NULL, person TEXT NOT NULL,
    asked TEXT NOT NULL, state TEXT NOT NULL, ended REAL
);
CREATE INDEX guided_tests_loop ON guided_tests (loop, id);
CREATE TABLE repairs (
    id INTEGER PRIMARY KEY, loop INTEGER NOT NULL REFERENCES loops (id), time REAL NOT NULL, noted REAL NOT NULL,
    person TEXT NOT NULL, note TEXT NOT NULL
);
CREATE INDEX repairs_loop ON repairs (loop, time)
"""

_MIGRATIONS = (_FIRST, _SECOND)
"""Steps from one version of the schema to the next; a database that is version n has had the first n."""

SCHEMA = len(_MIGRATIONS)
"""Version of the schema that this program writes."""

COLUMNS = (
    "t_start",
    "t_end",
    "sign",
    "samples",
    "delta_t",
    "delta_y",
    "e_max",
    "delta_sp",
    "delta_u",
    "delta_u_d",
    "delta_u_sp",
    "op_travel",
    "free",
    "kp_part",
    "d",
    "previous_delta_y",
    "d_hat_before",
    "mask",
    "reason",
    "d_hat",
    "median_mean",
    "noise_floor",
    "detections",
)
"""Columns kept of a half-period, by the names of `glapp.HalfPeriods`."""

Half = tuple[Any, ...]
"""A row of `half_periods`: loop, number, `COLUMNS`, and whether u_FF was not 0 in it."""


def _missing(db: sqlite3.Connection, version: int) -> str | None:
    """Missing table or column of a database with that version of the schema, None where all are there."""
    with closing(sqlite3.connect(":memory:")) as ours:
        for step in _MIGRATIONS[:version]:
            ours.executescript(step)
        for [table] in ours.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%'"):
            columns = {row[1] for row in ours.execute(f"PRAGMA table_info({table})")}
            if lacks := columns - {row[1] for row in db.execute(f"PRAGMA table_info({table})")}:
                return f"{table}.{min(lacks)}"
    return None


_INSERT_HALF = f"INSERT OR IGNORE INTO half_periods VALUES ({', '.join('?' * (len(COLUMNS) + 3))})"


class StoreFull(Exception):  # noqa: N818 - a state of the disk, not a fault of the program
    """The store cannot be written now: the disk is full, or the folder is gone. The transaction left nothing."""


@dataclass(frozen=True, slots=True)
class Entry:
    """Data taken in at one moment.

    - `id`: its number: later ones have greater numbers.
    - `now`: the moment, by the clock of this computer [s since 1970 UTC].
    - `loop` (uint32[n]): `loops.id` of each value.
    - `signal` (uint8[n]): which signal: its place in `glapp.service.signal.Signal`, or `ALIVE`, or `LOST`.
    - `good` (bool[n]): whether it may be believed.
    - `time`, `value` (float64[n]): source time [s since 1970 UTC], and the value.
    """

    id: int
    now: float
    loop: np.typing.NDArray[np.uint32]
    signal: np.typing.NDArray[np.uint8]
    good: np.typing.NDArray[np.bool_]
    time: np.typing.NDArray[np.float64]
    value: np.typing.NDArray[np.float64]

    def packed(self) -> bytes:
        """The entry's values as bytes, little-endian, compressed."""
        parts = (
            self.loop.astype("<u4").tobytes(),
            self.signal.tobytes(),
            self.good.astype(np.uint8).tobytes(),
            self.time.astype("<f8").tobytes(),
            self.value.astype("<f8").tobytes(),
        )
        return len(self.loop).to_bytes(4, "little") + zlib.compress(b"".join(parts), 1)

    @classmethod
    def unpacked(cls, id: int, now: float, body: bytes) -> Self:
        """The entry that `packed` packed, with the same bits."""
        n, data = int.from_bytes(body[:4], "little"), zlib.decompress(body[4:])
        at = np.cumsum([0, 4 * n, n, n, 8 * n, 8 * n])
        loop, signal, good, moments, value = (data[a:b] for a, b in pairwise(at))
        return cls(
            id,
            now,
            np.frombuffer(loop, "<u4").astype(np.uint32),
            np.frombuffer(signal, np.uint8),
            np.frombuffer(good, np.uint8).astype(np.bool_),
            np.frombuffer(moments, "<f8").astype(np.float64),
            np.frombuffer(value, "<f8").astype(np.float64),
        )


class Reader:
    """The database, read by anybody at any time.

    - `folder`: the data folder.

    Raises InputError where there is no database, it is damaged, or a later program wrote it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        path = folder / NAME
        if not path.is_file():
            raise InputError("holds no glapp.db", file=str(folder), hint="name the --data of a glapp watch")
        self._db = sqlite3.connect(
            f"{path.resolve().as_uri()}?mode=ro", uri=True, timeout=10, check_same_thread=False, isolation_level=None
        )
        self._db.row_factory = sqlite3.Row
        try:
            version = self._db.execute("PRAGMA user_version").fetchone()[0]
            foreign = version < 1 or (version == SCHEMA and _missing(self._db, version) is not None)
        except sqlite3.DatabaseError as error:
            self.close()
            raise InputError(f"cannot be read: {error}", file=str(path)) from None
        if foreign:
            self.close()
            hint = "start glapp watch on the folder: it sets the file aside and says so; or restore a copy"
            raise InputError("is no database of glapp, or an empty file", file=str(path), hint=hint)
        if version != SCHEMA:
            self.close()
            raise InputError(
                f"has schema {version}, and this glapp reads {SCHEMA}",
                file=str(path),
                hint="start glapp watch of this version once, or use the version that wrote it",
            )

    def close(self) -> None:
        """Let go of it."""
        self._db.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def rows(self, query: str, *values: Any) -> list[dict[str, Any]]:
        """Rows of a query, a dictionary each."""
        return [dict(row) for row in self._db.execute(query, values)]

    def one(self, query: str, *values: Any) -> dict[str, Any] | None:
        """The first row, or None."""
        row = self._db.execute(query, values).fetchone()
        return None if row is None else dict(row)

    def loops(self) -> dict[str, int]:
        """Number of each loop by its name."""
        return {row["name"]: row["id"] for row in self._db.execute("SELECT id, name FROM loops ORDER BY id")}

    def half_periods(
        self, loop: str, begin: float = -1e300, end: float = 1e300, *, accepted: bool = True, most: int = 100_000
    ) -> list[dict[str, Any]]:
        """Half-periods of a loop that ended within [begin, end], in the order of time; the newest `most` of them."""
        chosen = "reason = 0" if accepted else "reason >= 0"
        found = self.rows(
            f"SELECT number, {', '.join(COLUMNS)}, compensated FROM half_periods "
            f"WHERE loop = (SELECT id FROM loops WHERE name = ?) AND t_end BETWEEN ? AND ? AND {chosen} "
            "ORDER BY number DESC LIMIT ?",
            *(loop, begin, end, most),
        )
        return found[::-1]

    def answers(self, loop: str, most: int = 100) -> list[dict[str, Any]]:
        """The answers of a loop, the newest first: of their documents the next step, its urgency, and NE 107 health."""
        return self.rows(
            "SELECT id, time, asked_by, t_begin, t_end, verdict, d, low, high, unit, reason, compensable, "
            "json_extract(document, '$.analysis.loops[0].answer.next.text') AS next, "
            "json_extract(document, '$.analysis.loops[0].answer.confidence') AS confidence, "
            "json_extract(document, '$.analysis.loops[0].answer.urgency') AS urgency, "
            "json_extract(document, '$.analysis.loops[0].answer.health') AS health FROM answers "
            "WHERE loop = (SELECT id FROM loops WHERE name = ?) ORDER BY time DESC, id DESC LIMIT ?",
            *(loop, most),
        )

    def answer(self, loop: str, id: int) -> dict[str, Any] | None:
        """Verdict, width to compensate and document of an answer of a loop; None where there is no such answer."""
        return self.one(
            "SELECT verdict, compensable, document FROM answers JOIN loops ON loops.id = answers.loop "
            "WHERE answers.id = ? AND loops.name = ?",
            *(id, loop),
        )

    def document(self, id: int) -> dict[str, Any] | None:
        """The document of an answer, as `glapp analyze --json` writes it; None where there is no such answer."""
        found = self.one("SELECT document FROM answers WHERE id = ?", id)
        return None if found is None else json.loads(found["document"])["analysis"]

    def answers_shown(self, ids: Sequence[int]) -> list[dict[str, Any]]:
        """Answers for the station: answer, recordings and process as JSON, and when each was made."""
        return self.rows(
            "SELECT answers.id, name, "
            "json_extract(document, '$.analysis.loops[0].answer') AS answer, "
            "json_extract(document, '$.analysis.loops[0].fit.recordings') AS recordings, "
            "json_extract(document, '$.analysis.loops[0].fit.process') AS process, "
            "json_extract(document, '$.analysis.loops[0].file') AS file, "
            "t_begin, t_end, time, asked_by FROM answers "
            f"JOIN loops ON loops.id = answers.loop WHERE answers.id IN ({', '.join('?' * len(ids))})",
            *ids,
        )

    def detections(self, loop: str, begin: float, most: int) -> list[dict[str, Any]]:
        """End, width, estimate and compensation of a loop's accepted half-periods since `begin`; the newest `most`."""
        found = self.rows(
            "SELECT t_end, d, median_mean, compensated FROM half_periods WHERE loop = "
            "(SELECT id FROM loops WHERE name = ?) AND reason = 0 AND t_end >= ? ORDER BY t_end DESC LIMIT ?",
            *(loop, begin, most),
        )
        return found[::-1]

    def reason_counts(self, loop: str, begin: float) -> dict[int, int]:
        """Number of half-periods of a loop that ended after `begin`, by the code of `HalfPeriods.reason`."""
        found = self.rows(
            "SELECT reason, COUNT(*) AS n FROM half_periods WHERE loop = (SELECT id FROM loops WHERE name = ?) "
            "AND t_end > ? GROUP BY reason",
            *(loop, begin),
        )
        return {row["reason"]: row["n"] for row in found}

    def daily_detections(self, begin: float) -> list[dict[str, Any]]:
        """Mean width of each loop's detections by day since `begin`, those under compensation left out."""
        return self.rows(
            "SELECT name, CAST(t_end / 86400 AS INTEGER) AS day, AVG(d) AS d, NULL AS low, NULL AS high FROM "
            "half_periods JOIN loops ON loops.id = half_periods.loop "
            "WHERE reason = 0 AND compensated = 0 AND t_end > ? GROUP BY name, day",
            begin,
        )

    def daily_widths(self, begin: float) -> list[dict[str, Any]]:
        """Mean width and limits of each loop's fits that found backlash, by day since `begin`."""
        return self.rows(
            "SELECT name, CAST(time / 86400 AS INTEGER) AS day, AVG(d) AS d, AVG(low) AS low, AVG(high) AS high "
            "FROM answers JOIN loops ON loops.id = answers.loop WHERE verdict IN ('backlash', 'both') AND time > ? "
            "GROUP BY name, day",
            begin,
        )

    def events(self, loop: str | None = None, most: int = 200, before: int | None = None) -> list[dict[str, Any]]:
        """Events, the newest first; of one loop where it is named."""
        return self.rows(
            "SELECT id, time, loop, kind, text FROM events WHERE (?1 IS NULL OR loop = ?1) AND (?3 IS NULL OR id < ?3) "
            "ORDER BY id DESC LIMIT ?2",
            *(loop, most, before),
        )

    def left_enabled(self) -> list[str]:
        """Loops whose compensation was enabled, and whose end nobody has written down."""
        found = self.rows(
            "SELECT loop FROM (SELECT loop, kind, MAX(id) FROM events WHERE kind IN ('enabled', 'withdrawn') "
            "GROUP BY loop) WHERE kind = 'enabled' ORDER BY loop"
        )
        return [row["loop"] for row in found]

    def commands(self, loop: str | None = None, most: int = 200) -> list[dict[str, Any]]:
        """Commands, the newest first: who asked, the values before and after, or the reason of refusal."""
        found = self.rows(
            "SELECT * FROM commands WHERE (?1 IS NULL OR loop = ?1) ORDER BY id DESC LIMIT ?2", *(loop, most)
        )
        for row in found:
            row["before"], row["after"] = json.loads(row["before"]), json.loads(row["after"])
        return found

    def plan(self, loop: str) -> dict[str, Any] | None:
        """The last plan of a test that was asked for: `asked` with its limits, and `plan` or why it was `refused`."""
        return _parsed(self._last("plans", loop), "asked", "plan")

    def guided_test(self, loop: str) -> dict[str, Any] | None:
        """The last guided step test: `asked`, its `state`, and when it `ended`; None: it goes on."""
        return _parsed(self._last("guided_tests", loop), "asked", "state")

    def repairs(self, loop: str) -> list[dict[str, Any]]:
        """The repairs of a loop's valve that persons have noted, the newest first."""
        return self.rows(
            "SELECT id, time, noted, person, note FROM repairs WHERE loop = (SELECT id FROM loops WHERE name = ?) "
            "ORDER BY time DESC, id DESC",
            loop,
        )

    def plans_waiting(self) -> list[dict[str, Any]]:
        """The plans that are asked for and not made yet, in their order, with the `name` of the loop."""
        return self.rows(
            "SELECT plans.id, name, asked FROM plans JOIN loops ON loops.id = plans.loop "
            "WHERE plan IS NULL AND refused IS NULL ORDER BY plans.id"
        )

    def guided_tests_going_on(self) -> list[dict[str, Any]]:
        """The guided tests that go on, with the `name` of the loop."""
        return self.rows(
            "SELECT guided_tests.id, name, begun, person, asked, state FROM guided_tests "
            "JOIN loops ON loops.id = guided_tests.loop WHERE ended IS NULL ORDER BY guided_tests.id"
        )

    def _last(self, table: str, loop: str) -> dict[str, Any] | None:
        return self.one(
            f"SELECT * FROM {table} WHERE loop = (SELECT id FROM loops WHERE name = ?) ORDER BY id DESC LIMIT 1", loop
        )

    def settings(self, loop: str) -> dict[str, Any]:
        """Settings of a loop by persons."""
        found = self._db.execute(
            "SELECT name, value FROM settings WHERE loop = (SELECT id FROM loops WHERE name = ?)", (loop,)
        )
        return {row["name"]: json.loads(row["value"]) for row in found}

    def loops_given(self) -> dict[str, dict[str, Any]]:
        """Settings of every loop from loops.toml, by its name."""
        return {row["name"]: json.loads(row["settings"]) for row in self.rows("SELECT name, settings FROM loops")}

    def all_settings(self) -> dict[str, dict[str, Any]]:
        """Settings of each loop by persons, by the loop's name."""
        found: dict[str, dict[str, Any]] = {}
        for row in self.rows(
            "SELECT loops.name AS loop, settings.name, value FROM settings JOIN loops ON loops.id = settings.loop"
        ):
            found.setdefault(row["loop"], {})[row["name"]] = json.loads(row["value"])
        return found

    def users(self) -> list[dict[str, str]]:
        """Name and role of every user."""
        return self.rows("SELECT name, role FROM users ORDER BY name")

    def user(self, name: str) -> dict[str, str] | None:
        """Role and hashed password of a user; None where there is no such user."""
        return self.one("SELECT role, password FROM users WHERE name = ?", name)

    def logins(self) -> list[dict[str, Any]]:
        """Present logins: digest of the token, name, role and when the token expires."""
        return self.rows("SELECT digest, name, role, expires FROM tokens JOIN users ON name = person")

    def login(self, digest: str, now: float) -> tuple[str, str] | None:
        """Name and role of the user whose token has this digest; None where it has expired or there is none."""
        row = self.one(
            "SELECT name, role FROM tokens JOIN users ON name = person WHERE digest = ? AND expires > ?", digest, now
        )
        return None if row is None else (row["name"], row["role"])

    def known_addresses(self) -> dict[str, list[str]] | None:
        """Addresses from which each user has logged in, the newest last; None where nothing is kept of that."""
        row = self.one("SELECT value FROM meta WHERE name = 'known_addresses'")
        return None if row is None else json.loads(row["value"])

    def wait_at_most(self, milliseconds: int) -> None:
        """Wait no longer than this where another process writes [ms]."""
        self._db.execute(f"PRAGMA busy_timeout = {milliseconds:d}")

    @property
    def damaged(self) -> str | None:
        """Fault of the database that was set aside, as long as it is in the folder."""
        known = dict(self._db.execute("SELECT name, value FROM meta WHERE name LIKE 'damaged%'").fetchall())
        there = "damaged_file" in known and (self.folder / known["damaged_file"]).exists()
        return known["damaged"] if there else None

    def shown_at(self) -> float | None:
        """Time at which the service last wrote its status [s since 1970 UTC]; None where it never did."""
        row = self.one("SELECT time FROM shown")
        return None if row is None else row["time"]

    def shown(self) -> tuple[float, dict[str, Any]] | None:
        """Time at which the service last wrote its status, and the status."""
        row = self._db.execute("SELECT time, body FROM shown").fetchone()
        return None if row is None else (row["time"], json.loads(row["body"]))


def _parsed(row: dict[str, Any] | None, *columns: str) -> dict[str, Any] | None:
    """A row with these columns read as JSON."""
    if row is not None:
        row |= {column: None if row[column] is None else json.loads(row[column]) for column in columns}
    return row


class Store(Reader):
    """The database, to be written by the one process that has the folder's `FolderLock`.

    A database that is damaged is renamed to `glapp.db.damaged-TIME` with all that belongs to it, and a new one begun:
    nothing is written into it. Damaged is what SQLite finds damaged, an empty file, and what has not the tables of
    glapp. `found` says so where it was found now, `damaged` as long as the file is there. Where there is no database
    though signals are recorded, `found` says that.

    - `folder`: the data folder; made where it is missing.
    - `now`: the time that a damaged database is named by [s since 1970 UTC].

    Raises InputError where another process writes it, or a later program wrote it.
    """

    def __init__(self, folder: Path, now: float | None = None) -> None:
        self.folder = folder
        self.lock = FolderLock(folder)
        self.found: str | None = None
        self._one_at_a_time = threading.Lock()
        try:
            self._open(time.time() if now is None else now)
        except BaseException:
            self.lock.release()
            raise

    def _open(self, now: float) -> None:
        """Open the database; a damaged one is set aside."""
        path = self.folder / NAME
        there, version = path.exists(), 0
        empty = there and path.stat().st_size == 0  # SQLite takes it for a new database
        why = "has 0 bytes" if empty else None
        try:
            self._db = _connected(path)
            if (fault := self._db.execute("PRAGMA quick_check(1)").fetchone()[0]) != "ok":
                why = why or f"is damaged: {fault}"
            version = self._db.execute("PRAGMA user_version").fetchone()[0]
            there = there and (empty or bool(self._db.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchone()))
            if there and why is None and version <= SCHEMA and (lacks := _missing(self._db, max(version, 1))):
                why = f"is none of glapp's: schema {version} without {lacks}"
        except sqlite3.DatabaseError as error:
            if isinstance(error, sqlite3.OperationalError):  # it is not the file: the disk is full, or not ours
                raise InputError(f"cannot be opened: {error}", file=str(path)) from None
            why = f"is damaged: {error}"
        if why is None and version > SCHEMA:
            self._db.close()
            raise InputError(
                f"has schema {version}, and this glapp writes {SCHEMA}", file=str(path), hint="use the newer version"
            )
        damage: list[tuple[str, str]] = []
        if why is not None:
            self._db.close()
            aside = _set_aside(path, now)
            self.found = (
                f"the database {why}; it was set aside as {aside.name}, and a new one begun without the users, "
                f"settings, answers and events of before: restore a copy of it, or take {aside.name} away to go on"
            )
            damage = [("damaged", self.found), ("damaged_file", aside.name)]
            self._db, version = _connected(path), 0
        elif not there and any(self.folder.glob("signals/*")):
            self.found = (
                f"there is no {NAME} next to recorded signals: a new one was begun without the users, settings, "
                "answers and events of before; restore a copy of it"
            )
        try:
            _configure(self._db)
        except sqlite3.OperationalError as error:
            self._db.close()
            raise InputError(f"cannot be opened: {error}", file=str(path)) from None
        if version < SCHEMA:
            with self._writing():
                for step in _MIGRATIONS[version:]:
                    for statement in step.split(";\n"):
                        self._db.execute(statement)
                self._db.executemany("INSERT INTO meta VALUES (?, ?)", damage)
                self._db.execute(f"PRAGMA user_version = {SCHEMA}")

    def close(self) -> None:
        """Let go of it, and of the right to write it."""
        super().close()
        self.lock.release()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """A transaction, all of it or nothing; of one thread at a time."""
        with self._one_at_a_time:
            try:
                self._db.execute("BEGIN IMMEDIATE")
                try:
                    yield
                    self._db.execute("COMMIT")
                except BaseException:
                    if self._db.in_transaction:
                        self._db.execute("ROLLBACK")
                    raise
            except sqlite3.OperationalError as error:
                raise StoreFull(f"{self.folder / NAME} cannot be written: {error}") from None

    def know(self, loops: Sequence[Loop]) -> dict[str, int]:
        """Store loops; gives the number of every loop that was ever there."""
        with self._writing():
            self._db.executemany(
                "INSERT INTO loops (name, settings) VALUES (?, ?) "
                "ON CONFLICT (name) DO UPDATE SET settings = excluded.settings",
                [(loop.name, loop.model_dump_json(exclude_unset=True)) for loop in loops],
            )
        return self.loops()

    def add(self, entries: Sequence[Entry], halves: Sequence[Half], events: Sequence[Event]) -> None:
        """Store an entry, with its results: one transaction.

        Raises StoreFull where it cannot be written; nothing of it is there.
        """
        with self._writing():
            self._db.executemany(
                "INSERT INTO entries VALUES (?, ?, ?)", [(entry.id, entry.now, entry.packed()) for entry in entries]
            )
            self._insert(halves, events)

    def _insert(self, halves: Sequence[Half], events: Sequence[Event]) -> None:
        """Insert half-periods and events."""
        self._db.executemany(_INSERT_HALF, halves)
        self._db.executemany(
            "INSERT INTO events (time, loop, kind, text) VALUES (?, ?, ?, ?)",
            [(event.time, event.loop, event.kind, event.text) for event in events],
        )

    def save(self, position: int, states: Mapping[int, str], events: Sequence[Event] = ()) -> None:
        """Store the states in which all entries up to `position` are, and delete those entries: one transaction.

        Raises StoreFull where it cannot be written; all is as it was.
        """
        with self._writing():
            self._db.execute("DELETE FROM entries WHERE id <= ?", (position,))
            self._db.executemany("INSERT OR REPLACE INTO states VALUES (?, ?)", states.items())
            self._db.execute("INSERT OR REPLACE INTO meta VALUES ('position', ?)", (str(position),))
            self._insert((), events)

    def position(self) -> int:
        """Number of the last entry in the saved states; 0 before the first."""
        row = self._db.execute("SELECT value FROM meta WHERE name = 'position'").fetchone()
        return 0 if row is None else int(row["value"])

    def states(self) -> dict[int, str]:
        """The saved states by the loops' numbers."""
        return {row["loop"]: row["body"] for row in self._db.execute("SELECT loop, body FROM states")}

    def entries(self) -> Iterator[Entry]:
        """The entries that are in no saved state, in their order."""
        for row in self._db.execute("SELECT id, now, body FROM entries WHERE id > ? ORDER BY id", (self.position(),)):
            yield Entry.unpacked(row["id"], row["now"], row["body"])

    def show(self, now: float, body: str) -> None:
        """Store what readers see of the loops now."""
        with self._writing():
            self._db.execute("INSERT OR REPLACE INTO shown VALUES (1, ?, ?)", (now, body))

    def tell(self, events: Iterable[Event]) -> None:
        """Store events."""
        with self._writing():
            self._insert((), list(events))

    def forget(self, before: float) -> int:
        """Take out the rejected half-periods that ended before a time; gives how many. The accepted ones stay.

        Refused logins of before that time are not kept either, neither counted nor one by one, as they once were.
        """
        with self._writing():
            self._db.execute("DELETE FROM events WHERE kind = 'logins_refused' AND time < ?", (before,))
            self._db.execute("DELETE FROM commands WHERE command = 'login' AND time < ?", (before,))
            return self._db.execute("DELETE FROM half_periods WHERE reason > 0 AND t_end < ?", (before,)).rowcount

    def add_answer(self, loop: str, answer: Mapping[str, Any]) -> int:
        """Store an answer; gives its number."""
        names = ", ".join(answer)
        marks = ", ".join("?" * len(answer))
        with self._writing():
            cursor = self._db.execute(
                f"INSERT INTO answers (loop, {names}) VALUES ((SELECT id FROM loops WHERE name = ?), {marks})",
                (loop, *answer.values()),
            )
        assert cursor.lastrowid is not None
        return cursor.lastrowid

    def command(
        self,
        when: float,
        person: str,
        role: str,
        command: str,
        loop: str | None,
        before: Any,
        after: Any,
        *,
        refused: str | None = None,
        settings: Mapping[str, Any] | None = None,
        states: Mapping[int, str] | None = None,
    ) -> None:
        """Put down a command, and with it, in the same transaction, the settings and states that it changed."""
        with self._writing():
            self._db.execute(
                "INSERT INTO commands (time, person, role, command, loop, before, after, refused) "
                "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                (when, person, role, command, loop, json.dumps(before), json.dumps(after), refused),
            )
            self._db.executemany(
                "INSERT OR REPLACE INTO settings VALUES ((SELECT id FROM loops WHERE name = ?), ?, ?, ?, ?)",
                [(loop, name, json.dumps(value), when, person) for name, value in (settings or {}).items()],
            )
            self._db.executemany("INSERT OR REPLACE INTO states VALUES (?, ?)", (states or {}).items())

    def ask_plan(self, loop: str, now: float, person: str, asked: Mapping[str, Any]) -> None:
        """Store that somebody asks for a plan of a test."""
        with self._writing():
            self._db.execute(
                "INSERT INTO plans (loop, time, person, asked) VALUES ((SELECT id FROM loops WHERE name = ?), ?, ?, ?)",
                (loop, now, person, json.dumps(asked)),
            )

    def keep_plan(self, id: int, plan: Mapping[str, Any] | None, refused: str | None) -> None:
        """Store a requested plan, or the reason why there is none."""
        document = None if plan is None else json.dumps(plan)
        with self._writing():
            self._db.execute("UPDATE plans SET plan = ?, refused = ? WHERE id = ?", (document, refused, id))

    def begin_guided_test(
        self, loop: str, now: float, person: str, asked: Mapping[str, Any], state: Mapping[str, Any]
    ) -> None:
        """Store a guided test that begins."""
        with self._writing():
            self._db.execute(
                "INSERT INTO guided_tests (loop, begun, person, asked, state) "
                "VALUES ((SELECT id FROM loops WHERE name = ?), ?, ?, ?, ?)",
                (loop, now, person, json.dumps(asked), json.dumps(state)),
            )

    def keep_guided_test(self, id: int, state: str, ended: float | None) -> None:
        """Store where a guided test is, as JSON, and when it ended; one that has ended stays as it is."""
        with self._writing():
            self._db.execute(
                "UPDATE guided_tests SET state = ?, ended = ? WHERE id = ? AND ended IS NULL", (state, ended, id)
            )

    def note_repair(self, loop: str, at: float, now: float, person: str, note: str) -> None:
        """Store a repair of a loop's valve."""
        with self._writing():
            self._db.execute(
                "INSERT INTO repairs (loop, time, noted, person, note) "
                "VALUES ((SELECT id FROM loops WHERE name = ?), ?, ?, ?, ?)",
                (loop, at, now, person, note),
            )

    def put_user(self, name: str, role: str, password: str, now: float) -> None:
        """Store a user, with a password that is hashed, and end all logins of that name."""
        with self._writing():
            self._db.execute("INSERT OR REPLACE INTO users VALUES (?, ?, ?, ?)", (name, role, password, now))
            self._db.execute("DELETE FROM tokens WHERE person = ?", (name,))

    def remove_user(self, name: str) -> bool:
        """Delete a user with all logins; whether there was one of that name."""
        with self._writing():
            return self._db.execute("DELETE FROM users WHERE name = ?", (name,)).rowcount > 0

    def add_login(self, digest: str, name: str, expires: float) -> None:
        """Store a login by the digest of its token."""
        with self._writing():
            self._db.execute("INSERT INTO tokens VALUES (?, ?, ?)", (digest, name, expires))

    def end_login(self, digest: str) -> None:
        """Delete a login."""
        with self._writing():
            self._db.execute("DELETE FROM tokens WHERE digest = ?", (digest,))

    def end_logins(self, now: float) -> None:
        """Delete the logins that have expired."""
        with self._writing():
            self._db.execute("DELETE FROM tokens WHERE expires <= ?", (now,))

    def put_known_addresses(self, addresses: Mapping[str, Sequence[str]]) -> None:
        """Store the addresses from which each user has logged in."""
        with self._writing():
            self._db.execute("INSERT OR REPLACE INTO meta VALUES ('known_addresses', ?)", (json.dumps(addresses),))


def _private(path: Path) -> None:
    """Create a missing file, readable by its owner only; SQLite's files next to it get the same rights."""
    os.close(os.open(path, os.O_RDWR | os.O_CREAT, 0o600))
    with suppress(OSError):  # a file system without rights
        path.chmod(0o600)


def _connected(path: Path) -> sqlite3.Connection:
    try:
        for beside in path.parent.glob(f"{path.name}?*"):  # what an older version left, and copies set aside
            with suppress(OSError):
                beside.chmod(0o600)
        _private(path)
    except OSError:
        pass  # connecting says what is wrong
    db = sqlite3.connect(path, timeout=10, check_same_thread=False, isolation_level=None)
    db.row_factory = sqlite3.Row
    return db


def _configure(db: sqlite3.Connection) -> None:
    """Settings of a database that is written: only after its check, since the first of them changes the file."""
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("PRAGMA synchronous = FULL")  # what was committed is there after a power cut, too
    db.execute("PRAGMA foreign_keys = ON")


def _aside(path: Path, why: str, now: float) -> Path:
    """A free name next to a database that is set aside, with why and when."""
    stamp = time.strftime("%Y-%m-%dT%H-%M-%SZ", time.gmtime(now))
    found, number = path.with_name(f"{path.name}.{why}-{stamp}"), 1
    while found.exists():
        number += 1
        found = path.with_name(f"{path.name}.{why}-{stamp}-{number}")
    return found


def _set_aside(path: Path, now: float) -> Path:
    """Move a damaged database away, under a name with its time."""
    aside = _aside(path, "damaged", now)
    path.rename(aside)
    _move_beside(path, aside)
    return aside


def _move_beside(path: Path, aside: Path) -> None:
    """Move SQLite's own files of a database that was set aside after it."""
    for ending in ("-wal", "-shm"):
        beside = path.with_name(path.name + ending)
        if beside.exists():
            beside.rename(aside.with_name(aside.name + ending))


def backup(folder: Path, file: Path) -> None:
    """Copy the database of a data folder into a file, whether it is written at the time or not.

    The copy is made next to the file and then takes its name: either it is complete, or there is none. Signals are
    files in `folder/signals`, to be copied as files.

    - `folder`: the data folder.
    - `file`: the copy; one that is there is replaced.

    Raises InputError where there is no database, the file is one of the database's own, or it cannot be written.
    """
    if file.parent.resolve() == folder.resolve() and file.name in (NAME, f"{NAME}-wal", f"{NAME}-shm"):
        hint = "give the copy another name, best in another folder"
        raise InputError(f"belongs to the database of {folder}, which a copy would destroy", file=str(file), hint=hint)
    part = file.with_name(f".{file.name}.part")
    with Reader(folder) as reader:
        try:
            part.unlink(missing_ok=True)
            _private(part)
            target = sqlite3.connect(part)
            try:
                reader._db.backup(target)
                target.execute("PRAGMA journal_mode = DELETE")
                target.execute("DELETE FROM tokens")  # nobody is logged in by what is copied
                target.commit()
            finally:
                target.close()
            part.replace(file)
        except (sqlite3.Error, OSError) as error:
            part.unlink(missing_ok=True)
            raise InputError(f"cannot be written: {error}", file=str(file)) from None


def restore(folder: Path, file: Path, now: float | None = None) -> Path | None:
    """Put a copy that `backup` made in the place of the database of a data folder.

    The database that is there is set aside, not overwritten. Compensation is off afterwards, as after every start.

    - `folder`: the data folder; made where it is missing.
    - `file`: the copy.
    - `now`: the time that the old database is named by [s since 1970 UTC].

    Returns what the old database is called now.

    Raises InputError where a process writes the folder, or the file is no sound database of glapp.
    """
    try:
        copy = sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)
        try:
            sound = copy.execute("PRAGMA quick_check(1)").fetchone()[0] == "ok"
            version = copy.execute("PRAGMA user_version").fetchone()[0]
            lacks = _missing(copy, version) if 1 <= version <= SCHEMA else None
        finally:
            copy.close()
    except sqlite3.Error as error:
        raise InputError(f"is no database of glapp: {error}", file=str(file)) from None
    if lacks is not None:
        raise InputError(f"is no database of glapp: it has no {lacks}", file=str(file))
    if not sound or not 1 <= version <= SCHEMA:
        raise InputError(f"is damaged, or of schema {version}, where this glapp reads 1 to {SCHEMA}", file=str(file))
    lock = FolderLock(folder)
    try:
        path = folder / NAME
        part = path.with_name(f".{NAME}.part")
        _private(part)
        shutil.copyfile(file, part)
        aside = None
        if path.exists():
            aside = _aside(path, "replaced", time.time() if now is None else now)
            old = sqlite3.connect(path)
            try:
                old.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            except sqlite3.DatabaseError:
                pass  # it may be damaged: then it is set aside as it is
            finally:
                old.close()
            try:
                os.link(path, aside)  # a kill from here on leaves one of the two under the database's name
            except OSError:
                path.rename(aside)  # a file system without links
            _move_beside(path, aside)
        part.replace(path)
        return aside
    finally:
        lock.release()
