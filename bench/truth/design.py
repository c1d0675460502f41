"""Design of the records: a cell of the design and a number name one loop, and everything in it follows from the name.

A cell is what the truth is (`Cell.cause`), what the load does and whether the record stays within what the fit models
(`Cell.family`). All else, process, tuning, width, noise, setpoint, sample time, length, is drawn at random by the seed
that is the record's name.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from random import Random
from typing import Any, Literal, NamedTuple, get_args

from glapp import tuning
from glapp.controller import Controller
from glapp.errors import InputError
from glapp.plant import Plant
from glapp.scenario import (
    Coloured,
    Friction,
    Gaussian,
    Piece,
    Ramp,
    Scenario,
    Sine,
    Steps,
    Uniform,
    Walk,
)

Cause = Literal["none", "backlash", "stiction", "both", "oscillation"]
Family = Literal["inside", "outside"]

CAUSES: tuple[Cause, ...] = get_args(Cause)
FAMILIES: tuple[Family, ...] = get_args(Family)
LOADS = ("steps", "ramps", "walk")
OSCILLATIONS = ("sine", "limit")
"""A sine at the process input; a linear loop near its limit of stability."""

WIDTHS = (0.5, 1.0, 2.0, 5.0, 10.0)
"""Dead band of the actuator [% of the span of OP, which is 0..100]; 0 is the cause "none"."""

INSIDE: dict[str, Any] = {
    **{name: name for name in ("P1", "P2", "P3", "P4", "P5", "P8")},
    "lag": ([1.0], [1.0, 1.0], 0.2),
    "two lags": ([1.0], [3.0, 4.0, 1.0], 0.3),
    "swinging": ([1.0], [1.0, 0.6, 1.0], 0.2),
    "tank": ([1.0], [1.0, 0.0], 0.5),
    "slow tank": ([1.0], [2.0, 1.0, 0.0], 1.0),
}
"""Processes of up to four lags, real or oscillatory, or an integrator and up to one lag, with dead time."""

OUTSIDE: dict[str, Any] = {"P6": "P6", "P7": "P7", "lead": ([2.0, 1.0], [5.0, 6.0, 1.0], 0.3)}
"""A zero in the right half plane, eight lags, a zero in the left half plane."""

DEPARTURES = ("process", "coloured noise", "compression", "saturation")
"""Ways out of the family, one a record; a valve that sticks has one more, `FRICTION`."""

FRICTION = "He's friction"
"""A stem that sticks again at every sample, and moves in stairs; inside the family it is Kano's."""


class TimeScale(NamedTuple):
    """Measure of the process' speed [s]: T of its first-order model, and T + L."""

    lag: float
    whole: float


@lru_cache
def time_scale(plant: Plant) -> TimeScale:
    """T = T63 − L and T + L; for an integrating process lags and dead time stand for both."""
    if plant.gain is None:
        whole = tuning.integrating(plant).l
        return TimeScale(whole, whole)
    model = tuning.fotd(plant)
    return TimeScale(model.t, model.t + model.l)


RULES: dict[str, Any] = {
    "ZN step": tuning.ziegler_nichols_step,
    "ZN frequency": tuning.ziegler_nichols_frequency,
    "Lambda T": lambda plant, kind: tuning.lambda_tuning(plant, kind, lam=time_scale(plant).lag),
    "Lambda 3T": lambda plant, kind: tuning.lambda_tuning(plant, kind, lam=3 * time_scale(plant).lag),
    "AMIGO step": tuning.amigo_step,
    "AMIGO frequency": tuning.amigo_frequency,
    "SIMC": tuning.simc,
    "MIGO 1.4": tuning.migo,
    "MIGO Ms 2.0": lambda plant, kind: tuning.migo(plant, kind, ms=2.0),
    "designPID": tuning.design,
}
KINDS = ("PI", "PI", "PID")
"""Two loops of three have no derivative part, as in plants."""


class Cell(NamedTuple):
    """A group of records."""

    cause: Cause
    load: str
    family: Family

    def __str__(self) -> str:
        return "/".join(self)


CELLS = [Cell(cause, load, family) for cause in CAUSES[:-1] for load in LOADS for family in FAMILIES] + [
    Cell("oscillation", load, family) for load in OSCILLATIONS for family in FAMILIES
]


