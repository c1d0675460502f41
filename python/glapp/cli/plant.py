"""`glapp plant` serves a simulated plant by OPC UA; `glapp tags` finds the tags of a real one."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from ..report.words import count
from ..service.connection import Connection, read_connection
from ..service.tags import as_settings, loops_of, ranges_of
from .outputs import check_output, save
from .screen import CommandError, err, out

if TYPE_CHECKING:
    from ..service.opcua import Found
    from ..service.plant import SimPlant

__all__ = ["need_opcua", "plant", "tags"]

_WHOLE = {"gone": "the server is gone", "moved": "the server starts again with its namespaces in another order"}


def need_opcua() -> None:
    """Say what to install where the extra is missing, and keep asyncua's own words off the screen.

    Raises InputError where it is missing.
    """
    try:
        import asyncua  # noqa: F401
    except ModuleNotFoundError as error:
        if error.name != "asyncua":
            raise
        hint = "pip install 'glapp[opcua]'"
        raise InputError("the connection to a plant by OPC UA is an extra", hint=hint) from None
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)


@dataclass(frozen=True, slots=True)
class _Fault:
    """Time, kind, loop and duration of a fault [s]."""

    after: float
    kind: str
    loop: str | None
    lasts: float


def _fault(text: str) -> _Fault:
    """A fault from the text AFTER,KIND,LOOP,SECONDS."""
    parts = text.split(",")
    try:
        after, lasts = float(parts[0]), float(parts[3]) if len(parts) > 3 else 60.0
        if not 2 <= len(parts) <= 4 or not after >= 0 or not lasts > 0:
            raise ValueError
    except ValueError:
        shape = "must be AFTER,KIND[,LOOP[,SECONDS]], such as 60,bad,FIC101,30"
        raise CommandError(f"--fault: is '{text}', {shape}") from None
    return _Fault(after, parts[1], parts[2] or None if len(parts) > 2 else None, lasts)


def plant(
    loops: Annotated[int, typer.Option(metavar="N", help="Number of loops, 1 to 10000.")] = 5,
    settings: Annotated[
        Path | None, typer.Option(metavar="TOML", help="Write the loops.toml that fits it, for glapp watch.")
    ] = None,
    port: Annotated[int, typer.Option(metavar="PORT", help="Port it listens on, 1 to 65535.")] = 4840,
    host: Annotated[str, typer.Option(metavar="ADDRESS", help="Address it listens on.")] = "127.0.0.1",
    scan: Annotated[float, typer.Option(metavar="S", help="Scan time in s; the loops' times go by it.")] = 1.0,
    speed: Annotated[
        float, typer.Option(metavar="X", help="Seconds of the plant per second, until it is at the present.")
    ] = 1.0,
    days: Annotated[float, typer.Option(metavar="DAYS", help="How many days ago its time begins.")] = 0.0,
    repair: Annotated[
        float | None, typer.Option(metavar="DAY", help="Day on which the worn valves are repaired.")
    ] = None,
    history: Annotated[float, typer.Option(metavar="HOURS", help="History that can be read; 0 for none.")] = 1.0,
    watchdog: Annotated[
        float, typer.Option(metavar="S", help="How long its watchdog may stand still until u_FF goes to 0.")
    ] = 10.0,
    ramp: Annotated[float, typer.Option(metavar="S", help="Time in which u_FF then goes to 0.")] = 30.0,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of noise and disturbances.")] = 1,
    fresh: Annotated[
        bool, typer.Option("--fresh", metavar="", help="New time stamps in every scan for SP and mode too.")
    ] = False,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="AFTER,KIND[,LOOP[,SECONDS]]",
            help="Fault: after how many seconds, of which kind, in which loop (all by default), for how long; may be "
            "repeated. Of loops: silent, bad, stuck, future, late, duplicate, type, back, manual, writer, "
            "repaired. Of the server: gone, moved.",
        ),
    ] = None,
) -> None:
    """Serve a simulated plant by OPC UA: loops with gaps, wear, noise, disturbances, history and faults on request.

    The controller of each loop adds what is written to U_FF, and takes it away when Watchdog stands still.

    docs/plant.md tells the rest.
    """
    if not 1 <= port <= 65535:
        raise CommandError(f"--port: is {port}, must be 1 to 65535")
    wanted = [_fault(text) for text in fault or []]
    need_opcua()
    from ..service.plant import FAULTS, SimPlant

    for requested in wanted:
        if requested.kind not in FAULTS and requested.kind not in _WHOLE:
            known = "\n".join(f"  {kind:10} {what}" for kind, what in {**FAULTS, **_WHOLE}.items())
            raise CommandError(f"--fault: there is no {requested.kind!r}; there are\n{known}")
    if settings is not None:
        check_output("--settings", settings, [], ("a loops.toml of a simulated plant", rb"urn:glapp:plant"))
    made = SimPlant(
        loops,
        scan=scan,
        speed=speed,
        begin=days,
        seed=seed,
        port=port,
        host=host,
        history=history * 3600.0,
        fresh=fresh,
        watchdog=watchdog,
        ramp=ramp,
        repair=repair,
    )
    for requested in wanted:
        if requested.loop is not None:
            made.width(requested.loop)  # refuses a loop that there is not
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_serve(made, settings, wanted))


async def _serve(made: SimPlant, settings: Path | None, faults: Sequence[_Fault]) -> None:
    """Run the simulated plant with its faults, until stopped."""
    try:
        await made.open()
    except OSError as error:
        what = f"nobody can listen at {made.url}: {error.strerror or error}"
        raise InputError(what, hint="give another --port") from None
    if settings is not None:
        save(settings, made.settings())
        err.print(f"Wrote {settings}.", soft_wrap=True)
    async with made:
        out.print(f"{len(made.names)} loops at {made.url} (Ctrl-C ends it)", soft_wrap=True)
        tasks = [asyncio.create_task(_happen(made, fault)) for fault in faults]
        try:
            await made.failure()
        finally:
            for task in tasks:
                task.cancel()


async def _happen(made: SimPlant, fault: _Fault) -> None:
    """Start a fault in the simulated plant, and end it in time."""
    await asyncio.sleep(fault.after)
    what = fault.kind if fault.loop is None else f"{fault.kind} in {fault.loop}"
    out.print(f"fault: {what} for {fault.lasts:g} s", soft_wrap=True)
    if fault.kind not in _WHOLE:
        made.fault(fault.kind, fault.loop, fault.lasts)
        return
    await made.close()
    if fault.kind == "gone":
        await asyncio.sleep(fault.lasts)
    await made.open(namespaces=1 if fault.kind == "moved" else 0)


def tags(
    server: Annotated[str, typer.Argument(metavar="URL|TOML", help="opc.tcp://host:port, or a loops.toml with it.")],
    find: Annotated[
        list[str] | None, typer.Option(metavar="TEXT", help="Only loops with this in their name; may be repeated.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="TOML", help="File to write; default: standard output.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", metavar="", help="Overwrite the file if it exists.")] = False,
) -> None:
    """Look through an OPC UA server for tags of loops, and write a first loops.toml with those that there are.

    Nothing is written to the server. A tag for u_FF is never picked: name it yourself, with its limits.
    """
    connection = read_connection(server) if server.endswith(".toml") else None
    if connection is None:
        if not server.startswith("opc.tcp://"):
            raise CommandError(f"'{server}' is neither opc.tcp://host:port nor a loops.toml with a table [opcua]")
        connection = Connection(url=server)
    if output is not None:
        check_output("--output", output, [], None)
        if output.exists() and not force:
            raise InputError("exists already", file=str(output), hint="choose another name, or add --force")
    need_opcua()
    found = asyncio.run(_variables(connection))
    loops, without = loops_of((one.path, one.node) for one in found)
    if find and loops and not any(text.lower() in name.lower() for text in find for name in loops):
        some = ", ".join(list(loops)[:20]) + (", …" if len(loops) > 20 else "")
        raise InputError(
            f"no loop has {' or '.join(map(repr, find))} in its name; there are {some}", parameter="--find"
        )
    if find:
        loops = {name: nodes for name, nodes in loops.items() if any(text.lower() in name.lower() for text in find)}
    if not loops:
        hint = "write them into a loops.toml by hand; docs/plant.md shows how"
        raise InputError(f"has {len(found)} variables, and no loop was recognised", file=connection.url, hint=hint)
    spans = {one.node: one.span for one in found if one.span is not None}
    ranges = ranges_of(loops, spans, {one.node: one.unit for one in found if one.unit is not None})
    text = as_settings(connection, loops, ranges)
    if output is None:
        typer.echo(text, nl=False)
    else:
        save(output, text)
        whole = all({"pv_span", "op_span"} <= ranges.get(name, {}).keys() for name in loops)
        err.print(f"Wrote {output}. Fill in {'' if whole else 'spans and '}controller.", soft_wrap=True)
    err.print(f"{count(len(loops), 'loop')}; {without} of {len(found)} variables are of none", soft_wrap=True)


async def _variables(connection: Connection) -> list[Found]:
    """Every variable of the server."""
    from ..service.opcua import browse
    from ..service.opcua_values import reason

    try:
        return await browse(connection)
    except InputError:
        raise
    except Exception as error:  # whatever a server answers
        raise InputError(f"cannot be looked through: {reason(error)}", file=connection.url) from None
