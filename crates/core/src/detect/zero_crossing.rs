//! Zero crossings of the control error.

use crate::Real;

/// Finds zero crossings of the control error e = ysp − yf (thesis (2.1)).
///
/// A crossing is a change of the sign of e. An error of exactly zero keeps the sign before it: read literally, (2.1)
/// with its ≤ would make every sample of a flat e = 0 a crossing. Without parameters; the state is the sign.
///
/// ```
/// use glapp_core::ZeroCrossing;
/// let mut state = ZeroCrossing::default();
/// assert!(!state.update(0.5)); // the first sign is no crossing
/// assert!(!state.update(0.0)); // zero keeps the sign
/// assert!(state.update(-0.1));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ZeroCrossing {
    /// +1 or −1; 0 until an error other than zero was seen.
    pub sign: i8,
}

impl ZeroCrossing {
    /// Takes the error `e` [unit of PV]; true where its sign changed.
    #[inline(always)]
    pub fn update<R: Real>(&mut self, e: R) -> bool {
        let sign = sign_of(e, self.sign);
        let crossed = sign != self.sign && self.sign != 0;
        self.sign = sign;
        crossed
    }
}

/// The sign of `e`, or `before` where e is zero.
#[inline(always)]
pub(crate) fn sign_of<R: Real>(e: R, before: i8) -> i8 {
    if e > R::ZERO {
        1
    } else if e < R::ZERO {
        -1
    } else {
        before
    }
}
