//! The cycle that the fitted loop makes by itself, beside the one that was recorded.
//!
//! A gap in a loop with integral action makes it swing without any load, and how it swings is no free choice: period and swing
//! follow from process, gap and controller. The process and the gap are the fit's; of the controller the recording shows the law,
//!
//! ```text
//! OP(k) − OP(k−m) = K·(Δsp − Δpv) + Ki·Σ h·(sp − pv) + c      over m steps,
//! ```
//!
//! by least squares (a PI controller; c is what a setpoint that is not recorded adds). The loop of the three is then run without
//! any load from the recorded swing on, with the noise that PV has: through a controller it shakes OP, and a valve that is shaken is through its
//! gap earlier. Where the swing lasts, its period and its size are held against the recorded ones. A load that swings makes
//! its own period and a swing of its own size; that both are those of the loop with the gap is chance. The period alone is a weak witness,
//! for a load excites a loop best near the period at which it would swing itself.

use crate::data::backlash_model::BacklashModel;
use crate::data::cells::{Cells, Strip, crossings};
use crate::data::segment::{Segment, Stretch};
use crate::decide::bootstrap::Draws;
use crate::decide::thresholds::{LAW, OWN_CYCLE};
use crate::search::linear::{dot, solve};
use glapp_core::{Backlash, BacklashState, Friction, FrictionState};
use glapp_model::structure::{MOST, Structure, Theta};
use serde::{Deserialize, Serialize};

/// Fewest recorded swings that are compared with.
const FEWEST: usize = 4;
/// Periods for which the loop is run, of which the last third counts.
const PERIODS: f64 = 60.0;
/// Steps of the process in a step of the controller.
const FINE: usize = 8;
/// Share of a swing over which the law of the controller is fitted.
const PART: f64 = 0.25;
/// Distance from rest, in recorded swings, from which the loop counts as unstable.
const AWAY: f64 = 100.0;
/// Steps at most for which the loop is run.
const MOST_STEPS: f64 = 2e5;

/// Swing of the fitted loop without a load, compared with the recorded one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cycle {
    /// Period as a fraction of the recorded one; 0 where the loop comes to rest.
    pub period: f64,
    /// Swing of OP as a fraction of the recorded one; 0 where the loop comes to rest.
    pub swing: f64,
    /// Share of OP's moves over a quarter of a swing that the controller's law explains.
    pub law: f64,
}

impl Cycle {
    /// Whether the recorded swing is the one that the loop makes by itself.
    pub(crate) fn is_own(&self) -> bool {
        let near = |part: f64| part <= 1.0 + OWN_CYCLE && part * (1.0 + OWN_CYCLE) >= 1.0;
        self.law > LAW && near(self.period) && near(self.swing)
    }
}

/// The law of a PI controller, a step at a time [OP unit/PV unit].
struct Law {
    k: f64,
    ki: f64,
    explains: f64,
}

/// None where OP does not swing through the gap often enough, or shows no law that acts against PV.
pub(crate) fn cycle(
    rows: &Segment,
    cells: &Cells,
    structure: Structure,
    theta: &Theta,
    kp: f64,
    sigma: f64,
    lost: &BacklashModel,
) -> Option<Cycle> {
    let ops: Vec<&[f64]> = cells.stretches.iter().map(Strip::op).collect();
    // Width that a swing must cross: half of the gap, so that noise at the turns counts no swing twice and a swing
    // little wider than the gap counts.
    let through = 0.5 * lost.d;
    let (period, swing) = swings(&ops, through, FEWEST)?;
    let Law { k, ki, explains } = law(&rows.stretches, ((PART * period) as usize).max(1))?;
    let process = Process::new(structure, theta, kp, cells.cell as f64);
    if k * kp < 0.0 || ki * kp <= 0.0 {
        return None;
    }
    let steps = (PERIODS * period).min(MOST_STEPS) as usize;
    let op = process.run(k, ki, lost, swing, sigma * (cells.cell as f64).sqrt(), steps);
    let settled = &op[2 * steps / 3..];
    let rests = Cycle { period: 0.0, swing: 0.0, law: explains };
    if op.iter().any(|u| u.is_nan() || u.abs() >= AWAY * swing) {
        // The loop does not return.
        return Some(Cycle { swing: AWAY, ..rests });
    }
    let Some((own, height)) = swings(&[settled], through, FEWEST) else { return Some(rests) };
    Some(Cycle { period: own / period, swing: height / swing, law: explains })
}

