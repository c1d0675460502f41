"""Writer of a bench's figures into its page in bench/results, and the machine that they are from."""

from __future__ import annotations

import os
import platform
import re
from pathlib import Path

RESULTS = Path(__file__).parent / "results"


def processor() -> str:
    """The processor's model and its cores."""
    model = platform.processor() or platform.machine()
    if (info := Path("/proc/cpuinfo")).exists() and (found := re.search(r"model name\s*: (.*)", info.read_text())):
        model = found[1]
    return f"{model}, {os.cpu_count()} cores"


def write(name: str, text: str, mark: str = "measured") -> None:
    """Put `text` into bench/results/`name` between `<!-- mark -->` and the next `<!-- end -->`."""
    page = RESULTS / name
    between = re.compile(rf"(<!-- {mark} -->\n).*?(<!-- end -->)", re.DOTALL)
    written, places = between.subn(lambda m: f"{m[1]}\n{text.strip()}\n\n{m[2]}", page.read_text(encoding="utf-8"))
    if places != 1:
        raise ValueError(
            f"bench/results/{name} has {places} places between <!-- {mark} --> and <!-- end -->; one is needed"
        )
    page.write_text(written, encoding="utf-8")
