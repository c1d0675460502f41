"""Value of more recordings of one valve: `python -m bench.recordings`.

One loop of `bench.loads`, recorded on several days: the same dynamics, controller and valve, another load and noise, a
process gain up to a quarter off. `glapp.fit` is asked about one day, three, and so on. Every answer goes
to out/recordings.jsonl as soon as it is there.
"""

from __future__ import annotations

import os

os.environ.setdefault("RAYON_NUM_THREADS", "1")  # many processes, each with its own core

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, Self

import numpy as np

import glapp

from .asking import answers_of
from .loads.answer import WIDTHS, Outcome, outcome_of
from .loads.records import ROWS, record
from .page import write
from .truth.score import markdown

OUT = Path(__file__).parents[1] / "out" / "recordings.jsonl"

NUMBERS = (1, 3, 6, 12, 24)
"""Recordings of one valve."""

SAMPLES = 750
"""Rows of one; an hour at 5 s has as many."""


@dataclass(frozen=True)
class RecordingAnswer:
    """Answer of `glapp.fit` on so many days of a loop.

    - `name`: that of `bench.loads` without the day.
    - `d_true`: width of the gap [% of OP]; 0 for none.
    - `up`, `down`: traversals of the gap over all days, as in `bench.truth`.
    - `d`, `low`, `high`, `lr`, `needed`: as in `glapp.fit.Fit`.
    - `own`: verdict, d, low and high that each recording gives alone, and what it adds to the likelihood ratio.
    """

    name: str
    days: int
    d_true: float
    up: int
    down: int
    verdict: str
    reason: str
    d: float | None
    low: float | None
    high: float | None
    lr: float | None
    needed: float | None
    own: list[Any]
    seconds: float

    @property
    def outcome(self) -> Outcome:
        """The outcome, by the rules of `bench.loads`."""
        return outcome_of(self.verdict, self.d_true, self.low, self.high)

    @property
    def sided(self) -> bool:
        """Whether the verdict has a width with two limits."""
        return self.verdict in WIDTHS

    @property
    def row(self) -> str:
        """The load or the recorder of a row."""
        return self.name.split("/")[0]

    @classmethod
    def to(cls, name: str, days: int) -> Self:
        """Ask about the first so many days."""
        made = [record(f"{name}/{day}", SAMPLES) for day in range(days)]
        recordings = [of_day.recording(SAMPLES) for of_day in made]
        truths = [of_day.truth(SAMPLES) for of_day in made]
        begin = perf_counter()
        fit = glapp.fit(recordings)
        return cls(
            name=name,
            days=days,
            d_true=made[0].d,
            up=sum(truth.up for truth in truths),
            down=sum(truth.down for truth in truths),
            verdict=fit.verdict,
            reason=fit.reason,
            d=fit.d,
            low=fit.low,
            high=fit.high,
            lr=fit.lr_no_gap,
            needed=fit.lr_needed,
            own=[(r.fit.verdict, r.fit.d, r.fit.low, r.fit.high, r.adds, r.left_out) for r in fit.recordings],
            seconds=perf_counter() - begin,
        )


def ask(asked: tuple[str, int]) -> RecordingAnswer:
    """See `RecordingAnswer.to`."""
    return RecordingAnswer.to(*asked)


def read(path: Path) -> list[RecordingAnswer]:
    """Answers from a file that has one a line."""
    return [RecordingAnswer(**json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]


def table(answers: Sequence[RecordingAnswer]) -> str:
    """A line a row and number of recordings."""
    head = ["row", "recordings", "no gap", "width", "bound", "sound", "gap", "width", "bound", "wrong", "silent"]
    head += ["median error", "interval holds", "median of its length", "seconds"]
    body = []
    for row in [*ROWS, "all"]:
        for days in sorted({answer.days for answer in answers}):
            of = [a for a in answers if row in (a.row, "all") and a.days == days]
            if not of:
                continue
            none, gap = ([a for a in of if (a.d_true > 0) == there] for there in (False, True))
            sided = [a for a in gap if a.sided]
            numbers = [days, len(none), sum(a.sided for a in none), sum(a.verdict == "at_least" for a in none)]
            numbers += [sum(a.verdict == "sound" for a in none), len(gap), len(sided)]
            numbers += [sum(a.verdict == "at_least" for a in gap)]
            numbers += [sum(a.outcome == outcome for a in gap) for outcome in ("wrong", "silent")]
            error = length = ""
            if sided:
                error = f"{100 * np.median([(a.d or 0.0) / a.d_true - 1 for a in sided]):+.1f} %"
                lengths = [((a.high or np.inf) - (a.low or 0.0)) / a.d_true for a in sided]
                length = f"{100 * np.median(lengths):.0f} %"
            holds = f"{sum(a.outcome == 'right' for a in sided)} of {len(sided)}"
            seconds = f"{np.median([a.seconds for a in of]):.1f}"
            body.append([row, *map(str, numbers), error, holds, length, seconds])
    return markdown(head, body)


def main() -> None:
    """Run, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.recordings", description=__doc__.split("\n\n")[0])
    parser.add_argument("--each", type=int, default=10, help="so many valves of each row, without a gap and with one")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--rows", type=lambda text: text.split(","), default=ROWS, help="such as 'walk,steps'")
    parser.add_argument("--gaps", type=lambda text: text.split(","), default=["none", "gap"], help="'none' or 'gap'")
    parser.add_argument(
        "--days", type=lambda text: [int(n) for n in text.split(",")], default=NUMBERS, help="such as '1,3,6'"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, default=OUT, help="where the answers go")
    parser.add_argument("--resume", action="store_true", help="go on with the answers that are there")
    parser.add_argument("--docs", action="store_true", help="write the table into bench/results/truth.md")
    given = parser.parse_args()
    if wrong := set(given.rows) - set(ROWS):
        parser.error(f"{', '.join(sorted(wrong))}: rows are {', '.join(ROWS)}")
    # Numbers outermost: what is broken off has some of every row.
    numbers = range(given.first, given.first + given.each)
    names = [f"{row}/{gap}/{number}" for number in numbers for row in given.rows for gap in given.gaps]
    asked = [(name, days) for name in names for days in given.days]
    given.out.parent.mkdir(exist_ok=True)
    answers = read(given.out) if given.resume and given.out.exists() else []
    known = {(answer.name, answer.days) for answer in answers}
    asked = [one for one in asked if one not in known]
    with given.out.open("a" if known else "w", encoding="utf-8") as file:
        for answer in answers_of(ask, asked, given.jobs):
            answers.append(answer)
            print(json.dumps(asdict(answer)), file=file, flush=True)
    text = table(answers)
    print(text)
    if given.docs:
        write("truth.md", f"Numbers {numbers[0]} to {numbers[-1]} of every row.\n\n{text}", "recordings")


if __name__ == "__main__":
    main()
