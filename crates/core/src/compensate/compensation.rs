//! Compensation of a gap: a signal added to the controller's output so that the valve follows it.

use super::harm::{Harm, HarmState};
use crate::detect::zero_crossing::sign_of;
use crate::error::require;
use crate::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO, Status};
use crate::{ParameterError, Real, Saturation, SecondOrderFilter, SecondOrderFilterState, Sum};

/// A longer time between samples is none \[s\].
pub(super) const LONGEST: f64 = 1e9;
/// No rate, budget or width is so large; every controller can write it.
pub(super) const NO_LIMIT: f64 = 1e37;
/// The longest release \[Ti\], and \[s\]: no setting leaves u_FF in a plant for longer.
const LONGEST_RELEASE: (f64, f64) = (10.0, 300.0);
/// The longest time over which the loop is compared \[Ti\].
pub(super) const LONGEST_WATCH: f64 = 1e5;

/// The longest that any release may take \[s\].
pub(super) fn longest_release<R: Real>(ti: R) -> R {
    let (shares, longest) = LONGEST_RELEASE;
    (R::of(shares) * ti).lesser(R::of(longest))
}

/// The release where nobody says which: Ti, or the longest where that is shorter \[s\].
pub(super) fn usual_release<R: Real>(ti: R) -> R {
    ti.lesser(R::of(LONGEST_RELEASE.1))
}

/// Refills an account: half of the budget of an hour is there at any moment.
#[inline(always)]
pub(super) fn repay<R: Real>(spent: &mut R::Sum, budget: R, h: R) {
    spent.add(-(budget * (h / R::of(7200.0))));
    if spent.value() < R::ZERO {
        *spent = R::Sum::default();
    }
}

named! {
    /// Method that finds the direction in which the valve is driven (thesis 2.2).
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[repr(u8)]
    pub enum Way {
        /// sign(e)·sign(K): the thesis' own. Jumps whenever the filtered error crosses zero, noise or not.
        Error = 1 => "error",
        /// sign(du_f/dt): the inverse of the gap, of the filtered output. Chatters wherever u_f does.
        Derivative = 2 => "derivative",
        /// The inverse with a noise band: a reversal counts once u_f has gone back by `band` from where it was farthest.
        Inverse = 3 => "inverse",
    }
}

impl Way {
    /// The longest delay of u_FF with which it may be enabled, as a share of Ti; one scan always may. Measured on four thousand
    /// random loops with u_FF 1, 3 and 10 scans late (`bench/compensation.py`): the longest without more harm than at one scan.
    pub const fn longest_delay(self) -> f64 {
        match self {
            Self::Error | Self::Inverse => 0.2,
            Self::Derivative => 0.0,
        }
    }
}

named! {
    /// Source of the width that a [`Compensation`] takes its share of (thesis 6.4).
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[repr(u8)]
    pub enum Source {
        /// A person typed it.
        #[default]
        Typed = 1 => "typed",
        /// The lower limit of a fit whose verdict is backlash.
        Fitted = 2 => "fitted",
        /// The on-line estimate as it was when compensation was enabled.
        Estimate = 3 => "estimate",
    }
}

named! {
    /// State of a [`Compensation`]: active, or the reason why it is not. The first that holds, in this order.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[repr(u8)]
    pub enum Standing {
        /// Compensation is active.
        Active = 0 => "active",
        /// Nobody has enabled it.
        #[default]
        NotEnabled = 1 => "not_enabled",
        /// The controller is not in automatic.
        NotAuto = 2 => "not_auto",
        /// A value is bad or not a number, or communication is lost.
        BadQuality = 3 => "bad_quality",
        /// Withdrawn: the valve is driven back and forth by it. Holds until it is enabled anew.
        OverCompensated = 4 => "over_compensated",
        /// Withdrawn: more reversals than the budget allows. Holds until it is enabled anew.
        TooManyReversals = 5 => "too_many_reversals",
        /// Withdrawn: more travel than the budget allows. Holds until it is enabled anew.
        TooMuchTravel = 6 => "too_much_travel",
        /// The on-line estimate was there and is gone.
        EstimateLost = 7 => "estimate_lost",
        /// Something in the loop is at a limit, or OP is so near one that there is no room.
        AtLimit = 8 => "at_limit",
        /// No width is left to compensate: the size is 0, or no wider than the noise band.
        TooSmall = 9 => "too_small",
        /// All is well: it comes in with the next reversal.
        Waiting = 10 => "waiting",
        /// Withdrawn: PV is farther from SP, or OP turns more often, than before. Holds until it is enabled anew.
        Worse = 11 => "worse",
        /// u_FF comes too late for this controller: see [`Way::longest_delay`].
        TooLate = 12 => "too_late",
        /// Withdrawn: the u_FF that is read back is not the one that was handed over. Holds until it is enabled anew.
        NotFollowed = 13 => "not_followed",
        /// The on-line estimate is the source, and could not be compensated by when it was enabled. Holds until it is enabled anew.
        NoEstimate = 14 => "no_estimate",
    }
}

/// Settings of a [`Compensation`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CompensationSettings<R> {
    /// Method that finds the direction.
    pub way: Way,
    /// Gain K ≠ 0 of the controller, negative for direct action. Only its sign counts, and only for [`Way::Error`]: OP
    /// itself carries it already.
    pub k: R,
    /// Integral time Ti > 0 of the controller \[s\], by which [`bounds`](Self::bounds) go.
    pub ti: R,
    /// Source of the width.
    pub source: Source,
    /// Width that a person typed, or the lower limit of the fit where its verdict is backlash; 0 or greater [OP unit]. Not used by
    /// [`Source::Estimate`].
    pub size: R,
    /// Share of it to compensate, 0 to 1.
    pub share: R,
    /// Greatest width that may be compensated, whatever the size came from \[OP unit\].
    pub limit: R,
    /// Distance that u_f must go back to count as a reversal, for [`Way::Inverse`]; 0 or greater [OP unit]. With
    /// [`Source::Estimate`] it is at least a fifth of the estimate.
    pub band: R,
    /// Time constant of the second-order filter of u, 0 or greater \[s\]; not used by [`Way::Error`].
    pub tf: R,
    /// Greatest rate of u_FF > 0 [OP unit per s].
    pub rate: R,
    /// Shortest time from side to side with [`Source::Estimate`], 0 or greater \[s\]: the rate of a width that nobody
    /// knows yet.
    pub ramp_time: R,
    /// Time over which it is taken away > 0 \[s\].
    pub release: R,
    /// Budget: travel of u_FF in any hour > 0 [OP unit].
    pub travel: R,
    /// Budget: changes of its direction in any hour, 2 or more.
    pub reversals: R,
    /// Time over which the loop is compared with its state before > 0 \[s\]; three hundred Ti and more.
    pub watch: R,
    /// Whether a warning of over-compensation, and a loop that is worse than before, withdraw it.
    pub withdraw: bool,
    /// Whether the on-line estimate may make the size smaller.
    pub estimate: bool,
    /// Whether a fit contradicts the detections: their estimate is no source.
    pub contradicted: bool,
    /// Limits of OP [OP unit].
    pub limits: Saturation<R>,
}

