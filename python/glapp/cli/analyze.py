"""`glapp analyze`: recordings in, dead bands out."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.padding import Padding
from rich.text import Text

from .._glapp import to_text
from ..escape import for_spreadsheet, one_line
from ..planned import Plan
from ..repaired import Repair
from ..report import planned, repaired, words
from ..result import Result
from ..row import columns, rows
from ..writing import write_file
from .ask import asked, can_ask
from .inputs import Refused, open_files, read_by
from .options import Options, check_option, with_options
from .outputs import PAGE, TABLE, check_output, fault_of
from .screen import Column, CommandError, fitting, key_values, out, say_error, show_table, styled
from .work import analyze_all

__all__ = ["analyze"]


@with_options
def analyze(
    files: Annotated[list[Path], typer.Argument(metavar="FILES", help="Recordings, loops.toml files, or both.")],
    options: Options,
    as_loop: Annotated[
        str | None,
        typer.Option("--as-loop", metavar="NAME", help="All FILES are recordings of one loop and get one answer."),
    ] = None,
    report: Annotated[Path | None, typer.Option(metavar="HTML", help="Write a report with zoomable figures.")] = None,
    json: Annotated[
        bool, typer.Option("--json", metavar="", help="One JSON object on standard output, nothing else.")
    ] = False,
    table: Annotated[
        Path | None, typer.Option("--csv", metavar="CSV", help="Write a row per loop; - is standard output.")
    ] = None,
    trust: Annotated[
        bool, typer.Option("--trust", metavar="", help="Use K and Ti of an identification that is not usable, too.")
    ] = False,
    no_fit: Annotated[
        bool,
        typer.Option("--no-fit", metavar="", help="Leave out the fit of OP and PV, which takes a second per loop."),
    ] = False,
    why: Annotated[bool, typer.Option("--why", metavar="", help="Show the evidence of each answer.")] = False,
    plan: Annotated[
        bool,
        typer.Option(
            "--plan",
            metavar="",
            help="Where the answer is open, plan the test that would decide: up to some minutes per loop.",
        ),
    ] = False,
    op_within: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LOW HIGH", help="With --plan, limits of OP; those of the recording where not given."),
    ] = None,
    pv_within: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LOW HIGH", help="With --plan, limits of PV; those of the recording where not given."),
    ] = None,
    minutes: Annotated[float, typer.Option(metavar="NUMBER", help="With --plan, longest test.")] = 60.0,
) -> None:
    """Estimate the dead band of every loop, with how sure that is and the reasons."""
    to_output = str(table) == "-"
    if json and to_output:
        raise CommandError("--json and --csv - both write to standard output; name a file for --csv")
    limits = _limits(plan, no_fit, op_within, pv_within, minutes)
    to_table = None if to_output else table
    if to_table is not None:
        check_output("--csv", to_table, read_by(files), TABLE)
    if report is not None:
        check_output("--report", report, [*read_by(files), *([] if table is None else [table])], PAGE)
    opened = open_files(files, options, as_loop)
    if not json and not to_output and as_loop is None and can_ask():
        opened = asked(opened, options.settings())
    answers = analyze_all(opened, trust, fit=not no_fit, plan=limits)
    results = [a.result() if isinstance(a, Refused) else a for a in answers]
    # A file that cannot be written is no reason to lose the answers on the screen.
    table_fault = None if to_table is None else fault_of(to_table, lambda: write_file(to_table, _rows(results)))
    report_fault = None if report is None else fault_of(report, lambda: _write_report(results, report))
    if json:
        from ..document import to_json

        typer.echo(to_json(results).encode())
    elif to_output:
        typer.echo(_rows(results), nl=False)
    elif any(isinstance(a, Result) for a in answers):
        _show(answers, why)
    faults = [fault for fault in (table_fault, report_fault) if fault is not None]
    for error in [*(answer.error for answer in answers if isinstance(answer, Refused)), *faults]:
        say_error(error)
    if report is not None and report_fault is None and not json and not to_output:
        out.print(f"\nReport: {report}", soft_wrap=True)
    if faults or any(result.answer.valve == "refused" for result in results):
        raise typer.Exit(1)


def _limits(
    plan: bool,
    no_fit: bool,
    op_within: tuple[float, float] | None,
    pv_within: tuple[float, float] | None,
    minutes: float,
) -> dict[str, Any] | None:
    """Limits of a planned test; None where none is planned.

    Raises CommandError where an option contradicts another, or is out of its bounds.
    """
    if no_fit and plan:
        raise CommandError("--plan works on the fit, and --no-fit leaves it out")
    if not plan and (op_within is not None or pv_within is not None):
        raise CommandError("--op-within and --pv-within are limits of a planned test: add --plan")
    check_option("--op-within", op_within)
    check_option("--pv-within", pv_within)
    check_option("--minutes", minutes)
    return {"op_within": op_within, "pv_within": pv_within, "minutes": minutes} if plan else None


def _write_report(results: Sequence[Result], path: Path) -> None:
    """Write the report; Plotly and its templates are loaded only for it."""
    from ..report.html import write_report

    write_report(results, path)


def _rows(results: Sequence[Result]) -> str:
    """The answers as CSV, a row per loop in their order."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in columns()])
    for row in rows(results):
        writer.writerow(map(for_spreadsheet, row))
    return text.getvalue()


