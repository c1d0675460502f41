"""K and Ti from the recording, against loops whose K and Ti are known."""

from __future__ import annotations

import csv
import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench.identify import record
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from glapp.identify import R2_USABLE, Identification, identified
from glapp.simulate import Walk, closed_loop
from glapp.tuning import amigo_step

REFINERY = Path(__file__).parents[1].parent / "shared/data/refinery"


def refinery(name: str) -> tuple[np.ndarray, ...]:
    """t [s, every file is sampled at 10 s], SP, PV and OP of one real loop."""
    path = REFINERY / f"{name}.csv"
    if not path.exists():
        pytest.skip("the refinery recordings are not beside this checkout")
    with path.open() as file:
        rows = list(csv.DictReader(file))
    columns = (np.array([float(row[column]) for row in rows]) for column in ("SP", "PV", "OP"))
    return (np.arange(len(rows)) * 10.0, *columns)


def loop(
    n: int = 2000,
    h: float = 1.0,
    k: float = 1.0,
    ti: float = 20.0,
    b: float = 1.0,
    *,
    runs: int = 1,
    seed: int = 0,
    noise: float = 0.02,
    load: float = 0.05,
    time_constant: float = 15.0,
    delay: float = 3.0,
    op_step: float = 0.0,
    op_limits: tuple[float, float] = (-math.inf, math.inf),
    setpoints: dict[float, float] | None = None,
    gap: float = 0.0,
    integrating: bool = False,
    tf: float = 0.0,
    filters: int = 2,
) -> tuple[np.ndarray, ...]:
    """Record (t, SP, PV, OP) of a PI loop that runs `runs` times a sample; operating point 50, load a random walk.

    `tf` is the controller's own filter on PV, which is recorded before it.
    The plant's gain has the sign of `k`, so that the loop is stable for both.
    """
    rng = np.random.default_rng(seed)
    step = h / runs
    line = [0.0] * max(1, round(delay / step))
    sp, x, w, integral, valve, held_noise = 50.0, 0.0, 0.0, 0.0, 0.0, 0.0
    decay = math.exp(-step / 2)
    filtered = [50.0] * filters
    record = np.empty((4, n))
    for i in range(n * runs):
        sp = (setpoints or {}).get(i * step, sp)
        w += load * math.sqrt(step) * rng.standard_normal()
        fresh = noise * rng.standard_normal()
        held_noise = fresh if runs == 1 else decay * held_noise + math.sqrt(1 - decay**2) * fresh
        pv = 50 + x + held_noise
        measured = pv
        for j in range(filters):
            filtered[j] += (measured - filtered[j]) * step / (tf + step) if tf else measured - filtered[j]
            measured = filtered[j]
        integral += k * step / ti * (sp - measured)
        out = 50 + k * (b * (sp - 50) - (measured - 50)) + integral
        limited = min(max(out, op_limits[0]), op_limits[1])
        integral += limited - out
        op = round(limited / op_step) * op_step if op_step else limited
        if i % runs == runs - 1:
            record[:, i // runs] = (i // runs * h, sp, pv, op)
        slack = op - 50 - valve
        valve += math.copysign(max(abs(slack) - gap / 2, 0.0), slack)
        line.append(valve)
        drive = math.copysign(1.0, k) * (line.pop(0) + w)
        x += step / time_constant * (drive if integrating else drive - x)
    return tuple(record)


def pick(found: Identification) -> tuple[float, float]:
    assert found.k is not None and found.ti is not None
    return found.k, found.ti


@pytest.mark.slow
@pytest.mark.parametrize("b", [0.0, 1.0])
@pytest.mark.parametrize(("k", "ti", "h"), [(1, 20, 1), (-0.4, 20, 1), (0.8, 60, 2), (0.02, 8, 0.5), (1, 20, 5)])
def test_exact_law_is_found_exactly(k: float, ti: float, h: float, b: float) -> None:
    scale = {0.02: 1e-2}.get(k, 1.0)  # a small gain goes with a large PV range
    t, sp, pv, op = loop(k=k / scale, ti=ti, h=h, b=b, setpoints={200 * h: 52.0, 900 * h: 49.0})
    found = identified(t, sp, pv, 50 + (op - 50) * scale)
    assert pick(found) == pytest.approx((k, ti), rel=1e-6)
    assert found.setpoint_weight == pytest.approx(b, abs=1e-6)
    assert found.usable and found.reason == "" and found.r2 == pytest.approx(1)


@pytest.mark.slow
@pytest.mark.parametrize("runs", [5, 20])
@pytest.mark.parametrize("h", [2.0, 4.0])
def test_a_controller_faster_than_the_recording_lies_in_the_interval_with_k_over_ti_right(runs: int, h: float) -> None:
    for seed in range(3):
        found = identified(*loop(h=h, runs=runs, time_constant=40, seed=seed))
        k, ti = pick(found)
        assert k / ti == pytest.approx(1 / 20, rel=0.03)
        assert found.k_low < 1 < found.k_high and found.ti_low < 20 < found.ti_high
        assert ti == pytest.approx(20, rel=0.1)  # it shows that not every scan was recorded


@pytest.mark.slow
def test_interval_of_the_scatter_covers_with_correlated_residuals() -> None:
    for correlation in (0.0, 0.8):
        covered = np.zeros(2)
        seeds = 25
        for seed in range(seeds):
            t, sp, pv, op = loop(n=1200, seed=seed)
            rng = np.random.default_rng(1000 + seed)
            error = np.zeros(t.size)
            for i in range(1, t.size):
                error[i] = correlation * error[i - 1] + 0.05 * math.sqrt(1 - correlation**2) * rng.standard_normal()
            found = identified(t, sp, pv, op + error)
            k, ti = pick(found)
            # The part that stands for the timing within a step is taken off: here the truth is the current error.
            covered += (found.k_low <= 1 <= found.k_high - k / ti, found.ti_low <= 20 <= found.ti_high - 1)
        assert np.all(covered / seeds > 0.8), covered / seeds


@pytest.mark.slow
@pytest.mark.parametrize("op_step", [0.02, 0.1])
def test_k_and_ti_are_found_from_a_coarse_op(op_step: float) -> None:
    for seed in range(3):
        found = identified(*loop(op_step=op_step, seed=seed, load=0.1))
        assert pick(found) == pytest.approx((1, 20), rel=0.1)
        assert found.usable


def test_manual_saturation_nan_gaps_and_bad_times_are_left_out() -> None:
    t, sp, pv, op = loop(n=3000, load=0.2, op_limits=(45, 55))
    flags = np.zeros(t.size, dtype=np.uint8)
    flags[500:900] = 1
    op[500:900] = 70 + np.sin(np.arange(400))
    pv[1000:1010] = np.nan
    op[1200] = np.inf
    pv[1500:1520] += 100
    flags[1500:1520] = 2
    t[2000:] += 3600  # a gap over which anything may have happened
    op[2000:] += 5
    t[2500] = t[2499]
    t[2700] = t[2690]
    found = identified(t, sp, pv, op, flags, limits=(45, 55))
    assert pick(found) == pytest.approx((1, 20), rel=1e-3)
    assert found.usable and found.samples < 2600


def test_a_few_unrecorded_bumps_do_not_move_the_values() -> None:
    t, sp, pv, op = loop(n=3000)
    for i in range(300, 3000, 400):
        op[i:] += 2.0
    found = identified(t, sp, pv, op)
    assert pick(found) == pytest.approx((1, 20), rel=0.02)
    assert found.r2 < 0.9 and not found.usable and "R²" in found.reason  # yet they are not hidden


def test_op_recorded_a_sample_late_or_early() -> None:
    t, sp, pv, op = loop()
    for lag, word in ((1, "late"), (-1, "early")):
        found = identified(t, sp, pv, np.roll(op, lag))
        assert pick(found) == pytest.approx((1, 20), rel=0.01)
        assert word in found.note


@pytest.mark.slow
@pytest.mark.parametrize(("filters", "tf"), [(1, 6.0), (2, 2.0), (2, 0.7)])
@pytest.mark.parametrize("gap", [0.0, 1.0])
def test_pv_recorded_before_the_filter_of_the_controller(filters: int, tf: float, gap: float) -> None:
    found = identified(*loop(n=4000, noise=0.3, tf=tf, filters=filters, gap=gap, b=0.0, setpoints={900: 52.0}))
    assert pick(found) == pytest.approx((1, 20), rel=0.03)
    assert f"{filters} x Tf" in found.note and found.usable
    assert found.setpoint_weight == pytest.approx(0, abs=0.05)


def simulated(plant: str, controller: tuple[float, ...], every: int = 1, **more: Any) -> tuple[np.ndarray, ...]:
    """Every so many samples of a loop of the test batch, whose controller has the thesis' filter before it."""
    s = closed_loop(
        plant,
        (*controller, 0.0, 0.0)[:4],
        **{"noise": 0.02, "d": 0.5, "load": Walk(rate=0.1), "seed": 4} | more,
        filter_in_loop=True,
    )
    return tuple(x[::every] for x in (s.t, s.sp, s.pv, s.op))


def holds(found: Identification, k: float, ti: float, td: float = 0.0) -> bool:
    return bool(
        found.k_low <= k <= found.k_high
        and found.ti_low <= ti <= found.ti_high
        and (found.td_low <= td <= found.td_high)
    )


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 4])
def test_a_filter_that_nobody_recorded_does_not_hide_the_settings(every: int) -> None:
    """K came out as 0.483 (to 0.503), Ti as 1.2 s with R² 0.999: the filter before the controller was missed."""
    found = identified(*simulated("P1", (0.781, 4.04), every, h=0.05, t_end=400))
    assert pick(found) == pytest.approx((0.781, 4.04), rel=0.05)
    assert holds(found, 0.781, 4.04) and found.usable
    assert found.k_high / found.k_low < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["P2", "P5", "P7"])
