"""Nyquist plots in the thesis' manner."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from glapp.nonlinear import backlash_cycles, n_backlash, negative_inverse
from glapp.plant import Plant

from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_gap", "draw_loops", "frame"]


def frame(axes: Axes, real: tuple[float, float], imag: tuple[float, float]) -> None:
    """Limits of the plane, its axes and the point −1."""
    axes.axhline(0, color=style.MUTED, linewidth=0.8)
    axes.axvline(0, color=style.MUTED, linewidth=0.8)
    axes.plot(-1, 0, "x", color=style.INK, markersize=7)
    axes.set(xlim=real, ylim=imag, aspect="equal", xlabel="real part", ylabel="imaginary part")


def draw_gap(axes: Axes) -> None:
    """−1/N(A) of a gap, whatever its width."""
    a = 0.5 + np.geomspace(1e-3, 1e4, 600)
    curve = negative_inverse(n_backlash(a, 1.0))
    axes.plot(curve.real, curve.imag, "--", color=style.INK, linewidth=1.5, label="−1/N(A) of a gap")


def draw_loops(axes: Axes, loops: Mapping[str, Plant]) -> None:
    """L(iω) of each loop, and where it meets −1/N(A)."""
    for colour, (name, loop) in zip(style.CURVES, loops.items(), strict=False):
        value = loop.response(loop.frequencies(per_decade=200))
        axes.plot(value.real, value.imag, color=colour, linewidth=1.8, label=name)
        for cycle in backlash_cycles(loop, 1.0):
            at = complex(loop.response(cycle.w))
            axes.plot(at.real, at.imag, "o", color=style.WRONG, markersize=9, fillstyle="none", markeredgewidth=1.8)
