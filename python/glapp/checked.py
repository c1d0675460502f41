"""Settings that are checked when they are made, and refuse in one line."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, ValidationError

from .errors import InputError

__all__ = ["Checked", "check_limits", "check_number", "check_one_of", "check_positive", "nearest", "numbers_of"]

_BOUNDS = {
    "greater_than": ("gt", ">"),
    "greater_than_equal": ("ge", "≥"),
    "less_than": ("lt", "<"),
    "less_than_equal": ("le", "≤"),
}


class Checked(BaseModel):
    """Frozen pydantic model that forbids unknown keys and raises `InputError` instead of a page of text."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def __init__(self, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise _refusal(type(self), error) from None


def check_limits(limits: tuple[float, float], parameter: str | None = None, **place: Any) -> None:
    """Refuse limits or a span of which the lower one is not below the upper one.

    - `place`: further keys of `InputError`.

    Raises InputError where it is not.

    Examples
    --------
    >>> check_limits((65, 45), "op_within")
    Traceback (most recent call last):
    glapp.errors.InputError: op_within: goes from 65 to 45, must be low < high
    """
    low, high = limits
    if not low < high:
        what = f"goes from {low:g} to {high:g}, must be low < high"
        raise InputError(what, parameter=parameter, value=limits, bound="low < high", **place)


def check_positive(value: float, parameter: str | None = None) -> None:
    """Refuse what is not a finite number above 0.

    Raises InputError where it is not.

    Examples
    --------
    >>> check_positive(float("inf"), "minutes")
    Traceback (most recent call last):
    glapp.errors.InputError: minutes: is inf, must be a finite number > 0
    """
    check_number(value, parameter, lambda x: x > 0, "a finite number > 0")


def check_number(value: Any, parameter: str | None, good: Callable[[float], bool], bound: str) -> float:
    """The number, refused where it is none, not finite, or not `good`.

    - `bound`: what is good, in words.

    Raises InputError where it is not.

    Examples
    --------
    >>> check_number(2, "ti", lambda x: x > 0, "greater than 0 s")
    2.0
    >>> check_number("2 s", "ti", lambda x: x > 0, "greater than 0 s")
    Traceback (most recent call last):
    glapp.errors.InputError: ti: is '2 s', must be greater than 0 s
    """
    shown = repr(value)
    if isinstance(value, Real | np.ndarray):
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            pass
        else:
            if math.isfinite(number) and good(number):
                return number
            shown = f"{number:g}"
    raise InputError(f"is {shown}, must be {bound}", parameter=parameter, value=value, bound=bound)


def check_one_of(value: Any, parameter: str, known: Iterable[str]) -> None:
    """Refuse what is none of the known words.

    Raises InputError where it is none.

    Examples
    --------
    >>> check_one_of("PD", "kind", ("PI", "PID"))
    Traceback (most recent call last):
    glapp.errors.InputError: kind: is 'PD', must be 'PI' or 'PID'
    """
    known = list(known)
    if not (isinstance(value, str) and value in known):
        bound = " or ".join(map(repr, known))
        raise InputError(f"is {value!r}, must be {bound}", parameter=parameter, value=value, bound=bound)


def numbers_of(
    values: Any,
    parameter: str,
    bound: str = "finite numbers",
    good: Callable[[npt.NDArray[Any]], npt.NDArray[np.bool_]] | None = None,
    dtype: npt.DTypeLike = np.float64,
) -> npt.NDArray[Any]:
    """An array of finite numbers, each of them `good`.

    - `bound`: what is good, in words.

    Raises InputError where it is none, with the first number that is not good.

    Examples
    --------
    >>> numbers_of([1, 2], "t")
    array([1., 2.])
    >>> numbers_of([1, -2], "a", "greater than 0", lambda x: x > 0)
    Traceback (most recent call last):
    glapp.errors.InputError: a: is -2, must be greater than 0
    """
    try:
        found = np.asarray(values, dtype=dtype)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"is {values!r}, must be {bound}", parameter=parameter, value=values, bound=bound) from None
    right = np.isfinite(found)
    if good is not None:
        right &= good(found)
    if not right.all():
        first = found[~right].flat[0]
        raise InputError(f"is {first:g}, must be {bound}", parameter=parameter, value=values, bound=bound)
    return found


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The known word that `word` most likely meant.

    Examples
    --------
    >>> nearest("pvspan", ["op_span", "pv_span"])
    'pv_span'
    >>> nearest("colour", ["op_span"]) is None
    True
    """
    found = difflib.get_close_matches(word.lower(), list(known), n=1, cutoff=0.6)
    return found[0] if found else None


def _refusal(model: type[BaseModel], error: ValidationError) -> InputError:
    """Turn one of pydantic's findings into our line: key, value, bound."""
    found = error.errors(include_url=False)
    # A misspelt key is not the missing one: the misspelling is reported.
    first = next((fault for fault in found if fault["type"] == "extra_forbidden"), found[0])
    path = [str(p) for p in first["loc"] if not (isinstance(p, str) and ("[" in p or p in {"str", "int", "float"}))]
    inner = first.get("ctx", {}).get("error")
    if isinstance(inner, InputError):
        path += [inner.parameter] if inner.parameter and inner.parameter not in path[-1:] else []
        return InputError(
            inner.what, parameter=".".join(path) or None, value=inner.value, bound=inner.bound, hint=inner.hint
        )
    key, value, kind = ".".join(path) or None, first["input"], first["type"]
    if kind == "extra_forbidden":
        near = nearest(path[-1], model.model_fields)
        known = f"did you mean {near}?" if near else f"known keys: {', '.join(model.model_fields)}"
        return InputError("no such key", parameter=key, value=value, hint=known)
    if kind == "missing":
        return InputError("is required", parameter=key, bound="required")
    if kind in _BOUNDS:
        name, sign = _BOUNDS[kind]
        bound = f"{sign} {first['ctx'][name]:g}"
    elif kind == "literal_error":
        bound = f"one of {first['ctx']['expected']}"
    elif kind == "union_tag_invalid":
        # The place is the whole table; its key that decides and the value there are in the context.
        key, value = f"{key}.{first['ctx']['discriminator'].strip(chr(39))}", first["ctx"]["tag"]
        bound = f"one of {first['ctx']['expected_tags']}"
    elif kind == "finite_number":
        bound = "a finite number"
    elif kind in ("tuple_type", "list_type", "set_type", "frozen_set_type"):
        bound = "a list in brackets: [..., ...]"
    elif kind in ("model_type", "dict_type", "model_attributes_type"):
        bound = "a table in braces: { key = value }"
    else:
        message = first["msg"].removeprefix("Value error, ")
        bound = message[0].lower() + message[1:]
        if bound.startswith("input should be "):
            bound = bound.removeprefix("input should be ")
        else:
            return InputError(f"{bound} (given: {value!r})", parameter=key, value=value, bound=bound)
    return InputError(f"is {value!r}, must be {bound}", parameter=key, value=value, bound=bound)
