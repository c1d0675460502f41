"""The least IAE under bounds on the robustness, with the measurement filter counted in."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..errors import InputError
from ..plant import Plant
from .assess import Tuning, assess, closed_loop_stable, iae_of, open_loop
from .circles import circles_of, coarse_frequencies, gains_at_the_limit
from .migo import migo
from .process import Array, Kind, Process, sign_of, stable


def design(plant: Process, kind: Kind = "PID", *, ms: float = 1.4, mt: float = 1.4) -> Tuning:
    """Least IAE after a load step subject to Ms and Mt, with the measurement filter of (2.1) counted in.

    The filter goes with the controller, Tf = Td/5, for PI Ti/10, and costs phase, so it must not be added afterwards.
    IAE, and not 1/ki as in `migo`: with a derivative part the greatest ki swings. For every (Ti, Td) the gain is the
    greatest that the constraints allow; the two are found by a simplex search from the MIGO controller.

    Parameters
    ----------
    plant : process
        Stable, or with one integrator.
    kind : {"PI", "PID"}
    ms, mt : float
        Bounds of Ms and Mt, > 1.

    References
    ----------
    Garpinger and Hägglund, *A software tool for robust PID design*, IFAC World Congress 2008, which the thesis calls
    designPID.

    Examples
    --------
    >>> t = design("P2", "PI")
    >>> f"{t.ms:.2f} {t.mt:.2f}, Tf = {t.tf / t.controller.ti:.1f} Ti"
    '1.40 1.00, Tf = 0.1 Ti'
    """
    plant = stable(Plant.of(plant))
    circles, bound = circles_of(None, ms, mt)
    sign = sign_of(plant)
    start = migo(plant, kind, ms=ms, mt=mt).controller
    coarse = coarse_frequencies(plant)
    least = [math.inf]  # IAE so far

    def settings(times: Array) -> tuple[float, float, float]:
        """Ti, Td and Tf [s]."""
        ti, td = math.exp(times[0]), math.exp(times[1]) if kind == "PID" else 0.0
        return ti, td, td / 5 if td else ti / 10

    def greatest(times: Array, w: Array) -> tuple[float, float]:
        """The greatest gain that is allowed, and the IAE that it leaves; 0 and inf where none is."""
        ti, td, tf = settings(times)
        unit = open_loop(plant, (sign, ti, td), tf)
        shape = unit.response(w)
        for k in gains_at_the_limit(shape, circles, unit.integrators):
            if closed_loop_stable(unit, k * shape):
                nearest = float(w[int(np.argmin(np.abs(1 + k * shape)))])
                # 1/ki is never more than IAE: a controller that is far behind by it needs no closer look.
                return k, ti / k if ti / k > 3 * least[0] else iae_of(plant, unit * k, k / ti, nearest)
        return 0.0, math.inf

    def cost(times: Array) -> float:
        iae = min(greatest(times, coarse)[1], 1e300)  # finite, so that the simplex can take differences
        least[0] = min(least[0], iae)
        return iae

    begin = np.log(start[1:3] if kind == "PID" else start[1:2])
    for _ in range(20):  # the filter may have left no gain that is robust at that Ti
        if cost(begin) < 1e300:
            break
        begin[0] += 0.2
    else:
        raise InputError(f"no {kind} controller with its filter meets {bound}", parameter="plant", value=plant)
    best, fine = _simplex(cost, begin), plant.frequencies(per_decade=1000)
    expected, k = greatest(best, coarse)[0], 0.0
    for _ in range(20):  # the best Ti may be the least at which this gain was robust, on the coarse grid
        k = greatest(best, fine)[0]
        if k > 0.9 * expected:
            break
        best[0] += 0.01
    ti, td, tf = settings(best)
    source = "after Garpinger & Hägglund, IFAC World Congress (2008)"
    return assess(plant, (sign * k, ti, td), tf=tf, rule=f"design ({bound}) {kind}", source=source)


def _simplex(cost: Callable[[Array], float], start: Array) -> Array:
    """Least cost by Nelder and Mead's method."""
    try:
        from scipy.optimize import minimize
    except ImportError:
        raise ImportError("design() needs SciPy: install glapp[tuning]") from None
    begin = np.vstack([start, *(start + 0.2 * np.eye(start.size))])
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": begin, "xatol": 1e-3, "fatol": math.inf, "maxiter": 120},
    )
    return np.asarray(found.x, dtype=np.float64)
