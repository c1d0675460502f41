"""Systems and equations of the thesis as printed, with the results of glapp's blocks.

The thesis' side of each number is written from the printed formula and calls nothing of glapp.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from glapp import blocks
from glapp.nonlinear import n_backlash, n_relay
from glapp.plant import PLANTS, Plant
from glapp.tuning import ziegler_nichols_frequency

from .chapter8 import HALF_P2
from .figure import Number

__all__ = ["CHECKS"]

Complex = npt.NDArray[Any]

S = 1j * np.geomspace(1e-2, 1e1, 61)
"""Points at which transfer functions are compared."""

BATCH: dict[str, Complex] = {
    "P1": np.exp(-0.2 * S) / (S * (1 + 0.8 * S)),
    "P2": 1 / (1 + S) ** 4,
    "P3": 9 / ((S + 1) * (S**2 + 2 * S + 9)),
    "P4": np.exp(-4 * S) / (2 * S + 1),
    "P5": 1 / (1 + S) ** 3,
    "P6": (1 - 0.5 * S) / (1 + S) ** 3,
    "P7": 1 / (1 + S) ** 8,
    "P8": np.exp(-S) / (1 + 0.05 * S) ** 2,
}
"""The test batch as section 4.1 prints it."""

K, TI, TD, KP = 2.0, 2.0, 0.5, 1.0
DT, DY, D_HAT = 12.0, 0.5, 5.0
"""A controller and a half-period on which the equations are tried."""


def _off(plant: Plant, printed: Complex, name: str = "P") -> Number:
    """The greatest distance of P(iω) from the printed formula, relative to it."""
    off = np.max(abs(plant.response(S.imag) / printed - 1))
    return Number(f"{name}(iω) off the printed formula", "", 0.0, round(float(off), 12))


def _process(name: str) -> Callable[[], tuple[Number, ...]]:
    return lambda: (_off(PLANTS[name], BATCH[name], name),)


def fotd() -> tuple[Number, ...]:
    """The FOTD model of section 4.1."""
    return (_off(Plant([1.5], [3.0, 1.0], 2.0), 1.5 * np.exp(-2 * S) / (1 + 3 * S)),)


def cascade() -> tuple[Number, ...]:
    """The two halves of P2 in section 8.3."""
    return _off(HALF_P2, 1 / (S + 1) ** 2, "Gp1"), _off(HALF_P2 * HALF_P2, BATCH["P2"], "Gp1·Gp2")


def with_dead_time() -> tuple[Number, ...]:
    """P2 and P3 with 3 s more of dead time."""
    found = []
    for name in ("P2", "P3"):
        num, den, _ = PLANTS[name]
        found.append(_off(Plant(num, den, 3.0), BATCH[name] * np.exp(-3 * S), f"{name} with L = 3 s: P"))
    return tuple(found)


def contact() -> tuple[Number, ...]:
    """A gap in contact and out of it (1.1)."""
    gap = blocks.Backlash(1.0)
    up = [gap.update(x) for x in (0.0, 4.0, 5.0)]
    back = gap.update(4.5)
    return (
        Number("slope of the output in contact", "", 1.0, up[2] - up[1]),
        Number("slope within the gap", "", 0.0, back - up[2]),
    )


def describing_function() -> tuple[Number, ...]:
    """N(A, d) of section 1.2."""
    off = 0.0
    for a in (0.51, 0.7, 1.0, 3.0, 50.0):
        x = 1 / a  # d/A
        printed = math.pi / 2 + math.asin(1 - x) + (1 - x) * math.sqrt(x * (2 - x)) - 1j * x * (2 - x)
        off = max(off, abs(complex(n_backlash(a, 1.0)) - printed / math.pi))
    return (Number("N(A, d) off the printed formula", "", 0.0, round(off, 12)),)


def low_pass() -> tuple[Number, ...]:
    """The filter of section 2.1."""
    block = blocks.SecondOrderFilter(tf=1.0)
    block.update(0.0, 0.001)
    for _ in range(2000):
        after = block.update(1.0, 0.001)
    return (Number("step response after 2Tf", "", 1 - 3 * math.exp(-2), after),)


def crossings() -> tuple[Number, ...]:
    """Equation (2.1), and its result for an error of exactly zero."""
    e = (1.0, 0.0, 0.0, -1.0)
    block = blocks.ZeroCrossing()
    return (
        Number(
            "zero crossings in e = 1, 0, 0, −1",
            "",
            float(sum(now * before <= 0 for before, now in pairwise(e))),
            float(sum(block.update(x) for x in e)),
        ),
    )


def half_period() -> tuple[Number, ...]:
    """(2.2) of a half sine."""
    crossing, half = blocks.ZeroCrossing(), blocks.HalfPeriod()
    h = math.pi / 1000
    ended = [half.update(e, h, 0.0, crossed=crossing.update(e)) for e in (math.sin((i + 0.5) * h) for i in range(2001))]
    rows = [row for row in ended if row is not None]
    *_, delta_t, delta_y = rows[1][:4]
    return Number("Δt of a half sine", "s", math.pi, delta_t), Number("Δy of a half sine", "", 2 / math.pi, delta_y)


def _width(td: float | None = None, slope_change: float = 0.0) -> tuple[float, ...]:
    return blocks.Width(K, TI, td=td, kp=KP).of(1, DT, DY, slope_change=slope_change)


def width() -> tuple[Number, ...]:
    """(2.3) and (2.4)."""
    *_, kp_part, d = _width()
    return Number("Δu_true", "", DY / KP, kp_part), Number("d̂", "", K / TI * DY * DT - DY / KP, d)


def change_of_op() -> tuple[Number, ...]:
    """(7.1) and (7.5)."""
    return (Number("Δu", "", K / TI * DY * DT, _width()[0]),)


def with_derivative() -> tuple[Number, ...]:
    """(7.6): PV's slope turns by 0.1/s."""
    return (Number("Δu", "", K / TI * DY * DT - K * TD * 0.1, _width(TD, 0.1)[4]),)


