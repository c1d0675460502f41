"""Questions about one loop: pure functions from Arrow tables to Arrow tables, the same for every engine.

::

    rows of a loop and a day ──look──→ a row: quality, law of the controller, windows and what they may show
    rows of `look` of a loop ──choose─→ the windows worth fitting, at most `fits`
    rows of a loop and a day ──cut───→ the samples of the windows that were chosen
    these samples ───────────judge──→ a row a window, a row a loop: the joint answer of the valve, its trend, its harm

None of them knows a file, a clock or another loop; the order of the rows that go in does not matter. Crossings are
followed separately, one day after the other (`glapp.fleet.history`).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .. import _glapp
from .._glapp import to_text
from ..errors import InputError, unforeseen
from ..estimate import analyze
from ..fit import Fit, fit_recordings
from ..loop import Loop
from ..recording import AT_HIGH, AT_LOW, BAD, NOT_AUTO
from ..report import words
from ..result import HalfPeriods, Harm, Result, Settings, decide, harm_of
from ..samples import Samples
from ..several_recordings import unfit
from .lake import SIGNALS, day_name
from .problems import DataIssue

__all__ = [
    "DAYS",
    "FITS",
    "LOOPS",
    "ROWS_OF_WINDOW",
    "SAMPLES",
    "US",
    "WINDOWS",
    "Signal",
    "choose",
    "cut",
    "judge",
    "look",
    "on_pv",
    "refused",
    "signals_of",
]

Floats = NDArray[np.float64]

ROWS_OF_WINDOW = 3000
"""Rows of a window: as many cells as a fit takes at most, so no row is averaged away."""

FITS = 8
"""Windows of a loop that are fitted at most, however long its history is."""

OF_A_DAY = 4
"""Windows of a day that are kept in mind."""

OUTSIDE = 0.1
"""PV is outside its span where it is beyond it by more than this share of it."""

MOSTLY = 0.5
"""Share of a day's PV outside its span from which the day is in another unit."""

US = pa.timestamp("us", tz="UTC")

DAYS = pa.schema(
    [
        ("loop", pa.string()),
        ("day", pa.int32()),
        ("part", pa.int32()),
        ("first", US),
        ("last", US),
        ("rows", pa.int64()),
        ("usable", pa.float64()),
        ("step", pa.float64()),
        ("op", pa.bool_()),
        ("doubled", pa.int64()),
        ("contradicting", pa.int64()),
        ("unfit", pa.string()),
        ("unfit_code", pa.string()),
        ("unfit_reason", pa.string()),
        ("crossings", pa.string()),
        ("crossings_code", pa.string()),
        ("crossings_reason", pa.string()),
        ("k", pa.float64()),
        ("ti", pa.float64()),
        ("td", pa.float64()),
        ("origins", pa.string()),
        ("detector", pa.string()),
        ("quality", pa.list_(pa.struct([("code", pa.string()), ("severity", pa.string())]))),
        ("window_first", pa.list_(US)),
        ("window_last", pa.list_(US)),
        ("window_score", pa.list_(pa.float64())),
    ]
)
"""One row per loop and day; `docs/fleet.md` describes every column."""

SAMPLES = pa.schema(
    [
        ("loop", pa.string()),
        ("window", pa.int64()),
        ("t", pa.int64()),
        *((name, pa.float64()) for name in ("sp", "pv", "op", "position")),
        ("flags", pa.uint8()),
    ]
)
"""Samples of windows: window and t in microseconds since 1970 UTC, a signal that is not there null."""

WINDOWS = pa.schema(
    [
        ("loop", pa.string()),
        ("first", US),
        ("last", US),
        ("rows", pa.int64()),
        ("verdict", pa.string()),
        ("reason_code", pa.string()),
        ("d", pa.float64()),
        ("low", pa.float64()),
        ("high", pa.float64()),
        ("unit", pa.string()),
        ("lr_no_gap", pa.float64()),
        ("lr_needed", pa.float64()),
        ("kp", pa.float64()),
        ("dead_time", pa.float64()),
        ("lag", pa.float64()),
        ("repeated", pa.float64()),
        ("left_out", pa.string()),
        ("adds", pa.float64()),
        ("pv_share", pa.float64()),
        ("op_share", pa.float64()),
        ("k", pa.float64()),
        ("ti", pa.float64()),
        ("td", pa.float64()),
        ("origins", pa.string()),
    ]
)
"""A row a loop and fitted window."""

