//! Signals from outside a loop: setpoint, load and measurement noise.

use crate::SimError;
use crate::error::require;
use crate::random::Integers;
use glapp_core::{Noise, NoiseState};
use std::sync::Arc;

/// A setpoint, a load or a noise over time: the sum of its pieces, 0 where there is none.
pub type Signal = Vec<Piece>;

/// A part of a [`Signal`]. Times in s; every random piece draws from a stream of its own.
#[derive(Clone, Debug, PartialEq)]
pub enum Piece {
    /// (time, value from then on), times ascending; 0 before the first. A step takes effect at the first sample not
    /// before its time.
    Steps(Vec<(f64, f64)>),
    /// Ramp from 0 at `t` to `by` at `t` + `over`, constant after it.
    Ramp {
        /// Begin \[s\].
        t: f64,
        /// Height.
        by: f64,
        /// Duration > 0 \[s\].
        over: f64,
    },
    /// amplitude·sin(2π·(time − t)/period) from `t` on.
    Sine {
        /// Amplitude.
        amplitude: f64,
        /// Period > 0 \[s\].
        period: f64,
        /// Begin \[s\].
        t: f64,
    },
    /// Random walk from 0, with standard deviation `rate`·√t after t seconds \[unit per √s\].
    Walk {
        /// ≥ 0.
        rate: f64,
    },
    /// White, uniform between ± `amplitude` (thesis 6.2): the block [`Noise`].
    Uniform {
        /// ≥ 0.
        amplitude: f64,
    },
    /// White, nearly normal: the sum of twelve uniform numbers, less their mean.
    Gaussian {
        /// Standard deviation ≥ 0.
        sigma: f64,
    },
    /// Nearly normal, with the autocorrelation (τ/(τ + h))^|k| over k samples.
    Coloured {
        /// Standard deviation ≥ 0.
        sigma: f64,
        /// Correlation time τ ≥ 0 \[s\].
        tau: f64,
    },
    /// One value a sample.
    Samples(Arc<[f64]>),
}

/// A [`Signal`] under way: gives its values from the first sample on, some at a time.
#[derive(Clone, Debug)]
pub(crate) struct Source {
    pieces: Vec<Running>,
    h: f64,
}

#[derive(Clone, Debug)]
enum Running {
    /// (first sample, value), the last of those that have begun at `now`.
    Steps {
        steps: Vec<(usize, f64)>,
    },
    Ramp {
        t: f64,
        by: f64,
        over: f64,
    },
    Sine {
        amplitude: f64,
        period: f64,
        t: f64,
    },
    Walk {
        increment: f64,
        x: f64,
        integers: Integers,
    },
    Uniform {
        amplitude: f64,
        integers: Integers,
    },
    /// x := x + (gain·g − x)·share
    Coloured {
        gain: f64,
        share: f64,
        x: f64,
        integers: Integers,
    },
    Samples(Arc<[f64]>),
}

impl Source {
    /// The signal at `n` samples `h` seconds apart. `stream` numbers the signals of one scenario: each has its own
    /// random numbers.
    pub(crate) fn new(
        name: &'static str,
        signal: &[Piece],
        h: f64,
        n: usize,
        seed: u64,
        stream: u64,
    ) -> Result<Self, SimError> {
        let running = |(i, piece): (usize, &Piece)| {
            // Stream 0, piece 0 keeps the seed itself.
            let integers = Integers::seeded(seed.wrapping_add((stream * 1000 + i as u64).wrapping_mul(ODD)));
            piece.start(name, h, n, integers)
        };
        Ok(Self { pieces: signal.iter().enumerate().map(running).collect::<Result<_, _>>()?, h })
    }

    /// Writes the next values of the signal, of the samples from `first` on.
    pub(crate) fn fill(&mut self, first: usize, out: &mut [f64]) {
        out.fill(0.0);
        for piece in &mut self.pieces {
            piece.add(first, self.h, out);
        }
    }

