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
class _Reader:
    """The person who reads the sentences: units, calendar and row numbers."""

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
        numbers = {**evidence, **found["numbers"], "severity": severity}
        return Finding(code, severity, _SENTENCES[code](numbers, self), evidence)

    def row(self, row: int) -> str:
        return f"row {row + self.first_row}"

    def time(self, t: float) -> str:
        try:
            return f"{t:.10g} s" if self.t0 is None else (self.t0 + timedelta(seconds=t)).isoformat(sep=" ")
        except (OverflowError, ValueError):  # beyond the calendar
            return f"{t:.10g} s"


def _seconds(duration: float) -> str:
    return f"{duration:.3g} s" if duration < 1000 else f"{duration:.0f} s"


def _percent(share: float) -> str:
    return f"{share:.0%}" if share >= 0.095 or share == 0 else f"{100 * share:.2g} %".replace(" %", "%")


Numbers = Mapping[str, Any]


def _time_assumed(n: Numbers, reader: _Reader) -> str:
    steps = f"steps by {n['step']:.6g}" if n["step"] else "does not step"
    begins = f"column '{n['column']}' begins at {n['first']} and {steps}"
    if n["severity"] == "info":
        return f"{begins}: read as {reader.days}; if it counts seconds, write time_format = 'seconds'"
    return f"{begins}: read as seconds; if these are {reader.days}, write time_format = '{n['calendar']}'"


def _own_times(n: Numbers, _: _Reader) -> str:
    held = f"{n['held']} keep the last value until the next"
    if n["rows"] == n["pv_rows"]:
        return f"each signal has times of its own: the rows are those of PV, and {held}"
    return (
        f"each signal has times of its own, and OP many more than PV: {held}, and {n['pv_rows']} values of PV are "
        f"joined by straight lines over {n['rows']} rows; record PV as often as OP"
    )


def _too_few_rows(n: Numbers, _: _Reader) -> str:
    return f"the recording has {n['rows']} rows, from which nothing can be told: take hours, not moments"


def _time_missing(n: Numbers, _: _Reader) -> str:
    return f"{n['rows']} of {n['of']} rows have no time and are not used: check the time column"


def _time_reversed(n: Numbers, reader: _Reader) -> str:
    hint = {
        "newest_first": "the newest row comes first; sort the rows by time, the oldest first",
        "clock_set_back": "the clock seems to have been set back an hour: export in UTC or name the time zone",
        "unsorted": "sort the rows by time, or export in UTC if this is the end of summer time",
    }[n["looks_like"]]
    return (
        f"time runs backwards in {n['count']} of {n['of']} rows, first at {reader.row(n['first_row'])}, from "
        f"{n['from']} to {n['to']}: {hint}"
    )


def _time_repeated(n: Numbers, reader: _Reader) -> str:
    useless = n["severity"] == "refuse"
    hint = "every time is the same; check the time column" if useless else "remove the doubles if they are many"
    return f"{n['count']} of {n['of']} rows repeat the time before them, first {reader.row(n['first_row'])}: {hint}"


def _gaps(n: Numbers, reader: _Reader) -> str:
    return (
        f"gaps longer than {_seconds(n['threshold_s'])}: {n['count']}, {_seconds(n['total_s'])} in all, the longest "
        f"{_seconds(n['longest_s'])}, the first before {reader.row(n['first_row'])}; no half-period is taken across "
        "one: ask for raw values if they are many"
    )


def _not_a_number(n: Numbers, reader: _Reader) -> str:
    if n["rows"] == n["of"]:
        return f"{n['signal']} is not a number in any of {n['of']} rows: check the column or tag"
    return (
        f"{n['signal']} is not a number in {n['rows']} of {n['of']} rows ({_percent(n['share'])}), first "
        f"{reader.row(n['first_row'])}: each ends a half-period; ask the historian for good values"
    )


def _bad_quality(n: Numbers, _: _Reader) -> str:
    return (
        f"the quality is not good in {_percent(n['share'])} of the rows, which are not used: mend the signal, "
        "or check which quality codes mean good"
    )


