"""u_FF of one loop, made beside the plant's own controller by the block that ships (`BacklashDetection`).

It sees the newest values there are, and none that comes late; it is made anew at every start, and nothing is in force
until a person enables it. What it finds in the plant that nobody here has asked for, after a start, a loss or a gap, it
ramps to 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from .. import _glapp
from ..errors import InputError
from ..loop import Loop
from ..modules import BacklashDetection, Graph, Input, Output, Source
from ..recording import AT_HIGH, AT_LOW, BAD, NOT_AUTO
from .settable import check, of_plant, usual_of
from .signal import Signal, Value

__all__ = ["TEXT_OF_STATE", "Compensator", "detection_beside"]

COMPENSATION_STATES: list[str] = _glapp.compensation_states()
"""Names of the numbers of `standing`."""

TEXT_OF_STATE = {
    "active": "It compensates.",
    "not_enabled": "Nobody enabled it.",
    "not_auto": "The controller is in manual: u_FF is 0.",
    "bad_quality": "A signal is bad: u_FF is 0 until it is good again.",
    "over_compensated": "Withdrawn: the loop swings as if too much was compensated.",
    "too_many_reversals": "Withdrawn: the budget of reversals is spent.",
    "too_much_travel": "Withdrawn: the budget of OP's travel is spent.",
    "estimate_lost": "The estimate is gone: u_FF is 0.",
    "at_limit": "OP is at a limit: u_FF is 0 until it is away from there.",
    "too_small": "No width is left to compensate.",
    "waiting": "It waits for OP to turn round.",
    "worse": "Withdrawn: the loop is worse than before.",
    "too_late": "u_FF comes too late for this loop.",
    "not_followed": "Withdrawn: the plant does not follow u_FF.",
    "no_estimate": "Withdrawn: there is no estimate that may be compensated by.",
}
"""Each of them, for the person at the screen."""

LATE = 5.0
"""Allowed excess of u_FF's age in the plant over the time for three scans, the writes and the read-back [s]."""

_NOW = 1e-6
"""Time of a scan beside another of the same moment [s]."""

_ARRIVALS = 20
"""Number of latest values whose age at arrival counts."""

_FINAL = ("over_compensated", "too_many_reversals", "too_much_travel", "worse", "not_followed", "no_estimate")
"""States after which nothing is compensated until a person enables it anew."""


def detection_beside(loop: Loop, period: float, **chosen: Any) -> Graph:
    """A `BacklashDetection` beside a controller that is not ours, "watch", with its inputs sp, pv, flags, op and u_ff.

    - `loop`: whose settings it has.
    - `period`: usual time between samples, > 0 [s].
    - `chosen`: more settings of `BacklashDetection`.

    Raises InputError where the loop has no controller, or a setting is out of its bounds.
    """
    ideal = loop.ideal()
    if ideal is None:
        raise InputError("has no controller settings", loop=loop.name, parameter="controller", hint="give K and Ti")
    low, high = loop.op_range() or (None, None)
    spans = [None if span is None else span[1] - span[0] for span in (loop.pv_span, loop.op_span)]
    watch = BacklashDetection(
        **ideal._asdict(),
        kp=loop.kp(),
        pv_span=spans[0],
        op_span=spans[1],
        integrating=loop.process.type == "integrating",
        tf=loop.tf,
        n=loop.n,
        op_low=low,
        op_high=high,
        **chosen,
    )
    names = ("sp", "pv", "flags", "op", "u_ff")
    return Graph(
        period,
        {**{name: Input() for name in names}, "watch": watch, "ff": Output()},
        [f"{name} -> watch.{name}" for name in names] + ["watch -> ff"],
    )


