//! Performance of a loop over a stretch of time: distance of PV from SP, travel of OP, number of turns.
//!
//! The rows in automatic are cut into [`BLOCKS`] blocks of the same number of rows. Each block gives a mean square of PV − SP,
//! the travel of OP and its reversals; their mean over the blocks is the answer, and their scatter its 95 % interval, by
//! Student's distribution. Blocks next to each other are taken as independent: where the load changes more slowly than a block
//! lasts, the interval is too narrow.

use crate::Inspected;
use glapp_core::status::{BAD, NOT_AUTO};
use serde::Serialize;

/// Blocks of a stretch.
const BLOCKS: usize = 16;
/// 97.5 % point of Student's distribution with one degree of freedom less than there are blocks.
const STUDENT: f64 = 2.131;
/// Rows that a block must have.
const FEWEST: usize = 20;
/// \[s\].
const DAY: f64 = 86_400.0;
/// A step of time so many times longer than usual is a gap: what OP did in it is not known.
const BREAK_STEPS: f64 = 10.0;

/// A number with its 95 % interval.
pub type Between = (f64, f64, f64);

/// Performance of a loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Performance {
    /// Time that was looked at \[s\].
    pub seconds: f64,
    /// Standard deviation of PV about SP, or where that is not recorded about its mean in each block [PV unit].
    pub deviation: Between,
    /// Travel of OP in a day [OP unit]; none where OP is not recorded.
    pub travel: Option<Between>,
    /// Reversals of OP in a day.
    pub reversals: Option<Between>,
}

/// Performance of one block.
#[derive(Clone, Copy, Default)]
struct Block {
    square: f64,
    rows: f64,
    seconds: f64,
    travel: f64,
    turns: f64,
}

/// Performance of a loop in these rows. OP has turned where it has gone back by more than `turn` [OP unit]; none where
/// too few rows are in automatic.
///
/// ```
/// use glapp_analysis::{Inspected, performance};
/// let t: Vec<f64> = (0..3200).map(f64::from).collect();
/// let (sp, pv) = (vec![50.0; 3200], t.iter().map(|t| 50.0 + if t % 2.0 == 0.0 { 1.0 } else { -1.0 }).collect::<Vec<_>>());
/// let op: Vec<f64> = t.iter().map(|t| (t / 50.0 % 2.0 - 1.0).abs()).collect();
/// let found = performance(&Inspected { t: &t, sp: Some(&sp), pv: &pv, op: Some(&op), flags: None }, 0.1).unwrap();
/// assert!((found.deviation.0 - 1.0).abs() < 1e-12);
/// assert!((found.travel.unwrap().0 - 86_400.0 / 50.0).abs() < 1.0);
/// ```
pub fn performance(rows: &Inspected<'_>, turn: f64) -> Option<Performance> {
    let Inspected { t, sp, pv, op, flags } = *rows;
    let usable = |k: &usize| {
        let flags = flags.map_or(0, |flags| u16::from(flags[*k]));
        flags & (NOT_AUTO | BAD) == 0 && pv[*k].is_finite() && sp.is_none_or(|sp| sp[*k].is_finite())
    };
    let good: Vec<usize> = (0..t.len()).filter(usable).collect();
    if good.len() < BLOCKS * FEWEST {
        return None;
    }
    let mut steps: Vec<f64> = good.windows(2).map(|pair| t[pair[1]] - t[pair[0]]).collect();
    let longest = BREAK_STEPS * crate::median(&mut steps);
    let mut turning = Turning::new(turn);
    let mut blocks = Vec::with_capacity(BLOCKS);
    // Kept from block to block: OP's travel between two blocks counts in the later one.
    let mut last: Option<usize> = None;
    for i in 0..BLOCKS {
        let part = &good[i * good.len() / BLOCKS..(i + 1) * good.len() / BLOCKS];
        let mean = part.iter().map(|k| pv[*k]).sum::<f64>() / part.len() as f64;
        let mut block = Block { rows: part.len() as f64, ..Block::default() };
        for k in part.iter().copied() {
            block.square += (pv[k] - sp.map_or(mean, |sp| sp[k])).powi(2);
            let before = last.filter(|before| (0.0..=longest).contains(&(t[k] - t[*before])));
            block.seconds += before.map_or(0.0, |before| t[k] - t[before]);
            if let Some(op) = op.filter(|op| op[k].is_finite()) {
                let moved = before.map_or(0.0, |before| op[k] - op[before]);
                block.travel += if moved.is_finite() { moved.abs() } else { 0.0 };
                block.turns += f64::from(u8::from(turning.take(op[k], before.is_some())));
            }
            last = Some(k);
        }
        blocks.push(block);
    }
    if blocks.iter().any(|block| block.seconds <= 0.0) {
        return None;
    }
    let squares = over(&blocks, |block| block.square / block.rows);
    let a_day = |value: fn(&Block) -> f64| op.map(|_| over(&blocks, |block| DAY * value(block) / block.seconds));
    Some(Performance {
        seconds: blocks.iter().map(|block| block.seconds).sum(),
        deviation: (squares.0.sqrt(), squares.1.sqrt(), squares.2.sqrt()),
        travel: a_day(|block| block.travel),
        reversals: a_day(|block| block.turns),
    })
}

