"""The documentation as a site: read from a folder, in Chromium, with nothing asked of elsewhere."""

import re
import shutil
from html import unescape
from pathlib import Path

import pytest

import glapp
from glapp import simulate, tuning

SITE = Path(__file__).parent.parent / "dist/site"
CHROMIUM = shutil.which("chromium")
if CHROMIUM is None:
    pytest.skip("chromium is not installed", allow_module_level=True)
sync_api = pytest.importorskip("playwright.sync_api")

pytestmark = [
    pytest.mark.verify,
    # `make verify` builds the site before these tests; without npm, which it needs, it says so and builds none.
    pytest.mark.skipif(not (SITE / "index.html").exists(), reason="the site is not built: make site"),
]


def test_a_folder_is_read_and_searched_without_a_network() -> None:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 375, "height": 700})
        page.set_default_timeout(60_000)
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto((SITE / "fit.html").as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= 375
        page.set_viewport_size({"width": 1280, "height": 800})
        # Its table of five columns scrolled, with the numbers out of sight.
        page.goto((SITE / "thesis.html").as_uri())
        tables = page.locator(".md-typeset__scrollwrap")
        assert tables.count() > 0
        assert not tables.evaluate_all("all => all.some(one => one.scrollWidth > one.clientWidth)")
        page.goto((SITE / "index.html").as_uri())
        page.locator("[data-md-component=search-query]").fill("stiction")
        page.locator(".md-search-result__item", has_text="Read the answer").first.wait_for()
        page.locator(".md-search-result__item a", has_text="Read the answer").first.click()
        page.wait_for_url("**/answer.html*")
        browser.close()
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []


def test_the_reference_has_every_public_function() -> None:
    for page, module in (("api", glapp), ("api-laboratory", tuning), ("api-laboratory", simulate)):
        text = (SITE / f"{page}.html").read_text(encoding="utf-8")
        for name in module.__all__:
            public = getattr(module, name)
            places = {f"{module.__name__}.{name}", f"{public.__module__}.{name}"} if callable(public) else set()
            assert not places or any(f'id="{place}"' in text for place in places), name
        assert "::</p>" not in text and "=====" not in text


def test_the_reference_has_the_defaults_of_the_code() -> None:
    """Regression: it called `kind` "PI" where it is "PID", `relay` True, and every field of a `Scenario` required."""
    text = (SITE / "api-laboratory.html").read_text(encoding="utf-8")
    shown = {}
    for part in re.split(r'<h\d id="', text)[1:]:
        for row in re.findall(r'<tr class="doc-section-item">(.*?)</tr>', part, re.DOTALL):
            found = re.findall(r"<td.*?</td>", row, re.DOTALL)
            cells = [unescape(re.sub(r"<[^>]+>", "", cell)).strip() for cell in found]
            if len(cells) == 4:
                shown[part.split('"')[0], cells[0]] = cells[3]
    for name, default in {
        ("glapp.tuning.amigo_step", "kind"): "'PID'",
        ("glapp.nonlinear.nyquist_figure", "relay"): "False",
        ("glapp.simulate.Scenario", "plant"): "required",
        ("glapp.simulate.Scenario", "h"): "0.05",
        ("glapp.modules.PidAdvanced", "td"): "0.0",
    }.items():
        assert shown[name] == default, name
