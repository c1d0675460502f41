"""The page of a step test that a plant files: sequence, dead band, resolution, T86, overshoot, pass or fail.

The terms are those of ISA-75.25.01, IEC 60534-4 and IEC 61298-2. One A4 page a test, without scripts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from statistics import median
from typing import Literal

import numpy as np
from markupsafe import Markup, escape

from .. import _glapp
from ..escape import escaped
from ..loop import Loop
from ..recording import with_op_unit
from ..step_test import Reading, StepTest
from ..writing import GENERATOR
from . import words
from .html import templates

__all__ = ["NOMINAL", "Judged", "form_page", "judged"]

NOMINAL: float = _glapp.NOMINAL_LIMIT
"""Dead band that is allowed where none is given: EnTech's nominal one [% of span]."""


@dataclass(frozen=True, slots=True)
class Judged:
    """A step test compared with the dead band that is allowed.

    Attributes
    ----------
    test : StepTest
    verdict : "pass", "fail", "open"
        *pass*: the interval ends within what is allowed; *fail*: it begins beyond; *open*: it does neither, or there is
        no width or no span.
    allowed : float
        [% of span].
    origin : str
        Who allowed it.
    by : str
        "travel" where the valve's position gives the width, else "PV".
    low, high : float or None
        The interval [% of span].
    """

    test: StepTest
    verdict: Literal["pass", "fail", "open"]
    allowed: float
    origin: str
    by: Literal["travel", "PV"]
    low: float | None
    high: float | None


def judged(test: StepTest, loop: Loop, allowed: float | None = None) -> Judged:
    """Hold a step test against the dead band that is allowed.

    - `loop`: whose OP span and acceptable dead band count.
    - `allowed`: widest dead band that passes [% of span]; the loop's `acceptable_dead_band` where not given, else
      `NOMINAL`.

    Examples
    --------
    >>> test = StepTest("FIC1", "a.csv", "%", "%", None, d=2.0, low=1.8, high=2.2, d_percent_span=2.0)
    >>> loop = Loop(name="FIC1", op_span=(0, 100))
    >>> judged(test, loop).verdict, judged(test, loop, 3.0).verdict, judged(test, loop, 2.0).verdict
    ('fail', 'pass', 'open')
    """
    origin = "given for this test"
    if allowed is None:
        given = loop.acceptable_dead_band
        allowed, origin = (given, "given for this loop") if given is not None else (NOMINAL, "EnTech's nominal value")
    read, by = (test.travel, "travel") if test.travel is not None and test.travel.d is not None else (test, "PV")
    span = (loop if test.signals is None else with_op_unit(loop, test.signals)).op_range()
    to_percent = None if span is None else 100.0 / (span[1] - span[0])
    low, high = (None if limit is None or to_percent is None else limit * to_percent for limit in (read.low, read.high))
    verdict: Literal["pass", "fail", "open"] = "open"
    if low is not None and low > allowed:
        verdict = "fail"
    elif high is not None and high <= allowed:
        verdict = "pass"
    return Judged(test, verdict, allowed, origin, by, low, high)  # type: ignore[arg-type]


def form_page(tests: Sequence[Judged]) -> str:
    """One A4 page a test."""
    return (
        templates()
        .get_template("form.html")
        .render(generator=Markup(GENERATOR), version=version("glapp"), pages=[_page(test) for test in tests])
    )


_VERDICTS = {"pass": "Pass", "fail": "Fail", "open": "Not decided"}


def _page(judgement: Judged) -> dict[str, object]:
    """Fields of one page of the form."""
    test = judgement.test
    op = words.op_unit(test.unit)
    signals = [("PV", test)] if test.travel is None else [("Valve travel", test.travel), ("PV", test)]
    rows = test.signals
    at = [] if rows is None or not len(rows) else [words.clock(test.t0, float(rows.t[k])) for k in (0, -1)]
    return {
        "name": test.name,
        "source": test.source,
        "begin": at[0] if at else "",
        "end": at[1] if at else "",
        "verdict": _VERDICTS[judgement.verdict],
        "kind": judgement.verdict,
        "so": _reason_text(judgement),
        "signals": [name for name, _ in signals],
        "terms": [(term, [tell(read) for _, read in signals]) for term, tell in _terms(op)],
        "op": op,
        "pv": test.pv_unit,
        "moves": [_move(i, reading, test) for i, reading in enumerate(test.readings, 1)],
        "notes": test.notes,
        "picture": Markup(_picture(test)),
        "process": test.travel is None,
    }


def _reason_text(judgement: Judged) -> str:
    """Reason of the verdict; no number is parted from its unit."""
    return _reason(judgement).replace(" % of span", "\N{NO-BREAK SPACE}% of span")


def _reason(judgement: Judged) -> str:
    allowed = f"{words.number(judgement.allowed)} % of span is allowed ({judgement.origin})"
    by = "the valve's travel" if judgement.by == "travel" else "PV"
    if judgement.test.reason is not None and judgement.low is None:
        return f"{judgement.test.reason[0].upper()}{judgement.test.reason[1:]}. {allowed[0].upper()}{allowed[1:]}."
    if judgement.low is None:
        return f"OP's span is not known, so the dead band is not held against a limit. {allowed}."
    if judgement.high is None:
        return f"Dead band by {by}: at least {words.number(judgement.low)} % of span. {allowed}."
    width = f"{words.number(judgement.low)} to {words.number(judgement.high)} % of span (95 % interval)"
    return f"Dead band by {by}: {width}. {allowed}."


