"""Benefit of compensation, its false warnings, and its possible harm: `python -m bench.compensation`.

Up to an hour on two cores; `--loops 100` makes the last parts shorter, `--only late` makes one part, `--docs` writes
the tables into bench/results/compensation.md. Everything is simulated, so that the gap is known; the module
that ships compensates.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # many processes, each with its own core

import argparse
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise, product
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.progress import track

from glapp import tuning
from glapp.blocks import SecondOrderFilter
from glapp.errors import InputError
from glapp.plant import PLANTS, Plant
from glapp.recording import BAD, NOT_AUTO
from glapp.simulate import (
    COMPENSATION_STATES,
    Coloured,
    Compensation,
    Scenario,
    Simulation,
    Sine,
    Steps,
    Uniform,
    Walk,
    run,
)
from glapp_thesis.loops import short

from .page import write

Floats = npt.NDArray[np.float64]
WAYS = ("error", "derivative", "inverse")
WITHDRAWN = [COMPENSATION_STATES.index(name) for name in ("worse", "over_compensated")]
GAP = 0.05
HELPS = 0.95
"""PV's standard deviation, by that without compensation, from which on it counts as a help."""


def turns(x: Floats, band: float) -> list[int]:
    """Rows at which x has turned back from its farthest by more than `band`."""
    slope = np.sign(np.diff(x))
    moves = np.flatnonzero(slope)
    rows = np.append(moves[1:][np.diff(slope[moves]) != 0], x.size - 1)
    found, direction = [], 0
    low = high = float(x[0])
    for row, value in zip(rows.tolist(), x[rows].tolist(), strict=True):
        low, high = min(low, value), max(high, value)
        if direction <= 0 and value - low > band:
            found += [row] if direction < 0 else []
            direction, low, high = 1, value, value
        elif direction >= 0 and high - value > band:
            found += [row] if direction > 0 else []
            direction, low, high = -1, value, value
    return found


def reversals(x: Floats, band: float) -> int:
    """Number of times that x turns back by more than `band`."""
    return len(turns(x, band))


# --- Benefit -------------------------------------------------------------------------------------------------------

LOOPS = {
    "P2, Ms 2.0": ("P2", (0.775, 2.05)),
    "P3, PI of 5.2": ("P3", (0.48, 0.3117)),
    "P1, Ms 1.4": ("P1", (0.363, 7.06)),
}
SIZES = {"under, d/2": 0.5, "exact, d": 1.0, "over, 1.4d": 1.4}
SEEDS = 5


def measured(fields: dict[str, Any]) -> tuple[float, float, float]:
    """PV's standard deviation [%], OP's travel [%] and reversals by more than 0.5 %, in 1000 s."""
    s = run(short(**fields))
    late = s.t > s.t[-1] - 1000
    op = 100 * s.op[late]
    return 100 * float(np.std(s.pv[late])), float(np.abs(np.diff(op)).sum()), reversals(op, 0.5)


def brings(pool: ProcessPoolExecutor) -> Iterator[str]:
    """The first table."""
    yield "| loop | way | size | PV's standard deviation [%] | OP's travel [%/1000 s] | OP's reversals [1/1000 s] |"
    yield "|---|---|---|---|---|---|"
    for name, (plant, controller) in LOOPS.items():
        base = {"plant": plant, "controller": controller, "d": GAP, "noise": 0.005, "t_end": 2000.0}
        base |= {"setpoint": [(1, 1.0)], "load": [Steps(steps=((100.0, 0.3),)), Walk(rate=0.002)]}
        ways: list[tuple[str, str, Compensation | None]] = [("none", "before", None)]
        for way, (what, size) in product(WAYS, SIZES.items()):
            ways.append((way, what, Compensation(way=way, size=size * GAP, withdraw=False)))  # type: ignore[arg-type]
        for way, what, compensation in ways:
            runs = [base | {"seed": seed, "compensation": compensation} for seed in range(SEEDS)]
            std, travel, turns = np.median(list(pool.map(measured, runs)), axis=0)
            yield f"| {name} | {way} | {what} | {std:.2f} | {travel:.0f} | {turns:.0f} |"


