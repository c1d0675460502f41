//! Law that one length of the means gives, and the range of all laws that fit as well.

use super::Interval;
use super::band::{Band, TUKEY, standardised};
use super::filter::Filter;
use super::law::{Form, Law};
use super::linear::{Matrix, inverse, moments, weighted, without_first};
use super::search::WORST;
use nalgebra::DVector;

/// Standard errors by which a law must predict worse than the best before it is dropped.
const WORSE: f64 = 2.5;
/// Relative; the next law tried is as far away.
const HALF_OCTAVE: f64 = 0.41;
/// Relative; nobody needs settings more exactly, and the first samples of a filter are not known.
const SURE: f64 = 1e-3;
/// Worst condition with which something is left unexplained.
const SINGULAR: f64 = 1e14;

/// Ends of K (without its sign) [OP unit/PV unit], Ti [s], Td [s] and b.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Span {
    pub k: Interval,
    pub ti: Interval,
    pub td: Interval,
    pub b: Interval,
}

const ANY: Interval = Interval { low: f64::NEG_INFINITY, high: f64::INFINITY };
const ANYTHING: Span = Span { k: ANY, ti: ANY, td: ANY, b: ANY };

impl Span {
    /// All that either holds.
    pub fn hull(self, other: Self) -> Self {
        let hull = |a: Interval, b: Interval| Interval { low: a.low.min(b.low), high: a.high.max(b.high) };
        Self {
            k: hull(self.k, other.k),
            ti: hull(self.ti, other.ti),
            td: hull(self.td, other.td),
            b: hull(self.b, other.b),
        }
    }

    /// Whether K or Ti of two contradict each other.
    pub fn contradicts(&self, other: &Self) -> bool {
        let apart = |a: Interval, b: Interval| a.high < b.low || a.low > b.high;
        apart(self.k, other.k) || apart(self.ti, other.ti)
    }
}

/// Result of one length of the means: its best law, and the range of all that fit as well.
pub(super) struct Found {
    pub m: usize,
    pub law: Law,
    pub span: Span,
    /// Distance of K or Ti, in logarithms.
    pub width: f64,
    pub r2: f64,
}

impl Found {
    /// Result of a band from its plausible laws, the best first; none where there is no law.
    pub fn new(band: &Band<'_>, mut laws: Vec<Law>, op_noise: f64) -> Option<Self> {
        let best = laws.first()?;
        let good: Vec<bool> = laws.iter().enumerate().map(|(k, law)| k == 0 || as_good(law, best)).collect();
        let mut good = good.into_iter();
        laws.retain(|_| good.next() == Some(true));
        let span = laws.iter().map(|law| band.span(law, op_noise)).reduce(Span::hull)?;
        let mut shown = laws.iter().position(|law| !law.form.derivative).unwrap_or(0);
        let Law { form, cost, .. } = laws[shown];
        if !form.filter.lags() {
            // Without a filter the two clocks give the same fit; that every sample was a scan shows in the residual.
            let op = &band.stretches.op;
            let square = op.iter().map(|op| op * op).sum::<f64>() / op.len() as f64;
            let rounding = 2.0 * op_noise / band.m as f64 + 1e-12 * square;
            let scans = cost <= 1.5 * rounding * band.weight.iter().sum::<f64>();
            let same = Form { filter: Filter::none(scans), ..form };
            shown = laws.iter().position(|law| law.form == same).unwrap_or(shown);
        }
        let Span { k, ti, .. } = span;
        let known = k.low > 0.0 && ti.low > 0.0;
        let width = if known { (k.high / k.low).max(ti.high / ti.low).ln() } else { f64::INFINITY };
        let law = laws.swap_remove(shown);
        Some(Self { m: band.m, r2: band.r2(&law, op_noise), law, span, width })
    }
}

/// Whether a law predicts no worse than the best, by the logarithms of their squares in every block.
fn as_good(law: &Law, best: &Law) -> bool {
    let tiny = 1e-20 * best.moments[(0, 0)] / best.loss.len() as f64;
    let ratio: Vec<f64> =
        law.loss.iter().zip(&best.loss).map(|(law, best)| ((law + tiny) / (best + tiny)).ln()).collect();
    no_larger_than_0(&ratio)
}

