"""From a recording, or a stream of samples, to the width of the gap."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _glapp
from ._glapp import to_text
from .arrays import column
from .checked import check_positive
from .controller import Ideal
from .errors import InputError
from .fit import Fit, fit_from_core
from .identify import Identification, identification_from_core, identified
from .loop import Loop
from .progress import Progress, shares
from .quality import Finding, findings_from_core
from .recording import Recording, with_op_unit
from .repair_split import since_repair
from .result import REASONS, Answer, Corrected, HalfPeriods, Origin, Result, Settings
from .samples import check_loop, recording_of
from .step_test import step_test_from_core
from .trace import Band, Thinner, Trace

__all__ = ["Estimator", "analyze", "estimate", "identify"]

Floats = NDArray[np.float64]

INSPECTED_ROWS = _glapp.INSPECTED_ROWS
"""Rows that identification and the closer look at quality take from the beginning of a recording."""

Known = tuple[Origin, str]
"""Source of a setting, as a code and in words."""


def estimate(
    recording: Recording | None = None,
    *,
    t: ArrayLike | None = None,
    sp: ArrayLike | None = None,
    pv: ArrayLike | None = None,
    op: ArrayLike | None = None,
    flags: ArrayLike | None = None,
    loop: Loop | None = None,
    progress: Progress | None = None,
) -> Result:
    """Estimate the width of the gap with the settings that the recording's loop has, and nothing else.

    The detector runs over the recording once; the data is not judged, and nothing is identified from it
    (`analyze` does both). Where the loop gives no filter time, all of a ladder are tried in the same pass, and the
    smallest that leaves enough accepted half-periods, (N + 1)/2, is taken: a longer filter reads low.

    Parameters
    ----------
    recording : Recording
        From `glapp.recording_from` or `glapp.open_recordings`; its `loop` must have a controller; or, in its place:
    t, sp, pv, op, flags : array[n]
        Samples: time [s] or datetime64; setpoint and process value [PV unit], controller output [OP unit];
        sum of 1 not in automatic, 2 bad, 4 OP at its low, 8 at its high limit. NaN, infinite
        or masked is a bad value.
    loop : Loop
        Settings that go with samples.
    progress : callable, optional
        Called with the share that is read.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        Where the loop has no controller, or the recording cannot be read.

    Notes
    -----
    Known bias: high on a fast loop under PI, low on a slow one and under PID, high under load changes (a random-walk
    load gives confident false widths). `docs/estimator.md` has the figures.

    Examples
    --------
    >>> import glapp
    >>> sim = glapp.simulate.closed_loop("P3", (0.48, 0.3117), d=0.05, noise=0.001, t_end=400, load=[(100, 0.5)])
    >>> loop = glapp.Loop(name="P3", controller={"k": 0.48, "ti": 0.3117}, process={"kp": 1})
    >>> result = glapp.estimate(glapp.recording_from(sim.to_arrow(), loop))
    >>> result.verdict, 0.045 < result.d_hat < 0.055
    ('estimate', True)
    """
    [recording] = since_repair([recording_of(recording, loop, t=t, sp=sp, pv=pv, op=op, flags=flags)])
    loop = recording.loop
    if loop.controller is None:
        raise InputError(
            "has no controller settings",
            loop=loop.name,
            parameter="controller",
            hint="give K and Ti, or use glapp.analyze, which identifies them where OP is recorded",
        )
    return _analyzed(recording, 4096, progress, judge=False, fit=False)


@overload
def analyze(recording: list[Any], **asked: Any) -> list[Result]: ...


@overload
def analyze(recording: Any = None, **asked: Any) -> Result: ...


def analyze(  # type: ignore[misc]  # the overloads leave the names of its options to it
    recording: Any = None,
    *,
    t: ArrayLike | str | None = None,
    sp: ArrayLike | str | None = None,
    pv: ArrayLike | str | None = None,
    op: ArrayLike | str | None = None,
    position: ArrayLike | str | None = None,
    flags: ArrayLike | None = None,
    loop: Loop | None = None,
    trust: bool = False,
    fit: bool = True,
    progress: Progress | None = None,
) -> Result | list[Result]:
    """Judge a recording, find K, Ti and Td where they are not given, estimate and fit the width of the gap.

    Parameters
    ----------
    recording : Recording, path, table or list of these
        From `glapp.recording_from` or `glapp.open_recordings`; a file that holds one loop; a pandas, Polars or Arrow
        table or a dict of arrays. A list gives a list of answers, one for each loop of each file. Or, in its place:
    t, sp, pv, op, position, flags : array[n] or str
        With a file or a table, names of its columns where the guess is wrong; `position=""` leaves a measured
        position out. Alone, samples: time [s] or datetime64; setpoint and process value [PV unit], controller output
        [OP unit], the valve's measured position [%];
        sum of 1 not in automatic, 2 bad, 4 OP at its low, 8 at its high limit. NaN, infinite
        or masked is a bad value.
    loop : Loop
        Settings that go with samples.
    trust : bool
        Use an identification although it is not good enough (R² below 0.9).
    fit : bool
        Fit the gap from OP and PV as well (`glapp.fit`, a second or more per loop, and a dozen times that for a
        recording of more than half a million rows); without OP the result has no `fit`.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Result
        `refused`, with the reason, where data or settings do not allow an answer.

    Raises
    ------
    InputError
        Where settings contradict themselves or the recording cannot be read.

    Examples
    --------
    >>> import glapp
    >>> sim = glapp.simulate.closed_loop("P3", (0.48, 0.3117), d=0.05, noise=0.001, t_end=400, load=[(100, 0.5)])
    >>> loop = glapp.Loop(name="P3", controller={"k": 0.48, "ti": 0.3117}, process={"kp": 1})
    >>> result = glapp.analyze(glapp.recording_from(sim.to_arrow(), loop))
    >>> result.verdict, result.crossings
    ('backlash', 'estimate')
    >>> table = {"seconds": sim.t, "flow": sim.pv, "valve": sim.op}
    >>> glapp.analyze(table, t="seconds", pv="flow", op="valve", fit=False).verdict
    'refused'
    """
    signals: dict[str, Any] = {"t": t, "sp": sp, "pv": pv, "op": op, "position": position, "flags": flags}
    if isinstance(recording, list):
        opened = _all_of(recording, loop, signals)
        parts = shares(progress, *[1 / max(len(opened), 1)] * len(opened))
        pairs = zip(opened, parts, strict=True)
        return [_judged(single, trust, fit, part) for single, part in pairs]
    recording = recording_of(recording, loop, **signals)
    return _judged(recording, trust, fit, progress)


def _judged(recording: Recording, trust: bool, fit: bool, progress: Progress | None) -> Result:
    """The result of a recording; without `fit` its texts state that it was left out."""
    result = _analyzed(recording, INSPECTED_ROWS, progress, trust=trust, fit=fit)
    return result if fit else replace(result, fit_left_out="OP" in recording.columns)


def _all_of(several: list[Any], loop: Loop | None, signals: dict[str, Any]) -> list[Recording]:
    """Every loop of every file, table and recording."""
    from .reading import open_recordings

    plain = loop is None and all(column is None for column in signals.values())
    opened: list[Recording] = []
    for source in several:
        if plain and isinstance(source, str | os.PathLike):
            opened += open_recordings(Path(source))
        else:
            opened.append(recording_of(source, loop, **signals))
    return opened


def _analyzed(recording: Recording, rows: int, progress: Progress | None, **asked: bool) -> Result:
    """Hand a recording to the core, its beginning first, and put the answer into words."""
    [recording] = since_repair([recording])
    beginning = recording.beginning(rows)
    loop = with_op_unit(recording.loop, beginning)
    task = json.dumps(_task(loop) | asked)
    try:
        analysis = _glapp.Analysis(task, beginning)
    except ValueError as error:
        raise InputError(str(error), loop=loop.name) from None
    # A long recording is fitted in at most a dozen windows: a fit is far slower than reading.
    share = 0.1 if len(beginning) < rows else 0.5
    reading, fitting = (
        shares(progress, share, 1 - share) if asked["fit"] and beginning.op is not None else (progress, None)
    )
    thinner, signals = Thinner(), set[str]()
    for batch in [beginning] if len(beginning) < rows else recording.batches():
        columns = {name: getattr(batch, name) for name in ("pv", "sp", "op", "position")}
        columns |= {f"filtered {i}": signal for i, signal in enumerate(analysis.take(batch))}
        columns = {name: signal for name, signal in columns.items() if signal is not None}
        thinner.add(batch.t, columns)
        signals |= columns.keys()
        if reading is not None:
            reading(recording.fraction_read())
    done = analysis.finish(fitting)
    return _result(recording, loop, done, _trace(thinner, signals, done["chosen"]))


def _task(loop: Loop) -> dict[str, Any]:
    """Facts known of a loop, in the core's form."""
    ideal = loop.ideal()
    return {
        "controller": None if ideal is None else ideal._asdict(),
        "setpoint_weight": _given_setpoint_weight(loop),
        "kp": loop.kp(),
        "integrating": loop.process.type == "integrating",
        "pv_span": loop.pv_span,
        "op_span": loop.op_span,
        "op_percent": loop.op_label == "%",
        "exclusion": _exclusion(loop),
        "acceptable": loop.acceptable_dead_band,
        "prior": loop.prior(),
        "positioner_dead_band": None if loop.positioner is None else loop.positioner.dead_band,
        "tf": loop.tf,
        "n": loop.n,
    }


