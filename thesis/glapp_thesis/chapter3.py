"""Chapter 3: a loop built of blocks, without a gap and with one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from glapp.modules import Backlash, Graph, Input, Module, Pid, Plant

from . import style
from .figure import Number, Shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FIGURES"]

H, T_END, GAP = 0.02, 200.0, 5.0
"""Time between scans [s], end [s], width of the gap [%]."""

STANDS_FOR = (
    "Our own diagram of our own modules; the thesis' picture is a Simulink model and was not at hand. `Input` stands "
    "for "
    "Simulink's Step, `Pid` for Sum and PID Controller together, `Plant` for Transfer Fcn, the panels below for Scope"
)


def loop(gap: tuple[str, Module] | None) -> dict[str, npt.NDArray[np.float64]]:
    """P3 with the controller of section 5.2: a step of SP at 0 s, and one of the load at 100 s."""
    between = {} if gap is None else dict([gap])
    way = " -> ".join(["pid", *between, "process", "pid.pv"])
    modules = {"sp": Input(50.0), "load": Input(), "pid": Pid(k=0.48, ti=0.3117), **between, "process": Plant("P3")}
    graph = Graph(H, modules, ["sp -> pid.sp", "load -> process.load", way])
    steps = np.where(np.arange(round(T_END / H)) * H >= T_END / 2, 20.0, 0.0)
    return graph.run(T_END, load=steps, record=["sp", "pid", "process", *between])


def _picture(
    names: tuple[str, ...], colours: tuple[str, ...], seen: dict[str, npt.NDArray[np.float64]], valve: str | None
) -> Figure:
    figure, (diagram, top, bottom) = style.panels(3, height=5.6, share=False, ratios=(0.9, 1.2, 1.2))
    style.blocks(diagram, names, colours, back="PV")
    top.plot(seen["t"], seen["process"], color=style.FILTERED, linewidth=1.2, label="PV")
    top.plot(seen["t"], seen["sp"], **style.NARROW, label="SP")
    top.set(ylabel="SP, PV [%]", xlabel="time [s]", xlim=(0, T_END), ylim=(40, 75))
    bottom.plot(seen["t"], seen["pid"], color=style.OP, linewidth=1.2, label="OP")
    if valve is not None:
        bottom.plot(seen["t"], seen[valve], color=style.POSITION, linewidth=1.2, label="valve position")
    bottom.set(ylabel="OP [%]" if valve is None else "OP, position [%]", xlabel="time [s]", xlim=(0, T_END))
    bottom.set(ylim=(20, 60))
    style.legend(top)
    style.legend(bottom)
    return figure


def _late(x: npt.NDArray[np.float64]) -> float:
    """Swing of a signal in the last quarter."""
    return round(float(np.ptp(x[-len(x) // 4 :])), 9)


def figure_3_1() -> Shown:
    """A loop without a gap."""
    seen = loop(None)
    return Shown(
        number="3.1",
        title="A simple control loop",
        section="3.3",
        sentence="Setpoint, controller and process, connected to a loop: PV comes to rest at SP after a step of the "
        "setpoint and one of the load.",
        numbers=(
            Number("PV off SP at the end", "%", None, round(float(abs(seen["process"][-1] - 50.0)), 9)),
            Number("swing of OP in the last 50 s", "%", None, _late(seen["pid"])),
        ),
        difference=f"{STANDS_FOR}.",
        draw=lambda: _picture(("Input\n(SP)", "Pid", "Plant"), (style.MUTED, style.OP, style.FILTERED), seen, None),
    )


def figure_3_2() -> Shown:
    """The loop of figure 3.1 with a gap on the input of the process."""
    seen, without = loop(("gap", Backlash(GAP))), loop(None)
    return Shown(
        number="3.2",
        title="The loop with a gap on the input of the process",
        section="3.3",
        sentence="With one more module between controller and process OP drifts through the gap while the valve "
        "hardly moves.",
        numbers=(
            Number("swing of OP in the last 50 s", "%", None, _late(seen["pid"])),
            Number("swing of the valve in the last 50 s", "%", None, _late(seen["gap"])),
            Number("swing of OP in the last 50 s without the gap", "%", None, _late(without["pid"])),
        ),
        difference=f"{STANDS_FOR}, `Backlash` for Backlash.",
        draw=lambda: _picture(
            ("Input\n(SP)", "Pid", f"Backlash\n{GAP:g} %", "Plant"),
            (style.MUTED, style.OP, style.POSITION, style.FILTERED),
            seen,
            "gap",
        ),
    )


FIGURES: dict[str, Callable[[], Shown]] = {"3.1": figure_3_1, "3.2": figure_3_2}
