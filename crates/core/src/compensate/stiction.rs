//! Compensation of a valve that sticks: pushes on top of the controller's output.

use super::compensation::{LONGEST, LONGEST_WATCH, NO_LIMIT, Standing, longest_release, repay, usual_release};
use super::harm::{Harm, HarmState};
use crate::detect::zero_crossing::sign_of;
use crate::error::require;
use crate::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO, Status};
use crate::{ParameterError, Real, Saturation, Sum};

named! {
    /// Method of pushing a valve that sticks.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[repr(u8)]
    pub enum Push {
        /// Short pulses, one each period, towards where OP has gone since the pulse before: the knocker (Hägglund, *A friction compensator
        /// for pneumatic control valves*, J. Process Control 12, 2002).
        Knocker = 1 => "knocker",
        /// A constant towards where OP goes: constant reinforcement (Ivan and Lakshminarayanan, *A new unified approach to valve stiction
        /// quantification and compensation*, Ind. Eng. Chem. Res. 48, 2009).
        Reinforcement = 2 => "reinforcement",
        /// Two moves, one that breaks the stem loose and one back, where PV stays off SP; after Srinivasan and Rengaswamy, *Approaches for
        /// efficient stiction compensation in process control valves*, Comput. Chem. Eng. 32, 2008.
        TwoMoves = 3 => "two_moves",
    }
}

/// Settings of a [`Stiction`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct StictionSettings<R> {
    /// Method of pushing.
    pub push: Push,
    /// Gain K ≠ 0 of the controller, negative for direct action; only its sign counts, and only for [`Push::TwoMoves`].
    pub k: R,
    /// Integral time Ti > 0 of the controller \[s\], by which bounds go.
    pub ti: R,
    /// Height of a push, 0 or greater, at most `limit` [OP unit].
    pub size: R,
    /// Greatest height, at most OP's range [OP unit].
    pub limit: R,
    /// Length of a pulse, or of each of two moves, above 0, at most 10 Ti \[s\]; not used by [`Push::Reinforcement`].
    pub hold: R,
    /// Time from one push to the next, at least 2 `hold`, at most 1000 Ti \[s\]; not used by [`Push::Reinforcement`].
    pub period: R,
    /// Distance that OP must have gone, or gone back, to count as a direction; 0 or greater [OP unit]. Not used by
    /// [`Push::TwoMoves`].
    pub band: R,
    /// Distance of PV from SP that starts a push, 0 or greater [PV unit]; for [`Push::TwoMoves`].
    pub far: R,
    /// Greatest rate of u_FF > 0, at most 1E37 [OP unit per s].
    pub rate: R,
    /// Time over which it is taken away > 0, at most 10 Ti and at most 300 \[s\].
    pub release: R,
    /// Budget: travel of u_FF in any hour > 0, at most 1E37 [OP unit].
    pub travel: R,
    /// Time over which the loop is compared with its state before > 0, at most 1E5 Ti \[s\].
    pub watch: R,
    /// Whether a loop that is worse than before withdraws it.
    pub withdraw: bool,
    /// Limits of OP [OP unit].
    pub limits: Saturation<R>,
}

impl<R: Real> StictionSettings<R> {
    /// Pushes of height `size` for a controller with gain `k` and integral time `ti` \[s\]: no higher than that; pulses of Ti/10 every
    /// Ti/5; two moves of Ti each, 10 Ti apart; a band of a tenth of the height; no rate and no budget; taken away within Ti, or 300 s where
    /// that is shorter; compared over 300 Ti, and withdrawn where that asks for it.
    pub fn new(push: Push, k: R, ti: R, size: R) -> Self {
        let ten = R::of(10.0);
        let (hold, period) = match push {
            Push::TwoMoves => (ti, ten * ti),
            _ => (ti / ten, ti / R::of(5.0)),
        };
        Self {
            push,
            k,
            ti,
            size,
            limit: size,
            hold,
            period,
            band: size / ten,
            far: R::ZERO,
            rate: R::of(NO_LIMIT),
            release: usual_release(ti),
            travel: R::of(NO_LIMIT),
            watch: R::of(300.0) * ti,
            withdraw: true,
            limits: Saturation::none(),
        }
    }
}

