//! The likelihood of one family and its maximum for a given lost motion.

use crate::kalman::{LANES, Lanes, UNKNOWN, White, lanes};
use crate::record::{Lost, Positions, Record};
use crate::structure::{MOST, Structure, Theta};
use std::f64::consts::PI;

/// A point of the search: the family's parameters and what they are worth.
#[derive(Clone, Debug)]
pub(crate) struct Point {
    pub(crate) theta: Theta,
    /// −2·ln L but for a constant, the size of the noise and the gain at their best.
    pub(crate) cost: f64,
    /// Static gain (of an integrating process: velocity gain a cell) [PV unit / OP unit].
    pub(crate) kp: f64,
    pub(crate) lost: Lost,
}

/// What the likelihood is made of: `residual` = innovation/√S·exp(Σ ln S/2n), whose sum of squares is to be least.
pub(crate) struct Innovations {
    pub(crate) residual: Vec<Lanes>,
    pub(crate) kp: Lanes,
    pub(crate) sum: Lanes,
    /// Sum of squares with gain 0: what the disturbance alone explains.
    pub(crate) sum_without: Lanes,
    /// exp(Σ ln S/2n).
    pub(crate) scale: Lanes,
}

impl Innovations {
    pub(crate) fn lane(&self, lane: usize) -> Vec<f64> {
        self.residual.iter().map(|r| r[lane]).collect()
    }
}

/// One family on one record. `sign`: that of the gain where it is known, else 0.
#[derive(Clone, Copy)]
pub(crate) struct Search<'a> {
    pub(crate) record: &'a Record,
    pub(crate) structure: Structure,
    pub(crate) sign: f64,
}

