"""The phase lead as a module: frequency response, its effect on a limit cycle, graphs that it is refused in."""

import math
from typing import Any

import numpy as np
import pytest
from bench import phase_lead as bench

from glapp.errors import InputError
from glapp.modules import (
    AutoTuner,
    Backlash,
    BacklashDetection,
    Graph,
    Input,
    Module,
    Output,
    PhaseLead,
    Pid,
    PidAdvanced,
    ProcessSim,
    Sum,
)

LEAD = PhaseLead(lead=2.0, lag=0.5)
PROCESS = ProcessSim(gain=1.0, t1=3.0)
COMPENSATING = PidAdvanced(k=1.0, ti=5.0, comp_size=1.0)
WATCH = BacklashDetection(k=1.0, ti=5.0, comp_size=1.0)
RELAY = {"wait": 5.0, "longest": 100.0, "pv_low": -9.0, "pv_high": 9.0}
TUNER = AutoTuner(amplitude=1.0, op_low=0.0, op_high=100.0, **RELAY)


@pytest.mark.parametrize("w", [0.05, 0.5, 1.0, 3.0, 20.0])
def test_frequency_response(w: float) -> None:
    h = 0.002 / w
    graph = Graph(h, {"in": Input(), "lead": LEAD, "out": Output()}, ["in -> lead -> out"])
    t = np.arange(round(24 * math.pi / w / h)) * h
    y = graph.run(t.size * h, record=["out"], **{"in": np.sin(w * t)})["out"]
    last = t >= t[-1] - 6 * math.pi / w
    seen = 2 * np.mean(y[last] * np.exp(-1j * w * t[last])) * 1j
    expected = (1 + 1j * w * LEAD.lead) / (1 + 1j * w * LEAD.lag)
    assert abs(seen / expected - 1) < 4e-3


def test_what_comes_to_rest_is_not_moved() -> None:
    graph = Graph(0.1, {"in": Input(40.0), "lead": LEAD, "out": Output()}, ["in -> lead -> out"])
    graph.scan()
    graph.scan(**{"in": 41.0})
    assert graph["out"] == pytest.approx(40.0 + 2.1 / 0.6)
    graph.run(30.0)
    assert graph["out"] == pytest.approx(41.0, abs=1e-12)


REFUSED: dict[str, tuple[dict[str, Module], list[str], str]] = {
    "behind the controller": (
        {"pid": COMPENSATING, "process": PROCESS},
        ["pid -> lead -> process -> pid.pv"],
        "lead and pid .*of u_FF",
    ),
    "in front of its pv": (
        {"pid": COMPENSATING, "process": PROCESS},
        ["pid -> process -> lead -> pid.pv"],
        "lead and pid .*of u_FF",
    ),
    "u_FF from beside": (
        {"sp": Input(), "pid": Pid(k=1.0, ti=5.0), "watch": WATCH, "process": PROCESS},
        [
            "sp -> pid.sp",
            "sp -> watch.sp",
            "watch -> pid.ff",
            "pid -> lead -> process -> pid.pv",
            "process -> watch.pv",
        ],
        "lead and watch .*of u_FF",
    ),
    "beside a real plant": (
        {"pv": Input(), "pid": COMPENSATING, "valve": Output()},
        ["pv -> pid.pv", "pid -> lead -> valve"],
        "lead and pid .*of u_FF",
    ),
    "beside a real plant, at the sensor": (
        {"pv": Input(), "pid": COMPENSATING, "valve": Output()},
        ["pv -> lead -> pid.pv", "pid -> valve"],
        "lead and pid .*of u_FF",
    ),
    "between two processes": (
        {"pid": COMPENSATING, "first": PROCESS, "second": PROCESS},
        ["pid -> first -> lead -> second -> pid.pv"],
        "lead and pid .*of u_FF",
    ),
    "behind a relay": (
        {"pid": Pid(k=1.0, ti=5.0), "tuner": TUNER, "process": PROCESS},
        ["pid -> tuner -> lead -> process -> pid.pv", "process -> tuner.pv"],
        "lead and tuner .*autotuner's relay",
    ),
    "behind the relay inside": (
        {"pid": PidAdvanced(k=1.0, ti=5.0, low=0, high=9, tune_amplitude=1.0), "process": PROCESS},
        ["pid -> lead -> process -> pid.pv"],
        "lead and pid .*autotuner's relay",
    ),
}


@pytest.mark.parametrize("where", REFUSED)
def test_a_lead_in_a_loop_with_a_jump_is_refused(where: str) -> None:
    modules, wires, names = REFUSED[where]
    with pytest.raises(InputError, match=names):
        Graph(0.1, {**modules, "lead": LEAD}, wires)


