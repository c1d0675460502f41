"""The guided step test: its texts at each place, its end, and its decision."""

import asyncio
import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import service

import glapp
from glapp import InputError, Loop
from glapp.service.fits import answered
from glapp.service.guide import FIRST, Asked, guide, read_test, result_text
from glapp.service.guided import GuidedTests
from glapp.service.recordings import table_of
from glapp.service.signal import Signal, Value
from glapp.simulate import Gaussian, closed_loop

BEGIN = service.BEGIN
HOLD = 120.0
ASKED = Asked(1.0, (0.0, 2.0, 4.0, 2.0), HOLD, (40.0, 60.0), (30.0, 50.0), 60.0)
LOOP = Loop(name="FIC0", op_span=(0, 100))
AUTO = 60
"""Seconds in automatic before the test."""


def recorded(moves=(50.0, 52.0, 54.0, 52.0), *, d=1.0, noise=0.02, until=None, seed=1, hold=HOLD):
    """Rows of a test whose OP goes these ways, as the service keeps them."""
    begins = [AUTO + i * hold for i in range(len(moves))]
    manual = [(0.0, AUTO, moves[0]), *((at, at + hold, op) for at, op in zip(begins, moves, strict=True))]
    made = closed_loop(
        ([0.8], [8.0, 1.0], 2.0),
        (0.5, 20.0),
        d=d,
        noise=Gaussian(sigma=noise),
        h=1.0,
        t_end=AUTO + hold * len(moves),
        manual=manual,
        seed=seed,
    )
    rows = slice(0, None if until is None else int(until))
    flags = np.where(made.t < AUTO, 0.0, 1.0)
    nan = np.full(len(made.t), np.nan)
    return table_of(np.column_stack([BEGIN + made.t, nan, made.pv, made.op, flags, nan, nan])[rows])


def told(until, **more):
    """The guide when so many seconds are recorded."""
    return guide(ASKED, recorded(until=until, **more), LOOP, BEGIN, BEGIN + until)


def test_each_move_is_told_and_waited_for():
    assert told(30).text == "Put the controller in manual while the load is calm."
    first = told(AUTO + 20)
    assert (first.move, first.levels) == (0, (50.0, 52.0, 54.0, 52.0))
    assert first.text == "Leave OP at 50\N{NO-BREAK SPACE}%: PV settles."
    assert first.until == pytest.approx(BEGIN + AUTO + FIRST * HOLD)
    assert told(AUTO + 0.9 * HOLD).text == "Move OP up to 52\N{NO-BREAK SPACE}%, in one step."
    second = told(AUTO + 1.2 * HOLD)
    assert (second.move, second.until) == (1, pytest.approx(BEGIN + AUTO + 2 * HOLD, abs=1.5))
    late = guide(ASKED, recorded(until=AUTO + 1.99 * HOLD), LOOP, BEGIN, BEGIN + AUTO + 2.1 * HOLD)
    assert late.text == "Move OP up to 54\N{NO-BREAK SPACE}%, in one step."
    assert told(AUTO + 3.02 * HOLD).text == "Leave OP at 52\N{NO-BREAK SPACE}%: PV settles."


@pytest.mark.parametrize(("d", "found"), [(1.0, "gap"), (0.0, "no_gap")])
def test_the_test_ends_as_soon_as_it_has_decided(d, found):
    ends = [at for at in range(int(AUTO + 3 * HOLD), int(AUTO + 4 * HOLD), 5) if told(at, d=d).outcome == "decided"]
    assert ends, "it decides before its end"
    assert ends[0] < AUTO + 3.9 * HOLD
    decided = told(ends[0], d=d)
    assert decided.found == found
    assert decided.text.startswith("The test has decided. Put OP back to 50")
    assert (decided.begins, decided.ends) == (BEGIN + AUTO, pytest.approx(BEGIN + ends[0] - 1))
    assert (decided.low > 0.2) if d else (decided.high < 0.8)
    said = result_text(asdict(decided), ASKED, "%")
    assert said.startswith("There is a gap: " if d else "There is no gap of 1\N{NO-BREAK SPACE}%: it is ")


