"""A client with all that a connection says, and why a server does not take it."""

from __future__ import annotations

import asyncio
import contextlib
from datetime import timedelta
from pathlib import Path
from typing import Any

from asyncua import Client, ua
from asyncua.crypto import security_policies, uacrypto
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from ..errors import InputError
from .connection import Connection
from .opcua_values import LostError, reason
from .security import uri_of
from .trust import SOON, expiry

__all__ = ["DENIALS", "client_of", "connect", "disconnect", "expiring"]

DENIALS = {
    ua.StatusCodes.BadUserAccessDenied,
    ua.StatusCodes.BadIdentityTokenRejected,
    ua.StatusCodes.BadIdentityTokenInvalid,
}
"""What a server says to a wrong user or password."""


async def client_of(connection: Connection) -> Client:
    """A client that is not connected yet.

    Raises InputError with the file of a certificate, key or password that cannot be used.
    """
    client = Client(connection.url, timeout=connection.timeout, watchdog_intervall=connection.timeout)
    client.name = client.description = "glapp"
    client.session_timeout = 60_000
    if connection.security is not None:
        own, key, server = connection.certificate, connection.private_key, connection.server_certificate
        assert own is not None and key is not None and server is not None  # Connection has seen to it
        await _certificate(server)
        certificate = await _certificate(own)
        with _file(key, "is no private key without a password, in DER or PEM"):
            private = await uacrypto.load_private_key(key)
        if private.public_key() != certificate.public_key():
            raise InputError(f"is not the key of the certificate {own}", file=str(key))
        client.application_uri = uri_of(certificate) or client.application_uri
        policy = getattr(security_policies, f"SecurityPolicy{connection.security}")
        mode = ua.MessageSecurityMode[connection.mode]
        await client.set_security(policy, own, key, server_certificate=server, mode=mode)
    if connection.user is not None:
        client.set_user(connection.user)
        client.set_password(connection.password() or "")
    return client


async def connect(client: Client, connection: Connection) -> None:
    """Connect; where that fails, find out why, as far as the server tells everybody.

    Raises LostError with what a person can do about it, or what the client raises.
    """
    try:
        async with asyncio.timeout(4.0 * connection.timeout):
            await client.connect()
    except (TimeoutError, AssertionError, ua.UaError) as error:
        if isinstance(error, ua.UaStatusCodeError) and error.code in DENIALS:
            raise
        if (why := await _why(connection)) is not None:
            raise LostError(why) from error
        if isinstance(error, TimeoutError):
            raise LostError(f"{reason(error)}: check that an OPC UA server listens there") from error
        raise


async def disconnect(client: Client, connection: Connection) -> None:
    """Disconnect, whatever state the client is in."""
    with contextlib.suppress(Exception):
        async with asyncio.timeout(connection.timeout):
            await client.disconnect()


async def _why(connection: Connection) -> str | None:
    """Why a server does not take this connection, by the endpoints that it shows to everybody; None: not by them."""
    asked = Client(connection.url, timeout=connection.timeout)
    try:
        async with asyncio.timeout(2.0 * connection.timeout):
            shown = await asked.connect_and_get_server_endpoints()
    except Exception:  # a server need not show them
        return None
    ours = (connection.security or "None", "None" if connection.security is None else connection.mode)
    offered = {
        (one.SecurityPolicyUri.rpartition("#")[2].replace("_", ""), one.SecurityMode.name.rstrip("_")): one
        for one in shown
    }
    if ours not in offered:
        wanted, *names = (
            "no security" if policy == "None" else f"{policy} ({mode})" for policy, mode in (ours, *sorted(offered))
        )
        what = "change security and mode, or the server"
        return f"the server does not offer {wanted}; it offers {', '.join(names)}: {what}"
    server = connection.server_certificate
    if server is None:
        return None
    mine = (await _certificate(server)).public_bytes(Encoding.DER)
    if not (offered[ours].ServerCertificate or b"").startswith(mine):  # others may follow, which have signed it
        return f"the server shows another certificate than {server}: get its present one from its administrator"
    expired = " ".join(await expiring(connection, timedelta()))
    return expired or f"the server may not trust our certificate {connection.certificate}: its administrator has to"


async def expiring(connection: Connection, within: timedelta = SOON) -> list[str]:
    """Each certificate of a connection that is not valid now, or will not be soon, and what to do; else nothing.

    - `connection`: with the files.
    - `within`: what is soon.

    The other side may refuse ours. The server's is the one that was carried here, and is taken whatever its dates are:
    a plant is not lost sight of for a date.
    """
    texts = []
    for path, renew in (
        (connection.certificate, "make a new one, which the server's administrator has to trust"),
        (connection.server_certificate, "get a new one from the server's administrator"),
    ):
        if path is not None and (text := expiry(path, await _certificate(path), renew, within)) is not None:
            texts.append(text)
    return texts


async def _certificate(path: Path) -> x509.Certificate:
    """The certificate in a file."""
    with _file(path, "is no certificate in DER or PEM"):
        found: x509.Certificate = await uacrypto.load_certificate(path)
        return found


@contextlib.contextmanager
def _file(path: Path, what: str) -> Any:
    """Name the file that cannot be read, or holds something else."""
    try:
        yield
    except FileNotFoundError:
        raise InputError("there is no such file", file=str(path)) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=str(path)) from None
    except (ValueError, TypeError):
        raise InputError(what, file=str(path)) from None
