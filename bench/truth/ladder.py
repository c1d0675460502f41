"""Knowledge that finding a gap needs, step by step, `python -m bench.truth.ladder [each]`.

The oracle of `bench.truth.oracle` knows everything but the valve. This one is told less and less, rung by rung:

*all*: the process, the noise, OP between the recorded samples, the kind of the load and its times.
*times unknown*: of a load that steps or ramps only the kind and the usual size; where it steps or bends is sought, with
a gap and without, each place at its price. A load that walks has no times.
*OP as recorded*: of OP only the recorded samples, and lines between them.
*process unknown*: of the process only which kind it is; gain, dead time, its slowest lag and the others are free.

On each rung the question is the same: how much likelier is the record with the true valve than with one without a gap?
What a gap has to exceed there is what records without a gap reach on that rung with the gap that suits them best. A
record whose ratio does not exceed it does not hold its gap for anybody who knows no more.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # many processes, each with its own core

import argparse
import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt
from scipy import linalg, optimize, signal

import glapp
from glapp import _glapp, modules
from glapp.scenario import Coloured, Ramp, Scenario, Steps, Walk
from glapp.simulate import Simulation, run

from ..asking import answers_of
from ..page import write
from .__main__ import OUT as TRUTH
from .__main__ import read
from .design import FAMILIES, LOADS, Cell, Drawn, draw
from .oracle import NO_GAP, NO_JUMP
from .records import Floats, Truth, compressed
from .records import record as made_record
from .score import FAULTY, LACKING, Scored, markdown

Places = npt.NDArray[np.int64]

OUT = TRUTH.with_name("ladder.jsonl")

RUNGS = ("all", "times unknown", "OP as recorded", "process unknown")

WIDTHS = (0.003, 0.01, 0.03, 0.06, 0.1, 0.17, 0.3, 0.5, 0.75)
"""Gaps that are tried where there is none, in parts of OP's range."""

NEARER = (0.5, 0.65, 0.8, 0.9, 1.0)
"""Mere gaps that are tried where there is one, in parts of its width: missed turns of OP make it look narrower."""

FOLLOWED = 2
"""Number of the nearest of them for which the process is sought."""

PLACES = 600
"""Places at most that a step or bend of the load is sought at."""

MOST_CHANGES = {"steps": 120, "ramps": 240}
"""Steps of a load, or bends of one that ramps, at most: as many as the densest load of `design` has."""

STARTS = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.3), (0.0, 0.0, -0.2))
"""Changes of the process, as in `Process`, from which the best is sought."""

ROUNDS = 2
"""Turns in which the process is fitted and the places are sought anew."""


