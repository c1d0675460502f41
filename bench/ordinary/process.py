"""Process, valve drive and controller of the ordinary loops: their sizes, and the tuning as people leave it."""

from __future__ import annotations

import math
from random import Random
from typing import NamedTuple

import numpy as np

from glapp.plant import Plant

from ..loads.records import denominator
from ..truth.design import log_uniform


class Service(NamedTuple):
    """Least and greatest sizes of a kind of loops.

    - `lag` [s]; `second`, `dead_time`: second lag and dead time [first lags].
    - `noise`: standard deviation [PV unit]; `h`: step of the simulation [s].
    - `hours`: lengths of the records [h].
    - `holdup`: time in which a flow of 100 % fills the vessel [s]; None: the process does not integrate. Of one that
      does, `lag` is that of the flow.
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


class Process(NamedTuple):
    """A process before it is tuned.

    - `kp`: process gain [PV unit/%]; of one that integrates it takes no part.
    - `lags`: the longest first [s]; `dead_time` [s].
    - `speed`: of one that integrates, PV units per second for each per cent of OP [1/s].
    """

    kp: float
    lags: tuple[float, ...]
    dead_time: float
    speed: float | None = None

    def time_scale(self, ti: float) -> float:
        """Sum of lags and dead time, for a process that integrates the controller's Ti [s]."""
        return sum(self.lags) + self.dead_time if self.speed is None else ti


def process_of(random: Random, sizes: Service) -> Process:
    """A process of that kind of loops."""
    kp = log_uniform(random, 0.4, 2.5)
    first, second = log_uniform(random, *sizes.lag), random.uniform(*sizes.second)
    dead_time = random.uniform(*sizes.dead_time) * first
    speed = 1.0 / log_uniform(random, *sizes.holdup) if sizes.holdup else None
    return Process(kp, (first, first * second) if second > 0.02 else (first,), dead_time, speed)


class Drive(NamedTuple):
    """Parts of the valve that a fault does not change, as in `Valve`."""

    lag: float
    positioner: float
    curve: float

    @property
    def late(self) -> float:
        """Lag of the valve's position behind OP [s]; counts as dead time of the loop."""
        return self.lag / (1 + self.positioner)


def drive_of(random: Random, outside: tuple[str, ...], lag: float) -> Drive:
    """Drive of the valve, whose actuator has that lag [s] where there is no positioner."""
    positioner = curve = 0.0
    if "positioner" in outside:
        positioner, lag = log_uniform(random, 1.0, 6.0), max(lag, log_uniform(random, 0.5, 3.0))
    if "valve curve" in outside:
        curve = random.choice((-1.0, 1.0, 1.0)) * random.uniform(0.4, 1.5)
    return Drive(lag, positioner, curve)


def plant_of(random: Random, process: Process, h: float, fractional: bool) -> Plant:
    """The process as it is simulated, its first lag fractional or not.

    `h`: step of the simulation [s]; no other lag is shorter.
    """
    kp, lags, dead_time, speed = process
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
        num = num + weight * np.poly1d(1.0).coeffs * denominator(np.delete(lags, i))
    return Plant(num.tolist(), denominator(lags).tolist())


def two_digits(x: float) -> float:
    """A number with the two digits that a person types."""
    return float(f"{x:.2g}")


def tuned(random: Random, process: Process, h: float) -> tuple[float, float, float]:
    """K, Ti [s] and Td [s] by SIMC or Lambda (half rule for the second lag), as changed by a person.

    `h`: step of the simulation [s], which counts as dead time.
    """
    kp, lags, _, speed = process
    dead_time = process.dead_time + h
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


def within_margins(
    random: Random, plant: Plant, k: float, ti: float, td: float, tf: float, late: float, rings: bool
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
