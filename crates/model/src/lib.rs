//! Models of a record's process and disturbance, and the Kalman filters that give their likelihood.
//!
//! Eight models run side by side, in the widest registers of the machine; the bits are the same on every one. `glapp-fit` searches among
//! these models. They are a crate of their own because most of the compiler's work is here: whoever changes the search waits for it once.

// Indices of matrices, as in the equations.
#![allow(clippy::needless_range_loop)]

pub mod kalman;
pub mod lanes;
pub mod structure;
