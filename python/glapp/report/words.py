"""Results in plain words, for the person who plans the maintenance.

One rule for all of them: say what was measured, on how much, and what it cannot tell. Numbers carry their unit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from ..result import Answer, Result
    from ..step_test import StepTest


class Reason(NamedTuple):
    """How one verdict on a half-period is told: a label, what it means, and what to do if it is the usual one."""

    label: str
    meaning: str
    remedy: str


#: In the order of `glapp.result.REASONS`: the position in this table is the code in `HalfPeriods.reason`.
REASONS: dict[str, Reason] = {
    "accepted": Reason("accepted", "passed every test and gave one detection of the dead band", ""),
    "gap": Reason(
        "start or gap",
        "its beginning was not recorded: it is the first one, or samples are missing before or in it",
        "Record without interruptions, with compression and exception reporting switched off.",
    ),
    "bad_quality": Reason(
        "bad quality",
        "a sample is missing or marked bad",
        "Look at the transmitter and at how bad values are archived.",
    ),
    "not_auto": Reason(
        "not in auto",
        "the controller was not in automatic for all of it",
        "Record the loop while it runs in automatic. If this is a step test, glapp step-test reads it.",
    ),
    "saturated": Reason(
        "OP at a limit",
        "the output stood at a limit, so the integral does not tell how far the valve moved",
        "Record at a load where the valve is away from its limits.",
    ),
    "too_short": Reason(
        "too short",
        "Δt is not longer than 5·TI: PV crosses SP too often for a dead band to be measured",
        "Nothing to measure here. If it oscillates, look at tuning and load. Only a step test tells of the valve.",
    ),
    "not_square": Reason(
        "not square",
        "e_max is not below 2·Δy (5.2): the error is peaked or noisy, where a dead band gives a near-square shape",
        "A smooth wave points to tuning or to a load that oscillates rather than to the valve.",
    ),
    "uneven": Reason(
        "uneven",
        "Δy differs too much from that of the half-period before it (5.4)",
        "The load changes, or the two sides of the cycle differ. Record for longer, and while the load is calm.",
    ),
    "sp_moved": Reason(
        "SP moved",
        "the setpoint moved by more than Δy (5.5)",
        "Record at a fixed setpoint. For a cascade slave, put the master in manual while recording.",
    ),
    "too_small": Reason(
        "too small",
        "Δt is below the bound (5.1): the deviation is small beside what the estimate so far would give",
        "Mostly noise around the setpoint. A longer recording may hold clearer half-periods.",
    ),
}

NAMES = tuple(REASONS)

#: The one verdict of a loop. The last four are those of the zero crossings, where nothing was fitted.
VERDICTS: dict[str, str] = {
    "backlash": "Backlash",
    "stiction": "Stiction",
    "both": "Backlash and stiction",
    "at_least": "At least",
    "oscillation": "Oscillation",
    "sound": "Sound",
    "cannot_tell": "Cannot tell",
    "estimate": "Estimate",
    "provisional": "Provisional",
    "no_estimate": "No estimate",
    "refused": "Refused",
}

#: What is known of a valve.
VALVES: dict[str, str] = {
    "gap": "Gap found",
    "no_gap": "No gap shown",
    "unknown": "Cannot tell",
    "refused": "Refused",
}

#: How soon something is to be done.
URGENCIES: dict[str, str] = {
    "high": "First",
    "medium": "Next round",
    "low": "Later",
    "none": "Not now",
}

#: How strongly a recording speaks for a gap.
EVIDENCE: dict[str, str] = {"none": "none", "weak": "weak", "strong": "strong", "very_strong": "very strong"}


#: What a gap that is not all leaves to be said.
MORE = "Where the valve turns, PV strays from what a gap alone makes of it: the valve may stick as well."


class Step(NamedTuple):
    """A next step: in a sentence, in a word or two, and what is left of it where the recording holds a step test."""

    text: str
    short: str
    tested: str | None = None


_STEP_TEST = ""  # the step test that is asked for is there: nothing is left

#: What to do next by its code; what it is about may have another sentence.
NEXT: dict[str, Step] = {
    "correct": Step("Correct what is named, then analyse again.", "correct", "To learn more, correct what is named."),
    "inspect play": Step(
        "Look for play in linkage, keys and actuator; confirm with a step test before work is ordered.",
        "inspect",
        "Look for play in linkage, keys and actuator.",
    ),
    "inspect packing": Step(
        "Look at the packing, the seat and the air supply; confirm with a step test.",
        "inspect",
        "Look at the packing, the seat and the air supply.",
    ),
    "inspect both": Step(
        "Look for play in the linkage and at the packing; confirm with a step test.",
        "inspect",
        "Look for play in the linkage and at the packing.",
    ),
    "further": Step(
        "Record while OP moves further, or make a step test, to learn how much it is.", "record", _STEP_TEST
    ),
    "record_more": Step(
        "Record for longer, while OP moves further, or make a step test in manual.", "record", _STEP_TEST
    ),
    "tuning": Step("Look at the tuning, or for a disturbance from elsewhere.", "tuning"),
    "nothing": Step("Nothing now.", "nothing"),
    "review": Step("Nothing now. Analyse again at the next review.", "nothing"),
    "confirm": Step(
        "Confirm with a step test in manual, then plan work on valve, linkage and positioner.",
        "step test",
        "Where it agrees, plan work on valve, linkage and positioner.",
    ),
    "compare": Step(
        "Compare with what this valve may have. Confirm with a step test before work is ordered.",
        "compare",
        "Compare with what this valve may have.",
    ),
    "record_longer": Step("Record for longer, then analyse again.", "record"),
    "probably_too_wide": Step(
        "Probably too wide. Record for longer, or confirm with a step test in manual.",
        "record",
        _STEP_TEST,
    ),
    "step_test": Step("Nothing on this evidence. A step test in manual tells of the valve.", "step test", _STEP_TEST),
}

#: What each verdict means.
MEANINGS: dict[str, str] = {
    "backlash": "OP and PV show a gap, and how wide it is. The valve does not follow OP until OP has crossed it.",
    "stiction": "the valve sticks and then jumps. There is no gap beside it.",
    "both": "there is a gap, and the valve jumps when it breaks loose.",
    "at_least": "there is a gap, and only how wide it is at least: OP did not move far enough, or PV is too noisy.",
    "sound": "no gap wider than the limit that is given. A narrower one may be there.",
    "oscillation": "the loop swings in a clean sinusoid, and its valve is not why. A gap beside it does not show.",
    "cannot_tell": "OP and PV fit with a gap and without one, or do not fit at all. It does not mean that all is well.",
    "estimate": "nothing was fitted. At least N detections of the zero crossings stand behind the width.",
    "provisional": "nothing was fitted. Fewer than N detections stand behind the width, and it may still move.",
    "no_estimate": "nothing was fitted, and no half-period was fit to measure on.",
    "refused": "data or settings do not allow an analysis. The reason is named.",
}

#: The one answer in a sentence, where the fit gives it.
LEADS: dict[str, str] = {
    "backlash": "The valve of {name} has a gap of {width}{span}, {interval}.",
    "stiction": "The valve of {name} sticks, then jumps by {jump}.",
    "both": "The valve of {name} loses {width}{span} at each reversal, {interval}, and jumps by {jump} when it breaks "
    "loose.",
    "at_least": "The valve of {name} loses at least {low} at each reversal.",
    "sound": "The valve of {name} shows no gap wider than {high}.",
    "oscillation": "{name} swings in a clean sinusoid: not for its valve. A gap beside it does not show.",
    "cannot_tell": "OP and PV of {name} do not tell whether there is a gap.",
}

#: What each method is and is not.
METHODS: dict[str, tuple[str, ...]] = {
    "The gap from OP and PV": (
        "A model of the loop, from OP through a valve with a gap and through the process to PV, is fitted to the "
        "recording for every width of the gap. The width that explains PV best is the answer, and the limits hold all "
        "that explain it nearly as well.",
        "It needs OP, and an OP that turns round and crosses the gap. It asks neither for settings of the controller "
        "nor for a loop that oscillates.",
        "A load that swings as evenly as a gap would make it, or PV that was filtered or compressed on its way to the "
        "recording, is what it is most easily misled by.",
    ),
    "Zero crossings: what a PLC would show": (
        "The width is worked out from how long and how far PV stays on one side of SP while the controller integrates. "
        "It needs no OP, and it runs in a PLC. It is the answer where nothing could be fitted, else a footnote; it is "
        "struck where the fit contradicts it.",
        "Load changes while the loop waits make it read too high. Half-periods that do not cross the whole gap make it "
        "read too low. The scatter of the detections shows how well they repeat, and neither of these errors.",
        "A sound valve in noise or under a changing load also gives a number, in simulations up to about 2 % of span. "
        "A width that is small beside what is acceptable is no evidence of a gap.",
        "Silence proves nothing: a loop that rests at its setpoint gives no half-periods, whatever its valve is like.",
    ),
}

#: What a 95 % limit is.
SURE_OF_LIMITS = "On 1104 simulated recordings of known truth 93 to 96 of 100 such intervals held the true width."

#: How sure the answers are, counted on the benches of docs/truth.md.
SURE: tuple[str, ...] = (
    "A width stands between two limits, as in 2.40 (2.15 to 3.11): a 95 % interval. " + SURE_OF_LIMITS + " On 4800 "
    "more, with loads and recorders that look like a gap, 911 of 925 did.",
    "Where there was no gap, the fit saw one in 4 of 1000 of the first and in 14 of 2400 of the second. Zero crossings "
    "alone would have sent somebody to the valve in 304 of 1000 of the first; their width read 39 to 74 % too wide in "
    "the middle of the records.",
    "It is silent rather than wrong: of the gaps on the first bench that a recording could show at all, 31 in "
    "100 got a width. Several recordings of one valve tell more.",
    "Evidence is strong where a model without a gap is as much worse as the fit asks for, very strong where it is more "
    "than twice that, weak where it is half of it or more.",
    "Before work is ordered, confirm with a step test in manual: small steps up, then small steps down, and note how "
    "far OP travels before PV moves. Stiction and backlash look alike in most recordings.",
)


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with so many significant digits, without an exponent where a person would use none.

    >>> number(0.50349), number(1234.6), number(34), number(None), number(-0.00001234)
    ('0.503', '1235', '34', '–', '−1.23e-05')
    """
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if not -4 <= exponent < 6:
        text = f"{value:.{digits - 1}e}"
    else:
        text = f"{value:.{max(digits - 1 - exponent, 0)}f}"
        if float(value).is_integer():
            text = f"{value:.0f}"
    return text.replace("-", "−", 1) if text.startswith("-") else text


