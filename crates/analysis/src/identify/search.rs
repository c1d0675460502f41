//! The laws of one length of the means, and better times of their filters.

use super::band::{Band, Candidate, Shape};
use super::law::{Form, Law};
use super::linear::{inverse, moments, weighted};

/// A law this many times worse than the best gets no better by another time constant.
const PROMISING: f64 = 300.0;
/// Relative step of a filter's time by which slopes are taken.
const SMALL: f64 = 1e-3;
/// Worst condition of a regression that is believed.
pub(super) const WORST: f64 = 1e10;

impl Band<'_> {
    /// The sane laws of these forms and of those with better times, the best first.
    pub(super) fn searched(&mut self, candidates: &[Candidate]) -> Vec<Law> {
        let plain = self.plain.clone();
        self.reweight(&plain, Shape::Huber, 8);
        let Some(best) = self.sane(candidates).into_iter().next() else { return Vec::new() };
        self.reweight(&candidate(&best), Shape::Tukey, 15);
        let laws = self.sane(candidates);
        let Some(least) = laws.first().map(|law| law.cost) else { return Vec::new() };
        let mut kinds: Vec<Form> = Vec::new();
        let mut refined: Vec<Law> = Vec::new();
        for law in laws.iter().filter(|law| law.form.filter.lags() && law.cost <= PROMISING * least) {
            if !kinds.iter().any(|kind| kind.is_like(&law.form)) {
                kinds.push(law.form);
                refined.extend(self.refined(law));
            }
        }
        let best = laws.iter().take(1).chain(&refined).min_by(|a, b| a.cost.total_cmp(&b.cost)).map(candidate);
        if let Some(best) = best {
            self.reweight(&best, Shape::Tukey, 15);
        }
        let given = laws.iter().filter(|law| refined.iter().all(|better| better.form != law.form));
        self.sane(&given.chain(&refined).map(candidate).collect::<Vec<_>>())
    }

    /// Gauss and Newton in the filter's time; none where no other is better.
    fn refined(&self, law: &Law) -> Option<Law> {
        let mut best = self.better(law)?;
        let mut before = law.cost;
        for _ in 1..10 {
            if best.cost >= 0.99 * before {
                break;
            }
            before = best.cost;
            let Some(better) = self.better(&best) else { break };
            best = better;
        }
        Some(best)
    }

    /// The law a step on, or a part of that step.
    fn better(&self, law: &Law) -> Option<Law> {
        let step = self.step(law, &self.slope(law));
        let slower = |factor: f64| self.law(&self.fitted(law.form.slower(1.0 + factor * step)));
        let better = |other: &Law| other.sane() && other.cost < law.cost;
        if step.abs() > 1e-9 { [1.0, 0.25, 0.0625].into_iter().filter_map(slower).find(better) } else { None }
    }

    /// Change of OP's moves by a relative change of the filter's time.
    pub(super) fn slope(&self, law: &Law) -> Vec<f64> {
        let other = self.fitted(law.form.slower(1.0 + SMALL));
        let changes = other.moves.iter().zip(law.moves.iter()).take(if law.form.derivative { 3 } else { 2 });
        let mut slope = vec![0.0; law.residual.len()];
        for ((new, old), beta) in changes.zip(law.beta.iter()) {
            for (slope, (new, old)) in slope.iter_mut().zip(new.iter().zip(old)) {
                *slope += (new - old) * beta / SMALL;
            }
        }
        slope
    }

    /// Relative change of the filter's time that would make the residual smallest.
    fn step(&self, law: &Law, slope: &[f64]) -> f64 {
        let mut x = self.columns(law.form.derivative, &law.moves);
        x.push(slope);
        let Some((x, size)) = self.scaled(&x) else { return 0.0 };
        let Some(inverse) = inverse(&moments(&self.weight, &x), WORST) else { return 0.0 };
        let last = x.len() - 1;
        let change: f64 =
            x.iter().enumerate().map(|(j, x)| inverse[(last, j)] * weighted(&self.weight, x, &law.residual)).sum();
        (change / size[last]).clamp(-0.5, 1.0)
    }

    /// Columns of weighted length 1, and their length before.
    pub(super) fn scaled(&self, x: &[&[f64]]) -> Option<(Vec<Vec<f64>>, Vec<f64>)> {
        let size: Vec<f64> = x.iter().map(|x| weighted(&self.weight, x, x).sqrt()).collect();
        if !size.iter().all(|size| *size > 0.0 && size.is_finite()) {
            return None;
        }
        Some((x.iter().zip(&size).map(|(x, size)| x.iter().map(|x| x / size).collect()).collect(), size))
    }
}

fn candidate(law: &Law) -> Candidate {
    Candidate { form: law.form, moves: law.moves.clone(), fitted: law.fitted }
}
