//! P, I and D part of a controller with gains of 1, and how they move from mean to mean.

use super::filter::{Filter, Lag};
use super::rows::WholeRows;

/// Moves of P, I and D part.
pub(super) type Moves = [Vec<f64>; 3];

/// Running sums of P, I and D part: a move between two means takes three look-ups.
pub(super) type Sums = Vec<[f64; 3]>;

/// Signals that all lengths of the means and all laws share.
pub(super) struct SharedSignals<'a> {
    rows: &'a WholeRows,
    /// Usual step [s].
    pub h: f64,
    /// Rows by which OP is read later.
    pub lag: isize,
    /// The setpoint weight, where it is known.
    b: Option<f64>,
    /// Length of each step [s]; 0 where it may not be used.
    dt: Vec<f64>,
    /// Usable steps before each row.
    pub good: Vec<usize>,
    /// Running sums.
    pub op: Vec<f64>,
    pub setpoint: Vec<f64>,
    /// The setpoint weight is sought, and SP moves.
    pub sp_moves: bool,
    /// Largest |SP|.
    pub sp_size: f64,
    /// About the means of the parts, taken off before they are summed up so that few digits are lost.
    offset: [f64; 3],
}

impl<'a> SharedSignals<'a> {
    pub fn new(rows: &'a WholeRows, h: f64, b: Option<f64>, lag: isize) -> Self {
        let WholeRows { t, sp, op, step, .. } = rows;
        let n = t.len();
        let later = |k: usize| step.get(k.wrapping_add_signed(lag)).is_some_and(|step| *step);
        let step: Vec<bool> = (0..step.len()).map(|k| step[k] && later(k)).collect();
        // The state of the controller's filter at the first step after a break is unknown.
        let step: Vec<bool> = (0..step.len()).map(|k| k > 0 && step[k - 1] && step[k]).collect();
        let mut good = vec![0; n];
        for k in 1..n {
            good[k] = good[k - 1] + usize::from(step[k - 1]);
        }
        let read: Vec<f64> = (0..n).map(|k| op[(k as isize + lag).rem_euclid(n as isize) as usize]).collect();
        let dt = t.windows(2).zip(&rows.step).map(|(t, step)| if *step { t[1] - t[0] } else { 0.0 }).collect();
        let sp_moves = b.is_none() && super::rows::moves(sp, &step);
        let sp_size = sp.iter().fold(0.0, |most: f64, sp| most.max(sp.abs()));
        let (op, setpoint) = (sums(&read), sums(sp));
        let mut signals = Self { rows, h, lag, b, dt, good, op, setpoint, sp_moves, sp_size, offset: [0.0; 3] };
        let total = signals.parts(&Filter::none(true))[n];
        signals.offset = total.map(|total| total / n as f64);
        signals
    }

    /// PV before the last of the filter's lags and behind it, row by row.
    fn behind(&self, filter: &Filter) -> impl Iterator<Item = (f64, f64)> {
        let pv = &self.rows.pv;
        let lag = pv.first().map(|pv| Lag::new(*pv, filter.tf, self.h, filter.scans));
        let mut lags = [lag.filter(|_| filter.order > 0), lag.filter(|_| filter.order > 1)];
        pv.iter().map(move |&pv| {
            let (mut before, mut y) = (pv, pv);
            for lag in lags.iter_mut().flatten() {
                before = y;
                y = lag.update(y);
            }
            (before, y)
        })
    }

    /// The three parts behind a filter.
    pub fn parts(&self, filter: &Filter) -> Sums {
        let (WholeRows { sp, pv, .. }, h) = (self.rows, self.h);
        let first = pv.first().copied().unwrap_or(0.0);
        let mut smooth = (filter.tfd > 0.0).then(|| Lag::new(first, filter.tfd, h, filter.scans));
        let (mut last_y, mut last_e, mut area) = (first, 0.0, 0.0);
        let mut sum = [0.0; 3];
        let mut sums = Vec::with_capacity(pv.len() + 1);
        sums.push(sum);
        for (k, (before, y)) in self.behind(filter).enumerate() {
            let e = sp[k] - y;
            if k > 0 {
                area += if filter.scans { e } else { 0.5 * (e + last_e) } * self.dt[k - 1];
            }
            let slope = match &mut smooth {
                Some(smooth) if filter.scans => {
                    let last = smooth.y;
                    (smooth.update(y) - last) / h
                }
                Some(smooth) => (y - smooth.update(y)) / filter.tfd,
                None if filter.order > 0 && !filter.scans => (before - y) / filter.tf,
                None => (y - last_y) / h,
            };
            let proportional = self.b.map_or(-y, |b| b * sp[k] - y);
            for (sum, (part, offset)) in sum.iter_mut().zip([proportional, area, -slope].iter().zip(&self.offset)) {
                *sum += part - offset;
            }
            sums.push(sum);
            (last_y, last_e) = (y, e);
        }
        sums
    }

