"""Plotly figures of results.

They stand alone in a notebook and are what the report draws. Colours are constants so that the report can exchange
them for a dark page. Half-periods are drawn as one heatmap with a column per half-period: a canvas picture, quick with
thousands of them, whose hover answers anywhere inside a half-period.
"""

from __future__ import annotations

import html
import math
import textwrap
from collections import Counter
from datetime import UTC
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ..errors import InputError
from ..palette import FLAT, FONT, GRID, INK, MUTED, OUTPUT, PAPER, POINT, POSITION, RAW, SIGNAL, TOO_WIDE, UNJUDGED
from ..result import Result
from ..step_test import StepTest
from . import words

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..simulate import Simulation
    from ..step_test import Reading
    from ..trace import Trace

#: Colour of each verdict on a half-period, in the order of the codes: the muted scheme of Paul Tol, safe for
#: colour-blind readers, with greys for what matters least.
REASON_COLOURS: tuple[str, ...] = (
    "#00a070",  # accepted
    "#6b7280",  # gap
    "#882255",  # bad_quality
    "#aa4499",  # not_auto
    "#999933",  # saturated
    "#b8bec5",  # too_short
    "#e0c060",  # not_square
    "#66b8e0",  # uneven
    "#4a3fa0",  # sp_moved
    "#cc6677",  # too_small
)
SHADE = 0.38  # opacity of the shading: the signals must stay the strongest thing in the panel

#: More half-periods than this and neighbours share a column: no screen shows more, and the file stays small.
MAX_COLUMNS = 4000

CONFIG: dict[str, Any] = {"responsive": True, "displaylogo": False, "plotlyServerURL": ""}

#: Buttons that do not belong here: selections without a purpose, and one that would send plant data to a server.
_NO_BUTTONS = ["select2d", "lasso2d", "autoScale2d", "sendChartToCloud", "sendDataToCloud"]


def plot(of: Result | StepTest | Simulation) -> go.Figure:
    """A zoomable figure of a result, a step test or a simulation.

    Parameters
    ----------
    of : Result, StepTest or Simulation
        Of a result: SP, PV and filtered PV over shaded half-periods, OP, detections and estimate. Of a step test: PV
        and OP with each hold, where PV had settled, and each reading in its place. Of a simulation: SP and PV above,
        OP and the valve's position below, and the load where there is any.

    Returns
    -------
    plotly.graph_objects.Figure
        `.show()` opens it.

    Raises
    ------
    InputError
        For anything else.

    Examples
    --------
    >>> import glapp
    >>> s = glapp.simulate.closed_loop("P2", (0.775, 2.05), t_end=50, setpoint=[(1, 1.0)])
    >>> [trace.name for trace in glapp.plot(s).data]
    ['SP', 'PV', 'OP', 'position']
    """
    from ..simulate import Simulation

    if isinstance(of, Result):
        return loop_figure(of)
    if isinstance(of, StepTest):
        return step_test_figure(of)
    if isinstance(of, Simulation):
        return simulation_figure(of)
    raise InputError(
        f"is a {type(of).__name__}, must be a result of glapp.analyze, a step test or a simulation",
        parameter="of",
        value=of,
        bound="Result, StepTest or Simulation",
    )


