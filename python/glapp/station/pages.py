"""Common parts of all pages, and the two of the whole plant: overview and events."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from typing import Any

from nicegui import ui
from starlette.requests import Request

from ..errors import InputError
from ..report.words import duration
from .client import ApiClient, Gone, Refused, Unsure, loop_path
from .listed import Listed
from .sessions import Session, Sessions, Tokens
from .view import View, age
from .view import summary as summarised

__all__ = [
    "ONE_STOP",
    "Station",
    "all_events",
    "command",
    "described",
    "events_page",
    "frame",
    "heading",
    "moment",
    "overview_page",
    "quiet",
]

DOUBLE = 0.5
"""The same command of the same person within this time is a double click [s]."""

ASK = 3.0
"""Time between two questions whether the service can write [s]."""

WAITS = "What comes waits in its memory for ten minutes: make room on its disk, or repair it."
"""What is to be done where the service cannot write."""

PAGES = (("/", "Overview"), ("/events", "Events"), ("/laboratory", "Laboratory"))


@dataclass
class Station:
    """Shared state of the pages.

    - `view`: the database.
    - `api`: the service.
    - `sessions`: who is logged in.
    - `listed`: the overview, as of the last look.
    - `asked`: the commands under way or just done, until when the same one is not sent again [s].
    """

    view: View
    api: ApiClient
    sessions: Sessions = field(init=False)
    listed: Listed = field(default_factory=Listed)
    asked: dict[tuple[str, str, str], float] = field(default_factory=dict)
    _of: tuple[float | None, float] = (None, 0.0)
    _failing: str | None = None
    _asking: asyncio.Task[None] | None = None

    def __post_init__(self) -> None:
        self.sessions = Sessions(Tokens(self.view.folder))

    async def look(self) -> None:
        """Look at the database again and again, for all pages together."""
        while True:
            await asyncio.to_thread(self._look)
            await asyncio.sleep(1.0)

    def _look(self) -> None:
        """Look at the database, and list the loops anew where it has changed."""
        self.view.refresh()
        now = time.monotonic()
        # The page's values grow older, too, and a fit goes on.
        if self.view.at != self._of[0] or now - self._of[1] > (1.0 if self.view.fitting else 5.0):
            self._of = self.view.at, now
            self.listed = self.listed.after(self.view.rows())

    def failing(self, token: str) -> str | None:
        """Why the service cannot write, by its last answer; None where it did not say. It is asked again and again.

        A full disk holds no word of it in the database.
        """
        if self._asking is None or self._asking.done():
            self._asking = asyncio.create_task(self._ask_failing(token))
        return self._failing

    async def _ask_failing(self, token: str) -> None:
        """Ask the service once in some seconds whether it can write."""
        try:
            self._failing = (await self.api.asked("GET", "/status", token))["failing"]
        except (Gone, Refused):
            self._failing = None
        await asyncio.sleep(ASK)

    def who(self, request: Request) -> Session:
        """Whose page it is; nobody gets here without a session."""
        session = self.sessions.of(request.headers.get("cookie"))
        assert session is not None
        return session


def moment(at: float | None) -> str:
    """A moment as this computer's clock has it."""
    return "–" if at is None else time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(at))


def _zone_minutes() -> int:
    """Minutes by which this computer's clock is ahead of UTC."""
    return time.localtime().tm_gmtoff // 60


def heading(text: str, level: int = 1) -> None:
    """A heading, whatever characters are in it."""
    ui.html(f"<h{level}>{escape(text)}</h{level}>", sanitize=False)


def described(rows: Iterable[tuple[str, str]]) -> None:
    """Terms of a list of facts, each with its text."""
    for term, text in rows:
        with ui.element("div"):
            with ui.element("dt"):
                ui.label(term)
            with ui.element("dd"):
                ui.label(text)


def quiet(text: str, what: Any = None, *, flat: bool = False) -> ui.button:
    """A button in the ink of the page; the second click of a double one does nothing."""
    button = ui.button(text, color=None).props("flat no-caps" if flat else "outline no-caps")
    return button if what is None else button.on("click", what, [], throttle=DOUBLE, trailing_events=False)


