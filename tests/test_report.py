"""The report: what it says is what the results hold, nothing leaves the page, nothing breaks it."""

from __future__ import annotations

import json
import math
import re
from dataclasses import fields, replace
from datetime import datetime
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from glapp.fit import Fit, Trend, Window
from glapp.identify import Identification
from glapp.loop import Loop
from glapp.quality import Finding
from glapp.report import figures, html, words
from glapp.report.figures import loop_figure, overview_figure, phase_figure
from glapp.report.fit_figure import trend_figure
from glapp.report.html import write_report
from glapp.result import REASONS, Corrected, Crossings, HalfPeriods, Result, Settings
from glapp.trace import Band, Trace


def a_loop(**changes: Any) -> Loop:
    values: dict[str, Any] = {
        "name": "FIC101",
        "pv_unit": "m³/h",
        "pv_span": (0, 50),
        "op_span": (0, 100),
        "controller": {"form": "series", "k": 1.2, "gain_unit": "%/%", "ti": 0.5, "ti_unit": "min"},
        "acceptable_dead_band": 1.0,
    }
    return Loop(**(values | changes))


def settings(**changes: Any) -> Settings:
    notes = {"k": "given", "ti": "given", "tf": "ladder: TI/10", "kp": "not given and no PV span: term dropped"}
    values: dict[str, Any] = {"k": 0.6, "ti": 30.0, "td": 0.0, "b": 0.0, "tf": 3.0, "kp": None, "n": 9, "max_h": 5.0}
    return Settings(**(values | {"notes": notes, "origins": {}} | changes))


def half_periods_of(rows: list[dict[str, float]]) -> HalfPeriods:
    whole = {"mask": np.uint16, "reason": np.uint8, "sign": np.int8, "detections": np.uint8, "samples": np.uint32}
    return HalfPeriods(
        **{
            c.name: np.array([row.get(c.name, 0) for row in rows], whole.get(c.name, float))
            for c in fields(HalfPeriods)
        }
    )


def a_result(**changes: Any) -> Result:
    values: dict[str, Any] = {
        "name": "FIC101", "source": "plant.csv", "loop": a_loop(), "t0": datetime(2026, 3, 1, 6, 30),
        "crossings": "estimate", "reason": None, "d_hat": None, "unit": "%", "d_hat_percent_span": None,
        "repeatability": None, "noise_floor": None, "detections": 0, "half_periods": half_periods_of([]),
        "reasons": {}, "settings": settings(),
    }  # fmt: skip
    return Result(**(values | changes))


