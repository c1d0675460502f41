"""Security of our OPC UA servers: certificate, policies, and users.

Needs the extra `glapp[opcua]`.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asyncua import Server, ua
from cryptography import x509

__all__ = ["Security", "secure", "uri_of"]

_POLICIES = (
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Basic256Sha256_Sign,
    ua.SecurityPolicyType.Aes128Sha256RsaOaep_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
)


@dataclass(frozen=True, slots=True)
class Security:
    """Security settings of a server.

    - `certificate`, `private_key`: of the server, .der and .pem; with them there are encrypted endpoints, and no open
      one.
    - `users`: name and password of who may connect; anybody where it is empty.
    """

    certificate: Path | None = None
    private_key: Path | None = None
    users: Mapping[str, str] | None = None


async def secure(server: Server, security: Security, ruleset: Any = None) -> None:
    """Give a server its certificate, its endpoints and the kinds of users that it takes, before it is started.

    - `server`: one that was made with a manager of these users.
    - `security`: what it shows and asks for.
    - `ruleset`: what they may ask for; asyncua's own where not given.
    """
    policies = [ua.SecurityPolicyType.NoSecurity]
    if security.certificate is not None and security.private_key is not None:
        await server.load_certificate(security.certificate)
        await server.load_private_key(security.private_key)
        if (uri := uri_of(server.iserver.certificate)) is not None:  # clients compare it with what the server says
            await server.set_application_uri(uri)
        policies = list(_POLICIES)
    server.set_security_policy(policies, ruleset)
    # Never both: with asyncua's own manager of users the name "admin" may do everything, without a password.
    server.set_identity_tokens([ua.UserNameIdentityToken if security.users else ua.AnonymousIdentityToken])


def uri_of(certificate: x509.Certificate) -> str | None:
    """The application's URI in a certificate: the other side compares it with the application's own statement."""
    with suppress(x509.ExtensionNotFound):
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), None)
    return None