/// Whether the mean is not above 0 by more than [`WORSE`] of its standard errors.
fn no_larger_than_0(x: &[f64]) -> bool {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let variance = x.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (n - 1.0);
    mean <= WORSE * (variance / n).sqrt() + 1e-9
}

impl Band<'_> {
    /// Range of a law: as fitted, and as if the controller had never seen the noise of PV.
    fn span(&self, law: &Law, op_noise: f64) -> Span {
        let Some(scatter) = self.scatter(law) else { return ANYTHING };
        let h = self.signals.h;
        ends(law, &law.beta, &scatter, h).hull(ends(law, &self.corrected(law, op_noise), &scatter, h))
    }

    /// Covariance of the values, by block sums of the scores, times the square of Student's t.
    ///
    /// Where the filter's time was fitted its error is added, up to the half octave to the next law that is tried.
    pub(super) fn scatter(&self, law: &Law) -> Option<Matrix> {
        let mut x = self.columns(law.form.derivative, &law.moves);
        let spread = self.spread(law, &x)?;
        if !law.fitted {
            return Some(spread);
        }
        let slope = self.slope(law);
        let moved = DVector::from_fn(x.len(), |j, _| weighted(&self.weight, x[j], &slope));
        x.push(&slope);
        let last = x.len() - 1;
        let error = self.spread(law, &x).map_or(HALF_OCTAVE, |free| free[(last, last)].sqrt().min(HALF_OCTAVE));
        let change = without_first(&law.moments).lu().solve(&moved)? * error;
        Some(spread + &change * change.transpose())
    }

    /// Covariance of a law's parameters by the scatter of OP's moves.
    fn spread(&self, law: &Law, x: &[&[f64]]) -> Option<Matrix> {
        let (x, size) = self.scaled(x)?;
        let slope: Vec<f64> = standardised(&law.residual).into_iter().map(score_slope).collect();
        let inverse = inverse(&moments(&slope, &x), WORST)?;
        let scores: Vec<Vec<f64>> =
            x.iter().map(|x| self.by_block(|k| x[k] * (self.weight[k] * law.residual[k]))).collect();
        let blocks = self.cut.len();
        let scores = Matrix::from_fn(x.len(), blocks, |j, block| scores[j][block]);
        let blocks = blocks as f64;
        let spread = inverse * scores * (student(blocks - 1.0) * (blocks / (blocks - 1.0)).sqrt());
        let spread = spread.map_with_location(|i, _, spread| spread / size[i]);
        Some(&spread * spread.transpose())
    }

    /// The values if the noise of PV that its second differences allow was never seen by the controller.
    ///
    /// Noise in the move of the P part weakens K. It cannot be more than what leaves nothing unexplained, but for what OP's
    /// rounding does.
    fn corrected(&self, law: &Law, op_noise: f64) -> DVector<f64> {
        self.without_noise(law, op_noise).unwrap_or_else(|| law.beta.clone())
    }

    /// Solves the law with the noise of PV and of OP subtracted from the moments; None where the equations become singular.
    fn without_noise(&self, law: &Law, op_noise: f64) -> Option<DVector<f64>> {
        let weight = 2.0 / self.m as f64 * self.weight.iter().sum::<f64>();
        let mut moments = law.moments.clone();
        moments[(0, 0)] -= (op_noise * weight).min(0.95 * law.cost);
        let size = moments.diagonal().map(f64::sqrt);
        let scaled = |moments: &Matrix| moments.map_with_location(|i, j, moment| moment / (size[i] * size[j]));
        let most = size[1] * size[1] / inverse(&scaled(&moments), SINGULAR)?[(1, 1)];
        moments[(1, 1)] -= (self.signals.noise(&law.form.filter) * weight).min(most);
        let scaled = scaled(&moments);
        let inverse = inverse(&without_first(&scaled), SINGULAR)?;
        let beta = inverse * scaled.view((1, 0), (law.beta.len(), 1));
        Some(DVector::from_fn(law.beta.len(), |i, _| beta[i] * size[0] / size[i + 1]))
    }
}

/// Derivative of the biweight's score.
fn score_slope(u: f64) -> f64 {
    let v = (u / TUKEY) * (u / TUKEY);
    if v < 1.0 { (1.0 - v) * (1.0 - 5.0 * v) } else { 0.0 }
}

