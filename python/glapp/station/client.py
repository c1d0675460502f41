"""The service's API, asked in a person's name.

Nothing is believed that the API has not answered: where it does not answer, or refuses, that is an exception with the
sentence that the person is shown.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx

from ..service.trust import trusted

__all__ = ["ApiClient", "Gone", "Refused", "Unsure"]

LONGEST = 10.0
"""Longest wait for an answer [s]."""

READS = 80
"""Requests to read that run at once, of the 100 connections that httpx has: the others are for commands."""


class Gone(Exception):  # noqa: N818 - a state of the service, not a fault of the program
    """The service does not answer: nothing was done."""


class Unsure(Gone):
    """The service was asked, and its answer did not come: it may have done it."""


class Refused(Exception):  # noqa: N818 - a refusal is an answer
    """The service answered no.

    - `status`: as HTTP has it; 401: the token is good for nothing any more.
    """

    def __init__(self, text: str, status: int) -> None:
        super().__init__(text)
        self.status = status


class ApiClient:
    """The API of a service.

    - `folder`: the data folder, where the service writes down where its API is.
    - `url`: where it is instead.
    - `trust`: a certificate to trust, for an API with TLS whose certificate no public authority has signed.

    Raises InputError where the certificate cannot be used.
    """

    def __init__(self, folder: Path, url: str | None = None, trust: Path | None = None) -> None:
        self._folder, self._given = folder, url
        self._http = httpx.AsyncClient(verify=trusted(trust), timeout=LONGEST, trust_env=False)
        self._reads = asyncio.Semaphore(READS)
        self._live: dict[tuple[str, str], asyncio.Future[Any]] = {}

    @property
    def url(self) -> str:
        """Address of the service; it may have started again at another port.

        Raises Gone where nothing says so.
        """
        if self._given is not None:
            return self._given.rstrip("/")
        try:
            return (self._folder / "api-url").read_text(encoding="utf-8").strip()
        except OSError:
            raise Gone(f"the service has not told where its API is: {self._folder / 'api-url'} is not there") from None

    async def close(self) -> None:
        """Let go of its connections."""
        await self._http.aclose()

    async def log_in(self, user: str, password: str, address: str) -> dict[str, Any]:
        """A token for a user: `token`, `user`, `role`.

        - `user`, `password`: as they were typed.
        - `address`: where: the service counts tries by it, and believes it of who knows `station-key` of its folder.

        Raises Refused, Gone.
        """
        headers = {}
        with suppress(OSError):
            headers["Glapp-Station"] = (self._folder / "station-key").read_text(encoding="utf-8").strip()
            headers["Glapp-Address"] = address
        body = {"user": user, "password": password}
        found: dict[str, Any] = await self.asked("POST", "/login", None, body, headers)
        return found

    async def asked(
        self, method: str, path: str, token: str | None, body: Any = None, more: Mapping[str, str] | None = None
    ) -> Any:
        """Answer of the service; `more` are headers.

        Raises Refused, Gone.
        """
        headers = {**({} if token is None else {"Authorization": f"Bearer {token}"}), **(more or {})}
        content = None
        if method in ("POST", "PUT"):
            content = json.dumps({} if body is None else body).encode()
            headers["Content-Type"] = "application/json"
        try:
            async with self._reads if method == "GET" else nullcontext():
                reply = await self._http.request(method, self.url + path, headers=headers, content=content)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            why = _why(error)
            taken = isinstance(error, (httpx.ReadTimeout, httpx.ReadError, httpx.RemoteProtocolError))
            if taken and method != "GET":
                raise Unsure(f"the service took the request and did not say: {why}") from None
            raise Gone(f"the service does not answer: {why}") from None
        try:
            answer = reply.json()
        except ValueError:
            answer = None
        if reply.is_success:
            return answer
        detail = answer.get("detail") if isinstance(answer, dict) else None
        raise Refused(
            detail if isinstance(detail, str) else f"the service answers {reply.status_code}", reply.status_code
        )

    async def live(self, loop: str, token: str, after: float | None = None) -> dict[str, Any]:
        """The newest values of a loop; the tabs of one person that look at it at the same time ask once.

        - `loop`: which.
        - `token`: whose.
        - `after`: not before one with a PV newer than this is there [s since 1970 UTC], or a second has passed; None:
          at once.
        """
        wait = "" if after is None else f"&after={after!r}"
        path = f"/live?loop={quote(loop, safe='')}{wait}"
        asking = self._live.get((token, path))
        if asking is None:
            asking = self._live[token, path] = asyncio.ensure_future(self.asked("GET", path, token))

            def forget(one: asyncio.Future[Any]) -> None:
                """Forget the request once it is answered."""
                del self._live[token, path]
                one.cancelled() or one.exception()  # every tab that has asked may be closed by now

            asking.add_done_callback(forget)
        found: dict[str, Any] = (await asyncio.shield(asking))[loop]  # one tab that is closed ends it for no other
        return found


def _why(error: Exception) -> str:
    """Why there is no answer, and what a person can do about it."""
    if isinstance(error, httpx.TimeoutException):
        return f"no answer in {LONGEST:g} s"
    text = str(error) or type(error).__name__
    return "nobody listens at its address. Start `glapp watch`" if text == "All connection attempts failed" else text


def loop_path(loop: str, what: str) -> str:
    """Path of what concerns a loop.

    >>> loop_path("a/b", "fit")
    '/loops/a%2Fb/fit'
    """
    return f"/loops/{quote(loop, safe='')}/{what}"
