"""The report: its content is that of the results, nothing leaves the page, nothing breaks it."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from dataclasses import fields
from dataclasses import replace as with_fields
from datetime import datetime
from html import escape
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

import glapp
from glapp import palette
from glapp.fit import Fit, Trend, Window
from glapp.identify import Identification
from glapp.loop import Loop
from glapp.quality import Finding
from glapp.report import figures, html, words
from glapp.report.figures import loop_figure, phase_figure
from glapp.report.fit_figure import fit_figure, loop_figures, trend_figure
from glapp.report.html import write_report
from glapp.report.view import LoopView, bar
from glapp.result import REASONS, Corrected, Crossings, HalfPeriods, Result, Settings, Verdict, decide
from glapp.trace import Band, Trace


def replace(of: Any, **changes: Any) -> Any:
    """A result with other fields, and the answer that follows from them."""
    return of.decided_with(**changes) if isinstance(of, Result) else with_fields(of, **changes)


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
        "crossings": "estimate", "why": None, "reason": None, "d_hat": None, "unit": "%", "d_hat_percent_span": None,
        "repeatability": None, "noise_floor": None, "detections": 0, "half_periods": half_periods_of([]),
        "reasons": {}, "settings": settings(),
    }  # fmt: skip
    values |= changes
    facts = ("crossings", "d_hat", "detections", "reasons", "loop")
    answer = decide(fit=values.get("fit"), step_test=values.get("step_test"), **{name: values[name] for name in facts})
    return Result(answer=answer, **values)


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
    """Results of a run with one loop of every kind."""
    return [
        refused(),
        worn,
        replace(
            worn,
            name="FIC 102",
            d_hat_percent_span=None,
            unit="mA",
            loop=a_loop(op_span=None, op_unit="mA", pv_unit=None),
        ),
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


@pytest.mark.slow
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
    shown = float(re.search(r"dead band of ([\d.]+) %OP", text)[1])  # type: ignore[index]
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


@pytest.mark.slow
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
        assert page.tags.count("script") == 5
        assert page.tags.count("b") == 2, "What to do, How soon, and no other"
        assert HOSTILE in "".join(page.text)
    for figure in (loop_figure(bad), phase_figure(bad)):
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
    references = [r for r in page.references if r != "#how"]
    assert len(references) == len(loops)
    for reference, file in zip(references, files, strict=True):
        assert (tmp_path / reference.replace("%20", " ")).resolve() == file.resolve()
        assert file.stat().st_size < single.stat().st_size
        back = [r for r in parsed(file).references if not r.startswith("#")]
        assert back == ["../run%201.html"]


@pytest.mark.verify
def test_huge_recordings_stay_small(tmp_path: Path) -> None:
    huge = many(60_000)
    files = write_report([replace(huge, name=f"L{i}") for i in range(24)], tmp_path / "report.html")
    assert len(files) == 25
    assert all(file.stat().st_size < html.MAX_BYTES for file in files)


@pytest.mark.slow
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
    counted = sum(int(re.match(r"<b>(\d+) half", text)[1]) for text in shading.text[0])  # type: ignore[index]
    assert counted == result.half_periods.count


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
    drawn = {r.name: one for r in loops if (one := bar(r)) is not None}
    assert {name: one.width for name, one in drawn.items()} == pytest.approx(
        {r.name: r.d_hat_percent_span for r in loops if r.d_hat_percent_span is not None}
    ), "a width in mA has no place on a scale in % of span"
    assert {(one.low, one.kind, one.acceptable) for one in drawn.values()} == {(0.0, "crossings", 1.0)}


def test_the_list_draws_the_fitted_width_with_its_interval(worn: Result) -> None:
    gap = replace(worn, name="gap", fit=Fit("backlash", "", "%", 2.0, 1.5, 3.0))
    bound = replace(worn, name="bound", fit=Fit("at_least", "", "%", 4.0, 2.5, None))
    sound = replace(worn, name="sound", fit=Fit("sound", "", "%", 0.0, 0.0, 0.5))
    unsure = replace(worn, name="unsure", fit=Fit("cannot_tell", "", "%", 9.0, 0.0, None))
    wide = gap.loop.model_copy(update={"op_span": (0.0, 200.0)})
    assert bar(gap) == (1.5, 3.0, 2.0, 1.0, "gap")
    assert bar(replace(gap, loop=wide)) == (0.75, 1.5, 1.0, 1.0, "gap"), "in % of span"
    assert bar(bound) == (2.5, None, 2.5, 1.0, "gap")
    assert bar(sound) == (0.0, 0.5, None, 1.0, "no_gap"), "it was once drawn with what its crossings read"
    assert bar(unsure) is None


def test_results_rank_by_urgency_and_width_and_keep_units_apart(run: list[Result]) -> None:
    order = words.ranked(run)
    assert [r.name for r in order][-1] == "FIC999"
    levels = [list(words.URGENCIES).index(r.answer.urgency) for r in order]
    assert levels == sorted(levels) and len(set(levels)) > 1
    for level in set(levels):
        percents = [r.answer.width_percent_span for r, of in zip(order, levels, strict=True) if of == level]
        known = [percent for percent in percents if percent is not None]
        assert known == sorted(known, reverse=True)


def rows_of(page: str) -> list[str]:
    """Names in the list of loops, in their order: those judged, then those that are not."""
    overview = page[page.index('<section class="overview">') : page.index('<section class="loop"')]
    return [re.sub("<.*?>", "", name) for name in re.findall(r'<td data-label="Loop".*?<a [^>]*>(.*?)</a>', overview)]


@pytest.mark.slow
def test_every_loop_stands_once_in_the_list_the_most_urgent_first(run: list[Result], tmp_path: Path) -> None:
    loops = [replace(r, name=f"{r.name}.{i}") for i in range(3) for r in run]
    [file] = write_report(loops, tmp_path / "report.html")
    page = file.read_text(encoding="utf-8")
    order = words.ranked(loops)
    expected = [r.name for r in order if words.judged(r)] + [r.name for r in order if not words.judged(r)]
    assert rows_of(page) == expected and len(expected) == 18
    sections = [re.sub("<.*?>", "", name) for name in re.findall(r"<summary><h2>(.*?)</h2><span class=.width", page)]
    assert sections == [r.name for r in order]
    text = " ".join(" ".join(parsed(file).text).split())
    assert "9 loops that cannot be judged" in text
    for r in order:
        if not words.judged(r):
            assert f"{words.lead(r)} {words.next_step(r)}" in text, "the reason, and what would help"


@pytest.mark.slow
def test_of_one_loop_the_answer_and_what_to_do_stand_first(run: list[Result], tmp_path: Path) -> None:
    """Regression: a list of one loop said the same sentence three times before what to do."""
    for one in run:
        [file] = write_report([one], tmp_path / "report.html")
        text = " ".join(" ".join(parsed(file).text).split())
        assert "What comes first" not in text and "that cannot be judged" not in text
        lead = " ".join(words.lead(one).split())
        first = f"{lead} What to do {words.next_step(one)} How soon {words.URGENCIES[one.answer.urgency]}"
        head = text[: text.index(first)]
        assert lead not in head and head.endswith(words.verdict(one) + " ")


@pytest.mark.slow
@pytest.mark.parametrize("hole", ["reason", "d_hat_percent_span", "repeatability", "identification", "trace", "t0"])
def test_nothing_breaks_where_a_field_is_none(worn: Result, hole: str, tmp_path: Path) -> None:
    result = replace(worn, **{hole: None})
    write_report([result], tmp_path / "report.html")
    loop_figure(result)
    phase_figure(result)
    bar(result)


@pytest.mark.slow
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


def test_the_words_claim_no_more_than_is_known(run: list[Result]) -> None:
    for result in run:
        text = " ".join([words.lead(result), *words.why(result)])
        assert "confidence" not in text
        assert "interval" not in text
        assert words.next_step(result)
        if result.crossings == "provisional":
            assert "provisional" in text
        if result.d_hat is None:
            assert "dead band of" not in text
        else:
            assert "too high" in text
            assert "step test" in text
    assert "does not show that the valve is sound" in " ".join(words.why(run[5]))


@pytest.mark.slow
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
    assert words.next_step(unsure).startswith("Record for longer while OP moves further")
    write_report([bound, sound, unsure], file := tmp_path / "report.html")
    page = parsed(file)
    text = " ".join(page.text)
    assert text.count("What to do") == 1 + 3, "the overview's column, and once a loop"
    assert text.count(words.next_step(unsure)) == 2, "overview and section"


def test_what_to_do_about_a_fitted_gap_hangs_on_what_is_acceptable(worn: Result) -> None:
    def told(verdict: Any, low: float, high: float | None, limit: float | None = 2.0) -> tuple[str, str]:
        loop = worn.loop.model_copy(update={"op_span": (0.0, 200.0), "acceptable_dead_band": limit})
        result = replace(worn, loop=loop, fit=Fit(verdict, "found", "mA", low, low, high))
        return words.lead(result), words.next_step(result)

    # 2 % of a span of 200 are 4.
    for verdict, high in (("backlash", 6.0), ("at_least", None)):
        so, do = told(verdict, 5.0, high)
        assert so.endswith(", more than the 2\u00a0% of span allowed.") and not do.startswith("Nothing")
    assert told("backlash", 5.0, 6.0)[1].startswith("Check the linkage for play, and the packing")
    assert told("backlash", 2.0, 3.9)[1].startswith("Nothing now: all of it is within the 2\u00a0% of span allowed.")
    so, do = told("backlash", 3.0, 5.0)
    assert "allowed" not in so and do.startswith("Check the linkage"), "it may be either"
    assert told("at_least", 3.0, None)[1].startswith("Record while OP moves further")
    assert told("backlash", 5.0, 6.0, None)[0].endswith(", more than the usual 1\u00a0% of span."), "nominal"


def test_the_corrected_width_stands_beside_the_other(worn: Result, tmp_path: Path) -> None:
    found = Corrected(2.5, 2.25, 2.75, 1.5, (1.25, 1.75), 7, "(4.1)", None)
    write_report([replace(worn, corrected=found)], file := tmp_path / "found.html")
    text = " ".join(parsed(file).text)
    assert "With its known bias taken out it reads 2.50\xa0%OP (2.25 to 2.75)" in text
    assert "a process gain of 1.50 (1.25 to 1.75)" in text and "worked out by (4.1) in 7 pairs" in text
    assert words.number(worn.d_hat) in text
    refused = Corrected(None, None, None, None, None, 2, "op", "2 pairs are too few")
    assert "cannot be taken out: 2 pairs are too few." in " ".join(words.why(replace(worn, corrected=refused)))


@pytest.mark.slow
def test_widths_over_time_are_drawn_with_their_intervals(worn: Result, tmp_path: Path) -> None:
    day = 86400.0
    windows = [Window(day * i, day * i + 600, "backlash", 2.0 + i, 1.5 + i, 3.0 + i, 99.0) for i in range(5)]
    windows += [
        Window(6 * day, 6.1 * day, "at_least", 4.0, 3.5, None, 50.0),
        Window(7 * day, 7.1 * day, "sound", 0.0, 0.0, 0.4, 0.0),
        Window(8 * day, 8.1 * day, "cannot_tell", 1.0, 0.0, None, 3.0),
    ]
    trend = Trend(1.0, 0.1, 5, (300.0, 4 * day + 300), (2.0, 6.0), changes=True)
    change: dict[str, Any] = {"code": "grows", "widths": 5, "widths_needed": 5, "t": trend.t, "d": trend.d}
    change |= {"per_day": 1.0, "low": 0.8, "high": 1.2, "least_plain": 0.3}
    fit = Fit("backlash", "a gap", "%", 6.0, 5.5, 7.0, trend=trend, windows=windows, change=change)
    result = replace(worn, fit=fit)
    dots, least, most, line = trend_figure(result).data
    assert list(dots.y) == [2.0, 3.0, 4.0, 5.0, 6.0]
    assert list(dots.error_y.array) == [1.0] * 5 and list(dots.error_y.arrayminus) == [0.5] * 5
    assert (list(least.y), list(most.y)) == ([3.5], [0.4])
    assert list(line.y) == [2.0, 6.0] and line.x[0] == dots.x[0] and line.x[-1] == dots.x[-1]
    # One window that tells something once had the only moment of the axis, which then counted microseconds.
    alone = trend_figure(replace(worn, fit=replace(fit, windows=[windows[5], windows[7]], trend=None)))
    first, last = alone.layout.xaxis.range
    assert last - first == pytest.approx(2.1 * day * (1 if worn.t0 is None else 1000))
    write_report([result], file := tmp_path / "trend.html")
    text = " ".join(parsed(file).text)
    assert "8 windows of the recording" in text and ", up from 2 in 4 d" in text and "line is the trend" in text
    write_report([replace(result, fit=replace(fit, trend=None, change=None))], file)
    assert "8 windows of the recording" in (text := " ".join(parsed(file).text)) and "line is the trend" not in text
    assert "up from" not in words.lead(replace(result, fit=replace(fit, change=None)))


def test_a_loop_that_was_refused_has_no_picture_of_pv_over_op(worn: Result) -> None:
    """A PV that never answered lay level in it, and the note said that a gap makes PV level."""
    assert set(LoopView("a", replace(refused(), trace=worn.trace)).drawn) == {"time"}
    assert "phase" in LoopView("a", worn).drawn


def test_a_default_is_not_called_given(worn: Result) -> None:
    """TD of 0 s, b of 1 and N of 9 stood as if somebody had given them, TD and b with "given" beside them."""
    notes = {"k": "given", "ti": "given", "td": "given", "b": "given"}
    result = replace(worn, loop=a_loop(), settings=settings(notes=notes))
    rows = {label: (given, where) for label, given, _, where in LoopView("FIC101", result).settings}
    assert rows["Derivative time TD"] == rows["Setpoint weight b"] == ("–", "default")
    assert (rows["Detections needed N"], rows["Action"]) == (("–", ""), ("–", ""))
    assert (rows["Form"][0], rows["Integral time TI"]) == ("series", ("0.5 min", "given"))
    controller = {"k": 1, "gain_unit": "OP/PV", "ti": 9, "td": 0, "setpoint_weight": 1, "action": "reverse"}
    result = replace(result, loop=a_loop(controller=controller, n=9))
    rows = {label: (given, where) for label, given, _, where in LoopView("FIC101", result).settings}
    assert (rows["Derivative time TD"], rows["Setpoint weight b"]) == (("0 s", "given"), ("1", "given"))
    assert (rows["Detections needed N"][0], rows["Action"][0]) == ("9", "reverse")


def test_comparisons_agree_with_the_mask(worn: Result) -> None:
    h = worn.half_periods
    for i in range(h.count):
        lines = words.comparisons(worn, i)
        assert sum(passed is False for _, passed in lines) == len(words.failures(int(h.mask[i])))


@pytest.mark.slow
def test_figures_are_stored_once_and_can_be_read_back(worn: Result, tmp_path: Path) -> None:
    [file] = write_report([worn], tmp_path / "report.html")
    text = file.read_text(encoding="utf-8")
    stored = json.loads(re.search(r'id="data-loop-[^"]*">(.*?)</script>', text)[1])  # type: ignore[index]
    assert set(stored["figures"]) == {"time", "phase"}
    specs = [json.dumps(spec) for spec in stored["arrays"]]
    assert len(specs) == len(set(specs))
    assert len(text.encode()) < 6_500_000


@pytest.mark.slow
def test_crossings_that_contradict_the_fit_are_struck(worn: Result, tmp_path: Path) -> None:
    """A sound valve once stood in the list with the 1.38 % that its crossings read."""
    assert worn.d_hat is not None
    sound = replace(worn, name="sound", fit=Fit("sound", "no gap wider than 0.5 %OP", "%", 0.0, 0.0, 0.5))
    wide = replace(
        worn, name="wide", fit=Fit("backlash", "a gap", "%", 0.4 * worn.d_hat, 0.3 * worn.d_hat, 0.5 * worn.d_hat)
    )
    agrees = replace(worn, name="agrees", fit=Fit("backlash", "a gap", "%", worn.d_hat, 0.9 * worn.d_hat, worn.d_hat))
    may = replace(worn, fit=Fit("cannot_tell", "would fit", "%", 0.1, 0.0, 0.4, why="families_disagree"))
    codes = [r.answer.struck and r.answer.struck.code for r in (sound, wide, agrees, may)]
    assert codes == ["sound", "above", None, "above"]
    assert words.headline(sound).startswith("< 0.5") and sound.width is None and sound.verdict == "sound"
    assert words.headline(may) == "0 to 0.400\xa0%OP"
    assert words.lead(may) == f"The dead band of {may.name}, if it has one, is about 0.10\xa0%, at most 0.40\xa0%."
    assert [r.name for r in words.ranked([sound, wide, agrees])] == ["agrees", "wide", "sound"]
    write_report([sound, wide, agrees], file := tmp_path / "report.html")
    text = " ".join(parsed(file).text)
    assert "%OP, too high" in text and "%OP, from noise or load" in text and text.count("; ignore it.") == 2
    assert words.number(worn.d_hat) in text, "its number stands beside the reason"
    assert {trace.name for trace in loop_figure(sound).data} >= {"estimate, excluded", "not excluded by OP and PV"}
    assert "estimate, excluded" not in {trace.name for trace in loop_figure(agrees).data}


def test_the_likelihood_stands_in_the_fold_alone(worn: Result, tmp_path: Path) -> None:
    fit = Fit("backlash", "a gap: likelihood ratio 41, 40 needed", "%", 2.0, 1.5, 3.0, lr_no_gap=41.0, lr_needed=40.0)
    texts = replace(worn, fit=fit).texts()
    assert "likelihood" not in texts["so"] + texts["do"]
    assert texts["why"][0] == "a gap: likelihood ratio 41, 40 needed.".capitalize()
    assert words.basis(replace(worn, fit=fit)) == "strong evidence" and words.basis(worn) == "simple method alone"
    write_report([replace(worn, fit=fit)], file := tmp_path / "report.html")
    text = file.read_text(encoding="utf-8")
    assert text.index('<details class="why">') < text.index("likelihood ratio 41")


def fitted(worn: Result, verdict: Any = "backlash", low: float = 2.5, high: float | None = 3.4) -> Result:
    """A result with a fit whose model is the simulated valve itself."""
    s = closed_loop(3.0)
    candidate = {"lags": 1, "integrating": False, "noise": "input", "delta_deviance": 0.0}
    profile = (np.linspace(0, 6, 30), np.linspace(-3, 3, 30) ** 2 * 20)
    best = {
        "t": s["t"], "pv": s["pv"], "predicted": s["pv"], "position": s["position"], "signal": "PV",
        "integrating": False, "kp": 0.5, "range": 6.0, "rise": 8.0, "candidates": [candidate | {"profile": profile}],
    }  # fmt: skip
    fit = Fit(verdict, "a gap", "%", 3.0, low, high, lr_no_gap=90.0, lr_needed=15.0, best=best)
    return replace(worn, fit=fit, trace=thin(s, 6000))


@pytest.mark.slow
def test_the_parallelogram_is_as_wide_as_the_fitted_gap(worn: Result) -> None:
    drawn = loop_figures(fitted(worn))
    recorded, gap, low, high = drawn["gap"].data
    for line, width in ((gap, 3.0), (low, 2.5), (high, 3.4)):
        for k in (0, 1):
            assert line.x[k] - line.x[3 - k] == pytest.approx(width) and line.y[k] == line.y[3 - k]
    assert gap.y[1] - gap.y[0] == pytest.approx(0.5 * (gap.x[1] - gap.x[0])), "its slope is the process gain"
    assert [trace.name for trace in drawn["why"].data] == ["OP", "valve (model)", "PV", "SP"]  # SP is over PV's noise
    whole = np.ptp(drawn["why"].data[0].x)
    assert np.ptp(drawn["why"].layout.xaxis.range) < 0.5 * whole and len(recorded.x) < 6000, "a stretch, not all"
    bound = loop_figures(fitted(worn, "at_least", 2.5, None))["gap"].data
    assert [trace.name for trace in bound] == ["recorded", "at least"]


@pytest.mark.slow
def test_a_gap_that_was_not_found_is_not_drawn(worn: Result, tmp_path: Path) -> None:
    drawn = loop_figures(fitted(worn, "cannot_tell", 0.0, None))
    assert {trace.name for trace in drawn["why"].data} == {"OP", "SP", "PV"}
    assert [trace.name for trace in drawn["gap"].data] == ["recorded"]
    [file] = write_report([fitted(worn, "cannot_tell", 0.0, None)], tmp_path / "report.html")
    text = file.read_text(encoding="utf-8")
    assert "the valve by the model" not in text and "What was recorded" in text


def test_op_that_is_thinned_too_much_is_not_drawn_beside_the_window(worn: Result, tmp_path: Path) -> None:
    result = fitted(worn)
    coarse = replace(result, trace=thin(closed_loop(3.0), 20))
    assert set(loop_figures(result)) == {"why", "gap"} and set(loop_figures(coarse)) == {"why"}
    assert "OP" not in {trace.name for trace in loop_figures(coarse)["why"].data}
    for one, said in ((result, "Second picture"), (coarse, "OP is not drawn")):
        [file] = write_report([one], tmp_path / "report.html")
        text = file.read_text(encoding="utf-8")
        assert [name for name in ("First picture", "Second picture", "OP is not drawn") if name in text][-1] == said
    assert "First picture" not in text  # it told of an OP that is not there


@pytest.mark.slow
def test_a_fitted_loop_has_all_its_pictures(worn: Result, tmp_path: Path) -> None:
    assert list(LoopView("x", fitted(worn)).drawn) == ["why", "gap", "fit", "time"]
    [file] = write_report([fitted(worn)], tmp_path / "report.html")
    text = file.read_text(encoding="utf-8")
    assert sorted(re.findall(r'data-key="loop-[^"]*" data-name="(\w+)"', text)) == ["fit", "gap", "time", "why"]
    assert "What was recorded, and the valve by the model" in text and words.SURE_OF_LIMITS in text


def test_a_step_test_in_the_recording_is_used_and_not_advised() -> None:
    """Regression: a planner was advised to make the test that he had recorded."""
    steps = [(0, 100, 50.0), (100, 200, 53.0), (200, 300, 56.0), (300, 400, 52.0)]
    run_of = {"d": 2.0, "noise": 0.05, "h": 1.0, "t_end": 400, "setpoint": [(0, 40.0)]}
    plant = ([0.8], [5, 1], 0)
    by_hand = glapp.simulate.closed_loop(plant, (0.5, 10, 0, 0), manual=steps, **run_of, filter_in_loop=True)
    result = glapp.analyze(glapp.recording_from(by_hand.to_arrow()), fit=False)
    assert result.step_test is not None and result.step_test.d == pytest.approx(2.0, abs=0.1)
    used = re.compile(r"Use the step test in this recording: it gives [\d.]+\s%OP \([\d.]+ to [\d.]+\)")
    assert used.search(words.next_step(result)), "refused, since it was never in automatic"
    limit = a_loop(op_span=(0, 100), acceptable_dead_band=None)
    for verdict in ("backlash", "both", "at_least", "cannot_tell"):
        found = replace(result, loop=limit, fit=Fit(verdict, "a gap", "%", 2.0, 1.5, 2.5))
        advice = words.next_step(found)
        assert used.search(advice) and "confirm" not in advice and "make a step test" not in advice, advice
        without = words.next_step(replace(found, step_test=None))
        assert ("confirm with a step test" if verdict in ("backlash", "both") else "make a step test") in without
        assert words.todo(found) == ("inspect" if verdict in ("backlash", "both") else "read test")
    within = replace(found, loop=a_loop(acceptable_dead_band=9.0), fit=Fit("backlash", "a gap", "%", 2.0, 1.5, 2.5))
    assert words.next_step(within).startswith("Nothing now") and not used.search(words.next_step(within))
    in_auto = glapp.simulate.closed_loop(plant, (0.5, 10, 0, 0), **run_of, filter_in_loop=True)
    assert glapp.analyze(glapp.recording_from(in_auto.to_arrow()), fit=False).step_test is None


def test_a_run_is_told_in_a_sentence(worn: Result) -> None:
    def of(name: str, verdict: Any, *numbers: Any) -> Result:
        return replace(worn, name=name, fit=Fit(verdict, "evidence", "%", *numbers))

    gaps = [of("wide", "backlash", 2.0, 1.5, 3.0), of("narrow", "backlash", 0.5, 0.4, 0.6)]
    rest = [of("sound", "sound", 0.0, 0.0, 0.5), of("swings", "oscillation", 0.0, 0.0, 0.5)]
    rest += [of("unsure", "cannot_tell", 9.0, 0.0, None), worn, refused()]
    assert words.summary([*gaps, *rest]) == (
        "1 valve: act now. 1 loop: check the tuning. 1 valve: check at the next round. 1 valve: within the limit. "
        "1 valve: no dead band seen. 1 loop: cannot tell yet. 1 loop: not analysed."
    )
    assert words.summary(gaps[:1]) == words.lead(gaps[0]), "of one loop its answer"
    assert words.summary(rest[:1] * 2) == "Nothing is urgent. 2 valves: no dead band seen."


@pytest.mark.slow
def test_a_width_stands_in_op_units_and_in_percent_of_span(worn: Result, tmp_path: Path) -> None:
    milliamperes = replace(
        worn, unit="mA", loop=a_loop(op_span=(4.0, 20.0), op_unit="mA"), fit=Fit("backlash", "", "mA", 0.8, 0.4, 1.2)
    )
    assert words.headline(milliamperes) == "0.800\xa0mA (0.400 to 1.20)"
    assert words.of_span(milliamperes) == "5\xa0% of span (2.50 to 7.50)"
    assert words.of_span(replace(milliamperes, loop=a_loop(op_span=None, op_unit="mA"))) == ""
    assert words.of_span(replace(worn, fit=Fit("backlash", "", "%", 2.0, 1.5, 3.0))) == "", "said already"
    [file] = write_report([milliamperes], tmp_path / "report.html")
    assert "5\xa0% of span (2.50\xa0to\xa07.50)" in "".join(parsed(file).text)


def test_the_likelihood_of_a_sound_valve_fills_its_picture(worn: Result) -> None:
    """Regression: the axis reached to the ratio that every move of OP asks for, and the line lay flat."""
    widths = np.linspace(0, 4, 21)
    family = {"lags": 2, "integrating": False, "noise": "both", "delta_deviance": 0.0, "profile": (widths, 50 * widths)}
    rows = np.arange(5.0)
    drawn = {"t": rows, "pv": rows, "predicted": rows}
    best = {"candidates": [family], "rise": 8.0, "range": 4.0, "signal": "PV", **drawn}
    sound = Fit("sound", "", "%", 0.0, 0.0, 0.4, lr_no_gap=0.0, lr_needed=2648.5, best=best)
    figure = fit_figure(replace(worn, fit=sound))
    assert figure.layout.yaxis.range[1] == pytest.approx(1.3 * 50 * 2.4)
    [shaded] = [shape for shape in figure.layout.shapes if shape.type == "rect"]
    assert (shaded.x0, shaded.x1) == (0.0, 0.4)


def test_how_sure_it_is_is_what_the_benches_measured() -> None:
    """No figure is quoted that bench/results/truth.md does not have."""
    measured = (Path(__file__).parent.parent / "bench" / "results" / "truth.md").read_text(encoding="utf-8")

    def cells(beginning: str, after: str = "") -> list[str]:
        lines = measured[measured.index(after) :].splitlines()
        return next(line for line in lines if line.startswith(beginning)).split("|")[2:]

    fit, thesis, loads = cells("| fit |", "### In short"), cells("| thesis |", "### In short"), cells("| all | 1400 |")

    def percent(cell: str) -> float:
        return float(cell.strip(" %+"))

    text = " ".join(words.SURE)
    [records, *_] = re.findall(r"records of every kind, (\d+) in all", measured[measured.index("## Tables") :])
    assert f"On {records} simulated recordings" in words.SURE_OF_LIMITS
    assert {round(percent(fit[2])), round(percent(fit[5]))} == {96, 98} and "96 to 98 of 100 such intervals" in text
    assert (
        f"in {round(10 * percent(fit[6]))} of 1000" in text and f"in {round(10 * percent(thesis[6]))} of 1000" in text
    )
    assert {round(percent(fit[k])) for k in (0, 3)} == {23, 26} and "23 to 26 in 100 got a width" in text
    low, high = sorted(round(percent(thesis[k])) for k in (1, 4))
    assert f"{low} to {high} % too wide" in text
    without, claims, with_gap = int(loads[0]), int(loads[1]) + int(loads[2]), int(loads[3])
    assert f"{loads[-2].strip()} did" in text and f"in {claims} of {without} of" in text
    assert f"On {without + with_gap} more" in text


def test_how_to_read_it_covers_both_methods_and_every_verdict(worn: Result, tmp_path: Path) -> None:
    assert set(words.VERDICTS) == set(get_args(Verdict)) | set(get_args(Crossings))
    assert set(words.MEANINGS) == {*words.VERDICTS, *words.LIKELY}
    [file] = write_report([worn], tmp_path / "report.html")
    text = " ".join(" ".join(parsed(file).text).split())
    for method, sentences in words.METHODS.items():
        assert method in text and all(" ".join(one.split()) in text for one in sentences)
    assert all(one in text for one in (*words.SURE, *words.MEANINGS.values()))


@pytest.mark.slow
def test_the_same_results_give_the_same_page(
    run: list[Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Clock(datetime):
        @classmethod
        def now(cls, tz: Any = None) -> Any:
            return cls(2026, 3, 1)

    monkeypatch.setattr(html, "datetime", Clock)
    [one], [other] = (write_report(run, tmp_path / name) for name in ("a", "b"))
    assert one.read_bytes() == other.read_bytes()


@pytest.mark.verify
def test_eighty_loops_are_one_file(worn: Result, tmp_path: Path) -> None:
    loops = [replace(fitted(worn) if i % 4 == 0 else refused(), name=f"FIC{i}") for i in range(80)]
    [file] = write_report(loops, tmp_path / "report.html")
    assert file.stat().st_size < 22_000_000
    assert len(set(rows_of(file.read_text(encoding="utf-8")))) == 80


CHROMIUM = shutil.which("chromium")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


def browsed(page: Path, *options: str) -> str:
    """Content of a page in Chromium, three seconds after it was opened."""
    assert CHROMIUM is not None
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=3000", *options]
    return subprocess.run([*command, page.as_uri()], capture_output=True, text=True, timeout=120, check=True).stdout


@pytest.mark.verify
@needs_chromium
def test_a_narrow_page_is_not_wider_than_its_window_and_no_legend_lies_on_an_axis_or_under_buttons(
    run: list[Result], worn: Result, tmp_path: Path
) -> None:
    """Regression: one reason a row lay on the dates, and the parallelogram's axis was named in its numbers.

    The buttons of the pictures lay on the names of their curves.
    """
    long = replace(fitted(worn), name="PLANT/UNIT_07/AREA-B/FIC10101.LONGNAME_WITHOUT_END", quality=[FINDING])
    [file] = write_report([*run[1:4], long], tmp_path / "report.html")
    text = file.read_text(encoding="utf-8").replace("<details", "<details open")
    script = """
      const inside = document.querySelector("iframe");
      inside.onload = () => setTimeout(() => {
        const page = inside.contentDocument, root = page.documentElement;
        document.body.dataset.seen = [root.scrollWidth, inside.contentWindow.innerWidth,
          page.querySelectorAll(".plot[data-drawn]").length,
          ...[...page.querySelectorAll(".legend2")].flatMap((legend) => {
            const dates = legend.closest(".plot").querySelectorAll("[class^=x][class$=tick] text, [class^=g-x] text");
            const lowest = Math.max(...[...dates].map((date) => date.getBoundingClientRect().bottom));
            return [Math.round(legend.getBoundingClientRect().top - lowest)];
          }),
          ...[...page.querySelectorAll(".plot[data-name=gap][data-drawn]")].map((plot) => {
            const at = (part) => plot.querySelector(part).getBoundingClientRect();
            const [legend, title, number] = [".legend", ".xtitle", ".xtick text"].map(at);
            return Math.round(Math.min(legend.top - title.bottom, title.top - number.bottom));
          }),
          ...[...page.querySelectorAll(".plot[data-drawn] .modebar-group")].map((buttons) => {
            const legend = buttons.closest(".plot").querySelector(".legend")?.getBoundingClientRect();
            const at = buttons.getBoundingClientRect();
            return legend && legend.top < at.bottom && at.top < legend.bottom && at.left < legend.right ? -1 : 0;
          })].join(" ");
      }, 1500);
    """
    around = tmp_path / "around.html"
    frame = f'<iframe width="375" height="9000" style="border:0" srcdoc="{escape(text)}"></iframe>'
    around.write_text(f"{frame}<script>{script}</script>", encoding="utf-8")
    seen = re.search(
        r'data-seen="(\d+) (\d+) (\d+) ([-\d ]+)"', browsed(around, "--window-size=500,9000", "--dump-dom")
    )
    assert seen is not None
    content, window, drawn = map(int, seen.groups()[:3])
    assert content <= window == 375 and drawn > 0
    assert len(rooms := [int(room) for room in seen[4].split()]) > 1
    assert min(rooms) >= 0


@pytest.mark.verify
@needs_chromium
def test_a_loop_is_printed_on_one_page(worn: Result, tmp_path: Path) -> None:
    def pages(*loops: Result) -> int:
        [file] = write_report(loops, tmp_path / "report.html")
        browsed(file, f"--print-to-pdf={tmp_path / 'report.pdf'}")
        return len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "report.pdf").read_bytes()))

    assert pages(fitted(worn), worn, replace(fitted(worn), name="FIC2")) - pages(worn) == 2


def test_report_station_and_page_have_one_typeface() -> None:
    root = Path(__file__).parents[1]
    styles = [
        "python/glapp/report/report.css",
        "python/glapp/report/templates/form.html",
        "python/glapp/station/static/station.css",
        "page/style.css",
    ]
    families = set()
    for path in styles:
        text = (root / path).read_text(encoding="utf-8")
        for shorthand, value in re.findall(r"[\s{;]font(-family)?:\s*([^;}]+)", text):
            # The family stands behind the size in the shorthand.
            found = value if shorthand else re.sub(r"^.*?\d+(?:\.\d+)?(?:px|pt|rem|em)(?:/[\d.]+)?\s+", "", value)
            families |= {found.strip()} - {"inherit", "var(--face)"}
        families |= set(re.findall(r"--face:\s*([^;}]+)", text))
    assert families == {palette.FONT}
