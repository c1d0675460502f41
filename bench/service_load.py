"""Cost of the whole service for a thousand loops at 1 Hz: `python -m bench.service_load [loops] [seconds]`.

The plant is a process of its own. This process connects by OPC UA, and runs rows, detectors and memory; what it needs
of the processor is told in parts. A plant that gets too little of the processor falls behind the clock, and tells later
what it has to tell: what it sent is known from its own time stamps.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import resource
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from glapp.reading.settings import read_settings
from glapp.service.connection import read_connection
from glapp.service.ingest import Ingest
from glapp.service.monitor import Monitor
from glapp.service.opcua import OpcUa
from glapp.service.options import MonitorOptions
from glapp.service.plant import free_port
from glapp.service.signal import Signal
from glapp.service.store import Store

SENT = 6
"""Values of a loop that the plant tells in a scan of a second: SP, PV, OP, mode, two limit flags."""


class _Measured(Ingest):
    """Counts the processor time of its parts."""

    took = 0.0
    processed = 0.0
    count = 0

    def take(self, values: Any) -> None:
        begun = time.thread_time()
        super().take(values)
        self.took += time.thread_time() - begun
        self.count += len(values)

    def process(self, entry: Any) -> Any:
        """Process an entry, and count the processor time."""
        begun = time.thread_time()
        found = super().process(entry)
        self.processed += time.thread_time() - begun
        return found


def _reached(monitor: Monitor) -> list[float]:
    """The plant's time of each loop's newest PV."""
    return [one.latest[Signal.PV].time for one in monitor.loops.values() if Signal.PV in one.latest]


def _resident() -> float:
    """Present memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


def _used(process: int) -> float:
    """Processor time of another process [s]."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def _watch(settings: Path, folder: Path, seconds: float, plant: int) -> None:
    connection, loops = read_connection(settings), read_settings(settings)
    assert connection is not None
    connection = connection.model_copy(update={"timeout": 30.0})  # a plant without a processor answers late
    monitor = Monitor(loops, Store(folder), options=MonitorOptions(save=60.0))
    monitor.ingest = ingest = _Measured(monitor.loops, time.time)
    task = asyncio.create_task(monitor.run(OpcUa(connection, loops)))
    while not ingest.count and not task.done():
        await asyncio.sleep(0.5)
    await asyncio.sleep(15.0)
    ingest.took = ingest.processed = ingest.count = 0
    began_at = sum(_reached(monitor))
    cpu, theirs, begun = time.process_time(), _used(plant), time.monotonic()
    memory = [_resident()]
    while time.monotonic() - begun < seconds and not task.done():
        await asyncio.sleep(min(60.0, seconds / 4))
        memory.append(_resident())
        passed, reached = time.monotonic() - begun, _reached(monitor)
        print(
            f"{passed:5.0f} s: {ingest.count / passed:.0f} values/s of "
            f"{SENT * (sum(reached) - began_at) / passed:.0f} sent, "
            f"{(time.process_time() - cpu) / passed:.1%} of a core, of that {ingest.took / passed:.1%} taking, "
            f"{ingest.processed / passed:.1%} resamplers and detectors; "
            f"{memory[-1]:.0f} MB, {monitor.status()['waiting']} entries wait; "
            f"the plant {(_used(plant) - theirs) / passed:.1%}, {time.time() - min(reached):.0f} s behind the clock",
            flush=True,
        )
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task
    kinds = Counter(event["kind"] for event in monitor.reader.events(most=1_000_000))
    print("told:", ", ".join(f"{kind} {count} times" for kind, count in kinds.items()))
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    print(f"{size / 2**20:.1f} MB on disk")
    monitor.store.close()


def main() -> None:
    """Watch a simulated plant."""
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    numbers = [float(word) for word in sys.argv[1:]]
    loops, seconds = int(numbers[0]) if numbers else 1000, numbers[1] if len(numbers) > 1 else 120.0
    with TemporaryDirectory() as name:
        settings = Path(name) / "loops.toml"
        words = ["plant", "--loops", str(loops), "--port", str(free_port()), "--settings", str(settings), "--fresh"]
        command = [sys.executable, "-c", "from glapp.cli import main; main()", *words, "--history", "0"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as plant:
            try:
                assert plant.stdout is not None
                plant.stdout.readline()
                asyncio.run(_watch(settings, Path(name) / "data", seconds, plant.pid))
            finally:
                plant.terminate()


if __name__ == "__main__":
    main()
