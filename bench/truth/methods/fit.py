"""The width by maximum likelihood from OP and PV, `glapp.fit` (`docs/fit.md`).

Needs OP and PV; no settings. Made for any record of a loop in which OP moves, also where nothing oscillates.
"""

from __future__ import annotations

import glapp

from ..answer import MethodAnswer
from ..records import Record


def answer(record: Record) -> MethodAnswer:
    """Answer by `glapp.fit` where a gap is *found*, with the width where it gives one."""
    return _claimed(glapp.fit(record.recording))


def likely(record: Record) -> MethodAnswer:
    """The same where a gap is *found* or *likely*.

    A likely one whose width is unsure is a faulty valve without a width.
    """
    fit = glapp.fit(record.recording)
    judgement = fit.judgement or {}
    if judgement.get("confidence") != "likely":
        return _claimed(fit)
    if judgement["width_kind"] == "interval":
        return MethodAnswer("backlash", fit.d, fit.low, fit.high, reason=fit.reason)
    return MethodAnswer("valve", reason=fit.reason)


def _claimed(fit: glapp.Fit) -> MethodAnswer:
    if fit.verdict in ("backlash", "stiction", "both"):
        return MethodAnswer(fit.verdict, fit.d, fit.low, fit.high, reason=fit.reason)
    high = fit.high if fit.verdict == "sound" else None
    return MethodAnswer(fit.verdict, high=high, at_least=fit.at_least, reason=fit.reason)
