//! Width with an interval from OP and PV.

use crate::plain::plain;
use crate::position::{self, name};
use crate::windows::{Batch, columns};
use glapp_analysis::{Fitted, FittedValve, OneWidth, fall_of, fitted, fitted_valve, words};
use glapp_fit::{
    Evidence, JointAnswer, Judgement, LEARNED, PositionAnswer, Prediction, SegmentAnswer, SegmentFit, THRESHOLDS, Tell,
    Together, Trend, Unfit, ValveAnswer, Verdict, Width,
};
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyMapping};
use std::sync::{Mutex, PoisonError};

/// Fits the batches that can be fitted, records of one valve; `sign` is that of the process gain, 0 where it is not known.
/// `progress` is called with the share that is done. Gives the `answer` in plain types, and what PV and the valve's
/// position said, each None where it was not asked; where it could not be fitted, only why: `unfit`, a word and its number.
/// `glapp.fit` is the public function.
#[pyfunction]
#[pyo3(signature = (batches, sign, progress=None))]
pub fn fit<'py>(
    py: Python<'py>,
    batches: Vec<Batch<'py>>,
    sign: f64,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let batches = columns(&batches)?;
    let Fitted { answer, pv, position } = telling(py, progress, |tell| fitted(&batches, sign, None, tell))?;
    let out = PyDict::new(py);
    out.set_item("answer", plain(py, &answer)?)?;
    out.set_item("pv", pv.map(|pv| of_pv(py, pv)).transpose()?)?;
    out.set_item("position", position.map(|position| of_position(py, position)).transpose()?)?;
    Ok(out)
}

/// Runs `work` without the interpreter's lock, and calls `progress` with the share that it tells. What `progress` raises first
/// is raised when the work has ended.
pub(crate) fn telling<T: Send>(
    py: Python<'_>,
    progress: Option<Bound<'_, PyAny>>,
    work: impl FnOnce(Tell) -> T + Send,
) -> PyResult<T> {
    let progress = progress.map(Bound::unbind);
    let failed = Mutex::new(None);
    let tell = |share: f64| {
        if let Some(progress) = &progress {
            Python::attach(|py| {
                let called = progress.call1(py, (share,));
                let mut failed = failed.lock().unwrap_or_else(PoisonError::into_inner);
                *failed = failed.take().or(called.err());
            });
        }
    };
    let done = py.detach(|| work(&tell));
    failed.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(done), Err)
}

