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
mod position;
mod problem;
mod progress;
mod search;

pub use data::history::{Batch, LONG_HISTORY, MOST_EPOCHS, Rows, Windows};
pub use data::recorder::Recorder;
pub use data::repeated::Recorded;
pub use data::samples::{Samples, Unfit};
pub use data::segment::{Segment, Stretch};
pub use data::signal::{shifts, spikes};
pub use decide::evidence::{Evidence, Hidden};
pub use decide::joint::{JointAnswer, SegmentAnswer, Together};
pub use decide::judgement::{Cause, Confidence, Judgement, Verdict, WidthKind};
pub use decide::segment_fit::{Candidate, Prediction, SegmentFit};
pub use decide::thresholds::THRESHOLDS;
pub use decide::trend::{Trend, Width};
pub use decide::valve::{RecordingAnswer, ValveAnswer};
pub use decide::weigh::{LEAST_DOUBT, Terms, USUAL_PRIOR, Weighed};
pub use decide::weights::LEARNED;
pub use decide::witness::{cycle::Cycle, plateau::Plateau};
pub use glapp_model::structure::{Noise, Structure};
pub use position::{AtValve, PositionAnswer, Shown, fit_position};
pub use problem::{Divided, FitProblem, Window, WindowFit, fit, fit_valve};
pub use progress::Tell;
