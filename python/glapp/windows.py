"""The windows of a long history that tell most of the gap, chosen while it is read and in bounded memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .recording import AT_HIGH, AT_LOW, BAD, Batch, joined

__all__ = ["Windows", "turns"]

Floats = NDArray[np.float64]

MOST_EPOCHS = 12
"""Epochs of a history, of each of which the best window is kept; half as many or more once it is long."""


LEAST_ROWS = 200
"""Rows, and a twelfth of a window's, without which what lies between two holes is passed over."""


class Windows:
    """Cuts a history into windows of `length` rows and keeps the best one of each epoch.

    An epoch is a number of windows in a row, one at first; before there would be more than `MOST_EPOCHS`, neighbours
    are merged. So the windows kept are spread over the whole length, whatever it is. The best is that in which OP turns
    most, times the share of its rows that can be used: OP and PV are numbers, of good quality and not at a limit. In
    which mode the controller was does not matter, since any move of OP tells.

    Parameters
    ----------
    length : int
        Rows of a window, > 0.
    hole : float
        Time between two rows [s] after which a new window begins, > 0.

    Examples
    --------
    >>> windows = Windows(100, 60.0)
    >>> t = np.arange(5000.0)
    >>> windows.add(Batch(t, t, t, np.where(t < 2500, 40.0, 40.0 + np.sin(t))))
    >>> [int(window.t[0]) for window in windows.best()]
    [2600, 3200, 4200, 4800]
    """

    def __init__(self, length: int, hole: float) -> None:
        self._length = length
        self._hole = hole
        self._per_epoch = 1
        self._seen = 0
        self._epochs: list[tuple[float, Batch] | None] = []
        self._rest: list[Batch] = []

    def add(self, batch: Batch) -> None:
        """Take the next rows of the history."""
        holes = np.flatnonzero(np.diff(batch.t) > self._hole) + 1
        for first, last in zip([0, *holes], [*holes, len(batch)], strict=True):
            self._extend(batch[slice(int(first), int(last))])

    def best(self) -> list[Batch]:
        """The best window of each epoch, in the order of time; those in which OP rests are left out."""
        self._end()
        return [kept[1] for kept in self._epochs if kept is not None and kept[0] > 0]

    def _extend(self, part: Batch) -> None:
        if self._rest and len(part) and part.t[0] - self._rest[-1].t[-1] > self._hole:
            self._end()
        while len(part):
            space = self._length - sum(len(rows) for rows in self._rest)
            self._rest.append(part[slice(0, space)])
            part = part[slice(space, len(part))]
            if space == len(self._rest[-1]):
                self._end()

    def _end(self) -> None:
        """The window under way is whole, or will not become longer."""
        rows, self._rest = self._rest, []
        if sum(len(part) for part in rows) < min(self._length, max(LEAST_ROWS, self._length // 12)):
            return
        if len(self._epochs) == MOST_EPOCHS and self._seen % self._per_epoch == 0:
            pairs = zip(self._epochs[0::2], self._epochs[1::2], strict=True)
            self._epochs = [max(pair, key=lambda kept: -1.0 if kept is None else kept[0]) for pair in pairs]
            self._per_epoch *= 2
        if self._seen % self._per_epoch == 0:
            self._epochs.append(None)
        self._seen += 1
        window = joined(rows)
        told = _told(window)
        best = self._epochs[-1]
        if best is None or told > best[0]:
            self._epochs[-1] = told, window


def turns(op: Floats) -> float:
    """How far OP goes up and down in all, in steps that are large for it [OP unit]."""
    return float(np.abs(np.diff(op[:: max(1, len(op) // 60)])).sum())


def _told(window: Batch) -> float:
    """How much a window may tell."""
    if window.op is None:
        return 0.0
    usable = np.isfinite(window.op) & np.isfinite(window.pv)
    if window.flags is not None:
        usable &= (window.flags & (BAD | AT_LOW | AT_HIGH)) == 0
    return turns(window.op[np.isfinite(window.op)]) * float(usable.mean())
