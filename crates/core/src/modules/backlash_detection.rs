//! The detector as a module beside a controller.

use crate::modules::{Backward, Forward};
use crate::status::{AT_HIGH, AT_LOW, BAD, DATA_GAP, NOT_AUTO, Status, WRONG_SIGN};
use crate::{
    Compensation, CompensationSample, CompensationSettings, CompensationState, Correction, CorrectionState, Detector,
    DetectorSettings, DetectorState, Estimate, HalfPeriodResult, MedianMean, MedianMeanState, OverCompensation,
    OverCompensationState, OverWarning, ParameterError, Real, Reason, Sample, Saturation, Source, Standing, Sum,
    WrongSign, WrongSignState,
};

/// Number of half-periods in a row, with OP against K, that show a wrong sign: only those longer than the given number
/// of Ti, in which nothing but K and Ti moved OP.
const AGAINST: u8 = 3;
const LONG: f64 = 3.0;
/// Longest filter of PV, in Ti, behind which the estimate may be compensated by (thesis 8.2 has that by default).
const SMOOTH: f64 = 0.5;
const DISTURBED: u16 = Reason::Gap.bit()
    | Reason::BadQuality.bit()
    | Reason::NotAuto.bit()
    | Reason::Saturated.bit()
    | Reason::SpMoved.bit();

named! {
    /// Why the on-line estimate may not be compensated by. The first that holds, in this order.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[repr(u8)]
    pub enum Unfit {
        /// No detection yet.
        NoDetection = 1 => "no_detection",
        /// A fit contradicts it.
        Contradicted = 2 => "contradicted",
        /// Fewer detections than the filter is long.
        Provisional = 3 => "provisional",
        /// The estimate is below the noise limit.
        Noise = 4 => "noise",
        /// The estimate uses a default Kp, or a filter of PV longer than Ti/2.
        Crude = 5 => "crude",
    }
}

/// Settings of a [`BacklashDetection`] (thesis 6.4).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BacklashDetectionSettings<R> {
    /// The detector's, with those of the controller beside it.
    pub detector: DetectorSettings<R>,
    /// Compensation, where there is one. Its `k`, `ti` and `limits` are those of the controller above, whatever stands there.
    /// Taken out of the settings while it is in force, it is gone at once.
    pub compensation: Option<CompensationSettings<R>>,
}

/// Detection, estimation and compensation of backlash beside a controller (thesis 6.4): a [`Detector`] with connections.
///
/// It takes setpoint and process value on branches of the connections that enter the controller, and its output, u_FF,
/// goes to the controller's feed-forward. What comes back there is all that it has to know of the loop (7.1): that
/// something is at a limit, that the controller is not in automatic, and the output in effect. Where the output is not
/// connected, it sees no flags and no output; then only Δu below the span of the output is asked, and nothing is
/// compensated.
///
/// It learns in the backward pass: the u_FF that it hands over in a scan was made by the scan before. While it
/// compensates, the detector shows what is left of the gap; the whole is the median/mean of what was left and the size in
/// force, detection by detection. That may lower the size that a person or the fit gave, and never raises it. Both
/// warnings of over-compensation are shown; the relay withdraws it, where the settings say so. What a half-period means
/// for the compensation is worked off in the scan after it, and what it means for the corrected width in the scan after that, so that the worst
/// scan takes little longer than the others.
///
/// Two things tell that K has the wrong sign, [`WRONG_SIGN`]: OP goes to its limit and PV runs away from SP ([`WrongSign`], where
/// limits are known), which holds until PV crosses SP; or in three half-periods in a row, each longer than 3Ti and undisturbed, OP
/// went the other way than K says, so that the controller beside it has a K of the other sign, which holds until one in which it
/// does not. Either way compensation is taken away as at a limit.
///
/// It belongs in the inner loop of a cascade (8.3): what comes out of an outer controller is distorted by the inner
/// loop before it reaches the gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BacklashDetection<R> {
    settings: DetectorSettings<R>,
    pub(super) detector: Detector<R>,
    detections: MedianMean,
    sign: Option<WrongSign<R>>,
    max_h: R,
    long: R,
    pub(super) correction: Correction<R>,
    /// Kp in force, and whether it is a default.
    pub(super) gain: (Option<R>, bool),
    /// The filter of PV is so long that nothing may be compensated by the estimate.
    smooth: bool,
    compensation: Option<(Compensation<R>, OverCompensation<R>)>,
}

