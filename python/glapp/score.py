"""Answers compared with the workshop's findings: right, wrong or silent.

A file of labels has a row per valve: the recording, and what was found when the valve was opened or tested. Each answer
is held against its label by rules that are fixed here, before any label is read, and counted by how sure it was.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import date
from itertools import pairwise
from pathlib import Path
from statistics import NormalDist
from typing import Any, Literal, get_args

from .checked import nearest
from .errors import InputError
from .reading.files import check_file, separator_of
from .result import Answer, Result, span_of

__all__ = [
    "Calibrated",
    "Count",
    "Found",
    "Label",
    "Outcome",
    "Scored",
    "calibrated",
    "counted",
    "judged",
    "read_labels",
    "share",
]

Found = Literal["gap", "stiction", "both", "sound", "other"]
"""Finding of the workshop. *other*: the loop swings, and the valve is not the reason."""

Outcome = Literal["right", "wrong", "silent", "not counted"]

FAULTS = ("gap", "stiction", "both")
"""Faults of the valve."""

COLUMNS = ("file", "loop", "found", "width", "unit", "date")
"""Columns that are read; `file` and `found` must be there."""


@dataclass(frozen=True, slots=True)
class Label:
    """Known state of one valve.

    - `row`: row of the file of labels; its header is row 1.
    - `file`: recording, or a loops.toml.
    - `loop`: which loop of it; None where it has one.
    - `found`: what the workshop found.
    - `width`: measured dead band, in `unit`.
    - `unit`: "" for that of OP, "% of span" for per cent of its span.
    - `date`: when the valve was looked at. A recording that begins later is not counted.
    """

    row: int
    file: Path
    loop: str | None
    found: Found
    width: float | None = None
    unit: str = ""
    date: date | None = None


@dataclass(frozen=True, slots=True)
class Scored:
    """One answer with its label.

    - `why`: in a sentence: what does not agree, or why it is not counted; "" where it agrees or is silent.
    - `width`: measured dead band [OP unit].
    """

    label: Label
    result: Result
    outcome: Outcome
    why: str = ""
    width: float | None = None


def read_labels(path: Path) -> list[Label]:
    r"""The labels of a CSV file; files in it are named from its own folder.

    Raises
    ------
    InputError
        Where a column is missing, or a cell cannot be used: with row, column, value and what is allowed.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "labels.csv"
    ...     _ = path.write_text("file,found,width\nFIC101.csv,gap,2.5\n")
    ...     [label] = read_labels(path)
    >>> label.found, label.width, label.row
    ('gap', 2.5, 2)
    """
    check_file(path, str(path))
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read: {error}", file=str(path)) from None
    if not text.strip():
        raise InputError("is empty", file=str(path), hint=f"write a row a valve, with the columns {', '.join(COLUMNS)}")
    lines = text.splitlines()
    comma = separator_of(lines[0])
    rows = csv.DictReader(lines, delimiter=comma)
    names = [name.strip().lower() for name in rows.fieldnames or []]
    for name in ("file", "found"):
        if name not in names:
            hint = f"labels have the columns {', '.join(COLUMNS)}, and this file has {', '.join(names[:20])}"
            raise InputError(f"has no column '{name}'", file=str(path), hint=hint)
    for name in names:
        if name not in COLUMNS and (near := nearest(name, COLUMNS)) is not None and near not in names:
            raise InputError(f"has a column '{name}': did you mean '{near}'?", file=str(path), row=1, column=name)
    labels: list[Label] = []
    for cells in rows:
        row = {key.strip().lower(): (value or "").strip() for key, value in cells.items() if isinstance(key, str)}
        if any(row.values()):
            labels.append(_label(row, rows.line_num, path))
    if not labels:
        raise InputError("has no row", file=str(path))
    _require_unique(labels, path)
    return labels


def _label(row: dict[str, str], number: int, path: Path) -> Label:
    """A label from a row of the list, checked."""

    def wrong(column: str, what: str, bound: str) -> InputError:
        return InputError(
            what, file=str(path), row=number, column=column, value=row.get(column), bound=bound, hint=f"write {bound}"
        )

    if not row["file"]:
        raise wrong("file", "names no recording", "the name of a file")
    found = row["found"].lower()
    if found not in get_args(Found):
        raise wrong("found", f"'{row['found']}' is no finding", f"one of {', '.join(get_args(Found))}")
    width = None
    if text := row.get("width"):
        try:
            width = float(text.replace(",", ".") if text.count(",") == 1 else text)
        except ValueError:
            width = math.nan
        if not 0.0 <= width < math.inf:
            raise wrong("width", f"'{text}' is no width", "a number ≥ 0")
    looked = None
    if text := row.get("date"):
        try:
            looked = date.fromisoformat(text[:10])
        except ValueError:
            raise wrong("date", f"'{text}' is no date", "2026-03-31, year, month, day") from None
    loop, unit = row.get("loop") or None, row.get("unit") or ""
    return Label(number, path.parent / row["file"], loop, found, width, unit, looked)  # type: ignore[arg-type]


def _require_unique(labels: Sequence[Label], path: Path) -> None:
    """Refuse a valve that occurs twice."""
    seen: dict[tuple[Path, str | None], Label] = {}
    for label in labels:
        first = seen.setdefault((label.file.resolve(), label.loop), label)
        if first is not label:
            name = label.loop or label.file.name
            raise InputError(f"{name} is in row {first.row} already", file=str(path), row=label.row)


def judged(label: Label, result: Result) -> Scored:
    """Compare one answer with the finding on the valve.

    A fault is answered *right* where a dead band is found or likely, its cause is no other, and its interval holds the
    measured width. *Sound* is right of it below a bound that is wider than the measured width, and else wrong. A valve
    without a fault is answered wrong where a dead band beyond the acceptable limit is found or likely. What cannot be
    told, or was not analysed, is silent.

    Raises InputError where the width's unit is neither that of OP nor "% of span" with a known span.
    """
    answer, width = result.answer, _in_op(label, result)
    if label.date is not None and result.t0 is not None and result.t0.date() > label.date:
        return Scored(label, result, "not counted", f"it was recorded after {label.date}", width)
    outcome, why = (_of_fault if label.found in FAULTS else _of_sound)(label, answer, width)
    return Scored(label, result, outcome, why, width)


def _of_fault(label: Label, answer: Answer, width: float | None) -> tuple[Outcome, str]:
    """Outcome for a valve with a fault, and why."""
    if answer.verdict == "oscillation":
        return "wrong", "the answer says that the valve is not the reason"
    if answer.confidence in ("sound", "none_seen"):
        if width is not None and answer.high is not None and width <= answer.high:
            return "right", ""
        if width is None and answer.confidence == "none_seen":
            return "silent", ""
        return "wrong", "the answer sees no dead band"
    if answer.confidence == "likely_sound":
        limit = None if answer.limit is None else answer.limit.width
        within = width is not None and limit is not None and width <= limit
        return ("right", "") if within else ("wrong", "the answer calls the valve likely sound")
    if answer.confidence not in ("found", "likely"):
        return "silent", ""
    if {label.found, answer.cause} == {"gap", "stiction"} or (label.found, answer.cause) == ("stiction", "backlash"):
        return "wrong", f"the answer says {answer.cause}"
    low, high = answer.low, math.inf if answer.high is None else answer.high
    if width is not None and answer.width_kind != "unsure" and low is not None and not low <= width <= high:
        return "wrong", "the measured width is outside the interval"
    return "right", ""


def _of_sound(label: Label, answer: Answer, width: float | None) -> tuple[Outcome, str]:
    """Outcome for a sound valve, and why."""
    if answer.confidence in ("found", "likely"):
        within = answer.acceptable == "within"
        return ("right", "") if within else ("wrong", "the answer sees a dead band")
    if answer.confidence in ("sound", "none_seen", "likely_sound") or answer.verdict == "oscillation":
        return "right", ""
    return "silent", ""


def _in_op(label: Label, result: Result) -> float | None:
    """The measured width in OP's unit."""
    if label.width is None or label.unit in ("", result.unit):
        return label.width
    span = span_of(result.loop)
    if label.unit in ("%", "% of span") and span is not None:
        return label.width / 100.0 * span
    hint = f"write {result.unit or 'nothing'}" + ("" if span is None else " or '% of span'")
    raise InputError(f"'{label.unit}' is not the unit of OP", loop=result.name, row=label.row, column="unit", hint=hint)


