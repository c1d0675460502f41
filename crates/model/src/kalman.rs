//! The innovations of a record: what each sample of PV brings that the model did not foresee.

mod bank;
mod sides;

pub use bank::{Found, Sought};
pub use sides::{Asked, Sides, Totals, union};

use crate::lanes::{Lanes, Wide};
use pulp::{Simd, WithSimd};
use std::array;

/// Models of one sample step with `N` states: those of the process, the load at its input (a random walk), and perhaps one
/// more of first order: with `MORE` = [`DRIFT`] a drift o at the output, with [`SLOPE`] or [`LINES`] the slope of the load.
///
/// ```text
/// x⁺ = A·x + b·(kp·v + w)      w⁺ = w + s + n₁, variance q_load
/// o⁺ = pole·o + n₂, or s⁺ = pole·s + n₂, variance q_more
/// y  = x₀ + o + e, variance 1
/// ```
///
/// Variances are in units of the white noise on PV, whose own size drops out of the likelihood.
pub(crate) struct Models<S: Simd, const R: usize, const N: usize, const MORE: usize> {
    pub(crate) simd: S,
    /// The rows of the process; the load's column is b.
    pub(crate) transition: [[Wide<S, R>; N]; N],
    pub(crate) q_load: Wide<S, R>,
    pub(crate) q_more: Wide<S, R>,
    pub(crate) pole: Wide<S, R>,
}

/// Number of a further last state, where there is one.
pub(crate) const DRIFT: usize = 1;
pub(crate) const SLOPE: usize = 2;
/// A slope that changes where changes are marked, in the place of the load.
pub(crate) const LINES: usize = 3;

/// A cell before which the load may have jumped in some of the models.
#[derive(Clone, Copy, Debug)]
pub struct LoadChange {
    pub(crate) cell: usize,
    /// Variance of the change in each of the models.
    pub(crate) variance: Lanes,
    /// Time of the change before the cell's beginning [cells], below 1.
    pub(crate) before: Lanes,
}

impl LoadChange {
    /// Changes of all the models at these times [cells], in the order of their cells; of two in one cell the later one given.
    pub fn alike(times: &[f64]) -> Vec<Self> {
        let change = |time: &f64| Self {
            cell: time.ceil() as usize,
            variance: Lanes::all(UNKNOWN),
            before: Lanes::all(time.ceil() - time),
        };
        let mut all: Vec<Self> = times.iter().map(change).collect();
        all.sort_by_key(|change| change.cell);
        all.dedup_by(|later, kept| {
            let same = later.cell == kept.cell;
            if same {
                kept.before = later.before;
            }
            same
        });
        all
    }

    /// The changes of all the models in the order of their cells, each given by its times [cells].
    pub(crate) fn gathered(times: impl Iterator<Item = Vec<f64>>) -> Vec<Self> {
        let mut all: Vec<Self> = Vec::new();
        for (l, times) in times.enumerate() {
            for time in times {
                let cell = time.ceil() as usize;
                let at = all.binary_search_by_key(&cell, |change| change.cell).unwrap_or_else(|at| {
                    all.insert(at, Self { cell, variance: Lanes::all(0.0), before: Lanes::all(0.0) });
                    at
                });
                all[at].variance[l] = UNKNOWN;
                all[at].before[l] = time.ceil() - time;
            }
        }
        all
    }
}

/// Variance that means "not known at all", at the start and for the load where it changes, in units of the white noise.
pub const UNKNOWN: f64 = 1e8;
/// Part of [`UNKNOWN`] that is the variance of a step whose place in its cell is not known: it is ten times the noise.
const BLURRED: f64 = 1e-6;
/// Samples of PV at the beginning of a stretch that tell where the process and the load stand; they are worth nothing, so
/// that models with more states do not pay for a start that nobody asked about.
pub const START: usize = 6;

