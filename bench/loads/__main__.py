"""Which loads and recorders are taken for a gap, and which gaps are told under them: `python -m bench.loads`.

Every answer goes to out/loads.jsonl as soon as it is there. `--against FILE` holds the answers against those in an
older such file, record by record.
"""

from __future__ import annotations

import os

os.environ.setdefault("RAYON_NUM_THREADS", "1")  # many processes, each with its own core

import argparse
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Literal

import numpy as np
from rich.progress import track

import glapp

from ..page import write
from ..truth.score import _markdown
from .records import ROWS, Truth, record

OUT = Path(__file__).parents[2] / "out" / "loads.jsonl"
EACH = 200
WIDTHS = ("backlash", "stiction", "both")
Told = Literal["right", "wrong", "silent"]


@dataclass(frozen=True)
class Answer:
    """What `glapp.analyze` said of a record, through its fit.

    Attributes
    ----------
    truth : Truth
    verdict, reason : str
    d, low, high, lr : float or None
        As in `glapp.fit.Fit`; lr is `lr_no_gap`.
    sinusoidal : bool
        Whether there is a finding that the loop swings in a clean sinusoid, so that it is not backlash.
    seconds : float
    """

    truth: Truth
    verdict: str
    reason: str
    d: float | None
    low: float | None
    high: float | None
    lr: float | None
    sinusoidal: bool
    seconds: float

    @property
    def told(self) -> Told:
        """Right: a width whose interval holds the truth, or a lower bound below it. Wrong: any other claim.

        That there is no gap, or none above a bound, is a claim where there is one; where there is none it is silence.
        """
        d, low, high = self.truth.d, self.low or 0.0, np.inf if self.high is None else self.high
        if self.verdict in WIDTHS:
            return "right" if low <= d <= high and d > 0 else "wrong"
        if self.verdict == "at_least":
            return "right" if low <= d and d > 0 else "wrong"
        denied = self.verdict == "oscillation" or (self.verdict == "sound" and high < d)
        return "wrong" if denied and d > 0 else "silent"

    @property
    def contradicts(self) -> bool:
        """Whether it says at once that the valve is worn and that it is not."""
        return self.sinusoidal and self.verdict in (*WIDTHS, "at_least")

    @property
    def short(self) -> str:
        """The answer on a line."""
        numbers = ["" if x is None else f"{x:.3g}" for x in (self.d, self.low, self.high)]
        return f"{self.verdict} {numbers[0]} ({numbers[1]} to {numbers[2]})"


def ask(name: str) -> Answer:
    """What is said of the record of that name."""
    recording, truth = record(name)
    begin = perf_counter()
    result = glapp.analyze(recording)
    seconds = perf_counter() - begin
    fit = result.fit
    assert fit is not None
    sinusoidal = any(finding.code == "sinusoidal" for finding in result.quality)
    said = (fit.verdict, fit.reason, fit.d, fit.low, fit.high, fit.lr_no_gap)
    return Answer(truth, *said, sinusoidal=sinusoidal, seconds=seconds)


def read(path: Path) -> list[Answer]:
    """Answers from a file."""
    lines = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    return [Answer(Truth(**line.pop("truth")), **line) for line in lines]


def table(answers: Sequence[Answer]) -> str:
    """A line a row."""
    head = ["row", "no gap", "widths", "bounds", "gap", "right", "wrong", "silent", "identifiable", "right", "silent"]
    body = []
    for row in [*ROWS, "all"]:
        of = [answer for answer in answers if row in (answer.truth.row, "all")]
        none, gap = ([a for a in of if (a.truth.d > 0) == there] for there in (False, True))
        known = [a for a in gap if a.truth.identifiable]
        if not of:
            continue
        widths, bounds = (sum(a.verdict in v for a in none) for v in (WIDTHS, ("at_least",)))
        right, wrong, silent = (sum(a.told == told for a in gap) for told in ("right", "wrong", "silent"))
        sided = [a for a in gap if a.verdict in WIDTHS and a.d is not None]
        error = f"{100 * np.median([(a.d or 0.0) / a.truth.d - 1 for a in sided]):+.1f} %" if sided else ""
        held = f"{sum(a.told == 'right' for a in sided)} of {len(sided)}"
        numbers = [len(none), widths, bounds, len(gap), right, wrong, silent, len(known)]
        numbers += [sum(a.told == told for a in known) for told in ("right", "silent")]
        body.append([row, *map(str, numbers), error, held])
    return _markdown([*head, "median error", "interval holds"], body)


def against(before: Sequence[Answer], now: Sequence[Answer]) -> str:
    """What changed for each record that both have."""
    then = {answer.truth.name: answer for answer in before}
    both = [(then[answer.truth.name], answer) for answer in now if answer.truth.name in then]
    changed = [(old, new) for old, new in both if old.told != new.told]
    lines = [f"{len(both)} records are in both; told rightly {_right(o for o, _ in both)}, now {_right(n for _, n in both)}"]
    for row in ROWS:
        of = [(old, new) for old, new in both if old.truth.row == row and old.truth.d > 0]
        lost, gained = (sum((o.told == "right", n.told == "right") == way for o, n in of) for way in ((1, 0), (0, 1)))
        lines.append(f"{row}: {_right(o for o, _ in of)} -> {_right(n for _, n in of)}, lost {lost}, gained {gained}")
    lines += [
        f"{new.truth.name} (d {new.truth.d:.3g}): {old.told} -> {new.told}; {old.short} -> {new.short}; {new.reason}"
        for old, new in sorted(changed, key=lambda pair: (pair[0].told, pair[1].told))
    ]
    return "\n".join(lines)


def _right(answers: object) -> int:
    return sum(answer.told == "right" for answer in answers)  # type: ignore[attr-defined]


def main() -> None:
    """Run, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.loads", description=__doc__.split("\n\n")[0])
    parser.add_argument("--each", type=int, default=EACH, help="so many of each row, without a gap and with one")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--rows", type=lambda text: text.split(","), default=ROWS, help="such as 'walk,steps'")
    parser.add_argument("--gaps", type=lambda text: text.split(","), default=["none", "gap"], help="'none' or 'gap'")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, default=OUT, help="where the answers go")
    parser.add_argument("--against", type=Path, help="older answers")
    parser.add_argument("--docs", action="store_true", help="write the table into docs/truth.md")
    given = parser.parse_args()
    if wrong := set(given.rows) - set(ROWS):
        parser.error(f"{', '.join(sorted(wrong))}: rows are {', '.join(ROWS)}")
    # Numbers outermost: what is broken off has some of every row.
    numbers = range(given.first, given.first + given.each)
    names = [f"{row}/{gap}/{number}" for number in numbers for row in given.rows for gap in given.gaps]
    given.out.parent.mkdir(exist_ok=True)
    answers = []
    with ProcessPoolExecutor(given.jobs) as pool, given.out.open("w", encoding="utf-8") as file:
        for answer in track(pool.map(ask, names), "asking", len(names), disable=not sys.stderr.isatty()):
            answers.append(answer)
            print(json.dumps(asdict(answer)), file=file, flush=True)
    text = table(answers)
    print(text)
    print(f"\n{sum(a.contradicts for a in answers)} claim a gap beside the finding that it is none (sinusoidal)")
    if given.against is not None:
        print(f"\n{against(read(given.against), answers)}")
    if given.docs:
        write("truth.md", f"Numbers {numbers[0]} to {numbers[-1]} of every row.\n\n{text}", "loads")


if __name__ == "__main__":
    main()
