"""The report of a run: one HTML file that needs nothing else, to read, to print and to hand on.

The text is in the page, from the templates next to this file; the figures are JSON, drawn when they come into view, so
that a run of hundreds of loops opens at once. A content security policy in the page forbids every request, whatever a
loop is called.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape
from plotly.offline import get_plotlyjs

from .. import palette
from ..escape import escaped
from ..score import Scored
from ..writing import GENERATOR, write_file
from . import figures, repaired, words
from .scored import calibration, counts, workshop
from .view import LoopView, bar

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from ..result import Result

MAX_BYTES = 30_000_000
"""A report that would be larger becomes an index with one file per loop."""

_ASSETS = Path(__file__).parent

#: Colours of the figures on a dark page.
_DARK = {
    palette.INK: "#e4e8ec",
    palette.MUTED: "#9fabb7",
    palette.GRID: "#2c353e",
    palette.RAW: "#41658f",
    palette.SIGNAL: "#8cbcf0",
    palette.OUTPUT: "#b898e0",
    palette.POSITION: "#e0a060",
    palette.POINT: "#3cc79c",
    palette.TOO_WIDE: "#e5794f",
    palette.UNJUDGED: "#7aa8d8",
    palette.PAPER: "#161b20",
}


def write_report(
    results: Sequence[Result], path: str | Path, *, title: str = "Dead bands of control loops"
) -> list[Path]:
    """Write the report of a run.

    - `results`: the run's results, in any order; the report ranks them by urgency, and among equals by width.
    - `path`: the HTML file to write. Its folder must exist.
    - `title`: heading of the report.

    Returns the files written, `path` first. More than one only where a single file would reach `MAX_BYTES`: then `path`
    is an index, with one file per loop in a folder next to it that is named after it.
    """
    order = words.ranked(results)
    drawn = [bar(r) for r in order]
    scale = 1.02 * max((bar.end for bar in drawn if bar is not None), default=0.0) or 1.0

    def summary(links: Sequence[str]) -> dict[str, Any]:
        return {"scale": scale, "loops": list(zip(order, links, drawn, strict=True))}

    return _write(order, Path(path), title, "summary", summary)


def write_score(
    scored: Sequence[Scored], path: str | Path, *, title: str = "Answers and what the workshop found"
) -> list[Path]:
    """Write the score of labelled valves: the counts, the calibration, and a section for each answer that differs.

    - `scored`: answers with their labels, from `glapp.score`.
    - `path`: the HTML file to write. Its folder must exist.
    - `title`: heading of the report.

    Returns as `write_report`.
    """
    differ = [valve for valve in scored if valve.outcome == "wrong"]
    tables = {"counts": counts(scored), "calibration": calibration(scored)}

    def summary(links: Sequence[str]) -> dict[str, Any]:
        leads = dict(zip(map(id, differ), links, strict=True))
        lines = [(valve, leads.get(id(valve))) for valve in scored]
        return {"scored": lines, "differ": differ, "workshop": workshop, **tables}

    return _write([valve.result for valve in differ], Path(path), title, "score", summary)


def _write(
    order: Sequence[Result], path: Path, title: str, first: str, summary: Callable[[Sequence[str]], dict[str, Any]]
) -> list[Path]:
    """A page that begins with the template `first`, a section for each result in this order; `summary` takes links."""
    pages = templates()

    def part(name: str, **known: Any) -> Markup:
        return Markup(pages.get_template(f"{name}.html").render(known))

    def page(heading: str, *parts: Markup) -> bytes:
        return part("page", title=heading, parts=parts).encode()

    def beginning(links: Sequence[str]) -> Markup:
        written = f"Written {datetime.now():%Y-%m-%d %H:%M} by glapp {version('glapp')}"
        return part(first, title=title, written=written, **summary(links))

    keys = anchors([r.name for r in order])

    def section(key: str, r: Result) -> Markup:
        view = LoopView(key, r)
        return part("loop", v=view, r=r, payload=_payload(view.drawn))

    sections = [section(key, r) for key, r in zip(keys, order, strict=True)]
    explained = part("explain")
    whole = page(title, beginning([f"#{key}" for key in keys]), *sections, explained)
    if len(whole) < MAX_BYTES:
        write_file(path, whole)
        return [path]

    folder = path.with_name(path.stem + "_loops")
    folder.mkdir(exist_ok=True)
    files = [folder / f"{i + 1:0{len(str(len(order)))}d}_{_file_name(r.name)}.html" for i, r in enumerate(order)]
    back = part("back", link=f"../{quote(path.name)}")
    for file, r, shown in zip(files, order, sections, strict=True):
        write_file(file, page(f"{r.name}: {title}", back, shown, explained))
    links = [f"{quote(folder.name)}/{quote(file.name)}" for file in files]
    write_file(path, page(title, beginning(links), explained))
    return [path, *files]


def anchors(names: Sequence[str]) -> list[str]:
    """Anchor of each loop by its name, not by its rank: a link that was sent on still leads there in the next report.

    Examples
    --------
    >>> anchors(["FIC201", "FIC 201/A", "FIC-201-A", "流量"])
    ['loop-FIC201', 'loop-FIC-201-A', 'loop-FIC-201-A-2', 'loop-loop']
    """
    found: dict[str, None] = {}
    for name in names:
        base, number = f"loop-{_file_name(name).strip('-') or 'loop'}", 1
        key = base
        while key in found:
            number += 1
            key = f"{base}-{number}"
        found[key] = None
    return list(found)


def templates() -> Environment:
    """The templates, with what all of them use."""
    pages = Environment(
        loader=FileSystemLoader(_ASSETS / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda shown: escaped(shown) if type(shown) is str else shown,
    )
    pages.filters |= {"breakable": _breakable, "tight": _tight, "anchors": anchors}
    pages.tests["judged"] = words.judged
    pages.globals |= {
        "words": words,
        "repaired": repaired,
        "reasons": list(zip(words.REASONS.items(), figures.REASON_COLOURS, strict=True)),
        "generator": Markup(GENERATOR),
        "style": Markup((_ASSETS / "report.css").read_text(encoding="utf-8")),
        "script": Markup((_ASSETS / "report.js").read_text(encoding="utf-8")),
        "plotly": Markup(get_plotlyjs()),
        "dark": Markup(json.dumps(_DARK)),
        "config": Markup(json.dumps(figures.CONFIG)),
    }
    return pages


def _breakable(name: str) -> Markup:
    """Let long tags break where people break them: after a dot, slash, dash, underscore or colon."""
    return Markup("").join(escape(c) + Markup("<wbr>" if c in "./\\-_:" else "") for c in escaped(name))


def _tight(text: str) -> str:
    """Keep the two ends of an interval on one line."""
    return text.replace(" to ", "\N{NO-BREAK SPACE}to\N{NO-BREAK SPACE}")


def _file_name(name: str) -> str:
    """Make a loop's name safe for any file system."""
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in name)[:60] or "loop"


def _payload(drawn: Mapping[str, go.Figure]) -> Markup:
    """Store figures as JSON, every array once: the lines of a loop share their time, and the figures their signals."""
    arrays: dict[str, int] = {}
    specs: list[Any] = []

    def shared(node: Any) -> Any:
        """The tree of a chart with equal arrays stored once."""
        if isinstance(node, dict):
            if "bdata" in node:
                name = json.dumps(node, sort_keys=True)
                if name not in arrays:
                    arrays[name] = len(specs)
                    specs.append(node)
                return {"$": arrays[name]}
            return {k: shared(v) for k, v in node.items()}
        if isinstance(node, str):
            return escaped(node)
        return [shared(v) for v in node] if isinstance(node, list) else node

    stored = {name: shared(json.loads(figure.to_json())) for name, figure in drawn.items()}
    for figure in stored.values():
        figure["layout"].pop("width", None)  # the page decides
    text = json.dumps({"arrays": specs, "figures": stored}, separators=(",", ":"), ensure_ascii=False)
    return Markup(text.replace("<", "\\u003c"))
