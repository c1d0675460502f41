"""A monitor in a process of its own, to be killed: it goes on where the store ends, and prints its steps."""

import asyncio
import math
import sys
from pathlib import Path

import service
from service import BEGIN, Clock, loops, values

from glapp.service.monitor import Monitor
from glapp.service.options import MonitorOptions
from glapp.service.store import Store


class _Telling(Store):
    """A store that says when it writes."""

    def _writing(self):  # type: ignore[no-untyped-def]
        print("writing", flush=True)
        return super()._writing()


def main(folder: Path, seconds: int, save_every: int) -> None:
    clock = Clock()
    monitor = Monitor(loops(2), _Telling(folder, BEGIN), options=MonitorOptions(), clock=clock)
    since = monitor.ingest.since()
    given = [
        value
        for i, name in enumerate(monitor.loops)
        for value in values(name, seconds, seed=i + 1)
        if value.time > since.get((value.loop, value.signal), -math.inf)
    ]
    print("begun", flush=True)
    service.fed(monitor, clock, given, save_every=save_every, pace=1.0)
    asyncio.run(monitor.save())
    monitor.store.close()
    print("done", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
