"""The step test for backlash, read off a recording: OP is stepped in manual, held, stepped on and stepped back.

The core reads it (`crates/analysis/src/step_test.rs` has the derivation); here its numbers get units.
`docs/step-test.md` explains how holds, settling, noise and drift are treated, and how often the interval held the
truth.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from typing import Any, Literal

from numpy.typing import ArrayLike

from . import _glapp
from .errors import InputError
from .loop import Loop, op_unit
from .recording import Batch, Recording, with_op_unit
from .repair_split import since_repair
from .samples import recording_of

__all__ = ["Asked", "Hold", "Reading", "StepTest", "step_test"]


@dataclass(frozen=True, slots=True)
class Asked:
    """Whether the test has decided a width in question.

    - `width`: the width [`StepTest.unit`].
    - `narrower`, `wider`: probability that the gap is narrower than a fifth of it, and that it is wider than four
      fifths; None where the test gives no width.
    - `found`: what the test decides if it is over: one of the two probabilities is below 2.5 %. None: it is open.
    - `early`: what it decides while it goes on, at 0.1 %: then it may be ended. Who looks many times would otherwise
      decide wrongly more often than in 2.5 %.
    """

    width: float
    narrower: float | None
    wider: float | None
    found: Literal["gap", "no_gap"] | None
    early: Literal["gap", "no_gap"] | None


@dataclass(frozen=True, slots=True)
class Hold:
    """One stretch in which OP was held.

    - `start`, `end`: its time [s since the first row].
    - `settled`: time from which PV is taken as settled; None where the hold ended before that.
    - `op`: OP [its unit].
    - `level`: mean of PV when settled (of an integrating process: its slope [PV unit/s]); None where not settled.
    - `side`: +1 where OP then pressed the valve upwards, -1 downwards, 0 where that is not known or the hold is not
      used.
    """

    start: float
    end: float
    settled: float | None
    op: float
    level: float | None = None
    side: int = 0


@dataclass(frozen=True, slots=True)
class Reading:
    """Reading of one move from hold to hold.

    - `kind`: a move in the same direction as the last (Kp), a reversal (d), or one that gives nothing.
    - `start`, `end`: from the end of the hold before to the end of the hold after [s since the first row].
    - `op`: OP before and after.
    - `pv`: settled PV (or slope) before and after.
    - `value`, `low`, `high`: Kp [PV unit per OP unit] or d [OP unit] with its 95 % interval.
    - `t86`: time from OP's step until 86.5 % of PV's way is gone [s]; None where OP was not stepped at once, where the
      process integrates, or where noise hides it.
    - `overshoot`: how far PV went beyond its new level, part of its way; 0 where that is not beyond the noise.
    - `evidence`: the numbers it was read from, or why it gives nothing.
    - `evidence_code`: the same as a `code` with its numbers; None where the gain was not known.
    """

    kind: Literal["gain", "gap", "none"]
    start: float
    end: float
    op: tuple[float, float]
    pv: tuple[float, float]
    value: float | None
    low: float | None
    high: float | None
    t86: float | None
    overshoot: float | None
    evidence: str
    evidence_code: dict[str, Any] | None


@dataclass(frozen=True, slots=True)
class StepTest:
    """Gap and process gain as a step test shows them, or why it shows none.

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
    resolution : float | None
        Smallest move in the direction of the one before that PV surely answered [`unit`]: the resolution is no coarser.
    integrating : bool
        Whether slopes were read instead of levels.
    settle : float | None
        Time that PV was given to settle after each move [s].
    holds, readings : tuple
        Where OP was held, and what each move gives.
    reason : str | None
        Why there is no width; None where there is one.
    reason_code : dict | None
        The same as a `code` with its numbers.
    notes : tuple of str
        What a person should know in addition to the numbers.
    note_codes : tuple of dict
        The same as codes with their numbers.
    asked : Asked | None
        Whether the test has decided the width in question; None where none was asked for.
    travel : StepTest | None
        The same test read from the valve's position, where it was recorded: `pv` is then travel, Kp is travel per OP.
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
    reason_code: dict[str, Any] | None = None
    d: float | None = None
    low: float | None = None
    high: float | None = None
    d_percent_span: float | None = None
    kp: float | None = None
    kp_low: float | None = None
    kp_high: float | None = None
    resolution: float | None = None
    integrating: bool = False
    settle: float | None = None
    holds: tuple[Hold, ...] = ()
    readings: tuple[Reading, ...] = ()
    notes: tuple[str, ...] = ()
    note_codes: tuple[dict[str, Any], ...] = ()
    asked: Asked | None = None
    travel: StepTest | None = None
    t0: datetime | None = None
    signals: Batch | None = field(default=None, repr=False, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """All but the signals, as JSON has it."""
        shown = asdict(replace(self, signals=None, travel=None))
        del shown["signals"]
        shown["t0"] = None if self.t0 is None else self.t0.isoformat()
        return shown | {"travel": None if self.travel is None else self.travel.to_dict()}


def step_test(
    recording: Recording | None = None,
    *,
    t: ArrayLike | None = None,
    pv: ArrayLike | None = None,
    op: ArrayLike | None = None,
    position: ArrayLike | None = None,
    flags: ArrayLike | None = None,
    loop: Loop | None = None,
    manual: bool = False,
    width: float | None = None,
) -> StepTest:
    """Read gap and process gain off the step test that a recording holds.

    Looked at are the stretches in which the controller was not in automatic.  A test that can be read holds OP, after
    each move until PV has settled, and makes at least two moves in one direction and one back: the first move after
    the controller was put in manual gives nothing, since it is not known where in its gap the valve then was.

    Known bias: a step response with a tail much slower than its beginning settles later than is assumed.  A valve that
    sticks and slips has no one width; its readings scatter, and a note says so.

    Parameters
    ----------
    recording : Recording
        From `glapp.recording_from` or `glapp.open_recordings`.  Setting `process.type` to "integrating" makes it read
        slopes instead of levels.  Or, in its place:
    t, pv, op, position, flags : array[n]
        Samples: time [s] or datetime64; process value [PV unit], controller output [OP unit], the valve's measured
        position [%]; sum of 1 not in automatic, 2 bad, 4 OP at its low, 8 at its high limit. NaN, infinite
        or masked is a bad value.
    loop : Loop
        Settings that go with samples.
    manual : bool
        Take the whole recording as made in manual; for one without a mode column.
    width : float, optional
        Width in question [OP unit], > 0: `StepTest.asked` says whether the test has decided it.

    Returns
    -------
    StepTest
        With `reason` where the recording does not hold such a test.

    Raises
    ------
    InputError
        Where the recording cannot be read, `manual` is given for one that has a mode column, or the width is not > 0.

    Examples
    --------
    >>> import glapp
    >>> steps = [(0, 100, 50.0), (100, 200, 53.0), (200, 300, 56.0), (300, 400, 52.0)]
    >>> sim = glapp.simulate.closed_loop(([0.8], [5, 1], 0), (0.5, 10), d=2.0, noise=0.05, h=1.0, t_end=400,
    ...                                  manual=steps, setpoint=[(0, 40.0)])
    >>> found = glapp.step_test(glapp.recording_from(sim.to_arrow()))
    >>> print(f"{found.d:.1f} ({found.low:.1f} to {found.high:.1f}), Kp {found.kp:.1f}")
    2.0 (1.9 to 2.0), Kp 0.8
    """
    if width is not None and not width > 0:
        raise InputError(f"is {width:g}, must be > 0", parameter="width", value=width, bound="> 0")
    given = recording_of(recording, loop, t=t, pv=pv, op=op, position=position, flags=flags)
    [recording] = since_repair([given])
    has_mode = "MODE" in recording.columns
    if manual and has_mode:
        raise InputError(
            "is for recordings without a mode column, and this one has one",
            file=recording.source,
            loop=recording.name,
            column=recording.columns["MODE"],
            parameter="manual",
        )
    rows = _glapp.ManualRows(True if manual else False if has_mode else None)
    for batch in recording.batches():
        rows.add(batch)
    kept = rows.kept()
    loop = recording.loop if kept is None else with_op_unit(recording.loop, kept)
    span, positioner = loop.op_range(), loop.positioner
    found = rows.read(
        loop.process.type == "integrating",
        None if span is None else span[1] - span[0],
        None if positioner is None else positioner.dead_band,
        width,
    )
    return replace(step_test_from_core(found, recording, loop), signals=kept)


def step_test_from_core(found: dict[str, Any], recording: Recording, loop: Loop) -> StepTest:
    """Put the core's reading of a step test into words."""
    blank = StepTest(recording.name, recording.source, loop.op_label, loop.pv_unit or "PV unit", None, t0=recording.t0)
    travel = found.pop("travel")
    if travel is not None:
        travel = _with_answer(replace(blank, pv_unit="% travel"), travel, "the valve")
    return replace(_with_answer(blank, found, "PV"), travel=travel)


def _with_answer(blank: StepTest, found: dict[str, Any], subject: str) -> StepTest:
    """The core's answer, with its codes in sentences; `subject` is what answered OP."""
    words = {
        "subject": subject,
        "symbol": "PV" if subject == "PV" else "x",
        "op_unit": blank.unit,
        "unit": op_unit(blank.unit),
        "pv_unit": blank.pv_unit + ("/s" if found["integrating"] else ""),
    }

    def sentence(code: dict[str, Any] | None) -> str:
        return "" if code is None else _glapp.to_text(f"step_test.{code['code']}", words | code)

    reason, notes, asked = found.pop("reason"), tuple(found.pop("notes")), found.pop("asked")
    readings = [reading | {"op": tuple(reading["op"]), "pv": tuple(reading["pv"])} for reading in found.pop("readings")]
    return replace(
        blank,
        reason=None if reason is None else sentence(reason),
        reason_code=reason,
        notes=tuple(sentence(note) for note in notes),
        note_codes=notes,
        asked=None if asked is None else Asked(**asked),
        holds=tuple(Hold(**hold) for hold in found.pop("holds")),
        readings=tuple(
            Reading(**reading | {"evidence": sentence(reading["evidence"])}, evidence_code=reading["evidence"])
            for reading in readings
        ),
        **found,
    )
