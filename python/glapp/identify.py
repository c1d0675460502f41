"""The controller's own law, read out of the recording.

A PID controller moves its output by

    dOP = K (b dSP - dPV) + K/Ti e dt - K Td d(dPV/dt),      e = SP - PV                            (velocity form)

with PV filtered or not, and this sum over any stretch of time holds too: K, Ti, Td and (where the setpoint moves) b
follow from a regression of OP's moves on those of SP and PV and on the area of the error.  Which filter stands before
it, whether it has a D part and when it runs, the recording must tell as well, and often does not: then the interval
holds what every law says that explains OP as well.  `docs/identify.md` tells how the choices were made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

R2_USABLE = 0.9
"""Least share of OP's moves that the law must explain before its K and Ti are used unasked."""

WIDEST = 4.0
"""Largest ratio of the ends of the interval of K, or of Ti, with which they are used unasked."""

MIN_STEPS = 50
"""Fewest usable steps between samples; below it an interval means nothing."""

FROZEN_STEPS = 5
"""Where all signals repeat to the bit for so many steps, the recording stood still, not the loop."""

SORTED_ROWS = 200_000
"""Rows that are enough to know a signal's steps, noise and spectrum."""

_TUKEY = 4.685  # 95 % efficient for Gaussian residuals
_HUBER = 1.345
_BLOCKS = (8, 30)
_ROWS = 24_000  # of a longer recording, its three liveliest stretches
_EVERY = 100_000  # moves, by which a law is judged
_MOVES = 2000  # in a regression; they overlap, more add next to nothing
_WORSE = 2.5  # standard errors by which a law must predict worse than the best before it is dropped
_PROMISING = 300.0  # a law this many times worse than the best gets no better by another time constant
_HALF_OCTAVE = 0.41  # relative; the next law tried is as far away
_AGREEING = 2.0  # lengths of the means whose interval is at most so many times as wide as the narrowest are believed
_SURE = 1e-3  # relative; nobody needs settings more exactly, and the first samples of a filter are not known