def kp_taken_apart() -> tuple[Number, ...]:
    """(7.2)."""
    return (Number("d̂", "", K * DY * (DT / TI - 1 / (K * KP)), _width()[6]),)


def controller() -> tuple[Number, ...]:
    """(4.1) over a sine of 1."""
    block, h, u = blocks.Pid(K, TI, TD), 0.001, []
    for i in range(10_001):
        u.append(block.update(1.0, math.sin(i * h), h))

    def printed(t: float) -> float:
        return K * (-math.sin(t) + (t + math.cos(t) - 1) / TI - TD * math.cos(t))

    return (Number("OP's move from 1 to 10 s", "", printed(10.0) - printed(1.0), u[10_000] - u[1000]),)


def _bound(bit: int, change: Callable[[float], dict[str, float]]) -> float:
    """Number at which one condition of the safety net changes its verdict, between 0.01 and 100."""
    net = blocks.SafetyNet(K, TI)
    usual: dict[str, float] = {"delta_t": 1000.0, "delta_y": DY, "e_max": 0.6, "delta_sp": 0.0, "previous": DY}

    def fails(x: float) -> bool:
        return bool(net.check(flags=0, free=0.0, **usual | change(x))[0] & bit)

    low, high = 0.01, 100.0
    at_low = fails(low)
    assert at_low != fails(high)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if fails(middle) == at_low else (low, middle)
    return round(high, 9)


TOO_SHORT, NOT_SQUARE, UNEVEN, SP_MOVED, TOO_SMALL = 16, 32, 64, 128, 256
"""Bits of a half-period's mask."""


def shortest() -> tuple[Number, ...]:
    """Δt > 5Ti."""
    return (Number("least Δt/Ti", "", 5.0, _bound(TOO_SHORT, lambda x: {"delta_t": x * TI})),)


