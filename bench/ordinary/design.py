"""Design of the ordinary loops: a row, a number and a seed name one, and everything in it follows from the name.

"steps/gap/17/1" is number 17 of the row of steps with seed 1, its valve with a gap; "steps/none/17/1" is the same loop
without. Even numbers are part A, on which rules may be chosen; odd ones are part B, which judged until it had been
looked at three times. Parts C to G have a seed of their own each (`SEEDS`): parts C to F judged once each, and part G
judges now. Numbers 2 and 3 of any four lie outside of what the fit models: a positioner, a bent valve curve, a
filter in the sensor or a fractional lag.

"steps/gap/17/1/3" is that loop on another day: the same dynamics, controller, valve and kind of load, other random
numbers of load, setpoint and noise, a process gain up to a quarter off.

All distributions stand here, in `load`, `process` and `records`. They were fixed before a fit had run on any record,
and are not tuned after what a fit says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from random import Random
from typing import Literal, NamedTuple

import numpy as np

from glapp.controller import Controller
from glapp.errors import InputError
from glapp.nonlinear import backlash_cycles
from glapp.plant import Plant
from glapp.scenario import Coloured, Gaussian, Manual, Outer, Piece, Samples, Scenario, Stem, Steps, Valve
from glapp.simulate import run
from glapp.tuning.assess import open_loop

from ..loads.records import swinging_door
from ..truth.design import log_uniform
from ..truth.records import compressed
from .load import HOUR, LEAST_ROWS, LOADS, Floats, Scene, drifting, moves
from .process import (
    SERVICES,
    Drive,
    Process,
    Service,
    drive_of,
    plant_of,
    process_of,
    sensitivity,
    tuned,
    two_digits,
    within_margins,
)

Half = Literal["A", "B", "C", "D", "E", "F", "G"]
Fault = Literal["none", "gap", "friction", "both", "driven"]
"""Fault: none; a clearance; friction of the stem; both; none, but a load of the period and swing that the gap, or the
friction, of the same number makes by itself.
"""

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
"""Part that judges the weights of `bench.weigh`, which learn from the other parts."""

EACH = {2: (1.0, 1.0, 1.0, 2.0, 5.0), 8: (1.0, 2.0, 5.0, 5.0, 10.0), 24: (2.0, 5.0, 10.0, 10.0)}
"""Time between rows by length [s by h]."""


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
    """Part of the records of a number and seed: one of `SEEDS`, else A for even numbers and B for odd ones."""
    of_seed = [part for part, its_own in SEEDS.items() if its_own == seed]
    return of_seed[0] if of_seed else ("B" if number % 2 else "A")


def names(row: str, number: int, seed: int = 1) -> list[str]:
    """The twins of a row and a number."""
    return [f"{row}/{fault}/{number}/{seed}" for fault in FAULTS[row]]


class RecordName(NamedTuple):
    """Parts of a record's name, and the random generators that follow from them.

    The fault enters no generator, so that twins share all but the fault.
    """

    text: str
    row: str
    fault: Fault
    number: int
    seed: int
    day: int

    @classmethod
    def parse(cls, text: str) -> RecordName:
        """Parts of "row/fault/number/seed" or "row/fault/number/seed/day"."""
        try:
            row, given, number, seed, *day = text.split("/")
            (fault,) = [fault for fault in FAULTS[row] if fault == given]
            (of_day,) = day or ("0",)
            if day and row in CYCLES:
                raise ValueError(row)
            return cls(text, row, fault, int(number), int(seed), int(of_day))
        except (ValueError, KeyError):
            form = "row/fault/number/seed, or row/fault/number/seed/day of a row without limit cycles"
            raise ValueError(f"{text}: write {form}; the rows and their faults are {FAULTS}") from None

    def random(self, part: str) -> Random:
        """Generator of a part that is the same on all days."""
        return Random(f"ordinary/{self.seed}/{self.row}/{self.number}/{part}")

    def today(self, part: str) -> Random:
        """Generator of a part that differs from day to day."""
        return self.random(f"{part}/{self.day}" if self.day else part)


def draw(text: str) -> Drawn:
    """The loop of a name, as `RecordName.parse` takes it; a driven twin still without the load that drives it."""
    name = RecordName.parse(text)
    return _cycle(name) if name.row in CYCLES else _ordinary(name)


# The functions below share generators: the order of their calls is part of the design, and a record changes where a
# draw is added, removed or moved.


def _ordinary(name: RecordName) -> Drawn:
    """A loop of a row without limit cycles."""
    row = name.row
    random = name.random("loop")
    outside = _outside(random, name.number)
    service = _service(random, row)
    sizes = SERVICES[service]
    h = sizes.h
    process = process_of(random, sizes)
    width = log_uniform(random, 4.0, 12.0) if row == "standing" else log_uniform(random, 0.3, 6.0)
    k, ti, td = tuned(random, process, h)
    hours, every = _sampling(random, row, sizes)
    t_end = hours * HOUR

    of_valve = name.random("valve")
    drive = drive_of(of_valve, outside, log_uniform(of_valve, 0.3, 1.5) if "friction" in FAULTS[row] else 0.0)
    plant, sensor, in_loop = _with_sensor(name.random("sensor"), process, outside, h)

    # Nobody leaves a gain at which noise alone moves OP by more than half a per cent.
    sigma = log_uniform(random, *sizes.noise)
    tf = random.choice((0.0, 0.0, ti / 20)) if td == 0.0 else td / 5
    k, ms = within_margins(random, plant, k, ti, td, tf, drive.late + h / 2, row == "rings")
    sigma = min(sigma, 0.5 / abs(k))
    if name.day:
        today = log_uniform(name.today("gain"), 0.8, 1.25)
        plant, process = today * plant, process._replace(kp=today * process.kp)
    noise, sigma = _noise(random, sigma, h, sensor if in_loop else 0.0, may_be_coloured=bool(outside))

    op, pv = random.uniform(35.0, 65.0), random.uniform(35.0, 65.0)
    at_rest = Steps(steps=((0.0, (pv / process.kp if process.speed is None else 0.0) - op),))
    time_scale = process.time_scale(ti)
    of_load = name.today("load")
    kind, size = _kind_and_size(name, of_load, width)
    scene = Scene(of_load, size, int(t_end / h + 1e-9) + 1, h, h * every, time_scale)
    moving, changes = _moving(scene, kind, t_end)
    of_setpoint = name.today("setpoint")
    setpoint, outer = _setpoint(of_setpoint, row, process, pv, size, t_end, time_scale)
    of_recorder = name.random("recorder")
    recorder, pv_band, op_band = _recorder(of_recorder, row)
    scenario = Scenario(
        name=name.text,
        plant=plant,
        controller=Controller(k=k, ti=ti, td=td, setpoint_weight=random.choice((0.0, 1.0)), gain_unit="OP/PV"),
        tf=tf,
        pv_span=(0, 100),
        op_span=(0, 100),
        limits=(0.0, 100.0),
        noise=noise,
        pv_resolution=of_recorder.choice((0.0, 0.0, 0.01, 0.025)),
        setpoint=setpoint,
        load=(at_rest, *moving),
        manual=_manual(of_setpoint, t_end, op, time_scale) if row == "manual" else (),
        outer=outer,
        h=h,
        t_end=t_end,
        seed=random.randrange(2**32) + name.day,
    )
    made = Drawn(
        name=name.text,
        row=row,
        fault=name.fault,
        number=name.number,
        seed=name.seed,
        service=service,
        outside=outside,
        scenario=scenario,
        every=every,
        kind=kind,
        changes=changes,
        size=size,
        clearance=0.0,
        sticks=0.0,
        lags=(*process.lags, sensor) if sensor > 0.0 else process.lags,
        sigma=sigma,
        ms=ms,
        sensor=0.0 if in_loop else sensor,
        recorder=recorder,
        pv_band=pv_band,
        op_band=op_band,
        decimals=of_recorder.choice((0.0, 0.01, 0.01, 0.1)) if recorder == "" else 0.0,
    )
    return _faulty(made, width, drive, of_valve)


def _service(random: Random, row: str) -> str:
    """Kind of the loop, of `SERVICES`."""
    if row == "standing":
        return random.choice(("flow", "pressure", "temperature"))
    return random.choice(("flow", "flow", "pressure") if row == "cascade" else (*SERVICES, "flow"))


def _sampling(random: Random, row: str, sizes: Service) -> tuple[int, int]:
    """Length of the record [h], and steps of the simulation between two of its rows."""
    hours = random.choice(sizes.hours)
    apart = random.choice(EACH[hours])
    if row == "historian":
        hours = random.choice((8, 24, 24))
        apart = random.choice((10.0, 10.0, 15.0, 20.0, 30.0, 60.0))
    return hours, max(round(apart / sizes.h), 1)


def _with_sensor(random: Random, process: Process, outside: tuple[str, ...], h: float) -> tuple[Plant, float, bool]:
    """The process with its sensor, the sensor's lag [s], and whether the controller gets the filtered PV."""
    in_loop = random.random() < 0.5
    sensor = process.lags[0] * log_uniform(random, 0.1, 0.6) if "sensor filter" in outside else 0.0
    plant = plant_of(random, process, h, "fractional lag" in outside)
    if in_loop and sensor > 0.0:
        plant = plant * Plant([1.0], [sensor, 1.0])
    return plant, sensor, in_loop


