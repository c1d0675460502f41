"""How fast the window is, in Chromium: `python -m bench.station [overview | live]`.

overview: a folder with 5000 loops, and a year of detections of one of them; how long the overview and that graph
take. live: a simulated plant of 1000 loops at 1 Hz, `glapp watch` on it over OPC UA, and one loop's page; how old a PV
is when it is drawn. Browser, window, service and plant share this computer and its clock.
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
from glapp.service.door import Door as Server
from glapp.service.door import app_of as service_app
from glapp.service.memory import COLUMNS, Memory
from glapp.service.users import Users
from glapp.service.watch import Watch

LOOPS = 5000
A_DAY = 24
"""Detections of a day."""

PASSWORD = "only for the bench"


async def _serve(folder: Path) -> None:
    """A service that shows 5000 loops; nothing happens in it."""
    memory = Memory(folder)
    known = [Loop(name=f"FIC{i}", controller={"k": 0.5, "ti": 5}, op_span=(0, 100)) for i in range(LOOPS)]
    watch = Watch(known, memory)
    now = time.time()
    half = dict.fromkeys(COLUMNS, 1.0) | {"reason": 0, "mask": 0}
    halves = []
    for k in range(365 * A_DAY):
        at = now - 365 * 86400.0 + k * 86400.0 / A_DAY
        halves.append((1, k, *(half | {"t_start": at - 60.0, "t_end": at, "d": 1.0 + k % 17 / 50.0}).values(), 0))
    memory.add([], halves, [])
    Users(memory).put("eve", "engineer", PASSWORD, now)
    door = Server(service_app(watch, Users(memory)), "127.0.0.1", 0)
    (folder / "door").write_text(door.url, encoding="utf-8")
    opened = asyncio.ensure_future(door.open())
    while not opened.done():
        await asyncio.to_thread(memory.show, time.time(), json.dumps(watch.status()))
        await asyncio.sleep(5.0)


def _started(*words: str) -> tuple[subprocess.Popen[str], str]:
    """A `glapp station`, and where it is."""
    code = "from glapp.cli import main; main()"
    command = [sys.executable, "-c", code, "station", "--port", "0", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    line = process.stdout.readline()
    return process, line.removeprefix("The window is at ").strip().rstrip(".")


def _logged_in(page: Page, url: str, user: str, password: str) -> None:
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
        while not (Path(name) / "door").exists():
            time.sleep(0.5)
        time.sleep(5.0)
        window, url = _started("--data", name)
        try:
            _logged_in(page, url, "eve", PASSWORD)
            opened, drawn = [], []
            for _ in range(5):
                began = time.monotonic()
                page.goto(url + "/")
                page.wait_for_selector(".ag-row")
                opened.append(time.monotonic() - began)
            for _ in range(5):
                page.goto(url + "/loop?name=FIC0")
                button = page.get_by_role("button", name="Graph")
                button.wait_for()
                time.sleep(3.0)
                began = time.monotonic()
                button.click()
                page.wait_for_selector(".wide-dialog canvas")
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
  requestAnimationFrame(() => window.ages.push(Date.now() - points[points.length - 1][0]));
};
"""


def _live(page: Page) -> None:
    with TemporaryDirectory() as name:
        window, url = _started("--data", name, "--demo", "--loops", "1000")
        try:
            password = (Path(name) / "first-login.txt").read_text(encoding="utf-8").split("password ")[1].strip()
            time.sleep(30.0)
            _logged_in(page, url, "engineer", password)
            page.goto(url + "/loop?name=FIC101")
            page.get_by_role("button", name="Graph").wait_for()
            time.sleep(5.0)
            page.evaluate(_HEAR)
            time.sleep(60.0)
            ages: list[Any] = page.evaluate("window.ages")
            _times("age of a PV when it is drawn", [age / 1000.0 for age in ages])
        finally:
            window.terminate()
            window.wait(120)


def main(what: str) -> None:
    """Measure."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        {"overview": _overview, "live": _live}[what](page)
        browser.close()


if __name__ == "__main__":
    if sys.argv[1:2] == ["serve"]:
        asyncio.run(_serve(Path(sys.argv[2])))
    else:
        for one in sys.argv[1:] or ["overview", "live"]:
            main(one)
