"""The JSON document of `glapp analyze --json`: its models, and the JSON Schema made from them.

`docs/analyze.schema.json` is the output of `python -m glapp.document`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from ._glapp import ANSWER_VERSION
from .escape import in_quotes
from .result import Result

__all__ = ["to_json", "to_schema"]


class Columns(NamedTuple):
    """Endings for the name of a list of numbers where each number has a column of its own."""

    ends: tuple[str, ...]


Count = Annotated[int, Field(ge=0)]
Range = Annotated[list[float], Field(min_length=2, max_length=2), Columns(("_low", "_high"))]
Value = float | None  # NaN and infinity, which JSON does not have, are written as null


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", use_attribute_docstrings=True)


class Finding(_Part):
    """One fault or peculiarity of a recording."""

    code: str
    """Stable name, as in docs/quality.md."""
    severity: Literal["info", "warning", "refuse"]
    """refuse: no estimate from this recording can be right."""
    text: str
    """One sentence with the numbers, their units and what to do."""
    evidence: dict[str, int | float | str | None]
    """The numbers of the text and more: shares are 0..1, times in s, rows counted from 0."""


class Controller(_Part):
    """Settings that the detector used, in ideal form, seconds and the units of the signals."""

    k: Value
    """Gain K [OP unit/PV unit], negative for a direct-acting controller."""
    ti: Value
    """Integral time Ti [s]."""
    td: Value
    """Derivative time Td [s]."""
    setpoint_weight: Value
    """Setpoint weight b."""
    kp_process: Value
    """Static process gain Kp [PV unit/OP unit]; null: its term is dropped."""
    tf: Value
    """Time constant of the detector's filter [s]."""
    n: int
    """Detections behind one estimate."""
    as_written: str | None
    """The controller in its maker's words; null where it was identified."""
    notes: dict[str, str]
    """Source of each value, in words."""
    origins: dict[str, Literal["given", "identified", "fitted", "assumed", "chosen", "unknown"]]
    """Sources of the values: given, identified from OP's moves, fitted with the gap, the usual value, one of several,
    left out.
    """


Limits = Annotated[list[Value], Field(min_length=3, max_length=3), Columns(("", "_low", "_high"))]
"""A value with its lower and upper 95 % limit."""


class Process(_Part):
    """The process between valve and PV as the best model has it."""

    kp: Limits
    """Static gain [PV unit/OP unit], or velocity gain [PV unit/(OP unit·s)], with its 95 % limits."""
    dead_time: Limits
    """Dead time [s] with its 95 % limits."""
    lag: Limits
    """Lags together [s] with their 95 % limits."""
    integrating: bool
    """Whether the process integrates."""


class Window(_Part):
    """A window of the recording that was fitted."""

    t_start: float
    """Time of the first sample [s since the recording's first row, or the numbers of a time column in plain seconds].
    """
    t_end: float
    """Time of the last sample [s]."""
    verdict: str
    """Verdict of this window alone."""
    d: Value
    """Width [`unit`]."""
    low: Value
    """Lower 95 % limit [`unit`]."""
    high: Value
    """Upper 95 % limit [`unit`]; null where there is none."""


class FitRecording(_Part):
    """One of several recordings of a valve."""

    file: str
    """Name of the file, as the user wrote it."""
    t0: str | None
    """Time of its first row; null where its times are plain seconds."""
    repeated: Value
    """Share of its rows that repeat an earlier recording, and count there."""
    left_out: str | None
    """Why it does not count in the joint answer; null where it does."""
    adds: Value
    """Likelihood ratio of no gap that it adds to the joint one."""
    verdict: str
    """Verdict of this recording alone."""
    d: Value
    """Width [`unit`]."""
    low: Value
    """Lower 95 % limit [`unit`]."""
    high: Value
    """Upper 95 % limit [`unit`]; null where there is none."""
    reason: str
    """Sentence of this recording's verdict."""


