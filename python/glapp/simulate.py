"""Closed loops with a worn valve, where the truth is known.

A loop is a plant (transfer function with exact dead time), a PI or PID controller, a gap of total width d between the
controller and the valve, measurement noise, and what acts on it from outside::

       compensation  op                             position      load
           │ +       │                                 │           │ +
      sp ──→ PID ────┴→ rate ──→ gap ──→ friction ─────┴─────→ ○ ──→ plant ──┬──→
              ↑   within its limits                                          ○ ←── noise
              └──────────────── filter ←─────────────────────────────────────┴ pv

The plant is sampled exactly (zero-order hold), the blocks are the same as everywhere in glapp, and the same scenario
gives the same bits, alone or among a thousand. A loop with compensation is one of `glapp.modules`.
`docs/simulator.md` has every element with its equation and source.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv
from rich.progress import Progress

from . import _glapp
from .checked import check_number, check_one_of
from .errors import InputError
from .notebook import table
from .recording import AT_HIGH, AT_LOW, NOT_AUTO
from .scenario import (
    Coloured,
    Compensation,
    File,
    Friction,
    Gaussian,
    Manual,
    Outer,
    Piece,
    Ramp,
    Samples,
    Scenario,
    Sine,
    Stem,
    Steps,
    Uniform,
    Valve,
    Walk,
    read_scenario,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Coloured",
    "Compensation",
    "File",
    "Friction",
    "Gaussian",
    "Manual",
    "Outer",
    "Ramp",
    "Samples",
    "Scenario",
    "Signal",
    "Simulation",
    "Sine",
    "Stem",
    "Steps",
    "Uniform",
    "Valve",
    "Walk",
    "closed_loop",
    "random_walk",
    "read_scenario",
    "run",
    "run_many",
]

Signal = Piece | Sequence[Piece] | Sequence[tuple[float, float]] | npt.NDArray[np.float64]
"""A piece or several, whose sum it is; (time [s], value from then on) in ascending order, 0 before the first; or an
array with one value a sample."""

COMPENSATION_STATES = tuple(_glapp.compensation_states())
"""Meanings of the numbers in `Simulation.standing`."""


@dataclass(frozen=True, slots=True, repr=False)
class Simulation:
    """Signals of a simulated loop, one value a recorded sample.

    Attributes
    ----------
    t : float64[n]
        Time [s], exactly k·h where there is no jitter.
    sp, pv : float64[n]
        Setpoint (in a cascade that of the inner loop), and process value with noise as a recording has it, before any
        filter.
    op, position : float64[n]
        Controller output within its limits as it is sent, and the valve position that speed, gap and friction leave; of
        a `Valve` the position of its plug at the sample.
    load : float64[n]
        Load at the process input [unit of op].
    flags : uint8[n]
        Bits `NOT_AUTO`, `BAD`, `AT_LOW`, `AT_HIGH`.
    outer_sp, outer_pv : float64[n] or None
        Setpoint and process value of the outer loop of a cascade, whose output is `sp`.
    u_ff, standing : float64[n] or None
        What the compensation handed to the controller, and its state after the sample: an index of
        `COMPENSATION_STATES`.
    over, error : float64[n] or None
        Which warning of over-compensation held after the sample (0, 1 that of code block 7.1, 2 the relay, 3 both), and
        what the module found wrong (0, or `glapp.modules.Flag.WRONG_SIGN`).
    """

    t: npt.NDArray[np.float64]
    sp: npt.NDArray[np.float64]
    pv: npt.NDArray[np.float64]
    op: npt.NDArray[np.float64]
    position: npt.NDArray[np.float64]
    load: npt.NDArray[np.float64]
    flags: npt.NDArray[np.uint8]
    outer_sp: npt.NDArray[np.float64] | None = None
    outer_pv: npt.NDArray[np.float64] | None = None
    u_ff: npt.NDArray[np.float64] | None = None
    standing: npt.NDArray[np.float64] | None = None
    over: npt.NDArray[np.float64] | None = None
    error: npt.NDArray[np.float64] | None = None

    def __repr__(self) -> str:
        if not len(self.t):
            return "<Simulation: no samples>"
        return f"<Simulation: {len(self.t)} samples, {self.t[0]:g} to {self.t[-1]:g} s; SP, PV, OP, position, load>"

    def _repr_html_(self) -> str:
        """Ranges of the signals, for a notebook."""
        signals = (("SP", self.sp), ("PV", self.pv), ("OP", self.op), ("position", self.position), ("load", self.load))
        rows = [(name, f"{np.nanmin(x):.4g} to {np.nanmax(x):.4g}") for name, x in signals if len(x)]
        return table(repr(self)[1:-1], rows)

    def to_arrow(self) -> pa.Table:
        """Columns t, SP, PV, OP, MODE, OP_LOW, OP_HIGH, POSITION, LOAD; OUTER_SP, OUTER_PV, U_FF where there are."""
        mode = pa.DictionaryArray.from_arrays(self.flags & NOT_AUTO, pa.array(["AUTO", "MAN"]))
        columns = {
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
        if self.outer_sp is not None and self.outer_pv is not None:
            columns |= {"OUTER_SP": self.outer_sp, "OUTER_PV": self.outer_pv}
        if self.u_ff is not None:
            columns["U_FF"] = self.u_ff
        return pa.table(columns)

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """Arrow's protocol: `glapp.analyze`, `glapp.fit` and every reader of Arrow take a simulation as it is."""
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def to_pandas(self) -> pd.DataFrame:
        """The columns of `to_arrow` as a data frame of pandas, which must be installed.

        Raises
        ------
        InputError
            Where pandas is missing.
        """
        try:
            frame: pd.DataFrame = self.to_arrow().to_pandas()
        except ImportError:
            raise InputError("pandas is not installed", hint="pip install pandas, or use to_arrow()") from None
        return frame

    def write_csv(self, path: str | Path) -> None:
        """Write the columns of `to_arrow` as CSV, every number with all its digits."""
        table = self.to_arrow()
        mode = table.schema.get_field_index("MODE")
        pyarrow.csv.write_csv(table.set_column(mode, "MODE", table["MODE"].cast(pa.string())), path)


