//! Control connections: what modules tell one another, forward and backward.

use crate::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO, Status};
use crate::{
    Backlash, BacklashState, Noise, NoiseState, PhaseLead, PhaseLeadState, RateLimit, RateLimitState, Real, Saturation,
    SecondOrderFilter, SecondOrderFilterState, Sum,
};

/// Value that a module hands on to the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Forward<R> {
    /// The signal.
    pub value: R,
    /// [`BAD`] where the value is not to be believed; 0 = all well.
    pub flags: Status,
}

impl<R: Real> Forward<R> {
    /// A value, with the flags that come with it; what is no number is [`BAD`].
    #[inline(always)]
    pub fn new(value: R, flags: Status) -> Self {
        Self { value, flags: if value.is_number() { flags } else { flags | BAD } }
    }

    /// Whether the value may be used.
    #[inline(always)]
    pub fn is_good(&self) -> bool {
        self.flags & BAD == 0 && self.value.is_number()
    }
}

impl<R: Real> From<R> for Forward<R> {
    fn from(value: R) -> Self {
        Self::new(value, 0)
    }
}

/// Report of a module to the one before it: the effect of the value it was handed (thesis 6.1, 7.1).
///
/// | flag | meaning | thesis |
/// |---|---|---|
/// | [`AT_LOW`] | something further on is at its lower limit: a lower value has no effect | `MinReached` |
/// | [`AT_HIGH`] | the same at the upper limit | `MaxReached` |
/// | either of them | something further on moves as fast as it can that way | |
/// | [`NOT_AUTO`] | the value is not followed: `tracking` is in effect instead | |
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Backward<R> {
    /// The lowest value that is followed.
    pub low: R,
    /// The highest value that is followed.
    pub high: R,
    /// [`AT_LOW`], [`AT_HIGH`], [`NOT_AUTO`]; 0 = all well.
    pub flags: Status,
    /// The value in effect, from which whoever takes over goes on without a bump.
    pub tracking: R,
}

impl<R: Real> Default for Backward<R> {
    /// Every value is followed.
    fn default() -> Self {
        Self { low: -R::LARGEST, high: R::LARGEST, flags: 0, tracking: R::ZERO }
    }
}

impl<R: Real> Backward<R> {
    /// Combined report of two followers of one value: the narrower limits, all flags, and the first value in effect
    /// that is not the one handed over.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            low: self.low.greater(other.low),
            high: self.high.lesser(other.high),
            flags: self.flags | other.flags,
            tracking: if self.flags & NOT_AUTO == 0 { other.tracking } else { self.tracking },
        }
    }
}

// Blocks that stand in a connection. They hand on the flags of what they get, and what comes back passes them unchanged,
// save at a `Saturation` and a `RateLimit`.

impl<R: Real> Noise<R> {
    /// [`update`](Self::update) in a connection.
    #[inline(always)]
    pub fn forward(&self, state: &mut NoiseState, x: Forward<R>) -> Forward<R> {
        Forward::new(self.update(state, x.value), x.flags)
    }
}

impl<R: Real> Backlash<R> {
    /// [`update`](Self::update) in a connection; a bad value leaves the output where it is.
    #[inline(always)]
    pub fn forward(&self, state: &mut BacklashState<R>, x: Forward<R>) -> Forward<R> {
        if x.is_good() {
            Forward::new(self.update(state, x.value), x.flags)
        } else {
            Forward::new(if state.started { state.output } else { x.value }, x.flags | BAD)
        }
    }
}

impl<R: Real> SecondOrderFilter<R> {
    /// [`update`](Self::update) in a connection: a bad value is flagged, with the last output, and the next good one
    /// starts the filter anew.
    #[inline(always)]
    pub fn forward(&self, state: &mut SecondOrderFilterState<R>, x: Forward<R>, h: R) -> Forward<R> {
        if x.is_good() {
            Forward::new(self.update(state, x.value, h), x.flags)
        } else {
            state.started = false;
            Forward::new(state.y2.value(), x.flags | BAD)
        }
    }
}

impl<R: Real> Saturation<R> {
    /// [`update`](Self::update) in a connection.
    #[inline(always)]
    pub fn forward(&self, x: Forward<R>) -> Forward<R> {
        Forward::new(self.update(x.value), x.flags)
    }

    /// Tells those before it of its limits, and that its input `x` has reached one.
    #[inline(always)]
    pub fn backward(&self, x: R, back: Backward<R>) -> Backward<R> {
        Backward {
            low: self.low.greater(back.low),
            high: self.high.lesser(back.high),
            flags: back.flags | self.reached(x),
            tracking: back.tracking,
        }
    }

    /// [`AT_LOW`] and [`AT_HIGH`], where `x` lies beyond a limit.
    #[inline(always)]
    pub(crate) fn beyond(&self, x: R) -> Status {
        (if x < self.low { AT_LOW } else { 0 }) | (if x > self.high { AT_HIGH } else { 0 })
    }

    /// [`AT_LOW`] and [`AT_HIGH`], where `x` has reached a limit.
    #[inline(always)]
    pub fn reached(&self, x: R) -> Status {
        (if x <= self.low { AT_LOW } else { 0 }) | (if x >= self.high { AT_HIGH } else { 0 })
    }
}

impl<R: Real> RateLimit<R> {
    /// [`update`](Self::update) in a connection; a bad value leaves the output where it is.
    #[inline(always)]
    pub fn forward(&self, state: &mut RateLimitState<R>, x: Forward<R>, h: R) -> Forward<R> {
        if x.is_good() {
            Forward::new(self.update(state, x.value, h), x.flags)
        } else {
            Forward::new(if state.started { state.output.value() } else { x.value }, x.flags | BAD)
        }
    }