/// The positions of the eight models, each `delay` cells before.
pub enum Delayed<'d> {
    /// Positions of each model.
    Each(&'d [Lanes]),
    /// Positions with a cell before the first, a part of a cell late: as many whole cells late in all models.
    Same {
        /// Positions, and the one before them.
        shifted: &'d [f64],
        /// Part of a cell in each of the models.
        part: Lanes,
    },
    /// Positions of each model, all as late: the first ones hold before their beginning, the last ones after their end.
    Late {
        /// Positions as OP moves the valve.
        positions: &'d [Lanes],
        /// Delay [cells].
        delay: f64,
    },
}

impl Delayed<'_> {
    /// The positions at a cell.
    #[inline(always)]
    fn at<S: Simd, const R: usize>(&self, simd: S, k: usize) -> Wide<S, R> {
        match self {
            Self::Each(v) => Wide::load(simd, &v[k]),
            Self::Same { shifted, part } => {
                let (part, one) = (Wide::load(simd, part), Wide::all(simd, 1.0));
                (one - part) * Wide::all(simd, shifted[k + 1]) + part * Wide::all(simd, shifted[k])
            }
            Self::Late { positions, delay } => {
                let whole = delay.floor();
                let (part, at) = (Wide::all(simd, delay - whole), k as isize - whole as isize);
                let held = |at: isize| Wide::load(simd, &positions[at.clamp(0, positions.len() as isize - 1) as usize]);
                (Wide::all(simd, 1.0) - part) * held(at) + part * held(at - 1)
            }
        }
    }
}

/// Results of a pass over a record: innovations divided by their standard deviations, of PV and of the model's answer
/// with gain 1, and Σ ln S. Its room is kept from one pass to the next.
#[derive(Clone, Debug, Default)]
pub struct Whitened {
    of_y: Vec<Lanes>,
    of_v: Vec<Lanes>,
    /// Innovations that count of both.
    count: usize,
    /// Σ ln S of each of the models.
    pub log_s: Lanes,
    /// Sums of the innovations.
    pub sums: Sums,
    /// Gains for the same models with another answer: for a cell in which they move, and for a run of cells in which
    /// they stand still, the effect of an innovation on each of the states, and its weight.
    gains: Vec<Lanes>,
    gains_kept: usize,
    runs: Vec<Run>,
    stretches: Vec<Checkpoint>,
    /// The transition of the process, row by row, and the pole.
    process: Vec<Lanes>,
}

/// Sums of squares and products of the innovations of PV and of the answer.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// Σ ε_y² of PV.
    pub yy: Lanes,
    /// Σ ε_y·ε_v.
    pub yv: Lanes,
    /// Σ ε_v² of the answer.
    pub vv: Lanes,
}

/// Cells on end of one kind.
#[derive(Clone, Copy, Debug)]
struct Run {
    kind: Kind,
    cells: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// The gain moves.
    Moves,
    /// The gains stand still.
    Still,
    /// PV is missing.
    Missing,
}

/// Beginning of a stretch among innovations, gains and runs.
#[derive(Clone, Copy, Debug)]
struct Checkpoint {
    count: usize,
    gains: usize,
    runs: usize,
}

impl Whitened {
    /// Empty again, its room kept.
    pub(crate) fn clear(&mut self) {
        (self.count, self.gains_kept) = (0, 0);
        self.runs.clear();
        self.stretches.clear();
        (self.log_s, self.sums) = (Lanes::all(0.0), Sums::default());
    }

    /// Ready for another answer of the same models.
    pub(crate) fn forget_answer(&mut self) {
        (self.sums.yv, self.sums.vv) = (Lanes::all(0.0), Lanes::all(0.0));
    }

    /// Innovations of PV.
    pub fn of_y(&self) -> &[Lanes] {
        &self.of_y[..self.count]
    }

    /// Innovations of the answer.
    pub fn of_v(&self) -> &[Lanes] {
        &self.of_v[..self.count]
    }

