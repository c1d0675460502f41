"""Arrays at the functions of `glapp`, recordings without a setpoint, and how much `import glapp` loads."""

from __future__ import annotations

import subprocess
import sys
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from filtered import filtered

import glapp
from glapp.samples import Samples
from glapp.simulate import Simulation

LOOP = glapp.Loop(name="P3", op_unit="1", controller={"k": 0.48, "ti": 0.3117, "setpoint_weight": 0})
HEAVY = (
    "pyarrow",
    "scipy",
    "matplotlib",
    "plotly",
    "glapp.tuning",
    "glapp.nonlinear",
    "glapp.simulate",
    "glapp.modules",
)


@pytest.fixture(scope="module")
def worn() -> Simulation:
    settings: dict[str, Any] = {"noise": 0.005, "h": 0.1, "t_end": 200, "seed": 1}
    return filtered("P3", (0.48, 0.3117, 0, 0), d=0.05, setpoint=[(1, 1.0)], load=[(50, 0.3), (100, -0.2)], **settings)


def told(answer: Any) -> Any:
    """Everything but the name of the loop and where it came from."""
    return {k: v for k, v in answer.to_dict().items() if k not in ("name", "source", "columns")}


@pytest.mark.verify
def test_arrays_get_the_answer_of_their_recording(worn: Simulation) -> None:
    recording = glapp.recording_from(worn.to_arrow().drop_columns("POSITION"), LOOP)
    flags = next(recording.batches()).flags
    signals: dict[str, Any] = {"t": worn.t, "pv": worn.pv, "op": worn.op, "flags": flags}
    assert glapp.fit(sp=worn.sp, **signals, loop=LOOP).to_dict() == glapp.fit(recording).to_dict()
    assert glapp.identify(sp=worn.sp, **signals, loop=LOOP) == glapp.identify(recording)
    one, other = glapp.estimate(sp=worn.sp, **signals, loop=LOOP), glapp.estimate(recording)
    assert (one.verdict, one.d_hat, one.reasons) == (other.verdict, other.d_hat, other.reasons)
    whole = glapp.analyze(sp=worn.sp, **signals, loop=LOOP)
    assert whole.fit is not None and whole.fit.found and whole.crossings == other.crossings


def test_a_step_test_in_arrays() -> None:
    steps = [(0, 100, 50.0), (100, 200, 53.0), (200, 300, 56.0), (300, 400, 52.0)]
    plant = ([0.8], [5, 1], 0)
    s = filtered(plant, (0.5, 10, 0, 0), d=2.0, noise=0.05, h=1.0, t_end=400, manual=steps, setpoint=[(0, 40.0)])
    found = glapp.step_test(t=s.t, pv=s.pv, op=s.op, manual=True)
    assert found.low is not None and found.high is not None and found.low <= 2.0 <= found.high + 0.05
    assert glapp.step_test(t=s.t, pv=s.pv, op=s.op, flags=s.flags & 1).d == found.d


def test_times_may_be_dates(worn: Simulation) -> None:
    t = np.datetime64("2026-03-01T12:00:00") + (worn.t * 1e9).astype("timedelta64[ns]")
    made = Samples(LOOP, {"t": t, "pv": worn.pv, "op": worn.op})
    assert made.t0 is not None and made.t0.isoformat() == "2026-03-01T12:00:00"
    assert np.allclose(next(made.batches()).t, worn.t[:65536], atol=1e-6)


def test_times_of_pandas_with_a_zone_and_of_python(worn: Simulation) -> None:
    """Times with a zone were no numbers, and the nanoseconds of a timedelta64 were taken for seconds."""
    n = 50
    zoned = pd.date_range("2026-03-29 01:30", periods=n, freq="10min", tz="Europe/Stockholm")  # summer time begins
    own = [datetime(2026, 3, 1, tzinfo=UTC) + timedelta(seconds=600 * k) for k in range(n)]
    since = [timedelta(seconds=600 * k) for k in range(n)]
    for t in (zoned, pd.Series(zoned), own, [None, *own[1:]], zoned.tz_convert(None), zoned - zoned[0], since):
        made = next(Samples(LOOP, {"t": t, "pv": worn.pv[:n]}).batches())
        assert np.nanmax(np.abs(np.diff(made.t) - 600)) < 1e-6