/// One sample for a [`Stiction`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StictionSample<R> {
    /// Control error e = ysp − yf [PV unit].
    pub e: R,
    /// Output of the controller without u_FF; in manual, OP itself [OP unit].
    pub u: R,
    /// Time since the sample before \[s\].
    pub h: R,
    /// Whether a person wants it on.
    pub enable: bool,
    /// [`NOT_AUTO`], [`BAD`], [`AT_LOW`], [`AT_HIGH`]; 0 = all well.
    pub flags: Status,
}

/// Pushes against the stiction of a valve: a signal added to the controller's output.
///
/// ```text
/// knocker:        each period, for `hold`:   u_FF = size·sign(u − u at the pulse before)
/// reinforcement:                             u_FF = size·(which way u goes; it turns where it has gone back by more than `band`)
/// two moves:      no sooner than a period after the last, where |e| > far:
///                                            u_FF = size·sign(e·K) for `hold`, then −size·sign(e·K) for `hold`, then 0
/// ```
///
/// The safety is that of [`Compensation`](crate::Compensation): it is off until it is enabled; it comes in with a push that begins while it is,
/// and never with a bump; its height and rate are bounded; a bad value, a limit and a withdrawal take u_FF to 0 within `release`, manual at once; a
/// push that the travel left in the budget does not allow withdraws it, and so does a loop whose distance from SP, or whose
/// controller's turns, are more than before it was enabled. A withdrawal holds until it is enabled anew.
///
/// ```
/// use glapp_core::{Push, Stiction, StictionSample, StictionSettings, StictionState};
///
/// let knocker = Stiction::new(StictionSettings {
///     hold: 1.0, period: 3.0, band: 0.0, ..StictionSettings::new(Push::Knocker, 1.0, 10.0, 2.0)
/// })?;
/// let mut state = StictionState::default();
/// let mut update = |u| {
///     let sample = StictionSample { u, h: 1.0, enable: true, ..StictionSample::default() };
///     knocker.update(&mut state, &sample)
/// };
/// assert_eq!([50.0, 50.1, 50.2].map(&mut update), [0.0; 3]);
/// assert_eq!([50.3, 50.4, 50.5, 50.0].map(&mut update), [2.0, 0.0, 0.0, -2.0]); // up since the first, then down
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiction<R> {
    settings: StictionSettings<R>,
    harm: Harm<R>,
}

/// State of a [`Stiction`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct StictionState<R: Real> {
    harm: HarmState<R>,
    /// A sample has been seen, and OP then, or at the last push.
    started: bool,
    last: R,
    /// Lowest and highest u since it last turned.
    low: R,
    high: R,
    /// Time since the last push began, or since the first sample \[s\].
    time: R::Sum,
    /// Direction of the push: +1 or −1; 0 while unknown.
    pub direction: i8,
    in_force: bool,
    /// Why it was withdrawn until it is enabled anew.
    withdrawn: Option<Standing>,
    /// Size at the beginning of the decrease.
    whole: R,
    /// Feed-forward added to OP [OP unit].
    pub u_ff: R::Sum,
    /// Travel that counts against the budget, which an hour takes off again [OP unit].
    pub travel: R::Sum,
    /// State: active, or the reason why it is not.
    pub standing: Standing,
}

impl<R: Real> Stiction<R> {
    /// A block with these settings; an error names the first that is out of its bounds.
    pub fn new(settings: StictionSettings<R>) -> Result<Self, ParameterError> {
        let s = &settings;
        let (zero, two, ten) = (R::ZERO, R::of(2.0), R::of(10.0));
        let range = s.limits.range();
        let none = R::of(NO_LIMIT);
        let within =
            |name, value: R, low: R, high: R, words| require(name, value, value >= low && value <= high, words);
        let above = |name, value: R, high: R, words| require(name, value, value > zero && value <= high, words);
        require("k", s.k, s.k != zero, "a number other than 0")?;
        above("ti", s.ti, R::of(LONGEST), "greater than 0 s, at most 1e9 s")?;
        within("size", s.size, zero, range, "0 or greater, at most OP's range")?;
        within("limit", s.limit, s.size, range, "at least size, at most OP's range")?;
        above("hold", s.hold, ten * s.ti, "greater than 0 s, at most 10 Ti")?;
        within("period", s.period, two * s.hold, R::of(1e3) * s.ti, "at least 2 hold, at most 1000 Ti")?;
        within("band", s.band, zero, range, "0 or greater, at most OP's range")?;
        within("far", s.far, zero, R::MOST, "0 or greater")?;
        above("rate", s.rate, none, "greater than 0 per second, at most 1e37: none")?;
        above("release", s.release, longest_release(s.ti), "greater than 0 s, at most 10 Ti and at most 300 s")?;
        above("travel", s.travel, none, "greater than 0 in an hour, at most 1e37: none")?;
        above("watch", s.watch, R::of(LONGEST_WATCH) * s.ti, "greater than 0 s, at most 1e5 Ti")?;
        let harm = Harm { watch: s.watch, band: s.size / ten };
        Ok(Self { settings, harm })
    }

