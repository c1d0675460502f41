"""Speed of the window, in Chromium: `python -m bench.station [overview | live | lab]`.

overview: a folder with 5000 loops, and a year of detections of one of them; how long the overview and that graph
take. live: a simulated plant of 1000 loops at 1 Hz, `glapp watch` on it over OPC UA, and one loop's page; how old a PV
is when it is drawn. lab: how late a scan of the laboratory is in real time, with its page open. Browser, window,
service and plant share this computer and its clock.
"""

from __future__ import annotations

import asyncio
import json
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from playwright.sync_api import Page, sync_playwright

from glapp import Loop
from glapp.service.api import ApiServer
from glapp.service.api import app_of as service_app
from glapp.service.monitor import Monitor
from glapp.service.plant import free_port
from glapp.service.store import COLUMNS, Store
from glapp.service.users import Users
from glapp.station.lab import Lab

LOOPS = 5000
A_DAY = 24
"""Detections of a day."""

PASSWORD = "only for the bench"


async def _serve(folder: Path) -> None:
    """A service that shows 5000 loops; nothing happens in it."""
    store = Store(folder)
    known = [Loop(name=f"FIC{i}", controller={"k": 0.5, "ti": 5}, op_span=(0, 100)) for i in range(LOOPS)]
    monitor = Monitor(known, store)
    now = time.time()
    half = dict.fromkeys(COLUMNS, 1.0) | {"reason": 0, "mask": 0}
    halves = []
    for k in range(365 * A_DAY):
        at = now - 365 * 86400.0 + k * 86400.0 / A_DAY
        halves.append((1, k, *(half | {"t_start": at - 60.0, "t_end": at, "d": 1.0 + k % 17 / 50.0}).values(), 0))
    store.add([], halves, [])
    Users(store).put("eve", "engineer", PASSWORD, now)
    api = ApiServer(service_app(monitor, Users(store)), "127.0.0.1", 0)
    (folder / "api-url").write_text(api.url, encoding="utf-8")
    opened = asyncio.ensure_future(api.open())
    try:
        while not opened.done():
            await asyncio.to_thread(store.show, time.time(), json.dumps(monitor.status()))
            await asyncio.sleep(5.0)
    finally:
        opened.cancel()
        await asyncio.gather(opened, return_exceptions=True)


