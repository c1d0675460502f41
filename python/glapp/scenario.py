"""One simulated loop as one small record: plant, controller, valve, what acts on it, and how it is recorded.

A scenario is a frozen value with a form in TOML that a person can read and write; `glapp.simulate.run` runs it.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import numpy.typing as npt
import pyarrow.csv
import pyarrow.parquet
from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, PlainValidator, model_validator

from . import _glapp
from .checked import Checked, check_number
from .controller import Controller, Ideal, NotNegative, Positive, Span
from .errors import InputError
from .plant import PLANTS, Plant
from .tuning.assess import Tuning

__all__ = [
    "Coloured",
    "Compensation",
    "File",
    "Friction",
    "Gaussian",
    "Manual",
    "Outer",
    "Piece",
    "Ramp",
    "Samples",
    "Scenario",
    "Sine",
    "Stem",
    "Steps",
    "Uniform",
    "Valve",
    "Walk",
    "read_scenario",
]

Floats = npt.NDArray[np.float64]


class Steps(Checked):
    """A value that changes at given times; 0 before the first.

    Attributes
    ----------
    steps : tuple of (float, float)
        (time [s], value from then on), times ascending.
    """

    kind: Literal["steps"] = "steps"
    steps: tuple[tuple[float, float], ...]


class Ramp(Checked):
    """A ramp from 0 at `t` to `by` at `t + over`, constant afterwards.

    Attributes
    ----------
    t : float
        Begin [s].
    by : float
        Height.
    over : float
        Duration [s], > 0.
    """

    kind: Literal["ramp"] = "ramp"
    t: float = 0.0
    by: float
    over: Positive


class Sine(Checked):
    """amplitude·sin(2π·(time − t)/period) from `t` on, 0 before.

    Attributes
    ----------
    amplitude : float
        Of any sign.
    period : float
        [s], > 0.
    t : float
        Begin [s].
    """

    kind: Literal["sine"] = "sine"
    amplitude: float
    period: Positive
    t: float = 0.0


class Walk(Checked):
    """Random walk from 0: standard deviation rate·√t after t seconds.

    Attributes
    ----------
    rate : float
        [unit per √s], ≥ 0.
    """

    kind: Literal["walk"] = "walk"
    rate: NotNegative


class Uniform(Checked):
    """White noise, uniform between ± amplitude (thesis 6.2).

    Attributes
    ----------
    amplitude : float
        ≥ 0; the variance is amplitude²/3.
    """

    kind: Literal["uniform"] = "uniform"
    amplitude: NotNegative


class Gaussian(Checked):
    """White noise, the sum of twelve uniform numbers between 0 and 1, less 6: it never exceeds 6 sigma.

    Attributes
    ----------
    sigma : float
        Standard deviation, ≥ 0.
    """

    kind: Literal["gaussian"] = "gaussian"
    sigma: NotNegative


class Coloured(Checked):
    """Gaussian noise through a lag: its autocorrelation over k samples is (tau/(tau + h))^|k|.

    Attributes
    ----------
    sigma : float
        Standard deviation, ≥ 0.
    tau : float
        Time constant of the lag [s], ≥ 0.
    """

    kind: Literal["coloured"] = "coloured"
    sigma: NotNegative
    tau: NotNegative


class Samples(Checked):
    """One value a sample. Has no form in TOML: write a file, and `File`.

    Attributes
    ----------
    values : float64[n]
        n = t_end/h + 1 of them.
    """

    model_config = ConfigDict(arbitrary_types_allowed=True)

    kind: Literal["samples"] = "samples"
    values: Floats

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Samples) and np.array_equal(self.values, other.values)


class File(Checked):
    """A column of a CSV or Parquet file, one value a sample.

    Attributes
    ----------
    path : Path
        The file, by its ending .parquet or CSV.
    column : str
        Name of the column, of t_end/h + 1 numbers.
    """

    kind: Literal["file"] = "file"
    path: Path
    column: str

    def samples(self) -> Floats:
        """Read the values."""
        try:
            if self.path.suffix == ".parquet":
                table = pyarrow.parquet.read_table(self.path, columns=[self.column])
            else:
                table = pyarrow.csv.read_csv(self.path)
            return np.ascontiguousarray(table[self.column].to_numpy(), dtype=np.float64)
        except (OSError, KeyError, ValueError) as error:
            raise InputError(str(error), file=str(self.path), column=self.column) from None


Piece = Annotated[
    Steps | Ramp | Sine | Walk | Uniform | Gaussian | Coloured | Samples | File, Field(discriminator="kind")
]
"""Part of a signal; a signal is the sum of its pieces, each random one with a stream of its own."""


_PIECES = (Steps, Ramp, Sine, Walk, Uniform, Gaussian, Coloured, Samples, File)


def _signal(given: Any) -> Any:
    """Short forms of a signal: one piece, [(time, value), …], an array."""
    if isinstance(given, _PIECES):
        return (given,)
    if isinstance(given, np.ndarray):
        if given.ndim == 1 and given.dtype.kind in "fiu":
            return (Samples(values=np.ascontiguousarray(given, dtype=np.float64)),)
    elif isinstance(given, Sequence) and not isinstance(given, str):
        if all(isinstance(piece, (*_PIECES, Mapping)) for piece in given):
            return tuple(given)
        try:
            return (Steps(steps=tuple((float(t), float(value)) for t, value in given)),)
        except (TypeError, ValueError):
            pass
    hint = "write [(time, value), …], pieces such as {kind = 'sine', …}, or an array with one number a sample"
    raise InputError("is no signal", value=given, hint=hint)


def _noise(given: Any) -> Any:
    """A number is the amplitude of uniform noise."""
    if isinstance(given, int | float):
        return (Uniform(amplitude=given),) if given != 0 else ()
    return _signal(given)


def _controller(given: Any) -> Any:
    """Short form (k, ti[, td[, b]]): ideal, seconds, k negative for direct action, b = 1 where it is not given."""
    if isinstance(given, Controller | Mapping):
        return given
    if isinstance(given, Tuning):
        given = given.controller
    try:
        if not 2 <= len(given) <= 4:
            raise TypeError
        k, ti, *rest = [float(x) for x in given]
    except (TypeError, ValueError):
        raise InputError(
            "write (k, ti), (k, ti, td) or (k, ti, td, b), or give a Controller or a Tuning", value=given
        ) from None
    check_number(k, "k", lambda x: x != 0, "other than 0")
    td, b = (*rest, *(0.0, 1.0)[len(rest) :])
    return Controller(k=abs(k), ti=ti, td=td, setpoint_weight=b, action="direct" if k < 0 else "reverse")


def _simulated(controller: Controller) -> Controller:
    """Refuse what the simulated controller has not: else it would be left out without a word."""
    hints = {
        "error_gap": "leave it out",
        "output_dead_band": "leave it out; op_resolution gives steps of the output",
        "pv_filter": "write tf of the scenario, a second-order filter",
    }
    for name, hint in hints.items():
        if value := getattr(controller, name):
            raise InputError(f"is {value:g}, and is not simulated", parameter=name, value=value, bound="0", hint=hint)
    return controller


_Simulated = Annotated[Controller, BeforeValidator(_controller), AfterValidator(_simulated)]


def _manual(given: Any) -> Any:
    """Short form (from, to) or (from, to, op)."""
    if isinstance(given, Sequence) and 2 <= len(given) <= 3:
        return dict(zip(("begin", "end", "op"), given, strict=False))
    return given


Signal = Annotated[tuple[Piece, ...], BeforeValidator(_signal)]
Noise = Annotated[tuple[Piece, ...], BeforeValidator(_noise)]
Process = Annotated[Plant, PlainValidator(Plant.of)]
Limits = tuple[float, float]


class Friction(Checked):
    """Stick-slip friction of the valve.

    Parameters
    ----------
    model : {"kano", "he"}
        Kano et al. 2004: once loose the stem follows until the output stops or turns. He et al. 2007: it sticks again
        at every sample.
    s : float
        Dead band plus stick band: how far the output must move after a reversal [unit of op], ≥ 0.
    j : float
        Slip jump: how far the stem then jumps [unit of op], 0 ≤ j ≤ s. With j = 0 either model is a gap of width s.
    """

    model: Literal["kano", "he"]
    s: NotNegative
    j: NotNegative


class Stem(Checked):
    """Mass and friction of a valve's stem; forces in the unit of op, the actuator's spring has the rate 1.

    (1/w²)·ẍ = force − g(v) − viscous·v with g(v) = fc + (fs − fc)/(1 + |v|/stribeck); at rest it holds up to fs.

    Parameters
    ----------
    model : {"karnopp", "lugre"}
        Karnopp 1985: at rest it stands still. LuGre (Canudas de Wit et al. 1995): at rest bristles of 100 times the
        spring's rate bend.
    fs, fc : float
        Static and Coulomb friction [unit of op], fs ≥ fc ≥ 0. Without clearance the dead band is about 2·fc; the
        stem jumps where (fs − fc)/stribeck > viscous.
    stribeck : float
        Speed at which half of the difference is gone [unit of op per s], > 0.
    viscous : float
        [s], ≥ 0.
    w : float
        Natural frequency of mass and spring [rad/s], > 0. A simulation takes 20 steps per 1/w, 80 with LuGre.
    """

    model: Literal["karnopp", "lugre"]
    fs: NotNegative
    fc: NotNegative
    stribeck: Positive = 1.0
    viscous: NotNegative = 0.3
    w: Positive = 8.0


class Valve(Checked):
    """A valve as a mechanism: positioner and actuator, a stem, a worn joint, a curve.

    Parameters
    ----------
    lag : float
        Time constant of the actuator's pressure [s], ≥ 0; > 0 with a positioner and no stem.
    positioner : float
        Gain g of the positioner, ≥ 0; 0 for none. It sets the pressure to op + g·(op − stem).
    stem : Stem, optional
        Where not given the stem follows the pressure.
    d : float
        Total width of the clearance between stem and plug, outside of the positioner's loop [unit of op], ≥ 0.
    curve : float
        c, -1.8..1.8: e beyond rest the flow is e/(1 − c·e/100), of slope 1 at rest. c > 0 opens like an
        equal-percentage valve; 0 is straight.
    """

    lag: NotNegative = 0.0
    positioner: NotNegative = 0.0
    stem: Stem | None = None
    d: NotNegative = 0.0
    curve: Annotated[float, Field(ge=-1.8, le=1.8)] = 0.0

    def for_rust(self) -> tuple[Any, ...]:
        """The valve as the extension takes it."""
        s = self.stem
        stem = None if s is None else (s.model, s.fs, s.fc, s.stribeck, s.viscous, s.w)
        return (self.lag, self.positioner, stem, self.d, self.curve)

    def positions(self, op: npt.ArrayLike, h: float) -> Floats:
        """Positions of the plug under a course of op, from rest at its first value.

        Parameters
        ----------
        op : array_like, float64[n]
            Output at each sample, held to the next [unit of op].
        h : float
            Time between samples [s], > 0.

        Returns
        -------
        float64[n]
            Position of the plug just before the next sample [unit of op].

        Raises
        ------
        InputError
            For a number out of its bounds.

        Examples
        --------
        >>> Valve(d=2.0).positions([50.0, 53.0, 52.0, 50.0], 1.0).tolist()
        [50.0, 52.0, 52.0, 51.0]
        """
        try:
            return _glapp.valve_positions(self.for_rust(), np.array(op, dtype=np.float64), h)
        except ValueError as error:
            raise InputError(str(error)) from None


class Manual(Checked):
    """A stretch in manual.

    Attributes
    ----------
    begin, end : float
        From `begin` up to and without `end` [s].
    op : float, optional
        The output in it; its last value if not given.
    """

    begin: float
    end: float
    op: float | None = None


class Compensation(Checked):
    """Compensation of the gap by the module that ships (thesis 2.2, 7.4); `docs/compensation.md`.

    It is a `glapp.modules.BacklashDetection` next to the controller, at whose feed-forward it acts. It gets the
    controller's settings, its limits, and the static gain of the plant.

    Parameters
    ----------
    way : {"error", "derivative", "inverse"}
        By the sign of the filtered error, of the output's derivative, or by reversals of the output that exceed a noise
        band. There is no default: who compensates says how.
    size : float
        Width of the gap as far as it is trusted [unit of op], ≥ 0.
    share : float
        Share of it to compensate, 0..1.
    limit : float, optional
        Greatest width [unit of op], ≥ share·size; the size where not given.
    band : float, optional
        "inverse": how far the output must go back before that is a reversal [unit of op], ≥ 0; a fifth of the size
        where not given.
    tf : float
        Time constant of a filter of the output, before its direction is found [s], ≥ 0.
    rate : float, optional
        Greatest rate [unit of op per s], > 0. Where not given: "inverse" goes from side to side in Ti/10, the others
        jump.
    release : float, optional
        Time in which it is taken away [s], > 0, ≤ 10 Ti and ≤ 300; Ti where not given, or 300 s where that is shorter.
    watch : float, optional
        Time over which the loop is compared with what it was before [s], > 0; 300 Ti where not given.
    travel, reversals : float
        Budgets in any hour [unit of op; 1]; what is not given has none.
    withdraw : bool
        Whether it is withdrawn when over-compensation is found, and when the loop is worse than before.
    estimate : bool
        Whether the on-line estimate of the gap may lower the size; it never raises it.
    begin : float
        When it is enabled [s].
    k : float, optional
        Gain that is given to the module, ≠ 0; the controller's where not given.
    delay : int, optional
        Number of scans after which the controller has the u_FF that was made, 1..32. The module then treats it as
        another maker's controller, and reads its output. Where not given the module knows all of the controller, and
        the delay is one scan.
    longest : float, optional
        The longest delay with which it may be enabled, as a share of Ti, ≥ 0; the core's bound for its way where not
        given.
    """

    way: Literal["error", "derivative", "inverse"]
    size: NotNegative
    share: Annotated[float, Field(ge=0, le=1)] = 1.0
    limit: NotNegative | None = None
    band: NotNegative | None = None
    tf: NotNegative = 0.0
    rate: Positive | None = None
    release: Positive | None = None
    watch: Positive | None = None
    travel: Positive | None = None
    reversals: Annotated[float, Field(ge=2)] | None = None
    withdraw: bool = True
    estimate: bool = True
    begin: float = 0.0
    k: float | None = None
    delay: Annotated[int, Field(ge=1, le=32)] | None = None
    longest: NotNegative | None = None


class Outer(Checked):
    """The outer loop of a cascade (thesis 8.3); its output is the setpoint of the scenario's own loop.

    Parameters
    ----------
    plant, controller, limits, noise
        As in `Scenario`; the outer process is driven by the inner process value.
    tf : float, optional
        Time constant of the filter before the outer controller [s]; none where not given.
    d : float
        Width of a gap before the outer process [unit of the inner pv], ≥ 0 (8.3.2).
    load : Signal
        At the outer process' input [unit of the inner pv].
    """

    plant: Process
    controller: _Simulated
    tf: NotNegative | None = None
    limits: Limits | None = None
    d: NotNegative = 0.0
    noise: Noise = ()
    load: Signal = ()


class Scenario(Checked):
    """A loop with a worn valve, and what happens to it.

    Parameters
    ----------
    plant : Plant, or what `Plant.of` makes one of
        "P1" to "P8", (num, den, dead_time), `control.TransferFunction`, a list of plants in series ...; of order 1 to
        10, num of lower degree than den and not ending in 0.
    controller : Controller, (k, ti), (k, ti, td), (k, ti, td, b) or glapp.tuning.Tuning
        In any maker's form, without `error_gap`, `output_dead_band` and `pv_filter`, which are not simulated; or the
        ideal form (4.1): gain k ≠ 0, negative where more output lowers the process value; ti > 0 [s]; td ≥ 0 [s];
        setpoint weight b in 0..1, 1 where not given. The thesis has b = 0. A `Tuning` brings its own b and filter time.
    pv_span, op_span : (low, high), optional
        Needed for a gain in %/%.
    tf : float, optional
        Time constant of the second-order filter [s], 0 for none. Where not given, that of a `Tuning`, else the thesis'
        own (2.1): td/5, and ti/10 for a PI controller.
    filter_in_loop : bool, optional
        Whether the filter is before the controller, as in the thesis, or before the detector alone. Where not
        given, it is before the controller if `tf` is given.
    limits : (low, high), optional
        Limits of the output, with anti-windup.
    d : float
        Total width of the gap [unit of op], ≥ 0.
    friction : Friction, optional
        Stick-slip friction after the gap.
    valve : Valve, optional
        A valve as a mechanism, after gap and friction; not with compensation.
    rate : float, optional
        Greatest speed of the actuator [unit of op per s], > 0.
    noise : float or Signal
        Measurement noise [unit of pv]; a number is the amplitude of uniform noise.
    pv_resolution, op_resolution : float
        Steps that pv, and the op that is sent and recorded, are rounded to; 0 for none.
    setpoint, load : Signal
        [(time, value), …], an array, or pieces. The loop begins at rest at their first values; load acts at the process
        input, after the valve.
    manual : list of Manual, (begin, end) or (begin, end, op)
        Stretches in manual; back to auto without a bump.
    bad : list of (begin, end)
        Stretches [s] in which no process value arrives: the controller repeats its output, the recording the last
        value, with a flag.
    compensation : Compensation, optional
        Compensation of the gap: the loop is then one of `glapp.modules`.
    outer : Outer, optional
        Outer loop of a cascade; the setpoint is then the outer one.
    jitter : float
        Each recorded time is wrong by a uniform number between ± jitter [s], 0..h/2.
    lost : float
        Share of the samples that never reach the recording, 0 ≤ lost < 1.
    h, t_end : float
        Time between samples [s], > 0 and at most π over the magnitude of the plant's fastest pole; time of the last
        sample [s].
    seed : int
        Of everything random, 0..2⁶⁴ − 1.
    name : str
        For people.

    Raises
    ------
    InputError
        With the parameter, its value and its bound.

    Examples
    --------
    >>> s = Scenario(plant="P2", controller=(0.775, 2.05), d=0.05, setpoint=[(1, 1.0)], load=Walk(rate=0.002))
    >>> print(s.to_toml(), end="")
    plant = "P2"
    controller = { k = 0.775, ti = 2.05 }
    d = 0.05
    setpoint = [
      { kind = "steps", steps = [[1.0, 1.0]] },
    ]
    load = [
      { kind = "walk", rate = 0.002 },
    ]
    >>> Scenario.from_toml(s.to_toml()) == s
    True
    """

    name: str = ""
    plant: Process
    controller: _Simulated
    pv_span: Span | None = None
    op_span: Span | None = None
    tf: NotNegative | None = None
    filter_in_loop: bool | None = None
    limits: Limits | None = None
    d: NotNegative = 0.0
    friction: Friction | None = None
    valve: Valve | None = None
    rate: Positive | None = None
    noise: Noise = ()
    pv_resolution: NotNegative = 0.0
    op_resolution: NotNegative = 0.0
    setpoint: Signal = ()
    load: Signal = ()
    manual: tuple[Annotated[Manual, BeforeValidator(_manual)], ...] = ()
    bad: tuple[tuple[float, float], ...] = ()
    compensation: Compensation | None = None
    outer: Outer | None = None
    jitter: NotNegative = 0.0
    lost: Annotated[float, Field(ge=0, lt=1)] = 0.0
    h: Positive = 0.05
    t_end: NotNegative = 1000.0
    seed: Annotated[int, Field(ge=0, lt=2**64)] = 0

    @model_validator(mode="before")
    @classmethod
    def _filter_of_tuning(cls, given: Any) -> Any:
        """Take the filter time of a tuning, where none is given."""
        if isinstance(given, dict) and isinstance(tuning := given.get("controller"), Tuning) and tuning.tf:
            return {"tf": tuning.tf, **{name: value for name, value in given.items() if (name, value) != ("tf", None)}}
        return given

    def ideal(self) -> Ideal:
        """The controller in ideal form, in the units of the signals."""
        return self.controller.ideal(self.pv_span, self.op_span)

    def filter_time(self) -> float:
        """Time constant of the filter [s]: as given, or Td/5, or Ti/10 (2.1)."""
        return _filter_time(self.tf, self.ideal())

    def process_gain(self) -> float | None:
        """Static gain Kp of the plant; None for an integrating one."""
        return self.plant.gain

    def detector(self, tf: float) -> dict[str, Any]:
        """Settings of a detector for this loop with filter time `tf`, as the extension takes them."""
        gain = self.process_gain()
        return {**self.ideal()._asdict(), "kp": gain, "tf": tf, "h": self.h, "op_limits": self.limits}

    def _compensation(self, given: Compensation) -> dict[str, Any]:
        """The compensation in the core's form."""
        ideal = self.ideal()
        controller = {"k": ideal.k if given.k is None else given.k, "ti": ideal.ti}
        beside = given.model_dump(include={"begin", "delay", "longest"})
        settings = {**given.model_dump(exclude={*beside}), **controller}
        return {"settings": settings, "tf": self.filter_time(), **beside}

    @classmethod
    def from_toml(cls, text: str) -> Self:
        """The scenario that a TOML document describes; the same keys as here."""
        try:
            return cls(**tomllib.loads(text))
        except tomllib.TOMLDecodeError as error:
            raise InputError(str(error)) from None

    def to_toml(self) -> str:
        """The scenario as TOML, without the values that are defaults."""
        lines = []
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if value != field.default:
                lines.append(f"{name} = {_toml(value, deep=False)}\n")
        return "".join(lines)

    def for_rust(self) -> dict[str, Any]:
        """The scenario as plain values for the compiled extension."""
        friction, outer = self.friction, self.outer
        in_loop = self.tf is not None if self.filter_in_loop is None else self.filter_in_loop
        tf = self.filter_time() if in_loop else 0.0
        return {
            "plant": tuple(self.plant),
            "controller": (*self.ideal(), tf, self.limits),
            "d": self.d,
            "friction": None if friction is None else (friction.model, friction.s, friction.j),
            "valve": None if self.valve is None else self.valve.for_rust(),
            "rate": self.rate,
            "noise": _pieces(self.noise),
            "pv_resolution": self.pv_resolution,
            "op_resolution": self.op_resolution,
            "setpoint": _pieces(self.setpoint),
            "load": _pieces(self.load),
            "manual": [(stretch.begin, stretch.end, stretch.op) for stretch in self.manual],
            "bad": list(self.bad),
            "compensation": None if self.compensation is None else self._compensation(self.compensation),
            "outer": None if outer is None else _outer(outer),
            "jitter": self.jitter,
            "lost": self.lost,
            "h": self.h,
            "t_end": self.t_end,
            "seed": self.seed,
        }


