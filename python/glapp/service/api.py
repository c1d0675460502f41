"""The HTTP API of the service: commands and everything that programs read, on this computer only unless TLS is set up.

Nothing but this changes what the service does. Everybody who asks has a name and a role; every command is checked here
and put down with who, when, before and after, also where it is refused. The token goes in the header `Authorization:
Bearer …`, and nowhere else: a page of another site has no way to send it. K and Ti of the plant's own controllers
cannot be written at all.
"""

# FastAPI reads the annotations as they are: no `from __future__ import annotations` here.
import asyncio
import ipaddress
import math
import socket
import ssl
import time
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ParamSpec, TypeVar

import numpy as np
from cryptography import x509
from fastapi import Depends, FastAPI, HTTPException, Query, Request, Response
from fastapi import Path as InPath
from fastapi.exceptions import RequestValidationError
from fastapi.middleware.trustedhost import TrustedHostMiddleware
from fastapi.responses import JSONResponse
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from pydantic import BaseModel, ConfigDict, Field

from .. import __version__
from ..errors import InputError
from .listener import Listener, ListenerLimits, logged_in, network
from .monitor import Monitor
from .proof import Proof, routes
from .signal import Event
from .store import StoreFull
from .trust import expiry
from .users import Attempt, Person, Refused, RefusedLogins, Role, Users, is_station, station_key

__all__ = ["ApiServer", "app_of", "hosts_of", "loopback"]

P = ParamSpec("P")
T = TypeVar("T")

LARGEST = 65_536
"""No request may be longer [bytes]."""

HASHES = 20
"""Passwords of strangers that wait to be checked, at most; names from addresses where they have logged in go another
way.
"""

PATIENCE = 5.0
"""Longest wait of a command for the one before it [s]."""

LONGEST = 1.0
"""Longest wait of a request for a newer value [s]."""

WHY_NOT = {
    400: "A body that is no JSON",
    401: "Nobody who is logged in",
    403: "A role that may not",
    404: "No such loop, user or answer",
    409: "Not done: a rule forbids it, or it is not as it was seen",
    413: "A body that is too long, or whose length nobody says",
    422: "A value that cannot be",
    503: "Not done, since it cannot be stored; or too much is asked at once",
}
"""Answers other than the requested one."""

Begin = Annotated[float, Query(description="From when on [s since 1970 UTC].")]
End = Annotated[float, Query(description="Until when [s since 1970 UTC].")]
Most = Annotated[int, Query(ge=1, le=100_000, description="The newest, at most this many.")]
Name = Annotated[str, InPath(description="Name of the loop.", max_length=200)]


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Why(BaseModel):
    """Why there is no answer, or nothing was done."""

    detail: str


class LogIn(_Asked):
    """Login of a person."""

    user: Annotated[str, Field(max_length=64)]
    password: Annotated[str, Field(max_length=1000)]


class Seen(_Asked):
    """A command about what somebody has looked at."""

    seen: dict[str, float | None] | None = None
    """Parameters on the page that asks: where they no longer hold, the command is refused."""


class Change(Seen):
    """Parameters to set; null: as in loops.toml, or by default."""

    values: Annotated[dict[str, float | None], Field(min_length=1, max_length=40)]


class TakeOver(Seen):
    """Answer to take over."""

    answer: Annotated[int, Field(ge=1, le=2**53)]


class User(_Asked):
    """A user to be."""

    role: Annotated[str, Field(max_length=20)]
    password: Annotated[str, Field(max_length=1000)] | None = None


