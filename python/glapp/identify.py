"""The controller's own law, read out of the recording: what `crates/analysis/src/identify` found.

A PID controller moves its output by

    dOP = K (b dSP - dPV) + K/Ti e dt - K Td d(dPV/dt),      e = SP - PV                            (velocity form)

with PV filtered or not. `docs/identify.md` explains how K, Ti, Td and b follow from a recording, and how sure they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _glapp
from ._glapp import to_text
from .arrays import column

Floats = NDArray[np.float64]

R2_USABLE: float = _glapp.R2_USABLE
"""Least share of OP's moves that the law must explain before its K and Ti are used unasked."""

WIDEST: float = _glapp.WIDEST
"""Largest ratio of the ends of the interval of K, or of Ti, with which they are used unasked."""

MIN_STEPS: int = _glapp.MIN_STEPS
"""Fewest usable steps between samples; below it an interval means nothing."""


@dataclass(frozen=True, slots=True)
class Identification:
    """K, Ti and Td of a PID controller as its recording shows them.

    `k`, `ti`, `td` and `r2` are None where no fit was possible at all; then `reason` says why.  A fit that is not
    trusted keeps its numbers, for a person to judge, with `usable` False.

    Attributes
    ----------
    k : float | None
        Gain [OP unit per PV unit], negative for a direct acting controller.
    ti : float | None
        Integral time [s].
    k_low, k_high, ti_low, ti_high : float | None
        95 % interval: of the scatter, of every law that explains OP as well, and of what one sampling step leaves open
        (`identified`); `ti_high` is infinite where there may be no integral action.
    r2 : float | None
        Share of the variance of OP's *moves* (not of its level) explained, outliers included; at most 1,
        negative when worse than nothing.
    samples : int
        Steps between consecutive samples that could be used.
    setpoint_weight : float | None
        b, as given or as found; None where SP moved too little to show it.
    note : str
        How the fit was made, for the report.
    usable : bool
        R² at least `R2_USABLE`, K and Ti both clearly not zero, and the ends of each at most a factor `WIDEST` apart.
    reason : str
        One sentence for a person; empty when usable.
    td : float | None
        Derivative time [s]; 0 where a law without D part explains OP as well as any.
    td_low, td_high : float | None
        95 % interval of it.
    """

    k: float | None
    ti: float | None
    k_low: float | None
    k_high: float | None
    ti_low: float | None
    ti_high: float | None
    r2: float | None
    samples: int
    setpoint_weight: float | None
    note: str
    usable: bool
    reason: str
    td: float | None = None
    td_low: float | None = None
    td_high: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """The result in plain types, as `glapp analyze --json` writes it; None where there is no value."""
        return {
            "usable": self.usable,
            "k": [self.k, self.k_low, self.k_high],
            "ti": [self.ti, self.ti_low, self.ti_high],
            "td": [self.td, self.td_low, self.td_high],
            "setpoint_weight": self.setpoint_weight,
            "r2": self.r2,
            "samples": self.samples,
            "reason": self.reason or None,
        }


