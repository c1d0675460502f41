"""Crossings of a loop over its whole history: day after day, with the detector's state handed on.

::

    state ──┐
    rows of a loop and a day ──follow──→ a row: what the detector has found so far, and with which settings
    row of `look` ──┘          └──→ state of the next day

What it answers, to the bit, is what one pass over all samples answers: signals keep their last value over midnight, and
so does every number of the detector. Only a change of the settings starts it again.

Settings that nobody gave are *pinned*: the first day that shows them sets them for all that follow, so that a later
day cannot change what was found before. They hold until a day shows others.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pyarrow as pa

from .. import _glapp
from ..errors import unforeseen
from ..estimate import why_text
from ..loop import Loop
from .windows import US, Signal, on_pv, signals_of

__all__ = ["CROSSINGS", "FOLLOWED", "follow"]

CHANGED = 1.25
"""K or Ti that differ by more than this factor from those that are pinned are others."""

STEP_CHANGED = 2.0
"""A time between samples that differs by more than this factor is another."""

CROSSINGS = pa.schema(
    [
        ("loop", pa.string()),
        ("day", pa.int32()),
        ("part", pa.int32()),
        ("followed", pa.bool_()),
        ("since", US),
        ("crossings", pa.string()),
        ("crossings_code", pa.string()),
        ("crossings_reason", pa.string()),
        ("d_hat", pa.float64()),
        ("noise_floor", pa.float64()),
        ("detections", pa.int64()),
        ("half_periods", pa.int64()),
        ("rejected", pa.string()),
        ("k", pa.float64()),
        ("ti", pa.float64()),
        ("td", pa.float64()),
        ("b", pa.float64()),
        ("kp", pa.float64()),
        ("tf", pa.float64()),
        ("h", pa.float64()),
        ("origins", pa.string()),
    ]
)
"""One row per loop and day, from the first day with settings on: what was found since these hold."""

FOLLOWED = CROSSINGS.append(pa.field("state", pa.string()))
"""The columns of `CROSSINGS`, and the state that the next day begins with."""

_HELD = ("sp", "op", "mode", "op_low_flag", "op_high_flag")
_BEFORE = np.iinfo(np.int64).min


def follow(rows: pa.Table, look: pa.Table, loop: Loop, state: str | None) -> pa.Table:
    """A row of `FOLLOWED`: the detector over one more day.

    - `rows`: columns signal, t, value and bad of that loop and day, in any order.
    - `look`: what `look` says of that day.
    - `loop`: its settings.
    - `state`: the state after the day before; None: there is none.
    """
    [day] = look.select(["day", "part", "origins", "detector", "quality", "unfit_code"]).to_pylist()
    row: dict[str, Any] = dict.fromkeys(FOLLOWED.names)
    row |= {"loop": loop.name, "day": day["day"], "part": day["part"], "followed": False, "state": state}
    try:
        row |= _followed(rows, day, loop, state)
    except Exception as error:  # not to lose all other loops
        reason = str(unforeseen(error, None, loop.name))
        row |= {"crossings": "refused", "crossings_code": "fault", "crossings_reason": reason}
    return pa.Table.from_pylist([row], schema=FOLLOWED)


def _followed(rows: pa.Table, day: dict[str, Any], loop: Loop, state: str | None) -> dict[str, Any]:
    """Crossings of a day, joined to those of the days before."""
    before: dict[str, Any] = {"held": {}, "pinned": None} if state is None else json.loads(state)
    found, _, _ = signals_of(rows)
    held, samples = before["held"], {name: found[name] for name in (*_HELD, "pv") if name in found}
    if "mode" in found:  # before its first mode a loop counts as automatic, like a loop without modes
        held = {"mode": (1.0, False)} | held
    for name, (value, lost) in held.items():
        samples[name] = _with_last_value(value, lost, samples.get(name))
    detector = None if day["detector"] is None else json.loads(day["detector"])
    pinned, history = before["pinned"], None
    if pinned is not None:
        history = _glapp.History.load(pinned["history"])
    followed = "pv" in samples and _usable(day)
    if followed and detector is not None and (pinned is None or _settings_differ(pinned["told"], detector)):
        history = _glapp.History(_settings(detector), detector["tf"] is not None)
        pinned = {"told": detector, "since": int(samples["pv"].t[0]), "origins": day["origins"]}
    row: dict[str, Any] = {}
    if history is not None:
        if followed:
            _take(history, samples, pinned)
            pinned["history"] = history.save()
        row = {"followed": followed, **_crossing_columns(history.heard(), pinned, loop)}
    after = {name: _last_value(signal) for name, signal in samples.items() if name != "pv"}
    return row | {"state": json.dumps({"held": after, "pinned": pinned}, sort_keys=True)}


def _with_last_value(value: float | None, lost: bool, signal: Signal | None) -> Signal:
    """A signal with the last value of the day before in front."""
    begin = Signal(np.array([_BEFORE]), np.array([np.nan if value is None else value]), np.array([lost]))
    if signal is None:
        return begin
    names = ("t", "value", "lost")
    return Signal(*(np.concatenate([getattr(begin, name), getattr(signal, name)]) for name in names))


def _last_value(signal: Signal) -> tuple[float | None, bool]:
    """Last value of a signal, None where that is not known, and whether the signal was lost."""
    value = float(signal.value[-1])
    return (None if np.isnan(value) else value), bool(signal.lost[-1])


def _usable(day: dict[str, Any]) -> bool:
    """Whether a day's samples may be used: nothing was found that refuses them, and PV is no plain swing."""
    if day["unfit_code"] in ("outside_span", "unusable", "fault"):
        return False
    return all(one["severity"] != "refuse" and one["code"] != "sinusoidal" for one in day["quality"] or ())


