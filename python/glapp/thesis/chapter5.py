"""Chapter 5: the safety net, condition by condition."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..simulate import run, run_many
from . import style
from .figure import Number, Shown
from .loops import PERCENT, Detected, detect, safety_net_loop

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..simulate import Simulation

__all__ = ["FIGURES"]

WITHHELD = (
    "The thesis gives neither noise, sample time nor the size of the load step. Here: uniform noise of ± 0.05 %, "
    "h = 0.01 s, load step 100 %, which come nearest to its three facts (over 100 % at 105 s, 5 % before and noise "
    "after 550 s)."
)


def figure_5_1() -> Shown:
    """The condition Δt > 5Ti alone."""
    scenario = safety_net_loop()
    signals = run(scenario)
    seen = detect(scenario, signals, ("5Ti",))
    settled = seen.t > 130
    true = settled & (abs(seen.d - 5) < 1)
    noise = settled & (seen.d < 2)

    def draw() -> Figure:
        figure, (top, bottom) = style.panels(2, height=4.6)
        pv_and_sp(top, signals, seen)
        detections(bottom, seen)
        bottom.set(xlabel="time [s]", ylim=(-5, 145))
        return figure

    return Shown(
        number="5.1",
        title="Detections with Δt > 5Ti alone",
        section="5.2",
        sentence="On P3 the condition Δt > 5Ti lets through the widths of both steps, far too high, and from 550 s on "
        "those of mere noise, near zero.",
        numbers=(
            Number("shortest half-period accepted, 5Ti", "s", 1.6, 5 * scenario.ideal().ti),
            Number("median detection before the noise", "%", 5.0, float(np.median(seen.d[true]))),
            Number("last true detection", "s", 550.0, float(seen.t[true].max())),
            Number("first detection of noise", "s", 550.0, float(seen.t[noise].min())),
            Number("first detection of noise, median of 20 seeds", "s", None, _first_noise(20)),
            Number("detections of noise", "", None, float(noise.sum())),
        ),
        difference=WITHHELD,
        draw=draw,
    )


def _first_noise(seeds: int) -> float:
    scenarios = [safety_net_loop(seed=seed) for seed in range(seeds)]
    first = []
    for scenario, signals in zip(scenarios, run_many(scenarios, progress=False), strict=True):
        seen = detect(scenario, signals, ("5Ti",))
        first.append(float(seen.t[(seen.t > 130) & (seen.d < 2)].min()))
    return float(np.median(first))


def pv_and_sp(axes: Axes, signals: Simulation, seen: Detected) -> None:
    """Setpoint, process value and filtered process value [%]."""
    axes.plot(signals.t, PERCENT * signals.pv, color=style.PV, linewidth=0.8, label="PV")
    axes.plot(signals.t, PERCENT * seen.filtered, color=style.FILTERED, linewidth=1.2, label="PV filtered")
    axes.plot(signals.t, PERCENT * signals.sp, **style.NARROW, label="SP")
    axes.set_ylabel("SP, PV [%]")
    style.legend(axes)


def detections(axes: Axes, seen: Detected, true: float = 5.0) -> None:
    """Detections, right ones and others, and the true width [%]."""
    right = abs(seen.d - true) <= 0.2 * true
    for which, colour, marker, name in (
        (right, style.DETECTION, "o", "detection within 20 % of the gap"),
        (~right, style.WRONG, "x", "other detection"),
    ):
        axes.plot(seen.t[which], seen.d[which], marker, color=colour, markersize=5, label=name)
    axes.axhline(true, color=style.TRUE, linewidth=1.0, label="the gap")
    axes.set_ylabel("detected width [%]")
    style.legend(axes)


FIGURES: dict[str, Callable[[], Shown]] = {"5.1": figure_5_1}
