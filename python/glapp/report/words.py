"""Results in plain words, for the person who plans the maintenance.

The words themselves, and the format of every number, are in `crates/analysis/src/words`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, NamedTuple

from .. import _glapp
from .._glapp import count, duration, number, quantity, sentence, to_text
from ..loop import op_unit

if TYPE_CHECKING:
    from ..result import Result

__all__ = ["count", "duration", "number", "op_unit", "quantity", "sentence"]


def _catalogue_of(subject: str) -> dict[str, str]:
    """All of a subject of the catalogue, by name."""
    parts = ((code.partition("."), text) for code, text in _glapp.catalogue())
    return {name: text for (of, _, name), text in parts if of == subject}


class Reason(NamedTuple):
    """Texts on one verdict on a half-period: a label, what it means, and what to do if it is the usual one."""

    label: str
    meaning: str
    remedy: str


_MEANINGS, _REMEDIES = _catalogue_of("half_period_meaning"), _catalogue_of("half_period_remedy")

#: In the order of `glapp.result.REASONS`: the position in this table is the code in `HalfPeriods.reason`.
REASONS: dict[str, Reason] = {
    name: Reason(label, _MEANINGS[name], _REMEDIES[name]) for name, label in _catalogue_of("half_period").items()
}

NAMES = tuple(REASONS)

#: The one verdict of a loop. The last four are those of the zero crossings, where nothing was fitted.
VERDICTS = _catalogue_of("verdict")

#: Names of a confidence that are shown in place of the verdict.
LIKELY = {confidence: to_text(f"answer.{confidence}", {}) for confidence in ("likely", "likely_sound")}

#: What is known of a valve.
VALVES = _catalogue_of("valve")

#: How soon something is to be done.
URGENCIES = _catalogue_of("urgency")

#: What each verdict means, and what is shown in its place.
MEANINGS = _catalogue_of("meaning")

#: What each method is and is not.
METHODS: dict[str, tuple[str, ...]] = {
    "The gap from OP and PV": (
        "A model of the loop, from OP through a valve with a gap and through the process to PV, is fitted to the "
        "recording for every width of the gap. The width that explains PV best is the answer, and the limits hold all "
        "that explain it nearly as well.",
        "It needs an OP that reverses and crosses the gap. It asks neither for settings of the controller "
        "nor for a loop that oscillates.",
        "Two things mislead it most easily: a load that oscillates as regularly as a loop with a gap, and PV that was "
        "filtered or compressed on its way to the recording.",
    ),
    "Zero crossings: what a PLC would show": (
        "The width is worked out from how long and how far PV stays on one side of SP while the controller integrates. "
        "It needs no OP, and it runs in a PLC. It is the answer where nothing could be fitted; where the fit "
        "contradicts it, ignore it.",
        "Load changes while the loop waits make it read too high. Half-periods that do not cross the whole gap make it "
        "read too low. The scatter of the detections shows how well they repeat, but neither of these errors.",
        "A sound valve in noise or under a changing load also gives a number, in simulations up to about 2 % of span. "
        "A width far below what is acceptable is no evidence of a gap.",
        "Silence proves nothing: a loop that rests at its setpoint gives no half-periods, whatever its valve is like.",
    ),
}

#: What a 95 % limit is.
SURE_OF_LIMITS = "On 1104 simulated recordings of known truth 96 to 98 of 100 such intervals held the true width."

#: How sure the answers are, counted on the benches of docs/truth.md.
SURE: tuple[str, ...] = (
    "A width has two limits, as in 2.40 (2.15 to 3.11): a 95 % interval. " + SURE_OF_LIMITS + " On 2800 "
    "more, with loads and recorders that look like a gap, 711 of 717 did.",
    "Where there was no gap, the fit saw one in 4 of 1000 of the first and in 6 of 1400 of the second. Zero crossings "
    "alone would have sent somebody to the valve in 304 of 1000 of the first; their width read 39 to 74 % too wide in "
    "the median.",
    "It is silent rather than wrong: of the gaps on the first bench that a recording could show at all, 23 "
    "to 26 in 100 got a width. Several recordings of one valve show more.",
    "Evidence is strong where a model without a gap is worse by as much as the fit requires, very strong where by more "
    "than twice as much. It is weak where by half as much or more, or where a gap is likely by all evidence together.",
    "Before work is ordered, confirm with a step test in manual: small steps up, then small steps down, and note how "
    "far OP travels before PV moves. Stiction and backlash look alike in most recordings.",
)


def clock(t0: datetime | None, seconds: float) -> str:
    """Write a moment of the recording: local date and time where the first row has one, else seconds.

    >>> clock(datetime(2026, 3, 1, 12, 0), 90), clock(None, 90.0)
    ('2026-03-01 12:01:30', '90 s')
    """
    return _glapp.clock(None, seconds) if t0 is None else _glapp.clock(_micros(_moment(t0, seconds)), 0.0)


def _moment(t0: datetime, seconds: float) -> datetime:
    """A moment by the clocks of the recording's zone, without the zone."""
    # Elapsed time is added in UTC: the zone's clocks may have changed in between.
    zone = t0.tzinfo or UTC
    moment = (t0.replace(tzinfo=zone).astimezone(UTC) + timedelta(seconds=float(seconds))).astimezone(zone)
    return moment.replace(tzinfo=None)


