"""First-order models with dead time, from a transfer function or a recorded step response."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from ..checked import check_number, numbers_of
from ..errors import InputError
from ..plant import Plant
from .process import Array, Process

Character = Literal["lag-dominated", "balanced", "delay-dominated", "integrating"]
"""Limit of a process's control (thesis 4.1)."""

_LAG_DOMINATED, _DELAY_DOMINATED = 0.3, 0.5


@dataclass(frozen=True, slots=True)
class Fotd:
    """First-order model with dead time, Kp·e^(−L·s)/(1 + s·T).

    Attributes
    ----------
    kp_process : float
        Static gain Kp [process value per output], ≠ 0.
    t, l : float
        Time constant (lag) T and dead time L [s], ≥ 0.

    Raises
    ------
    InputError
        For a number out of its bounds.

    Examples
    --------
    >>> Fotd(2.0, t=3.0, l=1.0).tau
    0.25
    """

    kp_process: float
    t: float
    l: float  # noqa: E741 - the symbol in every source

    def __post_init__(self) -> None:
        check_number(self.kp_process, "kp_process", lambda x: x != 0, "other than 0")
        check_number(self.t, "t", lambda x: x >= 0, "0 s or greater")
        check_number(self.l, "l", lambda x: x >= 0, "0 s or greater")

    @property
    def tau(self) -> float:
        """Normalised dead time L/(L + T), 0..1; of a model with neither there is none."""
        check_number(self.l + self.t, "t + l", lambda x: x > 0, "greater than 0 s for a normalised dead time")
        return self.l / (self.l + self.t)

    @property
    def plant(self) -> Plant:
        """The model as a process."""
        return Plant([self.kp_process], [self.t, 1.0], self.l)


def fotd(plant: Process) -> Fotd:
    """First-order model of a stable process, read off its step response (thesis 4.1).

    L is where the steepest tangent meets the time axis; T = T63 − L, T63 being where the response first reaches
    1 − 1/e = 63 % of its end.

    Parameters
    ----------
    plant : process
        Stable, without integrator, static gain ≠ 0, num of lower degree than den.

    Raises
    ------
    InputError
        For a process outside these bounds, or one whose response turns so much that T or L would be below 0.

    Examples
    --------
    >>> model = fotd("P2")
    >>> round(model.l, 3), round(model.t, 3)
    (1.425, 2.927)
    """
    return _read(Plant.of(plant))[0]


def character(process: Process) -> Character:
    """Limit of a process's control (thesis 4.1), by τ = L/(L + T) of its FOTD model.

    Delay-dominated where L > T, τ > 0.5, as the thesis has it. Lag-dominated is what has "a much larger" T than L. The
    thesis leaves open how much, and calls P2 (τ = 0.33, T = 2.1 L) balanced. Here it is τ < 0.3, T > 2.3 L; any border
    between 0.25 and 0.33 gives the same classes for the test batch. Balanced is the rest.

    Parameters
    ----------
    process : process
        With at most one integrator.

    Returns
    -------
    Character

    Raises
    ------
    InputError
        For a process without an FOTD model (`fotd`).

    Examples
    --------
    >>> from glapp.plant import PLANTS
    >>> for name, plant in PLANTS.items():
    ...     print(name, character(plant))
    P1 integrating
    P2 balanced
    P3 balanced
    P4 delay-dominated
    P5 lag-dominated
    P6 balanced
    P7 balanced
    P8 delay-dominated
    """
    plant = Plant.of(process)
    if plant.integrators == 1:
        return "integrating"
    tau = fotd(plant).tau
    return "lag-dominated" if tau < _LAG_DOMINATED else "delay-dominated" if tau > _DELAY_DOMINATED else "balanced"


def tangent(plant: Plant) -> tuple[float, float]:
    """Points at which the steepest tangent of the unit step response meets the axes: process value −a, time L [s].

    The process must have an FOTD model. That model's own tangent, a = Kp·L/T, is not the process's: it is drawn to
    the response's 63 % and not to its slope, which for many equal lags makes it steeper.
    """
    model, slope = _read(plant)
    return slope * model.l, model.l


def _read(plant: Plant) -> tuple[Fotd, float]:
    """The model of a process, and the steepest slope of its response to a unit step."""
    kp = plant.gain
    if kp is None:
        raise InputError("has an integrator, an FOTD model has none", parameter="plant", hint="use integrating()")
    if not plant.is_stable:
        raise InputError("is unstable, its step response has no end", parameter="plant", value=plant, bound="stable")
    if kp == 0 or len(plant.num) == len(plant.den):
        what = "has a static gain of 0" if kp == 0 else "jumps at a step: num must be of lower degree than den"
        raise InputError(f"{what}; there is no FOTD model of it", parameter="plant", value=plant)
    scaled = plant * (1 / kp)
    slope = Plant([*scaled.num, 0.0], scaled.den, scaled.dead_time)
    corners = np.concatenate([plant.poles, plant.zeros])
    end = plant.dead_time + 3 * float(np.sum(1 / np.abs(corners.real[corners.real != 0])))
    course = scaled.step_response(np.linspace(plant.dead_time, end, 1000))
    if course.max() > 1.5 or course.min() < -0.5:
        raise InputError(
            "swings beyond its rest, or to the other side, by more than half of its change at a step",
            parameter="plant",
            value=plant,
            bound="a step response that is essentially monotone",
        )
    try:
        t63 = _narrow(lambda t: int(np.argmax(scaled.step_response(t) >= _RISE)), plant.dead_time, end)
        steepest = _narrow(lambda t: int(np.argmax(slope.step_response(t))), plant.dead_time, end)
    except ValueError:
        raise InputError("never reaches 63 % of its static gain", parameter="plant", value=plant) from None
    rise, speed = float(scaled.step_response(steepest)), float(slope.step_response(steepest))
    return _checked(kp, t63, steepest - rise / speed), kp * speed


