"""Logins of the window, and its guards against strangers.

A session is a random number in a cookie that no script can read and no other site can send; the service's token stays
in this process, and on no disk. It is over when the service's token is: each request asks the service's database
whether the token stands, and an open page's connection asks it every `LOOKED` seconds. So whoever is removed, or has
another role or password, reads nothing any more. Whoever has no session gets the login page. Whatever changes
something, and the connection that pages live by, must come from a page of ours: `Origin` says so, and no page can forge
it.
"""

from __future__ import annotations

import asyncio
import secrets
import sqlite3
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlencode, urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..errors import InputError
from ..service.listener import logged_in
from ..service.store import NAME, Reader
from ..service.users import LOGIN_LASTS, Role, digest_of

__all__ = ["COOKIE", "Guard", "Session", "Sessions", "Tokens"]

COOKIE = "glapp-station"

LOOKED = 0.25
"""After so long the connection of an open page finds out that its session is over [s]."""

OPEN = ("/login", "/static/", "/api/")
"""Paths for everybody; those under /api check the login themselves."""

ENDING = ("/login", "/logout")
"""A session that was there before may be over after these."""

LARGEST = 65_536
"""No request of somebody who is not logged in may be longer [bytes], …"""

LARGEST_FILE = 64_000_000
"""… and none at all: a recording that is to be read is the longest there is [bytes]."""

FOR_PROGRAMS = "/api/"
"""Path for programs: nothing is changed there, and no cookie set, so that a page elsewhere gets nothing from it."""

POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; font-src 'self' data:; connect-src 'self'; object-src 'none'; base-uri 'self'; "
    "form-action 'self'; frame-ancestors 'none'"
)
"""Pages load from here and from nowhere else. The library's pages evaluate scripts of their own, and need that."""


@dataclass(slots=True)
class Session:
    """Somebody who is logged in.

    - `id`: the cookie.
    - `token`: the service's, in that person's name.
    - `user`, `role`: as the service knows them.
    - `dark`: whether pages are dark.
    - `until`: when it is over [s since 1970 UTC].
    - `chosen`: whether the person has chosen light or dark; else pages are as the person's system is.
    """

    id: str = field(repr=False)  # neither may stand in a log
    token: str = field(repr=False)
    user: str
    role: str
    dark: bool
    until: float
    chosen: bool = False

    def may(self, role: str) -> bool:
        """Whether the person has the rights of a role.

        >>> Session("", "", "olaf", "operator", False, 0.0).may("engineer")
        False
        """
        return Role.named(self.role) >= Role.named(role)


