"""`glapp bump`: the gap and the process gain out of a test by hand."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from ..bump import Bump
from ..bump import bump as read_bump
from ..escape import in_quotes, one_line
from ..writing import GENERATOR
from .inputs import open_one, read_by
from .options import Options, with_options
from .outputs import PAGE, check_output, save
from .screen import key_values, out, say_error, styled

__all__ = ["bump"]


@with_options
def bump(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording, or a loops.toml with --loop.")],
    options: Options,
    manual: Annotated[
        bool,
        typer.Option("--manual", metavar="", help="All was in manual: for a recording without a mode column."),
    ] = False,
    json: Annotated[
        bool, typer.Option("--json", metavar="", help="One JSON object on standard output, nothing else.")
    ] = False,
    plot: Annotated[Path | None, typer.Option(metavar="HTML", help="Write a zoomable picture of it.")] = None,
) -> None:
    """Read gap and process gain off a test by hand: OP stepped twice one way and once back, and held each time.

    [bold]How to test a valve[/bold]: put the controller in manual. Step OP up by more than the gap may be, and wait \
until PV stands still. Step up once more, and wait. Step back by more than the gap, and wait. That is the least; \
further steps, two one way and two back, make the answer sharper.

    The first step only presses the valve to one side. The second gives the process gain Kp = ΔPV/ΔOP. What the step \
back moves OP, and PV does not follow, is the gap: d = |ΔOP| − |ΔPV|/Kp.
    """
    if plot is not None:
        check_output("--plot", plot, read_by([file]), PAGE)
    found = read_bump(open_one(file, options), manual=manual)
    if json:
        text = json_format.dumps(found.to_dict(), indent=2, ensure_ascii=False, allow_nan=False)
        typer.echo(in_quotes(text).encode())
    else:
        _show(found)
    if plot is not None:
        from ..report.figures import CONFIG

        page = found.plot().to_html(config=CONFIG)
        save(plot, page.replace("<head>", f"<head>{GENERATOR}", 1))
        if not json:
            out.print(f"\nPicture: {plot}", soft_wrap=True)
    if found.reason is not None:
        say_error(f"{found.source}, loop {found.name}: {found.reason}")
        raise typer.Exit(1)


def _show(found: Bump) -> None:
    from ..report.words import clock, number, op_unit, quantity

    op = op_unit(found)
    out.print(one_line(f"{found.name}  ({found.source})"), style="bold", soft_wrap=True)
    gain = f"{found.pv_unit}/{op}" + ("/s" if found.integrating else "")

    def between(low: float | None, high: float | None, unit: str) -> str:
        return f"95 %: {number(low)} to {quantity(high, unit)}"

    rows = []
    if found.d is not None:
        share = "" if found.d_percent_span is None else f"; {number(found.d_percent_span)} % of span"
        rows.append(("Gap d", f"{quantity(found.d, op)}  ({between(found.low, found.high, op)}{share})"))
    if found.kp is not None:
        name = "Velocity gain" if found.integrating else "Process gain Kp"
        rows.append((name, f"{quantity(found.kp, gain)}  ({between(found.kp_low, found.kp_high, gain)})"))
    if found.travel is not None:
        width = found.travel
        told = width.reason or f"{quantity(width.d, op)}  ({between(width.low, width.high, op)})"
        rows.append(("Gap from travel", told))
    if found.settle is not None:
        rows.append(("PV settles within", quantity(found.settle, "s")))
    if rows:
        out.print(key_values([*rows, *(("Note", note) for note in found.notes)]))
    if not found.readings:
        return
    out.print()
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("Held until", no_wrap=True)
    for header in (f"OP [{op}]", f"PV [{found.pv_unit}{'/s' if found.integrating else ''}]", "reads", "95 %"):
        table.add_column(header, justify="right", no_wrap=True)
    table.add_column("from")
    for reading in found.readings:
        value, interval = "–", "–"
        if reading.value is not None:
            value = f"{'d' if reading.kind == 'gap' else 'Kp'} {number(reading.value)}"
            interval = f"{number(reading.low)} to {number(reading.high)}"
        table.add_row(
            clock(found.t0, reading.start),
            " → ".join(number(x) for x in reading.op),
            " → ".join(number(x, 4) for x in reading.pv),
            value,
            interval,
            styled(reading.evidence, style="" if reading.value is not None else "dim"),
        )
    out.print(table)
