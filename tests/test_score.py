"""Answers compared with the workshop's findings."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import date, datetime
from pathlib import Path
from typing import Any

import pytest
from bench.labels import write
from typer.testing import CliRunner

import glapp
from glapp.cli import app
from glapp.demo import write_recordings
from glapp.errors import InputError
from glapp.fit import Fit
from glapp.result import Result
from glapp.score import Label, Outcome, Scored, calibrated, counted, judged, read_labels, share

TERMS = ("likelihood", "traversals", "width", "limit", "noise", "plateau", "process", "rules")
AGAINST = {"log_bayes_factor": -1.0, "terms": dict.fromkeys(TERMS, 0.0), "wider": [(0.2, 0.5), (0.5, 0.03), (1.0, 0.0)]}
"""Evidence against a gap, and that one is narrower than 1 % of span."""


def answered(verdict: str, d: float = 2.0, low: float = 1.8, high: float | None = 2.2, **more: Any) -> Result:
    """The answer to a fit that says so, of a loop whose OP has a span of 100 %."""
    error = InputError("is not read", file="FIC101.csv")
    loop = glapp.Loop(name="FIC101", op_span=(0, 100), op_unit="%")
    refused = Result.of_error(error, "FIC101", "FIC101.csv", loop)
    fit = Fit(verdict, "", "%", d, low, high, lr_no_gap=90.0, lr_needed=15.0, **more)  # type: ignore[arg-type]
    return replace(refused, crossings="no_estimate").decided_with(fit=fit)


def label(found: str, width: float | None = None, **more: Any) -> Label:
    return Label(2, Path("FIC101.csv"), None, found, width, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("found", "width", "answer", "outcome"),
    [
        ("gap", None, answered("backlash"), "right"),
        ("gap", 2.1, answered("backlash"), "right"),
        ("gap", 2.3, answered("backlash"), "wrong"),
        ("gap", 9.0, answered("at_least", high=None), "right"),
        ("gap", None, answered("stiction", jump=2.0), "wrong"),
        ("both", None, answered("stiction", jump=2.0), "right"),
        ("stiction", None, answered("stiction", jump=2.0), "right"),
        ("gap", None, answered("sound", 0.0, 0.0, 0.5), "wrong"),
        ("gap", 0.4, answered("sound", 0.0, 0.0, 0.5), "right"),
        ("gap", 0.6, answered("sound", 0.0, 0.0, 0.5), "wrong"),
        ("gap", None, answered("cannot_tell"), "silent"),
        ("gap", None, answered("cannot_tell", 0.2, 0.0, 0.5, why="may_be_a_gap", weighed=AGAINST), "wrong"),
        ("gap", 0.9, answered("cannot_tell", 0.2, 0.0, 0.5, why="may_be_a_gap", weighed=AGAINST), "right"),
        ("gap", 1.1, answered("cannot_tell", 0.2, 0.0, 0.5, why="may_be_a_gap", weighed=AGAINST), "wrong"),
        ("sound", None, answered("sound", 0.0, 0.0, 0.5), "right"),
        ("sound", None, answered("backlash"), "wrong"),
        ("sound", None, answered("backlash", 0.5, 0.4, 0.6), "right"),
        ("sound", None, answered("cannot_tell"), "silent"),
        ("sound", None, answered("cannot_tell", 0.2, 0.0, 0.5, why="may_be_a_gap", weighed=AGAINST), "right"),
        ("other", None, answered("backlash"), "wrong"),
    ],
)
def test_an_answer_is_right_wrong_or_silent(found: str, width: float | None, answer: Result, outcome: Outcome) -> None:
    scored = judged(label(found, width), answer)
    assert scored.outcome == outcome
    assert bool(scored.why) == (outcome == "wrong")


def test_a_width_is_held_in_the_unit_of_op() -> None:
    answer = answered("backlash")
    assert judged(label("gap", 2.1, unit="% of span"), answer).width == 2.1
    with pytest.raises(InputError, match=r"row 2, column unit: 'mm' is not the unit of OP; write % or '% of span'"):
        judged(label("gap", 2.1, unit="mm"), answer)


def test_what_was_recorded_after_the_repair_is_not_counted() -> None:
    answer = replace(answered("backlash"), t0=datetime(2026, 3, 2))
    assert judged(label("sound", date=date(2026, 3, 2)), answer).outcome == "wrong"
    late = judged(label("sound", date=date(2026, 3, 1)), answer)
    assert (late.outcome, late.why) == ("not counted", "it was recorded after 2026-03-01")
    assert counted([late]) == []


def test_a_share_has_an_interval() -> None:
    assert share(0, 0) is None
    found = share(20, 0)
    assert found is not None and found == pytest.approx((0.8389, 1.0, 1.0), abs=1e-4)


def test_labels_of_a_spreadsheet_with_decimal_commas(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_text("file;found;width;comment\na.csv;gap;2,5;play in the linkage, bolt lost\n")
    [label] = read_labels(path)
    assert (label.found, label.width) == ("gap", 2.5)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty; write a row a valve, with the columns file, loop, found"),
        ("found,Tag\ngap,x\n", "unit, date, and this file has found, tag"),
        ("file,found,widht\na.csv,gap,2\n", "row 1, column widht: has a column 'widht': did you mean 'width'?"),
        ("file,found\n", "has no row"),
        (
            "file,found\na.csv,worn\n",
            "row 2, column found: 'worn' is no finding; write one of gap, stiction, both, sound, other",
        ),
        ("file,found,width\na.csv,gap,wide\n", "row 2, column width: 'wide' is no width"),
        ("file,found,width\na.csv,gap,-1\n", "row 2, column width: '-1' is no width; write a number ≥ 0"),
        ("file,found,date\na.csv,gap,1.3.26\n", "row 2, column date: '1.3.26' is no date; write 2026-03-31"),
        ("file,found\na.csv,gap\n./a.csv,sound\n", "row 3: a.csv is in row 2 already"),
        ("file,found\n,gap\n", "row 2, column file: names no recording"),
    ],
)
def test_a_wrong_label_is_told(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "labels.csv"
    path.write_text(text)
    with pytest.raises(InputError) as wrong:
        read_labels(path)
    assert says in str(wrong.value)


def test_labels_none_of_which_can_be_opened_are_told(tmp_path: Path) -> None:
    """It ended in a traceback."""
    (tmp_path / "FIC101.csv").write_text("t,SP,PV,OP\n0,1,0.9,50\n1,1,1.1,51\n")
    (tmp_path / "labels.csv").write_text("file,loop,found\nFIC101.csv,LIC999,gap\nFIC7.csv,,gap\n")
    done = CliRunner().invoke(app, ["score", str(tmp_path / "labels.csv")])
    said = " ".join(done.stderr.split())
    assert done.exit_code == 1 and isinstance(done.exception, SystemExit)
    assert "row 2, column loop: has no loop 'LIC999'; write one of its loops: FIC101" in said
    assert "row 3, column file: there is no such file" in said


def test_stated_probabilities_are_held_against_what_is_so() -> None:
    def stated(found: str, p: float, width: float | None = None, beyond: float | None = None) -> Scored:
        answer = answered("cannot_tell")
        return Scored(
            label(found, width),
            replace(answer, answer=replace(answer.answer, p_gap=p, p_beyond=beyond)),
            "silent",
            width=width,
        )

    rows = calibrated(
        [
            stated("gap", 0.95, 3.0, 0.8),
            stated("sound", 0.92, None, 0.8),
            stated("stiction", 0.3),
            stated("other", 0.3, None, 0.3),
            stated("gap", 1.0, 0.4, 0.76),
            replace(stated("gap", 0.95), outcome="not counted"),
        ]
    )
    assert [(one.of, one.low, one.valves, one.so) for one in rows] == [
        ("p_gap", 0.25, 1, 1),
        ("p_gap", 0.9, 3, 2),
        ("p_beyond", 0.75, 3, 1),
    ]
    assert rows[1].stated == pytest.approx((0.95 + 0.92 + 1.0) / 3)
    assert calibrated([]) == []


@pytest.mark.slow
def test_a_labelled_folder_of_the_corpus_is_scored_and_its_faults_are_told(tmp_path: Path) -> None:
    labels = write(tmp_path / "corpus", ["steps"], "B", 1, 1)
    none, gap = sorted(tmp_path.glob("corpus/steps*.csv"), key=lambda path: "gap" in path.name)
    (tmp_path / "corpus" / "FV-7.csv").write_bytes(gap.read_bytes())
    (tmp_path / "corpus" / "odd.csv").write_text("\n".join(none.read_text().splitlines()[:600]) + "\n")
    with labels.open("a") as file:
        file.write("FV-7.csv,gap,2,%\nlost.csv,gap,2,%\nodd.csv,sound,1,mm\n")
    report = tmp_path / "score.html"
    done = CliRunner().invoke(app, ["score", str(labels), "--json", "--report", str(report)])
    assert done.exit_code == 1
    messages = " ".join(done.stderr.split())
    assert f"is the same recording as {gap.name} in row 3" in messages, "one valve under two names"
    assert "row 5, column file: there is no such file" in messages
    assert "row 6, column unit: 'mm' is not the unit of OP; write % or '% of span'" in messages
    found = json.loads(done.stdout)
    assert [one["found"] for one in found["valves"]] == ["sound", "gap"]
    assert all(one["valves"] for one in found["calibration"])
    page = report.read_text("utf-8").replace("<wbr>", "")
    assert "Right, wrong and silent" in page and none.stem in page and gap.stem in page
    differ = sum(one["outcome"] == "wrong" for one in found["valves"])
    assert page.count('<section class="loop"') == differ, "a section for each that differs"


@pytest.mark.slow
def test_the_demonstration_is_scored(tmp_path: Path) -> None:
    write_recordings(tmp_path / "demo")
    labels = tmp_path / "labels.csv"
    labels.write_text(
        "file,loop,found,width,unit\n"
        "demo/loops.toml,PIC305,gap,3,%\n"
        "demo/loops.toml,LIC110,sound,,\n"
        "demo/loops.toml,LIC999,sound,,\n"
        "demo/lost.csv,,gap,,\n"
    )
    report = tmp_path / "differ.html"
    done = CliRunner().invoke(app, ["score", str(labels), "--json", "--report", str(report)])
    assert done.exit_code == 1, "two of the four cannot be opened"
    printed = " ".join(done.stderr.split())
    assert (
        "row 4, column loop: has no loop 'LIC999'" in printed and "row 5, column file: there is no such file" in printed
    )
    found = json.loads(done.stdout)
    assert found["valves"][0]["outcome"] == "right"
    assert sum(one["right"] + one["wrong"] + one["silent"] for one in found["counts"]) == 2
    shown = CliRunner().invoke(app, ["score", str(labels)])
    assert "PIC305" not in shown.stdout and "right of those" in shown.stdout
