"""Times of the page in the browser: until an answer, and pictures a second of the laboratory.

The fit is timed with a worker for each processor, and with one worker.

`python -m bench.browser`; needs the page (`make page`) and Chromium, which has no GPU here: it draws on the processor.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from glapp.simulate import closed_loop

from . import page as document

PAGE = Path(__file__).parents[1] / "dist" / "page" / "index.html"
ROWS = 20_000
WATCHED = 10_000
"""Time for which the pictures of the laboratory are counted [ms]."""

COUNT = """async (watched) => {
    const began = await new Promise(requestAnimationFrame);
    let [pictures, now] = [0, began];
    while (now - began < watched) {
        now = await new Promise(requestAnimationFrame);
        pictures += 1;
    }
    return (1000 * pictures) / (now - began);
}"""


def recording(folder: Path) -> Path:
    """A worn valve under a load that steps, as text."""
    load = [(40.0 * k, 0.3 * (-1) ** k) for k in range(1, 49)]
    made = closed_loop(
        "P3", (0.48, 0.3117), d=0.05, noise=0.005, h=0.1, t_end=ROWS / 10, seed=1, setpoint=[(1, 1.0)], load=load
    )
    rows = zip(*(x[:ROWS].tolist() for x in (made.t, made.sp, made.pv, made.op)), strict=True)
    path = folder / "worn.csv"
    path.write_text("t,SP,PV,OP\n" + "".join(",".join(f"{x:.6g}" for x in row) + "\n" for row in rows))
    return path


def answered(page: Any, path: Path) -> tuple[float, float, float]:
    """Seconds from the drop to the answer of the crossings, with its pictures; with a window of the fit; with all."""
    page.evaluate("""() => {
        const began = new Promise((done) => {
            $("file").addEventListener("change", () => done(performance.now()), { once: true });
        });
        const shows = (what, saying = "") => new Promise((done) => {
            const seen = new MutationObserver(() => {
                if (!document.querySelector(what)?.textContent.includes(saying)) return;
                seen.disconnect();
                requestAnimationFrame(() => done(performance.now()));
            });
            seen.observe($("result"), { childList: true });
        });
        globalThis.took = Promise.all([
            began,
            shows("#result .loop"),
            shows("#result .going-on", "from 1 of"),
            shows("#result .loop:not(.provisional)"),
        ]);
    }""")
    page.set_input_files("#file", str(path))
    began, *shown = page.evaluate("() => took")
    crossings, window, fitted = ((at - began) / 1000 for at in shown)
    return crossings, window, fitted


def main() -> None:
    """Measure, and write the table of bench/results/page.md."""
    rows = ["| in Chromium {version} on {machine}, without a GPU | measured | asked |", "|---|---|---|"]
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(0)
        page.goto(PAGE.as_uri())
        page.evaluate("() => module_ready")
        page.click("#go-laboratory")
        page.wait_for_function("() => Number(document.getElementById('laboratory').dataset.t) > 5")
        rate = page.evaluate(COUNT, WATCHED)
        page.click("#lab-run")
        page.click("#go-recording")
        worn = recording(Path(folder))
        first, window, fitted = answered(page, worn)
        # A file that is chosen already does not change: the page begins anew.
        page.add_init_script("Object.defineProperty(navigator, 'hardwareConcurrency', { value: 1 })")
        page.reload()
        page.evaluate("() => module_ready")
        _, _, alone = answered(page, worn)
        size = PAGE.stat().st_size / 1e6
        version = browser.version
        browser.close()
    rows[0] = rows[0].format(version=version, machine=document.processor())
    rows += [
        f"| {ROWS} rows of a worn valve: the answer of the zero crossings, with its pictures | {first:.1f} s | ≤ 5 s |",
        f"| the same, with the first window of the fit | {window:.0f} s | ≤ 5 s |",
        f"| the same, with the fit in a worker a processor | {fitted:.0f} s | ≤ 5 s |",
        f"| the same, with the fit in one worker | {alone:.0f} s | |",
        f"| pictures a second of the laboratory at 1 ×, all three charts | {rate:.0f} | ≥ 50 |",
        f"| size of the page | {size:.2f} MB | ≤ 5 MB |",
    ]
    document.write("page.md", "\n".join(rows) + "\n", "measured")


if __name__ == "__main__":
    main()
