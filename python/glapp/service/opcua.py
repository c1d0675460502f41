"""Values from a plant by OPC UA, and the one kind of node in it that may be written.

`OpcUa` is a `glapp.service.signal.Source`. It subscribes to the tags of the loops with `DeadbandValue` 0, since a dead
band of the connection hides the very moves that show a gap; it hands every value on once, in the order of its source's
time stamps; and it says in one sentence what was not as it should be. `docs/plant.md` has the table of faults.

Needs the extra `glapp[opcua]`.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

from asyncua import Client, ua

from ..errors import InputError
from ..loop import Loop
from .connection import Connection, check_tags
from .opcua_client import DENIALS, client_of, connect, disconnect, expiring
from .opcua_events import REPEATED, EventFilter
from .opcua_u_ff import UffNodes
from .opcua_values import LostError, NotANumberError, number_of, number_reader, reason, span_of, status_text, unit_of
from .signal import Signal, Take, Tell, Value, WriteRefused

__all__ = ["Found", "OpcUa", "browse"]

_PAUSES = (1.0, 30.0)  # between two attempts to connect, the first and the longest [s]
_DENIED = 300.0  # after a refused password: an account is locked easily
_DAY = 86_400.0  # [s]
_KEEP_ALIVE = 3  # intervals without a value until the server says that it is there
_ITEMS = 500  # tags in one request
_BROWSED = 100  # nodes in one request while a server is looked through
_SLICE = 3600.0  # of the history in one request [s]
_VALUES = 25_000  # of the history in one request, as far as the interval shows
_STATUS = 0.001  # a status that changes without a new time stamp counts from so much later [s]
_MARGIN = 10.0  # what the history is asked for before the last value: not all of it may have been sent
_LITTLE = 5.0  # a pass over the history shorter than this leaves little to catch up [s]

_NO_FILTER = {
    ua.StatusCodes.BadMonitoredItemFilterUnsupported,
    ua.StatusCodes.BadMonitoredItemFilterInvalid,
    ua.StatusCodes.BadFilterNotAllowed,
}
_LIMITS = {
    ua.ObjectIds.Server_ServerCapabilities_OperationLimits_MaxMonitoredItemsPerCall: "items",
    ua.ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerHistoryReadData: "histories",
    ua.ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerRead: "reads",
}
_DESCRIBE = ua.QualifiedName("EURange"), ua.QualifiedName("EngineeringUnits")
_OVERFLOW = 0x480  # info type DataValue, and its bit Overflow
_NUMBERS = (int, float)


class _TakerError(Exception):
    """Whoever takes the values failed: that is no fault of the connection."""


class _Tag:
    """One tag: its meaning, and the time of its last value handed on."""

    __slots__ = ("first", "good", "kind", "last", "late", "loop", "number", "path", "run", "signal", "stamp", "value")

    def __init__(self, loop: Loop, signal: Signal, path: str, last: float) -> None:
        self.loop, self.signal, self.path, self.number = loop.name, signal, path, number_reader(loop, signal)
        self.last = self.stamp = last  # time of the last value that was handed on, and that of its source
        self.value, self.good = math.nan, True
        self.kind: ua.VariantType | None = None
        self.first = True  # whether no live value was newer than what the history gave
        self.late, self.run = -math.inf, 0  # the last late one, and how many came in a row, each after the other

    @property
    def name(self) -> str:
        return f"{self.loop} {self.signal.name}"


class OpcUa:
    """The plant's OPC UA server as a `Source`.

    - `connection`: how it is reached.
    - `loops`: each with its `opcua` tags: pv and sp, and what else there is.
    - `since`: source time of the last value of each signal that is already kept [s since 1970 UTC]: the history is read
      from there on, and nothing comes twice.

    Raises InputError for tags that cannot be meant.

    Examples
    --------
    >>> from glapp.service.connection import Connection
    >>> tags = {"pv": "nsu=urn:plant;s=FIC101.PV", "sp": "nsu=urn:plant;s=FIC101.SP"}
    >>> OpcUa(Connection(url="opc.tcp://plant:4840"), [Loop(name="FIC101", opcua=tags)]).alive("FIC101") is None
    True
    """

    def __init__(
        self,
        connection: Connection,
        loops: Sequence[Loop],
        *,
        since: Mapping[tuple[str, Signal], float] | None = None,
    ) -> None:
        check_tags(connection, loops)
        self._connection = connection
        self._since = dict(since or {})
        self._tags = [
            _Tag(loop, Signal(key), path, self._since.get((loop.name, Signal(key)), -math.inf))
            for loop in loops
            for key, path in loop.opcua.nodes.items()
        ]
        self._events = EventFilter()
        self._u_ff = UffNodes(loops, connection.interval, self._events)
        self._newest = {loop.name: -math.inf for loop in loops}
        for tag in self._tags:
            self._newest[tag.loop] = max(self._newest[tag.loop], tag.last)
        self._uris: dict[int, str] = {}
        self._clock = _Clock()
        self._link: _Link | None = None
        self._was_connected = False
        self._certificates_told = -math.inf
        self._quiet = -math.inf  # until then live values may be some that the history has given already

    # ----------------------------------------------------------------- functions of a Source

    async def run(self, take: Take, tell: Tell) -> None:
        """Hand over values and events until cancelled; a lost connection is taken up again for ever."""
        self._events.tell = tell
        pause, last_reason = _PAUSES[0], ""
        while True:
            try:
                await self._connected(take)
            except _TakerError as error:
                raise error.__cause__ or error from None
            except Exception as error:  # years of service: whatever a server answers, we try again
                why = reason(error)
                denied = isinstance(error, ua.UaStatusCodeError) and error.code in DENIALS
                if self._was_connected:
                    pause = _PAUSES[0]
                if self._was_connected or why != last_reason:
                    self._events.event("lost", None, f"{self._connection.url}: {why}; it is tried again")
                self._was_connected, last_reason = False, why
            self._events.flush()
            await asyncio.sleep(_DENIED if denied else pause)
            pause = min(2.0 * pause, _PAUSES[1])

    async def write(self, loop: str, u_ff: float) -> None:
        """Write the feed-forward of a loop, and read it back: see `UffNodes.write`."""
        await self._u_ff.write(loop, u_ff)

    async def read_back(self, loop: str) -> Value:
        """The feed-forward that is in the plant now; not good where it cannot be read."""
        return await self._u_ff.read_back(loop, self._clock.now())

    def enable(self, loop: str) -> None:
        """Let u_FF of this loop be written: see `UffNodes.enable`."""
        self._u_ff.enable(loop)

    def disable(self, loop: str) -> None:
        """Let u_FF of this loop only go to 0 from now on."""
        self._u_ff.disable(loop)

    def enabled(self, loop: str) -> bool:
        """Whether u_FF of this loop may be written."""
        return self._u_ff.enabled(loop)

    def alive(self, loop: str) -> float | None:
        """Time until which the loop's values are known to hold, by the plant's time stamps [s since 1970 UTC].

        A server that has nothing new says so; its last value then holds until that moment. None: never heard of.
        """
        newest, link = self._newest[loop], self._link
        if newest == -math.inf:
            return None
        # While values wait to be handed on, nothing is known to have stood still.
        return newest if link is None or link.waiting or not link.caught_up else max(newest, link.heard)

    async def heartbeat(self) -> None:
        """Count the plant's watchdog up.

        Raises WriteRefused: not_named, not_connected, by_server.
        """
        if self._connection.watchdog is None:
            raise WriteRefused("not_named", "opcua.watchdog is not given: the plant would not notice that we end")
        link = self._link
        if link is None or link.heartbeat is None:
            raise WriteRefused("not_connected", "the watchdog cannot be counted up: there is no connection")
        node, kind, count = link.heartbeat
        count = (count + 1) % 30_000
        value: object = bool(count % 2) if kind is ua.VariantType.Boolean else count
        if kind in (ua.VariantType.Float, ua.VariantType.Double):
            value = float(count)
        elif kind in (ua.VariantType.Byte, ua.VariantType.SByte):
            value = count % 100
        link.heartbeat = (node, kind, count)
        try:
            [status] = await link.client.uaclient.write_attributes(
                [node], [ua.DataValue(ua.Variant(value, kind))], ua.AttributeIds.Value
            )
        except (OSError, TimeoutError, ua.UaError) as error:
            raise WriteRefused("not_connected", f"the watchdog cannot be counted up: {reason(error)}") from None
        if not status.is_good():
            raise WriteRefused("by_server", f"the server refuses the watchdog: {status.name}")

    # ----------------------------------------------------------------- one connection

    async def _connected(self, take: Take) -> None:
        """Connect, catch up from the history, subscribe, and hand on until it is lost."""
        connection = self._connection
        client = await client_of(connection)
        link = _Link(client, connection)
        await self._tell_certificates()
        try:
            await connect(client, connection)
            client.connection_lost_callback = link.on_lost
            await self._resolve(link)
            await self._catch_up(link, take)
            await self._subscribe(link, range(len(self._tags)))
            self._link, self._u_ff.client, self._was_connected = link, client, True
            self._events.event("connected", None, f"{connection.url}: connected, {len(link.nodes)} tags")
            await self._backfill(link, take, self._clock.now())
            self._summary(link)
            link.caught_up = True
            self._quiet = time.monotonic() + REPEATED
            await self._hand_on(link, take)
        finally:
            self._link = None
            self._u_ff.disconnected()
            await disconnect(client, connection)

    async def _tell_certificates(self) -> None:
        """Report once a day each certificate that has expired, or soon will."""
        if time.monotonic() - self._certificates_told < _DAY:
            return
        self._certificates_told = time.monotonic()
        with contextlib.suppress(InputError):  # a file that is replaced right now
            for text in await expiring(self._connection):
                self._events.event("certificate", None, text)

    async def _resolve(self, link: _Link) -> None:
        """Node ids of this connection: the server may have put its namespaces in another order."""
        uris = await link.client.get_namespace_array()
        await self._limits(link)
        for handle, tag in enumerate(self._tags):
            if (node := self._node(tag.path, uris, tag, tag.name)) is not None:
                link.nodes[handle] = node
        written: dict[ua.NodeId, str] = {}
        for loop, feed in self._u_ff.nodes.items():
            feed.node = self._node(feed.path, uris, None, None)
            if feed.node is not None:
                written[feed.node] = loop
        for handle, node in link.nodes.items():
            tag = self._tags[handle]
            if written.get(node, tag.loop) != tag.loop or (node in written and tag.signal is not Signal.U_FF):
                raise LostError(f"{tag.name} and u_FF of {written[node]} are one node, {tag.path}")
        await self._u_ff.check(link.client, link.reads)
        if self._connection.watchdog is not None:
            node_id = self._node(self._connection.watchdog, uris, None, "opcua.watchdog")
            if node_id is not None:
                [seen] = await link.client.uaclient.read_attributes([node_id], ua.AttributeIds.Value)
                value, note = number_of(seen)
                if note or seen.Value is None:
                    text = f"opcua.watchdog: {self._connection.watchdog}: {note}; no loop can be compensated"
                    self._events.event("tag_missing", None, text)
                else:
                    link.heartbeat = (node_id, seen.Value.VariantType, int(value))

    async def _limits(self, link: _Link) -> None:
        """Number of tags that the server takes in one request."""
        asked = [ua.NodeId(i) for i in _LIMITS]
        for seen, name in zip(
            await link.client.uaclient.read_attributes(asked, ua.AttributeIds.Value), _LIMITS.values(), strict=True
        ):
            most = None if seen.Value is None else seen.Value.Value
            if isinstance(most, int) and most > 0:
                setattr(link, name, min(getattr(link, name), most))

    def _node(self, path: str, uris: Sequence[str], about: _Tag | None, what: str | None) -> ua.NodeId | None:
        """The node in this connection; None where its namespace is missing, which is reported where `what` names it."""
        head, _, rest = path.partition(";")
        if head.startswith("nsu="):
            uri = head.removeprefix("nsu=")
        elif head.startswith("ns="):
            index = int(head.removeprefix("ns="))
            if index not in self._uris and index < len(uris):
                self._uris[index] = uris[index]
            uri = self._uris.get(index, head)
        else:
            uri, rest = uris[0], path
        if uri not in uris:
            if what is not None:
                self._events.often("tag_missing", f"{what}: the server has no namespace {uri}", tag=about)
            return None
        if head.startswith("ns=") and uris.index(uri) != int(head.removeprefix("ns=")):
            moved = f"namespace {uri} has moved from index {head.removeprefix('ns=')} to {uris.index(uri)}"
            self._events.often("namespace_moved", f"{moved}; the tags follow it")
        return ua.NodeId.from_string(f"ns={uris.index(uri)};{rest}")

    async def _subscribe(self, link: _Link, handles: Sequence[int]) -> None:
        """Monitor these tags: every change of value, status or time stamp."""
        connection, session = self._connection, link.client.uaclient.session
        if link.subscription is None:
            wanted = ua.CreateSubscriptionParameters()
            wanted.RequestedPublishingInterval = 1000.0 * connection.interval
            wanted.RequestedMaxKeepAliveCount = _KEEP_ALIVE
            wanted.RequestedLifetimeCount = max(10 * _KEEP_ALIVE, math.ceil(60.0 / connection.interval))
            wanted.PublishingEnabled = True
            made = await session.create_subscription(wanted, link.published)
            link.subscription = made.SubscriptionId
            quiet = made.RevisedPublishingInterval / 1000.0 * made.RevisedMaxKeepAliveCount
            link.longest = 2.0 * quiet + connection.timeout
        asked = [handle for handle in handles if handle in link.nodes]
        slower = 0.0
        for first in range(0, len(asked), link.items):
            some = asked[first : first + link.items]
            results = await session.create_monitored_items(self._items(link, some, filtered=True))
            bare = [h for h, r in zip(some, results, strict=True) if r.StatusCode.value in _NO_FILTER]
            if bare:
                text = "the server takes no filter: a value that comes again unchanged is not sent"
                self._events.often("no_filter", text, many="tags", count=len(bare))
                again = await session.create_monitored_items(self._items(link, bare, filtered=False))
                results = [r for r in results if r.StatusCode.value not in _NO_FILTER] + list(again)
                some = [h for h in some if h not in bare] + bare
            for handle, result in zip(some, results, strict=True):
                tag = self._tags[handle]
                if result.StatusCode.is_good():
                    link.missing.discard(handle)
                    slower = max(slower, result.RevisedSamplingInterval / 1000.0)
                else:
                    link.missing.add(handle)
                    text = f"{tag.name}: {tag.path}: {status_text(result.StatusCode)}"
                    self._events.often("tag_missing", text, tag=tag)
        if slower > 1.01 * connection.interval:
            text = f"the server takes samples every {slower:g} s at best, not every {connection.interval:g} s"
            self._events.often("slower", text)

    def _items(self, link: _Link, handles: Sequence[int], *, filtered: bool) -> ua.CreateMonitoredItemsParameters:
        """Monitored items for these tags."""
        asked = ua.CreateMonitoredItemsParameters()
        asked.SubscriptionId = link.subscription
        asked.TimestampsToReturn = ua.TimestampsToReturn.Both
        for handle in handles:
            self._tags[handle].first = True
            item = ua.MonitoredItemCreateRequest()
            item.ItemToMonitor.NodeId = link.nodes[handle]
            item.ItemToMonitor.AttributeId = ua.AttributeIds.Value
            item.MonitoringMode = ua.MonitoringMode.Reporting
            item.RequestedParameters.ClientHandle = handle
            item.RequestedParameters.SamplingInterval = 1000.0 * self._connection.interval
            item.RequestedParameters.QueueSize = self._connection.samples
            item.RequestedParameters.DiscardOldest = True
            if filtered:
                item.RequestedParameters.Filter = ua.DataChangeFilter(
                    Trigger=ua.DataChangeTrigger.StatusValueTimestamp, DeadbandType=0, DeadbandValue=0.0
                )
            asked.ItemsToCreate.append(item)
        return asked

    async def _hand_on(self, link: _Link, take: Take) -> None:
        """Hand on the incoming values, until the connection is lost."""
        checked = time.monotonic()
        while True:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(1.0):  # Python 3.11's wait_for may lose a cancellation here
                    await link.wake.wait()
            link.wake.clear()
            while link.queue:
                values = self._values(link.pop(), live=True)
                if values:
                    _hand(take, values)
                await asyncio.sleep(0)
            if link.lost is not None:
                if link.overflow:
                    self._events.event(
                        "overflow", None, f"{link.lost}; they are read from the history where there is one"
                    )
                raise LostError(link.lost)
            now = time.monotonic()
            if now - checked >= 1.0:
                checked = now
                link.silent = 0 if now - link.last <= link.longest else link.silent + 1
                if link.silent > 1:  # at first it may be we who were not listening
                    raise LostError(f"the server has said nothing for {now - link.last:.0f} s")
                self._events.flush(due=True)
                await self._tell_certificates()
                if back := self._clock.set_back():
                    text = f"this computer's clock was set back by {back:.0f} s; what is ahead is judged as before"
                    self._events.event("clock_back", None, text)
                if link.missing and now - link.retried > REPEATED:
                    link.retried = now
                    await self._subscribe(link, sorted(link.missing))

    # ----------------------------------------------------------------- values

    def _values(self, items: Sequence[Any], *, live: bool) -> list[Value]:
        """Values of one message, in the order of their times; values that cannot be handed on are reported."""
        ahead = self._clock.now() + self._connection.ahead
        values = [v for item in items if (v := self._value(item.ClientHandle, item.Value, ahead, live)) is not None]
        values.sort(key=_time_of)
        return values

    def _value(self, handle: int, seen: ua.DataValue, ahead: float, live: bool) -> Value | None:
        """A data value as a value of a signal; None where it cannot be used."""
        tag = self._tags[handle]
        stamp = seen.SourceTimestamp
        if stamp is None:
            stamp = seen.ServerTimestamp
            if tag.signal is not Signal.U_FF:  # which we write, without one
                text = f"{tag.name} has no source time stamp; the server's is taken"
                self._events.often("no_time", text, tag=tag)
        t = self._clock.now() if stamp is None else stamp.timestamp()
        code = seen.StatusCode.value if seen.StatusCode is not None else 0
        variant = seen.Value
        value, note = math.nan, ""
        if code & 0xC000_0000:
            note = ua.StatusCode(code).name
        elif variant is None or variant.Value is None:
            note = "no value"
        else:
            if variant.VariantType is not tag.kind:
                self._new_type(tag, variant.VariantType)
            try:
                value = tag.number(variant.Value)
            except NotANumberError as error:
                note = str(error)
            except ValueError as error:  # a word for a mode that is not known: not automatic
                value = 0.0
                text = f"{tag.name}: {variant.Value!r} {'; '.join(str(a) for a in error.args)}"
                self._events.often("unknown_mode", text, tag=tag)
            if code & _OVERFLOW == _OVERFLOW:
                text = f"{tag.name}: the server has thrown values away: its queue was full"
                self._events.often("overflow", text, tag=tag, many="times")
        if t > ahead:
            note = f"its time stamp is {t - ahead + self._connection.ahead:.0f} s ahead of this computer's clock"
            self._events.often("future", f"{tag.name}: {note}; it counts as bad", tag=tag, many="values in all")
            return self._bad_now(tag, note)
        source = t
        if t <= tag.last:
            if not (live and t == tag.stamp and tag.good == bool(note)):
                if live and not (tag.first and time.monotonic() < self._quiet):
                    return self._not_newer(tag, t, value)
                return None
            t = tag.last + _STATUS  # the status has changed and the time has not
        if live and tag.signal is Signal.PV and not tag.first and time.monotonic() > self._quiet:
            self._tell_behind(tag, self._clock.now() - t)
        tag.last, tag.stamp, tag.value, tag.good, tag.run = t, source, value, not note, 0
        tag.first = tag.first and not live
        if t > self._newest[tag.loop]:
            self._newest[tag.loop] = t
        return Value(tag.loop, tag.signal, t, value, not note, note)

    def _tell_behind(self, tag: _Tag, behind: float) -> None:
        """Report a PV whose time stamp is long past when it comes [s]: one of the clocks is wrong."""
        if behind > self._connection.behind:
            text = f"{tag.name}: a time stamp is {behind:.0f} s behind this computer's clock; the value is used"
            self._events.often("behind", f"{text}. Set the clocks of both", tag=tag, many="values in all")

    def _bad_now(self, tag: _Tag, note: str) -> Value:
        """A bad value of this moment, of a tag whose clock is wrong: without it, what it was would be held as good."""
        return Value(tag.loop, tag.signal, self._clock.now(), math.nan, False, note)

    def _not_newer(self, tag: _Tag, t: float, value: float) -> Value | None:
        """Report a value that is not newer than the last one; it is left out, or bad where its clock was set back."""
        if t == tag.stamp:
            same = value == tag.value or value != value
            what = "comes twice" if same else "comes twice, with another value; the first one holds"
            text = f"{tag.name}: the value of {_clock_time(t)} {what}"
            self._events.often("duplicate", text, tag=tag, many="values in all")
            return None
        tag.run = tag.run + 1 if t > tag.late else 1
        tag.late = t
        if tag.run >= 3 and tag.last - t > 3.0 * self._connection.interval:
            note = f"its clock went back by {tag.last - t:.0f} s"
            text = f"{tag.name}: {note}; values count as bad until it has passed {_clock_time(tag.last)}"
            self._events.often("clock_back", text, tag=tag, many="values in all")
            return self._bad_now(tag, note)
        text = f"{tag.name}: a value of {_clock_time(t)} comes after that of {_clock_time(tag.last)}"
        self._events.often("late", f"{text}; it is left out", tag=tag, many="values in all")
        return None

    def _new_type(self, tag: _Tag, kind: ua.VariantType) -> None:
        """Report that a tag's type has changed."""
        if tag.kind is not None:
            text = f"{tag.name}: its type has changed from {tag.kind.name} to {kind.name}"
            self._events.once("type_changed", tag.loop, text, tag.signal)
        tag.kind = kind

    # ----------------------------------------------------------------- history

    async def _catch_up(self, link: _Link, take: Take) -> None:
        """Read the history until little is left, so that live values need not wait for hours of it."""
        before = math.inf
        while not link.no_history:
            begun = time.monotonic()
            await self._backfill(link, take, self._clock.now())
            took = time.monotonic() - begun
            if took < _LITTLE or took > 0.5 * before:
                return
            before = took

    async def _backfill(self, link: _Link, take: Take, until: float) -> None:
        """Hand on the history after the last values, up to `until`, in the order of time.

        Of a short break many loops are asked together: a server that answers slowly is asked less often.
        """
        if link.no_history or not self._connection.history:
            return
        interval = self._connection.interval
        loops: dict[str, list[int]] = {}
        for handle in link.nodes:
            if handle not in link.without:
                loops.setdefault(self._tags[handle].loop, []).append(handle)
        begins: dict[str, float] = {}
        for loop in loops:
            newest = self._newest[loop]
            if newest == -math.inf:
                continue
            begins[loop] = max(newest - _MARGIN - 2.0 * interval, until - self._connection.history)
            if begins[loop] > newest:
                text = f"{loop}: the break is longer than the {self._connection.history:g} s that are read"
                self._events.once("not_backfilled", loop, text)
        waiting = deque(sorted(begins, key=lambda loop: begins[loop]))
        while waiting and not link.no_history:
            begin = begins[waiting[0]]
            most = min(_VALUES * interval / min(max(until - begin, interval), _SLICE), link.histories)
            asked = loops[waiting.popleft()]
            while waiting and len(asked) + len(loops[waiting[0]]) <= most:
                asked = asked + loops[waiting.popleft()]
            await self._read(link, take, asked, begin, until)

    async def _read(self, link: _Link, take: Take, handles: Sequence[int], begin: float, until: float) -> None:
        """Hand on the history of some tags, slice by slice."""
        newest = {self._tags[handle].loop: self._newest[self._tags[handle].loop] for handle in handles}
        while begin < until and not link.no_history:
            end = min(begin + _SLICE, until)
            values = await self._history(link, handles, begin, end)
            if values:
                fresh = [value for value in values if value.time > newest[value.loop] + 1e-6]
                link.filled += len(fresh)
                if fresh:
                    link.filled_from = min(link.filled_from, fresh[0].time)
                    link.filled_to = max(link.filled_to, fresh[-1].time)
                _hand(take, values)
            begin = end
            if link.lost is not None:
                raise LostError(link.lost)

    async def _history(self, link: _Link, handles: Sequence[int], begin: float, end: float) -> list[Value]:
        """Values of some tags from `begin` to `end`."""
        details = ua.ReadRawModifiedDetails()
        details.IsReadModified, details.ReturnBounds, details.NumValuesPerNode = False, False, 0
        details.StartTime, details.EndTime = datetime.fromtimestamp(begin, UTC), datetime.fromtimestamp(end, UTC)
        found: dict[int, list[Any]] = {handle: [] for handle in handles}
        outside = 0
        left: dict[int, bytes | None] = dict.fromkeys(handles)
        while left:
            asked = ua.HistoryReadParameters()
            asked.HistoryReadDetails = details
            asked.ReleaseContinuationPoints = False  # asyncua's True gives their memory back, and reads nothing
            asked.TimestampsToReturn = ua.TimestampsToReturn.Both
            some = dict(list(left.items())[: link.histories])
            for handle, go_on in some.items():
                node = ua.HistoryReadValueId()
                node.NodeId, node.ContinuationPoint = link.nodes[handle], go_on
                asked.NodesToRead.append(node)
            try:
                results = await link.client.uaclient.history_read(asked)
            except ua.UaStatusCodeError as error:
                self._no_history(link, ua.StatusCode(error.code).name)
                break
            for (handle, before), result in zip(some.items(), results, strict=True):
                del left[handle]
                if not result.StatusCode.is_good():
                    self._without(link, handle, result.StatusCode)
                    continue
                for seen in getattr(result.HistoryData, "DataValues", None) or []:
                    if seen.SourceTimestamp is None or not begin <= seen.SourceTimestamp.timestamp() <= end:
                        outside += 1
                    else:
                        found[handle].append(seen)
                if result.ContinuationPoint and result.ContinuationPoint != before:
                    left[handle] = result.ContinuationPoint
        if outside:
            text = "the history gave values outside of what was asked"
            self._events.often("outside", f"{text}; they are left out", many="values", count=outside)
        values: list[Value] = []
        for handle, some_seen in found.items():
            some_seen.sort(key=lambda seen: seen.SourceTimestamp)
            made = (self._value(handle, seen, math.inf, live=False) for seen in some_seen)
            values += [value for value in made if value is not None]
        values.sort(key=_time_of)
        return values

    def _without(self, link: _Link, handle: int, status: ua.StatusCode) -> None:
        """A tag without a history; where no tag has one, the server has none."""
        link.without.add(handle)
        if len(link.without) == len(link.nodes):
            self._no_history(link, status.name)
        elif self._tags[handle].signal is Signal.PV:
            text = f"{self._tags[handle].name} has no history: {status.name}; a break in it stays a gap"
            self._events.often("no_history", text, tag=self._tags[handle])

    def _no_history(self, link: _Link, why: str) -> None:
        """Report once that the server's history cannot be read."""
        link.no_history = True
        self._events.event("no_history", None, f"the server has no history ({why}): the break stays a gap")

    def _summary(self, link: _Link) -> None:
        """Report the values that were filled from the server's history."""
        if link.filled:
            between = f"from {_clock_time(link.filled_from)} to {_clock_time(link.filled_to)}"
            self._events.event("backfilled", None, f"{link.filled} values {between} were read from the history")