@pytest.mark.parametrize(("every", "op_step"), [(1, 0.0), (4, 0.0), (1, 0.05)])
def test_derivative_action_is_found_with_its_filter(plant: str, every: int, op_step: float) -> None:
    """A PID passed for a PI with K and Ti up to half as large again."""
    k, ti, td, _ = amigo_step(plant, "PID").controller
    found = identified(*simulated(plant, (k, ti, td), every, h=ti / 100, t_end=30 * ti, op_resolution=op_step))
    assert holds(found, k, ti, td), found
    assert found.usable and found.td_high > 0
    assert pick(found) == pytest.approx((k, ti), rel=0.2)
    if every == 1 and not op_step:
        assert (found.k, found.ti, found.td) == pytest.approx((k, ti, td), rel=1e-3)
        assert found.td_low > 0 and "PID" in found.note


def test_what_one_sample_in_ti_leaves_open_is_in_the_interval() -> None:
    for plant, h in (("P2", 2.0), ("P5", 1.0), ("P4", 2.5)):
        k, ti, td, _ = amigo_step(plant, "PI").controller
        every = 40
        found = identified(*simulated(plant, (k, ti), every, h=h / every, t_end=1000 * h))
        assert holds(found, k, ti, td), (plant, found)


@pytest.mark.slow
def test_a_long_recording_is_known_by_its_liveliest_stretches() -> None:
    t, sp, pv, op = loop(n=40_000, load=0.1)
    op[20_000:22_000] = 50.0  # OP stands still: nothing to learn there, and nothing of the law
    flags = (op == 50.0).astype(np.uint8)
    found = identified(t, sp, pv, op, flags)
    assert pick(found) == pytest.approx((1, 20), rel=1e-3)
    assert found.usable and found.samples > 37_000


