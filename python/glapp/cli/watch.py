"""`glapp watch`: the service beside a plant, and the commands to it."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import os
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table
from typer.core import TyperGroup

from ..errors import InputError
from ..escape import one_line
from ..service.trust import TRUST, trusted
from .screen import CommandError, event_line, examples, key_values, moment, out, say_note, styled
from .serving import Certificate, Key, Names, PlantDays, PlantLoops, PlantScan, need

if TYPE_CHECKING:
    from ..service.security import Security

__all__ = ["watch"]

TOKEN = "GLAPP_TOKEN"
"""The environment's variable that may hold a token of the API."""

_API_URL = "http://127.0.0.1:8107"
"""Address of the API, where none is given."""


class _Group(TyperGroup):
    """`glapp watch loops.toml` is `glapp watch run loops.toml`: a word that is no command's name is a file to watch."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = ["run", *args]
        return super().parse_args(ctx, args)


watch = typer.Typer(
    cls=_Group,
    no_args_is_help=True,
    rich_markup_mode="rich",
    help=f"""\
Watch the loops of a plant for years: run their detectors on what its OPC UA server tells, fit all that was recorded \
every night, and compensate where an engineer has enabled it. Everything is kept in one folder.

[bold]Begin[/bold]

{examples("glapp tags opc.tcp://plant:4840 -o loops.toml", "glapp watch loops.toml --data plant")}

[bold]Look[/bold]

{examples("glapp watch status --data plant", "glapp watch events --data plant", "glapp watch backup p.db --data plant")}

[bold]Ask, in your own name[/bold]

