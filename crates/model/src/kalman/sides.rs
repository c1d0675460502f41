//! Statistics of a stretch from both sides: of the cells before a checkpoint and behind it, kept at checkpoints all
//! along.
//!
//! Changes of the load between two checkpoints are then judged by the cells between them (the two-filter form of the smoother, Fraser
//! and Potter 1969). Before a checkpoint stands the Kalman filter's foresight; behind it the likelihood of the states there,
//!
//! ```text
//! −2·ln L(x) = x'Λx − 2η'x + c + ln|…|
//! ```
//!
//! which goes back cell by cell: noise g·n takes Λg·g'Λ/(1 + g'Λg) from Λ, a transition makes F'ΛF of it, a sample of PV adds HH'.
//! To the filter it is as many more samples as there are states. The sums are those of [`Models::whiten`] but for rounding, and
//! for gains that count as still there.

use super::{Adding, GATHERED, Gain, LINES, LoadChange, Models, START, Sums};
use crate::lanes::{Lanes, Wide};
use crate::structure::Theta;
use pulp::{Simd, WithSimd};
use std::array;
use std::ops::Range;
use std::sync::Arc;

/// Cells from one checkpoint to the next.
const STRIDE: usize = 8;
/// Cells that are rather gone over again than made up for all along.
const NEARBY: usize = 32;
/// Most states of a model.
const MOST_STATES: usize = 5;
/// Fraction of itself below which a pivot of Λ counts as 0: nothing is known of that direction.
const UNTOLD: f64 = 1e-12;
/// Fraction by which statistics at a checkpoint may differ and still count as equal.
const SAME: f64 = 1e-10;

/// Statistics of the cells before a checkpoint: the covariance, the states of PV and of the answer, and the sums.
#[derive(Clone, Debug)]
struct Before {
    p: [[f64; MOST_STATES]; MOST_STATES],
    of_y: [f64; MOST_STATES],
    of_v: [f64; MOST_STATES],
    seen: usize,
    sums: [f64; 3],
    log_s: f64,
}

/// Statistics of the cells behind a checkpoint on the states there: Λ, η of PV and of the answer, c of both.
#[derive(Clone, Debug, Default)]
struct Behind {
    lambda: [[f64; MOST_STATES]; MOST_STATES],
    eta: [[f64; MOST_STATES]; 2],
    rest: [f64; 3],
    log_s: f64,
}

impl Before {
    /// Whether the states and their covariance are those.
    fn same<const N: usize>(&self, other: &Self) -> bool {
        alike::<N>(&self.p, &other.p) && [(&self.of_y, &other.of_y), (&self.of_v, &other.of_v)].into_iter().all(near)
    }
}

impl Behind {
    /// Whether the statistics of the states are equal.
    fn same<const N: usize>(&self, other: &Self) -> bool {
        alike::<N>(&self.lambda, &other.lambda) && self.eta.iter().zip(&other.eta).all(near)
    }
}

/// Whether two symmetric matrices are the same, given above their diagonals.
fn alike<const N: usize>(a: &[[f64; MOST_STATES]; MOST_STATES], b: &[[f64; MOST_STATES]; MOST_STATES]) -> bool {
    (0..N).all(|i| (i..N).all(|j| (a[i][j] - b[i][j]).powi(2) <= SAME * SAME * a[i][i] * a[j][j]))
}

/// Whether two columns agree within [`SAME`] of the largest element.
fn near((a, b): (&[f64; MOST_STATES], &[f64; MOST_STATES])) -> bool {
    let most = a.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= SAME * most)
}

/// A stretch under one model, as its changes stand.
#[derive(Clone, Debug)]
pub struct Sides {
    y: Arc<[f64]>,
    /// The positions, as late as they act.
    v: Vec<f64>,
    changes: Vec<LoadChange>,
    /// Statistics before each checkpoint; empty at first.
    before: Vec<Before>,
    behind: Vec<Behind>,
    /// Cells in which the changes were others when these were found.
    stale: Option<Range<usize>>,
    /// Cells after which the samples that tell the start are over.
    started: usize,
}

