//! The rows that a law is sought in.

use crate::Inspected;
use crate::signals::{frozen_steps, median};

/// Most rows; of a longer recording the three stretches of largest OP travel are used.
const ROWS: usize = 24_000;

/// Signals without holes, and of every step to the next row whether it may be used.
pub(super) struct WholeRows {
    pub t: Vec<f64>,
    pub sp: Vec<f64>,
    pub pv: Vec<f64>,
    pub op: Vec<f64>,
    pub step: Vec<bool>,
}

/// Steps between samples that are in auto, good, off the limits and not too long for the law to be followed, and the usual
/// one [s]; 0 where there is none.
pub(super) fn usable_steps(rows: &Inspected, sp: &[f64], op: &[f64], limits: Option<(f64, f64)>) -> (Vec<bool>, f64) {
    let Inspected { t, pv, flags, .. } = rows;
    let usable = |k: usize| {
        [t[k], sp[k], pv[k], op[k]].iter().all(|x| x.is_finite())
            && flags.is_none_or(|flags| flags[k] == 0)
            && limits.is_none_or(|(low, high)| op[k] > low && op[k] < high)
    };
    let usable: Vec<bool> = (0..t.len()).map(usable).collect();
    let forward = |k: usize| usable[k] && usable[k + 1] && t[k + 1] - t[k] > 0.0;
    let mut step: Vec<bool> = (1..t.len()).map(|k| forward(k - 1)).collect();
    let mut dt: Vec<f64> = t.windows(2).zip(&step).filter(|(_, step)| **step).map(|(t, _)| t[1] - t[0]).collect();
    let h = if dt.is_empty() { 0.0 } else { median(&mut dt) };
    let frozen = frozen_steps(Some(sp), pv, Some(op));
    for (k, step) in step.iter_mut().enumerate() {
        *step &= t[k + 1] - t[k] <= 3.0 * h && !frozen[k];
    }
    (step, h)
}

/// Whether a signal changes in a step that may be used.
pub(super) fn moves(x: &[f64], step: &[bool]) -> bool {
    x.windows(2).zip(step).any(|(x, step)| *step && x[1] != x[0])
}

/// All rows, or the three stretches of a long recording in which OP moves most, with breaks between.
pub(super) fn liveliest(t: &[f64], sp: &[f64], pv: &[f64], op: &[f64], step: &[bool]) -> WholeRows {
    let stretches: Vec<usize> = if t.len() > ROWS { lively(op, step) } else { vec![0] };
    let size = if t.len() > ROWS { ROWS / 3 } else { t.len() };
    let taken = |x: &[f64]| stretches.iter().flat_map(|begin| &x[*begin..begin + size]).copied().collect::<Vec<f64>>();
    let mut kept = Vec::with_capacity(stretches.len() * size);
    for begin in &stretches {
        kept.extend_from_slice(&step[*begin..begin + size - 1]);
        kept.push(false);
    }
    kept.pop();
    WholeRows { t: taken(t), sp: held(taken(sp)), pv: held(taken(pv)), op: held(taken(op)), step: kept }
}

/// Starts of the three stretches of largest OP travel, in their order of time.
fn lively(op: &[f64], step: &[bool]) -> Vec<usize> {
    let size = ROWS / 3;
    let travel = |begin: usize| -> f64 {
        let rows = begin..begin + size - 1;
        rows.filter(|k| step[*k]).map(|k| (op[k + 1] - op[k]).abs()).sum()
    };
    let mut begins: Vec<(f64, usize)> =
        (0..=op.len() - size).step_by(size).map(|begin| (travel(begin), begin)).collect();
    begins.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut begins: Vec<usize> = begins.into_iter().take(3).map(|(_, begin)| begin).collect();
    begins.sort_unstable();
    begins
}

/// The column with missing numbers replaced by the last one before, or by the first one at the beginning.
fn held(mut x: Vec<f64>) -> Vec<f64> {
    let mut last = x.iter().copied().find(|x| x.is_finite()).unwrap_or(0.0);
    for x in &mut x {
        if x.is_finite() {
            last = *x;
        }
        *x = last;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_are_filled_with_what_was_before() {
        let (nan, inf) = (f64::NAN, f64::INFINITY);
        assert_eq!(held(vec![nan, 1.0, inf, 2.0, nan]), [1.0, 1.0, 1.0, 2.0, 2.0]);
        assert_eq!(held(vec![nan, inf]), [0.0, 0.0]);
    }

    #[test]
    fn of_a_long_recording_the_stretches_in_which_op_moves() {
        let n = 50_000;
        let t: Vec<f64> = (0..n).map(f64::from).collect();
        let lively = |k: i32| [1, 3, 4].contains(&(k / 8000));
        let op: Vec<f64> = (0..n).map(|k| if lively(k) { f64::from(k % 2) } else { 0.0 }).collect();
        let rows = liveliest(&t, &t, &t, &op, &[true; 49_999]);
        assert_eq!(rows.t.len(), 24_000);
        assert_eq!([rows.t[0], rows.t[8000], rows.t[16_000]], [8000.0, 24_000.0, 32_000.0]);
        assert_eq!(rows.step.len(), 23_999);
        let breaks: Vec<usize> = (0..rows.step.len()).filter(|k| !rows.step[*k]).collect();
        assert_eq!(breaks, [7999, 15_999]);
    }
}