class Process:
    """A process of the true kind as it answers its input from rest, at the step of the simulation.

    `change`: ln of the factors on its slowest lag (or pair) and on all others, and what is added to its dead time, in
    those lags.
    """

    def __init__(self, scenario: Scenario, change: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        plant, h = scenario.plant, scenario.h
        zeros, poles, k = signal.tf2zpk(list(plant.num), list(plant.den))
        lags = np.array([1 / abs(p) if abs(p) > 1e-9 else 0.0 for p in poles])
        slow = lags > 0.999 * lags.max()
        factor = np.where(lags == 0, 1.0, np.where(slow, math.exp(-change[0]), math.exp(-change[1])))
        num, den = signal.zpk2tf(zeros, poles * factor, k * np.prod(factor))
        sampled, self.den, _ = signal.cont2discrete((num, den), h)
        self.num = sampled[0]
        self.integrating = plant.gain is None
        self.delay = max((plant.dead_time + change[2] * lags.max()) / h, 0.0)
        self.has_others = bool((~slow & (lags > 0)).any())

    def answer(self, v: Floats) -> Floats:
        """PV to an input."""
        return self._later(signal.lfilter(self.num, self.den, v))

    def starts(self, n: int) -> list[Floats]:
        """PV after every way in which the process may not have been at rest."""
        ways = np.eye(len(self.den) - 1)
        return [self._later(signal.lfilter(self.num, self.den, np.zeros(n), zi=way)[0]) for way in ways]

    def _later(self, y: Floats) -> Floats:
        whole = int(self.delay)
        part = self.delay - whole
        late = np.concatenate([np.zeros(whole + 1), y])
        moved: Floats = (1 - part) * late[1 : y.size + 1] + part * late[: y.size]
        return moved


class Record:
    """A record with all that is true of it."""

    def __init__(self, name: str) -> None:
        drawn = draw(name)
        assert drawn is not None
        self.drawn: Drawn = drawn
        self.scenario = drawn.scenario
        self.simulation: Simulation = run(drawn.scenario)
        self.n = self.simulation.t.size
        self.kept = np.arange(0, self.n, drawn.every)
        pv = self.simulation.pv[self.kept]
        self.pv: Floats = compressed(pv, drawn.band) if drawn.band else pv
        self.rest = float(self.simulation.position[0])
        self.recorded: Floats = np.interp(
            self.simulation.t, self.simulation.t[self.kept], self.simulation.op[self.kept]
        )
        self.kind = next((k for k in ("steps", "ramps") if f"/{k}/" in name), "walk")
        self.true = Process(self.scenario)
        self.white = self._white()
        self.pv_white = self.white(self.pv)
        ramps = [p for p in self.scenario.load if isinstance(p, Ramp)]
        jumps = [at for p in self.scenario.load if isinstance(p, Steps) for at, _ in p.steps if at > 0]
        times = jumps + [at for p in ramps for at in (p.t, p.t + p.over)]
        first = np.ceil(np.array(times, dtype=float) / self.scenario.h - 1e-9).astype(int)
        self.changes = np.unique(first[first < self.n])
        self.over = ramps[0].over if ramps else 0.0

    def _white(self) -> Callable[[Floats], Floats]:
        """A map that leaves white noise of variance 1 of the noise and of a load that walks."""
        # A held value is off by anything between ± band.
        sigma = math.hypot(self.drawn.noise, self.drawn.band / math.sqrt(3))
        m = self.kept.size
        covariance = None
        (noise,) = self.scenario.noise
        if isinstance(noise, Coloured):
            fading = noise.tau / (noise.tau + self.scenario.h)
            covariance = sigma**2 * linalg.toeplitz(fading ** (self.drawn.every * np.arange(m)))
        for piece in self.scenario.load:
            if isinstance(piece, Walk):
                covariance = sigma**2 * np.eye(m) if covariance is None else covariance
                step = self.true.answer(np.ones(self.n))[self.kept]
                each = piece.rate * math.sqrt(self.scenario.h * self.drawn.every) * step
                answers = linalg.toeplitz(each, np.zeros(m))
                covariance = covariance + answers @ answers.T
        if covariance is None:
            return lambda x: x / sigma
        inverse = linalg.solve_triangular(linalg.cholesky(covariance, lower=True), np.eye(m), lower=True)
        return lambda x: np.asarray(inverse @ x)

    def valve(self, op: Floats, d: float | None = None) -> Floats:
        """Positions under `op` of a valve with a mere gap of `d`; of the true valve where no width is given."""
        true = self.scenario
        parts: dict[str, modules.Module] = {"op": modules.Input()}
        width = true.d if d is None else d
        if width > 0:
            parts["gap"] = modules.Backlash(width, self.rest)
        if d is None and true.friction is not None:
            kind = modules.FrictionModel[true.friction.model.upper()]
            parts["friction"] = modules.Friction(true.friction.s, true.friction.j, kind, self.rest)
        if len(parts) == 1:
            return op
        parts["valve"] = modules.Output()
        moved: Floats = modules.Graph(1.0, parts, [" -> ".join(parts)]).run(op.size, op=op, record=["valve"])["valve"]
        return moved

    def left(self, process: Process, move: Floats, q: Floats) -> Floats:
        """Residual of PV after a movement of the valve, in white noise, and the unknown columns."""
        left = self.pv_white - self.white(process.answer(move)[self.kept])
        rest: Floats = left - q @ (q.T @ left)
        return rest

    def unknown(self, process: Process, *more: Floats) -> Floats:
        """Columns that no rung knows, and `more`: the offset, how the process began, an integrating one's drift."""
        columns = [np.ones(self.n), *process.starts(self.n), *more]
        if process.integrating:
            columns += [np.arange(self.n) / self.n, process.answer(np.ones(self.n))]
        return np.array([c[self.kept] for c in columns if np.abs(c).max() > 1e-9]).T

    def known_load(self, process: Process) -> list[Floats]:
        """The answers to the load's steps and ramps, each of an unknown size."""
        t, step, found = self.simulation.t, process.answer(np.ones(self.n)), []
        for piece in self.scenario.load:
            if isinstance(piece, Ramp):
                found.append(process.answer(np.clip((t - piece.t) / piece.over, 0.0, 1.0)))
            elif isinstance(piece, Steps):
                for at, _ in piece.steps:
                    first = min(math.ceil(at / self.scenario.h - 1e-9), self.n)
                    found.append(np.concatenate([np.zeros(first), step])[: self.n])
        return found

    def places(self) -> Places:
        """Places at which a step or bend is sought [steps of the simulation]: even ones, and the true ones."""
        every = max(self.n / PLACES, self.drawn.every / 2)
        even = np.arange(every, self.n, every).astype(int)
        return np.concatenate([self.changes, even[~np.isin(even, self.changes)]])

    def load_answers(self, process: Process, at: Places) -> Floats:
        """PV to a step, or a bend of the slope, at each of these places, as large as the load's usually are."""
        unit = process.answer(np.ones(self.n)) * self.drawn.load_size
        if self.kind == "ramps":
            unit = np.cumsum(unit) * self.scenario.h / self.over
        since = self.kept[:, None] - at[None, :]
        return np.where(since >= 0, unit[np.maximum(since, 0)], 0.0)


class Cost(NamedTuple):
    """−2·ln L of a hypothesis, its changes of the load, and its residual of PV for each sample."""

    cost: float
    changes: Places
    left: float


def basis(columns: Floats) -> Floats:
    """Orthonormal columns that span these."""
    q, r, _ = linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), mode="economic", pivoting=True)
    return q[:, np.abs(np.diag(r)) > 1e-7]


