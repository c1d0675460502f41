//! Width of a valve's gap with its interval, from OP and PV, by maximum likelihood.
//!
//! OP goes through a lost motion (a gap of width d, perhaps with slip jump J), a dead time and a low-order process; a load that
//! walks acts at the process input, a drift at its output, and white noise on PV. For given d the rest is estimated: the
//! gain and the size of the noise drop out by least squares, offset and slow load by a Kalman filter that knows nothing of
//! them at first, and few parameters are left to a search. What stands at the end is the likelihood as a function of d, for
//! several families of process and disturbance. The derivation is in `docs/fit.md`.

// Indices of matrices, as in the equations.
#![allow(clippy::needless_range_loop)]

mod data;
mod decide;
mod loads;
mod model;
mod position;
mod search;

pub use data::windows::{Batch, Part, Window, fit, window};
pub use decide::combine::{Combined, Reading, combine};
pub use decide::joint::JointAnswer;
pub use decide::verdict::{Answer, Candidate, Prediction, Question, Verdict};
pub use model::structure::{Noise, Structure};
pub use position::{AtValve, Recorder, Shown, at_valve};
