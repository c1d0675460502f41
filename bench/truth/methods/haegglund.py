"""Hägglund's estimate with the conditions of the article and no more.

Source: Hägglund, *Automatic on-line estimation of backlash in control loops*, J. Process Control 17 (2007): between two
zero crossings of the filtered error, d̂ = (K·Δt/Ti − 1/Kp)·Δy where Δt is long against Ti, here 5Ti, and the error is
like a square wave, e_max < 2Δy. The filter is (2.1): Td/5, or Ti/10. Answer: the median of all detections.

Needs K, Ti, the process gain, PV and SP. Made for a self-regulating loop that lies still but for its gap; the article
itself says that the net around it must be extended, which the thesis did.
"""

from __future__ import annotations

import numpy as np

import glapp

from ..answer import MethodAnswer
from ..records import Record
from .thesis import recording

LONG = 5.0
"""Shortest half-period [Ti]."""


def answer(record: Record) -> MethodAnswer:
    """The median of the detections."""
    ideal = record.loop.ideal()
    assert ideal is not None
    tf = ideal.td / 5 if ideal.td > 0 else ideal.ti / 10
    rows = glapp.estimate(recording(record, tf=tf)).half_periods
    square = rows.e_max < 2 * rows.delta_y
    # (2.4) as printed: the derivative part and OP's own travel are the thesis' additions.
    widths = (rows.delta_u - rows.kp_part)[(rows.delta_t > LONG * ideal.ti) & square]
    widths = widths[widths > 0]
    if not widths.size:
        return MethodAnswer("cannot_tell", reason="no half-period is long enough and square")
    return MethodAnswer("backlash", d=float(np.median(widths)))