/// State of a [`BacklashDetection`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BacklashDetectionState<R: Real> {
    /// Whether a person wants compensation.
    pub compensate: bool,
    /// The detector; it holds the estimate of the rest of the gap.
    pub detector: DetectorState<R>,
    /// The last half-period that ended, with its result.
    pub last: Option<HalfPeriodResult<R>>,
    /// The compensation: u_FF, the size in force, and its obstacle.
    pub compensation: CompensationState<R>,
    /// The warnings of over-compensation.
    pub over: OverWarning,
    /// Estimate of the whole gap; none before the first detection. Compensation goes by it, shown or not: it only makes
    /// it smaller.
    pub whole: Option<Estimate<R>>,
    /// OP without u_FF in the last scan, where it is known [OP unit].
    pub u_fb: Option<R>,
    #[cfg_attr(feature = "serde", serde(default))]
    pub(super) correction: CorrectionState<R>,
    /// The detections of `whole` are none to compensate by: made with a Kp that is a default, or behind too long a filter.
    #[cfg_attr(feature = "serde", serde(default))]
    unfit: bool,
    /// Too long a filter in the half-period under way.
    #[cfg_attr(feature = "serde", serde(default))]
    smooth: bool,
    window: MedianMeanState<R>,
    warning: OverCompensationState<R>,
    sign: WrongSignState<R>,
    /// Half-periods in a row in which OP went against K.
    against: u8,
    /// The last half-period is still to be worked off, with the size in force when it ended.
    due: bool,
    /// K or Ti have changed: the half-period under way ends as a gap.
    #[cfg_attr(feature = "serde", serde(default))]
    cut: bool,
    size: R,
    pub(super) sp: Forward<R>,
    pv: Forward<R>,
    #[cfg_attr(feature = "serde", serde(default))]
    raw: R,
    /// PV for u_FF and the watch for the wrong sign, where it is not the output of the detector's filter.
    beside: Option<R>,
    h: R,
    /// The u_FF that the output in effect holds.
    pub(super) u_ff: R,
}

impl<R: Real> Default for BacklashDetectionState<R> {
    fn default() -> Self {
        let nothing = Forward::new(R::ZERO, 0);
        Self {
            compensate: false,
            detector: DetectorState::default(),
            last: None,
            compensation: CompensationState::default(),
            over: OverWarning::default(),
            whole: None,
            u_fb: None,
            correction: CorrectionState::default(),
            unfit: false,
            smooth: false,
            window: MedianMeanState::default(),
            warning: OverCompensationState::default(),
            sign: WrongSignState::default(),
            against: 0,
            due: false,
            cut: false,
            size: R::ZERO,
            sp: nothing,
            pv: nothing,
            raw: R::ZERO,
            beside: None,
            h: R::ZERO,
            u_ff: R::ZERO,
        }
    }
}

impl<R: Real> BacklashDetectionState<R> {
    /// Forgets all detections. A compensation that went by them is taken away, without a bump.
    pub fn reset(&mut self) {
        let Self { compensate, compensation, sign, sp, pv, raw, beside, h, u_ff, .. } = *self;
        *self = Self { compensate, compensation, sign, sp, pv, raw, beside, h, u_ff, ..Self::default() };
    }

    /// Ends the half-period under way as a *gap* with the next sample: for whoever changes K or Ti, which no width can be read across.
    pub fn cut(&mut self) {
        self.cut = true;
    }

    /// The whole gap, if it is above the noise limit.
    pub fn shown(&self) -> Option<Estimate<R>> {
        self.whole.filter(|whole| self.detector.noise_floor().is_none_or(|floor| whole.value >= floor))
    }

    /// The whole gap as far as it may be compensated by: none where it was worked out with a Kp that is a default, or behind a filter of PV
    /// longer than Ti/2.
    pub fn compensable(&self) -> Option<Estimate<R>> {
        if self.unfit { None } else { self.whole }
    }

    /// Error: [`WRONG_SIGN`], or 0.
    pub fn error(&self) -> Status {
        if self.sign.found || self.against >= AGAINST { WRONG_SIGN } else { 0 }
    }
}

