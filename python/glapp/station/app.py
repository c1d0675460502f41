"""The window as an application: login, pages, guard; and served."""

# FastAPI reads the annotations as they are: no `from __future__ import annotations` here.
import asyncio
from collections.abc import Sequence
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import Annotated
from urllib.parse import urlencode

from fastapi import FastAPI, Form
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from fastapi.staticfiles import StaticFiles
from nicegui import app as pages
from nicegui import ui
from starlette.requests import Request

from ..service.listener import logged_in
from ..service.users import LOGIN_LASTS
from .api import api_of
from .client import Gone, Refused
from .lab_page import Bench, lab_page
from .loop_page import loop_page
from .pages import Station, all_events, events_page, overview_page
from .sessions import COOKIE, Guard
from .view import as_csv

__all__ = ["app_of"]

HERE = Path(__file__).parent

WHY = {"expired": "Your login is over. Log in again.", "": ""}


def _login(message: str, status: int = 401, *, loop: str = "", known: tuple[str, str] = ("", "")) -> HTMLResponse:
    """The login page; it needs no script but to tell whether the person's screen is dark.

    - `message`: why it is shown again.
    - `status`: of the reply.
    - `loop`: whose page it leads to.
    - `known`: name and password that are filled in.
    """
    user, password = (escape(text) for text in known)
    demo = "<p>A demonstration: name and password are filled in.</p>" if password else ""
    focus = " autofocus"
    text = f'<p role="alert" class="medium">{escape(message)}</p>' if message else ""
    return HTMLResponse(
        f"""<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Log in – glapp</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="stylesheet" href="/static/station.css"></head>
<body class="login"><form class="card" method="post" action="/login"><h1>glapp station</h1>{demo}{text}
<label for="user">Name</label>
<input id="user" name="user" value="{user}" autocomplete="username" required maxlength="64"{"" if user else focus}>
<label for="password">Password</label>
<input id="password" name="password" type="password" value="{password}" autocomplete="current-password"
 required maxlength="1000"{focus if user else ""}><input type="hidden" name="loop" value="{escape(loop)}">
<input type="hidden" id="dark" name="dark" value=""><button>Log in</button></form>
<script>if (matchMedia("(prefers-color-scheme: dark)").matches) {{ document.body.classList.add("dark");
document.getElementById("dark").value = "1"; }}</script></body></html>""",
        status,
    )


def _no_page() -> HTMLResponse:
    return HTMLResponse(
        """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>No such page – glapp</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="stylesheet" href="/static/station.css"></head>
<body class="login"><main class="card"><h1>There is no such page</h1>
<p>The address may be mistyped. <a href="/">Overview</a></p></main>
<script>if (matchMedia("(prefers-color-scheme: dark)").matches) document.body.classList.add("dark");</script>
</body></html>""",
        404,
    )


def _first_login(path: Path | None) -> tuple[str, str]:
    """Name and password of a demonstration's first user; two empty texts without one."""
    if path is None or not path.is_file():
        return "", ""
    login = dict(line.split(" ", 1) for line in path.read_text(encoding="utf-8").splitlines() if " " in line)
    return login.get("user", ""), login.get("password", "")


def app_of(station: Station, hosts: Sequence[str], *, secure: bool, first_login: Path | None = None) -> FastAPI:
    """The window of a station; once in a process, since the library has one set of pages.

    - `station`: what the pages stand on.
    - `hosts`: names that it may be addressed by.
    - `secure`: whether it is served by TLS.
    - `first_login`: `first-login.txt` of a demonstration: name and password in it stand on the login page. Never given
      for a plant.
    """
    app = FastAPI(title="glapp station", docs_url=None, redoc_url=None, openapi_url=None)
    app.mount("/api", api_of(station))
    app.mount("/static", StaticFiles(directory=HERE / "static"))
    bench = Bench()
    _login_routes(app, station, first_login, secure=secure)
    _session_routes(app, station)
    _exports(app, station)
    _pages(station, bench)
    _work(station, bench)
    ui.run_with(
        app, title="glapp", language="en-US", tailwind=False, show_welcome_message=False, reconnect_timeout=10.0
    )
    app.add_middleware(Guard, sessions=station.sessions, hosts=tuple(hosts), secure=secure)
    return app


