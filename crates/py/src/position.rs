//! Width with an interval from OP and the valve's own position.

use glapp_analysis::FitVerdict;
use glapp_fit::{AtValve, Recorder, SegmentAnswer, Verdict};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Name of a verdict in every interface.
pub(crate) fn name(verdict: Verdict) -> &'static str {
    FitVerdict::from(verdict).name()
}

/// Result of one record, times in seconds.
pub(crate) fn answered(py: Python<'_>, record: SegmentAnswer<AtValve>) -> PyResult<Bound<'_, PyDict>> {
    let SegmentAnswer { start, end, starts, h, answer } = record;
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
        ("information_ratio", answer.information_ratio),
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
    out.set_item("predicted", PyArray1::from_iter(py, shown.iter().map(|s| s.predicted)))?;
    out.set_item("position", PyArray1::from_iter(py, shown.iter().map(|s| s.valve)))?;
    Ok(out)
}