/// The answer of PV's fit.
pub(crate) fn of_pv(py: Python<'_>, found: Result<JointAnswer, Unfit>) -> PyResult<Bound<'_, PyDict>> {
    let joint = match found {
        Ok(joint) => joint,
        Err(why) => return unfit(py, why, "PV"),
    };
    let out = together(py, &joint.whole)?;
    out.set_item("message", plain(py, &words::of_pv(&joint.whole, &joint.records[joint.shown], false))?)?;
    out.set_item("shown", joint.shown)?;
    let windows = joint.records.into_iter().map(|record| answered(py, record));
    out.set_item("windows", windows.collect::<PyResult<Vec<_>>>()?)?;
    Ok(out)
}

/// Fits recordings of one valve, in the order of time: of each when its time is 0 [s] (NaN where not known) and its batches. As
/// `fit`; `pv` has the `recordings` in place of windows, of each what PV said alone.
#[pyfunction]
#[pyo3(signature = (recordings, sign, progress=None))]
pub fn fit_valve<'py>(
    py: Python<'py>,
    recordings: Vec<(f64, Vec<Batch<'py>>)>,
    sign: f64,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let recorded = recordings.iter().map(|(since, batches)| Ok((*since, columns(batches)?)));
    let recorded = recorded.collect::<PyResult<Vec<_>>>()?;
    let FittedValve { answer, pv, position } = telling(py, progress, |tell| fitted_valve(&recorded, sign, tell))?;
    let out = PyDict::new(py);
    out.set_item("answer", plain(py, &answer)?)?;
    out.set_item("pv", of_recordings(py, pv)?)?;
    out.set_item("position", position.map(|position| of_position(py, position)).transpose()?)?;
    Ok(out)
}

/// Result of PV in several recordings.
fn of_recordings(py: Python<'_>, found: Result<ValveAnswer, Unfit>) -> PyResult<Bound<'_, PyDict>> {
    let valve = match found {
        Ok(valve) => valve,
        Err(why) => return unfit(py, why, "PV"),
    };
    let out = together(py, &valve.whole)?;
    if let Ok(own) = &valve.recordings[valve.shown].own {
        out.set_item("message", plain(py, &words::of_pv(&valve.whole, &own.records[own.shown], valve.shared))?)?;
    }
    out.set_item("shown", valve.shown)?;
    out.set_item("shared", valve.shared)?;
    let recordings = PyList::empty(py);
    for recording in valve.recordings {
        let one = of_pv(py, recording.own)?;
        one.set_item("repeated", recording.repeated)?;
        one.set_item("left_out", recording.left_out)?;
        one.set_item("adds", recording.lr_no_gap)?;
        recordings.append(one)?;
    }
    out.set_item("recordings", recordings)?;
    Ok(out)
}

/// Result of the valve's position.
pub(crate) fn of_position(py: Python<'_>, found: Result<PositionAnswer, Unfit>) -> PyResult<Bound<'_, PyDict>> {
    let joint = match found {
        Ok(joint) => joint,
        Err(why) => return unfit(py, why, "the position"),
    };
    let out = joined(py, (joint.verdict, joint.d, joint.low, joint.high), joint.trend)?;
    out.set_item("message", plain(py, &words::of_position(&joint))?)?;
    out.set_item("shown", joint.shown)?;
    let windows = joint.records.into_iter().map(|record| position::answered(py, record));
    out.set_item("windows", windows.collect::<PyResult<Vec<_>>>()?)?;
    Ok(out)
}

/// Joint result of all records.
fn joined<'py>(
    py: Python<'py>,
    (verdict, d, low, high): (Verdict, f64, f64, Option<f64>),
    found: Option<Trend>,
) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("verdict", name(verdict))?;
    out.set_item("d", d)?;
    out.set_item("low", low)?;
    out.set_item("high", high)?;
    out.set_item("trend", trend(py, found)?)?;
    Ok(out)
}

/// The joint answer of all windows from OP and PV as a dict, with its evidence.
fn together<'py>(py: Python<'py>, whole: &Together) -> PyResult<Bound<'py, PyDict>> {
    let out = joined(py, (whole.verdict, whole.d, whole.low, whole.high), whole.trend)?;
    for (name, value) in
        [("lr_no_gap", whole.lr_no_gap), ("lr_needed", whole.lr_needed), ("dispersion", whole.dispersion)]
    {
        out.set_item(name, value)?;
    }
    out.set_item("traversals", (whole.traversals[0], whole.traversals[1]))?;
    out.set_item("reason", whole.reason)?;
    judged(py, &out, &whole.judgement, &whole.evidence)?;
    Ok(out)
}

/// Adds the fields of a [`Judgement`] and its `evidence` to a dict.
fn judged<'py>(py: Python<'py>, out: &Bound<'py, PyDict>, judgement: &Judgement, evidence: &Evidence) -> PyResult<()> {
    out.update(plain(py, judgement)?.cast::<PyMapping>()?)?;
    out.set_item("evidence", plain(py, evidence)?)
}

/// Judgement of the ladder on the `evidence` of an answer, which may be changed, with the reason and the likelihood
/// ratio that a gap needs.
#[pyfunction]
pub fn fit_judgement<'py>(py: Python<'py>, evidence: &str) -> PyResult<Bound<'py, PyDict>> {
    let evidence: Evidence = serde_json::from_str(evidence).map_err(|e| PyValueError::new_err(e.to_string()))?;
    let (judgement, reason) = evidence.judged();
    let out = plain(py, &judgement)?.cast_into::<PyDict>()?;
    out.set_item("reason", reason)?;
    Ok(out)
}

