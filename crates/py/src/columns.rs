//! NumPy arrays as columns of a recording.

use glapp_analysis::Inspected;
use glapp_core::Columns;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A signal, one value a row.
pub type Signal<'py> = PyReadonlyArray1<'py, f64>;

/// Hands the arrays over without copying, once they are seen to be contiguous and of one length.
pub fn with_rows<T>(
    t: &Signal<'_>,
    sp: Option<&Signal<'_>>,
    pv: &Signal<'_>,
    op: Option<&Signal<'_>>,
    flags: Option<&PyReadonlyArray1<'_, u8>>,
    work: impl FnOnce(Inspected<'_>) -> T,
) -> PyResult<T> {
    let rows = Inspected {
        t: t.as_slice()?,
        sp: sp.map(|sp| sp.as_slice()).transpose()?,
        pv: pv.as_slice()?,
        op: op.map(|op| op.as_slice()).transpose()?,
        flags: flags.map(|flags| flags.as_slice()).transpose()?,
    };
    let optional = [rows.sp.map(<[f64]>::len), rows.op.map(<[f64]>::len), rows.flags.map(<[u8]>::len)];
    if rows.pv.len() != rows.t.len() || optional.into_iter().flatten().any(|length| length != rows.t.len()) {
        return Err(PyValueError::new_err("t, sp, pv, op and flags must be of the same length"));
    }
    Ok(work(rows))
}

/// The same of a recording that has a setpoint, as the core takes it.
pub fn with_columns<T>(
    t: &Signal<'_>,
    sp: &Signal<'_>,
    pv: &Signal<'_>,
    op: Option<&Signal<'_>>,
    flags: Option<&PyReadonlyArray1<'_, u8>>,
    work: impl FnOnce(Columns<'_, f64>) -> T,
) -> PyResult<T> {
    let sp_values = sp.as_slice()?;
    with_rows(t, Some(sp), pv, op, flags, |Inspected { t, pv, op, flags, .. }| {
        work(Columns { t, sp: sp_values, pv, op, flags })
    })
}
