"""Outcome of reading a form: right, right after one answer, refused, or wrong."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from glapp.errors import InputError
from glapp.reading import open_recordings
from glapp.recording import BAD, NOT_AUTO, Batch, Recording, joined

from .record import Export, Form

__all__ = ["Outcome", "of"]


@dataclass(frozen=True)
class Outcome:
    """`end` is "read", "asked", "refused" or "wrong"; `said` is the error, or what differs."""

    form: str
    end: str
    message: str = ""


def of(form: Form, folder: Path) -> Outcome:
    """Write the form into the folder, and read it with nothing but the file; where that is refused, with its answer."""
    want = form.make()
    path = folder / f"{form.name}{want.ending}"
    path.write_bytes(want.content)
    try:
        differs = _compare(_read(path, None), want, path)
    except InputError as error:
        text = str(error)
    else:
        return Outcome(form.name, "wrong" if differs else "read", differs)
    if not want.answer:
        return Outcome(form.name, "refused", text)
    try:
        differs = _compare(_read(path, want.answer), want, path)
    except InputError as error:
        return Outcome(form.name, "refused", f"{text}; with the answer: {error}")
    return Outcome(form.name, "wrong", differs) if differs else Outcome(form.name, "asked", text)


def _read(path: Path, answer: dict[str, Any] | None) -> list[tuple[Recording, Batch]]:
    opened = open_recordings(path, defaults=answer)
    return [(recording, joined(list(recording.batches()))) for recording in opened]


def _compare(read: list[tuple[Recording, Batch]], want: Export, path: Path) -> str:
    """Differences in a few words; "" where there are none."""
    if len(read) != 1:
        return f"{len(read)} loops: {', '.join(recording.name for recording, _ in read)}"
    [(recording, got)] = read
    name = want.loop or path.stem
    if name not in recording.name:
        return f"the loop is called {recording.name}"
    if len(got) != len(want.t):
        return f"{len(got)} rows, not {len(want.t)}"
    t0 = recording.t0 and recording.t0.replace(tzinfo=None)
    if t0 != want.t0:
        return f"begins at {t0}, not {want.t0}"
    if not np.allclose(got.t, want.t, atol=1e-3):
        return f"times: {got.t[:3].tolist()}, not {want.t[:3].tolist()}"
    flags = np.zeros(len(got), np.uint8) if got.flags is None else got.flags
    bad = sorted(set(np.flatnonzero((flags & BAD) | ~np.isfinite(got.pv)).tolist()))
    if bad != list(want.bad):
        return f"bad rows: {bad[:5]}, not {list(want.bad)}"
    if (found := np.flatnonzero(flags & NOT_AUTO).tolist()) != list(want.manual):
        return f"rows not in automatic: {found[:5]}, not {list(want.manual)}"
    good = np.setdiff1d(np.arange(len(want.t)), bad)
    for signal in ("sp", "pv", "op"):
        values, expected = getattr(got, signal), getattr(want, signal)
        if (values is None) != (expected is None):
            return f"{signal.upper()} is {'missing' if values is None else 'there'}"
        if expected is not None and not np.allclose(values[good], expected[good], rtol=1e-12):
            return f"{signal.upper()}: {values[good][:3].tolist()}, not {expected[good][:3].tolist()}"
    return ""
