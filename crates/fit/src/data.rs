//! Records as they come, and as the likelihood sees them.

pub(crate) mod cells;
pub(crate) mod windows;