def _result(recording: Recording, loop: Loop, done: dict[str, Any], trace: Trace) -> Result:
    """The answer in words."""
    answer = done["answer"]
    named = partial(findings_from_core, pv_unit=loop.pv_unit or "PV unit", op_unit=loop.op_label, t0=recording.t0)
    found = named(answer["quality"])
    identification = None if answer["identification"] is None else identification_from_core(answer["identification"])
    table = {} if done["table"] is None else done["table"]
    if table and not done["op"]:
        table["op_travel"] = np.full(len(table["t_start"]), np.nan)
    corrected, s = answer["corrected"], answer["controller"]
    return Result(
        name=recording.name,
        source=recording.source,
        loop=loop,
        t0=recording.t0,
        crossings=answer["crossings"],
        why=_code(answer, found),
        reason=why_text(answer, loop, found, identification),
        d_hat=answer["d_hat"],
        unit=loop.op_label,
        columns=dict(recording.columns),
        left_out=tuple(recording.left_out),
        d_hat_percent_span=answer["d_hat_percent_span"],
        repeatability=None if answer["repeatability"] is None else tuple(answer["repeatability"]),
        noise_floor=answer["noise_floor"],
        detections=answer["detections"],
        half_periods=HalfPeriods(**table) if table else HalfPeriods.empty(),
        reasons=answer["reasons"],
        settings=Settings(
            k=s["k"],
            ti=s["ti"],
            td=s["td"],
            b=s["setpoint_weight"],
            tf=s["tf"],
            kp=s["kp_process"],
            n=s["n"],
            max_h=s["max_h"],
            notes={name: _note(name, origin, answer, loop) for name, origin in s["origins"].items()},
            origins=s["origins"],
        ),
        answer=Answer.of(answer["answer"]),
        messages=answer["messages"],
        step_test=None if answer["step_test"] is None else step_test_from_core(answer["step_test"], recording, loop),
        quality=named(answer["quality"], recording.found),
        identification=identification,
        trace=trace,
        fit=None if answer["fit"] is None else _fit(done, loop, found),
        corrected=None if corrected is None else _corrected(corrected, loop.op_label),
    )