/// [`Sums`] and Σ ln S of a stretch.
#[derive(Clone, Copy, Debug, Default)]
pub struct Totals {
    /// Sums of the innovations.
    pub sums: Sums,
    /// Σ ln S.
    pub log_s: Lanes,
}

impl Sides {
    /// `y`: PV; `v`: the position that acts in each cell; `changes`: times of the changes [cells].
    pub fn new(y: Arc<[f64]>, v: Vec<f64>, changes: &[f64]) -> Self {
        let numbers = y.iter().enumerate().filter(|(_, y)| !y.is_nan());
        let started = numbers.map(|(k, _)| k + 1).nth(START - 1).unwrap_or(y.len());
        let changes = LoadChange::alike(changes);
        Self { y, v, changes, before: Vec::new(), behind: Vec::new(), stale: None, started }
    }

    /// Sets new changes, which differ from the last ones in these cells alone.
    pub fn change(&mut self, changes: &[f64], cells: &Range<usize>) {
        self.changes = LoadChange::alike(changes);
        let cells = self.stale.as_ref().map_or(cells.clone(), |stale| union(stale, cells));
        self.stale = Some(cells);
    }

    /// The last checkpoint.
    fn last(&self) -> usize {
        self.y.len().div_ceil(STRIDE)
    }

    /// The cell before which a checkpoint lies.
    fn cell(&self, checkpoint: usize) -> usize {
        (checkpoint * STRIDE).min(self.y.len())
    }

    /// The checkpoint from which the cells of other changes are gone over, and the checkpoint up to which.
    fn between(&self, cells: &Range<usize>) -> [usize; 2] {
        let to = (cells.end - 1).max(self.started).div_ceil(STRIDE).min(self.last());
        [(cells.start.saturating_sub(1) / STRIDE).min(to), to]
    }

    /// The changes between the checkpoints, in each of the lanes its own.
    fn gathered(&self, [from, to]: [usize; 2], tried: &[&[f64]]) -> Vec<LoadChange> {
        let there = self.cell(from) as f64..=self.cell(to) as f64;
        let within = tried.iter().map(|times| {
            let times = times.iter().copied();
            times.filter(|time| *time > *there.start() && *time <= *there.end()).collect::<Vec<f64>>()
        });
        LoadChange::gathered(within)
    }
}

/// Cells from the first of both to the last.
pub fn union(a: &Range<usize>, b: &Range<usize>) -> Range<usize> {
    a.start.min(b.start)..a.end.max(b.end)
}

/// Eight filters under way.
struct Going<S: Simd, const R: usize, const N: usize> {
    gain: Gain<S, R, N>,
    of_y: [Wide<S, R>; N],
    of_v: [Wide<S, R>; N],
    seen: usize,
    sums: Adding<S, R>,
    log_s: Wide<S, R>,
}

impl<S: Simd, const R: usize, const N: usize> Going<S, R, N> {
    #[inline(always)]
    fn before(&self) -> Before {
        let first = |x: &Wide<S, R>| x.lanes()[0];
        let mut before = Before {
            p: Default::default(),
            of_y: Default::default(),
            of_v: Default::default(),
            seen: self.seen,
            sums: [&self.sums.yy, &self.sums.yv, &self.sums.vv].map(first),
            log_s: first(&self.log_s),
        };
        for i in 0..N {
            (before.of_y[i], before.of_v[i]) = (first(&self.of_y[i]), first(&self.of_v[i]));
            for j in i..N {
                before.p[i][j] = first(&self.gain.p[i][j]);
            }
        }
        before
    }
}

/// [`Models::elsewhere`], a function of its own, which the compiler is done with sooner than with all of them in one.
struct Judging<'j, 't, S: Simd, const R: usize, const N: usize, const MORE: usize> {
    models: &'j Models<S, R, N, MORE>,
    asked: Asked<'j, 't>,
}

impl<S: Simd, const R: usize, const N: usize, const MORE: usize> WithSimd for Judging<'_, '_, S, R, N, MORE> {
    type Output = Totals;

    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> Totals {
        self.models.judged(self.asked)
    }
}

impl<S: Simd, const R: usize, const N: usize, const MORE: usize> Models<S, R, N, MORE> {
    /// The totals of a stretch in which the first model's changes are others in these cells, up to eight sets of them.
    pub(crate) fn elsewhere(&self, asked: Asked) -> Totals {
        Simd::vectorize(self.simd, Judging { models: self, asked })
    }

