"""Plan of the test that would decide whether a valve has a gap, before anybody moves OP.

The fitted loop is simulated with the gap in question and without it, under the disturbance that the recording shows,
and each simulated test is judged by what judges a real one: `glapp.step_test` for OP moved by hand, `glapp.fit` for
setpoint steps. The share of simulations that end in the right answer is the power of the test.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .checked import check_limits, check_positive
from .controller import Ideal
from .errors import InputError
from .estimate import analyze
from .fit import Fit, Process, fit
from .loop import Loop, op_unit
from .planned import OPEN, Kind, Limits, Plan, Planned
from .plant import Plant
from .progress import Progress
from .recording import Recording, joined
from .result import Result
from .samples import recording_of
from .scenario import Manual, Samples, Scenario, Valve
from .simulate import run, run_many
from .step_test import step_test

__all__ = ["Kind", "Plan", "Planned", "plan_from", "plan_test", "with_plan"]

Floats = NDArray[np.float64]
Found = Literal["gap", "no_gap"]

BEYOND = 1.5
"""PV is kept within its limits with a process gain this many times its upper limit by the likelihood.

Even so, the person stops when PV reaches a limit.
"""

KNOWN = 2.0
"""The process is known where the upper limit of its gain by the likelihood is at most this many times the lower one.

Where a recording does not show the gap, it often does not show the process either: gains that it gives are then up to
17 times too small, lags 7 times too long. What such a loop does in a test cannot be foreseen.
"""

WORTH = 0.5
"""A test that decides less often is not proposed."""

POWER = 0.9
"""A test that decides so often is proposed; of those the shortest, and of these the one that moves PV least."""

LATE = 60
"""Rows at the end whose median is the loop's present place."""

PILOTS, SIMULATIONS = 8, 64
"""Tests simulated with the gap and as many without: to search for one, and to measure the power of that one."""

FITTED = 8
"""Number of simulations of setpoint steps: a fit takes a second, where a step test takes milliseconds."""

STEPS = (1.5, 2.0, 3.0, 5.0, 8.0)
"""Steps of OP that are tried [widths]."""

HOLDS = (1.3, 2.0, 4.0)
"""Times for which OP is held [settling times]."""

SETTLED_ROWS = 20
"""Rows of a hold after PV has settled."""

PATTERNS = ((0, 1, 2, 1), *((0, *(1, 2, 1, 0) * n) for n in (1, 2, 4)))
"""OP by hand [steps from its present value]: up, up, down, and up, up, down, down this many times."""

TAIL = 5.0
"""Tail, the one of the step test: PV counts as settled t₁ + 5(t₂ − t₁) after a move."""

SETPOINT_STEPS = (2.0, 3.0, 4.0)
"""Setpoint steps that are tried [width of the gap, through the process gain]."""

MOST_SETPOINT_STEPS = 10
"""A setpoint is stepped so often at most: five times each way."""

HOURS = (1.0, 3.0, 9.0)
"""A recording is continued for this many times its length."""

HOURS_POWER = 0.8
"""Share of simulations that must show the gap; the shortest recording that does is named."""

MOST_ROWS = 100_000
"""Rows that are fitted for that at most: of more the fit takes minutes."""


