"""The demonstration: its stored answers are those of the code, and the service goes on from there."""

import json
import math
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("asyncua")

from glapp.planned import OPEN
from glapp.reading.settings import parse_settings
from glapp.service import demonstration
from glapp.service.monitor import Monitor
from glapp.service.options import MonitorOptions
from glapp.service.plant import SimLoop, SimPlant
from glapp.service.recordings import SignalStore
from glapp.service.signal import Signal
from glapp.service.store import Reader, Store
from glapp.station.view import View

NOW = datetime(2026, 5, 17, 14, 30, tzinfo=UTC).timestamp()
TODAY = datetime(2026, 5, 17, tzinfo=UTC)
PAGE = Path(__file__).parents[1] / "docs" / "station.md"

WHAT = {
    "FIC101": "found",
    "PIC102": "cannot_tell",
    "TIC103": "found",
    "LIC104": "found",
    "FIC105": "sound",
    "TIC106": "cannot_tell",
}
"""Confidence of each answer; PIC102 oscillates for another reason."""


def differences(stored: Any, made: Any, place: str = "") -> Iterator[str]:
    """Paths at which two answers differ; numbers by more than a millionth."""
    if isinstance(stored, dict) and isinstance(made, dict):
        for name in sorted(stored.keys() | made.keys()):
            yield from differences(stored.get(name), made.get(name), f"{place}.{name}")
    elif isinstance(stored, list) and isinstance(made, list) and len(stored) == len(made):
        for i, (a, b) in enumerate(zip(stored, made, strict=True)):
            yield from differences(a, b, f"{place}[{i}]")
    elif isinstance(stored, float) and isinstance(made, int | float):
        if not math.isclose(stored, made, rel_tol=1e-6, abs_tol=1e-6):
            yield f"{place}: {stored} and {made}"
    elif stored != made:
        yield f"{place}: {stored!r} and {made!r}"


def stored() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(demonstration.FILE.read_text(encoding="utf-8"))
    return found


HINT = "python -m glapp.service.demonstration stores what the code answers now"


@pytest.mark.slow
def test_a_stored_answer_is_what_the_code_answers() -> None:
    """The one loop that takes a second; all of them below."""
    made = demonstration.made("TIC106")["TIC106"]
    assert list(differences(stored()["TIC106"] | {"time": 0.0}, made | {"time": 0.0})) == [], HINT


@pytest.mark.verify
def test_every_stored_answer_is_what_the_code_answers() -> None:
    assert list(differences(stored(), demonstration.made())) == [], HINT


def one_of(answers: dict[str, dict[str, Any]], loop: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(answers[loop]["document"])["analysis"]["loops"][0]
    return found


def test_there_is_one_of_each_kind_and_none_says_what_is_not_true() -> None:
    answers = demonstration.answers(TODAY)
    values = {name: one_of(answers, name)["answer"] for name in answers}
    assert {name: answer["confidence"] for name, answer in values.items()} == WHAT
    assert values["PIC102"]["verdict"] == "oscillation" and values["TIC103"]["trend"]["code"] == "grows"
    kinds = {loop.name: loop.kind for loop in demonstration.loops()}
    for name, answer in values.items():
        wear = kinds[name].wear * (demonstration.DAYS - 1)  # on the last day that was recorded
        true = kinds[name].d + wear
        low, high = answer["low"], answer["high"]
        if answer["confidence"] == "cannot_tell":
            assert low is None and high is None, name
        else:
            assert low <= true <= high, name
    slope = values["TIC103"]["trend"]
    assert slope["low"] <= kinds["TIC103"].wear <= slope["high"]


def test_answers_are_of_the_days_before() -> None:
    answers = demonstration.answers(TODAY)
    days = [one["t0"][:10] for one in one_of(answers, "TIC103")["fit"]["recordings"]]
    assert days == [f"2026-05-{day}" for day in range(11, 17)]
    assert "2000-" not in json.dumps(answers)
    assert answers["FIC101"]["t_end"] == TODAY.timestamp()


def test_many_scans_at_once_are_the_same_as_one_by_one() -> None:
    for one, many in zip(demonstration.loops(), demonstration.loops(), strict=True):
        names = (Signal.SP, Signal.PV, Signal.OP, Signal.POSITION)
        scanned = [one.scan(0.0, 0.0) for _ in range(900)]
        columns = many.record(900)
        for name, column in zip(names, columns, strict=True):
            assert [row[name] for row in scanned] == column.tolist(), (one.name, name)


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[SimLoop]]:
    """A folder as it is when the demonstration begins."""
    folder = tmp_path_factory.mktemp("begun")
    loops = demonstration.loops()
    known = parse_settings(SimPlant(loops).settings(), "the demonstration", Path())
    store = Store(folder, NOW)
    demonstration.begin(store, loops, known, NOW)
    monitor = Monitor(known, store, options=MonitorOptions(), clock=lambda: NOW)
    assert monitor.journal.failing is None
    store.show(NOW, json.dumps(monitor.status()))
    store.close()
    return folder, loops


