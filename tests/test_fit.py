"""The fit of the gap from OP and PV: truth from the simulator, wrong input, the traps of other methods."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from bench.lengths import made
from bench.loads.answer import LoadsAnswer
from bench.loads.records import record as confusing
from bench.truth.records import record
from filtered import filtered
from fits import made_anew

import glapp
from glapp.simulate import Simulation, random_walk

REFINERY = Path(__file__).parents[1].parent / "shared/data/refinery"
LOADS: dict[str, Any] = {"load": [(50, 0.3), (120, -0.2), (180, 0.1)]}
GAP = {"backlash", "stiction", "both"}


def fitted(t: Any, pv: Any, op: Any, **settings: Any) -> glapp.Fit:
    table = {"time": t, "SP": np.zeros(len(t)), "PV": pv, "OP": op}
    return glapp.fit(glapp.recording_from(table, glapp.Loop(name="made", op_unit="1", **settings)))


def simulation(plant: str = "P3", controller: Any = (0.48, 0.3117), d: float = 0.05, **kw: Any) -> Simulation:
    kw = {"noise": 0.005, "h": 0.1, "t_end": 250, "setpoint": [(1, 1.0)], "seed": 1, **kw}
    return filtered(plant, (*controller, 0.0, 0.0)[:4], d=d, **kw)


def simulated(plant: str = "P3", controller: Any = (0.48, 0.3117), d: float = 0.05, **kw: Any) -> glapp.Fit:
    s = simulation(plant, controller, d, **kw)
    table = s.to_arrow().drop_columns("POSITION")
    return glapp.fit(glapp.recording_from(table, glapp.Loop(name=plant, op_unit="1")))


@pytest.mark.slow
@pytest.mark.parametrize("d", [0.1, 0.05, 0.02])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_width_is_found_and_lies_in_its_interval(d: float, seed: int) -> None:
    f = simulated(d=d, seed=seed, **LOADS)
    assert f.verdict == "backlash", f.reason
    assert f.d == pytest.approx(d, rel=0.1)
    assert f.low is not None and f.high is not None
    assert f.low - 0.03 * d < d < f.high + 0.03 * d, (f.low, f.high)


@pytest.mark.slow
def test_progress_follows_the_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Progress grows from the first window to the end. Regression: it stood at 0 until the last window was done."""
    monkeypatch.setattr(glapp._glapp, "fit", made_anew)
    moves = [(40.0 * k, 0.3 * (-1) ** k) for k in range(1, 20)]
    s = simulation(t_end=800, load=moves)
    shares: list[float] = []
    glapp.fit(t=s.t, pv=s.pv, op=s.op, progress=shares.append)  # type: ignore[arg-type]
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert len(shares) > 8 and max(np.diff([0.0, *shares])) < 0.4

    def stop(share: float | None) -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        glapp.fit(t=s.t[:900], pv=s.pv[:900], op=s.op[:900], progress=stop)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "verdict"), [(1, "sound"), (2, "sound"), (3, "cannot_tell")])
def test_without_a_gap_none_is_claimed(seed: int, verdict: str) -> None:
    """In the third PV strays from the model at its turns, as where a load that OP answers looks like the valve."""
    f = simulated(d=0.0, seed=seed, **LOADS)
    assert f.verdict == verdict, f.reason
    assert f.high is not None and f.high < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "verdict"), [("both/steps/inside/1", "both"), ("backlash/steps/outside/20", "backlash")]
)
def test_small_steps_of_the_load_are_found_beside_the_lost_motion(name: str, verdict: str) -> None:
    """A load that walks would be the likelier one only if all of its steps were noise."""
    made = record(name)
    assert made is not None
    f, truth = glapp.fit(made[0].recording), made[1]
    assert f.verdict == verdict, f.reason
    assert f.low is not None and f.high is not None and f.low < truth.d < f.high
    assert f.best is not None and f.best["load_steps"] >= 5


