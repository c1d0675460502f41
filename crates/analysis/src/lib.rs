//! From samples to an answer: what is wrong with a recording, what its controller does, and what may be said of its valve.
//!
//! Nothing here reads a file, asks a clock or writes a sentence: arrays come in, numbers and names go out. Python, and
//! whatever else shows an answer, puts them into words.

pub mod identify;
mod signals;

pub use signals::{FROZEN_STEPS, SORTED_ROWS, frozen_steps, in_runs, median, noise_sigma, quantile, resolution};
