//! Records as they come and as the likelihood sees them, and the lost motion that moves them.

pub(crate) mod backlash_model;
pub(crate) mod cells;
pub(crate) mod history;
pub(crate) mod recorder;
pub(crate) mod repeated;
pub(crate) mod samples;
pub(crate) mod segment;
pub(crate) mod signal;
