"""Number of records that each method decides, rightly and wrongly: `python -m bench.truth.deciders FILE`.

FILE has the lines of `python -m bench.weigh`. The records of bench.truth among them are made again, and all methods but
the fit are asked about them. What the fit says follows from its stored evidence by the ladder of today, so that no
record is fitted anew: once what it finds, and once what it finds or calls likely.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

from glapp import _glapp

from ..page import write
from ..weigh.samples import Sample, read
from .answer import MethodAnswer
from .methods import METHODS, answer_of
from .records import record
from .score import Scored, decided

SOURCE = "truth "

CLAIMS = {"fit, found": ("found",), "fit, found or likely": ("found", "likely")}


def of_fit(sample: Sample, claims: tuple[str, ...]) -> MethodAnswer:
    """Judgement of today's ladder on the stored evidence."""
    judgement = _glapp.fit_judgement(json.dumps(sample.evidence))  # type: ignore[attr-defined]
    if judgement["confidence"] in claims:
        return MethodAnswer("at_least" if judgement["width_kind"] == "bound" else "backlash")
    if judgement["confidence"] == "none_seen":
        return MethodAnswer("sound", high=sample.width[2])
    return MethodAnswer("cannot_tell")


def asked(samples: list[Sample]) -> Iterator[Scored]:
    """Answers of each method on the records of bench.truth among the samples."""
    for sample in samples:
        if not sample.name.startswith(SOURCE):
            continue
        made = record(sample.name.removeprefix(SOURCE))
        assert made is not None
        of, truth = made
        answers = {name: of_fit(sample, claims) for name, claims in CLAIMS.items()}
        answers |= {name: answer_of(name, of) for name in METHODS if not name.startswith("fit")}
        for name, answer in answers.items():
            yield Scored(
                truth, name, answer.verdict, answer.d, answer.low, answer.high, answer.at_least, answer.reason, 0.0
            )


def main() -> None:
    """Ask, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.truth.deciders", description=__doc__.split("\n\n")[0])
    parser.add_argument("evidence", type=Path, help="lines of python -m bench.weigh")
    parser.add_argument("--docs", action="store_true", help="write the table into bench/results/truth.md")
    given = parser.parse_args()
    scored = list(asked(read(given.evidence)))
    text = decided(scored, list(dict.fromkeys(row.method for row in scored)))
    print(text)
    if given.docs:
        write("truth.md", text, "deciders")


if __name__ == "__main__":
    main()
