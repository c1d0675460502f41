//! Rows as they were recorded, and the even steps that are made of them.

use crate::data::segment::{Segment, Stretch};

/// Bits of a row's flags, as in `glapp.recording`: of bad quality, OP at its low and at its high limit.
pub(crate) const BAD: u8 = 2;
pub(crate) const AT_LIMIT: u8 = 4 | 8;

/// Steps without OP, or without any row, after which a new stretch begins.
const HOLE: f64 = 5.0;
/// Fewest rows with a later time than the one before, and fewest with an OP.
const FEWEST: usize = 50;
/// Fewest rows of a stretch.
pub(crate) const SHORTEST: usize = 20;
/// Fewest values that OP takes.
const LEVELS: usize = 6;

/// Rows of a recording, as they came: times may repeat, run backwards or be missing, values may be NaN.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    /// \[s\]
    pub t: &'a [f64],
    /// PV, or the valve's position; NaN where missing [its unit].
    pub pv: &'a [f64],
    /// Setpoint, NaN where missing [PV unit]; None where it was not recorded.
    pub sp: Option<&'a [f64]>,
    /// NaN where missing [OP unit]; None where it was not recorded.
    pub op: Option<&'a [f64]>,
    /// Sum of 2 where PV is bad, 4 and 8 where OP is at its low or high limit; None where all are 0.
    pub flags: Option<&'a [u8]>,
}

/// Why samples cannot be fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unfit {
    /// No OP.
    NoOp,
    /// Too few rows: this many.
    FewRows(usize),
    /// OP is missing in nearly all rows.
    OpMissing,
    /// OP stands still there [OP unit].
    OpStill(f64),
    /// OP and PV are the same signal.
    Same,
    /// PV stands still there [PV unit].
    PvStill(f64),
    /// OP takes only so many values.
    Coarse(usize),
    /// No 20 samples stand together without a hole.
    Broken,
    /// No record has 50 samples together in which OP moves.
    Few,
    /// The position is OP once more.
    Copy,
}

impl Unfit {
    /// The word for it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoOp => "no_op",
            Self::FewRows(_) => "few_rows",
            Self::OpMissing => "op_missing",
            Self::OpStill(_) => "op_still",
            Self::Same => "same",
            Self::PvStill(_) => "pv_still",
            Self::Coarse(_) => "coarse",
            Self::Broken => "broken",
            Self::Few => "few",
            Self::Copy => "copy",
        }
    }

    /// Number of the reason, 0 where it has none.
    pub const fn number(self) -> f64 {
        match self {
            Self::FewRows(n) | Self::Coarse(n) => n as f64,
            Self::OpStill(level) | Self::PvStill(level) => level,
            _ => 0.0,
        }
    }
}