impl<R: Real> BacklashDetection<R> {
    /// Checks the settings.
    pub fn new(settings: BacklashDetectionSettings<R>) -> Result<Self, ParameterError> {
        let BacklashDetectionSettings { detector, compensation } = settings;
        let DetectorSettings { k, ti, b, n, max_h, op_limits, integrating, .. } = detector;
        let gain = detector.gain();
        let known = gain.0.filter(|_| !gain.1);
        let checked = Detector::of(&detector)?;
        let limits = match op_limits {
            Some((low, high)) => Saturation::new(low, high)?,
            None => Saturation::none(),
        };
        Ok(Self {
            settings: detector,
            detector: checked,
            detections: MedianMean::new(n)?,
            sign: op_limits.map(|_| WrongSign::new(k, ti, limits)).transpose()?,
            max_h,
            long: R::of(LONG) * ti,
            correction: Correction::new(k, ti, b, known, integrating)?,
            gain,
            smooth: detector.tf > R::of(SMOOTH) * ti,
            compensation: match compensation {
                Some(given) => {
                    let compensation = Compensation::new(CompensationSettings { k, ti, limits, ..given })?;
                    Some((compensation, OverCompensation::new(k, ti)?))
                }
                None => None,
            },
        })
    }

    /// This module where PV comes through a filter with `tf` \[s\].
    pub(super) fn behind(self, tf: R) -> Self {
        Self { smooth: self.smooth || tf > R::of(SMOOTH) * self.settings.ti, ..self }
    }

    /// Settings it was made with; the compensation's `k`, `ti` and limits are those in force.
    pub fn settings(&self) -> BacklashDetectionSettings<R> {
        let compensation = self.compensation.as_ref().map(|(compensation, _)| *compensation.settings());
        BacklashDetectionSettings { detector: self.settings, compensation }
    }

    /// Takes setpoint, process value and the time since the last scan `h` \[s\]; gives u_FF.
    #[inline(always)]
    pub fn forward(&self, state: &mut BacklashDetectionState<R>, sp: Forward<R>, pv: Forward<R>, h: R) -> Forward<R> {
        self.forward_filtered(state, sp, pv, pv.value, None, h)
    }

    /// Computes forward where PV comes filtered: `raw` is PV as measured. `beside`: the PV for u_FF and the watch for the wrong sign,
    /// where that is not what the detector's filter gives.
    #[inline(always)]
    pub(super) fn forward_filtered(
        &self,
        state: &mut BacklashDetectionState<R>,
        sp: Forward<R>,
        pv: Forward<R>,
        raw: R,
        beside: Option<R>,
        h: R,
    ) -> Forward<R> {
        (state.sp, state.pv, state.raw, state.beside, state.h) = (sp, pv, raw, beside, h);
        state.u_ff = state.compensation.u_ff.value();
        Forward::new(state.u_ff, 0)
    }

    /// Takes the controller's report at its feed-forward, where that is connected; learns from the sample of this scan.
    #[inline(always)]
    pub fn backward(&self, state: &mut BacklashDetectionState<R>, back: Option<Backward<R>>) {
        let backward_flags = back.map_or(0, |back| back.flags & (AT_LOW | AT_HIGH | NOT_AUTO));
        self.learn(state, backward_flags, back.map(|back| back.tracking), None);
    }

    /// Source of the width to compensate; none: there is no compensation.
    pub fn source(&self) -> Option<Source> {
        let settings = self.compensation.as_ref().map(|(compensation, _)| compensation.settings())?;
        (settings.source != Source::Typed || settings.size > R::ZERO).then_some(settings.source)
    }

    /// Width from the chosen source of compensation.
    pub(super) fn width(&self, state: &BacklashDetectionState<R>) -> R {
        self.compensation.as_ref().map_or(R::ZERO, |(compensation, _)| compensation.width(&state.compensation))
    }

    /// The on-line estimate of the whole gap where it may be compensated by; else why not.
    pub fn may_compensate_by_estimate(&self, state: &BacklashDetectionState<R>) -> Result<R, Unfit> {
        let whole = state.whole.ok_or(Unfit::NoDetection)?;
        let contradicted =
            self.compensation.as_ref().is_some_and(|(compensation, _)| compensation.settings().contradicted);
        if contradicted {
            Err(Unfit::Contradicted)
        } else if whole.count < self.detections.n() {
            Err(Unfit::Provisional)
        } else if state.shown().is_none() {
            Err(Unfit::Noise)
        } else if state.compensable().is_none() {
            Err(Unfit::Crude)
        } else {
            Ok(whole.value)
        }
    }

