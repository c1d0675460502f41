"""A labelled folder of the corpus of ordinary loops, for `glapp score`: `python -m bench.labels FOLDER --numbers 3`.

Each record of `bench.ordinary` becomes a CSV file as a historian keeps it, and `labels.csv` has what is true of its
valve: a gap with its width, stiction, both, *sound*, or *other* where a load makes the loop swing. It is half B, on
which no rule was chosen, unless `--half A` is given.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import pyarrow.csv as pc

from .ordinary.design import ROWS, half, names
from .ordinary.records import record

FOUND = {"none": "sound", "gap": "gap", "friction": "stiction", "both": "both", "driven": "other"}
"""Words of a workshop for each fault of the corpus."""


def write(folder: Path, rows: list[str], which: str, numbers: int, seed: int) -> Path:
    """Write records and labels; the file of labels."""
    folder.mkdir(parents=True, exist_ok=True)
    wanted = [n for n in range(2 * numbers) if half(n) == which]
    labels = folder / "labels.csv"
    with labels.open("w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file)
        lines.writerow(["file", "found", "width", "unit"])
        for row in rows:
            for number in wanted:
                for name in names(row, number, seed):
                    made = record(name)
                    path = folder / f"{name.replace('/', '_').replace(' ', '_')}.csv"
                    pc.write_csv(made.table.rename_columns(["Time [s]", "SP", "PV", "OP", "MODE"]), path)
                    found = FOUND[made.truth.fault]
                    known = found == "gap"  # what a stem that sticks shows depends on how it is moved
                    lines.writerow([path.name, found, f"{made.truth.d:.4g}" if known else "", "%" if known else ""])
    return labels


def main() -> None:
    """Write recordings and their list of labels into a folder."""
    parser = argparse.ArgumentParser(prog="python -m bench.labels", description=__doc__.split("\n\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rows", help=f"some of: {', '.join(ROWS)}; all where not given, separated by commas")
    parser.add_argument("--half", choices=("A", "B"), default="B")
    parser.add_argument("--numbers", type=int, default=1, help="so many numbers of each row")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rows = given.rows.split(",") if given.rows else list(ROWS)
    print(write(given.folder, rows, given.half, given.numbers, given.seed))


if __name__ == "__main__":
    main()
