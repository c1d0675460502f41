"""Setup of the service's tests: a plant that is a table of values, and a folder that is watched."""

import asyncio
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from glapp import Loop
from glapp.fit import Fit
from glapp.result import decide
from glapp.service.monitor import Monitor
from glapp.service.options import MonitorOptions
from glapp.service.signal import Event, Signal, Value, WriteRefused
from glapp.service.store import Store

BEGIN = 1_795_000_000.0
"""Beginning of all recordings [s since 1970 UTC], the 18th of November 2026."""


def loops(count: int = 1) -> list[Loop]:
    """Loops with a detector each."""
    settings = {"controller": {"k": 0.5, "ti": 5}, "process": {"kp": 2}, "op_span": (0, 100), "n": 3, "tf": 0.001}
    return [Loop(name=f"FIC{i}", **settings) for i in range(count)]


def answered(fit: Fit, loop: Loop) -> dict[str, Any]:
    """The fields of a row of `answers` that a fit makes, with as much of a document as is read."""
    one = decide(crossings="no_estimate", d_hat=None, detections=0, reasons={}, fit=fit, loop=loop)
    fields = asdict(one)
    fields |= {"so": fit.reason or "seen"}
    fields["next"]["text"] = "Look at the valve."
    return {
        "t_begin": BEGIN,
        "t_end": BEGIN + 200,
        "verdict": one.verdict,
        "d": one.width,
        "low": one.low,
        "high": one.high,
        "unit": loop.op_label,
        "reason": fit.reason or "seen",
        "compensable": one.compensable,
        "document": json.dumps({"learnt": {}, "analysis": {"loops": [{"answer": fields}]}}),
    }


def values(loop: str, seconds: int, *, seed: int = 1, begin: float = BEGIN) -> list[Value]:
    """A PV that goes back and forth in a lasting cycle, with noise; SP stands, OP moves against it."""
    random = np.random.default_rng(seed)
    half = 30 + seed % 7
    found = [Value(loop, Signal.SP, begin, 50.0, True), Value(loop, Signal.MODE, begin, 1.0, True)]
    for k in range(seconds):
        side = 1.0 if k // half % 2 == 0 else -1.0
        pv = 50.0 + side + 0.02 * random.standard_normal()
        op = 50.0 - side * (k % half) / 10.0 + side * half / 20.0
        found.append(Value(loop, Signal.OP, begin + k, op, True))
        found.append(Value(loop, Signal.PV, begin + k, pv, True))
    return found


@dataclass
class Table:
    """A source that gives prepared values, and keeps the written ones."""

    batches: Sequence[Sequence[Value]] = ()
    events: Sequence[Event] = ()
    heard: float | None = None
    u_ff: dict[str, float] = field(default_factory=dict)
    writes: list[tuple[str, float]] = field(default_factory=list)
    heartbeats: int = 0
    may: set[str] = field(default_factory=set)
    refuse: str | None = None
    clock: Callable[[], float] = lambda: BEGIN

    async def run(self, take: Callable[[Sequence[Value]], None], tell: Callable[[Event], None]) -> None:
        for event in self.events:
            tell(event)
        for batch in self.batches:
            take(batch)
            await asyncio.sleep(0)
        await asyncio.Event().wait()

    async def write(self, loop: str, u_ff: float) -> None:
        if self.refuse is not None:
            raise WriteRefused(self.refuse, f"refused: {self.refuse}")
        if loop not in self.may and abs(u_ff) > abs(self.u_ff.get(loop, 0.0)):
            raise WriteRefused("not_enabled", "not enabled: it may only go to 0")
        self.u_ff[loop] = u_ff
        self.writes.append((loop, u_ff))

    async def read_back(self, loop: str) -> Value:
        u_ff = self.u_ff.get(loop, 0.0)
        return Value(loop, Signal.U_FF, self.clock(), u_ff, math.isfinite(u_ff))

    def alive(self, loop: str) -> float | None:
        return self.heard

    def enable(self, loop: str) -> None:
        if self.refuse is not None:
            raise WriteRefused(self.refuse, f"refused: {self.refuse}")
        self.may.add(loop)

    def disable(self, loop: str) -> None:
        self.may.discard(loop)

    async def heartbeat(self) -> None:
        self.heartbeats += 1


class Clock:
    """A clock that is set by hand."""

    def __init__(self, now: float = BEGIN) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now


def monitor(
    folder: Path,
    some: Sequence[Loop],
    clock: Clock,
    *,
    compensable: Mapping[str, tuple[float, float]] | None = None,
    **options: float,
) -> Monitor:
    """A monitor over a folder, to be stepped by hand."""
    return Monitor(
        some, Store(folder, clock()), options=MonitorOptions(**options), clock=clock, compensable=compensable
    )


def fed(one: Monitor, clock: Clock, some: Sequence[Value], *, save_every: int = 0, pace: float = 5.0) -> None:
    """Values handed over as time goes on, a step every `pace` seconds."""

    async def go() -> None:
        ordered = sorted(some, key=lambda value: value.time)
        at = steps = 0
        while at < len(ordered):
            until = pace * (math.floor(ordered[at].time / pace) + 1.0)
            end = at
            while end < len(ordered) and ordered[end].time < until:
                end += 1
            clock.now = until
            one.ingest.take(ordered[at:end])
            await one.step()
            steps += 1
            if save_every and steps % save_every == 0:
                await one.save()
            at = end

    asyncio.run(go())


def detections(folder: Path, loop: str) -> list[tuple[object, ...]]:
    """Every half-period of a loop with all that is kept of it."""
    from glapp.service.store import Reader

    with Reader(folder) as reader:
        return [tuple(row.values()) for row in reader.half_periods(loop, accepted=False)]