    /// Notes where a stretch of so many cells begins, and makes room for it with models of so many states.
    fn begin(&mut self, cells: usize, states: usize) {
        self.stretches.push(Checkpoint { count: self.count, gains: self.gains_kept, runs: self.runs.len() });
        let (count, gains) = (self.count + cells, self.gains_kept + cells * (states + 1));
        if self.of_y.len() < count {
            self.of_y.resize(count, Lanes::default());
            self.of_v.resize(count, Lanes::default());
        }
        if self.gains.len() < gains {
            self.gains.resize(gains, Lanes::default());
        }
    }
}

impl Whitened {
    /// Room for the next innovations of both.
    #[inline(always)]
    fn next(&mut self, cells: usize) -> (&mut [Lanes], &mut [Lanes]) {
        let from = self.count;
        self.count += cells;
        (&mut self.of_y[from..self.count], &mut self.of_v[from..self.count])
    }

    /// Keeps the effect of an innovation on the states, and its weight.
    #[inline(always)]
    fn keep<S: Simd, const R: usize, const N: usize>(&mut self, l: &[Wide<S, R>; N], worth: Wide<S, R>) {
        let room = &mut self.gains[self.gains_kept..self.gains_kept + N + 1];
        for (room, gain) in room.iter_mut().zip(l.iter().chain([&worth])) {
            *room = gain.lanes();
        }
        self.gains_kept += N + 1;
    }

    /// Cells of one kind go on, or begin.
    #[inline(always)]
    fn run(&mut self, kind: Kind, cells: usize) {
        let first = self.stretches.last().map_or(0, |stretch| stretch.runs);
        match self.runs[first..].last_mut() {
            Some(run) if run.kind == kind && kind != Kind::Still => run.cells += cells,
            _ => self.runs.push(Run { kind, cells }),
        }
    }

    /// Keeps a process for [`Models::kept`].
    pub(crate) fn keep_process<S: Simd, const R: usize, const N: usize, const MORE: usize>(
        &mut self,
        models: &Models<S, R, N, MORE>,
    ) {
        self.process.clear();
        self.process.extend(models.transition.iter().flatten().chain([&models.pole]).map(|x| x.lanes()));
    }
}

/// Variances of which the product is gathered before its logarithm is taken: none is below 1 or far above 10⁹.
const GATHERED: u32 = 16;

/// Variance of the next innovation and the Kalman gain, kept while they move and frozen once they stand still.
struct Gain<S: Simd, const R: usize, const N: usize> {
    /// P is symmetric: the entries below its diagonal are not kept.
    p: [[Wide<S, R>; N]; N],
    /// F·P·Hᵀ/S: what an innovation does to the next states.
    l: [Wide<S, R>; N],
    s: Wide<S, R>,
    /// 1/S and its root.
    part: Wide<S, R>,
    scale: Wide<S, R>,
    /// S when it was last looked at, and how many cells ago that was.
    before: Wide<S, R>,
    since: u32,
    frozen: bool,
}

/// Cells from one look to the next whether S still moves, and by what part of itself it may, to be taken for still.
const LOOK: u32 = 4;
const MOVES: f64 = 1e-7;

impl<S: Simd, const R: usize, const N: usize> Gain<S, R, N> {
    /// S will move again.
    #[inline(always)]
    fn thaw(&mut self) {
        (self.frozen, self.since) = (false, 0);
    }

    /// Checks after each step whether S stands still, so that the gains can be kept.
    #[inline(always)]
    fn look(&mut self) {
        self.since += 1;
        if self.since == LOOK {
            let moves = Wide::all(self.s.simd, MOVES) * self.before;
            self.frozen = ((self.s - self.before).abs() - moves).max() < 0.0;
            (self.before, self.since) = (self.s, 0);
        }
    }

    #[inline(always)]
    fn p(&self, i: usize, j: usize) -> Wide<S, R> {
        if i < j { self.p[i][j] } else { self.p[j][i] }
    }
}

/// [`Sums`] while they grow.
struct Adding<S: Simd, const R: usize> {
    yy: Wide<S, R>,
    yv: Wide<S, R>,
    vv: Wide<S, R>,
}

