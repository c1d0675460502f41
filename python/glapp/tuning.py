"""Tuning rules, from a table of 1942 to constrained optimisation, each with what it does to the loop.

Every rule gives a `Tuning`: the controller in ideal form, its robustness on the process it is meant for (dead time
exact), and what a load step does. The closed forms are in the core, this module describes the process to them.

==============================  ==========================================================  =========================
rule                            needs                                                       source
==============================  ==========================================================  =========================
`ziegler_nichols_step`          tangent of the step response                                Ziegler & Nichols 1942
`ziegler_nichols_frequency`     ultimate gain and period                                    Ziegler & Nichols 1942
`lambda_tuning`                 FOTD model, the time constant λ wished for                  Dahlin 1968
`amigo_step`                    FOTD model                                                  APC ch. 7
`amigo_frequency`               ultimate gain and period, static gain                       APC ch. 7
`simc`                          one or two lags and a dead time                             Skogestad 2003
`migo`                          the process                                                 Åström et al. 1998, 2004
`design`                        the process                                                 Garpinger & Hägglund 2008
==============================  ==========================================================  =========================

APC: Åström and Hägglund, *Advanced PID Control*, 2006.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from . import _glapp
from .controller import Ideal
from .errors import InputError
from .plant import Plant

__all__ = [
    "Fotd",
    "Integrating",
    "Kind",
    "Tuning",
    "Ultimate",
    "amigo_frequency",
    "amigo_step",
    "assess",
    "design",
    "fotd",
    "fotd_from_step",
    "half_rule",
    "integrating",
    "lambda_tuning",
    "migo",
    "open_loop",
    "simc",
    "ultimate",
    "ziegler_nichols_frequency",
    "ziegler_nichols_step",
]

Kind = Literal["PI", "PID"]
Array = npt.NDArray[np.float64]


# --- What a rule knows of a process ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Fotd:
    """First-order model with dead time, Kp·e^(−L·s)/(1 + s·T).

    Attributes
    ----------
    kp_process : float
        Static gain Kp [process value per output], ≠ 0.
    t, l : float
        Time constant (lag) T and dead time L [s], ≥ 0.

    Examples
    --------
    >>> Fotd(2.0, t=3.0, l=1.0).tau
    0.25
    """

    kp_process: float
    t: float
    l: float  # noqa: E741 - the symbol in every source

    @property
    def tau(self) -> float:
        """Normalised dead time L/(L + T), 0..1."""
        return self.l / (self.l + self.t)

    @property
    def plant(self) -> Plant:
        """The model as a process."""
        return Plant([self.kp_process], [self.t, 1.0], self.l)


@dataclass(frozen=True, slots=True)
class Integrating:
    """Integrator with dead time, Kv·e^(−L·s)/s.

    Attributes
    ----------
    kv : float
        Velocity gain Kv [process value per output and s], ≠ 0.
    l : float
        Dead time L [s], ≥ 0.
    """

    kv: float
    l: float  # noqa: E741

    @property
    def plant(self) -> Plant:
        """The model as a process."""
        return Plant([self.kv], [1.0, 0.0], self.l)


class Ultimate(NamedTuple):
    """Where P(iω) crosses the negative real axis farthest out.

    Attributes
    ----------
    ku : float
        Ultimate gain Ku: a proportional controller with it makes the loop oscillate steadily.
    tu : float
        Period Tu of that oscillation [s].
    """

    ku: float
    tu: float


Process = Any
"""What `Plant.of` accepts, or an `Fotd` or `Integrating` model."""


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
    plant = Plant.of(plant)
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
    return _checked_fotd(kp, t63, steepest - rise / speed)


_RISE = 1 - math.exp(-1)


def _narrow(pick: Callable[[Array], int], low: float, high: float) -> float:
    """The point that `pick` takes of a grid, on ever finer grids between the neighbours of the one before."""
    start = low
    while high - low > 1e-10 * (high - start) and high - low > 1e-12 * high:
        grid = np.linspace(low, high, 129)
        i = pick(grid)
        low, high = grid[max(i - 1, 0)], grid[min(i + 1, 128)]
    return float(0.5 * (low + high))


def _checked_fotd(kp: float, t63: float, l: float) -> Fotd:  # noqa: E741
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
    t, y = np.asarray(t, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if t.ndim != 1 or t.shape != y.shape or t.size < 20:
        raise InputError(
            f"have shapes {t.shape} and {y.shape}, must be equally long, 20 samples or more", column="t, y"
        )
    if not (np.isfinite(t).all() and np.isfinite(y).all() and np.all(np.diff(t) > 0) and t[-1] > 0):
        raise InputError("must be finite numbers, t ascending and beyond the step at 0", column="t, y")
    if not (math.isfinite(u_step) and u_step != 0):
        raise InputError(f"is {u_step}, must be other than 0", parameter="u_step", value=u_step, bound="≠ 0")
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
    return _checked_fotd(change / u_step, t63, float(l))


def _first_above(t: Array, y: Array, level: float) -> float:
    """Time of the first crossing, on the straight line between two samples."""
    i = int(np.argmax(y >= level))
    return float(t[i]) if i == 0 else float(t[i - 1] + (level - y[i - 1]) / (y[i] - y[i - 1]) * (t[i] - t[i - 1]))


def integrating(plant: Process) -> Integrating:
    """Integrator with dead time that a process with one integrator becomes in the long run.

    After a unit step y → Kv·(t − L): L is the dead time and all lags, less the zeros' lead.

    Parameters
    ----------
    plant : process
        One integrator, otherwise stable.

    Examples
    --------
    >>> integrating("P1")
    Integrating(kv=1.0, l=1.0)
    """
    plant = Plant.of(plant)
    kv = plant.velocity_gain
    if kv is None or not plant.is_stable:
        raise InputError(
            "must have one integrator and otherwise be stable", parameter="plant", value=plant, bound="one integrator"
        )
    corners = np.concatenate([-1 / plant.poles[plant.poles != 0], 1 / plant.zeros[plant.zeros != 0]])
    l = plant.dead_time + float(corners.sum().real)  # noqa: E741
    if l < -1e-12:
        raise InputError(
            f"leads by {-l:.4g} s in the long run, must lag", parameter="plant", value=plant, bound="L ≥ 0"
        )
    return Integrating(kv, max(l, 0.0))


def ultimate(plant: Process) -> Ultimate:
    """Ultimate gain and period: where −1/P(iω) is real, nearest to 0.

    Parameters
    ----------
    plant : process
        Stable, or with one integrator; negative gains give a negative Ku.

    Raises
    ------
    InputError
        Where no gain makes the loop oscillate.

    Examples
    --------
    >>> ku, tu = ultimate("P2")
    >>> round(ku, 9), round(tu / math.pi, 9)
    (4.0, 2.0)
    """
    plant = _stable(Plant.of(plant))
    sign = _sign(plant)
    w = plant.frequencies()
    value = sign * plant.response(w)
    cells = np.flatnonzero((np.sign(value.imag[:-1]) != np.sign(value.imag[1:])) & (value.real[:-1] < 0))
    best = Ultimate(math.inf, math.nan)
    for i in cells:
        at = _root(lambda x: float((sign * plant.response(x)).imag), w[i], w[i + 1])
        real = float((sign * plant.response(at)).real)
        if real < 0 and -1 / real < best.ku:
            best = Ultimate(-1 / real, 2 * math.pi / at)
    if math.isinf(best.ku):
        raise InputError(
            "has no ultimate gain: its phase never passes −180°", parameter="plant", value=plant, bound="phase < −180°"
        )
    return Ultimate(sign * best.ku, best.tu)


def half_rule(plant: Process, kind: Kind = "PI") -> tuple[float, float, float, float]:
    """Skogestad's half rule: a process with real poles as one lag (PI) or two lags (PID) and a dead time.

    Lags that are left out become dead time, but for half of the largest of them, which lengthens the last one kept;
    zeros in the right half plane become dead time.

    Returns
    -------
    (gain, t, t2, l) : float
        Kp, or Kv with an integrator, for which t is infinite; lags t ≥ t2 ≥ 0 and dead time l [s].

    Examples
    --------
    >>> half_rule("P2")
    (1.0, 1.5, 0.0, 2.5)
    >>> half_rule("P2", "PID")
    (1.0, 1.0, 1.5, 1.5)
    """
    plant = _stable(Plant.of(plant))
    poles, zeros = plant.poles, plant.zeros
    # A multiple real pole is found as a small ring around it.
    if np.any(np.abs(poles.imag) > 0.05 * np.abs(poles)):
        raise InputError(
            "has complex poles, the half rule needs real ones",
            parameter="plant",
            value=plant,
            bound="real poles",
            hint="give the rule a model: fotd(plant)",
        )
    if np.any(zeros.real <= 0) or np.any(np.abs(zeros.imag) > 0.05 * np.abs(zeros)):
        raise InputError(
            "has zeros that are not real and in the right half plane",
            parameter="plant",
            value=plant,
            bound="real zeros > 0",
            hint="give the rule a model: fotd(plant)",
        )
    gain = plant.gain if plant.gain is not None else plant.velocity_gain
    assert gain is not None
    lags = [math.inf] * (plant.integrators == 1) + sorted(_mean_lags(poles[poles != 0]), reverse=True)
    kept = 1 if kind == "PI" else 2
    lags += [0.0] * (kept + 1 - len(lags))
    rest = lags[kept:]
    lags[kept - 1] += rest[0] / 2
    l = plant.dead_time + sum(rest) - rest[0] / 2 + float(np.sum(1 / zeros).real)  # noqa: E741
    return gain, lags[0], lags[1] if kind == "PID" else 0.0, l


def _mean_lags(poles: npt.NDArray[np.complex128]) -> list[float]:
    """Lags of real poles; those that rounding spread around a multiple pole are replaced by their mean."""
    if not poles.size:  # an integrator alone
        return []
    lags: list[float] = []
    ordered = np.sort(-poles.real)
    for group in np.split(ordered, np.flatnonzero(np.diff(ordered) > 0.1 * ordered[1:]) + 1):
        lags += [1 / float(np.round(group.mean(), 12))] * group.size
    return lags


# --- What a controller does to the loop -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Tuning:
    """A controller, and what it makes of the loop.

    Attributes
    ----------
    rule, source : str
        The rule that gave it, with its own parameters, and where the rule is from.
    controller : Ideal
        K, Ti, Td, b in ideal form. b is 0 as in (4.1): no rule here depends on it.
    tf : float
        Time constant of the second-order measurement filter in the loop [s] (2.1); 0: none.
    ms, mt : float
        Greatest magnitude of the sensitivity 1/(1 + PC) and of the complementary sensitivity PC/(1 + PC).
    gain_margin, phase_margin : float
        Factor that the gain may still grow by, inf where no gain is too much; angle [°] that may still be lost.
    iae : float
        ∫|e| dt after a unit load step at the process input [process value · s]. Without a swing to the other side it
        is exactly 1/|ki|.
    plant : Plant
        The process that all this is for.
    """

    rule: str
    source: str
    controller: Ideal
    tf: float
    ms: float
    mt: float
    gain_margin: float
    phase_margin: float
    iae: float
    plant: Plant

    @property
    def ki(self) -> float:
        """Integral gain K/Ti [output per process value and s]."""
        return self.controller.k / self.controller.ti

    @property
    def loop(self) -> Plant:
        """The open loop P(s)·C(s)·F(s)."""
        return open_loop(self.plant, self.controller, self.tf)

    def __str__(self) -> str:
        k, ti, td, _ = self.controller
        return (
            f"{self.rule}: K {k:.4g}, Ti {ti:.4g} s, Td {td:.4g} s; Ms {self.ms:.2f}, Mt {self.mt:.2f}, "
            f"gain margin {self.gain_margin:.3g}, phase margin {self.phase_margin:.0f}°, IAE {self.iae:.3g}"
        )


def open_loop(plant: Process, controller: Sequence[float], tf: float = 0.0) -> Plant:
    """Open loop of a process, a controller in ideal form and the filter 1/(1 + s·tf)², as one transfer function.

    Parameters
    ----------
    plant : process
    controller : (k, ti), (k, ti, td) or (k, ti, td, b)
        k ≠ 0, ti > 0 [s], td ≥ 0 [s]; b is of no influence.
    tf : float
        Time constant of the filter [s], ≥ 0.

    Raises
    ------
    InputError
        For a parameter out of its bounds, and where derivative action on a process that jumps makes the loop improper.

    Examples
    --------
    >>> open_loop(Plant([1], [2, 1]), (3, 2))
    Plant(num=(6.0, 3.0), den=(4.0, 2.0, 0.0), dead_time=0.0)
    """
    plant = _plant(plant)
    k, ti, td, _ = _ideal(controller)
    if not (math.isfinite(tf) and tf >= 0):
        raise InputError(f"is {tf}, must be 0 s or greater", parameter="tf", value=tf, bound="0 s or greater")
    lag = [tf * tf, 2 * tf, 1.0] if tf else [1.0]
    num = np.polymul(plant.num, [k * ti * td, k * ti, k] if td else [k * ti, k])
    den = np.polymul(np.polymul(plant.den, lag), [ti, 0.0])
    if len(num) > len(den):
        raise InputError(
            "jumps at a step: derivative action without a filter has no end there",
            parameter="plant",
            value=plant,
            bound="num of lower degree than den",
            hint="give its fastest lag",
        )
    return Plant(num.tolist(), den.tolist(), plant.dead_time)


def assess(
    plant: Process, controller: Sequence[float], *, tf: float = 0.0, rule: str = "as given", source: str = ""
) -> Tuning:
    """Robustness and load rejection of a loop, dead time exact.

    Parameters
    ----------
    plant : process
        Stable but for integrators.
    controller : (k, ti), (k, ti, td) or (k, ti, td, b)
        Ideal form; k negative for a process of negative gain.
    tf : float
        Time constant of the second-order measurement filter [s], 0: none.
    rule, source : str
        Kept in the result.

    Raises
    ------
    InputError
        For an unstable process or an unstable closed loop.

    Notes
    -----
    Ms, Mt and the margins are extremes over frequency: found on a grid, then refined, to about nine digits. Stability
    is counted by Nyquist's criterion. IAE comes from the inverse Fourier transform of P/(1 + PC)/(iω): relative error
    below 1e-4.

    Examples
    --------
    >>> print(assess("P2", (0.775, 2.05)))
    as given: K 0.775, Ti 2.05 s, Td 0 s; Ms 2.00, Mt 1.35, gain margin 2.61, phase margin 46°, IAE 3.6
    >>> assess("P2", (5.0, 2.05))
    Traceback (most recent call last):
    glapp.errors.InputError: controller: as given makes the closed loop unstable
    """
    plant, ideal = _plant(plant), _ideal(controller)
    loop = open_loop(plant, ideal, tf)
    if np.any(plant.poles.real[plant.poles != 0] >= 0):
        raise InputError("has poles in the right half plane", parameter="plant", value=plant, bound="stable")
    w = loop.frequencies()
    value = loop.response(w)
    if not _closed_loop_stable(loop, value):
        raise InputError(f"{rule} makes the closed loop unstable", parameter="controller", value=tuple(ideal))
    ms, w_ms = _peak(lambda x: 1 / np.abs(1 + loop.response(x)), w, 1 / np.abs(1 + value))
    mt, _ = _peak(lambda x: np.abs(loop.response(x) / (1 + loop.response(x))), w, np.abs(value / (1 + value)))
    if len(loop.num) == len(loop.den):  # the curve does not end at 0, but at a point, or with dead time on a circle
        end = loop.num[0] / loop.den[0]
        reach = 1 - abs(end) if loop.dead_time else abs(1 + end)
        ms, mt = max(ms, 1 / reach), max(mt, abs(end) / reach)
    gain_margin, phase_margin = _margins(loop, w, value)
    iae = _iae(plant, loop, abs(ideal.k / ideal.ti), w_ms)
    return Tuning(rule, source, ideal, float(tf), ms, max(mt, 1.0), gain_margin, phase_margin, iae, plant)


def _closed_loop_stable(loop: Plant, value: npt.NDArray[np.complex128]) -> bool:
    """Nyquist's criterion: from ω = 0+ to ∞ the argument of 1 + L turns by 90° for each integrator, and not otherwise.

    Each unstable pole of the closed loop takes 180° of it.
    """
    if len(loop.num) == len(loop.den) and loop.dead_time and abs(loop.num[0] / loop.den[0]) >= 1:
        return False  # a gain of 1 or more at all high frequencies, and dead time turns it through −1
    turned = np.unwrap(np.angle(1 + value))
    return bool(abs(turned[-1] - turned[0] - loop.integrators * math.pi / 2) < math.pi / 2)


def _peak(function: Callable[[Array], Array], w: Array, value: Array) -> tuple[float, float]:
    """Greatest value over frequency and where it is: the highest points of the grid, refined."""
    inner = np.flatnonzero((value[1:-1] >= value[:-2]) & (value[1:-1] >= value[2:])) + 1
    candidates = inner[value[inner] > 0.95 * value.max()]
    best, where = float(value.max()), float(w[int(np.argmax(value))])
    for i in candidates:
        low, high = w[i - 1], w[i + 1]
        for _ in range(4):
            grid = np.linspace(low, high, 33)
            fine = function(grid)
            j = int(np.argmax(fine))
            low, high = grid[max(j - 1, 0)], grid[min(j + 1, 32)]
            if fine[j] > best:
                best, where = float(fine[j]), float(grid[j])
    return best, where


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function changes its sign between two points, by halving: no hurry, and no way to miss it."""
    negative = function(low) < 0
    for _ in range(48):
        middle = 0.5 * (low + high)
        if (function(middle) < 0) == negative:
            low = middle
        else:
            high = middle
    return float(0.5 * (low + high))


