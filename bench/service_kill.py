"""A monitor beside a plant, killed again and again: its data are those of a monitor without a kill.

Whatever it took in is kept beside by the database itself, in the transaction in which it was put down. After the last
kill all of that is handed to one monitor more, cut into other pieces, which runs through and is never ended: both must
have the same half-periods, samples and answers, bit for bit. Half of the kills wait until it writes, so that enough of
them fall within a transaction.

    python -m bench.service_kill --kills 100

The plant's server has history. So another service stands beside, from the same folder on, which nobody kills: it must
have the same, too, up to the moment at which the first of the two was stopped.

    python -m bench.service_kill --without-history --kills 20

Nothing can be read afterwards: what was told in a break is missing. So what was taken in is held against what the
plant told: no other value, none twice, and none missing but between a kill, or a connection that was lost, and the
first value after it. That one monitor more is then the uninterrupted one with this signal and these gaps.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import json
import math
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading.settings import parse_settings
from glapp.service.connection import Connection
from glapp.service.fits import answered
from glapp.service.monitor import Monitor
from glapp.service.options import MonitorOptions
from glapp.service.plant import SimPlant
from glapp.service.recordings import SignalStore
from glapp.service.resampler import CODES, LOST
from glapp.service.signal import Signal
from glapp.service.store import COLUMNS, Entry, Reader, Store

SCAN = 0.5
GAP = 3.0 * SCAN
"""More than that between two samples no half-period goes on across [s]."""

LONGEST = 600.0
"""Longest time until a monitor has begun, or ended, on a busy machine [s]."""

FITTED = 5
"""Number of loops that are fitted, one of each kind."""

PIECES = 20_000
"""Largest number of values that the monitor that runs through takes at once."""

_KEPT = """CREATE TABLE IF NOT EXISTS taken (id INTEGER PRIMARY KEY, now REAL, body BLOB);
CREATE TRIGGER IF NOT EXISTS take AFTER INSERT ON entries
BEGIN INSERT INTO taken VALUES (new.id, new.now, new.body); END;"""


class _Telling(Store):
    """A store that keeps its entries, and reports the begin and end of each write."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._db.executescript(_KEPT)

    def _writing(self) -> Any:
        return _told(super()._writing())


@contextlib.contextmanager
def _told(writing: Any) -> Any:
    sys.stdout.write("w")
    sys.stdout.flush()
    with writing:
        yield
    sys.stdout.write(".")
    sys.stdout.flush()


async def _child(folder: Path, url: str) -> None:
    from glapp.service.opcua import OpcUa

    loops = parse_settings((folder / "loops.toml").read_text(), "loops.toml", folder)
    monitor = Monitor(loops, _Telling(folder), options=MonitorOptions(step=0.2, save=2.0))
    task = asyncio.ensure_future(
        monitor.run(OpcUa(Connection(url=url, interval=0.5), loops, since=monitor.ingest.since()))
    )
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task
    monitor.store.close()


def _start(folder: Path, url: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "bench.service_kill", "--child", str(folder), url]
    return subprocess.Popen(command, stdout=(folder / "said").open("wb"))


async def _writes(folder: Path, count: int) -> None:
    """Wait until a monitor has written so often."""
    until = time.monotonic() + LONGEST
    while (folder / "said").read_bytes().count(b".") < count:
        if time.monotonic() > until:
            raise SystemExit(f"the monitor has not begun in {LONGEST:g} s")
        await asyncio.sleep(0.05)


def _while_it_writes(folder: Path) -> None:
    """Wait until a monitor is within a write, two seconds at most: by chance it seldom is."""
    until = time.monotonic() + 2.0
    with (folder / "said").open("rb") as written:
        while time.monotonic() < until:
            written.seek(-1, 2)
            if written.read(1) == b"w":
                return


def _stop(child: subprocess.Popen[bytes]) -> None:
    child.terminate()
    if child.wait(LONGEST) != 0:
        raise SystemExit(f"a monitor ended with {child.returncode}")


class _RecordedPlant(SimPlant):
    """A plant that records the times and values that it sent of each tag."""

    def __init__(self, loops: int, history: float) -> None:
        super().__init__(loops, scan=SCAN, history=history)
        self.sent: dict[tuple[str, Signal], dict[float, float]] = {}

    async def _write(self, key: tuple[str, Signal], t: float, value: float, *more: Any) -> None:
        self.sent.setdefault(key, {})[t] = value
        await super()._write(key, t, value, *more)


