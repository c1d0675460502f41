"""The operator's window without a browser: its content, its requests to the service, its refusals."""

import asyncio
import json
import math
import re
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

pytest.importorskip("nicegui")
pytest.importorskip("multipart")

import httpx
import service
from fastapi import FastAPI, WebSocket, WebSocketDisconnect
from fastapi.testclient import TestClient
from service import loops, values
from station_child import PASSWORDS, answer, made
from typer.testing import CliRunner

from glapp import Loop
from glapp import plan as plan_module
from glapp.cli import app as cli
from glapp.errors import InputError
from glapp.fit import Fit
from glapp.modules import BacklashDetection, Graph, Input, Output
from glapp.planned import OPEN
from glapp.reading.settings import parse_settings
from glapp.report.words import REASONS, failures
from glapp.result import Confidence
from glapp.service.api import app_of as service_app
from glapp.service.compensation import TEXT_OF_STATE, detection_beside
from glapp.service.monitor import Monitor
from glapp.service.plant import SimLoop, SimPlant
from glapp.service.plant import _kinds as kinds
from glapp.service.settable import SHARE
from glapp.service.signal import Signal
from glapp.service.store import Store
from glapp.service.users import LOGIN_LASTS
from glapp.station import charts, proof_page, step_test
from glapp.station.app import app_of
from glapp.station.client import ApiClient, Gone, Refused, Unsure, loop_path
from glapp.station.compensate import calm, plan
from glapp.station.pages import Station, all_events
from glapp.station.parameters import changed, field
from glapp.station.sessions import COOKIE, LARGEST, LARGEST_FILE, Guard, Sessions
from glapp.station.signals_page import state_of
from glapp.station.under_way import UnderWay
from glapp.station.view import View, _through, as_csv, trend

CATALOGUE = json.loads((Path(__file__).parents[1] / "vectors" / "catalogue.json").read_text())


@pytest.fixture(scope="session")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Monitor, FastAPI]]:
    """A service; nothing is stepped any more."""
    monitor, users = made(tmp_path_factory.mktemp("plant"))
    monitor.users = users
    yield monitor, service_app(monitor, users)
    monitor.store.close()


@pytest.fixture
def view(plant: tuple[Monitor, FastAPI]) -> View:
    monitor, _ = plant
    monitor.store.show(time.time(), json.dumps(monitor.status()))
    found = View(monitor.store.folder)
    found.refresh()
    for loop in found.shown["loops"].values():  # the plant may have been made long ago
        loop["seen"] = time.time() if loop["seen"] is not None else None
    return found


def client_of(app: FastAPI, folder: Path) -> ApiClient:
    """The station's way to a service that is in this process."""
    api = ApiClient(folder, "http://127.0.0.1")
    api._http = httpx.AsyncClient(transport=httpx.ASGITransport(app=app))
    return api


# Shown values


@pytest.mark.slow
def test_what_maintenance_should_do_first_comes_first(view: View) -> None:
    rows = view.rows()
    assert [(row.loop, row.soon) for row in rows] == [("FIC0", "Now"), ("FIC2", "Signal"), ("FIC1", "Signal")]
    first = rows[0]
    assert first.width == "2.40 % (2.15 to 3.11)" and first.percent == 2.4 and first.verdict == "Backlash"
    assert first.todo == "Look at the valve." and first.health == "Maintenance required"
    assert rows[2].width == "< 0.400 %" and rows[2].seen == "never" and rows[2].health == "Check function"
    assert "no value comes" in rows[1].todo


def test_what_persons_have_set_counts(plant: tuple[Monitor, FastAPI], view: View) -> None:
    monitor, _ = plant
    asyncio.run(monitor.commands.change("FIC2", {"acceptable_dead_band": 1.5}, "eve", "engineer"))
    monitor.store.show(time.time(), json.dumps(monitor.status()))
    view.refresh()
    assert view.loops["FIC2"].acceptable_dead_band == 1.5 and view.loops["FIC1"].acceptable_dead_band is None


def test_a_bad_pv_is_told(view: View) -> None:
    loop = view.shown["loops"]["FIC0"]
    loop |= {"good": False, "note": "BadSensorFailure", "health": "CHECK_FUNCTION"}
    row = next(row for row in view.rows() if row.loop == "FIC0")
    assert row.soon == "Signal" and "BadSensorFailure" in row.seen and row.health == "Check function"
    assert row.todo == "Look at the transmitter: PV is bad (BadSensorFailure)."
    loop["note"] = "its time stamp is 3600 s ahead of this computer's clock"
    assert view.todo("FIC0").startswith("Set the clocks of plant and service: PV is bad (its time stamp is")


def test_manual_and_a_limit_are_told() -> None:
    """Regression: nothing on a loop's page said that its controller was in manual."""
    auto = {name: {"value": x, "good": True, "note": ""} for name, x in (("mode", 1.0), ("low", 0.0), ("high", 0.0))}
    assert state_of(auto) == "" == state_of({})
    assert state_of(auto | {"mode": auto["low"]}) == "The controller is in manual."
    assert state_of(auto | {"low": auto["mode"]}) == "OP is at its low limit."
    bad = {"value": None, "good": False, "note": "BadCommunicationError"}
    assert state_of(auto | {"mode": bad}) == "MODE is bad: BadCommunicationError."


def test_a_compensation_of_a_service_that_is_gone_is_not_known(view: View) -> None:
    """Regression: "on, waiting" stayed in the overview, and u_FF was long taken away by the plant's watchdog."""
    view.shown["loops"]["FIC0"]["compensation"] = {"enabled": True, "standing": "waiting", "withdrawn": None}
    assert view.behind is None and view.rows()[0].compensation == "on, waiting"
    view._clock = lambda: time.time() + 60.0
    assert view.behind is not None and view.rows()[0].compensation == "not known"


