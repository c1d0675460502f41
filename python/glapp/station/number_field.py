"""A field for a number, typed with a decimal point or a decimal comma.

A browser's own number field drops the comma where its language is English: a typed 1,5 becomes 15, without a word. It
also counts up and down as the wheel of the mouse turns over it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

from nicegui import ui

from ..errors import InputError

__all__ = ["NumberField", "typed_number"]

_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")


def typed_number(text: str | None) -> float | None:
    """The number that a person typed; None where there is nothing.

    - `text`: what stands in the field.

    Raises InputError where it is no number, or where its comma may part thousands.

    Examples
    --------
    >>> typed_number("1,5"), typed_number("1.5"), typed_number(" ")
    (1.5, 1.5, None)
    >>> typed_number("1,500")
    Traceback (most recent call last):
    glapp.errors.InputError: '1,500' may be 1.500 or 1500; write one of them
    """
    plain = (text or "").strip().replace("\N{MINUS SIGN}", "-")
    if not plain:
        return None
    if _THOUSANDS.fullmatch(plain):
        either = f"{plain.replace(',', '.')} or {plain.replace(',', '')}"
        raise InputError(f"{plain!r} may be {either}", value=plain, hint="write one of them")
    value = float(plain.replace(",", ".")) if _NUMBER.fullmatch(plain) else math.nan
    if not math.isfinite(value):
        raise InputError(f"{plain!r} is no number", value=plain, hint="write one such as 1.5")
    return value


def _fault(text: str | None) -> str | None:
    """Why a typed text cannot be used; None where it can."""
    try:
        typed_number(text)
    except InputError as error:
        return str(error)
    return None


class NumberField(ui.input):
    """A field with a number; below it stands why a text in it is none.

    - `label`: its label; "" where it stands elsewhere.
    - `value`: at first; None for an empty field.
    - `name`: for those who do not see it.
    - `width`: [px]
    - `on_change`: called when a person has typed.
    """

    def __init__(
        self,
        label: str,
        value: float | None,
        *,
        name: str,
        width: int,
        on_change: Callable[[], Any] | None = None,
    ) -> None:
        self.name = name
        handler = None if on_change is None else lambda: on_change()
        super().__init__(label or None, value=_text(value), on_change=handler, validation=_fault)
        self.props(f'dense outlined hide-bottom-space inputmode=decimal autocomplete=off aria-label="{name}"')
        self.style(f"width: {width}px")

    @property
    def number(self) -> float | None:
        """The typed number; None where the field is empty.

        Raises InputError where it is none, or may be two.
        """
        try:
            return typed_number(self.value)
        except InputError as error:
            error.parameter = self.name
            raise

    @property
    def fault(self) -> str | None:
        """Why what stands in the field now is no number; None where it is one, or empty."""
        return _fault(self.value)

    def show(self, value: float) -> None:
        """Put a number into the field."""
        self.set_value(_text(value))


def _text(value: float | None) -> str:
    """A number as it stands in a field, with all its digits: what nobody changes is read as it was.

    >>> _text(2.0), _text(0.1), _text(None)
    ('2', '0.1', '')
    """
    return "" if value is None else repr(float(value)).removesuffix(".0")
