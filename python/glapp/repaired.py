"""A valve before and after its repair: the width, and the loop's gain in performance. `glapp.repair` makes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from datetime import datetime
from typing import Any, Literal

from .fit import DAY

__all__ = ["Between", "Difference", "Repair", "Side"]

Between = tuple[float, float, float]
"""A number with its 95 % limits."""


@dataclass(frozen=True, slots=True)
class Side:
    """The valve and its loop on one side of a repair.

    - `begin`, `end`: first and last row that was looked at; seconds where the recording has no date, None where there
      are no rows.
    - `verdict`, `confidence`: those of the answer of that side; None where there is none.
    - `d`, `low`, `high`: its width and limits [OP unit].
    - `days`: time in automatic that was looked at [d]; None, as all that follows, where too little was.
    - `deviation`: standard deviation of PV about SP with its 95 % limits [PV unit].
    - `travel`, `reversals`: travel [OP unit] and reversals of OP in a day.
    """

    begin: datetime | float | None = None
    end: datetime | float | None = None
    verdict: str | None = None
    confidence: str | None = None
    d: float | None = None
    low: float | None = None
    high: float | None = None
    days: float | None = None
    deviation: Between | None = None
    travel: Between | None = None
    reversals: Between | None = None


@dataclass(frozen=True, slots=True)
class Difference:
    """Difference of after and before.

    - `code`: whether the 95 % interval of the difference lies below 0, above 0, or holds 0.
    - `by`: after − before with its 95 % limits.
    """

    code: Literal["less", "more", "open"]
    by: Between


@dataclass(frozen=True, slots=True)
class Repair:
    """Before and after.

    - `noted`: time of the repair in the settings; None where only a fall of the width shows it.
    - `width`, `deviation`, `travel`, `reversals`: the difference; None where it is not known on both sides.
    """

    noted: datetime | None
    before: Side
    after: Side
    width: Difference | None = None
    deviation: Difference | None = None
    travel: Difference | None = None
    reversals: Difference | None = None

    @classmethod
    def from_core(cls, noted: datetime | None, sides: tuple[Side, Side], found: Mapping[str, Any]) -> Repair:
        """Repair with performance and differences, from those of `_glapp.before_after`."""
        before, after = (_with(side, found[name]) for side, name in zip(sides, ("before", "after"), strict=True))
        names = ("width", "deviation", "travel", "reversals")
        lie = {name: found[name] and Difference(found[name]["code"], tuple(found[name]["by"])) for name in names}
        return cls(noted, before, after, **lie)

    def to_dict(self) -> dict[str, Any]:
        """Before and after in plain types, as `glapp analyze --json` writes it."""
        document = asdict(self)
        document["noted"] = _text(self.noted)
        for name, side in (("before", self.before), ("after", self.after)):
            document[name] |= {"begin": _text(side.begin), "end": _text(side.end)}
        return document


def _with(side: Side, loop: Mapping[str, Any] | None) -> Side:
    """A side with the core's figures of its loop."""
    if loop is None:
        return side
    pairs = {name: loop[name] and tuple(loop[name]) for name in ("deviation", "travel", "reversals")}
    known = {field.name: getattr(side, field.name) for field in fields(side)}
    return Side(**known | pairs | {"days": loop["seconds"] / DAY})


def _text(moment: datetime | float | None) -> str | None:
    if moment is None:
        return None
    return moment.isoformat() if isinstance(moment, datetime) else f"{moment:g} s"
