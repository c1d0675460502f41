//! The controller's law, read out of a recording.

use glapp_analysis::identify::{Note, Reason};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::columns::with_rows;

/// Finds K, Ti and Td; `glapp.identify` is the door for people, and has the sentences.
///
/// `reason` is None where the law may be used; `k`, `ti` and `r2` are there where a law was found, the intervals and `note`
/// where it could be a controller's.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "the columns of a recording")]
pub fn identified<'py>(
    py: Python<'py>,
    t: PyReadonlyArray1<'py, f64>,
    sp: Option<PyReadonlyArray1<'py, f64>>,
    pv: PyReadonlyArray1<'py, f64>,
    op: Option<PyReadonlyArray1<'py, f64>>,
    flags: Option<PyReadonlyArray1<'py, u8>>,
    setpoint_weight: Option<f64>,
    limits: Option<(f64, f64)>,
) -> PyResult<Bound<'py, PyDict>> {
    let found = with_rows(&t, sp.as_ref(), &pv, op.as_ref(), flags.as_ref(), |rows| {
        py.detach(|| glapp_analysis::identify::identified(&rows, setpoint_weight, limits))
    })?;
    let out = PyDict::new(py);
    out.set_item("samples", found.samples)?;
    out.set_item("reason", found.reason.map(|reason| told(py, reason)).transpose()?)?;
    if let Some(values) = found.values {
        for (name, value) in [("k", values.k), ("ti", values.ti), ("r2", values.r2)] {
            out.set_item(name, value)?;
        }
    }
    if let Some(settings) = found.settings {
        for (name, interval) in [("k", settings.k_interval), ("ti", settings.ti_interval), ("td", settings.td_interval)]
        {
            out.set_item(format!("{name}_low"), interval.low)?;
            out.set_item(format!("{name}_high"), interval.high)?;
        }
        out.set_item("td", settings.td)?;
        out.set_item("setpoint_weight", settings.setpoint_weight)?;
        out.set_item("note", noted(py, settings.note)?)?;
    }
    Ok(out)
}

/// The name of a reason and its numbers.
fn told(py: Python<'_>, reason: Reason) -> PyResult<(&'static str, Bound<'_, PyDict>)> {
    let (name, numbers) = match reason {
        Reason::NoOp => ("no_op", vec![]),
        Reason::NoSp => ("no_sp", vec![]),
        Reason::FewSteps => ("few_steps", vec![]),
        Reason::OpStill => ("op_still", vec![]),
        Reason::PvStill => ("pv_still", vec![]),
        Reason::Unshown => ("unshown", vec![]),
        Reason::LittleExplained => ("little_explained", vec![]),
        Reason::NoGain { error } => ("no_gain", vec![("error", error)]),
        Reason::GainMayBeNone { size, k } => {
            ("gain_may_be_none", vec![("size", size), ("low", k.low), ("high", k.high)])
        }
        Reason::NoIntegral => ("no_integral", vec![]),
        Reason::OppositeSigns => ("opposite_signs", vec![]),
        Reason::Contradictory => ("contradictory", vec![]),
        Reason::Wide { k, ti, h } => {
            ("wide", vec![("k_low", k.low), ("k_high", k.high), ("ti_low", ti.low), ("ti_high", ti.high), ("h", h)])
        }
    };
    let out = PyDict::new(py);
    for (name, value) in numbers {
        out.set_item(name, value)?;
    }
    Ok((name, out))
}

fn noted(py: Python<'_>, note: Note) -> PyResult<Bound<'_, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("m", note.m)?;
    out.set_item("h", note.h)?;
    out.set_item("derivative", note.derivative)?;
    out.set_item("order", note.filter.order)?;
    out.set_item("tf", note.filter.tf)?;
    out.set_item("tfd", note.filter.tfd)?;
    out.set_item("lag", note.lag)?;
    out.set_item("weight", note.weight.map(|weight| (weight.fitted, weight.interval.low, weight.interval.high)))?;
    Ok(out)
}
