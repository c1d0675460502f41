"""What the ladder says of loops whose gap is known: ordinary ones, limit cycles, and their twins without a gap."""

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
    # Once "swings to and fro in almost even time, which no gap makes of this process".
    loop = ladder.cycling(2)
    cycle = ladder.limit_cycle(loop, 2)
    fit = judged(cycle, "cycle")
    assert fit.best["confidence"] == "found"
    assert fit.best["oscillates"]
    assert fit.low is not None and fit.high is not None and fit.low <= loop["d"] <= fit.high
    # The same loop without a gap, its OP driven as far and as fast.
    twin = judged(ladder.driven(loop, cycle, "sine", 2), "driven")
    assert twin.best["confidence"] not in ("found", "likely")


@pytest.mark.slow
def test_what_is_said_follows_from_the_evidence() -> None:
    simulation, d = ladder.ordinary(3)
    best = judged(simulation, "ordinary").best
    again = _glapp.fit_judgement(json.dumps(best["evidence"]))
    assert again == {key: best[key] for key in ("confidence", "cause", "width_kind", "oscillates", "reason")}
    assert best["cause"] == "dead_band"
    assert best["low"] <= d <= best["high"]
