"""Width of the gap with an interval, from OP and PV by maximum likelihood; the derivation is in docs/fit.md."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _glapp
from .controller import Ideal
from .loop import Loop
from .position import COPY, Interval, position_reason
from .progress import Progress, shares
from .recording import Batch, Recording
from .samples import recording_of

__all__ = ["Fit", "Process", "Trend", "Window", "fit", "fit_batches", "history", "process_sign"]

Verdict = Literal["backlash", "stiction", "both", "oscillation", "sound", "at_least", "cannot_tell"]

ROWS = _glapp.LONG_HISTORY
"""A recording with fewer rows is fitted as a whole; a longer one in windows spread over its length."""

DAY = 86400.0
"""[s]."""

SAMPLES_IN_LAG, _ = _glapp.fit_thresholds()["SAMPLES_IN_LAG"]
"""Samples that a process must take to settle, where it matters."""

SAMPLES_IF_SOUND, _ = _glapp.fit_thresholds()["SAMPLES_IN_LAG_IF_SOUND"]
"""The same for a valve to be called sound."""


@dataclass(frozen=True, slots=True)
class Process:
    """What the best model says of the process between valve and PV: each value with its lower and upper 95 % limit.

    Attributes
    ----------
    kp : (float, float, float)
        Static gain [PV unit/OP unit]; of an integrating process its velocity gain [PV unit/(OP unit·s)].
    dead_time : (float, float, float)
        Dead time [s].
    lag : (float, float, float)
        Lags together [s].
    integrating : bool
        Whether it integrates.
    """

    kp: tuple[float, float, float]
    dead_time: tuple[float, float, float]
    lag: tuple[float, float, float]
    integrating: bool


@dataclass(frozen=True, slots=True)
class Window:
    """One window's answer: its time [s since the recording's first row], verdict, width and limits [OP unit]."""

    t_start: float
    t_end: float
    verdict: Verdict
    d: float
    low: float
    high: float | None
    lr_no_gap: float

    @property
    def sided(self) -> bool:
        """Whether it has a width with a limit on either side."""
        return self.verdict in ("backlash", "stiction", "both") and self.high is not None


@dataclass(frozen=True, slots=True)
class Trend:
    """How the width changed from window to window.

    Attributes
    ----------
    slope, error : float
        Change of the width and its standard error [OP unit/day].
    windows : int
        Windows with a width that it stands on.
    t, d : (float, float)
        From when to when [s since the recording's first row], and the line's widths there [OP unit].
    changes : bool
        Whether it is plain that the width changes: five windows or more, and three standard errors.
    """

    slope: float
    error: float
    windows: int
    t: tuple[float, float]
    d: tuple[float, float]
    changes: bool

    def sentence(self, unit: str) -> str:
        """The same in words."""
        week, error = 7.0 * abs(self.slope), 7.0 * 1.96 * self.error
        return (
            f"it {'grew' if self.slope > 0 else 'shrank'} from {self.d[0]:.3g} to {self.d[1]:.3g} {unit} in "
            f"{(self.t[1] - self.t[0]) / DAY:.3g} days, by {week:.2g} a week ({week - error:.2g} to {week + error:.2g})"
        )


@dataclass(frozen=True, slots=True, repr=False)
class Fit:
    """Width of the gap with an interval, and what kind of lost motion it is.

    Attributes
    ----------
    verdict : str
        *backlash*, *stiction* (sticks and jumps, no gap beside), *both*, *oscillation* (a clean sinusoid, beside which
        no gap shows), *sound* (no gap wider than `high`), *at_least* (wider than `low`; OP did not go through the whole
        of it often enough, or PV's noise hides how much wider), *cannot_tell*.
    reason : str
        One sentence with the evidence.
    d : float or None
        Most likely total width at the actuator's input [`unit`]; None where nothing could be fitted.
    low, high : float or None
        Limits of its 95 % interval [`unit`]; `high` None where the recording gives none.
    unit : str
        Unit of OP.
    lr_no_gap, lr_needed : float or None
        Likelihood ratio −2·Δln L of no gap against the best width, and what it must exceed.
    jump : float
        Slip jump J [`unit`]; 0 for mere backlash.
    process : Process or None
        The process.
    trend : Trend or None
        Change of the width in time, from three windows or more. Where it is plain that the width changes, verdict, d
        and limits are those of the newest window that gave a width; else they are those of all windows together.
    windows : list of Window
        The windows of the recording that were fitted.
    best : dict
        Everything the clearest window's fit has to tell, as the core gives it, with the time `t` of each cell and the
        `signal` that was fitted: "PV", or "position" where the valve's own settled it.
    why : str
        The word for the evidence; `reason` is its sentence.
    through_pv : Fit or None
        Where the valve's position was recorded and settled the answer, what PV alone would have said. The process is
        always that of PV. Where no width lies in the intervals of both, `reason` names both: with a gap in either the
        interval holds both, and with a gap in one of them alone the verdict is *cannot_tell*.
    """

    verdict: Verdict
    reason: str
    unit: str
    d: float | None = None
    low: float | None = None
    high: float | None = None
    lr_no_gap: float | None = None
    lr_needed: float | None = None
    jump: float = 0.0
    process: Process | None = None
    trend: Trend | None = None
    windows: list[Window] = field(default_factory=list)
    best: dict[str, Any] = field(default_factory=dict)
    why: str = ""
    through_pv: Fit | None = None

    def __repr__(self) -> str:
        if self.d is None:
            return f"<Fit: {self.verdict}, {self.reason}>"
        high = "no upper limit" if self.high is None else f"{self.high:.4g}"
        return f"<Fit: {self.verdict}, {self.d:.4g} {self.unit} ({self.low:.4g} to {high})>"

    @property
    def found(self) -> bool:
        """Whether a lost motion was found: backlash, stiction, both, or at least a bound of it."""
        return self.verdict in ("backlash", "stiction", "both", "at_least")

    @property
    def interval(self) -> Interval | None:
        """The widths that are not excluded [`unit`], upper limit None where there is none; None where nothing is."""
        if self.low is None or not (self.found or self.verdict == "sound"):
            return None
        return (0.0, self.high) if self.verdict == "sound" else (self.low, None if self.at_least else self.high)

    @property
    def at_least(self) -> float | None:
        """The width's lower limit where that is all that can be said [`unit`]."""
        return self.low if self.verdict == "at_least" else None

    @property
    def compensable(self) -> float | None:
        """The width that a compensation may trust: the lower limit, with the verdict backlash and no other [`unit`]."""
        return self.low if self.verdict == "backlash" else None

    def to_dict(self) -> dict[str, Any]:
        """The answer in plain types, as `glapp analyze --json` writes it."""
        p = self.process
        return {
            "d": self.d,
            "low": self.low,
            "high": self.high,
            "unit": self.unit,
            "at_least": self.at_least,
            "verdict": self.verdict,
            "jump": self.jump,
            "lr_no_gap": self.lr_no_gap,
            "lr_needed": self.lr_needed,
            "process": None
            if p is None
            else {
                "kp": list(p.kp),
                "dead_time": list(p.dead_time),
                "lag": list(p.lag),
                "integrating": p.integrating,
            },
            "signal": self.best.get("signal", "PV"),
            "trend": None if self.trend is None else [self.trend.slope, self.trend.error],
            "windows": [
                {"t_start": w.t_start, "t_end": w.t_end, "verdict": w.verdict, "d": w.d, "low": w.low, "high": w.high}
                for w in self.windows
            ],
            "reason": self.reason,
        }


def fit(
    recording: Recording | None = None,
    *,
    t: ArrayLike | None = None,
    pv: ArrayLike | None = None,
    op: ArrayLike | None = None,
    position: ArrayLike | None = None,
    flags: ArrayLike | None = None,
    loop: Loop | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit the gap to a recording of OP and PV: OP → lost motion → dead time → lags → PV, under load and noise.

    The answer is the likelihood as a function of the width d, for several families of process and disturbance; the
    interval holds those of all that predict PV about as well as the best. Mode and setpoint do not matter: any move
    of OP tells. A process gain of known sign (from `loop.process.kp` or the controller's action) helps. Where the
    valve's position is recorded it is fitted by itself, and if it tells, it settles the answer.

    Parameters
    ----------
    recording : Recording
        From `glapp.recording_from` or `glapp.open_recordings`, of any length. Of more than half a million rows a
        dozen windows are fitted at most, spread over the whole length, each the most telling of its epoch. Or, in its
        place:
    t, pv, op, position, flags : array[n]
        Samples: time [s] or datetime64; process value [PV unit], controller output [OP unit], the valve's measured
        position [%]; sum of 1 not in automatic, 2 bad, 4 OP at its low, 8 at its high limit. NaN is a bad value.
    loop : Loop
        Settings that go with samples.
    progress : callable, optional
        Told the share of the windows that are done.

    Returns
    -------
    Fit

    Notes
    -----
    Known bias: where OP was recorded more coarsely than the controller runs, its turning points are missed, and the
    width reads low by a few per cent under a load that moves all the time. A step of the load smaller than the gap is
    taken for part of a wandering load. `docs/fit.md` has the figures.

    Examples
    --------
    >>> import glapp
    >>> acting = {"setpoint": [(1, 1.0)], "load": [(50, 0.3), (100, -0.2)]}
    >>> sim = glapp.simulate.closed_loop("P3", (0.48, 0.3117), d=0.05, noise=0.005, h=0.1, t_end=200, seed=1, **acting)
    >>> answer = glapp.fit(t=sim.t, pv=sim.pv, op=sim.op)
    >>> answer.verdict, bool(answer.low < 0.05 < answer.high)
    ('backlash', True)
    """
    recording = recording_of(recording, loop, t=t, pv=pv, op=op, position=position, flags=flags)
    sign = process_sign(recording.loop, recording.loop.ideal())
    beginning = recording.beginning(ROWS)
    windows = history(beginning, sign)
    if windows is None:
        return fit_batches([beginning], recording.loop, sign, progress=progress)
    reading, fitting = shares(progress, 0.3, 0.7)
    for batch in recording.batches():
        windows.add(batch)
        if reading is not None:
            reading(recording.fraction_read())
    return fit_batches(windows.best(), recording.loop, sign, progress=fitting)


def history(beginning: Batch, sign: float) -> _glapp.Windows | None:
    """What chooses the windows of a recording that begins so; None where that is all of it."""
    return None if len(beginning) < ROWS else _glapp.Windows.of_history(beginning, sign)


def fit_batches(
    batches: list[Batch],
    loop: Loop,
    sign: float,
    *,
    refused: str | None = None,
    sinusoid: str | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit a stretch in memory, or the windows of a longer recording; `sign` is that of the process gain (0: not known).

    `refused` and `sinusoid` are what the look at the recording's quality found: a reason why nothing can be said, and
    that the loop swings in a clean sinusoid.
    """
    if refused is not None:
        return Fit("cannot_tell", refused, loop.op_label)
    if progress is not None:
        progress(0.0)
    found = _glapp.fit(batches, sign, sinusoid is not None)
    if progress is not None:
        progress(1.0)
    return told(found["answer"], found["pv"], found["position"], loop, sinusoid)


def told(
    answer: dict[str, Any],
    pv: dict[str, Any] | None,
    position: dict[str, Any] | None,
    loop: Loop,
    sinusoid: str | None = None,
) -> Fit:
    """Put what the core answered, with all that PV and the valve's position said, into words."""
    if pv is None:
        return Fit("cannot_tell", "OP stands still all the time: only an OP that moves shows a gap", loop.op_label)
    through_pv = _through_pv(pv, loop, sinusoid)
    if position is None:
        return through_pv
    return _together(answer, _at_valve(position, loop), through_pv, loop)


def _together(answer: dict[str, Any], at_valve: Fit, through_pv: Fit, loop: Loop) -> Fit:
    """Put into words what position and PV say together: the answer names both where they contradict each other."""
    if answer["position"] == "silent":
        return replace(through_pv, reason=f"{through_pv.reason}. The valve's position tells nothing: {at_valve.reason}")
    if answer["position"] == "bounds":
        return replace(through_pv, reason=f"{through_pv.reason}. By the valve's position {at_valve.reason}")
    reason = f"read from the valve's position: {at_valve.reason}"
    own = loop.positioner.dead_band if loop.positioner is not None else None
    if own is not None and at_valve.found:
        reason += f"; the positioner's own part of it, by its settings: {own:.3g} % of travel"
    if answer["position"] == "contradicts":
        said = f"The position: {at_valve.reason}. PV: {through_pv.reason}"
        reason = f"the valve's position and PV contradict each other. {said}"
        if answer["verdict"] == "cannot_tell":
            reason += ". Is the sensor coupled firmly to the valve, and the valve to what it moves?"
    decided = {name: answer[name] for name in ("verdict", "low", "high")}
    return replace(at_valve, **decided, reason=reason, process=through_pv.process, through_pv=through_pv)


def _at_valve(answer: dict[str, Any], loop: Loop) -> Fit:
    """What the valve's own position says, window by window where there are several."""
    unit = loop.op_label
    if "unfit" in answer:
        return Fit("cannot_tell", _unfit(answer["unfit"], "the position"), unit)
    best = _shown(answer, "position")
    best["candidates"] = [{"noise": "position", "behind": 0.0, "profile": best["profile"]}]
    shown, trend = "%OP" if unit == "%" else unit, _trend(answer)
    verdict, d, low, high = (answer[key] for key in ("verdict", "d", "low", "high"))
    reason = position_reason(verdict, d, low, high, shown, best) + _changed(trend, shown)
    needed = {name: best[name] for name in ("lr_no_gap", "lr_needed", "jump")}
    return Fit(
        verdict,
        reason,
        unit,
        d,
        low,
        high,
        **needed,
        trend=trend,
        windows=_windows(answer),
        best=best,
        why=best["reason"],
    )


def _through_pv(answer: dict[str, Any], loop: Loop, sinusoid: str | None) -> Fit:
    """What PV says."""
    unit = loop.op_label
    if "unfit" in answer:
        return Fit("cannot_tell", _unfit(answer["unfit"], "PV"), unit)
    best = _shown(answer, "PV")
    kp, dead_time, lag = ((best[name], *best[f"{name}_limits"]) for name in ("kp", "dead_time", "lag"))
    shown, trend = "%OP" if unit == "%" else unit, _trend(answer)
    return Fit(
        verdict=answer["verdict"] if sinusoid is None else "oscillation",
        reason=(sinusoid or _reason(answer, shown, best)) + _changed(trend, shown),
        unit=unit,
        d=answer["d"],
        low=answer["low"],
        high=answer["high"],
        lr_no_gap=answer["lr_no_gap"],
        lr_needed=answer["lr_needed"],
        jump=best["jump"],
        process=Process(kp, dead_time, lag, best["integrating"]),
        trend=trend,
        windows=_windows(answer),
        best=best,
        why=answer["reason"],
    )


def _shown(answer: dict[str, Any], signal: str) -> dict[str, Any]:
    """The window that shows best what all say, and which signal was fitted."""
    best: dict[str, Any] = answer["windows"][answer["shown"]]
    best["signal"] = signal
    return best


def _windows(answer: dict[str, Any]) -> list[Window]:
    names = ("t_start", "t_end", "verdict", "d", "low", "high", "lr_no_gap")
    return [Window(*(window[name] for name in names)) for window in answer["windows"]]


def _trend(answer: dict[str, Any]) -> Trend | None:
    """The same a day."""
    found = answer["trend"]
    return None if found is None else Trend(**found | {key: DAY * found[key] for key in ("slope", "error")})


def _changed(trend: Trend | None, unit: str) -> str:
    return f"; {trend.sentence(unit)}" if trend is not None and trend.changes else ""


def process_sign(loop: Loop, ideal: Ideal | None) -> float:
    """Sign of the process gain: as given, else the controller's (a loop that controls has both alike); 0: not known."""
    if (kp := loop.kp()) is not None:
        return float(np.sign(kp))
    return 0.0 if ideal is None else float(np.sign(ideal.k))


def _unfit(unfit: tuple[str, float], name: str) -> str:
    """Why nothing could be fitted, in one sentence; `name`: that of PV, or of what stood in its place."""
    why, number = unfit
    match why:
        case "no_op":
            return "there is no OP: the width cannot be fitted without it"
        case "few_rows":
            return f"{number:.0f} rows are too few: a fit needs 50 samples at least"
        case "op_missing":
            return "OP is missing in nearly all rows"
        case "op_still":
            return f"OP stands still at {number:.4g} all the time: only an OP that moves shows a gap"
        case "same":
            return f"OP and {name} are the same signal: check which columns were taken"
        case "pv_still":
            return f"{name} stands still at {number:.4g} all the time"
        case "coarse":
            return f"OP takes only {number:.0f} values: it is recorded too coarsely"
        case "broken":
            return "no 20 samples stand together without a hole"
        case "copy":
            return COPY
        case _ if name == "PV":
            return "fewer than 50 samples stand together, or OP does not move in them"
        case _:
            return "fewer than 50 rows have a position"


def _times(n: int) -> str:
    return {0: "never", 1: "once", 2: "twice"}.get(n, f"{n} times")


def _reason(answer: dict[str, Any], unit: str, best: dict[str, Any]) -> str:
    """The verdict and its evidence in one sentence: `answer` is that of all windows, `best` that of the one shown."""
    verdict, d, low, high, reason = (answer[key] for key in ("verdict", "d", "low", "high", "reason"))
    up, down = answer["traversals"]
    evidence = f"no gap is {answer['lr_no_gap']:.0f} units of 2·ln L worse, where {answer['lr_needed']:.0f} are needed"
    would = f"a gap of {d:.3g} {unit} would fit"
    often = f"OP went through it {_times(up)} up and {_times(down)} down"
    match verdict:
        case "backlash":
            return f"a gap of {d:.3g} {unit}: {evidence}; {often}"
        case "stiction":
            return f"the valve sticks and jumps by {best['jump']:.3g} {unit}, no gap beside it: {evidence}; {often}"
        case "both":
            return (
                f"lost motion of {d:.3g} {unit} with jumps of {best['jump']:.3g} {unit} in it: {evidence}, and no jump "
                f"{best['lr_no_jump']:.0f} worse; {often}"
            )
        case "at_least" if reason == "noisy":
            return (
                f"at least {low:.3g} {unit} are lost: {evidence}; {often}, but PV's noise hides how much more it is. "
                "Record with a finer PV, or while OP moves further"
            )
        case "at_least":
            return (
                f"at least {low:.3g} {unit} are lost: {evidence}; {often}, too seldom to tell how much more it is. "
                "Record while OP moves further"
            )
        case "sound":
            return f"no gap wider than {high:.3g} {unit} (95 %): PV answers each turn of OP"
        case _ if reason == "misfit":
            return (
                f"no model fits: what it does not foresee of PV is alike from one sample to the next (correlation "
                f"{best['echo']:.2f}). Is PV what this OP moves, and recorded as it was measured?"
            )
        case _ if reason == "coarse":
            return (
                f"{would}, but between samples {best['h']:.3g} s apart OP does what none of them shows: the process "
                f"lags by {best['settles']:.3g} s, and {SAMPLES_IN_LAG:.0f} samples are needed in that. Record faster"
            )
        case _ if reason == "windows_disagree":
            return (
                f"a gap of {d:.3g} {unit} would fit all of the recording best, but its parts disagree "
                f"{answer['dispersion']:.0f} times more than chance allows: fit a time in which nothing was changed"
            )
        case _ if reason == "still":
            return (
                f"{would}, but in it the valve hardly moves: one step of PV at a time and of a size that are free "
                "explains as much. Record while OP moves further"
            )
        case _ if reason == "once":
            return f"{would}, but OP goes through it one way only, once: record for longer, or while OP moves further"
        case _ if reason == "repeats":
            return (
                f"{would}, but so would a load that repeats itself with the cycle of this loop: find what swings there "
                "or record while the setpoint moves, on calmer days, or with the valve's position"
            )
        case _ if reason == "swings":
            return (
                f"{would}, but OP swings to and fro in almost even time, which no gap makes of this process: a load "
                "that swings so explains as much. Record while the setpoint moves or on calmer days, make a bump test "
                "or record the valve's position"
            )
        case _ if reason == "lined":
            return (
                f"{would}, but a historian kept only corners of PV and drew lines between them, which bend by as much. "
                "Record without compression"
            )
        case _ if reason == "hidden_by_samples":
            return (
                f"no gap shows, but the process settles in {best['settles']:.3g} s, and samples {best['h']:.3g} s "
                f"apart would not show one: {SAMPLES_IF_SOUND:.0f} are needed in that. Record faster, and PV before "
                "any filter"
            )
        case _ if reason == "hidden_by_lag":
            return (
                f"no gap shows, but only if the process lags by {best['lag']:.3g} s, longer than what was recorded: "
                "record for longer"
            )
        case _ if reason == "hidden_by_changes":
            return (
                f"no gap shows beside {best['load_steps']} steps or bends of the load, but OP turned no oftener than "
                "the load, and they may hide one. Record while the setpoint moves, or on calmer days"
            )
        case _ if reason == "no_answer":
            return (
                f"PV does not answer OP: a process that stands still explains PV as well ({best['lr_no_answer']:.0f} "
                "units of 2·ln L). Record while OP moves"
            )
        case _:
            most = "any width" if high is None else f"a gap of up to {high:.3g} {unit}"
            if low <= 0 or reason == "families_disagree":
                against = "next to none would as well"
            else:
                lr, needed = answer["lr_no_gap"], answer["lr_needed"]
                against = f"none is {lr:.0f} units of 2·ln L less likely ({needed:.0f} are needed)"
            return (
                f"{most} would fit, most likely {d:.3g} {unit}, but {against}: "
                "record for longer, or while OP moves further"
            )
