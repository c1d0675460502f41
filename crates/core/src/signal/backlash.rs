//! Backlash: a play of total width `d` between a driving and a driven part.

use crate::error::require;
use crate::{ParameterError, Real};

/// Backlash of total width `d` (thesis 6.3, code block 6.2).
///
/// The driven side rests until the driving side has taken up the gap, then follows at half a gap's distance:
///
/// ```text
///   output
///     │        ╱  ╱        y = x − d/2   where that lies above the old y (moving up)
///     │   ←───╱  ╱         y = x + d/2   where that lies below the old y (moving down)
///     │      ╱──╱→         y = old y     in between
///     └──────┴──┴─── input
///            ←d →
/// ```
///
/// The thesis compares x with y ± d/2; here the comparison is made after the shift, so that rounding can never move the
/// output against the input. Both give the same output to the last bit or two.
///
/// An input that is no number leaves the output where it is.
///
/// ```
/// use glapp_core::{Backlash, BacklashState};
///
/// let gap = Backlash::new(2.0)?;
/// let mut state = BacklashState::default(); // begins in the middle of the gap: output = first input
/// let outputs = [0.0, 0.9, 3.0, 2.0, 1.5, 0.5].map(|x| gap.update(&mut state, x));
/// assert_eq!(outputs, [0.0, 0.0, 2.0, 2.0, 2.0, 1.5]);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backlash<R> {
    half: R,
}

/// State of a [`Backlash`]: the position of the driven side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BacklashState<R> {
    /// Position of the driven side [unit of the input].
    pub output: R,
    /// False until the first input, which then is taken as the position.
    pub started: bool,
}

impl<R: Real> BacklashState<R> {
    /// State with the driven side at a known position [unit of the input].
    pub fn at(output: R) -> Self {
        Self { output, started: true }
    }
}

impl<R: Real> Backlash<R> {
    /// A gap of total width `d` ≥ 0 [unit of the input].
    pub fn new(d: R) -> Result<Self, ParameterError> {
        let d = require("d", d, d >= R::ZERO, "0 or greater")?;
        Ok(Self { half: d / R::of(2.0) })
    }

    /// Takes the position of the driving side, gives that of the driven side.
    #[inline(always)]
    pub fn update(&self, state: &mut BacklashState<R>, x: R) -> R {
        if !state.started {
            *state = BacklashState { output: x, started: x.is_number() };
            return x;
        }
        state.output = state.output.greater(x - self.half).lesser(x + self.half);
        state.output
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn width_must_be_a_number_not_below_zero() {
        for d in [-0.1, f64::NAN, f64::INFINITY] {
            let error = Backlash::new(d).unwrap_err();
            assert_eq!((error.name, error.bound), ("d", "0 or greater"));
        }
    }

    #[test]
    fn bad_input_leaves_the_output() {
        let gap = Backlash::new(0.5).unwrap();
        let mut state = BacklashState::default();
        assert!(gap.update(&mut state, f64::NAN).is_nan());
        assert!(!state.started, "a bad first sample must not become the position");
        gap.update(&mut state, 1.0);
        assert_eq!(gap.update(&mut state, f64::NAN), 1.0);
    }

    #[test]
    fn single_precision_follows() {
        let (wide, narrow) = (Backlash::new(0.5_f64).unwrap(), Backlash::new(0.5_f32).unwrap());
        let (mut a, mut b) = (BacklashState::default(), BacklashState::default());
        for i in 0_u8..200 {
            let x = f32::from(i % 7) * 0.125; // exact in both
            assert_eq!(wide.update(&mut a, x.into()), f64::from(narrow.update(&mut b, x)));
        }
    }

    proptest! {
        #[test]
        fn output_stays_within_half_a_gap_and_never_moves_against_the_input(
            d in 0.0..3.0_f64,
            xs in prop::collection::vec(-10.0..10.0_f64, 2..60),
        ) {
            let gap = Backlash::new(d).unwrap();
            let mut state = BacklashState::default();
            let (mut x_old, mut y_old) = (xs[0], gap.update(&mut state, xs[0]));
            for &x in &xs[1..] {
                let y = gap.update(&mut state, x);
                prop_assert!((x - y).abs() <= d / 2.0 + 1e-14);
                prop_assert!((y - y_old) * (x - x_old) >= 0.0);
                (x_old, y_old) = (x, y);
            }
        }

        #[test]
        fn sign_symmetric(d in 0.0..3.0_f64, xs in prop::collection::vec(-10.0..10.0_f64, 1..60)) {
            let gap = Backlash::new(d).unwrap();
            let (mut a, mut b) = (BacklashState::default(), BacklashState::default());
            for &x in &xs {
                prop_assert_eq!(gap.update(&mut a, x), -gap.update(&mut b, -x));
            }
        }

        #[test]
        fn agrees_with_the_rule_as_the_thesis_prints_it(
            d in 0.0..3.0_f64,
            xs in prop::collection::vec(-10.0..10.0_f64, 1..60),
        ) {
            let gap = Backlash::new(d).unwrap();
            let mut state = BacklashState::at(0.0);
            let mut old = 0.0;
            for &x in &xs {
                if x > old + d / 2.0 {
                    old = x - d / 2.0;
                } else if x < old - d / 2.0 {
                    old = x + d / 2.0;
                }
                prop_assert!((gap.update(&mut state, x) - old).abs() <= 1e-14);
            }
        }
    }
}
