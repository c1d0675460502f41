"""The manual test for backlash, read off a recording: OP is stepped by hand, held, stepped on and stepped back.

A gap of total width d lets the valve follow OP only at its edges.  Where OP last drove it in direction s (+1 up, -1
down) and is held, a self-regulating process settles at

    PV = a + Kp (OP - s d/2).

A move in the same direction as the last one therefore gives the process gain, (8.1) and (8.2) of the thesis,

    Kp = dPV / dOP,

and a reversal gives the gap, the part of OP's move that PV does not answer,

    d = |dOP| - |dPV| / Kp.

`docs/bump.md` tells how holds, settling, noise and drift are treated, and how often the interval held the truth.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError
from .estimate import op_range, with_op_unit
from .identify import resolution
from .loop import Loop
from .quality import GAP_STEPS
from .recording import NOT_AUTO, Batch, Recording
from .samples import recording_of

if TYPE_CHECKING:
    import plotly.graph_objects as go

__all__ = ["Bump", "Hold", "Reading", "bump"]

Floats = NDArray[np.float64]

LEAST_ROWS = 10
"""Rows that a hold, and the settled part of one, must have."""

TAILS = 5.0
"""Time constants of the tail that must pass before PV counts as settled: 0.7 % of the response is left."""

SURE = 5e-4
"""One-sided probability below which PV is said to have answered a move."""

_MOST_HOLDS = 60
_BLOCKS = 16  # means a settled hold is cut into: enough to see drift, long enough to leave noise uncorrelated
_SLOPES = 4  # the same where slopes are read: their certainty falls with the third power of a block's length
_DRIFT = np.logspace(-4, 3, 29)  # variance of the random walk over one block, relative to that of a block's mean
_FREEDOM = 5  # least degrees of freedom behind an interval
_MISFIT = 4.0  # F ratio from which holds that lie off the model widen the interval
_TURN = "OP turned between two holds without being held"


@dataclass(frozen=True, slots=True)
class Hold:
    """One stretch in which OP was held.

    Attributes
    ----------
    start, end : float
        Its time [s since the first row].
    settled : float | None
        Time from which PV is taken as settled; None where it ended before that.
    op : float
        OP [its unit].
    level : float | None
        Mean of PV when settled (of an integrating process: its slope [PV unit/s]); None where not settled.
    side : int
        +1 where OP then pressed the valve upwards, -1 downwards, 0 where that is not known or the hold is not used.
    """

    start: float
    end: float
    settled: float | None
    op: float
    level: float | None = None
    side: int = 0


@dataclass(frozen=True, slots=True)
class Reading:
    """What one move from hold to hold tells.

    Attributes
    ----------
    kind : {"gain", "gap", "none"}
        A move in the same direction as the last (Kp), a reversal (d), or one that tells nothing.
    start, end : float
        From the end of the hold before to the end of the hold after [s since the first row].
    op : (float, float)
        OP before and after.
    pv : (float, float)
        Settled PV (or slope) before and after.
    value, low, high : float | None
        Kp [PV unit per OP unit] or d [OP unit] with its 95 % interval.
    evidence : str
        The numbers it was read from, or why it tells nothing.
    """

    kind: Literal["gain", "gap", "none"]
    start: float
    end: float
    op: tuple[float, float]
    pv: tuple[float, float]
    value: float | None
    low: float | None
    high: float | None
    evidence: str


@dataclass(frozen=True, slots=True)
class Bump:
    """Gap and process gain as a manual test shows them, or why it shows none.

    Attributes
    ----------
    name, source : str
        Loop, and the file it was recorded in.
    d, low, high : float | None
        Total width of the dead band at the valve's input [`unit`] and its 95 % interval, none of them below 0. With
        `d` None, `low` may still be a lower bound: OP reversed by so much, and PV did not answer.
    unit, pv_unit : str
        Units of OP and PV.
    d_percent_span : float | None
        `d` in % of OP span, None where the span is not known.
    kp, kp_low, kp_high : float | None
        Static process gain [PV unit per OP unit] with its 95 % interval; of an integrating process the velocity gain
        [PV unit per OP unit and s].
    integrating : bool
        Whether slopes were read instead of levels.
    settle : float | None
        Time that PV was given to settle after each move [s].
    holds, readings : tuple
        Where OP was held, and what each move tells.
    reason : str | None
        Why there is no width; None where there is one.
    notes : tuple of str
        What a person should know beside the numbers.
    travel : Bump | None
        The same read off the valve's position, where it was recorded: PV stands for travel, Kp for travel per OP.
    t0 : datetime | None
        Time of the recording's first row, where it has dates.
    signals : Batch | None
        The rows looked at, for the picture.
    """

    name: str
    source: str
    unit: str
    pv_unit: str
    reason: str | None
    d: float | None = None
    low: float | None = None
    high: float | None = None
    d_percent_span: float | None = None
    kp: float | None = None
    kp_low: float | None = None
    kp_high: float | None = None
    integrating: bool = False
    settle: float | None = None
    holds: tuple[Hold, ...] = ()
    readings: tuple[Reading, ...] = ()
    notes: tuple[str, ...] = ()
    travel: Bump | None = None
    t0: datetime | None = None
    signals: Batch | None = field(default=None, repr=False, compare=False)

    def plot(self) -> go.Figure:
        """A zoomable figure: PV and OP with what was held, what had settled, and each reading in its place."""
        from .report.figures import bump_figure

        return bump_figure(self)

    def to_dict(self) -> dict[str, Any]:
        """All but the signals, as JSON has it."""
        told = asdict(replace(self, signals=None, travel=None))
        del told["signals"]
        told["t0"] = None if self.t0 is None else self.t0.isoformat()
        return told | {"travel": None if self.travel is None else self.travel.to_dict()}


def bump(
    recording: Recording | None = None,
    *,
    t: ArrayLike | None = None,
    pv: ArrayLike | None = None,
    op: ArrayLike | None = None,
    position: ArrayLike | None = None,
    flags: ArrayLike | None = None,
    loop: Loop | None = None,
    manual: bool = False,
) -> Bump:
    """Read gap and process gain off the manual test that a recording holds.

    Looked at are the stretches in which the controller was not in automatic.  A test that can be read holds OP, after
    each move until PV has settled, and makes at least two moves in one direction and one back: the first move after
    the controller was put in manual tells nothing, since where in its gap the valve then stood is not known.

    Known bias: a step response with a tail much slower than its beginning settles later than is assumed.  A valve that
    sticks and slips has no one width; its readings scatter, and a note says so.

    Parameters
    ----------
    recording : Recording
        From `glapp.recording_from` or `glapp.open_recordings`.  Setting `process.type` to "integrating" makes it read
        slopes instead of levels.  Or, in its place:
    t, pv, op, position, flags : array[n]
        Samples: time [s] or datetime64; process value [PV unit], controller output [OP unit], the valve's measured
        position [%]; sum of 1 not in automatic, 2 bad, 4 OP at its low, 8 at its high limit.  NaN is a bad value.
    loop : Loop
        Settings that go with samples.
    manual : bool
        Take the whole recording as made in manual; for one without a mode column.

    Returns
    -------
    Bump
        With `reason` where the recording does not hold such a test.

    Raises
    ------
    InputError
        Where the recording cannot be read, or `manual` is given for one that has a mode column.

    Examples
    --------
    >>> import glapp
    >>> steps = [(0, 100, 50.0), (100, 200, 53.0), (200, 300, 56.0), (300, 400, 52.0)]
    >>> sim = glapp.simulate.closed_loop(([0.8], [5, 1], 0), (0.5, 10), d=2.0, noise=0.05, h=1.0, t_end=400,
    ...                                  manual=steps, setpoint=[(0, 40.0)])
    >>> found = glapp.bump(glapp.recording_from(sim.to_arrow()))
    >>> print(f"{found.d:.1f} ({found.low:.1f} to {found.high:.1f}), Kp {found.kp:.1f}")
    2.0 (1.9 to 2.0), Kp 0.8
    """
    recording = recording_of(recording, loop, t=t, pv=pv, op=op, position=position, flags=flags)
    has_mode = "MODE" in recording.columns
    if manual and has_mode:
        raise InputError(
            "is for recordings without a mode column, and this one has one",
            file=recording.source,
            loop=recording.name,
            column=recording.columns["MODE"],
            parameter="manual",
        )
    found_rows = _rows(recording.batches(), manual)
    rows, number = found_rows if found_rows is not None else (None, None)
    loop = recording.loop if rows is None else with_op_unit(recording.loop, rows)
    blank = Bump(
        recording.name,
        recording.source,
        loop.op_label,
        loop.pv_unit or "PV unit",
        reason="",
        integrating=loop.process.type == "integrating",
        t0=recording.t0,
        signals=rows,
    )
    if "OP" not in recording.columns:
        return replace(blank, reason="OP was not recorded; the test is read off OP and PV")
    if not (manual or has_mode):
        return replace(blank, reason="no mode column tells when the loop was in manual; if it always was, say --manual")
    if rows is None or number is None:
        return replace(
            blank, reason="the loop was never in manual; put it in manual, step OP twice one way and once back"
        )
    assert rows.op is not None
    stretches = _stretches(rows, number)
    if not stretches:
        return replace(blank, reason=f"no manual stretch of {LEAST_ROWS} rows without gaps in time or in OP")
    found = _Test(rows.t, rows.op, rows.pv, stretches, blank).answer()
    if rows.position is not None and np.isfinite(rows.position).any():
        at_valve = replace(blank, pv_unit="% travel", integrating=False, signals=None)
        travel = _Test(rows.t, rows.op, rows.position, stretches, at_valve, "the valve").answer()
        found = replace(found, travel=travel)
    if found.d is None:
        return found
    span, positioner = op_range(loop), loop.positioner
    percent = None if span is None else (span[1] - span[0]) / 100
    if percent is not None:
        found = replace(found, d_percent_span=found.d / percent)
    if positioner is not None and positioner.dead_band is not None:
        own = f"{positioner.dead_band:.3g} % of travel"
        if percent is not None:
            own += f", {positioner.dead_band * percent:.3g} {blank.unit}"
        found = replace(found, notes=(*found.notes, f"the positioner's own part of it, by its settings: {own}"))
    return found


def _rows(batches: Iterable[Batch], manual: bool) -> tuple[Batch, NDArray[np.int64]] | None:
    """The rows in manual, all in one, with their numbers in the recording; None where there is not one."""
    kept: list[tuple[Batch, NDArray[np.int64]]] = []
    done = 0
    for batch in batches:
        mode = np.zeros(len(batch), np.uint8) if batch.flags is None else batch.flags & NOT_AUTO
        rows = np.flatnonzero((mode != 0) | manual)
        if batch.op is not None and len(rows):
            place = None if batch.position is None else batch.position[rows]
            part = Batch(batch.t[rows], None, batch.pv[rows], batch.op[rows], None, place)
            kept.append((part, rows + done))
        done += len(batch)
    if not kept:
        return None

    def joined(name: str) -> Any:
        parts = [getattr(batch, name) for batch, _ in kept]
        return None if parts[0] is None else np.concatenate(parts)

    whole = Batch(joined("t"), None, joined("pv"), joined("op"), None, joined("position"))
    return whole, np.concatenate([rows for _, rows in kept])


def _stretches(rows: Batch, number: NDArray[np.int64]) -> list[slice]:
    """Runs of rows in manual with OP and without a gap in time: a move in a gap would not be seen."""
    assert rows.op is not None
    dt = np.diff(rows.t)
    forward = dt[dt > 0]
    if not len(forward):
        return []
    known = np.isfinite(rows.op)
    together = (dt > 0) & (dt <= GAP_STEPS * float(np.median(forward))) & (np.diff(number) == 1)
    cuts = [0, *(np.flatnonzero(~(together & known[1:] & known[:-1])) + 1).tolist(), len(rows)]
    return [slice(a, b) for a, b in pairwise(cuts) if b - a >= LEAST_ROWS]


def _held(op: Floats) -> tuple[list[tuple[int, int]], float]:
    """Rows (first, after the last) in which OP stayed where it was, and what that allows for OP's own noise."""
    noise = 1.4826 * float(np.median(np.abs(np.diff(op, 2)))) / math.sqrt(6)  # a ramp has no second difference
    tolerance = max(8 * noise, 1e-3 * float(np.ptp(op)))
    runs = [0, *(np.flatnonzero(np.diff(op)) + 1).tolist(), len(op)]
    found, first = [], 0
    low = high = float(op[0])
    for begin, _ in pairwise(runs):
        value = float(op[begin])
        low, high = min(low, value), max(high, value)
        if high - low > tolerance:
            found.append((first, begin))
            first, low, high = begin, value, value
    found.append((first, len(op)))

    def rests(a: int, b: int) -> bool:
        middle = (a + b) // 2  # a piece of a slow ramp wanders all through its tolerance
        return b - a >= LEAST_ROWS and bool(abs(op[a:middle].mean() - op[middle:b].mean()) <= tolerance / 4)

    return [(a, b) for a, b in found if rests(a, b)], tolerance


