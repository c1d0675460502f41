"""Records: a historian's data of a simulated loop, and the truth, apart from them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import count

import numpy as np
import numpy.typing as npt
import pyarrow as pa

import glapp
from glapp.errors import InputError
from glapp.simulate import Simulation, run

from .design import Cell, Drawn, draw
from .oscillation import regular

Floats = npt.NDArray[np.float64]

TRAVERSALS = 5
"""Fewest traversals of the gap each way."""

CANDIDATES = 300
"""Number of loops that are tried for one record before a cell is given up."""


@dataclass(frozen=True)
class Truth:
    """Truth of a record, known to no method.

    - `name`: "cause/load/family/number"; `record(name)` makes the record again.
    - `cause`, `load`, `family`, `departure`, `process`, `rule`, `setpoint`: as in `design`.
    - `op_resolution`, `load_size`: steps that OP is rounded to, 0 for none; as in `design` [%].
    - `d`, `jump`: whole dead band and slip jump [% of OP].
    - `up`, `down`: traversals of the whole gap that a sample of the recording tells from one another: reversals of the
      valve.
    - `op_range`, `op_unseen`: OP, peak to peak; and how far it goes, between two recorded samples, from the line
      through them (99 % of the time it is less) [%].
    - `sigma`: standard deviation of all that lies between the process and the recorded PV [PV unit].
    - `gain`, `lag`, `h`: Kp (see `Drawn.gain`), T and time between recorded samples [PV unit/%, s, s].
    - `samples`: length of the recording.
    - `identifiable`: `identifiable` of these numbers; with d = 0 the question does not arise, and it is False.
    - `cause_told`: the slip jump can be seen: J ≥ 3σ/Kp, and the cycles are enough.
    - `regular`: the error of the recording oscillates regularly, which most methods for the cause ask for.
    """

    name: str
    cause: str
    load: str
    family: str
    departure: str
    process: str
    rule: str
    setpoint: str
    op_resolution: float
    load_size: float
    d: float
    jump: float
    up: int
    down: int
    op_range: float
    op_unseen: float
    sigma: float
    gain: float
    lag: float
    h: float
    samples: int
    identifiable: bool
    cause_told: bool
    regular: bool

    @property
    def cell(self) -> Cell:
        """The cell of the design."""
        return Cell(self.cause, self.load, self.family)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Record:
    """Data of a record that a method may see.

    - `table`: columns t [s], SP, PV, OP, OP_LOW, OP_HIGH: no valve position and no load.
    - `loop`: name, spans, controller, and whether the process integrates.
    - `kp`: the true static gain [PV unit/%], for the methods that ask for it; None for an integrating process.
    """

    table: pa.Table
    loop: glapp.Loop
    kp: float | None

    @property
    def recording(self) -> glapp.Recording:
        """The recording that every method of glapp takes."""
        return glapp.recording_from(self.table, self.loop)

    def column(self, name: str) -> Floats:
        """A signal."""
        values: Floats = self.table[name].to_numpy()
        return values


def traversals(position: Floats) -> tuple[int, int]:
    """Numbers of times that the valve began to move up after it had moved down, and down after up.

    Between the two OP has crossed the whole gap, or gap and stick band; the position does not change while it does.
    """
    moves = np.sign(np.diff(position))
    moves = moves[moves != 0]
    turns = np.diff(moves)
    return int((turns > 0).sum()), int((turns < 0).sum())


def identifiable(
    d: float, up: int, down: int, op_range: float, gain: float, sigma: float, h: float, lag: float
) -> bool:
    """Whether the gap can be known: 5 traversals each way, OP ≥ 1.5·d, d·Kp ≥ 3σ, h ≤ T/5."""
    return d > 0 and min(up, down) >= TRAVERSALS and op_range >= 1.5 * d and d * abs(gain) >= 3 * sigma and h <= lag / 5


def compressed(pv: Floats, band: float) -> Floats:
    """Data of a historian that keeps a value until the next one differs from it by more than `band`."""
    kept = pv.tolist()
    held = kept[0]
    for i, value in enumerate(kept):
        if abs(value - held) > band:
            held = value
        kept[i] = held
    return np.array(kept)


def record(name: str) -> tuple[Record, Truth] | None:
    """Make the record of that name; None where it is no record.

    That is a tuning that does not exist for the process, a loop that is unstable, and OP at its limits where saturation
    is not what the record is about, or at them for less than 1 % or more than half of the time where it is.
    """
    drawn = draw(name)
    if drawn is None:
        return None
    try:
        simulation = run(drawn.scenario)
    except InputError:
        return None
    kept = slice(0, None, drawn.every)
    saturated = float(np.mean(simulation.flags[kept] != 0))
    if not (0.01 < saturated < 0.5 if drawn.departure == "saturation" else saturated == 0):
        return None
    made = _recorded(drawn, simulation, kept)
    return made, _truth(name, drawn, simulation, kept, regular(made.column("SP") - made.column("PV")))


def _recorded(drawn: Drawn, simulation: Simulation, kept: slice) -> Record:
    pv = simulation.pv[kept]
    if drawn.band:
        pv = compressed(pv, drawn.band)
    table = simulation.to_arrow().select(["t", "SP", "OP", "OP_LOW", "OP_HIGH"])
    table = table.take(np.arange(simulation.t.size)[kept]).append_column("PV", pa.array(pv))
    kp = drawn.scenario.process_gain()
    loop = glapp.Loop(
        name=drawn.scenario.name,
        pv_span=(0, 100),
        op_span=(0, 100),
        controller=drawn.scenario.controller,
        process=glapp.loop.Process(type="self-regulating" if kp is not None else "integrating"),
    )
    return Record(table, loop, kp)


def _truth(name: str, drawn: Drawn, simulation: Simulation, kept: slice, regular: bool) -> Truth:
    up, down = traversals(simulation.position[kept])
    op = simulation.op[kept]
    line = np.interp(simulation.t, simulation.t[kept], op)
    h = drawn.scenario.h * drawn.every
    # The held value is off by anything between ± band.
    sigma = math.hypot(drawn.noise, drawn.band / math.sqrt(3))
    cause, load, family, _ = name.split("/")
    numbers = {
        "d": drawn.d,
        "up": up,
        "down": down,
        "op_range": float(np.ptp(op)),
        "gain": drawn.gain,
        "sigma": sigma,
        "h": h,
        "lag": drawn.lag,
    }
    return Truth(
        name=name,
        cause=cause,
        load=load,
        family=family,
        departure=drawn.departure,
        process=drawn.process,
        rule=drawn.rule,
        setpoint=drawn.setpoint,
        op_resolution=drawn.scenario.op_resolution,
        load_size=drawn.load_size,
        jump=drawn.jump,
        samples=op.size,
        op_unseen=float(np.percentile(np.abs(simulation.op - line), 99)),
        identifiable=identifiable(**numbers),
        cause_told=drawn.jump * abs(drawn.gain) >= 3 * sigma and min(up, down) >= TRAVERSALS,
        regular=regular,
        **numbers,
    )


def truth_of(name: str) -> Truth | None:
    """The truth alone."""
    made = record(name)
    return None if made is None else made[1]


def chosen(cell: Cell, each: int, pool: Executor) -> Iterator[Truth]:
    """The first `each` records of a cell; where there is a gap, so many identifiable and so many others."""
    wanted = {True: each if cell.cause not in ("none", "oscillation") else 0, False: each}
    numbers = count()
    tried = 0
    while any(wanted.values()) and tried < CANDIDATES * each:
        names = [f"{cell}/{next(numbers)}" for _ in range(4 * each)]
        tried += len(names)
        for truth in pool.map(truth_of, names, chunksize=8):
            if truth is not None and wanted[truth.identifiable]:
                wanted[truth.identifiable] -= 1
                yield truth