# --- When its warnings are wrong ------------------------------------------------------------------------------------


def half_periods(s: Simulation, case: Scenario) -> Iterator[tuple[float, float, float]]:
    """(end, Δt, Δy) of each half-period of the filtered error."""
    smooth = SecondOrderFilter(case.filter_time())
    e = s.sp - np.array([smooth.update(y, case.h) for y in s.pv.tolist()])
    sign = np.sign(e)
    known = np.flatnonzero(sign)
    at = known[1:][np.diff(sign[known]) != 0]
    area = np.concatenate([[0.0], np.cumsum(np.abs(e) * case.h)])
    for begin, end in pairwise(at):
        delta_t = float(end - begin) * case.h
        yield float(s.t[end]), delta_t, float(area[end] - area[begin]) / delta_t


@dataclass(frozen=True)
class Case:
    """A compensated loop, and its truth."""

    plant: str
    noise: float
    dead_time: float
    h: float
    way: Any
    ratio: float
    seed: int

    @property
    def over(self) -> bool:
        """Whether the size exceeds the gap."""
        return self.ratio > 1


CASES = tuple(
    Case(*case)
    for case in product(
        ("P1", "P2", "P3"),
        (0.001, 0.005, 0.02),
        (0.0, 1.0, 4.0),
        (1 / 50, 1 / 10, 1 / 4),
        ("error", "inverse"),
        (0.5, 0.8, 1.0, 1.5, 2.0),
        (0, 1),
    )
)


def warned(case: Case) -> tuple[Case, float, float] | None:
    """Share of the half-periods after which each warning stands; None where the loop cannot be sampled so coarsely."""
    plant = PLANTS[case.plant].delayed(case.dead_time)
    tuned = tuning.amigo_step(plant, "PI").controller
    unit = max(tuned.ti, 1.0)
    begin = 300 * unit
    size = case.ratio * GAP
    # The estimate would take what is too much away before a warning is due.
    given = Compensation(way=case.way, size=size, begin=begin, withdraw=False, estimate=False)
    loop = short(
        plant=plant,
        controller=tuned,
        d=GAP,
        noise=case.noise,
        h=case.h * tuned.ti,
        t_end=600 * unit,
        load=[Steps(steps=((20 * unit, 0.3),)), Walk(rate=0.1 * GAP / math.sqrt(10 * unit))],
        compensation=given,
        seed=case.seed,
    )
    try:
        s = run(loop)
    except InputError:
        return None
    assert s.over is not None
    ends = [round(end / loop.h) for end, _, _ in half_periods(s, loop) if end > 50 * unit]
    compensated = ends[-max(1, round(len(ends) / 2)) :]
    # The block acts on a half-period in the scan after it.
    over = s.over[np.minimum(np.array(compensated, dtype=int) + 1, s.over.size - 1)].astype(int)
    return case, float(np.mean(over & 1 != 0)), float(np.mean(over & 2 != 0))


