"""Horch's cross-correlation: stiction, or something else, behind an oscillation.

Source: Horch, *A simple method for detection of stiction in control valves*, Control Engineering Practice 7 (1999). The
correlation of OP with PV over the lag is odd (a quarter of a period apart) where the valve sticks, and even (opposite)
where a load outside, or an over-tuned loop, swings. With τl, τr the zero crossings on either side of lag 0, r0 the
value there and r_opt the extreme of the same sign between them,

    Δτ = abs(τl − τr)/(τl + τr),    Δρ = abs(r0 − r_opt)/abs(r0 + r_opt);

stiction where Δτ ≥ 2/3 and Δρ ≥ 1/3, not where Δτ ≤ 1/3 and Δρ ≤ (2 − √3)/(2 + √3), undecided between.

Needs OP and PV of a loop that is known to oscillate, PI control and a self-regulating process. Made for flow and
pressure loops in pulp and paper mills; gives no size.
"""

from __future__ import annotations

import math

import numpy as np

from ..answer import MethodAnswer
from ..oscillation import correlation, oscillation
from ..records import Record

EVEN = (2 - math.sqrt(3)) / (2 + math.sqrt(3))


def answer(record: Record) -> MethodAnswer:
    """The decision."""
    if record.loop.process.type == "integrating":
        return MethodAnswer("cannot_tell", reason="made for self-regulating processes")
    op, pv = record.column("OP"), record.column("PV")
    found = oscillation(record.column("SP") - pv)
    if found is None or found.regularity <= 1:
        return MethodAnswer("cannot_tell", reason="no regular oscillation")
    both = correlation(op, pv)
    middle = op.size - 1
    positive = np.signbit(both)
    changes = np.flatnonzero(positive[1:] != positive[:-1])
    left, right = changes[changes < middle], changes[changes >= middle]
    if not left.size or not right.size:
        return MethodAnswer("cannot_tell", reason="the correlation does not cross zero on both sides")

    def crossing(i: int) -> float:
        return float(i + both[i] / (both[i] - both[i + 1]))

    tau_l, tau_r = middle - crossing(int(left[-1])), crossing(int(right[0])) - middle
    r0 = float(both[middle])
    r_opt = math.copysign(float(np.abs(both[left[-1] + 1 : right[0] + 1]).max(initial=abs(r0))), r0)
    delta_tau = abs(tau_l - tau_r) / (tau_l + tau_r)
    delta_rho = abs(r0 - r_opt) / abs(r0 + r_opt) if r0 + r_opt else 1.0
    if delta_tau >= 2 / 3 and delta_rho >= 1 / 3:
        return MethodAnswer("valve")
    if delta_tau <= 1 / 3 and delta_rho <= EVEN:
        return MethodAnswer("not valve")
    return MethodAnswer("cannot_tell", reason=f"Δτ = {delta_tau:.2f}, Δρ = {delta_rho:.2f}: undecided")
