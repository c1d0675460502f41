"""What is wrong with a recording, found before anything is estimated from it.

Two sources of evidence: a `Census`, counts over every row, and an `InspectionSample`, the rows kept in memory.  Each
`Finding` names one fault, its numbers and what to do; `docs/quality.md` lists them all.  Codes, severities and numbers
come from `crates/analysis`; here are their sentences.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from string import Formatter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _glapp
from .arrays import column
from .identify import Identification

Floats = NDArray[np.float64]
Severity = Literal["info", "warning", "refuse"]

GAP_STEPS: float = _glapp.GAP_STEPS
"""A step longer than so many ordinary ones is a gap."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One fault or peculiarity of a recording.

    Attributes
    ----------
    code : str
        Stable name, listed in `docs/quality.md`.
    severity : "info" | "warning" | "refuse"
        refuse: no estimate from this recording can be right.
    text : str
        One sentence with the numbers, their units and what to do.
    evidence : dict[str, float | int | str]
        The numbers of the text and more; shares are 0..1, times in s, rows counted from 0.
    """

    code: str
    severity: Severity
    text: str
    evidence: dict[str, float | int | str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Census:
    """Counts over all rows of a recording, each a running quantity, gathered in one pass in constant memory.

    Rows count from 0 over the whole recording; -1 means "none".  A *pair* is a row and the one before it, also across
    batches.  Infinite counts as a non-number everywhere.

    Attributes
    ----------
    rows : int
        Rows.
    t_bad : int
        Rows whose time is not a number; they take part in no pair below that needs times.
    repeated, repeated_row : int
        Pairs with the same time; the later row of the first.
    reversed, reversed_row : int
        Pairs whose later row has the earlier time; the later row of the first.
    reversed_from, reversed_to : float
        The two times of that first pair [s since t0]; NaN when none.
    gap_threshold : float
        A forward step longer than this is a gap [s]: `GAP_STEPS` times the median forward step of the first batch.
    gaps, gap_row : int
        Gaps; the row after the first.
    gap_longest, gap_total : float
        Longest, and sum of all [s]; 0 when none.
    sp_bad, pv_bad, op_bad : int
        Rows in which the signal is not a number; for an OP that is not recorded `op_bad` is 0.
    sp_bad_row, pv_bad_row, op_bad_row : int
        The first such row.
    not_auto, bad_quality : int
        Rows with flag bit 1, with flag bit 2.
    at_low, at_high : int
        Rows with flag bit 4, with flag bit 8, or whose OP is at or beyond the limit where limits are known.
    sp_changes, pv_unchanged, op_unchanged : int
        Pairs of numbers in which SP differs, PV is the same to the bit, OP is the same to the bit.
    still : int
        Pairs in which SP, PV and (where recorded) OP are all the same to the bit, while SP and PV differ.
    sp_min, sp_max, pv_min, pv_max, op_min, op_max : float
        Range over the numbers; NaN when there are none.
    """

    rows: int
    t_bad: int = 0
    repeated: int = 0
    repeated_row: int = -1
    reversed: int = 0
    reversed_row: int = -1
    reversed_from: float = math.nan
    reversed_to: float = math.nan
    gap_threshold: float = math.inf
    gaps: int = 0
    gap_row: int = -1
    gap_longest: float = 0.0
    gap_total: float = 0.0
    sp_bad: int = 0
    pv_bad: int = 0
    op_bad: int = 0
    sp_bad_row: int = -1
    pv_bad_row: int = -1
    op_bad_row: int = -1
    not_auto: int = 0
    bad_quality: int = 0
    at_low: int = 0
    at_high: int = 0
    sp_changes: int = 0
    pv_unchanged: int = 0
    op_unchanged: int = 0
    still: int = 0
    sp_min: float = math.nan
    sp_max: float = math.nan
    pv_min: float = math.nan
    pv_max: float = math.nan
    op_min: float = math.nan
    op_max: float = math.nan


@dataclass(frozen=True, slots=True)
class InspectionSample:
    """The first rows of a recording (at most half a million), as they came.

    Attributes
    ----------
    t : float64[n]
        Time [s].
    sp : float64[n] | None
        Setpoint [PV unit]; None where it is not recorded, and then nothing is told of the controller.
    pv : float64[n]
        Measurement [PV unit].
    op : float64[n] | None
        Controller output [OP unit].
    flags : uint8[n] | None
        Bits 1 not auto, 2 bad, 4 at the low, 8 at the high limit.
    """

    t: Floats
    sp: Floats | None
    pv: Floats
    op: Floats | None = None
    flags: NDArray[np.uint8] | None = None


def inspect(
    sample: InspectionSample,
    census: Census,
    *,
    k: float | None = None,
    ti: float | None = None,
    td: float | None = None,
    identification: Identification | None = None,
    pv_unit: str = "PV units",
    op_unit: str = "OP units",
    t0: datetime | None = None,
    first_row: int = 2,
    known: Sequence[Finding] = (),
) -> list[Finding]:
    """List what is wrong with a recording, gravest first.

    Parameters
    ----------
    sample : InspectionSample
        Rows to look at closely.
    census : Census
        Counts over all rows.
    k : float | None
        Controller gain used, signed [OP unit per PV unit].
    ti : float | None
        Integral time used [s].
    td : float | None
        Derivative time used [s], 0 for a PI controller.
    identification : Identification | None
        What the recording itself says of K, Ti and Td; compared with `k`, `ti` and `td` when usable.
    pv_unit, op_unit : str
        Units for the texts.
    t0 : datetime | None
        Time of t = 0, to name times as a person knows them.
    first_row : int
        Number of the first data row as its reader sees it (2 below a header).
    known : sequence of Finding
        What was found when the recording was opened.

    Returns
    -------
    list[Finding]
        Empty for a healthy recording.  Never raises on data.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(50.0)
    >>> still = np.full(50, 20.0)
    >>> found = inspect(InspectionSample(t, still + 1, still, still), Census(50, op_min=20, op_max=20), op_unit="%")
    >>> found[0].code, found[0].severity
    ('op_constant', 'refuse')
    >>> found[0].text
    'OP stays at 20 % over the whole recording: take a time in which the controller works, or check the OP column'
    """
    found = _glapp.inspect(
        column(sample.t),
        column(sample.sp),
        column(sample.pv),
        column(sample.op),
        column(sample.flags, np.uint8),
        census,
        (k, ti, td),
        identification,
    )
    return told(found, known, pv_unit=pv_unit, op_unit=op_unit, t0=t0, first_row=first_row)


def told(
    found: Sequence[dict[str, Any]],
    known: Sequence[Finding] = (),
    *,
    pv_unit: str = "PV units",
    op_unit: str = "OP units",
    t0: datetime | None = None,
    first_row: int = 2,
) -> list[Finding]:
    """Put findings of the core into words and list them behind those that are known, gravest first."""
    reader = _Reader(pv_unit, op_unit, t0, first_row)
    findings = [*known, *(reader.finding(one) for one in found)]
    # What hangs on an assumed gain is known last.
    grave = ("refuse", "warning", "info")
    return sorted(findings, key=lambda one: (one.code == "kp_assumed", grave.index(one.severity)))


def assumed_time(column: str, first: str, step: float | None, calendar: str, days: str, sure: bool) -> Finding:
    """Say what the numbers of a time column were taken for, where that was not plain.

    Parameters
    ----------
    column, first : str
        Its name, and its first value as it is written.
    step : float | None
        Ordinary step between its numbers; None where they do not step.
    calendar, days : str
        The `time_format` that reads them as days, and what they are then.
    sure : bool
        Whether they were read so; else as seconds.

    Examples
    --------
    >>> assumed_time("t", "45000.5", 1.0, "excel", "a spreadsheet's day numbers, 2023-03-15 12:00:00", False).severity
    'warning'
    """
    return _Reader(days=days).finding(_glapp.assumed_time(column, first, step, calendar, sure))


def own_times(held: str, pv_rows: int, rows: int) -> Finding:
    """Say how signals that were recorded each at times of its own were brought to common rows.

    Parameters
    ----------
    held : str
        Those that keep their last value until the next.
    pv_rows, rows : int
        Values of PV, and the rows that came of them: where there are more, PV is interpolated.

    Examples
    --------
    >>> own_times("SP, OP", 100, 100).text
    'each signal has times of its own: the rows are those of PV, and SP, OP keep the last value until the next'
    """
    return _Reader().finding(_glapp.own_times(held, pv_rows, rows))


def noise_sigma(pv: Floats) -> float | None:
    """Estimate the standard deviation of PV's fast noise [PV unit].

    The j-th difference of white noise of variance s² has variance s²·C(2j, j), and takes away any movement that is a
    polynomial of degree j - 1 over j + 1 samples.  From each of j = 0 .. 4 comes one robust value (median absolute
    deviation / 0.6745); the least is returned, since the loop's own movement can only add.

    Bias: an upper bound where PV's own movement fills only a few samples (sampling too coarse); too low for noise that
    a filter or a historian has smoothed.  Of a quantised PV at least one step / sqrt(12).  Samples that repeat the last
    value for long (held by a historian) are left out.

    Parameters
    ----------
    pv : float64[n]
        Samples at an even step [PV unit]; NaN where missing.

    Returns
    -------
    float | None
        None where fewer than 20 differences are left.

    Examples
    --------
    >>> import numpy as np
    >>> slow = 10 * np.sin(np.arange(5000) / 50)
    >>> round(noise_sigma(slow + np.random.default_rng(1).normal(0, 0.2, 5000)), 2)
    0.2
    """
    return _glapp.noise_sigma(column(pv))


@dataclass(frozen=True, slots=True)
class _Reader(Formatter):
    """The person who reads the sentences: units, calendar and row numbers.

    Beside the usual formats of numbers there are `seconds`, `share`, `row` and `size` (without its sign, three digits).
    """

    pv_unit: str = "PV units"
    op_unit: str = "OP units"
    t0: datetime | None = None
    first_row: int = 2
    days: str = ""
    """What the numbers of a time column are as days."""

    def finding(self, found: dict[str, Any]) -> Finding:
        """Put a finding into words, with what it tells beyond its evidence."""
        code, severity, evidence = found["code"], found["severity"], found["evidence"]
        if code == "time_reversed":
            evidence = evidence | {name: self.time(float(evidence[name])) for name in ("from", "to")}
        numbers = {**evidence, **found["numbers"], "severity": severity, "days": self.days}
        numbers |= {"pv_unit": self.pv_unit, "op_unit": self.op_unit}
        numbers |= _more(code, numbers)
        variant = _VARIANTS[code](numbers) if code in _VARIANTS else ""
        sentence = SENTENCES.get(f"{code} {variant}") or SENTENCES[code]
        return Finding(code, severity, self.vformat(sentence, (), numbers), evidence)

    def format_field(self, value: Any, format_spec: str) -> str:
        match format_spec:
            case "seconds":
                return _seconds(value)
            case "share":
                return _percent(value)
            case "size":
                return f"{abs(value):.3g}"
            case "row":
                return f"row {int(value) + self.first_row}"
            case "rows":
                return ", ".join(f"row {int(row) + self.first_row}" for row in value.split())
            case "and":
                return str(value).replace(",", " and")
        return format(value, format_spec)

    def time(self, t: float) -> str:
        try:
            return f"{t:.10g} s" if self.t0 is None else (self.t0 + timedelta(seconds=t)).isoformat(sep=" ")
        except (OverflowError, ValueError):  # beyond the calendar
            return f"{t:.10g} s"


def _seconds(duration: float) -> str:
    return f"{duration:.3g} s" if duration < 1000 else f"{duration:.0f} s"


def _percent(share: float) -> str:
    return f"{share:.0%}" if share >= 0.095 or share == 0 else f"{100 * share:.2g} %".replace(" %", "%")


def _more(code: str, n: Numbers) -> dict[str, str]:
    """What a sentence tells beyond the numbers of its finding."""
    match code:
        case "time_assumed":
            return {"steps": f"steps by {n['step']:.6g}" if n["step"] else "does not step"}
        case "spikes" | "shifts":
            return {"more": " and more" if n["count"] > len(n["rows"].split()) else ""}
    return {}


Numbers = Mapping[str, Any]

_GAIN = "{op_unit} per {pv_unit}"
_BEGINS = "column '{column}' begins at {first} and {steps}: read as "
_REVERSED = "time runs backwards in {count} of {of} rows, first at {first_row:row}, from {from} to {to}: "
_REPEATED = "{count} of {of} rows repeat the time before them, first {first_row:row}: "
_STAND_ALONE = (
    "alone, off those before and after ({rows:rows}{more}): the fit leaves them out, but the controller answers them, "
    "so look at the transmitter"
)
_WINDS = (
    " SP for {lasted_s:seconds} while OP winds from {op_from:.3g} to {op_to:.3g} {op_unit}, so PV does not answer OP "
    "and nothing can be estimated: take a time in which the loop controls"
)

SENTENCES: dict[str, str] = {
    "time_assumed info": _BEGINS + "{days}; if it counts seconds, write time_format = 'seconds'",
    "time_assumed": _BEGINS + "seconds; if these are {days}, write time_format = '{calendar}'",
    "own_times joined": "each signal has times of its own, and OP many more than PV: {held} keep the last value "
    "until the next, and {pv_rows} values of PV are joined by straight lines over {rows} rows; record PV as often as "
    "OP",
    "own_times": "each signal has times of its own: the rows are those of PV, and {held} keep the last value until "
    "the next",
    "too_few_rows": "the recording has {rows} rows, from which nothing can be told: take hours, not moments",
    "time_missing": "{rows} of {of} rows have no time and are not used: check the time column",
    "time_reversed newest_first": _REVERSED + "the newest row comes first; sort the rows by time, the oldest first",
    "time_reversed clock_set_back": _REVERSED
    + "the clock seems to have been set back an hour: export in UTC or name the time zone",
    "time_reversed unsorted": _REVERSED + "sort the rows by time, or export in UTC if this is the end of summer time",
    "time_repeated refuse": _REPEATED + "every time is the same; check the time column",
    "time_repeated": _REPEATED + "remove the doubles if they are many",
    "gaps": "gaps longer than {threshold_s:seconds}: {count}, {total_s:seconds} in all, the longest "
    "{longest_s:seconds}, the first before {first_row:row}; no half-period is taken across one: ask for raw values if "
    "they are many",
    "not_a_number all": "{signal} is not a number in any of {of} rows: check the column or tag",
    "not_a_number": "{signal} is not a number in {rows} of {of} rows ({share:share}), first {first_row:row}: each "
    "ends a half-period; ask the historian for good values",
    "bad_quality": "the quality is not good in {share:share} of the rows, which are not used: mend the signal, or "
    "check which quality codes mean good",
    "not_auto": "the loop is not in auto in {share:share} of the rows, which are not used: take a time in auto, or "
    "check which mode values mean auto",
    "at_limit": "OP is at its low limit in {at_low:share} and at its high limit in {at_high:share} of the rows, which "
    "are not used: take a time in which the valve has room to move",
    "no_sp": "SP is not recorded: the gap is fitted from OP and PV, and a step test can be read; zero crossings, "
    "the controller's K and Ti and the width that a PLC would show need SP",
    "no_op": "OP is not recorded, so K and Ti must be given, and saturation is seen only through limit flags: add OP",
    "op_constant": "OP stays at {op:.4g} {op_unit} over the whole recording: take a time in which the controller "
    "works, or check the OP column",
    "pv_constant": "PV stays at {pv:.4g} {pv_unit} over the whole recording: check the PV column and the transmitter",
    "same_signal": "{signals:and} are the same signal: check which columns or tags were taken",
    "winding_up below": "PV stays {error:size} {pv_unit} below" + _WINDS,
    "winding_up": "PV stays {error:size} {pv_unit} above" + _WINDS,
    "cascade_slave": "SP moves at {share:share} of the samples, as in a cascade slave: the method works in a slave, "
    "but half-periods in which SP moves more than PV are rejected (5.5); few may be left",
    "sampling slow": "a sample every {h_s:seconds} is slower than Ti {ti_s:seconds}, so the error between the samples "
    "is unknown: record at least every {enough_s:seconds}",
    "sampling": "a sample every {h_s:seconds} is coarse against Ti {ti_s:seconds}, so widths are rough: record at "
    "least every {enough_s:seconds}",
    "frozen": "in {share:share} of the recording SP, PV and OP all repeat their last value although PV is off SP, so "
    "the historian stood still, not the loop: export raw values, or another time",
    "compressed_pv held": "PV repeats its last value in {held:share} of the recording while OP moves on, as a "
    "historian's compression leaves it: export uncompressed values",
    "compressed_pv": "{straight:share} of PV's samples lie on exact straight lines, as interpolation between a "
    "historian's compressed values leaves them: export raw values",
    "spikes one": "1 sample of PV stands " + _STAND_ALONE,
    "spikes": "{count} samples of PV stand " + _STAND_ALONE,
    "shifts": "PV goes to another level from one row to the next ({rows:rows}{more}), as no process does: a "
    "transmitter was set anew or the recorder's scale changed; the fit begins anew there, the zero crossings do not",
    "quantised_pv": "PV comes in steps of {step:.3g} {pv_unit}, {levels} within its range, so small errors and "
    "crossings are lost: record with more digits",
    "quantised_op": "OP comes in steps of {step:.3g} {op_unit}, {levels} within its range, so no width below a few "
    "steps can be told: record with more digits",
    "sign": f"the settings say K {{k_given:.3g}} {_GAIN} but OP moves as with K {{k_seen:.3g}} {_GAIN}: check the "
    "action, direct (K < 0) or reverse (K > 0), or the columns",
    "settings K": f"the settings say {{parameter}} {{given:.3g}} {_GAIN} but OP moves as with {{seen:.3g}} {_GAIN} "
    f"({{low:.3g}} to {{high:.3g}} {_GAIN}): check the controller's form and units",
    "settings": "the settings say {parameter} {given:.3g} s but OP moves as with {seen:.3g} s ({low:.3g} to "
    "{high:.3g} s): check the controller's form and units",
    "exchanged": "OP and PV seem to be exchanged: PV moves with OP as the output of a PI or PID controller with Ti "
    "{ti_s:seconds} does ({r2_exchanged:share} explained), OP with PV as that of none: check which columns were taken "
    "(--pv and --op, columns.pv and columns.op)",
    "error_gap": "OP rests while PV is within {gap:.3g} {pv_unit} of SP and moves beyond, so the controller has an "
    "error gap, whose cycle looks like backlash: write error_gap in the settings, or record with it set to 0",
    "output_dead_band": "OP rests in {rests:share} of the steps and otherwise jumps by at least {jump:.3g} {op_unit}, "
    "so the controller has an output dead band, which adds to the valve's: write output_dead_band in the settings",
    "sinusoidal": "the error is a clean sinusoid of period {period_s:seconds} ({spectral_share:share} of its power at "
    f"one frequency, peak to mean {{peak_to_mean:.2f}} against {math.pi / 2:.2f}; half-periods of {{half_s:seconds}}, "
    "shorter than 5 Ti, {limit_s:seconds}): a linear oscillation, not backlash, makes the loop swing, and a gap "
    "beside it does not show; look at the tuning or for a disturbance from elsewhere",
    "kp_assumed": "Kp is not given and taken as 1.5 %/%, that is {kp:size} {pv_unit} per {op_unit}: it takes "
    "{kp_part:.3g} {op_unit} off a width of {free:.3g} {op_unit}; give kp",
}
"""A finding in one sentence, by its code and, where it has several, its variant; formats as `_Reader` knows them."""

_VARIANTS: dict[str, Callable[[Numbers], str]] = {
    "time_assumed": lambda n: n["severity"],
    "own_times": lambda n: "" if n["rows"] == n["pv_rows"] else "joined",
    "time_reversed": lambda n: n["looks_like"],
    "time_repeated": lambda n: n["severity"],
    "not_a_number": lambda n: "all" if n["rows"] == n["of"] else "",
    "winding_up": lambda n: "below" if n["error"] > 0 else "",
    "sampling": lambda n: "slow" if n["ratio"] > 1.0 else "",
    "compressed_pv": lambda n: n["looks_like"],
    "spikes": lambda n: "one" if n["count"] == 1 else "",
    "settings": lambda n: n["parameter"],
}
"""Which variant of a sentence its numbers ask for; one that has no sentence of its own has the plain one."""
