"""A watch beside a plant, killed again and again; its half-periods beside those of one that nobody kills.

Both begin from the same folder. The plant's server has history. After the last kill the killed one is let run until it
has caught up, and everything that both have is compared bit for bit, up to the moment at which the first of them was
stopped. Half of the kills
wait until it writes, so that enough of them fall within a transaction.

    python -m bench.service_kill --kills 100

With `--without-history` nothing can be read afterwards: what the killed one has must then be a part of what the other
has, with breaks where it was killed, and no half-period may have been accepted across one that a detector does not
bridge.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from glapp.reading.settings import parse_settings
from glapp.service.connection import Connection
from glapp.service.memory import COLUMNS, Memory, Reader
from glapp.service.recordings import Signals
from glapp.service.watch import Bounds, Watch

SCAN = 0.5
GAP = 3.0 * SCAN
"""More than that between two samples no half-period goes on across [s]."""


class _Telling(Memory):
    """A memory that says when it writes and when it has written."""

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
    watch = Watch(loops, _Telling(folder), bounds=Bounds(step=0.2, save=2.0))
    task = asyncio.ensure_future(watch.run(OpcUa(Connection(url=url, interval=0.5), loops, since=watch.since())))
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task
    watch.memory.close()


def _start(folder: Path, url: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "bench.service_kill", "--child", str(folder), url]
    return subprocess.Popen(command, stdout=(folder / "said").open("wb"))


async def _writes(folder: Path, count: int) -> None:
    """Wait until a watch has written so often."""
    for _ in range(600):
        if (folder / "said").read_bytes().count(b".") >= count:
            return
        await asyncio.sleep(0.05)
    raise SystemExit("the watch has not begun in 30 s")


def _while_it_writes(folder: Path) -> None:
    """Wait until a watch is within a write, two seconds at most: by chance it seldom is."""
    until = time.monotonic() + 2.0
    with (folder / "said").open("rb") as said:
        while time.monotonic() < until:
            said.seek(-1, 2)
            if said.read(1) == b"w":
                return


def _stop(child: subprocess.Popen[bytes]) -> None:
    child.terminate()
    if child.wait(60) != 0:
        raise SystemExit(f"a watch ended with {child.returncode}")


async def _kills(count: int, loops: int, seed: int, history: float) -> None:
    from glapp.service.plant import SimPlant

    with tempfile.TemporaryDirectory() as name:
        root, chance = Path(name), random.Random(seed)
        async with SimPlant(loops, scan=SCAN, history=history) as plant:
            straight, killed = root / "straight", root / "killed"
            straight.mkdir()
            (straight / "loops.toml").write_text(plant.settings())
            child = _start(straight, plant.url)
            await _writes(straight, 30)
            await asyncio.to_thread(_stop, child)
            shutil.copytree(straight, killed)
            began = plant.time
            beside = _start(straight, plant.url)
            within = done = 0
            kills = []
            while done < count:
                child = _start(killed, plant.url)
                await _writes(killed, 3)  # what comes then is the history since the last kill
                await asyncio.sleep(chance.uniform(0.0, 4.0))
                if chance.random() < 0.5:
                    _while_it_writes(killed)
                child.kill()
                kills.append(plant.time)
                child.wait()
                done += 1
                within += (killed / "said").read_bytes()[-1:] == b"w"
                print(f"\r{done} kills, {within} within a write", end="", flush=True)
            child = _start(killed, plant.url)
            await _writes(killed, 50)
            ended = plant.time - 10.0
            await asyncio.gather(asyncio.to_thread(_stop, child), asyncio.to_thread(_stop, beside))
        print(f"\nplant's time {ended - began:.0f} s, {loops} loops")
        if history:
            _compare(straight, killed, began, ended)
        else:
            _breaks(straight, killed, began, ended, kills)


def _breaks(straight: Path, killed: Path, began: float, ended: float, kills: Sequence[float]) -> None:
    """What is missing of what was killed, and whether anything goes across it."""
    breaks = known = missing = other = across = unexplained = 0
    with Reader(killed) as reader:
        for name in reader.loops():
            whole, part = (
                Signals(folder).read(name, began, ended).drop_columns(["U_FF"]).to_pydict()
                for folder in (straight, killed)
            )
            rows = [
                dict(zip(map(_seconds, table["time"]), zip(*list(table.values())[1:], strict=True), strict=True))
                for table in (whole, part)
            ]
            assert len(rows[1]) == len(part["time"]), f"{name}: a sample is there twice"
            known += len(rows[1])
            missing += len(rows[0].keys() - rows[1].keys())
            other += sum(repr(rows[0].get(at)) != repr(row) for at, row in rows[1].items())
            times = sorted(rows[1])
            found = [(a, b) for a, b in itertools.pairwise(times) if b - a > GAP]
            breaks += len(found)
            unexplained += sum(not any(a - 10.0 <= at <= b for at in kills) for a, b in found)
            halves = reader.half_periods(name, began, ended, accepted=True)
            across += sum(row["t_start"] < b and row["t_end"] > a for row in halves for a, b in found)
    print(f"{known} samples of the killed one, {other} other than those beside; {missing} missing, in {breaks} breaks,")
    print(f"{unexplained} of them without a kill; {across} half-periods accepted across a break")


def _seconds(at: Any) -> float:
    moment: float = at.timestamp()
    return moment


def _compare(straight: Path, killed: Path, began: float, ended: float) -> None:
    with Reader(straight) as one, Reader(killed) as other:
        halves = differ = 0
        for name in one.loops():
            a, b = (
                [tuple(row[key] for key in ("number", *COLUMNS)) for row in rows]
                for rows in (r.half_periods(name, -1e300, ended, accepted=False) for r in (one, other))
            )
            halves += len(a)
            if a != b:
                differ += 1
                at = next((i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
                print(f"{name} differs: {len(a)} and {len(b)} half-periods, from number {at + 1} on")
                print("  ", a[at : at + 1], b[at : at + 1], sep="\n  ")
        samples = other_samples = 0
        for name in one.loops():
            tables = [Signals(folder).read(name, began - 20.0, ended) for folder in (straight, killed)]
            samples += len(tables[0])
            other_samples += not tables[0].drop_columns(["U_FF"]).equals(tables[1].drop_columns(["U_FF"]))
        print(f"{halves} half-periods, {differ} loops differ; {samples} samples, {other_samples} loops differ")
        for row in reversed(other.events(most=400)):
            if row["kind"] in ("database_damaged", "given_up", "not_backfilled"):
                print(row)
        print("whole:", one.one("PRAGMA quick_check"), other.one("PRAGMA quick_check"))


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
        asyncio.run(_kills(asked.kills, asked.loops, asked.seed, 0.0 if asked.without_history else 7200.0))


if __name__ == "__main__":
    main()