def identified(
    t: Floats,
    sp: Floats | None,
    pv: Floats,
    op: Floats | None,
    flags: NDArray[np.uint8] | None = None,
    *,
    setpoint_weight: float | None = None,
    limits: tuple[float, float] | None = None,
) -> Identification:
    r"""Find K, Ti and Td of the controller that produced OP from SP and PV.

    Summed up, with e = SP - PV and all PV filtered as the controller filters it, the law reads at every sample

        OP = const + K (b SP - PV) + K/Ti sum e h - K Td dPV/dt.

    The move from the mean of m samples to the mean of the next m obeys it too, without the constant.  It is fitted by
    iteratively reweighted least squares (Huber, then Tukey's biweight; scale from the median absolute residual) over
    all stretches of 2m consecutive usable steps: in auto, good, finite, off the limits, no gap; m = 1, 2, 4 ... up to
    two Ti.  Short means show the filter and the D part, long ones what noise and the time between samples hide.

    The laws: PI and PID; PV as recorded, through one lag, or through two equal ones; or a D part with a filter of its
    own; of a controller that runs once a sample, and of one that runs much faster.  The filter's time is fitted too.
    Every law that predicts no worse than the best in 8-30 blocks of time takes part in the interval, once as fitted
    and once as if the controller had never seen the noise of the recorded PV.  So does every m whose interval is at
    most twice as wide as the narrowest.  The scatter is the sandwich of the robust fit with scores summed by block,
    and Student's t.

    Bias: a recording at step h does not show which error the controller integrated within the step.  Where all samples
    fit to within OP's resolution, the controller ran once a sample, and is taken to have used the current error; else
    it is taken to be much faster.  The interval is wide enough for Ti - h/2 or Ti + h/2, K in proportion.  A filter
    whose lags add up to more than Td hides the derivative: such a controller is taken for a PI with less gain.

    Parameters
    ----------
    t : float64[n]
        Time [s]; may repeat or run backwards, such steps are not used.
    sp, pv : float64[n]
        Setpoint and measurement [PV unit]; NaN where missing, SP None where it is not recorded.
    op : float64[n] | None
        Controller output [OP unit].
    flags : uint8[n] | None
        Any bit set (not auto, bad, at a limit) takes the sample out.
    setpoint_weight : float | None
        b where it is known; None: found where SP moves enough, and its effect kept apart in any case.
    limits : (float, float) | None
        OP's lower and upper limit [OP unit]; samples at or beyond them are not used.

    Returns
    -------
    Identification
        Never raises on data: `reason` names what cannot be found.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(400.0)
    >>> pv = 50 + np.sin(t / 17) + 0.3 * np.sin(t / 5)
    >>> sp = np.full(400, 50.0)
    >>> op = 2.0 * (sp - pv) + 2.0 / 30 * np.cumsum(sp - pv)
    >>> found = identified(t, sp, pv, op)
    >>> round(found.k, 3), round(found.ti, 2), found.usable
    (2.0, 30.0, True)
    """
    found = _glapp.identified(
        column(t), column(sp), column(pv), column(op), column(flags, np.uint8), setpoint_weight, limits
    )
    return identification_from_core(found)


def identification_from_core(found: Mapping[str, Any]) -> Identification:
    """Put the core's identification into words."""
    values, settings, reason = found["values"] or {}, found["settings"] or {}, found["reason"]
    ends = {
        f"{name}_{end}": settings[f"{name}_interval"][end] if settings else None
        for name in ("k", "ti", "td")
        for end in ("low", "high")
    }
    numbers = {name: values.get(name) for name in ("k", "ti", "r2")} | ends
    numbers |= {name: settings.get(name) for name in ("td", "setpoint_weight")}
    return Identification(
        **numbers,
        samples=found["samples"],
        note=_note(settings["note"], ends["td_low"], ends["td_high"]) if settings else to_text("identification.no_fit"),
        usable=reason is None,
        reason="" if reason is None else _reason(reason, numbers | {"samples": found["samples"]}),
    )


def _reason(why: Mapping[str, Any], numbers: Mapping[str, Any]) -> str:
    """Why it must not be used unasked, in one sentence."""
    beside = {
        f"{name}_{end}": value
        for name, interval in (why.get("of") or {}).items()
        if isinstance(interval, dict)
        for end, value in interval.items()
    }
    return to_text(f"identification.{why['code']}", {**numbers, **(why.get("of") or {}), **beside})


def _note(fit: Mapping[str, Any], td_low: float | None, td_high: float | None) -> str:
    """Note on the fit."""
    derivative, behind = fit["derivative"], fit["filter"]
    parts: list[tuple[str, dict[str, Any]]] = [
        ("law", {"derivative": derivative, "m": fit["m"], "span": fit["m"] * fit["h"]})
    ]
    if behind["order"]:
        parts.append(("filter", behind))
    if behind["tfd"]:
        parts.append(("derivative_filter", behind))
    if fit["lag"]:
        parts.append(("late" if fit["lag"] > 0 else "early", {}))
    if derivative and not (td_low or 0) > 0:
        parts.append(("derivative_open", {}))
    elif not derivative and (td_high or 0) > 0:
        parts.append(("derivative_hidden", {"td_high": td_high}))
    if (weight := fit["weight"]) is not None:
        parts.append(("weight", {"fitted": weight["fitted"], **weight["interval"]}))
    return "; ".join(to_text(f"identification.{code}", numbers) for code, numbers in parts)