    /// The settings.
    pub fn settings(&self) -> &StictionSettings<R> {
        &self.settings
    }

    /// Takes one sample; gives u_FF, which is to be added to u before OP's limits [OP unit].
    pub fn update(&self, state: &mut StictionState<R>, sample: &StictionSample<R>) -> R {
        let s = &self.settings;
        let bad = sample.flags & BAD != 0 || !sample.e.is_measurable() || !sample.u.is_measurable();
        let timed = sample.h > R::ZERO && sample.h <= R::of(LONGEST);
        let mut begins = false;
        if timed {
            repay(&mut state.travel, s.travel, sample.h);
            begins = !bad && self.look(state, sample);
        }
        let mut standing = self.standing(state, sample, bad);
        if standing == Standing::Active {
            if begins {
                standing = self.pay(state);
            } else if !state.in_force {
                standing = Standing::Waiting;
            }
        }
        state.in_force = standing == Standing::Active;
        state.standing = standing;
        if standing == Standing::NotAuto {
            (state.u_ff, state.whole) = (R::Sum::default(), R::ZERO);
        } else if timed {
            let old = state.u_ff;
            if state.in_force {
                state.whole = R::ZERO;
                state.u_ff.approach(self.goal(state), s.rate * sample.h);
            } else {
                state.whole = state.whole.greater(old.value().magnitude());
                state.u_ff.approach(R::ZERO, state.whole / s.release * sample.h);
            }
            state.travel.add(state.u_ff.since(old).magnitude());
            self.compare(state, sample, bad);
        }
        state.u_ff.value()
    }

    /// Finds the direction of the push, and whether one begins.
    fn look(&self, state: &mut StictionState<R>, sample: &StictionSample<R>) -> bool {
        let s = &self.settings;
        let u = sample.u;
        if !state.started {
            (state.started, state.last, state.low, state.high) = (true, u, u, u);
            return false;
        }
        state.time.add(sample.h);
        let due = state.time.value() >= s.period;
        match s.push {
            Push::Knocker if due => {
                if u - state.last > s.band {
                    state.direction = 1;
                } else if state.last - u > s.band {
                    state.direction = -1;
                }
                state.last = u;
            }
            Push::TwoMoves if due && sample.e.magnitude() > s.far => {
                state.direction = sign_of(if s.k < R::ZERO { -sample.e } else { sample.e }, state.direction);
            }
            Push::Reinforcement => {
                state.low = state.low.lesser(u);
                state.high = state.high.greater(u);
                if state.direction <= 0 && u - state.low > s.band {
                    state.direction = 1;
                } else if state.direction >= 0 && state.high - u > s.band {
                    state.direction = -1;
                } else {
                    return false;
                }
                (state.low, state.high) = (u, u);
            }
            _ => return false,
        }
        state.time = R::Sum::default();
        state.direction != 0
    }

    /// Goal of u_FF while it is in force.
    fn goal(&self, state: &StictionState<R>) -> R {
        let s = &self.settings;
        let (towards, time) = (if state.direction < 0 { -s.size } else { s.size }, state.time.value());
        match s.push {
            Push::Reinforcement => towards,
            _ if time < s.hold => towards,
            Push::TwoMoves if time < R::of(2.0) * s.hold => -towards,
            _ => R::ZERO,
        }
    }

