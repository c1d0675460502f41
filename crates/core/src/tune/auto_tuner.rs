//! The autotuner: a relay in the controller's place until the oscillation of the process is known.

use crate::error::require;
use crate::status::{AT_HIGH, AT_LOW, BAD, DATA_GAP, NOT_AUTO, Status};
use crate::tuning::{self, Gains, Kind, Table};
use crate::{ParameterError, Real, Sum};

/// Cycles that agree with the one before them and are measured together.
const MEASURED: u32 = 4;
/// Cycles of a phase after which the process counts as never regular.
const MOST_CYCLES: u32 = 30;
/// Samples of the shortest cycle that counts: below it the sample time, or chatter, makes the cycle.
const FEWEST_SAMPLES: u32 = 8;

/// Relay experiment with hysteresis: ultimate gain and period, static gain, and a controller from them.
///
/// From a loop at rest the output is taken over where it stands, OP₀, and goes through three phases:
///
/// ```text
/// waiting    OP₀ for `wait` seconds. Mean of PV = centre; half of its range = hysteresis ε, where none was given
/// balanced   OP₀ + bias ± ⅔a: up until PV > centre + ε, down until PV < centre − ε (with the sign of a on PV).
///            Where one half lasts more than 1½ times the other: bias := mean of OP over the cycle, within ± ⅓a
/// biased     the same with the bias moved by ⅓a towards the far side: the means of OP and PV move
/// ```
///
/// so that OP is never further than |a| from OP₀, and within its limits. A phase is over when four cycles in a row are like
/// the one before them: period, first harmonic and mean of PV within 15 % and three samples, mean of OP within 10 % of a. Then OP is
/// OP₀ again.
///
/// **Ultimate point.** Over a whole number of periods of a steady cycle the first harmonics of PV and OP are in the
/// proportion of the process itself, P(iω) = Y₁/U₁ at ω = 2π/T: nothing is approximated, and noise averages out. Ku = 1/|P|
/// and Tu = T would be those of the describing function of a relay with hysteresis, 4d/(πA) with its argument asin(ε/A),
/// freed of the error that the higher harmonics make in A. What is left of it is that the cycle does not stand at −180° but
/// at −180° + δ (hysteresis, sample time, higher harmonics); without correction Ku would be
/// too low for it, by a tenth and more in noise. δ is measured, and with κ = 1/(Kp·Ku)
///
/// ```text
/// c  = tan δ/(0.9 + 3κ)
/// Tu = T·(1 − c)           Ku = (1 + 2·(1 − κ²)·c)/|P|
/// ```
///
/// The slopes were chosen on the eight processes of the thesis (4.1); `docs/auto_tuner.md` has the remaining error, there
/// and on others.
///
/// **Static gain.** Kp = (mean PV, biased − mean PV, balanced)/(the same of OP). An integrating process brings the mean of OP
/// back to where it was: below κ = 0.05 there is no telling it from one, `kp` is none and `kappa` 0. Known bias: a load that
/// changes between the two phases goes into Kp in full, except where PV's mean did not follow (`kp` and `kappa` none).
///
/// **A gap** of known width d takes d/2 off either level before it reaches the process; that is counted in. One that is not
/// known makes Ku too high by the share d/(4a/3 − d) and more, and Kp by much more.
///
/// Whatever goes wrong ends the experiment with a [`Stop`], and OP is OP₀ in the same sample.
///
/// ```
/// use glapp_core::{AutoTuner, AutoTunerSettings, AutoTunerState, auto_tuner::Phase};
///
/// let tuner = AutoTuner::new(AutoTunerSettings {
///     amplitude: 5.0, relay_hysteresis: None, d: 0.0, wait: 10.0, longest: 600.0, max_h: 1.0, pv: (0.0, 100.0), op: (0.0, 100.0),
/// })?;
/// let mut state = AutoTunerState::default();
/// tuner.start(&mut state, 40.0);
/// let (mut x, mut op) = ([40.0_f64; 3], 40.0); // a process of three equal lags of 5 s: Ku = 8, Tu = 2π·5/√3 s
/// while state.phase.is_running() {
///     for _ in 0..10 {
///         x = [x[0] + (op - x[0]) * 0.002, x[1] + (x[0] - x[1]) * 0.002, x[2] + (x[1] - x[2]) * 0.002];
///     }
///     op = tuner.update(&mut state, x[2], 0.1, 0);
/// }
/// let found = state.found.unwrap();
/// assert_eq!((state.phase, op), (Phase::Done, 40.0));
/// assert!((found.ku / 8.0 - 1.0).abs() < 0.05 && (found.tu / 18.14 - 1.0).abs() < 0.05);
/// assert!((found.kp.unwrap() - 1.0).abs() < 0.05);
/// let pid = found.point_placement()?;
/// assert_eq!(pid.ti, 6.25 * pid.td);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AutoTuner<R> {
    settings: AutoTunerSettings<R>,
    /// |a|.
    most: R,
    /// 1, or −1 where PV falls when OP rises.
    sign: R,
    /// The relay's half swing, ⅔ of |a|.
    step: R,
    /// Limit of the bias, ⅓ of |a|.
    reach: R,
}

