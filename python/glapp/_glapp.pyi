"""The Rust extension."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from .recording import Batch

class AutoTuner:
    """Relay experiment (thesis 7.5); `found` is (ku, tu, kp, kappa), `tuned` gives (k, ti, td)."""

    def __init__(
        self,
        amplitude: float,
        *,
        wait: float,
        longest: float,
        max_h: float,
        pv_limits: tuple[float, float],
        op_limits: tuple[float, float],
        relay_hysteresis: float | None = None,
        d: float = 0.0,
    ) -> None: ...
    def start(self, op: float) -> None: ...
    def update(self, pv: float, h: float, flags: int = 0) -> float: ...
    @property
    def running(self) -> bool: ...
    @property
    def phase(self) -> str: ...
    @property
    def stop(self) -> str | None: ...
    @property
    def found(self) -> tuple[float, float, float | None, float | None] | None: ...
    @property
    def relay_hysteresis(self) -> float: ...
    @property
    def bias(self) -> float: ...
    def tuned(self, rule: str, kind: str = "PID") -> tuple[float, float, float]: ...

def stops() -> list[str]:
    """Names of the reasons why an experiment is broken off, by their numbers; the first is none."""

def tuned_by(
    found: tuple[float, float, float | None, float | None], rule: str, kind: str
) -> tuple[float, float, float]:
    """(k, ti, td) by a rule from ku, tu, kp and kappa."""

class Backlash:
    """Backlash of total width d ≥ 0 (thesis 6.3); begins at output, or at the first input."""

    def __init__(self, d: float, output: float | None = None) -> None: ...
    def update(self, x: float) -> float: ...

class Noise:
    """Uniform noise of ± amplitude (thesis 6.2); begins at integer, 1..2³¹ − 2."""

    def __init__(self, amplitude: float, integer: int = 1) -> None: ...
    def update(self, x: float) -> float: ...

class Pid:
    """PI or PID controller (thesis (4.1)) with anti-windup; update in auto, track in manual."""

    def __init__(
        self, k: float, ti: float, td: float = 0.0, b: float = 0.0, limits: tuple[float, float] | None = None
    ) -> None: ...
    def update(self, ysp: float, yf: float, h: float) -> float: ...
    def track(self, ysp: float, yf: float, u: float, h: float) -> float: ...

class Saturation:
    """A signal kept within low and high."""

    def __init__(self, low: float, high: float) -> None: ...
    def update(self, x: float) -> float: ...

class PhaseLead:
    """(1 + s·lead)/(1 + s·lag) with lead ≥ lag > 0 [s]; begins at rest at the first input."""

    def __init__(self, lead: float, lag: float) -> None: ...
    def update(self, x: float, h: float) -> float: ...

class RateLimit:
    """A signal that moves by at most rate > 0 a second; begins at the first input."""

    def __init__(self, rate: float) -> None: ...
    def update(self, x: float, h: float) -> float: ...

class Stiction:
    """Pushes against the stiction of a valve: "knocker", "reinforcement" or "two_moves"; without limits: none."""

    def __init__(
        self,
        push: str,
        *,
        k: float,
        ti: float,
        size: float,
        limit: float | None = None,
        hold: float | None = None,
        period: float | None = None,
        band: float | None = None,
        far: float = 0.0,
        rate: float | None = None,
        release: float | None = None,
        travel: float | None = None,
        watch: float | None = None,
        withdraw: bool = True,
        limits: tuple[float, float] | None = None,
    ) -> None: ...
    def update(self, e: float, u: float, h: float, *, enable: bool, flags: int = 0) -> float: ...
    @property
    def standing(self) -> str: ...
    @property
    def direction(self) -> int: ...

class Compensation:
    """Feed-forward that carries the valve through its gap (thesis 2.2); without limits: none.

    d_hat is the on-line estimate of the whole gap, where there is one; over: whether over-compensation is warned of;
    flags 1 not in automatic, 2 bad, 4 at the lower limit, 8 at the upper one; offered: the estimate where it may be a
    source; hindered: "too_late" or "not_followed".
    """

    def __init__(
        self,
        way: str,
        *,
        k: float,
        size: float,
        share: float,
        limit: float,
        band: float,
        tf: float,
        rate: float,
        release: float,
        watch: float,
        travel: float,
        reversals: float,
        withdraw: bool,
        estimate: bool = True,
        limits: tuple[float, float] | None = None,
        source: str = "typed",
        ramp_time: float = 0.0,
        ti: float | None = None,
    ) -> None: ...
    def update(
        self,
        e: float,
        u: float,
        h: float,
        *,
        enable: bool,
        d_hat: float | None = None,
        over: bool = False,
        flags: int = 0,
        offered: float | None = None,
        hindered: str | None = None,
    ) -> float: ...
    @property
    def standing(self) -> str: ...
    @property
    def size(self) -> float: ...
    @property
    def delta(self) -> float: ...
    @property
    def left(self) -> float: ...
    @property
    def spent(self) -> tuple[float, float]: ...

def compensation_states() -> list[str]: ...
def compensation_bounds(
    ti: float, *, size: float, share: float, limit: float, limits: tuple[float, float] | None = None
) -> list[tuple[str, str, float, float, bool]]: ...

class OverCompensation:
    """Warnings of over-compensation after a half-period: (equal, as in code block 7.1; relay)."""

    def __init__(self, k: float, ti: float) -> None: ...
    def update(
        self, delta_t: float, delta_y: float, h: float, size: float, delta_sp: float = 0.0, flags: int = 0
    ) -> tuple[bool, bool]: ...

class WrongSign:
    """Notices that K has the wrong sign for its process: OP at its limit, and PV runs away."""

    def __init__(self, k: float, ti: float, low: float, high: float) -> None: ...
    def update(self, sp: float, yf: float, op: float, h: float, flags: int = 0) -> bool: ...

class SecondOrderFilter:
    """Second-order low-pass filter of time constant tf ≥ 0 [s] (thesis 2.1); begins at the first value."""

    def __init__(self, tf: float) -> None: ...
    def update(self, x: float, h: float) -> float: ...

class NoiseLevel:
    """Standard deviation of a signal's fast noise, sample by sample."""

    def __init__(self) -> None: ...
    def update(self, x: float) -> None: ...
    @property
    def sigma(self) -> float | None: ...