def app_of(monitor: Monitor, users: Users, *, hosts: Sequence[str] = ("127.0.0.1", "localhost", "[::1]")) -> FastAPI:
    """The API of a monitor.

    - `monitor`: what it opens to.
    - `users`: who may ask.
    - `hosts`: names that requests may be addressed to: another one, which a page elsewhere may have made an alias of
      this computer, is refused.
    """
    app = FastAPI(
        title="glapp watch",
        version=__version__,
        docs_url=None,
        redoc_url=None,
        responses={status: {"model": Why, "description": text} for status, text in WHY_NOT.items()},
    )
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=list(hosts))
    api, logins = _Api(monitor, users), _Logins(monitor, users)
    app.state.refused_logins = logins.refused
    _answer_errors(app)
    _login_routes(app, api, logins)
    _reading_routes(app, api)
    _loop_reading_routes(app, api)
    _command_routes(app, api)
    _user_routes(app, api)
    app.state.proof = Proof(monitor)
    viewer, operator = (Depends(api.at_least(role)) for role in (Role.VIEWER, Role.OPERATOR))
    routes(app, app.state.proof, viewer, operator, api.known, api.done, api.looked)
    _metrics_route(app, api, logins)
    return app


class _Api:
    """State that the routes share: the login, the loops, and the log of commands."""

    def __init__(self, monitor: Monitor, users: Users) -> None:
        self.monitor, self.users = monitor, users
        # Reads and strangers' passwords do not take the threads that log commands.
        self._reading = ThreadPoolExecutor(2, "looking")
        self._alone = asyncio.Lock()

    async def looked(self, what: Callable[P, T], *words: P.args, **more: P.kwargs) -> T:
        """Result of a function of the reader, called in a thread."""
        return await asyncio.get_running_loop().run_in_executor(self._reading, partial(what, *words, **more))

    def token(self, request: Request) -> str:
        kind, _, shown = request.headers.get("authorization", "").partition(" ")
        return shown if kind.lower() == "bearer" else ""

    def at_least(self, role: Role) -> Callable[[Request], Awaitable[Person]]:
        """Dependency that admits persons with at least this role."""

        async def person(request: Request) -> Person:
            found = self.users.of(self.token(request), time.time())
            if found is None:
                raise HTTPException(401, "log in first", {"WWW-Authenticate": "Bearer"})
            logged_in(request.scope)
            if found.role < role:
                why = f"needs the role {role.name.lower()}"
                path, loop = request.url.path, request.path_params.get("name")
                await self.monitor.commands.refused(found.name, found.role.name.lower(), path, loop, None, why)
                raise HTTPException(403, why)
            return found

        return person

    def known(self, name: str) -> str:
        if name not in self.monitor.loops:
            raise HTTPException(404, "no such loop")
        return name

    async def done(
        self, person: Person, command: str, loop: str | None, asked: Any, what: Coroutine[Any, Any, Any]
    ) -> Any:
        """A command, put down where it is refused as well.

        One after another, so that what a command has checked holds until it is done. Only `disable` waits for none.
        """
        try:
            if command == "disable":
                return _plain(await what)
            try:
                async with asyncio.timeout(PATIENCE):
                    await self._alone.acquire()
            except TimeoutError:
                what.close()
                text = f"another command has not been done in {PATIENCE:g} s"
                raise InputError(text, loop=loop, hint="try again") from None
            try:
                return _plain(await what)
            finally:
                self._alone.release()
        except InputError as error:
            await self.monitor.commands.refused(person.name, person.role.name.lower(), command, loop, asked, str(error))
            raise

    def as_seen(self, name: str, asked: Seen | None) -> None:
        """Refuse a command where the parameters are no longer those on the page."""
        now = _plain(self.monitor.commands.settings(self.known(name)))
        for key, value in ((asked and asked.seen) or {}).items():
            if now.get(key) != value:
                raise InputError(
                    f"is {now.get(key)} by now, and not {value}",
                    loop=name,
                    parameter=key,
                    hint="look at it again: somebody else has changed it",
                )