@dataclass(frozen=True, slots=True)
class Count:
    """Numbers of right, wrong and silent answers of one confidence."""

    confidence: str
    """Confidence of the answers, or *oscillation*."""
    right: int
    wrong: int
    silent: int


def counted(scored: Sequence[Scored]) -> list[Count]:
    """Right, wrong and silent answers by confidence, the surest first; answers that do not count are left out."""
    order = (
        "found",
        "likely",
        "sound",
        "none_seen",
        "likely_sound",
        "oscillation",
        "cannot_tell",
        "not_judged",
        "refused",
    )
    counts = []
    for confidence in order:
        outcomes = [valve.outcome for valve in scored if _outcome(valve.result.answer) == confidence]
        right, wrong, silent = (outcomes.count(kind) for kind in ("right", "wrong", "silent"))
        if right or wrong or silent:
            counts.append(Count(confidence, right, wrong, silent))
    return counts


def _outcome(answer: Answer) -> str:
    """Confidence of the answer; an oscillation for another reason is an answer of its own."""
    return answer.verdict if answer.verdict == "oscillation" else answer.confidence


EDGES = (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0)
"""Probabilities are counted together between these."""


@dataclass(frozen=True, slots=True)
class Calibrated:
    """Stated probabilities compared with how often they were right.

    - `of`: of a dead band, or of one beyond the acceptable limit.
    - `low`, `high`: probabilities from `low` on and below `high` are counted together; 1 counts in the last.
    - `valves`, `so`: valves, and those of them where it was so.
    - `stated`: mean of the probabilities.
    """

    of: Literal["p_gap", "p_beyond"]
    low: float
    high: float
    valves: int
    so: int
    stated: float


