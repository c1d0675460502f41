"""Settable parameters of a loop, with the unit and both bounds of each, which depend on other settings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from .. import _glapp
from ..errors import InputError
from ..loop import Loop

__all__ = [
    "DETECTOR",
    "SETTINGS",
    "SHARE",
    "Bound",
    "bounds_of",
    "check",
    "compensation_settings",
    "of_plant",
    "usual_of",
    "with_settings",
]

DETECTOR = ("k", "ti", "td", "setpoint_weight", "kp", "tf", "n", "acceptable_dead_band")
"""Settable parameters of a detector: its model of the controller, never the controller itself."""

SETTINGS = (
    "comp_size",
    "comp_fitted",
    "comp_source",
    "comp_way",
    "comp_share",
    "comp_limit",
    "comp_band",
    "comp_tf",
    "comp_rate",
    "comp_release",
    "comp_watch",
    "comp_travel",
    "comp_reversals",
    "comp_withdraw",
    "comp_estimate",
    "ff_tolerance",
)
"""Settable parameters of a compensation; `BacklashDetection` has unit, bound and default of each."""

SHARE = 0.8
"""The share of the width that is compensated where nobody says another (`docs/compensation.md`)."""

_LONGEST = 1e9  # [s]: a longer time between samples is none, and a Ti beyond it is no integral action
_GREATEST = 1e12  # what a controller of seven digits can work with


class Bound(NamedTuple):
    """Bounds of a parameter: `low` ≤ value ≤ `high`, other than 0 unless `zero`, and a whole number where `whole`.

    - `unit`: its unit; "1" where it has none.
    - `low`, `high`: the least and the greatest, in this unit.
    - `zero`: whether it may be 0.
    - `whole`: whether only whole numbers are meant.

    Examples
    --------
    >>> Bound("s", 0.0, 300.0, zero=False).words
    '> 0 and ≤ 300 s'
    """

    unit: str
    low: float
    high: float
    zero: bool = True
    whole: bool = False

    @property
    def words(self) -> str:
        """Text of both bounds, with their unit."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.whole:
            return f"a whole number from {self.low:g} to {self.high:g}"
        if self.low == 0.0 and not self.zero:
            return f"> 0 and ≤ {self.high:.15g}{unit}"
        return f"from {self.low:.15g} to {self.high:.15g}{unit}" + ("" if self.zero else ", and not 0")

    def allows(self, value: float) -> bool:
        """Whether a value is within both bounds."""
        if not (math.isfinite(value) and self.low <= value <= self.high):
            return False
        return (self.zero or value != 0.0) and (not self.whole or float(value).is_integer())


def usual_of(most: tuple[float, float]) -> dict[str, float]:
    """Default settings of a compensation, by the greatest |u_FF| and rate that the plant takes.

    The limit is of a width, and so twice as much. The plant counts from write to write, and a write may come late and
    the next one in time: so the rate is less than the plant takes.
    """
    return {"comp_share": SHARE, "comp_limit": 2.0 * most[0], "comp_rate": 0.6 * most[1]}


def of_plant(loop: Loop) -> tuple[Bound, Bound]:
    """The bounds of `u_ff_limit` and `u_ff_rate` in a loops.toml: OP's range, and ten times that in a second."""
    low, high = loop.op_range() or (0.0, _GREATEST)
    limit = Bound(loop.op_label, 0.0, high - low, zero=False)
    return limit, limit._replace(unit=f"{loop.op_label}/s", high=10.0 * limit.high)


def bounds_of(loop: Loop, settings: Mapping[str, Any], most: tuple[float, float] | None) -> dict[str, Bound]:
    """The bounds of all that may be set of a loop, by what else is set, in the units of the loop.

    - `loop`: with what is set of its detector.
    - `settings`: what is set of its compensation; what is None or not there is as by default.
    - `most`: the greatest |u_FF| and rate that the plant takes [OP unit, OP unit per s]; None: it cannot be
      compensated.
    """
    units = (("OP unit", loop.op_label), ("PV unit", loop.pv_unit or "PV unit"))
    found = _bounds(loop, settings, most)
    for word, unit in units:
        found = {name: bound._replace(unit=bound.unit.replace(word, unit)) for name, bound in found.items()}
    return found


