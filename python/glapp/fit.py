"""Width of the gap with an interval, from OP and PV by maximum likelihood; the derivation is in docs/fit.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _glapp
from ._glapp import to_text
from .controller import Ideal
from .errors import InputError
from .loop import Loop
from .progress import Progress, shares
from .recording import Batch, Recording, with_op_unit
from .repair_split import since_repair
from .samples import recording_of
from .valve import in_order, one_valve, since

__all__ = ["Fit", "Process", "RecordingFit", "Trend", "Window", "fit", "fit_batches", "fit_recordings", "history"]
__all__ += ["process_sign"]

Verdict = Literal["backlash", "stiction", "both", "oscillation", "sound", "at_least", "cannot_tell"]

Interval = tuple[float, float | None]
"""Lower and upper limit, None where there is no upper one."""

ROWS = _glapp.LONG_HISTORY
"""A recording with fewer rows is fitted as a whole; a longer one in windows spread over its length."""

DAY = 86400.0
"""[s]."""

JUDGED = ("confidence", "cause", "width_kind", "oscillates", "evidence")
"""Fields of the ladder's judgement on all windows together, and of its evidence."""


@dataclass(frozen=True, slots=True)
class Process:
    """Process between valve and PV by the best model: each value with its lower and upper 95 % limit.

    - `kp`: static gain [PV unit/OP unit]; of an integrating process its velocity gain [PV unit/(OP unit·s)].
    - `dead_time`: dead time [s].
    - `lag`: lags together [s].
    - `integrating`: whether it integrates.
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
class RecordingFit:
    """The fit of one of several recordings of a valve.

    - `source`: file name as the user wrote it, or "memory".
    - `t0`: time of its first row.
    - `fit`: answer from this recording alone.
    - `repeated`: share of its rows that an earlier recording holds too; their PV counts in the earlier one only.
    - `left_out`: why it does not count in the joint answer; None where it does.
    - `adds`: its part of the joint likelihood ratio of no gap.
    - `shown`: whether figures and windows are those of this recording.
    """

    source: str
    t0: datetime | None
    fit: Fit
    repeated: float
    left_out: str | None
    adds: float
    shown: bool


@dataclass(frozen=True, slots=True)
class Trend:
    """Trend of the width from window to window.

    - `slope`, `error`: change of the width and its standard error [OP unit/day].
    - `windows`: number of windows with a width.
    - `t`, `d`: begin and end of the line [s since the recording's first row], and its widths there [OP unit].
    - `changes`: whether the width clearly changes: five windows or more, and three standard errors.
    """

    slope: float
    error: float
    windows: int
    t: tuple[float, float]
    d: tuple[float, float]
    changes: bool


@dataclass(frozen=True, slots=True, repr=False)
class Fit:
    """Width of the gap with an interval, and what kind of lost motion it is.

    Attributes
    ----------
    verdict : str
        *backlash*, *stiction* (sticks and jumps, without a gap), *both*, *oscillation* (a clean sinusoid
        without a visible gap), *sound* (no gap wider than `high`), *at_least* (wider than `low`; OP did not
        move far enough to show how much), *cannot_tell*.
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
        Slip jump J [`unit`]; 0 for backlash alone.
    process : Process or None
        The process.
    trend : Trend or None
        Change of the width in time, from three windows or more. Where the width clearly changes, verdict, d
        and limits are those of the newest window that gave a width; else they are those of all windows together.
    windows : list of Window
        The windows of the recording that were fitted; of several recordings, those of the one that shows best.
    recordings : list of RecordingFit
        Where several recordings of one valve were given, each of them in the order of time, with its own answer.
    best : dict
        All results of the clearest window's fit, as the core gives them, with the time `t` of each cell and the
        `signal` that was fitted: "PV", or "position" where the valve's own settled it. Of PV also what all windows say
        together: `confidence` (*found*, *likely*, *cannot_tell* or *none_seen*), `cause` (*dead_band*, *stiction* or
        *both*), `width_kind` (*interval*, *bound* or *unsure*), `oscillates`, and the `evidence` for that.
    why : str
        Code of what decided, which stays the same; `reason` is its sentence.
    through_pv : Fit or None
        Where the valve's position was recorded and settled the answer, the answer from PV alone. The process is
        always that of PV. Where no width lies in the intervals of both, `reason` names both: with a gap in either the
        interval holds both, and with a gap in one of them alone the verdict is *cannot_tell*.
    message : dict or None
        `reason` of several recordings as a code with its numbers.
    change : dict or None
        The trend as the one answer has it (`glapp.result.Moves`).
    judgement : dict or None
        What the ladder says: `confidence`, `cause`, `width_kind`, `oscillates`; None where nothing could be fitted.
    weighed : dict or None
        The evidence for a dead band: `log_bayes_factor`, the `terms` that add to it, and `wider`: widths [`unit`] with
        the probability that the dead band is wider, if there is one. None where there is nothing to weigh.
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
    recordings: list[RecordingFit] = field(default_factory=list)
    best: dict[str, Any] = field(default_factory=dict)
    why: str = ""
    through_pv: Fit | None = None
    change: dict[str, Any] | None = None
    judgement: dict[str, Any] | None = None
    weighed: dict[str, Any] | None = None
    message: dict[str, Any] | None = None

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
        """The lower limit of a bound [`unit`]."""
        return self.low if self.verdict == "at_least" else None

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
            "recordings": [
                {
                    "file": r.source,
                    "t0": None if r.t0 is None else r.t0.isoformat(),
                    "repeated": r.repeated,
                    "left_out": r.left_out,
                    "adds": r.adds,
                    **{key: getattr(r.fit, key) for key in ("verdict", "d", "low", "high", "reason")},
                }
                for r in self.recordings
            ],
            "reason_code": self.why,
            "reason": self.reason,
        }