def known(record: Record, process: Process, moves: Iterable[Floats]) -> list[Cost]:
    """Cost of each movement of the valve where the load's times are known."""
    q = basis(record.white(record.unknown(process, *record.known_load(process))))
    found = []
    for move in moves:
        left = record.left(process, move, q)
        rest = float(left @ left)
        found.append(Cost(rest, record.changes, rest / left.size))
    return found


def sought(record: Record, process: Process, moves: Iterable[Floats], variance: float) -> list[Cost]:
    """Cost of each movement where the places of the load's changes are sought, at the price of place and size.

    Orthogonal least squares: the change that pays most is taken in turn, from none and from the true ones; then what no
    longer pays is left out. A load that walks has no places.
    """
    q = basis(record.white(record.unknown(process)))
    left = [record.left(process, move, q) for move in moves]
    if record.kind == "walk":
        return [Cost(float(x @ x) / variance, record.changes, float(x @ x) / x.size) for x in left]
    at = record.places()
    answers = record.white(record.load_answers(process, at))
    answers -= q @ (q.T @ answers)
    gram = answers.T @ answers / variance
    most, towards = MOST_CHANGES[record.kind], [answers.T @ x / variance for x in left]
    begun: list[list[int]] = [[], list(range(record.changes.size))]
    best = [max(_pursued(gram, toward, start, most) for start in begun) for toward in towards]
    # Changes found for the best of them help the others as much.
    cost = [float(x @ x) / variance - gain for x, (gain, _) in zip(left, best, strict=True)]
    again = best[int(np.argmin(cost))][1]
    best = [max(pair, _pursued(gram, y, again, most)) for pair, y in zip(best, towards, strict=True)]
    return [
        Cost(float(x @ x) / variance - gain, at[taken], float(x @ x) / x.size)
        for x, (gain, taken) in zip(left, best, strict=True)
    ]


