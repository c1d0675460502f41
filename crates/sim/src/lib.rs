//! Plants and closed loops with backlash: where the truth for every test of glapp comes from.
//!
//! Everything is exact at the samples (zero-order hold by the matrix exponential, dead time of any length), and
//! deterministic: the same loop with the same seed gives the same bits.

mod closed_loop;
mod error;
mod matrix;
mod plant;
mod signal;

pub use closed_loop::{AT_HIGH, AT_LOW, ClosedLoop, Columns, Manual, NOT_AUTO};
pub use error::SimError;
pub use plant::{BATCH, MAX_ORDER, Named, Plant};
pub use signal::{Signal, random_walk};
