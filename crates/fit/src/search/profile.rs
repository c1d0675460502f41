//! The likelihood over the width d: where it is greatest, how far it stays near, what it is without a gap.

use crate::data::backlash_model::BacklashModel;
use crate::data::cells::Cells;
use crate::search::likelihood::{Point, Search};
use crate::search::linear::{dot, solve};
use glapp_model::structure::{MOST, Structure, Theta};
use serde::{Deserialize, Serialize};

/// Likelihood over d of one family; `points` in rising order of d, the first at d = 0.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Profile {
    pub(crate) structure: Structure,
    pub(crate) points: Vec<Point>,
    /// Place of the best point.
    pub(crate) best: usize,
}

/// A beginning of a profile: parameters, and the width that they go with.
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct Seed {
    pub(crate) theta: Theta,
    pub(crate) d: f64,
}

/// Gain of a step below which a descent of a whole profile ends [−2·ln L].
pub(crate) const FINE_TOLERANCE: f64 = 0.03;

/// Relative accuracy of the likelihood at a limit of the interval.
const NEAR: f64 = 0.1;

/// Rise of −2·ln L from one width to the next above which widths are looked at so many times nearer to each other.
const STEEP: f64 = 6.0;
const FINER: f64 = 10.0;

impl Profile {
    /// Profile over `widths` (rising), with all else of the valve as in `lost`. Each search begins from the neighbours on both
    /// sides, each fourth also from `seeds`, and each seed's own width from it; `rounds` and `enough` as in [`Search::descend`].
    pub(crate) fn over(
        search: &Search,
        widths: &[f64],
        lost: &BacklashModel,
        seeds: &[Seed],
        rounds: usize,
        enough: f64,
    ) -> Self {
        let at = |d: f64| BacklashModel { d, ..lost.clone() };
        let mut points: Vec<Point> = Vec::with_capacity(widths.len());
        for (i, &d) in widths.iter().enumerate() {
            let begins = |seed: &&Seed| i % 4 == 0 || seed.d == d;
            let mut beginnings: Vec<_> = seeds.iter().filter(begins).map(|seed| (seed.theta, at(d))).collect();
            if let Some(before) = points.last() {
                beginnings.push((before.theta, at(d)));
            }
            points.push(search.from(&beginnings, rounds, enough, f64::INFINITY));
        }
        for i in (0..points.len() - 1).rev() {
            let d = points[i].lost.d;
            let back = search.from(&[(points[i + 1].theta, at(d))], rounds, enough, points[i].cost);
            if back.cost < points[i].cost {
                points[i] = back;
            }
        }
        Self::of(search.structure, points)
    }

    /// Made from points in rising order of d.
    fn of(structure: Structure, points: Vec<Point>) -> Self {
        let mut profile = Self { structure, points, best: 0 };
        profile.find();
        profile
    }

    /// The point whose width is nearest to `d`.
    pub(crate) fn near(&self, d: f64) -> &Point {
        let off = |p: &&Point| (p.lost.d - d).abs();
        self.points.iter().min_by(|a, b| off(a).total_cmp(&off(b))).expect("a profile has points")
    }

    fn find(&mut self) {
        let cost = |i: &usize| self.points[*i].cost;
        self.best = (0..self.points.len()).min_by(|a, b| cost(a).total_cmp(&cost(b))).expect("a profile has points");
    }

    /// Whether the other's best point is of the same process.
    pub(crate) fn alike(&self, other: &Self) -> bool {
        let (here, there) = (&self.points[self.best], &other.points[other.best]);
        self.structure.alike(&here.theta, &there.theta)
    }

    pub(crate) fn least(&self) -> f64 {
        self.points[self.best].cost
    }

    /// Likelihood ratio −2·Δln L of no gap.
    pub(crate) fn lr_no_gap(&self) -> f64 {
        self.points[0].cost - self.least()
    }

    /// The least with what the family's parameters cost (Akaike).
    pub(crate) fn penalised(&self) -> f64 {
        self.least() + 2.0 * self.structure.parameters() as f64
    }

    /// The cost at a width, on a line between those beside it; None beyond the first and the last.
    pub(crate) fn interpolated_cost(&self, d: f64) -> Option<f64> {
        let after = self.points.partition_point(|p| p.lost.d < d);
        let right = self.points.get(after)?;
        if right.lost.d == d {
            return Some(right.cost);
        }
        let left = &self.points[after.checked_sub(1)?];
        let part = (d - left.lost.d) / (right.lost.d - left.lost.d);
        Some(left.cost + part * (right.cost - left.cost))
    }