class ZeroCrossing:
    """Zero crossings of the control error (thesis (2.1)); an error of exactly zero keeps the sign."""

    def __init__(self) -> None: ...
    def update(self, e: float) -> bool: ...
    @property
    def sign(self) -> int: ...

class Derivative:
    """Backward difference; 0 at the first value."""

    def __init__(self) -> None: ...
    def update(self, x: float, h: float) -> float: ...

class HalfPeriodBlock:
    """What the signals did between two zero crossings (thesis (2.2)).

    `update` gives None, or, where `crossed`: (flags, samples, delta_t, delta_y, e_max, delta_sp, sp_change,
    slope_change, op_change) of the half-period that the sample closes.
    """

    def __init__(self) -> None: ...
    def update(
        self,
        e: float,
        h: float,
        sp: float,
        slope: float = 0.0,
        op: float = 0.0,
        flags: int = 0,
        crossed: bool = False,
    ) -> tuple[int, int, float, float, float, float, float, float, float] | None: ...

class Width:
    """Width of the gap (thesis (2.4)) from one half-period; td, kp, op_change None: not known.

    `of` gives (delta_u, delta_u_d, delta_u_sp, op_travel, free, kp_part, d).
    """

    def __init__(
        self, k: float, ti: float, td: float | None = None, b: float = 1.0, kp: float | None = None
    ) -> None: ...
    def of(
        self,
        sign: int,
        delta_t: float,
        delta_y: float,
        sp_change: float = 0.0,
        slope_change: float = 0.0,
        op_change: float | None = None,
    ) -> tuple[float, float, float, float, float, float, float]: ...

class Swing:
    """OP's travel between its furthest points and the height of PV's plateau; `end` gives (travel or None, plateau)."""

    def __init__(self, k: float, ti: float, td: float | None = None, b: float = 1.0) -> None: ...
    def add(self, sp: float, yf: float, h: float, op: float | None = None) -> None: ...
    def end(self, sign: int, flags: int = 0) -> tuple[float | None, float]: ...

class Correction:
    """Width with the bias of (2.4) taken out, on line; `width` gives (d, low, high, kp), or the name of the doubt."""

    def __init__(
        self, k: float, ti: float, b: float = 1.0, kp: float | None = None, integrating: bool = False
    ) -> None: ...
    def conclude(self) -> None: ...
    def end(self, sign: int, delta_y: float, mask: int = 0, flags: int = 0) -> None: ...
    def add(self, sp: float, yf: float, h: float, op: float) -> None: ...
    def width(self) -> tuple[float, float, float, float] | str: ...

