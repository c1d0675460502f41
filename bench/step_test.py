"""Coverage of the interval of `glapp.step_test`: `python -m bench.step_test [tests]`, else 1000 a row.

Each row is a kind of step test on a simulated valve with a known gap; every test has its own noise and drift. What
the columns mean is written in bench/results/step_test.md, which has the table.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

import glapp
from glapp.simulate import Coloured, Gaussian, closed_loop, random_walk

UP_UP_BACK = (50.0, 53.0, 56.0, 52.0)
TWICE = (50.0, 54.0, 58.0, 53.0, 48.0, 54.0, 60.0)


@dataclass(frozen=True)
class Case:
    """A kind of test: process Kp/den, gap, noise, what drifts, and how OP was stepped."""

    name: str
    d: float = 2.0
    kp: float = 0.8
    den: tuple[float, ...] = (5.0, 1.0)
    noise: float = 0.1
    tau: float = 0.0
    walk: float = 0.0
    ramp: float = 0.0
    levels: tuple[float, ...] = UP_UP_BACK
    hold: float = 100.0

    def test(self, seed: int) -> glapp.StepTest:
        """One test of this kind, read."""
        n = int(self.hold * len(self.levels))
        load = random_walk(n + 1, 1.0, self.walk, seed) + self.ramp * np.arange(n + 1)
        load -= 52.0 * (self.den[-1] == 0)  # a tank's outflow
        simulation = closed_loop(
            ([self.kp], list(self.den), 0.0),
            (0.5, 10.0, 0, 0),
            d=self.d,
            noise=Coloured(sigma=self.noise, tau=self.tau) if self.tau else Gaussian(sigma=self.noise),
            h=1.0,
            t_end=float(n),
            manual=[(i * self.hold, (i + 1) * self.hold, op) for i, op in enumerate(self.levels)],
            load=load,
            setpoint=[(0.0, 40.0)],
            seed=seed,
            filter_in_loop=True,
        )
        loop = glapp.Loop(name=self.name, process={"type": "integrating"} if self.den[-1] == 0 else {})
        return glapp.step_test(glapp.recording_from(simulation.to_arrow().drop_columns(["POSITION"]), loop))


CASES = (
    Case("up, up, back"),
    Case("three times the noise", noise=0.3),
    Case("hardly any noise", noise=0.005),
    Case("d = 0.5", d=0.5),
    Case("no gap", d=0.0),
    Case("two up, two down, two up", levels=TWICE),
    Case("noise correlated over 5 s", tau=5.0),
    Case("noise correlated over 20 s", noise=0.05, tau=20.0),
    Case("load ramps by 0.005 %/s", ramp=0.005),
    Case("load wanders by 0.02 %/√s", walk=0.02),
    Case("load wanders by 0.05 %/√s", walk=0.05, noise=0.02),
    Case("wanders by 0.03, two up, two down, two up", walk=0.03, levels=TWICE),
    Case("four lags of 3 s, 150 s held", den=(81.0, 108.0, 54.0, 12.0, 1.0), hold=150.0),
    Case("Kp = -0.5", kp=-0.5),
    Case("level, 200 s held", kp=0.01, den=(5.0, 1.0, 0.0), noise=0.05, hold=200.0, levels=TWICE),
)


def _answer(case: Case, seed: int) -> tuple[float, float, float, float, float] | None:
    found = case.test(seed)
    if found.d is None:
        return None
    values = found.d, found.low, found.high, found.kp_low, found.kp_high
    return tuple(float(value) for value in values if value is not None)  # type: ignore[return-value]


def main(tests: int) -> None:
    """Print the table."""
    print("| test | read | holds d | holds Kp | median d̂ − d | median width |\n|---|---|---|---|---|---|")
    with ProcessPoolExecutor() as pool:
        for case in CASES:
            answers = list(pool.map(partial(_answer, case), range(1, tests + 1), chunksize=20))
            found = np.array([answer for answer in answers if answer is not None])
            d, low, high, kp_low, kp_high = found.T
            inside = np.mean((low <= case.d) & (case.d <= high))
            gain = np.mean((kp_low <= case.kp) & (case.kp <= kp_high))
            cells = f"{len(found) / tests:.1%} | {inside:.1%} | {gain:.1%}"
            print(f"| {case.name} | {cells} | {np.median(d) - case.d:+.3f} | {np.median(high - low):.2f} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