LOOPS = pa.schema(
    [
        ("loop", pa.string()),
        ("area", pa.string()),
        ("valve_type", pa.string()),
        ("positioner", pa.string()),
        ("days", pa.int64()),
        ("first", US),
        ("last", US),
        ("rows", pa.int64()),
        ("lost", pa.int64()),
        ("windows", pa.int64()),
        ("verdict", pa.string()),
        ("valve", pa.string()),
        ("confidence", pa.string()),
        ("cause", pa.string()),
        ("width_kind", pa.string()),
        ("width", pa.float64()),
        ("low", pa.float64()),
        ("high", pa.float64()),
        ("unit", pa.string()),
        ("width_percent", pa.float64()),
        ("low_percent", pa.float64()),
        ("high_percent", pa.float64()),
        ("acceptable_percent", pa.float64()),
        ("acceptable_origin", pa.string()),
        ("evidence", pa.string()),
        ("p_gap", pa.float64()),
        ("p_beyond", pa.float64()),
        ("acceptable", pa.string()),
        ("urgency", pa.string()),
        ("pv_share", pa.float64()),
        ("op_share", pa.float64()),
        ("harm", pa.float64()),
        ("score", pa.float64()),
        ("rank", pa.list_(pa.float64())),
        ("health", pa.string()),
        ("next", pa.string()),
        ("next_text", pa.string()),
        ("reason_code", pa.string()),
        ("reason", pa.string()),
        ("hindrance", pa.string()),
        ("findings", pa.string()),
        ("lr_no_gap", pa.float64()),
        ("lr_needed", pa.float64()),
        ("trend", pa.float64()),
        ("trend_error", pa.float64()),
        ("trend_first", US),
        ("trend_last", US),
        ("trend_d_first", pa.float64()),
        ("trend_d_last", pa.float64()),
        ("changes", pa.bool_()),
        ("crossings", pa.string()),
        ("d_hat", pa.float64()),
        ("detections", pa.int64()),
        ("usable", pa.float64()),
        ("step", pa.float64()),
    ]
)
"""A row a loop."""


@dataclass(frozen=True, slots=True)
class _Day:
    """The rows of a day on the times of PV's samples."""

    t: NDArray[np.int64]
    signals: dict[str, Floats]
    flags: NDArray[np.uint8] | None
    doubled: int
    contradicting: int

    def samples(self, loop: Loop, part: slice = slice(None)) -> Samples:
        """Rows of it as a recording."""
        named: dict[str, Any] = {name: x[part] for name, x in self.signals.items()}
        if self.flags is not None:
            named["flags"] = self.flags[part]
        return _samples(loop, self.t[part], named)


def _samples(loop: Loop, t: NDArray[np.int64], signals: dict[str, Any]) -> Samples:
    made = Samples(loop, {"t": t.astype("datetime64[us]"), **signals})
    made.source = f"{loop.name} of {_moment(t[0]):%Y-%m-%d %H:%M}"
    made.t0, made.zone = _moment(t[0]), "UTC"
    return made


def _moment(micros: Any) -> datetime:
    return datetime.fromtimestamp(int(micros) / 1e6, UTC)


@dataclass(frozen=True, slots=True)
class Signal:
    """Samples of one signal in the order of time: when, its value, whether it cannot be believed."""

    t: NDArray[np.int64]
    value: Floats
    lost: NDArray[np.bool_]


