"""From a recording, or a stream of samples, to the width of the gap."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _glapp
from .controller import Ideal
from .errors import InputError
from .fit import Fit, fit_batches, history, process_sign
from .identify import Identification, identified
from .loop import Loop
from .progress import Progress, shares
from .quality import GAP_STEPS, Census, Finding, InspectionSample, assumed_gain, inspect, noise_sigma
from .recording import Batch, Recording
from .result import REASONS, Corrected, HalfPeriods, Origin, Result, Settings, Verdict
from .samples import recording_of
from .trace import Band, Thinner, Trace

__all__ = ["Estimator", "analyze", "estimate", "identify"]

Floats = NDArray[np.float64]

INSPECTED_ROWS = 500_000
"""Rows that identification and the closer look at quality take from the beginning of a recording."""

CHECKED_ROWS = 20_000
"""Rows from which given settings are checked."""

Known = tuple[Origin, str]
"""Where a setting comes from, and the same in words."""

_TRAVEL = {
    "integral": "K/Ti·∫|e|dt (7.5)",
    "derivative": "K/Ti·∫|e|dt with the derivative part (7.6)",
    "op": "OP's own travel",
}
"""Where Δu is taken from."""

NO_SP = "SP is not recorded, and half-periods are told by where PV crosses it: name its column (--sp, columns.sp)"
"""Why there is no estimate from crossings where the fit may have one."""


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

    The detector runs over the recording once; the data is neither judged nor is anything identified from it
    (`analyze` does both). Where the loop gives no filter time, all of a ladder are tried in the same pass, and the
    smallest that leaves enough accepted half-periods, (N + 1)/2, is taken: a longer filter reads low.

    Parameters
    ----------
    recording : Recording
        From `glapp.recording_from` or `glapp.open_recordings`; its `loop` must have a controller; or, in its place:
    t, sp, pv, op, flags : array[n]
        Samples: time [s] or datetime64; setpoint and process value [PV unit], controller output [OP unit];
        sum of 1 not in automatic, 2 bad, 4 OP at its low, 8 at its high limit. NaN is a bad value.
    loop : Loop
        Settings that go with samples.
    progress : callable, optional
        Told how far the reading is.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        Where the loop has no controller, or the recording cannot be read.

    Notes
    -----
    Known bias: low by the part of OP's travel that Δy/Kp overstates, high under load changes (a random-walk load gives
    confident false widths); see `docs/estimator.md`.

    Examples
    --------
    >>> import glapp
    >>> sim = glapp.simulate.closed_loop("P3", (0.48, 0.3117), d=0.05, noise=0.001, t_end=400, load=[(100, 0.5)])
    >>> loop = glapp.Loop(name="P3", controller={"k": 0.48, "ti": 0.3117, "setpoint_weight": 0}, process={"kp": 1})
    >>> result = glapp.estimate(glapp.recording_from(sim.to_arrow(), loop))
    >>> result.verdict, 0.045 < result.d_hat < 0.055
    ('estimate', True)
    """
    recording = recording_of(recording, loop, t=t, sp=sp, pv=pv, op=op, flags=flags)
    loop = recording.loop
    if loop.controller is None:
        raise InputError(
            "has no controller settings",
            loop=loop.name,
            parameter="controller",
            hint="give K and Ti, or use glapp.analyze, which identifies them where OP is recorded",
        )
    ideal = loop.ideal()
    assert ideal is not None
    sample = _inspection(recording, 4096)
    loop = with_op_unit(loop, sample.batch)
    run = _Run(recording, sample, loop, ideal, {}, _process_gain(loop))
    run.all(progress)
    return run.result([], None)