def doubts() -> list[str]:
    """Names of the doubts about a corrected width, by their numbers from 1."""

class SafetyNet:
    """Conditions that a half-period must meet (thesis chapter 5, 7.1); `check` gives (mask, reason)."""

    def __init__(
        self,
        k: float,
        ti: float,
        op_span: float | None = None,
        *,
        limits: bool = True,
        too_short: bool = True,
        not_square: bool = True,
        decaying: bool = True,
        growing: bool = True,
        sp_moved: bool = True,
        too_small: bool = True,
    ) -> None: ...
    def check(
        self,
        flags: int,
        delta_t: float,
        delta_y: float,
        e_max: float,
        delta_sp: float,
        free: float,
        previous: float | None = None,
        d_hat: float | None = None,
    ) -> tuple[int, int]: ...

class MedianMean:
    """Median/mean filter of n detections, n odd (thesis 7.3); `update` gives (value, low, high, kept, count)."""

    def __init__(self, n: int = 9) -> None: ...
    def update(self, d: float) -> tuple[float, float, float, int, int]: ...

def batch() -> list[tuple[str, list[float], list[float], float]]: ...

class Scenario:
    """A scenario, checked; `watch` are the settings of a detector beside it."""

    def __init__(self, scenario: dict[str, Any], watch: dict[str, Any] | None = None) -> None: ...
    @property
    def samples(self) -> int: ...

def groups(scenarios: Sequence[Scenario]) -> list[list[int]]:
    """Indices of the scenarios that are best run together."""

def instruction_sets() -> list[str]:
    """Names of the instruction sets of this processor, the widest last; the bits do not depend on them."""

def valve_positions(
    valve: tuple[float, float, tuple[str, float, float, float, float, float] | None, float, float],
    op: npt.NDArray[np.float64],
    h: float,
) -> npt.NDArray[np.float64]:
    """Where the plug of a valve (lag, positioner, stem, d, curve) stands under each output.

    The stem is (model, fs, fc, stribeck, viscous, w).
    """

def run_together(
    scenarios: Sequence[Scenario],
    signals: Sequence[npt.NDArray[np.float64]],
    flags: Sequence[npt.NDArray[np.uint8]],
    instructions: str | None = None,
) -> list[tuple[int, str | None]]:
    """Run scenarios, each into its arrays: rows t, sp, pv, op, position, load, and in a cascade outer_sp, outer_pv.

    Gives how many samples are recorded, or the error, of each.
    """

def watch(
    scenarios: Sequence[Scenario], instructions: str | None = None
) -> list[tuple[float, float, float, int, int, str | None]]:
    """d_hat, low, high (NaN: none), detections, half-periods and error of each, run together."""

def random_walk(n: int, h: float, rate: float, seed: int) -> npt.NDArray[np.float64]: ...
def reasons() -> list[str]: ...

DETECTIONS: int
DATA_GAP_STEPS: float

def filter_time(ti: float, td: float) -> float: ...

class HalfPeriod:
    """One half-period; attributes as the columns of `glapp.HalfPeriods`."""

    @property
    def t_start(self) -> float: ...
    @property
    def t_end(self) -> float: ...
    @property
    def sign(self) -> int: ...
    @property
    def samples(self) -> int: ...
    @property
    def delta_t(self) -> float: ...
    @property
    def delta_y(self) -> float: ...
    @property
    def e_max(self) -> float: ...
    @property
    def delta_sp(self) -> float: ...
    @property
    def delta_u(self) -> float: ...
    @property
    def delta_u_d(self) -> float: ...
    @property
    def delta_u_sp(self) -> float: ...
    @property
    def op_travel(self) -> float: ...
    @property
    def swing(self) -> float: ...
    @property
    def plateau(self) -> float: ...
    @property
    def free(self) -> float: ...
    @property
    def kp_part(self) -> float: ...
    @property
    def d(self) -> float: ...
    @property
    def previous_delta_y(self) -> float: ...
    @property
    def d_hat_before(self) -> float: ...
    @property
    def mask(self) -> int: ...
    @property
    def reason(self) -> int: ...
    @property
    def d_hat(self) -> float: ...
    @property
    def detections(self) -> int: ...