impl Search<'_> {
    /// Four sets of parameters at once, each with the positions of one lost motion.
    pub(crate) fn innovations(&self, thetas: &[Theta; LANES], positions: [&Positions; LANES]) -> Innovations {
        // PV's mean over a cell lies half a cell behind its first step, OP's mean acts from the first step on. OP never acts on
        // the PV of its own step: it is the controller's answer to that PV, and would explain it all too well.
        let cell = self.record.cell as f64;
        let delay = lanes(|l| thetas[l][self.structure.dead_time_at()] - (cell - 1.0) / (2.0 * cell));
        let mut white = White::default();
        let mut delayed = Vec::new();
        for (i, stretch) in self.record.stretches.iter().enumerate() {
            delayed.clear();
            delayed.resize(stretch.y.len(), [0.0; LANES]);
            for l in 0..LANES {
                shift(&positions[l][i], delay[l], &mut delayed, l);
            }
            self.structure.whiten(thetas, &stretch.y, &stretch.jumps, &delayed, &mut white);
        }
        let (mut yy, mut yv, mut vv) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for (y, v) in white.of_y.iter().zip(&white.of_v) {
            for l in 0..LANES {
                yy[l] += y[l] * y[l];
                yv[l] += y[l] * v[l];
                vv[l] += v[l] * v[l];
            }
        }
        let kp = lanes(|l| {
            let kp = if vv[l] > 1e-300 { yv[l] / vv[l] } else { 0.0 };
            if kp * self.sign < 0.0 { 0.0 } else { kp }
        });
        let freedom = self.record.freedom();
        // A jump's size is free: it costs nothing here, and Search::surprise what it is worth.
        let free = self.record.jumps() as f64 * UNKNOWN.ln();
        let scale = lanes(|l| ((white.log_s[l] - free) / (2.0 * freedom)).exp());
        let mut residual = white.of_y;
        let mut sum = [0.0; LANES];
        for (y, v) in residual.iter_mut().zip(&white.of_v) {
            for l in 0..LANES {
                y[l] = (y[l] - kp[l] * v[l]) * scale[l];
                sum[l] += y[l] * y[l];
            }
        }
        Innovations { residual, kp, sum, sum_without: lanes(|l| yy[l] * scale[l] * scale[l]), scale }
    }

    pub(crate) fn at(&self, theta: &Theta, positions: &Positions) -> Innovations {
        self.innovations(&[*theta; LANES], [positions; LANES])
    }

    /// −2·ln L with the size of the noise at its best.
    pub(crate) fn cost(&self, sum: f64) -> f64 {
        let freedom = self.record.freedom();
        freedom * ((sum.max(1e-300) / freedom).ln() + 1.0 + (2.0 * PI).ln())
    }

    /// What the jumps of the load that are marked cost at `point` [−2·ln L]: each may lie at any cell, and be as large as OP's
    /// range.
    pub(crate) fn surprise(&self, point: &Point) -> f64 {
        let here = self.at(&point.theta, &self.record.positions(&point.lost));
        let white = here.sum[0] / (here.scale[0] * here.scale[0]) / self.record.freedom();
        let size = (point.kp * self.record.range).powi(2) / white;
        self.record.jumps() as f64 * ((2.0 * PI * size).ln().max(0.0) + 2.0 * (self.record.count as f64).ln())
    }

    /// Derivatives of the residuals by each parameter, a column each.
    pub(crate) fn slopes(&self, theta: &Theta, positions: &Positions, at: &[f64]) -> Vec<Vec<f64>> {
        let n = self.record.count as f64;
        let k = self.structure.parameters();
        let mut columns = Vec::with_capacity(k);
        for first in (0..k).step_by(LANES) {
            let mut thetas = [*theta; LANES];
            for (l, moved) in thetas.iter_mut().enumerate().take(k - first) {
                let j = first + l;
                moved[j] += 1e-4;
                *moved = self.structure.bounded(*moved, n);
                if moved[j] == theta[j] {
                    moved[j] -= 1e-4;
                }
            }
            let there = self.innovations(&thetas, [positions; LANES]);
            for l in 0..LANES.min(k - first) {
                let by = thetas[l][first + l] - theta[first + l];
                columns.push(there.residual.iter().zip(at).map(|(a, b)| (a[l] - b) / by).collect());
            }
        }
        columns
    }

    /// Levenberg–Marquardt from `theta`, at most `rounds` steps, until a step brings less than `enough` of −2·ln L. Four
    /// dampings are tried at each step.
    pub(crate) fn descend(&self, theta: Theta, lost: &Lost, rounds: usize, enough: f64) -> Point {
        let n = self.record.count as f64;
        let k = self.structure.parameters();
        let positions = self.record.positions(lost);
        let mut theta = self.structure.bounded(theta, n);
        let start = self.at(&theta, &positions);
        let (mut residual, mut sum, mut kp) = (start.lane(0), start.sum[0], start.kp[0]);
        let mut damping = 1e-2;
        for _ in 0..rounds {
            let slopes = self.slopes(&theta, &positions, &residual);
            let mut normal = [[0.0; MOST]; MOST];
            let mut down = [0.0; MOST];
            for i in 0..k {
                for j in i..k {
                    normal[i][j] = dot(&slopes[i], &slopes[j]);
                    normal[j][i] = normal[i][j];
                }
                down[i] = -dot(&slopes[i], &residual);
            }
            let flat = (0..k).map(|i| normal[i][i]).fold(0.0, f64::max) * 1e-9 + 1e-300;
            let dampings = [damping / 10.0, damping, damping * 10.0, damping * 300.0];
            let thetas = dampings.map(|damping| {
                let mut damped = normal;
                for (i, row) in damped.iter_mut().enumerate().take(k) {
                    row[i] += damping * row[i] + flat;
                }
                let step = solve(damped, down, k);
                let mut there = theta;
                for i in 0..k {
                    there[i] += step[i].clamp(-1.5, 1.5);
                }
                self.structure.bounded(there, n)
            });
            let found = self.innovations(&thetas, [&positions; LANES]);
            let best = (0..LANES).min_by(|a, b| found.sum[*a].total_cmp(&found.sum[*b])).expect("four lanes");
            if found.sum[best] < sum {
                let gained = self.cost(sum) - self.cost(found.sum[best]);
                (theta, residual, sum, kp) = (thetas[best], found.lane(best), found.sum[best], found.kp[best]);
                damping = dampings[best].clamp(1e-8, 1e6);
                if gained < enough {
                    break;
                }
            } else if damping < 1e4 {
                damping *= 3000.0;
            } else {
                break;
            }
        }
        Point { theta, cost: self.cost(sum), kp, lost: lost.clone() }
    }

    /// The best start of each stretch within the gap at θ, to a few hundredths of the gap.
    pub(crate) fn placed(&self, theta: &Theta, lost: &Lost) -> Lost {
        let mut best = lost.clone();
        for stretch in 0..best.start.len() {
            if !self.shows_start(lost, stretch) {
                continue;
            }
            let (mut centre, mut apart): (f64, f64) = (0.5, 1.0 / 3.0);
            while apart > 0.03 {
                let places = [-1.5, -0.5, 0.5, 1.5].map(|k| (centre + k * apart).clamp(0.0, 1.0));
                let tried = places.map(|place| {
                    let mut tried = best.clone();
                    tried.start[stretch] = place;
                    self.record.positions(&tried)
                });
                let sums = self.innovations(&[*theta; LANES], std::array::from_fn(|l| &tried[l])).sum;
                let least = (0..LANES).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).expect("four lanes");
                centre = places[least];
                best.start[stretch] = centre;
                apart /= 3.0;
            }
        }
        best
    }

    /// Whether it matters where in the gap the valve stands at the beginning of a stretch.
    fn shows_start(&self, lost: &Lost, stretch: usize) -> bool {
        self.record.stretches[stretch].open(lost.d, self.record.cell) >= 3
    }

    /// The best of several beginnings, each with its best starts in the gap.
    pub(crate) fn from(&self, beginnings: &[(Theta, Lost)], rounds: usize, enough: f64) -> Point {
        beginnings
            .iter()
            .map(|(theta, lost)| {
                let lost = self.placed(&self.structure.bounded(*theta, self.record.count as f64), lost);
                let point = self.descend(*theta, &lost, rounds, enough);
                // The parameters moved: so may the start.
                let again = self.placed(&point.theta, &lost);
                if again == lost { point } else { self.descend(point.theta, &again, rounds.div_ceil(2), enough) }
            })
            .min_by(|a, b| a.cost.total_cmp(&b.cost))
            .expect("at least one beginning")
    }
}

