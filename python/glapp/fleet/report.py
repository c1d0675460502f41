"""The report of a fleet: one page that needs nothing else, for the person who plans the next stop."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from .._glapp import to_text
from ..escape import for_spreadsheet
from ..report import words
from ..report.html import templates
from ..writing import write_file
from .results import manifest, read

__all__ = ["lost_of", "write_csv", "write_report"]

FIRST = 50
"""Valves in the first list; the table `loops` has all."""

REASONS = 1000
"""Loops that cannot be judged whose reason is listed; the table `loops` has all."""

GROUPS = 12
"""Bars of a Pareto at most."""

PLACES = 3
"""Places that are named of a kind of problem."""


class Group(NamedTuple):
    """Valves of one area, type or positioner."""

    name: str
    loops: int
    judged: int
    gaps: int
    beyond: int
    share: float
    cumulative: float


class Worn(NamedTuple):
    """A valve whose gap changes, with its windows for a small picture."""

    loop: dict[str, Any]
    points: list[tuple[float, float, float, float]]  # x, low, d, high, all 0..1
    line: tuple[float, float, float, float]
    top: float


def write_report(out: str | Path) -> Path:
    """Write `report.html` next to the results that it shows.

    - `out`: the folder of the results.

    Returns the page.

    Raises InputError where there are no results, or the page cannot be written.
    """
    out = Path(out)
    made = manifest(out)
    loops = read(out, "loops").to_pylist()
    scored = [row for row in loops if row["score"] is not None]
    ranked = [row for row in scored if row["acceptable"] != "within"]
    likely = {of: [row for row in loops if row["confidence"] == of] for of in words.LIKELY}
    page = templates().get_template("fleet.html")
    known = {
        "title": "Valves of the fleet",
        "made": made,
        "words": words,
        "loops": loops,
        "ranked": ranked,
        "first": ranked[:FIRST],
        "scale": _scale(ranked[:FIRST]),
        "short": _in_short(loops, ranked, likely),
        "paretos": [
            (title, groups, len({row[name] for row in loops if row[name]}) - len(groups))
            for title, name in (("area", "area"), ("type of valve", "valve_type"), ("positioner", "positioner"))
            if len(groups := _groups(loops, name)) > 1
        ],
        "worn": _worn(loops, read(out, "windows").to_pylist()),
        "unjudged": (unjudged := _unjudged(loops)),
        "reasons": [row for _, _, rows in unjudged for row in rows],
        "listed": REASONS,
        "sound": sorted((row for row in loops if row["valve"] == "no_gap"), key=lambda row: str(row["loop"])),
        "likely": sorted(likely["likely"], key=lambda row: -(row["p_beyond"] or 0.0)),
        "likely_sound": sorted(likely["likely_sound"], key=lambda row: str(row["loop"])),
        "within": [row for row in scored if row["acceptable"] == "within"],
        "others": [row for row in loops if row["score"] is None and row["valve"] == "gap"],
        "problems": _problems(read(out, "problems").to_pylist()),
        "lost": lost_of(made["lost"]),
        "partly": [row for row in loops if row["lost"] and row["valve"] != "refused"],
        "worn_in_all": sum(bool(row["changes"]) for row in loops),
        "span": _span(loops),
    }
    path = out / "report.html"
    write_file(path, page.render(known))
    return path


def write_csv(out: str | Path) -> Path:
    """Write the table `loops` as `loops.csv` next to the report, for a work list in a spreadsheet.

    - `out`: the folder of the results.

    Returns the file.

    Raises InputError where there are no results, OSError where it cannot be written.
    """
    table = read(out, "loops").drop_columns(["rank"])  # the rows are in its order
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.column_names)
    for row in table.to_pylist():
        cells = (cell.isoformat() if isinstance(cell, datetime) else cell for cell in row.values())
        writer.writerow(map(for_spreadsheet, cells))
    path = Path(out) / "loops.csv"
    write_file(path, text.getvalue())
    return path


def lost_of(lost: Mapping[str, int]) -> str:
    """Sentences on the parts of the lake that are not in the answers; empty where there are none.

    Examples
    --------
    >>> lost_of({"loops": 5, "files": 5, "rows": 7500, "left_out": 0, "not_understood": 0})
    '5 loops refused. 5 files could not be read in whole or in part (7500 rows, as far as is known).'
    >>> lost_of({"loops": 0, "files": 0, "rows": 0, "left_out": 0, "not_understood": 48})
    '48 files left out: no column names a signal of a loop.'
    """
    sentences = []
    if n := lost["loops"]:
        sentences.append(f"{words.count(n, 'loop')} refused.")
    if n := lost["files"]:
        rows = f" ({words.count(lost['rows'], 'row')}, as far as is known)" if lost["rows"] else ""
        sentences.append(f"{words.count(n, 'file')} could not be read in whole or in part{rows}.")
    if n := lost["not_understood"]:
        sentences.append(f"{words.count(n, 'file')} left out: no column names a signal of a loop.")
    if n := lost["left_out"]:
        sentences.append(f"{words.count(n, 'row')} left out for time, tag, unit or value.")
    return " ".join(sentences)


def _in_short(loops: Sequence[Any], ranked: Sequence[Any], likely: Mapping[str, Sequence[Any]]) -> str:
    """The summary of a run in a sentence."""
    beyond = [row for row in ranked if row["acceptable"] == "beyond"]
    gaps, none = (sum(row["valve"] == valve for row in loops) for valve in ("gap", "no_gap"))
    worn = sum(bool(row["changes"]) and (row["trend"] or 0) > 0 for row in loops)
    counts = {
        **{of: len(rows) for of, rows in likely.items()},
        "none": none,
        "unjudged": sum(row["hindrance"] is not None for row in loops),
    }
    sentences = [to_text("fleet.gaps", {"gaps": gaps, "all": len(loops), "beyond": len(beyond)})]
    sentences += [to_text(f"fleet.{of}", {"n": n}) for of, n in counts.items() if n]
    if beyond:
        sentences.append(to_text("fleet.first", {"names": ", ".join(row["loop"] for row in beyond[:3])}))
    if worn:
        sentences.append(to_text("fleet.grows", {"n": worn}))
    return " ".join(sentences)


def _scale(rows: Sequence[dict[str, Any]]) -> float:
    """Right end of the bars [% of span]: the widest gap, whatever its upper limit."""
    ends = [max(row["width_percent"] or 0.0, row["acceptable_percent"]) for row in rows]
    return 1.25 * max(ends, default=1.0)


def _groups(loops: Sequence[dict[str, Any]], column: str) -> list[Group]:
    """The valves by a column, those with most of the urgency first."""
    total = sum(row["score"] or 0.0 for row in loops)
    named = [row for row in loops if row[column]]
    found = []
    for name in sorted({row[column] for row in named}):
        of = [row for row in named if row[column] == name]
        gaps = [row for row in of if row["valve"] == "gap"]
        share = sum(row["score"] or 0.0 for row in of) / total if total else 0.0
        judged = sum(row["valve"] in ("gap", "no_gap") for row in of)
        beyond = sum(row["acceptable"] == "beyond" for row in gaps)
        found.append(Group(name, len(of), judged, len(gaps), beyond, share, 0.0))
    found.sort(key=lambda group: (-group.share, group.name))
    sums, groups = 0.0, []
    for group in found[:GROUPS]:
        sums += group.share
        groups.append(group._replace(cumulative=sums))
    return groups


def _worn(loops: Iterable[dict[str, Any]], windows: Sequence[dict[str, Any]]) -> list[Worn]:
    """The valves whose gap plainly changes, the fastest first."""
    changing = [row for row in loops if row["changes"]]
    changing.sort(key=lambda row: -(row["trend"] or 0.0))
    found = []
    for row in changing[:FIRST]:
        of = [
            w
            for w in windows
            if w["loop"] == row["loop"] and w["verdict"] in ("backlash", "stiction", "both") and w["high"]
        ]
        first, last = row["first"].timestamp(), row["last"].timestamp()
        length = max(last - first, 1.0)
        top = 1.1 * max([*(min(w["high"], 2 * w["d"]) for w in of), row["trend_d_last"], row["trend_d_first"]])
        points = [
            ((w["first"].timestamp() - first) / length, w["low"] / top, w["d"] / top, min(w["high"] / top, 1.0))
            for w in of
        ]
        ends = [(row[f"trend_{end}"].timestamp() - first) / length for end in ("first", "last")]
        found.append(Worn(row, points, (ends[0], row["trend_d_first"] / top, ends[1], row["trend_d_last"] / top), top))
    return found


def _unjudged(loops: Sequence[dict[str, Any]]) -> list[tuple[str, str, list[dict[str, Any]]]]:
    """The loops that cannot be judged, by the obstacle: the most frequent first."""
    of: dict[str, list[dict[str, Any]]] = {}
    for row in loops:
        if row["hindrance"] is not None:
            of.setdefault(row["hindrance"], []).append(row)
    order = sorted(of, key=lambda name: (-len(of[name]), name))
    return [
        (to_text(f"hindrance.{name}"), to_text(f"help.{name}"), sorted(of[name], key=lambda row: str(row["loop"])))
        for name in order
    ]


def _problems(rows: Sequence[dict[str, Any]]) -> list[tuple[str, int, list[str], str]]:
    """The problems by their kind: how many, the first places, what to do."""
    of: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        of.setdefault(row["code"], []).append(row)
    return [
        (
            code,
            len(found),
            [_place(row) for row in found[:PLACES]],
            "; ".join(dict.fromkeys(row["todo"] for row in found[:PLACES])),
        )
        for code, found in sorted(of.items())
    ]


def _place(row: dict[str, Any]) -> str:
    """Text of a data issue: its place, and what is wrong."""
    at = [row["file"], f"row {row['row']}" if row["row"] else "", row["tag"] or row["loop"], row["day"]]
    return f"{', '.join(part for part in at if part)}: {row['what']}"


def _span(loops: Sequence[dict[str, Any]]) -> str:
    """First and last day of the lake."""
    first: list[datetime] = [row["first"] for row in loops if row["first"] is not None]
    last: list[datetime] = [row["last"] for row in loops if row["last"] is not None]
    if not first:
        return "no time"
    begin, end = f"{min(first):%Y-%m-%d}", f"{max(last):%Y-%m-%d}"
    return begin if begin == end else f"{begin} to {end}"
