"""Answers where few samples lie in a process' lag: `python -m bench.loads.sparse`.

The loops are those of `bench.loads`, longer, and only every r-th row is recorded: 0.4 to 5 of them in a lag.
"""

from __future__ import annotations

import os

os.environ.setdefault("RAYON_NUM_THREADS", "1")  # many processes, each with its own core

import argparse
from dataclasses import replace
from random import Random

from ..asking import answers_of
from ..truth.design import log_uniform
from ..truth.score import markdown
from .answer import COUNTED, LoadsAnswer, counted
from .records import LOADS, Record, record

SAMPLES = 1000
BORDERS = (1.0, 2.5, 5.0)
"""Samples in a lag, below which a line of the table lies."""


def sparse(name: str) -> Record:
    """Every r-th row of the record of that name."""
    row, _, number = name.split("/")
    in_lag = log_uniform(Random(f"coarse/{row}/{number}"), 0.4, 5.0)
    every = max(2, round(record(name, 10).lag / in_lag))
    whole = record(name, SAMPLES * every)
    return replace(
        whole,
        table=whole.table.take(list(range(0, SAMPLES * every, every))),
        op=whole.op[::every],
        position=whole.position[::every],
    )


def ask(name: str) -> tuple[float, LoadsAnswer]:
    """Number of samples in the lag, and the answer."""
    record = sparse(name)
    return record.lag / record.truth(SAMPLES).h, LoadsAnswer.to(record, SAMPLES)


def table(answers: list[tuple[float, LoadsAnswer]]) -> str:
    """A line for each range of samples in a lag."""
    body, low = [], 0.0
    for high in BORDERS:
        selected = [answer for lag, answer in answers if low <= lag < high]
        body.append([f"{low:g} to {high:g}", *map(str, counted(selected))])
        low = high
    return markdown(["samples in a lag", *COUNTED], body)


def main() -> None:
    """Run, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.loads.sparse", description=__doc__.split("\n\n")[0])
    parser.add_argument("--each", type=int, default=20, help="so many of each load, without a gap and with one")
    parser.add_argument("--first", type=int, default=330, help="number of the first")
    given = parser.parse_args()
    numbers = range(given.first, given.first + given.each)
    names = [f"{row}/{gap}/{number}" for number in numbers for row in LOADS for gap in ("none", "gap")]
    answers = list(answers_of(ask, names, 2))
    for _, answer in answers:
        if not answer.holds:
            print(answer.truth.name, answer)
    print(table(answers))


if __name__ == "__main__":
    main()
