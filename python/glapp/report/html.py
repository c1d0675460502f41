"""The report of a run: one HTML file that needs nothing else, to read, to print and to hand on.

The text is in the page; the figures are JSON beside it, drawn when they come into view, so that a run of hundreds of
loops opens at once. A content security policy in the page forbids every request, whatever a loop is called.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
from plotly.offline import get_plotlyjs

from ..writing import GENERATOR, write_file
from . import figures, words
from .fit_figure import fit_figure, trend_figure

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from ..result import Result

MAX_BYTES = 30_000_000
"""A report that would be larger becomes an index with one file per loop."""

_ASSETS = Path(__file__).parent

#: Colours of the figures on a dark page.
_DARK = {
    figures.INK: "#e4e8ec",
    figures.MUTED: "#9fabb7",
    figures.GRID: "#2c353e",
    figures.RAW: "#41658f",
    figures.SIGNAL: "#8cbcf0",
    figures.OUTPUT: "#b898e0",
    figures.POSITION: "#e0a060",
    figures.POINT: "#3cc79c",
    figures.TOO_WIDE: "#e5794f",
    figures.ACCEPTABLE: "#3cc79b",
    figures.UNJUDGED: "#7aa8d8",
    figures.PAPER: "#161b20",
}


def write_report(
    results: Sequence[Result], path: str | Path, *, title: str = "Dead bands of control loops"
) -> list[Path]:
    """Write the report of a run.

    Parameters
    ----------
    results : Sequence[Result]
        The run's results, in any order; the report ranks them by width.
    path : str | Path
        The HTML file to write. Its folder must exist.
    title : str
        Heading of the report.

    Returns
    -------
    list[Path]
        The files written, `path` first. More than one only where a single file would reach `MAX_BYTES`: then `path`
        is an index, with one file per loop in a folder beside it that is named after it.
    """
    path = Path(path)
    order = words.ranked(results)
    sections = [_loop(f"loop-{i}", r) for i, r in enumerate(order)]
    overview = _overview(order, [f"#loop-{i}" for i in range(len(order))])
    page = _page(title, [_header(title, order), overview, *sections, _explanations()]).encode()
    if len(page) < MAX_BYTES:
        write_file(path, page)
        return [path]

    folder = path.with_name(path.stem + "_loops")
    folder.mkdir(exist_ok=True)
    files = [folder / f"{i + 1:0{len(str(len(order)))}d}_{_file_name(r.name)}.html" for i, r in enumerate(order)]
    back = f'<p class="back"><a href="../{quote(path.name)}">All loops of this run</a></p>'
    for file, r, section in zip(files, order, sections, strict=True):
        write_file(file, _page(f"{r.name}: {title}", [back, section, _explanations()]))
    links = [f"{quote(folder.name)}/{quote(file.name)}" for file in files]
    index = _page(title, [_header(title, order), _overview(order, links), _explanations()])
    write_file(path, index)
    return [path, *files]


def _page(title: str, parts: Iterable[str]) -> str:
    """Put the parts between the head and the scripts."""
    style = (_ASSETS / "report.css").read_text(encoding="utf-8")
    script = (_ASSETS / "report.js").read_text(encoding="utf-8")
    swatches = "".join(
        f".r-{name} {{ background: {colour}; }}\n"
        for name, colour in zip(words.REASONS, figures.REASON_COLOURS, strict=True)
    )
    policy = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data: blob:"
    return "\n".join(
        [
            "<!doctype html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            GENERATOR,
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta name="color-scheme" content="light dark">',
            f"<title>{escape(title)}</title>",
            f"<style>\n{style}{swatches}</style>",
            "</head>",
            "<body>",
            "<main>",
            "<noscript><p>The figures need JavaScript; all text and tables are here without it.</p></noscript>",
            *parts,
            "</main>",
            f"<script>{get_plotlyjs()}</script>",
            f'<script type="application/json" id="dark">{json.dumps(_DARK)}</script>',
            f'<script type="application/json" id="config">{json.dumps(figures.CONFIG)}</script>',
            f"<script>\n{script}</script>",
            "</body>",
            "</html>",
            "",
        ]
    )


def _header(title: str, order: Sequence[Result]) -> str:
    loops = words.count(len(order), "loop")
    tiles = "".join(
        f'<div class="tile {name}"><dt>{label}</dt><dd>{sum(r.answer.valve == name for r in order)}</dd></div>'
        for name, label in words.VALVES.items()
    )
    written = f"Written {datetime.now():%Y-%m-%d %H:%M} by glapp {version('glapp')}"
    return (
        f'<header id="top"><h1>{escape(title)}</h1><p class="sub">{loops}. {written}.</p>'
        f'<dl class="tiles">{tiles}</dl></header>'
    )


def _overview(order: Sequence[Result], links: Sequence[str]) -> str:
    """Write the ranking: the figure, then the table whose loop names lead to their sections."""
    if not order:
        return '<section class="overview"><h2>Overview</h2><p>There are no loops in this run.</p></section>'
    head = (
        ("Rank", "n"),
        ("Loop", ""),
        ("Valve", ""),
        ("Gap (95 %)", "n"),
        ("What to do", ""),
        ("How soon", ""),
        ("Quality", ""),
        ("A PLC would show", "n"),
        ("Detections", "n"),
        ("Rejected as", ""),
    )
    rows = []
    for i, (r, link) in enumerate(zip(order, links, strict=True)):
        reasons = ", ".join(f"{words.REASONS[name].label} {n}" for name, n in words.ranked_reasons(r)[:2])
        if r.answer.evidence is None and r.d_hat is None and (r.crossings == "refused" or r.detections or not reasons):
            reasons = r.reason or ""
        cells = (
            "–" if r.width is None else str(i + 1),
            f'<a href="{escape(link)}">{_breakable(r.name)}</a>',
            _badge(r),
            escape(words.headline(r) or "–").replace(" to ", "&nbsp;to&nbsp;"),
            escape(words.next_step(r)),
            words.URGENCIES[r.answer.urgency],
            _quality_cell(r),
            escape(words.crossing(r)),
            f"{r.detections} of {r.total_half_periods}",
            escape(reasons or "–"),
        )
        rows.append(
            "<tr>"
            + "".join(
                f'<td data-label="{escape(label)}" class="{style}">{cell}</td>'
                for (label, style), cell in zip(head, cells, strict=True)
            )
            + "</tr>"
        )
    heads = "".join(f'<th scope="col" class="{style}">{escape(label)}</th>' for label, style in head)
    picture = ""
    if any(r.width is not None for r in order):
        figure = figures.overview_figure(order)
        picture = _figure(
            "overview", "overview", figure, "Bars: dead band of each loop with its interval, widest first"
        )
        picture += _payload("overview", {"overview": figure})
    return (
        f'<section class="overview"><h2>Overview</h2>{picture}'
        '<table class="loops"><caption>Loops, widest dead band first. A dead band is the total width.</caption>'
        + f"<thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table></section>"
    )


def _loop(key: str, r: Result) -> str:
    """Write one loop's section: what was found, the figures, and all that it stands on."""
    name = escape(r.name)
    drawn: dict[str, go.Figure] = {}
    plots = ""
    if r.trace is not None:
        drawn["time"] = figures.loop_figure(r)
        plots = _figure(
            key, "time", drawn["time"], f"{r.name} over time: SP, PV, OP, half-periods by verdict, detections, estimate"
        )
        hint = "Hover over a half-period for its numbers. " if r.half_periods.count else ""
        plots += f'<p class="note">{hint}Drag to zoom, double-click to return.</p>'
    phase = ""
    if r.trace is not None and r.trace.op is not None:
        drawn["phase"] = figures.phase_figure(r)
        phase = (
            "<section><h3>PV against OP</h3>"
            + _figure(key, "phase", drawn["phase"], f"{r.name}: PV against OP, coloured by time")
            + f'<p class="note">{_phase_note(r)}</p></section>'
        )
    fitted = ""
    if r.fit is not None:
        if r.fit.best:
            drawn["fit"] = fit_figure(r)
        if len(r.fit.windows) > 1 and not r.fit.recordings:
            drawn["trend"] = trend_figure(r)
        fitted = _fit(key, r, drawn)
    width = escape(words.headline(r))
    crossings = words.verdict(r)
    answered, footnote = crossings, ""
    if r.answer.evidence is not None:
        answered = [words.lead(r), words.why(r)]
        footnote = f"<h3>What a PLC would show, from zero crossings</h3>{_told(crossings)}"
    todo = f'<p class="action"><b>What to do</b> {escape(words.next_step(r))}</p>'
    return (
        f'<section class="loop" id="{key}"><details>'
        f'<summary><h2>{_breakable(r.name)}</h2><span class="width">{width}</span>{_badge(r)}</summary>'
        f"{_told(answered, todo)}{fitted}{footnote}"
        f"{_facts(r)}{plots}"
        f'<div class="columns">{_reasons(r)}{_quality(r)}</div>{_settings(r)}'
        f'<div class="columns">{_identification(r)}{phase}</div>'
        f"{_payload(key, drawn) if drawn else ''}"
        f'<p class="back"><a href="#top" aria-label="From {name} back to the overview">Back to the overview</a></p>'
        "</details></section>"
    )