class Detector:
    """The detector with its state and its table of half-periods.

    `settings`: k, ti, h, and where they are not as usual td, b, kp, tf, n, max_h, op_limits, op_span, and off, the
    names of the conditions that are not asked.
    """

    def __new__(cls, settings: dict[str, Any]) -> Self: ...
    def update(self, t: float, sp: float, pv: float, op: float | None = None, flags: int = 0) -> HalfPeriod | None: ...
    def run(
        self,
        t: npt.NDArray[np.float64],
        sp: npt.NDArray[np.float64],
        pv: npt.NDArray[np.float64],
        op: npt.NDArray[np.float64] | None,
        flags: npt.NDArray[np.uint8] | None,
    ) -> None: ...
    def run_closely(
        self,
        t: npt.NDArray[np.float64],
        sp: npt.NDArray[np.float64],
        pv: npt.NDArray[np.float64],
        op: npt.NDArray[np.float64] | None,
        flags: npt.NDArray[np.uint8] | None,
    ) -> npt.NDArray[np.float64]:
        """As `run`, with the swing of the half-periods; gives the filtered PV of each sample."""
    def table(self) -> dict[str, npt.NDArray[Any]]: ...
    @property
    def reasons(self) -> list[int]: ...
    @property
    def estimate(self) -> tuple[float, float, float, int, int] | None: ...
    @property
    def median_mean(self) -> tuple[float, float, float, int, int] | None: ...
    @property
    def noise_floor(self) -> float | None: ...
    def save(self) -> str: ...
    @staticmethod
    def load(text: str) -> Detector: ...

def run_side_by_side(
    detectors: Sequence[Detector],
    signals: Sequence[
        tuple[
            npt.NDArray[np.float64],
            npt.NDArray[np.float64],
            npt.NDArray[np.float64],
            npt.NDArray[np.float64] | None,
        ]
    ],
    instructions: str | None = None,
) -> None:
    """As `Detector.run` for each, in the lanes of the processor: t, SP, PV and OP of each loop. The same bits."""

def run_lake(
    detectors: Sequence[Detector],
    places: Sequence[tuple[Sequence[str | Path], tuple[str, str, str, str | None]]],
    threads: int,
    since: int | None = None,
    instructions: str | None = None,
) -> list[tuple[int, tuple[Path, int | None, str] | None]]:
    """The same from Parquet: of each loop its files in the order of time, and the columns of time, SP, PV and OP.

    Seconds of timestamps are counted from `since` on [µs since 1970], else from each loop's first row. Gives rows read,
    or the file, its row, and what is wrong; the detector is then as it was.
    """

class History:
    """The detectors of a ladder over a history that comes in pieces, in bounded memory.

    `settings` as of a `Detector`; where tf is not `given`, all that are tried.
    """

    def __new__(cls, settings: dict[str, Any], given: bool) -> Self: ...
    def take(
        self,
        t: npt.NDArray[np.float64],
        sp: npt.NDArray[np.float64],
        pv: npt.NDArray[np.float64],
        op: npt.NDArray[np.float64] | None,
        flags: npt.NDArray[np.uint8] | None,
    ) -> None: ...
    def heard(self) -> dict[str, Any]:
        """`crossings`, `why`, `d_hat`, `noise_floor`, `detections`, `half_periods`, `reasons` and `tf` so far."""
    def save(self) -> str: ...
    @staticmethod
    def load(text: str) -> History: ...

def process_gain(given: float | None, spans: tuple[float, float] | None, integrating: bool) -> float | None: ...

KP_DEFAULT: float
INSPECTED_ROWS: int

ANSWER_VERSION: int
NOMINAL_LIMIT: float

def summary(facts: str) -> dict[str, Any]:
    """The one answer of what is known of a valve: facts as JSON in, plain types out."""

def harm(
    cells: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]],
    batch: Batch,
    law: tuple[float, float] | None,
    process: tuple[tuple[float, float, float], bool],
) -> dict[str, float | None]:
    """Harm of a gap fitted to cells (time, PV, position) of a batch, under K and Ti, through (Kp, dead time, lag)."""

class Analysis:
    """The analysis of a recording: made of a task (JSON) and its beginning, handed all batches, then finished."""

    def __init__(self, task: str, beginning: Batch) -> None: ...
    def take(self, batch: Batch) -> list[npt.NDArray[np.float64]]:
        """Takes the next rows; gives the filtered PV of each filter time that is tried."""
    def finish(self, progress: Callable[[float], None] | None) -> dict[str, Any]:
        """`answer` in plain types, `op`: whether OP is recorded, `chosen` filter time and `table`; `pv`, `position`."""

