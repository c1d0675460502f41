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
    total = (sum(getattr(one, kind) for one in rows) for kind in ("right", "wrong", "silent"))
    return [
        (
            one.confidence.replace("_", " "),
            str(one.right),
            str(one.wrong),
            str(one.silent),
            share_text(one.right, one.wrong),
        )
        for one in (*rows, Count("all", *total))
    ]


def calibration(scored: Sequence[Scored]) -> list[tuple[str, ...]]:
    """Rows of the probabilities: of what, as stated, of how many valves, and the share of those in which it was so."""
    return [
        (PROBABLE[one.of], f"{100 * one.stated:.0f} %", str(one.valves), share_text(one.so, one.valves - one.so))
        for one in calibrated(scored)
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


def workshop(one: Scored) -> str:
    """Finding of the workshop, with the width where it was measured."""
    width = "" if one.width is None else f", {quantity(one.width, op_unit(one.result.unit))}"
    return f"{one.label.found}{width}"
