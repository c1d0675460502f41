//! The face of glapp for C: a header, a static and a shared library.
//!
//! `include/glapp.h` is what a program in C includes, and its comments are the reference; `docs/c.md` tells how it is used. Here
//! stands how it is kept safe: `doors` checks every pointer and every length, `handles` follows no address that C hands
//! in, `wrong` lets no panic out. What is computed is computed in the other crates.

mod handles;
mod settings;
mod wrong;

#[allow(unsafe_code)]
mod doors;

pub use doors::*;
pub use wrong::{BAD_HANDLE, BAD_LENGTH, BAD_POINTER, BAD_TEXT, BROKEN, OK, REFUSED, YES};

/// The version of the interface: greater wherever a program that was built before would no longer do.
pub const ABI: u32 = 1;