impl<S: Simd, const R: usize> Adding<S, R> {
    #[inline(always)]
    fn of(simd: S, sums: &Sums) -> Self {
        let load = |lanes| Wide::load(simd, lanes);
        Self { yy: load(&sums.yy), yv: load(&sums.yv), vv: load(&sums.vv) }
    }

    #[inline(always)]
    fn add(&mut self, y: Wide<S, R>, v: Wide<S, R>) {
        self.yy += y * y;
        self.answer(y, v);
    }

    /// PV is the same as before.
    #[inline(always)]
    fn answer(&mut self, y: Wide<S, R>, v: Wide<S, R>) {
        self.yv += y * v;
        self.vv += v * v;
    }

    #[inline(always)]
    fn lanes(self) -> Sums {
        Sums { yy: self.yy.lanes(), yv: self.yv.lanes(), vv: self.vv.lanes() }
    }
}

/// [`Models::whiten`] of a stretch, a function of its own: a browser compiles one function of all passes so that they take a quarter
/// longer.
struct Whitening<'w, S: Simd, const R: usize, const N: usize, const MORE: usize> {
    models: &'w Models<S, R, N, MORE>,
    y: &'w [f64],
    changes: &'w [LoadChange],
    v: &'w Delayed<'w>,
    white: &'w mut Whitened,
}

impl<S: Simd, const R: usize, const N: usize, const MORE: usize> WithSimd for Whitening<'_, S, R, N, MORE> {
    type Output = ();

    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) {
        self.models.whitened(self.y, self.changes, self.v, self.white);
    }
}

/// [`Models::answer`], a function of its own likewise.
struct Answering<'w, S: Simd, const R: usize, const N: usize, const MORE: usize, const ONE: bool> {
    models: &'w Models<S, R, N, MORE>,
    stretch: usize,
    cells: usize,
    v: &'w Delayed<'w>,
    white: &'w mut Whitened,
}

impl<S: Simd, const R: usize, const N: usize, const MORE: usize, const ONE: bool> WithSimd
    for Answering<'_, S, R, N, MORE, ONE>
{
    type Output = ();

    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) {
        self.models.answered::<ONE>(self.stretch, self.cells, self.v, self.white);
    }
}

// Only what is inlined into a function for the registers of the machine is compiled for them.
impl<S: Simd, const R: usize, const N: usize, const MORE: usize> Models<S, R, N, MORE> {
    /// States of the process, behind which the load stands, and last the drift.
    const ORDER: usize = N - 1 - (MORE > 0) as usize;
    /// States that the process' rows look at.
    const INNER: usize = N - (MORE > 0) as usize;
    const LOAD: usize = Self::ORDER;
    const LAST: usize = N - 1;

    /// Innovations of `y` and of the answer to the positions `v`, for each sample of `y` that is a number; Kalman
    /// filter from an unknown start (the first [`START`] count as 0), the load unknown again at each of the `changes`.
    pub(crate) fn whiten(&self, y: &[f64], changes: &[LoadChange], v: &Delayed, white: &mut Whitened) {
        Simd::vectorize(self.simd, Whitening { models: self, y, changes, v, white });
    }

