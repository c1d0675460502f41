"""docs/thesis.md: every name of its table exists, every command of it runs, every snippet that it points to is there.

The snippets themselves run as doctests of the page.
"""

import importlib
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from glapp import modules
from glapp.cli import main

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/thesis.md").read_text(encoding="utf-8")

CHAPTERS = {
    "2.1",
    "2.2",
    "6.1",
    "6.2",
    "6.3",
    "6.4",
    "6.5",
    "6.6",
    "7.1",
    "7.2.1",
    "7.2.2",
    "7.2.3",
    "7.3",
    "7.4",
    "7.5",
}
"""Every section of the three chapters that asks something."""

FIGURES = {"2.1", "2.2", *(f"7.{i}" for i in range(1, 13))}
"""Every figure of them that is no screen."""

EQUATIONS = {"2.1", "2.2", "2.3", "2.4", "7.2", "7.4", "7.5", "7.6"}
"""Those between (7.2) and (7.4) included."""


class Row(NamedTuple):
    """A row of the table."""

    place: str
    asked: str
    where: str
    shown_by: str


def _rows() -> list[Row]:
    table = PAGE.split("<!-- table -->")[1].split("<!-- end -->")[0].strip().splitlines()
    rows = [Row(*(cell.strip() for cell in line.strip("|").split(" | "))) for line in table[2:]]
    assert len(rows) > 40
    return rows


ROWS = _rows()
NAMES = sorted({name for row in ROWS for name in re.findall(r"`(glapp[\w.]*)`", row.where)})
READ = sorted({name for row in ROWS for name in re.findall(r'`"(\w+)"`', row.where)})
COMMANDS = sorted({row.shown_by.strip("`") for row in ROWS if row.shown_by.startswith("`")})


def _slug(heading: str) -> str:
    """A heading as a link names it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize("name", NAMES)
def test_name_exists(name: str) -> None:
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        break
    for i, part in enumerate(parts[cut:]):
        fields = getattr(found, "__dataclass_fields__", {})
        if part in fields and i == len(parts[cut:]) - 1:
            return
        found = getattr(found, part)


@pytest.mark.parametrize("name", READ)
def test_variable_can_be_read(name: str) -> None:
    graph = modules.Graph(
        0.1,
        {
            "pv": modules.Input(),
            "sp": modules.Input(),
            "pid": modules.PidAdvanced(k=1.0, ti=5.0),
            "watch": modules.BacklashDetection(k=1.0, ti=5.0),
            "other": modules.Pid(k=1.0, ti=5.0),
            "valve": modules.Output(),
            "second": modules.Output(),
        },
        [
            *("pv -> pid.pv", "sp -> pid.sp", "pid -> valve", "pv -> other.pv", "sp -> other.sp", "other -> second"),
            *("pv -> watch.pv", "sp -> watch.sp", "watch -> other.ff"),
        ],
    )
    assert {f"pid.{name}", f"watch.{name}"} & set(graph)


def test_all_of_the_chapters_is_there() -> None:
    places = ", ".join(row.place for row in ROWS)
    sections = {found for row in ROWS for found in re.findall(r"(?<![\w(.])\d(?:\.\d+)+", row.place.split("figure")[0])}
    assert sections >= CHAPTERS, CHAPTERS - sections
    for number in EQUATIONS:
        assert f"({number})" in places, number
    commands = " ".join(COMMANDS).split()
    assert set(commands) >= FIGURES, FIGURES - set(commands)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.asked[:50])
def test_row_is_shown_by_a_command_or_a_snippet(row: Row) -> None:
    assert re.search(r"`", row.where), "names nothing"
    if row.shown_by.startswith("`"):
        return
    [anchor] = re.findall(r"\(#([^)]+)\)$", row.shown_by)
    headings = re.findall(r"^## (.+)$", PAGE, re.MULTILINE)
    [heading] = [heading for heading in headings if _slug(heading) == anchor]
    snippet = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    assert ">>> " in snippet


@pytest.mark.verify
@pytest.mark.xdist_group("thesis")  # where its figures are computed once
@pytest.mark.usefixtures("figures")
@pytest.mark.parametrize("command", [command for command in COMMANDS if command.startswith("glapp ")])
def test_command_runs(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [*shlex.split(command), "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as end:
        main()
    assert not end.value.code
    numbers = command.split()[2:]
    assert f"Figures: {len(numbers)}" in capsys.readouterr().out
    assert {f"figure-{number}.png" for number in numbers} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.slow
@pytest.mark.parametrize("command", [command for command in COMMANDS if not command.startswith("glapp ")])
def test_bench_runs(command: str) -> None:
    program, *arguments = shlex.split(command)
    assert program == "python"
    done = subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
