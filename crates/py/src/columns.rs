//! NumPy arrays as the core's columns.

use glapp_core::Columns;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Hands the arrays over without copying, once they are seen to be contiguous and of one length.
pub fn with_columns<T>(
    t: &PyReadonlyArray1<'_, f64>,
    sp: &PyReadonlyArray1<'_, f64>,
    pv: &PyReadonlyArray1<'_, f64>,
    op: Option<&PyReadonlyArray1<'_, f64>>,
    flags: Option<&PyReadonlyArray1<'_, u8>>,
    work: impl FnOnce(Columns<'_, f64>) -> T,
) -> PyResult<T> {
    let columns = Columns {
        t: t.as_slice()?,
        sp: sp.as_slice()?,
        pv: pv.as_slice()?,
        op: op.map(|op| op.as_slice()).transpose()?,
        flags: flags.map(|flags| flags.as_slice()).transpose()?,
    };
    let n = columns.t.len();
    let same =
        [Some(columns.sp.len()), Some(columns.pv.len()), columns.op.map(<[f64]>::len), columns.flags.map(<[u8]>::len)]
            .into_iter()
            .flatten()
            .all(|length| length == n);
    if !same {
        return Err(PyValueError::new_err("t, sp, pv, op and flags must be of the same length"));
    }
    Ok(work(columns))
}