def read_scenario(path: str | Path) -> Scenario:
    r"""The scenario in a TOML file.

    Parameters
    ----------
    path : str or Path
        The file; paths of signals in it are relative to its folder.

    Raises
    ------
    InputError
        Where the file cannot be read, or describes none.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "loop.toml")
    ...     _ = path.write_text('plant = "P3"\ncontroller = { k = 0.48, ti = 0.3117 }\nd = 0.05\n')
    ...     read_scenario(path).d
    0.05
    """
    path = Path(path)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=str(path)) from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(str(error), file=str(path)) from None
    for part in (table, table.get("outer", {})):
        for signal in ("setpoint", "load", "noise"):
            for piece in part.get(signal, []) if isinstance(part.get(signal), list) else []:
                if isinstance(piece, dict) and isinstance(piece.get("path"), str):
                    piece["path"] = path.parent / piece["path"]
    try:
        return Scenario(**table)
    except InputError as error:
        raise InputError(
            error.what, file=str(path), parameter=error.parameter, value=error.value, bound=error.bound, hint=error.hint
        ) from None


def _filter_time(tf: float | None, ideal: Ideal) -> float:
    return tf if tf is not None else _glapp.filter_time(ideal.ti, ideal.td)


def _outer(outer: Outer) -> dict[str, Any]:
    """The outer loop in the core's form."""
    ideal = outer.controller.ideal()
    return {
        "plant": tuple(outer.plant),
        "controller": (*ideal, outer.tf or 0.0, outer.limits),
        "d": outer.d,
        "noise": _pieces(outer.noise),
        "load": _pieces(outer.load),
    }


