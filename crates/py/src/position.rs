//! Width with an interval from OP and the valve's own position.

use crate::fit::VERDICTS;
use glapp_fit::{Recorder, at_valve};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Fits a valve's position: `parts` of (position, OP) at even steps, one for each unbroken stretch; NaN in the position is a
/// row without it. None where there are fewer than 50 rows or OP never moves. `glapp.fit` is the door for people.
#[pyfunction]
pub fn fit_position<'py>(
    py: Python<'py>,
    parts: Vec<(PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>)>,
) -> PyResult<Option<Bound<'py, PyDict>>> {
    let parts: Vec<(&[f64], &[f64])> =
        parts.iter().map(|(z, u)| Ok((z.as_slice()?, u.as_slice()?))).collect::<PyResult<_>>()?;
    let Some(answer) = py.detach(|| at_valve(&parts)) else { return Ok(None) };
    let out = PyDict::new(py);
    out.set_item("verdict", VERDICTS.iter().find(|(v, _)| *v == answer.verdict).expect("all have names").1)?;
    for (name, value) in [
        ("d", answer.d),
        ("low", answer.low),
        ("jump", answer.jump),
        ("lr_no_gap", answer.lr_no_gap),
        ("lr_needed", answer.lr_needed),
        ("lr_no_jump", answer.lr_no_jump),
        ("trust", answer.trust),
        ("rise", answer.rise),
        ("gain", answer.gain),
        ("lag", answer.lag),
        ("sigma", answer.sigma),
        ("explained", answer.explained),
        ("range", answer.range),
    ] {
        out.set_item(name, value)?;
    }
    out.set_item("high", answer.high)?;
    out.set_item("delay", answer.delay)?;
    out.set_item("traversals", (answer.traversals[0], answer.traversals[1]))?;
    out.set_item("rows", answer.rows)?;
    out.set_item("spikes", answer.spikes)?;
    out.set_item("reason", answer.reason)?;
    let (recorder, step) = match answer.recorder {
        Recorder::Plain => ("plain", 0.0),
        Recorder::Rounded(step) => ("rounded", step),
        Recorder::Kept(band) => ("kept", band),
    };
    out.set_item("recorder", (recorder, step))?;
    let (d, rise): (Vec<f64>, Vec<f64>) = answer.profile.into_iter().unzip();
    out.set_item("profile", (PyArray1::from_vec(py, d), PyArray1::from_vec(py, rise)))?;
    let shown = &answer.shown;
    out.set_item("part", PyArray1::from_iter(py, shown.iter().map(|s| s.part)))?;
    out.set_item("step", PyArray1::from_iter(py, shown.iter().map(|s| s.row)))?;
    out.set_item("pv", PyArray1::from_iter(py, shown.iter().map(|s| s.recorded)))?;
    out.set_item("foreseen", PyArray1::from_iter(py, shown.iter().map(|s| s.foreseen)))?;
    out.set_item("position", PyArray1::from_iter(py, shown.iter().map(|s| s.valve)))?;
    Ok(Some(out))
}