impl Samples<'_> {
    /// Median time from a row to a later one [s]; None where fewer than 50 rows have a later one.
    pub(crate) fn step(&self) -> Option<f64> {
        let steps = self.t.windows(2).map(|w| w[1] - w[0]);
        let mut forward: Vec<f64> = steps.filter(|step| step.is_finite() && *step > 0.0).collect();
        if forward.len() < FEWEST {
            return None;
        }
        let middle = forward.len() / 2;
        let even = forward.len().is_multiple_of(2);
        let (below, upper, _) = forward.select_nth_unstable_by(middle, f64::total_cmp);
        let lower = below.iter().copied().fold(f64::MIN, f64::max);
        Some(if even { (lower + *upper) / 2.0 } else { *upper })
    }

    /// PV in a row, NaN where it is bad.
    fn pv(&self, row: usize) -> f64 {
        let bad = self.flags.is_some_and(|flags| flags[row] & BAD != 0);
        if bad { f64::NAN } else { self.pv[row] }
    }

    /// The samples at even steps, cut where time goes back and where rows or OP are missing for more than five steps. At each
    /// step stands the latest row; PV is missing where that is a step and a half old.
    ///
    /// # Errors
    ///
    /// Where there is nothing to fit.
    pub fn record(&self) -> Result<Segment<'static>, Unfit> {
        let op = self.op.ok_or(Unfit::NoOp)?;
        let h = self.step().ok_or(Unfit::FewRows(self.t.len()))?;
        if op.iter().filter(|u| u.is_finite()).count() < FEWEST {
            return Err(Unfit::OpMissing);
        }
        let finite = || op.iter().copied().filter(|u| u.is_finite());
        if let Some(level) = stands(finite()) {
            return Err(Unfit::OpStill(level));
        }
        let both =
            || op.iter().enumerate().map(|(k, u)| (*u, self.pv(k))).filter(|b| b.0.is_finite() && b.1.is_finite());
        if both().next().is_some() && both().all(|(u, y)| u == y) {
            return Err(Unfit::Same);
        }
        if let Some(level) = stands(both().map(|(_, y)| y)) {
            return Err(Unfit::PvStill(level));
        }
        let levels = few_levels(finite());
        if levels < LEVELS {
            return Err(Unfit::Coarse(levels));
        }
        let stretches = self.stretches(op, h);
        if stretches.is_empty() { Err(Unfit::Broken) } else { Ok(Segment { h, stretches }) }
    }

    fn stretches(&self, op: &[f64], h: f64) -> Vec<Stretch<'static>> {
        let known: Vec<usize> = (0..op.len()).filter(|k| op[*k].is_finite() && self.t[*k].is_finite()).collect();
        let unbroken = |a: &usize, b: &usize| {
            let gap = self.t[*b] - self.t[*a];
            gap >= 0.0 && gap <= HOLE * h
        };
        known.chunk_by(unbroken).filter(|rows| rows.len() >= SHORTEST).map(|rows| self.at_steps(rows, op, h)).collect()
    }

    /// Rows of rising time at even steps.
    fn at_steps(&self, rows: &[usize], op: &[f64], h: f64) -> Stretch<'static> {
        let (start, end) = (self.t[rows[0]], self.t[rows[rows.len() - 1]]);
        let steps = ((end - start) / h + 1.5) as usize;
        let (mut pv, mut u) = (Vec::with_capacity(steps), Vec::with_capacity(steps));
        let mut sp = Vec::with_capacity(if self.sp.is_some() { steps } else { 0 });
        let mut latest = 0;
        for step in 0..steps {
            let now = start + h * step as f64;
            while latest + 1 < rows.len() && self.t[rows[latest + 1]] <= now + 0.5 * h {
                latest += 1;
            }
            let row = rows[latest];
            pv.push(if now - self.t[row] < h { self.pv(row) } else { f64::NAN });
            u.push(op[row]);
            sp.extend(self.sp.map(|sp| sp[row]));
        }
        Stretch { start, sp: sp.into(), pv: pv.into(), op: u.into() }
    }
}

/// The value that all are, of one or more.
fn stands(mut values: impl Iterator<Item = f64>) -> Option<f64> {
    let first = values.next()?;
    values.all(|x| x == first).then_some(first)
}

