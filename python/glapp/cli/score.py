"""`glapp score`: the answers beside what the workshop found."""

from __future__ import annotations

import json as js
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from ..recording import Recording
from ..report import words
from ..score import Count, Label, Scored, counted, judged, read_labels, share, to_dict
from .inputs import Refused, Valve, open_files
from .options import Options
from .outputs import PAGE, check_output
from .screen import Column, out, say_error, show_table
from .work import analyze_all

__all__ = ["score"]


def score(
    labels: Annotated[
        Path, typer.Argument(metavar="LABELS", help="CSV with the columns file, loop, found, width, unit, date.")
    ],
    report: Annotated[
        Path | None, typer.Option(metavar="HTML", help="Write a report of the valves on which answer and label differ.")
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", metavar="", help="One JSON object on standard output, nothing else.")
    ] = False,
) -> None:
    """Hold the answers against what the workshop found: how many are right, wrong and silent.

    LABELS has a row per valve. FILE is a recording or a loops.toml, from the folder of LABELS; LOOP which of its loops,
    where there are several. FOUND is gap, stiction, both, sound, or other where the loop swings for another reason.
    WIDTH is the measured dead band in the UNIT of OP, or in "% of span". DATE is when the valve was looked at: a
    recording that begins later is not counted.
    """
    known = read_labels(labels)
    if report is not None:
        check_output("--report", report, [labels, *(label.file for label in known)], PAGE)
    opened, faults = [], list[InputError]()
    loops = cache(_loops)  # a loops.toml may hold the valves of many rows
    for label in known:
        try:
            opened.append((label, _opened(label, _loops if label.loop is None else loops)))
        except InputError as error:
            faults.append(error)
    loops.cache_clear()  # nobody waits for the loops that have no label
    answers = analyze_all([entry for _, entry in opened], trust=False, fit=True)
    scored = []
    for (label, _), answer in zip(opened, answers, strict=True):
        result = answer.result() if isinstance(answer, Refused) else answer
        try:
            scored.append(judged(label, result))
        except InputError as wrong:
            wrong.file = str(labels)
            faults.append(wrong)
    differ = [one for one in scored if one.outcome == "wrong"]
    if json:
        typer.echo(js.dumps(to_dict(scored), ensure_ascii=False, allow_nan=False, indent=2))
    elif scored:
        _show(scored, differ)
    for fault in faults:
        say_error(fault)
    if report is not None and differ:
        from ..report.html import write_report

        write_report([one.result for one in differ], report)
        if not json:
            out.print(f"\nReport of the {len(differ)} that differ: {report}", soft_wrap=True)
    if faults:
        raise typer.Exit(1)


def _loops(file: Path) -> list[Recording | Valve | Refused]:
    return open_files([file], Options())


def _opened(label: Label, loops: Callable[[Path], list[Recording | Valve | Refused]]) -> Recording | Valve | Refused:
    """The one recording of a label.

    Raises
    ------
    InputError
        Where there is none, or several and no loop is named.
    """
    if not label.file.exists():
        raise InputError("there is no such file", file=str(label.file), row=label.row, column="file")
    opened = loops(label.file)
    if label.loop is not None:
        opened = [entry for entry in opened if entry.name == label.loop]
    if len(opened) != 1:
        what = f"holds {len(opened)} loops" if label.loop is None else f"has no loop '{label.loop}'"
        raise InputError(what, file=str(label.file), row=label.row, column="loop", hint="name one of its loops")
    [entry] = opened
    return entry


def _show(scored: list[Scored], differ: list[Scored]) -> None:
    counts = counted(scored)
    total = Count("all", *(sum(getattr(one, kind) for one in counts) for kind in ("right", "wrong", "silent")))
    rows = [*counts, total]
    show_table(
        [
            Column("the answer is", [one.confidence.replace("_", " ") for one in rows]),
            Column("right", [str(one.right) for one in rows], True),
            Column("wrong", [str(one.wrong) for one in rows], True),
            Column("silent", [str(one.silent) for one in rows], True),
            Column("right of those that say\nsomething (95 %)", [_share(one) for one in rows], True),
        ]
    )
    left = [one for one in scored if one.outcome == "not counted"]
    if left:
        out.print()
        for one in left:
            out.print(f"{one.result.name}, row {one.label.row}: not counted, {one.why}.")
    if differ:
        out.print()
        show_table(
            [
                Column("differs", [one.result.name for one in differ]),
                Column("row", [str(one.label.row) for one in differ], True),
                Column("the workshop found", [_found_text(one) for one in differ]),
                Column("the answer", [words.headline(one.result) or "–" for one in differ]),
                Column("why", [one.why for one in differ]),
            ]
        )


def _share(one: Count) -> str:
    found = share(one.right, one.wrong)
    if found is None:
        return "–"
    low, middle, high = (f"{100 * part:.0f}" for part in found)
    return f"{middle} % ({low} to {high})"


def _found_text(one: Scored) -> str:
    width = "" if one.width is None else f", {words.quantity(one.width, words.op_unit(one.result.unit))}"
    return f"{one.label.found}{width}"
