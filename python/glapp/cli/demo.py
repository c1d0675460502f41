"""`glapp demo`: recordings to try glapp on."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from .screen import out

__all__ = ["demo"]


def demo(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the files; made if missing.")],
    force: Annotated[
        bool, typer.Option("--force", metavar="", help="Overwrite files of the same names that hold something else.")
    ] = False,
) -> None:
    """Write demonstration recordings, made by the simulator, and their loops.toml."""
    from ..demo import write_recordings

    try:
        files = write_recordings(folder, force=force)
    except FileExistsError as error:
        hint = "name a folder of your own, or add --force to overwrite it"
        raise InputError(str(error.strerror), file=error.filename, hint=hint) from None
    except OSError as error:
        hint = "name a folder of your own"
        raise InputError(f"cannot be written: {error.strerror}", file=str(folder), hint=hint) from None
    out.print(f"Wrote {', '.join(file.name for file in files)} in {folder}.", soft_wrap=True)
    out.print(
        "\nNext:", f"  glapp analyze {shlex.quote(str(files[-1]))} --report report.html", sep="\n", soft_wrap=True
    )
