"""Setup of the window's tests in Chromium: a window in a process of its own, a browser, and a login."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")
HERE = Path(__file__).parent
LONGEST = 60_000
"""Longest wait, on any machine [ms]."""


class Child:
    """A program of the tests in a process of its own, which answers each word with the word when it has obeyed."""

    def __init__(self, program: str, *words: object) -> None:
        command = [sys.executable, str(HERE / program), *map(str, words)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

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
        self.process.wait(LONGEST / 1000)


class Window(Child):
    """A window, with commands to it."""

    def __init__(self, folder: Path, port: int = 0) -> None:
        self.folder = folder
        self.known: dict[object, Any] = {}
        self._start(port)

    def _start(self, port: int) -> None:
        super().__init__("station_child.py", self.folder, port)
        self.url = self.heard()

    def start_again(self) -> None:
        """Starts the window again at the same address, as a service that is restarted."""
        self._start(int(self.url.rpartition(":")[2]))


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Window]:
    one = Window(tmp_path_factory.mktemp("window"))
    yield one
    one.end()


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        one = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield one
        one.close()


@pytest.fixture
def browser(chromium: Any) -> Iterator[Any]:
    """A browser; no tab of one test is open in the next."""
    yield chromium
    for context in chromium.contexts:
        context.close()


def logged_in(browser: Any, window: Window, name: str, **more: Any) -> Any:
    """A page of somebody, and what went wrong on it."""
    from station_child import PASSWORDS

    key = (name, *more.items())
    state = window.known.get(key)
    context = browser.new_context(viewport={"width": 1280, "height": 800}, storage_state=state, **more)
    context.set_default_timeout(LONGEST)
    page = context.new_page()
    page.asked, page.wrong = [], []
    page.on("request", lambda request: page.asked.append(request.url))
    page.on("pageerror", lambda error: page.wrong.append(str(error)))
    page.on("console", lambda message: page.wrong.append(message.text) if message.type == "error" else None)
    page.goto(window.url)
    if page.locator("#user").count():  # once, and again where a test has ended the session
        page.fill("#user", name)
        page.fill("#password", PASSWORDS[name])
        page.keyboard.press("Enter")
    page.wait_for_selector(".ag-row")
    window.known[key] = context.storage_state()
    return page