@dataclass(frozen=True)
class Drawn:
    """A loop before it has run.

    - `scenario`: OP in % of its span; runs at a step much shorter than that of the recording.
    - `every`: of so many samples of the simulation the historian keeps one.
    - `band`: the historian holds PV until it has moved by this much [PV unit]; 0: it keeps every value.
    - `process`, `rule`: of `INSIDE` or `OUTSIDE`; of `RULES`, with PI or PID.
    - `departure`: one of `DEPARTURES`, or "" inside the family.
    - `lag`: T of the process [s]; for an integrating one the sum of its lags and dead time.
    - `gain`: Kp [PV unit/%]; for an integrating process what a change of OP by 1 % makes of PV within Ti.
    - `noise`: standard deviation of the measurement noise [PV unit].
    - `d`, `jump`: whole dead band, gap and stick band together, and slip jump [% of OP].
    - `load_size`: largest step or ramp of the load; standard deviation of a walk over the time between two steps [% of
      OP].
    - `setpoint`: "constant", "steps" or "cascade", that is moving at every sample.
    """

    scenario: Scenario
    every: int
    band: float
    process: str
    rule: str
    departure: str
    lag: float
    gain: float
    noise: float
    d: float
    jump: float
    load_size: float
    setpoint: str


@lru_cache
def base_plant(process: str) -> Plant:
    """A process of `INSIDE` or `OUTSIDE`, as it is called."""
    return Plant.of((INSIDE | OUTSIDE)[process])


@lru_cache
def tuned_for(process: str, rule: str, kind: str) -> tuning.Tuning | None:
    """The tuning, or None where the rule is not for this process."""
    try:
        return RULES[rule](base_plant(process), kind)
    except InputError:
        return None


def scaled(base: Plant, gain: float, slower: float) -> Plant:
    """A process with another gain and speed than `base`; PV stays within 0..100 where OP does."""
    order = len(base.den) - 1
    den = [c * slower ** (order - i) for i, c in enumerate(base.den)]
    num = [gain * c * slower ** (len(base.num) - 1 - i) for i, c in enumerate(base.num)]
    return Plant(num, den, base.dead_time * slower)


