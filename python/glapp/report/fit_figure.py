"""The picture of a fit: the likelihood over the width, and the model beside what was recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from . import words
from .figures import GRID, INK, MUTED, OUTPUT, POINT, POSITION, RAW, SIGNAL, _figure, _plain, _time

if TYPE_CHECKING:
    from ..result import Result

__all__ = ["fit_figure", "trend_figure"]

MOST = 4000
"""Cells drawn."""


def fit_figure(result: Result) -> go.Figure:
    """Draw the profile of every family of models, and PV, valve position and residual of the best one.

    The lower a profile lies, the better that width explains PV; the shaded band is the interval that covers them all.
    """
    f = result.fit
    assert f is not None and f.best  # the caller draws no plot without a fit
    unit, pv = _plain(words.op_unit(result)), _plain(result.loop.pv_unit or "PV unit")
    signal, ahead = "PV", ", one step ahead"
    if f.best["signal"] == "position":
        signal, ahead, pv = "measured position", "", "% travel"
    figure = make_subplots(
        rows=4,
        cols=1,
        row_heights=[0.34, 0.28, 0.22, 0.16],
        vertical_spacing=0.07,
        figure=_figure(),
    )
    for i, family in enumerate(reversed(f.best["candidates"])):
        best = i == len(f.best["candidates"]) - 1
        name = _family(family)
        widths, rise = family["profile"]
        line = {"color": SIGNAL if best else MUTED, "width": 2.4 if best else 1}
        hover = f"{name}<br>width %{{x:.4~g}} {unit}<br>%{{y:.1f}} above the best<extra></extra>"
        figure.add_trace(
            go.Scatter(
                x=widths,
                y=rise + family["behind"],
                mode="lines",
                line=line,
                opacity=1 if best else 0.6,
                name="best family" if best else "other families",
                legendgroup="best" if best else "others",
                showlegend=best or i == 0,
                hovertemplate=hover,
            ),
            row=1,
            col=1,
        )
    if f.low is not None and f.found:
        high = f.high if f.high is not None else f.best["range"]
        figure.add_vrect(x0=f.low, x1=high, fillcolor=POINT, opacity=0.14, line_width=0, row=1, col=1)
    top = float(max(np.quantile(f.best["candidates"][0]["profile"][1], 0.6), f.lr_needed or 0.0, 12.0))
    figure.update_xaxes(title_text=f"width of the gap [{unit}]", range=[0, f.best["range"]], row=1, col=1)
    figure.update_yaxes(title_text="rise of −2·ln L", range=[-0.05 * top, 1.3 * top], row=1, col=1)
    figure.add_hline(y=f.best["rise"], line={"color": INK, "width": 1, "dash": "dot"}, row=1, col=1)

    every = slice(None, None, max(1, len(f.best["t"]) // MOST))
    t = _time(result, f.best["t"][every])
    columns = {name: f.best[name][every] for name in ("pv", "foreseen", "position")}
    drawn = [
        (signal, columns["pv"], {"color": RAW, "width": 1.6}, 2, pv),
        (f"model{ahead}", columns["foreseen"], {"color": SIGNAL, "width": 1.2}, 2, pv),
        ("valve, as the model has it", columns["position"], {"color": POSITION, "width": 1.6}, 3, unit),
        ("residual", columns["pv"] - columns["foreseen"], {"color": OUTPUT, "width": 1}, 4, pv),
    ]
    for name, values, style, row, of in drawn:
        hover = f"{name} %{{y:.5~g}} {of}<br>%{{x}}<extra></extra>"
        figure.add_trace(
            go.Scatter(x=t, y=values, mode="lines", line=style, name=name, hovertemplate=hover), row=row, col=1
        )
    for row, title in ((2, f"{signal} [{pv}]"), (3, f"valve [{unit}]"), (4, f"residual [{pv}]")):
        figure.update_yaxes(title_text=title, row=row, col=1)
        kind = "date" if result.t0 is not None else "linear"
        figure.update_xaxes(matches="x2", type=kind, showticklabels=row == 4, gridcolor=GRID, row=row, col=1)
    if result.t0 is None:
        figure.update_xaxes(title_text="time [s]", row=4, col=1)
    figure.update_layout(height=720, margin={"l": 70, "r": 24, "t": 48, "b": 48}, hovermode="closest")
    figure.update_layout(legend={"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top"})
    return figure


def _family(family: dict[str, Any]) -> str:
    """What a family of models is called."""
    if family["noise"] == "position":
        return "OP to the valve's position"
    kind = f"{family['lags']} lags" if not family["integrating"] else "integrator and lag"
    noise = {
        "input": "load at the input",
        "slope": "load whose slope walks",
        "lines": "load along lines",
        "output": "drift at the output",
        "both": "load and drift",
    }
    return f"{kind}, {noise[family['noise']]}"


def trend_figure(result: Result) -> go.Figure:
    """Draw the width that each window of the recording gave, with its interval or bound, over time, and the trend.

    A dot is a width with its 95 % interval, a triangle a bound: upward *at least*, downward *at most*. Windows that
    cannot tell are left out.
    """
    f = result.fit
    assert f is not None  # the caller draws no plot without a fit
    unit = _plain(words.op_unit(result))
    figure = _figure()
    drawn = (
        ("width, 95 % interval", "circle", POINT, [(w, w.d) for w in f.windows if w.sided]),
        ("at least", "triangle-up", POSITION, [(w, w.low) for w in f.windows if w.verdict == "at_least"]),
        ("no wider than", "triangle-down", SIGNAL, [(w, w.high) for w in f.windows if w.verdict == "sound"]),
    )
    for name, symbol, colour, points in drawn:
        if not points:
            continue
        interval = None
        if symbol == "circle":
            up = [(w.high or w.d) - w.d for w, _ in points]
            interval = {"array": up, "arrayminus": [w.d - w.low for w, _ in points], "thickness": 1.6, "width": 5}
        spans = [
            f"{words.clock(result.t0, w.t_start)} to {words.clock(result.t0, w.t_end)}<br>{name} "
            + _plain(words.quantity(value, words.op_unit(result)))
            + (f" ({words.number(w.low)} to {words.number(w.high)})" if interval else "")
            for w, value in points
        ]
        figure.add_trace(
            go.Scatter(
                x=_time(result, np.array([(w.t_start + w.t_end) / 2 for w, _ in points])),
                y=[value for _, value in points],
                error_y=interval,
                mode="markers",
                marker={"symbol": symbol, "size": 10, "color": colour},
                name=name,
                hovertext=spans,
                hoverinfo="text",
            )
        )
    if f.trend is not None:
        figure.add_trace(
            go.Scatter(
                x=_time(result, np.array(f.trend.t)),
                y=f.trend.d,
                mode="lines",
                line={"color": INK, "width": 1.4, "dash": "dash"},
                name="trend",
                hoverinfo="skip",
            )
        )
    figure.update_yaxes(title_text=f"width of the gap [{unit}]", rangemode="tozero")
    if result.t0 is None:
        figure.update_xaxes(title_text="time [s]")
    else:
        figure.update_xaxes(type="date", title_text="local time")
    figure.update_layout(height=320, margin={"l": 70, "r": 24, "t": 40, "b": 48}, hovermode="closest", showlegend=True)
    figure.update_layout(legend={"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top"})
    return figure