def _noise(
    random: Random, sigma: float, h: float, filtered: float, may_be_coloured: bool
) -> tuple[tuple[Piece, ...], float]:
    """Noise of PV, and its standard deviation [PV unit].

    `filtered`: lag of a sensor in the loop, which filters noise of standard deviation `sigma` [s]; 0: there is none.
    """
    if filtered > 0.0:
        passes = math.sqrt(h / (2 * filtered + h))
        noise = (Coloured(sigma=sigma * passes, tau=filtered), Gaussian(sigma=sigma / 5))
        return noise, sigma * math.hypot(passes, 1 / 5)
    if may_be_coloured and random.random() < 0.4:
        return (Coloured(sigma=sigma, tau=h * log_uniform(random, 1.0, 10.0)),), sigma
    return (Gaussian(sigma=sigma),), sigma


def _kind_and_size(name: RecordName, of_load: Random, width: float) -> tuple[str, float]:
    """What the load does, of `LOADS`, and its size [% of OP] for a valve with a dead band of `width` [% of OP]."""
    size = min(max(width * log_uniform(of_load, 0.5, 8.0), 1.0), 15.0)
    if name.row == "standing":
        return "steps", width * of_load.uniform(0.1, 0.4)
    if name.row in LOADS:
        return name.row, size
    return name.random("load").choice(("drift", "steps", "bends", "square")), size