@pytest.mark.slow
def test_a_loop_that_is_sampled_seldom_is_not_silent(view: View) -> None:
    assert view.at is not None
    loop = view.shown["loops"]["FIC0"]
    for seen, heard, sample, silent in (
        (30.0, None, None, False),
        (90.0, None, None, True),
        (90.0, 5.0, None, False),
        (700.0, 5.0, None, True),
        (900.0, 300.0, 200.0, False),
        (1100.0, 5.0, 200.0, True),
    ):
        loop |= {"seen": view.at - seen, "heard": None if heard is None else view.at - heard}
        view.loops["FIC0"] = loops()[0].model_copy(update={"sample_time": sample})
        assert view.silent("FIC0") is silent, (seen, heard, sample)
    assert view.silent("not watched any more")


def test_no_loop_of_a_plant_that_catches_up_is_silent(view: View) -> None:
    """Each sent people to its transmitter: values of hours come at once, and minutes of the plant's time apart."""
    assert view.at is not None
    view.shown["loops"]["FIC0"] |= {"seen": view.at - 700.0, "heard": None, "good": True}
    assert view.silent("FIC0")
    view.shown["behind"] = {"seconds": 1e6, "left": 60.0}
    row = next(row for row in view.rows() if row.loop == "FIC0")
    assert not view.silent("FIC0") and row.soon != "Signal" and "transmitter" not in row.todo


def test_a_loop_whose_first_value_has_not_come_yet_is_not_silent(view: View) -> None:
    assert view.at is not None
    view.shown["loops"]["FIC1"] |= {"seen": None, "lost": True}
    for since, silent, seen in ((59.0, False, "not yet"), (61.0, True, "never")):
        view.shown["begun"] = view.at - since
        row = next(row for row in view.rows() if row.loop == "FIC1")
        assert (view.silent("FIC1"), row.seen, row.soon == "Signal") == (silent, seen, silent)


def test_a_lost_connection_is_told_by_its_name(view: View) -> None:
    """Each loop sent people to its transmitter, where the plant's server was gone."""
    assert view.at is not None and view.unconnected is None
    for loop in view.shown["loops"].values():
        loop |= {"seen": view.at - 30.0, "lost": True}
    view.shown["unconnected"] = "opc.tcp://plant: nobody listens there"
    assert view.unconnected == "opc.tcp://plant: nobody listens there" and view.newest == view.at - 30.0
    assert {row.todo for row in view.rows()} == {
        "The plant's server is not connected: check the server and the network."
    }
    view.shown["unconnected"] = None
    assert "no value comes" in view.todo("FIC1")


def test_a_plant_that_was_never_connected_is_told_by_its_name(view: View) -> None:
    """Regression: with a wrong address at the start each loop sent people to its transmitter, and no line said why."""
    assert view.at is not None
    for loop in view.shown["loops"].values():
        loop |= {"seen": None, "lost": True}
    view.shown |= {"begun": view.at - 61.0, "unconnected": "opc.tcp://plant: nobody listens there"}
    assert view.unconnected is not None and view.newest is None
    assert {row.todo for row in view.rows()} == {
        "The plant's server is not connected: check the server and the network."
    }


def test_a_tag_that_the_server_does_not_have_is_named(view: View) -> None:
    """Regression: a loop without SP looked as if it were only waiting for its first fit."""
    view.shown["loops"]["FIC1"]["missing"] = "FIC1 SP: ns=2;s=X: BadNodeIdUnknown (the server has no such node)"
    row = next(row for row in view.rows() if row.loop == "FIC1")
    assert row.soon == "Signal" and row.todo == (
        "FIC1 SP: ns=2;s=X: BadNodeIdUnknown (the server has no such node). Correct the tag in loops.toml, or at the "
        "server."
    )


def test_a_clock_that_is_behind_is_told_and_not_a_missing_value(view: View) -> None:
    assert view.at is not None
    late = {"seen": view.at - 3605.0, "heard": view.at - 3605.0, "lost": False, "good": True}
    view.shown["loops"]["FIC1"] |= late | {"age": 3603.0}
    assert "set the clock of the plant's server" in view.todo("FIC1")
    view.shown["loops"]["FIC1"] |= late | {"age": 0.2}
    assert "Find out why no value comes" in view.todo("FIC1")


def test_before_the_first_fit_the_crossings_are_marked_as_such(view: View) -> None:
    view._answers.clear()
    assert view.headline("FIC0").startswith("≈ ") and "crossings" in view.verdict("FIC0")


def test_width_is_in_percent_of_span_only_where_that_is_known(view: View) -> None:
    id, _, trend = view._answers["FIC0"]

    def headline(**loop: Any) -> str:
        fit = Fit("backlash", "", "mA", 2.4, 2.15, 3.11)
        row = service.answered(fit, Loop(name="FIC0", op_unit="mA", **loop))
        view.loops["FIC0"] = loops()[0].model_copy(update={"op_span": None, "op_unit": "mA"})
        view._answers["FIC0"] = id, json.loads(row["document"])["analysis"]["loops"][0]["answer"], trend
        return view.headline("FIC0")

    assert headline(op_span=(0.0, 200.0)) == "1.20 % (1.07 to 1.55)"
    assert headline() == "2.40 mA (2.15 to 3.11)"


