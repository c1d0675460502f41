"""`glapp station`: the operator's window, in the browser."""

from __future__ import annotations

import asyncio
import contextlib
import math
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import InputError
from ..service.trust import TRUST
from .screen import CommandError, out, say_note
from .serving import Certificate, Key, Names, PlantDays, PlantLoops, PlantScan, need, say_first_login, until_stopped

__all__ = ["station"]

_LONGEST = 180.0  # [s]: the demonstration's service takes 4 s on an idle machine


def station(
    data: Annotated[Path, typer.Option("--data", metavar="DIR", help="Folder of the service; it is only read.")] = Path(
        "glapp-data"
    ),
    demo: Annotated[
        bool, typer.Option("--demo", metavar="", help="Start a simulated plant and the service on it, too.")
    ] = False,
    loops: PlantLoops = None,
    days: PlantDays = None,
    scan: PlantScan = None,
    host: Annotated[str, typer.Option(metavar="ADDRESS", help="Address the window listens on.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(metavar="PORT", min=0, max=65535, help="Port it listens on; 0: any free one.")
    ] = 8108,
    certificate: Certificate = None,
    key: Key = None,
    name: Names = None,
    api_url: Annotated[
        str | None, typer.Option(metavar="URL", help="Address of the service's API, where the folder does not have it.")
    ] = None,
    trust: Annotated[
        Path | None,
        typer.Option(metavar="PEM", envvar=TRUST, help="Certificate of an API that no public authority has signed."),
    ] = None,
) -> None:
    """Show the plant's valves in the browser: overview, loops, events. Commands go through the service's API.

    Everybody logs in with the name and password that the service knows. Details: docs/station.md.
    """
    need("station", "station", "nicegui", "httpx", "fastapi", "uvicorn")
    given = {"host": host, "port": port, "certificate": certificate, "key": key, "names": name or ()}
    beside = _demo(data, loops, days, scan) if demo else contextlib.nullcontext()
    known = data / "first-login.txt" if demo and host in ("127.0.0.1", "localhost", "::1") else None
    with suppress(KeyboardInterrupt), beside:
        asyncio.run(_serve(data, given, api_url, trust, known))


async def _serve(
    data: Path,
    given: dict[str, Any],
    url: str | None,
    trust: Path | None,
    known: Path | None,
) -> None:
    """Run the window, until stopped."""
    from ..service.api import ApiServer, hosts_of
    from ..station.app import app_of
    from ..station.client import ApiClient
    from ..station.pages import Station
    from ..station.view import View

    made = Station(View(data), ApiClient(data, url, trust))
    hosts = hosts_of(given["host"], given["names"])
    app = app_of(made, hosts, secure=given["certificate"] is not None, first_login=known)
    opened = ApiServer(app, **given)
    out.print(f"The window is at {opened.url}.", soft_wrap=True)
    if (text := opened.expiring()) is not None:
        say_note(text)
    if not (data / "glapp.db").exists():
        out.print(
            f"No service has written to {data} yet, so there is nothing to show. glapp station --demo has six "
            f"simulated loops; glapp watch LOOPS.toml --data {data} watches your own.",
            soft_wrap=True,
        )
    if known is not None:
        out.print("It is a demonstration: name and password are filled in.", soft_wrap=True)
    say_first_login(data)
    await until_stopped(opened.open())


@contextlib.contextmanager
def _demo(data: Path, loops: int | None, days: float | None, scan: float | None) -> Iterator[None]:
    """A simulated plant with the service beside it, in a process of its own, as long as the window is open."""
    from ..folder_lock import FolderLock

    data.mkdir(parents=True, exist_ok=True)
    holder = FolderLock.holder(data)
    if holder is not None:
        raise InputError(
            f"is written by process {holder['pid']}: a demo needs a folder of its own",
            file=str(data),
            hint="without --demo the window shows what that service writes",
        )
    (data / "api-url").unlink(missing_ok=True)
    words = ["run", "--demo", "--data", str(data), "--port", "0"]
    for name, value in (("--loops", loops), ("--days", days), ("--scan", scan)):
        words += [] if value is None else [name, str(value)]
    if days is not None and days > 7.0:  # a fit looks back over all of it, so that wear is seen
        words += ["--fit-days", str(math.ceil(days))]
    code = "from glapp.cli import main; main()"
    log = (data / "demo.log").open("wb")
    child = subprocess.Popen(
        [sys.executable, "-c", code, "watch", *words],
        stdout=log,
        stderr=subprocess.STDOUT,
        start_new_session=True,  # Ctrl-C is for the window, which then ends this one
    )
    try:
        until = time.monotonic() + _LONGEST
        while not (data / "api-url").exists():
            if child.poll() is not None:
                raise CommandError(f"the service did not start: {data / 'demo.log'} tells why")
            if time.monotonic() > until:
                raise CommandError(f"the service did not start within {_LONGEST:.0f} s; is the machine busy?")
            time.sleep(0.2)
        yield
    finally:
        child.terminate()
        with suppress(subprocess.TimeoutExpired):
            child.wait(90.0)
        log.close()
