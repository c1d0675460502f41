"""From a recording, or a stream, to a verdict."""

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from filtered import filtered

import glapp
from glapp import Estimator, InputError, Loop, recording_from
from glapp.result import REASONS
from glapp.simulate import Simulation

REFINERY = Path(__file__).parents[1].parent / "shared/data/refinery"
PI = {"k": 0.48, "ti": 0.3117, "setpoint_weight": 0}


@pytest.fixture(scope="module")
def worn() -> Simulation:
    return filtered("P3", (0.48, 0.3117, 0, 0), d=0.05, noise=0.002, t_end=800, setpoint=[(1, 1.0)], load=[(100, 0.3)])


def loop(**changes: Any) -> Loop:
    return Loop(**({"name": "sim", "controller": PI, "process": {"kp": 1}, "op_unit": "V"} | changes))


def shown(s: Simulation, **changes: Any) -> glapp.Result:
    return glapp.analyze(recording_from(s.to_arrow(), loop(**changes)), fit=False)


@pytest.mark.slow
def test_a_worn_valve_gets_an_estimate_within_its_repeatability(worn: Simulation) -> None:
    result = shown(worn, tf=0.1)
    assert (result.verdict, result.reason) == ("estimate", None)
    assert result.d_hat == pytest.approx(0.05, rel=0.15)
    assert result.repeatability is not None
    assert result.repeatability[0] <= result.d_hat <= result.repeatability[1]
    assert result.detections + sum(result.reasons.values()) == result.total_half_periods == result.half_periods.count


@pytest.mark.slow
def test_provisional_with_its_count(worn: Simulation) -> None:
    result = shown(worn, n=31, tf=0.1)
    assert result.verdict == "provisional"
    assert result.d_hat is not None and result.detections < 31
    assert result.reason is not None and f"{result.detections} of the 31" in result.reason


@pytest.mark.slow
def test_no_estimate_names_what_rejected(worn: Simulation) -> None:
    result = shown(worn, controller=PI | {"ti": 100.0})
    assert (result.verdict, result.d_hat) == ("no_estimate", None)
    assert result.reason is not None and "was accepted" in result.reason


def test_silent_loop_has_no_half_period() -> None:
    t = np.arange(500.0)
    data = {"t": t, "SP": np.ones(500), "PV": np.full(500, 0.5), "OP": np.sin(t)}
    result = glapp.estimate(recording_from(data, loop()))
    assert (result.verdict, result.total_half_periods) == ("no_estimate", 0)
    assert result.reason is not None and "never crossed" in result.reason


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"cascade": {"role": "primary", "partner": "FIC2"}}, "FIC2"),
        ({"split_range": True}, "split range"),
        ({"shared_valve_with": "PIC7"}, "PIC7"),
    ],
)
def test_places_where_a_width_means_nothing_are_refused(worn: Simulation, changes: dict[str, Any], word: str) -> None:
    result = shown(worn, **changes)
    assert (result.verdict, result.d_hat) == ("refused", None)
    assert result.reason is not None and word in result.reason


def test_without_a_controller(worn: Simulation) -> None:
    with pytest.raises(InputError, match="no controller settings"):
        glapp.estimate(recording_from(worn.to_arrow(), loop(controller=None)))
    blind = recording_from(worn.to_arrow().drop_columns(["OP", "POSITION"]), loop(controller=None))
    result = glapp.analyze(blind, fit=False)
    assert result.verdict == "refused"
    assert result.reason is not None and "without an OP column" in result.reason
    with pytest.raises(InputError, match="no controller settings"):
        Estimator(loop(controller=None), h=1.0)


@pytest.mark.slow
def test_filter_time_is_given_or_the_smallest_that_serves(worn: Simulation) -> None:
    given = shown(worn, tf=0.1).settings
    assert (given.tf, given.notes["tf"]) == (0.1, "given")
    found = shown(worn)
    ladder = [share * 0.3117 for share in (0.1, 0.2, 0.5, 1.0, 2.0)]
    assert found.settings.tf in ladder
    accepted = [shown(worn, tf=tf).detections for tf in ladder]
    smallest = next(tf for tf, count in zip(ladder, accepted, strict=True) if count >= 5)
    assert found.settings.tf == smallest
    assert found.detections == accepted[ladder.index(smallest)]


