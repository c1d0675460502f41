"""The page of a step test: its numbers beside those of the simulated valve."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from typer.testing import CliRunner

from glapp import Loop, recording_from, step_test
from glapp.cli import app
from glapp.report.form import form_page, judged
from glapp.simulate import Gaussian, Valve, closed_loop

TWO_UP_TWO_DOWN = (50.0, 54.0, 58.0, 54.0, 50.0, 54.0)
TRUE_GAP, LAG, DEAD, GAIN = 1.6, 6.0, 4.0, 0.8


def made(*, plant=([GAIN], [LAG, 1.0], DEAD), d=TRUE_GAP, noise=0.02, valve=None, levels=TWO_UP_TWO_DOWN, hold=120.0):
    return closed_loop(
        plant,
        (0.5, 10.0),
        d=d,
        valve=valve,
        noise=Gaussian(sigma=noise),
        h=0.5,
        t_end=hold * len(levels),
        manual=[(i * hold, (i + 1) * hold + (i == len(levels) - 1), op) for i, op in enumerate(levels)],
        setpoint=[(0.0, 40.0)],
    )


def read(simulation, position=False, **loop):
    table = simulation.to_arrow()
    if not position:
        table = table.drop_columns(["POSITION"])
    loop = Loop(name="FIC402", op_span=(0, 100), **loop)
    return step_test(recording_from(table, loop)), loop


def text_of(page):
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", page)))


def cells(page, term):
    row = re.search(rf"<td>{re.escape(term)}</td>(.*?)</tr>", page, re.S)
    assert row is not None
    return [unescape(cell) for cell in re.findall(r"<td>(.*?)</td>", row[1], re.S)]


def first_number(text):
    return float(re.search(r"[\d.]+", text)[0])


def test_t86_of_pv_is_dead_time_and_twice_the_lag():
    test, loop = read(made())
    times = [one.t86 for one in test.readings if one.t86 is not None]
    assert len(times) == 4  # the first move tells nothing
    assert times == pytest.approx([DEAD + 2 * LAG] * 4, abs=1.0)
    page = form_page([judged(test, loop)])
    [cells_of_t86] = cells(page, "Step response time T86")
    assert first_number(cells_of_t86) == pytest.approx(DEAD + 2 * LAG, abs=0.5)


def test_t86_of_the_travel_is_the_valves_own():
    test, loop = read(made(valve=Valve(lag=3.0)), position=True)
    travel, through_pv = cells(form_page([judged(test, loop)]), "Step response time T86")
    assert first_number(travel) == pytest.approx(6.0, abs=0.6)  # twice the actuator's lag
    assert first_number(through_pv) > first_number(travel) + DEAD


def test_dead_band_resolution_and_gain_are_those_of_the_valve():
    test, loop = read(made(levels=(50.0, 54.0, 58.0, 58.5, 54.0, 50.0, 54.0, 58.0)))
    page = form_page([judged(test, loop)])
    [dead_band] = cells(page, "Dead band")
    assert first_number(dead_band) == pytest.approx(TRUE_GAP, abs=0.05)
    assert test.low < TRUE_GAP < test.high
    assert test.resolution == pytest.approx(0.5)
    assert cells(page, "Resolution") == ["0.500\u00a0%OP or finer"]
    assert first_number(cells(page, "Gain")[0]) == pytest.approx(GAIN, abs=0.02)


def test_overshoot_is_that_of_the_process():
    # Damping 0.5: exp(−π·0.5/√0.75) = 16.3 %.
    test, loop = read(made(plant=([GAIN], [25.0, 5.0, 1.0], 0.0)))
    shares = [one.overshoot for one in test.readings if one.overshoot is not None]
    assert np.median(shares) == pytest.approx(0.163, abs=0.02)
    assert "% of the step" in cells(form_page([judged(test, loop)]), "Overshoot")[0]
    calm, loop = read(made())
    assert cells(form_page([judged(calm, loop)]), "Overshoot") == ["none beyond the noise"]


@pytest.mark.parametrize(
    ("d", "loop", "allowed", "verdict", "origin"),
    [
        (TRUE_GAP, {}, None, "Fail", "EnTech's nominal value"),
        (TRUE_GAP, {"acceptable_dead_band": 3.0}, None, "Pass", "given for this loop"),
        (TRUE_GAP, {"acceptable_dead_band": 3.0}, 1.0, "Fail", "given for this test"),
        (TRUE_GAP, {}, TRUE_GAP, "Not decided", "given for this test"),
        (0.0, {}, None, "Pass", "EnTech's nominal value"),
    ],
)
def test_pass_or_fail(d, loop, allowed, verdict, origin):
    test, loop = read(made(d=d), **loop)
    text = text_of(form_page([judged(test, loop, allowed)]))
    assert f"{verdict} Dead band by PV" in text
    assert origin in text


def test_the_span_makes_the_percentage():
    table = made().to_arrow().drop_columns(["POSITION"])
    loop = Loop(name="FIC402", op_span=(0, 200))
    test = step_test(recording_from(table, loop))
    one = judged(test, loop)
    assert (one.low, one.high) == pytest.approx((test.low / 2, test.high / 2))
    assert one.verdict == "pass"  # 0.8 % of span


def test_the_sequence_has_every_move():
    test, loop = read(made())
    page = form_page([judged(test, loop)])
    assert "54 → 58" in page
    assert page.count("reversed") == 2
    rows = re.findall(r"<tr>(<td>\d+</td>.*?)</tr>", page, re.S)
    assert len(rows) == len(test.readings) == 5
    assert "<svg" in page and "<script" not in page


def test_a_test_without_a_width_says_why():
    test, loop = read(made(levels=(50.0, 54.0, 58.0)))
    text = text_of(form_page([judged(test, loop)]))
    assert "Not decided" in text
    assert "never reverses" in text


@pytest.mark.slow
def test_the_command_writes_the_page(tmp_path):
    file, page = tmp_path / "FIC402.csv", tmp_path / "form.html"
    made().write_csv(file)
    asked = ["step-test", str(file), "--op-span", "0", "100", "--page", str(page)]
    invoked = CliRunner().invoke(app, asked)
    assert invoked.exit_code == 0, invoked.output
    assert "Fail" in text_of(page.read_text(encoding="utf-8"))
    assert CliRunner().invoke(app, [*asked, "--allowed", "3"]).exit_code == 0
    assert "Pass" in text_of(page.read_text(encoding="utf-8"))
    wrong = CliRunner().invoke(app, [*asked, "--allowed", "0"])
    assert wrong.exit_code != 0
    names = CliRunner().invoke(app, ["step-test", str(file), "--allowed", "3"])
    assert names.exit_code != 0


def test_names_from_outside_are_escaped():
    test, loop = read(made())
    page = form_page([judged(replace(test, name="<b>&\x1b"), loop)])
    assert "<b>" not in page
    assert "\x1b" not in page
