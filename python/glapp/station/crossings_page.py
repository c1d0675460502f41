"""The zero crossings on the page of a loop: a footnote to the answer, or all there is before the first one."""

from __future__ import annotations

import math
import time
from contextlib import suppress

from nicegui import events, ui

from ..errors import InputError
from ..report.words import METHODS, NAMES, count, number, sentence
from . import charts
from .one_loop import OneLoop
from .pages import heading
from .signals_page import SignalCards

__all__ = ["CrossingsCard"]

REASON_DAYS = 7

COUNTED_EVERY = 10.0
"""The reasons of a week are counted anew after this time at the earliest [s]."""


class CrossingsCard:
    """Card with the estimate by zero crossings and the reasons of the half-periods.

    - `stale`: whether half-periods came since the reasons were counted.
    """

    def __init__(self, loop: OneLoop, signals: SignalCards) -> None:
        self.loop, self.signals = loop, signals
        self.stale, self.counted = True, -math.inf

    def build(self) -> None:
        """Build the card."""
        self.signals.shaded = alone = self.loop.answer is None
        with ui.element("details").classes("card").props("open" if alone else "") as fold:
            with ui.element("summary"):
                heading("Zero crossings: what a PLC would show", 2)
                self.plc = ui.label().classes("small muted")
            ui.label(METHODS["Zero crossings: what a PLC would show"][0]).classes("small")
            self.signals.half = ui.label().classes("small half")
            heading(f"Half-periods of the last {REASON_DAYS} days", 3)
            self.reasons = ui.element("div")
        fold.on("toggle", self._folded, js_handler="(e) => emit(e.target.open)")

    async def _folded(self, event: events.GenericEventArguments) -> None:
        """Half-periods are shaded while their heading is open."""
        self.signals.shaded = bool(event.args)
        with suppress(InputError):
            await self.signals.shade()

    def show(self) -> None:
        """Show the estimate."""
        loop, status = self.loop, self.loop.status
        estimate = loop.view.percent(loop.name, status.get("estimate"))
        shown = status.get("estimate") if estimate is None else estimate
        unit = loop.op_unit if estimate is None else "%"
        width = "no width" if shown is None else f"≈ {number(shown)} {unit}"
        self.plc.set_text(
            f"{width}, of {count(status.get('detections', 0), 'detection')}; "
            f"{count(status.get('half_periods', 0), 'half-period')} so far"
        )

    async def recount(self) -> None:
        """Count the reasons anew where half-periods came, not too often."""
        if self.stale and time.monotonic() - self.counted > COUNTED_EVERY:
            self.counted, self.stale = time.monotonic(), False
            await self._count()

    async def why_none(self) -> str:
        """Sentence that explains why there is no detection."""
        reasons = charts.reasons(await self._counts())
        counts = {meaning: n for label, n, meaning, _ in reasons if label and label != "accepted"}
        if not counts:
            return "No detection: PV has not crossed SP and come back yet."
        usual = max(counts, key=lambda meaning: counts[meaning])
        return f"No detection: of {sum(counts.values())} half-periods none passed, most often because {usual}."

    async def _counts(self) -> dict[str, int]:
        begin = self.loop.view.now - REASON_DAYS * 86400.0
        found = await self.loop.read(lambda reader: reader.reason_counts(self.loop.name, begin))
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
            with ui.element("table").classes("plain reasons"), ui.element("tbody"):
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
