"""Loops put together from control modules, as in a control system (thesis chapter 6).

A `Graph` is a few named modules and the wires between them, checked when it is made. It runs in simulation, or sample
by sample next to a real plant; every parameter and variable of every module can be read and set while it runs, a gain
schedule by `Graph.schedule` and `Graph.set_schedule`. A default is read as what is in force, a parameter that is not
known as None.

Over a connection goes more than a value. Forward go value and quality; backward go limits, whether something further on
has reached its lower or upper limit, and the value in effect where the one handed over is not followed. So a controller
knows when a valve, or a slave of its slave, is at its end: its integral stops, and the detector in it rejects the
half-period (7.1). `docs/modules.md` has the picture of one scan.

Examples
--------
The system of 6.5, a gap of 2.0 %, with the detector inside the controller:

>>> loop = Graph(
...     0.05,
...     {
...         "sp": Input(50.0),
...         "pid": PidAdvanced(k=2.0, ti=1.5, tf=0.05, low=0, high=100, kp=1.0, start=50.0),
...         "gap": Backlash(2.0),
...         "load": Input(),
...         "process": ProcessSim(gain=1.0, t1=1.0, t2=0.5, start=50.0),
...         "noise": Noise(0.02),
...     },
...     ["sp -> pid.sp", "pid -> gap -> process -> noise -> pid.pv", "load -> process.load"],
... )
>>> loop.run(10.0, record=["pid.out", "noise"])["noise"].shape
(200,)
>>> loop["pid.k"] = 1.8  # while it runs, without a bump
>>> loop["pid.mode"] = Mode.MANUAL
>>> loop["pid.manual"] = 55.0
>>> loop.scan(sp=51.0)
>>> loop["pid.out"]
55.0
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from numbers import Real
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from . import _glapp
from .arrays import column
from .checked import check_number
from .errors import InputError
from .plant import Plant as _Plant

__all__ = [
    "AutoTuner",
    "Backlash",
    "BacklashDetection",
    "Delay",
    "Filter2P",
    "Flag",
    "Friction",
    "FrictionModel",
    "Graph",
    "Input",
    "Mode",
    "Module",
    "Noise",
    "Output",
    "PhaseLead",
    "Pid",
    "PidAdvanced",
    "Plant",
    "ProcessSim",
    "Push",
    "RateLimit",
    "Resolution",
    "Saturation",
    "Source",
    "Stiction",
    "Sum",
    "TuneRule",
    "Unfit",
    "Way",
]

_MOST = float(np.finfo(np.float64).max)
_MOST_SCANS = 10**8  # of a run, as of a simulation


class Mode(enum.IntEnum):
    """Source of a controller's output, `"pid.mode"`.

    Attributes
    ----------
    MANUAL
        A person, through `"pid.manual"`.
    AUTO
        The controller, with its own setpoint `"pid.sp"`.
    EXTERNAL
        The controller, with the setpoint that is connected to it; where one is, it begins so.
    """

    MANUAL = 0
    AUTO = 1
    EXTERNAL = 2


class Way(enum.IntEnum):
    """Method by which a compensation finds the direction of the valve (2.2).

    Attributes
    ----------
    ERROR
        sign(e)·sign(K), the thesis' own.
    DERIVATIVE
        sign(du_f/dt).
    INVERSE
        Reversals of the output that exceed a noise band.
    """

    ERROR = 1
    DERIVATIVE = 2
    INVERSE = 3


class Source(enum.IntEnum):
    """Source of the width that a compensation takes its share of (6.4), `comp_source`.

    Attributes
    ----------
    TYPED
        `comp_size`: a person typed it.
    FITTED
        `comp_fitted`: the lower limit of a fit whose verdict is backlash.
    ESTIMATE
        The on-line estimate as it is when `"compensate"` is set; later it may only fall.
    """

    TYPED = 1
    FITTED = 2
    ESTIMATE = 3


class Unfit(enum.IntEnum):
    """Why the on-line estimate may not be compensated by, `"watch.unfit"`; 0: it may. The first that holds.

    Attributes
    ----------
    NO_DETECTION
        There is none yet.
    CONTRADICTED
        A fit contradicts it: `comp_fitted` is 0, no gap.
    PROVISIONAL
        There are fewer than `n` detections.
    NOISE
        It is below the noise limit.
    CRUDE
        It was worked out with a Kp that is a default, or behind a filter of PV longer than Ti/2.
    """

    NO_DETECTION = 1
    CONTRADICTED = 2
    PROVISIONAL = 3
    NOISE = 4
    CRUDE = 5


class TuneRule(enum.IntEnum):
    """Controller that the autotuner in a `PidAdvanced` offers (`docs/auto_tuner.md`).

    Attributes
    ----------
    POINT_PLACEMENT
        PID with Ti = 6.25·Td (thesis 7.5).
    AMIGO_PI, AMIGO_PID
        AMIGO from ultimate gain, ultimate period and κ: refused where κ was not found.
    """

    POINT_PLACEMENT = 1
    AMIGO_PI = 2
    AMIGO_PID = 3


class FrictionModel(enum.IntEnum):
    """Friction of a valve, by model (`docs/simulator.md`).

    Attributes
    ----------
    KANO
        Once loose, the stem follows until its input stops or turns.
    HE
        It sticks again at every sample.
    KARNOPP
        A stem with mass on a spring of rate 1 (w = 8 rad/s), with static friction (s + j)/2 and Coulomb friction
        (s − j)/2.
    """

    KANO = 1
    HE = 2
    KARNOPP = 3


class Flag(enum.IntFlag):
    """Bits of `flags` and `error`; the same numbers as everywhere in glapp.

    Attributes
    ----------
    NOT_AUTO
        The value is not followed; `tracking` is in effect.
    BAD
        A value is bad: not a number, or flagged so.
    AT_LOW, AT_HIGH
        Something further on is at its lower, upper limit (`MinReached`, `MaxReached`), or moves down, up as fast as it
        can.
    DATA_GAP
        The time since the last scan is not above 0, or longer than `max_h`.
    BAD_SP, BAD_FF
        The setpoint, the feed-forward is bad; the last good one is in effect.
    BAD_LIMITS
        Limits reported backward cross; the controller's own are in effect.
    WRONG_SIGN
        The gain has the wrong sign: the output has gone to its limit, and the process value runs away from the setpoint
        all the same; or, in a detector, the controller next to it goes the other way than its own k says.
    """

    NOT_AUTO = 1
    BAD = 2
    AT_LOW = 4
    AT_HIGH = 8
    DATA_GAP = 16
    BAD_SP = 32
    BAD_FF = 64
    BAD_LIMITS = 128
    WRONG_SIGN = 256


@dataclass(frozen=True)
class Module:
    """A module before it is in a graph. Its bounds are checked when the graph is made."""

    _also: ClassVar[tuple[str, ...]] = ()

    @property
    def kind(self) -> str:
        """Name of the kind."""
        return type(self).__name__

    @property
    def parameters(self) -> list[tuple[str, float]]:
        """Name and value of each parameter that is given."""
        given = [(field.name, getattr(self, field.name)) for field in fields(self) if field.name not in self._also]
        return [(name, self._number(name, value)) for name, value in given if value is not None]

    def _number(self, name: str, value: Any) -> float:
        """A parameter as a number; its bounds are the graph's to check."""
        try:
            return float(value)
        except (TypeError, ValueError, OverflowError):
            what = f"is {value!r}, must be a number"
            raise InputError(what, parameter=f"{self.kind}: {name}", value=value, bound="a number") from None

    @property
    def plant(self) -> tuple[list[float], list[float], float] | None:
        """Transfer function of a `Plant`."""
        return None

    @property
    def schedule(self) -> Sequence[tuple[float, float, float, float]]:
        """Gain schedule of a `PidAdvanced`."""
        return ()


