"""A tour of `glapp station --demo` in Chromium: `python -m bench.station_tour FOLDER [pages | compensation | wear]`.

pages: every page and dialog as a picture, light and dark, on a laptop and on a tablet held upright; in the laboratory
the loop of 6.5, and every variable of it changed while it runs. compensation: a level with a gap, a scan each 0.2 s,
compensated by half of its gap, and then by far too much; what the window says of both. wear: twenty days behind the
plant, of a valve that wears. FOLDER gets the pictures; what the window says is printed.
"""

from __future__ import annotations

import re
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

from .station import logged_in, started

SIZES = {"laptop": (1280, 800), "tablet": (768, 1024)}
DIALOGS = ("Graph", "Parameters", "Compensate", "Phase plot", "Step test")
LEVEL = "LIC104"


@contextmanager
def _window(browser: Browser, *words: str, **more: Any) -> Iterator[tuple[Page, str]]:
    """A demo, and a page of it on which the engineer is logged in."""
    with TemporaryDirectory() as name:
        window, url = started("station", "--demo", "--port", "0", "--data", name, *words)
        try:
            password = (Path(name) / "first-login.txt").read_text(encoding="utf-8").split("password ")[1].strip()
            page = browser.new_page(viewport={"width": 1280, "height": 800}, **more)
            logged_in(page, url, "engineer", password)
            yield page, url
        finally:
            window.terminate()
            window.wait(120)


def _settle(page: Page) -> None:
    """Until what comes after the first picture is there: the library says nowhere when that is."""
    page.wait_for_load_state("networkidle")
    time.sleep(1.5)


def _pages(browser: Browser, out: Path) -> None:
    with _window(browser, "--days", "2", "--scan", "10") as (page, url):
        time.sleep(60.0)  # half-periods, and detections among them
        page.goto(f"{url}/loop?name=FIC101")
        page.get_by_role("button", name="Fit now").click()
        page.get_by_text("asked by engineer").wait_for(timeout=300_000)
        for dark in ("light", "dark"):
            for kind, (width, height) in SIZES.items():
                page.set_viewport_size({"width": width, "height": height})
                for name, path in (
                    ("overview", "/"),
                    ("loop", "/loop?name=FIC101"),
                    ("events", "/events"),
                    ("laboratory", "/laboratory"),
                ):
                    page.goto(url + path)
                    _settle(page)
                    page.screenshot(path=out / f"{name}-{kind}-{dark}.png", full_page=True)
                for button in DIALOGS:
                    page.goto(f"{url}/loop?name=FIC101")
                    page.get_by_role("button", name=button, exact=True).click()
                    page.wait_for_selector(".wide-dialog")
                    _settle(page)
                    page.screenshot(path=out / f"{button.lower().replace(' ', '-')}-{kind}-{dark}.png")
            page.get_by_role("button", name="Close").click()
            page.get_by_role("button", name="Dark" if dark == "light" else "Light").click()
            page.wait_for_load_state()
        _laboratory(page, url, out)


def _laboratory(page: Page, url: str, out: Path) -> None:
    page.set_viewport_size({"width": 1280, "height": 800})
    page.goto(url + "/laboratory")
    page.get_by_role("button", name="1000 ×", exact=True).click()
    page.get_by_label("Search").fill("watch.d_hat")
    first = page.locator(".ag-cell[col-id=value]").first
    page.wait_for_function("parseFloat(document.querySelector('.ag-cell[col-id=value]').innerText) > 1.5")
    time.sleep(2.0)
    print(f"the loop of 6.5: gap.d is 2, watch.d_hat {first.inner_text()} at {page.inner_text('.content .muted.grow')}")
    page.screenshot(path=out / "laboratory-gap.png", full_page=True)
    page.get_by_role("button", name="1 ×", exact=True).click()
    paths = page.evaluate(
        """() => {
          const found = [];
          const id = Number(document.querySelector('.nicegui-aggrid').id.slice(1));
          getElement(id).api.forEachNode((node) => node.data.editable && found.push(node.data.path));
          return found;
        }"""
    )
    changed = []
    for path in paths:
        page.get_by_label("Search").fill(path)
        page.wait_for_function(
            "(path) => document.querySelector('.ag-cell[col-id=path]')?.innerText === path", arg=path
        )
        before = first.inner_text()
        number = float(before.replace("−", "-")) if re.match(r"[−\d.]", before) else None
        typed = "1" if number is None else f"{number * 1.1 if number else 0.1:.4g}"
        first.dblclick()
        page.keyboard.press("Control+A")
        page.keyboard.type(typed)
        page.keyboard.press("Enter")
        time.sleep(0.7)
        changed.append((path, before, typed, first.inner_text()))
    took = [path for path, before, _, after in changed if after != before]
    print(f"variables of 6.5's loop that may be set: {len(paths)}; changed while it runs: {len(took)}")
    for path, before, typed, after in changed:
        if after == before:
            print(f"  {path}: {before}, typed {typed}: stays")


