//! The families of models that are tried: lags, an integrator or none, and where the disturbance enters.

use crate::kalman::{Asked, DRIFT, Delayed, Found, LINES, LoadChange, Models, SLOPE, Sought, Totals, Whitened};
use crate::lanes::{LANES, Lanes, Wide, Work, wide_enough, widest};
use pulp::{Scalar, Simd, WithSimd};
use serde::{Deserialize, Serialize};
use std::array;
use std::iter::once;

/// Source of the disturbance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Noise {
    /// A load at the input that stands still but for the steps that are marked, and white noise on PV.
    Still,
    /// A load that walks at the input of the process, and white noise on PV.
    Input,
    /// A load at the input whose slope walks and fades, and white noise on PV: it goes along lines, or follows steps late.
    Slope,
    /// A load at the input that goes along lines, whose slope changes where it is marked, and white noise on PV.
    Lines,
    /// Lines whose slope also walks between its marks.
    Bends,
    /// A drift of first order at the output, and white noise on PV.
    Output,
    /// Output and input.
    Both,
}

impl Noise {
    /// Name for a reader of an answer: marks at which a slope changes, or also walks between, are both called lines.
    pub fn name(self) -> &'static str {
        match self {
            Noise::Still => "still",
            Noise::Input => "input",
            Noise::Output => "output",
            Noise::Slope => "slope",
            Noise::Lines | Noise::Bends => "lines",
            Noise::Both => "both",
        }
    }
}

/// One family: `lags` first-order lags (two of them may oscillate), perhaps an integrator, dead time, disturbance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Structure {
    /// Lags: 2, 3, or 1 with an integrator.
    pub lags: usize,
    /// One integrator behind them.
    pub integrating: bool,
    /// Place where the disturbance enters.
    pub noise: Noise,
}

/// The macro `$with`, given how many states the process and its disturbance have together, and which the disturbance is.
macro_rules! by_states {
    ($structure:expr, $with:ident) => {
        match ($structure.order(), $structure.noise) {
            (2, Noise::Still | Noise::Input) => $with!(3, 0),
            (2, Noise::Slope) => $with!(4, SLOPE),
            (2, Noise::Lines | Noise::Bends) => $with!(4, LINES),
            (2, _) => $with!(4, DRIFT),
            (_, Noise::Still | Noise::Input) => $with!(4, 0),
            (_, Noise::Slope) => $with!(5, SLOPE),
            (_, Noise::Lines | Noise::Bends) => $with!(5, LINES),
            (_, _) => $with!(5, DRIFT),
        }
    };
}

/// The same of a load that steps or bends: no other has marks.
macro_rules! by_marked_states {
    ($structure:expr, $with:ident) => {
        match ($structure.order(), $structure.noise) {
            (2, Noise::Still | Noise::Input) => $with!(3, 0),
            (2, Noise::Lines | Noise::Bends) => $with!(4, LINES),
            (_, Noise::Still | Noise::Input) => $with!(4, 0),
            (_, Noise::Lines | Noise::Bends) => $with!(5, LINES),
            (_, noise) => unreachable!("nothing is marked under {noise:?}"),
        }
    };
}

/// Kind of a load between its marks.
#[derive(Clone, Copy, PartialEq)]
pub enum Load {
    /// Constant, with steps.
    Levels,
    /// Along straight lines, with bends.
    Lines,
}

impl Load {
    /// Disturbance of a load that may walk between its marks.
    pub fn noise(self) -> Noise {
        if self == Self::Levels { Noise::Input } else { Noise::Bends }
    }

    /// Variances that are tried for how a load, or its slope, walks in a cell: the least of them, and from one to the next [ln of the
    /// noise's variance].
    pub fn walks(self) -> [f64; 2] {
        if self == Self::Levels { [-8.0, 2.5] } else { [-24.0, 4.0] }
    }

    /// Kind of the load in a family.
    pub fn of(structure: Structure) -> Self {
        if matches!(structure.noise, Noise::Lines | Noise::Bends) { Self::Lines } else { Self::Levels }
    }
}

/// Variance by which a load that stands still may yet walk in a cell: nothing, but for the rounding of the filter.
const STILL: f64 = 1e-5;
/// Variance of the walk of a slope that stands still.
const STRAIGHT: f64 = 1e-10;