@dataclass(frozen=True)
class Input(Module):
    """A value from outside: a measurement, a setpoint, a load. Not a number is a bad value.

    What is reported backward to it can be read: `low`, `high`, `flags`, `tracking`.

    Parameters
    ----------
    value : float
        What it holds until it is handed something else.
    """

    value: float = 0.0


@dataclass(frozen=True)
class Output(Module):
    """A value to outside, `value`.

    What the world there reports backward can be set: `low`, `high`, `flags`, `tracking`.
    """


@dataclass(frozen=True)
class Noise(Module):
    """Uniform noise added to a signal (6.2).

    Parameters
    ----------
    amplitude : float
        The noise lies within ± amplitude, ≥ 0.
    seed : int
        0..2³² − 1; used when the graph is made.
    """

    amplitude: float
    seed: int = 1


@dataclass(frozen=True)
class Sum(Module):
    """The sum of its inputs `in` and `plus`: noise or a correction on a signal.

    The range that one signal leaves is reported to the other.
    """


@dataclass(frozen=True)
class Resolution(Module):
    """Steps of a converter: the nearest multiple of `step`, halves upwards.

    Parameters
    ----------
    step : float
        ≥ 0, 0 for none [unit of the input].
    """

    step: float


@dataclass(frozen=True)
class Delay(Module):
    """Communication that takes its time: a value, with its quality, arrives some scans later. It may close a loop.

    Parameters
    ----------
    scans : int
        1..10000.
    start : float
        What comes in the first scans.

    Examples
    --------
    >>> late = Graph(1.0, {"x": Input(), "late": Delay(2), "y": Output()}, ["x -> late -> y"])
    >>> [float(y) for y in late.run(4, x=[1.0, 2.0, 3.0, 4.0], record=["y"])["y"]]
    [0.0, 0.0, 1.0, 2.0]
    """

    scans: int
    start: float = 0.0


@dataclass(frozen=True)
class Backlash(Module):
    """A gap (6.3).

    Parameters
    ----------
    d : float
        Total width, ≥ 0 [unit of the input].
    start : float, optional
        Its output at the beginning; its first input where not given.
    """

    d: float
    start: float | None = None


