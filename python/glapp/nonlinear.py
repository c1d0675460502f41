"""Describing functions: whether a gap makes a loop oscillate, how fast and how far (thesis 1.1, 1.2, 2.2, 7.4).

A loop is given by its linear part L(s) = P(s)·C(s)·F(s) as a `Plant`; `glapp.tuning.open_loop` makes it, and
`Tuning.loop` is one. The gap is between the controller and the process: its input is the controller's output OP,
so every amplitude A here is one of OP.

The method is an approximation: only the first harmonic of a signal is followed round the loop. What it misses is shown
in docs/nonlinear.md against simulation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .checked import check_number, numbers_of
from .errors import InputError
from .plant import Plant
from .tuning import Tuning, open_loop
from .tuning.process import Process

if TYPE_CHECKING:
    import plotly.graph_objects as go

__all__ = [
    "Criterion",
    "LimitCycle",
    "PhaseLead",
    "backlash_cycles",
    "backlash_margin",
    "circle_criterion",
    "describing_function",
    "n_backlash",
    "n_relay",
    "negative_inverse",
    "nyquist_figure",
    "over_compensation",
    "phase_lead",
    "relay_cycles",
    "small_gain",
]

Array = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]


# --- Describing functions -------------------------------------------------------------------------------------------


def n_backlash(a: npt.ArrayLike, d: float) -> ComplexArray:
    """Describing function of a gap (thesis 1.2).

    With x = 1 − d/A::

        N(A) = (1/π)·(π/2 + arcsin x + x·√(1 − x²)) − (i/π)·(1 − x²)

    N depends on d/A alone; N → 1 for A → ∞.

    Parameters
    ----------
    a : array_like of float
        Amplitude A of the sine at the input, > d/2: below that the output rests. Any shape.
    d : float
        Total width of the gap [unit of a], ≥ 0.

    Returns
    -------
    complex128
        N(A), in the shape of `a`.

    Raises
    ------
    InputError
        For an amplitude that does not traverse the gap.

    Examples
    --------
    >>> complex(n_backlash(1.0, 1.0).round(4))
    (0.5-0.3183j)
    >>> n_backlash([0.4, 1.0], 1.0)
    Traceback (most recent call last):
    glapp.errors.InputError: a: is 0.4, must be greater than d/2 = 0.5
    """
    d = _at_least_zero("d", d)
    a = numbers_of(a, "a", f"greater than d/2 = {d / 2:g}", lambda x: x > d / 2)
    return _n_of_x(1 - d / a)


def _n_of_x(x: npt.ArrayLike) -> ComplexArray:
    """Describing function of the gap as a function of x = 1 − d/A."""
    x = np.asarray(x, dtype=np.float64)
    rest = 1 - x * x
    return np.asarray((math.pi / 2 + np.arcsin(x) + x * np.sqrt(rest)) / math.pi - 1j * rest / math.pi)


def n_relay(a: npt.ArrayLike, level: float) -> ComplexArray:
    """Describing function of an ideal relay, N(A) = 4·level/(π·A) (thesis 7.4).

    Parameters
    ----------
    a : array_like of float
        Amplitude A of the sine at the input, > 0. Any shape.
    level : float
        The output is ± level, ≥ 0.

    Returns
    -------
    complex128
        N(A), in the shape of `a`.

    Examples
    --------
    >>> complex(n_relay(4.0, math.pi))
    (1+0j)
    """
    return np.asarray(4 * _at_least_zero("level", level) / (math.pi * _amplitudes(a)) + 0j)


def _amplitudes(a: npt.ArrayLike) -> Array:
    """Amplitudes of a sine, checked to be greater than 0."""
    return numbers_of(a, "a", "greater than 0", lambda x: x > 0)


def negative_inverse(n: npt.ArrayLike) -> ComplexArray:
    """−1/N, the curve that L(iω) meets where a limit cycle is predicted.

    Parameters
    ----------
    n : array_like of complex
        N(A), ≠ 0. Any shape.

    Returns
    -------
    complex128
        −1/N, in the shape of `n`.

    Examples
    --------
    >>> complex(negative_inverse(n_backlash(1.0, 1.0)).round(4))
    (-1.4232-0.906j)
    """
    bound = "other than 0: an element that gives nothing has no −1/N"
    return np.asarray(-1 / numbers_of(n, "n", bound, lambda x: x != 0, np.complex128))


def describing_function(
    element: Callable[[], Callable[[float], float]], a: npt.ArrayLike, samples: int = 4096
) -> ComplexArray:
    """Describing function of any element, by sending a sine through it.

    A sin θ in, y(θ) out, after one period to settle: N = (1/πA)·∮ y·(sin θ + i·cos θ) dθ.

    Parameters
    ----------
    element : callable
        Gives a fresh element: a function from one input to one output. Each amplitude gets its own, so that the memory
        of one amplitude is never seen by the next.
    a : array_like of float
        Amplitudes, > 0. Any shape.
    samples : int
        Samples a period, 8..10⁸. The error falls with its square for a continuous element.

    Returns
    -------
    complex128
        N(A), in the shape of `a`.

    Examples
    --------
    >>> from glapp.blocks import Backlash
    >>> complex(describing_function(lambda: Backlash(1.0).update, 1.0).round(4))
    (0.5-0.3183j)
    """
    samples = int(check_number(samples, "samples", lambda x: 8 <= x <= 1e8, "8 to 100 000 000"))
    if not callable(element):
        bound = "a function that makes one: lambda: Backlash(1.0).update"
        raise InputError(f"is {element!r}, must be {bound}", parameter="element", value=element, bound=bound)
    theta = 2 * math.pi * np.arange(samples) / samples
    a = _amplitudes(a)
    n = np.empty(a.shape, dtype=np.complex128)
    for i, one in np.ndenumerate(a):
        update = element()
        sine = (one * np.sin(theta)).tolist()
        for x in sine:
            update(x)
        y = np.array([update(x) for x in sine])
        n[i] = 2 * np.mean(y * (np.sin(theta) + 1j * np.cos(theta))) / one
    return n


# --- Criteria that exclude limit cycles -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Criterion:
    """Answer of a criterion for stability that is sufficient, not necessary.

    Attributes
    ----------
    holds : bool
        True: the loop with a gap of any width comes to rest. False: nothing is known.
    margin : float
        Factor that the loop gain may grow by before the criterion no longer holds; below 1 where it does not hold,
        inf where no gain is too much, 0 where none is small enough.
    w : float
        Frequency that decides [rad/s].
    """

    holds: bool
    margin: float
    w: float


def small_gain(loop: Process) -> Criterion:
    """Small gain theorem (1.1): a gap passes velocities with a gain ≤ 1, so |L(iω)| < 1 for all ω is enough.

    A loop with integral action never meets it.

    Parameters
    ----------
    loop : Plant
        Open loop, stable but for integrators.

    Examples
    --------
    >>> small_gain(Plant([0.5], [1, 1]))
    Criterion(holds=True, margin=2.0, w=0.0)
    """
    loop = _checked(loop)
    if loop.integrators > 0:
        return Criterion(False, 0.0, 0.0)
    return _criterion(loop, lambda value: -np.abs(value))


def circle_criterion(loop: Process) -> Criterion:
    """Circle criterion (1.1): Re L(iω) > −1 for all ω is enough.

    Never met with two integrators in the loop, as with a PI controller on an integrating process.

    Parameters
    ----------
    loop : Plant
        Open loop, stable but for integrators.

    Examples
    --------
    >>> from glapp.tuning import migo
    >>> c = circle_criterion(migo("P2").loop)
    >>> c.holds, round(c.margin, 1)
    (True, 3.2)
    """
    loop = _checked(loop)
    if loop.integrators > 1:
        return Criterion(False, 0.0, 0.0)
    return _criterion(loop, lambda value: value.real)


def _criterion(loop: Plant, height: Callable[[ComplexArray], Array]) -> Criterion:
    """Result of a criterion by the lowest height over all frequencies, which must stay above −1."""
    w = loop.frequencies()
    if loop.integrators <= 0:
        w = np.append(0.0, w)
    heights = height(loop.response(w))
    i = int(np.argmin(heights))
    low, high = w[max(i - 1, 0)], w[min(i + 1, w.size - 1)]
    lowest, at = float(heights[i]), float(w[i])
    for _ in range(5):
        grid = np.linspace(low, high, 33)
        fine = height(loop.response(grid[grid > 0]))
        j = int(np.argmin(fine))
        if fine[j] < lowest:
            lowest, at = float(fine[j]), float(grid[grid > 0][j])
        low, high = grid[grid > 0][max(j - 1, 0)], grid[min(j + 1 + (grid[0] == 0), 32)]
    return Criterion(lowest > -1, -1 / lowest if lowest < 0 else math.inf, at)


# --- Limit cycles ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """A predicted oscillation.

    Attributes
    ----------
    w : float
        Frequency [rad/s].
    amplitude : float
        Amplitude at the input of the nonlinear element: half of what OP swings.
    stable : bool
        Whether the oscillation draws its neighbours in; else it is a border, beyond which they grow.
    """

    w: float
    amplitude: float
    stable: bool

    @property
    def period(self) -> float:
        """Period [s]."""
        return 2 * math.pi / self.w


def backlash_cycles(loop: Process, d: float) -> list[LimitCycle]:
    """All limit cycles predicted for a gap: L(iω) = −1/N(A) (thesis 1.2).

    Solved as N(x) = −1/L(iω) over x = 1 − d/A, where d does not occur: frequencies do not depend on it, and amplitudes
    are proportional to it.

    Parameters
    ----------
    loop : Plant
        Open loop, stable but for integrators; its closed loop without the gap is to be stable.
    d : float
        Total width of the gap, > 0.

    Returns
    -------
    list of LimitCycle
        By ascending frequency; empty where none is predicted. An intersection that only touches is not seen.

    Notes
    -----
    Stability: 1 + N(A)·L(s) = 0 gives ds/dA = −N′·L/(N·L′) at the solution; where its real part is negative, a
    larger amplitude decays.

    Examples
    --------
    >>> from glapp.tuning import migo
    >>> for cycle in backlash_cycles(migo("P1", ms=2.0).loop, d=1.0):
    ...     print(f"{cycle.w:.2f} rad/s, A = {cycle.amplitude:.2f}, stable: {cycle.stable}")
    0.45 rad/s, A = 0.90, stable: True
    >>> backlash_cycles(migo("P2").loop, d=1.0)
    []
    """
    loop = _checked(loop)
    d = check_number(d, "d", lambda x: x > 0, "greater than 0")

    def target(w: npt.ArrayLike) -> ComplexArray:
        return np.asarray(-1 / loop.response(w))

    w = loop.frequencies(per_decade=200)
    w = w[np.abs(loop.response(w)) >= 0.99]  # |N| ≤ 1
    if w.size < 2:
        return []
    # Im N = −(1 − x²)/π gives x up to its sign; where x passes 0 one sign goes over into the other.
    edge = target(w).imag + 1 / math.pi
    borders = [_bisect(lambda x: float(target(x).imag) + 1 / math.pi, w[i], w[i + 1]) for i in _changes(edge)]
    w = np.unique(np.concatenate([w, borders]))
    z = target(w)
    square = np.where(np.isin(w, borders), 0.0, 1 + math.pi * z.imag)
    possible = (square >= 0) & (square <= 1)
    cycles = []
    for sign in (1.0, -1.0):

        def mismatch(x_w: npt.ArrayLike, sign: float = sign) -> Array:
            at = target(x_w)
            x = sign * np.sqrt(np.clip(1 + math.pi * at.imag, 0, 1))
            return np.asarray(at.real - _n_of_x(x).real)

        gap = mismatch(w)
        for i in _changes(gap):
            if possible[i] and possible[i + 1]:
                at = _bisect(lambda x: float(mismatch(x)), w[i], w[i + 1])
                x = sign * math.sqrt(min(max(1 + math.pi * float(target(at).imag), 0.0), 1.0))
                if x < 1:
                    slope = (2 * math.sqrt(1 - x * x) + 2j * x) / math.pi * (1 - x) ** 2 / d  # dN/dx·dx/dA
                    cycles.append(LimitCycle(at, d / (1 - x), _attracts(loop, at, complex(_n_of_x(x)), slope)))
    return sorted(cycles, key=lambda cycle: cycle.w)


def relay_cycles(loop: Process, level: float) -> list[LimitCycle]:
    """All limit cycles predicted for an ideal relay of ± level in the loop: where L(iω) meets the negative real axis.

    Parameters
    ----------
    loop : Plant
        What the relay drives, stable but for integrators. Its feedback is negative: of a process with Kp < 0 take
        −1 times the process, as a controller with K < 0 does.
    level : float
        > 0.

    Returns
    -------
    list of LimitCycle
        By ascending frequency. A dead time makes L(iω) cross the axis again and again, ever nearer to 0: of these the
        first dozen or more are given.

    Notes
    -----
    Stability: as for `backlash_cycles`, and no crossing further out is left over. The relay, frozen at N(A), is a gain
    with which each of these is a pair of growing roots. So the fast cycles of a process with dead time do not last:
    the loop goes over into the slow one.

    Examples
    --------
    >>> from glapp.plant import PLANTS
    >>> [cycle] = relay_cycles(PLANTS["P2"], level=1.0)  # Ku = 4, Tu = 2π
    >>> round(cycle.w, 6), round(cycle.amplitude * math.pi, 6), cycle.stable
    (1.0, 1.0, True)
    >>> [f"{cycle.period:.1f} s, {cycle.stable}" for cycle in relay_cycles(PLANTS["P4"], level=1.0)[:3]]
    ['11.0 s, True', '3.1 s, False', '1.8 s, False']
    """
    loop = _checked(loop)
    level = check_number(level, "level", lambda x: x > 0, "greater than 0")
    w = loop.frequencies(per_decade=200)
    # Where dead time turns L further from one frequency to the next, a change of sign may stand for many crossings.
    w = w[: 1 + int(np.argmax(np.append(loop.dead_time * np.diff(w), math.inf) > 1.0))]
    value = loop.response(w)
    crossed = []  # frequency, L there, +1 where it enters the second quadrant and −1 where it leaves it
    for i in _changes(value.imag):
        at = _bisect(lambda x: float(loop.response(x).imag), w[i], w[i + 1])
        if (real := float(loop.response(at).real)) < 0:
            crossed.append((at, real, 1 if value[i + 1].imag > value[i].imag else -1))
    # Two integrators whose phase is below −180° come in over the axis, from infinitely far.
    before = int(value[0].real < 0 < value[0].imag)
    cycles = []
    for at, real, _ in crossed:
        a = -4 * level / math.pi * real
        n = 4 * level / (math.pi * a)
        further = before + sum(way for _, other, way in crossed if other < real)
        cycles.append(LimitCycle(at, a, further == 0 and _attracts(loop, at, n, -n / a)))
    return cycles


def _attracts(loop: Plant, w: float, n: complex, slope: complex) -> bool:
    """Whether Re ds/dA < 0; slope = dN/dA."""
    step = 1e-5 * w
    derivative = (loop.response(w + step) - loop.response(w - step)) / (2j * step)
    return bool((-slope * loop.response(w) / (n * derivative)).real < 0)


def over_compensation(plant: Process, compensation: float, d: float, *, tf: float = 0.0) -> list[LimitCycle]:
    """Limit cycles of a loop whose compensation is wider than its gap (thesis 7.4).

    The feed forward ± compensation/2 by the sign of the error and of K, followed by the gap, is a relay of
    (compensation − d)/2. K has the sign of the process gain. As in the thesis the controller is left out: the relay is
    taken to dominate.

    Parameters
    ----------
    plant : process
        What `Plant.of` accepts.
    compensation, d : float
        Width that is compensated for, and total width of the gap, ≥ 0.
    tf : float
        Time constant of the filter before the error [s], ≥ 0.

    Returns
    -------
    list of LimitCycle
        Amplitudes of the filtered process value. Empty where compensation ≤ d.

    Examples
    --------
    >>> over_compensation("P2", compensation=0.05, d=0.06)
    []
    >>> [cycle] = over_compensation("P2", compensation=0.07, d=0.05)
    >>> f"period {cycle.period:.2f} s, amplitude {cycle.amplitude:.5f}"
    'period 6.28 s, amplitude 0.00318'
    """
    level = (_at_least_zero("compensation", compensation) - _at_least_zero("d", d)) / 2
    plant = Plant.of(plant)
    tf = _at_least_zero("tf", tf)
    if level <= 0:
        return []
    return relay_cycles(plant.sign * plant * Plant([1.0], [tf * tf, 2 * tf, 1.0]), level)


# --- Keeping clear of the curve -------------------------------------------------------------------------------------


def backlash_margin(loop: Process) -> tuple[float, float]:
    """Factor that the loop gain may grow by before L(iω) meets −1/N(A) of a gap, and the frequency where it does.

    Along every direction between −90° and −180° the distance of −1/N from 0 is compared with that of L. At −180° that
    is the gain margin, so it never exceeds that; and it is never below the margin of `circle_criterion`, which keeps
    clear of the whole half plane.

    Parameters
    ----------
    loop : Plant
        Open loop, stable but for integrators.

    Returns
    -------
    (margin, w)
        Below 1 where a limit cycle is predicted, 0 with two integrators, inf where the phase never reaches −90°;
        [rad/s].

    Examples
    --------
    >>> from glapp.tuning import migo
    >>> t = migo("P2")
    >>> margin, w = backlash_margin(t.loop)
    >>> f"{circle_criterion(t.loop).margin:.1f} < {margin:.1f} < {t.gain_margin:.1f}"
    '3.2 < 4.6 < 5.3'
    """
    loop = _checked(loop)
    if loop.integrators > 1:
        return 0.0, 0.0
    w = loop.frequencies(per_decade=200)
    room = _room(loop, w)
    if np.isinf(room).all():
        return math.inf, float(w[-1])
    near = np.flatnonzero(room < 1.1 * room.min())
    fine = np.unique(np.linspace(w[np.maximum(near - 1, 0)], w[np.minimum(near + 1, w.size - 1)], 101))
    room = _room(loop, fine)
    i = int(np.argmin(room))
    return float(room[i]), float(fine[i])


_X = np.concatenate([-1 + np.geomspace(1e-12, 1, 1500), 1 - np.geomspace(1, 1e-12, 1500)[1:]])
_SIZE = np.abs(_n_of_x(_X))
_ANGLE = np.angle(_n_of_x(_X))


def _room(loop: Plant, w: Array) -> Array:
    """Distance of L from −1/N as a ratio, |−1/N|/|L|, in L's direction; inf where −1/N has no such direction."""
    value = loop.response(w)
    # arg N rises with x from −90° to 0; arg(−1/N) = −180° − arg N.
    angle = np.angle(-1 / value)
    size = np.interp(angle, _ANGLE, _SIZE)
    with np.errstate(divide="ignore"):
        return np.where((angle > -math.pi / 2) & (angle <= 0), 1 / (size * np.abs(value)), math.inf)