    /// Totals with changed loads, by the statistics of both sides.
    #[inline(always)]
    fn judged(&self, asked: Asked) -> Totals {
        let Asked { sides, cells, tried, .. } = asked;
        let both = sides.stale.as_ref().map_or(cells.clone(), |stale| union(stale, cells));
        let near_by = !sides.before.is_empty() && both.len() <= NEARBY;
        if !near_by {
            self.fill(sides);
        }
        let [from, to] = sides.between(if near_by { &both } else { cells });
        let mut going = self.resumed(&sides.before[from]);
        let changes = sides.gathered([from, to], tried);
        self.go_on(&mut going, sides.cell(from)..sides.cell(to), &sides.y, &sides.v, &changes);
        self.add_behind(&mut going, &sides.behind[to]);
        Totals { sums: going.sums.lanes(), log_s: going.log_s.lanes() }
    }

    /// Computes the statistics at each checkpoint: at all of them, or as far as they are stale.
    #[inline(always)]
    fn fill(&self, sides: &mut Sides) {
        let stale = sides.stale.take();
        if sides.before.is_empty() {
            self.begin(sides);
            self.fill_before(sides, 0, usize::MAX);
            self.fill_behind(sides, sides.last(), 0);
        } else if let Some(cells) = stale {
            let last = sides.last();
            let (first, end) = (cells.start.saturating_sub(1), cells.end - 1);
            self.fill_before(sides, first / STRIDE, end);
            self.fill_behind(sides, end.div_ceil(STRIDE).min(last), first);
        }
    }

    #[inline(always)]
    fn begin(&self, sides: &mut Sides) {
        let all = |x| Wide::all(self.simd, x);
        let (nothing, sums) = ([all(0.0); N], Adding::of(self.simd, &Sums::default()));
        let begun = Going { gain: self.start(), of_y: nothing, of_v: nothing, seen: 0, sums, log_s: all(0.0) };
        sides.before = vec![begun.before(); sides.last() + 1];
        sides.behind = vec![Behind::default(); sides.last() + 1];
    }

    /// Computes the statistics before each checkpoint behind this one; from the cell `settled` on only until they are
    /// as they were, but for the sums.
    #[inline(always)]
    fn fill_before(&self, sides: &mut Sides, checkpoint: usize, settled: usize) {
        let mut going = self.resumed(&sides.before[checkpoint]);
        for next in checkpoint + 1..=sides.last() {
            self.go_on(&mut going, sides.cell(next - 1)..sides.cell(next), &sides.y, &sides.v, &sides.changes);
            let (before, now) = (&sides.before[next], going.before());
            if sides.cell(next) >= settled && now.same::<N>(before) {
                let more: [f64; 3] = array::from_fn(|i| now.sums[i] - before.sums[i]);
                let log_s = now.log_s - before.log_s;
                for rest in &mut sides.before[next..] {
                    rest.sums.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
                    rest.log_s += log_s;
                }
                break;
            }
            sides.before[next] = now;
        }
    }

    /// Computes the statistics behind each checkpoint before this one.
    #[inline(always)]
    fn fill_behind(&self, sides: &mut Sides, checkpoint: usize, settled: usize) {
        let process = self.first();
        let mut going = Back::<N, MORE>::from(&sides.behind[checkpoint]);
        for next in (0..checkpoint).rev() {
            let cells = sides.cell(next)..sides.cell(next + 1);
            let at = sides.changes.partition_point(|change| change.cell <= cells.end);
            let mut changes = sides.changes[..at].iter().rev().peekable();
            for k in cells.clone().rev() {
                if let Some(change) = changes.next_if(|change| change.cell == k + 1) {
                    going.free(&self.noise_of(change));
                    if MORE != LINES {
                        self.blur_of(change).iter().for_each(|column| going.free(column));
                    }
                }
                going.back(&process, sides.y[k], sides.v[k]);
            }
            let (behind, now) = (&sides.behind[next], going.behind());
            if cells.start <= settled && now.same::<N>(behind) {
                let more: [f64; 3] = array::from_fn(|i| now.rest[i] - behind.rest[i]);
                let log_s = now.log_s - behind.log_s;
                for rest in &mut sides.behind[..=next] {
                    rest.rest.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
                    rest.log_s += log_s;
                }
                break;
            }
            sides.behind[next] = now;
        }
    }

