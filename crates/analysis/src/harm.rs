//! Harm of a dead band to its loop: the part of PV's variance and of OP's travel that would vanish without it.
//!
//! A gap in a linear loop acts as a load of its own. With the controller's output u and the valve's position v it keeps
//!
//! ```text
//! w = u − v − mean(u − v)
//! ```
//!
//! from the process. What the loop makes of w, through the fitted gain, dead time and lags under the controller's K and Ti, is
//! taken from the error; what the variance loses is the share of PV. What of OP's travel the valve does not make is the share of
//! OP.

use crate::fitted::Process;
use crate::{Inspected, median};
use serde::{Deserialize, Serialize};

/// Number of cells below which there is no answer.
const FEWEST_CELLS: usize = 10;
/// PV so many times larger than a unit step of OP makes it means that the fitted process runs away under the controller.
const RUNS_AWAY: f64 = 1e6;

/// Harm of a dead band to its loop, as shares from 0 to 1; none where it cannot be computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Harm {
    /// Share of PV's variance about SP.
    pub pv_share: Option<f64>,
    /// Share of OP's travel.
    pub op_share: Option<f64>,
    /// The larger of both.
    #[serde(skip_deserializing)]
    pub worst: Option<f64>,
}

/// The cells that a gap was fitted to.
#[derive(Clone, Copy, Debug)]
pub struct Cells<'a> {
    /// Time \[s\].
    pub t: &'a [f64],
    /// PV [PV unit].
    pub pv: &'a [f64],
    /// Position of the valve as the model has it [OP unit].
    pub position: &'a [f64],
}

impl Harm {
    /// Harm from the shares that are known.
    pub fn of(pv_share: Option<f64>, op_share: Option<f64>) -> Self {
        let worst = [pv_share, op_share].into_iter().flatten().reduce(f64::max);
        Self { pv_share, op_share, worst }
    }