/// Mean time from one traversal of `d` up to the next [steps], and the median of OP's moves between them, of so many at least.
fn swings(ops: &[&[f64]], d: f64, fewest: usize) -> Option<(f64, f64)> {
    let (mut times, mut heights) = (Vec::new(), Vec::new());
    for op in ops {
        let [up, _] = crossings(op, d);
        for pair in up.windows(2) {
            let between = &op[pair[0]..pair[1]];
            times.push((pair[1] - pair[0]) as f64);
            let (low, high) = between.iter().fold((f64::MAX, f64::MIN), |(l, h), u| (l.min(*u), h.max(*u)));
            heights.push(high - low);
        }
    }
    if times.len() < fewest {
        return None;
    }
    heights.sort_by(f64::total_cmp);
    Some((times.iter().sum::<f64>() / times.len() as f64, heights[heights.len() / 2]))
}

/// The controller's law over `m` steps; None where OP does not follow one.
fn law(stretches: &[Stretch], m: usize) -> Option<Law> {
    let columns = 4;
    let (mut rows, mut moves): (Vec<[f64; 4]>, Vec<f64>) = (Vec::new(), Vec::new());
    for Stretch { sp, pv, op, .. } in stretches {
        // Missing values count for nothing within a sum, and no sum begins or ends at one.
        let error = |k: usize| {
            let e = sp.get(k).copied().unwrap_or(0.0) - pv[k];
            if e.is_nan() { 0.0 } else { e }
        };
        let mut sums = vec![0.0; pv.len() + 1];
        (0..pv.len()).for_each(|k| sums[k + 1] = sums[k] + error(k));
        for k in m..pv.len() {
            let setpoint = if sp.is_empty() { 0.0 } else { sp[k] - sp[k - m] };
            let (y, du) = (pv[k] - pv[k - m], op[k] - op[k - m]);
            if y.is_finite() && du.is_finite() && setpoint.is_finite() {
                rows.push([-y, sums[k + 1] - sums[k + 1 - m], setpoint, 1.0]);
                moves.push(du);
            }
        }
    }
    let n = moves.len() as f64;
    if moves.len() < 10 * columns {
        return None;
    }
    let column = |j: usize| rows.iter().map(|row| row[j]).collect::<Vec<f64>>();
    let all: Vec<Vec<f64>> = (0..columns).map(column).collect();
    let mut normal = [[0.0; MOST]; MOST];
    let mut by = [0.0; MOST];
    for i in 0..columns {
        for j in 0..columns {
            normal[i][j] = dot(&all[i], &all[j]);
        }
        // A setpoint that stands still has no column of its own.
        normal[i][i] = normal[i][i] * (1.0 + 1e-9) + 1e-9 * n;
        by[i] = dot(&all[i], &moves);
    }
    let x = solve(normal, by, columns);
    let left: f64 = rows
        .iter()
        .zip(&moves)
        .map(|(row, du)| (du - row.iter().zip(&x).map(|(a, b)| a * b).sum::<f64>()).powi(2))
        .sum();
    let mean = moves.iter().sum::<f64>() / n;
    let all: f64 = moves.iter().map(|du| (du - mean).powi(2)).sum();
    (all > 0.0).then_some(Law { k: x[0], ki: x[1], explains: 1.0 - left / all })
}

/// Position of the valve under OP, from rest on.
fn valve(lost: &BacklashModel) -> Box<dyn FnMut(f64) -> f64> {
    if lost.jump() > 0.0 {
        let friction = Friction::new(lost.model, lost.d, lost.jump()).expect("0 ≤ jump ≤ d");
        let mut state = FrictionState::at(0.0);
        Box::new(move |u| friction.update(&mut state, u))
    } else {
        let gap = Backlash::new(lost.d).expect("d ≥ 0");
        let mut state = BacklashState::at(0.0);
        Box::new(move |u| gap.update(&mut state, u))
    }
}

/// The fitted process at steps of the controller: two lags or one with an integrator, a third lag, a dead time.
struct Process {
    kp: f64,
    /// Coefficients of 1, s and s² [steps].
    den: [f64; 3],
    /// A third lag [steps]; 0 for none.
    third: f64,
    dead: f64,
}

impl Process {
    fn new(structure: Structure, theta: &Theta, kp: f64, cell: f64) -> Self {
        let t = theta[0].exp() * cell;
        let dead = theta[structure.dead_time_at()] * cell;
        if structure.integrating {
            return Self { kp: kp / cell, den: [0.0, 1.0, t], third: 0.0, dead };
        }
        let third = if structure.lags == 3 { theta[2].exp() * cell } else { 0.0 };
        Self { kp, den: [1.0, 2.0 * theta[1].exp() * t, t * t], third, dead }
    }

