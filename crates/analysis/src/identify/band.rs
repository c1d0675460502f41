//! The regression at one length of the means.

use std::rc::Rc;

use nalgebra::DVector;

use super::MIN_STEPS;
use super::law::{Form, Law, PLAIN};
use super::linear::{condition, moments, without_first};
use super::parts::{Moves, SharedSignals, Stretches, Sums};
use crate::signals::median;

/// Fewest and most blocks of time whose residuals count as independent.
const BLOCKS: (usize, usize) = (8, 30);
/// Most moves by which a law is judged.
const EVERY: usize = 100_000;
/// Most moves in a regression; they overlap, and more add next to nothing.
const MOVES: usize = 2000;
/// 95 % efficient for Gaussian residuals.
pub(super) const TUKEY: f64 = 4.685;
const HUBER: f64 = 1.345;

/// Weight of a move as a function of its residual.
#[derive(Clone, Copy, Debug)]
pub(super) enum Shape {
    Huber,
    Tukey,
}

impl Shape {
    fn weight(self, u: f64) -> f64 {
        match self {
            Shape::Huber => (HUBER / u.abs().max(1e-300)).min(1.0),
            Shape::Tukey if u.abs() < TUKEY => {
                let rest = 1.0 - (u / TUKEY) * (u / TUKEY);
                rest * rest
            }
            Shape::Tukey => 0.0,
        }
    }
}

/// Residuals in units of their scale.
pub(super) fn standardised(residual: &[f64]) -> Vec<f64> {
    // A majority that fits exactly, as where OP rests on its own coarse steps, must not outvote the rows that move.
    let spread = (residual.iter().map(|r| r * r).sum::<f64>() / residual.len() as f64).sqrt();
    let mut sizes: Vec<f64> = residual.iter().map(|r| r.abs()).collect();
    let scale = (1.4826 * median(&mut sizes)).max(0.1 * spread).max(1e-9);
    residual.iter().map(|r| r / scale).collect()
}

/// A law to try, and the moves of its parts.
#[derive(Clone)]
pub(super) struct Candidate {
    pub form: Form,
    pub moves: Rc<Moves>,
    /// The filter's time was sought, not given.
    pub fitted: bool,
}

impl Candidate {
    /// A law whose filter is as it was given.
    pub fn given(form: Form, moves: Rc<Moves>) -> Self {
        Self { form, moves, fitted: false }
    }
}

/// The regression on moves between means of m rows, with a weight for every move.
pub(super) struct Band<'a> {
    pub signals: &'a SharedSignals<'a>,
    pub m: usize,
    pub stretches: Stretches,
    /// First index of each block of time.
    pub cut: Vec<usize>,
    pub weight: Vec<f64>,
    pub plain: Candidate,
    sp_moves: bool,
    /// Every usable stretch, by which a law is judged.
    whole: Stretches,
}

/// Means of 1, 2, 4 … samples, up to two Ti: beyond, the proportional part hardly shows in the moves any more.
pub(super) fn bands<'a>(signals: &'a SharedSignals<'a>) -> Vec<Band<'a>> {
    let plain = signals.parts(&PLAIN.filter);
    let mut bands = Vec::new();
    while let Some(mut band) = Band::new(signals, 1 << bands.len(), &plain) {
        let (m, plain) = (band.m, band.plain.clone());
        band.reweight(&plain, Shape::Huber, 8);
        let ti = band.law(&plain).map(|law| law.ti());
        bands.push(band);
        if m >= 4 && ti.is_some_and(|ti| ti > 0.0 && m as f64 * signals.h > 2.0 * ti) {
            break;
        }
    }
    bands
}

impl<'a> Band<'a> {
    /// The moves between means of m rows; none where there are too few usable stretches of 2m rows.
    fn new(signals: &'a SharedSignals<'a>, m: usize, plain: &Sums) -> Option<Self> {
        let good = &signals.good;
        let usable = |k: &usize| good[k + 2 * m - 1] - good[*k] == 2 * m - 1;
        let all: Vec<usize> = (0..(good.len() + 1).saturating_sub(2 * m)).filter(usable).collect();
        let thinned = |most: usize| -> Vec<usize> {
            let every = (m / 2).max(all.len().div_ceil(most)).max(1);
            all.iter().copied().step_by(every).collect()
        };
        let start = thinned(MOVES);
        let (first, length) = (*start.first()?, start.last()? - start.first()? + 1);
        if start.len() < MIN_STEPS / 2 || length <= 20 * m {
            return None;
        }
        let blocks = (length / (5 * m)).clamp(BLOCKS.0, BLOCKS.1);
        let block = |k: usize| (start[k] - first) * blocks / length;
        let cut = (0..start.len()).filter(|&k| k == 0 || block(k) != block(k - 1)).collect();
        let weight = vec![1.0; start.len()];
        let whole = Stretches::new(signals, thinned(EVERY), m);
        let stretches = Stretches::new(signals, start, m);
        let sp_moves = signals.sp_moves && stretches.setpoint.iter().any(|sp| *sp != 0.0);
        let plain = Candidate::given(PLAIN, Rc::new(stretches.moves(plain)));
        Some(Self { signals, m, stretches, cut, weight, plain, sp_moves, whole })
    }

    /// Columns of the regression: moves of P, of I, of D where there is a D part, and of SP where its weight is sought.
    pub fn columns<'b>(&'b self, derivative: bool, moves: &'b Moves) -> Vec<&'b [f64]> {
        let mut columns: Vec<&[f64]> = vec![&moves[0], &moves[1]];
        if derivative {
            columns.push(&moves[2]);
        }
        if self.sp_moves {
            columns.push(&self.stretches.setpoint);
        }
        columns
    }