    #[cfg_attr(target_arch = "wasm32", inline(never))]
    #[cfg_attr(not(target_arch = "wasm32"), inline(always))]
    fn whitened(&self, y: &[f64], changes: &[LoadChange], v: &Delayed, white: &mut Whitened) {
        let all = |x| Wide::all(self.simd, x);
        let mut gain = self.start();
        let (mut of_y, mut of_v) = ([all(0.0); N], [all(0.0); N]);
        let mut seen = 0;
        let mut changes = changes.iter().peekable();
        white.begin(y.len(), N);
        let mut sums = Adding::of(self.simd, &white.sums);
        // Σ ln S: a product while S moves, a count once it stands still.
        let (mut log_s, mut product, mut gathered) = (all(0.0), all(1.0), 0);
        let mut k = 0;
        while k < y.len() {
            // The gain stands still up to the next change or hole.
            if gain.frozen {
                let end = changes.peek().map_or(y.len(), |change| (change.cell - 1).min(y.len()));
                let still = y[k..end.max(k)].iter().position(|y| y.is_nan()).unwrap_or(end.max(k) - k);
                if still > 0 {
                    white.keep(&gain.l, gain.scale);
                    white.run(Kind::Still, still);
                }
                let (out_y, out_v) = white.next(still);
                for ((y, out_y), out_v) in y[k..k + still].iter().zip(out_y).zip(out_v) {
                    let (e_y, e_v) = (self.unforeseen(&of_y, *y), self.unforeseen(&of_v, 0.0));
                    let (w_y, w_v) = (gain.scale * e_y, all(-1.0) * gain.scale * e_v);
                    sums.add(w_y, w_v);
                    (*out_y, *out_v) = (w_y.lanes(), w_v.lanes());
                    self.step(&mut of_y, &gain.l, e_y, None);
                    self.step(&mut of_v, &gain.l, e_v, Some(v.at(self.simd, k)));
                    k += 1;
                }
                log_s += all(still as f64) * gain.s.each(f64::ln);
                if k == y.len() {
                    break;
                }
            }
            let missing = y[k].is_nan();
            let change = changes.next_if(|change| change.cell == k + 1);
            if missing {
                gain.thaw();
                self.advance(&mut gain, true, change);
                self.pass(&mut of_y, None);
                self.pass(&mut of_v, Some(v.at(self.simd, k)));
                white.run(Kind::Missing, 1);
            } else {
                let (e_y, e_v) = (self.unforeseen(&of_y, y[k]), self.unforeseen(&of_v, 0.0));
                let worth = if seen < START { all(0.0) } else { gain.scale };
                seen += 1;
                // The model's own answer enters with the other sign: y − kp·answer.
                let (w_y, w_v) = (worth * e_y, all(-1.0) * worth * e_v);
                sums.add(w_y, w_v);
                let (out_y, out_v) = white.next(1);
                (out_y[0], out_v[0]) = (w_y.lanes(), w_v.lanes());
                if seen > START {
                    product *= gain.s;
                    gathered += 1;
                    if gathered == GATHERED {
                        log_s += product.each(f64::ln);
                        (product, gathered) = (all(1.0), 0);
                    }
                }
                self.advance(&mut gain, false, change);
                white.keep(&gain.l, worth);
                white.run(Kind::Moves, 1);
                self.step(&mut of_y, &gain.l, e_y, None);
                self.step(&mut of_v, &gain.l, e_v, Some(v.at(self.simd, k)));
            }
            k += 1;
        }
        log_s += product.each(f64::ln);
        white.log_s = (Wide::load(self.simd, &white.log_s) + log_s).lanes();
        white.sums = sums.lanes();
    }

    /// The innovations of the answer to other positions `v` in the stretch of that number, whose gains a pass of the same models
    /// has left. With `ONE` all the models are the first one's; then the innovations are only summed up.
    pub(crate) fn answer<const ONE: bool>(&self, stretch: usize, cells: usize, v: &Delayed, white: &mut Whitened) {
        Simd::vectorize(self.simd, Answering::<_, R, N, MORE, ONE> { models: self, stretch, cells, v, white });
    }