/// The `evidence` of an answer weighed: of each quantity its value, whether a greater one speaks for a dead band, and its log-odds; and
/// the logarithm of the Bayes factor, None where the record cannot be read.
#[pyfunction]
pub fn fit_weighed<'py>(py: Python<'py>, evidence: &str) -> PyResult<Bound<'py, PyDict>> {
    let evidence: Evidence = serde_json::from_str(evidence).map_err(|e| PyValueError::new_err(e.to_string()))?;
    let quantities = PyDict::new(py);
    for (name, value, rises, worth) in evidence.quantities() {
        quantities.set_item(name, (value, rises, worth))?;
    }
    let out = PyDict::new(py);
    out.set_item("quantities", quantities)?;
    out.set_item("log_bayes_factor", evidence.weighed().map(|(factor, _)| factor))?;
    out.set_item("learned", LEARNED)?;
    Ok(out)
}

/// Value and unit of every threshold of a verdict, by its name.
#[pyfunction]
pub fn fit_thresholds(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let out = PyDict::new(py);
    for (name, value, unit) in THRESHOLDS {
        out.set_item(name, (value, unit))?;
    }
    Ok(out)
}

fn unfit<'py>(py: Python<'py>, why: Unfit, signal: &'static str) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("message", plain(py, &words::of_unfit(why, signal))?)?;
    out.set_item("unfit", (why.name(), why.number()))?;
    Ok(out)
}

/// Trend under the names of `glapp.fit.Trend`, slope and error a second.
fn trend(py: Python<'_>, trend: Option<Trend>) -> PyResult<Option<Bound<'_, PyDict>>> {
    let Some(trend) = trend else { return Ok(None) };
    let out = PyDict::new(py);
    out.set_item("message", words::of_trend(&trend).map(|message| plain(py, &message)).transpose()?)?;
    out.set_item("slope", trend.slope)?;
    out.set_item("error", trend.error)?;
    out.set_item("windows", trend.widths)?;
    out.set_item("t", trend.t)?;
    out.set_item("d", trend.d)?;
    out.set_item("changes", trend.changes())?;
    Ok(Some(out))
}

/// Whether and how fast a width changes: widths [OP unit] at their times [s], in order, with their standard errors where those
/// are known. One rule for every face: `glapp_fit::Trend`.
#[pyfunction]
#[pyo3(signature = (t, d, error=None))]
pub fn width_trend<'py>(
    py: Python<'py>,
    t: Vec<f64>,
    d: Vec<f64>,
    error: Option<Vec<f64>>,
) -> PyResult<Bound<'py, PyAny>> {
    if d.len() != t.len() || error.as_ref().is_some_and(|error| error.len() != t.len()) {
        return Err(PyValueError::new_err("t, d and error must be of the same length"));
    }
    let width = |(i, t): (usize, &f64)| Width { t: *t, d: d[i], error: error.as_ref().map(|error| error[i]) };
    plain(py, &glapp_analysis::trend(&t.iter().enumerate().map(width).collect::<Vec<_>>()))
}

/// Whether the width has fallen from one recording or window to the next, as after a repair; None where it has not. `widths` is JSON:
/// of each its time \[s\], `verdict`, `d`, `low` and `high`.
#[pyfunction]
pub fn width_fall<'py>(py: Python<'py>, widths: &str) -> PyResult<Bound<'py, PyAny>> {
    let widths: Vec<OneWidth> =
        serde_json::from_str(widths).map_err(|error| PyValueError::new_err(error.to_string()))?;
    plain(py, &fall_of(&widths))
}