def _fit(done: dict[str, Any], loop: Loop, found: list[Finding]) -> Fit:
    """The fit in words."""
    match done["answer"]["fit"]["why"]:
        case {"code": "place"}:
            return Fit("cannot_tell", to_text("crossings.place", _of_exclusion(loop)), loop.op_label, why="place")
        case {"code": "finding", "of": i} if done["pv"] is None:
            return Fit("cannot_tell", found[i].text, loop.op_label, why=found[i].code)
        case {"code": "finding", "of": i}:
            return fit_from_core(done["answer"]["fit"], done["pv"], done["position"], loop, found[i].text)
    pv = done["pv"]
    if (enough := next((m["numbers"].get("enough") for m in done["answer"]["messages"]), None)) is not None:
        pv["message"]["numbers"]["enough"] = enough
    return fit_from_core(done["answer"]["fit"], pv, done["position"], loop)


def _note(name: str, origin: Origin, answer: dict[str, Any], loop: Loop) -> str:
    """Origin of a setting, in words."""
    s, found = answer["controller"], answer["identification"]
    how: str = origin
    numbers: dict[str, Any] = {"tried": s["tried"], "kp": _glapp.KP_DEFAULT}
    match name, origin:
        case "delta_u", _:
            how = s["delta_u"]
        case "td", "identified" if not s["td"]:
            how = "no_derivative"
        case _, "identified":
            return to_text("setting.identified", {"r2": found["values"]["r2"]})
        case "kp", "fitted":
            _, numbers["low"], numbers["high"] = answer["fit"]["process"]["kp"]
        case "kp", "unknown" if loop.process.type == "integrating":
            how = "integrating"
        case _, "given":
            return to_text("setting.given")
    return to_text(f"setting.{name}", numbers | {"origin": how})


