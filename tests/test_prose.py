"""The documentation is readable: short sentences in their usual order, and no word that makes a reader stop."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted(
    [
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "plc/blocks.md")),
        *(ROOT / "docs").glob("*.md"),
        *(ROOT / "docs/adr").glob("*.md"),
        *(ROOT / "bench/results").glob("*.md"),
    ]
)
CODE = (
    *(f"crates/{crate}" for crate in ("analysis", "capi", "core", "lake", "lanes", "page", "py", "sim")),
    *("python", "bench", "tests", "thesis", "vectors", "wheels", "requirements", "fuzz", "examples"),
)
MOST, MEAN = 30, 17
"""Words in a sentence, and in those of a page on average."""
STIFF = ("in order to", "leverage", "utilise", "utilize", "aforementioned", "feign", "feigned", "feigns")
ARCHAIC = (
    *("albeit", "amongst", "befall", "befalls", "besides", "hence", "hitherto", "lest", "oftener", "save where"),
    *("therein", "thereof", "to and fro", "told apart", "told from", "unto", "upon", "whence", "wherein"),
    *("whereof", "whilst", "is to be had"),
)
"""Words that nobody says today. Code is held to these too, in docstrings and comments."""
BESIDE = ("beside", "is told", "are told", "be it")
"""Said in another way on pages: next to, with, compared with; is reported, is shown; also."""
INVERTED = re.compile(
    r"(?:Here|There|Below|Above|Behind|Under|Over|Within|Beyond|In|Next to) (?:it |them )?(?:stands?|lies?|comes?)\b"
    r"|(?:Nor|So|Such|Neither) (?:is|are|was|were|do|does|did|has|have|can|could|may|must|will|would)\b"
    r"|(?:(?!Speed|Need|Feed|Seed)[A-Z]\w+ed|Shown|Lost|Taken|Left|Given|Found|Held|Known|Written|Seen|Told|Put|Made)"
    r" (?:is|are|was|were)\b"
)
"""Beginning of a sentence whose subject comes behind its verb."""
LIKENESS = re.compile(r"(?:The same|As|Like|What|Where|How|Those|It)\b")
"""Beginning of a docstring that says what a thing is like, before what it is."""


def sentences(text: str) -> list[str]:
    """The sentences of a page, without its tables, headings, programs and formulas."""
    text = re.sub(r"```.*?```|<!--.*?-->", "\n\n", text, flags=re.DOTALL)
    blocks: list[list[str]] = [[]]
    for line in text.split("\n"):
        inner = line.strip()
        if not inner or inner.startswith(("|", "#")) or (line.startswith("    ") and not blocks[-1]):
            blocks.append([])
        elif item := re.match(r"(?:[-*+]|\d+\.)\s+(.*)", inner):
            blocks.append([item[1]])
        else:
            blocks[-1].append(inner)
    found = []
    for block in blocks:
        said = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", " ".join(block))
        found += re.split(r"(?<=[.!?])[)\"”*]*\s+", re.sub(r"`[^`]*`", "x", said))
    return [one for one in found if re.search(r"\w", one)]


def length(sentence: str) -> int:
    return sum(bool(re.search(r"[A-Za-z0-9]", word)) for word in sentence.split())


def test_a_sentence_is_found() -> None:
    text = "# No\n\nOne two [three](four.md). Five `six seven`\n- eight: nine!\n\n| no |\n```\nno\n```\n"
    assert [length(one) for one in sentences(text)] == [3, 2, 2]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_is_readable(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    lengths = [(length(one), one) for one in sentences(text)]
    assert [one for n, one in lengths if n > MOST] == []
    assert sum(n for n, _ in lengths) <= MEAN * max(len(lengths), 1)
    assert said(text, *STIFF, *ARCHAIC, *BESIDE) == []
    assert [one for _, one in lengths if INVERTED.match(one)] == []


def said(text: str, *words: str) -> list[str]:
    """Those of the words that a text has, but for code, links, and pins in the tables of Structured Text."""
    plain = re.sub(
        r"```.*?```|`[^`]*`|\]\([^)]*\)|<!--.*?-->|^\| \w+ \| [A-Z]+ \|.*?$", " ", text, flags=re.DOTALL | re.M
    )
    return [word for word in words if re.search(rf"\b{word}\b", plain, re.IGNORECASE)]


def test_order_and_old_words_are_found() -> None:
    for wrong in (
        "Here stands what is left.",
        "So is the width.",
        "Retained are all of them.",
        "Below it lies the rest.",
    ):
        assert INVERTED.match(wrong), wrong
    for right in ("So the width is known.", "Speed is measured.", "In the table stands all.", "Needed: all is there."):
        assert not INVERTED.match(right), right
    assert said("Hence `upon` it rests.\n```\nwhilst\n```", *ARCHAIC) == ["hence"]


def comments(path: Path) -> str:
    """Docstrings and comments of a source file."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".rs":
        return "\n".join(re.findall(r"(?<!:)//[/!]?(.*)", text))
    return "\n".join([*re.findall(r'"""(.*?)"""', text, re.DOTALL), *re.findall(r"(?:^|\s)# (.*)", text)])


def sources(*more: str) -> list[Path]:
    found = [
        path
        for folder in (*CODE, *more)
        for path in sorted((ROOT / folder).rglob("*"))
        if path.suffix in (".py", ".rs")
    ]
    assert len(found) > 200
    return found


def test_comments_have_no_old_words() -> None:
    found = {str(path.relative_to(ROOT)): old for path in sources() if (old := said(comments(path), *ARCHAIC))}
    assert found == {}


def beginnings(suffix: str, text: str) -> Iterator[str]:
    """First lines of the docstrings and doc comments of a source."""
    if suffix == ".rs":
        yield from re.findall(r"\n(?![ \t]*//[/!])[^\n]*\n[ \t]*//[/!] ([^\n]*)", f"\n\n{text}")
        return
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Module):
            yield from (ast.get_docstring(node) or "").split("\n")[:1]


def test_docstrings_say_first_what_a_thing_is() -> None:
    """One in a hundred may begin otherwise: "As `x`, in single precision." is clear where `x` stands above it."""
    paths = sources("crates/fit", "plc")
    firsts = [first for path in paths for first in beginnings(path.suffix, path.read_text("utf-8")) if first]
    found = [first for first in firsts if LIKENESS.match(first)]
    assert len(firsts) > 9000 and len(found) <= len(firsts) / 100, found


def test_a_docstring_of_likeness_is_found() -> None:
    rust = "//! Rows.\n\n/// The same in `f32`.\n/// And more.\nfn a() {}\n/// What is left.\nfn b() {}\n"
    assert list(beginnings(".rs", rust)) == ["Rows.", "The same in `f32`.", "What is left."]
    python = 'def a():\n    """Where it begins.\n\n    More.\n    """\n'
    assert [bool(LIKENESS.match(one)) for one in [*beginnings(".rs", rust), *beginnings(".py", python)] if one] == [
        *(False, True, True),
        True,
    ]
