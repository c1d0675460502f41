"""The operator's window as a person meets it, in Chromium."""

import re
import time
import urllib.request
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("nicegui")
pytest.importorskip("multipart")

from station_child import EVIL, PASSWORDS
from station_window import LONGEST, Window, logged_in
from test_station import by_hand

from glapp.report.words import URGENCIES
from glapp.service.store import Reader
from glapp.station import charts
from glapp.station.pages import DOUBLE

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("station in a browser")]


CHART = "getElement(Number(document.querySelector('.chart').id.slice(1))).chart"


def unfolded(page: Any) -> None:
    """Unfold the zero crossings, which are folded where there is an answer."""
    page.locator("summary", has_text="Zero crossings").click()


def under_way(page: Any) -> None:
    """Wait until the page has its signals: it then shows the half-period under way."""
    unfolded(page)
    page.get_by_text(re.compile("^Half-period under way")).wait_for()


def test_overview_loop_and_events(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    row = page.locator(".ag-row", has_text="Backlash").first
    assert "2.40 % (2.15 to 3.11)" in row.inner_text() and "Now" in row.inner_text()
    page.get_by_label("Search").fill("FIC0")
    page.wait_for_function("document.querySelectorAll('.ag-center-cols-container .ag-row').length === 1")
    with page.expect_download() as download:
        page.get_by_role("link", name="CSV").click()
    assert "FIC0" in Path(download.value.path()).read_text(encoding="utf-8")
    page.locator(".ag-cell[col-id=verdict]").first.click()
    page.keyboard.press("Enter")
    page.wait_for_selector(".one")
    assert page.locator(".one").inner_text() == "2.40 %"
    unfolded(page)
    page.get_by_text("too short").or_(page.get_by_text("accepted")).first.wait_for()
    page.get_by_role("button", name="Width over time").click()
    page.get_by_text("A dot is a half-period").wait_for()
    assert page.locator(".wide-dialog canvas").count() == 1
    page.keyboard.press("Escape")
    page.get_by_role("link", name="Events").click()
    page.get_by_text("<b>so</b> late").wait_for()
    assert page.wrong == [] and {url.split("/")[2] for url in page.asked if "//" in url} == {window.url.split("/")[2]}


def test_one_typeface_and_a_page_that_does_not_exist(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    page.locator(".ag-row").first.wait_for()
    families = "(all) => [...new Set(all.map((one) => getComputedStyle(one).fontFamily))]"
    assert len(page.locator("body, .ag-cell, .ag-header-cell-text, .q-btn").evaluate_all(families)) == 1
    page.set_viewport_size({"width": 1280, "height": 800})
    cut = "(all) => all.filter((one) => one.scrollWidth > one.clientWidth + 1).map((one) => one.textContent)"
    assert page.locator(".ag-header-cell-text").evaluate_all(cut) == []
    found = page.goto(f"{window.url}/loops/FIC0")
    assert found.status == 404 and page.locator("h1").inner_text() == "There is no such page"
    page.get_by_role("link", name="Overview").click()
    page.locator(".ag-row").first.wait_for()


def test_a_browser_in_another_zone_is_told_whose_times_are_shown(browser: Any, window: Window) -> None:
    """Regression: pictures were an hour from the words beside them, where the service's computer runs in UTC."""
    there = "Etc/GMT-5" if time.localtime().tm_gmtoff != 5 * 3600 else "Etc/GMT-6"
    page = logged_in(browser, window, "vera", timezone_id=there)
    page.get_by_text(
        re.compile(r"^Times in words are UTC[+-]\d\d:\d\d; those of pictures are this browser's")
    ).wait_for()
    own = logged_in(browser, window, "olaf")
    assert not own.get_by_text("Times in words are").is_visible()


def test_a_loop_that_nobody_has_judged_does_not_look_like_one_that_needs_nothing(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    shape = "(row) => glapp.soon(row)[0]"
    shapes = [page.evaluate(shape, {"urgency": key, "soon": ""}) for key in (*URGENCIES, "signal", "unjudged")]
    assert len(set(shapes)) == len(shapes)


def test_reasons_use_the_width_of_a_telephone(browser: Any, window: Window) -> None:
    """Regression: their sentences had a column of 80 px, a word a line."""
    page = logged_in(browser, window, "vera")
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(window.url + "/loop?name=FIC0")
    unfolded(page)
    cell = page.locator(".reasons td:last-child").first
    cell.wait_for()
    assert cell.bounding_box()["width"] > 250
    names = (
        f"() => {CHART}.getOption().series[1].markArea.data.map(([a]) => a.label.formatter({{ name: 'too short' }}))"
    )
    page.wait_for_function(f"() => ({names})().length > 0")
    assert set(page.evaluate(names)) == {""}, "they lay on each other"
    page.set_viewport_size({"width": 1280, "height": 800})
    assert set(page.evaluate(names)) == {"too short"}
    page.set_viewport_size({"width": 390, "height": 844})
    page.wait_for_function("document.documentElement.scrollWidth <= innerWidth")


HARMLESS = r"() => !/[\p{Cf}\p{Zl}\p{Zp}]|(?![\t\n\r])\p{Cc}/u.test(document.body.innerText + document.title)"


def test_a_name_is_shown_with_what_is_hidden_in_it(browser: Any, window: Window) -> None:
    r"""`\u202e` in a loop's name was shown as it is: in the overview, on its page, among the events."""
    page = logged_in(browser, window, "vera")
    window.say("evil")
    cell = page.locator(".ag-cell[col-id=loop]", has_text="<b>")
    cell.wait_for()
    told = r"FIC\u202e9\u200b\x1b[31m\u2066<b>"
    assert cell.inner_text() == told
    page.get_by_role("alert").filter(has_text=f"The database has 0 bytes; it was set aside as {told}.").wait_for()
    cell.locator("a").click()  # the link leads to the loop all the same
    page.get_by_role("heading", name="<b>").wait_for()
    assert page.get_by_role("heading", level=1).inner_text() == told
    assert page.title() == f"{told} – glapp"
    page.wait_for_function(HARMLESS)
    page.get_by_role("link", name="Events").click()
    page.get_by_text("came late").wait_for()
    assert page.get_by_text("came late").inner_text() == f"{told} came late"
    page.wait_for_function(HARMLESS)
    for path in ("/overview.csv", "/events.csv"):
        text = page.request.get(window.url + path).text()
        assert told in text and EVIL not in text
    window.say("no evil")
    assert page.wrong == []


@pytest.mark.verify
def test_laboratory(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    page.get_by_role("link", name="Laboratory").click()
    page.get_by_text("SIMULATION").wait_for()
    page.get_by_role("button", name="1000 ×", exact=True).click()
    page.get_by_label("Search").fill("watch.d_hat")
    cell = page.locator(".ag-cell[col-id=value]").first
    page.wait_for_function("/^[12]\\.\\d/.test(document.querySelector('.ag-cell[col-id=value]').innerText)")
    page.get_by_label("Search").fill("gap.d")
    page.wait_for_function("document.querySelector('.ag-cell[col-id=value]').innerText === '2'")
    for typed, shown in (("4", "4"), ("-1", "4")):  # the second is out of bounds
        cell.click()
        page.keyboard.press("Control+A")
        page.keyboard.type(typed)
        page.keyboard.press("Enter")
        page.wait_for_function(f"document.querySelector('.ag-cell[col-id=value]').innerText === '{shown}'")
    page.get_by_text("0 or greater").or_(page.get_by_text("gap")).last.wait_for()
    page.get_by_role("button", name="Build another loop").click()
    page.get_by_label("wires, one a line").fill("sp -> pid.sp")
    page.get_by_role("button", name="Build", exact=True).click()
    page.get_by_text("connect it").wait_for()
    assert page.wrong == []


@pytest.mark.verify
def test_a_tab_that_is_open_for_a_day_does_not_grow(browser: Any, window: Window) -> None:
    """Two days of values, faster than they come: after the second the page holds no more than after the first."""
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    under_way(page)
    told = page.context.new_cdp_session(page)
    begin = page.evaluate("glapp.every = 0, Date.now() + 1e6")
    some = """(begin) => {
      const id = Number(document.querySelector('.chart').id.slice(1));
      glapp.append(id, Array.from({ length: 3600 }, (_, i) => [begin + 1000 * i, 50, 50, 50]), 900000);
      return getElement(id).chart.getOption().series.map((one) => one.data.length);
    }"""

    def used(day: int) -> tuple[float, int, int]:
        for hour in range(24):
            assert page.evaluate(some, begin + (24 * day + hour) * 3_600_000) == [901, 901, 901, 0]
        told.send("HeapProfiler.collectGarbage")
        counted = told.send("Memory.getDOMCounters")
        return told.send("Runtime.getHeapUsage")["usedSize"], counted["nodes"], counted["jsEventListeners"]

    first, second = used(0), used(1)
    more = [b - a for a, b in zip(first, second, strict=True)]
    assert more[0] < 2e6 and more[1] < 500 and more[2] < 100, (first, second)
    assert page.wrong == []


@pytest.mark.verify
def test_values_that_come_fast_are_drawn_together_and_none_is_left_out(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    under_way(page)
    drawn = page.evaluate("""async () => {
      const [id, begin] = [Number(document.querySelector('.chart').id.slice(1)), Date.now() + 1e6];
      const chart = getElement(id).chart;
      const set = chart.setOption.bind(chart);
      let times = 0;
      chart.setOption = (...given) => (times++, set(...given));
      for (let i = 0; i < 100; i++) glapp.append(id, [[begin + i, 50, 50, 50]], 900000);
      while (glapp.waiting[id].points.length) await new Promise((done) => setTimeout(done, 10));
      const since = chart.getOption().series[1].data.filter((point) => point[0] >= begin).length;
      return [since, times];
    }""")
    assert drawn[0] == 100 and drawn[1] < 50, drawn
    assert page.wrong == []


@pytest.mark.verify
def test_a_page_that_is_open_before_the_first_samples(browser: Any, window: Window) -> None:
    """Regressions: it never showed a half-period under way, and said over the signals that no value came."""
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC1")
    page.get_by_text("No PV has come since the service began.").wait_for()
    told = f"{CHART}.getOption().graphic?.[0].elements[0].style.text"
    page.wait_for_function(f"{told} === 'No value of FIC1 came in the last 15 min.'")
    window.say("samples")
    under_way(page)
    page.wait_for_function(f"{told} === ''")
    assert page.wrong == []


@pytest.mark.verify
def test_axes_end_at_the_span_or_at_the_signal(browser: Any, window: Window) -> None:
    """Regressions: an OP at its limit had an axis to 102 %, and an axis that was fitted kept its 5 % of span.

    Without a span a signal that stays at 50.2 had an axis from 20 to 80.
    """
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    under_way(page)

    def reach(*op: float) -> list[float]:
        data = [[1000 * k, value] for k, value in enumerate(op)]
        # In one call: between two the window may draw the loop's own values.
        set_data = f"{CHART}.setOption({{ series: [{{}}, {{}}, {{ data }}, {{ data }}] }})"
        extent = f"{CHART}.getModel().getComponent('yAxis', 1).axis.scale.getExtent()"
        return page.evaluate(f"(data) => {{ {set_data}; return {extent} }}", data)

    assert reach(100, 100) == [95, 100] and reach(0, 0) == [0, 5] and reach(60, 60) == [57.5, 62.5]
    assert reach(20, 90) == [20, 90] and reach(101, 101) == [95, 101] and reach(-2, 40) == [-2, 40]
    page.get_by_role("button", name="fit to signals").click()
    page.wait_for_function(f"Math.abs({CHART}.getOption().series[2].data[0][0]) > 1e9")  # drawn anew
    assert reach(100, 100) == [99.9, 100] and reach(60, 61) == [60, 61]
    without = charts._reach(None, charts.PART)
    ends = "{ min: eval(min), max: eval(max) }"
    page.evaluate(f"([min, max]) => {CHART}.setOption({{ yAxis: [{{}}, {ends}] }})", [without[":min"], without[":max"]])
    assert reach(50.2, 50.2) == pytest.approx([49.698, 50.702]) and reach(-50.2, -50.2)[1] == pytest.approx(-49.698)
    assert reach(0, 0) == [-1, 1] and reach(50.2, 50.4) == pytest.approx([50.2, 50.4])
    assert page.wrong == []


@pytest.mark.verify
def test_ten_tabs(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    tabs = [page, *(page.context.new_page() for _ in range(9))]
    for tab in tabs:
        tab.goto(window.url + "/loop?name=FIC0", wait_until="commit")
    for tab in tabs:
        tab.get_by_text(re.compile("^PV of ")).wait_for()
        assert tab.locator(".one").inner_text() == "2.40 %"


@pytest.mark.verify
def test_the_overview_takes_what_changes(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    page.wait_for_function("document.querySelectorAll('.ag-center-cols-container .ag-row').length === 3")
    window.say("one less")
    page.wait_for_function("document.querySelectorAll('.ag-center-cols-container .ag-row').length === 2")
    window.say("all")
    page.wait_for_function("document.querySelectorAll('.ag-center-cols-container .ag-row').length === 3")
    assert page.wrong == []


def test_detections_are_drawn_before_and_under_compensation(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    page.get_by_role("button", name="Width over time").click()
    page.wait_for_selector(".wide-dialog [data-drawn]")
    told = page.evaluate("fetch('/api/loops/FIC0/detections').then((reply) => reply.json())")
    under = sum(told["compensated"])
    assert under == 2 and len(told["time"]) > 5
    drawn = """() => getElement(Number(document.querySelector('.wide-dialog .chart').id.slice(1))).chart.getOption()
      .series.map((one) => one.data.length)"""
    n = len(told["time"])
    assert page.evaluate(drawn)[:2] == [n - under, under] and page.wrong == []


@pytest.mark.verify
def test_step_test(browser: Any, window: Window, tmp_path: Path) -> None:
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    page.get_by_role("button", name="Step test").click()
    now = page.locator("li[aria-current=step]")
    now.get_by_text("Put the controller in manual while the load is calm").wait_for()
    page.get_by_text("in automatic all the time").wait_for()
    page.get_by_role("button", name="From a file").click()
    page.get_by_text("A recording: CSV, Excel, OpenDocument, JSON, HTML, Parquet, Arrow").wait_for()  # was four of them
    page.get_by_label("column of PV").fill("flow")
    page.get_by_label("column of OP").fill("valve")
    path = tmp_path / "test.csv"
    pv, op = by_hand()
    path.write_text("s,flow,valve\n" + "".join(f"{k},{pv[k]},{op[k]}\n" for k in range(len(pv))))
    page.set_input_files(".q-uploader input", path)
    page.get_by_text("no time column among: s, flow, valve").wait_for()
    page.get_by_label("column of time").fill("s")
    page.get_by_text("all of it was made in manual").click()
    page.set_input_files(".q-uploader input", path)
    page.get_by_text(re.compile(r"The gap is 1\.98")).wait_for()
    assert page.locator(".wide-dialog canvas").count() == 1 and page.wrong == []


def test_a_viewer_has_no_buttons_of_others(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    fit = page.get_by_role("button", name="Fit now")
    fit.wait_for()
    assert fit.get_attribute("aria-disabled") == "true" or fit.is_disabled()
    page.get_by_role("button", name="Parameters").click()
    page.get_by_text("needs the role engineer").last.wait_for()
    assert page.get_by_label("kp", exact=True).get_attribute("readonly") is not None


def test_a_double_click_is_one_command(browser: Any, window: Window) -> None:
    """Regression: a fit was asked for twice, a repair noted twice, and two guided tests begun."""
    page = logged_in(browser, window, "eve")
    page.goto(window.url + "/loop?name=FIC1")
    with Reader(window.folder) as reader:
        page.get_by_role("button", name="Fit now").dblclick()
        page.get_by_text("FIC1 is fitted as soon as").wait_for()
        page.wait_for_timeout(500)
        assert [row["command"] for row in reader.commands("FIC1")] == ["fit"]
        page.get_by_role("button", name="Note a repair").click()
        page.get_by_label("What was done").fill("new stem")
        page.get_by_role("button", name="Note it").dblclick()
        page.get_by_text("new stem").wait_for()
        page.wait_for_timeout(500)
        assert len(reader.repairs("FIC1")) == 1
    page.get_by_role("button", name="Parameters").dblclick()
    page.get_by_text("Who changed what, when").first.wait_for()
    page.wait_for_timeout(1000)
    assert page.locator(".wide-dialog").count() == 1  # there were two, one behind the other
    assert page.get_by_text("Refused").count() == 0 and page.wrong == []


@pytest.mark.verify
def test_a_parameter_by_keyboard_and_two_engineers(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "eve", color_scheme="dark")
    assert "body--dark" in page.locator("body").get_attribute("class")
    page.goto(window.url + "/loop?name=FIC0")
    button = page.get_by_role("button", name="Parameters")
    button.focus()
    page.keyboard.press("Enter")
    page.get_by_label("kp", exact=True).fill("3")
    page.get_by_role("button", name="Set what is changed").click()
    page.get_by_text("Set: kp.").wait_for()
    page.get_by_text("Who changed what, when").wait_for(state="hidden")
    page.wait_for_timeout(1000.0 * DOUBLE)  # sooner it is the second click of a double one
    button.click()
    page.get_by_text("kp 2 → 3").wait_for()
    field = page.get_by_label("n", exact=True)
    assert field.input_value() == "3"
    window.say("change")  # somebody else makes n 5
    field.fill("7")
    page.get_by_role("button", name="Set what is changed").click()
    page.get_by_text("somebody else has changed it").wait_for()
    page.keyboard.press("Escape")
    page.wait_for_timeout(1000.0 * DOUBLE)
    button.click()
    field.fill("4")
    page.get_by_role("button", name="Set what is changed").click()
    page.get_by_text(re.compile("must be odd")).wait_for()


def test_pv_and_op_of_one_time_are_below_each_other(browser: Any, window: Window) -> None:
    """Regression: a time at the right end made the grid of OP up to 2 % narrower than that of PV."""
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    page.wait_for_function(f"{CHART}.getOption().series[2].data.length > 9")
    sides = f"""() => {{
      const end = 1000 * 3600 * Math.round(Date.now() / 3600000);
      const axis = {{ min: end - 900000, max: end }};
      {CHART}.setOption({{ xAxis: [axis, axis] }});
      const grid = (i) => {CHART}.getModel().getComponent('grid', i).coordinateSystem.getRect();
      return [0, 1].map((i) => [grid(i).x, grid(i).width]);
    }}"""
    above, below = page.evaluate(sides)
    assert above == below


def test_a_decimal_comma_is_one(browser: Any, window: Window) -> None:
    """Regression: the browser dropped the comma, and 0,5 was 5: a gap ten times as wide was compensated."""
    page = logged_in(browser, window, "eve")
    page.goto(window.url + "/loop?name=FIC0")
    page.get_by_role("button", name="Compensate").click()
    field = page.get_by_label("typed width")
    field.clear()
    field.press_sequentially("0,5")
    page.get_by_text("The width is 0.500 %, which a person typed.").wait_for()
    field.fill("1,250")  # in one country 1.25, in another 1250
    page.get_by_text("'1,250' may be 1.250 or 1250; write one of them").first.wait_for()
    assert page.get_by_role("button", name="Use this width").is_disabled()
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Parameters").click()
    page.get_by_label("kp", exact=True).fill("two")  # an empty field is the default, this is none
    page.get_by_role("button", name="Set what is changed").click()
    page.get_by_text("Nothing is changed: kp: 'two' is no number; write one such as 1.5").wait_for()
    assert page.wrong == []


@pytest.mark.verify
def test_a_service_with_a_full_disk_says_so(browser: Any, window: Window) -> None:
    """Its last state in the database does not tell: the window said that no command is answered."""
    page = logged_in(browser, window, "vera")
    window.say("full")
    page.get_by_text("The service cannot write: glapp.db cannot be written: database or disk is full.").wait_for()
    page.get_by_text("make room on its disk").wait_for()
    window.say("room")
    page.get_by_role("alert").filter(has_text="The service").wait_for(state="hidden")
    assert page.wrong == []


@pytest.mark.verify
def test_compensation_is_told_before(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "eve")
    page.goto(window.url + "/loop?name=FIC0")
    page.get_by_role("button", name="Compensate").click()
    enable = page.get_by_role("button", name="Enable compensation of FIC0")
    enable.wait_for()
    page.get_by_text("Press “Use this width” first.").wait_for()
    assert enable.is_disabled()
    page.get_by_text("The width is 2.15 %, the lower limit of the fit").wait_for()
    page.get_by_label("typed width").fill("0")
    page.get_by_text("typed", exact=True).click()
    page.get_by_text("No width is given").first.or_(page.get_by_text("The width is 0")).first.wait_for()
    # By keyboard a width that is used leads on to the test of switching off; the focus began again at the top.
    page.get_by_label("typed width").fill("1.5")
    page.get_by_text("The width is 1.50 %, which a person typed.").wait_for()
    page.get_by_role("button", name="Use this width").focus()
    page.keyboard.press("Enter")
    page.get_by_text("First test switching off: nothing is enabled before that was seen.").wait_for()
    page.wait_for_function("document.activeElement.innerText === 'Test switching off'")
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Parameters").click()
    page.get_by_label("comp_size", exact=True).fill("1")
    page.get_by_role("button", name="Set what is changed").click()
    page.get_by_text("Set: comp_size.").wait_for()
    page.get_by_role("button", name="Compensate").click()
    page.get_by_text("Whenever OP has turned round, u_FF goes to the other side: 0.600 % in all").wait_for()
    window.say(
        "share 0.7"
    )  # somebody else sets comp_share: the dialog goes with it; it showed 80 % until it was closed
    page.get_by_text("70 % of it is compensated").wait_for()
    page.get_by_text("by zero crossings").click()  # what somebody is about to choose stays
    page.get_by_text("typed", exact=True).click()
    page.get_by_text("First test switching off: nothing is enabled before that was seen.").wait_for()
    assert enable.is_disabled(), "it looked active, and the service refused it"
    window.say("watchdog seen")
    page.get_by_text("✓ Seen").wait_for()
    page.get_by_text("typed", exact=True).click()
    window.say("share 0.6")
    enable.click()
    page.get_by_text(re.compile("Refused: .*comp_share.*somebody else has changed it")).wait_for()
    page.goto(window.url + "/loop?name=FIC1")
    page.get_by_role("button", name="Compensate").click()
    page.get_by_text("no node for u_FF").wait_for()


@pytest.mark.verify
def test_a_login_that_is_over_leads_to_the_login_page(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    page.wait_for_selector(".one")
    window.say("expire")
    page.get_by_text("Your login is over").wait_for()
    page.fill("#user", "vera")
    page.fill("#password", PASSWORDS["vera"])
    page.keyboard.press("Enter")
    page.wait_for_selector(".one")  # at the same loop; it was the overview
    assert page.url.endswith("/loop?name=FIC0")
    window.say("expire")
    page.get_by_text("Your login is over").wait_for()
    page.goto(window.url + "/events")
    assert page.url.endswith("/login")


@pytest.mark.verify
def test_a_command_while_strangers_hold_connections(browser: Any, window: Window) -> None:
    """300 half-sent requests shut the window for as long as they were held."""
    from bench.half_open import running

    with running("-m", "bench.half_open", "attack", window.url.rpartition(":")[2], "300") as child:
        assert child.stdout is not None and child.stdout.readline()  # they are there
        context = browser.new_context()
        context.set_default_timeout(LONGEST)
        page = context.new_page()
        page.goto(window.url)
        page.fill("#user", "eve")
        page.fill("#password", PASSWORDS["eve"])
        page.keyboard.press("Enter")
        page.wait_for_selector(".ag-row")
        page.goto(window.url + "/loop?name=FIC2")
        page.get_by_role("button", name="Fit now").click()
        page.get_by_text("FIC2 is fitted as soon as").wait_for()


@pytest.mark.verify
def test_a_slow_network(browser: Any, window: Window) -> None:
    """400 ms there and back, 50 kB/s: all comes later, and nothing is lost or asked twice."""
    page = logged_in(browser, window, "eve")
    page.goto(window.url + "/loop?name=FIC0")
    under_way(page)
    told = page.context.new_cdp_session(page)
    told.send("Network.enable")
    slow = {"offline": False, "latency": 400, "downloadThroughput": 50_000, "uploadThroughput": 50_000}
    told.send("Network.emulateNetworkConditions", slow)
    page.goto(window.url + "/")
    page.wait_for_selector(".ag-row")
    page.goto(window.url + "/loop?name=FIC0")
    page.get_by_text(re.compile("^PV of ")).wait_for()
    assert page.locator(".one").inner_text() == "2.40 %"
    page.get_by_role("button", name="Fit now").click()
    page.get_by_text("FIC0 is fitted as soon as").wait_for()
    page.get_by_role("button", name="Width over time").click()
    page.wait_for_selector(".wide-dialog [data-drawn]")
    page.goto(window.url + "/events")
    page.locator(".ag-row", has_text="fit").first.wait_for()
    assert page.locator(".ag-center-cols-container .ag-row", has_text=re.compile("FIC0.*fit")).count() == 1
    assert page.wrong == []


@pytest.mark.verify
def test_a_window_that_is_started_again(browser: Any, tmp_path: Path) -> None:
    """A tab that was open meanwhile tells so, and leads to the login; after it the same loop is there."""
    window = Window(tmp_path)
    try:
        page = logged_in(browser, window, "eve")
        page.goto(window.url + "/loop?name=FIC0")
        page.get_by_text(re.compile("^PV of ")).wait_for()
        window.end()
        page.get_by_text("Connection lost").wait_for()
        assert page.locator(".one").inner_text() == "2.40 %"  # what is known is still there
        window.start_again()
        page.get_by_text("Your login is over").wait_for()
        page.fill("#user", "eve")
        page.fill("#password", PASSWORDS["eve"])
        page.keyboard.press("Enter")
        page.locator(".one", has_text="2.40 %").wait_for()
        assert page.url.endswith("/loop?name=FIC0")
    finally:
        window.end()


@pytest.mark.verify
def test_a_service_that_is_gone(browser: Any, tmp_path: Path) -> None:
    window = Window(tmp_path)
    try:
        page = logged_in(browser, window, "eve")
        page.goto(window.url + "/loop?name=FIC0")
        page.get_by_text(re.compile("^PV of ")).wait_for()
        window.say("gone")
        page.get_by_text("The service does not answer: no live values.").wait_for()
        page.get_by_text("not known", exact=True).wait_for()  # u_FF was shown as it last was
        assert page.locator(".v:not(.old)").count() == 0
        page.get_by_text(re.compile("The service has written nothing for 2 min")).wait_for()
        page.get_by_role("button", name="Fit now").click()
        page.get_by_text(re.compile("Not done: the service does not answer")).wait_for()
        window.say("no database")
        page.get_by_text(re.compile("The database cannot be read: .* holds no glapp.db")).wait_for()
        page.get_by_role("button", name="Width over time").click()
        page.locator(".q-notification__message", has_text="holds no glapp.db").wait_for()
        assert page.locator(".one").inner_text() == "2.40 %"  # what is known is still there
        assert page.wrong == []
        with pytest.raises(OSError):
            urllib.request.urlopen(urllib.request.Request(window.url + "/", headers={"Host": "evil.example"}))
    finally:
        window.end()


def test_no_line_is_drawn_across_a_break(browser: Any, window: Window) -> None:
    """Regression: the first value after a lost connection was joined to the last one before: it looked measured."""
    page = logged_in(browser, window, "vera")
    window.say("samples")
    page.goto(window.url + "/loop?name=FIC1")
    under_way(page)
    window.say("bad")  # regression: it had a half-period of 0 s whose SP had moved by 50 %
    page.get_by_text("No half-period is under way: SP or PV is bad.").wait_for()
    times = f"() => {CHART}.getOption().series[1].data.map(([t, x]) => x === null ? null : t / 1000)"
    page.wait_for_function(f"() => ({times})().length > 50")
    last = page.evaluate(times)[-1]
    window.say("break")
    page.wait_for_timeout(2000)
    assert page.evaluate(times)[-1] == last, "its sample is not there yet"
    window.say("after the break")
    page.wait_for_function(f"() => {{ const t = ({times})(); return t.at(-1) > {last} && t.includes(null); }}")
    assert page.wrong == []
