//! The detector as a module beside a controller.

use crate::modules::{Backward, Forward};
use crate::status::{AT_HIGH, AT_LOW, BAD, GAP, NOT_AUTO, Status, WRONG_SIGN};
use crate::{
    Compensation, CompensationSample, CompensationSettings, CompensationState, Detector, DetectorSettings,
    DetectorState, Estimate, MedianMean, MedianMeanState, OverCompensation, OverCompensationState, OverWarning,
    ParameterError, Real, Reason, Record, Sample, Saturation, Sum, WrongSign, WrongSignState,
};

/// So many half-periods in a row in which OP went against K tell that the detector was told the wrong sign: of those that are
/// longer than so many Ti, and in which nothing but K and Ti moved OP.
const AGAINST: u8 = 3;
const LONG: f64 = 3.0;
const DISTURBED: u16 = Reason::Gap.bit()
    | Reason::BadQuality.bit()
    | Reason::NotAuto.bit()
    | Reason::Saturated.bit()
    | Reason::SpMoved.bit();

/// Settings of a [`BacklashDetection`] (thesis 6.4).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BacklashDetectionSettings<R> {
    /// The detector's, with those of the controller beside it.
    pub detector: DetectorSettings<R>,
    /// Compensation, where there is one. Its `k` and `limits` are those of the controller above, whatever stands there.
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
/// for the compensation is worked off in the scan after it, so that the worst scan takes little longer than the others.
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
    detector: Detector<R>,
    detections: MedianMean,
    sign: Option<WrongSign<R>>,
    max_h: R,
    long: R,
    compensation: Option<(Compensation<R>, OverCompensation<R>)>,
}

/// State of a [`BacklashDetection`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BacklashDetectionState<R: Real> {
    /// Whether a person wants compensation.
    pub compensate: bool,
    /// The detector; it holds the estimate of what is left of the gap.
    pub detector: DetectorState<R>,
    /// The last half-period that ended, with what was concluded from it.
    pub last: Option<Record<R>>,
    /// The compensation: u_FF, the size in force, and what stands in its way.
    pub compensation: CompensationState<R>,
    /// The warnings of over-compensation.
    pub over: OverWarning,
    /// What the detections say of the whole gap, where there have been any. Compensation goes by it, shown or not: it only makes it
    /// smaller.
    pub whole: Option<Estimate<R>>,
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
    sp: Forward<R>,
    pv: Forward<R>,
    #[cfg_attr(feature = "serde", serde(default))]
    raw: R,
    h: R,
    u_ff: R,
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
            h: R::ZERO,
            u_ff: R::ZERO,
        }
    }
}

impl<R: Real> BacklashDetectionState<R> {
    /// Forgets all detections. A compensation that went by them is taken away, without a bump.
    pub fn reset(&mut self) {
        let Self { compensate, compensation, sign, sp, pv, raw, h, u_ff, .. } = *self;
        *self = Self { compensate, compensation, sign, sp, pv, raw, h, u_ff, ..Self::default() };
    }

    /// Ends the half-period under way as a *gap* with the next sample: for whoever changes K or Ti, which no width can be read across.
    pub fn cut(&mut self) {
        self.cut = true;
    }

    /// The whole gap, if it is more than noise can feign.
    pub fn shown(&self) -> Option<Estimate<R>> {
        self.whole.filter(|whole| self.detector.noise_floor().is_none_or(|floor| whole.value >= floor))
    }

    /// What is wrong: [`WRONG_SIGN`], or 0.
    pub fn error(&self) -> Status {
        if self.sign.found || self.against >= AGAINST { WRONG_SIGN } else { 0 }
    }
}

impl<R: Real> BacklashDetection<R> {
    /// Checks the settings.
    pub fn new(settings: BacklashDetectionSettings<R>) -> Result<Self, ParameterError> {
        let BacklashDetectionSettings { detector, compensation } = settings;
        let DetectorSettings { k, ti, n, max_h, op_limits, .. } = detector;
        let limits = match op_limits {
            Some((low, high)) => Saturation::new(low, high)?,
            None => Saturation::none(),
        };
        let detections = MedianMean::new(n)?;
        Ok(Self {
            detector: Detector::of(&detector)?,
            detections,
            sign: op_limits.map(|_| WrongSign::new(k, ti, limits)).transpose()?,
            max_h,
            long: R::of(LONG) * ti,
            compensation: match compensation {
                Some(given) => {
                    let compensation = Compensation::new(CompensationSettings { k, limits, ..given })?;
                    Some((compensation, OverCompensation::new(k, ti)?))
                }
                None => None,
            },
        })
    }

    /// Takes setpoint, process value and the time since the last scan `h` \[s\]; gives u_FF.
    #[inline(always)]
    pub fn forward(&self, state: &mut BacklashDetectionState<R>, sp: Forward<R>, pv: Forward<R>, h: R) -> Forward<R> {
        self.forward_filtered(state, sp, pv, pv.value, h)
    }

    /// The same where PV comes filtered: `raw` is PV as measured.
    #[inline(always)]
    pub(super) fn forward_filtered(
        &self,
        state: &mut BacklashDetectionState<R>,
        sp: Forward<R>,
        pv: Forward<R>,
        raw: R,
        h: R,
    ) -> Forward<R> {
        (state.sp, state.pv, state.raw, state.h) = (sp, pv, raw, h);
        state.u_ff = state.compensation.u_ff.value();
        Forward::new(state.u_ff, 0)
    }

    /// Takes what the controller tells at its feed-forward, where that is connected; learns from the sample of this scan.
    #[inline(always)]
    pub fn backward(&self, state: &mut BacklashDetectionState<R>, back: Option<Backward<R>>) {
        let told = back.map_or(0, |back| back.flags & (AT_LOW | AT_HIGH | NOT_AUTO));
        let flags = told | (state.sp.flags | state.pv.flags) & BAD;
        let (h, sp) = (state.h, state.sp.value);
        let op = back.map(|back| back.tracking - state.u_ff);
        if let (Some(last), true) = (&state.last, state.due) {
            if let Some((_, warning)) = &self.compensation {
                state.over = warning.update(&mut state.warning, &last.half, h, state.size);
                if last.mask == 0 {
                    state.whole = Some(self.detections.update(&mut state.window, last.parts.d + state.size));
                }
            }
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
        if state.due {
            (state.last, state.size) = (record, R::of(2.0) * state.compensation.half.value());
        }
        if let (Some(sign), Some(back)) = (&self.sign, back) {
            let gap = if h <= self.max_h { 0 } else { GAP };
            sign.update(&mut state.sign, sp, state.detector.filtered_pv(), back.tracking, h, flags | gap);
        }
        let Some((compensation, _)) = &self.compensation else {
            if state.compensation.u_ff.value() != R::ZERO {
                state.compensation = CompensationState::default();
            }
            return;
        };
        let sample = CompensationSample {
            e: sp - state.detector.filtered_pv(),
            u: op.unwrap_or(R::ZERO),
            h,
            d_hat: state.whole.map(|whole| whole.value),
            over: state.over.relay,
            enable: state.compensate && op.is_some(),
            flags: if state.error() == 0 { flags } else { flags | AT_LOW | AT_HIGH },
        };
        compensation.update(&mut state.compensation, &sample);
    }
}