    /// The value that all samples from `first` up to `end` have, where no piece moves.
    pub(crate) fn constant(&self, first: usize, end: usize) -> Option<f64> {
        self.pieces.iter().try_fold(0.0, |sum, piece| match piece {
            Running::Steps { steps } if !steps.iter().any(|(k, _)| (first + 1..end).contains(k)) => {
                Some(steps.iter().rev().find(|(k, _)| *k <= first).map_or(sum, |(_, value)| sum + value))
            }
            _ => None,
        })
    }
}

/// Sets the seeds of streams far apart; odd, so that no two streams of a seed meet.
const ODD: u64 = 0xD1B5_4A32_D192_ED03;

impl Piece {
    /// The piece at its first sample, with checked numbers; `integers`: its random stream.
    fn start(&self, name: &'static str, h: f64, n: usize, mut integers: Integers) -> Result<Running, SimError> {
        let wrong = |what| Err(SimError::Signal { name, what });
        let number = |key, x: f64, holds, bound: &str| match holds && x.is_finite() {
            true => Ok(x),
            false => Err(SimError::Signal { name, what: format!("{key} = {x}: must be {bound}") }),
        };
        match *self {
            Self::Samples(ref column) if column.len() != n => {
                wrong(format!("{} values for {n} samples; write one value a sample", column.len()))
            }
            Self::Samples(ref column) => match column.iter().position(|x| !x.is_finite()) {
                Some(k) => wrong(format!("value {} at sample {k} is not a number", column[k])),
                None => Ok(Running::Samples(column.clone())),
            },
            Self::Steps(ref steps) => {
                let mut last = f64::NEG_INFINITY;
                for &(t, value) in steps {
                    if !t.is_finite() || !value.is_finite() {
                        return wrong(format!("step ({t}, {value}) is not a pair of numbers"));
                    }
                    if t <= last {
                        return wrong(format!("step at {t} s after one at {last} s; write times in ascending order"));
                    }
                    last = t;
                }
                Ok(Running::Steps { steps: steps.iter().map(|&(t, value)| (sample_at(t, h, n), value)).collect() })
            }
            Self::Ramp { t, by, over } => Ok(Running::Ramp {
                t: number("t", t, true, "a number")?,
                by: number("by", by, true, "a number")?,
                over: number("over", over, over > 0.0, "greater than 0 s")?,
            }),
            Self::Sine { amplitude, period, t } => Ok(Running::Sine {
                amplitude: number("amplitude", amplitude, true, "a number")?,
                period: number("period", period, period > 0.0, "greater than 0 s")?,
                t: number("t", t, true, "a number")?,
            }),
            Self::Walk { rate } => {
                let rate = number("rate", rate, rate >= 0.0, "0 or greater")?;
                Ok(Running::Walk { increment: rate * (3.0 * h).sqrt(), x: 0.0, integers })
            }
            Self::Uniform { amplitude } => Ok(Running::Uniform {
                amplitude: number("amplitude", amplitude, amplitude >= 0.0, "0 or greater")?,
                integers,
            }),
            Self::Gaussian { sigma } => {
                let gain = number("sigma", sigma, sigma >= 0.0, "0 or greater")?;
                Ok(Running::Coloured { gain, share: 1.0, x: 0.0, integers })
            }
            Self::Coloured { sigma, tau } => {
                let sigma = number("sigma", sigma, sigma >= 0.0, "0 or greater")?;
                let tau = number("tau", tau, tau >= 0.0, "0 s or greater")?;
                // The filter with a = τ/(τ + h) leaves the variance (1 − a)/(1 + a) of white noise.
                let gain = sigma * ((2.0 * tau + h) / h).sqrt();
                let x = sigma * integers.gaussian();
                Ok(Running::Coloured { gain, share: h / (tau + h), x, integers })
            }
        }
    }
}