def loop_figure(result: Result) -> go.Figure:
    """Draw one loop over time: SP and PV with every half-period shaded, OP, and the detections with the estimate.

    The three panels share the time axis. Without a trace (a loop refused while it was read) the figure says so.
    """
    trace, halves = result.trace, result.half_periods
    if trace is None or len(trace.t) == 0:
        return _empty("No trace: the loop was refused before its signals were read.")
    pv_unit, op_unit = result.loop.pv_unit or "PV unit", words.op_unit(result.unit)
    has_op = _has_values(trace, "op") or _has_values(trace, "position")
    has_halves = halves.count > 0
    has_detections = bool((halves.reason == 0).any())
    panels = ["pv", *(["op"] if has_op else []), *(["d"] if has_detections else [])]
    heights = [{"pv": 0.48, "op": 0.26, "d": 0.26}[panel] for panel in panels]
    figure = make_subplots(
        rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.045, row_heights=heights, figure=_figure()
    )
    row = {panel: i + 1 for i, panel in enumerate(panels)}

    low, high = _limits(trace)
    present = sorted({int(code) for code in halves.reason})
    if has_halves:
        figure.add_trace(_shading(result, low, high), row=1, col=1)
        for code in present:
            figure.add_trace(_reason_key(result, code), row=1, col=1)
    _signals(figure, result, trace, row, {"pv": _plain(pv_unit), "op": _plain(op_unit)})
    figure.update_yaxes(title_text=f"SP, PV [{_plain(pv_unit)}]", range=[low, high], row=1, col=1)
    if has_op:
        figure.update_yaxes(title_text=f"OP [{_plain(op_unit)}]", row=row["op"], col=1)
    if has_detections:
        _detections(figure, result, row["d"])
    _time_axis(figure, result, len(panels))
    legend = 20 * (1 + math.ceil(len(present) / 3))  # below its title; a narrow page holds three reasons in a row
    figure.update_layout(
        height={1: 400, 2: 560, 3: 700}[len(panels)] + legend,
        margin={"l": 78, "r": 24, "t": 64, "b": 60 + legend},
        hovermode="closest",
        hoverdistance=8,
        legend={"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "yref": "paper", "itemsizing": "constant"},
        legend2={
            "orientation": "h",
            "x": 0,
            "y": 0,
            "yref": "container",
            "yanchor": "bottom",
            "itemclick": False,
            "itemdoubleclick": False,
            "title": {"text": "half-periods", "side": "top"},  # next to them it pushed the last one off the paper
        },
    )
    return figure


_LINES: list[tuple[str, str, str, dict[str, Any]]] = [
    ("pv", "PV", "pv", {"color": RAW, "width": 1}),
    ("sp", "SP", "pv", {"color": INK, "width": 1.3, "dash": "6px,3px"}),
    ("pv_filtered", "PV filtered", "pv", {"color": SIGNAL, "width": 1.6}),
    ("position", "valve position", "op", {"color": POSITION, "width": 2.2}),  # under OP: often the same line
    ("op", "OP", "op", {"color": OUTPUT, "width": 1.2}),
]
"""Column of the trace, name, panel and style of each line of `loop_figure`, in the order in which they are drawn."""


def _signals(figure: go.Figure, result: Result, trace: Trace, row: dict[str, int], unit: dict[str, str]) -> None:
    """Add the recorded signals; `row` and `unit` are those of each panel."""
    zigzag = _zigzag_time(result, trace)
    for column, name, panel, style in _LINES:
        if _has_values(trace, column):
            band = _band(trace, column)
            whole = np.array_equal(*band, equal_nan=True)  # nothing was thinned
            figure.add_trace(
                go.Scatter(
                    x=zigzag[::2] if whole else zigzag,
                    y=band[0].astype(np.float32) if whole else _interleave(*band),
                    mode="lines",
                    line=style,
                    name=name,
                    hovertemplate=f"{name} %{{y:.5~g}} {unit[panel]}<br>%{{x}}<extra></extra>",
                ),
                row=row[panel],
                col=1,
            )


def _reason_key(result: Result, code: int) -> go.Scatter:
    """Entry of the legend for the half-periods of one reason, with their number."""
    return go.Scatter(
        x=[None],
        y=[None],
        mode="markers",
        marker={"symbol": "square", "size": 13, "color": REASON_COLOURS[code], "opacity": SHADE + 0.2},
        name=f"{_label(code)} ({result.reasons.get(words.NAMES[code], result.detections)})",
        legend="legend2",
        hoverinfo="skip",
    )


def simulation_figure(simulation: Simulation) -> go.Figure:
    """Draw a simulated loop over time: SP and PV; OP and the valve's position; the load, where there is any."""
    loaded = bool(np.any(simulation.load != 0))
    rows = 3 if loaded else 2
    figure = make_subplots(rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.05, figure=_figure())
    drawn = [
        (1, "SP", simulation.sp, INK),
        (1, "PV", simulation.pv, SIGNAL),
        (2, "OP", simulation.op, OUTPUT),
        (2, "position", simulation.position, POSITION),
        *([(3, "load", simulation.load, MUTED)] if loaded else []),
    ]
    for row, name, values, colour in drawn:
        t, y = _drawn(simulation.t, values)
        figure.add_scatter(x=t, y=y, name=name, mode="lines", line={"color": colour, "width": 1.5}, row=row, col=1)
    figure.update_xaxes(title="time [s]", row=rows, col=1)
    for row, title in enumerate(("SP, PV [PV unit]", "OP, position [OP unit]", "load [OP unit]")[:rows], 1):
        figure.update_yaxes(title=title, row=row, col=1)
    figure.update_layout(height=200 * rows + 80, showlegend=True)
    return figure


def step_test_figure(test: StepTest) -> go.Figure:
    """Draw a step test: PV and OP with the held stretches shaded, the settled levels, and each reading in its place.

    A bracket shows how far PV moved from one settled level to the next; below it, at OP's move, is the reading.
    """
    rows = test.signals
    if rows is None or rows.op is None or not len(rows):
        return _empty(test.reason or "No manual stretch.")
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.55, 0.45], figure=_figure()
    )
    pv, op = _plain(test.pv_unit), _plain(words.op_unit(test.unit))
    signals = [("PV", rows.pv, {"color": RAW, "width": 1}, 1, pv)]
    if rows.position is not None:
        signals.append(("valve position", rows.position, {"color": POSITION, "width": 2.2}, 2, "% travel"))
    signals.append(("OP", rows.op, {"color": OUTPUT, "width": 1.4}, 2, op))
    for name, values, line, row, unit in signals:
        t, y = _drawn(rows.t, values)
        hover = f"{name} %{{y:.5~g}} {unit}<br>%{{x}}<extra></extra>"
        figure.add_trace(
            go.Scatter(x=_time(test, t), y=y, mode="lines", line=line, name=name, hovertemplate=hover), row=row, col=1
        )
    for hold in test.holds:
        start, settled, end = (
            None if t is None else _time(test, np.array([t]))[0] for t in (hold.start, hold.settled, hold.end)
        )
        figure.add_vrect(x0=start, x1=end, fillcolor=GRID, opacity=0.35, line_width=0, layer="below")
        if settled is not None:
            figure.add_vrect(x0=settled, x1=end, fillcolor=UNJUDGED, opacity=0.09, line_width=0, layer="below")
    if not test.integrating:
        _levels(figure, test)
    for reading in test.readings:
        after = next(hold for hold in test.holds if hold.end == reading.end)
        last = after is test.holds[-1]  # its text must not widen the axis
        figure.add_annotation(
            x=_time(test, np.array([after.end if last else after.start]))[0],
            y=reading.op[0] if reading.kind != "none" else sum(reading.op) / 2,
            text=_reading_text(test, reading),
            hovertext=_wrap(reading.evidence),
            showarrow=False,
            xanchor="right" if last else "left",
            xshift=-6 if last else 6,
            yanchor="middle",
            font={"size": 12.5, "color": _READINGS[reading.kind]},
            bgcolor=PAPER,
            opacity=0.92,
            row=2,
            col=1,
        )
    figure.update_yaxes(title_text=f"PV [{pv}]", row=1, col=1)
    figure.update_yaxes(title_text=f"OP [{op}]", row=2, col=1)
    _time_axis(figure, test, 2)
    figure.update_xaxes(range=_time(test, rows.t[[0, -1]]).tolist())
    figure.update_layout(
        title={"text": _plain(_step_test_title(test)), "x": 0.01, "xanchor": "left", "font": {"size": 16}},
        height=700,
        margin={"l": 78, "r": 24, "t": 56, "b": 150},  # a narrow page holds one name in a row of the legend
        hovermode="closest",
        legend={"orientation": "h", "x": 0, "y": 0, "yref": "container", "yanchor": "bottom"},
    )
    return figure


