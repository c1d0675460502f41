"""`glapp step-test`: the gap and the process gain out of a step test."""

from __future__ import annotations

import json as json_format
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from ..escape import in_quotes, one_line
from ..loop import Loop
from ..step_test import Reading, StepTest
from ..step_test import step_test as read_step_test
from ..writing import GENERATOR
from .inputs import Valve, open_files, read_by, recording_of
from .options import Options, with_options
from .outputs import PAGE, check_output, save
from .screen import Column, CommandError, key_values, out, say_error, show_table, styled

__all__ = ["step_test"]


@with_options
def step_test(
    files: Annotated[list[Path], typer.Argument(metavar="FILES", help="Recordings, loops.toml files, or both.")],
    options: Options,
    manual: Annotated[
        bool,
        typer.Option("--manual", metavar="", help="The whole recording was in manual: where it has no mode column."),
    ] = False,
    json: Annotated[
        bool, typer.Option("--json", metavar="", help="One JSON object on standard output, nothing else.")
    ] = False,
    plot: Annotated[Path | None, typer.Option(metavar="HTML", help="Write a zoomable picture of it.")] = None,
    page: Annotated[
        Path | None,
        typer.Option(metavar="HTML", help="Write the page to print and file: sequence, dead band, T86, pass or fail."),
    ] = None,
    allowed: Annotated[
        float | None,
        typer.Option(
            metavar="PERCENT",
            help="Widest dead band that passes in --page, in % of span; default: that of the loop, else 1.",
        ),
    ] = None,
) -> None:
    """Read gap and process gain off a step test: OP stepped twice one way and once back, and held each time.

    [bold]How to test a valve[/bold]: put the controller in manual. Step OP up by more than the gap may be, and wait \
until PV stands still. Step up once more, and wait. Step back by more than the gap, and wait. That is the least; \
further steps, two one way and two back, make the answer sharper.

    The first step only presses the valve to one side. The second gives the process gain Kp = ΔPV/ΔOP. What the step \
back moves OP, and PV does not follow, is the gap: d = |ΔOP| − |ΔPV|/Kp.
    """
    if allowed is not None and (page is None or not 0 < allowed <= 100):
        raise CommandError(
            "--allowed: " + ("goes with --page" if page is None else f"is {allowed:g}, must be 0 to 100")
        )
    if plot is not None:
        check_output("--plot", plot, read_by(files), PAGE)
    if page is not None:
        check_output("--page", page, [*read_by(files), *([] if plot is None else [plot])], PAGE)
    found: list[StepTest] = []
    loops: list[Loop] = []
    faults: list[InputError] = []
    for entry in open_files(files, options):
        for recording in entry.recordings if isinstance(entry, Valve) else [entry]:
            try:
                found.append(read_step_test(recording_of(recording), manual=manual))
                loops.append(recording.loop)  # type: ignore[arg-type]  # no refused one comes so far
            except InputError as error:
                faults.append(error)
    if json:
        answers = [test.to_dict() for test in found]
        answer = answers[0] if len(answers) == 1 and not faults else {"tests": answers}
        text = json_format.dumps(answer, indent=2, ensure_ascii=False, allow_nan=False)
        typer.echo(in_quotes(text).encode())
    else:
        for i, test in enumerate(test for test in found if test.reason is None or test.readings):
            if i:
                out.print()
            _show(test)
    if plot is not None and found:
        save(plot, _page(found))
        if not json:
            out.print(f"\nPicture: {plot}", soft_wrap=True)
    if page is not None and found:
        from ..report.form import form_page, judged

        pages = [judged(test, loop, allowed) for test, loop in zip(found, loops, strict=True)]
        save(page, form_page(pages))
        if not json:
            out.print(f"\nPage: {page}", soft_wrap=True)
    for fault in faults:
        say_error(fault)
    for test in found:
        if test.reason is not None:
            say_error(f"{test.source}, loop {test.name}: {test.reason}")
    if faults or any(test.reason is not None for test in found):
        raise typer.Exit(1)


def _page(found: Sequence[StepTest]) -> str:
    """The pictures of all tests in one page."""
    from ..report.figures import CONFIG, step_test_figure

    figures = [step_test_figure(test) for test in found]
    page: str = figures[0].to_html(config=CONFIG)
    others = "".join(figure.to_html(config=CONFIG, full_html=False, include_plotlyjs=False) for figure in figures[1:])
    head, body = page.replace("<head>", f"<head>{GENERATOR}", 1), "</body>"
    at = head.rindex(body)
    return head[:at] + others + head[at:]


def _show(found: StepTest) -> None:
    """Print the result of a step test."""
    from ..report.words import clock, number, op_unit, quantity

    op = op_unit(found.unit)
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
        text = width.reason or f"{quantity(width.d, op)}  ({between(width.low, width.high, op)})"
        rows.append(("Gap from travel", text))
    if found.settle is not None:
        rows.append(("PV settles within", quantity(found.settle, "s")))
    if rows:
        out.print(key_values([*rows, *(("Note", note) for note in found.notes)]))
    if not found.readings:
        return
    out.print()
    op_header, pv_header = f"OP [{op}]", f"PV [{found.pv_unit}{'/s' if found.integrating else ''}]"
    read = [reading.value is not None for reading in found.readings]
    show_table(
        [
            Column("Held until", [clock(found.t0, reading.start) for reading in found.readings]),
            Column(op_header, [" → ".join(number(x) for x in reading.op) for reading in found.readings], True),
            Column(pv_header, [" → ".join(number(x, 4) for x in reading.pv) for reading in found.readings], True),
            Column("reads", [_value(reading) for reading in found.readings], True),
            Column("95 %", [_interval(reading) for reading in found.readings], True),
            Column(
                "from",
                [
                    styled(reading.evidence, style="" if seen else "dim")
                    for reading, seen in zip(found.readings, read, strict=True)
                ],
            ),
        ]
    )


def _value(reading: Reading) -> str:
    from ..report.words import number

    return "–" if reading.value is None else f"{'d' if reading.kind == 'gap' else 'Kp'} {number(reading.value)}"


def _interval(reading: Reading) -> str:
    from ..report.words import number

    return "–" if reading.value is None else f"{number(reading.low)} to {number(reading.high)}"
