"""Times and sizes of the monitor."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..errors import InputError

__all__ = ["NIGHT", "MonitorOptions"]

NIGHT = "the night"
"""Name of the person in the log for a fit of the night."""


@dataclass(frozen=True, slots=True)
class MonitorOptions:
    """Times and sizes of a monitor.

    - `period`: usual time between values of a PV, > 0 [s], where the loop's `sample_time` does not say another.
    - `wait`: how long a sample waits for values that come late, ≥ 0 [s].
    - `ahead`: how far ahead of our clock a source time may be, > 0 [s].
    - `lost`: the longest time between two signs of life of a loop, > 0 [s].
    - `step`: time between two entries, > 0 [s].
    - `save`: time between two saves of all states, > 0 [s].
    - `keep`: days for which signals and rejected half-periods are kept, ≥ 1.
    - `fit_days`: days that a fit looks back, ≥ 1.
    - `fit_hour`: local hour at which the fits of the night begin, 0..23.
    - `fit_longest`: how long a fit may take, > 0 [s]; then it is ended.
    - `backlog`: most entries that wait in memory while the store cannot be written, ≥ 1; beyond it they are given up.
    - `watchdog_test`: how long a watchdog test waits for the plant to take u_FF away, > 0 [s].
    """

    period: float = 1.0
    wait: float = 2.0
    ahead: float = 60.0
    lost: float = 15.0
    step: float = 1.0
    save: float = 300.0
    keep: int = 30
    fit_days: int = 7
    fit_hour: int = 2
    fit_longest: float = 600.0
    backlog: int = 600
    watchdog_test: float = 300.0

    def __post_init__(self) -> None:
        for name in ("period", "step", "save", "lost", "ahead", "fit_longest", "watchdog_test"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"is {value}, must be > 0 s", parameter=name, value=value, bound="> 0 s")
        if not (math.isfinite(self.wait) and self.wait >= 0):
            raise InputError(f"is {self.wait}, must be >= 0 s", parameter="wait", value=self.wait, bound=">= 0 s")
        for name in ("keep", "fit_days", "backlog"):
            value = getattr(self, name)
            if value < 1:
                raise InputError(f"is {value}, must be 1 or more", parameter=name, value=value, bound=">= 1")
        if not 0 <= self.fit_hour <= 23:
            hour = self.fit_hour
            raise InputError(f"is {hour}, must be 0 to 23", parameter="fit_hour", value=hour, bound="0..23")