class FitAnswer(_Part):
    """Width of the gap with an interval, from OP and PV."""

    d: Value
    """Most likely total width [`unit`]."""
    low: Value
    """Lower limit of the 95 % interval [`unit`]."""
    high: Value
    """Upper limit [`unit`]; null where the recording gives none."""
    unit: str
    """Unit of OP."""
    at_least: Value
    """The lower limit of a bound [`unit`]."""
    verdict: Literal["backlash", "stiction", "both", "oscillation", "sound", "at_least", "cannot_tell"]
    """Kind of dead band, if there is one."""
    jump: Value
    """Slip jump J [`unit`]; 0 for backlash alone."""
    lr_no_gap: Value
    """Likelihood ratio -2·Δln L of no gap against the best width."""
    lr_needed: Value
    """Likelihood ratio that a gap needs."""
    process: Process | None
    """null where nothing could be fitted."""
    signal: Literal["PV", "position"]
    """Signal that was fitted to OP: PV, or the measured valve position where it settled the answer."""
    trend: Annotated[list[float], Field(min_length=2, max_length=2), Columns(("", "_error"))] | None
    """Change of the width and its standard error [`unit`/day], from three windows or more."""
    windows: list[Window]
    """The windows that were fitted."""
    recordings: list[FitRecording]
    """Recordings of a loop that has several, in the order of time; else empty."""
    reason_code: str
    """Code of the reason, the same from version to version."""
    reason: str
    """Reason in a sentence with the evidence."""


class Identified(_Part):
    """The controller's law as OP's moves show it."""

    usable: bool
    """Whether K and Ti are known well enough to be used."""
    k: Limits
    """Gain K [OP unit/PV unit] with its 95 % limits."""
    ti: Limits
    """Integral time Ti [s] with its 95 % limits; no upper one where there may be no integral action."""
    td: Limits
    """Derivative time Td [s] with its 95 % limits; 0 where a law without it explains OP as well."""
    setpoint_weight: Value
    """Setpoint weight b; null where SP moved too little."""
    r2: Value
    """Share of the variance of OP's moves that the law explains."""
    samples: Count
    """Steps between samples that could be used."""
    reason: str | None
    """Why it is not usable; null where it is."""


class Corrected(_Part):
    """The width from zero crossings with the known bias of (2.4) taken out."""

    d: Value
    """Total width [`unit`]; null: `reason` says why."""
    low: Value
    """Lower end of its range [`unit`]: repeatability, not an interval of confidence."""
    high: Value
    """Upper end."""
    kp: Value
    """Size of the process gain that it is computed with [PV unit/OP unit]."""
    kp_range: Range | None
    """Range of that gain with any one pair left out; null where it was known."""
    pairs: Count
    """Pairs of half-periods that it is made of."""
    travel: Literal["op", "(4.1)"]
    """OP as recorded, or as equation (4.1) makes it of SP and PV."""
    reason: str | None
    """Why there is no width."""


class Next(_Part):
    """Next step."""

    code: str
    """correct, inspect, further, record_more, tuning, nothing, review, confirm, compare, record_longer,
    probably_too_wide, step_test, remedy."""
    of: str | None
    """Subject of the step: a part of the valve, a reason of rejection; null where it has none."""
    tested: bool
    """Whether the recording holds a step test, which is used; no further one is asked for."""
    text: str
    """The message in a sentence or two."""


class Struck(_Part):
    """Why the crossings' width contradicts the fit."""

    code: Literal["above", "below", "sound"]
    """Wider or narrower than the fit allows, or a width of a valve that shows no gap."""
    limit: float
    """The fit's limit [`unit`]."""
    text: str
    """The message in a sentence."""


class Limit(_Part):
    """Widest dead band that is acceptable."""

    percent_span: float
    """Limit in % of OP span."""
    width: Value
    """Limit as a width [`unit`]; null where the span is not known."""
    origin: Literal["given", "nominal"]
    """given: in the settings of the loop; nominal: not given, and 1 % of span is taken (EnTech's nominal dead band)."""