def test_noise_that_hides_the_gap_leaves_it_open_at_the_end():
    over = guide(ASKED, recorded(noise=2.0), LOOP, BEGIN, BEGIN + AUTO + 4 * HOLD + 1)
    assert (over.outcome, over.found) == ("over", None)
    assert result_text(asdict(over), ASKED, "%").startswith("The test has not decided")


def test_the_test_ends_where_a_limit_is_near():
    near = replace(ASKED, pv_within=(30.0, 43.2))
    table = recorded(until=AUTO + 2.9 * HOLD)
    ended = guide(near, table, LOOP, BEGIN, BEGIN + AUTO + 2.9 * HOLD)
    assert ended.outcome == "limit"
    assert "PV is 42." in ended.text and "its limit is 43.2" in ended.text and "Put OP back to 50" in ended.text
    assert guide(near, recorded(until=AUTO + 1.5 * HOLD), LOOP, BEGIN, BEGIN + AUTO + 1.5 * HOLD).outcome is None
    wrong = guide(replace(ASKED, op_within=(40.0, 53.0)), table, LOOP, BEGIN, BEGIN + AUTO + 2.9 * HOLD)
    assert wrong.outcome == "limit" and wrong.text.startswith("OP is 54")


def test_op_elsewhere_silence_time_and_automatic_are_told():
    astray = told(AUTO + 1.5 * HOLD, moves=(50.0, 51.0, 54.0, 52.0))
    assert astray.move == 0
    assert astray.text == "Move OP up to 52\N{NO-BREAK SPACE}%, in one step."
    beyond = guide(
        ASKED, recorded((50.0, 52.0, 53.0, 52.0), until=AUTO + 2.2 * HOLD), LOOP, BEGIN, BEGIN + AUTO + 1.9 * HOLD
    )
    assert beyond.text.startswith("OP is 53") and "put it back to 52" in beyond.text
    table = recorded(until=AUTO + HOLD / 4)
    assert "No value has come for 2 min" in guide(ASKED, table, LOOP, BEGIN, BEGIN + AUTO + HOLD / 4 + 120).text
    assert guide(ASKED, table, LOOP, BEGIN, BEGIN + 2000).outcome == "silent"
    slow = replace(ASKED, minutes=3.0)
    assert guide(slow, recorded(until=AUTO + 2.9 * HOLD), LOOP, BEGIN, BEGIN + AUTO + 2.9 * HOLD).outcome == "time"
    assert guide(ASKED, recorded(until=30), LOOP, BEGIN, BEGIN + 1000).outcome == "automatic"


def test_samples_of_the_service_are_read_as_those_of_a_file():
    table = recorded()
    read = read_test(table, LOOP, 1.0)
    assert read.d == pytest.approx(1.0, abs=0.1)
    assert read_test(recorded(until=30), LOOP, 1.0) is None


def plan_of(asked):
    """A plan as it is stored."""
    test = {
        "kind": "by_hand", "reason": None, "moves": [50.0 + move for move in asked.moves], "hold": asked.hold,
        "minutes": 6.0, "op": [50.0, 54.0], "pv": [39.0, 44.0], "power": 0.97, "with_gap": 0.97, "without": 1.0,
        "false": 0.0, "simulations": 64,
    }  # fmt: skip
    return {
        "name": "FIC0", "source": "", "unit": "%", "pv_unit": "PV unit", "width": asked.width, "reason": None,
        "op_within": asked.op_within, "pv_within": asked.pv_within, "within": asked.minutes, "tests": [test],
    }  # fmt: skip


def watched(tmp_path, mode=True):
    clock = service.Clock()
    one = service.monitor(tmp_path, [LOOP], clock)
    if mode:
        service.fed(one, clock, [Value("FIC0", Signal.MODE, BEGIN, 1.0, True)])
    return one, clock


def stored_plan(one, document=None):
    one.store.ask_plan("FIC0", BEGIN, "eve", {})
    [row] = one.reader.plans_waiting()
    one.store.keep_plan(row["id"], document or plan_of(ASKED), None)


def values_of(table):
    found = []
    for row in table.to_pylist():
        at = row["time"].timestamp()
        found += [
            Value("FIC0", Signal.MODE, at, float(row["MODE"] == "AUTO"), True),
            Value("FIC0", Signal.SP, at, 40.0, True),
            Value("FIC0", Signal.OP, at, row["OP"], True),
            Value("FIC0", Signal.PV, at, row["PV"], True),
        ]
    return found