def test_repeated_rows_of_a_historian_that_stood_still_are_left_out() -> None:
    t, sp, pv, op = loop(n=3000)
    for i in range(100, 3000, 100):
        for x in (pv, op):
            x[i : i + 40] = x[i]
    found = identified(t, sp, pv, op)
    assert pick(found) == pytest.approx((1, 20), rel=1e-3)
    assert found.usable


@pytest.mark.slow
@pytest.mark.parametrize("scale_pv", [1e-3, 1e4])
@pytest.mark.parametrize("scale_op", [1e-3, 1e4])
@pytest.mark.parametrize("scale_t", [0.01, 60.0])
def test_k_scales_with_the_units_and_ti_with_time(scale_pv: float, scale_op: float, scale_t: float) -> None:
    t, sp, pv, op = loop(n=800, op_step=0.05, setpoints={300: 51.0})
    one = identified(t, sp, pv, op)
    other = identified(t * scale_t, sp * scale_pv, pv * scale_pv, op * scale_op)
    k = scale_op / scale_pv
    for name, factor in {"k": k, "k_low": k, "k_high": k, "ti": scale_t, "ti_low": scale_t, "r2": 1.0}.items():
        assert getattr(other, name) == pytest.approx(getattr(one, name) * factor, rel=1e-4), name


@pytest.mark.slow
def test_a_reversed_op_changes_only_the_sign_of_k() -> None:
    t, sp, pv, op = loop(n=800, op_step=0.05)
    one, other = identified(t, sp, pv, op), identified(t, sp, pv, -op)
    assert other.k == pytest.approx(-one.k) and other.ti == pytest.approx(one.ti)
    assert (other.k_low, other.k_high) == pytest.approx((-one.k_high, -one.k_low))
    assert identified(t, -sp, -pv, -op).k == pytest.approx(one.k)


@pytest.mark.slow
def test_setpoint_weight_is_told_only_where_sp_moves() -> None:
    assert identified(*loop()).setpoint_weight is None
    moving = loop(b=0.3, setpoints={300: 53.0, 900: 50.0, 1500: 54.0})
    assert identified(*moving).setpoint_weight == pytest.approx(0.3, abs=0.02)
    assert identified(*moving, setpoint_weight=0.3).k == pytest.approx(1, rel=1e-6)
    assert identified(*moving, setpoint_weight=0.3).setpoint_weight == 0.3
    assert not identified(*moving, setpoint_weight=1.0).r2 > 0.999