@pytest.mark.slow
@pytest.mark.parametrize(("h", "seed"), [(0.2, 1), (1.0, 3)])
def test_steps_that_make_up_for_a_wrong_width_are_marked_anew(h: float, seed: int) -> None:
    # Eleven steps beside a width of 1.25 (1.19 to 1.34) were believed, where four beside 1.5 explain far more.
    steps = [(300.0 * k, 5.0 * (k % 3)) for k in range(5)]
    sim = filtered(
        ([1.5], [30, 13, 1], 2.0), (0.6, 12.0, 0, 0), d=1.5, noise=0.1, h=h, t_end=1500, seed=seed, load=steps
    )
    found = glapp.fit(t=sim.t, pv=sim.pv, op=sim.op)
    assert found.verdict == "backlash" and found.d == pytest.approx(1.5, rel=0.02)
    # The intervals by the likelihood differ by less than 0.1. Their limits are moved out by 5 and 10 %.
    assert found.low <= 1.5 <= found.high and found.high - found.low < 0.3
    assert 4 <= found.best["load_steps"] < 8


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.slow
def test_small_steps_of_the_load_show_no_gap(number: int) -> None:
    made = record(f"none/steps/inside/{number}")
    assert made is not None
    f = glapp.fit(made[0].recording)
    assert not f.found, f.reason


@pytest.mark.verify
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("none/steps/outside/36", "no model of the loop fits"),
        ("both/ramps/outside/9", "explains the data as well"),
        ("oscillation/sine/inside/4", "a disturbance with the period of this loop"),
        ("backlash/ramps/outside/56", "PV does not follow OP"),
    ],
)
def test_samples_too_far_apart_or_a_single_move_of_op_show_no_gap(name: str, reason: str) -> None:
    """Each of these once had a width that was not there, or a bound above the truth."""
    made = record(name)
    assert made is not None
    f = glapp.fit(made[0].recording)
    assert f.verdict == "cannot_tell" and reason in f.reason, f.reason


@pytest.mark.verify
def test_a_gap_below_the_noise_of_pv_has_both_limits() -> None:
    """It got a bound alone, however often OP went through it: 198 times each way here."""
    f = simulated(d=0.05, noise=0.06, t_end=1000, load=[(40.0 * k, 0.3 * (k % 2)) for k in range(1, 25)])
    assert f.verdict == "backlash" and f.low is not None and f.high is not None, f.reason
    assert f.low < 0.05 < f.high < 0.15, repr(f)


def walk(rate: float, h: float, t_end: float, seed: int) -> Any:
    return random_walk(round(t_end / h) + 1, h, rate, seed=seed)


@pytest.mark.verify
@pytest.mark.parametrize("seed", [3, 4])
def test_a_load_that_walks_shows_no_gap(seed: int) -> None:
    """The zero-crossing estimate shows confident false widths here."""
    h, t_end = 0.3, 900.0
    f = simulated("P2", (0.775, 2.05), 0.0, h=h, t_end=t_end, load=walk(0.006, h, t_end, seed), seed=seed)
    assert f.verdict not in GAP and f.verdict != "at_least", f.reason
    true = simulated("P2", (0.775, 2.05), 0.05, h=h, t_end=t_end, load=walk(0.006, h, t_end, seed), seed=seed)
    assert true.verdict == "backlash", true.reason
    assert true.d == pytest.approx(0.05, rel=0.25)


@pytest.mark.verify
def test_derivative_action_does_not_bias_the_width() -> None:
    """Equation (7.5) reads 18 % low in this loop: the derivative part opposes the integral."""
    f = simulated("P2", (1.12, 2.40, 0.619), 0.05, h=0.2, t_end=700, load=[(100, 0.3), (300, -0.2), (500, 0.2)])
    assert f.verdict == "backlash", f.reason
    assert f.d == pytest.approx(0.05, rel=0.05)


