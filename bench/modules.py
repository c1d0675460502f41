"""Widths that the modules show: with and without Kp, by filters of the detector's own, corrected.

`python -m bench.modules`.

P1 to P8 under PI (MIGO, Ms 2.0) and PID (AMIGO), five seeds, noise of ± 0.005, steps of the load of 0.3, 1000 Ti at 20
scans a Ti; the spans of PV and OP are 1. The controller filters with Td/5, or Ti/10 without D. `--docs` writes the
tables into bench/results/modules.md; two minutes on two cores.
"""

from __future__ import annotations

import argparse
import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product

import numpy as np
from bench.page import write

from glapp import tuning
from glapp.controller import Ideal
from glapp.modules import Backlash, Graph, Input, Noise, PidAdvanced, Plant
from glapp.plant import PLANTS
from glapp.plant import Plant as Process

WIDTHS = (0.0, 0.02, 0.05)
GAINS = (1.0, 1.5, 2.0, 2.7, 3.4)
SEEDS = range(1, 6)
SCANS, STEP = 20_000, 2000
RULES: dict[str, Callable[[str], Ideal]] = {
    "PI": lambda plant: tuning.migo(plant, ms=2.0).controller,
    "PID": lambda plant: tuning.amigo_step(plant, "PID").controller,
    "Ziegler and Nichols": lambda plant: tuning.ziegler_nichols_frequency(plant, "PID").controller,
    "AMIGO": lambda plant: tuning.amigo_step(plant, "PID").controller,
    "MIGO": lambda plant: tuning.migo(plant, "PID", m=1.4).controller,
}
OWN = {"Ti/5": 0.2, "Ti/2": 0.5, "2Ti": 2.0}


@dataclass(frozen=True)
class Case:
    """A loop: plant, rule, width [share of the span], seed, gain of its process, noise of PV over that gain."""

    plant: str
    rule: str
    d: float
    seed: int
    gain: float = 1.0
    noise: float = 0.005


@dataclass(frozen=True)
class Shown:
    """Widths of one loop in the end, without a gap the largest of any scan; NaN where none is shown."""

    d_hat: float
    corrected: float
    kp_defaulted: bool


