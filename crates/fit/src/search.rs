//! The likelihood of one family and its maximum for a given lost motion.

use crate::kalman::{Jump, LANES, Lanes, UNKNOWN, White, lanes};
use crate::record::{Lost, Positions, Record};
use crate::structure::{MOST, Structure, Theta};
use std::cell::RefCell;
use std::f64::consts::PI;
use std::ops::Range;

/// A point of the search: the family's parameters and what they are worth.
#[derive(Clone, Debug)]
pub(crate) struct Point {
    pub(crate) theta: Theta,
    /// −2·ln L but for a constant, the size of the noise and the gain at their best.
    pub(crate) cost: f64,
    /// Static gain (of an integrating process: velocity gain a cell) [PV unit / OP unit].
    pub(crate) kp: f64,
    pub(crate) lost: Lost,
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
}

impl Innovations {
    pub(crate) fn lane(&self, lane: usize) -> Vec<f64> {
        self.residual.iter().map(|r| r[lane]).collect()
    }
}

/// Room for one pass, kept from one to the next.
#[derive(Default)]
struct Work {
    delayed: Vec<Lanes>,
    /// Jumps of each stretch.
    jumps: Vec<Vec<Jump>>,
    white: White,
    found: Innovations,
}

/// Cells after which what the filter was told at first is forgotten.
const SETTLED: usize = 100;

thread_local! {
    static WORK: RefCell<Work> = RefCell::default();
}

/// One family on one record. `sign`: that of the gain where it is known, else 0.
#[derive(Clone, Copy)]
pub(crate) struct Search<'a> {
    pub(crate) record: &'a Record,
    pub(crate) structure: Structure,
    pub(crate) sign: f64,
}

/// Sums of squares and products of the innovations of PV and of the answer.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    yy: Lanes,
    yv: Lanes,
    vv: Lanes,
}

impl Sums {
    #[inline(always)]
    fn of(white: &White) -> Self {
        let mut sums = Self::default();
        for (y, v) in white.of_y.iter().zip(&white.of_v) {
            for l in 0..LANES {
                sums.yy[l] += y[l] * y[l];
                sums.yv[l] += y[l] * v[l];
                sums.vv[l] += v[l] * v[l];
            }
        }
        sums
    }
}

/// The gain that makes the least of Σ r², not of the other sign.
fn gain(yv: f64, vv: f64, sign: f64) -> f64 {
    let kp = if vv > 1e-300 { yv / vv } else { 0.0 };
    if kp * sign < 0.0 { 0.0 } else { kp }
}

/// A point with the slope and the curvature of the likelihood there.
struct Local {
    theta: Theta,
    kp: f64,
    products: (f64, f64),
    sum: f64,
    /// JᵀJ and −Jᵀr.
    normal: [[f64; MOST]; MOST],
    down: Theta,
}

