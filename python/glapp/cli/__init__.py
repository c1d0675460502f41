"""The command line, `glapp`."""

from __future__ import annotations

import io
import sys
from typing import Annotated

import typer

from .. import __version__
from ..errors import InputError
from .analyze import analyze
from .demo import demo
from .explain import explain
from .identify import identify
from .init import init
from .screen import CommandError, out, say_error

__all__ = ["app", "main"]

app = typer.Typer(
    name="glapp",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (analyze, init, identify, explain, demo):
    app.command()(command)


def _version(asked: bool) -> None:
    if asked:
        out.print(f"glapp {__version__}")
        raise typer.Exit


@app.callback(
    epilog="Exit codes: 0 every loop got an answer; 1 at least one loop was refused or could not be read, and each is "
    "named; 2 the command line is wrong. Each command tells more: glapp analyze --help"
)
def glapp(
    version: Annotated[
        bool, typer.Option("--version", metavar="", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Find out from recordings of control loops whether their valves have a dead band, and how wide it is.

    A recording is a CSV, Parquet or Arrow file with time, SP, PV and, better, OP and mode. What is known about the
    loops (spans, controller) can stand in a loops.toml.

    [bold]Begin here[/bold]

      glapp demo demo                                    recordings to try it on
      glapp analyze demo/loops.toml --report demo.html   what glapp says of them
      glapp analyze plant.csv                            your own loop, nothing else known
      glapp init plant.csv -o loops.toml                 a settings file, to be completed
    """


def main() -> None:
    """Run the command line, and end with its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Unicode shows '?' for d̂, and goes on
    try:
        app()
    except InputError as error:
        say_error(error)
        sys.exit(1)
    except CommandError as error:
        say_error(error)
        sys.exit(2)
