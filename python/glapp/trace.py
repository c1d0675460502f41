"""Signals thinned to what a screen can show, without losing a peak."""

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

    Attributes
    ----------
    t : float64[n]
        Middle of each bucket [s since t0].
    sp, pv, pv_filtered : Band
        Setpoint, process value, filtered process value [PV unit].
    op, position : Band or None
        Controller output [OP unit] and valve position, where recorded.
    """

    t: Floats
    sp: Band
    pv: Band
    pv_filtered: Band
    op: Band | None
    position: Band | None


class Thinner:
    """Thins columns batch by batch, in constant memory, to between `MOST_BUCKETS`/2 and `MOST_BUCKETS` buckets.

    A bucket holds `width` rows; when there are too many buckets, neighbours are merged and `width` doubles.

    Examples
    --------
    >>> thinner = Thinner()
    >>> thinner.add({"t": np.arange(3.0), "pv": np.array([1.0, np.nan, 2.0])})
    >>> thinner.band("pv").high
    array([ 1., nan,  2.])
    """

    def __init__(self) -> None:
        self._width = 1
        self._low: dict[str, list[Floats]] = {}
        self._high: dict[str, list[Floats]] = {}
        self._rest: dict[str, Floats] = {}
        self._buckets = 0

    def add(self, columns: dict[str, Floats]) -> None:
        """Take one batch: columns of the same names and, among themselves, the same length."""
        rest = self._rest
        rows = {name: np.concatenate((rest[name], x)) if name in rest else x for name, x in columns.items()}
        n = len(next(iter(rows.values()))) // self._width
        for name, x in rows.items():
            low, high = _extremes(x[: n * self._width].reshape(n, self._width))
            self._low.setdefault(name, []).append(low)
            self._high.setdefault(name, []).append(high)
            self._rest[name] = x[n * self._width :].copy()
        self._buckets += n
        while self._buckets > MOST_BUCKETS:
            self._merge()

    def band(self, name: str) -> Band:
        """What was thinned of one column, the rows that do not fill a bucket included."""
        low, high = self._low[name], self._high[name]
        rest = self._rest[name]
        if len(rest):
            last_low, last_high = _extremes(rest.reshape(1, -1))
            low, high = [*low, last_low], [*high, last_high]
        return Band(np.concatenate(low), np.concatenate(high))

    def _merge(self) -> None:
        odd = self._buckets % 2
        for name in self._low:
            low, high = np.concatenate(self._low[name]), np.concatenate(self._high[name])
            if odd:
                # The bucket without a partner waits with the other rows; its two extremes stand for all of its rows.
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