@dataclass(frozen=True)
class Friction(Module):
    """A valve that sticks and slips.

    Parameters
    ----------
    s : float
        Dead band plus stick band, ≥ 0 [unit of the input].
    j : float
        Slip jump, 0 ≤ j ≤ s. With j = 0 it is a gap of width s.
    model : FrictionModel
    start : float, optional
        Position of the stem at the beginning; its first input where not given.
    """

    s: float
    j: float
    model: FrictionModel = FrictionModel.KANO
    start: float | None = None


@dataclass(frozen=True)
class Saturation(Module):
    """End positions of an actuator: the signal is kept within them, and the limits are reported backward.

    Parameters
    ----------
    low, high : float
        Limits, low < high.
    """

    low: float
    high: float


@dataclass(frozen=True)
class RateLimit(Module):
    """Speed of an actuator: the signal moves by at most so much a second.

    Parameters
    ----------
    rate : float
        > 0 [unit of the signal per second].
    reports : bool
        Whether it reports to the modules before it while it holds the signal back. A valve without a feedback of its
        position does not.
    start : float, optional
        Its output at the beginning; its first input where not given.
    """

    rate: float
    reports: bool = True
    start: float | None = None


@dataclass(frozen=True)
class Filter2P(Module):
    """Second-order low-pass filter 1/(1 + s·Tf)² (6.5); starts again after a bad value.

    Parameters
    ----------
    tf : float
        Time constant, ≥ 0 [s].
    """

    tf: float


@dataclass(frozen=True)
class PhaseLead(Module):
    """Phase-lead compensator (1 + s·lead)/(1 + s·lag), against the limit cycle of a gap (2.2).

    `glapp.nonlinear.phase_lead` designs it. It is between controller and valve, or before the controller's `pv`.
    Static gain 1, so what comes to rest is not moved; a step shows (lead + h)/(lag + h) times as high, be it a
    person's or noise. A graph is refused in which u_FF works in its loop, or an autotuner's relay goes through it. A
    bad value leaves its output where it is.

    Parameters
    ----------
    lead, lag : float
        Time constants, lead ≥ lag > 0 [s]; equal ones pass the signal on.
    start : float, optional
        Where it rests at the beginning; at its first input where not given.

    Examples
    --------
    >>> modules = {"op": Input(50.0), "lead": PhaseLead(lead=3.0, lag=1.0), "valve": Output()}
    >>> valve = Graph(1.0, modules, ["op -> lead -> valve"])
    >>> valve.scan()
    >>> valve.scan(op=51.0)
    >>> valve["valve"]
    52.0
    """

    lead: float
    lag: float
    start: float | None = None


@dataclass(frozen=True)
class ProcessSim(Module):
    """Process gain/((1 + s·t1)(1 + s·t2))·e^(−dead_time·s) with a load at its input (6.5).

    Known bias: a lag of T acts like one of about T + h/2. `Plant` is exact.

    Parameters
    ----------
    gain : float
        Static gain, ≠ 0.
    t1, t2 : float
        Lags, ≥ 0 [s].
    dead_time : float
        ≥ 0, at most 1022 scans [s].
    start : float
        Process value at which it rests in the beginning.
    h : float, optional
        Scan time that it is made for [s]; a graph with another one is refused.
    """

    gain: float
    t1: float
    t2: float = 0.0
    dead_time: float = 0.0
    start: float = 0.0
    h: float | None = None


@dataclass(frozen=True)
class Plant(Module):
    """An exact plant of any order, with a load at its input.

    Parameters
    ----------
    process : Plant, str, tuple
        Whatever `glapp.plant.Plant.of` takes.
    start : float
        Process value at which it rests in the beginning.
    h : float, optional
        Scan time that it is made for [s]; a graph with another one is refused.
    """

    _also = ("process",)

    process: object
    start: float = 0.0
    h: float | None = None

    @property
    def plant(self) -> tuple[list[float], list[float], float]:
        """Transfer function."""
        num, den, dead_time = _Plant.of(self.process)
        return list(num), list(den), dead_time