@dataclass(frozen=True, slots=True)
class PhaseLead:
    """Phase-lead compensator (1 + s·lead)/(1 + s·lag), static gain 1.

    Attributes
    ----------
    lead, lag : float
        Time constants [s], lead ≥ lag; lead/lag is what high-frequency noise is amplified by.
    margin, w : float
        `backlash_margin` with it, and where [rad/s].
    loop : Plant
        The open loop with it.
    """

    lead: float
    lag: float
    margin: float
    w: float
    loop: Plant


def phase_lead(loop: Process, margin: float) -> PhaseLead:
    """Phase-lead compensator with the least ratio lead/lag that keeps L(iω) clear of −1/N(A) (thesis 2.2).

    Static gain 1, so integral gain and accuracy stay; where the loop keeps clear already, lead = lag.

    Parameters
    ----------
    loop : Plant
        Open loop, stable but for one integrator.
    margin : float
        `backlash_margin` wished for, > 1.

    Raises
    ------
    InputError
        With two integrators in the loop, for which none exists: towards ω = 0 the curve comes in at −180°, the curve
        −1/N at −90°, and no lead of finite gain parts them. Also where a ratio of 20 is not enough.

    Examples
    --------
    P1 behind a slow valve under a proportional controller of 80 % of the ultimate gain:

    >>> from glapp.plant import PLANTS
    >>> loop = 1.6 * PLANTS["P1"] * Plant([1], [0.5, 1])
    >>> [cycle.stable for cycle in backlash_cycles(loop, d=1.0)]
    [False, True]
    >>> c = phase_lead(loop, margin=1.5)
    >>> f"({c.lead:.2f} s + 1)/({c.lag:.2f} s + 1), {c.margin:.2f}", backlash_cycles(c.loop, d=1.0)
    ('(0.75 s + 1)/(0.18 s + 1), 1.50', [])
    """
    loop = _checked(loop)
    margin = check_number(margin, "margin", lambda x: x > 1, "greater than 1")
    if loop.integrators > 1:
        raise InputError(
            "has two integrators: no phase lead removes its limit cycle",
            parameter="loop",
            value=loop,
            bound="one integrator at most",
            hint="close the gap, or take the integral action out",
        )
    if backlash_margin(loop)[0] >= margin:
        return PhaseLead(1.0, 1.0, *backlash_margin(loop), loop)
    w = loop.frequencies(per_decade=60)
    # Lead is needed near |L| = 1.
    middle = float(w[int(np.argmin(np.abs(np.log(np.abs(loop.response(w))))))])
    centres = middle * np.geomspace(0.1, 10, 81)

    def compensated(ratio: float, centre: float) -> tuple[Plant, float, float]:
        lead, lag = math.sqrt(ratio) / centre, 1 / (math.sqrt(ratio) * centre)
        return loop * Plant([lead, 1.0], [lag, 1.0]), lead, lag

    def best(ratio: float) -> tuple[float, float]:
        """Greatest margin over where the lead is put, and the centre."""
        margins = [float(_room(compensated(ratio, c)[0], w).min()) for c in centres]
        i = int(np.argmax(margins))
        return margins[i], float(centres[i])

    low, high = 1.0, _GREATEST_RATIO
    if best(high)[0] < margin:
        raise InputError(
            f"is {margin:g}, more than a lead/lag of {_GREATEST_RATIO:g} gives ({best(high)[0]:.2f})",
            parameter="margin",
            value=margin,
            bound=f"≤ {best(high)[0]:.2f}",
        )
    for _ in range(24):
        ratio = math.sqrt(low * high)
        low, high = (low, ratio) if best(ratio)[0] >= 1.001 * margin else (ratio, high)
    with_it, lead, lag = compensated(high, best(high)[1])
    return PhaseLead(lead, lag, *backlash_margin(with_it), with_it)


