"""Modules of the package import no module that imports them, on whatever way, and no room above their own."""

import ast
import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "python" / "glapp"

BELOW = {
    "cli": {"station", "service", "fleet", "report", "reading", "tuning", ""},
    "station": {"service", "report", "reading", "tuning", ""},
    "service": {"reading", ""},
    "fleet": {"report", "reading", ""},
    "report": {""},
    "reading": {""},
    "tuning": {""},
    "": {"reading", "tuning"},
}
"""Rooms that the modules of a room may import; "" is the folder `glapp` itself."""


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__")


def room_of(module: str) -> str:
    first, _, _ = module.removeprefix("glapp").removeprefix(".").partition(".")
    return first if (ROOT / first).is_dir() else ""


def imports(source: str, package: str, known: set[str]) -> Iterator[str]:
    """Modules that a source imports, anywhere in it: in functions and for types as well."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                full = f"{base}.{alias.name}"
                yield full if full in known else base
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def graph() -> dict[str, set[str]]:
    """Imports of every module within the package; the compiled one has none."""
    paths = {name_of(path): path for path in ROOT.rglob("*.py")}
    known = {*paths, "glapp._glapp"}
    found = {}
    for name, path in paths.items():
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        found[name] = {one for one in imports(path.read_text("utf-8"), package, known) if one in known} - {name}
    return found


def test_no_module_imports_itself_by_way_of_others() -> None:
    try:
        TopologicalSorter(graph()).prepare()
    except CycleError as error:
        pytest.fail(" → ".join(error.args[1]))


def test_no_room_imports_one_above_it() -> None:
    wrong = [
        f"{name} imports {one}"
        for name, modules in graph().items()
        for one in modules
        if name not in ("glapp", "glapp.__main__") and room_of(one) not in {room_of(name), *BELOW[room_of(name)]}
    ]
    assert wrong == []


def test_a_file_enters_names_and_values_once() -> None:
    """No form of files reads cells or assigns columns: `rows` and `columns` do, whatever the form."""
    modules = graph()

    def importers(of: str) -> set[str]:
        return {name.removeprefix("glapp.") for name, used in modules.items() if f"glapp.reading.{of}" in used}

    beside = {"reading.shape", "fleet.lake"}
    assert importers("values") == {"reading.rows", "reading.columns", "reading.source", "service.opcua_values", *beside}
    assert importers("columns") == {"reading", "reading.wide", "reading.long", *beside}


def test_sql_stands_in_one_module() -> None:
    sql = re.compile(r"\b(SELECT|INSERT|REPLACE INTO|DELETE FROM|UPDATE \w+ SET|PRAGMA)\b")
    assert [name_of(path) for path in ROOT.rglob("*.py") if sql.search(path.read_text("utf-8"))] == [
        "glapp.service.store"
    ]


def test_what_a_module_imports_is_found() -> None:
    source = "from . import a\nfrom ..b import C\ndef f():\n    from .d.e import g\nimport glapp.h\n"
    known = {"glapp.r.a", "glapp.b", "glapp.r.d.e", "glapp.h"}
    assert sorted(imports(source, "glapp.r", known)) == sorted(known)