{examples("glapp watch login engineer", "glapp watch users add anna --role operator", "glapp watch enable FIC101")}
""",
    epilog="The first user is engineer, whose password stands in first-login.txt of the folder. "
    "Details: docs/service.md.",
)

Data = Annotated[Path, typer.Option("--data", metavar="DIR", help="Folder of the database and the signals.")]
Url = Annotated[
    str,
    typer.Option(
        "--api-url", metavar="URL", help=f"Address of the service's API. {TRUST} names a certificate to trust."
    ),
]
User = Annotated[
    str | None,
    typer.Option("--user", metavar="NAME", help=f"Your user name; default: the token in {TOKEN}, or that of `login`."),
]


def _server_option(text: str, metavar: str, low: int | None = None, high: int | None = None) -> Any:
    """Option of our own OPC UA server."""
    return typer.Option(metavar=metavar, help=text, min=low, max=high, rich_help_panel="Our own OPC UA server")


@watch.command(
    epilog=examples(
        "glapp watch loops.toml --data plant",
        "glapp watch loops.toml --data plant --host 0.0.0.0 --name plant.example "
        "--certificate service.pem --key service.key",
        "glapp watch --demo",
        "glapp watch --demo --days 90 --scan 60 --loops 2 --repair 42",
        "glapp watch --demo --opcua-port 4841",
    )
)
def run(
    settings: Annotated[
        Path | None,
        typer.Argument(metavar="LOOPS.TOML", help="Settings of the loops, and of the connection to their server."),
    ] = None,
    data: Data = Path("glapp-data"),
    demo: Annotated[
        bool, typer.Option("--demo", metavar="", help="Watch a simulated plant, which is started too.")
    ] = False,
    loops: PlantLoops = None,
    days: PlantDays = None,
    scan: PlantScan = None,
    repair: Annotated[
        float | None,
        typer.Option(metavar="DAY", help="Day on which the worn valves of the simulated plant are repaired."),
    ] = None,
    host: Annotated[str, typer.Option(metavar="ADDRESS", help="Address the API listens on.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(metavar="PORT", min=0, max=65535, help="Port of the API; 0: any free one.")
    ] = 8107,
    certificate: Certificate = None,
    key: Key = None,
    name: Names = None,
    keep: Annotated[int, typer.Option(metavar="DAYS", help="Recorded days whose signals are kept.")] = 30,
    fit_days: Annotated[int, typer.Option(metavar="DAYS", help="How far a fit looks back.")] = 7,
    fit_hour: Annotated[int, typer.Option(metavar="H", help="Local hour at which the fits of the night begin.")] = 2,
    fit_longest: Annotated[float, typer.Option(metavar="S", help="Longest time of a fit; then it is stopped.")] = 600.0,
    wait: Annotated[float, typer.Option(metavar="S", help="How long a sample waits for values that come late.")] = 2.0,
    opcua_port: Annotated[
        int | None,
        _server_option("Serve the answers here, read-only; 0: any free one. Off where not given.", "PORT", 0, 65535),
    ] = None,
    opcua_host: Annotated[
        str, _server_option("Address; beyond 127.0.0.1 certificate, key and user are needed.", "ADDRESS")
    ] = "127.0.0.1",
    opcua_certificate: Annotated[Path | None, _server_option("Its certificate.", "DER")] = None,
    opcua_key: Annotated[Path | None, _server_option("Its key.", "PEM")] = None,
    opcua_user: Annotated[str | None, _server_option("Who may read; anybody where not given.", "NAME")] = None,
    opcua_password_file: Annotated[
        Path | None, _server_option("File whose first line is the password.", "FILE")
    ] = None,
) -> None:
    """Watch the loops of a loops.toml until it is stopped; this is what `glapp watch loops.toml` does."""
    need("watch", "service", "argon2", "asyncua", "fastapi", "prometheus_client", "uvicorn")
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # what matters of it is an event
    from ..service.options import MonitorOptions
    from ..service.store import StoreFull
    from .watch_run import SimulatedPlant, serve

    if demo == (settings is not None):
        raise CommandError("name a loops.toml, or say --demo")
    files = (opcua_certificate, opcua_key, opcua_password_file)
    if opcua_port is None and (opcua_host != "127.0.0.1" or opcua_user is not None or any(files)):
        raise CommandError("--opcua-port: is needed with the other settings of our own OPC UA server")
    answer_server: dict[str, Any] | None = None
    if opcua_port is not None:
        security = _security(opcua_certificate, opcua_key, opcua_user, opcua_password_file)
        answer_server = {"port": opcua_port, "host": opcua_host, "security": security}
    period = 1.0 if scan is None or not demo else scan
    options = MonitorOptions(
        period=period,
        lost=max(15.0, 3.0 * period),
        keep=keep if days is None else max(keep, int(days) + 1),
        fit_days=fit_days,
        fit_hour=fit_hour,
        fit_longest=fit_longest,
        wait=wait,
    )
    address = {"host": host, "port": port, "certificate": certificate, "key": key, "names": name or ()}
    watched = SimulatedPlant(loops, days, scan, repair) if settings is None else settings
    try:
        with suppress(KeyboardInterrupt):
            asyncio.run(serve(watched, data, options, address, answer_server))
    except StoreFull as full:
        raise InputError(str(full), hint="make room, then start it again") from None


def _security(certificate: Path | None, key: Path | None, user: str | None, file: Path | None) -> Security:
    from ..service.connection import password_in
    from ..service.security import Security

    if (user is None) != (file is None):
        raise CommandError("--opcua-user and --opcua-password-file are given together")
    if user is None or file is None:
        return Security(certificate, key)
    return Security(certificate, key, {user: password_in(file)})


@watch.command(epilog=examples("glapp watch status --data plant", "glapp watch status --json"))
def status(
    data: Data = Path("glapp-data"),
    as_json: Annotated[bool, typer.Option("--json", metavar="", help="One JSON object, nothing else.")] = False,
) -> None:
    """Show the last known state of every loop; the service need not run."""
    from ..folder_lock import FolderLock
    from ..service.store import Reader

    with Reader(data) as reader:
        shown, holder = reader.shown(), FolderLock.holder(data)
    if as_json:
        body = {"runs": holder, "time": None if shown is None else shown[0], **({} if shown is None else shown[1])}
        print(json.dumps(body))
        return
    runs = "no: nobody writes this folder" if holder is None else f"process {holder['pid']} since {holder['since']}"
    rows = [("runs", runs)]
    if shown is None:
        out.print(key_values([*rows, ("shown", "nothing yet")]))
        return
    at, body = shown
    rows.append(("as of", f"{moment(at)}, {_age(time.time() - at)} ago"))
    if body.get("unconnected"):
        rows.append(("plant", f"not connected: {body['unconnected']}"))
    if body["failing"]:
        rows.append(("store", body["failing"]))
    if body.get("damaged"):
        rows.append(("database", body["damaged"]))
    rows += [("tag", loop["missing"]) for loop in body["loops"].values() if loop.get("missing")]
    out.print(key_values(rows))
    table = Table(box=None, header_style="dim", padding=(0, 2, 0, 0))
    for name in ("loop", "seen", "gap (95 %)", "valve", "estimate", "detections", "compensation"):
        table.add_column(name)
    for name, loop in body["loops"].items():
        table.add_row(*(styled(one_line(cell)) for cell in (name, *_cells(loop, at, gone=holder is None))))
    out.print(table)


def _cells(loop: dict[str, Any], now: float, *, gone: bool) -> tuple[str, ...]:
    """Cells of a loop in the table of states; where the service is gone, a compensation that was on is not known."""
    answer, unit = loop["answer"], loop["unit"]
    seen = "never" if loop["seen"] is None else f"{_age(now - loop['seen'])} before"
    if loop["good"] is False:
        seen += f", bad: {loop['note']}"
    gap = ""
    if answer is not None and answer["d"] is not None:
        high = "" if answer["high"] is None else f" to {answer['high']:.3g}"
        low = "" if answer["low"] is None else f" ({answer['low']:.3g}{high})"
        gap = f"{answer['d']:.3g}{low} {unit}"
    estimate = loop["why"] if loop["estimate"] is None else f"{loop['estimate']:.3g} {unit}"
    compensation = ""
    if "compensation" in loop:
        made = loop["compensation"]
        compensation = "off" if not made["enabled"] else "not known" if gone else made["standing"]
        if made["u_ff"] and not gone:
            compensation += f", u_FF {made['u_ff']:.3g}"
    detections = f"{loop['accepted']} of {loop['half_periods']}"
    return seen, gap, "" if answer is None else answer["verdict"], estimate, detections, compensation


@watch.command(epilog=examples("glapp watch events --data plant --loop FIC101"))
def events(
    data: Data = Path("glapp-data"),
    loop: Annotated[str | None, typer.Option(metavar="NAME", help="Only events of this loop.")] = None,
    most: Annotated[int, typer.Option(metavar="N", min=1, help="Number of events, the newest ones.")] = 50,
    commands: Annotated[
        bool, typer.Option("--commands", metavar="", help="Show the commands and their persons instead.")
    ] = False,
) -> None:
    """Show the events, the newest last."""
    from ..service.store import Reader
    from ..station.parameters import command_text

    with Reader(data) as reader:
        found = reader.commands(loop, most) if commands else reader.events(loop, most)
    for row in reversed(found):
        if commands:
            place = f" {row['loop']}" if row["loop"] else ""
            what = command_text(row)
            text = f"{moment(row['time'])} {row['person']} ({row['role']}) {row['command']}{place}"
            out.print(styled(one_line(f"{text}: {what}" if what else text)), soft_wrap=True)
        else:
            out.print(event_line(row["time"], row["kind"], row["loop"], row["text"]), soft_wrap=True)


@watch.command(epilog=examples("glapp watch backup plant.db --data plant"))
def backup(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File of the copy; an old one is replaced.")],
    data: Data = Path("glapp-data"),
) -> None:
    """Copy the database, while the service runs or not; signals are files, in DIR/signals."""
    from ..service.store import backup as copy

    copy(data, file)
    out.print(f"Copied the database of {data} to {file}.", soft_wrap=True)


@watch.command(epilog=examples("glapp watch restore plant.db --data plant"))
def restore(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Copy that `glapp watch backup` wrote.")],
    data: Data = Path("glapp-data"),
) -> None:
    """Replace the database by a copy; the old one is kept aside, and compensation is off."""
    from ..service.store import restore as put_back

    aside = put_back(data, file)
    out.print(f"Restored {file} into {data}.", soft_wrap=True)
    if aside is not None:
        say_note(f"the database that was there is {aside.name} now")


# Commands to the service go through its API, in the name of the person who gives them.


@watch.command(epilog=examples("glapp watch login engineer"))
def login(
    user: Annotated[str, typer.Argument(metavar="NAME", help="Your user name.")],
    api_url: Url = _API_URL,
) -> None:
    """Log in: the token is kept for twelve hours in a file that only you can read."""
    need("watch", "service", "httpx")
    token = _token_of(api_url, user)
    path = _token_file()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    path.touch(mode=0o600)
    path.write_text(token, encoding="utf-8")
    out.print(f"Logged in as {user}.", soft_wrap=True)


@watch.command(epilog=examples("glapp watch watchdog-test FIC101"))
def watchdog_test(
    loop: Annotated[str, typer.Argument(metavar="LOOP")], api_url: Url = _API_URL, user: User = None
) -> None:
    """Test once that the plant removes a small u_FF when its watchdog stands still; no loop can be enabled before.

    There is one watchdog for all loops: where it stands still, the plant removes the u_FF of every loop.
    """
    _answer_of_service(api_url, user, "POST", f"/loops/{_path_part(loop)}/watchdog-test")
    text = (
        f"{loop}: `glapp watch events` tells how it ended, in five minutes at the latest. There is one watchdog for "
        "all loops: where u_FF of one cannot be taken away, the plant takes it away from every loop."
    )
    out.print(text, soft_wrap=True)


@watch.command(epilog=examples("glapp watch enable FIC101"))
def enable(loop: Annotated[str, typer.Argument(metavar="LOOP")], api_url: Url = _API_URL, user: User = None) -> None:
    """Enable the compensation of a loop, in your name; needs the role engineer."""
    _print_values(_answer_of_service(api_url, user, "POST", f"/loops/{_path_part(loop)}/enable"))


@watch.command(epilog=examples("glapp watch disable FIC101"))
def disable(loop: Annotated[str, typer.Argument(metavar="LOOP")], api_url: Url = _API_URL, user: User = None) -> None:
    """End the compensation of a loop; needs the role operator."""
    _print_values(_answer_of_service(api_url, user, "POST", f"/loops/{_path_part(loop)}/disable"))


@watch.command(epilog=examples("glapp watch fit FIC101"))
def fit(loop: Annotated[str, typer.Argument(metavar="LOOP")], api_url: Url = _API_URL, user: User = None) -> None:
    """Have a loop fitted now; needs the role operator."""
    _answer_of_service(api_url, user, "POST", f"/loops/{_path_part(loop)}/fit")
    out.print(f"{loop} is fitted: `glapp watch status` shows the answer when it is there.", soft_wrap=True)


@watch.command(
    name="set",
    epilog=examples("glapp watch set FIC101", "glapp watch set FIC101 kp=1.3 n=15", "glapp watch set FIC101 tf="),
)
def set_(
    loop: Annotated[str, typer.Argument(metavar="LOOP")],
    values: Annotated[
        list[str] | None, typer.Argument(metavar="NAME=VALUE...", help="NAME= restores the default.")
    ] = None,
    api_url: Url = _API_URL,
    user: User = None,
) -> None:
    """Show the parameters of a loop's detector and compensation, or change some; needs the role engineer."""
    path = f"/loops/{_path_part(loop)}/parameters"
    if not values:
        _print_values(_answer_of_service(api_url, user, "GET", path))
        return
    wanted: dict[str, float | None] = {}
    for setting in values:
        name, equals, value = setting.partition("=")
        try:
            wanted[name] = float(value) if value else None
        except ValueError:
            raise CommandError(f"{setting}: {value!r} is not a number") from None
        if not equals or not math.isfinite(wanted[name] or 0.0):
            raise CommandError(f"{setting}: write NAME=VALUE, with a number")
    _print_values(_answer_of_service(api_url, user, "POST", path, {"values": wanted}))