def test_a_service_that_stopped_is_told_with_its_age(view: View) -> None:
    shown = view.shown["wall"]
    for late, behind in ((19.0, None), (21.0, 21.0)):
        view._clock = lambda late=late: shown + late
        assert view.behind == (None if behind is None else pytest.approx(behind))
    view._clock = lambda: time.time() + 130.0
    assert view.behind is not None and 129.0 < view.behind < 140.0
    # The page does not say for ever that a loop is being judged: the fit ended with the service.
    name = next(iter(view.shown["loops"]))
    view.shown["loops"][name] |= {"fitting": True, "fit": {"since": shown, "after": None, "about": 40.0}}
    assert view.progress(name) == ""
    view._clock = lambda: shown + 12.0
    assert view.progress(name) == "Being judged: 12 s of about 40 s."
    # Regression: a clock that is set back hid for as long that the service had stopped.
    view._clock = lambda: shown - 3600.0
    assert view.behind is None
    view._new_at -= 30.0
    assert view.behind == pytest.approx(30.0, abs=10.0)


def test_no_database_is_told_and_taken_up_when_it_comes(tmp_path: Path) -> None:
    view = View(tmp_path)
    view.refresh()
    assert view.why is not None and "holds no glapp.db" in view.why and view.rows() == []
    store = Store(tmp_path)
    store.know(loops(1))
    view.refresh()
    assert "has not written anything yet" in (view.why or "")
    status = {"now": 1.0, "loops": {}}
    store.show(1.0, json.dumps(status))
    view.refresh()
    assert view.why is None
    store.close()


def test_a_database_that_was_put_in_its_place_is_read(tmp_path: Path) -> None:
    """A database that the service set aside is not shown."""
    old, new = Store(tmp_path / "old"), Store(tmp_path / "new")
    for store, moment in ((old, 1.0), (new, 2.0)):
        store.show(moment, json.dumps({"now": moment, "loops": {}}))
        store.close()
    view = View(tmp_path / "old")
    view.refresh()
    assert view.at == 1.0
    (tmp_path / "new" / "glapp.db").replace(tmp_path / "old" / "glapp.db")
    view.refresh()
    assert view.at == 2.0


def test_the_window_cannot_write_the_database(view: View) -> None:
    with pytest.raises(InputError, match="readonly"):
        view.read(lambda reader: reader.rows("DELETE FROM half_periods"))
    view.refresh()
    assert view.why is None and view.read(lambda reader: reader.half_periods("FIC0"))


def test_five_thousand_loops(view: View) -> None:
    one = view.shown["loops"]["FIC0"]
    view.shown["loops"] = {f"FIC{i}": one for i in range(5000)}
    assert len({row.rank for row in view.rows()}) == 5000


def test_wear_is_seen_coming(view: View) -> None:
    days = list(range(60))
    widths = [1.0 + 0.03 * day + 0.1 * math.sin(7.0 * day) for day in days]
    found = trend(days, widths)
    assert found is not None and found.moves and abs(found.slope - 0.9) < 0.1 and found.spread < 0.1
    flat = trend(days, [1.0 + 0.1 * math.sin(7.0 * day) for day in days])
    assert flat is not None and not flat.moves
    view._trends["FIC0"] = found
    one = view.answer("FIC0")
    assert one is not None
    assert view.trend_text("FIC0") == "↗ +0.89 ± 0.03 %/month", "2.4 % is beyond the limit of 1 % already"
    one["limit"]["percent_span"] = 3.0
    assert view.trend_text("FIC0") == "↗ +0.89 ± 0.03 %/month; at 3 % in 20 d"


def test_limits_of_the_fits_decide_whether_a_width_moves() -> None:
    """Five widths a day apart: the slope's standard error is that of a width over √10."""

    def moves(errors: float) -> bool:
        """Trend with a slope of so many standard errors."""
        slope, half = errors * 0.1 / math.sqrt(10.0), 1.96 * 0.1
        widths = [2.0 + slope * day for day in range(5)]
        found = _through([(day, d, d - half, d + half) for day, d in enumerate(widths)])
        assert found is not None and found.spread == pytest.approx(30.0 * 1.96 * 0.1 / math.sqrt(10.0))
        return found.moves

    assert [moves(errors) for errors in (2.9, 3.1, -3.1)] == [False, True, True]
    assert trend(range(4), [1.0, 2.0, 3.0, 4.0]) is None
    # The scatter decides by Student's distribution where one of them has no limits.
    uneven = [(day, 2.0 + 0.07 * day + (0.02, -0.02)[day % 2], None, None) for day in range(7)]
    few, more = _through(uneven[:5]), _through(uneven)
    assert few is not None and more is not None and not few.moves and more.moves


def test_an_export_holds_no_formula(view: View) -> None:
    rows = [{"loop": "=cmd()", "text": "a,b"}]
    assert as_csv(rows) == 'loop,text\r\n\'=cmd(),"a,b"\r\n'
    assert as_csv(view.rows()).count("\r\n") == 4


def test_events_and_commands_are_one_list(plant: tuple[Monitor, FastAPI], view: View) -> None:
    monitor, _ = plant
    asyncio.run(monitor.journal.log("eve", "engineer", "change", "FIC0", {"kp": 2.0}, {"kp": 3.0}))
    asyncio.run(monitor.commands.refused("olaf", "operator", "enable", "FIC0", None, "needs the role engineer"))
    found = all_events(Station(view, ApiClient(view.folder)), 100)
    assert [one["at"] for one in found] == sorted((one["at"] for one in found), reverse=True)
    texts = {(one["kind"], one["who"], one["text"]) for one in found}
    assert ("change", "eve (engineer)", "kp 2 → 3") in texts
    assert ("enable", "olaf (operator)", "refused: needs the role engineer") in texts
    assert any(one["kind"] == "late" for one in found)


