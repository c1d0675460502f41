//! Possible models of a record: lost motion, process and disturbance, and the filter that gives their likelihood.

pub(crate) mod backlash_model;
pub(crate) mod kalman;
pub(crate) mod lanes;
pub(crate) mod structure;
