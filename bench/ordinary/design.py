"""Design of the ordinary loops: a row, a number and a seed name one, and everything in it follows from the name.

"steps/gap/17/1" is number 17 of the row of steps with seed 1, its valve with a gap; "steps/none/17/1" is the same loop
without. Even numbers are part A, on which rules may be chosen; odd ones are part B, which judged until it had been
looked at three times. Parts C to G have a seed of their own each (`SEEDS`): parts C to F judged once each, and part G
judges now. Numbers 2 and 3 of any four lie outside of what the fit models: a positioner, a bent valve curve, a
filter in the sensor or a fractional lag.

"steps/gap/17/1/3" is that loop on another day: the same dynamics, controller, valve and kind of load, other random
numbers of load, setpoint and noise, a process gain up to a quarter off.

All distributions stand here and in `records`. They were fixed before a fit had run on any record, and are not tuned
after what a fit says.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from random import Random
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from glapp.controller import Controller
from glapp.errors import InputError
from glapp.nonlinear import backlash_cycles
from glapp.plant import Plant
from glapp.scenario import Coloured, Gaussian, Manual, Outer, Piece, Samples, Scenario, Stem, Steps, Valve, Walk
from glapp.simulate import run
from glapp.tuning.assess import open_loop

from ..loads.records import swinging_door
from ..truth.design import log_uniform
from ..truth.records import compressed

Floats = npt.NDArray[np.float64]
Half = Literal["A", "B", "C", "D", "E", "F", "G"]
Fault = Literal["none", "gap", "friction", "both", "driven"]
"""Fault: none; a clearance; friction of the stem; both; none, but a load of the period and swing that the gap, or the
friction, of the same number makes by itself.
"""

HOUR = 3600.0

FAULTS: dict[str, tuple[Fault, ...]] = {
    "drift": ("none", "gap"),
    "steps": ("none", "gap"),
    "bends": ("none", "gap"),
    "corners": ("none", "gap"),
    "sine": ("none", "gap"),
    "saw": ("none", "gap"),
    "square": ("none", "gap"),
    "cascade": ("none", "gap"),
    "manual": ("none", "gap"),
    "exceptions": ("none", "gap"),
    "swinging door": ("none", "gap"),
    "historian": ("none", "gap"),
    "friction": ("none", "friction", "gap", "both"),
    "gap cycle": ("none", "gap", "driven"),
    "perstorp": ("none", "gap", "driven"),
    "friction cycle": ("none", "friction", "driven"),
    "standing": ("none", "gap", "friction"),
    "rings": ("none", "gap"),
}
"""Every row with what is wrong in its records; all of one number are twins that share all but that.

*drift, steps, bends*: loads that drift, step, or bend each 25 to 200 samples. *corners*: bends that keep their time
to a fifth: each 25, 50, 100 or 200 samples. *sine, saw, square*: a neighbour's cycle.
*cascade*: an inner loop. *manual*: with periods in MAN. *exceptions*, *swinging door*: how the historian keeps its
values. *historian*: a row each 10 to 60 s. *friction*: a stem that sticks. *gap cycle*: the thesis' own symptom, PI
with Ti below the lag; *perstorp*: 8.5.2. *friction cycle*: a sticking valve, moved by the integral action.
*standing*: OP moves within the dead band most of the time. *rings*: loops with Ms above 3.
"""

ROWS = tuple(FAULTS)

CONSTANT = ("sine", "saw", "square", "manual", "standing")
"""Rows whose setpoint never moves; in one of four of the others it steps now and then, in a cascade always."""

CYCLES = ("gap cycle", "perstorp", "friction cycle")
"""Rows of limit cycles, each with a driven twin."""

OUTSIDE = ("positioner", "valve curve", "sensor filter", "fractional lag")
"""Properties outside of the fit's model."""

ATTEMPTS = 60
"""Number of loops that are drawn for a limit cycle until one has it."""

ALIKE = 0.5
"""A lasting cycle is like itself a period later by this correlation."""

SEEDS: dict[Half, int] = {"C": 90417, "D": 31126, "E": 5639, "F": 72944, "G": 18453}
"""Seeds of the parts that judge or have judged."""

JUDGE: Half = "F"
"""Part that judges the weights; no line was learned from it."""

LEAST_ROWS = 8
"""A cycle has at least so many rows a period."""


class Service(NamedTuple):
    """Sizes of a kind of loops, each from and to.

    lag [s], second lag and dead time in lags, noise [% of PV], step of the simulation [s]. `holdup`: time in which a
    flow of 100 % fills the vessel [s], for a process that integrates; its lag is that of the flow.
    """

    lag: tuple[float, float]
    second: tuple[float, float]
    dead_time: tuple[float, float]
    noise: tuple[float, float]
    h: float
    hours: tuple[int, ...]
    holdup: tuple[float, float] | None = None


SERVICES = {
    "flow": Service((2.0, 12.0), (0.0, 0.4), (0.15, 0.6), (0.05, 0.5), 0.25, (2, 2, 2, 8)),
    "pressure": Service((8.0, 60.0), (0.1, 0.5), (0.05, 0.4), (0.02, 0.2), 0.5, (2, 2, 8)),
    "level": Service((3.0, 15.0), (0.0, 0.0), (0.3, 1.0), (0.05, 0.4), 0.5, (2, 8, 8, 24), (60.0, 1500.0)),
    "temperature": Service((60.0, 600.0), (0.1, 0.4), (0.05, 0.4), (0.02, 0.1), 1.0, (8, 8, 24)),
    "quality": Service((120.0, 900.0), (0.0, 0.3), (0.3, 1.0), (0.02, 0.2), 1.0, (8, 24, 24)),
}

