//! Parts that a loop on blocks and a loop on modules share: the machine, its beginning at rest, and a scenario's signals.

use crate::error::require;
use crate::scenario::{Block, Scenario};
use crate::signal::{Source, sample_at};
use crate::{Piece, Plant, SimError};
use glapp_core::{ParameterError, Saturation};
use std::ops::Range;

/// The random streams of a scenario.
pub(crate) mod stream {
    pub(crate) const NOISE: u64 = 0;
    pub(crate) const SETPOINT: u64 = 1;
    pub(crate) const LOAD: u64 = 2;
    pub(crate) const OUTER_NOISE: u64 = 3;
    pub(crate) const OUTER_LOAD: u64 = 4;
    pub(crate) const JITTER: u64 = 5;
    pub(crate) const LOST: u64 = 6;
}

/// A signal of a scenario, with random numbers of its own.
pub(crate) fn source(
    s: &Scenario,
    name: &'static str,
    signal: &[Piece],
    stream: u64,
    n: usize,
) -> Result<Source, SimError> {
    Source::new(name, signal, s.h, n, s.seed, stream)
}

/// Steady state of a loop.
pub(crate) struct Rest {
    /// Process value.
    pub(crate) y: f64,
    /// Input of the process.
    pub(crate) v: f64,
    /// Output of the controller.
    pub(crate) op: f64,
}

/// The loop at rest at the process value `y` under `load`.
pub(crate) fn rest(plant: &Plant, limits: Saturation<f64>, y: f64, load: f64) -> Result<Rest, SimError> {
    let v = plant.gain().map_or(0.0, |kp| y / kp);
    let op = v - load;
    if limits.update(op) == op {
        Ok(Rest { y, v, op })
    } else {
        Err(SimError::NoRest { op, why: "outside the limits" })
    }
}

/// Source of the output; in manual its value, unless it stays.
#[derive(Clone, Copy)]
pub(crate) enum Mode {
    Auto,
    Manual(Option<f64>),
}

/// A loop of any order: sp, load and noise (in the place of pv) in the block become all signals.
pub(crate) trait Machine {
    /// Runs a block of samples on.
    fn advance(&mut self, block: &mut Block<'_>, first: usize, mode: Mode);
}

/// Steps that a signal is rounded to.
pub(crate) fn resolution(name: &'static str, step: f64) -> Result<f64, ParameterError> {
    require(name, step, step >= 0.0, "0 or greater")
}

/// Index ranges of the samples without a process value.
pub(crate) fn bad(s: &Scenario, n: usize) -> Result<Vec<Range<usize>>, SimError> {
    let samples = |&(from, to): &(f64, f64)| {
        if from.is_finite() && to.is_finite() && from < to {
            return Ok(sample_at(from, s.h, n)..sample_at(to, s.h, n));
        }
        let what = format!("stretch from {from} s to {to} s; write an end after the begin");
        Err(SimError::Signal { name: "bad", what })
    };
    s.bad.iter().map(samples).collect()
}
