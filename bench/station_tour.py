"""An engineer at `glapp station --demo` in Chromium: `python -m bench.station_tour FOLDER`.

The plant is five times as fast as usual (`--scan 0.2`). The level cycles by its gap. Its width is typed, the watchdog
tested, Compensate pressed; the window says how calm PV is then. After that the valve is repaired, which nobody tells
the compensation, until it is withdrawn. FOLDER gets pictures; what the window says is printed.
"""

from __future__ import annotations

import asyncio
import re
import shutil
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from asyncua import Client, ua
from playwright.sync_api import Browser, Page, TimeoutError, sync_playwright

from glapp.service.compensation import TEXT_OF_STATE
from glapp.service.connection import read_connection
from glapp.service.plant import NAMESPACE

from .station import logged_in, started

LEVEL = "LIC104"
CALM = "of SP half of the time"
TOO_MUCH = [f"It is off. {TEXT_OF_STATE[why]}" for why in ("over_compensated", "worse")]
LONGEST = 900.0
"""Longest wait on a busy machine [s]."""


@contextmanager
def _window(browser: Browser) -> Iterator[tuple[Page, str, Path]]:
    """A demo, and a page of it on which the engineer is logged in."""
    with TemporaryDirectory() as name:
        window, url = started("station", "--demo", "--port", "0", "--data", name, "--scan", "0.2")
        try:
            password = (Path(name) / "first-login.txt").read_text(encoding="utf-8").split("password ")[1].strip()
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            logged_in(page, url, "engineer", password)
            page.set_default_timeout(1000.0 * LONGEST)
            yield page, url, Path(name)
        finally:
            window.terminate()
            window.wait(LONGEST)


def _settle(page: Page) -> None:
    """Waits until everything after the first picture is there: the library has no event for that."""
    page.wait_for_load_state("networkidle")
    time.sleep(1.5)


def _repaired(data: Path, loop: str) -> None:
    """Have the plant's valve repaired, by the plant's own method."""

    async def call() -> None:
        connection = read_connection(data / "demo.toml")
        assert connection is not None
        async with Client(connection.url) as client:
            index = await client.get_namespace_index(NAMESPACE)
            method = client.get_node(ua.NodeId("Fault", index))
            text = await client.nodes.objects.call_method(method, "repaired", loop, 1e9)
            assert text == "", text

    with ThreadPoolExecutor(1) as one:  # the browser's own loop runs in this thread
        one.submit(asyncio.run, call()).result()


class _Engineer:
    """Person who presses the buttons of one loop, and records messages with their times."""

    def __init__(self, page: Page, url: str, out: Path, loop: str) -> None:
        self.page, self.url, self.out, self.loop = page, url, out, loop
        self.begun = time.monotonic()

    def note(self, text: str) -> None:
        print(f"  {time.monotonic() - self.begun:4.0f} s  {text}", flush=True)

    def opened(self, button: str) -> None:
        """The loop's page anew, and a dialog of it; once more where a machine that is busy did not hear the button."""
        while True:
            self.page.goto(f"{self.url}/loop?name={self.loop}")
            self.page.get_by_text(re.compile("^PV of ")).wait_for()
            try:
                self.page.get_by_role("button", name=button, exact=True).click(timeout=30_000)
                self.page.locator(".wide-dialog").wait_for(timeout=30_000)
            except TimeoutError:
                self.note(f"{button}: no dialog in 30 s")
            else:
                return

    def pressed(self, button: str, *text: str) -> str:
        """Press a button of the dialog; gives the one of these texts that appears then."""
        self.page.get_by_role("button", name=button).click()
        answers = self.page.get_by_text(text[0])
        for one in text[1:]:
            answers = answers.or_(self.page.get_by_text(one))
        answers.first.wait_for()
        text = answers.first.inner_text().splitlines()[0]
        self.note(f"{button}: {text}")
        return text

    def enabled(self) -> None:
        """Press Compensate until it is enabled; the obstacles are noted."""
        self.opened("Compensate")
        while "Refused" in self.pressed("Enable compensation", f"{self.loop} is compensated.", "Refused: "):
            time.sleep(5.0)
            self.opened("Compensate")

    def until(self, *texts: str) -> str:
        """Look into the dialog of the compensation until one of these texts is there; gives the dialog's text.

        A plant that was kept waiting by a machine that is busy has not followed u_FF: then it is enabled again.
        """
        began = time.monotonic()
        while time.monotonic() - began < LONGEST:
            self.opened("Compensate")
            text: str = self.page.inner_text(".wide-dialog")
            if any(text in text for text in texts):
                return text
            if "It is off" in text:
                self.note(_lines(text, "It is off"))
                self.enabled()
            time.sleep(2.0)
        raise SystemExit(f"after {LONGEST:g} s the window has not said any of {texts}")

    def picture(self, name: str) -> None:
        _settle(self.page)
        self.page.screenshot(path=self.out / f"{name}.png")


def _lines(text: str, *words: str) -> str:
    return " ".join(line for line in text.splitlines() if any(word in line for word in words))


def _story(browser: Browser, out: Path) -> None:
    with _window(browser) as (page, url, data):
        eve = _Engineer(page, url, out, LEVEL)
        eve.note("logged in")
        time.sleep(200.0)  # 25 Ti: how calm PV was before must have been seen
        eve.opened("Parameters")
        page.get_by_label("comp_size", exact=True).fill("2")
        eve.pressed("Set what is changed", "Set: ")
        eve.opened("Compensate")
        eve.picture("compensate-before")
        page.get_by_role("button", name="Close").click()
        eve.opened("Compensate")
        eve.pressed("Test switching off", "The test is under way")
        page.goto(f"{url}/events")
        page.get_by_text(re.compile("took u_FF of|drill_failed")).first.wait_for()
        eve.note(page.get_by_text(re.compile("took u_FF of|drill_failed")).first.inner_text())
        eve.enabled()
        text = eve.until(CALM)
        eve.note(_lines(text, CALM, "u_FF is"))
        eve.picture("compensate-calmer")
        page.get_by_role("button", name="Close").click()
        eve.picture("loop-calmer")
        _repaired(data, LEVEL)
        eve.note("the valve is repaired")
        text = eve.until("Warning: ", *TOO_MUCH)
        if "Warning: " in text:
            eve.note(_lines(text, "Warning: ", CALM))
            eve.picture("compensate-warned")
            text = eve.until(*TOO_MUCH)
        eve.note(_lines(text, "It is off"))
        eve.picture("compensate-withdrawn")
        page.goto(f"{url}/events")
        page.get_by_label("Search").fill(LEVEL)
        eve.picture("events-story")
        for row in page.locator(".ag-center-cols-container .ag-row").all()[:10]:
            print("  event:", " | ".join(row.inner_text().splitlines()))


def main(out: Path) -> None:
    """Make the tour."""
    out.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        _story(browser, out)
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
