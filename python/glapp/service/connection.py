"""Connection to a plant's OPC UA server: the table [opcua] of a loops.toml."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import Field, field_validator, model_validator

from ..checked import Checked
from ..controller import Positive
from ..errors import InputError
from ..loop import Loop, Node
from ..reading.settings import read_table

__all__ = ["PASSWORD", "Connection", "check_tags", "password_in", "read_connection"]

PASSWORD = "GLAPP_OPCUA_PASSWORD"
"""The environment's variable that may hold the password."""


class Connection(Checked):
    """The table [opcua] of a loops.toml.

    Parameters
    ----------
    url : str
        opc.tcp://host:port/path of the server.
    security : str, optional
        Security policy: "Basic256Sha256", "Aes128Sha256RsaOaep" or "Aes256Sha256RsaPss"; none where not given.
    mode : str
        "SignAndEncrypt" or "Sign", of what is sent.
    certificate, private_key : path, optional
        Our own, .der or .pem; needed with a policy.
    server_certificate : path, optional
        The server's, which somebody carried here: no other server is spoken to. Needed with a policy.
    user : str, optional
        User name. It is only sent encrypted, so it needs a policy, with the mode "SignAndEncrypt".
    password_file : path, optional
        File whose first line is the password; where not given, the environment's GLAPP_OPCUA_PASSWORD.
    interval : float
        How often the server takes samples and sends them, > 0, ≤ 3600 [s].
    samples : int
        How many values the server keeps of a tag between two messages, 1 to 10 000.
    queue : int
        How many values wait here at most; more are an overflow, 100 to 10⁸.
    timeout : float
        How long an answer may take, > 0 [s].
    history : float
        The longest break that is read from the server's history, ≥ 0 [s].
    ahead : float
        How far time stamps may be ahead of this computer's clock, ≥ 0 [s].
    behind : float
        How far a PV's time stamp may be behind this computer's clock when it comes, before that is reported, > 0 [s].
    watchdog : str, optional
        Node of a number that is counted up while we are alive. There is one for all loops: where it stands still, the
        plant takes u_FF of every loop away.

    Examples
    --------
    >>> Connection(url="opc.tcp://plant:4840").interval
    1.0
    >>> Connection(url="opc.tcp://plant:4840", user="glapp")
    Traceback (most recent call last):
    glapp.errors.InputError: user: is 'glapp' without a security policy: its password would be sent readable; write \
security = "Basic256Sha256"
    """

    url: str
    security: Literal["Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"] | None = None
    mode: Literal["SignAndEncrypt", "Sign"] = "SignAndEncrypt"
    certificate: Path | None = None
    private_key: Path | None = None
    server_certificate: Path | None = None
    user: str | None = None
    password_file: Path | None = None
    interval: Annotated[float, Field(gt=0, le=3600)] = 1.0
    samples: Annotated[int, Field(ge=1, le=10_000)] = 100
    queue: Annotated[int, Field(ge=100, le=100_000_000)] = 200_000
    timeout: Positive = 5.0
    history: Annotated[float, Field(ge=0)] = 86_400.0
    ahead: Annotated[float, Field(ge=0)] = 60.0
    behind: Positive = 60.0
    watchdog: Node | None = None

    @field_validator("url")
    @classmethod
    def _address(cls, url: str) -> str:
        """The address, checked."""
        bound = "an address such as opc.tcp://plant:4840"
        if "@" in url:  # it is not shown: it may hold a password
            raise InputError(f"has an @, must be {bound}", bound=bound, hint="write user and password_file")
        if re.fullmatch(r"opc\.tcp://[^\s/]+(/\S*)?", url) is None:
            raise InputError(f"is {url!r}, must be {bound}", value=url, bound=bound)
        try:
            urlsplit(url).port  # noqa: B018 - it raises
        except ValueError:
            bound = "a port from 0 to 65535"
            raise InputError(f"is {url!r}, must have {bound}", value=url, bound=bound) from None
        return url

    @model_validator(mode="after")
    def _secure(self) -> Connection:
        """Check that the files of a secure connection are given."""
        files = ("certificate", "private_key", "server_certificate")
        for name in files:
            if self.security is not None and getattr(self, name) is None:
                raise InputError(f"is required with security = {self.security!r}", parameter=name)
            if self.security is None and getattr(self, name) is not None:
                hint = 'write security = "Basic256Sha256"'
                raise InputError("is given without a security policy", parameter=name, hint=hint)
        if self.user is not None and (self.security is None or self.mode != "SignAndEncrypt"):
            without = "without a security policy" if self.security is None else f"with mode = {self.mode!r}"
            hint = 'write security = "Basic256Sha256"' if self.security is None else 'write mode = "SignAndEncrypt"'
            what = f"is {self.user!r} {without}: its password would be sent readable"
            raise InputError(what, parameter="user", value=self.user, hint=hint)
        if self.password_file is not None and self.user is None:
            raise InputError("is given without a user", parameter="password_file", value=str(self.password_file))
        return self

    def password(self) -> str | None:
        """The user's password.

        Raises InputError where there is a user and no password, or its file cannot be read.
        """
        if self.user is None:
            return None
        if self.password_file is None:
            if PASSWORD not in os.environ:
                hint = f"name a password_file, or set {PASSWORD}"
                raise InputError(f"has no password for {self.user!r}", parameter="opcua.user", hint=hint)
            return os.environ[PASSWORD]
        return password_in(self.password_file)


def password_in(file: Path) -> str:
    """The first line of a file.

    Raises InputError where it cannot be read.
    """
    try:
        return file.read_text(encoding="utf-8").partition("\n")[0].rstrip("\r")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"cannot be read: {reason}", file=str(file)) from None


def read_connection(path: str | Path) -> Connection | None:
    """The table [opcua] of a loops.toml; None where it has none. Paths are relative to the file.

    Raises InputError with file, key, value and bound; for an unknown key with the nearest known one.
    """
    table = read_table(path, "opcua")
    if table is None:
        return None
    try:
        made = Connection(**table)
    except InputError as error:
        error.file, error.parameter = str(path), f"opcua.{error.parameter}"
        raise
    files = ("certificate", "private_key", "server_certificate", "password_file")
    here = {name: Path(path).parent / file for name in files if (file := getattr(made, name)) is not None}
    return made.model_copy(update=here)


def check_tags(connection: Connection, loops: Sequence[Loop]) -> None:
    """Refuse tags that cannot be meant: no PV, a node that is written and is something else too.

    Raises InputError with the loop and the key.
    """
    names: set[str] = set()
    for loop in loops:
        if loop.name in names:
            raise InputError("there are two loops of this name", loop=loop.name)
        names.add(loop.name)
        for key in ("pv", "sp"):
            if getattr(loop.opcua, key) is None:
                raise InputError("is required to watch a loop", loop=loop.name, parameter=f"opcua.{key}")
    written = {} if connection.watchdog is None else {connection.watchdog: "opcua.watchdog"}

    def refuse(loop: Loop, key: str, node: str) -> None:
        raise InputError(f"{node} is also {written[node]}", loop=loop.name, parameter=f"opcua.{key}", value=node)

    for loop in loops:
        if (node := loop.opcua.u_ff) is not None:
            if node in written:
                refuse(loop, "u_ff", node)
            written[node] = f"u_ff of {loop.name}"
    for loop in loops:
        for key, node in loop.opcua.nodes.items():
            if key != "u_ff" and node in written:
                refuse(loop, key, node)
