"""What the valve's own position says of its gap, in words and beside what PV says; `docs/fit.md` has the method."""

from __future__ import annotations

from typing import Any

__all__ = ["COPY", "Interval", "position_reason"]

Interval = tuple[float, float | None]
"""Lower and upper limit, None where there is no upper one."""

COPY = (
    "the position equals OP in every row to the last digit, as no sensor's does: it is what was demanded of the valve, "
    "not where it stands. Record the positioner's feedback"
)


def position_reason(verdict: str, d: float, low: float, high: float | None, unit: str, best: dict[str, Any]) -> str:
    """The verdict and its evidence in one sentence."""
    up, down = best["traversals"]
    evidence = (
        f"without one the position would be {best['lr_no_gap']:.0f} units of 2·ln L less likely, where "
        f"{best['lr_needed']:.0f} are needed; the valve turned {up} times up and {down} down"
    )
    kind, step = best["recorder"]
    recorder = ""
    if kind == "kept":
        recorder = (
            f"; it was recorded only once it had moved by {step:.3g}, which may hide as much more. "
            "Record it as it is, without an exception band"
        )
    match verdict:
        case "backlash":
            return f"a gap of {d:.3g} {unit}: {evidence}{recorder}"
        case "stiction":
            return f"the valve sticks and jumps by {best['jump']:.3g} {unit}, no gap beside it: {evidence}{recorder}"
        case "both":
            return f"lost motion of {d:.3g} {unit} with jumps of {best['jump']:.3g} {unit} in it: {evidence}{recorder}"
        case "at_least":
            return f"at least {low:.3g} {unit} are lost: {evidence}, too seldom to tell how much more it is{recorder}"
        case "sound":
            return f"no gap wider than {high:.3g} {unit} (95 %): the position follows each turn of OP{recorder}"
        case _ if best["reason"] == "copy":
            return COPY
        case _ if best["reason"] == "no_answer":
            return (
                f"the position does not follow OP, which explains {max(0.0, best['explained']):.0%} of it: is it that "
                "of the valve that this OP moves?"
            )
        case _:
            most = "any width" if high is None else f"a gap of up to {high:.3g} {unit}"
            return f"{most} would fit the position, and none would as well{recorder}"
