"""Yamashita's pattern index: how much of the time OP moves and the flow does not.

Source: Yamashita, *An automatic method for detection of valve stiction in process control loops*, Control Engineering
Practice 14 (2006). The moves of OP and of the flow are normalised by their mean and standard deviation and become
symbols: increasing, steady, decreasing. ρ1 is the share of samples where OP moves and the flow is steady (IS, DS), of
all where not both are steady; two of eight patterns are that, so that chance gives 1/4: stiction where ρ1 > 1/4. (ρ3
of the paper takes off what is not followed by a move of the flow after OP; on our simulations of valves that stick it
finds fewer of them, and no fewer false ones.)

Needs OP and the flow through the valve, or its position; PV is that only in flow loops. Made for limit cycles of flow
loops; gives no size. How far from 0 a move counts, and how the record is sampled, is left open there; here a quarter of
the standard deviation and about 30 samples a cycle, with which the simulations come out best.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..answer import MethodAnswer
from ..oscillation import oscillation
from ..records import Floats, Record

LIMIT = 0.25
STEADY = 0.25
A_CYCLE = 30


def answer(record: Record) -> MethodAnswer:
    """The decision."""
    op, pv = record.column("OP"), record.column("PV")
    found = oscillation(record.column("SP") - pv)
    thin = max(round(found.period / A_CYCLE), 1) if found else 1
    return MethodAnswer("valve" if rho1(op[::thin], pv[::thin]) > LIMIT else "not valve")


def rho1(op: Floats, flow: Floats) -> float:
    """The index ρ1; 0 where nothing moves."""
    x, y = _symbols(op), _symbols(flow)
    moving = (x != 0) | (y != 0)
    return float(np.mean(y[moving] == 0)) if moving.any() else 0.0


def _symbols(signal: Floats) -> npt.NDArray[np.int8]:
    """+1 increasing, 0 steady, −1 decreasing."""
    moves = np.diff(signal)
    scatter = moves.std()
    if scatter == 0:
        return np.zeros(moves.size, np.int8)
    normalised = (moves - moves.mean()) / scatter
    symbols: npt.NDArray[np.int8] = (np.sign(normalised) * (np.abs(normalised) > STEADY)).astype(np.int8)
    return symbols
