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

import math

import numpy as np

from ..answer import MethodAnswer
from ..records import Floats, Record
from .he import half_periods, triangle_or_sine

STICTION, SOUND = ((1 + math.sqrt(2)) ** third for third in (1 / 3, 2 / 3))


def answer(record: Record) -> MethodAnswer:
    """Answer by the slope index of the oscillation of OP or PV."""
    if (swing := triangle_or_sine(record)) is None:
        return MethodAnswer("cannot_tell", reason="no regular oscillation")
    index = slope_index(*swing)
    if index is None:
        return MethodAnswer("cannot_tell", reason="too few samples a half-period")
    if STICTION < index < SOUND:
        return MethodAnswer("cannot_tell", reason=f"R = {index:.2f}: undecided")
    return MethodAnswer("valve" if index <= STICTION else "not valve")


def slope_index(signal: Floats, period: float) -> float | None:
    """R over all half-periods, each as often as it is high; None where none has enough samples."""
    outer = inner = 0.0
    for half in half_periods(signal, period):
        y = np.abs(half)
        peak, end = int(y.argmax()), y.size - 1
        if min(peak, end - peak) < 2:
            continue
        places = np.array([0.0, peak / 2, peak, (peak + end) / 2, end])
        first, up, top, down, last = np.interp(places, np.arange(y.size), y)
        outer += up - first + down - last
        inner += 2 * top - up - down
    return outer / inner if inner > 0 else None
