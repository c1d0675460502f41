"""The loop that every form holds, and how its cells are written. Nothing here knows the reader of glapp.

48 samples of FIC2104, 10 s apart from 2025-11-14 06:00:00 on. Where a form has a mode, rows 30 to 33 are in manual.
Where it has a quality, or words in the place of values, PV of rows 11 and 12 is bad.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

TAG = "FIC2104"
N = 48
STEP = 10.0
T0 = datetime(2025, 11, 14, 6)
K = np.arange(N)
SP = np.where(K < 24, 48.0, 48.5)
PV = np.round(48.2 + 0.9 * np.sin(K / 4), 2)
OP = np.round(55.1 + 2.5 * np.cos(K / 4), 2)
MANUAL = (30, 31, 32, 33)
MODE = ["MAN" if k in MANUAL else "AUTO" for k in range(N)]
BAD = (11, 12)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Export:
    """A file, and its correct content."""

    ending: str
    content: bytes
    loop: str | None = TAG
    """Part of the loop's name; None where no column tells, and the file's name is the loop's."""
    t: Floats = field(default_factory=lambda: K * STEP)
    sp: Floats | None = field(default_factory=lambda: SP)
    pv: Floats = field(default_factory=lambda: PV)
    op: Floats = field(default_factory=lambda: OP)
    t0: datetime | None = T0
    """First time as it is written; None where seconds count from nothing."""
    manual: Sequence[int] = ()
    bad: Sequence[int] = ()
    """Rows of which PV is not good."""
    answer: dict[str, Any] = field(default_factory=dict)
    """The setting that reads it, where the data are ambiguous: a key of the loop's settings."""


@dataclass(frozen=True)
class Form:
    """One layout."""

    name: str
    maker: str
    source: str
    """The maker's document that shows it."""
    make: Callable[[], Export]


FORMS: dict[str, Form] = {}


def form(maker: str, source: str) -> Callable[[Callable[[], Export]], Callable[[], Export]]:
    """Add a form by the name of the function that writes it."""

    def add(make: Callable[[], Export]) -> Callable[[], Export]:
        FORMS[make.__name__] = Form(make.__name__, maker, source, make)
        return make

    return add


def moments(step: float = STEP, t0: datetime = T0) -> list[datetime]:
    """The times of the rows."""
    return [t0 + timedelta(seconds=step * float(k)) for k in K]


def stamps(pattern: str = "%Y-%m-%d %H:%M:%S", step: float = STEP, t0: datetime = T0) -> list[str]:
    """The times of the rows as text."""
    return [moment.strftime(pattern) for moment in moments(step, t0)]


def american(t0: datetime = T0) -> list[str]:
    """11/14/2025 6:00:00 AM: no zeros in front."""
    rows_of_text = []
    for m in moments(t0=t0):
        hour = m.hour % 12 or 12
        rows_of_text.append(f"{m.month}/{m.day}/{m.year} {hour}:{m:%M:%S} {'AM' if m.hour < 12 else 'PM'}")
    return rows_of_text


def epoch(per_second: int) -> list[int]:
    """The times of the rows since 1970, in UTC."""
    first = int((T0 - datetime(1970, 1, 1)).total_seconds())
    return [int((first + STEP * float(k)) * per_second) for k in K]


def serials() -> list[float]:
    """The times of the rows as Excel counts days."""
    return [(m - datetime(1899, 12, 30)).total_seconds() / 86400 for m in moments()]


def number(x: float, decimal: str = ".") -> str:
    """A value, two digits behind the point."""
    return f"{x:.2f}".replace(".", decimal)


def column(values: Floats, decimal: str = ".", bad: dict[int, str] | None = None) -> list[str]:
    """Values as text, words in the place of some."""
    return [(bad or {}).get(k, number(x, decimal)) for k, x in enumerate(values)]


def lines(
    rows: Iterable[Sequence[Any]], delimiter: str = ",", end: str = "\r\n", quoting: int = csv.QUOTE_MINIMAL
) -> str:
    """Rows as a text file has them."""
    out = io.StringIO(newline="")
    csv.writer(out, delimiter=delimiter, lineterminator=end, quoting=quoting).writerows(rows)
    return out.getvalue()


def across(*columns: Sequence[Any]) -> list[list[Any]]:
    """Columns as rows."""
    return [list(row) for row in zip(*columns, strict=True)]


def text(content: str, encoding: str = "utf-8", ending: str = ".csv", **expected: Any) -> Export:
    """A text file."""
    return Export(ending, content.encode(encoding), **expected)


def as_json(data: Any, **expected: Any) -> Export:
    """A JSON file."""
    return Export(".json", json.dumps(data).encode(), **expected)


def by_tag(first: Sequence[str]) -> list[tuple[str, int, str, float]]:
    """(signal, row, time, value) of every sample, one tag after the other."""
    signals = {"PV": PV, "SP": SP, "OP": OP}
    return [(name, k, first[k], float(values[k])) for name, values in signals.items() for k in range(N)]