@pytest.mark.parametrize("d", [1.0, 2.1])
def test_a_test_is_stored_goes_on_after_a_restart_and_makes_the_answer(tmp_path, d):
    """A gap wider than the reversal has a lower limit alone. Regression: the test had decided, and the answer not."""
    one, clock = watched(tmp_path)
    with pytest.raises(InputError, match="no test is planned"):
        asyncio.run(GuidedTests(one).begin("FIC0", "olaf", "operator"))
    stored_plan(one)
    begin = clock.now
    tests = GuidedTests(one)
    asyncio.run(tests.begin("FIC0", "olaf", "operator"))
    with pytest.raises(InputError, match="goes on"):
        asyncio.run(tests.begin("FIC0", "olaf", "operator"))
    shifted = [replace(value, time=value.time + begin - BEGIN) for value in values_of(recorded(d=d))]
    service.fed(one, clock, [value for value in shifted if value.time < begin + AUTO + 100])
    [row] = tests.going_on()
    asyncio.run(tests._look(row))
    assert one.reader.guided_test("FIC0")["state"]["text"].startswith("Move OP up to 52")
    service.fed(one, clock, [value for value in shifted if value.time >= begin + AUTO + 100])
    asyncio.run(one.save())
    one.store.close()

    again = service.monitor(tmp_path, [LOOP], clock)
    tests = GuidedTests(again)
    [row] = tests.going_on()
    asyncio.run(tests._look(row))
    ended = again.reader.guided_test("FIC0")
    assert (ended["state"]["outcome"], ended["state"]["found"]) == ("decided", "gap")
    assert tests.going_on() == []
    assert again.status()["loops"]["FIC0"]["fitting"], "the answer is to take the test in"
    asyncio.run(again.save())
    row = answered(tmp_path, LOOP.model_dump_json(exclude_unset=True), BEGIN - 1, clock.now)
    answer = json.loads(row["document"])["analysis"]["loops"][0]["answer"]
    assert answer["step_test"]["decided"] == "gap"
    assert answer["confidence"] == "found"
    if d == 1.0:
        assert answer["low"] <= d <= answer["high"]
        assert "A step test made for this question shows a dead band of" in row["reason"]
    else:
        assert (answer["verdict"], answer["high"]) == ("at_least", None) and 1.5 < answer["low"] <= d
        assert "A step test made for this question shows a dead band of at least" in row["reason"]
        assert answer["so"].startswith("The valve of FIC0 has a dead band of at least 1.")
    again.store.close()


def test_a_test_that_nobody_could_follow_is_refused_and_one_can_be_stopped(tmp_path):
    one, clock = watched(tmp_path, mode=False)
    stored_plan(one)
    with pytest.raises(InputError, match="its mode does not come from the plant"):
        asyncio.run(GuidedTests(one).begin("FIC0", "olaf", "operator"))
    service.fed(one, clock, [Value("FIC0", Signal.MODE, BEGIN, 1.0, True)])
    tests = GuidedTests(one)
    asyncio.run(tests.begin("FIC0", "olaf", "operator"))
    asyncio.run(tests.stop("FIC0", "eve", "engineer"))
    found = one.reader.guided_test("FIC0")
    assert found["ended"] is not None
    assert found["state"]["text"] == "eve stopped the test. Put the controller in automatic."
    with pytest.raises(InputError, match="no guided test of it goes on"):
        asyncio.run(tests.stop("FIC0", "eve", "engineer"))
    assert [row["command"] for row in one.reader.commands("FIC0")] == ["guided_test_stopped", "guided_test"]
    one.store.close()


def test_a_plan_without_a_test_by_hand_begins_nothing(tmp_path):
    one, _ = watched(tmp_path)
    told = plan_of(ASKED)
    told["tests"][0] |= {"power": None, "reason": "the process integrates"}
    stored_plan(one, told)
    with pytest.raises(InputError, match="no test with OP by hand can be proposed: the process integrates"):
        asyncio.run(GuidedTests(one).begin("FIC0", "olaf", "operator"))
    one.store.close()


def test_the_step_test_of_the_window_reads_what_the_guide_reads():
    read = read_test(recorded(), LOOP)
    assert isinstance(read, glapp.StepTest)
    assert read.asked is None
