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


class Loop(NamedTuple):
    """Process and controller of a record.

    - `base`, `gain`, `slower`: the process is `base` with so many times its gain and its times.
    - `k`, `ti`, `td`: the controller [OP/PV], [s], [s].
    - `scale`: the process' time scale, slowed down [s].
    """

    base: Plant
    gain: float
    slower: float
    k: float
    ti: float
    td: float
    scale: TimeScale

    @property
    def integrates(self) -> bool:
        """Whether the process has no static gain."""
        return self.base.gain is None

    @property
    def kp(self) -> float:
        """Kp [PV unit/%]; for an integrating process what a change of OP by 1 % makes of PV within Ti."""
        if self.integrates:
            return self.gain * (self.base.velocity_gain or 0.0) * self.ti / self.slower
        return self.gain

    @property
    def slowest(self) -> float:
        """Ti, or T + L of the process where that is longer [s]."""
        return max(self.ti, self.scale.whole)


class Timing(NamedTuple):
    """Recorded sample time [s], steps of the simulation in it, length of the record [s]."""

    h: float
    every: int
    t_end: float


# Every function below draws from one generator: the order of its calls is part of the design, and a record changes
# where a draw is added, removed or moved.


def draw(name: str) -> Drawn | None:
    """The loop of that name, "cause/load/family/number"; None where the tuning that was drawn does not exist."""
    cause, load, family, _ = name.split("/")
    random = Random(name)
    sticks = cause in ("stiction", "both")
    departure = random.choice(DEPARTURES + (FRICTION,) * sticks) if family == "outside" else ""
    process = random.choice(list(OUTSIDE if departure == "process" else INSIDE))
    rule, kind = random.choice(list(RULES)), random.choice(KINDS)
    loop = _loop(random, process, rule, kind, near_limit=load == "limit")
    if loop is None:
        return None
    h, every, t_end = _timing(random, loop)

    width = random.choice(WIDTHS)
    d, friction = _valve(random, cause, width, "he" if departure == FRICTION else "kano")
    noise = loop.kp * min(max(width * log_uniform(random, 0.01, 1.0), 0.01), 1.0)
    noise_piece = _noise(random, noise, h, coloured=departure == "coloured noise")

    size = min(width * log_uniform(random, 0.3, 6.0), 20.0)
    apart = max(t_end / random.uniform(8, 60), 2 * loop.slowest)
    at_rest = [Steps(steps=((0.0, -50.0),))] if loop.integrates else []  # so that OP rests at 50 %
    moving = _load(load, random, t_end, apart, size, loop.slowest)
    limits = (0.0, 100.0)
    if departure == "saturation":
        reach = size * random.uniform(0.3, 0.9)
        limits = (50.0 - reach, 50.0 + reach)
    setpoint_kind, setpoint = _setpoint(random, loop, size, apart, t_end)

    controller = Controller(
        k=abs(loop.k), ti=loop.ti, td=loop.td, setpoint_weight=random.choice((0.0, 1.0)), gain_unit="OP/PV"
    )
    scenario = Scenario(
        name=name,
        plant=scaled(loop.base, loop.gain, loop.slower),
        controller=controller,
        pv_span=(0, 100),
        op_span=(0, 100),
        limits=limits,
        d=d,
        friction=friction,
        noise=(noise_piece,),
        op_resolution=random.choice((0.05, 0.1, 0.25)) if random.random() < 0.2 else 0.0,
        setpoint=setpoint,
        load=(*at_rest, *moving),
        h=h / every,
        t_end=t_end,
        seed=random.randrange(2**32),
        filter_in_loop=True,
    )
    return Drawn(
        scenario=scenario,
        every=every,
        band=loop.kp * width * log_uniform(random, 0.03, 0.5) if departure == "compression" else 0.0,
        process=process,
        rule=f"{rule} {kind}",
        departure=departure,
        lag=loop.scale.lag,
        gain=loop.kp,
        noise=noise,
        d=width if cause in ("backlash", "stiction", "both") else 0.0,
        jump=friction.j if friction else 0.0,
        load_size=size,
        setpoint=setpoint_kind,
    )


