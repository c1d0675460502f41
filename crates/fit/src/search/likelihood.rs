//! The likelihood of one family and its maximum for a given lost motion.

use crate::data::cells::{Cells, Positions, Strip};
use crate::model::backlash_model::BacklashModel;
use crate::model::kalman::{Asked, Delayed, LoadChange, Sides, Sums, Totals, UNKNOWN, Whitened, union};
use crate::model::lanes::{LANES, Lanes, Wide, Work, wide_enough, widest};
use crate::model::structure::{MOST, Noise, Structure, Theta};
use pulp::Simd;
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::f64::consts::PI;
use std::ops::Range;
use std::sync::Arc;

/// A point of the search: the family's parameters and what they are worth.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Point {
    pub(crate) theta: Theta,
    /// −2·ln L but for a constant, the size of the noise and the gain at their best.
    pub(crate) cost: f64,
    /// Static gain (of an integrating process: velocity gain a cell) [PV unit / OP unit].
    pub(crate) kp: f64,
    pub(crate) lost: BacklashModel,
    /// Variance of the white noise on PV [PV unit²].
    noise: f64,
    /// Σ ε_y·ε_v/S and Σ ε_v²/S, of which the gain is the ratio.
    products: (f64, f64),
}

/// What the likelihood is made of: `residual` = innovation/√S·exp(Σ ln S/2n), whose sum of squares is to be least.
#[derive(Clone, Debug, Default)]
pub(crate) struct Innovations {
    pub(crate) residual: Vec<Lanes>,
    pub(crate) kp: Lanes,
    sums: Sums,
    pub(crate) sum: Lanes,
    /// Sum of squares with gain 0: what the disturbance alone explains.
    pub(crate) sum_without: Lanes,
    /// exp(Σ ln S/2n).
    pub(crate) scale: Lanes,
    /// Σ Δᵢ·Δ for every lane i, where Δ is the residual of the first lane and what it is more in each other.
    products: [Lanes; LANES],
}

impl Innovations {
    pub(crate) fn lane(&self, lane: usize) -> Vec<f64> {
        self.residual.iter().map(|r| r[lane]).collect()
    }
}

/// What a pass is made for.
#[derive(Clone, Copy, PartialEq)]
enum Wanted {
    /// The sums of the innovations of PV and of the answer.
    Sums,
    /// The sum of the squares of the residuals.
    Least,
    /// Every residual.
    Residuals,
    /// The products of the residuals.
    Products,
}

/// Room for one pass, kept from one to the next.
#[derive(Default)]
struct Workspace {
    delayed: Vec<Lanes>,
    shifted: Vec<f64>,
    /// Jumps of each stretch.
    changes: Vec<Vec<LoadChange>>,
    /// Where a descent begins, and where it has come to: the next often begins at one of them.
    kept: [Kept; 2],
    /// Which of them the last pass has left.
    last: usize,
    found: Innovations,
}

/// What a pass has left.
#[derive(Default)]
struct Kept {
    white: Whitened,
    /// What its gains are of, where they are of the record's own changes.
    known: Option<Known>,
}

impl Workspace {
    fn white(&self) -> &Whitened {
        &self.kept[self.last].white
    }

    /// Where the gains of these models are kept.
    fn place_of(&self, search: &Search, thetas: &[Theta; LANES], lanes: usize) -> Option<usize> {
        self.kept.iter().position(|kept| kept.known.as_ref().is_some_and(|known| known.holds(search, thetas, lanes)))
    }
}

/// Where a pass leaves what no pass before has left.
const BEGUN: usize = 0;
const DESCENDED: usize = 1;

/// What the gains of a pass and the innovations of PV hang on: PV, the changes of the load, and the models but for their dead time,
/// which is the answer's alone.
struct Known {
    structure: Structure,
    thetas: [Theta; LANES],
    /// How many of them count.
    lanes: usize,
    /// Of each stretch its PV, which is the same only as itself, and its changes.
    stretches: Vec<(Arc<[f64]>, Vec<f64>)>,
}

impl Known {
    fn new(search: &Search, thetas: &[Theta; LANES], lanes: usize) -> Self {
        let stretches = search.record.stretches.iter().map(|s| (s.y.clone(), s.changes.clone())).collect();
        Self { structure: search.structure, thetas: *thetas, lanes, stretches }
    }

