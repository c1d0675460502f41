"""The rules in closed form: each describes the process to the core, which has the formulas."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal

from .. import _glapp
from ..checked import check_number, check_one_of
from ..errors import InputError
from ..plant import Plant
from .assess import Tuning, assess
from .fotd import Fotd, fotd, tangent
from .half_rule import half_rule
from .integrating import Integrating, integrating
from .process import Kind, Process, kind_of
from .ultimate import ultimate

_ZN = "Ziegler & Nichols, Trans. ASME 64 (1942)"
_APC = "Åström & Hägglund, Advanced PID Control (2006), chapter 7"
_TABLES = {"textbook": False, "original": True}


def ziegler_nichols_step(
    process: Process, kind: Kind = "PID", *, table: Literal["textbook", "original"] = "textbook"
) -> Tuning:
    """Ziegler and Nichols' step response method: PI K = 0.9/a, Ti = 3L; PID K = 1.2/a, Ti = 2L, Td = L/2.

    The steepest tangent of the response to a unit step meets the time axis at L and the other axis at −a (thesis
    4.2.1). A model is its own step response: a = Kp·L/T of an `Fotd`, Kv·L of an `Integrating`, and an integrating
    process is taken for its model.

    Parameters
    ----------
    process : process or model
        L > 0.
    kind : {"PI", "PID"}
    table : {"textbook", "original"}
        Original: Ti = L/0.3 for PI, as in 1942.

    Examples
    --------
    >>> t = ziegler_nichols_step("P2", "PI")
    >>> f"{t.rule}: K {t.controller.k:.2f}, Ti {t.controller.ti:.2f} s, but Ms {t.ms:.1f}"
    'Ziegler-Nichols step (textbook) PI: K 2.82, Ti 4.28 s, but Ms 20.4'
    """
    plant = Plant.of(process)
    rule = f"Ziegler-Nichols step ({_table(table)}) {kind_of(kind)}"
    a, l = _tangent(process)  # noqa: E741
    return _tuned(rule, _ZN, plant, _glapp.ziegler_nichols_step, a, l, kind == "PID", _TABLES[table])


def _tangent(process: Process) -> tuple[float, float]:
    """The steepest tangent's intersections with the axes, a and L."""
    if isinstance(process, Fotd):
        return process.kp_process * process.l / process.t if process.t > 0 else math.inf, process.l
    plant = Plant.of(process)
    if plant.integrators == 1:
        model = integrating(plant)
        return model.kv * model.l, model.l
    return tangent(plant)


def ziegler_nichols_frequency(
    process: Process, kind: Kind = "PID", *, table: Literal["textbook", "original"] = "textbook"
) -> Tuning:
    """Ziegler and Nichols' frequency response method: PI K = 0.4Ku, Ti = 0.8Tu; PID K = 0.6Ku, Ti = Tu/2, Td = Tu/8.

    Parameters
    ----------
    process : process or model
        With an ultimate gain.
    kind : {"PI", "PID"}
    table : {"textbook", "original"}
        Original: PI K = 0.45Ku, Ti = Tu/1.2, as in 1942.

    Examples
    --------
    >>> t = ziegler_nichols_frequency("P2", "PI")
    >>> round(t.controller.k, 6), round(t.controller.ti / math.pi, 6)
    (1.6, 1.6)
    """
    plant = Plant.of(process)
    ku, tu = ultimate(plant)
    rule = f"Ziegler-Nichols frequency ({_table(table)}) {kind_of(kind)}"
    return _tuned(rule, _ZN, plant, _glapp.ziegler_nichols_frequency, ku, tu, kind == "PID", _TABLES[table])


