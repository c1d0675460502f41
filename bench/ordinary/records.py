"""Records of the corpus: a historian's data of a simulated loop, and its truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from random import Random

import numpy as np
import pyarrow as pa

import glapp
from glapp.loop import Process
from glapp.scenario import Samples, Scenario, Valve
from glapp.simulate import Simulation, run

from ..truth.records import identifiable
from .design import (
    Drawn,
    Fault,
    Half,
    NoSuchLoopError,
    cycle_of,
    draw,
    half,
    kept_values,
    names,
    swing_of,
)
from .load import Floats, lagged, swing

LIMIT = 1.0
"""Width that is acceptable where nobody gives one [% of OP]."""

SWEEPS = 8
"""Turns of the slow sweep in which a valve's width is read off."""

SOON = 13
"""A slip comes within so many steps of the sweep, an eighth of the width, after the valve has moved."""

LEAST_MOVE = 0.02
"""A valve has moved when it did so by this part of the width that its clearance and Coulomb friction make."""


@dataclass(frozen=True)
class Truth:
    """Truth of the record, known to no method.

    Attributes
    ----------
    name, row : str
        "row/fault/number/seed"; `record(name)` makes the record again.
    fault : Fault
    number, seed : int
    half : str
        "A" to "G".
    service, kind : str
        As in `design.Drawn`.
    outside : list of str
        Ways out of what the fit models; none for half of the records.
    d, d_low, d_high : float
        Total width that a slow sweep of the valve shows, and the least and greatest of its turns [% of OP]; 0 for none.
        Of a mere clearance all are its own width.
    jump : float
        Slip jump in that sweep, the median of its turns; 0 where the valve only slides [% of OP].
    up, down : int
        Traversals each way: reversals after which the valve moved by a tenth of `d`.
    op_range : float
        OP, peak to peak [%].
    op_turns : int
        Turns of OP between which it moved by `LIMIT` or more.
    size, ms : float
        As in `Drawn`.
    sigma, gain, lag, dead_time, h : float
        As in `Drawn` [PV unit, PV unit/%, s, s, s]; sigma with what the historian's band adds, lag with the actuator's.
    lags : list of float
        As in `Drawn`, and that of the actuator.
    samples : int
        Rows.
    integrating : bool
    identifiable : bool
        By the rule of `bench.truth` but for h: 5 traversals each way, OP ≥ 1.5·d, d·Kp ≥ 3σ.
    apart : bool
        Rows are further apart than a fifth of T.
    period, swing : float
        Period [s] and peak to peak of OP [%] of the cycle in rows of limit cycles; 0 in others.
    """

    name: str
    row: str
    fault: Fault
    number: int
    seed: int
    half: Half
    service: str
    kind: str
    outside: list[str]
    d: float
    d_low: float
    d_high: float
    jump: float
    up: int
    down: int
    op_range: float
    op_turns: int
    size: float
    ms: float
    sigma: float
    gain: float
    lag: float
    dead_time: float
    lags: list[float]
    h: float
    samples: int
    integrating: bool
    identifiable: bool
    apart: bool
    period: float
    swing: float


@dataclass(frozen=True)
class Record:
    """A recording with its truth.

    Attributes
    ----------
    table : pyarrow.Table
        Columns t [s], SP, PV, OP, MODE.
    loop : glapp.Loop
        Name, spans, controller, and whether the process integrates.
    truth : Truth
    position : float64
        Where the valve's plug stood at each row [%]; no method sees it.
    """

    table: pa.Table
    loop: glapp.Loop
    truth: Truth
    position: Floats

    @property
    def recording(self) -> glapp.Recording:
        """The recording that every method of glapp takes."""
        return glapp.recording_from(self.table, self.loop)


