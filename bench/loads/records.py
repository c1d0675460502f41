"""Records of a loop under a load, or a recorder, that a gap is easily confused with.

"row/none/17" and "row/gap/17" are one and the same loop, without and with a gap; everything in it follows from the row
and the number. "row/gap/17/3" is that loop on another day: the same dynamics, controller, valve and noise, a process
gain up to a quarter off, a load up to twice as large or as small. PI, one or two lags of 6 to 25 s together, 1500 rows
at 1 s, in which the controller runs too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from random import Random

import numpy as np
import numpy.typing as npt
import pyarrow as pa

import glapp
from glapp import tuning
from glapp.controller import Controller
from glapp.plant import Plant
from glapp.scenario import Coloured, Gaussian, Piece, Samples, Scenario, Steps
from glapp.simulate import Simulation, run

from ..truth.design import log_uniform
from ..truth.records import compressed, identifiable, traversals

Floats = npt.NDArray[np.float64]
Corners = Iterator[tuple[float, float]]
"""(time from the corner before [s], value there)."""

H = 1.0
"""Time between samples, of recording and controller [s]."""

SAMPLES = 1500


@dataclass(frozen=True)
class Truth:
    """Truth of a record.

    - `name`: the record's, from which it is made again.
    - `samples`: so many of it, from its beginning.
    - `h`: time between them [s].
    - `d`: width of the gap [% of OP]; 0 for none.
    - `up`, `down`: traversals of the gap, as in `bench.truth`.
    - `op_range`: OP, peak to peak [%].
    - `size`: the load's size, of which a gap is a share [%].
    - `identifiable`: by the rule of `bench.truth`: 5 traversals each way, OP ≥ 1.5·d, d·Kp ≥ 3σ, h ≤ T/5.
    """

    name: str
    samples: int
    h: float
    d: float
    up: int
    down: int
    op_range: float
    size: float
    identifiable: bool

    @property
    def row(self) -> str:
        """The load or the recorder of a row."""
        return self.name.split("/")[0]


@dataclass(frozen=True)
class Record:
    """A recording with its truth, of which any beginning is a record as well.

    - `table`: columns t [s], SP, PV, OP, and POSITION where the record is about it.
    - `loop`: name, spans, controller.
    - `op`, `position` (float64[n]): what the controller sent, and where the valve was [%].
    - `d`, `size`: as in `Truth`.
    - `gain`, `lag`, `sigma`: Kp [PV unit/%], T [s], standard deviation of the noise [PV unit].
    """

    table: pa.Table
    loop: glapp.Loop
    op: Floats
    position: Floats
    d: float
    size: float
    gain: float
    lag: float
    sigma: float

    def recording(self, samples: int) -> glapp.Recording:
        """The first so many samples."""
        return glapp.recording_from(self.table.slice(0, samples), self.loop)

    def truth(self, samples: int) -> Truth:
        """The truth of the first so many samples."""
        up, down = traversals(self.position[:samples])
        op_range = float(np.ptp(self.op[:samples]))
        h = self.table["t"][1].as_py()
        identified = identifiable(self.d, up, down, op_range, self.gain, self.sigma, h, self.lag)
        return Truth(self.loop.name, samples, h, self.d, up, down, op_range, self.size, identified)


def record(name: str, samples: int = SAMPLES, moves: Callable[[float], Piece] | None = None) -> Record:
    """Make the record of that name; a longer one begins with the shorter one.

    `moves` makes its setpoint, in units of Kp·1 %, which else stands at 50.
    """
    row, gap, number, *day = name.split("/")
    if gap not in ("none", "gap"):
        raise ValueError(f"{name}: the middle part is 'none' or 'gap'")
    random, of_load, of_recorder = (
        Random("/".join(part)) for part in ((row, number), (row, number, "load", *day), (row, number, "recorder", *day))
    )
    kp, size = random.uniform(0.5, 2.0), log_uniform(random, *SIZES.get(row, (2.0, 10.0)))
    d = min(max(size * log_uniform(random, 0.15, 0.5), 0.5), 3.0)
    lags, dead_time = _process(random)
    k, ti, _, _ = _tuned(random, kp, lags, dead_time).controller
    sigma = log_uniform(random, 0.01, 0.1)
    noise: list[Gaussian | Coloured | Samples] = [Gaussian(sigma=sigma)]
    filtered = 0.0
    if row == "outliers":
        noise.append(Samples(values=_outliers(of_recorder, log_uniform(of_recorder, 4.0, 25.0), samples)))
    elif row == "transmitter shifts":
        noise.append(Samples(values=_shifts(of_recorder, samples)))
    elif row == "PV filtered":
        filtered = log_uniform(of_recorder, 1.0, 10.0)
        if of_recorder.random() < 0.5:
            # The controller's input is filtered too: the filter belongs to process and noise.
            lags.append(filtered)
            noise = [Coloured(sigma=sigma / math.sqrt(1 + 2 * filtered / H), tau=filtered)]
            filtered = 0.0
    # No filter may take the outliers away before the controller.
    tf = random.choice((0.0, ti / 10)) if row != "outliers" else 0.0
    seed = random.randrange(2**32)
    if day:
        today = Random("/".join((row, number, "day", *day)))
        kp, size = kp * log_uniform(today, 0.8, 1.25), size * log_uniform(today, 0.5, 2.0)
        seed = today.randrange(2**32)
    scenario = Scenario(
        plant=Plant([kp], list(denominator(lags)), dead_time),
        controller=Controller(k=k, ti=ti, setpoint_weight=1.0, gain_unit="OP/PV"),
        tf=tf,
        pv_span=(0, 100),
        op_span=(0, 100),
        limits=(0.0, 100.0),
        d=d if gap == "gap" else 0.0,
        noise=tuple(noise),
        setpoint=(moves(kp) if moves else Steps(steps=((0.0, 50.0 * kp),)),),
        load=(Samples(values=LOADS.get(row, _ordinary)(of_load, size, samples)),),
        h=H,
        t_end=(samples - 1) * H,
        seed=seed,
    )
    simulation = run(scenario)
    loop = glapp.Loop(name=name, pv_span=(0, 100), op_span=(0, 100), controller=scenario.controller)
    return Record(
        table=pa.table(_recorded(row, of_recorder, simulation, filtered)),
        loop=loop,
        op=simulation.op,
        position=simulation.position,
        d=scenario.d,
        size=size,
        gain=kp,
        lag=sum(lags),
        sigma=sigma,
    )


def _process(random: Random) -> tuple[list[float], float]:
    """Lags and dead time [s]."""
    whole = log_uniform(random, 6.0, 25.0)
    second = random.choice((0.0, random.uniform(0.1, 0.5)))
    lags = [whole * (1 - second)] + [whole * second] * (second > 0)
    return lags, random.uniform(0.05, 0.4) * whole


def _tuned(random: Random, kp: float, lags: list[float], dead_time: float) -> tuning.Tuning:
    # The controller answers a sample later.
    plant = Plant([kp], list(denominator(lags)), dead_time + H)
    rule: Callable[..., tuning.Tuning] = random.choice(
        (
            tuning.simc,
            tuning.amigo_step,
            partial(tuning.lambda_tuning, lam=sum(lags)),
            partial(tuning.lambda_tuning, lam=3 * sum(lags)),
        )
    )
    return rule(plant, kind="PI")


def denominator(lags: Iterable[float]) -> Floats:
    """Coefficients of the product of all (lag·s + 1)."""
    polynomial = np.array([1.0])
    for lag in lags:
        polynomial = np.convolve(polynomial, [lag, 1.0])
    return polynomial


def _triangle(period: tuple[float, float], random: Random, size: float, samples: int) -> Floats:
    """Up and down at even speed, always the same."""
    half, phase = random.uniform(*period) / 2, random.uniform(0.0, 2.0)
    t = np.arange(samples) * H / half + phase
    return size * (np.abs(t % 2.0 - 1.0) - 0.5)


def _polygon(corners: Corners, samples: int) -> Floats:
    """Straight lines between corners, from (0, 0) on."""
    t, x = [0.0], [0.0]
    while t[-1] < samples * H:
        apart, value = next(corners)
        t.append(t[-1] + apart)
        x.append(value)
    return np.interp(np.arange(samples) * H, t, x)


def _random_ramps(random: Random, size: float, samples: int) -> Floats:
    """Ramp after ramp, up and down by turns, of 30 to 200 s each, to random values."""

    def corners() -> Corners:
        side = random.choice((-0.5, 0.5))
        while True:
            yield log_uniform(random, 30.0, 200.0), side * size * random.uniform(0.3, 1.0)
            side = -side

    return _polygon(corners(), samples)


def _slow_ramps(random: Random, size: float, samples: int) -> Floats:
    """A few ramps of 150 to 500 s, up and down by turns, some with a rest between them."""

    def corners() -> Corners:
        value, side = 0.0, random.choice((-0.5, 0.5))
        while True:
            if random.random() < 0.3:
                yield random.uniform(50.0, 200.0), value
            value, side = side * size * random.uniform(0.3, 1.0), -side
            yield random.uniform(150.0, 500.0), value

    return _polygon(corners(), samples)


def _irregular_cycle(random: Random, size: float, samples: int) -> Floats:
    """A neighbour that swings at about 150 s: each swing has a length and a height of its own."""

    def corners() -> Corners:
        side = random.choice((-0.5, 0.5))
        rises = random.uniform(0.35, 0.65)
        while True:
            period = 150.0 * random.uniform(0.8, 1.2)
            yield period * rises, side * size * random.uniform(0.7, 1.0)
            yield period * (1 - rises), -side * size * random.uniform(0.7, 1.0)

    return _polygon(corners(), samples)


def _squares(random: Random, size: float, samples: int) -> Floats:
    """Squares that come through a lag of 5 to 40 s."""
    period, phase = random.uniform(60.0, 400.0), random.random()
    t = np.arange(samples) * H
    squares = size * np.where((t / period + phase) % 1.0 < 0.5, 0.5, -0.5)
    return _lagged(squares, log_uniform(random, 5.0, 40.0))


def _walk(random: Random, size: float, samples: int) -> Floats:
    """A walk that goes as far as `size` (one sigma) in 300 s."""
    steps = [random.gauss(0.0, size * math.sqrt(H / 300.0)) for _ in range(samples - 1)]
    return np.concatenate([[0.0], np.cumsum(steps)])


def _steps(random: Random, size: float, samples: int) -> Floats:
    """Steps to random values, 60 to 300 s apart."""
    load, at = np.zeros(samples), random.uniform(0.0, 100.0)
    while at < samples * H:
        load[round(at / H) :] = random.uniform(-size, size) / 2
        at += random.uniform(60.0, 300.0)
    return load


def _ordinary(random: Random, size: float, samples: int) -> Floats:
    """Settings apart from the load: a walk or steps, half of them each."""
    return random.choice((_walk, _steps))(random, size, samples)


LOADS: dict[str, Callable[[Random, float, int], Floats]] = {
    "triangle fast": partial(_triangle, (60.0, 150.0)),
    "triangle slow": partial(_triangle, (300.0, 600.0)),
    "random ramps": _random_ramps,
    "slow ramps": _slow_ramps,
    "irregular cycle": _irregular_cycle,
    "squares through a lag": _squares,
    "walk": _walk,
    "steps": _steps,
}
"""Rows that are about the load."""

ROWS = (
    *(row for row in LOADS if row not in ("walk", "steps")),
    "outliers",
    "swinging door",
    "PV filtered",
    "transmitter shifts",
    "recorder shifts",
    "position",
    "walk",
    "steps",
)
"""Rows in the order of the table; the last two are the fit's own model."""