/// Limits of an experiment.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AutoTunerSettings<R> {
    /// a: the greatest distance of OP from where it was [unit of OP], ≠ 0, negative where PV falls when OP rises.
    pub amplitude: R,
    /// ε ≥ 0 [unit of PV]; none: half of PV's range in the waiting phase.
    pub relay_hysteresis: Option<R>,
    /// Width d of the gap that the valve is known to have [unit of OP], ≥ 0 and < 4/3 of |a|; 0 = none known.
    pub d: R,
    /// Length of the waiting phase \[s\], > 0; a period of the process is long enough to see its noise.
    pub wait: R,
    /// The whole experiment ends within this time \[s\], > `wait`; a half-period within a quarter of it.
    pub longest: R,
    /// A longer time between two samples ends it \[s\], > 0.
    pub max_h: R,
    /// PV outside (low, high) ends it.
    pub pv: (R, R),
    /// Limits of OP; it does not begin nearer than a to one.
    pub op: (R, R),
}

named! {
    /// Rule that makes a controller from an experiment's result.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[repr(u8)]
    pub enum Rule {
        /// [`Found::point_placement`], PID with Ti = 6.25Td (thesis 7.5).
        #[default]
        PointPlacement = 1 => "point_placement",
        /// [`Found::amigo`], PI.
        AmigoPi = 2 => "amigo_pi",
        /// [`Found::amigo`], PID.
        AmigoPid = 3 => "amigo_pid",
    }
}

named! {
    /// Phase of an experiment.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[repr(u8)]
    pub enum Phase {
        /// Not started.
        #[default]
        Idle = 0 => "idle",
        /// OP held, PV looked at.
        Waiting = 1 => "waiting",
        /// Relay with a bias that makes up and down last alike.
        Balanced = 2 => "balanced",
        /// Relay with the bias moved away from there.
        Biased = 3 => "biased",
        /// Over.
        Done = 4 => "done",
        /// Broken off.
        Aborted = 5 => "aborted",
    }
}

impl Phase {
    /// Whether the relay has the output.
    pub fn is_running(self) -> bool {
        matches!(self, Self::Waiting | Self::Balanced | Self::Biased)
    }
}

