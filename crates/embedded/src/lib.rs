//! The face of glapp for microcontrollers: detector, compensation and PID in memory that C gives, without allocation.
//!
//! `include/glapp_embedded.h` is what a program includes, and its comments are the reference. What is computed is computed in the core; each
//! block is there once in `f32` and once in `f64`.

#![cfg_attr(target_os = "none", no_std)]

#[allow(unsafe_code)]
mod ffi;

pub use ffi::*;

/// A program without an operating system has nobody to tell: it stops, and a watchdog finds it. The core does not panic.
#[cfg(target_os = "none")]
#[panic_handler]
fn stop(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}
