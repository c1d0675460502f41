"""The gallery: every figure of the thesis recomputed, against docs/gallery."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from glapp import InputError
from glapp_thesis import FIGURES, Number, Shown, find, gallery
from glapp_thesis.differences import DIFFERENCES, shown_by
from glapp_thesis.style import save

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("thesis")]  # the figures are computed once, by one worker

A_FEW = ["1.4", "2.2", "4.2", "5.1", "5.10", "6.2", "6.5", "7.1", "7.4", "7.12"]
"""Figures of every chapter that take less than a second; all of them are computed in `make verify`."""

GALLERY = Path(__file__).parent.parent / "docs/gallery"
RECORDED = json.loads((GALLERY / "numbers.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def shown(figures: dict[str, Callable[[], Shown]]) -> dict[str, Shown]:
    return {number: function() for number, function in figures.items()}


@pytest.mark.parametrize("number", A_FEW)
def test_a_few_figures_are_those_of_the_gallery(figures: dict[str, Callable[[], Shown]], number: str) -> None:
    one = figures[number]()
    is_that_of_the_gallery(one, number)
    names_its_axes(one)
    assert (GALLERY / one.picture).is_file()


@pytest.mark.verify
@pytest.mark.parametrize("number", FIGURES)
def test_numbers_are_those_of_the_gallery(shown: dict[str, Shown], number: str) -> None:
    is_that_of_the_gallery(shown[number], number)


def is_that_of_the_gallery(one: Shown, number: str) -> None:
    recorded, numbers = RECORDED[number], RECORDED[number]["numbers"]
    assert one.number == number
    assert (one.title, one.section, one.why) == (recorded["title"], recorded["section"], recorded["why"])
    assert len({x.what for x in one.numbers}) == len(one.numbers)
    assert numbers.keys() == {x.what for x in one.numbers}
    for x in one.numbers:
        stored = numbers[x.what]
        assert x.agrees(stored["glapp"]), f"{x.what}: {x.ours}, recorded {stored['glapp']}; make gallery"
        assert (x.unit, x.thesis, x.same) == (stored["unit"], stored["thesis"], stored["same"]), "make gallery"
    assert bool(one.why) != one.same, "a reason stands where a number differs"


@pytest.mark.verify
def test_a_wrong_number_is_noticed(shown: dict[str, Shown]) -> None:
    x = shown["5.1"].numbers[0]
    assert x.ours is not None and not x.agrees(1.00001 * x.ours) and not x.agrees(None)


@pytest.mark.verify
def test_page_is_what_the_figures_say(shown: dict[str, Shown]) -> None:
    page = (GALLERY / "README.md").read_text(encoding="utf-8")
    assert page == gallery.as_markdown([gallery.recorded(one, RECORDED[n]) for n, one in shown.items()]), "make gallery"


@pytest.mark.verify
def test_every_picture_is_there_and_no_other(shown: dict[str, Shown]) -> None:
    assert {path.name for path in GALLERY.glob("*.png")} == {one.picture for one in shown.values()}
    assert all(path.stat().st_size <= 60_000 for path in GALLERY.glob("*.png"))


@pytest.mark.verify
def test_every_difference_has_its_number(shown: dict[str, Shown]) -> None:
    assert [difference for difference, _, _ in shown_by(list(shown.values()))] == list(DIFFERENCES)


@pytest.mark.verify
@pytest.mark.parametrize("number", FIGURES)
def test_picture_names_its_axes(shown: dict[str, Shown], number: str) -> None:
    names_its_axes(shown[number])


def names_its_axes(one: Shown) -> None:
    for axes in one.draw().axes:
        if axes.axison:
            assert axes.get_ylabel()
            assert any(each.get_xlabel() for each in axes.get_shared_x_axes().get_siblings(axes))


@pytest.mark.verify
@pytest.mark.parametrize("number", ["8.12", "8.13", "8.15"])
def test_panels_of_a_recording_have_one_time_axis(shown: dict[str, Shown], number: str) -> None:
    """Regression: the lower panel ended with the last detection, and its half-periods lay elsewhere than above."""
    above, below, *_ = shown[number].draw().axes
    assert above.get_xlabel() == below.get_xlabel() == "time [s]"
    assert above.get_xlim() == below.get_xlim()


@pytest.mark.verify
def test_html_page_stands_alone(shown: dict[str, Shown], tmp_path: Path) -> None:
    page = gallery.as_html(list(shown.values()))
    links = re.findall(r'(?:src|href)="([^"]*)"', page)
    targets = {one.picture for one in shown.values()} | {f"#{one.anchor}" for one in shown.values()}
    assert set(links) == targets
    assert "<code>glapp thesis 5.1</code>" in page and "`" not in page
    one = shown["5.1"]
    save(one.draw(), tmp_path / one.picture)
    assert (tmp_path / one.picture).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("text", "number"), [("5.1", "5.1"), ("Figure 5.1", "5.1"), ("figure-5.1", "5.1"), ("table 8.1", "Table 8.1")]
)
def test_numbers_as_people_write_them(text: str, number: str) -> None:
    assert find(text) == number


def test_unknown_number() -> None:
    with pytest.raises(InputError, match=r"is '3\.3', must be one of 1\.1, "):
        find("3.3")


def test_words_of_the_thesis_are_understood() -> None:
    def same(thesis: float | str | None, ours: float | None, **holds: bool) -> bool | None:
        return Number("x", "", thesis, ours, **holds).same

    assert [same(4.22, x) for x in (4.0, 3.7, None)] == [True, False, False]
    assert [same(0.0, x) for x in (0.0, 1e-3)] == [True, False]
    assert [same("near 5", x) for x in (4.1, 3.9)] == [True, False]
    assert [same("below 4 or none", x) for x in (None, 3.9, 4.1)] == [True, True, False]
    assert [same("none", x) for x in (None, 0.1)] == [True, False]
    assert [same("over 100", x) for x in (137.0, 90.0)] == [True, False]
    assert [same("within 10", x) for x in (-9.0, -15.0)] == [True, False]
    assert [same("1 or more", x) for x in (1.0, 0.0)] == [True, False]
    assert [same("some", x) for x in (1.0, 0.0)] == [same("several", x) for x in (2.0, 1.0)] == [True, False]
    assert same("good", 1.0, holds=False) is False and same(None, 1.0) is None
    with pytest.raises(ValueError, match="nobody decides whether 1 is 'good'"):
        same("good", 1.0)
