"""The answer on the page of a loop: its one number, the verdict with its reasons, and what to do."""

from __future__ import annotations

from html import escape
from typing import Any

from nicegui import ui

from ..report.words import MEANINGS, count, number
from ..service.options import NIGHT
from .one_loop import OneLoop
from .pages import described, heading, moment

__all__ = ["AnswerCard"]

_LONG = 8
"""Letters of a width beyond which it is set smaller, to stay on one line."""


class AnswerCard:
    """Card with the answer of a loop."""

    def __init__(self, loop: OneLoop) -> None:
        self.loop = loop
        self.answered: int | None = None

    def build(self) -> None:
        """Build the card."""
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

    def show(self) -> None:
        """Show the answer with its interval."""
        loop = self.loop
        view, name, answer, status = loop.view, loop.name, loop.answer, loop.status
        first, _, rest = view.headline(name).partition(" (")
        self.one.set_text(first or view.verdict(name))
        limits = f"95 % interval {rest.rstrip(')')} {loop.unit}" if rest else ""
        if answer is None and first:
            limits = "by zero crossings alone: a load that moves looks like a gap to them"
        elif not rest and answer is not None and (answer["low"], answer["high"]) != (None, None):
            limits = "with 95 % confidence"
        self.interval.set_text(limits)
        self.verdict.set_text(view.verdict(name))
        self.verdict.set_visibility(bool(first))
        urgency = "unjudged" if answer is None else answer["urgency"]
        tone = urgency if urgency in ("high", "medium", "unjudged") else ""
        self.verdict.classes(remove="high medium unjudged").classes(tone)
        kind = "long" if len(first) > _LONG else ""
        self.one.classes(remove="high medium unjudged text long").classes(kind if first else f"text {tone}")
        # An answer that an older version stored has no sentence of its own.
        so = status.get("why", "") if answer is None else answer.get("so") or MEANINGS.get(answer["verdict"], "")
        self.so.set_text(so)
        progress = view.progress(name)
        self.todo.set_text(answer["next"]["text"] if answer is not None else view.todo(name))
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
            described(self._known(answer))

    def _known(self, answer: dict[str, Any] | None) -> list[tuple[str, str]]:
        """Facts next to the answer: area, valve, acceptable limit, days, trend of the width."""
        view, of = self.loop.view, self.loop.name
        loop = view.loops[of]
        rows = [(name, text) for name, text in (("Area", loop.area), ("Valve", loop.valve)) if text]
        believed = view.believed(of)
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
            rows.append(("Recorded", "from " + believed["file"].removeprefix(f"{of} of ") + " UTC"))
        asked_by = "nightly fit" if believed["asked_by"] == NIGHT else f"asked by {believed['asked_by']}"
        rows.append(("Judged", f"{moment(believed['time'])[:16]}, {asked_by}"))
        if (text := view.trend_text(of)) != "–":
            rows.append(("Trend", text))
        return rows