impl<R: Real> CompensationSettings<R> {
    /// Defaults for a controller with gain `k` and integral time `ti` \[s\] and a `share` of the width `size`: no more than that width; a
    /// noise band of a fifth of it; the inverse goes from side to side in Ti/10, the other ways jump; no filter; taken away within
    /// Ti, or 300 s where that is shorter; the loop is compared over 300 Ti, and compensation withdrawn where that, or a warning, asks for it; the estimate may
    /// make the size smaller; no budgets, no limits.
    pub fn new(way: Way, k: R, ti: R, size: R, share: R) -> Self {
        let ten = R::of(10.0);
        let delta = share * size;
        Self {
            way,
            k,
            ti,
            source: Source::Typed,
            size,
            share,
            limit: size,
            band: size / R::of(5.0),
            tf: R::ZERO,
            rate: if way == Way::Inverse && delta > R::ZERO { ten * delta / ti } else { R::of(NO_LIMIT) },
            ramp_time: if way == Way::Inverse { ti / ten } else { R::ZERO },
            release: usual_release(ti),
            travel: R::of(NO_LIMIT),
            reversals: R::of(NO_LIMIT),
            watch: R::of(300.0) * ti,
            withdraw: true,
            estimate: true,
            contradicted: false,
            limits: Saturation::none(),
        }
    }

    /// Defaults for a `share` of the on-line estimate as it is when compensation is enabled; before that there is no width. Band and
    /// time from side to side are those of [`new`](Self::new) for that estimate; no greatest width.
    pub fn by_estimate(way: Way, k: R, ti: R, share: R) -> Self {
        let none = Self::new(way, k, ti, R::ZERO, share);
        Self { source: Source::Estimate, limit: R::of(NO_LIMIT), ..none }
    }

    /// The longest that any release may take, and any rate may make it: 10 Ti, and no more than 300 s.
    pub fn longest_release(&self) -> R {
        longest_release(self.ti)
    }

    /// The bounds of each setting that is a number, by the others as they are, in the order in which they are checked.
    ///
    /// ```
    /// use glapp_core::{CompensationSettings, Way};
    ///
    /// let settings = CompensationSettings::new(Way::Inverse, 1.0, 8.0, 2.0, 1.0);
    /// let [.., release, _, _, _, _, _] = settings.bounds();
    /// assert_eq!((release.name, release.unit, release.high), ("release", "s", 80.0)); // 10 Ti
    /// ```
    pub fn bounds(&self) -> [Bound<R>; 12] {
        let (zero, one, none) = (R::ZERO, R::ONE, R::of(NO_LIMIT));
        let two = one + one;
        let range = self.limits.range();
        let widest = if self.limit == none { none } else { range };
        let ten = R::of(LONGEST_RELEASE.0) * self.ti;
        let of = |name, unit, value, low, high, words| Bound { name, unit, value, low, high, above: false, words };
        let above = |name, unit, value, high, words| Bound { above: true, ..of(name, unit, value, zero, high, words) };
        [
            above("ti", "s", self.ti, R::of(LONGEST), "greater than 0 s, at most 1e9 s"),
            of("size", "OP unit", self.size, zero, range, "0 or greater, at most OP's range"),
            of("share", "1", self.share, zero, one, "between 0 and 1"),
            of(
                "limit",
                "OP unit",
                self.limit,
                self.share * self.size,
                widest,
                "at least share·size, at most OP's range; 1e37: none",
            ),
            of("band", "OP unit", self.band, zero, range, "0 or greater, at most OP's range"),
            above("rate", "OP unit/s", self.rate, none, "greater than 0 per second, at most 1e37: none"),
            above(
                "release",
                "s",
                self.release,
                self.longest_release(),
                "greater than 0 s, at most 10 Ti and at most 300 s",
            ),
            of("ramp_time", "s", self.ramp_time, zero, ten, "0 s or greater, at most 10 Ti"),
            above("travel", "OP unit/h", self.travel, none, "greater than 0 in an hour, at most 1e37: none"),
            of("reversals", "1/h", self.reversals, two, none, "2 or greater in an hour, at most 1e37: none"),
            above("watch", "s", self.watch, R::of(LONGEST_WATCH) * self.ti, "greater than 0 s, at most 1e5 Ti"),
            of("tf", "s", self.tf, zero, ten, "0 s or greater, at most 10 Ti"),
        ]
    }
}

/// The bounds of a setting: `low` ≤ value ≤ `high`, or `low` < value where it must be `above`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound<R> {
    /// Name.
    pub name: &'static str,
    /// Unit; 1 where it has none.
    pub unit: &'static str,
    /// Present value.
    pub value: R,
    /// The least.
    pub low: R,
    /// The greatest.
    pub high: R,
    /// Whether the least itself is out.
    pub above: bool,
    /// Name and unit in words.
    pub words: &'static str,
}

impl<R: Real> Bound<R> {
    /// Checks the value against its bounds.
    fn check(&self) -> Result<(), ParameterError> {
        let enough = if self.above { self.value > self.low } else { self.value >= self.low };
        require(self.name, self.value, enough && self.value <= self.high, self.words).map(|_| ())
    }
}