def _code(answer: dict[str, Any], found: list[Finding]) -> str | None:
    """Why the crossings say no more, in a word: that of a finding, where it is one."""
    match answer["why"]:
        case {"code": "finding", "of": int(i)}:
            return found[i].code
        case {"code": str(code)}:
            return code
    return None


def why_text(
    answer: dict[str, Any], loop: Loop, found: list[Finding], identification: Identification | None
) -> str | None:
    """Sentence that explains why the zero crossings give no width, or only a provisional one; None where they do."""
    match answer["why"]:
        case None:
            return None
        case {"code": "finding", "of": int(i)}:
            return found[i].text
        case {"code": "place"}:
            return to_text("crossings.place", _of_exclusion(loop))
        case {"code": "nothing_accepted"}:
            return nothing_accepted(answer["reasons"])
        case why:
            numbers = {"detections": answer["detections"], "n": loop.n}
            numbers |= {} if identification is None else {"reason": identification.reason}
            numbers |= {"kp_origin": answer["controller"]["origins"]["kp"]} | (why.get("of") or {})
            return to_text(f"crossings.{why['code']}", numbers, op_unit=loop.op_label)


def _corrected(c: dict[str, Any], unit: str) -> Corrected:
    """The width with the bias of (2.4) taken out, or why there is none."""
    reason = None if c["why"] is None else _not_corrected(c, unit)
    kp_range = None if c["kp_range"] is None else tuple(c["kp_range"])
    return Corrected(c["d"], c["low"], c["high"], c["kp"], kp_range, c["pairs"], c["travel"], reason)


def _not_corrected(c: dict[str, Any], unit: str) -> str:
    """Why there is no corrected width, in words."""
    code, of = c["why"]["code"], c["why"].get("of")
    numbers = {"doubt": of} if code == "doubt" else of or {}
    return to_text(f"not_corrected.{code}", numbers | {"pairs": c["pairs"], "kp": c["kp"]}, op_unit=unit)


def _trace(thinner: Thinner, signals: set[str], chosen: int | None) -> Trace:
    """Thinned signals for the charts."""
    t = thinner.times()
    none = Band(np.full(len(t), np.nan), np.full(len(t), np.nan))
    return Trace(
        t=t,
        sp=thinner.band("sp") if "sp" in signals else none,
        pv=thinner.band("pv"),
        pv_filtered=none if chosen is None else thinner.band(f"filtered {chosen}"),
        op=thinner.band("op") if "op" in signals else None,
        position=thinner.band("position") if "position" in signals else None,
    )


def identify(
    recording: Recording | None = None,
    *,
    t: ArrayLike | None = None,
    sp: ArrayLike | None = None,
    pv: ArrayLike | None = None,
    op: ArrayLike | None = None,
    flags: ArrayLike | None = None,
    loop: Loop | None = None,
) -> Identification:
    """K, Ti and Td as the first half million rows of a recording show them; `glapp.identify.identified` says how.

    Parameters
    ----------
    recording : Recording
        From `glapp.recording_from` or `glapp.open_recordings`; or, in its place:
    t, sp, pv, op, flags : array[n]
        Samples: time [s] or datetime64; setpoint and process value [PV unit], controller output [OP unit];
        sum of 1 not in automatic, 2 bad, 4 OP at its low, 8 at its high limit. NaN, infinite
        or masked is a bad value.
    loop : Loop
        Settings that go with samples.

    Returns
    -------
    Identification
        `reason` names what cannot be found.

    Raises
    ------
    InputError
        Where the recording cannot be read.

    Examples
    --------
    >>> import glapp, numpy as np
    >>> t = np.arange(400.0)
    >>> pv = 50 + np.sin(t / 17) + 0.3 * np.sin(t / 5)
    >>> op = 50 + 2.0 * (50 - pv) + 2.0 / 30 * np.cumsum(50 - pv)
    >>> found = glapp.identify(t=t, sp=np.full(400, 50.0), pv=pv, op=op)
    >>> round(found.k, 3), round(found.ti, 2), found.usable
    (2.0, 30.0, True)
    """
    return identify_with_unit(recording_of(recording, loop, t=t, sp=sp, pv=pv, op=op, flags=flags))[0]


