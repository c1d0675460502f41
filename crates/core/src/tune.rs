//! Controllers for processes: rules in closed form, and the experiment that finds their inputs (thesis chapter 4).

pub mod auto_tuner;
pub mod tuning;

pub use auto_tuner::{AutoTuner, AutoTunerSettings, AutoTunerState};
