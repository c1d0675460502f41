"""Signals of one loop, each at its own times, become samples for the detector.

Every good or bad value of PV is a sample; SP, OP, mode, limits, position and u_FF are what they last were::

    SP   ──x───────────────x────────────────          x  a value came
    PV   ──x────x────x────x────x──────o────x──        o  PV stands still, and the connection lives: a sample as well
    OP   ─────x─────────x──────────────x────
    samples  ↑    ↑    ↑    ↑    ↑      ↑    ↑        of the detector

All by the time of the source, in its order. A sample is made once nothing older can come: `wait` seconds after it, by
the newest time that came from anywhere in the loop. What comes, and what becomes of it:

=====================================  =================================================================================
a value of the time of one there       dropped; reported where it is another value
late: older than what was released     PV: dropped and told. Others: told, and in effect from the next sample on, where
                                       it is newer than what is in effect; else dropped
further ahead of our clock than        taken as a bad value of this moment, and told
`ahead`
the source's clock set back            five values of PV in a row that are late, each newer than the one before and as
                                       far apart as they came: told, and what came since goes on from there, after a gap
nothing comes, and the connection      PV stands still: a sample every `period`
lives
nothing comes, and it is lost, or      no sample: the detector finds a gap in time
not heard of for `lost` seconds
a bad value                            NaN, and the sample is bad
=====================================  =================================================================================
"""

from __future__ import annotations

import math
from operator import itemgetter
from typing import Any, NamedTuple, Self

from ..recording import AT_HIGH, AT_LOW, BAD, NOT_AUTO
from .signal import Signal

__all__ = ["ALIVE", "CODES", "LOST", "Resampler", "Sample"]

CODES = {signal: code for code, signal in enumerate(Signal)}
"""Number of each signal, as it is kept in the store: its place in `Signal`."""

ALIVE, LOST = 255, 254
"""Codes in place of a value: the loop's connection lived at a time; it was lost."""

SP, PV, OP, MODE, LOW, HIGH, POSITION, U_FF = range(8)

SET_BACK = 5
"""Late values of PV in a row, each newer than the one before, that mean a clock set back."""

_HELD_BACK = 1000
"""No more late values are kept for the case that a clock was set back."""


class Sample(NamedTuple):
    """One sample for the detector.

    - `t`: source time [s since 1970 UTC].
    - `sp`, `pv`, `op`: signals [their units]; NaN where bad, missing, or not known yet.
    - `flags`: sum of 1 (not in automatic), 2 (bad), 4 (OP at its low limit), 8 (at its high limit).
    - `position`, `u_ff`: the valve's position, the feed-forward in effect; NaN where not known.
    """

    t: float
    sp: float
    pv: float
    op: float
    flags: int
    position: float
    u_ff: float


