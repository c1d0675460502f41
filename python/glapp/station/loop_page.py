"""One loop: its one number, its signals, and a person's commands (6.4)."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

from nicegui import ui
from starlette.requests import Request

from ..errors import InputError
from ..service.compensation import TEXT_OF_STATE
from .answer_page import AnswerCard
from .compensate import why_off
from .compensate_page import CompensationPage
from .crossings_page import CrossingsCard
from .diagrams_page import pv_over_op, width_over_time
from .one_loop import WINDOWS, OneLoop, reporting
from .pages import Station, command, dialog_of, frame, heading, quiet
from .parameters_page import parameters
from .proof_page import ProofCards
from .sessions import Session
from .signals_page import SignalCards
from .step_test_page import Wizard

__all__ = ["loop_page"]


class _Page:
    """Page of one loop for one person."""

    def __init__(self, station: Station, session: Session, name: str) -> None:
        self.loop = loop = OneLoop(station, session, name)
        self.newest: tuple[Any, ...] | None = None
        self.answer, self.signals = AnswerCard(loop), SignalCards(loop)
        self.crossings = CrossingsCard(loop, self.signals)
        self.proof = ProofCards(station, session, name, loop.signals)

    def build(self) -> None:
        """Build the page."""
        with ui.element("div").classes("bar"):
            heading(self.loop.name)
            self.place = ui.label().classes("muted grow")
            ui.link("← Overview", "/")
        with ui.element("div").classes("loop"):
            with ui.element("div"):
                top = ui.element("div").style("display: contents")
                self.answer.build()
                self._buttons()
                self.proof.build(top)
            with ui.element("div"):
                self.signals.build()
                self.crossings.build()

    def _buttons(self) -> None:
        with ui.element("div").classes("card").style("display: grid; grid-template-columns: 1fr 1fr; gap: 8px"):
            self._button("Width over time", lambda: width_over_time(self.loop, self.crossings))
            self._button("PV over OP", lambda: pv_over_op(self.loop))
            self._button("Fit now", self.fit, "operator")
            self._button("Step test", self.step_test)
            self._button("Compensate", self.compensate)
            self._button("Parameters", lambda: parameters(self.loop))

    def _button(self, text: str, what: Callable[[], Awaitable[None]], role: str = "viewer") -> None:
        button = quiet(text, reporting(what))
        if not self.loop.session.may(role):
            button.props("disable").tooltip(f"needs the role {role}")

    def show(self) -> None:
        """Show the state that needs no query."""
        self.answer.show()
        self.crossings.show()
        loop = self.loop.view.loops[self.loop.name]
        self.place.set_text(", ".join(part for part in (loop.area, loop.valve) if part))
        self.signals.compensation.set_text(self._compensation())

    def _compensation(self) -> str:
        """State of the compensation in a sentence; empty where the loop can have none."""
        made = self.loop.status.get("compensation")
        if made is None:
            return ""
        if not made["enabled"]:
            return why_off(made).replace("It", "Compensation", 1)
        if self.loop.view.behind is not None:
            return "Compensation: not known. If the service has ended, the plant's watchdog takes u_FF to 0."
        return f"Compensation: {TEXT_OF_STATE[made['standing']]}"

    async def seldom(self) -> None:
        """Show the database's answer and new half-periods."""
        self.show()
        signals = self.signals
        with suppress(InputError):  # the frame tells it
            newest = await self.loop.read(lambda r: r.half_periods(self.loop.name, accepted=False, most=1))
            mark = tuple(row["number"] for row in newest)
            if mark != self.newest or signals.drawn < 2:
                # A page that is there before the first samples are has nothing to go on from.
                await (signals.draw() if signals.drawn < 2 else signals.shade())
                self.newest, self.crossings.stale = mark, True
            await self.crossings.recount()

    async def step_test(self) -> None:
        """A step test: the next step, and the result so far."""
        loop, answer = self.loop, self.loop.answer
        width = loop.status.get("estimate") if answer is None else (answer["high"] or answer["low"])
        with dialog_of(f"{loop.name}: step test"):
            await Wizard(loop.view.loops[loop.name], width, WINDOWS, loop.window, loop.newest, loop.dark).build()

    async def fit(self) -> None:
        """Have it fitted now."""
        loop = self.loop
        done = f"{loop.name} is fitted as soon as the fit before it is done."
        await command(loop.station, loop.session, loop.name, "fit", {}, done)

    async def compensate(self) -> None:
        """Dialog of the compensation: its plan before, its result after."""
        loop = self.loop
        page = CompensationPage(loop.station, loop.session, loop.name, loop.ask, loop.signals)
        if (known := await page.known()) is not None:
            with dialog_of(f"{loop.name}: compensation"):
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
        # What the service is asked for comes when the page is there, however slow it is.
        ui.timer(0.02, page.signals.often)
        ui.timer(2.0, page.seldom)
        ui.timer(1.0, page.proof.refresh)
