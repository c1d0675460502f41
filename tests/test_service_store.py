"""Storage of the service: nothing lost, nothing twice, whatever happens to the process, the file or the disk."""

import asyncio
import errno
import multiprocessing
import os
import random
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import service
from service import BEGIN, Clock, detections, fed, loops, values

import glapp
from glapp.errors import InputError
from glapp.folder_lock import FolderLock
from glapp.service import store as of_memory
from glapp.service.recordings import SignalStore, loop_of
from glapp.service.signal import Event, Signal, Value
from glapp.service.store import SCHEMA, Entry, Reader, Store, StoreFull, backup, restore

HERE = Path(__file__).parent


def test_an_entry_comes_back_with_the_same_bits() -> None:
    n = 1000
    random = np.random.default_rng(1)
    entry = Entry(
        7,
        BEGIN,
        random.integers(0, 5000, n).astype(np.uint32),
        random.integers(0, 256, n).astype(np.uint8),
        random.integers(0, 2, n).astype(np.bool_),
        random.standard_normal(n),
        np.where(random.random(n) < 0.1, np.nan, random.standard_normal(n)),
    )
    again = Entry.unpacked(7, BEGIN, entry.packed())
    for name in ("loop", "signal", "good", "time", "value"):
        a, b = getattr(entry, name), getattr(again, name)
        assert a.dtype == b.dtype and a.tobytes() == b.tobytes()


@pytest.mark.slow
def test_detections_are_those_of_the_estimator(tmp_path: Path) -> None:
    """The half-periods have the bits of `glapp.Estimator` on the samples."""
    [loop], clock = loops(), Clock()
    monitor = service.monitor(tmp_path, [loop], clock)
    fed(monitor, clock, values("FIC0", 400))
    asyncio.run(monitor.save())
    table = SignalStore(tmp_path).read("FIC0", BEGIN, BEGIN + 1e6)
    t = table["time"].cast("int64").to_numpy() / 1e6
    columns = {name: table[name.upper()].to_numpy() for name in ("sp", "pv", "op")}
    estimator = glapp.Estimator(loop, 1.0)
    estimator.update_many(t, **columns)
    kept = detections(tmp_path, "FIC0")
    alone = estimator.half_periods
    assert len(kept) == len(alone.d) > 10
    assert [row[of_memory.COLUMNS.index("d") + 1] for row in kept] == alone.d.tolist()
    assert len(t) == 398 and t[0] == BEGIN


@pytest.mark.slow
@pytest.mark.parametrize("save_every", [0, 1, 3])
def test_begun_anew_in_the_middle_it_goes_on_with_the_same_bits(tmp_path: Path, save_every: int) -> None:
    """Ended without a word between two steps, 7 times; once states are saved often, once never."""
    known, given = loops(2), values("FIC0", 300) + values("FIC1", 300, seed=2)
    clock = Clock()
    straight = service.monitor(tmp_path / "straight", known, clock)
    fed(straight, clock, given)
    clock = Clock()
    for part in range(8):
        monitor = service.monitor(tmp_path / "broken", known, clock)
        begin, end = BEGIN + part * 40, BEGIN + (part + 1) * 40
        fed(monitor, clock, [value for value in given if begin <= value.time < end], save_every=save_every)
        monitor.store.close()
        monitor.reader.close()
    for loop in ("FIC0", "FIC1"):
        assert detections(tmp_path / "broken", loop) == detections(tmp_path / "straight", loop)
        assert len(detections(tmp_path / "broken", loop)) > 5
    last = service.monitor(tmp_path / "broken", known, clock)
    asyncio.run(last.save())
    asyncio.run(straight.save())
    for loop in ("FIC0", "FIC1"):
        tables = [SignalStore(tmp_path / name).read(loop, BEGIN, BEGIN + 1e6) for name in ("broken", "straight")]
        assert tables[0].equals(tables[1]) and len(tables[0]) == 298
    assert last.status()["loops"]["FIC0"]["estimate"] == straight.status()["loops"]["FIC0"]["estimate"] is not None