def too_small() -> tuple[Number, ...]:
    """(5.1)."""
    found = _bound(TOO_SMALL, lambda x: {"delta_t": x, "d_hat": D_HAT})
    return (Number("least Δt", "s", TI * D_HAT / (2 * K * DY), found),)


def square() -> tuple[Number, ...]:
    """(5.2)."""
    return (Number("greatest e_max/Δy", "", 2.0, _bound(NOT_SQUARE, lambda x: {"e_max": x * DY})),)


def decay() -> tuple[Number, ...]:
    """(5.3)."""
    return (Number("greatest Δy_previous/Δy", "", 1.5, _bound(UNEVEN, lambda x: {"previous": (0.6 + x) * DY}) + 0.6),)


def growth() -> tuple[Number, ...]:
    """(5.4)."""
    found = _bound(UNEVEN, lambda x: {"previous": min(x, 1.0) * DY})
    return (Number("least Δy_previous/Δy", "", 0.5, found), *decay())


def setpoint() -> tuple[Number, ...]:
    """(5.5)."""
    return (Number("greatest Δysp/Δy", "", 1.0, _bound(SP_MOVED, lambda x: {"delta_sp": x * DY})),)


def noise() -> tuple[Number, ...]:
    """Code block 6.1."""
    block = blocks.Noise(0.3)
    values = np.array([block.update(0.0) for _ in range(20_000)])
    return (Number("standard deviation at Power = 0.3", "", 0.3 / math.sqrt(3), float(values.std())),)


def backlash() -> tuple[Number, ...]:
    """Code block 6.2."""
    block, deadband, output, off = blocks.Backlash(2.0), 2.0, 0.0, 0.0
    block.update(output)
    for x in (5.0 * np.sin(np.arange(1000) ** 1.1)).tolist():
        if x > output + deadband / 2:
            output = x - deadband / 2
        elif x < output - deadband / 2:
            output = x + deadband / 2
        off = max(off, abs(block.update(x) - output))
    return (Number("output off the code block's", "", 0.0, off),)


def median_mean() -> tuple[Number, ...]:
    """The three steps of section 7.3."""
    last = [4.8, 5.0, 5.1, 13.0, 5.2, 0.4, 4.9, 5.05, 7.0]
    median = statistics.median(last)
    block = blocks.MedianMean(9)
    for d in last:
        shown = block.update(d)[0]
    kept = [d for d in last if 0.8 * median <= d <= 1.2 * median]
    return (Number("shown after nine detections", "%", statistics.fmean(kept), shown),)


def relay() -> tuple[Number, ...]:
    """N(A) of a relay (7.4)."""
    return (Number("N(A) at A = 2A_relay", "", 4 / (2 * math.pi), complex(n_relay(2.0, 1.0)).real),)


def warning() -> tuple[Number, ...]:
    """Code block 7.1, with h = 0.1 s."""
    block = blocks.OverCompensation(K, TI)
    return (
        Number(
            "warnings of Δt = 12, 12.1, 12, 11.9, 12.4 s",
            "",
            1.0,
            float(sum(block.update(dt, 0.5, 0.1, size=2.0)[0] for dt in (12.0, 12.1, 12.0, 11.9, 12.4))),
        ),
    )


def by_frequency() -> tuple[Number, ...]:
    """Ziegler and Nichols."""
    found = ziegler_nichols_frequency("P2", "PID").controller
    return (Number("Ti/Td", "", 4.0, round(found.ti / found.td, 9)),)


CHECKS: dict[str, Callable[[], tuple[Number, ...]]] = {
    **{name: _process(name) for name in BATCH},
    **{
        check.__name__: check
        for check in (
            *(fotd, cascade, with_dead_time, contact, describing_function, low_pass, crossings, half_period, width),
            *(change_of_op, with_derivative, kp_taken_apart, controller, shortest, too_small, square, decay, growth),
            *(setpoint, noise, backlash, median_mean, relay, warning, by_frequency),
        )
    },
}
"""Checks that `ITEMS` names."""
