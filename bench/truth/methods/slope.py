"""The ratio of slopes tells triangles from sines.

Source: the idea of the published slope-ratio methods, with an index of our own. OP of a self-regulating process under a
valve that sticks, PV of an integrating one, is a triangle: its slope stays the same up to the peak. A load that swings,
or an over-tuned loop, leaves a sine, whose slope dies away. Each way from a zero crossing to the peak, and from the
peak to the next crossing, is halved in time; slope index

    R = mean slope of the outer halves/mean slope of the inner halves,

1 of a triangle and 1 + √2 of a sine. In thirds of ln(1 + √2): stiction below the first, not above the second, undecided
between.

Needs OP (PV for an integrating process) of a loop that is known to oscillate. Gives no size.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from ..answer import MethodAnswer
from ..oscillation import band_pass, oscillation, zero_crossings
from ..records import Floats, Record
from .he import SHORTEST

STICTION, SOUND = ((1 + math.sqrt(2)) ** third for third in (1 / 3, 2 / 3))


def answer(record: Record) -> MethodAnswer:
    """The decision."""
    integrating = record.loop.process.type == "integrating"
    signal = record.column("PV" if integrating else "OP")
    found = oscillation(record.column("SP") - record.column("PV"))
    if found is None or found.regularity <= 1:
        return MethodAnswer("cannot_tell", reason="no regular oscillation")
    index = slope_index(signal, found.period)
    if index is None:
        return MethodAnswer("cannot_tell", reason="too few samples a half-period")
    if STICTION < index < SOUND:
        return MethodAnswer("cannot_tell", reason=f"R = {index:.2f}: undecided")
    return MethodAnswer("valve" if index <= STICTION else "not valve")


def slope_index(signal: Floats, period: float) -> float | None:
    """R over all half-periods, each as often as it is high; None where none has enough samples."""
    # As for He: up to the eleventh harmonic a triangle is a triangle; below half the frequency is drift.
    calm = band_pass(signal, period, 0.5, 11.0)
    ends = np.round(zero_crossings(band_pass(signal, period))).astype(int)
    outer = inner = 0.0
    for a, b in itertools.pairwise(ends):
        y = np.abs(calm[a : b + 1])
        peak = int(y.argmax())
        if b - a < max(SHORTEST, 0.25 * period) or min(peak, b - a - peak) < 2:
            continue
        places = np.array([0.0, peak / 2, peak, (peak + b - a) / 2, b - a])
        first, up, top, down, last = np.interp(places, np.arange(y.size), y)
        outer += up - first + down - last
        inner += 2 * top - up - down
    return outer / inner if inner > 0 else None
