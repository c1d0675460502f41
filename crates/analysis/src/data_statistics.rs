//! Counts over all rows of a recording, the evidence of its quality.

use glapp_core::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO, Status};
use glapp_core::{ParameterError, Real};

use crate::Inspected;

/// Counts and extremes of a recording. Rows count from 0.
///
/// A *pair* is a row and the one before it; for times, the one before it whose time is a number. Infinite counts as
/// "not a number" everywhere.
#[derive(Clone, Copy, Debug)]
pub struct DataStatistics {
    /// A step longer than this is a gap \[s\].
    pub gap: f64,
    /// Rows.
    pub rows: u64,
    /// Rows whose time is not a number.
    pub t_bad: u64,
    /// Pairs with the same time.
    pub repeated: Occurrences,
    /// Pairs whose later row has the earlier time.
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
    /// Rows not in automatic.
    pub not_auto: u64,
    /// Rows at the lower limit, by flag or by OP.
    pub at_low: u64,
    /// Rows at the upper limit, by flag or by OP.
    pub at_high: u64,
    /// Pairs in which SP, PV and OP are all the same while SP and PV differ.
    pub still: u64,
}

impl Default for DataStatistics {
    fn default() -> Self {
        Self {
            gap: f64::INFINITY,
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
            at_low: 0,
            at_high: 0,
            still: 0,
        }
    }
}

/// Count of an event, and the row of the first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Occurrences {
    /// Number of times.
    pub count: u64,
    /// Index of the first.
    pub first: Option<u64>,
}

impl Occurrences {
    /// Counts one occurrence at a row.
    fn note(&mut self, row: u64) {
        self.count += 1;
        self.first.get_or_insert(row);
    }
}

/// Counts and extremes of one signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Values {
    /// Rows that are not a number, those apart whose quality was said to be bad.
    pub bad: u64,
    /// Index of the first of them.
    pub bad_first: Option<u64>,
    /// Rows whose quality was said to be bad.
    pub marked: Occurrences,
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
        let (bad_first, marked) = (None, Occurrences::default());
        Self { bad: 0, bad_first, marked, unchanged: 0, changed: 0, low: f64::INFINITY, high: f64::NEG_INFINITY }
    }
}

impl Values {
    /// Counts a column whose first row is number `row` and follows `before`; `marked` tells in which of its rows the quality was
    /// said to be bad.
    fn take(&mut self, column: &[f64], before: Option<f64>, row: u64, marked: impl Fn(usize) -> bool) {
        let (mut bad, mut same, mut different) = (0, 0, 0);
        let (mut low, mut high) = (self.low, self.high);
        let mut previous = before.unwrap_or(f64::NAN);
        for &x in column {
            let good = x.magnitude() <= f64::LARGEST;
            bad += u64::from(!good);
            same += u64::from(good & (x == previous));
            different += u64::from(good & (x != previous) & (previous.magnitude() <= f64::LARGEST));
            low = if good & (x < low) { x } else { low };
            high = if good & (x > high) { x } else { high };
            previous = x;
        }
        if bad > 0 {
            self.without_number(column, row, marked);
        }
        (self.low, self.high) = (low, high);
        self.unchanged += same;
        self.changed += different;
    }

    /// Counts the rows that are no numbers, by what is known of them.
    #[cold]
    fn without_number(&mut self, column: &[f64], row: u64, marked: impl Fn(usize) -> bool) {
        for (k, _) in column.iter().enumerate().filter(|(_, x)| !x.is_number()) {
            if marked(k) {
                self.marked.note(row + k as u64);
            } else {
                self.bad += 1;
                self.bad_first.get_or_insert(row + k as u64);
            }
        }
    }
}

/// Bits of a row's marks: the signals whose quality was said to be bad there, and which are no numbers for that.
pub const MARKED_SP: u8 = 1;
/// PV, or the row as a whole.
pub const MARKED_PV: u8 = 2;
/// OP.
pub const MARKED_OP: u8 = 4;

/// Takes the [`DataStatistics`] of a recording, in one pass and constant memory.
///
/// ```
/// use glapp_analysis::{Counter, Inspected};
/// let mut counter = Counter::new(3.0, Some((0.0, 100.0)))?;
/// let (t, sp, pv, op) = ([0.0, 1.0, 1.0, 9.0], [5.0; 4], [4.0, f64::NAN, 4.0, 4.0], [99.0, 100.0, 100.0, 98.0]);
/// counter.run(&Inspected { t: &t, sp: Some(&sp), pv: &pv, op: Some(&op), flags: None });
/// let statistics = counter.statistics;
/// assert_eq!((statistics.rows, statistics.pv.bad, statistics.repeated.count, statistics.gaps.count, statistics.at_high), (4, 1, 1, 1, 2));
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Counter {
    /// Statistics so far.
    pub statistics: DataStatistics,
    op_limits: Option<(f64, f64)>,
    t_before: Option<f64>,
    before: Option<Before>,
}

/// The last row, as far as the next one is compared with it.
#[derive(Clone, Copy, Debug)]
struct Before {
    sp: f64,
    pv: f64,
    op: f64,
}

