"""Effect of a phase lead on loops with a gap: `python -m bench.phase_lead`, seconds.

`--docs` writes bench/results/nonlinear.md.

Each loop is predicted by describing functions, a lead is designed for it (`glapp.nonlinear.phase_lead`), and both
are run as graphs of modules with a gap of 1, no noise: a step of the setpoint, later one of the load, and then what
is left.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np

from glapp.errors import InputError
from glapp.modules import Backlash, Graph, Input, Noise, PhaseLead, Pid, Plant
from glapp.nonlinear import backlash_cycles, backlash_margin, phase_lead
from glapp.plant import PLANTS
from glapp.plant import Plant as Transfer
from glapp.tuning import migo, open_loop, ultimate

from .page import write

D = 1.0
MARGIN = 1.3
"""`backlash_margin` asked for."""
NEVER = 1e7
"""Integral time of a proportional controller [s]."""


class Loop(NamedTuple):
    """A process under a controller."""

    name: str
    plant: Transfer
    k: float
    ti: float

    @property
    def open(self) -> Transfer:
        """L(s); that of a proportional controller has no integrator of its own."""
        return self.k * self.plant if self.ti == NEVER else open_loop(self.plant, (self.k, self.ti, 0.0))


def _fast(name: str, gain_margin: float) -> Loop:
    """MIGO's PI with its gain raised until so much gain margin is left."""
    tuned = migo(name, ms=2.0)
    k = tuned.controller.k * tuned.gain_margin / gain_margin
    return Loop(f"{name}, PI of MIGO, gain margin {gain_margin:g}", PLANTS[name], k, tuned.controller.ti)


def loops() -> list[Loop]:
    """Loops with a limit cycle that a lead removes, that none removes, and without one."""
    slow_valve = PLANTS["P1"] * Transfer([1], [0.5, 1])
    lags = Transfer([1], np.polymul([20, 1], np.polymul([1, 1], [1, 1])).tolist())
    zn = ultimate("P2")
    careful = migo("P7", ms=1.4).controller
    integrating = migo("P1", ms=2.0).controller
    return [
        _fast("P5", 1.2),
        _fast("P5", 1.4),
        Loop("1/((20s + 1)(s + 1)²), PI, Ti 4 s", lags, 12.0, 4.0),
        Loop("P1 behind a valve of 0.5 s, P", slow_valve, 1.6, NEVER),
        Loop("P2, PI of Ziegler and Nichols", PLANTS["P2"], 0.4 * zn.ku, 0.8 * zn.tu),
        Loop("P7, PI of MIGO, Ms 1.4", PLANTS["P7"], careful.k, careful.ti),
        Loop("P1, PI of MIGO, Ms 2.0", PLANTS["P1"], integrating.k, integrating.ti),
        _fast("P8", 1.2),
    ]


def _run(loop: Loop, lead: PhaseLead | None, *, d: float, noise: float, t: float, h: float) -> np.ndarray:
    """Signals at the gap, after a step of the setpoint and, at a third of the time, one of the load."""
    way = "pid -> lead -> gap" if lead else "pid -> gap"
    modules = {
        "sp": Input(),
        "load": Input(),
        "pid": Pid(k=loop.k, ti=loop.ti, b=1.0, max_h=1e9, start_pv=0.0),
        **({"lead": lead} if lead else {}),
        "gap": Backlash(d, start=0.0),
        "process": Plant(loop.plant),
        "noise": Noise(noise),
    }
    graph = Graph(h, modules, ["sp -> pid.sp", "load -> process.load", f"{way} -> process -> noise -> pid.pv"])
    n = int(t / h)
    step = np.arange(n) > n // 3
    seen = graph.run(n * h, record=["lead" if lead else "pid"], sp=np.full(n, 5.0), load=2.0 * step)
    return seen["lead" if lead else "pid"]


def _cycle(u: np.ndarray, h: float) -> str:
    """Period and amplitude of the rest in the last third; a dash where the loop is at rest."""
    last = u[-u.size // 3 :]
    amplitude = float(np.ptp(last)) / 2
    middle = (last.max() + last.min()) / 2
    up = np.flatnonzero((last[:-1] < middle) & (last[1:] >= middle))
    if amplitude < D / 20 or up.size < 3:
        return "at rest"
    return f"{h * float(np.diff(up).mean()):.1f} s, {amplitude:.2f}"


def _row(loop: Loop) -> tuple[str, list[str]]:
    """Result, and the row of the table."""
    cycles = [one for one in backlash_cycles(loop.open, D) if one.stable]
    period = max((one.period for one in cycles), default=10 * min(loop.ti, 10.0))
    h = period / 400
    times = {"t": 80 * period, "h": h}
    predicted = f"{cycles[-1].period:.1f} s, {cycles[-1].amplitude:.2f}" if cycles else "none"
    without = _cycle(_run(loop, None, d=D, noise=0.0, **times), h)
    cells = [loop.name, f"{backlash_margin(loop.open)[0]:.2f}", predicted, without]
    try:
        found = phase_lead(loop.open, MARGIN)
    except InputError as error:
        return "refused", [*cells, f"refused: {error}", "", ""]
    if found.lead == found.lag:
        return "empty", [*cells, "none needed", "", ""]
    lead = PhaseLead(found.lead, found.lag)
    with_it = _cycle(_run(loop, lead, d=D, noise=0.0, **times), h)
    quiet = {"d": 0.0, "noise": 0.02, **times}
    scatter = [float(np.std(_run(loop, one, **quiet)[-int(times["t"] / h) // 3 :])) for one in (None, lead)]
    design = f"(1 + {found.lead:.2f}s)/(1 + {found.lag:.2f}s), margin {found.margin:.2f}"
    return "designed", [*cells, design, with_it, f"{scatter[1] / scatter[0]:.2f}"]


def rows() -> tuple[list[str], dict[str, int]]:
    """The table, and how many came to what."""
    head = (
        "loop",
        "margin",
        "limit cycle, predicted: period, amplitude of OP",
        "simulated",
        f"lead for a margin of {MARGIN:g}",
        "simulated with it",
        "OP's scatter in noise, with/without",
    )
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    came_to = {"designed": 0, "empty": 0, "refused": 0}
    for loop in loops():
        what, cells = _row(loop)
        came_to[what] += 1
        lines.append(f"| {' | '.join(cells)} |")
    return lines, came_to


def main() -> None:
    """Measure, print, and write into the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--docs", action="store_true", help="write the table into bench/results/nonlinear.md")
    given = parser.parse_args()
    lines, came_to = rows()
    text = "\n".join([*lines, "", ", ".join(f"{what} {n}" for what, n in came_to.items()) + "."])
    print(text)
    if given.docs:
        write("nonlinear.md", text, "phase lead")


if __name__ == "__main__":
    main()