def identify_with_unit(recording: Recording) -> tuple[Identification, Loop]:
    """Find K, Ti and Td, and the loop with the unit of OP that the same rows allow.

    Raises InputError where the recording cannot be read.
    """
    [recording] = since_repair([recording])
    batch = recording.beginning(INSPECTED_ROWS)
    loop = with_op_unit(recording.loop, batch)
    found = identified(
        batch.t,
        batch.sp,
        batch.pv,
        batch.op,
        batch.flags,
        setpoint_weight=_given_setpoint_weight(loop),
        limits=loop.op_range(),
    )
    return found, loop


class Estimator:
    """The detector for a stream of samples: of one loop, with its state.

    Parameters
    ----------
    loop : Loop
        With a controller. Without a filter time `tf` it is Td/5, or Ti/10 for PI (thesis 2.1): a stream cannot be run
        again with a longer one. To go on as `analyze` did, give it the time that `analyze` chose:
        ``loop.model_copy(update={"tf": result.settings.tf})``.
    h : float
        Usual time between samples [s], > 0; a step longer than three of them is a gap.

    Raises
    ------
    InputError
        Where the loop has no controller, or a value is out of bounds.

    Notes
    -----
    `estimate` is None where what the detections say is below the noise limit `noise_floor`: 3σ/Kp, with σ of PV's
    fast noise when the last detection was made, or 3σ·2K where Kp is not known. `median_mean` is what they say all
    the same. Two more things that `analyze` asks of an estimate a stream does not: that a third of the detections
    agree, and the quality of the whole recording.

    Examples
    --------
    >>> import glapp
    >>> loop = glapp.Loop(name="FIC1", controller={"k": 0.5, "ti": 10}, process={"kp": 2}, n=3, tf=0.001)
    >>> estimator = glapp.Estimator(loop, h=1.0)
    >>> for k in range(800):
    ...     half_period = estimator.update(float(k), 0.0, -1.0 if k // 100 % 2 == 0 else 1.0)
    ...     if half_period is not None and half_period.reason == 0:
    ...         print(f"{half_period.t_end:.0f} s: {half_period.d:.2f}")
    300 s: 4.50
    400 s: 4.50
    500 s: 4.50
    600 s: 4.50
    700 s: 4.50
    >>> glapp.Estimator.load(estimator.save()).estimate == estimator.estimate
    True
    """

    def __init__(self, loop: Loop, h: float) -> None:
        """Make one, at the beginning of a stream."""
        check_loop(loop)
        ideal = loop.ideal()
        if ideal is None:
            raise InputError("has no controller settings", loop=loop.name, parameter="controller", hint="give K and Ti")
        check_positive(h, "h")
        self._detector = _glapp.Detector(_detector_settings(loop, ideal, _process_gain(loop), h))

    def update(
        self, t: float, sp: float, pv: float, op: float | None = None, flags: int = 0
    ) -> _glapp.HalfPeriod | None:
        """Take one sample.

        Parameters
        ----------
        t, sp, pv, op : float
            Time [s], signals; NaN is a bad value, None: OP is not known.
        flags : int
            Sum of 1 not in automatic, 2 bad quality, 4 at the lower, 8 at the upper limit.

        Returns
        -------
        HalfPeriod or None
            The half-period that it ended, with attributes as the columns of `HalfPeriods`; it is not added to
            `half_periods`.
        """
        return self._detector.update(t, sp, pv, op, flags)

    def update_many(
        self,
        t: ArrayLike,
        sp: ArrayLike,
        pv: ArrayLike,
        op: ArrayLike | None = None,
        flags: ArrayLike | None = None,
    ) -> None:
        """Take many samples; the same bits as `update` one by one, and the half-periods are added to `half_periods`.

        Parameters
        ----------
        t, sp, pv, op : float[n]
            Time [s], signals; NaN or masked is a bad value.
        flags : uint8[n], optional
            Sum of 1 not in automatic, 2 bad quality, 4 at the lower, 8 at the upper limit.
        """
        self._detector.run(column(t), column(sp), column(pv), column(op), column(flags, np.uint8))

    @property
    def half_periods(self) -> HalfPeriods:
        """Table of the half-periods that `update_many` has ended."""
        return HalfPeriods(**self._detector.table())

    @property
    def reasons(self) -> dict[str, int]:
        """Number of half-periods by their first reason, `update` and `update_many` together."""
        return dict(zip(REASONS, self._detector.reasons, strict=True))

    @property
    def estimate(self) -> tuple[float, float, float, int, int] | None:
        """(value, smallest, largest [OP unit], how many agree, how many there are) of the last N detections.

        None before the first detection, and where it is below the noise limit.
        """
        return self._detector.estimate

    @property
    def median_mean(self) -> tuple[float, float, float, int, int] | None:
        """The estimate, whether above the noise limit or not."""
        return self._detector.median_mean

    @property
    def noise_floor(self) -> float | None:
        """The noise limit [OP unit], by its level at the last detection; None where it is not known."""
        return self._detector.noise_floor

    def save(self) -> str:
        """Settings and state as JSON; the table is not part of it."""
        return self._detector.save()

    @classmethod
    def load(cls, saved: str) -> Self:
        """The estimator that `save` saved: it goes on with the same bits as one never interrupted.

        Raises
        ------
        InputError
            Where the text is not what `save` gave.
        """
        self = cls.__new__(cls)
        try:
            self._detector = _glapp.Detector.load(saved)
        except ValueError as error:
            raise InputError(str(error)) from None
        return self

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return type(self).load, (self.save(),)


