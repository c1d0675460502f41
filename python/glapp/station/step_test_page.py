"""The dialog of a step test: its next step and its result, as it goes on, later, or from a file."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from nicegui import ui
from nicegui.events import UploadEventArguments

from ..errors import InputError
from ..loop import Loop
from ..reading.files import ENDINGS, FORMS
from ..step_test import StepTest
from . import charts, step_test
from .pages import heading
from .sessions import LARGEST_FILE

__all__ = ["Wizard"]

LARGEST = LARGEST_FILE - 1_000_000
"""Largest file [bytes]; the rest of the request is smaller than the difference."""

_ONE = asyncio.Semaphore(1)
"""One window at a time reads a file: each may take the memory that `glapp.reading.bounds` allows."""

COLUMNS = {"time": "time", "pv": "PV", "op": "OP", "mode": "mode"}
"""Columns that may be named, by their roles."""


@dataclass
class Wizard:
    """A step test of one loop, in a dialog.

    - `loop`: which.
    - `width`: how wide its gap may be, by what is known [OP unit].
    - `windows`: how far back may be looked, and how that is called [s].
    - `window`: how far back is looked at first [s].
    - `signals`: the samples of the last seconds.
    - `dark`: on a dark page.
    """

    loop: Loop
    width: float | None
    windows: Mapping[int, str]
    window: int
    signals: Callable[[float], Awaitable[Mapping[str, Any]]]
    dark: bool

    def __post_init__(self) -> None:
        self._at: int | None = None
        self._seen: StepTest | None = None

    async def build(self) -> None:
        """Everything below the dialog's head."""
        ui.label(
            "You move OP, in manual, at the control system: two steps one way and one back, each held until PV "
            "stands still and as long again. Nothing is written from here."
        ).classes("small muted")
        choice = ui.toggle({"here": "As it goes on", "file": "From a file"}, value="here")
        choice.props("no-caps dense unelevated").style("align-self: start")
        with ui.element("div").bind_visibility_from(choice, "value", value="here"):
            self._here()
        with ui.element("div").bind_visibility_from(choice, "value", value="file"):
            self._file()
        heading("What it tells", 2)
        self.lines = ui.element("div").props('role="status"')
        self.picture = ui.element("div")

        async def look() -> None:
            if choice.value == "here":
                await self._look()

        choice.on_value_change(self._anew)
        choice.on_value_change(look)
        await look()
        ui.timer(5.0, look, immediate=False)

    def _here(self) -> None:
        """Choice of the recorded time to read."""
        with ui.element("div").classes("bar"):
            ui.label("Read it from the last")

            async def chosen(event: Any) -> None:
                self.window = int(event.value)
                await self._look()

            ui.toggle(dict(self.windows), value=self.window, on_change=chosen).props("no-caps dense unelevated")
        heading("What to do next", 2)
        self.steps = ui.element("ol").classes("steps")

    def _file(self) -> None:
        """Choice of a file to read."""
        with ui.element("div").classes("bar"):
            self.columns = {
                role: ui.input(f"column of {text}").props("dense outlined").style("width: 150px")
                for role, text in COLUMNS.items()
            }
            self.manual = ui.checkbox("all of it was made in manual")
        ui.label(
            "Columns are guessed where they are not named. The file is read with the settings of this loop, and kept "
            "nowhere."
        ).classes("small muted")
        ui.upload(
            label=f"A recording: {', '.join(FORMS)}",
            auto_upload=True,
            max_file_size=LARGEST,
            on_upload=self._came,
            on_rejected=lambda: ui.notify(
                f"A recording is {', '.join(list(FORMS)[:-1])} or {list(FORMS)[-1]}, of at most "
                f"{LARGEST // 1_000_000} MB. Its name ends in one of: {', '.join(ENDINGS)}.",
                type="warning",
            ),
        ).props(f'flat bordered accept="{",".join(ENDINGS)}"').style("width: 100%; max-width: 420px")

    def _anew(self) -> None:
        self._at, self._seen = None, None
        self.lines.clear()
        self.picture.clear()

    async def _look(self) -> None:
        """Read the recorded test, and show it."""
        values = await self.signals(self.window)
        found = await asyncio.to_thread(step_test.read, values, self.loop)
        at = step_test.next_step(found, bool(values["MODE"]) and values["MODE"][-1] == "MAN")
        if at != self._at:
            self._at = at
            self.steps.clear()
            with self.steps:
                for i, text in enumerate(step_test.steps(self.width, self.loop.op_label)):
                    with ui.element("li").classes("done" if i < at else "now" if i == at else "muted") as item:
                        ui.label(text)
                    if i == at:
                        item.props('aria-current="step"')
        self._tell(found, "The controller was in automatic all the time.")

    async def _came(self, event: UploadEventArguments) -> None:
        """Read an uploaded file."""
        assert isinstance(event.sender, ui.upload)
        columns = {role: one.value for role, one in self.columns.items()}
        event.sender.reset()  # the same file may come again, with other columns
        try:
            with TemporaryDirectory() as folder:
                path = Path(folder) / Path(event.file.name).name
                await event.file.save(path)
                async with _ONE:
                    found = await asyncio.to_thread(
                        lambda: step_test.read_apart(path, self.loop, columns, manual=bool(self.manual.value))
                    )
        except InputError as error:
            self._anew()
            with self.lines:
                ui.label(str(error)).classes("medium")
            return
        self._tell(found, "")

    def _tell(self, found: StepTest | None, nothing: str) -> None:
        """Show the result of a test, or why there is none."""
        if found is not None and found == self._seen:
            return
        self._seen = found
        self.lines.clear()
        self.picture.clear()
        with self.lines:
            for line in [nothing] if found is None else step_test.lines_of(found, found.unit):
                ui.label(line).classes("muted" if found is None else "")
        options = None if found is None else charts.step_test(found, dark=self.dark)
        if options is not None:
            with self.picture:
                ui.echart(options).classes("chart low").props('role="img" aria-label="PV and OP of the test"')