    /// The first cause to do nothing.
    fn standing(&self, state: &mut StictionState<R>, sample: &StictionSample<R>, bad: bool) -> Standing {
        let s = &self.settings;
        if !sample.enable {
            state.withdrawn = None;
            Standing::NotEnabled
        } else if sample.flags & NOT_AUTO != 0 {
            Standing::NotAuto
        } else if bad {
            Standing::BadQuality
        } else if let Some(withdrawn) = state.withdrawn {
            withdrawn
        } else if sample.flags & (AT_LOW | AT_HIGH) != 0
            || sample.u - s.size < s.limits.low
            || sample.u + s.size > s.limits.high
        {
            Standing::AtLimit
        } else if s.size <= R::ZERO {
            Standing::TooSmall
        } else {
            Standing::Active
        }
    }

    /// Takes a push off the account; withdraws it where that does not suffice.
    fn pay(&self, state: &mut StictionState<R>) -> Standing {
        let s = &self.settings;
        // Travel out and back, or to both sides and back.
        let way = R::of(if s.push == Push::TwoMoves { 4.0 } else { 2.0 }) * s.size;
        if (state.travel.value() + state.u_ff.value().magnitude() + way) * R::of(2.0) > s.travel {
            state.withdrawn = Some(Standing::TooMuchTravel);
        }
        state.withdrawn.unwrap_or(Standing::Active)
    }