def run(scenario: Scenario) -> Simulation:
    """Run a scenario from rest at its first setpoint and load.

    Parameters
    ----------
    scenario : Scenario
        The loop and what acts on it.

    Raises
    ------
    InputError
        For a parameter out of its bounds, and for a closed loop that runs away, with the time.

    Examples
    --------
    A valve that sticks, read off its position: it stands still while the output moves by s, then jumps by j
    and what the output moved since the sample before.

    >>> s = run(Scenario(plant="P1", controller=(0.363, 7.06), friction=Friction(model="kano", s=0.3, j=0.1),
    ...                  load=[(5, 0.2)], t_end=600))
    >>> jumps = np.abs(np.diff(s.position))
    >>> f"{jumps[s.t[1:] > 300].max():.3f}"
    '0.102'
    """
    (simulation,) = _simulations([_checked(scenario)], [scenario])
    if isinstance(simulation, str):
        raise InputError(simulation)
    return simulation


_T = TypeVar("_T")


@overload
def run_many(
    scenarios: Iterable[Scenario], keep: Literal["signals"] = "signals", *, progress: bool = True
) -> list[Simulation]: ...
@overload
def run_many(scenarios: Iterable[Scenario], keep: Literal["estimate"], *, progress: bool = True) -> pa.Table: ...
def run_many(
    scenarios: Iterable[Scenario], keep: Literal["signals", "estimate"] = "signals", *, progress: bool = True
) -> list[Simulation] | pa.Table:
    """Run scenarios on all cores; each gives the same bits as alone.

    Parameters
    ----------
    scenarios : iterable of Scenario
        They are all checked before the first one runs.
    keep : {"signals", "estimate"}
        Every signal of every scenario; or only what the detector found, with the settings of the scenario's own
        controller, its filter time, the plant's static gain and N = 9, without ever storing a signal.
    progress : bool
        Show a progress bar while it runs.

    Returns
    -------
    list of Simulation, or pyarrow.Table
        In the order given. The table has a row a scenario: name, seed, d [unit of op], d_hat [unit of op] (null where
        there is no detection), low and high (range of the detections behind it), detections, half_periods, and error
        (null, or why the loop could not be believed: an unstable one does not stop the others).

    Raises
    ------
    InputError
        For the first scenario that cannot run, with its number from 0; with "signals" also where a loop runs away.

    Examples
    --------
    >>> scenarios = [Scenario(plant="P3", controller=(0.48, 0.3117), d=0.05, noise=0.002, setpoint=[(1, 1.0)],
    ...                       load=[(100, 0.3)], seed=seed) for seed in range(3)]
    >>> table = run_many(scenarios, keep="estimate", progress=False)
    >>> [round(d, 3) for d in table["d_hat"].to_pylist()]
    [0.049, 0.051, 0.05]
    """
    if not isinstance(scenarios, Iterable):
        bound = "a list of Scenario"
        raise InputError(f"is {scenarios!r}, must be {bound}", parameter="scenarios", value=scenarios, bound=bound)
    given = list(scenarios)
    check_one_of(keep, "keep", ("signals", "estimate"))
    checked = [_numbered(i, lambda s=s: _checked(s, watch=keep == "estimate")) for i, s in enumerate(given)]  # type: ignore[misc]
    groups = _glapp.groups(checked)
    if keep == "signals":
        simulations: dict[int, Simulation] = {}

        def simulate(jobs: list[int]) -> None:
            some = [given[i] for i in jobs]
            for i, simulation in zip(jobs, _simulations([checked[i] for i in jobs], some), strict=True):
                if isinstance(simulation, str):
                    raise InputError(simulation, parameter=f"scenario {i}")
                simulations[i] = simulation

        _on_all_cores(simulate, groups, "simulating", progress)
        return [simulations[i] for i in range(len(given))]
    seen: list[Any] = [None] * len(given)

    def watch(jobs: list[int]) -> None:
        for i, found in zip(jobs, _glapp.watch([checked[i] for i in jobs]), strict=True):
            seen[i] = found

    _on_all_cores(watch, groups, "watching", progress)
    d_hat, low, high, detections, half_periods, error = zip(*seen, strict=True) if seen else ((),) * 6
    return pa.table(
        {
            "name": pa.array([s.name for s in given], pa.string()),
            "seed": pa.array([s.seed for s in given], pa.uint64()),
            "d": pa.array([s.d for s in given], pa.float64()),
            "d_hat": pa.array(d_hat, pa.float64(), from_pandas=True),
            "low": pa.array(low, pa.float64(), from_pandas=True),
            "high": pa.array(high, pa.float64(), from_pandas=True),
            "detections": pa.array(detections, pa.uint32()),
            "half_periods": pa.array(half_periods, pa.uint32()),
            "error": pa.array(error, pa.string()),
        }
    )