    /// The mean of each share over several windows, where it is known.
    pub fn mean(of: &[Self]) -> Self {
        let mean = |share: fn(&Self) -> Option<f64>| {
            let known: Vec<f64> = of.iter().filter_map(share).collect();
            (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
        };
        Self::of(mean(|harm| harm.pv_share), mean(|harm| harm.op_share))
    }
}

/// The harm of a gap that was fitted to cells of these rows; `law` has the controller's K [OP unit/PV unit] and Ti \[s\], where
/// they are known.
///
/// ```
/// use glapp_analysis::{HarmCells, Inspected, Process, harm};
/// let t: Vec<f64> = (0..100).map(f64::from).collect();
/// let op: Vec<f64> = t.iter().map(|t| (t / 8.0).sin()).collect();
/// let (pv, still) = (vec![0.0; 100], vec![0.0; 100]);
/// let rows = Inspected { t: &t, sp: None, pv: &pv, op: Some(&op), flags: None };
/// let process = Process { kp: (1.0, 0.9, 1.1), dead_time: (0.0, 0.0, 1.0), lag: (5.0, 4.0, 6.0), integrating: false };
/// let found = harm(&HarmCells { t: &t, pv: &pv, position: &still }, &rows, Some((0.5, 10.0)), &process);
/// // A valve that stands still, and PV with it.
/// assert_eq!((found.pv_share, found.op_share), (None, Some(1.0)));
/// ```
pub fn harm(cells: &Cells<'_>, rows: &Inspected<'_>, law: Option<(f64, f64)>, process: &Process) -> Harm {
    let Cells { t, pv, position } = *cells;
    let op = rows.op.and_then(|op| interpolated(t, rows.t, op));
    let Some(op) = op.filter(|_| t.len() >= FEWEST_CELLS) else { return Harm::default() };
    let sp = rows.sp.filter(|sp| sp.iter().any(|sp| sp.is_finite()));
    let error: Vec<f64> = match sp {
        Some(sp) => pv.iter().zip(held(t, rows.t, sp)).map(|(pv, sp)| pv - sp).collect(),
        None => pv.to_vec(),
    };
    let travel = |x: &[f64]| x.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum::<f64>();
    let asked = travel(&op);
    let op_share = (asked > 0.0).then(|| (1.0 - travel(position) / asked).clamp(0.0, 1.0));
    let lost: Vec<f64> = op.iter().zip(position).map(|(u, v)| u - v).collect();
    let mean = lost.iter().sum::<f64>() / lost.len() as f64;
    let load: Vec<f64> = lost.iter().map(|lost| lost - mean).collect();
    let made = law.and_then(|law| made_of(&load, t, law, process));
    let good: Vec<(f64, f64)> = made
        .map_or_else(Vec::new, |made| error.iter().copied().zip(made).filter(|(error, _)| error.is_finite()).collect());
    let power = variance(good.iter().map(|(error, _)| *error));
    let left = variance(good.iter().map(|(error, made)| error + made));
    let pv_share = (power > 0.0).then(|| (1.0 - left / power).clamp(0.0, 1.0));
    Harm::of(pv_share, op_share)
}

/// PV of a loop under PI with a load at the process input [PV unit]; none where the fitted process is unstable under
/// it.
fn made_of(load: &[f64], t: &[f64], (k, ti): (f64, f64), process: &Process) -> Option<Vec<f64>> {
    let mut steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let h = median(&mut steps);
    let ((kp, ..), (late, ..), (lag, ..)) = (process.kp, process.dead_time, process.lag);
    let (shift, a) = ((late / h).round() as usize, h / (lag.max(0.0) + h));
    let mut into = vec![0.0; load.len() + shift + 1];
    let (mut y, mut x, mut integral) = (0.0, 0.0, 0.0);
    let mut made = Vec::with_capacity(load.len());
    for (i, w) in load.iter().enumerate() {
        made.push(y);
        integral += k * h / ti * y;
        into[i + shift] = w - k * y - integral;
        x += (kp * into[i] - x) * a;
        y = if process.integrating { y + x * h } else { x };
        if y.is_nan() || y.abs() >= RUNS_AWAY * (1.0 + kp.abs()) {
            return None;
        }
    }
    Some(made)
}

/// A signal on straight lines between the samples where it is a number; none where it is nowhere one.
fn interpolated(at: &[f64], t: &[f64], x: &[f64]) -> Option<Vec<f64>> {
    let known: Vec<(f64, f64)> = t.iter().copied().zip(x.iter().copied()).filter(|(_, x)| x.is_finite()).collect();
    let (first, last) = (known.first()?, known.last()?);
    let value = |at: &f64| {
        let k = known.partition_point(|(t, _)| t <= at);
        match (k.checked_sub(1).map(|before| known[before]), known.get(k)) {
            (None, _) => first.1,
            (_, None) => last.1,
            (Some((t0, x0)), Some((t1, x1))) => x0 + (x1 - x0) * (at - t0) / (t1 - t0),
        }
    };
    Some(at.iter().map(value).collect())
}

/// A signal that keeps each value until the next.
fn held<'a>(at: &'a [f64], t: &'a [f64], x: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
    at.iter().map(move |at| x[t.partition_point(|t| t <= at).max(1) - 1])
}

