"""Result of an analysis of one loop."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import datetime
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _glapp
from .arrays import column
from .errors import InputError
from .fit import Fit
from .identify import Identification
from .loop import Loop
from .notebook import table
from .quality import Finding
from .recording import Batch
from .trace import Trace

if TYPE_CHECKING:
    import pandas as pd

    from .planned import Plan
    from .repaired import Repair
    from .step_test import StepTest

__all__ = ["REASONS", "Answer", "Confidence", "Corrected", "HalfPeriods", "Harm", "Limit", "Moves", "Next", "Origin"]
__all__ += ["Result", "Settings", "StepTestWidth", "Struck", "Verdict", "decide", "span_of"]

REASONS = tuple(_glapp.reasons())
"""Names of the codes in `HalfPeriods.reason`; the bit of a reason in `HalfPeriods.mask` is its code − 1."""

Crossings = Literal["estimate", "provisional", "no_estimate", "refused"]
"""Verdict of the zero crossings; provisional: fewer than N detections."""

Verdict = Literal[Crossings, "backlash", "stiction", "both", "oscillation", "sound", "at_least", "cannot_tell"]
"""The one verdict of a loop: the fit's, or where nothing was fitted that of the crossings."""

Confidence = Literal["found", "likely", "cannot_tell", "likely_sound", "none_seen", "sound", "refused", "not_judged"]
"""Confidence that there is a dead band."""

Origin = Literal["given", "identified", "fitted", "assumed", "chosen", "unknown"]
Floats = NDArray[np.float64]

_FACTS = ("verdict", "why", "d", "low", "high", "lr_no_gap", "lr_needed", "judgement", "weighed")
"""Fields of a fit that the one answer depends on, with the trend of its width."""