def quantity(value: float | None, unit: str, digits: int = 3) -> str:
    r"""Write a number with its unit, with a no-break space between; a dash alone where there is no number.

    >>> quantity(1.834, "%"), quantity(None, "%")
    ('1.83\xa0%', '–')
    """
    text = number(value, digits)
    return text if text == "–" or not unit else f"{text}\N{NO-BREAK SPACE}{unit}"


def duration(seconds: float) -> str:
    r"""Write a time span in the two largest units that fit.

    >>> duration(48), duration(7500), duration(200000)
    ('48\xa0s', '2 h 5 min', '2 d 8 h')
    """
    if seconds < 120:
        return quantity(seconds, "s")
    minutes = round(seconds / 60)
    if minutes < 60:
        return f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    if hours < 48:
        return f"{hours} h {minutes} min" if minutes else f"{hours} h"
    days, hours = divmod(hours + round(minutes / 60), 24)
    return f"{days} d {hours} h" if hours else f"{days} d"


def clock(t0: datetime | None, seconds: float) -> str:
    """Write a moment of the recording: local date and time where the first row has one, else seconds.

    >>> clock(datetime(2026, 3, 1, 12, 0), 90), clock(None, 90.0)
    ('2026-03-01 12:01:30', '90 s')
    """
    if t0 is None:
        return f"{seconds:.6g} s"
    # Elapsed time is added in UTC: the zone's clocks may have changed in between.
    zone = t0.tzinfo or UTC
    moment = (t0.replace(tzinfo=zone).astimezone(UTC) + timedelta(seconds=float(seconds))).astimezone(zone)
    return moment.replace(tzinfo=None).isoformat(" ", "milliseconds" if moment.microsecond else "seconds")


