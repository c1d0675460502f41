"""Texts and rows of tables for the templates, from the result of a loop; nothing is decided here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from . import figures, planned, repaired, words
from .fit_figure import fit_figure, loop_figures, trend_figure

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from ..result import Result

__all__ = ["Bar", "LoopView", "bar"]

TableRows = list[tuple[str, ...]]

_GRAVITY = {"refuse": "refused", "warning": "warning", "info": "note"}


class Bar(NamedTuple):
    """A width in the list, all in % of OP's span: its limits, the width, and the acceptable limit.

    `high` is None where there is no upper limit; `kind` is what is known of the valve, or *crossings*.
    """

    low: float
    high: float | None
    width: float | None
    acceptable: float | None
    kind: str

    @property
    def end(self) -> float:
        """The greatest of them."""
        return max(self.low, self.high or 0.0, self.width or 0.0, self.acceptable or 0.0)


def bar(r: Result) -> Bar | None:
    """The width as the list draws it; None where the span is not known, or nothing of the width."""
    answer = r.answer
    width, high = answer.width_percent_span, answer.high_percent_span
    if not words.judged(r) or answer.limit is None or (width is None and high is None):
        return None
    limit = answer.limit.percent_span
    if answer.evidence is None:
        return Bar(0.0, width, width, limit, "crossings")
    return Bar(answer.low_percent_span or 0.0, high, width, limit, answer.valve)


@dataclass(frozen=True)
class LoopView:
    """One loop as its section shows it.

    - `key`: name of its section in the page.
    - `r`: what is shown.
    """

    key: str
    r: Result

    @property
    def fitted(self) -> bool:
        """Whether the fit gives the answer, and the crossings are a footnote."""
        return self.r.answer.evidence is not None

    @property
    def changes(self) -> bool:
        """Whether it is plain that the width changes in time."""
        return self.r.fit is not None and self.r.fit.trend is not None and self.r.fit.trend.changes

    @cached_property
    def drawn(self) -> dict[str, go.Figure]:
        """The figures by name, in their order in the section."""
        r, drawn = self.r, dict[str, "go.Figure"]()
        if r.fit is not None and r.fit.best and r.trace is not None:
            drawn |= loop_figures(r)
        if r.fit is not None and len(r.fit.windows) > 1 and not r.fit.recordings:
            drawn["trend"] = trend_figure(r)
        if r.fit is not None and r.fit.best:
            drawn["fit"] = fit_figure(r)
        if r.trace is not None:
            drawn["time"] = figures.loop_figure(r)
        # Of a loop refused it would be read by the note beside it: a PV that never answers looks level, as in a gap.
        if r.trace is not None and r.trace.op is not None and "why" not in drawn and r.answer.valve != "refused":
            drawn["phase"] = figures.phase_figure(r)
        return drawn

    @property
    def answered(self) -> list[str]:
        """The answer in paragraphs, the first of them a sentence."""
        return [words.lead(self.r)]

    @cached_property
    def why(self) -> list[str]:
        """Reason of the answer."""
        return words.why(self.r)

    @property
    def planned(self) -> TableRows:
        """The test that would decide, where it was asked for and the answer is open."""
        return [] if self.r.plan is None else list(planned.rows(self.r.plan))

    @property
    def repair_text(self) -> str:
        """Say that a repair is noted, or that the width fell."""
        assert self.r.repair is not None  # the template asks for nothing else
        return repaired.text(self.r.repair, self.r.unit)

    @property
    def repair(self) -> TableRows:
        """The valve before and after its repair, and the difference."""
        return [] if self.r.repair is None else list(repaired.rows(self.r.repair, self.r.unit, self._pv_unit))

    @property
    def source(self) -> TableRows:
        """Rows on the recording: file, time span, area, valve, acceptable dead band."""
        r, loop = self.r, self.r.loop
        rows: TableRows = [("File", r.source)]
        if r.trace is not None and len(r.trace.t):
            first, last = float(np.nanmin(r.trace.t)), float(np.nanmax(r.trace.t))
            start, end = words.clock(r.t0, first), words.clock(r.t0, last)
            if r.t0 is not None and start[:10] == end[:10]:
                end = end[11:]
            rows.append(("Recording", f"{start} to {end}, {words.duration(last - first)}"))
        if r.columns:
            rows.append(("Read as", ", ".join(f"{signal} = {name}" for signal, name in r.columns.items())))
        rows += [("Not read", text) for text in r.left_out]
        rows += [(label, text) for label, text in (("Area", loop.area), ("Valve", loop.valve)) if text]
        if (limit := self.r.answer.limit) is not None:
            whose = "" if limit.origin == "given" else ", the usual limit: none was given"
            rows.append(("Acceptable", words.quantity(limit.percent_span, "% of span") + whose))
        return rows

    @property
    def shown_recording(self) -> str | None:
        """File of the recording that is drawn, where there are several."""
        recordings = () if self.r.fit is None else self.r.fit.recordings
        return next((single.source for single in recordings if single.shown), None)

    @property
    def recordings(self) -> TableRows:
        """Result of each of several recordings alone, and why one does not count."""
        if self.r.fit is None:
            return []
        unit = words.op_unit(self.r.unit)
        return [
            (
                single.source,
                words.VERDICTS[single.fit.verdict],
                words.quantity(single.fit.d, unit) if single.fit.found else "–",
                words.number(single.adds),
                words.sentence(single.left_out) or "counts",
            )
            for single in self.r.fit.recordings
        ]

    @property
    def process(self) -> TableRows:
        """The process that came with the fit."""
        if self.r.fit is None or (p := self.r.fit.process) is None:
            return []
        per = f"{self._pv_unit} per {words.op_unit(self.r.unit)}" + (" and s" if p.integrating else "")
        rows = (
            ("Velocity gain" if p.integrating else "Process gain Kp", p.kp, per),
            ("Dead time", p.dead_time, "s"),
            ("Lags together", p.lag, "s"),
        )
        return [(name, words.quantity(v, unit), _between(low, high)) for name, (v, low, high), unit in rows]

    @property
    def analysed(self) -> bool:
        """Whether it was looked at, and not refused before: of a loop refused no absence means anything."""
        return self.r.crossings != "refused" or self.r.total_half_periods > 0

    @property
    def crossings(self) -> TableRows:
        """Results of the zero crossings."""
        r, unit = self.r, words.op_unit(self.r.unit)
        if not self.analysed:
            return []
        rows: TableRows = [("A PLC would show", words.crossing(r))]
        rows += [("Half-periods", str(r.total_half_periods)), ("Detections", str(r.detections))]
        if r.repeatability is not None and r.detections > 1:
            low, high = r.repeatability
            rows.append(("Repeatability", f"{words.number(low)} to {words.quantity(high, unit)}"))
        if r.corrected is not None and r.corrected.d is not None:
            rows.append(("Bias taken out", words.quantity(r.corrected.d, unit)))
        if r.noise_floor is not None:
            rows.append(("Noise limit", words.quantity(r.noise_floor, unit)))
        return rows

    @property
    def half_periods(self) -> list[tuple[str, int, str]]:
        """Verdicts on half-periods with their counts and shares."""
        counts = [("accepted", self.r.detections), *self.r.ranked_reasons()]
        total = self.r.total_half_periods
        return [(name, n, f"{words.number(100 * n / total, 2)} %") for name, n in counts if n]

    @property
    def quality(self) -> TableRows:
        """Findings on the recording, the gravest first: severity, its word, the finding, its evidence."""
        order = list(_GRAVITY)
        found = sorted(self.r.quality, key=lambda f: order.index(f.severity))
        return [(f.severity, _GRAVITY[f.severity], f.text, _evidence(f.evidence)) for f in found]

    @property
    def settings(self) -> TableRows:
        """Settings as the maker writes them, as the detector used them, and where from."""
        r, s, loop = self.r, self.r.settings, self.r.loop
        if loop.controller is None and s.k is None:
            return []
        c, process, op = loop.controller, loop.process, words.op_unit(r.unit)
        form = gain = integral = derivative = action = weight = "–"
        others: list[tuple[str, str]] = []
        typed, notes = loop.model_fields_set, dict(s.notes)
        if c is not None:
            typed = typed | c.model_fields_set
            form, action, weight = c.form, c.action, words.number(c.setpoint_weight)
            per = f" {c.gain_unit}" if c.gain_unit else ""
            if c.form == "parallel":
                gain = f"kp {_typed(c.kp)}{per}"
                integral = f"ki {_typed(c.ki)} per {c.ti_unit}"
                derivative = f"kd {_typed(c.kd or 0.0)} {c.td_unit}"
            else:
                gain = f"PB {_typed(c.pb)} %" if c.pb is not None else f"{_typed(c.k)}{per}"
                integral = f"{_typed(c.ti)} {c.ti_unit}"
                derivative = f"{_typed(c.td)} {c.td_unit}"
            others = [
                ("Error gap of the controller", words.quantity(c.error_gap, self._pv_unit)),
                ("Output dead band of the controller", words.quantity(c.output_dead_band, op)),
                ("PV filter of the control system", words.quantity(c.pv_filter, "s")),
            ]
            # What is a default was not given, and is not called so.
            form, action = (form if "form" in typed else "–"), (action if "action" in typed else "–")
            if not typed & {"td", "kd"}:
                derivative, notes["td"] = "–", "default"
            if "setpoint_weight" not in typed:
                weight, notes["b"] = "–", "default"
        acting = "–" if s.k is None else "direct (K below 0)" if s.k < 0 else "reverse (K above 0)"
        given_kp = words.quantity(process.kp, process.kp_unit or "")
        used_kp = "not used" if s.kp is None else words.quantity(s.kp, f"{self._pv_unit} per {op}")
        rows = [
            ("Form", form, "ideal", ""),
            ("Gain K", gain, words.quantity(s.k, self._gain_unit), "k"),
            ("Integral time TI", integral, words.quantity(s.ti, "s"), "ti"),
            ("Derivative time TD", derivative, words.quantity(s.td, "s"), "td"),
            ("Action", action, acting, ""),
            ("Setpoint weight b", weight, words.number(s.b), "b"),
            ("Filter of the detector TF", words.quantity(loop.tf, "s"), words.quantity(s.tf, "s"), "tf"),
            ("Process gain Kp", "integrating" if process.type == "integrating" else given_kp, used_kp, "kp"),
            ("OP travel Δu", "", "", "delta_u"),
            ("Longest step between samples", "", words.quantity(s.max_h, "s"), ""),
            ("Detections needed N", str(loop.n) if "n" in typed else "–", str(s.n), "n"),
            ("PV span", _span(loop.pv_span, self._pv_unit), "", ""),
            ("OP span", _span(loop.op_span, op), "", ""),
            *((label, value, "", "") for label, value in others if value[0] != "0"),
        ]
        return [(label, given, used, notes.get(note, "")) for label, given, used, note in rows]

    @property
    def identification(self) -> TableRows:
        """The controller as the moves of OP show it, whether that was used or not."""
        f = self.r.identification
        if f is None:
            return []
        return [
            ("K", words.quantity(f.k, self._gain_unit), _between(f.k_low, f.k_high)),
            ("TI", words.quantity(f.ti, "s"), _between(f.ti_low, f.ti_high)),
            ("TD", words.quantity(f.td, "s"), _between(f.td_low, f.td_high)),
            ("b", words.number(f.setpoint_weight), ""),
            ("R²", words.number(f.r2), ""),
            ("steps used", str(f.samples), ""),
        ]

    @property
    def phase_note(self) -> str:
        """Note on the points of the phase plot, and on thinning that leaves too few of them."""
        assert self.r.trace is not None  # the caller draws no plot without one
        t = self.r.trace.t
        step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
        note = (
            f"One point per {words.duration(step)}. With a gap, PV stays level while OP travels across it at each "
            "reversal."
        )
        cycles = self.r.half_periods.delta_t[self.r.half_periods.reason == 0]
        if len(cycles) and step > float(np.median(cycles)) / 8:
            note += " The points lie too far apart for this recording: the shape of a single cycle is lost."
        return note

    @property
    def _pv_unit(self) -> str:
        return self.r.loop.pv_unit or "PV unit"

    @property
    def _gain_unit(self) -> str:
        return f"{words.op_unit(self.r.unit)} per {self._pv_unit}"


def _evidence(evidence: Mapping[str, float | int | str]) -> str:
    """Numbers of a finding, as text."""

    def shown(value: float | int | str) -> str:
        return value if isinstance(value, str) else str(value) if isinstance(value, int) else words.number(value, 4)

    return ", ".join(f"{key.replace('_', ' ')} {shown(value)}" for key, value in evidence.items())


def _between(low: float | None, high: float | None) -> str:
    if low is None or high is None:
        return "–"
    return f"{words.number(low)} to {words.number(high) if np.isfinite(high) else 'no upper bound'}"


def _typed(value: float | None) -> str:
    """Write a setting as a person typed it, not rounded as a measured number is."""
    return "–" if value is None else f"{value:.8g}"


def _span(span: tuple[float, float] | None, unit: str) -> str:
    return "–" if span is None else f"{_typed(span[0])} to {f'{_typed(span[1])} {unit}'}"
