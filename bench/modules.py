"""Widths of the modules with and without Kp, with filters of the detector's own, and corrected: `python -m bench.modules`.

P1 to P8 under PI (MIGO, Ms 2.0) and PID (AMIGO), noise of ± 0.005, steps of the load, 1000 Ti; PV and OP have a span of 1. `--docs` writes the tables of
`docs/modules.md`.
"""

from __future__ import annotations

import argparse
import math
import statistics
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from glapp import tuning
from glapp.controller import Ideal
from glapp.modules import Backlash, Graph, Input, Noise, PidAdvanced, Plant
from glapp.plant import PLANTS
from glapp.plant import Plant as Process

WIDTHS = (0.0, 0.02, 0.05)
GAINS = (1.0, 1.5, 2.0, 2.7, 3.4)
SEEDS = 5
PAGE = Path(__file__).parents[1] / "docs" / "modules.md"


@dataclass(frozen=True)
class Case:
    """A loop: plant, form of the controller, width [share of the span], gain of the process, and seed."""

    plant: str
    form: str
    d: float
    gain: float
    seed: int


def controller(plant: str, form: str) -> Ideal:
    """The controller for the plant as it is."""
    return tuning.migo(plant, ms=2.0).controller if form == "PI" else tuning.amigo_step(plant, "PID").controller


def loop(case: Case, **settings: float) -> Graph:
    """The loop after its 1000 Ti."""
    c = controller(case.plant, case.form)
    process = Process.of(case.plant)
    scaled = Process(tuple(case.gain * x for x in process.num), process.den, process.dead_time)
    h = c.ti / 20
    modules = {
        "sp": Input(0.0),
        "load": Input(),
        "pid": PidAdvanced(
            k=c.k / case.gain, ti=c.ti, td=c.td, b=c.b, tf=c.td / 5 if c.td else c.ti / 10, **settings
        ),
        "gap": Backlash(case.d, start=0.0),
        "plant": Plant(scaled),
        "noise": Noise(0.005 * case.gain, seed=case.seed),
    }
    wires = ["sp -> pid.sp", "load -> plant.load", "pid -> gap -> plant -> noise -> pid.pv"]
    made = Graph(h, modules, wires)
    n = 20_000
    made.run(n * h, load=0.3 * (np.arange(n) // 2000 % 2))
    return made


if __name__ == "__main__":
    pass
