//! Rows that are too far apart for the loop: it settles between two of them.

use crate::{Inspected, median};
use glapp_core::DATA_GAP_STEPS;
use glapp_core::status::{BAD, NOT_AUTO};

/// Fewer pairs of rows have no correlation.
const FEWEST: usize = 50;
/// Correlation of SP − PV with the same a row before, below which the loop forgets an error between two rows. Both are taken about 0: where
/// PV does not follow OP a controller with integral action leaves PV off SP, and the correlation is near 1.
const FORGETS: f64 = 0.4;
/// OP of a loop at rest stands still in more than this share of the rows.
const RESTS: f64 = 0.5;
/// The time between rows that Ti asks for, as a share of it.
const OF_TI: f64 = 1.0 / 5.0;
/// The time between rows that shows a fast loop, such as that of a flow, where Ti is not known \[s\].
const FAST: f64 = 1.0;

/// The time between rows with which the loop would show \[s\]; none where these rows are near enough, or tell nothing of it. `ti` is the
/// controller's \[s\], where it is known.
///
/// ```
/// use glapp_analysis::{Inspected, rows_to_ask_for};
/// let t: Vec<f64> = (0..200).map(|k| 60.0 * f64::from(k)).collect();
/// let pv: Vec<f64> = (0..200).map(|k| if k % 2 == 0 { 49.9 } else { 50.1 }).collect();
/// let op: Vec<f64> = (0..200).map(|k| 0.01 * f64::from(k)).collect();
/// let rows = Inspected { t: &t, sp: Some(&[50.0; 200]), pv: &pv, op: Some(&op), flags: None };
/// assert_eq!(rows_to_ask_for(&rows, None), Some(1.0));
/// assert_eq!(rows_to_ask_for(&rows, Some(20.0)), Some(4.0));
/// assert_eq!(rows_to_ask_for(&rows, Some(600.0)), None);
/// ```
pub fn rows_to_ask_for(rows: &Inspected<'_>, ti: Option<f64>) -> Option<f64> {
    let Inspected { t, sp, pv, op, flags } = rows.even();
    let (sp, op) = (sp?, op?);
    let mut forward: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).filter(|h| *h > 0.0).collect();
    let h = median(&mut forward);
    let enough = ti.map_or(FAST, |ti| OF_TI * ti);
    // Of a NaN nothing is asked.
    if !(h > enough && enough > 0.0) {
        return None;
    }
    let error = |k: usize| sp[k] - pv[k];
    let good = |k: usize| {
        let flags = flags.map_or(0, |flags| u16::from(flags[k]));
        flags & (NOT_AUTO | BAD) == 0 && error(k).is_finite() && op[k].is_finite()
    };
    let (mut pairs, mut still, mut square, mut product) = (0_usize, 0_usize, 0.0, 0.0);
    for k in 1..t.len() {
        if good(k - 1) && good(k) && t[k] - t[k - 1] <= DATA_GAP_STEPS * h {
            pairs += 1;
            still += usize::from(op[k] == op[k - 1]);
            square += 0.5 * (error(k - 1).powi(2) + error(k).powi(2));
            product += error(k - 1) * error(k);
        }
    }
    let rests = still as f64 > RESTS * pairs as f64;
    (pairs >= FEWEST && !rests && product < FORGETS * square).then_some(enough)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glapp_core::status::NOT_AUTO;

    /// Rows so far apart of a loop with a lag \[s\] under a PI controller with K = 0.4 and this Ti; PV has noise. Where `follows` is false
    /// its valve moves nothing.
    fn recorded(every: usize, lag: f64, ti: f64, follows: bool) -> [Vec<f64>; 4] {
        let (mut seed, mut x, mut load, mut integral, mut columns) = (1_u64, 0.0, 0.0, 0.0, [const { Vec::new() }; 4]);
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        };
        for k in 0..400 * every {
            load += 0.02 * random();
            let pv = x + load + 0.02 * random();
            integral -= 0.4 / ti * pv;
            let op = integral - 0.4 * pv;
            x += (if follows { op } else { 0.0 } - x) / lag;
            if k % every == 0 {
                for (column, value) in columns.iter_mut().zip([k as f64, 0.0, pv, op]) {
                    column.push(value);
                }
            }
        }
        columns
    }

    fn asked([t, sp, pv, op]: &[Vec<f64>; 4], ti: Option<f64>) -> Option<f64> {
        rows_to_ask_for(&Inspected { t, sp: Some(sp), pv, op: Some(op), flags: None }, ti)
    }

    #[test]
    fn a_fast_loop_with_a_row_a_minute_is_recorded_too_seldom() {
        let flow = recorded(60, 2.0, 3.0, true);
        assert_eq!([None, Some(3.0)].map(|ti| asked(&flow, ti)), [Some(1.0), Some(0.2 * 3.0)]);
    }

    #[test]
    fn neither_a_slow_loop_nor_near_rows_nor_a_loop_at_rest_is() {
        assert_eq!(asked(&recorded(60, 600.0, 600.0, true), None), None);
        assert_eq!(asked(&recorded(1, 2.0, 3.0, true), None), None);
        let mut rests = recorded(60, 2.0, 3.0, true);
        rests[3].fill(40.0);
        assert_eq!(asked(&rests, None), None);
    }

    #[test]
    fn nor_a_loop_whose_pv_does_not_follow_op() {
        for ti in [None, Some(3.0)] {
            assert_eq!(asked(&recorded(60, 2.0, 3.0, false), ti), None);
        }
    }

    #[test]
    fn rows_in_manual_do_not_count() {
        let [t, sp, pv, op] = recorded(60, 2.0, 3.0, true);
        let flags = vec![NOT_AUTO as u8; t.len()];
        let rows = Inspected { t: &t, sp: Some(&sp), pv: &pv, op: Some(&op), flags: Some(&flags) };
        assert_eq!(rows_to_ask_for(&rows, None), None);
    }
}
