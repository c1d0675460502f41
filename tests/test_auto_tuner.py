"""The autotuner on processes whose truth is known, and as a module in a loop."""

from typing import Any

import numpy as np
import pytest

from glapp import InputError
from glapp.modules import (
    AutoTuner,
    Backlash,
    Flag,
    Graph,
    Input,
    Noise,
    Output,
    PidAdvanced,
    Saturation,
)
from glapp.modules import Plant as PlantModule
from glapp.plant import PLANTS, Plant
from glapp.tuning import RelayExperiment, relay_experiment, ultimate

# None of the processes on which the slopes of the correction were chosen.
OTHERS = {
    "six lags": Plant([1], [1, 6, 15, 20, 15, 6, 1]),
    "lag and dead time": Plant([1], [1, 1], 1.0),
    "two lags and dead time": Plant([1], [1, 2, 1], 0.5),
    "negative gain": Plant([-3], [1, 3, 3, 1]),
    "slow zero": Plant([-1, 1], [1, 3, 3, 1]),
    "integrator and two lags": Plant([1], [1, 2, 1, 0]),
}


def cycle(plant: Plant) -> float:
    """Amplitude of the cycle under a relay of 2/3, by the describing function."""
    return 4 * (2 / 3) / np.pi / abs(ultimate(plant).ku)


def check(e: RelayExperiment, ku: float, tu: float, kp: float) -> None:
    """Errors as shares of the truth."""
    truth = ultimate(e.plant)
    assert e.stop is None and e.ku is not None and e.tu is not None
    assert e.ku == pytest.approx(truth.ku, rel=ku)
    assert e.tu == pytest.approx(truth.tu, rel=tu)
    if e.plant.gain is None:
        assert e.kp_process is None and e.kappa == 0
    else:
        assert e.kp_process == pytest.approx(e.plant.gain, rel=kp)
        assert e.kappa == pytest.approx(1 / (e.kp_process * e.ku))


@pytest.mark.parametrize("name", PLANTS)
def test_without_noise(name: str) -> None:
    check(relay_experiment(name), ku=0.04, tu=0.015, kp=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("load", [0.0, 0.3, -0.3])
def test_with_noise_and_load(name: str, load: float) -> None:
    """Noise of a tenth of the cycle, from peak to peak; the load comes with the first cycles and stays."""
    plant = PLANTS[name]
    steps = [(1.3 * ultimate(plant).tu, load)]
    for seed in (1, 2, 3):
        check(relay_experiment(plant, noise=0.05 * cycle(plant), load=steps, seed=seed), ku=0.06, tu=0.05, kp=0.08)


@pytest.mark.parametrize("name", OTHERS)
def test_other_processes(name: str) -> None:
    plant = OTHERS[name]
    check(relay_experiment(plant, noise=0.05 * cycle(plant)), ku=0.08, tu=0.04, kp=0.08)


def test_before_the_gain_is_known_the_point_is_as_read_off() -> None:
    """Purpose of the correction: with this noise the cycle of P5 stands 8° before −180°."""
    plant = PLANTS["P5"]
    whole = relay_experiment(plant, noise=0.1 * cycle(plant))
    begun = whole.t[whole.phase == 3][0]
    cut = relay_experiment(plant, noise=0.1 * cycle(plant), longest=begun + 1.0)
    assert (cut.stop, cut.kp_process, cut.kappa) == ("time_budget", None, None)
    assert cut.ku is not None and whole.ku is not None
    assert cut.ku < 0.9 * ultimate(plant).ku < whole.ku
    with pytest.raises(InputError, match="kappa"):
        cut.tuned("amigo")


def test_a_load_makes_up_and_down_last_alike_again() -> None:
    """0.3 of load on an integrator: without the bias OP would be up for a quarter of the time."""
    plant = PLANTS["P1"]
    e = relay_experiment(plant, load=[(1.5 * ultimate(plant).tu, 0.3)])
    op = e.op[e.phase == 2]
    rises = np.flatnonzero(np.diff(op) > 0) + 1
    op = op[rises[-4] : rises[-1]]
    assert np.mean(op > op.mean()) == pytest.approx(0.5, abs=0.1)
    assert op.mean() == pytest.approx(-0.3, abs=0.05)


@pytest.mark.parametrize(
    ("given", "stop"),
    [
        ({"longest": 30.0}, "time_budget"),
        ({"pv_limits": (-0.1, 0.1)}, "pv_bounds"),
        ({"op_limits": (-0.9, 2.0)}, "op_limit"),
        ({"load": [(8.0, 0.9)]}, "dead_loop"),
        ({"relay_hysteresis": 0.4}, "off_point"),
        ({"relay_hysteresis": 2.0}, "dead_loop"),
        ({"h": 1.5}, "not_regular"),
        ({"noise": 1.0, "relay_hysteresis": 0.01}, "not_regular"),
    ],
)
def test_it_ends_with_its_reason(given: dict[str, Any], stop: str) -> None:
    e = relay_experiment("P2", **given)
    assert (e.stop, e.op[-1], e.ku) == (stop, 0, None)
    with pytest.raises(InputError, match=stop):
        e.tuned()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"amplitude": -1.0}, "amplitude: is -1, must be greater than 0"),
        ({"relay_hysteresis": -1.0}, "relay_hysteresis = -1: must be 0 or greater"),
        ({"wait": 5.0, "longest": 4.0}, "longest = 4: must be greater than wait"),
        ({"known_d": 1.4}, "d = 1.4: must be 0 or greater, and less than 4/3"),
        ({"h": 0.0}, "h: is 0, must be greater than 0 s"),
        ({"pv_limits": (1.0, -1.0)}, "pv_limits: goes from 1 to -1, must be low < high"),
    ],
)
def test_refuses_what_it_cannot_do(given: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words.replace("(", r"\(")):
        relay_experiment("P2", **given)


