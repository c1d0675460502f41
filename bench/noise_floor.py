"""Number of widths that noise makes, and of those shown, P1 to P8: `python -m bench.noise_floor`.

PI by MIGO (Ms 2.0) and PID by AMIGO, detector's filter Ti/2, noise of ± 0.005, steps of the load, 20 000 samples.
"""

from __future__ import annotations

from collections import Counter

import glapp
from glapp import tuning
from glapp.controller import Ideal
from glapp.plant import PLANTS
from glapp.simulate import Simulation, closed_loop

WIDTHS = (0.0, 0.02, 0.05)


def record(plant: str, c: Ideal, d: float, seed: int) -> Simulation:
    """A loop under steps of its load."""
    load = [(100 * c.ti * k, 0.3 * (k % 2)) for k in range(1, 10)]
    settings = {"noise": 0.005, "h": c.ti / 20, "t_end": 1000 * c.ti, "seed": seed, "setpoint": [(0, 1.0)]}
    return closed_loop(plant, (c.k, c.ti, c.td, 0.0), d=d, load=load, **settings, filter_in_loop=True)


def main(seeds: int = 2) -> None:
    """Print the table."""
    counts: dict[float, Counter[str]] = {d: Counter() for d in WIDTHS}
    for plant in PLANTS:
        process = {"type": "integrating"} if PLANTS[plant].gain is None else {"kp": PLANTS[plant].gain}
        for c in (tuning.migo(plant, ms=2.0).controller, tuning.amigo_step(plant, "PID").controller):
            controller = {"k": c.k, "ti": c.ti, "td": c.td, "setpoint_weight": c.b}
            loop = glapp.Loop(name=plant, controller=controller, process=process, op_unit="V", tf=c.ti / 2)
            for d in WIDTHS:
                for seed in range(seeds):
                    s = record(plant, c, d, seed)
                    stream = glapp.Estimator(loop, h=c.ti / 20)
                    stream.update_many(s.t, s.sp, s.pv, s.op)
                    result = glapp.analyze(glapp.recording_from(s.to_arrow(), loop), fit=False)
                    counts[d]["runs"] += 1
                    counts[d]["said"] += stream.median_mean is not None
                    counts[d]["shown"] += stream.estimate is not None
                    counts[d]["analyze"] += result.d_hat is not None
    print("| d | records | the detections say a width | the stream shows one | `analyze` shows one |")
    print("|---|---|---|---|---|")
    for d, n in counts.items():
        print(f"| {d:g} | {n['runs']} | {n['said']} | {n['shown']} | {n['analyze']} |")


if __name__ == "__main__":
    main()
