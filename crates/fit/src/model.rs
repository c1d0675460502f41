//! What may have made a record: lost motion, process and disturbance, and the filter that gives their likelihood.

pub(crate) mod kalman;
pub(crate) mod lanes;
pub(crate) mod lost_motion;
pub(crate) mod structure;
