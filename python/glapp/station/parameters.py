"""The parameters of a loop as a person sets them: meaning and default of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..report.words import number
from ..service.settable import DETECTOR, SETTINGS, SHARE, Bound

__all__ = ["FIRST", "GROUPS", "NO_LIMIT", "PARAMETERS", "Parameter", "allowed", "changed", "command_text", "field"]

NOBODY_REACHES = 1e9
"""A bound that only keeps arithmetic finite."""

NO_LIMIT = 1e30
"""The core writes "none" as a number that is greater."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """Texts on a parameter; its unit and its bounds are the service's.

    - `meaning`: what it is.
    - `default`: what it is where nobody sets it.
    """

    meaning: str
    default: str


PARAMETERS: dict[str, Parameter] = {
    "k": Parameter("gain K that the detector believes the controller has", "loops.toml"),
    "ti": Parameter("its integral time Ti", "loops.toml"),
    "td": Parameter("its derivative time Td", "loops.toml"),
    "setpoint_weight": Parameter("its setpoint weight b", "1"),
    "kp": Parameter("static process gain Kp", "that of the fit, or 1.5 %/%"),
    "tf": Parameter("time constant of the detector's filter", "chosen from the data"),
    "n": Parameter("length of the filter of detections, odd", "9"),
    "acceptable_dead_band": Parameter("the widest gap that needs no work", "none"),
    "comp_size": Parameter("width of the gap, entered by hand; 0: none", "0"),
    "comp_fitted": Parameter("lower limit of the fit that was taken over", "none"),
    "comp_source": Parameter("which width counts: 1 typed, 2 fitted, 3 the estimate", "2 where there is one, else 1"),
    "comp_way": Parameter("how the direction is found: 1 error, 2 derivative, 3 inverse", "3"),
    "comp_share": Parameter("share of the width that is compensated", f"{SHARE:g}"),
    "comp_limit": Parameter("greatest width, whatever it came from, at least share·size", "twice u_ff_limit"),
    "comp_band": Parameter("how far OP must go back before that is a reversal", "a fifth of the width"),
    "comp_tf": Parameter("filter of OP before its direction is found", "0"),
    "comp_rate": Parameter("greatest rate of u_FF", "0.6 of u_ff_rate"),
    "comp_release": Parameter("time in which it is taken away", "Ti, at most 300 s"),
    "comp_watch": Parameter("time over which the loop is compared with before", "300 Ti"),
    "comp_travel": Parameter("budget of OP's travel by u_FF", "none"),
    "comp_reversals": Parameter("budget of u_FF's reversals", "none"),
    "comp_withdraw": Parameter("whether warnings withdraw it: 0 no, 1 yes", "1"),
    "comp_estimate": Parameter("whether the estimate may lower the width: 0 no, 1 yes", "1"),
    "ff_tolerance": Parameter("how far the u_FF read back may be off", "a tenth of the width"),
}
"""Texts by the parameter names of the service's API."""

assert tuple(PARAMETERS) == (*DETECTOR, *SETTINGS)

FIRST = ("kp", "tf", "n", "acceptable_dead_band", "comp_size")
"""Parameters that change most often; all others are folded."""

GROUPS: dict[str, tuple[str, ...]] = {
    "The controller, as the detector knows it": ("k", "ti", "td", "setpoint_weight"),
    "Compensation: which width, and how much of it": (
        "comp_source",
        "comp_fitted",
        "comp_share",
        "comp_limit",
        "comp_estimate",
    ),
    "Compensation: how u_FF moves": ("comp_way", "comp_band", "comp_tf", "comp_rate", "comp_release", "ff_tolerance"),
    "Compensation: when it is withdrawn": ("comp_watch", "comp_travel", "comp_reversals", "comp_withdraw"),
}
"""All other parameters, by subject."""

assert sorted((*FIRST, *(name for names in GROUPS.values() for name in names))) == sorted(PARAMETERS)


def field(value: float | None) -> float | None:
    """Content of a parameter's field: nothing for a limit that is none.

    >>> field(2.0), field(1e37)
    (2.0, None)
    """
    return None if value is not None and abs(value) > NO_LIMIT else value


def allowed(bound: Bound) -> str:
    """Allowed range of a parameter, in short; its unit stands beside it, and a limit that nobody reaches is none.

    >>> allowed(Bound("s", 0.0, 300.0, zero=False)), allowed(Bound("1", 1, 31, whole=True))
    ('> 0 and ≤ 300', 'a whole number, 1 to 31')
    >>> allowed(Bound("s", 0.0, 1e9, zero=False)), allowed(Bound("%", -1e12, 1e12, zero=False))
    ('> 0', 'not 0')
    """
    low, high = f"{bound.low:.6g}", f"{bound.high:.6g}"
    if bound.whole:
        return f"a whole number, {low} to {high}"
    if bound.high >= NOBODY_REACHES:
        if bound.low <= -NOBODY_REACHES:
            return "any number" if bound.zero else "not 0"
        return f"≥ {low}" if bound.zero or bound.low else "> 0"
    if bound.low == 0.0 and not bound.zero:
        return f"> 0 and ≤ {high}"
    return f"{low} to {high}" + ("" if bound.zero else ", not 0")


def changed(seen: Mapping[str, Any], typed: Mapping[str, float | None]) -> dict[str, Any]:
    """Request to the API: the values that differ from those on the page, and the seen ones of just those.

    - `seen`: the parameters as the page showed them.
    - `typed`: what stands in the fields now; None: as by default.

    Returns the body of the command; without values where nothing is changed.

    Examples
    --------
    >>> changed({"kp": 2.0, "n": 9}, {"kp": 3.0, "n": 9.0})
    {'values': {'kp': 3.0}, 'seen': {'kp': 2.0}}
    """
    values = {name: value for name, value in typed.items() if value != field(seen.get(name))}
    return {"values": values, "seen": {name: seen.get(name) for name in values}}


def command_text(command: Mapping[str, Any]) -> str:
    """A command in a line: whose account it is about, and the values before and after.

    >>> command_text({"before": {"kp": 2.0}, "after": {"kp": 3.0}, "refused": None})
    'kp 2 → 3'
    >>> command_text({"before": {"user": "anna", "role": None}, "after": {"user": "anna", "role": "viewer"}, \
"refused": None})
    'anna: role – → viewer'
    >>> command_text({"before": {"user": "anna"}, "after": None, "refused": None})
    'anna'
    """
    if command["refused"] is not None:
        return f"refused: {command['refused']}"
    before, after = command["before"], command["after"]
    if not isinstance(before, dict):
        return ""
    names = [name for name in after or () if before.get(name) != after[name]]
    changes = ", ".join(f"{name} {_short(before.get(name))} → {_short(after[name])}" for name in names)
    return ": ".join(part for part in (before.get("user", ""), changes) if part)


def _short(value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return "–" if value is None else str(value)
    return number(float(value))