class Refitted(NamedTuple):
    """−2·ln L with the process that was found, the changes of the load, and those of the process, as in `Process`."""

    cost: float
    changes: Places
    process: tuple[float, ...]


def refitted(
    record: Record, move: Floats, cost: Cost, variance: float, begin: Sequence[Sequence[float]] = STARTS
) -> Refitted:
    """Cost of a movement of the valve with its best process: gain, lags and dead time are free.

    The process is sought from each of `begin`, all to its places of the load, which are then sought anew. A load that
    walks is taken to walk through the true process all the same.
    """
    free = [0, 1, 2] if record.true.has_others else [0, 2]

    def process(x: Floats) -> Process:
        change = np.zeros(3)
        change[free] = x
        return Process(record.scenario, change.tolist())

    def parts(now: Process, changes: Places) -> tuple[Floats, Floats]:
        white = record.white(np.column_stack([now.answer(move)[record.kept], record.unknown(now)]))
        q = basis(white[:, 1:])
        both = np.column_stack([white[:, 0], record.pv_white])
        both -= q @ (q.T @ both)
        if changes.size:
            load = record.white(record.load_answers(now, changes))
            load -= q @ (q.T @ load)
            load /= np.maximum(np.linalg.norm(load, axis=0), 1e-300)
            gram = load.T @ load
            gram[np.diag_indices_from(gram)] += 1e-9
            both -= load @ linalg.solve(gram, load.T @ both, assume_a="pos")
        v, y = both.T
        return v, y

    def left(x: Floats, changes: Places) -> Floats:
        v, y = parts(process(x), changes)
        rest: Floats = y - v * (float(v @ y) / max(float(v @ v), 1e-300))
        return rest

    def descended(x: Floats, changes: Places) -> tuple[float, Floats]:
        found = optimize.least_squares(
            left, x, bounds=(-1.5, 1.5), args=(changes,), diff_step=1e-3, x_scale=0.1, max_nfev=10
        )
        return float(found.cost), found.x

    best, at = cost, np.zeros(3)
    starts = [np.array(start)[free] for start in begin]
    for _ in range(ROUNDS):
        _, x = min((descended(start, best.changes) for start in starts), key=lambda found: found[0])
        now = process(x)
        v, y = parts(now, best.changes)
        (found,) = sought(record, now, [float(v @ y) / max(float(v @ v), 1e-300) * move], variance)
        if found.cost > best.cost - 1:
            break
        best, starts = found, [x]
        at[free] = x
    return Refitted(best.cost, best.changes, tuple(at.tolist()))


def _pursued(gram: Floats, toward: Floats, taken: list[int], most: int) -> tuple[float, list[int]]:
    """Joint gain of the changes that pay, and the changes."""
    for _ in range(3):
        before = set(taken)
        taken = _left_out(gram, toward, _added(gram, toward, taken, most))
        if set(taken) == before:
            break
    return _gain(gram, toward, taken), taken


def _added(gram: Floats, toward: Floats, taken: list[int], most: int) -> list[int]:
    """`taken` and the changes that pay beside them, that which pays most first."""
    taken, size = list(taken), toward.size
    inverse = linalg.pinvh(gram[np.ix_(taken, taken)])
    beside = gram[:, taken] @ inverse
    g, b = gram - beside @ gram[taken], toward - beside @ toward[taken]
    while len(taken) < most:
        own = np.diag(g)
        usable = own > 1e-6 * np.diag(gram)
        usable[taken] = False
        worth = np.where(usable, b**2 / np.where(usable, own, 1.0) - np.log1p(np.maximum(own, 0.0)), -np.inf)
        best = int(worth.argmax())
        if worth[best] < 2 * math.log((size - len(taken)) / (len(taken) + 1)):
            break
        column = g[:, best] / g[best, best]
        b = b - column * b[best]
        g = g - np.outer(column, g[best])
        taken.append(best)
    return taken


