//! Width with an interval from OP and PV.

use glapp_fit::{Noise, Question, Reading, Seen, Verdict, Window};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

pub(crate) const VERDICTS: [(Verdict, &str); 6] = [
    (Verdict::Backlash, "backlash"),
    (Verdict::Stiction, "stiction"),
    (Verdict::Both, "both"),
    (Verdict::Sound, "sound"),
    (Verdict::AtLeast, "at_least"),
    (Verdict::CannotTell, "cannot_tell"),
];

type Signal<'py> = PyReadonlyArray1<'py, f64>;

/// A recording or a window of one: its step [s] and its stretches, (start [s], PV, OP) each.
type Batch<'py> = (f64, Vec<(f64, Signal<'py>, Signal<'py>)>);

fn batch<'a>((h, parts): &'a Batch<'_>) -> PyResult<glapp_fit::Batch<'a>> {
    let part = |(start, pv, op): &'a (f64, Signal<'_>, Signal<'_>)| {
        Ok(glapp_fit::Part { start: *start, pv: pv.as_slice()?, op: op.as_slice()? })
    };
    Ok(glapp_fit::Batch { h: *h, parts: parts.iter().map(part).collect::<PyResult<_>>()? })
}

/// Fits a recording, or the windows of a longer one, at even steps; NaN in PV is a missing sample. None where there are fewer
/// than 50 samples or OP never moves. `glapp.fit` is the door for people.
#[pyfunction]
pub fn fit<'py>(
    py: Python<'py>,
    batches: Vec<Batch<'py>>,
    sign: f64,
    bootstrap: usize,
) -> PyResult<Option<Bound<'py, PyDict>>> {
    let batches = batches.iter().map(batch).collect::<PyResult<Vec<_>>>()?;
    let question = Question { sign, bootstrap };
    let Some(whole) = py.detach(|| glapp_fit::fit(&batches, &question)) else { return Ok(None) };
    let out = PyDict::new(py);
    out.set_item("verdict", name(whole.verdict))?;
    for (name, value) in [
        ("d", whole.d),
        ("low", whole.low),
        ("lr_no_gap", whole.lr_no_gap),
        ("lr_needed", whole.lr_needed),
        ("dispersion", whole.dispersion),
    ] {
        out.set_item(name, value)?;
    }
    out.set_item("high", whole.high)?;
    out.set_item("traversals", (whole.traversals[0], whole.traversals[1]))?;
    out.set_item("reason", whole.reason)?;
    out.set_item("trend", whole.trend)?;
    out.set_item("shown", whole.shown)?;
    let windows = PyList::empty(py);
    for window in whole.windows {
        windows.append(answered(py, window)?)?;
    }
    out.set_item("windows", windows)?;
    Ok(Some(out))
}

fn name(verdict: Verdict) -> &'static str {
    VERDICTS.iter().find(|(v, _)| *v == verdict).expect("all have names").1
}

/// What one window says.
fn answered<'py>(py: Python<'py>, window: Window) -> PyResult<Bound<'py, PyDict>> {
    let Window { start, end, starts, h, answer } = window;
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
        ("trust", answer.trust),
        ("rise", answer.rise),
        ("kp", answer.kp),
        ("dead_time", answer.dead_time),
        ("lag", answer.lag),
        ("sigma", answer.sigma),
        ("echo", answer.echo),
        ("cell", answer.cell),
        ("range", answer.range),
    ] {
        out.set_item(name, value)?;
    }
    out.set_item("high", answer.high)?;
    out.set_item("kp_limits", answer.kp_limits)?;
    out.set_item("dead_time_limits", answer.dead_time_limits)?;
    out.set_item("lag_limits", answer.lag_limits)?;
    out.set_item("integrating", answer.integrating)?;
    out.set_item("traversals", (answer.traversals[0], answer.traversals[1]))?;
    out.set_item("cells", answer.cells)?;
    out.set_item("load_steps", answer.load_steps)?;
    out.set_item("reason", answer.reason)?;
    let time = |seen: &Seen| starts[seen.part] + h * seen.step as f64;
    out.set_item("t", PyArray1::from_iter(py, answer.seen.iter().map(time)))?;
    for (name, of) in
        [("pv", (|s| s.pv) as fn(&Seen) -> f64), ("foreseen", |s| s.foreseen), ("position", |s| s.position)]
    {
        out.set_item(name, PyArray1::from_iter(py, answer.seen.iter().map(of)))?;
    }
    let candidates = PyList::empty(py);
    for candidate in answer.candidates {
        let one = PyDict::new(py);
        one.set_item("lags", candidate.structure.lags)?;
        one.set_item("integrating", candidate.structure.integrating)?;
        let noise = match candidate.structure.noise {
            Noise::Still => "still",
            Noise::Input => "input",
            Noise::Output => "output",
            Noise::Slope => "slope",
            Noise::Lines | Noise::Bends => "lines",
            Noise::Both => "both",
        };
        one.set_item("noise", noise)?;
        one.set_item("behind", candidate.behind)?;
        one.set_item("d", candidate.d)?;
        one.set_item("lr_no_gap", candidate.lr_no_gap)?;
        let (d, rise): (Vec<f64>, Vec<f64>) = candidate.profile.into_iter().unzip();
        one.set_item("profile", (PyArray1::from_vec(py, d), PyArray1::from_vec(py, rise)))?;
        candidates.append(one)?;
    }
    out.set_item("candidates", candidates)?;
    Ok(out)
}

/// Steps that one window should hold; None where `fit` would give none. See `glapp.fit`.
#[pyfunction]
pub fn fit_window(py: Python<'_>, whole: Batch<'_>, sign: f64) -> PyResult<Option<usize>> {
    let whole = batch(&whole)?;
    Ok(py.detach(|| glapp_fit::window(&whole, sign)))
}

/// One answer from windows of (verdict, d, low, high, lr_no_gap, t): (verdict, d, low, high, (slope, error) or None).
#[pyfunction]
#[allow(clippy::type_complexity, reason = "plain tuples are the face")]
pub fn fit_combine(
    windows: Vec<(String, f64, f64, Option<f64>, f64, f64)>,
) -> PyResult<(&'static str, f64, f64, Option<f64>, Option<(f64, f64)>)> {
    let window = |(verdict, d, low, high, lr_no_gap, t): (String, f64, f64, Option<f64>, f64, f64)| {
        let (verdict, _) = VERDICTS
            .iter()
            .find(|(_, name)| *name == verdict)
            .ok_or_else(|| PyValueError::new_err(format!("{verdict}: no such verdict")))?;
        Ok(Reading { verdict: *verdict, d, low, high, lr_no_gap, t })
    };
    let windows = windows.into_iter().map(window).collect::<PyResult<Vec<_>>>()?;
    if windows.is_empty() {
        return Err(PyValueError::new_err("no window to combine"));
    }
    let whole = glapp_fit::combine(&windows);
    let name = VERDICTS.iter().find(|(v, _)| *v == whole.verdict).expect("all have names").1;
    Ok((name, whole.d, whole.low, whole.high, whole.trend))
}