def warns(pool: ProcessPoolExecutor) -> Iterator[str]:
    """The second table."""
    done = track(pool.map(warned, CASES, chunksize=10), "warnings", total=len(CASES), transient=True)
    found = [one for one in done if one is not None]
    yield "| | loops | 7.1: false | 7.1: missed | ours: false | ours: missed |"
    yield "|---|---|---|---|---|---|"
    groups: list[tuple[str, Callable[[Case], bool]]] = [("all", lambda _: True)]
    groups += [(f"plant {x}", lambda c, x=x: c.plant == x) for x in ("P1", "P2", "P3")]
    groups += [(f"noise ± {100 * x:g} %", lambda c, x=x: c.noise == x) for x in (0.001, 0.005, 0.02)]
    groups += [(f"dead time + {x:g} s", lambda c, x=x: c.dead_time == x) for x in (0.0, 1.0, 4.0)]
    groups += [(f"h = Ti/{1 / x:.0f}", lambda c, x=x: c.h == x) for x in (1 / 50, 1 / 10, 1 / 4)]
    groups += [(f"by {x}", lambda c, x=x: c.way == x) for x in ("error", "inverse")]
    groups += [(f"size {x:g}d", lambda c, x=x: c.ratio == x) for x in (0.5, 0.8, 1.0, 1.5, 2.0)]
    for name, belongs in groups:
        chosen = [one for one in found if belongs(one[0])]
        cells = []
        for column in (1, 2):
            false = [one[column] > 0 for one in chosen if not one[0].over]
            missed = [one[column] == 0 for one in chosen if one[0].over]
            cells += [f"{np.mean(x):.1%}" if x else "" for x in (false, missed)]
        yield f"| {name} | {len(chosen)} | {' | '.join(cells)} |"


# --- Whether it does harm -------------------------------------------------------------------------------------------


def _process(random: np.random.Generator) -> tuple[str, Plant]:
    """One of the batch, or lags with dead time, an integrator, a resonance."""
    kind = random.choice(["batch", "lags", "integrating", "resonant"], p=[0.3, 0.4, 0.2, 0.1])
    t = 10 ** random.uniform(0, 1.5)
    if kind == "batch":
        name = str(random.choice(list(PLANTS)))
        return name, PLANTS[name]
    dead_time = t * 10 ** random.uniform(-1.3, 0.3)
    gain = 10 ** random.uniform(-0.5, 0.5)
    if kind == "integrating":
        return "integrator", Plant([gain / t], [t * random.uniform(0.1, 1), 1.0, 0.0], dead_time / 2)
    if kind == "resonant":
        return "resonance", Plant([gain], [t * t, 2 * random.uniform(0.2, 0.7) * t, 1.0], dead_time / 2)
    lags = int(random.integers(1, 5))
    den = np.array([t, 1.0])
    for _ in range(lags - 1):
        den = np.polymul(den, [t * 10 ** random.uniform(-0.7, 0), 1.0])
    return f"{lags} lags", Plant([gain], den.tolist(), dead_time)


def _tuned(random: np.random.Generator) -> tuple[str, Plant, tuple[float, float, float], float, float]:
    """Process, controller that somebody has tuned and somebody else changed, filter time, Ms below 3."""
    while True:
        name, plant = _process(random)
        kind: Any = "PID" if random.random() < 0.25 else "PI"
        rules: list[Callable[[], tuning.Tuning]] = [
            lambda plant=plant, kind=kind: tuning.amigo_step(plant, kind),
            lambda plant=plant, kind=kind: tuning.amigo_frequency(plant, kind),
            lambda plant=plant, kind=kind: tuning.migo(plant, kind, ms=float(random.uniform(1.3, 2.0))),
            lambda plant=plant, kind=kind: tuning.simc(plant, kind),
            lambda plant=plant, kind=kind: tuning.ziegler_nichols_frequency(plant, kind),
        ]
        try:
            k, ti, td, _ = rules[int(random.integers(len(rules)))]().controller
            k, ti = k * math.exp(random.normal(0, 0.25)), ti * math.exp(random.normal(0, 0.25))
            tf = td / 5 if td > 0 else ti / 10
            ms = tuning.assess(plant, (k, ti, td), tf=tf).ms
        except InputError:
            continue
        if ms < 3:
            return f"{name}, {kind}", plant, (k, ti, td), tf, ms


def random_loop(number: int, way: Any) -> Scenario:
    """A random loop: process, tuning, gap, noise, load, setpoint, lost values and errors are drawn."""
    drawn = _drawn(number)
    assert drawn.compensation is not None
    return drawn.model_copy(update={"compensation": drawn.compensation.model_copy(update={"way": way})})