def _left_out(gram: Floats, toward: Floats, taken: list[int]) -> list[int]:
    """`taken` without the changes that gain less than their price beside the others."""
    taken, size = list(taken), toward.size
    while taken:
        inverse = linalg.pinvh(gram[np.ix_(taken, taken)])
        own = 1 / np.maximum(np.diag(inverse), 1e-300)
        worth = (inverse @ toward[taken]) ** 2 * own - np.log1p(own)
        least = int(worth.argmin())
        if worth[least] > 2 * math.log((size - len(taken) + 1) / len(taken)):
            break
        del taken[least]
    return taken


def _gain(gram: Floats, toward: Floats, taken: list[int]) -> float:
    """Decrease of −2·ln L by these changes, less the price of their places and sizes."""
    inner, count, size = gram[np.ix_(taken, taken)], len(taken), toward.size
    fitted = float(toward[taken] @ linalg.pinvh(inner) @ toward[taken])
    _, sizes = np.linalg.slogdet(inner + np.eye(count))
    places = math.lgamma(size + 1) - math.lgamma(count + 1) - math.lgamma(size - count + 1)
    return fitted - float(sizes) - 2 * places


PARTS = (1.0, 0.8, 0.6, 0.4, 0.2, 0.0)
"""Parts of the likelihood ratio that the fit asks for."""

LEAST_LOW, DENSE = (_glapp.fit_thresholds()[name][0] for name in ("LEAST_LOW", "CELLS_A_CHANGE"))
"""A lower limit that is a smaller part of the width is none; steps and bends denser than that are not believed."""


@dataclass(frozen=True)
class Rungs:
    """Result of the oracle on a record.

    - `lr_no_gap`: −2·Δln L of no gap on each of `RUNGS`, against the true valve or a mere gap of nearly its width; of a
      record without a gap against the best of `WIDTHS`. Below 0 no gap explains the record better.
    - `lr_no_jump`: the same of the best mere gap against the true valve that sticks; empty where it does not stick.
    - `d`, `low`, `high`: most likely width and its limits by the fit, told or not [% of OP].
    - `ratio`, `asked`: likelihood ratio of no gap by the fit, and what it must exceed.
    - `marks`: steps and bends of the load that the fit believes in.
    - `changes`: how many there are.
    """

    name: str
    lr_no_gap: list[float]
    lr_no_jump: list[float]
    d: float | None = None
    low: float | None = None
    high: float | None = None
    ratio: float | None = None
    asked: float | None = None
    marks: int | None = None
    changes: int = 0

    def holds(self, truth: Truth, part: float) -> bool | None:
        """Whether the width would be true with a threshold lowered to such a part, and no other change.

        None where it would still tell none: the ratio is less, or there are no two limits, the lower no trifle.
        """
        if None in (self.d, self.low, self.high, self.ratio, self.asked):
            return None
        told = self.ratio > part * self.asked and self.low >= LEAST_LOW * self.d > 0  # type: ignore[operator]
        return self.low <= truth.d <= self.high if told else None  # type: ignore[operator]

    @classmethod
    def of(cls, name: str) -> Self:
        """Ask about the record of that name."""
        record = Record(name)
        simulation, d = record.simulation, record.drawn.d
        tried, whole = (NEARER, d) if d > 0 else (WIDTHS, float(np.ptp(simulation.op)))
        widths = [part * whole for part in tried]
        sticks = record.scenario.friction is not None

        def moves(op: Floats) -> list[Floats]:
            valves = [op, *(record.valve(op, width) for width in widths), *([record.valve(op)] if sticks else [])]
            return [valve - record.rest for valve in valves]

        gaps = slice(1, 1 + len(widths))

        def ratios(costs: Sequence[float]) -> tuple[float, float]:
            return costs[0] - min(costs[1:]), min(costs[gaps]) - costs[-1]

        there, seen = moves(simulation.op), moves(record.recorded)
        # The unknown course of OP is more noise.
        variance = max(1.0, min(cost.left for cost in known(record, record.true, seen)))
        rungs = [known(record, record.true, there), sought(record, record.true, there, 1.0)]
        rungs.append(sought(record, record.true, seen, variance))
        costs = [[cost.cost for cost in rung] for rung in rungs]
        last = [math.inf] * len(seen)
        nearest = sorted(range(len(seen))[gaps], key=lambda i: costs[-1][i])[:FOLLOWED]
        for i in {0, *nearest, *([len(seen) - 1] if sticks else [])}:
            last[i] = refitted(record, seen[i], rungs[-1][i], variance).cost
        told = [ratios(rung) for rung in (*costs, last)]
        jumps = [jump for _, jump in told] if sticks else []
        made = made_record(name)
        assert made is not None
        fit = glapp.fit(made[0].recording)
        return cls(
            name, [gap for gap, _ in told], jumps, fit.d, fit.low, fit.high, fit.lr_no_gap, fit.lr_needed, fit.why
        )