async def _killed(root: Path, plant: _RecordedPlant, count: int, chance: random.Random, *, beside: bool) -> float:
    """Kill a monitor so often in `root/killed`; gives the plant's time up to which one beside can have everything."""
    straight, killed = root / "straight", root / "killed"
    async with plant:
        straight.mkdir()
        (straight / "loops.toml").write_text(plant.settings())
        child = _start(straight, plant.url)
        await _writes(straight, 30)
        await asyncio.to_thread(_stop, child)
        shutil.copytree(straight, killed)
        began = plant.time
        others = [_start(straight, plant.url)] if beside else []
        within = 0
        for kill in range(count):
            child = _start(killed, plant.url)
            await _writes(killed, 3)  # what comes then is the history since the last kill
            await asyncio.sleep(chance.uniform(0.0, 4.0))
            if chance.random() < 0.5:
                _while_it_writes(killed)
            child.kill()
            child.wait()
            within += (killed / "said").read_bytes()[-1:] == b"w"
            print(f"\r{kill + 1} kills, {within} within a write", end="", flush=True)
        child = _start(killed, plant.url)
        await _writes(killed, 50)
        ended = plant.time - 10.0
        await asyncio.gather(*(asyncio.to_thread(_stop, one) for one in (child, *others)))
    print(f"\nplant's time {ended - began:.0f} s")
    return ended


def _kills(count: int, loops: int, seed: int, history: float) -> None:
    with tempfile.TemporaryDirectory() as name:
        root, chance, plant = Path(name), random.Random(seed), _RecordedPlant(loops, history)
        ended = asyncio.run(_killed(root, plant, count, chance, beside=history > 0.0))
        known = parse_settings(plant.settings(), "loops.toml", root)
        if history:
            print("beside the one that nobody killed:")
            _compare(known, root / "straight", root / "killed", ended)
        else:
            _breaks(root / "killed", plant.sent, count)
        print("beside one that ran through with what was taken in:")
        _run_through(known, root / "killed", root / "through", chance)
        _compare(known, root / "through", root / "killed", math.inf)


def _taken(folder: Path) -> list[Entry]:
    """Everything that a monitor took in and put down, in its order."""
    with Reader(folder) as reader:
        return [Entry.unpacked(*row.values()) for row in reader.rows("SELECT id, now, body FROM taken ORDER BY id")]


def _breaks(killed: Path, sent: dict[tuple[str, Signal], dict[float, float]], kills: int) -> None:
    """Missing and extra entries of the store compared with the plant, and half-periods across a break."""
    with Reader(killed) as reader:
        names = {id: name for name, id in reader.loops().items()}
        lost = sum(event["kind"] == "lost" for event in reader.events(most=1_000_000))
        signals = {code: signal for signal, code in CODES.items()}
        taken: dict[tuple[str, Signal], dict[float, float]] = {}
        parts: dict[str, list[list[float]]] = {name: [[]] for name in names.values()}  # of PV, between the breaks
        other = 0
        for entry in _taken(killed):
            columns = (entry.loop, entry.signal, entry.time, entry.value)
            for id, code, t, value in zip(*(column.tolist() for column in columns), strict=True):
                name = names[id]
                if code == LOST:
                    parts[name].append([])
                elif code in signals:
                    key = name, signals[code]
                    other += sent[key].get(t) != value or t in taken.setdefault(key, {})
                    taken.setdefault(key, {})[t] = value
                    if key[1] is Signal.PV:
                        parts[name][-1].append(t)
        breaks = missing = unexplained = invented = across = 0
        for name, pieces in parts.items():
            some = [piece for piece in pieces if piece]
            gaps = [(a[-1], b[0]) for a, b in itertools.pairwise(some)]
            of_pv = taken[name, Signal.PV]
            gone = [t for t in sent[name, Signal.PV] if min(of_pv) < t < max(of_pv) and t not in of_pv]
            breaks, missing = breaks + len(gaps), missing + len(gone)
            unexplained += sum(not any(a < t < b for a, b in gaps) for t in gone)
            samples = SignalStore(killed).read(name, 0.0, math.inf)["time"].to_pylist()
            invented += sum(at.timestamp() not in of_pv for at in samples)
            halves = reader.half_periods(name)
            across += sum(row["t_start"] < b and row["t_end"] > a for row in halves for a, b in gaps if b - a > GAP)
    most = (kills + 1 + lost) * len(names)
    print(f"{sum(map(len, taken.values()))} values taken in, {other} of them twice or other than the plant told;")
    print(f"{missing} of PV missing in {breaks} breaks, where {kills} kills, a stop and {lost} lost connections make")
    print(f"{most} at most in {len(names)} loops; {unexplained} missing elsewhere; {invented} samples of no value;")
    print(f"{across} half-periods accepted across a gap")