class _Link:
    """One connection, and its values."""

    def __init__(self, client: Client, connection: Connection) -> None:
        self.client = client
        self.nodes: dict[int, ua.NodeId] = {}
        self.items = self.histories = self.reads = _ITEMS
        self.missing: set[int] = set()
        self.without: set[int] = set()
        self.retried = time.monotonic()
        self.subscription: int | None = None
        self.heartbeat: tuple[ua.NodeId, ua.VariantType, int] | None = None
        self.queue: deque[list[Any]] = deque()
        self.waiting, self._most = 0, connection.queue
        self.wake = asyncio.Event()
        self.lost: str | None = None
        self.overflow = False
        self.last, self.longest, self.silent = time.monotonic(), math.inf, 0
        self.heard, self._behind = -math.inf, math.inf
        self._sequence: int | None = None
        self.no_history = self.caught_up = False
        self.filled, self.filled_from, self.filled_to = 0, math.inf, -math.inf

    async def on_lost(self, error: Exception) -> None:
        """Called when the connection breaks."""
        self.end(reason(error))

    def end(self, why: str) -> None:
        """The connection is of no use any more."""
        if self.lost is None:
            self.lost = why
        self.wake.set()

    def pop(self) -> list[Any]:
        """The oldest message."""
        items = self.queue.popleft()
        self.waiting -= len(items)
        return items

    def published(self, result: ua.PublishResult) -> None:
        """Take a message of the subscription: values, or a sign that there are none."""
        self.last = time.monotonic()
        message = result.NotificationMessage
        newest, values = -math.inf, False
        for part in message.NotificationData or []:
            if isinstance(part, ua.StatusChangeNotification):
                self.end(f"the server has ended the subscription: {part.Status.name}")
            elif isinstance(part, ua.DataChangeNotification) and self.lost is None:
                values = True
                newest = max(newest, self._queued(part.MonitoredItems))
        if values:
            number = int(message.SequenceNumber)
            if self._sequence is not None and number != self._sequence % 0xFFFF_FFFF + 1:
                self.overflow = True
                self.end(f"messages {self._sequence + 1} to {number - 1} of the server are missing")
            self._sequence = number
        if message.PublishTime is not None:
            published = message.PublishTime.timestamp()
            if newest > -math.inf:
                self._behind = max(published - newest, 0.0)
            if self._behind < math.inf and not result.MoreNotifications:
                self.heard = max(self.heard, published - self._behind)

    def _queued(self, items: list[Any]) -> float:
        """Queue values for the taker; too many end the connection."""
        if self.waiting + len(items) > self._most and self.queue:
            self.overflow = True
            self.end(f"more than {self._most} values wait to be taken; {len(items)} are thrown away")
            return -math.inf
        self.queue.append(items)
        self.waiting += len(items)
        self.wake.set()
        return max((i.Value.SourceTimestamp.timestamp() for i in items if i.Value.SourceTimestamp), default=-math.inf)