@dataclass(frozen=True, slots=True)
class Identification:
    """K, Ti and Td of a PID controller as its recording shows them.

    `k`, `ti`, `td` and `r2` are None where no fit was possible at all; then `reason` says why.  A fit that is not
    trusted keeps its numbers, for a person to judge, with `usable` False.

    Attributes
    ----------
    k : float | None
        Gain [OP unit per PV unit], negative for a direct acting controller.
    ti : float | None
        Integral time [s].
    k_low, k_high, ti_low, ti_high : float | None
        95 % interval: of the scatter, of every law that explains OP as well, and of what one sampling step leaves open
        (`identified`); `ti_high` is infinite where integral action cannot be told from none.
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
        R² at least `R2_USABLE`, K and Ti both told from zero, and the ends of either no further apart than `WIDEST`.
    reason : str
        One sentence for a person; empty when usable.
    td : float | None
        Derivative time [s]; 0 where a law without D part explains OP as well as any.
    td_low, td_high : float | None
        95 % interval of it.
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
    td: float | None = None
    td_low: float | None = None
    td_high: float | None = None


def identified(
    t: Floats,
    sp: Floats | None,
    pv: Floats,
    op: Floats | None,
    flags: NDArray[np.uint8] | None = None,
    *,
    setpoint_weight: float | None = None,
    limits: tuple[float, float] | None = None,
) -> Identification:
    r"""Find K, Ti and Td of the controller that produced OP from SP and PV.

    Summed up, with e = SP - PV and all PV filtered as the controller filters it, the law reads at every sample

        OP = const + K (b SP - PV) + K/Ti sum e h - K Td dPV/dt.

    The move from the mean of m samples to the mean of the next m obeys it too, without the constant.  It is fitted by
    iteratively reweighted least squares (Huber, then Tukey's biweight; scale from the median absolute residual) over
    all stretches of 2m consecutive usable steps: in auto, good, finite, off the limits, no gap; m = 1, 2, 4 ... up to
    two Ti.  Short means show the filter and the D part, long ones what noise and the time between samples hide.

    The laws: PI and PID; PV as recorded, through one lag, or through two equal ones; or a D part with a filter of its
    own; of a controller that runs once a sample, and of one that runs much faster.  The filter's time is fitted too.
    Every law that predicts no worse than the best in 8-30 blocks of time takes part in the interval, once as fitted
    and once as if the controller had never seen the noise of the recorded PV.  So does every m whose interval is at
    most twice as wide as the narrowest.  The scatter is the sandwich of the robust fit with scores summed by block,
    and Student's t.

    Bias: a recording at step h cannot tell which error the controller integrated within the step.  Where all samples
    fit to within OP's resolution, the controller ran once a sample, and is taken to have used the current error; else
    it is taken to be much faster.  The interval is wide enough for Ti - h/2 or Ti + h/2, K in proportion.  A filter
    whose lags add up to more than Td hides the derivative: such a controller is taken for a PI with less gain.

    Parameters
    ----------
    t : float64[n]
        Time [s]; may repeat or run backwards, such steps are not used.
    sp, pv : float64[n]
        Setpoint and measurement [PV unit]; NaN where missing, SP None where it is not recorded.
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
    >>> found = identified(t, sp, pv, op)
    >>> round(found.k, 3), round(found.ti, 2), found.usable
    (2.0, 30.0, True)
    """
    if op is None:
        return _nothing("the recording has no OP, so K and Ti must be given", 0)
    if sp is None:
        return _nothing("the recording has no SP, so K and Ti must be given", 0)
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
        return _identify(*_liveliest(t, sp, pv, op, step), h, samples, setpoint_weight)


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


def frozen_steps(sp: Floats | None, pv: Floats, op: Floats | None) -> Bools:
    """Mark long stretches in which no signal changes a bit though the error is not zero, with the step that ends each.

    There a historian repeats its last row while the loop goes on; the jump at the end holds an error nobody recorded.
    """
    still = np.diff(pv) == 0
    if sp is not None:
        still &= (np.diff(sp) == 0) & (sp != pv)[1:]
    if op is not None:
        still &= np.diff(op) == 0
    frozen = in_runs(still, FROZEN_STEPS)
    # Coarse signals rest by themselves: only where values otherwise hardly ever repeat does a repetition mean anything.
    if np.count_nonzero(still) - np.count_nonzero(frozen) > 0.1 * np.count_nonzero(~frozen) or resolution(pv):
        return np.zeros_like(still)
    frozen[1:] |= frozen[:-1].copy()
    return frozen


def _liveliest(
    t: Floats, sp: Floats, pv: Floats, op: Floats, step: Bools
) -> tuple[Floats, Floats, Floats, Floats, Bools]:
    """All rows, or the three stretches of a long recording in which OP moves most, with breaks between."""
    if t.size > _ROWS:
        size = _ROWS // 3
        begins = np.arange(0, t.size - size + 1, size)
        moved = np.concatenate(([0.0], np.cumsum(np.where(step, np.abs(np.diff(op)), 0.0))))
        live = np.sort(begins[np.argsort(-(moved[begins + size - 1] - moved[begins]), kind="stable")[:3]])
        rows = (live[:, None] + np.arange(size)).ravel()
        t, sp, pv, op = t[rows], sp[rows], pv[rows], op[rows]
        step = np.concatenate([np.append(step[begin : begin + size - 1], False) for begin in live])[:-1]
    sp, pv, op = (_held(x) for x in (sp, pv, op))
    return t, sp, pv, op, step


def _held(x: Floats) -> Floats:
    """The last number where there is none."""
    known = np.isfinite(x)
    return np.asarray(np.nan_to_num(x)[np.maximum.accumulate(np.where(known, np.arange(x.size), np.argmax(known)))])


@dataclass(frozen=True, slots=True)
class _Filter:
    """What PV passes through: `order` lags of `tf` [s] before everything, or one of `tfd` before the D part alone.

    `scans`: the controller runs once a recorded sample, else much faster.
    """

    scans: bool
    order: int = 0
    tf: float = 0.0
    tfd: float = 0.0

    @property
    def time(self) -> float:
        return self.tf or self.tfd


class _Form(NamedTuple):
    """A law without its values: the filter, and whether there is a D part."""

    filter: _Filter
    derivative: bool

    @property
    def kind(self) -> tuple[bool, int, bool, bool]:
        return self.filter.scans, self.filter.order, self.filter.tfd > 0, self.derivative

    def slower(self, factor: float) -> _Form:
        by = self.filter
        return self._replace(filter=replace(by, tf=by.tf * factor, tfd=by.tfd * factor))


_PLAIN = _Form(_Filter(True), False)


class _Signals:
    """P, I and D part behind any filter at every row, summed up: a move between two means takes three look-ups."""

    def __init__(
        self, t: Floats, sp: Floats, pv: Floats, op: Floats, step: Bools, h: float, b: float | None, lag: int
    ) -> None:
        self.h, self.b, self.sp, self.pv = h, b, sp, pv
        self.dt = np.where(step, np.diff(t), 0.0)
        self.twice = step[1:] & step[:-1]
        if lag:  # OP is read so many rows later
            step = step & np.roll(step, -lag)
            step[-1 if lag > 0 else 0] = False
        # What the controller's filter held at the first step after a break is not known.
        step = step & np.append(False, step[:-1])
        self.good = np.concatenate(([0], np.cumsum(step)))
        self.op, self.setpoint = _sums(np.roll(op, -lag)), _sums(sp)
        self.sp_moves = b is None and bool(np.any(np.diff(sp)[step] != 0))
        self.kept: dict[_Filter, Floats] = {}
        self.noise: dict[_Filter, float] = {}

    def parts(self, law: _Filter, keep: bool) -> Floats:
        """Sums of the three parts for gains of 1."""
        if law in self.kept:
            return self.kept[law]
        before = y = self.pv
        for _ in range(law.order):
            before, y = y, _filtered(y, law.tf, self.h, law.scans)
        if law.tfd and law.scans:
            slope = np.diff(_filtered(y, law.tfd, self.h, True), prepend=y[0]) / self.h
        elif law.tfd:
            slope = (y - _filtered(y, law.tfd, self.h, False)) / law.tfd
        elif law.order and not law.scans:
            slope = (before - y) / law.tf
        else:
            slope = np.diff(y, prepend=y[0]) / self.h
        e = self.sp - y
        height = e[1:] if law.scans else 0.5 * (e[1:] + e[:-1])
        area = np.concatenate(([0.0], np.cumsum(height * self.dt)))
        self.noise[law] = float(np.mean(np.diff(y, 2)[self.twice] ** 2)) / 6 if self.twice.any() else 0.0
        proportional = y if self.b is None else y - self.b * self.sp
        parts = np.column_stack([_sums(-proportional), _sums(area), _sums(-slope)])
        if keep:
            self.kept[law] = parts
        return parts

    def band(self, m: int, most: int) -> _Band | None:
        """The regression on moves between means of m rows, where there are enough usable stretches of 2m rows."""
        if 2 * m > self.good.size:
            return None
        start = np.flatnonzero(self.good[2 * m - 1 :] - self.good[: self.good.size - 2 * m + 1] == 2 * m - 1)
        start = start[:: max(1, m // 2, -(-start.size // most))]
        return _Band(self, start, m) if start.size >= MIN_STEPS // 2 and start[-1] - start[0] >= 20 * m else None


def _sums(x: Floats) -> Floats:
    """Running sums, of what lies off the mean so that few digits are lost."""
    return np.concatenate(([0.0], np.cumsum(x - x.mean())))


@dataclass(frozen=True, slots=True)
class _Law:
    """One law with its values: K, K/Ti, K Td where it has a D part, b K where SP moves; and how well it does.

    `moments`: weighted, of OP's moves and of the columns of `x`.  `loss`: weighted squares of the residual by block.
    `fitted`: the filter's time was sought, not given.
    """

    form: _Form
    beta: Floats
    x: Floats
    residual: Floats
    loss: Floats
    moments: Floats
    fitted: bool

    @property
    def k(self) -> float:
        return float(self.beta[0])

    @property
    def ti(self) -> float:
        return float(self.beta[0] / self.beta[1])

    @property
    def td(self) -> float:
        return float(self.beta[2] / self.beta[0]) if self.form.derivative else 0.0

    @property
    def cost(self) -> float:
        return float(self.loss.sum())

    @property
    def sane(self) -> bool:
        """A controller that somebody may have built."""
        delay, ti, td = self.form.filter.order * self.form.filter.tf, self.ti, self.td
        if not self.form.derivative:
            return ti > 0 and delay <= ti
        return ti > 0 and max(delay, 2 * self.form.filter.tfd) <= td <= ti


class _Band:
    """The regression at one length m of the means, with a weight for every move."""

    def __init__(self, signals: _Signals, start: NDArray[np.int64], m: int) -> None:
        self.signals, self.start, self.m = signals, start, m
        self.op, self.setpoint = self._moves(signals.op), self._moves(signals.setpoint)
        # What the sums round off is no move of SP.
        self.setpoint[np.abs(self.setpoint) < 1e-9 * np.max(np.abs(signals.sp))] = 0.0
        self.sp_moves = signals.sp_moves and bool(self.setpoint.any())
        length = int(start[-1] - start[0]) + 1
        blocks = int(np.clip(length // (5 * m), *_BLOCKS))
        self.cut = np.flatnonzero(np.diff((start - start[0]) * blocks // length, prepend=-1))
        self.weight = np.ones(start.size)
        self.kept: dict[_Filter, Floats] = {}

    def _moves(self, sums: Floats) -> Floats:
        k, m = self.start, self.m
        return np.asarray((sums[k + 2 * m] - 2 * sums[k + m] + sums[k]) / m)

    def _columns(self, law: _Filter, keep: bool) -> Floats:
        """Moves of OP, of P, I and D, and of SP where its weight is sought."""
        if law in self.kept:
            return self.kept[law]
        parts = [self.op[:, None], self._moves(self.signals.parts(law, keep))]
        columns = np.concatenate(parts + [self.setpoint[:, None]] * self.sp_moves, axis=1)
        if keep:
            self.kept[law] = columns
        return columns

    def laws(self, forms: list[_Form], fitted: bool = False) -> dict[_Form, _Law]:
        """Every form's values, by weighted least squares; none where the moves do not determine them."""
        found = {}
        for derivative in (False, True):
            filters = [form.filter for form in forms if form.derivative == derivative]
            if not filters:
                continue
            columns = np.stack([self._columns(one, not fitted) for one in filters])
            if not derivative:
                columns = np.delete(columns, 3, axis=2)
            moments = (columns * self.weight[:, None]).transpose(0, 2, 1) @ columns
            size = np.sqrt(np.diagonal(moments, axis1=1, axis2=2))
            known = np.all((size > 0) & (size < 1e150), axis=1)
            size[~known] = 1.0
            scaled = moments / size[:, :, None] / size[:, None, :]
            scaled[~known] = np.eye(size.shape[1])
            known &= np.linalg.cond(scaled[:, 1:, 1:]) < 1e10
            scaled[~known] = np.eye(size.shape[1])
            beta = np.linalg.solve(scaled[:, 1:, 1:], scaled[:, 1:, :1])[:, :, 0] * size[:, :1] / size[:, 1:]
            x = columns[:, :, 1:]
            residual = columns[:, :, 0] - (x @ beta[:, :, None])[:, :, 0]
            loss = np.add.reduceat(self.weight * residual * residual, self.cut, axis=1)
            known &= np.all((np.abs(beta[:, :2]) > 1e-100) & (np.abs(beta[:, :2]) < 1e100), axis=1)
            for i in np.flatnonzero(known & np.all(np.isfinite(loss), axis=1)):
                form = _Form(filters[i], derivative)
                found[form] = _Law(form, beta[i], x[i], residual[i], loss[i], moments[i], fitted)
        return found

    def reweight(self, form: _Form, shape: str, rounds: int, fitted: bool = False) -> None:
        """Weights by which no few moves rule the fit of one form."""
        self.weight = np.ones(self.start.size)
        before = math.inf
        for _ in range(rounds):
            law = self.laws([form], fitted).get(form)
            if law is None:
                return
            self.weight = _weight(_standardised(law.residual), shape)
            if abs(law.k - before) <= 1e-7 * abs(law.k):
                return
            before = law.k

    def r2(self, law: _Law, op_noise: float) -> float:
        """Share of the moves that the law explains, of every usable stretch; what OP's rounding does is no failure."""
        whole = self.signals.band(self.m, _EVERY)
        assert whole is not None
        columns = whole._columns(law.form.filter, False)[:, 1:]
        x = columns if law.form.derivative else np.delete(columns, 2, axis=1)
        residual = whole.op - x[:, : law.beta.size] @ law.beta
        off = whole.op - whole.op.mean()
        total = float(off @ off)
        rest = max(float(residual @ residual) - 2 / self.m * op_noise * residual.size, 0.0)
        return 1 - rest / total if total > 0 else 0.0

    def searched(self, forms: list[_Form]) -> list[_Law]:
        """The sane laws of these forms and of those with better times, the best first."""
        self.reweight(_PLAIN, "huber", 8)
        laws = _sane(self.laws(forms))
        if not laws:
            return []
        self.reweight(laws[0].form, "tukey", 15)
        laws = _sane(self.laws(forms))
        if not laws:
            return []
        starts: dict[tuple[bool, int, bool, bool], _Law] = {}
        for law in laws:
            if law.form.filter.time and law.cost <= _PROMISING * laws[0].cost:
                starts.setdefault(law.form.kind, law)
        refined = self.refined(list(starts.values()))
        best = min([laws[0], *refined], key=lambda law: law.cost)
        self.reweight(best.form, "tukey", 15, best.fitted)
        better = [law.form for law in refined if law.fitted]
        return _sane(self.laws([law.form for law in laws]) | self.laws(better, True))

    def refined(self, laws: list[_Law]) -> list[_Law]:
        """Gauss and Newton in the time constants, all at once."""
        done: list[_Law] = []
        for _ in range(10):
            steps = [self.step(law, slope) for law, slope in zip(laws, self.slopes(laws), strict=True)]
            better: dict[_Form, _Law] = {}
            for factor in (1.0, 0.25, 0.0625):
                tried = {
                    law.form: law.form.slower(1 + factor * step)
                    for law, step in zip(laws, steps, strict=True)
                    if law.form not in better and abs(step) > 1e-9
                }
                new = self.laws(list(tried.values()), True)
                for law in laws:
                    other = new.get(tried[law.form]) if law.form in tried else None
                    if other is not None and other.sane and other.cost < law.cost:
                        better[law.form] = other
            done += [better.get(law.form, law) for law in laws if not _much_better(better.get(law.form), law)]
            laws = [better[law.form] for law in laws if _much_better(better.get(law.form), law)]
        return done + laws

    def slopes(self, laws: list[_Law]) -> list[Floats]:
        """What a relative change of each filter's time would add to the moves."""
        slopes = []
        for law in laws:
            columns = self._columns(law.form.slower(1.001).filter, False)[:, 1:]
            x = columns if law.form.derivative else np.delete(columns, 2, axis=1)
            slopes.append((x - law.x) @ law.beta / 1e-3)
        return slopes

    def step(self, law: _Law, slope: Floats) -> float:
        """Relative change of the filter's time that would make the residual smallest."""
        x = np.column_stack([law.x, slope])
        size = np.sqrt(self.weight @ (x * x))
        if not (np.all(size > 0) and np.all(np.isfinite(size))):
            return 0.0
        x = x / size
        inverse = _inverse((x * self.weight[:, None]).T @ x)
        if inverse is None:
            return 0.0
        change = float(inverse[-1] @ (x.T @ (self.weight * law.residual))) / float(size[-1])
        return min(max(change, -0.5), 1.0)

    def scatter(self, law: _Law) -> Floats | None:
        """Covariance of the values, by block sums of the scores, times the square of Student's t.

        Where the filter's time was fitted its error is added, up to the half octave to the next law that is tried.
        """
        spread = self._spread(law, law.x)
        if spread is None or not law.fitted:
            return spread
        slope = self.slopes([law])[0]
        free = self._spread(law, np.column_stack([law.x, slope]))
        error = _HALF_OCTAVE if free is None else min(math.sqrt(free[-1, -1]), _HALF_OCTAVE)
        weighted = law.x * self.weight[:, None]
        inverse = _inverse(weighted.T @ law.x, math.inf)
        assert inverse is not None  # or there were no law
        change = inverse @ (weighted.T @ slope) * error
        return spread + np.outer(change, change)

    def _spread(self, law: _Law, x: Floats) -> Floats | None:
        size = np.sqrt(self.weight @ (x * x))
        if not (np.all(size > 0) and np.all(np.isfinite(size))):
            return None
        x = x / size
        v = (_standardised(law.residual) / _TUKEY) ** 2
        slope = np.where(v < 1, (1 - v) * (1 - 5 * v), 0.0)  # derivative of the biweight's score
        inverse = _inverse((x * slope[:, None]).T @ x)
        if inverse is None:
            return None
        sums = np.add.reduceat(x * (self.weight * law.residual)[:, None], self.cut, axis=0)
        blocks = self.cut.size
        spread = (inverse / size[:, None]) @ sums.T * _student(blocks - 1) * math.sqrt(blocks / (blocks - 1))
        return np.asarray(spread @ spread.T)

    def span(self, law: _Law, op_noise: float) -> Floats:
        """Ends of K (without its sign), Ti, Td and b: an array of 4 x 2."""
        scatter = self.scatter(law)
        if scatter is None:
            return _ANYTHING
        return _hull([_ends(law, beta, scatter, self.signals.h) for beta in (law.beta, self.corrected(law, op_noise))])

    def corrected(self, law: _Law, op_noise: float) -> Floats:
        """The values if the noise of PV that its second differences allow was never seen by the controller.

        Noise in the move of the P part weakens K. It cannot be more than what leaves nothing unexplained, but for what
        OP's rounding does.
        """
        weight = float(self.weight.sum())
        noise = 2 / self.m * self.signals.noise[law.form.filter] * weight
        moments = law.moments.copy()
        moments[0, 0] -= min(2 / self.m * op_noise * weight, 0.95 * law.cost)
        size = np.sqrt(np.diag(moments))
        inverse = _inverse(moments / np.outer(size, size), 1e14)
        if inverse is None:
            return law.beta  # nothing is left unexplained
        moments[1, 1] -= min(noise, float(size[1] ** 2 / inverse[1, 1]))
        scaled = moments / np.outer(size, size)
        inverse = _inverse(scaled[1:, 1:], 1e14)
        return law.beta if inverse is None else np.asarray(inverse @ scaled[1:, 0] * size[0] / size[1:])


_ANYTHING = np.array([[-np.inf, np.inf]] * 4)


def _hull(spans: list[Floats]) -> Floats:
    ends = np.array(spans)
    return np.stack([ends[:, :, 0].min(axis=0), ends[:, :, 1].max(axis=0)], axis=1)


def _ends(law: _Law, beta: Floats, scatter: Floats, h: float) -> Floats:
    """Ends of K, Ti, Td and b about some values."""
    k, ki = float(beta[0]), float(beta[1])
    ti = k / ki if ki else math.nan
    if not (np.all(np.isfinite(beta)) and ti > 0 and k * law.k > 0):
        return _ANYTHING
    errors = np.sqrt(np.diag(scatter)) / abs(k)
    relative = scatter[:2, :2] / np.outer(beta[:2], beta[:2])
    k_error = float(errors[0]) + _SURE
    ti_error = math.sqrt(max(float(relative[0, 0] + relative[1, 1] - 2 * relative[0, 1]), 0.0)) + _SURE
    # Current, mean or previous error within a step: the same fit with Ti, Ti + h/2 or Ti + h, and K in proportion.
    early, late = (0.0, h) if law.form.filter.scans else (-h / 2, h / 2)
    ends = [
        (abs(k) * (1 - k_error) + abs(ki) * early, abs(k) * (1 + k_error) + abs(ki) * late),
        (ti / (1 + ti_error) + early, ti / (1 - ti_error) + late if ti_error < 1 else math.inf),
        (0.0, 0.0),
        (-math.inf, math.inf),
    ]
    if law.form.derivative:
        td, error = float(beta[2]) / k, float(errors[2])
        ends[2] = (max(td * (1 - _SURE) - error + early, 0.0), td * (1 + _SURE) + error + late)
    rest = 3 if law.form.derivative else 2
    if beta.size > rest:
        b = float(beta[rest]) / k
        ends[3] = (b - float(errors[rest]), b + float(errors[rest]))
    return np.array(ends)


def _sane(laws: dict[_Form, _Law]) -> list[_Law]:
    return sorted((law for law in laws.values() if law.sane), key=lambda law: law.cost)


def _much_better(new: _Law | None, old: _Law) -> TypeGuard[_Law]:
    return new is not None and new.cost < 0.99 * old.cost


def _as_good(law: _Law, best: _Law) -> bool:
    """Whether a law predicts no worse than the best, by the logarithms of their squares in every block."""
    tiny = 1e-20 * float(best.moments[0, 0]) / best.loss.size
    ratio = np.log((law.loss + tiny) / (best.loss + tiny))
    return bool(ratio.mean() <= _WORSE * (ratio.std(ddof=1) / math.sqrt(ratio.size)) + 1e-9)


def _forms(h: float, longest: float) -> list[_Form]:
    """PI and PID, behind every filter with times of h/4 up to `longest` in octaves."""
    times = [h * 2.0**octave for octave in range(-2, max(2, math.ceil(math.log2(longest / h))) + 1)]
    forms = []
    for scans in (True, False):
        filters = [_Filter(scans)] + [_Filter(scans, order, tf) for order in (1, 2) for tf in times]
        forms += [_Form(one, derivative) for one in filters for derivative in (False, True)]
        forms += [_Form(_Filter(scans, tfd=tfd), True) for tfd in times]
    return forms


@dataclass(frozen=True, slots=True)
class _Found:
    """What one length of the means tells: the law shown, the hull of all that are as good, its width in logarithms."""

    m: int
    law: _Law
    span: Floats
    width: float
    r2: float


def _found(band: _Band, laws: list[_Law], op_noise: float) -> _Found:
    good = [law for law in laws if _as_good(law, laws[0])]
    span = _hull([band.span(law, op_noise) for law in good])
    shown = next((law for law in good if not law.form.derivative), good[0])
    if not shown.form.filter.time:
        # Without a filter the two clocks give the same fit; that every sample was a scan shows in the residual.
        rounding = 2 * op_noise / band.m + 1e-12 * float(np.mean(band.op**2))
        scans = shown.cost <= 1.5 * rounding * float(band.weight.sum())
        same = _Form(_Filter(scans), shown.form.derivative)
        shown = next((law for law in good if law.form == same), shown)
    width = math.inf
    if np.all(span[:2, 0] > 0):
        width = float(np.max(np.log(span[:2, 1] / span[:2, 0])))
    return _Found(band.m, shown, span, width, band.r2(shown, op_noise))


def _inverse(a: Floats, condition: float = 1e10) -> Floats | None:
    if not np.all(np.isfinite(a)) or np.linalg.cond(a) > condition:
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


def _filtered(x: Floats, tf: float, h: float, scans: bool) -> Floats:
    """Pass x through a lag: yf += (x - yf) h/(Tf + h) once a sample, or that of a signal straight between samples."""
    if scans:
        a, now, before = tf / (tf + h), h / (tf + h), 0.0
    else:
        a = math.exp(-h / tf)
        mean = tf / h * (1 - a)
        now, before = 1 - mean, mean - a
    y = now * x + before * np.concatenate((x[:1], x[:-1]))
    # In blocks: a matrix for what happens within one, a short loop to carry the state over.
    size = 64
    power = a ** np.arange(size + 1)
    ages = np.subtract.outer(np.arange(size), np.arange(size))
    within = np.where(ages >= 0, power[np.abs(ages)], 0.0)
    blocks = np.pad(y, (0, -y.size % size)).reshape(-1, size) @ within.T
    state = x[0]
    for block in blocks:
        block += state * power[1:]
        state = block[-1]
    return np.asarray(blocks.ravel()[: x.size])


_UNSHOWN = "the moves of PV and the area of the error do not each show in OP (a single step, a ramp?): give K and Ti"


def _identify(
    t: Floats, sp: Floats, pv: Floats, op: Floats, step: Bools, h: float, samples: int, given_b: float | None
) -> Identification:
    grid = resolution(op)
    op_noise = grid[0] * grid[0] / 12 if grid and grid[0] < 1e100 else 0.0
    lag, bands = 0, _bands(_Signals(t, sp, pv, op, step, h, given_b, 0))
    if not bands:
        return _nothing(_UNSHOWN, samples)
    forms = _forms(h, bands[-1].m * h / 4)
    # OP recorded a sample late or early: where that leaves a quarter as much unexplained as any law without.
    least = _unexplained(bands, forms)
    for other in (1, -1) if least > 1e-3 else ():
        shifted = _bands(_Signals(t, sp, pv, op, step, h, given_b, other))
        if shifted and (rest := _unexplained(shifted, [_PLAIN])) < 0.25 * least:
            lag, bands, least = other, shifted, rest
            forms = [form for form in forms if not form.filter.time]
    found = []
    for band in bands:
        laws = band.searched(forms)
        if laws:
            found.append(_found(band, laws, op_noise))
    if not any(math.isfinite(one.span[0, 0]) for one in found):
        return _insane(bands, samples)
    return _judge(found, lag, h, samples, given_b)


def _bands(signals: _Signals) -> list[_Band]:
    """Means of 1, 2, 4 ... samples, up to two Ti: beyond, the proportional part hardly shows in the moves any more."""
    bands: list[_Band] = []
    while (band := signals.band(2 ** len(bands), _MOVES)) is not None:
        bands.append(band)
        band.reweight(_PLAIN, "huber", 8)
        plain = band.laws([_PLAIN]).get(_PLAIN)
        if plain is not None and plain.ti > 0 and band.m * signals.h > 2 * plain.ti and band.m >= 4:
            break
    return bands


def _unexplained(bands: list[_Band], forms: list[_Form]) -> float:
    """Share of OP's moves between means of some samples that the best of the laws leaves."""
    band = bands[min(2, len(bands) - 1)]
    band.reweight(_PLAIN, "huber", 8)
    laws = _sane(band.laws(forms))
    return 1 - band.r2(laws[0], 0.0) if laws else math.inf


def _insane(bands: list[_Band], samples: int) -> Identification:
    """Say what is wrong where no law comes out with values that a controller could have."""
    best: tuple[float, _Law, Floats] | None = None
    for band in bands:
        band.reweight(_PLAIN, "tukey", 15)
        law = band.laws([_PLAIN]).get(_PLAIN)
        scatter = band.scatter(law) if law is not None else None
        if law is None or scatter is None:
            continue
        r2 = band.r2(law, 0.0)
        if best is None or r2 > best[0]:
            best = r2, law, np.sqrt(np.diag(scatter))
    if best is None:
        return _nothing(_UNSHOWN, samples)
    r2, law, errors = best
    if r2 < R2_USABLE:
        reason = _too_little(r2)
    elif abs(law.k) <= errors[0]:
        reason = f"K cannot be told from 0 ({law.k:.3g} +- {errors[0]:.2g} OP units per PV unit): give K and Ti"
    elif abs(law.beta[1]) <= errors[1]:
        reason = _NO_INTEGRAL
    elif law.ti < 0:
        reason = f"K and K/Ti have opposite signs (Ti {law.ti:.3g} s), so this is no PI controller: give K and Ti"
    else:
        reason = "laws that explain OP equally well contradict each other even in the sign of K: give K and Ti"
    return replace(_nothing(reason, samples), k=law.k, ti=law.ti, r2=r2)


_NO_INTEGRAL = "integral action cannot be told from none: give K and Ti"


def _too_little(r2: float) -> str:
    return (
        f"no PI or PID law explains enough of OP's moves (R² {r2:.3g}, needed {R2_USABLE:g}): "
        "give K and Ti, or take a recording in auto that is neither compressed nor averaged"
    )


def _judge(found: list[_Found], lag: int, h: float, samples: int, given_b: float | None) -> Identification:
    # A coarse OP hides the law in short means; a wrong law is not mended by longer ones.
    best = min(found, key=lambda one: (one.r2 < R2_USABLE, one.width, not math.isfinite(one.span[0, 0]), -one.r2))
    law = best.law
    alike = [one.span for one in found if one.width <= _AGREEING * best.width < math.inf]
    span = _hull(alike or [best.span])
    # Lengths that contradict each other show that a law is missing: then neither is right alone.
    for one in found:
        apart = np.any((one.span[:2, 1] < span[:2, 0]) | (one.span[:2, 0] > span[:2, 1]))
        if apart and one.width < math.inf and one.r2 >= R2_USABLE:
            span = _hull([span, one.span])
    (k_low, k_high), (ti_low, ti_high), (td_low, td_high), _ = span.tolist()
    b, b_note = given_b, ""
    surest = min(found, key=lambda one: float(one.span[3, 1] - one.span[3, 0]))
    b_low, b_high = surest.span[3].tolist()
    if b_high - b_low < 0.5:
        raw = float(surest.law.beta[-1]) / surest.law.k
        b, b_note = min(max(raw, 0.0), 1.0), f"; setpoint weight {raw:.2f} ({b_low:.2f} to {b_high:.2f}) fitted"

    reason = ""
    if best.r2 < R2_USABLE:
        reason = _too_little(best.r2)
    elif not k_low > 0:
        reason = f"K cannot be told from 0 ({abs(law.k):.3g}, {k_low:.3g} to {k_high:.3g}): give K and Ti"
    elif not math.isfinite(ti_high):
        reason = _NO_INTEGRAL
    elif max(k_high / k_low, ti_high / ti_low) > WIDEST:
        reason = (
            f"K may be {k_low:.3g} to {k_high:.3g} and Ti {ti_low:.3g} to {ti_high:.3g} s, since laws with and without "
            f"filter, D part and delay explain OP as well: give K and Ti, or record more often than every {h:.3g} s, "
            "with more digits, or while the setpoint moves"
        )
    low, high = (k_low, k_high) if law.k > 0 else (-k_high, -k_low)
    return Identification(
        k=law.k,
        ti=law.ti,
        k_low=low,
        k_high=high,
        ti_low=ti_low,
        ti_high=ti_high,
        r2=best.r2,
        samples=samples,
        setpoint_weight=b,
        note=_note(best, lag, h, td_low, td_high) + b_note,
        usable=not reason,
        reason=reason,
        td=law.td,
        td_low=td_low,
        td_high=td_high,
    )


def _note(best: _Found, lag: int, h: float, td_low: float, td_high: float) -> str:
    law, by = best.law, best.law.form.filter
    kind = "PID" if law.form.derivative else "PI"
    parts = [f"robust fit of a {kind} law to means of {best.m} samples ({best.m * h:.4g} s)"]
    if by.order:
        parts.append(f"the controller filters PV, which is recorded unfiltered ({by.order} x Tf {by.tf:.3g} s)")
    if by.tfd:
        parts.append(f"its D part is filtered (Tf {by.tfd:.3g} s)")
    if lag:
        parts.append(f"OP recorded one sample {'late' if lag > 0 else 'early'}")
    if law.form.derivative and not td_low > 0:
        parts.append("lengths of the means disagree whether there is a D part")
    elif not law.form.derivative and td_high > 0:
        parts.append(f"a D part of up to {td_high:.3g} s behind a filter would explain OP as well")
    return "; ".join(parts)
