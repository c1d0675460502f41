"""Values of OPC UA as numbers, and its errors as a person reads them."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from asyncua import ua

from ..errors import InputError
from ..loop import Loop
from ..reading.values import mode_flag, text_of

__all__ = ["LostError", "NotANumberError", "as_written", "number_of", "number_reader", "reason"]

_NUMBERS = (int, float)


class LostError(Exception):
    """The connection is of no use any more, and why."""


class NotANumberError(Exception):
    """A value that is no number, and its type."""


def number_reader(loop: Loop, key: str) -> Callable[[Any], float]:
    """Function that reads a tag's value as a number."""
    if key in ("low", "high"):
        return lambda raw: float(_real(raw) != 0.0)
    if key != "mode":
        return _real
    decide = mode_flag(loop.auto_values, frozenset())
    known: dict[Any, float] = {}

    def mode(raw: Any) -> float:
        if isinstance(raw, ua.LocalizedText):
            raw = raw.Text
        if not isinstance(raw, str | int | float) or raw is None:
            raise NotANumberError(f"is a {type(raw).__name__}")
        if raw not in known:
            known[raw] = 0.0 if decide(text_of(raw)) else 1.0
        return known[raw]

    return mode


def _real(raw: Any) -> float:
    if type(raw) is float or isinstance(raw, _NUMBERS):
        value = float(raw)
        if math.isfinite(value):
            return value
        raise NotANumberError("not a finite number")
    raise NotANumberError(f"is a {type(raw).__name__}")


def number_of(seen: ua.DataValue) -> tuple[float, str]:
    """A read value as a number, and why it is not good."""
    if seen.StatusCode is not None and seen.StatusCode.value & 0xC000_0000:
        return math.nan, seen.StatusCode.name
    try:
        return _real(None if seen.Value is None else seen.Value.Value), ""
    except NotANumberError as error:
        return math.nan, str(error)


def as_written(value: float, kind: ua.VariantType) -> float:
    """The value as the node will hold it."""
    if kind is ua.VariantType.Float:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    return value


def reason(error: BaseException) -> str:
    """Reason of a connection's failure, for a person."""
    if isinstance(error, ua.UaStatusCodeError):
        return str(ua.StatusCode(error.code).name)
    if isinstance(error, TimeoutError):
        return "no answer in time"
    if isinstance(error, ConnectionRefusedError):
        return "nobody listens there"
    if isinstance(error, AssertionError):  # asyncua's, where a server refuses the channel that it asks for
        return "the server's answer cannot be read; it may not trust our certificate"
    text = str(error)
    return text if isinstance(error, LostError | InputError) else f"{type(error).__name__}: {text}"
