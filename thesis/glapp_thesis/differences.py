"""Statements of the thesis that do not hold in general, each with the number of a figure that shows it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from .figure import Number, Shown

__all__ = ["DIFFERENCES", "Difference", "shown_by"]


class Difference(NamedTuple):
    """A statement, its section, and where it is put to the test.

    - `section`: of the thesis.
    - `statement`: in our words.
    - `number`: figure or table, a key of `FIGURES`.
    - `what`: which of its numbers.
    """

    section: str
    statement: str
    number: str
    what: str


DIFFERENCES = (
    Difference("4.1", "T is the time of 63 % of the step response (for P2 that makes 4.35 s)", "4.1", "T"),
    Difference("7.2.1", "the Kp part never exceeds 10 % of the rest", "7.4", "highest of all"),
    Difference(
        "7.2.3", "no value of Kp makes the estimate of a 5 % gap too high", "7.5", "P3: highest of all seeds and gains"
    ),
    Difference("7.4", "four equally long half-periods warn of over-compensation", "7.11", "false warnings, Ms 1.4"),
    Difference(
        "7.5",
        "the derivative part is below 10 % of Δu, and of either sign",
        "Table 8.1",
        "AMIGO step PID: derivative part by Δu, median",
    ),
    Difference(
        "8.1",
        "no estimate is above the gap",
        "8.1",
        "processes with a median above the gap by more than 0.1 %",
    ),
    Difference(
        "8.2",
        "a longer filter lets a sluggish loop show its gap of 5 %",
        "8.2",
        "estimate with Tf = Ti/2 in the detector",
    ),
    Difference("8.3.1", "in an inner loop the gap is found", "8.5", "fast outer loop: detections in 1000 s"),
    Difference(
        "8.3.2",
        "in an outer loop an estimate of the 5 % gap before it is impossible",
        "8.6",
        "estimate in the outer loop, median of 20 seeds",
    ),
    Difference(
        "8.4.1",
        "with Tf = 2Ti dead time is no obstacle to a gap of 5 %",
        "8.10",
        "P2, L = 1 s: estimate, median of 20 seeds",
    ),
)


def shown_by(shown: Sequence[Shown]) -> Iterator[tuple[Difference, Shown, Number]]:
    """Each difference whose figure is among these, with the figure and its number."""
    by_number = {one.number: one for one in shown}
    for difference in DIFFERENCES:
        if difference.number in by_number:
            one = by_number[difference.number]
            yield difference, one, next(x for x in one.numbers if x.what == difference.what)