_RISE = 1 - math.exp(-1)


def _narrow(pick: Callable[[Array], int], low: float, high: float) -> float:
    """The point that `pick` takes of a grid, on ever finer grids between the neighbours of the one before."""
    start = low
    while high - low > 1e-10 * (high - start) and high - low > 1e-12 * high:
        grid = np.linspace(low, high, 129)
        i = pick(grid)
        low, high = grid[max(i - 1, 0)], grid[min(i + 1, 128)]
    return float(0.5 * (low + high))


def _checked(kp: float, t63: float, l: float) -> Fotd:  # noqa: E741
    """A model, checked for 0 ≤ L < T63."""
    if not (l >= -1e-9 * t63 and t63 > l):
        raise InputError(
            f"gives L = {l:.4g} s and T63 = {t63:.4g} s; a step response that is essentially monotone has 0 ≤ L < T63",
            parameter="plant",
            bound="0 ≤ L < T63",
        )
    return Fotd(kp, t63 - max(l, 0.0), max(l, 0.0))


def fotd_from_step(t: npt.ArrayLike, y: npt.ArrayLike, u_step: float) -> Fotd:
    """First-order model from a recorded step response, by the same construction as `fotd`.

    The tangent is a straight line fitted to a stretch of the response as long as a tenth of what it needs from 5 %
    to 63 %; the start is the mean of the samples before the step (the first one if there are none), the end the mean
    of the last tenth.

    Parameters
    ----------
    t : float64[n]
        Time since the step [s], ascending, n ≥ 20; samples before the step have t < 0.
    y : float64[n]
        Process value.
    u_step : float
        Height of the step in the output, ≠ 0.

    Raises
    ------
    InputError
        For arrays that do not fit together, and for a response that has not come to rest: its last two tenths must
        not differ by more than 2 % of the whole change.

    Notes
    -----
    Known bias: noise makes the steepest line steeper, so L comes out too long and T too short.

    Examples
    --------
    >>> t = np.linspace(0, 30, 3001)
    >>> model = fotd_from_step(t, Plant.of("P2").step_response(t), u_step=1)
    >>> round(model.kp_process, 3), round(model.l, 2), round(model.t, 2)
    (1.0, 1.42, 2.93)
    """
    t, y = numbers_of(t, "t"), numbers_of(y, "y")
    if t.ndim != 1 or t.shape != y.shape or t.size < 20:
        raise InputError(
            f"have shapes {t.shape} and {y.shape}, must be equally long, 20 samples or more", column="t, y"
        )
    if not (np.all(np.diff(t) > 0) and t[-1] > 0):
        raise InputError("must be ascending and go beyond the step at 0", column="t")
    u_step = check_number(u_step, "u_step", lambda x: x != 0, "other than 0")
    before = t < 0
    start = float(y[before].mean()) if before.any() else float(y[0])
    t, y = t[~before], y[~before]
    last, last_but_one = (y[(t >= t[-1] * a) & (t <= t[-1] * b)] for a, b in ((0.9, 1.0), (0.8, 0.9)))
    change = float(last.mean()) - start
    if change == 0 or not last_but_one.size or abs(last.mean() - last_but_one.mean()) > 0.02 * abs(change):
        raise InputError(
            "has not come to rest after the step: its last two tenths differ by more than 2 % of the change",
            column="y",
            bound="at rest",
        )
    rise = (y - start) / change
    t63 = _first_above(t, rise, _RISE)
    width = max(0.1 * (t63 - _first_above(t, rise, 0.05)), 2.1 * float(np.median(np.diff(t))))
    # Sums over a sliding stretch [i, j) give the line through it without a loop.
    i = np.arange(t.size)
    j = np.searchsorted(t, t + width, side="right")
    sums = [np.concatenate([[0.0], np.cumsum(x)]) for x in (t, rise, t * t, t * rise)]
    n, (st, sy, stt, sty) = j - i, (s[j] - s[i] for s in sums)
    whole = (n >= 3) & (t + width <= t[-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(whole, (n * sty - st * sy) / (n * stt - st * st), -math.inf)
    best = int(np.argmax(slope))
    l = (st[best] - sy[best] / slope[best]) / n[best]  # noqa: E741
    return _checked(change / u_step, t63, float(l))


def _first_above(t: Array, y: Array, level: float) -> float:
    """Time of the first crossing, on the straight line between two samples."""
    i = int(np.argmax(y >= level))
    return float(t[i]) if i == 0 else float(t[i - 1] + (level - y[i - 1]) / (y[i] - y[i - 1]) * (t[i] - t[i - 1]))