def _terms(op: str) -> list[tuple[str, Callable[[StepTest], str]]]:
    """Each term with its text for a signal."""

    def dead_band(read: StepTest) -> str:
        if read.d is None:
            return "not measured" if not read.low else f"at least {words.quantity(read.low, op)}"
        return f"{words.quantity(read.d, op)} (95 %: {words.number(read.low)} to {words.quantity(read.high, op)})"

    def resolution(read: StepTest) -> str:
        return "not measured" if read.resolution is None else f"{words.quantity(read.resolution, op)} or finer"

    def t86(read: StepTest) -> str:
        times = [reading.t86 for reading in read.readings if reading.t86 is not None]
        if not times:
            return "not measured"
        least = f" ({words.number(min(times))} to {words.quantity(max(times), 's')})" if len(times) > 1 else ""
        return f"{words.quantity(median(times), 's')}, median of {len(times)} {'steps' if least else 'step'}{least}"

    def overshoot(read: StepTest) -> str:
        shares = [reading.overshoot for reading in read.readings if reading.overshoot is not None]
        if not shares:
            return "not measured"
        if max(shares) == 0:
            return "none beyond the noise"
        most = f"at most {words.number(100 * max(shares))} %"
        if (middle := median(shares)) == 0:
            return f"{most} of the step, none in most steps"
        return f"{words.number(100 * middle)} % of the step, median of {len(shares)} ({most})"

    def gain(read: StepTest) -> str:
        if read.kp is None:
            return "not measured"
        unit = f"{read.pv_unit}/{op}" + ("/s" if read.integrating else "")
        return f"{words.quantity(read.kp, unit)} (95 %: {words.number(read.kp_low)} to {words.number(read.kp_high)})"

    return [
        ("Dead band", dead_band),
        ("Resolution", resolution),
        ("Step response time T86", t86),
        ("Overshoot", overshoot),
        ("Gain", gain),
    ]


_GIVES = {"gain": "gain", "gap": "dead band", "none": "–"}


def _move(i: int, reading: Reading, test: StepTest) -> list[str]:
    """Cells of a move's row."""
    up = reading.op[1] > reading.op[0]
    held = next((hold.end - hold.start for hold in test.holds if hold.end == reading.end), None)
    value = "" if reading.value is None else f" {words.number(reading.value)}"
    return [
        str(i),
        words.clock(test.t0, reading.start),
        " → ".join(words.number(x, 4) for x in reading.op),
        ("up" if up else "down") + (", reversed" if reading.kind == "gap" else ""),
        words.number(held),
        " → ".join(words.number(x, 4) for x in reading.pv),
        words.number(reading.t86),
        "–" if reading.overshoot is None else f"{100 * reading.overshoot:.0f} %",
        _GIVES[reading.kind] + value,
    ]


def _picture(test: StepTest) -> str:
    """PV and OP over time as SVG."""
    rows = test.signals
    if rows is None or rows.op is None or len(rows) < 2:
        return ""
    wide, high = 1000.0, 150.0
    t = rows.t - rows.t[0]
    parts = []
    panels = [("PV", test.pv_unit, [(rows.pv, "pv")]), ("OP", words.op_unit(test.unit), [(rows.op, "op")])]
    if rows.position is not None:
        panels[1][2].insert(0, (rows.position, "travel"))
    for i, (name, unit, lines) in enumerate(panels):
        top = i * (high + 24.0)
        every = np.concatenate([y[np.isfinite(y)] for y, _ in lines])
        if not every.size:
            continue
        low, most = float(every.min()), float(every.max())
        room = (most - low) or 1.0
        for y, kind in lines:
            keep = _thinned(y)
            good = keep[np.isfinite(y[keep])]
            x = 60 + (wide - 60) * t[good] / t[-1]
            at = top + high - high * (y[good] - low) / room
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, at, strict=True))
            parts.append(f'<polyline class="{kind}" points="{points}"/>')
        for value, place in ((most, top + 10), (low, top + high)):
            parts.append(f'<text x="54" y="{place:.0f}" text-anchor="end">{words.number(value, 4)}</text>')
        label = escape(escaped(f"{name} [{unit}]"))
        parts.append(f'<text x="0" y="{top + high / 2:.0f}">{label}</text>')
    total = len(panels) * (high + 24.0)
    seconds = words.quantity(float(t[-1]), "s")
    parts.append(f'<text x="{wide:.0f}" y="{total - 8:.0f}" text-anchor="end">{seconds}</text>')
    return (
        f'<svg viewBox="0 0 {wide:.0f} {total:.0f}" role="img" aria-label="PV and OP over time">{"".join(parts)}</svg>'
    )


def _thinned(y: np.ndarray, most: int = 1500) -> np.ndarray:
    """Rows of the least and the greatest value in each of `most` pieces."""
    if len(y) <= 2 * most:
        return np.arange(len(y))
    filled = np.where(np.isfinite(y), y, np.nanmedian(y))
    pieces = np.array_split(np.arange(len(y)), most)
    rows = {int(piece[k(filled[piece])]) for piece in pieces for k in (np.argmin, np.argmax)}
    return np.array(sorted(rows | {0, len(y) - 1}))
