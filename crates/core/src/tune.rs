//! Controllers for processes: rules in closed form, and the experiment that finds what they ask for (thesis chapter 4).

pub mod auto_tuner;
pub mod tuning;

pub use auto_tuner::{AutoTuner, AutoTunerSettings, AutoTunerState};
