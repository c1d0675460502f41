"""Limit cycles, predicted by describing functions and simulated: `python -m bench.limit_cycles`, seconds.

`--docs` writes bench/results/nonlinear.md and docs/limit_cycle.png.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np

from glapp.nonlinear import LimitCycle, backlash_cycles, n_backlash, negative_inverse
from glapp.simulate import Simulation, closed_loop
from glapp.tuning import migo, open_loop
from glapp_thesis import style

from .page import write

PICTURE = Path(__file__).parents[1] / "docs" / "limit_cycle.png"
D, H = 1.0, 0.01
LOOPS: list[tuple[str, Any, dict[str, float], float]] = [
    ("PI, Ms 1.4", "PI", {"ms": 1.4}, 0.0),
    ("PI, Ms 1.4", "PI", {"ms": 1.4}, 0.1),
    ("PI, Ms 2.0", "PI", {"ms": 2.0}, 0.0),
    ("PI, M = 1.4", "PI", {"m": 1.4}, 0.0),
    ("PI, M = 1.4", "PI", {"m": 1.4}, 0.1),
    ("PID, M = 1.4", "PID", {"m": 1.4}, 0.0),
    ("PID, M = 1.4", "PID", {"m": 1.4}, 0.2),
    ("PID, Ms 2.0", "PID", {"ms": 2.0}, 0.0),
]
"""Name, kind and bounds of a MIGO controller of P1, and its filter Tf as a share of Ti, of a PID of Td."""


def simulated(run: Simulation) -> tuple[float, float]:
    """Period [s], and amplitude of OP, in the second half of a run."""
    late = run.t > run.t[-1] / 2
    op, t = run.op[late], run.t[late]
    middle = op - (op.max() + op.min()) / 2
    up = np.flatnonzero((middle[:-1] < 0) & (middle[1:] >= 0))
    crossings = t[up] - middle[up] / (middle[up + 1] - middle[up]) * H
    return float(np.mean(np.diff(crossings))), float(np.ptp(op)) / 2


def predicted_and_run(kind: Any, bounds: dict[str, float], share: float) -> tuple[float, LimitCycle, Simulation]:
    """The filter's time constant [s], the cycle, and the loop over 60 periods of it."""
    controller = migo("P1", kind, **bounds).controller
    tf = share * (controller.td or controller.ti)
    [cycle] = backlash_cycles(open_loop("P1", controller, tf), D)
    t_end = 60 * cycle.period
    return tf, cycle, closed_loop("P1", controller, d=D, noise=0.0, h=H, t_end=t_end, setpoint=[(1, D)], tf=tf)


def rows() -> list[str]:
    """The table."""
    head = (
        "controller",
        "Tf",
        "period [s]: predicted / simulated",
        "error",
        "amplitude: predicted / simulated",
        "error",
    )
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for name, kind, bounds, share in LOOPS:
        _, cycle, run = predicted_and_run(kind, bounds, share)
        period, amplitude = simulated(run)
        tf = "0" if not share else f"{'Ti' if kind == 'PI' else 'Td'}/{1 / share:g}"
        cells = [name, tf]
        for ours, theirs, digits in ((cycle.period, period, 2), (cycle.amplitude, amplitude, 3)):
            cells += [
                f"{ours:.{digits}f} / {theirs:.{digits}f}",
                f"{100 * (ours / theirs - 1):+.1f} %".replace("-", "−"),
            ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def picture(path: Path) -> None:
    """Draw the loop of docs/nonlinear.md: where the curves meet, and the cycle beside its prediction."""
    _, cycle, run = predicted_and_run("PI", {"ms": 2.0}, 0.0)
    loop = migo("P1", ms=2.0).loop
    figure, (nyquist, time) = style.panels(1, 2, height=3.7, share=False)
    curve = loop.response(np.geomspace(0.2, 20, 600))
    nyquist.plot(curve.real, curve.imag, color=style.FILTERED, label="L(iω)")
    gap = negative_inverse(n_backlash(D * np.geomspace(0.5005, 50, 400), D))
    nyquist.plot(gap.real, gap.imag, **style.NARROW, label="−1/N(A)")
    at = complex(loop.response(cycle.w))
    nyquist.plot(at.real, at.imag, "o", color=style.WRONG, fillstyle="none", markersize=8, label="predicted cycle")
    nyquist.annotate(
        f"ω = {cycle.w:.2f} rad/s\nA = {cycle.amplitude:.2f} d", (at.real + 0.15, at.imag - 0.15), fontsize=9, va="top"
    )
    nyquist.plot(-1, 0, "x", color=style.MUTED)
    nyquist.set(xlabel="Re L(iω)", ylabel="Im L(iω)", xlim=(-3.5, 0.5), ylim=(-3, 0.5))
    style.legend(nyquist, columns=2)
    late = run.t > run.t[-1] - 2.5 * cycle.period
    t, op, valve = run.t[late] - run.t[late][0], run.op[late], run.position[late]
    centre = (op.max() + op.min()) / 2
    # The phase of the prediction is free: it is put where the first harmonic of OP has its own.
    whole = slice(0, round(simulated(run)[0] / H))
    begin = np.angle(np.sum((op - centre)[whole] * np.exp(-1j * cycle.w * t[whole]))) + math.pi / 2
    time.plot(t, op - centre, color=style.OP, label="OP")
    time.plot(t, valve - centre, color=style.POSITION, label="valve")
    time.plot(t, cycle.amplitude * np.sin(cycle.w * t + begin), **style.NARROW, label="predicted OP")
    time.set(xlabel="time [s]", ylabel="OP and valve [widths of the gap]", xlim=(0, t[-1]))
    style.legend(time, columns=2)
    style.save(figure, path)


def main() -> None:
    """Measure, print, and write into the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--docs", action="store_true", help="write table and picture into the documentation")
    given = parser.parse_args()
    text = "\n".join(rows())
    print(text)
    if given.docs:
        write("nonlinear.md", text, "limit cycles")
        picture(PICTURE)


if __name__ == "__main__":
    main()
