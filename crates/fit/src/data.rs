//! Records as they come, and as the likelihood sees them.

pub(crate) mod cells;
pub(crate) mod history;
pub(crate) mod recorder;
pub(crate) mod repeated;
pub(crate) mod samples;
pub(crate) mod segment;
pub(crate) mod signal;
