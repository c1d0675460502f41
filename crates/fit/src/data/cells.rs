//! The record as the fit sees it: even steps, gathered into cells.

use crate::data::backlash_model::BacklashModel;
use crate::data::segment::spread;
use crate::decide::thresholds::FEWEST_SWINGS;
use glapp_core::{Backlash, BacklashState, Friction, FrictionState, Real};
use glapp_model::kalman::START;
use glapp_model::lanes::{LANES, Lanes};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// One unbroken stretch: OP at every step, PV as the mean of each cell of `cell` steps, NaN where there is none.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Strip {
    pub(crate) y: Arc<[f64]>,
    u: Arc<[f64]>,
    /// Times of changes of the load [cells].
    pub(crate) changes: Vec<f64>,
    /// A load that is known, a mean for each cell [OP unit]; empty for none.
    load: Vec<f64>,
    /// Cells before it, from the beginning of the record.
    pub(crate) since: f64,
    /// Index of its part among those given.
    pub(crate) part: usize,
}

/// A record cut into stretches and cells.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Cells {
    pub(crate) stretches: Vec<Strip>,
    /// Steps in a cell.
    pub(crate) cell: usize,
    /// Cells whose PV is a number.
    pub(crate) count: usize,
    /// Widest move of OP within one stretch [OP unit].
    pub(crate) range: f64,
    /// Widest move of PV within one stretch [PV unit].
    pub(crate) span: f64,
}

/// Position of the valve, a mean for each cell of each stretch.
pub(crate) type Positions = Vec<Vec<f64>>;

impl Cells {
    /// `parts`: PV and OP at even steps, one pair for each unbroken stretch; OP without NaN.
    pub(crate) fn new(parts: &[(&[f64], &[f64])], cell: usize) -> Self {
        let before: Vec<f64> = parts
            .iter()
            .scan(0, |sum, (y, _)| Some(std::mem::replace(sum, *sum + y.len()) as f64 / cell as f64))
            .collect();
        let stretches: Vec<Strip> = parts
            .iter()
            .enumerate()
            .map(|(part, (y, u))| {
                let cells = y.len() / cell;
                let mean = |part: &[f64]| {
                    let (sum, n) = part.iter().filter(|y| !y.is_nan()).fold((0.0, 0), |(s, n), y| (s + y, n + 1));
                    if 2 * n > cell { sum / f64::from(n as u32) } else { f64::NAN }
                };
                Strip {
                    y: y[..cells * cell].chunks(cell).map(mean).collect(),
                    u: u[..cells * cell].into(),
                    changes: Vec::new(),
                    load: Vec::new(),
                    since: before[part],
                    part,
                }
            })
            .filter(|s| s.y.iter().filter(|y| !y.is_nan()).count() > 20)
            .collect();
        let count = stretches.iter().flat_map(|s| &*s.y).filter(|y| !y.is_nan()).count();
        let range = stretches.iter().map(|s| span(&s.u)).fold(0.0, f64::max);
        let of_pv = |s: &Strip| span(&s.y.iter().copied().filter(|y| !y.is_nan()).collect::<Vec<_>>());
        let span = stretches.iter().map(of_pv).fold(0.0, f64::max);
        Self { stretches, cell, count, range, span }
    }

    /// Cells of PV that count: those that tell where a stretch starts and how far a load jumped are worth nothing.
    pub(crate) fn freedom(&self) -> f64 {
        (self.count - START * self.stretches.len() - self.changes()) as f64
    }

    /// Jumps of the load that are marked.
    pub(crate) fn changes(&self) -> usize {
        self.stretches.iter().map(|s| s.changes.len()).sum()
    }

    /// Whether the same changes are marked in both.
    pub(crate) fn same_changes(&self, other: &Self) -> bool {
        let sorted = |s: &Strip| {
            let mut changes = s.changes.clone();
            changes.sort_by(f64::total_cmp);
            changes
        };
        self.stretches.iter().map(sorted).eq(other.stretches.iter().map(sorted))
    }

    /// Residuals of all cells that count, each at its cell of its stretch, 0 where PV is none.
    pub(crate) fn by_stretch(&self, residual: &[f64]) -> Vec<Vec<f64>> {
        let mut next = residual.iter();
        let mut of = |y: &f64| if y.is_nan() { 0.0 } else { *next.next().expect("one for each number") };
        self.stretches.iter().map(|s| s.y.iter().map(&mut of).collect()).collect()
    }

    /// The record without a mark.
    pub(crate) fn unmarked(&self) -> Self {
        self.with_changes(vec![Vec::new(); self.stretches.len()])
    }

    /// The record with other changes of the load.
    pub(crate) fn with_changes(&self, changes: Vec<Vec<f64>>) -> Self {
        let stretches = self.stretches.iter().zip(changes).map(|(s, changes)| Strip { changes, ..s.clone() }).collect();
        Self { stretches, ..*self }
    }