def show(case: Case, c: Ideal, **known: float) -> Shown:
    """Outputs of a `PidAdvanced` with this much known, after 1000 Ti."""
    plant = Process.of(case.plant)
    h = c.ti / 20
    loop = Graph(
        h,
        {
            "sp": Input(),
            "load": Input(),
            "pid": PidAdvanced(k=c.k / case.gain, ti=c.ti, td=c.td, b=c.b, tf=c.td / 5 if c.td else c.ti / 10, **known),
            "gap": Backlash(case.d, start=0.0),
            "plant": Plant(Process([case.gain * x for x in plant.num], plant.den, plant.dead_time)),
            "noise": Noise(case.noise * case.gain, seed=case.seed),
        },
        ["sp -> pid.sp", "load -> plant.load", "pid -> gap -> plant -> noise -> pid.pv"],
    )
    names = ["pid.d_hat", "pid.corrected_d"]
    seen = loop.run(SCANS * h, load=0.3 * (np.arange(SCANS) // STEP % 2), record=names)
    shown = [loop[name] for name in names]
    if case.d == 0.0:
        shown = [max((x for x in seen[name] if not math.isnan(x)), default=math.nan) for name in names]
    return Shown(*shown, kp_defaulted=loop["pid.kp_defaulted"] == 1)


def shows(case: Case) -> dict[str, Shown]:
    """Outputs of a loop with much and with little known; an integrating process has no Kp, and is set so."""
    c = RULES[case.rule](case.plant)
    integrates = PLANTS[case.plant].gain is None
    kp = {"integrating": 1.0} if integrates else {"kp": case.gain}
    spans = {"pv_span": 1.0, "op_span": 1.0}
    cases = {"Kp": kp, "default": kp if integrates else spans}
    if case.gain == 1.0:
        cases |= {"none": kp if integrates else {}}
        cases |= {name: kp | {"detector_tf": times * c.ti} for name, times in OWN.items()}
    return {name: show(case, c, **known) for name, known in cases.items()}


def answered(widths: Sequence[float], d: float) -> str:
    """Number of answers, and their median and range over d."""
    seen = sorted(width / d if d else width for width in widths if not math.isnan(width))
    if not seen:
        return "0"
    if d == 0.0:
        return str(len(seen))
    return f"{len(seen)}: {statistics.median(seen):.2f} ({seen[0]:.2f} to {seen[-1]:.2f})"


def widths_table(found: dict[Case, dict[str, Shown]]) -> Iterable[str]:
    """Estimates beside each other."""
    zero = {"Kp": "d̂, Kp = 1", "default": "d̂, Kp by default", "none": "d̂ without Kp"} | {f: f"d̂, Tf = {f}" for f in OWN}
    right = {"Kp": "corrected, Kp = 1", "default": "corrected, Kp by default"} | {
        f: f"corrected, Tf = {f}" for f in OWN
    }
    yield "| | d | loops | " + " | ".join([*zero.values(), *right.values()]) + " |"
    yield "|" + "---|" * (len(zero) + len(right) + 3)
    for rule, d in product(("PI", "PID"), WIDTHS):
        rows = [shown for case, shown in found.items() if (case.rule, case.d, case.gain) == (rule, d, 1.0)]
        cells = [answered([row[name].d_hat for row in rows], d) for name in zero]
        cells += [answered([row[name].corrected for row in rows], d) for name in right]
        yield f"| {rule} | {d:g} | {len(rows)} | " + " | ".join(cells) + " |"


def gains_table(found: dict[Case, dict[str, Shown]]) -> Iterable[str]:
    """The estimate with a Kp by default over that with the true one."""
    yield "| true Kp | loops | with d̂ | d̂ by default / by the true Kp: median | lowest | highest | within 20 % |"
    yield "|" + "---|" * 7
    for gain in GAINS:
        rows = [
            shown
            for case, shown in found.items()
            if case.gain == gain and case.d > 0 and case.plant != "P1" and case.rule in ("PI", "PID")
        ]
        both = [(row["default"].d_hat, row["Kp"].d_hat) for row in rows]
        ratios = sorted(default / true for default, true in both if not math.isnan(default + true))
        assert all(row["default"].kp_defaulted and not row["Kp"].kp_defaulted for row in rows)
        within = sum(abs(ratio - 1) <= 0.2 for ratio in ratios)
        cells = [statistics.median(ratios), ratios[0], ratios[-1]]
        numbers = " | ".join(f"{cell:.2f}" for cell in cells)
        yield f"| {gain:g} | {len(rows)} | {len(ratios)} | {numbers} | {within} of {len(ratios)} |"


def rules_table(found: dict[Case, dict[str, Shown]]) -> Iterable[str]:
    """P2 under PID by three rules, as in thesis table 8.1, in little noise."""
    yield "| P2, PID, d = 0.05 | loops | d̂, Kp = 1 | corrected | d̂, Tf = Ti/5 | corrected |"
    yield "|" + "---|" * 6
    for rule in list(RULES)[2:]:
        rows = [shown for case, shown in found.items() if case.rule == rule]
        cells = [answered([value(row) for row in rows], 0.05) for value in _COLUMNS]
        yield f"| {rule} | {len(rows)} | " + " | ".join(cells) + " |"


_COLUMNS: tuple[Callable[[dict[str, Shown]], float], ...] = (
    lambda row: row["Kp"].d_hat,
    lambda row: row["Kp"].corrected,
    lambda row: row["Ti/5"].d_hat,
    lambda row: row["Ti/5"].corrected,
)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", action="store_true", help="write the tables into bench/results/modules.md")
    write_them = parser.parse_args().docs
    cases = [Case(*of) for of in product(PLANTS, ("PI", "PID"), WIDTHS, SEEDS)]
    stable = [plant for plant in PLANTS if PLANTS[plant].gain is not None]
    cases += [Case(*of) for of in product(stable, ("PI", "PID"), WIDTHS[1:], SEEDS, GAINS[1:])]
    cases += [Case("P2", rule, 0.05, seed, noise=0.001) for rule, seed in product(list(RULES)[2:], SEEDS)]
    with ProcessPoolExecutor() as pool:
        found = dict(zip(cases, pool.map(shows, cases, chunksize=4), strict=True))
    for mark, table in (("widths", widths_table), ("kp by default", gains_table), ("pid rules", rules_table)):
        text = "\n".join(table(found))
        print(text, end="\n\n")
        if write_them:
            write("modules.md", text, mark)


if __name__ == "__main__":
    main()
