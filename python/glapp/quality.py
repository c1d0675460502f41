"""What is wrong with a recording, found before anything is estimated from it.

Two sources of evidence: a `Census`, counts over every row, and an `InspectionSample`, the rows kept in memory.  Each
`Finding` names one fault, its numbers and what to do; `docs/quality.md` lists them all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from . import _glapp
from .identify import FROZEN_STEPS, R2_USABLE, SORTED_ROWS, Identification, frozen_steps, in_runs, resolution

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
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
    with np.errstate(all="ignore"):
        look = _Look(sample, census, k, ti, td, identification, pv_unit, op_unit, t0, first_row)
        found = [*known, *(finding for test in _TESTS for finding in test(look))]
    return sorted(found, key=lambda finding: ("refuse", "warning", "info").index(finding.severity))


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
    begins = f"column '{column}' begins at {first} and " + ("does not step" if step is None else f"steps by {step:.6g}")
    if sure:
        text = f"{begins}: read as {days}; if it counts seconds, write time_format = 'seconds'"
    else:
        text = f"{begins}: read as seconds; if these are {days}, write time_format = '{calendar}'"
    evidence: dict[str, float | int | str] = {"column": column, "first": first, "step": 0.0 if step is None else step}
    evidence["read_as"] = calendar if sure else "seconds"
    return Finding("time_assumed", "info" if sure else "warning", text, evidence)


def assumed_gain(
    kp: float, free: float, kp_part: float, *, pv_unit: str = "PV units", op_unit: str = "OP units"
) -> Finding | None:
    """Say how much of the width hangs on a process gain that nobody gave; None where it is less than a tenth.

    Parameters
    ----------
    kp : float
        Gain that was assumed [PV unit/OP unit].
    free, kp_part : float
        Kp-free part of the width, and what Kp takes off it [OP unit].

    Examples
    --------
    >>> assumed_gain(30.0, 0.45, 0.22, pv_unit="m3/h", op_unit="%").text
    'Kp is not given and taken as 1.5 %/%, that is 30 m3/h per %: it takes 0.22 % off a width of 0.45 %; give kp'
    """
    if not kp_part > 0.1 * free:
        return None
    return Finding(
        "kp_assumed",
        "warning",
        f"Kp is not given and taken as 1.5 %/%, that is {abs(kp):.3g} {pv_unit} per {op_unit}: it takes "
        f"{kp_part:.3g} {op_unit} off a width of {free:.3g} {op_unit}; give kp",
        {"kp": kp, "free": free, "kp_part": kp_part},
    )


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
    pv = np.asarray(pv, dtype=np.float64)[:SORTED_ROWS]
    with np.errstate(all="ignore"):
        grid = resolution(pv)
        if grid is None and pv.size:  # on a grid, rest is what slow movement looks like
            pv = np.where(np.concatenate(([False], in_runs(np.diff(pv) == 0, FROZEN_STEPS))), np.nan, pv)
        sigmas = []
        for order in range(5):
            difference = np.diff(pv, order) if pv.size > order else pv[:0]
            difference = difference[np.isfinite(difference)]
            if difference.size < 20:
                return None
            deviation = np.median(np.abs(difference - np.median(difference)))
            sigmas.append(float(deviation) / 0.6745 / math.sqrt(math.comb(2 * order, order)))
    return max(min(sigmas), grid[0] / math.sqrt(12) if grid else 0.0)


class _Look:
    """A recording with what several tests need of it, worked out once."""

    def __init__(
        self,
        sample: InspectionSample,
        census: Census,
        k: float | None,
        ti: float | None,
        td: float | None,
        identification: Identification | None,
        pv_unit: str,
        op_unit: str,
        t0: datetime | None,
        first_row: int,
    ) -> None:
        self.census, self.identification = census, identification
        self.k, self.ti, self.td = k, ti, td
        # One frequency leaves Ti open by more than is usable: the least that it can be is enough to know a sinusoid by.
        self.shortest_ti = ti
        if ti is None and identification is not None and (identification.r2 or 0.0) >= R2_USABLE:
            low = identification.ti_low
            self.shortest_ti = low if low is not None and 0 < low < math.inf else None
        self.pv_unit, self.op_unit, self.t0, self.first_row = pv_unit, op_unit, t0, first_row
        self.t, self.pv = (np.asarray(x, dtype=np.float64) for x in (sample.t, sample.pv))
        self.sp, self.op = (None if x is None else np.asarray(x, dtype=np.float64) for x in (sample.sp, sample.op))
        with np.errstate(all="ignore"):
            # Whether PV swings as a sinusoid is seen about its mean as well.
            self.e = (np.nanmean(self.pv) if self.sp is None else self.sp) - self.pv
        dt = np.diff(self.t)
        forward = dt[:SORTED_ROWS][dt[:SORTED_ROWS] > 0]
        self.h = float(np.median(forward)) if forward.size else math.nan
        good = np.isfinite(self.e)
        if self.op is not None:
            good &= np.isfinite(self.op)
        if sample.flags is not None:
            good &= np.asarray(sample.flags) == 0
        self.good = good
        """Rows in auto, good, off the limits, all numbers."""
        self.step = good[1:] & good[:-1] & (dt > 0) & (dt <= GAP_STEPS * self.h)
        """Steps between such rows, without a gap."""
        self.frozen = frozen_steps(self.sp, self.pv, self.op)
        """Steps in which nothing is recorded anew."""
        self.live = self.step & ~self.frozen

    def share(self, count: int) -> float:
        return count / self.census.rows if self.census.rows else 0.0

    def row(self, row: int) -> str:
        return f"row {row + self.first_row}"

    def time(self, t: float) -> str:
        try:
            return f"{t:.10g} s" if self.t0 is None else (self.t0 + timedelta(seconds=t)).isoformat(sep=" ")
        except (OverflowError, ValueError):  # beyond the calendar
            return f"{t:.10g} s"

    def seconds(self, duration: float) -> str:
        return f"{duration:.3g} s" if duration < 1000 else f"{duration:.0f} s"


def _percent(share: float) -> str:
    return f"{share:.0%}" if share >= 0.095 or share == 0 else f"{100 * share:.2g} %".replace(" %", "%")


def _rows(look: _Look) -> Iterator[Finding]:
    rows = look.census.rows
    if rows < 10:
        yield Finding(
            "too_few_rows",
            "refuse",
            f"the recording has {rows} rows, from which nothing can be told: take hours, not moments",
            {"rows": rows},
        )


def _times(look: _Look) -> Iterator[Finding]:
    c = look.census
    if c.t_bad:
        yield Finding(
            "time_missing",
            "refuse" if c.t_bad >= c.rows - 1 else "warning",
            f"{c.t_bad} of {c.rows} rows have no time and are not used: check the time column",
            {"rows": c.t_bad, "share": look.share(c.t_bad)},
        )
    if c.reversed:
        back = c.reversed_from - c.reversed_to
        if c.reversed > 0.9 * (c.rows - 1):
            hint = "the newest row comes first; sort the rows by time, the oldest first"
        elif abs(back - 3600) <= max(60.0, look.h if math.isfinite(look.h) else 0.0):
            hint = "the clock seems to have been set back an hour: export in UTC or name the time zone"
        else:
            hint = "sort the rows by time, or export in UTC if this is the end of summer time"
        yield Finding(
            "time_reversed",
            "refuse",
            f"time runs backwards in {c.reversed} of {c.rows} rows, first at {look.row(c.reversed_row)}, from "
            f"{look.time(c.reversed_from)} to {look.time(c.reversed_to)}: {hint}",
            {
                "count": c.reversed,
                "first_row": c.reversed_row,
                "from": look.time(c.reversed_from),
                "to": look.time(c.reversed_to),
                "back_s": back,
            },
        )
    if c.repeated:
        useless = c.repeated >= c.rows - 1
        yield Finding(
            "time_repeated",
            "refuse" if useless else "warning",
            f"{c.repeated} of {c.rows} rows repeat the time before them, first {look.row(c.repeated_row)}: "
            + ("every time is the same; check the time column" if useless else "remove the doubles if they are many"),
            {"count": c.repeated, "share": look.share(c.repeated), "first_row": c.repeated_row},
        )
    if c.gaps:
        yield Finding(
            "gaps",
            "warning",
            f"gaps longer than {look.seconds(c.gap_threshold)}: {c.gaps}, {look.seconds(c.gap_total)} in all, the "
            f"longest {look.seconds(c.gap_longest)}, the first before {look.row(c.gap_row)}; no half-period is taken "
            "across one: ask for raw values if they are many",
            {"count": c.gaps, "longest_s": c.gap_longest, "total_s": c.gap_total, "first_row": c.gap_row},
        )


def _numbers(look: _Look) -> Iterator[Finding]:
    c = look.census
    if not c.rows:
        return
    recorded = [("PV", c.pv_bad, c.pv_bad_row), ("OP", c.op_bad, c.op_bad_row)]
    if look.sp is not None:
        recorded.insert(0, ("SP", c.sp_bad, c.sp_bad_row))
    for name, bad, row in recorded:
        share = look.share(bad)
        evidence: dict[str, float | int | str] = {"signal": name, "rows": bad, "share": share, "first_row": row}
        if bad == c.rows:
            yield Finding(
                "not_a_number",
                "warning" if name == "OP" else "refuse",
                f"{name} is not a number in any of {c.rows} rows: check the column or tag",
                evidence,
            )
        elif bad:
            yield Finding(
                "not_a_number",
                "warning" if share > 0.01 else "info",
                f"{name} is not a number in {bad} of {c.rows} rows ({_percent(share)}), first {look.row(row)}: "
                "each ends a half-period; ask the historian for good values",
                evidence,
            )
    if c.bad_quality:
        share = look.share(c.bad_quality)
        yield Finding(
            "bad_quality",
            "refuse" if c.bad_quality == c.rows else "warning" if share > 0.01 else "info",
            f"the quality is not good in {_percent(share)} of the rows, which are not used: mend the signal, "
            "or check which quality codes mean good",
            {"rows": c.bad_quality, "share": share},
        )


def _mode(look: _Look) -> Iterator[Finding]:
    c = look.census
    share = look.share(c.not_auto)
    if c.not_auto:
        yield Finding(
            "not_auto",
            "refuse" if c.not_auto == c.rows else "warning" if share > 0.5 else "info",
            f"the loop is not in auto in {_percent(share)} of the rows, which are not used: "
            "take a time in auto, or check which mode values mean auto",
            {"rows": c.not_auto, "share": share},
        )
    limited = c.at_low + c.at_high
    share = look.share(limited)
    if limited:
        yield Finding(
            "at_limit",
            "refuse" if share > 0.95 else "warning" if share > 0.05 else "info",
            f"OP is at its low limit in {_percent(look.share(c.at_low))} and at its high limit in "
            f"{_percent(look.share(c.at_high))} of the rows, which are not used: "
            "take a time in which the valve has room to move",
            {"at_low": look.share(c.at_low), "at_high": look.share(c.at_high)},
        )


def _constants(look: _Look) -> Iterator[Finding]:
    c = look.census
    if look.op is None:
        yield Finding(
            "no_op",
            "info",
            "OP is not recorded, so K and Ti must be given, and saturation is seen only through limit flags: add OP",
        )
    if c.rows >= 2 and c.op_min == c.op_max:
        yield Finding(
            "op_constant",
            "refuse",
            f"OP stays at {c.op_min:.4g} {look.op_unit} over the whole recording: "
            "take a time in which the controller works, or check the OP column",
            {"op": c.op_min},
        )
    if c.rows >= 2 and c.pv_min == c.pv_max:
        yield Finding(
            "pv_constant",
            "refuse",
            f"PV stays at {c.pv_min:.4g} {look.pv_unit} over the whole recording: "
            "check the PV column and the transmitter",
            {"pv": c.pv_min},
        )
    for name, other in (("OP", look.op), ("SP", look.sp)):
        if other is None:
            continue
        both = np.isfinite(other) & np.isfinite(look.pv)
        if both.sum() >= 10 and np.ptp(look.pv[both]) > 0 and np.mean(other[both] == look.pv[both]) > 0.99:
            yield Finding(
                "same_signal",
                "refuse",
                f"PV and {name} are the same signal: check which columns or tags were taken",
                {"signals": f"PV, {name}"},
            )


def _setpoint(look: _Look) -> Iterator[Finding]:
    if look.sp is None:
        return
    pairs = look.census.rows - 1 - look.census.still
    share = look.census.sp_changes / pairs if pairs > 0 else 0.0
    if share > 0.5:
        yield Finding(
            "cascade_slave",
            "warning",
            f"SP moves at {_percent(share)} of the samples, as in a cascade slave: the method works in a slave, but "
            "half-periods in which SP moves more than PV are rejected (5.5); few may be left",
            {"sp_changes": look.census.sp_changes, "share": share},
        )


def _sampling(look: _Look) -> Iterator[Finding]:
    if look.ti is None or not look.ti > 0 or not look.h > look.ti / 5:
        return
    evidence: dict[str, float | int | str] = {"h_s": look.h, "ti_s": look.ti, "ratio": look.h / look.ti}
    if look.h > look.ti:
        yield Finding(
            "sampling",
            "refuse",
            f"a sample every {look.seconds(look.h)} is slower than Ti {look.seconds(look.ti)}, so the error between "
            f"the samples is unknown: record at least every {look.seconds(look.ti / 5)}",
            evidence,
        )
    else:
        yield Finding(
            "sampling",
            "warning",
            f"a sample every {look.seconds(look.h)} is coarse against Ti {look.seconds(look.ti)}, so widths are rough: "
            f"record at least every {look.seconds(look.ti / 5)}",
            evidence,
        )


def _recording(look: _Look) -> Iterator[Finding]:
    """Frozen, held or interpolated by a historian."""
    steps = int(np.count_nonzero(look.step))
    if steps < 20:
        return
    frozen = int(np.count_nonzero(look.step & look.frozen)) / steps
    if frozen > 0.02:
        yield Finding(
            "frozen",
            "warning",
            f"in {_percent(frozen)} of the recording SP, PV and OP all repeat their last value although PV is off SP, "
            "so the historian stood still, not the loop: export raw values, or another time",
            {"share": frozen},
        )
    grid = resolution(look.pv)
    if grid is not None or not np.ptp(look.pv[look.good]) > 0:
        return  # equal steps on a coarse grid look like straight lines and like holds
    dpv = np.diff(look.pv)
    live = look.live
    flat = live & (dpv == 0)
    if look.op is not None:
        flat &= np.diff(look.op) != 0
    held = int(np.count_nonzero(in_runs(flat, FROZEN_STEPS))) / steps
    pairs = live[1:] & live[:-1] & (dpv[1:] != 0)
    size = np.abs(look.pv[2:]) + np.abs(look.pv[:-2])
    straight = pairs & (np.abs(np.diff(dpv / np.diff(look.t))) * look.h <= 1e-6 * np.abs(dpv[1:]) + 4e-16 * size)
    straight &= np.abs(dpv[1:]) > 1e-12 * size  # movement at rounding level has no shape
    lines = int(np.count_nonzero(in_runs(straight, 2))) / steps
    if held > 0.5:
        yield Finding(
            "compressed_pv",
            "warning",
            f"PV repeats its last value in {_percent(held)} of the recording while OP moves on, as a historian's "
            "compression leaves it: export uncompressed values",
            {"held": held, "straight": lines},
        )
    elif lines > 0.2:
        yield Finding(
            "compressed_pv",
            "warning",
            f"{_percent(lines)} of PV's samples lie on exact straight lines, as interpolation between a historian's "
            "compressed values leaves them: export raw values",
            {"held": held, "straight": lines},
        )


def _grids(look: _Look) -> Iterator[Finding]:
    for name, code, x, unit, consequence in (
        ("PV", "quantised_pv", look.pv, look.pv_unit, "small errors and crossings are lost"),
        ("OP", "quantised_op", look.op, look.op_unit, "no width below a few steps can be told"),
    ):
        grid = None if x is None else resolution(x)
        if grid is not None and grid[1] < 100:
            step, levels = grid
            yield Finding(
                code,
                "warning" if levels < 20 else "info",
                f"{name} comes in steps of {step:.3g} {unit}, {levels} within its range, so {consequence}: "
                "record with more digits",
                {"step": step, "levels": levels},
            )


def _settings(look: _Look) -> Iterator[Finding]:
    seen = look.identification
    if seen is None or not seen.usable or seen.k is None or seen.ti is None:
        return
    gain = f"{look.op_unit} per {look.pv_unit}"
    if look.k is not None and look.k * seen.k < 0:
        yield Finding(
            "sign",
            "warning",
            f"the settings say K {look.k:.3g} {gain} but OP moves as with K {seen.k:.3g} {gain}: "
            "check the action, direct (K < 0) or reverse (K > 0), or the columns",
            {"k_given": look.k, "k_seen": seen.k, "r2": seen.r2 or 0.0},
        )
    for name, given, found, low, high, unit in (
        ("K", look.k, seen.k, seen.k_low, seen.k_high, gain),
        ("Ti", look.ti, seen.ti, seen.ti_low, seen.ti_high, "s"),
        ("Td", look.td, seen.td, seen.td_low, seen.td_high, "s"),
    ):
        if given is None or found is None or low is None or high is None:
            continue
        low, high = sorted((abs(low), abs(high)))
        if not low / 1.5 <= abs(given) <= high * 1.5:
            yield Finding(
                "settings",
                "warning",
                f"the settings say {name} {given:.3g} {unit} but OP moves as with {found:.3g} {unit} "
                f"({low:.3g} to {high:.3g} {unit}): check the controller's form and units",
                {"parameter": name, "given": given, "seen": found, "low": low, "high": high},
            )


def _controller_gaps(look: _Look) -> Iterator[Finding]:
    """Error gap and output dead band of the controller: OP rests although the law would move it."""
    if look.op is None or look.sp is None:
        return
    move = np.abs(np.diff(look.op))[look.live]
    error = np.abs(look.e[1:])[look.live]
    rests = move == 0
    share = float(rests.mean()) if rests.size else 0.0
    if rests.size < 100 or not 0.05 < share < 0.98:
        return
    order = np.argsort(error)
    resting = np.cumsum(rests[order])
    index = np.arange(1, rests.size + 1)
    # The split by |e| with the fewest steps on the wrong side: rest inside the gap, movement outside.
    wrong = (index - resting) + (resting[-1] - resting)
    cut = int(np.argmin(wrong))
    inside, outside = float(resting[cut] / index[cut]), 0.0
    if cut + 1 < rests.size:
        outside = float((resting[-1] - resting[cut]) / (rests.size - 1 - cut))
    gap = float(error[order[cut]])
    # The step is sharp: just below the edge OP rests, just above it moves.
    edge = rests[order]
    near = min(cut, max(10, rests.size // 50))
    both = min(cut, rests.size - cut) >= 30
    sharp = edge[cut + 1 - near : cut + 1].mean() - edge[cut + 1 : cut + 1 + near].mean() if both else 0.0
    if inside > 0.9 and outside < 0.1 and sharp > 0.7:
        yield Finding(
            "error_gap",
            "warning",
            f"OP rests while PV is within {gap:.3g} {look.pv_unit} of SP and moves beyond, so the controller has an "
            "error gap, whose cycle looks like backlash: write error_gap in the settings, or record with it set to 0",
            {"gap": gap, "rests_inside": inside, "rests_outside": outside},
        )
        return
    jumps = move[~rests]
    least = float(np.quantile(jumps, 0.02))
    if share > 0.3 and least > 0.3 * float(np.median(jumps)) and resolution(look.op) is None:
        yield Finding(
            "output_dead_band",
            "warning",
            f"OP rests in {_percent(share)} of the steps and otherwise jumps by at least {least:.3g} {look.op_unit}, "
            "so the controller has an output dead band, which adds to the valve's: write output_dead_band in the "
            "settings",
            {"rests": share, "jump": least},
        )


def _winding_up(look: _Look) -> Iterator[Finding]:
    """One sign of the error for most of the recording, OP going one way all along, PV coming no nearer."""
    if look.op is None or look.sp is None:
        return
    rows = np.flatnonzero(look.good)
    if rows.size < 100:
        return
    e, op = look.e[rows], look.op[rows]
    sign = np.sign(e)
    starts = np.flatnonzero(np.concatenate(([True], sign[1:] != sign[:-1])))
    lengths = np.diff(np.concatenate((starts, [rows.size])))
    longest = int(np.argmax(lengths))
    a, n = int(starts[longest]), int(lengths[longest])
    if n < 0.8 * rows.size or sign[a] == 0:
        return
    e, op = e[a : a + n], op[a : a + n]
    travel = float(np.sum(np.abs(np.diff(op))))
    went = float(op[-1] - op[0])
    half = n // 2
    nearer = float(np.mean(np.abs(e[half:])) / np.mean(np.abs(e[:half])))
    lasted = float(look.t[rows[a + n - 1]] - look.t[rows[a]])
    if travel > 0 and abs(went) > 0.8 * travel and nearer > 0.8 and not lasted < 10 * (look.ti or 0.0):
        side = "below" if e[0] > 0 else "above"
        yield Finding(
            "winding_up",
            "refuse",
            f"PV stays {float(np.median(np.abs(e))):.3g} {look.pv_unit} {side} SP for {look.seconds(lasted)} while OP "
            f"winds from {op[0]:.3g} to {op[-1]:.3g} {look.op_unit}, so PV does not answer OP and nothing can be "
            "estimated: take a time in which the loop controls",
            {"error": float(np.median(e)), "lasted_s": lasted, "op_from": float(op[0]), "op_to": float(op[-1])},
        )


def _sinusoid(look: _Look) -> Iterator[Finding]:
    """Tell a linear oscillation: one clean frequency, half-periods too short for backlash under this Ti."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], look.step, [False])).astype(np.int8)))
    ti = look.shortest_ti
    if edges.size == 0 or ti is None:  # without Ti the cycle of a gap in an integrating loop looks the same
        return
    longest = int(np.argmax(edges[1::2] - edges[::2]))
    e = look.e[edges[2 * longest] : edges[2 * longest + 1] + 1][:SORTED_ROWS]
    if e.size < 64 or not np.ptp(e) > 0:
        return
    sign = np.where(e - e.mean() > 0, 1, -1)
    crossings = np.flatnonzero(np.diff(sign))
    if crossings.size < 12:
        return
    # Noise can cross many times around one zero: the half-period is that of the spectral peak, not of the crossings.
    power = np.abs(np.fft.rfft((e - e.mean()) * np.hanning(e.size))) ** 2
    peak = int(np.argmax(power[3:])) + 3
    width = max(2, round(0.15 * peak))  # the line with its slow changes of frequency
    share = float(power[max(1, peak - width) : peak + width + 1].sum() / power[1:].sum())
    half = 0.5 * e.size * look.h / peak
    inner = np.abs(e - e.mean())
    area = np.add.reduceat(inner, crossings + 1)[:-1] / np.diff(crossings)
    top = np.maximum.reduceat(inner, crossings + 1)[:-1]
    long = np.diff(crossings) * look.h > 0.5 * half
    shape = float(np.median((top / area)[long])) if long.any() else math.nan
    lengths = np.diff(crossings)[long] * look.h
    spread = float(np.std(lengths) / np.mean(lengths)) if lengths.size else math.inf
    if share > 0.9 and spread < 0.25 and half < 5 * ti and 1.35 < shape < 1.8:
        yield Finding(
            "sinusoidal",
            "warning",
            f"the error is a clean sinusoid of period {look.seconds(2 * half)} ({_percent(share)} of its power at one "
            f"frequency, peak to mean {shape:.2f} against {math.pi / 2:.2f}; half-periods of "
            f"{look.seconds(half)}, shorter than 5 Ti, {look.seconds(5 * ti)}): "
            "a linear oscillation, not backlash, makes the loop swing, and a gap beside it does not show; look at the "
            "tuning or for a disturbance from elsewhere",
            {"period_s": 2 * half, "spectral_share": share, "spread": spread, "peak_to_mean": shape},
        )


_TESTS = (
    _rows,
    _times,
    _numbers,
    _mode,
    _constants,
    _winding_up,
    _setpoint,
    _sampling,
    _recording,
    _grids,
    _settings,
    _controller_gaps,
    _sinusoid,
)
