"""Plants: their forms, their frequency and step response by other methods, their bounds."""

import math
from typing import Any

import control
import numpy as np
import pytest
import scipy.signal
from hypothesis import given
from hypothesis import strategies as st

from glapp import InputError, simulate
from glapp.plant import PLANTS, Plant
from glapp.tuning import character


def test_made_from_anything_that_means_a_process() -> None:
    tank = Plant([1], [0.8, 1, 0], 0.2)
    assert Plant.of("P1") == Plant.of(tank) == Plant.of(([1], [0.8, 1, 0], 0.2)) == PLANTS["P1"] == tank
    assert Plant.of(([2], [1, 1])) == Plant([2], [1, 1])
    assert Plant.of(control.tf([1], [0.8, 1, 0])).delayed(0.2) == tank
    assert Plant.of(scipy.signal.lti([3], [1, 2])) == Plant([3], [1, 2])
    assert Plant([0, 0, 1], [0, 1, 2]) == Plant([1], [1, 2])
    assert hash(tank) == hash(PLANTS["P1"])


@pytest.mark.parametrize(
    ("process", "message"),
    [
        ("P9", "plant: is 'P9'"),
        (3.0, "plant: is 3.0"),
        (([1], [1, 1], 1, 2), "plant: is"),
        (control.tf([1], [1, 0.5], 0.1), "plant: is sampled"),
        (control.tf([[[1], [1]]], [[[1, 1], [1, 2]]]), "plant: must have one input"),
        (([1, 0, 0], [1, 1]), "num: is of degree 2"),
        (([1], [1, 1], -1), "dead_time: is -1"),
        (([1], [1, 1], math.nan), "dead_time: is nan"),
        (([1], [0, 0]), "den: is"),
        (([1], ["a"]), "den: is"),
        (([math.inf], [1, 1]), "num: is"),
    ],
)
def test_wrong_processes_are_refused_in_one_line(process: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Plant.of(process)


def test_the_simulator_takes_its_three_parts() -> None:
    ours = simulate.closed_loop(
        tuple(PLANTS["P2"]), (0.4, 2.4, 0, 0), t_end=20, setpoint=[(0, 1.0)], filter_in_loop=True
    )
    named = simulate.closed_loop("P2", (0.4, 2.4, 0, 0), t_end=20, setpoint=[(0, 1.0)], filter_in_loop=True)
    np.testing.assert_array_equal(ours.pv, named.pv)


@pytest.mark.parametrize("name", PLANTS)
def test_frequency_response_agrees_with_python_control(name: str) -> None:
    plant = PLANTS[name]
    w = np.geomspace(1e-3, 1e3, 200)
    other = control.tf(plant.num, plant.den)(1j * w) * np.exp(-1j * w * plant.dead_time)
    np.testing.assert_allclose(plant.response(w), other, rtol=1e-9)


@pytest.mark.parametrize("name", PLANTS)
def test_step_response_agrees_with_residues(name: str) -> None:
    """Partial fractions of P/s, a road without any matrix; scipy's finds multiple poles to some digits only."""
    plant = PLANTS[name]
    t = np.array([0.0, 0.1, 0.5, 1.0, 3.7, 9.0, 25.0, 12.0])
    residues, poles, _ = scipy.signal.residue(plant.num, np.polymul(plant.den, [1, 0]), tol=0.05)
    late = np.maximum(t - plant.dead_time, 0)
    other, order = np.zeros(t.size), 1
    for i, (r, p) in enumerate(zip(residues, poles, strict=True)):
        order = order + 1 if i and abs(p - poles[i - 1]) < 1e-6 else 1
        other += (r * late ** (order - 1) / math.factorial(order - 1) * np.exp(p * late)).real
    np.testing.assert_allclose(plant.step_response(t), np.where(t >= plant.dead_time, other, 0), atol=2e-4)


def test_series_is_the_product_of_responses() -> None:
    one, two, w = PLANTS["P4"], PLANTS["P1"], np.geomspace(0.01, 10, 30)
    np.testing.assert_allclose((one * two).response(w), one.response(w) * two.response(w))
    np.testing.assert_allclose((3 * one).response(w), 3 * one.response(w))
    assert (one * two).dead_time == 4.2


def test_gain_integrators_poles_stability() -> None:
    assert [p.gain for p in PLANTS.values()] == [None, 1, 1, 1, 1, 1, 1, 1]
    assert Plant([3], [2, 0]).velocity_gain == 1.5 and Plant([3], [2, 0]).gain is None
    assert Plant([1, 0], [1, 2, 0]).integrators == 0 and Plant([1, 0], [1, 2, 0]).gain == 0.5
    assert Plant([1, 0], [1, 2, 1]).gain == 0
    assert all(plant.is_stable for plant in PLANTS.values())
    assert (
        not Plant([1], [1, -1]).is_stable
        and not Plant([1], [1, 0, 0]).is_stable
        and not Plant([1], [1, 0, 1]).is_stable
    )
    np.testing.assert_allclose(sorted(PLANTS["P3"].poles.imag), [-math.sqrt(8), 0, math.sqrt(8)], atol=1e-12)


def test_character_needs_an_fotd_model() -> None:
    assert character(Plant([2], [10, 1], 1)) == "lag-dominated"
    assert character(Plant([-2], [1, 1], 1)) == "balanced"
    assert character(Plant([2], [1, 1], 1.01)) == "delay-dominated"
    assert character(Plant([1], [1, 0]) * Plant([1], [1, 1])) == "integrating"
    with pytest.raises(InputError, match="unstable"):
        character(Plant([1], [1, -1]))


@given(
    lags=st.lists(st.floats(0.01, 100), min_size=1, max_size=5),
    gain=st.floats(0.1, 10),
    dead_time=st.floats(0, 50),
    scale=st.floats(0.01, 100),
)
@pytest.mark.slow
def test_time_scales(lags: list[float], gain: float, dead_time: float, scale: float) -> None:
    def plant(by: float) -> Plant:
        den = np.array([1.0])
        for lag in lags:
            den = np.polymul(den, [lag * by, 1])
        return Plant([gain], den.tolist(), dead_time * by)

    w = np.geomspace(1e-3, 1e2, 20)
    np.testing.assert_allclose(plant(1).response(w), plant(scale).response(w / scale), rtol=1e-6, atol=1e-12)
    t = np.linspace(0, 3 * (dead_time + sum(lags)), 9)
    np.testing.assert_allclose(plant(1).step_response(t), plant(scale).step_response(t * scale), rtol=1e-6, atol=1e-9)


def test_grid_finds_resonances_and_dead_time() -> None:
    sharp = Plant([1], [1, 2e-4, 1])
    assert np.abs(sharp.response(sharp.frequencies())).max() > 0.99 / 2e-4
    w = PLANTS["P8"].frequencies()
    assert np.diff(np.unwrap(np.angle(PLANTS["P8"].response(w[w < 20])))).min() > -0.5


@pytest.mark.parametrize("name", ["P1", "P2", "P3", "P5", "P7"])
def test_any_linear_system_is_a_process(name: str) -> None:
    """python-control's and SciPy's forms of a process of the batch give back its coefficients."""
    want = PLANTS[name]
    tf = scipy.signal.TransferFunction(want.num, want.den)
    ours = control.tf(list(want.num), list(want.den))
    systems = [tf, tf.to_ss(), tf.to_zpk(), ours, control.ss(ours), control.zpk(ours.zeros(), ours.poles(), 1.0)]
    for system in systems[:5]:
        found = Plant.of(system)
        scale = found.den[0] / want.den[0]
        assert len(found.num) == len(want.num) and len(found.den) == len(want.den), type(system)
        np.testing.assert_allclose(found.num, np.multiply(want.num, scale), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.den, np.multiply(want.den, scale), rtol=1e-9, atol=1e-12)
    assert Plant.of(systems[5]).order == want.order
    assert simulate.closed_loop(control.ss(ours), (0.2, 5), t_end=5).pv.shape == (101,)


def test_systems_that_are_no_process_are_refused() -> None:
    two = scipy.signal.StateSpace([[-1.0]], [[1.0, 1.0]], [[1.0]], [[0.0, 0.0]])
    sampled = control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1)
    for system, line in ((two, "must have one input and one output"), (sampled, "is sampled, must be continuous")):
        with pytest.raises(InputError, match=line):
            Plant.of(system)


def test_a_static_gain_in_state_space() -> None:
    assert Plant.of(control.ss([], [], [], [[3.0]])) == Plant([3], [1])