def _margins(loop: Plant, w: Array, value: npt.NDArray[np.complex128]) -> tuple[float, float]:
    """Gain margin at the crossings of the negative real axis, phase margin [°] at those of the unit circle."""
    gain, phase = math.inf, math.inf
    crossed = np.flatnonzero((np.sign(value.imag[:-1]) != np.sign(value.imag[1:])) & (value.real[:-1] < 0))
    # With dead time there are any number of them: refined are those that may be the farthest out short of −1.
    short = np.where(value.real[crossed] > -1.1, -value.real[crossed], 0.0)
    for i in crossed[short > 0.8 * short.max(initial=0.0)]:
        at = _root(lambda x: float(loop.response(x).imag), w[i], w[i + 1])
        real = float(loop.response(at).real)
        if -1 < real < 0:
            gain = min(gain, -1 / real)
    size = np.abs(value)
    for i in np.flatnonzero((size[:-1] > 1) != (size[1:] > 1)):
        at = _root(lambda x: float(np.abs(loop.response(x))) - 1, w[i], w[i + 1])
        phase = min(phase, abs(math.degrees(float(np.angle(-loop.response(at))))))
    return gain, phase


def _iae(plant: Plant, loop: Plant, ki: float, w_ms: float) -> float:
    """∫|y| dt after a unit load step, from y(t) as the inverse Fourier transform of P/(1 + PC)/(iω)."""
    h = 0.03 / w_ms
    if plant.dead_time:
        h = min(h, plant.dead_time / 32)
    n = 1 << 13
    while True:
        # A response that has not died away within n·h comes round again at the start: twice as long, then.
        w = 2 * math.pi / (n * h) * np.arange(1, n // 2 + 1)
        spectrum = np.empty(n // 2 + 1, dtype=np.complex128)
        spectrum[0] = 1 / ki if plant.num[-1] * loop.num[-1] >= 0 else -1 / ki
        spectrum[1:] = plant.response(w) / (1 + loop.response(w)) / (1j * w)
        y = np.fft.irfft(spectrum, n) / h
        # Just before the end stands what the cut spectrum adds before the start: looked at is what comes before that.
        if np.abs(y[-n // 4 : -n // 8]).max() < 1e-5 * np.abs(y).max() or n >= 1 << 19:
            break
        n *= 2
    a, b = np.abs(y), np.abs(np.roll(y, -1))
    crossed = y * np.roll(y, -1) < 0
    with np.errstate(divide="ignore", invalid="ignore"):
        area = np.where(crossed, (a * a + b * b) / (a + b), a + b)
    return float(0.5 * h * area.sum())


# --- The rules ------------------------------------------------------------------------------------------------------

_ZN = "Ziegler & Nichols, Trans. ASME 64 (1942)"
_APC = "Åström & Hägglund, Advanced PID Control (2006), chapter 7"
_TABLES = {"textbook": False, "original": True}


def ziegler_nichols_step(
    process: Process, kind: Kind = "PID", *, table: Literal["textbook", "original"] = "textbook"
) -> Tuning:
    """Ziegler and Nichols' step response method: PI K = 0.9/a, Ti = 3L; PID K = 1.2/a, Ti = 2L, Td = L/2.

    a = Kp·L/T for a stable process, Kv·L for an integrating one.

    Parameters
    ----------
    process : process or model
        L > 0.
    kind : {"PI", "PID"}
    table : {"textbook", "original"}
        Original: Ti = L/0.3 for PI, as in 1942.

    Examples
    --------
    >>> t = ziegler_nichols_step("P2", "PI")
    >>> f"{t.rule}: K {t.controller.k:.2f}, Ti {t.controller.ti:.2f} s, but Ms {t.ms:.1f}"
    'Ziegler-Nichols step (textbook) PI: K 1.85, Ti 4.28 s, but Ms 3.3'
    """
    model, plant = _model(process)
    rule = f"Ziegler-Nichols step ({_table(table)}) {_kind(kind)}"
    a = _tangent(model)
    return _by(rule, _ZN, plant, _glapp.ziegler_nichols_step, a, model.l, kind == "PID", _TABLES[table])


def _tangent(model: Fotd | Integrating) -> float:
    """A, where the steepest tangent meets the vertical axis."""
    if isinstance(model, Integrating):
        return model.kv * model.l
    return model.kp_process * model.l / model.t if model.t > 0 else math.inf


def ziegler_nichols_frequency(
    process: Process, kind: Kind = "PID", *, table: Literal["textbook", "original"] = "textbook"
) -> Tuning:
    """Ziegler and Nichols' frequency response method: PI K = 0.4Ku, Ti = 0.8Tu; PID K = 0.6Ku, Ti = Tu/2, Td = Tu/8.

    Parameters
    ----------
    process : process or model
        With an ultimate gain.
    kind : {"PI", "PID"}
    table : {"textbook", "original"}
        Original: PI K = 0.45Ku, Ti = Tu/1.2, as in 1942.

    Examples
    --------
    >>> t = ziegler_nichols_frequency("P2", "PI")
    >>> round(t.controller.k, 6), round(t.controller.ti / math.pi, 6)
    (1.6, 1.6)
    """
    plant = _plant(process)
    ku, tu = ultimate(plant)
    rule = f"Ziegler-Nichols frequency ({_table(table)}) {_kind(kind)}"
    return _by(rule, _ZN, plant, _glapp.ziegler_nichols_frequency, ku, tu, kind == "PID", _TABLES[table])


def lambda_tuning(process: Process, kind: Kind = "PI", *, lam: float) -> Tuning:
    """Lambda tuning: after the dead time the loop answers a setpoint like a lag λ.

    PI K = T/(Kp(λ + L)), Ti = T; PID K = (T + L/2)/(Kp(λ + L/2)), Ti = T + L/2, Td = TL/(2T + L); an integrating
    process: PI Ti = 2λ + L, K = Ti/(Kv(λ + L)²).

    Parameters
    ----------
    process : process or model
        Stable with T > 0; integrating for PI only.
    kind : {"PI", "PID"}
    lam : float
        λ [s], > 0. T is common, 3T cautious.

    Examples
    --------
    >>> t = lambda_tuning(Fotd(1.0, t=2.0, l=1.0), lam=3.0)
    >>> t.controller
    Ideal(k=0.5, ti=2.0, td=0.0, b=0.0)
    """
    model, plant = _model(process)
    rule, source = f"Lambda (λ = {lam:g} s) {_kind(kind)}", "Dahlin (1968), as internal model control"
    if isinstance(model, Fotd):
        return _by(rule, source, plant, _glapp.lambda_tuning, model.kp_process, model.t, model.l, lam, kind == "PID")
    if kind == "PID":
        raise InputError("Lambda PID is for processes without integrator", parameter="process", hint="take kind='PI'")
    return _by(rule, source, plant, _glapp.lambda_integrating, model.kv, model.l, lam)


def amigo_step(process: Process, kind: Kind = "PID") -> Tuning:
    """AMIGO from the step response: what MIGO with M = 1.4 gives for a large batch of processes, as a formula.

    PI K = (0.15 + (0.35 − LT/(L + T)²)T/L)/Kp, Ti = 0.35L + 13LT²/(T² + 12LT + 7L²);
    PID K = (0.2 + 0.45T/L)/Kp, Ti = L(0.4L + 0.8T)/(L + 0.1T), Td = 0.5LT/(0.3L + T); integrating: PI 0.35/(Kv·L),
    13.4L; PID 0.45/(Kv·L), 8L, 0.5L.

    Parameters
    ----------
    process : process or model
        L > 0.
    kind : {"PI", "PID"}

    Examples
    --------
    >>> [round(x, 3) for x in amigo_step("P2").controller[:3]]
    [1.124, 2.415, 0.622]
    """
    model, plant = _model(process)
    rule = f"AMIGO step {_kind(kind)}"
    if isinstance(model, Integrating):
        return _by(rule, _APC, plant, _glapp.amigo_integrating, model.kv, model.l, kind == "PID")
    return _by(rule, _APC, plant, _glapp.amigo_step, model.kp_process, model.t, model.l, kind == "PID")


def amigo_frequency(process: Process, kind: Kind = "PID") -> Tuning:
    """AMIGO from the ultimate point, κ = 1/(Kp·Ku), 0 for an integrating process.

    PI K = 0.16Ku, Ti = Tu/(1 + 4.5κ); PID K = (0.3 − 0.1κ⁴)Ku, Ti = 0.6Tu/(1 + 2κ), Td = 0.15(1 − κ)Tu/(1 − 0.95κ).

    Parameters
    ----------
    process : process or model
        With an ultimate gain, 0 ≤ κ < 1.
    kind : {"PI", "PID"}

    Examples
    --------
    >>> [round(x, 3) for x in amigo_frequency("P2").controller[:3]]
    [1.198, 2.513, 0.927]
    """
    plant = _plant(process)
    ku, tu = ultimate(plant)
    kappa = 0.0 if plant.gain is None else 1 / (plant.gain * ku) if plant.gain else math.inf
    return _by(f"AMIGO frequency {_kind(kind)}", _APC, plant, _glapp.amigo_frequency, ku, tu, kappa, kind == "PID")


def simc(process: Process, kind: Kind = "PI", *, tau_c: float | None = None) -> Tuning:
    """SIMC: K = T/(Kp(τc + L)), Ti = min(T, 4(τc + L)), and for PID Td = T₂ in series form; given in ideal form.

    Parameters
    ----------
    process : process or model
        A process with real poles is reduced by the half rule; a model is taken as it is, for PI only.
    kind : {"PI", "PID"}
    tau_c : float, optional
        Time constant τc wished for [s], > 0. Where not given, the dead time of the reduced process ("tight" control).

    Examples
    --------
    >>> simc("P2").controller
    Ideal(k=0.3, ti=1.5, td=0.0, b=0.0)
    """
    if isinstance(process, Fotd | Integrating):
        plant = process.plant
        if kind == "PID":
            raise InputError("a model with one lag gives a PI controller", parameter="kind", value=kind, bound="PI")
        gain, l = (process.kp_process if isinstance(process, Fotd) else process.kv), process.l  # noqa: E741
        t, t2 = (process.t if isinstance(process, Fotd) else math.inf), 0.0
    else:
        plant = Plant.of(process)
        gain, t, t2, l = half_rule(plant, _kind(kind))  # noqa: E741
    wished = l if tau_c is None else tau_c
    if tau_c is None and l == 0:
        raise InputError("is required for a process without dead time", parameter="tau_c", bound="> 0 s")
    rule, source = f"SIMC (τc = {wished:g} s) {kind}", "Skogestad, J. Process Control 13 (2003)"
    if math.isinf(t):
        return _by(rule, source, plant, _glapp.simc_integrating, gain, t2, l, wished)
    # The half rule may leave the second lag the longer one.
    return _by(rule, source, plant, _glapp.simc, gain, max(t, t2), min(t, t2), l, wished)


def _by(rule: str, source: str, plant: Plant, closed_form: Callable[..., tuple[float, ...]], *numbers: Any) -> Tuning:
    """Ask the core, and look at what it makes of the loop."""
    try:
        k, ti, td = closed_form(*numbers)
    except ValueError as error:
        raise InputError(f"{rule} is not for this process: {error}", parameter="process") from None
    return assess(plant, (k, ti, td), rule=rule, source=source)


# --- Constrained optimisation ---------------------------------------------------------------------------------------

_Circles = list[tuple[float, float]]
"""Circles (c, r) around −c on the real axis that the Nyquist curve must not enter."""


def migo(
    plant: Process,
    kind: Kind = "PI",
    *,
    m: float | None = None,
    ms: float | None = None,
    mt: float | None = None,
    tf: float = 0.0,
) -> Tuning:
    """M-constrained integral gain optimisation: the greatest ki = K/Ti that keeps the loop robust.

    1/ki is the integral of the error after a load step, so this is the best rejection of loads among controllers that
    do not swing. Robust means that the Nyquist curve stays out of circles with centre −C and radius R:

    ============  =============================================================================
    Ms ≤ ms       C = 1, R = 1/ms
    Mt ≤ mt       C = mt²/(mt² − 1), R = mt/(mt² − 1)
    m: both       C = (2m² − 2m + 1)/(2m(m − 1)), R = (2m − 1)/(2m(m − 1)), around both circles
    ============  =============================================================================

    At each frequency a circle forbids an ellipse of (k, ki); the lower envelope of the ellipses over all frequencies
    is ki(k), and its top the controller. For PID this is repeated over the derivative gain kd, of which the largest
    is taken that leaves that top smooth (∂ki/∂k = 0). Beyond it the top is an edge, touched at two frequencies, where
    ki still grows and the load response begins to swing. Where the top is an edge even without derivative part, kd is
    limited by Td ≤ Ti/4 (real zeros) instead.

    Parameters
    ----------
    plant : process
        Stable, or with one integrator.
    kind : {"PI", "PID"}
    m : float, optional
        One circle for Ms and Mt, > 1. The default, 1.4, where neither `ms` nor `mt` is given.
    ms, mt : float, optional
        Bounds of Ms and Mt, > 1; both may be given.
    tf : float
        Time constant of a second-order measurement filter in the loop [s], ≥ 0, counted in.

    Raises
    ------
    InputError
        For an unstable process, a bound ≤ 1, and where no gain is too much or none robust enough.

    References
    ----------
    Åström, Panagopoulos and Hägglund, *Design of PI controllers based on non-convex optimization*, Automatica 34
    (1998); Åström and Hägglund, *Revisiting the Ziegler-Nichols step response method for PID control*, J. Process
    Control 14 (2004).

    Examples
    --------
    The PI controller of the thesis' P3 (5.2), which has K = 0.48 and Ti = 0.3117:

    >>> t = migo("P3", ms=2.0)
    >>> f"K {t.controller.k:.2f}, Ti {t.controller.ti:.2f} s, Ms {t.ms:.2f}"
    'K 0.48, Ti 0.31 s, Ms 2.00'
    """
    plant = _stable(_plant(plant))
    circles, bound = _circles(m, ms, mt)
    sign = _sign(plant)
    k, ki, kd = _greatest_ki(_filtered(plant, tf) * sign, circles, _kind(kind) == "PID")
    source = "Åström, Panagopoulos & Hägglund, Automatica 34 (1998); Åström & Hägglund, J. Process Control 14 (2004)"
    return assess(plant, (sign * k, k / ki, kd / k), tf=tf, rule=f"MIGO ({bound}) {kind}", source=source)


def design(plant: Process, kind: Kind = "PID", *, ms: float = 1.4, mt: float = 1.4) -> Tuning:
    """Least IAE after a load step subject to Ms and Mt, with the measurement filter of (2.1) counted in.

    The filter goes with the controller, Tf = Td/5, for PI Ti/10, and costs phase, so it must not be added afterwards.
    IAE, and not 1/ki as in `migo`: with a derivative part the greatest ki swings. For every (Ti, Td) the gain is the
    greatest that the constraints allow; the two are found by a simplex search from the MIGO controller.

    Parameters
    ----------
    plant : process
        Stable, or with one integrator.
    kind : {"PI", "PID"}
    ms, mt : float
        Bounds of Ms and Mt, > 1.

    References
    ----------
    Garpinger and Hägglund, *A software tool for robust PID design*, IFAC World Congress 2008, which the thesis calls
    designPID.

    Examples
    --------
    >>> t = design("P2", "PI")
    >>> f"{t.ms:.2f} {t.mt:.2f}, Tf = {t.tf / t.controller.ti:.1f} Ti"
    '1.40 1.00, Tf = 0.1 Ti'
    """
    plant = _stable(_plant(plant))
    circles, bound = _circles(None, ms, mt)
    sign = _sign(plant)
    start = migo(plant, kind, ms=ms, mt=mt).controller
    coarse = _design_frequencies(plant)
    least = [math.inf]  # IAE so far

    def settings(times: Array) -> tuple[float, float, float]:
        """Ti, Td and Tf [s]."""
        ti, td = math.exp(times[0]), math.exp(times[1]) if kind == "PID" else 0.0
        return ti, td, td / 5 if td else ti / 10

    def greatest(times: Array, w: Array) -> tuple[float, float]:
        """The greatest gain that is allowed, and the IAE that it leaves; 0 and inf where none is."""
        ti, td, tf = settings(times)
        unit = open_loop(plant, (sign, ti, td), tf)
        shape = unit.response(w)
        for k in _gains_at_the_limit(shape, circles, unit.integrators):
            if _closed_loop_stable(unit, k * shape):
                nearest = float(w[int(np.argmin(np.abs(1 + k * shape)))])
                # 1/ki is never more than IAE: a controller that is far behind by it needs no closer look.
                return k, ti / k if ti / k > 3 * least[0] else _iae(plant, unit * k, k / ti, nearest)
        return 0.0, math.inf

    def cost(times: Array) -> float:
        iae = min(greatest(times, coarse)[1], 1e300)  # finite, so that the simplex can take differences
        least[0] = min(least[0], iae)
        return iae

    begin = np.log(start[1:3] if kind == "PID" else start[1:2])
    for _ in range(20):  # the filter may have left no gain that is robust at that Ti
        if cost(begin) < 1e300:
            break
        begin[0] += 0.2
    else:
        raise InputError(f"no {kind} controller with its filter meets {bound}", parameter="plant", value=plant)
    best, fine = _simplex(cost, begin), plant.frequencies(per_decade=1000)
    expected, k = greatest(best, coarse)[0], 0.0
    for _ in range(20):  # the best Ti may be the least at which this gain was robust, on the coarse grid
        k = greatest(best, fine)[0]
        if k > 0.9 * expected:
            break
        best[0] += 0.01
    ti, td, tf = settings(best)
    source = "after Garpinger & Hägglund, IFAC World Congress (2008)"
    return assess(plant, (sign * k, ti, td), tf=tf, rule=f"design ({bound}) {kind}", source=source)


def _circles(m: float | None, ms: float | None, mt: float | None) -> tuple[_Circles, str]:
    """Circles of the bounds, and the bounds in words."""
    if m is None and ms is None and mt is None:
        m = 1.4
    if m is not None and (ms is not None or mt is not None):
        raise InputError("bounds Ms and Mt together: give it, or ms and mt", parameter="m", value=m)
    for name, value in (("m", m), ("ms", ms), ("mt", mt)):
        if value is not None and not (math.isfinite(value) and value > 1):
            raise InputError(f"is {value}, must be greater than 1", parameter=name, value=value, bound="> 1")
    circles, words = [], []
    if m is not None:
        circles.append(((2 * m * m - 2 * m + 1) / (2 * m * (m - 1)), (2 * m - 1) / (2 * m * (m - 1))))
        words.append(f"M = {m:g}")
    if ms is not None:
        circles.append((1.0, 1 / ms))
        words.append(f"Ms ≤ {ms:g}")
    if mt is not None:
        circles.append((mt * mt / (mt * mt - 1), mt / (mt * mt - 1)))
        words.append(f"Mt ≤ {mt:g}")
    return circles, ", ".join(words)


def _design_frequencies(plant: Plant) -> Array:
    """Enough frequencies to begin with; what matters is refined later."""
    return plant.frequencies(per_decade=30)


def _greatest_ki(plant: Plant, circles: _Circles, derivative: bool) -> tuple[float, float, float]:
    """k, ki and kd of the best controller for a process of positive gain."""
    w = _design_frequencies(plant)
    envelope = _Envelope(plant, circles, w)
    k_alone = _first_touch(envelope.response, circles)
    if math.isinf(k_alone):
        raise InputError(_ANY_GAIN, parameter="plant", value=plant, hint=_WHY_LIMITED)
    best = envelope.top(0.0, k_alone * np.geomspace(0.003, 1, 90))
    if best is None:
        raise InputError("has no PI controller within these bounds", parameter="plant", value=plant)
    if not derivative:
        return _not_vanishing(best, k_alone, plant).k, best.ki, 0.0
    tops: dict[float, _Top] = {0.0: best}
    near = np.geomspace(0.3, 3, 40)

    def height(kd: float) -> float:
        """The top's ki where it is allowed, below all of these and falling with kd where it is not."""
        if kd not in tops:
            top = envelope.top(kd, near * tops[max(one for one in tops if one < kd)].k)
            if top is None:
                return -kd
            tops[kd] = top
        top = tops[kd]
        allowed = not top.edge if not best.edge else top.k * top.k >= 4 * top.ki * kd
        return top.ki if allowed else -kd

    # From a derivative gain that hardly acts upwards, until ki is past its greatest allowed value.
    steps = [0.0, 0.05 * best.k / best.w]
    while height(steps[-1]) > height(steps[-2]) and len(steps) < 60:
        steps.append(steps[-1] * 1.4)
    _golden(height, steps[max(len(steps) - 3, 0)], steps[-1], 13)
    kd = max(tops, key=height)
    if tops[kd].w > 0.1 * w[-1]:  # nothing of the process limits kd, only the end of the grid
        raise InputError(_ANY_GAIN, parameter="plant", value=plant, hint=_WHY_LIMITED)
    return _not_vanishing(tops[kd], k_alone, plant).k, tops[kd].ki, kd


_ANY_GAIN = "allows any gain under these bounds: there is no best controller"
_WHY_LIMITED = "give its dead time or its fastest lags, which limit the gain of the real process"


def _not_vanishing(top: _Top, k_alone: float, plant: Plant) -> _Top:
    if top.k < 0.0031 * k_alone:  # where the grid of gains begins
        raise InputError(
            "is best under purely integrating control, K → 0, which no PI or PID controller in ideal form can do",
            parameter="plant",
            value=plant,
            bound="K > 0",
        )
    return top


class _Top(NamedTuple):
    """Greatest ki over k for one kd."""

    k: float
    ki: float
    edge: bool
    w: float


class _Envelope:
    """Lower envelope of the ellipses that the circles forbid in the plane of k and ki.

    With P = X + iY, r = |P| and κ = ki/ω − kd·ω, the loop k − iκ times P lies on the circle (c, R) where
    κ = (−c·Y ± √(R²r² − (k·r² + c·X)²))/r².
    """

    def __init__(self, plant: Plant, circles: _Circles, w: Array) -> None:
        self.plant, self.circles, self.w = plant, circles, w
        self.response = plant.response(w)

    def forbidden(self, k: Array, kd: float, w: Array, p: npt.NDArray[np.complex128]) -> tuple[Array, Array]:
        """From which ki up to which, for each k and frequency, circle after circle; inf, −inf where nothing is."""
        x, y, square = p.real, p.imag, p.real**2 + p.imag**2
        low, high = [], []
        for c, r in self.circles:
            inside = k[:, None] * square + c * x
            with np.errstate(invalid="ignore"):
                half = np.sqrt(r * r * square - inside * inside)
            middle, half = w * (-c * y) / square + kd * w * w, w * half / square
            met = ~np.isnan(half)
            low.append(np.where(met, middle - half, math.inf))
            high.append(np.where(met, middle + half, -math.inf))
        return np.hstack(low), np.hstack(high)

    def first(self, k: Array, kd: float) -> Array:
        """Limit of ki, for each k and frequency, that comes first after the lowest robust ki; inf where none does.

        Without derivative part that ki is 0. With it the loop may need some integral action to be robust.
        """
        low, high = self.forbidden(k, kd, self.w, self.response)
        floor = np.zeros(k.size)
        for _ in range(20):
            reached = np.maximum(floor, np.where(low <= floor[:, None], high, 0.0).max(axis=1))
            if np.array_equal(reached, floor):
                break
            floor = reached
        limits = self._least(np.where(low > floor[:, None], low, math.inf))
        # Out of the circles is also where −1 is encircled: there nothing is allowed.
        ki = limits.min(axis=1)
        sure = 0.999 * np.where(np.isfinite(ki), ki, 0.0)
        w = self.w
        turned: Array = np.unwrap(
            np.angle(1 + (k[:, None] + 1j * (kd * w - sure[:, None] / w)) * self.response), axis=1
        )
        quarters = (1 + self.plant.integrators) * math.pi / 2
        stable = np.abs(turned[:, -1] - turned[:, 0] - quarters) < math.pi / 2
        return np.where(np.reshape(np.isfinite(ki) & stable, (-1, 1)), limits, -1.0)

    def near(self, k: Array, kd: float, w: Array, p: npt.NDArray[np.complex128], ki: float) -> Array:
        """The same limit where it is known to be close to `ki`."""
        low, _ = self.forbidden(k, kd, w, p)
        limits = self._least(np.where((low > 0.5 * ki) & (low < 1.3 * ki), low, math.inf))
        # Where another circle forbids what lies just below, the robust stretch has closed.
        below = 0.999 * limits.min(axis=1)[:, None]
        low, high = self.forbidden(k, kd, self.w, self.response)
        limits[((low < below) & (below < high)).any(axis=1)] = -1.0
        return limits

    def _least(self, limits: Array) -> Array:
        """The least over the circles."""
        return np.asarray(limits.reshape(limits.shape[0], len(self.circles), -1).min(axis=1), dtype=np.float64)

    def top(self, kd: float, k: Array) -> _Top | None:
        """The top for one kd among gains k, given on a grid; None where none is robust."""
        w, p = self.w, self.response
        limits = self.first(k, kd)
        for tolerance in (1.15, 1.01):
            i, ki = _highest(limits)
            if ki <= 0:
                return None
            # More k around the best one, and more frequencies between those that limit ki there.
            around = slice(max(i - 2, 0), i + 3)
            active = np.flatnonzero(((limits[around] > 0) & (limits[around] < tolerance * ki)).any(axis=0))
            cells = np.unique(np.clip(np.concatenate([active - 1, active]), 0, w.size - 2))
            if cells.size > 250:  # with dead time the curve comes by again and again
                least = np.where(limits[around] > 0, limits[around], math.inf).min(axis=0)
                cells = cells[np.argsort(np.minimum(least[cells], least[cells + 1]))[:250]]
            share = np.linspace(0, 1, 11)
            w = np.unique(w[cells, None] * (1 - share) + w[cells + 1, None] * share)
            p = self.plant.response(w)
            k = np.linspace(k[around][0], k[around][-1], 33)
            limits = self.near(k, kd, w, p, ki)
        i, ki = _highest(limits)

        def ki_at(at: float) -> float:
            value = float(self.near(np.array([at]), kd, w, p, ki).min())
            return value if math.isfinite(value) else -1.0

        best = _golden(ki_at, k[max(i - 1, 0)], k[min(i + 1, k.size - 1)])
        greatest, where = ki_at(best), float(w[int(np.argmin(self.near(np.array([best]), kd, w, p, ki)[0]))])
        # Around a smooth top ki falls with the square of the distance, from an edge in proportion to it.
        step = 1e-3
        fall = max(1 - ki_at(best * (1 + step)) / greatest, 1 - ki_at(best * (1 - step)) / greatest) / step
        return _Top(best, greatest, fall > _EDGE, where)


def _highest(limits: Array) -> tuple[int, float]:
    """Which k allows the greatest ki, and that; ki ≤ 0 where none does."""
    ki = limits.min(axis=1)
    ki = np.where(np.isfinite(ki), ki, -1.0)
    i = int(np.argmax(ki))
    return i, float(ki[i])


_EDGE = 0.05
"""Relative slope ∂(ln ki)/∂(ln k) beside the top from which on it is an edge."""


def _first_touch(curve: npt.NDArray[np.complex128], circles: _Circles) -> float:
    """Smallest gain at which gain·curve touches a circle; inf where none does."""
    best = math.inf
    for c, r in circles:
        half, square = c * curve.real, np.abs(curve) ** 2
        root = half * half - square * (c * c - r * r)
        with np.errstate(invalid="ignore"):
            gain = (-half - np.sqrt(root)) / square
        best = min(best, float(np.min(gain[(root >= 0) & (gain > 0)], initial=math.inf)))
    return best


def _gains_at_the_limit(shape: npt.NDArray[np.complex128], circles: _Circles, integrators: int) -> list[float]:
    """Gains k, the greatest first, at which k·shape comes to touch a circle from outside as k grows.

    There may be several: far above all robust gains the curve is outside again, around −1; and with two integrators
    in the loop too small a gain is not robust either, so that the first touch is only where the grid begins.
    """
    low, high = [], []
    for c, r in circles:
        half, square = c * shape.real, np.abs(shape) ** 2
        root = half * half - square * (c * c - r * r)
        met = (root > 0) & (half < 0)
        wide = np.sqrt(root[met])
        low.append((-half[met] - wide) / square[met])
        high.append((-half[met] + wide) / square[met])
    lows, highs = np.concatenate(low), np.concatenate(high)
    order = np.argsort(lows)
    begins, reach = lows[order], np.maximum.accumulate(np.append(0.0, highs[order]))[:-1]
    # A sliver between two forbidden stretches is one between two frequencies of the grid.
    tops: list[float] = begins[begins > 1.01 * reach][::-1].tolist()
    return tops[:-1] if integrators > 1 else tops


def _golden(function: Callable[[float], float], low: float, high: float, steps: int = 16) -> float:
    """Where a function with one top is greatest, by golden section."""
    ratio = (math.sqrt(5) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    fa, fb = function(a), function(b)
    for _ in range(steps):
        if fa >= fb:
            high, b, fb = b, a, fa
            a = high - ratio * (high - low)
            fa = function(a)
        else:
            low, a, fa = a, b, fb
            b = low + ratio * (high - low)
            fb = function(b)
    return a if fa >= fb else b


def _simplex(cost: Callable[[Array], float], start: Array) -> Array:
    """Least cost by Nelder and Mead's method."""
    try:
        from scipy.optimize import minimize
    except ImportError:
        raise ImportError("design() needs SciPy: install glapp[tuning]") from None
    begin = np.vstack([start, *(start + 0.2 * np.eye(start.size))])
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": begin, "xatol": 1e-3, "fatol": math.inf, "maxiter": 120},
    )
    return np.asarray(found.x, dtype=np.float64)


# --- Reading arguments ----------------------------------------------------------------------------------------------


def _filtered(plant: Plant, tf: float) -> Plant:
    return plant * Plant([1.0], [tf * tf, 2 * tf, 1.0]) if tf else plant


def _plant(process: Process) -> Plant:
    return process.plant if isinstance(process, Fotd | Integrating) else Plant.of(process)


def _model(process: Process) -> tuple[Fotd | Integrating, Plant]:
    """The model of a process, and the process itself."""
    if isinstance(process, Fotd | Integrating):
        return process, process.plant
    plant = Plant.of(process)
    return (integrating(plant) if plant.integrators == 1 else fotd(plant)), plant


def _stable(plant: Plant) -> Plant:
    if not plant.is_stable:
        raise InputError(
            "must be stable but for one integrator", parameter="plant", value=plant, bound="stable, or one integrator"
        )
    return plant


def _sign(plant: Plant) -> float:
    """Sign of the static or velocity gain."""
    lowest = plant.gain if plant.gain is not None else plant.velocity_gain
    if not lowest:
        raise InputError(
            "has a static gain of 0, no integral action can control it", parameter="plant", value=plant, bound="≠ 0"
        )
    return math.copysign(1.0, lowest)


def _ideal(controller: Sequence[float]) -> Ideal:
    if not 2 <= len(controller) <= 4:
        raise InputError("write (k, ti), (k, ti, td) or (k, ti, td, b)", parameter="controller", value=controller)
    ideal = Ideal(*(float(x) for x in [*controller, 0.0, 0.0][:4]))
    for name, good, bound in (
        ("k", ideal.k != 0, "other than 0"),
        ("ti", ideal.ti > 0, "greater than 0 s"),
        ("td", ideal.td >= 0, "0 s or greater"),
    ):
        value = getattr(ideal, name)
        if not (good and math.isfinite(value)):
            raise InputError(f"is {value:g}, must be {bound}", parameter=name, value=value, bound=bound)
    return ideal


def _kind(kind: Kind) -> Kind:
    if kind not in ("PI", "PID"):
        raise InputError(f"is {kind!r}, must be 'PI' or 'PID'", parameter="kind", value=kind, bound="'PI' or 'PID'")
    return kind


def _table(table: str) -> str:
    if table not in _TABLES:
        bound = "'textbook' or 'original'"
        raise InputError(f"is {table!r}, must be {bound}", parameter="table", value=table, bound=bound)
    return table
