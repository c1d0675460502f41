//! Source of a setting.

use glapp_core::named;
use serde::Serialize;

pub use glapp_core::KP_DEFAULT;

named! {
    /// Source of a setting's value.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Origin {
        /// A person or a file gave it.
        Given => "given",
        /// Identified from OP's moves.
        Identified => "identified",
        /// Fitted to OP and PV together with the gap.
        Fitted => "fitted",
        /// No information: the usual value is used.
        Assumed => "assumed",
        /// Chosen among several by the result.
        Chosen => "chosen",
        /// Unknown: steps that need it are left out.
        Unknown => "unknown",
    }
}

/// The process gain Kp [PV unit/OP unit] that a width is worked out with, by [`glapp_core::process_gain`], and where it comes from.
///
/// ```
/// use glapp_analysis::{Origin, process_gain};
/// assert_eq!(process_gain(None, Some((50.0, 100.0)), false), (Some(0.75), Origin::Assumed));
/// assert_eq!(process_gain(None, Some((50.0, 100.0)), true), (None, Origin::Unknown));
/// assert_eq!(process_gain(Some(2.0), None, false), (Some(2.0), Origin::Given));
/// ```
pub fn process_gain(given: Option<f64>, spans: Option<(f64, f64)>, integrating: bool) -> (Option<f64>, Origin) {
    let (kp, defaulted) = glapp_core::process_gain(given, spans, integrating);
    let origin = match kp {
        Some(_) if defaulted => Origin::Assumed,
        Some(_) => Origin::Given,
        None => Origin::Unknown,
    };
    (kp, origin)
}

/// Whether a gain that was fitted may stand for one that is not known: its interval has one sign, and is at most two thirds
/// of it wide.
pub fn fitted_gain_serves(kp: f64, low: f64, high: f64) -> bool {
    low * high > 0.0 && (high - low).abs() <= 2.0 * kp.abs() / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fitted_gain_must_be_known_to_a_third() {
        assert!(fitted_gain_serves(-3.0, -4.0, -2.0));
        assert!(!fitted_gain_serves(3.0, 2.0, 4.1));
        assert!(!fitted_gain_serves(0.1, -0.1, 0.1) && !fitted_gain_serves(f64::NAN, f64::NAN, 1.0));
    }
}
