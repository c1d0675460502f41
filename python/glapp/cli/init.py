"""`glapp init`: a first loops.toml from a recording."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from ..reading.init import refuse_without_numbers, settings_of
from ..recording import Recording
from .inputs import Refused, open_files
from .options import Options, with_options
from .outputs import check_output, save
from .screen import CommandError, err, say_error

__all__ = ["init"]


@with_options
def init(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILES", help="Recordings: CSV, Excel, OpenDocument, JSON, Parquet or Arrow."),
    ],
    options: Options,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="TOML", help="File to write; default: standard output.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", metavar="", help="Overwrite the file if it exists.")] = False,
) -> None:
    """Write a first settings file for the loops of recordings, with what the options say, to be completed by hand."""
    if toml := next((file for file in files if file.suffix.lower() == ".toml"), None):
        raise CommandError(f"init takes recordings, and {toml} holds settings")
    if output is not None:
        check_output("--output", output, files, None)
        if output.exists() and not force:
            raise InputError("exists already", file=str(output), hint="choose another name, or add --force")
    recordings, faults = [], []
    for entry in open_files(files, options):
        if isinstance(entry, Refused):
            faults.append(entry.error)
        elif isinstance(entry, Recording):
            try:
                refuse_without_numbers(entry)
            except InputError as unusable:
                faults.append(unusable)
            else:
                recordings.append(entry)
    if recordings:
        text = settings_of(recordings, "." if output is None else output.parent)
        if output is None:
            typer.echo(text, nl=False)
        else:
            save(output, text)
            loops = [recording.loop for recording in recordings]
            spans = all(loop.pv_span is not None and loop.op_span is not None for loop in loops)
            controllers = all(loop.controller is not None for loop in loops)
            left = " and ".join([*([] if spans else ["spans"]), *([] if controllers else ["controller"])])
            err.print(f"Wrote {output}. {f'Fill in {left}, then' if left else 'Next'}:", soft_wrap=True)
            err.print(f"  glapp analyze {shlex.quote(str(output))} --report report.html", soft_wrap=True)
    for error in faults:
        say_error(error)
    if faults:
        raise typer.Exit(1)