ALLOWED: dict[str, tuple[dict[str, Module], list[str]]] = {
    "a detector that does not compensate": (
        {"pid": PidAdvanced(k=1.0, ti=5.0), "process": PROCESS},
        ["pid -> lead -> process -> pid.pv"],
    ),
    "another loop": (
        {"pid": COMPENSATING, "process": PROCESS, "other": Pid(k=1.0, ti=5.0), "tank": PROCESS},
        ["pid -> process -> pid.pv", "other -> lead -> tank -> other.pv"],
    ),
    "another loop, whose load it is": (
        {"pid": COMPENSATING, "process": PROCESS, "other": Pid(k=1.0, ti=5.0), "tank": PROCESS},
        ["pid -> process -> pid.pv", "other -> lead -> tank -> other.pv", "process -> tank.load"],
    ),
    "before the relay": (
        {"pid": Pid(k=1.0, ti=5.0), "tuner": TUNER, "process": PROCESS},
        ["pid -> lead -> tuner -> process -> pid.pv", "process -> tuner.pv"],
    ),
}


@pytest.mark.parametrize("where", ALLOWED)
def test_a_lead_in_a_loop_without_a_jump_runs(where: str) -> None:
    modules, wires = ALLOWED[where]
    Graph(0.1, {**modules, "lead": LEAD}, wires).run(1.0)


@pytest.mark.parametrize(("name", "value"), [("pid.comp_size", 1.0), ("pid.tune_amplitude", 1.0)])
def test_a_jump_cannot_be_switched_on_behind_a_lead(name: str, value: float) -> None:
    pid = PidAdvanced(k=1.0, ti=5.0, low=0, high=9, **{f"tune_{key}": x for key, x in RELAY.items()})
    modules: dict[str, Any] = {"pid": pid, "lead": LEAD, "process": PROCESS}
    graph = Graph(0.1, modules, ["pid -> lead -> process -> pid.pv"])
    with pytest.raises(InputError, match="lead and pid are in the same loop"):
        graph[name] = value
    assert graph[name] == 0.0
    without = Graph(0.1, {"pid": pid, "process": PROCESS}, ["pid -> process -> pid.pv"])
    without[name] = value
    assert without[name] == value


@pytest.mark.parametrize(("lead", "lag", "name"), [(1.0, 0.0, "lag"), (0.5, 1.0, "lead"), (float("nan"), 1.0, "lead")])
def test_times_out_of_bounds_are_refused(lead: float, lag: float, name: str) -> None:
    with pytest.raises(InputError, match=f"lead: {name} = "):
        Graph(0.1, {"in": Input(), "lead": PhaseLead(lead, lag), "out": Output()}, ["in -> lead -> out"])


def test_it_does_not_close_the_gap() -> None:
    """A load still keeps PV off SP while OP goes through the gap (2.2)."""
    pid = Pid(k=1.0, ti=5.0)

    def away(**lead: Module) -> float:
        way = "lead -> gap" if lead else "gap"
        graph = Graph(
            0.02,
            {
                "load": Input(),
                "pid": pid,
                **lead,
                "gap": Backlash(1.0),
                "process": PROCESS,
                "sum": Sum(),
                "zero": Input(),
            },
            [f"pid -> {way} -> process -> sum -> pid.pv", "zero -> sum.plus", "load -> process.load"],
        )
        load = np.where(np.arange(5000) < 2500, 0.5, -0.5)
        return float(np.abs(graph.run(100.0, load=load, record=["sum"])["sum"][2500:]).max())

    assert away(lead=LEAD) > 0.5 * away()


@pytest.mark.slow
def test_the_bench_tells_designed_refused_and_empty_apart() -> None:
    lines, came_to = bench.rows()
    assert came_to == {"designed": 3, "empty": 2, "refused": 3}
    for line in lines[2:]:
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        predicted, simulated, design, with_it = cells[2:6]
        assert (predicted == "none") == (simulated == "at rest")
        if design.startswith("(1 + "):
            assert with_it == "at rest" and float(cells[6]) > 1
        if predicted != "none":
            period, amplitude = (float(part.split()[0]) for part in predicted.split(", "))
            seen_period, seen_amplitude = (float(part.split()[0]) for part in simulated.split(", "))
            assert seen_period == pytest.approx(period, rel=0.05) and seen_amplitude == pytest.approx(
                amplitude, rel=0.2
            )
    assert sum("two integrators" in line for line in lines) == 1
