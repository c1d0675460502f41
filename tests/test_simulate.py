"""The simulator against other roads to the same truth."""

from pathlib import Path

import numpy as np
import pyarrow.csv
import pytest
from filtered import filtered
from numpy.typing import NDArray
from scipy import signal

from glapp.controller import Controller
from glapp.errors import InputError
from glapp.plant import PLANTS, Plant
from glapp.recording import AT_HIGH, AT_LOW, NOT_AUTO
from glapp.simulate import Simulation, closed_loop, random_walk

AMIGO_PI = (0.414, 2.66)
P3_PI = (0.48, 0.3117)
STEP_AND_LOAD = {"setpoint": [(1.0, 1.0)], "load": [(100.0, -0.5)]}


def columns(s: Simulation) -> list[NDArray[np.float64] | NDArray[np.uint8]]:
    return [s.t, s.sp, s.pv, s.op, s.position, s.load, s.flags]


@pytest.mark.parametrize("name", PLANTS)
def test_plant_against_lsim(name: str) -> None:
    """The step response in manual, at a step that no dead time of the batch divides, from lsim at one that all do."""
    num, den, dead_time = PLANTS[name]
    s = filtered(name, (1.0, 1.0, 0, 0), d=0, noise=0, h=0.03, t_end=30, manual=[(0, 99, 1.0)])
    exact = signal.lsim(signal.TransferFunction(num, den), np.ones(3001), np.linspace(0, 30, 3001))[1]
    at = 3 * np.arange(s.t.size) - round(100 * dead_time)
    assert np.abs(np.where(at >= 0, exact[np.maximum(at, 0)], 0.0) - s.pv).max() < 1e-9


def test_p3_cycles_through_the_gap_in_noise() -> None:
    """Thesis 5.2: half-periods much longer than 5 Ti, the output's travel just above d, the mean width near d."""
    s = filtered("P3", (*P3_PI, 0, 0), d=0.05, noise=0.005, t_end=3000, **STEP_AND_LOAD, seed=4)
    late = s.t > 500
    assert 0.05 < np.ptp(s.op[late]) < 0.07
    assert np.ptp(s.position[late]) < 0.015
    assert np.abs(s.pv[late] - 1.0).max() < 0.03


def test_without_integrator_and_noise_no_cycle_lasts() -> None:
    """P2 under PI: each passage through the gap takes half as long again as the one before, and the error fades."""
    s = filtered("P2", (0.775, 2.05, 0, 0), d=0.05, noise=0, t_end=3000, **STEP_AND_LOAD)
    e = s.sp - s.pv
    passages = np.diff(s.t[np.flatnonzero(np.diff(np.sign(e)))])[-5:]
    assert np.all(passages[1:] > 1.5 * passages[:-1])
    assert np.abs(e[s.t > 2000]).max() < 0.002 * 0.05


def test_integrating_process_cycles_without_noise_and_in_proportion_to_the_gap() -> None:
    """P1: the describing function of backlash scales with d, so the cycle does too, at the same frequency."""

    def cycle(d: float) -> tuple[float, float]:
        s = filtered("P1", (0.363, 7.06, 0, 0), d=d, noise=0, t_end=3000, load=[(10.0, -0.5)])
        e = s.pv[s.t > 1500]
        return float(np.ptp(e)), float(np.mean(np.diff(np.flatnonzero(np.diff(np.sign(e)) > 0))))

    (small, period), (large, same_period) = cycle(0.01), cycle(0.05)
    assert large / small == pytest.approx(5, rel=0.01)
    assert same_period == pytest.approx(period, rel=0.01)


def test_a_shorter_run_is_the_beginning_of_a_longer_one() -> None:
    short = filtered("P1", (0.363, 7.06, 0, 0), t_end=50, **STEP_AND_LOAD)
    long = filtered("P1", (0.363, 7.06, 0, 0), t_end=200, **STEP_AND_LOAD)
    assert all(np.array_equal(x, y[: len(x)]) for x, y in zip(columns(short), columns(long), strict=True))