@pytest.mark.slow
def test_the_width_scales_with_the_units() -> None:
    s = simulation(**LOADS)
    f = fitted(s.t, s.pv, s.op)
    g = fitted(s.t * 60.0, 1000.0 - 50.0 * s.pv, s.op * 10.0 + 3.0)
    assert f.d is not None and g.d is not None and f.process is not None and g.process is not None
    assert g.verdict == f.verdict
    assert g.d == pytest.approx(10.0 * f.d, rel=0.01)
    assert g.process.kp[0] == pytest.approx(-5.0 * f.process.kp[0], rel=0.02)
    assert g.process.lag[0] == pytest.approx(60.0 * f.process.lag[0], rel=0.05)


@pytest.mark.verify
@pytest.mark.xdist_group("units")
@pytest.mark.parametrize(
    ("pv", "op", "seconds", "zero"),
    [(1e-4, 1.0, 1.0, 0.0), (1e4, 1.0, 60.0, 0.0), (1.0, 1e-3, 1.0, 1e6)],  # none of the two can make up for the other
)
def test_no_unit_changes_the_answer(pv: float, op: float, seconds: float, zero: float) -> None:
    """Rounding in another unit once led the search elsewhere: 1.36 for 1.50, and 14 steps of the load for 4."""
    load = [(300.0 * k, 5.0 * (k % 3)) for k in range(5)]
    s = filtered(([1.5], [30, 13, 1], 2.0), (0.6, 12.0, 0, 0), d=1.5, noise=0.1, seed=1, t_end=1500, load=load)
    f, g = fitted(s.t, s.pv, s.op), fitted(s.t * seconds, s.pv * pv + zero, s.op * op)
    assert g.verdict == f.verdict == "backlash"
    for here, there in ((f.d, g.d), (f.low, g.low), (f.high, g.high)):
        assert here is not None and there is not None
        assert there / op == pytest.approx(here, rel=1e-3)


@pytest.mark.verify
@pytest.mark.xdist_group("levels/PI/gap/0")
def test_many_rows_are_cut_into_windows_as_long_as_the_process_asks_for() -> None:
    """Cells as long as a load's step once made 100 000 rows 8.9 (5.1 to 12.4)."""
    f = glapp.analyze(made("levels/PI/gap/0", 100_000).recording(100_000)).fit  # as test_lengths has it
    assert f is not None and f.verdict == "backlash", f
    assert f.low is not None and f.high is not None and f.low <= 1.5 <= f.high < 1.7
    assert all(w.t_end - w.t_start < 10_000 for w in f.windows) and len(f.windows) > 3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["triangle fast/none/0", "triangle slow/none/0", "irregular cycle/none/1"])
def test_a_load_that_swings_is_no_gap(name: str) -> None:
    """Each of these once had a width or a bound without any gap."""
    f = glapp.fit(confusing(name).recording(1500))
    assert not f.found, f.reason


@pytest.mark.verify
@pytest.mark.parametrize("name", ["backlash/ramps/inside/68", "stiction/ramps/inside/12", "both/steps/outside/57"])
def test_a_setpoint_that_moves_tells_an_even_swing_from_a_load_that_swings(name: str) -> None:
    """The loop rings or slips after the setpoint; without that it might be a neighbour that swings."""
    made = record(name)
    assert made is not None
    [batch] = made[0].recording.batches()
    signals = {"t": batch.t, "pv": batch.pv, "op": batch.op, "loop": made[0].recording.loop}
    without, led = glapp.fit(**signals), glapp.fit(sp=batch.sp, **signals)
    assert (without.verdict, without.why) == ("cannot_tell", "swings")
    assert led.found and led.low is not None and led.high is not None and led.low < made[1].d < led.high, led.reason
    # One that hardly moves tells nothing.
    still = glapp.fit(sp=50.0 + 0.01 * (batch.sp - 50.0), **signals)
    assert still.why == "swings"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "verdict"),
    [
        ("triangle slow/none/707", "cannot_tell"),  # PV strays from the model at its turns
        ("random ramps/none/201", "sound"),
        ("slow ramps/none/705", "sound"),
    ],
)
def test_a_load_along_lines_leaves_a_valve_sound(name: str, verdict: str) -> None:
    f = glapp.fit(confusing(name).recording(1500))
    assert f.verdict == verdict and f.high is not None and f.high < 0.3, f.reason
    assert f.best is not None and f.best["load_steps"] >= 4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["triangle slow/gap/14", "random ramps/gap/15", "random ramps/gap/18"])
