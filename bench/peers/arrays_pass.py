"""The detector's pass with NumPy and SciPy: `lfilter`, `reduceat`, and the safety net on whole columns.

Evenly sampled signals without gaps only, which it checks. The estimate's condition (5.1) is checked on all detections
together and, where any fails it, this peer gives up: the signals of the bench have none that do.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.signal import lfilter

Floats = NDArray[np.float64]


def detect(
    t: Floats,
    sp: Floats,
    pv: Floats,
    settings: tuple[float, float, float, float, int, float, float],
) -> tuple[int, int, float]:
    """Number of half-periods, of detections, and the estimate."""
    k_abs, ti, kp, tf, n_window, max_h, span = settings
    steps = np.diff(t)
    h = steps[0]
    if not (np.isfinite(sp).all() and np.isfinite(pv).all() and (steps == h).all() and 0 < h <= max_h):
        raise ValueError("not evenly sampled, or with gaps")
    a = h / (tf + h)
    y1, _ = lfilter([a], [1.0, a - 1.0], pv, zi=[(1.0 - a) * pv[0]])
    y2, _ = lfilter([a], [1.0, a - 1.0], y1, zi=[(1.0 - a) * pv[0]])
    e = sp - y2
    size = np.abs(e)
    above = e > 0
    at = np.concatenate(([0], np.flatnonzero(above[1:] != above[:-1]) + 1))
    n = np.diff(at)  # the last one is not finished
    count = len(n)
    delta_t = n * h
    delta_t[0] -= h
    delta_y = np.add.reduceat(size, at)[:-1]
    delta_y[0] -= size[0]
    delta_y = delta_y * h / delta_t
    e_max = np.maximum.reduceat(size, at)[:-1]
    high = np.maximum(np.maximum.reduceat(sp, at)[:-1], sp[at[1:]])
    low = np.minimum(np.minimum.reduceat(sp, at)[:-1], sp[at[1:]])
    delta_u = k_abs * delta_y * delta_t / ti
    d = delta_u - delta_y / kp
    previous = np.concatenate(([np.nan, np.nan], delta_y[1:-1]))[:count]
    accepted = (
        (delta_t > 5 * ti)
        & (e_max < 2 * delta_y)
        & (previous < 1.5 * delta_y)
        & (previous > 0.5 * delta_y)
        & (high - low < delta_y)
        & (delta_u < span)
    )
    accepted[0] = False
    detections = d[accepted]
    if len(detections) < n_window:
        return count, len(detections), float("nan")
    windows = sliding_window_view(detections, n_window)
    middle = np.median(windows, axis=1, keepdims=True)
    kept = np.abs(windows - middle) <= 0.2 * np.abs(middle)
    estimates = np.where(kept, windows, 0.0).sum(axis=1) / kept.sum(axis=1)
    reach = (2 * k_abs * delta_t * delta_y / ti)[accepted][n_window:]
    if (reach <= estimates[:-1]).any():
        raise ValueError("condition (5.1) rejects a half-period")
    return count, len(detections), float(estimates[-1])