_GREATEST_RATIO = 20.0


# --- Pictures -------------------------------------------------------------------------------------------------------


def nyquist_figure(
    loops: Mapping[str, Any] | Sequence[Any] | Any,
    *,
    backlash: bool = True,
    relay: bool = False,
    criteria: bool = False,
    window: float = 3.0,
) -> go.Figure:
    """Nyquist plot in the thesis' manner (figures 1.3, 1.5, 1.6 and 2.2; the relay of section 7.4).

    Parameters
    ----------
    loops : open loop, sequence of them, or mapping of name to open loop
        Each a `Plant`, a `glapp.tuning.Tuning`, or a linear system of python-control or `scipy.signal`.
    backlash, relay : bool
        Draw −1/N(A) of a gap, of a relay; predicted limit cycles of a gap are marked.
    criteria : bool
        Shade where the small gain theorem and the circle criterion allow the curve to be (figure 1.3).
    window : float
        The axes reach from −window to window/3, > 0.

    Returns
    -------
    plotly.graph_objects.Figure
        The picture: `.show()` opens it.

    Examples
    --------
    >>> from glapp.tuning import migo
    >>> figure = nyquist_figure({"P1": migo("P1").loop, "P2": migo("P2").loop})
    >>> [trace.name for trace in figure.data]
    ['P1', 'P2', '−1/N(A) of a gap', 'limit cycle', '−1']
    """
    import plotly.graph_objects as go

    from . import palette as paper

    window = check_number(window, "window", lambda x: x > 0, "greater than 0")
    named = _named(loops)
    figure = go.Figure()
    if criteria:
        figure.add_shape(
            type="rect", x0=-1, x1=window, y0=-window, y1=window, fillcolor=paper.GRID, line_width=0, layer="below"
        )
        figure.add_shape(type="circle", x0=-1, x1=1, y0=-1, y1=1, fillcolor=paper.RAW, line_width=0, layer="below")
    colours = (paper.SIGNAL, paper.POSITION, paper.POINT, paper.OUTPUT)
    met: list[complex] = []
    for i, (name, loop) in enumerate(named.items()):
        loop = _checked(loop)
        w = loop.frequencies(per_decade=200)
        value = loop.response(w)
        seen = np.abs(value) < 4 * window
        figure.add_scatter(
            x=value.real[seen],
            y=value.imag[seen],
            customdata=w[seen],
            name=name,
            mode="lines",
            line={"color": colours[i % len(colours)], "width": 2},
            hovertemplate="%{x:.3f} %{y:+.3f}i at ω = %{customdata:.3g} rad/s",
        )
        met += [complex(loop.response(cycle.w)) for cycle in backlash_cycles(loop, 1.0)] if backlash else []
    dashed = {"color": paper.INK, "width": 1.5, "dash": "dash"}
    if backlash:
        _draw_backlash(figure, met, dashed)
    if relay:
        figure.add_scatter(x=[-4 * window, 0], y=[0, 0], name="−1/N(A) of a relay", mode="lines", line=dashed)
    figure.add_scatter(x=[-1], y=[0], name="−1", mode="markers", marker={"color": paper.INK, "symbol": "x", "size": 8})
    figure.update_layout(
        template="plotly_white",
        font={"family": paper.FONT, "color": paper.INK},
        width=640,
        height=560,
        margin={"l": 60, "r": 20, "t": 30, "b": 50},
        legend={"orientation": "h", "y": 1.08},
    )
    figure.update_xaxes(
        title="Re L(iω)", range=[-window, window / 3], zeroline=True, zerolinecolor=paper.MUTED, constrain="domain"
    )
    figure.update_yaxes(
        title="Im L(iω)", range=[-window, window / 3], scaleanchor="x", zeroline=True, zerolinecolor=paper.MUTED
    )
    return figure