def leaving(op: Floats, position: Floats, kept: Places) -> float:
    """Median move of OP, from one recorded sample to the next, in which the valve begins to move the other way."""
    moves = np.diff(position[kept])
    at = np.flatnonzero(moves)
    turned = at[1:][np.sign(moves[at[1:]]) != np.sign(moves[at[:-1]])]
    return float(np.median(np.abs(np.diff(op[kept])[turned]))) if turned.size else math.nan


def thresholds(sound: Sequence[tuple[Truth, Rungs]]) -> dict[str, list[float]]:
    """Thresholds on each rung that no record without a gap reaches, for each kind of load; no less than the fit's."""

    def greatest(load: str, i: int) -> float:
        return max((rungs.lr_no_gap[i] for truth, rungs in sound if truth.load == load), default=0.0)

    return {load: [max(NO_GAP, greatest(load, i)) for i in range(len(RUNGS))] for load in LOADS}


def seen(rungs: Rungs, least: Sequence[float]) -> list[bool]:
    """Whether a gap is seen on each rung and on all above it."""
    above = [ratio > x for ratio, x in zip(rungs.lr_no_gap, least, strict=True)]
    return [all(above[: i + 1]) for i in range(len(RUNGS))]


def ask(name: str) -> Rungs:
    """Ask about one record; for a pool of processes."""
    return Rungs.of(name)


def percent(part: float | np.floating) -> str:
    """A share as the other tables have it."""
    return f"{100 * part:.0f} %"


def tables(gaps: Sequence[tuple[Scored, Rungs]], sound: Sequence[tuple[Truth, Rungs]]) -> str:
    """Number of gaps that can be told on each rung, and the rung on which those are lost that the fit does not tell."""
    asked = thresholds(sound)
    body = []
    for load in (*LOADS, "all"):
        of = [(row, seen(rungs, asked[row.truth.load])) for row, rungs in gaps if load in (row.truth.load, "all")]
        if not of:
            continue
        least = [f" (> {x:.0f})" for x in asked[load]] if load in asked else [""] * len(RUNGS)
        shares = [f"{percent(np.mean([rung[i] for _, rung in of]))}{least[i]}" for i in range(len(RUNGS))]
        body.append([load, str(len(of)), *shares, percent(np.mean([row.covered is True for row, _ in of]))])
    parts = [markdown(["load", "records", *RUNGS, "the fit: a true width"], body)]
    body = []
    said: dict[str, Callable[[Scored], bool]] = {
        "a true width": lambda row: row.covered is True,
        "a false width": lambda row: row.covered is False,
        "a bound": lambda row: row.d is None and row.verdict != "sound" and row.alarm,
        "sound": lambda row: row.verdict == "sound",
        "silent": lambda row: row.d is None and row.verdict != "sound" and not row.alarm,
    }
    for what, holds in said.items():
        rungs_of = [seen(rungs, asked[row.truth.load]) for row, rungs in gaps if holds(row)]
        lost = [sum(sum(rung) == i for rung in rungs_of) for i in range(len(RUNGS) + 1)]
        body.append([what, str(len(rungs_of)), *map(str, lost)])
    parts.append(markdown(["the fit says", "records", *(f"lost: {rung}" for rung in RUNGS), "seen to the end"], body))
    return "\n\n".join(parts)