    /// Variance of the noise behind a filter that the second differences of PV allow.
    pub fn noise(&self, filter: &Filter) -> f64 {
        let y: Vec<f64> = self.behind(filter).map(|(_, y)| y).collect();
        let known = self.rows.step.windows(2).map(|step| step[0] && step[1]);
        let (mut squares, mut count) = (0.0, 0.0);
        for (y, _) in y.windows(3).zip(known).filter(|(_, known)| *known) {
            let second = (y[2] - y[1]) - (y[1] - y[0]);
            squares += second * second;
            count += 1.0;
        }
        if count > 0.0 { squares / count / 6.0 } else { 0.0 }
    }
}

/// Running sums of the deviations from the mean, so that few digits are lost.
fn sums(x: &[f64]) -> Vec<f64> {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    let mut sum = 0.0;
    let mut sums = vec![0.0];
    sums.extend(x.iter().map(|x| {
        sum += x - mean;
        sum
    }));
    sums
}

/// Stretches of 2m rows, and the moves in them from the mean of the first m to that of the others.
pub(super) struct Stretches {
    pub start: Vec<usize>,
    m: usize,
    pub op: Vec<f64>,
    pub setpoint: Vec<f64>,
}

impl Stretches {
    pub fn new(signals: &SharedSignals<'_>, start: Vec<usize>, m: usize) -> Self {
        let moves = |sums: &[f64]| -> Vec<f64> {
            start.iter().map(|&k| (sums[k + 2 * m] - 2.0 * sums[k + m] + sums[k]) / m as f64).collect()
        };
        let (op, mut setpoint) = (moves(&signals.op), moves(&signals.setpoint));
        // A move within the rounding of the sums is no move of SP.
        for move_ in &mut setpoint {
            if move_.abs() < 1e-9 * signals.sp_size {
                *move_ = 0.0;
            }
        }
        Self { start, m, op, setpoint }
    }

    /// Moves of the parts in these sums.
    pub fn moves(&self, sums: &[[f64; 3]]) -> Moves {
        let mut moves = [const { Vec::new() }; 3];
        for (j, moves) in moves.iter_mut().enumerate() {
            let m = self.m;
            let move_ = |&k: &usize| (sums[k + 2 * m][j] - 2.0 * sums[k + m][j] + sums[k][j]) / m as f64;
            moves.extend(self.start.iter().map(move_));
        }
        moves
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows a second apart, of a PV and a constant SP.
    fn rows(pv: Vec<f64>) -> WholeRows {
        let n = pv.len();
        WholeRows {
            t: (0..n).map(|k| k as f64).collect(),
            sp: vec![1.0; n],
            op: pv.clone(),
            pv,
            step: vec![true; n - 1],
        }
    }

    #[test]
    fn a_move_is_the_difference_of_two_means() {
        let op: Vec<f64> = (0..60).map(|k| f64::from((k * k * 31) % 17)).collect();
        let rows = rows(op.clone());
        for m in [1, 2, 5] {
            let signals = SharedSignals::new(&rows, 1.0, None, 0);
            let stretches = Stretches::new(&signals, vec![0, 3, 60 - 2 * m], m);
            let mean = |from: usize| op[from..from + m].iter().sum::<f64>() / m as f64;
            for (k, move_) in stretches.start.iter().zip(&stretches.op) {
                assert!((move_ - (mean(k + m) - mean(*k))).abs() < 1e-12);
            }
            assert!(stretches.setpoint.iter().all(|sp| *sp == 0.0));
        }
    }

    #[test]
    fn parts_of_a_ramp() {
        let rows = rows((0..200).map(|k| 2.0 * f64::from(k)).collect());
        let signals = SharedSignals::new(&rows, 1.0, None, 0);
        let lag = Filter { order: 1, tf: 3.0, ..Filter::none(false) };
        for filter in [Filter::none(true), Filter::none(false), lag, Filter { tfd: 3.0, ..Filter::none(false) }] {
            let moves = Stretches::new(&signals, vec![150], 1).moves(&signals.parts(&filter));
            assert!((moves[0][0] + 2.0).abs() < 1e-9, "P moves by minus PV's step");
            assert!(moves[2][0].abs() < 1e-9, "the slope is constant");
            let late = f64::from(filter.order) * filter.tf;
            let middle = if filter.scans { 151.0 } else { 150.5 };
            assert!((moves[1][0] - (1.0 - 2.0 * (middle - late))).abs() < 1e-9, "I moves by the error");
        }
        assert!(signals.noise(&Filter::none(true)) < 1e-20);
    }

    #[test]
    fn op_is_read_later_or_earlier_and_not_beyond_a_break() {
        let mut rows = rows((0..30).map(f64::from).collect());
        rows.step[10] = false;
        let steps = |lag| {
            let good = SharedSignals::new(&rows, 1.0, None, lag).good;
            (1..30).filter(|k| good[*k] == good[k - 1]).map(|k| k - 1).collect::<Vec<_>>()
        };
        assert_eq!(steps(0), [0, 10, 11]);
        assert_eq!(steps(1), [0, 9, 10, 11, 28]);
        assert_eq!(steps(-1), [0, 1, 10, 11, 12]);
        let late = SharedSignals::new(&rows, 1.0, None, 1);
        assert!((late.op[2] - late.op[1] - (late.op[1] - late.op[0]) - 1.0).abs() < 1e-12);
    }
}
