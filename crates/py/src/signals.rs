//! What a recorded signal is like.

use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

/// Step of a quantised signal and the number of steps in its range; None where it has no such grid.
#[pyfunction]
pub fn resolution(py: Python<'_>, x: PyReadonlyArray1<'_, f64>) -> PyResult<Option<(f64, u64)>> {
    let x = x.as_slice()?;
    Ok(py.detach(|| glapp_analysis::resolution(x)))
}
