"""From answers to tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from .answer import DENIAL, FAULT
from .design import FAMILIES
from .records import TRAVERSALS, Truth

FAULTY = ("backlash", "stiction", "both")
"""Causes that are in the valve."""

LACKING: dict[str, Callable[[Truth], bool]] = {
    "few traversals": lambda truth: min(truth.up, truth.down) < TRAVERSALS,
    "OP moves too little": lambda truth: truth.op_range < 1.5 * truth.d,
    "noise": lambda truth: truth.d * abs(truth.gain) < 3 * truth.sigma,
    "h > T/5": lambda truth: truth.h > truth.lag / 5,
}
"""Conditions that a gap may fail for it to be identifiable; it may fail several."""

FEW = 3
"""Number of widths below which a median is not worth printing."""


class Scored(NamedTuple):
    """One answer beside its truth."""

    truth: Truth
    method: str
    verdict: str
    d: float | None
    low: float | None
    high: float | None
    at_least: float | None
    reason: str
    seconds: float

    @property
    def error(self) -> float:
        """d̂/d − 1, NaN where there is no width, or none to compare with."""
        return np.nan if self.d is None or self.truth.d == 0 else self.d / self.truth.d - 1

    @property
    def covered(self) -> bool | None:
        """Whether the width's interval holds d; None where there is no width, or no interval."""
        if self.d is None or self.low is None or self.high is None:
            return None
        return self.low <= self.truth.d <= self.high

    @property
    def alarm(self) -> bool:
        """Whether somebody is sent to the valve."""
        return self.verdict in FAULT

    @property
    def careful(self) -> bool:
        """A bound, from below or above, that is true; a refusal; or a width whose interval is true."""
        if self.d is not None:
            return bool(self.covered)
        return (self.at_least or 0.0) <= self.truth.d <= (math.inf if self.high is None else self.high)


Rows = Sequence[Scored]


def tables(scored: Rows) -> str:
    """All tables in Markdown."""
    methods = list(dict.fromkeys(row.method for row in scored))
    sizing = [m for m in methods if any(row.method == m and row.d is not None for row in scored)]
    judging = [m for m in methods if any(row.method == m and row.verdict != "cannot_tell" for row in scored)]
    parts = [
        ("In short", _summary(scored, methods)),
        ("Identifiable gaps: width", _width(scored, sizing)),
        ("No gap, or another cause: false alarms", _false_alarms(scored, judging)),
        ("Identifiable gaps: missed", _missed(scored, judging)),
        ("Gaps that cannot be identified", _unidentifiable(scored, sizing)),
        ("Regular oscillations: is it the valve?", _regular(scored, judging)),
        ("Who decides how many", decided(scored, methods)),
        ("Causes", "\n\n".join(f"*{m}*\n\n" + _confusion(_by(scored, method=m)) for m in judging)),
        ("Identifiable gaps: where the width goes wrong", _where(scored, sizing)),
        ("Time", _time(scored, methods)),
    ]
    return "\n\n".join(f"### {title}\n\n{text}" for title, text in parts)


def _summary(scored: Rows, methods: Sequence[str]) -> str:
    """Summary of a method, on one line."""
    head = ["method", "answered, inside", "bias", "coverage", "answered, outside", "bias", "coverage"]
    head += ["false alarms", "true bound or refusal where not identifiable", "cause right where it can be seen"]
    body = []
    for method in methods:
        rows = _by(scored, method=method)
        faulty = [row for row in rows if row.truth.cause in FAULTY]
        cells = []
        for family in FAMILIES:
            answered, bias, _, coverage = _widths([r for r in _by(faulty, family=family) if r.truth.identifiable])
            cells += [answered, bias, "" if coverage == "no interval" else coverage]
        sound = [row.alarm for row in rows if row.truth.cause not in FAULTY]
        unknown = [row.d is None and row.careful for row in faulty if not row.truth.identifiable]
        cause = [row.verdict == row.truth.cause for row in faulty if _cause_seen(row.truth)]
        body.append([method, *cells, _share(sound), _share(unknown), _share(cause)])
    return markdown(head, body)


def _cause_seen(truth: Truth) -> bool:
    """Whether the fault of the valve can be identified."""
    return truth.identifiable and (truth.cause == "backlash" or truth.cause_told)


def _width(scored: Rows, methods: Sequence[str]) -> str:
    head = ["method", "family", "cause", "records", "answered", "bias", "spread", "coverage"]
    body = []
    for method in methods:
        for family in FAMILIES:
            for cause in FAULTY:
                rows = _by(scored, method=method, family=family, cause=cause, identifiable=True)
                body.append([method, family, cause, str(len(rows)), *_widths(rows)])
    return markdown(head, body)