def test_half_periods_are_shaded_by_their_verdict(view: View) -> None:
    halves = view.read(lambda reader: reader.half_periods("FIC0", accepted=False))
    areas = charts.shades(halves, 100.0, dark=False)
    assert len(areas) == len(halves)
    for half, (area, end) in zip(halves, areas, strict=True):
        blue = area["itemStyle"]["color"] == charts.LIGHT["accepted"]
        assert blue == (half["reason"] == 0) and end["xAxis"] == 1000.0 * half["t_end"]


def test_no_line_is_drawn_where_nothing_came() -> None:
    times = [*range(100), *range(160, 200)]
    values = {"time": times, "SP": [50.0] * 140, "PV": [51.0] * 140, "OP": [None] * 140}
    pv = charts.live(values, [], "bar", "%", dark=False)["series"][1]["data"]
    assert [i for i, (_, x) in enumerate(pv) if x is None] == [100] and len(pv) == 141
    assert charts.live({name: [] for name in values}, [], "", "%", dark=True)["series"][1]["data"] == []


def test_a_fit_stands_with_its_interval() -> None:
    options = charts.detections([answer("backlash", 2.0, 1.0, 3.0, None)], "%", scale=0.5, dark=True)
    *_, fits = options["series"]
    assert fits["data"][0][1] == 1.0 and [end["coord"][1] for end in fits["markLine"]["data"][0]] == [0.5, 1.5]
    # The axis reaches the end of its bar: one beyond it would not be drawn.
    assert options["yAxis"][":max"] == "v => v.max >= 1.5 ? null : 1.5"


@pytest.mark.parametrize("tone", [charts.LIGHT, charts.DARK])
def test_colours_can_be_read(tone: dict[str, str]) -> None:
    """WCAG 2: 4.5 for text on the cards of the page."""
    card = "#f7f8f9" if tone is charts.LIGHT else "#1d242b"

    def light(colour: str) -> float:
        parts = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
        r, g, b = (x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts)
        return 0.2126 * r + 0.7152 * g + 0.0722 * b

    for name in ("ink", "muted", "pv", "op", "sp", "after"):
        a, b = sorted((light(tone[name]), light(card)))
        assert (b + 0.05) / (a + 0.05) >= 4.5, name


# Parameters and compensation


def test_only_what_is_changed_is_asked_for() -> None:
    seen = {"kp": 2.0, "tf": None, "n": 9}
    assert changed(seen, {"kp": 2.0, "tf": None, "n": 9.0}) == {"values": {}, "seen": {}}
    assert changed(seen, {"kp": None, "tf": 0.5, "n": 9}) == {
        "values": {"kp": None, "tf": 0.5},
        "seen": {"kp": 2.0, "tf": None},
    }


def test_every_compensation_state_has_its_sentence() -> None:
    assert set(TEXT_OF_STATE) == set(CATALOGUE["standings"])


SETTINGS: dict[str, Any] = {
    "ti": 20.0,
    "comp_size": 2.0,
    "comp_fitted": None,
    "comp_source": None,
    "comp_way": 3.0,
    "comp_share": 0.8,
    "comp_band": None,
    "comp_limit": 5.0,
    "comp_rate": 0.5,
    "comp_release": None,
    "comp_watch": None,
    "comp_withdraw": 1.0,
    "comp_travel": None,
    "comp_reversals": None,
}


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"comp_fitted": 1.5},
        {"comp_band": 0.1},
        {"comp_way": 1.0},
        {"comp_share": 0.5, "comp_fitted": 1.0, "comp_source": 1},
    ],
)
def test_what_is_told_before_is_what_the_block_does(more: dict[str, Any]) -> None:
    settings = SETTINGS | more
    told = plan(settings, "%")
    given = {key: value for key, value in settings.items() if value is not None}
    names = ("sp", "pv", "flags", "op", "u_ff")
    block = BacklashDetection(k=1.0, op_low=0.0, op_high=100.0, **given)
    graph = Graph(
        1.0,
        {**{name: Input() for name in names}, "watch": block, "ff": Output()},
        [f"{name} -> watch.{name}" for name in names] + ["watch -> ff"],
    )
    graph["watch.compensate"] = 1.0
    graph.scan(sp=0.0, pv=0.0, flags=0.0, op=50.0, u_ff=0.0)
    assert told.why_not == "" and told.size == graph["watch.size"]
    assert told.delta == pytest.approx(graph["watch.delta"], rel=1e-12)


def test_what_cannot_be_compensated_is_told() -> None:
    assert "no node" in plan({"k": 1.0}, "%").why_not
    assert "No width" in plan(SETTINGS | {"comp_size": 0.0}, "%").why_not
    assert "width is 0" in plan(SETTINGS | {"comp_fitted": 0.0}, "%").why_not
    assert "Nothing is left" in plan(SETTINGS | {"comp_band": 1.9}, "%").why_not


def test_the_half_period_under_way_is_that_of_the_detector() -> None:
    """The view has the half-periods of the service's detector."""
    from glapp.estimate import Estimator

    loop = loops()[0]
    rows: dict[float, dict[str, float]] = {}
    for value in values("FIC0", 300):
        rows.setdefault(value.time, {})[str(value.signal)] = value.value
    detector, shadow = Estimator(loop, 1.0), UnderWay(loop, 1.0)
    compared = 0
    for t, row in sorted(rows.items()):
        before, failing = shadow.numbers, shadow.failing
        half = detector.update(t, 50.0, row["pv"], row["op"], 0)
        shadow.take(t, 50.0, row["pv"], row["op"], auto=True)
        if half is not None and half.reason != 1:
            assert before["delta_t"] == pytest.approx(half.delta_t, abs=1.0 + 1e-9)
            assert before["delta_y"] == pytest.approx(half.delta_y, rel=0.05)
            assert before["e_max"] == pytest.approx(half.e_max, rel=1e-9)
            assert [REASONS[name].label for name in failures(half.mask)] == failing
            compared += 1
    assert compared >= 5