def lambda_tuning(process: Process, kind: Kind = "PI", *, lam: float) -> Tuning:
    """Lambda tuning: after the dead time the loop answers a setpoint like a lag λ.

    PI K = T/(Kp(λ + L)), Ti = T; PID K = (T + L/2)/(Kp(λ + L/2)), Ti = T + L/2, Td = TL/(2T + L); an integrating
    process: PI Ti = 2λ + L, K = Ti/(Kv(λ + L)²).

    Parameters
    ----------
    process : process or model
        Stable with T > 0; integrating for PI only.
    kind : {"PI", "PID"}
    lam : float
        λ [s], > 0. T is common, 3T cautious.

    Examples
    --------
    >>> t = lambda_tuning(Fotd(1.0, t=2.0, l=1.0), lam=3.0)
    >>> t.controller
    Ideal(k=0.5, ti=2.0, td=0.0, b=0.0)
    """
    model, plant, lam = *_model(process), _time("lam", lam)
    rule, source = f"Lambda (λ = {lam:g} s) {kind_of(kind)}", "Dahlin (1968), as internal model control"
    if isinstance(model, Fotd):
        return _tuned(rule, source, plant, _glapp.lambda_tuning, model.kp_process, model.t, model.l, lam, kind == "PID")
    if kind == "PID":
        raise InputError("Lambda PID is for processes without integrator", parameter="process", hint="take kind='PI'")
    return _tuned(rule, source, plant, _glapp.lambda_integrating, model.kv, model.l, lam)


def amigo_step(process: Process, kind: Kind = "PID") -> Tuning:
    """AMIGO from the step response: what MIGO with M = 1.4 gives for a large batch of processes, as a formula.

    PI K = (0.15 + (0.35 − LT/(L + T)²)T/L)/Kp, Ti = 0.35L + 13LT²/(T² + 12LT + 7L²);
    PID K = (0.2 + 0.45T/L)/Kp, Ti = L(0.4L + 0.8T)/(L + 0.1T), Td = 0.5LT/(0.3L + T); integrating: PI 0.35/(Kv·L),
    13.4L; PID 0.45/(Kv·L), 8L, 0.5L.

    Parameters
    ----------
    process : process or model
        L > 0.
    kind : {"PI", "PID"}

    Examples
    --------
    >>> [round(x, 3) for x in amigo_step("P2").controller[:3]]
    [1.124, 2.415, 0.622]
    """
    model, plant = _model(process)
    rule = f"AMIGO step {kind_of(kind)}"
    if isinstance(model, Integrating):
        return _tuned(rule, _APC, plant, _glapp.amigo_integrating, model.kv, model.l, kind == "PID")
    return _tuned(rule, _APC, plant, _glapp.amigo_step, model.kp_process, model.t, model.l, kind == "PID")


def amigo_frequency(process: Process, kind: Kind = "PID") -> Tuning:
    """AMIGO from the ultimate point, κ = 1/(Kp·Ku), 0 for an integrating process.

    PI K = 0.16Ku, Ti = Tu/(1 + 4.5κ); PID K = (0.3 − 0.1κ⁴)Ku, Ti = 0.6Tu/(1 + 2κ), Td = 0.15(1 − κ)Tu/(1 − 0.95κ).

    Parameters
    ----------
    process : process or model
        With an ultimate gain, 0 ≤ κ < 1.
    kind : {"PI", "PID"}

    Notes
    -----
    Known bias: for PI the ultimate point says too little where κ is small. Above κ = 0.5 K and ki are within 15 % of
    MIGO's, P5 (κ = 1/8) gets twice as much and Ms = 1.8, P1 (κ = 0) Ms = 2.7.

    Examples
    --------
    >>> [round(x, 3) for x in amigo_frequency("P2").controller[:3]]
    [1.198, 2.513, 0.927]
    """
    plant = Plant.of(process)
    ku, tu = ultimate(plant)
    kappa = 0.0 if plant.gain is None else 1 / (plant.gain * ku) if plant.gain else math.inf
    return _tuned(f"AMIGO frequency {kind_of(kind)}", _APC, plant, _glapp.amigo_frequency, ku, tu, kappa, kind == "PID")