EACH = {2: (1.0, 1.0, 1.0, 2.0, 5.0), 8: (1.0, 2.0, 5.0, 5.0, 10.0), 24: (2.0, 5.0, 10.0, 10.0)}
"""Time between rows by length [s by h]."""


class Drive(NamedTuple):
    """Parts of the valve that a fault does not change, as in `Valve`."""

    lag: float
    positioner: float
    curve: float

    @property
    def late(self) -> float:
        """Part of the loop's dead time [s]."""
        return self.lag / (1 + self.positioner)


@dataclass(frozen=True)
class Drawn:
    """A loop before it has run.

    - `service`: of `SERVICES`, or "cycle" for rows of limit cycles that are made to be one.
    - `outside`: which of `OUTSIDE`; none inside the fit's family.
    - `scenario`: runs at a step shorter than that of the recording.
    - `every`: of so many samples of the simulation one is recorded.
    - `kind`: what the load does; of `LOADS`, or "swing" for a driven twin's.
    - `changes`: times at which a load that steps or bends does [s].
    - `size`: the load's size, peak to peak or, of one that drifts, about twice its standard deviation [% of OP].
    - `clearance`, `sticks`: width of the clearance, and of the dead band that Coulomb friction makes alone [% of OP].
    - `lags`: of process and sensor, as they were drawn [s].
    - `sigma`: standard deviation of the noise of PV as recorded [PV unit].
    - `ms`: greatest magnitude of the loop's sensitivity.
    - `sensor`: lag of a filter through which the recorded PV goes alone [s]; 0: none.
    - `recorder`: "", "held", "events" or "swinging door": how the historian keeps values.
    - `pv_band`, `op_band`: its bands [PV unit, % of OP].
    - `decimals`: steps that the recorded PV and OP are rounded to; 0: none.
    """

    name: str
    row: str
    fault: Fault
    number: int
    seed: int
    service: str
    outside: tuple[str, ...]
    scenario: Scenario
    every: int
    kind: str
    changes: Floats
    size: float
    clearance: float
    sticks: float
    lags: tuple[float, ...]
    sigma: float
    ms: float
    sensor: float = 0.0
    recorder: str = ""
    pv_band: float = 0.0
    op_band: float = 0.0
    decimals: float = 0.0

    @property
    def h(self) -> float:
        """Time between recorded samples [s]."""
        return self.scenario.h * self.every

    @property
    def lag(self) -> float:
        """T: the sum of the lags [s]."""
        return sum(self.lags)

    @property
    def gain(self) -> float:
        """Kp; for an integrating process the change of PV within Ti by a change of OP by 1 % [PV unit/%]."""
        plant = self.scenario.plant
        if plant.gain is not None:
            return plant.gain
        return (plant.velocity_gain or 0.0) * self.scenario.controller.ti


class NoSuchLoopError(Exception):
    """No loop of a name can be drawn, or its valve has no width."""


def half(number: int, seed: int = 1) -> Half:
    """A, on which rules may be chosen; B, C and D, which judged before; or E, which judges."""
    of_seed = [part for part, its_own in SEEDS.items() if its_own == seed]
    return of_seed[0] if of_seed else ("B" if number % 2 else "A")


def names(row: str, number: int, seed: int = 1) -> list[str]:
    """The twins of a row and a number."""
    return [f"{row}/{fault}/{number}/{seed}" for fault in FAULTS[row]]


def draw(name: str) -> Drawn:
    """The loop of that name, "row/fault/number/seed"; a driven twin still without the load that drives it."""
    row, fault, number, seed, day = _parts(name)
    if row in CYCLES:
        return _cycle(name, row, fault, number, seed)
    return _ordinary(name, row, fault, number, seed, day)


def _parts(name: str) -> tuple[str, Fault, int, int, int]:
    """Row, fault, number, seed and day of a record's name."""
    try:
        row, given, number, seed, *day = name.split("/")
        (fault,) = [fault for fault in FAULTS[row] if fault == given]
        (of_day,) = day or ("0",)
        if day and row in CYCLES:
            raise ValueError(row)
        return row, fault, int(number), int(seed), int(of_day)
    except (ValueError, KeyError):
        form = "row/fault/number/seed, or row/fault/number/seed/day of a row without limit cycles"
        raise ValueError(f"{name}: write {form}; the rows and their faults are {FAULTS}") from None


