"""Chapter 6: the control modules, and the system that was built of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from glapp.modules import Backlash, BacklashDetection, Filter2P, Graph, Input, Module, Noise, Output, Pid, ProcessSim

from . import style
from .checks import CHECKS
from .figure import Number, Shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FIGURES"]

H, T_END, GAP = 0.1, 3000.0, 2.0
"""Time between scans [s], end [s], width of the gap [%]."""

SEEDS_6_5 = 5

POWER = 0.3
"""Amplitude of the noise in figure 6.1 [%]."""


def system(seed: int, **more: Any) -> Graph:
    """The modules of figure 6.5 and their connections; the filter is that of (2.1) with Ti/20.

    `more` are further settings of the detector.
    """
    modules = {
        "sp": Input(50.0),
        "load": Input(),
        "pid": Pid(k=2.0, ti=2.0, low=0.0, high=100.0, start=50.0),
        "gap": Backlash(GAP),
        "process": ProcessSim(gain=1.0, t1=3.0, t2=1.0, start=50.0),
        "noise": Noise(0.1, seed=seed),
        "filter": Filter2P(0.1),
        "watch": BacklashDetection(k=2.0, ti=2.0, kp=1.0, tf=0.0, **more),
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


OURS = "Our own drawing of our own module; the thesis' picture is another maker's symbol and was not at hand."


def one_module(module: Module, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Response of a module to a signal."""
    graph = Graph(H, {"in": Input(), "module": module, "out": Output()}, ["in -> module -> out"])
    return graph.run(H * len(x), record=["out"], **{"in": x})["out"]


def _module_figure(
    pins: tuple[str, str, list[str], list[str]], x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], colour: str
) -> Figure:
    figure, (diagram, below) = style.panels(2, height=3.6, share=False, ratios=(0.8, 2))
    style.pins(diagram, *pins)
    t = H * np.arange(len(x))
    below.plot(t, y, color=colour, linewidth=1.0, label="out")
    below.plot(t, x, **style.NARROW, label="in")
    below.set(xlabel="time [s]", ylabel="signal [%]", xlim=(0, t[-1]))
    style.legend(below)
    return figure


def figure_6_1() -> Shown:
    """The module that adds noise."""
    x = 50.0 + np.where(np.arange(600) % 300 < 150, 0.0, 1.0)
    y = one_module(Noise(POWER), x)
    return Shown(
        number="6.1",
        title="The module NoiseCC",
        section="6.2",
        sentence="One input, one output and one parameter, the amplitude: rectangular noise is added to what comes in.",
        numbers=(
            *CHECKS["noise"](),
            Number("greatest distance of the output from the input", "%", f"within {POWER:g}", float(abs(y - x).max())),
        ),
        difference=f"{OURS} `glapp.modules.Noise` stands for NoiseCC, its `amplitude` for `Power`.",
        draw=lambda: _module_figure(
            ("Noise\namplitude ± 0.3 %", style.MUTED, ["in"], ["out = in + noise"]), x, y, style.PV
        ),
    )


def figure_6_2() -> Shown:
    """The module with the gap."""
    x = 50.0 + 3.0 * np.sin(np.arange(600) * 2 * np.pi / 300) * np.linspace(1.0, 0.4, 600)
    y = one_module(Backlash(GAP), x)
    return Shown(
        number="6.2",
        title="The module BackLashCC",
        section="6.3",
        sentence="One input, one output and one parameter, the dead band: the output follows half of it behind the "
        "input, and waits where the input turns.",
        numbers=(
            *CHECKS["backlash"](),
            Number(
                "greatest distance of the output from the input", "%", f"within {GAP / 2:g}", float(abs(y - x).max())
            ),
        ),
        difference=f"{OURS} `glapp.modules.Backlash` stands for BackLashCC, its `d` for `deadband`.",
        draw=lambda: _module_figure(
            (f"Backlash\ndead band {GAP:g} %", style.POSITION, ["u"], ["u_true"]), x, y, style.POSITION
        ),
    )


PINS = {
    "sp": "SP",
    "pv": "PV",
    "op": "OP, where it can be read",
    "flags": "mode and limits",
    "u_ff": "u_FF as read back",
}
"""Inputs of the detector; the first two are the thesis'."""


def _connected() -> float:
    """All of them connected at once, without a controller among the modules; how many there are."""
    modules: dict[str, Module] = {name: Input() for name in PINS}
    modules |= {"watch": BacklashDetection(k=2.0, ti=2.0), "out": Output()}
    Graph(H, modules, [*(f"{name} -> watch.{name}" for name in PINS), "watch -> out"]).scan()
    return float(len(PINS))


