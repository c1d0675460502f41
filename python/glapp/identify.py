"""The controller's own law, read out of the recording.

A PI controller moves its output by

    dOP = K (b dSP - dPV) + K/Ti e dt,      e = SP - PV                                             (velocity form)

and this sum over any stretch of time holds too, so K, Ti and (where the setpoint moves) b follow from a regression of
OP's moves on the moves of SP and PV and the area of the error.  `docs/identify.md` tells how the choices were made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

R2_USABLE = 0.9
"""Least share of OP's moves that the law must explain before its K and Ti are used unasked."""

MIN_STEPS = 50
"""Fewest usable steps between samples; below it an interval means nothing."""

FROZEN_STEPS = 5
"""Where all signals repeat to the bit for so many steps, the recording stood still, not the loop."""

SORTED_ROWS = 200_000
"""Rows that are enough to know a signal's steps, noise and spectrum."""

_TUKEY = 4.685  # 95 % efficient for Gaussian residuals
_HUBER = 1.345
_SHORTEST = 3  # [steps] one or two steps are ruled by what PV did between the samples
_BLOCKS = (8, 30)
_SEARCH_ROWS = 4000
_SEARCH_ROUNDS = (4, 0)  # to rank ways of recording takes no fit to the last digit


@dataclass(frozen=True, slots=True)
class Identification:
    """K and Ti of a PI controller as its recording shows them.

    `k`, `ti` and `r2` are None where no fit was possible at all; then `reason` says why.  A fit that is not trusted
    keeps its numbers, for a person to judge, with `usable` False.

    Attributes
    ----------
    k : float | None
        Gain [OP unit per PV unit], negative for a direct acting controller.
    ti : float | None
        Integral time [s].
    k_low, k_high, ti_low, ti_high : float | None
        95 % interval of the scatter, widened by what one sampling step leaves open (`identify`); `ti_high` is infinite
        where integral action cannot be told from none.
    r2 : float | None
        Share of the variance of OP's *moves* (not of its level) explained, outliers included; at most 1,
        negative when worse than nothing.
    samples : int
        Steps between consecutive samples that could be used.
    setpoint_weight : float | None
        b, as given or as found; None where SP moved too little to tell.
    note : str
        How the fit was made, for the report.
    usable : bool
        R² at least `R2_USABLE`, K and Ti both told from zero.
    reason : str
        One sentence for a person; empty when usable.
    """

    k: float | None
    ti: float | None
    k_low: float | None
    k_high: float | None
    ti_low: float | None
    ti_high: float | None
    r2: float | None
    samples: int
    setpoint_weight: float | None
    note: str
    usable: bool
    reason: str