@watch.command(name="take-over", epilog=examples("glapp watch take-over FIC101"))
def take_over(
    loop: Annotated[str, typer.Argument(metavar="LOOP")],
    answer: Annotated[int | None, typer.Option(metavar="ID", help="Number of the answer; default: the newest.")] = None,
    api_url: Url = _API_URL,
    user: User = None,
) -> None:
    """Take over a fit's result: the width to compensate, Kp, and K and Ti where they are not known."""
    if answer is None:
        found = _answer_of_service(api_url, user, "GET", f"/loops/{_path_part(loop)}/answers?most=1")
        if not found:
            raise InputError("has no answer yet", loop=loop, hint=f"glapp watch fit {loop}")
        answer = found[0]["id"]
    _print_values(_answer_of_service(api_url, user, "POST", f"/loops/{_path_part(loop)}/take_over", {"answer": answer}))


users = typer.Typer(no_args_is_help=True, rich_markup_mode="rich", help="Who may do what: viewer, operator, engineer.")
watch.add_typer(users, name="users")


@users.command(name="list", epilog=examples("glapp watch users list"))
def list_(api_url: Url = _API_URL, user: User = None) -> None:
    """Name and role of every user."""
    for account in _answer_of_service(api_url, user, "GET", "/users"):
        out.print(f"{account['name']}  {account['role']}", soft_wrap=True)


