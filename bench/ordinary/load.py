"""Loads of the ordinary loops: what each row's does over the time of a record."""

from __future__ import annotations

import math
from collections.abc import Callable
from random import Random
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from glapp.scenario import Coloured, Piece, Walk

from ..truth.design import log_uniform

Floats = npt.NDArray[np.float64]

HOUR = 3600.0
"""[s]"""

LEAST_ROWS = 8
"""A cycle has at least so many rows a period."""


class Scene(NamedTuple):
    """What a load is drawn from.

    - `random`: its generator; `size`: its size, peak to peak [% of OP].
    - `samples`, `h`: samples of the simulation, and the time between them [s].
    - `each`: time between recorded samples [s].
    - `whole`: time scale of the loop [s].
    """

    random: Random
    size: float
    samples: int
    h: float
    each: float
    whole: float

    @property
    def t(self) -> Floats:
        """Times of the samples [s]."""
        return np.arange(self.samples) * self.h

    @property
    def t_end(self) -> float:
        """Time of the last sample [s]."""
        return (self.samples - 1) * self.h


Load = tuple[Floats | None, Floats]
"""Values at each sample [% of OP], None where a piece of the scenario makes them; times of the load's changes [s]."""


def _drift(_: Scene) -> Load:
    """None: `drifting` makes it."""
    return None, np.empty(0)


def drifting(random: Random, size: float, t_end: float) -> Piece:
    """A walk of half the size in 20 to 60 minutes; over more than two hours one that is drawn back."""
    if t_end <= 2 * HOUR:
        return Walk(rate=size / 2 / math.sqrt(random.uniform(0.3, 1.0) * HOUR))
    return Coloured(sigma=size / 2, tau=HOUR * log_uniform(random, 0.3, 3.0))


def _steps(scene: Scene) -> Load:
    """Steps to random values, 5 to 60 minutes or 5 to 40 time scales apart, whichever is longer."""
    random = scene.random
    apart = max(log_uniform(random, 300.0, HOUR), scene.whole * log_uniform(random, 5.0, 40.0))
    steps = moves(random, scene.t_end, min(apart, scene.t_end / 4), scene.size / 2)
    at, values = np.array([0.0, *(t for t, _ in steps)]), np.array([0.0, *(x for _, x in steps)])
    return values[np.searchsorted(at, scene.t, side="right") - 1], at[1:]


def moves(random: Random, t_end: float, apart: float, size: float, rest: float = 0.0) -> list[tuple[float, float]]:
    """Steps at random times to random values within ± size of `rest`."""
    t, steps = apart * random.uniform(0.05, 0.8), []
    while t < t_end:
        steps.append((t, rest + random.uniform(-size, size)))
        t += random.uniform(0.4, 1.6) * apart
    return steps


def _bends(scene: Scene) -> Load:
    """Straight lines between corners that are 25 to 200 recorded samples apart."""
    return _lines(scene, lambda: log_uniform(scene.random, 25.0, 200.0))


CORNERS = (25, 50, 100, 200)
"""Recorded samples from one corner to the next in the row *corners*, to a fifth."""


def _corners(scene: Scene) -> Load:
    """Straight lines between corners that are so many samples apart."""
    apart = scene.random.choice(CORNERS)
    return _lines(scene, lambda: apart * scene.random.uniform(0.8, 1.2))


def _lines(scene: Scene, apart: Callable[[], float]) -> Load:
    """Straight lines between random values, `apart` recorded samples from one to the next."""
    at, values = [0.0], [0.0]
    while at[-1] < scene.t_end:
        at.append(at[-1] + apart() * scene.each)
        values.append(scene.random.uniform(-0.5, 0.5) * scene.size)
    return np.interp(scene.t, at, values), np.array(at[1:-1])


def _neighbour(scene: Scene, shape: str) -> Load:
    """A neighbour's cycle of 3 to 60 time scales, at least 8 rows and at most an eighth of the record.

    Every other one keeps its time to a tenth and its height to a fifth only.
    """
    random = scene.random
    period = min(max(scene.whole * log_uniform(random, 3.0, 60.0), LEAST_ROWS * scene.each), scene.t_end / 8)
    values = swing(random, shape, period, scene.t, random.random() < 0.5)
    return scene.size / 2 * values, np.empty(0)


def swing(random: Random, shape: str, period: float, t: Floats, uneven: bool) -> Floats:
    """A cycle between -1 and 1: sine, saw or square, cycle by cycle, with a phase of its own."""
    count = math.ceil(t[-1] / period / 0.85) + 3
    lengths = np.array([period * (random.uniform(0.9, 1.1) if uneven else 1.0) for _ in range(count)])
    heights = np.array([random.uniform(0.8, 1.0) if uneven else 1.0 for _ in range(count)])
    begins = np.concatenate([[0.0], np.cumsum(lengths)]) - period * random.random()
    which = np.searchsorted(begins, t, side="right") - 1
    part = (t - begins[which]) / lengths[which]
    rises = random.uniform(0.1, 0.9) if random.random() < 0.5 else 0.5
    lag = period * random.uniform(0.02, 0.15)
    if shape == "sine":
        x = np.sin(2 * math.pi * part)
    elif shape == "saw":
        x = np.interp((part + rises / 2) % 1.0, [0.0, rises, 1.0], [-1.0, 1.0, -1.0])
    else:
        x = lagged(np.where(part < 0.5, 1.0, -1.0), lag, t[1] - t[0])
    return x * heights[which]


def lagged(x: Floats, lag: float, h: float) -> Floats:
    """Output of a lag [s] with the input `x`, from rest at the first value."""
    fading = math.exp(-h / lag)
    y, _ = lfilter([1 - fading], [1.0, -fading], x - x[0], zi=[0.0])
    return np.asarray(y + x[0])


LOADS: dict[str, Callable[[Scene], Load]] = {
    "drift": _drift,
    "steps": _steps,
    "bends": _bends,
    "corners": _corners,
    "sine": lambda scene: _neighbour(scene, "sine"),
    "saw": lambda scene: _neighbour(scene, "saw"),
    "square": lambda scene: _neighbour(scene, "square"),
}
"""Load of each row; rows that are not about the load draw one of them."""
