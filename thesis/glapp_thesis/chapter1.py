"""Chapter 1: what backlash is, and when it makes a loop oscillate."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from glapp.blocks import Backlash
from glapp.nonlinear import (
    backlash_cycles,
    circle_criterion,
    describing_function,
    n_backlash,
    negative_inverse,
    small_gain,
)
from glapp.plant import PLANTS, Plant
from glapp.tuning import design, migo, open_loop

from . import style
from .figure import Number, Shown
from .loops import limit_cycle, rounded
from .nyquist import draw_gap, draw_loops, frame

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


def figure_1_3() -> Shown:
    """Areas that the two criteria allow for the Nyquist curve."""
    inside, right = 0.5 * PLANTS["P3"], migo("P2").loop
    gain, border = small_gain(inside), circle_criterion(right)

    def draw() -> Figure:
        figure, (axes,) = style.panels(height=4.4)
        axes.axvspan(-1, 3, color=style.CURVES[0], alpha=0.12, linewidth=0, label="circle criterion")
        circle = np.exp(1j * np.linspace(0, 2 * np.pi, 181))
        axes.fill(circle.real, circle.imag, color=style.CURVES[1], alpha=0.3, linewidth=0, label="small gain")
        loops = {"0.5·P3, inside both": inside, "P2 with MIGO PI, inside the second": right}
        draw_loops(axes, loops)
        frame(axes, (-2.2, 2.2), (-2.2, 1.4))
        style.legend(axes, columns=2)
        return figure

    return Shown(
        number="1.3",
        title="Where the loop is proven to come to rest",
        section="1.1",
        sentence="With a gap of any width a loop comes to rest if its Nyquist curve stays inside the unit circle "
        "(small gain), or to the right of −1 (circle criterion), which allows far more.",
        numbers=(
            Number("radius of the small gain theorem", "", 1.0, gain.margin * abs(complex(inside.response(gain.w)))),
            Number("border of the circle criterion, real part", "", -1.0, border.margin * _real(right, border.w)),
        ),
        difference="With integral action the curve begins at infinity, so the small gain theorem never applies to the "
        "loops of the thesis.",
        draw=draw,
    )


def figure_1_4() -> Shown:
    """A sine through a gap."""
    d, amplitude = 1.0, 1.0
    n = complex(describing_function(lambda: Backlash(d).update, amplitude, samples=1 << 14))

    def draw() -> Figure:
        figure, (axes,) = style.panels(height=3.4)
        theta = np.linspace(0, 360, 401)
        for colour, d_over_a in zip(style.CURVES, (0.5, 1.0, 1.5), strict=False):
            _, true = _through(d_over_a, 1.0)
            axes.plot(theta, true, color=colour, linewidth=1.8, label=f"output, d = {d_over_a:g} A")
        axes.plot(theta, np.sin(np.radians(theta)), **style.NARROW, label="input")
        axes.set(xlabel="angle of the sine [°]", ylabel="signal, in amplitudes A", xticks=range(0, 361, 90))
        style.legend(axes)
        return figure

    return Shown(
        number="1.4",
        title="A sine through a gap",
        section="1.2",
        sentence="The gap cuts the tops off the sine and delays it; the first harmonic of what comes out is the "
        "describing function N(A).",
        numbers=(  # 1e-4: the integral over a sampled sine
            Number("real part of N(A) at A = d, by integration", "", 0.5, n.real, 1e-4),
            Number("imaginary part of N(A) at A = d, by integration", "", -1 / np.pi, n.imag, 1e-4),
        ),
        difference="The thesis' numbers are its formula at A = d; ours come from the sampled signal of the gap block.",
        draw=draw,
    )


def figure_1_5() -> Shown:
    """−1/N(A) of a gap."""
    end = complex(negative_inverse(n_backlash(1e6, 1.0)))
    passed = [a for a in np.arange(0.4, 0.6, 1 / 1024).tolist() if np.ptp(_through(1.0, a)[1]) > 0]
    scaled = abs(complex(n_backlash(1.0, 0.3) - n_backlash(2.0, 0.6)))

    def draw() -> Figure:
        figure, (axes,) = style.panels(height=4.2)
        draw_gap(axes)
        for a in (0.6, 0.7, 1.0, 2.0, 10.0):
            at = complex(negative_inverse(n_backlash(a, 1.0)))
            axes.plot(at.real, at.imag, "o", color=style.CURVES[0], markersize=4)
            axes.annotate(f"A = {a:g} d", (at.real, at.imag), xytext=(7, -3), textcoords="offset points", fontsize=9)
        frame(axes, (-4.5, 1.0), (-3.8, 0.5))
        style.legend(axes)
        return figure

    return Shown(
        number="1.5",
        title="The negative inverse of the describing function",
        section="1.2",
        sentence="One curve serves gaps of every width, since only A/d counts; it comes in from infinity at A = d/2 "
        "and ends in −1 for great amplitudes.",
        numbers=(
            Number("end of the curve for A → ∞, real part", "", -1.0, end.real, 1e-5),
            Number("least amplitude that gets through", "d", 0.5, passed[0]),
            Number("N(A, d/c) − N(cA, d)", "", 0.0, scaled),
        ),
        difference="",
        draw=draw,
    )


def figure_1_6() -> Shown:
    """Two loops, one of which meets the curve."""
    processes = {"P1": PLANTS["P1"], "P2": Plant(*_lags(4, 0.8))}
    controllers = {name: rounded(design(plant, "PID").controller) for name, plant in processes.items()}
    loops = {name: open_loop(plant, controllers[name], controllers[name].td / 5) for name, plant in processes.items()}
    (cycle,) = backlash_cycles(loops["P1"], 0.05)
    found = [limit_cycle("P1", controllers["P1"], d, cycle.period) for d in (0.05, 0.005)]

    def draw() -> Figure:
        figure, (axes,) = style.panels(height=4.4)
        draw_gap(axes)
        draw_loops(axes, loops)
        frame(axes, (-3.2, 0.8), (-2.6, 0.6))
        axes.plot([], [], "o", color=style.WRONG, fillstyle="none", markeredgewidth=1.8, label="limit cycle")
        style.legend(axes)
        return figure

    return Shown(
        number="1.6",
        title="Which loop is made to oscillate",
        section="1.2",
        sentence="Under PID control the integrating process meets −1/N(A), so a gap makes it oscillate for ever, while "
        "four equal lags keep clear of it.",
        numbers=(
            Number("intersections of P1", "", 1.0, float(len(backlash_cycles(loops["P1"], 0.05)))),
            Number("intersections of P2", "", 0.0, float(len(backlash_cycles(loops["P2"], 0.05)))),
            Number("period predicted for P1", "s", None, cycle.period),
            Number("period simulated, gap 5 %", "s", None, found[0].period),
            Number(
                "period simulated, gap 0.5 %",
                "s",
                "the same",
                found[1].period,
                holds=math.isclose(found[1].period, found[0].period, rel_tol=0.01),
            ),
            Number("amplitude of OP predicted, gap 5 %", "%", None, 100 * cycle.amplitude),
            Number("amplitude of OP simulated, gap 5 %", "%", None, 100 * found[0].amplitude),
        ),
        difference="The controllers are not given; here least IAE with Ms and Mt ≤ 1.4, the filter Td/5 counted in. "
        "P2 is 1/(1 + 0.8s)⁴ as section 1.2 prints it; chapter 4 has 1/(1 + s)⁴.",
        draw=draw,
    )


def _real(loop: Plant, w: float) -> float:
    return complex(loop.response(w)).real


def _lags(n: int, t: float) -> tuple[list[float], list[float]]:
    """Num and den of 1/(1 + t·s)ⁿ."""
    return [1.0], (np.poly1d([t, 1.0]) ** n).coeffs.tolist()


def _dead_travel(d: float) -> float:
    """Backward travel of a gap's input before its output moves, in steps of a 64th."""
    gap = Backlash(d)
    gap.update(-4.0)
    u, rest = 4.0, gap.update(4.0)
    while gap.update(u) == rest:
        u -= 1 / 64
    return 4.0 - u - 1 / 64


def _through(d: float, amplitude: float) -> tuple[Floats, Floats]:
    """A sine of `amplitude`, and its settled form after a gap."""
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
    axes.fill([x, x + width, x + width, x], [y, y, y + height, y + height], color=colour)


FIGURES: dict[str, Callable[[], Shown]] = {
    "1.1": figure_1_1,
    "1.2": figure_1_2,
    "1.3": figure_1_3,
    "1.4": figure_1_4,
    "1.5": figure_1_5,
    "1.6": figure_1_6,
}
