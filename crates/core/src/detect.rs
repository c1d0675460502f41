//! From samples to half-periods, detections and the estimate (thesis chapters 5 and 7).

mod corrected;
mod correction;
pub(crate) mod detector;
mod detector_settings;
mod half_period;
mod median_mean;
pub(crate) mod safety_net;
mod swing;
mod width;
pub(crate) mod zero_crossing;

pub use corrected::{Corrected, Doubt, FEWEST, Half, Pair, corrected, pairs};
pub use correction::{Correction, CorrectionState, NOISE_SPAN, PAIRS};
pub use detector::{Columns, Detector, DetectorState, HalfPeriodResult, Sample, Span};
pub use detector_settings::{DATA_GAP_STEPS, DETECTIONS, DetectorSettings, KP_DEFAULT, process_gain};
pub use half_period::{HalfPeriod, HalfPeriodState};
pub use median_mean::{Estimate, LONGEST_WINDOW, MedianMean, MedianMeanState};
pub use safety_net::{Conditions, Reason, SafetyNet};
pub use swing::{Swing, SwingParts, SwingState};
pub use width::{TravelSource, Width, WidthParts};
pub use zero_crossing::ZeroCrossing;
