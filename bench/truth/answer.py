"""Answer of a method on a record, in terms common to all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Verdict = Literal[
    "backlash", "stiction", "both", "valve", "at_least", "oscillation", "sound", "not valve", "cannot_tell"
]
"""*valve*: stiction or backlash, without a choice. *not valve*: the cause lies elsewhere, or there is none."""

FAULT = ("backlash", "stiction", "both", "valve", "at_least")
"""Verdicts that send somebody to the valve."""

DENIAL = ("oscillation", "sound", "not valve")
"""Verdicts that keep people away from it."""


@dataclass(frozen=True)
class MethodAnswer:
    """The answer.

    - `d`, `low`, `high`: dead band, and its 95 % interval where the method gives one; `high` alone is an upper limit [%
      of OP].
    - `at_least`: lower bound [% of OP].
    - `reason`: why there is no more, for a person.
    """

    verdict: Verdict
    d: float | None = None
    low: float | None = None
    high: float | None = None
    at_least: float | None = None
    reason: str = ""
