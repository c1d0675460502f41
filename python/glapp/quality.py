"""Findings on a recording, made before anything is estimated from it.

Two sources of evidence: `DataStatistics`, counts over every row, and an `InspectionSample`, the rows kept in memory.
Each `Finding` names one fault, its numbers and what to do; `docs/quality.md` lists them all.  Codes, severities,
numbers and sentences come from `crates/analysis`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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

DATA_GAP_STEPS: float = _glapp.DATA_GAP_STEPS
"""A step longer than this many ordinary ones is a gap."""


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
class DataStatistics:
    """Counts over all rows of a recording, each a running quantity, gathered in one pass in constant memory.

    Rows count from 0 over the whole recording; -1 means "none".  A *pair* is a row and the one before it, also across
    batches.  Infinite counts as a non-number everywhere.

    - `rows`: rows.
    - `t_bad`: rows whose time is not a number; they take part in no pair below that needs times.
    - `repeated`, `repeated_row`: pairs with the same time; the later row of the first.
    - `reversed`, `reversed_row`: pairs whose later row has the earlier time; the later row of the first.
    - `reversed_from`, `reversed_to`: the two times of that first pair [s since t0]; NaN when none.
    - `gap_threshold`: a longer forward step is a gap in the data [s]: `DATA_GAP_STEPS` times the median forward step
      of the first batch.
    - `gaps`, `gap_row`: gaps; the row after the first.
    - `gap_longest`, `gap_total`: longest, and sum of all [s]; 0 when none.
    - `sp_bad`, `pv_bad`, `op_bad`: rows in which the signal is not a number, those apart whose quality was said to be
      bad; for an OP that is not recorded `op_bad` is 0.
    - `sp_bad_row`, `pv_bad_row`, `op_bad_row`: the first such row.
    - `sp_marked`, `pv_marked`, `op_marked`: rows in which the signal's quality was said to be bad; a row as a whole
      counts for PV.
    - `sp_marked_row`, `pv_marked_row`, `op_marked_row`: the first such row.
    - `not_auto`: rows with flag bit 1.
    - `at_low`, `at_high`: rows with flag bit 4, with flag bit 8, or whose OP is at or beyond the limit where limits are
      known.
    - `sp_changes`, `pv_unchanged`, `op_unchanged`: pairs of numbers in which SP differs, PV is the same to the bit, OP
      is the same to the bit.
    - `still`: pairs in which SP, PV and (where recorded) OP are all the same to the bit, while SP and PV differ.
    - `sp_min`, `sp_max`, `pv_min`, `pv_max`, `op_min`, `op_max`: range over the numbers; NaN when there are none.
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
    sp_marked: int = 0
    pv_marked: int = 0
    op_marked: int = 0
    sp_marked_row: int = -1
    pv_marked_row: int = -1
    op_marked_row: int = -1
    not_auto: int = 0
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

    - `t` (float64[n]): time [s].
    - `sp` (float64[n] | None): setpoint [PV unit]; None where it is not recorded, and then nothing is said of the
      controller.
    - `pv` (float64[n]): measurement [PV unit].
    - `op` (float64[n] | None): controller output [OP unit].
    - `flags` (uint8[n] | None): bits 1 not auto, 2 bad, 4 at the low, 8 at the high limit.
    """

    t: Floats
    sp: Floats | None
    pv: Floats
    op: Floats | None = None
    flags: NDArray[np.uint8] | None = None


def inspect(
    sample: InspectionSample,
    statistics: DataStatistics,
    *,
    k: float | None = None,
    ti: float | None = None,
    td: float | None = None,
    identification: Identification | None = None,
    pv_span: tuple[float, float] | None = None,
    op_span: tuple[float, float] | None = None,
    pv_unit: str = "PV units",
    op_unit: str = "OP units",
    t0: datetime | None = None,
    first_row: int = 2,
    known: Sequence[Finding] = (),
) -> list[Finding]:
    """List the findings on a recording, gravest first.

    - `sample`: rows to look at closely.
    - `statistics`: counts over all rows.
    - `k`: controller gain used, signed [OP unit per PV unit].
    - `ti`: integral time used [s].
    - `td`: derivative time used [s], 0 for a PI controller.
    - `identification`: K, Ti and Td as identified from the recording; compared with `k`, `ti` and `td` when usable.
    - `pv_span`, `op_span`: ranges of the instruments, where they are known [PV unit, OP unit].
    - `pv_unit`, `op_unit`: units for the texts.
    - `t0`: time of t = 0, to name times as a person knows them.
    - `first_row`: number of the first data row as its reader sees it (2 below a header).
    - `known`: what was found when the recording was opened.

    Returns: Empty for a healthy recording.  Never raises on data.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(50.0)
    >>> still = np.full(50, 20.0)
    >>> sample, rows = InspectionSample(t, still + 1, still, still), DataStatistics(50, op_min=20, op_max=20)
    >>> found = inspect(sample, rows, op_unit="%")
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
        statistics,
        (k, ti, td),
        identification,
        pv_span,
        op_span,
    )
    return findings_from_core(found, known, pv_unit=pv_unit, op_unit=op_unit, t0=t0, first_row=first_row)


