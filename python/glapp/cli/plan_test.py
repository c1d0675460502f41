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
from ..plan import Plan, Planned
from ..plan import plan_test as plan
from ..report.words import number, op_unit
from .inputs import Valve, open_files, recording_of
from .options import Options, with_options
from .screen import err, key_values, out, say_error
from .work import PATIENCE

__all__ = ["plan_test"]


@with_options
def plan_test(
    files: Annotated[list[Path], typer.Argument(metavar="FILES...", help="Recordings, loops.toml files, or both.")],
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
        answers = [one.to_dict() for one in plans]
        text = json_format.dumps(answers[0] if len(answers) == 1 else answers, indent=2, ensure_ascii=False)
        typer.echo(in_quotes(text).encode())
    else:
        for i, one in enumerate(plans):
            if i:
                out.print()
            _show(one)
    for fault in faults:
        say_error(fault)
    if faults or any(all(test.power is None for test in one.tests) for one in plans):
        raise typer.Exit(1)


_NAMES = {"by_hand": "OP by hand", "setpoint": "Setpoint steps", "more_hours": "More hours"}


def _show(one: Plan) -> None:
    out.print(one_line(f"{one.name}  ({one.source})"), style="bold", soft_wrap=True)
    limits = f"OP within {_limits(one.op_within)}, PV within {_limits(one.pv_within)}, at most {one.within:g} min"
    rows = [("Question", f"is there a gap of {number(one.width)} {op_unit(one.unit)}?"), ("Limits", limits)]
    rows += [(_NAMES[test.kind], _text_of(test, one)) for test in one.tests]
    out.print(key_values([(name, one_line(text)) for name, text in rows]))


def _text_of(test: Planned, of: Plan) -> str:
    if test.power is None or test.minutes is None:
        return f"no: {test.reason}"
    if test.kind == "more_hours":
        more = f"{number(test.minutes / 60)} h" if test.minutes > 120 else f"{test.minutes:.0f} min"
        return f"{more} more of the same show the gap in {_share(test.power)}, if there is one (not simulated)"
    assert test.hold is not None
    what, unit = ("OP", op_unit(of.unit)) if test.kind == "by_hand" else ("SP", of.pv_unit)
    moves = " → ".join(number(x, 4) for x in test.moves)
    text = f"{what} {moves} {unit}, {_time(test.hold)} each, {number(test.minutes)} min in all. "
    if test.pv is not None and test.op is not None:
        text += f"PV stays within {_limits(test.pv)}"
        text += ". " if test.kind == "by_hand" else f", OP within {_limits(test.op)}. "
    return text + (
        f"It decides in {_share(test.power)}: {_share(test.with_gap)} of {test.simulations} simulations with the gap "
        f"show it, {_share(test.without)} of as many without show that there is none"
    )


def _share(of: float | None) -> str:
    return "–" if of is None else f"{100 * of:.0f} %"


def _limits(of: tuple[float, float]) -> str:
    return f"{number(of[0], 4)} to {number(of[1], 4)}"


def _time(seconds: float) -> str:
    return f"{number(seconds / 60)} min" if seconds >= 60 else f"{number(seconds)} s"
