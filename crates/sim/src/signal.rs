//! What acts on a loop from outside: setpoint and load.

use crate::SimError;
use crate::error::require;
use glapp_core::{Noise, NoiseState};

/// A setpoint or load over time.
#[derive(Clone, Debug, PartialEq)]
pub enum Signal {
    /// (time [s], value from then on), times ascending; 0 before the first. A step takes effect at the first sample not
    /// before its time.
    Steps(Vec<(f64, f64)>),
    /// One value a sample.
    Samples(Vec<f64>),
}

impl Signal {
    /// The signal at `n` samples `h` seconds apart.
    pub(crate) fn column(&self, name: &'static str, h: f64, n: usize) -> Result<Vec<f64>, SimError> {
        let wrong = |what| Err(SimError::Signal { name, what });
        match self {
            Self::Samples(column) if column.len() != n => {
                wrong(format!("{} values for {n} samples; write one value a sample", column.len()))
            }
            Self::Samples(column) => match column.iter().position(|x| !x.is_finite()) {
                Some(k) => wrong(format!("value {} at sample {k} is not a number", column[k])),
                None => Ok(column.clone()),
            },
            Self::Steps(steps) => {
                let mut column = vec![0.0; n];
                let mut last = f64::NEG_INFINITY;
                for &(t, value) in steps {
                    if !t.is_finite() || !value.is_finite() {
                        return wrong(format!("step ({t}, {value}) is not a pair of numbers"));
                    }
                    if t <= last {
                        return wrong(format!("step at {t} s after one at {last} s; write times in ascending order"));
                    }
                    last = t;
                    column[sample_at(t, h, n)..].fill(value);
                }
                Ok(column)
            }
        }
    }
}

/// The first of `n` samples not before time `t`; `n` where there is none.
pub(crate) fn sample_at(t: f64, h: f64, n: usize) -> usize {
    // A time meant as a multiple of h must not miss its sample by a rounding; the cast saturates.
    ((t / h - 1e-9).ceil().max(0.0) as usize).min(n)
}

/// Random walk of `n` samples from 0, with standard deviation `rate`·√t after t seconds [unit per √s].
///
/// Uniform increments of ± rate·√(3h), which have the variance rate²·h.
pub fn random_walk(n: usize, h: f64, rate: f64, seed: u64) -> Result<Vec<f64>, SimError> {
    require("h", h, h > 0.0, "greater than 0 s")?;
    require("rate", rate, rate >= 0.0, "0 or greater")?;
    let increment = Noise::new(rate * (3.0 * h).sqrt())?;
    let mut state = NoiseState::seeded(seed);
    let mut x = 0.0;
    let mut walk = Vec::with_capacity(n);
    for _ in 0..n {
        walk.push(x);
        x = increment.update(&mut state, x);
    }
    Ok(walk)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_take_effect_at_their_sample() {
        let steps = Signal::Steps(vec![(-1.0, 5.0), (0.3, 1.0), (0.35, 2.0), (9.0, 7.0)]);
        assert_eq!(steps.column("load", 0.1, 6).unwrap(), [5.0, 5.0, 5.0, 1.0, 2.0, 2.0]);
    }

    #[test]
    fn wrong_signals_are_named() {
        for (signal, part) in [
            (Signal::Steps(vec![(1.0, 0.0), (1.0, 2.0)]), "ascending"),
            (Signal::Steps(vec![(f64::NAN, 0.0)]), "pair of numbers"),
            (Signal::Samples(vec![0.0; 5]), "5 values for 6 samples"),
            (Signal::Samples(vec![f64::NAN; 6]), "sample 0"),
        ] {
            let text = signal.column("load", 0.1, 6).unwrap_err().to_string();
            assert!(text.starts_with("load: ") && text.contains(part), "{text}");
        }
    }

    #[test]
    fn random_walk_spreads_with_the_root_of_time() {
        let (runs, n, h, rate) = (2000, 500, 0.2, 0.3);
        let ends: Vec<f64> = (0..runs).map(|seed| random_walk(n + 1, h, rate, seed).unwrap()[n]).collect();
        let variance = ends.iter().map(|x| x * x).sum::<f64>() / runs as f64;
        let expected = rate * rate * h * n as f64;
        assert!((variance / expected - 1.0).abs() < 0.13, "{variance} for {expected}");
    }
}