def count(n: int, noun: str) -> str:
    """Write a count with its noun.

    >>> count(1, "detection"), count(1204, "half-period")
    ('1 detection', '1204 half-periods')
    """
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def op_unit(result: Result | StepTest) -> str:
    """Write the unit of OP as a sentence needs it: `%` alone would leave open of what."""
    return "%OP" if result.unit == "%" else result.unit


def ranked(results: Sequence[Result]) -> list[Result]:
    """Order results as every list shows them, by `Answer.rank`."""
    return sorted(results, key=lambda result: result.answer.rank)


def judged(result: Result) -> bool:
    """Tell whether something is known of the valve; of the others a list says why not, and what would help."""
    return result.answer.valve in ("gap", "no_gap")


def summary(results: Sequence[Result]) -> str:
    """Tell a run in two or three sentences: how many valves have a gap, and how many are to be looked at how soon."""
    if len(results) == 1:
        return lead(results[0])
    answers = [r.answer for r in results]
    found = [a for a in answers if a.valve == "gap"]
    measured = sum(a.evidence is not None for a in found)
    beyond = sum(a.acceptable == "beyond" for a in found if a.evidence is not None)
    text = f"{measured or 'None'} of {count(len(results), 'valve')} {'have' if measured > 1 else 'has'} a measured gap"
    if beyond:
        of_them = "" if measured == 1 else "all of them " if beyond == measured else f"{beyond} of them "
        text += f", {of_them}wider than is acceptable"
    others = [
        (len(found) - measured, "read a width by zero crossings alone", "reads a width by zero crossings alone"),
        (sum(a.verdict == "sound" for a in answers), "show none", "shows none"),
        (sum(a.verdict == "oscillation" for a in answers), "swing for another reason", "swings for another reason"),
        (sum(a.valve == "unknown" for a in answers), "cannot be judged", "cannot be judged"),
        (sum(a.valve == "refused" for a in answers), "were refused", "was refused"),
    ]
    told = [f"{n} {one if n == 1 else many}" for n, many, one in others if n]
    text += f". {', '.join(told)}." if told else "."
    soon = (("high", "first"), ("medium", "at the next round"))
    acting = [f"{n} {when}" for level, when in soon if (n := sum(a.urgency == level for a in answers))]
    return f"{text} To be looked at: {', '.join(acting)}." if acting else f"{text} Nothing is urgent."


