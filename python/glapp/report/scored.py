"""Answers beside what the workshop found, in words."""

from __future__ import annotations

from ..score import Count, Scored, counted, share
from .words import op_unit, quantity

__all__ = ["PROBABLE", "counts", "share_text", "workshop"]

PROBABLE = {"p_gap": "a dead band", "p_beyond": "one beyond the limit"}
"""What each probability is of."""


def counts(scored: list[Scored]) -> list[Count]:
    """The counts by how sure the answers are, and those of all."""
    rows = counted(scored)
    total = (sum(getattr(one, kind) for one in rows) for kind in ("right", "wrong", "silent"))
    return [*rows, Count("all", *total)]


def share_text(so: int, not_so: int) -> str:
    """A share with its 95 % interval.

    >>> share_text(9, 1)
    '90 % (60 to 98)'
    """
    found = share(so, not_so)
    if found is None:
        return "–"
    low, middle, high = (f"{100 * part:.0f}" for part in found)
    return f"{middle} % ({low} to {high})"


def workshop(one: Scored) -> str:
    """What the workshop found, with the width where it was measured."""
    width = "" if one.width is None else f", {quantity(one.width, op_unit(one.result.unit))}"
    return f"{one.label.found}{width}"