def _moving(scene: Scene, kind: str, t_end: float) -> tuple[list[Piece], Floats]:
    """The load without its value at rest, and the times of its changes [s]."""
    values, changes = LOADS[kind](scene)
    random, size = scene.random, scene.size
    pieces: list[Piece] = [drifting(random, size, t_end) if values is None else Samples(values=values)]
    if kind != "drift":
        sigma, tau = size * log_uniform(random, 0.005, 0.05), scene.whole * random.uniform(0.5, 3.0)
        pieces.append(Coloured(sigma=sigma, tau=tau))
    return pieces, changes


def _setpoint(
    random: Random, row: str, process: Process, pv: float, size: float, t_end: float, time_scale: float
) -> tuple[tuple[Piece, ...], Outer | None]:
    """The setpoint, and the outer loop where one moves it; `pv`: PV at rest, `size`: that of the load [% of OP]."""
    if row == "cascade":
        return (Steps(steps=((0.0, 50.0),)),), _outer(random, pv, process.kp * size, t_end, time_scale)
    steps = [(0.0, pv)]
    if row not in CONSTANT and random.random() < 0.25:
        move = (process.kp if process.speed is None else 1.0) * min(size, 5.0)
        steps += moves(random, t_end, max(t_end / 6, 20 * time_scale), move, pv)
    return (Steps(steps=tuple(steps)),), None


