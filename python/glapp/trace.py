"""Signals thinned to the resolution of a screen, without losing a peak."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Band", "Thinner", "Trace"]

Floats = NDArray[np.float64]

MOST_BUCKETS = 4096
"""A trace has half as many buckets or more, as long as there are as many rows; a screen shows fewer."""


class Band(NamedTuple):
    """Smallest and largest value of a signal in each bucket; NaN where it had none."""

    low: Floats
    high: Floats


@dataclass(frozen=True, slots=True)
class Trace:
    """A recording in buckets of equally many rows.

    - `t` (float64[n]): first row of each bucket [s since t0].
    - `sp`, `pv`, `pv_filtered`: setpoint, process value, filtered process value [PV unit].
    - `op`, `position`: controller output [OP unit] and valve position, where recorded.
    """

    t: Floats
    sp: Band
    pv: Band
    pv_filtered: Band
    op: Band | None
    position: Band | None


class Thinner:
    """Thins columns batch by batch, in constant memory, to between `MOST_BUCKETS`/2 and `MOST_BUCKETS` buckets.

    A bucket holds `width` rows; before there would be too many, neighbours are merged and `width` doubles.

    Examples
    --------
    >>> thinner = Thinner()
    >>> thinner.add(np.arange(3.0), {"pv": np.array([1.0, np.nan, 2.0])})
    >>> thinner.band("pv").high
    array([ 1., nan,  2.])
    """

    def __init__(self) -> None:
        self._width = 1
        self._buckets = 0
        self._t: list[Floats] = []
        self._low: dict[str, list[Floats]] = {}
        self._high: dict[str, list[Floats]] = {}
        self._t_rest = np.empty(0)
        self._rest: dict[str, Floats] = {}

    def add(self, t: Floats, columns: dict[str, Floats]) -> None:
        """Take one batch: times, and columns of the same length and always the same names."""
        while self._buckets + (len(self._t_rest) + len(t)) // self._width > MOST_BUCKETS:
            self._merge()
        width = self._width
        t = np.concatenate((self._t_rest, t))
        n = len(t) // width
        self._t.append(t[: n * width : width].copy())
        self._t_rest = t[n * width :].copy()
        for name, x in columns.items():
            x = np.concatenate((self._rest[name], x)) if name in self._rest else x
            low, high = _extremes(x[: n * width].reshape(n, width))
            self._low.setdefault(name, []).append(low)
            self._high.setdefault(name, []).append(high)
            self._rest[name] = x[n * width :].copy()
        self._buckets += n

    def times(self) -> Floats:
        """Time of the first row of each bucket, the one of the rows that do not fill a bucket included."""
        return np.concatenate([*self._t, self._t_rest[:1]])

    def band(self, name: str) -> Band:
        """Thinned values of one column, the rows that do not fill a bucket included."""
        low, high = self._low[name], self._high[name]
        rest = self._rest[name]
        if len(rest):
            last_low, last_high = _extremes(rest.reshape(1, -1))
            low, high = [*low, last_low], [*high, last_high]
        return Band(np.concatenate(low), np.concatenate(high))

    def _merge(self) -> None:
        """Merge buckets in pairs."""
        odd = self._buckets % 2
        t = np.concatenate([*self._t, np.empty(0)])
        if odd:
            # The bucket without a partner waits with the other rows; its two extremes represent all of its rows.
            self._t_rest = np.concatenate((np.full(self._width, t[-1]), self._t_rest))
        self._t = [t[: len(t) - odd : 2]]
        for name in self._low:
            low, high = np.concatenate(self._low[name]), np.concatenate(self._high[name])
            if odd:
                fill = np.empty(self._width)
                fill[0::2], fill[1::2] = low[-1], high[-1]
                self._rest[name] = np.concatenate((fill, self._rest[name]))
                low, high = low[:-1], high[:-1]
            self._low[name] = [_extremes(low.reshape(-1, 2))[0]]
            self._high[name] = [_extremes(high.reshape(-1, 2))[1]]
        self._buckets //= 2
        self._width *= 2


def _extremes(buckets: Floats) -> tuple[Floats, Floats]:
    """Smallest and largest of each row; NaN only where all are."""
    if not buckets.size:
        return np.empty(0), np.empty(0)
    low, high = buckets.min(axis=1), buckets.max(axis=1)
    holes = np.isnan(low)
    if holes.any():
        low[holes] = np.fmin.reduce(buckets[holes], axis=1)
        high[holes] = np.fmax.reduce(buckets[holes], axis=1)
    return low, high
