"""Read sixty exports of historians and control systems unaided, and count: `python -m bench.makers`.

`--write FOLDER` keeps the files there, `--docs` prints the table of bench/results/file_forms.md and reads nothing.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path

from rich.console import Console
from rich.table import Table

from . import FORMS, guide
from .score import of


def main() -> None:
    """Write all forms, read them, and print the outcomes."""
    parser = argparse.ArgumentParser(prog="python -m bench.makers", description=__doc__.split("\n\n")[0])
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="keep the files here")
    parser.add_argument("--docs", action="store_true", help="print the table of bench/results/file_forms.md")
    given = parser.parse_args()
    if given.docs:
        print(guide(), end="")
        return
    with tempfile.TemporaryDirectory() as scratch:
        folder = given.write or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        outcomes = [of(form, folder) for form in FORMS.values()]
    table = Table("form", "maker", "end", "said", box=None)
    for form, outcome in zip(FORMS.values(), outcomes, strict=True):
        table.add_row(form.name, form.maker, outcome.end, outcome.message.replace(str(folder), ""))
    console = Console()
    console.print(table)
    counts = Counter(outcome.end for outcome in outcomes)
    ends = ("read", "asked", "refused", "wrong")
    console.print(f"{len(outcomes)} forms: " + ", ".join(f"{counts[end]} {end}" for end in ends))


if __name__ == "__main__":
    main()
