"""Time of a fit, and of the same likelihood maximised with SciPy: `python -m bench.fit`.

On all processors; `RAYON_NUM_THREADS=1 python -m bench.fit` on one. The least of three fits counts.

SciPy's is one family of those that `glapp.fit` tries, written from the equations of docs/fit.md and not from the core:
two lags, a load that walks, white noise; a stationary Kalman filter as a transfer function run by `lfilter`, so that a
likelihood costs about a millisecond. What both find must agree.
"""

from __future__ import annotations

import os
import time

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # matrices of three rows: threads would only wait for each other
os.environ.setdefault("RAYON_NUM_THREADS", str(len(os.sched_getaffinity(0))))

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import minimize
from scipy.signal import lfilter, ss2tf

import glapp
from glapp.simulate import Simulation, closed_loop, random_walk

from .lengths import made

Floats = NDArray[np.float64]
H, D = 0.3, 0.05
DAYS = [f"{load}/PI/{gap}/0" for load in ("steps", "day", "walk", "setpoint") for gap in ("none", "gap")]
"""Records of `bench.lengths`."""
FIRST = 20
"""Innovations that are left out: the filter begins at rest."""


def loop(samples: int) -> Simulation:
    """P2 under a load that walks: what both models are made for but for the process' order."""
    return closed_loop(
        "P2",
        (0.775, 2.05, 0, 0),
        d=D,
        noise=0.005,
        load=random_walk(6 * samples + 1, H / 6, 0.006, 2),
        h=H / 6,
        t_end=samples * H,
        seed=1,
        filter_in_loop=True,
    )


def recording(samples: int) -> glapp.Recording:
    """Every sixth sample of it."""
    table = loop(samples).to_arrow().drop_columns("POSITION").take(np.arange(0, 6 * samples, 6))
    return glapp.recording_from(table, glapp.Loop(name="P2", op_unit="1"))


def gap(u: Floats, d: float) -> Floats:
    """Position of the valve behind a gap of width d, in its middle at first."""
    out = np.empty_like(u)
    x = u[0]
    for k, u_k in enumerate(u.tolist()):
        x = min(max(x, u_k - d / 2), u_k + d / 2)
        out[k] = x
    return out


def minus_two_log_likelihood(theta: Floats, y: Floats, v: Floats) -> float:
    """−2·ln L of lags (ln T₁, ln T₂), dead time [samples] and ln q, noise and gain at their best."""
    t1, t2, q = np.exp(np.clip(theta[[0, 1, 3]], -12.0, 12.0))
    if not 0 <= theta[2] <= 60 or t1 > 200 or t2 > 200:
        return 1e12
    generator = np.zeros((3, 3))
    generator[0, 1] = 1.0
    generator[1] = -1.0 / (t1 * t2), -(t1 + t2) / (t1 * t2), 1.0 / (t1 * t2)
    a = expm(generator)
    b, c = a[:, 2:].copy(), np.array([[1.0, 0.0, 0.0]])
    b[2] = 0.0
    p = solve_discrete_are(a.T, c.T, np.diag([0.0, 0.0, q]) + 1e-14 * np.eye(3), np.eye(1))
    s = float((c @ p @ c.T).item()) + 1.0
    k = a @ p @ c.T / s
    whole = np.floor(theta[2])
    part = theta[2] - whole
    at = np.arange(len(v)) - int(whole)
    last = len(v) - 1
    delayed = (1 - part) * v[np.clip(at, 0, last)] + part * v[np.clip(at - 1, 0, last)]

    def innovations(column: Floats, x: Floats, direct: float) -> Floats:
        numerator, denominator = ss2tf(a - k @ c, column, -c, np.array([[direct]]))
        out: Floats = lfilter(numerator[0], denominator, x)[FIRST:]
        return out

    of_y = innovations(k, y - y[0], 1.0)
    of_v = -innovations(b, delayed - delayed[0], 0.0)
    kp = of_y @ of_v / max(of_v @ of_v, 1e-300)
    rest = of_y - kp * of_v
    n = len(rest)
    return n * float(np.log(rest @ rest / n / s)) + n * float(np.log(s))


def with_scipy(y: Floats, u: Floats, widths: Floats) -> tuple[float, int]:
    """The most likely of the widths, and how many likelihoods that took."""
    evaluations, best = 0, (np.inf, 0.0)
    starts = [np.array([np.log(t), np.log(t), 1.0, -2.0]) for t in (2.0, 8.0)]
    for d in widths:
        v = gap(u, d)
        for start in starts:
            found = minimize(minus_two_log_likelihood, start, (y, v), "Nelder-Mead", options={"maxfev": 300})
            evaluations += found.nfev
            best = min(best, (found.fun, float(d)))
    return best[1], evaluations


def main() -> None:
    """Print the table."""
    table = Table("work", "time", "width", "likelihoods", title=f"{os.environ['RAYON_NUM_THREADS']} threads")
    shown = 751
    for samples in (751, 3000, 30_000):
        record = recording(samples)
        took = np.inf
        for _ in range(3):
            begun = time.perf_counter()
            answer = glapp.fit(record)
            took = min(took, time.perf_counter() - begun)
        table.add_row(f"glapp.fit, {samples} samples", f"{took:.2f} s", f"{answer.d:.4f} ({answer.low:.4f}…)", "")
        if samples == shown:
            ours, ours_took = answer.d, took
    days = []
    for name in DAYS:
        day = made(name, 86_400).recording(86_400)
        begun = time.perf_counter()
        glapp.fit(day)
        days.append(time.perf_counter() - begun)
    title = f"glapp.fit, a day at 1 s: median of {len(days)}, least and most"
    table.add_row(title, f"{np.median(days):.1f} s, {min(days):.1f} and {max(days):.1f} s", "", "")
    rows = loop(shown)
    y, u = (column[: 6 * shown : 6] for column in (rows.pv, rows.op))
    widths = np.linspace(0.0, np.ptp(u), 9)
    begun = time.perf_counter()
    d, evaluations = with_scipy(y, u, widths)
    took = time.perf_counter() - begun
    assert ours is not None and abs(d - ours) <= widths[1], f"SciPy finds {d}, glapp.fit {ours}"
    table.add_row(f"SciPy, one family, 9 widths, {shown} samples", f"{took:.2f} s", f"{d:.4f}", str(evaluations))
    table.add_row("SciPy / glapp.fit", f"{took / ours_took:.1f} ×", "", "")
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
