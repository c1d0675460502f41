"""Bounds on the robustness as circles that the Nyquist curve must not enter."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..checked import check_number
from ..errors import InputError
from ..plant import Plant
from .process import Array

Circles = list[tuple[float, float]]
"""Circles (c, r) around −c on the real axis that the Nyquist curve must not enter."""


def circles_of(m: float | None, ms: float | None, mt: float | None) -> tuple[Circles, str]:
    """Circles of the bounds, and the bounds in words."""
    if m is None and ms is None and mt is None:
        m = 1.4
    if m is not None and (ms is not None or mt is not None):
        raise InputError("bounds Ms and Mt together: give it, or ms and mt", parameter="m", value=m)
    for name, value in (("m", m), ("ms", ms), ("mt", mt)):
        if value is not None:
            check_number(value, name, lambda x: x > 1, "greater than 1")
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


def coarse_frequencies(plant: Plant) -> Array:
    """Frequencies to begin with; the range that matters is refined later."""
    return plant.frequencies(per_decade=30)


def first_touch(curve: npt.NDArray[np.complex128], circles: Circles) -> float:
    """Smallest gain at which gain·curve touches a circle; inf where none does."""
    best = math.inf
    for c, r in circles:
        half, square = c * curve.real, np.abs(curve) ** 2
        root = half * half - square * (c * c - r * r)
        with np.errstate(invalid="ignore"):
            gain = (-half - np.sqrt(root)) / square
        best = min(best, float(np.min(gain[(root >= 0) & (gain > 0)], initial=math.inf)))
    return best


def gains_at_the_limit(shape: npt.NDArray[np.complex128], circles: Circles, integrators: int) -> list[float]:
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