impl Counter {
    /// `gap` \[s\] > 0: a longer step is a gap. `op_limits` \[OP unit\], low < high, where they are known.
    pub fn new(gap: f64, op_limits: Option<(f64, f64)>) -> Result<Self, ParameterError> {
        let refused = |name, value, bound| Err(ParameterError { name, value, bound });
        if !(gap > 0.0 && gap.is_number()) {
            return refused("gap", gap, "greater than 0 s");
        }
        if let Some((low, _)) = op_limits.filter(|(low, high)| !(low < high && low.is_number())) {
            return refused("op_low", low, "below op_high");
        }
        Ok(Self {
            statistics: DataStatistics { gap, ..DataStatistics::default() },
            op_limits,
            t_before: None,
            before: None,
        })
    }

    /// Counts some rows more, whose marks are not known: a row that is flagged as bad and has all its numbers is one of bad quality.
    pub fn run(&mut self, rows: &Inspected<'_>) {
        self.run_marked(rows, None);
    }

    /// Counts some rows more, with the sum of each row's marks. Column by column, so that most of it is done for several rows at
    /// once.
    pub fn run_marked(&mut self, rows: &Inspected<'_>, marks: Option<&[u8]>) {
        let Inspected { t, sp, pv, op, flags } = rows.even();
        let n = t.len();
        self.times(t);
        let (row, before) = (self.statistics.rows, self.before);
        let marked = |signal: u8| move |k: usize| marks.is_some_and(|marks| marks[k] & signal != 0);
        if let Some(sp) = sp {
            self.statistics.sp.take(sp, before.map(|b| b.sp), row, marked(MARKED_SP));
        }
        self.statistics.pv.take(pv, before.map(|b| b.pv), row, marked(MARKED_PV));
        if let Some(op) = op {
            self.statistics.op.take(op, before.map(|b| b.op), row, marked(MARKED_OP));
        }
        self.flags(flags, op, n);
        for (k, _) in flags.unwrap_or_default().iter().enumerate().filter(|(_, flag)| u16::from(**flag) & BAD != 0) {
            if pv[k].is_number() && sp.is_none_or(|sp| sp[k].is_number()) {
                self.statistics.pv.marked.note(row + k as u64);
            }
        }
        // A missing SP counts as equal to PV.
        let sp = sp.unwrap_or(pv);
        let value = |k: usize| Before { sp: sp[k], pv: pv[k], op: op.map_or(0.0, |op| op[k]) };
        let mut previous = before;
        for k in 0..n {
            let now = value(k);
            let rests = previous.is_some_and(|b| (now.sp == b.sp) & (now.pv == b.pv) & (now.op == b.op));
            self.statistics.still += u64::from(rests & (now.sp != now.pv));
            previous = Some(now);
        }
        self.before = previous;
        self.statistics.rows += n as u64;
    }

    fn times(&mut self, column: &[f64]) {
        for (&t, row) in column.iter().zip(self.statistics.rows..) {
            let h = t - self.t_before.unwrap_or(f64::NAN);
            if !(h > 0.0 && h <= self.statistics.gap) {
                self.odd_step(t, h, row);
            }
            if t.is_number() {
                self.t_before = Some(t);
            }
        }
    }

    /// Counts a step whose length is not the usual one.
    #[cold]
    fn odd_step(&mut self, t: f64, h: f64, row: u64) {
        if !t.is_number() {
            self.statistics.t_bad += 1;
        } else if h > self.statistics.gap {
            self.statistics.gaps.note(row);
            self.statistics.gap_longest = self.statistics.gap_longest.max(h);
            self.statistics.gap_total += h;
        } else if h == 0.0 {
            self.statistics.repeated.note(row);
        } else if h < 0.0 {
            if self.statistics.reversed.count == 0 {
                self.statistics.reversed_times = (self.t_before.unwrap_or(f64::NAN), t);
            }
            self.statistics.reversed.note(row);
        }
    }

    /// Counts rows by their flags, and rows with OP at a limit.
    fn flags(&mut self, flags: Option<&[u8]>, op: Option<&[f64]>, n: usize) {
        let Some((least, most)) = self.op_limits.filter(|_| op.is_some()) else {
            for &flag in flags.unwrap_or_default() {
                self.flag(flag.into());
            }
            return;
        };
        for k in 0..n {
            let op = op.map_or(0.0, |op| op[k]);
            let flag = flags.map_or(0, |flags| flags[k].into());
            self.flag(flag | if op <= least { AT_LOW } else { 0 } | if op >= most { AT_HIGH } else { 0 });
        }
    }

    /// Counts the flags of one row.
    #[inline(always)]
    fn flag(&mut self, flag: Status) {
        if flag != 0 {
            self.statistics.not_auto += u64::from(flag & NOT_AUTO != 0);
            self.statistics.at_low += u64::from(flag & AT_LOW != 0);
            self.statistics.at_high += u64::from(flag & AT_HIGH != 0);
        }
    }
}