def test_limits_hold_and_are_flagged() -> None:
    s = filtered(
        "P2", (*AMIGO_PI, 0, 0), t_end=300, limits=(0.1, 0.6), setpoint=[(0, 0.3), (50, 1.0), (150, 0.3), (220, 0)]
    )
    assert s.op.min() == 0.1 and s.op.max() == 0.6
    assert np.array_equal((s.flags & AT_LOW) != 0, s.op == 0.1)
    assert np.array_equal((s.flags & AT_HIGH) != 0, s.op == 0.6)
    # Anti-windup: back from 100 s at the limit soon after the setpoint returns (tens of times slower without).
    assert s.t[(s.t > 150) & (s.op < 0.6)][0] < 156


def test_manual_and_auto_without_a_bump() -> None:
    s = filtered(
        "P2", (0.5, 3.0, 0, 0), noise=0, t_end=200, setpoint=[(0, 1.0), (20, 1.2)], manual=[(30, 60), (100, 120, 0.9)]
    )
    held = (s.t >= 30) & (s.t < 60)
    assert np.ptp(s.op[held]) == 0.0
    assert np.all(s.op[(s.t >= 100) & (s.t < 120)] == 0.9)
    assert np.array_equal((s.flags & NOT_AUTO) != 0, held | ((s.t >= 100) & (s.t < 120)))
    for back in (60.0, 120.0):
        k = int(np.flatnonzero(s.t >= back)[0])
        # One sample moves OP by its own integration and by what PV did in that sample, no more.
        bound = 0.5 * 0.05 / 3.0 * abs(s.sp[k] - s.pv[k]) + 0.5 * abs(s.pv[k] - s.pv[k - 1])
        assert abs(s.op[k] - s.op[k - 1]) <= bound + 1e-3


def test_begins_at_rest() -> None:
    s = filtered(
        ([0.8], [5.0, 1.0], 1.3), (2.0, 6.0, 0, 0), noise=0, h=0.5, t_end=60, setpoint=[(0, 120.0)], load=[(0, 3.0)]
    )
    assert s.pv == pytest.approx(np.full(121, 120.0), abs=1e-9)
    assert s.op == pytest.approx(np.full(121, 120.0 / 0.8 - 3.0), abs=1e-9)


def test_direct_acting_controller() -> None:
    s = filtered(([-2.0], [5.0, 1.0], 0.0), (-0.5, 6.0, 0, 0), d=0, noise=0, t_end=200, setpoint=[(5, 1.0)])
    assert s.pv[-1] == pytest.approx(1.0, abs=1e-6)
    assert s.op[-1] == pytest.approx(-0.5, abs=1e-6)


def test_a_dead_time_longer_than_the_run() -> None:
    s = filtered(([1.0], [1.0, 1.0], 1e9), (*AMIGO_PI, 0, 0), noise=0, t_end=10, setpoint=[(1, 1.0)])
    assert np.all(s.pv == 0.0)


def test_controller_as_its_maker_writes_it() -> None:
    controller = Controller(k=0.5, ti=0.05, ti_unit="min", setpoint_weight=0)
    as_written = filtered("P2", controller.ideal(), t_end=50, **STEP_AND_LOAD)
    assert np.array_equal(as_written.pv, filtered("P2", (0.5, 3.0, 0, 0), t_end=50, **STEP_AND_LOAD).pv)


@pytest.mark.parametrize("name", ["error_gap", "output_dead_band", "pv_filter"])
def test_what_a_controller_has_and_the_simulator_has_not_is_refused(name: str) -> None:
    """It was left out without a word."""
    with pytest.raises(InputError, match=rf"^controller\.{name}: is 0\.2, and is not simulated"):
        closed_loop("P2", {"k": 0.5, "ti": 2, name: 0.2}, t_end=10)


def test_random_walk_as_load() -> None:
    walk = random_walk(2001, h=0.05, rate=0.006, seed=1)
    s = filtered("P2", (*AMIGO_PI, 0, 0), t_end=100, load=walk)
    assert np.array_equal(s.load, walk)
    assert walk[0] == 0.0 and not np.array_equal(walk, random_walk(2001, h=0.05, rate=0.006, seed=2))


