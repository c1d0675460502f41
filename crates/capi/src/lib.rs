//! The face of glapp for C: a header, a static and a shared library.
//!
//! `include/glapp.h` is what a program in C includes, and its comments are the reference; `docs/c.md` tells how it is used. Here
//! stands how it is kept safe: `ffi` checks every pointer and every length, `handles` follows no address that C hands
//! in, `wrong` lets no panic out. What is computed is computed in the other crates.

mod errors;
mod handles;
mod settings;

#[allow(unsafe_code)]
mod ffi;

pub use errors::{BAD_HANDLE, BAD_LENGTH, BAD_POINTER, BAD_TEXT, BROKEN, OK, REFUSED, YES};
pub use ffi::*;

/// The version of the interface: greater wherever a program that was built before would no longer do.
pub const ABI: u32 = 1;
