"""`glapp thesis`: the figures of the thesis, computed anew."""

from __future__ import annotations

from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from ..errors import InputError
from ..writing import write_file
from .outputs import PAGE, check_output
from .screen import CommandError, err, out

if TYPE_CHECKING:
    from glapp_thesis import Shown

__all__ = ["thesis"]


def thesis(
    numbers: Annotated[
        list[str] | None,
        typer.Argument(metavar="NUMBER", help='Figures and tables, such as 5.1 or "Table 8.1"; all if none.'),
    ] = None,
    folder: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the gallery; made if missing.")] = (
        Path("thesis")
    ),
    markdown: Annotated[bool, typer.Option("--markdown", help="Write README.md instead of index.html.")] = False,
) -> None:
    """Compute the figures of the thesis anew, and show its numbers next to ours."""
    try:
        from glapp_thesis import FIGURES, find, gallery, style
    except ModuleNotFoundError as error:
        if error.name != "glapp_thesis":
            raise
        what = "the figures of the thesis are a package of their own"
        raise InputError(what, hint="pip install 'glapp[thesis]'") from None
    try:
        wanted = [find(number) for number in numbers or FIGURES]
    except InputError as error:
        raise CommandError(str(error)) from None
    begun = monotonic()
    shown: list[Shown] = []
    page = folder / ("README.md" if markdown else "index.html")
    if folder.is_dir():
        check_output("--out", page, [], (PAGE[0], f"# {gallery.TITLE}".encode()) if markdown else PAGE)
        check_output("--out", folder / "numbers.json", [], ("numbers that glapp wrote", rb'\A\{\n +"(Table )?\d\.'))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
        with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
            for number in bar.track(wanted, description="figures"):
                figure = FIGURES[number]()
                style.save(figure.draw(), folder / figure.picture)
                shown.append(figure)
        write_file(page, gallery.as_markdown(shown) if markdown else gallery.as_html(shown))
        write_file(folder / "numbers.json", gallery.as_json(shown))
    except OSError as error:
        hint = "name a folder of your own with --out"
        raise InputError(f"cannot be written: {error.strerror}", file=str(folder), hint=hint) from None
    table = Table(box=None, pad_edge=False)
    for name in ("figure", "number"):
        table.add_column(name)
    for name in ("thesis", "glapp"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for figure in shown:
        for i, x in enumerate(figure.numbers):
            table.add_row("" if i else figure.number, x.what, gallery.text(x.thesis), gallery.text(x.ours), x.unit)
    out.print(table)
    for figure in shown:
        if figure.difference:
            out.print(f"\n{figure.name}: {figure.difference}")
    out.print(f"\nFigures: {len(shown)}, in {monotonic() - begun:.1f} s. Open {page}", soft_wrap=True)
