"""The corpus of ordinary loops: twins, halves, and the truth of a valve's width."""

from __future__ import annotations

import numpy as np
import pytest
from bench.ordinary import design
from bench.ordinary.design import FAULTS, ROWS, draw, fractional_lag, half, names, sensitivity
from bench.ordinary.records import record, reversals, swept

from glapp.plant import Plant
from glapp.scenario import Stem, Valve


@pytest.mark.parametrize("row", ROWS)
def test_twins_differ_in_the_valve_alone(row):
    drawn = [draw(name) for name in names(row, 2)]
    assert [one.fault for one in drawn] == list(FAULTS[row])
    first = drawn[0]
    assert first.clearance == first.sticks == 0.0
    for one in drawn[1:]:
        assert (one.clearance > 0, one.sticks > 0) == {
            "gap": (True, False),
            "friction": (False, True),
            "both": (True, True),
            "driven": (False, False),
        }[one.fault]
        own = {"name": first.scenario.name, "d": first.scenario.d, "valve": first.scenario.valve}
        same, other = first.scenario.for_rust(), one.scenario.model_copy(update=own).for_rust()
        for key, value in same.items():
            np.testing.assert_equal(other[key], value, err_msg=key)
        if first.scenario.valve is not None and one.scenario.valve is not None:
            healthy = one.scenario.valve.model_copy(update={"d": 0.0, "stem": None})
            assert healthy == first.scenario.valve
        unlike = {"name", "fault", "scenario", "clearance", "sticks", "changes"}
        assert {k: v for k, v in vars(one).items() if k not in unlike} == {
            k: v for k, v in vars(first).items() if k not in unlike
        }


def test_halves_do_not_overlap_and_lie_in_and_out_of_the_family_alike():
    numbers = range(40)
    halves = {which: {n for n in numbers if half(n) == which} for which in "AB"}
    assert not halves["A"] & halves["B"] and halves["A"] | halves["B"] == set(numbers)
    outside = {n for n in range(16) if draw(f"drift/none/{n}/1").outside}
    assert len(outside & halves["A"]) == len(outside & halves["B"]) == 4


def test_a_name_makes_the_same_record_again_and_another_seed_another():
    once, again, other = (record(f"square/gap/1/{seed}") for seed in (1, 1, 2))
    assert once.table.equals(again.table) and once.truth == again.truth
    assert not once.table.equals(other.table)


def test_the_gap_is_in_the_record():
    sound, worn = record("square/none/1/1"), record("square/gap/1/1")
    assert sound.truth.d == 0.0 < worn.truth.d
    lost = worn.table["OP"].to_numpy() - worn.position
    # OP is rounded as it is recorded; the valve follows it up and down by half of the width.
    assert np.ptp(lost) == pytest.approx(worn.truth.d, abs=0.2)


def test_the_sweep_shows_the_width_of_a_mere_clearance():
    for lag in (0.0, 0.7):
        d, low, high, jump = swept(Valve(d=2.0, lag=lag), 2.0)
        assert d == pytest.approx(2.0, rel=0.03)
        assert high - low < 0.05 and jump == 0.0


@pytest.mark.parametrize("model", ["karnopp", "lugre"])
def test_the_sweep_shows_the_width_and_the_jump_of_mere_friction(model):
    slides = Stem(model=model, fs=1.0, fc=1.0)
    d, _, _, jump = swept(Valve(stem=slides, lag=0.5), 2.0)
    assert d == pytest.approx(2.0, rel=0.06) and jump == 0.0
    slips = Stem(model=model, fs=1.5, fc=1.0, stribeck=0.1)
    d, _, _, jump = swept(Valve(stem=slips, lag=0.5), 2.0)
    # It stands until the force has gone from one side's friction to fs of the other.
    assert 2.0 < d < 3.1 and 0.2 < jump < 1.0
    d, _, _, _ = swept(Valve(stem=slides, lag=0.5, positioner=3.0, d=1.0), 1.5)
    assert d == pytest.approx(1.5, rel=0.06)


def test_a_driven_twin_swings_as_its_cycle_does():
    cycle, driven = record("perstorp/gap/1/1").truth, record("perstorp/driven/1/1").truth
    assert cycle.d == 25.0 and driven.d == 0.0
    assert driven.period == pytest.approx(cycle.period, rel=0.05)
    assert driven.swing == pytest.approx(cycle.swing, rel=0.06)


def test_loops_that_ring_do_and_others_do_not():
    assert draw("rings/none/0/1").ms > 3.0
    assert draw("steps/none/0/1").ms < 2.3
    # 1/(s + 1), K = 1, Ti = 1 s, 1 s late: L = exp(-s)/s, whose Ms is 1/min|1 + L| by hand.
    w = np.geomspace(0.01, 20, 100_000)
    by_hand = np.max(1 / np.abs(1 + np.exp(-1j * w) / (1j * w)))
    assert sensitivity(Plant([1.0], [1.0, 1.0]), 1.0, 1.0, 0.0, 0.0, 1.0) == pytest.approx(by_hand, rel=1e-3)
    assert sensitivity(Plant([1.0], [1.0, 1.0]), 2.0, 1.0, 0.0, 0.0, 1.0) == np.inf


def test_a_fractional_lag_answers_as_one():
    # The frequency response of 1/(1 + (10s)^0.7), within what five lags can do.
    w = np.geomspace(0.01, 1.0, 30)
    exact = 1 / (1 + (10j * w) ** 0.7)
    np.testing.assert_allclose(fractional_lag(10.0, 0.7, 0.1).response(w), exact, atol=0.06)


def test_turns_are_counted_by_how_far_they_go():
    x = np.array([0.0, 1.0, 0.9, 2.0, 0.0, 0.1, 0.0, 2.0, 1.0])
    assert reversals(x, 0.5) == (1, 2)
    assert reversals(x, 0.05) == (3, 4)
    assert reversals(np.zeros(5), 0.1) == (0, 0)


def test_a_name_that_is_none_is_refused():
    for name in ("steps/gap/1", "steps/driven/1/1", "nothing/gap/1/1", "steps/gap/x/1"):
        with pytest.raises(ValueError, match="row/fault/number/seed"):
            draw(name)
    assert design.names("friction", 3)[-1] == "friction/both/3/1"
