//! The windows of a long history that tell most of the gap, chosen while it is read and in bounded memory.

use crate::data::samples::{AT_LIMIT, BAD, Samples};
use crate::data::segment::{COARSE_STEPS, travel};
use crate::search::decimation::window;

/// A recording with fewer rows is fitted as a whole; of a longer one windows are chosen.
pub const LONG_HISTORY: usize = 500_000;
/// Epochs of a history, of each of which the best window is kept; half as many or more once it is long.
pub const MOST_EPOCHS: usize = 12;
/// Rows, and a twelfth of a window's, without which what lies between two holes is passed over.
const LEAST_ROWS: usize = 200;

/// Rows of a history.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// Samples as the fit sees them.
    pub samples: Samples<'a>,
    /// Position of the valve, NaN where missing [its unit]; None where it was not recorded.
    pub position: Option<&'a [f64]>,
}

/// Cuts a history into windows and keeps the best one of each epoch.
///
/// An epoch is a number of windows in a row, one at first; before there would be more than [`MOST_EPOCHS`], neighbours are
/// merged. So the windows kept are spread over the whole length, whatever it is. The best is that in which OP turns most,
/// times the share of its rows that can be used: OP and PV are numbers, of good quality and not at a limit. In which mode the
/// controller was does not matter, since any move of OP tells.
#[derive(Clone, Debug)]
pub struct Windows {
    /// Rows of a window.
    length: usize,
    /// Time between two rows [s] after which a new window begins.
    hole: f64,
    per_epoch: usize,
    /// Windows so far.
    seen: usize,
    epochs: Vec<Option<(f64, Rows)>>,
    /// The window under way.
    rows: Rows,
}

impl Windows {
    /// Windows of `length` rows, > 0, that end where two rows lie further apart than `hole` [s], > 0.
    pub fn new(length: usize, hole: f64) -> Self {
        Self { length, hole, per_epoch: 1, seen: 0, epochs: Vec::with_capacity(MOST_EPOCHS), rows: Rows::default() }
    }

    /// Windows for a history of which so much is known, as long as one of a shorter recording would be; where nothing of the
    /// beginning can be fitted, a twelfth of it. `sign`: that of the process gain where it is known, else 0.
    pub fn of_history(beginning: &Samples, sign: f64) -> Self {
        let rows = beginning.t.len();
        let (steps, h) = match beginning.record() {
            Ok(record) => (window(&record, sign), Some(record.h)),
            Err(_) => (None, beginning.step()),
        };
        let length = steps.map_or(rows / MOST_EPOCHS, |steps| steps.min(rows / 2)).max(1);
        Self::new(length, h.map_or(f64::INFINITY, |h| 0.25 * length as f64 * h))
    }

    /// Takes the next rows of the history.
    pub fn add(&mut self, batch: &Batch) {
        let t = batch.samples.t;
        let mut first = 0;
        while first < t.len() {
            let hole = self.hole;
            let apart = |from: f64, to: f64| to - from > hole;
            if self.rows.t.last().is_some_and(|last| apart(*last, t[first])) {
                self.end();
            }
            let room = (self.length - self.rows.t.len()).min(t.len() - first);
            let unbroken = t[first..first + room].windows(2).take_while(|w| !apart(w[0], w[1]));
            let next = first + 1 + unbroken.count();
            self.rows.extend(batch, first..next);
            if self.rows.t.len() == self.length {
                self.end();
            }
            first = next;
        }
    }

    /// The best window of each epoch, in the order of time; those in which OP rests are left out. The window under way ends here.
    pub fn best(&mut self) -> impl Iterator<Item = &Rows> {
        self.scored().map(|(_, rows)| rows)
    }

    /// Windows with a score each, by which windows of several histories of one valve can be chosen: OP's travel in a
    /// coarse look times the share of rows that can be used [OP unit].
    pub fn scored(&mut self) -> impl Iterator<Item = &(f64, Rows)> {
        self.end();
        self.epochs.iter().flatten().filter(|(score, _)| *score > 0.0)
    }

