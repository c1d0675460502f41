"""Common description of a process for all files here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ..checked import check_one_of
from ..errors import InputError
from ..plant import Plant

Kind = Literal["PI", "PID"]
"""Controller without or with derivative part."""

Array = npt.NDArray[np.float64]

Process = Any
"""Process that `Plant.of` accepts."""


def stable(plant: Plant) -> Plant:
    """The process, refused where it is unstable or has two integrators."""
    if not plant.is_stable:
        raise InputError(
            "must be stable but for one integrator", parameter="plant", value=plant, bound="stable, or one integrator"
        )
    return plant


def sign_of(plant: Plant) -> float:
    """Sign of the static or velocity gain."""
    lowest = plant.gain if plant.gain is not None else plant.velocity_gain
    if not lowest:
        raise InputError(
            "has a static gain of 0, no integral action can control it", parameter="plant", value=plant, bound="≠ 0"
        )
    return plant.sign


def kind_of(kind: Kind) -> Kind:
    """The kind, refused where it is none."""
    check_one_of(kind, "kind", ("PI", "PID"))
    return kind


def root(function: Callable[[float], float], low: float, high: float) -> float:
    """Place at which a function changes its sign between two points, by halving."""
    negative = function(low) < 0
    for _ in range(48):
        middle = 0.5 * (low + high)
        if (function(middle) < 0) == negative:
            low = middle
        else:
            high = middle
    return float(0.5 * (low + high))