@contextmanager
def frame(station: Station, session: Session, title: str, here: str) -> Iterator[None]:
    """Everything around a page: links, the person, and the age of the shown data."""
    ui.page_title(f"{title} – glapp")
    ui.dark_mode(session.dark)
    ui.colors(primary="#41618a" if session.dark else "#3f4a54")
    paper = "#161b20" if session.dark else "#eceef0"
    ui.add_head_html(
        f'<style>html{{background:{paper}}}</style><link rel="stylesheet" href="/static/station.css">'
        '<script src="/static/shown.js"></script><script src="/static/station.js"></script>'
        f"<script>glapp.follow({json.dumps(session.dark)}, {json.dumps(session.chosen)});"
        f"glapp.zone({_zone_minutes()})</script>"
    )
    ui.link("To the content", "#content").classes("skip")
    with ui.element("header").classes("top"):
        ui.label("glapp station").classes("name")
        with ui.element("nav").props('aria-label="Pages"'):
            for path, name in PAGES:
                ui.link(name, path).props('aria-current="page"' if path == here else "")
        with ui.element("div").classes("right"):
            state = ui.label().props('role="status"')
            ui.label(session.user if session.user == session.role else f"{session.user}, {session.role}")
            other = "Light" if session.dark else "Dark"
            quiet(other, flat=True).on("click", js_handler="() => glapp.post('/theme', location.href)")
            quiet("Log out", flat=True).on("click", js_handler="() => glapp.post('/logout', '/login')")
    with ui.element("div").classes("content").props('id="content" tabindex="-1"'):
        banner = ui.label().classes("banner").props('role="alert"')
        hours, minutes = divmod(abs(_zone_minutes()), 60)
        zone = f"UTC{'-' if _zone_minutes() < 0 else '+'}{hours:02d}:{minutes:02d}"
        ui.label(f"Times in words are {zone}; those of pictures are this browser's.").classes("zone small muted")
        yield

    def tick() -> None:
        if station.sessions.by_id(session.id) is None:
            timer.cancel()
            ui.run_javascript("glapp.expired()")
            return
        view = station.view
        late = view.behind
        since = "" if view.at is None else f"as of {moment(view.at)[11:]}"
        catching = view.catching_up
        if catching is not None:
            state.set_text("Service: catching up")
        else:
            state.set_text(f"Service: {since}" if late is None else f"Service: {since}, {age(late)} old")
        state.classes(remove="late") if late is None else state.classes("late")
        text = ""
        if view.why is not None:
            text = f"The database cannot be read: {view.why}"
        elif late is not None and (failing := station.failing(session.token)) is not None:
            text = f"The service cannot write: {failing}. {WAITS} You see the state of {moment(view.at)}."
        elif late is not None:
            text = (
                f"The service has written nothing for {age(late)}: you see the state of {moment(view.at)}. "
                "No command is answered until it is back."
            )
        elif catching is not None:
            left = "" if catching["left"] is None else f", and needs about {duration(catching['left'])} for it"
            text = (
                f"The simulated plant catches up with today: it is at {moment(view.at)[:16]}, "
                f"{age(catching['seconds'])} to go{left}. Until then nothing here is of now."
            )
        elif view.unconnected is not None:
            text = f"The plant's server is not connected: {view.unconnected}."
            if view.newest is not None:
                text += f" The newest value is of {moment(view.newest)[11:]}."
            if any(one.get("compensation") for one in view.shown["loops"].values()):
                text += " Until it is back u_FF in the plant is not known; the plant takes it to 0 by its watchdog."
        elif view.shown.get("failing"):
            text = f"The service cannot write: {view.shown['failing']}. {WAITS}"
        elif view.shown.get("damaged"):
            text = view.shown["damaged"][:1].upper() + view.shown["damaged"][1:] + "."
        banner.classes(remove="calm").classes(add="calm" if catching is not None else "")
        banner.set_text(text)
        banner.set_visibility(bool(text))

    timer = ui.timer(1.0, tick)


@contextmanager
def dialog_of(title: str) -> Iterator[ui.dialog]:
    """A dialog over the page, there at once; Escape closes it, and it is built anew each time."""
    with ui.dialog(value=True).props("transition-duration=0") as dialog, ui.card().classes("wide-dialog"):
        dialog.on("hide", dialog.delete)  # by then the button that opened it has the focus again
        with ui.element("div").classes("bar"):
            heading(title, 2)
            ui.element("span").classes("grow")
            quiet("Close", dialog.close, flat=True)
        yield dialog