def signals_of(rows: pa.Table) -> tuple[dict[str, Signal], int, int]:
    """Rows signal by signal in the order of time, each once; how many came more than once, how many contradict others.

    Two rows of one signal and moment that differ contradict each other: neither can be believed.
    """
    signal, t, value, bad = (rows.column(name).to_numpy() for name in ("signal", "t", "value", "bad"))
    found: dict[str, Signal] = {}
    doubled = contradicting = 0
    for number in np.unique(signal):
        mine = np.flatnonzero(signal == number)
        if (np.diff(t[mine]) <= 0).any():
            mine = mine[np.lexsort((bad[mine], value[mine], t[mine]))]
        ts, xs, wrong = t[mine], value[mine], bad[mine]
        same = np.diff(ts) == 0
        if same.any():
            alike = same & ((np.diff(xs) == 0) | (np.isnan(xs[1:]) & np.isnan(xs[:-1]))) & (wrong[1:] == wrong[:-1])
            against = same & ~alike
            doubled, contradicting = doubled + int(alike.sum()), contradicting + int(against.sum())
            first = np.r_[True, ~same]
            group = np.cumsum(first) - 1
            doubtful = np.zeros(int(group[-1]) + 1, np.bool_)
            doubtful[group[1:][against]] = True
            ts, xs, wrong = ts[first], xs[first], wrong[first] | doubtful
        found[SIGNALS[number]] = Signal(ts, xs, wrong)
    return found, doubled, contradicting


def on_pv(found: dict[str, Signal]) -> tuple[dict[str, Floats], NDArray[np.uint8]]:
    """All signals on the times of PV's samples, each held from its last sample to its next, and the flags.

    Before a signal's first sample it is not known: NaN; an unknown mode is not automatic, an unknown limit flag clear.
    """
    t, pv, wrong = found["pv"].t, found["pv"].value, found["pv"].lost
    flags = (wrong * np.uint8(BAD)).astype(np.uint8)
    signals: dict[str, Floats] = {"pv": pv}
    for name, signal in found.items():
        if name == "pv":
            continue
        at = np.searchsorted(signal.t, t, side="right") - 1
        none = (at < 0) | signal.lost[at]
        if name in _FLAGS:
            raised = (signal.value[at] != 0) != (name == "mode")  # a mode is 1 where the loop is in automatic
            flags |= np.where(none, name == "mode", raised).astype(np.uint8) * np.uint8(_FLAGS[name])
        else:
            signals[name] = np.where(none, np.nan, signal.value[at])
    return signals, flags


def _aligned(rows: pa.Table) -> _Day | None:
    """The rows of a day on the times of PV's samples; None where there is no PV."""
    found, doubled, contradicting = signals_of(rows)
    if "pv" not in found:
        return None
    signals, flags = on_pv(found)
    return _Day(found["pv"].t, signals, flags if flags.any() else None, doubled, contradicting)


_FLAGS = {"mode": NOT_AUTO, "op_low_flag": AT_LOW, "op_high_flag": AT_HIGH}


def look(rows: pa.Table, loop: Loop, day: int, part: int = 0) -> pa.Table:
    """A row of `DAYS`: what one day of a loop holds, and its windows with what each may show.

    - `rows`: columns signal, t, value and bad of that loop and day, in any order.
    - `loop`: its settings.
    - `day`: days since 1970, UTC.
    - `part`: which part of the day it is, where a day has too many rows to be looked at as a whole.
    """
    out: dict[str, Any] = dict.fromkeys(DAYS.names)
    out |= {"loop": loop.name, "day": day, "part": part, "rows": 0, "doubled": 0, "contradicting": 0, "op": False}
    out |= {"crossings": "refused", "window_first": [], "window_last": [], "window_score": []}
    here = _aligned(rows)
    try:
        if here is None:
            raise InputError("has no sample", tag="PV", hint="check the export")
        out |= {"rows": len(here.t), "first": int(here.t[0]), "last": int(here.t[-1]), "op": "op" in here.signals}
        out |= {"doubled": here.doubled, "contradicting": here.contradicting}
        recording = here.samples(loop)
        whole = recording.beginning(len(here.t))
        good = whole.flags is None or (whole.flags & BAD == 0)
        out |= {"usable": float(np.mean(good)), "step": float(np.median(np.diff(whole.t)))}
        if (share := _outside(loop, whole.pv)) > MOSTLY:
            what = f"{100 * share:.0f} % of PV lies outside its span {loop.pv_span}: is it in another unit?"
            out |= {"unfit": "cannot_tell", "unfit_code": "outside_span", "unfit_reason": what}
            return _row(out, DAYS)
        result = analyze(recording, fit=False)
        out |= _judged(result, out["step"], "op" in here.signals, "sp" in here.signals)
        why = unfit(result)
        if why is not None:
            out |= dict(zip(("unfit", "unfit_code", "unfit_reason"), why, strict=True))
        if whole.op is not None and (why is None or why[0] == "oscillation"):
            windows = _glapp.Windows(ROWS_OF_WINDOW, 0.25 * ROWS_OF_WINDOW * max(out["step"], 1e-6))
            windows.add(whole)
            best = sorted(windows.scores(), key=lambda w: (-w[2], w[0]))[:OF_A_DAY]
            begin = int(here.t[0])
            for i, name in enumerate(("window_first", "window_last")):
                out[name] = [begin + round(window[i] * 1e6) for window in sorted(best)]
            out["window_score"] = [score for _, _, score in sorted(best)]
    except InputError as error:
        out |= {"unfit": "cannot_tell", "unfit_code": "unusable", "unfit_reason": str(error)}
    except Exception as error:  # not to lose all other loops
        out |= {"unfit": "cannot_tell", "unfit_code": "fault", "unfit_reason": str(unforeseen(error, None, loop.name))}
    return _row(out, DAYS)


