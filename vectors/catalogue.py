"""The catalogue as a page of the documentation: `python vectors/catalogue.py` prints it.

`make catalogue` writes vectors/catalogue.json from the crates. The site makes its page of it when it is built.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
JSON = HERE / "catalogue.json"

NUMBERED = {
    "flags": "Status flags, of which a status is a sum: what is the matter with a signal, a half-period or a module",
    "reasons": "Reasons for which a half-period is rejected, in the order in which the first is named",
    "standings": "What compensation does, or why it does nothing",
    "sources": "Where the width comes from that compensation takes its share of",
    "unfit": "Why the on-line estimate may not be compensated by; 0: it may",
    "ways": "How compensation finds the direction",
    "modes": "Who sets the output of a controller",
    "phases": "Where the autotuner's experiment stands",
    "stops": "Why it was broken off",
    "rules": "Which controller the autotuner in a controller offers",
    "doubts": "Why there is no corrected width",
    "parameters": "Parameters, as a controller's `ErrorID` names one that is out of bounds",
}


def page(catalogue: dict[str, Any]) -> str:
    """The catalogue as a page."""
    given = catalogue["defaults_for"]
    controller = f"K = {given['k']:g}, Ti = {given['ti']:g} s, Td = {given['td']:g} s, h = {given['h']:g} s"
    parts = [
        "# Names, numbers, units, bounds and defaults",
        "For whoever reads numbers out of glapp, or sets parameters. Made from the crates by `make catalogue`. Rust, "
        "Python, C, Structured Text and saved states share these names and numbers; a released number never changes.",
    ]
    for key, meaning in NUMBERED.items():
        parts += [f"## {key}", f"{meaning}.", _table(("name", "number"), sorted(_pairs(catalogue[key]), key=_number))]
    delays = [(f"`{name}`", f"{share:g}") for name, share in catalogue["longest_delays"].items()]
    parts += [
        "## longest delays",
        "Longest delay of u_FF with which compensation may be enabled next to another maker's controller, as a share "
        "of Ti; one scan is always allowed ([compensation.md](compensation.md#when-u_ff-comes-late)).",
        _table(("way", "Ti"), delays),
        "## conditions",
        "Of the safety net that can be switched off, one by one: " + ", ".join(catalogue["conditions"]) + ".",
    ]
    findings = [(f"`{f['code']}`", ", ".join(f["severities"])) for f in catalogue["findings"]]
    parts += [
        "## findings",
        "What may be wrong with a recording ([quality.md](quality.md)), in the order of the checks.",
        _table(("code", "severity"), findings),
    ]
    variables = [(f"`{v['name']}`", v["unit"], v["meaning"].replace("|", "\\|")) for v in catalogue["variables"]]
    parts += [
        "## inner variables",
        "What can be read in a detector while it runs ([modules.md](modules.md#inner-variables)).",
        _table(("name", "unit", "meaning"), variables),
    ]
    for block, settings in catalogue["settings"].items():
        rows = [(s["name"], s["unit"], s["bound"], _default(s["default"])) for s in settings]
        parts += [f"## settings of {block}", _table(("name", "unit", "bound", "default"), rows)]
    parts.append(
        f"Defaults are those for {controller}; of compensation for *inverse* and {given['share']:g} of a size of "
        f"{given['size']:g}. Kp where it is not known and both spans are: {catalogue['kp_default']:g} %/% with the "
        "sign of K, marked. No default: it must be given, is not known, or has no limit."
    )
    return "\n\n".join(parts) + "\n"


def _pairs(numbered: dict[str, int]) -> list[tuple[str, str]]:
    return [(f"`{name}`", str(number)) for name, number in numbered.items()]


def _number(pair: tuple[str, str]) -> int:
    return int(pair[1])


def _default(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [f"| {' | '.join(line)} |" for line in (head, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]])


if __name__ == "__main__":
    print(page(json.loads(JSON.read_text(encoding="utf-8"))), end="")
