"""From answers to the tables that a rule is chosen, or judged, by."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from ..truth.records import TRAVERSALS
from ..truth.score import markdown
from .answers import CLAIMED, Claim, Line
from .design import CYCLES, ROWS
from .records import LIMIT

TURNS = 10
"""Turns of OP by `LIMIT` from which a gapless record ought to be called sound."""


class Judged(NamedTuple):
    """A line and its claim."""

    line: Line
    claim: Claim

    @property
    def claimed(self) -> bool:
        """Whether a gap is found, or likely."""
        return self.claim.confidence in CLAIMED


Group = Sequence[Judged]


def tables(lines: Iterable[Line], again: bool = False) -> str:
    """All tables in Markdown."""
    every = [Judged(line, line.claim(again)) for line in lines]
    singles = [j for j in every if j.line.recordings == 1]
    parts = " and ".join(sorted({j.line.truth.half for j in every}))
    parts = [
        f"{len(singles)} records, part {parts}; in brackets the 95 % limits of a share (Clopper, Pearson).",
        titled("Gapless: false alarms", gapless(singles)),
        titled("Limit cycles", cycles(singles)),
        titled("Gaps that can be identified", seen(singles)),
        titled("Why identifiable gaps are not told", reasons(singles)),
        titled("Intervals", intervals(singles)),
        titled("Sound", sound(singles)),
        titled(f"Gapless, OP turned through {LIMIT:g} % {TURNS} times: why not sound", unsound(singles)),
        titled("Causes", causes(singles)),
        titled("Limits of the process", process(singles)),
        titled("More recordings", several(every)),
        titled("Time", times(singles)),
    ]
    return "\n\n".join(part for part in parts if part)


def titled(title: str, table: str) -> str:
    """The table under its title; nothing where it is empty."""
    return f"### {title}\n\n{table}" if table else ""


def share(hits: Sequence[bool]) -> str:
    """Share in per cent with 95 % limits."""
    n, k = len(hits), sum(hits)
    if n == 0:
        return "-"
    low, high = stats.binomtest(k, n).proportion_ci(0.95, method="exact")
    return f"{100 * k / n:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def counts(hits: Sequence[bool]) -> str:
    """Text *so many of so many*."""
    return f"{sum(hits)} of {len(hits)}"


def _by_row(group: Group) -> dict[str, list[Judged]]:
    found = {row: [j for j in group if j.line.truth.row == row] for row in ROWS}
    return {row: selected for row, selected in found.items() if selected}


def gapless(group: Group) -> str:
    """Number of records without a gap that are called one: row by row, and all."""
    without = [j for j in group if j.line.truth.d == 0]
    groups = {}
    for row, selected in _by_row(without).items():
        groups[row] = [j for j in selected if j.line.truth.fault == "none"]
        groups[f"{row}, driven"] = [j for j in selected if j.line.truth.fault == "driven"]
    groups["all, not driven"] = [j for j in without if j.line.truth.fault == "none"]
    groups["all"] = without
    body = [
        [
            name,
            str(len(selected)),
            share([j.claim.confidence == "found" for j in selected]),
            share([j.claimed for j in selected]),
            share([j.claim.confidence == "sound" for j in selected]),
        ]
        for name, selected in groups.items()
        if selected
    ]
    return markdown(["row", "records", "found", "found or likely", "sound"], body) if body else ""


def cycles(group: Group) -> str:
    """Limit cycles of a gap and of friction."""
    body = []
    for row in CYCLES:
        selected = [j for j in group if j.line.truth.row == row and j.line.truth.d > 0]
        if selected:
            sided = [j for j in selected if j.claim.sided]
            driven = [j for j in group if j.line.truth.row == row and j.line.truth.fault == "driven"]
            body.append(
                [
                    row,
                    str(len(selected)),
                    share([j.claim.confidence == "found" for j in selected]),
                    share([j.claimed for j in selected]),
                    counts([j.claim.holds(j.line.truth.d) for j in sided]),
                    share([j.claimed for j in driven]),
                ]
            )
    head = ["row", "cycles", "found", "found or likely", "interval holds", "driven twins: found or likely"]
    return markdown(head, body) if body else ""


def seen(group: Group) -> str:
    """Number of gaps found of those that the rule of bench.truth calls identifiable, row by row."""
    identifiable = [j for j in group if j.line.truth.identifiable]
    groups: dict[str, Group] = {
        "rows near": [j for j in identifiable if not j.line.truth.apart],
        "rows further apart than T/5": [j for j in identifiable if j.line.truth.apart],
        "inside the fit's family": [j for j in identifiable if not j.line.truth.outside],
        "outside": [j for j in identifiable if j.line.truth.outside],
        **_by_row(identifiable),
    }
    body = [
        [
            name,
            str(len(selected)),
            share([j.claim.confidence == "found" for j in selected]),
            share([j.claimed for j in selected]),
            counts([j.claim.holds(j.line.truth.d) for j in selected if j.claim.sided]),
            counts([j.claim.holds(j.line.truth.d) for j in selected if not j.claimed and j.claim.high is not None]),
        ]
        for name, selected in groups.items()
        if selected
    ]
    head = ["gaps", "records", "found", "found or likely", "told interval holds", "withheld interval holds"]
    return markdown(head, body) if body else ""


def reasons(group: Group) -> str:
    """Reasons of the identifiable gaps that are not found, the most frequent first."""
    silent = [j for j in group if j.line.truth.identifiable and not j.claimed]
    found: Counter[str] = Counter(f"{j.claim.confidence}: {j.line.fit.get('reason_code') or 'no fit'}" for j in silent)
    return markdown(["reason", "records"], [[why, str(n)] for why, n in found.most_common()]) if silent else ""


def intervals(group: Group) -> str:
    """Coverage and width of the intervals of found and of likely gaps."""
    body = []
    for confidence in CLAIMED:
        selected = [j for j in group if j.claim.confidence == confidence and j.line.truth.d > 0]
        sided = [j for j in selected if j.claim.sided]
        bounds = [j for j in selected if j.claim.width_kind == "bound" and j.claim.low is not None]
        if selected:
            ratios = [j.claim.high / j.claim.low for j in sided if j.claim.low]  # type: ignore[operator]
            body.append(
                [
                    confidence,
                    str(len(selected)),
                    share([j.claim.sided for j in selected]),
                    share([j.claim.holds(j.line.truth.d) for j in sided]),
                    f"{np.median(ratios):.2f}" if ratios else "-",
                    counts([j.line.truth.d >= j.claim.low for j in bounds]),  # type: ignore[operator]
                ]
            )
    head = ["gaps called", "records", "with an interval", "interval holds", "median high/low", "bound holds"]
    return markdown(head, body) if body else ""


def sound(group: Group) -> str:
    """Sound of valves with a gap, and of those without whose OP turned often enough."""
    wide = [j for j in group if j.line.truth.d > LIMIT]
    told = [j for j in wide if j.claim.confidence == "sound"]
    narrow = [j for j in group if 0 < j.line.truth.d <= LIMIT and j.claim.confidence in ("sound", "none_seen")]
    turned = [j for j in group if j.line.truth.d == 0 and j.line.truth.op_turns >= TURNS]
    still = [j for j in group if j.line.truth.row == "standing" and j.line.truth.d > 0]

    def wrong(j: Judged) -> bool:
        return j.claim.high is None or j.line.truth.d > j.claim.high

    def called(j: Judged) -> bool:
        return j.claim.confidence == "sound"

    def probably(j: Judged) -> bool:
        return j.claim.confidence == "likely_sound"

    rows: dict[str, list[bool]] = {
        f"gaps wider than {LIMIT:g} %: called sound": [called(j) for j in wide],
        "of these the gap is wider than the bound": [wrong(j) for j in told],
        "narrower gaps, sound or none seen: wider than the bound": [wrong(j) for j in narrow],
        "valves that stand still: called sound": [called(j) for j in still],
        f"gapless, OP turned through {LIMIT:g} % {TURNS} times: called sound": [called(j) for j in turned],
        f"gaps wider than {LIMIT:g} %: called likely sound": [probably(j) for j in wide],
        "valves that stand still: called likely sound": [probably(j) for j in still],
        "gapless: called likely sound": [probably(j) for j in group if j.line.truth.d == 0],
        f"gapless, OP turned through {LIMIT:g} % {TURNS} times: called likely sound": [probably(j) for j in turned],
    }
    return markdown(
        ["", "how many", "share"], [[name, counts(selected), share(selected)] for name, selected in rows.items()]
    )


def unsound(group: Group) -> str:
    """Reasons why a valve without a gap is not called sound although OP turned often, the most frequent first."""
    turned = [j for j in group if j.line.truth.d == 0 and j.line.truth.op_turns >= TURNS]
    found = Counter(_doubt(j) for j in turned if j.claim.confidence != "sound")
    return markdown(["reason", "records"], [[why, str(n)] for why, n in found.most_common()]) if found else ""


def _doubt(j: Judged) -> str:
    """Why a valve is not called sound, of several reasons the first."""
    evidence, high = j.line.evidence.get("evidence"), j.claim.high
    if evidence is None:
        return "not fitted"
    doubts = {
        "a gap is found or likely": j.claimed,
        f"the bound is above {LIMIT:g} %, or there is none": high is None or high > LIMIT,
        "a gap explains PV better than none": evidence["low"] > 0,
        "a believed model sees a gap": evidence["dissent"],
        f"hidden by {evidence['hidden']}": evidence["hidden"] is not None,
    }
    return next((why for why, holds in doubts.items() if holds), "the process is not known well enough")


def jumps(line: Line) -> bool:
    """Whether the slip jump can be seen: J ≥ 3σ/Kp, five traversals each way."""
    truth = line.truth
    return truth.jump * abs(truth.gain) >= 3 * truth.sigma and min(truth.up, truth.down) >= TRAVERSALS


def causes(group: Group) -> str:
    """Causes named, by true cause."""
    groups: dict[str, Callable[[Line], bool]] = {
        "clearance": lambda line: line.truth.fault == "gap",
        "friction": lambda line: line.truth.fault == "friction",
        "friction, J ≥ 3σ/Kp": lambda line: line.truth.fault == "friction" and jumps(line),
        "both": lambda line: line.truth.fault == "both",
        "both, J ≥ 3σ/Kp": lambda line: line.truth.fault == "both" and jumps(line),
    }
    names = ("backlash", "dead_band", "stiction", "both")
    body = []
    for name, holds in groups.items():
        selected = [j for j in group if holds(j.line)]
        if selected:
            told = Counter(j.claim.cause for j in selected if j.claimed)
            right = [j.claimed and j.claim.cause in ("stiction", "both") for j in selected]
            body.append(
                [name, str(len(selected)), *(str(told[cause]) for cause in names), str(told[None]), share(right)]
            )
    return markdown(["truth", "records", *names, "no cause", "stiction or both"], body) if body else ""


def process(group: Group) -> str:
    """Coverage of the limits of gain, dead time and lags, inside the fit's family, without an integrator."""
    body = []
    for near in (True, False):
        selected = [
            j.line
            for j in group
            if not j.line.truth.outside
            and not j.line.truth.integrating
            and j.line.fit.get("process")
            and j.line.truth.apart != near
        ]
        if not selected:
            continue
        truths = {
            "kp": lambda line: line.truth.gain,
            "dead_time": lambda line: line.truth.dead_time,
            "lag": lambda line: line.truth.lag,
        }
        shares = []
        for name, truth in truths.items():
            limits = [(line.fit["process"][name], truth(line)) for line in selected]
            told = [(low, high, x) for (_, low, high), x in limits if low is not None and high is not None]
            shares.append(f"{share([low <= x <= high for low, high, x in told])} of {len(told)}")
        body.append(["rows near" if near else "rows further apart than T/5", str(len(selected)), *shares])
    return markdown(["", "records", "Kp", "dead time", "lags"], body) if body else ""


