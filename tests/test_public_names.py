"""Names use the words of CONTRIBUTING: each word there exists, and no public name has a word that was given up."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.main import get_command

from glapp.cli import app

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")

#: A word that was given up, and what is said instead.
OLD = {
    "beat": "heartbeat",
    "beats": "heartbeat",
    "bump": "step test",
    "census": "data statistics",
    "door": "API",
    "doors": "API",
    "drill": "watchdog test",
    "drilled": "watchdog test",
    "echo": "autocorrelation",
    "foreseen": "predicted",
    "shaken": "unsampled",
    "strays": "misfit",
    "said": "what it gives: facts, texts, a verdict",
    "standings": "compensation states",
    "told": "what it gives: to_text, texts_of, ..._from_core",
}
#: Names that were given up as a whole.
OLD_CLASSES = {"Bounds", "Lock", "Memory", "MemoryFull", "Problem", "Rows", "Signals", "Watch"}
#: Where names follow those of Structured Text and the vectors.
OF_THE_BLOCKS = "crates/core/"


def words(name: str) -> set[str]:
    """The words of a name in any case: `told_of`, `toldOf` and `ToldOf` have two."""
    return {word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)}


def in_python(path: Path, text: str) -> Iterator[str]:
    """Public names of a module: its own, constants, classes, functions and methods, and what `__all__` has."""
    yield path.stem
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign | ast.AugAssign):
            names = [one.id for one in ast.walk(node) if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)]
            yield from names
            if names == ["__all__"]:
                yield from (str(one.value) for one in ast.walk(node) if isinstance(one, ast.Constant))


def in_rust(path: Path, text: str) -> Iterator[str]:
    """Public names of a file of Rust."""
    yield path.stem
    for kind in ("fn", "struct", "enum", "mod", "type", "trait", "const"):
        yield from re.findall(rf"\bpub(?:\([a-z ]+\))? {kind} (\w+)", text)


def public() -> Iterator[tuple[str, str]]:
    """Every public name with its file."""
    for path in sorted((ROOT / "python/glapp").rglob("*.py")):
        found = in_python(path, path.read_text(encoding="utf-8"))
        yield from ((str(path.relative_to(ROOT)), name) for name in found if not name.startswith("_"))
    for path in sorted((ROOT / "crates").glob("*/src/**/*.rs")):
        found = in_rust(path, path.read_text(encoding="utf-8"))
        yield from ((str(path.relative_to(ROOT)), name) for name in found)


def commands(group: object, path: str = "glapp") -> Iterator[tuple[str, str]]:
    """Every command and option of the command line."""
    for name, command in getattr(group, "commands", {}).items():
        yield path, name
        yield from ((f"{path} {name}", option) for one in command.params for option in one.opts)
        yield from commands(command, f"{path} {name}")


NAMES = [*public(), *commands(get_command(app))]


def test_no_public_name_has_an_old_word() -> None:
    assert len(NAMES) > 2000
    ours = [(where, name) for where, name in NAMES if not where.startswith(OF_THE_BLOCKS)]
    found = [(where, name, OLD[word]) for where, name in ours for word in sorted(words(name) & OLD.keys())]
    assert found == []


def test_no_class_has_an_old_name() -> None:
    assert [(where, name) for where, name in NAMES if where.endswith(".py") and name in OLD_CLASSES] == []


@pytest.mark.parametrize(
    ("text", "old"),
    [("def told_of(x): ...", "told"), ("class DoorServer: ...", "door"), ("__all__ = ['STANDINGS']", "standings")],
)
def test_an_old_word_is_found(text: str, old: str) -> None:
    names = in_python(Path("x.py"), text)
    assert old in set().union(*map(words, names)) & OLD.keys()


def test_an_old_word_is_found_in_rust() -> None:
    names = in_rust(Path("x.rs"), "pub(crate) fn told(x: u8) {}\npub struct Census;")
    assert set().union(*map(words, names)) & OLD.keys() == {"told", "census"}


def rows() -> list[list[str]]:
    """The glossary's nouns: word, meaning, names in the code."""
    table = TEXT.split("| noun | what it is | in the code |\n|---|---|---|\n")[1].split("\n\n")[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.split("\n")]


def test_each_noun_is_there_once() -> None:
    nouns = [noun for row in rows() for noun in row[0].split(", ")]
    assert len(nouns) > 20 and len(set(nouns)) == len(nouns) and nouns == sorted(nouns, key=str.lower)


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_a_noun_is_a_name_in_the_code(row: list[str]) -> None:
    known = {name for _, name in NAMES} | {"api-url"}
    named = re.findall(r"`([^`]+)`", row[2])
    assert named
    for name in named:
        assert name.split(" ")[-1] in known or name == "standing", name