    /// Whether the first so many models are these.
    fn holds(&self, search: &Search, thetas: &[Theta; LANES], lanes: usize) -> bool {
        let Search { record, structure, .. } = search;
        let dead = structure.dead_time_at();
        let alike = |(a, b): (&Theta, &Theta)| (0..MOST).all(|i| i == dead || a[i] == b[i]);
        let same = |((y, changes), s): (&(Arc<[f64]>, Vec<f64>), &Strip)| Arc::ptr_eq(y, &s.y) && *changes == s.changes;
        self.structure == *structure
            && self.lanes >= lanes
            && self.thetas.iter().zip(thetas).all(alike)
            && self.stretches.len() == record.stretches.len()
            && self.stretches.iter().zip(&record.stretches).all(same)
    }
}

/// Cells in which a slope of the load may go through OP's range.
const LONG: f64 = 100.0;

/// Cells after which what the filter was told at first is forgotten.
const SETTLED: usize = 100;

thread_local! {
    static WORKSPACE: RefCell<Workspace> = RefCell::default();
}

/// One family on one record. `sign`: that of the gain where it is known, else 0.
#[derive(Clone, Copy)]
pub(crate) struct Search<'a> {
    pub(crate) record: &'a Cells,
    pub(crate) structure: Structure,
    pub(crate) sign: f64,
}

/// The gain that makes the least of Σ r², not of the other sign.
fn gain(yv: f64, vv: f64, sign: f64) -> f64 {
    let kp = if vv > 1e-300 { yv / vv } else { 0.0 };
    if kp * sign < 0.0 { 0.0 } else { kp }
}

/// Σ r² of each lane, and the first rows of [`Innovations::products`].
#[inline(always)]
fn products<S: Simd, const R: usize, const ROWS: usize>(
    simd: S,
    residuals: impl Iterator<Item = Wide<S, R>>,
    sum: &mut Wide<S, R>,
    products: &mut [Lanes; LANES],
) {
    let mut rows = [Wide::all(simd, 0.0); ROWS];
    let first = Wide::load(simd, &Lanes::each(|l| if l == 0 { 0.0 } else { 1.0 }));
    for r in residuals {
        *sum += r * r;
        let more = r - first * Wide::all(simd, r.lanes()[0]);
        let each = more.lanes();
        for (row, of) in rows.iter_mut().zip(each.iter()) {
            *row += Wide::all(simd, *of) * more;
        }
    }
    products.iter_mut().zip(rows).for_each(|(product, row)| *product = row.lanes());
}

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

/// A pass over a record: eight sets of parameters at once, of which the first so many `lanes` count.
struct Pass<'r, 's> {
    search: &'s Search<'s>,
    workspace: &'r mut Workspace,
    thetas: &'s [Theta; LANES],
    lanes: usize,
    /// The positions for a lane in a stretch.
    positions: &'s dyn Fn(usize, usize) -> &'s [f64],
    wanted: Wanted,
    /// [`BEGUN`] or [`DESCENDED`].
    place: usize,
}

impl Work for Pass<'_, '_> {
    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, simd: S) {
        let Self { search, workspace, thetas, lanes, positions, wanted, place } = self;
        let Search { record, structure, .. } = search;
        let stretches = 0..record.stretches.len();
        let delay = Lanes::each(|l| search.delay(&thetas[l]));
        // Most lanes differ in something else.
        let same = |i: usize| (1..LANES).all(|l| std::ptr::eq(positions(l, i), positions(0, i)));
        let together = delay.iter().all(|d| d.floor() == delay[0].floor()) && stretches.clone().all(same);
        let part = Lanes::each(|l| delay[l] - delay[l].floor());
        workspace.delayed.clear();
        workspace.shifted.clear();
        for i in stretches.clone() {
            if together {
                shift(positions(0, i), delay[0], &mut workspace.shifted);
                continue;
            }
            let from = workspace.delayed.len();
            workspace.delayed.resize(from + positions(0, i).len(), Lanes::default());
            for l in 0..lanes {
                workspace.shifted.clear();
                shift(positions(l, i), delay[l], &mut workspace.shifted);
                let of_lane = workspace.shifted.windows(2).map(|two| (1.0 - part[l]) * two[1] + part[l] * two[0]);
                workspace.delayed[from..].iter_mut().zip(of_lane).for_each(|(delayed, v)| delayed[l] = v);
            }
        }
        let (mut each, mut shifted) = (workspace.delayed.as_slice(), workspace.shifted.as_slice());
        let delayed = stretches.clone().map(|i| {
            let cells = positions(0, i).len();
            if together {
                let (v, after) = shifted.split_at(cells + 1);
                shifted = after;
                Delayed::Same { shifted: v, part }
            } else {
                let (v, after) = each.split_at(cells);
                each = after;
                Delayed::Each(v)
            }
        });
        let held = workspace.place_of(search, thetas, lanes);
        workspace.last = held.unwrap_or(place);
        let Kept { white, known } = &mut workspace.kept[workspace.last];
        if held.is_some() {
            white.forget_answer();
            let inputs = delayed.zip(&record.stretches).map(|(v, s)| (s.y.len(), v));
            structure.answer::<S, R, false>(simd, 0, inputs, white);
        } else {
            workspace.changes.clear();
            workspace.changes.extend(record.stretches.iter().map(|stretch| LoadChange::alike(&stretch.changes)));
            *known = None;
            white.clear();
            let inputs = delayed.zip(&record.stretches).zip(&workspace.changes);
            let inputs = inputs.map(|((v, stretch), changes)| (&*stretch.y, changes.as_slice(), v));
            structure.whiten::<S, R>(simd, thetas, inputs, white);
            *known = Some(Known::new(search, thetas, lanes));
        }
        search.gain_and_residuals::<S, R>(simd, white, &mut workspace.found, wanted);
    }
}