/// One sample for a [`Compensation`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CompensationSample<R> {
    /// Control error e = ysp − yf [PV unit].
    pub e: R,
    /// Output of the controller without u_FF; in manual, OP itself [OP unit].
    pub u: R,
    /// Time since the sample before \[s\].
    pub h: R,
    /// On-line estimate of the whole gap, where there is one: the detector's, which shows the part that is left, and
    /// the size that was in force while it was made [OP unit].
    pub d_hat: Option<R>,
    /// Estimate that may be compensated by: it is a source.
    pub offered: Option<R>,
    /// Whether over-compensation is warned of.
    pub over: bool,
    /// Whether a person wants it on.
    pub enable: bool,
    /// Obstacle that only the caller who hands on u_FF can see: [`Standing::TooLate`], [`Standing::NotFollowed`].
    pub hindered: Option<Standing>,
    /// [`NOT_AUTO`], [`BAD`], [`AT_LOW`], [`AT_HIGH`]; 0 = all well.
    pub flags: Status,
}

impl<R: Real> CompensationSample<R> {
    fn offered(&self) -> Option<R> {
        self.offered.filter(|offered| offered.is_measurable())
    }
}

/// Feed-forward that carries the valve through its gap whenever it is reversed (thesis 2.2, 7.4).
///
/// ```text
/// u = u_FB + u_FF,     u_FF → δ/2·s     by at most rate·h a sample
///
///   s = sign(e)·sign(K)      Error         δ = share·size
///   s = sign(du_f/dt)        Derivative    δ = share·size
///   s = side of u_f          Inverse       δ = share·size − band
/// ```
///
/// The size is that of its [`Source`]: what a person typed, the lower limit of a fit, or the on-line estimate as it was when
/// compensation was enabled, if it could be compensated by then. share·size is at most `limit`.
///
///
/// The side of u_f is up until u_f has fallen by more than `band` below its highest since it was last down, and the other way
/// round. By then u_FB itself has gone `band` of the way, which therefore is taken off: what the controller sees is a
/// mere gap of width d − δ, and never a slip. With the full size it would be a valve that sticks by `band` and jumps by as
/// much.
///
/// It comes in with a reversal, when the valve has to go through its gap anyway: sooner, it would push the valve on by δ/2.
///
/// It is taken away within `release` seconds (or |u_FF|/rate, where that is longer, but never longer than 10 Ti or 300 s) when
/// nobody wants it any more, on a bad value, at a limit, when the estimate is lost, and when it is withdrawn: OP goes back into the
/// gap, where the valve stands. In
/// manual u_FF is 0 at once: OP is the operator's, and a controller that tracks all of OP gives it back without a bump.
///
/// The on-line estimate can make the size smaller, where the settings let it, and it stays smaller until it is enabled anew; it
/// never makes it larger.
///
/// Where the loop is worse than before it was enabled, in PV's distance from SP or in OP's reversals by more than size/10, it
/// is withdrawn until it is enabled anew.
///
/// The budgets are kept by two accounts, each of half a budget, that fill up again within an hour: so no hour sees more than
/// the whole, nor a minute more than the half. Before every reversal, the way there and the way back to 0 must be left, or
/// it is withdrawn. In manual u_FF takes part in neither.
///
/// A sample that is no number, or beyond 10³⁰ (`f32`: 10¹²), counts as bad, and an estimate that is so as none to compensate by; a step
/// h that is not above 0, or above 10⁹ s, changes nothing but how it stands.
///
/// ```
/// use glapp_core::{Compensation, CompensationSample, CompensationSettings, CompensationState, Saturation, Way};
///
/// let inverse = Compensation::new(CompensationSettings {
///     limit: 5.0, band: 0.5, rate: 1.0, release: 1.0, limits: Saturation::new(0.0, 100.0)?,
///     ..CompensationSettings::new(Way::Inverse, 1.0, 30.0, 2.0, 1.0)
/// })?;
/// let mut state = CompensationState::default();
/// let mut update = |u| {
///     let sample = CompensationSample { u, h: 1.0, enable: true, ..CompensationSample::default() };
///     inverse.update(&mut state, &sample)
/// };
/// assert_eq!([50.0, 50.6, 50.2].map(&mut update), [0.0, 0.0, 0.0]); // up, and not yet back by more than 0.5
/// assert_eq!([50.0, 49.9].map(&mut update), [-0.75, -0.75]); // δ/2 = (2 − 0.5)/2
/// assert_eq!([50.5, 50.6].map(&mut update), [0.25, 0.75]); // to the other side, at 1 a second
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensation<R> {
    settings: CompensationSettings<R>,
    longest: R,
    filter: SecondOrderFilter<R>,
    harm: Harm<R>,
}

/// State of a [`Compensation`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CompensationState<R: Real> {
    filter: SecondOrderFilterState<R>,
    harm: HarmState<R>,
    /// Lowest and highest u_f since the last reversal.
    low: R,
    high: R,
    /// Direction in which the valve is driven: +1 or −1; 0 while unknown.
    pub direction: i8,
    /// The side that u_FF was last sent to: +1 or −1.
    side: i8,
    /// Whether it compensates.
    in_force: bool,
    /// Why it was withdrawn until it is enabled anew.
    withdrawn: Option<Standing>,
    /// Half of the width in force now [OP unit].
    pub half: R::Sum,
    /// Size at the beginning of the decrease.
    whole: R,
    /// Feed-forward added to OP [OP unit].
    pub u_ff: R::Sum,
    /// The smallest on-line estimate since it was enabled [OP unit].
    pub d_hat: Option<R>,
    /// The on-line estimate when it was enabled, where that is the source [OP unit].
    pressed: R,
    /// The estimate was unfit to compensate by.
    unfit: bool,
    /// The width of the gap that it goes by [OP unit].
    pub size: R,
    /// δ: share·size less the noise band [OP unit].
    pub delta: R,
    /// Travel that counts against the budget, which an hour takes off again [OP unit].
    pub travel: R::Sum,
    /// Reversals that count against the budget.
    pub reversals: R::Sum,
    /// State: active, or the reason why it is not.
    pub standing: Standing,
}

impl<R: Real> CompensationState<R> {
    /// The width that stays uncompensated while it is in force: the rest of the share, and the noise band [OP unit].
    pub fn left(&self) -> R {
        (self.size - self.delta).greater(R::ZERO)
    }

    /// Goes on from the u_FF that is in effect, of which nothing is known: it is taken away.
    pub(crate) fn begin_at(&mut self, u_ff: R) {
        let half = u_ff.magnitude();
        (self.u_ff, self.half, self.whole) = (u_ff.into(), half.into(), half);
        (self.side, self.in_force) = (if u_ff < R::ZERO { -1 } else { 1 }, false);
    }
}

