"""The methods, each in a file of its own with its source, what it needs and what it was made for."""

from __future__ import annotations

from collections.abc import Callable

from glapp.errors import InputError

from ..answer import MethodAnswer
from ..records import Record
from . import ellipse, fit, haegglund, he, horch, slope, thesis, yamashita

METHODS: dict[str, Callable[[Record], MethodAnswer]] = {
    "fit": fit.answer,
    "fit, found or likely": fit.likely,
    "thesis": thesis.answer,
    "Hägglund": haegglund.answer,
    "ellipse": ellipse.answer,
    "He": he.answer,
    "Horch": horch.answer,
    "Yamashita": yamashita.answer,
    "slope ratio": slope.answer,
}
"""Methods in the order of the tables."""


def answer_of(method: str, of: Record) -> MethodAnswer:
    """Answer of a method of `METHODS` on a record; where it refuses the record, that it cannot tell, and why."""
    try:
        return METHODS[method](of)
    except InputError as error:
        return MethodAnswer("cannot_tell", reason=str(error))