/// Number of different values, counted up to [`LEVELS`].
fn few_levels(values: impl Iterator<Item = f64>) -> usize {
    let mut levels: Vec<f64> = Vec::with_capacity(LEVELS);
    for x in values {
        if !levels.contains(&x) {
            levels.push(x);
            if levels.len() == LEVELS {
                break;
            }
        }
    }
    levels.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 200;

    fn rows() -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let t: Vec<f64> = (0..N).map(|k| 0.5 * k as f64).collect();
        let of = |slow: f64| t.iter().map(|t| (t / slow).sin()).collect::<Vec<_>>();
        (t.clone(), of(3.0), of(5.0))
    }

    fn record(t: &[f64], pv: &[f64], op: &[f64]) -> Result<Segment<'static>, Unfit> {
        Samples { t, sp: None, pv, op: Some(op), flags: None }.record()
    }

    fn lengths(record: &Segment) -> Vec<usize> {
        record.stretches.iter().map(|s| s.pv.len()).collect()
    }

    #[test]
    fn rows_at_even_steps_are_what_they_were() {
        let (t, pv, op) = rows();
        let one = record(&t, &pv, &op).unwrap();
        assert_eq!((one.h, one.stretches.len(), one.stretches[0].start), (0.5, 1, 0.0));
        assert_eq!((&*one.stretches[0].pv, &*one.stretches[0].op), (&*pv, &*op));
    }

    #[test]
    fn a_hole_in_rows_or_in_op_and_a_step_back_end_a_stretch() {
        let (t, pv, op) = rows();
        let without = |rows: std::ops::Range<usize>| {
            let keep = |x: &[f64]| (0..N).filter(|k| !rows.contains(k)).map(|k| x[k]).collect::<Vec<_>>();
            record(&keep(&t), &keep(&pv), &keep(&op)).unwrap()
        };
        // Five steps are bridged: OP stands where it was, PV is missing.
        let bridged = without(60..64);
        assert_eq!(lengths(&bridged), [N]);
        let missing: Vec<usize> = (0..N).filter(|k| bridged.stretches[0].pv[*k].is_nan()).collect();
        assert_eq!(missing, [60, 61, 62, 63]);
        assert!(bridged.stretches[0].op[59..64].iter().all(|u| *u == op[59]));
        assert_eq!(lengths(&without(60..65)), [60, N - 65]);
        let mut gone = op.clone();
        gone[60..65].fill(f64::NAN);
        assert_eq!(lengths(&record(&t, &pv, &gone).unwrap()), [60, N - 65]);
        let mut back = t.clone();
        back[100..].iter_mut().for_each(|t| *t -= 7.0);
        assert_eq!(lengths(&record(&back, &pv, &op).unwrap()), [100, 100]);
        // A part shorter than 20 rows is left out.
        let mut torn = op.clone();
        torn[10..20].fill(f64::NAN);
        let torn = record(&t, &pv, &torn).unwrap();
        assert_eq!((lengths(&torn), torn.stretches[0].start), (vec![N - 20], 10.0));
    }

    #[test]
    fn bad_rows_and_rows_between_steps() {
        let (t, pv, op) = rows();
        let mut flags = vec![4; N];
        flags[30..40].fill(BAD);
        let bad = Samples { t: &t, sp: None, pv: &pv, op: Some(&op), flags: Some(&flags) }.record().unwrap();
        let missing: Vec<usize> = (0..N).filter(|k| bad.stretches[0].pv[*k].is_nan()).collect();
        assert_eq!(missing, (30..40).collect::<Vec<_>>());
        // A row a little early or late stands at its step.
        let jittered: Vec<f64> = t
            .iter()
            .enumerate()
            .map(|(k, t)| t + [0.1, 0.0, -0.1][k % 10 % 3] * f64::from(u8::from(k % 10 < 3)))
            .collect();
        let even = record(&jittered, &pv, &op).unwrap();
        assert_eq!(lengths(&even), [N]);
        assert!(even.stretches[0].pv.iter().zip(&pv).all(|(a, b)| a == b));
    }

    #[test]
    fn the_step_is_the_median_of_those_forward() {
        let step = |t: &[f64]| Samples { t, sp: None, pv: t, op: None, flags: None }.step();
        let mut t: Vec<f64> = (0..61).map(f64::from).collect();
        assert_eq!(step(&t), Some(1.0));
        t[60] = 62.5;
        // An even number of steps: the mean of the middle two.
        let halves: Vec<f64> = (0..61).map(|k| if k <= 30 { f64::from(k) } else { f64::from(2 * k) - 30.0 }).collect();
        assert_eq!((step(&t), step(&halves), step(&t[..50])), (Some(1.0), Some(1.5), None));
        t[10..].iter_mut().for_each(|t| *t = f64::NAN);
        assert_eq!(step(&t), None);
    }

    #[test]
    fn what_cannot_be_fitted_says_why() {
        let (t, pv, op) = rows();
        let why = |pv: &[f64], op: &[f64]| record(&t, pv, op).unwrap_err();
        assert_eq!(Samples { t: &t, sp: None, pv: &pv, op: None, flags: None }.record().unwrap_err(), Unfit::NoOp);
        assert_eq!(record(&t[..5], &pv[..5], &op[..5]).unwrap_err(), Unfit::FewRows(5));
        assert_eq!(why(&pv, &[f64::NAN; N]), Unfit::OpMissing);
        assert_eq!(why(&pv, &[40.0; N]), Unfit::OpStill(40.0));
        assert_eq!(why(&pv, &pv), Unfit::Same);
        assert_eq!(why(&[7.0; N], &op), Unfit::PvStill(7.0));
        let rounded: Vec<f64> = op.iter().map(|u| u.round()).collect();
        assert_eq!(why(&pv, &rounded), Unfit::Coarse(3));
        let torn: Vec<f64> = op.iter().enumerate().map(|(k, u)| if k % 20 < 8 { f64::NAN } else { *u }).collect();
        assert_eq!(why(&pv, &torn), Unfit::Broken);
    }
}