def _ordinary(name: str, row: str, fault: Fault, number: int, seed: int, day: int) -> Drawn:
    def stream(part: str) -> Random:
        return Random(f"ordinary/{seed}/{row}/{number}/{part}")

    def daily(part: str) -> Random:
        return stream(f"{part}/{day}") if day else stream(part)

    random = stream("loop")
    outside = _outside(random, number)
    choices = ("flow", "flow", "pressure") if row == "cascade" else (*SERVICES, "flow")
    if row == "standing":
        choices = ("flow", "pressure", "temperature")
    service = random.choice(choices)
    sizes = SERVICES[service]
    kp = log_uniform(random, 0.4, 2.5)
    lags = _lags(random, sizes)
    dead_time = random.uniform(*sizes.dead_time) * lags[0]
    speed = 1.0 / log_uniform(random, *sizes.holdup) if sizes.holdup else None
    width = log_uniform(random, 4.0, 12.0) if row == "standing" else log_uniform(random, 0.3, 6.0)
    h = sizes.h
    k, ti, td = _tuned(random, kp, lags, dead_time + h, speed)

    hours = random.choice(sizes.hours)
    apart = random.choice(EACH[hours])
    if row == "historian":
        hours = random.choice((8, 24, 24))
        apart = random.choice((10.0, 10.0, 15.0, 20.0, 30.0, 60.0))
    every = max(round(apart / h), 1)
    t_end = hours * HOUR

    of_valve = stream("valve")
    drive = _drive(of_valve, outside, log_uniform(of_valve, 0.3, 1.5) if "friction" in FAULTS[row] else 0.0)
    of_sensor = stream("sensor")
    in_loop = of_sensor.random() < 0.5
    sensor = lags[0] * log_uniform(of_sensor, 0.1, 0.6) if "sensor filter" in outside else 0.0
    plant = _plant(kp, lags, dead_time, speed, h, "fractional lag" in outside, of_sensor)
    if in_loop and sensor > 0.0:
        plant = plant * Plant([1.0], [sensor, 1.0])

    # Nobody leaves a gain at which noise alone moves OP by more than half a per cent.
    sigma = log_uniform(random, *sizes.noise)
    tf = random.choice((0.0, 0.0, ti / 20)) if td == 0.0 else td / 5
    k, ms = _margins(plant, k, ti, td, tf, drive.late + h / 2, row == "rings", random)
    sigma = min(sigma, 0.5 / abs(k))
    if day:
        today = log_uniform(daily("gain"), 0.8, 1.25)
        plant, kp = today * plant, today * kp
    if sensor > 0.0 and in_loop:
        noise: list[Piece] = [
            Coloured(sigma=sigma * math.sqrt(h / (2 * sensor + h)), tau=sensor),
            Gaussian(sigma=sigma / 5),
        ]
        sigma *= math.hypot(math.sqrt(h / (2 * sensor + h)), 1 / 5)
    elif outside and random.random() < 0.4:
        noise = [Coloured(sigma=sigma, tau=h * log_uniform(random, 1.0, 10.0))]
    else:
        noise = [Gaussian(sigma=sigma)]

    op, pv = random.uniform(35.0, 65.0), random.uniform(35.0, 65.0)
    rests = (pv / kp if speed is None else 0.0) - op
    of_load = daily("load")
    kind = row if row in LOADS else stream("load").choice(("drift", "steps", "bends", "square"))
    size = min(max(width * log_uniform(of_load, 0.5, 8.0), 1.0), 15.0)
    if row == "standing":
        kind, size = "steps", width * of_load.uniform(0.1, 0.4)
    whole = sum(lags) + dead_time if speed is None else ti
    samples = int(t_end / h + 1e-9) + 1
    values, changes = LOADS[kind](Scene(of_load, size, samples, h, h * every, whole))
    load: list[Piece] = [Steps(steps=((0.0, rests),))]
    if values is not None:
        load.append(Samples(values=values))
    else:
        load.append(_drifting(of_load, size, t_end))
    if kind != "drift":
        load.append(Coloured(sigma=size * log_uniform(of_load, 0.005, 0.05), tau=whole * of_load.uniform(0.5, 3.0)))

    of_setpoint = daily("setpoint")
    setpoint: list[Piece] = [Steps(steps=((0.0, pv),))]
    outer = None
    if row == "cascade":
        outer = _outer(of_setpoint, pv, kp * size, t_end, whole)
        setpoint = [Steps(steps=((0.0, 50.0),))]
    elif row not in CONSTANT and of_setpoint.random() < 0.25:
        moves = (kp if speed is None else 1.0) * min(size, 5.0)
        setpoint = [Steps(steps=((0.0, pv), *_moves(of_setpoint, t_end, max(t_end / 6, 20 * whole), moves, pv)))]
    of_recorder = stream("recorder")
    recorder, pv_band, op_band = _recorder(of_recorder, row)
    scenario = Scenario(
        name=name,
        plant=plant,
        controller=Controller(k=k, ti=ti, td=td, setpoint_weight=random.choice((0.0, 1.0)), gain_unit="OP/PV"),
        tf=tf,
        pv_span=(0, 100),
        op_span=(0, 100),
        limits=(0.0, 100.0),
        noise=tuple(noise),
        pv_resolution=of_recorder.choice((0.0, 0.0, 0.01, 0.025)),
        setpoint=tuple(setpoint),
        load=tuple(load),
        manual=_manual(of_setpoint, t_end, op, whole) if row == "manual" else (),
        outer=outer,
        h=h,
        t_end=t_end,
        seed=random.randrange(2**32) + day,
    )
    made = Drawn(
        name=name,
        row=row,
        fault=fault,
        number=number,
        seed=seed,
        service=service,
        outside=outside,
        scenario=scenario,
        every=every,
        kind=kind,
        changes=changes,
        size=size,
        clearance=0.0,
        sticks=0.0,
        lags=(*lags, sensor) if sensor > 0.0 else tuple(lags),
        sigma=sigma,
        ms=ms,
        sensor=0.0 if in_loop else sensor,
        recorder=recorder,
        pv_band=pv_band,
        op_band=op_band,
        decimals=of_recorder.choice((0.0, 0.01, 0.01, 0.1)) if recorder == "" else 0.0,
    )
    return _faulty(made, width, drive, of_valve)