def _row(values: dict[str, Any], schema: pa.Schema) -> pa.Table:
    return pa.Table.from_pylist([values], schema=schema)


def _outside(loop: Loop, pv: Floats) -> float:
    """Share of PV that lies well outside its span."""
    if loop.pv_span is None:
        return 0.0
    low, high = loop.pv_span
    beyond = OUTSIDE * (high - low)
    known = pv[np.isfinite(pv)]
    return float(np.mean((known < low - beyond) | (known > high + beyond))) if len(known) else 0.0


def _judged(result: Result, step: float, op: bool, sp: bool) -> dict[str, Any]:
    """Analysis of a day without the fit, and the settings for a detector of its crossings."""
    s = result.settings
    detector = None
    if s.k is not None and s.ti is not None and sp and step > 0:
        detector = {name: getattr(s, name) for name in ("k", "ti", "td", "b", "kp", "n")} | {"h": step, "op": op}
        detector |= {"op_limits": result.loop.op_range(), "tf": result.loop.tf, "kp_origin": s.origins.get("kp")}
    return {
        "crossings": result.crossings,
        "crossings_code": result.why,
        "crossings_reason": result.reason,
        **{name: getattr(s, name) for name in ("k", "ti", "td")},
        "origins": json.dumps(s.origins, sort_keys=True),
        "detector": None if detector is None else json.dumps(detector, sort_keys=True),
        "quality": [{"code": f.code, "severity": f.severity} for f in result.quality],
    }


def choose(days: pa.Table, fits: int = FITS) -> list[tuple[int, int]]:
    """The windows of a loop that are worth fitting: first and last moment [µs since 1970 UTC], in the order of time.

    The history is divided into `fits` equal epochs, and of each the window is taken that may show most; where an epoch
    has none, the best of what is left is taken in its place.

    - `days`: rows of `DAYS` of one loop, in any order.
    - `fits`: greatest number of windows.

    Examples
    --------
    >>> found = {"window_first": [[0, 10, 80]], "window_last": [[9, 19, 89]], "window_score": [[1.0, 2.0, 0.5]]}
    >>> choose(pa.table(found), fits=2)
    [(10, 19), (80, 89)]
    """

    def column(name: str) -> list[Any]:
        nested = days.column(name).combine_chunks()
        flat = nested.flatten() if isinstance(nested, pa.ListArray) else pa.concat_arrays(nested.chunks).flatten()
        flat = flat if pa.types.is_floating(flat.type) else flat.cast(pa.int64())
        return list(flat.to_pylist())

    found = list(zip(column("window_score"), column("window_first"), column("window_last"), strict=True))
    if not found:
        return []
    begin, end = min(w[1] for w in found), max(w[2] for w in found) + 1
    best = sorted(found, key=lambda w: (-w[0], w[1]))
    taken: dict[int, tuple[int, int]] = {}
    left = []
    for _, first, last in best:
        epoch = fits * (first - begin) // (end - begin)
        if epoch in taken:
            left.append((first, last))
        else:
            taken[epoch] = (first, last)
    return sorted([*taken.values(), *left[: fits - len(taken)]])


