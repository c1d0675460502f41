"""A step test (8.5): read while it goes on, from the recordings here, or from a file. A person moves OP."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..loop import Columns, Loop
from ..reading import open_each
from ..reading.apart import Worker
from ..recording import AT_HIGH, AT_LOW, BAD, NOT_AUTO
from ..report.words import number, quantity
from ..step_test import StepTest, step_test

__all__ = ["lines_of", "next_step", "read", "read_apart", "read_file", "steps"]


def read(values: Mapping[str, Sequence[Any]], loop: Loop) -> StepTest | None:
    """Result of a test in samples of the service; None where the controller was in automatic all the time.

    - `values`: columns as the API gives them: `time`, `PV`, `OP`, `MODE`, `QUALITY`, `OP_LOW`, `OP_HIGH`.
    - `loop`: settings that go with them.
    """
    flags = np.zeros(len(values["time"]), np.uint8)
    for column, value, flag in (
        ("MODE", "MAN", NOT_AUTO),
        ("QUALITY", "bad", BAD),
        ("OP_LOW", 1, AT_LOW),
        ("OP_HIGH", 1, AT_HIGH),
    ):
        flags |= np.array([one == value for one in values[column]], bool).astype(np.uint8) * np.uint8(flag)
    if not (flags & NOT_AUTO).any():
        return None
    numbers = {name: [math.nan if x is None else x for x in values[name]] for name in ("PV", "OP")}
    try:
        return step_test(t=np.asarray(values["time"]), pv=numbers["PV"], op=numbers["OP"], flags=flags, loop=loop)
    except InputError:
        return None


def read_file(path: Path, loop: Loop, columns: Mapping[str, str | None], *, manual: bool) -> StepTest:
    """Result of a test in a recording of the person's own.

    - `path`: a file of one of `glapp.reading.files.FORMS`.
    - `loop`: settings that go with it; its name chooses among the loops of a file that holds several.
    - `columns`: columns by role ("time", "pv", "op", "mode"), where the guess is wrong.
    - `manual`: all of it was made in manual; for one without a mode column.

    Raises InputError where it cannot be read; with the file's own name, and not where it lies meanwhile.
    """
    named = Columns(**{key: value for key, value in columns.items() if value})
    try:
        [opened] = open_each(path, [loop.model_copy(update={"columns": named, "file": None, "files": ()})])
        if isinstance(opened, InputError):
            raise opened
        return step_test(opened, manual=manual)
    except InputError as error:
        error.file = path.name
        raise


def read_apart(path: Path, loop: Loop, columns: Mapping[str, str | None], *, manual: bool) -> StepTest:
    """Read a file in a process of its own, as `read_file` does: this one goes on whatever it holds, and has its memory.

    Raises InputError as `read_file`; where it ends that process, or takes more time or memory than
    `glapp.reading.bounds` allows.
    """
    with Worker() as worker:
        return worker.call(path.name, read_file, path, loop, columns, manual=manual)


def steps(width: float | None, unit: str) -> tuple[str, ...]:
    r"""Steps for the person, in order; the last says that the test is done.

    Parameters
    ----------
    width : float or None
        How wide the gap may be, by what is known [OP unit].
    unit : str
        Of OP.

    Examples
    --------
    >>> steps(2.0, "%")[1]
    'Step OP by more than the gap may be, 3\xa0% or more. Hold it until PV stands still, and as long again.'
    """
    size = "" if width is None else f", {quantity(1.5 * width, unit)} or more"
    return (
        "Put the controller in manual while the load is calm, and wait until PV stands still.",
        f"Step OP by more than the gap may be{size}. Hold it until PV stands still, and as long again.",
        "Step on in the same direction, and hold as long.",
        "Step back by clearly more than the gap, and hold as long.",
        "The test can be read. One more step each way makes the interval narrower; then back to automatic.",
    )


def next_step(found: StepTest | None, manual: bool) -> int:
    """Index of the next of the `steps`.

    - `found`: what was read so far.
    - `manual`: whether the controller is in manual now.

    Examples
    --------
    >>> next_step(None, False), next_step(None, True)
    (0, 1)
    """
    if found is not None and found.reason is None:
        return 4
    if not manual:
        return 0
    held = [] if found is None else [one.op for one in found.holds]
    moves = [b > a for a, b in pairwise(held)]
    if not moves:
        return 1
    return 3 if any(a == b for a, b in pairwise(moves)) else 2


def lines_of(found: StepTest, unit: str) -> list[str]:
    """Sentences on the result of a test: the gap, the process gain, each move's reading, or why there is none."""
    lines = []
    if found.d is not None:
        between = f"{number(found.low)} to {quantity(found.high, unit)}"
        lines.append(f"The gap is {quantity(found.d, unit)} (95 %: {between}).")
    if found.kp is not None:
        name = "velocity gain" if found.integrating else "process gain Kp"
        lines.append(f"The {name} is {number(found.kp)} (95 %: {number(found.kp_low)} to {number(found.kp_high)}).")
    if found.reason is not None:
        lines.append(found.reason[:1].upper() + found.reason[1:] + ".")
    lines.extend(f"{note[:1].upper()}{note[1:]}." for note in found.notes)
    for one in found.readings:
        a, b = one.op
        what = {"gain": "Kp", "gap": "gap"}.get(one.kind, "")
        value = "" if one.value is None else f"{what} {number(one.value)} ({number(one.low)} to {number(one.high)}), "
        lines.append(f"OP {number(a)} → {number(b)}: {value}{one.evidence}.")
    return lines
