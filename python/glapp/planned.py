"""A plan of tests: what would decide whether a valve has a gap. `glapp.plan` makes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

__all__ = ["OPEN", "Kind", "Limits", "Plan", "Planned"]

Limits = tuple[float, float]
Kind = Literal["by_hand", "setpoint", "more_hours"]

OPEN = ("likely", "likely_sound", "cannot_tell")
"""Confidences of an answer that a test would decide."""


def _pair(of: Sequence[float] | None) -> Limits | None:
    return None if of is None else (of[0], of[1])


@dataclass(frozen=True, slots=True)
class Planned:
    """One kind of test.

    - `kind`: OP moved in manual; the setpoint stepped in automatic; a longer recording of the loop as it runs.
    - `reason`: why no such test can be proposed; None where it can, and all that follows is known.
    - `moves`: OP [OP unit], or SP [PV unit], one after the other, the first where the loop stood at the end of the
      recording. Empty for more hours.
    - `hold`: time at each of them [s].
    - `minutes`: time for all of it, without that at the beginning that is recorded before the first move.
    - `op`, `pv`: least and greatest OP and PV in any of the simulations, with the process gain 1.5 times its upper
      limit. None for more hours.
    - `power`: probability that it decides: the smaller of the next two.
    - `with_gap`, `without`: share of the simulations with the gap that end in *gap*, and of those without it that end
      in *no gap* of that width. Setpoint steps are simulated a few times only: k of n that show the gap count as (k +
      1)/(n + 2). `without` is None for more hours.
    - `false`: share of all simulations that end in the wrong answer.
    - `simulations`: simulations of either kind; of more hours those with the gap, the only ones.
    """

    kind: Kind
    reason: str | None = None
    moves: tuple[float, ...] = ()
    hold: float | None = None
    minutes: float | None = None
    op: Limits | None = None
    pv: Limits | None = None
    power: float | None = None
    with_gap: float | None = None
    without: float | None = None
    false: float | None = None
    simulations: int = 0


@dataclass(frozen=True, slots=True, repr=False)
class Plan:
    """Plan of the test that would decide.

    Attributes
    ----------
    name, source, unit, pv_unit : str
        Loop, file, units of OP and PV.
    width : float
        Total width of the gap in question [OP unit].
    op_within, pv_within : (float, float)
        Limits that no test passes [OP unit, PV unit].
    within : float
        Time that a test may take [min].
    tests : tuple of Planned
        By hand, by setpoint steps, by more hours.
    reason : str or None
        Why nothing could be planned at all, where that is no error: in the answer of `glapp.analyze`.
    """

    name: str
    source: str
    unit: str
    pv_unit: str
    width: float
    op_within: Limits
    pv_within: Limits
    within: float
    tests: tuple[Planned, ...]
    reason: str | None = None

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Plan:
        """The plan of `to_dict`."""
        pairs = ("op_within", "pv_within")
        tests = tuple(
            Planned(**test | {"moves": tuple(test["moves"])} | {key: _pair(test[key]) for key in ("op", "pv")})
            for test in document["tests"]
        )
        return cls(**{**document, "tests": tests, **{key: tuple(document[key]) for key in pairs}})

    @property
    def by_hand(self) -> Planned | None:
        """The test with OP by hand, where one can be proposed."""
        return next((test for test in self.tests if test.kind == "by_hand" and test.power is not None), None)

    def __repr__(self) -> str:
        tests = ", ".join(
            f"{test.kind} {'refused' if test.power is None else f'{test.power:.0%} in {test.minutes:.0f} min'}"
            for test in self.tests
        )
        return f"<Plan {self.name}: a gap of {self.width:.3g} {self.unit}; {tests}>"

    def __getitem__(self, kind: Kind) -> Planned:
        return next(test for test in self.tests if test.kind == kind)

    def to_dict(self) -> dict[str, Any]:
        """The plan in plain types, as `glapp plan-test --json` writes it."""
        return asdict(self)