def test_a_gap_is_found_under_a_load_of_straight_lines(name: str) -> None:
    made = confusing(name)
    f = glapp.fit(made.recording(1500))
    assert f.verdict == "backlash", f.reason
    assert f.low is not None and f.high is not None and f.low < made.d < f.high
    assert f.d == pytest.approx(made.d, rel=0.1)


@pytest.mark.verify
@pytest.mark.parametrize("acting", [{"setpoint": [(1.0, 2.0)]}, {"load": [(1.0, 10.0)]}], ids=["setpoint", "load"])
@pytest.mark.parametrize(("h", "seed"), [(0.02, 1), (0.05, 2)])
def test_a_gap_in_little_noise_has_no_jump(h: float, seed: int, acting: Any) -> None:
    """Regression: under MIGO PI with Ms 2.0 a gap of 1 was fitted as one of 2.3 with a jump."""
    s = filtered("P1", (0.781, 4.04, 0, 0), d=1.0, noise=0.02, h=h, seed=seed, t_end=300.0, **acting)
    f = fitted(s.t, s.pv, s.op)
    assert f.verdict == "backlash" and f.jump == 0.0, f.reason
    assert f.low is not None and f.high is not None and f.low < 1.0 < f.high
    assert f.d == pytest.approx(1.0, abs=0.05)


MARKED = ["steps/gap/17", "steps/gap/19", "slow ramps/gap/11", "slow ramps/gap/17", "squares through a lag/none/58"]
"""Records with as many marked steps or bends as traversals of the gap. Regression: an interval missed the truth, or a
gap was claimed.
"""

UNKNOWN = ["triangle fast/gap/10", "outliers/none/10", "random ramps/none/18", "outliers/none/220"]
"""OP goes through a width a few times under an unknown load: a gap was once claimed that is none, or not so wide."""

WIDE = ["triangle fast/gap/227"]
"""Regression: 13.6 of the 20 that OP swings was the width for a gap of 3."""

LINED = ["swinging door/gap/214", "swinging door/gap/226"]
"""PV is kept as lines, which hide the gap: the valve was once called sound."""


@pytest.mark.verify
@pytest.mark.parametrize("name", MARKED + UNKNOWN + WIDE + LINED)
def test_answers_under_loads_that_resemble_a_gap_are_true(name: str) -> None:
    assert LoadsAnswer.to(confusing(name), 1500).outcome != "wrong"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("PV filtered/gap/258", "the process settles in"),
        ("squares through a lag/gap/238", "the process settles in"),
        ("squares through a lag/gap/256", "changes of the load"),
    ],
)
def test_what_hides_a_gap_makes_no_valve_sound(name: str, why: str) -> None:
    """Each has a gap, and was once sound: PV answered at once, within hours, or beside 16 steps for 8 traversals."""
    found = glapp.fit(confusing(name).recording(1500))
    assert found.verdict == "cannot_tell" and why in found.reason, found.reason


@pytest.mark.verify
@pytest.mark.parametrize("name", ["none/ramps/inside/0", "oscillation/sine/outside/0"])
def test_a_bound_that_noise_hides_needs_as_much_as_any_other(name: str) -> None:
    """0.007 and 0.07 were once lost at least, where 17 and 15 units were asked."""
    made = record(name)
    assert made is not None
    f = glapp.fit(made[0].recording)
    assert f.verdict == "cannot_tell", f.reason


@pytest.mark.slow
@pytest.mark.parametrize("number", [18, 706])
def test_a_gap_is_found_in_spite_of_outliers(number: int) -> None:
    """A sample that the controller saw as far off leaves two innovations against each other."""
    made = confusing(f"outliers/gap/{number}")
    f = glapp.fit(made.recording(1500))
    assert f.verdict == "backlash", f.reason
    assert f.low is not None and f.high is not None and f.low < made.d < f.high


