"""A figure of the thesis: one sentence, numbers next to the thesis', and a picture."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Number", "Shown", "anchor", "name"]

SAME, NEAR, ZERO = 0.1, 0.2, 1e-9
"""Relative difference within which a number is that of the thesis, or near it; what counts as zero."""

_WORDS: tuple[tuple[str, Callable[[float, float], bool]], ...] = (
    (r"(?:near|about) (\S+)", lambda ours, x: math.isclose(ours, x, rel_tol=NEAR)),
    (r"below (\S+)(?: or none)?", lambda ours, x: ours < x),
    (r"(?:above|over) (\S+)", lambda ours, x: ours > x),
    (r"within (\S+)", lambda ours, x: abs(ours) <= x),
    (r"(\S+) or more", lambda ours, x: ours >= x),
    ("some", lambda ours, _: ours > 0),
    ("several", lambda ours, _: ours > 1),
    ("none", lambda *_: False),
)


@dataclass(frozen=True, slots=True)
class Number:
    """A number that a figure or a table shows.

    - `what`: what it is; a figure has each of them once.
    - `unit`: "" for a pure number.
    - `thesis`: what the thesis says: a number, words such as "over 100", or None where it gives nothing.
    - `ours`: what glapp computes; None where there is nothing to show, such as an estimate without a detection.
    - `tolerance`: relative difference that a run on another machine may have. Simulations give the same bits
      everywhere; a larger one has its reason next to it.
    - `holds`: whether the thesis' words hold, where other numbers than this one decide it.

    Examples
    --------
    >>> number = Number("estimate", "%", thesis=1.8, ours=1.75)
    >>> number.agrees(1.75), number.agrees(1.8), number.agrees(None)
    (True, False, False)
    >>> number.same, Number("estimate", "%", thesis="below 5", ours=6.2).same, Number("gap", "%", None, 5.0).same
    (True, False, None)
    """

    what: str
    unit: str
    thesis: float | str | None
    ours: float | None
    tolerance: float = 1e-6
    holds: bool | None = None

    @property
    def same(self) -> bool | None:
        """Whether our number agrees with the thesis; None where it says nothing.

        A number is the same within `SAME`, or as a zero within `ZERO`; "near 5" and "about 5" within `NEAR`. Other
        words mean what they say: below, above, over, within (either sign), some (more than none), several (more than
        one), or more, none.

        Raises ValueError for words that are none of these, where `holds` does not decide.
        """
        if self.holds is not None or self.thesis is None:
            return self.holds
        if isinstance(self.thesis, float):
            if self.ours is None:
                return False
            return math.isclose(self.ours, self.thesis, rel_tol=SAME, abs_tol=ZERO)
        if self.ours is None:
            return "none" in self.thesis
        for words, meaning in _WORDS:
            if match := re.fullmatch(words, self.thesis):
                return meaning(self.ours, float(match[1]) if match.groups() else math.nan)
        raise ValueError(f"{self.what}: nobody decides whether {self.ours:g} is {self.thesis!r}")

    def agrees(self, recorded: float | None) -> bool:
        """Whether `recorded`, from an earlier run, is the same within the tolerance."""
        if self.ours is None or recorded is None:
            return self.ours is recorded
        return math.isclose(self.ours, recorded, rel_tol=self.tolerance, abs_tol=1e-12)


def name(number: str) -> str:
    """Full name of a figure or table.

    >>> name("8.1"), name("Table 8.1")
    ('Figure 8.1', 'Table 8.1')
    """
    return number if number.startswith("Table") else f"Figure {number}"


def anchor(number: str) -> str:
    """Name of a figure or table in links and in the name of its picture.

    >>> anchor("8.1"), anchor("Table 8.1")
    ('figure-8.1', 'table-8.1')
    """
    return name(number).lower().replace(" ", "-")


@dataclass(frozen=True, slots=True)
class Shown:
    """A figure or table of the thesis, recomputed.

    - `number`: as in the thesis: "8.1", "Table 8.1".
    - `title`: what it is about, in a few words.
    - `section`: section of the thesis.
    - `sentence`: what is seen, in one sentence.
    - `numbers`: ours next to the thesis'.
    - `difference`: where and why it differs from the thesis, what had to be assumed; "" where there is nothing to say.
    - `draw`: makes the picture.
    - `why`: in a few words why it differs, where a number is not the thesis'; "" where all are.
    """

    number: str
    title: str
    section: str
    sentence: str
    numbers: tuple[Number, ...]
    difference: str
    draw: Callable[[], Figure]
    why: str = ""

    @property
    def same(self) -> bool:
        """Whether every number is the thesis' of which it says anything."""
        return all(number.same is not False for number in self.numbers)

    @property
    def name(self) -> str:
        """Full name: "Figure 8.1", "Table 8.1"."""
        return name(self.number)

    @property
    def anchor(self) -> str:
        """Its name in links."""
        return anchor(self.number)

    @property
    def picture(self) -> str:
        """File name of its picture."""
        return f"{self.anchor}.png"
