"""Closed loops with a worn valve, where the truth is known.

A loop is a plant (transfer function with exact dead time), a PI or PID controller, a gap of total width d between the
controller and the valve, measurement noise, and what acts on it from outside::

                                       load
                                        │ +
      sp ──→ PID ──→ limits ──→ gap ──→ ○ ──→ plant ──┬──→
              ↑         │op      │position            │
              │                                       ○ ←── noise
              └──────────────── filter ←──────────────┴ pv

The plant is sampled exactly (zero-order hold), the blocks are the same as everywhere in glapp, and the same arguments
give the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv

from . import _glapp
from .errors import InputError

__all__ = ["PLANTS", "Plant", "Signal", "Simulation", "closed_loop", "random_walk"]

Plant = tuple[Sequence[float], Sequence[float], float]
"""Transfer function (num, den, dead time [s]), coefficients in descending powers of s."""

Signal = Sequence[tuple[float, float]] | npt.NDArray[np.float64]
"""(time [s], value from then on) in ascending order, 0 before the first; or an array with one value a sample."""

PLANTS: dict[str, Plant] = {name: (num, den, dead_time) for name, num, den, dead_time in _glapp.batch()}
"""The test batch P1 to P8 (thesis 4.1)."""

NOT_AUTO, AT_LOW, AT_HIGH = 1, 4, 8
"""Bits of `Simulation.flags`: in manual, output at its lower limit, at its upper limit."""


@dataclass(frozen=True, slots=True)
class Simulation:
    """Signals of a simulated loop, one value a sample.

    Attributes
    ----------
    t : float64[n]
        Time [s], exactly k·h.
    sp, pv : float64[n]
        Setpoint, and process value with noise as a recording has it, before any filter.
    op, position : float64[n]
        Controller output within its limits, and the valve position that the gap leaves of it.
    load : float64[n]
        Load at the process input [unit of op].
    flags : uint8[n]
        Bits `NOT_AUTO`, `AT_LOW`, `AT_HIGH`.
    """

    t: npt.NDArray[np.float64]
    sp: npt.NDArray[np.float64]
    pv: npt.NDArray[np.float64]
    op: npt.NDArray[np.float64]
    position: npt.NDArray[np.float64]
    load: npt.NDArray[np.float64]
    flags: npt.NDArray[np.uint8]

    def to_arrow(self) -> pa.Table:
        """Arrow table with the columns t, SP, PV, OP, MODE, OP_LOW, OP_HIGH, POSITION, LOAD."""
        mode = pa.DictionaryArray.from_arrays(self.flags & NOT_AUTO, pa.array(["AUTO", "MAN"]))
        return pa.table(
            {
                "t": self.t,
                "SP": self.sp,
                "PV": self.pv,
                "OP": self.op,
                "MODE": mode,
                "OP_LOW": (self.flags & AT_LOW) != 0,
                "OP_HIGH": (self.flags & AT_HIGH) != 0,
                "POSITION": self.position,
                "LOAD": self.load,
            }
        )

    def write_csv(self, path: str | Path) -> None:
        """Write the columns of `to_arrow` as CSV, every number with all its digits."""
        table = self.to_arrow()
        mode = table.schema.get_field_index("MODE")
        pyarrow.csv.write_csv(table.set_column(mode, "MODE", table["MODE"].cast(pa.string())), path)


def closed_loop(
    plant: str | Plant,
    controller: Sequence[float],
    *,
    d: float = 0.05,
    noise: float = 0.005,
    h: float = 0.05,
    t_end: float = 1000.0,
    setpoint: Signal = (),
    load: Signal = (),
    limits: tuple[float, float] | None = None,
    manual: Sequence[tuple[float, float] | tuple[float, float, float]] = (),
    tf: float | None = None,
    seed: int = 0,
) -> Simulation:
    """Simulate a loop from rest.

    Parameters
    ----------
    plant : str or (num, den, dead_time)
        "P1" to "P8", or a transfer function of order 1 to 10, num of lower degree than den, coefficients in descending
        powers of s, with its dead time ≥ 0 [s].
    controller : (k, ti), (k, ti, td) or (k, ti, td, b)
        Ideal form (4.1), as `Loop.ideal` gives it: gain k ≠ 0, negative where more output lowers the process value;
        ti > 0 [s]; td ≥ 0 [s]; setpoint weight b in 0..1, 0 where not given, as in the thesis.
    d : float
        Total width of the gap [unit of op], ≥ 0.
    noise : float
        Amplitude of the uniform measurement noise [unit of pv], ≥ 0.
    h, t_end : float
        Time between samples [s], > 0 and at most π over the magnitude of the plant's fastest pole; time of the last
        sample [s].
    setpoint, load : Signal
        The loop begins at rest at their first values; load acts at the process input, after the gap.
    limits : (low, high), optional
        Limits of the output, with anti-windup.
    manual : list of (from, to) or (from, to, op)
        Stretches from ≤ t < to [s] in manual, at op or where the output stood; back to auto without a bump.
    tf : float, optional
        Time constant of the second-order filter before the controller [s], 0 for none. Where not given, the thesis' own
        (2.1): td/5, and ti/10 for a PI controller.
    seed : int
        Seed of the noise, 0..2⁶⁴ − 1.

    Returns
    -------
    Simulation

    Raises
    ------
    InputError
        For a parameter out of its bounds, and for a closed loop that runs away, with the time.

    Examples
    --------
    P3 of the thesis with its PI controller: the output never rests, it travels through the gap to and fro.

    >>> s = closed_loop("P3", (0.48, 0.3117), d=0.05, t_end=1000, setpoint=[(1, 1.0)])
    >>> late = s.t > 500
    >>> f"{np.ptp(s.op[late]):.3f} of which the valve sees {np.ptp(s.position[late]):.3f}"
    '0.059 of which the valve sees 0.009'
    >>> closed_loop("P3", (5.0, 0.3117), t_end=400, setpoint=[(1, 1.0)])  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    glapp.errors.InputError: unstable closed loop: ...
    """
    if not 2 <= len(controller) <= 4:
        raise InputError("write (k, ti), (k, ti, td) or (k, ti, td, b)", parameter="controller", value=controller)
    k, ti, td, b = [*controller, 0.0, 0.0][:4]
    _check_seed(seed)
    try:
        t, sp, pv, op, position, load_column, flags = _glapp.closed_loop(
            plant=_transfer_function(plant),
            k=k,
            ti=ti,
            td=td,
            b=b,
            tf=(td / 5 if td > 0 else ti / 10) if tf is None else tf,
            limits=limits,
            d=d,
            noise=noise,
            h=h,
            t_end=t_end,
            setpoint=_signal("setpoint", setpoint),
            load=_signal("load", load),
            manual=[(*stretch, None) if len(stretch) == 2 else stretch for stretch in manual],
            seed=seed,
        )
    except ValueError as error:
        raise InputError(str(error)) from None
    return Simulation(t, sp, pv, op, position, load_column, flags)


def random_walk(n: int, h: float, rate: float, seed: int = 0) -> npt.NDArray[np.float64]:
    """Random walk from 0, a load that wanders: standard deviation rate·√t after t seconds.

    Parameters
    ----------
    n : int
        Number of samples.
    h : float
        Time between samples [s], > 0.
    rate : float
        Standard deviation after one second [unit per √s], ≥ 0.
    seed : int
        Seed, 0..2⁶⁴ − 1.

    Examples
    --------
    >>> walk = random_walk(101, h=1.0, rate=0.1, seed=3)
    >>> s = closed_loop("P2", (0.775, 2.05), h=1.0, t_end=100, load=walk)
    >>> bool(np.array_equal(s.load, walk))
    True
    """
    _check_seed(seed)
    if n < 0:
        raise InputError(f"is {n}, must be 0 or greater", parameter="n", value=n, bound="≥ 0")
    try:
        return _glapp.random_walk(n, h, rate, seed)
    except ValueError as error:
        raise InputError(str(error)) from None


def _signal(name: str, signal: Signal) -> Signal:
    """Bring the signal into one of the two shapes that the simulator takes."""
    if isinstance(signal, np.ndarray) and signal.ndim == 1:
        return np.ascontiguousarray(signal, dtype=np.float64)
    try:
        return [(float(t), float(value)) for t, value in signal]
    except (TypeError, ValueError):
        hint = "write [(time, value), …] or an array with one number a sample"
        raise InputError("is no signal", parameter=name, value=signal, hint=hint) from None


def _check_seed(seed: int) -> None:
    if not 0 <= seed < 2**64:
        raise InputError(f"is {seed}, must be 0..2⁶⁴ − 1", parameter="seed", value=seed, bound="0..2⁶⁴ − 1")


def _transfer_function(plant: str | Plant) -> Plant:
    hint = f"write {', '.join(PLANTS)} or (num, den, dead_time)"
    try:
        num, den, dead_time = PLANTS[plant] if isinstance(plant, str) else plant
        return [float(c) for c in num], [float(c) for c in den], float(dead_time)
    except (KeyError, TypeError, ValueError):
        raise InputError(f"is {plant!r}", parameter="plant", value=plant, hint=hint) from None