def plan_test(
    recording: Recording,
    result: Result,
    *,
    begins: Recording | None = None,
    op_within: Limits | None = None,
    pv_within: Limits | None = None,
    minutes: float = 60.0,
    width: float | None = None,
    kinds: Sequence[Kind] = ("by_hand", "setpoint", "more_hours"),
    progress: Progress | None = None,
) -> Plan:
    """Say which test would decide whether there is a gap, how long it takes, how far PV moves, how often it decides.

    A test decides where it ends in *gap* with the gap, and in *no gap of this width* without. By hand: the 95 %
    interval of the step test begins above a fifth of the width, or ends below four fifths. By setpoint steps: the
    fit's *found*, or *none seen* above a limit below the width. PV is simulated as P·valve + w: P is the fitted
    process, the valve follows OP with a gap of the width, or without, and w is what is left of the recorded PV, taken
    from a place of the recording that is another one in each simulation. It is the same w with the gap and without:
    that of the two which leaves less of the recording. Gain and times of the process are drawn from within their 95 %
    limits, separately for each simulation: a process that is not well known makes the power smaller.

    More hours: the loop with its gap is simulated in automatic, with the recorded course of SP backwards and forwards
    in turn, and fitted together with the recording. The plan names the shortest of once, three and nine times its
    length that shows the gap in 80 %.

    Known bias: valve and load are those of the fit. Where the true gain is below its limits, or the process slower than
    its limits allow, the true power is below the stated one. A valve that sticks is simulated as one with a gap.

    Parameters
    ----------
    recording : Recording
        The loop's recording.
    result : Result
        The result of `glapp.analyze` for it.
    begins : Recording, optional
        A later recording of the loop, at whose end the test begins; the same where not given.
    op_within, pv_within : (float, float), optional
        Limits of OP [OP unit] and PV [PV unit] for the test; the least and greatest value in the recording where not
        given.
    minutes : float
        Longest test [min], > 0.
    width : float, optional
        Width in question [OP unit], > 0. Where not given it is the most likely one of a *likely* gap, else the widest
        acceptable one, else the most likely one.
    kinds : sequence of str
        Kinds of test to work out.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        Where OP and PV were not fitted or do not show the process, a limit is out of its bounds, or no width in
        question is given or follows from the answer.

    Examples
    --------
    >>> import glapp
    >>> steps = [(0, 40.0), (600, 42.0), (1500, 40.0), (2400, 43.0)]
    >>> sim = glapp.simulate.closed_loop(([0.8], [20, 1], 5), (0.5, 20), d=1.0, noise=0.1, h=1.0, t_end=3600,
    ...                                  setpoint=steps, seed=1)
    >>> recording = glapp.recording_from(sim.to_arrow().drop_columns(["POSITION"]))
    >>> plan = plan_test(recording, glapp.analyze(recording), width=1.0, op_within=(45, 65), pv_within=(35, 50),
    ...                  kinds=("by_hand",))
    >>> test = plan["by_hand"]
    >>> test.power >= 0.9, test.pv[0] >= 35 and test.pv[1] <= 50
    (True, True)
    """
    check_positive(minutes, "minutes")
    if width is not None:
        check_positive(width, "width")
    for name, within in (("op_within", op_within), ("pv_within", pv_within)):
        if within is not None:
            check_limits(within, name)
    if unknown := set(kinds) - {"by_hand", "setpoint", "more_hours"}:
        raise InputError(f"holds {sorted(unknown)[0]!r}; known: by_hand, setpoint, more_hours", parameter="kinds")
    asked = _width(result) if width is None else width
    loop = _Fitted.of(recording, result, asked, op_within, pv_within, begins or recording)
    report = progress or (lambda _: None)
    tests = []
    for i, kind in enumerate(kinds):
        report(i / len(kinds))
        match kind:
            case "by_hand":
                tests.append(_by_hand(loop, minutes))
            case "setpoint":
                tests.append(_setpoint(loop, minutes))
            case "more_hours":
                tests.append(_more_hours(loop, recording))
    report(1.0)
    return Plan(
        name=result.name,
        source=result.source,
        unit=result.unit,
        pv_unit=result.loop.pv_unit or "PV unit",
        width=asked,
        op_within=loop.op_within,
        pv_within=loop.pv_within,
        within=minutes,
        tests=tuple(tests),
    )


TRIED = 3
"""Recordings of several that are tried, the newest first, until one shows the process."""


def plan_from(recordings: Sequence[Recording], result: Result, **asked: Any) -> Plan:
    """Plan a test for a loop with one recording or several: from the newest one whose fit shows the process.

    - `recordings`: in the order of time; the test begins where the last one ends.
    - `result`: the result of `glapp.analyze` for all of them; it gives the width in question where `asked` does not.
    - `**asked`: as in `plan_test`.

    Raises InputError as `plan_test`, of the newest recording that could be fitted.
    """
    width = asked.pop("width", None) or _width(result)
    refused: list[tuple[bool, InputError]] = []
    for recording in reversed(recordings[-TRIED:]):
        alone = result if recording.source == result.source else analyze(recording)
        try:
            return plan_test(recording, alone, width=width, begins=recordings[-1], **asked)
        except InputError as error:
            refused.append((alone.fit is None or alone.fit.process is None, error))
    raise min(refused, key=lambda refusal: refusal[0])[1]  # the reason against a long recording helps more


def with_plan(recordings: Sequence[Recording], result: Result, **asked: Any) -> Result:
    """The result with `Result.plan`: what would decide, where its answer is open.

    - `recordings`, `result`, `**asked`: as in `plan_from`. Where nothing can be planned, `Plan.reason` says why.
    """
    if result.answer.confidence not in OPEN:
        return result
    try:
        plan = plan_from(recordings, result, **asked)
    except InputError as error:
        none = (math.nan, math.nan)
        within = asked.get("minutes", 60.0)
        unit, pv_unit = result.unit, result.loop.pv_unit or "PV unit"
        plan = Plan(result.name, result.source, unit, pv_unit, math.nan, none, none, within, (), str(error))
    return replace(result, plan=plan)


