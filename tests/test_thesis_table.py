"""docs/thesis.md: its table is what `python -m glapp_thesis` makes, whole, and everything that it names is there.

The snippets themselves run as doctests of the page, and the figures are computed in `test_thesis.py`.
"""

import importlib
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from glapp import modules
from glapp_thesis import FIGURES, find, table
from glapp_thesis.checks import CHECKS
from glapp_thesis.items import ITEMS, Item

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/thesis.md").read_text(encoding="utf-8")
NUMBERS = json.loads((ROOT / "docs/gallery/numbers.json").read_text(encoding="utf-8"))
ROWS = list(table.rows(NUMBERS))

SECTIONS = (
    *("1", "1.1", "1.2", "2.1", "2.2", "3.1", "3.2", "3.3", "3.4", "4.1", "4.2", "4.2.1", "4.2.2", "4.2.3", "5.1"),
    *("5.2", "5.3", "5.4", "6.1", "6.2", "6.3", "6.4", "6.5", "6.6", "7.1", "7.2.1", "7.2.2", "7.2.3", "7.3", "7.4"),
    *("7.5", "8.1", "8.2", "8.3.1", "8.3.2", "8.4.1", "8.5.1", "8.5.2", "9"),
)
"""Every section of the thesis that says something of its own; 7.2, 8.3 and others only have sections below them."""

EQUATIONS = (
    *("2.1", "2.2", "2.3", "2.4", "4.1", "5.1", "5.2", "5.3", "5.4", "5.5", "7.1", "7.2", "7.3", "7.4", "7.5", "7.6"),
    *("8.1", "8.2"),
)
PICTURES = (
    *("1.1", "1.2", "1.3", "1.4", "1.5", "1.6", "2.1", "2.2", "3.1", "3.2", "4.1", "4.2"),
    *(f"5.{i}" for i in range(1, 13)),
    *(f"6.{i}" for i in range(1, 6)),
    *(f"7.{i}" for i in range(1, 13)),
    *(f"8.{i}" for i in range(1, 16)),
    "Table 8.1",
)

NAMES = sorted({name for item in ITEMS for name in re.findall(r"`(glapp[\w.]*)`", item.where)})
READ = sorted({name for item in ITEMS for name in re.findall(r'`"(\w+)"`', item.where)})
COMMANDS = sorted({item.shown.strip("`") for item in ITEMS if item.shown.startswith("`")})


def _slug(heading: str) -> str:
    """A heading as a link names it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def test_the_page_has_the_table_that_is_made() -> None:
    assert table.replaced(PAGE, NUMBERS) == PAGE, "python -m glapp_thesis"


def test_everything_of_the_thesis_is_there() -> None:
    places = ", ".join(item.place for item in ITEMS)
    sections = {found for item in ITEMS for found in re.findall(r"\d(?:\.\d+)*", item.place.split("figure")[0])}
    assert sections >= set(SECTIONS), set(SECTIONS) - sections
    for number in EQUATIONS:
        assert f"({number})" in places, number
    assert sorted(item.figure for item in ITEMS if item.figure) == sorted(PICTURES) == sorted(FIGURES)
    assert {item.check for item in ITEMS if item.check} == set(CHECKS)
    assert {f"system P{i}" for i in range(1, 9)} <= {place for item in ITEMS for place in item.place.split(", ")}
    assert all(f"code block {number}" in places for number in ("6.1", "6.2", "7.1"))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.item.place}: {row.says[:40]}")
def test_a_reason_stands_where_it_differs_and_nowhere_else(row: table.Row) -> None:
    assert bool(row.why) == (row.standing != "same")
    assert all(number.same is not None for number in row.numbers)
    if row.item.check and row.standing == "same":  # an equation, not a simulation
        for number in row.numbers:
            if isinstance(number.thesis, float):
                assert number.ours == pytest.approx(number.thesis, rel=0.01, abs=1e-9)


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


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: f"{item.place}: {item.says[:40]}")
def test_item_is_shown_by_a_command_a_snippet_or_a_page(item: Item) -> None:
    if not item.where:
        assert item.why
        return
    assert "`" in item.where, "names nothing"
    if item.shown.startswith("`"):
        return
    [(page, anchor)] = re.findall(r"\(([\w./-]*)#?([^)]*)\)$", item.shown)
    text = (ROOT / "docs" / page).read_text(encoding="utf-8") if page else PAGE
    if anchor:
        [heading] = [one for one in re.findall(r"^#+ (.+)$", text, re.MULTILINE) if _slug(one) == anchor]
        assert page or ">>> " in PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]


def test_every_link_to_the_gallery_leads_to_its_figure() -> None:
    """Regression: all of them led to the top of a page with 57 pictures."""
    page = (ROOT / "docs/gallery/README.md").read_text(encoding="utf-8")
    links = re.findall(r"\[([^\]]+)\]\(gallery/README\.md#([^)]+)\)", PAGE)
    assert {number for number, _ in links} == set(PICTURES)
    for number, anchor in links:
        assert f'<a id="{anchor}"></a>\n\n## {number if number.startswith("Table") else f"Figure {number}"}: ' in page


@pytest.mark.parametrize("command", [command for command in COMMANDS if command.startswith("glapp ")])
def test_command_names_figures(command: str) -> None:
    program, subcommand, *numbers = shlex.split(command)
    assert (program, subcommand) == ("glapp", "thesis") and numbers
    assert [find(number) for number in numbers] == numbers


def test_the_table_is_made_by_one_command(tmp_path: Path) -> None:
    page = tmp_path / "thesis.md"
    page.write_text(f"before\n{table.BEGIN}\nreplaced\n{table.END}\nafter\n", encoding="utf-8")
    program = [sys.executable, "-m", "glapp_thesis", str(page), str(ROOT / "docs/gallery/numbers.json")]
    subprocess.run(program, check=True, timeout=120)
    made = page.read_text(encoding="utf-8")
    assert made.startswith(f"before\n{table.BEGIN}\n") and made.endswith(f"{table.END}\nafter\n")
    assert made.count("\n|") == len(ITEMS) + 2 and "\nreplaced\n" not in made


@pytest.mark.slow
@pytest.mark.parametrize("command", [command for command in COMMANDS if command.startswith("python -m bench")])
def test_bench_runs(command: str) -> None:
    program, *arguments = shlex.split(command)
    assert program == "python"
    done = subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