def closed_loop(d: float, *, seconds: int = 12000, noise: float = 0.05, seed: int = 1) -> dict[str, np.ndarray]:
    """Run a PI loop on an integrating level whose valve loses `d` [%] at each reversal, sampled once a second."""
    rng = np.random.default_rng(seed)
    k, ti, h = 0.6, 30.0, 1.0
    y, u, v, e_old = 50.0, 40.0, 40.0, 0.0
    sp, pv, op, position = (np.empty(seconds) for _ in range(4))
    for i in range(seconds):
        target = 50.0 if i < seconds * 0.6 else 54.0
        load = 40.0 + (4.0 if i > seconds // 4 else 0.0)
        measured = y + noise * rng.uniform(-1, 1)
        e = target - measured
        u += k * (e - e_old) + k / ti * e * h
        e_old = e
        v = min(max(v, u - d / 2), u + d / 2)
        y += 0.02 * (v - load) * h
        sp[i], pv[i], op[i], position[i] = target, measured, u, v
    return {"t": np.arange(seconds) * h, "sp": sp, "pv": pv, "op": op, "position": position}


def thin(signals: dict[str, np.ndarray], buckets: int = 1500) -> Trace:
    cuts = np.linspace(0, len(signals["t"]), min(buckets, len(signals["t"])) + 1).astype(int)[:-1]
    bands = {
        name: Band(np.minimum.reduceat(x, cuts), np.maximum.reduceat(x, cuts))
        for name, x in signals.items()
        if name != "t"
    }
    counts = np.diff(np.append(cuts, len(signals["t"])))
    return Trace(
        t=np.add.reduceat(signals["t"], cuts) / counts,
        **{c: bands.get(c) for c in ("sp", "pv", "pv_filtered", "op", "position")},
    )


def detect(signals: dict[str, np.ndarray], k: float, ti: float) -> tuple[HalfPeriods, np.ndarray, list[float]]:
    """Judge the half-periods roughly as the detector does: enough to draw and to tell."""
    t, sp = signals["t"], signals["sp"]
    h = t[1] - t[0]
    filtered = np.empty_like(signals["pv"])
    a = b = signals["pv"][0]
    for i, x in enumerate(signals["pv"]):
        a += (x - a) * h / (ti / 10 + h)
        b += (a - b) * h / (ti / 10 + h)
        filtered[i] = b
    e = sp - filtered
    crossings = np.flatnonzero(np.diff(np.sign(e)) != 0) + 1
    rows, kept = [], []
    before, previous = math.nan, math.nan
    for first, end in pairwise(crossings):
        error = np.abs(e[first:end])
        delta_t, delta_y, e_max = (end - first) * h, float(error.mean()), float(error.max())
        delta_sp = float(np.ptp(sp[first:end]))
        delta_u = abs(k) / ti * delta_y * delta_t
        failed = {
            5: delta_t <= 5 * ti,
            6: e_max >= 2 * delta_y,
            7: not (0.5 < (previous / delta_y if delta_y else 0) < 1.5),
            8: delta_sp >= delta_y,
            9: len(kept) >= 9 and delta_t <= ti * before / (2 * abs(k) * delta_y),
        }
        codes = [code for code, hit in failed.items() if hit]
        if not codes:
            kept.append(delta_u)
        rows.append(
            dict(
                t_start=t[first], t_end=t[end - 1] + h, sign=float(np.sign(e[first])), delta_t=delta_t, delta_y=delta_y,
                e_max=e_max, delta_sp=delta_sp, delta_u=delta_u, delta_u_d=0.0, op_travel=delta_u, free=delta_u,
                kp_part=0.0, d=delta_u, previous_delta_y=previous, d_hat_before=before,
                mask=sum(1 << (code - 1) for code in codes), reason=codes[0] if codes else 0,
                d_hat=float(np.median(kept[-9:])) if kept else math.nan,
            )
        )  # fmt: skip
        previous, before = delta_y, rows[-1]["d_hat"]
    return half_periods_of(rows), filtered, kept


def analysed(
    signals: dict[str, np.ndarray], *, k: float = 0.6, ti: float = 30.0, name: str = "FIC101", **changes: Any
) -> Result:
    table, filtered, kept = detect(signals, k, ti)
    codes = table.reason.astype(int)
    reasons = {n: int((codes == c).sum()) for c, n in enumerate(REASONS) if c and (codes == c).any()}
    d_hat = float(np.median(kept[-9:])) if kept else None
    result = a_result(
        name=name,
        loop=a_loop(),
        crossings="no_estimate" if not kept else "provisional" if len(kept) < 9 else "estimate",
        reason=None
        if len(kept) >= 9
        else f"{len(kept)} of 9 detections needed."
        if kept
        else "no half-period was accepted",
        d_hat=d_hat,
        d_hat_percent_span=d_hat,
        repeatability=(min(kept[-9:]), max(kept[-9:])) if kept else None,
        detections=len(kept),
        half_periods=table,
        reasons=reasons,
        settings=settings(k=k, ti=ti),
        trace=thin({**signals, "pv_filtered": filtered}),
    )
    return replace(result, **changes)


def refused() -> Result:
    return a_result(
        name="FIC999",
        crossings="refused",
        reason="plant.csv, row 18, column PV: 'abc' is not a number; write bad values as empty, or name them",
        t0=None,
        loop=a_loop(controller=None, op_span=None, pv_unit=None, acceptable_dead_band=None),
        half_periods=half_periods_of([]),
        settings=settings(k=None, ti=None, td=None, b=None, tf=None, notes={}),
    )


FINDING = Finding(
    "compressed_pv", "warning", "PV looks interpolated by a historian.", {"share_on_lines": 0.61234, "samples": 751}
)
IDENTIFICATION = Identification(
    k=0.61, k_low=0.58, k_high=0.64, ti=31.2, ti_low=29.0, ti_high=math.inf, r2=0.953, samples=700,
    setpoint_weight=None, note="stretches of 30 steps", usable=True, reason="",
)  # fmt: skip


def many(n: int) -> Result:
    """A result with `n` half-periods and a full trace."""
    rng = np.random.default_rng(3)
    t = np.arange(n + 1) * 10.0
    reason = rng.integers(0, 10, n).astype(np.uint8)
    mask = np.where(reason > 0, 1 << np.maximum(reason.astype(int) - 1, 0), 0).astype(np.uint16)
    columns = {c.name: rng.uniform(0.5, 2, n) for c in fields(HalfPeriods)}
    table = HalfPeriods(**(columns | {"t_start": t[:-1], "t_end": t[1:], "reason": reason, "mask": mask}))
    signals = {c: rng.normal(size=4000) for c in ("sp", "pv", "pv_filtered", "op", "position")}
    reasons = {name: int((table.reason == code).sum()) for code, name in enumerate(REASONS) if code}
    return a_result(
        d_hat=1.25,
        d_hat_percent_span=1.25,
        detections=n - sum(reasons.values()),
        repeatability=(1.0, 1.5),
        half_periods=table,
        reasons=reasons,
        settings=settings(),
        trace=thin({"t": np.linspace(0, t[-1], 4000), **signals}, 4000),
    )


@pytest.fixture(scope="module")
def worn() -> Result:
    return analysed(closed_loop(3.0), quality=[FINDING], identification=IDENTIFICATION, name="FIC101")


@pytest.fixture(scope="module")
def run(worn: Result) -> list[Result]:
    """One loop of every kind."""
    return [
        refused(),
        worn,
        replace(worn, name="FIC 102", d_hat_percent_span=None, unit="mA", loop=a_loop(op_span=None, pv_unit=None)),
        replace(worn, name="FIC103", crossings="provisional", detections=3, reason="3 of 9 detections needed", t0=None),
        analysed(closed_loop(0.0, seconds=3000, noise=0.2), name="LIC104"),
        replace(
            refused(), name="silent", crossings="no_estimate", reason="there are no half-periods", trace=worn.trace
        ),
    ]


class Checker(HTMLParser):
    """Checks that tags close in order; collects links and text."""

    VOID = frozenset({"meta", "br", "wbr", "link", "img", "hr", "input"})

    def __init__(self) -> None:
        super().__init__()
        self.stack: list[str] = []
        self.references: list[str] = []
        self.ids: list[str] = []
        self.text: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for key, value in attrs:
            if key in {"src", "href", "srcset", "data", "action", "poster"}:
                self.references.append(value or "")
            if key == "id":
                self.ids.append(value or "")
        if tag not in self.VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.stack.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"script", "style"} & set(self.stack):
            self.text.append(data)