impl Running {
    fn add(&mut self, first: usize, h: f64, out: &mut [f64]) {
        let n = out.len();
        match self {
            Self::Samples(column) => out.iter_mut().zip(&column[first..]).for_each(|(out, x)| *out += x),
            Self::Steps { steps } => {
                for (i, &(from, value)) in steps.iter().enumerate() {
                    let until = steps.get(i + 1).map_or(usize::MAX, |next| next.0);
                    let within = |k: usize| k.clamp(first, first + n) - first;
                    out[within(from)..within(until)].iter_mut().for_each(|out| *out += value);
                }
            }
            Self::Ramp { t, by, over } => {
                for (k, out) in out.iter_mut().enumerate() {
                    *out += *by * (((first + k) as f64 * h - *t) / *over).clamp(0.0, 1.0);
                }
            }
            Self::Sine { amplitude, period, t } => {
                for (k, out) in out.iter_mut().enumerate() {
                    let since = (first + k) as f64 * h - *t;
                    *out += if since >= 0.0 { *amplitude * sine_of_turns(since / *period) } else { 0.0 };
                }
            }
            Self::Walk { increment, x, integers } => {
                for out in out {
                    *out += *x;
                    *x += *increment * integers.uniform();
                }
            }
            Self::Uniform { amplitude, integers } => integers.add_uniform(*amplitude, out),
            Self::Coloured { gain, share, x, integers } => {
                for out in out {
                    *x += (*gain * integers.gaussian() - *x) * *share;
                    *out += *x;
                }
            }
        }
    }
}

