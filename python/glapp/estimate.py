"""From a recording, or a stream of samples, to the width of the gap."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
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
from .result import REASONS, Corrected, HalfPeriods, Result, Settings, Verdict
from .samples import recording_of
from .trace import Band, Thinner, Trace

__all__ = ["Estimator", "analyze", "estimate", "identify"]

Floats = NDArray[np.float64]

INSPECTED_ROWS = 500_000
"""Rows that identification and the closer look at quality take from the beginning of a recording."""

CHECKED_ROWS = 20_000
"""Rows from which given settings are checked."""

KP_DEFAULT = 1.5
"""Process gain [%/%] where none is known but both spans are (thesis 7.2.2)."""

KP_ASSUMED = f"not given, taken as {KP_DEFAULT} %/%"
"""Note beside it."""

NO_SP = "SP is not recorded, and half-periods are told by where PV crosses it: name its column (--sp, columns.sp)"
"""Why there is no estimate from crossings where the fit may have one."""

LADDER = (0.2, 0.5, 1.0, 2.0)
"""Filter times tried where none is given, in Ti, after the shortest that serves (thesis 2.1, 8.2, 8.4)."""


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
    run = _Run(recording, loop, sample.median_step, ideal, {}, _process_gain(loop))
    run.all(progress)
    return run.result([], None, sample.batch)


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
    notes: dict[str, str] = {}
    if ideal is None and found is not None and found.k and found.ti and (found.usable or trust):
        ideal = Ideal(
            found.k, found.ti, found.td or 0.0, 1.0 if found.setpoint_weight is None else found.setpoint_weight
        )
        notes = dict.fromkeys(("k", "ti"), f"identified (R² {found.r2:.3f})")
        notes["td"] = notes["k"] if found.td else "PI law identified"
        notes["b"] = "no setpoint change to tell it by" if found.setpoint_weight is None else notes["k"]
    run = _Run(recording, loop, sample.median_step, ideal, notes, _process_gain(loop))
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
    told = [batch] if windows is None else windows.best()
    fitted = _fit(told, loop, ideal, quality, fitting) if fit else None
    known = loop.process.type == "integrating" or run.notes["kp"] == "given"
    if fitted is not None and not known and (gain := _fitted_gain(fitted)) is not None:
        run = _Run(recording, loop, sample.median_step, ideal, notes, gain)
        run.all(again)
    return replace(run.result(quality, found, batch), fit=fitted)


def _fitted_gain(fit: Fit) -> tuple[float, str] | None:
    """Kp where the fit found a lost motion and with it the gain of a process that does not integrate, to a third."""
    if not fit.found or fit.process is None or fit.process.integrating:
        return None
    kp, low, high = fit.process.kp
    if not low * high > 0 or abs(high - low) > 2 * abs(kp) / 3:
        return None
    return kp, f"fitted from OP and PV ({low:.3g} to {high:.3g})"


def _fit(
    batches: list[Batch], loop: Loop, ideal: Ideal | None, quality: list[Finding], progress: Progress | None
) -> Fit:
    """The fit, told what is already known: the sign of the process, and what makes any answer wrong."""
    refusals = [*_refusals(loop), *(f.text for f in quality if f.severity == "refuse" and f.code != "not_auto")]
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


class Estimator(_glapp.Detector):
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

    def __new__(cls, loop: Loop, h: float) -> Self:
        """Make one, at the beginning of a stream."""
        ideal = loop.ideal()
        if ideal is None:
            raise InputError("has no controller settings", loop=loop.name, parameter="controller", hint="give K and Ti")
        if not h > 0:
            raise InputError(f"is {h}, must be > 0 s", parameter="h", value=h, bound="> 0 s")
        tf = loop.tf if loop.tf is not None else _ladder(ideal)[0]
        return super().__new__(cls, _detector_settings(loop, ideal, tf, _process_gain(loop)[0], h))

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
        self.run(
            _floats(t),
            _floats(sp),
            _floats(pv),
            None if op is None else _floats(op),
            None if flags is None else np.ascontiguousarray(flags, dtype=np.uint8),
            False,
        )

    @property
    def half_periods(self) -> HalfPeriods:
        """Table of the half-periods that `update_many` has ended."""
        return HalfPeriods(**self.table())

    def save(self) -> str:
        """Settings and state as JSON; the table is not part of it."""
        return self.to_json()

    @classmethod
    def load(cls, saved: str) -> Self:
        """The estimator that `save` saved: it goes on with the same bits as one never interrupted.

        Raises
        ------
        InputError
            Where the text is not what `save` gave.
        """
        self = super().__new__(cls, {"k": 1.0, "ti": 1.0, "h": 1.0})
        try:
            self.restore(saved)
        except ValueError as error:
            raise InputError(str(error)) from None
        return self

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return type(self).load, (self.save(),)


@dataclass(frozen=True, slots=True)
class _Inspection:
    batch: Batch
    median_step: float


def _inspection(recording: Recording, rows: int) -> _Inspection:
    """The first rows, and the median step between them [s]."""
    whole = recording.beginning(rows)
    steps = np.diff(whole.t)
    steps = steps[np.isfinite(steps) & (steps > 0)]
    return _Inspection(whole, float(np.median(steps)) if len(steps) else 1.0)


class _Run:
    """One pass over a recording with a detector for every filter time that is tried."""

    def __init__(
        self,
        recording: Recording,
        loop: Loop,
        step: float,
        ideal: Ideal | None,
        notes: dict[str, str],
        gain: tuple[float | None, str],
    ) -> None:
        self.recording = recording
        self.loop = loop
        self.ideal = ideal
        self.h = step
        self.max_h = GAP_STEPS * step
        self.kp, kp_note = gain
        self.notes = {**dict.fromkeys(("k", "ti", "td", "b"), "given"), **notes, "kp": kp_note}
        self.thinner = Thinner()
        self.op_known = self.position_known = False
        self.sp_known = "SP" in recording.columns
        self.filter_times: list[float] = []
        if ideal is not None and self.sp_known:
            self.filter_times = [self.loop.tf] if self.loop.tf is not None else _ladder(ideal)
        self.detectors = [
            _detector(self.loop, ideal, tf, self.kp, self.h) for tf in self.filter_times if ideal is not None
        ]

    def all(
        self, progress: Progress | None, census: _glapp.Census | None = None, windows: _glapp.Windows | None = None
    ) -> None:
        """Read the recording from its first to its last row, the detectors side by side."""
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            each = pool.map if len(self.detectors) > 1 else map
            for batch in self.recording.batches():
                filtered = each(_taking(batch), self.detectors)
                if census is not None:
                    # Of an SP that is not recorded nothing is told.
                    census.run(batch.t, batch.pv if batch.sp is None else batch.sp, batch.pv, batch.op, batch.flags)
                if windows is not None:
                    windows.add(batch)
                columns = {"pv": batch.pv}
                for name in ("sp", "op", "position"):
                    if (signal := getattr(batch, name)) is not None:
                        columns[name] = signal
                columns.update((f"filtered {i}", signal) for i, signal in enumerate(filtered))
                self.thinner.add(batch.t, columns)
                self.op_known = self.op_known or batch.op is not None
                self.position_known = self.position_known or batch.position is not None
                if progress is not None:
                    progress(self.recording.fraction_read())

    def result(self, quality: list[Finding], found: Identification | None, beginning: Batch) -> Result:
        """Choose the filter time and say what was found; OP's noise is that of the recording's `beginning`."""
        loop, ideal, notes = self.loop, self.ideal, self.notes
        chosen = self._choose()
        detector = self.detectors[chosen] if self.detectors else None
        tf = None
        if detector is not None:
            tf = self.filter_times[chosen]
            notes["tf"] = "given" if loop.tf is not None else f"smallest of {len(self.filter_times)} that serves"
            notes["delta_u"] = {
                "integral": "K/Ti·∫|e|dt (7.5)",
                "derivative": "K/Ti·∫|e|dt with the derivative part (7.6)",
                "op": "OP's own travel",
            }[detector.travel_source(self.op_known)]
        half_periods = _half_periods(detector, self.op_known)
        if notes["kp"] == KP_ASSUMED and self.kp is not None:
            quality = [*quality, *self._doubt(half_periods)]
        counts = dict(zip(REASONS, detector.reasons if detector is not None else [0] * len(REASONS), strict=True))
        detections = counts.pop("accepted")
        floor = detector.noise_floor if detector is not None else None
        value = detector.median_mean if detector is not None else None
        verdict, reason = _verdict(self, quality, found, value, detections, counts, floor)
        shown = value if verdict in ("estimate", "provisional") else None
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
            noise_floor=floor,
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
                notes=notes,
            ),
            quality=quality,
            identification=found,
            trace=self._trace(chosen),
            corrected=self._corrected(detector, tf, d_hat, beginning.op) if detections else None,
        )

    def _corrected(
        self, detector: _glapp.Detector | None, tf: float | None, d_hat: float | None, op: Floats | None
    ) -> Corrected:
        """The width with the bias of (2.4) taken out, or why there is none."""
        assert detector is not None and tf is not None and self.ideal is not None  # there are detections
        kp = None if self.notes["kp"] == KP_ASSUMED else self.kp
        pairs, found, doubt = detector.corrected(kp)
        reason = None if doubt is None else self._doubts(pairs, kp)[doubt]
        if self.op_known:
            # Noise alone moves OP from end to end by about six times its deviation, and the valve follows.
            sigma = None if op is None else noise_sigma(op)
            noise = 0.0 if sigma is None else 6.0 * sigma
            if found is not None and found[0] < noise:
                reason = f"{found[0]:.3g} {self.loop.op_label} is less than the {noise:.3g} that noise moves OP by"
        elif tf > 1.001 * (0.2 * (self.ideal.td or self.ideal.ti)):
            reason = f"OP is not recorded, and PV filtered with {tf:.3g} s is too smooth to work out its turns by (4.1)"
        if self.loop.process.type == "integrating":
            reason = "an integrating process does not come to rest off SP"
        if d_hat is None:
            reason = "there is no estimate to correct"
        d, low, high, gain, gains = found if found is not None and reason is None else (None, None, None, kp, None)
        return Corrected(d, low, high, gain, gains, pairs, "op" if self.op_known else "(4.1)", reason)

    def _doubts(self, pairs: int, kp: float | None) -> dict[str, str]:
        """Why the pairs of half-periods give no width, in words."""
        few = f"{pairs} pairs of half-periods in which PV came to rest off SP, where 3 are needed"
        return {
            "too_few": few if kp is not None else f"{few}, and 4 without the process gain",
            "alike": "PV's half-periods are too much alike to tell the process gain and the width apart: give kp",
            "wrong_slope": "OP travels less where PV swings further: not a gap in front of a process at rest",
            "scattered": f"the {pairs} pairs of half-periods do not agree: the load moves, or PV does not come to rest",
            "swamped": "the valve moves further than the gap is wide",
        }

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

    def _choose(self) -> int:
        """The smallest filter time that leaves enough accepted half-periods; where none does, the one with most."""
        accepted = [detector.reasons[0] for detector in self.detectors]
        enough = (self.loop.n + 1) // 2
        for i, count in enumerate(accepted):
            if count >= enough:
                return i
        return int(np.argmax(accepted)) if accepted else 0

    def _trace(self, chosen: int) -> Trace:
        thinner = self.thinner
        t = thinner.times()
        none = Band(np.full(len(t), np.nan), np.full(len(t), np.nan))
        return Trace(
            t=t,
            sp=thinner.band("sp") if self.sp_known else none,
            pv=thinner.band("pv"),
            pv_filtered=thinner.band(f"filtered {chosen}") if self.detectors else none,
            op=thinner.band("op") if self.op_known else None,
            position=thinner.band("position") if self.position_known else None,
        )


def _verdict(
    run: _Run,
    quality: list[Finding],
    found: Identification | None,
    value: tuple[float, float, float, int, int] | None,
    detections: int,
    rejected: dict[str, int],
    floor: float | None,
) -> tuple[Verdict, str | None]:
    """What may be said, and why not more."""
    loop = run.loop
    for refusal in _refusals(loop):
        return "refused", refusal
    if not run.sp_known:
        return "refused", NO_SP
    for finding in quality:
        if finding.code == "not_auto" and finding.severity == "refuse":
            return "no_estimate", finding.text  # the data is in order; the loop just did not control
    for finding in quality:
        if finding.severity == "refuse":
            return "refused", finding.text
    for finding in quality:
        if finding.code == "sinusoidal":
            return "no_estimate", finding.text
    if run.ideal is None:
        if found is None:
            what = "K and Ti are not given, and without an OP column they cannot be identified"
            return "refused", f"{what}: name the column (--op, columns.op), or give the controller"
        return "refused", f"K and Ti are not given and could not be identified: {found.reason}"
    if value is None:
        return "no_estimate", _nothing_accepted(rejected)
    d_hat, _, _, kept, count = value
    if 3 * kept < count:
        return "no_estimate", f"the detections do not agree: {kept} of the last {count} lie within 20 % of their median"
    if d_hat <= 0:
        assumed = run.notes["kp"] == KP_ASSUMED
        what = "the assumed Kp of 1.5 %/% does not fit" if assumed else "Kp is set too low"
        return "no_estimate", f"Δy/Kp is larger than OP's travel: {what}, check kp and the span of PV"
    if floor is not None and d_hat < floor:
        unit = loop.op_label
        text = f"the detections give {d_hat:.3g} {unit}, less than the {floor:.3g} {unit} that noise can feign"
        return "no_estimate", text
    if detections < loop.n:
        return "provisional", f"{detections} of the {loop.n} detections that an estimate needs"
    return "estimate", None


def _refusals(loop: Loop) -> Iterator[str]:
    """Places of the detector where its estimate would be wrong (thesis 8.3.2)."""
    if loop.cascade is not None and loop.cascade.role == "primary":
        partner = loop.cascade.partner or "the secondary loop"
        yield f"primary loop of a cascade: its OP is a setpoint, not a valve signal; analyse {partner} instead"
    if loop.split_range:
        yield "split range: OP works on several valves, and a width of OP belongs to none of them"
    if loop.shared_valve_with is not None:
        yield f"the valve is shared with {loop.shared_valve_with}: this OP is not what moves it all the time"


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


def _process_gain(loop: Loop) -> tuple[float | None, str]:
    """Kp [PV unit/OP unit] and where it comes from."""
    if loop.process.type == "integrating":
        return None, "integrating process: no static gain, its term is dropped"
    if (kp := loop.kp()) is not None:
        return kp, "given"
    if loop.pv_span is not None and loop.op_span is not None:
        ratio = (loop.pv_span[1] - loop.pv_span[0]) / (loop.op_span[1] - loop.op_span[0])
        return KP_DEFAULT * ratio, KP_ASSUMED
    return None, "not known: its term is dropped, the estimate is high by Δy/Kp"


def _ladder(ideal: Ideal) -> list[float]:
    first = _glapp.filter_time(ideal.ti, ideal.td)
    return [first, *(tf for share in LADDER if (tf := share * ideal.ti) > first)]


def _detector_settings(loop: Loop, ideal: Ideal, tf: float, kp: float | None, h: float) -> dict[str, Any]:
    return {**ideal._asdict(), "kp": kp, "tf": tf, "n": loop.n, "h": h, "op_limits": op_range(loop)}


def with_op_unit(loop: Loop, batch: Batch) -> Loop:
    """Give up the assumption that OP is a percentage where nothing says so and the recording contradicts it."""
    assumed = loop.op_span is None and loop.op_unit is None
    if assumed and batch.op is not None and bool(np.any((batch.op < 0.0) | (batch.op > 100.0))):
        return loop.model_copy(update={"op_unit": "OP unit"})
    return loop


def op_range(loop: Loop) -> tuple[float, float] | None:
    """Span of OP; that of a percentage where nothing else is said."""
    return (0.0, 100.0) if loop.op_span is None and loop.op_label == "%" else loop.op_span


def _detector(loop: Loop, ideal: Ideal, tf: float, kp: float | None, h: float) -> _glapp.Detector:
    try:
        return _glapp.Detector(_detector_settings(loop, ideal, tf, kp, h))
    except ValueError as error:
        raise InputError(str(error), loop=loop.name) from None


def _taking(batch: Batch) -> Callable[[_glapp.Detector], NDArray[np.float64]]:
    """What a detector does with a batch; it gives the filtered PV."""

    def take(detector: _glapp.Detector) -> NDArray[np.float64]:
        assert batch.sp is not None  # without it there is no detector
        filtered = detector.run(batch.t, batch.sp, batch.pv, batch.op, batch.flags, True)
        assert filtered is not None  # asked for
        return filtered

    return take


def _half_periods(detector: _glapp.Detector | None, op_known: bool) -> HalfPeriods:
    if detector is None:
        return HalfPeriods.empty()
    table = detector.table()
    if not op_known:
        table["op_travel"] = np.full(len(table["t_start"]), np.nan)
    return HalfPeriods(**table)


def _floats(values: ArrayLike) -> NDArray[np.float64]:
    return np.ascontiguousarray(values, dtype=np.float64)