def identify(
    t: Floats,
    sp: Floats,
    pv: Floats,
    op: Floats | None,
    flags: NDArray[np.uint8] | None = None,
    *,
    setpoint_weight: float | None = None,
    limits: tuple[float, float] | None = None,
) -> Identification:
    r"""Find K and Ti of the PI controller that produced OP from SP and PV.

    Summed over m steps the velocity form reads

        OP(k+m) - OP(k) = -K (PV(k+m) - PV(k)) + b K (SP(k+m) - SP(k)) + K/Ti sum_{j=k+1}^{k+m} e_j h_j,

    with e = SP - PV.  It is fitted by iteratively reweighted least squares (Huber, then Tukey's biweight; scale from
    the median absolute residual) over all stretches of m consecutive usable steps: in auto, good, finite, off the
    limits, no gap.  Of m = 3, 5, 8, 12 ... up to two Ti that with the most certain K and K/Ti is taken, among those
    with R² enough if any: over one step, what PV did between two samples and OP's resolution rule the fit, and R² can
    be high while Ti is far off.

    The interval is the sandwich of the robust fit with the scores summed in 8-30 blocks of time, so that residuals may
    be correlated within a block, and Student's t for the number of blocks.

    Bias: a recording at step h cannot tell which error the controller integrated within the step.  The values are those
    of a controller that runs once a sample on the current error.  One that runs much faster has the same K/Ti and
    Ti + h/2; one that integrates the previous error Ti + h.  The ends of the intervals away from zero include both.
    Derivative action is not modelled and lowers R².  Where the controller filters PV and PV was recorded before the
    filter, a first or second order filter is fitted first, and `note` says so; without it noise would hide K.

    Parameters
    ----------
    t : float64[n]
        Time [s]; may repeat or run backwards, such steps are not used.
    sp, pv : float64[n]
        Setpoint and measurement [PV unit]; NaN where missing.
    op : float64[n] | None
        Controller output [OP unit].
    flags : uint8[n] | None
        Any bit set (not auto, bad, at a limit) takes the sample out.
    setpoint_weight : float | None
        b where it is known; None: found where SP moves enough, and its effect kept apart in any case.
    limits : (float, float) | None
        OP's lower and upper limit [OP unit]; samples at or beyond them are not used.

    Returns
    -------
    Identification
        Never raises on data: whatever cannot be found is said in `reason`.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(400.0)
    >>> pv = 50 + np.sin(t / 17) + 0.3 * np.sin(t / 5)
    >>> sp = np.full(400, 50.0)
    >>> op = 2.0 * (sp - pv) + 2.0 / 30 * np.cumsum(sp - pv)
    >>> found = identify(t, sp, pv, op)
    >>> round(found.k, 3), round(found.ti, 2), found.usable
    (2.0, 30.0, True)
    """
    if op is None:
        return _nothing("the recording has no OP, so K and Ti must be given", 0)
    t, sp, pv, op = (np.asarray(x, dtype=np.float64) for x in (t, sp, pv, op))
    usable = np.isfinite(t) & np.isfinite(sp) & np.isfinite(pv) & np.isfinite(op)
    if flags is not None:
        usable &= np.asarray(flags) == 0
    if limits is not None:
        usable &= (op > limits[0]) & (op < limits[1])
    with np.errstate(all="ignore"):
        dt = np.diff(t)
        step = usable[1:] & usable[:-1] & (dt > 0)
        h = float(np.median(dt[step])) if step.any() else 0.0
        step &= dt <= 3 * h
        step &= ~frozen_steps(sp, pv, op)
        samples = int(np.count_nonzero(step))
        if samples < MIN_STEPS:
            return _nothing(
                f"only {samples} steps between samples are in auto, good, off the limits and without a gap; "
                f"at least {MIN_STEPS} are needed: give K and Ti, or a longer recording in auto",
                samples,
            )
        moved = np.diff(op)[step]
        if not moved.any():
            return _nothing("OP never moves while in auto, so nothing shows K and Ti: give them", samples)
        if not np.diff(pv)[step].any():
            return _nothing("PV never moves while in auto, so nothing shows K and Ti: give them", samples)
        seen = _seen(t, sp, pv, op, step, h, setpoint_weight)
        moves = _Moves(t, sp, _filtered(pv, seen, h), op, step, setpoint_weight)
        return _identify(moves, seen, h, samples, setpoint_weight)


def _nothing(reason: str, samples: int) -> Identification:
    return Identification(None, None, None, None, None, None, None, samples, None, "no fit", False, reason)


