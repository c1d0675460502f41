"""One loop: its one number, its signals, and a person's commands (6.4)."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from html import escape
from typing import Any

import numpy as np
from nicegui import events, ui
from starlette.requests import Request

from ..errors import InputError
from ..modules import Backlash, Graph, Input, Output
from ..report.words import MEANINGS, METHODS, NAMES, count, number, quantity, sentence
from ..service.compensation import TEXT_OF_STATE
from ..service.options import NIGHT
from ..service.recordings import SignalStore
from ..service.settable import Bound
from . import charts
from .client import Gone, Refused, loop_path
from .compensate import why_off
from .compensate_page import CompensationPage
from .pages import Station, command, dialog_of, frame, heading, moment, quiet
from .parameters import FIRST, GROUPS, PARAMETERS, allowed, changed, command_text, field
from .proof_page import ProofCards
from .sessions import Session
from .step_test_page import Wizard
from .under_way import UnderWay

__all__ = ["loop_page"]

_LONG = 8
"""Letters of a width beyond which it is set smaller, to stay on one line."""

WINDOWS = {900: "15 min", 7200: "2 h", 86400: "1 d", 604800: "7 d"}
"""Choices of the time shown in the charts [s]."""

MOST = 3000
"""Samples drawn at most."""

REASON_DAYS = 7

COUNTED_EVERY = 10.0
"""The reasons of a week are counted anew after this time at the earliest [s]."""

BRIDGED = 5.0
"""Gap between two live values from which recorded samples are drawn in between [s]."""


async def signals(station: Station, session: Session, loop: str, begin: float, end: float) -> dict[str, Any]:
    """Samples of a loop: from the service, and where that does not answer those on disk."""
    path = loop_path(loop, f"signals?begin={begin}&end={end}&most={MOST}")
    try:
        found: dict[str, Any] = await station.api.asked("GET", path, session.token)
        return found
    except (Gone, Refused):
        return await asyncio.to_thread(_from_disk, station, loop, begin, end)


def _from_disk(station: Station, loop: str, begin: float, end: float) -> dict[str, Any]:
    """Recorded signals, thinned."""
    table = SignalStore(station.view.folder).read(loop, begin, end)
    every = max(1, -(-len(table) // MOST))
    found: dict[str, Any] = table.take(np.arange(0, len(table), every)).to_pydict()
    found["time"] = [at.timestamp() for at in found["time"]]
    for name in ("SP", "PV", "OP", "U_FF"):
        found[name] = [None if x is None or not math.isfinite(x) else x for x in found[name]]
    return found


class _Valve:
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


class _Page:
    """Page of one loop for one person."""

    def __init__(self, station: Station, session: Session, name: str) -> None:
        self.station, self.session, self.name = station, session, name
        sample = station.view.loops[name].sample_time or 1.0
        self.window = next((window for window in WINDOWS if window >= 300.0 * sample), max(WINDOWS))
        self.last = -math.inf
        self.seen: float | None = None
        self.drawn = 0
        self.newest: tuple[Any, ...] | None = None
        self.stale, self.counted = True, -math.inf
        self.under_way: UnderWay | None = None
        self.valve: _Valve | None = None
        self.by_span, self.crossings_open = True, False
        self.answered: int | None = None
        loop = station.view.loops[name]
        self.pv_unit, self.op_unit = loop.pv_unit or "", loop.op_label
        self.proof = ProofCards(station, session, name, self._between)

    async def _between(self, begin: float, end: float) -> dict[str, Any]:
        return await signals(self.station, self.session, self.name, begin, end)

    @property
    def status(self) -> dict[str, Any]:
        found: dict[str, Any] = self.station.view.shown["loops"].get(self.name, {})
        return found

    def read(self, what: Callable[[Any], Any]) -> Any:
        return self.station.view.read(what)

    # The page

    def build(self) -> None:
        """Build the page."""
        with ui.element("div").classes("bar"):
            heading(self.name)
            self.place = ui.label().classes("muted grow")
            ui.link("← Overview", "/")
        with ui.element("div").classes("loop"):
            with ui.element("div"):
                top = ui.element("div").style("display: contents")
                self._answer()
                self._buttons()
                self.proof.build(top)
            with ui.element("div"):
                self._values()
                self._signals()
                self._crossings()

    def _answer(self) -> None:
        with ui.element("div").classes("card"):
            heading("Gap of the valve", 2)
            self.one = ui.label().classes("one").props('role="status"')
            self.interval = ui.label().classes("muted")
            self.verdict = ui.label().style("margin-top: 8px; font-weight: 600")
            self.so = ui.label()
            with ui.element("div").style("margin-top: 8px") as self.to_do:
                ui.label("What to do").style("font-weight: 600")
                self.todo = ui.label()
            self.progress = ui.label().classes("small medium").props('role="status"')
            with ui.element("details").style("margin-top: 8px") as self.believed:
                with ui.element("summary"):
                    ui.label("Why").style("display: inline")
                self.why = ui.element("div").classes("small")
            self.facts = ui.element("dl").classes("facts small")

    def _buttons(self) -> None:
        with ui.element("div").classes("card").style("display: grid; grid-template-columns: 1fr 1fr; gap: 8px"):
            self._button("Width over time", self.graph)
            self._button("PV over OP", self.phase)
            self._button("Fit now", self.fit, "operator")
            self._button("Step test", self.step_test)
            self._button("Compensate", self.compensate)
            self._button("Parameters", self.parameters)

    def _button(self, text: str, what: Callable[[], Awaitable[None]], role: str = "viewer") -> ui.button:
        button = quiet(text, self._reporting(what))
        if not self.session.may(role):
            button.props("disable").tooltip(f"needs the role {role}")
        return button

    def _reporting(self, what: Callable[[], Awaitable[None]]) -> Callable[[], Awaitable[None]]:
        """Handler of a button that reports errors at the button, also those of a database that cannot be read."""

        async def safely() -> None:
            try:
                await what()
            except InputError as error:
                ui.notify(str(error), type="warning", timeout=0, close_button="Close", multi_line=True)

        return safely

    def _values(self) -> None:
        with ui.element("div").classes("card"), ui.element("div").classes("values"):
            self.values = {}
            for key, text in (("sp", "SP"), ("pv", "PV"), ("op", "OP"), ("u_ff", "u_FF, added to OP")):
                with ui.element("div"):
                    ui.label(text).classes("small muted")
                    self.values[key] = ui.label("–").classes("v")
            with ui.element("div"):
                self.fresh = ui.label().classes("small muted")
                self.compensation = ui.label().classes("small")

    def _signals(self) -> None:
        with ui.element("div").classes("card"):
            with ui.element("div").classes("bar"):
                heading("Signals", 2)
                ui.element("span").classes("grow")
                if any(self._spans()):
                    scales = {True: f"{100 * charts.PART:g} % of span", False: "fit to signals"}
                    ui.toggle(scales, value=True, on_change=self._scale).props("no-caps dense unelevated")
                ui.toggle(WINDOWS, value=self.window, on_change=self._window).props("no-caps dense unelevated")
            nothing = {k: list[Any]() for k in ("time", "SP", "PV", "OP")}
            self.chart = ui.echart(
                charts.live(nothing, [], self.pv_unit, self.op_unit, dark=self.session.dark)
            ).classes("chart")
            self.chart.props('role="img" aria-label="SP, PV, OP and the valve over time"')
            self.drawn_as = ui.label().classes("small muted")

    def _spans(self) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
        """Ranges of the axes of PV and OP."""
        loop = self.station.view.loops[self.name]
        return loop.pv_span, loop.op_span

    def _crossings(self) -> None:
        """Results of the zero crossings: a footnote to the answer, or all there is before the first one."""
        alone = self.station.view.answer(self.name) is None
        self.crossings_open = alone
        with ui.element("details").classes("card").props("open" if alone else "") as fold:
            with ui.element("summary"):
                heading("Zero crossings: what a PLC would show", 2)
                self.plc = ui.label().classes("small muted")
            ui.label(METHODS["Zero crossings: what a PLC would show"][0]).classes("small")
            self.half = ui.label().classes("small half")
            heading(f"Half-periods of the last {REASON_DAYS} days", 3)
            self.reasons = ui.element("div")
        fold.on("toggle", self._folded, js_handler="(e) => emit(e.target.open)")

    async def _folded(self, event: events.GenericEventArguments) -> None:
        """Half-periods are shaded while their heading is open."""
        self.crossings_open = bool(event.args)
        self._show_under_way()
        with suppress(InputError):
            await self.shade()

    async def _scale(self, event: Any) -> None:
        self.by_span = bool(event.value)
        await self._reporting(self.draw)()

    async def _window(self, event: Any) -> None:
        self.window = int(event.value)
        await self._reporting(self.draw)()

    # Running tasks

    async def draw(self) -> None:
        """The signals of the window, all of them anew."""
        end = self.station.view.now
        values = await signals(self.station, self.session, self.name, end - self.window, end)
        halves = await self._halves(end - self.window) if self.crossings_open else []
        self.last, self.drawn = max(values["time"], default=-math.inf), len(values["time"])
        answer = self.station.view.answer(self.name)
        width = None if answer is None else answer["width"]
        self.valve = _Valve(width) if width else None
        valve = None if self.valve is None else [self.valve.after(op) for op in values["OP"]]
        spans = self._spans() if self.by_span else (None, None)
        options = charts.live(
            values, halves, self.pv_unit, self.op_unit, dark=self.session.dark, valve=valve, spans=spans
        )
        if not self.drawn:
            why = f"No value of {self.name} came in the last {WINDOWS[self.window]}."
            options = charts.nothing(options, why, dark=self.session.dark)
        self.drawn_as.set_text(
            f"The valve stays while OP crosses its gap of {quantity(width, self.op_unit)}." if width else ""
        )
        self.chart.options.clear()
        self.chart.options.update(options)
        self.chart.update()
        self.under_way = await asyncio.to_thread(self._begun, values)
        self._show_under_way()

    async def _halves(self, begin: float) -> list[dict[str, Any]]:
        """Half-periods since a time, for the chart."""
        found: list[dict[str, Any]] = await asyncio.to_thread(
            self.read, lambda r: r.half_periods(self.name, begin, 1e12, accepted=False, most=400)
        )
        return found

    async def shade(self) -> None:
        """Redraw the shading of the half-periods over the signals."""
        halves = await self._halves(self.station.view.now - self.window) if self.crossings_open else []
        areas = charts.shades(halves, self.window, dark=self.session.dark)
        ui.run_javascript(f"glapp.shade({self.chart.id}, {json.dumps(areas)})")

    def _begun(self, values: dict[str, Any]) -> UnderWay | None:
        """A detector that has seen the drawn samples; None without the controller, or where samples are left out."""
        loop = self.station.view.loops[self.name]
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
        found = self.under_way.numbers
        pv = self.pv_unit
        failing = ", ".join(self.under_way.failing)
        self.half.set_text(
            f"Half-period under way: Δt {quantity(found['delta_t'], 's')}, Δy {quantity(found['delta_y'], pv)}, "
            f"e_max {quantity(found['e_max'], pv)}, Δysp {quantity(found['delta_sp'], pv)}. "
            + (f"It would be rejected now: {failing}." if failing else "It would be a detection now.")
        )

    async def often(self) -> None:
        """The newest values, from the service."""
        try:
            values = await self.station.api.live(self.name, self.session.token, self.seen)
        except (Gone, Refused) as error:
            if isinstance(error, Refused) and error.status == 401:
                self.station.sessions.end(self.session.id)  # the frame leads to the login
            self.fresh.set_text("The service does not answer: no live values.")
            self.fresh.classes(add="late")
            self.seen = None  # what is newest is told at once when it is back
            await asyncio.sleep(1.0)
            return
        silent = self.station.view.silent(self.name)
        for key, label in self.values.items():
            unit = self.pv_unit if key in ("sp", "pv") else self.op_unit
            value = values.get(key)
            good = value is not None and value["good"]
            text = quantity(value["value"], unit, 4) if value is not None and good else "bad" if value else "–"
            if key == "u_ff" and self.status.get("lost"):
                text = "not known"  # what was written last need not be in the plant any more
            label.set_text(text)
            label.classes(add="old") if silent else label.classes(remove="old")
        pv = values.get("pv")
        if pv is None:
            self.fresh.set_text("No PV has come since the service began.")
            await asyncio.sleep(1.0)
            return
        self.seen = pv["time"]
        old = self.station.view.now - pv["time"]
        at = moment(pv["time"])
        fresh = old < 100 and self.station.view.catching_up is None
        self.fresh.set_text(f"PV of {at[11:]}, {old:.1f} s old." if fresh else f"PV of {at}.")
        self.fresh.classes(add="late") if silent or not pv["good"] else self.fresh.classes(remove="late")
        if pv["time"] > self.last + BRIDGED and self.drawn:
            await self.draw()
        if pv["time"] > self.last:
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
            ui.run_javascript(f"glapp.append({self.chart.id}, {json.dumps([row])}, {1000 * self.window})")

    def _number(self, values: dict[str, Any], key: str) -> float | None:
        value = values.get(key)
        return value["value"] if value is not None and value["good"] else None

    def show(self) -> None:
        """Show the state that needs no query."""
        status = self.status
        self._show_answer(self.station.view.answer(self.name), status)
        loop = self.station.view.loops[self.name]
        self.place.set_text(", ".join(part for part in (loop.area, loop.valve) if part))
        estimate = self.station.view.percent(self.name, status.get("estimate"))
        shown = status.get("estimate") if estimate is None else estimate
        unit = self.op_unit if estimate is None else "%"
        width = "no width" if shown is None else f"≈ {number(shown)} {unit}"
        self.plc.set_text(
            f"{width}, of {count(status.get('detections', 0), 'detection')}; "
            f"{count(status.get('half_periods', 0), 'half-period')} so far"
        )
        made = status.get("compensation")
        self.compensation.set_text(
            ""
            if made is None
            else f"Compensation: {TEXT_OF_STATE[made['standing']]}"
            if made["enabled"]
            else why_off(made).replace("It", "Compensation", 1)
        )

    async def seldom(self) -> None:
        """Show the database's answer and new half-periods."""
        self.show()
        with suppress(InputError):  # the frame tells it
            newest = await asyncio.to_thread(self.read, lambda r: r.half_periods(self.name, accepted=False, most=1))
            mark = tuple(row["number"] for row in newest)
            if mark != self.newest or self.drawn < 2:
                # A page that is there before the first samples are has nothing to go on from.
                await (self.draw() if self.drawn < 2 else self.shade())
                self.newest, self.stale = mark, True
            if self.stale and time.monotonic() - self.counted > COUNTED_EVERY:
                self.counted, self.stale = time.monotonic(), False
                await self._count()

    def _unit(self) -> str:
        return "% of span" if self.station.view.percent(self.name, 1.0) is not None else self.op_unit

    def _show_answer(self, answer: dict[str, Any] | None, status: dict[str, Any]) -> None:
        """Show the answer with its interval."""
        view = self.station.view
        first, _, rest = view.headline(self.name).partition(" (")
        self.one.set_text(first or view.verdict(self.name))
        limits = f"95 % interval {rest.rstrip(')')} {self._unit()}" if rest else ""
        if answer is None and first:
            limits = "by zero crossings alone: a load that moves looks like a gap to them"
        elif not rest and answer is not None and (answer["low"], answer["high"]) != (None, None):
            limits = "with 95 % confidence"
        self.interval.set_text(limits)
        self.verdict.set_text(view.verdict(self.name))
        self.verdict.set_visibility(bool(first))
        urgency = "unjudged" if answer is None else answer["urgency"]
        tone = urgency if urgency in ("high", "medium", "unjudged") else ""
        self.verdict.classes(remove="high medium unjudged").classes(tone)
        kind = "long" if len(first) > _LONG else ""
        self.one.classes(remove="high medium unjudged text long").classes(kind if first else f"text {tone}")
        if answer is None:
            so = status.get("why", "")
        else:  # an answer that an older version stored has no sentence of its own
            so = answer.get("so") or sentence(MEANINGS.get(answer["verdict"], ""))
        self.so.set_text(so)
        progress = view.progress(self.name)
        self.todo.set_text(answer["next"]["text"] if answer is not None else view.todo(self.name))
        self.to_do.set_visibility(answer is not None or not progress)
        self.progress.set_text(progress)
        made = status.get("answer")
        id = None if made is None else made["id"]
        if id == self.answered and self.answered is not None:
            return
        self.answered = id
        self.believed.set_visibility(answer is not None and bool(answer.get("why")))
        self.why.clear()
        self.facts.clear()
        with self.why:
            for text in [] if answer is None else answer.get("why", []):
                ui.html(f"<p>{escape(text)}</p>", sanitize=False)
        with self.facts:
            for name, text in self._known(answer):
                with ui.element("div"):
                    with ui.element("dt"):
                        ui.label(name)
                    with ui.element("dd"):
                        ui.label(text)

    def _known(self, answer: dict[str, Any] | None) -> list[tuple[str, str]]:
        """Facts next to the answer: area, valve, acceptable limit, days, trend of the width."""
        view, loop = self.station.view, self.station.view.loops[self.name]
        rows = [(name, text) for name, text in (("Area", loop.area), ("Valve", loop.valve)) if text]
        believed = view.believed(self.name)
        if answer is None or believed is None:
            return rows
        if (limit := answer["limit"]) is not None and limit["percent_span"] is not None:
            whose = "" if limit["origin"] == "given" else ", the usual limit: none was given"
            rows.append(("Acceptable", f"{number(limit['percent_span'])} % of span{whose}"))
        counted = [one for one in believed["recordings"] if one["left_out"] is None and one["t0"] is not None]
        if counted:
            days = sorted(one["t0"][:10] for one in counted)
            last = "" if days[-1] == days[0] else f" to {days[-1]}"
            rows.append(("Recorded", f"{count(len(counted), 'recording')} of {days[0]}{last}"))
        elif believed["file"]:
            rows.append(("Recorded", "from " + believed["file"].removeprefix(f"{self.name} of ") + " UTC"))
        asked_by = "nightly fit" if believed["asked_by"] == NIGHT else f"asked by {believed['asked_by']}"
        rows.append(("Judged", f"{moment(believed['time'])[:16]}, {asked_by}"))
        if (text := view.trend_text(self.name)) != "–":
            rows.append(("Trend", text))
        return rows

    async def _reasons_of(self) -> list[tuple[str, int, str]]:
        """Labels of the reasons of the last days with how often, and their meaning."""
        found = charts.reasons(await self._counts())
        return [(label, n, meaning) for label, n, meaning, _ in found if label != "accepted"]

    async def _counts(self) -> dict[str, int]:
        begin = self.station.view.now - REASON_DAYS * 86400.0
        found = await asyncio.to_thread(self.read, lambda reader: reader.reason_counts(self.name, begin))
        return {NAMES[code]: n for code, n in found.items()}

    async def _count(self) -> None:
        """Show the reasons of rejection with their counts."""
        counts = charts.reasons(await self._counts())
        total = sum(n for _, n, _, _ in counts)
        self.reasons.clear()
        with self.reasons:
            if not total:
                ui.label("None yet: the loop has not crossed its setpoint.").classes("muted")
                return
            with ui.element("table").classes("plain"), ui.element("tbody"):
                for label, n, meaning, remedy in counts:
                    with ui.element("tr"):
                        with ui.element("td").style("white-space: nowrap"):
                            ui.label(label)
                        with ui.element("td").classes("n"):
                            ui.label(str(n))
                        with ui.element("td").style("min-width: 80px"), ui.element("div").classes("meter"):
                            ui.element("div").style(f"width: {100.0 * n / total:.1f}%")
                        with ui.element("td"):
                            ui.label(sentence(meaning))
                            if remedy:
                                ui.label(remedy).classes("small muted")

    # Dialogs behind the buttons

    async def graph(self) -> None:
        """Detections over time, before and under compensation."""
        any_ = await asyncio.to_thread(self.read, lambda r: r.half_periods(self.name, most=1))
        answers = await asyncio.to_thread(self.read, lambda r: r.answers(self.name, 400))
        scale = self.station.view.percent(self.name, 1.0)
        believed = self.station.view.believed(self.name)
        alone = [] if believed is None else believed["recordings"]
        with dialog_of(f"{self.name}: width of the gap over time"):
            options = charts.detections(
                answers,
                self._unit(),
                scale=1.0 if scale is None else scale,
                dark=self.session.dark,
                alone=[one for one in alone if one["verdict"] in ("backlash", "both")],
            )
            if not any_ and not answers:
                options = charts.nothing(options, await self._why_none(), dark=self.session.dark)
            elif not any_ and all(one["d"] is None for one in answers):
                options = charts.nothing(
                    options, f"No width yet: the fit gave none. {await self._why_none()}", dark=self.session.dark
                )
            chart = ui.echart(options).classes("chart").props('role="img" aria-label="Width of the gap over time"')
            ui.run_javascript(f"glapp.detections({chart.id}, {json.dumps(self.name)})")
            ui.label(
                "A dot is a half-period that passed every test; a triangle is one under compensation, which shows what "
                "is left of the gap. A diamond is a fit, with its 95 % interval."
            ).classes("small muted")

    async def _why_none(self) -> str:
        """Sentence that explains why there is no detection."""
        counts = {name: n for label, n, name in await self._reasons_of() if label}
        if not counts:
            return "No detection: PV has not crossed SP and come back yet."
        usual = max(counts, key=lambda name: counts[name])
        return f"No detection: of {sum(counts.values())} half-periods none passed, most often because {usual}."

    async def phase(self) -> None:
        """PV over OP, and the flanks of the gap where one is known."""
        end = self.station.view.now
        values = await signals(self.station, self.session, self.name, end - self.window, end)
        answer, believed = self.station.view.answer(self.name), self.station.view.believed(self.name)
        process = None if believed is None else believed["process"]
        width = None if answer is None else answer["width"]
        seen, title = values["PV"], f"PV [{self.pv_unit}]" if self.pv_unit else "PV"
        flanks = None
        if width and process is not None and process["integrating"]:
            valve = _Valve(width)  # PV against OP has no shape of its own there
            seen, title = [valve.after(op) for op in values["OP"]], f"{charts.VALVE} [{self.op_unit}]"
            flanks, why = (width, 1.0), "The process integrates, so that the valve stands over OP, not PV."
        elif width and process is not None and process["kp"][0]:
            flanks, why = (width, process["kp"][0]), "PV stays while OP crosses from one flank to the other."
        elif answer is None:
            why = "No flanks are drawn: the loop is not judged yet."
        else:
            why = f"No flanks are drawn: the answer has no width ({self.station.view.verdict(self.name).lower()})."
        with dialog_of(f"{self.name}: PV over OP, last {WINDOWS[self.window]}"):
            options = charts.phase(
                values["OP"], seen, title, self.op_unit, dark=self.session.dark, flanks=flanks, times=values["time"]
            )
            if not any(x is not None for x in values["PV"]):
                why_empty = f"No value of {self.name} came in the last {WINDOWS[self.window]}."
                options = charts.nothing(options, why_empty, dark=self.session.dark)
            ui.echart(options).classes("chart").props('role="img" aria-label="PV over OP"')
            lines = f"The two lines are the flanks of the gap of {quantity(width, self.op_unit)}. " if flanks else ""
            ui.label(lines + why).classes("small muted")

    async def step_test(self) -> None:
        """A step test: the next step, and the result so far."""
        answer, status = self.station.view.answer(self.name), self.status
        width = status.get("estimate") if answer is None else (answer["high"] or answer["low"])

        async def last(seconds: float) -> dict[str, Any]:
            end = self.station.view.now
            return await signals(self.station, self.session, self.name, end - seconds, end)

        with dialog_of(f"{self.name}: step test"):
            loop = self.station.view.loops[self.name]
            await Wizard(loop, width, WINDOWS, self.window, last, self.session.dark).build()

    async def _ask(self, path: str) -> Any:
        """Something from the API; None where it does not say."""
        try:
            return await self.station.api.asked("GET", path, self.session.token)
        except (Gone, Refused) as error:
            ui.notify(str(error), type="warning", timeout=0, close_button="Close", multi_line=True)
            return None

    async def parameters(self) -> None:
        """All parameters with unit, bound and default; who changed what, when."""
        seen = await self._ask(loop_path(self.name, "parameters"))
        bounds = None if seen is None else await self._ask(loop_path(self.name, "bounds"))
        if seen is None or bounds is None:
            return
        log = await asyncio.to_thread(self.read, lambda r: r.commands(self.name, 200))
        log = [row for row in log if row["command"] in ("change", "take_over")]
        may = self.session.may("engineer")
        fields: dict[str, ui.number] = {}
        with dialog_of(f"{self.name}: parameters") as dialog:
            ui.label(
                "Settings of the detector and of the compensation. The plant's controller is not changed "
                "here. A change of the detector restarts its estimate. An empty field means the default."
            ).classes("small muted")

            def rows(names: tuple[str, ...]) -> None:
                with ui.element("table").classes("plain parameters"):
                    with ui.element("thead"), ui.element("tr"):
                        for text in ("Parameter", "Value", "Unit", "Allowed", "Default"):
                            with ui.element("th"):
                                ui.label(text)
                    with ui.element("tbody"):
                        for name in names:
                            if name in seen:
                                row(name)

            def row(name: str) -> None:
                about, bound = PARAMETERS[name], Bound(**bounds[name])
                with ui.element("tr"):
                    with ui.element("td"):
                        ui.label(sentence(about.meaning).removesuffix("."))
                        ui.label(name).classes("small muted")
                    with ui.element("td"):
                        fields[name] = (
                            ui.number(value=field(seen[name]))
                            .props(f'dense outlined aria-label="{name}" input-class="text-right"')
                            .style("width: 130px")
                        )
                        if not may:
                            fields[name].props("readonly")
                    unit = "–" if bound.unit == "1" else bound.unit
                    for head, text in (("Unit", unit), ("Allowed", allowed(bound)), ("Default", about.default)):
                        with ui.element("td").props(f'data-label="{head}"'):
                            ui.label(text).style("display: inline")

            rows(FIRST)
            for title, names in GROUPS.items():
                if any(name in seen for name in names):
                    with ui.element("details"):
                        with ui.element("summary"):
                            ui.label(title).style("display: inline")
                        rows(names)

            async def save() -> None:
                body = changed(seen, {name: one.value for name, one in fields.items()})
                if not body["values"]:
                    ui.notify("Nothing is changed.")
                    return
                path = loop_path(self.name, "parameters")
                what = ", ".join(body["values"])
                asking = lambda: self.station.api.command(path, self.session.token, body)  # noqa: E731
                if await command(self.station, self.session, asking, f"Set: {what}.") is not None:
                    dialog.close()

            if may:
                ui.button("Set what is changed", on_click=save).props("no-caps unelevated color=primary").style(
                    "align-self: start"
                )
            else:
                ui.label("Changing them needs the role engineer.").classes("small muted")
            heading("Who changed what, when", 2)
            self._log(log, command_text)

    def _log(self, rows: list[dict[str, Any]], text: Callable[[dict[str, Any]], str]) -> None:
        """Table of commands with the persons."""
        if not rows:
            ui.label("Nobody yet.").classes("muted")
            return
        with ui.element("table").classes("plain"), ui.element("tbody"):
            for row in rows[:50]:
                with ui.element("tr"):
                    for cell in (moment(row["time"]), f"{row['person']} ({row['role']})", row["command"], text(row)):
                        with ui.element("td"):
                            ui.label(cell)

    async def fit(self) -> None:
        """Have it fitted now."""
        path = loop_path(self.name, "fit")
        asking = lambda: self.station.api.command(path, self.session.token)  # noqa: E731
        await command(
            self.station, self.session, asking, f"{self.name} is fitted as soon as the fit before it is done."
        )

    # Compensation

    async def compensate(self) -> None:
        """Dialog of the compensation: its plan before, its result after."""
        page = CompensationPage(self.station, self.session, self.name, self._ask, self._between)
        if (known := await page.known()) is not None:
            with dialog_of(f"{self.name}: compensation"):
                await page.build(*known)


def loop_page(station: Station, request: Request, name: str) -> None:
    """One loop."""
    session = station.who(request)
    with frame(station, session, name, ""):
        if name not in station.view.shown["loops"] or name not in station.view.loops:
            heading("No such loop")
            ui.label(f"The service watches no loop “{name}”.")
            ui.link("← Overview", "/")
            return
        page = _Page(station, session, name)
        page.build()
        page.show()
        ui.timer(0.02, page.often)  # what the service is asked for comes when the page is there, however slow it is
        ui.timer(2.0, page.seldom)
        ui.timer(1.0, page.proof.refresh)