/// Ratio of a lag to the lag beside it from which on it stands for an integrator.
const LASTS: f64 = 50.0;

/// Most parameters that a structure can have.
pub const MOST: usize = 7;

/// The parameters of a structure in the order in which the search moves them, all on scales where a step of 1 is large:
/// ln T, ln ζ (two lags or more), ln T₃ (three lags), dead time in cells, then of the noise ln q_load, ln q_more,
/// logit of the drift's pole. T in cells; two lags are 1/(1 + 2ζTs + T²s²).
pub type Theta = [f64; MOST];

impl Structure {
    /// Process families: two lags hold one (the other goes to nothing), an integrator holds one with a lag.
    const PROCESSES: [(usize, bool); 3] = [(2, false), (3, false), (1, true)];

    /// The families that every record is tried with, for one kind of disturbance.
    pub fn with(noise: Noise) -> [Self; 3] {
        Self::PROCESSES.map(|(lags, integrating)| Self { lags, integrating, noise })
    }

    /// Number of its parameters in θ.
    pub fn parameters(self) -> usize {
        self.lags + 1 + self.noise_parameters()
    }

    fn noise_parameters(self) -> usize {
        match self.noise {
            Noise::Still | Noise::Lines => 0,
            Noise::Input | Noise::Bends => 1,
            Noise::Output | Noise::Slope => 2,
            Noise::Both => 3,
        }
    }

    /// Place of the dead time in θ.
    pub fn dead_time_at(self) -> usize {
        self.lags
    }

    /// A beginning for the search: lags of `t` cells in all, dead time `dead` cells.
    pub fn beginning(self, t: f64, dead: f64) -> Theta {
        let mut theta = [0.0; MOST];
        match self.lags {
            1 => theta[0] = t.ln(),
            2 => (theta[0], theta[1]) = ((t / 2.0).ln(), 0.1),
            _ => (theta[0], theta[1], theta[2]) = ((t / 3.0).ln(), 0.1, (t / 3.0).ln()),
        }
        let d = self.lags;
        theta[d] = dead;
        match self.noise {
            Noise::Still | Noise::Lines => {}
            Noise::Input => theta[d + 1] = -2.0,
            Noise::Bends => theta[d + 1] = -10.0,
            Noise::Output => (theta[d + 1], theta[d + 2]) = (-2.0, 2.0),
            Noise::Slope => (theta[d + 1], theta[d + 2]) = (-6.0, 3.0),
            Noise::Both => (theta[d + 1], theta[d + 2], theta[d + 3]) = (-3.0, -3.0, 2.0),
        }
        theta
    }

    /// The nearest θ within bounds, for a record of `n` cells.
    pub fn bounded(self, mut theta: Theta, n: f64) -> Theta {
        let long = (n / 4.0).ln();
        match self.lags {
            1 => theta[0] = theta[0].clamp(-3.0, long),
            _ => {
                theta[0] = theta[0].clamp(-3.0, long);
                theta[1] = theta[1].clamp(-2.3, 1.6);
            }
        }
        if self.lags == 3 {
            theta[2] = theta[2].clamp(-3.0, long);
        }
        let d = self.lags;
        theta[d] = theta[d].clamp(0.0, (n / 6.0).min(80.0));
        // A slope of next to no variance still bends the load in the end.
        let least = if matches!(self.noise, Noise::Slope | Noise::Bends) { -30.0 } else { -10.0 };
        for i in d + 1..self.parameters() {
            theta[i] = theta[i].clamp(least, 14.0);
        }
        if matches!(self.noise, Noise::Output | Noise::Slope | Noise::Both) {
            let pole = self.parameters() - 1;
            theta[pole] = theta[pole].clamp(-3.0, 10.0);
        }
        theta
    }

    /// Coefficients of 1, s, s² … [cellsᵏ], with the integrator if there is one; those beyond the order are 0.
    pub fn denominator(self, theta: &Theta) -> [f64; 4] {
        let t = theta[0].exp();
        if self.integrating {
            return [0.0, 1.0, t, 0.0];
        }
        let mut den = [1.0, 2.0 * theta[1].exp() * t, t * t, 0.0];
        if self.lags == 3 {
            let t = theta[2].exp();
            for i in (1..den.len()).rev() {
                den[i] += t * den[i - 1];
            }
        }
        den
    }

