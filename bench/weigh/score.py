"""Tables on the worth of the weights."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np

from ..ordinary.design import JUDGE
from ..truth.score import markdown
from .model import Bools, Floats, Lines, Names, auc, balanced, learned, left_out, log_loss
from .samples import Sample

PRIORS = (0.1, 0.25, 0.5)
USUAL = 0.25
FOUND, LIKELY = 0.97, 0.75
LEAST_LR = 15.0
BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
FEW = 15
"""Number of records below which a share is not worth printing."""

KINDS: dict[str, Callable[[Sample], str]] = {
    "load": lambda s: s.load,
    "process": lambda s: s.process,
    "recorder": lambda s: s.recorder,
    "friction": lambda s: s.friction,
    "load and process": lambda s: f"{s.load}, {s.process}",
}
"""Groups that are left out in turn."""


class Data(NamedTuple):
    """Samples in columns; a record a row.

    `quantities` as the core has them, `rises` which way each speaks, `log_odds` by the weights that are compiled.
    """

    samples: list[Sample]
    names: list[str]
    quantities: Floats
    rises: Bools
    log_odds: Floats
    gap: Bools
    weight: Floats

    def of(self, which: Bools) -> Self:
        """Some of them, weighed anew."""
        samples = [s for s, take in zip(self.samples, which, strict=True) if take]
        gap = self.gap[which]
        rows = np.array([s.row for s in samples])
        columns = (self.quantities[which], self.rises, self.log_odds[which], gap, balanced(gap, rows))
        return type(self)(samples, self.names, *columns)

    def group(self, of: Callable[[Sample], str]) -> Names:
        """Outcome of each record by a rule."""
        return np.array([of(s) for s in self.samples])

    def column(self, name: str) -> Floats:
        """A quantity of all records."""
        found: Floats = self.quantities[:, self.names.index(name)]
        return found

    def lines(self) -> Lines:
        """Lines for other records."""
        return learned(self.quantities, self.rises, self.gap, self.weight)

    def learned(self, out: Names | None = None) -> Floats:
        """Log-odds by lines learned without each record's group, by default without the record and its twins."""
        groups = self.group(lambda s: s.twin) if out is None else out
        return left_out(self.quantities, self.rises, self.gap, self.weight, groups, 40)


def logit(p: float) -> float:
    """Ln p/(1−p)."""
    return float(np.log(p / (1 - p)))


def probability(odds: Floats, prior: float) -> Floats:
    """Probability of a dead band, where a share `prior` of valves has one."""
    p: Floats = 1.0 / (1.0 + np.exp(-(odds + logit(prior))))
    return p


def at(prior: float, data: Data) -> Floats:
    """Weights with which a share `prior` of the records has a gap."""
    weight = data.weight * np.where(data.gap, 2 * prior, 2 * (1 - prior))
    found: Floats = weight
    return found


def tables(data: Data) -> str:
    """All tables; a part judges the weights of all others, where there are records of it."""
    parts_of = data.group(lambda s: s.half)
    ours, judge = data.of(parts_of != JUDGE), data.of(parts_of == JUDGE)
    judged = []
    if judge.samples:
        odds = ours.lines().log_odds(judge.quantities)
        judged = [
            ("Log loss, learned from the other parts", losses(ours, judge, odds)),
            (f"Frequency against stated probability, part {JUDGE}", calibration(judge, odds)),
            (f"Rungs by probability, compared with the ladder, part {JUDGE}", rungs(judge, odds)),
        ]
    parts = [
        ("", counts(data)),
        *judged,
        ("Each kind left out in turn", kinds(data)),
        ("A dead band beyond 1 % of span, twins left out", beyond(data, data.learned())),
        ("What must not be learned", nuisances(data)),
        ("The terms, learned from the other parts", terms(ours)),
    ]
    return "\n\n".join((f"### {title}\n\n" if title else "") + text for title, text in parts)


