"""The declared answer: the core's own, its JSON, its row in a table and its schema are one."""

from __future__ import annotations

import json
import typing
from importlib import import_module
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pydantic import BaseModel

import glapp
from glapp import _glapp
from glapp.document import LoopAnswer, Terms, to_json
from glapp.recording import Batch
from glapp.row import columns, rows
from glapp.simulate import closed_loop

estimate = import_module("glapp.estimate")  # the module; the function has its name in the package

ACTING: dict[str, Any] = {"setpoint": [(1, 1.0)], "load": [(50, 0.3), (120, -0.2), (180, 0.1)]}

WORDS = {
    "loop",
    "file",
    "unit",
    "reason",
    "reason_code",
    "identified",
    "answer.next.text",
    "answer.reasons",
    "answer.so",
    "answer.do",
    "answer.why",
    "answer.struck.text",
    "quality.text",
    "left_out",
    "controller.as_written",
    "controller.notes",
    "corrected.reason",
    "fit.unit",
    "fit.recordings",
    "fit.reason",
    "fit.reason_code",
    "plan",
    "repair",
}
"""Fields that Python adds: names, units, sentences, several recordings of one loop, and plans of tests."""

CODES = {
    "version",
    "why",
    "corrected.why",
    "fit.why",
    "fit.position",
    "fit.change",
    "fit.judgement",
    "fit.weighed",
    "step_test",
    "messages",
    "identification",
    "quality.numbers",
    "controller.max_h",
    "controller.tried",
    "controller.delta_u",
}
"""Codes that the sentences are made of."""


def answered(recording: glapp.Recording, **asked: Any) -> dict[str, Any]:
    """The core's answer in plain types."""
    beginning = recording.beginning(10**6)
    loop = estimate.with_op_unit(recording.loop, beginning)
    analysis = _glapp.Analysis(json.dumps(estimate._task(loop) | asked), beginning)
    analysis.take(beginning)
    answer: dict[str, Any] = analysis.finish(None)["answer"]
    return answer


def named_fields(model: type[BaseModel], answer: dict[str, Any], at: str = "") -> tuple[set[str], set[str]]:
    """Keys that only the model has and that only the answer has, with the way to them."""
    fields = model.model_fields
    declared, there = ({f"{at}{name}" for name in keys} for keys in (fields, answer))
    only = (declared - there, there - declared)
    for name in fields.keys() & answer.keys():
        models = [
            one
            for kind in (fields[name].annotation, *typing.get_args(fields[name].annotation))
            for one in (kind, *typing.get_args(kind))
            if isinstance(one, type) and issubclass(one, BaseModel)
        ]
        if not models:
            continue
        value = answer[name]
        assert value not in (None, []), f"{at}{name}: nothing to compare"
        below = named_fields(models[0], value[0] if isinstance(value, list) else value, f"{at}{name}.")
        only = (only[0] | below[0], only[1] | below[1])
    return only


def worn(kp: float = 1.0) -> glapp.Recording:
    s = closed_loop(
        "P3", (0.48, 0.3117, 0, 0), d=0.05, noise=0.005, h=0.1, t_end=250, seed=1, **ACTING, filter_in_loop=True
    )
    pv = s.pv.copy()
    pv[300] = np.nan
    loop = glapp.Loop(name="P3", controller={"k": 0.48, "ti": 0.3117, "setpoint_weight": 0}, process={"kp": kp}, n=3)
    return glapp.recording_from({"t": s.t, "SP": s.sp, "PV": pv, "OP": s.op}, loop)


def with_all_parts() -> dict[str, Any]:
    """A one answer that has a trend, weights, a step test, harm and a width of the crossings that does not stand."""
    widths = [1.0 + 0.01 * i for i in range(6)]
    trend = _glapp.width_trend([86400.0 * i for i in range(6)], widths, [0.01] * 6)
    fit = {"verdict": "backlash", "why": "gap", "d": 1.0, "low": 0.9, "high": 1.1, "lr_no_gap": 90.0, "lr_needed": 15.0}
    terms = {name: 0.1 for name in Terms.model_fields}
    weighed = {"log_bayes_factor": 2.0, "terms": terms, "wider": [[0.5, 1.0], [1.5, 0.0]]}
    facts = {
        "crossings": "estimate",
        "d_hat": 0.2,
        "detections": 9,
        "rejected": None,
        "fit": fit | {"trend": trend, "weighed": weighed},
        "span": 100.0,
        "acceptable": None,
        "step_test": {"d": 1.0, "low": 0.8, "high": 1.2},
        "harm": [{"pv_share": 0.5, "op_share": 0.25}],
    }
    return _glapp.summary(json.dumps(facts))


@pytest.mark.slow
def test_the_core_answers_what_is_declared() -> None:
    # The crossings are too narrow with so small a Kp, and struck.
    assert named_fields(LoopAnswer, answered(worn(0.3)) | {"answer": with_all_parts()}) == (WORDS, CODES)


@pytest.mark.slow
def test_what_is_written_is_what_the_core_answered() -> None:
    """Number by number, with sentences beside."""
    answer, written = answered(worn(0.3)), glapp.analyze(worn(0.3)).to_dict()
    assert written["answer"]["struck"]["code"] == "below"

    def compare(one: Any, other: Any, at: str) -> None:
        if isinstance(one, dict):
            for key in one.keys() & other.keys():
                compare(one[key], other[key], f"{at}.{key}")
        elif isinstance(one, list):
            assert len(one) == len(other), at
            for i, (a, b) in enumerate(zip(one, other, strict=True)):
                compare(a, b, f"{at}[{i}]")
        else:
            assert one == other, at

    compare(answer, written, "")