def analyze(
    recording: Recording | None = None,
    *,
    t: ArrayLike | None = None,
    sp: ArrayLike | None = None,
    pv: ArrayLike | None = None,
    op: ArrayLike | None = None,
    position: ArrayLike | None = None,
    flags: ArrayLike | None = None,
    loop: Loop | None = None,
    trust: bool = False,
    fit: bool = True,
    progress: Progress | None = None,
) -> Result:
    """Judge a recording, find K, Ti and Td where they are not given, estimate and fit the width of the gap.

    Parameters
    ----------
    recording : Recording
        From `glapp.recording_from` or `glapp.open_recordings`; or, in its place:
    t, sp, pv, op, position, flags : array[n]
        Samples: time [s] or datetime64; setpoint and process value [PV unit], controller output [OP unit],
        the valve's measured position [%];
        sum of 1 not in automatic, 2 bad, 4 OP at its low, 8 at its high limit. NaN is a bad value.
    loop : Loop
        Settings that go with samples.
    trust : bool
        Go on with an identification that is not good enough (R² below 0.9).
    fit : bool
        Fit the gap from OP and PV as well (`glapp.fit`, a second or more a loop, and a dozen times that for a
        recording of more than half a million rows); without OP the result has no `fit`.
    progress : callable, optional
        Told the share that is done; reading is the first half of it, the fit the second.

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
    >>> loop = glapp.Loop(name="P3", controller={"k": 0.48, "ti": 0.3117, "setpoint_weight": 0}, process={"kp": 1})
    >>> glapp.analyze(glapp.recording_from(sim.to_arrow(), loop)).verdict
    'estimate'
    """
    recording = recording_of(recording, loop, t=t, sp=sp, pv=pv, op=op, position=position, flags=flags)
    sample = _inspection(recording, INSPECTED_ROWS)
    batch = sample.batch
    loop = with_op_unit(recording.loop, batch)
    ideal = loop.ideal()
    # Settings that are given need only be held against the recording, for which its beginning is enough.
    found = None if batch.op is None else _identified(batch if ideal is None else batch[slice(0, CHECKED_ROWS)], loop)
    origins: dict[str, Known] = {}
    if ideal is None and found is not None and found.k and found.ti and (found.usable or trust):
        ideal = Ideal(
            found.k, found.ti, found.td or 0.0, 1.0 if found.setpoint_weight is None else found.setpoint_weight
        )
        told: Known = ("identified", f"identified (R² {found.r2:.3f})")
        origins = {"k": told, "ti": told, "td": told if found.td else ("identified", "PI law identified")}
        origins["b"] = ("assumed", "no setpoint change to tell it by") if found.setpoint_weight is None else told
    run = _Run(recording, sample, loop, ideal, origins, _process_gain(loop))
    census = _glapp.Census(run.max_h, op_range(loop))
    fit = fit and batch.op is not None
    reading, fitting, again = shares(progress, 0.4, 0.4, 0.2) if fit else (progress, None, None)
    windows = history(batch, process_sign(loop, ideal)) if fit else None
    run.all(reading, census, windows)
    quality = inspect(
        InspectionSample(batch.t, batch.sp, batch.pv, batch.op, batch.flags),
        Census(**census.counts()),
        k=None if ideal is None else ideal.k,
        ti=None if ideal is None else ideal.ti,
        td=None if ideal is None else ideal.td,
        identification=found,
        pv_unit=loop.pv_unit or "PV unit",
        op_unit=loop.op_label,
        t0=recording.t0,
        known=recording.found,
    )
    fitted_batches = [batch] if windows is None else windows.best()
    fitted = _fit(fitted_batches, loop, ideal, quality, fitting) if fit else None
    known = loop.process.type == "integrating" or run.origins["kp"][0] == "given"
    if fitted is not None and not known and (gain := _fitted_gain(fitted)) is not None:
        run = _Run(recording, sample, loop, ideal, origins, gain)
        run.all(again)
    return replace(run.result(quality, found), fit=fitted)


def _fitted_gain(fit: Fit) -> tuple[float, Known] | None:
    """Kp where the fit found a lost motion and with it the gain of a process that does not integrate, to a third."""
    if not fit.found or fit.process is None or fit.process.integrating:
        return None
    kp, low, high = fit.process.kp
    if not _glapp.fitted_gain_serves(kp, low, high):
        return None
    return kp, ("fitted", f"fitted from OP and PV ({low:.3g} to {high:.3g})")


