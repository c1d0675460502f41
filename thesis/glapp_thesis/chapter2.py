"""Chapter 2: how a gap is read off the signals, and how a lead keeps its oscillation away."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from glapp.nonlinear import backlash_cycles, phase_lead
from glapp.plant import PLANTS, Plant
from glapp.simulate import Simulation, run

from . import style
from .figure import Number, Shown
from .loops import PERCENT, detect, safety_net_loop, short
from .nyquist import draw_gap, draw_loops, frame

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FIGURES"]


BOX = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}


def figure_2_1() -> Shown:
    """One half-period with its names."""
    scenario = safety_net_loop(t_end=340.0)
    signals = run(scenario)
    seen = detect(scenario, signals, ("5Ti",))
    i = int(np.flatnonzero(seen.accepted)[-1])
    rows = {name: float(column[i]) for name, column in seen.half_periods.to_dict().items()}
    begin, end = rows["t_start"], rows["t_end"]
    here = (signals.t > begin - 60) & (signals.t < end + 15)
    inside = (signals.t >= begin) & (signals.t <= end)
    travel = PERCENT * abs(float(signals.op[inside][-1] - signals.op[inside][0]))

    def draw() -> Figure:
        figure, (top, bottom) = style.panels(2, height=4.8)
        t, y = signals.t[here], PERCENT * (signals.pv - signals.sp)[here]
        filtered = PERCENT * (seen.filtered - signals.sp)[here]
        top.plot(t, y, color=style.PV, linewidth=0.8, label="PV − SP")
        top.plot(t, filtered, color=style.FILTERED, linewidth=1.5, label="filtered")
        top.axhline(0, **style.NARROW)
        dy = -rows["sign"] * PERCENT * rows["delta_y"]
        middle = (begin + end) / 2
        arrow = {"arrowstyle": "<->", "color": style.INK, "shrinkA": 0, "shrinkB": 0}
        top.annotate("", xytext=(begin, 0), xy=(end, 0), arrowprops=arrow)
        top.text(middle, 0, "Δt", ha="center", va="center", bbox=BOX)
        top.annotate("", xytext=(middle + 12, 0), xy=(middle + 12, dy), arrowprops=arrow)
        top.text(middle + 14, dy / 2, "Δy", va="center", bbox=BOX)
        top.set_ylabel("PV − SP [%]")
        style.legend(top)
        bottom.plot(t, PERCENT * signals.op[here], color=style.OP, linewidth=1.5, label="OP")
        bottom.plot(t, PERCENT * signals.position[here], color=style.POSITION, linewidth=1.5, label="valve position")
        bottom.set(xlabel="time [s]", ylabel="OP, position [%]")
        style.legend(bottom)
        for axes in (top, bottom):
            for at in (begin, end):
                axes.axvline(at, color=style.MUTED, linewidth=0.8, linestyle=":")
        return figure

    return Shown(
        number="2.1",
        title="What a gap does to PV and OP",
        section="2.1",
        sentence="While OP drifts through the gap the valve stands and PV stays a distance Δy from SP; the drift Δu "
        "between two zero crossings, less Δy/Kp, is the width (2.4).",
        numbers=(
            Number("gap", "%", None, PERCENT * scenario.d),
            Number("Δu = K/Ti·Δy·Δt, from SP and PV alone", "%", None, PERCENT * rows["delta_u"]),
            Number(
                "Δu, read off OP",
                "%",
                "the same",
                travel,
                holds=math.isclose(travel, PERCENT * rows["delta_u"], rel_tol=0.01),
            ),
            Number("width (2.4)", "%", None, PERCENT * rows["d"]),
        ),
        difference="Process, controller and noise of the figure are not given; here P3 as in figure 5.1.",
        draw=draw,
    )


def figure_2_2() -> Shown:
    """A phase lead keeps the curves apart."""
    gain, d = 1.6, 0.05
    plant = PLANTS["P1"] * Plant([1], [0.5, 1])
    loop = gain * plant
    lead = phase_lead(loop, margin=1.5)
    compensated = plant * Plant([round(lead.lead, 2), 1], [round(lead.lag, 2), 1])
    before, after = backlash_cycles(loop, d), backlash_cycles(gain * compensated, d)
    stable = before[-1]
    without, with_lead = (_proportional(process, gain, d) for process in (plant, compensated))

    def draw() -> Figure:
        figure, (left, right) = style.panels(1, 2, height=3.9, share=False)
        draw_gap(left)
        draw_loops(left, {"without": loop, "with phase lead": gain * compensated})
        frame(left, (-2.6, 0.4), (-2.6, 0.6))
        style.legend(left, columns=1)
        for colour, name, signals in zip(
            style.CURVES, ("without", "with phase lead"), (without, with_lead), strict=False
        ):
            right.plot(signals.t, PERCENT * signals.pv, color=colour, linewidth=1.5, label=name)
        right.set(xlabel="time [s]", ylabel="PV [%]", xlim=(0, 60))
        style.legend(right, columns=1)
        return figure

    return Shown(
        number="2.2",
        title="A phase lead against the limit cycle",
        section="2.2",
        sentence="A phase lead turns the Nyquist curve of an integrating process away from −1/N(A), and the "
        "oscillation dies out.",
        numbers=(
            Number("intersections without the lead", "", "1 or more", float(len(before))),
            Number("intersections with the lead", "", 0.0, float(len(after))),
            Number("amplitude of OP predicted without", "%", None, PERCENT * stable.amplitude),
            Number("amplitude of OP simulated without", "%", None, _late(without.op, without)),
            Number("amplitude of the valve without", "%", None, _late(without.position, without)),
            Number(
                "amplitude of the valve with",
                "%",
                "dies out",
                _late(with_lead.position, with_lead),
                holds=_late(with_lead.position, with_lead) < 0.01 * _late(without.position, without),
            ),
        ),
        difference="The thesis does not say which controller it draws. With a PI or PID controller there are two "
        "integrators in the loop, and no lead of finite gain can part the curves; here the controller is proportional, "
        "and the valve has a lag of 0.5 s.",
        draw=draw,
    )


def _proportional(process: Plant, gain: float, d: float) -> Simulation:
    """A proportional loop (Ti of a week), kicked by a load."""
    return run(
        short(plant=process, controller=(gain, 6e5), tf=0.0, d=d, load=[(0, 0), (1, 0.3), (3, 0)], h=0.005, t_end=300.0)
    )


def _late(x: npt.NDArray[np.float64], signals: Simulation) -> float:
    """Half of the swing of a signal in the last third [%]."""
    return PERCENT * float(np.ptp(x[signals.t > 200])) / 2


FIGURES: dict[str, Callable[[], Shown]] = {"2.1": figure_2_1, "2.2": figure_2_2}
