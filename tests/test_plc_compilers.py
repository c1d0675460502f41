"""The library under two compilers of other makers: both take every file, and their programs give the core's numbers."""

import re
import sys
from pathlib import Path

import pytest
from programs import built

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "plc"))
import compilers  # noqa: E402

pytestmark = [pytest.mark.verify, pytest.mark.slow, pytest.mark.xdist_group("compilers")]


@pytest.fixture(scope="module", autouse=True)
def both() -> None:
    try:
        compilers.tools()
    except compilers.Missing as lacking:
        pytest.skip(f"the library under other makers' compilers: this machine lacks {lacking}")


@pytest.fixture(scope="module")
def traces(tmp_path_factory) -> list[Path]:
    return compilers.traces(tmp_path_factory.mktemp("traces"), twins=built("check", "test", "twins"))


@pytest.mark.parametrize("compiler", compilers.COMPILERS)
@pytest.mark.parametrize(("build", "literals"), compilers.CASES)
def test_it_shows_the_numbers_of_the_core(compiler, build, literals, traces, tmp_path):
    driver = compilers.compiled(compiler, build, tmp_path / build, literals, built("check", "example", "foreign"))
    done, passed, exact, block, off = compilers.self_test(driver)
    assert (done, passed, block) == (1, 1, 0)
    found = compilers.compared(driver, traces)
    numbers = sum(row[2] for _, row in found)
    assert numbers > 2e7 and {"GlappDemo", "GlappAutoTuner", "GlappPidAdvanced"} <= {name for name, _ in found}
    others = {name: row[3] for name, row in found if row[3] > 0}
    if (build, literals) == ("REAL", "as they are"):
        # An expression with a literal is worked out in 64 bits there: other last digits, and where a number stands at a
        # bound of a setting or condition, another answer.
        assert off < 1e-6 and others
    else:
        assert exact == 1 and off == 0.0
        assert not others


@pytest.mark.parametrize("compiler", compilers.COMPILERS)
@pytest.mark.parametrize("build", compilers.BUILDS)
def test_the_examples_of_the_pages_are_taken_and_give_what_they_say(compiler, build, tmp_path):
    """OpenPLC refused the program of the page for `Integral`, a block of matiec; others handed no settings over."""
    rows = compilers.of_examples(compiler, build, tmp_path)
    examples, loop = rows[:-20], rows[-20:]
    assert len(examples) > 40
    assert [name for name, wrong in examples if wrong != "0"] == []
    # The program with compensation gives the rows of the page; in REAL a literal of 64 bits leads it another way.
    page = (ROOT / "docs/plc.md").read_text(encoding="utf-8")
    shown = re.search(r"```\nscan,.*?\n(.*?)```", page, re.DOTALL)[1].split()
    if build == "LREAL":
        printed = [",".join(row) for row in loop]
        # The last row of the page has PV bad.
        assert len(shown) == 3 and set(shown[:2]) <= set(printed)
    standing, width = loop[15][6], float(loop[15][3])
    assert standing == "0" and abs(width - 1.6) < 0.1


@pytest.mark.parametrize("build", compilers.BUILDS)
def test_the_project_for_openplc_runs_in_its_task(build, tmp_path):
    done, passed, exact, found, width, message = compilers.project(build, tmp_path)
    # The example has no K and Ti of its own, and asks for them.
    assert (done, passed, found, message) == (1, 1, 1, 6)
    assert exact == (build == "LREAL")
    assert abs(width - 2.0) < 0.3
