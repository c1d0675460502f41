//! Further evidence for a gap or against it, beyond the likelihood of PV: numbers, no decisions.

pub(crate) mod cycle;
pub(crate) mod plateau;