/// `v` later by `delay` cells, which need not be whole, into one lane of `out`.
fn shift(v: &[f64], delay: f64, out: &mut [Lanes], lane: usize) {
    let whole = delay.floor();
    let part = delay - whole;
    let whole = whole as isize;
    let last = v.len() as isize - 1;
    for (k, out) in out.iter_mut().enumerate() {
        let at = |k: isize| v[k.clamp(0, last) as usize];
        let k = k as isize;
        out[lane] = (1.0 - part) * at(k - whole) + part * at(k - whole - 1);
    }
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Four sums at once: the order is stated, so that every machine gets the same bits.
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a4.zip(b4) {
        for i in 0..4 {
            sums[i] += x[i] * y[i];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

/// Solves the symmetric, positive definite a·x = b of order `k` by Cholesky's factors; no move where it is not definite.
pub(crate) fn solve(mut a: [[f64; MOST]; MOST], mut b: Theta, k: usize) -> Theta {
    for j in 0..k {
        for i in j..k {
            let sum: f64 = (0..j).map(|m| a[i][m] * a[j][m]).sum();
            let rest = a[i][j] - sum;
            if i == j {
                if rest <= 0.0 {
                    return [0.0; MOST];
                }
                a[j][j] = rest.sqrt();
            } else {
                a[i][j] = rest / a[j][j];
            }
        }
    }
    for i in 0..k {
        let sum: f64 = (0..i).map(|m| a[i][m] * b[m]).sum();
        b[i] = (b[i] - sum) / a[i][i];
    }
    for i in (0..k).rev() {
        let sum: f64 = (i + 1..k).map(|m| a[m][i] * b[m]).sum();
        b[i] = (b[i] - sum) / a[i][i];
    }
    b
}