@lru_cache(maxsize=8)
def simulated(name: str) -> tuple[Drawn, Simulation]:
    """The loop of that name and its signals; a driven twin with the load that drives it."""
    drawn = draw(name)
    if drawn.fault != "driven":
        return drawn, run(drawn.scenario)
    of = "friction" if drawn.row == "friction cycle" else "gap"
    period, size = cycle(name.replace("/driven/", f"/{of}/"))
    random = Random(f"ordinary/{drawn.seed}/{drawn.row}/{drawn.number}/swing")
    shape, uneven = ("sine", "saw", "square")[drawn.number // 2 % 3], random.random() < 0.5
    t = np.arange(int(drawn.scenario.t_end / drawn.scenario.h + 1e-9) + 1) * drawn.scenario.h
    unit = swing(random, shape, period, t, uneven)
    height, simulation = size / 2, None
    for _ in range(3):
        load = (*drawn.scenario.load, Samples(values=height * (unit - unit[0])))
        driven = drawn.scenario.model_copy(update={"load": load})
        simulation = run(driven)
        reached = swing_of(simulation.op, period / drawn.scenario.h)
        drawn = replace(drawn, kind="swing", size=2 * height)
        if reached <= 0.0 or abs(reached / size - 1) < 0.05:
            break
        height *= min(max(size / reached, 0.2), 5.0)
    assert simulation is not None
    return drawn, simulation


@lru_cache(maxsize=64)
def cycle(name: str) -> tuple[float, float]:
    """Period [s] and peak to peak of OP [%] of the cycle in that record."""
    drawn, simulation = simulated(name)
    period, size, _ = cycle_of(simulation.op, drawn.scenario.h)
    return period, size


def record(name: str) -> Record:
    """Make the record of that name."""
    drawn, simulation = simulated(name)
    kept = slice(0, None, drawn.every)
    table = _recorded(drawn, simulation, kept)
    process = Process(type="integrating" if drawn.scenario.process_gain() is None else "self-regulating")
    loop = glapp.Loop(
        name=name, pv_span=(0, 100), op_span=(0, 100), controller=drawn.scenario.controller, process=process
    )
    return Record(table, loop, _truth(drawn, simulation, kept, table.num_rows), simulation.position[kept])


def _recorded(drawn: Drawn, simulation: Simulation, kept: slice) -> pa.Table:
    t, sp, pv, op = simulation.t[kept], simulation.sp[kept], simulation.pv, simulation.op[kept]
    if drawn.sensor > 0.0:
        pv = lagged(pv, drawn.sensor, drawn.scenario.h)
    pv = kept_values(pv[kept], drawn.recorder, drawn.pv_band)
    op = kept_values(op, drawn.recorder, drawn.op_band)
    if drawn.decimals > 0.0:
        pv, op = (np.round(x / drawn.decimals) * drawn.decimals for x in (pv, op))
    mode = simulation.to_arrow()["MODE"].combine_chunks().take(pa.array(np.arange(simulation.t.size)[kept]))
    table = pa.table({"t": t, "SP": sp, "PV": pv, "OP": op, "MODE": mode})
    if drawn.recorder == "events":
        moved = (np.diff(pv, prepend=np.inf) != 0) | (np.diff(op, prepend=np.inf) != 0)
        moved[-1] = True
        table = table.filter(pa.array(moved))
    return table


def _truth(drawn: Drawn, simulation: Simulation, kept: slice, rows: int) -> Truth:
    d, d_low, d_high, jump = width(drawn)
    valve = drawn.scenario.valve
    lags = [*drawn.lags, valve.lag / (1 + valve.positioner)] if valve is not None and valve.lag else [*drawn.lags]
    position, op = simulation.position[kept], simulation.op[kept]
    up, down = reversals(position, max(0.1 * d, 1e-6)) if d > 0 else (0, 0)
    op_range = float(np.ptp(op))
    # A value that is held, or stands for a line, is off by anything between ± band.
    sigma = math.hypot(drawn.sigma, drawn.pv_band / math.sqrt(3) if drawn.recorder else 0.0)
    period, swings = 0.0, 0.0
    if drawn.row in ("gap cycle", "perstorp", "friction cycle") and drawn.fault != "none":
        period, swings, _ = cycle_of(simulation.op, drawn.scenario.h)
    return Truth(
        name=drawn.name,
        row=drawn.row,
        fault=drawn.fault,
        number=drawn.number,
        seed=drawn.seed,
        half=half(drawn.number, drawn.seed),
        service=drawn.service,
        kind=drawn.kind,
        outside=list(drawn.outside),
        d=d,
        d_low=d_low,
        d_high=d_high,
        jump=jump,
        up=up,
        down=down,
        op_range=op_range,
        op_turns=sum(reversals(op, LIMIT)),
        size=drawn.size,
        ms=drawn.ms,
        sigma=sigma,
        gain=drawn.gain,
        lag=sum(lags),
        dead_time=drawn.scenario.plant.dead_time,
        lags=lags,
        h=drawn.h,
        samples=rows,
        integrating=drawn.scenario.process_gain() is None,
        identifiable=identifiable(d, up, down, op_range, drawn.gain, sigma, 0.0, drawn.lag),
        apart=drawn.h > drawn.lag / 5,
        period=period,
        swing=swings,
    )


def reversals(x: Floats, least: float) -> tuple[int, int]:
    """Numbers of turns of x upwards and downwards, with a move of `least` or more each way."""
    moves = np.sign(np.diff(x))
    at = np.flatnonzero(moves)
    turned = at[1:][moves[at[1:]] != moves[at[:-1]]]
    corners = [float(x[0]), *x[turned].tolist(), float(x[-1])]
    up = down = direction = 0
    extreme = low = high = corners[0]
    for value in corners[1:]:
        if direction == 0:
            low, high = min(low, value), max(high, value)
            if value - low >= least or high - value >= least:
                direction, extreme = (1 if value - low >= least else -1), value
        elif (value - extreme) * direction >= 0:
            extreme = value
        elif abs(value - extreme) >= least:
            direction, extreme = -direction, value
            up, down = up + (direction > 0), down + (direction < 0)
    return up, down


def width(drawn: Drawn) -> tuple[float, float, float, float]:
    """Total width, its least and greatest, and the slip jump, by a slow sweep of the valve [% of OP]."""
    scenario: Scenario = drawn.scenario
    if scenario.valve is None or scenario.valve.stem is None:
        d = scenario.d if scenario.valve is None else scenario.valve.d
        return d, d, d, 0.0
    return swept(scenario.valve, drawn.clearance + drawn.sticks)


@lru_cache(maxsize=64)
def swept(valve: Valve, about: float) -> tuple[float, float, float, float]:
    """Width, its least and greatest, and the slip jump, of a valve whose width is about `about`.

    OP goes back and forth by 2 to 3 widths, so slowly that the actuator's lag is a hundredth of the width. A width is
    how far OP goes after a turn before the plug has moved by `LEAST_MOVE` of it. The jump is how far the plug gets
    then, while OP moves by that, beyond what OP moved; a jump below a twentieth of the width is none.
    """
    random = Random(f"{valve}")
    least = LEAST_MOVE * about
    speed = 0.01 * about / (valve.lag / (1 + valve.positioner) + 0.2)
    h = least / 2 / speed
    corners = [50.0]
    for turn in range(SWEEPS + 2):
        corners.append(50.0 + (-1) ** turn * about * random.uniform(1.0, 1.5))
    legs = [np.arange(a, b, math.copysign(speed * h, b - a)) for a, b in pairwise(corners)]
    op = np.concatenate(legs)
    x = valve.positions(op, h)
    turns = np.cumsum([leg.size for leg in legs])[1:-1]
    ends = np.cumsum([leg.size for leg in legs])[2:]
    widths, jumps = [], []
    for turn, end in zip(turns, ends, strict=True):
        # The stem comes to rest within a few lags of the turn.
        rest = x[turn + 1]
        moved = np.flatnonzero(np.abs(x[turn + 1 : end] - rest) > least)
        if moved.size:
            at = turn + 1 + int(moved[0])
            widths.append(abs(op[at] - op[turn]) - least / 2)
            first = x[at - 2 : min(at + SOON, end)]
            jumps.append(float(np.abs(first[2:] - first[:-2]).max()) - least)
    if not widths:
        raise NoSuchLoopError(f"{valve}: did not move in a sweep of {about} %")
    jump = float(np.median(jumps))
    return float(np.mean(widths)), min(widths), max(widths), jump if jump > about / 20 else 0.0


def twins(row: str, number: int, seed: int = 1) -> list[Record]:
    """All records of a number, which differ in the fault of the valve alone."""
    return [record(name) for name in names(row, number, seed)]