def started(*words: str) -> tuple[subprocess.Popen[str], str]:
    """A command of glapp, and the address that it says first."""
    code = "from glapp.cli import main; main()"
    process = subprocess.Popen([sys.executable, "-c", code, *words], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    line = process.stdout.readline()
    return process, line.strip().rstrip(".").rpartition(" ")[2]


def logged_in(page: Page, url: str, user: str, password: str) -> None:
    """Log in, and wait for the overview."""
    page.set_default_timeout(60_000)
    page.goto(url)
    page.fill("#user", user)
    page.fill("#password", password)
    page.keyboard.press("Enter")
    page.wait_for_selector(".ag-row")


def _times(what: str, seconds: list[float]) -> None:
    ordered = sorted(seconds)
    most = ordered[min(len(ordered) - 1, round(0.95 * len(ordered)))]
    print(f"{what}: median {statistics.median(ordered):.2f} s, 95 % within {most:.2f} s, of {len(ordered)}")


def _overview(page: Page) -> None:
    with TemporaryDirectory() as name:
        service = subprocess.Popen([sys.executable, "-m", "bench.station", "serve", name])
        while not (Path(name) / "api-url").exists():
            time.sleep(0.5)
        window, url = started("station", "--port", "0", "--data", name)
        try:
            logged_in(page, url, "eve", PASSWORD)
            opened, drawn = [], []
            for _ in range(5):
                began = time.monotonic()
                page.goto(url + "/")
                page.wait_for_selector(".ag-row")
                opened.append(time.monotonic() - began)
            for _ in range(5):
                page.goto(url + "/loop?name=FIC0")
                page.wait_for_selector("table.plain")  # the last of the page that comes by itself
                button = page.get_by_role("button", name="Width over time")
                began = time.monotonic()
                button.click()
                page.wait_for_selector(f".wide-dialog [data-drawn='{365 * A_DAY}']")
                page.evaluate(_PAINTED)
                drawn.append(time.monotonic() - began)
            _times(f"overview of {LOOPS} loops", opened)
            _times(f"graph of {365 * A_DAY} detections", drawn)
        finally:
            for process in (window, service):
                process.terminate()
                process.wait(60)


_HEAR = """
window.ages = []; const append = glapp.append;
glapp.append = (id, points, keep) => {
  append(id, points, keep);
  requestAnimationFrame(() => setTimeout(() => window.ages.push(Date.now() - points[points.length - 1][0])));
};
"""

_PAINTED = "new Promise((done) => requestAnimationFrame(() => setTimeout(done)))"


def _live(page: Page) -> None:
    with TemporaryDirectory() as name:
        folder = Path(name)
        settings = folder / "plant.toml"
        words = ("--loops", "1000", "--port", str(free_port()), "--history", "0", "--settings", str(settings))
        running = [started("plant", *words)[0]]
        text = settings.read_text(encoding="utf-8")
        settings.write_text(text.replace("[opcua]", "[opcua]\ninterval = 0.5"), encoding="utf-8")
        try:
            running.append(started("watch", "run", str(settings), "--data", name, "--port", "0")[0])
            window, url = started("station", "--port", "0", "--data", name)
            running.append(window)
            password = (folder / "first-login.txt").read_text(encoding="utf-8").split("password ")[1].strip()
            logged_in(page, url, "engineer", password)
            page.goto(url + "/loop?name=FIC101")
            page.wait_for_selector(".half:not(:empty)")
            page.evaluate(_HEAR)
            time.sleep(60.0)
            ages: list[Any] = page.evaluate("window.ages")
            _times("age of a PV when it is drawn", [age / 1000.0 for age in ages])
        finally:
            for process in reversed(running):
                process.terminate()
                process.wait(120)


async def _lab_window(folder: Path) -> None:
    """A window whose laboratory notes when each scan is made, until its stdin is closed."""
    from glapp.station.app import app_of
    from glapp.station.client import ApiClient
    from glapp.station.pages import Station
    from glapp.station.view import View

    made: list[float] = []
    advance = Lab.advance

    def noted(self: Lab, elapsed: float) -> None:
        before = round(self.t / self.project.h)
        advance(self, elapsed)
        now = time.monotonic()
        made.extend(now - k * self.project.h for k in range(before, round(self.t / self.project.h)))

    Lab.advance = noted  # type: ignore[method-assign]
    serving = asyncio.ensure_future(_serve(folder))
    while not (folder / "api-url").exists():
        await asyncio.sleep(0.1)
    window = ApiServer(app_of(Station(View(folder), ApiClient(folder)), ("127.0.0.1",), secure=False), "127.0.0.1", 0)
    opened = asyncio.ensure_future(window.open())
    print(f"The window is at {window.url}.", flush=True)
    await asyncio.to_thread(sys.stdin.readline)
    begin = min(made)  # the scan that was late by least
    print(json.dumps([one - begin for one in made]), flush=True)
    for task in (opened, serving):
        task.cancel()
    await asyncio.gather(opened, serving, return_exceptions=True)


def _lab(page: Page) -> None:
    with TemporaryDirectory() as name:
        command = [sys.executable, "-m", "bench.station", "laboratory", name]
        window = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert window.stdout is not None and window.stdin is not None
        url = window.stdout.readline().strip().rstrip(".").rpartition(" ")[2]
        logged_in(page, url, "eve", PASSWORD)
        page.goto(url + "/laboratory")
        page.wait_for_selector(".ag-row")
        time.sleep(60.0)
        window.stdin.write("enough\n")
        window.stdin.flush()
        late = json.loads(window.stdout.readline())
        _times("a scan of the laboratory at 1 × is late by", late)
        print(f"  the latest {max(late):.3f} s")
        window.wait(60)


def main(what: str) -> None:
    """Measure."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        {"overview": _overview, "live": _live, "lab": _lab}[what](page)
        browser.close()


if __name__ == "__main__":
    if sys.argv[1:2] == ["serve"]:
        asyncio.run(_serve(Path(sys.argv[2])))
    elif sys.argv[1:2] == ["laboratory"]:
        asyncio.run(_lab_window(Path(sys.argv[2])))
    else:
        for one in sys.argv[1:] or ["overview", "live", "lab"]:
            main(one)