def _loop(random: Random, process: str, rule: str, kind: str, near_limit: bool) -> Loop | None:
    """Process and controller; None where the rule has no tuning for this process.

    `near_limit`: K is 85 to 97 % of the one at the limit of stability. None where that is more than 20 times the
    rule's K.
    """
    tuned = tuned_for(process, rule, kind)
    if tuned is None:
        return None
    base = base_plant(process)
    gain, slower = random.choice((0.5, 1.0, 1.6)), random.choice((1.0, 10.0, 60.0))
    k, ti, td, _ = tuned.controller
    k, ti, td = k / gain, ti * slower, td * slower
    if near_limit:
        try:
            margin = tuning.assess(base, tuned.controller[:3], tf=filter_time(ti, td) / slower).gain_margin
        except InputError:
            return None
        if margin > 20:
            return None
        k *= margin * random.uniform(0.85, 0.97)
    return Loop(base, gain, slower, k, ti, td, TimeScale(*(slower * x for x in time_scale(base))))


def _timing(random: Random, loop: Loop) -> Timing:
    """Sample time of 1 to 50 % of Ti, 400 to 3000 samples of it, and at most 400 000 steps of the simulation."""
    h = loop.ti * log_uniform(random, 0.01, 0.5)
    step = min(loop.ti / 50, loop.scale.lag / 20, filter_time(loop.ti, loop.td) / 2)
    every = math.ceil(h / step)
    samples = max(min(round(log_uniform(random, 600, 3000)), 400_000 // every), 400)
    return Timing(h, every, samples * h)


def _valve(random: Random, cause: str, width: float, model: Literal["kano", "he"]) -> tuple[float, Friction | None]:
    """Clearance [% of OP] and friction of a valve whose whole dead band is `width` [% of OP]."""
    if cause not in ("stiction", "both"):
        return (width if cause == "backlash" else 0.0), None
    # A valve with j < s is, seen from outside, one with a gap of s − j and friction of s = j.
    gap, slip = (width * random.uniform(0.3, 0.7), random.uniform(0.3, 1.0)) if cause == "both" else (0.0, 1.0)
    s = width - gap
    return gap, Friction(model=model, s=s, j=s * slip)


def _noise(random: Random, sigma: float, h: float, coloured: bool) -> Piece:
    """Measurement noise of standard deviation `sigma` [PV unit]; `h`: recorded sample time [s]."""
    if coloured:
        return Coloured(sigma=sigma, tau=h * log_uniform(random, 1.0, 20.0))
    if random.random() < 0.5:
        return Gaussian(sigma=sigma)
    return Uniform(amplitude=sigma * math.sqrt(3))


def _setpoint(random: Random, loop: Loop, size: float, apart: float, t_end: float) -> tuple[str, tuple[Piece, ...]]:
    """Kind of the setpoint, and its pieces; `size`: that of the load [% of OP], `apart`: time between steps [s]."""
    at_rest = 50.0 * loop.gain
    kind = random.choice(("constant", "constant", "steps", "cascade"))
    moves = loop.gain * min(size, 10.0) * random.uniform(0.1, 1.0)
    if kind == "steps":
        return kind, (Steps(steps=((0.0, at_rest), *random_steps(random, t_end, apart, moves, at_rest))),)
    constant = Steps(steps=((0.0, at_rest),))
    if kind == "cascade":
        return kind, (constant, Coloured(sigma=moves, tau=loop.slowest * random.uniform(1.0, 5.0)))
    return kind, (constant,)


def log_uniform(random: Random, low: float, high: float) -> float:
    """A number between `low` and `high`, as often from each octave."""
    return float(low * (high / low) ** random.random())


def filter_time(ti: float, td: float) -> float:
    """Time constant of the thesis' filter (2.1) [s]."""
    return td / 5 if td > 0 else ti / 10


def random_steps(
    random: Random, t_end: float, apart: float, size: float, rest: float = 0.0
) -> list[tuple[float, float]]:
    """Times [s] and values of steps, `apart` seconds from each other on average, within ± `size` of `rest`."""
    t, steps = 0.5 * apart * random.random(), []
    while t < t_end:
        steps.append((t, rest + random.uniform(-size, size)))
        t += random.uniform(0.5, 1.5) * apart
    return steps


def _load(load: str, random: Random, t_end: float, apart: float, size: float, slowest: float) -> list[Piece]:
    """Pieces of the load at the process input [% of OP]; `slowest`: the loop's [s]."""
    if load == "walk":
        return [Walk(rate=size / math.sqrt(apart))]
    if load == "sine":
        period = slowest * log_uniform(random, 2.0, 20.0)
        return [Sine(amplitude=0.5 * size, period=period)]
    steps = random_steps(random, t_end, apart, size)
    if load in ("steps", "limit"):
        return [Steps(steps=tuple(steps))]
    over = apart * random.uniform(0.2, 0.5)
    pieces: list[Piece] = []
    before = 0.0
    for t, value in steps:
        pieces.append(Ramp(t=t, by=value - before, over=over))
        before = value
    return pieces