    /// The window under way is whole, or will not become longer.
    fn end(&mut self) {
        let rows = std::mem::take(&mut self.rows);
        if rows.t.len() < self.length.min(LEAST_ROWS.max(self.length / 12)) {
            return;
        }
        if self.epochs.len() == MOST_EPOCHS && self.seen.is_multiple_of(self.per_epoch) {
            let score = |kept: &Option<(f64, Rows)>| kept.as_ref().map_or(-1.0, |(score, _)| *score);
            let mut pairs = std::mem::take(&mut self.epochs).into_iter();
            while let (Some(one), Some(other)) = (pairs.next(), pairs.next()) {
                self.epochs.push(if score(&other) > score(&one) { other } else { one });
            }
            self.per_epoch *= 2;
        }
        if self.seen.is_multiple_of(self.per_epoch) {
            self.epochs.push(None);
        }
        self.seen += 1;
        let score = rows.score();
        if let Some(epoch) = self.epochs.last_mut()
            && epoch.as_ref().is_none_or(|(best, _)| score > *best)
        {
            *epoch = Some((score, rows));
        }
    }
}

/// Rows that were kept, as in [`Batch`]; a signal that only some of the batches had is NaN, or no flag, in the others.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    /// \[s\]
    pub t: Vec<f64>,
    /// Setpoint [PV unit]
    pub sp: Option<Vec<f64>>,
    /// [PV unit]
    pub pv: Vec<f64>,
    /// [OP unit]
    pub op: Option<Vec<f64>>,
    /// See [`Samples`].
    pub flags: Option<Vec<u8>>,
    /// See [`Batch`].
    pub position: Option<Vec<f64>>,
}

impl Rows {
    /// The rows, lent.
    pub fn batch(&self) -> Batch<'_> {
        let Self { t, sp, pv, op, flags, position } = self;
        let samples = Samples { t, sp: sp.as_deref(), pv, op: op.as_deref(), flags: flags.as_deref() };
        Batch { samples, position: position.as_deref() }
    }

    fn extend(&mut self, batch: &Batch, rows: std::ops::Range<usize>) {
        let Batch { samples: Samples { t, sp, pv, op, flags }, position } = batch;
        let before = self.t.len();
        self.t.extend_from_slice(&t[rows.clone()]);
        self.pv.extend_from_slice(&pv[rows.clone()]);
        join(&mut self.sp, *sp, before, rows.clone(), f64::NAN);
        join(&mut self.op, *op, before, rows.clone(), f64::NAN);
        join(&mut self.flags, *flags, before, rows.clone(), 0);
        join(&mut self.position, *position, before, rows, f64::NAN);
    }

    /// Score of the window: an estimate of its information.
    fn score(&self) -> f64 {
        let Some(op) = &self.op else { return 0.0 };
        let good = |k: usize| self.flags.as_ref().is_none_or(|flags| flags[k] & (BAD | AT_LIMIT) == 0);
        let usable = (0..op.len()).filter(|k| op[*k].is_finite() && self.pv[*k].is_finite() && good(*k)).count();
        let finite = || op.iter().copied().filter(|u| u.is_finite());
        let every = (finite().count() / COARSE_STEPS).max(1);
        travel(finite(), every) * (usable as f64 / op.len() as f64)
    }
}