class Trend(_Part):
    """Trend of the width."""

    code: Literal["grows", "shrinks", "steady", "too_few"]
    """Whether a change is plain."""
    widths: Count
    """Widths that it rests on."""
    widths_needed: Count
    """Widths that a change must rest on."""
    per_day: Value
    """Change of the width [`unit`/day]."""
    low: Value
    """Lower 95 % limit [`unit`/day]."""
    high: Value
    """Upper 95 % limit [`unit`/day]."""
    least_plain: Value
    """A change so fast would be plain [`unit`/day]."""
    t: Range | None
    """First and last of the widths [s]."""
    d: Range | None
    """The line's widths there [`unit`]."""
    days_to_limit: Value
    """Days from the last width until it reaches the acceptable limit; null where it does not clearly grow."""


class StepTestWidth(_Part):
    """Width by a step test in the recording."""

    d: float
    """Total width [`unit`]; the lower limit where the test has decided by that alone."""
    low: Value
    """Lower 95 % limit [`unit`]."""
    high: Value
    """Upper 95 % limit [`unit`]; null where the test has decided by the lower one alone."""
    decided: Literal["gap", "no_gap"] | None
    """Decision of the test that was made for a question; null for any other test."""


class Terms(_Part):
    """Contribution of each kind of evidence to the log-odds of a dead band, compared with a usual record."""

    likelihood: float
    """The gap's part of what OP explains of PV."""
    traversals: float
    """Number of traversals of the width by OP."""
    width: float
    """The width against OP's range."""
    limit: float
    """Nearness of the upper limit to the width."""
    noise: float
    """Effect of the gap on PV compared with PV's noise."""
    plateau: float
    """Whether PV stands still while OP goes through the gap."""
    process: float
    """Part of the valve's effect that a load undoes."""
    rules: float
    """Judgement by the rules of the ladder."""


class Harm(_Part):
    """Harm of the gap to the loop: shares from 0 to 1."""

    pv_share: Value
    """Share of PV's variance about SP that would not be there without the gap."""
    op_share: Value
    """Share of OP's travel that would not be there without it."""
    worst: Value
    """The larger of both."""


class Message(_Part):
    """A reason as a code with its numbers, from which its sentence is made."""

    code: str
    """Subject and name, as in the catalogue of messages."""
    numbers: dict[str, Any]
    """Numbers and words by name; a message within a message has `code` and `numbers` too."""


class Answer(_Part):
    """The one answer of a loop, from all that is known of its valve."""

    verdict: Literal[
        "backlash",
        "stiction",
        "both",
        "oscillation",
        "sound",
        "at_least",
        "cannot_tell",
        "estimate",
        "provisional",
        "no_estimate",
        "refused",
    ]
    """The fit's; the last four are those of the crossings, where nothing was fitted."""
    valve: Literal["gap", "no_gap", "unknown", "refused"]
    """State of the valve; refused: data or settings allow no answer."""
    confidence: Literal["found", "likely", "cannot_tell", "likely_sound", "none_seen", "sound", "refused", "not_judged"]
    """Confidence that there is a dead band; likely_sound: one wider than the limit is improbable; none_seen: none above
    `high`; sound: none wider than the limit; not_judged: OP and PV were not fitted, and zero crossings alone do not
    judge a valve.
    """
    cause: Literal["backlash", "stiction", "both", "dead_band"] | None
    """Cause; dead_band: play or packing, the data do not show which; null where none is found or likely."""
    width_kind: Literal["interval", "bound", "unsure"] | None
    """Kind of the width; unsure: a dead band is there, and its width is not known well; null where nothing is known."""
    oscillates: bool
    """Whether the loop swings in a clean sinusoid, which no dead band makes."""
    width: Value
    """The width that lists rank by [`unit`]: the most likely one, or the bound if that is all; null: no gap found."""
    width_percent_span: Value
    """Width in % of OP span; null where the span is not known."""
    low: Value
    """Narrowest gap that the data does not exclude [`unit`]; null where nothing is excluded."""
    low_percent_span: Value
    """Lower limit in % of OP span."""
    high: Value
    """Widest one [`unit`]; null where there is no limit."""
    high_percent_span: Value
    """Upper limit in % of OP span."""
    evidence: Literal["none", "weak", "strong", "very_strong"] | None
    """Strength of the recording's evidence for a gap; null without a fit."""
    p_gap: Value
    """Probability of a dead band, 0.02 to 0.98; null where no evidence was weighed."""
    p_beyond: Value
    """Probability of one beyond the limit."""
    terms: Terms | None
    """Contribution of each kind of evidence to the log-odds of a dead band; above 0 is evidence for one."""
    log_bayes_factor: Value
    """ln of how many times likelier the evidence is with a dead band than without."""
    prior: Value
    """Share of valves with a dead band that `p_gap` starts from."""
    limit: Limit | None
    """Acceptable limit; null where it is not given and the span is not known."""
    acceptable: Literal["within", "beyond", "open"] | None
    """The width compared with the acceptable limit; open: the interval holds the limit. Null where either is not known.
    """
    next: Next
    """Next step."""
    urgency: Literal["none", "low", "medium", "high"]
    """Urgency; at most medium by a limit that was not given."""
    health: Literal["NORMAL", "MAINTENANCE_REQUIRED"]
    """Health of the valve by NAMUR NE 107."""
    trend: Trend | None
    """Trend of the width; null where there are too few widths."""
    step_test: StepTestWidth | None
    """Width by a step test in the recording; null where it gives none."""
    harm: Harm | None
    """Harm of the gap to the loop; null where it was not computed."""
    compensable: Value
    """Width that a compensation may trust [`unit`]; 0 of a valve that shows no gap; null: a person may type one."""
    score: Value
    """Rank within one urgency: the lower limit over the acceptable one, times the harm."""
    rank: tuple[int, int, int, float]
    """Place of the loop in every list: smaller comes first, number by number."""
    struck: Struck | None
    """Reason why the crossings' width is contradicted; null where it is not, or there is none."""
    reasons: list[Message]
    """Reasons of the fit's and the crossings' verdicts."""
    so: str
    """State of the valve, in one sentence."""
    do: str
    """Next step, in a sentence or two."""
    why: list[str]
    """Why, a sentence each."""


