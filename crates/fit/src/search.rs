//! The likelihood, its maximum, and how it goes over the width.

pub(crate) mod decimation;
mod descent;
pub(crate) mod elsewhere;
pub(crate) mod likelihood;
pub(crate) mod linear;
mod pass;
pub(crate) mod profile;
pub(crate) mod screen;
