"""Gaps that an oracle without knowledge of process and load could tell: `python -m bench.ordinary.oracle FILE`.

The oracle of `bench.truth.ladder` on its last rung: it is told the true valve, the noise, and of process and load only
the kind; gain, lags, dead time and the load's places are sought, with the true valve and without a gap. It is asked
about records of FILE (answers of `python -m bench.ordinary`) with a load that steps, bends or drifts inside the fit's
family, of `MOST_ROWS` rows at most. What a gap has to exceed is what records without one reach under such a load, with
rows as far apart.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import math
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

import numpy as np
from scipy import linalg, signal

from glapp import modules
from glapp.scenario import Coloured, Gaussian, Walk

from ..asking import answers_of
from ..truth.ladder import FOLLOWED, NEARER, WIDTHS, Cost, Process, known, refitted, sought
from ..truth.ladder import Record as Known
from ..truth.oracle import NO_GAP
from ..truth.score import markdown
from .answers import Line, read
from .load import Floats
from .records import record, simulated
from .score import share

MOST_ROWS = 14401
KINDS = {"steps": "steps", "bends": "ramps", "drift": "walk"}
"""Loads, and their names in the ladder."""

ROWS = ("drift", "steps", "bends", "historian", "friction", "manual", "cascade", "standing", "rings")
"""Rows with such loads in which only known causes move the loop."""


class Record(Known):
    """A record of the corpus as the ladder asks for it."""

    def __init__(self, name: str) -> None:
        drawn, simulation = simulated(name)
        self.scenario, self.simulation = drawn.scenario, simulation
        self.drawn = SimpleNamespace(  # type: ignore[assignment]
            d=drawn.clearance + drawn.sticks, every=drawn.every, band=0.0, noise=drawn.sigma, load_size=drawn.size
        )
        self.n = simulation.t.size
        self.kept = np.arange(0, self.n, drawn.every)
        kept = record(name).table
        self.pv = kept["PV"].to_numpy()
        self.rest = float(simulation.position[0])
        self.recorded = np.interp(simulation.t, simulation.t[self.kept], kept["OP"].to_numpy())
        self.kind = KINDS[drawn.kind]
        self.steps = math.hypot(drawn.decimals, drawn.scenario.pv_resolution)
        self.true = Process(drawn.scenario)
        self.white = self._white()
        self.pv_white = self.white(self.pv)
        first = np.ceil(drawn.changes / drawn.scenario.h - 1e-9).astype(int)
        self.changes = np.unique(first[(first > 0) & (first < self.n)])
        self.over = float(np.median(np.diff(drawn.changes))) if drawn.changes.size > 1 else drawn.scenario.t_end

    def _white(self) -> Any:
        """A map that leaves white noise of variance 1 of the noise and of loads that drift.

        The stationary Kalman filter of process and load, run by `lfilter`: the same as by the covariance of all rows,
        which would not fit into memory.
        """
        (noise,) = self.scenario.noise
        assert isinstance(noise, Gaussian)
        h = self.scenario.h * self.drawn.every
        # Rate of decay [1/s] and intensity of each load.
        loads = [
            (1 / one.tau, one.sigma * math.sqrt(2 / one.tau)) if isinstance(one, Coloured) else (0.0, one.rate)
            for one in self.scenario.load
            if isinstance(one, Coloured | Walk)
        ]
        # The dead time is of no influence on what the noise looks like.
        a, b, c, _ = signal.tf2ss(list(self.scenario.plant.num), list(self.scenario.plant.den))
        order, size = len(a), len(a) + len(loads)
        whole, driven, seen = np.zeros((size, size)), np.zeros((size, size)), np.zeros((1, size))
        whole[:order, :order], seen[:, :order] = a, c
        for i, (decay, intensity) in enumerate(loads, order):
            whole[:order, i], whole[i, i], driven[i, i] = b[:, 0], -decay, intensity**2
        balanced, t = linalg.matrix_balance(whole)
        back = linalg.inv(t)
        whole, driven, seen = balanced, back @ driven @ back.T, seen @ t
        exp = linalg.expm(np.block([[-whole, driven], [np.zeros_like(whole), whole.T]]) * h)
        phi = exp[size:, size:].T
        q = phi @ exp[:size, size:]
        q = (q + q.T) / 2 + 1e-12 * np.trace(q) * np.eye(size)
        r = max(self.drawn.noise, 1e-9) ** 2 + self.steps**2 / 12
        p = linalg.solve_discrete_are(phi.T, seen.T, q, np.array([[r]]))
        s = float((seen @ p @ seen.T)[0, 0] + r)
        k = phi @ p @ seen.T / s
        # e = y − c·x̂, x̂⁺ = phi·x̂ + k·e
        whitened, poles = signal.ss2tf(phi - k @ seen, k, -seen, np.array([[1.0]]))
        return lambda x: signal.lfilter(whitened[0], poles, x, axis=0) / math.sqrt(s)

    def known_load(self, process: Process) -> list[Floats]:
        """The answers to the load's steps and bends, each of an unknown size."""
        unit = process.answer(np.ones(self.n))
        if self.kind == "ramps":
            unit = np.cumsum(unit)
        return [np.concatenate([np.zeros(at), unit])[: self.n] for at in self.changes]

    def valve(self, op: Floats, d: float | None = None) -> Floats:
        """Positions under `op` of a valve with a mere gap of `d`; of the true valve where no width is given."""
        true = self.scenario.valve
        if d is None and true is not None:
            flows: Floats = np.append(self.rest, true.positions(op, self.scenario.h)[:-1])
            return flows
        width = self.scenario.d if d is None else d
        if width <= 0.0:
            return op
        parts: dict[str, modules.Module] = {
            "op": modules.Input(),
            "gap": modules.Backlash(width, self.rest),
            "valve": modules.Output(),
        }
        graph = modules.Graph(1.0, parts, [" -> ".join(parts)])
        moved: Floats = graph.run(op.size, op=op, record=["valve"])["valve"]
        return moved


