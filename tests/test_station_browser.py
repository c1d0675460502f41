"""The operator's window as a person meets it, in Chromium."""

import re
import shutil
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")
if CHROMIUM is None:
    pytest.skip("chromium is not installed", allow_module_level=True)
pytest.importorskip("nicegui")
sync_api = pytest.importorskip("playwright.sync_api")

from station_child import PASSWORDS  # noqa: E402

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("station in a browser")]
HERE = Path(__file__).parent


class Window:
    """A window in a process of its own, to which words are said."""

    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "station_child.py"), str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.url = self.heard()

    def heard(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def say(self, word: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(word + "\n")
        self.process.stdin.flush()
        assert self.heard() == word

    def end(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(20)


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Window]:
    one = Window(tmp_path_factory.mktemp("window"))
    yield one
    one.end()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        one = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield one
        one.close()


@pytest.fixture(autouse=True)
def _closed(browser: Any) -> Iterator[None]:
    """No tab of one test is open in the next."""
    yield
    for context in browser.contexts:
        context.close()


def logged_in(browser: Any, window: Window, name: str, **more: Any) -> Any:
    """A page of somebody, and what went wrong on it."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, **more)
    page = context.new_page()
    page.set_default_timeout(20_000)
    page.asked, page.wrong = [], []
    page.on("request", lambda request: page.asked.append(request.url))
    page.on("pageerror", lambda error: page.wrong.append(str(error)))
    page.on("console", lambda said: page.wrong.append(said.text) if said.type == "error" else None)
    page.goto(window.url)
    page.fill("#user", name)
    page.fill("#password", PASSWORDS[name])
    page.keyboard.press("Enter")
    page.wait_for_selector(".ag-row")
    return page


def test_overview_loop_and_events(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    row = page.locator(".ag-row", has_text="Backlash").first
    assert "2.40 % (2.15 to 3.11)" in row.inner_text() and "First" in row.inner_text()
    page.get_by_label("Search").fill("FIC0")
    page.wait_for_function("document.querySelectorAll('.ag-center-cols-container .ag-row').length === 1")
    with page.expect_download() as download:
        page.get_by_role("link", name="CSV").click()
    assert "FIC0" in Path(download.value.path()).read_text(encoding="utf-8")
    page.locator(".ag-cell[col-id=verdict]").first.click()
    page.keyboard.press("Enter")
    page.wait_for_selector(".one")
    assert page.locator(".one").inner_text() == "2.40 %"
    page.get_by_text("too short").or_(page.get_by_text("accepted")).first.wait_for()
    page.get_by_role("button", name="Graph").click()
    page.get_by_text("Each dot is a half-period").wait_for()
    assert page.locator(".wide-dialog canvas").count() == 1
    page.keyboard.press("Escape")
    page.get_by_role("link", name="Events").click()
    page.get_by_text("<b>so</b> late").wait_for()
    assert page.wrong == [] and {url.split("/")[2] for url in page.asked if "//" in url} == {window.url.split("/")[2]}


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
    page.get_by_role("button", name="Put a loop together").click()
    page.get_by_label("wires, one a line").fill("sp -> pid.sp")
    page.get_by_role("button", name="Build").click()
    page.get_by_text("connect it").wait_for()
    assert page.wrong == []


def test_a_tab_that_is_open_for_a_day_does_not_grow(browser: Any, window: Window) -> None:
    """A day of values, faster than they come; and nine more tabs beside it."""
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    page.wait_for_selector(".chart canvas")
    others = [page.context.new_page() for _ in range(9)]
    for other in others:
        other.goto(window.url + "/loop?name=FIC0", wait_until="commit")
    count = """() => {
      const id = Number(document.querySelector('.chart').id.slice(1));
      const begin = Date.now() + 1e6;
      for (let k = 0; k < 86400; k += 300) {
        const rows = [];
        for (let i = 0; i < 300; i++) rows.push([begin + 1000 * (k + i), 50, 50, 50]);
        glapp.append(id, rows, 900000);
      }
      return getElement(id).chart.getOption().series.map((one) => one.data.length);
    }"""
    assert page.evaluate(count) == [901, 901, 901]
    for other in others:
        other.get_by_text(re.compile("PV is ")).wait_for()
        assert other.locator(".one").inner_text() == "2.40 %"


def test_step_test(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    page.get_by_role("button", name="Step test").click()
    page.get_by_text("Put the controller in manual while the load is calm").wait_for()
    page.get_by_text("in automatic all the time").wait_for()


def test_a_viewer_has_no_buttons_of_others(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    fit = page.get_by_role("button", name="Fit now")
    fit.wait_for()
    assert fit.get_attribute("aria-disabled") == "true" or fit.is_disabled()
    page.get_by_role("button", name="Parameters").click()
    page.get_by_text("needs the role engineer").last.wait_for()
    assert page.get_by_label("kp", exact=True).get_attribute("readonly") is not None


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
    button.click()
    page.get_by_text("kp 2 → 3").wait_for()
    field = page.get_by_label("n", exact=True)
    assert field.input_value() == "3"
    window.say("change")  # somebody else makes n 5
    field.fill("7")
    page.get_by_role("button", name="Set what is changed").click()
    page.get_by_text("somebody else has changed it").wait_for()
    page.keyboard.press("Escape")
    button.click()
    field.fill("4")
    page.get_by_role("button", name="Set what is changed").click()
    page.get_by_text(re.compile("must be odd")).wait_for()


def test_compensation_is_told_before(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "eve")
    page.goto(window.url + "/loop?name=FIC0")
    page.get_by_role("button", name="Compensate").click()
    page.get_by_text("no node for u_FF").wait_for()


def test_nothing_hangs_over(browser: Any, window: Window) -> None:
    """13-inch laptop, tablet upright, and that laptop at 200 %."""
    page = logged_in(browser, window, "vera")
    for path in ("/", "/loop?name=FIC0", "/events", "/laboratory"):
        page.goto(window.url + path)
        page.wait_for_selector(".content h1, .content h2")
        for width, height in ((1280, 800), (768, 1024), (640, 400)):
            page.set_viewport_size({"width": width, "height": height})
            # A chart is as wide as before until it has seen that its place is narrower.
            fits = "document.documentElement.scrollWidth <= document.documentElement.clientWidth"
            page.wait_for_function(fits)


def test_a_login_that_is_over_leads_to_the_login_page(browser: Any, window: Window) -> None:
    page = logged_in(browser, window, "vera")
    page.goto(window.url + "/loop?name=FIC0")
    page.wait_for_selector(".one")
    window.say("expire")
    page.get_by_text("Your login is over").wait_for()
    page.goto(window.url + "/events")
    assert page.url.endswith("/login")


def test_a_service_that_is_gone(browser: Any, tmp_path: Path) -> None:
    window = Window(tmp_path)
    try:
        page = logged_in(browser, window, "eve")
        page.goto(window.url + "/loop?name=FIC0")
        page.get_by_text(re.compile(r"PV is \d")).wait_for()
        window.say("gone")
        page.get_by_text("The service does not answer: no live values.").wait_for()
        page.get_by_text(re.compile("The service has written nothing for 2 min")).wait_for()
        page.get_by_role("button", name="Fit now").click()
        page.get_by_text(re.compile("Not done: the service does not answer")).wait_for()
        window.say("no database")
        page.get_by_text(re.compile("The database cannot be read: .* holds no glapp.db")).wait_for()
        page.get_by_role("button", name="Graph").click()
        page.locator(".q-notification__message", has_text="holds no glapp.db").wait_for()
        assert page.locator(".one").inner_text() == "2.40 %"  # what is known is still there
        assert page.wrong == []
        with pytest.raises(OSError):
            urllib.request.urlopen(urllib.request.Request(window.url + "/", headers={"Host": "evil.example"}))
    finally:
        window.end()