SIZES: dict[str, tuple[float, float]] = {
    "triangle fast": (5.0, 20.0),
    "random ramps": (5.0, 20.0),
    "slow ramps": (10.0, 30.0),
}
"""Sizes of the load, from and to [%], where they are not 2 to 10."""


def _lagged(x: Floats, lag: float) -> Floats:
    """Through a lag [s]; it begins at rest at the first value."""
    y, last = np.empty_like(x), float(x[0])
    for i, value in enumerate(x):
        last += (value - last) * H / (lag + H)
        y[i] = last
    return y


def _outliers(random: Random, size: float, samples: int) -> Floats:
    """Errors of single samples, 0.07 to 3 % of all: half the size to all of it, up or down."""
    off = np.zeros(samples)
    share = log_uniform(random, 0.0007, 0.03)
    at = random.uniform(0.0, min(1 / share, SAMPLES))  # one at least within the usual length
    while at < samples:
        off[int(at)] = random.choice((-1.0, 1.0)) * random.uniform(0.5, 1.0) * size
        at += random.expovariate(share)
    return off


def _shifts(random: Random, samples: int) -> Floats:
    """Steps of a transmitter that is set anew, or of a recorder's new scale: of 2 to 20, 150 to 900 s apart."""
    shifts, at = np.zeros(samples), random.uniform(50.0, 500.0)
    while at < samples * H:
        shifts[round(at / H) :] += random.choice((-1.0, 1.0)) * log_uniform(random, 2.0, 20.0)
        at += random.uniform(150.0, 900.0)
    return shifts


