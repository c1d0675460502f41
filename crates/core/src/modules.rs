//! Control modules: blocks with connections, from which loops are put together (thesis chapter 6).
//!
//! A module has two passes in every scan. `forward` takes what the modules before it hand on and gives its output;
//! `backward` takes what the modules after it tell, and gives what it tells those before:
//!
//! ```text
//!             ── forward: value, quality ──→
//!    filter         pid          gap         process      each in turn, then the same way back
//!             ←── backward: limits, flags, tracking ──
//! ```
//!
//! Within a scan every `forward` sees what was computed before it in the same scan, and every `backward` likewise. So a
//! controller's output rests on measurements of the same scan, and on what was told backward in the scan before: a valve
//! that reaches its limit in a scan stops the controller's integral in the next. A detector learns in the backward pass,
//! when the flags of the scan are known: a flag belongs to the very sample that it was raised at.
//!
//! The blocks that only stand in a connection, [`Noise`](crate::Noise), [`Backlash`](crate::Backlash),
//! [`SecondOrderFilter`](crate::SecondOrderFilter), [`PhaseLead`](crate::PhaseLead), [`RateLimit`](crate::RateLimit) and
//! [`Saturation`](crate::Saturation), have their `forward` themselves.
//!
//! Whoever sets the output for a while, a person, a controller further in or an experiment, does so by telling
//! [`NOT_AUTO`](crate::status::NOT_AUTO) and the value in effect backward: the controller tracks it.

mod auto_tuner;
mod backlash_detection;
mod connection;
mod foreign_detection;
mod pid;
mod pid_advanced;
mod process_sim;
mod variables;

pub use auto_tuner::{AutoTuner, AutoTunerState};
pub use backlash_detection::{BacklashDetection, BacklashDetectionSettings, BacklashDetectionState, Unfit};
pub use connection::{Backward, Forward};
pub use foreign_detection::{FOREIGN_SCANS, ForeignDetection, ForeignDetectionSettings, ForeignDetectionState, Read};
pub use pid::{Mode, Pid, PidSettings, PidState};
pub use pid_advanced::{Gains, PidAdvanced, PidAdvancedSettings, PidAdvancedState, SCHEDULE_ROWS};
pub use process_sim::{ProcessSim, ProcessSimState};
pub use variables::{VARIABLES, Variable};
