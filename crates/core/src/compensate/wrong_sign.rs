//! A process that answers OP the other way round than the controller's gain takes for granted.

use crate::detect::zero_crossing::sign_of;
use crate::error::require;
use crate::status::{AT_HIGH, AT_LOW, BAD, DATA_GAP, NOT_AUTO, Status};
use crate::{ParameterError, Real, Saturation, Sum};

/// The share of OP's span that it must have gone through on its way to the limit.
const TRAVEL: f64 = 0.2;
/// The share of that way by which it moves in a sample where it only rounds.
const ROUNDING: f64 = 1e-5;
/// Ratio of PV's distance from SP where OP reaches the limit to that in the first half of the way.
const GROWN: f64 = 1.5;
/// Ratio by which PV must exceed its farthest distance from SP before.
const BEYOND: f64 = 1.1;
/// Time that OP must have stood at its limit \[Ti\].
const WAIT: f64 = 5.0;
/// A longer time between samples is a gap \[s\].
const LONGEST: f64 = 1e9;

/// Notices that the gain K has the wrong sign for its process: OP has gone to its limit, and PV runs away all the same.
///
/// With integral action and the wrong sign no loop is stable: PV leaves SP for good, and drives OP to a limit, where it stays.
/// In a loop that is right OP goes to a limit too, where a load asks for more than there is. What tells them apart:
///
/// ```text
/// e = ysp − yf has not changed its sign since OP was u₀, and OP stands still at the limit to which K·e drives it, for t ≥ 5Ti
///
/// |u − u₀| ≥ 0.2·(high − low)      all that way, and PV has not crossed SP once
/// |e₁| ≥ 1.5·max |e| while |u − u₀| ≤ 0.1·(high − low)         the farther OP went, the farther PV did: |e₁| at the limit
/// |e₁| + a ≥ 1.1·max |e|           and beyond that since it stands there: a = what PV went away from SP, max |e| until then;
///                                  a now, and its mean
/// ```
///
/// A load that grows slowly takes OP to its limit with PV near SP, crossing it now and then: a short way within one half-period.
/// One that grows steadily keeps PV at the same distance while OP goes. One that comes at once takes PV away first: by the time OP
/// has gone to its limit PV is on its way back, or at its farthest. A step of SP takes OP to its limit and PV towards SP.
///
/// It cannot be separated from this: a load that by itself grows as a loop of the wrong sign does, faster and faster, and beyond what OP
/// can do; and one far beyond it that comes at once, where K is so large that OP is at its limit before PV is half of its way. Either
/// way the loop has lost its PV. Without limits nothing is noticed; nor where OP began near the limit at which it ends.
///
/// It holds until PV crosses SP, or until the controller is no longer in automatic. Where a sample is bad, no number or comes after
/// a gap, what was seen so far is forgotten, since PV may have gone anywhere; what was found holds. A step h that is not above 0 is
/// passed over.
///
/// ```
/// use glapp_core::{Saturation, WrongSign, WrongSignState, status::AT_HIGH};
///
/// let block = WrongSign::new(2.0, 3.0, Saturation::new(0.0, 100.0)?)?;
/// let mut state = WrongSignState::default();
/// // As OP opens, PV falls; at 100 % it goes on falling.
/// for (pv, op) in [(50.2, 50.0), (49.5, 51.0), (46.0, 60.0), (38.0, 80.0)] {
///     assert!(!block.update(&mut state, 50.0, pv, op, 1.0, 0));
/// }
/// let found = (0..16).map(|k| block.update(&mut state, 50.0, 30.0 - f64::from(k), 100.0, 1.0, AT_HIGH));
/// assert_eq!(found.filter(|found| *found).count(), 1); // after 5Ti = 15 s
/// assert!(!block.update(&mut state, 50.0, 50.1, 70.0, 1.0, 0)); // PV is back
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrongSign<R> {
    direct: bool,
    ti: R,
    travel: R,
}

/// State of a [`WrongSign`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct WrongSignState<R: Real> {
    /// The sign is wrong.
    pub found: bool,
    /// Sign of e; 0 while none has been seen.
    sign: i8,
    /// OP in the last sample, and before e changed its sign.
    op: R,
    begin: R,
    /// Greatest |e| in the first half of the way, and until OP reached its limit.
    early: R,
    farthest: R,
    /// Time since OP stands at its limit \[s\], |e| and PV at that moment, whether OP came from far with |e| growing,
    /// and the integral of PV's distance since.
    time: R::Sum,
    e: R,
    pv: R,
    far: bool,
    away: R::Sum,
}

