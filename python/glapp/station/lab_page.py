"""The laboratory's page: a simulated loop that runs, its blocks, its variables, and a form to put another together."""

from __future__ import annotations

import asyncio
import json
import time
from dataclasses import replace
from typing import Any

from nicegui import ui
from starlette.requests import Request

from ..errors import InputError
from ..report.words import count, number
from . import charts
from .lab import FASTEST, KINDS, THESIS, Lab, Part, Project, diagram
from .number_field import NumberField, typed_number
from .pages import ONE_STOP, Station, dialog_of, frame, heading, quiet

__all__ = ["Bench", "lab_page"]

TICK = 0.02
"""The laboratories go on so often [s]."""

LEFT = 60.0
"""A laboratory at which nobody looks stands still after this time [s]."""

MOST = 20
"""Largest number of laboratories in a window; the one that was left longest ago goes first."""

BEGUN = 1000.0
"""Simulated time of the first loop when its page opens [s]."""

WINDOWS = {60: "1 min", 600: "10 min", 3600: "1 h"}


def _begun() -> Lab:
    """A laboratory of the first loop that has run for a while."""
    lab = Lab(THESIS)
    lab.speed = BEGUN
    lab.advance(1.0)
    lab.speed = 1.0
    return lab


class Bench:
    """The laboratories of all who are logged in, one each."""

    def __init__(self) -> None:
        self._labs: dict[str, tuple[Lab, float]] = {}

    def of(self, id: str) -> Lab:
        """The laboratory of a session; begun with the loop of 6.5, after `BEGUN` s, so that there is an estimate."""
        lab = self._labs[id][0] if id in self._labs else _begun()
        self.put(id, lab)
        return lab

    def put(self, id: str, lab: Lab) -> None:
        """Keep the laboratory of a session as the one used last; too many drop the one unused for longest."""
        self._labs[id] = (lab, time.monotonic())
        while len(self._labs) > MOST:
            del self._labs[min(self._labs, key=lambda one: self._labs[one][1])]

    async def go_on(self) -> None:
        """Run all of them, until cancelled."""
        last = time.monotonic()
        while True:
            await asyncio.sleep(TICK)
            now = time.monotonic()
            for lab, looked in list(self._labs.values()):
                if now - looked < LEFT:
                    lab.advance(now - last)
            last = now


def lab_page(station: Station, bench: Bench, request: Request) -> None:
    """A simulated loop: nothing here has a way to a plant."""
    session = station.who(request)
    with frame(station, session, "Laboratory", "/laboratory"):
        _Page(bench, session.id, session.dark).build()


