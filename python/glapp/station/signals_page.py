"""The signals on the page of a loop: the values now, their chart over time, and the half-period under way."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from nicegui import ui

from ..modules import Backlash, Graph, Input, Output
from ..report.words import quantity
from . import charts
from .client import Gone, Refused
from .one_loop import WINDOWS, OneLoop, reporting
from .pages import heading, moment
from .under_way import UnderWay

__all__ = ["DrawnValve", "SignalCards", "state_of"]

BRIDGED = 5.0
"""Gap between two live values from which recorded samples are drawn in between [s]."""


class DrawnValve:
    """The valve as the model has it: OP after a gap of a width, sample by sample."""

    def __init__(self, width: float) -> None:
        self.width = width
        self._graph: Graph | None = None

    def after(self, op: float | None) -> float | None:
        """Place in the test with this OP; None where that is bad."""
        if op is None:
            return None
        if self._graph is None:  # it is not known where in its gap it was: it is drawn as if in the middle
            modules = {"op": Input(op), "gap": Backlash(self.width, start=op), "end": Output()}
            self._graph = Graph(1.0, modules, ["op -> gap -> end"])
        self._graph["op.value"] = op
        self._graph.scan()
        return float(self._graph["gap"])


def state_of(values: Mapping[str, Mapping[str, Any]]) -> str:
    """State of a loop that a person has to know: manual, a limit, a bad signal; empty where there is none.

    - `values`: the newest of each signal, as the service's `live` has them.

    >>> good = {"good": True, "note": ""}
    >>> state_of({"mode": good | {"value": 0.0}, "high": good | {"value": 1.0}, "low": good | {"value": 0.0}})
    'The controller is in manual. OP is at its high limit.'
    >>> state_of({"pv": {"value": None, "good": False, "note": "BadSensorFailure"}})
    'PV is bad: BadSensorFailure.'
    """
    found = [
        f"{name.upper()} is bad: {value['note'] or 'no number'}."
        for name, value in values.items()
        if name in ("sp", "pv", "op", "mode") and not value["good"]
    ]
    for name, text in (
        ("low", "OP is at its low limit."),
        ("high", "OP is at its high limit."),
        ("mode", "The controller is in manual."),
    ):
        value = values.get(name)
        if value is not None and value["good"] and (value["value"] == 0.0) == (name == "mode"):
            found.insert(0, text)
    return " ".join(found)


class SignalCards:
    """Cards with the values now and with the chart of the signals.

    - `last`: time of the newest point of the chart [s since 1970 UTC].
    - `longest`: time across which no line is drawn [s].
    - `drawn`: number of samples drawn at once.
    - `shaded`: whether half-periods are shaded in the chart.
    - `half`: label for the half-period under way.
    - `compensation`: label for the state of the compensation.
    """

    def __init__(self, loop: OneLoop) -> None:
        self.loop = loop
        self.last, self.longest = -math.inf, math.inf
        self.seen: float | None = None
        self.drawn = 0
        self.under_way: UnderWay | None = None
        self.valve: DrawnValve | None = None
        self.by_span, self.shaded = True, False
        self.half: ui.label

    def build(self) -> None:
        """Build the cards."""
        with ui.element("div").classes("card"), ui.element("div").classes("values"):
            self.values = {}
            for key, text in (("sp", "SP"), ("pv", "PV"), ("op", "OP"), ("u_ff", "u_FF, added to OP")):
                with ui.element("div"):
                    ui.label(text).classes("small muted")
                    self.values[key] = ui.label("–").classes("v")
            with ui.element("div"):
                self.fresh = ui.label().classes("small muted")
                self.state = ui.label().classes("medium").props('role="status"')
                self.compensation = ui.label().classes("small")
        with ui.element("div").classes("card"):
            with ui.element("div").classes("bar"):
                heading("Signals", 2)
                ui.element("span").classes("grow")
                if any(self._spans()):
                    scales = {True: f"{100 * charts.PART:g} % of span", False: "fit to signals"}
                    ui.toggle(scales, value=True, on_change=self._scale).props("no-caps dense unelevated")
                ui.toggle(WINDOWS, value=self.loop.window, on_change=self._window).props("no-caps dense unelevated")
            nothing = {k: list[Any]() for k in ("time", "SP", "PV", "OP")}
            empty = charts.live(nothing, [], self.loop.pv_unit, self.loop.op_unit, dark=self.loop.dark)
            why = f"Waiting for the signals of {self.loop.name}."
            self.chart = ui.echart(charts.nothing(empty, why, dark=self.loop.dark)).classes("chart")
            self.chart.props('role="img" aria-label="SP, PV, OP and the valve over time"')
            self.drawn_as = ui.label().classes("small muted")

    def _spans(self) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
        """Ranges of the axes of PV and OP."""
        loop = self.loop.view.loops[self.loop.name]
        return loop.pv_span, loop.op_span

    async def _scale(self, event: Any) -> None:
        self.by_span = bool(event.value)
        await reporting(self.draw)()

    async def _window(self, event: Any) -> None:
        self.loop.window = int(event.value)
        await reporting(self.draw)()

    async def draw(self) -> None:
        """The signals of the window, all of them anew."""
        values, halves = await self.loop.newest(), await self._halves()
        self.last, self.drawn = max(values["time"], default=-math.inf), len(values["time"])
        self.longest = charts.longest(values["time"])
        width = self.loop.width
        self.valve = DrawnValve(width) if width else None
        valve = None if self.valve is None else [self.valve.after(op) for op in values["OP"]]
        options = charts.live(
            values,
            halves,
            self.loop.pv_unit,
            self.loop.op_unit,
            dark=self.loop.dark,
            valve=valve,
            spans=self._spans(),
            part=charts.PART if self.by_span else charts.FITTED,
        )
        why = "" if self.drawn else f"No value of {self.loop.name} came in the last {WINDOWS[self.loop.window]}."
        options = charts.nothing(options, why, dark=self.loop.dark)
        self.drawn_as.set_text(
            f"The valve stays while OP crosses its gap of {quantity(width, self.loop.op_unit)}." if width else ""
        )
        self.chart.options.clear()
        self.chart.options.update(options)
        self.chart.update()
        self.under_way = await asyncio.to_thread(self._begun, values)
        self._show_under_way()

    async def shade(self) -> None:
        """Redraw the shading of the half-periods over the signals."""
        areas = charts.shades(await self._halves(), self.loop.window, dark=self.loop.dark)
        ui.run_javascript(f"glapp.shade({self.chart.id}, {json.dumps(areas)})")

    async def _halves(self) -> list[dict[str, Any]]:
        """Half-periods of the window, for the chart; none where they are not shaded."""
        if not self.shaded:
            return []
        begin = self.loop.view.now - self.loop.window
        return await self.loop.read(lambda r: r.half_periods(self.loop.name, begin, 1e12, accepted=False, most=400))

    def _begun(self, values: dict[str, Any]) -> UnderWay | None:
        """A detector that has seen the drawn samples; None without the controller, or where samples are left out."""
        loop = self.loop.view.loops[self.loop.name]
        times = values["time"]
        if loop.controller is None or len(times) < 2 or values.get("every", 1) > 1:
            return None
        one = UnderWay(loop, loop.sample_time or float(np.median(np.diff(times))))
        one.take_all(values)
        return one

    def _show_under_way(self) -> None:
        """Show the half-period under way."""
        if self.under_way is None:
            self.half.set_text("")
            return
        if self.under_way.bad:
            self.half.set_text("No half-period is under way: SP or PV is bad.")
            return
        found = self.under_way.numbers
        pv = self.loop.pv_unit
        failing = ", ".join(self.under_way.failing)
        self.half.set_text(
            f"Half-period under way: Δt {quantity(found['delta_t'], 's')}, Δy {quantity(found['delta_y'], pv)}, "
            f"e_max {quantity(found['e_max'], pv)}, Δysp {quantity(found['delta_sp'], pv)}. "
            + (f"It would be rejected now: {failing}." if failing else "It would be a detection now.")
        )

    async def often(self) -> None:
        """The newest values, from the service."""
        try:
            values = await self.loop.station.api.live(self.loop.name, self.loop.session.token, self.seen)
        except (Gone, Refused) as error:
            if isinstance(error, Refused) and error.status == 401:
                self.loop.station.sessions.end(self.loop.session.id)  # the frame leads to the login
            self.fresh.set_text("The service does not answer: no live values.")
            self.fresh.classes(add="late")
            self.state.set_text("")
            self.values["u_ff"].set_text("not known")
            for label in self.values.values():
                label.classes(add="old")
            self.seen = None  # what is newest is told at once when it is back
            await asyncio.sleep(1.0)
            return
        silent = self.loop.view.silent(self.loop.name)
        for key, label in self.values.items():
            unit = self.loop.pv_unit if key in ("sp", "pv") else self.loop.op_unit
            value = values.get(key)
            good = value is not None and value["good"]
            text = quantity(value["value"], unit, 4) if value is not None and good else "bad" if value else "–"
            if key == "u_ff" and self.loop.status.get("lost"):
                text = "not known"  # what was written last need not be in the plant any more
            label.set_text(text)
            label.classes(add="old") if silent else label.classes(remove="old")
        self.state.set_text("" if silent else state_of(values))
        pv = values.get("pv")
        if pv is None:
            self.fresh.set_text("No PV has come since the service began.")
            await asyncio.sleep(1.0)
            return
        self.seen = pv["time"]
        old = self.loop.view.now - pv["time"]
        at = moment(pv["time"])
        fresh = old < 100 and self.loop.view.catching_up is None
        self.fresh.set_text(f"PV of {at[11:]}, {old:.1f} s old." if fresh else f"PV of {at}.")
        self.fresh.classes(add="late") if silent or not pv["good"] else self.fresh.classes(remove="late")
        if pv["time"] > self.last + BRIDGED and self.drawn:
            await self.draw()
        if pv["time"] > self.last + self.longest:
            return  # a line across a break would look measured: the samples since then are there in seconds
        if pv["time"] > self.last and self.drawn:  # else it is drawn with those before it
            self.last = pv["time"]
            row = [1000.0 * pv["time"], *(self._number(values, key) for key in ("sp", "pv", "op"))]
            if self.valve is not None:
                row.append(self.valve.after(row[3]))
            if self.under_way is not None:
                mode = values.get("mode")
                auto = mode is None or mode["value"] == 1.0
                sp, value, op = (self._number(values, key) for key in ("sp", "pv", "op"))
                self.under_way.take(pv["time"], sp, value, op, auto=auto)
                self._show_under_way()
            ui.run_javascript(f"glapp.append({self.chart.id}, {json.dumps([row])}, {1000 * self.loop.window})")

    def _number(self, values: dict[str, Any], key: str) -> float | None:
        value = values.get(key)
        return value["value"] if value is not None and value["good"] else None
