"""The joint fit over the recordings that are kept of a loop: in a process of its own, so that the monitor goes on."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..document import to_json
from ..errors import InputError
from ..estimate import analyze
from ..loop import Loop
from ..result import Result
from ..several_recordings import analyze_recordings
from .guide import read_test
from .recordings import SignalStore
from .repairs import repaired_at
from .store import NAME, Reader

__all__ = ["answered", "event_text", "row_of"]


def event_text(row: Mapping[str, Any]) -> str:
    """Sentence of an event on an answer: the one that leads it everywhere.

    - `row`: a row of `answers`.
    """
    [loop] = json.loads(row["document"])["analysis"]["loops"]
    return str(loop["answer"]["so"])


def answered(folder: Path, settings: str, begin: float, end: float) -> dict[str, Any]:
    """Joint answer of all kept recordings of a loop, as a row of `answers`: those since the last repair of its valve.

    A guided step test that has decided answers where normal operation leaves it open.

    - `folder`: the data folder.
    - `settings`: the loop, as JSON.
    - `begin`, `end`: from when to when [s since 1970 UTC].

    Raises InputError where there is no recording, or it cannot be read.
    """
    loop = Loop(**json.loads(settings))
    test = None
    if (folder / NAME).exists():  # a demonstration is fitted before it has one
        with Reader(folder) as reader:
            begin = max(begin, repaired_at(reader, loop.name, end))
            test = reader.guided_test(loop.name)
    recordings = SignalStore(folder).recordings(loop, begin, end)
    if not recordings:
        raise InputError("has no recording to fit yet", loop=loop.name)
    result = analyze(recordings[0]) if len(recordings) == 1 else analyze_recordings(recordings)
    return row_of(_with_test(result, test, SignalStore(folder), loop, begin), begin, end)


def _with_test(
    result: Result, test: Mapping[str, Any] | None, signals: SignalStore, loop: Loop, begin: float
) -> Result:
    """The result, with the guided test that has decided what normal operation leaves open."""
    state = None if test is None else test["state"]
    if state is None or state["found"] is None or state["begins"] < begin:
        return result
    # The stretch includes the last row of the test, whose time is rounded where it is stored.
    rows = signals.read(loop.name, state["begins"] - 1e-3, state["ends"] + 1e-3)
    read = read_test(rows, loop, test["asked"]["width"])  # type: ignore[index]  # there is a state
    return result if read is None else result.decided_with(step_test=read)


def row_of(result: Result, begin: float, end: float) -> dict[str, Any]:
    """A result as a row of `answers`: what its one answer says, and the document of all.

    - `result`: what was found.
    - `begin`, `end`: from when to when it was recorded [s since 1970 UTC].
    """
    one = result.answer
    fitted = result.fit is not None and one.verdict == result.fit.verdict
    reason = result.fit.reason if result.fit is not None and fitted else result.reason
    if one.step_test is not None and one.step_test.decided is not None:
        reason = result.texts()["why"][0]
    found = result.settings
    values = {"k": found.k, "ti": found.ti, "td": found.td, "kp": found.kp}
    learnt = {
        name: value
        for name, value in values.items()
        if value is not None and math.isfinite(value) and found.origins.get(name) in ("identified", "fitted")
    }
    return {
        "t_begin": begin,
        "t_end": end,
        "verdict": one.verdict,
        "d": one.width,
        "low": one.low,
        "high": one.high,
        "unit": result.unit,
        "reason": reason or "OP is not recorded",
        "compensable": one.compensable,
        "document": json.dumps({"learnt": learnt, "analysis": json.loads(to_json([result]))}),
    }
