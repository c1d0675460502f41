"""The pictures, as options of the chart library: their series and greys."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from itertools import pairwise
from typing import Any

from ..palette import FLAT, FONT
from ..report.words import NAMES, REASONS, number
from ..step_test import StepTest

__all__ = [
    "FITTED",
    "PART",
    "VALVE",
    "detections",
    "effect",
    "lab",
    "live",
    "longest",
    "nothing",
    "phase",
    "shades",
    "step_test",
]

VALVE = "valve (model)"
"""OP after a gap of the width that was found."""

DRAWN = 2000
"""Points of a signal from a file that are drawn at most."""

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
    """Colours for light or dark."""
    return DARK if dark else LIGHT


def _axis(tone: Mapping[str, str], *, label: Mapping[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    return {
        "axisLine": {"lineStyle": {"color": tone["muted"]}},
        "axisLabel": {"color": tone["muted"], "hideOverlap": True, **(label or {})},
        "splitLine": {"lineStyle": {"color": tone["faint"]}},
        "nameTextStyle": {"color": tone["muted"], "align": "left"},
        **more,
    }


_ABOVE_ANOTHER = {"left": 56, "right": 32, "outerBoundsMode": "none"}
"""Sides of one of two grids with one time axis; else a label at the end makes room for itself in its grid alone."""

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
        "textStyle": {"color": tone["ink"], "fontFamily": FONT},
        "tooltip": {"trigger": "axis", "confine": True, "order": "seriesAsc"},
        "legend": {"textStyle": {"color": tone["ink"]}, "top": 0, "itemHeight": 10, "itemWidth": 16},
        "aria": {"enabled": True},
    }


def _of_lines(tone: Mapping[str, str]) -> dict[str, Any]:
    """A legend of lines, for a chart of lines alone."""
    base = _base(tone)
    return {**base, "legend": {**base["legend"], "icon": "rect", "itemHeight": 3}}


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
                        ":formatter": "glapp.reason",
                    },
                },
                {"xAxis": 1000.0 * half["t_end"]},
            ]
        )
    return found


PART = 0.05
"""Smallest range of an axis as a share of the span."""

FITTED = 0.001
"""The same of an axis that is fitted to the signals."""


def _reach(span: tuple[float, float] | None, part: float) -> dict[str, Any]:
    """Limits of an axis: all of the data, and at least `part` of a span where one is given, but nothing beyond both.

    Without a span they are the library's own, but for a signal that does not move.
    """
    if span is None:
        # The library's own goes from half of such a value to one and a half; without a limit it takes that of the data.
        by = f"({FLAT!r} * Math.abs(v.min) || 1)"
        return {
            "scale": True,
            ":min": f"v => v.min === v.max ? v.min - {by} : null",
            ":max": f"v => v.min === v.max ? v.max + {by} : null",
        }
    low, high = span
    least = part * (high - low)
    begin = f"Math.max({low!r}, Math.min({high - least!r}, (v.min + v.max - {least!r}) / 2))"
    return {
        "scale": True,
        ":min": f"v => Math.min(v.min, {begin})",
        ":max": f"v => Math.max(v.max, {begin} + {least!r})",
        "label": {"showMinLabel": False, "showMaxLabel": False},
    }


def longest(times: Sequence[float]) -> float:
    """Samples further apart than that are not joined by a line [s].

    >>> longest([]), longest([0.0, 10.0, 20.0, 300.0])
    (15.0, 50.0)
    """
    steps = sorted(b - a for a, b in pairwise(times))
    return max(15.0, 5.0 * steps[len(steps) // 2]) if steps else 15.0


def nothing(options: dict[str, Any], why: str, *, dark: bool) -> dict[str, Any]:
    """A picture in which there is nothing to see, and why; with an empty reason an earlier one is taken away."""
    style = {"text": why, "fill": _tone(dark)["muted"], "fontSize": 14, "width": 520, "overflow": "break"}
    # By its id the library knows it again: what a chart has is merged, and a text left out would stay.
    told = {"id": "why", "type": "text", "left": "center", "top": "middle", "style": style, "silent": True}
    return {**options, "graphic": told}


def live(
    values: Mapping[str, Sequence[Any]],
    halves: Sequence[Mapping[str, Any]],
    pv_unit: str,
    op_unit: str,
    *,
    dark: bool,
    valve: Sequence[float | None] | None = None,
    spans: tuple[tuple[float, float] | None, tuple[float, float] | None] = (None, None),
    part: float = PART,
) -> dict[str, Any]:
    """SP and PV above, OP and the valve below; the half-periods are shaded behind PV.

    - `values`: `time` [s since 1970 UTC], `SP`, `PV`, `OP`.
    - `halves`: rows of half-periods.
    - `pv_unit`, `op_unit`: for the axes.
    - `dark`: on a dark page.
    - `valve`: where the valve is by the model, at the times of the values; None without a width.
    - `spans`: spans of PV and OP where they are known; an axis ends there, unless a signal goes further.
    - `part`: smallest range of an axis as a share of its span.
    """
    tone = _tone(dark)
    most = longest(values["time"])

    def line(name: str, axis: int, color: str, x_of: Sequence[Any] | None = None, **more: Any) -> dict[str, Any]:
        data: list[list[Any]] = []
        last = 0.0
        for t, x in zip(values["time"], values[name] if x_of is None else x_of, strict=True):
            if data and t - last > most:
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
    series = [line("SP", 0, tone["sp"], type="dashed"), pv, line("OP", 1, tone["op"])]
    if valve is not None:
        series.append(line(VALVE, 1, tone["after"], valve, width=2.5))
    return {
        **_of_lines(tone),
        "axisPointer": {"link": [{"xAxisIndex": "all"}]},
        "grid": [
            {**_ABOVE_ANOTHER, "top": 46, "height": "38%"},
            {**_ABOVE_ANOTHER, "bottom": 24, "height": "33%"},
        ],
        "xAxis": [
            _axis(tone, type="time", gridIndex=0, axisLabel={"show": False}),
            _time(tone, gridIndex=1),
        ],
        "yAxis": [
            _axis(
                tone,
                type="value",
                gridIndex=0,
                name=f"SP, PV [{pv_unit}]" if pv_unit else "SP, PV",
                splitNumber=4,
                **_reach(spans[0], part),
            ),
            _axis(tone, type="value", gridIndex=1, name=f"OP [{op_unit}]", splitNumber=3, **_reach(spans[1], part)),
        ],
        "series": series,
    }


def effect(
    values: Mapping[str, Sequence[Any]], enabled: float, pv_unit: str, op_unit: str, *, dark: bool
) -> dict[str, Any]:
    """PV about SP above, u_FF below, before a compensation was enabled and since.

    - `values`: `time` [s since 1970 UTC], `SP`, `PV`, `U_FF`.
    - `enabled`: when it was [s since 1970 UTC].
    - `pv_unit`, `op_unit`: for the axes.
    - `dark`: on a dark page.
    """
    error = [None if sp is None or pv is None else pv - sp for sp, pv in zip(values["SP"], values["PV"], strict=True)]
    shown = live(
        {"time": values["time"], "SP": [None] * len(error), "PV": error, "OP": values["U_FF"]},
        [],
        pv_unit,
        op_unit,
        dark=dark,
    )
    tone = _tone(dark)
    _, above, below = shown["series"]
    above["name"], below["name"] = "PV − SP", "u_FF"
    above["markLine"] = {
        "silent": True,
        "symbol": "none",
        "lineStyle": {"color": tone["after"], "type": "solid", "width": 1.5},
        "label": {"formatter": "enabled", "color": tone["muted"], "position": "insideEndTop"},
        "data": [{"xAxis": 1000.0 * enabled}],
    }
    shown["series"] = [above, below]
    shown["grid"][0]["height"] = "33%"  # it is lower than that of the signals, and the name of u_FF needs its line
    above_axis, below_axis = shown["yAxis"]
    above_axis["name"], below_axis["name"] = f"PV − SP [{pv_unit or 'PV unit'}]", f"u_FF [{op_unit}]"
    return shown


def detections(
    answers: Sequence[Mapping[str, Any]],
    unit: str,
    *,
    scale: float,
    dark: bool,
    alone: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Detections over time, those under compensation as a series of their own; the estimate, and the fits' answers.

    The first three series are empty: `glapp.detections` in the browser fills them.

    - `answers`: rows of answers.
    - `unit`: of the width as it is drawn.
    - `scale`: that unit per OP unit.
    - `dark`: on a dark page.
    - `alone`: what each recording of the newest fit says alone: `t0`, `d`; those with a width are drawn.
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

    fits, top = _fits(answers, scale, tone)
    return {
        **_base(tone),
        "grid": {"left": 56, "right": 16, "top": 62, "bottom": 64},
        "xAxis": _time(tone),
        "yAxis": {
            **_axis(tone, type="value", name=f"width [{unit}]", min=0),
            # A bar whose end is above the axis would not be drawn at all.
            ":max": f"v => v.max >= {top!r} ? null : {top!r}",
        },
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
            fits,
            *_alone(alone, scale, tone),
        ],
    }


def _fits(answers: Sequence[Mapping[str, Any]], scale: float, tone: Mapping[str, str]) -> tuple[dict[str, Any], float]:
    """The widths of fits with their intervals as a series, and the greatest upper limit, up to the next half."""
    found = [a for a in answers if a["d"] is not None]
    bars = [
        [{"coord": [1000.0 * a["time"], a["low"] * scale]}, {"coord": [1000.0 * a["time"], a["high"] * scale]}]
        for a in found
        if a["low"] is not None and a["high"] is not None
    ]
    series = {
        "name": "fit, with its 95 % interval",
        "type": "scatter",
        "symbol": "diamond",
        "symbolSize": 11,
        "data": [[1000.0 * a["time"], a["d"] * scale] for a in found],
        "itemStyle": {"color": tone["ink"]},
        "markLine": {
            "silent": True,
            "symbol": ["none", "none"],
            "data": bars,
            "lineStyle": {"color": tone["ink"], "type": "solid"},
            "label": {"show": False},
        },
    }
    return series, math.ceil(2.0 * max((bar[1]["coord"][1] for bar in bars), default=0.0)) / 2.0


def _alone(alone: Sequence[Mapping[str, Any]], scale: float, tone: Mapping[str, str]) -> list[dict[str, Any]]:
    """The widths of single recordings as a series; none where no recording has one."""
    recorded = [
        [1000.0 * datetime.fromisoformat(one["t0"]).timestamp(), one["d"] * scale]
        for one in alone
        if one["t0"] is not None and one["d"] is not None and one["left_out"] is None
    ]
    if not recorded:
        return []
    series = {
        "name": "one recording of the fit alone",
        "type": "scatter",
        "symbol": "rect",
        "symbolSize": 8,
        "data": recorded,
        "itemStyle": {"color": tone["after"]},
    }
    return [series]


def step_test(found: StepTest, *, dark: bool) -> dict[str, Any] | None:
    """A step test: PV above, OP below; what was held is shaded, from when PV had settled more strongly.

    - `found`: what was read.
    - `dark`: on a dark page.

    Returns: None where nothing was in manual.
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
        **_of_lines(tone),
        "grid": [
            {**_ABOVE_ANOTHER, "top": 34, "height": "42%"},
            {**_ABOVE_ANOTHER, "bottom": 26, "height": "28%"},
        ],
        "xAxis": [_axis(tone, type=kind, scale=True, gridIndex=0, axisLabel={"show": False}), below],
        "yAxis": [
            _axis(tone, type="value", scale=True, gridIndex=0, name=f"PV [{found.pv_unit}]", splitNumber=4),
            _axis(tone, type="value", scale=True, gridIndex=1, name=f"OP [{found.unit}]", splitNumber=3),
        ],
        "series": [pv, line("OP", 1, rows.op, tone["op"])],
    }


