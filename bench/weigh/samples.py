"""Records that the weights are learned from and judged by, each with its truth and the fit's evidence."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from time import process_time
from typing import Any, Literal, Self

import glapp
from glapp import _glapp

from .. import lengths
from ..loads import records as loads
from ..ordinary import design as ordinary_design
from ..ordinary import records as ordinary
from ..ordinary.answers import _plain
from ..ordinary.answers import read as read_answers
from ..ordinary.design import Half
from ..truth import design as truth_design
from ..truth import records as truth

Fault = Literal["none", "gap", "friction", "both"]

SEED = 40
"""Seed of the ordinary loops; `bench.ordinary` chooses and judges on others."""

FIRST = {"loads": 600, "truth": 5000, "lengths": 600}
"""Numbers from which on the other corpora are asked; thresholds were chosen and judged on smaller ones."""

LENGTH = 9000
"""Rows of a record of `bench.lengths`."""

HIDDEN = 1.0
"""A gap that makes less of PV than so many standard deviations of its noise is not one that the record can resolve."""

LOADS = {
    **dict.fromkeys(("drift", "walk", "day", "manual"), "drift"),
    **dict.fromkeys(("steps", "levels", "setpoint", "standing"), "steps"),
    **dict.fromkeys(("bends", "corners", "ramps", "random ramps", "slow ramps"), "bends"),
    **dict.fromkeys(("sine", "limit"), "sine"),
    **dict.fromkeys(("saw", "triangle fast", "triangle slow", "irregular cycle"), "saw"),
    **dict.fromkeys(("square", "squares through a lag"), "square"),
    "cascade": "cascade",
    "swing": "own cycle",
    "own cycle": "own cycle",
}
"""Kinds of load by their names in the corpora."""


@dataclass(frozen=True)
class Sample:
    """A record and the evidence for a gap in it.

    Attributes
    ----------
    name : str
        Source and name: "ordinary steps/gap/2/40" is `bench.ordinary.records.record("steps/gap/2/40")`.
    half : str
        The weights are judged by `ordinary_design.JUDGE`, and learned from all others.
    row : str
        Records of one row are weighed so that half of their weight has a gap.
    load, process, recorder : str
        What is left out in turn.
    friction : Fault
    d, seen : float
        Width [% of OP], 0 for none; d·Kp in standard deviations of PV's noise.
    identifiable : bool
        By the rule of `bench.truth`.
    nuisances : dict
        What says nothing of the valve: step, rows, lag in steps, length in lags.
    confidence : str
        What the ladder says.
    width : list
        Most likely width and its limits, told or withheld [% of OP].
    evidence : dict
        What the core has for it, as `fit_judgement` takes it.
    wider : list of (float, float)
        Widths [% of OP] with the probability that the gap is wider, if there is one.
    fit : str
        Version of the fit.
    seconds : float
        Of the processor.
    """

    name: str
    half: Half
    row: str
    load: str
    process: str
    recorder: str
    friction: Fault
    d: float
    seen: float
    identifiable: bool
    nuisances: dict[str, float]
    confidence: str
    width: list[float | None]
    evidence: dict[str, Any]
    wider: list[list[float]]
    fit: str
    seconds: float

    @property
    def twin(self) -> str:
        """Key that a record shares with its twins, which differ in the valve alone."""
        source, name = self.name.split(" ", 1)
        return f"{source} " + "/".join(part for part in name.split("/") if part not in FAULTS)

    @property
    def gap(self) -> bool:
        """Whether there is a dead band."""
        return self.d > 0.0

    @property
    def resolvable(self) -> bool:
        """Whether PV's noise does not hide it; also where there is none."""
        return not self.gap or self.seen >= HIDDEN

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(_plain(asdict(self)), allow_nan=False)

    @classmethod
    def of(cls, text: str) -> Self:
        """A sample from a line of `to_json`."""
        return cls(**json.loads(text))


FAULTS = ("none", "gap", "friction", "both", "driven", "backlash", "stiction", "oscillation")


def version() -> str:
    """Version of glapp and a number of its thresholds, which change when the fit does."""
    numbers = "".join(f"{name}{value}" for name, (value, _) in sorted(_glapp.fit_thresholds().items()))
    return f"{glapp.__version__} {sum(i * ord(c) for i, c in enumerate(numbers)) % 10**6:06}"