class PlannedTest(_Part):
    """A test that would decide whether there is a gap, or the reason why this kind of test cannot."""

    kind: Literal["by_hand", "setpoint", "more_hours"]
    """OP moved in manual; the setpoint stepped in automatic; a longer recording of the loop as it runs."""
    reason: str | None
    """Why no such test can be proposed; null where one can."""
    moves: list[float]
    """OP [`unit`] or SP, one after the other, the first where the loop was; empty for more hours."""
    hold: Value
    """Time at each of them [s]."""
    minutes: Value
    """Time from the first move on [min]."""
    op: Range | None
    """Least and greatest OP in any simulation [`unit`]."""
    pv: Range | None
    """Least and greatest PV in any simulation."""
    power: Value
    """Probability that it decides: the smaller of the next two."""
    with_gap: Value
    """Share of the simulations with the gap that show it."""
    without: Value
    """Share of the simulations without the gap that show that there is none."""
    false: Value
    """Share of all simulations that end in the wrong answer."""
    simulations: Count
    """Simulations of either kind."""


class Plan(_Part):
    """Test that would decide whether there is a gap."""

    name: str
    """Loop."""
    source: str
    """Recording that it was planned from."""
    unit: str
    """Unit of OP."""
    pv_unit: str
    """Unit of PV."""
    width: Value
    """Width in question [`unit`]."""
    op_within: Annotated[list[Value], Field(min_length=2, max_length=2), Columns(("_low", "_high"))]
    """Limits of OP that no test passes [`unit`]."""
    pv_within: Annotated[list[Value], Field(min_length=2, max_length=2), Columns(("_low", "_high"))]
    """Limits of PV."""
    within: float
    """Time that a test may take [min]."""
    tests: list[PlannedTest]
    """One of each kind."""
    reason: str | None
    """Why nothing could be planned; null where something could."""


class RepairSide(_Part):
    """The valve and its loop before a repair, or after it."""

    begin: str | None
    """First row that was looked at; such as "600 s" where the recording has no date, null where there are no rows."""
    end: str | None
    """Last row."""
    verdict: str | None
    """Verdict on the valve by this side; null where there is no answer."""
    confidence: str | None
    """Confidence of the verdict; null where the width is the mean of several."""
    d: Value
    """Width [`unit`]."""
    low: Value
    """Lower 95 % limit [`unit`]."""
    high: Value
    """Upper 95 % limit [`unit`]."""
    days: Value
    """Time in automatic that was looked at [d]; null, as all that follows, where too little was."""
    deviation: Limits | None
    """Standard deviation of PV about SP [PV unit]."""
    travel: Limits | None
    """Travel of OP in a day [`unit`]; null without OP."""
    reversals: Limits | None
    """Reversals of OP in a day."""


