"""Loops and detectors that several figures share. The thesis counts everything in parts of the span; figures in %."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from glapp import _glapp
from glapp.controller import Ideal
from glapp.result import HalfPeriods
from glapp.scenario import Scenario
from glapp.simulate import Simulation, run

__all__ = [
    "NET",
    "PERCENT",
    "Condition",
    "Cycle",
    "Detected",
    "detect",
    "limit_cycle",
    "rounded",
    "safety_net_loop",
    "short",
]

Floats = npt.NDArray[np.float64]

PERCENT = 100.0

Condition = Literal["saturation", "5Ti", "5.2", "decay", "growth", "5.5", "5.1"]
"""Conditions on a half-period, by their equations; "decay" is (5.3) and, with "growth", makes (5.4)."""

SWITCHES: dict[Condition, str] = {
    "saturation": "limits",
    "5Ti": "too_short",
    "5.2": "not_square",
    "decay": "decaying",
    "growth": "growing",
    "5.5": "sp_moved",
    "5.1": "too_small",
}
"""All of them, with the detector's names."""

NET = tuple(SWITCHES)


@dataclass(frozen=True, slots=True)
class Detected:
    """Results of a detector: its half-periods, and the filtered process value."""

    half_periods: HalfPeriods
    filtered: Floats

    @property
    def accepted(self) -> npt.NDArray[np.bool_]:
        """Whether each half-period became a detection."""
        return np.asarray(self.half_periods.mask == 0)

    @property
    def t(self) -> Floats:
        """Times of the detections [s]."""
        return self.half_periods.t_end[self.accepted]

    @property
    def d(self) -> Floats:
        """Widths of the detections [%]."""
        return PERCENT * self.half_periods.d[self.accepted]

    @property
    def d_hat(self) -> float | None:
        """Estimate at the end, whether above the noise limit or not [%]."""
        last = self.half_periods.median_mean[-1:]
        return PERCENT * float(last[0]) if np.isfinite(last).any() else None


def detect(
    scenario: Scenario,
    signals: Simulation,
    conditions: tuple[Condition, ...] = NET,
    *,
    tf: float | None = None,
    kp: float | None = None,
    n: int = _glapp.DETECTIONS,
    derivative: bool = False,
) -> Detected:
    """Run the detector as the thesis does: on SP and PV alone, with a part of its conditions.

    - `scenario`, `signals`: the loop and what it did; the controller's settings are known to the detector.
    - `conditions`: the others are off.
    - `tf`, `kp`: filter time [s] and static gain of the process; those of the scenario where not given.
    - `n`: detections behind an estimate, odd.
    - `derivative`: whether the derivative part is counted, as in (7.6), or left out, as in (7.5).
    """
    k, ti, td, b = scenario.ideal()
    detector = _glapp.Detector(
        {
            "k": k,
            "ti": ti,
            "td": td if derivative else None,
            "b": b,
            "kp": scenario.process_gain() if kp is None else kp,
            "tf": scenario.filter_time() if tf is None else tf,
            "n": n,
            "h": scenario.h,
            "op_limits": scenario.limits,
            "off": [name for condition, name in SWITCHES.items() if condition not in conditions],
        }
    )
    filtered = detector.run_closely(signals.t, signals.sp, signals.pv, None, signals.flags)
    return Detected(HalfPeriods(**detector.table()), filtered)


def safety_net_loop(**changes: Any) -> Scenario:
    """P3 with the PI controller of section 5.2, a gap of 5 %, steps of setpoint and load at 1 and 100 s.

    Noise, sample time and size of the load step are not in the thesis; these give all its facts. A load step of 100 %
    gives the detection of over 100 %, noise of ± 0.07 % at h = 0.01 s the change from backlash to noise about 550 s.
    With Tf = Ti/10 as in (2.1) every half-period is less than 2/3 as high as the one before, so that (5.3) would reject
    the true ones too; with 0.15 Ti it rejects what the thesis says.
    """
    fields: dict[str, Any] = {
        "plant": "P3",
        "controller": (0.48, 0.3117),
        "d": 0.05,
        "tf": 0.15 * 0.3117,
        "noise": 0.0007,
        "setpoint": [(0.0, 0.0), (1.0, 1.0)],
        "load": [(100.0, 1.0)],
        "h": 0.01,
        "t_end": 1000.0,
        "seed": 8,
    }
    return short(**fields | changes)


def short(**fields: Any) -> Scenario:
    """A scenario from the short forms of its fields, with b = 0 (4.1) and the filter (2.1) in the loop."""
    if isinstance(fields["controller"], tuple):
        fields["controller"] = (*fields["controller"], 0.0, 0.0)[:4]
    return Scenario(**fields, filter_in_loop=True)


def rounded(controller: Ideal) -> Ideal:
    """K, Ti, Td to three digits: as a person would type them in, and the same on every machine."""
    return Ideal(*(float(f"{x:.3g}") for x in controller))


class Cycle(NamedTuple):
    """A simulated oscillation: period [s], and half of what OP swings."""

    period: float
    amplitude: float


def limit_cycle(plant: str, controller: Ideal, d: float, period: float) -> Cycle:
    """The oscillation that a gap keeps up without noise; `period` [s] is what is expected of it."""
    scenario = short(
        plant=plant, controller=controller, d=d, load=[(0, 0), (1.0, d)], h=period / 1000, t_end=60 * period
    )
    signals = run(scenario)
    late = signals.t > 30 * period
    up = np.flatnonzero((signals.pv[:-1] < 0) & (signals.pv[1:] >= 0) & late[1:])
    times = signals.t[up]
    return Cycle(float(times[-1] - times[0]) / (len(times) - 1), float(np.ptp(signals.op[late])) / 2)
