"""Proof of a gap on a loop's page: the test that would decide, the guided test, before and after the repair."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from datetime import datetime
from typing import Any

from nicegui import ui

from ..errors import InputError
from ..planned import OPEN, Plan
from ..report import planned, repaired
from ..report.words import number, quantity
from ..service import repairs
from ..service.guide import Asked, result_text
from ..service.plans import LONGEST
from .number_field import NumberField
from .pages import Station, command, described, dialog_of, heading, moment, quiet
from .sessions import Session

__all__ = ["ProofCards"]

MINUTES = 60.0

ENDED = {
    "decided": "Decided",
    "over": "All moves made",
    "limit": "Ended at a limit",
    "time": "Time over",
    "automatic": "Ended: back in automatic",
    "stopped": "Stopped",
    "silent": "Ended: no values",
}
"""Texts on the end of a guided test."""

RANGE = 7200.0
"""Beside the limits stands where OP and PV were in so many seconds."""

ReadSignals = Callable[[float, float], Awaitable[dict[str, Any]]]


def waiting_text(asked: float) -> str:
    """Text while a plan is made; `asked`: when it was asked for [s since 1970 UTC].

    >>> waiting_text(0.0).partition("since ")[2][5:]
    '. That takes some minutes; it is given up after 10 min.'
    """
    longest = LONGEST / 60.0
    return f"Being planned since {moment(asked)[11:16]}. That takes some minutes; it is given up after {longest:g} min."


class ProofCards:
    """The cards of one loop.

    - `station`: what the pages stand on.
    - `signals`: samples from when to when [s since 1970 UTC].
    """

    def __init__(self, station: Station, session: Session, loop: str, signals: ReadSignals) -> None:
        self.station, self.session, self.loop, self._signals = station, session, loop, signals
        known = station.view.loops[loop]
        self.op_unit, self.pv_unit = known.op_label, known.pv_unit or ""
        self._shown: dict[str, Any] = {}

    def build(self, top: ui.element) -> None:
        """The cards, empty; `refresh` fills them.

        - `top`: where the guided test is as long as it goes on, next to the signals.
        """
        self.top, self.below = top, ui.element("div").style("display: contents")
        self._place = self.below
        with self.below:
            self.guided = ui.element("div").classes("card guided").props('role="status"')
        self.plan = ui.element("div").classes("card")
        self.repair = ui.element("div").classes("card")
        for card in (self.guided, self.plan, self.repair):
            card.set_visibility(False)
        # A card that is filled anew takes along what was opened in it.
        self.dialogs = ui.element("div").style("display: contents")

    async def refresh(self) -> None:
        """Show the database's present state of them; unchanged parts stay."""
        with suppress(InputError):  # the frame tells it
            plan, test, noted = await asyncio.to_thread(
                self.station.view.read,
                lambda r: (r.plan(self.loop), r.guided_test(self.loop), r.repairs(self.loop)),
            )
            goes_on = test is not None and test["ended"] is None
            place = self.top if goes_on else self.below
            if place is not self._place:
                self.guided.move(place)
                self._place = place
            self._show("guided", self.guided, (test, self._left(test)), self._guided)
            self._show("plan", self.plan, (plan, goes_on, self._confidence()), self._planned)
            self._show("repair", self.repair, (noted, self._fall()), self._repaired)

    def _show(self, name: str, card: ui.element, what: Any, fill: Callable[..., bool]) -> None:
        """Fill a card again where its content has changed."""
        if name in self._shown and self._shown[name] == what:
            return
        self._shown[name] = what
        card.clear()
        with card:
            card.set_visibility(fill(*what))

    def _confidence(self) -> str | None:
        answer = self.station.view.answer(self.loop)
        return None if answer is None else answer["confidence"]

    def _may(self, button: ui.button) -> ui.button:
        """A button, disabled for persons below operator."""
        if not self.session.may("operator"):
            button.props("disable").tooltip("needs the role operator")
        return button

    async def _go(self, what: str, body: Any, done: str) -> bool:
        """Send a command, and show its result."""
        found = await command(self.station, self.session, self.loop, what, body, done)
        await self.refresh()
        return found

    # The test that would decide

    def _planned(self, row: dict[str, Any] | None, goes_on: bool, confidence: str | None) -> bool:
        """Show the plan of a test; whether there is one to show."""
        if confidence not in OPEN and row is None:
            return False
        heading("Which test would decide", 2)
        waits = row is not None and row["plan"] is None and row["refused"] is None
        if row is None:
            ui.label("Type how far OP and PV may go. The loop is then simulated with the gap and without it.")
        elif waits:
            ui.label(waiting_text(row["time"])).classes("medium")
        elif row["refused"] is not None:
            ui.label(f"No test can be planned: {row['refused']}.").classes("medium")
        else:
            plan = Plan.of(row["plan"])
            with ui.element("dl").classes("facts small"):
                described(planned.rows(plan))
            ui.label(f"Planned {moment(row['time'])[:16]}, {row['person']}.").classes("small muted")
        with ui.element("div").classes("bar").style("margin-top: 8px"):
            if not waits:  # a second one would be refused
                self._may(quiet("Plan a test" if row is None else "Plan anew", self._ask))
            stored = None if row is None else row["plan"]
            if stored is not None and Plan.of(stored).by_hand is not None and not goes_on:
                begin = ui.button("Begin the guided test", on_click=self._begin)
                self._may(begin.props("no-caps unelevated color=primary"))
        return True

    async def _ask(self) -> None:
        """The limits of the test, typed by the person."""
        end = self.station.view.now
        values = await self._signals(end - RANGE, end)
        last = self._shown["plan"][0]
        asked = None if last is None else last["asked"]
        fields: dict[str, tuple[NumberField, NumberField]] = {}
        with self.dialogs, dialog_of(f"{self.loop}: plan a test") as dialog:
            ui.label(
                "How far OP and PV may go. A planned test stays within these limits in every simulation. Stop it where "
                "PV reaches one all the same."
            ).classes("small muted")
            for name, text, unit, column in (
                ("op_within", "OP", self.op_unit, "OP"),
                ("pv_within", "PV", self.pv_unit, "PV"),
            ):
                known = [x for x in values[column] if x is not None]
                was = f"In the last 2 h it was {number(min(known), 4)} to {number(max(known), 4)}." if known else ""
                low, high = (None, None) if asked is None else asked[name]
                with ui.element("div").classes("bar"):
                    fields[name] = tuple(  # type: ignore[assignment]  # two of them
                        NumberField(
                            f"{text} {end} [{unit}]" if unit else f"{text} {end}",
                            value,
                            name=f"{text} {end}",
                            width=150,
                        )
                        for end, value in (("from", low), ("to", high))
                    )
                    ui.label(was).classes("small muted")
            longest = MINUTES if asked is None else asked["minutes"]
            minutes = NumberField("Longest test [min]", longest, name="Longest test", width=150)

            async def go() -> None:
                try:
                    body = {name: [one.number for one in pair] for name, pair in fields.items()}
                    wanted = {**body, "minutes": minutes.number}
                except InputError as error:
                    ui.notify(str(error), type="warning")
                    return
                if any(x is None for pair in body.values() for x in pair) or not wanted["minutes"]:
                    ui.notify("Type all four limits and the longest time.", type="warning")
                    return
                if await self._go("plan", wanted, f"A test of {self.loop} is being planned."):
                    dialog.close()

            ui.button("Plan the test", on_click=go).props("no-caps unelevated color=primary").style("align-self: start")

    async def _begin(self) -> None:
        if await self._go("guided-test", {}, "The test has begun: put the controller in manual."):
            # To its card, next to the signals; the button that was pressed is gone by now, and with it its place.
            self.guided.client.run_javascript("window.scrollTo(0, 0)")

    # The guided test

    def _left(self, test: dict[str, Any] | None) -> int | None:
        """Seconds that a hold lasts still."""
        until = None if test is None or test["ended"] is not None else test["state"]["until"]
        return None if until is None else max(0, round(until - self.station.view.now))

    def _guided(self, test: dict[str, Any] | None, left: int | None) -> bool:
        """Show the running or last guided test."""
        if test is None:
            return False
        state, asked = test["state"], Asked.of(test["asked"])
        on = test["ended"] is None
        heading("Guided step test" if on else f"Guided step test: {ENDED[state['outcome']].lower()}", 2)
        ui.label(state["text"]).classes("say" if on else "")
        if left is not None:
            ui.label(f"{left // 60}:{left % 60:02d} min left.").classes("small muted")
        if state["levels"] and on:
            with ui.element("ol").classes("moves"):
                for i, level in enumerate(state["levels"]):
                    kind = "done" if i < state["move"] else "now" if i == state["move"] else "muted"
                    with ui.element("li").classes(kind) as item:
                        ui.label(quantity(level, self.op_unit, 4))
                    if i == state["move"]:
                        item.props('aria-current="step"')
        if not on or state["d"] is not None:
            text = result_text(state, asked, self.op_unit)
            if on:
                between = f"{number(state['low'])} to {number(state['high'])}"
                text = f"So far {quantity(state['d'], self.op_unit)} (95 %: {between})."
            ui.label(text).style("" if on else "font-weight: 600")
        if on:
            self._may(quiet("Stop the test", self._stop)).style("margin-top: 8px")
        else:
            ui.label(f"{moment(test['begun'])[:16]} to {moment(test['ended'])[11:16]}, {test['person']}.").classes(
                "small muted"
            )
        return True

    async def _stop(self) -> None:
        await self._go("guided-test-stop", {}, "The test is stopped.")

    # The repair

    def _fall(self) -> dict[str, Any] | None:
        """A fall of the width in the loop's answer; None where there is none."""
        believed = self.station.view.believed(self.loop)
        return None if believed is None else repairs.fall_of(believed["recordings"])

    def _repaired(self, noted: list[dict[str, Any]], fall: dict[str, Any] | None) -> bool:
        """Show repairs, and a fall of the width that nobody noted."""
        heading("Repair of the valve", 2)
        if fall is not None and not any(fall["t"][0] <= row["time"] <= fall["t"][1] + 86400.0 for row in noted):
            both = (fall["before"], fall["after"])
            before, after = (f"{quantity(d, self.op_unit)} ({number(low)} to {number(high)})" for d, low, high in both)
            ui.label(
                f"The gap fell from {before} to {after} between {moment(fall['t'][0])[:10]} and "
                f"{moment(fall['t'][1])[:10]}. "
                "Was the valve repaired? Then note it: its answer will be that of the days since."
            ).classes("medium")
        for row in noted[:3]:
            note = f": {row['note']}" if row["note"] else ""
            ui.label(f"{moment(row['time'])[:16]}, noted by {row['person']}{note}")
        if not noted and fall is None:
            ui.label("No repair is noted.").classes("muted")
        with ui.element("div").classes("bar").style("margin-top: 8px"):
            self._may(quiet("Note a repair", self._note))
            if noted:
                quiet("Before and after", lambda: self._compare(noted[0]))
        return True

    async def _note(self) -> None:
        """Dialog to note a repair."""
        with self.dialogs, dialog_of(f"{self.loop}: note a repair") as dialog:
            ui.label("From then on the loop is judged by what was recorded after the repair.").classes("small muted")
            now = datetime.fromtimestamp(self.station.view.now)
            at = ui.input("When", value=now.strftime("%Y-%m-%d %H:%M"))
            at.props('dense outlined aria-label="When"').style("width: 220px")
            note = ui.input("What was done").props('dense outlined maxlength=500 aria-label="What was done"')
            note.style("width: 100%; max-width: 420px")

            async def go() -> None:
                """Note the repair with the time and the text of the dialog."""
                try:
                    moment_of = datetime.strptime(at.value.strip(), "%Y-%m-%d %H:%M").timestamp()
                except ValueError:
                    ui.notify("Write the time as 2026-11-25 14:30.", type="warning")
                    return
                if await self._go("repaired", {"time": moment_of, "note": note.value or ""}, "Noted."):
                    dialog.close()

            ui.button("Note it", on_click=go).props("no-caps unelevated color=primary").style("align-self: start")

    async def _compare(self, row: dict[str, Any]) -> None:
        """Dialog of a loop before and after a repair."""
        view = self.station.view
        settings = view.loops[self.loop].model_dump_json(exclude_unset=True)
        with self.dialogs, dialog_of(f"{self.loop}: before and after the repair of {moment(row['time'])[:10]}"):
            waiting = ui.label("Reading what was recorded.").classes("muted")
            body = ui.element("div")
            try:
                found = await asyncio.to_thread(repairs.compared, view.folder, settings, row["time"], time.time())
            except InputError as error:
                waiting.set_text(str(error))
                return
            waiting.delete()
            with body:
                with ui.element("table").classes("plain"):
                    with ui.element("thead"), ui.element("tr"):
                        for text in ("", "before", "after", "difference"):
                            with ui.element("th"):
                                ui.label(text)
                    with ui.element("tbody"):
                        for line in repaired.rows(found, self.op_unit, self.pv_unit):
                            with ui.element("tr"):
                                for text in line:
                                    with ui.element("td"):
                                        ui.label(text)
                ui.label(repaired.NOTE).classes("small muted").style("margin-top: 8px")