impl<R: Real> Compensation<R> {
    /// Checks the settings.
    pub fn new(settings: CompensationSettings<R>) -> Result<Self, ParameterError> {
        let s = &settings;
        require("k", s.k, s.k != R::ZERO, "a number other than 0")?;
        for bound in s.bounds() {
            bound.check()?;
        }
        let harm = Harm { watch: s.watch, band: s.size / R::of(10.0) };
        Ok(Self { settings, longest: s.longest_release(), filter: SecondOrderFilter::new(s.tf)?, harm })
    }

    /// The settings of this block.
    pub fn settings(&self) -> &CompensationSettings<R> {
        &self.settings
    }

    /// Takes one sample; gives u_FF, which is to be added to u before OP's limits [OP unit].
    #[inline(always)]
    pub fn update(&self, state: &mut CompensationState<R>, sample: &CompensationSample<R>) -> R {
        let s = &self.settings;
        let bad = sample.flags & BAD != 0 || !sample.e.is_measurable() || !sample.u.is_measurable();
        let timed = sample.h > R::ZERO && sample.h <= R::of(LONGEST);
        let before = state.direction;
        if sample.enable && state.standing == Standing::NotEnabled {
            state.unfit = sample.offered().is_none();
            state.pressed = sample.offered().unwrap_or(state.pressed);
        }
        if timed {
            self.repay(state, sample.h);
            if !bad {
                self.look(state, sample);
            }
        }
        let reversed = before != 0 && state.direction != before;
        let d_hat = sample.d_hat.filter(|d_hat| s.estimate && d_hat.is_number());
        let goal = self.goal(state, sample, d_hat);
        let mut standing = self.standing(state, sample, d_hat, bad, goal);
        if standing == Standing::Active && reversed {
            standing = self.pay(state, goal);
        } else if standing == Standing::Active && !state.in_force {
            standing = Standing::Waiting;
        }
        state.in_force = standing == Standing::Active;
        state.standing = standing;
        if standing == Standing::NotAuto {
            (state.half, state.u_ff) = (R::Sum::default(), R::Sum::default());
            (state.whole, state.side) = (R::ZERO, 0);
        } else if timed {
            let goal = if state.in_force { goal } else { R::ZERO };
            let mut rate = self.rate(state);
            if !state.in_force {
                // However slow the rate is by now, and however far u_FF lags behind; it never grows on its way.
                let u_ff = state.u_ff.value();
                state.whole = state.whole.greater(u_ff.magnitude());
                rate = rate.greater(state.whole / self.longest);
                let on_its_side = if state.side < 0 { -u_ff } else { u_ff };
                if state.half.value() > on_its_side {
                    state.half = on_its_side.greater(R::ZERO).into();
                }
            }
            state.half.add(-(state.whole / s.release * sample.h));
            if state.half.value() <= goal {
                state.half = goal.into();
                if state.in_force {
                    state.whole = goal;
                }
            }
            let half = state.half.value();
            let old = state.u_ff;
            state.u_ff.approach(if state.side < 0 { -half } else { half }, rate * sample.h);
            state.travel.add(state.u_ff.since(old).magnitude());
            self.compare(state, sample);
        }
        state.u_ff.value()
    }

    /// Compares the loop with its state before it was enabled.
    #[inline(always)]
    fn compare(&self, state: &mut CompensationState<R>, sample: &CompensationSample<R>) {
        let since = state.in_force;
        let by_estimate = self.settings.source == Source::Estimate;
        let harm = if by_estimate { Harm { band: state.pressed / R::of(10.0), ..self.harm } } else { self.harm };
        let unknown = by_estimate && state.pressed <= R::ZERO;
        if !since
            && (state.standing != Standing::NotEnabled
                || sample.flags != 0
                || unknown
                || !(sample.e + sample.u).is_measurable())
        {
            return match state.standing {
                Standing::NotEnabled => harm.begin(&mut state.harm, false),
                _ => harm.interrupt(&mut state.harm),
            };
        }
        let worse = harm.update(&mut state.harm, sample.e, sample.u + state.u_ff.value(), sample.h, since);
        if worse && self.settings.withdraw && state.withdrawn.is_none() {
            state.withdrawn = Some(Standing::Worse);
        }
    }

    /// Lets the accounts fill up again.
    #[inline(always)]
    fn repay(&self, state: &mut CompensationState<R>, h: R) {
        repay(&mut state.travel, self.settings.travel, h);
        repay(&mut state.reversals, self.settings.reversals, h);
    }

    /// Finds the direction in which the valve is driven.
    #[inline(always)]
    fn look(&self, state: &mut CompensationState<R>, sample: &CompensationSample<R>) {
        let s = &self.settings;
        if s.way == Way::Error {
            state.direction =
                if s.k < R::ZERO { sign_of(-sample.e, state.direction) } else { sign_of(sample.e, state.direction) };
            return;
        }
        let begun = state.filter.started;
        let u = self.filter.update(&mut state.filter, sample.u, sample.h);
        if !begun {
            (state.low, state.high) = (u, u);
        }
        state.low = state.low.lesser(u);
        state.high = state.high.greater(u);
        let band = self.band(state);
        if state.direction <= 0 && u - state.low > band {
            (state.direction, state.low, state.high) = (1, u, u);
        } else if state.direction >= 0 && state.high - u > band {
            (state.direction, state.low, state.high) = (-1, u, u);
        }
    }

    /// The width that the source gives.
    #[inline(always)]
    pub(crate) fn width(&self, state: &CompensationState<R>) -> R {
        if self.settings.source == Source::Estimate { state.pressed } else { self.settings.size }
    }

    /// The noise band that counts as a reversal.
    #[inline(always)]
    fn band(&self, state: &CompensationState<R>) -> R {
        let s = &self.settings;
        match (s.way, s.source) {
            (Way::Inverse, Source::Estimate) => s.band.greater(state.pressed / R::of(5.0)),
            (Way::Inverse, _) => s.band,
            _ => R::ZERO,
        }
    }

    /// The rate of u_FF.
    #[inline(always)]
    fn rate(&self, state: &CompensationState<R>) -> R {
        let s = &self.settings;
        let delta = s.share * state.pressed;
        if s.source == Source::Estimate && s.ramp_time > R::ZERO && delta > R::ZERO {
            s.rate.lesser(delta / s.ramp_time)
        } else {
            s.rate
        }
    }