@lru_cache(maxsize=1)  # tuning it takes longer than running it
def _drawn(number: int) -> Scenario:
    random = np.random.default_rng([5, number])
    name, plant, (k, ti, td), tf, ms = _tuned(random)
    fastest = float(np.abs(plant.poles).max())
    h = min(ti / random.uniform(8, 60), 0.9 * math.pi / fastest if fastest > 0 else math.inf)
    if random.random() < 0.25:
        plant, k = plant * -1.0, -k
    width = 10 ** random.uniform(-0.3, 1.0)
    d = 0.0 if random.random() < 0.15 else width
    size = width * 10 ** random.uniform(-0.5, 0.3)
    unit = max(ti, 5 * h)
    t_end = min(random.uniform(600, 1200) * unit, 150_000 * h)
    reach = width * (abs(plant.gain) if plant.gain is not None else 1 / abs(k))
    noise = reach * 10 ** random.uniform(-2, 0)
    white = random.random() < 0.7
    load: list[Any] = [Steps(steps=((random.uniform(0.02, 0.1) * t_end, random.uniform(-3, 3) * width),))]
    if random.random() < 0.7:
        load.append(Walk(rate=width * 10 ** random.uniform(-1.5, 0) / math.sqrt(10 * unit)))
    if random.random() < 0.2:
        load.append(Sine(amplitude=width * random.uniform(0.2, 2), period=unit * 10 ** random.uniform(0.7, 2)))
    setpoint = [(0.0, 0.0)]
    if random.random() < 0.3:
        times = np.cumsum(random.uniform(20, 200, 60) * unit)
        setpoint += [(float(t), float(reach * random.normal(0, 1.5))) for t in times if t < t_end]
    lost = random.uniform(0.2, 0.98, 3) * t_end if random.random() < 0.3 else []
    by_hand = random.uniform(0.35, 0.9) * t_end
    wrong = (-1 if random.random() < 0.2 else 1) * 10 ** random.uniform(-0.5, 0.5) if random.random() < 0.5 else 1
    return short(
        name=f"{number}: {name}, Ms {ms:.1f}",
        plant=plant,
        controller=(k, ti, td),
        tf=tf,
        d=d,
        noise=Uniform(amplitude=noise) if white else Coloured(sigma=noise / 2, tau=unit * random.uniform(0.05, 1)),
        load=load,
        setpoint=setpoint,
        bad=tuple((float(t), float(t + random.uniform(1, 10) * unit)) for t in lost),
        manual=((by_hand, by_hand + random.uniform(1, 15) * unit),) if random.random() < 0.2 else (),
        limits=(-random.uniform(3, 12) * width, random.uniform(3, 12) * width) if random.random() < 0.2 else None,
        h=h,
        t_end=t_end,
        seed=number,
        compensation=Compensation(way="inverse", size=size, share=0.8, begin=t_end / 3, k=wrong * k),
    )


def _within(pv: float, turns: int, turns_without: int) -> bool:
    """Whether PV's deviation, by that without compensation, and OP's reversals are within the bounds."""
    return pv <= 1.1 and turns <= 1.5 * turns_without + 2