    /// OP of the loop without a load, from half a swing off its rest on, with PV's noise as the controller sees it.
    fn run(&self, k: f64, ki: f64, lost: &BacklashModel, swing: f64, sigma: f64, steps: usize) -> Vec<f64> {
        let mut valve = valve(lost);
        let [c, b, a] = self.den;
        let dt = 1.0 / FINE as f64;
        // The trapezoidal rule for x₁' = x₂, a·x₂' = v − c·x₁ − b·x₂, which no short lag makes unstable.
        let denominator = a + 0.5 * dt * b + 0.25 * dt * dt * c;
        let third = if self.third > 0.0 { 1.0 - (-dt / self.third).exp() } else { 1.0 };
        let delay = (self.dead / dt).round() as usize;
        let mut queue = vec![0.0; delay + 1];
        let (mut at, mut x1, mut x2, mut y, mut sum) = (0, 0.0, 0.0, 0.0, 0.0);
        let mut op = Vec::with_capacity(steps);
        let mut draws = Draws::new(1, 0);
        for _ in 0..steps {
            let seen = y + sigma * draws.normal();
            sum -= seen;
            let u = 0.5 * swing - k * seen + ki * sum;
            let v = valve(u);
            op.push(u);
            for _ in 0..FINE {
                queue[at] = v;
                at = (at + 1) % queue.len();
                let delayed = self.kp * queue[at];
                let next = ((a - 0.5 * dt * b - 0.25 * dt * dt * c) * x2 + dt * (delayed - c * x1)) / denominator;
                x1 += 0.5 * dt * (x2 + next);
                x2 = next;
                y += third * (x1 - y);
            }
        }
        op
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glapp_model::structure::Noise;

    const SECOND: f64 = 1000.0;

    /// SP 0, PV and OP each second of a PI loop round a lag of 60 s with a dead time of 2 s, Euler's rule in steps of a millisecond; the
    /// load goes round a circle in `period` and is `size` large.
    fn simulated(d: f64, period: f64, size: f64) -> Segment<'static> {
        let (k, ki) = (8.0, 8.0 / 16.0);
        let (mut y, mut sum, mut v, mut u) = (0.0, 0.0, 0.0, 0.0);
        let mut late = vec![0.0; 2000];
        let (mut pv, mut op) = (Vec::new(), Vec::new());
        for step in 0..1_500_000 {
            if step % 1000 == 0 {
                sum -= y;
                u = 5.0 - k * y + ki * sum;
                pv.push(y);
                op.push(u);
            }
            v = f64::clamp(v, u - d / 2.0, u + d / 2.0);
            let delayed = std::mem::replace(&mut late[step % 2000], v);
            let load = size * (step as f64 / SECOND / period * std::f64::consts::TAU).sin();
            y += (delayed + load - y) / 60.0 / SECOND;
        }
        Segment {
            h: 1.0,
            stretches: vec![Stretch { start: 0.0, sp: [].as_slice().into(), pv: pv.into(), op: op.into() }],
        }
    }

    fn witness(record: &Segment, d: f64) -> Option<Cycle> {
        let cells = Cells::new(&record.signals(), 1);
        let structure = Structure { lags: 2, integrating: false, noise: Noise::Input };
        // 60 s and next to nothing.
        let (t1, t2) = (60.0f64, 0.01f64);
        let mut theta = [0.0; MOST];
        (theta[0], theta[1], theta[2]) = ((t1 * t2).sqrt().ln(), ((t1 + t2) / 2.0 / (t1 * t2).sqrt()).ln(), 2.0);
        cycle(record, &cells, structure, &theta, 1.0, 0.0, &BacklashModel::gap(d, 1))
    }

    #[test]
    fn the_swing_of_a_gap_is_the_loops_own() {
        let found = witness(&simulated(4.0, 100.0, 0.0), 4.0).unwrap();
        assert!(found.is_own() && (found.period - 1.0).abs() < 0.03 && (found.swing - 1.0).abs() < 0.03, "{found:?}");
        assert!(found.law > 0.999, "{found:?}");
    }

    #[test]
    fn the_swing_of_a_load_is_not() {
        // Taken for half a gap, a whole one and two.
        for d in [1.0, 2.0, 4.0] {
            let found = witness(&simulated(0.0, 90.0, 3.0), d);
            assert!(!found.is_some_and(|found| found.is_own()), "{d}: {found:?}");
        }
    }

    #[test]
    fn an_op_that_follows_no_law_has_no_witness() {
        let mut record = simulated(4.0, 100.0, 0.0);
        for (i, u) in record.stretches[0].op.to_mut().iter_mut().enumerate() {
            *u = 3.0 * (i as f64 / 40.0).sin();
        }
        assert!(!witness(&record, 1.0).is_some_and(|found| found.is_own()));
    }
}
