//! The detector's law: a sample in, a record out. What a controller mirrors is this file.

mod batch;
mod lanes;

pub use batch::{Columns, Span};

use crate::status::{AT_HIGH, AT_LOW, BAD, DATA_GAP, NOT_AUTO, Status};
use crate::{
    Estimate, HalfPeriod, HalfPeriodState, MedianMean, MedianMeanState, NoiseLevel, ParameterError, Real, Reason,
    SafetyNet, SecondOrderFilter, SecondOrderFilterState, Sum, Width, WidthParts, ZeroCrossing, error::require,
};

/// One sample of a loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<R> {
    /// Time since the sample before \[s\]; not used at the first sample.
    pub h: R,
    /// Setpoint [PV unit].
    pub sp: R,
    /// Process value [PV unit].
    pub pv: R,
    /// Controller output [OP unit], where it is known.
    pub op: Option<R>,
    /// [`NOT_AUTO`], [`BAD`], [`AT_LOW`], [`AT_HIGH`]; 0 = all well.
    pub flags: Status,
}

/// One half-period with everything that was concluded from it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct HalfPeriodResult<R> {
    /// Signals of the half-period.
    pub half: HalfPeriod<R>,
    /// The width and its parts; a detection where `mask` is 0.
    pub parts: WidthParts<R>,
    /// All conditions that failed, see [`Reason::bit`]; 0 = accepted.
    pub mask: u16,
    /// Δy of the completed half-period before, compared in (5.4).
    pub previous_delta_y: Option<R>,
    /// The estimate compared in (5.1), where it was asked.
    pub d_hat_before: Option<R>,
    /// Estimate after this half-period; none before the first detection.
    pub estimate: Option<Estimate<R>>,
    /// The noise limit, from the level of the noise at the last detection [OP unit]; none where it is not known.
    pub noise_floor: Option<R>,
    /// σ of PV's fast noise at its end, where nothing but (5.1) speaks against it and the noise is known [PV unit].
    pub sigma: Option<R>,
    /// Whether Kp was a default ([`DetectorSettings::gain`](crate::DetectorSettings::gain)).
    #[cfg_attr(feature = "serde", serde(default))]
    pub kp_defaulted: bool,
}

impl<R: Real> HalfPeriodResult<R> {
    /// The estimate after this half-period, if it is above the noise limit.
    pub fn shown(&self) -> Option<Estimate<R>> {
        shown(self.estimate, self.noise_floor)
    }

    /// The first reason of rejection.
    pub fn reason(&self) -> Reason {
        Reason::first(self.mask)
    }
}