_READINGS = {"gain": SIGNAL, "gap": TOO_WIDE, "none": MUTED}


def _levels(figure: go.Figure, test: StepTest) -> None:
    """Add the settled levels of PV, and for each reading a bracket from the level before to the one after."""
    levels = [(hold.settled, hold.end, hold.level) for hold in test.holds if hold.level is not None]
    x = np.array([value for start, end, _ in levels for value in (start, end, np.nan)], dtype=np.float64)
    y = [value for _, _, level in levels for value in (level, level, None)]
    line = {"color": INK, "width": 2.2}
    figure.add_trace(
        go.Scatter(x=_time(test, x), y=y, mode="lines", line=line, name="settled PV", hoverinfo="skip"), row=1, col=1
    )
    for kind in ("gain", "gap"):
        xs: list[float] = []
        ys: list[float | None] = []
        texts: list[str] = []
        for reading in test.readings:
            after = next(hold for hold in test.holds if hold.end == reading.end)
            if reading.kind == kind and after.settled is not None:
                xs += [reading.start, after.settled, after.settled, np.nan]
                ys += [reading.pv[0], reading.pv[0], reading.pv[1], None]
                texts += [f"{_reading_text(test, reading)}<br>{_plain(reading.evidence)}"] * 4
        if xs:
            figure.add_trace(
                go.Scatter(
                    x=_time(test, np.array(xs)),
                    y=ys,
                    mode="lines",
                    line={"color": _READINGS[kind], "width": 2, "dash": "4px,3px"},
                    name={"gain": "ΔPV in the same direction", "gap": "ΔPV after a reversal"}[kind],
                    text=texts,
                    hovertemplate="%{text}<extra></extra>",
                ),
                row=1,
                col=1,
            )


