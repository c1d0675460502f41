"""Skogestad's half rule."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..plant import Plant
from .process import Kind, Process, kind_of, stable


def half_rule(plant: Process, kind: Kind = "PI") -> tuple[float, float, float, float]:
    """Skogestad's half rule: a process with real poles as one lag (PI) or two lags (PID) and a dead time.

    Lags that are left out become dead time, but for half of the largest of them, which lengthens the last one kept;
    zeros in the right half plane become dead time.

    Parameters
    ----------
    plant : process
        Stable or with one integrator, its poles real, its zeros real and in the right half plane.
    kind : {"PI", "PID"}
        One lag is kept, or two.

    Returns
    -------
    (gain, t, t2, l) : float
        Kp, or Kv with an integrator, for which t is infinite; lags t and t2 ≥ 0 and dead time l [s]. For PI t2 is 0.
        For PID half of a lag that is left out may make t2 the longer one.

    Examples
    --------
    >>> half_rule("P2")
    (1.0, 1.5, 0.0, 2.5)
    >>> half_rule("P2", "PID")
    (1.0, 1.0, 1.5, 1.5)
    """
    plant = stable(Plant.of(plant))
    kind = kind_of(kind)
    poles, zeros = plant.poles, plant.zeros
    # A multiple real pole is found as a small ring around it.
    if np.any(np.abs(poles.imag) > 0.05 * np.abs(poles)):
        raise InputError(
            "has complex poles, the half rule needs real ones",
            parameter="plant",
            value=plant,
            bound="real poles",
            hint="give the rule a model: fotd(plant)",
        )
    if np.any(zeros.real <= 0) or np.any(np.abs(zeros.imag) > 0.05 * np.abs(zeros)):
        raise InputError(
            "has zeros that are not real and in the right half plane",
            parameter="plant",
            value=plant,
            bound="real zeros > 0",
            hint="give the rule a model: fotd(plant)",
        )
    gain = plant.gain if plant.gain is not None else plant.velocity_gain
    assert gain is not None
    lags = [math.inf] * (plant.integrators == 1) + sorted(_mean_lags(poles[poles != 0]), reverse=True)
    kept = 1 if kind == "PI" else 2
    lags += [0.0] * (kept + 1 - len(lags))
    rest = lags[kept:]
    lags[kept - 1] += rest[0] / 2
    l = plant.dead_time + sum(rest) - rest[0] / 2 + float(np.sum(1 / zeros).real)  # noqa: E741
    return gain, lags[0], lags[1] if kind == "PID" else 0.0, l


def _mean_lags(poles: npt.NDArray[np.complex128]) -> list[float]:
    """Lags of real poles; those that rounding spread around a multiple pole are replaced by their mean."""
    if not poles.size:  # an integrator alone
        return []
    lags: list[float] = []
    ordered = np.sort(-poles.real)
    for group in np.split(ordered, np.flatnonzero(np.diff(ordered) > 0.1 * ordered[1:]) + 1):
        lags += [1 / float(np.round(group.mean(), 12))] * group.size
    return lags