class Compensator:
    """The compensation of one loop.

    - `loop`: with a controller.
    - `period`: usual time between values of PV, > 0 [s].
    - `settings`: what a person has set, by the names in `SETTINGS`; None: as by default.
    - `most`, `fastest`: the greatest |u_FF| and the greatest rate that the plant takes, > 0 [OP unit, OP unit per s];
      `comp_limit` and `comp_rate` go by them (`usual_of`).

    Raises InputError where the loop has no controller, or a setting is out of its bounds.
    """

    def __init__(self, loop: Loop, period: float, settings: Mapping[str, Any], most: float, fastest: float) -> None:
        self.loop, self.period = loop, period
        self._usual, self._most = usual_of((most, fastest)), most
        for name, value, bound in zip(("u_ff_limit", "u_ff_rate"), (most, fastest), of_plant(loop), strict=True):
            check(name, value, bound, loop.name)
        chosen: dict[str, Any] = {**self._usual, **{name: x for name, x in settings.items() if x is not None}}
        try:
            self._graph = detection_beside(loop, period, **chosen)
        except InputError as error:
            error.loop = loop.name
            raise
        self._held: dict[Signal, Value] = {}
        self._ages: list[float] = []
        self._write_time: float | None = None
        self._scanned: float | None = None
        self.fresh_pv = False
        self.pv_at = -math.inf  # when a PV came, by the clock of `scan`
        self.read_back = False  # whether u_FF was read from the plant since the connection began
        self.written: float | None = None
        self.written_at = -math.inf
        self._to_zero: float | None = None  # since when a u_FF in the plant has to go to 0, by the clock of `scan`
        self.why_off = "nobody enabled it since the start"
        self.withdrawn: str | None = None
        self._seen = 0.0  # u_FF as it was read for the last scan

    @property
    def longest_still(self) -> float:
        """Longest time without a new PV, beyond which nothing is compensated any more [s]."""
        return max(30.0 * self.period, 1.0)

    @property
    def enabled(self) -> bool:
        """Whether a person has enabled it, and nothing has ended that."""
        return bool(self._graph["watch.compensate"])

    @property
    def sized(self) -> bool:
        """Whether there is a width to compensate."""
        return bool(self._graph["watch.source"])

    @property
    def standing(self) -> str:
        """Whether it compensates ("active"), and else why not."""
        return COMPENSATION_STATES[int(self._graph["watch.standing"])]

    @property
    def u_ff(self) -> float:
        """The latest u_FF [OP unit]."""
        return float(self._graph["ff"])

    @property
    def to_write(self) -> float:
        """Value for the plant: u_FF, and while it is off nothing farther from 0 than the value in the plant [OP unit].

        The plant may hold less than was made, where writes came late. What is farther would be refused, and the
        watchdog of every loop not counted up for it.
        """
        found = self._held.get(Signal.U_FF)
        if self.enabled or found is None or not found.good:
            return self.u_ff
        return min(max(self.u_ff, min(0.0, found.value)), max(0.0, found.value))

    @property
    def at_work(self) -> bool:
        """Whether a value has to be written: it is enabled, or the value in the plant is not 0 yet."""
        found = self._held.get(Signal.U_FF)
        return self.enabled or self.u_ff != 0.0 or (found is not None and found.good and found.value != 0.0)

    @property
    def away_within(self) -> float:
        """Longest time in which u_FF goes to 0 [s]: `comp_release`, or by its rate, within what the core allows."""
        ti = float(self._graph["watch.ti"])
        bounds = _glapp.compensation_bounds(ti, size=0.0, share=0.0, limit=0.0)
        longest = next(high for name, _, _, high, _ in bounds if name == "release")
        if not self.sized:
            return float(min(ti, longest))  # what is found in the plant goes by the default
        by_rate = self._most / self._graph["watch.comp_rate"]
        return float(min(max(self._graph["watch.comp_release"], by_rate), longest))

    def stuck_u_ff(self, now: float) -> float | None:
        """The u_FF that is read back from the plant though it had to be 0 by now; None: all is as it has to be.

        - `now`: the clock of `scan` [s].
        """
        found = self._held.get(Signal.U_FF)
        if self._to_zero is None or found is None or not found.good or found.value == 0.0:
            return None
        return found.value if now - self._to_zero > self.away_within + 3.0 * self.period + LATE else None

    def take(self, value: Value, now: float) -> None:
        """Take a value where it is newer than the one there is; a PV that comes late moves nothing.

        - `now`: when it came [s since 1970 UTC].
        """
        held = self._held.get(value.signal)
        if held is not None and value.time <= held.time:
            return
        if value.signal is Signal.PV:
            age = now - value.time
            if self.age is not None and age > 3.0 * self.period + self.age:
                return
            self._ages = [*self._ages[1 - _ARRIVALS :], max(age, 0.0)]
            self.fresh_pv = True
        self._held[value.signal] = value

    @property
    def age(self) -> float | None:
        """Age of a PV at its arrival, the median of the latest [s]; None before the first."""
        return sorted(self._ages)[len(self._ages) // 2] if self._ages else None

    @property
    def delay(self) -> float | None:
        """Measured delay of u_FF: PV's age when it comes, and the time that a write takes [s]."""
        return None if self.age is None or self._write_time is None else self.age + self._write_time

    def wrote(self, u_ff: float, now: float, took: float) -> None:
        """A write that the plant has confirmed after `took` seconds."""
        self.written, self.written_at = u_ff, now
        self._write_time = took if self._write_time is None else max(took, 0.9 * self._write_time)

    def scan(self, now: float, alive: bool) -> float:
        """A scan with the newest values; gives u_FF.

        - `now`: a clock that only goes forward [s].
        - `alive`: whether the connection of the loop lives: where it does not, what was read is not believed.
        """
        if self.fresh_pv:
            self.pv_at = now
        h = self.period if self._scanned is None else now - self._scanned
        self._scanned, self.fresh_pv = now, False
        read = {signal: self._read(signal) if alive else math.nan for signal in Signal}
        flags = 0
        mode = read[Signal.MODE]
        if mode != mode:
            flags |= BAD
        elif mode == 0.0:
            flags |= NOT_AUTO
        for signal, flag in ((Signal.LOW, AT_LOW), (Signal.HIGH, AT_HIGH)):
            if signal in self._held and read[signal] != 0.0:
                flags |= flag if read[signal] == read[signal] else BAD
        was = self.enabled
        inputs = {str(signal): read[signal] for signal in (Signal.SP, Signal.PV, Signal.OP, Signal.U_FF)}
        if self._pushed(read[Signal.U_FF]):  # after a value that is none the block goes on from the one it finds
            self._graph.scan(h=_NOW, **inputs | {"u_ff": math.nan}, flags=float(flags | BAD))
        self._graph.scan(h=h, **inputs, flags=float(flags))
        at_zero = self._read(Signal.U_FF) == 0.0  # what is written later, has its own time
        if self.standing == "active" or not self.read_back or at_zero:
            self._to_zero = None
        elif self._to_zero is None:
            self._to_zero = now
        if was and now - self.pv_at > self.longest_still:
            self.disable(f"no PV came for {now - self.pv_at:.0f} s")
        elif was and self.standing in _FINAL:
            self.disable(f"it was withdrawn, {self.standing}", self.standing)
        return self.u_ff

    def _pushed(self, u_ff: float) -> bool:
        """Whether somebody else has written u_FF while nothing is in force: it goes to 0 from there, not at once."""
        seen, self._seen = self._seen, u_ff
        found = math.isfinite(u_ff) and u_ff not in (0.0, seen, self.written)
        return found and not self.enabled and self.u_ff == 0.0

    def _read(self, signal: Signal) -> float:
        """Last good value of a signal, else not a number."""
        held = self._held.get(signal)
        return held.value if held is not None and held.good else math.nan

    def enable(self) -> None:
        """Let it compensate from the next scan on.

        Raises InputError where no width is given, mode or OP was never read, or what was measured of the delay is more
        than the core allows for this Ti; nothing is in force then.
        """
        name = self.loop.name
        for signal in (Signal.MODE, Signal.OP, Signal.U_FF):
            if signal not in self._held:
                raise InputError(f"{signal} was never read: nothing is compensated without it", loop=name)
        if not self.sized:
            raise InputError(
                "no width is given to compensate", loop=name, parameter="comp_size", hint="take over a fit, or type one"
            )
        delay = self.delay
        if delay is None:
            raise InputError("the delay of u_FF is not measured yet", loop=name, hint="wait until values come")
        scans = max(1, math.ceil(delay / self.period - 1e-9))
        if scans > 32:
            raise InputError(f"u_FF comes {delay:.2f} s late, more than 32 scans", loop=name, value=delay)
        self._graph["watch.ff_delay"] = scans
        self._graph["watch.compensate"] = 1.0
        # Inputs may be of any kind: only whether the delay is allowed is used.
        trial = Compensator._late(self._graph, self.period, scans)
        if trial is not None:
            self._graph["watch.compensate"] = 0.0
            raise InputError(
                f"u_FF comes {delay:.2f} s late, {scans} scans of {self.period:g} s: {trial}",
                loop=name,
                value=delay,
                hint="read it faster, or leave it uncompensated",
            )
        self.why_off, self.withdrawn = "", None

    @staticmethod
    def _late(graph: Graph, period: float, scans: int) -> str | None:
        """Judgement of the core on a delay, by a block of its own with the same settings."""
        names = ("sp", "pv", "flags", "op", "u_ff")
        asked = {name: graph[f"watch.{name}"] for name in ("k", "ti", "td", "comp_way", "ff_longest")}
        beside = Graph(
            period,
            {
                **{name: Input() for name in names},
                "watch": BacklashDetection(**asked, ff_delay=scans, comp_size=1.0, op_low=-1e6, op_high=1e6),
                "ff": Output(),
            },
            [f"{name} -> watch.{name}" for name in names] + ["watch -> ff"],
        )
        beside["watch.compensate"] = 1.0
        beside.scan(sp=0.0, pv=0.0, flags=0.0, op=0.0, u_ff=0.0)
        late = COMPENSATION_STATES[int(beside["watch.standing"])] == "too_late"
        return f"more than the core allows with Ti = {asked['ti']:g} s" if late else None

    def disable(self, why: str, withdrawn: str | None = None) -> None:
        """End it: u_FF goes to 0 in `comp_release`, and it stays off until a person enables it.

        `withdrawn` is the state by which the core withdrew it, where the core did.
        """
        if self.enabled:
            self._graph["watch.compensate"] = 0.0
            self.why_off, self.withdrawn = why, withdrawn

    @property
    def why_off_text(self) -> str:
        """Why it is off, in a sentence."""
        return f"{self.why_off}." if self.withdrawn is None else TEXT_OF_STATE[self.withdrawn]

    def lost(self, why: str) -> None:
        """The connection is lost: it is off, and the value found afterwards is ramped to 0.

        What was read stays until something newer comes: what has not changed meanwhile is not sent again.
        """
        self.disable(why)
        self._held = {signal: replace(value, time=-math.inf) for signal, value in self._held.items()}
        self._ages.clear()
        self._write_time = None
        self.written, self.read_back, self._to_zero = None, False, None

    def set_all(self, values: Mapping[str, float | None]) -> None:
        """Set some of `SETTINGS` while it runs; None: as by default.

        One by one, in the order in which each is within its bounds with those that are set already.

        Raises InputError with the bound that one of them breaks; all is as it was.
        """
        left, before = dict(values), dict[str, float | None]()
        while left:
            refused: dict[str, InputError] = {}
            for name, value in left.items():
                was = self.setting(name)
                try:
                    self._graph[f"watch.{name}"] = self._usual.get(name) if value is None else value
                    before[name] = was
                except InputError as error:
                    refused[name] = error
            if len(refused) == len(left):
                for name in reversed(before):
                    self._graph[f"watch.{name}"] = before[name]
                raise next(iter(refused.values()))
            left = {name: left[name] for name in refused}

    def setting(self, name: str) -> float | None:
        """One of `SETTINGS` as it is in force."""
        value: float | None = self._graph[f"watch.{name}"]
        return value

    def status(self) -> dict[str, Any]:
        """State for display."""
        graph = self._graph
        source = int(graph["watch.source"])
        return {
            "enabled": self.enabled,
            # Enabled a moment ago: the block says so with the next scan.
            "standing": "waiting" if self.enabled and self.standing == "not_enabled" else self.standing,
            "why_off": self.why_off,
            "withdrawn": self.withdrawn,
            "u_ff": _number(self.u_ff),
            "written": _number(self.written),
            "source": Source(source).name.lower() if source else None,
            "size": _number(graph["watch.size"]),
            "delta": _number(graph["watch.delta"]),
            "left": _number(graph["watch.left"]),
            "over": int(graph["watch.over"]),
            "delay": _number(self.delay),
        }


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