    /// Columns whose outer products add up to the blur of a change of the first model.
    #[inline(always)]
    fn blur_of(&self, change: &LoadChange) -> [[f64; N]; N] {
        let size = change.variance[0];
        let blur = self.blur().map(|row| row.map(|x| size * x.lanes()[0]));
        let mut columns = [[0.0; N]; N];
        for j in 0..N {
            let rest = blur[j][j] - (0..j).map(|m| columns[m][j] * columns[m][j]).sum::<f64>();
            if rest <= 1e-9 * blur[j][j] {
                continue;
            }
            let pivot = rest.sqrt();
            for i in j..N {
                let sum: f64 = (0..j).map(|m| columns[m][i] * columns[m][j]).sum();
                columns[j][i] = (blur[j][i] - sum) / pivot;
            }
        }
        columns
    }

    /// Effect of a change of the first model on each of the states.
    #[inline(always)]
    fn noise_of(&self, change: &LoadChange) -> [f64; N] {
        let size = change.variance[0].sqrt();
        self.reached(Wide::load(self.simd, &change.before)).map(|reached| size * reached.lanes()[0])
    }

    /// A pass from a checkpoint on, with the first model in all lanes.
    #[inline(always)]
    fn resumed(&self, before: &Before) -> Going<S, R, N> {
        let all = |x| Wide::all(self.simd, x);
        let mut gain = self.start();
        for i in 0..N {
            for j in i..N {
                gain.p[i][j] = all(before.p[i][j]);
            }
        }
        self.measure(&mut gain);
        let [yy, yv, vv] = before.sums.map(all);
        let of = |x: &[f64; MOST_STATES]| array::from_fn(|i| all(x[i]));
        let (of_y, of_v) = (of(&before.of_y), of(&before.of_v));
        Going { gain, of_y, of_v, seen: before.seen, sums: Adding { yy, yv, vv }, log_s: all(before.log_s) }
    }

    /// Over these cells, as [`Models::whiten`] goes where gains move; of the changes those within them.
    #[inline(always)]
    fn go_on(&self, going: &mut Going<S, R, N>, cells: Range<usize>, y: &[f64], v: &[f64], changes: &[LoadChange]) {
        let all = |x| Wide::all(self.simd, x);
        let Going { gain, of_y, of_v, seen, sums, log_s } = going;
        let mut changes = changes[changes.partition_point(|change| change.cell <= cells.start)..].iter().peekable();
        let (mut product, mut gathered) = (all(1.0), 0);
        for k in cells {
            let change = changes.next_if(|change| change.cell == k + 1);
            let v = Some(all(v[k]));
            gain.thaw();
            if y[k].is_nan() {
                self.advance(gain, true, change);
                self.pass(of_y, None);
                self.pass(of_v, v);
                continue;
            }
            let (e_y, e_v) = (self.unforeseen(of_y, y[k]), self.unforeseen(of_v, 0.0));
            let worth = if *seen < START { all(0.0) } else { gain.scale };
            *seen += 1;
            sums.add(worth * e_y, all(-1.0) * worth * e_v);
            if *seen > START {
                product *= gain.s;
                gathered += 1;
                if gathered == GATHERED {
                    *log_s += product.each(f64::ln);
                    (product, gathered) = (all(1.0), 0);
                }
            }
            self.advance(gain, false, change);
            self.step(of_y, &gain.l, e_y, None);
            self.step(of_v, &gain.l, e_v, v);
        }
        *log_s += product.each(f64::ln);
    }