/// Mean over the blocks with its 95 % interval, nothing of it below 0.
fn over(blocks: &[Block], value: impl Fn(&Block) -> f64) -> Between {
    let values: Vec<f64> = blocks.iter().map(value).collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let scatter = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let half = STUDENT * (scatter / n).sqrt();
    (mean, (mean - half).max(0.0), mean + half)
}

/// Reversals of a signal that may tremble by so much.
struct Turning {
    band: f64,
    extreme: f64,
    /// Direction of travel; 0 before the first move.
    way: f64,
}

impl Turning {
    fn new(band: f64) -> Self {
        Self { band, extreme: f64::NAN, way: 0.0 }
    }

    /// Takes a value; whether the signal has turned with it. After a gap it begins anew.
    fn take(&mut self, x: f64, goes_on: bool) -> bool {
        if !goes_on || !self.extreme.is_finite() {
            (self.extreme, self.way) = (x, 0.0);
            return false;
        }
        let back = x - self.extreme;
        if self.way == 0.0 {
            if back.abs() > self.band {
                (self.extreme, self.way) = (x, back.signum());
            }
            return false;
        }
        if back * self.way > 0.0 {
            self.extreme = x;
            return false;
        }
        let turned = back.abs() > self.band;
        if turned {
            (self.extreme, self.way) = (x, -self.way);
        }
        turned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(period: f64, rows: usize) -> Vec<f64> {
        (0..rows).map(|k| 2.0 * ((k as f64 / period).fract() - 0.5).abs()).collect()
    }

    #[test]
    fn reversals_and_travel_are_those_of_the_signal_and_trembling_is_none() {
        let t: Vec<f64> = (0..6400).map(|k| k as f64).collect();
        let op: Vec<f64> = triangle(100.0, 6400).iter().enumerate().map(|(k, x)| x + 0.03 * (k % 2) as f64).collect();
        let pv = vec![1.0; 6400];
        let rows = Inspected { t: &t, sp: None, pv: &pv, op: Some(&op), flags: None };
        let found = performance(&rows, 0.05).unwrap();
        let (turns, low, high) = found.reversals.unwrap();
        assert!((turns - DAY / 50.0).abs() < 0.03 * DAY / 50.0, "{turns}");
        assert!(low < DAY / 50.0 && DAY / 50.0 < high);
        assert!(performance(&rows, 0.001).unwrap().reversals.unwrap().0 > 10.0 * turns);
        assert_eq!(found.deviation.0, 0.0);
    }

    #[test]
    fn rows_in_manual_and_gaps_do_not_count() {
        let t: Vec<f64> = (0..6400).map(|k| if k < 3200 { k as f64 } else { 100_000.0 + k as f64 }).collect();
        let op: Vec<f64> = (0..6400).map(|k| if k < 3200 { 0.0 } else { 1000.0 }).collect();
        let pv: Vec<f64> = (0..6400).map(|k| if k % 4 == 0 { 100.0 } else { 1.0 }).collect();
        let sp = vec![1.0; 6400];
        let flags: Vec<u8> = (0..6400).map(|k| u8::from(k % 4 == 0)).collect();
        let rows = Inspected { t: &t, sp: Some(&sp), pv: &pv, op: Some(&op), flags: Some(&flags) };
        let found = performance(&rows, 1.0).unwrap();
        assert_eq!(found.deviation, (0.0, 0.0, 0.0));
        assert_eq!(found.travel.unwrap().0, 0.0, "what OP did in the gap is not known");
        assert!(found.seconds < 6400.0);
        let few = Inspected { t: &t[..300], sp: None, pv: &pv[..300], op: None, flags: None };
        assert_eq!(performance(&few, 1.0), None);
    }

    #[test]
    fn the_interval_holds_the_deviation_of_noise() {
        let (mut held, mut state) = (0, 7u64);
        for _ in 0..200 {
            let mut random = || {
                let mut uniform = || {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (state >> 11) as f64 / (1u64 << 53) as f64
                };
                (0..12).map(|_| uniform()).sum::<f64>() - 6.0
            };
            let pv: Vec<f64> = (0..800).map(|_| random()).collect();
            let t: Vec<f64> = (0..800).map(|k| k as f64).collect();
            let sp = vec![0.0; 800];
            let rows = Inspected { t: &t, sp: Some(&sp), pv: &pv, op: None, flags: None };
            let (_, low, high) = performance(&rows, 1.0).unwrap().deviation;
            held += i32::from(low < 1.0 && 1.0 < high);
        }
        assert!((180..=198).contains(&held), "{held} of 200");
    }
}