    /// Denominator in time, with cells of `h` seconds; behind an integrator, whose gain is a velocity, divided by `h`.
    pub fn denominator_in(self, theta: &Theta, h: f64) -> [f64; 4] {
        let den = self.denominator(theta);
        let mut power = if self.integrating { 1.0 / h } else { 1.0 };
        den.map(|coefficient| {
            let scaled = coefficient * power;
            power *= h;
            scaled
        })
    }

    /// Lags together [cells]: the coefficient of s in the denominator, of s² behind an integrator.
    pub fn lag(self, theta: &Theta) -> f64 {
        self.denominator(theta)[1 + usize::from(self.integrating)]
    }

    /// Settling time of PV [cells]: its lags; behind an integrator, which answers at once, with the dead time.
    pub fn settles(self, theta: &Theta) -> f64 {
        self.lag(theta) + if self.integrating { theta[self.dead_time_at()] } else { 0.0 }
    }

    /// Whether two sets of parameters are of one process: lags and dead time within a third of their sum.
    pub fn alike(self, a: &Theta, b: &Theta) -> bool {
        let (lags, dead) = ([self.lag(a), self.lag(b)], [a[self.dead_time_at()], b[self.dead_time_at()]]);
        let near = 0.5 + (lags[0] + dead[0]) / 3.0;
        (lags[0] - lags[1]).abs() < near && (dead[0] - dead[1]).abs() < near
    }

    /// The nearest parameters of two lags with a load that walks.
    pub fn as_pilot(self, theta: &Theta) -> Theta {
        let mut pilot = [0.0; MOST];
        if self.integrating {
            // An integrator is a lag that lasts.
            let (shorter, longer) = (theta[0].exp(), LASTS * theta[0].exp().max(1.0));
            pilot[0] = 0.5 * (shorter * longer).ln();
            pilot[1] = (0.5 * (shorter + longer)).ln() - pilot[0];
        } else {
            (pilot[0], pilot[1]) = (theta[0], theta[1]);
        }
        // The third lag becomes dead time.
        pilot[2] = theta[self.dead_time_at()] + if self.lags == 3 { theta[2].exp() } else { 0.0 };
        pilot[3] = match self.noise {
            Noise::Still => -6.0,
            Noise::Output | Noise::Slope | Noise::Lines | Noise::Bends => -2.0,
            _ => theta[self.lags + 1],
        };
        pilot
    }

    /// The process with gain 1, held input, one cell a step; its first state is its output, the others its
    /// derivatives in units of the time constant τ, which keeps all of one size.
    pub(crate) fn models<S: Simd, const R: usize, const N: usize, const MORE: usize>(
        self,
        simd: S,
        thetas: &[Theta; LANES],
    ) -> Models<S, R, N, MORE> {
        Simd::vectorize(simd, Discretisation::<_, R, N, MORE> { structure: self, thetas, simd })
    }

    #[inline(always)]
    fn discrete<S: Simd, const R: usize, const N: usize, const MORE: usize>(
        self,
        simd: S,
        thetas: &[Theta; LANES],
    ) -> Models<S, R, N, MORE> {
        let order = N - 1 - (MORE > 0) as usize;
        let mut generator = [[Lanes::default(); N]; N];
        for (l, theta) in thetas.iter().enumerate() {
            let den = self.denominator(theta);
            let tau = if self.integrating { den[2] } else { den[order].powf(1.0 / order as f64) };
            for i in 0..order - 1 {
                generator[i][i + 1][l] = 1.0 / tau;
            }
            let mut scale = tau.powi(order as i32 - 1) / den[order];
            generator[order - 1][order][l] = scale;
            for j in 0..order {
                generator[order - 1][j][l] = -den[j] * scale;
                scale /= tau;
            }
        }
        let transition = exponential(simd, generator);
        let (nothing, one) = (Wide::all(simd, 0.0), Wide::all(simd, 1.0));
        let noise = |place: usize, scale: fn(f64) -> f64| {
            Wide::load(simd, &Lanes::each(|l| scale(thetas[l][self.lags + 1 + place])))
        };
        let (q_load, q_more, pole) = match self.noise {
            Noise::Still => (Wide::all(simd, STILL), nothing, nothing),
            Noise::Input => (noise(0, f64::exp), nothing, nothing),
            Noise::Lines => (Wide::all(simd, STILL), Wide::all(simd, STRAIGHT), one),
            Noise::Bends => (Wide::all(simd, STILL), noise(0, f64::exp), one),
            Noise::Output => (nothing, noise(0, f64::exp), noise(1, logistic)),
            Noise::Slope => (Wide::all(simd, STILL), noise(0, f64::exp), noise(1, logistic)),
            Noise::Both => (noise(0, f64::exp), noise(1, f64::exp), noise(2, logistic)),
        };
        Models { simd, transition, q_load, q_more, pole }
    }

