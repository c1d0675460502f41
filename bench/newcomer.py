"""A newcomer's five minutes, by the stop-watch: from the download to a gap found.

    python -m bench.newcomer pip WHEEL       the wheel into an empty environment, then the demonstration
    python -m bench.newcomer source          a fresh clone of what is committed here, then `make run`
    python -m bench.newcomer page [FOLDER]   the page of `make page` from the disk, then a recording dropped on it

Each prints its steps with their seconds, and ends with the gap that was found; it fails where none is. What comes over
the network counts: of a wheel all that it needs is fetched anew, of the sources what is in no cache of this machine.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
LOOP, TRUE = "FIC201", (2.0, 3.2)
"""A loop of the demonstration, and widths that its interval must lie about [%OP]."""


@contextmanager
def step(what: str) -> Iterator[None]:
    """Time a step."""
    begin = time.perf_counter()
    yield
    print(f"{time.perf_counter() - begin:7.1f} s  {what}", flush=True)


def found(text: str) -> str:
    """Answer of the loop in the printed text.

    Raises SystemExit where it is no gap of about the true width.
    """
    answer = re.search(rf"{LOOP}\D*(\d+\.\d+).*", text)
    if answer is None or not TRUE[0] < float(answer[1]) < TRUE[1]:
        raise SystemExit(f"no gap of {LOOP} in\n{text}")
    return answer[0].strip()


def by_pip(wheel: Path, room: Path) -> str:
    """Install a wheel, and analyse the demonstration."""
    command = room / "empty" / ("Scripts" if os.name == "nt" else "bin")
    # No file beside this one may be imported in place of the wheel.
    alone = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    with step("an empty environment"):
        subprocess.run([sys.executable, "-m", "venv", room / "empty"], check=True)
    with step("pip install, with all that it needs"):
        install = [command / "python", "-m", "pip", "install", "--quiet", "--no-cache-dir", wheel.absolute()]
        subprocess.run(install, env=alone, check=True)
    with step("glapp demo demo"):
        subprocess.run([command / "glapp", "demo", "demo"], cwd=room, env=alone, check=True, capture_output=True)
    with step("glapp analyze demo/loops.toml --report report.html"):
        words = [command / "glapp", "analyze", "demo/loops.toml", "--report", "report.html"]
        done = subprocess.run(words, cwd=room, env=alone, check=True, capture_output=True, text=True)
    return found(done.stdout)


def by_source(room: Path) -> str:
    """Clone, and run `make run`."""
    with step("git clone"):
        subprocess.run(["git", "clone", "--quiet", ROOT, room / "glapp"], check=True)
    with step("make run"):
        done = subprocess.run(["make", "run"], cwd=room / "glapp", check=True, capture_output=True, text=True)
    return found(done.stdout)


def by_page(folder: Path, room: Path) -> str:
    """Open the page from the disk, and drop a recording on it."""
    from playwright.sync_api import sync_playwright

    subprocess.run([sys.executable, "-m", "glapp", "demo", room / "demo"], check=True, capture_output=True)
    with step("the page is copied"):
        shutil.copy(folder / "index.html", room)
    with sync_playwright() as playwright:
        with step("the browser starts, and shows the page"):
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            page = browser.new_page()
            page.set_default_timeout(1_800_000)
            page.goto((room / "index.html").as_uri())
            page.locator("#file").wait_for(state="attached")
        with step("a recording is dropped, and answered by its zero crossings, then by its fit"):
            with step("the zero crossings, with their pictures"):
                page.locator("#file").set_input_files(room / f"demo/{LOOP}.csv")
                page.locator("#result .loop").wait_for()
            page.locator("#result .loop:not(.provisional)").wait_for()
        text = page.locator("#result .width").inner_text()
        browser.close()
    return found(f"{LOOP} {text}")


def main() -> None:
    """Time one way."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("way", choices=("pip", "source", "page"))
    parser.add_argument("path", type=Path, nargs="?")
    given = parser.parse_args()
    print(f"{os.cpu_count()} processors; at work for them before: {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder, step("in all"):
        room = Path(folder)
        if given.way == "pip":
            if given.path is None:
                parser.error("pip needs a wheel: dist/wheels/*.whl")
            answer = by_pip(given.path, room)
        elif given.way == "source":
            answer = by_source(room)
        else:
            answer = by_page(given.path or ROOT / "dist/page", room)
        print(answer)


if __name__ == "__main__":
    main()