def in_runs(mask: Bools, least: int) -> Bools:
    """Keep of a mask only the runs of at least so many."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    long = edges[1::2] - edges[::2] >= least
    keep = np.zeros(mask.size + 1, dtype=np.int8)
    keep[edges[::2][long]] = 1
    keep[edges[1::2][long]] = -1
    return np.cumsum(keep[:-1], dtype=np.int8).astype(bool)


def resolution(x: Floats) -> tuple[float, int] | None:
    """Step of a quantised signal and the number of steps in its range; None when it has no such grid."""
    x = x[:SORTED_ROWS]
    values = np.unique(x[np.isfinite(x)])
    if values.size < 2 or values.size > 0.5 * x.size:
        return None
    span, size = float(values[-1] - values[0]), float(np.max(np.abs(values)))
    apart = np.diff(values)
    apart = apart[apart > 1e-9 * span + 1e-12 * size]
    if apart.size == 0 or not math.isfinite(span):
        return None
    # A few interpolated values between the steps must not hide the grid: its step is what most neighbours share.
    step = float(np.median(apart[apart <= 1.5 * np.quantile(apart, 0.1)]))
    off = np.abs(apart / step - np.round(apart / step))
    return (step, round(span / step)) if np.mean(off < 0.02) > 0.9 else None


def frozen_steps(sp: Floats, pv: Floats, op: Floats | None) -> Bools:
    """Mark long stretches in which no signal changes a bit though the error is not zero, with the step that ends each.

    There a historian repeats its last row while the loop goes on; the jump at the end holds an error nobody recorded.
    """
    still = (np.diff(sp) == 0) & (np.diff(pv) == 0) & (sp != pv)[1:]
    if op is not None:
        still &= np.diff(op) == 0
    frozen = in_runs(still, FROZEN_STEPS)
    # Coarse signals rest by themselves: only where values otherwise hardly ever repeat does a repetition mean anything.
    if np.count_nonzero(still) - np.count_nonzero(frozen) > 0.1 * np.count_nonzero(~frozen) or resolution(pv):
        return np.zeros_like(still)
    frozen[1:] |= frozen[:-1].copy()
    return frozen


@dataclass(frozen=True, slots=True)
class _Seen:
    """How the recording saw the controller.

    `lag` [rows]: OP recorded one late (1) or early (-1).  `order`, `tf` [s]: the controller's filter on PV, where PV
    was recorded before it.
    """

    lag: int
    order: int
    tf: float


class _Moves:
    """Moves of OP, SP and PV and the area of the error over any number of usable steps, by running sums."""

    def __init__(self, t: Floats, sp: Floats, pv: Floats, op: Floats, step: Bools, b: float | None) -> None:
        dt = np.diff(t)
        area = np.where(step, (sp - pv)[1:] * dt, 0.0)
        self.area = np.concatenate(([0.0], np.cumsum(area)))
        self.good = np.concatenate(([0], np.cumsum(step)))
        self.op, self.sp, self.pv = op, sp, pv
        self.b = b
        self.sp_moves = bool(np.any(np.diff(sp)[step] != 0))

    def enough(self, m: int) -> bool:
        """Tell whether half of the usable steps start a stretch of m of them."""
        return bool(2 * np.count_nonzero(self.good[m:] - self.good[:-m] == m) >= self.good[-1])

    def over(self, m: int, lag: int = 0) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Rows (start index, move of OP, regressors) of stretches of m usable steps; OP is read `lag` rows later."""
        ends = np.arange(max(0, -lag), self.good.size - m - max(0, lag))
        whole = (self.good[ends + m] - self.good[ends] == m) & (self.good[ends + m + lag] - self.good[ends + lag] == m)
        start = ends[whole]
        # Stretches overlap: a start every m/4 steps loses next to nothing, nor do more than some 100 000 rows add any.
        start = start[:: max(1, m // 4, start.size // 100_000)]
        stop = start + m
        y = self.op[stop + lag] - self.op[start + lag]
        dsp, dpv = self.sp[stop] - self.sp[start], self.pv[stop] - self.pv[start]
        area = self.area[stop] - self.area[start]
        if not self.sp_moves:
            columns = [-dpv, area]
        elif self.b is None:
            columns = [-dpv, area, dsp]
        else:
            columns = [self.b * dsp - dpv, area]
        return start, y, np.column_stack(columns)


@dataclass(frozen=True, slots=True)
class _Fit:
    beta: Floats
    covariance: Floats
    r2: float
    blocks: int


def _fit(start: NDArray[np.int64], y: Floats, x: Floats, m: int, rounds: tuple[int, int] = (20, 30)) -> _Fit | None:
    """Huber, then Tukey, from the median absolute residual; covariance from block sums of the scores.

    `rounds` limits the repetitions of each.

    None where the rows do not determine the values.
    """
    if y.size < 5 * x.shape[1]:
        return None
    unit, size = float(np.sqrt(np.mean(y * y))), np.sqrt(np.mean(x * x, axis=0))
    if not (unit > 0 and math.isfinite(unit) and np.all(size > 0) and np.all(np.isfinite(size))):
        return None
    y, x = y / unit, x / size
    inverse = _inverse(x.T @ x)
    if inverse is None:
        return None
    beta = inverse @ (x.T @ y)
    for shape, most in zip(("huber", "tukey"), rounds, strict=True):
        for _ in range(most):
            weight = _weight(_standardised(y - x @ beta), shape)
            inverse = _inverse((x * weight[:, None]).T @ x)
            if inverse is None:
                return None
            new = inverse @ (x.T @ (weight * y))
            change, beta = float(np.max(np.abs(new - beta))), new
            if change <= 1e-7 * float(np.max(np.abs(beta))):
                break
    residual = y - x @ beta
    u = _standardised(residual)
    v = (u / _TUKEY) ** 2
    slope = np.where(v < 1, (1 - v) * (1 - 5 * v), 0.0)  # derivative of the biweight's score
    inverse = _inverse((x * slope[:, None]).T @ x)
    total = float(np.sum((y - y.mean()) ** 2))
    if inverse is None or not total > 0:
        return None
    score = x * (_weight(u, "tukey") * residual)[:, None]
    length = int(start[-1] - start[0]) + 1
    blocks = int(np.clip(length // (5 * m), *_BLOCKS))
    sums = np.column_stack([np.bincount((start - start[0]) * blocks // length, column, blocks) for column in score.T])
    covariance = inverse @ (sums.T @ sums) @ inverse.T * blocks / (blocks - 1)
    scale = unit / size
    r2 = 1 - float(residual @ residual) / total
    fit = _Fit(beta * scale, covariance * np.outer(scale, scale), r2, blocks)
    size = np.abs(fit.beta[:2])
    sane = np.all((size > 1e-100) & (size < 1e100)) and np.all(np.isfinite(fit.covariance))
    return fit if sane else None


def _inverse(a: Floats) -> Floats | None:
    if not np.all(np.isfinite(a)) or np.linalg.cond(a) > 1e10:
        return None
    return np.asarray(np.linalg.inv(a))


def _standardised(residual: Floats) -> Floats:
    # A majority that fits exactly, as where OP rests on its own coarse steps, must not outvote the rows that move.
    spread = float(np.sqrt(np.mean(residual * residual)))
    return residual / max(1.4826 * float(np.median(np.abs(residual))), 0.1 * spread, 1e-9)


def _weight(u: Floats, shape: str) -> Floats:
    if shape == "huber":
        return np.minimum(1.0, _HUBER / np.maximum(np.abs(u), 1e-300))
    return np.where(np.abs(u) < _TUKEY, (1 - (u / _TUKEY) ** 2) ** 2, 0.0)


def _student(df: int) -> float:
    """97.5 % point of Student's t, by its expansion about the normal's (error below 0.01 from 5 degrees of freedom)."""
    z = 1.959964
    return z + (z**3 + z) / (4 * df) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * df**2)


def _identify(moves: _Moves, seen: _Seen, h: float, samples: int, given_b: float | None) -> Identification:
    best: _Fit | None = None
    m, used, least = _SHORTEST, 0, (True, math.inf)
    while m <= max(_SHORTEST, samples // 20) and (m == _SHORTEST or moves.enough(m)):
        fit = _fit(*moves.over(m, seen.lag), m)
        if fit is not None:
            # A coarse OP hides the law in short stretches; a wrong law is not mended by longer ones.
            rank = (fit.r2 < R2_USABLE, _uncertainty(fit))
            if best is None or rank < least:
                best, used, least = fit, m, rank
            # Beyond two Ti the proportional part hardly shows in the moves any more.
            if m * h > 2 * abs(float(fit.beta[0] / fit.beta[1])):
                break
        m += (m + 1) // 2
    if best is None:
        return _nothing(
            "the moves of PV and the area of the error do not each show in OP (a single step, a ramp?): give K and Ti",
            samples,
        )
    return _judge(best, used, seen, h, samples, given_b, moves.sp_moves)


def _uncertainty(fit: _Fit) -> float:
    """Sum of the relative variances of K and K/Ti."""
    return float(np.sum(np.diag(fit.covariance)[:2] / fit.beta[:2] ** 2))


def _seen(t: Floats, sp: Floats, pv: Floats, op: Floats, step: Bools, h: float, b: float | None) -> _Seen:
    """Find how OP was made and recorded: as written, unless another way leaves a quarter as much unexplained."""
    first = int(np.argmax(step))
    part = slice(first, first + _SEARCH_ROWS)
    within = step[part][:-1] if step.size >= first + _SEARCH_ROWS else step[part]
    rows = slice(first, first + within.size + 1)

    def unexplained(seen: _Seen) -> float:
        moves = _Moves(t[rows], sp[rows], _filtered(pv[rows], seen, h), op[rows], within, b)
        start, y, x = moves.over(_SHORTEST, seen.lag)
        fit = _fit(start, y, x, _SHORTEST, _SEARCH_ROUNDS) if start.size else None
        return math.inf if fit is None else 1 - fit.r2

    plain = _Seen(0, 0, 0.0)
    scores = {plain: unexplained(plain)}
    if scores[plain] < 0.01:
        return plain
    for lag in (1, -1):
        scores[_Seen(lag, 0, 0.0)] = unexplained(_Seen(lag, 0, 0.0))
    for order in (1, 2):
        for octave in range(-1, 8):
            seen = _Seen(0, order, h * 2.0**octave)
            scores[seen] = unexplained(seen)
    best = min(scores, key=lambda seen: scores[seen])
    if not scores[best] < 0.25 * scores[plain]:
        return plain
    # Which order it is shows only once the time of each is right.
    for order in (1, 2) if best.order else ():
        for halving in range(1, 7):
            factor = 2.0 ** (0.5**halving)
            near = min((seen for seen in scores if seen.order == order), key=lambda seen: scores[seen])
            for seen in (_Seen(0, order, near.tf / factor), _Seen(0, order, near.tf * factor)):
                scores[seen] = unexplained(seen)
    return min(scores, key=lambda seen: scores[seen])


def _filtered(x: Floats, seen: _Seen, h: float) -> Floats:
    """Pass x `order` times through yf += (x - yf) h/(Tf + h), holding the last value where there is no number."""
    if not seen.order or not x.size:
        return x
    known = np.maximum.accumulate(np.where(np.isfinite(x), np.arange(x.size), 0))
    y, a = np.nan_to_num(x[known]), seen.tf / (seen.tf + h)
    # In blocks: a matrix for what happens within one, a short loop to carry the state over.
    size = 64
    power = a ** np.arange(size + 1)
    ages = np.subtract.outer(np.arange(size), np.arange(size))
    within = np.where(ages >= 0, (1 - a) * power[np.abs(ages)], 0.0)
    for _ in range(seen.order):
        state = y[0]
        blocks = np.pad(y, (0, -y.size % size)).reshape(-1, size) @ within.T
        for block in blocks:
            block += state * power[1:]
            state = block[-1]
        y = blocks.ravel()[: x.size]
    return y


def _judge(
    fit: _Fit, m: int, seen: _Seen, h: float, samples: int, given_b: float | None, sp_moves: bool
) -> Identification:
    k, ki = float(fit.beta[0]), float(fit.beta[1])
    t95 = _student(fit.blocks - 1)
    k_error, ki_error = (t95 * math.sqrt(max(float(v), 0.0)) for v in np.diag(fit.covariance)[:2])
    relative = fit.covariance[:2, :2] / np.outer(fit.beta[:2], fit.beta[:2])
    ti_error = t95 * math.sqrt(max(float(relative[0, 0] + relative[1, 1] - 2 * relative[0, 1]), 0.0))
    ti = k / ki
    # Current, mean or previous error within a step: the same fit with Ti, Ti + h/2 or Ti + h, and K in proportion.
    ends = (k - k_error, k + k_error, k - k_error + ki * h, k + k_error + ki * h)
    ti_low, ti_high = ti / (1 + ti_error), (ti / (1 - ti_error) + h if ti_error < 1 else math.inf)

    b, b_note = given_b, ""
    if given_b is None and sp_moves:
        raw = float(fit.beta[2]) / k
        b_error = t95 * math.sqrt(max(float(fit.covariance[2, 2]), 0.0)) / abs(k)
        if b_error < 0.25:
            b, b_note = min(max(raw, 0.0), 1.0), f"; setpoint weight {raw:.2f} +- {b_error:.2f} fitted"
    timing = {0: "", 1: "; OP recorded one sample late", -1: "; OP recorded one sample early"}[seen.lag]
    if seen.order:
        timing = f"; the controller filters PV, which is recorded unfiltered ({seen.order} x Tf {seen.tf:.3g} s)"
    note = f"robust fit over stretches of {m} samples ({m * h:.4g} s){timing}{b_note}"

    reason = ""
    if fit.r2 < R2_USABLE:
        reason = (
            f"the PI law explains too little of OP's moves (R² {fit.r2:.3g}, needed {R2_USABLE:g}): "
            "give K and Ti, or take a recording in auto that is neither compressed nor averaged"
        )
    elif abs(k) <= k_error:
        reason = f"K cannot be told from 0 ({k:.3g} +- {k_error:.2g} OP units per PV unit): give K and Ti"
    elif abs(ki) <= ki_error or ti_error >= 1:
        reason = (
            f"integral action cannot be told from none (K/Ti {ki:.3g} +- {ki_error:.2g} OP units per PV unit and s): "
            "give K and Ti"
        )
    elif ti <= 0:
        reason = f"K and K/Ti come out with opposite signs (Ti {ti:.3g} s), so this is no PI controller: give K and Ti"
    return Identification(
        k=k,
        ti=ti,
        k_low=min(ends),
        k_high=max(ends),
        ti_low=min(ti_low, ti_high),
        ti_high=max(ti_low, ti_high),
        r2=fit.r2,
        samples=samples,
        setpoint_weight=b,
        note=note,
        usable=not reason,
        reason=reason,
    )
