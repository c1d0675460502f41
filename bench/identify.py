"""Success of `glapp.identify`: `python -m bench.identify [records]`, 300 of each kind by default.

Every record is a simulated loop whose K, Ti and Td are known: P1 to P8 under a PI or PID by one of five rules, with or
without a filter before the controller, a gap, noise, steps of the setpoint; h is Ti/100 to Ti. The four ways to record
it are four kinds. What the columns mean is written in bench/results/identify.md, which has the table.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import count, islice
from random import Random

import numpy as np
from numpy.typing import NDArray

from glapp.errors import InputError
from glapp.identify import Identification, identified
from glapp.plant import PLANTS
from glapp.scenario import Gaussian, Scenario, Walk
from glapp.simulate import run

from .truth.design import RULES as TUNINGS
from .truth.design import log_uniform, random_steps, time_scale

Floats = NDArray[np.float64]

RULES = ("ZN frequency", "Lambda 3T", "AMIGO step", "SIMC", "MIGO 1.4")
KINDS = ("PI", "PID")
SEEN = ("every scan", "OP rounded", "between scans", "between, OP rounded")
"""Ways in which the recorder saw the controller: each of its scans; or one of many, OP as old as one scan."""


@dataclass(frozen=True)
class Record:
    """Signals and their truth; the filter's time constant is 0 where there is no filter."""

    name: str
    t: Floats
    sp: Floats
    pv: Floats
    op: Floats
    k: float
    ti: float
    td: float
    tf: float
    h: float


