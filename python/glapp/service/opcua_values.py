"""Values of OPC UA as numbers, and its errors as a person reads them."""

from __future__ import annotations

import math
import socket
import struct
from collections.abc import Callable
from typing import Any

from asyncua import ua

from ..errors import InputError
from ..loop import Loop
from ..reading.values import mode_flag, text_of

__all__ = [
    "LostError",
    "NotANumberError",
    "as_written",
    "number_of",
    "number_reader",
    "reason",
    "span_of",
    "status_text",
    "unit_of",
]

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
            raise NotANumberError(_no_number(raw))
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
    raise NotANumberError(_no_number(raw))


def _no_number(raw: Any) -> str:
    """What a value is that is no number.

    >>> _no_number("12.5"), _no_number([1.0])
    ('text, no number', 'list, no number')
    """
    return f"{'text' if isinstance(raw, str) else type(raw).__name__}, no number"


def number_of(seen: ua.DataValue) -> tuple[float, str]:
    """A read value as a number, and why it is not good."""
    if seen.StatusCode is not None and seen.StatusCode.value & 0xC000_0000:
        return math.nan, status_text(seen.StatusCode)
    try:
        return _real(None if seen.Value is None else seen.Value.Value), ""
    except NotANumberError as error:
        return math.nan, str(error)


def span_of(raw: Any) -> tuple[float, float] | None:
    """A range of OPC UA as a span; None where it is none, as 0 to 0 where nobody has filled it in.

    Examples
    --------
    >>> span_of(ua.Range(0.0, 50.0)), span_of(ua.Range(0.0, 0.0)), span_of(None)
    ((0.0, 50.0), None, None)
    """
    if not isinstance(raw, ua.Range):
        return None
    low, high = float(raw.Low), float(raw.High)
    return (low, high) if math.isfinite(low) and math.isfinite(high) and low < high else None


def unit_of(raw: Any) -> str | None:
    """The word of an engineering unit; None where there is none."""
    text = raw.DisplayName.Text if isinstance(raw, ua.EUInformation) and raw.DisplayName is not None else None
    return (text or "").strip() or None


_MEANS = {
    ua.StatusCodes.BadNodeIdUnknown: "the server has no such node",
    ua.StatusCodes.BadAttributeIdInvalid: "the node is no variable",
    ua.StatusCodes.BadUserAccessDenied: "the server refuses this user, password or right",
    ua.StatusCodes.BadNotReadable: "the server does not let us read it",
    ua.StatusCodes.BadIdentityTokenRejected: "the server wants a user name and a password, or another one",
    ua.StatusCodes.BadIdentityTokenInvalid: "the server wants a user name and a password, or another one",
    ua.StatusCodes.BadCertificateUntrusted: "the server's administrator has to trust our certificate",
    ua.StatusCodes.BadSecurityChecksFailed: "the server's administrator has to trust our certificate",
    ua.StatusCodes.BadCertificateTimeInvalid: "a certificate has expired, or a clock is wrong",
    ua.StatusCodes.BadCertificateUriInvalid: "the certificate is of another application",
    ua.StatusCodes.BadTooManySessions: "the server takes no more clients",
    ua.StatusCodes.BadTcpEndpointUrlInvalid: "the server does not know the path behind host and port",
}
"""Statuses with which a connection that is made for the first time fails, as a person reads them."""


def status_text(status: ua.StatusCode) -> str:
    """A status by its name in OPC UA, and what it means where a person can mend that.

    Examples
    --------
    >>> status_text(ua.StatusCode(ua.StatusCodes.BadNodeIdUnknown))
    'BadNodeIdUnknown (the server has no such node)'
    >>> status_text(ua.StatusCode(ua.StatusCodes.BadSensorFailure))
    'BadSensorFailure'
    """
    means = _MEANS.get(status.value)
    return status.name if means is None else f"{status.name} ({means})"


def as_written(value: float, kind: ua.VariantType) -> float:
    """The value as the node will hold it."""
    if kind is ua.VariantType.Float:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    return value


def reason(error: BaseException) -> str:
    """Reason of a connection's failure, for a person."""
    if isinstance(error, ua.UaStatusCodeError):
        return status_text(ua.StatusCode(error.code))
    if isinstance(error, TimeoutError):
        return "no answer in time"
    if isinstance(error, socket.gaierror):
        return "the name of its host is not known: check it, or write the address in numbers"
    if isinstance(error, ConnectionRefusedError):
        return "nobody listens there: check host and port, and that the server runs"
    if isinstance(error, ConnectionError):
        return "the connection broke"
    if isinstance(error, AssertionError):  # asyncua's, where a server refuses the channel that it asks for
        return "the server's answer cannot be read; it may not trust our certificate"
    text = str(error)
    if isinstance(error, OSError) and "Connect call failed" in text:  # asyncio's, of a name with several addresses
        return "no address of its host answers: check host and port, and that the server runs"
    return text if isinstance(error, LostError | InputError) else f"{type(error).__name__}: {text}"
