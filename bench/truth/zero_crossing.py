"""The zero-crossing estimator on loops whose gap is known, `python -m bench.truth.zero_crossing [seeds]`.

Four loops, four widths, five kinds of disturbance, 20 seeds of noise and disturbance each. Noise of amplitude 0.005
on PV, h = 0.05 s, an hour of the loop's time. The settings are given, as from a control system; nothing tells the
detector the width.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from random import Random
from typing import Any, NamedTuple

import numpy as np

import glapp
from glapp.simulate import Signal, closed_loop, random_walk

CONTROLLERS: dict[str, tuple[str, tuple[float, ...]]] = {
    "P3 PI": ("P3", (0.48, 0.3117)),
    "P2 PI, Ms 2.0": ("P2", (0.775, 2.05)),
    "P2 PI, ZN": ("P2", (1.6, 5.03)),
    "P2 PID, AMIGO": ("P2", (1.12, 2.40, 0.619)),
}
WIDTHS = (0.1, 0.05, 0.02, 0.0)
H, T_END, NOISE = 0.05, 3600.0, 0.005


class Disturbance(NamedTuple):
    """What acts on the loop, a setpoint and a load from a seed, and limits of OP."""

    setpoint: Callable[[Random], Signal]
    load: Callable[[Random], Signal]
    limits: tuple[float, float] | None = None


def _steps(random: Random, low: float, high: float, apart: float) -> list[tuple[float, float]]:
    """Steps at random times to random values."""
    t, steps = 1.0, []
    while t < T_END:
        steps.append((t, random.uniform(low, high)))
        t += random.uniform(0.5, 1.5) * apart
    return steps


def _once(_random: Random) -> Signal:
    return [(1.0, 1.0)]


def _walk(rate: float) -> Callable[[Random], Signal]:
    return lambda random: random_walk(round(T_END / H) + 1, H, rate, seed=random.randrange(2**32))


DISTURBANCES = {
    "load steps": Disturbance(_once, lambda random: _steps(random, -0.3, 0.3, 400.0)),
    "setpoint steps": Disturbance(lambda random: _steps(random, 0.7, 1.3, 400.0), lambda _: ()),
    "saturation": Disturbance(_once, lambda random: _steps(random, -0.5, 0.3, 400.0), (0.0, 1.2)),
    "random walk 0.002": Disturbance(_once, _walk(0.002)),
    "random walk 0.006": Disturbance(_once, _walk(0.006)),
}


def run(loop: str, disturbance: str, d: float, seed: int) -> glapp.Result:
    """Analyse one simulated loop."""
    plant, controller = CONTROLLERS[loop]
    acting = DISTURBANCES[disturbance]
    random = Random(f"{loop} {disturbance} {seed}")
    s = closed_loop(
        plant,
        controller,
        d=d,
        noise=NOISE,
        h=H,
        t_end=T_END,
        setpoint=acting.setpoint(random),
        load=acting.load(random),
        limits=acting.limits,
        seed=random.randrange(2**32),
    )
    k, ti, td = [*controller, 0.0][:3]
    known: dict[str, Any] = {"op_span": acting.limits} if acting.limits else {"op_unit": "1"}
    settings = {"k": k, "ti": ti, "td": td, "setpoint_weight": 0, "gain_unit": "OP/PV"}
    process = {"kp": 1.0, "kp_unit": "PV/OP"}
    known |= {"controller": settings, "process": process}
    return glapp.analyze(glapp.recording_from(s.to_arrow(), glapp.Loop(name=loop, **known)), fit=False)


def _short(case: tuple[str, str, float, int]) -> tuple[str, float | None, int]:
    result = run(*case)
    return result.verdict, result.d_hat, result.detections


def rows(seeds: int) -> Iterator[list[str]]:
    """A row of the table for each loop, disturbance and width."""
    cases = [(loop, kind, d) for kind in DISTURBANCES for loop in CONTROLLERS for d in WIDTHS]
    with ProcessPoolExecutor() as pool:
        found = pool.map(_short, [(*case, seed) for case in cases for seed in range(seeds)], chunksize=4)
        for kind, loop, d in [(kind, loop, d) for loop, kind, d in cases]:
            answers = [next(found) for _ in range(seeds)]
            verdicts = Counter(verdict for verdict, _, _ in answers)
            shown = np.array([d_hat for _, d_hat, _ in answers if d_hat is not None])
            row = [kind, loop, f"{d:g}"]
            row += [str(verdicts[name]) for name in ("estimate", "provisional", "no_estimate", "refused")]
            row.append(f"{np.median([count for _, _, count in answers]):.0f}")
            if len(shown):
                middle, low, high = np.median(shown), shown.min(), shown.max()
                row += [f"{middle:.4f}", f"{100 * (middle / d - 1):+.0f} %" if d else "", f"{low:.4f} to {high:.4f}"]
            else:
                row += ["", "", ""]
            yield row


def main() -> None:
    """Print the table in Markdown."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    head = [
        "disturbance",
        "loop",
        "d",
        "est.",
        "prov.",
        "none",
        "refused",
        "det.",
        "median d̂",
        "bias",
        "lowest to highest",
    ]
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for row in rows(seeds):
        print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