@pytest.mark.verify
@pytest.mark.parametrize("number", [1, 3])
def test_spikes_of_pv_are_left_out(number: int) -> None:
    made = confusing(f"outliers/gap/{number}")
    f = glapp.fit(made.recording(1500))
    assert not f.found or (f.low is not None and f.low <= made.d <= (f.high or made.d)), f.reason


@pytest.mark.slow
@pytest.mark.parametrize("number", ["transmitter shifts/gap/2", "recorder shifts/gap/708"])
def test_a_gap_is_found_in_spite_of_shifts_of_pv(number: str) -> None:
    """A model that has to explain the shifts does not tell."""
    made = confusing(number)
    f = glapp.fit(made.recording(1500))
    assert f.verdict == "backlash", f.reason
    assert f.low is not None and f.high is not None and f.low < made.d < f.high


@pytest.mark.slow
def test_the_same_recording_gets_the_same_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    once = simulated(d=0.02, **LOADS).to_dict()
    monkeypatch.setattr("glapp._glapp.fit", made_anew)
    assert simulated(d=0.02, **LOADS).to_dict() == once


@pytest.mark.slow
def test_a_hole_and_bad_values_do_no_harm() -> None:
    s = simulation(**LOADS)
    pv, keep = s.pv.copy(), np.ones(len(s.t), bool)
    pv[300:310] = np.nan
    keep[1000:1200] = False
    f = fitted(s.t[keep], pv[keep], s.op[keep])
    assert f.verdict == "backlash", f.reason
    assert f.d == pytest.approx(0.05, rel=0.1)


@pytest.mark.slow
def test_a_gap_that_op_never_goes_through_gives_no_width() -> None:
    t = np.arange(0, 400, 0.5)
    rng = np.random.default_rng(1)
    op = 50 + 0.4 * np.sin(t / 9) + 0.01 * rng.standard_normal(len(t))
    f = fitted(t, 20 + 0.05 * rng.standard_normal(len(t)), op)
    assert f.verdict == "cannot_tell" and "does not follow OP" in f.reason


def _noise(n: int) -> Any:
    return np.random.default_rng(2).standard_normal(n)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (lambda t: (_noise(len(t)), np.full(len(t), 40.0)), "stands still"),
        (lambda t: (np.sin(t / 7), np.sin(t / 7)), "same signal"),
        (lambda t: (np.zeros(len(t)), np.sin(t / 7)), "PV stands still"),
        (lambda t: (_noise(len(t)), np.round(0.8 * np.sin(t / 7))), "too coarsely"),
        (lambda t: (_noise(len(t)), np.where(t < 1e9, np.nan, 1.0)), "OP has a value in fewer than 50 rows"),
    ],
)
def test_what_cannot_be_fitted_is_refused_with_its_reason(columns: Any, message: str) -> None:
    t = np.arange(0, 300, 0.5)
    f = fitted(t, *columns(t))
    assert f.verdict == "cannot_tell" and message in f.reason, f.reason
    assert f.d is None


@pytest.mark.slow
def test_two_moves_one_way_give_neither_width_nor_bound() -> None:
    """The first move depends on the valve's place in its gap. Regression: a coarse grid of places made a width."""
    t = np.arange(0.0, 1200.0)
    op = np.where(t < 400, 45.0, np.where(t < 800, 41.0, 38.0)) + 0.01 * np.sin(t)
    gap = glapp.blocks.Backlash(1.5, 44.25)
    valve = np.array([gap.update(x) for x in op])
    pv, level = np.empty(len(t)), valve[0]
    for i, x in enumerate(valve):
        level += (x - level) / 12
        pv[i] = 2.5 * level
    f = fitted(t, pv + 0.3 * _noise(len(t)), op)
    assert f.verdict == "cannot_tell", f.reason
    assert f.low is not None and f.low < 1.5


def test_five_samples_are_too_few() -> None:
    f = fitted(np.arange(5.0), np.arange(5.0), np.arange(5.0)[::-1])
    assert f.verdict == "cannot_tell" and "too few" in f.reason