# A step test


def by_hand() -> tuple[list[float], list[float]]:
    """PV and OP of a step test, a sample a second; the gap is 2 %."""
    import glapp

    steps = [(0, 100, 50.0), (100, 200, 53.0), (200, 300, 56.0), (300, 400, 52.0)]
    made = glapp.simulate.closed_loop(
        ([0.8], [5, 1], 0),
        (0.5, 10, 0, 0),
        d=2.0,
        noise=0.05,
        h=1.0,
        t_end=400,
        manual=steps,
        setpoint=[(0, 40.0)],
        filter_in_loop=True,
    ).to_arrow()
    return made["PV"].to_pylist(), made["OP"].to_pylist()


def test_a_step_test_is_read_as_it_goes_on() -> None:
    pv, op = by_hand()
    n = len(pv)
    values: dict[str, Any] = {
        "time": [1.795e9 + k for k in range(n)],
        "PV": pv,
        "OP": op,
        "MODE": ["MAN"] * n,
        "QUALITY": ["good"] * n,
        "OP_LOW": [0] * n,
        "OP_HIGH": [0] * n,
    }
    at = []
    for end in (90, 195, 295, 400):
        part = {name: column[:end] for name, column in values.items()}
        at.append(step_test.next_step(step_test.read(part, loops()[0]), True))
    assert at == [1, 2, 3, 4] and step_test.next_step(None, False) == 0
    found = step_test.read(values, loops()[0])
    assert found is not None and "The gap is 1.98" in " ".join(step_test.lines_of(found, "%"))
    drawn = charts.step_test(found, dark=False)
    assert drawn is not None and drawn["xAxis"][1]["type"] == "time"
    assert drawn["series"][0]["data"][0][0] == 1000.0 * values["time"][0] and len(drawn["series"][1]["data"]) == n
    assert step_test.read(values | {"MODE": ["AUTO"] * n}, loops()[0]) is None


def test_a_step_test_is_read_from_a_file_of_the_persons_own(tmp_path: Path) -> None:
    rows = [(f"2026-03-02 06:{k // 60:02}:{k % 60:02}", *pair) for k, pair in enumerate(zip(*by_hand(), strict=True))]
    dated, plain = tmp_path / "FIC402.csv", tmp_path / "test.csv"
    dated.write_text("time,SP,PV,OP,MODE\n" + "".join(f"{t},40,{pv},{op},MAN\n" for t, pv, op in rows))
    plain.write_text("s,flow,valve\n" + "".join(f"{k},{pv},{op}\n" for k, (_, pv, op) in enumerate(rows)))
    found = step_test.read_file(dated, loops()[0], {}, manual=False)
    assert found.d == pytest.approx(1.98, abs=0.02) and found.t0 is not None
    drawn = charts.step_test(found, dark=True)
    assert drawn is not None and drawn["xAxis"][1]["type"] == "time"
    assert drawn["series"][0]["data"][0][0] == 1000.0 * found.t0.timestamp()
    with pytest.raises(InputError, match=r"^test\.csv: no column for PV and OP") as refused:
        step_test.read_file(plain, loops()[0], {}, manual=True)
    assert str(tmp_path) not in str(refused.value)
    named = step_test.read_file(plain, loops()[0], {"time": "s", "pv": "flow", "op": "valve", "mode": ""}, manual=True)
    assert named.d == found.d
    drawn = charts.step_test(named, dark=False)
    assert drawn is not None and drawn["xAxis"][1]["type"] == "value" and drawn["series"][0]["data"][0][0] == 0.0


def test_whether_pv_is_calmer_is_told_only_when_that_is_seen() -> None:
    t = [float(k) for k in range(2000)]
    pv = [50.0 + (1.0 if k < 1000 else 0.4) * math.sin(0.05 * k) for k in range(2000)]
    u_ff = [0.0 if k < 1000 else 0.5 for k in range(2000)]
    sp = [50.0] * 2000
    found = calm(t, sp, pv, u_ff, 950.0, 900.0)
    assert found is not None and found.factor == pytest.approx(2.5, rel=0.05) and found.word.startswith("calmer")
    assert found.seconds == 999.0
    stepped = [y + (30.0 if 1200 <= k < 1400 else 0.0) for k, y in enumerate(pv)]
    other = calm(t, sp, stepped, u_ff, 950.0, 900.0)
    assert other is not None and other.factor == pytest.approx(2.0, rel=0.1), "a load that steps does not hide it"
    assert calm(t, sp, pv, [0.0] * 2000, 950.0, 900.0) is None  # enabled, and it waits
    assert calm(t[:1500], sp[:1500], pv[:1500], u_ff[:1500], 950.0, 900.0) is None
    assert calm(t[500:], sp[500:], pv[500:], u_ff[500:], 950.0, 900.0) is None
    assert calm([], [], [], [], 950.0, 900.0) is None


@pytest.mark.slow
def test_the_level_of_the_demonstration_is_calmer_by_its_medians() -> None:
    """The loads are the same with and without compensation: most of the scatter is of the loads."""
    settings = parse_settings(SimPlant(5).settings(), "loops.toml", Path())
    found = []
    for compensated in (False, True):
        sim = SimLoop(3, kinds(1.0)[3], 1.0, seed=1)
        beside = detection_beside(settings[3], 1.0, comp_size=2.0, comp_share=SHARE, comp_rate=0.06, comp_limit=6.0)
        beside["watch.ff_delay"] = 2.0
        u_ff, e = [0.0, 0.0], []
        for scan in range(6000):
            beside["watch.compensate"] = float(compensated and scan >= 500)
            told = sim.scan(0.0, u_ff[-2])
            beside.scan(**{name: told[Signal(name)] for name in ("sp", "pv", "op")}, u_ff=u_ff[-2], flags=0.0)
            u_ff.append(beside["ff"])
            e.append(told[Signal.SP] - told[Signal.PV])
        found.append(np.array(e[1000:]))
    without, with_it = found
    assert 1.0 < without.std() / with_it.std() < 2.0 < np.median(abs(without)) / np.median(abs(with_it)) < 4.0