def figure_6_3() -> Shown:
    """The detector as a module of its own."""

    def draw() -> Figure:
        figure, (axes,) = style.panels(height=2.6)
        style.pins(axes, "BacklashDetection\nK, Ti, Td, Kp, Tf", style.WRONG, list(PINS.values()), ["u_FF"])
        return figure

    return Shown(
        number="6.3",
        title="The module BackLashDetectionCC",
        section="6.4",
        sentence="SP and PV go in and u_FF comes out, for the feed-forward input of the controller, whose settings are "
        "parameters.",
        numbers=(Number("inputs", "", "2 or more", _connected()),),
        difference=f"{OURS} `glapp.modules.BacklashDetection` stands for BackLashDetectionCC. Its further inputs say "
        "when not to compensate; without OP nothing is compensated.",
        draw=draw,
    )


def figure_6_4() -> Shown:
    """Content of the interaction window, read from the module while it runs."""
    loop = system(0, op_low=0.0, op_high=100.0, comp_size=1.0, comp_withdraw=False)
    load = 5.0 * (np.arange(round(T_END / H)) // 2000 % 2)
    half = len(load) // 2
    before = loop.run(T_END / 2, record=["watch.d", "watch.detections"], load=load[:half])
    estimate, count = loop["watch.d_hat"], loop["watch.count"]
    loop["watch.compensate"] = 1
    after = loop.run(T_END / 2, record=["watch.d", "watch.detections"], load=load[half:])
    left = loop["watch.d_hat"]
    assert estimate is not None and count is not None and left is not None

    def draw() -> Figure:
        figure, (window, graph) = style.panels(2, height=4.8, share=False, ratios=(1.3, 1.6))
        rows = (
            ("Current dead band estimate", f"{estimate:.2f} %, of {count:.0f} detections", "d_hat, count"),
            ("Graph of the detections", "below", "d, detections"),
            ("Parameters", "K 2, Ti 2 s, Kp 1", "k, ti, td, kp, tf"),
            ("Compensate", "on from 1500 s, for 1 %", "compensate, standing"),
            ("Estimate while it compensates", f"{left:.2f} %", "d_hat"),
        )
        for x, title in ((0.0, "the thesis' window"), (0.38, "here"), (0.72, "variables of the module")):
            window.annotate(title, (x, 0.92), fontsize=8, color=style.MUTED)
        for i, row in enumerate(rows):
            for x, cell in zip((0.0, 0.38, 0.72), row, strict=True):
                window.annotate(cell, (x, 0.74 - 0.18 * i), fontsize=9, color=style.INK)
        window.set(xlim=(0, 1), ylim=(-0.05, 1))
        window.set_axis_off()
        for begin, seen, colour, name in (
            (0.0, before, style.DETECTION, "detection"),
            (T_END / 2, after, style.OP, "detection while it compensates"),
        ):
            new = np.flatnonzero(np.diff(seen["watch.detections"], prepend=seen["watch.detections"][0]) > 0)
            graph.plot(begin + H * new, seen["watch.d"][new], "o", color=colour, markersize=4, label=name)
        graph.axhline(GAP, color=style.TRUE, linewidth=1.0, label="the gap")
        graph.set(xlabel="time [s]", ylabel="detected width [%]", xlim=(0, T_END), ylim=(0, 3))
        style.legend(graph)
        return figure

    return Shown(
        number="6.4",
        title="The interaction window",
        section="6.4",
        sentence="The estimate, the detections in time, the parameters and the Compensate button, and what is detected "
        "while it compensates.",
        numbers=(
            Number("estimate of the gap of 2 %, nothing compensated", "%", None, estimate),
            Number("estimate while 1 % is compensated", "%", f"below {estimate:.4g}", left),
        ),
        difference="The thesis' picture is a screen of another maker's system and was not at hand; no likeness is "
        "meant. "
        "Each row has what that window offers, by the thesis' text, and the variables of `BacklashDetection` that "
        "hold it, as they stand at the end of the run. `glapp station` shows them on a screen.",
        draw=draw,
    )


FIGURES: dict[str, Callable[[], Shown]] = {
    "6.1": figure_6_1,
    "6.2": figure_6_2,
    "6.3": figure_6_3,
    "6.4": figure_6_4,
    "6.5": figure_6_5,
}