/// A column of `before` rows with more of them.
fn join<T: Copy>(
    column: &mut Option<Vec<T>>,
    more: Option<&[T]>,
    before: usize,
    rows: std::ops::Range<usize>,
    none: T,
) {
    if column.is_none() && more.is_some() {
        *column = Some(vec![none; before]);
    }
    if let Some(column) = column {
        match more {
            Some(more) => column.extend_from_slice(&more[rows]),
            None => column.resize(before + rows.len(), none),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The given number of rows, a second apart; OP turns by steps that a coarse look still sees, more at some times
    /// than at others.
    fn rows(n: usize) -> (Vec<f64>, Vec<f64>) {
        let t = (0..n).map(|k| k as f64).collect();
        let op = (0..n).map(|k| if k / 7 % 2 == 1 { 41.0 + (k / 1000 * 37 % 11) as f64 } else { 40.0 }).collect();
        (t, op)
    }

    fn batch<'a>(t: &'a [f64], op: Option<&'a [f64]>) -> Batch<'a> {
        Batch { samples: Samples { t, sp: None, pv: t, op, flags: None }, position: None }
    }

    fn fed(length: usize, hole: f64, t: &[f64], op: &[f64], at_once: usize) -> Windows {
        let mut windows = Windows::new(length, hole);
        for (t, op) in t.chunks(at_once).zip(op.chunks(at_once)) {
            windows.add(&batch(t, Some(op)));
        }
        windows
    }

    #[test]
    fn however_it_comes_in_the_same_windows_are_kept() {
        let (mut t, op) = rows(50_000);
        t[20_300..].iter_mut().for_each(|t| *t += 5000.0);
        t[40_000] = f64::NAN;
        let kept = |at_once: usize| {
            let mut windows = fed(900, 500.0, &t, &op, at_once);
            windows.best().map(|w| (w.t.clone(), w.op.clone())).collect::<Vec<_>>()
        };
        let whole = format!("{:?}", kept(50_000));
        for at_once in [65_536, 4096, 901, 900, 77, 1] {
            assert_eq!(format!("{:?}", kept(at_once)), whole, "{at_once} rows at once");
        }
    }

    #[test]
    fn memory_stays_what_it_was_however_long_the_history() {
        let held = |windows: &Windows| {
            let of = |rows: &Rows| rows.t.capacity() + rows.op.as_ref().map_or(0, Vec::capacity);
            windows.epochs.iter().flatten().map(|(_, rows)| of(rows)).sum::<usize>() + of(&windows.rows)
        };
        let (t, op) = rows(2_000_000);
        let mut windows = Windows::new(1000, f64::INFINITY);
        let mut most = [0; 2];
        for (i, (t, op)) in t.chunks(10_000).zip(op.chunks(10_000)).enumerate() {
            windows.add(&batch(t, Some(op)));
            assert!(windows.epochs.len() <= MOST_EPOCHS);
            most[usize::from(i >= 100)] = most[usize::from(i >= 100)].max(held(&windows));
        }
        assert!(most[1] <= most[0], "{most:?}");
        assert!(most[0] <= 2 * 2 * 1000 * (MOST_EPOCHS + 1), "{most:?}");
    }

    #[test]
    fn epochs_are_merged_and_keep_the_better_window() {
        let (t, op) = rows(24_000);
        let mut windows = fed(1000, f64::INFINITY, &t, &op, 24_000);
        let best: Vec<usize> = windows.best().map(|w| w.t[0] as usize / 1000).collect();
        // Windows 0 to 23, two an epoch.
        let better = |e: &usize| (2 * e..2 * e + 2).max_by_key(|w| (w * 37 % 11, std::cmp::Reverse(*w))).unwrap();
        assert_eq!(best, (0..12).collect::<Vec<_>>().iter().map(better).collect::<Vec<_>>());
    }

    #[test]
    fn a_hole_ends_a_window_a_short_rest_is_passed_over_and_a_missing_op_is_filled() {
        let (mut t, op) = rows(3650);
        t[2500..].iter_mut().for_each(|t| *t += 1e6);
        t[2650..].iter_mut().for_each(|t| *t += 1e6);
        let mut windows = fed(1000, 500.0, &t, &op, 64);
        let spans: Vec<(f64, f64)> = windows.best().map(|w| (w.t[0], w.t[w.t.len() - 1])).collect();
        assert_eq!(spans, [(0.0, 999.0), (1000.0, 1999.0), (2000.0, 2499.0), (t[2650], t[3649])]);
        let mut windows = Windows::new(1000, f64::INFINITY);
        windows.add(&batch(&t[..300], None));
        windows.add(&batch(&t[300..900], Some(&op[300..900])));
        windows.add(&batch(&t[900..1000], None));
        let rows = windows.best().next().unwrap();
        let kept = rows.op.as_ref().unwrap();
        assert!(kept[..300].iter().chain(&kept[900..]).all(|u| u.is_nan()) && kept[300..900] == op[300..900]);
        assert_eq!(kept.len(), 1000);
    }

    #[test]
    fn a_beginning_says_how_long_a_window_is() {
        let (t, _) = rows(2400);
        let op: Vec<f64> = t.iter().map(|t| (t / 9.0).sin()).collect();
        let still = Samples { t: &t, sp: None, pv: &t, op: Some(&[40.0; 2400]), flags: None };
        let windows = Windows::of_history(&still, 0.0);
        assert_eq!((windows.length, windows.hole), (200, 50.0));
        let without = Windows::of_history(&Samples { op: None, ..still }, 0.0);
        assert_eq!(without.length, 200);
        let moving = Windows::of_history(&Samples { op: Some(&op), ..still }, 0.0);
        // All of so short a record is one window, but half of what is known is the most.
        assert_eq!((moving.length, moving.hole), (1200, 300.0));
    }
}