/// Ends about some values.
fn ends(law: &Law, beta: &DVector<f64>, scatter: &Matrix, h: f64) -> Span {
    let (k, ki) = (beta[0], beta[1]);
    let ti = k / ki;
    let error: Vec<f64> = scatter.diagonal().iter().map(|variance| variance.sqrt() / k.abs()).collect();
    let known = beta.iter().chain(&error).all(|x| x.is_finite());
    if !(known && ti > 0.0 && ti.is_finite() && k * law.k() > 0.0) {
        return ANYTHING;
    }
    let relative = |i: usize, j: usize| scatter[(i, j)] / (beta[i] * beta[j]);
    let k_error = error[0] + SURE;
    let ti_error = (relative(0, 0) + relative(1, 1) - 2.0 * relative(0, 1)).max(0.0).sqrt() + SURE;
    // Current, mean or previous error within a step: the same fit with Ti, Ti + h/2 or Ti + h, and K in proportion.
    let (early, late) = if law.form.filter.scans { (0.0, h) } else { (-h / 2.0, h / 2.0) };
    let mut span = Span {
        k: Interval {
            low: k.abs() * (1.0 - k_error) + ki.abs() * early,
            high: k.abs() * (1.0 + k_error) + ki.abs() * late,
        },
        ti: Interval {
            low: ti / (1.0 + ti_error) + early,
            high: if ti_error < 1.0 { ti / (1.0 - ti_error) + late } else { f64::INFINITY },
        },
        td: Interval { low: 0.0, high: 0.0 },
        b: ANY,
    };
    let mut rest = beta.iter().zip(&error).skip(2).map(|(beta, error)| (beta / k, *error));
    if law.form.derivative
        && let Some((td, error)) = rest.next()
    {
        let low = (td * (1.0 - SURE) - error + early).max(0.0);
        span.td = Interval { low, high: td * (1.0 + SURE) + error + late };
    }
    if let Some((b, error)) = rest.next() {
        span.b = Interval { low: b - error, high: b + error };
    }
    span
}

/// 97.5 % point of Student's t, by its expansion about the normal's (error below 0.01 from 7 degrees of freedom).
fn student(df: f64) -> f64 {
    let z = 1.959964_f64;
    z + (z.powi(3) + z) / (4.0 * df) + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * df * df)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn students_t() {
        for (df, exact) in [(7.0, 2.3646), (10.0, 2.2281), (29.0, 2.0452), (1e9, 1.96)] {
            assert!((student(df) - exact).abs() < 0.01, "{df}");
        }
    }

    #[test]
    fn two_and_a_half_standard_errors_above_0_are_worse() {
        // Standard error 1: nine numbers of standard deviation 3.
        let about = |mean: f64| {
            let spread = 3.0 * (8.0f64 / 6.0).sqrt();
            [-1.0, -1.0, -1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0].map(|x| mean + spread * x)
        };
        assert!(no_larger_than_0(&about(2.45)) && !no_larger_than_0(&about(2.55)));
    }

    #[test]
    fn the_slope_of_the_score_is_its_derivative() {
        let score = |u: f64| u * (1.0 - (u / TUKEY).powi(2)).powi(2);
        for u in [0.0, 1.0, -2.5, 4.6] {
            let slope = (score(u + 1e-6) - score(u - 1e-6)) / 2e-6;
            assert!((slope - score_slope(u)).abs() < 1e-6);
        }
        assert_eq!(score_slope(5.0), 0.0);
    }

    #[test]
    fn spans_that_contradict() {
        let span = |k: (f64, f64), ti: (f64, f64)| Span {
            k: Interval { low: k.0, high: k.1 },
            ti: Interval { low: ti.0, high: ti.1 },
            ..ANYTHING
        };
        let one = span((1.0, 2.0), (5.0, 9.0));
        assert!(!one.contradicts(&span((2.0, 3.0), (1.0, 5.0))));
        assert!(one.contradicts(&span((2.1, 3.0), (1.0, 5.0))));
        assert!(one.contradicts(&span((1.0, 3.0), (10.0, 11.0))));
        assert_eq!(one.hull(span((0.5, 1.5), (6.0, 10.0))), span((0.5, 2.0), (5.0, 10.0)));
    }
}