class _Clock:
    """The clock of this computer, which never goes back while we run."""

    def __init__(self) -> None:
        self._offset = time.time() - time.monotonic()
        self._told = 0.0

    def now(self) -> float:
        """Seconds since 1970 UTC."""
        moment = time.monotonic()
        self._offset = max(self._offset, time.time() - moment)
        return moment + self._offset

    def set_back(self) -> float:
        """Seconds by which the clock was set back since the last call; 0: not by more than a second."""
        back = self.now() - time.time()
        new, self._told = back - self._told, max(back, 0.0)
        return new if new > 1.0 else 0.0


def _time_of(value: Value) -> float:
    return value.time


def _clock_time(t: float) -> str:
    return f"{datetime.fromtimestamp(t, UTC):%Y-%m-%d %H:%M:%S}Z"


def _hand(take: Take, values: list[Value]) -> None:
    """Hand values to the taker; its errors end the connection."""
    try:
        take(values)
    except Exception as error:
        raise _TakerError from error


# --------------------------------------------------------------------- browsing


@dataclass(frozen=True, slots=True)
class Found:
    """A variable of the server.

    - `path`: the names that lead to it.
    - `node`: as a loops.toml names it.
    - `span`, `unit`: its EURange and EngineeringUnits, where the server has them.
    """

    path: str
    node: str
    span: tuple[float, float] | None = None
    unit: str | None = None