    /// A pass with another answer, by the gains of the last one.
    #[cfg_attr(target_arch = "wasm32", inline(never))]
    #[cfg_attr(not(target_arch = "wasm32"), inline(always))]
    fn answered<const ONE: bool>(&self, stretch: usize, cells: usize, v: &Delayed, white: &mut Whitened) {
        let load = |lanes: &Lanes| if ONE { Wide::all(self.simd, lanes[0]) } else { Wide::load(self.simd, lanes) };
        let minus = Wide::all(self.simd, -1.0);
        let mut x = [Wide::all(self.simd, 0.0); N];
        let Checkpoint { count, gains, runs } = white.stretches[stretch];
        let last = white.stretches.get(stretch + 1).map_or(white.runs.len(), |next| next.runs);
        let mut sums = Adding::of(self.simd, &white.sums);
        let (mut k, mut count, mut gains) = (0, count, gains);
        for run in &white.runs[runs..last] {
            let end = (k + run.cells).min(cells);
            let more = end - k;
            match run.kind {
                Kind::Missing => {
                    for k in k..end {
                        self.pass(&mut x, Some(v.at(self.simd, k)));
                    }
                }
                Kind::Still => {
                    let of = &white.gains[gains..gains + N + 1];
                    let (l, worth): ([_; N], _) = (array::from_fn(|i| load(&of[i])), load(&of[N]));
                    let out = white.of_y[count..count + more].iter().zip(&mut white.of_v[count..count + more]);
                    for (k, (of_y, of_v)) in (k..end).zip(out) {
                        let unforeseen = self.unforeseen(&x, 0.0);
                        let w_v = minus * worth * unforeseen;
                        sums.answer(load(of_y), w_v);
                        if !ONE {
                            *of_v = w_v.lanes();
                        }
                        self.step(&mut x, &l, unforeseen, Some(v.at(self.simd, k)));
                    }
                    (count, gains) = (count + more, gains + N + 1);
                }
                Kind::Moves => {
                    let out = white.of_y[count..count + more].iter().zip(&mut white.of_v[count..count + more]);
                    let of = white.gains[gains..gains + more * (N + 1)].chunks_exact(N + 1);
                    for ((k, (of_y, of_v)), of) in (k..end).zip(out).zip(of) {
                        let (l, worth): ([_; N], _) = (array::from_fn(|i| load(&of[i])), load(&of[N]));
                        let unforeseen = self.unforeseen(&x, 0.0);
                        let w_v = minus * worth * unforeseen;
                        sums.answer(load(of_y), w_v);
                        if !ONE {
                            *of_v = w_v.lanes();
                        }
                        self.step(&mut x, &l, unforeseen, Some(v.at(self.simd, k)));
                    }
                    (count, gains) = (count + more, gains + more * (N + 1));
                }
            }
            k = end;
            if k == cells {
                break;
            }
        }
        white.sums = sums.lanes();
    }

    /// The models whose process was kept; they answer, and know nothing of variances.
    #[inline(always)]
    pub(crate) fn kept<const ONE: bool>(simd: S, white: &Whitened) -> Self {
        let load = |lanes: &Lanes| if ONE { Wide::all(simd, lanes[0]) } else { Wide::load(simd, lanes) };
        let nothing = Wide::all(simd, 0.0);
        Self {
            simd,
            transition: array::from_fn(|i| array::from_fn(|j| load(&white.process[i * N + j]))),
            q_load: nothing,
            q_more: nothing,
            pole: load(&white.process[N * N]),
        }
    }

    /// PV of the first process from rest, without load and noise, at these positions.
    #[inline(always)]
    pub(crate) fn response(&self, v: &[f64]) -> Vec<f64> {
        let mut x = [Wide::all(self.simd, 0.0); N];
        let step = |v: &f64| {
            let now = x[0].lanes()[0];
            self.pass(&mut x, Some(Wide::all(self.simd, *v)));
            now
        };
        v.iter().map(step).collect()
    }

    /// Part of `y` that the states `x` did not predict.
    #[inline(always)]
    fn unforeseen(&self, x: &[Wide<S, R>; N], y: f64) -> Wide<S, R> {
        let rest = Wide::all(self.simd, y) - x[0];
        if MORE == DRIFT { rest - x[Self::LAST] } else { rest }
    }

    /// The states a cell later, without a sample of PV; `v`: the position. The load stays where it is and the drift fades: only the
    /// process' rows are full.
    #[inline(always)]
    fn pass(&self, x: &mut [Wide<S, R>; N], v: Option<Wide<S, R>>) {
        let before = *x;
        for i in 0..Self::ORDER {
            x[i] = self.row(i, |j| before[j]);
            if let Some(v) = v {
                x[i] += self.transition[i][Self::LOAD] * v;
            }
        }
        if MORE >= SLOPE {
            x[Self::LOAD] += before[Self::LAST];
        }
        if MORE > 0 {
            x[Self::LAST] = self.pole * before[Self::LAST];
        }
    }