    /// Whitens PV and the answers of eight models to positions, stretch after stretch.
    ///
    /// - `lanes`: so many of the models count; the others may be left out.
    /// - `stretches`: of each its PV, the changes of its load and its positions.
    /// - `white`: takes the innovations, their sums, and the gains for [`Self::answer`].
    pub fn whiten<'a>(
        self,
        lanes: usize,
        thetas: &[Theta; LANES],
        stretches: &mut dyn Iterator<Item = (&'a [f64], &'a [LoadChange], Delayed<'a>)>,
        white: &mut Whitened,
    ) {
        white.clear();
        wide_enough(lanes, Whiten { structure: self, thetas, stretches, white });
    }

    /// The answers to other positions with the gains that [`Self::whiten`] has left.
    ///
    /// - `lanes`: so many of the models count.
    /// - `stretches`: of each its cells and its positions.
    /// - `white`: of the same models; PV's innovations stay.
    pub fn answer<'a>(
        self,
        lanes: usize,
        stretches: &mut dyn Iterator<Item = (usize, Delayed<'a>)>,
        white: &mut Whitened,
    ) {
        white.forget_answer();
        wide_enough(lanes, Answer::<false> { structure: self, first: 0, stretches, white });
    }

    /// Sums of the answers of the first model to eight sets of positions in one stretch, with the gains that [`Self::whiten`] has left.
    pub fn answers_of_first(self, stretch: usize, cells: usize, v: Delayed, white: &mut Whitened) {
        white.forget_answer();
        widest(Answer::<true> { structure: self, first: stretch, stretches: &mut once((cells, v)), white });
    }

    /// Totals of a stretch with other changes of a load that steps or bends; see [`Sides`](crate::kalman::Sides).
    pub fn elsewhere(self, asked: Asked) -> Totals {
        wide_enough(asked.tried.len(), Elsewhere { structure: self, asked })
    }

    /// Changes of a load that steps or bends, by a bank of filters.
    pub fn bank(self, sought: &Sought) -> Found {
        widest(Bank { structure: self, sought })
    }

    /// States of the process.
    fn order(self) -> usize {
        self.lags + usize::from(self.integrating)
    }

    /// PV of the process from rest, with gain 1, without load and noise, at the positions `v`.
    pub fn response(self, theta: &Theta, v: &[f64]) -> Vec<f64> {
        // One model alone: a register of one number is wide enough.
        macro_rules! with {
            ($states:literal, $more:expr) => {
                self.models::<Scalar, 1, $states, { $more }>(Scalar::new(), &[*theta; LANES]).response(v)
            };
        }
        by_states!(self, with)
    }
}

/// [`Structure::models`], a function of its own: all passes need it.
struct Discretisation<'d, S, const R: usize, const N: usize, const MORE: usize> {
    structure: Structure,
    thetas: &'d [Theta; LANES],
    simd: S,
}

impl<S: Simd, const R: usize, const N: usize, const MORE: usize> WithSimd for Discretisation<'_, S, R, N, MORE> {
    type Output = Models<S, R, N, MORE>;

    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> Models<S, R, N, MORE> {
        self.structure.discrete(self.simd, self.thetas)
    }
}

/// See [`Structure::whiten`].
struct Whiten<'w, 'a> {
    structure: Structure,
    thetas: &'w [Theta; LANES],
    stretches: &'w mut dyn Iterator<Item = (&'a [f64], &'a [LoadChange], Delayed<'a>)>,
    white: &'w mut Whitened,
}

impl Work for Whiten<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, simd: S) {
        let Self { structure, thetas, stretches, white } = self;
        // A loop and no closure: only what is inlined here is compiled for the registers of the machine.
        macro_rules! with {
            ($states:literal, $more:expr) => {{
                let models = structure.models::<S, R, $states, { $more }>(simd, thetas);
                white.keep_process(&models);
                for (y, changes, v) in stretches {
                    models.whiten(y, changes, &v, white);
                }
            }};
        }
        by_states!(structure, with);
    }
}