@dataclass(frozen=True)
class Pid(Module):
    """PI or PID controller in ideal form (4.1); `series` and `parallel` convert the other forms.

    u = K·(b·ysp − yf + (1/Ti)·∫(ysp − yf) dt + Td·d(c·ysp − yf)/dt) + u_FF

    Parameters
    ----------
    k : float
        Gain, ≠ 0; negative for a direct-acting controller [output per process value].
    ti, td : float
        Integral time > 0, derivative time ≥ 0 [s].
    b, c : float
        Setpoint weights of the proportional and the derivative part, 0..1.
    tf : float
        Time constant of its second-order measurement filter, ≥ 0 [s].
    low, high : float
        Limits of the output; narrower ones that are reported backward count.
    rate : float
        The fastest that the output moves, > 0 [output per second].
    max_h : float, optional
        A longer time between scans is a gap, > 0 [s]; Ti/2 where not given.
    start : float
        Where the output begins.
    start_pv : float, optional
        The process value, and setpoint, at which the loop rests at the beginning with that output. Where not given, the
        first scan takes what it finds as the beginning.

    Examples
    --------
    >>> Pid.series(k=2.0, ti=8.0, td=2.0).ti
    10.0
    >>> Pid.parallel(kp=2.0, ki=0.25, kd=1.0).td
    0.5
    """

    k: float
    ti: float
    td: float = 0.0
    b: float = 1.0
    c: float = 0.0
    tf: float = 0.0
    low: float = -_MOST
    high: float = _MOST
    rate: float = _MOST
    max_h: float | None = None
    start: float = 0.0
    start_pv: float | None = None

    @classmethod
    def series(cls, k: float, ti: float, td: float = 0.0, **others: float) -> Self:
        """Series form k·(1 + 1/(s·ti))·(1 + s·td); `others` are the class's other parameters."""
        return cls._of(_glapp.ideal_of_series, (k, ti, td), others)

    @classmethod
    def parallel(cls, kp: float, ki: float, kd: float = 0.0, **others: float) -> Self:
        """Parallel form kp + ki/s + kd·s; `others` are the class's other parameters."""
        return cls._of(_glapp.ideal_of_parallel, (kp, ki, kd), others)

    @classmethod
    def _of(
        cls,
        ideal: Callable[[float, float, float], tuple[float, float, float]],
        gains: tuple[float, float, float],
        others: Mapping[str, float],
    ) -> Self:
        """A controller with gains in another form."""
        with _input_errors():
            k, ti, td = ideal(*gains)
        return cls(k=k, ti=ti, td=td, **others)


@dataclass(frozen=True, kw_only=True)
class _Compensating(Module):
    comp_size: float = 0.0
    comp_fitted: float | None = None
    comp_source: Source | None = None
    comp_way: Way = Way.INVERSE
    comp_share: float = 1.0
    comp_limit: float | None = None
    comp_band: float | None = None
    comp_tf: float = 0.0
    comp_rate: float | None = None
    comp_release: float | None = None
    comp_watch: float | None = None
    comp_travel: float | None = None
    comp_reversals: float | None = None
    comp_withdraw: bool = True
    comp_estimate: bool = True


@dataclass(frozen=True)
class PidAdvanced(_Compensating, Pid):
    """A `Pid` with detector and autotuner inside, a setpoint ramp and a gain schedule (6.4, 6.6, 7.1, 7.2.2).

    The detector takes the controller's settings and sees what it sees: setpoint in effect, filtered process value,
    limits and mode. Where `tf` is 0 the detector filters, with Td/5, or Ti/10 without D. Read `d_hat`, `count`
    (detections behind it), `noise_floor` (the noise limit: below it `d_hat` and `whole` are NaN, and `count` is
    0), `detections` (in all), and of the last half-period `d` and `reason` (0: accepted). `error` says too that k has
    the wrong sign for the process, where `low` and `high` are given. `corrected_d` is the width with the bias of (2.4)
    taken out, NaN where `corrected_doubt` says why not. `docs/modules.md` explains these and all inner variables.

    The autotuner is that of `AutoTuner`: `"pid.tune"` = 1 begins an experiment and 0 ends it, `tune_phase` and
    `tune_stop` show how far it is, `tune_ku`, `tune_tu`, `tune_kappa` what it found. Once it is done, `tune_k`,
    `tune_ti` and `tune_td` are the controller that it offers (NaN: none), and `Graph.take_over` puts that in force.
    The Kp that it found, `tune_kp`, is the detector's at once, where `kp` is not given.

    Parameters
    ----------
    k, ti, td, b, c, tf, low, high, rate, max_h, start, start_pv : float
        As in `Pid`.
    kp : float, optional
        Static process gain, ≠ 0: from a fit, a step test [process value per output]. Set it while it runs when it
        becomes known.
    pv_span, op_span : float, optional
        Spans of process value and output, > 0 [their units]. Where both are given and `kp` is not, Kp is 1.5 %/% with
        the sign of k (7.2.2): `kp_used` shows it, `kp_defaulted` is 1, and nothing is compensated by such an estimate.
        No Δu as large as `op_span` is a gap's; that of the limits where it is not given.
    integrating : bool
        The process integrates: it has no Kp, and no corrected width.
    detector_tf : float, optional
        Time constant of a filter of the detector's own, ≥ 0 [s], for the process value as measured; `comp_way` and
        `error` see it as they would without. Where not given, the detector sees what the controller sees. Behind a
        filter longer than Ti/2, also the controller's, nothing is compensated by the estimate (8.4).
    n : int
        Length of the filter of detections, odd, 1..31.
    sp_rate : float
        The fastest that the setpoint in effect moves, > 0 [PV unit per second].
    schedule : sequence of (at, k, ti, td)
        Gains by the signal connected to `by`, linear between the rows; at most 8, `at` ascending, k of one sign. The
        width is then taken from the output's own travel. `Graph.set_schedule` edits it while it runs.
    comp_size, comp_fitted, comp_source, comp_way, comp_share, comp_limit, comp_band, comp_tf
        Compensation, as in `BacklashDetection`; it takes at most half of `rate`. Under a schedule its defaults go
        by the longest Ti of the rows.
    comp_rate, comp_release, comp_watch, comp_travel, comp_reversals, comp_withdraw, comp_estimate
        Likewise.
    tune_amplitude : float
        The greatest distance of the output from where it was in an experiment, negative where PV falls when the output
        rises; 0: there is no autotuner. With one, `low` and `high` must be given.
    tune_wait, tune_longest, tune_pv_low, tune_pv_high, tune_relay_hysteresis, tune_d : float, optional
        As in `AutoTuner`; the first four must be given with an amplitude.
    tune_rule : TuneRule
        Which controller is offered.
    """

    _also = ("schedule",)

    kp: float | None = None
    pv_span: float | None = None
    op_span: float | None = None
    integrating: bool = False
    detector_tf: float | None = None
    n: int = 9
    sp_rate: float = _MOST
    schedule: Sequence[tuple[float, float, float, float]] = ()
    tune_amplitude: float = 0.0
    tune_wait: float | None = None
    tune_longest: float | None = None
    tune_pv_low: float | None = None
    tune_pv_high: float | None = None
    tune_relay_hysteresis: float | None = None
    tune_d: float = 0.0
    tune_rule: TuneRule = TuneRule.POINT_PLACEMENT


