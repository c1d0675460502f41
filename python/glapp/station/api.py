"""API of the window, for programs and for its own pages: HTTP that only reads.

Whoever asks shows a token of the service (`Authorization: Bearer …`) or, as the pages do, the session of a person who
is logged in. There is no request here that changes anything: commands go through the service's own API.
"""

# FastAPI reads the annotations as they are: no `from __future__ import annotations` here.
import asyncio
import json
from typing import Annotated, Any

from fastapi import Depends, FastAPI, HTTPException, Query, Request, Response
from fastapi import Path as InPath
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.middleware.gzip import GZipMiddleware

from .. import __version__
from ..errors import InputError
from ..service.listener import logged_in
from .client import Gone, Refused
from .pages import Station, all_events
from .view import LoopRow

__all__ = ["api_of"]

WHY_NOT = {
    400: "A body that is no JSON",
    401: "Nobody who is known to the service",
    404: "No such loop",
    422: "A value that cannot be",
    503: "Service or database cannot be reached",
}
"""Answers other than the requested one."""

Name = Annotated[str, InPath(description="Name of the loop.", max_length=200)]
Most = Annotated[int, Query(ge=1, le=100_000, description="No more than so many, the newest.")]


class LogIn(BaseModel):
    """Login of a person for a token."""

    model_config = ConfigDict(extra="forbid")

    user: Annotated[str, Field(max_length=64)]
    password: Annotated[str, Field(max_length=1000)]


class Token(BaseModel):
    """Good for twelve hours."""

    token: str
    user: str
    role: str


class Why(BaseModel):
    """Why there is no answer."""

    detail: str


class Overview(BaseModel):
    """The overview, or what has changed in it."""

    at: float | None = Field(description="When the service wrote it [s since 1970 UTC].")
    behind: float | None = Field(description="How long the service has written nothing [s], where that is too long.")
    why: str | None = Field(description="Why the database cannot be read; what was last known stays.")
    version: int = Field(description="For `since` of the next request.")
    whole: bool = Field(description="Whether these are all loops, and not only those that have changed.")
    loops: list[LoopRow]
    gone: list[str] = Field(description="Loops that are not watched any more.")


class Detections(BaseModel):
    """Detections of a loop, in the order of time: columns of the same length."""

    unit: str = Field(description="Unit of OP, in which the widths are.")
    percent: float | None = Field(description="% of OP span per unit of OP; null where the span is not known.")
    time: list[float] = Field(description="When the half-period ended [s since 1970 UTC].")
    width: list[float | None] = Field(description="Width of the dead band that it shows [unit].")
    estimate: list[float | None] = Field(description="The estimate by then: median and mean of the last [unit].")
    compensated: list[int] = Field(description="1 where u_FF was made: then it is what is left of the gap.")


class One(BaseModel):
    """A loop."""

    row: LoopRow = Field(description="As in the overview.")
    answer: dict[str, Any] | None = Field(description="The one answer of `glapp analyze --json`; null before a fit.")
    slope: float | None = Field(description="How the width moves [OP unit per 30 days]; null where that is not known.")
    spread: float | None = Field(description="Half of the slope's 95 % interval [the same].")


class Happened(BaseModel):
    """An event, or a command."""

    when: str
    at: float = Field(description="The same [s since 1970 UTC].")
    loop: str
    kind: str
    who: str
    text: str


def api_of(station: Station) -> FastAPI:
    """The interface of a station, to be mounted at `/api`.

    - `station`: what it tells of.
    """
    app = FastAPI(
        title="glapp station",
        version=__version__,
        docs_url=None,
        redoc_url=None,
        responses={status: {"model": Why, "description": text} for status, text in WHY_NOT.items()},
    )
    app.add_middleware(GZipMiddleware, minimum_size=10_000, compresslevel=1)

    _answer_errors(app)
    _login_route(app, station)
    _reading_routes(app, station)
    return app


