"""`glapp fleet`: the valves of a whole lake, those to repair first at the top."""

from __future__ import annotations

import shlex
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.table import Table
from rich.text import Text

from ..errors import InputError
from ..escape import one_line
from .screen import err, examples, out, say_error, say_note

__all__ = ["fleet"]

fleet = typer.Typer(no_args_is_help=True, rich_markup_mode="rich")

_PARTS = {
    "files": "1/5 looking at files",
    "days": "2/5 judging days",
    "crossings": "3/5 following crossings",
    "windows": "4/5 reading windows",
    "loops": "5/5 fitting loops",
}
_SHOWN = 20
"""Loops of the table on the screen."""


class _Left(ProgressColumn):
    """Time that this part still takes by its own rate; nothing while that is not known."""

    def render(self, task: Task) -> Text:
        """One cell."""
        left = task.time_remaining
        if left is None or not task.total or task.completed < 3:
            return Text("")
        from ..report.words import duration

        return Text(f"part: {duration(left)} left", no_wrap=True)


# A second paragraph is shown with its line breaks: one text, so that it fits any terminal.
@fleet.callback(
    help="Judge the valves of a lake of Parquet files: which to repair first, which wear, which cannot be judged "
    "and why.\n\nA lake is a folder of Parquet files as historians and platforms write them: long (tag, time, value, "
    "quality) or wide (a file a loop), by day or by tag, out of order, overlapping. The results are Parquet tables and "
    "a report; a run that was stopped goes on where it was, and the next one reads only what is new. docs/fleet.md "
    "tells all of it."
)
def _fleet() -> None:
    """The commands of the fleet."""


@fleet.command(
    "make-demo", epilog=examples("glapp fleet make-demo lake", "glapp fleet make-demo small --loops 20 --days 3")
)
def make_demo(
    lake: Annotated[Path, typer.Argument(metavar="LAKE", help="Folder for the lake; made if missing, else empty.")],
    loops: Annotated[int, typer.Option(metavar="N", help="Number of loops, 10 to 10000.")] = 200,
    days: Annotated[int, typer.Option(metavar="N", help="Days of history, 1 to 3660.")] = 30,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the simulated mill.")] = 1,
) -> None:
    """Write a lake of simulated loops to try the fleet on, with bad data of every kind and the truth about it."""
    from ..fleet import make_demo

    with _bar() as bar:
        task = bar.add_task("writing days", total=days)
        make_demo(
            lake, loops=loops, days=days, seed=seed, progress=lambda done, total: bar.update(task, completed=done)
        )
    out.print(
        f"Wrote {loops} loops of {days} {'day' if days == 1 else 'days'} in {lake}; what is true of them is in "
        f"{lake / '_truth'}.",
        soft_wrap=True,
    )
    where = shlex.quote(str(lake))
    out.print("\nNext:", f"  glapp fleet analyze {where} --out results", sep="\n", soft_wrap=True)


