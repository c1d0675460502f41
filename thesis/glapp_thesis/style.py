"""One look for all pictures: the colours of the report, a unit on every axis, readable at 700 pixels."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from glapp.errors import InputError
from glapp.report.figures import GRID, INK, MUTED, OUTPUT, POINT, POSITION, RAW, SIGNAL, TOO_WIDE
from glapp.writing import write_file

try:
    import matplotlib as mpl
    from matplotlib.figure import Figure
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
    "legend",
    "panels",
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