/// The sums of the answers of the first model to eight starts in one stretch, whose gains a pass has left.
struct Beginning<'r, 's> {
    search: &'s Search<'s>,
    white: &'r mut Whitened,
    theta: &'s Theta,
    stretch: usize,
    positions: &'s [Lanes],
}

impl Work for Beginning<'_, '_> {
    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, simd: S) {
        let Self { search, white, theta, stretch, positions } = self;
        white.forget_answer();
        let v = Delayed::Late { positions, delay: search.delay(theta) };
        search.structure.answer::<S, R, true>(simd, stretch, std::iter::once((positions.len(), v)), white);
    }
}

/// The response of a process to positions alone.
struct Response<'s> {
    structure: Structure,
    theta: &'s Theta,
    positions: &'s [Lanes],
    white: &'s mut Whitened,
}

impl Work for Response<'_> {
    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, simd: S) {
        let nothing = vec![0.0; self.positions.len()];
        let alone = [(nothing.as_slice(), [].as_slice(), Delayed::Each(self.positions))];
        self.structure.whiten::<S, R>(simd, &[*self.theta; LANES], alone.into_iter(), self.white);
    }
}

impl Search<'_> {
    /// Eight sets of parameters at once, of which the first so many `lanes` count, each with the positions of one lost motion; `then`
    /// takes what it needs of it.
    fn innovations<T>(
        &self,
        thetas: &[Theta; LANES],
        lanes: usize,
        positions: &Positions,
        wanted: Wanted,
        then: impl FnOnce(&Innovations) -> T,
    ) -> T {
        self.pass(thetas, lanes, &|_, i| &positions[i], wanted, BEGUN, |workspace| then(&workspace.found))
    }

    /// How late the answer is [cells]. PV's mean over a cell lies half a cell behind its first step, OP's mean acts from the first
    /// step on. OP never acts on the PV of its own step: it is the controller's answer to that PV, and would explain it all too well.
    fn delay(&self, theta: &Theta) -> f64 {
        let cell = self.record.cell as f64;
        theta[self.structure.dead_time_at()] - (cell - 1.0) / (2.0 * cell)
    }

    /// See [`Pass`].
    fn pass<'s, T>(
        &'s self,
        thetas: &'s [Theta; LANES],
        lanes: usize,
        positions: &'s dyn Fn(usize, usize) -> &'s [f64],
        wanted: Wanted,
        place: usize,
        then: impl FnOnce(&Workspace) -> T,
    ) -> T {
        WORKSPACE.with_borrow_mut(|workspace| {
            wide_enough(lanes, Pass { search: self, workspace, thetas, lanes, positions, wanted, place });
            then(workspace)
        })
    }

    /// Gain and residuals from what a pass left.
    #[inline(always)]
    fn gain_and_residuals<S: Simd, const R: usize>(
        &self,
        simd: S,
        white: &Whitened,
        found: &mut Innovations,
        wanted: Wanted,
    ) {
        let load = |lanes: &Lanes| Wide::<S, R>::load(simd, lanes);
        let nothing = Wide::<S, R>::all(simd, 0.0);
        found.sums = white.sums;
        found.residual.clear();
        if wanted == Wanted::Sums {
            return;
        }
        let sums = found.sums;
        found.kp = Lanes::each(|l| gain(sums.yv[l], sums.vv[l], self.sign));
        let freedom = self.record.freedom();
        // A change's size is free: it costs nothing here, and Search::price_of_changes what it is worth.
        let free = self.record.changes() as f64 * UNKNOWN.ln();
        found.scale = Lanes::each(|l| ((white.log_s[l] - free) / (2.0 * freedom)).exp());
        found.sum_without = Lanes::each(|l| sums.yy[l] * found.scale[l] * found.scale[l]);
        let (kp, scale) = (load(&found.kp), load(&found.scale));
        let innovations = white.of_y().iter().zip(white.of_v());
        let residuals = innovations.map(|(y, v)| (load(y) - kp * load(v)) * scale);
        let mut sum = nothing;
        match wanted {
            Wanted::Sums | Wanted::Least => residuals.for_each(|r| sum += r * r),
            Wanted::Residuals => residuals.for_each(|r| {
                sum += r * r;
                found.residual.push(r.lanes());
            }),
            Wanted::Products => {
                // As many rows as there are parameters to move, and the residuals themselves.
                macro_rules! rows {
                    ($($rows:literal)*) => {
                        match self.structure.parameters() + 1 {
                            $($rows => products::<S, R, $rows>(simd, residuals, &mut sum, &mut found.products),)*
                            rows => unreachable!("{rows} rows"),
                        }
                    };
                }
                rows!(3 4 5 6 7 8);
            }
        }
        found.sum = sum.lanes();
    }

    /// θ with the variance of its first disturbance that explains most: how restless a load is spans many powers of ten.
    pub(crate) fn with_best_load_variance(&self, theta: Theta, lost: &BacklashModel) -> Theta {
        let thetas: [Theta; LANES] = std::array::from_fn(|l| {
            let mut theta = theta;
            theta[self.structure.lags + 1] = 2.5 * l as f64 - 8.0;
            theta
        });
        let positions = self.record.positions(lost);
        let sums = self.innovations(&thetas, LANES, &positions, Wanted::Least, |found| found.sum);
        thetas[(0..LANES).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).expect("eight lanes")]
    }

    /// One set of parameters: the first lane tells.
    pub(crate) fn at(&self, theta: &Theta, positions: &Positions) -> Innovations {
        self.innovations(&[*theta; LANES], 1, positions, Wanted::Residuals, Innovations::clone)
    }

    /// −2·ln L with the size of the noise at its best.
    pub(crate) fn cost(&self, sum: f64) -> f64 {
        let freedom = self.record.freedom();
        freedom * ((sum.max(1e-300) / freedom).ln() + 1.0 + (2.0 * PI).ln())
    }

    /// What the changes of the load that are marked cost at `point`, which was found with them [−2·ln L]: each may lie at any cell, and
    /// be as large as OP's range, that of a slope as large as that in a hundred cells.
    pub(crate) fn price_of_changes(&self, point: &Point) -> f64 {
        self.price(point.kp, || point.noise)
    }

    /// The same with the changes of this record at a point of another.
    pub(crate) fn price_at(&self, point: &Point) -> f64 {
        let noise = || {
            let positions = self.record.positions(&point.lost);
            self.innovations(&[point.theta; LANES], 1, &positions, Wanted::Least, |found| self.noise(found))
        };
        self.price(point.kp, noise)
    }

    /// Variance of the white noise on PV in the first lane.
    fn noise(&self, found: &Innovations) -> f64 {
        let scale = found.scale[0];
        found.sum[0] / (scale * scale) / self.record.freedom()
    }

    fn price(&self, kp: f64, noise: impl FnOnce() -> f64) -> f64 {
        if self.record.changes() == 0 {
            return 0.0;
        }
        // What OP could do, or what PV did: a process that hardly answers OP pays no less for its changes.
        let seen = if self.structure.integrating { 0.0 } else { self.record.span };
        let mut size = (kp * self.record.range).abs().max(seen).powi(2) / noise();
        if matches!(self.structure.noise, Noise::Lines | Noise::Bends) {
            size /= LONG * LONG;
        }
        let (changes, cells) = (self.record.changes(), self.record.count);
        // They may come in any order: ln of the binomial coefficient.
        let places: f64 = (0..changes).map(|j| ((cells - j) as f64 / (j + 1) as f64).ln()).sum();
        changes as f64 * (size / (2.0 * PI)).ln().max(0.0) + 2.0 * places
    }

    /// What a unit step of the load (of its slope, where that is what changes), with gain 1, leaves in the innovations over the
    /// `cells` after it, once the filter has settled.
    pub(crate) fn answer(&self, theta: &Theta, cells: usize) -> Vec<f64> {
        let before = 400;
        let lines = matches!(self.structure.noise, Noise::Lines | Noise::Bends);
        let load = |k: usize| {
            if k < before {
                0.0
            } else if lines {
                (k - before) as f64
            } else {
                1.0
            }
        };
        let step: Vec<Lanes> = (0..before + cells).map(|k| Lanes::all(load(k))).collect();
        let mut white = Whitened::default();
        widest(Response { structure: self.structure, theta, positions: &step, white: &mut white });
        white.of_v()[before..].iter().map(|v| v[0]).collect()
    }

    /// Whitened PV, and what a unit of each of the inputs makes of it.
    pub(crate) fn answers(&self, theta: &Theta, inputs: &[&Positions]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let (mut of_y, mut answers) = (Vec::new(), Vec::new());
        for eight in inputs.chunks(LANES) {
            let of = |l: usize, i: usize| eight[l.min(eight.len() - 1)][i].as_slice();
            self.pass(&[*theta; LANES], eight.len(), &of, Wanted::Sums, BEGUN, |workspace| {
                let white = workspace.white();
                of_y = white.of_y().iter().map(|y| y[0]).collect();
                answers.extend((0..eight.len()).map(|l| white.of_v().iter().map(|v| v[l]).collect::<Vec<f64>>()));
            });
        }
        (of_y, answers)
    }

    /// PV as the process alone would make it from rest at the positions of a lost motion; none where the record has none.
    pub(crate) fn predicted(&self, point: &Point, positions: &Positions) -> Vec<Vec<f64>> {
        let delay = self.delay(&point.theta);
        let of = |(stretch, positions): (&Strip, &Vec<f64>)| {
            let v: Vec<f64> = delayed(positions, delay).iter().map(|v| v * point.kp).collect();
            let response = self.structure.response(&point.theta, &v);
            response.iter().zip(&*stretch.y).map(|(x, y)| if y.is_nan() { f64::NAN } else { *x }).collect()
        };
        self.record.stretches.iter().zip(positions).map(of).collect()
    }

    /// Lanes that a point takes with its derivatives: see [`Search::perturbed`].
    fn lanes(&self) -> usize {
        1 + self.structure.parameters()
    }

    /// θ in the first lane, in the others θ with one parameter moved, and by how much.
    fn perturbed(&self, theta: &Theta) -> ([Theta; LANES], Theta) {
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
            // From there on the start shows no longer.
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
            // As it stands, and seven places over all of the gap; then eight around the best.
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

    /// Sums over the beginning of one stretch, each lane with positions of its own.
    fn beginnings(&self, point: &Point, stretch: usize, positions: &[Lanes]) -> Sums {
        // The gains with which the point was found, so that they do not hang on what else was passed before.
        let (thetas, _) = self.perturbed(&point.theta);
        let held = || WORKSPACE.with_borrow(|workspace| workspace.place_of(self, &thetas, self.lanes()));
        let held = held().unwrap_or_else(|| {
            self.innovations(&thetas, self.lanes(), &self.record.positions(&point.lost), Wanted::Sums, |_| ());
            BEGUN
        });
        WORKSPACE.with_borrow_mut(|workspace| {
            let white = &mut workspace.kept[held].white;
            widest(Beginning { search: self, white, theta: &point.theta, stretch, positions });
            white.sums
        })
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

/// A record under one model whose changes are tried elsewhere, each by the cells around it.
pub(crate) struct Elsewhere<'s> {
    search: Search<'s>,
    theta: Theta,
    /// The changes of each stretch as they stand.
    changes: Vec<Vec<f64>>,
    sides: Vec<Sides>,
    /// Of each stretch as its changes stand, where there are several.
    totals: Vec<Totals>,
}

impl<'s> Elsewhere<'s> {
    pub(crate) fn new(search: &Search<'s>, theta: &Theta, positions: &Positions) -> Self {
        let delay = search.delay(theta);
        let sides = |(stretch, positions): (&Strip, &Vec<f64>)| {
            Sides::new(stretch.y.clone(), delayed(positions, delay), &stretch.changes)
        };
        let sides: Vec<Sides> = search.record.stretches.iter().zip(positions).map(sides).collect();
        let changes = search.record.stretches.iter().map(|stretch| stretch.changes.clone()).collect();
        let mut all = Self { search: *search, theta: *theta, changes, sides, totals: Vec::new() };
        if all.sides.len() > 1 {
            all.totals = (0..all.sides.len()).map(|i| all.of_stretch(i, None)).collect();
        }
        all
    }

    /// Σ r² as the changes stand.
    pub(crate) fn as_it_stands(&mut self) -> f64 {
        let totals = self.of_stretch(0, None);
        self.squares(0, totals, self.changes[0].len())[0]
    }

    /// Σ r² with up to eight other sets of changes in one of the stretches, as many in each.
    pub(crate) fn with(&mut self, stretch: usize, tried: &[&[f64]]) -> Lanes {
        let totals = self.of_stretch(stretch, Some(tried));
        self.squares(stretch, totals, tried[0].len())
    }

    /// The changes of a stretch are these from now on.
    pub(crate) fn take(&mut self, stretch: usize, changes: &[f64]) {
        if let Some(cells) = differing(&self.changes[stretch], changes) {
            self.sides[stretch].change(changes, &cells);
        }
        self.changes[stretch] = changes.to_vec();
        if self.sides.len() > 1 {
            self.totals[stretch] = self.of_stretch(stretch, None);
        }
    }

    /// With its changes as they stand, or with those that are tried.
    fn of_stretch(&mut self, stretch: usize, tried: Option<&[&[f64]]>) -> Totals {
        let own = self.changes[stretch].as_slice();
        let as_it_stands = [own];
        let tried = tried.unwrap_or(&as_it_stands);
        let cells = tried.iter().filter_map(|tried| differing(own, tried));
        let cells = cells.reduce(|a, b| union(&a, &b)).unwrap_or(1..2);
        let asked = Asked { sides: &mut self.sides[stretch], theta: &self.theta, cells: &cells, tried };
        let mut totals = Totals::default();
        wide_enough(tried.len(), Tried { structure: self.search.structure, asked, totals: &mut totals });
        totals
    }

    /// Σ r² with these totals of one of the stretches, which has so many changes.
    fn squares(&self, stretch: usize, totals: Totals, changes: usize) -> Lanes {
        let others = || (0..self.sides.len()).filter(|i| *i != stretch);
        let record = self.search.record;
        let changes = (changes + others().map(|i| self.changes[i].len()).sum::<usize>()) as f64;
        let freedom = record.freedom() + record.changes() as f64 - changes;
        Lanes::each(|l| {
            let sum =
                |of: fn(&Totals) -> &Lanes| of(&totals)[l] + others().map(|i| of(&self.totals[i])[0]).sum::<f64>();
            let [yy, yv, vv] = [sum(|t| &t.sums.yy), sum(|t| &t.sums.yv), sum(|t| &t.sums.vv)];
            let kp = gain(yv, vv, self.search.sign);
            let log_s = sum(|t| &t.log_s) - changes * UNKNOWN.ln();
            (yy - 2.0 * kp * yv + kp * kp * vv) * (log_s / freedom).exp()
        })
    }
}

/// The cells in which changes are others, as far as they are; none where they are the same.
fn differing(a: &[f64], b: &[f64]) -> Option<Range<usize>> {
    let first = a.iter().zip(b).take_while(|(a, b)| a == b).count();
    let (a, b) = (&a[first..], &b[first..]);
    let last = a.iter().rev().zip(b.iter().rev()).take_while(|(a, b)| a == b).count();
    let rest = a[..a.len() - last].iter().chain(&b[..b.len() - last]).map(|time| time.ceil() as usize);
    let (least, most) = (rest.clone().min()?, rest.max()?);
    Some(least..most + 1)
}

/// See [`Structure::elsewhere`].
struct Tried<'s, 't> {
    structure: Structure,
    asked: Asked<'s, 't>,
    totals: &'s mut Totals,
}

impl Work for Tried<'_, '_> {
    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, simd: S) {
        *self.totals = self.structure.elsewhere::<S, R>(simd, self.asked);
    }
}

