//! From likelihoods to an answer.

pub(crate) mod combine;
pub(crate) mod joint;
pub(crate) mod verdict;
