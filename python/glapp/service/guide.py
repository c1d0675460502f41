"""Progress of a guided step test, by the recorded signals: the person's next step, and whether it has decided.

Whether it has decided says the core (`glapp.step_test`, `crates/analysis/src/step_test/asked.rs`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .._glapp import duration, number, quantity
from ..errors import InputError
from ..loop import Loop
from ..planned import Plan
from ..recording import AT_HIGH, AT_LOW, BAD, NOT_AUTO
from ..step_test import StepTest, step_test

__all__ = ["Asked", "Guide", "guide", "read_test", "result_text"]

Floats = NDArray[np.float64]

NEAR = 0.1
"""A test ends where PV has come within so much of its limits, part of the room between them."""

AT = 0.15
"""OP is where it should be within so much of the smallest step."""

FIRST = 0.5
"""Part of a hold for which OP stays where it is in manual, before the first move."""

SILENT = 60.0
"""Time without a value after which, or after ten samples, the person is warned [s]."""

PATIENCE = 900.0
"""A test whose controller is not put in manual for so long is ended [s]."""

Outcome = Literal["decided", "over", "limit", "time", "automatic", "stopped", "silent"]
"""Why a test has ended: it has decided; all moves are made; PV or OP came near a limit; its time is over; the
controller was put in automatic, or never in manual; a person stopped it; no values came for a quarter of an hour."""


@dataclass(frozen=True, slots=True)
class Asked:
    """A test that is to be made.

    - `width`: width in question [OP unit].
    - `moves`: how far OP goes from its value in manual, one after the other; the first is 0 [OP unit].
    - `hold`: time at each [s].
    - `op_within`, `pv_within`: limits [OP unit, PV unit].
    - `minutes`: longest time from the first move on [min].
    """

    width: float
    moves: tuple[float, ...]
    hold: float
    op_within: tuple[float, float]
    pv_within: tuple[float, float]
    minutes: float

    @property
    def near(self) -> float:
        """OP is at a level within so much [OP unit]."""
        return AT * float(np.abs(np.diff(self.moves)).min())

    @classmethod
    def of_plan(cls, plan: Plan) -> Asked:
        """The planned test with OP by hand.

        Raises InputError where none can be proposed.
        """
        test = plan.by_hand
        if test is None or test.hold is None:
            why = next((one.reason for one in plan.tests if one.kind == "by_hand"), "none was planned")
            raise InputError(f"no test with OP by hand can be proposed: {why}", loop=plan.name)
        moves = tuple(op - test.moves[0] for op in test.moves)
        return cls(plan.width, moves, test.hold, plan.op_within, plan.pv_within, plan.within)

    @classmethod
    def of(cls, stored: Mapping[str, Any]) -> Asked:
        """The test that was stored."""
        pairs = {name: (stored[name][0], stored[name][1]) for name in ("op_within", "pv_within")}
        return cls(**{**stored, "moves": tuple(stored["moves"]), **pairs})


@dataclass(frozen=True, slots=True)
class Guide:
    """Progress of a test, and the person's next step.

    - `text`: what to do now, in a sentence or two.
    - `move`: of `Asked.moves` the one at which OP is held; -1 before the controller is in manual.
    - `levels`: OP at each move [OP unit]; empty before the controller is in manual.
    - `until`: when the hold is over [s since 1970 UTC]; None while a move is waited for.
    - `outcome`: why it has ended; None while it goes on.
    - `found`: what it has decided.
    - `d`, `low`, `high`: width with its 95 % limits so far [OP unit].
    - `begins`, `ends`: from when to when the controller was in manual for it [s since 1970 UTC].
    """

    text: str
    move: int = -1
    levels: tuple[float, ...] = ()
    until: float | None = None
    outcome: Outcome | None = None
    found: Literal["gap", "no_gap"] | None = None
    d: float | None = None
    low: float | None = None
    high: float | None = None
    begins: float | None = None
    ends: float | None = None


def read_test(table: pa.Table, loop: Loop, width: float | None = None) -> StepTest | None:
    """Result of a test in samples of the service; None where the controller was in automatic all the time.

    - `table`: as `Monitor.recorded` gives it.
    - `loop`: settings that go with it.
    - `width`: width in question [OP unit].
    """
    rows = _Rows.of(table)
    if not (rows.flags & NOT_AUTO).any():
        return None
    try:
        return step_test(t=rows.t, pv=rows.pv, op=rows.op, flags=rows.flags, loop=loop, width=width)
    except InputError:
        return None


@dataclass(frozen=True, slots=True)
class _Rows:
    t: Floats
    pv: Floats
    op: Floats
    flags: NDArray[np.uint8]

    @classmethod
    def of(cls, table: pa.Table) -> _Rows:
        flags = np.zeros(len(table), np.uint8)
        for column, value, flag in (
            ("MODE", "MAN", NOT_AUTO),
            ("QUALITY", "bad", BAD),
            ("OP_LOW", 1, AT_LOW),
            ("OP_HIGH", 1, AT_HIGH),
        ):
            flags |= np.array([one == value for one in table[column].to_pylist()], bool) * np.uint8(flag)
        t = table["time"].cast(pa.int64()).to_numpy() / 1e6
        pv, op = (np.asarray(table[name].to_numpy(zero_copy_only=False), np.float64) for name in ("PV", "OP"))
        return cls(t, pv, op, flags)


def guide(asked: Asked, table: pa.Table, loop: Loop, begun: float, now: float) -> Guide:
    """Progress of a test by the signals recorded since its beginning.

    - `asked`: the test.
    - `table`: samples since then, as `Monitor.recorded` gives them.
    - `loop`: settings that go with them.
    - `begun`, `now`: [s since 1970 UTC]
    """
    rows = _Rows.of(table)
    manual = rows.flags & NOT_AUTO != 0
    if not manual.any():
        if now - begun > PATIENCE:
            text = "The controller was not put in manual. Begin the test again when you are ready."
            return Guide(text, outcome="automatic")
        return Guide("Put the controller in manual while the load is calm.")
    begins = int(np.argmax(manual))
    after = np.flatnonzero(~manual[begins:])
    ends = begins + int(after[0]) if len(after) else len(manual)
    here = slice(begins, ends)
    t, op, pv = rows.t[here], rows.op[here], rows.pv[here]
    known = np.flatnonzero(np.isfinite(op))
    if not len(known):
        return Guide("OP has no value: the test cannot be followed.", begins=float(t[0]))
    levels = tuple(float(op[known[0]]) + move for move in asked.moves)
    place = _place(t, op, asked, levels)
    read = read_test(table.slice(begins, ends - begins), loop, asked.width)
    guided = _Guided(asked, loop, levels, place, t, read)
    if len(after):
        return guided.ended("automatic", "The controller is in automatic again.")
    if read is not None and read.asked is not None and read.asked.early is not None:
        return guided.ended("decided", "The test has decided.", early=True)
    if (near := _near(asked, loop, op, pv)) is not None:
        return guided.ended("limit", near)
    if place.reached == len(levels) - 1 and now - place.since >= asked.hold:
        return guided.ended("over", "All moves are made.")
    if place.first is not None and now - place.first > 60.0 * asked.minutes:
        return guided.ended("time", f"The {asked.minutes:g} minutes are over.")
    silent = now - float(t[-1])
    if silent > PATIENCE:
        return guided.ended("silent", f"No value came for {duration(silent)}.")
    usual = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    if silent > max(SILENT, 10.0 * usual):
        return guided.goes_on(f"No value has come for {duration(silent)}: leave OP where it is.")
    return guided.next(now, float(op[known[-1]]))


@dataclass(frozen=True, slots=True)
class _Place:
    """Move that OP has reached, and since when [s]; when it left the first level."""

    reached: int
    since: float
    first: float | None


def _place(t: Floats, op: Floats, asked: Asked, levels: Sequence[float]) -> _Place:
    """Place of OP among the levels of the test."""
    near, reached, since, first = asked.near, 0, float(t[0]), None
    for moment, value in zip(t.tolist(), op.tolist(), strict=True):
        if reached + 1 < len(levels) and abs(value - levels[reached + 1]) <= near:
            reached, since = reached + 1, moment
            first = moment if first is None else first
    return _Place(reached, since, first)


def _near(asked: Asked, loop: Loop, op: Floats, pv: Floats) -> str | None:
    """Why the test must end: the newest PV is near a limit, or OP beyond one."""
    for name, values, (low, high), unit, near in (
        ("PV", pv, asked.pv_within, loop.pv_unit or "", NEAR),
        ("OP", op, asked.op_within, loop.op_label, 0.0),
    ):
        room = near * (high - low)
        known = values[np.isfinite(values)]
        if len(known) and not low + room <= known[-1] <= high - room:
            limit = low if known[-1] < low + room else high
            return f"{name} is {quantity(float(known[-1]), unit, 4)}, and its limit is {quantity(limit, unit, 4)}."
    return None


@dataclass(frozen=True, slots=True)
class _Guided:
    """Texts on one place of a test."""

    asked: Asked
    loop: Loop
    levels: tuple[float, ...]
    place: _Place
    t: Floats
    read: StepTest | None

    def goes_on(self, text: str, until: float | None = None) -> Guide:
        """The next instruction of a running test."""
        return self._guide(text, until=until)

    def ended(self, outcome: Outcome, text: str, *, early: bool = False) -> Guide:
        """The end of a test, with its outcome."""
        decided = None if self.read is None else self.read.asked
        found = None if decided is None else decided.early if early else decided.found
        back = f" Put OP back to {quantity(self.levels[0], self.loop.op_label, 4)} and the controller in automatic."
        text += back if outcome not in ("automatic", "silent") else ""
        return self._guide(text, outcome=outcome, found=found, ends=float(self.t[-1]))

    def next(self, now: float, op: float) -> Guide:
        """Wait, hold, or move."""
        unit, at = self.loop.op_label, self.place.reached
        hold = self.asked.hold * (FIRST if at == 0 else 1.0)
        until = self.place.since + hold
        if now < until:
            if abs(op - self.levels[at]) > self.asked.near:
                level = quantity(self.levels[at], unit, 4)
                return self.goes_on(f"OP is {quantity(op, unit, 4)}: put it back to {level} and leave it there.")
            return self.goes_on(f"Leave OP at {quantity(self.levels[at], unit, 4)}: PV settles.", until)
        way = "up" if self.levels[at + 1] > self.levels[at] else "down"
        return self.goes_on(f"Move OP {way} to {quantity(self.levels[at + 1], unit, 4)}, in one step.")

    def _guide(self, text: str, **more: Any) -> Guide:
        read = self.read
        widths = {} if read is None else {"d": read.d, "low": read.low, "high": read.high}
        return Guide(text, move=self.place.reached, levels=self.levels, begins=float(self.t[0]), **{**widths, **more})


FOUND = {"gap": "There is a gap", "no_gap": "There is no gap of {width}", None: "The test has not decided"}
"""Texts on the decision."""


def result_text(state: Mapping[str, Any], asked: Asked, unit: str) -> str:
    r"""Sentence on the decision of a test, with the width and its interval.

    >>> asked = Asked(1.0, (0.0, 2.0, 4.0, 2.0), 60.0, (40.0, 60.0), (0.0, 9.0), 60.0)
    >>> result_text({"found": "gap", "d": 1.1, "low": 0.9, "high": 1.3}, asked, "%")
    'There is a gap: 1.10\xa0% (95 %: 0.900 to 1.30).'
    """
    sentence = FOUND[state["found"]].format(width=quantity(asked.width, unit))
    d, low, high = (state[name] for name in ("d", "low", "high"))
    if d is not None and state["found"] == "no_gap":
        return f"{sentence}: it is {quantity(high, unit)} at most, with 95 % confidence."
    if d is not None:
        return f"{sentence}: {quantity(d, unit)} (95 %: {number(low)} to {number(high)})."
    return f"{sentence}: more than {quantity(low, unit)}." if low is not None else f"{sentence}."