def phase(
    op: Sequence[Any],
    pv: Sequence[Any],
    name: str,
    op_unit: str,
    *,
    dark: bool,
    flanks: tuple[float, float] | None = None,
    times: Sequence[float] = (),
) -> dict[str, Any]:
    """PV over OP, and the two flanks of a gap: the lines along which PV follows OP up and down, its width apart.

    - `op`, `pv`: the signals; None where they are bad.
    - `name`: of the upright axis, with its unit.
    - `op_unit`: unit of OP.
    - `dark`: on a dark page.
    - `flanks`: width of the gap [OP unit] and PV's move per move of the valve; without them no flank is drawn.
    - `times`: when each sample was [s since 1970 UTC]; no line is drawn where none came for a while.

    Examples
    --------
    >>> drawn = phase([0.0, 2.0, 4.0], [0.0, 0.0, 4.0], "PV [%]", "%", dark=False, flanks=(2.0, 2.0))
    >>> [one["name"] for one in drawn["series"]]
    ['recorded', 'OP rising', 'OP falling']
    """
    tone = _tone(dark)
    data = [[x, y] for x, y in zip(op, pv, strict=True) if x is not None and y is not None]
    most = longest(times)
    broken: list[list[Any]] = []
    for i, pair in enumerate(zip(op, pv, strict=True)):
        if i and i < len(times) and times[i] - times[i - 1] > most:
            broken.append([None, None])
        broken.append(list(pair))
    series: list[dict[str, Any]] = [
        {
            "name": "recorded",
            "type": "line",
            "data": broken,
            "showSymbol": False,
            "lineStyle": {"color": tone["pv"], "width": 1},
            "itemStyle": {"color": tone["pv"]},
        }
    ]
    if flanks is not None and data:
        width, gain = flanks
        low, high = (limit(x for x, _ in data) for limit in (min, max))
        # The line goes through the middle of the points: the load moves PV up and down beside OP.
        middle = _median([y - gain * x for x, y in data])
        bottom, top = (limit(y for _, y in data) for limit in (min, max))
        for label, side, kind in (("OP rising", 1.0, "solid"), ("OP falling", -1.0, "dashed")):
            ends = [(x, middle + gain * (x - side * width / 2.0)) for x in (low - width, high + width)]
            ends = _within(ends, bottom, top)
            series.append(
                {
                    "name": label,
                    "type": "line",
                    "data": [list(end) for end in ends],
                    "showSymbol": False,
                    "lineStyle": {"color": tone["after"], "width": 2.5, "type": kind},
                    "itemStyle": {"color": tone["after"]},
                }
            )
    return {
        **_of_lines(tone),
        "tooltip": {"show": False},
        "grid": {"left": 56, "right": 16, "top": 44, "bottom": 44},
        "xAxis": _axis(tone, type="value", scale=True, name=f"OP [{op_unit}]", nameLocation="middle", nameGap=26),
        "yAxis": _axis(tone, type="value", scale=True, name=name),
        "series": series,
    }


def _median(values: Sequence[float]) -> float:
    ordered = sorted(values)
    return ordered[len(ordered) // 2]


def _within(ends: Sequence[tuple[float, float]], bottom: float, top: float) -> list[tuple[float, float]]:
    """The part of a line between two heights.

    >>> _within([(0.0, 0.0), (4.0, 8.0)], 2.0, 6.0)
    [(1.0, 2.0), (3.0, 6.0)]
    """
    (x0, y0), (x1, y1) = ends
    if y0 == y1:
        return list(ends)
    return [(x0 + (x1 - x0) * (y - y0) / (y1 - y0), y) for y in (bottom, top)]


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
        **_of_lines(tone),
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