def ranked_reasons(result: Result) -> list[tuple[str, int]]:
    """List the reasons of rejection with their counts, the most frequent first."""
    return sorted(((name, n) for name, n in result.reasons.items() if n), key=lambda pair: -pair[1])


def headline(result: Result) -> str:
    """Write the one width that a list shows, with its interval if it has one; empty where nothing is known of it."""
    answer = result.answer
    if answer.low is None and answer.high is None:
        return "" if answer.width is None else width(result)
    return _between(answer, 1.0, op_unit(result))


def of_span(result: Result) -> str:
    """Write the same in % of OP's span; empty where the span is not known, or the headline says so already."""
    answer, span = result.answer, result.span
    if span is None or (result.unit == "%" and span == 100.0) or (answer.low is None and answer.high is None):
        return ""
    return _between(answer, 100.0 / span, "% of span")


def _between(answer: Answer, scale: float, unit: str) -> str:
    """Write a width with its limits, or the one limit that is known."""
    low, high, width = (None if x is None else scale * x for x in (answer.low, answer.high, answer.width))
    if answer.verdict == "at_least":
        return f"> {quantity(low, unit)}"
    if answer.verdict == "sound":
        return f"< {quantity(high, unit)}"
    if width is None:
        return f"{number(low)} to {quantity(high, unit)}"
    return f"{quantity(width, unit)} ({number(low)} to {number(high)})"