@pytest.mark.slow
def test_a_break_that_no_history_fills_is_a_gap_however_short(tmp_path: Path) -> None:
    """Ten seconds after a kill somebody listens again: PV was held to have stood still meanwhile."""
    clock = Clock()
    given = values("FIC0", 120)
    first = service.monitor(tmp_path, loops(), clock)
    fed(first, clock, [value for value in given if value.time < BEGIN + 60], pace=1.0)
    first.store.close()
    again = service.monitor(tmp_path, loops(), clock)
    fed(again, clock, [value for value in given if value.time >= BEGIN + 70], pace=1.0)
    asyncio.run(again.save())
    times = [
        at.timestamp() - BEGIN for at in SignalStore(tmp_path).read("FIC0", BEGIN, BEGIN + 1e6)["time"].to_pylist()
    ]
    assert times == [*range(60), *range(70, 118)]
    ended = [row for row in detections(tmp_path, "FIC0") if row[1] < BEGIN + 60 <= row[2] + 10]
    assert [row[of_memory.COLUMNS.index("mask") + 1] & 1 for row in ended] == [1], "it ended as a gap"


@pytest.mark.verify
def test_who_looks_at_the_signals_does_not_end_the_watch(tmp_path: Path) -> None:
    """A page asked for them in a thread of its own, and at that moment no sample could be added."""
    [loop], clock = loops(), Clock()
    monitor = service.monitor(tmp_path, [loop], clock)
    fed(monitor, clock, values("FIC0", 3000))
    samples = monitor.loops["FIC0"].samples
    samples.extend(samples * 30)  # what takes longer is met sooner
    done, seen = threading.Event(), list[int]()

    def look() -> None:
        while not done.is_set():
            seen.append(len(monitor.journal.recorded("FIC0", BEGIN, BEGIN + 1e6)))

    looking = [threading.Thread(target=look) for _ in range(2)]
    for one in looking:
        one.start()
    try:
        while len(seen) < 100:
            samples.extend(samples[-7:])
            del samples[-7:]
    finally:
        done.set()
        for one in looking:
            one.join()
    assert min(seen) >= 31 * 2998


@pytest.mark.verify
def test_killed_at_random_moments(tmp_path: Path) -> None:
    """kill -9 while it takes in, writes and saves; values that the store lacks are handed over again, as a history
    does.
    """
    folder, chance, kills, seconds = tmp_path / "killed", random.Random(5), 0, 150
    while True:
        last = kills == 6
        child = subprocess.Popen(
            [sys.executable, str(HERE / "service_child.py"), str(folder), str(seconds), "5"],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert child.stdout is not None
        with child.stdout:
            while (line := child.stdout.readline()) != "begun\n":
                assert line == "writing\n", "it ended before it began"
            if not last:
                for _ in range(chance.randint(0, 12)):
                    child.stdout.readline()
                time.sleep(chance.choice([0.0, chance.uniform(0.0, 0.02)]))
                child.kill()
            child.stdout.read()
            code = child.wait()
        kills += code == -signal.SIGKILL
        if code == 0 and last:
            break
        if code == 0:  # it was done before it was killed: there is more to come
            seconds += 150
    clock = Clock()
    straight = service.monitor(tmp_path / "straight", loops(2), clock)
    fed(straight, clock, values("FIC0", seconds) + values("FIC1", seconds, seed=2))
    asyncio.run(straight.save())
    for loop in ("FIC0", "FIC1"):
        assert len(detections(folder, loop)) > 3
        assert detections(folder, loop) == detections(tmp_path / "straight", loop)
        tables = [SignalStore(path).read(loop, BEGIN, BEGIN + 1e6) for path in (folder, tmp_path / "straight")]
        assert tables[0].equals(tables[1])


def test_a_change_of_settings_begins_the_detector_anew_and_says_so(tmp_path: Path) -> None:
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(), clock)
    fed(monitor, clock, values("FIC0", 200), save_every=10)
    monitor.store.close()
    changed = loops()[0].model_copy(update={"tf": 0.5})
    again = service.monitor(tmp_path, [changed], clock)
    asyncio.run(again.step())
    assert again.status()["loops"]["FIC0"]["estimate"] is None
    assert "detector_anew" in [event["kind"] for event in again.reader.events("FIC0")]
    assert len(detections(tmp_path, "FIC0")) == monitor.status()["loops"]["FIC0"]["half_periods"]


