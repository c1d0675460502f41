"""Everything that the documentation tells to type exists.

Examples with `>>>` are doctests. `test_cli.py` runs the commands of `docs/cli.md`, `start.md` and `score.md`.
`test_settings.py`, `test_scenario.py` and `test_service_opcua.py` read the settings. `plc/check` runs the Structured
Text, and `test_c.py` compiles the C.
Here stands what is left: every command of every page, with its options, and the programs that are no doctest.
"""

from __future__ import annotations

import re
import shlex
from functools import cache
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.main import get_command

import glapp
from glapp import fleet
from glapp.cli import app

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def typed(page: Path) -> list[str]:
    """Every line of a program and every piece of code in a sentence."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```\w*\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    rest = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    lines = [line for block in blocks for line in block.splitlines()]
    return [one.strip() for one in [*lines, *re.findall(r"`([^`\n]+)`", rest)]]


def commands() -> list[tuple[str, str]]:
    """Page and command line of each `glapp …` with more than a name."""
    found = []
    for page in PAGES:
        for line in typed(page):
            command = re.match(r"(?:\.venv/bin/|uv run )?(glapp [a-z-].*)", line)
            # A sentence of a fence, or what a command prints.
            if command and not re.match(r"glapp (is|reads|finds|thesis$)", command[1]):
                found.append((page.name, re.split(r"\s#|\s[>|]\s", command[1].replace("\\|", "|"))[0].strip()))
    return list(dict.fromkeys(found))


def parsed(line: str) -> None:
    """Parse a command line as the program does, and do nothing."""
    words = [word for word in shlex.split(line)[1:] if word not in ("…", "...")]
    command = get_command(app)
    context = command.make_context("glapp", words)
    while hasattr(command, "resolve_command") and (rest := [*context._protected_args, *context.args]):
        name, command, rest = command.resolve_command(context, rest)
        context = command.make_context(name, rest, parent=context)


@pytest.mark.slow
def test_every_command_in_the_docs_can_be_typed() -> None:
    lines = commands()
    assert len(lines) > 60
    wrong = []
    for page, line in lines:
        try:
            parsed(line)
        except typer.Exit:  # it has shown its help
            pass
        except Exception as error:
            # A sentence often names a command without its arguments.
            if type(error).__name__ not in ("MissingParameter", "NoArgsIsHelpError"):
                wrong.append(f"{page}: {line}: {error}")
    assert not wrong, "\n".join(wrong)


def test_every_target_and_bench_in_the_docs_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z]+):", makefile, flags=re.MULTILINE))
    lines = [line for page in PAGES for line in typed(page)]
    asked = {found[1] for line in lines if (found := re.match(r"make ([a-z]+)", line))}
    assert len(asked) > 8
    assert asked <= targets
    benches = {found[1] for line in lines if (found := re.match(r"python -m (bench[\w.]*)", line))}
    missing = {name for name in benches if not (ROOT / f"{name.replace('.', '/')}.py").exists()}
    missing -= {name for name in missing if (ROOT / name.replace(".", "/") / "__main__.py").exists()}
    assert len(benches) > 5
    assert not missing


def python_without_doctests(page: Path) -> list[str]:
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return [block for block in blocks if ">>>" not in block]


def test_no_program_escapes() -> None:
    """A program that is no doctest is checked below; a new one needs its test, or `>>>`."""
    assert {page.name: len(found) for page in PAGES if (found := python_without_doctests(page))} == {
        "fleet.md": 2,
        "platform.md": 1,
        "start.md": 1,
    }


@pytest.mark.slow
def test_the_program_of_the_first_recording_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    import pandas as pd
    import plotly.graph_objects as go

    shown = []
    monkeypatch.setattr(go.Figure, "show", lambda figure, *_, **__: shown.append(figure))
    sim = glapp.simulate.closed_loop(
        "P3", (0.48, 0.3117), d=5.0, noise=0.1, h=0.1, t_end=120, setpoint=[(1, 50.0)], seed=1
    )
    names = {"t": sim.t, "sp": sim.sp, "pv": sim.pv, "op": sim.op}
    frame = pd.DataFrame({"t [s]": sim.t, "SP": sim.sp, "PV": sim.pv, "OP": sim.op})
    [program] = python_without_doctests(ROOT / "docs/start.md")
    exec(program, {**names, "dataframe": frame, "np": np})
    assert len(shown) == 1


def test_the_program_of_the_fleet_has_functions_that_are_there() -> None:
    """The functions are tested in `test_fleet.py` and `test_fleet_stream.py`: a lake takes longer than this."""
    for page in ("fleet", "platform"):
        for program in python_without_doctests(ROOT / f"docs/{page}.md"):
            called = re.findall(r"fleet\.(\w+)\(", program)
            assert called and all(callable(getattr(fleet, name)) for name in called)


def test_every_test_that_a_table_names_exists() -> None:
    """Tables list the tried cases, each row with its test."""
    there = {name for path in (ROOT / "tests").glob("*.py") for name in re.findall(r"def test_(\w+)", path.read_text())}
    files = {path.name for path in (ROOT / "tests").glob("test_*.py")}
    there |= {name.removesuffix(".py").removeprefix("test_") for name in files}
    found = []
    for page in (ROOT / "SECURITY.md", *PAGES, *sorted((ROOT / "bench/results").glob("*.md"))):
        heads: list[str] = []
        for line in page.read_text(encoding="utf-8").splitlines():
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            for head, cell in zip(heads, cells, strict=False):
                if head in ("test", "tried in"):
                    found += [(page.name, name.removeprefix("test_")) for name in re.findall(r"`(\w+)`", cell)]
                    assert set(re.findall(r"`tests/([^`]+)`", cell)) <= files, f"{page.name}: {cell}"
            heads = heads or cells if line.startswith("|") else []
    assert len(found) > 150 and [one for one in found if one[1] not in there] == []


MADE = {"plc-blocks.md", "catalogue.md"}
"""Pages that only `make site` makes."""


@cache
def anchors(page: Path) -> set[str]:
    """The places of a page that a link can name: its headings, and what it marks itself."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    headings = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", one) for one in re.findall(r"^#+ (.+)$", text, re.MULTILINE)]
    marks = set(re.findall(r'<a id="([^"]+)"', text))
    return marks | {re.sub(r"[^\w\- ]", "", one.lower()).replace(" ", "-") for one in headings}