/// `v` as many whole cells before as are in `delay`, from the cell before its first on; before its beginning what it was there.
#[inline(always)]
fn shift(v: &[f64], delay: f64, shifted: &mut Vec<f64>) {
    let (n, from) = (v.len() as isize, shifted.len());
    let whole = delay.floor() as isize;
    let unseen = (whole + 1).clamp(0, n + 1);
    let skipped = (-1 - whole).clamp(0, n);
    shifted.resize(from + unseen as usize, v[0]);
    shifted.extend(v[skipped as usize..].iter().take((n + 1 - unseen) as usize));
    shifted.resize(from + v.len() + 1, v[v.len() - 1]);
}

/// `v` so many cells late.
fn delayed(v: &[f64], delay: f64) -> Vec<f64> {
    let (mut shifted, part) = (Vec::new(), delay - delay.floor());
    shift(v, delay, &mut shifted);
    shifted.windows(2).map(|two| (1.0 - part) * two[1] + part * two[0]).collect()
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

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Scalar;

    /// What a pass makes of a record with a hole and a change of the load, in registers of the instructions `S`: of a point and
    /// its derivatives.
    fn passed<S: Simd, const R: usize>(simd: S, structure: Structure) -> Vec<u64> {
        let u: Vec<f64> = (0..200).map(|k| (f64::from(k) * 0.1).sin()).collect();
        let mut y: Vec<f64> =
            (0..200).map(|k| (f64::from(k) * 0.1 - 1.0).sin() + 0.01 * f64::from(k * 7919 % 13)).collect();
        y[70..75].fill(f64::NAN);
        let record = Cells::new(&[(&y, &u)], 1).with_changes(vec![vec![120.3]]);
        let search = Search { record: &record, structure, sign: 1.0 };
        let (thetas, _) = search.perturbed(&structure.beginning(8.0, 2.4));
        let positions = record.positions(&BacklashModel::gap(0.1, 1));
        let mut workspace = Workspace::default();
        let pass = Pass {
            search: &search,
            workspace: &mut workspace,
            thetas: &thetas,
            lanes: search.lanes(),
            positions: &|_, i| positions[i].as_slice(),
            wanted: Wanted::Products,
            place: BEGUN,
        };
        pass.run::<S, R>(simd);
        let Innovations { sum, products, .. } = &workspace.found;
        (0..search.lanes()).flat_map(|l| [sum[l], products[1][l]]).map(f64::to_bits).collect()
    }

    #[test]
    fn gains_that_are_kept_give_the_bits_of_a_new_pass() {
        let u: Vec<f64> = (0..300).map(|k| (f64::from(k) * 0.1).sin()).collect();
        let mut y: Vec<f64> = u.iter().zip(0..).map(|(u, k)| u + 0.01 * f64::from(k * 7919 % 13)).collect();
        y[70..75].fill(f64::NAN);
        let parts = [(&y[..180], &u[..180]), (&y[180..], &u[180..])];
        let record = Cells::new(&parts, 1).with_changes(vec![vec![120.3, 40.0], vec![60.5]]);
        for structure in [Noise::Still, Noise::Input, Noise::Both, Noise::Slope, Noise::Bends].map(of_two_lags) {
            let search = Search { record: &record, structure, sign: 1.0 };
            let (thetas, _) = search.perturbed(&structure.beginning(8.0, 2.4));
            let of = |d: f64, forget: bool| {
                if forget {
                    WORKSPACE.take();
                }
                let positions = record.positions(&BacklashModel::gap(d, 2));
                search.innovations(&thetas, search.lanes(), &positions, Wanted::Residuals, |found| {
                    let of_all = found.residual.iter().flat_map(|r| r.map(f64::to_bits));
                    of_all.chain(found.sums.yv.map(f64::to_bits)).collect::<Vec<u64>>()
                })
            };
            let anew = of(0.2, true);
            of(0.1, true);
            assert!(WORKSPACE.with_borrow(|workspace| workspace.place_of(&search, &thetas, search.lanes()).is_some()));
            assert!(of(0.2, false) == anew, "{structure:?}");
        }
    }

    #[test]
    fn kept_gains_are_of_one_record_and_one_process() {
        let (y, u) = ([1.0, 2.0, 1.5, 0.5].repeat(20), [0.0, 1.0, 1.0, 0.0].repeat(20));
        let record = Cells::new(&[(&y, &u)], 1);
        let structure = of_two_lags(Noise::Input);
        let theta = structure.beginning(8.0, 2.4);
        let (mut slower, mut later) = (theta, theta);
        slower[0] += 0.1;
        later[structure.dead_time_at()] += 1.0;
        let kept = Known::new(&Search { record: &record, structure, sign: 1.0 }, &[theta; LANES], 4);
        let so_many = |record: &Cells, theta: Theta, lanes: usize| {
            kept.holds(&Search { record, structure, sign: 1.0 }, &[theta; LANES], lanes)
        };
        let holds = |record: &Cells, theta: Theta| so_many(record, theta, 4);
        assert!(
            so_many(&record, theta, 1) && !so_many(&record, theta, 5),
            "of those that do not count nothing is kept"
        );
        assert!(holds(&record, theta) && holds(&record.clone(), later), "the dead time is the answer's alone");
        assert!(!holds(&record, slower));
        assert!(!holds(&record.with_changes(vec![vec![40.0]]), theta));
        assert!(!holds(&record.with(vec![y.clone()]), theta), "other PV, though its numbers are the same");
    }

    #[test]
    fn beginnings_are_summed_up_as_passes_would() {
        let u: Vec<f64> = (0..150).map(|k| (f64::from(k) * 0.05).sin()).collect();
        let y: Vec<f64> = u.iter().zip(0..).map(|(u, k)| u + 0.01 * f64::from(k * 7919 % 13)).collect();
        let record = Cells::new(&[(&y, &u)], 1);
        let structure = of_two_lags(Noise::Input);
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

    #[test]
    fn changes_elsewhere_are_judged_by_the_cells_around_them_as_by_a_pass() {
        let u: Vec<f64> = (0..400).map(|k| (f64::from(k) * 0.1).sin()).collect();
        let mut y: Vec<f64> = u.iter().zip(0..).map(|(u, k)| u + 0.01 * f64::from(k * 7919 % 13)).collect();
        y[2..5].fill(f64::NAN);
        y[110..117].fill(f64::NAN);
        let parts = [(&y[..250], &u[..250]), (&y[250..], &u[250..])];
        let marks = vec![vec![170.3, 40.5, 112.0], vec![60.5, 75.25]];
        let record = Cells::new(&parts, 1).with_changes(marks.clone());
        let families = [(2, false), (3, false), (1, true)];
        for noise in [Noise::Still, Noise::Input, Noise::Lines, Noise::Bends] {
            for (lags, integrating) in families {
                let structure = Structure { lags, integrating, noise };
                let search = Search { record: &record, structure, sign: 1.0 };
                let theta = structure.beginning(8.0, 2.4);
                let positions = record.positions(&BacklashModel::gap(0.2, 2));
                let of_pass = |marks: &[Vec<f64>]| {
                    let record = record.with_changes(marks.to_vec());
                    Search { record: &record, structure, sign: 1.0 }.at(&theta, &positions).sum[0]
                };
                // A slope that is not known at all costs either of them digits.
                let off = if matches!(noise, Noise::Lines | Noise::Bends) { 5e-5 } else { 2e-6 };
                let near = |told: f64, pass: f64| {
                    assert!((told - pass).abs() < off * pass, "{structure:?}: {told} for {pass}");
                };
                let mut marks = marks.clone();
                let mut elsewhere = Elsewhere::new(&search, &theta, &positions);
                near(elsewhere.as_it_stands(), of_pass(&marks));
                // Of each stretch in turn: moved, moved nearer, left out; then as it stands, from other places.
                for (i, moved) in [
                    (0, [5.0, 5.5, 6.0, 12.0, 100.0, 117.5, 240.25, 244.9]),
                    (1, [5.0, 5.5, 60.0, 61.0, 76.0, 100.0, 140.0, 144.0]),
                ] {
                    for _ in 0..2 {
                        let tried = moved.map(|time| [&[time], &marks[i][1..]].concat());
                        let told = elsewhere.with(i, &tried.each_ref().map(Vec::as_slice));
                        for (tried, told) in tried.iter().zip(*told) {
                            let mut marks = marks.clone();
                            marks[i].clone_from(tried);
                            near(told, of_pass(&marks));
                        }
                        marks[i].clone_from(&tried[4]);
                        elsewhere.take(i, &tried[4]);
                        near(elsewhere.as_it_stands(), of_pass(&marks));
                    }
                    marks[i].remove(1);
                    elsewhere.take(i, &marks[i]);
                    near(elsewhere.as_it_stands(), of_pass(&marks));
                }
            }
        }
    }

    fn of_two_lags(noise: Noise) -> Structure {
        Structure { lags: 2, integrating: false, noise }
    }

    #[test]
    fn registers_of_every_width_give_the_same_bits() {
        let of_lines = [Noise::Slope, Noise::Lines, Noise::Bends];
        for noise in [Noise::Still, Noise::Input, Noise::Output, Noise::Both].into_iter().chain(of_lines) {
            for (lags, integrating) in [(2, false), (3, false), (1, true)] {
                let structure = Structure { lags, integrating, noise };
                let alone = passed::<Scalar, LANES>(Scalar::new(), structure);
                assert!(alone.iter().all(|bits| f64::from_bits(*bits).is_finite()));
                #[cfg(target_arch = "x86_64")]
                {
                    #[cfg(debug_assertions)]
                    use pulp::x86::V2;
                    use pulp::x86::{V3, V4};
                    // All eight lanes, and as many registers as are wide enough.
                    macro_rules! same {
                        ($instructions:ident: $($registers:literal)*) => {$(
                            if let Some(simd) = $instructions::try_new()
                                && $registers * $instructions::F64_LANES > structure.parameters()
                            {
                                let bits = passed::<$instructions, $registers>(simd, structure);
                                assert_eq!(bits, alone, "{structure:?} in {} registers", $registers);
                            }
                        )*};
                    }
                    // Two numbers a register stand for NEON and WebAssembly. They take the compiler as long as all else here, so
                    // they are left to `make verify`, whose tests are compiled with assertions.
                    #[cfg(debug_assertions)]
                    same!(V2: 4 3 2);
                    same!(V3: 2 1);
                    same!(V4: 1);
                }
            }
        }
    }
}
