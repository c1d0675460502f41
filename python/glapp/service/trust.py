"""Certificates: trust in one that no public authority has signed, and the day on which one ends."""

from __future__ import annotations

import ssl
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError

if TYPE_CHECKING:  # a base install has it not
    from cryptography import x509

__all__ = ["SOON", "TRUST", "expiry", "trusted"]

TRUST = "GLAPP_TRUST"
"""The environment's variable that may name the file."""

SOON = timedelta(days=30)
"""Before a certificate expires it is reported for so long."""


def expiry(path: Path, certificate: x509.Certificate, renew: str, within: timedelta = SOON) -> str | None:
    """Sentence on a certificate that is not valid now, or will not be soon; None where it is.

    - `path`: its file.
    - `renew`: what to do then.
    - `within`: what is soon.
    """
    now, begin, end = datetime.now(UTC), certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if now < begin:
        return f"{path} is valid from {begin:%Y-%m-%d} on: check the clock of this computer"
    if now + within <= end:
        return None
    when = f"has expired on {end:%Y-%m-%d}" if now > end else f"expires on {end:%Y-%m-%d}, in {(end - now).days} d"
    return f"{path} {when}: {renew}"


def trusted(pem: Path | None) -> ssl.SSLContext | bool:
    """What httpx verifies a server by: this certificate, or those of the public authorities where it is None.

    Raises InputError where it cannot be used.
    """
    if pem is None:
        return True
    try:
        return ssl.create_default_context(cafile=str(pem))
    except (OSError, ssl.SSLError) as error:
        raise InputError(f"cannot be used: {error}", file=str(pem)) from None
