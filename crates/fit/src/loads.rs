//! Hypotheses of the load: that it walks, steps, goes along lines or repeats itself.

pub(crate) mod changes;
pub(crate) mod cycle;
pub(crate) mod hypothesis;
mod marks;
mod plausible;