@dataclass(frozen=True)
class AutoTuner(Module):
    """Relay experiment between a controller and its valve: `in` from the controller, `pv` on a branch of its PV.

    `"tuner.run"` = 1 begins one and 0 ends it; `"tuner.phase"` (0 idle, 1 waiting, 2 balanced, 3 biased, 4 done,
    5 aborted), `"tuner.stop"`, `"tuner.ku"`, `tu`, `kp` and `kappa` tell. Meanwhile the controller tracks the relay and
    goes on from there without a bump; a limit reached further on, a bad PV or somebody else at the output end it.

    Parameters
    ----------
    amplitude : float
        The greatest distance of the output from where it was, ≠ 0; negative where PV falls when the output rises.
    wait, longest : float
        Length of the waiting phase and of the whole experiment, 0 < wait < longest [s].
    pv_low, pv_high : float
        PV outside ends it.
    op_low, op_high : float
        Limits of the output.
    relay_hysteresis : float, optional
        Half width of the relay's hysteresis, ≥ 0; half of PV's range in the waiting phase where not given.
    d : float
        Total width of the gap that the valve is known to have, ≥ 0 and less than 4/3 of the amplitude.
    max_h : float, optional
        A longer time between scans ends it, > 0 [s]; three scan times where not given.
    """

    amplitude: float
    wait: float
    longest: float
    pv_low: float
    pv_high: float
    op_low: float
    op_high: float
    relay_hysteresis: float | None = None
    d: float = 0.0
    max_h: float | None = None


