"""Long histories: which windows are kept while they are read, and that a gap that grows shows."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from filtered import filtered

import glapp
from glapp._glapp import MOST_EPOCHS, Windows
from glapp.recording import AT_HIGH, BAD, Batch

DAY = 86400.0


def batch(t: Any, op: Any, **more: Any) -> Batch:
    return Batch(t, np.zeros(len(t)), np.zeros(len(t)), op, **more)


def turning(t: Any) -> Any:
    """An OP that turns all the time, by steps that a coarse look still sees."""
    return np.where(np.arange(len(t)) // 7 % 2, 41.0, 40.0)


@pytest.mark.parametrize("rows", [3_000, 40_000, 1_234_567])
def test_the_windows_are_spread_over_the_whole_history_in_bounded_memory(rows: int) -> None:
    windows = Windows(1000, 1e9)
    t = np.arange(float(rows))
    op = turning(t)
    for first in range(0, rows, 65536):
        windows.add(batch(t, op)[slice(first, first + 65536)])
        assert len(windows.best()) <= MOST_EPOCHS
    best = windows.best()
    assert min(3, MOST_EPOCHS // 2) <= len(best) <= MOST_EPOCHS
    assert all(len(window) <= 1000 for window in best)
    starts = [window.t[0] for window in best]
    assert starts == sorted(starts)
    # None of the epochs is left out.
    edges = np.array([*starts, rows])
    assert np.diff(edges).max() <= 4 * rows / MOST_EPOCHS + 1000


def test_the_window_in_which_op_turns_and_can_be_used_is_kept() -> None:
    t = np.arange(24_000.0)
    busy = (t % 2000 >= 1000) & (t < 23_000)
    op = np.where(busy, turning(t), 40.0)
    flags = np.zeros(len(t), np.uint8)
    flags[(t >= 5000) & (t < 6000)] = BAD
    flags[(t >= 7000) & (t < 8000)] = AT_HIGH
    windows = Windows(1000, 1e9)
    windows.add(batch(t, op, flags=flags))
    starts = [window.t[0] for window in windows.best()]
    assert starts and all(start % 2000 == 1000 for start in starts)
    assert 5000.0 not in starts and 7000.0 not in starts and 23_000.0 not in starts


def history(widths: list[float], apart: float) -> dict[str, Any]:
    """A day's few minutes of every few days, with another gap each time."""
    parts = []
    load = [(50, 0.3), (150, -0.2), (260, 0.2), (330, -0.1)]
    for i, d in enumerate(widths):
        acting: dict[str, Any] = {"setpoint": [(1, 1.0)], "load": load, "noise": 0.005}
        s = filtered("P3", (0.48, 0.3117, 0, 0), d=d, h=0.2, t_end=400, seed=i, **acting)
        parts.append((s.t + i * apart, s.sp, s.pv, s.op))
    return dict(zip(("time", "SP", "PV", "OP"), (np.concatenate(x) for x in zip(*parts, strict=True)), strict=True))


def between_manual(signals: dict[str, Any], parts: int, rows: int) -> dict[str, Any]:
    """A history with so many rows in manual after each of its parts: half a million rows."""
    ends = np.split(np.arange(len(signals["time"])), parts)
    take = np.concatenate([np.append(part, np.full(rows, part[-1])) for part in ends])
    manual = np.tile(np.append(np.zeros(len(ends[0])), np.arange(1, rows + 1)), parts)
    columns = {name: signals[name.upper()][take] for name in ("sp", "pv", "op")}
    return {"t": signals["time"][take] + 0.2 * manual, **columns, "flags": (manual > 0).astype(np.uint8)}


@pytest.fixture
def short_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    """A long history that is not half a million rows long."""
    monkeypatch.setattr(sys.modules["glapp.fit"], "ROWS", 4000)


LOOP = glapp.Loop(name="grows", op_unit="V", controller={"k": 0.48, "ti": 0.3117, "setpoint_weight": 0})