/// See [`Structure::answer`]; with `ONE` all models are the first one's, see [`Structure::answers_of_first`].
struct Answer<'w, 'a, const ONE: bool> {
    structure: Structure,
    /// Place of the first stretch.
    first: usize,
    stretches: &'w mut dyn Iterator<Item = (usize, Delayed<'a>)>,
    white: &'w mut Whitened,
}

impl<const ONE: bool> Work for Answer<'_, '_, ONE> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, simd: S) {
        let Self { structure, first, stretches, white } = self;
        macro_rules! with {
            ($states:literal, $more:expr) => {{
                let models = Models::<S, R, $states, { $more }>::kept::<ONE>(simd, white);
                for (stretch, (cells, v)) in (first..).zip(stretches) {
                    models.answer::<ONE>(stretch, cells, &v, white);
                }
            }};
        }
        by_states!(structure, with);
    }
}

/// See [`Structure::elsewhere`].
struct Elsewhere<'s, 't> {
    structure: Structure,
    asked: Asked<'s, 't>,
}

impl Work for Elsewhere<'_, '_> {
    type Output = Totals;

    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, simd: S) -> Totals {
        let Self { structure, asked } = self;
        macro_rules! with {
            ($states:literal, $more:expr) => {
                structure.models::<S, R, $states, { $more }>(simd, &[*asked.theta; LANES]).elsewhere(asked)
            };
        }
        by_marked_states!(structure, with)
    }
}

/// See [`Structure::bank`].
pub(crate) struct Bank<'s, 'b> {
    pub(crate) structure: Structure,
    pub(crate) sought: &'s Sought<'b>,
}

impl Work for Bank<'_, '_> {
    type Output = Found;

    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, simd: S) -> Found {
        let Self { structure, sought } = self;
        macro_rules! with {
            ($states:literal, $more:expr) => {
                structure.models::<S, R, $states, { $more }>(simd, &[*sought.theta; LANES]).bank(sought)
            };
        }
        by_marked_states!(structure, with)
    }
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// e^a of eight matrices at once: the series for a 2^s-th of each, small enough for 12 terms to be exact, then s squarings.
#[inline(always)]
fn exponential<S: Simd, const R: usize, const N: usize>(simd: S, a: [[Lanes; N]; N]) -> [[Wide<S, R>; N]; N] {
    let norm = a.iter().flatten().flat_map(|x| x.iter()).fold(0.0, |norm: f64, x| norm.max(x.abs()));
    let squarings = (norm * N as f64 / 0.5).log2().ceil().max(0.0);
    let part = Wide::all(simd, (-squarings).exp2());
    let a = a.map(|row| row.map(|x| Wide::load(simd, &x) * part));
    let one = |i, j| Wide::all(simd, if i == j { 1.0 } else { 0.0 });
    let mut sum: [[Wide<S, R>; N]; N] = array::from_fn(|i| array::from_fn(|j| one(i, j)));
    // Horner: 1 + a(1 + a/2(1 + a/3(…))).
    for term in (1..=12).rev() {
        let by = Wide::all(simd, 1.0 / f64::from(term));
        sum = product(&a, &sum);
        for i in 0..N {
            for j in 0..N {
                sum[i][j] = sum[i][j] * by + one(i, j);
            }
        }
    }
    for _ in 0..squarings as usize {
        sum = product(&sum, &sum);
    }
    sum
}

