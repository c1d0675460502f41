"""Answers compared with the workshop's findings, in words."""

from __future__ import annotations

from collections.abc import Sequence

from ..score import Count, Scored, calibrated, counted, share
from .words import op_unit, quantity

__all__ = ["calibration", "counts", "share_text", "workshop"]

PROBABLE = {"p_gap": "a dead band", "p_beyond": "one beyond the limit"}
"""Event of each probability."""


def counts(scored: Sequence[Scored]) -> list[tuple[str, ...]]:
    """Rows by confidence, and of all answers: number, right, wrong, silent, the share of right ones."""
    rows = counted(list(scored))
    total = (sum(getattr(row, kind) for row in rows) for kind in ("right", "wrong", "silent"))
    return [
        (
            row.confidence.replace("_", " "),
            str(row.right),
            str(row.wrong),
            str(row.silent),
            share_text(row.right, row.wrong),
        )
        for row in (*rows, Count("all", *total))
    ]


def calibration(scored: Sequence[Scored]) -> list[tuple[str, ...]]:
    """Rows of the probabilities: of what, as stated, of how many valves, and the share of those in which it was so."""
    return [
        (PROBABLE[row.of], f"{100 * row.stated:.0f} %", str(row.valves), share_text(row.so, row.valves - row.so))
        for row in calibrated(scored)
    ]


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


def workshop(valve: Scored) -> str:
    """Finding of the workshop, with the width where it was measured."""
    width = "" if valve.width is None else f", {quantity(valve.width, op_unit(valve.result.unit))}"
    return f"{valve.label.found}{width}"