    /// One more width, begun from the better of its neighbours.
    pub(crate) fn insert(&mut self, search: &Search, d: f64, rounds: usize) -> f64 {
        let after = self.points.partition_point(|p| p.lost.d < d);
        if self.points.get(after).is_some_and(|p| p.lost.d == d) {
            return self.points[after].cost;
        }
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|i| self.points.get(i));
        let better = near.min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("a profile has points");
        let lost = BacklashModel { d, ..better.lost.clone() };
        let point = search.from(&[(better.theta, lost)], rounds, 1e-3, f64::INFINITY);
        let cost = point.cost;
        self.points.insert(after, point);
        self.find();
        cost
    }

    /// One more width, begun from its neighbours and from `theta` as well.
    pub(crate) fn also(&mut self, search: &Search, theta: Theta, d: f64, rounds: usize) {
        self.insert(search, d, rounds);
        let point = self.points.iter_mut().find(|p| p.lost.d == d).expect("it was inserted");
        let other = search.from(&[(theta, point.lost.clone())], rounds, FINE_TOLERANCE, point.cost);
        if other.cost < point.cost {
            *point = other;
        }
        self.find();
    }

    /// Adds widths around each of the `most` deepest valleys until their neighbours stand `fine` apart.
    pub(crate) fn refine(&mut self, search: &Search, most: usize, fine: f64) {
        for _ in 0..12 {
            let least = self.least();
            let cost = |j: Option<usize>| j.and_then(|j| self.points.get(j)).map_or(f64::INFINITY, |p| p.cost);
            let valley = |i: &usize| cost(Some(*i)) <= cost(i.checked_sub(1)) && cost(Some(*i)) <= cost(Some(i + 1));
            let mut valleys: Vec<usize> = (0..self.points.len()).filter(valley).collect();
            valleys.sort_by(|a, b| self.points[*a].cost.total_cmp(&self.points[*b].cost));
            let deep = valleys.iter().take(most).filter(|i| self.points[**i].cost < least + 60.0);
            let new: Vec<f64> = deep.filter_map(|i| self.nearer(*i, fine)).collect();
            if new.is_empty() {
                break;
            }
            for d in new {
                self.insert(search, d, 6);
            }
        }
        let best = self.points[self.best].clone();
        let polished = search.from(&[(best.theta, best.lost.clone())], 12, 1e-5, f64::INFINITY);
        if polished.cost < best.cost {
            self.points[self.best] = polished;
        }
        // The neighbours may do better from there.
        for i in [0, self.best.saturating_sub(1), (self.best + 1).min(self.points.len() - 1)] {
            let Point { lost, cost, .. } = self.points[i].clone();
            let again = search.from(&[(self.points[self.best].theta, lost)], 12, 1e-3, cost);
            if again.cost < self.points[i].cost {
                self.points[i] = again;
            }
        }
        self.find();
    }

    /// A width that narrows the valley around point `i`; None where its neighbours stand `fine` apart.
    fn nearer(&self, i: usize, fine: f64) -> Option<f64> {
        let at = |j: usize| self.points.get(j).map(|p| (p.lost.d, p.cost));
        let (d, cost) = at(i)?;
        let (left, right) = (i.checked_sub(1).and_then(at), at(i + 1));
        let room = |beside: Option<(f64, f64)>| beside.map_or(0.0, |b| (b.0 - d).abs());
        let wide = if room(left) > room(right) { -room(left) } else { room(right) };
        let rises = |beside: Option<(f64, f64)>| beside.is_some_and(|b| b.1 - cost > STEEP);
        // A likelihood as sharp as that may have its bottom between.
        let fine = if wide.abs() <= 1.001 * fine && (rises(left) || rises(right)) { fine / FINER } else { fine };
        if wide.abs() <= 1.001 * fine {
            return None;
        }
        let (Some(left), Some(right)) = (left, right) else {
            return Some(d + wide / 2.0);
        };
        let (rise, fall) = ((right.1 - cost) / (right.0 - d), (cost - left.1) / (d - left.0));
        let bottom = (left.0 + d) / 2.0 - fall * (right.0 - left.0) / 2.0 / (rise - fall).max(1e-300);
        if room(Some(left)).max(room(Some(right))) > 8.0 * room(Some(left)).min(room(Some(right)))
            && (bottom - d).abs() > fine
        {
            Some(d + wide / 2.0)
        } else if (bottom - d).abs() > fine && bottom > left.0 + 0.5 * fine && bottom < right.0 - 0.5 * fine {
            Some(bottom)
        } else {
            Some(d + fine * wide.signum())
        }
    }

    /// The lowest and the highest width whose cost is within `rise` of `from`, to within `fine`; the highest is None where
    /// the profile stays low to its end.
    pub(crate) fn within(&mut self, search: &Search, from: f64, rise: f64, fine: f64) -> Option<(f64, Option<f64>)> {
        let limit = from + rise;
        let inside = |p: &Point| p.cost <= limit;
        let first = self.points.iter().position(inside)?;
        let last = self.points.iter().rposition(inside)?;
        let place = |i: usize| (self.points[i].lost.d, self.points[i].cost);
        let (lowest, highest) = (place(first), place(last));
        let (below, above) = (first.checked_sub(1).map(place), (last + 1 < self.points.len()).then(|| place(last + 1)));
        let low = below.map_or(lowest.0, |below| self.border(search, lowest, below, limit, fine));
        let high = above.map(|above| self.border(search, highest, above, limit, fine));
        Some((low, high))
    }

    /// Width at which the cost crosses `limit`, between a width and its cost inside and others outside.
    fn border(
        &mut self,
        search: &Search,
        mut inside: (f64, f64),
        mut outside: (f64, f64),
        limit: f64,
        fine: f64,
    ) -> f64 {
        let crossing = |inside: (f64, f64), outside: (f64, f64), edge: f64| {
            let share = ((limit - inside.1) / (outside.1 - inside.1)).clamp(edge, 1.0 - edge);
            inside.0 + share * (outside.0 - inside.0)
        };
        while (outside.0 - inside.0).abs() > fine {
            let d = crossing(inside, outside, 0.15);
            let cost = self.insert(search, d, 4);
            if (cost - limit).abs() < NEAR {
                return d;
            }
            if cost <= limit {
                inside = (d, cost);
            } else {
                outside = (d, cost);
            }
        }
        crossing(inside, outside, 0.0)
    }
}