    /// The record with a load that is known.
    pub(crate) fn with_load(&self, load: Positions) -> Self {
        let stretches = self.stretches.iter().zip(load).map(|(s, load)| Strip { load, ..s.clone() }).collect();
        Self { stretches, ..*self }
    }

    /// Cells of the longest stretch.
    pub(crate) fn longest(&self) -> usize {
        self.stretches.iter().map(|s| s.y.len()).max().unwrap_or(0)
    }

    /// The record with another PV.
    pub(crate) fn with(&self, ys: Vec<Vec<f64>>) -> Self {
        let stretches = self.stretches.iter().zip(ys).map(|(s, y)| Strip { y: y.into(), ..s.clone() }).collect();
        Self { stretches, ..*self }
    }

    /// Position of the valve, a mean for each cell.
    pub(crate) fn positions(&self, lost: &BacklashModel) -> Positions {
        let at = |(stretch, start): (&Strip, &f64)| stretch.positions(lost, *start, self.cell, stretch.y.len());
        self.stretches.iter().zip(&lost.start).map(at).collect()
    }

    /// Moves of OP from each step to the next [OP unit].
    fn moves(&self) -> impl Iterator<Item = f64> + '_ {
        self.stretches.iter().flat_map(|s| s.u.windows(2).map(|w| (w[1] - w[0]).abs()))
    }

    /// Half of the median move of OP from one step to the next [OP unit]: where between two steps it turned is not known,
    /// and how far the valve followed is not known better than that. Nothing where OP mostly stands still: its steps are
    /// seen. Turns that are missed make a gap look narrower, at both of its ends.
    pub(crate) fn resolution(&self) -> f64 {
        let mut moves: Vec<f64> = self.moves().collect();
        moves.sort_by(f64::total_cmp);
        moves.get(moves.len() / 2).map_or(0.0, |m| m / 2.0)
    }

    /// Mean travel of OP in a step, up and down [OP unit].
    pub(crate) fn travel(&self) -> f64 {
        self.moves().sum::<f64>() / self.stretches.iter().map(|s| s.u.len()).sum::<usize>() as f64
    }

    /// Standard deviation of Kp·OP, part of that of PV.
    pub(crate) fn cancels(&self, kp: f64) -> f64 {
        let op = spread(self.stretches.iter().flat_map(|s| s.u.iter().copied()));
        let pv = spread(self.stretches.iter().flat_map(|s| s.y.iter().copied()));
        kp.abs() * op / pv.max(1e-300)
    }

    /// Largest travel of the valve within a stretch [OP unit].
    pub(crate) fn reach(&self, lost: &BacklashModel) -> f64 {
        self.positions(lost).iter().map(|v| span(v)).fold(0.0, f64::max)
    }

    /// Times that OP goes through the whole of a gap of width `d` up, and down.
    pub(crate) fn traversals(&self, d: f64) -> [usize; 2] {
        let each = self.stretches.iter().map(|s| crossings(&s.u, d).map(|steps| steps.len()));
        each.fold([0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
    }

    /// Mean time from one traversal of `d` to the next the same way [steps], and its standard deviation, part of it; None where
    /// there are fewer than [`FEWEST_SWINGS`].
    pub(crate) fn swing(&self, d: f64) -> Option<(f64, f64)> {
        let ways = self.stretches.iter().flat_map(|s| crossings(&s.u, d));
        let times: Vec<f64> =
            ways.flat_map(|steps| steps.windows(2).map(|w| (w[1] - w[0]) as f64).collect::<Vec<_>>()).collect();
        let n = times.len() as f64;
        let mean = times.iter().sum::<f64>() / n;
        let variance = times.iter().map(|t| (t - mean) * (t - mean)).sum::<f64>() / n;
        (times.len() >= FEWEST_SWINGS).then_some((mean, variance.sqrt() / mean))
    }
}

impl Strip {
    /// Positions of the valve in the first `cells` of one stretch, whose start in the gap is `start`.
    pub(crate) fn positions(&self, lost: &BacklashModel, start: f64, cell: usize, cells: usize) -> Vec<f64> {
        let (d, jump) = (lost.d, lost.jump());
        // The start is told by where the lower end of the gap lies.
        let first = self.u[0] + (start - 0.5) * d;
        if jump > 0.0 {
            let friction = Friction::new(lost.model, d, jump).expect("0 ≤ jump ≤ d");
            let mut state = FrictionState::at(first);
            self.means(cell, cells, |u| friction.update(&mut state, u))
        } else {
            let gap = Backlash::new(d).expect("d ≥ 0");
            let mut state = BacklashState::at(first);
            self.means(cell, cells, |u| gap.update(&mut state, u))
        }
    }

    /// The mean of a path over each cell, the known load with it.
    fn means(&self, cell: usize, cells: usize, mut path: impl FnMut(f64) -> f64) -> Vec<f64> {
        let (u, per_cell) = (&self.u[..cells * cell], 1.0 / cell as f64);
        let mut means: Vec<f64> = if cell == 1 {
            u.iter().map(|&u| path(u)).collect()
        } else {
            u.chunks_exact(cell).map(|u| u.iter().map(|&u| path(u)).sum::<f64>() * per_cell).collect()
        };
        means.iter_mut().zip(&self.load).for_each(|(mean, load)| *mean += load);
        means
    }

    /// Positions of the valve from any eight starts at once.
    pub(crate) fn positions_from(
        &self,
        lost: &BacklashModel,
        cell: usize,
        cells: usize,
    ) -> impl Fn(&Lanes) -> Vec<Lanes> {
        let (mut low, mut high) = (Vec::new(), Vec::new());
        if lost.jump() == 0.0 {
            // A gap holds what it is given between two limits, and so does one sample after the other: between the paths from its
            // lower and its upper end.
            let gap = Backlash::new(lost.d).expect("d ≥ 0");
            let path = |start: f64| -> Vec<f64> {
                let mut state = BacklashState::at(self.u[0] + (start - 0.5) * lost.d);
                self.u[..cells * cell].iter().map(|&u| gap.update(&mut state, u)).collect()
            };
            (low, high) = (path(0.0), path(1.0));
        }
        move |starts| {
            let mut all = vec![Lanes::default(); cells];
            if lost.jump() > 0.0 {
                for (l, start) in starts.iter().enumerate() {
                    let of_lane = self.positions(lost, *start, cell, cells);
                    all.iter_mut().zip(of_lane).for_each(|(all, v)| all[l] = v);
                }
                return all;
            }
            let (first, per_cell) = (Lanes::each(|l| self.u[0] + (starts[l] - 0.5) * lost.d), 1.0 / cell as f64);
            let load = self.load.iter().copied().chain(std::iter::repeat(0.0));
            for (((all, low), high), load) in all.iter_mut().zip(low.chunks(cell)).zip(high.chunks(cell)).zip(load) {
                for (low, high) in low.iter().zip(high) {
                    for l in 0..LANES {
                        all[l] += first[l].greater(*low).lesser(*high);
                    }
                }
                for l in 0..LANES {
                    all[l] = all[l] * per_cell + load;
                }
            }
            all
        }
    }

    /// Cells until OP has moved by `d`, from where on the start in the gap no longer shows.
    pub(crate) fn open(&self, d: f64, cell: usize) -> usize {
        let (mut low, mut high) = (self.u[0], self.u[0]);
        let moved = self.u.iter().position(|&u| {
            low = low.min(u);
            high = high.max(u);
            high - low >= d
        });
        moved.unwrap_or(self.u.len()) / cell
    }

    /// Move of OP from one cell to another [OP unit].
    pub(crate) fn moved(&self, from: usize, to: usize, cell: usize) -> f64 {
        self.u[to * cell] - self.u[from * cell]
    }

    /// OP at each step [OP unit].
    pub(crate) fn op(&self) -> &[f64] {
        &self.u
    }
}

/// Steps at which OP has gone through the whole of a gap of width `d` up, and down.
pub(crate) fn crossings(op: &[f64], d: f64) -> [Vec<usize>; 2] {
    let (mut low, mut high, mut way) = (op[0], op[0], 0);
    let mut steps = [Vec::new(), Vec::new()];
    for (k, &u) in op.iter().enumerate() {
        low = low.min(u);
        high = high.max(u);
        if way != 1 && u - low >= d {
            (way, high) = (1, u);
            steps[0].push(k);
        } else if way != -1 && high - u >= d {
            (way, low) = (-1, u);
            steps[1].push(k);
        }
    }
    steps
}

fn span(u: &[f64]) -> f64 {
    u.iter().fold(f64::MIN, |a, &b| a.max(b)) - u.iter().fold(f64::MAX, |a, &b| a.min(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glapp_core::Model;

    #[test]
    fn eight_starts_at_once_are_each_what_one_is() {
        let u: Vec<f64> = (0..120).map(|k| (f64::from(k) * 0.37).sin() + 0.01 * f64::from(k)).collect();
        let record = Cells::new(&[(&u, &u)], 3).with_load(vec![vec![0.25; 40]]);
        let stretch = &record.stretches[0];
        let places = Lanes::each(|l| l as f64 / 7.0);
        for (d, share) in [(0.0, 0.0), (0.3, 0.0), (1.7, 0.0), (5.0, 0.0), (0.4, 0.5)] {
            let lost = BacklashModel { d, share, model: Model::Kano, start: vec![0.5] };
            let all = stretch.positions_from(&lost, 3, 40)(&places);
            for (l, place) in places.iter().enumerate() {
                let alone = stretch.positions(&lost, *place, 3, 40);
                let bits = |v: &[f64]| v.iter().map(|v| v.to_bits()).collect::<Vec<u64>>();
                let lane: Vec<f64> = all.iter().map(|all| all[l]).collect();
                assert_eq!(bits(&lane), bits(&alone), "d {d}, start {place}");
            }
        }
    }
}
