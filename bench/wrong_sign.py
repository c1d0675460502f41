"""Whether a gain of the wrong sign is noticed, and never on a healthy loop: `python -m bench.wrong_sign`.

The random loops of `bench/compensation.py`, each as it is, with its process turned round, and with a detector that is
told a K of the other sign; OP's range is 100 % where they have no limits. What notices it is the module that ships,
beside a controller that nothing compensates. `--docs` writes bench/results/modules.md; two minutes on two cores.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from glapp.errors import InputError
from glapp.simulate import Scenario, Simulation, run

from .compensation import half_periods, random_loop
from .page import write

RANGE = (-50.0, 50.0)


class Loop(NamedTuple):
    """Times of `WRONG_SIGN` in a loop, by the module beside its controller; None: never."""

    own_limits: bool
    right: float | None
    """Time of the warning with the right sign, after PV last crossed SP [Ti]."""
    wrong: float | None
    """Time of the warning with the process turned round, after PV last crossed SP [Ti]."""
    wrong_k: float | None
    """Time of the warning where the module's K has another sign than the controller's, after the beginning [Ti]."""


def _found(s: Simulation) -> float | None:
    assert s.error is not None
    rows = np.flatnonzero(s.error)
    return float(s.t[rows[0]]) if rows.size else None


def _since_crossing(s: Simulation, case: Scenario) -> float | None:
    found = _found(s)
    if found is None:
        return None
    return (found - max((end for end, _, _ in half_periods(s, case) if end <= found), default=0.0)) / case.ideal().ti


def loop(number: int) -> Loop | None:
    """The runs of a loop, never compensated; None where it cannot begin at rest within its limits."""
    drawn = random_loop(number, "inverse")
    assert drawn.compensation is not None
    ideal = drawn.ideal()

    def with_k(k: float) -> Scenario:
        given = drawn.compensation.model_copy(update={"begin": 2 * drawn.t_end, "k": k})  # type: ignore[union-attr]
        return drawn.model_copy(update={"limits": drawn.limits or RANGE, "compensation": given})

    case = with_k(ideal.k)
    turned = case.model_copy(update={"plant": case.plant * -1.0})
    try:
        right, wrong, wrong_k = run(case), run(turned), _found(run(with_k(-ideal.k)))
    except InputError:
        return None
    return Loop(
        own_limits=drawn.limits is not None,
        right=_since_crossing(right, case),
        wrong=_since_crossing(wrong, turned),
        wrong_k=None if wrong_k is None else wrong_k / ideal.ti,
    )


def _cells(after: list[float | None]) -> list[str]:
    """Number of misses, and the times of the others."""
    known = [one for one in after if one is not None]
    missed = len(after) - len(known)
    took = f"{np.median(known):.0f} / {np.percentile(known, 95):.0f}" if known else ""
    return [f"{missed} ({missed / max(len(after), 1):.1%})", took]


def rows(loops: list[Loop]) -> list[str]:
    """The table."""
    lines = [
        "| OP's range | loops | right sign: taken for wrong | wrong sign: missed | noticed after, median / 95 % [Ti] | "
        "K told wrongly: missed | noticed after, median / 95 % [Ti] |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, own in (("3 to 12 gaps to either side", True), ("100 %", False)):
        some = [one for one in loops if one.own_limits == own]
        cells = [str(len(some)), str(sum(one.right is not None for one in some))]
        cells += [*_cells([one.wrong for one in some]), *_cells([one.wrong_k for one in some])]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def main() -> None:
    """Measure, print, and write into the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--first", type=int, default=5000, help="number of the first loop")
    parser.add_argument("--loops", type=int, default=1000, help="how many")
    parser.add_argument("--docs", action="store_true", help="write the table into bench/results/modules.md")
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