def _pieces(signal: tuple[Piece, ...]) -> list[dict[str, Any]]:
    """Each piece as a dict of its kind and its numbers."""
    pieces: list[dict[str, Any]] = []
    for piece in signal:
        match piece:
            case Steps():
                pieces.append({"steps": piece.steps})
            case Ramp():
                pieces.append({"ramp": (piece.t, piece.by, piece.over)})
            case Sine():
                pieces.append({"sine": (piece.amplitude, piece.period, piece.t)})
            case Walk():
                pieces.append({"walk": piece.rate})
            case Uniform():
                pieces.append({"uniform": piece.amplitude})
            case Gaussian():
                pieces.append({"gaussian": piece.sigma})
            case Coloured():
                pieces.append({"coloured": (piece.sigma, piece.tau)})
            case Samples():
                pieces.append({"samples": piece.values})
            case File():
                pieces.append({"samples": piece.samples()})
    return pieces


def _toml(value: Any, deep: bool = True) -> str:
    """A value of a scenario in TOML; on the outermost level, lists of tables one a line."""
    if isinstance(value, Samples):
        raise InputError("an array has no form in TOML", hint="write it to a file, and name that with kind = 'file'")
    if isinstance(value, Plant):
        return _toml_plant(value)
    if isinstance(value, Checked):
        items = {
            name: getattr(value, name)
            for name, field in type(value).model_fields.items()
            if name == "kind" or getattr(value, name) != field.default
        }
        return "{ " + ", ".join(f"{name} = {_toml(item)}" for name, item in items.items()) + " }"
    if isinstance(value, tuple):
        if not deep and value and isinstance(value[0], Checked):
            return "[\n" + "".join(f"  {_toml(item)},\n" for item in value) + "]"
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value) if math.isfinite(value) else str(value)
    return json.dumps(value.as_posix() if isinstance(value, Path) else value, ensure_ascii=False)


def _toml_plant(plant: Plant) -> str:
    """The name of a plant of the test batch, the coefficients of any other."""
    for name, named in PLANTS.items():
        if plant == named:
            return json.dumps(name)
    dead_time = f", dead_time = {_toml(plant.dead_time)}" if plant.dead_time else ""
    return f"{{ num = {_toml(plant.num)}, den = {_toml(plant.den)}{dead_time} }}"