@fleet.command(
    epilog=examples(
        "glapp fleet analyze lake --out results",
        "glapp fleet analyze lake --out results --loops settings.csv --time-zone Europe/Stockholm",
        "glapp fleet analyze lake --out results --engine spark",
    )
)
def analyze(
    lake: Annotated[Path, typer.Argument(metavar="LAKE", help="Folder of Parquet files; those below it are read too.")],
    results: Annotated[Path, typer.Option("--out", metavar="RESULTS", help="Folder of results, outside the lake.")],
    loops: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Settings: a loops.toml, or a CSV or Parquet table with a row per loop. Default: loops.toml, "
            "loops.parquet or loops.csv in the lake; without any, the loops found by the names of tags.",
        ),
    ] = None,
    time_zone: Annotated[
        str | None, typer.Option(metavar="ZONE", help="Zone of times without one, such as Europe/Stockholm.")
    ] = None,
    fits: Annotated[
        int, typer.Option(metavar="N", help="Most windows fitted per loop, 1 to 64; each takes a second.")
    ] = 8,
    engine: Annotated[
        Literal["local", "spark"],
        typer.Option(help="Run on this machine's cores, or on Spark (pip install 'glapp\\[spark]')."),
    ] = "local",
    workers: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Number of processes; default: one per core.")
    ] = None,
) -> None:
    """Judge all valves of a lake; stopped, it goes on where it was, and later it reads only what is new."""
    from .. import fleet as engines
    from ..fleet.report import lost_of
    from ..report.words import LIKELY

    with _bar() as bar:
        tasks: dict[str, Any] = {}

        def stage(name: str, total: int, done: int) -> None:
            if name not in tasks:  # what an earlier run made is no measure of the rate
                tasks[name] = bar.add_task(_PARTS[name], total=total - done)
                tasks[f"{name} before"] = done
            bar.update(tasks[name], completed=done - tasks[f"{name} before"])

        try:
            made = engines.analyze(
                lake, results, loops=loops, time_zone=time_zone, fits=fits, engine=engine, workers=workers, stage=stage
            )
        except KeyboardInterrupt:
            say_note("stopped; the same command goes on where it was")
            raise
    table = engines.read(results)
    every = table.to_pylist()
    found = [row for row in every if row["score"] is not None and row["acceptable"] != "within"]
    if found:
        out.print(_table(found[:_SHOWN]))
        if len(found) > _SHOWN:
            out.print(f"and {len(found) - _SHOWN} more in the report")
    valves = [row["confidence" if row["confidence"] in LIKELY else "valve"] for row in every]
    counts = {name: valves.count(name) for name in ("gap", "no_gap", *LIKELY, "unknown")}
    lost = made["lost"]
    beyond = sum(row["acceptable"] == "beyond" for row in found)
    out.print(
        f"{table.num_rows} loops: {counts['gap']} with a gap ({beyond} wider than the limit), "
        f"{counts['likely']} likely with one, {counts['no_gap']} without, {counts['likely_sound']} likely sound, "
        f"{counts['unknown'] + lost['loops']} cannot be judged ({lost['loops']} of them refused). "
        f"{made['seconds']:.0f} s.",
        soft_wrap=True,
    )
    out.print(
        f"The report is {results / 'report.html'}, the list for a spreadsheet {results / 'loops.csv'}, the tables are "
        f"in {results / made['folder']}.",
        soft_wrap=True,
    )
    if n := made["tables"]["problems"]["rows"]:
        codes = Counter(engines.read(results, "problems")["code"].to_pylist())
        each = ", ".join(f"{of} {code}" for code, of in codes.most_common())
        say_note(
            f"{n} problem{'s' * (n > 1)} in the lake ({each}), each with its place: the report's last part, and the "
            "table problems"
        )
    if missing := lost_of(lost):
        say_error(f"not in the answers: {missing}")
    if not table.num_rows:
        raise InputError("no loop of the lake has rows", file=str(lake), hint="see the problems in the report")
    if lost["loops"] or lost["files"]:
        raise typer.Exit(1)


def _bar() -> Progress:
    """Progress bar of a run."""
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(16),  # with the longest part, ten thousand loops and hours left it fits 80 characters
        TextColumn("{task.completed:.0f} of {task.total:.0f}"),
        _Left(),
        console=err,
        disable=not err.is_terminal,
    )


def _table(rows: list[dict[str, Any]]) -> Table:
    """Table of the valves to repair first."""
    from ..report.words import named, number

    table = Table(title="To repair first", title_justify="left")
    for name in ("loop", "area", "valve", "gap % of span (95 %)", "harm", "score"):
        table.add_column(name, justify="right" if name in ("harm", "score") else "left")
    for row in rows:
        high = "…" if row["high_percent"] is None else number(row["high_percent"])
        width = f"{number(row['width_percent'])} ({number(row['low_percent'])} to {high})"
        harm = "–" if row["harm"] is None else f"{100 * row['harm']:.0f} %"
        names = (one_line(row["loop"]), one_line(row["area"] or ""))
        table.add_row(*names, named(row["confidence"], row["verdict"]), width, harm, number(row["score"], 2))
    return table
