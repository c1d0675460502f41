"""What a thousand loops by OPC UA cost the one who listens: `python -m bench.opcua [loops] [seconds]`.

The plant is a process of its own. What this process needs is split in two: `asyncua`, which unpacks messages, and what
glapp does with the values. Both are processor time, so other work on the machine changes them little.
"""

from __future__ import annotations

import asyncio
import contextlib
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from glapp.reading.settings import read_settings
from glapp.service.connection import read_connection
from glapp.service.opcua import OpcUa
from glapp.service.plant import free_port
from glapp.service.signal import Event, Value

__all__ = ["measure"]


class _Measured(OpcUa):
    """Counts the processor time between a message and the values that were made of it."""

    own = 0.0

    def _values(self, items, *, live):  # type: ignore[no-untyped-def]
        begun = time.thread_time()
        values = super()._values(items, live=live)
        self.own += time.thread_time() - begun
        return values


async def _listen(settings: Path, seconds: float) -> dict[str, float]:
    connection = read_connection(settings)
    assert connection is not None
    source = _Measured(connection, read_settings(settings))
    count, latest, late = 0, 0.0, []
    events: list[Event] = []

    def take(values: list[Value]) -> None:
        nonlocal count, latest
        count += len(values)
        latest = max(latest, values[-1].time)
        late.append(time.time() - values[-1].time)

    task = asyncio.create_task(source.run(take, events.append))
    while not count:
        await asyncio.sleep(0.5)
    await asyncio.sleep(5.0)
    count, source.own, cpu, begun = 0, 0.0, time.process_time(), time.monotonic()
    late.clear()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    await asyncio.sleep(seconds)
    cpu, passed = time.process_time() - cpu, time.monotonic() - begun
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task
    for event in events:
        print(f"  {event.kind}: {event.text}")
    late.sort()
    return {
        "values/s": count / passed,
        "share of one core": cpu / passed,
        "of it asyncua": 1.0 - source.own / cpu,
        "µs a value": 1e6 * cpu / count,
        "µs a value, glapp": 1e6 * source.own / count,
        "values/s a core could take": count / cpu,
        "delay, median [s]": late[len(late) // 2],
        "delay, greatest [s]": late[-1],
        "memory grew [MB]": (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory) / 1024,
    }


def measure(loops: int, seconds: float) -> dict[str, float]:
    """Listen to a simulated plant of so many loops at 1 Hz, each with SP, PV, OP, mode and limit flags."""
    with TemporaryDirectory() as folder:
        settings = Path(folder) / "loops.toml"
        words = ["plant", "--loops", str(loops), "--port", str(free_port()), "--settings", str(settings), "--fresh"]
        command = [sys.executable, "-c", "from glapp.cli import main; main()", *words, "--history", "0"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as plant:
            try:
                assert plant.stdout is not None
                plant.stdout.readline()
                return asyncio.run(_listen(settings, seconds))
            finally:
                plant.terminate()


if __name__ == "__main__":
    numbers = [float(word) for word in sys.argv[1:]]
    for name, value in measure(int(numbers[0]) if numbers else 1000, numbers[1] if len(numbers) > 1 else 60.0).items():
        print(f"{name:28} {value:.4g}")