    /// Learns from the sample of this scan, with its flags, the output in effect where it is known, and the obstacle to
    /// u_FF.
    #[inline(always)]
    pub(super) fn learn(
        &self,
        state: &mut BacklashDetectionState<R>,
        backward_flags: Status,
        output: Option<R>,
        hindered: Option<Standing>,
    ) {
        let flags = backward_flags | (state.sp.flags | state.pv.flags) & BAD;
        let (h, sp) = (state.h, state.sp.value);
        let op = output.map(|output| output - state.u_ff);
        state.u_fb = op;
        if !state.due {
            self.correction.conclude(&mut state.correction);
        }
        state.smooth |= self.smooth;
        if let (Some(last), true) = (&state.last, state.due) {
            if let Some((_, warning)) = &self.compensation {
                state.over = warning.update(&mut state.warning, &last.half, h, state.size);
                if last.mask == 0 {
                    let unfit = last.kp_defaulted || state.smooth;
                    if unfit != state.unfit {
                        (state.window, state.unfit) = (MedianMeanState::default(), unfit);
                    }
                    state.whole = Some(self.detections.update(&mut state.window, last.parts.d + state.size));
                }
            }
            state.smooth = self.smooth;
            if last.half.delta_t > self.long && last.mask & DISTURBED == 0 {
                let against = last.parts.op_travel + last.parts.delta_u / R::of(2.0) < R::ZERO;
                state.against = if against { AGAINST.min(state.against + 1) } else { 0 };
            }
        }
        // To the detector a step back in time is a gap.
        let since = if core::mem::take(&mut state.cut) { -R::ONE } else { h };
        let sample = Sample { h: since, sp, pv: state.pv.value, op, flags };
        let record = self.detector.update_filtered(&mut state.detector, &sample, state.raw);
        state.due = record.is_some();
        if let Some(record) = &record {
            self.correction.end(&mut state.correction, record);
            (state.last, state.size) = (Some(*record), R::of(2.0) * state.compensation.half.value());
        }
        // At a repeated time a value that is none is passed over by the detector, and has no noise.
        if let (Some(output), Some(yf)) = (output.filter(|output| output.is_measurable()), state.detector.observed()) {
            self.correction.add(&mut state.correction, h, sp, yf, output);
        } else {
            self.correction.interrupt(&mut state.correction);
        }
        let yf = state.beside.unwrap_or(state.detector.filtered_pv());
        if let (Some(sign), Some(output)) = (&self.sign, output) {
            let gap = if h <= self.max_h { 0 } else { DATA_GAP };
            sign.update(&mut state.sign, sp, yf, output, h, flags | gap);
        }
        self.compensate(state, (sp - yf, op, h), hindered, flags);
    }

    /// A scan in which nothing is read: u_FF goes to 0 by its ramp, or is 0 at once where `told` has [`NOT_AUTO`]. All else waits, and
    /// goes on as after a gap.
    pub fn pause(&self, state: &mut BacklashDetectionState<R>, backward_flags: Status, h: R) {
        state.cut = true;
        self.correction.interrupt(&mut state.correction);
        if let Some(sign) = &self.sign {
            sign.update(&mut state.sign, R::ZERO, R::ZERO, R::ZERO, h, DATA_GAP);
        }
        self.compensate(state, (R::ZERO, Some(R::ZERO), h), None, backward_flags & NOT_AUTO | BAD);
    }

    /// u_FF of the next scan, by the error, OP without u_FF where it is known and the time since the last scan.
    #[inline(always)]
    fn compensate(
        &self,
        state: &mut BacklashDetectionState<R>,
        (e, u, h): (R, Option<R>, R),
        hindered: Option<Standing>,
        flags: Status,
    ) {
        let Some((compensation, _)) = &self.compensation else {
            if state.compensation.u_ff.value() != R::ZERO {
                state.compensation = CompensationState::default();
            }
            return;
        };
        let by_estimate = compensation.settings().source == Source::Estimate;
        let sample = CompensationSample {
            e,
            u: u.unwrap_or(R::ZERO),
            h,
            d_hat: state.compensable().map(|whole| whole.value),
            offered: if by_estimate { self.may_compensate_by_estimate(state).ok() } else { None },
            over: state.over.relay,
            enable: state.compensate && u.is_some(),
            hindered,
            flags: if state.error() == 0 { flags } else { flags | AT_LOW | AT_HIGH },
        };
        compensation.update(&mut state.compensation, &sample);
    }
}