async def browse(connection: Connection, *, most: int = 100_000) -> list[Found]:
    """Every variable below Objects with a namespace of its own, in the order of the server.

    - `connection`: how the server is reached.
    - `most`: nodes that are looked at.
    """
    client = await client_of(connection)
    try:
        await connect(client, connection)
        uris = await client.get_namespace_array()
        described: dict[tuple[ua.NodeId, str], ua.NodeId] = {}
        found = [one async for one in _variables_below(client, uris, most, described)]
        return await _described(client, found, described)
    finally:
        await disconnect(client, connection)


async def _described(
    client: Client, found: Sequence[tuple[ua.NodeId, Found]], described: Mapping[tuple[ua.NodeId, str], ua.NodeId]
) -> list[Found]:
    """The variables with their spans and units, read from the nodes that have these."""
    nodes = list(described.values())
    values: list[Any] = []
    for i in range(0, len(nodes), _BROWSED):
        some = nodes[i : i + _BROWSED]
        try:
            seen = await client.uaclient.read_attributes(some, ua.AttributeIds.Value)
        except ua.UaError:  # the tags are found without them
            values += [None] * len(some)
        else:
            values += [None if one.Value is None else one.Value.Value for one in seen]
    of = dict(zip(described, values, strict=True))
    return [
        replace(one, span=span_of(of.get((node, "EURange"))), unit=unit_of(of.get((node, "EngineeringUnits"))))
        for node, one in found
    ]