    /// Compares the loop with its state before it was enabled. The pushes themselves are no turns of the controller.
    fn compare(&self, state: &mut StictionState<R>, sample: &StictionSample<R>, bad: bool) {
        let unknown = bad || sample.flags != 0 || !(sample.e + sample.u).is_measurable();
        if !state.in_force && (state.standing != Standing::NotEnabled || unknown) {
            return match state.standing {
                Standing::NotEnabled => self.harm.begin(&mut state.harm, false),
                _ => self.harm.interrupt(&mut state.harm),
            };
        }
        let worse = self.harm.update(&mut state.harm, sample.e, sample.u, sample.h, state.in_force);
        if worse && self.settings.withdraw && state.withdrawn.is_none() {
            state.withdrawn = Some(Standing::Worse);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn settings(push: Push) -> StictionSettings<f64> {
        StictionSettings {
            hold: 1.0,
            period: 4.0,
            band: 0.5,
            far: 0.5,
            release: 4.0,
            limits: Saturation::new(0.0, 100.0).unwrap(),
            ..StictionSettings::new(push, 1.0, 10.0, 2.0)
        }
    }

    fn sample(e: f64, u: f64) -> StictionSample<f64> {
        StictionSample { e, u, h: 1.0, enable: true, flags: 0 }
    }

    fn run(push: Push, samples: impl Iterator<Item = StictionSample<f64>>) -> Vec<(f64, Standing)> {
        let (block, mut state) = (Stiction::new(settings(push)).unwrap(), StictionState::default());
        samples.map(|sample| (block.update(&mut state, &sample), state.standing)).collect()
    }

    #[test]
    fn it_is_off_until_it_is_enabled() {
        for push in Push::ALL {
            let off = (0..50).map(|i| StictionSample { enable: false, ..sample(1.0, 50.0 + f64::from(i)) });
            assert!(run(push, off).iter().all(|shown| *shown == (0.0, Standing::NotEnabled)), "{push:?}");
        }
    }

    #[test]
    fn two_moves_push_and_come_back() {
        let shown = run(Push::TwoMoves, (0..9).map(|_| sample(1.0, 50.0)));
        let u_ff: Vec<f64> = shown.iter().map(|shown| shown.0).collect();
        assert_eq!(u_ff, [0.0, 0.0, 0.0, 0.0, 2.0, -2.0, 0.0, 0.0, 2.0]);
        assert!(run(Push::TwoMoves, (0..9).map(|_| sample(0.4, 50.0))).iter().all(|shown| shown.0 == 0.0));
    }

    #[test]
    fn reinforcement_goes_with_the_output() {
        let path = [50.0, 50.4, 50.6, 51.0, 50.7, 50.4, 50.0];
        let shown = run(Push::Reinforcement, path.into_iter().map(|u| sample(1.0, u)));
        let u_ff: Vec<f64> = shown.iter().map(|shown| shown.0).collect();
        assert_eq!(u_ff, [0.0, 0.0, 2.0, 2.0, 2.0, -2.0, -2.0]);
    }

    #[test]
    fn what_is_lost_takes_it_away() {
        let lost = [(BAD, Standing::BadQuality), (AT_LOW, Standing::AtLimit), (NOT_AUTO, Standing::NotAuto)];
        for (flags, standing) in lost {
            let mut samples: Vec<_> = (0..4).map(|i| sample(1.0, 50.0 + f64::from(i))).collect();
            samples.extend((0..6).map(|_| StictionSample { flags, ..sample(1.0, 53.0) }));
            let shown = run(Push::Reinforcement, samples.into_iter());
            assert_eq!(shown[3], (2.0, Standing::Active));
            let after: Vec<f64> = shown[4..].iter().map(|shown| shown.0).collect();
            let expected = if flags == NOT_AUTO { [0.0; 6] } else { [1.5, 1.0, 0.5, 0.0, 0.0, 0.0] };
            assert_eq!((after, shown[4].1), (expected.to_vec(), standing));
        }
    }

    #[test]
    fn a_budget_withdraws_it() {
        let block = Stiction::new(StictionSettings { travel: 20.0, ..settings(Push::Knocker) }).unwrap();
        let mut state = StictionState::default();
        let mut standings = Vec::new();
        for i in 0..40 {
            block.update(&mut state, &sample(1.0, 50.0 + f64::from(i)));
            standings.push(state.standing);
        }
        assert!(standings.contains(&Standing::Active) && standings[39] == Standing::TooMuchTravel);
        block.update(&mut state, &StictionSample { enable: false, ..sample(1.0, 90.0) });
        assert_eq!(state.standing, Standing::NotEnabled);
    }

    #[test]
    fn a_loop_that_swings_more_withdraws_it() {
        let block = Stiction::new(StictionSettings { watch: 600.0, ..settings(Push::Reinforcement) }).unwrap();
        let mut state = StictionState::default();
        for i in 0..4000 {
            let enable = i > 1500;
            let side = if (i / 20) % 2 == 0 { 1.0 } else { -1.0 };
            let e = if enable { 2.0 * side } else { side };
            block.update(&mut state, &StictionSample { enable, ..sample(e, 50.0 + side) });
        }
        assert_eq!(state.standing, Standing::Worse);
    }

    #[test]
    fn what_is_out_of_bounds_is_named() {
        type Spoil = fn(&mut StictionSettings<f64>);
        let all: [(&str, Spoil); 12] = [
            ("k", |s| s.k = 0.0),
            ("ti", |s| s.ti = -1.0),
            ("size", |s| s.size = -1.0),
            ("limit", |s| s.limit = 1.0),
            ("hold", |s| s.hold = 0.0),
            ("period", |s| s.period = 1.9),
            ("band", |s| s.band = f64::NAN),
            ("far", |s| s.far = -0.1),
            ("rate", |s| s.rate = 0.0),
            ("release", |s| s.release = 101.0),
            ("travel", |s| s.travel = 0.0),
            ("watch", |s| s.watch = 2e6),
        ];
        for (name, spoil) in all {
            let mut spoilt = settings(Push::Knocker);
            spoil(&mut spoilt);
            assert_eq!(Stiction::new(spoilt).unwrap_err().name, name);
        }
    }

    proptest! {
        /// However it is driven, u_FF stays within its height, and moves by no more than its rate while it is in force.
        #[test]
        fn it_stays_within_its_height_and_rate(
            push in 0_usize..3,
            path in prop::collection::vec((-3.0..3.0, -3.0..3.0, 0_u16..16, any::<bool>()), 1..200),
        ) {
            let set = StictionSettings { rate: 0.7, ..settings(Push::ALL[push]) };
            let (block, mut state) = (Stiction::new(set).unwrap(), StictionState::default());
            let mut before = 0.0;
            for (e, u, flags, enable) in path {
                let u_ff = block.update(&mut state, &StictionSample { e, u: 50.0 + u, h: 1.0, enable, flags });
                prop_assert!(u_ff.abs() <= 2.0);
                if state.standing == Standing::Active {
                    prop_assert!((u_ff - before).abs() <= 0.7 + 1e-12);
                }
                before = u_ff;
            }
        }
    }
}