def _widths(rows: Rows) -> list[str]:
    """Share of widths given, bias, spread and coverage."""
    errors = np.array([row.error for row in rows])
    errors = errors[~np.isnan(errors)]
    covered = [row.covered for row in rows if row.covered is not None]
    if len(errors) < FEW:
        return [_share([row.d is not None for row in rows]), "", "", ""]
    low, high = np.percentile(errors, [15.87, 84.13])
    return [
        _share([row.d is not None for row in rows]),
        f"{100 * np.median(errors):+.1f} %",
        f"{50 * (high - low):.0f} %",
        _share(covered) if covered else "no interval",
    ]


def _false_alarms(scored: Rows, methods: Sequence[str]) -> str:
    groups = [("none", load) for load in ("steps", "ramps", "walk")] + [("oscillation", x) for x in ("sine", "limit")]
    return _matrix(
        scored,
        methods,
        [
            (f"{cause}, {load}, {family}", {"cause": cause, "load": load, "family": family})
            for cause, load in groups
            for family in FAMILIES
        ],
        lambda row: row.alarm,
    )


def _missed(scored: Rows, methods: Sequence[str]) -> str:
    return _matrix(
        scored,
        methods,
        [
            (f"{cause}, {load}, {family}", {"cause": cause, "load": load, "family": family, "identifiable": True})
            for cause in FAULTY
            for load in ("steps", "ramps", "walk")
            for family in FAMILIES
        ],
        lambda row: not row.alarm,
    )


def _matrix(
    scored: Rows, methods: Sequence[str], groups: Sequence[tuple[str, dict[str, Any]]], what: Callable[[Scored], bool]
) -> str:
    body = []
    for title, group in groups:
        chosen = [_by(scored, method=method, **group) for method in methods]
        body.append([title, str(len(chosen[0])), *(_share([what(row) for row in rows]) for rows in chosen)])
    return markdown(["group", "records", *methods], body)


def _unidentifiable(scored: Rows, methods: Sequence[str]) -> str:
    head = ["method", "why", "records", "bound or refusal", "wrong bound", "width with a true interval", "other width"]
    body = []
    for method in methods:
        every = [row for row in _by(scored, method=method, identifiable=False) if row.truth.cause in FAULTY]
        for why in ("all", *LACKING):
            rows = every if why == "all" else [row for row in every if LACKING[why](row.truth)]
            shares = (
                _share([(row.d is None) == without and row.careful == careful for row in rows])
                for without, careful in ((True, True), (True, False), (False, True), (False, False))
            )
            body.append([method, why, str(len(rows)), *shares])
    return markdown(head, body)


def _regular(scored: Rows, methods: Sequence[str]) -> str:
    """The valve / not the valve / undecided, for records that oscillate regularly; a gap must be identifiable."""
    body = []
    for cause in ("none", "oscillation", *FAULTY):
        rows = [row for row in _by(scored, cause=cause, regular=True) if row.truth.identifiable or cause not in FAULTY]
        cells = []
        for method in methods:
            verdicts = [row.verdict for row in rows if row.method == method]
            n = max(len(verdicts), 1)
            valve, denied = sum(v in FAULT for v in verdicts), sum(v in DENIAL for v in verdicts)
            parts = (valve, denied, len(verdicts) - valve - denied)
            cells.append(" / ".join(f"{100 * part / n:.0f}" for part in parts))
        body.append([cause, str(len({row.truth.name for row in rows})), *cells])
    return markdown(["truth", "records", *(f"{m} [%]" for m in methods)], body)


def decided(scored: Rows, methods: Sequence[str]) -> str:
    """Numbers of records that a method decides, rightly and wrongly: regular oscillations, and all of them."""
    body = []
    for method in methods:
        cells = [method]
        for every in ([row for row in _by(scored, method=method) if row.truth.regular], _by(scored, method=method)):
            right = wrong = 0
            for row in every:
                faulty = row.truth.cause in FAULTY
                # A bound that is true denies nothing.
                denied = row.verdict in DENIAL and (row.high is None or row.truth.d > row.high)
                right += row.alarm if faulty else row.verdict in DENIAL
                wrong += denied if faulty else row.alarm
            cells += [str(len(every)), str(right), str(wrong), str(len(every) - right - wrong)]
        body.append(cells)
    head = ["method", "regular oscillations", "right", "wrong", "undecided", "all records", "right", "wrong"]
    return markdown([*head, "undecided"], body)


def _confusion(rows: Rows) -> str:
    """Truth down, verdicts across; with a gap only identifiable records, with a slip jump only where it can be seen."""
    verdicts = list(dict.fromkeys(row.verdict for row in rows))
    verdicts.sort(key=lambda v: -sum(row.verdict == v for row in rows))
    body = []
    for cause in ("none", "oscillation", *FAULTY):
        of_cause = [row for row in _by(rows, cause=cause) if cause not in FAULTY or _cause_seen(row.truth)]
        body.append([cause, str(len(of_cause)), *(_share([row.verdict == v for row in of_cause]) for v in verdicts)])
    return markdown(["truth", "records", *verdicts], body)


