"""Each fault, made on purpose, is found; healthy recordings have none; no data makes the inspection fail."""

from __future__ import annotations

import dataclasses
import math
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from test_identify import loop, numbers, refinery

import glapp
from glapp.errors import InputError
from glapp.identify import identified
from glapp.quality import DATA_GAP_STEPS, DataStatistics, Finding, InspectionSample, inspect, noise_sigma


def statistics_of(sample: InspectionSample) -> DataStatistics:
    """Count as the docstring of `DataStatistics` defines it, in the plainest way."""
    t, flags = sample.t, sample.flags
    flags = np.zeros(t.size, dtype=np.uint8) if flags is None else flags
    signals = {"sp": sample.sp, "pv": sample.pv, "op": sample.op}
    with np.errstate(all="ignore"):
        dt = np.diff(t)
        forward = dt[dt > 0]
        threshold = DATA_GAP_STEPS * float(np.median(forward)) if forward.size else math.inf
        same = {name: np.diff(x) == 0 for name, x in signals.items() if x is not None}
        sp_changes = int(np.sum(np.isfinite(np.diff(sample.sp)) & ~same["sp"]))

    def first(mask: np.ndarray, shift: int = 1) -> int:
        return int(np.argmax(mask)) + shift if mask.any() else -1

    counts: dict[str, float] = {
        "rows": t.size,
        "t_bad": int(np.sum(~np.isfinite(t))),
        "repeated": int(np.sum(dt == 0)),
        "repeated_row": first(dt == 0),
        "reversed": int(np.sum(dt < 0)),
        "reversed_row": first(dt < 0),
        "gap_threshold": threshold,
        "gaps": int(np.sum(dt > threshold)),
        "gap_row": first(dt > threshold),
        "gap_longest": float(np.max(dt[dt > threshold], initial=0)),
        "gap_total": float(np.sum(dt[dt > threshold])),
        "not_auto": int(np.sum(flags & 1 > 0)),
        "pv_marked": int(np.sum(flags & 2 > 0)),
        "pv_marked_row": first(flags & 2 > 0, 0),
        "at_low": int(np.sum(flags & 4 > 0)),
        "at_high": int(np.sum(flags & 8 > 0)),
        "pv_unchanged": int(same["pv"].sum()),
        "op_unchanged": int(same["op"].sum()) if "op" in same else 0,
        "sp_changes": sp_changes,
        "still": int(np.sum(np.logical_and.reduce(list(same.values())) & (sample.sp != sample.pv)[1:])),
    }
    if counts["reversed"]:
        counts["reversed_from"] = float(t[first(dt < 0) - 1])
        counts["reversed_to"] = float(t[first(dt < 0)])
    for name, x in signals.items():
        if x is None:
            continue
        number = np.isfinite(x)
        counts[f"{name}_bad"] = int(np.sum(~number))
        counts[f"{name}_bad_row"] = first(~number, 0)
        if number.any():
            counts[f"{name}_min"], counts[f"{name}_max"] = float(x[number].min()), float(x[number].max())
    return DataStatistics(**counts)  # type: ignore[arg-type]


def look(t, sp, pv, op=None, flags=None, **known) -> dict[str, Finding]:
    sample = InspectionSample(t, sp, pv, op, flags)
    found = inspect(sample, statistics_of(sample), **{"pv_unit": "m3/h", "op_unit": "%"} | known)
    return {finding.code: finding for finding in found}


