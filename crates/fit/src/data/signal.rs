//! Preparation of a signal for the fit: its scale, its spikes and shifts, and whether it was drawn as lines.

use crate::decide::thresholds::CORNERS;

/// Scale of a signal: value = zero + size·(number in the fit).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unit {
    pub(crate) zero: f64,
    pub(crate) size: f64,
}

/// Steps of a signal's whole range: rounding that hangs on the unit of a file is far below, noise far above.
const GRID: f64 = (1u64 << 20) as f64;

impl Unit {
    pub(crate) fn of<'a>(signals: impl Iterator<Item = &'a [f64]>) -> Self {
        let (low, high) = signals
            .flatten()
            .filter(|x| !x.is_nan())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)));
        Self { zero: low, size: if high > low { high - low } else { 1.0 } }
    }

    /// The signal from 0 to 1: the results do not depend on units.
    pub(crate) fn scaled(self, signal: &[f64]) -> Vec<f64> {
        signal.iter().map(|x| ((x - self.zero) / self.size * GRID).round() / GRID).collect()
    }
}

/// Steps of PV, in its usual step (median), by which a sample must stand out from the two before and the two after it.
const SPIKE: f64 = 12.0;

/// Rows of samples that stand alone: no process goes and comes back in one step.
///
/// ```
/// let mut pv: Vec<f64> = (0..200).map(|k| (f64::from(k) / 7.0).sin()).collect();
/// assert!(glapp_fit::spikes(&pv).is_empty());
/// pv[60] += 5.0;
/// assert_eq!(glapp_fit::spikes(&pv), [60]);
/// ```
pub fn spikes(pv: &[f64]) -> Vec<usize> {
    let Some(usual) = usual_step(pv) else { return Vec::new() };
    let alone = |w: &[f64]| {
        let (low, high) = range(&[w[0], w[1], w[3], w[4]]);
        let out = (w[2] - high).max(low - w[2]);
        // Beside a jump of PV the last sample before it stands out by nothing.
        w.iter().all(|x| !x.is_nan()) && out > SPIKE * usual && out > high - low
    };
    pv.windows(5).enumerate().filter(|(_, w)| alone(w)).map(|(k, _)| k + 2).collect()
}

/// The least and the greatest of the values that are numbers.
fn range(x: &[f64]) -> (f64, f64) {
    x.iter().fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(*x), high.max(*x)))
}

/// The median move of a signal that moves.
fn usual_step(signal: &[f64]) -> Option<f64> {
    let mut steps: Vec<f64> = signal.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|step| *step > 0.0).collect();
    let middle = steps.len() / 2;
    (!steps.is_empty()).then(|| *steps.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Rows before a shift of whose range it leads out, and in which OP is looked at.
const BEFORE: usize = 30;
/// Rows on both sides of a shift in which PV stays where it is, but for this share of the shift.
const LEVEL: (usize, f64) = (3, 0.25);
/// Shifts, and the share of them that go one way with OP: more are slips of a valve that sticks.
const SLIPS: (usize, f64) = (3, 0.8);

/// Rows from which PV stands on another level than in the row before: a transmitter that was set anew, or another scale of
/// the recorder. A process is on its way for longer.
///
/// They are larger than twelve of PV's usual steps (median), lead out of the range of the last 30 rows by half their size,
/// and come after no such step of OP in these rows. Nor do they go the way that OP has gone, as slips of a valve do.
///
/// ```
/// let wave = |k: i32| (f64::from(k) / 7.0).sin();
/// let op: Vec<f64> = (0..200).map(wave).collect();
/// let pv: Vec<f64> = (0..200).map(|k| wave(k - 3) + if k < 120 { 0.0 } else { 5.0 }).collect();
/// assert_eq!(glapp_fit::shifts(&pv, &op), [120]);
/// ```
pub fn shifts(pv: &[f64], op: &[f64]) -> Vec<usize> {
    let pv = without_spikes(pv.to_vec());
    let Some(usual) = usual_step(&pv) else { return Vec::new() };
    let op_step = usual_step(op).unwrap_or(0.0);
    let (level, still) = LEVEL;
    let shift = |k: &usize| {
        let size = (pv[*k] - pv[k - 1]).abs();
        let [before, after] = [&pv[k - level..*k], &pv[*k..k + level]];
        let rests = |x: &[f64]| range(x).1 - range(x).0 <= still * size && x.iter().all(|x| !x.is_nan());
        let beyond = || {
            let (low, high) = range(&pv[k - BEFORE..*k]);
            (range(after).0 - high).max(low - range(after).1)
        };
        let led = || op[k - BEFORE..*k].windows(2).any(|w| (w[1] - w[0]).abs() > SPIKE * op_step);
        size > SPIKE * usual && rests(before) && rests(after) && beyond() > 0.5 * size && !led()
    };
    let found: Vec<usize> = (BEFORE..(pv.len() + 1).saturating_sub(level)).filter(shift).collect();
    let with_op = |k: &usize| (pv[*k] - pv[k - 1]) * (op[k - 1] - op[k - BEFORE]);
    let way = |sign: f64| found.iter().filter(|k| sign * with_op(k) > 0.0).count();
    let (fewest, most) = SLIPS;
    let slips = found.len() >= fewest && way(1.0).max(way(-1.0)) as f64 > most * found.len() as f64;
    if slips { Vec::new() } else { found }
}

/// The signal without its [`spikes`], which OP answers as if they were real.
pub(crate) fn without_spikes(mut pv: Vec<f64>) -> Vec<f64> {
    spikes(&pv).into_iter().for_each(|k| pv[k] = f64::NAN);
    pv
}

/// Median bend of PV between the points that a historian kept and drew lines between; 0 where it kept every sample.
pub(crate) fn bow(pv: &[f64]) -> f64 {
    let bend = |w: &[f64]| w[2] - 2.0 * w[1] + w[0];
    // A still PV holds no drawn lines.
    let moving = |w: &&[f64]| (w[2] - w[1]).abs() + (w[1] - w[0]).abs() > 8.0 / GRID;
    let corner = |w: &[f64]| bend(w).abs() > 8.0 / GRID;
    let all = pv.windows(3).filter(moving).count();
    let corners: Vec<(usize, f64)> =
        pv.windows(3).enumerate().filter(|(_, w)| corner(w)).map(|(k, w)| (k, bend(w).abs())).collect();
    if corners.len() < 3 || corners.len() as f64 > CORNERS * all as f64 {
        return 0.0;
    }
    let beside = |w: &[(usize, f64)]| {
        let (left, right) = ((w[1].0 - w[0].0) as f64, (w[2].0 - w[1].0) as f64);
        w[1].1 * left * right / (left + right)
    };
    let mut bows: Vec<f64> = corners.windows(3).map(beside).collect();
    let middle = bows.len() / 2;
    *bows.select_nth_unstable_by(middle, f64::total_cmp).1
}
