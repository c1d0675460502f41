"""The examples run, and tell the same story in every language."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from programs import built

from glapp.station import lab

EXAMPLES = Path(__file__).parents[1] / "examples"


def output_of(*command: str) -> str:
    done = subprocess.run(command, cwd=EXAMPLES.parent, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_python_example_runs(path: Path) -> None:
    assert output_of(sys.executable, str(path)).strip()


def read(notebook: Path) -> tuple[str, str]:
    """The program of a notebook, and its text."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    assert not any(cell["outputs"] for cell in cells if cell["cell_type"] == "code"), "outputs are not kept"
    program, text = (
        "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == kind)
        for kind in ("code", "markdown")
    )
    return program, text


@pytest.mark.verify
def test_the_notebook_runs_from_its_first_cell_to_its_last() -> None:
    program, _ = read(EXAMPLES / "fleet.ipynb")
    assert "in truth" in output_of(sys.executable, "-c", program)


COURSE = sorted((EXAMPLES / "course").glob("*.ipynb"))


@pytest.mark.verify
@pytest.mark.parametrize("path", COURSE, ids=lambda path: path.stem)
def test_a_notebook_of_the_course_runs_with_its_answers(path: Path) -> None:
    """The answers end in assertions, so that a wrong one ends the program."""
    program, _ = read(path)
    assert program.count("\nassert ") >= 2
    assert output_of(sys.executable, "-c", program).strip()


def test_the_course_is_whole() -> None:
    """Five notebooks, each with as many answers as exercises; their links lead somewhere."""
    assert len(COURSE) == 5
    laboratory = {f"{part.name}.{name}" for part in lab.THESIS.parts for name in vars(part.module())}
    for path in COURSE:
        program, text = read(path)
        exercises, answers = (text.split("## Exercises")[1] + program).split("## Answers")
        asked = re.findall(r"^(\d)\. ", exercises, flags=re.MULTILINE)
        numbers = {found[0] or found[1] for found in re.findall(r"^(?:# (\d)\.|(\d)\. )", answers, flags=re.MULTILINE)}
        assert len(asked) >= 3 and numbers == set(asked), path.name
        for link in re.findall(r"\]\(([^)]+)\)", text):
            page, _, settings = link.partition("#laboratory")
            if settings:
                assert page == "../../dist/page/index.html"
                assert {one.partition("=")[0] for one in settings.removeprefix("?").split("&")} <= laboratory
            else:
                assert (path.parent / link).is_file(), link


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.rs")), ids=lambda path: path.name)
def test_rust_example_prints_what_its_python_twin_prints(path: Path) -> None:
    assert output_of(built("sim", "example", path.stem)) == output_of(sys.executable, str(path.with_suffix(".py")))
