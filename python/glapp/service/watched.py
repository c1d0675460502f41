"""One loop under watch: its newest values, its detector, its compensation and its last answer."""

from __future__ import annotations

import asyncio
import json
import math
from array import array
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimate import Estimator
from ..loop import Loop
from .compensation import Compensator
from .resampler import CODES, Resampler, Sample
from .settable import bounds_of, check, compensation_settings, with_settings
from .signal import Signal, Value

__all__ = ["NEEDED", "Health", "WatchedLoop", "loop_with"]

NEEDED = (Signal.PV, Signal.SP, Signal.OP)
"""Signals without which a loop cannot be judged."""

_FIELDS = len(Sample._fields)


class Health(IntEnum):
    """Health of a loop's valve by NAMUR NE 107, in the names and numbers of OPC UA's DeviceHealthEnumeration.

    - `NORMAL`: no dead band was found, or all of it is acceptable; also where no fit could decide.
    - `FAILURE`: u_FF in the plant is not 0 though it had to be by now, and the service cannot take it away. A dead band
      alone is no failure: the valve still works.
    - `CHECK_FUNCTION`: the loop cannot be watched now: no value came yet, its connection is lost, a tag of SP, PV
      or OP is missing, or PV is bad. Also where its answers were set aside with a damaged database and no fit has
      answered since.
    - `OFF_SPEC`: never used.
    - `MAINTENANCE_REQUIRED`: the last fit found backlash or stiction, more than what is acceptable where that is known.
    """

    NORMAL = 0
    FAILURE = 1
    CHECK_FUNCTION = 2
    OFF_SPEC = 3
    MAINTENANCE_REQUIRED = 4


@dataclass(slots=True)
class WatchedLoop:
    """A loop under watch.

    - `loop`: with what persons have set.
    - `id`: its number in the store.
    - `period`: usual time between values of PV, > 0 [s].
    - `resampler`: makes samples of its values.
    - `detector`: None where K and Ti are not known.
    - `plant_limits`: the greatest |u_FF| and rate that the plant takes [OP unit, OP unit per s]; None without a node
      for u_FF.
    - `half_periods`: how many half-periods the detector found.
    - `entry_ids` (array of int): of each sample that is not on disk yet, the number of the entry that made it.
    - `samples` (array of float): those samples, one after another.
    - `latest`: the newest value of each signal.
    - `missing`: tags that the server does not give, each with the reason.
    - `lost`: whether nothing came yet, or the connection was lost since.
    - `pv_age`: how old the newest PV was when it came, by its time stamp [s].
    - `alive_entered`: the last sign of life that was entered in the journal [s since 1970 UTC].
    - `compensator`: computes u_FF; None where the loop cannot be compensated.
    - `pv_came`: wakes the thread that computes u_FF.
    - `u_ff_time`: source time of the PV from which u_FF was last computed [s since 1970 UTC].
    - `u_ff_stuck`: whether u_FF in the plant is not 0 though it had to be by now.
    - `watchdog_tested`: whether a watchdog test is under way: its u_FF is for the plant to take away.
    - `answer`: the last answer of a fit, a row of `Reader.answers`.
    """

    loop: Loop
    id: int
    period: float
    resampler: Resampler
    detector: Estimator | None
    plant_limits: tuple[float, float] | None = None
    half_periods: int = 0
    entry_ids: array[int] = field(default_factory=lambda: array("q"))
    samples: array[float] = field(default_factory=lambda: array("d"))
    latest: dict[Signal, Value] = field(default_factory=dict)
    missing: dict[Signal, str] = field(default_factory=dict)
    lost: bool = True
    pv_age: float | None = None
    alive_entered: float = -math.inf
    compensator: Compensator | None = None
    pv_came: asyncio.Event = field(default_factory=asyncio.Event)
    u_ff_time: float = -math.inf
    u_ff_stuck: bool = False
    watchdog_tested: bool = False
    answer: dict[str, Any] | None = None

    def take(self, value: Value, now: float) -> None:
        """Take a new value of one of its signals, which came at `now` [s since 1970 UTC]."""
        newest = self.latest.get(value.signal)
        if newest is None or value.time >= newest.time:
            self.latest[value.signal] = value
        self.missing.pop(value.signal, None)
        if value.signal is Signal.PV:
            self.lost, self.pv_age = False, now - value.time
        if self.compensator is not None:
            self.compensator.take(value, now)
            if self.compensator.fresh_pv:
                self.pv_came.set()

    def restore_latest(self, now: float) -> None:
        """Take each signal's last value before the start as the present one: a server does not send it again."""
        for signal, code in CODES.items():
            last = self.resampler.latest(code)
            if last is None:
                continue
            value = Value(self.loop.name, signal, *last, "")
            self.latest[signal] = value
            if self.compensator is not None and signal not in (Signal.PV, Signal.U_FF):
                self.compensator.take(value, now)

    def unsaved(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Samples that are not on disk yet, a row each, and the number of the entry that made each: copies."""
        # Sliced first: nothing may be added to an array while another thread looks at it.
        samples = np.frombuffer(self.samples[:], np.float64).reshape(-1, _FIELDS)
        return np.frombuffer(self.entry_ids[:], np.int64), samples

    def forget_saved(self, count: int | None = None) -> None:
        """Drop the first `count` of the samples that were not on disk; all of them where no number is given."""
        count = len(self.entry_ids) if count is None else count
        del self.entry_ids[:count], self.samples[: count * _FIELDS]

    def state(self) -> str:
        """Resampler and detector as JSON, from which the next start goes on."""
        detector = None if self.detector is None else self.detector.save()
        return json.dumps({"rows": self.resampler.save(), "number": self.half_periods, "detector": detector})

    def health(self, *, answers_lost: bool) -> Health:
        """NE 107: whether the loop can be watched, and the last answer on the valve.

        - `answers_lost`: whether the answers were set aside with a damaged database: then no answer does not mean that
          all is well.
        """
        pv, answer = self.latest.get(Signal.PV), self.answer
        if self.u_ff_stuck:
            return Health.FAILURE
        missing = any(signal in self.missing for signal in NEEDED)
        if self.lost or missing or pv is None or not pv.good or (answers_lost and answer is None):
            return Health.CHECK_FUNCTION
        return Health.NORMAL if answer is None or answer["health"] is None else Health[answer["health"]]


def loop_with(
    given: Loop,
    settings: Mapping[str, Any],
    period: float,
    plant_limits: tuple[float, float] | None,
    changed: Collection[str] = (),
) -> tuple[Loop, Compensator | None]:
    """The loop with what persons have set, and its compensation; None where it cannot be compensated.

    All settings are checked against their bounds. Of several that are out of bounds, the error names one in `changed`.

    Raises InputError with the parameter, its value and its bounds.
    """
    alone = bounds_of(given, {}, None)
    for name, bound in alone.items():
        if settings.get(name) is not None:
            check(name, settings[name], bound, given.name)
    loop = with_settings(given, settings)
    if plant_limits is None or loop.controller is None:
        return loop, None
    of_compensation = compensation_settings(settings)
    bounds = bounds_of(loop, of_compensation, plant_limits)
    for name in sorted(of_compensation, key=lambda name: name not in changed):
        if of_compensation[name] is not None:
            check(name, of_compensation[name], bounds[name], given.name)
    return loop, Compensator(loop, period, of_compensation, *plant_limits)
