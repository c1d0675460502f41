"""Time of a design, over the test batch: median and worst of repeated runs."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

from rich.console import Console
from rich.table import Table

from glapp.plant import PLANTS, Plant
from glapp.tuning import Kind, Tuning, design, migo

RUNS = 9


def seconds(rule: Callable[[Plant, Kind], Tuning], kind: Kind) -> dict[str, list[float]]:
    """Seconds of every run, by the name of the process; a process that the rule refuses is left out."""
    times: dict[str, list[float]] = {}
    for name, plant in PLANTS.items():
        try:
            rule(plant, kind)
        except ValueError:
            continue
        for _ in range(RUNS):
            begun = time.perf_counter()
            rule(plant, kind)
            times.setdefault(name, []).append(time.perf_counter() - begun)
    return times


if __name__ == "__main__":
    table = Table("rule", "processes", "median [ms]", "slowest process [ms]", "worst single run [ms]")
    rules: dict[str, Callable[[Plant, Kind], Tuning]] = {
        "MIGO, M = 1.4": migo,
        "MIGO, Ms ≤ 1.4": lambda plant, kind: migo(plant, kind, ms=1.4),
        "MIGO, Ms ≤ 2.0": lambda plant, kind: migo(plant, kind, ms=2.0),
        "design, Ms, Mt ≤ 1.4": design,
    }
    kinds: tuple[Kind, ...] = ("PI", "PID")
    for title, rule in rules.items():
        for kind in kinds:
            times = seconds(rule, kind)
            every = [1e3 * one for runs in times.values() for one in runs]
            medians = {name: 1e3 * statistics.median(runs) for name, runs in times.items()}
            slowest = max(medians, key=lambda name: medians[name])
            table.add_row(
                f"{title}, {kind}",
                str(len(times)),
                f"{statistics.median(every):.0f}",
                f"{medians[slowest]:.0f} ({slowest})",
                f"{max(every):.0f}",
            )
    Console(width=110).print(table)
