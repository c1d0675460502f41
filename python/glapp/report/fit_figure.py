"""The pictures of a fit: why it is believed, the likelihood over the width, and the width over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ..palette import GRID, INK, MUTED, OUTPUT, POINT, POSITION, RAW, SIGNAL
from . import words
from .figures import _figure, _has_values, _middle, _plain, _time, _time_axis

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..result import Result

    Floats = NDArray[np.float64]

__all__ = ["fit_figure", "loop_figures", "trend_figure"]

MOST = 4000
"""Cells drawn."""

TURNS = 8
"""Turns of the valve that a picture shows: fewer make no pattern, with more the gap is too narrow to be seen."""


def loop_figures(result: Result) -> dict[str, go.Figure]:
    """Draw the evidence: OP, the modelled valve position and PV over time; and PV against OP.

    Where a gap was found, both show the stretch in which the valve turns `TURNS` times and OP travels least beside; the
    first can be zoomed out to all of the window that was fitted. In it the gap is a parallelogram: PV stays while OP
    crosses the gap, and follows at its edges. Of a history that is too long OP is thinned too much to be drawn beside
    the window that was fitted.
    """
    f, trace = result.fit, result.trace
    assert f is not None and f.best and trace is not None  # the caller draws no plot without a fit
    best, position = f.best, f.best["signal"] == "position"
    t, valve, seen = best["t"], np.asarray(best["position"]), np.asarray(best["pv"])
    op = np.interp(t, trace.t, _middle(trace, "op"))
    stretch = _stretch(valve, op) if f.found else slice(0, len(t))
    shown = t[[stretch.start, stretch.stop - 1]]
    fine = float(np.median(np.diff(trace.t))) < float(np.ptp(shown)) / (8 * TURNS)
    unit, pv_unit = _plain(words.op_unit(result.unit)), _plain(result.loop.pv_unit or "PV unit")
    seen_name, seen_unit = ("valve, measured", "% travel") if position else ("PV", pv_unit)

    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.56, 0.44], figure=_figure()
    )
    every = slice(None, None, max(1, len(t) // MOST))
    lines = [("OP", op, {"color": OUTPUT, "width": 1.4}, 1, unit)] if fine else []
    if f.found or not fine:
        lines.append(("valve (model)", valve, {"color": POSITION, "width": 2.2}, 1, unit))
    lines.append((seen_name, seen, {"color": SIGNAL, "width": 1.4}, 2, seen_unit))
    if _has_values(trace, "sp") and not position:  # over PV, whose noise hides it
        sp = np.interp(t, trace.t, _middle(trace, "sp"))
        lines.append(("SP", sp, {"color": INK, "width": 1.2, "dash": "6px,3px"}, 2, pv_unit))
    for name, values, line, row, of in lines:
        hover = f"{name} %{{y:.5~g}} {of}<br>%{{x}}<extra></extra>"
        y = np.asarray(values[every], np.float32)
        figure.add_trace(
            go.Scatter(x=_time(result, t[every]), y=y, mode="lines", line=line, name=name, hovertemplate=hover),
            row=row,
            col=1,
        )
    for row, title in ((1, f"OP [{unit}]"), (2, f"{seen_name} [{seen_unit}]")):
        inside = np.concatenate([values[stretch] for _, values, _, panel, _ in lines if panel == row])
        margin = 0.08 * float(np.ptp(inside)) or 1.0
        limits = [float(np.min(inside)) - margin, float(np.max(inside)) + margin]
        figure.update_yaxes(title_text=title, range=limits, row=row, col=1)
    _time_axis(figure, result, 2)
    figure.update_xaxes(range=_time(result, shown).tolist())
    figure.update_layout(height=460, margin={"l": 70, "r": 16, "t": 40, "b": 48}, hovermode="closest")
    figure.update_layout(legend={"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top"})
    figures = {"why": figure}
    if fine:
        figures["gap"] = _parallelogram(result, op[stretch], valve[stretch], seen[stretch], stretch)
    return figures


def _parallelogram(result: Result, op: Floats, valve: Floats, seen: Floats, stretch: slice) -> go.Figure:
    """Draw PV against OP, and over it the fitted gap under a slow cycle of PV's height, with its limits."""
    f, answer = result.fit, result.answer
    assert f is not None
    unit, name, recorded = _plain(words.op_unit(result.unit)), "PV", "recorded"
    axis = _plain(result.loop.pv_unit or "PV unit")
    if f.best["signal"] == "position":
        gain, _ = np.polyfit(valve, f.best["predicted"][stretch], 1) if np.ptp(valve) > 0 else (1.0, 0.0)
        name, axis = "valve, measured", "% travel"
    elif f.best["integrating"]:  # PV against OP has no shape of its own
        gain, seen, name, axis, recorded = 1.0, valve, "valve (model)", unit, "model"
    else:
        gain = f.best["kp"]
    middle = float(np.median(seen - gain * valve))
    figure = _figure()
    every = slice(None, None, max(1, len(op) // MOST))
    figure.add_trace(
        go.Scatter(
            x=op[every].astype(np.float32),
            y=seen[every].astype(np.float32),
            mode="markers",
            marker={"size": 3.5, "color": SIGNAL, "opacity": 0.5},
            name=recorded,
            hovertemplate="OP %{x:.5~g}<br>%{y:.5~g}<extra></extra>",
        )
    )
    # A gap has no flanks where PV does not follow the valve at all.
    bottom, top = np.sort((np.quantile(seen, [0.05, 0.95]) - middle) / gain) if gain else (0.0, 0.0)
    drawn = [
        (answer.width, {"color": POSITION, "width": 2.6}, "at least" if answer.verdict == "at_least" else "fitted gap"),
        (answer.low if f.found else None, {"color": INK, "width": 1.6, "dash": "3px,3px"}, "95 % limit"),
        (answer.high, {"color": INK, "width": 1.6, "dash": "3px,3px"}, "95 % limit"),
    ]
    named = set[str]()
    for width, line, label in drawn:
        if width is None or not gain or (label == "95 % limit" and width == answer.width):
            continue
        half = width / 2
        v = np.array([bottom, top, top, bottom, bottom])
        figure.add_trace(
            go.Scatter(
                x=v + half * np.array([1, 1, -1, -1, 1]),
                y=middle + gain * v,
                mode="lines",
                line=line,
                name=label,
                legendgroup=label,
                showlegend=label not in named,
                hovertemplate=f"{label} {_plain(words.quantity(width, words.op_unit(result.unit)))}<extra></extra>",
            )
        )
        named.add(label)
    figure.update_xaxes(title_text=f"OP [{unit}]", nticks=6, tickangle=0)
    figure.update_yaxes(title_text=f"{name} [{axis}]")
    figure.update_layout(height=460, margin={"l": 70, "r": 16, "t": 40, "b": 78}, hovermode="closest", showlegend=True)
    # Above the picture the buttons would lie on it: this one is the narrower of two.
    figure.update_layout(legend={"orientation": "h", "x": 0, "y": 0, "yref": "container", "yanchor": "bottom"})
    return figure


def _stretch(valve: Floats, op: Floats) -> slice:
    """The stretch in which the valve turns `TURNS` times and OP travels least; all where it turns less often."""
    moves = np.flatnonzero(np.diff(valve) != 0)
    turns = moves[1:][np.diff(np.sign(np.diff(valve)[moves])) != 0]
    if len(turns) <= TURNS:
        return slice(0, len(valve))
    travel = [float(np.ptp(op[a:b])) for a, b in zip(turns[:-TURNS], turns[TURNS:], strict=True)]
    first = int(np.argmin(travel))
    return slice(int(turns[first]), int(turns[first + TURNS]) + 1)


def fit_figure(result: Result) -> go.Figure:
    """Draw the profile of every family of models, and PV with the best one's prediction and residual.

    The lower a profile lies, the better that width explains PV; the shaded band is the interval that covers them all.
    """
    f = result.fit
    assert f is not None and f.best  # the caller draws no plot without a fit
    unit, pv = _plain(words.op_unit(result.unit)), _plain(result.loop.pv_unit or "PV unit")
    signal, ahead = "PV", ", one step ahead"
    if f.best["signal"] == "position":
        signal, ahead, pv = "measured position", "", "% travel"
    figure = make_subplots(
        rows=3,
        cols=1,
        row_heights=[0.44, 0.34, 0.22],
        vertical_spacing=0.11,
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
                y=rise + family["delta_deviance"],
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
    if f.low is not None and (f.found or f.verdict == "sound"):
        high = f.high if f.high is not None else f.best["range"]
        figure.add_vrect(x0=f.low, x1=high, fillcolor=POINT, opacity=0.14, line_width=0, row=1, col=1)
    needed = f.lr_needed if f.found and f.lr_needed is not None else 0.0  # of no width it is that of every move of OP
    top = float(max(np.quantile(f.best["candidates"][0]["profile"][1], 0.6), needed, 12.0))
    figure.update_xaxes(
        title={"text": f"width of the gap [{unit}]", "standoff": 4}, range=[0, f.best["range"]], row=1, col=1
    )
    figure.update_yaxes(title_text="rise of −2·ln L", range=[-0.05 * top, 1.3 * top], row=1, col=1)
    figure.add_hline(y=f.best["rise"], line={"color": INK, "width": 1, "dash": "dot"}, row=1, col=1)

    every = slice(None, None, max(1, len(f.best["t"]) // MOST))
    t = _time(result, f.best["t"][every])
    columns = {name: np.asarray(f.best[name][every], np.float32) for name in ("pv", "predicted")}
    drawn = [
        (signal, columns["pv"], {"color": RAW, "width": 1.6}, 2, pv),
        (f"model{ahead}", columns["predicted"], {"color": SIGNAL, "width": 1.2}, 2, pv),
        ("residual", columns["pv"] - columns["predicted"], {"color": OUTPUT, "width": 1}, 3, pv),
    ]
    for name, values, style, row, of in drawn:
        hover = f"{name} %{{y:.5~g}} {of}<br>%{{x}}<extra></extra>"
        figure.add_trace(
            go.Scatter(x=t, y=values, mode="lines", line=style, name=name, hovertemplate=hover), row=row, col=1
        )
    for row, title in ((2, f"{signal} [{pv}]"), (3, f"residual [{pv}]")):
        figure.update_yaxes(title_text=title, row=row, col=1)
        kind = "date" if result.t0 is not None else "linear"
        figure.update_xaxes(matches="x2", type=kind, showticklabels=row == 3, gridcolor=GRID, row=row, col=1)
        figure.update_xaxes(nticks=6, tickangle=0, row=row, col=1)
    if result.t0 is None:
        figure.update_xaxes(title_text="time [s]", row=3, col=1)
    figure.update_layout(height=650, margin={"l": 70, "r": 24, "t": 48, "b": 48}, hovermode="closest")
    figure.update_layout(legend={"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top"})
    return figure


def _family(family: dict[str, Any]) -> str:
    """Name of a family of models."""
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
    unit = _plain(words.op_unit(result.unit))
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
            + _plain(words.quantity(value, words.op_unit(result.unit)))
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
    # All of the recording, also where only one window has a result.
    whole = _time(result, np.array([min(w.t_start for w in f.windows), max(w.t_end for w in f.windows)]))
    figure.update_xaxes(nticks=6, tickangle=0, range=whole.tolist())
    figure.update_layout(height=320, margin={"l": 70, "r": 24, "t": 40, "b": 48}, hovermode="closest", showlegend=True)
    figure.update_layout(legend={"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top"})
    return figure
