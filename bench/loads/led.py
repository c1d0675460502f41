"""Answers under loads that swing where the setpoint moves: `python -m bench.loads.led`.

The loops are those rows of `bench.loads` in which OP swings evenly; the setpoint steps, or walks as in a cascade.
"""

from __future__ import annotations

import os

os.environ.setdefault("RAYON_NUM_THREADS", "1")  # many processes, each with its own core

import argparse
import math
from random import Random

import numpy as np

from glapp.scenario import Piece, Samples, Steps

from ..asking import answers_of
from ..truth.design import log_uniform
from ..truth.score import markdown
from .answer import COUNTED, LoadsAnswer, counted
from .records import LOADS, SAMPLES, H, Record, record

ROWS = [row for row in LOADS if row not in ("walk", "steps", "random ramps", "slow ramps")]
MOVES = ("steps", "cascade")


def led(name: str) -> Record:
    """The record of that name, whose last part is how the setpoint moves."""
    name, _, how = name.rpartition("/")
    random = Random(f"led/{name}/{how}")

    def moves(kp: float) -> Piece:
        """Moves of the setpoint in units of OP, by `how`, times Kp."""
        size, end = random.uniform(1.0, 10.0) * kp, SAMPLES * H
        if how == "steps":
            every, steps = log_uniform(random, 100.0, 600.0), [(0.0, 50.0 * kp)]
            while steps[-1][0] < end:
                steps.append((steps[-1][0] + random.uniform(0.5, 1.5) * every, 50.0 * kp + random.uniform(-size, size)))
            return Steps(steps=tuple(steps))
        tau, x, values = log_uniform(random, 10.0, 100.0), 0.0, []
        for _ in range(SAMPLES):
            x += -x * H / tau + 0.5 * size * math.sqrt(2 * H / tau) * random.gauss(0.0, 1.0)
            values.append(50.0 * kp + x)
        return Samples(values=np.array(values))

    return record(name, SAMPLES, moves)


def ask(name: str) -> LoadsAnswer:
    """Answers on a record."""
    return LoadsAnswer.to(led(name), SAMPLES)


def table(answers: dict[str, LoadsAnswer]) -> str:
    """A line for each load."""
    body = []
    for row in [*ROWS, "all"]:
        selected = [answer for name, answer in answers.items() if row in ("all", name.split("/")[0])]
        body.append([row, *map(str, counted(selected))])
    return markdown(["load", *COUNTED], body)


def main() -> None:
    """Run, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.loads.led", description=__doc__.split("\n\n")[0])
    parser.add_argument("--each", type=int, default=12, help="so many of each load, without a gap and with one")
    parser.add_argument("--first", type=int, default=12, help="number of the first")
    given = parser.parse_args()
    numbers = range(given.first, given.first + given.each)
    names = [f"{row}/{gap}/{n}/{how}" for n in numbers for row in ROWS for gap in ("none", "gap") for how in MOVES]
    answers = dict(zip(names, answers_of(ask, names, 2), strict=True))
    for name, answer in answers.items():
        if answer.outcome == "wrong":
            print(name, answer)
    print(table(answers))


if __name__ == "__main__":
    main()
