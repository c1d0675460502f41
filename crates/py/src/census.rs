//! The census: counts over all rows of a recording.

use glapp_analysis::{Census, Counter, Occurrences, Values};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

use crate::columns::with_rows;
use crate::refused;

/// Counts over all rows of a recording, batch by batch.
#[pyclass(module = "glapp", name = "Census")]
pub struct PyCensus(Counter);

#[pymethods]
impl PyCensus {
    #[new]
    fn new(gap: f64, op_limits: Option<(f64, f64)>) -> PyResult<Self> {
        Counter::new(gap, op_limits).map(Self).map_err(refused)
    }

    /// Counts some rows more.
    fn run<'py>(
        &mut self,
        py: Python<'py>,
        t: PyReadonlyArray1<'py, f64>,
        sp: Option<PyReadonlyArray1<'py, f64>>,
        pv: PyReadonlyArray1<'py, f64>,
        op: Option<PyReadonlyArray1<'py, f64>>,
        flags: Option<PyReadonlyArray1<'py, u8>>,
    ) -> PyResult<()> {
        with_rows(&t, sp.as_ref(), &pv, op.as_ref(), flags.as_ref(), |rows| py.detach(|| self.0.run(&rows)))
    }

    /// The counts under the names of `glapp.quality.Census`.
    fn counts(&self) -> Counts {
        self.0.census.into()
    }
}

/// `glapp.quality.Census`: the counts by name, a row that is none as −1, a range that is none as NaN.
#[derive(FromPyObject, IntoPyObject)]
pub struct Counts {
    rows: u64,
    t_bad: u64,
    repeated: u64,
    repeated_row: i64,
    reversed: u64,
    reversed_row: i64,
    reversed_from: f64,
    reversed_to: f64,
    gap_threshold: f64,
    gaps: u64,
    gap_row: i64,
    gap_longest: f64,
    gap_total: f64,
    sp_bad: u64,
    pv_bad: u64,
    op_bad: u64,
    sp_bad_row: i64,
    pv_bad_row: i64,
    op_bad_row: i64,
    not_auto: u64,
    bad_quality: u64,
    at_low: u64,
    at_high: u64,
    sp_changes: u64,
    pv_unchanged: u64,
    op_unchanged: u64,
    still: u64,
    sp_min: f64,
    sp_max: f64,
    pv_min: f64,
    pv_max: f64,
    op_min: f64,
    op_max: f64,
}

impl From<Census> for Counts {
    fn from(c: Census) -> Self {
        let row = |first: Option<u64>| first.map_or(-1, |row| row as i64);
        let range = |x: Values| if x.low <= x.high { (x.low, x.high) } else { (f64::NAN, f64::NAN) };
        let [(sp_min, sp_max), (pv_min, pv_max), (op_min, op_max)] = [c.sp, c.pv, c.op].map(range);
        Self {
            rows: c.rows,
            t_bad: c.t_bad,
            repeated: c.repeated.count,
            repeated_row: row(c.repeated.first),
            reversed: c.reversed.count,
            reversed_row: row(c.reversed.first),
            reversed_from: c.reversed_times.0,
            reversed_to: c.reversed_times.1,
            gap_threshold: c.gap,
            gaps: c.gaps.count,
            gap_row: row(c.gaps.first),
            gap_longest: c.gap_longest,
            gap_total: c.gap_total,
            sp_bad: c.sp.bad,
            pv_bad: c.pv.bad,
            op_bad: c.op.bad,
            sp_bad_row: row(c.sp.bad_first),
            pv_bad_row: row(c.pv.bad_first),
            op_bad_row: row(c.op.bad_first),
            not_auto: c.not_auto,
            bad_quality: c.bad_quality,
            at_low: c.at_low,
            at_high: c.at_high,
            sp_changes: c.sp.changed,
            pv_unchanged: c.pv.unchanged,
            op_unchanged: c.op.unchanged,
            still: c.still,
            sp_min,
            sp_max,
            pv_min,
            pv_max,
            op_min,
            op_max,
        }
    }
}

impl From<Counts> for Census {
    fn from(c: Counts) -> Self {
        let row = |row: i64| u64::try_from(row).ok();
        let seen = |count, first| Occurrences { count, first: row(first) };
        let values = |bad, first, low, high| Values { bad, bad_first: row(first), low, high, ..Values::default() };
        Self {
            gap: c.gap_threshold,
            rows: c.rows,
            t_bad: c.t_bad,
            repeated: seen(c.repeated, c.repeated_row),
            reversed: seen(c.reversed, c.reversed_row),
            reversed_times: (c.reversed_from, c.reversed_to),
            gaps: seen(c.gaps, c.gap_row),
            gap_longest: c.gap_longest,
            gap_total: c.gap_total,
            sp: Values { changed: c.sp_changes, ..values(c.sp_bad, c.sp_bad_row, c.sp_min, c.sp_max) },
            pv: Values { unchanged: c.pv_unchanged, ..values(c.pv_bad, c.pv_bad_row, c.pv_min, c.pv_max) },
            op: Values { unchanged: c.op_unchanged, ..values(c.op_bad, c.op_bad_row, c.op_min, c.op_max) },
            not_auto: c.not_auto,
            bad_quality: c.bad_quality,
            at_low: c.at_low,
            at_high: c.at_high,
            still: c.still,
        }
    }
}
