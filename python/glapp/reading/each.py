"""Many loops, each on its own: an error takes the place of the loop it belongs to, and the others go on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from ..errors import InputError, unforeseen
from ..loop import Loop

__all__ = ["all_or_none", "each"]

T = TypeVar("T")


def each(loops: Sequence[Loop], make: Callable[[Loop], T], file: str) -> list[T | InputError]:
    """Results of `make` for every loop, or the error it raises; among several loops an error names its own."""
    made: list[T | InputError] = []
    for loop in loops:
        try:
            made.append(make(loop))
        except InputError as error:
            if len(loops) > 1:
                error.loop = loop.name
            made.append(error)
        except Exception as error:
            made.append(unforeseen(error, file, loop.name))
    return made


def all_or_none(items: Sequence[T | InputError]) -> list[T]:
    """The items, where none of them is an error; the first error is raised.

    Examples
    --------
    >>> all_or_none([1, InputError("has no rows", file="a.csv")])
    Traceback (most recent call last):
    glapp.errors.InputError: a.csv: has no rows
    """
    good = []
    for item in items:
        if isinstance(item, InputError):
            raise item
        good.append(item)
    return good
