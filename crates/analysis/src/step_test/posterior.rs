//! Regression of block means with noise and drift of unknown size.
//!
//! ```text
//! y = X β + w + v
//! ```
//!
//! w is a random walk within each stretch of the recording, v white with a variance inverse to the block's rows. Their
//! variances are σ² ρ and σ². Given the ratio ρ, β has Student's distribution about the generalised least squares, with
//! n − p degrees of freedom. ρ is integrated over a grid, flat in its logarithm, with the weight that the restricted likelihood
//! gives it,
//!
//! ```text
//! ln w(ρ) = −½ ln|V| − ½ ln|Xᵀ V⁻¹ X| − ½ (n − p) ln RSS,   V = I + ρ W.
//! ```
//!
//! In the axes of W both stay diagonal, whatever ρ is: one eigenvalue problem serves the whole grid.

use super::blocks::{Blocks, mean};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Least and greatest variance of the walk over one block, relative to that of a block's mean: from none that shows to one that
/// hides the noise.
const RATIO: (f64, f64) = (1e-4, 1e3);
/// Ratios between them: four a decade.
const RATIOS: usize = 29;
/// Steps of the search for a limit, each halving the rest of 200 standard deviations.
const HALVINGS: usize = 40;

/// Shares of the distribution that lie below median, lower and upper 95 % limit.
const SHARES: [f64; 3] = [0.5, 0.025, 0.975];

/// Blocks in the axes of their walk.
pub(super) struct Axes<'a> {
    blocks: &'a Blocks,
    /// Axes times the root of the blocks' rows.
    turn: DMatrix<f64>,
    /// Variance along each axis, for each ratio.
    variance: Vec<DVector<f64>>,
    /// Variance below which a PV is taken as without noise: rounding is as large.
    floor: f64,
}

impl<'a> Axes<'a> {
    /// None where times or values overflow: no eigenvalue would be found.
    pub(super) fn of(blocks: &'a Blocks) -> Option<Self> {
        let unit = mean(&blocks.rows.iter().map(|rows| 1.0 / rows).collect::<Vec<_>>()) / mean(&blocks.width);
        let largest = blocks.y.iter().fold(0.0f64, |largest, y| largest.max(y.abs()));
        let root = DVector::from_iterator(blocks.len(), blocks.rows.iter().map(|rows| rows.sqrt()));
        let mut walk = blocks.walk();
        walk.iter_mut().enumerate().for_each(|(at, w)| *w *= root[at % root.len()] * root[at / root.len()]);
        if !(walk.iter().all(|w| w.is_finite()) && largest.is_finite()) {
            return None;
        }
        let SymmetricEigen { eigenvectors, eigenvalues } = walk.symmetric_eigen();
        let mut turn = eigenvectors.transpose();
        for (mut column, root) in turn.column_iter_mut().zip(root.iter()) {
            column *= *root;
        }
        let (least, most) = (RATIO.0.log10(), RATIO.1.log10());
        let ratio = |k: usize| 10f64.powf(least + (most - least) * k as f64 / (RATIOS - 1) as f64);
        let variance = (0..RATIOS).map(|k| eigenvalues.map(|size| 1.0 + ratio(k) * unit * size.max(0.0)));
        Some(Self { blocks, turn, variance: variance.collect(), floor: (1e-9 * largest + 1e-100).powi(2) })
    }
}

/// Distribution of the coefficients.
pub(super) struct Posterior {
    /// n − p.
    pub(super) freedom: usize,
    /// Residual sum of squares for each ratio.
    pub(super) rss: Vec<f64>,
    /// The most likely ratio.
    pub(super) best: usize,
    beta: Vec<DVector<f64>>,
    covariance: Vec<DMatrix<f64>>,
    weight: Vec<f64>,
}

/// Median with its 95 % limits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub(super) median: f64,
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Limits {
    pub(super) fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self { median: f(self.median), low: f(self.low), high: f(self.high) }
    }
}

