#![doc = include_str!("../README.md")]
#![no_std]

#[cfg(test)]
extern crate std;

#[macro_use]
mod named;

mod compensate;
mod control;
mod detect;
mod error;
pub mod modules;
mod numbers;
mod real;
mod signal;
pub mod status;
mod sum;
mod tune;

pub use compensate::*;
pub use control::*;
pub use detect::*;
pub use error::{PARAMETERS, ParameterError};
pub use modules::{Backward, Forward};
pub use numbers::{Adding, LANES, Lanes, Numbers};
pub use real::Real;
pub use signal::*;
pub use status::Status;
pub use sum::{Carried, Saved, Sum};
pub use tune::*;
