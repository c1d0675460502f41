"""He's curve fit tells triangles from sines.

Source: He, Wang, Pottmann and Qin, *A curve fitting method for detecting valve stiction in oscillating control loops*,
Ind. Eng. Chem. Res. 46 (2007). A valve that sticks moves in steps; after the first integrator, the controller's for a
self-regulating process (OP) and the process' own for an integrating one (PV), steps are triangles, while a load that
swings or an over-tuned loop leaves sines. Every half-period between two zero crossings is fitted with a half sine and
with two straight lines from the crossings to a peak between them; stiction index

    SI = MSE_sine/(MSE_sine + MSE_triangle),    ≥ 0.6 stiction, ≤ 0.4 not, undecided between.

Needs OP (PV for an integrating process) of a loop that is known to oscillate. Made for strong stick-slip cycles; gives
no size.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from ..answer import MethodAnswer
from ..oscillation import band_pass, oscillation, zero_crossings
from ..records import Floats, Record

STICTION, SOUND = 0.6, 0.4
SHORTEST = 8
"""Samples that a half-period must have for its shape to be seen."""


def answer(record: Record) -> MethodAnswer:
    """The decision."""
    if (swing := triangle_or_sine(record)) is None:
        return MethodAnswer("cannot_tell", reason="no regular oscillation")
    index = stiction_index(*swing)
    if index is None:
        return MethodAnswer("cannot_tell", reason="too few samples a half-period")
    if SOUND < index < STICTION:
        return MethodAnswer("cannot_tell", reason=f"SI = {index:.2f}: undecided")
    return MethodAnswer("valve" if index >= STICTION else "not valve")


def triangle_or_sine(record: Record) -> tuple[Floats, float] | None:
    """The signal that a sticking valve makes a triangle, and its period [samples]; None where nothing swings evenly."""
    integrating = record.loop.process.type == "integrating"
    found = oscillation(record.column("SP") - record.column("PV"))
    if found is None or found.regularity <= 1:
        return None
    return record.column("PV" if integrating else "OP"), found.period


def half_periods(signal: Floats, period: float) -> Iterator[Floats]:
    """Half-periods long enough to have a shape; crossings are those of the signal without drift and fastest part."""
    # Up to the eleventh harmonic a triangle is a triangle; below half the frequency is drift.
    calm = band_pass(signal, period, 0.5, 11.0)
    ends = np.round(zero_crossings(band_pass(signal, period))).astype(int)
    for a, b in itertools.pairwise(ends):
        if b - a >= max(SHORTEST, 0.25 * period):
            yield calm[a : b + 1]


def stiction_index(signal: Floats, period: float) -> float | None:
    """SI over all half-periods."""
    sine = triangle = 0.0
    for y in half_periods(signal, period):
        sine += _misfit(y, np.sin(np.linspace(0, np.pi, y.size)))
        triangle += _triangle_misfit(y)
    return sine / (sine + triangle) if sine + triangle > 0 else None


def _misfit(y: Floats, shape: Floats) -> float:
    """Sum of squares that the best multiple of a shape leaves."""
    return float(y @ y - (y @ shape) ** 2 / (shape @ shape))


def _triangle_misfit(y: Floats) -> float:
    """Sum of squares that a line up from the first crossing and one down to the second leave, at the best peak."""
    x = np.arange(y.size, dtype=np.float64)
    left = _line_misfit(x, y)
    right = _line_misfit(x, y[::-1])[::-1]
    return float((left[:-1] + right[1:]).min())


def _line_misfit(x: Floats, y: Floats) -> Floats:
    """Sum of squares that a line through the first sample's zero leaves of the samples up to each."""
    xx, xy, yy = np.cumsum(x * x), np.cumsum(x * y), np.cumsum(y * y)
    return yy - np.divide(xy * xy, xx, out=np.zeros_like(xx), where=xx > 0)