@dataclass(frozen=True)
class Seen:
    """Result of the oracle on a record.

    Attributes
    ----------
    name : str
    ratio : float
        −2·Δln L of no gap against the true valve, or against a mere gap of nearly its width; of a record without a gap
        against the best of many widths.
    """

    name: str
    ratio: float

    @classmethod
    def of(cls, name: str) -> Self:
        """Ask about the record of that name."""
        record = Record(name)
        d, op = record.drawn.d, record.recorded
        tried, whole = (NEARER, d) if d > 0 else (WIDTHS, float(np.ptp(record.simulation.op)))
        moves = [op - record.rest, *(record.valve(op, part * whole) - record.rest for part in tried)]
        if d > 0 and record.scenario.valve is not None:
            moves.append(record.valve(op) - record.rest)
        # The unknown course of OP between the rows is more noise.
        variance = max(1.0, min(cost.left for cost in known(record, record.true, moves)))
        costs: list[Cost] = sought(record, record.true, moves, variance)
        nearest = sorted(range(1, len(moves)), key=lambda i: costs[i].cost)[:FOLLOWED]
        asked = (0, *nearest)
        fitted = {i: refitted(record, moves[i], costs[i], variance) for i in asked}
        # Process and places that one found are where the others begin once more.
        least = {i: fitted[i].cost for i in asked}
        for i in asked:
            for other in set(asked) - {i}:
                found = Cost(least[i], fitted[other].changes, 0.0)
                again = refitted(record, moves[i], found, variance, [fitted[other].process])
                least[i] = min(least[i], again.cost)
        return cls(name, least[0] - min(least[i] for i in nearest))


def ask(name: str) -> Seen | str:
    """Result of the oracle on the record, or the reason why it cannot be asked."""
    try:
        return Seen.of(name)
    except linalg.LinAlgError as error:
        return f"left out: {name}: {error}"


def fitting(line: Line) -> bool:
    """Whether the oracle can be asked about the record, or the gapless twin of one."""
    truth = line.truth
    return (
        truth.row in ROWS
        and truth.kind in KINDS
        and not truth.outside
        and truth.samples <= MOST_ROWS
        and truth.fault != "driven"
    )


def main() -> None:
    """Ask about the records of a file of answers, and print how many of the gaps that the oracle sees are found."""
    parser = argparse.ArgumentParser(prog="python -m bench.ordinary.oracle", description=__doc__.split("\n\n")[0])
    parser.add_argument("answers", type=Path, help="lines of python -m bench.ordinary")
    parser.add_argument("--most", type=int, default=60, help="so many records with a gap")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--again", action="store_true", help="judge the stored evidence by the ladder of today")
    given = parser.parse_args()
    lines = {line.truth.name: line for line in read(given.answers) if line.recordings == 1 and fitting(line)}
    gaps = [line for line in lines.values() if line.truth.d > 0][: given.most]
    out = given.answers.with_suffix(".oracle.jsonl")
    asked = [Seen(**json.loads(text)) for text in out.read_text("utf-8").splitlines()] if out.exists() else []
    none = [line for line in lines.values() if line.truth.d == 0][: given.most]
    # Read in the order of the file, so that rows there early have both.
    names = [name for name, line in lines.items() if line in gaps or line in none]
    left = [name for name in names if name not in {seen.name for seen in asked}]
    with out.open("a", encoding="utf-8") as file:
        for seen in answers_of(ask, left, given.jobs):
            if isinstance(seen, str):
                print(seen, file=sys.stderr)
                continue
            asked.append(seen)
            print(json.dumps(asdict(seen)), file=file, flush=True)
    ratios = {seen.name: seen.ratio for seen in asked}
    print(table([lines[name] for name in names if name in ratios], ratios, given.again))


def table(lines: list[Line], ratios: dict[str, float], again: bool = False) -> str:
    """Table of the gaps that the oracle sees, with the number that the fit tells."""
    asked: dict[tuple[str, bool], float] = {}
    for line in lines:
        key = (line.truth.kind, line.truth.apart)
        reached = ratios[line.truth.name] if line.truth.d == 0 else NO_GAP
        asked[key] = max(asked.get(key, NO_GAP), reached)
    there = [line for line in lines if line.truth.d > 0]
    seen = [line for line in there if ratios[line.truth.name] > asked[line.truth.kind, line.truth.apart]]
    groups = {
        "all": seen,
        "rows near": [line for line in seen if not line.truth.apart],
        "rows further apart than T/5": [line for line in seen if line.truth.apart],
    }
    body = []
    for name, of in groups.items():
        confidences = [line.claim(again).confidence for line in of]
        found = share([c == "found" for c in confidences])
        body.append([name, str(len(of)), found, share([c in ("found", "likely") for c in confidences])])
    most = ", ".join(f"{kind}{' far apart' * apart} {ratio:.0f}" for (kind, apart), ratio in sorted(asked.items()))
    head = f"Of {len(there)} gaps the oracle sees {len(seen)}; their ratio exceeds what none reaches without: {most}."
    return f"{head}\n\n{markdown(['seen', 'records', 'found', 'found or likely'], body)}"


if __name__ == "__main__":
    main()
