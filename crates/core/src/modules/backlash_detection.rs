//! The detector as a module beside a controller.

use crate::connection::{Backward, Forward};
use crate::half_period::{AT_HIGH, AT_LOW, BAD, NOT_AUTO};
use crate::{
    Detector, DetectorState, MedianMean, ParameterError, Real, Record, SafetyNet, Sample, SecondOrderFilter, Width,
};

/// Settings of a [`BacklashDetection`] (thesis 6.4): those of the controller beside it, and the detector's own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BacklashDetectionSettings<R> {
    /// Gain K ≠ 0 of the controller in ideal form [output per process value].
    pub k: R,
    /// Its integral time > 0 \[s\].
    pub ti: R,
    /// Its derivative time ≥ 0 \[s\]; none: the width is taken from the output's own travel.
    pub td: Option<R>,
    /// Its setpoint weight, 0 to 1.
    pub b: R,
    /// Static process gain ≠ 0, where known [process value per output].
    pub kp: Option<R>,
    /// Time constant of the detector's filter ≥ 0 \[s\]; 0 where PV comes filtered.
    pub tf: R,
    /// Length of the filter of detections, odd, 1 to 31.
    pub n: u32,
    /// Lower and upper limit of the output, low < high, where known: a wider travel is none.
    pub op_limits: Option<(R, R)>,
    /// A longer time between scans, > 0, is a gap \[s\].
    pub max_h: R,
}

impl<R: Real> BacklashDetectionSettings<R> {
    /// For a PI or PID controller with b = 1; Kp and limits not known, tf = Ti/10 (2.1), N = 9, a gap above Ti/2.
    pub fn new(k: R, ti: R, td: R) -> Self {
        let (tf, max_h) = (ti / R::of(10.0), ti / R::of(2.0));
        Self { k, ti, td: Some(td), b: R::ONE, kp: None, tf, n: 9, op_limits: None, max_h }
    }
}

/// Detection and estimation of backlash beside a controller (thesis 6.4): a [`Detector`] with connections.
///
/// It takes setpoint and process value on branches of the connections that enter the controller, and its output goes to
/// the controller's feed-forward. What comes back there is all that it has to know of the loop (7.1): that something is
/// at a limit, that the controller is not in automatic, and the output in effect. Where the output is not connected, it
/// sees no flags and no output; then only Δu below the span of the output is asked.
///
/// It belongs in the inner loop of a cascade (8.3): what comes out of an outer controller is distorted by the inner
/// loop before it reaches the gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BacklashDetection<R> {
    detector: Detector<R>,
}

/// State of a [`BacklashDetection`]. A new one resets the detection.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BacklashDetectionState<R> {
    /// The detector; it holds the estimate.
    pub detector: DetectorState<R>,
    /// The last half-period that ended, with what was concluded from it.
    pub last: Option<Record<R>>,
    sp: Forward<R>,
    pv: Forward<R>,
    h: R,
}

impl<R: Real> Default for BacklashDetectionState<R> {
    fn default() -> Self {
        let nothing = Forward::new(R::ZERO, 0);
        Self { detector: DetectorState::default(), last: None, sp: nothing, pv: nothing, h: R::ZERO }
    }
}

impl<R: Real> BacklashDetection<R> {
    /// Checks the settings.
    pub fn new(settings: BacklashDetectionSettings<R>) -> Result<Self, ParameterError> {
        let BacklashDetectionSettings { k, ti, td, b, kp, tf, n, op_limits, max_h } = settings;
        Ok(Self {
            detector: Detector::new(
                SecondOrderFilter::new(tf)?,
                Width::new(k, ti, td, b, kp)?,
                SafetyNet::new(op_limits.map(|(low, high)| high - low))?,
                MedianMean::new(n)?,
                max_h,
                op_limits,
            )?,
        })
    }

    /// Takes setpoint, process value and the time since the last scan `h` \[s\]; gives the feed-forward, 0.
    #[inline(always)]
    pub fn forward(&self, state: &mut BacklashDetectionState<R>, sp: Forward<R>, pv: Forward<R>, h: R) -> Forward<R> {
        (state.sp, state.pv, state.h) = (sp, pv, h);
        Forward::new(R::ZERO, 0)
    }

    /// Takes what the controller tells at its feed-forward, where that is connected; learns from the sample of this scan.
    #[inline(always)]
    pub fn backward(&self, state: &mut BacklashDetectionState<R>, back: Option<Backward<R>>) {
        let told = back.map_or(0, |back| back.flags & (AT_LOW | AT_HIGH | NOT_AUTO));
        let quality = (state.sp.flags | state.pv.flags) & BAD;
        let sample = Sample {
            h: state.h,
            sp: state.sp.value,
            pv: state.pv.value,
            op: back.map(|back| back.tracking),
            flags: told | quality,
        };
        if let Some(record) = self.detector.update(&mut state.detector, &sample) {
            state.last = Some(record);
        }
    }
}
