"""The window for whoever has no mouse, sees little, or has a small screen: keyboard, 200 %, contrast."""

import re
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("nicegui")
pytest.importorskip("multipart")

from station_window import Window, logged_in

pytestmark = [pytest.mark.verify, pytest.mark.xdist_group("station by keyboard")]

PAGES = {"overview": "/", "loop": "/loop?name=FIC0", "events": "/events", "laboratory": "/laboratory"}
DIALOGS = {
    ("loop", "Width over time"): "A dot is a half-period",
    ("loop", "Parameters"): "Who changed what, when",
    ("loop", "Compensate"): "Who did what, when",
    ("loop", "PV over OP"): "flanks",
    ("loop", "Step test"): "in automatic all the time",
    ("laboratory", "Build another loop"): "wires, one a line",
}

CONTROLS = """(scope) => {
  const all = document.querySelectorAll(`${scope} :is(a[href], button, input, select, summary, textarea, [tabindex])`);
  const found = [...all].filter((e) => e.tabIndex >= 0 && !e.disabled && e.type !== 'hidden'
    && e.checkVisibility() && !e.closest('.ag-root-wrapper, [aria-hidden=true], .q-dialog__inner > [tabindex]')
    && !e.matches('.q-focus-helper'));
  found.forEach((e, k) => (e.dataset.k = k));
  return found.map((e) => e.getAttribute('aria-label') || e.innerText || e.placeholder || e.type || e.tagName);
}"""

FOCUSED = """() => {
  const e = document.activeElement;
  const around = [e, e.closest('.q-field__control'), e.closest('.q-btn'), e.closest('.q-checkbox')];
  const seen = around.some((one) => {
    const style = one && getComputedStyle(one);
    return style && style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) >= 2;
  });
  return {
    k: e.dataset.k ?? null,
    seen,
    grid: !!e.closest('.ag-root-wrapper'),
    nowhere: e === document.body,
    what: e.outerHTML.slice(0, 150),
  };
}"""

CUT = """() => {
  const own = (e) => [...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim());
  const wide = (e) => {
    for (let p = e.parentElement; p; p = p.parentElement)
      if (['auto', 'scroll'].includes(getComputedStyle(p).overflowX) && p !== document.documentElement) return true;
    return false;
  };
  const found = [];
  for (const e of document.querySelectorAll('body *')) {
    const box = e.getBoundingClientRect();
    if (!own(e) || box.width <= 1 || e.closest('.ag-root-wrapper, svg, script, style, .skip')) continue;
    const style = getComputedStyle(e);
    const clipped = e.scrollWidth > e.clientWidth + 1 && style.display !== 'inline'
      && ['hidden', 'clip'].includes(style.overflowX);
    if (clipped || (box.right > innerWidth + 1 && !wide(e))) found.push(e.innerText);
  }
  return found;
}"""


RATIO = """(selector) => {
  const parts = (text) => {
    const found = text.match(/[\\d.]+/g).map(Number);
    return text.startsWith('color(srgb') ? found.map((x, i) => (i < 3 ? 255 * x : x)) : found;
  };
  const over = (a, b) => [0, 1, 2].map((i) => (a[3] ?? 1) * a[i] + (1 - (a[3] ?? 1)) * b[i]);
  const light = (c) => {
    const [r, g, b] = c.map((x) => x / 255).map((x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const e = document.querySelector(selector);
  const layers = [];
  for (let p = e; p; p = p.parentElement) layers.unshift(parts(getComputedStyle(p).backgroundColor));
  const back = layers.reduce((below, one) => over(one, below), [255, 255, 255]);
  const [a, b] = [light(over(parts(getComputedStyle(e).color), back)), light(back)].sort((x, y) => x - y);
  return (b + 0.05) / (a + 0.05);
}"""
"""Contrast of a text with its background, by WCAG 2."""


def opened(page: Any, window: Window, name: str) -> None:
    page.goto(window.url + PAGES[name])
    page.wait_for_selector(".content h1")
    if name in ("overview", "events", "laboratory"):
        page.wait_for_selector(".ag-row")
    else:
        page.locator("summary", has_text="Zero crossings").click()
        page.get_by_text(re.compile("^Half-period under way")).wait_for()


def dialog(page: Any, button: str) -> Any:
    """A dialog opened by keyboard; it is there when its last line is."""
    page.get_by_role("button", name=button, exact=True).focus()
    page.keyboard.press("Enter")
    found = page.locator(".wide-dialog")
    text = next(text for (_, name), text in DIALOGS.items() if name == button)
    found.get_by_text(text).or_(found.get_by_label(text)).first.wait_for()
    return found