@dataclass(frozen=True)
class Harm:
    """A random loop with and without its compensation, over the last third."""

    name: str
    gap: float
    size: float
    pv: float
    """PV's standard deviation by that of the uncompensated loop."""
    turns: int
    turns_without: int
    standing: str
    active: float
    """Share of the time in which it was in force."""
    broken: str
    """The first promise that it broke, if it did: size, rate, limits, held, taken away."""
    since_force: int | None = None
    """Half-periods from where it came in force to where it was withdrawn; None: it was not."""
    since_shown: int | None = None
    """Half-periods from the first harm to the withdrawal; 0: withdrawn before; None: no withdrawal or no harm."""
    kept: float | None = None
    """The result had it not been withdrawn, where it was withdrawn though it would have stayed within the bounds: `pv`
    had it not been.
    """
    absent: bool = False
    """u_FF is 0 in all of the last third: what is compared there is the loop without compensation, twice."""

    @property
    def harmless(self) -> bool:
        """The bounds, with two reversals for counts that are small."""
        return _within(self.pv, self.turns, self.turns_without)

    @property
    def at_once(self) -> bool:
        """Withdrawn within ten half-periods of where it came in force."""
        return self.since_force is not None and self.since_force <= 10

    @property
    def in_time(self) -> bool:
        """Withdrawn within ten half-periods of where harm began to show, or of where it came in force."""
        return self.at_once or (self.since_shown is not None and self.since_shown <= 10)

    @property
    def settled(self) -> bool:
        """Within the bounds, withdrawn in time, or gone before the last third."""
        return self.harmless or self.in_time or self.absent

    @property
    def badness(self) -> float:
        """Ratio by which the bounds are exceeded."""
        return max(self.pv / 1.1, self.turns / (1.5 * self.turns_without + 2))


def harm(number: int, way: str) -> Harm | None:
    """A loop with compensation and without, run alike; None where it cannot begin at rest within its limits."""
    with_it = random_loop(number, way)
    given = with_it.compensation
    assert given is not None
    try:
        compensated, without = run(with_it), run(_never(with_it))
    except InputError:
        return None
    found = _harm(with_it, compensated, without)
    if found.since_force is None:
        return found
    kept = run(with_it.model_copy(update={"compensation": given.model_copy(update={"withdraw": False})}))
    last = without.t > 2 / 3 * without.t[-1]
    pv_kept, turns_kept, _ = _beside(kept, without, last, given.size / 10)
    return replace(found, kept=pv_kept) if _within(pv_kept, turns_kept, found.turns_without) else found


def _harm(with_it: Scenario, compensated: Simulation, without: Simulation) -> Harm:
    """Comparison of the compensated loop with the one without."""
    given = with_it.compensation
    assert given is not None and compensated.u_ff is not None and compensated.standing is not None
    band = given.size / 10
    size, ti = given.share * given.size, with_it.ideal().ti
    late = without.t > 2 / 3 * without.t[-1]
    pv, turns, turns_without = _beside(compensated, without, late, band)
    withdrawn = np.flatnonzero(np.isin(compensated.standing, WITHDRAWN))
    counts: dict[str, Any] = {}
    if withdrawn.size:
        counts |= _in_time(compensated, without, with_it, int(withdrawn[0]))
    return Harm(
        name=with_it.name,
        gap=with_it.d,
        size=size,
        pv=pv,
        turns=turns,
        turns_without=turns_without,
        standing=COMPENSATION_STATES[int(compensated.standing[-1])],
        active=float(np.mean(compensated.standing[late] == 0)),
        absent=not compensated.u_ff[late].any(),
        broken=_broken(compensated, with_it, size, 10 * size / ti if given.way == "inverse" else size / with_it.h),
        **counts,
    )


def _never(case: Scenario) -> Scenario:
    """The loop of modules, with its compensation never enabled."""
    assert case.compensation is not None
    return case.model_copy(update={"compensation": case.compensation.model_copy(update={"begin": 2 * case.t_end})})


def _beside(s: Simulation, without: Simulation, rows: npt.NDArray[Any], band: float) -> tuple[float, int, int]:
    """PV's standard deviation by that without compensation, and the reversals of both."""
    pv, pv_without = (float(np.std((x.pv - x.sp)[rows])) for x in (s, without))
    return pv / pv_without, reversals(s.op[rows], band), reversals(without.op[rows], band)