def _exclusion(loop: Loop) -> str | None:
    """Why the width of this OP is not that of one valve (thesis 8.3.2); None where it is."""
    if loop.cascade is not None and loop.cascade.role == "primary":
        return "primary"
    if loop.split_range:
        return "split_range"
    return None if loop.shared_valve_with is None else "shared_valve"


def _of_exclusion(loop: Loop) -> dict[str, str | None]:
    """Position of the loop, where it rules out an estimate, and the partner that the sentence names."""
    partner = loop.shared_valve_with
    if loop.cascade is not None:
        partner = loop.cascade.partner or "the secondary loop"
    return {"place": _exclusion(loop), "partner": partner}


def nothing_accepted(rejected: dict[str, int]) -> str:
    """Why no half-period was accepted: the two most frequent reasons."""
    total = sum(rejected.values())
    if not total:
        return to_text("crossings.never_crossed")
    ranked = sorted(rejected.items(), key=lambda item: -item[1])[:2]
    causes = " and ".join(f"{count} as {to_text(f'half_period.{name}')}" for name, count in ranked if count)
    return to_text("crossings.nothing_accepted", {"total": total, "causes": causes})


def _given_setpoint_weight(loop: Loop) -> float | None:
    """Setpoint weight b where it was given; its default is no fact about the controller."""
    controller = loop.controller
    if controller is None or "setpoint_weight" not in controller.model_fields_set:
        return None
    return controller.setpoint_weight


def _process_gain(loop: Loop) -> float | None:
    """Kp as far as it is given or assumed [PV unit/OP unit]."""
    spans = None
    if loop.pv_span is not None and loop.op_span is not None:
        spans = (loop.pv_span[1] - loop.pv_span[0], loop.op_span[1] - loop.op_span[0])
    return _glapp.process_gain(loop.kp(), spans, loop.process.type == "integrating")


def _detector_settings(loop: Loop, ideal: Ideal, kp: float | None, h: float) -> dict[str, Any]:
    """Settings of the detector for the core."""
    given = {} if loop.tf is None else {"tf": loop.tf}
    return {**ideal._asdict(), **given, "kp": kp, "n": loop.n, "h": h, "op_limits": loop.op_range()}