@dataclass(frozen=True)
class BacklashDetection(_Compensating):
    """The detector next to a controller (6.4). Connect its output to the controller's `ff`: the flags come back there.

    Where a width is given it compensates as soon as `"compensate"` is set to 1. Read `u_ff`, `standing` (0: it
    compensates, else why not), `source` (the `Source` of the width; 0: none), `unfit` (why the estimate is none),
    `size`, the width that it goes by, `delta`, what is left of its share after the noise band, `left`, what stays
    uncompensated of `size`, `over` (1: code block 7.1 warns, 2: the relay), `whole`, the estimate of the whole gap
    while `d_hat` shows what is left, `noise_floor`, the noise limit (below it `d_hat` and `whole` are NaN, and
    `count` is 0), and `error` (`Flag.WRONG_SIGN`). Connect `pv` before any filter: noise that is filtered off is not
    heard.

    Next to a controller that is no module here (figure 6.3), connect `flags`: the sum of 1 (not in automatic), 2 (bad),
    4 and 8 (something in the loop is at its lower, upper limit). `op`, its output, and `u_ff`, the value at its
    feed-forward read back, may stay open; without `op` nothing is compensated. The output of a scan is made of the
    inputs of that scan (`docs/modules.md`).

    Parameters
    ----------
    k, ti, td, b : float
        Settings of the controller in ideal form.
    kp : float, optional
        Static process gain, ≠ 0.
    pv_span, op_span, integrating
        As in `PidAdvanced`.
    tf : float, optional
        Time constant of the detector's filter, ≥ 0 [s]; Td/5, or Ti/10 without D, where not given. 0 where the process
        value comes filtered.
    n : int
        Length of the filter of detections, odd, 1..31.
    op_low, op_high : float, optional
        Limits of the output.
    max_h : float, optional
        A longer time between scans is a gap, > 0 [s]; three scans where not given.
    ff_delay : int
        Next to a controller that is no module here: how many scans after the one in which it is made `op` holds u_FF,
        1..32.
    ff_tolerance : float, optional
        How far the u_FF read back may be from what was handed over, ≥ 0 [unit of the output]; a tenth of the width
        where not given.
    ff_longest : float, optional
        The longest delay with which it may be enabled, as a share of Ti, ≥ 0; a scan always may. Where not given: 0.2
        for `Way.INVERSE` and `Way.ERROR`, a scan alone for `Way.DERIVATIVE`.
    comp_size : float
        Width of the gap, entered by hand, ≥ 0, within the range of the output [unit of the output]; 0: none.
    comp_fitted : float, optional
        Lower limit of the fit whose verdict is backlash, ≥ 0 [unit of the output]; 0: the fit found no gap, and the
        on-line estimate is contradicted.
    comp_source : Source, optional
        Which width counts; where not given that of the fit, and without a fit the typed one. With neither there is no
        compensation. With `Source.ESTIMATE` band and time from side to side go by the estimate: `comp_band` is the
        least band, `comp_rate` the greatest rate.
    comp_way : Way
        How the direction is found.
    comp_share : float
        Share of it to compensate, 0..1.
    comp_limit : float, optional
        Greatest width, ≥ share·size, within the range of the output; the size where not given, none for the estimate.
    comp_band : float, optional
        `Way.INVERSE`: how far the output must go back before that is a reversal, ≥ 0, within the range of the output; a
        fifth of the size where not given.
    comp_tf : float
        Time constant of a filter of the output before its direction is found, ≥ 0, ≤ 10 Ti [s].
    comp_rate : float, optional
        Greatest rate, > 0 [unit of the output per s]; where not given the inverse goes from side to side of its
        share in Ti/10, the others jump.
    comp_release : float, optional
        Time in which it is taken away, > 0, ≤ 10 Ti and ≤ 300 [s]; Ti where not given, or 300 s where that is shorter.
    comp_watch : float, optional
        Time over which the loop is compared with what it was before, > 0, ≤ 10⁵ Ti [s]; 300 Ti where not given.
    comp_travel, comp_reversals : float, optional
        Budgets in any hour [unit of the output; 1]; none where not given.
    comp_withdraw : bool
        Whether it is withdrawn when the relay warns, and where the loop is worse than before.
    comp_estimate : bool
        Whether the on-line estimate may lower the size.
    """

    k: float
    ti: float
    td: float = 0.0
    b: float = 1.0
    kp: float | None = None
    pv_span: float | None = None
    op_span: float | None = None
    integrating: bool = False
    tf: float | None = None
    n: int = 9
    op_low: float | None = None
    op_high: float | None = None
    max_h: float | None = None
    ff_delay: int = 1
    ff_tolerance: float | None = None
    ff_longest: float | None = None


class Push(enum.IntEnum):
    """Method by which `Stiction` pushes a valve that sticks (`docs/compensation.md`).

    Attributes
    ----------
    KNOCKER
        Pulses, towards where the output has gone since the one before.
    REINFORCEMENT
        A constant towards where the output goes.
    TWO_MOVES
        One that breaks the stem loose and one back, where PV stays off SP.

    Examples
    --------
    >>> Push.TWO_MOVES.name
    'TWO_MOVES'
    """

    KNOCKER = 1
    REINFORCEMENT = 2
    TWO_MOVES = 3


@dataclass(frozen=True)
class Stiction(Module):
    """Pushes for a valve that sticks. Connect its output to the controller's `ff`: OP and its flags come back there.

    It pushes as soon as `"compensate"` is set to 1, with the next push that begins. Read `u_ff`, `standing` (0: it
    compensates, else why not, as of `BacklashDetection`) and `direction`.

    Parameters
    ----------
    push : Push
        How it is pushed.
    k, ti : float
        Settings of the controller in ideal form; the sign of `k` counts for `Push.TWO_MOVES` alone.
    size : float
        Height of a push, ≥ 0 [unit of the output].
    limit : float, optional
        Greatest height, ≥ size [unit of the output]; the size where not given.
    hold : float, optional
        Length of a pulse, or of each of two moves, > 0, ≤ 10 Ti [s]; where not given Ti/10, of two moves Ti.
    period : float, optional
        Time from one push to the next, ≥ 2 hold, ≤ 1000 Ti [s]; where not given Ti/5, of two moves 10 Ti.
    band : float, optional
        How far the output must go before that is a direction, ≥ 0 [unit of the output]; a tenth of the size where not
        given.
    far : float
        Two moves: how far PV must be off SP, ≥ 0 [unit of PV].
    rate : float, optional
        Greatest rate, > 0 [unit of the output per s]; none where not given.
    release : float, optional
        Time in which it is taken away, > 0, ≤ 10 Ti and ≤ 300 [s]; Ti where not given, or 300 s where that is shorter.
    travel : float, optional
        Budget in any hour, > 0 [unit of the output]; none where not given.
    watch : float, optional
        Time over which the loop is compared with what it was before, > 0, ≤ 10⁵ Ti [s]; 300 Ti where not given.
    withdraw : bool
        Whether it is withdrawn where the loop is worse than before.
    op_low, op_high : float, optional
        Limits of the output.
    """

    push: Push
    k: float
    ti: float
    size: float
    limit: float | None = None
    hold: float | None = None
    period: float | None = None
    band: float | None = None
    far: float = 0.0
    rate: float | None = None
    release: float | None = None
    travel: float | None = None
    watch: float | None = None
    withdraw: bool = True
    op_low: float | None = None
    op_high: float | None = None