def test_two_writers(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with pytest.raises(InputError, match=f"is written by process {os.getpid()} on .* since"):
        Store(tmp_path)
    with Reader(tmp_path) as reader:
        assert reader.loops() == {}
    store.close()
    Store(tmp_path).close()


@pytest.mark.slow
def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    """Regression: `glapp watch` said that standard output could not be written."""
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file/data: cannot be written: Not a directory; name a folder"):
        FolderLock(tmp_path / "file" / "data")


def test_a_full_disk_under_the_lock_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: `glapp watch` and `glapp fleet` did not name the folder, and said nothing of room."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched, pytest.raises(InputError, match="No space left on device; make room"):
        patched.setattr(os, "write", full)
        FolderLock(tmp_path)
    FolderLock(tmp_path).release()


def test_a_lock_ends_with_its_process(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    child = context.Process(target=_hold, args=(tmp_path,))
    child.start()
    deadline = time.monotonic() + 30
    while FolderLock.holder(tmp_path) is None and time.monotonic() < deadline:
        time.sleep(0.02)
    assert (FolderLock.holder(tmp_path) or {}).get("pid") == child.pid
    child.kill()
    child.join()
    assert FolderLock.holder(tmp_path) is None


def test_a_holder_that_has_not_said_who_it_is(tmp_path: Path) -> None:
    """Regression: `glapp watch status` ended with a KeyError where it looked just after a service had begun."""
    lock = FolderLock(tmp_path)
    (tmp_path / "lock").write_text("")
    assert FolderLock.holder(tmp_path) == {"pid": "?", "host": "?", "since": "?"}
    lock.release()


def _hold(folder: Path) -> None:
    lock = FolderLock(folder)
    time.sleep(60)
    lock.release()


@pytest.mark.parametrize("how", ["text", "middle", "cut", "empty page"])
@pytest.mark.slow
def test_a_damaged_database_is_set_aside_and_not_written(tmp_path: Path, how: str) -> None:
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(), clock)
    fed(monitor, clock, values("FIC0", 120), save_every=8)
    monitor.store.close()
    monitor.reader.close()
    path = tmp_path / "glapp.db"
    db = sqlite3.connect(path)
    db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    db.close()
    good = path.read_bytes()
    bad = {
        "text": b"this is no database" * 100,
        "middle": good[:4096] + bytes(range(256)) * 32 + good[4096 + 8192 :],
        "cut": good[: len(good) // 2],
        "empty page": good[:8192] + bytes(16384) + good[24576:],
    }[how]
    path.write_bytes(bad)
    again = service.monitor(tmp_path, loops(), clock)
    asyncio.run(again.step())
    [aside] = tmp_path.glob("glapp.db.damaged-*Z")
    assert aside.read_bytes() == bad, "not a byte of it is changed"
    [event] = [event for event in again.reader.events() if event["kind"] == "database_damaged"]
    assert aside.name in event["text"]
    fed(again, clock, [value for value in values("FIC0", 200) if value.time >= clock.now])
    asyncio.run(again.save())
    assert len(SignalStore(tmp_path).read("FIC0", BEGIN, BEGIN + 1e6)) > 150, "signals are files of their own"


def foreign(statements: str) -> bytes:
    with closing(sqlite3.connect(":memory:")) as db:
        db.executescript(statements)
        return db.serialize()


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "has 0 bytes"),
        (foreign("CREATE TABLE notes (text TEXT)"), "is none of glapp's: schema 0 without"),
        (foreign(f"CREATE TABLE loops (id); PRAGMA user_version = {SCHEMA}"), f"is none of glapp's: schema {SCHEMA}"),
        (foreign("CREATE TABLE notes (text TEXT); PRAGMA user_version = -3"), "is none of glapp's: schema -3 without"),
    ],
    ids=["0 bytes", "foreign", "foreign of our version", "negative version"],
)
def test_an_empty_or_foreign_file_is_damage_that_is_told(tmp_path: Path, content: bytes, why: str) -> None:
    """A database of 0 bytes was begun anew without a word."""
    clock, path = Clock(), tmp_path / "glapp.db"
    path.write_bytes(content)
    with pytest.raises(InputError, match="is no database of glapp, or an empty file"):
        Reader(tmp_path)
    monitor = service.monitor(tmp_path, loops(), clock)
    fed(monitor, clock, values("FIC0", 20))
    [aside] = tmp_path.glob("glapp.db.damaged-*Z")
    assert aside.read_bytes() == content and monitor.store.found is not None
    [event] = [event for event in monitor.reader.events() if event["kind"] == "database_damaged"]
    assert event["text"].startswith(f"the database {why}") and aside.name in event["text"]
    status = monitor.status()
    assert status["damaged"] == monitor.store.found and status["loops"]["FIC0"]["health"] == "CHECK_FUNCTION"
    monitor.store.close()
    monitor.reader.close()
    with closing(Store(tmp_path)) as again:
        assert again.found is None and again.damaged == event["text"], "told until somebody takes the file away"
        aside.unlink()
        assert again.damaged is None