def _in_time(s: Simulation, without: Simulation, case: Scenario, withdrawn: int) -> dict[str, int | None]:
    """Number of half-periods of the filtered error until its withdrawal, at row `withdrawn`.

    Harm begins to show with the first half-period, from the tenth on, at whose end the bounds are exceeded from where
    the compensation came in force to there.
    """
    assert s.standing is not None and case.compensation is not None
    in_force = np.flatnonzero(s.standing == 0)
    first = int(in_force[0]) if in_force.size else withdrawn
    ends = np.array([round(end / case.h) for end, _, _ in half_periods(s, case)], dtype=int)
    ends = ends[ends > first]
    band = case.compensation.size / 10
    spread, turned = zip(*(_so_far(x, first, ends, band) for x in (s, without)), strict=True)
    beyond = (spread[0] > 1.1 * spread[1]) | (turned[0] > 1.5 * turned[1] + 2)
    shown = np.flatnonzero(beyond[9:])
    since_shown = None
    if shown.size:
        since_shown = int(np.sum((ends > ends[9 + shown[0]]) & (ends <= withdrawn)))
    return {"since_force": int(np.sum(ends <= withdrawn)), "since_shown": since_shown}


def _so_far(s: Simulation, first: int, ends: npt.NDArray[Any], band: float) -> tuple[Floats, Floats]:
    """PV's standard deviation and OP's reversals from row `first` to each of the rows `ends`."""
    e = (s.pv - s.sp)[first:]
    count = ends - first + 1.0
    mean, square = (np.cumsum(x)[ends - first] / count for x in (e, e * e))
    turned = np.searchsorted(turns(s.op[first:], band), ends - first, side="right")
    return np.sqrt(np.maximum(square - mean * mean, 0.0)), turned.astype(float)


def _broken(s: Simulation, case: Scenario, size: float, rate: float) -> str:
    """The first promise that u_FF breaks."""
    assert s.u_ff is not None and case.compensation is not None
    # The controller holds OP in manual, and while PV is lost, and uses nothing of the feed-forward.
    held = (s.flags & (NOT_AUTO | BAD)) != 0
    if np.diff(s.op)[held[1:]].any():
        return "held"
    # A value that comes late is compared with the state when it was made.
    late = (case.compensation.delay or 1) - 1
    u, held = s.u_ff[late:], held[: held.size - late]
    if np.abs(u).max() > size / 2 * (1 + 1e-9):
        return "size"
    if np.abs(np.diff(u))[~(held[1:] | held[:-1])].max() > rate * case.h * (1 + 1e-9):
        return "rate"
    if case.limits is not None and (s.op.min() < case.limits[0] or s.op.max() > case.limits[1]):
        return "limits"
    # The value handed over was made by the scan before.
    return "taken away" if u[1:][held[1:] & held[:-1]].any() else ""


def in_every_way(
    pool: ProcessPoolExecutor, what: Callable[[int, str], Any], numbers: Sequence[int], name: str
) -> Iterator[tuple[str, list[Any]]]:
    """Results of every loop in each way."""
    pairs = list(product(numbers, WAYS))
    asked = pool.map(what, *zip(*pairs, strict=True), chunksize=4 * len(WAYS))
    done = list(track(asked, name, total=len(pairs), transient=True))
    for at, way in enumerate(WAYS):
        yield way, [one for one in done[at :: len(WAYS)] if one is not None]