def findings_from_core(
    found: Sequence[dict[str, Any]],
    known: Sequence[Finding] = (),
    *,
    pv_unit: str = "PV units",
    op_unit: str = "OP units",
    t0: datetime | None = None,
    first_row: int = 2,
) -> list[Finding]:
    """Put findings of the core into words and list them behind those that are known, gravest first."""
    findings = [*known, *(_finding(finding, pv_unit, op_unit, t0, first_row) for finding in found)]
    # A finding that rests on an assumed gain comes after all others.
    grave = ("refuse", "warning", "info")
    return sorted(findings, key=lambda finding: (finding.code == "kp_assumed", grave.index(finding.severity)))


def assumed_time(column: str, first: str, step: float | None, calendar: str, days: str, sure: bool) -> Finding:
    """Report the assumed unit of a time column, where it was not plain.

    - `column`, `first`: its name, and its first value as it is written.
    - `step`: ordinary step between its numbers; None where they do not step.
    - `calendar`, `days`: the `time_format` that reads them as days, and what they are then.
    - `sure`: whether they were read so; else as seconds.

    Examples
    --------
    >>> assumed_time("t", "45000.5", 1.0, "excel", "a spreadsheet's day numbers, 2023-03-15 12:00:00", False).severity
    'warning'
    """
    return _finding(_glapp.assumed_time(column, first, step, calendar, sure), days=days)


def own_times(held: str, pv_rows: int, rows: int) -> Finding:
    """Say how signals that were recorded each at times of its own were brought to common rows.

    - `held`: those that keep their last value until the next.
    - `pv_rows`, `rows`: values of PV, and the rows that came of them: where there are more, PV is interpolated.

    Examples
    --------
    >>> own_times("SP, OP", 100, 100).text
    'each signal has times of its own: the rows are those of PV, and SP, OP keep the last value until the next'
    """
    return _finding(_glapp.own_times(held, pv_rows, rows))


def newest_first(column: str) -> Finding:
    """Say that the newest row came first, and that the rows were taken from the last to the first.

    - `column`: name of the column of times.

    Examples
    --------
    >>> newest_first("Time").text.split(":")[0]
    "the newest row comes first in column 'Time', so the rows were taken from the last to the first"
    """
    return _finding(_glapp.newest_first(column))


def setting_unused(setting: str, value: str, column: str | None = None) -> Finding:
    """Say that a setting is given which the recording has no use for.

    - `setting`: `sample_time` in addition to a column of times, or `auto_values` without a column of the mode.
    - `value`: what is given, as a loops.toml has it.
    - `column`: name of the column of times.

    Examples
    --------
    >>> setting_unused("sample_time", "2.0", "Time").text.split(":")[0]
    "sample_time = 2.0 is not used, since column 'Time' has the times"
    """
    return _finding(_glapp.setting_unused(setting, value, column))


def noise_sigma(pv: Floats) -> float | None:
    """Estimate the standard deviation of PV's fast noise [PV unit].

    The j-th difference of white noise of variance s² has variance s²·C(2j, j), and takes away any movement that is a
    polynomial of degree j - 1 over j + 1 samples.  From each of j = 0 .. 4 comes one robust value (median absolute
    deviation / 0.6745); the least is returned, since the loop's own movement can only add.

    Bias: an upper bound where PV's own movement fills only a few samples (sampling too coarse); too low for noise that
    a filter or a historian has smoothed.  Of a quantised PV at least one step / sqrt(12).  Samples that repeat the last
    value for long (held by a historian) are left out.

    - `pv` (float64[n]): samples at an even step [PV unit]; NaN where missing.

    Returns: None where fewer than 20 differences are left.

    Examples
    --------
    >>> import numpy as np
    >>> slow = 10 * np.sin(np.arange(5000) / 50)
    >>> round(noise_sigma(slow + np.random.default_rng(1).normal(0, 0.2, 5000)), 2)
    0.2
    """
    return _glapp.noise_sigma(column(pv))


def _finding(
    found: dict[str, Any],
    pv_unit: str = "PV units",
    op_unit: str = "OP units",
    t0: datetime | None = None,
    first_row: int = 2,
    days: str = "",
) -> Finding:
    """Put a finding of the core into words; `days`: what the numbers of a time column are as days."""
    code, severity, evidence = found["code"], found["severity"], found["evidence"]
    if code == "time_reversed":
        evidence = evidence | {name: _time(float(evidence[name]), t0) for name in ("from", "to")}
    numbers = {**evidence, **found["numbers"], "severity": severity, "days": days}
    text = _glapp.to_text(f"quality.{code}", numbers, pv_unit=pv_unit, op_unit=op_unit, first_row=first_row)
    return Finding(code, severity, text, evidence)


def _time(t: float, t0: datetime | None) -> str:
    """A moment as a person knows it, with the zone that its recording has."""
    try:
        return f"{t:.10g} s" if t0 is None else (t0 + timedelta(seconds=t)).isoformat(sep=" ")
    except (OverflowError, ValueError):  # beyond the calendar
        return f"{t:.10g} s"
