"""The valve's recorded position: the recorder's effect on it, the verdicts it settles, and contradictions by PV."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from filtered import filtered

import glapp
from glapp import _glapp
from glapp.fit import Fit, _at_valve, _together
from glapp.recording import Batch
from glapp.report.fit_figure import fit_figure

LOOP = glapp.Loop(name="P3", op_unit="1")
LOADS: dict[str, Any] = {"load": [(50, 0.3), (120, -0.2), (180, 0.1)], "setpoint": [(1, 1.0)]}


def kept(x: Any, band: float) -> Any:
    """Written only once it has moved by more than `band`, as a historian with an exception band does."""
    written, last = np.empty_like(x), x[0]
    for i, value in enumerate(x):
        if abs(value - last) > band:
            last = value
        written[i] = last
    return written


def spiky(x: Any) -> Any:
    rng = np.random.default_rng(3)
    return x + np.where(rng.random(len(x)) < 0.005, 2.0 * rng.standard_normal(len(x)), rng.normal(0.0, 0.0005, len(x)))


RECORDERS: dict[str, Any] = {
    "without noise": lambda x: x,
    "noisy": lambda x: x + np.random.default_rng(1).normal(0.0, 0.002, len(x)),
    "rounded": lambda x: np.round(x / 0.001) * 0.001,
    "by exception": lambda x: kept(x, 0.005),
    "with spikes": spiky,
    "in % of another span, reverse": lambda x: np.round(80.0 - 40.0 * x, 3),
}


def by_position(batches: list[Batch]) -> Fit:
    """Result of the position alone: PV is not asked."""
    without = [replace(batch, pv=np.full(len(batch), np.nan)) for batch in batches]
    return _at_valve(_glapp.fit(without, 0.0)["position"], LOOP)


@pytest.mark.parametrize("recorder", sorted(set(RECORDERS) - {"without noise"}))
def test_without_a_gap_none_is_claimed(recorder: str) -> None:
    """Regression: seven of ten such loops by exception and with spikes had a gap."""
    s = filtered("P3", (0.482, 0.313, 0.0, 0.0), d=0.0, noise=0.005, h=0.05, t_end=250, seed=1, **LOADS)
    f = by_position([Batch(s.t, s.sp, s.pv, s.op, None, RECORDERS[recorder](s.position))])
    assert f.verdict == "sound" or (recorder == "by exception" and "demanded" in f.reason), f.reason
    if f.verdict == "sound" and recorder == "by exception":
        assert f.high is not None and f.high >= 0.005, "what the band may hide is not excluded"


@pytest.mark.slow
def test_a_position_that_is_op_tells_nothing_and_pv_answers() -> None:
    """Regression: for no gap it was "at least 0.773"."""
    s = filtered("P3", (0.482, 0.313, 0, 0), d=0.0, noise=0.005, h=0.1, t_end=120, seed=1, **LOADS)
    f = glapp.fit(glapp.recording_from(s.to_arrow(), LOOP))
    assert not f.found, f.reason
    assert "equals OP in every row" in f.reason and f.to_dict()["signal"] == "PV"


def said(verdict: Any, d: float, low: float, high: float | None) -> Fit:
    return Fit(verdict, f"{verdict} {d}", "%", d, low, high)


@pytest.mark.parametrize(
    ("position", "pv", "verdict", "low", "high"),
    [
        # No width is in both: both are named, and the interval holds both.
        (said("backlash", 1.0, 0.9, 1.1), said("backlash", 2.0, 1.8, 2.2), "backlash", 0.9, 2.2),
        (said("backlash", 1.0, 0.9, 1.1), said("at_least", 3.0, 2.5, None), "backlash", 0.9, None),
        # A gap in one of them alone.
        (said("sound", 0.0, 0.0, 0.2), said("backlash", 2.0, 1.8, 2.2), "cannot_tell", 0.0, 2.2),
        (said("backlash", 1.0, 0.9, 1.1), said("sound", 0.0, 0.0, 0.3), "cannot_tell", 0.0, 1.1),
    ],
)
def test_a_contradiction_names_both(position: Fit, pv: Fit, verdict: str, low: float, high: float | None) -> None:
    """The position once overrode PV unseen. What is decided is held in `crates/analysis/src/fitted.rs`."""
    decided = {
        "position": "contradicts",
        "verdict": verdict,
        "low": low,
        "high": high,
        "change": None,
        "judgement": None,
        "weighed": None,
    }
    f = _together(decided, position, pv, LOOP)
    assert (f.verdict, f.low, f.high) == (verdict, low, high)
    assert position.reason in f.reason and pv.reason in f.reason and "contradict" in f.reason


def test_where_they_agree_the_position_settles_it() -> None:
    sharp, broad = said("backlash", 1.0, 0.9, 1.1), said("backlash", 1.3, 0.8, 2.0)
    settles = {"position": "settles", "verdict": "backlash", "low": 0.9, "high": 1.1}
    settles |= dict.fromkeys(("change", "judgement", "weighed"))
    f = _together(settles, sharp, broad, LOOP)
    assert (f.d, f.low, f.high, f.through_pv) == (1.0, 0.9, 1.1, broad)
    assert "contradict" not in f.reason
    # A mere bound does not hide a width.
    bound = said("at_least", 1.0, 0.7, None)
    assert _together({"position": "bounds", "verdict": "backlash"}, bound, broad, LOOP).d == 1.3
    # PV answers where the position cannot, and the reason says so.
    silent = Fit("cannot_tell", "it stands still", "%")
    answer = _together({"position": "silent", "verdict": "backlash"}, silent, broad, LOOP)
    assert answer.d == 1.3 and "it stands still" in answer.reason


def test_a_history_of_windows_gives_one_answer_with_its_trend() -> None:
    batches = []
    for i in range(4):
        s = filtered("P3", (0.482, 0.313, 0, 0), d=0.05, noise=0.005, h=0.1, t_end=120, seed=i, **LOADS)
        position = RECORDERS["noisy"](s.position)
        batches.append(Batch(s.t + 1e5 * i, s.sp, s.pv, s.op, None, position))
    f = by_position(batches)
    assert f.verdict == "backlash" and len(f.windows) == 4 and f.trend is not None and not f.trend.changes
    assert f.low is not None and f.high is not None and f.low <= 0.05 <= f.high, f


@pytest.mark.slow
def test_the_report_draws_it() -> None:
    s = filtered("P3", (0.482, 0.313, 0, 0), d=0.05, noise=0.005, h=0.1, t_end=120, seed=1, **LOADS)
    table = {"time": s.t, "SP": s.sp, "PV": s.pv, "OP": s.op, "POSITION": RECORDERS["noisy"](s.position)}
    result = glapp.analyze(glapp.recording_from(table, LOOP))
    assert result.fit is not None and result.fit.to_dict()["signal"] == "position"
    figure = fit_figure(result)
    assert any("measured position" in (trace.name or "") for trace in figure.data)
