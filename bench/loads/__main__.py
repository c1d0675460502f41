"""False gaps under loads and recorders, and gaps told under them: `python -m bench.loads`.

Every answer goes to out/loads.jsonl as soon as it is there. `--against FILE` holds the answers against those in an
older such file, record by record.
"""

from __future__ import annotations

import os

os.environ.setdefault("RAYON_NUM_THREADS", "1")  # many processes, each with its own core

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..asking import answers_of
from ..page import write
from ..truth.score import markdown
from .answer import COUNTED, LoadsAnswer, against, counted, read
from .records import ROWS, SAMPLES, record

OUT = Path(__file__).parents[2] / "out" / "loads.jsonl"
EACH = 200


def ask(name: str) -> LoadsAnswer:
    """Answer on the record of that name."""
    return LoadsAnswer.to(record(name), SAMPLES)


def table(answers: Sequence[LoadsAnswer]) -> str:
    """A line a row."""
    head = ["row", *COUNTED, "identifiable", "right", "silent"]
    body = []
    for row in [*ROWS, "all"]:
        selected = [answer for answer in answers if row in (answer.truth.row, "all")]
        if not selected:
            continue
        gap = [a for a in selected if a.truth.d > 0]
        known = [a for a in gap if a.truth.identifiable]
        sided = [a for a in gap if a.sided]
        numbers = [
            *counted(selected),
            len(known),
            *(sum(a.outcome == outcome for a in known) for outcome in ("right", "silent")),
        ]
        error = f"{100 * np.median([(a.d or 0.0) / a.truth.d - 1 for a in sided]):+.1f} %" if sided else ""
        body.append([row, *map(str, numbers), error, f"{sum(a.holds for a in sided)} of {len(sided)}"])
    return markdown([*head, "median error", "interval holds"], body)


def main() -> None:
    """Run, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.loads", description=__doc__.split("\n\n")[0])
    parser.add_argument("--each", type=int, default=EACH, help="so many of each row, without a gap and with one")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--rows", type=lambda text: text.split(","), default=ROWS, help="such as 'walk,steps'")
    parser.add_argument("--gaps", type=lambda text: text.split(","), default=["none", "gap"], help="'none' or 'gap'")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, default=OUT, help="where the answers go")
    parser.add_argument("--resume", action="store_true", help="go on with the answers that are there")
    parser.add_argument("--against", type=Path, help="older answers")
    parser.add_argument("--docs", action="store_true", help="write the table into bench/results/truth.md")
    given = parser.parse_args()
    if wrong := set(given.rows) - set(ROWS):
        parser.error(f"{', '.join(sorted(wrong))}: rows are {', '.join(ROWS)}")
    # Numbers outermost: what is broken off has some of every row.
    numbers = range(given.first, given.first + given.each)
    names = [f"{row}/{gap}/{number}" for number in numbers for row in given.rows for gap in given.gaps]
    before = [] if given.against is None else read(given.against)
    given.out.parent.mkdir(exist_ok=True)
    answers = read(given.out) if given.resume and given.out.exists() else []
    known = {answer.truth.name for answer in answers}
    names = [name for name in names if name not in known]
    with given.out.open("a" if known else "w", encoding="utf-8") as file:
        for answer in answers_of(ask, names, given.jobs):
            answers.append(answer)
            print(answer.to_json(), file=file, flush=True)
    text = table(answers)
    print(text)
    print(f"\n{sum(a.contradicts for a in answers)} claim a gap beside the finding that it is none (sinusoidal)")
    if given.against is not None:
        print(f"\n{against(before, answers)}")
    if given.docs:
        write("truth.md", f"Numbers {numbers[0]} to {numbers[-1]} of every row.\n\n{text}", "loads")


if __name__ == "__main__":
    main()
