"""Loops for the ladder of judgements: ordinary ones, limit cycles of a gap, and their twins without one."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import numpy as np
import numpy.typing as npt
import pyarrow as pa

import glapp
from glapp.controller import Controller
from glapp.plant import Plant
from glapp.scenario import Gaussian, Samples, Scenario, Steps
from glapp.simulate import Simulation, run

Floats = npt.NDArray[np.float64]


def simulated(
    kp: float,
    lags: list[float],
    dead_time: float,
    k: float,
    ti: float,
    d: float,
    load: Floats,
    seed: int,
    sigma: float = 0.03,
    h: float = 1.0,
) -> Simulation:
    """A PI loop at h [s] under a load at the process input [% of OP]; PV stands at 50."""
    denominator = np.array([1.0])
    for lag in lags:
        denominator = np.convolve(denominator, [lag, 1.0])
    scenario = Scenario(
        plant=Plant([kp], list(denominator), dead_time),
        controller=Controller(k=k, ti=ti, setpoint_weight=1.0, gain_unit="OP/PV"),
        pv_span=(0, 100),
        op_span=(0, 100),
        limits=(0.0, 100.0),
        d=d,
        noise=(Gaussian(sigma=sigma),),
        setpoint=(Steps(steps=((0.0, 50.0 * kp),)),),
        load=(Samples(values=load),),
        h=h,
        t_end=(load.size - 1) * h,
        seed=seed,
    )
    return run(scenario)


def recording(simulation: Simulation, name: str, every: int = 1) -> glapp.Recording:
    """Every so many of its rows."""
    columns = {"t": simulation.t, "SP": simulation.sp, "PV": simulation.pv, "OP": simulation.op}
    table = pa.table({name: column[::every] for name, column in columns.items()})
    return glapp.recording_from(table, glapp.Loop(name=name, pv_span=(0, 100), op_span=(0, 100)))


def drift(random: Random, size: float, samples: int, h: float = 1.0) -> Floats:
    """A load that wanders about `size` [%], is drawn back within ten minutes and smooth within one."""
    x = smooth = 0.0
    load = np.empty(samples)
    for k in range(samples):
        x += random.gauss(0.0, 1.0) * size * np.sqrt(2 * h / 600.0) - x * h / 600.0
        smooth += (x - smooth) * h / 60.0
        load[k] = smooth
    return load


ORDINARY = (0.3, 0.5, 0.8, 1.0, 1.2, 1.5, 2.0, 3.0, 4.0)
"""Gaps of the ordinary loops [%]."""


def ordinary(number: int, gap: bool = True) -> tuple[Simulation, float]:
    """Two hours of a loop at 1 s under a load that drifts, and its gap."""
    random = Random(f"ordinary/{number}")
    d = ORDINARY[number % len(ORDINARY)]
    kp, lag = random.uniform(0.5, 2.0), random.uniform(8.0, 40.0)
    dead = random.uniform(0.1, 0.3) * lag
    k, ti = lag / (kp * (lag + dead)), lag
    load = drift(random, d * random.uniform(2.0, 5.0), 7200)
    return simulated(kp, [lag], dead, k, ti, d if gap else 0.0, load, number, random.uniform(0.02, 0.1) * d * kp), d


SIGMA = 0.01
"""Noise of PV in the loops that swing [PV unit]."""


def cycling(number: int) -> dict[str, float]:
    """One of twelve loops with a lag, a short dead time and Ti < T, whose gap makes them swing: their numbers."""
    random = Random(f"cycle/{number}")
    d = 3.0 + 8.0 * (number % 12) / 11
    kp, lag = random.uniform(0.5, 1.8), random.uniform(40.0, 160.0)
    dead = random.uniform(0.02, 0.05) * lag
    return {"kp": kp, "lag": lag, "dead": dead, "k": lag / (kp * 2 * dead), "ti": min(lag, 8 * dead), "d": d}


def perstorp(number: int) -> dict[str, float]:
    """The loop of the thesis, 8.5.2: K 8.5, Ti 10.3 s, Kp 0.46, a gap of 25."""
    random = Random(f"perstorp/{number}")
    return {
        "kp": 0.46,
        "lag": random.uniform(30.0, 80.0),
        "dead": random.uniform(0.8, 3.0),
        "k": 8.5,
        "ti": 10.3,
        "d": 25.0,
    }


def limit_cycle(loop: dict[str, float], seed: int, samples: int = 2000) -> Simulation:
    """Such a loop left to itself, from a small step of the load on."""
    load = np.full(samples, 0.0)
    load[50:] = 0.5 * loop["d"]
    return simulated(loop["kp"], [loop["lag"]], loop["dead"], loop["k"], loop["ti"], loop["d"], load, seed, SIGMA)


FORMS: dict[str, Callable[[Floats], Floats]] = {
    "sine": lambda phase: np.sin(2 * np.pi * phase),
    "square": lambda phase: np.sign(np.sin(2 * np.pi * phase)),
    "saw": lambda phase: 2 * (phase % 1.0) - 1,
    "triangle": lambda phase: 4 * np.abs(phase % 1.0 - 0.5) - 1,
}


def driven(loop: dict[str, float], like: Simulation, form: str, seed: int) -> Simulation:
    """The loop without its gap, driven by a load so that OP swings with the period and as far as in `like`."""
    op = like.op[like.op.size // 3 :]
    signs = np.sign(op - np.median(op))
    ups = np.flatnonzero((signs[1:] > 0) & (signs[:-1] <= 0))
    ups = ups[np.concatenate([[True], np.diff(ups) > 5])]
    period = float(np.mean(np.diff(ups)))
    swing = float(np.ptp(op))
    wave = FORMS[form](np.arange(like.op.size) / period)

    def of(size: float, sigma: float) -> Simulation:
        args = (loop["kp"], [loop["lag"]], loop["dead"], loop["k"], loop["ti"], 0.0)
        return simulated(*args, size * wave, seed, sigma)

    quiet = of(1.0, 1e-6)
    return of(swing / float(np.ptp(quiet.op[quiet.op.size // 3 :])), SIGMA)


def dozing(number: int) -> tuple[Simulation, float]:
    """A loop under a load that hardly moves: OP drifts in the gap for hours and PV lies still beside its setpoint."""
    random = Random(f"dozing/{number}")
    d, kp, lag = 6.0, random.uniform(0.5, 1.5), random.uniform(10.0, 40.0)
    dead = 0.2 * lag
    load = np.zeros(7200)
    for at in range(random.randrange(200, 600), load.size, random.randrange(1500, 3000)):
        load[at:] += random.choice((-1.0, 1.0)) * random.uniform(0.05, 0.3)
    k, ti = 0.1 / kp, 3.0 * lag
    return simulated(kp, [lag], dead, k, ti, d, load, number, 0.02), d
