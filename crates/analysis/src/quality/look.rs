//! A recording with what several tests need of it, worked out once.

use std::ops::Range;

use glapp_core::DATA_GAP_STEPS;

use super::Known;
use crate::{DataStatistics, Inspected, SORTED_ROWS, frozen_steps, median, resolution};

pub(super) struct Look<'a> {
    pub rows: Inspected<'a>,
    pub statistics: &'a DataStatistics,
    pub known: &'a Known,
    /// SP − PV, or PV about its mean where SP is not recorded: whether it swings as a sinusoid is seen there as well.
    pub e: Vec<f64>,
    /// Ordinary step \[s\]; NaN where time never goes forward.
    pub h: f64,
    /// Rows in auto, good, off the limits, all numbers.
    pub good: Vec<bool>,
    /// Steps between such rows, without a gap.
    pub step: Vec<bool>,
    /// Steps in which nothing is recorded anew.
    pub frozen: Vec<bool>,
    /// Step of PV's grid and steps in its range.
    pub pv_grid: Option<(f64, u64)>,
    /// Step of OP's grid and steps in its range.
    pub op_grid: Option<(f64, u64)>,
}

impl<'a> Look<'a> {
    pub fn new(rows: &Inspected<'a>, statistics: &'a DataStatistics, known: &'a Known) -> Self {
        let rows = rows.even();
        let Inspected { t, sp, pv, op, flags } = rows;
        let e: Vec<f64> = if let Some(sp) = sp {
            sp.iter().zip(pv).map(|(sp, pv)| sp - pv).collect()
        } else {
            let numbers = pv.iter().filter(|pv| !pv.is_nan());
            let mean = numbers.clone().sum::<f64>() / numbers.count() as f64;
            pv.iter().map(|pv| mean - pv).collect()
        };
        let steps = t.windows(2).map(|pair| pair[1] - pair[0]);
        let mut forward: Vec<f64> = steps.clone().take(SORTED_ROWS).filter(|h| *h > 0.0).collect();
        let h = median(&mut forward);
        let good: Vec<bool> = (0..t.len())
            .map(|k| {
                e[k].is_finite() && op.is_none_or(|op| op[k].is_finite()) && flags.is_none_or(|flags| flags[k] == 0)
            })
            .collect();
        let step = steps
            .zip(good.windows(2))
            .map(|(dt, good)| good[0] && good[1] && dt > 0.0 && dt <= DATA_GAP_STEPS * h)
            .collect();
        let frozen = frozen_steps(sp, pv, op);
        let (pv_grid, op_grid) = (resolution(pv), op.and_then(resolution));
        Self { rows, statistics, known, e, h, good, step, frozen, pv_grid, op_grid }
    }

    /// Whether something is recorded anew in the step from row `k` to the next.
    pub fn live(&self, k: usize) -> bool {
        self.step[k] && !self.frozen[k]
    }

    /// Share of so many rows in all, 0 to 1.
    pub fn share(&self, count: u64) -> f64 {
        if self.statistics.rows > 0 { count as f64 / self.statistics.rows as f64 } else { 0.0 }
    }
}

/// Rows of the longest run of one wanted value, the first such run; empty where there is none.
pub(super) fn longest_run<T: PartialEq>(values: &[T], wanted: impl Fn(&T) -> bool) -> Range<usize> {
    let (mut longest, mut begin) = (0..0, 0);
    for run in values.chunk_by(|a, b| a == b) {
        if run.len() > longest.len() && wanted(&run[0]) {
            longest = begin..begin + run.len();
        }
        begin += run.len();
    }
    longest
}

/// Number of true marks.
pub(super) fn count(marks: impl IntoIterator<Item = bool>) -> usize {
    marks.into_iter().filter(|mark| *mark).count()
}

/// Distance from the smallest to the largest number; 0 where there is none.
pub(super) fn span(x: impl Iterator<Item = f64>) -> f64 {
    let (low, high) = x.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (x.min(low), x.max(high)));
    (high - low).max(0.0)
}