def harms(pool: ProcessPoolExecutor, numbers: range, worst: int = 0) -> Iterator[str]:
    """The third table, and the worst by *inverse*."""
    yield (
        "| way | loops | within both bounds, withdrawn in time or gone | without those that were gone | "
        "within both bounds | PV ≤ 1.1 × | reversals ≤ 1.5 × | beyond them, not withdrawn | promises broken | "
        "in force at the end | withdrawn: worse | over-compensated | needlessly | of these it helped | "
        "PV's median where in force |"
    )
    yield "|" + "---|" * 15
    found: list[Harm] = []
    for way, found in in_every_way(pool, harm, numbers, "harm"):
        ends = Counter(one.standing for one in found)
        in_force = [one.pv for one in found if one.active > 0.5]
        shares = (
            [one.settled for one in found],
            [one.harmless or one.in_time for one in found],
            [one.harmless for one in found],
            [one.pv <= 1.1 for one in found],
            [one.turns <= 1.5 * one.turns_without + 2 for one in found],
            [not one.harmless and one.since_force is None for one in found],
        )
        cells = [f"{np.mean(share):.1%}" for share in shares]
        cells.append(str(sum(bool(one.broken) for one in found)))
        cells += [f"{ends[name] / len(found):.0%}" for name in ("active", "worse", "over_compensated")]
        needless = [one.kept for one in found if one.kept is not None]
        cells += [f"{n / len(found):.0%}" for n in (len(needless), sum(pv <= HELPS for pv in needless))]
        cells.append(f"{np.median(in_force):.2f} ×" if in_force else "")
        yield f"| {way} | {len(found)} | {' | '.join(cells)} |"
    if not worst:
        return
    yield ""
    yield f"The worst {worst} by *inverse*:"
    yield ""
    yield "| loop | gap | size | PV | reversals, without | at the end | half-periods in force, of harm |"
    yield "|---|---|---|---|---|---|---|"
    for one in sorted(found, key=lambda one: (one.settled, one.in_time, -one.badness))[:worst]:
        counts = f"{one.turns}, {one.turns_without}"
        after = ", ".join("–" if n is None else str(n) for n in (one.since_force, one.since_shown))
        shown = f"{one.gap:.2f} | {one.size:.2f} | {one.pv:.2f} × | {counts} | {one.standing} | {after}"
        yield f"| {one.name} | {shown} |"


# --- Chance, and steps ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Beside:
    """A random loop, disturbed by next to nothing, and stepped when its compensation is enabled."""

    nudged: bool
    """Within the bounds with a hundredth of the size, never withdrawn."""
    helped: bool
    """Within the bounds, and PV better by a twentieth, with all of the size, never withdrawn."""
    withdrawn: tuple[bool, bool, bool]
    """Within 120 Ti of being enabled: without a step, on a step of the load, of the setpoint."""


def beside(number: int, way: str) -> Beside | None:
    """The runs of a loop; None where it cannot begin at rest within its limits."""
    with_it = random_loop(number, way)
    given = with_it.compensation
    assert given is not None
    kept = given.model_copy(update={"withdraw": False})
    little = kept.model_copy(update={"share": 0.01, "band": 0.002 * given.size})
    controller, gain = with_it.ideal(), with_it.plant.gain  # type: ignore[union-attr]
    reach = 2 * given.size * (abs(gain) if gain is not None else 1 / abs(controller.k))
    changes: list[dict[str, Any]] = [{"compensation": c} for c in (_never(with_it).compensation, kept, little)]
    changes += [
        {},
        {"load": [*with_it.load, Steps(steps=((given.begin, 2 * given.size),))]},
        {"setpoint": [*with_it.setpoint, Steps(steps=((given.begin, reach),))]},
    ]
    try:
        without, all_of_it, hundredth, *stepped = (run(with_it.model_copy(update=change)) for change in changes)
    except InputError:
        return None
    late = without.t > 2 / 3 * without.t[-1]
    soon = (without.t > given.begin) & (without.t < given.begin + 120 * controller.ti)
    whole = _beside(all_of_it, without, late, given.size / 10)
    return Beside(
        nudged=_within(*_beside(hundredth, without, late, given.size / 10)),
        helped=_within(*whole) and whole[0] <= HELPS,
        withdrawn=tuple(bool(np.isin(s.standing[soon], WITHDRAWN).any()) for s in stepped),  # type: ignore
    )


def besides(pool: ProcessPoolExecutor, numbers: range) -> Iterator[str]:
    """Table of harm and withdrawal next to a load, way by way."""
    yield (
        "| way | loops | a hundredth of the size: beyond the bounds | loops that it helps | "
        "withdrawn within 120 Ti | enabled on a load step | on a setpoint step |"
    )
    yield "|---|---|---|---|---|---|---|"
    for way, found in in_every_way(pool, beside, numbers, "beside"):
        helped = [one.withdrawn for one in found if one.helped]
        cells = [f"{np.mean([not one.nudged for one in found]):.1%}", str(len(helped))]
        cells += [f"{share:.0%}" for share in np.mean(helped, axis=0)]
        yield f"| {way} | {len(found)} | {' | '.join(cells)} |"


