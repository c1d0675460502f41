//! Findings on a recording: rows and counts in, findings out.

use glapp_analysis::quality::{Interval, Known, Law};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

use crate::columns::{Signal, rows_of};
use crate::data_statistics::Counts;
use crate::plain::plain;

/// `glapp.Identification`, the part that a recording is compared with.
#[derive(FromPyObject)]
pub struct Identification {
    usable: bool,
    r2: Option<f64>,
    k: Option<f64>,
    k_low: Option<f64>,
    k_high: Option<f64>,
    ti: Option<f64>,
    ti_low: Option<f64>,
    ti_high: Option<f64>,
    td: Option<f64>,
    td_low: Option<f64>,
    td_high: Option<f64>,
}

impl Identification {
    fn law(self) -> Law {
        let interval = |value, low, high| Interval { value, low, high };
        Law {
            usable: self.usable,
            r2: self.r2,
            k: interval(self.k, self.k_low, self.k_high),
            ti: interval(self.ti, self.ti_low, self.ti_high),
            td: interval(self.td, self.td_low, self.td_high),
        }
    }
}

/// Findings on a recording, without sentences.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "the arguments of Python")]
pub fn inspect<'py>(
    py: Python<'py>,
    t: Signal<'py>,
    sp: Option<Signal<'py>>,
    pv: Signal<'py>,
    op: Option<Signal<'py>>,
    flags: Option<PyReadonlyArray1<'py, u8>>,
    statistics: Counts,
    settings: (Option<f64>, Option<f64>, Option<f64>),
    identification: Option<Identification>,
    pv_span: Option<(f64, f64)>,
    op_span: Option<(f64, f64)>,
) -> PyResult<Bound<'py, PyAny>> {
    let (k, ti, td) = settings;
    let known = Known { k, ti, td, law: identification.map(Identification::law), kp: None, pv_span, op_span };
    let statistics = statistics.into();
    let rows = rows_of(&t, sp.as_ref(), &pv, op.as_ref(), flags.as_ref())?;
    let found = py.detach(|| glapp_analysis::quality::inspect(&rows, &statistics, &known));
    plain(py, &found)
}

/// Finding on the assumed unit of a time column.
#[pyfunction]
pub fn assumed_time<'py>(
    py: Python<'py>,
    column: &str,
    first: &str,
    step: Option<f64>,
    calendar: &str,
    sure: bool,
) -> PyResult<Bound<'py, PyAny>> {
    plain(py, &glapp_analysis::quality::assumed_time(column, first, step, calendar, sure))
}

/// Finding on signals with times of their own that were brought to common rows.
#[pyfunction]
pub fn own_times<'py>(py: Python<'py>, held: &str, pv_rows: u64, rows: u64) -> PyResult<Bound<'py, PyAny>> {
    plain(py, &glapp_analysis::quality::own_times(held, pv_rows, rows))
}

/// That the newest row came first, and the rows were taken from the last to the first.
#[pyfunction]
pub fn newest_first<'py>(py: Python<'py>, column: &str) -> PyResult<Bound<'py, PyAny>> {
    plain(py, &glapp_analysis::quality::newest_first(column))
}

/// That a setting is given which is not used.
#[pyfunction]
pub fn setting_unused<'py>(
    py: Python<'py>,
    setting: &str,
    value: &str,
    column: Option<&str>,
) -> PyResult<Bound<'py, PyAny>> {
    plain(py, &glapp_analysis::quality::setting_unused(setting, value, column))
}

/// Standard deviation of PV's fast noise. See `glapp.quality.noise_sigma`.
#[pyfunction]
pub fn noise_sigma(py: Python<'_>, pv: Signal<'_>) -> PyResult<Option<f64>> {
    let pv = pv.as_slice()?;
    Ok(py.detach(|| glapp_analysis::noise_sigma(pv)))
}

/// Unit of OP, as far as its settings and its values tell. See `glapp.Loop.op_label` and `glapp.recording.with_op_unit`.
#[pyfunction]
pub fn op_unit(stated: Option<&str>, span: Option<(f64, f64)>, op: Option<Signal<'_>>) -> PyResult<String> {
    let op = op.as_ref().map(|op| op.as_slice()).transpose()?;
    Ok(glapp_analysis::quality::op_unit(stated, span, op).to_owned())
}
