"""A PID controller as its maker writes it, and as the theory needs it.

A DCS shows gain or proportional band, repeats per minute or seconds, a series or a parallel form. All of that is
converted once, here, to the ideal (ISA) form in SI seconds and in the units the loop's signals have::

    u = K·(b·ysp − y + (1/Ti)·∫(ysp − y) dt − Td·dy/dt)

| form | as written | ideal form |
|---|---|---|
| ideal | K', Ti', Td' | K = K', Ti = Ti', Td = Td' |
| series | K'·(1 + 1/(Ti's))·(1 + Td's) | K = K'(1 + Td'/Ti'), Ti = Ti' + Td', Td = Ti'Td'/(Ti' + Td') |
| parallel | kp + ki/s + kd·s | K = kp, Ti = kp/ki, Td = kd/kp |

Proportional band: K = 100/PB, in % of OP span per % of PV span. A gain in %/% becomes OP units per PV unit when
multiplied by (width of OP span)/(width of PV span). A direct-acting controller (OP rises with PV) has negative K.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, field_validator, model_validator

from .checked import Checked
from .errors import InputError

__all__ = ["Controller", "Ideal", "Span"]

Span = tuple[float, float]
"""Range of a signal, (low, high), in the signal's unit."""

_SECONDS = {"s": 1.0, "min": 60.0, "repeats/s": 1.0, "repeats/min": 60.0}

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class Ideal(NamedTuple):
    """Controller in ideal form.

    Attributes
    ----------
    k : float
        Gain K [OP unit / PV unit], negative for a direct-acting controller, never 0.
    ti, td : float
        Integral and derivative time [s], `ti` > 0, `td` ≥ 0.
    b : float
        Setpoint weight, 0..1.
    """

    k: float
    ti: float
    td: float
    b: float


