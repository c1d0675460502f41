"""The zero-crossing estimator on loops whose gap is known, `python -m bench.truth.zero_crossing [seeds]`.

Four loops, four widths, five kinds of disturbance, 20 seeds of noise and disturbance each. Noise of amplitude 0.005
on PV, h = 0.05 s, an hour of the loop's time. The settings are given, as from a control system; nothing tells the
detector the width. The second table has the corrected width of the same runs: with OP and Kp, without Kp, without OP.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from random import Random
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

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
    """Signals from outside the loop, a setpoint and a load from a seed, and limits of OP."""

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


class Run(NamedTuple):
    """Results of one simulated loop: as in the thesis, and corrected."""

    verdict: str
    d_hat: float | None
    detections: int
    known: glapp.Corrected | None
    d_hat_without_kp: float | None
    together: glapp.Corrected | None
    without_op: glapp.Corrected | None


def run(case: tuple[str, str, float, int]) -> Run:
    """Analyse one simulated loop: loop, disturbance, width, seed."""
    loop, disturbance, d, seed = case
    plant, controller = CONTROLLERS[loop]
    acting = DISTURBANCES[disturbance]
    random = Random(f"{loop} {disturbance} {seed}")
    s = closed_loop(
        plant,
        (*controller, 0.0, 0.0)[:4],
        d=d,
        noise=NOISE,
        h=H,
        t_end=T_END,
        setpoint=acting.setpoint(random),
        load=acting.load(random),
        limits=acting.limits,
        seed=random.randrange(2**32),
        filter_in_loop=True,
    )
    k, ti, td = [*controller, 0.0][:3]
    settings = {"k": k, "ti": ti, "td": td, "setpoint_weight": 0, "gain_unit": "OP/PV"}
    known: dict[str, Any] = {"op_span": acting.limits} if acting.limits else {"op_unit": "1"}
    known["controller"] = settings
    process = {"kp": 1.0, "kp_unit": "PV/OP"}
    table = s.to_arrow()

    def analyzed(table: pa.Table, **more: Any) -> glapp.Result:
        return glapp.analyze(glapp.recording_from(table, glapp.Loop(name=loop, **known, **more)), fit=False)

    result = analyzed(table, process=process)
    together, without_op = analyzed(table), analyzed(table.drop_columns("OP"), process=process)
    answers = (result.corrected, together.d_hat, together.corrected, without_op.corrected)
    return Run(result.verdict, result.d_hat, result.detections, *answers)


def rows(seeds: int) -> Iterator[tuple[list[str], list[str]]]:
    """A row of each table for each loop, disturbance and width."""
    cases = [(loop, kind, d) for kind in DISTURBANCES for loop in CONTROLLERS for d in WIDTHS]
    with ProcessPoolExecutor() as pool:
        found = pool.map(run, [(*case, seed) for case in cases for seed in range(seeds)], chunksize=4)
        for loop, kind, d in cases:
            runs = [next(found) for _ in range(seeds)]
            verdicts = Counter(run.verdict for run in runs)
            row = [kind, loop, f"{d:g}"]
            counts = [str(verdicts[name]) for name in ("estimate", "provisional", "no_estimate", "refused")]
            counts.append(f"{np.median([run.detections for run in runs]):.0f}")
            shown = [run.d_hat for run in runs if run.d_hat is not None]
            corrected = [str(len(shown)), _bias(shown, d)[0]]
            for way in ("known", "together", "without_op"):
                if way == "together":
                    plain = [run.d_hat_without_kp for run in runs if run.d_hat_without_kp is not None]
                    corrected.append(_bias(plain, d)[0])
                given = [c for run in runs if (c := getattr(run, way)) is not None and c.d is not None]
                corrected += [str(len(given)), *_bias([c.d for c in given], d)]
                if way == "together":
                    corrected.append(f"{np.median([c.kp for c in given]):.2f}" if given else "")
            yield row + counts + [f"{np.median(shown):.4f}" if shown else "", *_bias(shown, d)], row + corrected


def _bias(widths: Sequence[float], d: float) -> list[str]:
    """Bias of the median, lowest to highest."""
    if not widths:
        return ["", ""]
    bias = f"{100 * (np.median(widths) / d - 1):+.0f} %" if d else ""
    return [bias, f"{min(widths):.4f} to {max(widths):.4f}"]


def _print(head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)


def main() -> None:
    """Print the tables in Markdown."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    plain: list[list[str]] = []
    corrected: list[list[str]] = []
    for first, second in rows(seeds):
        plain.append(first)
        if int(second[3]):
            corrected.append(second)
    which = ["disturbance", "loop", "d"]
    shown = ["median d̂", "bias", "lowest to highest"]
    _print([*which, "est.", "prov.", "none", "refused", "det.", *shown], plain)
    print()
    head = [*which, "d̂", "bias", "corrected", "bias", "lowest to highest"]
    head += ["d̂ without Kp", "corrected", "bias", "lowest to highest", "Kp", "without OP", "bias", "lowest to highest"]
    _print(head, corrected)


if __name__ == "__main__":
    main()