def cut(rows: pa.Table, loop: Loop, windows: Sequence[tuple[int, int]]) -> pa.Table:
    """The samples of windows of one day, a table of `SAMPLES`; `rows` are those that `look` had."""
    here = _aligned(rows)
    parts = []
    for first, last in windows if here is not None else ():
        assert here is not None
        part = slice(int(np.searchsorted(here.t, first)), int(np.searchsorted(here.t, last, side="right")))
        n = part.stop - part.start
        columns: dict[str, Any] = {
            "loop": pa.array([loop.name] * n, pa.string()),
            "window": np.full(n, first),
            "t": here.t[part],
            "flags": np.zeros(n, np.uint8) if here.flags is None else here.flags[part],
        }
        for name in ("sp", "pv", "op", "position"):
            columns[name] = here.signals[name][part] if name in here.signals else pa.nulls(n, pa.float64())
        parts.append(pa.table([columns[name] for name in SAMPLES.names], schema=SAMPLES))
    return pa.concat_tables(parts) if parts else SAMPLES.empty_table()


def judge(
    samples: pa.Table, days: pa.Table, crossings: pa.Table, loop: Loop
) -> tuple[pa.Table, pa.Table, list[DataIssue]]:
    """The answer of a loop: a row of `LOOPS`, rows of `WINDOWS`, and its data issues.

    - `samples`: rows of `SAMPLES`: all windows that were chosen, in any order.
    - `days`: rows of `DAYS` of the loop, in any order.
    - `crossings`: rows of `glapp.fleet.history.CROSSINGS` of the loop, in any order: the last says what was found of
      all of them.
    - `loop`: its settings.
    """
    looks = sorted(days.to_pylist(), key=_order)
    followed = crossings.to_pylist()
    crossed = max((day for day in followed if day["crossings_code"] != "fault"), key=_order, default=None)
    problems = _problems(loop, looks, followed)
    fit: Fit | None = None
    windows: list[dict[str, Any]] = []
    try:
        recordings, short = _recordings(samples, loop)
        if short:
            what = f"{short} chosen windows have fewer than two values of PV, and are not fitted"
            problems.append(DataIssue("window", what, "nothing; more rows a day give better windows", loop=loop.name))
        if recordings:
            of = [_look_of(one, looks) for one in recordings]
            known = [_known_unfit(day) for day in of]
            fit = fit_recordings(recordings, unfit=known)
            for one, window, its in zip(recordings, fit.recordings, of, strict=True):
                windows.append(_window(loop, one, window, its))
                if window.repeated > MOSTLY:
                    what = f"{100 * window.repeated:.0f} % of the window's PV repeats an earlier one: it counts there"
                    day = windows[-1]["first"]
                    problems.append(
                        DataIssue(
                            "replayed", what, "check the export", loop=loop.name, day=_moment(day).date().isoformat()
                        )
                    )
    except Exception as error:  # not to lose all other loops
        fault = error if isinstance(error, InputError) else unforeseen(error, None, loop.name)
        problems.append(DataIssue("fault", str(fault), "report it", loop=loop.name))
        return refused(loop, "fault", str(fault), looks), WINDOWS.empty_table(), problems
    if fit is None:
        fit = _not_fitted(looks, loop)
    row = _row(_loop_row(loop, looks, crossed, fit, windows), LOOPS)
    return row, pa.Table.from_pylist(windows, schema=WINDOWS), problems


def refused(loop: Loop, code: str, reason: str, looks: Sequence[dict[str, Any]] = ()) -> pa.Table:
    """A row of `LOOPS` of a loop that is not judged: why.

    Examples
    --------
    >>> refused(Loop(name="FIC1"), "no_rows", "none of its rows can be used").select(["loop", "valve"]).to_pylist()
    [{'loop': 'FIC1', 'valve': 'refused'}]
    """
    crossed = _WITHOUT_CROSSINGS | {"crossings": "refused", "crossings_code": code, "crossings_reason": reason}
    return _row(_loop_row(loop, list(looks), crossed, None, []) | {"hindrance": "data"}, LOOPS)


