//! NumPy arrays as columns of a recording.

use glapp_analysis::Inspected;
use glapp_core::Columns;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A signal, one value a row.
pub type Signal<'py> = PyReadonlyArray1<'py, f64>;

/// The arrays without copying, once they are seen to be contiguous and of one length.
pub fn rows_of<'a>(
    t: &'a Signal<'_>,
    sp: Option<&'a Signal<'_>>,
    pv: &'a Signal<'_>,
    op: Option<&'a Signal<'_>>,
    flags: Option<&'a PyReadonlyArray1<'_, u8>>,
) -> PyResult<Inspected<'a>> {
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
    Ok(rows)
}

/// The columns of a recording that has a setpoint, as the core takes them.
pub fn columns_of<'a>(
    t: &'a Signal<'_>,
    sp: &'a Signal<'_>,
    pv: &'a Signal<'_>,
    op: Option<&'a Signal<'_>>,
    flags: Option<&'a PyReadonlyArray1<'_, u8>>,
) -> PyResult<Columns<'a, f64>> {
    let Inspected { t, pv, op, flags, .. } = rows_of(t, Some(sp), pv, op, flags)?;
    Ok(Columns { t, sp: sp.as_slice()?, pv, op, flags })
}
