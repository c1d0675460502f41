"""The nodes of u_FF: with the watchdog they are the only ones in the plant that are written."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

from asyncua import Client, ua

from ..loop import Loop
from .opcua_events import EventFilter
from .opcua_values import as_written, number_of, reason, status_text
from .signal import Signal, Value, WriteRefused

__all__ = ["UffNodes"]


_ANEW = "Nothing is written any more until it is enabled again"


@dataclass(slots=True)
class UffNode:
    """The node of u_FF of one loop, and the last written value."""

    path: str
    limit: float
    rate: float
    state: str = "off"  # enabled; taken: somebody else wrote it
    written: float | None = None
    allowed: float = 0.0  # by how much it may change at once
    at: float = 0.0
    node: ua.NodeId | None = None
    kind: ua.VariantType = ua.VariantType.Double


class UffNodes:
    """Writes u_FF of the loops, each within its limit and rate, and only while it is enabled.

    - `loops`: with the tags of u_FF.
    - `interval`: usual time between two writes [s].
    - `events`: gets where somebody else writes, and where a node cannot be written.
    """

    def __init__(self, loops: Sequence[Loop], interval: float, events: EventFilter) -> None:
        self._interval, self._events = interval, events
        self.client: Client | None = None
        self.nodes = {
            loop.name: UffNode(loop.opcua.u_ff, loop.opcua.u_ff_limit, loop.opcua.u_ff_rate)
            for loop in loops
            if loop.opcua.u_ff is not None and loop.opcua.u_ff_limit is not None and loop.opcua.u_ff_rate is not None
        }
        self._locks = {name: asyncio.Lock() for name in self.nodes}

    def disconnected(self) -> None:
        """The connection is gone: nothing may be written until it is enabled again."""
        self.client = None
        for feed in self.nodes.values():  # who is told of the lost connection withdraws the loops
            feed.state = "taken" if feed.state == "taken" else "off"
            feed.written, feed.node = None, None

    async def write(self, loop: str, u_ff: float) -> None:
        """Write the feed-forward of a loop, and read it back.

        Where it is not enabled, only a value nearer to 0 than the present one is written, so that what was found
        after a restart can be ramped out. Towards 0 the rate is free.

        Raises WriteRefused: not_named, not_enabled, not_a_number, too_large, too_fast, not_connected, other_writer,
        by_server.
        """
        feed = self._node_of(loop)
        if not math.isfinite(u_ff):
            raise WriteRefused("not_a_number", f"{loop}: u_FF is {u_ff}, must be a number")
        async with self._locks[loop]:
            if feed.state == "taken":
                raise WriteRefused("other_writer", f"{loop}: somebody else has written u_FF. {_ANEW}")
            client = self._client_of(loop)
            value = as_written(u_ff, feed.kind)
            if abs(value) > feed.limit:
                text = f"{loop}: u_FF is {value:g}, must be within ±{feed.limit:g} (u_ff_limit)"
                raise WriteRefused("too_large", text)
            found = await self._value_in_plant(client, loop, feed)
            if feed.written is not None and found != feed.written:
                self._refuse_other_writer(loop, feed, f"u_FF is {found:g} where {feed.written:g} was written")
            nearer = abs(value) <= abs(found) and value * found >= 0.0
            if feed.state == "off" and not nearer:
                raise WriteRefused("not_enabled", f"{loop}: writing is not enabled; u_FF may only go to 0")
            now = time.monotonic()
            most = 2.0 * feed.rate * self._interval  # writes need not come like a clock
            allowed = min(feed.allowed + feed.rate * (now - feed.at), most)
            if not nearer and abs(value - found) > allowed * (1.0 + 1e-9):
                text = f"{loop}: u_FF goes from {found:g} to {value:g} at once, must be ≤ {feed.rate:g}/s"
                # A little less, which the node may round up.
                nearest = found + math.copysign((1.0 - 1e-6) * allowed, value - found)
                raise WriteRefused("too_fast", text, nearest)
            try:
                [status] = await client.uaclient.write_attributes(
                    [feed.node], [ua.DataValue(ua.Variant(value, feed.kind))], ua.AttributeIds.Value
                )
            except (OSError, TimeoutError, ua.UaError) as error:
                raise WriteRefused("not_connected", f"{loop}: u_FF was not written: {reason(error)}") from None
            if not status.is_good():
                raise WriteRefused("by_server", f"{loop}: the server refuses u_FF: {status.name}")
            feed.written, feed.at = value, now
            feed.allowed = max(allowed - abs(value - found), 0.0)
            if (found := await self._value_in_plant(client, loop, feed)) != value:
                self._refuse_other_writer(loop, feed, f"u_FF is {found:g} right after {value:g} was written")

    async def read_back(self, loop: str, now: float) -> Value:
        """The feed-forward in the plant now; not good where it cannot be read.

        - `now`: the time of a value without a time stamp [s since 1970 UTC].

        Raises WriteRefused: not_named, not_connected.
        """
        feed = self._node_of(loop)
        client = self._client_of(loop)
        try:
            [seen] = await client.uaclient.read_attributes([feed.node], ua.AttributeIds.Value)
        except (OSError, TimeoutError, ua.UaError) as error:
            raise WriteRefused("not_connected", f"{loop}: u_FF cannot be read: {reason(error)}") from None
        at = seen.SourceTimestamp or seen.ServerTimestamp
        value, note = number_of(seen)
        return Value(loop, Signal.U_FF, now if at is None else at.timestamp(), value, not note, note)

    def enable(self, loop: str) -> None:
        """Let u_FF of this loop be written, until it is disabled, the connection is lost or somebody else writes it.

        Raises WriteRefused: not_named, not_connected.
        """
        feed = self._node_of(loop)
        self._client_of(loop)
        feed.state, feed.written, feed.allowed, feed.at = "enabled", None, 0.0, time.monotonic()

    def disable(self, loop: str) -> None:
        """Let u_FF of this loop only go to 0 from now on.

        Raises WriteRefused: not_named.
        """
        feed = self._node_of(loop)
        if feed.state == "enabled":
            feed.state = "off"

    def enabled(self, loop: str) -> bool:
        """Whether u_FF of this loop may be written."""
        return loop in self.nodes and self.nodes[loop].state == "enabled"

    def _node_of(self, loop: str) -> UffNode:
        feed = self.nodes.get(loop)
        if feed is None:
            raise WriteRefused("not_named", f"{loop}: opcua.u_ff is not given: nothing of this loop is ever written")
        return feed

    def _client_of(self, loop: str) -> Client:
        if self.client is None or self.nodes[loop].node is None:
            raise WriteRefused("not_connected", f"{loop}: there is no connection to the node of u_FF")
        return self.client

    async def _value_in_plant(self, client: Client, loop: str, feed: UffNode) -> float:
        """Present value at the node of u_FF."""
        try:
            [seen] = await client.uaclient.read_attributes([feed.node], ua.AttributeIds.Value)
        except (OSError, TimeoutError, ua.UaError) as error:
            raise WriteRefused("not_connected", f"{loop}: u_FF cannot be read: {reason(error)}") from None
        value, note = number_of(seen)
        if note:
            raise WriteRefused("by_server", f"{loop}: u_FF cannot be read: {note}")
        return value

    def _refuse_other_writer(self, loop: str, feed: UffNode, text: str) -> NoReturn:
        feed.state = "taken"
        why = "somebody else writes it, or the plant takes it away"
        self._events.event("other_writer", loop, f"{loop}: {text}: {why}. {_ANEW}")
        raise WriteRefused("other_writer", f"{loop}: {text}")

    async def check(self, client: Client, most: int) -> None:
        """Drop each node that is no real number or cannot be written; at most `most` nodes are read in one request."""
        named = [(loop, feed) for loop, feed in self.nodes.items() if feed.node is not None]
        for first in range(0, len(named), most):
            some = named[first : first + most]
            nodes = [feed.node for _, feed in some]
            values = await client.uaclient.read_attributes(nodes, ua.AttributeIds.Value)
            levels = await client.uaclient.read_attributes(nodes, ua.AttributeIds.UserAccessLevel)
            for (loop, feed), seen, access in zip(some, values, levels, strict=True):
                kind, bad = None if seen.Value is None else seen.Value.VariantType, seen.StatusCode
                bits = 0 if access.Value is None or access.Value.Value is None else int(access.Value.Value)
                if kind not in (ua.VariantType.Double, ua.VariantType.Float):
                    there = bad is None or bad.is_good()
                    why = " is no Double or Float" if there else f": {status_text(bad)}"
                    text = f"{loop} U_FF: {feed.path}{why}; nothing is written"
                    self._events.event("tag_missing", loop, text, Signal.U_FF)
                    feed.node = None
                elif not bits & 1 << ua.AccessLevel.CurrentWrite.value:
                    text = f"{loop} U_FF: the server does not let us write {feed.path}"
                    self._events.event("not_writable", loop, text, Signal.U_FF)
                    feed.node = None
                else:
                    feed.kind = kind
