"""A gap is proved in the window: an open answer, the planned test, the guided test, *found*, the repair, after it."""

import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("nicegui")

from station_child import PASSWORDS
from station_window import LONGEST, Child

pytestmark = [pytest.mark.verify, pytest.mark.by_the_clock, pytest.mark.xdist_group("proof in a browser")]

TEST_TAKES = 300
"""A guided test is over by then, on any machine [s]."""

PLAN_TAKES = 600
"""A plan is made by then [s]."""


class Plant(Child):
    """A service with its plant: its address, and a person at its controller."""

    def __init__(self, folder: Path) -> None:
        super().__init__("proof_child.py", folder)
        self.url, self.confidence = self.heard().split()


@pytest.fixture  # a second try begins with a plant of its own
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    one = Plant(tmp_path_factory.mktemp("proof"))
    yield one
    one.end()


def entered(browser: Any, plant: Plant) -> Any:
    context = browser.new_context(viewport={"width": 1280, "height": 1000})
    context.set_default_timeout(LONGEST)
    page = context.new_page()
    page.wrong = []
    page.on("pageerror", lambda error: page.wrong.append(str(error)))
    page.goto(plant.url)
    page.fill("#user", "olaf")
    page.fill("#password", PASSWORDS["olaf"])
    page.keyboard.press("Enter")
    page.locator(".ag-row").first.wait_for()
    return page


def guided(page: Any, plant: Plant) -> str:
    """Follow the card's instructions until the test has ended; gives its last text."""
    card = page.locator(".guided")
    said, until = "", time.monotonic() + TEST_TAKES
    while time.monotonic() < until:
        text = card.inner_text()
        if "Guided step test:" in text:
            plant.say("auto")
            return text
        # In one look: an instruction that goes while it is read would be waited for.
        say = card.evaluate("card => card.querySelector('.say')?.innerText ?? ''")
        if say != said and say.startswith("Put the controller in manual"):
            plant.say("manual")
        if say != said and (found := re.match(r"Move OP (?:up|down) to ([\d.]+)", say)):
            plant.say(f"op {found[1]}")
        said = say
        page.wait_for_timeout(300)
    raise AssertionError(f"the test did not end: {card.inner_text()}")


def test_from_open_to_found_to_repaired(browser: Any, plant: Plant) -> None:
    assert plant.confidence in ("likely", "cannot_tell")
    page = entered(browser, plant)
    shown = page.locator(".ag-row[row-index='0']")
    shown.get_by_text(re.compile("Likely a gap|Cannot tell")).wait_for()
    page.get_by_role("link", name="FIC7").click()
    page.get_by_text("Which test would decide").wait_for()
    page.get_by_role("button", name="Plan a test").click()
    for label, value in (
        ("OP from", "30"),
        ("OP to", "70"),
        ("PV from", "25"),
        ("PV to", "55"),
        ("Longest test", "30"),
    ):
        page.get_by_label(label).fill(value)
    page.get_by_role("button", name="Plan the test").click()
    begin = page.get_by_role("button", name="Begin the guided test")
    begin.wait_for(timeout=1000 * PLAN_TAKES)
    assert re.search(r"It decides in \d+ %", page.locator("body").inner_text())

    begin.click()
    page.locator(".guided").get_by_text("Put the controller in manual").wait_for()
    # What to do stands next to the signals, on the first screen; it was below everything else.
    page.wait_for_function("document.querySelector('.guided').getBoundingClientRect().top < 150 && scrollY == 0")
    ended = guided(page, plant)
    assert "There is a gap" in ended and "decided" in ended.partition("\n")[0]
    page.wait_for_function("document.querySelector('.guided').getBoundingClientRect().top > 300")
    page.get_by_text(re.compile("FIC7 has a dead band of")).first.wait_for(timeout=1000 * TEST_TAKES)
    assert "Backlash" in page.locator("body").inner_text()

    plant.say("repair")
    page.get_by_role("button", name="Note a repair").click()
    page.get_by_label("When").fill(time.strftime("%Y-%m-%d %H:%M", time.localtime(time.time() + 60)))
    page.get_by_label("What was done").fill("new linkage")
    page.get_by_role("button", name="Note it").click()
    page.get_by_text("new linkage").wait_for()
    page.wait_for_timeout(max(0.0, 61.0 - time.time() % 60.0) * 1000)

    page.get_by_role("button", name="Begin the guided test").click()
    page.locator(".guided").get_by_text("Put the controller in manual").wait_for()
    ended = guided(page, plant)
    assert "There is no gap" in ended
    page.get_by_text(re.compile("no dead band")).first.wait_for(timeout=1000 * TEST_TAKES)
    page.get_by_role("button", name="Before and after").click()
    table = page.locator(".q-dialog table")
    table.wait_for()
    gap = table.locator("tr", has_text="Gap").inner_text()
    # A reversal that PV does not answer may decide by a lower limit alone.
    assert re.search(r"(\d.*\(.* to .*\)|> \d).*<", gap.replace("\n", " ")), gap
    assert not page.wrong
    page.context.close()
