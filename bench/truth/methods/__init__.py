"""The methods, each in a file of its own with its source, what it needs and what it was made for."""

from __future__ import annotations

from collections.abc import Callable

from ..answer import MethodAnswer
from ..records import Record
from . import ellipse, fit, haegglund, he, horch, slope, thesis, yamashita

METHODS: dict[str, Callable[[Record], MethodAnswer]] = {
    "fit": fit.answer,
    "thesis": thesis.answer,
    "Hägglund": haegglund.answer,
    "ellipse": ellipse.answer,
    "He": he.answer,
    "Horch": horch.answer,
    "Yamashita": yamashita.answer,
    "slope ratio": slope.answer,
}
"""In the order of the tables."""
