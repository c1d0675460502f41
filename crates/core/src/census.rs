//! Counts over all samples of a recording, the evidence of its quality.

use crate::half_period::{AT_HIGH, AT_LOW, BAD, NOT_AUTO};
use crate::{Columns, ParameterError, error::require};

/// Counts what a recording holds, in one pass and constant memory. Indices count samples from 0.
///
/// A *pair* is a sample and the one before it. Samples whose time is not a number take part in no pair. Infinite counts
/// as "not a number" everywhere.
///
/// ```
/// use glapp_core::{Census, Columns};
/// let mut census = Census::new(3.0, Some((0.0, 100.0)))?;
/// let (t, sp, pv, op) = ([0.0, 1.0, 1.0, 9.0], [5.0; 4], [4.0, f64::NAN, 4.0, 4.0], [99.0, 100.0, 100.0, 98.0]);
/// census.run(Columns { t: &t, sp: &sp, pv: &pv, op: Some(&op), flags: None });
/// assert_eq!((census.rows, census.pv.bad, census.repeated.count, census.gaps.count, census.at_high), (4, 1, 1, 1, 2));
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Census {
    gap: f64,
    op_limits: Option<(f64, f64)>,
    before: Option<Before>,
    /// Samples.
    pub rows: u64,
    /// Samples whose time is not a number.
    pub t_bad: u64,
    /// Pairs with the same time.
    pub repeated: Occurrences,
    /// Pairs whose later sample has the earlier time.
    pub reversed: Occurrences,
    /// The two times of the first reversed pair \[s\].
    pub reversed_times: (f64, f64),
    /// Steps longer than the gap threshold.
    pub gaps: Occurrences,
    /// The longest gap \[s\].
    pub gap_longest: f64,
    /// All gaps together \[s\].
    pub gap_total: f64,
    /// Setpoint.
    pub sp: Values,
    /// Process value.
    pub pv: Values,
    /// Controller output.
    pub op: Values,
    /// Samples not in automatic.
    pub not_auto: u64,
    /// Samples of bad quality.
    pub bad_quality: u64,
    /// Samples at the lower limit, by flag or by OP.
    pub at_low: u64,
    /// Samples at the upper limit, by flag or by OP.
    pub at_high: u64,
    /// Pairs in which SP, PV and OP are all the same while SP and PV differ.
    pub still: u64,
}

/// How often something was met, and where first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Occurrences {
    /// How often.
    pub count: u64,
    /// Index of the first.
    pub first: Option<u64>,
}

impl Occurrences {
    fn note(&mut self, row: u64) {
        self.count += 1;
        self.first.get_or_insert(row);
    }
}

/// What one signal holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Values {
    /// Samples that are not a number.
    pub bad: u64,
    /// Index of the first of them.
    pub bad_first: Option<u64>,
    /// Pairs of numbers that are the same.
    pub unchanged: u64,
    /// Pairs of numbers that differ.
    pub changed: u64,
    /// Smallest number; infinity where there is none.
    pub low: f64,
    /// Largest number; minus infinity where there is none.
    pub high: f64,
}

impl Default for Values {
    fn default() -> Self {
        Self { bad: 0, bad_first: None, unchanged: 0, changed: 0, low: f64::INFINITY, high: f64::NEG_INFINITY }
    }
}

impl Values {
    #[inline(always)]
    fn note(&mut self, x: f64, before: Option<f64>, row: u64) {
        if !x.is_finite() {
            self.bad += 1;
            self.bad_first.get_or_insert(row);
            return;
        }
        self.low = self.low.min(x);
        self.high = self.high.max(x);
        if let Some(before) = before {
            let same = x == before;
            self.unchanged += u64::from(same);
            self.changed += u64::from(!same && before.is_finite());
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Before {
    t: f64,
    sp: f64,
    pv: f64,
    op: f64,
}

impl Census {
    /// `gap` \[s\] > 0: a longer step is a gap. `op_limits` \[OP unit\], low < high, where they are known.
    pub fn new(gap: f64, op_limits: Option<(f64, f64)>) -> Result<Self, ParameterError> {
        require("gap", gap, gap > 0.0, "greater than 0 s")?;
        if let Some((low, high)) = op_limits {
            require("op_low", low, low < high, "below op_high")?;
        }
        Ok(Self {
            gap,
            op_limits,
            before: None,
            rows: 0,
            t_bad: 0,
            repeated: Occurrences::default(),
            reversed: Occurrences::default(),
            reversed_times: (f64::NAN, f64::NAN),
            gaps: Occurrences::default(),
            gap_longest: 0.0,
            gap_total: 0.0,
            sp: Values::default(),
            pv: Values::default(),
            op: Values::default(),
            not_auto: 0,
            bad_quality: 0,
            at_low: 0,
            at_high: 0,
            still: 0,
        })
    }

    /// Counts some samples more.
    pub fn run(&mut self, columns: Columns<'_, f64>) {
        for k in 0..columns.len() {
            let flags = columns.flags.map_or(0, |flags| flags[k]);
            self.take(columns.t[k], columns.sp[k], columns.pv[k], columns.op.map(|op| op[k]), flags);
        }
    }

    #[inline(always)]
    fn take(&mut self, t: f64, sp: f64, pv: f64, op: Option<f64>, flags: u8) {
        let row = self.rows;
        self.rows += 1;
        let before = self.before;
        if !t.is_finite() {
            self.t_bad += 1;
        } else if let Some(b) = before {
            let h = t - b.t;
            if h > self.gap {
                self.gaps.note(row);
                self.gap_longest = self.gap_longest.max(h);
                self.gap_total += h;
            } else if h == 0.0 {
                self.repeated.note(row);
            } else if h < 0.0 {
                if self.reversed.count == 0 {
                    self.reversed_times = (b.t, t);
                }
                self.reversed.note(row);
            }
        }
        self.sp.note(sp, before.map(|b| b.sp), row);
        self.pv.note(pv, before.map(|b| b.pv), row);
        let mut low = flags & AT_LOW != 0;
        let mut high = flags & AT_HIGH != 0;
        if let Some(op) = op {
            self.op.note(op, before.map(|b| b.op), row);
            if let Some((least, most)) = self.op_limits {
                low |= op <= least;
                high |= op >= most;
            }
        }
        self.at_low += u64::from(low);
        self.at_high += u64::from(high);
        self.not_auto += u64::from(flags & NOT_AUTO != 0);
        self.bad_quality += u64::from(flags & BAD != 0);
        let op = op.unwrap_or(0.0);
        if let Some(b) = before {
            self.still += u64::from(sp == b.sp && pv == b.pv && op == b.op && sp != pv);
        }
        if t.is_finite() {
            self.before = Some(Before { t, sp, pv, op });
        }
    }
}
