"""The documentation is readable: short sentences, and no word that makes a reader stop."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "docs/adr").glob("*.md")]
)
MOST, MEAN = 30, 17
"""Words in a sentence, and in those of a page on average."""
BANNED = (
    "aforementioned",
    "feign",
    "feigned",
    "feigns",
    "hitherto",
    "in order to",
    "leverage",
    "thereof",
    "utilise",
    "utilize",
    "whilst",
)


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
    told = [(length(one), one) for one in sentences(text)]
    assert [one for n, one in told if n > MOST] == []
    assert sum(n for n, _ in told) <= MEAN * max(len(told), 1)
    assert [word for word in BANNED if re.search(rf"\b{word}\b", text, re.IGNORECASE)] == []
