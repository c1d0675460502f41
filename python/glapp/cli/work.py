"""The analysis of many loops at once, with a progress bar, and quick to stop."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from threading import Event
from time import monotonic
from typing import Any

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from ..errors import InputError, unforeseen
from ..escape import one_line
from ..estimate import analyze
from ..plan import with_plan
from ..recording import Recording
from ..repair import with_repair
from ..result import Result
from ..several_recordings import analyze_recordings
from .inputs import Refused, Valve
from .screen import err

__all__ = ["analyze_all"]

PATIENCE = 1.0
"""A progress bar appears after so many seconds."""


def analyze_all(
    opened: Sequence[Recording | Valve | Refused], trust: bool, fit: bool, plan: Mapping[str, Any] | None = None
) -> list[Result | Refused]:
    """Analyse in parallel; the answers in the order of the recordings, with a plan within limits where one is open."""
    done = [0.0] * len(opened)
    stop = Event()

    def answer(i: int) -> Result | Refused:
        def progress(fraction: float | None) -> None:
            done[i] = fraction or 0.0
            if stop.is_set():
                raise InterruptedError

        entry = opened[i]
        if isinstance(entry, Refused):
            return entry
        try:
            recordings = entry.recordings if isinstance(entry, Valve) else [entry]
            if len(recordings) > 1:
                result = analyze_recordings(recordings, trust=trust, fit=fit, progress=progress)
            else:
                result = analyze(recordings[0], trust=trust, fit=fit, progress=progress)
            result = with_repair(recordings, result, trust=trust, fit=fit)
            return result if plan is None else with_plan(recordings, result, **plan)
        except InputError as error:
            error.file = error.file or entry.source
            return Refused(entry.name, entry.source, error, entry.loop)
        except Exception as error:  # not to lose the answers of all other loops
            return Refused(entry.name, entry.source, unforeseen(error, entry.source, entry.name), entry.loop)
        finally:
            done[i] = 1.0
            for recording in entry.recordings if isinstance(entry, Valve) else [entry]:
                recording.release()

    begun = monotonic()
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        TimeRemainingColumn(),
        console=err,
        transient=True,
        disable=not err.is_terminal,
    )
    task = bar.add_task(f"{len(opened)} loops" if len(opened) > 1 else one_line(opened[0].name), total=len(opened))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        futures = [pool.submit(answer, i) for i in range(len(opened))]
        try:
            while wait(futures, timeout=0.1).not_done:
                bar.update(task, completed=sum(done))
                if monotonic() - begun > PATIENCE:
                    bar.start()
        except KeyboardInterrupt:
            stop.set()
            pool.shutdown(cancel_futures=True)
            raise
        finally:
            bar.stop()
    return [future.result() for future in futures]
