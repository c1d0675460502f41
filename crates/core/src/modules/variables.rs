//! Variables of a detection that can be read while it runs, by name (thesis 3.4: the online editor).

use super::backlash_detection::{BacklashDetection, BacklashDetectionState};
use crate::{Corrected, Doubt, HalfPeriodResult, Real};

/// A variable that can be read in every scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Variable {
    /// Name in every interface of glapp.
    pub name: &'static str,
    /// Unit; 1 where it has none.
    pub unit: &'static str,
    /// Meaning.
    pub meaning: &'static str,
}

const fn of(name: &'static str, unit: &'static str, meaning: &'static str) -> Variable {
    Variable { name, unit, meaning }
}

/// The inner variables of a [`BacklashDetection`], in order; [`BacklashDetection::read`] gives their values.
pub const VARIABLES: [Variable; 27] = [
    of("e", "PV unit", "error ysp − yf by the detector's filter"),
    of("delta_t", "s", "duration Δt of the half-period under way"),
    of("delta_y", "PV unit", "its mean distance to the setpoint Δy so far (2.2)"),
    of("e_max", "PV unit", "its largest |e| so far (5.2)"),
    of("delta_sp", "PV unit", "range of the setpoint in it, Δysp (5.5)"),
    of("delta_y_prev", "PV unit", "Δy of the completed half-period before it (5.4)"),
    of("delta_u", "OP unit", "its K/Ti·Δy·Δt so far (7.5)"),
    of("free", "OP unit", "its Δu that is used: by (7.5), (7.6) without the slope, or OP's own travel"),
    of("kp_part", "OP unit", "its part Δy/Kp of (2.4)"),
    of("mask", "1", "conditions that it would fail if it ended now, a bit for each reason"),
    of("last_delta_t", "s", "Δt of the last half-period that ended"),
    of("last_delta_y", "PV unit", "its Δy"),
    of("last_e_max", "PV unit", "its e_max"),
    of("last_delta_sp", "PV unit", "its Δysp"),
    of("last_delta_u", "OP unit", "its K/Ti·Δy·Δt (7.5)"),
    of("last_free", "OP unit", "its Δu that was used"),
    of("last_kp_part", "OP unit", "its part Δy/Kp of (2.4)"),
    of("last_mask", "1", "conditions that it failed, a bit for each reason; 0: a detection"),
    of("u_fb", "OP unit", "the output without u_FF"),
    of("kp_used", "PV unit/OP unit", "Kp in force: given, found by an experiment, or default"),
    of("kp_defaulted", "1", "1 where that Kp, or the one behind d_hat, is a default: nothing is compensated by it"),
    of(
        "whole_fit",
        "1",
        "1 where `whole` may be compensated by: Kp is no default and no filter of PV is longer than Ti/2",
    ),
    of("corrected_d", "OP unit", "width with the bias of (2.4) taken out"),
    of("corrected_low", "OP unit", "smallest width that the pairs of half-periods allow"),
    of("corrected_high", "OP unit", "largest one"),
    of("corrected_kp", "PV unit/OP unit", "|Kp| that it goes with, known or found with it"),
    of("corrected_doubt", "1", "why there is no corrected width, by number; 0: there is one"),
];

impl<R: Real> BacklashDetection<R> {
    /// The value of one of the [`VARIABLES`] after a scan; NaN where there is none, none for another name.
    ///
    /// ```
    /// use glapp_core::modules::{BacklashDetection, BacklashDetectionSettings, BacklashDetectionState};
    /// use glapp_core::DetectorSettings;
    /// let detector = DetectorSettings { tf: 0.0, ..DetectorSettings::new(0.5, 10.0, 0.0, 1.0) };
    /// let watch = BacklashDetection::new(BacklashDetectionSettings { detector, compensation: None })?;
    /// let mut state = BacklashDetectionState::default();
    /// for pv in [48.0, 49.0, 48.0] {
    ///     watch.forward(&mut state, 50.0.into(), pv.into(), 1.0);
    ///     watch.backward(&mut state, None);
    /// }
    /// let read = |name| watch.read(&state, name).unwrap();
    /// assert_eq!([read("e"), read("delta_t"), read("delta_y"), read("e_max")], [2.0, 2.0, 1.5, 2.0]);
    /// assert!(read("u_fb").is_nan() && watch.read(&state, "tank").is_none());
    /// # Ok::<(), glapp_core::ParameterError>(())
    /// ```
    pub fn read(&self, state: &BacklashDetectionState<R>, name: &str) -> Option<f64> {
        let found = VARIABLES.iter().find(|variable| variable.name == name)?;
        if let Some(of_last) = found.name.strip_prefix("last_") {
            return Some(state.last.as_ref().map_or(f64::NAN, |last| of_record(last, of_last)));
        }
        let number = |x: Option<R>| x.map_or(f64::NAN, R::as_f64);
        Some(match found.name {
            "e" => number(state.detector.observed().map(|yf| state.sp.value - yf)),
            "u_fb" => number(state.u_fb),
            "kp_used" => number(state.detector.kp().or(self.gain.0)),
            "kp_defaulted" => f64::from(u8::from(self.kp_defaulted(state))),
            "whole_fit" => f64::from(u8::from(state.compensable().is_some())),
            "corrected_d" => number(self.corrected(state).ok().map(|found| found.d)),
            "corrected_low" => number(self.corrected(state).ok().map(|found| found.low)),
            "corrected_high" => number(self.corrected(state).ok().map(|found| found.high)),
            "corrected_kp" => number(self.corrected(state).ok().map(|found| found.kp)),
            "corrected_doubt" => self.corrected(state).err().map_or(0.0, |doubt| f64::from(doubt as u8)),
            other => of_record(&self.under_way(state), other),
        })
    }

    /// The record of the half-period under way as if it ended now.
    pub fn under_way(&self, state: &BacklashDetectionState<R>) -> HalfPeriodResult<R> {
        self.detector.under_way(&state.detector, state.sp.value)
    }

    /// The width with the bias of (2.4) taken out, by the last [`PAIRS`](crate::PAIRS) pairs of half-periods, or why there is none.
    pub fn corrected(&self, state: &BacklashDetectionState<R>) -> Result<Corrected<R>, Doubt> {
        self.correction.width(&state.correction, state.detector.shown().is_some())
    }

    /// Whether the Kp in force, or the one behind the estimate, is a default.
    pub fn kp_defaulted(&self, state: &BacklashDetectionState<R>) -> bool {
        (self.gain.1 && state.detector.kp().is_none()) || state.detector.kp_defaulted()
    }
}

fn of_record<R: Real>(record: &HalfPeriodResult<R>, name: &str) -> f64 {
    let HalfPeriodResult { half, parts, mask, previous_delta_y, .. } = record;
    let value = match name {
        "delta_t" => half.delta_t,
        "delta_y" => half.delta_y,
        "e_max" => half.e_max,
        "delta_sp" => half.delta_sp,
        "delta_u" => parts.delta_u,
        "free" => parts.free,
        "kp_part" => parts.kp_part,
        "delta_y_prev" => return previous_delta_y.map_or(f64::NAN, R::as_f64),
        _ => return f64::from(*mask),
    };
    value.as_f64()
}