def test_a_database_that_is_gone_is_told_and_a_new_folder_is_not(tmp_path: Path) -> None:
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(), clock)
    assert monitor.store.found is None and monitor.status()["damaged"] is None
    fed(monitor, clock, values("FIC0", 200))
    asyncio.run(monitor.save())
    monitor.store.close()
    monitor.reader.close()
    (tmp_path / "glapp.db").unlink()
    with closing(Store(tmp_path)) as again:
        assert again.found is not None and "there is no glapp.db next to recorded signals" in again.found


def test_a_later_schema_is_refused_and_left_alone(tmp_path: Path) -> None:
    Store(tmp_path).close()
    db = sqlite3.connect(tmp_path / "glapp.db")
    db.execute("PRAGMA user_version = 99")
    db.close()
    before = (tmp_path / "glapp.db").read_bytes()
    for way in (Store, Reader):
        with pytest.raises(InputError, match="has schema 99"):
            way(tmp_path)
    assert (tmp_path / "glapp.db").read_bytes() == before and FolderLock.holder(tmp_path) is None


def test_an_older_schema_is_brought_up_in_one_transaction(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path)
    store.know(loops())
    store.close()
    more = (*of_memory._MIGRATIONS, "CREATE TABLE more (a TEXT);\nINSERT INTO more VALUES ('x');\n")
    monkeypatch.setattr(of_memory, "_MIGRATIONS", (*more[:-1], more[-1] + "INSERT INTO nothing VALUES (1);\n"))
    monkeypatch.setattr(of_memory, "SCHEMA", len(more))
    with pytest.raises(StoreFull):
        Store(tmp_path)
    monkeypatch.setattr(of_memory, "_MIGRATIONS", more)
    store = Store(tmp_path)
    assert store.loops() == {"FIC0": 1} and store.one("SELECT a FROM more") == {"a": "x"}


@pytest.mark.slow
def test_backup_while_it_is_written_and_restore(tmp_path: Path) -> None:
    clock = Clock()
    folder, copy = tmp_path / "data", tmp_path / "copy.db"
    monitor = service.monitor(folder, loops(), clock)
    given = values("FIC0", 300)
    fed(monitor, clock, [value for value in given if value.time < BEGIN + 150], save_every=8)
    at_copy = detections(folder, "FIC0")
    backup(folder, copy)
    fed(monitor, clock, [value for value in given if value.time >= BEGIN + 150], save_every=8)
    after = detections(folder, "FIC0")
    with pytest.raises(InputError, match="is written by process"):
        restore(folder, copy)
    monitor.store.close()
    monitor.reader.close()
    aside = restore(folder, copy, clock())
    assert aside is not None and aside.is_file()
    assert detections(folder, "FIC0") == at_copy != after
    # Values since then are handed over once more, as a server with history does: none is there twice.
    clock.now = BEGIN + 400
    again = service.monitor(folder, loops(), clock)
    since = again.ingest.since()["FIC0", Signal.PV]
    assert since == BEGIN + 149
    clock = Clock()
    again._clock = clock
    fed(again, clock, [value for value in given if value.time > since])
    asyncio.run(again.save())
    assert detections(folder, "FIC0") == after
    times = SignalStore(folder).read("FIC0", BEGIN, BEGIN + 1e6)["time"].to_pylist()
    assert len(times) == len(set(times)) == 298


