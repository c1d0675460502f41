//! Rate limit: a signal that cannot move faster than so much a second.

use crate::error::require;
use crate::{ParameterError, Real, Sum};

/// Limit of the rate of change: the stroking speed of an actuator, the ramp of a setpoint.
///
/// ```text
/// step = rate·h
/// y := y_old + step   where x lies above that
///      y_old − step   where x lies below that
///      x              in between
/// ```
///
/// An input that is no number, or a step h that is not above 0, leaves the output where it is.
///
/// ```
/// use glapp_core::{RateLimit, RateLimitState};
///
/// let actuator = RateLimit::new(2.0)?;
/// let mut state = RateLimitState::default(); // begins at the first input
/// assert_eq!([5.0, 9.0, 9.0, 8.5].map(|x| actuator.update(&mut state, x, 1.0)), [5.0, 7.0, 9.0, 8.5]);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateLimit<R> {
    rate: R,
}

/// State of a [`RateLimit`]: its output.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RateLimitState<R: Real> {
    /// The last output [unit of the signal].
    pub output: R::Sum,
    /// False until the first input, which then is taken as the output.
    pub started: bool,
}

impl<R: Real> RateLimitState<R> {
    /// State with the output at a known value.
    pub fn at(output: R) -> Self {
        Self { output: output.into(), started: true }
    }
}

impl<R: Real> RateLimit<R> {
    /// A limit of `rate` > 0 [unit of the signal per second], up and down.
    pub fn new(rate: R) -> Result<Self, ParameterError> {
        Ok(Self { rate: require("rate", rate, rate > R::ZERO, "greater than 0 per second")? })
    }

    /// Takes a value and the time since the one before `h` \[s\], gives the limited value.
    #[inline(always)]
    pub fn update(&self, state: &mut RateLimitState<R>, x: R, h: R) -> R {
        if !state.started {
            *state = RateLimitState { output: x.into(), started: x.is_number() };
            return x;
        }
        if h > R::ZERO && x.is_number() {
            state.output.approach(x, self.rate * h);
        }
        state.output.value()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rate_must_be_a_number_above_zero() {
        for rate in [0.0, -0.1, f64::NAN, f64::INFINITY] {
            assert_eq!(RateLimit::new(rate).unwrap_err().name, "rate");
        }
    }

    #[test]
    fn bad_input_leaves_the_output() {
        let limit = RateLimit::new(0.5).unwrap();
        let mut state = RateLimitState::default();
        assert!(limit.update(&mut state, f64::NAN, 1.0).is_nan());
        assert!(!state.started, "a bad first sample must not become the output");
        limit.update(&mut state, 1.0, 1.0);
        for (x, h) in [(f64::NAN, 1.0), (f64::INFINITY, 1.0), (2.0, 0.0), (2.0, -1.0)] {
            assert_eq!(limit.update(&mut state, x, h), 1.0);
        }
    }

    proptest! {
        #[test]
        fn never_faster_and_sign_symmetric(
            rate in 0.01..3.0_f64,
            samples in prop::collection::vec((-10.0..10.0_f64, 0.01..2.0_f64), 2..60),
        ) {
            let limit = RateLimit::new(rate).unwrap();
            let (mut a, mut b) = (RateLimitState::at(0.0), RateLimitState::at(0.0));
            let mut old = 0.0_f64;
            for &(x, h) in &samples {
                let y = limit.update(&mut a, x, h);
                prop_assert_eq!(y, -limit.update(&mut b, -x, h));
                prop_assert!((y - old).abs() <= rate * h + 1e-14 && (y - old) * (x - old) >= 0.0);
                old = y;
            }
        }
    }
}
