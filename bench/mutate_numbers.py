"""Deciding numbers that no test holds: `python -m bench.mutate_numbers FILE:NAME[:PLACE]... -- COMMAND`.

Each number is changed by a factor (`--factor`, 1.5), one at a time; COMMAND is run, and the file is put back. A number
whose change the command passes is not held. NAME is a constant of Rust or Python (`const NAME: f64 = 1.5;`,
`NAME = 1.5`, a row `NAME: f64 = 1.5, "unit";` of a table); PLACE is which number of its definition, 0 for the first.
Whole numbers stay whole. A change that does not compile would count as noticed: `--show` has what the command printed.

    python -m bench.mutate_numbers crates/fit/src/decide/thresholds.rs:TREND_ERRORS -- cargo test -p glapp-fit trend
"""

from __future__ import annotations

import re
import subprocess
import sys
from argparse import ArgumentParser
from dataclasses import dataclass
from pathlib import Path

NUMBER = re.compile(r"(?<![\w.])(\d[\d_]*(?:\.\d+)?(?:[eE][+-]?\d+)?)")

END = re.compile(r';|"|\n\s*\n|\n\w+ = ')
"""End of a definition."""


@dataclass(frozen=True)
class Place:
    """A number in a source file."""

    file: Path
    name: str
    place: int

    @classmethod
    def of(cls, text: str) -> Place:
        """FILE:NAME or FILE:NAME:PLACE."""
        file, name, *place = text.split(":")
        return cls(Path(file), name, int(place[0]) if place else 0)

    def changed(self, source: str, factor: float) -> tuple[str, str, str]:
        """The source with the number changed, and the number before and after."""
        definition = re.search(
            rf"^\W*(?:pub(?:\(\w+\))? )?(?:const )?{self.name}\b(?:: [^=\n]+)? = ", source, re.MULTILINE
        )
        if definition is None:
            raise SystemExit(f"{self.file}: defines no constant {self.name}")
        end = END.search(source, definition.end())
        numbers = list(NUMBER.finditer(source, definition.end(), end.start() if end else len(source)))
        if self.place >= len(numbers):
            raise SystemExit(f"{self.file}: {self.name} has no number {self.place}")
        at = numbers[self.place]
        before = at[1].replace("_", "")
        after = (
            str(max(round(int(before) * factor), int(before) + 1)) if before.isdigit() else repr(float(before) * factor)
        )
        return source[: at.start()] + after + source[at.end() :], before, after


def main() -> int:
    """Print what each change does; the exit code is the number of changes that nothing noticed."""
    parser = ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--factor", type=float, default=1.5)
    parser.add_argument("--show", action="store_true", help="print the last lines of what the command printed")
    parser.add_argument("places", nargs="+", type=Place.of)
    arguments = sys.argv[1:]
    if "--" not in arguments:
        parser.error("the command that must notice is missing: -- COMMAND")
    at = arguments.index("--")
    asked, command = parser.parse_args(arguments[:at]), arguments[at + 1 :]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        parser.error("the command fails without any change")
    kept = 0
    for place in asked.places:
        source = place.file.read_text()
        changed, before, after = place.changed(source, asked.factor)
        place.file.write_text(changed)
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False)
        finally:
            place.file.write_text(source)
        kept += done.returncode == 0
        says = "noticed" if done.returncode else "NOT NOTICED"
        print(f"{place.file}:{place.name}:{place.place}  {before} -> {after}  {says}", flush=True)
        if asked.show:
            print("\n".join((done.stdout + done.stderr).splitlines()[-8:]))
    print(f"{len(asked.places) - kept} of {len(asked.places)} noticed")
    return kept


if __name__ == "__main__":
    sys.exit(main())
