"""The corpus of ordinary loops: twins, halves, and the truth of a valve's width."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench.ordinary import design, oracle
from bench.ordinary.__main__ import answers, tasks
from bench.ordinary.answers import Claim, Line, ask, done
from bench.ordinary.design import FAULTS, ROWS, SEEDS, draw, half, names
from bench.ordinary.process import fractional_lag, sensitivity
from bench.ordinary.records import record, reversals, swept
from bench.ordinary.score import tables

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
    assert [{half(n, SEEDS[part]) for n in numbers} for part in "CDEF"] == [{"C"}, {"D"}, {"E"}, {"F"}]
    outside = {n for n in range(16) if draw(f"drift/none/{n}/1").outside}
    assert len(outside & halves["A"]) == len(outside & halves["B"]) == 4


def test_a_name_makes_the_same_record_again_and_another_seed_another():
    once, again, other = (record(f"square/gap/1/{seed}") for seed in (1, 1, 2))
    assert once.table.equals(again.table) and once.truth == again.truth
    assert not once.table.equals(other.table)


FROZEN = {
    "drift/gap/6/1": (2881, 1.056, 181.1, 0.8631, 5.67),
    "steps/gap/6/1": (1441, 2.488, 4.805, 4.759, 11.5),
    "bends/gap/6/1": (3601, 1.39, 5.811, 0.6052, 2.22),
    "sine/gap/6/1": (8641, 0.5461, 597.2, 0.4362, 0.713),
    "saw/gap/6/1": (5761, 0.7689, 483.7, 2.021, 3.35),
    "square/gap/6/1": (7201, 0.3464, 7.116, 1.383, 5.5),
    "cascade/gap/6/1": (2881, 1.147, 12.45, 3.299, 31.9),
    "manual/gap/6/1": (8641, 0.8014, 263.5, 1.193, 6.7),
    "exceptions/gap/6/1": (14401, 1.435, 11.82, 3.421, 30.9),
    "swinging door/gap/6/1": (8641, 2.036, 439.1, 1.811, 2.53),
    "historian/gap/6/1": (1441, 1.975, 9.312, 0.5514, 7.36),
    "friction/friction/6/1": (14401, 3.291, 12.6, 5.371, 22.2),
    "gap cycle/gap/6/1": (3601, 1.202, 27.78, 10.17, 37.1),
    "perstorp/gap/6/1": (7201, 0.46, 25.91, 25, 71.3),
    "friction cycle/friction/6/1": (7201, 0.878, 3.74, 4.845, 16.5),
    "standing/gap/6/1": (7201, 1.719, 5.11, 5.51, 6.01),
    "rings/gap/6/1": (8641, 2.213, 259.6, 2.138, 16.9),
}
"""Rows, gain, lag, width and range of OP, as they were when the first fit ran."""


@pytest.mark.slow
@pytest.mark.parametrize("name", FROZEN)
def test_the_generator_is_what_it_was_when_the_first_fit_ran(name):
    truth = record(name).truth
    assert (truth.samples, truth.gain, truth.lag, truth.d, truth.op_range) == pytest.approx(FROZEN[name], rel=0.01)


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
    # The stem stands until the force has gone from one side's friction to fs of the other.
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


def a_line(name, **fit):
    fields = {"verdict": "cannot_tell", "d": None, "low": None, "high": None, "reason_code": "may_be_a_gap"} | fit
    return Line(record(name).truth, 1, {"fit": fields}, {}, None, 1.0)


def test_a_line_is_read_as_it_was_written():
    line = a_line("bends/gap/1/1", verdict="backlash", d=np.float64(5.0), low=np.nan, high=None)
    back = Line.of(line.to_json())
    assert back.truth == Line.of(back.to_json()).truth and back.key == ("bends/gap/1/1", 1)
    assert (back.fit["d"], back.fit["low"], back.fit["high"]) == (5.0, None, None)


def test_a_claim_is_read_from_the_confidence_or_in_old_files_from_the_verdict():
    line = a_line("bends/gap/1/1", verdict="at_least", d=5.0, low=2.0)
    assert line.claim() == Claim("found", None, "bound", 5.0, 2.0, None)
    assert a_line("bends/gap/1/1", verdict="sound", high=0.9).claim().confidence == "sound"
    assert a_line("bends/gap/1/1", verdict="sound", high=1.1).claim().confidence == "none_seen"
    assert a_line("bends/gap/1/1", verdict="oscillation").claim().confidence == "cannot_tell"
    new = {"confidence": "likely", "cause": "dead_band", "width_kind": "interval", "width": None, "low": None}
    line.document["answer"] = new | {"high": 6.0}
    assert line.claim() == Claim("likely", "dead_band", "interval", 5.0, 2.0, 6.0)
    line = replace(line, document={"fit": line.fit}, evidence=new | {"confidence": "found"})
    assert line.claim().confidence == "found" and not line.claim().sided


def test_a_file_goes_on_after_a_line_that_was_cut_off(tmp_path):
    path = tmp_path / "out.jsonl"
    assert done(path) == set()
    whole = a_line("bends/gap/1/1").to_json() + "\n"
    path.write_text(whole + whole[:40], encoding="utf-8")
    assert done(path) == {("bends/gap/1/1", 1)}
    assert path.read_text(encoding="utf-8") == whole


def test_the_tables_count():
    d = record("bends/gap/1/1").truth.d
    wide = {"verdict": "backlash", "d": d, "low": 0.8 * d, "high": 1.6 * d}
    sound = {"verdict": "sound", "d": 0.0, "low": 0.0, "high": 0.5}
    lines = [
        a_line("bends/none/0/1", **wide),
        a_line("bends/none/1/1", **sound),
        a_line("bends/gap/1/1", **wide),
        a_line("standing/gap/1/1", **sound),
        a_line("drift/gap/0/1"),
    ]
    text = tables(lines)
    assert "| bends | 2 | 50.0 % (1.3 to 98.7) | 50.0 % (1.3 to 98.7) | 50.0 % (1.3 to 98.7) |" in text
    assert "| found | 1 | 100.0 % (2.5 to 100.0) | 100.0 % (2.5 to 100.0) | 2.00 | 0 of 0 |" in text
    assert "| gaps wider than 1 %: called sound | 1 of 3 |" in text
    assert "| of these the gap is wider than the bound | 1 of 1 |" in text
    assert "| cannot_tell: may_be_a_gap | 1 |" in text
    assert tables([]).startswith("0 records")


def test_tasks_keep_to_their_part():
    asked = list(tasks(["steps", "perstorp"], "A", 3, 1, several=False))
    assert {int(name.split("/")[2]) for name, _ in asked} == {0, 2, 4}
    assert len(asked) == 3 * (2 + 3) and {count for _, count in asked} == {1}
    judges = list(tasks(["steps"], "C", 2, SEEDS["C"], several=False))
    assert judges == [(f"steps/{fault}/{n}/{SEEDS['C']}", 1) for n in (0, 1) for fault in ("none", "gap")]
    last = [name.split("/") for name, _ in tasks(["steps", "perstorp"], "D", 16, SEEDS["D"], several=False)]
    # All numbers have a sound valve, four of sixteen one with a gap; the first numbers of all rows come first.
    assert [int(n) for row, fault, n, _ in last if (row, fault) == ("steps", "gap")] == [0, 6, 8, 14]
    assert sum(fault in ("none", "driven") for _, fault, *_ in last) == 16 * 3
    assert [int(n) for _, _, n, _ in last] == sorted(int(n) for _, _, n, _ in last)
    days = list(tasks(["steps", "perstorp"], "B", 1, 1, several=True))
    assert days == [("steps/gap/1/1", n) for n in (1, 2, 4, 8)]


def test_a_loop_that_cannot_be_drawn_is_named_and_left_out(capsys, monkeypatch):
    # None of the loops of that number has a cycle; the first three are enough to show it.
    monkeypatch.setattr(design, "ATTEMPTS", 3)
    assert list(answers([("friction cycle/none/13/381", 1)], 1)) == []
    assert "left out, and its twins: friction cycle/13/381: no cycle in 3 loops" in capsys.readouterr().err


def test_another_day_is_the_same_valve_and_controller():
    first, other = draw("steps/gap/1/1"), draw("steps/gap/1/1/2")
    assert first.scenario.controller == other.scenario.controller and first.clearance == other.clearance
    assert 0.8 <= other.gain / first.gain <= 1.25 and other.scenario.seed != first.scenario.seed
    assert not np.array_equal(first.changes, other.changes)
    with pytest.raises(ValueError, match="without limit cycles"):
        draw("perstorp/gap/1/1/2")


def test_the_oracle_knows_the_noise():
    sound = oracle.Record("steps/none/12/1")
    # With OP as it was between the rows only white noise of variance 1 is left.
    (cost,) = oracle.known(sound, sound.true, [sound.simulation.op - sound.rest])
    assert cost.left == pytest.approx(1.0, abs=0.1)


@pytest.mark.verify
def test_the_oracle_sees_a_plain_gap_and_none_where_there_is_none():
    gap, none = oracle.Seen.of("steps/gap/12/1"), oracle.Seen.of("steps/none/12/1")
    assert gap.ratio > 50 > none.ratio
    lines = [a_line(one.name) for one in (gap, none)]
    table = oracle.table(lines, {one.name: one.ratio for one in (gap, none)})
    assert table.startswith("Of 1 gaps the oracle sees 1;") and "| all | 1 | 0.0 % (0.0 to 97.5) |" in table


@pytest.mark.verify
def test_a_fit_is_kept_with_its_evidence():
    line = ask("bends/gap/0/1")
    assert line.error is None and line.fit["verdict"] and line.seconds > 0
    assert {"candidates", "traversals", "lr_no_gap", "h"} <= set(line.evidence) and "pv" not in line.evidence
    assert Line.of(line.to_json()).claim() == Line.of(Line.of(line.to_json()).to_json()).claim()
