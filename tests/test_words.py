"""The words: one catalogue in the crates, and nothing about an answer that reaches a person by another way."""

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from glapp import _glapp
from glapp._glapp import to_text
from glapp.escape import one_line
from glapp.report import words
from page import build

ROOT = Path(__file__).parents[1]
VECTORS = json.loads((ROOT / "crates/analysis/src/words/vectors.json").read_text(encoding="utf-8"))

#: Modules that show an answer.
SHOWING = [
    *(f"{name}.py" for name in ("quality", "fit", "estimate", "identify", "step_test", "valve", "result", "row")),
    "several_recordings.py",
    *(f"report/{name}.py" for name in ("words", "view", "html", "figures", "fit_figure")),
    *(f"cli/{name}.py" for name in ("analyze", "step_test", "screen", "explain")),
    *(f"fleet/{name}.py" for name in ("report", "windows")),
    "station/view.py",
]

#: What stands beside answers there: beginnings of texts, and why they are none of the catalogue's.
BESIDE = {
    "labels of figures, tables and pictures": [
        ", the usual limit: none was given",
        "OP travel by the PI law",
        "SP, PV [PV unit]",
        "OP, position [OP unit]",
        "not excluded by OP and PV",
        "width of the gap [",
        "OP to the valve's position",
        "load at the input",
        "load whose slope walks",
        "drift at the output",
        "Dead bands of control loops",
        "Answers and what the workshop found",
        "Before and after the repair",
        "\nBefore and after the repair, {}",
        "Valves of the fleet",
        "Error gap of the controller",
        "Output dead band of the controller",
        "PV filter of the control system",
        "Filter of the detector TF",
        "Longest step between samples",
        "ΔPV in the same direction",
        "OP %{",
        "{} %{",
        "{}<br>",
        "PV and OP were not both recorded.",
        "No trace: the loop was refused",
        "One point per {}.",
        " The points lie too far apart",
        "no Δy before it to compare with",
        "bound (5.1) not applied yet",
        "by the measured position in",
        "{} detections in {} half-periods",
    ],
    "one half-period, number by number": [
        "at '{}' runs a half-period",
        "The half-period at '{}'",
        "\nand {} more that are shorter",
        "{}, half-period {} of",
        "PV neither above nor below SP",
        "{} (mean distance of PV",
        "{} (K/Ti·∫|e|dt",
        "OP turn to turn",
        "{} (since its turn in",
        "{} (where PV came to rest",
    ],
    "what the methods are, of no loop": [
        "The gap from OP and PV",
        "Zero crossings: what a PLC",
        "A model of the loop, from OP",
        "It needs an OP that reverses",
        "Two things mislead it most easily",
        "The width is worked out from",
        "Load changes while the loop",
        "A sound valve in",
        "Silence proves nothing",
        "On 1104 simulated",
        "A width has two limits",
        " On 2800 more",
        "Where there was no gap",
        "It is silent rather than",
        "Evidence is strong where",
        "Before work is ordered",
    ],
    "what was read of a lake, of no valve": [
        " ({}, as far as is known)",
        "{} could not be read",
        "{} left out for time",
        "{} left out: no column",
        "{} % of PV lies outside",
        "{} chosen windows have fewer",
        "{} % of the window's PV",
        "{} rows are there more",
        "{} rows say something else",
        "find out which export",
        "check unit and span",
    ],
    "what the service does, not what an answer is": [
        "the service has not written",
        "The plant's server is not connected",
        "Find out why no value comes",
        "The time stamps of its values",
        "{}. Correct the tag in loops.toml",
        "Look at the transmitter",
        "Set the clocks of plant",
        "{}: write them into loops.toml.",
        "{}It will be judged",
        "Will be judged next.",
        "Will be judged after",
    ],
}

#: What page/*.js says itself.
BESIDE_ON_THE_PAGE = {
    "pictures and tables, explained": [
        "There are no half-periods",
        "As used: ideal form",
        "PV against OP",
        "The process between valve",
        "The first reason that applied",
        "Findings on the recording",
        "A line is a family",
        "Plan a test with",
        "Drag to zoom, double-click",
        "The evidence, for the engineer",
        "What a PLC would show, from zero",
        "The gap from OP and PV",
        "${from}. The fit of OP",
        "${shown.from}. The fit",
        "Filter of the detector",
        "PV and SP over time",
        "likelihood over the width",
        "(prefers-color-scheme",
        "http://www.w3.org/2000/svg",
        "<!doctype",
        "<meta",
        "default-src",
        "width of the gap",
        "PV against OP, with",
    ],
    "how far an analysis is": [
        "From zero crossings",
        "Fitting the gap",
        "Joining what the windows",
        "Looking at quality",
        "${stage} ${reply.windows}",
        "${verdict(answer)} ${headline}",
        "${so} The true gap",
        "The fit was ended",
        "Fit what is recorded",
    ],
    "what is wrong with an input or a program": [
        "the ${what} broke off",
        "TD: give K and TI",
        "one recording is read at",
        "cannot be read (${fault",
        "Loop, one of",
        "span of ${of",
        "the analysis broke off",
        "K and TI: give both",
        "The fit broke off",
        "one of its workers died",
    ],
}

WORD = re.compile(r"[A-Za-zÄÖÜäöüß]{2,}")

#: What is raised, or handed to the command line as help, tells of an input and not of an answer.
OF_INPUTS = {"CommandError", "Option", "Argument", "DataIssue", "say_note", "say_error"}