def _told(paragraphs: Sequence[str], todo: str = "") -> str:
    """Write paragraphs, the first of them large, and what to do."""
    lead, *more = (escape(text) for text in paragraphs)
    return f'<div class="verdict"><p class="lead">{lead}</p>{"".join(f"<p>{text}</p>" for text in more)}{todo}</div>'


def _fit(key: str, r: Result, drawn: Mapping[str, go.Figure]) -> str:
    """Show the fit of OP and PV: its picture, its numbers, and the process that came with it."""
    f = r.fit
    assert f is not None
    told = f"<p>{escape(words.sentence(f.reason))}</p>"
    if r.answer.evidence is not None:
        told = f'<details class="numbers"><summary>The numbers</summary>{told}</details>'
    picture = table = ""
    if "fit" in drawn:
        picture = _figure(key, "fit", drawn["fit"], f"{r.name}: likelihood over the width, model beside PV, residual")
        picture += (
            '<p class="note">Upper panel: the lower a line, the better that width explains PV; the shaded band is the '
            "95 % interval, the dotted line its level for the best family. Below: PV and what the best model foresaw "
            "of it one step ahead, the valve as that model has it, and what is left.</p>"
        )
    if shown := next((one.source for one in f.recordings if one.shown), None):
        picture += (
            f'<p class="note">Drawn is {escape(shown)}, which of {len(f.recordings)} recordings shows best what all '
            "say: its own likelihood, and the joint interval.</p>"
        )
    if "trend" in drawn:
        picture += _figure(key, "trend", drawn["trend"], f"{r.name}: width of the gap in each window over time")
        picture += (
            f'<p class="note">{words.count(len(f.windows), "window")} of the recording, fitted apart: a dot is a width '
            "with its 95 % interval, a triangle a bound. Windows that cannot tell are left out. The dashed line is the "
            "trend.</p>"
        )
    if (p := f.process) is not None:
        per = _pv_unit(r) + f" per {words.op_unit(r)}" + (" and s" if p.integrating else "")
        rows = (
            ("Velocity gain" if p.integrating else "Process gain Kp", p.kp, per),
            ("Dead time", p.dead_time, "s"),
            ("Lags together", p.lag, "s"),
        )
        body = "".join(
            f'<tr><th scope="row">{name}</th><td class="n">{escape(words.quantity(value, unit))}</td>'
            f'<td class="n">{_between(low, high)}</td></tr>'
            for name, (value, low, high), unit in rows
        )
        table = (
            "<table><caption>The process between valve and PV, from the same fit.</caption><thead><tr>"
            '<th scope="col">Process</th><th scope="col" class="n">Value</th>'
            f'<th scope="col" class="n">95 % interval</th></tr></thead><tbody>{body}</tbody></table>'
        )
    return f"<section><h3>The gap from OP and PV</h3>{told}{picture}{table}</section>"