named! {
    /// Why an experiment was broken off. Of several reasons at one sample the first counts.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[repr(u8)]
    pub enum Stop {
        /// No error.
        #[default]
        None = 0 => "none",
        /// PV, or OP at the start, is no number or flagged bad.
        BadQuality = 1 => "bad_quality",
        /// A gap, time that stands still or runs backwards, or a step longer than `max_h`.
        SampleTime = 2 => "sample_time",
        /// Somebody else has the output.
        NotAuto = 3 => "not_auto",
        /// OP is at a limit, or nearer to one than the amplitude.
        OpLimit = 4 => "op_limit",
        /// PV is out of its bounds.
        PvBounds = 5 => "pv_bounds",
        /// OP went up, and PV the wrong way: the amplitude has the wrong sign.
        WrongSign = 6 => "wrong_sign",
        /// PV does not answer, or not any longer: a valve or sensor that does not move, a load beyond the relay's power, or a
        /// process too slow for the time given.
        DeadLoop = 7 => "dead_loop",
        /// Thirty cycles, and no four alike: too much noise, or too coarse a sample time.
        NotRegular = 8 => "not_regular",
        /// The time given is over.
        TimeBudget = 9 => "time_budget",
        /// A regular cycle too far from −180° (|tan δ| > 0.5): hysteresis or sample time make it, not the process.
        OffPoint = 10 => "off_point",
    }
}

/// Result of an experiment.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Found<R> {
    /// Ultimate gain Ku [OP per PV], of the sign of the process gain.
    pub ku: R,
    /// Ultimate period Tu \[s\].
    pub tu: R,
    /// Static gain Kp [PV per OP]; none for an integrating process, and where it could not be measured.
    pub kp: Option<R>,
    /// κ = 1/(Kp·Ku), 0 for an integrating process; none where it could not be measured, and then Ku and Tu are not
    /// corrected for the phase of the cycle.
    pub kappa: Option<R>,
}

impl<R: Real> Found<R> {
    /// The PID controller with Ti = 6.25Td of [`tuning::point_placement`]; refused from κ = 0.8 on, where it becomes unstable.
    pub fn point_placement(&self) -> Result<Gains<R>, ParameterError> {
        let bound = "less than 0.8: the derivative makes a process unstable that is nearly all dead time";
        let kappa = self.kappa.unwrap_or(R::ZERO);
        require("kappa", kappa, kappa < R::of(0.8), bound)?;
        tuning::point_placement(self.ku, self.tu)
    }

    /// The controller that a rule makes of it.
    pub fn by(&self, rule: Rule) -> Result<Gains<R>, ParameterError> {
        match rule {
            Rule::PointPlacement => self.point_placement(),
            Rule::AmigoPi => self.amigo(Kind::Pi),
            Rule::AmigoPid => self.amigo(Kind::Pid),
        }
    }

    /// The controller by [`tuning::ziegler_nichols_frequency`].
    pub fn ziegler_nichols(&self, kind: Kind, table: Table) -> Result<Gains<R>, ParameterError> {
        tuning::ziegler_nichols_frequency(self.ku, self.tu, kind, table)
    }

    /// [`tuning::amigo_frequency`]; refused where κ is not known.
    pub fn amigo(&self, kind: Kind) -> Result<Gains<R>, ParameterError> {
        let unknown = ParameterError { name: "kappa", value: f64::NAN, bound: "measured; repeat the experiment" };
        tuning::amigo_frequency(self.ku, self.tu, self.kappa.ok_or(unknown)?, kind)
    }
}

/// Integrals over a cycle, or over several.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Cycle<T> {
    /// Duration \[s\], and that of the part with OP up.
    t: T,
    up: T,
    samples: u32,
    /// ∫(OP − OP₀)dt, as the gap leaves it, and ∫±(PV − centre)dt.
    u: T,
    y: T,
    /// Integrands times cos 2πt/T and sin 2πt/T.
    u_cos: T,
    u_sin: T,
    y_cos: T,
    y_sin: T,
}

impl<R: Real> Cycle<R> {
    fn add(&mut self, other: &Self) {
        self.t += other.t;
        self.u += other.u;
        self.y += other.y;
        self.u_cos += other.u_cos;
        self.u_sin += other.u_sin;
        self.y_cos += other.y_cos;
        self.y_sin += other.y_sin;
    }

    /// Square of PV's first harmonic: |Y₁|²/4.
    fn power(&self) -> R {
        (self.y_cos * self.y_cos + self.y_sin * self.y_sin) / (self.t * self.t)
    }