def _said(page: Page) -> list[str]:
    """What the dialog of the compensation says first."""
    return page.inner_text(".wide-dialog").splitlines()[2:8]


def _compensation(browser: Browser, out: Path) -> None:
    with _window(browser, "--scan", "0.2") as (page, url):

        def button(name: str) -> None:
            while True:
                page.goto(f"{url}/loop?name={LEVEL}")
                page.get_by_text(re.compile("^PV of ")).wait_for()
                page.get_by_role("button", name=name, exact=True).click()
                page.locator(".wide-dialog").or_(page.locator(".q-notification")).first.wait_for()
                if page.locator(".wide-dialog").count():
                    return
                print("  told:", page.inner_text(".q-notification"))

        def put(values: dict[str, str]) -> None:
            button("Parameters")
            for name, value in values.items():
                page.get_by_label(name, exact=True).fill(value)
            page.get_by_role("button", name="Set what is changed").click()
            page.get_by_text("Set: ").wait_for()

        def enable(picture: str) -> None:
            button("Compensate")
            _settle(page)
            page.screenshot(path=out / f"{picture}-before.png")
            while True:
                page.get_by_role("button", name="Enable compensation").click()
                done = page.get_by_text(f"{LEVEL} is compensated.")
                done.or_(page.get_by_text("Refused: ")).first.wait_for()
                if done.count():
                    return
                print("  told:", page.inner_text(".q-notification"))
                time.sleep(10.0)
                button("Compensate")

        def until(text: str, most: float) -> str:
            began = time.monotonic()
            while time.monotonic() - began < most:
                button("Compensate")
                time.sleep(5.0)
                said = page.inner_text(".wide-dialog")
                if text in said:
                    break
            print(f"after {time.monotonic() - began:.0f} s:", *_said(page), sep="\n  ")
            return said

        put({"comp_size": "1", "comp_watch": "300"})
        button("Compensate")
        page.get_by_role("button", name="Drill the watchdog").click()
        page.goto(url + "/events")
        page.get_by_text(re.compile("took u_FF of|drill_failed")).first.wait_for(timeout=300_000)
        time.sleep(20 * 100 * 0.2 + 20)  # how calm PV was before must have been seen for 20 Ti
        enable("compensation")
        until("PV is ", 900.0)
        page.screenshot(path=out / "compensation-calmer.png")
        page.get_by_role("button", name="Switch off").click()
        page.get_by_text(f"{LEVEL}: off.").wait_for()
        put({"comp_size": "6"})
        time.sleep(60.0)
        enable("too-much")
        until("It is off: ", 1500.0)
        page.screenshot(path=out / "too-much-withdrawn.png")
        page.goto(url + "/events")
        page.get_by_label("Search").fill(LEVEL)
        _settle(page)
        page.screenshot(path=out / "too-much-events.png")
        for row in page.locator(".ag-center-cols-container .ag-row").all()[:12]:
            print("  event:", " | ".join(row.inner_text().splitlines()))


def _wear(browser: Browser, out: Path) -> None:
    with _window(browser, "--days", "20", "--scan", "60") as (page, url):
        page.goto(f"{url}/loop?name=FIC101")
        page.get_by_text(re.compile(r"^PV of .* old")).wait_for(timeout=900_000)  # the plant is at the present
        page.get_by_role("button", name="Fit now").click()
        page.get_by_text(re.compile("Fit of .*, asked by engineer")).wait_for(timeout=900_000)
        page.goto(url)
        page.get_by_text("month").first.wait_for()
        for row in page.locator(".ag-center-cols-container .ag-row").all():
            print("  ", " | ".join(row.inner_text().splitlines()))
        page.screenshot(path=out / "wear-overview.png")
        page.goto(f"{url}/loop?name=FIC101")
        page.get_by_text(re.compile("Trend: ")).wait_for()
        _settle(page)
        page.screenshot(path=out / "wear-loop.png", full_page=True)
        print(" ".join(page.inner_text(".card").split()))
        page.get_by_role("button", name="Graph").click()
        page.wait_for_selector("[data-drawn]")
        _settle(page)
        page.screenshot(path=out / "wear-graph.png")


def main(out: Path, parts: list[str]) -> None:
    """Make the tour."""
    out.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for part in parts:
            print(f"{part}:", flush=True)
            {"pages": _pages, "compensation": _compensation, "wear": _wear}[part](browser, out)
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or ["pages", "compensation", "wear"])