impl Posterior {
    /// Posterior of the coefficients of these columns. `extra` is a variance common to all blocks of one hold and known beforehand, such as
    /// that of a coarse PV; `widen` multiplies that of the noise. None where the columns do not tell them apart.
    pub(super) fn of(columns: &[Vec<f64>], axes: &Axes, extra: f64, widen: f64) -> Option<Self> {
        let (n, p) = (axes.blocks.len(), columns.len());
        let freedom = n - p;
        let x = &axes.turn * super::blocks::matrix(columns);
        let y = &axes.turn * DVector::from_column_slice(&axes.blocks.y);
        let shared = (extra > 0.0).then(|| &axes.turn * super::blocks::matrix(&axes.blocks.levels()));
        let mut found = Self {
            freedom,
            rss: Vec::with_capacity(RATIOS),
            best: 0,
            beta: Vec::with_capacity(RATIOS),
            covariance: Vec::with_capacity(RATIOS),
            weight: Vec::with_capacity(RATIOS),
        };
        let mut logs = Vec::with_capacity(RATIOS);
        for variance in &axes.variance {
            let scale = variance.map(|variance| 1.0 / variance.sqrt());
            let white = |of: &DMatrix<f64>| {
                let mut of = of.clone();
                of.column_iter_mut().for_each(|mut column| column.component_mul_assign(&scale));
                of
            };
            let (xw, yw) = (white(&x), y.component_mul(&scale));
            let gram = xw.tr_mul(&xw).cholesky()?;
            let log_det: f64 = 2.0 * gram.l_dirty().diagonal().iter().map(|l| l.ln()).sum::<f64>();
            let inverse = gram.inverse();
            let beta = &inverse * xw.tr_mul(&yw);
            let rss = (yw - &xw * &beta).norm_squared();
            let noise = (rss / freedom as f64).max(axes.floor) * widen;
            let mut covariance = &inverse * noise;
            if let Some(shared) = &shared {
                let gain = &inverse * xw.tr_mul(&white(shared));
                covariance += &gain * gain.transpose() * extra;
            }
            let likely = -0.5 * (log_det + variance.iter().map(|v| v.ln()).sum::<f64>());
            logs.push(likely - 0.5 * freedom as f64 * rss.max(axes.floor * freedom as f64).ln());
            found.beta.push(beta);
            found.covariance.push(covariance);
            found.rss.push(rss);
        }
        let (best, most) = logs
            .iter()
            .enumerate()
            .fold((0, f64::NEG_INFINITY), |at, (k, log)| if *log > at.1 { (k, *log) } else { at });
        let weight: Vec<f64> = logs.iter().map(|log| (log - most).exp()).collect();
        let sum: f64 = weight.iter().sum();
        found.best = best;
        found.weight = weight.iter().map(|weight| weight / sum).collect();
        Some(found)
    }

    /// Probability that `over`ᵀβ is below x.
    pub(super) fn below(&self, x: f64, over: &[f64]) -> f64 {
        self.share(&self.project(over, None), x)
    }

    /// Median and 95 % interval of `over`ᵀβ.
    pub(super) fn interval(&self, over: &[f64]) -> Limits {
        let (middle, deviation) = self.rough(over);
        self.limits(&self.project(over, None), middle, deviation)
    }

    /// The interval of `over`ᵀβ/`under`ᵀβ for `under`ᵀβ > 0, by Fieller: it is below x where `over`ᵀβ − x·`under`ᵀβ is below 0.
    pub(super) fn ratio(&self, over: &[f64], under: &[f64]) -> Limits {
        let ((middle, deviation), (divisor, of_it)) = (self.rough(over), self.rough(under));
        let deviation = deviation / divisor + (middle / divisor).abs() * of_it / (divisor * divisor);
        self.limits(&self.project(over, Some(under)), middle / divisor, deviation)
    }

    /// Probability that `over`ᵀβ/`under`ᵀβ is below x, for `under`ᵀβ > 0.
    pub(super) fn ratio_below(&self, x: f64, over: &[f64], under: &[f64]) -> f64 {
        self.share(&self.project(over, Some(under)), x)
    }