@dataclass(slots=True)
class _Node:
    """A hold in rows of the whole: its OP, stretch and settled rows, and what the readings make of it."""

    first: int
    end: int
    stretch: int
    op: float
    settled: int | None = None  # first settled row
    side: int = 0


class _Posterior:
    """Regression of block means with noise and drift of unknown size.

    y = X beta + w + v: w a random walk within each stretch of the recording, v white with a variance inverse to the
    block's rows.  The ratio of the two variances is integrated over, with the weight that the data give it (restricted
    likelihood, flat in its logarithm); given the ratio, beta has Student's distribution.  `extra` is a variance common
    to all blocks of one hold, known beforehand, such as that of a coarse PV.
    """

    def __init__(self, x: Floats, blocks: _Blocks, extra: float, widen: float = 1.0) -> None:
        n, p = x.shape
        self.freedom = n - p
        walk = blocks.walk()
        unit = float(np.mean(1 / blocks.rows)) / float(np.mean(blocks.width))
        shared = (blocks.hold[:, None] == np.unique(blocks.hold)).astype(float)
        floor = (1e-9 * float(np.max(np.abs(blocks.y))) + 1e-100) ** 2  # a PV without noise, or always 0
        # In these axes v has the variance 1 and w one of its own for each, whatever the ratio: both stay diagonal.
        root = np.sqrt(blocks.rows)[:, None]
        size, axes = np.linalg.eigh(root * walk * root.T)
        variance = 1 + np.outer(_DRIFT * unit, np.maximum(size, 0.0))
        white = axes.T @ (root * np.column_stack([x, blocks.y, shared])) / np.sqrt(variance)[:, :, None]
        xw, yw, sharedw = white[:, :, :p], white[:, :, p : p + 1], white[:, :, p + 1 :]
        transposed = xw.transpose(0, 2, 1)
        inverse = np.linalg.inv(transposed @ xw)
        beta = inverse @ (transposed @ yw)
        self.rss = np.sum((yw - xw @ beta) ** 2, axis=(1, 2))
        gain = inverse @ (transposed @ sharedw)
        noise = np.maximum(self.rss / self.freedom, floor) * widen
        self._beta = beta[:, :, 0]
        self._covariance = noise[:, None, None] * inverse + extra * gain @ gain.transpose(0, 2, 1)
        logs = 0.5 * (np.linalg.slogdet(inverse)[1] - np.log(variance).sum(axis=1))
        logs -= 0.5 * self.freedom * np.log(np.maximum(self.rss, floor * self.freedom))
        weight = np.exp(logs - logs.max())
        self._weight = weight / weight.sum()
        self.best = int(np.argmax(logs))

    def below(self, x: float, over: Floats) -> float:
        """Probability that over'beta is below x."""
        return float(self._distribution(over)(np.array([x]))[0])

    def interval(self, over: Floats, under: Floats | None = None) -> tuple[float, float, float]:
        """Median and 95 % interval of over'beta, or of its ratio to under'beta > 0 as Fieller has it."""
        below = self._distribution(over, under)
        middle, reach = self._rough(over)
        if under is not None:
            divisor, of_it = self._rough(under)
            middle, reach = middle / divisor, reach / divisor + abs(middle) * of_it / divisor**2
        reach = 100 * reach + 1e-12 * abs(middle)
        shares = np.array([0.5, 0.025, 0.975])
        low, high = np.full(3, middle - reach), np.full(3, middle + reach)
        for _ in range(40):
            half = (low + high) / 2
            short = below(half) < shares
            low, high = np.where(short, half, low), np.where(short, high, half)
        median, least, most = ((low + high) / 2).tolist()
        return median, least, most

    def _rough(self, c: Floats) -> tuple[float, float]:
        variance = self._weight @ np.einsum("i,kij,j->k", c, self._covariance, c)
        return float(self._weight @ self._beta @ c), math.sqrt(float(variance))

    def _distribution(self, over: Floats, under: Floats | None = None) -> Callable[[Floats], Floats]:
        over_mean, over_variance = self._beta @ over, np.einsum("i,kij,j->k", over, self._covariance, over)
        if under is None:
            return lambda x: self._share(x[:, None] - over_mean, over_variance)
        under_mean, both = self._beta @ under, np.einsum("i,kij,j->k", over, self._covariance, under)
        under_variance = np.einsum("i,kij,j->k", under, self._covariance, under)

        def below(x: Floats) -> Floats:
            x = x[:, None]
            return self._share(x * under_mean - over_mean, over_variance - 2 * x * both + x * x * under_variance)

        return below

    def _share(self, distance: Floats, variance: Floats) -> Floats:
        t = distance / np.sqrt(np.maximum(variance, 1e-300))
        share: Floats = _student(t, self.freedom) @ self._weight
        return share