def test_no_op_no_fit() -> None:
    table = {"time": np.arange(100.0), "SP": np.zeros(100), "PV": _noise(100)}
    f = glapp.fit(glapp.recording_from(table, glapp.Loop(name="no OP")))
    assert f.verdict == "cannot_tell" and "no OP" in f.reason


@pytest.mark.slow
def test_op_of_another_loop_gives_no_gap() -> None:
    t = np.arange(0, 500, 0.5)
    f = fitted(t, np.cumsum(_noise(len(t))) * 0.1, 50 + 5 * np.sin(t / 11))
    assert f.verdict in {"cannot_tell", "sound"}, f.reason


@pytest.mark.slow
def test_a_pv_that_no_model_makes_gives_no_gap() -> None:
    """OP answers PV, but PV is two sines to the last digit. Regression: a gap explained the residual."""
    t = np.arange(600.0)
    pv = np.round(50 + np.sin(t / 17) + 0.3 * np.sin(t / 5), 4)
    op = 55 + 0.8 * (50 - pv) + 0.8 / 25 * np.cumsum(50 - pv)
    f = fitted(t, pv, op)
    assert not f.found, f.reason


@pytest.mark.slow
def test_a_recorded_valve_position_decides_the_verdict() -> None:
    """PV alone cannot tell: OP hardly moves through the gap, and the noise is as large as what PV shows of it."""
    s = filtered("P2", (0.4, 2.3, 0, 0), d=0.05, noise=0.05, h=0.2, t_end=300, load=walk(0.02, 0.2, 300, 1), seed=1)
    positioned = glapp.Loop(name="P2", op_unit="1", positioner={"dead_band": 0.2})
    position = s.position + np.random.default_rng(1).normal(0.0, 0.002, len(s.t))
    table = {"time": s.t, "SP": s.sp, "PV": s.pv, "OP": s.op, "POSITION": position}
    f = glapp.fit(glapp.recording_from(table, positioned))
    assert f.verdict == "backlash" and f.low is not None and f.high is not None
    assert f.low <= 0.05 <= f.high and f.high - f.low < 0.01
    assert f.through_pv is not None and f.through_pv.verdict != "backlash"
    assert "valve's position" in f.reason and "0.2 % of travel" in f.reason
    assert f.to_dict()["signal"] == "position"


@pytest.mark.slow
def test_the_zero_crossing_estimate_takes_the_fitted_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    s = filtered("P3", (0.48, 0.3117, 0, 0), d=0.05, noise=0.002, h=0.1, t_end=400, setpoint=[(1, 1.0)], **LOADS)
    spans = {"pv_span": (0, 1), "op_span": (0, 1)}
    loop = glapp.Loop(name="P3", op_unit="1", controller={"k": 0.48, "ti": 0.3117, "setpoint_weight": 0}, **spans)
    recording = glapp.recording_from(s.to_arrow().drop_columns("POSITION"), loop)
    passes, batches = [], type(recording).batches
    monkeypatch.setattr(type(recording), "batches", lambda *a: passes.append(1) or batches(*a))
    fitted = glapp.analyze(recording)
    assert len(passes) == 1, "what is in memory was read again"
    assumed = glapp.analyze(recording, fit=False)
    assert assumed.settings.kp == pytest.approx(1.5) and assumed.settings.origins["kp"] == "assumed"
    assert fitted.settings.kp == pytest.approx(1.0, rel=0.15) and "fitted" in fitted.settings.notes["kp"]
    assert fitted.settings.origins["kp"] == "fitted" and fitted.settings.origins["k"] == "given"
    assert fitted.d_hat is not None and assumed.d_hat is not None and fitted.d_hat < assumed.d_hat