    /// The 95 % limits of the posterior.
    fn limits(&self, of: &[Projected], middle: f64, deviation: f64) -> Limits {
        let reach = 100.0 * deviation + 1e-12 * middle.abs();
        let at = |share: f64| {
            let (mut low, mut high) = (middle - reach, middle + reach);
            for _ in 0..HALVINGS {
                let half = f64::midpoint(low, high);
                *(if self.share(of, half) < share { &mut low } else { &mut high }) = half;
            }
            f64::midpoint(low, high)
        };
        let [median, low, high] = SHARES.map(at);
        Limits { median, low, high }
    }

    /// Posterior mean of the projection on `over`, and the mean of its standard deviation, weighted over all ratios.
    fn rough(&self, over: &[f64]) -> (f64, f64) {
        let of = self.project(over, None);
        let weighed =
            |value: fn(&Projected) -> f64| of.iter().zip(&self.weight).map(|(of, w)| w * value(of)).sum::<f64>();
        (weighed(|of| of.mean), weighed(|of| of.variance).sqrt())
    }

    /// Statistics that the limits need, for each ratio.
    fn project(&self, over: &[f64], under: Option<&[f64]>) -> Vec<Projected> {
        let over = DVector::from_column_slice(over);
        let under = under.map(DVector::from_column_slice);
        let of = |(beta, covariance): (&DVector<f64>, &DMatrix<f64>)| {
            let spread = covariance * &over;
            let (under_mean, both, under_variance) =
                under.as_ref().map_or((1.0, 0.0, 0.0), |u| (beta.dot(u), spread.dot(u), (covariance * u).dot(u)));
            Projected { mean: beta.dot(&over), variance: spread.dot(&over), under_mean, both, under_variance }
        };
        self.beta.iter().zip(&self.covariance).map(of).collect()
    }

    /// The probability below x.
    fn share(&self, of: &[Projected], x: f64) -> f64 {
        let below = |of: &Projected| {
            let variance = of.variance - 2.0 * x * of.both + x * x * of.under_variance;
            student((x * of.under_mean - of.mean) / variance.max(1e-300).sqrt(), self.freedom)
        };
        of.iter().zip(&self.weight).map(|(of, weight)| below(of) * weight).sum()
    }
}

/// Means and variances of `over`ᵀβ and `under`ᵀβ, the latter 1 where there is none.
struct Projected {
    mean: f64,
    variance: f64,
    under_mean: f64,
    both: f64,
    under_variance: f64,
}