class _Logins:
    """Logins: their addresses, when their passwords are checked, and how refused ones are reported."""

    def __init__(self, monitor: Monitor, users: Users) -> None:
        self.monitor, self.users, self.refused = monitor, users, RefusedLogins()
        self._station_key = station_key(monitor.store.folder)
        self._hashing = {known: ThreadPoolExecutor(1, "passwords") for known in (False, True)}
        self._strangers = 0

    def came_from(self, request: Request) -> str:
        """The address of who logs in; the station says whose, and shows that it is the station."""
        if is_station(self._station_key, request.headers.get("glapp-station")):
            return request.headers.get("glapp-address", "")[:64]
        return request.client.host if request.client is not None else ""

    def refuse(self, name: str, address: str) -> None:
        """Count a refusal; the first is reported at once, and the number after it some minutes later."""
        text = self.refused.add(name if name in self.users else None, address)
        if text is not None:
            self.monitor.tell(Event(time.time(), None, "logins_refused", text))
            asyncio.get_running_loop().call_later(self.refused.every, self.tell_refused)

    def tell_refused(self) -> None:
        if (text := self.refused.since()) is not None:
            self.monitor.tell(Event(time.time(), None, "logins_refused", text))

    async def looked_at(self, attempt: Attempt, password: str) -> tuple[str, Person]:
        """Check of the password, by a thread for known persons and one for strangers: neither waits for the other."""
        until = time.monotonic() + attempt.wait
        while not attempt.displaced and (left := until - time.monotonic()) > 0.0:
            await asyncio.sleep(min(left, 0.05))
        if attempt.displaced:
            raise Refused("another login came from there after this one: try again")
        if not attempt.known and self._strangers >= HASHES:
            raise HTTPException(503, f"{self._strangers} logins wait already: try again", {"Retry-After": "5"})
        self._strangers += not attempt.known
        try:
            what = partial(self.users.log_in, attempt, password, time.time())
            return await asyncio.get_running_loop().run_in_executor(self._hashing[attempt.known], what)
        finally:
            self._strangers -= not attempt.known