/// Comparison of a loop before and after a repair, by rows of either side and its width as JSON, as in `width_fall` or
/// null.
#[pyfunction]
pub fn before_after<'py>(
    py: Python<'py>,
    rows: (Option<Batch<'_>>, Option<Batch<'_>>),
    widths: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let widths = serde_json::from_str(widths).map_err(|error| PyValueError::new_err(error.to_string()))?;
    let before = rows.0.as_ref().map(Batch::rows).transpose()?.map(|(rows, _)| rows);
    let after = rows.1.as_ref().map(Batch::rows).transpose()?.map(|(rows, _)| rows);
    plain(py, &py.detach(|| glapp_analysis::before_after((before.as_ref(), after.as_ref()), widths)))
}

/// Result of one record.
fn answered<'py>(py: Python<'py>, record: SegmentAnswer<SegmentFit>) -> PyResult<Bound<'py, PyDict>> {
    let SegmentAnswer { start, end, starts, h, answer } = record;
    let out = PyDict::new(py);
    out.set_item("verdict", name(answer.verdict))?;
    for (name, value) in [
        ("t_start", start),
        ("t_end", end),
        ("h", h),
        ("d", answer.d),
        ("low", answer.low),
        ("jump", answer.jump),
        ("lr_no_gap", answer.lr_no_gap),
        ("lr_needed", answer.lr_needed),
        ("lr_no_jump", answer.lr_no_jump),
        ("lr_no_answer", answer.lr_no_answer),
        ("information_ratio", answer.information_ratio),
        ("rise", answer.rise),
        ("kp", answer.kp),
        ("dead_time", answer.dead_time),
        ("lag", answer.lag),
        ("settles", answer.settles),
        ("sigma", answer.sigma),
        ("echo", answer.autocorrelation),
        ("cell", answer.cell),
        ("range", answer.range),
    ] {
        out.set_item(name, value)?;
    }
    out.set_item("high", answer.high)?;
    out.set_item("kp_limits", answer.kp_limits)?;
    out.set_item("kp_near", answer.kp_near)?;
    out.set_item("dead_time_limits", answer.dead_time_limits)?;
    out.set_item("lag_limits", answer.lag_limits)?;
    out.set_item("lag_near", answer.lag_near)?;
    out.set_item("integrating", answer.integrating)?;
    out.set_item("denominator", answer.denominator)?;
    out.set_item("traversals", (answer.traversals[0], answer.traversals[1]))?;
    out.set_item("cells", answer.cells)?;
    out.set_item("load_steps", answer.load_steps)?;
    out.set_item("reason", answer.reason)?;
    judged(py, &out, &answer.judgement, &answer.evidence)?;
    let time = |cell: &Prediction| starts[cell.part] + h * cell.step as f64;
    out.set_item("t", PyArray1::from_iter(py, answer.predictions.iter().map(time)))?;
    for (name, of) in
        [("pv", (|c| c.pv) as fn(&Prediction) -> f64), ("predicted", |c| c.predicted), ("position", |c| c.position)]
    {
        out.set_item(name, PyArray1::from_iter(py, answer.predictions.iter().map(of)))?;
    }
    let candidates = PyList::empty(py);
    for candidate in answer.candidates {
        let one = PyDict::new(py);
        one.set_item("lags", candidate.structure.lags)?;
        one.set_item("integrating", candidate.structure.integrating)?;
        one.set_item("noise", candidate.structure.noise.name())?;
        one.set_item("delta_deviance", candidate.delta_deviance)?;
        one.set_item("d", candidate.d)?;
        one.set_item("lr_no_gap", candidate.lr_no_gap)?;
        let (d, rise): (Vec<f64>, Vec<f64>) = candidate.profile.into_iter().unzip();
        one.set_item("profile", (PyArray1::from_vec(py, d), PyArray1::from_vec(py, rise)))?;
        candidates.append(one)?;
    }
    out.set_item("candidates", candidates)?;
    Ok(out)
}
