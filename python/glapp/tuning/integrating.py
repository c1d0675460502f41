"""Integrators with dead time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..checked import check_number
from ..errors import InputError
from ..plant import Plant
from .process import Process


@dataclass(frozen=True, slots=True)
class Integrating:
    """Integrator with dead time, Kv·e^(−L·s)/s.

    Attributes
    ----------
    kv : float
        Velocity gain Kv [process value per output and s], ≠ 0.
    l : float
        Dead time L [s], ≥ 0.

    Raises
    ------
    InputError
        For a number out of its bounds.
    """

    kv: float
    l: float  # noqa: E741

    def __post_init__(self) -> None:
        check_number(self.kv, "kv", lambda x: x != 0, "other than 0")
        check_number(self.l, "l", lambda x: x >= 0, "0 s or greater")

    @property
    def plant(self) -> Plant:
        """The model as a process."""
        return Plant([self.kv], [1.0, 0.0], self.l)


def integrating(plant: Process) -> Integrating:
    """Integrator with dead time that a process with one integrator becomes in the long run.

    After a unit step y → Kv·(t − L): L is the dead time and all lags, less the zeros' lead.

    Parameters
    ----------
    plant : process
        One integrator, otherwise stable.

    Examples
    --------
    >>> integrating("P1")
    Integrating(kv=1.0, l=1.0)
    """
    plant = Plant.of(plant)
    kv = plant.velocity_gain
    if kv is None or not plant.is_stable:
        raise InputError(
            "must have one integrator and otherwise be stable", parameter="plant", value=plant, bound="one integrator"
        )
    corners = np.concatenate([-1 / plant.poles[plant.poles != 0], 1 / plant.zeros[plant.zeros != 0]])
    l = plant.dead_time + float(corners.sum().real)  # noqa: E741
    if l < -1e-12:
        raise InputError(
            f"leads by {-l:.4g} s in the long run, must lag", parameter="plant", value=plant, bound="L ≥ 0"
        )
    return Integrating(kv, max(l, 0.0))
