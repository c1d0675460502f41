//! The data statistics: counts over all rows of a recording.

use glapp_analysis::{DataStatistics, Occurrences, Values};
use pyo3::prelude::*;

/// `glapp.quality.DataStatistics`: the counts by name, a row that is none as −1, a range that is none as NaN.
#[derive(FromPyObject)]
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
    sp_marked: u64,
    pv_marked: u64,
    op_marked: u64,
    sp_marked_row: i64,
    pv_marked_row: i64,
    op_marked_row: i64,
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

impl From<Counts> for DataStatistics {
    fn from(c: Counts) -> Self {
        let row = |row: i64| u64::try_from(row).ok();
        let seen = |count, first| Occurrences { count, first: row(first) };
        let values = |(bad, bad_row), (marked, marked_row), low, high| {
            let marked = Occurrences { count: marked, first: row(marked_row) };
            Values { bad, bad_first: row(bad_row), marked, low, high, ..Values::default() }
        };
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
            sp: Values {
                changed: c.sp_changes,
                ..values((c.sp_bad, c.sp_bad_row), (c.sp_marked, c.sp_marked_row), c.sp_min, c.sp_max)
            },
            pv: Values {
                unchanged: c.pv_unchanged,
                ..values((c.pv_bad, c.pv_bad_row), (c.pv_marked, c.pv_marked_row), c.pv_min, c.pv_max)
            },
            op: Values {
                unchanged: c.op_unchanged,
                ..values((c.op_bad, c.op_bad_row), (c.op_marked, c.op_marked_row), c.op_min, c.op_max)
            },
            not_auto: c.not_auto,
            at_low: c.at_low,
            at_high: c.at_high,
            still: c.still,
        }
    }
}