#: So many loops have a block each; more are a table.
_BLOCKS = 5
#: Number of loops below a table for which the reason is printed why they were not analysed.
_REFUSED = 3


def _show(answers: Sequence[Result | Refused], why: bool) -> None:
    """Print state and next step: a block a loop, or a table of many, the most urgent first; reasons in blocks only."""
    results = words.ranked([a.result() if isinstance(a, Refused) else a for a in answers])
    shown = [result for result in results if result.trace is not None]  # an error has a line of its own
    if why or len(results) <= _BLOCKS:
        for result in shown:
            _block(result, why)
        if not why:
            out.print(styled("Reasons: add --why", style="dim"))
        return
    show_table(fitting(_columns(results), 4))
    out.print()
    out.print(words.summary(results))
    _show_refused([result for result in shown if result.answer.valve == "refused"])
    out.print(styled("Reasons: add --why", style="dim"))
    for result in results:
        if result.plan is not None:
            out.print(f"\nWhat would decide, {one_line(_name(result))}:", soft_wrap=True)
            out.print(Padding(key_values(_planned(result.plan)), (0, 0, 0, 2)))
        if result.repair is not None:
            out.print(f"\nBefore and after the repair, {one_line(_name(result))}:", soft_wrap=True)
            _show_repair(result, result.repair, below=0, left=2)


def _show_refused(refused: Sequence[Result]) -> None:
    """Why the first loops were not analysed: the table has no room for what to correct, `--why` prints it for all."""
    for result in refused[:_REFUSED]:
        out.print(Padding(one_line(words.lead(result)), (1, 0, 0, 0)))
    if refused:
        out.print()


def _planned(plan: Plan) -> list[tuple[str, str]]:
    return [(name, one_line(text)) for name, text in planned.rows(plan)]


def _block(result: Result, why: bool) -> None:
    """Print the block of one loop, with reasons on request."""
    texts = result.texts()
    head = Text("  ").join(
        filter(None, [styled(_name(result), style="bold"), styled(texts["headline"]), _verdict(result)])
    )
    rows = [("", texts["so"]), ("do", texts["do"])]
    if result.loop.file is None and not result.loop.files:  # no loops.toml in which somebody could see and change it
        rows.append(("read", ", ".join(f"{signal} = {name}" for signal, name in result.columns.items())))
    reasons = [text for text in texts["why"] if text not in texts["so"]]
    if why:
        rows += [("why" if text is reasons[0] else "", text) for text in reasons]
    warnings = [f.text for f in result.quality if f.severity == "warning"]
    rows += [("note", words.sentence(text)) for text in warnings if text.lower() not in " ".join(reasons).lower()]
    if result.by_position is not None:
        rows.append(("by", result.by_position))
    out.print(head)
    out.print(Padding(key_values([(label, one_line(text)) for label, text in rows]), (0, 0, 1, 2)))
    if result.repair is not None:
        out.print(Padding("Before and after the repair", (0, 0, 0, 2)))
        _show_repair(result, result.repair, below=1, left=4)
    if result.plan is not None:
        out.print(Padding("What would decide", (0, 0, 0, 2)))
        out.print(Padding(key_values(_planned(result.plan)), (0, 0, 1, 4)))


