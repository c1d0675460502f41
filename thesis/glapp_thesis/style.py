"""One look for all pictures: the colours of the report, a unit on every axis, readable at 700 pixels."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from glapp.errors import InputError
from glapp.palette import GRID, INK, MUTED, OUTPUT, POINT, POSITION, RAW, SIGNAL, TOO_WIDE
from glapp.writing import write_file

try:
    import matplotlib as mpl
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle
    from PIL import Image
except ImportError:
    raise InputError("the figures of the thesis need matplotlib", hint="pip install 'glapp[thesis]'") from None

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "CURVES",
    "DETECTION",
    "FILTERED",
    "GRID",
    "INK",
    "MUTED",
    "NARROW",
    "OP",
    "POSITION",
    "PV",
    "SP",
    "TRUE",
    "WRONG",
    "blocks",
    "feedback",
    "legend",
    "panels",
    "pins",
    "save",
]

SP, PV, FILTERED, OP = INK, RAW, SIGNAL, OUTPUT
CURVES = (SIGNAL, POSITION, POINT, OUTPUT)
"""Curves that are no signals of a loop, one after the other."""

DETECTION, WRONG, TRUE = POINT, TOO_WIDE, MUTED
"""Detections that are right and wrong, and the true width."""

WIDTH, DPI = 7.0, 144
NARROW: dict[str, Any] = {"color": SP, "linewidth": 1.0, "dashes": (5, 2)}
"""Line of a setpoint, or of a true width with another colour."""

_LOOK: Any = {
    "font.size": 10,
    "axes.labelsize": 10,
    "axes.titlesize": 10,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def panels(
    rows: int = 1, columns: int = 1, *, height: float = 3.6, ratios: Sequence[float] | None = None, share: bool = True
) -> tuple[Figure, list[Axes]]:
    """A figure of `height` inches with rows × columns axes, row by row; `share` shares the x axes of a column."""
    with mpl.rc_context(_LOOK):
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        axes = figure.subplots(rows, columns, sharex="col" if share else False, squeeze=False, height_ratios=ratios)
    return figure, list(axes.flat)


def blocks(
    axes: Axes, names: Sequence[str], colours: Sequence[str], *, back: str | None = None, beside: str | None = None
) -> None:
    """A chain of boxes from left to right with arrows between them; `back` names the arrow from the last to the first.

    Names may have several lines; a box gets the colour at its place. `beside` is one more, which hears what comes back
    and feeds the first.
    """
    pitch, width, height = 1.0, 0.78, 0.5
    ends = len(names) - 1
    for i, (name, colour) in enumerate(zip(names, colours, strict=True)):
        box = Rectangle((i * pitch - width / 2, -height / 2), width, height, facecolor="white", edgecolor=colour)
        box.set_linewidth(1.5)
        axes.add_patch(box)
        axes.annotate(name, (i * pitch, 0), ha="center", va="center", fontsize=8, color=INK)
    arrow: dict[str, Any] = {"arrowstyle": "-|>", "color": MUTED, "shrinkA": 0, "shrinkB": 0}
    spans = [(i * pitch + width / 2, (i + 1) * pitch - width / 2) for i in range(ends)]
    for begin, end in spans:
        axes.annotate("", (end, 0), (begin, 0), arrowprops=arrow)
    if back is not None:
        low, first, last = -0.62, -width / 2 - 0.2, ends * pitch + width / 2 + 0.2
        axes.plot([last - 0.2, last, last, first, first], [0, 0, low, low, 0], color=MUTED, linewidth=1.0)
        axes.annotate("", (-width / 2, 0), (first, 0), arrowprops=arrow)
        axes.annotate(back, ((first + last) / 2, low), ha="center", va="bottom", fontsize=9, color=INK)
    if beside is not None:
        middle, low = ends * pitch / 2, -1.05
        box = Rectangle((middle - width, low - 0.16), 2 * width, 0.32, facecolor="white", edgecolor=WRONG)
        box.set_linewidth(1.5)
        axes.add_patch(box)
        axes.annotate(beside, (middle, low), ha="center", va="center", fontsize=8, color=INK)
        axes.annotate("", (middle, low + 0.16), (middle, -0.62), arrowprops=arrow)
        axes.plot([middle - width, 0, 0], [low, low, -0.3], color=MUTED, linewidth=1.0)
        axes.annotate("", (0, -height / 2), (0, -0.35), arrowprops=arrow)
        axes.annotate("u_FF", (0.05, low + 0.03), va="bottom", fontsize=8, color=INK)
    lowest = -1.3 if beside else -0.75 if back else -0.4
    axes.set(xlim=(-0.75, ends * pitch + 0.75), ylim=(lowest, 0.4))
    axes.set_axis_off()


def pins(axes: Axes, name: str, colour: str, inputs: Sequence[str], outputs: Sequence[str]) -> None:
    """One box with an arrow for each of its pins: inputs on the left, outputs on the right."""
    height = 0.3 * max(len(inputs), len(outputs), 2)
    box = Rectangle((-0.6, -height / 2), 1.2, height, facecolor="white", edgecolor=colour)
    box.set_linewidth(1.5)
    axes.add_patch(box)
    axes.annotate(name, (0, 0), ha="center", va="center", fontsize=9, color=INK)
    arrow: dict[str, Any] = {"arrowstyle": "-|>", "color": MUTED, "shrinkA": 0, "shrinkB": 0}
    for names, side in ((inputs, -1), (outputs, 1)):
        for i, pin in enumerate(names):
            y = height * ((len(names) - 1) / 2 - i) / max(len(names), 1)
            near, far = 0.6 * side, 1.1 * side
            begin, end = (far, near) if side < 0 else (near, far)
            axes.annotate("", (end, y), (begin, y), arrowprops=arrow)
            axes.annotate(
                pin, (far + 0.05 * side, y), ha="right" if side < 0 else "left", va="center", fontsize=8, color=INK
            )
    axes.set(xlim=(-2.6, 2.6), ylim=(-height / 2 - 0.08, height / 2 + 0.08))
    axes.set_axis_off()


def feedback(axes: Axes, after: int, before: int, name: str) -> None:
    """One more arrow in a chain of `blocks`: from behind one box, above the chain, to the input of another."""
    high, begin, end = 0.42, after + 0.5, before - 0.5
    axes.plot([begin, begin, end, end], [0, high, high, 0], color=MUTED, linewidth=1.0)
    arrow: dict[str, Any] = {"arrowstyle": "-|>", "color": MUTED, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (before - 0.39, 0), (end, 0), arrowprops=arrow)
    axes.annotate(name, ((begin + end) / 2, high), ha="center", va="bottom", fontsize=9, color=INK)
    axes.set_ylim(axes.get_ylim()[0], 0.6)


def legend(axes: Axes, columns: int = 4) -> None:
    """Legend in small type above the axes."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=columns,
        borderaxespad=0.2,
        fontsize=9,
        frameon=False,
        handlelength=1.8,
        columnspacing=1.4,
    )


def save(figure: Figure, path: Path) -> None:
    """Write a PNG with a palette: a third of the size, and nobody sees it."""
    raw, out = BytesIO(), BytesIO()
    figure.savefig(raw, format="png", dpi=DPI)
    picture = Image.open(raw).convert("RGB")
    picture.quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(out, "png", optimize=True)
    write_file(path, out.getvalue())