impl<R: Real> WrongSign<R> {
    /// A block for a controller with gain `k` ≠ 0 (its sign matters), integral time `ti` > 0 \[s\] and the `limits` of its output.
    pub fn new(k: R, ti: R, limits: Saturation<R>) -> Result<Self, ParameterError> {
        require("k", k, k != R::ZERO, "a number other than 0")?;
        let ti = require("ti", ti, ti > R::ZERO, "greater than 0 s")?;
        let Saturation { low, high } = Saturation::new(limits.low, limits.high)?;
        Ok(Self { direct: k < R::ZERO, ti, travel: R::of(TRAVEL) * (high - low) })
    }

    /// Takes setpoint, filtered process value and output, the time since the last sample `h` \[s\], and flags ([`NOT_AUTO`],
    /// [`BAD`], [`DATA_GAP`], [`AT_LOW`], [`AT_HIGH`]); tells whether the sign is wrong.
    #[inline(always)]
    pub fn update(&self, state: &mut WrongSignState<R>, sp: R, yf: R, op: R, h: R, flags: Status) -> bool {
        let e = sp - yf;
        if flags & (BAD | DATA_GAP) != 0
            || !(e.is_measurable() && yf.is_measurable() && op.is_measurable() && h <= R::of(LONGEST))
        {
            if !state.found {
                *state = WrongSignState::default();
            }
            return state.found;
        }
        if h <= R::ZERO {
            return state.found;
        }
        let sign = sign_of(e, state.sign);
        if flags & NOT_AUTO != 0 {
            *state = WrongSignState { op, ..WrongSignState::default() };
            return false;
        }
        let last = state.op;
        if sign != state.sign {
            let begin = if state.sign == 0 { op } else { last };
            *state = WrongSignState { sign, begin, ..WrongSignState::default() };
        }
        state.op = op;
        // A rate that limits is told as a limit too: OP is on its way as long as it moves on.
        let (towards, on) = if (sign > 0) != self.direct { (AT_HIGH, op - last) } else { (AT_LOW, last - op) };
        if flags & towards != 0 && on <= R::of(ROUNDING) * self.travel {
            self.at_limit(state, e.magnitude(), yf, h);
        } else {
            state.farthest = state.farthest.greater(e.magnitude());
            if (op - state.begin).magnitude() <= self.travel / R::of(2.0) {
                state.early = state.farthest;
            }
            state.time = R::Sum::default();
        }
        state.found
    }