def test_times_with_a_zone_keep_it() -> None:
    """Arrays began at the hour of UTC, which the report calls local time; a table of the same times did not."""
    zoned = pd.date_range("2026-03-01 12:00", periods=3, freq="s", tz="Europe/Stockholm")
    missing = pd.Series([pd.NaT, *zoned[1:]])
    for t in (zoned, pd.Series(zoned), missing, list(zoned.to_pydatetime()), pl.Series(zoned), pa.array(zoned)):
        made = Samples(LOOP, {"t": t, "pv": [1.0, 2.0, 3.0]})
        assert made.zone == "Europe/Stockholm" and f"{made.t0:%H:%M %z}" == "12:00 +0100", type(t)
    offset = [datetime(2026, 3, 1, 12, second, tzinfo=timezone(timedelta(hours=1))) for second in (0, 1)]
    made = Samples(LOOP, {"t": offset, "pv": [1.0, 2.0]})
    assert (made.zone, made.t0) == ("UTC", offset[0])


def test_a_masked_or_infinite_value_is_none() -> None:
    """The number under a mask was read as a value, and so was an infinite one, after which no gap was found."""
    mask = [False, True, False]
    masked = np.ma.masked_array([1.0, -9999.0, 2.0], mask=mask)
    for pv in (masked, masked.astype(int), [1.0, np.inf, 2.0], [1.0, -np.inf, 2.0]):
        batch = next(Samples(LOOP, {"t": [0.0, 1.0, 2.0], "pv": pv}).batches())
        assert batch.flags is not None and batch.flags.tolist() == [0, 2, 0] and np.isnan(batch.pv[1])
    dates = np.array(["2026-03-01T12:00:00", "1970-01-01", "2026-03-01T12:00:02"], "datetime64[s]")
    for t in (dates, dates.astype(object), dates - dates[0], np.array([0, -9999, 2]), np.array([0.0, np.inf, 2.0])):
        given = t if t.dtype == float else np.ma.masked_array(t, mask=mask)
        batch = next(Samples(LOOP, {"t": given, "pv": [1.0, 1.5, 2.0]}).batches())
        assert np.array_equal(batch.t, [0.0, np.nan, 2.0], equal_nan=True)
    stream = [glapp.Estimator(LOOP, h=1.0) for _ in range(2)]
    stream[0].update_many(t=np.arange(3.0), sp=np.zeros(3), pv=masked)
    stream[1].update_many(t=np.arange(3.0), sp=np.zeros(3), pv=masked.filled(np.nan))
    assert stream[0].save() == stream[1].save()


def test_what_is_no_result_or_loop_is_one_line() -> None:
    with pytest.raises(glapp.InputError, match=r"^results: must be a list of results of glapp.analyze"):
        glapp.to_arrow(["FIC101"])  # type: ignore[list-item]
    with pytest.raises(glapp.InputError, match=r"^of: is a NoneType, must be a result of glapp.analyze"):
        glapp.plot(None)  # type: ignore[arg-type]
    with pytest.raises(glapp.InputError, match=r"^loop: is a dict, must be a glapp.Loop"):
        glapp.estimate(t=[0, 1], sp=[0, 0], pv=[1, 2], loop={"name": "FIC101"})  # type: ignore[arg-type]
    with pytest.raises(glapp.InputError, match=r"^loop: is a dict, must be a glapp.Loop"):
        glapp.Estimator({"name": "FIC101"}, h=1.0)  # type: ignore[arg-type]


def test_rows_without_pv_are_bad_and_an_sp_that_is_not_recorded_is_not_missing() -> None:
    batch = next(Samples(LOOP, {"t": [0.0, 1.0, 2.0], "pv": [1.0, np.nan, 2.0]}).batches())
    assert batch.sp is None and batch.flags is not None and batch.flags.tolist() == [0, 2, 0]


