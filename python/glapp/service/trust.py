"""Trust in the certificate of an API that no public authority has signed."""

from __future__ import annotations

import ssl
from pathlib import Path

from ..errors import InputError

__all__ = ["TRUST", "trusted"]

TRUST = "GLAPP_TRUST"
"""The environment's variable that may name the file."""


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