def _micros(moment: datetime) -> int:
    return (moment - datetime(1970, 1, 1)) // timedelta(microseconds=1)


def days(results: Sequence[Result]) -> str:
    """The days of the recordings, as text; empty where none has dates."""
    ends = [
        _moment(r.t0, float(r.trace.t[at])).date().isoformat()
        for r in results
        if r.t0 is not None and r.trace is not None and len(r.trace.t)
        for at in (0, -1)
    ]
    return to_text("answer.days", {"first": min(ends), "last": max(ends)}) if ends else ""


def ranked(results: Sequence[Result]) -> list[Result]:
    """Order results as every list shows them, by `Answer.rank`."""
    return sorted(results, key=lambda result: result.answer.rank)


def judged(result: Result) -> bool:
    """Whether there is an answer on the valve. A list gives the reason of the others, and what would help."""
    return result.answer.valve in ("gap", "no_gap") or result.answer.confidence in LIKELY


def summary(results: Sequence[Result]) -> str:
    """A run in short: how many loops need what."""
    if len(results) == 1:
        return lead(results[0])
    answers = [result.answer for result in results]
    return _glapp.overview(
        json.dumps(
            [{"valve": a.valve, "urgency": a.urgency, "next": a.next.code, "acceptable": a.acceptable} for a in answers]
        )
    )


def verdict(result: Result) -> str:
    """Name the one verdict, as every list shows it."""
    return named(result.answer.confidence, result.answer.verdict)


def named(confidence: str | None, verdict: str) -> str:
    """Name a verdict: where a dead band is likely, or a sound valve is, that."""
    return LIKELY.get(confidence or "", VERDICTS.get(verdict, verdict))


def headline(result: Result) -> str:
    """Write the one width that a list shows, with its interval if it has one; empty where nothing is known of it."""
    return _text_of(result, "headline")


def of_span(result: Result) -> str:
    """Write the same in % of OP's span; empty where the span is not known, or the headline says so already."""
    return _text_of(result, "of_span")


def crossing(result: Result) -> str:
    """Write the width that a PLC would show, and whether it is wrong."""
    return _text_of(result, "plc")


def lead(result: Result) -> str:
    """State of the valve, in one sentence for the person who plans the maintenance."""
    return _text_of(result, "so")


def why(result: Result) -> list[str]:
    """Reasons of the answer, a sentence each."""
    found: list[str] = result.texts()["why"]
    return found


def basis(result: Result) -> str:
    """Basis of a verdict on a valve, in a few words."""
    evidence = result.answer.evidence
    return to_text("answer.basis", {"evidence": evidence and to_text(f"evidence.{evidence}")})


def next_step(result: Result) -> str:
    """Say in one or two sentences what to do next; a step test that the recording holds is used, not advised."""
    return _text_of(result, "do")


def todo(result: Result) -> str:
    """Say the same in a word or two."""
    return _text_of(result, "short")


def _text_of(result: Result, name: str) -> str:
    return str(result.texts()[name])


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