def _cycle(name: str, row: str, fault: Fault, number: int, seed: int) -> Drawn:
    """A loop whose gap, or friction, makes a lasting cycle by itself.

    Loops are drawn until the simulation has it; of a gap the describing function must promise it first.
    """
    drawn = _attempted(name, row, fault, number, seed, _that_swings(row, number, seed))
    assert drawn is not None
    return drawn


@lru_cache(maxsize=64)
def _that_swings(row: str, number: int, seed: int) -> int:
    """The first of the loops of that number whose simulation has a lasting cycle."""
    fault: Fault = "friction" if row == "friction cycle" else "gap"
    for attempt in range(ATTEMPTS):
        name = f"{row}/{fault}/{number}/{seed}"
        drawn = _attempted(name, row, fault, number, seed, attempt)
        if drawn is None:
            continue
        period, size, alike = cycle_of(run(drawn.scenario).op, drawn.scenario.h)
        lasts = drawn.scenario.t_end > 20 * period and period > LEAST_ROWS * drawn.h
        if lasts and alike > ALIKE and size > 0.7 * (drawn.clearance + drawn.sticks):
            return attempt
    raise NoSuchLoopError(f"{row}/{number}/{seed}: no cycle in {ATTEMPTS} loops")


def _attempted(name: str, row: str, fault: Fault, number: int, seed: int, attempt: int) -> Drawn | None:
    random = Random(f"ordinary/{seed}/{row}/{number}/loop/{attempt}")
    if row == "friction cycle":
        return _friction_cycle(name, fault, number, seed, random)
    return _gap_cycle(name, row, fault, number, seed, random)


