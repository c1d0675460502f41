"""The estimate of Haventon and Öberg (Lund 2008, TFRT-5826): zero crossings with the whole safety net.

Needs K, Ti, Td and the process gain; PV and SP (OP for a PID). Made for a detector that runs for months inside a
controller and waits for what it can use; it never claims that there is no gap. Its range of detections is no interval
of confidence (`docs/estimator.md`), so none is given.
"""

from __future__ import annotations

import glapp
from glapp.loop import Process

from ..answer import MethodAnswer
from ..records import Record


def answer(record: Record) -> MethodAnswer:
    """`glapp.estimate` with the true process gain."""
    result = glapp.estimate(recording(record))
    if result.d_hat is None:
        return MethodAnswer("cannot_tell", reason=result.verdict)
    return MethodAnswer("backlash", d=result.d_hat)


def recording(record: Record, **changes: float) -> glapp.Recording:
    """The recording, with the gain that the zero-crossing methods ask for."""
    loop = record.loop
    if record.kp is not None:
        loop = loop.model_copy(update={"process": Process(kp=record.kp, kp_unit="PV/OP")})
    return glapp.recording_from(record.table, loop.model_copy(update=changes))