def test_a_backup_never_takes_the_place_of_the_database_itself(tmp_path: Path) -> None:
    """Regression: the file under a running service was replaced, and what it wrote from then on was in no file."""
    store = Store(tmp_path)
    with pytest.raises(InputError, match=r"glapp\.db: belongs to the database of .* give the copy another name"):
        backup(tmp_path, tmp_path / "glapp.db")
    with pytest.raises(InputError, match="belongs to the database"):
        backup(tmp_path / ".." / tmp_path.name, tmp_path / "glapp.db-wal")
    backup(tmp_path, tmp_path / "copy.db")
    store.put_user("eve", "viewer", "-", BEGIN)
    store.close()
    with Reader(tmp_path) as reader:
        assert [user["name"] for user in reader.users()] == ["eve"]


def test_two_restores_within_a_second_keep_both_databases(tmp_path: Path) -> None:
    """Regression: the second was put aside under the name of the first, and overwrote it."""
    folder, copy = tmp_path / "data", tmp_path / "copy.db"
    Store(folder).close()
    backup(folder, copy)
    asides = [restore(folder, copy, BEGIN) for _ in range(3)]
    assert len({*asides}) == 3 and all(one is not None and one.is_file() for one in asides)


def test_a_restore_that_is_killed_leaves_a_database(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, copy = tmp_path / "data", tmp_path / "copy.db"
    store = Store(folder)
    store.know(loops())
    store.close()
    backup(folder, copy)

    def killed(*_: Path) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            restore(folder, copy)
    with Reader(folder) as reader:
        assert reader.loops() == {"FIC0": 1}
    assert restore(folder, copy) is not None


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no database at all, but some text" * 200,
        foreign("CREATE TABLE loops (id); PRAGMA user_version = 1"),
    ],
)
def test_what_is_no_backup_is_not_restored(tmp_path: Path, content: bytes) -> None:
    folder, copy = tmp_path / "data", tmp_path / "copy.db"
    store = Store(folder)
    store.know(loops())
    store.close()
    copy.write_bytes(content)
    with pytest.raises(InputError, match=r"copy.db: is (no database of glapp|damaged)"):
        restore(folder, copy)
    with Reader(folder) as reader:
        assert reader.loops() == {"FIC0": 1}


def limited(store: Store, pages: int) -> None:
    """A full disk: SQLite answers as it does when a write fails for lack of space."""
    size = store._db.execute("PRAGMA page_count").fetchone()[0]
    store._db.execute(f"PRAGMA max_page_count = {size + pages}")


@pytest.mark.slow
def test_a_full_disk_is_told_and_what_came_is_put_down_when_there_is_room(tmp_path: Path) -> None:
    clock = Clock()
    straight = service.monitor(tmp_path / "straight", loops(), clock)
    given = values("FIC0", 300)
    fed(straight, clock, given)
    clock = Clock()
    monitor = service.monitor(tmp_path / "full", loops(), clock)
    limited(monitor.store, 3)
    fed(monitor, clock, [value for value in given if value.time < BEGIN + 250], pace=1.0)
    assert monitor.journal.failing is not None and "full" in monitor.journal.failing
    assert monitor.status()["waiting"] > 20
    with pytest.raises(StoreFull):
        asyncio.run(monitor.save())
    assert len(detections(tmp_path / "full", "FIC0")) < len(detections(tmp_path / "straight", "FIC0"))
    limited(monitor.store, 100_000)
    fed(monitor, clock, [value for value in given if value.time >= BEGIN + 250])
    assert monitor.journal.failing is None and monitor.status()["waiting"] == 0
    assert detections(tmp_path / "full", "FIC0") == detections(tmp_path / "straight", "FIC0")
    kinds = [event["kind"] for event in monitor.reader.events()]
    assert kinds.count("memory_full") >= 1 and kinds.count("memory_again") == 1
    monitor.store.close()
    assert sqlite3.connect(tmp_path / "full" / "glapp.db").execute("PRAGMA integrity_check").fetchone() == ("ok",)


