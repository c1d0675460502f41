//! Saturation: the range that a signal is kept in.

use crate::error::require;
use crate::{ParameterError, Real};

/// Limits of a signal: y = min(max(x, low), high).
///
/// ```text
///   output
///   high ┤      ╱────
///        │    ╱
///   low  ┤──╱
///        └──┴───┴──── input
///          low high
/// ```
///
/// It has no memory, so no state. An input that is no number passes as it is.
///
/// ```
/// use glapp_core::Saturation;
///
/// let valve = Saturation::new(0.0, 100.0)?;
/// assert_eq!([-3.0, 42.0, 120.0].map(|x| valve.update(x)), [0.0, 42.0, 100.0]);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Saturation<R> {
    /// Lower limit [unit of the signal].
    pub low: R,
    /// Upper limit [unit of the signal].
    pub high: R,
}

impl<R: Real> Saturation<R> {
    /// Limits `low` < `high`.
    pub fn new(low: R, high: R) -> Result<Self, ParameterError> {
        let high = require("high", high, true, "a number above the lower limit")?;
        let low = require("low", low, low < high, "a number below the upper limit")?;
        Ok(Self { low, high })
    }

    /// No limits short of the largest number.
    pub fn none() -> Self {
        Self { low: -R::LARGEST, high: R::LARGEST }
    }

    /// Distance of the limits, by halves, which cannot overflow.
    pub(crate) fn range(&self) -> R {
        let two = R::of(2.0);
        let half = self.high / two - self.low / two;
        if half <= R::MOST / two { two * half } else { R::MOST }
    }

    /// Takes a value, gives it within the limits.
    #[inline(always)]
    pub fn update(&self, x: R) -> R {
        x.greater(self.low).lesser(self.high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn limits_out_of_order_are_named() {
        assert_eq!(Saturation::new(1.0, 1.0).unwrap_err().name, "low");
        assert_eq!(Saturation::new(f64::NAN, 1.0).unwrap_err().name, "low");
        assert_eq!(Saturation::new(1.0, f64::INFINITY).unwrap_err().name, "high");
    }

    #[test]
    fn no_number_passes() {
        assert!(Saturation::new(0.0, 1.0).unwrap().update(f64::NAN).is_nan());
    }

    proptest! {
        #[test]
        fn within_and_untouched_where_it_was_within(x in -9.0..9.0_f64, low in -5.0..0.0_f64, high in 0.1..5.0_f64) {
            let limits = Saturation::new(low, high).unwrap();
            let y = limits.update(x);
            prop_assert!(low <= y && y <= high);
            prop_assert_eq!(limits.update(y), y);
            prop_assert!(y == x || !(low..=high).contains(&x));
        }
    }
}