# The service's API


def test_commands_go_by_the_api_in_the_persons_name(plant: tuple[Monitor, FastAPI]) -> None:
    monitor, app = plant
    path = loop_path("FIC0", "parameters")

    async def go() -> None:
        api = client_of(app, monitor.store.folder)
        eve, vera = [
            (await api.asked("POST", "/login", None, {"user": name, "password": PASSWORDS[name]}))["token"]
            for name in ("eve", "vera")
        ]
        seen = await api.asked("GET", path, vera)
        fields = {name: field(value) for name, value in seen.items()}
        with pytest.raises(Refused, match="needs the role engineer"):
            await api.asked("POST", path, vera, changed(seen, fields | {"kp": 3.0}))
        assert (await api.asked("POST", path, eve, changed(seen, fields | {"kp": 3.0})))["kp"] == 3.0
        with pytest.raises(Refused, match="somebody else has changed it"):
            await api.asked("POST", path, eve, changed(seen, fields | {"kp": 4.0}))
        with pytest.raises(Refused, match="must be odd"):
            await api.asked("POST", path, eve, {"values": {"n": 4}})
        assert (await api.live("FIC0", vera))["pv"]["good"]
        await api.asked("POST", "/logout", eve)
        with pytest.raises(Refused) as refused:
            await api.asked("GET", "/status", eve)
        assert refused.value.status == 401
        await api.close()

    asyncio.run(go())
    assert monitor.reader.commands("FIC0")[0]["person"] in ("eve", "vera")


def test_a_command_without_an_answer_may_be_done(tmp_path: Path) -> None:
    """Regression: "Not done" was said of a command that the service had taken, and was slow to do."""

    def slow(request: httpx.Request) -> httpx.Response:
        raise httpx.ReadTimeout("")

    async def go() -> None:
        api = ApiClient(tmp_path, "http://127.0.0.1")
        api._http = httpx.AsyncClient(transport=httpx.MockTransport(slow))
        with pytest.raises(Unsure, match="took the request and did not say: no answer in 10 s"):
            await api.asked("POST", "/loops/FIC0/enable", "token")
        with pytest.raises(Gone, match="does not answer: no answer in 10 s") as error:
            await api.asked("GET", "/status", "token")
        assert not isinstance(error.value, Unsure)

    asyncio.run(go())


def test_a_test_is_offered_where_one_is_planned() -> None:
    """Regression: none where the answer is *likely sound*, though `--plan` planned one."""
    assert proof_page.OPEN is plan_module.OPEN
    assert set(OPEN) == {"likely", "likely_sound", "cannot_tell"} < set(get_args(Confidence))


def test_a_service_that_is_gone_is_told(tmp_path: Path) -> None:
    async def go() -> None:
        api = ApiClient(tmp_path)
        with pytest.raises(Gone, match="api-url is not there"):
            await api.asked("GET", "/status", "x")
        (tmp_path / "api-url").write_text("http://127.0.0.1:9")
        with pytest.raises(Gone, match=r"does not answer: nobody listens at its address\. Start `glapp watch`"):
            await api.asked("GET", "/status", "x")
        await api.close()

    asyncio.run(go())


# Guards against strangers


class Known:
    """The service's tokens: whose each is."""

    def __init__(self, **known: tuple[str, str]) -> None:
        self.known = known

    def of(self, token: str, now: float) -> tuple[str, str] | None:
        return self.known.get(token)


@pytest.fixture
def guarded() -> tuple[TestClient, Sessions]:
    inner = FastAPI()

    @inner.get("/{path:path}")
    async def page(path: str) -> str:
        if path == "slow":
            sessions._tokens.known.clear()
        return path

    @inner.post("/{path:path}")
    async def change(path: str) -> str:
        return path

    @inner.websocket("/_nicegui_ws/socket.io/")
    async def connected(socket: WebSocket) -> None:
        await socket.accept()
        with suppress(WebSocketDisconnect):
            while True:
                await socket.send_text(await socket.receive_text())

    sessions = Sessions(Known(t=("eve", "engineer")))
    app = Guard(inner, sessions, ("127.0.0.1",), secure=False)
    return TestClient(app, base_url="http://127.0.0.1:8108", follow_redirects=False), sessions


def test_without_a_session_there_is_the_login_page_and_nothing_else(guarded: tuple[TestClient, Sessions]) -> None:
    client, sessions = guarded
    for path in ("/", "/loop?name=FIC0", "/events.csv", "/laboratory"):
        assert client.get(path).headers["location"].partition("?")[0] == "/login"
    assert client.get("/_nicegui_ws/socket.io/?EIO=4&transport=polling").status_code == 401
    assert client.get("/_nicegui/1/static/nicegui.js").status_code == 401
    assert client.get("/login").status_code == 200
    client.cookies.set(COOKIE, "guess")
    assert client.get("/").status_code == 303
    client.cookies.set(COOKIE, sessions.begin("t", "eve", "engineer", dark=False).id)
    assert client.get("/").status_code == 200


