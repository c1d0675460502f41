"""The figures as a gallery: pictures, a page with the numbers, and the numbers for other programs."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from glapp.writing import GENERATOR

from .differences import shown_by
from .figure import Number, Shown

__all__ = ["as_html", "as_json", "as_markdown", "recorded", "text"]

TITLE = "The figures of the thesis, recomputed"
ABOUT = (
    "O. Haventon and J. Öberg, Testing and implementation of a backlash detection algorithm, Lund University, "
    "TFRT-5826 (2008). Every picture comes from glapp's own simulator and detector; next to each number of the thesis "
    "is ours. `glapp thesis 5.1` prints all numbers of a figure; numbers.json has them."
)


DIFFERS = "Where the thesis does not hold"


def text(value: float | str | None) -> str:
    """A value as a person reads it; – for none."""
    return "–" if value is None else value if isinstance(value, str) else f"{value:.4g}"


def as_json(shown: Sequence[Shown]) -> str:
    """The numbers for other programs.

    {"5.1": {"title": …, "section": …, "why": …, "numbers": {what: {"unit", "thesis", "glapp", "same"}}}}
    """
    figures = {
        one.number: {
            "title": one.title,
            "section": one.section,
            "why": one.why,
            "numbers": {
                number.what: {
                    "unit": number.unit,
                    "thesis": number.thesis,
                    "glapp": number.ours,
                    "same": number.same,
                }
                for number in one.numbers
            },
        }
        for one in shown
    }
    return json.dumps(figures, ensure_ascii=False, indent=1) + "\n"


def recorded(shown: Shown, figure: Mapping[str, Any]) -> Shown:
    """A figure with the numbers of an earlier run, as `as_json` wrote them."""
    numbers = figure["numbers"]
    return replace(
        shown, numbers=tuple(replace(number, ours=numbers[number.what]["glapp"]) for number in shown.numbers)
    )


def as_markdown(shown: Sequence[Shown]) -> str:
    """The gallery as a page in Markdown, with its pictures and the numbers that the thesis has too."""
    parts = [f"# {TITLE}\n", ABOUT + "\n"]
    if differs := _differs(shown):
        rows = [f"| {' | '.join(cells)} |\n" for _, *cells in differs]
        parts.append("".join([f"## {DIFFERS}\n\n| section | it says | here | |\n|---|---|---|---|\n", *rows]))
    for one in shown:
        parts.append(f'<a id="{one.anchor}"></a>\n\n## {one.name}: {one.title}\n')
        parts.append(f"![{one.name}]({one.picture})\n")
        parts.append(f"{one.sentence} (Section {one.section})\n")
        compared = [number for number in one.numbers if number.thesis is not None]
        if compared:
            rows = [
                f"| {what} | {thesis} | {f'{ours} {unit}'.rstrip()} |\n" for what, thesis, ours, unit in _rows(compared)
            ]
            parts.append("".join(["| | thesis | glapp |\n|---|---:|---:|\n", *rows]))
        if one.difference:
            parts.append(f"*Difference:* {one.difference}\n")
    return "\n".join(parts)


_CSS = """body{font:16px/1.5 system-ui,sans-serif;color:#1f2933;max-width:760px;margin:2rem auto;padding:0 1rem}
img{max-width:100%}table{border-collapse:collapse}th,td{text-align:left;padding:.1rem 1rem .1rem 0;vertical-align:top}
td:nth-child(2),td:nth-child(3),th:nth-child(2),th:nth-child(3){text-align:right}h2{margin-top:3rem}
a{color:#1d5b9c}nav a{margin-right:.8rem;white-space:nowrap}"""


def as_html(shown: Sequence[Shown]) -> str:
    """The gallery as one page; it needs the pictures next to it and nothing else."""
    links = " ".join(f'<a href="#{one.anchor}">{_said(one.number)}</a>' for one in shown)
    parts = [
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width,initial-scale=1">',
        f"{GENERATOR}<title>{TITLE}</title><style>{_CSS}</style><h1>{TITLE}</h1><p>{_said(ABOUT)}</p><nav>{links}</nav>",
    ]
    if differs := _differs(shown):
        parts.append(f"<h2>{DIFFERS}</h2><ul>")
        parts += [
            f"<li>{_said(sentence)} ({_said(section)}). "
            f'Here <a href="#{one.anchor}">{_said(one.name)}</a>: {_said(here)}'
            for one, section, sentence, here, _ in differs
        ]
        parts.append("</ul>")
    for one in shown:
        parts.append(f'<h2 id="{one.anchor}">{_said(one.name)}: {_said(one.title)}</h2>')
        parts.append(f'<img src="{one.picture}" alt="{html.escape(one.sentence)}"><p>{_said(one.sentence)}')
        parts.append(f"(Section {_said(one.section)})</p><table><tr><th><th>thesis<th>glapp<th>unit")
        parts += ["<tr>" + "".join(f"<td>{_said(cell)}" for cell in cells) for cells in _rows(one.numbers)]
        parts.append("</table>")
        if one.difference:
            parts.append(f"<p><em>Difference:</em> {_said(one.difference)}</p>")
    return "\n".join(parts) + "\n"


def _said(text: str) -> str:
    """Text of Markdown as HTML: names of the code stand in back quotes there."""
    return re.sub("`(.+?)`", r"<code>\1</code>", html.escape(text))


def _differs(shown: Sequence[Shown]) -> list[tuple[Shown, str, str, str, str]]:
    """Figure; section, statement, our number in words, name of the figure."""
    return [
        (one, differs.section, differs.statement, f"{number.what}: {text(number.ours)} {number.unit}".strip(), one.name)
        for differs, one, number in shown_by(shown)
    ]


def _rows(numbers: Sequence[Number]) -> list[tuple[str, str, str, str]]:
    return [(number.what, text(number.thesis), text(number.ours), number.unit) for number in numbers]
