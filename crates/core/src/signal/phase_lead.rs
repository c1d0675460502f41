//! Phase lead: a linear design against the limit cycle of a gap.

use crate::error::require;
use crate::{ParameterError, Real, Sum};

/// Phase-lead compensator (1 + s·lead)/(1 + s·lag) with static gain 1 (thesis 2.2).
///
/// Backward differences, as in the filter; with the lagged signal x_f
///
/// ```text
/// y    = x + (x − x_f)·(lead − lag)/(lag + h)
/// x_f += (x − x_f)·h/(lag + h)
/// ```
///
/// A step of x shows (lead + h)/(lag + h) times as high: this is by what the compensator multiplies jumps, and nearly by what it
/// multiplies fast noise. With lead = lag it passes the signal on, bit for bit.
///
/// It begins at rest at its first input. An input that is no number, or a step h that is not above 0 or no number, leaves the output where it is.
///
/// ```
/// use glapp_core::{PhaseLead, PhaseLeadState};
///
/// let lead = PhaseLead::new(3.0, 1.0)?;
/// let mut state = PhaseLeadState::default();
/// assert_eq!([2.0, 3.0, 3.0, 3.0].map(|x| lead.update(&mut state, x, 1.0)), [2.0, 4.0, 3.5, 3.25]);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseLead<R> {
    lag: R,
    /// lead − lag.
    more: R,
}

/// State of a [`PhaseLead`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PhaseLeadState<R: Real> {
    /// The lagged signal x_f [unit of the signal].
    pub lagged: R::Sum,
    /// The last output [unit of the signal].
    pub output: R,
    /// False until the first input.
    pub started: bool,
}

impl<R: Real> PhaseLeadState<R> {
    /// Steady state at a known value.
    pub fn at(value: R) -> Self {
        Self { lagged: value.into(), output: value, started: true }
    }
}

impl<R: Real> PhaseLead<R> {
    /// A phase lead with time constants `lead` ≥ `lag` > 0 \[s\].
    pub fn new(lead: R, lag: R) -> Result<Self, ParameterError> {
        require("lag", lag, lag > R::ZERO, "greater than 0 s")?;
        require("lead", lead, lead >= lag, "a number not less than lag: a phase lead")?;
        Ok(Self { lag, more: lead - lag })
    }

    /// Takes a value and the time since the one before `h` \[s\]; gives the value with its lead.
    #[inline(always)]
    pub fn update(&self, state: &mut PhaseLeadState<R>, x: R, h: R) -> R {
        if !state.started {
            if x.is_number() {
                *state = PhaseLeadState::at(x);
            }
            return x;
        }
        if h > R::ZERO && h.is_number() && x.is_number() {
            let away = state.lagged.to(x);
            state.output = x + away * (self.more / (self.lag + h));
            state.lagged.add(away * (h / (self.lag + h)));
        }
        state.output
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn parameters_out_of_bounds_are_named() {
        for (lead, lag, name) in
            [(1.0, 0.0, "lag"), (1.0, f64::NAN, "lag"), (0.9, 1.0, "lead"), (f64::NAN, 1.0, "lead")]
        {
            assert_eq!(PhaseLead::new(lead, lag).unwrap_err().name, name);
        }
    }

    #[test]
    fn bad_input_leaves_the_output() {
        let lead = PhaseLead::new(4.0, 1.0).unwrap();
        let mut state = PhaseLeadState::default();
        assert!(lead.update(&mut state, f64::NAN, 1.0).is_nan());
        assert!(!state.started, "a bad first sample is no beginning");
        lead.update(&mut state, 1.0, 1.0);
        let y = lead.update(&mut state, 2.0, 1.0);
        assert_eq!(y, 3.5);
        for (x, h) in [(f64::NAN, 1.0), (f64::INFINITY, 1.0), (9.0, 0.0), (9.0, -1.0), (9.0, f64::INFINITY)] {
            assert_eq!(lead.update(&mut state, x, h), y);
        }
    }

    #[test]
    fn a_ramp_shows_as_much_earlier_as_lead_is_longer_than_lag() {
        let lead = PhaseLead::new(5.0, 2.0).unwrap();
        let mut state = PhaseLeadState::default();
        let last = (0..8000_u16).map(|k| lead.update(&mut state, 0.01 * f64::from(k), 0.01)).last().unwrap();
        assert!((last - (79.99 + 3.0)).abs() < 1e-9, "{last}");
    }

    #[test]
    fn single_precision_comes_to_rest_where_its_input_is() {
        // A plain sum would stop 1e-7·101325 short.
        let lead = PhaseLead::<f32>::new(1000.0, 500.0).unwrap();
        let mut state = PhaseLeadState::at(101_325.0);
        let last = (0..1_000_000).map(|_| lead.update(&mut state, 101_425.0, 0.01)).last().unwrap();
        assert_eq!(last, 101_425.0);
    }

    proptest! {
        #[test]
        fn a_lead_that_is_the_lag_changes_no_bit(
            lag in 0.01..10.0_f64, samples in prop::collection::vec((-1e3..1e3_f64, 0.001..2.0_f64), 1..50),
        ) {
            let lead = PhaseLead::new(lag, lag).unwrap();
            let mut state = PhaseLeadState::default();
            for (x, h) in samples {
                prop_assert_eq!(lead.update(&mut state, x, h), x);
            }
        }

        #[test]
        fn a_step_shows_by_the_ratio_at_most_and_dies_out(
            lag in 0.1..5.0_f64, ratio in 1.0..20.0_f64, step in -9.0..9.0_f64, h in 0.01..1.0_f64,
        ) {
            let lead = PhaseLead::new(lag * ratio, lag).unwrap();
            let mut state = PhaseLeadState::at(0.0);
            let first = lead.update(&mut state, step, h);
            prop_assert!((first - step * (lag * ratio + h) / (lag + h)).abs() < 1e-12 * ratio * 10.0);
            let mut before = first.abs();
            for _ in 0..3000 {
                let y = lead.update(&mut state, step, h);
                prop_assert!(y.abs() <= before + 1e-12 && y.abs() >= step.abs() - 1e-9);
                before = y.abs();
            }
        }
    }
}