def calibrated(scored: Sequence[Scored]) -> list[Calibrated]:
    """Whether events with a stated probability of 80 % occur in 80 %.

    A valve with a fault has a dead band, a *sound* one has none; of *other* nobody looked. Whether a dead band is
    beyond the limit is known where its width was measured, and of a sound valve.
    """
    rows = []
    for of in ("p_gap", "p_beyond"):
        events = [
            (stated, so)
            for valve in scored
            if valve.outcome != "not counted"
            and (stated := getattr(valve.result.answer, of)) is not None
            and (so := _is_so(of, valve)) is not None
        ]
        for low, high in pairwise(EDGES):
            within = [(p, so) for p, so in events if low <= p < high or p == high == EDGES[-1]]
            if within:
                stated = sum(p for p, _ in within) / len(within)
                rows.append(Calibrated(of, low, high, len(within), sum(so for _, so in within), stated))
    return rows


def _is_so(of: str, valve: Scored) -> bool | None:
    """Whether an event of a probability is true; None where that is not known."""
    if valve.label.found == "sound":
        return False
    if valve.label.found == "other":
        return None
    if of == "p_gap":
        return True
    limit = valve.result.answer.limit
    return None if valve.width is None or limit is None or limit.width is None else valve.width > limit.width


def share(right: int, wrong: int) -> tuple[float, float, float] | None:
    """Share of right answers among those that say something, with its 95 % interval (Wilson); None where none does.

    Examples
    --------
    >>> low, middle, high = share(9, 1)
    >>> f"{middle:.0%} ({low:.0%} to {high:.0%})"
    '90% (60% to 98%)'
    """
    n = right + wrong
    if n == 0:
        return None
    p, z = right / n, NormalDist().inv_cdf(0.975)
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return middle - half, p, middle + half


def to_dict(scored: Sequence[Scored]) -> dict[str, Any]:
    """The score for programs: a row a valve, the counts, and the calibration of the probabilities."""
    valves = [
        {
            "row": valve.label.row,
            "file": str(valve.label.file),
            "loop": valve.result.name,
            "found": valve.label.found,
            "measured_width": valve.width,
            "unit": valve.result.unit,
            "confidence": valve.result.answer.confidence,
            "cause": valve.result.answer.cause,
            "width": valve.result.answer.width,
            "low": valve.result.answer.low,
            "high": valve.result.answer.high,
            "outcome": valve.outcome,
            "why": valve.why or None,
        }
        for valve in scored
    ]
    counts = [
        {"confidence": count.confidence, "right": count.right, "wrong": count.wrong, "silent": count.silent}
        for count in counted(scored)
    ]
    return {"valves": valves, "counts": counts, "calibration": [asdict(row) for row in calibrated(scored)]}