impl Search<'_> {
    /// Eight sets of parameters at once, each with the positions of one lost motion; `then` takes what it needs of it.
    fn innovations<R>(
        &self,
        thetas: &[Theta; LANES],
        positions: &Positions,
        then: impl FnOnce(&Innovations) -> R,
    ) -> R {
        self.pass(thetas, positions, |_, i| &self.record.stretches[i].jumps, then)
    }

    /// Σ r² with eight other sets of jumps in one of the stretches, each as large as the record's own.
    pub(crate) fn with_other_jumps(
        &self,
        theta: &Theta,
        positions: &Positions,
        stretch: usize,
        jumps: &[Vec<f64>; LANES],
    ) -> Lanes {
        let of = |l: usize, i: usize| if i == stretch { &jumps[l] } else { &self.record.stretches[i].jumps };
        self.pass(&[*theta; LANES], positions, of, |found| found.sum)
    }

    /// A pass over the whole record; `jumps`: those of the load for a lane in a stretch.
    fn pass<'j, R>(
        &self,
        thetas: &[Theta; LANES],
        positions: &Positions,
        jumps: impl Fn(usize, usize) -> &'j Vec<f64>,
        then: impl FnOnce(&Innovations) -> R,
    ) -> R {
        WORK.with_borrow_mut(|work| {
            // The widest vectors that the machine has; nothing is fused, so the bits are the same with any.
            pulp::Arch::new().dispatch(
                #[inline(always)]
                || {
                    let all = 0..self.record.stretches.len();
                    self.whiten(work, thetas, all, |_, i| &positions[i], jumps);
                    self.weigh(work);
                    then(&work.found)
                },
            )
        })
    }

    /// Gain and residuals from what a pass over the whole record left.
    #[inline(always)]
    fn weigh(&self, work: &mut Work) {
        let Work { white, found, .. } = work;
        let sums = Sums::of(white);
        found.kp = lanes(|l| gain(sums.yv[l], sums.vv[l], self.sign));
        found.sums = sums;
        let freedom = self.record.freedom();
        // A jump's size is free: it costs nothing here, and Search::surprise what it is worth.
        let free = self.record.jumps() as f64 * UNKNOWN.ln();
        found.scale = lanes(|l| ((white.log_s[l] - free) / (2.0 * freedom)).exp());
        found.sum_without = lanes(|l| sums.yy[l] * found.scale[l] * found.scale[l]);
        found.residual.clear();
        let mut sum = [0.0; LANES];
        for (y, v) in white.of_y.iter().zip(&white.of_v) {
            let r = lanes(|l| (y[l] - found.kp[l] * v[l]) * found.scale[l]);
            for l in 0..LANES {
                sum[l] += r[l] * r[l];
            }
            found.residual.push(r);
        }
        found.sum = sum;
    }

    /// The innovations of some of the stretches; `of`: the positions for a lane in a stretch, as far as they are wanted;
    /// `jumps`: those of the load.
    #[inline(always)]
    fn whiten<'p, 'j>(
        &self,
        work: &mut Work,
        thetas: &[Theta; LANES],
        stretches: Range<usize>,
        of: impl Fn(usize, usize) -> &'p [f64],
        jumps: impl Fn(usize, usize) -> &'j Vec<f64>,
    ) {
        // PV's mean over a cell lies half a cell behind its first step, OP's mean acts from the first step on. OP never acts on
        // the PV of its own step: it is the controller's answer to that PV, and would explain it all too well.
        let cell = self.record.cell as f64;
        let delay = lanes(|l| thetas[l][self.structure.dead_time_at()] - (cell - 1.0) / (2.0 * cell));
        work.delayed.clear();
        for i in stretches.clone() {
            let from = work.delayed.len();
            let first = of(0, i);
            delayed(first, delay[0], &mut work.delayed);
            for l in 1..LANES {
                // Most lanes differ in something else.
                let v = of(l, i);
                if delay[l] != delay[0] || !std::ptr::eq(v, first) {
                    delay_lane(v, delay[l], &mut work.delayed[from..], l);
                }
            }
        }
        work.jumps.clear();
        for i in stretches.clone() {
            work.jumps.push(Jump::gathered(|l| jumps(l, i).as_slice()));
        }
        work.white.clear();
        let mut rest = work.delayed.as_slice();
        let inputs = stretches.zip(&work.jumps).map(|(i, jumps)| {
            let (v, after) = rest.split_at(of(0, i).len());
            rest = after;
            (&self.record.stretches[i].y[..v.len()], jumps.as_slice(), v)
        });
        self.structure.whiten(thetas, inputs, &mut work.white);
    }

    /// One set of parameters: the first lane tells.
    pub(crate) fn at(&self, theta: &Theta, positions: &Positions) -> Innovations {
        self.innovations(&[*theta; LANES], positions, Innovations::clone)
    }

    /// −2·ln L with the size of the noise at its best.
    pub(crate) fn cost(&self, sum: f64) -> f64 {
        let freedom = self.record.freedom();
        freedom * ((sum.max(1e-300) / freedom).ln() + 1.0 + (2.0 * PI).ln())
    }

    /// What the jumps of the load that are marked cost at `point` [−2·ln L]: each may lie at any cell, and be as large as OP's
    /// range.
    pub(crate) fn surprise(&self, point: &Point) -> f64 {
        if self.record.jumps() == 0 {
            return 0.0;
        }
        let here = self.at(&point.theta, &self.record.positions(&point.lost));
        let white = here.sum[0] / (here.scale[0] * here.scale[0]) / self.record.freedom();
        // What OP could do, or what PV did: a process that hardly answers OP pays no less for its jumps.
        let seen = if self.structure.integrating { 0.0 } else { self.record.span };
        let size = (point.kp * self.record.range).abs().max(seen).powi(2) / white;
        let (jumps, cells) = (self.record.jumps(), self.record.count);
        // They may come in any order: ln of the binomial coefficient.
        let places: f64 = (0..jumps).map(|j| ((cells - j) as f64 / (j + 1) as f64).ln()).sum();
        jumps as f64 * (size / (2.0 * PI)).ln().max(0.0) + 2.0 * places
    }

    /// θ in the first lane, in the others θ with one parameter moved, and by how much.
    fn around(&self, theta: &Theta) -> ([Theta; LANES], Theta) {
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
        let (thetas, by) = self.around(theta);
        self.innovations(&thetas, positions, |found| {
            let slope = |j: usize| found.residual.iter().map(|r| (r[j + 1] - r[0]) / by[j]).collect();
            (found.lane(0), (0..self.structure.parameters()).map(slope).collect())
        })
    }

    /// θ with slope and curvature, in one pass.
    fn local(&self, theta: Theta, positions: &Positions) -> Local {
        let (thetas, by) = self.around(&theta);
        let k = self.structure.parameters();
        self.innovations(
            &thetas,
            positions,
            #[inline(always)]
            |found| {
                let mut products = [[0.0; LANES]; LANES];
                for r in &found.residual {
                    let moved = lanes(|l| if l == 0 { r[0] } else { r[l] - r[0] });
                    for i in 0..LANES {
                        for l in 0..LANES {
                            products[i][l] += moved[i] * moved[l];
                        }
                    }
                }
                let (mut normal, mut down) = ([[0.0; MOST]; MOST], [0.0; MOST]);
                for i in 0..k {
                    for j in 0..k {
                        normal[i][j] = products[i + 1][j + 1] / (by[i] * by[j]);
                    }
                    down[i] = -products[0][i + 1] / by[i];
                }
                let products = (found.sums.yv[0], found.sums.vv[0]);
                Local { theta, kp: found.kp[0], products, sum: found.sum[0], normal, down }
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
    pub(crate) fn descend(&self, theta: Theta, lost: &Lost, rounds: usize, enough: f64, unless: f64) -> Point {
        let n = self.record.count as f64;
        let positions = self.record.positions(lost);
        let mut here = self.local(self.structure.bounded(theta, n), &positions);
        let mut damping = 1e-2;
        for _ in 0..rounds {
            let (there, less) = self.step(&here, damping);
            let foreseen = self.cost(here.sum) - self.cost((here.sum - less).max(0.1 * here.sum));
            if foreseen < enough || self.cost(here.sum) - 3.0 * foreseen > unless {
                break;
            }
            let next = self.local(there, &positions);
            let before = here.sum;
            if next.sum < before {
                here = next;
                damping = (damping / 10.0).max(1e-8);
            } else {
                // Too far: eight shorter steps at once.
                let dampings: Lanes = lanes(|l| damping * 10f64.powi(l as i32 + 1));
                let thetas = dampings.map(|damping| self.step(&here, damping).0);
                let sums = self.innovations(&thetas, &positions, |found| found.sum);
                let best = (0..LANES).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).expect("eight lanes");
                if sums[best] >= before {
                    break;
                }
                here = self.local(thetas[best], &positions);
                damping = dampings[best];
            }
            if self.cost(before) - self.cost(here.sum) < enough {
                break;
            }
        }
        let Local { theta, kp, products, sum, .. } = here;
        Point { theta, cost: self.cost(sum), kp, lost: lost.clone(), products }
    }

    /// The best start of each stretch within the gap at a point, to a few hundredths of the gap; the gain follows.
    fn placed(&self, point: &Point) -> Lost {
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
            let tried = |places: Lanes| {
                self.beginnings(point, i, places.map(|place| stretch.positions(lost, place, self.record.cell, cells)))
            };
            let better = |sums: &Sums, rest: (f64, f64)| {
                let bought = |l: usize| {
                    let (yv, vv) = (rest.0 + sums.yv[l], rest.1 + sums.vv[l]);
                    gain(yv, vv, self.sign) * yv
                };
                (0..LANES).max_by(|a, b| bought(*a).total_cmp(&bought(*b))).expect("eight lanes")
            };
            // As it stands, and seven places over all of the gap; then eight around the best.
            let places = lanes(|l| if l == 0 { lost.start[i] } else { (l as f64 - 1.0) / 6.0 });
            let first = tried(places);
            let rest = (yv - first.yv[0], vv - first.vv[0]);
            let centre = places[better(&first, rest)];
            let places = lanes(|l| (centre + (l as f64 - 3.5) / 30.0).clamp(0.0, 1.0));
            let second = tried(places);
            let found = better(&second, rest);
            best.start[i] = places[found];
            (yv, vv) = (rest.0 + second.yv[found], rest.1 + second.vv[found]);
        }
        best
    }

    /// Sums over the beginning of one stretch, each lane with positions of its own.
    fn beginnings(&self, point: &Point, stretch: usize, positions: [Vec<f64>; LANES]) -> Sums {
        WORK.with_borrow_mut(|work| {
            pulp::Arch::new().dispatch(
                // Takes the positions as its own: a closure that could be called twice would be called through a function
                // that is compiled for any machine.
                #[inline(always)]
                move || {
                    let positions = positions;
                    let jumps = &self.record.stretches[stretch].jumps;
                    self.whiten(work, &[point.theta; LANES], stretch..stretch + 1, |l, _| &positions[l], |_, _| jumps);
                    Sums::of(&work.white)
                },
            )
        })
    }

    /// The best of several beginnings, each with its best starts in the gap; one that will plainly not come below `unless` or
    /// another beginning is left where it is.
    pub(crate) fn from(&self, beginnings: &[(Theta, Lost)], rounds: usize, enough: f64, unless: f64) -> Point {
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

/// `v` later by `delay` cells, which need not be whole, the same in every lane.
#[inline(always)]
fn delayed(v: &[f64], delay: f64, out: &mut Vec<Lanes>) {
    for k in 0..v.len() {
        out.push([earlier(v, k, delay); LANES]);
    }
}

/// The same in one lane.
#[inline(always)]
fn delay_lane(v: &[f64], delay: f64, out: &mut [Lanes], lane: usize) {
    for k in 0..v.len() {
        out[k][lane] = earlier(v, k, delay);
    }
}

/// What `v` was `delay` cells before `k`; before its beginning what it was there.
#[inline(always)]
fn earlier(v: &[f64], k: usize, delay: f64) -> f64 {
    let whole = delay.floor();
    let part = delay - whole;
    let at = |back: isize| v[(k as isize - back).clamp(0, v.len() as isize - 1) as usize];
    (1.0 - part) * at(whole as isize) + part * at(whole as isize + 1)
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