def closed_loop(
    plant: Any,
    controller: Any,
    *,
    d: float = 0.05,
    noise: float | Signal = 0.005,
    h: float = 0.05,
    t_end: float = 1000.0,
    setpoint: Signal = (),
    load: Signal = (),
    limits: tuple[float, float] | None = None,
    manual: Sequence[tuple[float, float] | tuple[float, float, float]] = (),
    tf: float | None = None,
    seed: int = 0,
    **more: Any,
) -> Simulation:
    """Simulate a control loop; gap and noise are those of the thesis where they are not given.

    `(k, ti)` is a plain PI controller: setpoint weight b = 1, and no filter unless `tf` is given, as elsewhere. The
    thesis has b = 0 and the filter (2.1) in the loop: write ``(k, ti, 0, 0)`` and ``filter_in_loop=True``.

    Parameters
    ----------
    plant, controller, d, noise, h, t_end, setpoint, load, limits, manual, tf, seed, **more
        As in `Scenario`.

    Returns
    -------
    Simulation

    Raises
    ------
    InputError
        For a parameter out of its bounds, and for a closed loop that runs away, with the time.

    Examples
    --------
    P3 of the thesis with its PI controller: the output never rests, it travels through the gap back and forth.

    >>> s = closed_loop("P3", (0.48, 0.3117), d=0.05, t_end=1000, setpoint=[(1, 1.0)])
    >>> late = s.t > 500
    >>> f"{np.ptp(s.op[late]):.3f} of which the valve sees {np.ptp(s.position[late]):.3f}"
    '0.057 of which the valve sees 0.007'
    >>> closed_loop("P3", (5.0, 0.3117), t_end=400, setpoint=[(1, 1.0)])  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    glapp.errors.InputError: unstable closed loop: ...
    """
    fields: dict[str, Any] = {
        "plant": plant,
        "controller": controller,
        "d": d,
        "noise": noise,
        "h": h,
        "t_end": t_end,
        "setpoint": setpoint,
        "load": load,
        "limits": limits,
        "manual": manual,
        "tf": tf,
        "seed": seed,
    }
    return run(Scenario(**fields, **more))


