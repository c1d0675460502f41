"""The layout of the International Stiction Data Base, for a person who has its file; the data are not part of glapp.

The file `isdb10.mat` goes with the book of Jelali & Huang (eds.), *Detection and Diagnosis of Stiction in Control
Loops*, Springer 2010. It holds a struct `cdata` with a struct for each industry (`buildings`, `chemicals`,
`pulpPapers`, `power`, `mining`, `metals`; `testdata` is synthetic), and in each of them a struct for each loop:
`loop1`, `loop2` and so on. A loop has the fields `PV`, `OP`, `SP`, `t`, `Ts` [s], `Type` (1 where the process
integrates), `Comments` and `BriefComments`. The comments are the contributors' verdicts.

Methods are compared most on twenty of the loops. `QUOTED` has their verdicts as the comparison of methods in the book's
chapter 13 counts them: 13 stick, 7 do not (the same count in Damarla 2026, arXiv:2607.22486).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..loop import Loop, Process
from ..recording import Recording
from ..samples import Samples

__all__ = ["QUOTED", "StictionLoop", "open_isdb"]

Floats = NDArray[np.float64]

SYNTHETIC = "testdata"
"""The group whose loops are made and not recorded."""

STICTION = "stiction"

QUOTED = {
    "chemicals.loop1": STICTION,
    "chemicals.loop2": STICTION,
    "chemicals.loop3": "no stiction: quantization of PV",
    "chemicals.loop6": STICTION,
    "chemicals.loop10": STICTION,
    "chemicals.loop11": STICTION,
    "chemicals.loop12": STICTION,
    "chemicals.loop13": "no stiction: faulty steam sensor",
    "chemicals.loop14": "no stiction: faulty steam sensor",
    "chemicals.loop16": "no stiction: interaction of loops",
    "chemicals.loop23": STICTION,
    "chemicals.loop24": STICTION,
    "chemicals.loop29": STICTION,
    "chemicals.loop32": STICTION,
    "pulpPapers.loop2": STICTION,
    "pulpPapers.loop4": "no stiction: dead zone and tight tuning",
    "pulpPapers.loop5": STICTION,
    "pulpPapers.loop7": "no stiction: external disturbance",
    "pulpPapers.loop9": "no stiction: no oscillation",
    "mining.loop1": STICTION,
}
"""Published verdicts of the twenty loops that are quoted most, by the name of `StictionLoop`."""

_SAYS = (
    ("no stiction", r"\bno stiction\b"),
    ("likely stiction", r"\bstiction\s*\(likely\)|\blikely stiction\b"),
    ("stiction", r"\bstiction\b"),
)


@dataclass(frozen=True, slots=True)
class StictionLoop:
    """One loop of the data base.

    - `name`: industry and number, such as "chemicals.loop10".
    - `comment`: the contributor's text.
    - `says`: its verdict in a word; None where the comment does not mention stiction. "no stiction" does not mean that
      the valve is sound, or that the loop is well tuned.
    - `quoted`: the verdict in `QUOTED`: "stiction", or "no stiction" with the cause; None for every other loop. Where
      it differs from `says`, the literature and the contributor disagree.
    - `recording`: its samples, the loop's name with them.
    """

    name: str
    comment: str
    says: Literal["stiction", "likely stiction", "no stiction"] | None
    quoted: str | None
    recording: Recording


def open_isdb(path: str | Path, *, synthetic: bool = False) -> list[StictionLoop]:
    """The loops of the data base.

    - `path`: the file, such as `isdb10.mat`.
    - `synthetic`: with the synthetic loops.

    Returns: In the order of the file. A loop whose OP has another length than its PV has none.

    Raises InputError where SciPy is not installed, the file cannot be read, has not that layout, or a loop has no
    usable PV.
    """
    path = Path(path)
    try:
        from scipy.io import loadmat
    except ImportError:
        raise InputError("needs SciPy", file=str(path), hint="pip install 'glapp[tuning]'") from None
    try:
        whole = loadmat(path, squeeze_me=True, struct_as_record=False)
    except Exception as error:  # damaged files end in errors of many kinds
        raise InputError(f"cannot be read: {error}", file=str(path)) from None
    if not hasattr(whole.get("cdata"), "_fieldnames"):
        raise InputError("holds no struct cdata", file=str(path), hint="name the file isdb10.mat of the data base")
    return [_loop(path, name, one) for name, one in _structs(whole["cdata"], synthetic)]


def _structs(root: Any, synthetic: bool) -> Iterator[tuple[str, Any]]:
    """Name and data of each loop in the file."""
    for industry in root._fieldnames:
        group = getattr(root, industry)
        if industry == SYNTHETIC and not synthetic:
            continue
        for name in getattr(group, "_fieldnames", []):
            if hasattr(data := getattr(group, name), "_fieldnames"):
                yield f"{industry}.{name}", data


def _loop(path: Path, name: str, data: Any) -> StictionLoop:
    """A loop of the data base."""
    values = {key: _column(getattr(data, key, None)) for key in ("PV", "OP", "SP", "t")}
    pv = values["PV"]
    if pv is None or not np.isfinite(pv).any():
        raise InputError("has no PV", file=str(path), loop=name, column="PV")
    n = len(pv)
    signals = {key.lower(): x for key, x in values.items() if key in ("OP", "SP") and x is not None and len(x) == n}
    sp = values["SP"]
    if "sp" not in signals and sp is not None and len(sp) == 1:
        signals["sp"] = np.full(n, sp[0])
    kind: Literal["integrating", "self-regulating"] = (
        "integrating" if _number(data, "Type") == 1.0 else "self-regulating"
    )
    loop = Loop(name=name, process=Process(type=kind))
    recording = Samples(loop, {"t": _times(path, name, data, values["t"], n), "pv": pv, **signals})
    recording.source = f"{path.name}: {name}"
    comment = _text(getattr(data, "BriefComments", "")) or _text(getattr(data, "Comments", ""))
    says = next((word for word, pattern in _SAYS if re.search(pattern, comment, re.IGNORECASE)), None)
    return StictionLoop(name, comment, says, QUOTED.get(name), recording)  # type: ignore[arg-type]  # it is one of these words


def _times(path: Path, name: str, data: Any, t: Floats | None, n: int) -> Floats:
    """Times [s]: those of the sampling time; a loop without one has those of its own column."""
    step = _number(data, "Ts")
    if math.isfinite(step) and step > 0.0:
        return np.arange(n, dtype=np.float64) * step
    if t is not None and len(t) == n and (np.diff(t) > 0).all():
        return t
    raise InputError("has neither a sampling time nor times", file=str(path), loop=name, column="Ts")


def _column(values: Any) -> Floats | None:
    """Numbers of a column; None where it has none."""
    try:
        column = np.asarray(values, np.float64).ravel()
    except (TypeError, ValueError):
        return None
    return column if column.size and np.isfinite(column).any() else None


def _number(data: Any, name: str) -> float:
    column = _column(getattr(data, name, None))
    return math.nan if column is None else float(column[0])


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value.strip()
    if isinstance(value, np.ndarray):
        return " ".join(_text(element) for element in value.ravel()).strip()
    return ""
