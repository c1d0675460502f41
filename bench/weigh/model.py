"""A sum of broken lines for the log-odds of a dead band, learned by penalised maximum likelihood."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Names = npt.NDArray[np.str_]

KNOTS = 3
"""Corners of a line, at even shares of the records between `ENDS`."""

ENDS = (0.03, 0.97)

STIFF = 1.0
"""Penalty of a squared rise between two corners, in records; chosen on parts A to C, twins left out together, of 1, 2,
3, 5 and 10. With more the lines are too flat, and what is plain is understated."""


@dataclass(frozen=True)
class Lines:
    """The model: log-odds of a record are `base` + the sum of its lines' heights.

    - `base`: the log-odds of a usual record, where one of two has a dead band.
    - `x`, `y` (list of float64[n]): corners of each line, in rising order.
    """

    base: float
    x: list[Floats]
    y: list[Floats]

    def heights(self, quantities: Floats) -> Floats:
        """Height of each line, a column each, for records in rows."""
        return np.stack([np.interp(q, x, y) for q, x, y in zip(quantities.T, self.x, self.y, strict=True)], axis=1)

    def log_odds(self, quantities: Floats) -> Floats:
        """Log-odds of each record."""
        odds: Floats = self.base + self.heights(quantities).sum(axis=1)
        return odds


def corners(values: Floats) -> Floats:
    """Values at which the line of a quantity has its corners; a quantity with two values has a line between them."""
    different = np.unique(values)
    if different.size == 1:
        return np.array([different[0], different[0] + 1.0])
    places = np.unique(np.round(np.quantile(values, np.linspace(*ENDS, KNOTS)), 4))
    return places if places.size > 1 else different[[0, -1]]


def learned(quantities: Floats, rises: Bools, gap: Bools, weight: Floats) -> Lines:
    """The lines that make the records likeliest; none goes the wrong way."""
    x = [corners(column) for column in quantities.T]
    parts: list[Floats] = []
    for column, at, up in zip(quantities.T, x, rises, strict=True):
        share = np.clip((column[:, None] - at[:-1]) / np.diff(at), 0.0, 1.0)
        parts.append(share if up else 1.0 - share)
    design = np.concatenate(parts, axis=1)
    w, y = weight / weight.mean(), gap.astype(float)

    def loss(theta: Floats) -> tuple[float, Floats]:
        z = design @ theta[:-1] + theta[-1]
        p = 1.0 / (1.0 + np.exp(-z))
        off = w * (p - y)
        value = w @ (np.logaddexp(0.0, z) - y * z) + 0.5 * STIFF * (theta[:-1] @ theta[:-1])
        return float(value), np.append(design.T @ off + STIFF * theta[:-1], off.sum())

    n = design.shape[1]
    bounds = [(0.0, None)] * n + [(None, None)]
    found = minimize(loss, np.append(np.full(n, 0.1), 0.0), jac=True, method="L-BFGS-B", bounds=bounds)
    theta, base, lines, at_n = found.x[:-1], float(found.x[-1]), [], 0
    for column, at, up in zip(quantities.T, x, rises, strict=True):
        steps = theta[at_n : at_n + at.size - 1]
        at_n += at.size - 1
        line = np.append(0.0, np.cumsum(steps)) if up else np.append(np.cumsum(steps[::-1])[::-1], 0.0)
        mean = float(w @ np.interp(column, at, line) / w.sum())
        base += mean
        lines.append(line - mean)
    return Lines(base, x, lines)


def left_out(quantities: Floats, rises: Bools, gap: Bools, weight: Floats, groups: Names, most: int = 10) -> Floats:
    """Log-odds of each record by lines that were learned without its group; of many some are left out at a time."""
    odds = np.zeros(gap.size)
    for part in _parts(groups, most):
        out = np.isin(groups, part)
        odds[out] = learned(quantities[~out], rises, gap[~out], weight[~out]).log_odds(quantities[out])
    return odds


def _parts(groups: Names, most: int) -> Iterator[Sequence[str]]:
    every = np.unique(groups)
    np.random.default_rng(1).shuffle(every)
    yield from np.array_split(every, min(most, every.size))


def balanced(gap: Bools, rows: Names) -> Floats:
    """Weights with which half of each row has a gap, and a row counts as many records as it has."""
    weight = np.zeros(gap.size)
    for row in np.unique(rows):
        members = rows == row
        for with_gap in (False, True):
            alike = members & (gap == with_gap)
            # A row with one kind alone tells nothing of the other.
            if alike.any() and alike.sum() < members.sum():
                weight[alike] = 0.5 * members.sum() / alike.sum()
    return weight


def log_loss(odds: Floats, gap: Bools, weight: Floats) -> float:
    """Mean of −ln of the probability of the truth."""
    return float(weight @ (np.logaddexp(0.0, odds) - gap * odds) / weight.sum())


def auc(odds: Floats, gap: Bools, weight: Floats) -> float:
    """Share of pairs in which a record with a gap has greater odds than one without; a tie counts half."""
    order = np.argsort(odds)
    z, y, w = odds[order], gap[order], weight[order]
    above, won = 0.0, 0.0
    for value in np.unique(z):
        here = z == value
        none, some = w[here & ~y].sum(), w[here & y].sum()
        won += some * (above + 0.5 * none)
        above += none
    return float(won / (w[~y].sum() * w[y].sum()))