class _Texts(ast.NodeVisitor):
    """Literals of more than three words that are no docstring and tell of no input."""

    def __init__(self) -> None:
        self.found: list[tuple[int, str]] = []

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        pass

    def visit_Call(self, node: ast.Call) -> None:
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if name not in OF_INPUTS and not name.endswith("Error"):
            self.generic_visit(node)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        self._take("".join(part.value if isinstance(part, ast.Constant) else "{}" for part in node.values), node.lineno)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, str):
            self._take(node.value, node.lineno)

    def _take(self, text: str, line: int) -> None:
        if len(WORD.findall(text)) > 3:
            self.found.append((line, text))


def texts_of(source: str) -> list[tuple[int, str]]:
    texts = _Texts()
    texts.visit(ast.parse(source))
    return texts.found


def texts_of_script(source: str) -> Iterator[tuple[int, str]]:
    for line, text in enumerate(source.splitlines(), 1):
        code = re.sub(r"(?<!:)//.*$", "", text)
        for literal in re.findall(r'"(?:[^"\\]|\\.)*"|`(?:[^`\\]|\\.)*`', code):
            if len(WORD.findall(re.sub(r"\$\{[^}]*\}", "", literal))) > 3:
                yield line, literal[1:-1]


def allowed(text: str, beside: dict[str, list[str]]) -> bool:
    return any(text.startswith(beginning) for beginnings in beside.values() for beginning in beginnings)


@pytest.mark.parametrize("name", SHOWING)
def test_what_is_told_of_an_answer_comes_from_the_catalogue(name: str) -> None:
    source = (ROOT / "python/glapp" / name).read_text(encoding="utf-8")
    assert [(line, text) for line, text in texts_of(source) if not allowed(text, BESIDE)] == []


@pytest.mark.parametrize("path", sorted((ROOT / "page").glob("*.js")), ids=lambda path: path.stem)
def test_the_page_words_nothing_itself(path: Path) -> None:
    found = texts_of_script(path.read_text(encoding="utf-8"))
    if path.stem in build.READER:  # they tell of files alone, as InputErrors
        return
    assert [(line, text) for line, text in found if not allowed(text, BESIDE_ON_THE_PAGE)] == []


def test_a_sentence_beside_the_catalogue_is_found() -> None:
    planted = (
        'def f(r):\n    """A docstring of more than three words."""\n    return f"The valve of {r} sticks a bit"\n'
    )
    assert [(line, allowed(text, BESIDE)) for line, text in texts_of(planted)] == [(3, False)]
    assert texts_of('raise InputError("has no column for the signal")') == []
    script = "const a = `The valve of ${name} sticks a bit`; // a comment of many words\n"
    assert [line for line, text in texts_of_script(script) if not allowed(text, BESIDE_ON_THE_PAGE)] == [1]


def test_every_text_that_is_allowed_is_there() -> None:
    """An allowance that nobody needs would hide the next sentence that begins so."""
    sources = [(ROOT / "python/glapp" / name).read_text(encoding="utf-8") for name in SHOWING]
    texts = [text for source in sources for _, text in texts_of(source)]
    assert [b for all_of in BESIDE.values() for b in all_of if not any(text.startswith(b) for text in texts)] == []
    scripts = [path.read_text(encoding="utf-8") for path in (ROOT / "page").glob("*.js")]
    texts = [text for script in scripts for _, text in texts_of_script(script)]
    unused = [
        b for all_of in BESIDE_ON_THE_PAGE.values() for b in all_of if not any(text.startswith(b) for text in texts)
    ]
    assert unused == []


def test_numbers_are_written_as_before() -> None:
    """Values at random, as Python wrote them before the crates did."""
    for kind, of, wanted in VECTORS["numbers"]:
        if kind != "format":
            assert getattr(_glapp, kind)(*of) == wanted, (kind, of)
    assert words.number(float("nan")) == words.number(float("inf")) == "–"


@pytest.mark.parametrize(
    ("code", "numbers", "sentence"),
    [
        ("quality.shifts", {"rows": "3 7", "count": 5}, "(row 5, row 9 and more)"),
        ("crossings.disagree", {"kept": 2, "count": 9}, "2 of the last 9 lie within 20 % of their median"),
        ("identification.gain_may_be_none", {"size": 1.0, "k_low": 0.0, "k_high": float("inf")}, "1, 0 to inf"),
        ("fit.not_counted", {"why": "x", "names": "a.csv, b.csv"}, "Not counted, since x: a.csv, b.csv"),
        (
            "fit.changed",
            {"said": {"code": "left_out.misfit"}, "trend": {"code": "left_out.still", "numbers": {}}},
            "no model fits it; the valve would hardly move",
        ),
    ],
)
def test_a_message_is_told(code: str, numbers: dict[str, object], sentence: str) -> None:
    assert sentence in to_text(code, numbers)


def test_what_is_missing_is_named() -> None:
    with pytest.raises(ValueError, match=r"message 'crossings\.noise' has no 'd'"):
        to_text("crossings.noise", {"floor": 1.0})
    with pytest.raises(ValueError, match="'d' cannot be written as"):
        to_text("crossings.noise", {"d": "wide", "floor": 1.0})
    with pytest.raises(ValueError, match=r"no message 'crossings\.nothing'"):
        to_text("crossings.nothing")


def test_no_sentence_of_the_catalogue_hides_a_character() -> None:
    assert [code for code, text in _glapp.catalogue() if one_line(text) != text] == []


def test_what_the_page_takes_from_the_reader_is_there() -> None:
    taken = build.reader_data()
    assert taken["columns"]["separators"] and taken["values"]["number"] and taken["heads"]["lines"]