class Graph:
    """A loop of modules.

    Parameters
    ----------
    h : float
        Scan time, > 0 [s].
    modules : mapping of name to module
    wires : sequence of str
        Each from output to input, through any number of modules: `"pid -> gap -> process -> noise -> pid.pv"`. The last
        input is named where the module has more than one.

    Raises
    ------
    InputError
        For a parameter out of its bounds; an input or output that leads nowhere, or an input that two modules drive; a
        circle without a `ProcessSim` or `Plant` in it; modules made for another scan time; and a detector where it
        cannot work: in the outer loop of a cascade (8.3), or at an output with several valves. The error names the
        modules.

    Examples
    --------
    >>> Graph(0.1, {"pv": Input(), "pid": Pid(k=1.0, ti=5.0)}, ["pv -> pid.pv"])
    Traceback (most recent call last):
    glapp.errors.InputError: pid, its output, is open: connect it

    Next to a real plant there is nothing but the controller, its measurements and its valve:

    >>> loop = Graph(
    ...     1.0,
    ...     {"pv": Input(), "sp": Input(40.0), "pid": PidAdvanced(k=0.5, ti=20.0, start=30.0), "valve": Output()},
    ...     ["pv -> pid.pv", "sp -> pid.sp", "pid -> valve"],
    ... )
    >>> loop.scan(pv=38.0)
    >>> loop.scan(pv=37.9, h=1.1)  # the time that has really passed
    >>> round(loop["valve"], 4)
    30.1578
    >>> loop.scan(pv=float("nan"))  # a sensor that fails: the output is held
    >>> round(loop["valve"], 4), Flag(int(loop["pid.error"]))
    (30.1578, <Flag.BAD: 2>)
    """

    def __init__(self, h: float, modules: Mapping[str, Module], wires: Sequence[str]) -> None:
        if not isinstance(modules, Mapping):
            bound = "names with their modules: {'pid': Pid(k=1.0, ti=5.0), …}"
            raise InputError(f"is {modules!r}, must be {bound}", parameter="modules", value=modules, bound=bound)
        for name, module in modules.items():
            if not isinstance(module, Module):
                raise InputError(f"is {module!r}, must be a module", parameter=name, value=module, bound="a module")
        if isinstance(wires, str):
            bound = "a list of wires: ['sp -> pid.sp', …]"
            raise InputError(f"is {wires!r}, must be {bound}", parameter="wires", value=wires, bound=bound)
        with _input_errors():
            self._graph = _glapp.Graph(_number("h", h), list(modules.items()), list(wires))

    @property
    def h(self) -> float:
        """Scan time [s]."""
        return self._graph.h

    @property
    def t(self) -> float:
        """Time of the coming scan, had all come at the scan time [s]."""
        return self._graph.scans * self._graph.h

    def scan(self, *, h: float | None = None, **inputs: float) -> None:
        """One scan.

        Parameters
        ----------
        h : float, optional
            The time since the last scan where it is not the scan time [s]. A simulated process moves on by its own scan
            time all the same.
        **inputs : float
            A value for each `Input` that changes; not a number for a bad one.
        """
        for name, value in inputs.items():
            self[f"{name}.value"] = value
        self._graph.scan(self.h if h is None else _number("h", h))

    def run(
        self, t: float, *, record: Sequence[str] = (), **inputs: npt.ArrayLike
    ) -> dict[str, npt.NDArray[np.float64]]:
        """Run for `t` seconds.

        Parameters
        ----------
        t : float
            How long, ≥ 0 [s]; as many scans as fit in.
        record : sequence of str
            What to record: `"gap"` for a module's output, `"pid.error"` for a variable.
        **inputs : array
            A value a scan for each `Input` that changes; not a number, or masked, for a bad one.

        Returns
        -------
        dict of array
            A value a scan for each that is recorded, and `"t"`, the time [s].

        Raises
        ------
        InputError
            For more than 10⁸ scans, a name that is not there, or values that are no numbers, or not one a scan.
        """
        most = _MOST_SCANS * self.h
        t = check_number(t, "t", lambda x: 0 <= x <= most, f"0 to {most:g} s, which is 10⁸ scans")
        n = math.floor(t / self.h + 1e-9)
        begin = self._graph.scans
        values = [(name, _numbers(name, x)) for name, x in inputs.items()]
        with _input_errors():
            columns = self._graph.record(n, values, list(record))
        t_of_scans: npt.NDArray[np.float64] = np.arange(begin, begin + n).astype(np.float64) * self.h
        return {"t": t_of_scans, **dict(zip(record, columns, strict=True))}

    def schedule(self, module: str) -> list[tuple[float, float, float, float]]:
        """Rows (at, k, ti, td) of the gain schedule in a `PidAdvanced`; none: its own gains are used."""
        with _input_errors():
            return self._graph.schedule(module)

    def set_schedule(self, module: str, rows: Sequence[tuple[float, float, float, float]]) -> None:
        """Set the gain schedule of a `PidAdvanced`, all rows at once, while it runs and without a bump.

        Parameters
        ----------
        module : str
        rows : sequence of (at, k, ti, td)
            As `PidAdvanced` takes them; none: its own gains are used from now on.

        Raises
        ------
        InputError
            For a row out of its bounds, which it names with value and bound. The schedule stays as it was.

        Examples
        --------
        >>> loop = Graph(
        ...     1.0,
        ...     {"pv": Input(), "pid": PidAdvanced(k=0.5, ti=20.0), "valve": Output()},
        ...     ["pv -> pid.pv", "pv -> pid.by", "pid -> valve"],
        ... )
        >>> loop.set_schedule("pid", [(20, 0.5, 20, 0), (60, 0.8, 15, 0)])
        >>> loop.set_schedule("pid", [(60, 0.8, 15, 0), (20, 0.5, 20, 0)])
        Traceback (most recent call last):
        glapp.errors.InputError: pid: at of row 2 = 20: must be a number greater than in the row before
        >>> loop.schedule("pid")
        [(20.0, 0.5, 20.0, 0.0), (60.0, 0.8, 15.0, 0.0)]
        """
        with _input_errors():
            self._graph.set_schedule(module, rows)

    def take_over(self, module: str) -> None:
        """Put the controller in force that the autotuner in a `PidAdvanced` offers: K, Ti and Td, without a bump.

        The half-period under way ends as a *gap*: no width can be read across two controllers.

        Parameters
        ----------
        module : str

        Raises
        ------
        InputError
            Before an experiment has come to its end; where the rule has no answer for what it found; under a gain
            schedule. All then stays as it was.

        Examples
        --------
        >>> tank = Graph(
        ...     0.1,
        ...     {
        ...         "sp": Input(50.0),
        ...         "pid": PidAdvanced(
        ...             k=1.0, ti=10.0, low=0, high=100, start=62.5, start_pv=50.0,
        ...             tune_amplitude=5.0, tune_wait=10.0, tune_longest=400.0, tune_pv_low=40.0, tune_pv_high=60.0,
        ...             tune_rule=TuneRule.AMIGO_PI,
        ...         ),
        ...         "process": ProcessSim(gain=0.8, t1=3.0, t2=1.0, dead_time=1.0, start=50.0),
        ...     },
        ...     ["sp -> pid.sp", "pid -> process -> pid.pv"],
        ... )
        >>> tank["pid.tune"] = 1
        >>> _ = tank.run(200.0)
        >>> f"K {tank['pid.tune_k']:.2f}, Ti {tank['pid.tune_ti']:.2f} s, Kp {tank['pid.tune_kp']:.2f}"
        'K 1.05, Ti 3.14 s, Kp 0.80'
        >>> tank.take_over("pid")
        >>> tank["pid.ti"] == tank["pid.tune_ti"]
        True
        """
        with _input_errors():
            self._graph.take_over(module)

    def reset_detection(self, module: str) -> None:
        """Make the detector in a module forget its detections."""
        with _input_errors():
            self._graph.reset_detection(module)

    def window(self, module: str) -> list[float]:
        """Detections behind the estimate of a detector, the oldest first [unit of the output].

        Examples
        --------
        >>> loop = Graph(
        ...     1.0,
        ...     {"pv": Input(), "sp": Input(), "pid": PidAdvanced(k=0.5, ti=2.0, kp=1.0), "valve": Output()},
        ...     ["pv -> pid.pv", "sp -> pid.sp", "pid -> valve"],
        ... )
        >>> loop.run(60, pv=np.where(np.arange(60) // 12 % 2, 1.0, -1.0))["t"].size
        60
        >>> [round(d, 2) for d in loop.window("pid")]
        [1.87, 1.87]
        """
        with _input_errors():
            return self._graph.window(module)

    def __getitem__(self, path: str) -> Any:
        with _input_errors():
            return self._graph.get(path)

    def __setitem__(self, path: str, value: float | None) -> None:
        number = None if value is None else _number(path, value)
        with _input_errors():
            self._graph.set(path, number)

    def __iter__(self) -> Iterator[str]:
        """All names that can be read."""
        return iter(self._graph.names())


def _number(name: str, value: Any) -> float:
    """A number, not a number for a bad value included."""
    if isinstance(value, Real | np.ndarray):
        try:
            return float(value)
        except (TypeError, ValueError):  # an array of several
            pass
    raise InputError(f"is {value!r}, must be a number", parameter=name, value=value, bound="a number")


def _numbers(name: str, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """The values of an input, one a scan."""
    try:
        found: npt.NDArray[np.float64] = column(values)
    except (TypeError, ValueError) as error:
        raise InputError(f"is not numbers: {error}", parameter=name, value=values) from None
    if found.ndim != 1 or np.ndim(values) != 1:
        raise InputError("is no array, must have one value a scan", parameter=name, value=values)
    return found


@contextmanager
def _input_errors() -> Iterator[None]:
    try:
        yield
    except (ValueError, TypeError) as error:
        raise InputError(str(error)) from None
