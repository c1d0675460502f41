//! Measurement noise from a generator that every PLC can repeat.

use crate::error::require;
use crate::{ParameterError, Real};

/// M = 2³¹ − 1, the generator's prime modulus.
const MODULUS: i32 = 2_147_483_647;
/// The generator's multiplier (Park, Miller and Stockmeyer, Comm. ACM 36, 1993).
const MULTIPLIER: i32 = 48_271;
/// M ÷ multiplier.
const QUOTIENT: i32 = MODULUS / MULTIPLIER;
/// M mod multiplier; smaller than the quotient, which is what makes Schrage's way work.
const REMAINDER: i32 = MODULUS % MULTIPLIER;

/// Uniform noise of ± `amplitude` added to a signal (thesis 6.2, code block 6.1).
///
/// ```text
/// s   := 48271·s mod (2³¹ − 1)              by Schrage's way, so that no product exceeds a signed 32-bit integer
/// out := in + amplitude·((s/2147483647 − 0.5)·2)
/// ```
///
/// Mean 0, variance amplitude²/3, period 2³¹ − 2. In `f32`, `s` is rounded once on conversion, and the ends of the
/// interval can be met exactly.
///
/// ```
/// use glapp_core::{Noise, NoiseState};
///
/// let noise = Noise::new(0.1)?;
/// let mut state = NoiseState::default();
/// let out = noise.update(&mut state, 5.0);
/// assert_eq!(state.integer, 48_271);
/// assert_eq!(out, 5.0 + 0.1 * ((48_271.0 / 2_147_483_647.0 - 0.5) * 2.0));
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise<R> {
    amplitude: R,
}

/// The last integer drawn by a [`Noise`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct NoiseState {
    /// 1 … 2³¹ − 2; anything else counts as 1.
    pub integer: i32,
}

impl NoiseState {
    /// A start well away from those of all other seeds.
    ///
    /// Neighbouring integers would not do: the streams that start at 1 and at 2 have a correlation of one half. The seed
    /// is therefore stirred first (the finaliser of `SplitMix64`).
    pub fn seeded(seed: u64) -> Self {
        let mut z = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        Self { integer: (z % (MODULUS as u64 - 1)) as i32 + 1 }
    }

    /// Next integer of the generator.
    #[inline(always)]
    fn draw(&mut self) -> i32 {
        let s = if self.integer > 0 && self.integer < MODULUS { self.integer } else { 1 };
        let next = MULTIPLIER * (s % QUOTIENT) - REMAINDER * (s / QUOTIENT);
        self.integer = if next < 0 { next + MODULUS } else { next };
        self.integer
    }
}

impl<R: Real> Noise<R> {
    /// Noise of ± `amplitude` ≥ 0 [unit of the signal].
    pub fn new(amplitude: R) -> Result<Self, ParameterError> {
        Ok(Self { amplitude: require("amplitude", amplitude, amplitude >= R::ZERO, "0 or greater")? })
    }

    /// Takes a sample, gives it with noise.
    #[inline(always)]
    pub fn update(&self, state: &mut NoiseState, x: R) -> R {
        let s = R::of(f64::from(state.draw()));
        let centred = (s / R::of(f64::from(MODULUS)) - R::of(0.5)) * R::of(2.0);
        x + self.amplitude * centred
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amplitude_must_be_a_number_not_below_zero() {
        for amplitude in [-0.1, f64::NAN, f64::INFINITY] {
            assert_eq!(Noise::new(amplitude).unwrap_err().name, "amplitude");
        }
    }

    #[test]
    fn ten_thousandth_integer_is_the_published_one() {
        // Park, Miller and Stockmeyer: from 1, multiplier 48271, the 10 001st number of the sequence.
        let mut state = NoiseState { integer: 1 };
        let last = (0..10_000).map(|_| state.draw()).last();
        assert_eq!(last, Some(399_268_537));
    }

    #[test]
    fn every_state_from_outside_is_safe() {
        for integer in [i32::MIN, -1, 0, MODULUS] {
            assert_eq!(NoiseState { integer }.draw(), MULTIPLIER);
        }
    }

    #[test]
    fn uniform_white_and_different_by_seed() {
        let noise = Noise::new(1.0).unwrap();
        let n = 200_000;
        let series = |seed| {
            let mut state = NoiseState::seeded(seed);
            (0..n).map(|_| noise.update(&mut state, 0.0)).collect::<std::vec::Vec<f64>>()
        };
        let mean = |x: &mut dyn Iterator<Item = f64>| x.sum::<f64>() / f64::from(n);
        let (a, b) = (series(1), series(2));
        let tolerance = 4.0 / f64::from(n).sqrt();
        assert!(a.iter().all(|x| x.abs() <= 1.0));
        assert!(mean(&mut a.iter().copied()).abs() < tolerance);
        assert!((mean(&mut a.iter().map(|x| x * x)) - 1.0 / 3.0).abs() < tolerance);
        assert!(mean(&mut a.iter().zip(&a[1..]).map(|(x, y)| x * y)).abs() < tolerance);
        assert!(mean(&mut a.iter().zip(&b).map(|(x, y)| x * y)).abs() < tolerance);
    }

    #[test]
    fn single_precision_follows() {
        let (wide, narrow) = (Noise::new(0.5_f64).unwrap(), Noise::new(0.5_f32).unwrap());
        let (mut a, mut b) = (NoiseState::seeded(3), NoiseState::seeded(3));
        for _ in 0..10_000 {
            let (x, y) = (wide.update(&mut a, 1.0), narrow.update(&mut b, 1.0));
            assert!((x - f64::from(y)).abs() < 3e-7 && (0.5..=1.5).contains(&y));
        }
    }
}
