"""`glapp plan-test`: which test would decide."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from time import monotonic
from typing import Annotated

import typer
from rich.progress import Progress

from ..errors import InputError
from ..escape import in_quotes, one_line
from ..estimate import analyze
from ..plan import plan_test as plan
from ..planned import Plan
from ..report import planned
from .inputs import Valve, open_files, recording_of
from .options import Options, check_option, with_options
from .screen import err, key_values, out, say_error
from .work import PATIENCE

__all__ = ["plan_test"]


@with_options
def plan_test(
    files: Annotated[list[Path], typer.Argument(metavar="FILES", help="Recordings, loops.toml files, or both.")],
    options: Options,
    op_within: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LOW HIGH", help="Limits of OP for the test; those of the recording where not given."),
    ] = None,
    pv_within: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LOW HIGH", help="Limits of PV for the test; those of the recording where not given."),
    ] = None,
    minutes: Annotated[float, typer.Option(metavar="NUMBER", help="Longest test.")] = 60.0,
    width: Annotated[
        float | None,
        typer.Option(
            metavar="NUMBER", help="Width in question, in the unit of OP; that of the answer where not given."
        ),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", metavar="", help="One JSON object on standard output, nothing else.")
    ] = False,
) -> None:
    """Say which test would decide whether a valve has a gap: the moves, the minutes, how far PV goes, and how surely.

    The fitted loop is simulated with the gap and without, and each simulated test is read as a real one would be. No \
test passes the limits in any simulation, with the process gain at its upper limit. Where nothing fits in the limits, \
the reason is told.
    """
    check_option("--op-within", op_within)
    check_option("--pv-within", pv_within)
    check_option("--minutes", minutes)
    check_option("--width", width)
    plans: list[Plan] = []
    faults: list[InputError] = []
    for entry in open_files(files, options):
        try:
            recording = recording_of(entry.recordings[-1] if isinstance(entry, Valve) else entry)
            begun = monotonic()
            with Progress(console=err, transient=True, disable=not err.is_terminal, auto_refresh=True) as bar:
                task = bar.add_task(one_line(recording.name), total=1.0, visible=False)

                def show(done: float | None, bar: Progress = bar, begun: float = begun, task: object = task) -> None:
                    bar.update(task, completed=done or 0.0, visible=monotonic() - begun > PATIENCE)  # type: ignore[arg-type]

                result = analyze(recording, progress=lambda done: show(0.3 * (done or 0.0)))
                plans.append(
                    plan(
                        recording,
                        result,
                        op_within=op_within,
                        pv_within=pv_within,
                        minutes=minutes,
                        width=width,
                        progress=lambda done: show(0.3 + 0.7 * (done or 0.0)),
                    )
                )
        except InputError as error:
            faults.append(error)
    if json:
        answers = [made.to_dict() for made in plans]
        text = json_format.dumps(answers[0] if len(answers) == 1 else answers, indent=2, ensure_ascii=False)
        typer.echo(in_quotes(text).encode())
    else:
        for i, made in enumerate(plans):
            if i:
                out.print()
            _show(made)
    for fault in faults:
        say_error(fault)
    if faults or any(all(test.power is None for test in made.tests) for made in plans):
        raise typer.Exit(1)


def _show(plan: Plan) -> None:
    """Print a plan."""
    out.print(one_line(f"{plan.name}  ({plan.source})"), style="bold", soft_wrap=True)
    out.print(key_values([(name, one_line(text)) for name, text in planned.rows(plan)]))
