//! Width with an interval from OP and the valve's own position.

use crate::fit::{name, trend, unfit};
use crate::windows::{Batch, columns};
use glapp_fit::{AtValve, RecordAnswer, Recorder, Samples};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// Fits the valve positions of the batches that can be fitted, records of one valve. Where none can be, only why: `unfit`, a
/// word and its number. `glapp.fit` is the door for people.
#[pyfunction]
pub fn fit_position<'py>(py: Python<'py>, batches: Vec<Batch<'py>>) -> PyResult<Bound<'py, PyDict>> {
    let batches = columns(&batches)?;
    let none: Vec<Vec<f64>> = batches
        .iter()
        .map(|batch| if batch.position.is_none() { vec![f64::NAN; batch.samples.t.len()] } else { Vec::new() })
        .collect();
    // What is wrong with PV is nothing to the position.
    let samples: Vec<Samples> = batches
        .iter()
        .zip(&none)
        .map(|(batch, none)| Samples { pv: batch.position.unwrap_or(none), flags: None, ..batch.samples })
        .collect();
    let joint = match py.detach(|| glapp_fit::fit_position(&samples)) {
        Ok(joint) => joint,
        Err(why) => return unfit(py, why),
    };
    let out = PyDict::new(py);
    out.set_item("verdict", name(joint.verdict))?;
    out.set_item("d", joint.d)?;
    out.set_item("low", joint.low)?;
    out.set_item("high", joint.high)?;
    out.set_item("trend", trend(py, joint.trend)?)?;
    out.set_item("shown", joint.shown)?;
    let windows = PyList::empty(py);
    for record in joint.records {
        windows.append(answered(py, record)?)?;
    }
    out.set_item("windows", windows)?;
    Ok(out)
}

/// What one record says, times in seconds.
fn answered(py: Python<'_>, record: RecordAnswer<AtValve>) -> PyResult<Bound<'_, PyDict>> {
    let RecordAnswer { start, end, starts, h, answer } = record;
    let out = PyDict::new(py);
    out.set_item("verdict", name(answer.verdict))?;
    for (name, value) in [
        ("t_start", start),
        ("t_end", end),
        ("d", answer.d),
        ("low", answer.low),
        ("jump", answer.jump),
        ("lr_no_gap", answer.lr_no_gap),
        ("lr_needed", answer.lr_needed),
        ("lr_no_jump", answer.lr_no_jump),
        ("trust", answer.trust),
        ("rise", answer.rise),
        ("gain", answer.gain),
        ("lag", answer.lag * h),
        ("sigma", answer.sigma),
        ("explained", answer.explained),
        ("range", answer.range),
    ] {
        out.set_item(name, value)?;
    }
    out.set_item("high", answer.high)?;
    out.set_item("delay", answer.delay as f64 * h)?;
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
    out.set_item("t", PyArray1::from_iter(py, shown.iter().map(|s| starts[s.part] + h * s.row as f64)))?;
    out.set_item("pv", PyArray1::from_iter(py, shown.iter().map(|s| s.recorded)))?;
    out.set_item("foreseen", PyArray1::from_iter(py, shown.iter().map(|s| s.foreseen)))?;
    out.set_item("position", PyArray1::from_iter(py, shown.iter().map(|s| s.valve)))?;
    Ok(out)
}