@users.command(epilog=examples("glapp watch users add anna --role operator"))
def add(
    name: Annotated[str, typer.Argument(metavar="NAME")],
    role: Annotated[str, typer.Option(metavar="ROLE", help="viewer, operator or engineer.")] = "viewer",
    keep_password: Annotated[bool, typer.Option("--keep-password", metavar="", help="Change only the role.")] = False,
    api_url: Url = _API_URL,
    user: User = None,
) -> None:
    """Add a user, or change role and password of one."""
    password = None if keep_password else typer.prompt(f"Password of {name}", hide_input=True, confirmation_prompt=True)
    _answer_of_service(api_url, user, "PUT", f"/users/{_path_part(name)}", {"role": role, "password": password})
    out.print(f"{name} is {role}.", soft_wrap=True)


@users.command(epilog=examples("glapp watch users remove anna"))
def remove(name: Annotated[str, typer.Argument(metavar="NAME")], api_url: Url = _API_URL, user: User = None) -> None:
    """Remove a user."""
    _answer_of_service(api_url, user, "DELETE", f"/users/{_path_part(name)}")
    out.print(f"{name} is a user no more.", soft_wrap=True)


def _token_file() -> Path:
    """File in which `login` keeps a token."""
    base = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA") or str(Path.home() / ".local" / "state")
    return Path(base) / "glapp" / "token"