def _login_routes(app: FastAPI, station: Station, first_login: Path | None, *, secure: bool) -> None:
    """Login and logout; the arguments are those of `app_of`."""

    @app.get("/login")
    async def log_in_page(why: str = "", loop: str = "") -> Response:
        return _login(WHY.get(why, ""), 200, loop=loop[:200], known=_first_login(first_login))

    @app.post("/login")
    async def log_in(
        request: Request,
        user: Annotated[str, Form(max_length=64)],
        password: Annotated[str, Form(max_length=1000)],
        dark: Annotated[str, Form(max_length=1)] = "",
        loop: Annotated[str, Form(max_length=200)] = "",
    ) -> Response:
        address = request.client.host if request.client is not None else ""
        try:
            found = await station.api.log_in(user, password, address)
        except (Gone, Refused) as error:
            message = str(error)
            status = 503 if isinstance(error, Gone) or error.status == 503 else 401
            return _login(f"{message[:1].upper()}{message[1:]}.", status, loop=loop, known=(user, ""))
        session = station.sessions.begin(found["token"], found["user"], found["role"], dark=bool(dark))
        logged_in(request.scope)
        # A link to a loop that was sent on leads there after the login; never anywhere else.
        reply = RedirectResponse(f"/loop?{urlencode({'name': loop})}" if loop else "/", 303)
        reply.set_cookie(
            COOKIE, session.id, max_age=int(LOGIN_LASTS), httponly=True, samesite="strict", secure=secure, path="/"
        )
        return reply

    @app.post("/logout")
    async def log_out(request: Request) -> Response:
        session = station.who(request)
        station.sessions.end(session.id)
        with suppress(Gone, Refused):  # the token ends by itself; here it is forgotten
            await station.api.asked("POST", "/logout", session.token)
        return RedirectResponse("/login", 303)


def _session_routes(app: FastAPI, station: Station) -> None:
    """Questions of a page about its session."""

    @app.post("/theme")
    async def theme(request: Request, system: str = "") -> Response:
        """Switch between light and dark. Until a person has chosen, the page follows the system of the computer."""
        session = station.who(request)
        if not system:
            session.dark, session.chosen = not session.dark, True
        elif not session.chosen:
            session.dark = system == "dark"
        return Response(status_code=204)

    @app.get("/who")
    async def who() -> Response:
        return Response(status_code=204)  # to whom the guard lets in; everybody else is led to the login


def _exports(app: FastAPI, station: Station) -> None:
    """Overview and events as CSV."""

    @app.get("/overview.csv")
    async def overview_csv() -> Response:
        return _csv(as_csv(station.listed.rows), "overview.csv")

    @app.get("/events.csv")
    async def events_csv() -> Response:
        text = await asyncio.to_thread(lambda: as_csv(all_events(station, 1_000_000)))
        return _csv(text, "events.csv")


def _pages(station: Station, bench: Bench) -> None:
    """The pages, by their addresses."""

    @ui.page("/")
    def _overview(request: Request) -> None:
        overview_page(station, request)

    @ui.page("/events")
    def _events(request: Request) -> None:
        events_page(station, request)

    @ui.page("/loop")
    def _loop(request: Request, name: str = "") -> None:
        loop_page(station, request, name)

    @ui.page("/laboratory")
    def _laboratory(request: Request) -> None:
        lab_page(station, bench, request)

    @pages.exception_handler(404)
    async def _missing(request: Request, error: Exception) -> Response:
        return _no_page()


def _work(station: Station, bench: Bench) -> None:
    """What goes on while the window is open, beside its pages."""
    tasks: list[asyncio.Task[None]] = []

    async def begin() -> None:
        await asyncio.to_thread(station._look)
        tasks.extend(asyncio.create_task(one) for one in (station.look(), bench.go_on()))

    async def end() -> None:
        for task in tasks:
            task.cancel()
        await station.api.close()

    pages.on_startup(begin)
    pages.on_shutdown(end)


def _csv(text: str, name: str) -> Response:
    return Response(
        text, media_type="text/csv; charset=utf-8", headers={"Content-Disposition": f"attachment; filename={name}"}
    )