def _where(scored: Rows, methods: Sequence[str]) -> str:
    """Bias ± spread, share answered and coverage, of identifiable gaps in groups of every kind."""
    groups: dict[tuple[str, str], list[Scored]] = {}
    for row in scored:
        if row.truth.identifiable:
            for group in _groups(row.truth):
                groups.setdefault(group, []).append(row)
    body = []
    for group in sorted(groups):
        rows = groups[group]
        cells = [_widths(_by(rows, method=method)) for method in methods]
        count = len(rows) // len({row.method for row in rows})
        body.append([f"{group[0]} {group[1].strip()}", str(count), *(_short(*cell) for cell in cells)])
    return markdown(["group", "records", *methods], body)


def _short(answered: str, bias: str, spread: str, coverage: str) -> str:
    """Bias ± spread, share answered, coverage."""
    if not bias:
        return answered
    return f"{bias} ± {spread}, {answered}" + ("" if coverage == "no interval" else f", {coverage}")


def _groups(truth: Truth) -> Iterator[tuple[str, str]]:
    """Groups that a record is in: kind and value, padded so that they sort as numbers."""
    yield "load", truth.load
    size = truth.load_size / truth.d
    yield "load against d", "below 1" if size < 1 else "1 to 3" if size < 3 else "above 3"
    yield "setpoint", truth.setpoint
    yield "process", truth.process
    if truth.departure:
        yield "departure", truth.departure
    yield "tuning", truth.rule.rsplit(" ", 1)[0]
    yield "controller", truth.rule.rsplit(" ", 1)[1]
    yield "OP", "rounded" if truth.op_resolution else "not rounded"
    yield "d", f"{truth.d:4.1f} %"
    unseen = truth.op_unseen / truth.d
    yield "OP unseen between samples", "below d/50" if unseen < 0.02 else "d/50 to d/5" if unseen < 0.2 else "more"
    steps = truth.lag / truth.h
    yield "samples in T", "  5 to 15" if steps <= 15 else " 15 to 50" if steps <= 50 else "above 50"
    clear = truth.d * abs(truth.gain) / truth.sigma
    yield "d·Kp/σ", "  3 to 10" if clear < 10 else " 10 to 30" if clear < 30 else "above 30"
    turns = min(truth.up, truth.down)
    yield "traversals each way", "  5 to 10" if turns <= 10 else " 11 to 50" if turns <= 50 else "above 50"


def _time(scored: Rows, methods: Sequence[str]) -> str:
    body = []
    for method in methods:
        seconds = np.array([row.seconds for row in _by(scored, method=method)]) * 1000
        body.append([method, f"{np.median(seconds):.0f}", f"{np.percentile(seconds, 95):.0f}", f"{seconds.max():.0f}"])
    return markdown(["method", "median ms", "95 % ms", "longest ms"], body)


def worst(scored: Rows, method: str, count: int = 20) -> str:
    """The records that a method is most wrong about, with what to make them again by."""

    def wrong(row: Scored) -> float:
        if row.truth.d == 0:
            return 20.0 + (row.d or row.at_least or 0.0) if row.alarm else 0.0
        if row.careful or (row.d is not None and row.covered is None and row.truth.identifiable):
            return 0.0 if row.d is None or row.covered else abs(row.error)
        return (10.0 if row.truth.identifiable else 0.0) + (5.0 if row.d is None else abs(row.error))

    rows = sorted(_by(scored, method=method), key=wrong, reverse=True)[:count]
    body = []
    for row in rows:
        if wrong(row) == 0:
            break
        t = row.truth
        limits = " to ".join("" if x is None else f"{x:.3g}" for x in (row.low or row.at_least, row.high))
        body.append(
            [
                *(t.name, t.process, t.rule, t.departure, f"{t.d:g}", "yes" if t.identifiable else "no"),
                *(f"{min(t.up, t.down)}", f"{t.d * abs(t.gain) / t.sigma:.1f}"),
                *(f"{t.lag / t.h:.1f}", f"{t.op_unseen:.2g}", f"{t.load_size:.2g}"),
                *(row.verdict, "" if row.d is None else f"{row.d:.3g}", limits.strip() if limits != " to " else ""),
            ]
        )
    head = ["record", "process", "tuning", "departure", "d", "identifiable"]
    return markdown([*head, "traversals", "d·Kp/σ", "T/h", "OP unseen", "load", "verdict", "d̂", "bounds"], body)


def _by(rows: Rows, **equal: Any) -> list[Scored]:
    """Rows of a method, and those whose truth has these values."""
    method = equal.pop("method", None)
    return [
        row
        for row in rows
        if (method is None or row.method == method) and all(getattr(row.truth, k) == v for k, v in equal.items())
    ]


def _share(hits: Sequence[bool | None]) -> str:
    if not hits:
        return ""
    share = 100 * sum(bool(x) for x in hits) / len(hits)
    return f"{share:.0f} %" if share in (0, 100) or len(hits) < 200 else f"{share:.1f} %"


def markdown(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """A table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in body)])
