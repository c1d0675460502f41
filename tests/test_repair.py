"""Before and after a repair in the answer: noted by a person, or seen as a fall of the width between recordings."""

import json
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest
from typer.testing import CliRunner

import glapp
from glapp.cli import app
from glapp.errors import InputError
from glapp.fit import Window
from glapp.reading.settings import read_settings, write_settings
from glapp.repair import fall_of, with_repair
from glapp.repair_split import moment_in, since_repair, until_repair
from glapp.report.html import write_report
from glapp.several_recordings import analyze_recordings

HOURS = 3
AT = "2026-03-01 13:00"
"""The valve is repaired in the middle of the recording."""


def day(d, seed, hours=HOURS):
    """Hours of a flow loop whose setpoint steps every quarter of an hour."""
    steps = [(900.0 * i, float(i % 2)) for i in range(4 * hours)]
    return glapp.simulate.closed_loop(
        ([0.8], [20, 1], 5), (0.5, 20), d=d, setpoint=steps, noise=0.05, h=2.0, t_end=3600 * hours, seed=seed
    )


def written(path, *days, start="2026-03-01T10:00:00"):
    """The days one after the other, each without its last row, as a CSV file."""
    signals = {name: np.concatenate([getattr(one, name)[:-1] for one in days]) for name in ("sp", "pv", "op")}
    t = np.datetime64(start) + np.arange(len(signals["pv"])) * np.timedelta64(2, "s")
    rows = zip(np.datetime_as_string(t, unit="s"), *signals.values(), strict=True)
    text = "\n".join(f"{at.replace('T', ' ')},{sp:.6f},{pv:.6f},{op:.6f}" for at, sp, pv, op in rows)
    path.write_text(f"Time,SP,PV,OP\n{text}\n")
    return path


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return written(tmp_path_factory.mktemp("repair") / "FIC101.csv", day(2.0, 1), day(0.0, 2))


def answer_of(*arguments):
    done = CliRunner().invoke(app, ["analyze", *map(str, arguments), "--json"])
    return done, json.loads(done.stdout)["loops"][0]


def test_a_noted_repair_gives_the_answer_of_after_and_compares_it_with_before(file, tmp_path):
    report = tmp_path / "report.html"
    done, loop = answer_of(file, "--op-span", "-50", "50", "--repaired", AT, "--report", report)
    assert done.exit_code == 0, done.stderr
    assert loop["answer"]["valve"] == "no_gap"
    repair = loop["repair"]
    assert repair["noted"] == "2026-03-01T13:00:00"
    before, after = repair["before"], repair["after"]
    assert before["low"] < 2.0 < before["high"] and before["verdict"] == "backlash"
    assert after["verdict"] == "sound"
    assert (before["begin"], before["end"] < "2026-03-01T13:00:00") == ("2026-03-01T10:00:00", True)
    assert after["begin"] >= "2026-03-01T13:00:00"
    assert repair["width"]["code"] == "less" and repair["width"]["by"][2] < -1.0
    for name in ("deviation", "travel", "reversals"):
        for side in (before, after):
            middle, low, high = side[name]
            assert low <= middle <= high
        difference = repair[name]["by"]
        assert difference[0] == pytest.approx(after[name][0] - before[name][0])
        assert difference[1] < difference[0] < difference[2]
    page = report.read_text("utf-8")
    assert "Before and after the repair" in page and "repaired on 2026-03-01 at 13:00" in page
    assert "less by" in page


def test_what_was_recorded_before_does_not_touch_the_answer(file, tmp_path):
    loop = glapp.Loop(name="FIC101", op_span=(-50, 50), repaired=datetime(2026, 3, 1, 13))
    [whole] = glapp.open_recordings(file, [loop])
    [alone] = glapp.open_recordings(
        written(tmp_path / "after.csv", day(0.0, 2), start="2026-03-01T13:00:00"), [loop.model_copy()]
    )
    assert glapp.fit(whole).high == pytest.approx(glapp.fit(alone).high, rel=1e-6)
    assert glapp.analyze(whole, fit=False).total_half_periods == glapp.analyze(alone, fit=False).total_half_periods
    assert glapp.identify(whole).samples == glapp.identify(alone).samples
    [before], [after] = until_repair([whole]), since_repair([whole])
    assert sum(len(b) for one in (before, after) for b in one.batches()) == sum(len(b) for b in whole.batches())
    assert before.loop.repaired is None, "it is cut once"


