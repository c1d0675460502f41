//! The derivative of a sampled signal.

use crate::Real;

/// Backward difference (x − x_before)/h: the derivative ẏf that (4.1), (7.6) and a PID use.
///
/// Without parameters; the state is the value before. The first value gives 0, so that a controller starts without a
/// kick; a step h that is not positive gives 0 and keeps the value before.
///
/// ```
/// use glapp_core::Derivative;
/// let mut state = Derivative::default();
/// assert_eq!(state.update(2.0, 0.5), 0.0);
/// assert_eq!(state.update(3.0, 0.5), 2.0);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Derivative<R> {
    previous: R,
    started: bool,
}

impl<R: Real> Derivative<R> {
    /// The state after a value `previous`.
    #[inline(always)]
    pub fn after(previous: R) -> Self {
        Self { previous, started: true }
    }

    /// Takes one value `x`, `h` seconds after the one before; gives the slope [unit of x/s].
    #[inline(always)]
    pub fn update(&mut self, x: R, h: R) -> R {
        if !self.started {
            *self = Self::after(x);
            return R::ZERO;
        }
        if h <= R::ZERO {
            return R::ZERO;
        }
        let slope = (x - self.previous) / h;
        self.previous = x;
        slope
    }
}
