"""Effect of pushes on a valve that sticks, each beside none: `python -m bench.stiction`.

A loop is drawn: a process of two lags and a dead time under a PI controller, noise, steps of the load, and a valve that
sticks, by Karnopp or by He. It runs for 100 Ti; then it is pushed, or not, for 200 Ti, of which the last 150 are
compared. The block is the one that ships, with its safety: it may withdraw itself. The height of a push is a share of
half of the valve's band s, which nobody knows exactly: each loop has it wrong by up to 30 %. Shares were chosen on
other loops, `--choose`. `--docs` writes the table into bench/results/compensation.md.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass
from random import Random
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.progress import track

from glapp.modules import Friction, FrictionModel, Graph, Input, Noise, Pid, ProcessSim, Push, Stiction, Sum

from .page import write

Floats = npt.NDArray[np.float64]
BEFORE, AFTER, COMPARED = 100.0, 200.0, 150.0
"""[Ti]."""
SHARES = {Push.KNOCKER: 0.8, Push.REINFORCEMENT: 0.8, Push.TWO_MOVES: 1.0}
"""Height of a push, as a share of s/2."""
HARM = 1.1
WITHDRAWN = (6, 11)
CHOSEN_ON = 1_000_000
"""Seeds of the loops that the shares were chosen on begin here."""


@dataclass(frozen=True)
class Loop:
    """One that is drawn."""

    seed: int
    model: FrictionModel

    def draw(self) -> dict[str, Any]:
        """Draws the loop's numbers."""
        random = Random(self.seed)
        t1 = math.exp(random.uniform(math.log(3.0), math.log(30.0)))
        t2, dead = t1 * random.uniform(0.05, 0.5), t1 * random.uniform(0.1, 0.6)
        gain = random.choice((1.0, -1.0)) * random.uniform(0.5, 2.0)
        # SIMC with a closed loop between tight and slow.
        ti = min(t1 + t2 / 2.0, 8.0 * (dead + t2 / 2.0))
        k = (t1 + t2 / 2.0) / (gain * random.uniform(1.5, 4.0) * (dead + t2 / 2.0))
        s = random.uniform(1.0, 6.0)
        return {
            "h": t1 / 15.0,
            "process": (gain, t1, t2, dead),
            "k": k,
            "ti": ti,
            "s": s,
            "j": s * random.uniform(0.1, 0.7),
            "noise": abs(gain) * random.uniform(0.02, 0.2),
            "wrong": random.uniform(0.7, 1.3),
            "loads": [(random.uniform(0.0, 300.0), random.gauss(0.0, 3.0)) for _ in range(6)],
        }


def measured(loop: Loop, push: Push | None, share: float, noise: int = 1) -> tuple[float, ...]:
    """Mean |e|, travel of OP and of the stem in 100 Ti, turns of the stem in 100 Ti, the last standing."""
    of = loop.draw()
    h, ti, k = of["h"], of["ti"], of["k"]
    gain, t1, t2, dead = of["process"]
    modules = {
        "sp": Input(0.0),
        "load": Input(0.0),
        "pid": Pid(k=k, ti=ti),
        "valve": Friction(s=of["s"], j=of["j"], model=loop.model, start=0.0),
        "process": ProcessSim(gain=gain, t1=t1, t2=t2, dead_time=dead),
        "noise": Noise(of["noise"], seed=noise),
        "sum": Sum(),
    }
    wires = ["sp -> pid.sp", "pid -> valve -> sum -> process -> noise -> pid.pv", "load -> sum.plus"]
    if push is not None:
        size = share * of["wrong"] * of["s"] / 2.0
        modules["push"] = Stiction(push=push, k=k, ti=ti, size=size, far=2.0 * of["noise"])
        wires += ["sp -> push.sp", "noise -> push.pv", "push -> pid.ff"]
    graph = Graph(h, modules, wires)
    graph["pid.mode"] = 2
    scans = round((BEFORE + AFTER) * ti / h)
    at = np.arange(scans) * h / ti
    load = sum((size * (at >= begin) for begin, size in of["loads"]), np.zeros(scans))
    first = round(BEFORE * ti / h)
    graph.run(first * h, load=load[:first])
    if push is not None:
        graph["push.compensate"] = 1
    shown = graph.run((scans - first) * h, record=["noise", "pid", "valve"], load=load[first:])
    late = slice(-round(COMPARED * ti / h), None)
    e, op, stem = (shown[name][late] for name in ("noise", "pid", "valve"))
    per = 100.0 / COMPARED
    steps = np.diff(stem)
    moves = steps[np.abs(steps) > 0.01 * of["s"]]
    turns = float(np.count_nonzero(np.diff(np.sign(moves))))
    standing = graph["push.standing"] if push is not None else 1.0
    return (
        float(np.abs(e).mean()),
        float(np.abs(np.diff(op)).sum()) * per,
        float(np.abs(steps).sum()) * per,
        turns * per,
        float(standing),
    )


def table(loops: int, models: tuple[FrictionModel, ...] = (FrictionModel.KARNOPP, FrictionModel.HE)) -> Iterator[str]:
    """Medians of each way beside none, over loops of each friction."""
    yield (
        "| friction | push | IAE, of none's | better by 10 % | worse by 10 % | OP's travel, of none's | "
        "stem's travel, of none's | stem's turns, of none's | withdrawn |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    for model in models:
        lot = [Loop(seed, model) for seed in range(loops // len(models))]
        none = np.array([measured(loop, None, 0.0) for loop in track(lot, description=f"{model.name}, none")])
        # Differences that chance alone makes in the comparison.
        again = np.array([measured(loop, None, 0.0, noise=2) for loop in lot])
        yield line(model, "none, other noise", none, again)
        for push, share in SHARES.items():
            rows = [measured(loop, push, share) for loop in track(lot, description=f"{model.name}, {push.name}")]
            yield line(model, push.name.lower().replace("_", " "), none, np.array(rows))


def line(model: FrictionModel, name: str, none: Floats, rows: Floats) -> str:
    """A row of the table."""
    of_none = rows[:, :4] / np.maximum(none[:, :4], 1e-9)
    iae = of_none[:, 0]
    better, worse = np.mean(iae < 1.0 / HARM), np.mean(iae > HARM)
    middle = " | ".join(f"{x:.2f}" for x in np.median(of_none[:, 1:], axis=0))
    gone = np.mean(np.isin(rows[:, 4], WITHDRAWN))
    return (
        f"| {model.name.title()} | {name} | {np.median(iae):.2f} | {better:.0%} | {worse:.1%} | {middle} | {gone:.0%} |"
    )


def choose(loops: int) -> None:
    """Each way with one share after the other, on loops that the table does not have."""
    lots = [Loop(CHOSEN_ON + seed, FrictionModel(2 + seed % 2)) for seed in range(loops)]
    none = np.array([measured(loop, None, 0.0) for loop in lots])
    for push in Push:
        for share in (0.2, 0.4, 0.6, 0.8, 1.0, 1.3):
            rows = np.array([measured(loop, push, share) for loop in lots])
            print(share, line(FrictionModel.HE, push.name, none, rows), flush=True)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=1000)
    parser.add_argument("--choose", action="store_true", help="try shares on loops that the table does not have")
    parser.add_argument("--docs", action="store_true", help="write the table into bench/results/compensation.md")
    given = parser.parse_args()
    if given.choose:
        choose(given.loops)
        return
    lines = list(table(given.loops))
    print("\n".join(lines))
    if given.docs:
        write("compensation.md", "\n".join(lines), "stiction")


if __name__ == "__main__":
    main()