    /// Half of the width to compensate.
    #[inline(always)]
    fn goal(&self, state: &mut CompensationState<R>, sample: &CompensationSample<R>, d_hat: Option<R>) -> R {
        let s = &self.settings;
        if !sample.enable {
            state.d_hat = None;
            // The value it would have if it were enabled now.
            state.pressed =
                if state.u_ff.value() == R::ZERO { sample.offered().unwrap_or(R::ZERO) } else { state.pressed };
        } else if let Some(d_hat) = d_hat {
            state.d_hat = Some(state.d_hat.map_or(d_hat, |least| least.lesser(d_hat)));
        }
        let size = self.width(state);
        state.size = state.d_hat.map_or(size, |d_hat| size.lesser(d_hat));
        state.delta = ((s.share * state.size).lesser(s.limit) - self.band(state)).greater(R::ZERO);
        state.delta / R::of(2.0)
    }

    /// Compensation state at this sample: the first cause why u_FF is not in force, else active.
    #[inline(always)]
    fn standing(
        &self,
        state: &mut CompensationState<R>,
        sample: &CompensationSample<R>,
        d_hat: Option<R>,
        bad: bool,
        goal: R,
    ) -> Standing {
        let limits = &self.settings.limits;
        if !sample.enable {
            state.withdrawn = None;
        } else if sample.over && self.settings.withdraw && state.withdrawn.is_none() {
            state.withdrawn = Some(Standing::OverCompensated);
        } else if sample.hindered == Some(Standing::NotFollowed) && state.withdrawn.is_none() {
            state.withdrawn = sample.hindered;
        }
        if !sample.enable {
            Standing::NotEnabled
        } else if sample.flags & NOT_AUTO != 0 {
            Standing::NotAuto
        } else if bad {
            Standing::BadQuality
        } else if let Some(withdrawn) = state.withdrawn {
            withdrawn
        } else if let Some(hindered) = sample.hindered {
            hindered
        } else if self.settings.source == Source::Estimate && state.unfit {
            Standing::NoEstimate
        } else if state.d_hat.is_some() && d_hat.is_none() {
            Standing::EstimateLost
        } else if sample.flags & (AT_LOW | AT_HIGH) != 0
            || sample.u - goal < limits.low
            || sample.u + goal > limits.high
        {
            Standing::AtLimit
        } else if goal <= R::ZERO {
            Standing::TooSmall
        } else {
            Standing::Active
        }
    }