def unseen(gaps: Sequence[tuple[Scored, Rungs]], sound: Sequence[tuple[Truth, Rungs]]) -> str:
    """Reasons of the fit in the records that are seen on all rungs, and of which it tells no width."""
    asked, body = thresholds(sound), []
    for load in LOADS:
        of = [
            (row.truth, r) for row, r in gaps if row.d is None and row.truth.load == load and seen(r, asked[load])[-1]
        ]
        less = [(truth, r) for truth, r in of if (r.ratio or 0.0) <= (r.asked or 0.0)]
        unmarked = [truth.samples < DENSE * r.changes for truth, r in less if not r.marks]
        numbers = (len(of), len(of) - len(less), len(less) - len(unmarked), len(unmarked), sum(unmarked))
        body.append([load, *map(str, numbers)])
    head = ["load", "seen on all rungs, no width", "the fit's ratio is as large as it asks", "smaller, with marks"]
    return markdown([*head, "smaller, without", f"of these more than a change in {DENSE:.0f} samples"], body)


def causes(gaps: Sequence[tuple[Scored, Rungs]]) -> str:
    """Number of sticking valves whose jump is seen, and not only a gap, on each rung, and by the fit."""
    body = []
    for load in (*LOADS, "all"):
        of = [(row, r.lr_no_jump) for row, r in gaps if row.truth.cause_told and load in (row.truth.load, "all")]
        if of:
            above = [[all(x > NO_JUMP for x in ratios[: i + 1]) for _, ratios in of] for i in range(len(RUNGS))]
            right = np.mean([row.verdict == row.truth.cause for row, _ in of])
            body.append([load, str(len(of)), *(percent(np.mean(rung)) for rung in above), percent(right)])
    return markdown(["load", "valves that stick", *RUNGS, "the fit: the right cause"], body)


def asked_for_less(gaps: Sequence[tuple[Truth, Rungs]], sound: Sequence[tuple[Truth, Rungs]]) -> str:
    """Widths that the fit would give with a lower threshold of its likelihood ratio, and no other change."""
    body = []
    for part in PARTS:
        found = [rungs.holds(truth, part) for truth, rungs in gaps]
        claims = sum(rungs.holds(truth, part) is not None for truth, rungs in sound)
        numbers = (found.count(True), found.count(False), found.count(None), claims)
        body.append([f"{part:g}", *map(str, numbers)])
    head = ["part of what is asked", "true widths", "false widths", "none", f"widths in {len(sound)} without a gap"]
    return markdown(head, body)


SLOWLY = 6.0
"""Median moves of OP in the sample in which the valve leaves its gap, that a gap is wide where these hide nothing."""