#[inline(always)]
fn product<S: Simd, const R: usize, const N: usize>(
    a: &[[Wide<S, R>; N]; N],
    b: &[[Wide<S, R>; N]; N],
) -> [[Wide<S, R>; N]; N] {
    let mut c = *a;
    for i in 0..N {
        for j in 0..N {
            c[i][j] = a[i][0] * b[0][j];
            for k in 1..N {
                c[i][j] += a[i][k] * b[k][j];
            }
        }
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kalman::Sums;
    use glapp_sim::Matrix;

    #[test]
    fn eight_exponentials_are_each_what_one_is() {
        let entry = |l: usize, i: usize, j: usize| f64::from((7 * l + 3 * i + 5 * j) as u32 % 11) - 5.0;
        let many: [[Wide<_, LANES>; 4]; 4] =
            exponential(Scalar::new(), array::from_fn(|i| array::from_fn(|j| Lanes::each(|l| entry(l, i, j)))));
        let many = many.map(|row| row.map(Wide::lanes));
        for l in 0..LANES {
            let mut one = Matrix::zeros(4);
            (0..16).for_each(|at| one.set(at / 4, at % 4, entry(l, at / 4, at % 4)));
            let one = one.exp();
            let size = (0..16).map(|at| one.get(at / 4, at % 4).abs()).fold(0.0, f64::max);
            for at in 0..16 {
                let off = (many[at / 4][at % 4][l] - one.get(at / 4, at % 4)).abs();
                assert!(off < 1e-11 * size, "lane {l}: {off} of {size}");
            }
        }
    }

    #[test]
    fn a_lag_sampled_is_its_step_response() {
        // One lag of 3 cells, the other next to nothing: after k cells of input 1 its output is 1 − e^(−k/3).
        let structure = Structure { lags: 2, integrating: false, noise: Noise::Input };
        let (t1, t2): (f64, f64) = (3.0, 1e-4);
        let mut theta = [0.0; MOST];
        (theta[0], theta[1]) = ((t1 * t2).sqrt().ln(), ((t1 + t2) / 2.0 / (t1 * t2).sqrt()).ln());
        let models = structure.models::<Scalar, LANES, 3, 0>(Scalar::new(), &[theta; LANES]);
        let transition = models.transition.map(|row| row.map(Wide::lanes));
        let mut x = [0.0; 2];
        for k in 1..=10 {
            let row = |i: usize| transition[i][0][0] * x[0] + transition[i][1][0] * x[1] + transition[i][2][0];
            x = [row(0), row(1)];
            let truth = 1.0 - (-f64::from(k) / 3.0).exp();
            assert!((x[0] - truth).abs() < 1e-4, "{k}: {} for {truth}", x[0]);
        }
    }

    /// Innovations and sums of a record with a hole and a change of the load, in registers of the instructions `S`: of a point and its
    /// derivatives; then with other positions, by the gains that are kept.
    fn whitened<S: Simd, const R: usize>(simd: S, structure: Structure) -> Vec<u64> {
        let mut y: Vec<f64> =
            (0..200).map(|k| (f64::from(k) * 0.1 - 1.0).sin() + 0.01 * f64::from(k * 7919 % 13)).collect();
        y[70..75].fill(f64::NAN);
        let positions =
            |late: f64| (0..200).map(|k| Lanes::all((f64::from(k) * 0.1 - late).sin())).collect::<Vec<Lanes>>();
        let thetas = array::from_fn(|l| {
            let mut theta = structure.beginning(8.0, 2.4);
            if l > 0 {
                theta[l - 1] += 0.01;
            }
            theta
        });
        let (changes, mut white) = (LoadChange::alike(&[120.3]), Whitened::default());
        let mut bits = Vec::new();
        let mut keep = |white: &Whitened| {
            let Sums { yy, yv, vv } = white.sums;
            let all = white.of_y().iter().chain(white.of_v()).chain([&white.log_s, &yy, &yv, &vv]);
            bits.extend(all.flat_map(|lanes| lanes.map(f64::to_bits).into_iter().take(structure.parameters() + 1)));
        };
        let first = positions(0.2);
        let stretches = &mut once((y.as_slice(), changes.as_slice(), Delayed::Each(&first)));
        Whiten { structure, thetas: &thetas, stretches, white: &mut white }.run::<S, R>(simd);
        keep(&white);
        white.forget_answer();
        let second = positions(0.3);
        let stretches = &mut once((y.len(), Delayed::Each(&second)));
        Answer::<false> { structure, first: 0, stretches, white: &mut white }.run::<S, R>(simd);
        keep(&white);
        bits
    }

    #[test]
    fn registers_of_every_width_give_the_same_bits() {
        let of_lines = [Noise::Slope, Noise::Lines, Noise::Bends];
        for noise in [Noise::Still, Noise::Input, Noise::Output, Noise::Both].into_iter().chain(of_lines) {
            for (lags, integrating) in [(2, false), (3, false), (1, true)] {
                let structure = Structure { lags, integrating, noise };
                let alone = whitened::<Scalar, LANES>(Scalar::new(), structure);
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
                                let bits = whitened::<$instructions, $registers>(simd, structure);
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