    /// Whether it is like `first` in period, first harmonic and means; `most` is |a|.
    fn agrees(&self, first: &Self, most: R) -> bool {
        let apart = |a: R, b: R| (a - b).magnitude();
        let power = first.power();
        let moved = self.y / self.t - first.y / first.t;
        let share = R::of(0.15) + R::of(3.0) / R::of(f64::from(first.samples));
        let (least, greatest) = (R::ONE - share, R::ONE + share);
        apart(self.t, first.t) <= share * first.t
            && self.power() >= least * least * power
            && self.power() <= greatest * greatest * power
            && moved * moved <= share * share * power
            && apart(self.u / self.t, first.u / first.t) <= R::of(0.1) * most
    }
}

/// Totals of a cycle's sums.
fn total<R: Real>(sums: &Cycle<R::Sum>) -> Cycle<R> {
    let &Cycle { t, up, samples, u, y, u_cos, u_sin, y_cos, y_sin } = sums;
    Cycle {
        t: t.value(),
        up: up.value(),
        samples,
        u: u.value(),
        y: y.value(),
        u_cos: u_cos.value(),
        u_sin: u_sin.value(),
        y_cos: y_cos.value(),
        y_sin: y_sin.value(),
    }
}

/// State of an [`AutoTuner`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AutoTunerState<R: Real> {
    /// Phase of the experiment.
    pub phase: Phase,
    /// Why it was broken off.
    pub stop: Stop,
    /// Result: Ku and Tu, not corrected yet, after the balanced phase; all after the biased one.
    pub found: Option<Found<R>>,
    /// Output to the valve.
    pub output: R,
    /// OP₀, where the output was and will be.
    pub start: R,
    /// Time since the start \[s\].
    pub t: R::Sum,
    /// ε [unit of PV].
    pub relay_hysteresis: R,
    /// Mean of PV at rest.
    pub centre: R,
    /// Middle of the relay, from OP₀.
    pub bias: R,
    /// Cycles in this phase.
    pub cycles: u32,
    /// PV at the first sample at rest, how far it went from there, and the integral of that.
    first_pv: R,
    low: R,
    high: R,
    area: R::Sum,
    resting: bool,
    /// ±(PV − centre) at the last sample.
    x: R,
    up: bool,
    /// PV has crossed the band once.
    answered: bool,
    /// Time since the relay last switched.
    half: R::Sum,
    /// The period that cos and sin are taken with, 0 = not known yet.
    period: R,
    cycle: Cycle<R::Sum>,
    /// The cycle that the following are compared with, and how many agree, itself included.
    first: Cycle<R>,
    alike: u32,
    sum: Cycle<R>,
    /// Means of OP and PV, and δ as its tangent, in the balanced phase.
    mean_u: R,
    mean_y: R,
    tangent: R,
}

impl<R: Real> AutoTuner<R> {
    /// Checks the settings.
    pub fn new(settings: AutoTunerSettings<R>) -> Result<Self, ParameterError> {
        let AutoTunerSettings { amplitude, relay_hysteresis, d, wait, longest, max_h, pv, op } = settings;
        let sane = |x: R| x.magnitude() <= R::MOST;
        require("amplitude", amplitude, amplitude != R::ZERO && sane(amplitude), "a number other than 0")?;
        if let Some(relay_hysteresis) = relay_hysteresis {
            require(
                "relay_hysteresis",
                relay_hysteresis,
                relay_hysteresis >= R::ZERO && sane(relay_hysteresis),
                "0 or greater",
            )?;
        }
        let swing = R::of(4.0) * (amplitude.magnitude() / R::of(3.0));
        require(
            "d",
            d,
            d >= R::ZERO && d < swing,
            "0 or greater, and less than 4/3 of the amplitude: the relay's swing",
        )?;
        require("wait", wait, wait > R::ZERO && sane(wait), "greater than 0 s")?;
        require("longest", longest, longest > wait && sane(longest), "greater than wait")?;
        require("max_h", max_h, max_h > R::ZERO && sane(max_h), "greater than 0 s")?;
        require("pv_high", pv.1, sane(pv.1), "a number")?;
        require("pv_low", pv.0, pv.0 < pv.1 && sane(pv.0), "a number less than pv_high")?;
        require("op_high", op.1, sane(op.1), "a number")?;
        require("op_low", op.0, op.0 < op.1 && sane(op.0), "a number less than op_high")?;
        let most = amplitude.magnitude();
        let third = most / R::of(3.0);
        let sign = if amplitude > R::ZERO { R::ONE } else { -R::ONE };
        Ok(Self { settings, most, sign, step: R::of(2.0) * third, reach: third })
    }

