"""The command line, `glapp`."""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from .. import __version__
from ..errors import InputError
from .analyze import analyze
from .demo import demo
from .explain import explain
from .fleet import fleet
from .identify import identify
from .init import init
from .plan_test import plan_test
from .plant import plant, tags
from .score import score
from .screen import CommandError, examples, out, say_error
from .station import station
from .step_test import step_test
from .thesis import thesis
from .watch import watch

__all__ = ["app", "main"]

app = typer.Typer(
    name="glapp",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command(
    epilog="[bold]Examples[/bold]\n\n"
    + examples(
        "glapp analyze plant.csv",
        "glapp analyze *.csv --report report.html",
        "glapp analyze loops.toml --json > answer.json",
        "glapp analyze plant.csv --op CO --pb 180 --ti 0.5 --ti-unit min --pv-span 0 50 --op-span 0 100",
    )
)(analyze)
app.command(
    epilog=examples(
        "glapp init plant.csv -o loops.toml",
        "glapp init plant.csv --op CO --pb 180 --ti 0.5 --ti-unit min --pv-span 0 50 --op-span 0 100",
    )
)(init)
app.command(epilog=examples("glapp identify plant.csv", "glapp identify loops.toml --loop FIC101"))(identify)
app.command(
    epilog=examples(
        "glapp explain plant.csv",
        'glapp explain plant.csv --at "2026-03-01 12:34"',
        "glapp explain loops.toml --loop FIC101 --at 5400",
    )
)(explain)
app.command(
    epilog=examples(
        "glapp demo demo",
        "glapp step-test demo/FIC402.csv --plot test.html",
        "glapp step-test demo/FIC402.csv --page page.html --allowed 2",
        "glapp step-test demo/loops.toml --loop FIC402 --json",
    )
)(step_test)
app.command(
    epilog=examples(
        "glapp plan-test plant.csv --op-within 40 60 --pv-within 3 5 --minutes 45",
        "glapp plan-test loops.toml --loop FIC101 --width 1.5",
    )
)(plan_test)
app.command(epilog=examples("glapp score labels.csv --report differ.html"))(score)
app.command(epilog=examples("glapp demo demo"))(demo)
app.command(
    epilog=examples(
        "glapp plant --settings loops.toml",
        "glapp plant --days 90 --scan 60 --speed 20000 --history 2400",
        "glapp plant --fault 60,bad,FIC101,30 --fault 120,gone,,300",
    )
)(plant)
app.command(
    epilog=examples("glapp tags opc.tcp://plant:4840 -o loops.toml", "glapp tags loops.toml --find FIC --find PIC")
)(tags)
app.command(
    epilog=examples(
        "glapp station --demo",
        "glapp station --data plant",
        "glapp station --data plant --host 0.0.0.0 --certificate station.pem --key station.key --name station.plant",
    )
)(station)
app.command(epilog=examples("glapp thesis 5.1", "glapp thesis 1.2 'Table 8.1' --out figures"))(thesis)

app.add_typer(watch, name="watch")
app.add_typer(fleet, name="fleet")


def _version(asked: bool) -> None:
    if asked:
        out.print(f"glapp {__version__}")
        raise typer.Exit


@app.callback(
    help=f"""\
Find out from recordings of control loops whether their valves have a dead band, and how wide it is. A recording is a \
CSV, Excel, OpenDocument, Parquet or Arrow file with time, PV, OP and, better, SP and mode; what is known about the \
loops (spans, controller) can stand in a loops.toml.

[bold]Try it[/bold]

{examples("glapp demo demo", "glapp analyze demo/loops.toml --report demo.html")}

[bold]Your own loop, first with nothing but the recording[/bold]

{examples("glapp analyze plant.csv", "glapp init plant.csv -o loops.toml", "glapp analyze loops.toml --report r.html")}
""",
    epilog="Exit codes: 0 every loop got an answer; 1 at least one loop was refused or could not be read, and each is "
    "named; 2 the command line is wrong. Each command has examples of its own: glapp analyze --help",
)
def glapp(
    version: Annotated[
        bool, typer.Option("--version", metavar="", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Hold the options of the whole program."""


def main() -> None:
    """Run the command line, and end with its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Unicode shows '?' for d̂, and goes on
    try:
        code = _run()
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of the pipe has closed it
        code = 1
        _silence()
    except OSError as error:
        code = 1
        if error.filename is None:
            _silence()
            say_error(f"standard output cannot be written: {error.strerror}")
        else:
            say_error(f"{error.filename}: cannot be read or written: {error.strerror}")
    sys.exit(code)


def _run() -> int | str | None:
    """Run the command line; gives the exit code."""
    try:
        app()
    except SystemExit as end:
        return end.code
    except InputError as error:
        say_error(error)
        return 1
    except CommandError as error:
        say_error(error)
        return 2
    return 0


def _silence() -> None:
    """Send standard output to nowhere: else the rest of it is written again at the end, with a traceback."""
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), sys.__stdout__.fileno() if sys.__stdout__ else 1)