def walked(page: Any, scope: str) -> tuple[list[str], set[int], list[str], bool]:
    """All controls, those that Tab reached, what was focused and could not be seen, and whether it came round."""
    controls = page.evaluate(CONTROLS, scope)
    reached: set[int] = set()
    unseen: list[str] = []
    first = None
    for _ in range(2 * len(controls) + 30):
        page.keyboard.press("Tab")
        focused = page.evaluate(FOCUSED)
        if focused["nowhere"]:
            continue
        if not focused["seen"]:
            unseen.append(focused["what"])
        if focused["k"] is None:
            continue
        k = int(focused["k"])
        if first is None:
            first = k
        elif k == first and len(reached) > 1:
            return controls, reached, unseen, True
        reached.add(k)
    return controls, reached, unseen, False


@pytest.mark.parametrize("name", PAGES)
def test_every_control_is_reached_by_keyboard_and_seen(browser: Any, window: Window, name: str) -> None:
    page = logged_in(browser, window, "eve")
    opened(page, window, name)
    controls, reached, unseen, round_ = walked(page, "body")
    assert [what for k, what in enumerate(controls) if k not in reached] == []
    assert len(controls) >= 8 and unseen == [] and round_, "Tab goes round"
    if name != "loop":  # a list is one stop; within it one goes by arrows
        page.locator(".ag-header-cell").first.focus()
        page.keyboard.press("ArrowDown")
        assert page.evaluate("document.activeElement.closest('.ag-row') !== null")
        assert page.evaluate(FOCUSED)["seen"]
        page.keyboard.press("Tab")
        page.wait_for_function("!document.activeElement.closest('.ag-root-wrapper')")  # Tab leaves the list


@pytest.mark.parametrize(("name", "button"), DIALOGS)
def test_dialogs_by_keyboard(browser: Any, window: Window, name: str, button: str) -> None:
    page = logged_in(browser, window, "eve")
    opened(page, window, name)
    found = dialog(page, button)
    controls, reached, unseen, round_ = walked(page, ".q-dialog")
    assert [what for k, what in enumerate(controls) if k not in reached] == [] and unseen == []
    assert round_ or len(controls) == 1
    page.keyboard.press("Escape")
    found.wait_for(state="detached")
    page.wait_for_function("(name) => document.activeElement.innerText === name", arg=button)


def test_login_by_keyboard(browser: Any, window: Window) -> None:
    page = browser.new_context().new_page()
    page.goto(window.url)
    page.wait_for_function("document.activeElement.id === 'user'")
    for key in ("eve", "Tab", "wrong", "Tab", "Enter"):
        page.keyboard.press(key) if key in ("Tab", "Enter") else page.keyboard.type(key)
    page.get_by_text("Wrong name or password").wait_for()
    assert page.input_value("#user") == "eve"
    assert page.evaluate("document.activeElement.id") == "password"


def each_state(page: Any, window: Window, look: Callable[[str, str], None]) -> None:
    """Every page, and every dialog over it."""
    for name in PAGES:
        opened(page, window, name)
        look(name, "body")
        for place, button in DIALOGS:
            if place == name:
                found = dialog(page, button)
                look(f"{name}: {button}", ".q-dialog")
                page.keyboard.press("Escape")
                found.wait_for(state="detached")


SIZES = {"laptop": (1280, 800), "tablet": (768, 1024), "200 %": (640, 400), "telephone": (390, 844)}


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_nothing_hangs_over_or_is_cut(browser: Any, window: Window, size: tuple[int, int]) -> None:
    """A 13-inch laptop, a tablet held upright, that laptop at 200 %, and a telephone."""
    page = logged_in(browser, window, "eve")
    page.set_viewport_size({"width": size[0], "height": size[1]})

    def look(name: str, _: str) -> None:
        # A chart is as wide as before until it has seen that its place is narrower.
        page.wait_for_function("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        assert page.evaluate(CUT) == [], name

    each_state(page, window, look)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_contrast_and_names_by_axe(browser: Any, window: Window, scheme: str) -> None:
    """WCAG 2.1 A and AA by axe-core: contrast of at least 4.5, of large text 3; names and roles of all controls."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page = logged_in(browser, window, "eve", color_scheme=scheme)
    rules = {
        "runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"],
        "resultTypes": ["violations", "passes", "incomplete"],
    }
    compared = 0

    def look(name: str, scope: str) -> None:
        nonlocal compared
        found = axe.run(page, context=scope, options=rules)
        wrong = []
        for kind in ("violations", "incomplete", "passes"):
            for one in found.response[kind]:
                for node in one["nodes"]:
                    if one["id"] == "color-contrast":
                        compared += 1
                        # Rules for which axe is not sure of the background, or takes a dialog's toggle for one behind
                        # its backdrop.
                        if kind != "passes" and page.evaluate(RATIO, node["target"][0]) < 4.5:
                            wrong.append((node["target"], node.get("failureSummary")))
                    elif kind == "violations":
                        wrong.append((one["id"], node["target"], node.get("failureSummary")))
        assert wrong == [], name

    each_state(page, window, look)
    page.context.clear_cookies()
    page.goto(window.url)
    page.wait_for_selector("#user")
    look("login", "body")
    assert compared > 300