def test_the_page_has_the_widths_that_the_window_shows(begun: tuple[Path, list[SimLoop]]) -> None:
    """Regression: the interval and the trend of TIC103 were those of an older fit."""
    view = View(begun[0], clock=lambda: NOW)
    view.refresh()
    rows = {row.loop: row for row in view.rows()}
    table = {line.split("|")[1].strip(): line for line in PAGE.read_text().splitlines() if line.startswith("| ")}
    for name in ("FIC101", "TIC103", "LIC104", "FIC105"):
        assert rows[name].width in table[name]
    [slope] = re.findall(r"[+−][\d.]+", rows["TIC103"].trend)[:1]
    assert f"{slope} % a month" in table["TIC103"]
    [offered] = re.findall(r"is offered for (.*)\.\n", PAGE.read_text())
    assert offered.split(" and ") == [name for name, confidence in WHAT.items() if confidence in OPEN]
    assert not {"likely", "likely_sound"} & set(WHAT.values()) and "None of them is *Likely a gap*" in PAGE.read_text()


def test_the_service_goes_on_from_what_is_there(begun: tuple[Path, list[SimLoop]]) -> None:
    folder, _ = begun
    with Reader(folder) as reader:
        _, shown = reader.shown() or (0.0, {})
        for name in WHAT:
            status, halves = shown["loops"][name], reader.half_periods(name, accepted=False)
            assert status["half_periods"] == len(halves) and status["answer"] is not None
            assert status["accepted"] == sum(row["reason"] == 0 for row in halves)
        assert len(reader.half_periods("FIC101")) > 9


def test_what_was_recorded_is_what_the_answers_say(begun: tuple[Path, list[SimLoop]]) -> None:
    folder, loops = begun
    signals = SignalStore(folder)
    for loop in loops:
        days = demonstration.DAYS if loop.kind.wear else 1
        rows = signals.read(loop.name, NOW - 8 * 86400.0, NOW)
        assert len(rows) == days * demonstration.EACH + demonstration.LATELY
        assert NOW - rows["time"][-1].as_py().timestamp() <= 2.0
        assert rows["POSITION"].null_count == len(rows), "the fit had the valve's position"


def test_the_window_is_full_at_once(begun: tuple[Path, list[SimLoop]]) -> None:
    folder, _ = begun
    view = View(folder, lambda: NOW)
    view.refresh()
    verdicts = {name: view.verdict(name) for name in WHAT}
    assert verdicts == {
        "FIC101": "Backlash",
        "PIC102": "Oscillation",
        "TIC103": "Backlash",
        "LIC104": "Backlash",
        "FIC105": "Sound",
        "TIC106": "Cannot tell",
    }
    assert view.trend_text("TIC103").startswith("↗ +4.") and view.trend_text("FIC101") == "–"
    assert "Not judged yet" not in {row.soon for row in view.rows()}