def parsed(path: Path) -> Checker:
    checker = Checker()
    checker.feed(path.read_text(encoding="utf-8"))
    checker.close()
    assert checker.stack == []
    assert len(checker.ids) == len(set(checker.ids))
    return checker


def test_every_reason_of_the_detector_has_words_and_a_colour() -> None:
    assert tuple(words.REASONS) == REASONS
    assert len(figures.REASON_COLOURS) == len(REASONS)


def test_the_report_is_one_file_that_asks_for_nothing(run: list[Result], tmp_path: Path) -> None:
    [file] = write_report(run, tmp_path / "report.html")
    page = parsed(file)
    assert all(reference.startswith("#") for reference in page.references)
    assert {reference[1:] for reference in page.references} <= set(page.ids)
    style = re.findall(r"<style>(.*?)</style>", file.read_text(encoding="utf-8"), re.S)
    assert not re.search(r"@import|url\(", "".join(style))
    assert "default-src 'none'" in file.read_text(encoding="utf-8")
    assert page.tags.count("script") == 4 + sum(i.startswith("data-") for i in page.ids)


def test_numbers_in_the_report_are_those_of_the_results(worn: Result, tmp_path: Path) -> None:
    [file] = write_report([worn], tmp_path / "report.html")
    text = " ".join(" ".join(parsed(file).text).split())
    assert worn.verdict == "estimate"
    shown = float(re.search(r"loses ([\d.]+) % of OP span", text)[1])  # type: ignore[index]
    assert shown == pytest.approx(worn.d_hat_percent_span, rel=5e-3)
    assert f"from {worn.detections} detections in {worn.half_periods.count} half-periods" in text
    for name, n in worn.reasons.items():
        assert f"{words.REASONS[name].label} {n} " in text
    assert "PV looks interpolated by a historian." in text
    assert "share on lines 0.6123, samples 751" in text
    assert "29 to no upper bound" in text
    assert "0.953" in text
    assert "1.2 %/%" in text
    assert "0.600 %OP per m³/h" in text
    assert "0.5 min" in text
    assert "ladder: TI/10" in text