@pytest.mark.parametrize(
    ("signals", "line"),
    [
        ({"pv": [1, 2]}, "t: is missing; give a recording, or t=..., pv=..., op=..."),
        ({}, "t and pv: is missing"),
        ({"t": [0, 1], "pv": [1]}, "pv: has 1 samples, and t has 2"),
        ({"t": [0.0], "pv": [1]}, "t: has fewer than two samples"),
        ({"t": [0, 1], "pv": [np.nan, np.nan]}, "pv: has no value in any of 2 rows"),
        ({"t": [0, 1], "pv": ["a", "b"]}, "pv: is not numbers"),
        ({"t": [[0, 1]], "pv": [1, 2]}, "t: has 2 dimensions, must have one"),
        ({"t": [0, 1], "pv": np.array([1, 2j])}, "pv: holds complex numbers, must be real"),
        (
            {"t": [3, 2, 1], "pv": [1, 2, 3]},
            "t: runs backwards in 2 of 2 steps: the newest sample comes first; reverse",
        ),
        ({"t": [0, 1], "pv": [1, 2], "flags": [0, 16]}, "flags: is 16, must be a sum of 1 (not in automatic)"),
        ({"t": [timedelta(0), 1], "pv": [1, 2]}, "t: is not times: 1 among durations; give seconds"),
        ({"t": np.array(["30000-01-01", "30000-01-02"], "M8[D]"), "pv": [1, 2]}, "t: begins at 30000-01-01, beyond"),
        ({"t": np.full(2, "NaT", "datetime64[s]"), "pv": [1, 2]}, "t: holds no time"),
        ({"t": [datetime(2026, 3, 1), datetime(2026, 3, 1, tzinfo=UTC)], "pv": [1, 2]}, "t: holds times with a zone"),
        ({"t": [datetime(2026, 3, 1), 7], "pv": [1, 2]}, "t: is not times"),
        ({"t": ["2026-03-01 12:00", "2026-03-01 12:01"], "pv": [1, 2]}, "t: is not numbers"),
    ],
)
def test_wrong_arrays_are_one_line(signals: dict[str, Any], line: str) -> None:
    with pytest.raises(glapp.InputError) as caught:
        glapp.fit(**signals)
    assert str(caught.value).startswith(line)


def test_an_op_that_looks_like_a_fraction_is_no_percentage(worn: Simulation) -> None:
    """Holds for every question, with one recording or two."""
    op = 0.5 + (worn.op - worn.op.mean()) / np.ptp(worn.op) / 2.1
    signals = {"t": worn.t, "pv": worn.pv, "op": op}
    assert glapp.fit(**signals).unit == "OP unit"
    assert glapp.fit([{"t": worn.t, "SP": worn.sp, "PV": worn.pv, "OP": op}] * 2).unit == "OP unit"
    result = glapp.analyze(sp=worn.sp, loop=LOOP.model_copy(update={"op_span": None, "op_unit": "%"}), **signals)
    assert result.unit == "OP unit" and result.answer.acceptable is None
    assert "span" in {finding.code for finding in result.quality}
    fraction = glapp.analyze(sp=worn.sp, loop=LOOP.model_copy(update={"op_span": (0.0, 1.0)}), **signals)
    assert "span" not in {finding.code for finding in fraction.quality} and fraction.answer.acceptable is not None


def test_a_recording_has_its_own_signals(worn: Simulation) -> None:
    recording = glapp.recording_from(worn.to_arrow(), LOOP)
    with pytest.raises(glapp.InputError, match="pv, loop: a recording has its signals and its loop"):
        glapp.fit(recording, pv=worn.pv, loop=LOOP)
    with pytest.raises(glapp.InputError, match=r"a ndarray is not a table with named columns"):
        glapp.fit(worn.pv)  # type: ignore[arg-type]


@pytest.mark.verify
@pytest.mark.parametrize("names", [("t", "PV", "OP"), ("t", "FIC7.PV", "FIC7.OP")])
def test_without_a_setpoint_the_fit_answers_and_the_crossings_say_why_not(
    tmp_path: Path, worn: Simulation, names: tuple[str, ...]
) -> None:
    path = tmp_path / "FIC7.csv"
    rows = zip(worn.t, worn.pv, worn.op, strict=True)
    path.write_text("\n".join([",".join(names), *(f"{t},{pv},{op}" for t, pv, op in rows)]))
    [recording] = glapp.open_recordings(path)
    result = glapp.analyze(recording)
    assert result.fit is not None and result.fit.verdict == "backlash"
    assert result.fit.d == pytest.approx(0.05, rel=0.1)
    assert result.verdict == "backlash" and result.crossings == "refused"
    assert result.reason is not None and "SP is not recorded" in result.reason
    assert not {"not_a_number", "cascade_slave"} & {finding.code for finding in result.quality}
    assert not glapp.identify(recording).usable


def test_a_transmitter_beside_loops_is_no_loop(tmp_path: Path) -> None:
    path = tmp_path / "plant.csv"
    path.write_text("t,FIC1.SP,FIC1.PV,FIC1.OP,TI2.PV,TI2.OUT\n0,1,1,1,5,5\n1,1,2,3,6,6\n")
    assert [recording.name for recording in glapp.open_recordings(path)] == ["FIC1"]


@pytest.mark.slow
def test_importing_glapp_loads_no_large_library() -> None:
    look = f"import glapp, sys; print([name for name in {HEAVY} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_what_is_loaded_later_is_there() -> None:
    assert all(getattr(glapp, name) is not None for name in dir(glapp))
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        glapp.nothing  # noqa: B018
