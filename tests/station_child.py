"""A service with three loops and the window on it, in a process of its own; a word on stdin makes something happen."""

import asyncio
import json
import sys
import time
from pathlib import Path
from typing import Any

import service
from argon2 import PasswordHasher
from service import loops, values

from glapp import Loop
from glapp.fit import Fit, Verdict
from glapp.service.api import ApiServer
from glapp.service.api import app_of as service_app
from glapp.service.monitor import Monitor
from glapp.service.options import MonitorOptions
from glapp.service.signal import Event, Signal, Value
from glapp.service.store import COLUMNS, Store
from glapp.service.users import Users
from glapp.service.watchdog import WATCHDOG_SEEN
from glapp.station.app import app_of
from glapp.station.client import ApiClient
from glapp.station.pages import Station
from glapp.station.view import View

PASSWORDS = {"vera": "viewer-password", "olaf": "operator-password", "eve": "engineer-password"}
ROLES = {"vera": "viewer", "olaf": "operator", "eve": "engineer"}
CHEAP = PasswordHasher(time_cost=1, memory_cost=8, parallelism=1)


def answer(verdict: Verdict, d: float, low: float, high: float, acceptable: float | None) -> dict[str, object]:
    """A row of `answers`, whose document has the one answer of such a fit."""
    loop = Loop(name="FIC0", op_span=(0, 100), acceptable_dead_band=acceptable)
    row = service.answered(Fit(verdict, "", "%", d, low, high, lr_no_gap=90.0, lr_needed=15.0), loop)
    return {"time": time.time(), "asked_by": "the night"} | row


FULL = "glapp.db cannot be written: database or disk is full"
"""What a service with a full disk says."""

EVIL = "FIC\u202e9\u200b\x1b[31m\u2066<b>"
"""A name with turns of direction, an invisible mark and an escape."""


def made(folder: Path, count: int = 3) -> tuple[Monitor, Users]:
    """A monitor over a folder whose first loop has detections until now, and two of which were fitted."""
    begin = float(int(time.time()) - 400)
    clock = service.Clock(begin)
    store = Store(folder, begin)
    store.know(loops(count))
    store.add_answer("FIC0", answer("backlash", 2.4, 2.15, 3.11, 1.0))
    store.add_answer("FIC1", answer("sound", 0.0, 0.0, 0.4, None))
    monitor = Monitor(loops(count), store, options=MonitorOptions(), compensable={"FIC0": (3.0, 0.5)}, clock=clock)
    service.fed(monitor, clock, values("FIC0", 400, begin=begin), pace=20.0)
    monitor.tell(Event(begin, "FIC0", "late", "<b>so</b> late"))
    asyncio.run(monitor.step())
    half = dict.fromkeys(COLUMNS, 1.0) | {"reason": 0, "mask": 0}
    times = [{"t_start": at - 10.0, "t_end": at} for at in (begin - 500.0, begin - 400.0)]
    store.add([], [(1, -2 + k, *(half | one).values(), 1) for k, one in enumerate(times)], [])
    monitor._clock = time.time
    users = Users(store, CHEAP)
    for name, role in ROLES.items():
        users.put(name, role, PASSWORDS[name], begin)
    store.show(time.time(), json.dumps(monitor.status()))
    return monitor, users


def again(folder: Path) -> tuple[Monitor, Users]:
    """The service after it was ended: all it knows is in its folder."""
    store = Store(folder)
    return Monitor(loops(3), store, options=MonitorOptions()), Users(store, CHEAP)


def with_evil(row: dict[str, Any]) -> dict[str, Any]:
    """A state with a loop of that name, whose signal says it too, and a database set aside."""
    return row | {
        "damaged": f"the database has 0 bytes; it was set aside as {EVIL}",
        "loops": row["loops"] | {EVIL: row["loops"]["FIC2"] | {"note": EVIL}},
    }


async def main(folder: Path, port: int) -> None:
    monitor, users = await asyncio.to_thread(again if (folder / "glapp.db").exists() else made, folder)
    api = ApiServer(service_app(monitor, users), "127.0.0.1", 0)
    (folder / "api-url").write_text(api.url, encoding="utf-8")
    station = Station(View(folder), ApiClient(folder))
    window = ApiServer(app_of(station, ("127.0.0.1",), secure=False), "127.0.0.1", port)
    opened = asyncio.ensure_future(api.open())
    pages = asyncio.ensure_future(window.open())

    async def shown() -> None:
        while True:
            monitor.store.show(time.time(), json.dumps(monitor.status()))
            await asyncio.sleep(1.0)

    showing = asyncio.ensure_future(shown())
    print(window.url, flush=True)
    while word := (await asyncio.to_thread(sys.stdin.readline)).strip():
        if word == "gone":
            opened.cancel()
            showing.cancel()
            await asyncio.gather(opened, showing, return_exceptions=True)
            monitor.store.show(time.time() - 120.0, json.dumps(monitor.status() | {"wall": time.time() - 120.0}))
        if word == "full":
            showing.cancel()
            monitor.status = lambda: Monitor.status(monitor) | {"failing": FULL}
            monitor.store.show(time.time() - 120.0, json.dumps(Monitor.status(monitor) | {"wall": time.time() - 120.0}))
        if word == "room":
            del monitor.status
            showing = asyncio.ensure_future(shown())
        if word == "no database":
            (folder / "glapp.db").rename(folder / "away.db")
        if word == "change":
            await monitor.commands.change("FIC0", {"n": 5}, "olga", "engineer")
        if word == "samples":
            monitor.ingest.take(values("FIC1", 100, begin=time.time() - 120.0))
            await monitor.step()
        if word == "bad":
            newest = monitor.ingest.live("FIC1")["pv"]["time"]
            monitor.ingest.take([Value("FIC1", Signal.PV, newest + 2.0, float("nan"), False, "BadSensorFailure")])
        if word == "break":  # a value after a break, whose sample is not there yet
            monitor.ingest.take(values("FIC1", 5, begin=time.time() - 5.0))
        if word == "after the break":
            await monitor.step()
            monitor.ingest.take(values("FIC1", 2, begin=time.time() + 1.0))
        if word == "evil":
            monitor.tell(Event(time.time(), EVIL, "late", f"{EVIL} came late"))
            monitor.store.know([Loop(name=EVIL)])
            monitor.status = lambda: with_evil(Monitor.status(monitor))
            await monitor.step()
        if word == "no evil":
            del monitor.status
        if word.startswith("share "):
            await monitor.commands.change("FIC0", {"comp_share": float(word.split()[1])}, "olga", "engineer")
        if word == "watchdog seen":
            seen = {"time": time.time(), "person": "olga", "took": 2.0}
            log = monitor.journal.log
            await log("olga", "engineer", "drilled", "FIC0", None, seen, settings={WATCHDOG_SEEN: seen})
        if word == "one less":
            station.view.rows = lambda: View.rows(station.view)[1:]
        if word == "all":
            del station.view.rows
        if word == "expire":
            station.sessions._all.clear()
        print(word, flush=True)
    for task in (opened, showing, pages):
        task.cancel()
    await asyncio.gather(opened, showing, pages, return_exceptions=True)
    monitor.store.close()


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), int(sys.argv[2])))