def _analysed(r: Result) -> bool:
    """Tell a loop that was looked at from one that was refused before: of the latter no absence means anything."""
    return r.crossings != "refused" or r.total_half_periods > 0


def _facts(r: Result) -> str:
    """List what the recording is and what came of it."""
    facts = [("File", escape(r.source))]
    if r.trace is not None and len(r.trace.t):
        first, last = float(np.nanmin(r.trace.t)), float(np.nanmax(r.trace.t))
        start, end = words.clock(r.t0, first), words.clock(r.t0, last)
        if r.t0 is not None and start[:10] == end[:10]:
            end = end[11:]
        facts.append(("Recording", f"{escape(start)} to {escape(end)}, {words.duration(last - first)}"))
    if _analysed(r):
        facts.append(("Half-periods", str(r.total_half_periods)))
        facts.append(("Detections", str(r.detections)))
    if r.repeatability is not None and r.detections > 1:
        low, high = r.repeatability
        facts.append(("Repeatability", f"{words.number(low)} to {escape(words.quantity(high, words.op_unit(r)))}"))
    if r.corrected is not None and r.corrected.d is not None:
        facts.append(("Bias taken out", escape(words.quantity(r.corrected.d, words.op_unit(r)))))
    if r.noise_floor is not None:
        facts.append(("Noise can feign", escape(words.quantity(r.noise_floor, words.op_unit(r)))))
    if r.loop.acceptable_dead_band is not None:
        facts.append(("Acceptable", words.quantity(r.loop.acceptable_dead_band, "% of span")))
    return '<dl class="facts">' + "".join(f"<div><dt>{k}</dt><dd>{v}</dd></div>" for k, v in facts) + "</dl>"