class _Page:
    def __init__(self, bench: Bench, id: str, dark: bool) -> None:
        self.bench, self.id, self.dark = bench, id, dark
        self.lab = bench.of(id)
        self.window = 600
        self.sent: dict[str, Any] = {}

    def build(self) -> None:
        """Build the page."""
        with ui.element("div").classes("bar"):
            heading("Laboratory")
            ui.label("SIMULATION: no plant, no service").classes("mark")
            self.state = ui.label().classes("muted grow").props('role="status"')
        with ui.element("div").classes("bar"):
            self.run = ui.button("Pause", on_click=self._pause).props("no-caps unelevated color=primary")
            speed = self.speed = NumberField(
                "Speed [×]", self.lab.speed, name="Speed", width=120, on_change=self._speed
            )
            for x in (1, 10, 100, 1000):
                quiet(f"{x} ×", lambda _, x=x: speed.show(x)).tooltip(
                    "As fast as the clock" if x == 1 else f"{x} times as fast as the clock"
                )
            quiet("Start again at t = 0", lambda: self._built(self.lab.project))
            quiet("Load the thesis’ loop", lambda: self._built(THESIS)).tooltip("Figure 6.5, with a gap of 2.0 %")
            quiet("Build another loop", self._form)
        with ui.element("div").classes("lab"):
            with ui.element("div").classes("card").style("overflow-x: auto"):
                self.blocks = ui.html(diagram(self.lab.project), sanitize=False)
            with ui.element("div").classes("card stack"):
                heading("Estimate of the gap", 2)
                with ui.element("div").classes("bar"):
                    self.estimate = ui.label().classes("one").props('role="status"')
                    self.true = ui.label().classes("muted")
                self.from_ = ui.label().classes("small muted")
                self.on = ui.button("Compensate", on_click=self._compensate).props("no-caps unelevated color=primary")
                self.standing = ui.label().classes("small")
        with ui.element("div").classes("lab"):
            with ui.element("div").classes("card"):
                with ui.element("div").classes("bar"):
                    heading("Signals", 2)
                    ui.element("span").classes("grow")
                    ui.toggle(WINDOWS, value=self.window, on_change=lambda e: setattr(self, "window", e.value)).props(
                        "no-caps dense unelevated"
                    )
                self.chosen = ui.select(
                    self._labels(),
                    value=list(self.lab.shown),
                    multiple=True,
                    label="drawn",
                    on_change=self._chosen,
                ).props("dense outlined use-chips")
                self.chart = ui.echart(charts.lab(self._drawn(), dark=self.dark)).classes("chart")
            with ui.element("div").classes("card"):
                with ui.element("div").classes("bar"):
                    heading("Variables", 2)
                    search = ui.input(placeholder="Search").props('dense outlined clearable aria-label="Search"')
                self.grid = ui.aggrid(
                    {
                        "columnDefs": [
                            {"field": "path", "headerName": "Variable", "flex": 1, "minWidth": 150},
                            {
                                "field": "value",
                                "headerName": "Value",
                                "width": 130,
                                ":editable": "p => p.data.editable",
                                ":cellClass": "p => p.data.editable ? 'editable' : ''",
                            },
                        ],
                        "rowData": self._rows(),
                        ":getRowId": "p => p.data.path",
                        "rowHeight": 30,
                        "singleClickEdit": True,
                        "animateRows": False,
                        "stopEditingWhenCellsLoseFocus": True,
                        **ONE_STOP,
                    },
                    auto_size_columns=False,
                ).classes("grid short")
                self.grid.on("cellValueChanged", self._edited)
                ui.label("Underlined values can be changed while it runs.").classes("small muted")
                search.on_value_change(
                    lambda: self.grid.run_grid_method("setGridOption", "quickFilterText", search.value or "")
                )
        ui.timer(0.5, self._tick)

    def _rows(self) -> list[dict[str, Any]]:
        """Rows of the table of values."""
        return [
            {"path": path, "value": self._value(path), "editable": path in self.lab.editable} for path in self.lab.paths
        ]

    def _value(self, path: str) -> str:
        value = self.lab[path]
        return number(None if value is not None and abs(value) > 1e300 else value, 5)  # as good as no limit

    def _tick(self) -> None:
        """Draw the present state."""
        if self.bench.of(self.id) is not self.lab:  # another tab has put another loop together
            self._show(self.bench.of(self.id))
        lab = self.lab
        self.run.set_text("Pause" if lab.running else "Run")
        late = f"; {lab.late:.0f} s could not be kept up with" if lab.late else ""
        self.state.set_text(f"t = {lab.t:.1f} s at {lab.speed:g} ×{late}")
        self._detected()
        series = [{"name": name, "data": points} for name, points in self._drawn().items()]
        ui.run_javascript(f"getElement({self.chart.id})?.chart?.setOption({json.dumps({'series': series})})")
        rows = {row["path"]: row for row in self._rows()}
        changes = [row for path, row in rows.items() if self.sent.get(path) != row]
        self.sent = rows
        if changes:
            self.grid.run_grid_method("applyTransaction", {"update": changes})

    def _labels(self) -> dict[str, str]:
        """Labels of the signals by their names; where they differ the name stands beside."""
        return {
            name: name if self.lab.label(name) == name else f"{self.lab.label(name)} ({name})"
            for name in self.lab.signals
        }

    def _drawn(self) -> dict[str, list[list[float]]]:
        """Points of each curve of the window, by its label."""
        return {self.lab.label(name): points for name, points in self.lab.curves(self.window).items()}

    def _detected(self) -> None:
        """Show the estimate of the detector, the true gap, and the state of the compensation."""
        lab, name = self.lab, self.lab.detector
        true = lab.gap
        self.true.set_text("" if true is None else f"true: {number(true)} %")
        self.on.set_visibility(name is not None)
        if name is None:
            self.estimate.set_text("–")
            self.from_.set_text("This loop has no detector.")
            self.standing.set_text("")
            return
        found, of = lab[f"{name}.d_hat"], int(lab[f"{name}.count"] or 0)
        self.estimate.set_text("–" if found is None else f"{number(found)} %")
        self.from_.set_text(
            f"Median and mean of the last {count(of, 'detection')}." if of else "No detection yet: run it faster."
        )
        wanted, u_ff = bool(lab[f"{name}.compensate"]), lab[f"{name}.u_ff"] or 0.0
        self.on.set_text("Switch the compensation off" if wanted else "Compensate")
        size = lab[f"{name}.comp_size"] or 0.0
        if not wanted:
            text = f"It would go by the typed width, comp_size = {number(size)}\N{NO-BREAK SPACE}%."
        else:
            left = lab[f"{name}.left"]
            text = f"It goes by {number(lab[f'{name}.size'] or 0.0)} %; u_FF is {number(u_ff)} %"
            text += "." if left is None else f", and {number(left)} % of the gap is left."
        self.standing.set_text(text)

    def _compensate(self) -> None:
        name = self.lab.detector
        if name is None:
            return
        path = f"{name}.compensate"
        try:
            self.lab[path] = 0.0 if self.lab[path] else 1.0
        except (InputError, TypeError) as error:
            ui.notify(f"{path}: {error}", type="warning", multi_line=True)
        self._detected()

    def _pause(self) -> None:
        self.lab.running = not self.lab.running

    def _speed(self) -> None:
        """Run as fast as was typed; until that is a number, as before."""
        if not self.speed.fault and (typed := self.speed.number) is not None:
            self.lab.speed = min(max(typed, 0.1), FASTEST)

    def _chosen(self, event: Any) -> None:
        self.lab.shown = tuple(event.value)
        self._draw_anew()

    def _draw_anew(self) -> None:
        self.chart.options.clear()
        self.chart.options.update(charts.lab(self._drawn(), dark=self.dark))
        self.chart.update()

    def _edited(self, event: Any) -> None:
        """Set a value that was typed into the table."""
        path, text = event.args["data"]["path"], event.args["newValue"]
        try:
            self.lab[path] = None if text == "–" else typed_number(text)
        except (InputError, TypeError) as error:
            ui.notify(f"{path}: {error}", type="warning", multi_line=True)
        self.sent.pop(path, None)

    def _built(self, project: Project) -> bool:
        """Begin a project; the speed stays."""
        try:
            made = Lab(project)
        except InputError as error:
            ui.notify(str(error), type="warning", timeout=0, close_button="Close", multi_line=True)
            return False
        made.speed = self.lab.speed
        self.bench.put(self.id, made)
        self._show(made)
        return True

    def _show(self, lab: Lab) -> None:
        """Show another laboratory."""
        self.lab = lab
        self.blocks.set_content(diagram(lab.project))
        self.chosen.set_options(self._labels(), value=list(lab.shown))
        self.sent = {}
        self.grid.run_grid_method("setGridOption", "rowData", self._rows())
        self._draw_anew()

    def _form(self) -> None:
        """A loop put together from modules by name."""
        project = self.lab.project
        parts = list(project.parts)
        with dialog_of("A loop from modules") as dialog:
            scan = NumberField("scan time [s]", project.h, name="scan time", width=160)
            rows = ui.element("div")

            def listed() -> None:
                """Show the list of modules again."""
                rows.clear()
                with rows:
                    for i, part in enumerate(parts):
                        with ui.element("div").classes("bar"):
                            ui.input("name", value=part.name, on_change=lambda e, i=i: put(i, name=e.value)).props(
                                "dense outlined"
                            ).style("width: 120px")
                            ui.select(
                                list(KINDS),
                                value=part.kind,
                                label="module",
                                on_change=lambda e, i=i: put(i, kind=e.value),
                            ).props("dense outlined").style("width: 190px")
                            ui.input(
                                "parameters", value=part.settings, on_change=lambda e, i=i: put(i, settings=e.value)
                            ).props("dense outlined").classes("grow")
                            quiet("Remove", lambda _, i=i: remove(i), flat=True)

            def put(i: int, **more: str) -> None:
                parts[i] = replace(parts[i], **more)

            def remove(i: int) -> None:
                del parts[i]
                listed()

            def add() -> None:
                parts.append(Part(f"new{len(parts)}", "Filter2P", "tf=1"))
                listed()

            listed()
            quiet("Add a module", add).style("align-self: start")
            wires = ui.textarea("wires, one a line: from output to input", value="\n".join(project.wires))
            wires.props("outlined autogrow")

            def build() -> None:
                lines = tuple(line.strip() for line in (wires.value or "").splitlines() if line.strip())
                if not scan.fault and self._built(
                    Project(scan.number or 0.0, tuple(parts), lines, project.shown, project.called)
                ):
                    dialog.close()

            ui.button("Build", on_click=build).props("no-caps unelevated color=primary").style("align-self: start")
