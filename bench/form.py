"""The page of a step test beside the valve that was simulated: `python -m bench.form [FOLDER]`.

Each row of the table is a valve whose dead band, response and overshoot are known, and what the page of its test says.
With a folder the pages are written there.
"""

from __future__ import annotations

import math
import re
import sys
from dataclasses import dataclass
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np

import glapp
from glapp.plant import Plant
from glapp.report.form import form_page, judged
from glapp.simulate import Gaussian, Valve, closed_loop

LEVELS = (50.0, 54.0, 58.0, 58.5, 54.0, 50.0, 54.0, 58.0)
"""Two up, a small step on, two down, two up [% of OP]."""

HOLD = 120.0
"""Each of them is held so long [s]."""

TERMS = ("Dead band", "Resolution", "Step response time T86", "Overshoot", "Gain")


@dataclass(frozen=True)
class Tested:
    """A valve, its process, and the truth of the test."""

    name: str
    d: float
    t86: float
    overshoot: float
    plant: Any = ([0.8], [6.0, 1.0], 4.0)
    noise: float = 0.02
    more: tuple[tuple[str, Any], ...] = ()

    def page(self) -> tuple[str, str]:
        """The page of its test, and pass or fail at 1 % of span."""
        made = closed_loop(
            self.plant,
            (0.5, 10.0),
            d=self.d,
            noise=Gaussian(sigma=self.noise),
            h=0.5,
            t_end=HOLD * len(LEVELS),
            manual=[(i * HOLD, (i + 1) * HOLD + (i == len(LEVELS) - 1), op) for i, op in enumerate(LEVELS)],
            setpoint=[(0.0, 40.0)],
            seed=1,
            **dict(self.more),
        )
        table = made.to_arrow()
        if not self.more:
            table = table.drop_columns(["POSITION"])
        loop = glapp.Loop(name=self.name, op_span=(0, 100))
        one = judged(glapp.step_test(glapp.recording_from(table, loop)), loop)
        return form_page([one]), one.verdict


def t86(plant: Any) -> float:
    """Time from which a step response of the process stays beyond 86.5 % of its way [s]."""
    t, y = Plant.of(plant).step(np.arange(0.0, 100.0, 0.01))
    return float(t[np.flatnonzero(y / y[-1] < 1 - math.exp(-2))[-1] + 1])


THREE_LAGS: Any = ([0.8], [125.0, 75.0, 15.0, 1.0], 0.0)
DAMPED: Any = ([0.8], [25.0, 5.0, 1.0], 0.0)


VALVES = (
    Tested("one lag, d = 1.6", 1.6, 4.0 + 2 * 6.0, 0.0),
    Tested("no dead band", 0.0, 4.0 + 2 * 6.0, 0.0),
    Tested("d = 0.4, more noise", 0.4, 4.0 + 2 * 6.0, 0.0, noise=0.05),
    Tested("three lags of 5 s, d = 3", 3.0, t86(THREE_LAGS), 0.0, THREE_LAGS),
    Tested("damping 0.5, d = 1", 1.0, t86(DAMPED), math.exp(-math.pi / math.sqrt(3)), DAMPED),
    Tested("travel recorded, lag 3, d = 1", 1.0, 2 * 3.0, 0.0, more=(("valve", Valve(lag=3.0)),)),
)


def terms_of(page: str) -> dict[str, str]:
    """Terms of a page, of the travel where that is recorded."""
    found = {}
    for term in TERMS:
        row = re.search(rf"<td>{re.escape(term)}</td>(.*?)</tr>", page, re.S)
        assert row is not None
        found[term] = unescape(re.findall(r"<td>(.*?)</td>", row[1], re.S)[0]).replace("\u00a0", " ")
    return found


def main(folder: Path | None) -> None:
    """Print the table, and write the pages."""
    print("| valve | dead band | the page | T86 | the page | overshoot | the page | resolution | at 1 % |")
    print("|---|---|---|---|---|---|---|---|---|")
    for valve in VALVES:
        page, verdict = valve.page()
        shown = terms_of(page)
        overshoot = f"{100 * valve.overshoot:.1f} %" if valve.overshoot else "none"
        cells = (
            valve.name,
            f"{valve.d:g}",
            shown["Dead band"],
            f"{valve.t86:.1f} s",
            shown["Step response time T86"],
            overshoot,
            shown["Overshoot"],
            shown["Resolution"],
            verdict,
        )
        print(f"| {' | '.join(cells)} |")
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{re.sub('[^a-z0-9]+', '-', valve.name)}.html").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