    /// Begins an experiment with the output where it stands, `op`; one that is under way is forgotten.
    pub fn start(&self, state: &mut AutoTunerState<R>, op: R) {
        let (low, high) = self.settings.op;
        let last = if op.is_number() { op } else { state.output };
        *state = AutoTunerState { phase: Phase::Waiting, start: last, output: last, ..AutoTunerState::default() };
        if !op.is_number() {
            self.stop(state, Stop::BadQuality);
        } else if !(op - self.most >= low && op + self.most <= high) {
            self.stop(state, Stop::OpLimit);
        }
    }

    /// Takes PV, the time since the sample before `h` \[s\], and the flags of the sample
    /// ([`status`](crate::status)); gives OP. Where no experiment runs, OP stays.
    #[inline]
    pub fn update(&self, state: &mut AutoTunerState<R>, pv: R, h: R, flags: Status) -> R {
        if state.phase.is_running() {
            match self.fault(state, pv, h, flags) {
                Stop::None if state.phase == Phase::Waiting => self.rest(state, pv, h),
                Stop::None => self.relay(state, pv, h),
                reason => self.stop(state, reason),
            }
        }
        state.output
    }

    /// Reason to end the experiment at this sample, whatever it measured so far.
    #[inline]
    fn fault(&self, s: &AutoTunerState<R>, pv: R, h: R, flags: Status) -> Stop {
        let (low, high) = self.settings.pv;
        if flags & BAD != 0 || !pv.is_number() {
            Stop::BadQuality
        } else if flags & DATA_GAP != 0 || !(h > R::ZERO && h <= self.settings.max_h) {
            Stop::SampleTime
        } else if flags & NOT_AUTO != 0 {
            Stop::NotAuto
        } else if flags & (AT_LOW | AT_HIGH) != 0 {
            Stop::OpLimit
        } else if pv < low || pv > high {
            if self.went_wrong(s, self.sign * (pv - s.centre)) { Stop::WrongSign } else { Stop::PvBounds }
        } else if s.t.value() + h > self.settings.longest {
            Stop::TimeBudget
        } else {
            Stop::None
        }
    }

    /// Whether the very first push sent PV the wrong way.
    fn went_wrong(&self, s: &AutoTunerState<R>, x: R) -> bool {
        s.phase != Phase::Waiting && !s.answered && x < -s.relay_hysteresis
    }

    fn stop(&self, s: &mut AutoTunerState<R>, reason: Stop) {
        s.phase = Phase::Aborted;
        s.stop = reason;
        s.output = s.start;
    }

    /// The phase before the relay: centre and hysteresis from PV.
    fn rest(&self, s: &mut AutoTunerState<R>, pv: R, h: R) {
        if !s.resting {
            s.first_pv = pv;
            s.resting = true;
        }
        let away = pv - s.first_pv;
        s.low = s.low.lesser(away);
        s.high = s.high.greater(away);
        s.area.add(h * away);
        s.t.add(h);
        if s.t.value() >= self.settings.wait {
            s.centre = s.first_pv + s.area.value() / s.t.value();
            s.relay_hysteresis = self.settings.relay_hysteresis.unwrap_or(R::of(0.5) * (s.high - s.low));
            s.phase = Phase::Balanced;
            s.up = true;
            s.x = self.sign * (pv - s.centre);
            self.push(s);
        }
    }