def _order(row: dict[str, Any]) -> tuple[int, int]:
    """Sort key of windows: day and part."""
    return row["day"], row["part"]


def _look_of(recording: Samples, looks: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The look at the day that a window is of."""
    assert recording.t0 is not None
    began = [day for day in looks if day["first"] is not None and day["first"] <= recording.t0]
    return began[-1]


def _recordings(samples: pa.Table, loop: Loop) -> tuple[list[Samples], int]:
    """A recording a window, in the order of time, and how many windows have too few rows to be one."""
    window, t = samples.column("window").to_numpy(), samples.column("t").to_numpy()
    order = np.lexsort((t, window))
    cuts = np.flatnonzero(np.diff(window[order])) + 1
    found = []
    short = 0
    for rows in np.split(order, cuts) if len(order) else ():
        part = samples.take(pa.array(rows))
        columns = {name: part.column(name).to_numpy() for name in ("sp", "pv", "op", "position", "flags")}
        signals = {name: x for name, x in columns.items() if name in ("pv", "flags") or not np.isnan(x).all()}
        if len(rows) > 1 and np.isfinite(columns["pv"]).any():
            found.append(_samples(loop, part.column("t").to_numpy(), signals))
        else:
            short += 1
    return found, short


def _known_unfit(day: dict[str, Any]) -> Any:
    """Finding of a look at the day that makes a fit unnecessary."""
    return None if day["unfit"] is None else (day["unfit"], day["unfit_code"], day["unfit_reason"])


def _window(loop: Loop, recording: Samples, fitted: Any, day: dict[str, Any]) -> dict[str, Any]:
    """Row of a fitted window in the table `WINDOWS`."""
    fit: Fit = fitted.fit
    whole = recording.beginning(recording.rows or 0)
    law = (day["k"], day["ti"])
    harm = harm_of(fit, law, whole) if fit.d and fitted.left_out is None else Harm(None, None)
    p = fit.process
    assert recording.t0 is not None
    first = round(recording.t0.timestamp() * 1e6)
    return {
        "loop": loop.name,
        "first": first,
        "last": first + round(whole.t[-1] * 1e6),
        "rows": len(whole.t),
        "verdict": fit.verdict,
        "reason_code": fit.why,
        "d": fit.d,
        "low": fit.low,
        "high": fit.high,
        "unit": fit.unit,
        "lr_no_gap": fit.lr_no_gap,
        "lr_needed": fit.lr_needed,
        **({} if p is None else {"kp": p.kp[0], "dead_time": p.dead_time[0], "lag": p.lag[0]}),
        "repeated": fitted.repeated,
        "left_out": fitted.left_out,
        "adds": fitted.adds,
        "pv_share": harm.pv_share,
        "op_share": harm.op_share,
        **{name: day[name] for name in ("k", "ti", "td", "origins")},
    }


_WITHOUT_CROSSINGS: dict[str, Any] = {name: None for name in ("d_hat", "k", "ti", "td", "tf")}
_WITHOUT_CROSSINGS |= {"detections": 0, "rejected": "{}"}


def _why_without_crossings(last: dict[str, Any]) -> dict[str, Any]:
    """What a detector says that never had settings or a day that could be used: what the last day says of it."""
    crossed = _WITHOUT_CROSSINGS | {name: last[name] for name in ("crossings", "crossings_code", "crossings_reason")}
    if crossed["crossings"] == "refused":
        crossed["crossings_code"] = crossed["crossings_code"] or last["unfit_code"]
        crossed["crossings_reason"] = crossed["crossings_reason"] or last["unfit_reason"]
    return crossed


def _result(loop: Loop, crossed: dict[str, Any], fit: Fit | None, windows: list[dict[str, Any]]) -> Result:
    """The result of a loop, from the crossings of its last day and the joint fit, as the sentences need it."""
    rejected = json.loads(crossed["rejected"])
    return Result(
        name=loop.name,
        source="lake",
        loop=loop,
        t0=None,
        crossings=crossed["crossings"],
        why=crossed["crossings_code"],
        reason=crossed["crossings_reason"],
        d_hat=crossed["d_hat"],
        unit=loop.op_label,
        d_hat_percent_span=None,
        repeatability=None,
        noise_floor=None,
        detections=crossed["detections"],
        half_periods=HalfPeriods.empty(),
        reasons=rejected,
        answer=decide(
            crossings=crossed["crossings"],
            d_hat=crossed["d_hat"],
            detections=crossed["detections"],
            reasons=rejected,
            fit=fit,
            loop=loop,
            harm=[Harm(w["pv_share"], w["op_share"]) for w in windows],
        ),
        settings=Settings(crossed["k"], crossed["ti"], crossed["td"], None, crossed["tf"], None, loop.n, None, {}, {}),
        fit=fit,
    )


def _loop_row(
    loop: Loop,
    looks: list[dict[str, Any]],
    crossed: dict[str, Any] | None,
    fit: Fit | None,
    windows: list[dict[str, Any]],
) -> dict[str, Any]:
    """A row of `LOOPS`; `crossed` is the last row of `CROSSINGS`, None where there is none."""
    result = _result(loop, crossed or _why_without_crossings(looks[-1]), fit, windows)
    answer = result.answer
    harm = answer.harm or Harm(None, None)
    trend = None if fit is None else fit.trend
    start = None if not windows else windows[0]["first"]
    rows = sum(day["rows"] for day in looks)
    findings = _lasting(looks)
    code = (_reason_code(fit) if fit is not None else result.why) or None
    dated = [day for day in looks if day["first"] is not None]
    return {
        "loop": loop.name,
        "area": loop.area,
        "valve_type": loop.valve,
        "positioner": None if loop.positioner is None else loop.positioner.type,
        "days": len({day["day"] for day in dated}),
        "first": min((day["first"] for day in dated), default=None),
        "last": max((day["last"] for day in dated), default=None),
        "rows": rows,
        "lost": 0,
        "windows": sum(w["reason_code"] is not None for w in windows),
        "verdict": answer.verdict,
        "confidence": answer.confidence,
        "cause": answer.cause,
        "width_kind": answer.width_kind,
        "valve": answer.valve,
        "width": answer.width,
        "low": answer.low,
        "high": answer.high,
        "unit": result.unit,
        "width_percent": answer.width_percent_span,
        "low_percent": answer.low_percent_span,
        "high_percent": answer.high_percent_span,
        "acceptable_percent": None if answer.limit is None else answer.limit.percent_span,
        "acceptable_origin": None if answer.limit is None else answer.limit.origin,
        "evidence": answer.evidence,
        "p_gap": answer.p_gap,
        "p_beyond": answer.p_beyond,
        "acceptable": answer.acceptable,
        "urgency": answer.urgency,
        "pv_share": harm.pv_share,
        "op_share": harm.op_share,
        "harm": harm.worst,
        "score": answer.score,
        "health": answer.health,
        "rank": list(answer.rank),
        "next": answer.next.code,
        "next_text": words.next_step(result),
        "reason_code": code,
        "reason": fit.reason if fit is not None else result.reason,
        "hindrance": None if words.judged(result) else _hindrance(looks, code, findings),
        "findings": " ".join(findings),
        "lr_no_gap": None if fit is None else fit.lr_no_gap,
        "lr_needed": None if fit is None else fit.lr_needed,
        **({} if trend is None or start is None else _trend(trend, start)),
        "changes": trend is not None and trend.changes,
        "crossings": result.crossings,
        "d_hat": result.d_hat,
        "detections": result.detections,
        "usable": sum(day["rows"] * (day["usable"] or 0.0) for day in looks) / rows if rows else None,
        "step": _mean([day["step"] for day in looks if day["step"] is not None]),
    }


def _reason_code(fit: Fit) -> str:
    """Code of the reason of a fit; where no window could be fitted, the commonest code of the windows."""
    words = [one.fit.why for one in fit.recordings]
    return fit.why or (max(sorted(set(words)), key=words.count) if words else "")


def _trend(trend: Any, start: int) -> dict[str, Any]:
    """Columns of the trend."""
    first, last = (start + round(t * 1e6) for t in trend.t)
    return {
        "trend": trend.slope,
        "trend_error": trend.error,
        "trend_first": first,
        "trend_last": last,
        "trend_d_first": trend.d[0],
        "trend_d_last": trend.d[1],
    }


def _mean(values: Sequence[float]) -> float | None:
    return None if not values else float(np.mean(values))


def _not_fitted(looks: list[dict[str, Any]], loop: Loop) -> Fit | None:
    """Why nothing of a loop was fitted, where its days say so: what most of them say."""
    unfit = [(day["unfit"], day["unfit_code"], day["unfit_reason"]) for day in looks if day["unfit"] is not None]
    if 2 * len(unfit) > len(looks):
        codes = [code for _, code, _ in unfit]
        most = max(sorted(set(codes)), key=codes.count)
        verdict, code, reason = next(one for one in unfit if one[1] == most)
        return Fit(verdict, reason, loop.op_label, why=code)
    if not any(day["op"] for day in looks):
        return None  # the crossings answer
    return Fit("cannot_tell", to_text("fit.op_rests"), loop.op_label, why="op_rests")


def _lasting(looks: list[dict[str, Any]]) -> list[str]:
    """Findings of quality, but for mere remarks, that more than half of the days have."""
    codes = [one["code"] for day in looks for one in day["quality"] or () if one["severity"] != "info"]
    return [code for code in sorted(set(codes)) if 2 * codes.count(code) > len(looks)]


HINDRANCES: dict[str, tuple[str, ...]] = {
    "compression": ("lined", "compressed_pv", "frozen"),
    "sampling": ("coarse", "hidden_by_samples", "sampling"),
    "resolution": ("quantised_pv", "quantised_op"),
    "manual": ("not_auto",),
    "op_rests": ("op_rests", "op_still", "op_constant", "still", "once", "hidden_by_lag", "few", "few_rows"),
    "load": (
        "swings",
        "repeats",
        "opposed",
        "hidden_by_changes",
        "sinusoidal",
        "recordings_disagree",
        "windows_disagree",
    ),
    "evidence": (
        "may_be_a_gap",
        "families_disagree",
        "misfit",
        "no_answer",
        "windows_silent",
        "outweighed",
        "disagree",
        "noise",
    ),
}
"""Obstacles to an answer, by their codes, in addition to `no_op` and `data`."""


def _hindrance(looks: list[dict[str, Any]], code: str | None, findings: Sequence[str]) -> str:
    """Change that an answer needs.

    OP is not recorded; the reason that was given; where that is too little evidence, a finding that lasts.
    """
    if not any(day["op"] for day in looks):
        return "no_op"
    of = {one: name for name, codes in HINDRANCES.items() for one in codes}
    next_step = of.get(code or "", "data")
    return next_step if next_step != "evidence" else next((of[one] for one in findings if one in of), next_step)


def _problems(loop: Loop, looks: list[dict[str, Any]], crossings: list[dict[str, Any]]) -> list[DataIssue]:
    """Data issues that a loop's days show of the lake and not of the loop, and faults over its crossings."""
    found = [
        DataIssue("fault", day["crossings_reason"], "report it", loop=loop.name, day=day_name(day["day"]))
        for day in crossings
        if day["crossings_code"] == "fault"
    ]
    for day in looks:
        when: dict[str, Any] = {"loop": loop.name, "day": day_name(day["day"])}
        if day["doubled"]:
            what = f"{day['doubled']} rows are there more than once, and count once"
            found.append(
                DataIssue("doubled", what, "nothing; or take out what was exported twice", **when, rows=day["doubled"])
            )
        if day["contradicting"]:
            what = f"{day['contradicting']} rows say something else of a moment than others: these moments count as bad"
            todo = "find out which export is right, and take out the other"
            found.append(DataIssue("contradicting", what, todo, **when, rows=day["contradicting"]))
        if day["unfit_code"] in ("outside_span", "unusable", "fault"):
            todo = "check unit and span in the settings" if day["unfit_code"] == "outside_span" else "check the export"
            found.append(DataIssue(day["unfit_code"], day["unfit_reason"], todo, **when, rows=day["rows"]))
    return found
