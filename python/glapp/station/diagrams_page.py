"""Diagrams behind the buttons of a loop's page: the width over time, and PV over OP."""

from __future__ import annotations

import json

from nicegui import ui

from ..report.words import quantity
from . import charts
from .crossings_page import CrossingsCard
from .one_loop import WINDOWS, OneLoop
from .pages import dialog_of
from .signals_page import DrawnValve

__all__ = ["pv_over_op", "width_over_time"]


async def width_over_time(loop: OneLoop, crossings: CrossingsCard) -> None:
    """Detections over time, before and under compensation."""
    any_ = await loop.read(lambda r: r.half_periods(loop.name, most=1))
    answers = await loop.read(lambda r: r.answers(loop.name, 400))
    scale = loop.view.percent(loop.name, 1.0)
    believed = loop.view.believed(loop.name)
    alone = [] if believed is None else believed["recordings"]
    with dialog_of(f"{loop.name}: width of the gap over time"):
        options = charts.detections(
            answers,
            loop.unit,
            scale=1.0 if scale is None else scale,
            dark=loop.dark,
            alone=[one for one in alone if one["verdict"] in ("backlash", "both")],
        )
        if not any_ and not answers:
            options = charts.nothing(options, await crossings.why_none(), dark=loop.dark)
        elif not any_ and all(one["d"] is None for one in answers):
            options = charts.nothing(
                options, f"No width yet: the fit gave none. {await crossings.why_none()}", dark=loop.dark
            )
        chart = ui.echart(options).classes("chart").props('role="img" aria-label="Width of the gap over time"')
        ui.run_javascript(f"glapp.detections({chart.id}, {json.dumps(loop.name)})")
        ui.label(
            "A dot is a half-period that passed every test; a triangle is one under compensation, which shows what "
            "is left of the gap. A diamond is a fit, with its 95 % interval."
        ).classes("small muted")


async def pv_over_op(loop: OneLoop) -> None:
    """PV over OP, and the flanks of the gap where one is known."""
    values, width = await loop.newest(), loop.width
    believed = loop.view.believed(loop.name)
    process = None if believed is None else believed["process"]
    seen, title = values["PV"], f"PV [{loop.pv_unit}]" if loop.pv_unit else "PV"
    flanks = None
    if width and process is not None and process["integrating"]:
        valve = DrawnValve(width)  # PV against OP has no shape of its own there
        seen, title = [valve.after(op) for op in values["OP"]], f"{charts.VALVE} [{loop.op_unit}]"
        flanks, why = (width, 1.0), "The process integrates, so that the valve stands over OP, not PV."
    elif width and process is not None and process["kp"][0]:
        flanks, why = (width, process["kp"][0]), "PV stays while OP crosses from one flank to the other."
    elif loop.answer is None:
        why = "No flanks are drawn: the loop is not judged yet."
    else:
        why = f"No flanks are drawn: the answer has no width ({loop.view.verdict(loop.name).lower()})."
    with dialog_of(f"{loop.name}: PV over OP, last {WINDOWS[loop.window]}"):
        options = charts.phase(
            values["OP"], seen, title, loop.op_unit, dark=loop.dark, flanks=flanks, times=values["time"]
        )
        if not any(x is not None for x in values["PV"]):
            why_empty = f"No value of {loop.name} came in the last {WINDOWS[loop.window]}."
            options = charts.nothing(options, why_empty, dark=loop.dark)
        ui.echart(options).classes("chart").props('role="img" aria-label="PV over OP"')
        lines = f"The two lines are the flanks of the gap of {quantity(width, loop.op_unit)}. " if flanks else ""
        ui.label(lines + why).classes("small muted")