@dataclass(frozen=True, slots=True, repr=False)
class HalfPeriods:
    """A table of half-periods, one array a column, in the order of time.

    All half-periods that last longer than 5·Ti are here, and of the shorter ones the first 50 000.

    Attributes
    ----------
    t_start, t_end : float64[n]
        First sample; sample that ended it, or the last one before a gap [s since t0].
    sign : int8[n]
        +1: PV below SP, −1: above, 0: neither was seen.
    samples : uint32[n]
        Number of samples.
    delta_t : float64[n]
        Duration Δt [s], without the time of a gap.
    delta_y, e_max, delta_sp : float64[n]
        Mean distance to the setpoint Δy (2.2), largest error, range of the setpoint [PV unit].
    delta_u, delta_u_d, delta_u_sp : float64[n]
        K/Ti·Δy·Δt (7.5), derivative part of (7.6), part of a moving setpoint [OP unit].
    op_travel : float64[n]
        OP's own travel in the direction of the integral action [OP unit], NaN where OP is not recorded.
    swing : float64[n]
        OP's travel from its furthest point in the half-period before to that in this one [OP unit]; NaN where there is
        none to count from, and all through with an `Estimator`, which does not look at it.
    plateau : float64[n]
        Height of PV's plateau [PV unit]; NaN with an `Estimator`.
    free, kp_part, d : float64[n]
        Kp-free part and Kp part of the width, and the width (2.4) [OP unit].
    previous_delta_y : float64[n]
        Δy of the half-period before [PV unit], NaN where there is none to compare with.
    d_hat_before : float64[n]
        Estimate compared in (5.1) [OP unit], NaN where it was not asked.
    mask : uint16[n]
        All conditions that failed, a bit each.
    reason : uint8[n]
        First of them: a code of `REASONS`, 0 = accepted.
    d_hat : float64[n]
        Estimate after the half-period [OP unit], NaN while there is none or it is below the noise limit.
    median_mean : float64[n]
        What the detections say, whether above the noise limit or not [OP unit], NaN while there are none.
    noise_floor : float64[n]
        The noise limit, by its level at the last detection [OP unit], NaN where it is not known.
    detections : uint8[n]
        Detections in the filter's window after the half-period.
    """

    t_start: Floats
    t_end: Floats
    sign: NDArray[np.int8]
    samples: NDArray[np.uint32]
    delta_t: Floats
    delta_y: Floats
    e_max: Floats
    delta_sp: Floats
    delta_u: Floats
    delta_u_d: Floats
    delta_u_sp: Floats
    op_travel: Floats
    swing: Floats
    plateau: Floats
    free: Floats
    kp_part: Floats
    d: Floats
    previous_delta_y: Floats
    d_hat_before: Floats
    mask: NDArray[np.uint16]
    reason: NDArray[np.uint8]
    d_hat: Floats
    median_mean: Floats
    noise_floor: Floats
    detections: NDArray[np.uint8]

    @classmethod
    def empty(cls) -> HalfPeriods:
        """A table without rows."""
        kinds = {"sign": np.int8, "samples": np.uint32, "mask": np.uint16, "reason": np.uint8, "detections": np.uint8}
        return cls(**{column.name: np.empty(0, kinds.get(column.name, np.float64)) for column in fields(cls)})

    def __repr__(self) -> str:
        return f"<HalfPeriods: {self.count} rows of {', '.join(self.to_dict())}>"

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.t_start)

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """The columns by name."""
        return {column.name: getattr(self, column.name) for column in fields(self)}


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings that the detector used, in ideal form, seconds and the signals' units.

    Attributes
    ----------
    k, ti, td, b : float or None
        Controller [OP unit/PV unit, s, s, 1]; None where nothing is known of it.
    tf : float or None
        Time constant of the detector's filter [s].
    kp : float or None
        Process gain [PV unit/OP unit]; None: its term is dropped.
    n : int
        Detections behind one estimate.
    max_h : float or None
        A longer step is a gap [s].
    notes : dict
        Where each of them comes from, in words.
    origins : dict
        The same as one of *given*, *identified* (from OP's moves), *fitted* (with the gap), *assumed* (the usual
        value), *chosen* (of those tried), *unknown* (its term is left out).
    """

    k: float | None
    ti: float | None
    td: float | None
    b: float | None
    tf: float | None
    kp: float | None
    n: int
    max_h: float | None
    notes: dict[str, str]
    origins: dict[str, Origin]


@dataclass(frozen=True, slots=True)
class Corrected:
    """The width from zero crossings with the known bias of (2.4) taken out.

    It is shown in addition to the estimate, never instead of it.

    Between two reversals OP travels d, and PV's whole way from plateau to plateau over Kp, not half of it:
    travel = d + way/Kp. Where Kp is not known, several half-periods of different Δy give d and Kp together.

    Attributes
    ----------
    d : float or None
        Total width [`Result.unit`]; None: `reason` says why.
    low, high : float or None
        Its range: of the pairs of half-periods that agree where Kp is known, else with any one pair left out. How well
        they repeat, not an interval of confidence.
    kp : float or None
        |Kp| [PV unit/OP unit] that it is computed with.
    kp_range : (float, float) or None
        Range of Kp with any one pair left out; None where it was known.
    pairs : int
        Pairs of half-periods that it is made of.
    travel : "op" or "(4.1)"
        OP as recorded, or as (4.1) makes it of SP and PV.
    reason : str or None
        Why there is no width.
    """

    d: float | None
    low: float | None
    high: float | None
    kp: float | None
    kp_range: tuple[float, float] | None
    pairs: int
    travel: Literal["op", "(4.1)"]
    reason: str | None

    def to_dict(self) -> dict[str, Any]:
        """The corrected width in plain types, as `glapp analyze --json` writes it."""
        shown = {column.name: getattr(self, column.name) for column in fields(self)}
        return shown | {"kp_range": None if self.kp_range is None else list(self.kp_range)}


@dataclass(frozen=True, slots=True)
class Next:
    """Next step: a code, and its subject (a part of the valve, a reason of rejection) where it has one.

    `tested`: the recording holds a step test, which is used; no further one is asked for.
    """

    code: str
    of: str | None = None
    tested: bool = False


@dataclass(frozen=True, slots=True)
class Struck:
    """Why the crossings' width is contradicted: *above* or *below* a limit of the fit, or of a *sound* valve.

    `limit` is the fit's [OP unit].
    """

    code: Literal["above", "below", "sound"]
    limit: float


@dataclass(frozen=True, slots=True)
class Limit:
    """Widest acceptable dead band [% of OP span], the same [OP unit] where the span is known, and its source.

    *given*: a person, for this loop; *nominal*: nobody, and 1 % of span is taken (EnTech's nominal dead band).
    """

    percent_span: float
    width: float | None
    origin: Literal["given", "nominal"]


@dataclass(frozen=True, slots=True)
class StepTestWidth:
    """Width that a step test in the recording gives, with its 95 % limits [OP unit].

    `decided` is what the test was made to decide, and has decided: "gap" or "no_gap"; None of any other test. Where the
    test has decided by a lower limit alone, `d` is that limit and `high` None.
    """

    d: float
    low: float | None
    high: float | None
    decided: Literal["gap", "no_gap"] | None = None


@dataclass(frozen=True, slots=True)
class Harm:
    """Harm of the gap to the loop: shares, 0 to 1, of PV's variance about SP and of OP's travel; `worst` of both."""

    pv_share: float | None
    op_share: float | None
    worst: float | None = None


@dataclass(frozen=True, slots=True)
class Moves:
    """Trend of the width.

    - `code`: whether a change is clear: five widths or more, and three standard errors.
    - `widths`, `widths_needed`: widths that it is based on, and that a change needs.
    - `per_day`, `low`, `high`, `least_plain`: change of the width with its 95 % limits, and the least change that
      would be clear [OP unit/day].
    - `t`, `d`: first and last of the widths [s], and the line's widths there [OP unit].
    - `days_to_limit`: days from the last width on until it reaches what is acceptable.
    """

    code: Literal["grows", "shrinks", "steady", "too_few"]
    widths: int
    widths_needed: int
    per_day: float | None
    low: float | None
    high: float | None
    least_plain: float | None
    t: tuple[float, float] | None
    d: tuple[float, float] | None
    days_to_limit: float | None


@dataclass(frozen=True, slots=True)
class Answer:
    """The one answer of a loop, from all that is known of its valve; decided in `crates/analysis/src/summary`.

    Attributes
    ----------
    verdict : str
        The fit's, or where nothing was fitted that of the crossings.
    valve : "gap", "no_gap", "unknown", "refused"
        What that means for the valve.
    confidence : str
        How sure it is that there is a dead band: *found*, *likely*, *cannot_tell*, *likely_sound* (one wider than is
        acceptable is improbable), *none_seen* (above `high`), *sound* (none wider than is acceptable), *refused* (data
        or settings allow no answer), *not_judged* (OP and PV were not fitted; zero crossings alone do not judge a
        valve).
    cause : "backlash", "stiction", "both", "dead_band" or None
        Its cause; dead_band: play or packing, the data do not show which.
    width_kind : "interval", "bound", "unsure" or None
        Whether the width has two limits, is one limit, or is not known well.
    oscillates : bool
        Whether the loop oscillates as a clean sinusoid, which no dead band causes.
    width : float or None
        The width that lists rank by: the most likely one, or the bound where only that is known; None where no gap
        was found [`Result.unit`].
    width_percent_span : float or None
        The same [% of OP span], None where the span is not known.
    low, high, low_percent_span, high_percent_span : float or None
        Narrowest and widest gap that the data does not exclude [`Result.unit`, % of OP span]; where the valve is
        likely sound, at most what is acceptable. Both None where nothing is excluded.
    evidence : "none", "weak", "strong", "very_strong" or None
        How strongly the recording speaks for a gap; None without a fit.
    p_gap, p_beyond : float or None
        Probability of a dead band, and of one beyond the limit, 0.02 to 0.98; None where no evidence was weighed.
    terms : dict or None
        What each kind of evidence adds to the log-odds of a dead band; above 0 is evidence for one.
    log_bayes_factor : float or None
        ln of how many times more probable the evidence is with a dead band than without.
    prior : float or None
        Share of valves with a dead band that `p_gap` starts from: `Loop.dead_band_prior`, or 0.25.
    limit : Limit or None
        What is acceptable; None where nobody gave it and the span is not known.
    acceptable : "within", "beyond", "open" or None
        Where the width is relative to the limit; open: it may be on either side. None where either is not known.
    next : Next
        What to do next.
    urgency : "none", "low", "medium", "high"
        How soon; at most medium where nobody gave a limit.
    health : "NORMAL", "MAINTENANCE_REQUIRED"
        Health of the valve by NAMUR NE 107.
    trend : Moves or None
        How the width changes in time; None where there are too few widths.
    step_test : StepTestWidth or None
        What a step test in the recording gives.
    harm : Harm or None
        What the gap does to the loop.
    compensable : float or None
        The width that a compensation may trust [`Result.unit`]: the lower limit, only with the verdict backlash; 0 for
        a valve that shows no gap. None: a person must type one.
    score : float or None
        What loops of one urgency are ranked by: the lower limit of the gap over what is acceptable, times its harm.
    rank : (int, int, int, float)
        Place of the loop in every list; smaller comes first.
    struck : Struck or None
        Why the crossings' width contradicts the fit; None where it does not, or there is none.
    """

    verdict: Verdict
    valve: Literal["gap", "no_gap", "unknown", "refused"]
    confidence: Confidence
    cause: Literal["backlash", "stiction", "both", "dead_band"] | None
    width_kind: Literal["interval", "bound", "unsure"] | None
    oscillates: bool
    width: float | None
    width_percent_span: float | None
    low: float | None
    low_percent_span: float | None
    high: float | None
    high_percent_span: float | None
    evidence: Literal["none", "weak", "strong", "very_strong"] | None
    p_gap: float | None
    p_beyond: float | None
    terms: dict[str, float] | None
    log_bayes_factor: float | None
    prior: float | None
    limit: Limit | None
    acceptable: Literal["within", "beyond", "open"] | None
    next: Next
    urgency: Literal["none", "low", "medium", "high"]
    health: Literal["NORMAL", "MAINTENANCE_REQUIRED"]
    trend: Moves | None
    step_test: StepTestWidth | None
    harm: Harm | None
    compensable: float | None
    score: float | None
    rank: tuple[int, int, int, float]
    struck: Struck | None

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Answer:
        """The answer of the core or of a document; the document's sentences are left out."""
        parts = {
            "limit": Limit,
            "step_test": StepTestWidth,
            "harm": Harm,
            "struck": Struck,
            "trend": Moves,
            "next": Next,
        }
        values = {column.name: document[column.name] for column in fields(cls)} | {"rank": tuple(document["rank"])}
        for name, part in parts.items():
            if values[name] is not None:
                numbers = {column.name: values[name].get(column.name) for column in fields(part)}
                values[name] = part(**numbers)
        return cls(**values)


def decide(
    *,
    crossings: Crossings,
    d_hat: float | None,
    detections: int,
    reasons: Mapping[str, int],
    fit: Fit | None,
    loop: Loop,
    step_test: StepTest | None = None,
    harm: Sequence[Harm] = (),
) -> Answer:
    """The one answer on a valve by the known facts, as the core decides it.

    - `crossings`, `d_hat`, `detections`, `reasons`, `fit`, `step_test`: as in `Result`.
    - `loop`: whose OP span and acceptable dead band count.
    - `harm`: what the gap does to the loop, in each window where that was worked out; the mean of each share counts.

    Examples
    --------
    >>> loop = Loop(name="FIC101", op_span=(4, 20), op_unit="mA")
    >>> fit = Fit("backlash", "", "mA", 0.5, 0.4, 0.6, lr_no_gap=90.0, lr_needed=15.0)
    >>> answer = decide(crossings="no_estimate", d_hat=None, detections=0, reasons={}, fit=fit, loop=loop)
    >>> answer.limit, answer.urgency, answer.next.code
    (Limit(percent_span=1.0, width=0.16, origin='nominal'), 'medium', 'inspect')
    """
    of_fit = None
    if fit is not None:
        of_fit = {name: getattr(fit, name) for name in _FACTS} | {"trend": fit.change}
    test = step_test
    if test is not None and test.d is None:  # no width, but a lower limit may have decided
        test = replace(test, d=test.low) if test.asked is not None and test.asked.found is not None else None
    facts = {
        "crossings": crossings,
        "d_hat": d_hat,
        "detections": detections,
        "rejected": max(reasons, key=lambda name: reasons[name], default=None),
        "fit": of_fit,
        "span": span_of(loop),
        "acceptable": loop.acceptable_dead_band,
        "prior": loop.prior(),
        "step_test": test
        and {"d": test.d, "low": test.low, "high": test.high, "decided": test.asked and test.asked.found},
        "harm": [{"pv_share": part.pv_share, "op_share": part.op_share} for part in harm],
    }
    return Answer.of(_glapp.summary(json.dumps(facts)))


def harm_of(fit: Fit, law: tuple[float | None, float | None], rows: Batch) -> Harm:
    """Harm of the fitted gap to its loop, where it can be computed.

    - `fit`: through PV; its `best` window has the cells, and its `process` what a load at the valve does to PV.
    - `law`: the controller's K [OP unit/PV unit] and Ti [s].
    - `rows`: the rows with the cells.
    """
    best, p = fit.best, fit.process
    if p is None or rows.op is None or best.get("signal") != "PV":
        return Harm(None, None)
    k, ti = law
    cells = tuple(column(best[name]) for name in ("t", "pv", "position"))
    process = (p.kp[0], p.dead_time[0], p.lag[0]), p.integrating
    return Harm(**_glapp.harm(cells, rows, None if k is None or ti is None else (k, ti), process))


def span_of(loop: Loop) -> float | None:
    """Width of OP's span [OP unit], None where it is not known; a loop in % without a given span has 100."""
    if loop.op_span is not None:
        return loop.op_span[1] - loop.op_span[0]
    return 100.0 if loop.op_label == "%" else None


@dataclass(frozen=True, slots=True, repr=False)
class Result:
    """The answer for one loop: `answer` is the one answer, all else is its evidence.

    Attributes
    ----------
    name, source : str
        Loop, and the file it was recorded in, or "memory".
    loop : Loop
        What was known about it.
    t0 : datetime or None
        Time of t = 0.
    crossings : "estimate", "provisional", "no_estimate", "refused"
        What the zero crossings allow to be said. provisional: fewer than N detections. refused: data or settings do
        not allow an estimate.
    why : str or None
        Why not more, in a word that stays the same from version to version; None only with an estimate.
    reason : str or None
        The same in one sentence.
    d_hat : float or None
        Total width of the gap by zero crossings, as a PLC would show it [`unit`]; `answer.struck` says where it does
        not stand.
    unit : str
        Unit of OP.
    d_hat_percent_span : float or None
        The same [% of OP span], None where the span is not known.
    repeatability : (float, float) or None
        Smallest and largest detection behind `d_hat` [`unit`]: how well detections repeat, not an interval of
        confidence.
    noise_floor : float or None
        Noise alone can produce a width up to this [`unit`].
    detections : int
        Accepted half-periods.
    half_periods : HalfPeriods
        Table of half-periods.
    reasons : dict
        First reason of rejection to how many half-periods, over all of them.
    settings : Settings
        What the detector worked with.
    answer : Answer
        The one answer.
    quality : list of Finding
        What is wrong with the recording, gravest first.
    identification : Identification or None
        K and Ti as the recording shows them, where they were asked for.
    trace : Trace or None
        The signals, thinned for a screen.
    fit : Fit or None
        Width with an interval from OP and PV (`glapp.fit`); None without OP.
    corrected : Corrected or None
        The width from zero crossings with its known bias taken out; None without detections.
    step_test : StepTest or None
        What a step test in the recording's first half million rows gives (`glapp.step_test`), where it gives a width.
    plan : Plan or None
        What would decide whether there is a gap (`glapp.plan_test`), where that was asked for and is open.
    repair : Repair or None
        The valve before and after its repair, where one is noted or the width was seen to fall (`glapp.repair`).
    columns : dict
        Role to the column or tag that was taken: where a position was measured, the width may be that of the position
        alone, and `repr` says so.
    left_out : sequence of str
        What is not read of the file: signals that may be in columns of no loop, and on the first of several loops the
        names that are taken for no loop; each with what to write.
    messages : list of dict
        Why fit and crossings say what they do: each a `code` of the catalogue with its `numbers`.
    fit_left_out : bool
        OP was recorded, and nobody asked for the fit.
    """

    name: str
    source: str
    loop: Loop
    t0: datetime | None
    crossings: Crossings
    why: str | None
    reason: str | None
    d_hat: float | None
    unit: str
    d_hat_percent_span: float | None
    repeatability: tuple[float, float] | None
    noise_floor: float | None
    detections: int
    half_periods: HalfPeriods
    reasons: dict[str, int]
    settings: Settings
    answer: Answer
    quality: list[Finding] = field(default_factory=list)
    identification: Identification | None = None
    trace: Trace | None = None
    fit: Fit | None = None
    corrected: Corrected | None = None
    step_test: StepTest | None = None
    messages: list[dict[str, Any]] = field(default_factory=list)
    plan: Plan | None = None
    repair: Repair | None = None
    columns: dict[str, str] = field(default_factory=dict)
    left_out: Sequence[str] = ()
    fit_left_out: bool = False

    @classmethod
    def of_error(cls, error: InputError, name: str, source: str, loop: Loop | None = None) -> Result:
        """The answer for a loop whose settings or recording cannot be used: refused, with the error as its reason.

        Examples
        --------
        >>> result = Result.of_error(InputError("no such file", file="plant.csv"), "plant", "plant.csv")
        >>> result.verdict, result.reason
        ('refused', 'plant.csv: no such file')
        """
        loop = loop or Loop(name=name)
        answer = decide(crossings="refused", d_hat=None, detections=0, reasons={}, fit=None, loop=loop)
        return cls(
            name=name,
            source=source,
            loop=loop,
            t0=None,
            crossings="refused",
            why="unusable",
            reason=str(error),
            d_hat=None,
            unit=loop.op_label,
            d_hat_percent_span=None,
            repeatability=None,
            noise_floor=None,
            detections=0,
            half_periods=HalfPeriods.empty(),
            reasons={},
            settings=Settings(None, None, None, None, None, None, loop.n, None, {}, {}),
            answer=answer,
        )

    def decided_with(self, *, harm: Sequence[Harm] = (), **facts: Any) -> Result:
        """A result with other facts (fields of `Result`), and the one answer that follows from them."""
        changed = replace(self, **facts)
        names = ("crossings", "d_hat", "detections", "reasons", "fit", "loop", "step_test")
        return replace(changed, answer=decide(**{name: getattr(changed, name) for name in names}, harm=harm))

    def __repr__(self) -> str:
        answer = self.answer
        if self.fit is not None and answer.verdict == self.fit.verdict:
            high = "no upper limit" if answer.high is None else f"{answer.high:.4g}"
            limits = "" if answer.low is None else f" ({answer.low:.4g} to {high})"
            width = "" if answer.width is None else f" {answer.width:.4g} {self.unit}"
            text = f"{answer.verdict}{',' if width or limits else ''}{width}{limits}"
            return f"<Result {self.name}: {text}{'' if (by := self.by_position) is None else f', {by}'}>"
        width = "" if self.d_hat is None else f" {self.d_hat:.4g} {self.unit},"
        found = f"{self.detections} detections in {self.total_half_periods} half-periods"
        return f"<Result {self.name}: {answer.verdict},{width} {found}>"

    def _repr_html_(self) -> str:
        """State, next step and reason, for a notebook."""
        texts = self.texts()
        why = [("why" if i == 0 else "", text) for i, text in enumerate(texts["why"])]
        by = [] if self.by_position is None else [("by", self.by_position)]
        head = f"{self.name}: {texts['headline'] or self.verdict}"
        return table(head, [("", texts["so"]), ("do", texts["do"]), *by, *why])

    @property
    def by_position(self) -> str | None:
        """Sentence on a width by a measured position: its column, and what PV alone says; None for any other width."""
        if self.fit is None or self.fit.best.get("signal") != "position":
            return None
        alone = self.fit.through_pv
        by = f"by the measured position in '{self.columns.get('position') or self.columns.get('POSITION')}'"
        if alone is None:
            return by
        if alone.low is None:
            return f"{by}; PV alone: {alone.verdict.replace('_', ' ')}"
        return f"{by}; PV alone: {alone.low:.4g} to {'no upper limit' if alone.high is None else f'{alone.high:.4g}'}"

    @property
    def verdict(self) -> Verdict:
        """The one verdict: the fit's, or where nothing was fitted that of the crossings."""
        return self.answer.verdict

    @property
    def width(self) -> float | None:
        """The most likely width [`unit`]; None where no gap was found, or only a bound is known: see `bound`."""
        return None if self.answer.width_kind == "bound" else self.answer.width

    @property
    def bound(self) -> tuple[float | None, float | None] | None:
        """Bound of the width where no more is known [`unit`]: (at least, None) or (None, at most); else None."""
        if self.answer.width_kind != "bound":
            return None
        if self.answer.width is not None:
            return self.answer.low if self.answer.low else self.answer.width, None
        return None, self.answer.high

    @property
    def span(self) -> float | None:
        """Width of OP's span [`unit`], None where it is not known; a loop in % without a given span has 100."""
        return span_of(self.loop)

    @property
    def total_half_periods(self) -> int:
        """Accepted and rejected half-periods together, those that the table leaves out included."""
        return self.detections + sum(self.reasons.values())

    def to_frame(self) -> pd.DataFrame:
        """The half-periods as a pandas DataFrame, reasons by name.

        Raises
        ------
        InputError
            Where pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise InputError(
                "to_frame() needs pandas", hint="pip install pandas, or use half_periods.to_dict()"
            ) from None
        frame = pd.DataFrame(self.half_periods.to_dict())
        frame["reason"] = np.array(REASONS)[self.half_periods.reason]
        return frame

    def to_dict(self) -> dict[str, Any]:
        """The answer in plain types, as `glapp analyze --json` writes it; None where there is no value."""
        s = self.settings
        controller = None
        if s.k is not None:
            given = self.loop.controller
            controller = {
                "k": s.k,
                "ti": s.ti,
                "td": s.td,
                "setpoint_weight": s.b,
                "kp_process": s.kp,
                "tf": s.tf,
                "n": s.n,
                "as_written": given.as_written() if given is not None else None,
                "notes": s.notes,
                "origins": s.origins,
            }
        return {
            "loop": self.name,
            "file": self.source,
            "answer": self._answered(),
            "crossings": self.crossings,
            "reason_code": self.why,
            "reason": self.reason,
            "d_hat": self.d_hat,
            "unit": self.unit,
            "d_hat_percent_span": self.d_hat_percent_span,
            "repeatability": list(self.repeatability) if self.repeatability else None,
            "noise_floor": self.noise_floor,
            "corrected": None if self.corrected is None else self.corrected.to_dict(),
            "detections": self.detections,
            "half_periods": self.total_half_periods,
            "reasons": self.reasons,
            "quality": [
                {"code": f.code, "severity": f.severity, "text": f.text, "evidence": f.evidence} for f in self.quality
            ],
            "left_out": list(self.left_out),
            "controller": controller,
            "identified": None if self.identification is None else self.identification.to_dict(),
            "fit": None if self.fit is None else self.fit.to_dict(),
            "plan": None if self.plan is None else self.plan.to_dict(),
            "repair": None if self.repair is None else self.repair.to_dict(),
        }

    def _answered(self) -> dict[str, Any]:
        """The one answer in plain types, with its sentences."""
        answer, texts = asdict(self.answer), self.texts()
        answer["next"]["text"] = texts["do"]
        if answer["struck"] is not None:
            answer["struck"]["text"] = texts["crossing"]
        return answer | {"reasons": self.messages} | {part: texts[part] for part in ("so", "do", "why")}

    def facts(self) -> dict[str, Any]:
        """The one answer under the names of its document, with what only its sentences need."""
        f, rejected, positioner = self.fit, self.ranked_reasons(), self.loop.positioner
        contradicts = f is not None and f.through_pv is not None and f.verdict == "cannot_tell"
        return {
            **asdict(self.answer),
            "span": self.span,
            "fit": f
            and {
                "why": f.why,
                "d": f.d,
                "jump": f.jump,
                "position": "contradicts" if contradicts else None,
                "reason": f.reason,
                "recordings": [sum(single.left_out is None for single in f.recordings), len(f.recordings)],
            },
            "fit_left_out": self.fit_left_out,
            **{
                name: next((m["numbers"][name] for m in self.messages if name in m["numbers"]), None)
                for name in ("enough", "apart")
            },
            "crossings": {
                "verdict": self.crossings,
                "reason": self.reason,
                **{
                    name: getattr(self, name) for name in ("d_hat", "d_hat_percent_span", "detections", "repeatability")
                },
                "half_periods": self.total_half_periods,
                "n": self.settings.n,
                "noise_floor": self.noise_floor,
                "corrected": None if self.corrected is None else asdict(self.corrected),
                "rejected": rejected[0] if rejected else None,
                "positioner": None if positioner is None else positioner.dead_band,
            },
        }

    def texts(self) -> dict[str, Any]:
        """The answer in sentences, by the name of each part: `so`, `do`, `why`, `headline`, `of_span` and more."""
        facts = json.dumps(_without_nan(self.facts()))
        found: dict[str, Any] = _glapp.texts_of(facts, name=self.name, pv_unit=self.loop.pv_unit, op_unit=self.unit)
        return found

    def ranked_reasons(self) -> list[tuple[str, int]]:
        """Why half-periods were rejected, and how many for each reason, the most frequent first."""
        return sorted(((name, n) for name, n in self.reasons.items() if n), key=lambda pair: -pair[1])


def _without_nan(of: Any) -> Any:
    """A value with None in the place of the numbers that JSON does not have."""
    if isinstance(of, dict):
        return {name: _without_nan(value) for name, value in of.items()}
    if isinstance(of, list | tuple):
        return [_without_nan(value) for value in of]
    return None if isinstance(of, float) and not math.isfinite(of) else of
