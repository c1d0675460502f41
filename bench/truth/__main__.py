"""Measure every method on records whose truth is known, `python -m bench.truth`.

The short form takes 20 records of every kind, `--full` a thousand. Every answer goes to out/truth.csv as soon as it is
there; `--resume` goes on with what is in that file, and skips the answers that it has. The tables are printed, and
written into bench/results/truth.md with `--docs`.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, fields
from pathlib import Path
from time import perf_counter
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from ..page import write
from .answer import MethodAnswer
from .design import CELLS
from .methods import METHODS, answer_of
from .records import Truth, chosen, record
from .score import Scored, tables, worst

ROOT = Path(__file__).parents[2]
OUT = ROOT / "out" / "truth.csv"
SHORT, FULL = 20, 1000
SAID = ("verdict", "d", "low", "high", "at_least", "reason")


def ask(name: str, methods: tuple[str, ...]) -> list[tuple[str, MethodAnswer, float]]:
    """Answers of the methods on one record, and their times [s]."""
    made = record(name)
    assert made is not None
    answers = []
    for method in methods:
        begin = perf_counter()
        try:
            answer = answer_of(method, made[0])
        except Exception as error:
            raise RuntimeError(f"{method} failed on {name}: {error!r}") from error
        answers.append((method, answer, perf_counter() - begin))
    return answers


def measured(each: int, methods: tuple[str, ...], known: set[tuple[str, str]]) -> Iterator[tuple[Truth, Any]]:
    """Every record with its answers that are not known yet, cell by cell."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with ProcessPoolExecutor() as pool, Progress(*columns) as bar:
        choosing = bar.add_task("choosing records", total=len(CELLS))
        truths: list[Truth] = []
        for cell in CELLS:
            truths += chosen(cell, each, pool)
            bar.advance(choosing)
        task = bar.add_task("asking", total=len(truths))
        left = [tuple(m for m in methods if (truth.name, m) not in known) for truth in truths]
        for truth, answers in zip(
            truths, pool.map(ask, [truth.name for truth in truths], left, chunksize=4), strict=True
        ):
            yield truth, answers
            bar.advance(task)


def read(path: Path) -> list[Scored]:
    """Answers from a file."""
    kinds = {field.name: field.type for field in fields(Truth)}
    convert: dict[Any, Any] = {
        "int": int,
        "float": float,
        "str": str,
        "bool": lambda text: text == "True",
    }
    scored = []
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            truth = Truth(**{name: convert[kind](row[name]) for name, kind in kinds.items()})
            d, low, high, at_least = (
                float(row[name]) if row[name] else None for name in ("d_hat", "low", "high", "at_least")
            )
            columns = (row["method"], row["verdict"], d, low, high, at_least, row["reason"], float(row["seconds"]))
            scored.append(Scored(truth, *columns))
    return scored


def main() -> None:
    """Run, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m bench.truth", description=__doc__.split("\n\n")[0])
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--full", dest="each", action="store_const", const=FULL, default=SHORT, help="1000 of every kind")
    size.add_argument("--each", type=int, help="so many of every kind")
    parser.add_argument("--resume", action="store_true", help="go on with out/truth.csv")
    parser.add_argument("--docs", action="store_true", help="write the tables into bench/results/truth.md")
    given = parser.parse_args()
    begin = perf_counter()
    OUT.parent.mkdir(exist_ok=True)
    if not (given.resume and OUT.exists()):
        OUT.unlink(missing_ok=True)
    known = {(row.truth.name, row.method) for row in read(OUT)} if OUT.exists() else set()
    names = [field.name for field in fields(Truth)]
    with OUT.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        if not known:
            writer.writerow([*names, "method", "verdict", "d_hat", *SAID[2:], "seconds"])
        for truth, answers in measured(given.each, tuple(METHODS), known):
            of_truth = asdict(truth)
            for method, answer, seconds in answers:
                columns = ["" if getattr(answer, name) is None else getattr(answer, name) for name in SAID]
                writer.writerow([*(of_truth[name] for name in names), method, *columns, f"{seconds:.4f}"])
            file.flush()
    scored = read(OUT)
    records = len({row.truth.name for row in scored})
    text = f"{given.each} records of every kind, {records} in all.\n\n{tables(scored)}"
    print(text)
    for method in METHODS:
        print(f"\n### {method}: the worst\n\n{worst(scored, method)}")
    print(f"\n{perf_counter() - begin:.0f} s", file=sys.stderr)
    if given.docs:
        write("truth.md", text, "tables")


if __name__ == "__main__":
    main()