def to_text(
    code: str,
    numbers: Mapping[str, Any] | None = None,
    *,
    name: str = "",
    pv_unit: str | None = None,
    op_unit: str | None = None,
    t0: int | None = None,
    first_row: int = 2,
) -> str:
    """The message of this code as a person reads it; `t0`: local time of t = 0 [µs since 1970].

    ValueError where there is no such message, or one of its numbers is missing or of another kind.
    """

def texts_of(facts: str, *, name: str = "", pv_unit: str | None = None, op_unit: str | None = None) -> dict[str, Any]:
    """The parts of an answer in words, from its document and what its sentences need beside it (JSON)."""

def overview(run: str) -> str:
    """All loops of a run in short; of each its headline (JSON)."""

def catalogue() -> list[tuple[str, str]]:
    """Every code with its template."""

def number(value: float | None, digits: int = 3) -> str:
    """Write a number with so many significant digits, without an exponent where a person would use none.

    >>> number(0.50349), number(1234.6), number(34), number(None), number(-0.00001234)
    ('0.503', '1235', '34', '–', '−1.23e-05')
    """

def quantity(value: float | None, unit: str, digits: int = 3) -> str:
    """Write a number with its unit, with a no-break space between; a dash alone where there is no number."""

def duration(seconds: float) -> str:
    """Write a time span in the two largest units that fit."""

def clock(t0: int | None, seconds: float) -> str:
    """Write a moment of a recording; `t0`: local time of t = 0 [µs since 1970], None where it is not known."""

def count(n: int, noun: str) -> str:
    """Write a count with its noun."""

def sentence(text: str | None) -> str:
    """Make a reason a sentence: full stop, and a capital letter unless it starts with a file, a tag or a symbol."""

def inspect(
    t: npt.NDArray[np.float64],
    sp: npt.NDArray[np.float64] | None,
    pv: npt.NDArray[np.float64],
    op: npt.NDArray[np.float64] | None,
    flags: npt.NDArray[np.uint8] | None,
    statistics: object,
    settings: tuple[float | None, float | None, float | None],
    identification: object | None,
    pv_span: tuple[float, float] | None,
    op_span: tuple[float, float] | None,
) -> list[dict[str, Any]]:
    """What is wrong with a recording; data statistics and identification by their attributes, settings K, Ti and Td."""

def own_times(held: str, pv_rows: int, rows: int) -> dict[str, Any]: ...
def newest_first(column: str) -> dict[str, Any]: ...
def setting_unused(setting: str, value: str, column: str | None) -> dict[str, Any]: ...
def assumed_time(column: str, first: str, step: float | None, calendar: str, sure: bool) -> dict[str, Any]: ...
def noise_sigma(pv: npt.NDArray[np.float64]) -> float | None: ...
def op_unit(stated: str | None, span: tuple[float, float] | None, op: npt.NDArray[np.float64] | None) -> str: ...

# Tuning rules in closed form: (k, ti, td) of the ideal form. Raise ValueError that names the bound.

def ziegler_nichols_step(a: float, l: float, pid: bool, original: bool) -> tuple[float, float, float]: ...
def ziegler_nichols_frequency(ku: float, tu: float, pid: bool, original: bool) -> tuple[float, float, float]: ...
def lambda_tuning(kp: float, t: float, l: float, lam: float, pid: bool) -> tuple[float, float, float]: ...
def lambda_integrating(kv: float, l: float, lam: float) -> tuple[float, float, float]: ...
def amigo_step(kp: float, t: float, l: float, pid: bool) -> tuple[float, float, float]: ...
def amigo_integrating(kv: float, l: float, pid: bool) -> tuple[float, float, float]: ...
def amigo_frequency(ku: float, tu: float, kappa: float, pid: bool) -> tuple[float, float, float]: ...
def point_placement(ku: float, tu: float) -> tuple[float, float, float]: ...
def simc(kp: float, t: float, t2: float, l: float, tau_c: float) -> tuple[float, float, float]: ...
def simc_integrating(kv: float, t2: float, l: float, tau_c: float) -> tuple[float, float, float]: ...

LONG_HISTORY: int
MOST_EPOCHS: int

