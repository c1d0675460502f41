//! Width with an interval from OP and PV.

use glapp_fit::{Noise, Question, Seen, Verdict, Window};
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

/// Fits a record: `parts` of (PV, OP) at even steps of `h` [s], one for each unbroken stretch; NaN in PV is a missing sample.
/// None where there are fewer than 50 samples or OP never moves. `glapp.fit` is the door for people.
#[pyfunction]
pub fn fit<'py>(
    py: Python<'py>,
    parts: Vec<(PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>)>,
    h: f64,
    sign: f64,
    bootstrap: usize,
    seed: u64,
) -> PyResult<Option<Bound<'py, PyDict>>> {
    let parts: Vec<(&[f64], &[f64])> =
        parts.iter().map(|(y, u)| Ok((y.as_slice()?, u.as_slice()?))).collect::<PyResult<_>>()?;
    let question = Question { h, sign, bootstrap, seed };
    let Some(answer) = py.detach(|| glapp_fit::fit(&parts, &question)) else { return Ok(None) };
    let out = PyDict::new(py);
    out.set_item("verdict", VERDICTS.iter().find(|(v, _)| *v == answer.verdict).expect("all have names").1)?;
    for (name, value) in [
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
    for (name, column) in [
        ("part", answer.seen.iter().map(|s| s.part).collect()),
        ("step", answer.seen.iter().map(|s| s.step).collect::<Vec<_>>()),
    ] {
        out.set_item(name, PyArray1::from_vec(py, column))?;
    }
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
    Ok(Some(out))
}

/// Steps that one fit should hold at most; None where `fit` would give none. See `glapp.fit`.
#[pyfunction]
pub fn fit_window(
    py: Python<'_>,
    parts: Vec<(PyReadonlyArray1<'_, f64>, PyReadonlyArray1<'_, f64>)>,
    sign: f64,
) -> PyResult<Option<usize>> {
    let parts: Vec<(&[f64], &[f64])> =
        parts.iter().map(|(y, u)| Ok((y.as_slice()?, u.as_slice()?))).collect::<PyResult<_>>()?;
    Ok(py.detach(|| glapp_fit::window(&parts, sign)))
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
        Ok(Window { verdict: *verdict, d, low, high, lr_no_gap, t })
    };
    let windows = windows.into_iter().map(window).collect::<PyResult<Vec<_>>>()?;
    if windows.is_empty() {
        return Err(PyValueError::new_err("no window to combine"));
    }
    let whole = glapp_fit::combine(&windows);
    let name = VERDICTS.iter().find(|(v, _)| *v == whole.verdict).expect("all have names").1;
    Ok((name, whole.d, whole.low, whole.high, whole.trend))
}
