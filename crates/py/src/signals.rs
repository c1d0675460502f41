//! What a recorded signal is like.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Keeps of a mask only the runs of at least so many.
#[pyfunction]
pub fn in_runs<'py>(
    py: Python<'py>,
    mask: PyReadonlyArray1<'py, bool>,
    least: usize,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    Ok(PyArray1::from_vec(py, glapp_analysis::in_runs(mask.as_slice()?, least)))
}

/// Step of a quantised signal and the number of steps in its range; None where it has no such grid.
#[pyfunction]
pub fn resolution(py: Python<'_>, x: PyReadonlyArray1<'_, f64>) -> PyResult<Option<(f64, u64)>> {
    let x = x.as_slice()?;
    Ok(py.detach(|| glapp_analysis::resolution(x)))
}

/// Marks long stretches in which no signal changes a bit though the error is not zero, with the step that ends each.
#[pyfunction]
pub fn frozen_steps<'py>(
    py: Python<'py>,
    sp: Option<PyReadonlyArray1<'py, f64>>,
    pv: PyReadonlyArray1<'py, f64>,
    op: Option<PyReadonlyArray1<'py, f64>>,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let sp = sp.as_ref().map(|sp| sp.as_slice()).transpose()?;
    let op = op.as_ref().map(|op| op.as_slice()).transpose()?;
    let pv = pv.as_slice()?;
    if [sp, op].into_iter().flatten().any(|x| x.len() != pv.len()) {
        return Err(PyValueError::new_err("sp, pv and op must be of the same length"));
    }
    Ok(PyArray1::from_vec(py, py.detach(|| glapp_analysis::frozen_steps(sp, pv, op))))
}
