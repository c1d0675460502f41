"""`glapp score`: the answers compared with the workshop's findings."""

from __future__ import annotations

import json as js
from collections.abc import Callable
from functools import cache
from hashlib import blake2b
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from ..recording import Recording
from ..report import scored as texts
from ..report import words
from ..score import Label, Scored, judged, read_labels, to_dict
from .inputs import Refused, Valve, open_files
from .options import Options
from .outputs import PAGE, check_output
from .screen import Column, out, say_error, show_table
from .work import analyze_all

__all__ = ["score"]

ROWS = 65536
"""Recordings are the same where so many of their first rows are."""


def score(
    labels: Annotated[
        Path, typer.Argument(metavar="LABELS", help="CSV with the columns file, loop, found, width, unit, date.")
    ],
    report: Annotated[
        Path | None, typer.Option(metavar="HTML", help="Write a report of the score, a section for each that differs.")
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", metavar="", help="One JSON object on standard output, nothing else.")
    ] = False,
) -> None:
    """Compare the answers with the workshop's findings: how many are right, wrong and silent.

    LABELS has a row per valve, with these columns:

    FILE is a recording or a loops.toml, from the folder of LABELS; LOOP which of its loops, where there are several.

    FOUND is gap, stiction, both, sound, or other where the loop swings for another reason.

    WIDTH is the measured dead band in the UNIT of OP, or in "% of span".

    DATE is when the valve was looked at: a recording that begins later is not counted.
    """
    known = read_labels(labels)
    if report is not None:
        check_output("--report", report, [labels, *(label.file for label in known)], PAGE)
    opened, faults = [], list[InputError]()
    seen: dict[bytes, Label] = {}
    loops = cache(_loops)  # a loops.toml may hold the valves of many rows
    for label in known:
        try:
            entry = _opened(label, _loops if label.loop is None else loops)
            _require_another(entry, label, seen)
            opened.append((label, entry))
        except InputError as error:
            faults.append(error)
    loops.cache_clear()  # nobody waits for the loops that have no label
    answers = analyze_all([entry for _, entry in opened], trust=False, fit=True) if opened else []
    scored = []
    for (label, _), answer in zip(opened, answers, strict=True):
        result = answer.result() if isinstance(answer, Refused) else answer
        try:
            scored.append(judged(label, result))
        except InputError as wrong:
            wrong.file = str(labels)
            faults.append(wrong)
    differ = [valve for valve in scored if valve.outcome == "wrong"]
    if json:
        typer.echo(js.dumps(to_dict(scored), ensure_ascii=False, allow_nan=False, indent=2))
    elif scored:
        _show(scored, differ)
    for fault in faults:
        say_error(fault)
    if report is not None and scored:
        from ..report.html import write_score

        write_score(scored, report)
        if not json:
            out.print(f"\nReport: {report}", soft_wrap=True)
    if faults:
        raise typer.Exit(1)


def _loops(file: Path) -> list[Recording | Valve | Refused]:
    return open_files([file], Options())


def _opened(label: Label, loops: Callable[[Path], list[Recording | Valve | Refused]]) -> Recording | Valve | Refused:
    """The one recording of a label.

    Raises InputError where there is none, or several and no loop is named.
    """
    if not label.file.exists():
        raise InputError("there is no such file", file=str(label.file), row=label.row, column="file")
    held = loops(label.file)
    opened = held if label.loop is None else [entry for entry in held if entry.name == label.loop]
    if len(opened) != 1:
        what = f"holds {len(held)} loops" if label.loop is None else f"has no loop '{label.loop}'"
        names = ", ".join(entry.name for entry in held[:20]) + (", …" if len(held) > 20 else "")
        hint = f"write one of its loops: {names}" if held else None
        raise InputError(what, file=str(label.file), row=label.row, column="loop", hint=hint)
    [entry] = opened
    return entry


def _require_another(entry: Recording | Valve | Refused, label: Label, seen: dict[bytes, Label]) -> None:
    """Refuse a recording that another row has already, under whatever name.

    Raises InputError: naming the first row.
    """
    if isinstance(entry, Refused):
        return
    recordings = entry.recordings if isinstance(entry, Valve) else [entry]
    text = blake2b()
    for recording in recordings:
        rows = recording.beginning(ROWS)
        for column in (rows.pv, rows.op):
            text.update(b"" if column is None else column.tobytes())
    first = seen.setdefault(text.digest(), label)
    if first is not label:
        name = first.loop or first.file.name
        what = f"is the same recording as {name} in row {first.row}"
        raise InputError(what, file=str(label.file), row=label.row, hint="a valve counts once: leave one of them out")


def _show(scored: list[Scored], differ: list[Scored]) -> None:
    """Print the tables of the score."""
    heads = ("the answer is", "right", "wrong", "silent", "right of those that say\nsomething (95 %)")
    _table(heads, texts.counts(scored))
    stated = texts.calibration(scored)
    if stated:
        out.print()
        _table(("probability of", "stated", "valves", "it was so in (95 %)"), stated)
    left = [valve for valve in scored if valve.outcome == "not counted"]
    if left:
        out.print()
        for valve in left:
            out.print(f"{valve.result.name}, row {valve.label.row}: not counted, {valve.why}.")
    if differ:
        out.print()
        show_table(
            [
                Column("differs", [valve.result.name for valve in differ]),
                Column("row", [str(valve.label.row) for valve in differ], True),
                Column("the workshop found", [texts.workshop(valve) for valve in differ]),
                Column("the answer", [words.headline(valve.result) or "–" for valve in differ]),
                Column("why", [valve.why for valve in differ]),
            ]
        )


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    """Show rows of which all but the first cell are numbers."""
    columns = zip(heads, zip(*rows, strict=True), strict=True)
    show_table([Column(head, list(cells), i > 0) for i, (head, cells) in enumerate(columns)])