def _draw_backlash(figure: go.Figure, met: Sequence[complex], line: Mapping[str, Any]) -> None:
    """Draw −1/N(A) of a gap, and the limit cycles where loops meet it."""
    from . import palette as paper

    x = np.linspace(-0.999, 1, 800)
    curve = negative_inverse(_n_of_x(x))
    figure.add_scatter(
        x=curve.real,
        y=curve.imag,
        customdata=1 / (1 - np.minimum(x, 1 - 1e-9)),
        name="−1/N(A) of a gap",
        mode="lines",
        line=line,
        hovertemplate="A = %{customdata:.3f} d",
    )
    if met:
        at = np.array(met)
        marker = {"color": paper.TOO_WIDE, "size": 10, "symbol": "circle-open", "line": {"width": 2}}
        figure.add_scatter(x=at.real, y=at.imag, name="limit cycle", mode="markers", marker=marker)


# --- Reading arguments ----------------------------------------------------------------------------------------------


def _named(loops: Any) -> dict[str, Any]:
    """Loops by the names that a legend shows."""
    if isinstance(loops, Mapping):
        named = dict(loops)
    elif isinstance(loops, list | tuple) and len(loops) != 1:
        named = {f"L{i}(iω)": loop for i, loop in enumerate(loops, start=1)}
    else:
        named = {"L(iω)": loops[0] if isinstance(loops, list | tuple) else loops}
    if not named:
        raise InputError("is empty, give one loop or more", parameter="loops", value=loops, bound="one loop or more")
    return named


