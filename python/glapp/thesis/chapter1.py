"""Chapter 1: what backlash is, and when it makes a loop oscillate."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from matplotlib.patches import Rectangle

from ..blocks import Backlash
from . import style
from .figure import Number, Shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["FIGURES"]

Floats = npt.NDArray[np.float64]


def figure_1_1() -> Shown:
    """Sketch of a gap."""
    half = 1.0
    return Shown(
        number="1.1",
        title="A gap between two parts",
        section="1",
        sentence="The driven part stands still until the driving part has crossed the gap, D to either side of the "
        "middle.",
        numbers=(Number("way from flank to flank over D", "", 2.0, _dead_travel(2 * half) / half),),
        difference="",
        draw=lambda: _draw_sketch(half),
    )


def figure_1_2() -> Shown:
    """Input against output."""
    d = 1.0
    outer, inner = (_through(d, amplitude) for amplitude in (2.5, 1.2))

    def draw() -> Figure:
        figure, (axes,) = style.panels(height=4.2)
        for (u, true), colour, name in (
            (outer, style.CURVES[0], "wide swing"),
            (inner, style.CURVES[1], "narrow swing"),
        ):
            axes.plot(u, true, color=colour, linewidth=2, label=name)
            _arrows(axes, float(u.max()) - d / 2, d, colour)
        axes.annotate("", xytext=(-0.5, 0), xy=(0.5, 0), arrowprops={"arrowstyle": "<->", "color": style.INK})
        axes.text(0, 0.08, "d", ha="center")
        axes.set(xlabel="u, in widths of the gap", ylabel="u_true, in widths of the gap", aspect="equal")
        style.legend(axes)
        return figure

    return Shown(
        number="1.2",
        title="Input and output of a gap",
        section="1",
        sentence="In contact the output follows along one of two parallel flanks; after each reversal it waits on a "
        "horizontal line until the input has crossed the dead band.",
        numbers=(Number("width between the flanks", "d", 1.0, _dead_travel(d)),),
        difference="",
        draw=draw,
    )


def _dead_travel(d: float) -> float:
    """How far the input of a gap goes back before the output moves, in steps of a 64th."""
    gap = Backlash(d)
    gap.update(-4.0)
    u, rest = 4.0, gap.update(4.0)
    while gap.update(u) == rest:
        u -= 1 / 64
    return 4.0 - u - 1 / 64


def _through(d: float, amplitude: float) -> tuple[Floats, Floats]:
    """A sine of `amplitude`, and what a gap makes of it once it has settled."""
    theta = np.linspace(0, 4 * np.pi, 801)
    u = amplitude * np.sin(theta)
    gap = Backlash(d)
    true = np.array([gap.update(x) for x in u.tolist()])
    return u[400:], true[400:]


def _arrows(axes: Axes, high: float, d: float, colour: str) -> None:
    """The way round a loop whose output swings to ± high: one arrow on each flank, one on each horizontal line."""
    flank = 0.8 * high
    for x, y, dx, dy in (
        (flank + d / 2, flank, 1, 1),
        (high, high, -1, 0),
        (-flank - d / 2, -flank, -1, -1),
        (-high, -high, 1, 0),
    ):
        arrow = {"arrowstyle": "-|>", "color": colour, "mutation_scale": 18}
        axes.annotate("", xytext=(x - 0.05 * dx, y - 0.05 * dy), xy=(x + 0.1 * dx, y + 0.1 * dy), arrowprops=arrow)


def _draw_sketch(half: float) -> Figure:
    figure, (axes,) = style.panels(height=2.5)
    for box in ((-6.0, -0.15, 5.5, 0.3), (-0.5, -0.7, 1.0, 1.4)):
        _part(axes, box, style.OP)
    left, right = -0.5 - half, 0.5 + half
    for box in (
        (left - 0.6, 0.25, 0.6, 1.0),
        (left - 0.6, -1.25, 0.6, 1.0),
        (right, -1.25, 0.6, 2.5),
        (left - 0.6, 1.25, right - left + 1.2, 0.3),
        (left - 0.6, -1.55, right - left + 1.2, 0.3),
        (right + 0.6, -0.15, 3.4, 0.3),
    ):
        _part(axes, box, style.POSITION)
    for begin, end in ((left, -0.5), (0.5, right)):
        axes.annotate("", xytext=(begin, 0.95), xy=(end, 0.95), arrowprops={"arrowstyle": "<->", "color": style.INK})
        axes.text((begin + end) / 2, 0.35, "D", ha="center", va="center")
    axes.text(-5.9, 0.35, "u, from the controller", color=style.OP)
    axes.text(2.3, 0.35, "u_true, to the process", color=style.POSITION)
    axes.set(xlim=(-6.2, 6.2), ylim=(-1.8, 1.8), aspect="equal")
    axes.set_axis_off()
    return figure


def _part(axes: Axes, box: tuple[float, float, float, float], colour: str) -> None:
    x, y, width, height = box
    axes.add_patch(Rectangle((x, y), width, height, color=colour))


FIGURES: dict[str, Callable[[], Shown]] = {"1.1": figure_1_1, "1.2": figure_1_2}