def fit(
    recording: Recording | Sequence[Recording] | None = None,
    *,
    t: ArrayLike | None = None,
    sp: ArrayLike | None = None,
    pv: ArrayLike | None = None,
    op: ArrayLike | None = None,
    position: ArrayLike | None = None,
    flags: ArrayLike | None = None,
    loop: Loop | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit the gap to a recording of OP and PV: OP → lost motion → dead time → lags → PV, under load and noise.

    The answer is the likelihood as a function of the width d, for several families of process and disturbance; the
    interval holds those of all that predict PV about as well as the best. The mode does not matter: any move of OP
    is used. The setpoint may be missing; one that moves shows that no load makes OP swing. A process gain of known sign
    (from `loop.process.kp` or the controller's action) helps. Where the valve's position is recorded it is fitted by
    itself, and if it shows a result, that is the answer.

    Parameters
    ----------
    recording : Recording or list of Recording
        From `glapp.recording_from` or `glapp.open_recordings`, of any length. Of more than half a million rows a
        dozen windows are fitted at most, spread over the whole length, each the most informative of its part. Several
        are of one valve: they get one answer, with the width that they share. Or, in its place:
    t, sp, pv, op, position, flags : array[n]
        Samples: time [s] or datetime64; setpoint and process value [PV unit], controller output [OP unit], position
        of the valve [%]; sum of 1 not in automatic, 2 bad, 4 OP at its low, 8 at its high limit. NaN, infinite
        or masked is a bad value.
    loop : Loop
        Settings that go with samples.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Fit

    Raises
    ------
    InputError
        Where neither or both are given, no recording, or recordings that differ in unit, span or controller.

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
    if isinstance(recording, Sequence):
        signals = {"t": t, "sp": sp, "pv": pv, "op": op, "position": position, "flags": flags}
        every = [recording_of(source, loop, **signals) for source in recording]
        if not every:
            raise InputError("holds no recording", parameter="recording")
        every = since_repair(every)
        if len(every) > 1:
            return fit_recordings(every, progress=progress)
        recording = every[0]
    given = recording_of(recording, loop, t=t, sp=sp, pv=pv, op=op, position=position, flags=flags)
    [recording] = since_repair([given])
    sign = process_sign(recording.loop, recording.loop.ideal())
    batches, fitting = _read(recording, sign, progress)
    return fit_batches(batches, with_op_unit(recording.loop, *batches), sign, progress=fitting)


def _read(recording: Recording, sign: float, progress: Progress | None) -> tuple[list[Batch], Progress | None]:
    """The recording in memory, or the windows of a longer one; and what is called with how far the fit is."""
    beginning = recording.beginning(ROWS)
    windows = history(beginning, sign)
    if windows is None:
        return [beginning], progress
    reading, fitting = shares(progress, 0.3, 0.7)
    for batch in recording.batches():
        windows.add(batch)
        if reading is not None:
            reading(recording.fraction_read())
    return windows.best(), fitting


def fit_recordings(
    recordings: Sequence[Recording],
    *,
    unfit: Sequence[tuple[Verdict, str, str] | None] | None = None,
    progress: Progress | None = None,
) -> Fit:
    """One answer of several recordings of one valve: the width is shared, everything else is each one's own.

    `unfit` is what a look at the quality of each found: a verdict, a finding's code and its sentence. Such a recording
    is not fitted.

    Raises InputError where they differ in unit, span, controller, process or positioner: which file, and which value.
    """
    one_valve(recordings)
    place = {id(recording): i for i, recording in enumerate(recordings)}
    recordings = in_order(recordings)
    ruled_out = [None if unfit is None else unfit[place[id(recording)]] for recording in recordings]
    loop = recordings[0].loop
    sign = process_sign(loop, loop.ideal())
    *reading, fitting = shares(progress, *[0.3 / len(recordings)] * len(recordings), 0.7)
    batches = [
        _read(recording, sign, progress_of)[0] if why is None else []
        for recording, progress_of, why in zip(recordings, reading, ruled_out, strict=True)
    ]
    starts = since(recordings)
    fitted = [pair for pair, why in zip(zip(starts, batches, strict=True), ruled_out, strict=True) if why is None]
    found: dict[str, Any] = {"pv": {"unfit": ("few", 0.0)}, "position": None}
    if fitted:
        found = _glapp.fit_valve(fitted, sign, fitting)
    decided = {name: found.get("answer", {}).get(name) for name in ("change", "judgement", "weighed")}
    loop = with_op_unit(loop, *(batch for parts in batches for batch in parts))
    through_pv = replace(_valve(found["pv"], recordings, ruled_out, loop.op_label), **decided)
    if found["position"] is None:
        return through_pv
    both = _together(found["answer"], _at_valve(found["position"], loop), through_pv, loop)
    return replace(both, recordings=through_pv.recordings)


def _valve(
    answer: dict[str, Any],
    recordings: Sequence[Recording],
    ruled_out: Sequence[tuple[Verdict, str, str] | None],
    unit: str,
) -> Fit:
    """The answer of several recordings, in words."""
    own = iter(answer.get("recordings") or [answer] * len(ruled_out))
    singles = []
    for recording, why in zip(recordings, ruled_out, strict=True):
        found: dict[str, Any] = {} if why is not None else next(own)
        if why is not None:
            alone = Fit(why[0], why[2], unit, why=why[1])
        elif "unfit" in found:
            alone = Fit("cannot_tell", _sentence(found, unit), unit, why=found["unfit"][0])
        else:
            alone = _fit_from_answer(found, unit)
        word = found.get("left_out", "unfit")
        singles.append(
            RecordingFit(
                source=recording.source,
                t0=recording.t0,
                fit=alone,
                repeated=found.get("repeated", 0.0),
                left_out=None if word is None else _left_out(word, alone),
                adds=found.get("adds", 0.0),
                shown="recordings" in answer and found is answer["recordings"][answer["shown"]],
            )
        )
    if "unfit" in answer:
        verdict: Verdict = (
            "oscillation" if all(single.fit.verdict == "oscillation" for single in singles) else "cannot_tell"
        )
        reason = to_text("fit.no_recording", {"all": len(singles), "said": singles[0].fit.reason})
        return Fit(verdict, reason, unit, recordings=singles)
    best = answer["recordings"][answer["shown"]]
    return replace(
        _fit_from_answer(answer | {"windows": best["windows"], "shown": best["shown"]}, unit),
        reason=_of_many(answer, singles, unit),
        message=_joint(answer, singles),
        recordings=singles,
    )


def _left_out(word: str, alone: Fit) -> str:
    """Why a recording does not count in the joint answer."""
    return alone.reason if word == "unfit" else to_text(f"left_out.{word}")


def _of_many(answer: dict[str, Any], singles: list[RecordingFit], unit: str) -> str:
    """Verdict and evidence of several recordings: how many count, and why the others do not."""
    names = _names(singles)
    numbers = _joint(answer, singles)["numbers"] | {"said": _sentence(answer, unit)}
    sentences = [to_text("fit.recordings", numbers)]
    reasons: dict[str, list[str]] = {}
    for name, single in zip(names, singles, strict=True):
        if single.left_out is not None:
            reasons.setdefault(single.left_out, []).append(name)
    sentences += [
        to_text("fit.not_counted", {"why": why, "names": ", ".join(sources)}) for why, sources in reasons.items()
    ]
    sentences += [
        to_text("fit.repeated", {"share": single.repeated, "name": name})
        for name, single in zip(names, singles, strict=True)
        if single.repeated
    ]
    return ". ".join(sentences)


def _joint(answer: dict[str, Any], singles: list[RecordingFit]) -> dict[str, Any]:
    """Verdict and evidence of several recordings, as a message."""
    alone = None
    if not answer["shared"]:
        alone = next(name for name, single in zip(_names(singles), singles, strict=True) if single.shown)
    counted = sum(single.left_out is None for single in singles)
    numbers = {"counted": counted, "all": len(singles), "alone": alone, "said": answer["message"]}
    return {"code": "fit.recordings", "numbers": numbers}


def _names(singles: list[RecordingFit]) -> list[str]:
    """Names of recordings, made different where several have the same one."""
    names = [single.source for single in singles]
    if len(set(names)) < len(names):
        return [f"{name} ({place})" for place, name in enumerate(names, 1)]
    return names


def history(beginning: Batch, sign: float) -> _glapp.Windows | None:
    """Chooser of the windows of a recording that begins so; None where that is all of it."""
    return None if len(beginning) < ROWS else _glapp.Windows.of_history(beginning, sign)


def fit_batches(
    batches: list[Batch],
    loop: Loop,
    sign: float,
    *,
    progress: Progress | None = None,
) -> Fit:
    """Fit a stretch in memory, or windows of a longer recording. `sign`: that of the process gain, 0 if not known."""
    found = _glapp.fit(batches, sign, progress)
    return fit_from_core(found["answer"], found["pv"], found["position"], loop)


def fit_from_core(
    answer: dict[str, Any],
    pv: dict[str, Any] | None,
    position: dict[str, Any] | None,
    loop: Loop,
    sinusoid: str | None = None,
) -> Fit:
    """Put the core's answer on PV and on the valve's position into words."""
    if pv is None:
        return Fit("cannot_tell", to_text("fit.op_rests"), loop.op_label, why="op_rests")
    decided = {name: answer[name] for name in ("change", "judgement", "weighed")}
    through_pv = replace(_through_pv(pv, loop, sinusoid), **decided)
    if position is None:
        return through_pv
    return _together(answer, _at_valve(position, loop), through_pv, loop)


def _together(answer: dict[str, Any], at_valve: Fit, through_pv: Fit, loop: Loop) -> Fit:
    """Put into words what position and PV say together: the answer names both where they contradict each other."""
    numbers = {"pv": through_pv.reason, "position": at_valve.reason, "verdict": answer["verdict"]}
    if answer["position"] in ("silent", "bounds"):
        return replace(through_pv, reason=to_text(f"fit.{answer['position']}", numbers))
    own = loop.positioner.dead_band if loop.positioner is not None else None
    numbers["own"] = own if at_valve.found else None
    reason = to_text(f"fit.{answer['position']}", numbers)
    decided = {name: answer[name] for name in ("verdict", "low", "high", "change", "judgement", "weighed")}
    return replace(at_valve, **decided, reason=reason, process=through_pv.process, through_pv=through_pv)


def _at_valve(answer: dict[str, Any], loop: Loop) -> Fit:
    """Fit of the valve's own position, window by window where there are several."""
    if "unfit" in answer:
        return _unfit(answer, loop.op_label)
    best = _best_window(answer, "position")
    best["candidates"] = [{"noise": "position", "delta_deviance": 0.0, "profile": best["profile"]}]
    return _fitted(answer, loop.op_label, best, best)


def _through_pv(answer: dict[str, Any], loop: Loop, sinusoid: str | None) -> Fit:
    """Fit of PV."""
    unit = loop.op_label
    if "unfit" in answer:
        return _unfit(answer, unit)
    found = _fit_from_answer(answer, unit)
    if sinusoid is None:
        return found
    return replace(found, verdict="oscillation", why="sinusoidal", reason=sinusoid + _width_change_text(answer, unit))


def _fit_from_answer(answer: dict[str, Any], unit: str) -> Fit:
    """Fit of PV from the core's answer, with its sentences."""
    best = _best_window(answer, "PV") | {name: answer[name] for name in JUDGED}
    kp, dead_time, lag = ((best[name], *best[f"{name}_limits"]) for name in ("kp", "dead_time", "lag"))
    process = Process(kp, dead_time, lag, best["integrating"])
    return replace(_fitted(answer, unit, best, answer), process=process)


def _unfit(answer: dict[str, Any], unit: str) -> Fit:
    """Why PV or the position could not be fitted."""
    return Fit("cannot_tell", _sentence(answer, unit), unit, why=answer["unfit"][0])


def _fitted(answer: dict[str, Any], unit: str, best: dict[str, Any], decided: dict[str, Any]) -> Fit:
    """What a fit of PV and one of the position have in common.

    - `answer`: of all windows.
    - `best`: of the window that shows best what all say.
    - `decided`: the one of both that has likelihood ratios and reason.
    """
    return Fit(
        verdict=answer["verdict"],
        reason=_sentence(answer, unit),
        unit=unit,
        d=answer["d"],
        low=answer["low"],
        high=answer["high"],
        lr_no_gap=decided["lr_no_gap"],
        lr_needed=decided["lr_needed"],
        jump=best["jump"],
        trend=_trend(answer),
        windows=_windows(answer),
        best=best,
        why=decided["reason"],
    )


def _best_window(answer: dict[str, Any], signal: str) -> dict[str, Any]:
    """The window that shows best what all say, and which signal was fitted."""
    best: dict[str, Any] = answer["windows"][answer["shown"]]
    best["signal"] = signal
    return best


def _windows(answer: dict[str, Any]) -> list[Window]:
    """Results of the single windows."""
    names = ("t_start", "t_end", "verdict", "d", "low", "high", "lr_no_gap")
    return [Window(*(window[name] for name in names)) for window in answer["windows"]]


def _trend(answer: dict[str, Any]) -> Trend | None:
    """The trend, with slope and error per day."""
    if (found := answer["trend"]) is None:
        return None
    fields = {key: found[key] for key in ("windows", "t", "d", "changes")}
    return Trend(slope=DAY * found["slope"], error=DAY * found["error"], **fields)


def _sentence(answer: dict[str, Any], unit: str) -> str:
    """Verdict and evidence, and how the width changes where that is plain."""
    message = answer["message"]
    return to_text(message["code"], message["numbers"], op_unit=unit) + _width_change_text(answer, unit)


def _width_change_text(answer: dict[str, Any], unit: str) -> str:
    """Clause on the trend of the width; empty where there is none."""
    message = (answer.get("trend") or {}).get("message")
    return "" if message is None else f"; {to_text(message['code'], message['numbers'], op_unit=unit)}"


def process_sign(loop: Loop, ideal: Ideal | None) -> float:
    """Sign of the process gain: as given, else the controller's (a loop that controls has both alike); 0: not known."""
    if (kp := loop.kp()) is not None:
        return float(np.sign(kp))
    return 0.0 if ideal is None else float(np.sign(ideal.k))
