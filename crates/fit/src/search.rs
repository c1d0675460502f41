//! The likelihood, its maximum, and how it goes over the width.

pub(crate) mod decimation;
pub(crate) mod likelihood;
pub(crate) mod profile;
pub(crate) mod screen;
