"""Whether a gain of the wrong sign is noticed, and never on a healthy loop: `python -m bench.wrong_sign`.

The random loops of `bench/compensation.py`, each as it is and with its process turned round; OP's range is 100 % where
they have no limits. `--docs` writes the table into docs/modules.md; two minutes on two cores.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from glapp import _glapp
from glapp.blocks import SecondOrderFilter, WrongSign
from glapp.errors import InputError
from glapp.simulate import Scenario, Simulation, run

from .compensation import random_loop
from .page import write

RANGE = (-50.0, 50.0)
IN_A_ROW = 3
DISTURBED = 0b1000_1111
"""A gap, a bad value, not in automatic, at a limit, or a setpoint that moved."""


class Loop(NamedTuple):
    """What was found in a loop with the right sign, and with the wrong one."""

    own_limits: bool
    right: float | None
    """How long after PV last crossed SP it was found [Ti]; None: never."""
    wrong: float | None
    long: int
    """Long half-periods with the right sign; then the longest rows of them in which OP went against K, as it is and as
    it would be told wrongly."""
    against: int
    told_wrong: int


def _found(s: Simulation, of: Scenario) -> float | None:
    ideal, smooth = of.ideal(), SecondOrderFilter(of.filter_time())
    low, high = of.limits or RANGE
    block = WrongSign(ideal.k, ideal.ti, low, high)
    begun, before = 0.0, 0.0
    for t, sp, pv, op, flags in zip(
        s.t.tolist(), s.sp.tolist(), s.pv.tolist(), s.op.tolist(), s.flags.tolist(), strict=True
    ):
        yf = before if flags & 2 else smooth.update(pv, of.h)
        if (sp - yf) * (sp - before) <= 0:
            begun = t
        before = yf
        if block.update(sp, yf, op, of.h, flags):
            return float(t - begun) / ideal.ti
    return None


def _detected(s: Simulation, of: Scenario) -> tuple[int, int, int]:
    """Long half-periods, and the longest rows of them in which OP went against K as it is, and as told wrongly."""
    ideal = of.ideal()
    low, high = of.limits or RANGE
    detector = _glapp.Detector({**of.detector(of.filter_time()), "op_limits": (low, high)})
    rows, longest, long = [0, 0], [0, 0], 0
    for t, sp, pv, op, flags in zip(
        s.t.tolist(), s.sp.tolist(), s.pv.tolist(), s.op.tolist(), s.flags.tolist(), strict=True
    ):
        record = detector.update(t, sp, pv, op, flags)
        if record is None or record.mask & DISTURBED or record.delta_t <= 3 * ideal.ti:
            continue
        long += 1
        for i, travel in enumerate((record.op_travel, -record.op_travel)):
            rows[i] = rows[i] + 1 if travel + record.delta_u / 2 < 0 else 0
            longest[i] = max(longest[i], rows[i])
    return long, longest[0], longest[1]


def loop(number: int) -> Loop | None:
    """The two runs of a loop; None where it cannot begin at rest within its limits."""
    of = random_loop(number, "inverse").model_copy(update={"compensation": None})
    own = of.limits is not None
    of = of.model_copy(update={"limits": of.limits or RANGE})
    turned = of.model_copy(update={"plant": of.plant * -1.0})
    try:
        right, wrong = run(of), run(turned)
    except InputError:
        return None
    return Loop(own, _found(right, of), _found(wrong, turned), *_detected(right, of))


def rows(loops: list[Loop]) -> list[str]:
    """The table."""
    lines = [
        "| OP's range | loops | right sign: taken for wrong | wrong sign: missed | noticed after, median / 95 % [Ti] | "
        "three long half-periods | right K: taken for wrong | K told wrongly: missed |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, own in (("3 to 12 gaps to either side", True), ("100 %", False)):
        some = [one for one in loops if one.own_limits == own]
        after = [one.wrong for one in some if one.wrong is not None]
        known = [one for one in some if one.long >= IN_A_ROW]
        cells = [
            str(len(some)),
            str(sum(one.right is not None for one in some)),
            f"{sum(one.wrong is None for one in some)} ({np.mean([one.wrong is None for one in some]):.1%})",
            f"{np.median(after):.0f} / {np.percentile(after, 95):.0f}",
            str(len(known)),
            str(sum(one.against >= IN_A_ROW for one in known)),
            str(sum(one.told_wrong < IN_A_ROW for one in known)),
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def main() -> None:
    """Measure, print, and write into the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--first", type=int, default=5000, help="number of the first loop")
    parser.add_argument("--loops", type=int, default=1000, help="how many")
    parser.add_argument("--docs", action="store_true", help="write the table into docs/modules.md")
    given = parser.parse_args()
    numbers = range(given.first, given.first + given.loops)
    with ProcessPoolExecutor() as pool:
        found = list(zip(numbers, pool.map(partial(loop), numbers, chunksize=4), strict=True))
    loops = [one for _, one in found if one is not None]
    text = "\n".join(rows(loops))
    print(text)
    print("taken for wrong:", [number for number, one in found if one and one.right is not None])
    print("missed:", [number for number, one in found if one and one.wrong is None])
    if given.docs:
        write("modules.md", text, "wrong sign")


if __name__ == "__main__":
    main()
