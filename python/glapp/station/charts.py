"""The pictures, as options of the chart library: what is drawn, and in which grey."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from ..report.words import NAMES, REASONS, number
from ..step_test import StepTest

__all__ = ["detections", "lab", "live", "phase", "shades", "step_test"]

DRAWN = 2000
"""So many points of a signal are drawn at most where it was read from a file."""

LIGHT = {
    "ink": "#1f2933",
    "muted": "#59646f",
    "faint": "#dfe3e7",
    "sp": "#59646f",
    "pv": "#1d5b9c",
    "op": "#3f4a54",
    "accepted": "rgba(29,91,156,0.16)",
    "rejected": "rgba(89,100,111,0.10)",
    "after": "#8a5a00",
}
DARK = {
    "ink": "#e4e8ec",
    "muted": "#a4afba",
    "faint": "#38424c",
    "sp": "#a4afba",
    "pv": "#8cbcf0",
    "op": "#cfd6dd",
    "accepted": "rgba(140,188,240,0.22)",
    "rejected": "rgba(164,175,186,0.10)",
    "after": "#e0b050",
}


def _tone(dark: bool) -> dict[str, str]:
    return DARK if dark else LIGHT


def _axis(tone: Mapping[str, str], **more: Any) -> dict[str, Any]:
    return {
        "axisLine": {"lineStyle": {"color": tone["muted"]}},
        "axisLabel": {"color": tone["muted"], "hideOverlap": True},
        "splitLine": {"lineStyle": {"color": tone["faint"]}},
        "nameTextStyle": {"color": tone["muted"], "align": "left"},
        **more,
    }


_DATES = {"year": "{yyyy}", "month": "{d} {MMM}", "day": "{d} {MMM}", "hour": "{HH}:{mm}", "minute": "{HH}:{mm}"}
_DATES["second"] = "{HH}:{mm}:{ss}"


def _time(tone: Mapping[str, str], **more: Any) -> dict[str, Any]:
    axis = _axis(tone, type="time", **more)
    axis["axisLabel"] = {"color": tone["muted"], "hideOverlap": True, "formatter": _DATES}
    return axis


def _base(tone: Mapping[str, str]) -> dict[str, Any]:
    return {
        "animation": False,
        "backgroundColor": "transparent",
        "textStyle": {"color": tone["ink"], "fontFamily": "system-ui, sans-serif"},
        "tooltip": {"trigger": "axis", "confine": True, "order": "seriesAsc"},
        "legend": {"textStyle": {"color": tone["ink"]}, "top": 0, "itemHeight": 10, "itemWidth": 16},
        "aria": {"enabled": True},
    }


def shades(halves: Sequence[Mapping[str, Any]], span: float, *, dark: bool) -> list[list[dict[str, Any]]]:
    """Half-periods as areas by their verdict: detections blue, the others grey.

    The reason stands at those that are wide enough to be read, a twelfth of the picture's `span` [s] or more.
    """
    tone = _tone(dark)
    found = []
    for half in halves:
        if half["t_start"] is None or half["t_end"] is None:
            continue
        reason = half["reason"]
        label = "✓" if reason == 0 else REASONS[NAMES[reason]].label
        found.append(
            [
                {
                    "xAxis": 1000.0 * half["t_start"],
                    "name": label if half["t_end"] - half["t_start"] > span / 12.0 else "",
                    "itemStyle": {
                        "color": tone["accepted" if reason == 0 else "rejected"],
                        "borderColor": tone["muted"] + "40",  # two of the same verdict are still two
                        "borderWidth": 1,
                    },
                    "label": {
                        "color": tone["muted"],
                        "fontSize": 10,
                        "position": "insideTop",
                        "overflow": "truncate",
                        "width": 70,
                    },
                },
                {"xAxis": 1000.0 * half["t_end"]},
            ]
        )
    return found


def live(
    values: Mapping[str, Sequence[Any]], halves: Sequence[Mapping[str, Any]], pv_unit: str, op_unit: str, *, dark: bool
) -> dict[str, Any]:
    """SP and PV above, OP below; the half-periods are shaded behind PV.

    Parameters
    ----------
    values : mapping
        `time` [s since 1970 UTC], `SP`, `PV`, `OP`.
    halves : sequence
        Rows of half-periods.
    pv_unit, op_unit : str
        For the axes.
    dark : bool
        On a dark page.
    """
    tone = _tone(dark)
    steps = sorted(b - a for a, b in pairwise(values["time"]))
    longest = max(15.0, 5.0 * steps[len(steps) // 2]) if steps else 15.0

    def line(name: str, axis: int, color: str, **more: Any) -> dict[str, Any]:
        data: list[list[Any]] = []
        last = 0.0
        for t, x in zip(values["time"], values[name], strict=True):
            if data and t - last > longest:
                data.append([1000.0 * last + 1.0, None])  # nothing came: no line either
            data.append([1000.0 * t, x])
            last = t
        return {
            "name": name,
            "type": "line",
            "data": data,
            "xAxisIndex": axis,
            "yAxisIndex": axis,
            "showSymbol": False,
            "lineStyle": {"color": color, "width": 1.5, **more},
            "itemStyle": {"color": color},
        }

    span = values["time"][-1] - values["time"][0] if values["time"] else 0.0
    pv = line("PV", 0, tone["pv"])
    pv["markArea"] = {"silent": True, "data": shades(halves, span, dark=dark)}
    return {
        **_base(tone),
        "axisPointer": {"link": [{"xAxisIndex": "all"}]},
        "grid": [
            {"left": 56, "right": 16, "top": 34, "height": "46%"},
            {"left": 56, "right": 16, "bottom": 24, "height": "24%"},
        ],
        "xAxis": [
            _axis(tone, type="time", gridIndex=0, axisLabel={"show": False}),
            _time(tone, gridIndex=1),
        ],
        "yAxis": [
            _axis(
                tone,
                type="value",
                scale=True,
                gridIndex=0,
                name=f"SP, PV [{pv_unit}]" if pv_unit else "SP, PV",
                splitNumber=4,
            ),
            _axis(tone, type="value", scale=True, gridIndex=1, name=f"OP [{op_unit}]", splitNumber=3),
        ],
        "series": [line("SP", 0, tone["sp"], type="dashed"), pv, line("OP", 1, tone["op"])],
    }


def detections(answers: Sequence[Mapping[str, Any]], unit: str, *, scale: float, dark: bool) -> dict[str, Any]:
    """Detections over time, those under compensation as a series of their own; the estimate, and what the fits said.

    The first three series are empty: `glapp.detections` in the browser fills them.

    Parameters
    ----------
    answers : sequence
        Rows of answers.
    unit : str
        Of the width as it is drawn.
    scale : float
        That unit per OP unit.
    dark : bool
        On a dark page.
    """
    tone = _tone(dark)

    def dots(name: str, color: str, symbol: str) -> dict[str, Any]:
        return {
            "name": name,
            "type": "scatter",
            "data": [],
            "symbolSize": 6,
            "symbol": symbol,
            "large": True,
            "itemStyle": {"color": color, "opacity": 0.75},
        }

    fits = [a for a in answers if a["d"] is not None]
    bars = [
        [{"coord": [1000.0 * a["time"], a["low"] * scale]}, {"coord": [1000.0 * a["time"], a["high"] * scale]}]
        for a in fits
        if a["low"] is not None and a["high"] is not None
    ]
    return {
        **_base(tone),
        "grid": {"left": 56, "right": 16, "top": 62, "bottom": 64},
        "xAxis": _time(tone),
        "yAxis": _axis(tone, type="value", name=f"width [{unit}]", min=0),
        "dataZoom": [{"type": "inside"}, {"type": "slider", "height": 18, "bottom": 8, "showDataShadow": False}],
        "series": [
            dots("detections", tone["pv"], "circle"),
            dots("under compensation", tone["after"], "triangle"),
            {
                "name": "estimate",
                "type": "line",
                "data": [],
                "showSymbol": False,
                "sampling": "lttb",
                "lineStyle": {"color": tone["muted"], "width": 1.5},
                "itemStyle": {"color": tone["muted"]},
            },
            {
                "name": "fit, with its 95 % interval",
                "type": "scatter",
                "symbol": "diamond",
                "symbolSize": 11,
                "data": [[1000.0 * a["time"], a["d"] * scale] for a in fits],
                "itemStyle": {"color": tone["ink"]},
                "markLine": {
                    "silent": True,
                    "symbol": ["none", "none"],
                    "data": bars,
                    "lineStyle": {"color": tone["ink"], "type": "solid"},
                    "label": {"show": False},
                },
            },
        ],
    }


def step_test(found: StepTest, *, dark: bool) -> dict[str, Any] | None:
    """A step test: PV above, OP below; what was held is shaded, from when PV had settled more strongly.

    Parameters
    ----------
    found : StepTest
        What was read.
    dark : bool
        On a dark page.

    Returns
    -------
    dict or None
        None where nothing was in manual.
    """
    rows = found.signals
    if rows is None or rows.op is None or not len(rows):
        return None
    tone = _tone(dark)
    # Samples of the service have their times, those of a file with dates begin at its first row, all others at 0.
    begin = 0.0 if found.t0 is None else found.t0.timestamp()
    dated = begin + float(rows.t[0]) > 1e8
    scale = 1000.0 if dated else 1.0

    def line(name: str, axis: int, values: Any, color: str) -> dict[str, Any]:
        every = max(1, -(-len(rows) // DRAWN))
        pairs = zip(rows.t[::every].tolist(), values[::every].tolist(), strict=True)
        return {
            "name": name,
            "type": "line",
            "data": [[scale * (begin + t), x if math.isfinite(x) else None] for t, x in pairs],
            "xAxisIndex": axis,
            "yAxisIndex": axis,
            "showSymbol": False,
            "lineStyle": {"color": color, "width": 1.5},
            "itemStyle": {"color": color},
        }

    def area(start: float, end: float, color: str) -> list[dict[str, Any]]:
        return [{"xAxis": scale * (begin + start), "itemStyle": {"color": color}}, {"xAxis": scale * (begin + end)}]

    pv = line("PV", 0, rows.pv, tone["pv"])
    held = [area(one.start, one.end if one.settled is None else one.settled, tone["rejected"]) for one in found.holds]
    settled = [area(one.settled, one.end, tone["accepted"]) for one in found.holds if one.settled is not None]
    pv["markArea"] = {"silent": True, "data": held + settled}
    below = _time(tone, gridIndex=1) if dated else _axis(tone, type="value", scale=True, gridIndex=1, name="t [s]")
    kind = "time" if dated else "value"
    return {
        **_base(tone),
        "grid": [
            {"left": 56, "right": 24, "top": 34, "height": "42%"},
            {"left": 56, "right": 24, "bottom": 26, "height": "28%"},
        ],
        "xAxis": [_axis(tone, type=kind, scale=True, gridIndex=0, axisLabel={"show": False}), below],
        "yAxis": [
            _axis(tone, type="value", scale=True, gridIndex=0, name=f"PV [{found.pv_unit}]", splitNumber=4),
            _axis(tone, type="value", scale=True, gridIndex=1, name=f"OP [{found.unit}]", splitNumber=3),
        ],
        "series": [pv, line("OP", 1, rows.op, tone["op"])],
    }


def phase(op: Sequence[Any], pv: Sequence[Any], pv_unit: str, op_unit: str, *, dark: bool) -> dict[str, Any]:
    """PV over OP: a gap draws two flanks that lie its width apart."""
    tone = _tone(dark)
    data = [[x, y] for x, y in zip(op, pv, strict=True) if x is not None and y is not None]
    return {
        **_base(tone),
        "legend": {"show": False},
        "tooltip": {"show": False},
        "grid": {"left": 56, "right": 16, "top": 34, "bottom": 44},
        "xAxis": _axis(tone, type="value", scale=True, name=f"OP [{op_unit}]", nameLocation="middle", nameGap=26),
        "yAxis": _axis(tone, type="value", scale=True, name=f"PV [{pv_unit}]" if pv_unit else "PV"),
        "series": [{"type": "line", "data": data, "showSymbol": False, "lineStyle": {"color": tone["pv"], "width": 1}}],
    }


def reasons(counts: Mapping[str, int]) -> list[tuple[str, int, str, str]]:
    """Reasons with their counts, the most frequent first: label, count, meaning, what to do.

    >>> [row[:2] for row in reasons({"too_short": 3, "accepted": 5, "gap": 0})]
    [('accepted', 5), ('too short', 3)]
    """
    ordered = sorted(((n, name) for name, n in counts.items() if n), reverse=True)
    return [(REASONS[name].label, n, REASONS[name].meaning, REASONS[name].remedy) for n, name in ordered]


def width(value: float | None, unit: str) -> str:
    """A width for the eye.

    >>> width(None, "%"), width(2.404, "%")
    ('–', '2.40 %')
    """
    return "–" if value is None else f"{number(value)} {unit}"


def lab(points: Mapping[str, Sequence[Sequence[float]]], *, dark: bool) -> dict[str, Any]:
    """Signals of the laboratory over the simulated time, in greys and blues."""
    tone = _tone(dark)
    colours = [tone["muted"], tone["pv"], tone["op"], tone["after"]]
    return {
        **_base(tone),
        "grid": {"left": 56, "right": 16, "top": 40, "bottom": 40},
        "xAxis": _axis(tone, type="value", name="t [s]", nameLocation="middle", nameGap=26, scale=True, splitNumber=6),
        "yAxis": _axis(tone, type="value", scale=True),
        "series": [
            {
                "name": name,
                "type": "line",
                "data": list(data),
                "showSymbol": False,
                "lineStyle": {"color": colours[i % 4], "width": 1.5, "type": "dashed" if i == 0 else "solid"},
                "itemStyle": {"color": colours[i % 4]},
            }
            for i, (name, data) in enumerate(points.items())
        ],
    }