def crossing(result: Result) -> str:
    """Write the width that a PLC would show, marked where it is struck."""
    text = quantity(result.d_hat, op_unit(result))
    return text if result.answer.struck is None else f"{text}, struck"


def struck(result: Result) -> str:
    """Say why the crossings' width does not stand beside the fit; empty where it does."""
    why, unit = result.answer.struck, op_unit(result)
    if why is None:
        return ""
    d_hat, limit = quantity(result.d_hat, unit), quantity(why.limit, unit)
    because = {
        "above": f"OP and PV exclude more than {limit}. A load that moves looks like a wider gap to the crossings",
        "below": f"OP and PV exclude less than {limit}. Half-periods that do not cross the whole gap read low",
        "sound": f"OP and PV show no gap wider than {limit}. Noise and a moving load look like one to the crossings",
    }[why.code]
    return f"The {d_hat} of the zero crossings is struck: {because}."


def lead(result: Result) -> str:
    """Tell the one answer in a sentence for the person who plans the maintenance."""
    answer, unit, name = result.answer, op_unit(result), result.name
    span = ""
    if answer.width_percent_span is not None and unit != "%OP":
        span = f", {quantity(answer.width_percent_span, '% of span')}"
    interval = f"between {number(answer.low)} and {quantity(answer.high, unit)} with 95 % confidence"
    if answer.verdict not in LEADS:
        return verdict(result)[0]
    text = LEADS[answer.verdict].format(
        name=name,
        width=quantity(answer.width, unit),
        span=span,
        interval=interval,
        jump=quantity(None if result.fit is None else result.fit.jump, unit),
        low=quantity(answer.low, unit),
        high=quantity(answer.high, unit),
    )
    f = result.fit
    if f is not None and f.trend is not None and f.trend.changes:
        now = "has grown to this" if f.trend.slope > 0 else "has shrunk to this"
        text = f"{text} It {now} in {duration(f.trend.t[1] - f.trend.t[0])}."
    return text


def why(result: Result) -> str:
    """Tell what the one answer stands on, without the numbers of the likelihood."""
    each = [] if result.fit is None else result.fit.recordings
    if not each:
        return _why(result)
    counted = sum(one.left_out is None for one in each)
    return f"{_why(result)} {counted} of {len(each)} recordings count."


def _why(result: Result) -> str:
    answer, f = result.answer, result.fit
    if f is None or answer.evidence is None:
        return sentence(result.reason)
    if answer.verdict == "cannot_tell" and f.why in ("may_be_a_gap", "families_disagree"):
        unit = op_unit(result)
        if answer.high is not None:
            return f"The data fit any gap from 0 to {quantity(answer.high, unit)}, most likely {quantity(f.d, unit)}."
        return f"The data fit any gap, most likely {quantity(f.d, unit)}, and none as well."
    if f.found:
        more = f" {MORE}" if f.why == "gap_and_more" else ""
        return f"Evidence for a gap: {EVIDENCE[answer.evidence]}.{more}"
    return sentence(f.reason)


def basis(result: Result) -> str:
    """Say in a few words what a verdict on a valve rests on."""
    evidence = result.answer.evidence
    return "zero crossings alone" if evidence is None else f"evidence {EVIDENCE[evidence]}"


def next_step(result: Result) -> str:
    """Say in one or two sentences what to do next; a step test that the recording holds is used, not advised."""
    answer = result.answer
    step = _step(result)
    do = step.text
    if answer.next.tested:
        do = f"{step_test(result)} {step.tested or ''}".rstrip()
    if answer.low is None or answer.acceptable in (None, "open"):
        return do
    assert answer.limit is not None
    acceptable = f"what is acceptable here, {number(answer.limit.percent_span)} % of span"
    if answer.acceptable == "within":
        return f"Nothing now: all of it is within {acceptable}. Analyse again at the next review."
    return f"It is more than {acceptable}. {do}"