def _settings_differ(pinned: dict[str, Any], detector: dict[str, Any]) -> bool:
    """Whether a day shows other settings than those that are pinned."""

    def apart(name: str, factor: float) -> bool:
        ratio = detector[name] / pinned[name]
        return not 1 / factor <= ratio <= factor

    return (
        apart("k", CHANGED) or apart("ti", CHANGED) or apart("h", STEP_CHANGED) or (detector["op"] and not pinned["op"])
    )


def _settings(detector: dict[str, Any]) -> dict[str, Any]:
    """Settings of the detector that it starts with."""
    given = {name: detector[name] for name in ("k", "ti", "td", "b", "kp", "n", "h")}
    given |= {} if detector["tf"] is None else {"tf": detector["tf"]}
    return given | {"op_limits": None if detector["op_limits"] is None else tuple(detector["op_limits"])}


def _take(history: _glapp.History, samples: dict[str, Signal], pinned: dict[str, Any]) -> None:
    """Hand a day's samples to the detector; its time counts from when its settings hold [s]."""
    signals, flags = on_pv(samples)
    t = (samples["pv"].t - pinned["since"]) * 1e-6
    none = np.full(len(t), np.nan)
    op = signals.get("op", none) if pinned["told"]["op"] else None
    history.take(t, signals.get("sp", none), signals["pv"], op, flags)


def _crossing_columns(found: dict[str, Any], pinned: dict[str, Any], loop: Loop) -> dict[str, Any]:
    """State of the crossings so far, in columns."""
    detector = pinned["told"]
    rejected = dict(found["reasons"])
    answer = {"why": found["why"], "reasons": rejected, "detections": found["detections"]}
    answer["controller"] = {"origins": {"kp": detector["kp_origin"]}}
    return {
        "since": pinned["since"],
        "crossings": found["crossings"],
        "crossings_code": None if found["why"] is None else found["why"]["code"],
        "crossings_reason": why_text(answer, loop, [], None),
        **{name: found[name] for name in ("d_hat", "noise_floor", "detections", "half_periods", "tf")},
        "rejected": json.dumps(rejected, sort_keys=True),
        **{name: detector[name] for name in ("k", "ti", "td", "b", "kp", "h")},
        "origins": pinned["origins"],
    }