def _reasons(r: Result) -> str:
    """Draw the verdicts on all half-periods as one bar and list them with their meaning."""
    total = r.total_half_periods
    if not _analysed(r):
        return ""
    if not total:
        return "<section><h3>Half-periods</h3><p>There are none: PV did not cross SP and come back.</p></section>"
    counts = [("accepted", r.detections), *words.ranked_reasons(r)]
    counts = [(name, n) for name, n in counts if n]
    parts, rows = [], []
    for name, n in counts:
        reason = words.REASONS[name]
        parts.append(f'<i class="r-{name}" style="flex-grow:{n}" title="{reason.label}: {n}"></i>')
        rows.append(
            f'<tr><td class="label"><span class="swatch r-{name}"></span>{reason.label}</td><td class="n">{n}</td>'
            f'<td class="n">{words.number(100 * n / total, 2)} %</td><td>{reason.meaning}</td></tr>'
        )
    return (
        '<section><h3>Half-periods</h3><div class="bar" aria-hidden="true">'
        + "".join(parts)
        + "</div><table><caption>The first reason that applied to each half-period.</caption><thead><tr>"
        + '<th scope="col">Verdict</th><th scope="col" class="n">Count</th><th scope="col" class="n">Share</th>'
        + f'<th scope="col">Meaning</th></tr></thead><tbody>{"".join(rows)}</tbody></table></section>'
    )


def _quality(r: Result) -> str:
    """List the findings on the data, the gravest first, with their evidence."""
    if not r.quality:
        if not _analysed(r):
            return ""
        return "<section><h3>Data quality</h3><p>Nothing to remark.</p></section>"
    order = {"refuse": 0, "warning": 1, "info": 2}
    label = {"refuse": "refused", "warning": "warning", "info": "note"}
    rows = "".join(
        f'<tr><td><span class="severity {f.severity}">{label[f.severity]}</span></td><td>{escape(f.text)}'
        f'<span class="evidence">{_evidence(f.evidence)}</span></td></tr>'
        for f in sorted(r.quality, key=lambda f: order[f.severity])
    )
    return (
        "<section><h3>Data quality</h3><table><caption>Findings on the recording, with evidence.</caption><thead><tr>"
        f'<th scope="col">Weight</th><th scope="col">Finding</th></tr></thead><tbody>{rows}</tbody></table></section>'
    )


def _evidence(evidence: Mapping[str, float | int | str]) -> str:
    def shown(value: float | int | str) -> str:
        return value if isinstance(value, str) else str(value) if isinstance(value, int) else words.number(value, 4)

    return escape(", ".join(f"{key.replace('_', ' ')} {shown(value)}" for key, value in evidence.items()))