def _show_repair(result: Result, repair: Repair, below: int, left: int) -> None:
    """Print the result of a repair, and a line for each number before and after it."""
    rows = repaired.rows(repair, result.unit, result.loop.pv_unit or "PV unit")
    lines = [(name, f"{before} → {after}{change and f': {change}'}") for name, before, after, change in rows]
    out.print(Padding(repaired.text(repair, result.unit), (0, 0, 0, left)))
    out.print(Padding(key_values(lines), (0, 0, below, left)))


def _columns(results: Sequence[Result]) -> list[Column]:
    """Columns of a row per loop: the answer first, then its evidence."""
    fitted = any(result.fit is not None for result in results)
    columns = [Column("loop", [one_line(_name(result)) for result in results])]
    if fitted:
        columns.append(Column("dead band\n(95 %)", [words.headline(result) or "–" for result in results], True))
    else:
        columns.append(Column("d̂", [words.quantity(r.d_hat, words.op_unit(r.unit)) for r in results], True))
    verdicts = [_verdict(result, probable=True) for result in results]
    columns.append(Column("valve" if fitted else "verdict", verdicts))
    columns.append(Column("to do", [words.todo(result) for result in results]))
    columns.append(Column("how soon", [words.URGENCIES[result.answer.urgency].lower() for result in results]))
    counts, reasons, quality = (list(column) for column in zip(*map(_cells, results), strict=True))
    columns.append(Column("quality", quality))
    if fitted:
        columns.append(Column("simple\nmethod", [_crossing(result) for result in results], True))
    return [*columns, Column("det./\nhalf-p.", counts, True), Column("rejected as", reasons)]


def _name(result: Result) -> str:
    """Name of the loop; with several recordings their number behind it."""
    several = [] if result.fit is None else result.fit.recordings
    return f"{result.name} ({len(several)} recordings)" if several else result.name


def _verdict(result: Result, probable: bool = False) -> Text:
    """The one verdict, whether its width is acceptable, and if asked how probable a gap is where that is open."""
    answer = result.answer
    parts = [words.verdict(result).lower()]
    if answer.acceptable is not None and answer.acceptable != "open":
        parts.append("too wide" if answer.acceptable == "beyond" else "acceptable")
    if probable and answer.confidence in ("likely", "cannot_tell") and answer.p_gap is not None:
        parts.append(to_text("answer.probable", {"p_gap": answer.p_gap}))
    return styled(", ".join(parts), style=_STYLES[answer.valve])


def _crossing(result: Result) -> Text:
    """Width that a PLC would show, in brackets and crossed out where the fit contradicts it."""
    text = words.quantity(result.d_hat, words.op_unit(result.unit))
    return styled(text, style="dim") if result.answer.struck is None else styled(f"({text})", style="dim strike")


def _cells(result: Result) -> list[str]:
    """Cells of the zero crossings: counts, reasons, quality."""
    worst = [f.code.replace("_", " ") for f in result.quality if f.severity != "info"]
    reasons = [f"{name.replace('_', ' ')} {n}" for name, n in result.ranked_reasons()[:2]]
    return [
        f"{result.detections}/{result.total_half_periods}" if result.trace else "–",
        ", ".join(reasons) or "–",
        ", ".join(worst[:2]) or ("good" if result.trace else "–"),
    ]


_STYLES = {"gap": "bold", "no_gap": "", "unknown": "dim", "refused": "red"}
