"""What a figure of the thesis is here: one sentence, numbers beside the thesis', and a picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Number", "Shown"]


@dataclass(frozen=True, slots=True)
class Number:
    """A number that a figure or a table shows.

    Attributes
    ----------
    what : str
        What it is; a figure has each of them once.
    unit : str
        "" for a pure number.
    thesis : float, str or None
        What the thesis says: a number, words such as "over 100", or None where it gives nothing.
    ours : float or None
        What glapp computes; None where there is nothing to show, such as an estimate without a detection.
    tolerance : float
        Relative difference that a run on another machine may have. Simulations give the same bits everywhere; a larger
        one has its reason beside it.

    Examples
    --------
    >>> number = Number("estimate", "%", thesis=1.8, ours=1.75)
    >>> number.agrees(1.75), number.agrees(1.8), number.agrees(None)
    (True, False, False)
    """

    what: str
    unit: str
    thesis: float | str | None
    ours: float | None
    tolerance: float = 1e-6

    def agrees(self, recorded: float | None) -> bool:
        """Whether `recorded`, from an earlier run, is the same within the tolerance."""
        if self.ours is None or recorded is None:
            return self.ours is recorded
        return math.isclose(self.ours, recorded, rel_tol=self.tolerance, abs_tol=1e-12)


@dataclass(frozen=True, slots=True)
class Shown:
    """A figure or table of the thesis, computed anew.

    Attributes
    ----------
    number : str
        As in the thesis: "8.1", "Table 8.1".
    title : str
        What it is about, in a few words.
    section : str
        Section of the thesis.
    sentence : str
        What is seen, in one sentence.
    numbers : tuple of Number
        Ours beside the thesis'.
    difference : str
        Where and why it differs from the thesis, what had to be assumed; "" where there is nothing to say.
    draw : callable
        Makes the picture.
    """

    number: str
    title: str
    section: str
    sentence: str
    numbers: tuple[Number, ...]
    difference: str
    draw: Callable[[], Figure]

    @property
    def name(self) -> str:
        """In full: "Figure 8.1", "Table 8.1"."""
        return self.number if self.number.startswith("Table") else f"Figure {self.number}"

    @property
    def picture(self) -> str:
        """File name of its picture."""
        return self.name.lower().replace(" ", "-") + ".png"