    /// One cell with a sample of PV. What was not foreseen comes last, since it waits for the states.
    #[inline(always)]
    fn step(&self, x: &mut [Wide<S, R>; N], l: &[Wide<S, R>; N], unforeseen: Wide<S, R>, v: Option<Wide<S, R>>) {
        self.pass(x, v);
        for i in 0..N {
            x[i] += l[i] * unforeseen;
        }
    }

    /// A row of the transition times a column.
    #[inline(always)]
    fn row(&self, i: usize, of: impl Fn(usize) -> Wide<S, R>) -> Wide<S, R> {
        let mut sum = self.transition[i][0] * of(0);
        for j in 1..Self::INNER {
            sum += self.transition[i][j] * of(j);
        }
        sum
    }

    #[inline(always)]
    fn start(&self) -> Gain<S, R, N> {
        let all = |x| Wide::all(self.simd, x);
        let nothing = all(0.0);
        let mut p = [[nothing; N]; N];
        for (i, row) in p.iter_mut().enumerate() {
            row[i] = all(UNKNOWN);
        }
        if MORE > 0 && MORE != LINES {
            let at_start = self.q_more / (all(1.0) - self.pole * self.pole);
            p[Self::LAST][Self::LAST] = at_start.each(|variance| variance.min(UNKNOWN));
        }
        let [s, part, scale, before] = [nothing; 4];
        let mut gain = Gain { p, l: [nothing; N], s, part, scale, before, since: 0, frozen: false };
        self.measure(&mut gain);
        gain
    }

    /// Variance of the next innovation, from P.
    #[inline(always)]
    fn measure(&self, gain: &mut Gain<S, R, N>) {
        let d = Self::LAST;
        let one = Wide::all(self.simd, 1.0);
        gain.s = gain.p[0][0] + one;
        if MORE == DRIFT {
            gain.s += gain.p[0][d] + gain.p[0][d] + gain.p[d][d];
        }
        gain.part = one / gain.s;
        gain.scale = gain.part.sqrt();
    }

    /// One step on, with the effect of the innovation on the states. The gain of a stretch without holes settles; from
    /// then on it is not worked out again.
    #[cfg_attr(target_arch = "wasm32", inline(never))]
    #[cfg_attr(not(target_arch = "wasm32"), inline(always))]
    fn advance(&self, gain: &mut Gain<S, R, N>, missing: bool, change: Option<&LoadChange>) {
        if gain.frozen && change.is_none() {
            return;
        }
        if change.is_some() {
            gain.thaw();
        }
        self.predict(gain, missing);
        if let Some(change) = change {
            let before = Wide::load(self.simd, &change.before);
            let variance = Wide::load(self.simd, &change.variance);
            let reached = self.reached(before);
            let (from, to) = if MORE == LINES { (Self::LOAD, Self::LAST) } else { (0, Self::LOAD) };
            for i in from..=to {
                for j in i..=to {
                    gain.p[i][j] += variance * reached[i] * reached[j];
                }
            }
            if MORE != LINES {
                let blur = self.blur();
                for i in 0..Self::ORDER {
                    for j in i..Self::ORDER {
                        gain.p[i][j] += variance * blur[i][j];
                    }
                }
            }
        }
        self.measure(gain);
        gain.look();
    }

