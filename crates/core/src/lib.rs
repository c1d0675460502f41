#![doc = include_str!("../README.md")]
#![no_std]

#[cfg(test)]
extern crate std;

pub mod auto_tuner;
mod backlash;
mod compensation;
mod connection;
mod corrected;
mod derivative;
mod detector;
mod detector_settings;
mod error;
mod filter;
mod half_period;
mod harm;
mod median_mean;
pub mod modules;
mod noise;
mod noise_level;
mod over_compensation;
mod pid;
mod rate_limit;
mod real;
mod safety_net;
mod saturation;
pub mod status;
mod sum;
mod swing;
pub mod tuning;
mod width;
mod wrong_sign;
mod zero_crossing;

pub use auto_tuner::{AutoTuner, AutoTunerSettings, AutoTunerState};
pub use backlash::{Backlash, BacklashState};
pub use compensation::{Compensation, CompensationSample, CompensationSettings, CompensationState, Standing, Way};
pub use connection::{Backward, Forward};
pub use corrected::{Corrected, Doubt, FEWEST, Half, Pair, corrected, pairs};
pub use derivative::Derivative;
pub use detector::{Columns, Detector, DetectorState, Record, Sample, Span};
pub use detector_settings::{DETECTIONS, DetectorSettings, GAP_STEPS};
pub use error::ParameterError;
pub use filter::{SecondOrderFilter, SecondOrderFilterState};
pub use half_period::{HalfPeriod, HalfPeriodState};
pub use median_mean::{Estimate, LONGEST_WINDOW, MedianMean, MedianMeanState};
pub use noise::{Noise, NoiseState};
pub use noise_level::NoiseLevel;
pub use over_compensation::{OverCompensation, OverCompensationState, OverWarning};
pub use pid::{Pid, PidState};
pub use rate_limit::{RateLimit, RateLimitState};
pub use real::Real;
pub use safety_net::{Conditions, Reason, SafetyNet};
pub use saturation::Saturation;
pub use status::Status;
pub use sum::{Carried, Saved, Sum};
pub use swing::{Swing, SwingParts, SwingState};
pub use width::{TravelSource, Width, WidthParts};
pub use wrong_sign::{WrongSign, WrongSignState};
pub use zero_crossing::ZeroCrossing;
