"""Chapter 4: what tuning rules read off a step response."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from glapp.plant import PLANTS, Plant
from glapp.tuning import fotd, fotd_from_step, ziegler_nichols_step

from . import style
from .figure import Number, Shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["FIGURES"]

PLANT = PLANTS["P2"]
TIMES = np.linspace(0.0, 14.0, 1401)
READ = 1e-3
"""Numbers that a search ends in; NumPy's version may move them, though never so far."""


def figure_4_1() -> Shown:
    """L and T of a step response."""
    model, slope = fotd(PLANT), _steepest()
    response = PLANT.step_response(TIMES)
    sampled = fotd_from_step(TIMES, response, 1.0)
    t63 = model.l + model.t

    def draw() -> Figure:
        figure, (axes,) = style.panels(height=3.6)
        _response(axes, slope, model.l)
        axes.plot(TIMES, model.plant.step_response(TIMES), ":", color=style.CURVES[2], label="FOTD model")
        axes.plot([0, t63, t63], [0.632, 0.632, 0], **style.NARROW)
        axes.text(0.1, 0.66, "63 %")
        _span(axes, 0, model.l, 0.05, "L")
        _span(axes, model.l, t63, 0.05, "T")
        axes.set(xlabel="time [s]", ylabel="process value", ylim=(-0.02, 1.05), xlim=(0, 14))
        style.legend(axes)
        return figure

    return Shown(
        number="4.1",
        title="Dead time L and time constant T",
        section="4.1",
        sentence="The steepest tangent of the step response, here of P2, meets the time axis at L; at L + T it has "
        "risen by 63 %.",
        numbers=(
            Number("L", "s", None, model.l, READ),
            Number("T", "s", "time of 63 %", model.t, READ, holds=False),
            Number("time of 63 %", "s", None, t63, READ),
            Number("L, off samples 10 ms apart", "s", None, sampled.l, READ),
            Number("T, off samples 10 ms apart", "s", None, sampled.t, READ),
        ),
        difference="The thesis calls the time of 63 % T. The rules need what is left of it after the dead time, "
        "T = T63 − L; its own text on lag and dead time makes sense only so.",
        draw=draw,
        why="T is the time of 63 % less L, which the thesis' own P2 needs",
    )


def figure_4_2() -> Shown:
    """The constants a and L of Ziegler and Nichols."""
    model, slope = fotd(PLANT), _steepest()
    by_tangent = slope * model.l
    rule = ziegler_nichols_step(PLANT, "PI")

    def draw() -> Figure:
        figure, (axes,) = style.panels(height=3.6)
        _response(axes, slope, model.l)
        axes.axhline(0, color=style.MUTED, linewidth=0.8)
        arrow = {"arrowstyle": "<->", "color": style.INK, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", xytext=(0.05, 0), xy=(0.05, -by_tangent), arrowprops=arrow)
        axes.text(0.25, -by_tangent / 2, "a", va="center")
        _span(axes, 0, model.l, 0.08, "L")
        axes.set(xlabel="time [s]", ylabel="process value", ylim=(-0.42, 1.05), xlim=(-0.2, 14))
        style.legend(axes)
        return figure

    return Shown(
        number="4.2",
        title="The constants a and L of Ziegler and Nichols",
        section="4.2.1",
        sentence="The steepest tangent of the step response, here of P2, meets the time axis at L and the other axis "
        "at −a.",
        numbers=(
            Number("L", "s", None, model.l, READ),
            Number(
                "a",
                "",
                "on the tangent",
                by_tangent,
                READ,
                holds=math.isclose(rule.controller.k * by_tangent, 0.9, rel_tol=READ),
            ),
            Number("L/T, which a would be if P2 were its FOTD model", "", None, model.l / model.t, READ),
            Number("K of a PI controller, 0.9/a", "", None, rule.controller.k, READ),
            Number("phase margin that it leaves", "°", None, rule.phase_margin, READ),
        ),
        difference="The thesis prints no values. By this rule P2 is nearly unstable under PI control: its phase margin "
        "is 4°.",
        draw=draw,
    )


def _steepest() -> float:
    """Greatest slope of the response [1/s]."""
    return float(Plant([*PLANT.num, 0.0], PLANT.den).step_response(TIMES).max())


def _response(axes: Axes, slope: float, dead_time: float) -> None:
    """The step response and its steepest tangent."""
    axes.plot(TIMES, PLANT.step_response(TIMES), color=style.CURVES[0], linewidth=1.8, label="step response of P2")
    ends = np.array([0.0, dead_time + 1 / slope])
    axes.plot(ends, slope * (ends - dead_time), color=style.CURVES[1], linewidth=1.4, label="steepest tangent")


def _span(axes: Axes, begin: float, end: float, y: float, name: str) -> None:
    arrow = {"arrowstyle": "<->", "color": style.INK, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xytext=(begin, y), xy=(end, y), arrowprops=arrow)
    axes.text((begin + end) / 2, y + 0.03, name, ha="center")


FIGURES: dict[str, Callable[[], Shown]] = {"4.1": figure_4_1, "4.2": figure_4_2}