def test_a_page_elsewhere_changes_nothing(guarded: tuple[TestClient, Sessions]) -> None:
    client, sessions = guarded
    client.cookies.set(COOKIE, sessions.begin("t", "eve", "engineer", dark=False).id)
    ours = {"Origin": "http://127.0.0.1:8108"}
    assert client.post("/logout", headers=ours).status_code == 200
    for origin in ("http://evil.example", "http://127.0.0.1:9999", "https://127.0.0.1:8108", "null"):
        assert client.post("/logout", headers={"Origin": origin}).status_code == 403, origin
        assert client.get("/", headers={"Origin": origin}).status_code == 403
    assert client.post("/logout").status_code == 403  # nobody says where it comes from
    assert client.get("/", headers={"Host": "evil.example"}).status_code == 400
    with pytest.raises(WebSocketDisconnect) as closed, client.websocket_connect("/_nicegui_ws/socket.io/"):
        pass
    assert closed.value.code == 1008


def test_every_answer_says_that_nothing_comes_from_outside(guarded: tuple[TestClient, Sessions]) -> None:
    client, _ = guarded
    headers = client.get("/login").headers
    assert "default-src 'self'" in headers["content-security-policy"] and headers["cache-control"] == "no-store"
    assert "frame-ancestors 'none'" in headers["content-security-policy"]


def test_a_session_ends() -> None:
    now = 0.0
    tokens = Known(t=("eve", "engineer"))
    sessions = Sessions(tokens, lambda: now)
    one = sessions.begin("t", "eve", "engineer", dark=False)
    assert sessions.of(f"a=b; {COOKIE}={one.id}") is one and sessions.of("x") is None and sessions.of(None) is None
    now = LOGIN_LASTS + 1.0
    assert sessions.of(f"{COOKIE}={one.id}") is None
    now = 0.0
    for known in ({}, {"t": ("eve", "viewer")}, {"t": ("adam", "engineer")}):
        one = sessions.begin("t", "eve", "engineer", dark=False)
        tokens.known = {"t": ("eve", "engineer")}
        assert sessions.by_id(one.id) is one
        tokens.known = known
        assert sessions.by_id(one.id) is None
        tokens.known = {"t": ("eve", "engineer")}
        assert sessions.by_id(one.id) is None, "what is over stays over"


def test_an_answer_that_comes_after_the_session_is_over_is_kept_back(guarded: tuple[TestClient, Sessions]) -> None:
    client, sessions = guarded
    client.cookies.set(COOKIE, sessions.begin("t", "eve", "engineer", dark=False).id)
    assert client.get("/fast").json() == "fast"
    reply = client.get("/slow")
    assert reply.status_code == 401 and reply.text == "log in first"


def test_the_connection_of_a_page_ends_with_its_session(guarded: tuple[TestClient, Sessions]) -> None:
    client, sessions = guarded
    one = sessions.begin("t", "eve", "engineer", dark=False)
    headers = {"Origin": "http://127.0.0.1:8108", "Host": "127.0.0.1:8108", "Cookie": f"{COOKIE}={one.id}"}
    with client.websocket_connect("/_nicegui_ws/socket.io/", headers=headers) as socket:
        socket.send_text("here")
        assert socket.receive_text() == "here"
        sessions._tokens.known.clear()
        with pytest.raises(WebSocketDisconnect) as closed:
            socket.receive_text()
        assert closed.value.code == 1008


def test_no_request_is_longer_than_it_need_be(guarded: tuple[TestClient, Sessions]) -> None:
    client, sessions = guarded
    ours = {"Origin": "http://127.0.0.1:8108"}
    assert client.post("/login", content=b"x" * LARGEST, headers=ours).status_code == 200
    assert client.post("/login", content=b"x" * (LARGEST + 1), headers=ours).status_code == 413
    assert client.post("/login", content=iter([b"x"]), headers=ours).status_code == 413  # nobody says how long
    client.cookies.set(COOKIE, sessions.begin("t", "eve", "engineer", dark=False).id)
    assert client.post("/a/file", content=b"x" * (LARGEST + 1), headers=ours).status_code == 200
    assert client.post("/a/file", headers={**ours, "Content-Length": str(LARGEST_FILE + 1)}).status_code == 413


@pytest.fixture(scope="session")  # its library can be given to one application only, however often a worker comes back
def window(plant: tuple[Monitor, FastAPI]) -> tuple[Station, FastAPI]:
    monitor, app = plant
    station = Station(View(monitor.store.folder), client_of(app, monitor.store.folder))
    return station, app_of(station, ("127.0.0.1",), secure=True)


def test_login(window: tuple[Station, FastAPI]) -> None:
    station, app = window
    client = TestClient(app, base_url="https://127.0.0.1", follow_redirects=False)
    ours = {"Origin": "https://127.0.0.1"}
    wrong = client.post("/login", data={"user": "eve<b>", "password": "no"}, headers=ours)
    assert wrong.status_code == 401 and "Wrong name or password." in wrong.text and "<b>" not in wrong.text
    assert 'value="eve&lt;b&gt;"' in wrong.text, "the name stays; it had to be typed again"
    right = client.post("/login", data={"user": "eve", "password": PASSWORDS["eve"], "dark": "1"}, headers=ours)
    cookie = right.headers["set-cookie"]
    assert right.status_code == 303
    for word in ("HttpOnly", "SameSite=strict", "Secure", "Path=/"):
        assert word.lower() in cookie.lower()
    session = station.sessions.of(cookie.partition(";")[0])
    assert session is not None and session.role == "engineer" and session.dark and session.token not in cookie
    assert client.post("/login", data={"user": "eve", "password": PASSWORDS["eve"]}).status_code == 403
    assert client.get("/overview.csv").status_code == 200
    out = client.post("/logout", headers=ours)
    assert out.status_code == 303 and station.sessions.by_id(session.id) is None
    assert client.get("/overview.csv").headers["location"] == "/login"