async def command(station: Station, session: Session, loop: str, what: str, body: Any, done: str) -> bool:
    """A command about a loop in the person's name; its outcome is shown in any case. True where it was done.

    The second click of a double one is no second command.
    """
    if station.sessions.by_id(session.id) is None:
        ui.run_javascript("glapp.expired()")
        return False
    path = loop_path(loop, what)
    key, now = (session.id, path, json.dumps(body)), time.monotonic()
    if now < station.asked.get(key, now):
        return False
    station.asked = {one: until for one, until in station.asked.items() if until > now} | {key: math.inf}
    try:
        await station.api.asked("POST", path, session.token, body)
    except Refused as refused:
        if refused.status == 401:
            station.sessions.end(session.id)
            ui.run_javascript("glapp.expired()")
        else:
            ui.notify(f"Refused: {refused}", type="warning", timeout=0, close_button="Close", multi_line=True)
        return False
    except Gone as gone:
        text = f"It may be done or not: {gone}. Events tell." if isinstance(gone, Unsure) else f"Not done: {gone}"
        ui.notify(text, type="negative", timeout=0, close_button="Close", multi_line=True)
        return False
    finally:
        station.asked[key] = now + DOUBLE
    ui.notify(done, color="grey-9", position="bottom-right")
    return True


_TO_LOOP = "location.href = '/loop?name=' + encodeURIComponent({})"
_NAME = (  # by keyboard Enter on the row does the same, and Tab has no stop at each row
    "p => { const a = document.createElement('a'); a.textContent = p.value; a.tabIndex = -1; "
    "a.href = '/loop?name=' + encodeURIComponent(p.value); return a; }"
)


ONE_STOP = {":tabToNextCell": "glapp.leave", ":tabToNextHeader": "glapp.leave"}
"""A list is one stop of Tab; within it one goes by arrows, and is not held by thousands of cells."""

_HEALTHS = (
    "{'Maintenance required': 'health health-service', 'Check function': 'health health-check', "
    "'Failure': 'health high'}"
)


def _overview_columns() -> list[dict[str, Any]]:
    def column(name: str, title: str, width: int, **more: Any) -> dict[str, Any]:
        return {"field": name, "headerName": title, "width": width, "tooltipField": name, **more}

    return [
        column("rank", "#", 58, sort="asc", filter=False),
        column("loop", "Loop", 92, pinned="left", **{":cellRenderer": _NAME}),
        column(
            "soon",
            "How soon",
            122,
            **{":cellClass": "p => 'soon-' + p.data.urgency", ":valueFormatter": "p => glapp.soon(p.data)"},
        ),
        column(
            "width",
            "Gap (95 %)",
            172,
            **{":comparator": "(a, b, m, n) => (m.data.percent ?? -1) - (n.data.percent ?? -1)"},
        ),
        column("verdict", "Verdict", 118, **{":valueFormatter": "p => p.value.replace(', by crossings', '')"}),
        column("todo", "What to do", 260, flex=1, minWidth=232),
        column("trend", "Trend", 132, **{":valueFormatter": "p => p.value.replace(/ ± \\S+/, '').replace(/;.*/, '')"}),
        column("health", "NE 107", 118, **{":cellClass": f"p => ({_HEALTHS})[p.value] || ''"}),
        column(
            "seen",
            "PV age",
            80,
            headerTooltip="How old the newest PV is",
            suppressHeaderFilterButton=True,
            **{":valueFormatter": "p => p.value.replace(/bad: .*/, 'bad')"},  # what to do has the rest
        ),
        column("compensation", "Compensation", 116, suppressHeaderFilterButton=True),
        column(
            "card", "Answer", 200, flex=1, hide=True, sortable=False, filter=False, **{":cellRenderer": "glapp.card"}
        ),
    ]


def overview_page(station: Station, request: Request) -> None:
    """Every loop of the plant, what maintenance should do first before all else."""
    session = station.who(request)
    with frame(station, session, "Overview", "/"):
        with ui.element("div").classes("bar"):
            heading("Overview")
            summary = ui.label().classes("muted grow")
            search = ui.input(placeholder="Search").props('dense outlined clearable aria-label="Search"')
            some = ui.toggle({"all": "All", "some": "To do"}, value="all").props("no-caps dense unelevated")
            ui.link("CSV", "/overview.csv").props("download")
        grid = ui.aggrid(
            {
                "columnDefs": _overview_columns(),
                "defaultColDef": {
                    "sortable": True,
                    "filter": True,
                    "resizable": True,
                    "suppressHeaderMenuButton": True,
                    "wrapText": True,  # nothing is cut, however long it is
                    "autoHeight": True,
                    "cellStyle": {"lineHeight": "20px", "paddingTop": "7px", "paddingBottom": "7px"},
                },
                ":getRowId": "p => p.data.loop",
                "enableCellTextSelection": True,
                "ensureDomOrder": True,
                "animateRows": False,
                ":onCellKeyDown": f"e => {{ if (e.event.key === 'Enter') {_TO_LOOP.format('e.data.loop')}; }}",
                ":onRowDoubleClicked": f"e => {{ {_TO_LOOP.format('e.data.loop')}; }}",
                ":onGridReady": "e => { glapp.cards(e.api, ['loop']); glapp.overview(e.api); }",
                "overlayNoRowsTemplate": "No loop is here.",
                **ONE_STOP,
            },
            auto_size_columns=False,
        ).classes("grid")

        def filtered() -> None:
            grid.run_grid_method("setGridOption", "quickFilterText", search.value or "")
            model = (
                None
                if some.value == "all"
                else {"soon": {"filterType": "text", "type": "notContains", "filter": "Not now"}}
            )
            grid.run_grid_method("setFilterModel", model)

        search.on_value_change(filtered)
        some.on_value_change(filtered)

        def tick() -> None:
            summary.set_text(summarised(station.listed.rows, station.view.judged_at()))

        tick()
        ui.timer(2.0, tick)