def fit(batches: Sequence[Batch], sign: float, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Fit records of one valve: the `answer`, and what `pv` and `position` said in whole."""

def fit_valve(
    recordings: Sequence[tuple[float, Sequence[Batch]]],
    sign: float,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """As `fit`, of recordings in the order of time: when the time of each is 0 [s] or NaN, and its batches."""

def fit_judgement(evidence: str) -> dict[str, Any]:
    """What the ladder says of an answer's `evidence`, as JSON: confidence, cause, width_kind, oscillates, reason."""

def fit_weighed(evidence: str) -> dict[str, Any]:
    """An answer's `evidence`, as JSON, weighed.

    `quantities`: of each its value, whether a greater one speaks for a dead band, and its log-odds; `log_bayes_factor`,
    None where the record cannot be read; `learned`: which fit and records the weights are from.
    """

def fit_thresholds() -> dict[str, tuple[float, str]]:
    """Value and unit of every threshold of a verdict, by its name."""

def width_trend(t: Sequence[float], d: Sequence[float], error: Sequence[float] | None = None) -> dict[str, Any]:
    """Whether and how fast a width changes: widths [OP unit] at times [s], with standard errors where known."""

def width_fall(widths: str) -> dict[str, Any] | None:
    """Whether the width has fallen from one recording or window to the next.

    `widths` is JSON: of each its time `t` [s], `verdict`, `d`, `low` and `high` [OP unit].
    """

def before_after(rows: tuple[Batch | None, Batch | None], widths: str) -> dict[str, Any]:
    """How a loop did before and after a repair, and the differences.

    `widths` is JSON: of either side as in `width_fall`, or null.
    """

class ManualRows:
    """The rows in manual of a recording, and the step test in them.

    `manual`: True where all rows were made in manual, False where the flags say which, None where nothing does.
    """

    def __init__(self, manual: bool | None) -> None: ...
    def add(self, batch: Batch) -> None: ...
    def kept(self) -> Batch | None:
        """The rows in manual in one; None where there are none."""
    def read(
        self, integrating: bool, op_span: float | None, positioner_dead_band: float | None, width: float | None
    ) -> dict[str, Any]:
        """The step test: numbers and codes, without sentences; of the width in question whether it is decided."""

class Windows:
    """Cuts a history into windows of `length` rows and keeps the best one of each epoch, in bounded memory.

    `hole` is the time between two rows [s] after which a new window begins.
    """

    def __init__(self, length: int, hole: float) -> None: ...
    @staticmethod
    def of_history(beginning: Batch, sign: float) -> Windows:
        """Windows for a history that begins so; `sign` is that of the process gain, 0 where it is not known."""
    def add(self, batch: Batch) -> None: ...
    def best(self) -> list[Batch]:
        """The best window of each epoch, in the order of time; the window under way ends here."""
    def scores(self) -> list[tuple[float, float, float]]:
        """Of the same windows the times of the first and last row [s], and what each may tell [OP unit]."""

R2_USABLE: float
WIDEST: float
MIN_STEPS: int

def identified(
    t: npt.NDArray[np.float64],
    sp: npt.NDArray[np.float64] | None,
    pv: npt.NDArray[np.float64],
    op: npt.NDArray[np.float64] | None,
    flags: npt.NDArray[np.uint8] | None,
    setpoint_weight: float | None,
    limits: tuple[float, float] | None,
) -> dict[str, Any]:
    """Find K, Ti and Td of the controller; `glapp.identify` is the public function."""

class Graph:
    """A loop of control modules; `modules` are (name, module) with its kind, parameters, plant and schedule."""

    def __init__(self, h: float, modules: Sequence[tuple[str, Any]], wires: Sequence[str]) -> None: ...
    @property
    def h(self) -> float: ...
    @property
    def scans(self) -> int: ...
    def scan(self, h: float) -> None: ...
    def record(
        self, scans: int, inputs: Sequence[tuple[str, npt.NDArray[np.float64]]], recorded: Sequence[str]
    ) -> list[npt.NDArray[np.float64]]: ...
    def get(self, path: str) -> float | None: ...
    def window(self, module: str) -> list[float]: ...
    def set(self, path: str, value: float | None) -> None: ...
    def schedule(self, module: str) -> list[tuple[float, float, float, float]]: ...
    def set_schedule(self, module: str, rows: Sequence[tuple[float, float, float, float]]) -> None: ...
    def take_over(self, module: str) -> None: ...
    def reset_detection(self, module: str) -> None: ...
    def names(self) -> list[str]: ...

def ideal_of_series(k: float, ti: float, td: float) -> tuple[float, float, float]:
    """K, Ti and Td in ideal form of k·(1 + 1/(s·ti))·(1 + s·td)."""

def ideal_of_parallel(kp: float, ki: float, kd: float) -> tuple[float, float, float]:
    """K, Ti and Td in ideal form of kp + ki/s + kd·s."""