def _answer_errors(app: FastAPI) -> None:
    """Answers to what cannot be read, and to what cannot be asked."""

    @app.exception_handler(InputError)
    async def not_read(request: Request, error: InputError) -> JSONResponse:
        return JSONResponse({"detail": str(error)}, 503)

    @app.exception_handler(RequestValidationError)
    async def not_understood(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        return JSONResponse({"detail": f"{place}: {first['msg']}"}, 422)


def _login_route(app: FastAPI, station: Station) -> None:
    """The one route that reads nothing."""

    @app.post("/login", response_model=Token)
    async def log_in(request: Request, wanted: LogIn) -> Any:
        """A token of the service for a user. It opens no page: this sets no cookie."""
        address = request.client.host if request.client is not None else ""
        try:
            found = await station.api.log_in(wanted.user, wanted.password, address)
        except Refused as refused:
            headers = {"WWW-Authenticate": "Bearer"} if refused.status == 401 else None
            raise HTTPException(refused.status if refused.status < 500 else 503, str(refused), headers) from None
        except Gone as gone:
            raise HTTPException(503, str(gone)) from None
        logged_in(request.scope)
        return found


def _reading_routes(app: FastAPI, station: Station) -> None:
    """Routes for whoever is known to the service."""

    async def known(request: Request) -> None:
        """Refuse readers that are not known to the service."""
        if station.sessions.of(request.headers.get("cookie")) is not None:
            return
        kind, _, token = request.headers.get("authorization", "").partition(" ")
        if kind.lower() != "bearer" or not token.isascii() or not token.isprintable():
            raise HTTPException(401, "show a token of the service", {"WWW-Authenticate": "Bearer"})
        if not station.sessions.token(token):
            raise HTTPException(401, "log in first", {"WWW-Authenticate": "Bearer"})
        logged_in(request.scope)

    def watched(name: Name) -> str:
        if name not in station.view.shown["loops"] or name not in station.view.loops:
            raise HTTPException(404, "no such loop")
        return name

    Loop = Annotated[str, Depends(watched)]  # noqa: N806 - a type
    reads = [Depends(known)]

    @app.get("/overview", response_model=Overview, dependencies=reads)
    async def overview(
        since: Annotated[int, Query(ge=0, le=2**53, description="Only what has changed since this version.")] = 0,
    ) -> Response:
        """Every loop with its one answer, what maintenance should do first before all else."""
        return Response(await asyncio.to_thread(_overview, station, since), media_type="application/json")

    @app.get("/loops/{name:path}/detections", response_model=Detections, dependencies=reads)
    async def detections(
        name: Loop,
        begin: Annotated[float, Query(description="From when on [s since 1970 UTC].")] = -1e12,
        most: Most = 100_000,
    ) -> Response:
        """Detections of a loop."""
        body = await asyncio.to_thread(_detections, station, name, begin, most)
        return Response(body, media_type="application/json")

    @app.get("/loops/{name:path}", response_model=One, dependencies=reads)
    async def loop(name: Loop) -> Any:
        """One loop: its row, its answer, its trend."""
        row = next((row for row in station.listed.rows if row.loop == name), None)
        if row is None:
            raise HTTPException(404, "no such loop")
        trend = station.view.trend(name)
        slope, spread = (None, None) if trend is None else (trend.slope, trend.spread)
        return {"row": row, "answer": station.view.answer(name), "slope": slope, "spread": spread}

    @app.get("/events", response_model=list[Happened], dependencies=reads)
    async def events(
        loop: Annotated[str | None, Query(max_length=200, description="Only events of this loop.")] = None,
        most: Most = 200,
    ) -> Any:
        """Everything that happened and that was asked for, the newest first."""
        return await asyncio.to_thread(all_events, station, most, loop)


def _overview(station: Station, since: int) -> bytes:
    """Changes of the overview, as JSON."""
    listed, view = station.listed, station.view
    whole, rows, gone = listed.changes(since)
    head = {
        "at": view.at,
        "behind": view.behind,
        "why": view.why,
        "version": listed.version,
        "whole": whole,
        "gone": gone,
    }
    return f'{json.dumps(head)[:-1]}, "loops": [{", ".join(rows)}]}}'.encode()


def _detections(station: Station, name: str, begin: float, most: int) -> bytes:
    """Detections of a loop, as JSON."""
    rows = station.view.read(lambda reader: reader.detections(name, begin, most))
    body = {
        "unit": station.view.unit(name),
        "percent": station.view.percent(name, 1.0),
        "time": [round(row["t_end"], 3) for row in rows],
        "width": [_short(row["d"]) for row in rows],
        "estimate": [_short(row["median_mean"]) for row in rows],
        "compensated": [row["compensated"] for row in rows],
    }
    return json.dumps(body).encode()


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.6g}")