    /// Adds the cells behind, as samples h'x + e = z with Λ = Σ hh' and η = Σ hz, and the part of it that no state
    /// explains.
    #[inline(always)]
    fn add_behind(&self, going: &mut Going<S, R, N>, behind: &Behind) {
        let all = |x| Wide::all(self.simd, x);
        let mut lambda = behind.lambda;
        let mut eta = behind.eta;
        let [mut yy, mut yv, mut vv] = behind.rest;
        let (p, of_y, of_v) = (&mut going.gain.p, &mut going.of_y, &mut going.of_v);
        let mut product = all(1.0);
        for i in 0..N {
            if lambda[i][i] <= UNTOLD * behind.lambda[i][i] {
                continue;
            }
            let pivot = lambda[i][i].sqrt();
            let mut h = [0.0; N];
            for j in i..N {
                h[j] = lambda[i][j] / pivot;
            }
            let [z_y, z_v] = eta.map(|eta| eta[i] / pivot);
            for j in i + 1..N {
                for m in j..N {
                    lambda[j][m] -= h[j] * h[m];
                }
                (eta[0][j], eta[1][j]) = (eta[0][j] - h[j] * z_y, eta[1][j] - h[j] * z_v);
            }
            (yy, yv, vv) = (yy - z_y * z_y, yv - z_y * z_v, vv - z_v * z_v);
            // Update as by a sample of PV.
            let mut ph = [all(0.0); N];
            let (mut s, mut e_y, mut e_v) = (all(1.0), all(z_y), all(z_v));
            for j in 0..N {
                for m in i..N {
                    ph[j] += all(h[m]) * if j < m { p[j][m] } else { p[m][j] };
                }
                if j >= i {
                    s += all(h[j]) * ph[j];
                    (e_y, e_v) = (e_y - all(h[j]) * of_y[j], e_v - all(h[j]) * of_v[j]);
                }
            }
            let l = ph.map(|ph| ph / s);
            for j in 0..N {
                for m in j..N {
                    p[j][m] -= l[j] * ph[m];
                }
                (of_y[j], of_v[j]) = (of_y[j] + l[j] * e_y, of_v[j] + l[j] * e_v);
            }
            let worth = (all(1.0) / s).sqrt();
            going.sums.add(worth * e_y, all(-1.0) * worth * e_v);
            product *= s;
        }
        let Adding { yy: of_yy, yv: of_yv, vv: of_vv } = &mut going.sums;
        // The answer enters with the other sign.
        (*of_yy, *of_yv, *of_vv) = (*of_yy + all(yy), *of_yv - all(yv), *of_vv + all(vv));
        going.log_s += product.each(f64::ln) + all(behind.log_s);
    }

    #[inline(always)]
    fn first(&self) -> Process<N> {
        let first = |x: &Wide<S, R>| x.lanes()[0];
        let transition = array::from_fn(|i| array::from_fn(|j| first(&self.transition[i][j])));
        let q_more = if MORE == LINES { first(&self.q_more) } else { 0.0 };
        Process { transition, q_load: first(&self.q_load), q_more, pole: first(&self.pole) }
    }
}

/// The first of the models; of the transition the rows of the process count.
struct Process<const N: usize> {
    transition: [[f64; N]; N],
    q_load: f64,
    q_more: f64,
    pole: f64,
}

/// [`Behind`] on the way back, all of Λ.
struct Back<const N: usize, const MORE: usize> {
    lambda: [[f64; N]; N],
    eta: [[f64; N]; 2],
    rest: [f64; 3],
    log_s: f64,
    /// Factor whose logarithm log_s grows by.
    grown: f64,
}

impl<const N: usize, const MORE: usize> Back<N, MORE> {
    const ORDER: usize = N - 1 - (MORE == LINES) as usize;
    const LOAD: usize = Self::ORDER;
    const LAST: usize = N - 1;

    #[inline(always)]
    fn from(behind: &Behind) -> Self {
        let lambda = array::from_fn(|i| array::from_fn(|j| behind.lambda[i.min(j)][i.max(j)]));
        let eta = behind.eta.map(|eta| array::from_fn(|i| eta[i]));
        Self { lambda, eta, rest: behind.rest, log_s: behind.log_s, grown: 1.0 }
    }

    /// Statistics at a checkpoint.
    #[inline(always)]
    fn behind(&mut self) -> Behind {
        self.log_s += std::mem::replace(&mut self.grown, 1.0).ln();
        let mut behind = Behind { rest: self.rest, log_s: self.log_s, ..Behind::default() };
        for i in 0..N {
            behind.lambda[i][..N].copy_from_slice(&self.lambda[i]);
            (behind.eta[0][i], behind.eta[1][i]) = (self.eta[0][i], self.eta[1][i]);
        }
        behind
    }

