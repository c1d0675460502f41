"""The figures of the thesis, recomputed (Haventon & Öberg, TFRT-5826, 2008).

Every figure and table of the thesis is a function that computes it, and returns a sentence, our numbers next to the
thesis', where and why they differ, and a picture. `docs/gallery` is all of them.

>>> from glapp_thesis import show
>>> shown = show("1.2")
>>> for number in shown.numbers:
...     print(f"{number.what}: thesis {number.thesis}, here {number.ours:g}")
width between the flanks: thesis 1.0, here 1
"""

from __future__ import annotations

from collections.abc import Callable

from glapp.errors import InputError

from . import chapter1, chapter2, chapter3, chapter4, chapter5, chapter6, chapter7, chapter8
from .figure import Number, Shown

__all__ = ["FIGURES", "Number", "Shown", "find", "show"]

FIGURES: dict[str, Callable[[], Shown]] = {
    **chapter1.FIGURES,
    **chapter2.FIGURES,
    **chapter3.FIGURES,
    **chapter4.FIGURES,
    **chapter5.FIGURES,
    **chapter6.FIGURES,
    **chapter7.FIGURES,
    **chapter8.FIGURES,
}
"""Number in the thesis to the function that computes it, in the thesis' order."""


def find(number: str) -> str:
    """The key in `FIGURES` that a person means.

    - `number`: "8.1" or "Figure 8.1" for a figure, "Table 8.1" for a table; in capitals or not.

    Raises InputError for a figure that is not here.

    Examples
    --------
    >>> find("figure 5.1")
    '5.1'
    """
    wanted = " ".join(number.lower().replace("-", " ").split()).removeprefix("figure ").capitalize()
    if wanted not in FIGURES:
        bound = f"one of {', '.join(FIGURES)}"
        raise InputError(f"is {number!r}, must be {bound}", parameter="number", value=number, bound=bound)
    return wanted


def show(number: str) -> Shown:
    """Compute one figure or table; `number` as `find` takes it."""
    return FIGURES[find(number)]()
