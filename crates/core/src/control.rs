//! The controller's law, bare (thesis (4.1)).

pub(crate) mod pid;

pub use pid::{Pid, PidState};
