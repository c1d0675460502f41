//! The controller's law, read out of a recording.

use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

use crate::columns::rows_of;
use crate::plain::plain;

/// Finds K, Ti and Td; `glapp.identify` is the public function, and has the sentences.
///
/// `reason` is None where the law may be used; `values` are there where a law was found, `settings` where it could be a
/// controller's.
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
) -> PyResult<Bound<'py, PyAny>> {
    let rows = rows_of(&t, sp.as_ref(), &pv, op.as_ref(), flags.as_ref())?;
    let found = py.detach(|| glapp_analysis::identify::identified(&rows, setpoint_weight, limits));
    plain(py, &found)
}
