"""Assessment of a controller in a loop: robustness and load rejection, dead time exact."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..checked import check_number
from ..controller import Controller, Ideal
from ..errors import InputError
from ..notebook import table
from ..plant import Plant
from .process import Array, Process, root


@dataclass(frozen=True, slots=True, repr=False)
class Tuning:
    """A controller, and its effect on the loop.

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

    def __repr__(self) -> str:
        return f"<Tuning {self}>"

    def _repr_html_(self) -> str:
        """Controller, robustness and load rejection, for a notebook."""
        k, ti, td, _ = self.controller
        rows = [("K", f"{k:.4g}"), ("Ti", f"{ti:.4g} s"), ("Td", f"{td:.4g} s"), ("Ms", f"{self.ms:.2f}")]
        rows += [("Mt", f"{self.mt:.2f}"), ("gain margin", f"{self.gain_margin:.3g}")]
        return table(self.rule, [*rows, ("phase margin", f"{self.phase_margin:.0f}°"), ("IAE", f"{self.iae:.3g}")])

    def __str__(self) -> str:
        k, ti, td, _ = self.controller
        return (
            f"{self.rule}: K {k:.4g}, Ti {ti:.4g} s, Td {td:.4g} s; Ms {self.ms:.2f}, Mt {self.mt:.2f}, "
            f"gain margin {self.gain_margin:.3g}, phase margin {self.phase_margin:.0f}°, IAE {self.iae:.3g}"
        )


def open_loop(plant: Process, controller: Sequence[float] | Tuning, tf: float = 0.0) -> Plant:
    """Open loop of a process, a controller in ideal form and the filter 1/(1 + s·tf)², as one transfer function.

    Parameters
    ----------
    plant : process
    controller : (k, ti), (k, ti, td), (k, ti, td, b) or Tuning
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
    plant = Plant.of(plant)
    k, ti, td, _ = ideal_of(controller)
    tf = check_number(tf, "tf", lambda x: x >= 0, "0 s or greater")
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
    plant: Process, controller: Sequence[float] | Tuning, *, tf: float = 0.0, rule: str = "as given", source: str = ""
) -> Tuning:
    """Robustness and load rejection of a loop, dead time exact.

    Parameters
    ----------
    plant : process
        Stable but for integrators.
    controller : (k, ti), (k, ti, td), (k, ti, td, b) or Tuning
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
    plant, ideal = Plant.of(plant), ideal_of(controller)
    loop = open_loop(plant, ideal, tf)
    if np.any(plant.poles.real[plant.poles != 0] >= 0):
        raise InputError("has poles in the right half plane", parameter="plant", value=plant, bound="stable")
    w = loop.frequencies()
    value = loop.response(w)
    if not closed_loop_stable(loop, value):
        raise InputError(f"{rule} makes the closed loop unstable", parameter="controller", value=tuple(ideal))
    ms, w_ms = _peak(lambda x: 1 / np.abs(1 + loop.response(x)), w, 1 / np.abs(1 + value))
    mt, _ = _peak(lambda x: np.abs(loop.response(x) / (1 + loop.response(x))), w, np.abs(value / (1 + value)))
    if len(loop.num) == len(loop.den):  # the curve does not end at 0, but at a point, or with dead time on a circle
        end = loop.num[0] / loop.den[0]
        reach = 1 - abs(end) if loop.dead_time else abs(1 + end)
        ms, mt = max(ms, 1 / reach), max(mt, abs(end) / reach)
    gain_margin, phase_margin = _margins(loop, w, value)
    iae = iae_of(plant, loop, abs(ideal.k / ideal.ti), w_ms)
    return Tuning(rule, source, ideal, float(tf), ms, max(mt, 1.0), gain_margin, phase_margin, iae, plant)


def closed_loop_stable(loop: Plant, value: npt.NDArray[np.complex128]) -> bool:
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


def _margins(loop: Plant, w: Array, value: npt.NDArray[np.complex128]) -> tuple[float, float]:
    """Gain margin at the crossings of the negative real axis, phase margin [°] at those of the unit circle."""
    gain, phase = math.inf, math.inf
    crossed = np.flatnonzero((np.sign(value.imag[:-1]) != np.sign(value.imag[1:])) & (value.real[:-1] < 0))
    # With dead time there are any number of them: those that may be the farthest out short of −1 are refined.
    short = np.where(value.real[crossed] > -1.1, -value.real[crossed], 0.0)
    for i in crossed[short > 0.8 * short.max(initial=0.0)]:
        at = root(lambda x: float(loop.response(x).imag), w[i], w[i + 1])
        real = float(loop.response(at).real)
        if -1 < real < 0:
            gain = min(gain, -1 / real)
    size = np.abs(value)
    for i in np.flatnonzero((size[:-1] > 1) != (size[1:] > 1)):
        at = root(lambda x: float(np.abs(loop.response(x))) - 1, w[i], w[i + 1])
        phase = min(phase, abs(math.degrees(float(np.angle(-loop.response(at))))))
    return gain, phase


def iae_of(plant: Plant, loop: Plant, ki: float, w_ms: float) -> float:
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
        # The cut spectrum adds just before the end the part that belongs before the start: only earlier values are
        # used.
        if np.abs(y[-n // 4 : -n // 8]).max() < 1e-5 * np.abs(y).max() or n >= 1 << 19:
            break
        n *= 2
    a, b = np.abs(y), np.abs(np.roll(y, -1))
    crossed = y * np.roll(y, -1) < 0
    with np.errstate(divide="ignore", invalid="ignore"):
        area = np.where(crossed, (a * a + b * b) / (a + b), a + b)
    return float(0.5 * h * area.sum())


def ideal_of(controller: Sequence[float] | Tuning) -> Ideal:
    """A controller in ideal form, refused where it is none."""
    if isinstance(controller, Tuning):
        return controller.controller
    if isinstance(controller, Controller):
        raise InputError(
            "is as its maker writes it, must be in ideal form",
            parameter="controller",
            value=controller,
            hint="write controller.ideal(pv_span, op_span)",
        )
    try:
        numbers = [float(x) for x in controller]
    except (TypeError, ValueError):
        numbers = []
    if not 2 <= len(numbers) <= 4:
        raise InputError("write (k, ti), (k, ti, td) or (k, ti, td, b)", parameter="controller", value=controller)
    ideal = Ideal(*[*numbers, 0.0, 0.0][:4])
    check_number(ideal.k, "k", lambda x: x != 0, "other than 0")
    check_number(ideal.ti, "ti", lambda x: x > 0, "greater than 0 s")
    check_number(ideal.td, "td", lambda x: x >= 0, "0 s or greater")
    return ideal