def counts(data: Data) -> str:
    """Numbers of records of each kind."""
    sources = sorted({s.name.split(" ")[0] for s in data.samples})
    fits = ", ".join(sorted({s.fit for s in data.samples}))
    of = sorted(Counter(s.half for s in data.samples).items())
    return (
        f"{len(data.samples)} records of {', '.join(sources)}, {int(data.gap.sum())} with a gap. Of these "
        f"{', '.join(f'{n} of part {part}' for part, n in of)}. Fit {fits}."
    )


def losses(ours: Data, judge: Data, odds: Floats) -> str:
    """Against the likelihood ratio alone: as a chi-square has it, and by the best line through it."""

    def of_ratio(data: Data) -> Floats:
        return np.array([[np.log1p(max(s.evidence["lr_no_gap"], 0.0))] for s in data.samples])

    alone = ours._replace(quantities=of_ratio(ours), rises=np.array([True]))
    line = alone.lines()

    def raw(data: Data) -> Floats:
        return np.clip([0.5 * s.evidence["lr_no_gap"] for s in data.samples], -4.0, 4.0)

    of = {
        "half the likelihood ratio, at most ±4": (raw(ours), raw(judge)),
        "a line through the likelihood ratio": (alone.learned(), line.log_odds(of_ratio(judge))),
        "all weights": (ours.learned(), odds),
    }
    body = []
    for name, each in of.items():
        row = [name]
        for data, z, best in zip((ours, judge), each, of["all weights"], strict=True):
            loss, least = (log_loss(x, data.gap, data.weight) for x in (z, best))
            row += [f"{loss:.3f}", f"{100 * (1 - least / loss):.0f} %", f"{auc(z, data.gap, data.weight):.3f}"]
        body.append(row)
    head = ["other parts, twins left out", "weights better by", "AUC", f"part {JUDGE}", "weights better by", "AUC"]
    return markdown(["log-odds", *head], body)


def calibration(data: Data, odds: Floats) -> str:
    """Bin by bin and prior by prior."""
    body = []
    for prior in PRIORS:
        p, weight = probability(odds, prior), at(prior, data)
        for low, high in pairwise(BINS):
            here = (p >= low) & (p < high) if high < 1 else p >= low
            if here.sum() >= FEW and weight[here].sum() > 0:
                stated, true = _means(p[here], data.gap[here], weight[here])
                row = [f"{prior:g}", f"{low:g} to {high:g}", str(int(here.sum()))]
                body.append([*row, *_percent(stated, true, true - stated, _error(p[here], weight[here]))])
    return markdown(["prior", "stated", "records", "mean stated", "true", "off", "standard error"], body)


def kinds(data: Data) -> str:
    """Mean stated probability against frequency of each kind, by weights that were learned without it."""
    body = []
    for what, of in KINDS.items():
        groups = data.group(of)
        for name in np.unique(groups):
            out = groups == name
            here = out
            if what == "friction":
                if name == "none":
                    continue
                # A kind of friction has no records without a gap of its own: those of its twins, which are learned
                # from, stand beside it.
                twins = {s.twin for s, take in zip(data.samples, out, strict=True) if take}
                here = out | np.array([s.twin in twins and not s.gap for s in data.samples])
            odds = _without(data, out)
            weight, p = at(USUAL, data)[here], probability(odds, USUAL)[here]
            if here.sum() < FEW or weight.sum() == 0:
                continue
            stated, true = _means(p, data.gap[here], weight)
            error = _error(p, weight)
            good = abs(true - stated) <= max(0.1, 2 * error)
            loss = log_loss(odds[here], data.gap[here], data.weight[here])
            row = [what, str(name), str(int(here.sum())), *_percent(stated, true, true - stated)]
            body.append([*row, f"{100 * error:.0f}", f"{loss:.3f}", "yes" if good else "no"])
    head = ["left out", "", "records", "mean stated", "true", "off", "standard error", "log loss", "holds"]
    return markdown(head, body)


def _without(data: Data, out: Bools) -> Floats:
    """Log-odds of all by lines that were learned without some."""
    rest = data.of(~out)
    return rest.lines().log_odds(data.quantities)