def draw(name: str) -> Drawn | None:
    """The loop of that name, "cause/load/family/number"; None where the tuning that was drawn does not exist."""
    cause, load, family, _ = name.split("/")
    random = Random(name)
    sticks = cause in ("stiction", "both")
    departure = random.choice(DEPARTURES + (FRICTION,) * sticks) if family == "outside" else ""
    process = random.choice(list(OUTSIDE if departure == "process" else INSIDE))
    rule, kind = random.choice(list(RULES)), random.choice(KINDS)
    tuned = tuned_for(process, rule, kind)
    if tuned is None:
        return None
    base = base_plant(process)
    gain, slower = random.choice((0.5, 1.0, 1.6)), random.choice((1.0, 10.0, 60.0))
    integrating = base.gain is None
    k, ti, td, _ = tuned.controller
    k, ti, td = k / gain, ti * slower, td * slower
    scale = TimeScale(*(slower * x for x in time_scale(base)))
    if load == "limit":
        try:
            margin = tuning.assess(base, tuned.controller[:3], tf=filter_time(ti, td) / slower).gain_margin
        except InputError:
            return None
        if margin > 20:
            return None
        k *= margin * random.uniform(0.85, 0.97)
    loop_time = max(ti, scale.whole)

    h = ti * log_uniform(random, 0.01, 0.5)
    step = min(ti / 50, scale.lag / 20, filter_time(ti, td) / 2)
    every = math.ceil(h / step)
    samples = max(min(round(log_uniform(random, 600, 3000)), 400_000 // every), 400)
    t_end = samples * h

    width = random.choice(WIDTHS)
    d, friction = 0.0, None
    if sticks:
        # A valve with j < s is, seen from outside, one with a gap of s − j and friction of s = j.
        gap, slip = (width * random.uniform(0.3, 0.7), random.uniform(0.3, 1.0)) if cause == "both" else (0.0, 1.0)
        s = width - gap
        friction = Friction(model="he" if departure == FRICTION else "kano", s=s, j=s * slip)
        d = gap
    elif cause == "backlash":
        d = width

    kp = gain * (base.velocity_gain or 0.0) * ti / slower if integrating else gain
    noise = kp * min(max(width * log_uniform(random, 0.01, 1.0), 0.01), 1.0)
    coloured = departure == "coloured noise"
    noises: Piece
    if coloured:
        noises = Coloured(sigma=noise, tau=h * log_uniform(random, 1.0, 20.0))
    elif random.random() < 0.5:
        noises = Gaussian(sigma=noise)
    else:
        noises = Uniform(amplitude=noise * math.sqrt(3))

    size = min(width * log_uniform(random, 0.3, 6.0), 20.0)
    apart = max(t_end / random.uniform(8, 60), 2 * loop_time)
    at_rest = [Steps(steps=((0.0, -50.0),))] if integrating else []  # so that OP rests at 50 %
    acting = _load(load, random, t_end, apart, size, loop_time)
    limits = (0.0, 100.0)
    if departure == "saturation":
        reach = size * random.uniform(0.3, 0.9)
        limits = (50.0 - reach, 50.0 + reach)

    pv_at_rest = 50.0 * gain
    kind_of_setpoint = random.choice(("constant", "constant", "steps", "cascade"))
    moves = gain * min(size, 10.0) * random.uniform(0.1, 1.0)
    setpoint: list[Piece] = [Steps(steps=((0.0, pv_at_rest),))]
    if kind_of_setpoint == "steps":
        setpoint = [Steps(steps=((0.0, pv_at_rest), *_steps(random, t_end, apart, moves, pv_at_rest)))]
    elif kind_of_setpoint == "cascade":
        setpoint.append(Coloured(sigma=moves, tau=loop_time * random.uniform(1.0, 5.0)))

    weight = random.choice((0.0, 1.0))
    controller = Controller(k=abs(k), ti=ti, td=td, setpoint_weight=weight, gain_unit="OP/PV")
    scenario = Scenario(
        name=name,
        plant=scaled(base, gain, slower),
        controller=controller,
        pv_span=(0, 100),
        op_span=(0, 100),
        limits=limits,
        d=d,
        friction=friction,
        noise=(noises,),
        op_resolution=random.choice((0.05, 0.1, 0.25)) if random.random() < 0.2 else 0.0,
        setpoint=tuple(setpoint),
        load=(*at_rest, *acting),
        h=h / every,
        t_end=t_end,
        seed=random.randrange(2**32),
        filter_in_loop=True,
    )
    return Drawn(
        scenario=scenario,
        every=every,
        band=kp * width * log_uniform(random, 0.03, 0.5) if departure == "compression" else 0.0,
        process=process,
        rule=f"{rule} {kind}",
        departure=departure,
        lag=scale.lag,
        gain=kp,
        noise=noise,
        d=width if cause in ("backlash", "stiction", "both") else 0.0,
        jump=friction.j if friction else 0.0,
        load_size=size,
        setpoint=kind_of_setpoint,
    )


def log_uniform(random: Random, low: float, high: float) -> float:
    """A number between `low` and `high`, as often from each octave."""
    return float(low * (high / low) ** random.random())


def filter_time(ti: float, td: float) -> float:
    """Time constant of the thesis' filter (2.1) [s]."""
    return td / 5 if td > 0 else ti / 10


def _steps(random: Random, t_end: float, apart: float, size: float, rest: float = 0.0) -> list[tuple[float, float]]:
    """Steps at random times to random values around `rest`."""
    t, steps = 0.5 * apart * random.random(), []
    while t < t_end:
        steps.append((t, rest + random.uniform(-size, size)))
        t += random.uniform(0.5, 1.5) * apart
    return steps


def _load(load: str, random: Random, t_end: float, apart: float, size: float, loop_time: float) -> list[Piece]:
    """Pieces of the load at the process input [% of OP]."""
    if load == "walk":
        return [Walk(rate=size / math.sqrt(apart))]
    if load == "sine":
        period = loop_time * log_uniform(random, 2.0, 20.0)
        return [Sine(amplitude=0.5 * size, period=period)]
    steps = _steps(random, t_end, apart, size)
    if load in ("steps", "limit"):
        return [Steps(steps=tuple(steps))]
    over = apart * random.uniform(0.2, 0.5)
    pieces: list[Piece] = []
    before = 0.0
    for t, value in steps:
        pieces.append(Ramp(t=t, by=value - before, over=over))
        before = value
    return pieces
