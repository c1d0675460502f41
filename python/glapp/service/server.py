"""OPC UA server with the monitor's results on each loop, for other programs: nothing of it can be written.

One object per loop, in the folder Loops; `NODES` says what is in each. A value changes when what it says does, with the
time from which on it says so: of an answer, when it was given.

Needs the extra `glapp[service]`.
"""

from __future__ import annotations

import asyncio
import hmac
import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from types import TracebackType
from typing import Any, NamedTuple, Self

from asyncua import Server, ua
from asyncua.common.node import Node as UaNode
from asyncua.crypto.permission_rules import SimpleRoleRuleset, User, UserRole

from ..errors import InputError
from .api import loopback
from .plant import free_port
from .security import Security, secure
from .users import SHORTEST, TRIES, TRIES_WITHIN
from .watched import Health

__all__ = ["DI", "NAMESPACE", "NODES", "AnswerServer", "Node", "node_values"]

NAMESPACE = "urn:glapp:loops"
"""URI of the namespace of the loops."""

DI = "http://opcfoundation.org/UA/DI/"
"""URI of OPC UA for Devices (OPC 10000-100), where DeviceHealth and its type are defined."""

_HEALTH_TYPE, _HEALTH_WORDS = 6244, 6450  # DeviceHealthEnumeration and its EnumStrings there
_APPLICATION = "urn:glapp:watch"
_MOST = 100  # connections at once
_UNECE = "http://www.opcfoundation.org/UA/units/un/cefact"
_PERCENT = 0x5031  # "P1" of UN/ECE Recommendation 20, as OPC 10000-8 makes a number of it
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Node:
    """A variable of a loop.

    - `kind`: its type.
    - `text`: what it says.
    - `unit`: whether it is in the unit of OP.
    """

    kind: ua.VariantType
    text: str
    unit: bool = False


NODES = {
    "Verdict": Node(ua.VariantType.String, "What the last fit found, such as backlash, sound or cannot_tell"),
    "Confidence": Node(ua.VariantType.String, "How sure it is that there is a dead band"),
    "Width": Node(ua.VariantType.Double, "Most likely total width of the gap by the last fit", True),
    "Low": Node(ua.VariantType.Double, "Lower limit of its 95 % interval", True),
    "High": Node(ua.VariantType.Double, "Upper limit of its 95 % interval", True),
    "NextStep": Node(ua.VariantType.String, "What to do next"),
    "Urgency": Node(ua.VariantType.String, "How soon: none, low, medium, high"),
    "Standing": Node(ua.VariantType.String, "Whether the loop is compensated (active), and else why not"),
    "UFf": Node(ua.VariantType.Double, "The feed-forward that compensates the gap", True),
    "Detections": Node(ua.VariantType.UInt32, "Half-periods that were accepted"),
    "LastSeen": Node(ua.VariantType.DateTime, "Source time of the newest PV"),
    "DeviceHealth": Node(ua.VariantType.Int32, "Health of the valve by NAMUR NE 107"),
}
"""Name of each variable of a loop, and its meaning."""

_OF_ANSWER = {
    "Verdict": "verdict",
    "Confidence": "confidence",
    "Width": "d",
    "Low": "low",
    "High": "high",
    "NextStep": "next",
    "Urgency": "urgency",
}


class NodeValue(NamedTuple):
    """Value of a variable.

    - `value`: None where there is none.
    - `status`: OPC UA's status, bad where there is no value.
    - `time`: from when on it says so [s since 1970 UTC]; None: from now on.
    """

    value: Any
    status: int
    time: float | None = None


def node_values(loop: Mapping[str, Any]) -> dict[str, NodeValue]:
    """Values of `NODES` for a loop.

    - `loop`: the loop's part of `Monitor.status`.

    Returns its status is BadWaitingForInitialData before the first fit or PV, BadNoData where a fit gives no such
    value, BadNotSupported where the loop has no node for u_FF, BadNoCommunication of u_FF where the connection is lost.

    Examples
    --------
    >>> loop = {"answer": None, "seen": 1.7e9, "lost": False, "accepted": 7, "health": "NORMAL"}
    >>> values = node_values(loop)
    >>> values["Detections"].value, values["LastSeen"].value.isoformat()
    (7, '2023-11-14T22:13:20+00:00')
    >>> ua.StatusCode(values["Width"].status).name
    'BadWaitingForInitialData'
    """
    codes = ua.StatusCodes
    answer, made, seen = loop["answer"], loop.get("compensation"), loop["seen"]
    values: dict[str, NodeValue] = {}
    for name, key in _OF_ANSWER.items():
        if answer is None:
            values[name] = NodeValue(None, codes.BadWaitingForInitialData)
        else:
            values[name] = _node_value(answer[key], codes.BadNoData, answer["time"])
    if made is None:
        values["Standing"] = values["UFf"] = NodeValue(None, codes.BadNotSupported)
    else:
        values["Standing"] = NodeValue(made["standing"], codes.Good)
        values["UFf"] = _node_value(None if loop["lost"] else made["u_ff"], codes.BadNoCommunication)
    values["Detections"] = NodeValue(loop["accepted"], codes.Good)
    values["LastSeen"] = _node_value(None if seen is None else _moment(seen), codes.BadWaitingForInitialData, seen)
    values["DeviceHealth"] = NodeValue(int(Health[loop["health"]]), codes.Good)
    return values