def _cycle(name: RecordName) -> Drawn:
    """A loop whose gap, or friction, makes a lasting cycle by itself.

    Loops are drawn until the simulation has it; of a gap the describing function must predict it first.
    """
    drawn = _attempted(name, _first_that_cycles(name.row, name.number, name.seed))
    assert drawn is not None
    return drawn


@lru_cache(maxsize=64)
def _first_that_cycles(row: str, number: int, seed: int) -> int:
    """The first attempt of that number whose simulation has a lasting cycle."""
    fault: Fault = "friction" if row == "friction cycle" else "gap"
    name = RecordName.parse(f"{row}/{fault}/{number}/{seed}")
    for attempt in range(ATTEMPTS):
        drawn = _attempted(name, attempt)
        if drawn is None:
            continue
        period, size, alike = cycle_of(run(drawn.scenario).op, drawn.scenario.h)
        lasts = drawn.scenario.t_end > 20 * period and period > LEAST_ROWS * drawn.h
        if lasts and alike > ALIKE and size > 0.7 * (drawn.clearance + drawn.sticks):
            return attempt
    raise NoSuchLoopError(f"{row}/{number}/{seed}: no cycle in {ATTEMPTS} loops")


def _attempted(name: RecordName, attempt: int) -> Drawn | None:
    """The loop of an attempt; None where its margins or its describing function rule a cycle of the fault out."""
    random = name.random(f"loop/{attempt}")
    return _friction_cycle(name, random) if name.row == "friction cycle" else _gap_cycle(name, random)


