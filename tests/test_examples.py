"""The examples run, and tell the same story in every language."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from programs import built

EXAMPLES = Path(__file__).parents[1] / "examples"


def output_of(*command: str) -> str:
    done = subprocess.run(command, cwd=EXAMPLES.parent, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_python_example_runs(path: Path) -> None:
    assert output_of(sys.executable, str(path)).strip()


@pytest.mark.verify
def test_the_notebook_runs_from_its_first_cell_to_its_last() -> None:
    cells = json.loads((EXAMPLES / "fleet.ipynb").read_text())["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert len(code) > 5 and not any(cell["outputs"] for cell in cells if cell["cell_type"] == "code")
    assert "in truth" in output_of(sys.executable, "-c", "\n".join(code))


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.rs")), ids=lambda path: path.name)
def test_rust_example_prints_what_its_python_twin_prints(path: Path) -> None:
    assert output_of(built("sim", "example", path.stem)) == output_of(sys.executable, str(path.with_suffix(".py")))
