"""A plan of tests in words: the question, the limits, and each test with its moves, its minutes and its power."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .words import number, op_unit

if TYPE_CHECKING:
    from ..planned import Limits, Plan, Planned

__all__ = ["KINDS", "limits", "question", "rows", "text"]

KINDS = {"by_hand": "OP by hand", "setpoint": "Setpoint steps", "more_hours": "More hours"}
"""Name of each kind of test."""


def question(plan: Plan) -> str:
    """Question that the test would decide."""
    return f"Is there a gap of {number(plan.width)} {op_unit(plan.unit)}?"


def limits(plan: Plan) -> str:
    """The limits that a person gave."""
    op, pv = f"{_within(plan.op_within)} {op_unit(plan.unit)}", f"{_within(plan.pv_within)} {plan.pv_unit}"
    return f"OP within {op}, PV within {pv}, at most {plan.within:g} min"


def rows(plan: Plan) -> list[tuple[str, str]]:
    """The plan as a table: the question, the limits, each test."""
    if plan.reason is not None:
        return [("No plan", f"{plan.reason}.")]
    tests = [(KINDS[test.kind], text(test, plan)) for test in plan.tests]
    return [("Question", question(plan)), ("Limits", f"{limits(plan)}."), *tests]


def text(test: Planned, plan: Plan) -> str:
    """One test: what to do, how long it takes, how far PV goes, and how often it decides; or why it is refused."""
    if test.power is None or test.minutes is None:
        return f"No: {test.reason}."
    if test.kind == "more_hours":
        more = f"{number(test.minutes / 60)} h" if test.minutes > 120 else f"{test.minutes:.0f} min"
        return (
            f"{more} more of the same operation would show the gap in {_share(test.power)} of cases, if there is one."
        )
    assert test.hold is not None
    what, unit = ("OP", op_unit(plan.unit)) if test.kind == "by_hand" else ("SP", plan.pv_unit)
    sentences = f"{what} {_moves(test.moves)} {unit}, {_time(test.hold)} each, {number(test.minutes)} min in all. "
    if test.pv is not None and test.op is not None:
        sentences += f"PV stays within {_within(test.pv)} {plan.pv_unit}"
        sentences += ". " if test.kind == "by_hand" else f", OP within {_within(test.op)} {op_unit(plan.unit)}. "
    return sentences + (
        f"It decides in {_share(test.power)}: it shows the gap in {_share(test.with_gap)} and its absence in "
        f"{_share(test.without)}, after {test.simulations} simulations of each."
    )


def _moves(moves: Sequence[float]) -> str:
    """The moves; a repeated pattern is listed once.

    >>> _moves((50.0, 52.0, 54.0, 52.0)), _moves((50.0, 52.0, 50.0, 52.0, 50.0, 52.0, 50.0))
    ('50 → 52 → 54 → 52', '50 → 52 → 50, three times,')
    """
    first, rest = moves[0], moves[1:]
    for size in (2, 4):
        times = len(rest) // size
        if 1 < times < len(_TIMES) and tuple(rest) == tuple(rest[:size]) * times:
            return f"{' → '.join(number(x, 4) for x in (first, *rest[:size]))}, {_TIMES[times]},"
    return " → ".join(number(x, 4) for x in moves)


_TIMES = ("", "once", "twice", "three times", "four times", "five times")


def _share(of: float | None) -> str:
    return "–" if of is None else f"{100 * of:.0f} %"


def _within(of: Limits) -> str:
    return f"{number(of[0], 4)} to {number(of[1], 4)}"


def _time(seconds: float) -> str:
    return f"{number(seconds / 60)} min" if seconds >= 60 else f"{number(seconds)} s"