    /// Follows PV while OP stands at its limit.
    #[inline(never)]
    fn at_limit(&self, state: &mut WrongSignState<R>, e: R, yf: R, h: R) {
        if state.time.value() == R::ZERO {
            state.farthest = state.farthest.greater(e);
            (state.e, state.pv, state.away) = (e, yf, R::Sum::default());
            state.far = (state.op - state.begin).magnitude() >= self.travel && e >= R::of(GROWN) * state.early;
        }
        state.time.add(h);
        let away = if state.sign > 0 { state.pv - yf } else { yf - state.pv };
        state.away.add(away * h);
        let least = R::of(BEYOND) * state.farthest - state.e;
        let time = state.time.value();
        let beyond = away >= least && state.away.value() >= least * time;
        state.found |= state.far && beyond && time >= R::of(WAIT) * self.ti;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn block(k: f64) -> WrongSign<f64> {
        WrongSign::new(k, 5.0, Saturation::new(0.0, 100.0).unwrap()).unwrap()
    }

    #[test]
    fn settings_out_of_bounds_are_named() {
        let limits = Saturation::new(0.0, 100.0).unwrap();
        assert_eq!(WrongSign::new(0.0, 5.0, limits).unwrap_err().name, "k");
        assert_eq!(WrongSign::new(1.0, 0.0, limits).unwrap_err().name, "ti");
        assert_eq!(WrongSign::new(1.0, 5.0, Saturation { low: 2.0, high: 1.0 }).unwrap_err().name, "low");
    }

    #[test]
    fn a_rate_on_the_way_is_no_limit() {
        let (block, mut state) = (block(1.0), WrongSignState::default());
        for n in 0..200 {
            let (op, e) = ((40.0 + f64::from(n)).min(100.0), 1.0 + f64::from(n));
            let found = block.update(&mut state, 0.0, -e, op, 1.0, AT_HIGH);
            assert_eq!(found, n >= 60 + 25, "scan {n}: at the limit from 60 on");
        }
    }

    /// A PI on a lag of 10 s with gain `gain`, begun at 50 with PV a little off; whether it was found, and the last PV.
    fn run(k: f64, gain: f64, limits: (f64, f64), load: impl Fn(u32) -> f64, scans: u32) -> (Option<u32>, f64) {
        let limits = Saturation::new(limits.0, limits.1).unwrap();
        let pid = crate::Pid::new(k, 5.0, 0.0, 1.0, limits).unwrap();
        let block = WrongSign::new(k, 5.0, limits).unwrap();
        let (mut law, mut state, mut y, mut found) =
            (crate::PidState::default(), WrongSignState::default(), 50.1_f64, None);
        pid.track(&mut law, 50.0, y, 50.0, 0.1);
        for n in 0..scans {
            let op = pid.update(&mut law, 50.0, y, 0.1);
            if block.update(&mut state, 50.0, y, op, 0.1, limits.reached(op)) {
                found = found.or(Some(n));
            }
            y += (50.0 + gain * (op - 50.0 + load(n)) - y) * 0.01;
        }
        (found, y)
    }

    #[test]
    fn a_process_of_the_wrong_sign_is_found_in_time() {
        for (k, gain) in [(0.4, -1.0), (-0.4, 1.0), (3.0, -1.0), (1.0, -0.2)] {
            let (found, y) = run(k, gain, (0.0, 100.0), |_| 0.0, 3000);
            assert!((y - 50.0).abs() > 9.0, "it has run away: {y}");
            assert!(found.is_some_and(|n| n < 2500), "K {k}, gain {gain}: {found:?}");
        }
    }

    #[test]
    fn a_healthy_loop_is_not_taken_for_one() {
        for (k, gain) in [(0.4, 1.0), (-0.4, -1.0), (3.0, 1.0), (1.0, 0.2)] {
            let whole = (0.0, 100.0);
            assert_eq!(run(k, gain, whole, |_| 0.0, 3000).0, None);
            // More than OP can do, at once, and growing slowly.
            let (found, y) = run(k, gain, whole, |n| if n > 300 { -70.0 } else { 0.0 }, 6000);
            assert!((y - 50.0).abs() > 3.0, "beyond what OP can do: {y}");
            assert_eq!(found.is_some(), k == 3.0, "K {k}, gain {gain}: where K is large the two are alike");
            let (found, y) = run(k, gain, whole, |n| -0.02 * f64::from(n) + (f64::from(n) * 0.05).sin(), 4000);
            assert_eq!((found, (y - 50.0).abs() > 3.0), (None, true), "K {k}, gain {gain}: {y}");
        }
    }

    proptest! {
        #[test]
        fn sign_symmetric(samples in prop::collection::vec((-9.0..9.0_f64, 0.0..100.0_f64, 0.1..6.0_f64, 0..16_u16), 1..200)) {
            let (a, b) = (block(1.0), block(-1.0));
            let (mut x, mut y) = (WrongSignState::default(), WrongSignState::default());
            for (e, op, h, flags) in samples {
                prop_assert_eq!(a.update(&mut x, 0.0, -e, op, h, flags), b.update(&mut y, 0.0, e, op, h, flags));
            }
        }

        #[test]
        fn only_after_a_long_way_to_the_limit(
            samples in prop::collection::vec((0.1..90.0_f64, 81.0..100.0_f64, prop::bool::ANY), 1..300),
        ) {
            let (block, mut state) = (block(1.0), WrongSignState::default());
            let found: Vec<bool> = samples.iter().map(|&(e, op, limit)| {
                block.update(&mut state, 0.0, -e, op, 1.0, if limit { AT_HIGH } else { 0 })
            }).collect();
            prop_assert!(!found.contains(&true));
        }

        #[test]
        fn manual_and_a_crossing_take_it_back(by_hand in prop::bool::ANY) {
            let (block, mut state) = (block(1.0), WrongSignState::default());
            block.update(&mut state, 0.0, -1.0, 20.0, 1.0, 0);
            for n in 0..40 {
                block.update(&mut state, 0.0, -5.0 - f64::from(n), 100.0, 1.0, AT_HIGH);
            }
            prop_assert!(state.found);
            for (yf, h, flags) in [(f64::NAN, 1.0, 0), (-9.0, 1.1e9, 0), (-1.1e30, 1.0, 0), (-9.0, 0.0, 0), (-9.0, 1.0, DATA_GAP | NOT_AUTO), (-9.0, 1.0, BAD), (-9.0, 1.0, 0)] {
                prop_assert!(block.update(&mut state, 0.0, yf, 100.0, h, flags));
            }
            let (yf, flags) = if by_hand { (-30.0, NOT_AUTO) } else { (0.1, 0) };
            prop_assert!(!block.update(&mut state, 0.0, yf, 100.0, 1.0, flags));
        }
    }
}