HEALTHY = {
    "load": {},
    "slow sampling": {"h": 3.0, "time_constant": 40.0},
    "faster controller": {"runs": 5},
    "no noise": {"noise": 0.0},
    "noise only": {"load": 0.0, "noise": 0.3},
    "direct acting": {"k": -1.0},
    "setpoint steps": {"setpoints": {300: 53.0, 900: 48.0}},
    "backlash": {"gap": 1.0, "load": 0.02, "noise": 0.01},
    "backlash, integrating": {"gap": 1.0, "integrating": True, "k": 0.4, "ti": 30.0, "time_constant": 30, "load": 0.0},
    "fine converter": {"op_step": 0.01},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", HEALTHY)
def test_a_healthy_recording_has_no_finding(name: str) -> None:
    for seed in range(3):
        signals = loop(n=2500, seed=seed, **HEALTHY[name])
        k, ti = HEALTHY[name].get("k", 1.0), HEALTHY[name].get("ti", 20.0)
        found = look(*signals, k=k, ti=ti, identification=identified(*signals))
        assert not found, found


def test_signals_against_their_spans() -> None:
    t, sp, pv, op = loop(n=2500)[:4]
    k = {"k": 1.0, "ti": 20.0}
    low, high = pv.min(), pv.max()
    assert not look(t, sp, pv, op, **k, pv_span=(low + 0.1, high + 1), op_span=(0, 100))
    [found] = look(t, sp, pv, op, **k, pv_span=(high - 0.5, high + 1)).values()
    assert (found.code, found.severity, found.evidence["signal"]) == ("span", "warning", "PV")
    assert found.text.startswith(f"PV goes from {low:.4g} to {high:.4g}, beyond its span of {high - 0.5:.4g}")
    # OP as a fraction and as a current, with the settings and without.
    for span in (None, (0.0, 100.0)):
        found = look(t, sp, pv, op / 100, op_span=span)["span"]
        assert found.evidence["looks_like"] == "fraction" and "--op-span 0 1" in found.text
    assert "span" not in look(t, sp, pv, op / 100, op_span=(0.0, 1.0))
    current = 4 + 0.16 * op
    assert look(t, sp, pv, current)["span"].evidence["looks_like"] == "current"
    assert "span" not in look(t, sp, pv, current, op_span=(0.0, 100.0))


def test_sampling_against_ti() -> None:
    signals = loop(n=500, h=3.0)
    assert "sampling" not in look(*signals, ti=15.0)
    assert look(*signals, ti=14.9)["sampling"].severity == "warning"
    found = look(*signals, ti=2.9)["sampling"]
    assert found.severity == "warning"
    assert found.text == (
        "a sample every 3 s is slower than Ti 2.9 s, so the error between the samples is unknown: "
        "record at least every 0.58 s"
    )


def test_spikes_are_listed_by_their_rows() -> None:
    t, sp, pv, op = loop(n=2500)
    assert "spikes" not in look(t, sp, pv, op)
    pv[[300, 700]] += 8 * np.ptp(pv)
    few = look(t, sp, pv, op)["spikes"]
    assert (few.severity, few.evidence["count"], few.evidence["rows"]) == ("info", 2, "300 700")
    assert few.text.startswith("2 samples of PV stand alone, off those before and after (row 302, row 702)")
    pv[1000:1800:80] += 8 * np.ptp(pv)
    many = look(t, sp, pv, op)["spikes"]
    assert (many.severity, many.evidence["count"]) == ("warning", 12)
    assert "row 702, row 1002, row 1082, row 1162 and more" in many.text


def test_shifts_of_pv_are_listed_by_their_rows() -> None:
    t, sp, pv, op = loop(n=2500)
    pv[900:] += 8 * np.ptp(pv)
    found = look(t, sp, pv, op)["shifts"]
    assert (found.severity, found.evidence["count"], found.evidence["rows"]) == ("warning", 1, "900")
    assert found.text.startswith("PV goes to another level from one row to the next (row 902), as no process does")
    # A jump of OP right before it is its cause, and three that go with OP are slips.
    led = op.copy()
    led[898:] += 8 * np.ptp(op)
    assert "shifts" not in look(t, sp, pv, led)
    square = np.sign(np.sin(t / 40.0))
    assert "shifts" not in look(t, sp, sp + square + 1e-3 * (pv - sp), 50 - np.cumsum(square) / 10)
    assert "shifts" in look(t, sp, sp + square + 1e-3 * (pv - sp), op)


@pytest.mark.slow
@pytest.mark.parametrize("tag", ["FIC46005_0614", "FIC46005_0902"])
def test_slips_of_a_sticking_valve_are_no_shifts(tag: str) -> None:
    sample = refinery(tag)
    assert "shifts" not in look(*sample)


@pytest.mark.slow
@pytest.mark.parametrize("controller", [{}, {"k": 0.5, "ti": 60.0}])
def test_op_and_pv_under_each_others_name(controller: dict[str, float]) -> None:
    for seed in range(3):
        t, sp, pv, op = loop(n=2500, seed=seed, **controller)
        as_filed, exchanged = identified(t, sp, pv, op), identified(t, sp, op, pv)
        assert "exchanged" not in look(t, sp, pv, op, identification=as_filed)
        found = look(t, sp, op, pv, identification=exchanged)["exchanged"]
        assert found.severity == "refuse" and "--pv and --op" in found.text
        assert found.evidence["r2_exchanged"] > 0.95
        assert found.evidence["ti_s"] == pytest.approx(as_filed.ti, rel=0.01)


def test_pv_interpolated_or_held_by_a_historian() -> None:
    t, sp, pv, op = loop()
    lines = np.interp(t, t[::8], pv[::8])
    assert look(t, sp, lines, op)["compressed_pv"].evidence["straight"] > 0.6
    held = np.repeat(pv[::10], 10)
    assert look(t, sp, held, op)["compressed_pv"].evidence["held"] > 0.6
    assert "compressed_pv" not in look(t, sp, np.round(pv, 1), op)


def test_rest_of_coarse_signals_is_neither_frozen_nor_compressed_nor_a_controller_gap() -> None:
    for seed in range(3):
        t, sp, pv, op = loop(op_step=0.1, load=0.02, seed=seed)
        assert set(look(t, sp, np.round(pv, 1), op)) <= {"quantised_pv", "quantised_op"}


def test_a_historian_that_stood_still() -> None:
    t, sp, pv, op = loop()
    for x in (pv, op):
        x[500:1000] = x[500]
    assert look(t, sp, pv, op)["frozen"].evidence["share"] == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("step", [0.25, 0.1])
def test_coarse_pv_and_op_are_found_with_their_step(step: float) -> None:
    t, sp, pv, op = loop(load=0.1)
    for code, signals in {"quantised_pv": (pv, op), "quantised_op": (op, pv)}.items():
        coarse = np.round(signals[0] / step) * step
        order = (coarse, op) if code == "quantised_pv" else (pv, coarse)
        found = look(t, sp, *order)
        assert list(found) == [code]
        assert found[code].evidence["step"] == pytest.approx(step)
        assert found[code].evidence["levels"] == round(np.ptp(coarse) / step)


def test_constant_and_same_signals() -> None:
    t, sp, pv, op = loop(n=300)
    assert look(t, sp, pv, 0 * op + 20)["op_constant"].severity == "refuse"
    assert look(t, sp, 0 * pv + 20, op)["pv_constant"].severity == "refuse"
    assert "PV and OP" in look(t, sp, pv, pv)["same_signal"].text
    assert "PV and SP" in look(t, pv, pv, op)["same_signal"].text
    assert list(look(t, sp, pv)) == ["no_op"]


def test_shares_of_manual_limits_and_quality() -> None:
    t, sp, pv, op = loop(n=1000)
    flags = np.zeros(1000, dtype=np.uint8)
    for bit, code in ((1, "not_auto"), (2, "bad_quality"), (4, "at_limit"), (8, "at_limit")):
        for rows, severity in ((5, "info"), (600, "warning"), (1000, "refuse")):
            flags[:] = 0
            flags[:rows] = bit
            found = look(t, sp, pv, op, flags)[code]
            assert found.severity == severity
            share = "no row is in auto" if (code, rows) == ("not_auto", 1000) else f"{rows / 10:g}\u00a0%"
            assert share in found.text


def test_times() -> None:
    t, sp, pv, op = loop(n=1000)
    late = t.copy()
    late[600:] += 100
    late[700:] += 50
    gaps = look(late, sp, pv, op)["gaps"]
    assert gaps.evidence == {"count": 2, "longest_s": 101.0, "total_s": 152.0, "first_row": 600}
    assert "row 602" in gaps.text
    twice = t.copy()
    twice[500] = twice[499]
    assert look(twice, sp, pv, op)["time_repeated"].severity == "warning"
    assert look(0 * t, sp, pv, op)["time_repeated"].severity == "refuse"
    minutes = look(t // 60 * 60, sp, pv, op)["time_repeated"]  # which said to remove the doubles, and went on
    assert minutes.severity == "refuse" and "lost their seconds" in minutes.text and "--sample-time" in minutes.text
    late = t.copy()
    late[600:] += 100
    one = look(late, sp, pv, op)["gaps"].text
    assert one == "1 gap of 101 s, before row 602; no half-period is taken across it"
    back = t.copy()
    back[400:] -= 3600
    found = look(back, sp, pv, op, t0=datetime(2025, 10, 26, 2, 53, 20, tzinfo=UTC))["time_reversed"]
    assert found.severity == "refuse"
    assert "row 402, from 2025-10-26 02:59:59+00:00 to 2025-10-26 02:00:00+00:00" in found.text
    assert "time zone" in found.text and "time zone" not in look(t[::-1], sp, pv, op)["time_reversed"].text
    t[3] = np.nan
    assert look(t, sp, pv, op)["time_missing"].evidence["rows"] == 1


def test_a_row_of_bad_quality_is_not_called_one_without_a_value(tmp_path) -> None:
    """Both were counted as rows in which PV is not a number, and rows without a value as rows of bad quality."""
    t, sp, pv, op = loop(n=1000)
    quality = np.full(1000, "Good")
    quality[200:230] = "Bad"
    cells = [("" if 400 <= k < 412 else f"{y:.4f}") for k, y in enumerate(pv)]
    path = tmp_path / "plant.csv"

    def found(*columns) -> dict[str, str]:
        names = ("t", "SP", "PV", "OP", "quality")[: len(columns)]
        path.write_text("\n".join(map(",".join, [names, *(map(str, row) for row in zip(*columns, strict=True))])))
        result = glapp.analyze(path, fit=False)
        return {one.code: one.text for one in result.quality if one.code in ("not_a_number", "bad_quality")}

    both = found(t, sp, cells, op, quality)
    assert both["not_a_number"].startswith("PV has no value in 12 of 1000 rows (1.2\u00a0%), first row 402: ")
    assert both["bad_quality"].startswith(
        "the quality of PV is not good in 30 of 1000 rows (3\u00a0%), first row 202, "
    )
    assert list(found(t, sp, cells, op)) == ["not_a_number"]
    assert list(found(t, sp, pv, op, quality)) == ["bad_quality"]
    quality[:] = "Bad"
    with pytest.raises(
        InputError, match="column PV: has no value of good quality in any of 1000 rows, and one of bad quality in 1000"
    ):
        found(t, sp, pv, op, quality)


def test_each_signal_of_a_long_table_has_its_own_bad_quality(tmp_path) -> None:
    """A bad sample of SP or OP was counted as one that is not a number."""
    _, sp, pv, op = loop(n=1000)
    path = tmp_path / "long.csv"
    lines = [
        f"{k},F1.{tag},{values[k]:.4f},{'Bad' if k < bad else 'Good'}"
        for k in range(1000)
        for tag, values, bad in (("SP", sp, 5), ("PV", pv, 20), ("OP", op, 7))
    ]
    path.write_text("\n".join(["t,tag,value,quality", *lines]))
    result = glapp.analyze(path, fit=False)
    assert "not_a_number" not in [one.code for one in result.quality]
    bad = [one.evidence for one in result.quality if one.code == "bad_quality"]
    assert {one["signal"]: (one["rows"], one["first_row"]) for one in bad} == {
        "SP": (5, 0),
        "PV": (20, 0),
        "OP": (7, 0),
    }


def test_non_numbers() -> None:
    t, sp, pv, op = loop(n=1000)
    pv[100:105] = np.nan
    found = look(t, sp, pv, op)["not_a_number"]
    assert (
        found.severity == "info"
        and "PV has no value in 5 of 1000 rows (0.5\N{NO-BREAK SPACE}%), first row 102" in found.text
    )
    pv[:500] = np.inf
    assert look(t, sp, pv, op)["not_a_number"].severity == "warning"
    assert look(t, sp, pv * np.nan, op)["not_a_number"].severity == "refuse"
    assert look(t, sp, pv, op * np.nan)["not_a_number"].severity == "warning"
    assert look(t[:5], sp[:5], pv[:5], op[:5])["too_few_rows"].severity == "refuse"
    assert look(t[:0], sp[:0], pv[:0], op[:0])["too_few_rows"].severity == "refuse"


def test_cascade_slave() -> None:
    steps = np.cumsum(np.random.default_rng(4).normal(0, 0.05, 1500))
    signals = loop(n=1500, setpoints={float(i): 50 + step for i, step in enumerate(steps)})
    assert look(*signals)["cascade_slave"].severity == "warning"


def test_settings_against_what_op_does() -> None:
    signals = loop(n=1000)
    seen = identified(*signals)
    assert "K -1 % per m3/h" in look(*signals, k=-1.0, ti=20.0, identification=seen)["sign"].text
    assert not look(*signals, k=1.3, ti=25.0, identification=seen)
    assert look(*signals, k=60.0, ti=20.0, identification=seen)["settings"].evidence["parameter"] == "K"
    minutes = look(*signals, k=1.0, ti=20.0 * 60, identification=seen)["settings"]
    assert "Ti 1.2e+03 s but OP moves as with 20 s" in minutes.text
    assert not look(*signals, k=60.0, identification=dataclasses.replace(seen, usable=False))


def controller(error_gap: float = 0.0, dead_band: float = 0.0, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Record PI control with an error gap or an output dead band of its own, on a lag with a random-walk load."""
    rng = np.random.default_rng(seed)
    n, x, w, op, asked, before = 4000, 0.0, 0.0, 0.0, 0.0, 0.0
    record = np.empty((2, n))
    for i in range(n):
        w += 0.05 * rng.standard_normal()
        pv = 50 + x + 0.02 * rng.standard_normal()
        e = 50 - pv
        if abs(e) > error_gap:
            asked += e - before + e / 20
        before = e
        if abs(asked - op) >= dead_band:
            op = asked
        record[:, i] = pv, 50 + op
        x += (op + w - x) / 15
    return np.arange(float(n)), np.full(n, 50.0), *record


def test_error_gap_and_output_dead_band_of_the_controller() -> None:
    for seed in range(3):
        found = look(*controller(error_gap=0.2, seed=seed))
        assert list(found) == ["error_gap"]
        assert found["error_gap"].evidence["gap"] == pytest.approx(0.2, rel=0.05)
        found = look(*controller(dead_band=0.3, seed=seed))
        assert list(found) == ["output_dead_band"]
        assert found["output_dead_band"].evidence["jump"] == pytest.approx(0.3, rel=0.1)
        assert not look(*controller(seed=seed))


def test_winding_up() -> None:
    n = 1000
    t, sp = np.arange(float(n)), np.full(n, 50.0)
    pv = 45 + 0.1 * np.random.default_rng(1).standard_normal(n)
    op = 20 + np.cumsum(sp - pv) / 200
    found = look(t, sp, pv, op)["winding_up"]
    assert found.severity == "refuse" and "5 m3/h below SP for 17 min while OP winds from 20" in found.text
    assert "above SP" in look(t, sp, 100 - pv, 40 - op)["winding_up"].text
    assert "winding_up" not in look(t, sp, pv, op, ti=150.0)  # too short to say so of a slow controller
    start = 50 - 20 * np.exp(-t / 300)
    assert "winding_up" not in look(t, sp, start, 20 + np.cumsum(sp - start) / 200)  # a start-up that arrives


def test_sinusoid() -> None:
    t = np.arange(0, 6000, 5.0)
    rng = np.random.default_rng(2)
    pv = 50 + np.sin(2 * np.pi * t / 150) + 0.03 * rng.standard_normal(t.size)
    sp = np.full(t.size, 50.0)
    op = 50 + 2 * (sp - pv)
    found = look(t, sp, pv, op, ti=100.0)["sinusoidal"]
    assert found.evidence["period_s"] == pytest.approx(150, rel=0.03)
    assert found.evidence["spectral_share"] > 0.95
    assert "sinusoidal" not in look(t, sp, pv, op, ti=10.0)  # half-periods longer than 5 Ti may well be backlash
    assert "sinusoidal" not in look(t, sp, 50 + np.sign(pv - 50), op, ti=100.0)
    assert "sinusoidal" not in look(t, sp, 50 + rng.standard_normal(t.size), op, ti=100.0)


@pytest.mark.parametrize("sigma", [0.001, 0.2, 5.0])
def test_noise_is_distinguished_from_movement(sigma: float) -> None:
    for seed in range(3):
        noise = np.random.default_rng(seed).normal(0, sigma, 4000)
        for slow in (0.0, 100 * sigma * np.sin(np.arange(4000) / 60), np.arange(4000) * sigma):
            assert noise_sigma(slow + noise) == pytest.approx(sigma, rel=0.1)
        gaps = noise.copy()
        gaps[::10] = np.nan
        assert noise_sigma(gaps) == pytest.approx(sigma, rel=0.15)
        gaps[1000:2000] = 7.0
        assert noise_sigma(gaps) == pytest.approx(sigma, rel=0.15)


def test_noise_of_a_coarse_signal_and_of_constant_missing_or_short_ones() -> None:
    assert noise_sigma(np.round(np.sin(np.arange(4000) / 60), 1)) == pytest.approx(0.1 / math.sqrt(12))
    assert noise_sigma(np.sin(np.arange(4000) / 200)) < 1e-6
    assert noise_sigma(np.full(4000, 3.0)) is None
    assert noise_sigma(np.full(4000, np.nan)) is None
    assert noise_sigma(np.arange(3.0)) is None
    assert noise_sigma(np.arange(0.0)) is None


@pytest.mark.slow
@settings(max_examples=200)
@given(arrays(np.float64, (4, 110), elements=numbers), arrays(np.uint8, 110), st.integers(0, 110))
def test_any_numbers_are_inspected_without_error(data: np.ndarray, flags: np.ndarray, n: int) -> None:
    for t in (data[0, :n], np.arange(float(n))):
        sample = InspectionSample(t, *data[1:, :n], flags[:n])
        for look_at in (sample, dataclasses.replace(sample, flags=None)):
            found = inspect(
                look_at, statistics_of(look_at), ti=3.0, k=1.0, t0=datetime(2025, 1, 1), identification=None
            )
            for finding in found:
                assert finding.text and finding.severity in ("info", "warning", "refuse")
                for value in finding.evidence.values():
                    assert not (isinstance(value, float) and math.isnan(value)), finding
            sigma = noise_sigma(look_at.pv)
            assert sigma is None or sigma >= 0


def test_findings_are_listed_gravest_first() -> None:
    t, sp, pv, op = loop(n=300)
    pv[10] = np.nan
    flags = np.zeros(300, dtype=np.uint8)
    flags[:200] = 1
    severities = [finding.severity for finding in look(t, sp, pv, 0 * op, flags).values()]
    assert severities == ["refuse", "warning", "info"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "codes"),
    [
        ("FIC46005_0902", {"sampling"}),
        ("FIC46005_0614", {"sampling", "frozen"}),
        ("FIC20102_0609", {"sampling", "frozen"}),
        ("FIC20102_1107", {"sampling"}),
        ("FIC20102_1207", {"sampling"}),
        ("LIC31102B_0824", {"sinusoidal"}),
        ("LIC31102B_0904", {"sinusoidal"}),
        ("LIC31102B_1127", {"sinusoidal"}),
        ("LIC30102_0825", set()),
        ("FIC41004_1108", set()),
        ("FIC40102B_0825", {"sampling", "cascade_slave"}),
    ],
)
def test_refinery_loops_have_their_known_findings(name: str, codes: set[str]) -> None:
    signals = refinery(name)
    seen = identified(*signals)
    found = look(*signals, k=seen.k, ti=seen.ti, identification=seen)
    assert set(found) == codes
    assert all(finding.severity != "refuse" for finding in found.values())


def test_a_real_loop_that_winds_up_is_refused() -> None:
    found = look(*refinery("FIC10104_0224"))
    assert found["winding_up"].severity == "refuse"
    assert "OP winds from 5.04 to 78.4 %" in found["winding_up"].text