    /// Noise of variance 1 that reaches the states so is free.
    #[inline(always)]
    fn free(&mut self, reached: &[f64; N]) {
        let mut by = [0.0; N];
        let (mut s, mut of_y, mut of_v) = (1.0, 0.0, 0.0);
        for i in 0..N {
            for j in 0..N {
                by[i] += reached[j] * self.lambda[i][j];
            }
            s += reached[i] * by[i];
            of_y += reached[i] * self.eta[0][i];
            of_v += reached[i] * self.eta[1][i];
        }
        self.less(&by, [of_y, of_v], 1.0, s);
    }

    /// Update for noise of one state, of this variance.
    #[inline(always)]
    fn free_state(&mut self, state: usize, variance: f64) {
        let by = self.lambda[state];
        let [of_y, of_v] = self.eta.map(|eta| eta[state]);
        self.less(&by, [of_y, of_v], variance, 1.0 + variance * by[state]);
    }

    /// Takes Λg·g'Λ·q/s from Λ, and the parts that go with it from η and the sums of squares.
    #[inline(always)]
    fn less(&mut self, by: &[f64; N], [of_y, of_v]: [f64; 2], q: f64, s: f64) {
        let part = q / s;
        for i in 0..N {
            let less = by[i] * part;
            for j in 0..N {
                self.lambda[i][j] -= less * by[j];
            }
            self.eta[0][i] -= less * of_y;
            self.eta[1][i] -= less * of_v;
        }
        self.rest[0] -= of_y * of_y * part;
        self.rest[1] -= of_y * of_v * part;
        self.rest[2] -= of_v * of_v * part;
        self.grown *= s;
    }

    /// F'x.
    #[inline(always)]
    fn transposed(process: &Process<N>, x: &[f64; N]) -> [f64; N] {
        let f = &process.transition;
        let mut before = [0.0; N];
        for j in 0..=Self::LOAD {
            for m in 0..Self::ORDER {
                before[j] += f[m][j] * x[m];
            }
        }
        before[Self::LOAD] += x[Self::LOAD];
        if MORE == LINES {
            before[Self::LAST] = process.pole * x[Self::LAST] + x[Self::LOAD];
        }
        before
    }

    /// A cell back.
    #[inline(always)]
    fn back(&mut self, process: &Process<N>, y: f64, v: f64) {
        self.free_state(Self::LOAD, process.q_load);
        if MORE == LINES {
            self.free_state(Self::LAST, process.q_more);
        }
        // Effect of the position.
        let input: [f64; N] =
            array::from_fn(|i| if i < Self::ORDER { v * process.transition[i][Self::LOAD] } else { 0.0 });
        let mut of_v = self.eta[1];
        for i in 0..N {
            for j in 0..Self::ORDER {
                of_v[i] -= self.lambda[i][j] * input[j];
            }
        }
        for i in 0..Self::ORDER {
            self.rest[1] -= self.eta[0][i] * input[i];
            self.rest[2] -= (self.eta[1][i] + of_v[i]) * input[i];
        }
        // F'ΛF, and F'η.
        let half = self.lambda.map(|row| Self::transposed(process, &row));
        for i in 0..N {
            let column = array::from_fn(|m| half[m][i]);
            self.lambda[i] = Self::transposed(process, &column);
        }
        self.eta = [Self::transposed(process, &self.eta[0]), Self::transposed(process, &of_v)];
        if !y.is_nan() {
            self.lambda[0][0] += 1.0;
            self.eta[0][0] += y;
            self.rest[0] += y * y;
        }
    }
}

/// Other changes of a stretch, which differ from its own in these cells alone.
pub struct Asked<'s, 't> {
    /// The stretch.
    pub sides: &'s mut Sides,
    /// Its model.
    pub theta: &'s Theta,
    /// Cells in which the changes differ.
    pub cells: &'s Range<usize>,
    /// Times of all changes of the stretch [cells], up to eight sets of them.
    pub tried: &'s [&'t [f64]],
}