@pytest.mark.slow
def test_every_reason_is_a_code_with_numbers_that_tells_its_sentence() -> None:
    result = glapp.analyze(worn(0.3))
    document = json.loads(to_json([result]))["loops"][0]
    codes = [reason["code"] for reason in document["answer"]["reasons"]]
    assert codes[0] == "fit.backlash"
    first = document["answer"]["reasons"][0]
    assert _glapp.to_text(first["code"], first["numbers"], op_unit=document["unit"]) == document["fit"]["reason"]
    assert document["answer"]["why"][0] == _glapp.sentence(document["fit"]["reason"])


@pytest.mark.slow
def test_reasons_and_the_law_that_was_read_stand_there_for_programs() -> None:
    s = closed_loop(
        "P3", (0.48, 0.3117, 0, 0), d=0.05, noise=0.005, h=0.1, t_end=250, seed=1, **ACTING, filter_in_loop=True
    )
    signals = {"t": s.t, "sp": s.sp, "pv": s.pv, "op": s.op}
    unknown = glapp.analyze(**signals, fit=False).to_dict()
    k, low, high = unknown["identified"]["k"]
    assert unknown["identified"]["usable"] and unknown["reason_code"] is None and low < k < high
    assert k == pytest.approx(0.48, rel=0.01) and unknown["identified"]["reason"] is None
    still = glapp.analyze(**(signals | {"op": np.ones(len(s.t))})).to_dict()
    assert still["reason_code"] == still["fit"]["reason_code"] == "op_constant"
    assert not still["identified"]["usable"] and still["identified"]["k"] == [None, None, None]
    alone = glapp.analyze(**(signals | {"sp": None})).to_dict()
    assert alone["reason_code"] == "no_sp" and alone["fit"]["reason_code"] == "gap"


def test_rows_follow_from_what_is_declared() -> None:
    results = [glapp.analyze(worn(), fit=False), glapp.Result.of_error(glapp.InputError("no such file"), "x", "x.csv")]
    table = glapp.to_arrow(results)
    names = [column.name for column in columns()]
    assert table.column_names == names and len(set(names)) == len(names)
    assert list(rows(results)) == [list(row.values()) for row in table.to_pylist()]
    first, error = table.to_pylist()
    written = json.loads(to_json(results))["loops"][0]
    assert first["d_hat"] == written["d_hat"] and first["corrected_d"] == written["corrected"]["d"]
    assert first["rejected_too_short"] == written["reasons"]["too_short"] and first["fit_d"] is None
    assert [first["repeatability_low"], first["repeatability_high"]] == written["repeatability"]
    assert "not_a_number:" in first["quality"]
    assert first["identified_k_low"] == written["identified"]["k"][1] and error["reason_code"] == "unusable"
    assert error["answer_verdict"] == "refused" and error["k"] is None and error["rejected_gap"] == 0
    assert glapp.to_arrow(results[0]) == table[:1]
    assert glapp.to_arrow([]).schema == table.schema and table.schema.field("half_periods").type == pa.int64()


def test_a_task_that_is_none_is_refused_by_name() -> None:
    beginning = worn().beginning(100)
    with pytest.raises(ValueError, match="unknown field `gain`"):
        _glapp.Analysis('{"gain": 1.0}', beginning)
    with pytest.raises(ValueError, match="k = 0: must be other than 0"):
        _glapp.Analysis('{"controller": {"k": 0.0, "ti": 1.0, "td": 0.0, "b": 1.0}}', beginning)
    analysis = _glapp.Analysis("{}", beginning)
    with pytest.raises(ValueError, match="must be of the same length"):
        analysis.take(Batch(np.arange(3.0), None, np.arange(2.0)))
    analysis.finish(None)
    with pytest.raises(RuntimeError, match="finished"):
        analysis.take(beginning)


def test_an_error_in_what_shows_progress_comes_through() -> None:
    def broken(_: float | None) -> None:
        raise KeyError("the screen has gone")

    beginning = worn().beginning(100)
    with pytest.raises(KeyError, match="screen"):
        _glapp.Analysis("{}", beginning).finish(broken)


@pytest.mark.slow
def test_a_recording_is_read_once_though_its_gain_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Kp enters once a half-period has ended: the table is judged again, the samples are not read again."""
    monkeypatch.setattr(estimate, "INSPECTED_ROWS", 2000)
    recording = worn()
    recording.loop = recording.loop.model_copy(update={"process": glapp.Loop(name="x").process})
    passes = []
    batches = recording.batches
    monkeypatch.setattr(recording, "batches", lambda *rows: passes.append(1) or batches(*rows))
    result = glapp.analyze(recording)
    assert result.settings.origins["kp"] == "fitted" and len(passes) == 2, "the beginning, and one pass"
    again = worn()
    again.loop = again.loop.model_copy(
        update={"process": again.loop.process.model_copy(update={"kp": result.settings.kp})}
    )
    assert glapp.estimate(again).d_hat == result.d_hat
