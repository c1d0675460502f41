"""The listener of the API and of the station: which connections it keeps, and for how long.

Whoever connects has seconds to send a whole request, and has to take the answer as it comes. A connection that has not
shown a login is a stranger's. Strangers have a bound each address and a bound altogether; where one is reached, the
oldest connection that waits is closed for the new one. So nobody who connects finds the listener full: what is held
open is what goes first. Connections that have shown a login are counted apart, and none of a stranger's displaces them.
"""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import math
import socket
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import uvicorn

__all__ = ["Listener", "ListenerLimits", "logged_in"]

LONGEST_HEADER = 32_768
"""A request's header may be no longer [bytes]."""

RESERVED = ("/login", "/api/login")
"""Paths that are answered by POST however many other requests there are; so is every path that ends in `/disable`."""


def _most() -> int:
    """Three quarters of the files that this process may have open, but no more than 1200 connections."""
    if sys.platform == "win32":
        return 1200
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return 1200 if soft == resource.RLIM_INFINITY else max(40, min(1200, soft * 3 // 4))


@dataclass(frozen=True, slots=True)
class ListenerLimits:
    """Limits of one listener.

    - `header`: a header is whole so soon after the connection was made or TLS was agreed on [s].
    - `body`: a body is whole so soon after its header [s], and one second later for each `slowest` bytes of it.
    - `answer`: within this time somebody who is sent an answer has taken `slowest` bytes of it, or all [s].
    - `slowest`: [bytes]
    - `idle`: so long a connection waits for the next request [s].
    - `rest`: so long for the rest of a body that was answered before it was whole [s].
    - `address`: connections of strangers from one address; of IPv6, from one network of 64 bits.
    - `strangers`: connections of strangers altogether.
    - `logged_in`: connections that have shown a login.
    - `each`: requests that one connection may send without a login; with the answer to the last it is closed.
    - `turns`: requests of strangers that are worked on at the same time; the others wait, but for log-in and `disable`.
    - `requests`: requests that are answered at the same time; log-in and `disable` are answered beyond it.
    """

    header: float = 5.0
    body: float = 10.0
    answer: float = 10.0
    slowest: int = 10_000
    idle: float = 30.0
    rest: float = 2.0
    address: int = field(default_factory=lambda: _most() // 4)
    strangers: int = field(default_factory=lambda: _most() // 2)
    logged_in: int = field(default_factory=lambda: _most() // 2)
    each: int = 10
    turns: int = 4
    requests: int = 200


@dataclass(slots=True, eq=False)
class _Connection:
    """A connection, from when it was accepted."""

    socket: socket.socket
    address: str
    until: float
    known: bool = False
    transport: asyncio.Transport | None = None
    making: asyncio.Task[None] | None = None
    left: int = 0
    taken: float = 0.0
    requests: int = 0
    end_turn: Callable[[], None] | None = None

    @property
    def gone(self) -> bool:
        return self.socket.fileno() < 0  # its transport closes it

    def end(self) -> None:
        """Close it now, whatever was not sent."""
        if self.transport is not None:
            self.transport.abort()
        elif self.making is not None:
            self.making.cancel()


def logged_in(scope: Any) -> None:
    """The request that this is has shown a login: its connection is no stranger's."""
    connection = scope.get("state", {}).get("connection")
    if connection is not None and not connection.known:
        connection.known = True
        if connection.end_turn is not None:
            connection.end_turn()
        scope["state"]["listener"].more_known()


def network(host: str) -> str:
    """Network that an owner of an address can easily have all of.

    Examples
    --------
    >>> network("10.1.2.3"), network("::ffff:10.1.2.3"), network("2001:db8::1:2:3:4")
    ('10.1.2.3', '10.1.2.3', '2001:db8::/64')
    """
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped is not None:
            return str(address.ipv4_mapped)
        return str(ipaddress.ip_network((int(address) >> 64 << 64, 64)))
    return str(address)


class Listener(uvicorn.Server):
    """A server whose connections are bounded in number and time; the signals of the process are the process's.

    - `app`: what is served.
    - `limits`: how much is taken.
    - `**more`: settings of uvicorn.
    """

    def __init__(self, app: Any, limits: ListenerLimits | None = None, **more: Any) -> None:
        self.limits = limits or ListenerLimits()
        self._app = app
        self._open: list[_Connection] = []
        self._requests = 0
        self._turns = asyncio.Semaphore(self.limits.turns)
        self._tasks: list[asyncio.Task[None]] = []
        super().__init__(
            uvicorn.Config(
                self._asked,
                interface="asgi3",
                http="h11",  # the one whose header has a bound
                h11_max_incomplete_event_size=LONGEST_HEADER,
                log_level="error",  # what strangers send that is no HTTP fills no log
                access_log=False,
                proxy_headers=False,  # no header says where a request comes from
                server_header=False,
                timeout_keep_alive=math.ceil(self.limits.idle),
                timeout_graceful_shutdown=2,
                **more,
            )
        )

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """None of them."""
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to listen: here, and not in uvicorn, since it counts a connection only when TLS was agreed on."""
        await super().startup(sockets=[])
        self._tasks = [asyncio.create_task(self._accept(one)) for one in sockets or ()]
        self._tasks.append(asyncio.create_task(self._look()))
        for task in self._tasks:
            task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task[None]) -> None:
        """A listener that accepts nobody any more must not seem to listen."""
        if not task.cancelled() and (error := task.exception()) is not None:
            logging.getLogger("uvicorn.error").error("the listener ends", exc_info=error)
            self.should_exit = True

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Take no more connections, and end those there are."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await super().shutdown(sockets)
        for connection in self._open:
            connection.end()

    # Connections

    async def _accept(self, listening: socket.socket) -> None:
        """Accept connections, until cancelled."""
        listening.setblocking(False)
        loop = asyncio.get_running_loop()
        while True:
            try:
                taken, peer = await loop.sock_accept(listening)
            except OSError:  # no file is left, or who connected is gone
                self._displace([one for one in self._open if not one.known])
                await asyncio.sleep(0.05)
                continue
            connection = _Connection(taken, network(peer[0]), time.monotonic() + self.limits.header)
            self._make_room(connection.address)
            self._open.append(connection)
            connection.making = loop.create_task(self._make(connection))
            await asyncio.sleep(0)  # who is connected has their turn before the next one is

    async def _make(self, connection: _Connection) -> None:
        """Hand a connection to uvicorn's protocol."""
        state = {**self.lifespan.state, "connection": connection, "listener": self}
        loop = asyncio.get_running_loop()

        def protocol() -> asyncio.Protocol:
            made: Any = self.config.http_protocol_class
            found: asyncio.Protocol = made(
                config=self.config, server_state=self.server_state, app_state=state, _loop=loop
            )
            return found

        tls = self.config.ssl
        times = {} if tls is None else {"ssl_handshake_timeout": self.limits.header, "ssl_shutdown_timeout": 2.0}
        try:
            connection.transport, _ = await loop.connect_accepted_socket(protocol, connection.socket, ssl=tls, **times)
        except (OSError, asyncio.CancelledError):  # an error of TLS is one of the system's
            connection.socket.close()
            return
        connection.taken = time.monotonic()
        connection.until = max(connection.until, connection.taken + self.limits.header * (tls is not None))

    def _make_room(self, address: str) -> None:
        """Close the connection that may go, for a new one."""
        strangers = [one for one in self._open if not one.known and not one.gone]
        own = [one for one in strangers if one.address == address]
        if len(own) >= self.limits.address:
            self._displace(own)
        elif len(strangers) >= self.limits.strangers:
            self._displace(_of_most(strangers))

    def more_known(self) -> None:
        """Make room where one connection more has shown a login: who has most loses the one that waits longest."""
        logged_in = [one for one in self._open if one.known and not one.gone]
        if len(logged_in) > self.limits.logged_in:
            self._displace(_of_most(logged_in)[:-1])

    def _displace(self, some: Sequence[_Connection]) -> None:
        """Close the oldest of those that wait, or the oldest of all."""
        waiting = [one for one in some if math.isfinite(one.until)] or some
        for one in waiting[:1]:
            self._open.remove(one)
            one.end()

    async def _look(self) -> None:
        """Close what has waited, or was waited for, too long."""
        step = min(0.5, self.limits.header / 4.0)
        while True:
            await asyncio.sleep(step)
            now = time.monotonic()
            self._open = [one for one in self._open if not one.gone]
            for one in self._open:
                if now > one.until or (one.transport is not None and self._stuck(one, one.transport, now)):
                    one.end()

    def _stuck(self, one: _Connection, transport: asyncio.Transport, now: float) -> bool:
        """Whether the other side takes too little of the sent data."""
        left = transport.get_write_buffer_size()
        if left == 0 or left <= one.left - self.limits.slowest:
            one.left, one.taken = left, now
        one.left = max(one.left, left)
        return now - one.taken > self.limits.answer

    # Requests

    async def _asked(self, scope: Any, receive: Any, send: Any) -> None:
        """Every request, on its way to the application."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await self._app(scope, receive, self._opened(scope["state"]["connection"], send))
        elif (refusal := self._refusal(scope)) is not None:
            status, text = refusal
            body = f'{{"detail": "{text}"}}'.encode()
            headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
            await send({"type": "http.response.start", "status": status, "headers": headers})
            await send({"type": "http.response.body", "body": body})
            scope["state"]["connection"].until = time.monotonic() + self.limits.rest
        else:
            self._requests += 1
            try:
                await self._answered(scope, receive, send)
            finally:
                self._requests -= 1

    def _refusal(self, scope: Any) -> tuple[int, str] | None:
        """Status and text of a refusal; None where the request may pass."""
        if any(name == b"transfer-encoding" for name, _ in scope["headers"]):
            return 411, "a request says by Content-Length how many bytes it has"
        if self._requests >= self.limits.requests and not _reserved(scope):
            return 503, f"{self._requests} requests are being answered: try again in a second"
        return None

    async def _answered(self, scope: Any, receive: Any, send: Any) -> None:
        """Answer a request within the limits."""
        connection: _Connection = scope["state"]["connection"]
        connection.requests += 1
        length = next((value for name, value in scope["headers"] if name == b"content-length"), b"0")
        whole = length == b"0"
        answered = gone = False
        # Hundreds that are worked on at the same time would let each step of a log-in wait for all of them. A turn is
        # held neither while a body is waited for nor while an answer is taken.
        turn = connection.known or _reserved(scope)
        held = False

        async def begin() -> None:
            """Wait for a turn, where one is needed."""
            nonlocal turn, held
            if not turn:
                turn = True
                await self._turns.acquire()
                held = True

        def end() -> None:
            nonlocal held
            if held:
                held = False
                self._turns.release()

        connection.end_turn = end

        async def received() -> Any:
            nonlocal whole, gone
            message = await receive()
            gone = gone or message["type"] == "http.disconnect"
            if message["type"] == "http.request" and not message.get("more_body", False):
                whole = True
                if not answered:
                    connection.until = math.inf
                    await begin()
            return message

        async def sent(message: Any) -> None:
            nonlocal answered
            if message["type"] == "http.response.start" and self._last(connection):
                message = {**message, "headers": [*message.get("headers", ()), (b"connection", b"close")]}
            elif message["type"] == "http.response.body":
                end()
            await send(message)
            if message["type"] == "http.response.body" and not message.get("more_body", False):
                answered = True
                connection.until = time.monotonic() + (self.limits.idle if whole else self.limits.rest)

        connection.until = (
            math.inf if whole else time.monotonic() + self.limits.body + int(length) / self.limits.slowest
        )
        try:
            if whole:
                await begin()
            await self._app(scope, received, sent)
        except RuntimeError as error:
            # Starlette's middleware takes it for a fault that nobody was answered, also where nobody is left to answer.
            if not gone or str(error) != "No response returned.":
                raise
        finally:
            end()
            if not answered:  # it failed, and uvicorn says so
                connection.until = time.monotonic() + self.limits.rest

    def _last(self, connection: _Connection) -> bool:
        """Whether a stranger's connection has had its last request."""
        return connection.requests >= self.limits.each and not connection.known

    def _opened(self, connection: _Connection, send: Any) -> Callable[[Any], Any]:
        """Sender that ends the deadlines of a connection once it is a WebSocket."""
        connection.until = time.monotonic() + self.limits.header

        async def sent(message: Any) -> None:
            if message["type"] == "websocket.accept":
                connection.until = math.inf
            elif message["type"] in ("websocket.close", "websocket.http.response.start"):
                connection.until = time.monotonic() + self.limits.rest
            await send(message)

        return sent


def _reserved(scope: Any) -> bool:
    return scope["method"] == "POST" and (scope["path"] in RESERVED or scope["path"].endswith("/disable"))


def _of_most(some: Sequence[_Connection]) -> list[_Connection]:
    """Connections of the address that has the most connections."""
    [(most, _)] = Counter(one.address for one in some).most_common(1)
    return [one for one in some if one.address == most]
