"""`glapp init`: a first loops.toml from a recording."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from ..reading.init import first_settings
from .outputs import check_output, save
from .screen import err

__all__ = ["init"]


def init(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording: CSV, Parquet or Arrow.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="TOML", help="File to write; else standard output.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", metavar="", help="Overwrite the file if it exists.")] = False,
) -> None:
    """Write a first settings file for the loops of a recording, to be completed by hand."""
    if output is not None:
        check_output("--output", output, [file], None)
        if output.exists() and not force:
            raise InputError("exists already", file=str(output), hint="choose another name, or add --force")
    text = first_settings(file, "." if output is None else output.parent)
    if output is None:
        typer.echo(text, nl=False)
        return
    save(output, text)
    err.print(f"Wrote {output}. Fill in spans and controller, then:", soft_wrap=True)
    err.print(f"  glapp analyze {shlex.quote(str(output))} --report report.html", soft_wrap=True)