def _node_value(value: Any, otherwise: int, at: float | None = None) -> NodeValue:
    """A value where there is one, and else why not."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return NodeValue(None, otherwise, at)
    return NodeValue(value, ua.StatusCodes.Good, at)


def _moment(seconds: float) -> datetime:
    return _EPOCH + timedelta(seconds=seconds)


class _Readers:
    """Login of readers: no role above reader, and after some wrong passwords nobody for a while."""

    def __init__(self, users: Mapping[str, str] | None) -> None:
        self._users = users
        self._failed: list[float] = []

    def get_user(
        self, iserver: Any, username: str | None = None, password: str | None = None, certificate: Any = None
    ) -> User | None:
        """The user, or None to refuse."""
        if not self._users:
            return User(role=UserRole.User)
        now = time.monotonic()
        self._failed = [at for at in self._failed if now - at < TRIES_WITHIN]
        known = self._users.get(username or "")
        right = hmac.compare_digest((known or "").encode(), (password or "").encode()) and known is not None
        if len(self._failed) < TRIES and right:
            return User(role=UserRole.User, name=username)
        if len(self._failed) < TRIES:
            self._failed.append(now)
        return None


class _ReadOnly(SimpleRoleRuleset):  # type: ignore[misc]
    """All that a user may, but for writing and calling, also of the standard's own nodes."""

    def check_validity(self, user: User, action_type_id: ua.NodeId, body: Any) -> bool:
        """Whether a request is let in."""
        return action_type_id not in _REFUSED and bool(super().check_validity(user, action_type_id, body))


_REFUSED = (
    ua.NodeId(ua.ObjectIds.WriteRequest_Encoding_DefaultBinary),
    ua.NodeId(ua.ObjectIds.CallRequest_Encoding_DefaultBinary),
)


def _refuse(*_: Any) -> None:
    """Asyncua takes in other servers' names from anybody, and keeps them."""
    raise ua.uaerrors.BadServiceUnsupported