def _settings(r: Result) -> str:
    """Set the settings as the maker writes them beside those the detector used."""
    s, loop = r.settings, r.loop
    if loop.controller is None and s.k is None:
        return ""
    c, process = loop.controller, loop.process
    form = gain = integral = derivative = action = weight = "–"
    others: list[tuple[str, str]] = []
    if c is not None:
        form, action, weight = c.form, c.action, words.number(c.setpoint_weight)
        per = f" {c.gain_unit}" if c.gain_unit else ""
        if c.form == "parallel":
            gain = f"kp {_typed(c.kp)}{per}"
            integral = f"ki {_typed(c.ki)} per {c.ti_unit}"
            derivative = f"kd {_typed(c.kd or 0.0)} {c.td_unit}"
        else:
            gain = f"PB {_typed(c.pb)} %" if c.pb is not None else f"{_typed(c.k)}{per}"
            integral = f"{_typed(c.ti)} {c.ti_unit}"
            derivative = f"{_typed(c.td)} {c.td_unit}"
        others = [
            ("Error gap of the controller", words.quantity(c.error_gap, _pv_unit(r))),
            ("Output dead band of the controller", words.quantity(c.output_dead_band, words.op_unit(r))),
            ("PV filter of the control system", words.quantity(c.pv_filter, "s")),
        ]
    acting = "–" if s.k is None else "direct (K below 0)" if s.k < 0 else "reverse (K above 0)"
    process_gain = words.quantity(process.kp, process.kp_unit or "")
    rows: list[tuple[str, str, str, str]] = [
        ("Form", form, "ideal", ""),
        ("Gain K", gain, words.quantity(s.k, _gain_unit(r)), "k"),
        ("Integral time TI", integral, words.quantity(s.ti, "s"), "ti"),
        ("Derivative time TD", derivative, words.quantity(s.td, "s"), "td"),
        ("Action", action, acting, ""),
        ("Setpoint weight b", weight, words.number(s.b), "b"),
        ("Filter of the detector TF", words.quantity(loop.tf, "s"), words.quantity(s.tf, "s"), "tf"),
        (
            "Process gain Kp",
            "integrating" if process.type == "integrating" else process_gain,
            "not used" if s.kp is None else words.quantity(s.kp, f"{_pv_unit(r)} per {words.op_unit(r)}"),
            "kp",
        ),
        ("OP travel Δu", "", "", "delta_u"),
        ("Longest step between samples", "", words.quantity(s.max_h, "s"), ""),
        ("Detections needed N", str(loop.n), str(s.n), "n"),
        ("PV span", _span(loop.pv_span, _pv_unit(r)), "", ""),
        ("OP span", _span(loop.op_span, words.op_unit(r)), "", ""),
        *((label, value, "", "") for label, value in others if value[0] != "0"),
    ]
    body = "".join(
        f'<tr><th scope="row">{escape(label)}</th><td>{escape(as_given)}</td><td>{escape(used)}</td>'
        f"<td>{escape(s.notes.get(note, ''))}</td></tr>"
        for label, as_given, used, note in rows
    )
    return (
        "<section><h3>Settings</h3><table><caption>As given, and as used: ideal form, seconds, units of the signals."
        '</caption><thead><tr><th scope="col">Setting</th><th scope="col">As given</th><th scope="col">As used</th>'
        f'<th scope="col">Where from</th></tr></thead><tbody>{body}</tbody></table></section>'
    )


def _identification(r: Result) -> str:
    """Show the fit of the controller's law, whether it was used or not."""
    f = r.identification
    if f is None:
        return ""
    rows = [
        ("K", words.quantity(f.k, _gain_unit(r)), _between(f.k_low, f.k_high)),
        ("TI", words.quantity(f.ti, "s"), _between(f.ti_low, f.ti_high)),
        ("TD", words.quantity(f.td, "s"), _between(f.td_low, f.td_high)),
        ("b", words.number(f.setpoint_weight), ""),
        ("R²", words.number(f.r2), ""),
        ("steps used", str(f.samples), ""),
    ]
    body = "".join(
        f'<tr><th scope="row">{k}</th><td class="n">{escape(v)}</td><td class="n">{escape(i)}</td></tr>'
        for k, v, i in rows
    )
    remark = "; ".join(part for part in (f.reason, f.note) if part)
    return (
        "<section><h3>Controller as identified</h3><table><caption>Read from the moves of OP, SP and PV.</caption>"
        '<thead><tr><th scope="col">Setting</th><th scope="col" class="n">Value</th>'
        f'<th scope="col" class="n">95 % interval</th></tr></thead><tbody>{body}</tbody></table>'
        + (f'<p class="note">{escape(remark)}</p>' if remark else "")
        + "</section>"
    )


def _between(low: float | None, high: float | None) -> str:
    if low is None or high is None:
        return "–"
    return f"{words.number(low)} to {words.number(high) if np.isfinite(high) else 'no upper bound'}"


def _phase_note(r: Result) -> str:
    """Tell what a point of the phase plot is, and when thinning leaves too little of it."""
    assert r.trace is not None  # the caller draws no plot without one
    step = float(np.median(np.diff(r.trace.t))) if len(r.trace.t) > 1 else 0.0
    note = (
        f"One point per {words.duration(step)}. With a gap, PV stays level while OP travels across it at each reversal."
    )
    cycles = r.half_periods.delta_t[r.half_periods.reason == 0]
    if len(cycles) and step > float(np.median(cycles)) / 8:
        note += " The points lie too far apart for this recording: the shape of a single cycle is lost."
    return note


