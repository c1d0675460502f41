"""Dialog of a loop's parameters: each with unit, bounds and default, and who changed what, when."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from ..errors import InputError
from ..report.words import sentence
from ..service.settable import Bound
from .client import loop_path
from .number_field import NumberField
from .one_loop import OneLoop
from .pages import command, dialog_of, heading, moment
from .parameters import FIRST, GROUPS, PARAMETERS, allowed, changed, command_text, field

__all__ = ["parameters"]


async def parameters(loop: OneLoop) -> None:
    """All parameters with unit, bound and default; who changed what, when."""
    seen = await loop.ask(loop_path(loop.name, "parameters"))
    bounds = None if seen is None else await loop.ask(loop_path(loop.name, "bounds"))
    if seen is None or bounds is None:
        return
    log = await loop.read(lambda r: r.commands(loop.name, 200))
    log = [row for row in log if row["command"] in ("change", "take_over")]
    may = loop.session.may("engineer")
    fields: dict[str, NumberField] = {}
    with dialog_of(f"{loop.name}: parameters") as dialog:
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
                    fields[name] = NumberField("", field(seen[name]), name=name, width=130)
                    fields[name].props('input-class="text-right"')
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
            try:
                body = changed(seen, {name: one.number for name, one in fields.items()})
            except InputError as error:  # it stands below its field, too, which may be folded
                ui.notify(f"Nothing is changed: {error}", type="warning")
                return
            if not body["values"]:
                ui.notify("Nothing is changed.")
                return
            done = f"Set: {', '.join(body['values'])}."
            if await command(loop.station, loop.session, loop.name, "parameters", body, done):
                dialog.close()

        if may:
            ui.button("Set what is changed", on_click=save).props("no-caps unelevated color=primary").style(
                "align-self: start"
            )
        else:
            ui.label("Changing them needs the role engineer.").classes("small muted")
        heading("Who changed what, when", 2)
        _show_log(log)


def _show_log(rows: list[dict[str, Any]]) -> None:
    """Table of commands with the persons."""
    if not rows:
        ui.label("Nobody yet.").classes("muted")
        return
    with ui.element("table").classes("plain"), ui.element("tbody"):
        for row in rows[:50]:
            with ui.element("tr"):
                for cell in (
                    moment(row["time"]),
                    f"{row['person']} ({row['role']})",
                    row["command"],
                    command_text(row),
                ):
                    with ui.element("td"):
                        ui.label(cell)