def step_test(result: Result) -> str:
    """Say what the step test that the recording holds gives; empty where it holds none."""
    test = result.step_test
    if test is None:
        return ""
    gap = f"{quantity(test.d, op_unit(test))} ({number(test.low)} to {number(test.high)})"
    return f"This recording holds a step test, and it gives a gap of {gap}: see glapp step-test."


def todo(result: Result) -> str:
    """Say the same in a word or two."""
    step = _step(result)
    return "read test" if result.answer.next.tested and step.tested == _STEP_TEST else step.short


def _step(result: Result) -> Step:
    code, of = result.answer.next.code, result.answer.next.of
    if code == "remedy":
        assert of is not None
        return Step(REASONS[of].remedy, "step test", _STEP_TEST)
    return NEXT[code if of is None else f"{code} {of}"]


def width(result: Result) -> str:
    """Write the estimated width in OP units and, where the span is known and is not 100, in % of span."""
    text = quantity(result.d_hat, op_unit(result))
    percent = result.d_hat_percent_span
    if result.d_hat is None or percent is None or (result.unit == "%" and math.isclose(percent, result.d_hat)):
        return text
    return f"{text} ({quantity(percent, '% of span')})"


#: Fewer detections than this, and none of them can be checked against another: no sentence about the valve.
FEW = 3


def exceeds(result: Result) -> bool | None:
    """Tell whether d̂ is wider than what is acceptable, where it is the answer; None where that cannot be said."""
    answer = result.answer
    return None if answer.evidence is not None or answer.acceptable is None else answer.acceptable == "beyond"


def verdict(result: Result) -> list[str]:
    """Tell the zero crossings in paragraphs: what they give, on what it stands, what they reject, and do not say."""
    halves = count(result.total_half_periods, "half-period")
    if result.crossings == "refused":
        fitted = result.verdict != "refused"
        lead = f"The zero crossings of {result.name} say nothing." if fitted else f"{result.name} was not analysed."
        return [lead, sentence(result.reason)]
    basis: list[str] = []
    if result.d_hat is None:
        finding = f"No dead band could be estimated for {result.name}."
        basis.append(sentence(result.reason))
        if not result.detections:
            basis.append("This does not show that the valve is sound.")
    else:
        percent = result.d_hat_percent_span
        lost = quantity(percent, "% of OP span") if percent is not None else quantity(result.d_hat, op_unit(result))
        in_units = "" if percent is None or result.unit == "%" else f" ({quantity(result.d_hat, op_unit(result))})"
        verb = "appears to lose" if result.crossings == "provisional" else "loses"
        finding = f"The valve of {result.name} {verb} {lost}{in_units} at each reversal."
        if result.answer.evidence is not None:
            finding = f"A PLC would show {lost}{in_units}."
        elif result.detections < FEW:
            finding = f"Too few detections to judge the valve of {result.name}: they read {lost}{in_units}."
        elif exceeds(result) is False:
            finding = f"The dead band of {result.name} reads {lost}{in_units}, within what is acceptable."
        basis.append(f"This comes from {count(result.detections, 'detection')} in {halves}.")
        if result.crossings == "provisional":
            basis.append(
                f"It is provisional: fewer than {result.settings.n} detections stand behind it, and it may still move."
            )
        if result.repeatability is not None and result.detections > 1:
            low, high = result.repeatability
            basis.append(
                f"The detections kept lie between {number(low)} and {quantity(high, op_unit(result))}: "
                "that is how well they repeat, not how near they are to the truth."
            )
        if result.corrected is not None:
            basis.append(corrected(result))
        if result.noise_floor is not None:
            basis.append(f"The noise limit is {quantity(result.noise_floor, op_unit(result))}.")
        wide = exceeds(result)
        if wide is not None:
            assert result.answer.limit is not None
            limit = quantity(result.answer.limit.percent_span, "%")
            basis.append(
                f"It is {'wider than' if wide else 'within'} the {limit} of span called acceptable for this loop."
            )
        positioner = result.loop.positioner
        if positioner is not None and positioner.dead_band is not None:
            basis.append(
                f"The positioner's own dead band is set to {quantity(positioner.dead_band, '%')}, which is part of it."
            )
    if result.answer.struck is not None:
        finding, basis = struck(result), basis[:1]
    paragraphs = [finding, " ".join(filter(None, basis))]
    ranked = ranked_reasons(result)
    if ranked:
        name, n = ranked[0]
        paragraphs.append(
            f"The most frequent reason for rejection was “{REASONS[name].label}” ({n} of {halves}): "
            f"{REASONS[name].meaning}."
        )
    if result.d_hat is not None and result.answer.struck is None:
        settles = step_test(result) or "A step test in manual settles it."
        paragraphs.append(
            "Load changes can make the width read too high, so that even a sound valve shows a per cent or two; small "
            f"movements can make it read too low; stiction looks the same. {settles}"
        )
    return paragraphs


