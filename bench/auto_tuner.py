"""Results of the autotuner on the test batch, beside the truth: `python -m bench.auto_tuner` writes it into the docs.

Also other processes than those on which the slopes of its correction were chosen, and the picture of one experiment.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from glapp.plant import PLANTS, Plant
from glapp.tuning import RelayExperiment, relay_experiment, ultimate
from glapp_thesis import style

from .page import write

PICTURE = Path(__file__).parents[1] / "docs" / "auto_tuner.png"
SEEDS = 20
POWER = 2 / 3
"""Half swing of the relay, with an amplitude of 1."""

OTHERS = {
    "1/(s + 1)⁶": Plant([1], [1, 6, 15, 20, 15, 6, 1]),
    "1/((s + 1)(s/2 + 1)(s/4 + 1)(s/8 + 1))": Plant([64], [1, 15, 70, 120, 64]),
    "e⁻⁰·²ˢ/(s + 1)": Plant([1], [1, 1], 0.2),
    "e⁻ˢ/(s + 1)": Plant([1], [1, 1], 1.0),
    "e⁻⁰·¹ˢ/(s + 1)²": Plant([1], [1, 2, 1], 0.1),
    "e⁻⁰·⁵ˢ/(s + 1)²": Plant([1], [1, 2, 1], 0.5),
    "e⁻²ˢ/(s + 1)²": Plant([1], [1, 2, 1], 2.0),
    "(1 − s)/(s + 1)³": Plant([-1, 1], [1, 3, 3, 1]),
    "(1 − 2s)/(s + 1)³": Plant([-2, 1], [1, 3, 3, 1]),
    "1/((s + 1)(s² + 0.6s + 1))": Plant([1], [1, 1.6, 1.6, 1]),
    "−3/(s + 1)³": Plant([-3], [1, 3, 3, 1]),
    "e⁻ˢ/s": Plant([1], [1, 0], 1.0),
    "1/(s(s + 1)²)": Plant([1], [1, 2, 1, 0]),
}


class Condition(NamedTuple):
    """Noise in shares of the amplitude of the cycle, load and gap in shares of the experiment's amplitude."""

    title: str
    noise: float = 0.0
    load: float = 0.0
    samples: int = 100
    d: float = 0.0


CONDITIONS = [
    Condition("clean"),
    Condition("noise ± 5 %", noise=0.05),
    Condition("noise ± 20 %", noise=0.2),
    Condition("load 0.3, noise ± 5 %", noise=0.05, load=0.3),
    Condition("gap of 0.16, told, noise ± 5 %", noise=0.05, d=0.16),
    Condition("h = Tu/20, noise ± 5 %", noise=0.05, samples=20),
]


def run(plant: Plant, condition: Condition, seed: int) -> RelayExperiment:
    """One experiment."""
    ku, tu = ultimate(plant)
    cycle = 4 * POWER / math.pi / abs(ku)
    load = [(1.3 * tu, condition.load)]
    noise, d, h = condition.noise * cycle, condition.d, tu / condition.samples
    return relay_experiment(plant, noise=noise, load=load, d=d, known_d=d, h=h, seed=seed + 1)


class Errors(NamedTuple):
    """Errors of one experiment, as shares of the truth; None: not found."""

    ku: float | None
    tu: float | None
    kp: float | None
    integrating: bool
    duration: float
    describing: float | None
    """Error of Ku = 4d/(πA), A half of PV's range over the second half of the balanced phase."""


def errors(job: tuple[Plant, Condition, int]) -> Errors:
    """Errors of one experiment; where κ is not known Ku and Tu are not corrected and count as not found."""
    plant, _, _ = job
    e = run(*job)
    ku, tu = ultimate(plant)
    if e.ku is None or e.tu is None or e.kappa is None:
        return Errors(None, None, None, False, e.t[-1] / tu, None)
    kp = e.kp_process / plant.gain - 1 if e.kp_process is not None and plant.gain else None
    balanced = e.pv[e.phase == 2]
    swing = np.ptp(balanced[len(balanced) // 2 :]) / 2
    describing = float(4 * POWER / (math.pi * swing * abs(ku))) - 1
    return Errors(e.ku / ku - 1, e.tu / tu - 1, kp, e.kp_process is None, e.t[-1] / tu, describing)


def shown(values: Iterable[float | None]) -> str:
    """Median and, in brackets, the greatest of the magnitudes, in per cent."""
    numbers = [100 * value for value in values if value is not None]
    if not numbers:
        return "–"
    return f"{statistics.median(numbers):+.1f} ({max(map(abs, numbers)):.1f})"


def table(plants: Mapping[str, Plant], condition: Condition, pool: Any) -> list[str]:
    """Rows of a Markdown table."""
    seeds = SEEDS if condition.noise else 1
    rows = [f"**{condition.title}**", "", "| | found | Ku | Tu | Kp | duration | 4d/(πA) |", "|---|" + 6 * "---|"]
    for process, plant in plants.items():
        seen = list(pool.map(errors, [(plant, condition, seed) for seed in range(seeds)]))
        done = sum(one.ku is not None for one in seen)
        kp = shown(one.kp for one in seen)
        if any(one.integrating for one in seen):
            kp = f"integrating ({sum(one.integrating for one in seen)})"
        duration = statistics.median(one.duration for one in seen)
        ku, tu, describing = (shown(getattr(one, name) for one in seen) for name in ("ku", "tu", "describing"))
        rows.append(f"| {process} | {done}/{seeds} | {ku} | {tu} | {kp} | {duration:.0f} Tu | {describing} |")
    return [*rows, ""]


def picture(path: Path) -> None:
    """Draw an experiment on P2, with noise and a load that comes with the first cycles."""
    plant = PLANTS["P2"]
    tu = ultimate(plant).tu
    e = relay_experiment(plant, noise=0.01, load=[(2.5 * tu, 0.3)], wait=2 * tu, seed=3)
    figure, (above, below) = style.panels(2, height=4.6, ratios=(3, 2))
    above.plot(e.t, e.pv, linewidth=0.9, color=style.FILTERED)
    below.step(e.t, e.op, where="post", linewidth=1.0, color=style.OP)
    below.set(xlabel="time [s]", ylabel="OP", ylim=(-1.2, 1.2))
    for level in (-1, 1):
        below.axhline(level, linestyle=":", linewidth=0.9, color=style.MUTED)
    top = 1.25 * max(abs(e.pv))
    above.set(ylabel="PV", ylim=(-top, top))
    for number, title in ((1, "waiting"), (2, "balanced"), (3, "biased")):
        t = e.t[e.phase == number]
        for axis in (above, below):
            axis.axvline(t[0], linewidth=0.8, color=style.MUTED)
        above.text(t[0] + 0.5, 0.85 * top, title)
    found = f"Ku {e.ku:.2f} (true 4.00), Tu {e.tu:.2f} s (true {tu:.2f} s), Kp {e.kp_process:.2f} (true 1.00)"
    above.set_title(f"P2: {found}")
    style.save(figure, path)


def main() -> None:
    """Write tables and picture."""
    lines: list[str] = []
    with ProcessPoolExecutor() as pool:
        for condition in CONDITIONS:
            lines += table(PLANTS, condition, pool)
        lines += table(OTHERS, CONDITIONS[1]._replace(title="other processes, noise ± 5 %"), pool)
    write("auto_tuner.md", "\n".join(lines))
    picture(PICTURE)


if __name__ == "__main__":
    main()