@pytest.mark.slow
def test_process_gain_given_default_or_dropped(worn: Simulation) -> None:
    given = shown(worn, tf=0.1).half_periods
    for changes, kp in [
        ({"process": {"kp": 2}}, 2.0),
        ({"process": {}}, None),
        ({"process": {"type": "integrating"}}, None),
        ({"process": {}, "pv_span": (0, 4), "op_span": (-2, 2), "controller": PI | {"gain_unit": "OP/PV"}}, 1.5),
        ({"process": {}, "pv_span": (0, 2), "op_span": (-2, 2), "controller": PI | {"gain_unit": "OP/PV"}}, 0.75),
    ]:
        result = shown(worn, tf=0.1, **changes)
        assert result.settings.kp == kp
        part = 0.0 if kp is None else given.delta_y / kp
        assert result.half_periods.kp_part == pytest.approx(part)
        assert result.half_periods.free == pytest.approx(given.free)


@pytest.mark.slow
def test_every_way_of_writing_the_controller_gives_one_answer(worn: Simulation) -> None:
    spans = {"pv_span": (-1.0, 4.0), "op_span": (-5.0, 15.0)}  # 0.48 OP/PV = 0.12 %/%
    ways: list[dict[str, Any]] = [
        {"k": 0.48, "ti": 0.3117, "gain_unit": "OP/PV"},
        {"k": 0.12, "ti": 0.3117, "gain_unit": "%/%"},
        {"pb": 100 / 0.12, "ti": 0.3117},
        {"pb": 100 / 0.12, "ti": 0.3117 / 60, "ti_unit": "min"},
        {"k": 0.12, "gain_unit": "%/%", "ti": 60 / 0.3117, "ti_unit": "repeats/min"},
        {"form": "series", "k": 0.12, "gain_unit": "%/%", "ti": 1 / 0.3117, "ti_unit": "repeats/s"},
        {"form": "parallel", "kp": 0.48, "ki": 0.48 / 0.3117, "gain_unit": "OP/PV"},
    ]
    process = {"kp": 1, "kp_unit": "PV/OP"}
    answers = [shown(worn, tf=0.1, process=process, controller=way | {"setpoint_weight": 0}, **spans) for way in ways]
    for answer in answers:
        assert answer.d_hat == pytest.approx(answers[0].d_hat, rel=1e-9)
        assert answer.d_hat_percent_span == pytest.approx(5.0 * answers[0].d_hat, rel=1e-9)


def test_tables_of_every_kind_give_the_same_bits(worn: Simulation) -> None:
    table = worn.to_arrow().select(["t", "SP", "PV", "OP"])
    columns = {name: table[name].to_numpy() for name in table.column_names}
    kinds = [table, table.to_pandas(), pl.DataFrame(columns), columns, pa.RecordBatch.from_pydict(columns)]
    kinds.append(pd.DataFrame(columns).to_records(index=False))
    answers = [json.dumps(glapp.estimate(recording_from(kind, loop())).to_dict()) for kind in kinds]
    assert len(set(answers)) == 1


def test_stream_is_the_recording(worn: Simulation) -> None:
    settings = loop(tf=0.1)
    whole = glapp.estimate(recording_from(worn.to_arrow(), settings)).half_periods.to_dict()
    many, single = Estimator(settings, h=0.05), Estimator(settings, h=0.05)
    records = []
    for i in range(0, len(worn.t), 1000):
        part = slice(i, i + 1000)
        many.update_many(worn.t[part], worn.sp[part], worn.pv[part], worn.op[part], worn.flags[part])
        if i == 5000:
            many = Estimator.load(many.save())
            kept = 0
        for j in range(i, min(i + 1000, len(worn.t))):
            record = single.update(worn.t[j], worn.sp[j], worn.pv[j], worn.op[j], int(worn.flags[j]))
            if record is not None:
                records.append(record)
    kept = many.half_periods.count
    # Checks of a recording only.
    for name in ("swing", "plateau"):
        assert np.isfinite(whole.pop(name)).any()
        assert np.isnan(many.half_periods.to_dict()[name]).all()
        assert np.isnan([getattr(record, name) for record in records]).all()
    for name, column in whole.items():
        assert np.array_equal([getattr(record, name) for record in records], column, equal_nan=name != "reason"), name
        assert np.array_equal(many.half_periods.to_dict()[name], column[-kept:], equal_nan=name != "reason"), name
    assert many.estimate == single.estimate
    assert many.reasons == single.reasons