def cycle_of(op: Floats, h: float) -> tuple[float, float, float]:
    """Period [s], the median swing over it, and how much OP is like itself a period later, 1 for quite.

    By the autocorrelation of the last four fifths.
    """
    x = op[op.size // 5 :]
    x = x - x.mean()
    power = np.abs(np.fft.rfft(x, 2 * x.size)) ** 2
    correlation = np.fft.irfft(power)[: x.size // 2]
    if correlation[0] <= 0.0 or (correlation >= 0).all():
        return x.size * h, float(np.ptp(x)), 0.0
    first = int(np.argmax(correlation < 0))
    lag = first + int(np.argmax(correlation[first:]))
    return lag * h, swing_of(op, lag), float(correlation[lag] / correlation[0] * x.size / (x.size - lag))


def swing_of(op: Floats, period: float) -> float:
    """Peak to peak of OP within a period [samples], the median of the last four fifths."""
    x, whole = op[op.size // 5 :], max(int(period), 2)
    parts = x[: x.size // whole * whole].reshape(-1, whole) if x.size >= whole else x[None, :]
    return float(np.median(np.ptp(parts, axis=1)))


def _gap_cycle(name: str, row: str, fault: Fault, number: int, seed: int, random: Random) -> Drawn | None:
    outside = _outside(random, number)
    if row == "perstorp":
        outside = ()
        kp, k, ti, width = 0.46, 8.5, 10.3, 25.0
        lag = log_uniform(random, 25.0, 120.0)
        dead_time = random.uniform(0.5, 2.0)
        h = 0.25
    else:
        kp, lag = log_uniform(random, 0.4, 2.5), log_uniform(random, 20.0, 300.0)
        width = random.uniform(3.0, 11.0)
        h = 0.25 if lag < 60 else 0.5
        if random.random() < 0.5:
            # SIMC PI with the dead time for its closed loop's time constant.
            dead_time = lag * random.uniform(0.01, 0.05)
            k, ti = lag / (kp * 2 * (dead_time + h / 2)), min(lag, 8 * (dead_time + h / 2))
        else:
            dead_time = lag * random.uniform(0.02, 0.2)
            ti = lag * random.uniform(0.1, 0.5)
            k = random.uniform(0.3, 0.7) * lag / (kp * (dead_time + h / 2))
    of_valve = Random(f"ordinary/{seed}/{row}/{number}/valve")
    drive = _drive(of_valve, outside, 0.0)
    sensor = lag * log_uniform(of_valve, 0.02, 0.1) if "sensor filter" in outside else 0.0
    plant = _plant(kp, [lag], dead_time, None, h, "fractional lag" in outside, of_valve)
    if sensor:
        plant = plant * Plant([1.0], [sensor, 1.0])
    k, ti = (k, ti) if row == "perstorp" else (two_digits(k), two_digits(ti))
    ms = sensitivity(plant, k, ti, 0.0, 0.0, drive.late + h / 2)
    late = drive.late + h / 2
    seen = open_loop(plant * Plant([1.0], [late, 1.0]), (k, ti))
    try:
        stable = [cycle for cycle in backlash_cycles(seen, width) if cycle.stable]
    except InputError:
        return None
    if ms > 2.5 or not stable or 2 * stable[0].amplitude > 60.0:
        return None
    period = 2 * math.pi / stable[0].w
    hours = next((hours for hours in (2, 8, 24) if hours * HOUR > 40 * period), 24)
    each = [each for each in EACH[hours] if each < period / LEAST_ROWS]
    if not each:
        return None
    cycle = Cycle(
        name, row, fault, number, seed, "cycle", outside, plant, k, ti, kp, (lag, sensor) if sensor else (lag,), h
    )
    return _swinging(cycle, random, random.choice(each), hours, width, ms, drive, of_valve)


def _friction_cycle(name: str, fault: Fault, number: int, seed: int, random: Random) -> Drawn | None:
    outside = _outside(random, number)
    service = random.choice(("flow", "flow", "pressure"))
    sizes = SERVICES[service]
    kp, lags = log_uniform(random, 0.4, 2.5), _lags(random, sizes)
    dead_time, h = random.uniform(*sizes.dead_time) * lags[0], sizes.h
    k, ti, _ = _tuned(random, kp, lags, dead_time + h, None)
    ti = two_digits(ti * random.uniform(0.4, 0.9))
    of_valve = Random(f"ordinary/{seed}/friction cycle/{number}/valve")
    width = log_uniform(random, 1.0, 6.0)
    drive = _drive(of_valve, outside, log_uniform(of_valve, 0.3, 1.5))
    sensor = lags[0] * log_uniform(of_valve, 0.1, 0.4) if "sensor filter" in outside else 0.0
    plant = _plant(kp, lags, dead_time, None, h, "fractional lag" in outside, of_valve)
    if sensor:
        plant = plant * Plant([1.0], [sensor, 1.0])
    ms = sensitivity(plant, k, ti, 0.0, 0.0, drive.late + h / 2)
    if ms > 2.5:
        return None
    hours = random.choice(sizes.hours)
    each = [each for each in EACH[hours] if each <= max(2.0, ti / 4)] or [1.0]
    lags = [*lags, sensor] if sensor else lags
    cycle = Cycle(name, "friction cycle", fault, number, seed, service, outside, plant, k, ti, kp, tuple(lags), h)
    return _swinging(cycle, random, random.choice(each), hours, width, ms, drive, of_valve)


class Cycle(NamedTuple):
    """A loop that is to swing; names as in `Drawn`, `h` the step of the simulation [s]."""

    name: str
    row: str
    fault: Fault
    number: int
    seed: int
    service: str
    outside: tuple[str, ...]
    plant: Plant
    k: float
    ti: float
    kp: float
    lags: tuple[float, ...]
    h: float


def _swinging(
    cycle: Cycle, random: Random, each: float, hours: int, width: float, ms: float, drive: Drive, of_valve: Random
) -> Drawn:
    """The record of a limit cycle: little load but for a pulse that sets it going, and a few small steps."""
    name, row, fault, number, seed, service, outside, plant, k, ti, kp, lags, h = cycle
    t_end = hours * HOUR
    of_load = Random(f"ordinary/{seed}/{row}/{number}/load")
    op, pv = random.uniform(40.0, 60.0), random.uniform(35.0, 65.0)
    begin = of_load.choice((-1.0, 1.0)) * width * of_load.uniform(0.8, 1.5)
    lasts = 3 * (ti + sum(lags))
    steps = [(0.0, pv / kp - op), (0.01 * t_end, pv / kp - op + begin), (0.01 * t_end + lasts, pv / kp - op)]
    for at, value in _moves(of_load, t_end, t_end / of_load.uniform(1.5, 5.0), min(0.3 * width, 3.0)):
        if at > steps[-1][0]:
            steps.append((at, pv / kp - op + value))
    sigma = min(log_uniform(random, 0.01, 0.1) * width * kp, 0.3, 0.5 / k)
    scenario = Scenario(
        name=name,
        plant=plant,
        controller=Controller(k=k, ti=ti, setpoint_weight=random.choice((0.0, 1.0)), gain_unit="OP/PV"),
        tf=0.0,
        pv_span=(0, 100),
        op_span=(0, 100),
        limits=(0.0, 100.0),
        noise=(Gaussian(sigma=sigma),),
        pv_resolution=random.choice((0.0, 0.01, 0.025)),
        setpoint=(Steps(steps=((0.0, pv),)),),
        load=(
            Steps(steps=tuple(steps)),
            Coloured(sigma=width * log_uniform(of_load, 0.002, 0.03), tau=sum(lags) * of_load.uniform(0.5, 3.0)),
        ),
        h=h,
        t_end=t_end,
        seed=random.randrange(2**32),
    )
    made = Drawn(
        name=name,
        row=row,
        fault=fault,
        number=number,
        seed=seed,
        service=service,
        outside=outside,
        scenario=scenario,
        every=max(round(each / h), 1),
        kind="steps",
        changes=np.array([at for at, _ in steps[1:]]),
        size=abs(begin),
        clearance=0.0,
        sticks=0.0,
        lags=lags,
        sigma=sigma,
        ms=ms,
        decimals=random.choice((0.0, 0.01)),
    )
    return _faulty(made, width, drive, of_valve)


def _faulty(made: Drawn, width: float, drive: Drive, random: Random) -> Drawn:
    """The loop with its valve: all that is drawn here is drawn for every fault, and used where it is there."""
    jumps = made.row == "friction cycle"
    model: Literal["karnopp", "lugre"] = random.choice(("karnopp", "lugre"))
    # Every third stem slides as hard as it sticks, and does not jump.
    excess = 0.0 if random.random() < 1 / 3 and not jumps else random.uniform(0.2, 1.0)
    share = random.uniform(0.3, 0.7)
    speed, viscous = log_uniform(random, 0.05, 0.5), random.uniform(0.1, 0.4)
    clearance = {"gap": width, "both": width * share}.get(made.fault, 0.0)
    sticks = {"friction": width, "both": width * (1 - share)}.get(made.fault, 0.0)
    if not (drive.lag or drive.curve or sticks):
        return replace(made, scenario=made.scenario.model_copy(update={"d": clearance}), clearance=clearance)
    stem = None
    if sticks:
        fc = sticks * (1 + drive.positioner) / 2
        if jumps:
            speed = min(speed, fc * excess / (10 * viscous))
        stem = Stem(model=model, fs=fc * (1 + excess), fc=fc, stribeck=speed, viscous=viscous, w=8.0)
    valve = Valve(stem=stem, d=clearance, **drive._asdict())
    scenario = made.scenario.model_copy(update={"valve": valve})
    return replace(made, scenario=scenario, clearance=clearance, sticks=sticks)


def _drive(random: Random, outside: tuple[str, ...], lag: float) -> Drive:
    """Drive of the valve, whose actuator has that lag [s] where there is no positioner."""
    positioner = curve = 0.0
    if "positioner" in outside:
        positioner, lag = log_uniform(random, 1.0, 6.0), max(lag, log_uniform(random, 0.5, 3.0))
    if "valve curve" in outside:
        curve = random.choice((-1.0, 1.0, 1.0)) * random.uniform(0.4, 1.5)
    return Drive(lag, positioner, curve)


def _outside(random: Random, number: int) -> tuple[str, ...]:
    """Choice from `OUTSIDE`: none for numbers 0 and 1 of any four, one or two for the others."""
    first, second, two = random.choice(OUTSIDE), random.choice(OUTSIDE), random.random() < 0.3
    if number % 4 < 2:
        return ()
    return (first, second) if two and second != first else (first,)


def _lags(random: Random, sizes: Service) -> list[float]:
    first, second = log_uniform(random, *sizes.lag), random.uniform(*sizes.second)
    return [first, first * second] if second > 0.02 else [first]


def _plant(
    kp: float, lags: list[float], dead_time: float, speed: float | None, h: float, fractional: bool, random: Random
) -> Plant:
    """The process; `speed` of one that integrates [1/s]. `h` bounds its fastest lag."""
    alpha = random.uniform(0.6, 0.9)
    first = fractional_lag(lags[0], alpha, h) if fractional else Plant([1.0], [lags[0], 1.0])
    plant = Plant([kp], [1.0, 0.0]) * (speed / kp) * first if speed else kp * first
    for lag in lags[1:]:
        plant = plant * Plant([1.0], [max(lag, h), 1.0])
    return plant.delayed(dead_time)


def fractional_lag(lag: float, alpha: float, h: float, parts: int = 5) -> Plant:
    """1/(1 + (lag·s)^alpha) as a sum of ordinary lags, 0 < alpha < 1, as heat in a wall or a packed bed answers.

    Its step response is 1 − ∫K(r)·exp(−r·t/lag)dr/r with K(r) = sin(απ)/π·r^α/(r^2α + 2·r^α·cos(απ) + 1), all positive
    (Gorenflo and Mainardi, *Fractional calculus*, 1997, 3.4): the integral is taken over `parts` even steps of ln r,
    from a fiftieth of 1/lag to 30 of them.
    """
    edges = np.linspace(math.log(0.02), math.log(30.0), parts + 1)
    rates = np.exp((edges[1:] + edges[:-1]) / 2)
    weights = rates**alpha / (rates ** (2 * alpha) + 2 * rates**alpha * math.cos(alpha * math.pi) + 1)
    weights /= weights.sum()
    lags = np.maximum(lag / rates, h)
    num = np.zeros(parts)
    for i, weight in enumerate(weights):
        num = num + weight * np.poly1d(1.0).coeffs * _product(np.delete(lags, i))
    return Plant(num.tolist(), _product(lags).tolist())


def _product(lags: Floats) -> Floats:
    polynomial = np.array([1.0])
    for lag in lags:
        polynomial = np.convolve(polynomial, [lag, 1.0])
    return polynomial


def two_digits(x: float) -> float:
    """A number with the two digits that a person types."""
    return float(f"{x:.2g}")


def _tuned(
    random: Random, kp: float, lags: list[float], dead_time: float, speed: float | None
) -> tuple[float, float, float]:
    """K, Ti and Td by SIMC or Lambda (half rule for the second lag), as changed by a person."""
    if speed is not None:
        late = dead_time + sum(lags)
        arrest = late * log_uniform(random, 2.0, 15.0)
        k, ti = (2 * arrest + late) / (speed * (arrest + late) ** 2), 2 * arrest + late
        return two_digits(k * log_uniform(random, 0.7, 1.3)), two_digits(ti), 0.0
    second = lags[1] if len(lags) > 1 else 0.0
    lag, late = lags[0] + second / 2, dead_time + second / 2
    closed = random.choice((late, 2 * late, lag, 2 * lag, 3 * lag))
    k, ti, td = lag / (kp * (closed + late)), min(lag, 4 * (closed + late)), 0.0
    if lags[0] > 50 and random.random() < 0.25:
        td = two_digits(max(second, late / 3))
    return (
        two_digits(k * log_uniform(random, 0.6, 1.3)),
        two_digits(max(ti * log_uniform(random, 0.7, 1.5), 1.0)),
        td,
    )


def sensitivity(plant: Plant, k: float, ti: float, td: float, tf: float, late: float) -> float:
    """Ms of the loop, with `late` seconds of valve and sampling; inf where it is unstable."""
    w = np.geomspace(0.01 / ti, 30.0 / (late + 0.1 * ti), 2000)
    s = 1j * w
    controller = k * (1 + 1 / (s * ti) + s * td / (1 + s * td / 10)) / (1 + s * tf) ** 2
    loop = controller * plant.response(w) * np.exp(-s * late)
    # Stable: where the phase has fallen to -180° the magnitude is below 1 from then on.
    phase = np.unwrap(np.angle(loop))
    beyond = phase < -math.pi
    if (np.abs(loop[beyond]) >= 1.0).any():
        return math.inf
    return float(np.max(1 / np.abs(1 + loop)))


def _margins(
    plant: Plant, k: float, ti: float, td: float, tf: float, late: float, rings: bool, random: Random
) -> tuple[float, float]:
    """K with which Ms is at most 2.2, or 3.2 to 6 for a loop that rings; and Ms."""
    most = random.uniform(3.2, 6.0) if rings else 2.2
    ms = sensitivity(plant, k, ti, td, tf, late)
    while ms > most:
        k *= 0.95
        ms = sensitivity(plant, k, ti, td, tf, late)
    while rings and ms < 3.0:
        k *= 1.02
        ms = sensitivity(plant, k, ti, td, tf, late)
    return (k if rings else two_digits(k)), ms


class Scene(NamedTuple):
    """Facts that a load is drawn from.

    Its random numbers and size [%], samples of the simulation and their step [s], time between recorded samples and
    time scale of the loop [s].
    """

    random: Random
    size: float
    samples: int
    h: float
    each: float
    whole: float

    @property
    def t(self) -> Floats:
        """Times of the samples [s]."""
        return np.arange(self.samples) * self.h

    @property
    def t_end(self) -> float:
        """The last [s]."""
        return (self.samples - 1) * self.h


Load = tuple[Floats | None, Floats]
"""Values at each sample, None for one that a piece of the scenario makes; times of its changes [s]."""


def _drift(_: Scene) -> Load:
    return None, np.empty(0)


def _drifting(random: Random, size: float, t_end: float) -> Piece:
    """A walk of half the size in 20 to 60 minutes; over more than two hours one that is drawn back."""
    if t_end <= 2 * HOUR:
        return Walk(rate=size / 2 / math.sqrt(random.uniform(0.3, 1.0) * HOUR))
    return Coloured(sigma=size / 2, tau=HOUR * log_uniform(random, 0.3, 3.0))


def _steps(scene: Scene) -> Load:
    """Steps to random values, 5 to 60 minutes or 5 to 40 time scales apart, whichever is longer."""
    random = scene.random
    apart = max(log_uniform(random, 300.0, HOUR), scene.whole * log_uniform(random, 5.0, 40.0))
    moves = _moves(random, scene.t_end, min(apart, scene.t_end / 4), scene.size / 2)
    at, values = np.array([0.0, *(t for t, _ in moves)]), np.array([0.0, *(x for _, x in moves)])
    return values[np.searchsorted(at, scene.t, side="right") - 1], at[1:]


def _moves(random: Random, t_end: float, apart: float, size: float, rest: float = 0.0) -> list[tuple[float, float]]:
    """Steps at random times to random values within ± size of `rest`."""
    t, steps = apart * random.uniform(0.05, 0.8), []
    while t < t_end:
        steps.append((t, rest + random.uniform(-size, size)))
        t += random.uniform(0.4, 1.6) * apart
    return steps


def _bends(scene: Scene) -> Load:
    """Straight lines between corners that are 25 to 200 recorded samples apart."""
    return _lines(scene, lambda: log_uniform(scene.random, 25.0, 200.0))


CORNERS = (25, 50, 100, 200)
"""Recorded samples from one corner to the next in the row *corners*, to a fifth."""


def _corners(scene: Scene) -> Load:
    """Straight lines between corners that are so many samples apart."""
    apart = scene.random.choice(CORNERS)
    return _lines(scene, lambda: apart * scene.random.uniform(0.8, 1.2))


def _lines(scene: Scene, apart: Callable[[], float]) -> Load:
    """Straight lines between random values, `apart` recorded samples from one to the next."""
    at, values = [0.0], [0.0]
    while at[-1] < scene.t_end:
        at.append(at[-1] + apart() * scene.each)
        values.append(scene.random.uniform(-0.5, 0.5) * scene.size)
    return np.interp(scene.t, at, values), np.array(at[1:-1])


def _neighbour(scene: Scene, shape: str) -> Load:
    """A neighbour's cycle of 3 to 60 time scales, at least 8 rows and at most an eighth of the record.

    Every other one keeps its time to a tenth and its height to a fifth only.
    """
    random = scene.random
    period = min(max(scene.whole * log_uniform(random, 3.0, 60.0), LEAST_ROWS * scene.each), scene.t_end / 8)
    values = swing(random, shape, period, scene.t, random.random() < 0.5)
    return scene.size / 2 * values, np.empty(0)


def swing(random: Random, shape: str, period: float, t: Floats, uneven: bool) -> Floats:
    """A cycle between -1 and 1: sine, saw or square, cycle by cycle, with a phase of its own."""
    count = math.ceil(t[-1] / period / 0.85) + 3
    lengths = np.array([period * (random.uniform(0.9, 1.1) if uneven else 1.0) for _ in range(count)])
    heights = np.array([random.uniform(0.8, 1.0) if uneven else 1.0 for _ in range(count)])
    begins = np.concatenate([[0.0], np.cumsum(lengths)]) - period * random.random()
    which = np.searchsorted(begins, t, side="right") - 1
    part = (t - begins[which]) / lengths[which]
    rises = random.uniform(0.1, 0.9) if random.random() < 0.5 else 0.5
    lag = period * random.uniform(0.02, 0.15)
    if shape == "sine":
        x = np.sin(2 * math.pi * part)
    elif shape == "saw":
        x = np.interp((part + rises / 2) % 1.0, [0.0, rises, 1.0], [-1.0, 1.0, -1.0])
    else:
        x = lagged(np.where(part < 0.5, 1.0, -1.0), lag, t[1] - t[0])
    return x * heights[which]


def lagged(x: Floats, lag: float, h: float) -> Floats:
    """Through a lag [s], from rest at the first value."""
    fading = math.exp(-h / lag)
    y, _ = lfilter([1 - fading], [1.0, -fading], x - x[0], zi=[0.0])
    return np.asarray(y + x[0])


LOADS: dict[str, Callable[[Scene], Load]] = {
    "drift": _drift,
    "steps": _steps,
    "bends": _bends,
    "corners": _corners,
    "sine": lambda scene: _neighbour(scene, "sine"),
    "saw": lambda scene: _neighbour(scene, "saw"),
    "square": lambda scene: _neighbour(scene, "square"),
}
"""Load of each row; rows that are not about the load draw one of them."""


def _outer(random: Random, pv: float, size: float, t_end: float, whole: float) -> Outer:
    """A level or a temperature whose controller moves the setpoint of a flow or pressure.

    `pv`: the inner process value at rest, `size`: how far it is to move. Its own load steps.
    """
    moves = [(0.0, -pv), *((t, -pv + x) for t, x in _moves(random, t_end, t_end / random.uniform(6, 25), size / 2))]
    slow = whole * log_uniform(random, 6.0, 40.0)
    if random.random() < 0.5:
        arrest = 2 * slow
        holdup = log_uniform(random, 2.0, 20.0) * slow
        k, ti = holdup * (2 * arrest + slow) / (arrest + slow) ** 2, 2 * arrest + slow
        plant = Plant([1 / holdup], [1.0, 0.0])
        noise = log_uniform(random, 0.02, 0.3)
        return Outer(
            plant=plant,
            controller=Controller(k=two_digits(k), ti=two_digits(ti), setpoint_weight=1.0, gain_unit="OP/PV"),
            limits=(0.0, 100.0),
            noise=(Gaussian(sigma=min(noise, 0.3 / k)),),
            load=(Steps(steps=tuple(moves)),),
        )
    k, ti = random.uniform(0.4, 1.5), slow
    return Outer(
        plant=Plant([1.0], [slow, 1.0], slow * random.uniform(0.05, 0.2)),
        controller=Controller(k=two_digits(k), ti=two_digits(ti), setpoint_weight=1.0, gain_unit="OP/PV"),
        limits=(0.0, 100.0),
        noise=(Gaussian(sigma=log_uniform(random, 0.01, 0.1)),),
        load=(Steps(steps=tuple((t, x + 50.0) for t, x in moves)),),
    )


def _manual(random: Random, t_end: float, op: float, whole: float) -> tuple[Manual, ...]:
    """One to four periods in MAN, 2 to 15 % of the time each; in two of three a person moves OP now and then."""
    periods, count = [], random.randint(1, 4)
    for i in range(count):
        part = t_end / count
        lasts = min(t_end * random.uniform(0.02, 0.15), 0.6 * part)
        begin = i * part + random.uniform(0.1, 0.9) * (part - lasts)
        if random.random() < 1 / 3:
            periods.append(Manual(begin=begin, end=begin + lasts))
            continue
        at = [begin]
        while at[-1] < begin + lasts:
            at.append(at[-1] + max(whole * random.uniform(2.0, 10.0), lasts / 8))
        at[-1] = begin + lasts
        for here, there in pairwise(at):
            periods.append(Manual(begin=here, end=there, op=round(op + random.uniform(-4.0, 4.0), 1)))
    return tuple(periods)


def _recorder(random: Random, row: str) -> tuple[str, float, float]:
    """Recorder of the historian, and its bands of PV and OP."""
    pv_band, op_band = log_uniform(random, 0.05, 0.5), random.choice((0.0, 0.05, 0.1, 0.25))
    events = random.random() < 1 / 3
    if row == "exceptions":
        return ("events" if events else "held"), pv_band, op_band
    if row == "swinging door":
        return "swinging door", pv_band, op_band
    return "", 0.0, 0.0


def kept_values(x: Floats, recorder: str, band: float) -> Floats:
    """A column as the historian gives it back at even times."""
    if band == 0.0 or recorder == "":
        return x
    return swinging_door(x, band) if recorder == "swinging door" else compressed(x, band)