def swinging_door(x: Floats, band: float) -> Floats:
    """Signal from a historian that kept only the corners of x, at even steps, and draws lines between them.

    A corner is kept as soon as no line from the one before passes all samples since within ± `band`.
    """
    kept, last = [0], 0
    up, low = math.inf, -math.inf
    for i in range(1, x.size):
        up = min(up, (x[i] + band - x[last]) / (i - last))
        low = max(low, (x[i] - band - x[last]) / (i - last))
        if low > up:
            last = i - 1
            kept.append(last)
            up, low = x[i] + band - x[last], x[i] - band - x[last]
    kept.append(x.size - 1)
    return np.interp(np.arange(x.size), kept, x[kept])


def _recorded(row: str, random: Random, simulation: Simulation, filtered: float) -> dict[str, Floats]:
    """Columns of the recording."""
    pv, op = simulation.pv, simulation.op
    columns: dict[str, Floats] = {}
    if filtered:
        pv = _lagged(pv, filtered)
    if row == "swinging door":
        pv = swinging_door(pv, log_uniform(random, 0.05, 1.0))
        if random.random() < 0.5:
            op = swinging_door(op, log_uniform(random, 0.05, 0.25))
    elif row == "recorder shifts":
        pv = pv + _shifts(random, pv.size)
    elif row == "position":
        position = simulation.position.copy()
        if random.random() < 0.75:
            position = compressed(position, 0.5)
        else:
            position += _outliers(random, log_uniform(random, 2.0, 20.0), position.size)
        columns["POSITION"] = position
    return {"t": simulation.t, "SP": simulation.sp, "PV": pv, "OP": op, **columns}
