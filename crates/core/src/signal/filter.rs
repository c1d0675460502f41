//! The second-order low-pass filter that makes the *signal* out of the samples.

use crate::error::require;
use crate::{Adding, Numbers, ParameterError, Real, Sum};

/// Second-order low-pass filter, Yf(s) = Y(s) / (1 + s·Tf)² (thesis 2.1).
///
/// Two equal first-order sections in the division-only form `y += (x − y)·(h/(Tf + h))`, the backward-difference
/// discretisation: stable for every h > 0, defined for steps of any length, and made of operations that a PLC has. The
/// factor h/(Tf + h) is computed first, then (x − y) is multiplied by it; nothing is fused.
///
/// Known bias: a signal of period T is delayed by about 2·Tf and, at T = 10·Tf, reduced to 72 % of its amplitude.
///
/// ```
/// use glapp_core::{SecondOrderFilter, SecondOrderFilterState};
/// let filter = SecondOrderFilter::new(1.0)?;
/// let mut state = SecondOrderFilterState::default();
/// assert_eq!(filter.update(&mut state, 4.0, 1.0), 4.0); // starts at the first value, without a transient
/// assert_eq!(filter.update(&mut state, 8.0, 1.0), 5.0); // 4 → 6 → in the second section 4 → 5
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondOrderFilter<R> {
    tf: R,
}

/// State of [`SecondOrderFilter`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SecondOrderFilterState<R: Real> {
    /// Output of the first section [unit of x].
    pub y1: R::Sum,
    /// Output of the second section, the filtered value [unit of x].
    pub y2: R::Sum,
    /// False until the first value was taken.
    pub started: bool,
}

impl<R: Real> SecondOrderFilter<R> {
    /// A filter with `tf` \[s\] ≥ 0; 0 passes the value through.
    pub fn new(tf: R) -> Result<Self, ParameterError> {
        Ok(Self { tf: require("tf", tf, tf >= R::ZERO, "0 s or greater")? })
    }

    /// The filter-time constant Tf \[s\].
    pub fn tf(&self) -> R {
        self.tf
    }

    /// Takes one value `x`, `h` seconds after the one before; gives the filtered value. The first value starts the
    /// filter there; a step `h` that is not positive leaves the state as it is.
    #[inline(always)]
    pub fn update(&self, state: &mut SecondOrderFilterState<R>, x: R, h: R) -> R {
        if !state.started {
            *state = SecondOrderFilterState { y1: x.into(), y2: x.into(), started: true };
        } else if h > R::ZERO {
            sections(self.tf, &mut state.y1, &mut state.y2, x, h);
        }
        state.y2.value()
    }
}

/// Takes `x`, `h` seconds after the value before, through both sections.
#[inline(always)]
pub(crate) fn sections<N: Numbers, S: Adding<N>>(tf: N, y1: &mut S, y2: &mut S, x: N, h: N) {
    let a = h / (tf + h);
    y1.add(y1.to(x) * a);
    y2.add(y1.since(*y2) * a);
}
