"""Parts that `glapp watch` and `glapp station` share: options, requirements, and their end."""

from __future__ import annotations

import asyncio
import importlib
import signal
from collections.abc import Awaitable
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from .screen import out

__all__ = [
    "Certificate",
    "Key",
    "Names",
    "PlantDays",
    "PlantLoops",
    "PlantScan",
    "need",
    "say_first_login",
    "until_stopped",
]

PlantLoops = Annotated[
    int | None, typer.Option(metavar="N", help="Simulate a new plant, without history, with this number of loops.")
]
PlantDays = Annotated[
    float | None,
    typer.Option(metavar="DAYS", help="Simulate a new plant that begins this many days ago and catches up."),
]
PlantScan = Annotated[float | None, typer.Option(metavar="S", help="Simulate a new plant with this scan time in s.")]
Certificate = Annotated[
    Path | None, typer.Option(metavar="PEM", help="Certificate for TLS; needed on other addresses than 127.0.0.1.")
]
Key = Annotated[Path | None, typer.Option(metavar="PEM", help="Key of the certificate.")]
Names = Annotated[
    list[str] | None,
    typer.Option("--name", metavar="NAME", help="Host name by which other computers ask; may be repeated."),
]


def need(command: str, extra: str, *names: str) -> None:
    """Say what to install for a command where it is missing."""
    for name in names:
        try:
            importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name != name:
                raise
            raise InputError(f"glapp {command} needs {name}", hint=f"pip install 'glapp[{extra}]'") from None


def say_first_login(data: Path) -> None:
    """Say in which file the first user's password is, as long as it exists."""
    first = data / "first-login.txt"
    if first.exists():
        out.print(f"The first user's name and password stand in {first}.", soft_wrap=True)


async def until_stopped(*work: Awaitable[None]) -> None:
    """Run all tasks until one ends or fails, or the process is stopped."""
    tasks = [asyncio.ensure_future(awaitable) for awaitable in work]
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for name in ("SIGTERM", "SIGINT"):
        with suppress(NotImplementedError, AttributeError):  # Windows stops it by KeyboardInterrupt
            loop.add_signal_handler(getattr(signal, name), stop.set)
    stopped = asyncio.ensure_future(stop.wait())
    try:
        done, _ = await asyncio.wait([*tasks, stopped], return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in (*tasks, stopped):
            task.cancel()
        await asyncio.gather(*tasks, stopped, return_exceptions=True)
