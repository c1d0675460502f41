"""Who is logged in to the window, and what keeps others out.

A session is a random number in a cookie that no script can read and no other site can send; the service's token stays
in this process, and on no disk. Whoever has no session gets the login page. Whatever changes something, and the
connection that pages live by, must come from a page of ours: `Origin` says so, and no page can forge it.
"""

from __future__ import annotations

import secrets
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..service.users import LOGIN_LASTS, Role

__all__ = ["COOKIE", "Guard", "Session", "Sessions", "Tries"]

COOKIE = "glapp-station"

TRIES = 10
"""So many logins may be tried from one address within `WITHIN`."""

WITHIN = 60.0
"""[s]"""

OPEN = ("/login", "/static/", "/api/")
"""Paths for whoever comes; what is under /api asks by itself who it is."""

LARGEST = 65_536
"""No request of somebody who is not logged in may be longer [bytes], …"""

LARGEST_FILE = 64_000_000
"""… and none at all: a recording that is to be read is the longest there is [bytes]."""

FOR_PROGRAMS = "/api/login"
"""What a program posts to: it sets no cookie, so that a page elsewhere has nothing of it."""

POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; font-src 'self' data:; connect-src 'self'; object-src 'none'; base-uri 'self'; "
    "form-action 'self'; frame-ancestors 'none'"
)
"""Pages load from here and from nowhere else. The library's pages evaluate scripts of their own, and need that."""


@dataclass(slots=True)
class Session:
    """Somebody who is logged in.

    Attributes
    ----------
    id : str
        The cookie.
    token : str
        The service's, in that person's name.
    user, role : str
        As the service knows them.
    dark : bool
        Whether pages are dark.
    until : float
        When it is over [s since 1970 UTC].
    """

    id: str = field(repr=False)  # neither may stand in a log
    token: str = field(repr=False)
    user: str
    role: str
    dark: bool
    until: float

    def may(self, role: str) -> bool:
        """Whether the person may what a role may.

        >>> Session("", "", "olaf", "operator", False, 0.0).may("engineer")
        False
        """
        return Role.named(self.role) >= Role.named(role)


@dataclass
class Tries:
    """How often a login was tried from where.

    Examples
    --------
    >>> tries = Tries()
    >>> [tries.wait("10.0.0.7", 100.0) for _ in range(TRIES + 1)][-2:]
    [0.0, 60.0]
    >>> tries.wait("10.0.0.8", 100.0)
    0.0
    """

    _seen: dict[str, deque[float]] = field(default_factory=dict)

    def wait(self, address: str, now: float) -> float:
        """Count a try; gives how long that address has to wait before it [s], 0 where it need not."""
        if len(self._seen) > 10_000:
            self._seen = {key: seen for key, seen in self._seen.items() if seen and now - seen[-1] < WITHIN}
        seen = self._seen.setdefault(address, deque(maxlen=TRIES))
        if len(seen) == TRIES and now - seen[0] < WITHIN:
            return WITHIN - (now - seen[0])
        seen.append(now)
        return 0.0


class Sessions:
    """All who are logged in.

    Parameters
    ----------
    clock : callable
        The time [s since 1970 UTC].
    """

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
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
        """The session of an id; None where there is none, or no longer."""
        found = self._all.get(id)
        return found if found is not None and found.until > self._clock() else None

    def end(self, id: str) -> None:
        """It is over."""
        self._all.pop(id, None)


class Guard:
    """What every request passes through first.

    Parameters
    ----------
    app : ASGI application
        The pages behind it.
    sessions : Sessions
        Who is logged in.
    hosts : sequence of str
        Names that requests may be addressed to: another one, which a page elsewhere may have made to stand for this
        computer, is refused.
    secure : bool
        Whether it is served by TLS.
    """

    def __init__(self, app: ASGIApp, sessions: Sessions, hosts: tuple[str, ...], *, secure: bool) -> None:
        self._app, self._sessions, self._hosts, self._secure = app, sessions, hosts, secure

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through, or not."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        answer = self._refusal(scope)
        if answer is None:
            await self._app(scope, receive, self._with_headers(scope, send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": "log in first"})
        else:
            await answer(scope, receive, self._with_headers(scope, send))

    def _refusal(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if _name(host) not in self._hosts:
            return PlainTextResponse("this window has another name", 400)
        origin, path = headers.get("origin"), scope["path"]
        changes = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD", "OPTIONS")
        if scope["type"] == "http" and changes:
            length = headers.get("content-length", "0" if "transfer-encoding" not in headers else "")
            most = LARGEST if self._sessions.of(headers.get("cookie")) is None else LARGEST_FILE
            if not length.isdigit() or int(length) > most:
                return PlainTextResponse(f"a request has at most {most} bytes, and says how many", 413)
        changes = changes and path != FOR_PROGRAMS
        if (changes or origin is not None) and origin != f"{'https' if self._secure else 'http'}://{host}":
            return PlainTextResponse("refused: this does not come from a page of this window", 403)
        if any(path == one or (one.endswith("/") and path.startswith(one)) for one in OPEN):
            return None
        if self._sessions.of(headers.get("cookie")) is None:
            if scope["type"] == "http" and scope["method"] == "GET" and not path.startswith("/_nicegui"):
                return RedirectResponse("/login", 303)
            return PlainTextResponse("log in first", 401)
        return None

    def _with_headers(self, scope: Scope, send: Send) -> Send:
        kept = scope["path"].startswith(("/_nicegui/", "/static/"))
        more: list[tuple[bytes, bytes]] = [
            (b"content-security-policy", POLICY.encode()),
            (b"x-content-type-options", b"nosniff"),
            (b"referrer-policy", b"same-origin"),
        ]
        if not kept:
            more.append((b"cache-control", b"no-store"))

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                names = {name for name, _ in more}
                old: list[Any] = [pair for pair in message.get("headers", []) if pair[0].lower() not in names]
                message = {**message, "headers": [*old, *more]}
            await send(message)

        return sent


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
