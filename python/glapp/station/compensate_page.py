"""The dialog of a loop's compensation: its width, its effect before and after, and the test of switching off."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from ..report.words import duration, quantity
from ..service.compensation import TEXT_OF_STATE
from ..service.settable import usual_of
from ..service.watchdog import WATCHDOG_SEEN
from . import charts
from .client import loop_path
from .compensate import calm, plan, why_off
from .number_field import NumberField
from .pages import Station, command, heading, moment, quiet
from .parameters import field
from .sessions import Session

__all__ = ["CALM_AFTER", "CompensationPage"]

CALM_AFTER = 20.0
"""Number of Ti before and since that the comparison needs."""

AGAIN = 3.0
"""Interval of updates of running parts [s]."""

ReadSignals = Callable[[float, float], Awaitable[dict[str, Any]]]
Ask = Callable[[str], Awaitable[Any]]


class CompensationPage:
    """Content of the dialog, built anew after each command.

    - `station`: what the pages stand on.
    - `ask`: something from the API, by its path; None where it does not say.
    - `signals`: samples from when to when [s since 1970 UTC].
    """

    def __init__(self, station: Station, session: Session, loop: str, ask: Ask, signals: ReadSignals) -> None:
        self.station, self.session, self.loop = station, session, loop
        self._ask, self._signals = ask, signals
        known = station.view.loops[loop]
        self.pv_unit, self.op_unit = known.pv_unit or "", known.op_label
        self._engineer, self._operator = session.may("engineer"), session.may("operator")

    async def known(self) -> tuple[dict[str, Any], dict[str, Any]] | None:
        """Parameters and status of the loop; None where the API does not say."""
        seen = await self._ask(loop_path(self.loop, "parameters"))
        status = None if seen is None else await self._ask("/status")
        return None if seen is None or status is None else (seen, status["loops"][self.loop])

    async def build(self, seen: dict[str, Any], status: dict[str, Any]) -> None:
        """All of it, in the dialog that is open."""
        self.body, self.log = ui.element("div").classes("stack"), ui.element("div")
        self._shown: tuple[Any, ...] = ()
        self._filling = asyncio.Lock()  # a command and the timer may both find that something has changed
        await self._fill(seen, status)
        ui.timer(AGAIN, self._look)

    async def _fill(self, seen: dict[str, Any], status: dict[str, Any]) -> None:
        """Show the present state; unchanged parts stay, so that a click meanwhile finds its button."""
        async with self._filling:
            made = status.get("compensation")
            settings = await asyncio.to_thread(self.station.view.read, lambda r: r.settings(self.loop))
            shown = (seen, settings, made, status["answer"], status["estimate"])
            if shown != self._shown:
                again, self._shown = bool(self._shown), shown
                await self._fill_body(seen, status, settings)
                if again:
                    self.body.client.run_javascript(f"glapp.refocus({self.body.id})")
            if made is not None:
                await self._show_log()

    async def _fill_body(self, seen: dict[str, Any], status: dict[str, Any], settings: dict[str, Any]) -> None:
        """Fill the dialog with settings and state."""
        made = status.get("compensation")
        self._seen, self._status, self._enabled = seen, status, bool(made and made["enabled"])
        self._tested, self._set, self._choosing = settings.get(WATCHDOG_SEEN), settings, False
        self.body.clear()
        with self.body:
            if made is None:
                ui.label(plan(seen, self.op_unit).why_not or "This loop has no node for u_FF.")
            elif made["enabled"]:
                await self._in_force(made)
            else:
                ui.label(why_off(made))
                self._offered()

    async def _anew(self) -> None:
        """Fill the dialog again."""
        if (known := await self.known()) is not None:
            await self._fill(*known)

    async def _go(self, what: str, body: dict[str, Any], message: str) -> bool:
        """Send a command; in any case the dialog shows the state afterwards."""
        return await command(self.station, self.session, self.loop, what, body, message)

    async def _look(self) -> None:
        """Update what changes by itself or by somebody else; a width that is being chosen here stays."""
        status = self.station.view.shown["loops"].get(self.loop, {})
        made = status.get("compensation")
        settings = await asyncio.to_thread(self.station.view.read, lambda r: r.settings(self.loop))
        changed = settings != self._set and not self._choosing
        if changed or settings.get(WATCHDOG_SEEN) != self._tested or bool(made and made["enabled"]) != self._enabled:
            await self._anew()
        elif self._enabled:
            await self._effect()

    # Before it is enabled

    def _offered(self) -> None:
        """Show the widths that can be chosen."""
        unit, seen, status = self.op_unit, self._seen, self._status
        last = status["answer"]
        self._fit = None if last is None or last["compensable"] is None else last
        fitted = seen["comp_fitted"] if self._fit is None else self._fit["compensable"]
        source = int(seen["comp_source"] or (2 if seen["comp_fitted"] is not None else 1 if seen["comp_size"] else 0))
        if not source and self._fit is not None:
            source = 2  # it is offered; nothing is taken over before that is asked for
        estimate = status["estimate"]
        heading("1. The width of the gap", 2)
        options = {
            2: "fitted: "
            + ("no fit has found one" if fitted is None else f"{quantity(fitted, unit)}, its lower limit"),
            1: "typed",
            3: "by zero crossings: " + ("none yet" if estimate is None else f"{quantity(estimate, unit)} now"),
        }
        with ui.element("div").classes("bar"):
            self.source = ui.radio(options, value=source or None, on_change=self._chosen).props("dense")
            self.size = NumberField(
                f"typed width [{unit}]", field(seen["comp_size"]), name="typed width", width=170, on_change=self._typed
            )
            self.use = quiet("Use this width", self._use)
        heading("2. What it will do", 2)
        self.lines = ui.element("ul")
        self.why_not = ui.label()
        heading("3. Test that the plant switches it off if glapp stops", 2)
        with ui.element("div").classes("bar"):
            test = quiet("Test switching off", self._test_watchdog)
            test.props("" if self._engineer else "disable")
            done = self._tested
            self.test = ui.label(
                "glapp writes a small u_FF and stops its heartbeat; the plant must take u_FF to 0 by itself."
                if done is None
                else f"✓ Seen {moment(done['time'])}, {done['person']}: the plant took it away in {done['took']:.0f} s."
            ).classes("small")
        heading("4. Enable", 2)
        with ui.element("div").classes("bar"):
            self.on = ui.button(f"Enable compensation of {self.loop}", on_click=self._enable).props(
                "no-caps unelevated color=primary"
            )
            self.not_yet = ui.label().classes("small muted")
        self._describe()

    def _wanted(self) -> dict[str, Any]:
        """The parameters as they would be with the width that is chosen."""
        chosen = dict(self._seen)
        source = self.source.value
        if self._differs():  # what nobody has set goes by the width, too
            tags = self.station.view.loops[self.loop].opcua
            usual = {"comp_band": None, **usual_of((tags.u_ff_limit or 0.0, tags.u_ff_rate or 0.0))}
            chosen |= {name: self._set[name] if self._set.get(name) is not None else x for name, x in usual.items()}
        if source is not None:
            chosen["comp_source"] = float(source)
        chosen["comp_size"] = self._size
        if source == 2 and self._fit is not None:
            chosen["comp_fitted"] = self._fit["compensable"]
        return chosen

    @property
    def _size(self) -> float:
        """The typed width; 0 where there is none, or the text in its field is no number, which stands below it."""
        return 0.0 if self.size.fault else self.size.number or 0.0

    def _differs(self) -> bool:
        """Whether the width that is chosen is another than the one in force."""
        seen, source = self._seen, self.source.value
        in_force = int(seen["comp_source"] or (2 if seen["comp_fitted"] is not None else 1 if seen["comp_size"] else 0))
        if source is None:
            return False
        if source != in_force:
            return True
        if source == 1:
            return bool(self._size != seen["comp_size"])
        return bool(source == 2 and self._fit is not None and self._fit["compensable"] != seen["comp_fitted"])

    def _typed(self) -> None:
        """Take the typed width as the source, and describe its effect."""
        if self.source.value != 1 and self.size.value:
            self.source.set_value(1)
        self._chosen()

    def _chosen(self) -> None:
        """Describe the effect of what was chosen."""
        self._choosing = True
        self._describe()

    def _describe(self) -> None:
        """Describe the effect of the chosen width."""
        chosen, seen = self._wanted(), self._seen
        used = not self._differs()
        found = plan(seen if used else chosen, self.op_unit)
        self.lines.clear()
        with self.lines:
            for line in found.lines:
                with ui.element("li"):
                    ui.label(line)
        self.lines.set_visibility(bool(found.lines))
        why_not = self.size.fault or found.why_not
        self.why_not.set_text(why_not)
        self.use.props(remove="disable")
        if not self._engineer or used or why_not:
            self.use.props("disable")
        why = ""
        if not self._engineer:
            why = "Enabling it needs the role engineer; switching it off, operator."
        elif why_not:
            why = why_not
        elif not used:
            why = "Press “Use this width” first."
        elif self._tested is None:
            why = "First test switching off: nothing is enabled before that was seen."
        self.on.props("disable" if why else "", remove="" if why else "disable")
        self.not_yet.set_text(why)
        self.why_not.set_visibility(bool(why_not))

    async def _use(self) -> None:
        """Take over the fit, or set which width counts: the values that differ from those in force."""
        if self.size.fault:  # the click was under way when that was found
            return None
        seen, wanted = self._seen, self._wanted()
        if self.source.value == 2 and self._fit is not None and seen["comp_fitted"] != self._fit["compensable"]:
            if not await self._go("take_over", {"answer": self._fit["id"], "seen": seen}, "Taken over."):
                return await self._anew()
            if (known := await self.known()) is None:
                return None
            seen = known[0]
        names = [name for name in ("comp_source", "comp_size") if wanted[name] != seen[name]]
        if self.source.value == 2 and seen["comp_source"] is None:
            names = [name for name in names if name != "comp_source"]  # a fit counts by itself where there is one
        if names:
            body = {"values": {name: wanted[name] for name in names}, "seen": {name: seen[name] for name in names}}
            await self._go("parameters", body, f"Set: {', '.join(names)}.")
        await self._anew()

    async def _test_watchdog(self) -> None:
        if await self._go("watchdog-test", {}, "The test is under way: it ends in five minutes at the latest."):
            self.test.set_text("The test is under way. Events tell how it ends.")

    async def _enable(self) -> None:
        await self._go("enable", {"seen": self._seen}, f"{self.loop} is compensated.")
        await self._anew()

    # While it is in force

    async def _in_force(self, made: dict[str, Any]) -> None:
        """Show the running compensation."""
        unit = self.op_unit
        ui.label(TEXT_OF_STATE[made["standing"]]).style("font-weight: 600")
        if made["over"]:
            ui.label("Warning: the loop swings as if too much was compensated.").classes("high")
        ui.label(
            f"The width it goes by is {quantity(made['size'], unit)}; u_FF moves by {quantity(made['delta'], unit)} "
            f"from side to side. {quantity(made['left'], unit)} of the gap is left."
        )
        with ui.element("div").classes("bar"):
            off = ui.button("Switch off", on_click=self._off)
            off.props("no-caps unelevated color=primary" + ("" if self._operator else " disable"))
            if not self._operator:
                ui.label("Switching it off needs the role operator.").classes("small muted")
        self._begun: float | None = None
        heading("Its effect", 2)
        self.calm = ui.label().props('role="status"')
        self.chart = ui.element("div")
        await self._effect()
        with ui.element("details"):
            with ui.element("summary"):
                ui.label("What it does").style("display: inline")
            with ui.element("ul"):
                for line in plan(self._seen, unit).lines:
                    with ui.element("li"):
                        ui.label(line)

    async def _off(self) -> None:
        await self._go("disable", {}, f"{self.loop}: off.")
        await self._anew()

    async def _effect(self) -> None:
        """PV about SP before and since, in words and as a picture."""
        if self._begun is None:  # the service writes the event a moment after it has done the command
            events = await asyncio.to_thread(self.station.view.read, lambda r: r.events(self.loop, 500))
            self._begun = next((row["time"] for row in events if row["kind"] == "enabled"), None)
        if self._begun is None:
            return
        now, least = time.time(), CALM_AFTER * self._seen["ti"]
        span = min(max(now - self._begun, least), 7 * 86400.0)
        values = await self._signals(self._begun - 1.1 * span, now)
        sp, pv, u_ff = ([math.nan if x is None else x for x in values[name]] for name in ("SP", "PV", "U_FF"))
        found = calm(values["time"], sp, pv, u_ff, self._begun, least)
        if found is None:
            left = max(0.0, least - (now - self._begun))
            last = next((x for x in reversed(u_ff) if math.isfinite(x)), 0.0)  # the newest PV may be there before it
            self.calm.set_text(
                f"u_FF is {quantity(last, self.op_unit)}. Whether PV is calmer can be told "
                f"in {duration(left)}: that takes {duration(least)} before it was enabled, and as long since."
            )
        else:
            self.calm.set_text(
                f"PV is {found.word}: in the {duration(found.seconds)} since u_FF moves it is within "
                f"{quantity(found.since, self.pv_unit)} of SP half of the time; before, within "
                f"{quantity(found.before, self.pv_unit)}."
            )
        options = charts.effect(values, self._begun, self.pv_unit, self.op_unit, dark=self.session.dark)
        self.chart.clear()
        with self.chart:
            ui.echart(options).classes("chart low").props('role="img" aria-label="PV about SP, and u_FF"')

    async def _show_log(self) -> None:
        """Show the commands on this compensation."""
        log = await asyncio.to_thread(self.station.view.read, lambda r: r.commands(self.loop, 200))
        log = [row for row in log if row["command"] in ("enable", "disable", "drill", "drilled", "take_over")]
        self.log.clear()
        with self.log, ui.element("details"):
            with ui.element("summary"):
                ui.label(f"Who did what, when ({len(log)})").style("display: inline")
            with ui.element("table").classes("plain"), ui.element("tbody"):
                for row in log[:50]:
                    refused = f"refused: {row['refused']}" if row["refused"] else ""
                    with ui.element("tr"):
                        for cell in (
                            moment(row["time"]),
                            f"{row['person']} ({row['role']})",
                            row["command"],
                            refused,
                        ):
                            with ui.element("td"):
                                ui.label(cell)