class Difference(_Part):
    """Difference of after and before."""

    code: Literal["less", "more", "open"]
    """Whether all of the 95 % interval lies below 0, above 0, or neither."""
    by: Limits
    """After − before with its 95 % limits."""


class Repair(_Part):
    """The valve before and after its repair."""

    noted: str | None
    """Time of the repair in the settings; null where only a fall of the width shows it."""
    before: RepairSide
    """Up to 7 days before."""
    after: RepairSide
    """Up to 7 days after."""
    width: Difference | None
    """Change of the width [`unit`]; null, as all that follow, where it is not known on both sides."""
    deviation: Difference | None
    """Change of PV's deviation from SP [PV unit]."""
    travel: Difference | None
    """Change of OP's travel in a day [`unit`]."""
    reversals: Difference | None
    """Change of OP's reversals in a day."""


class LoopAnswer(_Part):
    """The answer for one loop: `answer` is the one answer, all else is its evidence."""

    loop: str
    """Name of the loop."""
    file: str
    """Recording, as the user wrote it."""
    answer: Answer
    """The one answer."""
    crossings: Literal["estimate", "provisional", "no_estimate", "refused"]
    """Verdict of the zero crossings; provisional: from fewer than N detections."""
    reason_code: str | None
    """Why not more, in a word that stays the same from version to version; null only with an estimate."""
    reason: str | None
    """Why not more, in a sentence."""
    d_hat: Value
    """Total width by zero crossings, as a PLC would show it [`unit`]; `answer.struck` says where it is contradicted."""
    unit: str
    """Unit of OP."""
    d_hat_percent_span: Value
    """Width by the crossings in % of OP span; null where the span is not known."""
    repeatability: Range | None
    """Smallest and largest detection behind `d_hat` [`unit`]; not an interval of confidence."""
    noise_floor: Value
    """Width below which noise alone could produce an estimate [`unit`]."""
    corrected: Corrected | None
    """The width with its known bias taken out; null without detections."""
    detections: Count
    """Accepted half-periods."""
    half_periods: Count
    """Accepted and rejected half-periods."""
    reasons: dict[str, Count]
    """First reason of rejection to the number of half-periods."""
    quality: list[Finding]
    """Findings on the recording, gravest first."""
    left_out: list[str]
    """What is not read of the file, and may belong to this loop or be another one: a sentence each, with what to write.
    """
    controller: Controller | None
    """null where nothing is known of it."""
    identified: Identified | None
    """Settings identified from OP's moves, with a given controller too; null without OP."""
    fit: FitAnswer | None
    """Width with an interval from OP and PV; null without OP."""
    plan: Plan | None
    """Plan of a test that would decide, where `--plan` asked for it and the answer is open; else null."""
    repair: Repair | None
    """Before and after the repair, where one is noted or the width fell from one day to the next; else null."""


class Document(_Part):
    """Answer of `glapp analyze --json`."""

    schema_version: Literal[3]
    """Layout of this document."""
    glapp: str
    """Version that wrote it."""
    loops: list[LoopAnswer]
    """One per loop, in the order in which they were given."""


def to_json(results: Sequence[Result]) -> str:
    """The document for a run: strict JSON, without NaN or infinity.

    Examples
    --------
    >>> print(to_json([]))  # doctest: +ELLIPSIS
    {
      "schema_version": 3,
      "glapp": "...",
      "loops": []
    }
    """
    document = {
        "schema_version": ANSWER_VERSION,
        "glapp": version("glapp"),
        "loops": [result.to_dict() for result in results],
    }
    return in_quotes(Document.model_validate(document).model_dump_json(indent=2))


def to_schema() -> str:
    """JSON Schema of the document."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **Document.model_json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False)


if __name__ == "__main__":
    print(to_schema())
