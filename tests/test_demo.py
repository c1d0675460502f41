"""The demonstration recordings: read as any user's files, they show their stated faults."""

from pathlib import Path

import pytest

from glapp import Result, analyze
from glapp.demo import write_recordings
from glapp.reading import open_recordings
from glapp.reading.settings import read_settings

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("demo")]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Result]:
    folder = tmp_path_factory.mktemp("demo")
    write_recordings(folder)
    loops = read_settings(folder / "loops.toml")
    return {loop.name: analyze(open_recordings(str(loop.file), [loop])[0], fit=False) for loop in loops}


@pytest.mark.parametrize(("name", "d"), [("FIC201", 2.4), ("PIC305", 3.0), ("TIC118", 1.6)])
def test_worn_valves_are_measured(results: dict[str, Result], name: str, d: float) -> None:
    result = results[name]
    assert (result.verdict, result.unit) == ("estimate", "%")
    assert result.d_hat == pytest.approx(d, rel=0.1)
    assert result.detections >= 9


def test_settings_that_nobody_wrote_down_are_identified(results: dict[str, Result]) -> None:
    found = results["TIC118"].identification
    assert found is not None and found.usable
    assert (found.k, found.ti) == pytest.approx((0.65, 18.0), rel=0.01)


def test_sound_valve_in_a_linear_oscillation_is_no_backlash(results: dict[str, Result]) -> None:
    result = results["LIC110"]
    assert result.verdict == "no_estimate" and result.reason
    assert result.reasons["too_short"] > 30 and result.d_hat is None


def test_loop_in_manual_gives_no_number_and_says_why(results: dict[str, Result]) -> None:
    result = results["FIC402"]
    assert result.d_hat is None and result.reason is not None
    assert "not in auto" in result.reason


def test_the_same_files_every_time(tmp_path: Path) -> None:
    first, again = write_recordings(tmp_path / "a"), write_recordings(tmp_path / "b")
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]