def several(every: Group) -> str:
    """Joint answers of several days of one valve, beside that of the first alone."""
    alone = {j.line.truth.name: j for j in every if j.line.recordings == 1}
    numbers = sorted({j.line.recordings for j in every})
    if len(numbers) < 2:
        return ""
    names = {j.line.truth.name for j in every if j.line.recordings > 1}
    body = []
    for n in numbers:
        selected = [j for j in every if j.line.recordings == n and j.line.truth.name in names and j.line.truth.d > 0]
        sided = [j for j in selected if j.claim.sided]
        narrower = []
        for j in sided:
            first = alone.get(j.line.truth.name)
            if first is not None and first.claim.sided:
                widths = [claim.high - claim.low for claim in (j.claim, first.claim)]  # type: ignore[operator]
                narrower.append(widths[0] / max(widths[1], 1e-9))
        body.append(
            [
                str(n),
                str(len(selected)),
                share([j.claim.confidence == "found" for j in selected]),
                share([j.claimed for j in selected]),
                share([j.claim.holds(j.line.truth.d) for j in sided]),
                f"{np.median(narrower):.2f} of {len(narrower)}" if narrower else "-",
            ]
        )
    head = ["recordings", "valves", "found", "found or likely", "interval holds", "width of the interval, one's is 1"]
    return markdown(head, body)


def times(group: Group) -> str:
    """Times of a record."""
    if not group:
        return ""
    seconds = [j.line.seconds for j in group]
    median, most = np.median(seconds), max(seconds)
    per = np.median([1e3 * j.line.seconds / j.line.truth.samples for j in group])
    whole = sum(seconds) / 60
    return f"Median {median:.1f} s a record, at most {most:.1f} s; {per:.2f} s a thousand rows; {whole:.0f} min in all."
