"""Width of the PV-OP ellipse: apparent stiction.

Source: Choudhury, Shah, Thornhill and Shook, *Automatic detection and quantification of stiction in control valves*,
Control Engineering Practice 14 (2006): an ellipse is fitted to PV over OP, both filtered to the oscillation, and its
width in the direction of OP is the apparent stiction. Rossi and Scali (J. Process Control 15, 2005) compare it with
other techniques.

Needs OP and PV of a loop that oscillates regularly, and to know that the valve is the cause: the paper settles that
before, by the bicoherence of the error, which asks for some 4000 samples and saw nothing in records as short as these.
So this method never says that there is a fault; it only gives a size. Made to rank sticking valves, not to measure
them: the width is the valve's dead band only where the process is fast against the cycle, since its lag opens the
ellipse too.
"""

from __future__ import annotations

import numpy as np

from ..answer import MethodAnswer
from ..oscillation import Floats, band_pass, oscillation
from ..records import Record


def answer(record: Record) -> MethodAnswer:
    """Apparent stiction of a loop that oscillates."""
    op, pv = record.column("OP"), record.column("PV")
    found = oscillation(record.column("SP") - pv)
    if found is None or found.regularity <= 1:
        return MethodAnswer("cannot_tell", reason="no regular oscillation")
    width = ellipse_width(band_pass(op, found.period), band_pass(pv, found.period))
    return MethodAnswer(
        "cannot_tell", d=width, reason="a size, if the valve sticks" if width else "PV over OP is no ellipse"
    )


def ellipse_width(x: Floats, y: Floats) -> float | None:
    """Longest chord along x of the ellipse A·x² + B·xy + C·y² = 1 fitted to points around 0; None for a hyperbola."""
    a, b = x.std(), y.std()
    if a == 0 or b == 0:
        return None
    u, v = x / a, y / b
    columns = np.column_stack([u * u, u * v, v * v])
    (p, q, r), *_ = np.linalg.lstsq(columns, np.ones(x.size), rcond=None)
    return float(2 * a / np.sqrt(p)) if p > 0 and 4 * p * r > q * q else None