def test_an_estimator_goes_through_pickle_and_refuses_what_is_not_one(worn: Simulation) -> None:
    one = Estimator(loop(), h=0.05)
    one.update_many(worn.t[:8000], worn.sp[:8000], worn.pv[:8000], worn.op[:8000])
    other = pickle.loads(pickle.dumps(one))
    assert type(other) is Estimator
    assert (other.estimate, other.save()) == (one.estimate, one.save())
    for text in ("", "{}", '{"format": "glapp detector 1"}', "[1]"):
        with pytest.raises(InputError, match="saved detector"):
            Estimator.load(text)
    with pytest.raises(InputError, match="h: is 0"):
        Estimator(loop(), h=0)


@pytest.mark.slow
def test_result_as_frame_dict_and_figure(worn: Simulation) -> None:
    result = shown(worn)
    frame = result.to_frame()
    assert len(frame) == result.half_periods.count
    assert set(frame["reason"]) <= set(REASONS)
    assert (frame["mask"] == 0).equals(frame["reason"] == "accepted")
    plain = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert plain["d_hat"] == result.d_hat
    assert plain["half_periods"] == result.total_half_periods
    assert len(glapp.plot(result).data) > 0


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_no_number_is_ever_not_a_number(worn: Simulation, size: float) -> None:
    rng = np.random.default_rng(7)
    pv = worn.pv * size
    pv[rng.integers(0, len(pv), 40)] = np.nan
    pv[rng.integers(0, len(pv), 5)] = np.inf
    pv[rng.integers(0, len(pv), 5)] = 1e30
    data = {"t": worn.t, "SP": worn.sp * size, "PV": pv, "OP": worn.op}
    result = glapp.estimate(recording_from(data, loop()))
    json.dumps(result.to_dict(), allow_nan=False)
    for name, column in result.half_periods.to_dict().items():
        if name not in (
            "op_travel",
            "swing",
            "previous_delta_y",
            "d_hat_before",
            "d_hat",
            "median_mean",
            "noise_floor",
        ):
            assert np.isfinite(column).all(), name


needs_refinery = pytest.mark.skipif(not REFINERY.is_dir(), reason=f"the refinery recordings are not at {REFINERY}")


def refinery(name: str, **settings: Any) -> glapp.Result:
    path = REFINERY / f"{name}.csv"
    loops = [Loop(name=name, **settings)] if settings else None
    (recording,) = glapp.open_recordings(path, loops)
    return glapp.analyze(recording, fit=False)


@pytest.mark.slow
@needs_refinery
def test_stiction_is_found_with_nothing_but_the_file() -> None:
    result = refinery("FIC46005_0902")
    assert result.verdict in ("estimate", "provisional")
    assert (result.verdict == "provisional") == (result.detections < 9)
    # K/Ti is told; K and Ti by themselves hang on whether the controller runs faster than the recording.
    assert result.settings.k is not None and result.settings.ti is not None
    assert result.settings.k / result.settings.ti == pytest.approx(0.012 / 34, rel=0.05)
    assert result.settings.ti == pytest.approx(38, rel=0.15)
    assert result.d_hat is not None and 0.40 <= result.d_hat <= 0.60
    given = refinery("FIC46005_0902", controller={"k": 0.012, "ti": 34})
    assert given.d_hat is not None and 0.40 <= given.d_hat <= 0.60


@pytest.mark.slow
@needs_refinery
@pytest.mark.parametrize("name", ["LIC31102B_0824", "LIC31102B_0904", "LIC31102B_1127"])
def test_a_linear_oscillation_is_no_backlash(name: str) -> None:
    result = refinery(name)
    assert (result.verdict, result.d_hat) == ("no_estimate", None)
    assert result.reason is not None and "sine wave" in result.reason