def _explanations() -> str:
    limits = "".join(f"<li>{escape(text)}</li>" for text in words.LIMITS)
    reasons = "".join(
        f'<div><dt><span class="swatch r-{name}"></span>{reason.label}</dt><dd>{reason.meaning}</dd></div>'
        for name, reason in words.REASONS.items()
    )
    verdicts = (
        ("Backlash, stiction, both", "OP and PV show a lost motion, with a 95 % interval of its width."),
        ("At least", "they show one, and only how wide it is at least."),
        ("Sound", "no gap wider than the limit: with 95 % confidence, of a hundred such limits five are too low."),
        ("Oscillation", "the loop swings in a clean sinusoid, which is not its valve's doing."),
        ("Cannot tell", "OP and PV fit with a gap and without one."),
        ("Estimate", "nothing was fitted; at least N detections stand behind the width."),
        ("Provisional", "nothing was fitted; fewer than N detections; the width may still move."),
        ("No estimate", "nothing was fitted, and no half-period was fit to measure on."),
        ("Refused", "data or settings do not allow an analysis; the reason is named."),
    )
    told = "".join(f"<div><dt>{label}</dt><dd>{text}</dd></div>" for label, text in verdicts)
    return (
        '<section class="explain"><h2>How to read this report</h2>'
        f"<ul>{limits}</ul>"
        "<p>A half-period is the time between two crossings of PV through SP. Δt is its length, Δy the mean distance "
        "of PV from SP in it, e_max the largest. The detector judges each by these tests, in this order:</p>"
        f'<dl class="terms">{reasons}</dl><p>A loop ends in one verdict:</p>'
        f'<dl class="terms">{told}</dl></section>'
    )


def _badge(r: Result) -> str:
    return f'<span class="badge {r.answer.valve}">{words.VERDICTS[r.verdict]}</span>'


def _quality_cell(r: Result) -> str:
    """Name the findings that matter, two at most."""
    codes = [f.code.replace("_", " ") for f in r.quality if f.severity != "info"]
    more = f" and {len(codes) - 2} more" if len(codes) > 2 else ""
    return escape(", ".join(codes[:2]) + more) or "–"


def _breakable(name: str) -> str:
    """Let long tags break where people break them: after a dot, slash, dash, underscore or colon."""
    return "".join(escape(c) + ("<wbr>" if c in "./\\-_:" else "") for c in name)


def _pv_unit(r: Result) -> str:
    return r.loop.pv_unit or "PV unit"


def _gain_unit(r: Result) -> str:
    return f"{words.op_unit(r)} per {_pv_unit(r)}"


def _typed(value: float | None) -> str:
    """Write a setting as a person typed it, not rounded as a measured number is."""
    return "–" if value is None else f"{value:.8g}"


def _span(span: tuple[float, float] | None, unit: str) -> str:
    return "–" if span is None else f"{_typed(span[0])} to {f'{_typed(span[1])} {unit}'}"


def _file_name(name: str) -> str:
    """Make a loop's name safe for any file system."""
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in name)[:60] or "loop"


def _figure(key: str, name: str, figure: go.Figure, label: str) -> str:
    """Leave the place for a figure, at its final height so that the page does not jump."""
    side = f";max-width:{figure.layout.width}px" if figure.layout.width else ""
    return (
        f'<div class="plot" role="img" aria-label="{escape(label)}" data-key="{key}" data-name="{name}" '
        f'style="height:{figure.layout.height}px{side}"></div>'
    )


def _payload(key: str, drawn: Mapping[str, go.Figure]) -> str:
    """Store figures as JSON, every array once: the lines of a loop share their time, and the figures their signals."""
    arrays: dict[str, int] = {}
    specs: list[Any] = []

    def shared(node: Any) -> Any:
        if isinstance(node, dict):
            if "bdata" in node:
                name = json.dumps(node, sort_keys=True)
                if name not in arrays:
                    arrays[name] = len(specs)
                    specs.append(node)
                return {"$": arrays[name]}
            return {k: shared(v) for k, v in node.items()}
        return [shared(v) for v in node] if isinstance(node, list) else node

    stored = {name: shared(json.loads(figure.to_json())) for name, figure in drawn.items()}
    for figure in stored.values():
        figure["layout"].pop("width", None)  # the page decides
    text = json.dumps({"arrays": specs, "figures": stored}, separators=(",", ":"), ensure_ascii=False)
    return f'<script type="application/json" id="data-{key}">{text.replace("<", chr(92) + "u003c")}</script>'