def _not_auto(n: Numbers, _: _Reader) -> str:
    return (
        f"the loop is not in auto in {_percent(n['share'])} of the rows, which are not used: "
        "take a time in auto, or check which mode values mean auto"
    )


def _at_limit(n: Numbers, _: _Reader) -> str:
    return (
        f"OP is at its low limit in {_percent(n['at_low'])} and at its high limit in {_percent(n['at_high'])} of the "
        "rows, which are not used: take a time in which the valve has room to move"
    )


def _no_op(_: Numbers, __: _Reader) -> str:
    return "OP is not recorded, so K and Ti must be given, and saturation is seen only through limit flags: add OP"


def _no_sp(n: Numbers, _: _Reader) -> str:
    return (
        "SP is not recorded: the gap is fitted from OP and PV, and a test by hand can be read; zero crossings, the "
        "controller's K and Ti and the width that a PLC would show need SP"
    )


def _op_constant(n: Numbers, reader: _Reader) -> str:
    return (
        f"OP stays at {n['op']:.4g} {reader.op_unit} over the whole recording: "
        "take a time in which the controller works, or check the OP column"
    )


def _pv_constant(n: Numbers, reader: _Reader) -> str:
    return (
        f"PV stays at {n['pv']:.4g} {reader.pv_unit} over the whole recording: check the PV column and the transmitter"
    )


def _same_signal(n: Numbers, _: _Reader) -> str:
    return f"{n['signals'].replace(',', ' and')} are the same signal: check which columns or tags were taken"


def _winding_up(n: Numbers, reader: _Reader) -> str:
    side = "below" if n["error"] > 0 else "above"
    return (
        f"PV stays {abs(n['error']):.3g} {reader.pv_unit} {side} SP for {_seconds(n['lasted_s'])} while OP winds from "
        f"{n['op_from']:.3g} to {n['op_to']:.3g} {reader.op_unit}, so PV does not answer OP and nothing can be "
        "estimated: take a time in which the loop controls"
    )


def _cascade_slave(n: Numbers, _: _Reader) -> str:
    return (
        f"SP moves at {_percent(n['share'])} of the samples, as in a cascade slave: the method works in a slave, but "
        "half-periods in which SP moves more than PV are rejected (5.5); few may be left"
    )


def _sampling(n: Numbers, _: _Reader) -> str:
    step, ti = _seconds(n["h_s"]), _seconds(n["ti_s"])
    told = (
        f"a sample every {step} is slower than Ti {ti}, so the error between the samples is unknown"
        if n["ratio"] > 1.0
        else f"a sample every {step} is coarse against Ti {ti}, so widths are rough"
    )
    return f"{told}: record at least every {_seconds(n['enough_s'])}"


def _spikes(n: Numbers, reader: _Reader) -> str:
    named = [reader.row(int(row)) for row in n["rows"].split()]
    rows, more = ", ".join(named), " and more" if n["count"] > len(named) else ""
    samples = "1 sample of PV stands" if n["count"] == 1 else f"{n['count']} samples of PV stand"
    return (
        f"{samples} alone, off those before and after ({rows}{more}): the fit leaves them out, but "
        "the controller answers them, so look at the transmitter"
    )


def _exchanged(n: Numbers, _: _Reader) -> str:
    return (
        f"OP and PV seem to be exchanged: PV moves with OP as the output of a PI or PID controller with Ti "
        f"{_seconds(n['ti_s'])} does ({_percent(n['r2_exchanged'])} explained), OP with PV as that of none: check "
        "which columns were taken (--pv and --op, columns.pv and columns.op)"
    )


def _frozen(n: Numbers, _: _Reader) -> str:
    return (
        f"in {_percent(n['share'])} of the recording SP, PV and OP all repeat their last value although PV is off SP, "
        "so the historian stood still, not the loop: export raw values, or another time"
    )


def _compressed_pv(n: Numbers, _: _Reader) -> str:
    if n["looks_like"] == "held":
        return (
            f"PV repeats its last value in {_percent(n['held'])} of the recording while OP moves on, as a historian's "
            "compression leaves it: export uncompressed values"
        )
    return (
        f"{_percent(n['straight'])} of PV's samples lie on exact straight lines, as interpolation between a "
        "historian's compressed values leaves them: export raw values"
    )