/// sin(2πx) for x ≥ 0, to about 10⁻¹⁶, with + − × ÷ alone: a library's sine has other last bits on other machines.
fn sine_of_turns(x: f64) -> f64 {
    let turn = x - x.floor();
    let quarter = match turn {
        t if t > 0.75 => t - 1.0,
        t if t > 0.25 => 0.5 - t,
        t => t,
    };
    let x = quarter * std::f64::consts::TAU;
    let term = |sum: f64, n: u32| 1.0 - x * x / f64::from(2 * n * (2 * n + 1)) * sum;
    x * (1..=10).rev().fold(1.0, term)
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

    fn column(signal: &[Piece], h: f64, n: usize) -> Vec<f64> {
        let mut out = vec![0.0; n];
        Source::new("load", signal, h, n, 7, 0).unwrap().fill(0, &mut out);
        out
    }

    #[test]
    fn steps_take_effect_at_their_sample() {
        let steps = [Piece::Steps(vec![(-1.0, 5.0), (0.3, 1.0), (0.35, 2.0), (9.0, 7.0)])];
        assert_eq!(column(&steps, 0.1, 6), [5.0, 5.0, 5.0, 1.0, 2.0, 2.0]);
        let late = [Piece::Steps(vec![(0.2, 1.0)])];
        assert_eq!(column(&late, 0.1, 4), [0.0, 0.0, 1.0, 1.0]);
    }

    #[test]
    fn pieces_add_up_and_do_not_mind_how_they_are_asked() {
        let signal = [
            Piece::Steps(vec![(0.0, 1.0), (13.0, 2.0)]),
            Piece::Ramp { t: 5.0, by: 3.0, over: 7.0 },
            Piece::Sine { amplitude: 0.5, period: 11.0, t: 2.0 },
            Piece::Walk { rate: 0.1 },
            Piece::Uniform { amplitude: 0.2 },
            Piece::Gaussian { sigma: 0.3 },
            Piece::Coloured { sigma: 0.3, tau: 4.0 },
            Piece::Samples((0..1000).map(f64::from).collect()),
        ];
        let whole = column(&signal, 0.1, 1000);
        let mut source = Source::new("load", &signal, 0.1, 1000, 7, 0).unwrap();
        let mut pieces = vec![0.0; 1000];
        for (first, end) in [(0, 3), (3, 200), (200, 201), (201, 1000)] {
            source.fill(first, &mut pieces[first..end]);
        }
        assert_eq!(whole, pieces);
        let sum: Vec<f64> = (0..1000)
            .map(|k| signal[..3].iter().map(|p| column(std::slice::from_ref(p), 0.1, 1000)[k]).sum())
            .collect();
        assert_eq!(column(&signal[..3], 0.1, 1000), sum);
    }

    #[test]
    fn constant_where_nothing_moves() {
        let source = |signal: &[Piece]| Source::new("load", signal, 1.0, 100, 0, 0).unwrap();
        let steps = source(&[Piece::Steps(vec![(10.0, 1.0), (20.0, 2.0)]), Piece::Steps(vec![(0.0, 5.0)])]);
        assert_eq!(steps.constant(0, 10), Some(5.0));
        assert_eq!(steps.constant(0, 11), None);
        assert_eq!(steps.constant(10, 20), Some(6.0));
        assert_eq!(steps.constant(20, 99), Some(7.0));
        assert_eq!(source(&[]).constant(0, 99), Some(0.0));
        assert_eq!(source(&[Piece::Walk { rate: 1.0 }]).constant(0, 2), None);
    }

    #[test]
    fn sine_against_the_library() {
        for k in 0..10_000 {
            let x = f64::from(k) * 0.000_37;
            assert!((sine_of_turns(x) - (x * std::f64::consts::TAU).sin()).abs() < 4e-15, "{x}");
        }
    }

    #[test]
    fn coloured_noise_has_its_deviation_and_its_correlation() {
        let (h, tau, sigma) = (0.5, 3.0, 0.2);
        let x = column(&[Piece::Coloured { sigma, tau }], h, 400_000);
        let mean = |lag: usize| x.iter().zip(&x[lag..]).map(|(a, b)| a * b).sum::<f64>() / x.len() as f64;
        assert!((mean(0) / (sigma * sigma) - 1.0).abs() < 0.03, "{}", mean(0));
        for lag in [1, 5] {
            let expected = (tau / (tau + h)).powi(lag);
            assert!((mean(lag as usize) / mean(0) - expected).abs() < 0.02);
        }
    }

    #[test]
    fn streams_differ() {
        let noise = [Piece::Uniform { amplitude: 1.0 }, Piece::Uniform { amplitude: 1.0 }];
        let stream = |stream| {
            let mut out = vec![0.0; 1000];
            Source::new("noise", &noise[..1], 1.0, 1000, 3, stream).unwrap().fill(0, &mut out);
            out
        };
        let both = column(&noise, 1.0, 1000);
        assert!(stream(0) != stream(1) && both.iter().any(|x| x.abs() > 1.0));
    }

    #[test]
    fn wrong_signals_are_named() {
        for (piece, part) in [
            (Piece::Steps(vec![(1.0, 0.0), (1.0, 2.0)]), "ascending"),
            (Piece::Steps(vec![(f64::NAN, 0.0)]), "pair of numbers"),
            (Piece::Samples(vec![0.0; 5].into()), "5 values for 6 samples"),
            (Piece::Samples(vec![f64::NAN; 6].into()), "sample 0"),
            (Piece::Ramp { t: 0.0, by: 1.0, over: 0.0 }, "over = 0: must be greater than 0 s"),
            (Piece::Sine { amplitude: 1.0, period: -1.0, t: 0.0 }, "period = -1: must be"),
            (Piece::Walk { rate: -1.0 }, "rate = -1: must be"),
            (Piece::Uniform { amplitude: f64::NAN }, "amplitude = NaN: must be"),
            (Piece::Gaussian { sigma: -1.0 }, "sigma = -1: must be"),
            (Piece::Coloured { sigma: 1.0, tau: -1.0 }, "tau = -1: must be"),
        ] {
            let text = Source::new("load", &[piece], 0.1, 6, 0, 0).unwrap_err().to_string();
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
        let mut source = Source::new("load", &[Piece::Walk { rate }], h, n + 1, 9, 0).unwrap();
        let mut walk = vec![0.0; n + 1];
        source.fill(0, &mut walk);
        assert_eq!(walk, random_walk(n + 1, h, rate, 9).unwrap());
    }
}