def all_events(station: Station, most: int, loop: str | None = None) -> list[dict[str, Any]]:
    """Events and commands together, the newest first.

    Raises InputError where the database cannot be read.
    """
    from .parameters import command_text

    found = [
        {
            "when": moment(row["time"]),
            "at": row["time"],
            "loop": row["loop"] or "",
            "kind": row["kind"].replace("_", " "),
            "who": "",
            "text": row["text"],
        }
        for row in station.view.read(lambda reader: reader.events(loop, most))
    ]
    for row in station.view.read(lambda reader: reader.commands(loop, most)):
        found.append(
            {
                "when": moment(row["time"]),
                "at": row["time"],
                "loop": row["loop"] or "",
                "kind": row["command"].replace("_", " "),
                "who": f"{row['person']} ({row['role']})" if row["role"] else row["person"],
                "text": command_text(row),
            }
        )
    found.sort(key=lambda one: -one["at"])
    return found[:most]


def events_page(station: Station, request: Request) -> None:
    """Everything that happened, who asked for it, when and why."""
    session = station.who(request)
    with frame(station, session, "Events", "/events"):
        with ui.element("div").classes("bar"):
            heading("Events")
            ui.label("The newest 5000 events and commands; the CSV has them all.").classes("muted grow")
            search = ui.input(placeholder="Search").props('dense outlined clearable aria-label="Search"')
            ui.link("CSV", "/events.csv").props("download")
        grid = ui.aggrid(
            {
                "columnDefs": [
                    {"field": "when", "headerName": "When", "width": 160},
                    {"field": "loop", "headerName": "Loop", "width": 100},
                    {"field": "kind", "headerName": "Kind", "width": 130},
                    {
                        "field": "text",
                        "headerName": "What happened",
                        "flex": 1,
                        "minWidth": 300,
                        "wrapText": True,
                        "autoHeight": True,
                        "cellStyle": {"lineHeight": "20px", "paddingTop": "10px", "paddingBottom": "10px"},
                        "tooltipField": "text",
                    },
                    {"field": "who", "headerName": "Who", "width": 170},
                    {
                        "colId": "card",
                        "headerName": "Events",
                        "flex": 1,
                        "hide": True,
                        "wrapText": True,
                        "autoHeight": True,
                        "cellStyle": {"lineHeight": "20px", "paddingTop": "7px", "paddingBottom": "7px"},
                        "sortable": False,
                        "filter": False,
                        ":cellRenderer": "glapp.event",
                    },
                ],
                ":onGridReady": "e => glapp.cards(e.api)",
                "defaultColDef": {
                    "sortable": True,
                    "filter": True,
                    "resizable": True,
                    "suppressHeaderMenuButton": True,
                },
                "rowData": [],
                "enableCellTextSelection": True,
                "animateRows": False,
                **ONE_STOP,
            },
            auto_size_columns=False,
        ).classes("grid")
        search.on_value_change(lambda: grid.run_grid_method("setGridOption", "quickFilterText", search.value or ""))
        shown: list[tuple[Any, ...]] = []

        async def tick() -> None:
            try:
                rows = await asyncio.to_thread(all_events, station, 5000)
            except InputError:
                return  # the frame says so
            newest = [tuple(row.values()) for row in rows[:1]]
            if newest != shown:
                shown[:] = newest
                grid.options["rowData"] = rows
                grid.run_grid_method("setGridOption", "rowData", rows)

        ui.timer(3.0, tick)
