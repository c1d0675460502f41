"""Several recordings of one loop: each is judged by itself, and all get one width."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .estimate import analyze
from .fit import Verdict, fit_recordings
from .progress import Progress, shares
from .recording import Batch, Recording, joined
from .repair_split import since_repair
from .result import Result, harm_of
from .valve import in_order, one_valve

__all__ = ["analyze_recordings", "unfit"]


def analyze_recordings(
    recordings: Sequence[Recording], *, trust: bool = False, fit: bool = True, progress: Progress | None = None
) -> Result:
    """One answer of several recordings of one loop.

    Zero crossings, quality and signals are those of the recording that shows best what all say; `fit` is that of all
    (`glapp.fit`). A recording whose data allow no answer, or that swings in a clean sinusoid, does not count in it.

    - `recordings`: two or more.
    - `trust`, `fit`, `progress`: as in `glapp.analyze`.

    Raises InputError where they differ in unit, span, controller, process or positioner, or one cannot be read.
    """
    one_valve(recordings)
    recordings = in_order(since_repair(recordings))
    if len(recordings) == 1:
        return analyze(recordings[0], trust=trust, fit=fit, progress=progress)
    *judging, fitting = shares(progress, *[0.4 / len(recordings)] * len(recordings), 0.6)
    each = [
        analyze(recording, trust=trust, fit=False, progress=part)
        for recording, part in zip(recordings, judging, strict=True)
    ]
    source = ", ".join(recording.source for recording in recordings)
    if not fit or all("OP" not in recording.columns for recording in recordings):
        return replace(max(each, key=lambda result: result.detections), source=source)
    answer = fit_recordings(recordings, unfit=[unfit(result) for result in each], progress=fitting)
    best = each[next((i for i, single in enumerate(answer.recordings) if single.shown), 0)]
    messages = [*([] if answer.message is None else [answer.message]), *best.messages]
    harm = [
        harm_of(single.fit, (result.settings.k, result.settings.ti), _rows(recording, single.fit.best["t"]))
        for single, result, recording in zip(answer.recordings, each, recordings, strict=True)
        if single.left_out is None and single.fit.process is not None
    ]
    return best.decided_with(source=source, fit=answer, messages=messages, harm=harm)


def _rows(recording: Recording, t: Sequence[float]) -> Batch:
    """The rows of a recording that hold the cells at `t` [s]."""

    def within(batch: Batch) -> Batch:
        return batch[slice(np.searchsorted(batch.t, t[0]), np.searchsorted(batch.t, t[-1], side="right"))]

    return joined([rows for batch in recording.batches() if len(rows := within(batch))])


def unfit(result: Result) -> tuple[Verdict, str, str] | None:
    """Finding on the recording that rules out a fit, with the reason's code and sentence."""
    loop = result.loop
    primary = loop.cascade is not None and loop.cascade.role == "primary"
    if primary or loop.split_range or loop.shared_valve_with is not None:
        return "cannot_tell", "place", result.reason or ""
    for f in result.quality:
        if f.severity == "refuse" and f.code != "not_auto":
            return "cannot_tell", f.code, f.text
    sinusoids = (f for f in result.quality if f.code == "sinusoidal")
    return next((("oscillation", f.code, f.text) for f in sinusoids), None)