def rungs(data: Data, odds: Floats) -> str:
    """Rungs by the probability alone, and those of the ladder."""
    p = probability(odds, USUAL)
    lr = np.array([s.evidence["lr_no_gap"] for s in data.samples])
    said = data.group(lambda s: s.confidence)
    by_p = np.where((p >= FOUND) & (lr >= LEAST_LR), "found", np.where(p >= LIKELY, "likely", ""))
    identifiable = np.array([s.identifiable for s in data.samples])
    body = []
    for name, of in (("the ladder", said), ("by probability", by_p)):
        found, told = of == "found", (of == "found") | (of == "likely")
        row = [name]
        for group in (~data.gap, data.gap, data.gap & identifiable):
            row += [f"{int((found & group).sum())} and {int((told & group).sum())} of {int(group.sum())}"]
        for prior in (0.1, 0.25):
            weight = at(prior, data)
            for one in (found, told & ~found):
                share = weight[one & data.gap].sum() / max(weight[one].sum(), 1e-12)
                row.append(f"{100 * share:.0f} % of {int(one.sum())}")
        body.append(row)
    head = ["rungs", "gapless: found, found or likely", "gaps", "identifiable gaps"]
    head += ["*found* true at 0.1", "*likely* true at 0.1", "*found* true at 0.25", "*likely* true at 0.25"]
    return markdown(head, body)


def beyond(data: Data, odds: Floats) -> str:
    """Stated probability of a dead band beyond 1 % against its frequency, at the usual prior."""
    known = np.array([bool(s.wider) for s in data.samples])
    wider = np.array([_wider(s, 1.0) for s in data.samples])
    p, weight = probability(odds, USUAL) * wider, at(USUAL, data)
    true = np.array([s.d > 1.0 for s in data.samples])
    p, weight, true = p[known], weight[known], true[known]
    body = []
    for low, high in pairwise(BINS):
        here = (p >= low) & (p < high) if high < 1 else p >= low
        if here.sum() >= FEW:
            stated, share = _means(p[here], true[here], weight[here])
            body.append([f"{low:g} to {high:g}", str(int(here.sum())), *_percent(stated, share, share - stated)])
    return markdown(["stated", "records", "mean stated", "true", "off"], body)


def _wider(sample: Sample, width: float) -> float:
    told = np.array(sample.wider).reshape(-1, 2)
    return float(np.interp(width, *told.T)) if len(told) else 0.0


def nuisances(data: Data) -> str:
    """Success of a classifier on quantities alone that say nothing of the valve; twins are left out together."""
    columns = np.array([[np.log(x) for x in s.nuisances.values()] for s in data.samples])
    loads = data.group(lambda s: s.load)
    each = np.stack([(loads == load).astype(float) for load in np.unique(loads)], axis=1)
    twins = data.group(lambda s: s.twin)
    body = []
    for name, of in (("step, rows, lag, length", columns), ("and the kind of load", np.hstack([columns, each]))):
        # Each column may speak either way.
        both = np.hstack([of, of])
        rises = np.arange(both.shape[1]) < of.shape[1]
        odds = left_out(both, rises, data.gap, data.weight, twins)
        body.append([name, f"{auc(odds, data.gap, data.weight):.3f}"])
    return markdown(["classifier that sees only", "AUC"], body)


def terms(data: Data) -> str:
    """The lines: which way each speaks, and how much it can."""
    lines = data.lines()
    body = []
    for name, up, x, y in zip(data.names, data.rises, lines.x, lines.y, strict=True):
        body.append([name, "for" if up else "against", f"{x[0]:.3g} to {x[-1]:.3g}", f"{y[0]:+.2f} to {y[-1]:+.2f}"])
    return markdown(["quantity", "more of it speaks", "learned over", "log-odds"], body)


def _means(p: Floats, gap: Bools, weight: Floats) -> tuple[float, float]:
    return float(p @ weight / weight.sum()), float(gap @ weight / weight.sum())


def _error(p: Floats, weight: Floats) -> float:
    """Standard error of a frequency, by the stated probabilities: large where few records have most of the weight."""
    return float(np.sqrt((weight**2 @ (p * (1 - p))) / weight.sum() ** 2))


def _percent(*of: float) -> Sequence[str]:
    return [f"{100 * x:.0f}" for x in of]