@pytest.mark.verify
def test_a_gap_that_grows_shows_over_the_whole_history() -> None:
    widths = [0.04 + 0.007 * i for i in range(5)]
    signals = between_manual(history(widths, 4 * DAY), len(widths), 100_000)
    assert len(signals["t"]) > 500_000
    result = glapp.analyze(**signals, loop=LOOP)
    f = result.fit
    assert f is not None and f.trend is not None
    assert f.verdict == "backlash" and f.trend.changes
    assert f.trend.slope == pytest.approx(0.007 / 4, rel=0.1)
    assert f.trend.error < 0.15 * f.trend.slope
    assert len(f.windows) >= 5
    assert f.windows[0].t_start < DAY and f.windows[-1].t_end > 16 * DAY
    for window in f.windows:
        truth = widths[round(window.t_start / (4 * DAY))]
        assert window.d == pytest.approx(truth, rel=0.1)
    # Today's width, not the mean of those that were.
    assert f.d == pytest.approx(widths[-1], rel=0.05)
    assert f.low is not None and f.low > widths[-2]
    assert "it grew from 0.0" in f.reason and "in 16 days" in f.reason
    document = result.to_dict()["fit"]
    assert document["trend"] == [f.trend.slope, f.trend.error]
    assert len(document["windows"]) == len(f.windows)


@pytest.mark.verify
def test_a_long_history_fitted_by_itself_has_the_windows_of_its_analysis() -> None:
    signals = between_manual(history([0.04, 0.06], 4 * DAY), 2, 250_000)
    fit = glapp.analyze(**signals, loop=LOOP).fit
    assert fit is not None and len(fit.windows) >= 2
    del signals["sp"]
    assert glapp.fit(**signals, loop=LOOP).to_dict()["windows"] == fit.to_dict()["windows"]


@pytest.mark.verify
@pytest.mark.usefixtures("short_beginning")
def test_a_gap_that_stays_shows_no_change() -> None:
    f = glapp.fit(glapp.recording_from(history([0.06] * 5, 4 * DAY), LOOP))
    assert f.verdict == "backlash" and f.trend is not None
    assert not f.trend.changes and "grew" not in f.reason and "shrank" not in f.reason
    assert f.d == pytest.approx(0.06, rel=0.05)


@pytest.mark.verify
@pytest.mark.usefixtures("short_beginning")
def test_op_that_only_moves_after_the_beginning_is_found() -> None:
    rest = {"time": np.arange(0.0, 2000.0, 0.2), "SP": np.ones(10_000), "OP": np.full(10_000, 0.5)}
    rest["PV"] = 1.0 + np.random.default_rng(1).normal(0.0, 0.005, 10_000)
    moves = history([0.06, 0.06], 600.0)  # a window is a twelfth of a short beginning: one alone holds few turns
    moves["time"] = moves["time"] + 5000.0
    table = {name: np.concatenate([rest[name], moves[name]]) for name in moves}
    f = glapp.fit(glapp.recording_from(table, LOOP))
    assert f.verdict == "backlash", f.reason
    assert f.d == pytest.approx(0.06, rel=0.25)
    assert f.windows[0].t_start >= 4000.0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda t: Windows(0, 1.0), "length is 0, must be > 0"),
        (lambda t: Windows(10, np.nan), "hole is NaN, must be > 0"),
        (lambda t: Windows(10, 1.0).add(Batch(t, t, t[:5], t)), "must be of the same length"),
    ],
)
def test_wrong_windows_are_refused(wrong: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        wrong(np.arange(20.0))


def test_scores_are_those_of_the_windows_and_tell_more_where_op_turns_further() -> None:
    t = np.arange(4000.0)
    op = np.where(t < 2000, 1.0, 5.0) * turning(t)
    windows = Windows(2000, 1e9)
    windows.add(batch(t, op))
    scores = windows.scores()
    assert [(begin, end) for begin, end, _ in scores] == [(w.t[0], w.t[-1]) for w in windows.best()]
    assert scores[1][2] == pytest.approx(5 * scores[0][2], rel=0.05)