@pytest.mark.verify
def test_the_controllers_filter_time_does_not_matter_to_it() -> None:
    """The zero-crossing estimate of the same loops reads the lower the longer its filter."""
    table = filtered(
        "P3", (0.48, 0.3117, 0, 0), d=0.05, noise=0.002, h=0.1, t_end=400, setpoint=[(1, 1.0)], **LOADS
    ).to_arrow()
    table = table.drop_columns("POSITION")
    widths = []
    for tf in (0.1, 1.0):
        controller = {"k": 0.48, "ti": 0.3117, "setpoint_weight": 0}
        loop = glapp.Loop(name="P3", op_unit="1", tf=tf, controller=controller, process={"kp": 1})
        widths.append(glapp.analyze(glapp.recording_from(table, loop)))
    assert widths[0].fit is not None and widths[1].fit is not None
    assert widths[0].fit.d == widths[1].fit.d == pytest.approx(0.05, rel=0.1)
    assert (widths[1].d_hat or 0.0) < 0.9 * (widths[0].d_hat or 0.0)


def refinery(name: str) -> glapp.Fit:
    path = REFINERY / f"{name}.csv"
    if not path.exists():
        pytest.skip(f"the refinery recordings are not here ({REFINERY.name})")
    [recording] = glapp.open_recordings(path)
    return glapp.analyze(recording).fit or pytest.fail("OP is recorded, so there must be a fit")


@pytest.mark.slow
def test_the_same_valve_three_months_apart() -> None:
    late, early = refinery("FIC46005_0902"), refinery("FIC46005_0614")
    assert late.verdict in GAP
    assert late.low is not None and late.high is not None and early.low is not None
    assert 0.4 < late.low < late.high < 0.8
    assert late.why == "gap_and_more" and "strays" in late.reason, "its PV is nearly square"
    assert early.low < late.high and (early.high is None or late.low < early.high), "the intervals overlap"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "reason"), [("FIC20102_0609", "60 needed"), ("FIC20102_1207", "in one direction only")]
)
def test_a_single_step_of_op_gives_no_bound(name: str, reason: str) -> None:
    """Each once had a bound: OP went through the gap once, and a step of PV of any size and time explains as much."""
    f = refinery(name)
    assert f.verdict == "cannot_tell" and reason in f.reason, f.reason
    assert f.d is not None and 1.5 < f.d < 2.7


@pytest.mark.slow
def test_an_op_that_moves_little_gives_no_bound() -> None:
    f = refinery("FIC20102_1107")
    assert f.verdict == "cannot_tell" and f.d is not None and 0.5 < f.d < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["LIC31102B_0824", "LIC31102B_0904", "LIC31102B_1127"])
def test_a_clean_sinusoid_is_no_backlash(name: str) -> None:
    assert refinery(name).verdict == "oscillation"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["FIC41004_1108", "LIC30102_0825"])
def test_sound_valves_of_a_refinery_get_no_gap(name: str) -> None:
    assert refinery(name).verdict in {"sound", "cannot_tell"}


def test_an_output_that_winds_up_is_refused() -> None:
    f = refinery("FIC10104_0224")
    assert f.verdict == "cannot_tell" and f.d is None and "winds" in f.reason


@pytest.mark.slow
def test_a_level_that_sticks_gets_no_bound_beyond_its_band() -> None:
    """A valve that moved by 2 % of a band of 79 once explained a stick band of 3: one free step."""
    controller = glapp.controller.Controller(k=0.5, ti=400.0, gain_unit="OP/PV")
    for seed in (4, 5, 9):
        level = glapp.simulate.run(
            glapp.scenario.Scenario(
                name="level",
                plant=glapp.plant.Plant([0.02], [20.0, 1.0, 0.0], 8.0),
                controller=controller,
                friction=glapp.scenario.Friction(model="kano", s=3.0, j=1.5),
                noise=(glapp.scenario.Gaussian(sigma=0.05),),
                setpoint=(glapp.scenario.Steps(steps=((0.0, 50.0),)),),
                load=(glapp.scenario.Steps(steps=((0.0, -50.0),)), glapp.scenario.Walk(rate=0.1)),
                h=1.0,
                t_end=6000,
                seed=seed,
                filter_in_loop=True,
            )
        )
        f = fitted(level.t[::4], level.pv[::4], level.op[::4])
        assert f.verdict == "cannot_tell" or (f.low is not None and f.low <= 3.0), f.reason