class Controller(Checked):
    """PID settings in the words and units of the system they come from.

    Parameters
    ----------
    form : {"ideal", "series", "parallel"}
        Ideal and series take `k` or `pb`, with `ti` and `td`; parallel takes `kp`, `ki`, `kd`.
    k : float
        Gain, > 0; its sign is given by `action`.
    pb : float
        Proportional band [%], > 0.
    kp, ki, kd : float
        Gains of the parallel form: `kp` > 0, `ki` > 0 per `ti_unit`, `kd` ≥ 0 times `td_unit`.
    gain_unit : {"%/%", "OP/PV"}
        Unit of `k`, or of `kp`, `ki` and `kd`. May be left out where both are the same: spans of equal width, or no
        spans known (then taken as OP/PV). A proportional band is always %/%.
    ti : float
        Integral time, > 0.
    ti_unit : {"s", "min", "repeats/s", "repeats/min"}
        Unit of `ti`; repeats per time are its inverse.
    td : float
        Derivative time, ≥ 0.
    td_unit : {"s", "min"}
        Unit of `td`.
    action : {"reverse", "direct"}
        Reverse: OP falls when PV rises (most loops). Direct: OP rises with PV.
    setpoint_weight : float
        b, the part of the setpoint in the proportional term, 0..1.
    error_gap : float
        Errors smaller than this are ignored by the controller itself [PV unit], ≥ 0.
    output_dead_band : float
        Changes of OP smaller than this are not sent to the valve [OP unit], ≥ 0.
    pv_filter : float
        Time constant of the PV filter in the control system [s], ≥ 0.

    Raises
    ------
    InputError
        With the parameter, its value and its bound.

    Examples
    --------
    A series controller with PB 200 % and 2 repeats per minute on a 0..50 m³/h flow:

    >>> c = Controller(form="series", pb=200, ti=2, ti_unit="repeats/min", td=0.05, td_unit="min")
    >>> c.ideal(pv_span=(0, 50), op_span=(0, 100))
    Ideal(k=1.1, ti=33.0, td=2.727272727272727, b=1.0)
    >>> Controller(k=0.5, ti=0)
    Traceback (most recent call last):
    glapp.errors.InputError: ti: is 0, must be > 0
    """

    form: Literal["ideal", "series", "parallel"] = "ideal"
    k: Positive | None = None
    pb: Annotated[float, Field(gt=0)] | None = None
    kp: Positive | None = None
    ki: Positive | None = None
    kd: NotNegative | None = None
    gain_unit: Literal["%/%", "OP/PV"] | None = None
    ti: Positive | None = None
    ti_unit: Literal["s", "min", "repeats/s", "repeats/min"] = "s"
    td: NotNegative = 0.0
    td_unit: Literal["s", "min"] = "s"
    action: Literal["reverse", "direct"] = "reverse"
    setpoint_weight: Annotated[float, Field(ge=0, le=1)] = 1.0
    error_gap: NotNegative = 0.0
    output_dead_band: NotNegative = 0.0
    pv_filter: Annotated[float, Field(ge=0)] = 0.0

    @field_validator("k", "pb", "kp", mode="before")
    @classmethod
    def _sign_is_the_action(cls, value: Any) -> Any:
        """Refuse a sign of the gain: `action` has it."""
        if isinstance(value, int | float) and value < 0:
            hint = "the action has its sign: write action = 'direct' where OP rises with PV"
            raise InputError(f"is {value!r}, must be > 0", value=value, bound="> 0", hint=hint)
        return value

    @model_validator(mode="after")
    def _one_way_of_writing(self) -> Controller:
        """Check that the gains are given in one way, and completely."""
        parallel = self.form == "parallel"
        wanted, other = (("kp", "ki", "kd"), ("k", "pb", "ti", "td")) if parallel else (("k", "ti"), ("kp", "ki", "kd"))
        given = self.model_fields_set
        for name in other:
            if name in given and getattr(self, name) is not None:
                hint = f"the {self.form} form is written with {', '.join(wanted)}"
                raise InputError(f"does not belong to form = '{self.form}'", parameter=name, hint=hint)
        if parallel:
            if self.kp is None or self.ki is None:
                name = "kp" if self.kp is None else "ki"
                raise InputError("is required in the parallel form", parameter=name, bound="required")
            if self.ti_unit.startswith("repeats"):
                raise InputError(
                    f"is {self.ti_unit!r}, must be 's' or 'min' in the parallel form (ki is per second or per minute)",
                    parameter="ti_unit",
                    value=self.ti_unit,
                    bound="'s' or 'min'",
                )
            return self
        if (self.k is None) == (self.pb is None):
            raise InputError("give either the gain k or the proportional band pb", parameter="k", value=self.k)
        if self.ti is None:
            raise InputError("is required", parameter="ti", bound="> 0", hint="the method needs the integral time")
        if self.pb is not None and self.gain_unit == "OP/PV":
            raise InputError("a proportional band is always in %/%", parameter="gain_unit", value=self.gain_unit)
        return self

    def ideal(self, pv_span: Span | None = None, op_span: Span | None = None) -> Ideal:
        """Convert to the ideal form in the units of the signals.

        Parameters
        ----------
        pv_span, op_span : (float, float), optional
            Ranges of PV and OP [their units]. Needed for a gain in %/%.

        Returns
        -------
        Ideal
            K signed [OP unit / PV unit], Ti and Td [s], b.

        Raises
        ------
        InputError
            Where the unit of the gain is open, or spans are needed and not given.

        Examples
        --------
        >>> Controller(form="parallel", kp=2, ki=0.5, kd=4).ideal()
        Ideal(k=2.0, ti=4.0, td=2.0, b=1.0)
        >>> Controller(k=2, ti=1, ti_unit="min", action="direct").ideal()
        Ideal(k=-2.0, ti=60.0, td=0.0, b=1.0)
        """
        scale = self._scale(pv_span, op_span)
        unit_i, unit_d = _SECONDS[self.ti_unit], _SECONDS[self.td_unit]
        if self.form == "parallel":
            assert self.kp is not None and self.ki is not None  # checked when made
            k, ti, td = self.kp, self.kp / self.ki * unit_i, (self.kd or 0.0) / self.kp * unit_d
        else:
            assert self.ti is not None
            k = self.k if self.k is not None else 100.0 / self.pb  # type: ignore[operator]
            ti = unit_i / self.ti if self.ti_unit.startswith("repeats") else self.ti * unit_i
            td = self.td * unit_d
            if self.form == "series":
                k, ti, td = k * (1.0 + td / ti), ti + td, ti * td / (ti + td)
        k *= scale
        for name, value, low in (("k", k, 0.0), ("ti", ti, 0.0), ("td", td, -1.0)):
            if not (math.isfinite(value) and value > low):  # a product that over- or underflowed
                raise InputError(f"is {value:g} when converted, must be finite and > 0", parameter=name, value=value)
        return Ideal(-k if self.action == "direct" else k, ti, td, self.setpoint_weight)

    def _scale(self, pv_span: Span | None, op_span: Span | None) -> float:
        """Width of OP span over width of PV span, where the gain is in %/%; 1 where it is in signal units."""
        percent = self.pb is not None or self.gain_unit == "%/%"
        if self.gain_unit == "OP/PV":
            return 1.0
        if pv_span is None or op_span is None:
            if not percent:
                return 1.0
            missing = "pv_span" if pv_span is None else "op_span"
            raise InputError(
                "is required to convert a gain in %/% (or a proportional band)",
                parameter=missing,
                bound="required",
                hint="give the ranges of PV and OP: --pv-span 0 50 --op-span 0 100, or in a loops.toml "
                "pv_span = [0, 50] and op_span = [0, 100]",
            )
        ratio = (op_span[1] - op_span[0]) / (pv_span[1] - pv_span[0])
        if not percent and ratio != 1.0:
            raise InputError(
                "is required, since the spans of PV and OP differ in width",
                parameter="gain_unit",
                bound="'%/%' or 'OP/PV'",
                hint="'%/%' if the gain is in % of span per % of span (as in most systems), 'OP/PV' if in their units",
            )
        return ratio

    def as_written(self) -> str:
        """The settings in the maker's own words, for reports.

        Examples
        --------
        >>> Controller(form="series", pb=200, ti=2, ti_unit="repeats/min").as_written()
        'series: PB 200 %, Ti 2 repeats/min, Td 0 s, reverse acting'
        """
        unit = f" {self.gain_unit}" if self.gain_unit else ""
        if self.form == "parallel":
            terms = [
                f"kp {self.kp:g}{unit}",
                f"ki {self.ki:g} per {self.ti_unit}",
                f"kd {self.kd or 0:g} {self.td_unit}",
            ]
        else:
            gain = f"K {self.k:g}{unit}" if self.k is not None else f"PB {self.pb:g} %"
            terms = [gain, f"Ti {self.ti:g} {self.ti_unit}", f"Td {self.td:g} {self.td_unit}"]
        weight = [f"setpoint weight {self.setpoint_weight:g}"] if self.setpoint_weight != 1 else []
        return f"{self.form}: " + ", ".join([*terms, f"{self.action} acting", *weight])