def random_walk(n: int, h: float, rate: float, seed: int = 0) -> npt.NDArray[np.float64]:
    """Random walk from 0, a load that wanders: standard deviation rate·√t after t seconds.

    Parameters
    ----------
    n : int
        Number of samples, 0..10⁹.
    h : float
        Time between samples [s], > 0.
    rate : float
        Standard deviation after one second [unit per √s], ≥ 0.
    seed : int
        Seed, 0..2⁶⁴ − 1.

    Returns
    -------
    float64[n]
        The walk, 0 at the first sample.

    Examples
    --------
    >>> walk = random_walk(101, h=1.0, rate=0.1, seed=3)
    >>> s = closed_loop("P2", (0.775, 2.05), h=1.0, t_end=100, load=walk)
    >>> bool(np.array_equal(s.load, walk))
    True
    """
    if not (isinstance(seed, Integral) and 0 <= seed < 2**64):
        bound = "a whole number, 0..2⁶⁴ − 1"
        raise InputError(f"is {seed!r}, must be {bound}", parameter="seed", value=seed, bound=bound)
    n = int(check_number(n, "n", lambda x: 0 <= x <= 1e9 and x == int(x), "a whole number, 0..10⁹"))
    h = check_number(h, "h", lambda x: x > 0, "greater than 0 s")
    rate = check_number(rate, "rate", lambda x: x >= 0, "0 or greater")
    try:
        return _glapp.random_walk(n, h, rate, seed)
    except ValueError as error:
        raise InputError(str(error)) from None


def _checked(scenario: Scenario, watch: bool = False) -> _glapp.Scenario:
    """A scenario for the core, checked."""
    if not isinstance(scenario, Scenario):
        bound = "a Scenario"
        raise InputError(f"is {scenario!r}, must be {bound}", parameter="scenario", value=scenario, bound=bound)
    settings = scenario.detector(scenario.filter_time()) if watch else None
    try:
        return _glapp.Scenario(scenario.for_rust(), settings)
    except ValueError as error:
        raise InputError(str(error)) from None


def _columns(scenario: Scenario) -> tuple[str, ...]:
    """Signals that a scenario has, in the order in which they are recorded."""
    outer = ("outer_sp", "outer_pv") if scenario.outer is not None else ()
    compensated = ("u_ff", "standing", "over", "error") if scenario.compensation is not None else ()
    return ("t", "sp", "pv", "op", "position", "load", *outer, *compensated)


def _simulations(checked: Sequence[_glapp.Scenario], scenarios: Sequence[Scenario]) -> list[Simulation | str]:
    """The signals of each, or why it could not be believed."""
    names = [_columns(scenario) for scenario in scenarios]
    # One piece of NumPy memory comes in large pages; fetching small ones would take longer than the run.
    signals = [np.empty((len(rows), scenario.samples)) for rows, scenario in zip(names, checked, strict=True)]
    flags = [np.empty(scenario.samples, dtype=np.uint8) for scenario in checked]
    return [
        Simulation(**{name: row[:n] for name, row in zip(rows, columns, strict=True)}, flags=bits[:n])
        if error is None
        else error
        for (n, error), rows, columns, bits in zip(
            _glapp.run_together(checked, signals, flags), names, signals, flags, strict=True
        )
    ]


def _numbered(i: int, work: Callable[[], _T]) -> _T:
    """Do the work for scenario `i`, and name it in what goes wrong."""
    try:
        return work()
    except InputError as error:
        raise InputError(
            str(error), parameter=f"scenario {i}", value=error.value, bound=error.bound, hint=error.hint
        ) from None


def _on_all_cores(work: Callable[[list[int]], None], jobs: list[list[int]], what: str, progress: bool) -> None:
    """Do jobs on all cores, with a progress bar."""
    with (
        Progress(disable=not progress, transient=True) as bar,
        ThreadPoolExecutor(max_workers=os.cpu_count()) as pool,
    ):
        task = bar.add_task(what, total=sum(len(job) for job in jobs))
        running = {pool.submit(work, job): len(job) for job in jobs}
        try:
            for done in as_completed(running):
                done.result()
                bar.advance(task, running[done])
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