def test_a_forgotten_direct_action_does_not_turn_the_process_round() -> None:
    """OP shows that the controller acts the other way, and the fit takes the sign from the recording."""

    def controller(action: Literal["reverse", "direct"]) -> glapp.Controller:
        return glapp.Controller(k=0.5, ti=90.0, action=action, gain_unit="OP/PV")

    cooler = glapp.simulate.run(
        glapp.scenario.Scenario(
            name="cooler",
            plant=glapp.plant.Plant([-1.2], [2400.0, 100.0, 1.0], 4.0),
            controller=controller("direct"),
            d=2.0,
            noise=(glapp.scenario.Gaussian(sigma=0.05),),
            setpoint=(glapp.scenario.Steps(steps=((0.0, 50.0),)),),
            load=(glapp.scenario.Steps(steps=((0.0, 50.0),)), glapp.scenario.Walk(rate=0.3)),
            h=4.0,
            t_end=8000,
            seed=3,
        )
    )

    def answer(action: Literal["reverse", "direct"]) -> glapp.Result:
        loop = glapp.Loop(name="TIC1", controller=controller(action))
        return glapp.analyze(t=cooler.t, sp=cooler.sp, pv=cooler.pv, op=cooler.op, loop=loop)

    right, forgotten = answer("direct"), answer("reverse")
    assert [f.code for f in forgotten.quality if f.code == "sign"] == ["sign"]
    assert right.fit is not None and forgotten.fit is not None and right.fit.process is not None
    assert forgotten.fit.process is not None and right.fit.process.kp[0] < 0
    assert forgotten.fit.process.kp[0] == pytest.approx(right.fit.process.kp[0], rel=1e-3)
    assert forgotten.fit.d == pytest.approx(right.fit.d, rel=1e-3)


def flow(every: float, follows: bool = True) -> dict[str, np.ndarray]:
    """A quiet loop of a flow under a PI controller, a row every so many seconds; its valve may move nothing."""
    h, rows, random = 0.5, 1500, np.random.default_rng(1)
    each, x, load, integral, columns = round(every / h), 0.0, 0.0, 50.0, []
    for k in range(rows * each):
        load += 0.02 * h**0.5 * random.standard_normal()
        pv = 50.0 + x + load + 0.05 * random.standard_normal()
        integral = min(max(integral + 0.4 * h / 3.0 * (50.0 - pv), 0.0), 100.0)
        op = min(max(integral + 0.4 * (50.0 - pv), 0.0), 100.0)
        x += h / 2.0 * ((op - 50.0 if follows else 0.0) - x)
        if k % each == 0:
            columns.append((k * h, 50.0, pv, op))
    return dict(zip(("t", "sp", "pv", "op"), np.array(columns).T, strict=True))


@pytest.mark.slow
def test_the_answer_asks_for_faster_sampling_of_a_flow_with_a_row_a_minute():
    """It ended in "PV does not follow OP", without a word of the sampling."""
    result = glapp.analyze(**flow(60.0))
    assert result.fit.why == "no_answer"
    texts = result.texts()
    assert texts["so"] == "PV of loop does not follow OP, or is recorded too seldom to show it."
    assert texts["do"].startswith("Record a row every 1 s or faster while OP moves")
    assert "Rows 60 s apart may be why" in texts["why"][0] and "every 1 s or faster, while OP moves" in texts["why"][0]
    known = glapp.Loop(name="FIC1", controller={"k": 0.4, "ti": 3})
    assert "every 0.6 s or faster" in glapp.analyze(**flow(60.0), loop=known).texts()["do"]


@pytest.mark.slow
@pytest.mark.parametrize("every", [1.0, 60.0])
def test_the_answer_does_not_ask_for_faster_sampling_where_pv_does_not_follow_op(every):
    result = glapp.analyze(**flow(every, follows=False))
    texts = result.texts()
    assert result.fit.why in ("no_answer", "winding_up")
    assert "apart may be why" not in " ".join(texts["why"]) and "or faster" not in texts["do"]
