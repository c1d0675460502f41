"""Judgements of the ladder on loops whose gap is known: ordinary ones, limit cycles, and their twins without a gap."""

import json

import ladder
import pytest

import glapp
from glapp import _glapp
from glapp.fit import Fit
from glapp.simulate import Simulation


def judged(simulation: Simulation, name: str) -> Fit:
    return glapp.fit(ladder.recording(simulation, name))


@pytest.mark.slow
def test_a_limit_cycle_is_the_gaps_and_not_a_loads() -> None:
    # Once "swings back and forth in almost even time, which no gap makes of this process".
    loop = ladder.cycling(2)
    cycle = ladder.limit_cycle(loop, 2)
    fit = judged(cycle, "cycle")
    assert fit.best["confidence"] in ("found", "likely")
    assert fit.best["oscillates"]
    assert fit.low is not None and fit.high is not None and fit.low <= loop["d"] <= fit.high
    # The same loop without a gap has its OP driven as far and as fast.
    twin = judged(ladder.driven(loop, cycle, "sine", 2), "driven")
    assert twin.best["confidence"] not in ("found", "likely")


@pytest.mark.slow
def test_a_limit_cycle_is_no_sound_valve() -> None:
    # With the loop's sign a load that steps in each half-period explained PV best. It was called sound below 0.8 %,
    # since the step with which the cycle begins was not taken for one.
    loop = ladder.cycling(5)
    fit = glapp.analyze(ladder.recording(ladder.limit_cycle(loop, 5), "cycle")).fit
    assert fit is not None and fit.best is not None and fit.low is not None and fit.high is not None
    assert fit.best["confidence"] in ("found", "likely") and fit.low <= loop["d"] <= fit.high
    assert fit.best["load_steps"] == 1


@pytest.mark.slow
def test_an_ordinary_loop_and_its_twin_without_a_gap() -> None:
    # Nine such loops: seven were silent although the sentence itself named the width.
    simulation, d = ladder.ordinary(5)
    best = judged(simulation, "ordinary").best
    assert (best["confidence"], best["cause"], best["width_kind"]) == ("found", "dead_band", "interval")
    assert best["low"] <= d <= best["high"]
    # The judgement follows from the evidence that is handed out, without a fit.
    again = _glapp.fit_judgement(json.dumps(best["evidence"]))
    assert again == {key: best[key] for key in ("confidence", "cause", "width_kind", "oscillates", "reason")}
    twin = judged(ladder.ordinary(5, gap=False)[0], "twin")
    assert twin.best["confidence"] not in ("found", "likely")
    assert twin.best["cause"] is None


@pytest.mark.slow
def test_a_valve_that_does_not_move_is_not_called_sound() -> None:
    # OP drifts within a gap of 6 and PV lies still: once "< 0.028 %" of such a loop.
    fit = judged(ladder.dozing(1)[0], "dozing")
    assert fit.best["confidence"] == "cannot_tell" and fit.verdict == "cannot_tell"