def _pieces(entries: list[Entry], chance: random.Random) -> Iterator[Entry]:
    """The values in their order, cut at other places; a lost value begins a piece, as it began an entry."""
    columns = [
        np.concatenate([getattr(e, name) for e in entries]) for name in ("loop", "signal", "good", "time", "value")
    ]
    now = np.concatenate([np.full(len(entry.loop), entry.now) for entry in entries])
    ends = np.flatnonzero(np.diff((columns[1] == LOST).astype(int)) == 1) + 1
    at = number = 0
    while at < len(now):
        to = min([at + chance.choice((1, 7, 40, 300, PIECES)), *ends[ends > at][:1].tolist()])
        number += 1
        yield Entry(number, float(now[at:to].max()), *(column[at:to] for column in columns))
        at = to


def _run_through(known: list[Loop], killed: Path, folder: Path, chance: random.Random) -> None:
    """Run one monitor without an end on the entries of the killed one."""
    monitor = Monitor(known, Store(folder))
    for piece in _pieces(_taken(killed), chance):
        monitor.store.add([], monitor.ingest.process(piece)[0], [])
        monitor.journal.position = piece.id
    asyncio.run(monitor.save())
    monitor.store.close()


def _compare(known: list[Loop], straight: Path, killed: Path, ended: float) -> None:
    """Half-periods, samples and answers of both, bit for bit."""
    with Reader(straight) as one, Reader(killed) as other:
        halves = differ = samples = other_samples = 0
        for name in one.loops():
            a, b = (
                [tuple(row[key] for key in ("number", *COLUMNS)) for row in rows]
                for rows in (r.half_periods(name, -1e300, min(ended, 1e300), accepted=False) for r in (one, other))
            )
            halves += len(a)
            if a != b:
                differ += 1
                at = next((i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
                print(f"{name} differs: {len(a)} and {len(b)} half-periods, from number {at + 1} on")
                print("  ", a[at : at + 1], b[at : at + 1], sep="\n  ")
            tables = [
                SignalStore(folder).read(name, 0.0, ended).drop_columns(["U_FF"]) for folder in (straight, killed)
            ]
            samples += len(tables[0])
            other_samples += not tables[0].equals(tables[1])
        print(f"{halves} half-periods, {differ} loops differ; {samples} samples, {other_samples} loops differ")
        for row in reversed(other.events(most=100_000)):
            if row["kind"] in ("database_damaged", "given_up", "not_backfilled"):
                print(row)
        print("whole:", one.one("PRAGMA quick_check"), other.one("PRAGMA quick_check"))
    answers = [[_said(folder, loop, ended) for loop in known[:FITTED]] for folder in (straight, killed)]
    same = sum(a == b for a, b in zip(*answers, strict=True))
    verdicts = ", ".join(f"{loop.name} {one}" for loop, (one, _) in zip(known, answers[1], strict=False))
    print(f"{same} of {len(answers[0])} answers are the same: {verdicts}", flush=True)


def _said(folder: Path, loop: Loop, ended: float) -> tuple[str, str]:
    """The verdict of a fit of all that is kept of a loop, and the whole of its answer."""
    try:
        found = answered(folder, loop.model_dump_json(exclude_unset=True), 0.0, ended)
    except InputError as error:
        return "refused", str(error)
    return found["verdict"], json.dumps(found, sort_keys=True)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--loops", type=int, default=20)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--without-history", action="store_true", help="the server has none")
    parser.add_argument("--child", nargs=2, metavar=("DIR", "URL"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.child:
        asyncio.run(_child(Path(asked.child[0]), asked.child[1]))
    else:
        _kills(asked.kills, asked.loops, asked.seed, 0.0 if asked.without_history else 7200.0)


if __name__ == "__main__":
    main()