@pytest.mark.slow
@needs_refinery
def test_wound_up_direct_acting_and_slave_loops_are_recognised() -> None:
    wound_up = refinery("FIC10104_0224")
    assert (wound_up.verdict, wound_up.d_hat) == ("refused", None)
    assert wound_up.reason
    direct = refinery("LIC30102_0825")
    assert direct.identification is not None and direct.identification.k is not None and direct.identification.k < 0
    slave = refinery("FIC40102B_0825")
    assert any("cascade" in finding.text for finding in slave.quality)


FILTER = 0.155
"""Half of Ti [s], so that noise makes half-periods that look like backlash."""


def feed(s: Simulation, **changes: Any) -> Estimator:
    estimator = Estimator(loop(**changes), h=s.t[1] - s.t[0])
    estimator.update_many(s.t, s.sp, s.pv, s.op)
    return estimator


@pytest.fixture(scope="module")
def noisy() -> Simulation:
    """No gap: noise alone makes hundreds of half-periods, and dozens of them look like backlash."""
    return filtered("P3", (0.48, 0.3117, 0, 0), d=0.0, noise=0.002, t_end=3000, setpoint=[(1, 1.0)], load=[(100, 0.3)])


def test_a_stream_shows_no_width_below_the_noise_limit(noisy: Simulation) -> None:
    """Regression: it showed the width of a gap that is not there, from nine detections."""
    estimator = feed(noisy, tf=FILTER)
    behind, floor = estimator.median_mean, estimator.noise_floor
    assert behind is not None and floor is not None
    assert behind[4] == 9 and 0.0 < behind[0] < floor
    assert estimator.estimate is None
    halves = estimator.half_periods
    assert np.isnan(halves.d_hat[halves.median_mean < halves.noise_floor]).all()
    # One at a time the same is shown.
    single = Estimator(loop(tf=FILTER), h=0.05)
    last = None
    for row in zip(noisy.t, noisy.sp, noisy.pv, noisy.op, strict=True):
        last = single.update(*row) or last
    assert last is not None and single.estimate is None
    assert (last.noise_floor, np.isnan(last.d_hat)) == (floor, True)


def test_a_stream_shows_the_true_width(worn: Simulation) -> None:
    estimator = feed(worn, tf=FILTER)
    assert estimator.estimate == estimator.median_mean
    assert estimator.estimate is not None and estimator.estimate[0] == pytest.approx(0.05, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("kp", [1.0, None])
def test_stream_and_analysis_have_one_floor(noisy: Simulation, worn: Simulation, kp: float | None) -> None:
    for s in (noisy, worn):
        result = shown(s, tf=FILTER, process={"kp": kp} if kp else {})
        estimator = feed(s, tf=FILTER, process={"kp": kp} if kp else {})
        assert result.noise_floor == estimator.noise_floor is not None
        assert (result.d_hat is None) == (estimator.estimate is None)


def test_the_floor_is_saved_and_an_older_save_can_be_read(noisy: Simulation) -> None:
    half = noisy.t.size // 2 + 7
    first = [x[:half] for x in (noisy.t, noisy.sp, noisy.pv, noisy.op)]
    second = [x[half:] for x in (noisy.t, noisy.sp, noisy.pv, noisy.op)]
    whole, cut = feed(noisy, tf=FILTER), Estimator(loop(tf=FILTER), h=0.05)
    cut.update_many(*first)
    saved = cut.save()
    restored = Estimator.load(saved)
    restored.update_many(*second)
    assert restored.save() == whole.save()
    # Saved before there was a floor: it goes on, and knows the noise again after twenty samples.
    older = json.loads(saved)
    del older["state"]["signal"]["noise"], older["state"]["memory"]["noise_floor"]
    old = Estimator.load(json.dumps(older))
    assert old.noise_floor is None
    old.update_many(*second)
    assert old.median_mean == whole.median_mean and old.estimate is None
    assert old.noise_floor == pytest.approx(whole.noise_floor, rel=0.05)