    /// Tells those before it that its output has not come as far as its input `x`: farther that way has no effect yet.
    #[inline(always)]
    pub fn backward(&self, state: &RateLimitState<R>, x: R, back: Backward<R>) -> Backward<R> {
        let now = Saturation { low: state.output.value(), high: state.output.value() };
        Backward { flags: back.flags | now.beyond(x), ..back }
    }
}

impl<R: Real> PhaseLead<R> {
    /// [`update`](Self::update) in a connection; a bad value leaves the output where it is.
    #[inline(always)]
    pub fn forward(&self, state: &mut PhaseLeadState<R>, x: Forward<R>, h: R) -> Forward<R> {
        if x.is_good() {
            Forward::new(self.update(state, x.value, h), x.flags)
        } else {
            Forward::new(if state.started { state.output } else { x.value }, x.flags | BAD)
        }
    }

    /// Passes the backward signals on to the modules before it. Where its output is not followed, it rests at the value
    /// in effect, so that whoever goes on from there does so without a bump.
    #[inline(always)]
    pub fn backward(&self, state: &mut PhaseLeadState<R>, back: Backward<R>) -> Backward<R> {
        if back.flags & NOT_AUTO != 0 && back.tracking.is_number() {
            *state = PhaseLeadState::at(back.tracking);
        }
        back
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_is_bad() {
        for x in [f64::NAN, f64::INFINITY] {
            assert!(!Forward::from(x).is_good());
            assert_eq!(Noise::new(0.1).unwrap().forward(&mut NoiseState::default(), x.into()).flags, BAD);
        }
        assert!(Forward::from(1.0).is_good());
    }

    #[test]
    fn a_bad_value_moves_nothing_and_is_handed_on() {
        let gap = Backlash::new(1.0).unwrap();
        let mut state = BacklashState::at(3.0);
        let held = gap.forward(&mut state, Forward::new(9.0, BAD));
        assert_eq!((held.value, held.flags), (3.0, BAD));

        let filter = SecondOrderFilter::new(10.0).unwrap();
        let mut state = SecondOrderFilterState::default();
        filter.forward(&mut state, 5.0.into(), 1.0);
        let held = filter.forward(&mut state, f64::NAN.into(), 1.0);
        assert_eq!((held.value, held.flags), (5.0, BAD));
        // The start is the first good value: earlier values say nothing about it.
        assert_eq!(filter.forward(&mut state, 80.0.into(), 1.0), Forward::new(80.0, 0));
    }

    #[test]
    fn a_limit_is_told_backward() {
        let valve = Saturation::new(0.0, 100.0).unwrap();
        let narrower = Backward { high: 90.0, flags: NOT_AUTO, tracking: 7.0, ..Backward::default() };
        let back = valve.backward(100.0, narrower);
        assert_eq!(back, Backward { low: 0.0, high: 90.0, flags: NOT_AUTO | AT_HIGH, tracking: 7.0 });
        assert_eq!(valve.backward(50.0, Backward::default()).flags, 0);
        assert_eq!(valve.backward(-1.0, Backward::default()).flags, AT_LOW);
    }

    #[test]
    fn a_rate_that_limits_is_told_backward_until_it_has_caught_up() {
        let actuator = RateLimit::new(2.0).unwrap();
        let mut state = RateLimitState::at(50.0);
        let mut back = |x: f64| {
            let y = actuator.forward(&mut state, x.into(), 1.0);
            let back = actuator.backward(&state, x, Backward { high: 90.0, tracking: 7.0, ..Backward::default() });
            assert_eq!((back.low, back.high, back.tracking), (-f64::LARGEST, 90.0, 7.0));
            (y.value, y.flags, back.flags)
        };
        assert_eq!(back(55.0), (52.0, 0, AT_HIGH));
        assert_eq!(back(53.0), (53.0, 0, 0));
        assert_eq!(back(55.0), (55.0, 0, 0)); // as fast as it can, and it holds nothing back
        assert_eq!(back(40.0), (53.0, 0, AT_LOW));
        assert_eq!(back(f64::NAN), (53.0, BAD, 0));
    }

    #[test]
    fn a_lead_whose_output_is_not_followed_goes_on_without_a_bump() {
        let lead = PhaseLead::new(10.0, 1.0).unwrap();
        let mut state = PhaseLeadState::default();
        lead.forward(&mut state, 20.0.into(), 0.1);
        assert!(lead.forward(&mut state, 21.0.into(), 0.1).value > 29.0);
        let back = Backward { flags: NOT_AUTO, tracking: 55.0, ..Backward::default() };
        assert_eq!(lead.backward(&mut state, back), back);
        assert_eq!(lead.forward(&mut state, 55.0.into(), 0.1), Forward::new(55.0, 0));
        assert_eq!(lead.forward(&mut state, f64::NAN.into(), 0.1), Forward::new(55.0, BAD));
    }

    #[test]
    fn two_followers_say_the_narrower() {
        let one = Backward { low: 0.0, high: 50.0, flags: AT_LOW, tracking: 1.0 };
        let other = Backward { low: -9.0, high: 20.0, flags: NOT_AUTO, tracking: 2.0 };
        let both = Backward { low: 0.0, high: 20.0, flags: AT_LOW | NOT_AUTO, tracking: 2.0 };
        assert_eq!(one.and(other), both);
        assert_eq!(other.and(one), both);
    }
}