def _width(result: Result) -> float:
    """Width that a test is to decide on."""
    answer, found = result.answer, result.fit
    likely = found.d if found is not None and answer.confidence in ("likely", "found") else None
    acceptable = None if answer.limit is None else answer.limit.width
    for width in (likely, acceptable, None if found is None else found.d):
        if width is not None and width > 0:
            return width
    raise InputError(
        "no width is known, neither a likely one nor an acceptable one",
        loop=result.name,
        parameter="width",
        hint="say which width is asked for, or give OP's span",
    )


@dataclass(frozen=True, slots=True)
class _Fitted:
    """The fitted loop, as it was at the end of its recording; OP and PV are counted from there."""

    name: str
    loop: Loop
    fit: Fit
    width: float
    h: float
    plant: Plant
    strong: Plant
    """The process with the largest gain that is planned for."""
    gain_spread: float
    """Standard deviation of ln Kp, and that of the logarithm of the process' times, by their 95 % limits."""
    time_spread: float
    integrating: bool
    settling: float
    left: _Left
    """Residual of the valve with the gap or without, whichever is smaller: the load is the same for both."""
    op: float
    pv: float
    sp: float
    sp_moves: Floats
    """SP from step to step, relative to its end; 0 where it is not recorded."""
    law: Ideal | None
    op_within: Limits
    pv_within: Limits

    @property
    def op_unit(self) -> str:
        """Unit of OP as a sentence needs it."""
        return op_unit(self.fit.unit)

    @property
    def pv_unit(self) -> str:
        """Unit of PV."""
        return self.loop.pv_unit or "PV unit"

    @classmethod
    def of(
        cls,
        recording: Recording,
        result: Result,
        width: float,
        op_within: Limits | None,
        pv_within: Limits | None,
        begins: Recording,
    ) -> _Fitted:
        loop = recording.loop
        found, process, gains = _known_process(result, loop)
        best = found.best
        h = float(best["h"])
        op, pv, sp = _rows(recording, best["t_start"], best["t_end"], h)
        plant, strong = (_plant(gain, best, h) for gain in gains)
        settling = _settling(plant)
        skip = min(len(pv) // 4, int(settling / h))
        either = [_Left.of(plant, op, pv, d, h, skip) for d in (width, 0.0)]
        left = min(either, key=lambda residual: residual.moves_by(max(1, round(settling / h))))
        last = _last_values(begins)
        s = result.settings
        known = s.k is not None and s.ti is not None
        return cls(
            name=result.name,
            loop=loop,
            fit=found,
            width=width,
            h=h,
            plant=plant,
            strong=strong,
            gain_spread=0.0 if loop.kp() is not None else _gain_spread(best["kp_near"]),
            time_spread=_time_spread(process, best["lag_near"][1]),
            integrating=process.integrating,
            settling=settling,
            left=left,
            op=last["op"],
            pv=last["pv"],
            sp=last["sp"],
            sp_moves=sp - sp[-1],
            law=Ideal(s.k, s.ti, s.td or 0.0, 1.0 if s.b is None else s.b) if known else None,  # type: ignore[arg-type]
            op_within=_room("op", op_within, op, last["op"]),
            pv_within=_room("pv", pv_within, pv, last["pv"]),
        )

    def disturbance(self, n: int, at: int, seed: int) -> Floats:
        """The given number of values of PV's residual, from another place with each seed, 0 at the sample `at`."""
        return self.left.piece(n, at, np.random.default_rng(seed))

    def process(self, seed: int) -> Plant:
        """A process as the recording allows it: gain and times drawn from within their limits, one draw per seed."""
        random = np.random.default_rng([seed, 2])
        gain, time = (
            math.exp(spread * float(np.clip(random.standard_normal(), -_LIMIT, _LIMIT)))
            for spread in (self.gain_spread, self.time_spread)
        )
        order = len(self.plant.den) - 1
        num = [gain * x for x in self.plant.num]
        den = [x * time ** (order - i - self.integrating) for i, x in enumerate(self.plant.den)]
        plant = Plant(num, den, self.plant.dead_time * time)
        return plant if np.abs(plant.poles).max() * self.h < 3.0 else Plant(num, self.plant.den, self.plant.dead_time)

    def swing(self, n: int) -> Limits:
        """Move of PV by itself from its present value, within the given number of samples."""
        pieces = [self.disturbance(n, 0, seed) for seed in range(SIMULATIONS)]
        return min(float(x.min()) for x in pieces), max(float(x.max()) for x in pieces)


def _known_process(result: Result, loop: Loop) -> tuple[Fit, Process, tuple[float, float]]:
    """The fit of OP and PV, its process, and the two gains of `_gains`.

    Raises InputError where there is no fit, where it contradicts the settings, and where the gain is too uncertain.
    """
    found = result.fit
    if found is not None and found.through_pv is not None:
        found = found.through_pv
    if found is None or found.process is None:
        reason = result.reason if found is None else found.reason
        raise InputError(f"OP and PV were not fitted: {reason}", file=result.source, loop=result.name)
    process = found.process
    where: dict[str, Any] = {"file": result.source, "loop": result.name}
    if process.integrating != (loop.process.type == "integrating"):
        kinds = ("integrating", "self-regulating")
        fitted, stated = kinds if process.integrating else kinds[::-1]
        raise InputError(
            f"the fit takes the process for {fitted}, and its settings say {stated}",
            **where,
            hint=f'write process = {{ type = "{fitted}" }} in a loops.toml if that is so',
        )
    gains = _gains(process.kp[0], found.best["kp_near"], loop.kp())
    if gains is None:
        raise InputError(
            f"the process gain is too uncertain: {process.kp[1]:.3g} to {process.kp[2]:.3g} "
            f"{loop.pv_unit or 'PV unit'} per {op_unit(result.unit)}",
            **where,
            hint="record the loop while OP or the setpoint is stepped once or twice",
        )
    return found, process, gains


def _room(name: str, within: Limits | None, x: Floats, last: float) -> Limits:
    """Limits of a signal in the test: those given, else its range in the recording, which ends at `last`."""
    low, high = within or (float(np.nanmin(x)), float(np.nanmax(x)))
    check_limits((low, high), f"{name}_within")
    if not low <= last <= high:
        raise InputError(f"is {low:g} to {high:g}, and the recording ends at {last:.4g}", parameter=f"{name}_within")
    return low, high


def _gains(kp: float, near: Limits, given: float | None) -> tuple[float, float] | None:
    """Process gain, and the largest that is planned for; None where it is not known."""
    least, most = sorted(abs(x) for x in near)
    if near[0] * near[1] <= 0 or most > KNOWN * least:
        return None
    kp = kp if given is None else given
    return kp, math.copysign(BEYOND * max(abs(kp), most if given is None else 0.0), kp)


_LIMIT = NormalDist().inv_cdf(0.975)
"""A 95 % limit is this many standard deviations away."""

MOST_SPREAD = 0.5
"""Standard deviation of the logarithm of what has no upper limit: 95 % within a factor of 2.7 either way."""


def _gain_spread(near: Limits) -> float:
    """Standard deviation of ln Kp by its 95 % limits by the likelihood.

    Of 49 loops of `bench.plan` (half A) whose gain is known well enough to plan, these limits hold the true gain in 46;
    the wider ones that the fit gives are for the others.
    """
    least, most = sorted(abs(x) for x in near)
    return math.log(most / least) / (2.0 * _LIMIT) if most > least > 0.0 else 0.0


def _time_spread(process: Process, high: float) -> float:
    """Standard deviation of dead time plus lags, known better than either, by the upper limit of the lags."""
    dead, lag = process.dead_time[0], process.lag[0]
    if not dead + lag > 0.0 or not math.isfinite(high):
        return MOST_SPREAD
    return min(math.log(max(1.0, (dead + high) / (dead + lag))) / _LIMIT, MOST_SPREAD)


def _last_values(recording: Recording) -> dict[str, float]:
    """OP, PV and SP at the end of the recording, PV in the place of an SP that is not recorded."""
    last: dict[str, list[Floats]] = {"op": [], "pv": [], "sp": []}
    for batch in recording.batches():
        for name, kept in last.items():
            values = getattr(batch, name)
            if values is not None:
                kept[:] = [np.concatenate([*kept, values[np.isfinite(values)][-LATE:]])[-LATE:]]
    values = {name: float(np.median(kept[0])) for name, kept in last.items() if kept and kept[0].size}
    return {"sp": values["pv"]} | values


def _rows(recording: Recording, start: float, end: float, h: float) -> tuple[Floats, Floats, Floats]:
    """OP, PV and SP between `start` and `end`, resampled to steps of `h` seconds by the latest value; SP 0 without."""
    rows = joined([part for b in recording.batches() if len(part := b[_inside(b.t, start, end)])])
    assert rows.op is not None  # it was fitted
    good = np.isfinite(rows.t) & np.isfinite(rows.op) & np.isfinite(rows.pv)
    sp = np.zeros(len(rows.t)) if rows.sp is None or np.isnan(rows.sp).all() else rows.sp
    good &= np.isfinite(sp)
    t, op, pv, sp = rows.t[good], rows.op[good], rows.pv[good], sp[good]
    grid = t[0] + h * np.arange(int((t[-1] - t[0]) / h + 1e-9) + 1)
    latest = np.searchsorted(t, grid + 1e-6 * h, side="right") - 1
    return op[latest], pv[latest], sp[latest]


def _inside(t: Floats, start: float, end: float) -> slice:
    """Rows between two times."""
    inside = np.flatnonzero((t >= start) & (t <= end))
    return slice(int(inside[0]), int(inside[-1]) + 1) if len(inside) else slice(0, 0)


def _plant(kp: float, best: dict[str, Any], h: float) -> Plant:
    """The fitted process; lags that a row does not show are left out."""
    coefficients = list(best["denominator"])
    while not coefficients[-1]:
        coefficients.pop()
    plant = Plant([kp], coefficients[::-1], best["dead_time"])
    if np.abs(plant.poles).max() * h < 3.0:
        return plant
    integrator = int(best["integrating"])
    lag = max(coefficients[1 + integrator], h / 3.0)
    return Plant([kp], [lag, 1.0] + [0.0] * integrator, best["dead_time"])


def _settling(plant: Plant) -> float:
    """Settling time of PV in the step test [s]: t₁ + 5(t₂ − t₁); behind an integrator that of its lag."""
    if plant.gain is None:
        plant = Plant([1.0], plant.den[:-1], plant.dead_time)
    t, y = plant.step()
    gone = np.maximum.accumulate(y / float(plant.gain or 1.0))
    t1, t2 = (float(t[np.searchsorted(gone, 1.0 - math.exp(-k)).clip(0, len(t) - 1)]) for k in (1, 2))
    return t1 + TAIL * (t2 - t1)


def _at_rest(plant: Plant, h: float, t_end: float, **more: Any) -> Scenario:
    """The process in manual, from rest at 0."""
    sign = math.copysign(1.0, plant.num[-1])
    manual = more.pop("manual", [Manual(begin=0.0, end=t_end + h, op=0.0)])
    more |= {"controller": (sign, 10.0), "manual": manual}
    return Scenario(plant=plant, h=h, t_end=t_end, **more)


@dataclass(frozen=True, slots=True)
class _Left:
    """Residual of PV after the valve's moves."""

    w: Floats
    """[PV unit]."""
    due: Floats
    """Move of PV still to come where OP is held from here on: a distance [PV unit], behind an integrator a rate [PV
    unit/s].
    """
    shape: Floats
    """Course of that move, from step to step: the step response to 1, behind an integrator time [s]."""
    integrating: bool

    @classmethod
    def of(cls, plant: Plant, op: Floats, pv: Floats, d: float, h: float, skip: int) -> _Left:
        """Residual of PV, where the valve has a gap of width `d`; without the first `skip` steps."""
        valve = Valve(d=d).positions(op, h) if d > 0 else op
        moves = valve - valve[0]
        moved = run(_at_rest(plant, h, h * (len(op) - 1), load=Samples(values=moves))).pv[: len(pv)]
        t: Floats = h * np.arange(len(pv), dtype=np.float64)
        if (gain := plant.gain) is None:
            return cls((pv - moved)[skip:], (float(plant.velocity_gain or 0.0) * moves)[skip:], t, True)
        return cls((pv - moved)[skip:], (gain * moves - moved)[skip:], np.asarray(plant.step_response(t) / gain), False)

    def moves_by(self, steps: int) -> float:
        """Mean square of its change in so many steps."""
        return float(np.mean((self.w[steps:] - self.w[:-steps]) ** 2)) if len(self.w) > steps else math.inf

    def piece(self, n: int, at: int, random: np.random.Generator) -> Floats:
        """The given number of steps from a random place, with OP held from the step `at` on, where it is 0.

        A recording shorter than twice that is read forwards and backwards in turn.
        """
        w, due, turn = self.w, self.due, -1.0 if self.integrating else 1.0
        while len(w) < 2 * n:
            w, due = np.concatenate([w, w[::-1]]), np.concatenate([due, turn * due[::-1]])
        rest = np.arange(1, max(0, n - len(self.shape)) + 1) * (self.shape[1] if self.integrating else 0.0)
        shape = np.append(self.shape, self.shape[-1] + rest)
        start = int(random.integers(0, len(w) - n + 1))
        piece: Floats = w[start : start + n] - w[start + at]
        piece[at:] += due[start + at] * shape[: n - at]
        return piece


def _by_hand(loop: _Fitted, minutes: float) -> Planned:
    """Plan of a step test with OP by hand."""
    if loop.integrating:
        return Planned("by_hand", "the process integrates: PV would run away while OP is held")
    room = {+1: loop.op_within[1] - loop.op, -1: loop.op - loop.op_within[0]}
    side = max(room, key=lambda side: room[side])
    reach = room[side] / 2
    if STEPS[0] * loop.width > reach:
        return Planned(
            "by_hand",
            f"two steps of OP beyond a gap of {loop.width:.3g} {loop.op_unit} take "
            f"{2 * STEPS[0] * loop.width:.3g} {loop.op_unit}, and OP may move from {loop.op:.4g} by {room[side]:.3g} "
            f"{loop.op_unit} at most",
        )
    refused: set[str] = set()
    best: Planned | None = None
    for hold, pattern in _shortest(loop, minutes, refused):
        n = round(hold / loop.h) * len(pattern) + 1
        low, high = loop.swing(n)
        for size in STEPS:
            if size * loop.width > reach:
                break
            levels = tuple(side * size * loop.width * level for level in pattern)
            pv = _goes(loop, loop.strong, levels, hold, (low, high))
            if not _within(pv, loop.pv_within):
                refused.add(
                    f"PV may go from {pv[0]:.4g} to {pv[1]:.4g} {loop.pv_unit} in two steps of OP by "
                    f"{size * loop.width:.3g} {loop.op_unit}, and its limits are {loop.pv_within[0]:.4g} and "
                    f"{loop.pv_within[1]:.4g} {loop.pv_unit}"
                )
                break
            pilot = _tried(loop, levels, hold, range(PILOTS))
            planned = _planned("by_hand", loop.op, levels, hold, pilot, pv)
            if planned.power is not None and planned.power >= POWER - 0.1:  # others at the same loop will be as good
                planned = _planned(
                    "by_hand",
                    loop.op,
                    levels,
                    hold,
                    _tried(loop, levels, hold, range(PILOTS, PILOTS + SIMULATIONS)),
                    pv,
                )
                if planned.power is not None and planned.power >= POWER:
                    return planned
            if best is None or (planned.power or 0.0) > (best.power or 0.0):
                best = planned
    if best is None:
        return Planned("by_hand", sorted(refused)[0])
    if best.simulations == PILOTS:  # the best of many looks better than it is
        levels = tuple(op - loop.op for op in best.moves)
        again = _tried(loop, levels, best.hold or 0.0, range(PILOTS, PILOTS + SIMULATIONS))
        best = _planned("by_hand", loop.op, levels, best.hold or 0.0, again, best.pv)
    if (best.power or 0.0) < WORTH:
        why = f", and {sorted(refused)[0]}" if refused else ""
        return Planned(
            "by_hand",
            f"the surest test of up to {minutes:g} min decides in {100 * (best.power or 0.0):.0f} % only{why}",
        )
    return best


def _goes(loop: _Fitted, plant: Plant, levels: Sequence[float], hold: float, swing: Limits) -> Limits:
    """Least and greatest PV of a test without a gap, wherever the load goes meanwhile."""
    pv = run(_scenario(loop, plant, 0.0, levels, hold, None)).pv
    return loop.pv + float(pv.min()) + swing[0], loop.pv + float(pv.max()) + swing[1]


def _shortest(loop: _Fitted, minutes: float, refused: set[str]) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Holds and patterns that fit into the time, the shortest first."""
    pairs = []
    for share in HOLDS:
        hold = _round(max(share * loop.settling, loop.settling + SETTLED_ROWS * loop.h), loop.h)
        pairs += [(hold, pattern) for pattern in PATTERNS]
    fitting = [pair for pair in pairs if _minutes(*pair) <= minutes]
    if not fitting:
        least = min(_minutes(*pair) for pair in pairs)
        refused.add(f"the shortest test takes {least:.0f} min, and {minutes:g} are allowed")
    yield from sorted(fitting, key=lambda pair: _minutes(*pair))


def _minutes(hold: float, moves: Sequence[float]) -> float:
    """Duration of a test from its first move to the last hold [min]."""
    return hold * (len(moves) - 1) / 60


def _round(seconds: float, h: float) -> float:
    """A time that a person can keep, and a multiple of the step."""
    unit = 60.0 if seconds > 240 else 30.0 if seconds > 60 else 10.0 if seconds > 20 else 1.0
    return h * math.ceil(unit * math.ceil(seconds / unit - 1e-9) / h - 1e-9)


def _within(inner: Limits, outer: Limits) -> bool:
    """Whether one range lies within another."""
    return outer[0] <= inner[0] and inner[1] <= outer[1]


def _scenario(
    loop: _Fitted, plant: Plant, d: float, levels: Sequence[float], hold: float, seed: int | None
) -> Scenario:
    """OP by hand, after a hold at which the valve was left anywhere in its gap; without a seed nothing disturbs PV."""
    before = 0 if seed is None else 2
    place = 0.0 if seed is None else float(np.random.default_rng([seed, 1]).uniform(-1.0, 1.0)) * loop.width
    held = [*([place, 0.0] if before else []), *levels]
    t_end = hold * len(held)
    noise: Any = ()
    if seed is not None:
        n = round(t_end / loop.h) + 1
        noise = Samples(values=loop.disturbance(n, round(before * hold / loop.h), seed))
    manual = [Manual(begin=i * hold, end=(i + 1) * hold, op=op) for i, op in enumerate(held)]
    manual[-1] = Manual(begin=manual[-1].begin, end=t_end + loop.h, op=held[-1])
    return _at_rest(plant, loop.h, t_end, manual=manual, d=d, noise=noise)


def _tried(
    loop: _Fitted, levels: Sequence[float], hold: float, seeds: Sequence[int]
) -> list[tuple[float, Found | None]]:
    """Results of the step test on simulated tests, with the gap and without."""
    each = [(d, seed) for d in (loop.width, 0.0) for seed in seeds]
    simulations = run_many(
        [_scenario(loop, loop.process(seed), d, levels, hold, seed) for d, seed in each], progress=False
    )
    first = round(2 * hold / loop.h)
    judged = []
    for (d, _), s in zip(each, simulations, strict=True):
        read = step_test(
            t=s.t[first:], pv=s.pv[first:] + loop.pv, op=s.op[first:] + loop.op, manual=True, width=loop.width
        )
        judged.append((d, None if read.asked is None else read.asked.found))
    return judged


def _planned(
    kind: Kind,
    begins: float,
    levels: Sequence[float],
    hold: float,
    judged: Sequence[tuple[float, Found | None]],
    pv: Limits | None,
    op: Limits | None = None,
    few: bool = False,
) -> Planned:
    """A test as its simulations were judged; with `few` of them k of n that show the gap count as (k + 1)/(n + 2)."""
    with_gap = [found == "gap" for d, found in judged if d > 0]
    without = [found == "no_gap" for d, found in judged if d == 0]
    false = [found == ("no_gap" if d > 0 else "gap") for d, found in judged]
    moves = tuple(begins + level for level in levels)
    shown, excluded = (sum(with_gap) + few) / (len(with_gap) + 2 * few), sum(without) / len(without)
    return Planned(
        kind,
        moves=moves,
        hold=hold,
        minutes=_minutes(hold, moves),
        op=op or (min(moves), max(moves)),
        pv=pv,
        power=min(shown, excluded),
        with_gap=shown,
        without=excluded,
        false=float(np.mean(false)),
        simulations=len(with_gap),
    )


def _setpoint(loop: _Fitted, minutes: float) -> Planned:
    """Plan of a test with steps of the setpoint."""
    law = loop.law
    if law is None or not law.k:
        return Planned("setpoint", "the controller's K and Ti are not known: give them, or record SP")
    apart = _round(3.0 * loop.settling + 2.0 * law.ti, loop.h)
    n = min(MOST_SETPOINT_STEPS, int(minutes * 60 / apart))
    if n < 2:
        return Planned("setpoint", f"two setpoint steps take {2 * apart / 60:.0f} min, and {minutes:g} are allowed")
    # Final effect of OP's move, or behind an integrator the immediate one.
    gain = 1.0 / abs(law.k) if loop.integrating else abs(loop.plant.gain or 0.0)
    begins = loop.sp
    side = 1.0 if loop.pv_within[1] - begins >= begins - loop.pv_within[0] else -1.0
    passed = ""
    for size in reversed(SETPOINT_STEPS):
        step = side * size * loop.width * gain
        levels = tuple(step * (i % 2) for i in range(n + 1))
        pv, op = _reached(loop, law, levels, apart)
        if _within(pv, loop.pv_within) and _within(op, loop.op_within):
            judged = _fitted(loop, law, levels, apart, FITTED)
            found = _planned("setpoint", begins, levels, apart, judged, pv, op, few=True)
            if (found.power or 0.0) >= WORTH:
                return found
            return Planned(
                "setpoint",
                f"{n} setpoint steps of {abs(step):.3g} {loop.pv_unit}, {apart / 60:.1f} min apart, decide in "
                f"{100 * (found.power or 0.0):.0f} % only",
            )
        if not math.isfinite(pv[1]):
            return Planned(
                "setpoint",
                "with the largest process gain that the recording allows the loop runs away by itself: what setpoint "
                "steps would do cannot be promised",
            )
        passed = (
            f"setpoint steps of {abs(step):.3g} {loop.pv_unit} take PV from {pv[0]:.4g} to {pv[1]:.4g} {loop.pv_unit} "
            f"and OP from {op[0]:.4g} to {op[1]:.4g} {loop.op_unit}, beyond the limits"
        )
    return Planned("setpoint", passed)


def _stepped(
    loop: _Fitted, law: Ideal, plant: Plant, d: float, levels: Sequence[float], apart: float, seed: int
) -> Scenario:
    """Scenario with steps of the setpoint."""
    t_end = apart * len(levels)
    noise = Samples(values=loop.disturbance(round(t_end / loop.h) + 1, 0, seed))
    more: dict[str, Any] = {"controller": tuple(law), "noise": noise}
    more["setpoint"] = [(i * apart, level) for i, level in enumerate(levels)]
    return Scenario(plant=plant, d=d, h=loop.h, t_end=t_end, **more)


def _reached(loop: _Fitted, law: Ideal, levels: Sequence[float], apart: float) -> tuple[Limits, Limits]:
    """Least and greatest PV and OP with either gain, with the gap and without."""
    seeds = range(FITTED)
    each = [
        _stepped(loop, law, plant, d, levels, apart, seed)
        for plant in (loop.plant, loop.strong)
        for d in (loop.width, 0.0)
        for seed in seeds
    ]
    try:
        simulations = run_many(each, progress=False)
    except InputError:  # it runs away with the greater gain
        return (-math.inf, math.inf), (-math.inf, math.inf)
    begins = loop.sp

    def reach(of: str, zero: float) -> Limits:
        values = [getattr(s, of) for s in simulations]
        return zero + min(float(x.min()) for x in values), zero + max(float(x.max()) for x in values)

    return reach("pv", begins), reach("op", loop.op)


def _fitted(
    loop: _Fitted, law: Ideal, levels: Sequence[float], apart: float, count: int
) -> list[tuple[float, Found | None]]:
    """Results of the fit on simulated setpoint steps, with the gap and without."""
    each = [(d, seed) for d in (loop.width, 0.0) for seed in range(100, 100 + count)]
    judged: list[tuple[float, Found | None]] = []
    for d, seed in each:
        try:
            s = run(_stepped(loop, law, loop.process(seed), d, levels, apart, seed))
        except InputError:  # that process runs away under the controller: nothing is decided
            judged.append((d, None))
            continue
        judged.append((d, fit_decides(fit(t=s.t, sp=s.sp, pv=s.pv, op=s.op, loop=loop.loop), loop.width)))
    return judged


def fit_decides(found: Fit, width: float) -> Found | None:
    """What a fit decides: a gap, none of this width, or nothing."""
    confidence = (found.judgement or {}).get("confidence")
    if confidence == "found":
        return "gap"
    return "no_gap" if confidence in ("none_seen", "sound") and found.high is not None and found.high < width else None


def _more_hours(loop: _Fitted, recording: Recording) -> Planned:
    """The recording continued for once, three or nine times its length, the shortest of them that shows the gap."""
    found = loop.fit
    if found.why in ("swings", "repeats", "opposed"):
        return Planned("more_hours", f"more hours of the same show nothing new: {found.reason}")
    if not (found.lr_no_gap or 0.0) > 0.0 or found.why not in ("may_be_a_gap", "windows_silent", "families_disagree"):
        return Planned("more_hours", f"more hours of the same need not show more: {found.reason}")
    if loop.law is None or not loop.law.k:
        return Planned("more_hours", "the controller's K and Ti are not known: give them, or record SP")
    if len(loop.sp_moves) * (max(1, len(found.windows)) + max(HOURS)) > MOST_ROWS:
        most = MOST_ROWS / (1 + max(HOURS))
        return Planned("more_hours", f"what goes on from a recording of more than {most:.0f} rows is not simulated")
    short, middle, long = HOURS
    times, shown = middle, _shown(loop, recording, loop.law, middle)
    if shown < HOURS_POWER:
        times, shown = long, _shown(loop, recording, loop.law, long)
    elif (sooner := _shown(loop, recording, loop.law, short)) >= HOURS_POWER:
        times, shown = short, sooner
    minutes = times * len(loop.sp_moves) * loop.h / 60
    if shown < WORTH:
        return Planned(
            "more_hours",
            f"{minutes / 60:.3g} h more of the same operation would show the gap in only {100 * shown:.0f} % of cases",
        )
    return Planned("more_hours", minutes=minutes, power=shown, with_gap=shown, simulations=FITTED)


def _shown(loop: _Fitted, recording: Recording, law: Ideal, times: float) -> float:
    """Share of simulated recordings, longer by a factor, in which the fit finds the gap."""
    n = round(times * len(loop.sp_moves))
    # Backwards and forwards in turn: SP goes on from its last value, and moves as often as it did.
    sp = np.resize(np.concatenate([loop.sp_moves[::-1], loop.sp_moves]), n)
    shown = 0
    for seed in range(200, 200 + FITTED):
        signals: Any = {"setpoint": Samples(values=sp), "noise": Samples(values=loop.disturbance(n, 0, seed))}
        more: Any = {"plant": loop.process(seed), "controller": tuple(law)}
        try:
            s = run(Scenario(**more, **signals, d=loop.width, h=loop.h, t_end=loop.h * (n - 1)))
        except InputError:  # that process runs away under the controller: nothing is shown
            continue
        goes_on = recording_of(None, loop.loop, t=s.t, sp=s.sp, pv=s.pv, op=s.op)
        shown += fit_decides(fit([recording, goes_on]), loop.width) == "gap"
    return shown / FITTED