def _token_of(api_url: str, user: str) -> str:
    """Ask for the password, and log in; gives the token."""
    password = typer.prompt(f"Password of {user}", hide_input=True, err=True)
    return str(_request(api_url, "POST", "/login", {"user": user, "password": password}, None)["token"])


def _answer_of_service(api_url: str, user: str | None, method: str, path: str, body: Any = None) -> Any:
    """Answer of the service."""
    need("watch", "service", "httpx")
    if user is not None:
        token = _token_of(api_url, user)
    elif TOKEN in os.environ:
        token = os.environ[TOKEN]
    elif _token_file().is_file():
        token = _token_file().read_text(encoding="utf-8").strip()
    else:
        raise InputError("nobody is logged in", hint="glapp watch login NAME")
    return _request(api_url, method, path, body, token)


def _request(api_url: str, method: str, path: str, body: Any, token: str | None) -> Any:
    """A request to the service; gives its answer."""
    import httpx

    pem = os.environ.get(TRUST)
    verify = trusted(None if pem is None else Path(pem))
    headers = {} if token is None else {"Authorization": f"Bearer {token}"}
    content = None if method == "GET" else json.dumps(body if body is not None else {}).encode()
    if content is not None:
        headers["Content-Type"] = "application/json"
    try:
        reply = httpx.request(
            method, api_url + path, headers=headers, content=content, timeout=30, verify=verify, trust_env=False
        )
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        hint = "is glapp watch running? DIR/api-url says where"
        if "CERTIFICATE_VERIFY_FAILED" in str(error):
            hint = f"write the file of its certificate, or of who has signed it, into the variable {TRUST}"
        raise InputError(f"does not answer: {error}", parameter=api_url, hint=hint) from None
    try:
        answer = reply.json()
    except ValueError:
        answer = {}
    if reply.is_success:
        return answer
    detail = answer.get("detail") if isinstance(answer, dict) else None
    raise InputError(
        detail if isinstance(detail, str) else f"answers {reply.status_code}: {detail}", parameter="service"
    )


def _path_part(name: str) -> str:
    """A loop's name as part of a URL."""
    from urllib.parse import quote

    return quote(name, safe="")


def _print_values(values: dict[str, Any]) -> None:
    out.print(key_values([(name, _printed(value)) for name, value in values.items()]))


def _printed(value: Any) -> str:
    """A value of the API: numbers with nine digits at most, as more are only rounding."""
    if value is None:
        return ""
    if isinstance(value, float):
        return "no limit" if abs(value) > 1e30 else f"{value:.9g}"
    return str(value)


def _age(seconds: float) -> str:
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"
