//! From likelihoods to an answer: width, interval, verdict.

pub(crate) mod best;
pub(crate) mod bootstrap;
pub(crate) mod combine;
pub(crate) mod evidence;
pub(crate) mod joint;
pub(crate) mod judgement;
mod pooled;
pub(crate) mod segment;
pub(crate) mod segment_fit;
pub(crate) mod thresholds;
pub(crate) mod trend;
pub(crate) mod valve;
pub(crate) mod verdict;
pub(crate) mod weigh;
pub(crate) mod weights;
pub(crate) mod witness;
