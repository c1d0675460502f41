"""The joint fit over the recordings that are kept of a loop: in a process of its own, so that the monitor goes on."""

from __future__ import annotations

import faulthandler
import json
import math
import os
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ..document import to_json
from ..errors import InputError
from ..estimate import analyze
from ..loop import Loop
from ..many import analyze_recordings
from ..result import Result
from .recordings import SignalStore

__all__ = ["answer", "answered", "row_of"]


def answer(to: Connection, folder: Path, settings: str, begin: float, end: float, longest: float) -> None:
    """Send what all kept recordings of a loop say together, as a row of `answers`, or a text where they say nothing.

    This process ends itself where that takes too long: nothing else stops a fit that is under way.

    Parameters
    ----------
    to : Connection
        Who waits for it.
    folder : Path
        The data folder.
    settings : str
        The loop, as JSON.
    begin, end : float
        From when to when [s since 1970 UTC].
    longest : float
        How long it may take, > 0 [s].
    """
    with open(os.devnull, "w") as nowhere:  # noqa: PTH123 - only the number of an open file is used
        faulthandler.dump_traceback_later(longest, exit=True, file=nowhere)
        try:
            to.send(answered(folder, settings, begin, end))
        except InputError as error:
            to.send(str(error))
        except Exception as error:  # it must not end the monitor
            to.send(f"{type(error).__name__}: {error}")
        finally:
            faulthandler.cancel_dump_traceback_later()


def answered(folder: Path, settings: str, begin: float, end: float) -> dict[str, Any]:
    """What all kept recordings of a loop say together, as a row of `answers`.

    Parameters
    ----------
    folder : Path
        The data folder.
    settings : str
        The loop, as JSON.
    begin, end : float
        From when to when [s since 1970 UTC].

    Raises
    ------
    InputError
        Where there is no recording, or it cannot be read.
    """
    loop = Loop(**json.loads(settings))
    recordings = SignalStore(folder).recordings(loop, begin, end)
    if not recordings:
        raise InputError("has no recording to fit yet", loop=loop.name)
    result = analyze(recordings[0]) if len(recordings) == 1 else analyze_recordings(recordings)
    return row_of(result, begin, end)


def row_of(result: Result, begin: float, end: float) -> dict[str, Any]:
    """A result as a row of `answers`: what its one answer says, and the document of all.

    Parameters
    ----------
    result : Result
        What was found.
    begin, end : float
        From when to when it was recorded [s since 1970 UTC].
    """
    one = result.answer
    fitted = result.fit is not None and one.verdict == result.fit.verdict
    reason = result.fit.reason if result.fit is not None and fitted else result.reason
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
