//! Plants and closed loops with backlash: where the truth for every test of glapp comes from.
//!
//! Everything is exact at the samples (zero-order hold by the matrix exponential, dead time of any length), and
//! deterministic: the same scenario with the same seed gives the same bits, alone or among others.

mod engine;
mod error;
mod graph;
mod lanes;
mod looped;
mod machine;
mod matrix;
mod module;
mod plant;
mod random;
mod run;
mod scenario;
mod signal;
mod valve;

pub use error::{GraphError, SimError};
pub use glapp_lanes::Instructions;
pub use graph::Graph;
pub use lanes::{groups, run_together, watch_together};
pub use matrix::Matrix;
pub use module::Module;
pub use plant::{BATCH, MAX_ORDER, Named, Plant};
pub use scenario::{Block, Columns, Compensated, Controller, Manual, Outer, Scenario, Seen};
pub use signal::{Piece, Signal, random_walk};
pub use valve::{Stem, StemModel, Valve};