@pytest.mark.slow
def test_setpoint_weight_is_not_read_off_means_that_do_not_tell_k() -> None:
    """Regression: it was 0.04, from means of 4 samples, mostly at rest; longer ones give 0.45 to 1.32."""
    made = record("PID/OP rounded/37")
    assert made is not None
    found = identified(made.t, made.sp, made.pv, made.op)
    assert found.usable and found.setpoint_weight is None


@pytest.mark.slow
def test_what_is_no_pi_controller_is_not_usable() -> None:
    t, sp, pv, _ = loop()
    rng = np.random.default_rng(3)
    walk = 50 + np.cumsum(rng.standard_normal(t.size)) * 0.1
    proportional = 50 + 2 * (sp - pv)
    integral = 50 + np.cumsum(sp - pv) / 10
    opposite = 50 + 2 * (sp - pv) - 0.1 * np.cumsum(sp - pv)
    cases = {
        "R²": walk,
        "there may be no integral action": proportional + 1e-3 * rng.standard_normal(t.size),
        "K may be 0": integral + 1e-3 * rng.standard_normal(t.size),
        "opposite signs": opposite,
        "OP never moves": np.full(t.size, 50.0),
        "no OP": None,
    }
    for words, op in cases.items():
        found = identified(t, sp, pv, op)
        assert not found.usable and words in found.reason, (words, found)


def test_nothing_to_learn_from() -> None:
    t, sp, pv, op = loop(n=300)
    manual = np.ones(300, dtype=np.uint8)
    assert identified(t, sp, pv, op, manual).reason.startswith("no step between samples is in auto, good, ")
    assert "only 29 steps" in identified(t[:30], sp[:30], pv[:30], op[:30]).reason
    assert identified(t[:0], sp[:0], pv[:0], op[:0]).reason.startswith("OP has no value in any row")
    assert "PV never moves" in identified(t, sp, sp - 1, np.cumsum(sp)).reason
    assert "no step between samples" in identified(t * 0, sp, pv, op).reason
    assert "PV has no value in any row" in identified(t, sp, pv * np.nan, op).reason


numbers = st.one_of(
    st.floats(-1e3, 1e3), st.sampled_from([0.0, 1.0, math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324])
)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(arrays(np.float64, (4, 70), elements=numbers))
def test_any_numbers_give_an_answer_without_nan(data: np.ndarray) -> None:
    for t in (data[0], np.arange(70.0)):
        found = identified(t, *data[1:])
        for name, value in dataclasses.asdict(found).items():
            assert not (isinstance(value, float) and math.isnan(value)), (name, found)
        assert found.usable == (found.reason == "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "k", "ti"),
    [
        ("FIC46005_0902", (0.0115, 0.0150), (34, 43)),  # 35 s once a sample, 40 s if it runs much faster
        ("FIC46005_0614", (0.0115, 0.0150), (34, 43)),  # the same valve and controller, three months earlier
        ("FIC20102_1207", (0.10, 0.17), (35, 60)),
        ("LIC30102_0825", (-2.2, -1.7), (100, 300)),
    ],
)
def test_controllers_of_a_refinery_are_identified(name: str, k: tuple[float, float], ti: tuple[float, float]) -> None:
    found = identified(*refinery(name))
    assert k[0] < found.k < k[1] and ti[0] < found.ti < ti[1], found
    assert found.usable and found.r2 >= R2_USABLE


def test_minutes_of_a_real_loop_of_35_seconds_are_not_believed() -> None:
    found = identified(*(column[::6] for column in refinery("FIC46005_0902")))  # said 13.6 s, K a third of the true one
    assert not found.usable
    assert found.ti_low < 35 < found.ti_high and found.k_low < 0.0123 < found.k_high


@pytest.mark.slow
def test_recordings_of_one_sinusoid_do_not_contradict_each_other() -> None:
    """Regression: the intervals of one controller were 207 to 231, 115 to 131 and 160 to 178 s."""
    spans = [identified(*refinery(f"LIC31102B_{day}")) for day in ("0824", "0904", "1127")]
    assert max(found.ti_low for found in spans) < min(found.ti_high for found in spans)
    assert max(found.k_low for found in spans) < min(found.k_high for found in spans)


def test_a_real_loop_that_winds_up_is_not_identified() -> None:
    assert not identified(*refinery("FIC10104_0224")).usable