class AnswerServer:
    """The server: `async with` begins to listen, `run` keeps what it says true.

    - `status`: what `Monitor.status` gives; its loops must not change.
    - `port`: where it listens; 0 for any free one.
    - `host`: the address it listens at.
    - `security`: certificate, key and users; each password has ten characters or more.
    - `step`: time between two looks at the status, > 0 [s].

    Raises InputError for an address that others reach without a certificate and users, for users without a certificate,
    a password that is too short; when it begins to listen for a certificate or key that cannot be used, and for a port
    that is taken.
    """

    def __init__(
        self,
        status: Callable[[], Mapping[str, Any]],
        port: int,
        host: str = "127.0.0.1",
        security: Security | None = None,
        step: float = 1.0,
    ) -> None:
        self._security = security or Security()
        if (self._security.certificate is None) != (self._security.private_key is None):
            raise InputError("certificate and key are given together", parameter="opcua-certificate")
        for password in (self._security.users or {}).values():
            if self._security.certificate is None:
                hint = "give a certificate and its key"
                raise InputError("its password would be sent readable", parameter="opcua-user", hint=hint)
            if len(password) < SHORTEST:
                bound = f">= {SHORTEST} characters"
                raise InputError(f"must have {SHORTEST} characters or more", parameter="opcua-password", bound=bound)
        if not loopback(host) and not self._security.users:
            raise InputError(
                f"is {host}, which others reach",
                parameter="opcua-host",
                value=host,
                hint="give a certificate with its key, and a user, or leave it at 127.0.0.1",
            )
        self._status, self._step = status, step
        self.url = f"opc.tcp://{host}:{port or free_port()}/glapp/loops"
        self._server: Server | None = None
        self._ids: dict[tuple[str, str], ua.NodeId] = {}
        self._last: dict[tuple[str, str], NodeValue] = {}

    async def __aenter__(self) -> Self:
        server = Server(user_manager=_Readers(self._security.users))
        await server.init()
        server.iserver.register_server = _refuse
        server.iserver.max_connections = _MOST
        server.set_server_name("glapp watch")
        await server.set_application_uri(_APPLICATION)
        server.set_endpoint(self.url)
        try:
            await secure(server, self._security, _ReadOnly())
        except (OSError, ValueError) as error:
            raise InputError(f"cannot be used: {error}", parameter="opcua-certificate or opcua-key") from None
        certificate, key = server.iserver.certificate, server.iserver.private_key
        if certificate is not None and certificate.public_key() != key.public_key():
            raise InputError("is not the key of the certificate", file=str(self._security.private_key))
        await self._build(server)
        self._server = server
        await self.publish()
        try:
            await server.start()
        except OSError as error:
            self._server = None
            what = f"{self.url}: nobody can listen there: {error}"
            raise InputError(what, parameter="opcua-port", hint="give another --opcua-port") from None
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        server, self._server = self._server, None
        if server is not None:
            with suppress(asyncio.CancelledError):  # of asyncua's own tasks
                await server.stop()

    async def run(self) -> None:
        """Write the new values, step by step, until cancelled."""
        while True:
            await asyncio.sleep(self._step)
            await self.publish()

    async def publish(self) -> None:
        """Say what has changed since the last time."""
        assert self._server is not None
        aspace = self._server.iserver.aspace
        for loop, status in self._status()["loops"].items():
            for name, node in node_values(status).items():
                if self._last.get((loop, name)) == node:
                    continue
                self._last[loop, name] = node
                now = datetime.now(UTC)
                kind = ua.VariantType.Null if node.value is None else NODES[name].kind
                source = now if node.time is None else _moment(node.time)
                value = ua.DataValue(ua.Variant(node.value, kind), ua.StatusCode(node.status), source, now)
                await aspace.write_attribute_value(self._ids[loop, name], ua.AttributeIds.Value, value)

    async def _build(self, server: Server) -> None:
        """Create the nodes of all loops."""
        index = await server.register_namespace(NAMESPACE)
        di = await server.register_namespace(DI)
        health_type = ua.NodeId(_HEALTH_TYPE, di)
        enumerations = server.get_node(ua.ObjectIds.Enumeration)
        kind = await enumerations.add_data_type(health_type, ua.QualifiedName("DeviceHealthEnumeration", di))
        words = [ua.LocalizedText(health.name) for health in Health]
        await kind.add_property(ua.NodeId(_HEALTH_WORDS, di), ua.QualifiedName("EnumStrings"), words)
        loops = await server.nodes.objects.add_folder(ua.NodeId(1, index), ua.QualifiedName("Loops", index))
        for loop, status in self._status()["loops"].items():
            # A loop may be called as another one's variable is.
            one = await loops.add_object(ua.NodeId(f"Loops/{loop}", index), ua.QualifiedName(loop, index))
            for name, node in NODES.items():
                id = ua.NodeId(f"{loop}.{name}", index)
                of_di = name == "DeviceHealth"
                made = await one.add_variable(
                    id,
                    ua.QualifiedName(name, di if of_di else index),
                    ua.get_default_value(node.kind),
                    node.kind,
                    health_type if of_di else None,
                )
                text = ua.DataValue(ua.Variant(ua.LocalizedText(node.text), ua.VariantType.LocalizedText))
                await made.write_attribute(ua.AttributeIds.Description, text)
                if node.unit:
                    await _in_unit(made, f"{loop}.{name}.EngineeringUnits", index, status["unit"])
                self._ids[loop, name] = id


async def _in_unit(node: UaNode, id: str, index: int, unit: str) -> None:
    """Make a variable an AnalogUnitType: one with EngineeringUnits."""
    await node.delete_reference(ua.ObjectIds.BaseDataVariableType, ua.ObjectIds.HasTypeDefinition, bidirectional=False)
    await node.add_reference(ua.ObjectIds.AnalogUnitType, ua.ObjectIds.HasTypeDefinition, bidirectional=False)
    percent = unit == "%"
    information = ua.EUInformation(
        NamespaceUri=_UNECE if percent else NAMESPACE,
        UnitId=_PERCENT if percent else -1,  # -1: none that the standard knows
        DisplayName=ua.LocalizedText(unit),
        Description=ua.LocalizedText("unit of OP"),
    )
    await node.add_property(ua.NodeId(id, index), ua.QualifiedName("EngineeringUnits"), information)