def _checked(loop: Any) -> Plant:
    """The open loop, of whatever defines one."""
    try:
        plant = loop.loop if isinstance(loop, Tuning) else Plant.of(loop)
    except InputError as error:
        hint = f"make it with glapp.tuning.{open_loop.__name__}(plant, controller)"
        raise InputError(error.what, parameter="loop", value=loop, hint=hint) from None
    if np.any(plant.poles.real[plant.poles != 0] >= 0):
        raise InputError("has poles in the right half plane", parameter="loop", value=loop, bound="stable")
    if plant.integrators > 0 and plant.sign < 0:
        raise InputError(
            "integrates with a negative gain, which is positive feedback: no closed loop of it is stable",
            parameter="loop",
            value=loop,
            bound="gain > 0",
            hint="K and the gain of the process need the same sign",
        )
    return plant


def _at_least_zero(name: str, value: float) -> float:
    """A parameter, checked to be 0 or greater."""
    return check_number(value, name, lambda x: x >= 0, "0 or greater")


def _changes(values: Array) -> list[int]:
    """Indices at which a value and the next have different signs."""
    return np.flatnonzero(np.signbit(values[:-1]) != np.signbit(values[1:])).tolist()


def _bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """Zero of a function between two places of opposite sign."""
    below = math.copysign(1, function(low)) < 0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if (math.copysign(1, function(middle)) < 0) == below:
            low = middle
        else:
            high = middle
    return float(0.5 * (low + high))
