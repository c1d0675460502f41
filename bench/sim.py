"""The simulator beside other ways to the same loop, in one run: steps a second, with versions.

The loop is P2 + PI + second-order filter + backlash + uniform noise, h = 0.05 s, every signal kept.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from importlib.metadata import version
from io import StringIO

import control
import numba
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy import signal

from glapp import _glapp, modules
from glapp.simulate import Scenario, _checked, run_many

H, K, TI, D, AMPLITUDE = 0.05, 0.775, 2.05, 0.05, 0.005
TF = TI / 10
A, B, C, _, _ = signal.cont2discrete((*signal.tf2ss([1.0], [1.0, 4.0, 6.0, 4.0, 1.0]),), H)
LANES = 16


def best(work: Callable[[], object], steps: int) -> float:
    """Greatest rate [M steps/s] of all that fit into a second, of three at least."""
    times: list[float] = []
    while len(times) < 3 or sum(times) < 1.0:
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return steps / min(times) / 1e6


def scenario(steps: int, seed: int = 0) -> Scenario:
    """The loop."""
    return Scenario(
        plant="P2",
        controller=(K, TI, 0, 0),
        d=D,
        noise=AMPLITUDE,
        h=H,
        t_end=(steps - 1) * H,
        setpoint=[(1, 1.0)],
        load=[(100, -0.5)],
        seed=seed,
        filter_in_loop=True,
    )


def ours(steps: int, lanes: int, instructions: str | None) -> Callable[[], object]:
    """Loops in lanes, recorded into memory that is there already, as the next run of a batch finds it."""
    checked = [_checked(scenario(steps, seed)) for seed in range(lanes)]
    signals, flags = [np.empty((6, steps)) for _ in checked], [np.empty(steps, np.uint8) for _ in checked]
    return lambda: _glapp.run_together(checked, signals, flags, instructions)


def ours_watched(steps: int, lanes: int, instructions: str | None) -> Callable[[], object]:
    """Loops in lanes with their detectors, and no signal kept."""
    checked = [_checked(scenario(steps, seed), watch=True) for seed in range(lanes)]
    return lambda: _glapp.watch(checked, instructions)


def of_modules(steps: int) -> Callable[[], object]:
    """A loop of `glapp.modules` with its signals recorded: the loop of the others."""
    loop = modules.Graph(
        H,
        {
            "sp": modules.Input(),
            "load": modules.Input(),
            "pid": modules.Pid(k=K, ti=TI, b=0.0, tf=TF, start_pv=0.0),
            "gap": modules.Backlash(D, start=0.0),
            "plant": modules.Plant("P2"),
            "noise": modules.Noise(AMPLITUDE),
        },
        ["sp -> pid.sp", "load -> plant.load", "pid -> gap -> plant -> noise -> pid.pv"],
    )
    t = np.arange(steps) * H
    sp, load = np.where(t >= 1, 1.0, 0.0), np.where(t >= 100, -0.5, 0.0)
    return lambda: loop.run(steps * H, record=["noise", "pid", "gap"], sp=sp, load=load)


def by_hand(
    steps: int, a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    """The loop written out, for numba and for Python itself."""
    x0 = x1 = x2 = x3 = y1 = y2 = integral = position = 0.0
    share = H / (TF + H)
    seed = 1
    for k in range(steps):
        seed = 48271 * seed % 2147483647
        y = c[0] * x0 + c[1] * x1 + c[2] * x2 + c[3] * x3 + AMPLITUDE * ((seed / 2147483647 - 0.5) * 2)
        y1 += (y - y1) * share
        y2 += (y1 - y2) * share
        sp = 1.0 if k * H >= 1 else 0.0
        integral += K * H / TI * (sp - y2)
        u = integral - K * y2
        position = min(max(position, u - D / 2), u + D / 2)
        v = position + (-0.5 if k * H >= 100 else 0.0)
        x0, x1, x2, x3 = (
            a[0, 0] * x0 + a[0, 1] * x1 + a[0, 2] * x2 + a[0, 3] * x3 + b[0] * v,
            a[1, 0] * x0 + a[1, 1] * x1 + a[1, 2] * x2 + a[1, 3] * x3 + b[1] * v,
            a[2, 0] * x0 + a[2, 1] * x1 + a[2, 2] * x2 + a[2, 3] * x3 + b[2] * v,
            a[3, 0] * x0 + a[3, 1] * x1 + a[3, 2] * x2 + a[3, 3] * x3 + b[3] * v,
        )
        out[0, k], out[1, k], out[2, k], out[3, k] = k * H, y, u, position


def python_control(steps: int) -> Callable[[], object]:
    """One discrete non-linear system, by `input_output_response`."""

    def update(t: float, x: NDArray[np.float64], u: NDArray[np.float64], params: object) -> NDArray[np.float64]:
        y = float(C[0] @ x[:4]) + u[2]
        y1 = x[4] + (y - x[4]) * H / (TF + H)
        y2 = x[5] + (y1 - x[5]) * H / (TF + H)
        integral = x[6] + K * H / TI * (u[0] - y2)
        op = integral - K * y2
        position = min(max(x[7], op - D / 2), op + D / 2)
        return np.array([*(A @ x[:4] + B[:, 0] * (position + u[1])), y1, y2, integral, position])

    system = control.nlsys(update, lambda t, x, u, params: x, inputs=3, outputs=8, states=8, dt=H)
    t = np.arange(steps) * H
    noise = np.random.default_rng(1).uniform(-AMPLITUDE, AMPLITUDE, steps)
    inputs = np.array([np.where(t >= 1, 1.0, 0.0), np.where(t >= 100, -0.5, 0.0), noise])
    return lambda: control.input_output_response(system, t, inputs)


def path_sim(steps: int) -> Callable[[], object]:
    """Blocks and connections in continuous time, Euler steps of h, without the filter and with its own backlash."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import PID, Adder, Backlash, Scope, Source, StateSpace
    from pathsim.solvers import EUF

    a, b, c, d = signal.tf2ss([1.0], [1.0, 4.0, 6.0, 4.0, 1.0])
    random = np.random.default_rng(1)

    def run() -> None:
        sp, load = Source(lambda t: 1.0 if t >= 1 else 0.0), Source(lambda t: -0.5 if t >= 100 else 0.0)
        noise = Source(lambda t: random.uniform(-AMPLITUDE, AMPLITUDE))
        error, pid, gap, total = Adder("+-"), PID(Kp=K, Ki=K / TI, Kd=0), Backlash(D), Adder()
        plant, measured, scope = StateSpace(a, b, c, d), Adder(), Scope()
        simulation = Simulation(
            [sp, load, noise, error, pid, gap, total, plant, measured, scope],
            [
                Connection(sp, error),
                Connection(measured, error[1], scope),
                Connection(error, pid),
                Connection(pid, gap, scope[1]),
                Connection(gap, total, scope[2]),
                Connection(load, total[1]),
                Connection(total, plant),
                Connection(plant, measured),
                Connection(noise, measured[1]),
            ],
            dt=H,
            Solver=EUF,
            log=False,
        )
        simulation.run(steps * H)

    return run


