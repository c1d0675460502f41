"""Ultimate gain and period."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..plant import Plant
from .process import Process, root, sign_of, stable


class Ultimate(NamedTuple):
    """The point at which P(iω) crosses the negative real axis farthest out.

    Attributes
    ----------
    ku : float
        Ultimate gain Ku: a proportional controller with it makes the loop oscillate steadily.
    tu : float
        Period Tu of that oscillation [s].
    """

    ku: float
    tu: float


def ultimate(plant: Process) -> Ultimate:
    """Ultimate gain and period: where −1/P(iω) is real, nearest to 0.

    Parameters
    ----------
    plant : process
        Stable, or with one integrator; negative gains give a negative Ku.

    Raises
    ------
    InputError
        Where no gain makes the loop oscillate.

    Examples
    --------
    >>> ku, tu = ultimate("P2")
    >>> round(ku, 9), round(tu / math.pi, 9)
    (4.0, 2.0)
    """
    plant = stable(Plant.of(plant))
    sign = sign_of(plant)
    w = plant.frequencies()
    value = sign * plant.response(w)
    cells = np.flatnonzero((np.sign(value.imag[:-1]) != np.sign(value.imag[1:])) & (value.real[:-1] < 0))
    best = Ultimate(math.inf, math.nan)
    for i in cells:
        at = root(lambda x: float((sign * plant.response(x)).imag), w[i], w[i + 1])
        real = float((sign * plant.response(at)).real)
        if real < 0 and -1 / real < best.ku:
            best = Ultimate(-1 / real, 2 * math.pi / at)
    if math.isinf(best.ku):
        raise InputError(
            "has no ultimate gain: its phase never passes −180°", parameter="plant", value=plant, bound="phase < −180°"
        )
    return Ultimate(sign * best.ku, best.tu)