    /// Takes a move to the other side off the accounts; withdraws it where they do not suffice.
    #[inline(always)]
    fn pay(&self, state: &mut CompensationState<R>, goal: R) -> Standing {
        let s = &self.settings;
        let two = R::of(2.0);
        let u_ff = state.u_ff.value();
        let moves = if u_ff == R::ZERO || state.side == state.direction { R::ZERO } else { R::ONE };
        // Travel to the goal, and from it back to 0.
        let way = u_ff.magnitude() + two * goal;
        if (state.reversals.value() + moves) * two > s.reversals {
            state.withdrawn = Some(Standing::TooManyReversals);
        } else if (state.travel.value() + way) * two > s.travel {
            state.withdrawn = Some(Standing::TooMuchTravel);
        } else {
            state.reversals.add(moves);
            state.side = state.direction;
        }
        state.withdrawn.unwrap_or(Standing::Active)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn settings_of<R: Real>(way: Way) -> CompensationSettings<R> {
        CompensationSettings {
            way,
            k: R::of(1.0),
            ti: R::of(30.0),
            source: Source::Typed,
            size: R::of(2.0),
            share: R::of(1.0),
            limit: R::of(5.0),
            band: R::of(0.5),
            tf: R::of(0.0),
            rate: R::of(1e6),
            ramp_time: R::of(0.0),
            release: R::of(1.0),
            watch: R::of(1e6),
            travel: R::of(1e6),
            reversals: R::of(1e6),
            withdraw: true,
            estimate: true,
            contradicted: false,
            limits: Saturation::new(R::of(-100.0), R::of(100.0)).unwrap(),
        }
    }

    fn settings(way: Way) -> CompensationSettings<f64> {
        settings_of(way)
    }

    fn sample(e: f64, u: f64) -> CompensationSample<f64> {
        CompensationSample { e, u, h: 1.0, enable: true, ..CompensationSample::default() }
    }

    /// A block in force at +δ/2.
    fn active(settings: CompensationSettings<f64>) -> (Compensation<f64>, CompensationState<f64>) {
        let block = Compensation::new(settings).unwrap();
        let mut state = CompensationState::default();
        for (e, u) in [(1.0, 4.0), (-1.0, 1.0), (1.0, 2.0)] {
            block.update(&mut state, &sample(e, u));
        }
        assert_eq!((state.standing, state.direction), (Standing::Active, 1));
        (block, state)
    }

    #[test]
    fn settings_out_of_bounds_are_named() {
        let base = settings(Way::Inverse);
        type Change = fn(&mut CompensationSettings<f64>);
        let cases: [(&str, Change); 22] = [
            ("k", |s| s.k = 0.0),
            ("ti", |s| s.ti = 0.0),
            ("ti", |s| s.ti = 1.1e9),
            ("size", |s| s.size = 200.1),
            ("limit", |s| s.limit = 200.1),
            ("band", |s| s.band = 200.1),
            ("tf", |s| s.tf = 300.1),
            ("ramp_time", |s| s.ramp_time = 300.1),
            ("release", |s| s.release = 300.1),
            ("release", |s| (s.ti, s.release) = (0.5, 5.1)),
            ("watch", |s| s.watch = 3.1e6),
            ("size", |s| s.size = -0.1),
            ("size", |s| s.size = f64::NAN),
            ("share", |s| s.share = 1.1),
            ("limit", |s| s.limit = 1.9),
            ("band", |s| s.band = -1.0),
            ("tf", |s| s.tf = -1.0),
            ("rate", |s| s.rate = 0.0),
            ("rate", |s| s.rate = f64::INFINITY),
            ("release", |s| s.release = 0.0),
            ("travel", |s| s.travel = 0.0),
            ("reversals", |s| s.reversals = 1.0),
        ];
        for (name, change) in cases {
            let mut changed = base;
            change(&mut changed);
            assert_eq!(Compensation::new(changed).unwrap_err().name, name);
        }
    }

    #[test]
    fn each_bound_is_allowed_and_what_is_beyond_it_is_not() {
        let base = settings(Way::Inverse);
        let set = |name: &str, value: f64| {
            let mut s = base;
            *match name {
                "ti" => &mut s.ti,
                "size" => &mut s.size,
                "share" => &mut s.share,
                "limit" => &mut s.limit,
                "band" => &mut s.band,
                "rate" => &mut s.rate,
                "release" => &mut s.release,
                "ramp_time" => &mut s.ramp_time,
                "travel" => &mut s.travel,
                "reversals" => &mut s.reversals,
                "watch" => &mut s.watch,
                "tf" => &mut s.tf,
                other => panic!("{other} is new: which field is it?"),
            } = value;
            s
        };
        for bound in base.bounds() {
            let refused = |value| {
                let made = Compensation::new(set(bound.name, value));
                made.err().is_some_and(|error| error.name == bound.name && error.bound == bound.words)
            };
            let step = |x: f64, by: f64| x + by * (x.abs() * 1e-15 + 1e-300);
            // A parameter that bounds others moves their bounds with it.
            let moves = ["ti", "size"].contains(&bound.name);
            assert!(moves || !refused(bound.high), "{bound:?}");
            assert!(refused(step(bound.high, 1.0)), "{bound:?}");
            assert!(moves || refused(bound.low) == bound.above, "{bound:?}");
            assert!(refused(step(bound.low, -1.0)), "{bound:?}");
            for value in [f64::NAN, f64::INFINITY, -1.0] {
                assert!(refused(value), "{} = {value}", bound.name);
            }
        }
    }

    #[test]
    fn nothing_before_it_is_enabled() {
        let block = Compensation::new(settings(Way::Error)).unwrap();
        let mut state = CompensationState::default();
        for e in [1.0, -1.0, 1.0] {
            assert_eq!(block.update(&mut state, &CompensationSample { enable: false, ..sample(e, 0.0) }), 0.0);
            assert_eq!(state.standing, Standing::NotEnabled);
        }
    }

    #[test]
    fn sign_of_k_turns_the_error_and_nothing_else() {
        for (way, turned) in [(Way::Error, -1.0), (Way::Derivative, 1.0), (Way::Inverse, 1.0)] {
            let (one, other) = (settings(way), CompensationSettings { k: -3.0, ..settings(way) });
            let last = |settings| active_or_not(settings, 1.0).u_ff;
            assert_eq!(last(one) * turned, last(other), "{way:?}");
            assert_eq!(last(one).abs(), if way == Way::Inverse { 0.75 } else { 1.0 });
        }
    }

    fn active_or_not(settings: CompensationSettings<f64>, e: f64) -> CompensationState<f64> {
        let block = Compensation::new(settings).unwrap();
        let mut state = CompensationState::default();
        for (e, u) in [(e, 4.0), (-e, 1.0), (e, 2.0), (e, 3.0)] {
            block.update(&mut state, &sample(e, u));
        }
        state
    }

    #[test]
    fn every_loss_takes_it_back_to_zero_with_its_reason() {
        let lost: [(Standing, CompensationSample<f64>); 8] = [
            (Standing::NotEnabled, CompensationSample { enable: false, ..sample(1.0, 3.0) }),
            (Standing::BadQuality, CompensationSample { flags: BAD, ..sample(1.0, 3.0) }),
            (Standing::BadQuality, sample(f64::NAN, 3.0)),
            (Standing::BadQuality, sample(1.0, 1e300)),
            (Standing::OverCompensated, CompensationSample { over: true, ..sample(1.0, 3.0) }),
            (Standing::AtLimit, CompensationSample { flags: AT_LOW, ..sample(1.0, 3.0) }),
            (Standing::AtLimit, sample(1.0, 99.9)),
            (Standing::TooSmall, CompensationSample { d_hat: Some(-0.1), ..sample(1.0, 3.0) }),
        ];
        for way in Way::ALL {
            for (standing, sample) in &lost {
                let (block, mut state) = active(settings(way));
                let full = state.u_ff;
                assert!(full > 0.7);
                // Changed in steps of a tenth of `release`: a ramp, not a jump.
                let shown: Vec<f64> =
                    (0..10).map(|_| block.update(&mut state, &CompensationSample { h: 0.1, ..*sample })).collect();
                assert_eq!(state.standing, *standing);
                assert!(shown[0] > 0.8 * full && shown[4] > 0.0, "{way:?} {standing:?}: {shown:?}");
                assert_eq!((shown[9].abs() < 1e-12, state.u_ff.abs() < 1e-12), (true, true));
            }
        }
    }

    #[test]
    fn manual_takes_it_away_at_once() {
        let (block, mut state) = active(settings(Way::Inverse));
        assert_eq!(block.update(&mut state, &CompensationSample { flags: NOT_AUTO, ..sample(1.0, 2.75) }), 0.0);
        assert_eq!(block.update(&mut state, &sample(1.0, 2.75)), 0.0);
        assert_eq!(state.standing, Standing::Waiting);
        assert_eq!(block.update(&mut state, &sample(1.0, 2.0)), -0.75, "with the next reversal");
    }

    #[test]
    fn an_estimate_that_is_lost_or_smaller() {
        let (block, mut state) = active(settings(Way::Error));
        let mut with = |d_hat| {
            block.update(&mut state, &CompensationSample { d_hat, ..sample(1.0, 2.0) });
            (state.half, state.standing)
        };
        assert_eq!(with(Some(9.0)), (1.0, Standing::Active), "never larger than its size");
        assert_eq!(with(Some(1.0)), (0.5, Standing::Active));
        assert_eq!(with(Some(1.8)), (0.5, Standing::Active), "never larger again");
        assert_eq!(with(None), (0.0, Standing::EstimateLost));
        assert_eq!(with(Some(1.9)), (0.0, Standing::Waiting));
        assert_eq!(with(Some(f64::NAN)).1, Standing::EstimateLost);
        block.update(&mut state, &CompensationSample { enable: false, ..sample(1.0, 2.0) });
        block.update(&mut state, &sample(1.0, 2.0));
        assert_eq!(state.standing, Standing::Waiting, "one that never was there is not lost");
    }

    #[test]
    fn an_estimate_that_is_no_measurement_is_none_to_compensate_by() {
        for (offered, standing) in
            [(2.0, Standing::Waiting), (f64::NAN, Standing::NoEstimate), (1e31, Standing::NoEstimate)]
        {
            let block =
                Compensation::new(CompensationSettings { source: Source::Estimate, ..settings(Way::Inverse) }).unwrap();
            let mut state = CompensationState::default();
            block.update(&mut state, &CompensationSample { offered: Some(offered), ..sample(1.0, 2.0) });
            assert_eq!((state.standing, state.pressed.is_nan()), (standing, false), "{offered}");
        }
    }

    #[test]
    fn a_step_that_is_longer_than_any_moves_nothing() {
        let (block, mut state) = active(settings(Way::Error));
        for h in [1.1e9, f64::INFINITY, f64::NAN] {
            let before = state;
            block.update(&mut state, &CompensationSample { h, ..sample(-1.0, 2.0) });
            assert_eq!(state, before);
        }
    }

    #[test]
    fn withdrawn_until_enabled_anew() {
        let (block, mut state) = active(settings(Way::Error));
        block.update(&mut state, &CompensationSample { over: true, ..sample(1.0, 2.0) });
        for flags in [0, NOT_AUTO, BAD, 0] {
            block.update(&mut state, &CompensationSample { flags, ..sample(1.0, 2.0) });
            assert_eq!(state.u_ff, 0.0);
        }
        assert_eq!(state.standing, Standing::OverCompensated, "a change of mode does not forgive");
        block.update(&mut state, &CompensationSample { enable: false, ..sample(1.0, 2.0) });
        assert_eq!(block.update(&mut state, &sample(-1.0, 2.0)), -1.0);
    }

    #[test]
    fn a_warning_only_warns_where_it_shall_not_withdraw() {
        let (block, mut state) = active(CompensationSettings { withdraw: false, ..settings(Way::Error) });
        block.update(&mut state, &CompensationSample { over: true, ..sample(1.0, 2.0) });
        assert_eq!(state.standing, Standing::Active);
    }

    /// A block whose watch has blocks of one sample, and has seen `before` of them with |e| = 1. OP turns every 20 samples:
    /// u itself before it is enabled, u_FF afterwards.
    fn watched(before: i32) -> impl FnMut(i32, f64) -> Standing {
        let block = Compensation::new(CompensationSettings { watch: 150.0, ..settings(Way::Error) }).unwrap();
        let mut state = CompensationState::default();
        let (mut i, mut enable) = (0, false);
        let mut run = move |n: i32, e: f64| {
            for _ in 0..n {
                let side = f64::from(1 - 2 * (i / 20 % 2));
                let e = side * e * (1.0 + 0.3 * f64::from(i % 3 - 1));
                let u = if enable { 2.0 } else { 2.0 + side };
                block.update(&mut state, &CompensationSample { enable, ..sample(e, u) });
                i += 1;
            }
            enable = true;
            state.standing
        };
        run(before, 1.0);
        run
    }

    #[test]
    fn a_loop_that_is_worse_is_withdrawn_the_sooner_the_worse_it_is() {
        for (e, samples, standing) in [
            (3.0, 9, Standing::Active),
            (3.0, 12, Standing::Worse),
            (1.15, 40, Standing::Active), // not before it is judged
            (1.15, 70, Standing::Worse),
            (1.05, 1000, Standing::Active),
        ] {
            assert_eq!(watched(300)(samples, e), standing, "{e} after {samples}");
        }
    }

    #[test]
    fn a_step_when_it_is_enabled_does_not_withdraw_it() {
        let mut run = watched(300);
        run(10, 20.0);
        assert_eq!(run(1000, 1.0), Standing::Active);
        let mut run = watched(300);
        assert_eq!(run(22, 20.0), Standing::Worse, "what lasts is no step");
    }

    #[test]
    fn nothing_is_compared_with_what_is_not_known() {
        assert_eq!(watched(5)(1000, 9.0), Standing::Active);
    }

    #[test]
    fn a_size_that_is_set_to_zero_while_it_is_in_force_is_ramped_out() {
        for way in Way::ALL {
            let (_, mut state) = active(settings(way));
            let full = state.u_ff;
            let none = Compensation::new(CompensationSettings { size: 0.0, ..settings(way) }).unwrap();
            let shown: Vec<f64> =
                (0..10).map(|_| none.update(&mut state, &CompensationSample { h: 0.1, ..sample(1.0, 3.0) })).collect();
            assert!((shown[0] - 0.9 * full).abs() < 1e-12 && (shown[4] - 0.5 * full).abs() < 1e-12, "{shown:?}");
            assert!(shown[9].abs() < 1e-12, "it stood where it was, with nothing to go by");
            assert_eq!(state.standing, Standing::TooSmall);
        }
    }

    #[test]
    fn removal_does_not_follow_a_reversal_to_the_other_side() {
        let (block, mut state) = active(settings(Way::Error));
        for _ in 0..20 {
            let off = CompensationSample { enable: false, h: 0.1, ..sample(-1.0, 2.0) };
            assert!(block.update(&mut state, &off) >= 0.0);
        }
    }

    #[test]
    fn single_precision_follows() {
        let wide = Compensation::new(settings(Way::Inverse)).unwrap();
        let narrow = Compensation::new(settings_of::<f32>(Way::Inverse)).unwrap();
        let (mut a, mut b) = (CompensationState::default(), CompensationState::default());
        for i in 0_u16..200 {
            let u = f32::from(i % 7) * 0.375; // exact in both
            let x = wide.update(&mut a, &CompensationSample { h: 0.25, ..sample(0.0, u.into()) });
            let y = narrow
                .update(&mut b, &CompensationSample { u, h: 0.25, enable: true, ..CompensationSample::default() });
            assert!((x - f64::from(y)).abs() < 1e-5, "{x} and {y}");
        }
    }

    fn any_way() -> impl Strategy<Value = Way> {
        prop::sample::select(Way::ALL.to_vec())
    }

    fn any_sample() -> impl Strategy<Value = CompensationSample<f64>> {
        let number = || prop_oneof![20 => -3.0..3.0_f64, 1 => Just(f64::NAN), 1 => Just(0.0)];
        (
            number(),
            number(),
            prop_oneof![20 => 0.01..2.0_f64, 1 => Just(0.0), 1 => Just(-1.0)],
            prop::option::weighted(0.3, number()),
            prop::bool::weighted(0.01),
            prop::bool::weighted(0.95),
            prop_oneof![30 => Just(0_u16), 1 => Just(NOT_AUTO), 1 => Just(BAD), 1 => Just(AT_LOW), 1 => Just(AT_HIGH)],
        )
            .prop_map(|(e, u, h, d_hat, over, enable, flags)| CompensationSample {
                e,
                u,
                h,
                d_hat,
                over,
                enable,
                flags,
                ..CompensationSample::default()
            })
    }

    proptest! {
        #[test]
        fn never_beyond_size_rate_and_budgets(
            way in any_way(), k in prop_oneof![-2.0..-0.1_f64, 0.1..2.0_f64], share in 0.0..1.0_f64,
            band in 0.0..1.0_f64, tf in 0.0..2.0_f64, rate in 0.1..20.0_f64, travel in 2.0..60.0_f64,
            reversals in 2.0..40.0_f64, samples in prop::collection::vec(any_sample(), 1..400),
        ) {
            let s = CompensationSettings { k, share, band, tf, rate, travel, reversals, ..settings(way) };
            let block = Compensation::new(s).unwrap();
            let mut state = CompensationState::default();
            let (mut old, mut way_gone, mut turned, mut side) = (0.0_f64, 0.0, 0.0, 0.0);
            for x in &samples {
                let u_ff = block.update(&mut state, x);
                prop_assert!(u_ff.is_finite() && u_ff.abs() <= share * s.size / 2.0 + 1e-12);
                if state.standing != Standing::NotAuto {
                    prop_assert!((u_ff - old).abs() <= rate * x.h.max(0.0) + 1e-12);
                    way_gone += (u_ff - old).abs();
                    if u_ff * side < 0.0 {
                        turned += 1.0;
                    }
                }
                side = if u_ff == 0.0 { side } else { u_ff.signum() };
                if u_ff == 0.0 { side = 0.0; }
                old = u_ff;
            }
            // 400 samples of at most 2 s are less than an hour.
            prop_assert!(way_gone <= travel && turned <= reversals, "{} {}", way_gone, turned);
        }

        #[test]
        fn back_to_zero_after_any_history(
            way in any_way(), rate in 0.5..20.0_f64, samples in prop::collection::vec(any_sample(), 1..60),
            flags in prop::sample::select(std::vec![NOT_AUTO, BAD, AT_LOW, AT_HIGH]),
        ) {
            let s = CompensationSettings { rate, ..settings(way) };
            let block = Compensation::new(s).unwrap();
            let mut state = CompensationState::default();
            for x in &samples {
                block.update(&mut state, x);
            }
            let time = s.release + s.size / 2.0 / rate;
            for _ in 0..=(time / 0.01) as usize + 1 {
                block.update(&mut state, &CompensationSample { h: 0.01, flags, ..sample(-1.0, 0.0) });
            }
            prop_assert!(state.u_ff.abs() < 1e-9 && state.half.abs() < 1e-9, "{:?}", state);
        }

        #[test]
        fn away_in_time_whatever_was_set_meanwhile(
            way in any_way(), ti in 0.01..100.0_f64, share in 0.1..1.0_f64,
            sets in prop::collection::vec((0.0..1.0_f64, 0.0..1.0_f64, 1e-9..1e9_f64), 1..5),
            samples in prop::collection::vec(any_sample(), 1..60),
            flags in prop::sample::select(std::vec![0, BAD, AT_LOW, AT_HIGH]),
        ) {
            let mut state = CompensationState::default();
            let base = CompensationSettings { ti, share, withdraw: false, watch: ti, ..settings(way) };
            let longest = base.longest_release();
            let mut block = None;
            for (width, release, rate) in sets {
                let size = 5.0 * width;
                let made = CompensationSettings { size, band: 0.0, release: longest * (1.0 - release), rate, ..base };
                block = Some(Compensation::new(made).unwrap());
                for x in &samples {
                    block.as_ref().unwrap().update(&mut state, x);
                }
            }
            let off = CompensationSample { enable: flags != 0, flags, h: longest / 100.0, ..sample(-1.0, 0.0) };
            let mut last = f64::INFINITY;
            for _ in 0..101 {
                let u_ff = block.as_ref().unwrap().update(&mut state, &off).abs();
                prop_assert!(u_ff <= last, "it grows from {last} to {u_ff}");
                last = u_ff;
            }
            prop_assert!(last < 1e-12, "{:?}", state);
        }

        #[test]
        fn sign_symmetric(
            way in any_way(), band in 0.0..1.0_f64, samples in prop::collection::vec(any_sample(), 1..60),
        ) {
            let block = Compensation::new(CompensationSettings { band, ..settings(way) }).unwrap();
            let (mut a, mut b) = (CompensationState::default(), CompensationState::default());
            for x in &samples {
                let mirrored = CompensationSample { e: -x.e, u: -x.u, ..*x };
                prop_assert_eq!(block.update(&mut a, x), -block.update(&mut b, &mirrored));
                prop_assert_eq!(a.standing, b.standing);
            }
        }

        #[test]
        fn on_a_known_gap_the_rest_is_a_smaller_gap(
            d in 0.5..3.0_f64, share in 0.0..1.0_f64, band in 0.0..0.5_f64,
            moves in prop::collection::vec(-9.0..9.0_f64, 3..40),
        ) {
            use crate::{Backlash, BacklashState};
            // u in small steps, so that a reversal is found where it happens; jumps at once; in force from the start.
            let s = CompensationSettings { size: d, share, band, release: 1e-3, ..settings(Way::Inverse) };
            let block = Compensation::new(s).unwrap();
            let delta = (share * d - band).max(0.0);
            let (gap, rest) = (Backlash::new(d).unwrap(), Backlash::new(d - delta).unwrap());
            let (mut state, mut valve, mut wished) =
                (CompensationState::default(), BacklashState::at(0.0), BacklashState::at(0.0));
            let (mut u, mut known, mut ran, mut side) = (0.0_f64, false, 0.0, 0);
            for &to in &moves {
                let steps = ((to - u).abs() / 0.01) as usize + 1;
                let step = (to - u) / steps as f64;
                for _ in 0..steps {
                    u += step;
                    let u_ff = block.update(&mut state, &sample(0.0, u));
                    let (y, w) = (gap.update(&mut valve, u + u_ff), rest.update(&mut wished, u));
                    if !known {
                        // Both gaps begin at the same edge, after the valve was driven to it once.
                        ran = if state.direction == side { ran + step.abs() } else { 0.0 };
                        side = state.direction;
                        known = state.standing == Standing::Active && ran > 2.0 * d;
                        wished = BacklashState::at(y);
                    } else {
                        prop_assert!((y - w).abs() <= 0.0101, "{} {} at {}", y, w, u);
                    }
                }
            }
        }
    }
}