@pytest.mark.slow
def test_whoever_is_removed_reads_nothing_any_more(
    window: tuple[Station, FastAPI], plant: tuple[Monitor, FastAPI]
) -> None:
    """Regression: for up to twelve hours such a session read everything."""
    _, app = window
    users = plant[0].users
    for change in (
        lambda: users.put("rick", "operator", None, time.time()),
        lambda: users.put("rick", "viewer", "another-password", time.time()),
        lambda: users.remove("rick"),
    ):
        users.put("rick", "viewer", "ricks-password", time.time())
        client = TestClient(app, base_url="https://127.0.0.1", follow_redirects=False)
        ours = {"Origin": "https://127.0.0.1"}
        client.post("/login", data={"user": "rick", "password": "ricks-password"}, headers=ours)
        paths = ("/", "/loop?name=FIC0", "/events", "/laboratory", "/who", "/overview.csv", "/events.csv")
        for path in (*paths, "/api/overview", "/api/events"):
            assert client.get(path).status_code in (200, 204), path
        change()
        for path in paths:
            assert client.get(path).headers["location"].partition("?")[0] == "/login", path
        for path in ("/api/overview", "/api/events", "/_nicegui_ws/socket.io/?EIO=4&transport=polling"):
            assert client.get(path).status_code == 401, path
        assert client.post("/theme", headers=ours).status_code == 401


# The command line


@pytest.mark.slow
def test_it_is_not_opened_to_others_without_tls(tmp_path: Path) -> None:
    code = "from glapp.cli import main; main()"
    words = ["station", "--data", str(tmp_path), "--host", "0.0.0.0", "--port", "0"]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=60)
    said = " ".join(done.stderr.split())
    assert done.returncode == 1 and "passwords would be readable on their way" in said and "Traceback" not in said


@pytest.fixture
def certificate(tmp_path: Path) -> tuple[Path, Path]:
    """A certificate of 127.0.0.1 that signs itself, and its key."""
    import datetime
    import ipaddress

    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key, name = ec.generate_private_key(ec.SECP256R1()), x509.Name([])
    now = datetime.datetime.now(datetime.UTC)
    made = (
        x509.CertificateBuilder(name, name, key.public_key(), 1, now, now + datetime.timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]), critical=True)
        .sign(key, hashes.SHA256())
    )
    (tmp_path / "own.pem").write_bytes(made.public_bytes(serialization.Encoding.PEM))
    form = (serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    (tmp_path / "own.key").write_bytes(key.private_bytes(serialization.Encoding.PEM, *form))
    return tmp_path / "own.pem", tmp_path / "own.key"


@pytest.mark.slow
def test_with_a_certificate_it_speaks_tls_and_nothing_else(
    tmp_path: Path, certificate: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    own, key = certificate
    code = "from glapp.cli import main; main()"
    words = ["--data", str(tmp_path / "data"), "--port", "0", "--certificate", str(own), "--key", str(key)]
    process = subprocess.Popen(
        [sys.executable, "-c", code, "station", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None and process.stderr is not None
        assert re.match(r"note: .*own\.pem expires on \S+, in 0 d: put a new one there", process.stderr.readline())
        url = process.stdout.readline().removeprefix("The window is at ").strip().rstrip(".")
        assert url.startswith("https://127.0.0.1:")
        with httpx.Client(verify=ssl.create_default_context(cafile=str(own)), timeout=60.0) as client:
            assert client.get(f"{url}/login").status_code == 200
            assert client.post(f"{url}/login", headers={"Origin": url.replace("https", "http")}).status_code == 403
            told = client.post(f"{url}/login", headers={"Origin": url}, data={"user": "eve", "password": "x"})
            assert told.status_code == 503 and "The service has not told where its API is" in told.text
            with pytest.raises(httpx.HTTPError):
                client.get(f"{url.replace('https', 'http')}/login")
        with pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
            httpx.get(f"{url}/login", timeout=60.0)  # who does not know the certificate says nothing
        # Regression: no command of `glapp watch` reached an API whose certificate the plant had signed.
        asked = ["watch", "disable", "FIC0", "--api-url", url]
        monkeypatch.setenv("GLAPP_TOKEN", "x")
        refused = CliRunner().invoke(cli, asked).exception
        assert isinstance(refused, InputError) and "into the variable GLAPP_TRUST" in str(refused)
        monkeypatch.setenv("GLAPP_TRUST", str(own))
        answered = CliRunner().invoke(cli, asked).exception
        assert isinstance(answered, InputError) and answered.parameter == "service"
    finally:
        process.terminate()
        process.communicate(timeout=60)


def test_a_demo_takes_no_folder_of_a_service_that_runs(tmp_path: Path) -> None:
    store = Store(tmp_path)
    result = CliRunner().invoke(cli, ["station", "--demo", "--data", str(tmp_path)])
    assert isinstance(result.exception, InputError) and "a folder of its own" in str(result.exception)
    store.close()


def test_help_teaches() -> None:
    text = CliRunner().invoke(cli, ["station", "--help"]).output
    assert "glapp station --demo" in text and "docs/station.md" in text


def test_the_names_of_the_axes_of_an_effect_have_their_own_line() -> None:
    """Regression: in its 300 px *u_FF [%]* lay on the lowest number of PV − SP."""
    values = {"time": [0.0, 1.0], "SP": [50.0, 50.0], "PV": [50.0, 51.0], "U_FF": [0.0, 0.1]}
    upper, lower = charts.effect(values, 0.5, "%", "%", dark=False)["grid"]
    share = {key: float(grid["height"].rstrip("%")) / 100.0 for key, grid in (("upper", upper), ("lower", lower))}
    last_number = upper["top"] + share["upper"] * 300.0 + 6.0
    name = 300.0 - lower["bottom"] - share["lower"] * 300.0 - 15.0 - 6.0
    assert last_number <= name