@pytest.mark.slow
def test_what_waits_for_a_full_disk_is_bounded_and_what_is_given_up_is_told(tmp_path: Path) -> None:
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(), clock, backlog=20)
    limited(monitor.store, 3)
    fed(monitor, clock, [value for value in values("FIC0", 300) if value.time < BEGIN + 250], pace=1.0)
    assert monitor.status()["waiting"] <= 21
    limited(monitor.store, 100_000)
    fed(monitor, clock, [value for value in values("FIC0", 300) if value.time >= BEGIN + 250])
    assert [event for event in monitor.reader.events() if event["kind"] == "given_up" and "values" in event["text"]]
    shown = monitor.status()["loops"]["FIC0"]
    monitor.store.close()
    again = service.monitor(tmp_path, loops(), clock)
    now = again.status()["loops"]["FIC0"]
    assert (now["half_periods"], now["estimate"]) == (shown["half_periods"], shown["estimate"])


def test_a_disk_without_room_for_signals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(), clock)
    fed(monitor, clock, values("FIC0", 60))
    monkeypatch.setattr("pyarrow.parquet.ParquetWriter.write_table", _full)
    with pytest.raises(OSError, match="No space left"):
        asyncio.run(monitor.save())
    assert not [*tmp_path.rglob("*.part")] and not [*tmp_path.rglob("*.parquet")]
    monkeypatch.undo()
    asyncio.run(monitor.save())
    assert len(SignalStore(tmp_path).read("FIC0", BEGIN, BEGIN + 1e6)) == 58


def _full(*_: object) -> None:
    with Path("/dev/full").open("wb", buffering=0) as file:
        file.write(b"x")


# Signals


@pytest.mark.slow
def test_days_become_files_that_analyze_reads(tmp_path: Path) -> None:
    begin = BEGIN + 46_400.0 - 150.0  # into the next day
    clock = Clock(begin)
    monitor = service.monitor(tmp_path, loops(2), clock)
    fed(monitor, clock, values("FIC0", 300, begin=begin) + values("FIC1", 300, begin=begin, seed=3), save_every=12)
    asyncio.run(monitor.save())
    signals = monitor.journal.signals
    whole = {name: signals.read(name, begin, begin + 300) for name in ("FIC0", "FIC1")}
    assert len(whole["FIC0"]) == 298
    assert signals.close_days(begin + 301) == signals.days("FIC0")[:1]
    assert signals.close_days(begin + 301) == []
    for name, table in whole.items():
        assert SignalStore(tmp_path).read(name, begin, begin + 300).equals(table)
    first = tmp_path / "signals" / str(signals.days("FIC0")[0]) / "FIC0.parquet"
    [recording] = glapp.open_recordings(first)
    assert recording.columns.keys() >= {"time", "SP", "PV", "OP", "MODE"} and recording.zone == "UTC"
    batch = recording.beginning(1000)
    assert batch.flags is None and batch.pv.tolist() == whole["FIC0"]["PV"].to_pylist()[:150]
    recordings = signals.recordings(loops()[0], begin, begin + 300)
    assert [len(one.beginning(10**6)) for one in recordings] == [150, 148]
    signals.close_days(begin + 87_000.0)
    assert not [*(tmp_path / "signals" / "open").glob("*.parquet")]
    assert signals.forget(2) == []
    assert signals.forget(1) == [first.parent.name]
    assert len(signals.days("FIC0")) == 1


def test_a_clock_that_is_years_ahead_takes_no_signals(tmp_path: Path) -> None:
    """Regression: an hour with the clock in 2046 took all recordings."""
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(), clock)
    fed(monitor, clock, values("FIC0", 50))
    asyncio.run(monitor.save())

    async def an_hour() -> None:
        tidying = asyncio.create_task(monitor.journal.tidy())
        while not any(event.kind == "signals_closed" for event in monitor.journal._events):
            await asyncio.sleep(0.01)
        tidying.cancel()

    clock.now += 20 * 365 * 86_400.0
    asyncio.run(an_hour())
    assert [*(tmp_path / "signals").glob("*/FIC0.parquet")] and len(SignalStore(tmp_path).days("FIC0")) == 1