class Tokens:
    """The service's tokens, by its database: whose they are now.

    - `folder`: the service's data folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._reader: Reader | None = None
        self._opened: tuple[int, int] | None = None

    def of(self, token: str, now: float) -> tuple[str, str] | None:
        """Name and role of a token's owner; None where it does not, or no longer.

        Raises InputError where the database is not there, or cannot be read.
        """
        try:
            stat = (self._folder / NAME).stat()
            found = (stat.st_dev, stat.st_ino)
        except OSError:
            raise InputError(f"holds no {NAME}", file=str(self._folder), hint="start glapp watch on it") from None
        try:
            if self._reader is None or self._opened != found:  # the service has set the old one aside
                self._close()
                self._reader, self._opened = Reader(self._folder), found
                self._reader.wait_at_most(200)  # all requests wait for this one
            return self._reader.login(digest_of(token), now)
        except sqlite3.Error as error:
            self._close()
            raise InputError(f"cannot be read: {error}", file=str(self._folder / NAME)) from None

    def _close(self) -> None:
        if self._reader is not None:
            self._reader.close()
        self._reader = None


class Sessions:
    """All who are logged in.

    - `tokens`: whom the service's tokens stand for.
    - `clock`: the time [s since 1970 UTC].
    """

    def __init__(self, tokens: Tokens, clock: Callable[[], float] = time.time) -> None:
        self._tokens = tokens
        self._clock = clock
        self._all: dict[str, Session] = {}

    def begin(self, token: str, user: str, role: str, *, dark: bool) -> Session:
        """A new session."""
        now = self._clock()
        self._all = {id: one for id, one in self._all.items() if one.until > now}
        made = Session(secrets.token_urlsafe(32), token, user, role, dark, now + LOGIN_LASTS)
        self._all[made.id] = made
        return made

    def of(self, cookies: str | None) -> Session | None:
        """The session that a `Cookie` header belongs to; None where there is none, or no longer."""
        try:
            morsel = SimpleCookie(cookies or "").get(COOKIE)
        except CookieError:
            return None
        return None if morsel is None else self.by_id(morsel.value)

    def by_id(self, id: str) -> Session | None:
        """The session of an id; None where there is none, or no longer.

        Where the database cannot be read it stays: nothing is read from there then that was not shown before, and what
        the service is asked for it is asked for with the token.
        """
        found, now = self._all.get(id), self._clock()
        if found is None:
            return None
        try:
            stands = found.until > now and self._tokens.of(found.token, now) == (found.user, found.role)
        except InputError:
            stands = True
        if not stands:
            self.end(id)
            return None
        return found

    def token(self, token: str) -> bool:
        """Whether a token of the service stands.

        Raises InputError where the database is not there, or cannot be read.
        """
        return self._tokens.of(token, self._clock()) is not None

    def end(self, id: str) -> None:
        """End the session."""
        self._all.pop(id, None)


class Guard:
    """Guard that every request passes first.

    - `app`: the pages behind it.
    - `sessions`: who is logged in.
    - `hosts`: names that requests may be addressed to: another one, which a page elsewhere may have made to stand for
      this computer, is refused.
    - `secure`: whether it is served by TLS.
    """

    def __init__(self, app: ASGIApp, sessions: Sessions, hosts: tuple[str, ...], *, secure: bool) -> None:
        self._app, self._sessions, self._hosts, self._secure = app, sessions, hosts, secure

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through, or not."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        session = self._sessions.of(Headers(scope=scope).get("cookie"))
        answer = self._refusal(scope, session)
        if session is not None:
            logged_in(scope)
        if scope["type"] == "websocket":
            if answer is not None or session is None:
                await send({"type": "websocket.close", "code": 1008, "reason": "log in first"})
            else:
                await self._while_it_lasts(session, scope, receive, send)
        elif answer is None:
            await self._app(scope, receive, self._with_headers(scope, send, session))
        else:
            await answer(scope, receive, self._with_headers(scope, send))

    def _lasts(self, session: Session) -> bool:
        return self._sessions.by_id(session.id) is not None

    async def _while_it_lasts(self, session: Session, scope: Scope, receive: Receive, send: Send) -> None:
        """The connection of a page, closed when the session is over; nothing is sent by it afterwards."""

        async def lasts() -> None:
            while self._lasts(session):
                await asyncio.sleep(LOOKED)

        over = asyncio.create_task(lasts())

        async def received() -> Message:
            getting = asyncio.ensure_future(receive())
            try:
                await asyncio.wait({getting, over}, return_when=asyncio.FIRST_COMPLETED)
                if not over.done():
                    return getting.result()
            finally:
                getting.cancel()
            with suppress(OSError):  # the page may be gone
                await send({"type": "websocket.close", "code": 1008, "reason": "the login is over"})
            return {"type": "websocket.disconnect", "code": 1008}

        async def sent(message: Message) -> None:
            if not over.done():
                await send(message)

        try:
            await self._app(scope, received, sent)
        finally:
            over.cancel()

    def _refusal(self, scope: Scope, session: Session | None) -> Response | None:
        """Response that refuses a request; None where it may pass."""
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if _name(host) not in self._hosts:
            return PlainTextResponse("this window has another name", 400)
        origin, path = headers.get("origin"), scope["path"]
        changes = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD", "OPTIONS")
        if scope["type"] == "http" and changes:
            length = "" if "transfer-encoding" in headers else headers.get("content-length", "0")
            most = LARGEST if session is None else LARGEST_FILE
            if not length.isdigit() or int(length) > most:
                return PlainTextResponse(f"a request has at most {most} bytes, and says how many", 413)
        changes = changes and not path.startswith(FOR_PROGRAMS)
        if (changes or origin is not None) and origin != f"{'https' if self._secure else 'http'}://{host}":
            return PlainTextResponse("refused: this does not come from a page of this window", 403)
        if any(path == one or (one.endswith("/") and path.startswith(one)) for one in OPEN):
            return None
        if session is None:
            if scope["type"] == "http" and scope["method"] == "GET" and not path.startswith("/_nicegui"):
                return RedirectResponse(f"/login{_to_loop(scope)}", 303)
            return PlainTextResponse("log in first", 401)
        return None

    def _with_headers(self, scope: Scope, send: Send, session: Session | None = None) -> Send:
        """An answer with what every answer says; where a session is over by then, that instead."""
        kept = scope["path"].startswith(("/_nicegui/", "/static/"))
        more: list[tuple[bytes, bytes]] = [
            (b"content-security-policy", POLICY.encode()),
            (b"x-content-type-options", b"nosniff"),
            (b"referrer-policy", b"same-origin"),
        ]
        if not kept:
            more.append((b"cache-control", b"no-store"))

        over = False

        async def sent(message: Message) -> None:
            nonlocal over
            begins = message["type"] == "http.response.start"
            if begins and session is not None and scope["path"] not in ENDING and not self._lasts(session):
                over = True
                await PlainTextResponse("log in first", 401)(scope, _nothing, self._with_headers(scope, send))
            if over:
                return
            if begins:
                names = {name for name, _ in more}
                old: list[Any] = [pair for pair in message.get("headers", []) if pair[0].lower() not in names]
                message = {**message, "headers": [*old, *more]}
            await send(message)

        return sent


def _to_loop(scope: Scope) -> str:
    """The loop that a page was asked for, for after the login.

    >>> _to_loop({"path": "/loop", "query_string": b"name=FIC%2F1"}), _to_loop({"path": "/", "query_string": b""})
    ('?loop=FIC%2F1', '')
    """
    name = dict(parse_qsl(scope["query_string"].decode("latin-1"))).get("name", "")
    return f"?{urlencode({'loop': name})}" if scope["path"] == "/loop" and name else ""


async def _nothing() -> Message:
    return {"type": "http.disconnect"}


def _name(host: str) -> str:
    """The name in a `Host` header, without the port.

    >>> _name("127.0.0.1:8108"), _name("[::1]:8108"), _name("")
    ('127.0.0.1', '[::1]', '')
    """
    try:
        found = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
    return f"[{found}]" if ":" in found else found