HOSTILE = '<script>alert("1")</script> & </script><!-- <b>x'


def test_names_and_texts_of_users_stay_text(worn: Result, tmp_path: Path) -> None:
    bad = replace(
        worn,
        name=HOSTILE,
        source=HOSTILE,
        reason=HOSTILE,
        unit=HOSTILE,
        loop=a_loop(pv_unit=HOSTILE, name=HOSTILE),
        settings=settings(notes={"k": HOSTILE}),
        quality=[Finding(HOSTILE, "info", HOSTILE, {HOSTILE: HOSTILE})],
        identification=replace(IDENTIFICATION, reason=HOSTILE, note=HOSTILE),
    )
    for crossings in get_args(Crossings):
        [file] = write_report([replace(bad, crossings=crossings)], tmp_path / "report.html", title=HOSTILE)
        page = parsed(file)
        assert page.tags.count("script") == 6
        assert "b" not in page.tags or page.tags.count("b") == 1  # "What to do"
        assert HOSTILE in "".join(page.text)
    for figure in (loop_figure(bad), phase_figure(bad), overview_figure([bad])):
        assert "<script" not in figure.to_json().lower().replace("\\u003c", "<")


@pytest.mark.slow
def test_a_run_too_large_for_one_file_is_an_index_with_a_file_per_loop(
    worn: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loops = [replace(worn, name=name) for name in ("A/1 ü", "A/1 ü", "..", HOSTILE)]
    [single] = write_report(loops, tmp_path / "one.html")
    monkeypatch.setattr(html, "MAX_BYTES", single.stat().st_size)
    index, *files = write_report(loops, tmp_path / "run 1.html")
    assert index == tmp_path / "run 1.html"
    assert len(files) == len(set(files)) == len(loops)
    page = parsed(index)
    assert len(page.references) == len(loops)
    for reference, file in zip(page.references, files, strict=True):
        assert (tmp_path / reference.replace("%20", " ")).resolve() == file.resolve()
        assert file.stat().st_size < single.stat().st_size
        back = [r for r in parsed(file).references if not r.startswith("#")]
        assert back == ["../run%201.html"]


@pytest.mark.slow
def test_huge_recordings_stay_small(tmp_path: Path) -> None:
    huge = many(60_000)
    files = write_report([replace(huge, name=f"L{i}") for i in range(24)], tmp_path / "report.html")
    assert len(files) == 25
    assert all(file.stat().st_size < html.MAX_BYTES for file in files)


def test_every_half_period_is_shaded_and_told(worn: Result) -> None:
    figure = loop_figure(worn)
    shading = figure.data[0]
    h = worn.half_periods
    codes = np.asarray(shading.z)[0]
    assert np.array_equal(codes[np.isfinite(codes)], h.reason)
    assert len(shading.x) == len(codes) + 1
    assert np.all(np.diff(shading.x) >= 0)
    texts = [text for text in shading.text[0] if text]
    rejected = [text for text, code in zip(texts, h.reason, strict=True) if code]
    assert len(texts) == h.count
    assert all("✗" in text for text in rejected)
    assert all("✗" not in text for text, code in zip(texts, h.reason, strict=True) if not code)
    assert sum("Accepted" in text for text in texts) == worn.detections


def test_neighbours_share_a_column_when_there_are_too_many_and_none_is_lost() -> None:
    result = many(10 * figures.MAX_COLUMNS + 7)
    shading = loop_figure(result).data[0]
    codes = np.asarray(shading.z)[0]
    assert len(codes) == figures.MAX_COLUMNS
    told = sum(int(re.match(r"<b>(\d+) half", text)[1]) for text in shading.text[0])  # type: ignore[index]
    assert told == result.half_periods.count


def test_a_loop_without_detections_has_no_panel_for_them(run: list[Result]) -> None:
    titles = [axis.title.text for axis in loop_figure(run[4]).select_yaxes()]
    assert run[4].verdict == "no_estimate"
    assert titles == ["SP, PV [m³/h]", "OP [%OP]"]


def test_time_that_runs_backwards_does_not_fold_the_shading(worn: Result) -> None:
    late = np.arange(worn.half_periods.count) >= 5
    h = worn.half_periods
    h = replace(h, t_start=h.t_start - 2000 * late, t_end=h.t_end - 2000 * late)
    shading = loop_figure(replace(worn, half_periods=h)).data[0]
    assert np.all(np.diff(shading.x) >= 0)


def test_the_time_axis_shows_the_wall_clock_of_the_recording(worn: Result) -> None:
    zoned = replace(worn, t0=datetime.fromisoformat("2026-03-01T06:30:00+09:00"))
    for result in (worn, zoned):
        figure = loop_figure(result)
        expected = np.datetime64("2026-03-01T06:30:00", "ms").astype(float) + 1000 * worn.trace.t[0]
        line = next(trace for trace in figure.data if trace.name == "PV")
        assert line.x[0] == pytest.approx(expected, abs=1)
        assert figure.layout.xaxis.type == "date"
    plain = loop_figure(replace(worn, t0=None))
    assert plain.layout.xaxis3.title.text == "time [s]"


def test_no_peak_is_lost_by_drawing(worn: Result) -> None:
    line = next(trace for trace in loop_figure(worn).data if trace.name == "PV")
    assert np.nanmax(line.y) == pytest.approx(np.nanmax(worn.trace.pv.high), rel=1e-6)
    assert np.nanmin(line.y) == pytest.approx(np.nanmin(worn.trace.pv.low), rel=1e-6)


def test_every_estimate_has_one_bar_as_long_as_its_width(run: list[Result]) -> None:
    loops = [*run, replace(run[1], name="narrow", d_hat=0.4, d_hat_percent_span=np.float64(0.4))]
    bars = [trace for trace in overview_figure(loops).data if trace.type == "bar"]
    drawn = sorted((name, x) for bar in bars for name, x in zip(bar.hovertext, bar.x, strict=True))
    expected = [(r.name, r.d_hat_percent_span or r.d_hat) for r in loops if r.d_hat is not None]
    assert drawn == sorted(expected)
    assert {bar.name for bar in bars} == {
        "wider than acceptable", "wider than acceptable, provisional", "acceptable", "no limit given"
    }  # fmt: skip


def test_the_overview_draws_the_fitted_width_with_its_interval(worn: Result) -> None:
    gap = replace(worn, name="gap", fit=Fit("backlash", "", "%", 2.0, 1.5, 3.0))
    bound = replace(worn, name="bound", fit=Fit("at_least", "", "%", 4.0, 2.5, None))
    sound = replace(worn, name="sound", fit=Fit("sound", "", "%", 0.0, 0.0, 0.5))
    unsure = replace(worn, name="unsure", fit=Fit("cannot_tell", "", "%", 9.0, 0.0, None))
    bars = {name: (bar, k) for bar in overview_figure([gap, bound, unsure, sound]).data if bar.type == "bar"
            for k, name in enumerate(bar.hovertext)}  # fmt: skip
    drawn = {name: bar.x[k] for name, (bar, k) in bars.items()}
    assert drawn == {"gap": 2.0, "bound": 2.5}, "a sound valve was once drawn with what its crossings read"
    bar, k = bars["gap"]
    assert (bar.error_x.arrayminus[k], bar.error_x.array[k]) == (0.5, 1.0)
    assert bars["bound"][0].marker.pattern.shape == "/" and "at least" in bars["bound"][0].name


def test_results_rank_by_width_and_keep_units_apart(run: list[Result]) -> None:
    order = words.ranked(run)
    assert [r.name for r in order][-1] == "FIC999"
    percents = [r.d_hat_percent_span for r in order if r.d_hat_percent_span is not None]
    assert percents == sorted(percents, reverse=True)
    figure = overview_figure(run)
    titles = [axis.title.text for axis in figure.select_xaxes()]
    assert "% of OP span" in titles[0]
    assert "OP units" in titles[1]
    labels = [label for axis in figure.select_yaxes() for label in axis.ticktext]
    assert sorted(labels) == sorted(r.name for r in run)


@pytest.mark.slow
@pytest.mark.parametrize("hole", ["reason", "d_hat_percent_span", "repeatability", "identification", "trace", "t0"])
def test_nothing_breaks_where_a_field_is_none(worn: Result, hole: str, tmp_path: Path) -> None:
    result = replace(worn, **{hole: None})
    write_report([result], tmp_path / "report.html")
    loop_figure(result)
    phase_figure(result)
    overview_figure([result])


def test_nothing_breaks_without_signals_or_numbers(worn: Result, tmp_path: Path) -> None:
    trace = replace(worn.trace, op=None, position=None)
    nan = np.full(len(trace.t), np.nan)
    void = replace(worn.trace, **{c: Band(nan, nan) for c in ("sp", "pv", "pv_filtered", "op")})
    nothing = {c: Band(nan[:0], nan[:0]) for c in ("sp", "pv", "pv_filtered", "op")}
    short = replace(worn.trace, t=nan[:0], **nothing)
    for each in (trace, void, short):
        write_report([replace(worn, trace=each)], tmp_path / "report.html")
    [file] = write_report([], tmp_path / "report.html")
    assert "no loops in this run" in " ".join(parsed(file).text)
    overview_figure([])


def test_the_words_claim_no_more_than_is_known(run: list[Result]) -> None:
    for result in run:
        text = " ".join(words.verdict(result))
        assert "confidence" not in text
        assert "interval" not in text
        assert words.next_step(result)
        if result.crossings == "provisional":
            assert "provisional" in text
            assert "appears to lose" in text
        if result.d_hat is None:
            assert "loses" not in text
        else:
            assert "too high" in text
            assert "step test" in text
    assert "does not show that the valve is sound" in " ".join(words.verdict(run[5]))


def test_where_the_fit_tells_it_alone_says_what_to_do(worn: Result, tmp_path: Path) -> None:
    """A planner read "nothing on this evidence" beside a gap that the fit had found."""
    silent = replace(worn, crossings="no_estimate", d_hat=None, reason="the detections do not agree")
    bound = replace(silent, name="bound", fit=Fit("at_least", "at least 2 %OP are lost", "%", 4.0, 2.0, None))
    sound = replace(silent, name="sound", fit=Fit("sound", "no gap wider than 1 %OP", "%", 0.0, 0.0, 1.0))
    unsure = replace(silent, name="unsure", fit=Fit("cannot_tell", "any width would fit", "%", 9.0, 0.0, None))
    assert [r.answer.valve for r in (bound, sound, unsure, silent, worn)] == [
        "gap",
        "no_gap",
        "unknown",
        "unknown",
        "gap",
    ]
    assert "step test" in words.next_step(bound) and words.next_step(sound) == "Nothing now."
    assert words.next_step(unsure).startswith("Record for longer, while OP moves further")
    write_report([bound, sound, unsure], file := tmp_path / "report.html")
    page = parsed(file)
    text = " ".join(page.text)
    assert text.count("What to do") == 1 + 3, "the overview's column, and once a loop"
    assert text.count(words.next_step(unsure)) == 2, "overview and section"


def test_what_to_do_about_a_fitted_gap_hangs_on_what_is_acceptable(worn: Result) -> None:
    def step(verdict: Any, low: float, high: float | None, limit: float | None = 2.0) -> str:
        loop = worn.loop.model_copy(update={"op_span": (0.0, 200.0), "acceptable_dead_band": limit})
        return words.next_step(replace(worn, loop=loop, fit=Fit(verdict, "found", "mA", low, low, high)))

    # 2 % of a span of 200 are 4.
    assert step("backlash", 5.0, 6.0).startswith("It is more than what is acceptable here, 2 % of span. Look for play")
    assert step("at_least", 5.0, None).startswith("It is more than")
    assert step("backlash", 2.0, 3.9).startswith("Nothing now: all of it is within what is acceptable here, 2 % of")
    assert step("backlash", 3.0, 5.0).startswith("Look for play"), "it may be either"
    assert step("at_least", 3.0, None).startswith("Record while OP moves further")
    assert step("backlash", 5.0, 6.0, None).startswith("Look for play")


def test_the_corrected_width_stands_beside_the_other(worn: Result, tmp_path: Path) -> None:
    found = Corrected(2.5, 2.25, 2.75, 1.5, (1.25, 1.75), 7, "(4.1)", None)
    write_report([replace(worn, corrected=found)], file := tmp_path / "found.html")
    text = " ".join(parsed(file).text)
    assert "With its known bias taken out it reads 2.50\xa0%OP (2.25 to 2.75)" in text
    assert "a process gain of 1.50 (1.25 to 1.75)" in text and "worked out by (4.1) in 7 pairs" in text
    assert words.number(worn.d_hat) in text
    refused = Corrected(None, None, None, None, None, 2, "op", "2 pairs are too few")
    assert "cannot be taken out: 2 pairs are too few." in " ".join(words.verdict(replace(worn, corrected=refused)))


def test_widths_over_time_are_drawn_with_their_intervals(worn: Result, tmp_path: Path) -> None:
    day = 86400.0
    windows = [Window(day * i, day * i + 600, "backlash", 2.0 + i, 1.5 + i, 3.0 + i, 99.0) for i in range(5)]
    windows += [
        Window(6 * day, 6.1 * day, "at_least", 4.0, 3.5, None, 50.0),
        Window(7 * day, 7.1 * day, "sound", 0.0, 0.0, 0.4, 0.0),
        Window(8 * day, 8.1 * day, "cannot_tell", 1.0, 0.0, None, 3.0),
    ]
    trend = Trend(1.0, 0.1, 5, (300.0, 4 * day + 300), (2.0, 6.0), changes=True)
    fit = Fit("backlash", "a gap", "%", 6.0, 5.5, 7.0, trend=trend, windows=windows)
    result = replace(worn, fit=fit)
    dots, least, most, line = trend_figure(result).data
    assert list(dots.y) == [2.0, 3.0, 4.0, 5.0, 6.0]
    assert list(dots.error_y.array) == [1.0] * 5 and list(dots.error_y.arrayminus) == [0.5] * 5
    assert (list(least.y), list(most.y)) == ([3.5], [0.4])
    assert list(line.y) == [2.0, 6.0] and line.x[0] == dots.x[0] and line.x[-1] == dots.x[-1]
    write_report([result], file := tmp_path / "trend.html")
    text = " ".join(parsed(file).text)
    assert "8 windows of the recording" in text and "It has grown to this in 4 d" in text
    assert "grown" not in words.lead(replace(result, fit=replace(fit, trend=None)))


def test_a_width_is_judged_only_against_a_limit_in_the_same_unit(worn: Result) -> None:
    assert worn.d_hat_percent_span is not None
    assert words.exceeds(worn) is True
    assert words.exceeds(replace(worn, loop=a_loop(acceptable_dead_band=worn.d_hat_percent_span))) is False
    assert words.exceeds(replace(worn, d_hat_percent_span=None)) is None
    assert words.exceeds(replace(worn, loop=a_loop(acceptable_dead_band=None))) is None


def test_comparisons_agree_with_the_mask(worn: Result) -> None:
    h = worn.half_periods
    for i in range(h.count):
        lines = words.comparisons(worn, i)
        assert sum(passed is False for _, passed in lines) == len(words.failures(int(h.mask[i])))


def test_figures_are_stored_once_and_can_be_read_back(worn: Result, tmp_path: Path) -> None:
    [file] = write_report([worn], tmp_path / "report.html")
    text = file.read_text(encoding="utf-8")
    stored = json.loads(re.search(r'id="data-loop-0">(.*?)</script>', text)[1])  # type: ignore[index]
    assert set(stored["figures"]) == {"time", "phase"}
    specs = [json.dumps(spec) for spec in stored["arrays"]]
    assert len(specs) == len(set(specs))
    assert len(text.encode()) < 6_500_000


def test_crossings_that_contradict_the_fit_are_struck(worn: Result, tmp_path: Path) -> None:
    """A sound valve once stood in the list with the 1.38 % that its crossings read."""
    assert worn.d_hat is not None
    sound = replace(worn, name="sound", fit=Fit("sound", "no gap wider than 0.5 %OP", "%", 0.0, 0.0, 0.5))
    wide = replace(
        worn, name="wide", fit=Fit("backlash", "a gap", "%", 0.4 * worn.d_hat, 0.3 * worn.d_hat, 0.5 * worn.d_hat)
    )
    agrees = replace(worn, name="agrees", fit=Fit("backlash", "a gap", "%", worn.d_hat, 0.9 * worn.d_hat, worn.d_hat))
    may = replace(worn, fit=Fit("cannot_tell", "would fit", "%", 0.1, 0.0, 0.4, why="may_be_a_gap"))
    codes = [r.answer.struck and r.answer.struck.code for r in (sound, wide, agrees, may)]
    assert codes == ["sound", "above", None, "above"]
    assert words.headline(sound).startswith("< 0.5") and sound.width is None and sound.verdict == "sound"
    assert words.headline(may) == "0 to 0.400\xa0%OP"
    assert words.why(may) == "The data fit any gap from 0 to 0.400\xa0%OP, most likely 0.100\xa0%OP."
    assert [r.name for r in words.ranked([sound, wide, agrees])] == ["agrees", "wide", "sound"]
    write_report([sound, wide, agrees], file := tmp_path / "report.html")
    text = " ".join(parsed(file).text)
    assert text.count("%OP, struck") == 2 and text.count("of the zero crossings is struck") == 2
    assert words.number(worn.d_hat) in text, "its number stands beside the reason"
    assert {trace.name for trace in loop_figure(sound).data} >= {"estimate, struck", "not excluded by OP and PV"}
    assert "estimate, struck" not in {trace.name for trace in loop_figure(agrees).data}


def test_how_strong_the_evidence_is_stands_in_words(worn: Result) -> None:
    def said(lr: float, verdict: Any = "backlash") -> str:
        fit = Fit(verdict, "units of 2·ln L", "%", 2.0, 1.5, 3.0, lr_no_gap=lr, lr_needed=40.0)
        return words.why(replace(worn, fit=fit))

    assert said(41.0) == "Evidence for a gap: strong." and said(90.0) == "Evidence for a gap: very strong."
    assert said(20.0, "sound") == "Units of 2·ln L.", "a reason of the fit's own"