def names(rounds: int, first: int = 0) -> Iterator[str]:
    """Names of the records, round by round, each row once with its twins; even rounds are part A, odd ones B."""
    for number in range(first, first + rounds):
        for row in ordinary_design.ROWS:
            yield from (f"ordinary {name}" for name in ordinary_design.names(row, number, SEED))
        for row in loads.ROWS:
            if row != "position":
                yield from (f"loads {row}/{gap}/{FIRST['loads'] + number}" for gap in ("none", "gap"))
        for cell in truth_design.CELLS:
            yield f"truth {cell}/{_truth_number(str(cell), number)}"
        kind = ("PI", "PID")[number // 2 % 2]
        for load in lengths.LOADS:
            yield from (f"lengths {load}/{kind}/{gap}/{FIRST['lengths'] + number}" for gap in ("none", "gap"))


def _truth_number(cell: str, number: int) -> int:
    """The first number of its hundred that is a record."""
    return next(n for n in count(FIRST["truth"] + 100 * number) if truth.record(f"{cell}/{n}") is not None)


def ask(name: str) -> Sample | None:
    """The evidence that today's fit has for a record; None where nothing can be fitted."""
    source, rest = name.split(" ", 1)
    facts, recording = {"ordinary": _ordinary, "loads": _loads, "truth": _truth, "lengths": _lengths}[source](rest)
    begin = process_time()
    try:
        fit = glapp.fit(recording)
    except glapp.InputError:
        return None
    seconds = process_time() - begin
    if "evidence" not in fit.best:
        return None
    return Sample(
        name=name,
        confidence=fit.best["confidence"],
        width=[fit.d, fit.low, fit.high],
        evidence=fit.best["evidence"],
        wider=(fit.weighed or {}).get("wider", []),
        fit=version(),
        seconds=seconds,
        **facts,
    )


def _facts(number: int, d: float, kp: float, sigma: float, h: float, rows: int, lag: float) -> dict[str, Any]:
    return {
        "half": "B" if number % 2 else "A",
        "d": d,
        "seen": d * abs(kp) / max(sigma, 1e-12),
        "nuisances": {"h": h, "rows": float(rows), "lag": lag / h, "length": rows * h / lag},
    }


def of_answers(path: Path) -> Iterator[Sample]:
    """The samples in a file of `bench.ordinary`: of one recording each that could be fitted."""
    for line in read_answers(path):
        if line.recordings == 1 and "evidence" in line.evidence:
            told = line.evidence
            yield Sample(
                name=f"ordinary {line.truth.name}",
                confidence=told["confidence"],
                width=[line.fit.get(name) for name in ("d", "low", "high")],
                evidence=told["evidence"],
                wider=[],
                fit="as stored",
                seconds=line.seconds,
                **_of_ordinary(line.truth),
            )


def _ordinary(name: str) -> tuple[dict[str, Any], glapp.Recording]:
    made = ordinary.record(name)
    return _of_ordinary(made.truth), made.recording


def _of_ordinary(known: ordinary.Truth) -> dict[str, Any]:
    recorders = {"exceptions": "held", "swinging door": "swinging door", "historian": "far apart"}
    return {
        **_facts(known.number, known.d, known.gain, known.sigma, known.h, known.samples, known.lag),
        "half": known.half,
        "row": f"ordinary {known.row}",
        # Twins are left out together: one swings by itself, or is driven as if it did.
        "load": "own cycle" if known.row in ordinary_design.CYCLES else LOADS[known.kind],
        "process": known.service,
        "recorder": recorders.get(known.row, "every row"),
        "friction": "none" if known.fault == "driven" else known.fault,
        "identifiable": known.identifiable,
    }


def _loads(name: str) -> tuple[dict[str, Any], glapp.Recording]:
    made = loads.record(name)
    known = made.truth(loads.SAMPLES)
    row, gap, number = name.split("/")
    recorders = {"swinging door": "swinging door", "recorder shifts": "shifts", "transmitter shifts": "shifts"}
    recorders |= {"outliers": "outliers", "PV filtered": "filtered"}
    return {
        **_facts(int(number), made.d, made.gain, made.sigma, known.h, known.samples, made.lag),
        "row": f"loads {row}",
        "load": LOADS.get(row, "drift"),
        "process": "lags",
        "recorder": recorders.get(row, "every row"),
        "friction": gap,
        "identifiable": known.identifiable,
    }, made.recording(loads.SAMPLES)


def _truth(name: str) -> tuple[dict[str, Any], glapp.Recording]:
    made = truth.record(name)
    assert made is not None
    record, known = made
    number = (int(name.rsplit("/", 1)[1]) - FIRST["truth"]) // 100
    faults = {"backlash": "gap", "stiction": "friction", "both": "both"}
    kept = {"compression": "held", "saturation": "saturated"}
    return {
        **_facts(number, known.d, known.gain, known.sigma, known.h, known.samples, known.lag),
        "row": f"truth {known.load}" if known.load in truth_design.LOADS else "truth oscillation",
        "load": LOADS[known.load],
        "process": known.process,
        "recorder": kept.get(known.departure, "every row"),
        "friction": faults.get(known.cause, "none"),
        "identifiable": known.identifiable,
    }, record.recording


def _lengths(name: str) -> tuple[dict[str, Any], glapp.Recording]:
    made = lengths.made(name, LENGTH)
    load, _, gap, number = name.split("/")
    known = made.truth(LENGTH)
    return {
        **_facts(int(number), made.d, made.gain, made.sigma, known.h, LENGTH, made.lag),
        "row": f"lengths {load}",
        "load": LOADS[load],
        "process": "long",
        "recorder": "every row",
        "friction": gap,
        "identifiable": known.identifiable,
    }, made.recording(LENGTH)


def read(path: Path) -> list[Sample]:
    """All samples of a file."""
    return [Sample.of(text) for text in path.read_text(encoding="utf-8").splitlines()]


def done(path: Path) -> set[str]:
    """Names that a file has; a line that was cut off is taken out of it."""
    if not path.exists():
        return set()
    texts = path.read_text(encoding="utf-8").splitlines(keepends=True)
    if texts and not texts[-1].endswith("\n"):
        texts = texts[:-1]
        path.write_text("".join(texts), encoding="utf-8")
    return {json.loads(text)["name"] for text in texts}
