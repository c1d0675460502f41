"""The width by maximum likelihood from OP and PV, `glapp.fit` (`docs/fit.md`).

Needs OP and PV; no settings. Made for any record of a loop in which OP moves, also where nothing oscillates.
"""

from __future__ import annotations

import glapp

from ..answer import MethodAnswer
from ..records import Record


def answer(record: Record) -> MethodAnswer:
    """Answer by `glapp.fit`, with the width where it gives one."""
    fit = glapp.fit(record.recording)
    if fit.verdict in ("backlash", "stiction", "both"):
        return MethodAnswer(fit.verdict, fit.d, fit.low, fit.high, reason=fit.reason)
    high = fit.high if fit.verdict == "sound" else None
    return MethodAnswer(fit.verdict, high=high, at_least=fit.at_least, reason=fit.reason)