def _student(t: Floats, freedom: int) -> Floats:
    """Student's distribution by Wallace's normal approximation, good to 0.001 from 5 degrees of freedom."""
    z = (8 * freedom + 1) / (8 * freedom + 3) * np.sqrt(freedom / 2 * np.log1p(t * t / freedom)) * np.sign(-t)
    return 0.5 * np.array([math.erfc(value) for value in z.ravel().tolist()]).reshape(z.shape)


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Means (or slopes) of pieces of settled holds: value, weight as a number of rows, middle and width in time."""

    y: Floats
    rows: Floats
    middle: Floats
    width: Floats
    hold: NDArray[np.int64]
    stretch: NDArray[np.int64]
    lag: float

    def of(self, keep: NDArray[np.bool_]) -> _Blocks:
        """Some of them."""
        names = ("y", "rows", "middle", "width", "hold", "stretch")
        return replace(self, **{name: getattr(self, name)[keep] for name in names})

    def walk(self) -> Floats:
        """Covariance of the means of a random walk of unit variance per second behind the process, up to a constant.

        Through a lag T it has -|r|/2 - T/2 exp(-|r|/T) over a distance r in time; each mean is taken at three points.
        """
        share = np.array([5, 8, 5]) / 18  # Gauss and Legendre
        at = self.middle[:, None] + self.width[:, None] * np.array([-1, 0, 1]) * math.sqrt(0.15)
        apart = np.abs(at[:, None, :, None] - at[None, :, None, :])
        lag = max(self.lag, 1e-9 * float(self.width.mean()))
        kernel = np.einsum("ijkl,k,l->ij", -apart / 2 - lag / 2 * np.exp(-apart / lag), share, share)
        kernel += np.max(apart) + lag  # each stretch has a level of its own, so a constant does not matter
        out: Floats = np.where(self.stretch[:, None] == self.stretch, kernel, 0.0)
        return out

    def drift(self) -> Floats:
        """Intercept and slope for each stretch, one column each."""
        columns = []
        for stretch in np.unique(self.stretch):
            inside = (self.stretch == stretch).astype(float)
            centre = self.middle[inside > 0].mean()
            length = max(float(np.ptp(self.middle[inside > 0])), 1e-300)
            columns += [inside, inside * (self.middle - centre) / length]
        return np.column_stack(columns)


class _Test:
    """One signal's answer (PV's or the position's) to the moves of OP."""

    def __init__(
        self, t: Floats, op: Floats, y: Floats, stretches: list[slice], blank: Bump, subject: str = "PV"
    ) -> None:
        self.t, self.op, self.y, self.blank, self.subject = t, op, y, blank, subject
        self.unit = "%OP" if blank.unit == "%" else blank.unit  # % alone would leave open of what
        self.h = float(np.median(np.concatenate([np.diff(t[part]) for part in stretches])))
        self.nodes: list[_Node] = []
        self.tolerance = 0.0
        for i, part in enumerate(stretches):
            held, tolerance = _held(op[part])
            self.tolerance = max(self.tolerance, tolerance)
            for a, b in held:
                a, b = a + part.start, b + part.start
                if np.count_nonzero(np.isfinite(y[a:b])) >= LEAST_ROWS:
                    self.nodes.append(_Node(a, b, i, float(np.median(op[a:b]))))

    def refused(self, reason: str, **more: Any) -> Bump:
        """The answer that there is none."""
        return replace(self.blank, reason=reason, **more)

    def answer(self) -> Bump:
        """Find what settled, what each move tells, and what they tell together."""
        subject = self.subject
        if not self.nodes:
            return self.refused(f"OP was never held for {LEAST_ROWS} rows in manual with a good {self.subject}")
        if len(self.nodes) < 2 or np.ptp([node.op for node in self.nodes]) <= self.tolerance:
            return self.refused("OP was held at one value only: in manual, step it twice one way and once back")
        settle = self._settle()
        h, settled = self.h, []
        for node in self.nodes:
            start, end = self.t[node.first], self.t[node.end - 1]
            wait = (end - start) / 2 if self.blank.integrating else settle
            if end - start >= wait + max(LEAST_ROWS * h, 0.2 * wait) - 1e-9 * h or self.blank.integrating:
                first = int(np.searchsorted(self.t[node.first : node.end], start + wait)) + node.first
                if np.count_nonzero(np.isfinite(self.y[first : node.end])) >= LEAST_ROWS:
                    node.settled = first
                    settled.append(node)
        told: dict[str, Any] = {"holds": self._holds({}), "settle": None if self.blank.integrating else settle}
        if len(settled) < 3:
            what = (
                f"{subject} did not settle before the next step: only {len(settled)} of {len(self.nodes)} holds last "
            )
            what += f"long enough for it ({settle * 1.2:.3g} s); hold OP for longer"
            if self.blank.integrating:
                what = f"only {len(settled)} holds last {2 * LEAST_ROWS} rows; hold OP for longer"
            else:
                what += ", or, if the process integrates (a level), say so: process = { type = 'integrating' }"
            return self.refused(what, **told)
        count = Counter(node.stretch for node in settled)
        return self._read([node for node in settled if count[node.stretch] > 1], settle, told)

    def _settle(self) -> float:
        """Time after a move until its answer is over [s]: see docs/bump.md."""
        moves: list[tuple[_Node, _Node, float, float, float, float]] = []
        for before, after in pairwise(self.nodes):
            if before.stretch != after.stretch:
                continue
            ends = self._last_third(before), self._last_third(after)
            noise = max(_scatter(y) for y in ends)
            old, new = (float(np.mean(y)) for y in ends)
            length = float(self.t[after.end - 1] - self.t[after.first])
            if abs(new - old) > 4 * noise / math.sqrt(max(min(len(y) for y in ends) / 5, 1)):
                moves.append((before, after, old, new, noise, length))
        if not moves:
            return LEAST_ROWS * self.h
        least = 0.5 * float(np.median([move[5] for move in moves]))
        moves = [move for move in moves if move[5] >= least]
        shortest = min(move[5] for move in moves)
        for bins in (100, 50, 25, 12):
            edges = np.linspace(0, shortest, bins + 1)
            left = np.zeros(bins)
            size = variance = 0.0
            for before, after, old, new, noise, _ in moves:
                since = self.t[after.first : after.end] - self.t[after.first]
                y = self.y[after.first : after.end]
                good = np.isfinite(y) & (since < shortest)
                count = np.histogram(since[good], edges)[0]
                if not count.any():
                    continue
                total = np.histogram(since[good], edges, weights=new - y[good])[0]
                value = np.interp(np.arange(bins), np.flatnonzero(count), (total / np.maximum(count, 1))[count > 0])
                # A step starts where the hold before ended; after a slow ramp most of the answer has already come.
                at_once = self.t[after.first] - self.t[before.end - 1] <= 2 * self.h
                begin = new - old if at_once else float(value[0])
                if begin * (new - old) <= 0 or abs(begin) < 3 * noise:
                    continue
                left += value if new > old else -value
                size += abs(begin)
                variance += noise**2 / max(float(np.mean(count)), 1.0)
            if size == 0 or math.sqrt(variance) < 0.03 * size:
                break
        if size == 0:
            return LEAST_ROWS * self.h
        # The whole answer is left at the move itself, what lies in a bin is told of its middle.
        times = np.concatenate([[0.0], (edges[1:] + edges[:-1]) / 2, edges[-1:]])
        share = np.concatenate([[1.0], np.abs(left) / size, [0.0]])
        one, two = (_last_crossing(times, share, math.exp(-k)) for k in (1, 2))
        return max(one + TAILS * max(two - one, 0.3 * float(edges[1])), LEAST_ROWS * self.h)

    def _last_third(self, node: _Node) -> Floats:
        y = self.y[node.end - (node.end - node.first + 2) // 3 : node.end]
        y = y[np.isfinite(y)]
        return y if len(y) else np.zeros(1)

    def _blocks(self, nodes: list[_Node], lag: float) -> _Blocks:
        """Settled rows in blocks: means, or for an integrating process slopes."""
        columns: list[tuple[float, float, float, float, int, int]] = []
        most = _SLOPES if self.blank.integrating else _BLOCKS
        for i, node in enumerate(nodes):
            assert node.settled is not None
            rows = np.arange(node.settled, node.end)
            rows = rows[np.isfinite(self.y[rows])]
            for part in np.array_split(rows, max(min(most, len(rows) // 4, 300 // len(nodes)), 3)):
                t, y = self.t[part], self.y[part]
                middle = float(t.mean())
                weight = float(len(part))
                value = float(y.mean())
                if self.blank.integrating:
                    weight = float(np.sum((t - middle) ** 2))
                    value = float(np.sum((t - middle) * y)) / weight
                columns.append((value, weight, middle, float(t[-1] - t[0]) + self.h, i, node.stretch))
        y, weights, middles, widths, holds, stretches = (np.array(column) for column in zip(*columns, strict=True))
        return _Blocks(y, weights / weights.mean(), middles, widths, holds, stretches, lag)

    def _coarse(self) -> float:
        """Variance that a coarse signal adds to a level."""
        if self.blank.integrating or len(np.unique(self.y)) <= len(self.nodes):  # a value a hold makes no grid
            return 0.0
        found = resolution(self.y)
        return 0.0 if found is None else found[0] ** 2 / 12

    def _read(self, nodes: list[_Node], settle: float, told: dict[str, Any]) -> Bump:
        if len(nodes) < 3 or np.ptp([node.op for node in nodes]) <= self.tolerance:
            return self.refused("fewer than three settled holds follow each other at different OP", **told)
        more = len(nodes) - _MOST_HOLDS
        nodes = nodes[:_MOST_HOLDS]
        blocks, extra = self._blocks(nodes, 0.0 if self.blank.integrating else settle / (1 + TAILS)), self._coarse()
        each = np.eye(len(nodes))
        drift = blocks.drift()[:, 1::2]  # a level for each hold leaves only the slopes
        x = np.column_stack([each[blocks.hold], drift])
        if len(blocks.y) - x.shape[1] < _FREEDOM:
            return self.refused("the holds are too short to tell noise from drift; hold OP for longer", **told)
        free = _Posterior(x, blocks, extra)
        ends = [np.concatenate([row, np.zeros(drift.shape[1])]) for row in each]
        levels = [
            float(np.average(blocks.y[blocks.hold == i], weights=blocks.rows[blocks.hold == i]))
            for i in range(len(nodes))
        ]
        changes = [
            (b.op - a.op) * (free.below(0.0, ends[i + 1] - ends[i]) - 0.5) for i, (a, b) in enumerate(pairwise(nodes))
        ]
        sign = -1.0 if sum(changes) > 0 else 1.0  # of Kp: below() is small where PV rose
        moves = self._moves(nodes, free, ends, sign)
        told["holds"] = self._holds({node.first: level for node, level in zip(nodes, levels, strict=True)})
        readings = [self._plain(move, nodes, levels) for move in moves]
        told["readings"] = tuple(readings)
        if all(move.unanswered for move in moves) and not any(node.side for node in nodes):
            least = max(abs(b.op - a.op) for a, b in pairwise(nodes))
            what = f"{self.subject} did not answer any move of OP, the largest of {least:.3g} {self.unit}: "
            return self.refused(what + f"make larger ones, beyond the gap and {self.subject}'s noise", **told)
        used = [i for i, node in enumerate(nodes) if node.side]
        gains = [move for move in moves if move.kind == "gain"]
        gaps = [move for move in moves if move.kind == "gap"]
        if not gains:
            what = f"no move goes on in the direction of one that {self.subject} answered, so the gain is not known"
            short = sum(node.settled is None for node in self.nodes)
            if short:
                what += f"; {short} of {len(self.nodes)} holds ended before {self.subject} had settled"
            return self.refused(f"{what}; step twice one way, then back, beyond the gap each time", **told)
        keep = np.isin(blocks.hold, used)
        part = blocks.of(keep)
        op = np.array([node.op for node in nodes])[part.hold]
        side = np.array([node.side for node in nodes])[part.hold]
        base = part.drift()
        columns = [base, sign * (op - op.mean())] + ([-sign * side / 2] if gaps else [])
        x = np.column_stack(columns)
        if len(part.y) - x.shape[1] < _FREEDOM or np.linalg.matrix_rank(x) < x.shape[1]:
            return self.refused("the holds are too short to tell noise from drift; hold OP for longer", **told)
        notes = [f"read are the first {_MOST_HOLDS} holds; {more} follow"] if more > 0 else []
        fit = _Posterior(x, part, extra)
        widen = self._misfit(part, fit, extra)
        if widen > 1:
            fit = _Posterior(x, part, extra, widen)
            notes.append(
                f"the readings disagree by more than noise and drift explain (F = {widen:.3g}), and the interval is "
                "widened: the load moved between holds, the process gain varies with OP, or the valve sticks and slips"
            )
        at_gain = np.eye(x.shape[1])[base.shape[1]]
        kp, kp_low, kp_high = fit.interval(at_gain)
        if kp_low <= 0:
            what = notes[-1] if widen > 1 else f"{self.subject} did not answer a second move in the same direction"
            return self.refused(f"{what}: the gain is not told from 0; make larger steps, or hold for longer", **told)
        told["readings"] = tuple(
            self._read_move(move, plain, free.interval(ends[move.to] - ends[move.origin]), (kp, kp_low, kp_high))
            for move, plain in zip(moves, readings, strict=True)
        )
        told |= {
            "kp": sign * kp,
            "kp_low": min(sign * kp_low, sign * kp_high),
            "kp_high": max(sign * kp_low, sign * kp_high),
        }
        if not gaps:
            silent = [move for move in moves if move.unanswered and move.since is not None]
            if not silent:
                return self.refused("OP never reverses after a move that PV answered; step it back", **told)
            move = max(silent, key=lambda move: abs(move.travel))
            assert move.since is not None
            most = max(abs(limit) for limit in free.interval(ends[move.to] - ends[move.since])[1:])
            least = max(abs(move.travel) - most / kp_low, 0.0)
            what = f"{self.subject} did not answer the reversal of {abs(move.travel):.3g} {self.unit}: "
            what += f"the gap is at least {least:.3g} {self.unit}; step back further"
            return self.refused(what, low=least, **told)
        at_gap = np.eye(x.shape[1])[-1]
        d, low, high = (max(value, 0.0) for value in fit.interval(at_gap, at_gain))
        if low == 0.0:
            notes.append(f"the interval reaches 0: no gap is told from one of {high:.3g} {self.unit}")
        return replace(self.blank, reason=None, d=d, low=low, high=high, notes=tuple(notes), **told)

    def _misfit(self, blocks: _Blocks, tight: _Posterior, extra: float) -> float:
        """F ratio of what levels of their own for all holds explain beyond the model; 1 where that is little."""
        holds = (blocks.hold[:, None] == np.unique(blocks.hold)).astype(float)
        free = np.column_stack([holds, blocks.drift()[:, 1::2]])
        more = free.shape[1] - (len(blocks.y) - tight.freedom)
        if more < 1 or len(blocks.y) - free.shape[1] < 1:
            return 1.0
        loose = _Posterior(free, blocks, extra)
        at = loose.best
        rest = loose.rss[at] / loose.freedom
        # What no noise shows either: the steps of a coarse PV, and the last of an answer that is not quite over.
        known = extra + (1e-3 * float(np.ptp(blocks.y))) ** 2
        ratio = (tight.rss[at] - loose.rss[at]) / more / max(rest + known * _BLOCKS, 1e-300)
        return float(ratio) if ratio > _MISFIT else 1.0

    def _moves(self, nodes: list[_Node], free: _Posterior, ends: list[Floats], sign: float) -> list[_Move]:
        """What each move from one settled hold to the next is, from which side the valve was pressed, and since when.

        `since` is the last hold at which the valve is known to have been pressed; from there on OP may have gone to and
        fro within the gap.
        """
        moves: list[_Move] = []
        since: int | None = None
        for i, (a, b) in enumerate(pairwise(nodes)):
            if i == 0 or nodes[i - 1].stretch != a.stretch:
                since = None
            if a.stretch != b.stretch:
                since = None
                continue
            if not self._straight(a, b):
                since = None
                moves.append(_Move("none", i, i + 1, None, b.op - a.op, False, _TURN))
                continue
            origin = i if since is None else since
            travel = b.op - nodes[origin].op
            if since is not None and abs(travel) <= self.tolerance:
                b.side, since = nodes[since].side, i + 1  # back where it was pressed
                continue
            if abs(b.op - a.op) <= self.tolerance:
                continue
            direction = 1 if travel > 0 else -1
            if since is not None and direction == nodes[since].side:
                b.side = direction
                moves.append(_Move("gain", since, i + 1, since, travel, False, ""))
                since = i + 1
                continue
            answer = free.below(0.0, (ends[i + 1] - ends[origin]) * sign * direction)
            if answer > 1 - SURE:
                moves.append(
                    _Move(
                        "none", origin, i + 1, None, travel, False, f"{self.subject} went the other way: the load moved"
                    )
                )
                since = None
            elif answer > SURE:
                what = f"{self.subject} did not answer"
                moves.append(_Move("none", origin, i + 1, since, travel, True, what))
            else:
                b.side = direction
                first = "first move: where in its gap the valve stood before it is not known" if since is None else ""
                moves.append(_Move("none" if first else "gap", origin, i + 1, since, travel, False, first))
                since = i + 1
        return moves

    def _straight(self, a: _Node, b: _Node) -> bool:
        """Whether OP went from one hold to the other without turning."""
        path = self.op[a.end - 1 : b.first + 1] * (1 if b.op >= a.op else -1)
        return bool(np.max(np.maximum.accumulate(path) - path) <= self.tolerance)

    def _plain(self, move: _Move, nodes: list[_Node], levels: list[float]) -> Reading:
        """A move before the process gain is known."""
        a, b = nodes[move.origin], nodes[move.to]
        return Reading(
            move.kind,
            float(self.t[a.end - 1]),
            float(self.t[b.end - 1]),
            (a.op, b.op),
            (levels[move.origin], levels[move.to]),
            None,
            None,
            None,
            move.why,
        )

    def _read_move(
        self, move: _Move, plain: Reading, answer: tuple[float, float, float], gain: tuple[float, float, float]
    ) -> Reading:
        """A move with its value: intervals to first order, from those of PV's answer and of Kp."""
        if move.kind == "none":
            return plain
        kp, kp_low, kp_high = gain
        change, error = answer[0], (answer[2] - answer[1]) / 2
        symbol = "PV" if self.subject == "PV" else "x"
        unit, pv = self.unit, self.blank.pv_unit + ("/s" if self.blank.integrating else "")
        if move.kind == "gain":
            value, error = change / move.travel, error / abs(move.travel)
            evidence = f"Δ{symbol}/ΔOP = {change:.3g} {pv} / {move.travel:.3g} {unit}"
        else:
            error = math.hypot(error / kp, change / kp**2 * (kp_high - kp_low) / 2)
            value = abs(move.travel) - abs(change) / kp
            evidence = f"|ΔOP| − |Δ{symbol}|/|Kp| = {abs(move.travel):.3g} − {abs(change):.3g}/{kp:.3g} {unit}"
        return replace(plain, value=value, low=value - error, high=value + error, evidence=evidence)

    def _holds(self, levels: dict[int, float]) -> tuple[Hold, ...]:
        out = []
        for node in self.nodes:
            hold = Hold(
                float(self.t[node.first]),
                float(self.t[node.end - 1]),
                None if node.settled is None else float(self.t[node.settled]),
                node.op,
            )
            if (level := levels.get(node.first)) is not None:
                hold = replace(hold, level=level, side=node.side)
            out.append(hold)
        return tuple(out)


@dataclass(frozen=True, slots=True)
class _Move:
    """A move between two settled holds (their places among the settled ones)."""

    kind: Literal["gain", "gap", "none"]
    origin: int
    to: int
    since: int | None
    travel: float
    unanswered: bool
    why: str


def _last_crossing(x: Floats, y: Floats, level: float) -> float:
    """Where y, which starts above the level and ends below it, last goes through it."""
    at = int(np.flatnonzero(y > level)[-1])
    return float(x[at] + (x[at + 1] - x[at]) * (y[at] - level) / (y[at] - y[at + 1]))


def _scatter(y: Floats) -> float:
    """Standard deviation about a straight line."""
    if len(y) < 4:
        return 0.0
    x = np.arange(len(y)) - (len(y) - 1) / 2
    return float(np.std(y - y.mean() - x * (x @ y) / (x @ x)))