def definitions(scored: Sequence[Scored], leavings: dict[str, float], held: set[str]) -> str:
    """Share of the identifiable gaps that the fit tells, by several definitions of identifiable."""

    def apart(row: Scored) -> bool:
        return row.truth.d >= SLOWLY * leavings[row.truth.name]

    def but_for_h(row: Scored) -> bool:
        return not any(lacks(row.truth) for why, lacks in LACKING.items() if why != "h > T/5")

    said: dict[str, Callable[[Scored], bool]] = {
        "h ≤ T/5, as the records were chosen": lambda row: row.truth.identifiable,
        "d ≥ 6e as well": lambda row: row.truth.identifiable and apart(row),
        "d ≥ 6e instead": lambda row: but_for_h(row) and apart(row),
        "h ≤ T/5, and seen on all rungs": lambda row: row.truth.name in held,
    }
    body = []
    for what, holds in said.items():
        of = [row for row in scored if holds(row)]
        told = [row for row in of if row.covered is not None]
        right = sum(bool(row.covered) for row in told)
        bias = f"{100 * np.median([row.error for row in told]):+.1f} %" if told else ""
        body.append([what, str(len(of)), percent(len(told) / max(len(of), 1)), bias, f"{right} of {len(told)}"])
    return markdown(["identifiable", "records", "answered", "bias", "interval holds"], body)


def leaving_of(name: str) -> float:
    """`leaving` of the record of that name."""
    drawn = draw(name)
    assert drawn is not None
    simulation = run(drawn.scenario)
    return leaving(simulation.op, simulation.position, np.arange(0, simulation.t.size, drawn.every))


def main() -> None:
    """Ask about the identifiable gaps that the bench asked the fit about, and about as many records without one."""
    parser = argparse.ArgumentParser(prog="python -m bench.truth.ladder", description=__doc__.split("\n\n")[0])
    parser.add_argument(
        "each", type=int, nargs="?", default=10, help="the first so many of every kind in out/truth.csv"
    )
    parser.add_argument("--family", choices=FAMILIES, default="inside")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--resume", action="store_true", help="go on with out/ladder.jsonl")
    parser.add_argument("--docs", action="store_true", help="write the tables into bench/results/truth.md")
    given = parser.parse_args()
    if not TRUTH.exists():
        parser.error(f"there is no {TRUTH}: run python -m bench.truth first")
    if not given.resume:
        OUT.unlink(missing_ok=True)
    done = {r.name: r for r in map(_read, OUT.read_text("utf-8").splitlines())} if OUT.exists() else {}
    every = [row for row in read(TRUTH) if row.method == "fit" and row.truth.family == given.family]
    faulty = [row for row in every if row.truth.cause in FAULTY]
    gaps = first(given.each, [row for row in faulty if row.truth.identifiable])
    # The oracle's covariance lacks the walk of a load between two samples.
    none = first(given.each, [r for r in every if r.truth.cause == "none" and r.truth.h <= r.truth.lag / 5])
    left = [row.truth.name for row in (*gaps, *none) if row.truth.name not in done]
    with OUT.open("a", encoding="utf-8") as file:
        for rungs in answers_of(ask, left, given.jobs):
            done[rungs.name] = rungs
            print(json.dumps(asdict(rungs)), file=file, flush=True)
    names = [row.truth.name for row in faulty]
    leavings = dict(zip(names, answers_of(leaving_of, names, given.jobs), strict=True))
    told = [(row, done[row.truth.name]) for row in gaps]
    sound = [(row.truth, done[row.truth.name]) for row in none]
    least = thresholds(sound)
    held = {rungs.name for row, rungs in told if seen(rungs, least[row.truth.load])[-1]}
    less = asked_for_less([(row.truth, rungs) for row, rungs in told], sound)
    text = "\n\n".join(
        [tables(told, sound), unseen(told, sound), causes(told), less, definitions(faulty, leavings, held)]
    )
    text = f"The first {given.each} of every kind {given.family} the family.\n\n{text}"
    print(text)
    if given.docs:
        write("truth.md", text, "ladder")


def first(each: int, rows: Sequence[Scored]) -> list[Scored]:
    """The first so many of every cell, the first of all cells first."""
    places: dict[Cell, int] = {}
    placed = []
    for row in rows:
        place = places[row.truth.cell] = places.get(row.truth.cell, -1) + 1
        placed.append((place, row))
    return [row for place, row in sorted(placed, key=lambda pair: pair[0]) if place < each]


def _read(line: str) -> Rungs:
    return Rungs(**json.loads(line))


if __name__ == "__main__":
    main()
