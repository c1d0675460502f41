//! Records as they come, and as the likelihood sees them.

pub(crate) mod cells;
pub mod history;
pub mod record;
pub mod samples;
pub(crate) mod signal;