async def _variables_below(
    client: Client, uris: Sequence[str], most: int, described: dict[tuple[ua.NodeId, str], ua.NodeId]
) -> Any:
    """Nodes of a server's variables, and what is found of them.

    - `described`: gets the nodes with the EURange and EngineeringUnits of variables, which are no tags.
    """
    seen: set[ua.NodeId] = set()
    waiting: deque[tuple[ua.NodeId, str]] = deque([(client.nodes.objects.nodeid, "")])
    while waiting and len(seen) < most:
        some = [waiting.popleft() for _ in range(min(len(waiting), _BROWSED))]
        asked = ua.BrowseParameters()
        for node, _ in some:
            one = ua.BrowseDescription()
            one.NodeId, one.BrowseDirection = node, ua.BrowseDirection.Forward
            one.ReferenceTypeId = ua.NodeId(ua.ObjectIds.HierarchicalReferences)
            one.IncludeSubtypes, one.ResultMask = True, ua.BrowseResultMask.All
            asked.NodesToBrowse.append(one)
        for (parent, path), result in zip(some, await client.uaclient.browse(asked), strict=True):
            for reference in await _all_of(client, result):
                node = reference.NodeId
                if node in seen or node.NamespaceIndex == 0 or node.NamespaceIndex >= len(uris):
                    continue
                seen.add(node)
                if reference.BrowseName in _DESCRIBE:
                    described[parent, reference.BrowseName.Name] = node
                    continue
                name = f"{path}.{reference.BrowseName.Name}" if path else reference.BrowseName.Name
                if reference.NodeClass is not ua.NodeClass.Method:  # whose arguments are no tags
                    waiting.append((node, name))
                if reference.NodeClass is ua.NodeClass.Variable:
                    yield node, Found(name, _text_of(node, uris))


async def _all_of(client: Client, result: Any) -> Iterator[Any]:
    references = list(result.References or [])
    point = result.ContinuationPoint
    while point:
        more = ua.BrowseNextParameters()
        more.ReleaseContinuationPoints, more.ContinuationPoints = False, [point]
        [result] = await client.uaclient.session.browse_next(more)
        references += result.References or []
        point = result.ContinuationPoint
    return iter(references)


def _text_of(node: ua.NodeId, uris: Sequence[str]) -> str:
    """A node by its namespace's URI: that outlives a restart of the server."""
    text = str(node.to_string())
    return f"nsu={uris[node.NamespaceIndex]};{text.partition(';')[2] if text.startswith('ns=') else text}"