def _bounds(loop: Loop, settings: Mapping[str, Any], most: tuple[float, float] | None) -> dict[str, Bound]:
    """The bounds as `bounds_of` gives them, with the words of the core for units."""
    gain = Bound("OP unit/PV unit", -_GREATEST, _GREATEST, zero=False)
    found = {
        "k": gain,
        "ti": Bound("s", 0.0, _LONGEST, zero=False),
        "td": Bound("s", 0.0, _LONGEST),
        "setpoint_weight": Bound("1", 0.0, 1.0),
        "kp": gain._replace(unit="PV unit/OP unit"),
        "tf": Bound("s", 0.0, _LONGEST, zero=False),
        "n": Bound("1", 1.0, 31.0, whole=True),
        "acceptable_dead_band": Bound("% of span", 0.0, 100.0, zero=False),
    }
    ideal = loop.ideal()
    if most is None or ideal is None:
        return found
    given = usual_of(most) | {name: x for name, x in settings.items() if x is not None}
    fitted = given.get("comp_fitted")
    source = given.get("comp_source", 1.0 if fitted is None else 2.0)
    size = {1.0: given.get("comp_size", 0.0), 2.0: fitted or 0.0}.get(source, 0.0)
    share, limit = given["comp_share"], given["comp_limit"]
    if not 0.0 <= share <= 1.0:  # by what is out itself, nothing else is bounded
        share = SHARE
    if not 0.0 < limit <= 2.0 * most[0]:
        limit = 2.0 * most[0]
    if not 0.0 <= size <= of_plant(loop)[0].high:
        size = 0.0
    rows = _glapp.compensation_bounds(ideal.ti, size=size, share=share, limit=limit, limits=loop.op_range())
    core = {name: Bound(unit, low, high, zero=not above) for name, unit, low, high, above in rows}
    widest = core["size"].high
    # Only the width that counts is bounded by the limit, too.
    typed_counts = source == 1.0 or ("comp_source" not in given and fitted is None)
    counts = core["size"]._replace(high=min(widest, _quotient(limit, share)))
    switch = Bound("1", 0.0, 1.0, whole=True)
    named = Bound("1", 1.0, 3.0, whole=True)
    return found | {
        "comp_size": counts if typed_counts else core["size"],
        "comp_fitted": counts if given.get("comp_source", 2.0) == 2.0 else core["size"],
        "comp_source": named,
        "comp_way": named,
        "comp_share": core["share"]._replace(high=min(1.0, _quotient(limit, size))),
        "comp_limit": core["limit"]._replace(high=min(widest, 2.0 * most[0])),
        "comp_band": core["band"],
        "comp_tf": core["tf"],
        "comp_rate": core["rate"]._replace(high=min(core["rate"].high, most[1])),
        "comp_release": core["release"],
        "comp_watch": core["watch"],
        "comp_travel": core["travel"],
        "comp_reversals": core["reversals"],
        "comp_withdraw": switch,
        "comp_estimate": switch,
        "ff_tolerance": Bound("OP unit", 0.0, most[0]),
    }


def check(name: str, value: float, bound: Bound, loop: str) -> None:
    """Refuse a value that is out of its bounds.

    Raises
    ------
    InputError
        With the parameter, its value, its bounds and what to do.

    Examples
    --------
    >>> check("comp_release", 1e9, Bound("s", 0.0, 80.0, zero=False), "LIC104")
    Traceback (most recent call last):
    glapp.errors.InputError: loop LIC104, comp_release: is 1000000000 s, must be > 0 and ≤ 80 s; give a value within \
these bounds
    """
    if not bound.allows(value):
        unit = "" if bound.unit == "1" else f" {bound.unit}"
        raise InputError(
            f"is {value:.15g}{unit}, must be {bound.words}",
            loop=loop,
            parameter=name,
            value=value,
            bound=bound.words,
            hint="give a value within these bounds",
        )


def compensation_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of a loop that belong to its compensation."""
    return {name: settings[name] for name in SETTINGS if name in settings}


def with_settings(loop: Loop, settings: Mapping[str, Any]) -> Loop:
    """The loop, with persons' settings of its detector in place of its own.

    Raises InputError with the parameter, its value and its bound.
    """
    given = {name: settings[name] for name in DETECTOR if settings.get(name) is not None}
    if not given:
        return loop
    data = loop.model_dump(exclude_unset=True)
    ideal = loop.ideal()
    if given.keys() & {"k", "ti", "td", "setpoint_weight"}:
        known = {} if ideal is None else {"k": ideal.k, "ti": ideal.ti, "td": ideal.td, "setpoint_weight": ideal.b}
        known |= {name: given[name] for name in ("k", "ti", "td", "setpoint_weight") if name in given}
        if known.get("k") == 0.0:
            raise InputError("is 0, must not be 0", loop=loop.name, parameter="k", value=0.0, bound="≠ 0")
        k = known.pop("k", None)
        data["controller"] = {
            **known,
            **({} if k is None else {"k": abs(k), "action": "direct" if k < 0 else "reverse"}),
            "gain_unit": "OP/PV",
        }
    if "kp" in given:
        data["process"] = {**data.get("process", {}), "kp": given["kp"], "kp_unit": "PV/OP"}
    for name in ("tf", "n", "acceptable_dead_band"):
        if name in given:
            whole = name == "n" and float(given[name]).is_integer()
            data[name] = int(given[name]) if whole else given[name]
    try:
        return Loop(**data)
    except InputError as error:
        error.loop = loop.name
        if error.parameter is not None:
            error.parameter = error.parameter.rpartition(".")[2]
        raise


def _quotient(a: float, b: float) -> float:
    """The greatest number that, times `b`, is at most `a`."""
    if not b > 0.0:
        return math.inf
    found = a / b
    return found if found * b <= a else math.nextafter(found, 0.0)