    /// The covariance a cell later, and the effect of an innovation on the states there.
    #[inline(always)]
    fn predict(&self, gain: &mut Gain<S, R, N>, missing: bool) {
        let d = Self::LAST;
        // F·P, of which only the process' rows are new, and F·P·Hᵀ.
        let mut half = [[Wide::all(self.simd, 0.0); N]; N];
        for i in 0..Self::ORDER {
            for j in 0..N {
                half[i][j] = self.row(i, |m| gain.p(m, j));
            }
        }
        let mut ahead: [Wide<S, R>; N] = array::from_fn(|i| if i < Self::ORDER { half[i][0] } else { gain.p[0][i] });
        if MORE == DRIFT {
            for i in 0..N {
                ahead[i] += if i < Self::ORDER { half[i][d] } else { gain.p[i][d] };
            }
        }
        if MORE >= SLOPE {
            ahead[Self::LOAD] += ahead[d];
        }
        if MORE > 0 {
            ahead[d] *= self.pole;
        }
        // F·P·Fᵀ.
        for i in 0..Self::ORDER {
            for j in i..Self::ORDER {
                gain.p[i][j] = self.row(j, |m| half[i][m]);
            }
        }
        for i in 0..Self::ORDER {
            gain.p[i][Self::LOAD] = half[i][Self::LOAD];
        }
        if MORE >= SLOPE {
            // The load goes on by its slope, which all that knows of the load then knows too.
            for i in 0..Self::ORDER {
                gain.p[i][Self::LOAD] += half[i][d];
            }
            let both = gain.p[Self::LOAD][d];
            gain.p[Self::LOAD][Self::LOAD] += both + both + gain.p[d][d];
            gain.p[Self::LOAD][d] = both + gain.p[d][d];
        }
        if MORE > 0 {
            for i in 0..Self::ORDER {
                gain.p[i][d] = self.pole * half[i][d];
            }
            gain.p[Self::LOAD][d] *= self.pole;
            gain.p[d][d] = self.pole * self.pole * gain.p[d][d];
        }
        if !missing {
            for i in 0..N {
                gain.l[i] = ahead[i] * gain.part;
            }
            for i in 0..N {
                for j in i..N {
                    gain.p[i][j] -= gain.l[i] * ahead[j];
                }
            }
        }
        gain.p[Self::LOAD][Self::LOAD] += self.q_load;
        if MORE > 0 {
            gain.p[d][d] += self.q_more;
        }
    }

    /// Covariance of the effects on the process of a step anywhere in its cell, or spread over it, beside those of one in its middle; the
    /// step's variance is [`BLURRED`] of the one that is not known at all.
    #[inline(always)]
    fn blur(&self) -> [[Wide<S, R>; N]; N] {
        array::from_fn(|i| {
            array::from_fn(|j| {
                if i >= Self::ORDER || j >= Self::ORDER {
                    return Wide::all(self.simd, 0.0);
                }
                let (p, q) = (Self::ORDER - i, Self::ORDER - j);
                let covariance = 1.0 / (p + q + 1) as f64 - 1.0 / ((p + 1) * (q + 1)) as f64;
                let both = self.transition[i][Self::LOAD] * self.transition[j][Self::LOAD];
                both * Wide::all(self.simd, covariance * BLURRED)
            })
        })
    }

    /// Effect on the states of a change so long before a cell; the last state follows at once, the others one after
    /// another.
    #[inline(always)]
    fn reached(&self, before: Wide<S, R>) -> [Wide<S, R>; N] {
        let (nothing, one) = (Wide::all(self.simd, 0.0), Wide::all(self.simd, 1.0));
        let mut reached = [nothing; N];
        if MORE == LINES {
            // The slope began to change the load before the cell did.
            (reached[Self::LOAD], reached[Self::LAST]) = (before, one);
            return reached;
        }
        reached[Self::LOAD] = one;
        let mut later = before;
        for i in (0..Self::ORDER).rev() {
            reached[i] = later * self.transition[i][Self::LOAD];
            later *= before;
        }
        reached
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_of_all_models_are_those_of_each() {
        let times = [120.3, 40.0, 119.6, 7.5, 120.9];
        let bits = |changes: Vec<LoadChange>| {
            let of = |c: &LoadChange| (c.cell, c.variance.map(f64::to_bits), c.before.map(f64::to_bits));
            changes.iter().map(of).collect::<Vec<_>>()
        };
        assert_eq!(bits(LoadChange::alike(&times)), bits(LoadChange::gathered((0..8).map(|_| times.to_vec()))));
    }
}
