"""MIGO: the greatest integral gain under bounds on the robustness."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..checked import check_number
from ..errors import InputError
from ..plant import Plant
from .assess import Tuning, assess
from .circles import Circles, circles_of, coarse_frequencies, first_touch
from .process import Array, Kind, Process, kind_of, sign_of, stable


def migo(
    plant: Process,
    kind: Kind = "PI",
    *,
    m: float | None = None,
    ms: float | None = None,
    mt: float | None = None,
    tf: float = 0.0,
    Ms: float | None = None,  # noqa: N803 (as it is written)
    Mt: float | None = None,  # noqa: N803
) -> Tuning:
    """M-constrained integral gain optimisation: the greatest ki = K/Ti that keeps the loop robust.

    1/ki is the integral of the error after a load step, so this is the best rejection of loads among controllers that
    do not swing. Robust means that the Nyquist curve stays out of circles with centre −C and radius R:

    | bound | C | R |
    |---|---|---|
    | Ms ≤ ms | 1 | 1/ms |
    | Mt ≤ mt | mt²/(mt² − 1) | mt/(mt² − 1) |
    | m: both, a circle around both circles | (2m² − 2m + 1)/(2m(m − 1)) | (2m − 1)/(2m(m − 1)) |

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
    Ms, Mt : float, optional
        The same, as books write them.
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
    for name, small, large in (("ms", ms, Ms), ("mt", mt, Mt)):
        if small is not None and large is not None:
            raise InputError("is given twice", parameter=name, value=large)
    ms, mt = Ms if ms is None else ms, Mt if mt is None else mt
    plant = stable(Plant.of(plant))
    circles, bound = circles_of(m, ms, mt)
    sign, tf = sign_of(plant), check_number(tf, "tf", lambda x: x >= 0, "0 s or greater")
    k, ki, kd = _greatest_ki(_filtered(plant, tf) * sign, circles, kind_of(kind) == "PID")
    source = "Åström, Panagopoulos & Hägglund, Automatica 34 (1998); Åström & Hägglund, J. Process Control 14 (2004)"
    return assess(plant, (sign * k, k / ki, kd / k), tf=tf, rule=f"MIGO ({bound}) {kind}", source=source)


def _filtered(plant: Plant, tf: float) -> Plant:
    """The process with the controller's filter."""
    return plant * Plant([1.0], [tf * tf, 2 * tf, 1.0]) if tf else plant


def _greatest_ki(plant: Plant, circles: Circles, derivative: bool) -> tuple[float, float, float]:
    """Gains k, ki, kd with the greatest ki within the circles, for a process of positive gain."""
    w = coarse_frequencies(plant)
    envelope = _Envelope(plant, circles, w)
    k_alone = first_touch(envelope.response, circles)
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
            top = envelope.top(kd, near * tops[max(smaller for smaller in tops if smaller < kd)].k)
            if top is None:
                return -kd
            tops[kd] = top
        top = tops[kd]
        allowed = not top.edge if not best.edge else top.k * top.k >= 4 * top.ki * kd
        return top.ki if allowed else -kd

    # Begin at a derivative gain that hardly acts, upwards until ki is past its greatest allowed value.
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
    """The design, refused where its gain vanishes."""
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

    def __init__(self, plant: Plant, circles: Circles, w: Array) -> None:
        self.plant, self.circles, self.w = plant, circles, w
        self.response = plant.response(w)

    def forbidden(self, k: Array, kd: float, w: Array, p: npt.NDArray[np.complex128]) -> tuple[Array, Array]:
        """Forbidden interval of ki for each k and frequency, circle after circle; inf, −inf where there is none."""
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
        """The limits where they are known to be close to `ki`."""
        low, _ = self.forbidden(k, kd, w, p)
        limits = self._least(np.where((low > 0.5 * ki) & (low < 1.3 * ki), low, math.inf))
        # The robust stretch has closed where another circle forbids the part just below.
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
    """Gain with the greatest allowed ki, and that ki; ki ≤ 0 where none is allowed."""
    ki = limits.min(axis=1)
    ki = np.where(np.isfinite(ki), ki, -1.0)
    i = int(np.argmax(ki))
    return i, float(ki[i])


_EDGE = 0.05
"""Relative slope ∂(ln ki)/∂(ln k) next to the top from which on it is an edge."""


def _golden(function: Callable[[float], float], low: float, high: float, steps: int = 16) -> float:
    """Place of the maximum of a function with one top, by golden section."""
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