def test_every_link_leads_to_a_page_and_a_heading() -> None:
    """Regression: `mkdocs --quiet --strict` let every warning pass, and two links led to a renamed heading."""
    pages = [*PAGES, *(ROOT / f"{name}.md" for name in ("CHANGELOG", "SECURITY"))]
    pages += [
        *(ROOT / "docs/adr").glob("*.md"),
        ROOT / "docs/gallery/README.md",
        *(ROOT / "bench/results").glob("*.md"),
    ]
    wrong, checked = [], 0
    for page in pages:
        text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        for link in re.findall(r"\]\(([^):\s]+)\)", text):
            path, _, anchor = link.partition("#")
            to = page.parent / path if path else page
            checked += 1
            if to.name in MADE or anchor.startswith("glapp."):  # the site has these, and `make site` checks them
                continue
            if not to.exists() or (anchor and anchor not in anchors(to)):
                wrong.append(f"{page.relative_to(ROOT)}: {link}")
    assert checked > 500
    assert wrong == []


@pytest.mark.parametrize(("page", "module"), [("api.md", "glapp"), ("api-laboratory.md", "glapp.tuning")])
def test_a_function_named_as_its_module_is_in_the_reference(page: str, module: str) -> None:
    """The site leaves it out where only the package is named: `glapp.fit` and `tuning.migo` were not there."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    package = import_module(module)
    assert package.__file__ is not None
    files = {path.stem for path in Path(package.__file__).parent.glob("*.py")}
    hidden = [name for name in package.__all__ if name in files and callable(getattr(package, name))]
    assert len(hidden) > 3
    for name in hidden:
        assert f"\n::: {getattr(package, name).__module__}.{name}\n" in text


def test_no_docstring_of_the_reference_has_a_table_that_the_site_does_not_draw() -> None:
    python, checked = ROOT / "python/glapp", 0
    for page in ("api.md", "api-laboratory.md"):
        for name in re.findall(r"^::: glapp\.?(\w*)", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.MULTILINE):
            folder = python / name
            for path in folder.glob("*.py") if name and folder.is_dir() else [python / f"{name or '__init__'}.py"]:
                assert not re.search(r"^ *=====", path.read_text(encoding="utf-8"), re.MULTILINE), path
                checked += 1
    assert checked > 15
