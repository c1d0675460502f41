"""One loop: its one number, its signals, and what a person may do about it (6.4)."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import numpy as np
from nicegui import ui
from starlette.requests import Request

from ..errors import InputError
from ..report.words import MEANINGS, NAMES, duration, quantity, sentence
from ..service.compensation import TOLD
from ..service.recordings import Signals
from ..service.settable import Bound
from . import charts
from .client import Gone, Refused, loop_path
from .compensate import calm, plan, why_off
from .pages import Station, command, dialog_of, frame, heading, moment, quiet
from .parameters import PARAMETERS, changed, field, told
from .sessions import Session
from .step_test_page import Wizard
from .under_way import UnderWay

__all__ = ["loop_page"]

WINDOWS = {900: "15 min", 7200: "2 h", 86400: "1 d", 604800: "7 d"}
"""How far back the signals are drawn [s]."""

MOST = 3000
"""So many samples are drawn at most."""

REASON_DAYS = 7

COUNTED_EVERY = 10.0
"""The reasons of a week are counted anew after this time at the earliest [s]."""

BRIDGED = 5.0
"""Where more than that lies between two live values, what came in between is drawn as it was recorded [s]."""

CALM_AFTER = 20.0
"""So many Ti must have been seen before and since to say whether PV is calmer."""


async def signals(station: Station, session: Session, loop: str, begin: float, end: float) -> dict[str, Any]:
    """Samples of a loop: from the service, and where that does not answer those on disk."""
    path = loop_path(loop, f"signals?begin={begin}&end={end}&most={MOST}")
    try:
        found: dict[str, Any] = await station.door.asked("GET", path, session.token)
        return found
    except (Gone, Refused):
        return await asyncio.to_thread(_from_disk, station, loop, begin, end)


def _from_disk(station: Station, loop: str, begin: float, end: float) -> dict[str, Any]:
    table = Signals(station.view.folder).read(loop, begin, end)
    every = max(1, -(-len(table) // MOST))
    found: dict[str, Any] = table.take(np.arange(0, len(table), every)).to_pydict()
    found["time"] = [at.timestamp() for at in found["time"]]
    for name in ("SP", "PV", "OP", "U_FF"):
        found[name] = [None if x is None or not math.isfinite(x) else x for x in found[name]]
    return found


class _Page:
    """What is shown of one loop to one person."""

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
        loop = station.view.loops[name]
        self.pv_unit, self.op_unit = loop.pv_unit or "", loop.op_label

    @property
    def status(self) -> dict[str, Any]:
        found: dict[str, Any] = self.station.view.shown["loops"].get(self.name, {})
        return found

    def read(self, what: Callable[[Any], Any]) -> Any:
        return self.station.view.read(what)

    # The page

    def build(self) -> None:
        with ui.element("div").classes("bar"):
            heading(self.name)
            self.place = ui.label().classes("muted grow")
            ui.link("← Overview", "/")
        with ui.element("div").classes("loop"):
            with ui.element("div"):
                self._answer()
                self._buttons()
                self._values()
            with ui.element("div"):
                self._signals()
                with ui.element("div").classes("card"):
                    self._reasons()

    def _answer(self) -> None:
        with ui.element("div").classes("card"):
            heading("Gap of the valve", 2)
            self.one = ui.label().classes("one").props('role="status"')
            self.interval = ui.label().classes("muted")
            self.verdict = ui.label().style("margin-top: 8px; font-weight: 600")
            self.meaning = ui.label().classes("small")
            self.trend = ui.label().classes("small")
            self.todo = ui.label().style("margin-top: 8px")
            self.asked = ui.label().classes("small muted")

    def _buttons(self) -> None:
        with ui.element("div").classes("card").style("display: grid; grid-template-columns: 1fr 1fr; gap: 8px"):
            self._button("Graph", self.graph)
            self._button("Parameters", self.parameters)
            self._button("Compensate", self.compensate)
            self._button("Fit now", self.fit, "operator")
            self._button("Phase plot", self.phase)
            self._button("Step test", self.step_test)

    def _button(self, text: str, what: Callable[[], Awaitable[None]], role: str = "viewer") -> ui.button:
        button = quiet(text, self._told(what))
        if not self.session.may(role):
            button.props("disable").tooltip(f"needs the role {role}")
        return button

    def _told(self, what: Callable[[], Awaitable[None]]) -> Callable[[], Awaitable[None]]:
        """What a button does; a database that cannot be read is told at the button."""

        async def safely() -> None:
            try:
                await what()
            except InputError as error:
                ui.notify(str(error), type="warning", timeout=0, close_button="Close", multi_line=True)

        return safely

    def _values(self) -> None:
        with ui.element("div").classes("card"):
            heading("Now", 2)
            with ui.element("div").classes("values"):
                self.values = {}
                for key, text in (("sp", "SP"), ("pv", "PV"), ("op", "OP"), ("u_ff", "u_FF")):
                    with ui.element("div"):
                        ui.label(text).classes("small muted")
                        self.values[key] = ui.label("–").classes("v")
            self.fresh = ui.label().classes("small muted")
            self.compensation = ui.label().classes("small").style("margin-top: 6px")

    def _signals(self) -> None:
        with ui.element("div").classes("card"):
            with ui.element("div").classes("bar"):
                heading("Signals, half-periods shaded by their verdict", 2)
                ui.element("span").classes("grow")
                ui.toggle(WINDOWS, value=self.window, on_change=self._window).props("no-caps dense unelevated")
            self.chart = ui.echart(
                charts.live(
                    {k: [] for k in ("time", "SP", "PV", "OP")}, [], self.pv_unit, self.op_unit, dark=self.session.dark
                )
            ).classes("chart")
            self.chart.props('role="img" aria-label="SP, PV and OP over time"')
            self.half = ui.label().classes("small half")

    def _reasons(self) -> None:
        heading(f"Half-periods of the last {REASON_DAYS} days", 2)
        self.reasons = ui.element("div")

    async def _window(self, event: Any) -> None:
        self.window = int(event.value)
        await self._told(self.draw)()

    # What goes on

    async def draw(self) -> None:
        """The signals of the window, all of them anew."""
        end = time.time()
        values = await signals(self.station, self.session, self.name, end - self.window, end)
        halves = await self._halves(end - self.window)
        self.last, self.drawn = max(values["time"], default=-math.inf), len(values["time"])
        options = charts.live(values, halves, self.pv_unit, self.op_unit, dark=self.session.dark)
        self.chart.options.clear()
        self.chart.options.update(options)
        self.chart.update()
        self.under_way = await asyncio.to_thread(self._begun, values)
        self._show_under_way()

    async def _halves(self, begin: float) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = await asyncio.to_thread(
            self.read, lambda r: r.half_periods(self.name, begin, 1e12, accepted=False, most=400)
        )
        return found

    async def shade(self) -> None:
        """The half-periods of the window anew; the signals are there."""
        areas = charts.shades(await self._halves(time.time() - self.window), self.window, dark=self.session.dark)
        ui.run_javascript(f"glapp.shade({self.chart.id}, {json.dumps(areas)})")

    def _begun(self, values: dict[str, Any]) -> UnderWay | None:
        """A detector that has seen what is drawn; None where the controller is not known, or samples are left out."""
        loop = self.station.view.loops[self.name]
        times = values["time"]
        if loop.controller is None or len(times) < 2 or values.get("every", 1) > 1:
            return None
        one = UnderWay(loop, loop.sample_time or float(np.median(np.diff(times))))
        one.take_all(values)
        return one

    def _show_under_way(self) -> None:
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
            values = await self.station.door.live(self.name, self.session.token, self.seen)
        except (Gone, Refused) as error:
            if isinstance(error, Refused) and error.status == 401:
                self.station.sessions.end(self.session.id)  # the frame leads to the login
            self.fresh.set_text("The service does not answer: no live values.")
            self.fresh.classes(add="late")
            self.seen = None  # what is newest is told at once when it is back
            await asyncio.sleep(1.0)
            return
        for key, label in self.values.items():
            unit = self.pv_unit if key in ("sp", "pv") else self.op_unit
            value = values.get(key)
            good = value is not None and value["good"]
            text = quantity(value["value"], unit, 4) if value is not None and good else "bad" if value else "–"
            label.set_text(text)
        pv = values.get("pv")
        if pv is None:
            self.fresh.set_text("No PV has come since the service began.")
            await asyncio.sleep(1.0)
            return
        self.seen = pv["time"]
        old = time.time() - pv["time"]
        at = moment(pv["time"])
        self.fresh.set_text(f"PV of {at[11:]}, {old:.1f} s old." if old < 100 else f"PV of {at}.")
        self.fresh.classes(add="late") if self.station.view.silent(self.name) or not pv["good"] else self.fresh.classes(
            remove="late"
        )
        if pv["time"] > self.last + BRIDGED and self.drawn:
            await self.draw()
        if pv["time"] > self.last:
            self.last = pv["time"]
            row = [1000.0 * pv["time"], *(self._number(values, key) for key in ("sp", "pv", "op"))]
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
        """What is known without asking."""
        status = self.status
        self._show_answer(self.station.view.answer(self.name), status)
        self.place.set_text(f"Gap of the valve in {self._unit()}; half-periods so far: {status.get('half_periods', 0)}")
        made = status.get("compensation")
        self.compensation.set_text(
            ""
            if made is None
            else f"Compensation: {TOLD[made['standing']]}"
            if made["enabled"]
            else f"Compensation: {why_off(made)}"
        )

    async def seldom(self) -> None:
        """What the database has: the answer, and new half-periods."""
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
        text = self.station.view.headline(self.name)
        first, _, rest = text.partition(" (")
        self.one.set_text(first or "–")
        limits = f"95 % interval {rest.rstrip(')')} {self._unit()}" if rest else ""
        if not rest and answer is not None and answer["verdict"] in ("sound", "at_least"):
            limits = "with 95 % confidence"
        self.interval.set_text(limits)
        self.verdict.set_text(self.station.view.verdict(self.name))
        urgency = "none" if answer is None else answer["urgency"]
        self.verdict.classes(remove="high medium").classes(add=urgency if urgency in ("high", "medium") else "")
        if answer is None:
            crossings = "By zero crossings alone: a load that moves looks like a gap to them."
            why = status.get("why") or ("" if status.get("estimate") is None else crossings)
            self.meaning.set_text(sentence(why))
            self.todo.set_text("It is fitted tonight; Fit now does it at once.")
            self.asked.set_text("Is being fitted." if status.get("fitting") else "")
        else:
            self.meaning.set_text(sentence(MEANINGS.get(answer["verdict"], "")))
            self.todo.set_text(answer["next"]["text"])
            row = status.get("answer") or {}
            by, at = row.get("asked_by", ""), row.get("time")
            self.asked.set_text("Is being fitted." if status.get("fitting") else f"Fit of {moment(at)}, asked by {by}.")
        trend = self.station.view.trend_text(self.name)
        self.trend.set_text("" if trend == "–" else f"Trend: {trend}")

    async def _count(self) -> None:
        since = time.time() - REASON_DAYS * 86400.0
        rows = await asyncio.to_thread(
            self.read,
            lambda r: r.rows(
                "SELECT reason, COUNT(*) AS n FROM half_periods WHERE loop = (SELECT id FROM loops WHERE name = ?) "
                "AND t_end > ? GROUP BY reason",
                self.name,
                since,
            ),
        )
        counts = charts.reasons({NAMES[row["reason"]]: row["n"] for row in rows})
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

    # What its buttons open

    async def graph(self) -> None:
        """Detections over time, before and under compensation."""
        any_ = await asyncio.to_thread(self.read, lambda r: r.half_periods(self.name, most=1))
        answers = await asyncio.to_thread(self.read, lambda r: r.answers(self.name, 400))
        scale = self.station.view.percent(self.name, 1.0)
        with dialog_of(f"{self.name}: detections"):
            if not any_ and not answers:
                ui.label("There is no detection yet.")
            else:
                options = charts.detections(
                    answers, self._unit(), scale=1.0 if scale is None else scale, dark=self.session.dark
                )
                chart = ui.echart(options).classes("chart").props('role="img" aria-label="Detections over time"')
                ui.run_javascript(f"glapp.detections({chart.id}, {json.dumps(self.name)})")
                ui.label(
                    "Each dot is a half-period that passed every test. Triangles are those under compensation: they "
                    "show what is left of the gap. A fit stands with its 95 % interval."
                ).classes("small muted")

    async def phase(self) -> None:
        """PV over OP."""
        end = time.time()
        values = await signals(self.station, self.session, self.name, end - self.window, end)
        with dialog_of(f"{self.name}: PV over OP, last {WINDOWS[self.window]}"):
            options = charts.phase(values["OP"], values["PV"], self.pv_unit, self.op_unit, dark=self.session.dark)
            ui.echart(options).classes("chart").props('role="img" aria-label="PV over OP"')
            ui.label("A gap draws two flanks that lie its width apart in OP.").classes("small muted")

    async def step_test(self) -> None:
        """A step test: what to do next, and what it tells so far."""
        answer, status = self.station.view.answer(self.name), self.status
        width = status.get("estimate") if answer is None else (answer["high"] or answer["low"])

        async def last(seconds: float) -> dict[str, Any]:
            end = time.time()
            return await signals(self.station, self.session, self.name, end - seconds, end)

        with dialog_of(f"{self.name}: step test"):
            loop = self.station.view.loops[self.name]
            await Wizard(loop, width, WINDOWS, self.window, last, self.session.dark).build()

    async def _ask(self, path: str) -> Any:
        """Something from the door; None where it does not say."""
        try:
            return await self.station.door.asked("GET", path, self.session.token)
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
                "These are of the detector and the compensation. The plant's own controller is not changed here. "
                "A change of the detector's begins its estimate anew. An empty field is the default."
            ).classes("small muted")
            with ui.element("table").classes("plain"):
                with ui.element("thead"), ui.element("tr"):
                    for text in ("parameter", "value", "unit", "must be", "default"):
                        with ui.element("th"):
                            ui.label(text)
                with ui.element("tbody"):
                    for name, value in seen.items():
                        about, bound = PARAMETERS[name], Bound(**bounds[name])
                        with ui.element("tr"):
                            with ui.element("td"):
                                ui.label(name)
                                ui.label(about.meaning).classes("small muted")
                            with ui.element("td"):
                                fields[name] = (
                                    ui.number(value=field(value))
                                    .props(f'dense outlined aria-label="{name}" input-class="text-right"')
                                    .style("width: 130px")
                                )
                                if not may:
                                    fields[name].props("readonly")
                            for text in ("–" if bound.unit == "1" else bound.unit, bound.words, about.default):
                                with ui.element("td"):
                                    ui.label(text)

            async def save() -> None:
                body = changed(seen, {name: one.value for name, one in fields.items()})
                if not body["values"]:
                    ui.notify("Nothing is changed.")
                    return
                path = loop_path(self.name, "parameters")
                what = ", ".join(body["values"])
                asking = lambda: self.station.door.command(path, self.session.token, body)  # noqa: E731
                if await command(self.station, self.session, asking, f"Set: {what}.") is not None:
                    dialog.close()

            if may:
                ui.button("Set what is changed", on_click=save).props("no-caps unelevated color=primary").style(
                    "align-self: start"
                )
            else:
                ui.label("Changing them needs the role engineer.").classes("small muted")
            heading("Who changed what, when", 2)
            self._log(log, told)

    def _log(self, rows: list[dict[str, Any]], text: Callable[[dict[str, Any]], str]) -> None:
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
        asking = lambda: self.station.door.command(path, self.session.token)  # noqa: E731
        await command(
            self.station, self.session, asking, f"{self.name} is fitted as soon as the fit before it is done."
        )

    # Compensation

    async def compensate(self) -> None:
        """What it will do before it does it, and what it has done."""
        seen = await self._ask(loop_path(self.name, "parameters"))
        status = await self._ask("/status")
        if seen is None or status is None:
            return
        made = status["loops"][self.name].get("compensation")
        last = status["loops"][self.name]["answer"]
        found = plan(seen, self.op_unit)
        engineer, operator = self.session.may("engineer"), self.session.may("operator")
        token = self.session.token
        with dialog_of(f"{self.name}: compensation") as dialog:
            if made is None:
                ui.label(found.why_not or "This loop has no node for u_FF, or its controller is not known.")
                return
            if made["enabled"]:
                await self._in_force(made, seen["ti"])
            elif made["why_off"]:
                ui.label(why_off(made))
            heading("What it does" if made["enabled"] else "What it will do", 2)
            with ui.element("ul"):
                for line in found.lines:
                    with ui.element("li"):
                        ui.label(line)
            if found.why_not:
                ui.label(found.why_not)

            async def go(what: str, body: dict[str, Any], said: str) -> None:
                asking = lambda: self.station.door.command(loop_path(self.name, what), token, body)  # noqa: E731
                if await command(self.station, self.session, asking, said) is not None:
                    dialog.close()

            with ui.element("div").classes("bar"):
                if made["enabled"]:
                    off = ui.button("Switch off", on_click=lambda: go("disable", {}, f"{self.name}: off."))
                    off.props("no-caps unelevated color=primary" + ("" if operator else " disable"))
                else:
                    on = ui.button(
                        f"Enable compensation of {self.name}",
                        on_click=lambda: go("enable", {"seen": seen}, f"{self.name} is compensated."),
                    )
                    on.props(
                        "no-caps unelevated color=primary" + ("" if engineer and not found.why_not else " disable")
                    )
                if (
                    last is not None
                    and last["compensable"] is not None
                    and seen.get("comp_fitted") != last["compensable"]
                ):
                    width = quantity(last["compensable"], self.op_unit)
                    take = quiet(
                        f"Take over the fit: {width}",
                        lambda: go("take_over", {"answer": last["id"], "seen": seen}, "Taken over."),
                    )
                    take.props("" if engineer else "disable")
                if not made["enabled"]:
                    drill = quiet(
                        "Test switching off",
                        lambda: go("drill", {}, "The test is under way: Events tell how it ends."),
                    )
                    drill.props("" if engineer else "disable")
            if not engineer:
                ui.label("Enabling it needs the role engineer; switching it off, operator.").classes("small muted")
            if not made["enabled"]:
                ui.label(
                    "First test that the plant switches compensation off if glapp stops. Nothing is enabled before "
                    "that was seen."
                ).classes("small muted")
            log = await asyncio.to_thread(self.read, lambda r: r.commands(self.name, 200))
            log = [row for row in log if row["command"] in ("enable", "disable", "drill", "drilled", "take_over")]
            heading("Who did what, when", 2)
            self._log(log, lambda row: f"refused: {row['refused']}" if row["refused"] else "")

    async def _in_force(self, made: dict[str, Any], ti: float) -> None:
        unit = self.op_unit
        ui.label(TOLD[made["standing"]]).style("font-weight: 600")
        if made["over"]:
            ui.label("Warning: the loop swings as if too much was compensated.").classes("high")
        ui.label(
            f"u_FF is {quantity(made['u_ff'], unit)}. The width it goes by is {quantity(made['size'], unit)}; it moves "
            f"by {quantity(made['delta'], unit)} from side to side. {quantity(made['left'], unit)} of the gap is left."
        )
        events = await asyncio.to_thread(self.read, lambda r: r.events(self.name, 500))
        begun = next((row["time"] for row in events if row["kind"] == "enabled"), None)
        if begun is None:
            return
        now = time.time()
        least = CALM_AFTER * ti
        span = min(max(now - begun, least), 7 * 86400.0)
        values = await signals(self.station, self.session, self.name, begun - 1.1 * span, now)
        sp, pv, u_ff = (_floats(values[name]) for name in ("SP", "PV", "U_FF"))
        found = calm(values["time"], sp, pv, u_ff, begun, least)
        if found is None:
            wait = f"that takes {duration(least)} before u_FF moved, and as long since"
            ui.label(f"It is too early to say whether PV is calmer: {wait}.").classes("muted")
            return
        ui.label(
            f"PV is {found.word}: in the {duration(found.seconds)} since u_FF moves it is within "
            f"{quantity(found.since, self.pv_unit)} of SP half of the time; before, within "
            f"{quantity(found.before, self.pv_unit)}."
        )


def _floats(values: list[Any]) -> list[float]:
    return [math.nan if value is None else value for value in values]


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