# --- Beside a controller that is not ours ----------------------------------------------------------------------------

DELAYS = (1, 3, 10)
"""Scans after which their controller has u_FF."""
PARTS = ("brings", "warns", "tuned", "harms", "beside", "late", "late, held out")

SHARES = (0.05, 0.1, 0.2, 0.3, 0.5, 1.25)
"""Ends of the classes of the delay as a share of Ti."""


@dataclass(frozen=True)
class Late:
    """A random loop beside which the compensation stands, with u_FF late by each of `DELAYS`."""

    share: float
    """A scan as a share of Ti."""
    settled: tuple[bool, ...]
    """Whether, for each delay, it was within both bounds, withdrawn in time or gone."""
    broken: str
    """The first promise that was broken."""


def late(number: int, way: str) -> Late | None:
    """The runs of a loop; None where it cannot begin at rest within its limits."""
    case = random_loop(number, way)
    given = case.compensation
    assert given is not None
    try:
        without = run(_never(case))
    except InputError:
        return None
    runs = [
        case.model_copy(update={"compensation": given.model_copy(update={"delay": n, "longest": 1e9})}) for n in DELAYS
    ]
    found = [_harm(one, run(one), without) for one in runs]
    return Late(
        share=case.h / case.ideal().ti,
        settled=tuple(one.settled for one in found),
        broken=next((one.broken for one in found if one.broken), ""),
    )


def lates(pool: ProcessPoolExecutor, numbers: Sequence[int]) -> Iterator[str]:
    """The fifth table: each loop with each longer delay, beside itself with one scan."""
    yield "| way | delay [Ti] | cases | harm with the delay alone | harm with one scan alone |"
    yield "|---|---|---|---|---|"
    broken = 0
    for way, found in in_every_way(pool, late, numbers, "late"):
        broken += sum(bool(one.broken) for one in found)
        cases = [(n * one.share, one.settled[0], one.settled[at]) for one in found for at, n in enumerate(DELAYS) if at]
        for low, high in pairwise((0.0, *SHARES)):
            chosen = [settled for share, *settled in cases if low < share <= high]
            if chosen:
                counts = f"{chosen.count([True, False])} | {chosen.count([False, True])}"
                yield f"| {way} | {low:g} to {high:g} | {len(chosen)} | {counts} |"
    yield ""
    yield f"{len(numbers)} loops; promises broken: {broken}."


def _sections(parts: Sequence[tuple[str, Iterable[str]]]) -> Iterator[tuple[str, str]]:
    for name, lines in parts:
        text = "\n".join(lines)
        print(f"\n{text}", flush=True)
        yield name, text


def main() -> None:
    """Measure, print, and write into the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--loops", type=int, default=1000, help="random loops of the last parts")
    parser.add_argument("--docs", action="store_true", help="write the tables into bench/results/compensation.md")
    parser.add_argument("--only", choices=PARTS, help="one part")
    given = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        n = given.loops
        parts = [("brings", brings(pool)), ("warns", warns(pool))]
        held_out = range(3000, 3000 + n)
        parts += [("tuned", harms(pool, range(2 * n))), ("harms", harms(pool, held_out, worst=10))]
        parts += [("beside", besides(pool, held_out))]
        parts += [("late", lates(pool, [*range(n), *range(3000, 3000 + 2 * n), *range(6000, 6000 + n)]))]
        parts += [("late, held out", lates(pool, range(7000, 7000 + n)))]
        tables = dict(_sections([part for part in parts if given.only in (None, part[0])]))
    if given.docs:
        for name, text in tables.items():
            write("compensation.md", text, name)


if __name__ == "__main__":
    main()
