"""One loop over many seeds of its noise: runs that fit into memory, and the median and range of their results."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from glapp.scenario import Scenario
from glapp.simulate import Simulation, run_many

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SEEDS", "Spread", "each", "plot", "seeded", "spread"]

SEEDS = 20

SAMPLES = 4_000_000
"""Samples that are held at once, 64 bytes each."""


class Spread(NamedTuple):
    """Spread of the results of many seeds.

    - `median`, `low`, `high`: of those seeds that gave a number; NaN where none did.
    - `share`: share of the seeds that gave one.
    - `lower`, `upper`: their quartiles.
    """

    median: float
    low: float
    high: float
    share: float
    lower: float
    upper: float

    @property
    def usual(self) -> float | None:
        """The median where at least half of the seeds gave a number."""
        return self.median if self.share >= 0.5 else None


def spread(values: Iterable[float | None]) -> Spread:
    """Median and range of values, of which None is no value.

    Examples
    --------
    >>> spread([1.0, None, 3.0, 2.0])
    Spread(median=2.0, low=1.0, high=3.0, share=0.75, lower=1.5, upper=2.5)
    >>> spread([None, None, 5.0]).usual is None
    True
    """
    given = list(values)
    numbers = [value for value in given if value is not None]
    if not numbers:
        return Spread(np.nan, np.nan, np.nan, 0.0, np.nan, np.nan)
    lower, middle, upper = (float(x) for x in np.percentile(numbers, (25, 50, 75)))
    return Spread(middle, min(numbers), max(numbers), len(numbers) / len(given), lower, upper)


def seeded(scenario: Scenario, seeds: int = SEEDS) -> list[Scenario]:
    """The scenario with each seed."""
    return [scenario.model_copy(update={"seed": seed}) for seed in range(seeds)]


def each(scenarios: Sequence[Scenario]) -> Iterator[tuple[Scenario, Simulation]]:
    """Run scenarios in lanes, as many at once as fit into memory, and give them one by one."""
    at_once: list[Scenario] = []
    samples = 0.0
    for scenario in scenarios:
        at_once.append(scenario)
        samples += scenario.t_end / scenario.h
        if samples > SAMPLES or scenario is scenarios[-1]:
            yield from zip(at_once, run_many(at_once, progress=False), strict=True)
            at_once, samples = [], 0.0


def plot(
    axes: Axes, x: Sequence[float], spreads: Sequence[Spread], colour: str, label: str, *, quartiles: bool = False
) -> None:
    """Medians on a line, ranges or quartiles as bars; open where fewer than half of the seeds gave a number."""
    middle = np.array([one.median for one in spreads])
    ends = ("lower", "upper") if quartiles else ("low", "high")
    low, high = (np.array([getattr(one, end) for one in spreads]) for end in ends)
    usual = np.array([one.usual is not None for one in spreads])
    at = np.asarray(x, dtype=float)
    axes.vlines(at, low, high, color=colour, linewidth=1.0)
    axes.plot(at, np.where(usual, middle, np.nan), "-o", color=colour, markersize=4, linewidth=1.2, label=label)
    axes.plot(at[~usual], middle[~usual], "o", color=colour, markersize=4, markerfacecolor="white")