/// Information ratio of the width, 0 to 1: the variance of the slope of ln L by d that equally spread, uncorrelated
/// innovations would give, over the one seen (Bartlett's window of 5 cells). Below 1 where the innovations are larger
/// just where d matters, as at the reversals of a valve that the model does not quite fit.
pub(crate) fn information_ratio(search: &Search, point: &Point, step: f64) -> f64 {
    let record: &Cells = search.record;
    let positions = record.positions(&point.lost);
    let (residual, others) = search.slopes(&point.theta, &positions);
    let moved = |by: f64| {
        let lost = BacklashModel { d: (point.lost.d + by).max(0.0), ..point.lost.clone() };
        search.at(&point.theta, &record.positions(&lost)).lane(0)
    };
    let (up, down) = (moved(step), moved(-step.min(point.lost.d)));
    let across = step + step.min(point.lost.d);
    let mut slope: Vec<f64> = up.iter().zip(&down).map(|(a, b)| (a - b) / across).collect();
    let k = others.len();
    let mut normal = [[0.0; MOST]; MOST];
    let mut by = [0.0; MOST];
    for i in 0..k {
        for j in 0..k {
            normal[i][j] = dot(&others[i], &others[j]);
        }
        normal[i][i] *= 1.0 + 1e-9;
        normal[i][i] += 1e-300;
        by[i] = dot(&others[i], &slope);
    }
    let part = solve(normal, by, k);
    for (other, part) in others.iter().zip(part) {
        for (s, o) in slope.iter_mut().zip(other) {
            *s -= part * o;
        }
    }
    let n = slope.len() as f64;
    let variance = dot(&residual, &residual) / n;
    let nominal = variance * dot(&slope, &slope);
    let score: Vec<f64> = slope.iter().zip(&residual).map(|(s, r)| s * r).collect();
    let mut seen = dot(&score, &score);
    for lag in 1..5 {
        seen += 2.0 * (1.0 - lag as f64 / 5.0) * dot(&score[lag..], &score[..score.len() - lag]);
    }
    if seen > nominal && nominal > 0.0 { nominal / seen } else { 1.0 }
}
