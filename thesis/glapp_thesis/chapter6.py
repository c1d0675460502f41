"""Chapter 6: the system that was built of control modules."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from glapp.modules import Backlash, BacklashDetection, Filter2P, Graph, Input, Noise, Pid, ProcessSim

from . import style
from .figure import Number, Shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FIGURES"]

H, T_END, GAP = 0.1, 3000.0, 2.0
"""Time between scans [s], end [s], width of the gap [%]."""

SEEDS_6_5 = 5


def system(seed: int) -> Graph:
    """The modules of figure 6.5 and their connections; the filter is that of (2.1) with Ti/20."""
    modules = {
        "sp": Input(50.0),
        "load": Input(),
        "pid": Pid(k=2.0, ti=2.0, low=0.0, high=100.0, start=50.0),
        "gap": Backlash(GAP),
        "process": ProcessSim(gain=1.0, t1=3.0, t2=1.0, start=50.0),
        "noise": Noise(0.1, seed=seed),
        "filter": Filter2P(0.1),
        "watch": BacklashDetection(k=2.0, ti=2.0, kp=1.0, tf=0.0),
    }
    wires = ["sp -> pid.sp", "sp -> watch.sp", "load -> process.load", "filter -> watch.pv", "watch -> pid.ff"]
    return Graph(H, modules, [*wires, "pid -> gap -> process -> noise -> filter -> pid.pv"])


def figure_6_5() -> Shown:
    """The system of control modules, and what its detector shows."""
    load = 5.0 * (np.arange(round(T_END / H)) // 2000 % 2)
    runs = []
    for seed in range(SEEDS_6_5):
        loop = system(seed)
        runs.append(loop.run(T_END, record=["noise", "sp", "watch.d_hat"], load=load))
    last = [float(run["watch.d_hat"][-1]) for run in runs]
    shown = runs[0]

    def draw() -> Figure:
        figure, (diagram, top, bottom) = style.panels(3, height=6.6, share=False, ratios=(1.2, 1.4, 1.1))
        names = ("PidCC", "BackLash\nCC", "ProcessSim\nCC", "NoiseCC", "Filter2P\nCC")
        colours = (style.OP, style.POSITION, style.FILTERED, style.MUTED, style.FILTERED)
        style.blocks(diagram, names, colours, back="PV", beside="BackLashDetectionCC")
        t = np.arange(len(load)) * H
        here = (t > 1000) & (t < 1600)
        top.plot(t[here], shown["noise"][here], color=style.PV, linewidth=0.8, label="PV")
        top.plot(t[here], shown["sp"][here], **style.NARROW, label="SP")
        top.set(xlabel="time [s]", ylabel="SP, PV [%]", xlim=(1000, 1600))
        for run in runs:
            bottom.plot(t, run["watch.d_hat"], color=style.DETECTION, linewidth=0.9, alpha=0.7)
        bottom.plot([], [], color=style.DETECTION, linewidth=0.9, label=f"shown, {SEEDS_6_5} seeds of the noise")
        bottom.axhline(GAP, color=style.TRUE, linewidth=1.0, label="the gap")
        bottom.set(xlabel="time [s]", ylabel="width [%]", ylim=(0, 3), xlim=(0, T_END))
        style.legend(top)
        style.legend(bottom)
        return figure

    return Shown(
        number="6.5",
        title="The system of control modules",
        section="6.5",
        sentence="Connected as in the thesis, the modules show a gap of 2.0 % as a little less while nothing is "
        "compensated.",
        numbers=(
            Number(f"width shown at the end, median of {SEEDS_6_5} seeds", "%", 1.8, float(np.median(last))),
            Number("lowest", "%", None, min(last)),
            Number("highest", "%", None, max(last)),
        ),
        difference="Process, tuning, noise and load are not in the thesis. Here the process has lags of 3 s and 1 s, "
        "the controller K = 2 and Ti = 2 s, the noise ± 0.1 %, and the load steps by 5 % every 200 s.",
        draw=draw,
    )


FIGURES: dict[str, Callable[[], Shown]] = {"6.5": figure_6_5}