fn variance(of: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = of.clone().count() as f64;
    if n == 0.0 {
        return 0.0;
    }
    let mean = of.clone().sum::<f64>() / n;
    of.map(|x| (x - mean) * (x - mean)).sum::<f64>() / n
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROCESS: Process =
        Process { kp: (1.0, 0.9, 1.1), dead_time: (0.0, 0.0, 1.0), lag: (5.0, 4.0, 6.0), integrating: false };

    /// A valve that follows OP behind a gap of 1, the PV that a loop under PI makes of that, and a share of noise in it.
    fn swinging(n: usize, noise: f64) -> (Vec<f64>, Vec<f64>, Vec<f64>, Vec<f64>) {
        let t: Vec<f64> = (0..n).map(|k| k as f64).collect();
        let op: Vec<f64> = t.iter().map(|t| 2.0 * (t / 20.0).sin()).collect();
        let mut at = 0.0f64;
        let follow = |u: &f64| {
            at = at.clamp(u - 0.5, u + 0.5);
            at
        };
        let position: Vec<f64> = op.iter().map(follow).collect();
        let lost: Vec<f64> = op.iter().zip(&position).map(|(u, v)| u - v).collect();
        let mean = lost.iter().sum::<f64>() / n as f64;
        let load: Vec<f64> = lost.iter().map(|lost| lost - mean).collect();
        let made = made_of(&load, &t, (0.5, 10.0), &PROCESS).unwrap();
        let pv = made.iter().enumerate().map(|(k, made)| noise * if k % 2 == 0 { 1.0 } else { -1.0 } - made).collect();
        (t, op, position, pv)
    }

    fn of(n: usize, noise: f64, sp: f64) -> Harm {
        let (t, op, position, pv) = swinging(n, noise);
        let pv: Vec<f64> = pv.iter().map(|pv| pv + sp).collect();
        let sp = vec![sp; n];
        let rows = Inspected { t: &t, sp: Some(&sp), pv: &pv, op: Some(&op), flags: None };
        harm(&Cells { t: &t, pv: &pv, position: &position }, &rows, Some((0.5, 10.0)), &PROCESS)
    }

    #[test]
    fn what_the_gap_alone_makes_of_pv_is_all_of_it() {
        let harm = of(2000, 0.0, 0.0);
        assert!((harm.pv_share.unwrap() - 1.0).abs() < 1e-9, "{harm:?}");
        // A gap of 1 takes 1 off each swing of 4.
        assert!((harm.op_share.unwrap() - 0.25).abs() < 0.01, "{harm:?}");
        assert_eq!(harm.worst, harm.pv_share);
        assert_eq!(of(2000, 0.0, 40.0).pv_share.map(|share| (share * 1e6).round()), Some(1e6), "about SP, not about 0");
    }

    #[test]
    fn noise_beside_the_gap_is_none_of_its_harm() {
        let power = of(2000, 0.0, 0.0);
        let half = of(2000, 0.2, 0.0).pv_share.unwrap();
        assert!(0.1 < half && half < 0.95 && power.pv_share.unwrap() > half, "{half}");
    }

    #[test]
    fn too_few_cells_and_a_process_that_runs_away_say_nothing() {
        assert_eq!(of(FEWEST_CELLS - 1, 0.0, 0.0), Harm::default());
        assert!(of(FEWEST_CELLS, 0.0, 0.0).op_share.is_some() && FEWEST_CELLS == 10);
        let late =
            Process { kp: (1.0, 1.0, 1.0), dead_time: (50.0, 50.0, 50.0), lag: (0.0, 0.0, 0.0), integrating: true };
        let (t, op, position, pv) = swinging(2000, 0.0);
        let rows = Inspected { t: &t, sp: None, pv: &pv, op: Some(&op), flags: None };
        let cells = Cells { t: &t, pv: &pv, position: &position };
        let harm = harm(&cells, &rows, Some((5.0, 1.0)), &late);
        assert!(harm.pv_share.is_none() && harm.op_share.is_some(), "{harm:?}");
        assert_eq!(super::harm(&cells, &rows, None, &PROCESS).pv_share, None, "without K and Ti nobody knows");
    }

    #[test]
    fn a_loop_that_leaves_two_million_units_runs_away() {
        // An integrator of gain 1 without a controller: 100 cells of a steady load add up to 99 times the load.
        let process = Process { kp: (1.0, 1.0, 1.0), lag: (0.0, 0.0, 0.0), integrating: true, ..PROCESS };
        let t: Vec<f64> = (0..100).map(f64::from).collect();
        let stays = |end: f64| made_of(&[end / 100.0; 100], &t, (0.0, 10.0), &process).is_some();
        assert!(stays(1.99e6) && !stays(2.01e6));
    }

    #[test]
    fn signals_are_taken_at_the_cells() {
        let (t, x) = ([0.0, 1.0, 2.0, 3.0], [0.0, f64::NAN, 4.0, 4.0]);
        assert_eq!(interpolated(&[-1.0, 1.0, 2.5, 9.0], &t, &x), Some(vec![0.0, 2.0, 4.0, 4.0]));
        assert_eq!(interpolated(&[0.0], &t, &[f64::NAN; 4]), None);
        assert_eq!(
            held(&[-1.0, 0.0, 1.9, 2.0, 9.0], &t, &[1.0, 2.0, 3.0, 4.0]).collect::<Vec<_>>(),
            [1.0, 1.0, 2.0, 3.0, 4.0]
        );
    }

    #[test]
    fn windows_count_alike() {
        let mean = Harm::mean(&[Harm::of(Some(0.2), None), Harm::of(Some(0.4), Some(0.9))]);
        assert!((mean.pv_share.unwrap() - 0.3).abs() < 1e-12);
        assert_eq!((mean.op_share, mean.worst), (Some(0.9), Some(0.9)));
        assert_eq!(Harm::mean(&[]), Harm::default());
    }
}
