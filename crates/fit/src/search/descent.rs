//! Descent to the maximum of the likelihood for a given lost motion: Levenberg and Marquardt, the derivatives by differences, all of
//! them in one pass.

use crate::data::backlash_model::BacklashModel;
use crate::data::cells::Positions;
use crate::search::likelihood::{Point, Search, Wanted, gain};
use crate::search::linear::solve;
use crate::search::pass::{BEGUN, DESCENDED, Workspace};
use glapp_model::kalman::Sums;
use glapp_model::lanes::{LANES, Lanes};
use glapp_model::structure::{MOST, Theta};

/// Cells after which what the filter was told at first is forgotten.
const SETTLED: usize = 100;

/// A point with the slope and the curvature of the likelihood there.
struct Local {
    theta: Theta,
    kp: f64,
    noise: f64,
    products: (f64, f64),
    sum: f64,
    /// JᵀJ and −Jᵀr.
    normal: [[f64; MOST]; MOST],
    down: Theta,
}

impl Search<'_> {
    /// Lanes that a point takes with its derivatives: see [`Search::perturbed`].
    pub(super) fn lanes(&self) -> usize {
        1 + self.structure.parameters()
    }

    /// θ in the first lane, in the others θ with one parameter moved, and by how much.
    pub(super) fn perturbed(&self, theta: &Theta) -> ([Theta; LANES], Theta) {
        let n = self.record.count as f64;
        let mut thetas = [*theta; LANES];
        let mut by = [1.0; MOST];
        for j in 0..self.structure.parameters() {
            let moved = &mut thetas[j + 1];
            moved[j] += 1e-4;
            *moved = self.structure.bounded(*moved, n);
            if moved[j] == theta[j] {
                moved[j] -= 1e-4;
            }
            by[j] = moved[j] - theta[j];
        }
        (thetas, by)
    }

    /// Residuals at θ and their derivatives by each parameter, a column each.
    pub(crate) fn slopes(&self, theta: &Theta, positions: &Positions) -> (Vec<f64>, Vec<Vec<f64>>) {
        let (thetas, by) = self.perturbed(theta);
        self.innovations(&thetas, self.lanes(), positions, Wanted::Residuals, |found| {
            let slope = |j: usize| found.residual.iter().map(|r| (r[j + 1] - r[0]) / by[j]).collect();
            (found.lane(0), (0..self.structure.parameters()).map(slope).collect())
        })
    }

    /// θ with slope and curvature, in one pass; `place` as in [`Pass`].
    fn local(&self, theta: Theta, positions: &Positions, place: usize) -> Local {
        let (thetas, by) = self.perturbed(&theta);
        let k = self.structure.parameters();
        self.pass(
            &thetas,
            self.lanes(),
            &|_, i| &positions[i],
            Wanted::Products,
            place,
            |Workspace { found, .. }| {
                let (mut normal, mut down) = ([[0.0; MOST]; MOST], [0.0; MOST]);
                for i in 0..k {
                    for j in 0..k {
                        normal[i][j] = found.products[i + 1][j + 1] / (by[i] * by[j]);
                    }
                    down[i] = -found.products[0][i + 1] / by[i];
                }
                let products = (found.sums.yv[0], found.sums.vv[0]);
                Local { theta, kp: found.kp[0], noise: self.noise(found), products, sum: found.sum[0], normal, down }
            },
        )
    }

    /// The damped step from a point and how far it should bring Σ r² down. Parameters that stand at a bound and would leave it
    /// stay.
    fn step(&self, from: &Local, damping: f64) -> (Theta, f64) {
        let n = self.record.count as f64;
        let k = self.structure.parameters();
        let (mut normal, mut down) = (from.normal, from.down);
        let flat = (0..k).map(|i| normal[i][i]).fold(0.0, f64::max) * 1e-9 + 1e-300;
        for (i, row) in normal.iter_mut().enumerate().take(k) {
            row[i] += damping * row[i] + flat;
        }
        let mut there = from.theta;
        for _ in 0..k {
            let step = solve(normal, down, k);
            there = from.theta;
            for i in 0..k {
                there[i] += step[i].clamp(-1.5, 1.5);
            }
            let free = there;
            there = self.structure.bounded(there, n);
            let mut held = (0..k).filter(|i| there[*i] != free[*i] && there[*i] == from.theta[*i]).peekable();
            if held.peek().is_none() {
                break;
            }
            for i in held {
                down[i] = 0.0;
                for j in 0..k {
                    (normal[i][j], normal[j][i]) = (0.0, 0.0);
                }
                normal[i][i] = 1.0;
            }
        }
        let mut less = 0.0;
        for i in 0..k {
            let by = there[i] - from.theta[i];
            less +=
                by * (2.0 * from.down[i] - (0..k).map(|j| from.normal[i][j] * (there[j] - from.theta[j])).sum::<f64>());
        }
        (there, less)
    }

    /// Levenberg–Marquardt from `theta`, at most `rounds` steps, until a step brings less than `enough` of −2·ln L, or as
    /// soon as it is plain that it will not come below `unless`.
    pub(crate) fn descend(&self, theta: Theta, lost: &BacklashModel, rounds: usize, enough: f64, unless: f64) -> Point {
        let n = self.record.count as f64;
        let positions = self.record.positions(lost);
        let mut here = self.local(self.structure.bounded(theta, n), &positions, BEGUN);
        let mut damping = 1e-2;
        for _ in 0..rounds {
            let (there, less) = self.step(&here, damping);
            let foreseen = self.cost(here.sum) - self.cost((here.sum - less).max(0.1 * here.sum));
            if foreseen < enough || self.cost(here.sum) - 3.0 * foreseen > unless {
                break;
            }
            let next = self.local(there, &positions, DESCENDED);
            let before = here.sum;
            if next.sum < before {
                here = next;
                damping = (damping / 10.0).max(1e-8);
            } else {
                // Too far: eight shorter steps at once.
                let dampings = Lanes::each(|l| damping * 10f64.powi(l as i32 + 1));
                let thetas = dampings.map(|damping| self.step(&here, damping).0);
                let of = |_, i: usize| positions[i].as_slice();
                let sums = self.pass(&thetas, LANES, &of, Wanted::Least, DESCENDED, |pass| pass.found.sum);
                let best = (0..LANES).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).expect("eight lanes");
                if sums[best] >= before {
                    break;
                }
                here = self.local(thetas[best], &positions, DESCENDED);
                damping = dampings[best];
            }
            if self.cost(before) - self.cost(here.sum) < enough {
                break;
            }
        }
        let Local { theta, kp, noise, products, sum, .. } = here;
        Point { theta, cost: self.cost(sum), kp, lost: lost.clone(), noise, products }
    }

    /// The best start of each stretch within the gap at a point, to a few hundredths of the gap; the gain follows.
    fn placed(&self, point: &Point) -> BacklashModel {
        let lost = &point.lost;
        let mut best = lost.clone();
        let (mut yv, mut vv) = point.products;
        for (i, stretch) in self.record.stretches.iter().enumerate() {
            let open = stretch.open(lost.d, self.record.cell);
            if open < 3 {
                continue;
            }
            // The start no longer matters from there on.
            let cells = (2 * open + SETTLED).min(stretch.y.len());
            let positions = stretch.positions_from(lost, self.record.cell, cells);
            let tried = |places: Lanes| self.beginnings(point, i, &positions(&places));
            let better = |sums: &Sums, rest: (f64, f64)| {
                let bought = |l: usize| {
                    let (yv, vv) = (rest.0 + sums.yv[l], rest.1 + sums.vv[l]);
                    gain(yv, vv, self.sign) * yv
                };
                (0..LANES).max_by(|a, b| bought(*a).total_cmp(&bought(*b))).expect("eight lanes")
            };
            // The present place, and seven places over all of the gap; then eight around the best.
            let places = Lanes::each(|l| if l == 0 { lost.start[i] } else { (l as f64 - 1.0) / 6.0 });
            let first = tried(places);
            let rest = (yv - first.yv[0], vv - first.vv[0]);
            let centre = places[better(&first, rest)];
            let places = Lanes::each(|l| (centre + (l as f64 - 3.5) / 30.0).clamp(0.0, 1.0));
            let second = tried(places);
            let found = better(&second, rest);
            best.start[i] = places[found];
            (yv, vv) = (rest.0 + second.yv[found], rest.1 + second.vv[found]);
        }
        best
    }

    /// The best of several beginnings, each with its best starts in the gap; one that will plainly not come below `unless` or
    /// another beginning is left where it is.
    pub(crate) fn from(&self, beginnings: &[(Theta, BacklashModel)], rounds: usize, enough: f64, unless: f64) -> Point {
        let mut unless = unless;
        let ends = beginnings.iter().map(|(theta, lost)| {
            let mut point = self.descend(*theta, lost, rounds, enough, unless);
            let placed = self.placed(&point);
            if placed != point.lost {
                point = self.descend(point.theta, &placed, rounds.div_ceil(2), enough, unless);
            }
            unless = unless.min(point.cost);
            point
        });
        ends.min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("at least one beginning")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::cells::Cells;
    use crate::search::likelihood::Innovations;
    use glapp_model::structure::{Noise, Structure};

    #[test]
    fn beginnings_are_summed_up_as_passes_would() {
        let u: Vec<f64> = (0..150).map(|k| (f64::from(k) * 0.05).sin()).collect();
        let y: Vec<f64> = u.iter().zip(0..).map(|(u, k)| u + 0.01 * f64::from(k * 7919 % 13)).collect();
        let record = Cells::new(&[(&y, &u)], 1);
        let structure = Structure { lags: 2, integrating: false, noise: Noise::Input };
        let search = Search { record: &record, structure, sign: 1.0 };
        let theta = structure.beginning(8.0, 2.4);
        let point = search.descend(theta, &BacklashModel::gap(0.5, 1), 0, 0.1, f64::INFINITY);
        let places = Lanes::each(|l| l as f64 / 7.0);
        let stretch = &record.stretches[0];
        let sums = search.beginnings(&point, 0, &stretch.positions_from(&point.lost, 1, 150)(&places));
        for l in 0..LANES {
            let lost = BacklashModel { start: vec![places[l]], ..point.lost.clone() };
            let of_one = |found: &Innovations| (found.sums.yv[0], found.sums.vv[0]);
            let thetas = [point.theta; LANES];
            let (yv, vv) = search.innovations(&thetas, 1, &record.positions(&lost), Wanted::Sums, of_one);
            assert!((yv - sums.yv[l]).abs() < 1e-6 * yv.abs() && (vv - sums.vv[l]).abs() < 1e-6 * vv, "start {l}");
        }
    }
}
