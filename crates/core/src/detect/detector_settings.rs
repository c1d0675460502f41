//! Settings of a detector, with all defaults.

use super::detector::checked;
use crate::Conditions;
use crate::error::require;
use crate::{Detector, MedianMean, ParameterError, Real, SafetyNet, SecondOrderFilter, Width};

/// Steps of the usual length that a step may be long without being a gap.
pub const DATA_GAP_STEPS: f64 = 3.0;
/// Length of the filter of detections (thesis 7.3).
pub const DETECTIONS: u32 = 9;
/// Process gain [%/%] where none is known but both spans are (thesis 7.2.2).
pub const KP_DEFAULT: f64 = 1.5;

/// The size of the process gain Kp [PV unit/OP unit] that a width is worked out with, and whether it is a default: the one `given`, else
/// [`KP_DEFAULT`] where the `spans` of PV and OP are known. An integrating process has none.
///
/// ```
/// use glapp_core::process_gain;
/// assert_eq!(process_gain(None, Some((50.0, 100.0)), false), (Some(0.75), true));
/// assert_eq!(process_gain(None, Some((50.0, 100.0)), true), (None, false));
/// assert_eq!(process_gain(Some(2.0), None, false), (Some(2.0), false));
/// ```
pub fn process_gain<R: Real>(given: Option<R>, spans: Option<(R, R)>, integrating: bool) -> (Option<R>, bool) {
    match (given, spans) {
        _ if integrating => (None, false),
        (Some(kp), _) => (Some(kp), false),
        (None, Some((pv, op))) => (Some(R::of(KP_DEFAULT) * (pv / op)), true),
        (None, None) => (None, false),
    }
}

/// Settings of a [`Detector`]: those of the controller that it watches, and its own.
///
/// ```
/// use glapp_core::{Detector, DetectorSettings};
/// let settings = DetectorSettings { kp: Some(2.0), ..DetectorSettings::new(0.5, 10.0, 0.0, 1.0) };
/// assert_eq!((settings.tf, settings.n, settings.max_h), (1.0, 9, 3.0));
/// assert!(Detector::of(&settings).is_ok());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DetectorSettings<R> {
    /// Gain K ≠ 0 of the controller in ideal form, negative for direct action [OP unit/PV unit].
    pub k: R,
    /// Integral time of the controller > 0 \[s\].
    pub ti: R,
    /// Derivative time of the controller ≥ 0 \[s\]; none: the width is taken from the output's own travel, or without
    /// its derivative part.
    pub td: Option<R>,
    /// Setpoint weight of the controller, 0 to 1.
    pub b: R,
    /// Static process gain ≠ 0, where known [PV unit/OP unit]. None: [`Self::gain`] tells what stands for it.
    pub kp: Option<R>,
    /// Span of the process value > 0, where known \[PV unit\].
    pub pv_span: Option<R>,
    /// Whether the process is known to integrate: it has no Kp, given or not.
    #[cfg_attr(feature = "serde", serde(default))]
    pub integrating: bool,
    /// Time constant of the detector's filter ≥ 0 \[s\]; 0 where PV comes filtered.
    pub tf: R,
    /// Length of the filter of detections, odd, 1 to 31.
    pub n: u32,
    /// A longer time between samples, > 0, is a gap \[s\].
    pub max_h: R,
    /// Lower and upper limit of the output, low < high, where known: at or beyond them it is saturated.
    pub op_limits: Option<(R, R)>,
    /// Span of the output > 0, where known: no gap is wider. None: that of the limits [OP unit].
    pub op_span: Option<R>,
    /// Conditions of the safety net that are checked.
    pub conditions: Conditions,
}

impl<R: Real> DetectorSettings<R> {
    /// Defaults for a controller whose samples usually lie `h` \[s\] apart: b = 1, Kp and limits not known, the filter of
    /// [`filter_time`](Self::filter_time), N = 9, a gap above 3h, all conditions.
    pub fn new(k: R, ti: R, td: R, h: R) -> Self {
        Self {
            k,
            ti,
            td: Some(td),
            b: R::ONE,
            kp: None,
            pv_span: None,
            integrating: false,
            tf: Self::filter_time(ti, td),
            n: DETECTIONS,
            max_h: R::of(DATA_GAP_STEPS) * h,
            op_limits: None,
            op_span: None,
            conditions: Conditions::default(),
        }
    }

    /// The process gain in force [PV unit/OP unit], and whether it is a default: Kp where it is given, else 1.5 %/% with the sign
    /// of K where both spans are given and the process does not integrate (thesis 7.2.2), else none.
    ///
    /// What an estimate with a default says is shown with that mark, and nothing is compensated by it.
    ///
    /// ```
    /// use glapp_core::DetectorSettings;
    /// let bare = DetectorSettings::new(-0.5, 10.0, 0.0, 1.0);
    /// assert_eq!(bare.gain(), (None, false));
    /// let spanned = DetectorSettings { pv_span: Some(50.0), op_span: Some(100.0), ..bare };
    /// assert_eq!(spanned.gain(), (Some(-0.75), true));
    /// assert_eq!(DetectorSettings { kp: Some(-2.0), ..spanned }.gain(), (Some(-2.0), false));
    /// assert_eq!(DetectorSettings { integrating: true, ..spanned }.gain(), (None, false));
    /// ```
    pub fn gain(&self) -> (Option<R>, bool) {
        let (kp, defaulted) = process_gain(self.kp, self.pv_span.zip(self.op_span), self.integrating);
        let sign = if self.k < R::ZERO { -R::ONE } else { R::ONE };
        (if defaulted { kp.map(|kp| sign * kp) } else { kp }, defaulted)
    }

    /// The shortest filter that serves (2.1): Td/5 behind a controller with derivative action, Ti/10 behind one without \[s\].
    pub fn filter_time(ti: R, td: R) -> R {
        if td > R::ZERO { td / R::of(5.0) } else { ti / R::of(10.0) }
    }
}

impl<R: Real> Detector<R> {
    /// A detector by its settings.
    ///
    /// # Errors
    /// Where one of them is out of its bounds.
    pub fn of(settings: &DetectorSettings<R>) -> Result<Self, ParameterError> {
        let &DetectorSettings { k, ti, td, b, tf, n, max_h, op_limits, op_span, conditions, .. } = settings;
        // Settings that others are calculated from are checked first.
        Width::new(k, ti, td, b, settings.kp)?;
        let span = op_span.or(checked(op_limits)?.map(|(low, high)| high - low));
        let net = SafetyNet { conditions, ..SafetyNet::new(span)? };
        if let Some(span) = settings.pv_span {
            require("pv_span", span, span > R::ZERO, "greater than 0")?;
        }
        let (kp, defaulted) = settings.gain();
        let width = Width::new(k, ti, td, b, kp)?;
        let mut detector =
            Detector::new(SecondOrderFilter::new(tf)?, width, net, MedianMean::new(n)?, max_h, op_limits)?;
        detector.kp_defaulted = defaulted;
        Ok(detector)
    }
}