def _answer_errors(app: FastAPI) -> None:
    """Bound the length of requests, and answer errors with their sentence."""

    @app.middleware("http")
    async def bounded(request: Request, go_on: Callable[[Request], Awaitable[Response]]) -> Response:
        length = request.headers.get("content-length")
        if request.method in ("POST", "PUT") and (length is None or not length.isdigit() or int(length) > LARGEST):
            return JSONResponse({"detail": f"a request has at most {LARGEST} bytes, and says how many"}, 413)
        response = await go_on(request)
        response.headers["Cache-Control"] = "no-store"
        response.headers["X-Content-Type-Options"] = "nosniff"
        return response

    @app.exception_handler(InputError)
    async def wrong(request: Request, error: InputError) -> JSONResponse:
        return JSONResponse({"detail": str(error)}, 409 if request.method != "GET" else 404)

    @app.exception_handler(RequestValidationError)
    async def not_understood(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        return JSONResponse({"detail": f"{place}: {first['msg']}"}, 422)

    @app.exception_handler(StoreFull)
    async def full(request: Request, error: StoreFull) -> JSONResponse:
        return JSONResponse({"detail": f"not done, since it cannot be stored: {error}"}, 503)


def _login_routes(app: FastAPI, api: _Api, logins: _Logins) -> None:
    """Log in and out."""
    viewer = Annotated[Person, Depends(api.at_least(Role.VIEWER))]

    @app.post("/login")
    async def log_in(request: Request, asked: LogIn) -> dict[str, Any]:
        """A token for a user, good for twelve hours."""
        address = network(logins.came_from(request))
        try:
            made, person = await logins.looked_at(
                api.users.attempt(asked.user, address, time.monotonic()), asked.password
            )
        except Refused as refused:
            logins.refuse(asked.user, address)
            raise HTTPException(401, str(refused), {"WWW-Authenticate": "Bearer"}) from None
        except StoreFull as full:
            # The window asks the database whether a login stands: one in memory alone would be none there.
            raise HTTPException(
                503,
                f"name and password are right, but nobody can log in until the service can write: {full}; make room on "
                "its disk, then log in again. Who is logged in stays so",
            ) from None
        logged_in(request.scope)
        return {"token": made, "user": person.name, "role": person.role.name.lower()}

    @app.post("/logout")
    async def log_out(request: Request, person: viewer) -> dict[str, Any]:
        """The token is good for nothing any more."""
        await asyncio.to_thread(api.users.log_out, api.token(request))
        return {}


def _reading_routes(app: FastAPI, api: _Api) -> None:
    """Routes that programs and the station read, of the whole plant."""
    viewer = Annotated[Person, Depends(api.at_least(Role.VIEWER))]

    @app.get("/status")
    async def status(person: viewer) -> dict[str, Any]:
        """The service, and every loop: last seen, estimate, answer, compensation."""
        found: dict[str, Any] = _plain(api.monitor.status())
        return found

    @app.get("/live")
    async def live(
        person: viewer,
        loop: Annotated[list[str] | None, Query(max_length=5000)] = None,
        after: Annotated[
            float | None,
            Query(description="Not before one of the loops that are named has a PV newer than this, or 1 s is over."),
        ] = None,
    ) -> dict[str, Any]:
        """The newest values of loops, of all where none is named."""
        names = [api.known(name) for name in loop or api.monitor.loops]
        if loop and after is not None:
            until = time.monotonic() + LONGEST
            while time.monotonic() < until and not any(api.monitor.ingest.newer(name, after) for name in names):
                await asyncio.sleep(0.02)
        return {name: api.monitor.ingest.live(name) for name in names}

    @app.get("/answers/{id}")
    async def answer(person: viewer, id: Annotated[int, InPath(ge=1, le=2**53)]) -> Any:
        """All of one answer, as `glapp analyze --json` writes it."""
        found = await api.looked(api.monitor.reader.document, id)
        if found is None:
            raise HTTPException(404, "no such answer")
        return found

    @app.get("/events")
    async def events(
        person: viewer,
        loop: str | None = None,
        most: Most = 200,
        before: Annotated[int | None, Query(ge=0, le=2**53)] = None,
    ) -> list[dict[str, Any]]:
        """Events, the newest first."""
        return await api.looked(api.monitor.reader.events, loop, most, before)

    @app.get("/commands")
    async def commands(person: viewer, loop: str | None = None, most: Most = 200) -> list[dict[str, Any]]:
        """Commands with the names of those who asked, the newest first."""
        found: list[dict[str, Any]] = _plain(await api.looked(api.monitor.reader.commands, loop, most))
        return found


def _loop_reading_routes(app: FastAPI, api: _Api) -> None:
    """Routes that programs and the station read, of one loop."""
    viewer = Annotated[Person, Depends(api.at_least(Role.VIEWER))]

    @app.get("/loops/{name:path}/half_periods")
    async def half_periods(
        person: viewer,
        name: Name,
        begin: Begin = -1e12,
        end: End = 1e12,
        accepted: bool = True,
        most: Most = 10_000,
    ) -> list[dict[str, Any]]:
        """Half-periods of a loop, with the record of each; the accepted ones are its detections."""
        found = await api.looked(
            api.monitor.reader.half_periods, api.known(name), begin, end, accepted=accepted, most=most
        )
        return found

    @app.get("/loops/{name:path}/signals")
    async def signals(person: viewer, name: Name, begin: Begin, end: End, most: Most = 10_000) -> dict[str, Any]:
        """Samples of a loop as they are kept, every so many of them where there are more than asked for."""
        if not end - begin <= 32 * 86400.0:
            raise HTTPException(422, "end - begin must be at most 32 days")
        table = await api.looked(api.monitor.journal.recorded, api.known(name), begin, end)
        every = max(1, -(-len(table) // most))
        found: dict[str, Any] = table.take(np.arange(0, len(table), every)).to_pydict()
        found["time"] = [at.timestamp() for at in found["time"]]
        return {"every": every, **_plain(found)}

    @app.get("/loops/{name:path}/parameters")
    async def parameters(person: viewer, name: Name) -> dict[str, Any]:
        """Settable parameters of a loop, as in force."""
        found: dict[str, Any] = _plain(api.monitor.commands.settings(api.known(name)))
        return found

    @app.get("/loops/{name:path}/bounds")
    async def bounds(person: viewer, name: Name) -> dict[str, dict[str, Any]]:
        """Unit, least and greatest of what may be set of a loop, whether it may be 0, whether it is a whole number."""
        return {parameter: bound._asdict() for parameter, bound in api.monitor.commands.bounds(api.known(name)).items()}

    @app.get("/loops/{name:path}/answers")
    async def answers(person: viewer, name: Name, most: Most = 100) -> list[dict[str, Any]]:
        """Answers of a loop's fits, the newest first."""
        return await api.looked(api.monitor.reader.answers, api.known(name), most)


def _command_routes(app: FastAPI, api: _Api) -> None:
    """Routes that change a loop, by the name of the person who asks."""
    operator = Annotated[Person, Depends(api.at_least(Role.OPERATOR))]
    engineer = Annotated[Person, Depends(api.at_least(Role.ENGINEER))]

    @app.post("/loops/{name:path}/parameters")
    async def change(person: engineer, name: Name, asked: Change) -> dict[str, Any]:
        """Set parameters of a loop's detector or compensation, all of them or none."""

        async def go() -> Any:
            api.as_seen(name, asked)
            return await api.monitor.commands.change(name, asked.values, *_name_and_role(person))

        found: dict[str, Any] = await api.done(person, "change", api.known(name), asked.model_dump(), go())
        return found

    @app.post("/loops/{name:path}/enable")
    async def enable(person: engineer, name: Name, asked: Seen | None = None) -> dict[str, Any]:
        """Let a loop be compensated, by the name of who asks."""

        async def go() -> Any:
            api.as_seen(name, asked)
            return await api.monitor.commands.enable(name, *_name_and_role(person))

        found: dict[str, Any] = await api.done(person, "enable", api.known(name), None, go())
        return found

    @app.post("/loops/{name:path}/watchdog-test")
    async def watchdog_test(person: engineer, name: Name) -> dict[str, Any]:
        """Try whether the plant takes u_FF away when its watchdog stands still; events report the result."""
        await api.done(
            person, "drill", name, None, api.monitor.commands.watchdog_test(api.known(name), *_name_and_role(person))
        )
        return {"asked": name}

    @app.post("/loops/{name:path}/disable")
    async def disable(person: operator, name: Name) -> dict[str, Any]:
        """End the compensation of a loop."""
        going = api.monitor.commands.disable(api.known(name), *_name_and_role(person))
        found: dict[str, Any] = await api.done(person, "disable", name, None, going)
        return found

    @app.post("/loops/{name:path}/fit")
    async def fit(person: operator, name: Name) -> dict[str, Any]:
        """Have a loop fitted as soon as the one before it is done."""
        await api.monitor.commands.fit(api.known(name), *_name_and_role(person))
        return {"asked": name}

    @app.post("/loops/{name:path}/take_over")
    async def take_over(person: engineer, name: Name, asked: TakeOver) -> dict[str, Any]:
        """Take over a fit's result."""

        async def go() -> Any:
            api.as_seen(name, asked)
            return await api.monitor.commands.take_over(name, asked.answer, *_name_and_role(person))

        found: dict[str, Any] = await api.done(person, "take_over", api.known(name), {"answer": asked.answer}, go())
        return found


def _user_routes(app: FastAPI, api: _Api) -> None:
    """Users, by an engineer."""
    engineer = Annotated[Person, Depends(api.at_least(Role.ENGINEER))]

    @app.get("/users")
    async def all_users(person: engineer) -> list[dict[str, str]]:
        """Name and role of every user."""
        return await api.looked(api.monitor.reader.users)

    @app.put("/users/{user}")
    async def put_user(person: engineer, user: Annotated[str, InPath(max_length=64)], asked: User) -> dict[str, Any]:
        """Add a user, or change role or password of one."""
        before = {one["name"]: one["role"] for one in await api.looked(api.monitor.reader.users)}.get(user)

        async def go() -> None:
            await asyncio.to_thread(api.users.put, user, asked.role, asked.password, time.time())

        await api.done(person, "put_user", None, {"user": user, "role": asked.role}, go())
        after = {"user": user, "role": asked.role, "new_password": asked.password is not None}
        await api.monitor.journal.log(*_name_and_role(person), "put_user", None, {"user": user, "role": before}, after)
        return {"user": user, "role": asked.role}

    @app.delete("/users/{user}")
    async def remove_user(person: engineer, user: Annotated[str, InPath(max_length=64)]) -> dict[str, Any]:
        """Remove a user."""

        async def go() -> None:
            await asyncio.to_thread(api.users.remove, user)

        await api.done(person, "remove_user", None, {"user": user}, go())
        await api.monitor.journal.log(*_name_and_role(person), "remove_user", None, {"user": user}, None)
        return {}


def _metrics_route(app: FastAPI, api: _Api, logins: _Logins) -> None:
    """Route of the numbers for Prometheus."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Numbers(api.monitor, logins.refused))

    @app.get("/metrics", responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}})
    async def metrics(request: Request) -> Response:
        """Metrics for Prometheus: open on this computer, by a viewer's token from elsewhere."""
        host = request.client.host if request.client is not None else ""
        if not loopback(host):
            await api.at_least(Role.VIEWER)(request)
        return Response(generate_latest(registry), media_type="text/plain; version=0.0.4; charset=utf-8")


class _Numbers(Collector):
    """Numbers for Prometheus."""

    def __init__(self, monitor: Monitor, refused_logins: RefusedLogins) -> None:
        self._monitor, self._refused_logins = monitor, refused_logins

    def collect(self) -> list[Metric]:
        """Numbers of the service and of every loop."""
        status = self._monitor.status()
        loops: dict[str, dict[str, Any]] = status["loops"]
        found: list[Metric] = [
            _gauge("glapp_up_seconds", "Time since the service began", status["now"] - status["begun"]),
            _gauge("glapp_store_failing", "1 where the store cannot be written", float(bool(status["failing"]))),
            _gauge("glapp_database_damaged", "1 while a damaged database is set aside", float(bool(status["damaged"]))),
            _gauge("glapp_entries_waiting", "Entries that wait for the disk", status["waiting"]),
        ]
        of_loops: dict[str, tuple[str, Callable[[dict[str, Any]], Any]]] = {
            "glapp_seen_seconds": (
                "Age of the newest PV",
                lambda s: None if s["seen"] is None else status["now"] - s["seen"],
            ),
            "glapp_good": ("1 where the newest PV is good", lambda s: None if s["good"] is None else float(s["good"])),
            "glapp_dead_band_estimate": (
                "Estimate of the dead band by zero crossings, in OP units",
                lambda s: s["estimate"],
            ),
            "glapp_dead_band": (
                "Width of the gap by the last fit, in OP units",
                lambda s: (s["answer"] or {}).get("d"),
            ),
            "glapp_compensation_enabled": (
                "1 where u_FF is made",
                lambda s: float(s["compensation"]["enabled"]) if "compensation" in s else None,
            ),
            "glapp_u_ff": ("u_FF, in OP units", lambda s: s["compensation"]["u_ff"] if "compensation" in s else None),
        }
        for name, (text, value) in of_loops.items():
            gauge = GaugeMetricFamily(name, text, labels=["loop"])
            for loop, shown in loops.items():
                if (number := value(shown)) is not None:
                    gauge.add_metric([loop], number)
            found.append(gauge)
        for name, text, key in (
            ("glapp_half_periods", "Half-periods", "half_periods"),
            ("glapp_detections", "Accepted half-periods", "accepted"),
            ("glapp_values_dropped", "Values that came late or twice", "dropped"),
        ):
            counter = CounterMetricFamily(name, text, labels=["loop"])
            for loop, shown in loops.items():
                counter.add_metric([loop], shown[key])
            found.append(counter)
        found.append(CounterMetricFamily("glapp_logins_refused", "Logins refused", value=self._refused_logins.total))
        return found


def _gauge(name: str, text: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, text, value=value)


class ApiServer:
    """The API, open: served beside the monitor, in the same loop.

    - `app`: what `app_of` made.
    - `host`: the address that it listens at.
    - `port`: 0: any that is free.
    - `certificate`, `key`: for TLS; needed for any address that is not this computer's own.
    - `limits`: how many connections and requests are taken, and how long they may be waited for.
    - `names`: host names that it is asked by; `url` has the first where `host` is every address of this computer.

    Raises InputError for an address of the network without TLS.
    """

    def __init__(
        self,
        app: FastAPI,
        host: str,
        port: int,
        certificate: Path | None = None,
        key: Path | None = None,
        limits: ListenerLimits | None = None,
        names: Sequence[str] = (),
    ) -> None:
        self._certificate: tuple[Path, x509.Certificate] | None = None
        if (certificate is None) != (key is None):
            raise InputError("certificate and key are given together", parameter="certificate")
        if certificate is None and not loopback(host):
            raise InputError(
                f"is {host}, which others reach, and passwords would be readable on their way",
                parameter="host",
                value=host,
                hint="give a certificate and its key, or leave it at 127.0.0.1",
            )
        if certificate is not None:
            try:
                ssl.create_default_context(ssl.Purpose.CLIENT_AUTH).load_cert_chain(certificate, key)
                self._certificate = certificate, x509.load_pem_x509_certificates(certificate.read_bytes())[0]
            except (OSError, ssl.SSLError, ValueError) as error:
                raise InputError(f"cannot be used: {error}", file=str(certificate)) from None
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            self._socket = socket.create_server((host.strip("[]"), port), family=family, backlog=1024)
        except OSError as error:
            what = f"{host}:{port} cannot be listened at: {error.strerror or error}"
            raise InputError(what, parameter="host and port", value=port, hint="give another --port") from None
        self.port: int = self._socket.getsockname()[1]
        named = names[0] if names and host.strip("[]") in ("0.0.0.0", "::") else host
        self.url = f"{'http' if certificate is None else 'https'}://{_in_url(named)}:{self.port}"
        self._server = Listener(app, limits, ssl_certfile=certificate, ssl_keyfile=key)

    def expiring(self) -> str | None:
        """Sentence on a certificate that has expired, or soon will; else None."""
        return None if self._certificate is None else expiry(*self._certificate, "put a new one there, and start again")

    async def open(self) -> None:
        """Serve until cancelled."""
        serving = asyncio.create_task(self._server.serve(sockets=[self._socket]))
        try:
            await asyncio.shield(serving)
        except asyncio.CancelledError:
            self._server.should_exit = True
            await serving
            raise


def _name_and_role(person: Person) -> tuple[str, str]:
    return person.name, person.role.name.lower()


def hosts_of(host: str, names: Sequence[str]) -> tuple[str, ...]:
    """Names that requests may be addressed to.

    - `host`: the address that is listened at.
    - `names`: other names of this computer.

    >>> hosts_of("2001:db8::5", ["plant.example"])
    ('127.0.0.1', 'localhost', '[::1]', '[2001:db8::5]', 'plant.example')
    """
    return ("127.0.0.1", "localhost", "[::1]", _in_url(host), *names)


def _in_url(host: str) -> str:
    """An address as it stands in a URL: of IPv6 in brackets."""
    return f"[{host.strip('[]')}]" if ":" in host else host


def loopback(host: str) -> bool:
    """Whether an address is this computer's own, which nobody else reaches."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def _plain(value: Any) -> Any:
    """A value with None for what JSON has no number for."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