def _reading_text(test: StepTest, reading: Reading) -> str:
    """Say what one move gave, as short as a picture needs it."""
    if reading.value is None:
        return _plain(reading.evidence.split(":")[0])
    name, unit = ("d", words.op_unit(test.unit)) if reading.kind == "gap" else ("Kp", "")
    return _plain(f"{name} = {words.quantity(reading.value, unit).strip()}")


def _step_test_title(test: StepTest) -> str:
    if test.d is None:
        return f"{test.name}: no width"
    width = words.quantity(test.d, words.op_unit(test.unit))
    return f"{test.name}: gap {width} ({words.number(test.low)} to {words.number(test.high)})"


def _drawn(t: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Points of a line: broken where time makes a leap, and least and greatest of each piece where there are many."""
    leaps = np.flatnonzero(np.diff(t) > 3 * np.median(np.diff(t))) + 1 if len(t) > 2 else np.empty(0, np.intp)
    parts: list[tuple[NDArray[np.float64], NDArray[np.float32]]] = []
    for a, b in pairwise([0, *leaps.tolist(), len(t)]):
        starts = a + np.unique(np.linspace(0, b - a, min(b - a, MAX_COLUMNS), endpoint=False).astype(np.intp))
        inside = y[:b]
        band = np.fmin.reduceat(inside, starts), np.fmax.reduceat(inside, starts)
        whole = b - a <= MAX_COLUMNS
        times, values = (t[a:b], y[a:b].astype(np.float32)) if whole else (np.repeat(t[starts], 2), _interleave(*band))
        parts.append((np.append(times, t[b - 1]), np.append(values, np.float32(np.nan))))
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def phase_figure(result: Result) -> go.Figure:
    """Draw PV against OP, the points coloured by time: a gap shows as a flat passage at every reversal."""
    trace = result.trace
    if trace is None or not _has_values(trace, "op") or not _has_values(trace, "pv"):
        return _empty("PV and OP were not both recorded.")
    source = "pv_filtered" if _has_values(trace, "pv_filtered") else "pv"
    op, pv = _middle(trace, "op"), _middle(trace, source)
    figure = _figure()
    figure.add_trace(
        go.Scatter(
            x=op,
            y=pv,
            mode="lines+markers",
            line={"color": GRID, "width": 1},
            marker={
                "size": 4,
                "color": np.asarray(trace.t, dtype=np.float32),
                "colorscale": [[0, "#3a6fb0"], [0.5, "#9a8a94"], [1, "#e39a2d"]],  # seen on white and on black
                "colorbar": {
                    "thickness": 10,
                    "outlinewidth": 0,
                    "tickvals": [float(trace.t[0]), float(trace.t[-1])],
                    "ticktext": ["start", "end"],
                    "len": 0.6,
                },
            },
            hovertemplate="OP %{x:.5~g}<br>PV %{y:.5~g}<extra></extra>",
            showlegend=False,
        )
    )
    figure.update_xaxes(title_text=f"OP [{_plain(words.op_unit(result.unit))}]")
    figure.update_yaxes(
        title_text=f"{'PV filtered' if source == 'pv_filtered' else 'PV'} [{_plain(result.loop.pv_unit or 'PV unit')}]"
    )
    figure.update_layout(height=480, width=560, margin={"l": 78, "r": 24, "t": 24, "b": 56}, hovermode="closest")
    return figure


def _figure() -> go.Figure:
    """Start an empty figure in the report's dress, without Plotly's own template (7 kB in each figure)."""
    axis = {
        "gridcolor": GRID,
        "linecolor": GRID,
        "zeroline": False,
        "showline": True,
        "ticks": "outside",
        "tickcolor": GRID,
        "ticklen": 4,
        "title": {"font": {"size": 13, "color": MUTED}},
        "exponentformat": "none",
    }
    template = go.layout.Template(layout={"xaxis": axis, "yaxis": axis})
    return go.Figure(
        layout={
            "template": template,
            "font": {"family": FONT, "size": 13, "color": INK},
            "paper_bgcolor": PAPER,
            "plot_bgcolor": PAPER,
            "hoverlabel": {
                "align": "left",
                "bgcolor": PAPER,
                "bordercolor": MUTED,
                "font": {"color": INK, "size": 12.5},
            },
            "colorway": [SIGNAL],
            "dragmode": "zoom",
            "modebar": {"remove": _NO_BUTTONS},
            "separators": ".\u202f",
        }
    )


def _empty(text: str, height: int = 220) -> go.Figure:
    """Make a figure that only says why there is nothing to draw."""
    figure = _figure()
    figure.update_xaxes(visible=False)
    figure.update_yaxes(visible=False)
    figure.add_annotation(text=_plain(text), showarrow=False, x=0.5, y=0.5, xref="paper", yref="paper")
    figure.update_layout(height=height, margin={"l": 24, "r": 24, "t": 24, "b": 24})
    return figure


def _time(result: Result | StepTest, seconds: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Times on the axis for seconds since t0: milliseconds of local wall-clock time, or seconds.

    Plotly's dates know no zone, so the wall clock of the first row is given to it as if it were UTC.
    """
    exact: NDArray[np.float64] = np.asarray(seconds, dtype=np.float64)
    if result.t0 is None:
        return exact
    start = result.t0.replace(tzinfo=UTC).timestamp()
    return np.round((start + exact) * 1000.0)


def _time_axis(figure: go.Figure, result: Result | StepTest, rows: int) -> None:
    """Set the shared time axis: dates without a unit, seconds with it; as many labels as a narrow page holds level."""
    figure.update_xaxes(nticks=6, tickangle=0)
    if result.t0 is None:
        figure.update_xaxes(title_text="time [s]", row=rows, col=1)
        return
    figure.update_xaxes(type="date", hoverformat="%Y-%m-%d %H:%M:%S")
    figure.update_xaxes(title_text="local time", row=rows, col=1)


def _has_values(trace: Trace, column: str) -> bool:
    """Whether a column of the trace was recorded and holds at least one number."""
    band = getattr(trace, column)
    return band is not None and bool(np.isfinite(band.low).any())


def _band(trace: Trace, column: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper ends of a thinned column."""
    band = getattr(trace, column)
    return band.low, band.high


def _middle(trace: Trace, column: str) -> NDArray[np.float32]:
    """Mean of the ends of a thinned column."""
    low, high = _band(trace, column)
    return np.asarray((low + high) / 2, dtype=np.float32)


def _interleave(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float32]:
    """Line up low and high of each bucket, low first in one and high first in the next.

    Drawn as a line it fills the band between them, so that noise looks like noise and no peak is lost.
    """
    out = np.empty(2 * len(low), dtype=np.float32)
    out[0::2], out[1::2] = low, high
    odd = np.arange(len(low)) % 2 == 1
    out[0::2][odd], out[1::2][odd] = high[odd], low[odd]
    return out


def _zigzag_time(result: Result, trace: Trace) -> NDArray[np.float64]:
    """Times for a line that goes from low to high of each bucket."""
    return np.repeat(_time(result, trace.t), 2)


def _limits(trace: Trace) -> tuple[float, float]:
    """Range of the PV panel: all of SP and PV with a margin."""
    bands = [values for column in ("sp", "pv") if _has_values(trace, column) for values in _band(trace, column)]
    if not bands:
        return 0.0, 1.0
    low = min(float(np.nanmin(values)) for values in bands)
    high = max(float(np.nanmax(values)) for values in bands)
    margin = 0.06 * (high - low) or FLAT * abs(high) or 1.0
    return low - margin, high + margin


def _groups(n: int) -> NDArray[np.intp]:
    """Edges of the groups of half-periods that share a column."""
    return np.linspace(0, n, min(n, MAX_COLUMNS) + 1).astype(np.intp)


def _shading(result: Result, low: float, high: float) -> go.Heatmap:
    """Shade every half-period by its verdict, with its numbers on hover.

    A column of several half-periods takes the colour of an accepted one if there is any, else of the most frequent.
    """
    h = result.half_periods
    cuts = _groups(h.count)
    edges: list[float] = []
    codes: list[float] = []
    texts: list[str] = []
    latest = -np.inf
    for first, end in pairwise(cuts):
        start = max(float(h.t_start[first]), latest)  # time may run backwards in a recording; the columns must not
        stop = max(float(h.t_end[end - 1]), start)
        if edges and start > latest:
            codes.append(np.nan)
            texts.append("")
            edges.append(start)
        elif not edges:
            edges.append(start)
        edges.append(stop)
        latest = stop
        found = Counter(int(code) for code in h.reason[first:end])
        code = 0 if found[0] else found.most_common(1)[0][0]
        codes.append(float(code))
        texts.append(
            _half_period_text(result, int(first)) if end - first == 1 else _group_text(result, first, end, found)
        )
    shortest = min(end - start for start, end in pairwise(edges))
    scale: list[tuple[float, str]] = []
    for code, colour in enumerate(REASON_COLOURS):
        scale += [(code / 10, colour), ((code + 1) / 10, colour)]
    return go.Heatmap(
        x=_time(result, np.array(edges)),
        y=[low, high],
        z=np.array([codes], dtype=np.float32),
        zmin=-0.5,
        zmax=9.5,
        colorscale=scale,
        showscale=False,
        opacity=SHADE,
        text=[texts],
        hovertemplate="%{text}<extra></extra>",
        hoverongaps=False,
        xgap=1 if shortest > (edges[-1] - edges[0]) / 300 else 0,  # a pixel would hide narrow ones
        name="half-periods",
    )


def _half_period_text(result: Result, i: int) -> str:
    """Write the hover text of one half-period: its verdict, then every comparison with a cross where it failed."""
    h = result.half_periods
    op_unit = words.op_unit(result.unit)
    if h.reason[i] == 0:
        head = "<b>Accepted</b>"
    else:
        labels = [words.REASONS[name].label for name in words.failures(int(h.mask[i]))]
        head = f"<b>Rejected: {', '.join(labels)}</b>"
    mark = {True: "✓", False: "✗", None: "·"}
    lines = [
        head,
        f"{words.clock(result.t0, h.t_start[i])}, PV {('at', 'below', 'above')[int(h.sign[i])]} SP",
        *(f"{mark[passed]} {text}" for text, passed in words.comparisons(result, i)),
        f"OP travel by the PI law {words.quantity(float(h.delta_u[i]), op_unit)}, "
        f"recorded {words.quantity(float(h.op_travel[i]), op_unit)}",
        f"d = {words.quantity(float(h.d[i]), op_unit)}",
    ]
    return "<br>".join(_plain(line) if line is not head else head for line in lines)


def _group_text(result: Result, first: np.intp, end: np.intp, found: Counter[int]) -> str:
    """Text on half-periods that are drawn as one."""
    h = result.half_periods
    lines = [
        f"<b>{end - first} half-periods</b>",
        f"{words.clock(result.t0, h.t_start[first])} to {words.clock(result.t0, h.t_end[end - 1])}",
        *(f"{n} {_label(code)}" for code, n in found.most_common()),
    ]
    return "<br>".join(lines)


def _detections(figure: go.Figure, result: Result, row: int) -> None:
    """Add the panel of detections: a point each, the displayed estimate as a step line, the acceptable as a level."""
    h = result.half_periods
    unit = _plain(words.op_unit(result.unit))
    span = result.span
    accepted = _thinned(np.flatnonzero(np.asarray(h.reason) == 0), np.asarray(h.d))
    figure.update_yaxes(title_text=f"d [{unit}]", rangemode="tozero", row=row, col=1)
    time = _time(result, np.asarray(h.t_end)[accepted])
    d, d_hat = np.asarray(h.d, dtype=np.float64)[accepted], np.asarray(h.d_hat, dtype=np.float64)[accepted]

    def hover(label: str, values: NDArray[np.float64]) -> dict[str, Any]:
        if span is None:
            return {"hovertemplate": f"{label} %{{y:.3~g}} {unit}<br>%{{x}}<extra></extra>"}
        percent = np.asarray(100 * values / span, dtype=np.float32)
        return {
            "customdata": percent,
            "hovertemplate": f"{label} %{{y:.3~g}} {unit}<br>%{{customdata:.3~g}} % of span<br>%{{x}}<extra></extra>",
        }

    figure.add_trace(
        go.Scatter(
            x=time,
            y=d.astype(np.float32),
            mode="markers",
            marker={"color": POINT, "size": 6, "opacity": 0.75},
            name="detection",
            **hover("detection", d),
        ),
        row=row,
        col=1,
    )
    end = _time(result, np.asarray(result.trace.t)[-1:] if result.trace is not None else np.asarray(h.t_end)[-1:])
    figure.add_trace(
        go.Scatter(
            x=np.append(time, np.maximum(end, time[-1])),
            y=np.append(d_hat, d_hat[-1]).astype(np.float32),
            mode="lines",
            line={
                "color": INK,
                "width": 1.6,
                "shape": "hv",
                "dash": "2px,3px" if result.crossings == "provisional" else "solid",
            },
            name=_estimate(result),
            **hover("estimate", np.append(d_hat, d_hat[-1])),
        ),
        row=row,
        col=1,
    )
    _answer_levels(figure, result, row, [time[0], float(np.maximum(end, time[-1])[0])])


def _answer_levels(figure: go.Figure, result: Result, row: int, ends: list[Any]) -> None:
    """Add what the detections are compared with, between two times: the interval of the answer, the acceptable."""
    answer = result.answer
    if answer.low is not None and answer.high is not None:
        figure.add_trace(
            go.Scatter(
                x=[*ends, *reversed(ends)],
                y=[answer.high] * 2 + [answer.low] * 2,
                mode="lines",
                line={"width": 0},
                fill="toself",
                fillcolor="rgba(0, 135, 94, 0.18)",
                name="not excluded by OP and PV",
                hoverinfo="skip",
            ),
            row=row,
            col=1,
        )
    if answer.limit is not None and answer.limit.width is not None:
        unit = _plain(words.op_unit(result.unit))
        figure.add_trace(
            go.Scatter(
                x=ends,
                y=[answer.limit.width] * 2,
                mode="lines",
                line={"color": TOO_WIDE, "width": 1.2, "dash": "6px,4px"},
                name="acceptable",
                hovertemplate=f"acceptable %{{y:.3~g}} {unit}<extra></extra>",
            ),
            row=row,
            col=1,
        )


def _estimate(result: Result) -> str:
    """Name the line of the crossings' estimate."""
    if result.answer.struck is not None:
        return "estimate, excluded"
    return "estimate, provisional" if result.crossings == "provisional" else "estimate"


def _thinned(indices: NDArray[np.intp], values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Keep at most `MAX_COLUMNS` detections: the least and the greatest of each group of neighbours, and the last."""
    if len(indices) <= MAX_COLUMNS:
        return indices
    cuts = np.linspace(0, len(indices), MAX_COLUMNS // 2).astype(np.intp)
    keep = {int(indices[-1])}
    for first, end in pairwise(cuts):
        group = indices[first:end]
        keep |= {int(group[np.argmin(values[group])]), int(group[np.argmax(values[group])])}
    return np.array(sorted(keep), dtype=np.intp)


def _label(code: int) -> str:
    return words.REASONS[words.NAMES[code]].label


def _plain(text: str) -> str:
    """Make text safe for Plotly, which reads a few HTML tags in every string."""
    return html.escape(text, quote=False)


def _wrap(text: str) -> str:
    """Break a sentence into lines for a hover label."""
    return "<br>".join(_plain(line) for line in textwrap.wrap(text, 70))