/// Detects half-periods with backlash and estimates the width of the gap, on line (thesis 2.1, chapters 5 and 7).
///
/// samples → [`SecondOrderFilter`] → [`ZeroCrossing`] → [`HalfPeriod`] → [`Width`] → [`SafetyNet`] → [`MedianMean`].
/// O(1) per sample. Every sample belongs to exactly one half-period, and every half-period ends in one [`HalfPeriodResult`].
///
/// What breaks the signal:
/// - the first sample, a step h that is negative or longer than `max_h`: a *gap*. The half-period under way ends with
///   that reason; what follows starts the filter anew, and carries the reason until the next crossing.
/// - a bad flag, or a value that is not a finite number: likewise, with *bad quality*; the value is not used. What
///   follows starts at the next good one. An error or OP beyond 10³⁰ (`f32`: 10¹²), and
///   whatever else makes a number overflow, counts as bad.
/// - h = 0, a repeated time: the sample is passed over, only its flags count.
/// - not in automatic, at a limit: the half-period goes on and is rejected.
///
/// The previous Δy for (5.4) is that of the completed half-period before, accepted or not; none after a break or
/// manual operation.
///
/// (5.1) compares with the estimate only once N detections stand behind it. It cannot lock: detections that fail
/// nothing but (5.1) are collected beside the window, and a row of them, which only a detection that passes ends,
/// replaces it
/// - after N, where two thirds of the last N lie within 80–120 % of their median, and the row's detections last at
///   least as long as all other half-periods of automatic operation since it began: the gap has become smaller, or the
///   first detections were false;
/// - after 10N, whatever they are like.
///
/// The time tells a limit cycle, which is nearly all detections, from noise, whose half-periods are now and then as long
/// as a detection but mostly much shorter: what noise makes after a limit cycle has come to rest must stay rejected
/// (thesis figure 5.4).
///
/// Where Kp becomes known, or is no longer, the detections are forgotten with the next half-period: those made with a default
/// ([`DetectorSettings::gain`](crate::DetectorSettings::gain)) and the others make no estimate together.
///
/// An estimate is *shown* where it is at least the noise limit: 3σ/|Kp| ([`Width::noise_floor`]), with σ of PV as measured, by
/// [`NoiseLevel`], at the last detection. (5.1) goes by what the detections say, shown or not.
///
/// ```
/// use glapp_core::{Detector, DetectorState, MedianMean, SafetyNet, Sample, SecondOrderFilter, Width};
/// let detector = Detector::new(
///     SecondOrderFilter::new(0.0)?,
///     Width::new(0.5, 10.0, Some(0.0), 1.0, Some(2.0))?,
///     SafetyNet::new(None)?,
///     MedianMean::new(3)?,
///     60.0,
///     None,
/// )?;
/// let mut state = DetectorState::default();
/// for k in 0..800 {
///     let pv = if (k / 100) % 2 == 0 { -1.0 } else { 1.0 };
///     detector.update(&mut state, &Sample { h: 1.0, sp: 0.0, pv, op: None, flags: 0 });
/// }
/// assert_eq!(state.estimate().unwrap().value, 4.5); // 0.5/10·1·100 − 1/2
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detector<R> {
    filter: SecondOrderFilter<R>,
    width: Width<R>,
    net: SafetyNet<R>,
    detections: MedianMean,
    max_h: R,
    op_limits: Option<(R, R)>,
    /// Whether Kp is a default.
    pub(super) kp_defaulted: bool,
}

/// State of [`Detector`]: a part that changes at every sample, and one that changes at a zero crossing.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DetectorState<R: Real> {
    signal: Signal<R>,
    memory: Conclusions<R>,
    /// Time of the last sample of [`Detector::run`], and of the first one of the half-period under way.
    t: Option<(f64, f64)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Signal<R: Real> {
    pv: SecondOrderFilterState<R>,
    #[cfg_attr(feature = "serde", serde(default))]
    noise: NoiseLevel<R>,
    op: SecondOrderFilterState<R>,
    crossing: ZeroCrossing,
    half: HalfPeriodState<R>,
    /// Why the signal is broken, as flags; 0 while it is whole.
    broken: Status,
}

impl<R: Real> Signal<R> {
    /// Ends the half-period under way, of this sign, at a crossing, and begins the next.
    #[inline(always)]
    fn turn(&mut self, sign: i8, sp: R, slope: R, op: R) -> HalfPeriod<R> {
        let half = self.half.close(sign, sp, slope, op);
        self.half = if slope.is_number() {
            HalfPeriodState::start(sp, slope, op, 0)
        } else {
            HalfPeriodState::start(sp, R::ZERO, op, BAD)
        };
        half
    }
}