/// Student's distribution by Wallace's normal approximation, good to 0.001 from 5 degrees of freedom.
fn student(t: f64, freedom: usize) -> f64 {
    let n = freedom as f64;
    let z = (8.0 * n + 1.0) / (8.0 * n + 3.0) * (n / 2.0 * (t * t / n).ln_1p()).sqrt();
    0.5 * libm::erfc(if t > 0.0 { -z } else { z })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    #[test]
    fn students_distribution_is_good_to_a_thousandth() {
        for (t, freedom, exact) in
            [(2.571, 5, 0.975), (-2.015, 5, 0.05), (2.228, 10, 0.975), (1.96, 10_000, 0.975), (0.0, 7, 0.5)]
        {
            assert!((student(t, freedom) - exact).abs() < 1e-3, "{t} of {freedom}: {}", student(t, freedom));
        }
    }

    /// Two holds of 16 blocks; the second `step` higher, with noise and a walk of these sizes.
    pub(in crate::step_test) fn two_holds(step: f64, noise: f64, walk: f64) -> Blocks {
        let mut state = 9u64;
        let mut random = || {
            let uniform = |state: &mut u64| {
                *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (*state >> 11) as f64 / (1u64 << 53) as f64
            };
            (0..12).map(|_| uniform(&mut state)).sum::<f64>() - 6.0
        };
        let mut level = 0.0;
        let y = (0..32).map(|i| {
            level += walk * 10f64.sqrt() * random();
            level + noise * random() + if i < 16 { 0.0 } else { step }
        });
        Blocks {
            y: y.collect(),
            rows: vec![1.0; 32],
            middle: (0..32).map(|i| 10.0 * f64::from(i)).collect(),
            width: vec![10.0; 32],
            hold: (0..32).map(|i| i / 16).collect(),
            stretch: vec![0; 32],
            lag: 0.0,
        }
    }

    #[test]
    fn without_drift_the_step_is_as_sure_as_the_mean_of_its_blocks() {
        let blocks = two_holds(3.0, 0.1, 0.0);
        let axes = Axes::of(&blocks).unwrap();
        let found = Posterior::of(&blocks.levels(), &axes, 0.0, 1.0).unwrap();
        let step = found.interval(&[-1.0, 1.0]);
        assert!(step.low < 3.0 && 3.0 < step.high, "{step:?}");
        // 2·2.04·0.1·√(2/16) with no drift at all; some is always allowed for.
        assert!((0.13..0.30).contains(&(step.high - step.low)), "{step:?}");
        assert!(found.below(0.0, &[-1.0, 1.0]) < 1e-12 && found.best < 8, "{}", found.best);
        let wide = Posterior::of(&blocks.levels(), &axes, 0.0, 4.0).unwrap().interval(&[-1.0, 1.0]);
        let wider = (wide.high - wide.low) / (step.high - step.low);
        assert!((1.7..2.05).contains(&wider), "{wider}");
        let coarse = Posterior::of(&blocks.levels(), &axes, 0.01, 1.0).unwrap().interval(&[-1.0, 1.0]);
        assert!(coarse.high - coarse.low > 0.5, "{coarse:?}");
    }

    #[test]
    fn a_load_that_walks_is_seen_to_and_widens_the_interval() {
        let blocks = two_holds(3.0, 0.01, 0.05);
        let found = Posterior::of(&blocks.levels(), &Axes::of(&blocks).unwrap(), 0.0, 1.0).unwrap();
        let step = found.interval(&[-1.0, 1.0]);
        assert!(found.best > 16, "{}", found.best);
        assert!(step.low < 3.0 && 3.0 < step.high && step.high - step.low > 0.3, "{step:?}");
    }

    #[test]
    fn the_ratios_of_walk_to_noise_decide_how_wide_an_interval_is() {
        // These numbers come from the code: with other ratios, or more of them, they differ in the third digit.
        for (walk, expected) in [(0.0, 0.206087020), (0.01, 0.283226343), (0.05, 0.839833920)] {
            let blocks = two_holds(3.0, 0.1, walk);
            let found = Posterior::of(&blocks.levels(), &Axes::of(&blocks).unwrap(), 0.0, 1.0).unwrap();
            let step = found.interval(&[-1.0, 1.0]);
            assert!((step.high - step.low - expected).abs() < 1e-7, "{} for {walk}", step.high - step.low);
        }
    }

    #[test]
    fn a_ratio_has_the_interval_of_fieller() {
        let blocks = two_holds(3.0, 0.1, 0.0);
        let mut columns = blocks.levels();
        columns[0] = vec![1.0; 32];
        let found = Posterior::of(&columns, &Axes::of(&blocks).unwrap(), 0.0, 1.0).unwrap();
        let (step, half) = (found.interval(&[0.0, 1.0]), found.ratio(&[0.0, 0.5], &[0.0, 1.0]));
        assert!((half.median - 0.5).abs() < 1e-9 && step.low > 2.0, "{half:?}");
        let doubled = found.ratio(&[1.0, 0.0], &[0.0, 1.0]).map(|x| 2.0 * x);
        let again = found.ratio(&[2.0, 0.0], &[0.0, 1.0]);
        assert!((doubled.low - again.low).abs() < 1e-9 && (doubled.high - again.high).abs() < 1e-9);
    }

    #[test]
    fn columns_that_are_the_same_tell_nothing() {
        let blocks = two_holds(3.0, 0.1, 0.0);
        let mut columns = blocks.levels();
        columns.push(vec![1.0; 32]);
        columns.push(vec![1.0; 32]);
        assert!(Posterior::of(&columns, &Axes::of(&blocks).unwrap(), 0.0, 1.0).is_none());
    }
}