def _quantised_pv(n: Numbers, reader: _Reader) -> str:
    return (
        f"PV comes in steps of {n['step']:.3g} {reader.pv_unit}, {n['levels']} within its range, so small errors and "
        "crossings are lost: record with more digits"
    )


def _quantised_op(n: Numbers, reader: _Reader) -> str:
    return (
        f"OP comes in steps of {n['step']:.3g} {reader.op_unit}, {n['levels']} within its range, so no width below a "
        "few steps can be told: record with more digits"
    )


def _sign(n: Numbers, reader: _Reader) -> str:
    gain = f"{reader.op_unit} per {reader.pv_unit}"
    return (
        f"the settings say K {n['k_given']:.3g} {gain} but OP moves as with K {n['k_seen']:.3g} {gain}: "
        "check the action, direct (K < 0) or reverse (K > 0), or the columns"
    )


def _settings(n: Numbers, reader: _Reader) -> str:
    unit = f"{reader.op_unit} per {reader.pv_unit}" if n["parameter"] == "K" else "s"
    return (
        f"the settings say {n['parameter']} {n['given']:.3g} {unit} but OP moves as with {n['seen']:.3g} {unit} "
        f"({n['low']:.3g} to {n['high']:.3g} {unit}): check the controller's form and units"
    )


def _error_gap(n: Numbers, reader: _Reader) -> str:
    return (
        f"OP rests while PV is within {n['gap']:.3g} {reader.pv_unit} of SP and moves beyond, so the controller has an "
        "error gap, whose cycle looks like backlash: write error_gap in the settings, or record with it set to 0"
    )


def _output_dead_band(n: Numbers, reader: _Reader) -> str:
    return (
        f"OP rests in {_percent(n['rests'])} of the steps and otherwise jumps by at least {n['jump']:.3g} "
        f"{reader.op_unit}, so the controller has an output dead band, which adds to the valve's: write "
        "output_dead_band in the settings"
    )


def _sinusoidal(n: Numbers, _: _Reader) -> str:
    return (
        f"the error is a clean sinusoid of period {_seconds(n['period_s'])} ({_percent(n['spectral_share'])} of its "
        f"power at one frequency, peak to mean {n['peak_to_mean']:.2f} against {math.pi / 2:.2f}; half-periods of "
        f"{_seconds(n['half_s'])}, shorter than 5 Ti, {_seconds(n['limit_s'])}): "
        "a linear oscillation, not backlash, makes the loop swing, and a gap beside it does not show; look at the "
        "tuning or for a disturbance from elsewhere"
    )


def _kp_assumed(n: Numbers, reader: _Reader) -> str:
    return (
        f"Kp is not given and taken as 1.5 %/%, that is {abs(n['kp']):.3g} {reader.pv_unit} per {reader.op_unit}: it "
        f"takes {n['kp_part']:.3g} {reader.op_unit} off a width of {n['free']:.3g} {reader.op_unit}; give kp"
    )


_SENTENCES: dict[str, Callable[[Numbers, _Reader], str]] = {
    "time_assumed": _time_assumed,
    "own_times": _own_times,
    "too_few_rows": _too_few_rows,
    "time_missing": _time_missing,
    "time_reversed": _time_reversed,
    "time_repeated": _time_repeated,
    "gaps": _gaps,
    "not_a_number": _not_a_number,
    "bad_quality": _bad_quality,
    "not_auto": _not_auto,
    "at_limit": _at_limit,
    "no_sp": _no_sp,
    "no_op": _no_op,
    "op_constant": _op_constant,
    "pv_constant": _pv_constant,
    "same_signal": _same_signal,
    "winding_up": _winding_up,
    "cascade_slave": _cascade_slave,
    "sampling": _sampling,
    "frozen": _frozen,
    "compressed_pv": _compressed_pv,
    "spikes": _spikes,
    "quantised_pv": _quantised_pv,
    "quantised_op": _quantised_op,
    "sign": _sign,
    "settings": _settings,
    "exchanged": _exchanged,
    "error_gap": _error_gap,
    "output_dead_band": _output_dead_band,
    "sinusoidal": _sinusoidal,
    "kp_assumed": _kp_assumed,
}
