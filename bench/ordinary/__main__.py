"""Ask about the corpus of ordinary loops, and count the answers: `python -m bench.ordinary`.

Every answer goes, with all its evidence, to one line of a file as soon as it is there; what the file has is not asked
again. `--score FILE` counts the lines of files that are there and fits nothing.

Part A is for choosing rules. Part G (`--half G`, its seed is set) is asked and scored once, when they are chosen; parts
B to F judged before it.
"""

from __future__ import annotations

import os

os.environ.setdefault("RAYON_NUM_THREADS", "1")  # many processes, each with its own core

import argparse
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import get_args

from rich.progress import track

from ..page import write
from .answers import Line, ask, done, read
from .design import CYCLES, ROWS, SEEDS, Half, NoSuchLoopError, half, names
from .score import tables

OUT = Path(__file__).parents[2] / "out" / "ordinary.jsonl"

SEVERAL = (1, 2, 4, 8)
"""Numbers of days of one valve that are asked about together with `--several`."""

WITH_FAULT = (0, 6)
"""Of eight numbers of parts D to G these have all their twins, one of them in and one out of what the fit models; the
others only those without a gap or friction."""


def tasks(rows: list[str], which: str, numbers: int, seed: int, several: bool) -> Iterator[tuple[str, int]]:
    """Tasks, the first numbers of all rows first."""
    wanted = [n for n in range(2 * numbers) if half(n, seed) in which][: numbers * len(which)]
    for number in wanted:
        for row in rows:
            for name in names(row, number, seed):
                sound = name.split("/")[1] in ("none", "driven")
                if several and (row in CYCLES or sound):
                    continue
                if which > "C" and not sound and number % 8 not in WITH_FAULT:
                    continue
                yield from ((name, count) for count in (SEVERAL if several else (1,)))


def main() -> None:
    """Ask, or score."""
    parser = argparse.ArgumentParser(prog="python -m bench.ordinary", description=__doc__.split("\n\n")[0])
    parser.add_argument("--rows", help=f"some of: {', '.join(ROWS)}; all where not given, separated by commas")
    parser.add_argument("--half", choices=("AB", *get_args(Half)), default="A")
    parser.add_argument("--numbers", type=int, default=20, help="so many numbers of each row and half")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--several", action="store_true", help=f"{SEVERAL} days of one valve together, with a gap")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--score", type=Path, nargs="+", help="count what is in these files; fits nothing")
    parser.add_argument("--again", action="store_true", help="judge the stored evidence by the ladder of today")
    parser.add_argument("--docs", action="store_true", help="write the tables into bench/results/truth.md")
    given = parser.parse_args()
    given.seed = SEEDS.get(given.half, given.seed)
    if given.score:
        show([line for path in given.score for line in read(path)], given)
        return
    rows = given.rows.split(",") if given.rows else list(ROWS)
    if unknown := set(rows) - set(ROWS):
        parser.error(f"there is no row {', '.join(sorted(unknown))}; write some of {', '.join(ROWS)}")
    known = done(given.out)
    left = [task for task in tasks(rows, given.half, given.numbers, given.seed, given.several) if task not in known]
    given.out.parent.mkdir(parents=True, exist_ok=True)
    with given.out.open("a", encoding="utf-8") as file:
        for line in track(answers(left, given.jobs), "asking", len(left), disable=not sys.stderr.isatty()):
            print(line.to_json(), file=file, flush=True)
    show(read(given.out), given)


def show(lines: list[Line], given: argparse.Namespace) -> None:
    """Print the tables of the half that is asked for, and put them into the docs where they are to be."""
    text = tables([line for line in lines if line.truth.half in given.half], given.again)
    print(text)
    if given.docs:
        write("truth.md", text, "ordinary")


def answers(left: list[tuple[str, int]], jobs: int) -> Iterator[Line]:
    """Answers as they come; a loop that cannot be drawn is named and left out."""
    with ProcessPoolExecutor(jobs) as pool:
        for future in as_completed([pool.submit(ask, *task) for task in left]):
            try:
                yield future.result()
            except NoSuchLoopError as error:
                print(f"left out, and its twins: {error}", file=sys.stderr)


if __name__ == "__main__":
    main()
