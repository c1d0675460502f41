"""Answer on a record, with all that can decide it, on one line."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time
from typing import Any, Self

import numpy as np

import glapp
from glapp import _glapp
from glapp.fit import Fit

from .records import LIMIT, Truth, record

FOUND = ("found",)
CLAIMED = ("found", "likely")

DRAWN = ("t", "pv", "predicted", "position")
"""Columns of the evidence that only a picture needs."""

OLD = {
    "backlash": ("found", "backlash", "interval"),
    "stiction": ("found", "stiction", "interval"),
    "both": ("found", "both", "interval"),
    "at_least": ("found", None, "bound"),
    "sound": ("none_seen", None, "bound"),
}
"""Confidence, cause and kind of width of a verdict that has no such fields; of any other it is *cannot_tell*."""


@dataclass(frozen=True)
class Claim:
    """Claim of an answer.

    Attributes
    ----------
    confidence : str
        *found, likely, cannot_tell, likely_sound, none_seen, sound, refused* or *not_judged*.
    cause, width_kind : str or None
        As in the answer's document.
    d, low, high : float or None
        Width and its limits [% of OP], told or withheld.
    """

    confidence: str
    cause: str | None
    width_kind: str | None
    d: float | None
    low: float | None
    high: float | None

    @property
    def sided(self) -> bool:
        """Whether it is a width with an interval."""
        return self.confidence in CLAIMED and self.width_kind == "interval" and None not in (self.low, self.high)

    def holds(self, d: float) -> bool:
        """Whether the interval holds a width."""
        return self.low is not None and self.high is not None and self.low <= d <= self.high


@dataclass(frozen=True)
class Line:
    """A record, or several of one valve, with its answers.

    - `truth`: of the first, where there are several.
    - `recordings`: how many days of one valve were asked about together.
    - `document`: `Result.to_dict()` of one recording; of several only `fit`.
    - `evidence`: `Fit.best`, everything that the core has to tell of the window, without the columns of a picture.
    - `error`: what an input error said.
    - `seconds`: of the processor.
    """

    truth: Truth
    recordings: int
    document: dict[str, Any]
    evidence: dict[str, Any]
    error: str | None
    seconds: float

    @property
    def key(self) -> tuple[str, int]:
        """Key of the record."""
        return self.truth.name, self.recordings

    @property
    def fit(self) -> dict[str, Any]:
        """The fit's part of the document; empty without a fit."""
        return self.document.get("fit") or {}

    def claim(self, again: bool = False) -> Claim:
        """Claim of an answer; `again`: as the ladder of today judges the stored evidence, without a fit."""
        if self.error is not None:
            return Claim("refused", None, None, None, None, None)
        answer, fit, best = self.document.get("answer") or {}, self.fit, self.evidence
        numbers = {name: fit.get(name) for name in ("d", "low", "high")}
        refused = "refused" in (answer.get("verdict"), answer.get("confidence"))
        # A clean sinusoid silences the fit, whatever its evidence is.
        silenced = refused or fit.get("reason_code") == "sinusoidal"
        if again and "evidence" in best and not silenced:
            return _judged(_glapp.fit_judgement(json.dumps(best["evidence"])), numbers)  # type: ignore[attr-defined]
        if "confidence" in answer:
            kept = {"d": answer["width"], "low": answer["low"], "high": answer["high"]}
            numbers = {name: numbers[name] if value is None else value for name, value in kept.items()}
            return Claim(answer["confidence"], answer["cause"], answer["width_kind"], **numbers)
        for part in (fit, best):
            if "confidence" in part:
                return _judged(part, numbers)
        if refused:
            return Claim("refused", None, None, **numbers)
        confidence, cause, kind = OLD.get(fit.get("verdict", ""), ("cannot_tell", None, None))
        return _judged({"confidence": confidence, "cause": cause, "width_kind": kind}, numbers)

    def to_json(self) -> str:
        """The answer as one line of JSON, null for a value that is no number."""
        return json.dumps(_plain(asdict(self)), allow_nan=False)

    @classmethod
    def of(cls, text: str) -> Self:
        """An answer from a line of `to_json`."""
        line = json.loads(text)
        return cls(**line | {"truth": Truth(**line["truth"])})


def _judged(fit: Mapping[str, Any], numbers: Mapping[str, float | None]) -> Claim:
    """Verdict of the fit; a valve without a gap is *sound* where its bound is within the acceptable limit."""
    confidence, high = fit["confidence"], numbers["high"]
    if confidence == "none_seen" and high is not None and high <= LIMIT:
        confidence = "sound"
    return Claim(confidence, fit["cause"], fit["width_kind"], **numbers)


def ask(name: str, recordings: int = 1) -> Line:
    """All answers on a record, or on so many days of one valve together."""
    made = [record(name if day == 0 else f"{name}/{day}") for day in range(recordings)]
    document: dict[str, Any] = {}
    evidence: dict[str, Any] = {}
    error = None
    begin = process_time()
    try:
        fit: Fit | None
        if recordings == 1:
            result = glapp.analyze(made[0].recording)
            fit, document = result.fit, result.to_dict()
        else:
            fit = glapp.fit([one.recording for one in made])
            document = {"fit": fit.to_dict()}
        evidence = {k: v for k, v in (fit.best if fit is not None else {}).items() if k not in DRAWN}
    except glapp.InputError as refused:
        error = str(refused)
    return Line(made[0].truth, recordings, document, evidence, error, process_time() - begin)


def read(path: Path) -> list[Line]:
    """All lines of a file."""
    return [Line.of(text) for text in path.read_text(encoding="utf-8").splitlines()]


def done(path: Path) -> set[tuple[str, int]]:
    """Finished lines of a file; a line that was cut off while it was written is removed from it."""
    if not path.exists():
        return set()
    texts = path.read_text(encoding="utf-8").splitlines(keepends=True)
    if texts and not texts[-1].endswith("\n"):
        path.write_text("".join(texts[:-1]), encoding="utf-8")
        texts = texts[:-1]
    return {Line.of(text).key for text in texts}


def _plain(x: Any) -> Any:
    """A value in types that JSON has; numbers to six digits."""
    if isinstance(x, dict):
        return {str(key): _plain(value) for key, value in x.items()}
    if isinstance(x, np.ndarray):
        return _plain(x.tolist())
    if isinstance(x, list | tuple | set) or (isinstance(x, Iterable) and not isinstance(x, str)):
        return [_plain(value) for value in x]
    if isinstance(x, np.generic):
        return _plain(x.item())
    if isinstance(x, float):
        return float(f"{x:.6g}") if math.isfinite(x) else None
    return x if x is None or isinstance(x, bool | int | str) else str(x)
