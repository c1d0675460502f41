"""A bench writes between its marks, and nowhere else."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import bench
import pytest
from bench import page
from bench.compensation import PARTS


def test_only_what_stands_between_the_marks_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "RESULTS", tmp_path)
    document = tmp_path / "a.md"
    document.write_text("before\n<!-- one -->\nold\n<!-- end -->\n<!-- two -->\nkept\n<!-- end -->\n", encoding="utf-8")
    page.write("a.md", "new \\1\n", "one")
    text = document.read_text(encoding="utf-8")
    assert text == "before\n<!-- one -->\n\nnew \\1\n\n<!-- end -->\n<!-- two -->\nkept\n<!-- end -->\n"


def test_a_page_without_the_marks_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "RESULTS", tmp_path)
    document = tmp_path / "a.md"
    document.write_text("<!-- one -->\nold\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"bench/results/a\.md has 0 places between <!-- one -->"):
        page.write("a.md", "new", "one")
    assert document.read_text(encoding="utf-8") == "<!-- one -->\nold\n"


@pytest.mark.parametrize(
    ("name", "mark"),
    [
        ("benchmarks.md", "measured"),
        ("auto_tuner.md", "measured"),
        *[("truth.md", mark) for mark in ("ladder", "loads", "ordinary", "lengths", "times", "recordings", "tables")],
        ("fleet.md", "measured"),
        ("fleet.md", "speed"),
        ("nonlinear.md", "limit cycles"),
        ("nonlinear.md", "phase lead"),
        ("page.md", "measured"),
        ("modules.md", "wrong sign"),
        ("modules.md", "widths"),
        ("modules.md", "kp by default"),
        ("modules.md", "pid rules"),
        *[("compensation.md", mark) for mark in (*PARTS, "stiction")],
    ],
)
def test_every_page_that_a_bench_writes_has_its_marks(name: str, mark: str) -> None:
    assert f"<!-- {mark} -->\n" in (page.RESULTS / name).read_text(encoding="utf-8")


def test_every_bench_can_be_imported() -> None:
    """One of them asked another for a name that had gone, and no test had imported it."""
    modules = [m.name for m in pkgutil.walk_packages(bench.__path__, "bench.") if not m.name.endswith("__main__")]
    assert len(modules) > 40
    for name in modules:
        try:
            importlib.import_module(name)
        except ModuleNotFoundError as missing:
            assert missing.name in ("numba", "control", "pathsim", "bdsim", "polars", "duckdb"), f"{name}: {missing}"
