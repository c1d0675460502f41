"""Verdict of the oracle: the information of a record on the valve, `python -m bench.truth.oracle [each]`.

Nobody can tell from a record what is not in it. This one knows everything but the valve: the process, the noise, OP
between the recorded samples, and the kind of the load with the times of its steps and ramps, only not how large they
are. It asks how much likelier the true movement of the valve makes the record than a valve without a gap, and than the
mere gap that comes nearest. Where it cannot tell, no method can; where it can and the fit does not, the fit lacks what
it had to find out by itself.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import numpy as np
from scipy import linalg, signal

from glapp import _glapp
from glapp.blocks import Backlash
from glapp.scenario import Coloured, Ramp, Steps, Walk
from glapp.simulate import Simulation, run

from .design import CELLS, LOADS, Drawn, draw
from .records import Floats, Truth, chosen, compressed
from .score import FAULTY

NO_GAP, NO_JUMP = (_glapp.fit_thresholds()[name][0] for name in ("LR_MIN", "LR_JUMP"))
"""Likelihood ratios that are needed: the thresholds of the fit."""

NEARER = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3)
"""Mere gaps that are tried, in widths of the true dead band."""


class Told(NamedTuple):
    """Likelihood ratios −2·Δln L: of no gap, and of the nearest mere gap, against the truth."""

    lr_no_gap: float
    lr_no_jump: float


class Process:
    """The true process as it answers its input from rest, at the step of the simulation."""

    def __init__(self, drawn: Drawn) -> None:
        plant = drawn.scenario.plant
        num, self.den, _ = signal.cont2discrete((list(plant.num), list(plant.den)), drawn.scenario.h)
        self.num = num[0]
        self.delay = round(plant.dead_time / drawn.scenario.h)
        self.integrating = plant.gain is None

    def answer(self, v: Floats) -> Floats:
        """PV to an input."""
        return self._later(signal.lfilter(self.num, self.den, v))

    def starts(self, n: int) -> Iterator[Floats]:
        """PV after every way in which the process may not have been at rest."""
        for unit in np.eye(len(self.den) - 1):
            yield self._later(signal.lfilter(self.num, self.den, np.zeros(n), zi=unit)[0])

    def _later(self, y: Floats) -> Floats:
        return np.concatenate([np.zeros(self.delay), y])[: y.size]


def told(name: str) -> Told:
    """Outcome that a record with a gap allows."""
    drawn = draw(name)
    assert drawn is not None
    simulation = run(drawn.scenario)
    kept = slice(0, None, drawn.every)
    process = Process(drawn)
    whiten = _whitening(drawn, simulation, process)
    rest = simulation.position[0]
    pv = compressed(simulation.pv[kept], drawn.band) if drawn.band else simulation.pv[kept]

    def cost(position: Floats) -> float:
        left = whiten(pv - process.answer(position - rest)[kept])
        return float(left @ left)

    true = cost(simulation.position)
    gaps = [cost(_through_gap(simulation.op, part * drawn.d, rest)) for part in NEARER]
    return Told(cost(simulation.op) - true, min(gaps) - true)


def _through_gap(op: Floats, d: float, first: float) -> Floats:
    gap = Backlash(d, first)
    return np.array([gap.update(x) for x in op.tolist()])


def _whitening(drawn: Drawn, simulation: Simulation, process: Process) -> Callable[[Floats], Floats]:
    """A map that leaves white noise of variance 1 of noise, load and start: generalised least squares."""
    scenario, t = drawn.scenario, simulation.t
    kept = slice(0, None, drawn.every)
    m = t[kept].size
    # A held value is off by anything between ± band.
    sigma = math.hypot(drawn.noise, drawn.band / math.sqrt(3))
    (noise,) = scenario.noise
    covariance = sigma**2 * np.eye(m)
    if isinstance(noise, Coloured):
        fading = noise.tau / (noise.tau + scenario.h)
        covariance = sigma**2 * linalg.toeplitz(fading ** (drawn.every * np.arange(m)))
    unknown = [np.ones(m), *(start[kept] for start in process.starts(t.size))]
    if process.integrating:
        unknown.append(np.arange(m, dtype=float))
    step = process.answer(np.ones(t.size))
    for piece in scenario.load:
        if isinstance(piece, Walk):
            each = piece.rate * math.sqrt(scenario.h * drawn.every) * step[kept]
            answers = linalg.toeplitz(each, np.zeros(m))
            covariance += answers @ answers.T
        elif isinstance(piece, Ramp):
            unknown.append(process.answer(np.clip((t - piece.t) / piece.over, 0.0, 1.0))[kept])
        elif isinstance(piece, Steps):
            for at, _ in piece.steps:
                first = math.ceil(at / scenario.h - 1e-9)
                unknown.append(np.concatenate([np.zeros(min(first, t.size)), step])[: t.size][kept])
    root = linalg.cholesky(covariance, lower=True)
    columns = np.array([u for u in unknown if np.abs(u).max() > 1e-9]).T
    columns = linalg.solve_triangular(root, columns, lower=True)
    q, r, _ = linalg.qr(columns / np.linalg.norm(columns, axis=0), mode="economic", pivoting=True)
    q = q[:, np.abs(np.diag(r)) > 1e-7]

    def whiten(left: Floats) -> Floats:
        white: Floats = linalg.solve_triangular(root, left, lower=True)
        return white - q @ (q.T @ white)

    return whiten


def table(truths: Sequence[Truth], all_told: Sequence[Told]) -> str:
    """A table with a row a load: the share of records in which the gap or the jump is seen."""
    lines = ["| load | records | that there is a gap | that it jumps, where J ≥ 3σ/Kp |", "|---|---|---|---|"]
    for load in (*LOADS, "all"):
        rows = [(t, x) for t, x in zip(truths, all_told, strict=True) if load in (t.load, "all")]
        gap = [x.lr_no_gap > NO_GAP for _, x in rows]
        jump = [x.lr_no_jump > NO_JUMP for t, x in rows if t.cause_told]
        lines.append(f"| {load} | {len(rows)} | {np.mean(gap):.0%} | {np.mean(jump):.0%} of {len(jump)} |")
    return "\n".join(lines)


def main() -> None:
    """Ask of all identifiable records of the bench, `each` of a kind."""
    each = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    with ProcessPoolExecutor() as pool:
        cells = [cell for cell in CELLS if cell.cause in FAULTY]
        truths = [truth for cell in cells for truth in chosen(cell, each, pool) if truth.identifiable]
        print(table(truths, list(pool.map(told, [truth.name for truth in truths], chunksize=4))))


if __name__ == "__main__":
    main()