class Resampler:
    """Values in, samples out, of one loop.

    - `period`: usual time between values of PV, > 0 [s].
    - `wait`: how long a sample waits for values that come late, ≥ 0 [s].
    - `ahead`: how far ahead of our clock a source time may be [s].
    - `lost`: the longest time between two signs of life [s].

    Examples
    --------
    >>> resampler = Resampler(1.0, wait=0.0)
    >>> resampler.take(SP, 0.0, 50.0, True, now=0.1)
    >>> for t in (0.0, 1.0, 2.0):
    ...     resampler.take(PV, t, 49.0 + t, True, now=t + 0.1)
    >>> [(sample.t, sample.sp, sample.pv) for sample in resampler.release()]
    [(0.0, 50.0, 49.0), (1.0, 50.0, 50.0), (2.0, 50.0, 51.0)]
    """

    def __init__(self, period: float, *, wait: float = 2.0, ahead: float = 60.0, lost: float = 15.0) -> None:
        self.period, self.wait, self.ahead, self.lost = period, wait, ahead, lost
        self.events: list[tuple[str, str]] = []
        self.newest = -math.inf
        self.released = -math.inf
        self.dropped = 0
        self._pending: list[tuple[float, int, float, bool]] = []
        self._there: set[tuple[int, float]] = set()
        self._held: list[float | None] = [None] * 8
        self._good = [True] * 8
        self._at = [-math.inf] * 8
        self._last = -math.inf
        self._lives_from = self._lives_to = -math.inf
        self._late: list[tuple[float, int, float, float, bool]] = []

    def take(self, signal: int, time: float, value: float, good: bool, now: float) -> None:
        """Take a value.

        - `signal`: its number in `CODES`; or `ALIVE`: the connection lived at `time`; or `LOST`.
        - `time`: source time [s since 1970 UTC].
        - `value`: the value.
        - `good`: whether it may be believed.
        - `now`: when it came, by our clock [s since 1970 UTC].
        """
        if signal == ALIVE:
            if self.newest < time <= now + self.ahead:  # of what is known already it says nothing
                self._lives(time)
            return
        if signal == LOST:
            self._lives_to = -math.inf
            return
        if not time <= now + self.ahead:  # not a number, too
            self.events.append(("future", f"a value {time - now:.0f} s ahead of our clock is taken as bad"))
            time, value, good = now, math.nan, False
        if not math.isfinite(value):
            value, good = math.nan, False
        if time <= self.released:
            self._came_late(signal, time, value, good, now)
            return
        if (signal, time) in self._there:
            self._came_twice(signal, time, value, good)
            return
        if signal == PV and self._late:
            self._late.clear()
        self._there.add((signal, time))
        self._pending.append((time, signal, value, good))
        # After a loss PV is known from its own first value on, and not since another signal changed in the break.
        if signal == PV or self._lives_to > -math.inf:
            self._lives(time)
        self.newest = max(self.newest, time)

    def _lives(self, time: float) -> None:
        """Note a sign of life of the loop."""
        if time > self._lives_to:
            if time - self._lives_to > self.lost:
                self._lives_from = time
            self._lives_to = time
        self.newest = max(self.newest, time)

    def _came_twice(self, signal: int, time: float, value: float, good: bool) -> None:
        """Drop a repeated value; an event where it differs."""
        self.dropped += 1
        for at, kind, other, was_good in self._pending:
            if (at, kind) == (time, signal) and (other != value or good != was_good) and (good or was_good):
                self.events.append(("duplicate", f"two values of one time: {other:g} counts, {value:g} is dropped"))

    def _came_late(self, signal: int, time: float, value: float, good: bool, now: float) -> None:
        """A value of a time that was released before."""
        if time == self._at[signal]:  # that one again
            self.dropped += 1
            held = self._held[signal]
            if good and self._good[signal] and held != value:
                self.events.append(("duplicate", f"two values of one time: {held:g} counts, {value:g} is dropped"))
            return
        behind = self.released - time
        if signal != PV and time > self._at[signal]:
            # What is sent first may have changed long ago, and what is the same changes nothing.
            if self._held[signal] not in (None, value):
                self.events.append(("late", f"{_NAMES[signal]} came {behind:.1f} s late: in effect from now on"))
            self._hold(signal, time, value, good)
            return
        self.dropped += 1
        self.events.append(("late", f"{_NAMES[signal]} came {behind:.1f} s late: dropped"))
        if self._late and signal == PV:
            of_pv = [at for _, kind, at, _, _ in self._late if kind == PV]
            if of_pv and time <= of_pv[-1]:
                self._late.clear()
        if len(self._late) < _HELD_BACK and (signal == PV or self._late):
            self._late.append((now, signal, time, value, good))
        if signal == PV:
            self._set_back()

    def _set_back(self) -> None:
        """Whether the late values are those of a clock that was set back: then they count."""
        of_pv = [(now, time) for now, kind, time, _, _ in self._late if kind == PV]
        if len(of_pv) < SET_BACK:
            return
        came, span = of_pv[-1][0] - of_pv[0][0], of_pv[-1][1] - of_pv[0][1]
        if not (came > 0.0 and 0.5 * came <= span <= 2.0 * came):
            return  # a heap of late values, which came all at once
        behind = self.released - of_pv[0][1]
        self.events.append(
            ("clock_back", f"the source's clock was set back by {behind:.0f} s: a gap, and on from there")
        )
        values, self._late = self._late, []
        self._pending.clear()
        self._there.clear()
        self._at = [-math.inf] * 8
        self.released = self.newest = self._lives_from = self._lives_to = -math.inf
        self._last = -math.inf
        self.dropped -= len(values)
        for now, signal, time, value, good in values:
            self.take(signal, time, value, good, now)

    def _hold(self, signal: int, time: float, value: float, good: bool) -> None:
        """Keep a value until the next one."""
        self._held[signal], self._good[signal], self._at[signal] = value, good, time

    def release(self) -> list[Sample]:
        """The samples that nothing older can come before any more, in their order."""
        limit = self.newest - self.wait
        if limit <= self.released:
            return []
        pending = self._pending
        # PV comes last of one time: it is the sample that the others belong to.
        pending.sort(key=_order)
        out: list[Sample] = []
        taken = 0
        of_pv = [time for time, signal, _, _ in pending if signal == PV and time <= limit]
        of_pv.append(math.inf)
        upcoming = 0
        decided = True
        for time, signal, value, good in pending:
            if time > limit:
                break
            decided = self._still(min(time, limit), of_pv[upcoming], limit, out)
            if not decided:
                break
            taken += 1
            self._there.discard((signal, time))
            self._hold(signal, time, value, good)
            if signal == PV:
                upcoming += 1
                self._sample(time, out)
            self.released = time
        del pending[:taken]
        if decided:
            self._still(limit, of_pv[upcoming], limit, out)
            # A still PV up to the limit is not decided until half a period is over: its time stays open.
            self.released = max(self.released, min(limit, self._open()))
        return out

    def _open(self) -> float:
        """End of the times that are decided: just before the next sample that a still PV may have."""
        if self._last == -math.inf:
            return math.inf
        return math.nextafter(max(self._last + self.period, self._lives_from), -math.inf)

    def _still(self, before: float, upcoming: float, limit: float, out: list[Sample]) -> bool:
        """Samples of a PV that stands still, of times before `before`; whether all of them are known by now.

        A time of one is left out where a value of PV comes within half a period: what is made of the same values is the
        same, however they came.
        """
        if self._last == -math.inf or self._held[PV] is None or upcoming - self._last <= 1.5 * self.period:
            return True
        while True:
            time = max(self._last + self.period, self._lives_from)
            if time >= before or time > self._lives_to or upcoming <= time + 0.5 * self.period:
                return True
            if limit <= time + 0.5 * self.period:
                return False
            self._sample(time, out)

    def _sample(self, time: float, out: list[Sample]) -> None:
        """Add the sample of the held values."""
        sp, pv, op, mode, low, high, position, u_ff = self._held
        flags = 0
        if sp is None or pv is None or sp != sp or pv != pv:
            flags = BAD
        if mode is not None:
            if mode != mode:
                flags |= BAD
            elif mode == 0.0:
                flags |= NOT_AUTO
        for limit, flag in ((low, AT_LOW), (high, AT_HIGH)):
            if limit is not None and limit != 0.0:
                flags |= flag if limit == limit else BAD
        nan = math.nan
        out.append(
            Sample(
                time,
                nan if sp is None else sp,
                nan if pv is None else pv,
                nan if op is None else op,
                flags,
                nan if position is None else position,
                nan if u_ff is None else u_ff,
            )
        )
        self._last = time

    def known(self, signal: int) -> bool:
        """Whether a value of a signal ever came."""
        return self._held[signal] is not None

    def latest(self, signal: int) -> tuple[float, float, bool] | None:
        """Source time, value and goodness of the newest value of a signal that was taken; None before the first.

        It need not be in effect yet: its sample may still wait.
        """
        value = self._held[signal]
        taken = [] if value is None else [(self._at[signal], value, self._good[signal])]
        taken += [(time, value, good) for time, kind, value, good in self._pending if kind == signal]
        return max(taken, key=itemgetter(0), default=None)

    def save(self) -> dict[str, Any]:
        """State in plain types; NaN and infinity are numbers in it, as Python's JSON has them."""
        return {
            "newest": self.newest,
            "released": self.released,
            "dropped": self.dropped,
            "pending": [list(one) for one in self._pending],
            "held": self._held,
            "good": self._good,
            "at": self._at,
            "last": self._last,
            "lives": [self._lives_from, self._lives_to],
            "late": [list(one) for one in self._late],
        }

    @classmethod
    def load(cls, saved: dict[str, Any], period: float, **bounds: float) -> Self:
        """The rows that `save` saved: they go on with the same samples."""
        self = cls(period, **bounds)
        self.newest, self.released, self.dropped = saved["newest"], saved["released"], saved["dropped"]
        self._pending = [(time, signal, value, good) for time, signal, value, good in saved["pending"]]
        self._there = {(signal, time) for time, signal, _, _ in self._pending}
        self._held, self._good, self._at = saved["held"], saved["good"], saved["at"]
        self._last = saved["last"]
        self._lives_from, self._lives_to = saved["lives"]
        self._late = [(now, signal, time, value, good) for now, signal, time, value, good in saved["late"]]
        return self


_NAMES = ("SP", "PV", "OP", "mode", "the low limit", "the high limit", "the position", "u_FF")


def _order(value: tuple[float, int, float, bool]) -> tuple[float, bool, int]:
    """Sort key of values: by time, PV last."""
    return value[0], value[1] == PV, value[1]