def corrected(result: Result) -> str:
    """Tell the width with its known bias taken out, or why it is not."""
    c, unit = result.corrected, op_unit(result)
    assert c is not None
    if c.d is None:
        return f"Its known bias cannot be taken out: {c.reason}."
    how = "OP's travel from turn to turn" + ("" if c.travel == "op" else ", worked out by (4.1)")
    gain = ""
    if c.kp_range is not None:
        low, high = c.kp_range
        gain = f", and with it a process gain of {number(c.kp)} ({number(low)} to {number(high)})"
    return (
        f"With its known bias taken out it reads {quantity(c.d, unit)} ({number(c.low)} to {number(c.high)}){gain}: "
        f"from {how} in {count(c.pairs, 'pair')} of half-periods."
    )


def comparisons(result: Result, i: int) -> list[tuple[str, bool | None]]:
    """List what half-period `i` was compared with: a line of text, and whether it passed (None: not applied).

    Only the comparisons of numbers; a gap, a bad value, manual mode or a limit is in the mask alone.
    """
    h, s = result.half_periods, result.settings
    unit_pv = result.loop.pv_unit or "PV unit"
    assert s.k is not None and s.ti is not None  # there are no half-periods without a controller
    failed = failures(int(h.mask[i]))
    dy, k = float(h.delta_y[i]), abs(s.k)
    lines: list[tuple[str, bool | None]] = [
        (f"Δt {quantity(h.delta_t[i], 's')}, needs > 5·TI = {quantity(5 * s.ti, 's')}", "too_short" not in failed),
        (
            f"e_max {quantity(h.e_max[i], unit_pv)}, needs < 2·Δy = {quantity(2 * dy, unit_pv)}",
            "not_square" not in failed,
        ),
    ]
    previous = float(h.previous_delta_y[i])
    if math.isfinite(previous) and dy > 0:
        lines.append((f"Δy before / Δy = {number(previous / dy, 4)}, needs 0.5 to 1.5", "uneven" not in failed))
    else:
        lines.append(("no Δy before it to compare with", "uneven" not in failed))
    lines.append(
        (
            f"SP moved {quantity(h.delta_sp[i], unit_pv)}, needs < Δy = {quantity(dy, unit_pv)}",
            "sp_moved" not in failed,
        )
    )
    before = float(h.d_hat_before[i])
    if math.isfinite(before) and dy > 0 and k > 0:
        bound = s.ti * before / (2 * k * dy)
        lines.append(
            (
                f"Δt {quantity(h.delta_t[i], 's')}, needs > bound (5.1) = {quantity(bound, 's')}",
                "too_small" not in failed,
            )
        )
    else:
        lines.append(("bound (5.1) not applied yet", None))
    return lines


def failures(mask: int) -> Sequence[str]:
    """Names of all the conditions in a mask, in their order.

    >>> failures(0), failures(0b10001)
    ([], ['gap', 'too_short'])
    """
    return [name for bit, name in enumerate(NAMES[1:]) if mask >> bit & 1]


def sentence(text: str | None) -> str:
    """Make a reason a sentence: full stop, and a capital letter unless it starts with a file, a tag or a symbol."""
    if not text:
        return ""
    if text.split()[0].isalpha():
        text = text[0].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else text + "."