    /// A law with the moves of its parts, whose filter's time was sought.
    pub fn fitted(&self, form: Form) -> Candidate {
        let moves = Rc::new(self.stretches.moves(&self.signals.parts(&form.filter)));
        Candidate { form, moves, fitted: true }
    }

    /// The law's values by weighted least squares; none where the moves do not determine them.
    pub fn law(&self, candidate: &Candidate) -> Option<Law> {
        let &Candidate { form, ref moves, fitted } = candidate;
        let x = self.columns(form.derivative, moves);
        let mut all = vec![self.stretches.op.as_slice()];
        all.extend(&x);
        let moments = moments(&self.weight, &all);
        let size = moments.diagonal().map(f64::sqrt);
        if !size.iter().all(|size| *size > 0.0 && *size < 1e150) {
            return None;
        }
        let scaled = moments.map_with_location(|i, j, moment| moment / size[i] / size[j]);
        let inner = without_first(&scaled);
        if condition(&inner) >= 1e10 {
            return None;
        }
        let known = DVector::from_fn(x.len(), |i, _| scaled[(i + 1, 0)]);
        let scaled = inner.lu().solve(&known)?;
        let beta = DVector::from_fn(x.len(), |i, _| scaled[i] * size[0] / size[i + 1]);
        let residual = residual(&self.stretches.op, &x, &beta);
        let loss = self.by_block(|k| self.weight[k] * residual[k] * residual[k]);
        let cost: f64 = loss.iter().sum();
        let shown = beta.iter().take(2).all(|beta| (1e-100..1e100).contains(&beta.abs()));
        (shown && loss.iter().all(|loss| loss.is_finite())).then(|| Law {
            form,
            beta,
            moves: moves.clone(),
            residual,
            loss,
            cost,
            moments,
            fitted,
        })
    }

    /// The sane laws among some, the best first.
    pub fn sane<'b>(&self, candidates: impl IntoIterator<Item = &'b Candidate>) -> Vec<Law> {
        let mut laws: Vec<Law> =
            candidates.into_iter().filter_map(|candidate| self.law(candidate)).filter(Law::sane).collect();
        laws.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        laws
    }

    /// Sums over every block of time.
    pub fn by_block(&self, of: impl Fn(usize) -> f64) -> Vec<f64> {
        let ends = self.cut.iter().skip(1).copied().chain([self.stretches.start.len()]);
        self.cut.iter().zip(ends).map(|(begin, end)| (*begin..end).map(&of).sum()).collect()
    }

    /// Weights by which no few moves rule the fit of one law.
    pub fn reweight(&mut self, candidate: &Candidate, shape: Shape, rounds: usize) {
        self.weight.fill(1.0);
        let mut before = f64::INFINITY;
        for _ in 0..rounds {
            let Some(law) = self.law(candidate) else { return };
            self.weight = standardised(&law.residual).into_iter().map(|u| shape.weight(u)).collect();
            if (law.k() - before).abs() <= 1e-7 * law.k().abs() {
                return;
            }
            before = law.k();
        }
    }

    /// Share of the moves that the law explains, of every usable stretch; what OP's rounding, of variance `op_noise`, does is
    /// no failure.
    pub fn r2(&self, law: &Law, op_noise: f64) -> f64 {
        let moves = self.whole.moves(&self.signals.parts(&law.form.filter));
        let mut x: Vec<&[f64]> =
            moves.iter().take(if law.form.derivative { 3 } else { 2 }).map(Vec::as_slice).collect();
        if law.beta.len() > x.len() {
            x.push(&self.whole.setpoint);
        }
        let op = &self.whole.op;
        let squares = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
        let n = op.len() as f64;
        let mean = op.iter().sum::<f64>() / n;
        let total: f64 = op.iter().map(|op| (op - mean) * (op - mean)).sum();
        let rest = (squares(&residual(op, &x, &law.beta)) - 2.0 / self.m as f64 * op_noise * n).max(0.0);
        let left = rest / total;
        if total > 0.0 && !left.is_nan() { 1.0 - left } else { 0.0 }
    }
}

/// Residual of OP's moves under a law.
fn residual(op: &[f64], x: &[&[f64]], beta: &DVector<f64>) -> Vec<f64> {
    let explained = |k: usize| x.iter().zip(beta.iter()).map(|(x, beta)| x[k] * beta).sum::<f64>();
    op.iter().enumerate().map(|(k, op)| op - explained(k)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_fall_with_the_residual() {
        assert_eq!(Shape::Huber.weight(0.0), 1.0);
        assert_eq!(Shape::Huber.weight(-1.3), 1.0);
        assert_eq!(Shape::Huber.weight(2.69), 0.5);
        assert_eq!(Shape::Tukey.weight(0.0), 1.0);
        assert_eq!(Shape::Tukey.weight(-5.0), 0.0);
        assert!((Shape::Tukey.weight(TUKEY / 2.0) - 0.5625).abs() < 1e-12);
    }

    #[test]
    fn the_scale_is_the_middle_residual_but_at_least_a_tenth_of_the_rms() {
        let mut residual = [1.0, -1.0, 1.0, -1.0, 1.0];
        assert!((standardised(&residual)[0] - 1.0 / 1.4826).abs() < 1e-12);
        residual = [0.0, 0.0, 0.0, 0.0, 10.0];
        assert!((standardised(&residual)[4] - 10.0 * f64::sqrt(5.0)).abs() < 1e-9);
        assert_eq!(standardised(&[0.0; 4]), [0.0; 4]);
    }
}