impl<R: Real> Default for Signal<R> {
    fn default() -> Self {
        Self {
            pv: SecondOrderFilterState::default(),
            noise: NoiseLevel::default(),
            op: SecondOrderFilterState::default(),
            crossing: ZeroCrossing::default(),
            half: HalfPeriodState::default(),
            broken: DATA_GAP,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Conclusions<R: Real> {
    previous_delta_y: Option<R>,
    window: MedianMeanState<R>,
    estimate: Option<Estimate<R>>,
    #[cfg_attr(feature = "serde", serde(default))]
    noise_floor: Option<R>,
    #[cfg_attr(feature = "serde", serde(default))]
    kp_defaulted: bool,
    accepted: u32,
    /// Kp that has been found since, in place of the one in the settings [PV unit/OP unit].
    #[cfg_attr(feature = "serde", serde(default))]
    kp: Option<R>,
    /// Detections that (5.1) alone rejected since the last one accepted, how many, and their time less that of all other
    /// half-periods since the first of them \[s\].
    candidates: MedianMeanState<R>,
    rejected: u32,
    excess: R::Sum,
}

impl<R: Real> Default for DetectorState<R> {
    fn default() -> Self {
        Self { signal: Signal::default(), memory: Conclusions::default(), t: None }
    }
}

impl<R: Real> DetectorState<R> {
    /// Estimate by the detections; none before the first.
    pub fn estimate(&self) -> Option<Estimate<R>> {
        self.memory.estimate
    }

    /// The noise limit, from the level of the noise at the last detection [OP unit]; none where it is not known.
    pub fn noise_floor(&self) -> Option<R> {
        self.memory.noise_floor
    }

    /// The estimate, if it is above the noise limit.
    pub fn shown(&self) -> Option<Estimate<R>> {
        shown(self.memory.estimate, self.memory.noise_floor)
    }

    /// Whether the detections were made with a Kp that is a default.
    pub fn kp_defaulted(&self) -> bool {
        self.memory.kp_defaulted
    }

    /// The detections behind the estimate, the oldest first [OP unit].
    pub fn window(&self) -> impl Iterator<Item = R> {
        self.memory.window.detections()
    }

    /// This state's place in the signals, with nothing concluded from the half-periods before it.
    pub fn unjudged(&self) -> Self {
        Self {
            memory: Conclusions { previous_delta_y: self.memory.previous_delta_y, ..Conclusions::default() },
            ..*self
        }
    }

    /// Number of accepted half-periods so far.
    pub fn accepted(&self) -> u32 {
        self.memory.accepted
    }

    /// Takes `kp` for the static process gain from the next half-period on, in place of the one in the settings; `None`, 0 and what
    /// is no number: that one again [PV unit/OP unit].
    pub fn set_kp(&mut self, kp: Option<R>) {
        self.memory.kp = kp.filter(|kp| kp.is_number() && *kp != R::ZERO);
    }

    /// The Kp that has been [set](Self::set_kp) [PV unit/OP unit].
    pub fn kp(&self) -> Option<R> {
        self.memory.kp
    }

    /// The filtered PV now [PV unit].
    pub fn filtered_pv(&self) -> R {
        self.signal.pv.y2.value()
    }

    /// The filtered PV now [PV unit]; none while the filter waits for a sample that can be used.
    #[inline(always)]
    pub fn observed(&self) -> Option<R> {
        if self.signal.pv.started { Some(self.filtered_pv()) } else { None }
    }
}

impl<R: Real> Detector<R> {
    /// A detector of these blocks. `max_h` \[s\] > 0, at most 10⁹: a longer step is a gap. `op_limits` \[OP unit\], low < high: an OP at
    /// or beyond one of them is saturated.
    pub fn new(
        filter: SecondOrderFilter<R>,
        width: Width<R>,
        net: SafetyNet<R>,
        detections: MedianMean,
        max_h: R,
        op_limits: Option<(R, R)>,
    ) -> Result<Self, ParameterError> {
        require("max_h", max_h, max_h > R::ZERO && max_h <= R::of(1e9), "greater than 0 s, at most 1e9 s")?;
        checked(op_limits)?;
        Ok(Self { filter, width, net, detections, max_h, op_limits, kp_defaulted: false })
    }

    /// The width block, for what it is made of.
    pub fn width(&self) -> &Width<R> {
        &self.width
    }

    /// Result of the half-period under way as if it ended now, with setpoint `sp` and the slope of PV that it began with. The
    /// state does not change.
    pub fn under_way(&self, state: &DetectorState<R>, sp: R) -> HalfPeriodResult<R> {
        let DetectorState { signal, mut memory, .. } = *state;
        let half = signal.half.so_far(signal.crossing.sign, sp, signal.op.y2.value());
        self.judge(&mut memory, half, signal.op.started, &signal.noise)
    }

    /// Takes one sample; gives the record of the half-period that it ended, if it did.
    pub fn update(&self, state: &mut DetectorState<R>, sample: &Sample<R>) -> Option<HalfPeriodResult<R>> {
        self.update_filtered(state, sample, sample.pv)
    }

    /// Takes one sample whose PV comes filtered: `raw` is PV as measured, of which the noise is estimated.
    pub fn update_filtered(
        &self,
        state: &mut DetectorState<R>,
        sample: &Sample<R>,
        raw: R,
    ) -> Option<HalfPeriodResult<R>> {
        let &Sample { h, sp, pv, op, flags } = sample;
        let ended = match op {
            Some(op) => self.observe::<true>(&mut state.signal, h, sp, pv, op, flags, raw),
            None => self.observe::<false>(&mut state.signal, h, sp, pv, R::ZERO, flags, raw),
        };
        ended.map(|half| self.judge(&mut state.memory, half, op.is_some(), &state.signal.noise))
    }

    /// Judges a half-period again that a detector with another Kp has put on record; in their order, from
    /// [`DetectorState::unjudged`]. Kp enters only once a half-period has ended. `passed` \[s\] is the time of half-periods
    /// since the one judged before that are not judged again: too short, in automatic and without a break.
    ///
    /// It gives the bits of a pass over the samples, with two exceptions: time that was passed over enters as one sum, and a
    /// half-period in which numbers overflowed with the other Kp stays bad.
    pub fn judge_again(
        &self,
        state: &mut DetectorState<R>,
        record: &HalfPeriodResult<R>,
        passed: R,
    ) -> HalfPeriodResult<R> {
        let m = &mut state.memory;
        let last = core::mem::replace(&mut m.previous_delta_y, record.previous_delta_y);
        if passed > R::ZERO {
            m.excess.add(-passed);
        }
        let judged = self.conclude(m, record.half, self.width.again(&record.parts, &record.half), || record.sigma);
        m.previous_delta_y = last;
        judged
    }

    /// The signal after one sample more, and its error; none where the sample does not continue it: not in time, of bad
    /// quality, or with a value that is no measurement. In SP and PV such a value shows in the error.
    #[inline(always)]
    fn advance<const OP: bool>(
        &self,
        s: &Signal<R>,
        h: R,
        sp: R,
        pv: R,
        op: R,
        flags: Status,
    ) -> Option<(SecondOrderFilterState<R>, SecondOrderFilterState<R>, R)> {
        if s.broken != 0 || !self.in_time(h) || flags & BAD != 0 {
            return None;
        }
        let (mut y, mut u) = (s.pv, s.op);
        self.filter.update(&mut y, pv, h);
        let e = y.y2.to(sp);
        if !e.is_measurable() || (OP && !op.is_measurable()) {
            return None;
        }
        if OP {
            self.filter.update(&mut u, op, h);
        }
        Some((y, u, e))
    }

    /// Whether the sample came within the usual time.
    #[inline(always)]
    fn in_time(&self, h: R) -> bool {
        h > R::ZERO && h <= self.max_h
    }

    /// The flags of a sample, with those that OP at its limit adds.
    #[inline(always)]
    fn with_limits<const OP: bool>(&self, flags: Status, op: R) -> Status {
        match self.op_limits {
            Some((low, high)) if OP => {
                flags | (if op <= low { AT_LOW } else { 0 }) | (if op >= high { AT_HIGH } else { 0 })
            }
            _ => flags,
        }
    }

    /// Takes a sample into the half-period; gives the half-period where it ended.
    #[allow(clippy::too_many_arguments)]
    fn observe<const OP: bool>(
        &self,
        s: &mut Signal<R>,
        h: R,
        sp: R,
        pv: R,
        op: R,
        flags: Status,
        raw: R,
    ) -> Option<HalfPeriod<R>> {
        if let Some(next) = self.advance::<OP>(s, h, sp, pv, op, flags) {
            return self.observe_good::<OP>(s, next, h, sp, op, flags, raw);
        }
        let ended;
        (*s, ended) = self.observe_break::<OP>(*s, h, sp, pv, op, flags, raw);
        ended
    }

    /// The ordinary sample: crossing and integrals.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn observe_good<const OP: bool>(
        &self,
        s: &mut Signal<R>,
        (y, u, e): (SecondOrderFilterState<R>, SecondOrderFilterState<R>, R),
        h: R,
        sp: R,
        op: R,
        flags: Status,
        raw: R,
    ) -> Option<HalfPeriod<R>> {
        s.noise.update(raw);
        let moved = y.y2.since(s.pv.y2);
        (s.pv, s.op) = (y, u);
        let sign = s.crossing.sign;
        let mut ended = None;
        if s.crossing.update(e) {
            ended = Some(s.turn(sign, sp, moved / h, u.y2.value()));
        }
        s.half.add(e, h, self.with_limits::<OP>(flags, op));
        s.half.widen(sp);
        ended
    }

    /// The first sample, a repeated time, a gap, a bad value, and the first good sample after any of them. State in,
    /// state out: the caller's copy can stay in registers.
    #[cold]
    #[allow(clippy::too_many_arguments)]
    fn observe_break<const OP: bool>(
        &self,
        mut s: Signal<R>,
        h: R,
        sp: R,
        pv: R,
        op: R,
        flags: Status,
        raw: R,
    ) -> (Signal<R>, Option<HalfPeriod<R>>) {
        let fresh = !s.pv.started && s.half.is_empty();
        if h == R::ZERO && !fresh {
            s.half.mark(flags);
            return (s, None);
        }
        let in_time = self.in_time(h);
        // A sample that is in time and continues no complete signal is bad; else the signal would start at it.
        let startable = flags & BAD == 0 && (sp - pv).is_measurable() && (!OP || op.is_measurable());
        let good = startable && (s.broken != 0 || !in_time);
        let mut ended = None;
        if s.broken == 0 || !in_time {
            let cause = (if in_time { 0 } else { DATA_GAP }) | (if good { 0 } else { BAD });
            if !s.half.is_empty() {
                ended = Some(s.half.break_off(s.crossing.sign, cause));
            }
            s.noise.interrupt();
            s = Signal { broken: cause, noise: s.noise, ..Signal::default() };
        }
        if !good {
            s.broken |= BAD;
            s.half.add_unusable(flags | s.broken);
            return (s, ended);
        }
        s.noise.update(raw);
        // The filter starts at this value; the step that led here is not observed time.
        let yf = self.filter.update(&mut s.pv, pv, R::ZERO);
        let opf = if OP { self.filter.update(&mut s.op, op, R::ZERO) } else { R::ZERO };
        s.crossing.update(sp - yf);
        s.half.resume(sp, R::ZERO, opf, s.broken);
        s.half.add(sp - yf, R::ZERO, self.with_limits::<OP>(flags, op));
        s.broken = 0;
        (s, ended)
    }

    /// Width, safety net and filter of detections for one half-period.
    #[inline(always)]
    fn judge(
        &self,
        m: &mut Conclusions<R>,
        half: HalfPeriod<R>,
        op_known: bool,
        noise: &NoiseLevel<R>,
    ) -> HalfPeriodResult<R> {
        self.conclude(m, half, self.width.with_kp(m.kp).of(&half, op_known), || noise.sigma())
    }

    /// Safety net and filter of detections, once the width is known; `sigma` is PV's noise at the end of the half-period.
    #[inline(always)]
    fn conclude(
        &self,
        m: &mut Conclusions<R>,
        mut half: HalfPeriod<R>,
        mut parts: WidthParts<R>,
        sigma: impl FnOnce() -> Option<R>,
    ) -> HalfPeriodResult<R> {
        if !parts.are_numbers() {
            half.flags |= BAD;
            parts = WidthParts::default();
        }
        let kp_defaulted = self.kp_defaulted && m.kp.is_none();
        if m.kp_defaulted != kp_defaulted {
            // Detections with a default and with a Kp that is known make no estimate together.
            (m.window, m.estimate, m.noise_floor) = (MedianMeanState::default(), None, None);
            (m.rejected, m.kp_defaulted) = (0, kp_defaulted);
        }
        let previous_delta_y = m.previous_delta_y;
        let settled = m.estimate.filter(|estimate| estimate.count == self.detections.n());
        let d_hat_before = settled.map(|estimate| estimate.value);
        let mask = self.net.check(&half, &parts, &self.width, previous_delta_y, d_hat_before);
        let broken = half.flags & (DATA_GAP | BAD | NOT_AUTO) != 0;
        let sigma = if mask & !Reason::TooSmall.bit() == 0 { sigma() } else { None };
        if mask == 0 {
            self.accept(m, parts.d, sigma);
        } else if mask == Reason::TooSmall.bit() {
            self.reconsider(m, parts.d, half.delta_t, sigma);
        } else if !broken {
            m.excess.add(-half.delta_t);
        }
        m.previous_delta_y = if broken { None } else { Some(half.delta_y) };
        let &mut Conclusions { estimate, noise_floor, kp_defaulted, .. } = m;
        HalfPeriodResult {
            half,
            parts,
            mask,
            previous_delta_y,
            d_hat_before,
            estimate,
            noise_floor,
            sigma,
            kp_defaulted,
        }
    }

    /// Takes a detection into the estimate.
    #[inline(never)]
    fn accept(&self, m: &mut Conclusions<R>, detection: R, sigma: Option<R>) {
        m.estimate = Some(self.detections.update(&mut m.window, detection));
        m.noise_floor = sigma.map(|sigma| self.width.with_kp(m.kp).noise_floor(sigma));
        m.accepted = m.accepted.saturating_add(1);
        m.rejected = 0;
    }

    /// Keeps (5.1) from locking out a gap that has become smaller, or that the first detections got wrong.
    #[inline(never)]
    fn reconsider(&self, m: &mut Conclusions<R>, detection: R, delta_t: R, sigma: Option<R>) {
        if m.rejected == 0 {
            m.candidates = MedianMeanState::default();
            m.excess = R::Sum::default();
        }
        m.excess.add(delta_t);
        let n = u32::from(self.detections.n());
        let found = self.detections.update(&mut m.candidates, detection);
        m.rejected = m.rejected.saturating_add(1);
        let agree = u32::from(found.count) == n && 3 * u32::from(found.kept) >= 2 * n;
        if (agree && m.excess.value() >= R::ZERO) || m.rejected >= 10 * n {
            m.window = m.candidates;
            m.estimate = Some(found);
            m.noise_floor = sigma.map(|sigma| self.width.with_kp(m.kp).noise_floor(sigma));
            m.rejected = 0;
        }
    }
}

/// Limits of the output that are in order, where there are any.
pub(crate) fn checked<R: Real>(op_limits: Option<(R, R)>) -> Result<Option<(R, R)>, ParameterError> {
    if let Some((low, high)) = op_limits {
        require("op_high", high, true, "a number above op_low")?;
        require("op_low", low, low < high, "a number below op_high")?;
    }
    Ok(op_limits)
}

/// The estimate, if it is not below the noise limit.
fn shown<R: Real>(estimate: Option<Estimate<R>>, noise_floor: Option<R>) -> Option<Estimate<R>> {
    estimate.filter(|estimate| noise_floor.is_none_or(|floor| estimate.value >= floor))
}
