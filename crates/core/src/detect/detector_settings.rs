//! What a detector is told, with all of its defaults.

use super::detector::checked;
use crate::Conditions;
use crate::{Detector, MedianMean, ParameterError, Real, SafetyNet, SecondOrderFilter, Width};

/// Steps of the usual length that a step may be long without being a gap.
pub const GAP_STEPS: f64 = 3.0;
/// Length of the filter of detections (thesis 7.3).
pub const DETECTIONS: u32 = 9;

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
    /// Its integral time > 0 \[s\].
    pub ti: R,
    /// Its derivative time ≥ 0 \[s\]; none: the width is taken from the output's own travel, or without its derivative part.
    pub td: Option<R>,
    /// Its setpoint weight, 0 to 1.
    pub b: R,
    /// Static process gain ≠ 0, where known [PV unit/OP unit].
    pub kp: Option<R>,
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
    /// Which conditions of the safety net are asked.
    pub conditions: Conditions,
}

impl<R: Real> DetectorSettings<R> {
    /// For a controller whose samples usually lie `h` \[s\] apart: b = 1, Kp and limits not known, the filter of
    /// [`filter_time`](Self::filter_time), N = 9, a gap above 3h, all conditions.
    pub fn new(k: R, ti: R, td: R, h: R) -> Self {
        Self {
            k,
            ti,
            td: Some(td),
            b: R::ONE,
            kp: None,
            tf: Self::filter_time(ti, td),
            n: DETECTIONS,
            max_h: R::of(GAP_STEPS) * h,
            op_limits: None,
            op_span: None,
            conditions: Conditions::default(),
        }
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
        let &DetectorSettings { k, ti, td, b, kp, tf, n, max_h, op_limits, op_span, conditions } = settings;
        let span = op_span.or(checked(op_limits)?.map(|(low, high)| high - low));
        Detector::new(
            SecondOrderFilter::new(tf)?,
            Width::new(k, ti, td, b, kp)?,
            SafetyNet { conditions, ..SafetyNet::new(span)? },
            MedianMean::new(n)?,
            max_h,
            op_limits,
        )
    }
}