def test_csv_gives_the_same_numbers_back(tmp_path: Path) -> None:
    s = filtered("P2", (*AMIGO_PI, 0, 0), t_end=20, limits=(-1, 1), manual=[(5, 10)], setpoint=[(1, 1.0)])
    s.write_csv(tmp_path / "loop.csv")
    table = pyarrow.csv.read_csv(tmp_path / "loop.csv")
    assert table.column_names == s.to_arrow().column_names
    for name, column in (("t", s.t), ("SP", s.sp), ("PV", s.pv), ("OP", s.op), ("POSITION", s.position)):
        assert np.array_equal(table[name].to_numpy(), column)
    assert [mode == "MAN" for mode in table["MODE"].to_pylist()] == list((s.flags & NOT_AUTO) != 0)


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"h": 0}, "h: is 0, must be > 0"),
        ({"h": 5}, "h = 5 s is too coarse for the fastest pole: at most 3.0"),
        ({"t_end": -1}, "t_end: is -1, must be ≥ 0"),
        ({"t_end": 1e12}, "t_end = 1000000000000: must be 0 s or greater, and not above 10⁸ steps"),
        ({"d": -0.1}, "d: is -0.1, must be ≥ 0"),
        ({"noise": float("nan")}, "noise.amplitude: is nan, must be a finite number"),
        ({"tf": -1}, "tf: is -1, must be ≥ 0"),
        ({"seed": -1}, "seed: is -1, must be ≥ 0"),
        ({"limits": (1, 0)}, "low = 1: must be a number below the upper limit"),
        ({"limits": (0, 1), "load": [(0, 5.0)]}, "needs OP = -5: outside the limits"),
        ({"manual": [(5, 3)]}, "manual: stretch from 5 s to 3 s; write ascending times"),
        ({"setpoint": [(2, 1.0), (1, 0.0)]}, "setpoint: step at 1 s after one at 2 s"),
        ({"load": np.zeros(3)}, "load: 3 values for 20001 samples"),
        ({"load": [("soon", 1.0)]}, "load: is no signal; write [(time, value), …]"),
        ({"plant": "P9"}, "plant: is 'P9'; write P1, P2"),
        ({"plant": ([1.0],)}, "plant: is ([1.0],); write P1, P2"),
        ({"plant": ([1.0, 1.0], [1.0, 1.0], 0.0)}, "plant with num of degree 1 over den of degree 1"),
        ({"plant": ([1.0], [1.0, 1.0], -1.0)}, "plant.dead_time: is -1, must be 0 s or greater"),
        ({"plant": ([1.0, 0.0], [1.0, 1.0], 0.0)}, "plant with num of degree 1"),
        ({"controller": (0.0, 1.0)}, "controller.k: is 0, must be other than 0"),
        ({"controller": (1.0, 0.0)}, "controller.ti: is 0.0, must be > 0"),
        ({"controller": (1.0,)}, "controller: write (k, ti)"),
        ({"controller": (1.0, 1.0, 0.0, 2.0)}, "controller.setpoint_weight: is 2.0, must be ≤ 1"),
    ],
)
def test_wrong_input_is_refused_in_one_line(wrong: dict, line: str) -> None:
    arguments = {"plant": "P2", "controller": AMIGO_PI} | wrong
    with pytest.raises(InputError) as refusal:
        closed_loop(**arguments)
    assert line in str(refusal.value) and "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("plant", "controller", "limits", "signal_name"),
    [
        ("P2", (6.0, 1.0), None, "OP"),
        (([1.0], [1.0, 1.0, -1.0], 0.0), (0.1, 10.0), (-1.0, 1.0), "PV"),  # a pole at +0.62, the output at its limit
    ],
)
def test_an_unstable_loop_is_told_with_the_time(
    plant: Plant | str, controller: tuple[float, float], limits: tuple[float, float] | None, signal_name: str
) -> None:
    with pytest.raises(InputError, match=rf"unstable closed loop: {signal_name} went beyond .* at t = \d+\.\d+ s"):
        filtered(plant, controller, t_end=2000, setpoint=[(1, 1.0)], limits=limits)
