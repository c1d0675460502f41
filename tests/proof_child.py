"""A service with one simulated loop that runs in real time, and the window on it; a word on stdin moves its valve.

`manual 52` puts the controller in manual with that OP, `op 54` moves it, `auto` ends it, `repair` takes the gap away.
"""

import asyncio
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random

import numpy as np
from service import Table
from station_child import CHEAP, PASSWORDS, ROLES

from glapp import Loop
from glapp.service.api import ApiServer
from glapp.service.api import app_of as service_app
from glapp.service.fits import answered
from glapp.service.monitor import Monitor
from glapp.service.options import MonitorOptions
from glapp.service.recordings import SignalStore
from glapp.service.signal import Event, Signal, Value
from glapp.service.store import Store
from glapp.service.users import Users
from glapp.simulate import Gaussian, Walk, closed_loop
from glapp.station.app import app_of
from glapp.station.client import ApiClient
from glapp.station.pages import Station
from glapp.station.view import View

NAME = "FIC7"
H = 0.25
GAIN, LAG, LATE = 0.8, 1.2, 0.25
K, TI = 0.4, 2.0
GAP = 1.0
NOISE, WALK = 0.3, 0.08
SP = 40.0
SWING = 4.0
YESTERDAY = 900.0
"""Length of the recording on the day before [s]: it leaves open whether there is a gap, and a test is soon planned."""

LOOP = Loop(
    name=NAME,
    op_span=(0, 100),
    op_unit="%",
    pv_unit="bar",
    sample_time=H,
    controller={"k": K, "ti": TI},
    process={"kp": GAIN},
)


def history(folder: Path, end: float, seed: int = 7) -> None:
    """The day before: the loop in automatic, with a few setpoint steps."""
    random = Random(seed)
    steps = [(0.0, SP), *((t * YESTERDAY / 8, SP + random.uniform(-SWING, SWING)) for t in range(1, 8))]
    made = closed_loop(
        ([GAIN], [LAG, 1.0], LATE),
        (K, TI),
        d=GAP,
        noise=Gaussian(sigma=NOISE),
        load=Walk(rate=WALK),
        h=H,
        t_end=YESTERDAY,
        setpoint=steps,
        seed=seed,
    )
    nan, flags = np.full(len(made.t), np.nan), np.zeros(len(made.t))
    rows = np.column_stack([end - YESTERDAY + made.t, made.sp, made.pv, made.op, flags, nan, nan])
    SignalStore(folder).save({NAME: (np.zeros(len(rows), np.int64), rows)}, 0)


class Live(Table):
    """The loop as it runs: a sample every `H`, at its time."""

    def __init__(self) -> None:
        super().__init__()
        self.gap, self.op, self.auto = GAP, SP / GAIN, True
        self._valve, self._pv, self._integral = self.op, SP, self.op
        self._late = [self.op] * round(LATE / H)
        self._random, self._load = Random(7), 0.0

    async def run(self, take: Callable[[Sequence[Value]], None], tell: Callable[[Event], None]) -> None:
        at = time.time()
        while True:
            at += H
            await asyncio.sleep(max(0.0, at - time.time()))
            pv = self._scan()
            take(
                [
                    Value(NAME, Signal.MODE, at, float(self.auto), True),
                    Value(NAME, Signal.SP, at, SP, True),
                    Value(NAME, Signal.OP, at, self.op, True),
                    Value(NAME, Signal.PV, at, pv, True),
                ]
            )

    def alive(self, loop: str) -> float | None:
        return time.time()

    def _scan(self) -> float:
        self._load += WALK * math.sqrt(H) * self._random.gauss(0.0, 1.0) * 0.1
        pv = self._pv + NOISE * self._random.gauss(0.0, 1.0)
        if self.auto:
            self._integral += K * H / TI * (SP - pv)
            self.op = self._integral - K * (pv - SP)
        half = self.gap / 2
        self._valve = min(max(self._valve, self.op - half), self.op + half)
        self._late.append(self._valve + self._load)
        self._pv += (1.0 - math.exp(-H / LAG)) * (GAIN * self._late.pop(0) - self._pv)
        return pv

    def moved(self, word: str) -> None:
        what, _, value = word.partition(" ")
        if what == "repair":
            self.gap = 0.0
        if what == "auto":
            self.auto, self._integral = True, self.op
        if what == "manual":
            self.auto = False
        if value:
            self.op = float(value)


async def main(folder: Path) -> None:
    now = time.time()
    history(folder, now - 86400.0)
    store = Store(folder, now)
    store.know([LOOP])
    settings = LOOP.model_dump_json(exclude_unset=True)
    row = await asyncio.to_thread(answered, folder, settings, now - 7 * 86400.0, now)
    store.add_answer(NAME, {"time": now, "asked_by": "the night"} | row)
    monitor = Monitor([LOOP], store, options=MonitorOptions())
    users = Users(store, CHEAP)
    for name, role in ROLES.items():
        users.put(name, role, PASSWORDS[name], now)
    app = service_app(monitor, users)
    api = ApiServer(app, "127.0.0.1", 0)
    (folder / "api-url").write_text(api.url, encoding="utf-8")
    window = ApiServer(app_of(Station(View(folder), ApiClient(folder)), ("127.0.0.1",), secure=False), "127.0.0.1", 0)
    live = Live()
    works = [monitor.run(live), api.open(), window.open(), *app.state.proof.work()]
    tasks = [asyncio.ensure_future(work) for work in works]
    print(window.url, json.loads(row["document"])["analysis"]["loops"][0]["answer"]["confidence"], flush=True)
    while word := (await asyncio.to_thread(sys.stdin.readline)).strip():
        live.moved(word)
        print(word, flush=True)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    store.close()


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1])))
