"""Before and after a repair: the recordings compared, their times, and how a fall of the width is seen."""

import asyncio
import json

import numpy as np
import pytest
import service

from glapp import InputError, Loop
from glapp.report.repaired import rows
from glapp.service.fits import answered
from glapp.service.proof import Proof, Repaired
from glapp.service.recordings import SignalStore
from glapp.service.repairs import compared, fall_of

BEGIN = service.BEGIN
LOOP = Loop(name="FIC0", op_span=(0, 100), controller={"k": 0.5, "ti": 5}, process={"kp": 2})
SETTINGS = LOOP.model_dump_json(exclude_unset=True)
AT = BEGIN + 3 * 3600.0


def signals(tmp_path, hours=6):
    """PV and OP swing twice as far before the repair as after it, and OP turns twice as often."""
    t = np.arange(0.0, 3600.0 * hours, 2.0)
    before = BEGIN + t < AT
    period = np.where(before, 100.0, 200.0)
    size = np.where(before, 2.0, 1.0)
    noise = np.random.default_rng(1).standard_normal(len(t))
    pv = 50.0 + size * np.sign(np.sin(2 * np.pi * t / period)) + 0.01 * noise
    op = 50.0 + size * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * t / period))
    nan = np.full(len(t), np.nan)
    rows = np.column_stack([BEGIN + t, np.full(len(t), 50.0), pv, op, np.zeros(len(t)), nan, nan])
    SignalStore(tmp_path).save({"FIC0": (np.arange(len(t), dtype=np.int64), rows)}, len(t))


@pytest.fixture
def repaired(tmp_path):
    clock = service.Clock(BEGIN + 6 * 3600.0)
    one = service.monitor(tmp_path, [LOOP], clock)
    signals(tmp_path)
    asked = Repaired(time=AT, note="new positioner")
    asyncio.run(Proof(one).repaired("FIC0", asked, "olaf", "operator"))
    yield one, tmp_path
    one.store.close()


def test_a_repair_is_noted_and_the_loop_is_fitted_anew(repaired):
    one, _ = repaired
    [row] = one.reader.repairs("FIC0")
    assert (row["time"], row["person"], row["note"]) == (AT, "olaf", "new positioner")
    assert one.reader.commands("FIC0")[0]["command"] == "repaired"
    assert one.status()["loops"]["FIC0"]["fitting"]
    again = Repaired(time=AT, note="new positioner")
    with pytest.raises(InputError, match="a repair of that time is noted already"):  # a double click noted it twice
        asyncio.run(Proof(one).repaired("FIC0", again, "olaf", "operator"))
    assert len(one.reader.repairs("FIC0")) == 1
    late = Repaired(time=one.now + 7200.0)
    with pytest.raises(InputError, match="has not come yet"):
        asyncio.run(Proof(one).repaired("FIC0", late, "olaf", "operator"))


def test_what_the_loop_gained_is_told_with_intervals(repaired):
    _, folder = repaired
    found = compared(folder, SETTINGS, AT, BEGIN + 6 * 3600.0)
    before, after = found.before, found.after
    assert before.deviation[0] == pytest.approx(2.0, rel=0.01)
    assert after.deviation[0] == pytest.approx(1.0, rel=0.01)
    assert before.reversals[0] == pytest.approx(2 * 864, rel=0.05)
    assert after.reversals[0] == pytest.approx(864, rel=0.05)
    assert before.travel[0] == pytest.approx(864 * 8.0, rel=0.05)
    assert before.deviation[1] <= before.deviation[0] <= before.deviation[2]
    assert after.deviation[2] < before.deviation[1]
    assert (before.verdict, after.verdict, found.width) == (None, None, None)
    assert (found.deviation.code, found.reversals.code) == ("less", "less")
    assert found.deviation.by[1] < -1.0 < found.deviation.by[2]
    table = rows(found, "%", "bar")
    assert table[0] == ("Gap", "not judged", "not judged", "–")
    assert table[1][1].startswith("2\N{NO-BREAK SPACE}bar (")
    assert table[1][3].startswith("less by 1\N{NO-BREAK SPACE}bar (")


def test_widths_are_those_of_before_and_after(repaired):
    one, folder = repaired
    from glapp.fit import Fit

    wide = service.answered(Fit("backlash", "", "%", 2.0, 1.8, 2.2, lr_no_gap=90.0, lr_needed=15.0), LOOP)
    none = service.answered(Fit("sound", "", "%", 0.0, 0.0, 0.4, lr_no_gap=0.0, lr_needed=15.0), LOOP)
    mixed = service.answered(Fit("backlash", "", "%", 9.0, 8.0, 10.0, lr_no_gap=90.0, lr_needed=15.0), LOOP)
    for row, begin, end in ((wide, BEGIN, AT), (mixed, BEGIN, AT + 3600.0), (none, AT, AT + 3600.0)):
        one.store.add_answer("FIC0", {"time": end, "asked_by": "eve"} | row | {"t_begin": begin, "t_end": end})
    found = compared(folder, SETTINGS, AT, BEGIN + 6 * 3600.0)
    assert found.before.d == 2.0, "a fit over both sides of the repair is neither"
    assert found.after.verdict == "sound"
    assert rows(found, "%", "")[0] == (
        "Gap",
        "2\N{NO-BREAK SPACE}%OP (1.80 to 2.20)",
        "< 0.400\N{NO-BREAK SPACE}%OP",
        "less by 2\N{NO-BREAK SPACE}%OP (1.55 to 2.20)",
    )
    bound = service.answered(Fit("at_least", "", "%", 1.8, 1.8, None, lr_no_gap=90.0, lr_needed=15.0), LOOP)
    one.store.add_answer("FIC0", {"time": AT + 7200.0, "asked_by": "eve"} | bound | {"t_begin": BEGIN, "t_end": AT})
    found = compared(folder, SETTINGS, AT, BEGIN + 6 * 3600.0)
    assert rows(found, "%", "")[0][1] == "> 1.80\N{NO-BREAK SPACE}%OP"


def test_a_fit_looks_at_nothing_from_before_the_repair(repaired):
    _, folder = repaired
    row = answered(folder, SETTINGS, BEGIN, BEGIN + 6 * 3600.0)
    assert row["t_begin"] == AT
    document = json.loads(row["document"])["analysis"]["loops"][0]
    assert document["file"].startswith("FIC0 of 2026-11-")


def day(number, d, verdict="backlash", half=0.2, **more):
    limits = {"low": max(d - half, 0.0), "high": d + half}
    return {"t0": f"2026-11-{number:02}T00:00:00+00:00", "left_out": None, "verdict": verdict, "d": d, **limits, **more}


def test_a_fall_is_seen_between_two_days_and_what_does_not_count_is_left_out():
    days = [day(20, 2.0), day(21, 2.1), day(22, 0.0, "sound"), day(23, 0.1)]
    found = fall_of(days)
    assert (found["t"][1] - found["t"][0]) == 86400.0
    assert found["before"][1] > found["after"][2]
    assert fall_of(days[:2]) is None
    assert fall_of([*days[:2], day(22, 0.1, left_out="repeats another")]) is None
    assert fall_of([day(20, 2.0, high=None), day(21, 0.1)]) is None
    assert fall_of([]) is None
