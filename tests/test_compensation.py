"""Compensation of the gap, in closed loops."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bench.compensation import Case, Harm, harm, reversals, warned

from glapp import Loop
from glapp.errors import InputError
from glapp.fit import Fit
from glapp.modules import Flag
from glapp.recording import BAD
from glapp.result import decide
from glapp.simulate import COMPENSATION_STATES, Compensation, Scenario, Simulation, Walk, run, run_many

WAYS = ("error", "derivative", "inverse")
ACTIVE, NOT_ENABLED, MANUAL = (COMPENSATION_STATES.index(name) for name in ("active", "not_enabled", "not_auto"))


def loop(**changes: Any) -> Scenario:
    """P1 with its limit cycle."""
    fields: dict[str, Any] = {
        "plant": "P1",
        "controller": (0.363, 7.06, 0, 0),
        "d": 0.05,
        "noise": 0.002,
        "h": 0.05,
        "t_end": 600,
        "setpoint": [(1, 1.0)],
        "load": [(100, 0.3)],
        "filter_in_loop": True,
    }
    return Scenario(**fields | changes)


def compensated(way: Any = "inverse", **changes: Any) -> Compensation:
    return Compensation(**{"way": way, "size": 0.05, "withdraw": False} | changes)


def ff(simulation: Simulation) -> np.ndarray:
    assert simulation.u_ff is not None
    return simulation.u_ff


def standing(simulation: Simulation) -> np.ndarray:
    assert simulation.standing is not None
    return simulation.standing


@pytest.mark.parametrize("way", WAYS)
def test_is_the_uncompensated_loop_until_it_is_enabled(way: str) -> None:
    without, with_it = run(loop()), run(loop(compensation=compensated(way, begin=300.0)))
    before = with_it.t < 300
    for name in ("pv", "op", "position", "flags"):
        assert np.array_equal(getattr(without, name)[before], getattr(with_it, name)[before])
    assert not ff(with_it)[before].any() and (standing(with_it)[before] == NOT_ENABLED).all()
    assert ff(with_it)[~before].any() and (standing(with_it)[-1000:] == ACTIVE).all()


@pytest.mark.parametrize("direct", [False, True])
@pytest.mark.parametrize("way", WAYS)
def test_takes_the_limit_cycle_of_an_integrating_process_away(way: str, direct: bool) -> None:
    """A loop of P1 swings by the gap for ever; a wrong sign of K would make it swing more."""
    plant, controller = ("P1", (0.363, 7.06)) if not direct else (([-1.0], [1.0, 1.0, 0.0], 0.0), (-0.363, 7.06))
    swings = [
        float(np.ptp(s.pv[s.t > 400]))
        for s in (
            run(loop(plant=plant, controller=controller, noise=0.0, compensation=c))
            for c in (None, compensated(way, band=0.0), compensated(way, size=0.025, band=0.0))
        )
    ]
    assert swings[0] > 0.1
    assert swings[1] < 0.15 * swings[0]
    assert 0.3 * swings[0] < swings[2] < 0.7 * swings[0]


def test_adds_to_the_output_before_its_limits() -> None:
    s = run(loop(limits=(-0.5, 0.6), compensation=compensated("error", size=0.2)))
    assert s.op.min() >= -0.5 and s.op.max() <= 0.6
    jumps = np.abs(np.diff(ff(s))) > 0.05
    assert jumps.any()
    assert np.abs(np.diff(s.op - ff(s)))[jumps].max() < 0.05, "what is left without u_FF has no jumps"


def test_a_lost_signal_takes_it_away_and_leaves_the_output() -> None:
    s = run(loop(bad=[(300.0, 320.0)], compensation=compensated("inverse", release=5.0)))
    bad = (s.flags & BAD) != 0
    first, last = np.flatnonzero(bad)[[0, -1]]
    # The controller holds its output: it is not in automatic.
    assert bad.sum() == 400 and (standing(s)[bad] == MANUAL).all()
    assert ff(s)[first - 1] != 0.0 and not ff(s)[bad][1:].any()
    assert (s.op[bad] == s.op[first - 1]).all(), "OP stays where it stood, with what was added to it"
    assert abs(s.op[last + 1] - s.op[last]) < 0.002, "no bump"
    assert (s.pv[bad] == s.pv[first - 1]).all(), "the recording repeats the last value"
    assert (standing(s)[-1000:] == ACTIVE).all()


def test_withdraws_where_it_drives_the_loop() -> None:
    kept = run(loop(compensation=compensated("error", size=0.1)))
    withdrawn = run(loop(compensation=compensated("error", size=0.1, withdraw=True)))
    assert COMPENSATION_STATES[int(standing(withdrawn)[-1])] == "over_compensated" and ff(withdrawn)[-1] == 0.0
    assert (standing(kept)[-1000:] == ACTIVE).all()


def test_comes_in_with_a_reversal() -> None:
    """Sooner, it would push the valve on by half the gap."""
    s = run(loop(compensation=compensated("inverse", begin=300.0)))
    first = int(np.flatnonzero(ff(s))[0])
    assert (standing(s)[s.t == 300.0] == COMPENSATION_STATES.index("waiting")).all()
    assert np.abs(np.diff(s.position[first - 2 : first + 10])).max() == 0.0, "the valve stands in its gap"


def test_a_loop_whose_valve_is_worn_out_is_left_alone() -> None:
    """sign(e) in noise makes PV better, at eight times the reversals; a smaller size of the inverse stays."""
    noisy: dict[str, Any] = {"plant": "P2", "controller": (0.775, 2.05, 0, 0), "noise": 0.005, "t_end": 2000.0}
    noisy["load"] = [Walk(rate=0.002)]
    for way, share, name in (("error", 1.0, "worse"), ("inverse", 0.6, "active")):
        s = run(loop(**noisy, compensation=compensated(way, share=share, begin=600.0, withdraw=True)))
        assert COMPENSATION_STATES[int(standing(s)[-1])] == name
        assert (ff(s)[-1] == 0.0) == (name == "worse")


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_compensation_of_random_loops_does_no_harm_or_is_withdrawn_in_time(way: str) -> None:
    found = [one for one in (harm(number, way) for number in range(16)) if one is not None]
    assert len(found) >= 14
    assert not [one for one in found if one.broken]
    assert np.mean([one.harmless or one.in_time for one in found]) >= 0.9
    assert any(one.active > 0.5 for one in found), "a compensation that is never in force does no harm either"


def test_what_counts_as_harm() -> None:
    fields = {"name": "", "gap": 1.0, "size": 0.8, "standing": "active", "active": 1.0, "broken": ""}
    assert Harm(pv=1.1, turns=17, turns_without=10, **fields).harmless  # type: ignore[arg-type]
    assert not Harm(pv=1.11, turns=10, turns_without=10, **fields).harmless  # type: ignore[arg-type]
    assert not Harm(pv=0.5, turns=18, turns_without=10, **fields).harmless  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("force", "shown", "in_time", "at_once"),
    [
        (None, None, False, False),  # never withdrawn
        (10, None, True, True),
        (11, None, False, False),  # harm never showed, and yet
        (50, 10, True, False),
        (50, 11, False, False),
        (30, 0, True, False),  # withdrawn before it showed
    ],
)
def test_what_counts_as_withdrawn_in_time(force: int | None, shown: int | None, in_time: bool, at_once: bool) -> None:
    fields = {"name": "", "gap": 1.0, "size": 0.8, "pv": 1.2, "turns": 0, "turns_without": 0, "standing": "worse"}
    one = Harm(**fields, active=0.0, broken="", since_force=force, since_shown=shown)  # type: ignore[arg-type]
    assert (one.in_time, one.at_once) == (in_time, at_once)


def test_reversals_are_turns_beyond_the_band() -> None:
    zigzag = np.array([0.0, 1.0, 0.8, 1.2, 1.2, 0.0, 0.3, -1.0, 0.5])
    assert [reversals(zigzag, band) for band in (0.1, 0.25, 0.5, 3.0)] == [6, 4, 2, 0]


@pytest.mark.parametrize(("plant", "ratio"), [("P1", 0.5), ("P1", 0.8), ("P1", 2.0), ("P3", 0.8), ("P3", 2.0)])
def test_our_warning_is_right_where_that_of_the_thesis_is_wrong(plant: str, ratio: float) -> None:
    found = warned(Case(plant, noise=0.005, dead_time=0.0, h=0.1, way="inverse", ratio=ratio, seed=3))
    assert found is not None
    _, equal, relay = found
    assert equal > 0, "equal half-periods there are in all of these"
    assert relay > 0.5 if ratio > 1 else relay == 0


@pytest.mark.parametrize("turned", [False, True])
def test_what_the_module_notices_is_recorded(turned: bool) -> None:
    """A process of the wrong sign; and a size of twice the gap, which drives the loop."""
    plant = ([-1.0 if turned else 1.0], [0.8, 1.0, 0.0], 0.2)
    given = compensated("error", size=0.1, estimate=False, begin=100.0)
    s = run(loop(plant=plant, limits=(-5.0, 5.0), compensation=given))
    assert s.error is not None and s.over is not None
    assert s.error[-1] == (Flag.WRONG_SIGN if turned else 0) and not s.error[s.t < 10].any()
    assert not (s.over[s.t < 100].astype(int) & 2).any()
    assert (int(s.over[-1]) & 2 != 0) != turned
    assert COMPENSATION_STATES[int(standing(s)[-1])] == ("at_limit" if turned else "active")


def test_only_backlash_may_be_compensated() -> None:
    for verdict, size in (("backlash", 0.8), ("both", None), ("stiction", None), ("at_least", None), ("sound", 0.0)):
        fit = Fit(verdict=verdict, reason="", unit="%", d=1.0, low=0.8, high=1.2)  # type: ignore[arg-type]
        none: dict[str, Any] = {"crossings": "no_estimate", "d_hat": None, "detections": 0, "reasons": {}}
        assert decide(**none, fit=fit, loop=Loop(name="FIC1")).compensable == size


def test_together_as_alone() -> None:
    scenarios = [loop(seed=seed, compensation=compensated()) for seed in range(5)]
    for alone, together in zip(map(run, scenarios), run_many(scenarios, progress=False), strict=True):
        for name in ("pv", "op", "u_ff", "standing", "over", "error", "flags"):
            assert np.array_equal(getattr(alone, name), getattr(together, name))


def test_settings_survive_toml() -> None:
    scenario = loop(bad=[(10.0, 20.0)], compensation=compensated("error", share=0.8, begin=5.0))
    assert (
        'compensation = { way = "error", size = 0.05, share = 0.8, withdraw = false, begin = 5.0 }\n'
        in scenario.to_toml()
    )
    assert Scenario.from_toml(scenario.to_toml()) == scenario


def test_beside_a_controller_that_is_not_ours() -> None:
    """A scan late it is the loop of the module at the controller; beyond a fifth of Ti nothing is compensated."""
    changes: dict[str, Any] = {"bad": [(300.0, 310.0)], "manual": [(400.0, 405.0)], "limits": (-0.6, 0.6)}

    def late(delay: int | None, **more: Any) -> Simulation:
        return run(loop(**changes, compensation=compensated(begin=100.0, delay=delay, **more)))

    ours, theirs = late(None), late(1)
    for name in ("pv", "op", "u_ff", "standing", "over", "error", "flags"):
        assert np.array_equal(getattr(ours, name), getattr(theirs, name))
    assert ff(theirs).any() and not np.array_equal(late(3).op, ours.op)
    slow = {"h": 0.5, "t_end": 600}
    changes |= slow
    assert (standing(late(2)) == ACTIVE).any()  # 1 s, Ti is 7.06 s
    assert not ff(late(3)).any() and COMPENSATION_STATES[int(standing(late(3))[-1])] == "too_late"
    assert ff(late(3, longest=1.0)).any()


def test_in_a_cascade() -> None:
    outer = {"plant": ([1.0], [30.0, 1.0], 0.0), "controller": (2.0, 30.0, 0, 0), "tf": 3.0}
    s = run(loop(plant="P2", controller=(0.775, 2.05, 0, 0), outer=outer, compensation=compensated()))
    assert s.outer_pv is not None and abs(s.outer_pv[-1] - 1.0) < 0.1 and ff(s).any()


@pytest.mark.parametrize(
    ("change", "parameter"),
    [
        ({"way": "sign"}, "way"),
        ({"size": -1.0}, "size"),
        ({"share": 1.5}, "share"),
        ({"rate": 0.0}, "rate"),
        ({"reversals": 1}, "reversals"),
        ({"k": 0.0}, "k"),
        ({"delay": 0}, "delay"),
        ({"delay": 33}, "delay"),
        ({"longest": -1.0}, "longest"),
    ],
)
def test_refuses_what_is_out_of_bounds(change: dict[str, Any], parameter: str) -> None:
    with pytest.raises(InputError, match=parameter):
        run(loop(compensation=compensated(**change)))


def test_has_no_default_way() -> None:
    with pytest.raises(InputError, match="way"):
        Compensation(size=0.05)  # type: ignore[call-arg]


def test_a_stretch_without_values_that_ends_before_it_begins() -> None:
    with pytest.raises(InputError, match="bad: stretch from 20 s to 10 s"):
        run(loop(bad=[(20.0, 10.0)]))