def test_a_fall_between_recordings_is_seen_and_asks_for_the_time(tmp_path):
    days = [
        written(tmp_path / f"{i}.csv", day(d, i), start=f"2026-03-0{i}T10:00:00")
        for i, d in ((1, 2.0), (2, 2.0), (3, 0.4), (4, 0.4))
    ]
    opened = [glapp.open_recordings(one, [glapp.Loop(name="FIC101", op_span=(-50, 50))])[0] for one in days]
    result = with_repair(opened, analyze_recordings(opened))
    repair = result.repair
    assert repair is not None and repair.noted is None
    assert (repair.before.end.day, repair.after.begin.day) == (2, 3)
    assert repair.before.low < 2.0 < repair.before.high
    assert repair.width.code == "less"
    page = tmp_path / "report.html"
    write_report([result], page)
    assert "Was the valve repaired?" in page.read_text("utf-8")
    steady = with_repair(opened[:2], analyze_recordings(opened[:2]))
    assert steady.repair is None


def test_a_fall_between_the_windows_of_one_recording_is_seen(file):
    [whole] = glapp.open_recordings(file, [glapp.Loop(name="FIC101", op_span=(-50, 50))])
    result = glapp.analyze(whole)

    def window(begin, end, d):
        return Window(begin, end, "backlash", d, d - 0.1, d + 0.1, 90.0)

    windows = [window(0.0, 5000.0, 2.0), window(5000.0, 10_790.0, 2.0), window(10_810.0, 21_000.0, 0.2)]
    repair = with_repair([whole], replace(result, fit=replace(result.fit, windows=windows))).repair
    assert repair.before.end == datetime(2026, 3, 1, 12, 59, 48)
    assert repair.after.begin == datetime(2026, 3, 1, 13, 0, 10)
    assert (repair.before.d, repair.after.d) == (pytest.approx(2.0), pytest.approx(0.2))
    assert with_repair([whole], replace(result, fit=replace(result.fit, windows=windows[:2]))).repair is None


def test_a_limit_that_is_not_finite_is_none():
    wide = {"t": 0.0, "verdict": "backlash", "d": 2.0, "low": 1.9, "high": 2.1}
    odd = {"t": 1.0, "verdict": "backlash", "d": 0.1, "low": 0.0, "high": float("inf")}
    assert fall_of([wide, odd, odd | {"high": float("nan")}, odd | {"verdict": "no_estimate", "high": 0.2}]) is None
    assert fall_of([wide, odd | {"high": 0.2}])["t"] == [0.0, 1.0]


def test_a_repair_without_recordings_around_it_is_refused_with_the_reason(file):
    done, loop = answer_of(file, "--repaired", "2026-03-02 10:00")
    assert done.exit_code == 1 and loop["repair"] is None
    assert "nothing was recorded after it" in loop["reason"]
    _, loop = answer_of(file, "--op-span", "-50", "50", "--repaired", "2026-02-01")
    assert loop["repair"]["before"]["begin"] is None and loop["repair"]["width"] is None
    plain = glapp.recording_from(day(0.0, 2, 1).to_arrow(), glapp.Loop(name="F", repaired=datetime(2026, 3, 1)))
    with pytest.raises(InputError, match="have no date"):
        glapp.analyze(plain)
    with pytest.raises(InputError, match="have no zone"):
        zoned = datetime.fromisoformat("2026-03-01T13:00+01:00")
        moment_in(glapp.open_recordings(file)[0], zoned)
    wrong = CliRunner().invoke(app, ["analyze", str(file), "--repaired", "soon"])
    assert "--repaired: is 'soon'" in str(wrong.exception)


def test_the_time_of_a_repair_stands_in_a_loops_toml(file, tmp_path):
    toml = tmp_path / "loops.toml"
    toml.write_text(f'[loops.FIC101]\nfile = "{file.as_posix()}"\nrepaired = 2026-03-01T13:00:00\n')
    [loop] = read_settings(toml)
    assert loop.repaired == datetime(2026, 3, 1, 13)
    assert "repaired = 2026-03-01T13:00:00" in write_settings([loop])