def bd_sim(steps: int) -> Callable[[], object]:
    """Blocks and wires in continuous time, steps of at most h of a Runge-Kutta solver, without the filter."""
    import bdsim

    simulator = bdsim.BDSim(animation=False, graphics=False, progress=False, toolboxes=False)
    diagram = simulator.blockdiagram()
    random = np.random.default_rng(1)
    position = [0.0]

    def gap(u: float) -> float:
        position[0] = min(max(position[0], u - D / 2), u + D / 2)
        return position[0]

    sp, load = diagram.STEP(T=1.0, name="sp"), diagram.STEP(T=100.0, on=-0.5, name="load")
    clock = diagram.TIME()
    noise = diagram.FUNCTION(lambda t: random.uniform(-AMPLITUDE, AMPLITUDE), nin=1, nout=1, name="noise")
    error, proportional, integral = diagram.SUM("+-"), diagram.GAIN(K), diagram.INTEGRATOR(x0=0.0, gain=K / TI)
    op, valve, total = diagram.SUM("++"), diagram.FUNCTION(gap, nin=1, nout=1, name="gap"), diagram.SUM("++")
    plant, pv = diagram.LTI_SISO([1.0], [1.0, 4.0, 6.0, 4.0, 1.0]), diagram.SUM("++")
    for start, end in (
        (clock, noise),
        (sp, error[0]),
        (pv, error[1]),
        (error, proportional),
        (error, integral),
        (proportional, op[0]),
        (integral, op[1]),
        (op, valve),
        (valve, total[0]),
        (load, total[1]),
        (total, plant),
        (plant, pv[0]),
        (noise, pv[1]),
    ):
        diagram.connect(start, end)

    def run() -> None:
        with redirect_stdout(StringIO()):  # it reports every run
            simulator.run(diagram, T=steps * H, dt=H, watch=[pv], solver="RK23", max_step=H, block=False)

    with redirect_stdout(StringIO()):
        diagram.compile()
    return run


def rows() -> list[tuple[str, float]]:
    """Measurements: name and M steps/s."""
    single = best(ours(100_000, 1, None), 100_000)
    table = [("one loop, recorded", single)]
    rate = best(of_modules(100_000), 100_000)
    table.append((f"the same of modules, recorded: ×{rate / single:.2f}", rate))
    for instructions in _glapp.instruction_sets():
        # A batch as long as a core's own memory holds, and one that must go out to the machine's.
        for steps, where in ((10_000, "within the cache"), (100_000, "to memory")):
            rate = best(ours(steps, LANES, instructions), LANES * steps)
            table.append((f"{LANES} loops in lanes, {instructions}, recorded {where}: ×{rate / single:.1f}", rate))
    table.append(("one loop, estimate kept", best(ours_watched(100_000, 1, None), 100_000)))
    for instructions in _glapp.instruction_sets():
        rate = best(ours_watched(100_000, LANES, instructions), LANES * 100_000)
        table.append((f"{LANES} loops in lanes, {instructions}, estimate kept", rate))
    many = [scenario(200_001, seed) for seed in range(1000)]
    rate = best(lambda: run_many(many, keep="estimate", progress=False), 1000 * 200_001)
    table.append((f"1000 scenarios of 10 000 s, estimate kept, all cores: {200.001 / rate:.2f} s", rate))
    out = np.empty((4, 1_000_000))
    compiled = numba.njit(by_hand)
    arguments = (A, B[:, 0].copy(), C[0].copy(), out)
    compiled(10, *arguments)
    table.append((f"numba {version('numba')}, written out", best(lambda: compiled(1_000_000, *arguments), 1_000_000)))
    plain = [part.tolist() if part.ndim == 1 else part for part in arguments]
    table.append((f"Python {platform.python_version()}, written out", best(lambda: by_hand(20_000, *plain), 20_000)))
    table.append((f"python-control {version('control')}", best(python_control(2_000), 2_000)))
    table.append((f"PathSim {version('pathsim')}, Euler, no filter", best(path_sim(1_000), 1_000)))
    table.append((f"bdsim {version('bdsim')}, RK23, no filter", best(bd_sim(400), 400)))
    return table


if __name__ == "__main__":
    shown = Table("P2 + PI + filter + backlash + noise", "M steps/s")
    for name, rate in rows():
        shown.add_row(name, f"{rate:.3g}")
    Console(width=110).print(shown)