def test_a_process_that_no_relay_brings_to_180_degrees() -> None:
    with pytest.raises(InputError, match="no ultimate gain"):
        relay_experiment(Plant([1], [1, 2, 1]))


def test_load_as_steps_and_as_samples_is_the_same() -> None:
    steps = relay_experiment("P4", load=[(8.0, 0.3), (30.0, 0.1)], h=0.1)
    t = np.arange(20000) * 0.1
    samples = relay_experiment("P4", load=np.where(t >= 29.95, 0.1, np.where(t >= 7.95, 0.3, 0.0)), h=0.1)
    assert np.array_equal(steps.pv, samples.pv)


def test_controllers_from_what_was_found() -> None:
    """The rules, on what an experiment with noise found, keep the robustness they have on the truth."""
    for name in ("P2", "P3", "P5", "P6", "P7"):
        plant = PLANTS[name]
        e = relay_experiment(plant, noise=0.05 * cycle(plant))
        pid = e.tuned()
        assert pid.controller.ti == pytest.approx(6.25 * pid.controller.td)
        assert pid.ms < 1.8
        assert e.tuned("amigo", "PID").ms < 1.65
        assert e.tuned("ziegler_nichols", "PID").controller.ti == pytest.approx(e.tu / 2)
    e = relay_experiment("P8")
    with pytest.raises(InputError, match=r"less than 0\.8"):
        e.tuned()
    with pytest.raises(InputError, match="point_placement"):
        e.tuned("zn")  # type: ignore[arg-type]


def loop(**more: Any) -> Graph:
    """P2-like process around 50 % under PI, a valve of 0..100 %, and the autotuner between."""
    given: dict[str, Any] = {"amplitude": 6.0, "wait": 7.0, "longest": 400.0}
    given |= {"pv_low": 30.0, "pv_high": 70.0, "op_low": 0.0, "op_high": 100.0}
    return Graph(
        0.1,
        {
            "sp": Input(50.0),
            "pid": PidAdvanced(k=0.4, ti=3.0, low=0, high=100, kp=1.0, start=50.0),
            "tuner": AutoTuner(**given | more),
            "valve": Saturation(0, 100),
            "gap": Backlash(0.0),
            "process": PlantModule(PLANTS["P2"], start=50.0),
            "noise": Noise(0.05),
        },
        ["sp -> pid.sp", "pid -> tuner.in", "tuner -> valve -> gap -> process -> noise -> pid.pv", "noise -> tuner.pv"],
    )


def test_in_a_loop_it_takes_over_and_hands_back_without_a_bump() -> None:
    graph = loop()
    graph.run(50.0)
    assert graph["tuner"] == graph["pid"]
    graph["tuner.run"] = 1
    seen = graph.run(200.0, record=["pid", "tuner", "pid.flags", "tuner.phase", "noise", "pid.detections"])
    before = seen["tuner"][0]
    running = (seen["tuner.phase"] >= 1) & (seen["tuner.phase"] <= 3)
    assert graph["tuner.phase"] == 4 and graph["tuner.run"] == 0
    assert np.abs(seen["tuner"][running] - before).max() <= 6.0 * (1 + 1e-12)
    # The controller tracks, a scan behind; its detector takes nothing of it for a gap.
    assert np.all(seen["pid.flags"][running].astype(int) & Flag.NOT_AUTO)
    assert np.array_equal(seen["pid"][1:][running[1:]], seen["tuner"][:-1][running[1:]])
    assert np.ptp(seen["pid.detections"][running]) == 0
    end = int(np.flatnonzero(running)[-1]) + 1
    assert seen["tuner"][end] == before
    error = abs(50.0 - seen["noise"][end + 1])
    assert abs(seen["tuner"][end + 1] - before) <= 0.4 * 0.1 / 3.0 * error + 1e-9
    assert graph["tuner.ku"] == pytest.approx(4.0, rel=0.05)
    assert graph["tuner.kp"] == pytest.approx(1.0, rel=0.06)
    graph["pid.kp"] = graph["tuner.kp"]
    graph["pid.k"], graph["pid.ti"] = 0.16 * graph["tuner.ku"], graph["tuner.tu"] / (1 + 4.5 * graph["tuner.kappa"])
    after = graph.run(150.0, record=["noise"])["noise"]
    assert np.abs(after[-300:] - 50.0).max() < 0.2


def test_without_a_good_output_of_the_controller_it_does_not_begin() -> None:
    graph = Graph(
        0.1,
        {"op": Input(float("nan")), "pv": Input(), "tuner": AutoTuner(1, 1, 9, -1, 1, -2, 2), "valve": Output()},
        ["op -> tuner.in", "pv -> tuner.pv", "tuner -> valve"],
    )
    graph["tuner.run"] = 1
    graph.scan()
    assert (graph["tuner.phase"], graph["tuner.stop"]) == (5, 1)
    assert np.isnan(graph["valve"])
    with pytest.raises(InputError, match="0 \\(end it\\) or 1 \\(begin\\)"):
        graph["tuner.run"] = 2