def _fit(
    batches: list[Batch], loop: Loop, ideal: Ideal | None, quality: list[Finding], progress: Progress | None
) -> Fit:
    """The fit, told what is already known: the sign of the process, and what makes any answer wrong."""
    refusal = _refusal(loop)
    refusals = [
        *([] if refusal is None else [refusal[1]]),
        *(f.text for f in quality if f.severity == "refuse" and f.code != "not_auto"),
    ]
    sinusoids = [f.text for f in quality if f.code == "sinusoidal"]
    return fit_batches(
        batches,
        loop,
        process_sign(loop, ideal),
        refused=refusals[0] if refusals else None,
        sinusoid=sinusoids[0] if sinusoids else None,
        progress=progress,
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
        sum of 1 not in automatic, 2 bad, 4 OP at its low, 8 at its high limit. NaN is a bad value.
    loop : Loop
        Settings that go with samples.

    Returns
    -------
    Identification
        Whatever cannot be found is said in `reason`.

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
    recording = recording_of(recording, loop, t=t, sp=sp, pv=pv, op=op, flags=flags)
    batch = _inspection(recording, INSPECTED_ROWS).batch
    return _identified(batch, with_op_unit(recording.loop, batch))


def _identified(batch: Batch, loop: Loop) -> Identification:
    return identified(
        batch.t,
        batch.sp,
        batch.pv,
        batch.op,
        batch.flags,
        setpoint_weight=_given_setpoint_weight(loop),
        limits=op_range(loop),
    )


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
    `estimate` is None where noise can feign what the detections say, that is, below `noise_floor`: 3σ/Kp, with σ of
    PV's fast noise when the last detection was made, or 3σ·2K where Kp is not known. `median_mean` is what they say all
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
        ideal = loop.ideal()
        if ideal is None:
            raise InputError("has no controller settings", loop=loop.name, parameter="controller", hint="give K and Ti")
        if not h > 0:
            raise InputError(f"is {h}, must be > 0 s", parameter="h", value=h, bound="> 0 s")
        self._detector = _glapp.Detector(_detector_settings(loop, ideal, _process_gain(loop)[0], h))

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
            Time [s], signals; NaN is a bad value.
        flags : uint8[n], optional
            Sum of 1 not in automatic, 2 bad quality, 4 at the lower, 8 at the upper limit.
        """
        self._detector.run(
            _floats(t),
            _floats(sp),
            _floats(pv),
            None if op is None else _floats(op),
            None if flags is None else np.ascontiguousarray(flags, dtype=np.uint8),
        )

    @property
    def half_periods(self) -> HalfPeriods:
        """Table of the half-periods that `update_many` has ended."""
        return HalfPeriods(**self._detector.table())

    @property
    def reasons(self) -> dict[str, int]:
        """How many half-periods ended with each first reason, `update` and `update_many` together."""
        return dict(zip(REASONS, self._detector.reasons, strict=True))

    @property
    def estimate(self) -> tuple[float, float, float, int, int] | None:
        """(value, smallest, largest [OP unit], how many agree, how many there are) of the last N detections.

        None before the first detection, and where noise can feign it.
        """
        return self._detector.estimate

    @property
    def median_mean(self) -> tuple[float, float, float, int, int] | None:
        """The same, whether noise can feign it or not."""
        return self._detector.median_mean

    @property
    def noise_floor(self) -> float | None:
        """What noise can feign [OP unit], by its level at the last detection; None where it is not known."""
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


@dataclass(frozen=True, slots=True)
class _Inspection:
    batch: Batch
    median_step: float
    whole: bool
    """Whether the recording has no more rows: it need not be read again."""


def _inspection(recording: Recording, rows: int) -> _Inspection:
    """The first rows, and the median step between them [s]."""
    beginning = recording.beginning(rows)
    steps = np.diff(beginning.t)
    steps = steps[np.isfinite(steps) & (steps > 0)]
    return _Inspection(beginning, float(np.median(steps)) if len(steps) else 1.0, len(beginning) < rows)


class _Run:
    """One pass over a recording with a detector for every filter time that is tried."""

    def __init__(
        self,
        recording: Recording,
        sample: _Inspection,
        loop: Loop,
        ideal: Ideal | None,
        origins: dict[str, Known],
        gain: tuple[float | None, Known],
    ) -> None:
        self.recording, self.sample = recording, sample
        self.loop = loop
        self.ideal = ideal
        self.h = sample.median_step
        self.max_h = GAP_STEPS * self.h
        self.kp, kp_known = gain
        given: Known = ("given", "given")
        self.origins = {**dict.fromkeys(("k", "ti", "td", "b"), given), **origins, "kp": kp_known}
        self.thinner = Thinner()
        self.op_known = self.position_known = False
        self.sp_known = "SP" in recording.columns
        self.ladder = None if ideal is None or not self.sp_known else _ladder(loop, ideal, self.kp, self.h)

    def all(
        self, progress: Progress | None, census: _glapp.Census | None = None, windows: _glapp.Windows | None = None
    ) -> None:
        """Read the recording from its first to its last row, the detectors side by side."""
        for batch in [self.sample.batch] if self.sample.whole else self.recording.batches():
            if census is not None:
                census.run(batch.t, batch.sp, batch.pv, batch.op, batch.flags)
            if windows is not None:
                windows.add(batch)
            columns = {"pv": batch.pv}
            for name in ("sp", "op", "position"):
                if (signal := getattr(batch, name)) is not None:
                    columns[name] = signal
            if self.ladder is not None and batch.sp is not None:
                filtered = self.ladder.run(batch.t, batch.sp, batch.pv, batch.op, batch.flags)
                columns.update((f"filtered {i}", signal) for i, signal in enumerate(filtered))
            self.thinner.add(batch.t, columns)
            self.op_known = self.op_known or batch.op is not None
            self.position_known = self.position_known or batch.position is not None
            if progress is not None:
                progress(self.recording.fraction_read())

    def result(self, quality: list[Finding], found: Identification | None) -> Result:
        """Choose the filter time and say what was found; OP's noise is that of the recording's beginning."""
        loop, ideal, origins = self.loop, self.ideal, dict(self.origins)
        chosen, detector = (None, None) if self.ladder is None else self.ladder.chosen()
        tf = None
        if self.ladder is not None and chosen is not None and detector is not None:
            times = self.ladder.filter_times
            tf = times[chosen]
            tried: Known = ("chosen", f"smallest of {len(times)} that serves")
            origins["tf"] = ("given", "given") if loop.tf is not None else tried
            origins["delta_u"] = ("chosen", _TRAVEL[detector.travel_source(self.op_known)])
        half_periods = _half_periods(detector, self.op_known)
        if origins["kp"][0] == "assumed":
            quality = [*quality, *self._doubt(half_periods)]
        counts = dict(zip(REASONS, detector.reasons if detector is not None else [0] * len(REASONS), strict=True))
        detections = counts.pop("accepted")
        verdict, reason = self._verdict(detector, quality, found, detections, counts)
        shown = detector.median_mean if detector is not None and verdict in ("estimate", "provisional") else None
        d_hat = shown[0] if shown else None
        limits = op_range(loop)
        return Result(
            name=self.recording.name,
            source=self.recording.source,
            loop=loop,
            t0=self.recording.t0,
            verdict=verdict,
            reason=reason,
            d_hat=d_hat,
            unit=loop.op_label,
            d_hat_percent_span=None if d_hat is None or limits is None else 100.0 * d_hat / (limits[1] - limits[0]),
            repeatability=(shown[1], shown[2]) if shown else None,
            noise_floor=None if detector is None else detector.noise_floor,
            detections=detections,
            half_periods=half_periods,
            reasons={name: count for name, count in counts.items() if count},
            settings=Settings(
                k=ideal and ideal.k,
                ti=ideal and ideal.ti,
                td=ideal and ideal.td,
                b=ideal and ideal.b,
                tf=tf,
                kp=self.kp,
                n=loop.n,
                max_h=self.max_h,
                notes={name: note for name, (_, note) in origins.items()},
                origins={name: origin for name, (origin, _) in origins.items()},
            ),
            quality=quality,
            identification=found,
            trace=self._trace(chosen),
            corrected=self._corrected(detector, d_hat, self.sample.batch.op)
            if detector is not None and detections
            else None,
        )

    def _verdict(
        self,
        detector: _glapp.Detector | None,
        quality: list[Finding],
        found: Identification | None,
        detections: int,
        rejected: dict[str, int],
    ) -> tuple[Verdict, str | None]:
        """What may be said, and in words why not more."""
        loop = self.loop
        refusal = _refusal(loop)
        findings = [(finding.code, finding.severity) for finding in quality]
        place = None if refusal is None else refusal[0]
        verdict, why = _glapp.verdict(place, self.sp_known, found is not None, findings, detector)
        if why is None:
            return verdict, None
        match why:
            case "primary" | "split_range" | "shared_valve", _:
                assert refusal is not None
                reason = refusal[1]
            case "no_sp", _:
                reason = NO_SP
            case "finding", [i]:
                reason = quality[int(i)].text
            case "no_law", _:
                what = "K and Ti are not given, and without an OP column they cannot be identified"
                reason = f"{what}: name the column (--op, columns.op), or give the controller"
            case "not_identified", _:
                assert found is not None
                reason = f"K and Ti are not given and could not be identified: {found.reason}"
            case "nothing_accepted", _:
                reason = _nothing_accepted(rejected)
            case "disagree", [kept, count]:
                reason = (
                    f"the detections do not agree: {kept:.0f} of the last {count:.0f} lie within 20 % of their median"
                )
            case "gain_too_low", _:
                assumed = self.origins["kp"][0] == "assumed"
                what = "the assumed Kp of 1.5 %/% does not fit" if assumed else "Kp is set too low"
                reason = f"Δy/Kp is larger than OP's travel: {what}, check kp and the span of PV"
            case "noise", [d_hat, floor]:
                unit = loop.op_label
                reason = (
                    f"the detections give {d_hat:.3g} {unit}, less than the {floor:.3g} {unit} that noise can feign"
                )
            case _:
                reason = f"{detections} of the {loop.n} detections that an estimate needs"
        return verdict, reason

    def _corrected(self, detector: _glapp.Detector, d_hat: float | None, op: Floats | None) -> Corrected:
        """The width with the bias of (2.4) taken out, or why there is none."""
        kp = None if self.origins["kp"][0] == "assumed" else self.kp
        sigma = None if op is None or not self.op_known else noise_sigma(op)
        integrating = self.loop.process.type == "integrating"
        pairs, found, doubt = detector.corrected(kp, self.op_known, sigma, integrating)
        reason = None if doubt is None else self._not_corrected(pairs, kp, *doubt)
        if d_hat is None:
            found, reason = None, "there is no estimate to correct"
        d, low, high, gain, gains = found or (None, None, None, kp, None)
        return Corrected(d, low, high, gain, gains, pairs, "op" if self.op_known else "(4.1)", reason)

    def _not_corrected(self, pairs: int, kp: float | None, name: str, numbers: list[float]) -> str:
        """Why there is no corrected width, in words."""
        match name, numbers:
            case "too_few", _:
                few = f"{pairs} pairs of half-periods in which PV came to rest off SP, where 3 are needed"
                return few if kp is not None else f"{few}, and 4 without the process gain"
            case "alike", _:
                return "PV's half-periods are too much alike to tell the process gain and the width apart: give kp"
            case "wrong_slope", _:
                return "OP travels less where PV swings further: not a gap in front of a process at rest"
            case "scattered", _:
                return f"the {pairs} pairs of half-periods do not agree: the load moves, or PV does not come to rest"
            case "noise", [d, noise]:
                return f"{d:.3g} {self.loop.op_label} is less than the {noise:.3g} that noise moves OP by"
            case "smooth", [tf]:
                filtered = f"PV filtered with {tf:.3g} s is too smooth to work out its turns by (4.1)"
                return f"OP is not recorded, and {filtered}"
            case "integrating", _:
                return "an integrating process does not come to rest off SP"
            case _:
                return "the valve moves further than the gap is wide"

    def _doubt(self, half_periods: HalfPeriods) -> Iterator[Finding]:
        """What an assumed Kp does to the detections."""
        good = half_periods.reason == 0
        if self.kp is not None and good.any():
            free, kp_part = (float(np.median(x[good])) for x in (half_periods.free, half_periods.kp_part))
            found = assumed_gain(
                self.kp, free, kp_part, pv_unit=self.loop.pv_unit or "PV unit", op_unit=self.loop.op_label
            )
            if found is not None:
                yield found

    def _trace(self, chosen: int | None) -> Trace:
        thinner = self.thinner
        t = thinner.times()
        none = Band(np.full(len(t), np.nan), np.full(len(t), np.nan))
        return Trace(
            t=t,
            sp=thinner.band("sp") if self.sp_known else none,
            pv=thinner.band("pv"),
            pv_filtered=none if chosen is None else thinner.band(f"filtered {chosen}"),
            op=thinner.band("op") if self.op_known else None,
            position=thinner.band("position") if self.position_known else None,
        )


def _refusal(loop: Loop) -> tuple[str, str] | None:
    """A place of the detector where its estimate would be wrong (thesis 8.3.2), by its name and in words."""
    if loop.cascade is not None and loop.cascade.role == "primary":
        partner = loop.cascade.partner or "the secondary loop"
        what = f"primary loop of a cascade: its OP is a setpoint, not a valve signal; analyse {partner} instead"
        return "primary", what
    if loop.split_range:
        return "split_range", "split range: OP works on several valves, and a width of OP belongs to none of them"
    if loop.shared_valve_with is not None:
        what = f"the valve is shared with {loop.shared_valve_with}: this OP is not what moves it all the time"
        return "shared_valve", what
    return None


def _nothing_accepted(rejected: dict[str, int]) -> str:
    from .report.words import REASONS as LABELS

    total = sum(rejected.values())
    if not total:
        return "PV never crossed SP: there is no half-period to read a gap from"
    ranked = sorted(rejected.items(), key=lambda item: -item[1])[:2]
    causes = " and ".join(f"{count} as {LABELS[name].label}" for name, count in ranked if count)
    return f"none of {total} half-periods was accepted: {causes}"


def _given_setpoint_weight(loop: Loop) -> float | None:
    """Setpoint weight b where a person stated it; its default says nothing about the controller."""
    controller = loop.controller
    if controller is None or "setpoint_weight" not in controller.model_fields_set:
        return None
    return controller.setpoint_weight


def _process_gain(loop: Loop) -> tuple[float | None, Known]:
    """Kp [PV unit/OP unit] and where it comes from."""
    spans = None
    if loop.pv_span is not None and loop.op_span is not None:
        spans = (loop.pv_span[1] - loop.pv_span[0], loop.op_span[1] - loop.op_span[0])
    integrating = loop.process.type == "integrating"
    kp, origin = _glapp.process_gain(loop.kp(), spans, integrating)
    dropped = "not known: its term is dropped, the estimate is high by Δy/Kp"
    if integrating:
        dropped = "integrating process: no static gain, its term is dropped"
    note = {"given": "given", "assumed": f"not given, taken as {_glapp.KP_DEFAULT} %/%", "unknown": dropped}[origin]
    return kp, (origin, note)


def _detector_settings(loop: Loop, ideal: Ideal, kp: float | None, h: float) -> dict[str, Any]:
    given = {} if loop.tf is None else {"tf": loop.tf}
    return {**ideal._asdict(), **given, "kp": kp, "n": loop.n, "h": h, "op_limits": op_range(loop)}


def with_op_unit(loop: Loop, batch: Batch) -> Loop:
    """Give up the assumption that OP is a percentage where nothing says so and the recording contradicts it."""
    assumed = loop.op_span is None and loop.op_unit is None
    if assumed and batch.op is not None and bool(np.any((batch.op < 0.0) | (batch.op > 100.0))):
        return loop.model_copy(update={"op_unit": "OP unit"})
    return loop


def op_range(loop: Loop) -> tuple[float, float] | None:
    """Span of OP; that of a percentage where nothing else is said."""
    return (0.0, 100.0) if loop.op_span is None and loop.op_label == "%" else loop.op_span


def _ladder(loop: Loop, ideal: Ideal, kp: float | None, h: float) -> _glapp.Ladder:
    try:
        return _glapp.Ladder(_detector_settings(loop, ideal, kp, h))
    except ValueError as error:
        raise InputError(str(error), loop=loop.name) from None


def _half_periods(detector: _glapp.Detector | None, op_known: bool) -> HalfPeriods:
    if detector is None:
        return HalfPeriods.empty()
    table = detector.table()
    if not op_known:
        table["op_travel"] = np.full(len(table["t_start"]), np.nan)
    return HalfPeriods(**table)


def _floats(values: ArrayLike) -> NDArray[np.float64]:
    return np.ascontiguousarray(values, dtype=np.float64)