    /// Switches the relay by PV; each switch upwards closes a cycle.
    fn relay(&self, s: &mut AutoTunerState<R>, pv: R, h: R) {
        let x = self.sign * (pv - s.centre);
        s.integrate(x, h, R::of(0.5) * self.settings.d);
        s.t.add(h);
        s.half.add(h);
        s.x = x;
        if s.up && x > s.relay_hysteresis {
            s.up = false;
            s.answered = true;
            s.half = R::Sum::default();
        } else if !s.up && x < -s.relay_hysteresis {
            s.up = true;
            s.half = R::Sum::default();
            self.close(s);
        } else if s.half.value() > R::of(0.25) * self.settings.longest {
            self.stop(s, if self.went_wrong(s, x) { Stop::WrongSign } else { Stop::DeadLoop });
        }
        if s.phase.is_running() {
            self.push(s);
        }
    }

    /// Sets the output to the side on which the relay is.
    fn push(&self, s: &mut AutoTunerState<R>) {
        let (low, high) = self.settings.op;
        let to = s.start + (if s.up { s.bias + self.step } else { s.bias - self.step });
        // Rounding may put the sum beyond the limit that the start was checked against.
        s.output = to.greater(low).lesser(high);
    }

    /// A cycle is complete.
    fn close(&self, s: &mut AutoTunerState<R>) {
        let cycle = total::<R>(&core::mem::take(&mut s.cycle));
        let (known, before) = (s.period > R::ZERO, s.alike);
        s.period = cycle.t;
        s.alike = 0;
        s.cycles += 1;
        if s.cycles > MOST_CYCLES {
            return self.stop(s, Stop::NotRegular);
        }
        // Without a period before it, it has no harmonics.
        let swings = cycle.power() > R::ZERO;
        if !(known && swings) || cycle.samples < FEWEST_SAMPLES {
            return;
        }
        if s.phase == Phase::Balanced && self.rebalance(s, &cycle) {
            return;
        }
        if before > 0 && cycle.agrees(&s.first, self.most) {
            s.sum.add(&cycle);
            s.alike = before + 1;
            s.period = s.sum.t / R::of(f64::from(before));
        } else {
            s.first = cycle;
            s.sum = Cycle::default();
            s.alike = 1;
        }
        if s.alike > MEASURED {
            if s.phase == Phase::Balanced { self.balanced(s) } else { self.biased(s) }
        }
    }

    /// Moves the bias to where up and down last alike; whether it had to.
    fn rebalance(&self, s: &mut AutoTunerState<R>, cycle: &Cycle<R>) -> bool {
        let bias = (cycle.u / cycle.t).greater(-self.reach).lesser(self.reach);
        let uneven = (cycle.up - (cycle.t - cycle.up)).magnitude() > R::of(0.2) * cycle.t;
        let moves = uneven && (bias - s.bias).magnitude() > R::of(0.01) * self.most;
        if moves {
            s.bias = bias;
        }
        moves
    }

    /// Takes the point of the process' frequency response from four equal cycles under the balanced relay.
    fn balanced(&self, s: &mut AutoTunerState<R>) {
        let sum = &s.sum;
        let re = sum.y_cos * sum.u_cos + sum.y_sin * sum.u_sin;
        let im = sum.y_cos * sum.u_sin - sum.y_sin * sum.u_cos;
        let ratio = (sum.u_cos * sum.u_cos + sum.u_sin * sum.u_sin) / (sum.y_cos * sum.y_cos + sum.y_sin * sum.y_sin);
        let tangent = if re < R::ZERO { im / re } else { R::LARGEST };
        if !(tangent.magnitude() <= R::of(0.5) && ratio > R::ZERO && ratio.is_number()) {
            return self.stop(s, Stop::OffPoint);
        }
        s.tangent = tangent;
        s.mean_u = sum.u / sum.t;
        s.mean_y = sum.y / sum.t;
        s.found = Some(Found { ku: self.sign * root(ratio), tu: s.period, kp: None, kappa: None });
        s.bias = s.bias + (if s.bias > R::ZERO { -self.reach } else { self.reach });
        s.phase = Phase::Biased;
        s.cycles = 0;
        s.alike = 0;
        s.period = R::ZERO;
    }