def cycle_of(op: Floats, h: float) -> tuple[float, float, float]:
    """Period [s], median of OP's peak to peak in a period [%], and correlation of OP with itself a period later.

    From the autocorrelation of the last four fifths; `h`: time between samples [s].
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


class Cycle(NamedTuple):
    """A loop that is to cycle; parts as in `Drawn`, `width` of its dead band [% of OP]."""

    service: str
    outside: tuple[str, ...]
    process: Process
    plant: Plant
    sensor: float
    k: float
    ti: float
    ms: float
    h: float
    width: float
    drive: Drive


def _gap_cycle(name: RecordName, random: Random) -> Drawn | None:
    """A loop whose gap makes a cycle by the describing function."""
    outside: tuple[str, ...] = _outside(random, name.number)
    if name.row == "perstorp":
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
        k, ti = two_digits(k), two_digits(ti)
    of_valve = name.random("valve")
    drive = drive_of(of_valve, outside, 0.0)
    sensor = lag * log_uniform(of_valve, 0.02, 0.1) if "sensor filter" in outside else 0.0
    process = Process(kp, (lag,), dead_time)
    plant = plant_of(of_valve, process, h, "fractional lag" in outside)
    if sensor:
        plant = plant * Plant([1.0], [sensor, 1.0])
    late = drive.late + h / 2
    ms = sensitivity(plant, k, ti, 0.0, 0.0, late)
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
    cycle = Cycle("cycle", outside, process, plant, sensor, k, ti, ms, h, width, drive)
    return _cycling(name, cycle, random, random.choice(each), hours, of_valve)


def _friction_cycle(name: RecordName, random: Random) -> Drawn | None:
    """A loop with an integral action fast enough that a sticking valve may make a cycle."""
    outside = _outside(random, name.number)
    service = random.choice(("flow", "flow", "pressure"))
    sizes = SERVICES[service]
    process, h = process_of(random, sizes), sizes.h
    k, ti, _ = tuned(random, process, h)
    ti = two_digits(ti * random.uniform(0.4, 0.9))
    of_valve = name.random("valve")
    width = log_uniform(random, 1.0, 6.0)
    drive = drive_of(of_valve, outside, log_uniform(of_valve, 0.3, 1.5))
    sensor = process.lags[0] * log_uniform(of_valve, 0.1, 0.4) if "sensor filter" in outside else 0.0
    plant = plant_of(of_valve, process, h, "fractional lag" in outside)
    if sensor:
        plant = plant * Plant([1.0], [sensor, 1.0])
    ms = sensitivity(plant, k, ti, 0.0, 0.0, drive.late + h / 2)
    if ms > 2.5:
        return None
    hours = random.choice(sizes.hours)
    each = [each for each in EACH[hours] if each <= max(2.0, ti / 4)] or [1.0]
    cycle = Cycle(service, outside, process, plant, sensor, k, ti, ms, h, width, drive)
    return _cycling(name, cycle, random, random.choice(each), hours, of_valve)


def _cycling(name: RecordName, cycle: Cycle, random: Random, each: float, hours: int, of_valve: Random) -> Drawn:
    """The record of a limit cycle: little load but for a pulse that sets it going, and a few small steps.

    `each`: time between recorded samples [s].
    """
    k, ti, kp, h, width = cycle.k, cycle.ti, cycle.process.kp, cycle.h, cycle.width
    lags = (*cycle.process.lags, cycle.sensor) if cycle.sensor else cycle.process.lags
    t_end = hours * HOUR
    of_load = name.random("load")
    op, pv = random.uniform(40.0, 60.0), random.uniform(35.0, 65.0)
    pulse = of_load.choice((-1.0, 1.0)) * width * of_load.uniform(0.8, 1.5)
    lasts = 3 * (ti + sum(lags))
    steps = [(0.0, pv / kp - op), (0.01 * t_end, pv / kp - op + pulse), (0.01 * t_end + lasts, pv / kp - op)]
    for at, value in moves(of_load, t_end, t_end / of_load.uniform(1.5, 5.0), min(0.3 * width, 3.0)):
        if at > steps[-1][0]:
            steps.append((at, pv / kp - op + value))
    sigma = min(log_uniform(random, 0.01, 0.1) * width * kp, 0.3, 0.5 / k)
    scenario = Scenario(
        name=name.text,
        plant=cycle.plant,
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
        name=name.text,
        row=name.row,
        fault=name.fault,
        number=name.number,
        seed=name.seed,
        service=cycle.service,
        outside=cycle.outside,
        scenario=scenario,
        every=max(round(each / h), 1),
        kind="steps",
        changes=np.array([at for at, _ in steps[1:]]),
        size=abs(pulse),
        clearance=0.0,
        sticks=0.0,
        lags=lags,
        sigma=sigma,
        ms=cycle.ms,
        decimals=random.choice((0.0, 0.01)),
    )
    return _faulty(made, width, cycle.drive, of_valve)


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


def _outside(random: Random, number: int) -> tuple[str, ...]:
    """Choice from `OUTSIDE`: none for numbers 0 and 1 of any four, one or two for the others."""
    first, second, two = random.choice(OUTSIDE), random.choice(OUTSIDE), random.random() < 0.3
    if number % 4 < 2:
        return ()
    return (first, second) if two and second != first else (first,)


def _outer(random: Random, pv: float, size: float, t_end: float, whole: float) -> Outer:
    """A level or a temperature whose controller moves the setpoint of a flow or pressure.

    `pv`: the inner process value at rest, `size`: how far it is to move. Its own load steps.
    """
    steps = [(0.0, -pv), *((t, -pv + x) for t, x in moves(random, t_end, t_end / random.uniform(6, 25), size / 2))]
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
            load=(Steps(steps=tuple(steps)),),
        )
    k, ti = random.uniform(0.4, 1.5), slow
    return Outer(
        plant=Plant([1.0], [slow, 1.0], slow * random.uniform(0.05, 0.2)),
        controller=Controller(k=two_digits(k), ti=two_digits(ti), setpoint_weight=1.0, gain_unit="OP/PV"),
        limits=(0.0, 100.0),
        noise=(Gaussian(sigma=log_uniform(random, 0.01, 0.1)),),
        load=(Steps(steps=tuple((t, x + 50.0) for t, x in steps)),),
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
