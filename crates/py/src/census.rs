//! The census: counts over all rows of a recording.

use glapp_core::Census;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::columns::with_columns;

/// Counts over all rows of a recording, batch by batch.
#[pyclass(module = "glapp", name = "Census")]
pub struct PyCensus {
    gap: f64,
    census: Census,
}

#[pymethods]
impl PyCensus {
    #[new]
    fn new(gap: f64, op_limits: Option<(f64, f64)>) -> PyResult<Self> {
        let census = Census::new(gap, op_limits).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(Self { gap, census })
    }

    /// Counts some rows more.
    fn run<'py>(
        &mut self,
        py: Python<'py>,
        t: PyReadonlyArray1<'py, f64>,
        sp: PyReadonlyArray1<'py, f64>,
        pv: PyReadonlyArray1<'py, f64>,
        op: Option<PyReadonlyArray1<'py, f64>>,
        flags: Option<PyReadonlyArray1<'py, u8>>,
    ) -> PyResult<()> {
        with_columns(&t, &sp, &pv, op.as_ref(), flags.as_ref(), |columns| py.detach(|| self.census.run(columns)))
    }

    /// The counts under the names of `glapp.quality.Census`.
    fn counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let c = &self.census;
        let counts = PyDict::new(py);
        let row = |first: Option<u64>| first.map_or(-1, |row| row as i64);
        for (name, seen) in [("repeated", c.repeated), ("reversed", c.reversed)] {
            counts.set_item(name, seen.count)?;
            counts.set_item(format!("{name}_row"), row(seen.first))?;
        }
        counts.set_item("rows", c.rows)?;
        counts.set_item("t_bad", c.t_bad)?;
        counts.set_item("reversed_from", c.reversed_times.0)?;
        counts.set_item("reversed_to", c.reversed_times.1)?;
        counts.set_item("gap_threshold", self.gap)?;
        counts.set_item("gaps", c.gaps.count)?;
        counts.set_item("gap_row", row(c.gaps.first))?;
        counts.set_item("gap_longest", c.gap_longest)?;
        counts.set_item("gap_total", c.gap_total)?;
        for (name, values) in [("sp", c.sp), ("pv", c.pv), ("op", c.op)] {
            counts.set_item(format!("{name}_bad"), values.bad)?;
            counts.set_item(format!("{name}_bad_row"), row(values.bad_first))?;
            let (low, high) = if values.low <= values.high { (values.low, values.high) } else { (f64::NAN, f64::NAN) };
            counts.set_item(format!("{name}_min"), low)?;
            counts.set_item(format!("{name}_max"), high)?;
        }
        counts.set_item("not_auto", c.not_auto)?;
        counts.set_item("bad_quality", c.bad_quality)?;
        counts.set_item("at_low", c.at_low)?;
        counts.set_item("at_high", c.at_high)?;
        counts.set_item("sp_changes", c.sp.changed)?;
        counts.set_item("pv_unchanged", c.pv.unchanged)?;
        counts.set_item("op_unchanged", c.op.unchanged)?;
        counts.set_item("still", c.still)?;
        Ok(counts)
    }
}