def record(name: str) -> Record | None:
    """The record "kind/seen/number"; None where the rule is not for the process, or the loop is unstable."""
    kind, seen, _ = name.split("/")
    random = Random(name)
    process, rule = random.choice(list(PLANTS)), random.choice(RULES)
    tuned = _tuned(process, rule, kind)
    if tuned is None:
        return None
    k, ti, td = tuned
    h = ti * log_uniform(random, 0.01, 1.0)
    filtered = random.choice(("thesis", "thesis", "none", "other"))
    # Slower than half of Td, twice in series, it would take away what the D part brings.
    other = log_uniform(random, 0.05, 0.5) * td or log_uniform(random, 0.02, 0.2) * ti
    tf = {"thesis": td / 5 or ti / 10, "none": 0.0, "other": other}[filtered]
    every = 1
    if seen.startswith("between"):
        fast = min(ti / 40, time_scale(PLANTS[process]).lag / 20, tf / 2 or math.inf)
        every = max(math.ceil(h / fast), 2)
    samples = max(min(round(log_uniform(random, 600, 3000)), 400_000 // every), 400)
    t_end = samples * h
    late = random.choice((0, 1)) if every > 1 else 0
    apart = max(t_end / random.uniform(8, 60), 2 * ti)
    size = log_uniform(random, 1.0, 10.0)
    moves = [(0.0, 50.0)]
    if random.random() < 0.5:
        moves += random_steps(random, t_end, apart, random.uniform(0.1, 1.0) * size, 50.0)
    load = (
        Walk(rate=size / math.sqrt(apart)) if random.random() < 0.5 else random_steps(random, t_end, apart, size, 0.0)
    )
    scenario = Scenario(
        plant=PLANTS[process],
        controller=(k, ti, td, random.choice((0.0, 1.0))),
        tf=tf,
        d=random.choice((0.0, 1.0, 3.0)),
        noise=(Gaussian(sigma=log_uniform(random, 0.003, 0.3)),),
        op_resolution=random.choice((0.05, 0.1, 0.25)) if "rounded" in seen else 0.0,
        setpoint=moves,
        load=load,
        h=h / every,
        t_end=t_end,
        seed=random.randrange(2**32),
    )
    try:
        simulation = run(scenario)
    except InputError:
        return None
    if np.ptp(simulation.op) > 200.0:  # it swings ever wider
        return None
    rows = np.arange(late, simulation.t.size, every)
    t, sp, pv, op = (x[rows] for x in (simulation.t, simulation.sp, simulation.pv, simulation.op))
    return Record(name, t, sp, pv, simulation.op[rows - late] if late else op, k, ti, td, tf, h)


@cache
def _tuned(process: str, rule: str, kind: str) -> tuple[float, float, float] | None:
    """K, Ti and Td; None where the rule is not for this process, or gives a PID no derivative."""
    try:
        k, ti, td, _ = TUNINGS[rule](PLANTS[process], kind).controller
    except InputError:
        return None
    return (k, ti, td) if (td > 0) == (kind == "PID") else None


@dataclass(frozen=True)
class IdentifyAnswer:
    """Answer on a record; the errors are relative to the truth, the width is that of the interval."""

    kind: str
    seen: str
    ratio: float
    usable: bool
    holds: bool
    k_error: float
    ti_error: float
    k_width: float
    ti_width: float

    @property
    def right(self) -> bool:
        """Used unasked, and no interval lies."""
        return self.usable and self.holds


def answer(made: Record) -> IdentifyAnswer:
    """Ask, and compare with the truth."""
    return compared(made, identified(made.t, made.sp, made.pv, made.op))


def compared(made: Record, found: Identification) -> IdentifyAnswer:
    """Comparison of an identification with the truth."""
    kind, seen, _ = made.name.split("/")
    ratio = made.h / made.ti
    if found.k is None or found.ti is None:
        return IdentifyAnswer(kind, seen, ratio, False, False, *[math.nan] * 4)
    ends = found.k_low, found.k_high, found.ti_low, found.ti_high
    k_low, k_high, ti_low, ti_high = (math.nan if end is None else end for end in ends)
    holds = k_low <= made.k <= k_high and ti_low <= made.ti <= ti_high
    if made.td > 0 or found.td:
        holds &= found.td_low <= made.td <= found.td_high
    return IdentifyAnswer(
        kind,
        seen,
        ratio,
        found.usable,
        holds,
        found.k / made.k - 1,
        found.ti / made.ti - 1,
        (k_high - k_low) / made.k,
        (ti_high - ti_low) / made.ti,
    )


def records(kind: str, seen: str, first: int = 0) -> Iterator[Record]:
    """Every record of a kind from that number on."""
    for number in count(first):
        made = record(f"{kind}/{seen}/{number}")
        if made is not None:
            yield made


def asked(kind: str, seen: str, first: int, each: int) -> list[IdentifyAnswer]:
    """The answers to so many records of a kind."""
    return [answer(made) for made in islice(records(kind, seen, first), each)]


HEAD = (
    "| loops | records | used | of these right | used and right | K off | Ti off | width of K | of Ti |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def row(name: str, answers: list[IdentifyAnswer]) -> str:
    """A line of the table: shares, and medians over the usable ones."""
    used = [a for a in answers if a.usable]
    right = sum(a.right for a in answers)

    def median(values: Iterable[float]) -> str:
        known = list(values)
        return f"{np.median(known):.1%}" if known else ""

    cells = (
        name,
        str(len(answers)),
        f"{len(used) / len(answers):.1%}",
        f"{right / len(used):.1%}" if used else "",
        f"{right / len(answers):.1%}",
        median(abs(a.k_error) for a in used),
        median(abs(a.ti_error) for a in used),
        median(a.k_width for a in used),
        median(a.ti_width for a in used),
    )
    return f"| {' | '.join(cells)} |"


def main(each: int, first: int = 0) -> None:
    """Print the table."""
    print(HEAD)
    everything: list[IdentifyAnswer] = []
    with ProcessPoolExecutor() as pool:
        cells = [(kind, seen) for kind in KINDS for seen in SEEN]
        jobs = [pool.submit(asked, kind, seen, first, each) for kind, seen in cells]
        for (kind, seen), job in zip(cells, jobs, strict=True):
            answers = job.result()
            everything += answers
            print(row(f"{kind}, {seen}", answers), flush=True)
    for kind in KINDS:
        for low, high in ((0.01, 0.03), (0.03, 0.1), (0.1, 0.3), (0.3, 1.0)):
            print(
                row(
                    f"{kind}, h/Ti {low} to {high}", [a for a in everything if a.kind == kind and low <= a.ratio < high]
                )
            )
    print(row("all", everything))


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:3] or ("300",)))
