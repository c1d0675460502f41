"""Before and after a repair: text and table."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING

from .words import number, op_unit, quantity

if TYPE_CHECKING:
    from ..repaired import Between, Difference, Repair, Side

__all__ = ["NOTE", "rows", "text"]

NOTE = (
    "In brackets are 95 % intervals. Up to 7 days before and after count, in automatic. A load that was calmer or "
    "rougher afterwards changes PV and OP too."
)


def text(repair: Repair, unit: str) -> str:
    """Text on a repair that was noted, or on a fall of the width and what to do about it."""
    before, after = repair.before, repair.after
    if repair.noted is not None:
        noted = f"The valve was repaired on {repair.noted:%Y-%m-%d at %H:%M}. The answer is that of the time since."
        return noted if before.begin is not None else f"{noted} Nothing was recorded before."
    return (
        f"The gap fell from {_width(before, unit)} to {_width(after, unit)} between {_moment(before.end)} and "
        f"{_moment(after.begin)}. Was the valve repaired? Then give the time with --repaired, or as repaired in a "
        "loops.toml: the answer is then that of what was recorded since."
    )


def rows(repair: Repair, unit: str, pv_unit: str) -> list[tuple[str, ...]]:
    """The comparison as a table: what, before, after, the difference."""
    sides, op = (repair.before, repair.after), op_unit(unit)
    table: list[tuple[str, ...]] = [("Gap", *(_width(side, unit) for side in sides), _difference(repair.width, op))]
    for name, label, of in (
        ("deviation", "PV about SP, standard deviation", pv_unit),
        ("travel", "Travel of OP in a day", op),
        ("reversals", "Reversals of OP in a day", ""),
    ):
        values = (_between(getattr(side, name), of) for side in sides)
        table.append((label, *values, _difference(getattr(repair, name), of)))
    return [*table, ("Looked at, in automatic", *(_days(side) for side in sides), "")]


def _width(side: Side, unit: str) -> str:
    """Width of one side, as text."""
    unit = op_unit(unit)
    if side.verdict is None:
        return "not judged"
    if side.verdict == "sound" and side.high is not None:
        return f"< {quantity(side.high, unit)}"
    if side.verdict == "at_least" and side.low is not None:
        return f"> {quantity(side.low, unit)}"
    if side.d is not None and side.low is not None and side.high is not None:
        return f"{quantity(side.d, unit)} ({number(side.low)} to {number(side.high)})"
    return str(side.confidence or side.verdict).replace("_", " ")


def _between(value: Between | None, unit: str) -> str:
    if value is None:
        return "–"
    middle, low, high = (float(f"{x:.3g}") for x in value)
    return f"{quantity(middle, unit)} ({number(low)} to {number(high)})"


def _difference(of: Difference | None, unit: str) -> str:
    """A difference, as text."""
    if of is None:
        return "–"
    if of.code == "open":
        return "no plain difference"
    middle, low, high = (abs(float(f"{x:.3g}")) for x in of.by)
    least, most = sorted((low, high))
    return f"{of.code} by {quantity(middle, unit)} ({number(least)} to {number(most)})"


def _days(side: Side) -> str:
    """Length of one side, as text."""
    if side.days is None:
        return "too little"
    return f"{number(side.days)} d" if side.days >= 1.0 else f"{number(24.0 * side.days)} h"


def _moment(at: datetime | float | None) -> str:
    if at is None:
        return "–"
    return f"{at:%Y-%m-%d %H:%M}" if isinstance(at, datetime) else f"{number(at)} s"