def test_parts_of_a_day_that_was_put_together_before_are_added_once(tmp_path: Path) -> None:
    """A day's file is there already; the process ends after the file, before the part goes: nothing is there twice."""
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(), clock)
    given = values("FIC0", 120)
    fed(monitor, clock, [value for value in given if value.time < BEGIN + 60])
    asyncio.run(monitor.save())
    later = BEGIN + 2 * 86_400.0
    monitor.journal.signals.close_days(later)
    fed(monitor, clock, [value for value in given if value.time >= BEGIN + 60])
    asyncio.run(monitor.save())
    [part] = (tmp_path / "signals" / "open").glob("*.parquet")
    content = part.read_bytes()
    whole = monitor.journal.signals.read("FIC0", BEGIN, later)
    monitor.journal.signals.close_days(later)
    part.write_bytes(content)
    assert monitor.journal.signals.read("FIC0", BEGIN, later).equals(whole) and len(whole) == 118
    monitor.journal.signals.close_days(later)
    assert monitor.journal.signals.read("FIC0", BEGIN, later).equals(whole) and not part.exists()


@pytest.mark.parametrize("name", ["FIC 101/A", "..", "../../etc/passwd", ".hidden", "Å\\:*", "C:\\x"])
def test_no_name_of_a_loop_leads_out_of_the_folder(tmp_path: Path, name: str) -> None:
    clock = Clock()
    loop = loops()[0].model_copy(update={"name": name})
    monitor = service.monitor(tmp_path / "data", [loop], clock)
    fed(monitor, clock, values(name, 40))
    asyncio.run(monitor.save())
    monitor.journal.signals.close_days(BEGIN + 2 * 86_400.0)
    [file] = (tmp_path / "data" / "signals").glob("2026-*/*.parquet")
    assert loop_of(file.name) == name and len(monitor.journal.signals.read(name, BEGIN, BEGIN + 100)) == 38
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


# Events are reported, but not a thousand times


def test_what_happens_again_and_again_is_told_once_a_minute_with_its_count(tmp_path: Path) -> None:
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(), clock)
    for k in range(200):
        clock.now = BEGIN + k
        monitor.tell(Event(clock.now, "FIC0", "late", f"number {k}"))
    asyncio.run(monitor.step())
    texts = [event["text"] for event in monitor.reader.events("FIC0")]
    assert len(texts) == 4 and texts[0].startswith("number 180 (and 59 times more")
    for later in (1000.0, 1001.0, 1100.0):
        monitor.tell(Event(BEGIN + later, "FIC0", "lost", "twice"))
    asyncio.run(monitor.step())
    assert monitor.reader.events("FIC0")[0]["text"] == "twice (and once more since)"


def test_the_last_of_a_minute_is_told_when_it_is_over(tmp_path: Path) -> None:
    """Regression: lost, connected, lost within a minute was told as lost, connected: it stayed so for hours."""
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(), clock)
    for later, kind in ((0.0, "lost"), (20.0, "connected"), (30.0, "lost"), (40.0, "lost")):
        clock.now = BEGIN + later
        monitor.tell(Event(clock.now, None, kind, f"{kind} after {later:g} s"))
    asyncio.run(monitor.step())
    assert [event["text"] for event in monitor.reader.events()] == ["connected after 20 s", "lost after 0 s"]
    clock.now = BEGIN + 61.0
    asyncio.run(monitor.step())
    assert monitor.reader.events()[0]["text"] == "lost after 40 s (and once more since)"
    clock.now = BEGIN + 200.0
    asyncio.run(monitor.step())
    assert len(monitor.reader.events()) == 3, "it is told once"


def test_a_save_waits_for_the_step_under_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: a change of a parameter was refused on a busy computer, as if the store could not be written."""
    clock = Clock()
    monitor, some = service.monitor(tmp_path, loops(), clock), values("FIC0", 20)
    write = monitor.journal.write

    async def slow(now: float) -> None:
        await asyncio.sleep(0.05)
        await write(now)
        monitor.ingest.take(some[30:])

    async def both() -> None:
        await asyncio.gather(monitor.save(), monitor.step())

    monkeypatch.setattr(monitor.journal, "write", slow)
    monitor.ingest.take(some[:30])
    asyncio.run(both())
    assert not monitor.journal.waiting


def test_values_of_a_loop_that_is_not_watched_are_left_out(tmp_path: Path) -> None:
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(), clock)
    fed(monitor, clock, [Value("OTHER", Signal.PV, BEGIN, 1.0, True)])
    assert monitor.reader.loops() == {"FIC0": 1} and list(monitor.loops) == ["FIC0"]