    /// Four cycles alike under the biased relay: the static gain, and with it the correction for δ.
    fn biased(&self, s: &mut AutoTunerState<R>) {
        let du = s.sum.u / s.sum.t - s.mean_u;
        let dy = s.sum.y / s.sum.t - s.mean_y;
        let pushed = if s.bias > s.mean_u { R::ONE } else { -R::ONE };
        let seen = R::of(0.1) * root(R::of(4.0) * s.sum.power());
        if let Some(raw) = s.found
            && dy * pushed > seen
        {
            let gain = raw.ku.magnitude();
            let flat = du / dy;
            let kappa = flat / gain;
            let (kappa, kp) = if kappa < R::of(0.05) { (R::ZERO, None) } else { (kappa, Some(self.sign * (dy / du))) };
            let least = kappa.lesser(R::ONE);
            let c = s.tangent / (R::of(0.9) + R::of(3.0) * least);
            let ku = gain * (R::ONE + R::of(2.0) * (R::ONE - least * least) * c);
            let kappa = if kp.is_some() { flat / ku } else { R::ZERO };
            s.found = Some(Found { ku: self.sign * ku, tu: raw.tu * (R::ONE - c), kp, kappa: Some(kappa) });
        }
        s.phase = Phase::Done;
        s.output = s.start;
    }
}

impl<R: Real> AutoTunerState<R> {
    /// Adds what happened since the last sample: OP was held, PV went from its last value to `x`. The valve stands half of
    /// its gap, `lost`, this side of OP: every turn of the relay takes it through the whole of it.
    #[inline]
    fn integrate(&mut self, x: R, h: R, lost: R) {
        let half = R::of(0.5);
        let level = self.output - self.start;
        let u = (if self.up { level - lost } else { level + lost }) * h;
        let y = half * (self.x + x) * h;
        let c = &mut self.cycle;
        if self.period > R::ZERO {
            // Phase in turns, from half a turn ago: that changes the sign of OP's and PV's harmonic alike. A cycle of
            // more than twice the period is none that counts.
            let turn = ((c.t.value() + half * h) / self.period).lesser(R::of(2.0)) - half;
            let (cos, sin) = circle(turn);
            c.u_cos.add(u * cos);
            c.u_sin.add(u * sin);
            c.y_cos.add(y * cos);
            c.y_sin.add(y * sin);
        }
        c.u.add(u);
        c.y.add(y);
        c.t.add(h);
        if self.up {
            c.up.add(h);
        }
        c.samples += 1;
    }
}

/// cos 2πa and sin 2πa by the series of a quarter of the angle, doubled twice: 1e-8 of a turn within |a| ≤ ½.
#[inline]
fn circle<R: Real>(a: R) -> (R, R) {
    let b = a * R::of(core::f64::consts::FRAC_PI_2);
    let z = b * b;
    let cos = R::ONE
        + z * (R::of(-1.0 / 2.0)
            + z * (R::of(1.0 / 24.0)
                + z * (R::of(-1.0 / 720.0) + z * (R::of(1.0 / 40320.0) + z * R::of(-1.0 / 3628800.0)))));
    let sin = b
        * (R::ONE
            + z * (R::of(-1.0 / 6.0)
                + z * (R::of(1.0 / 120.0) + z * (R::of(-1.0 / 5040.0) + z * R::of(1.0 / 362880.0)))));
    let twice = |c: R, s: R| (R::ONE - R::of(2.0) * s * s, R::of(2.0) * s * c);
    let (cos, sin) = twice(cos, sin);
    twice(cos, sin)
}

/// √x by Newton's way from above, which ends at the first step that no longer descends.
fn root<R: Real>(x: R) -> R {
    let mut root = x.greater(R::ONE);
    loop {
        let next = R::of(0.5) * (root + x / root);
        if next < root {
            root = next;
        } else {
            return root;
        }
    }
}
