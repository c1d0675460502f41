//! The standard deviation of a signal's fast noise, on line.

use crate::{Numbers, Real};

/// A value repeated so many times in a row is held, by a transmitter or a historian, and tells nothing of the noise.
pub(crate) const HELD: u8 = 5;
/// Number of differences that m begins with, and number after which σ is known.
const BEGINNING: u8 = 8;
const ENOUGH: u8 = 20;
/// 1/(0.6745·√70): from the median of |fourth difference| of white noise to its standard deviation.
const OF_MEDIAN: f64 = 0.177_202_165_950_243_68;
/// 1/√12: the standard deviation of what rounding to a grid of 1 leaves.
const OF_GRID: f64 = 0.288_675_134_594_812_87;
/// Values before the one that completes a fourth difference.
pub(crate) const VALUES: u8 = 4;
/// The gain at the beginning, and the least, with which it forgets what was a thousand samples ago.
const FIRST_GAIN: f64 = 0.25;
pub(crate) const LEAST_GAIN: f64 = 1.0 / 512.0;

/// Standard deviation σ of the fast noise of a signal at an even step, sample by sample.
///
/// The fourth difference takes away any movement that is a cubic over five samples; that of white noise of variance σ² has
/// variance 70σ². Its median size, which steps and outliers hardly move, is followed by going up or down by a share `g` of itself:
///
/// ```text
/// δ = |x − 4x₁ + 6x₂ − 4x₃ + x₄|           as differences of differences
/// q  = the least step other than 0 between two samples
/// m := the least of the first eight δ > 0, then
///      max(q, m + g·m) where δ > m, else max(q, m − g·m);     g := max(g − g²/2, 1/512), from 1/4
/// σ = max(m/(0.6745·√70), q/√12)
/// ```
///
/// So `g` falls like 2/n, and in the end the last thousand samples count. Of a quantised signal q is the step of its grid, of any
/// other it soon is next to nothing. A value that is repeated for the fifth time, and on, is held and left out.
///
/// Without parameters. Nothing is told before twenty differences. A bad value or a gap ([`Self::interrupt`]) begins the
/// differences anew and keeps what was learnt.
///
/// Known bias: an upper bound where the signal's own movement fills only a few samples; too low for noise that a filter has smoothed,
/// or that holds on from sample to sample.
///
/// ```
/// use glapp_core::{Noise, NoiseLevel, NoiseState};
/// let (noise, mut drawn, mut level) = (Noise::new(0.3)?, NoiseState::default(), NoiseLevel::default());
/// for k in 0..4000 {
///     level.update(noise.update(&mut drawn, 50.0 + 0.01 * f64::from(k)));
/// }
/// let sigma = level.sigma().unwrap(); // uniform noise of ± 0.3: 0.3/√3 = 0.173
/// assert!((sigma - 0.173).abs() < 0.02);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct NoiseLevel<R> {
    /// The last value, and the first three differences there.
    pub(crate) x: R,
    pub(crate) first: R,
    pub(crate) second: R,
    pub(crate) third: R,
    pub(crate) median: R,
    pub(crate) gain: R,
    pub(crate) grid: R,
    /// Values since the last break, as far as a fourth difference needs them.
    pub(crate) values: u8,
    pub(crate) repeats: u8,
    /// Fourth differences.
    pub(crate) count: u8,
}

impl<R: Real> NoiseLevel<R> {
    /// Takes one value `x`, a number.
    #[inline(always)]
    pub fn update(&mut self, x: R) {
        if self.values == 0 {
            (self.x, self.values, self.repeats) = (x, 1, 0);
            return;
        }
        let moved = (x - self.x).magnitude() > R::ZERO;
        self.repeats = if moved { 0 } else { self.repeats.saturating_add(1) };
        if self.repeats >= HELD {
            return;
        }
        // Differences after a break are to a value before it; they are not used before all are new.
        let size = self.differ(x);
        if self.values < VALUES {
            self.values += 1;
        } else if self.count < BEGINNING {
            self.begin(size);
        } else {
            self.weigh(size);
            self.gain = (self.gain - self.gain * self.gain / R::of(2.0)).greater(R::of(LEAST_GAIN));
            self.count = self.count.saturating_add(1);
        }
    }

    /// Takes the first differences: the smallest size so far is the median.
    #[cold]
    fn begin(&mut self, size: R) {
        if size > R::ZERO {
            self.median = if self.count == 0 { size } else { self.median.lesser(size) };
            self.gain = R::of(FIRST_GAIN);
            self.count += 1;
        }
    }

    /// Begins the differences anew after values that are missing.
    #[inline(always)]
    pub fn interrupt(&mut self) {
        self.values = 0;
    }

    /// σ [unit of the signal]; none before there are enough differences.
    pub fn sigma(&self) -> Option<R> {
        let of_median = self.median * R::of(OF_MEDIAN);
        (self.count >= ENOUGH).then(|| of_median.greater(self.grid * R::of(OF_GRID)))
    }
}

impl<N: Numbers> NoiseLevel<N> {
    /// Takes a value into the differences and the grid; gives the size of the fourth.
    #[inline(always)]
    pub(crate) fn differ(&mut self, x: N) -> N {
        let first = x - self.x;
        let (step, none) = (first.magnitude(), x.like(0.0));
        let least = N::either(none.below(self.grid), self.grid, step).lesser(step);
        self.grid = N::either(none.below(step), least, self.grid);
        let second = first - self.first;
        let third = second - self.second;
        let size = (third - self.third).magnitude();
        (self.x, self.first, self.second, self.third) = (x, first, second, third);
        size
    }

    /// m after a fourth difference of this size.
    #[inline(always)]
    pub(crate) fn weigh(&mut self, size: N) {
        let change = self.median * self.gain;
        let median = N::either(self.median.below(size), self.median + change, self.median - change);
        self.median = median.greater(self.grid);
    }
}