def point_placement(process: Process) -> Tuning:
    """PID that moves the ultimate point to −0.5·e^(i45°), with Ti = 6.25Td: K = 0.354Ku, Ti = 1.134Tu, Td = 0.181Tu.

    Ti = 6.25Td is what the thesis says of the autotuner (7.5); the point is ours.

    Parameters
    ----------
    process : process or model
        With an ultimate gain. One that is nearly all dead time (P8) becomes unstable, and is refused.

    Examples
    --------
    >>> t = point_placement("P2")
    >>> [round(x, 3) for x in t.controller[:3]], round(t.ms, 2)
    ([1.414, 7.127, 1.14], 1.43)
    """
    plant = Plant.of(process)
    ku, tu = ultimate(plant)
    source = "Åström & Hägglund, Automatica 20 (1984); Ti = 6.25Td: thesis 7.5"
    return _tuned("point placement PID", source, plant, _glapp.point_placement, ku, tu)


def simc(process: Process, kind: Kind = "PI", *, tau_c: float | None = None) -> Tuning:
    """SIMC: K = T/(Kp(τc + L)), Ti = min(T, 4(τc + L)), and for PID Td = T₂ in series form; given in ideal form.

    Parameters
    ----------
    process : process or model
        A process with real poles is reduced by the half rule; a model is taken as it is, for PI only.
    kind : {"PI", "PID"}
    tau_c : float, optional
        Time constant τc wished for [s], > 0. Where not given, the dead time of the reduced process ("tight" control).

    Examples
    --------
    >>> simc("P2").controller
    Ideal(k=0.3, ti=1.5, td=0.0, b=0.0)
    """
    if isinstance(process, Fotd | Integrating):
        plant = process.plant
        if kind == "PID":
            raise InputError("a model with one lag gives a PI controller", parameter="kind", value=kind, bound="PI")
        gain, l = (process.kp_process if isinstance(process, Fotd) else process.kv), process.l  # noqa: E741
        t, t2 = (process.t if isinstance(process, Fotd) else math.inf), 0.0
    else:
        plant = Plant.of(process)
        gain, t, t2, l = half_rule(plant, kind_of(kind))  # noqa: E741
    wished = l if tau_c is None else _time("tau_c", tau_c)
    if tau_c is None and l == 0:
        raise InputError("is required for a process without dead time", parameter="tau_c", bound="> 0 s")
    rule, source = f"SIMC (τc = {wished:g} s) {kind}", "Skogestad, J. Process Control 13 (2003)"
    if math.isinf(t):
        return _tuned(rule, source, plant, _glapp.simc_integrating, gain, t2, l, wished)
    # The half rule may leave the second lag the longer one.
    return _tuned(rule, source, plant, _glapp.simc, gain, max(t, t2), min(t, t2), l, wished)


def _tuned(
    rule: str, source: str, plant: Plant, closed_form: Callable[..., tuple[float, ...]], *numbers: Any
) -> Tuning:
    """Compute K, Ti and Td by a closed formula of the core, and assess the loop with them."""
    try:
        k, ti, td = closed_form(*numbers)
    except ValueError as error:
        raise InputError(f"{rule} is not for this process: {error}", parameter="process") from None
    return assess(plant, (k, ti, td), rule=rule, source=source)


def _model(process: Process) -> tuple[Fotd | Integrating, Plant]:
    """The model of a process, and the process itself."""
    if isinstance(process, Fotd | Integrating):
        return process, process.plant
    plant = Plant.of(process)
    return (integrating(plant) if plant.integrators == 1 else fotd(plant)), plant


def _time(name: str, value: float) -> float:
    """A time constant that is wished for [s], refused where it is none."""
    return check_number(value, name, lambda x: x > 0, "greater than 0 s")


def _table(table: str) -> str:
    check_one_of(table, "table", _TABLES)
    return table
