"""Answer on a record, beside its truth."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Literal, Self

import numpy as np

import glapp

from .records import Record, Truth

WIDTHS = ("backlash", "stiction", "both")
Outcome = Literal["right", "wrong", "silent"]


def outcome_of(verdict: str, d: float, low: float | None, high: float | None) -> Outcome:
    """Outcome of a verdict with its limits for a gap `d` wide, 0 for none.

    Right: a width whose interval holds the truth, a lower bound below it, *sound* where there is no gap.
    Wrong: what does not hold. Silent: nothing of it, and *sound, none above x* where the gap is narrower.
    """
    low, high = low or 0.0, np.inf if high is None else high
    if verdict in WIDTHS:
        return "right" if d > 0 and low <= d <= high else "wrong"
    if verdict == "at_least":
        return "right" if d > 0 and low <= d else "wrong"
    if verdict == "sound":
        return "wrong" if d > high else "right" if d == 0 else "silent"
    return "silent"


@dataclass(frozen=True)
class LoadsAnswer:
    """Answer of `glapp.analyze` on a record, through its fit.

    - `d`, `low`, `high`, `lr`: as in `glapp.fit.Fit`; lr is `lr_no_gap`.
    - `lowest`: the least number among width and limits, of the whole and of each window [% of OP].
    - `sinusoidal`: whether there is a finding that the loop swings in a clean sinusoid, so that it is not backlash.
    """

    truth: Truth
    verdict: str
    reason: str
    d: float | None
    low: float | None
    high: float | None
    lr: float | None
    lowest: float
    sinusoidal: bool
    seconds: float

    @property
    def sided(self) -> bool:
        """Whether it is a width."""
        return self.verdict in WIDTHS

    @property
    def claims(self) -> bool:
        """Whether it says that there is a gap."""
        return self.sided or self.verdict == "at_least"

    @property
    def holds(self) -> bool:
        """Whether the answer is true of the width; silence counts as true."""
        return self.outcome != "wrong"

    @property
    def outcome(self) -> Outcome:
        """Outcome of the answer, see `outcome_of`."""
        return outcome_of(self.verdict, self.truth.d, self.low, self.high)

    @property
    def contradicts(self) -> bool:
        """Whether it says at once that the valve is worn and that it is not."""
        return self.sinusoidal and self.claims

    @property
    def key(self) -> tuple[str, int]:
        """The record that it is about."""
        return self.truth.name, self.truth.samples

    def __str__(self) -> str:
        d, low, high = ("" if x is None else f"{x:.3g}" for x in (self.d, self.low, self.high))
        return f"{self.verdict} {d} ({low} to {high})"

    @classmethod
    def to(cls, record: Record, samples: int) -> Self:
        """Ask about the first so many samples of a record."""
        recording = record.recording(samples)
        begin = perf_counter()
        result = glapp.analyze(recording)
        seconds = perf_counter() - begin
        fit = result.fit
        assert fit is not None
        numbers = [(fit.d, fit.low, fit.high), *((w.d, w.low, w.high) for w in fit.windows)]
        return cls(
            truth=record.truth(samples),
            verdict=fit.verdict,
            reason=fit.reason,
            d=fit.d,
            low=fit.low,
            high=fit.high,
            lr=fit.lr_no_gap,
            lowest=min((x for of in numbers for x in of if x is not None), default=0.0),
            sinusoidal=any(finding.code == "sinusoidal" for finding in result.quality),
            seconds=seconds,
        )

    def to_json(self) -> str:
        """The answer as one line of JSON."""
        return json.dumps(asdict(self))


COUNTED = ("no gap", "width", "bound", "gap", "right", "wrong", "silent")
"""Heads of `counted`."""


def counted(answers: Sequence[LoadsAnswer]) -> list[int]:
    """Counts of records without a gap with their widths and bounds, and of others by right, wrong and no answer."""
    none, gap = ([a for a in answers if (a.truth.d > 0) == there] for there in (False, True))
    numbers = [len(none), *(sum(a.verdict in claims for a in none) for claims in (WIDTHS, ("at_least",)))]
    return [*numbers, len(gap), *(sum(a.outcome == outcome for a in gap) for outcome in ("right", "wrong", "silent"))]


def read(path: Path) -> list[LoadsAnswer]:
    """Answers from a file that has one a line."""
    lines = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    return [LoadsAnswer(Truth(**line.pop("truth")), **line) for line in lines]


def against(before: Iterable[LoadsAnswer], now: Sequence[LoadsAnswer]) -> str:
    """Change for each record that both have."""
    then = {answer.key: answer for answer in before}
    both = [(then[answer.key], answer) for answer in now if answer.key in then]
    lines = [f"{len(both)} records are in both."]
    for row in dict.fromkeys(answer.truth.row for answer in now):
        for what, there in (("no gap", False), ("gap", True)):
            of = [
                (old.outcome, new.outcome) for old, new in both if old.truth.row == row and (old.truth.d > 0) == there
            ]
            if not of:
                continue
            counts = (f"{t} {sum(o == t for o, _ in of)} -> {sum(n == t for _, n in of)}" for t in ("right", "wrong"))
            lost, gained = (sum((o == "right", n == "right") == way for o, n in of) for way in ((1, 0), (0, 1)))
            lines.append(f"{row}, {what}: {', '.join(counts)}; lost {lost}, gained {gained} of {len(of)}")
    changed = [(old, new) for old, new in both if old.outcome != new.outcome]
    lines += [
        f"{new.truth.name} {new.truth.samples} (d {new.truth.d:.3g}): "
        f"{old.outcome} -> {new.outcome}: {old} -> {new}; {new.reason}"
        for old, new in sorted(changed, key=lambda pair: (pair[0].outcome, pair[1].outcome, pair[0].truth.name))
    ]
    return "\n".join(lines)
