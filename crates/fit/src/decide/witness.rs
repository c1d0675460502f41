//! What else speaks for a gap or against it, beside the likelihood of PV: numbers, no decisions.

pub(crate) mod cycle;
pub(crate) mod plateau;
