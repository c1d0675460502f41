//! Errors of a call: a code, and a text that says what to do.

use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Done.
pub const OK: i32 = 0;
/// Done, and there is something: a half-period ended, an estimate is there.
pub const YES: i32 = 1;
/// A pointer is NULL where it must not be, or does not lie as its type asks.
pub const BAD_POINTER: i32 = -1;
/// A handle that was never given, is of another kind, or was freed.
pub const BAD_HANDLE: i32 = -2;
/// A length that no array can have.
pub const BAD_LENGTH: i32 = -3;
/// A text that is no UTF-8, or does not end within 4096 bytes.
pub const BAD_TEXT: i32 = -4;
/// A setting, name or value that is refused: the text names it, its value and its bound.
pub const REFUSED: i32 = -5;
/// A fault inside the library. The handle can only be freed.
pub const BROKEN: i32 = -6;

/// Error of a call.
#[derive(Debug)]
pub(crate) struct CallError {
    pub(crate) code: i32,
    text: String,
}

impl CallError {
    pub(crate) fn new(code: i32, text: impl Into<String>) -> Self {
        Self { code, text: text.into() }
    }

    /// The call's error for an error of the crates.
    pub(crate) fn refused(error: impl std::fmt::Display) -> Self {
        Self::new(REFUSED, error.to_string())
    }
}

thread_local! {
    static TEXT: RefCell<CString> = RefCell::default();
}

/// The text of the last failure in this thread; empty where there was none.
pub(crate) fn text() -> *const c_char {
    TEXT.try_with(|text| text.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// Does the work of a call: no panic leaves it, and a failure leaves its text.
pub(crate) fn guarded(work: impl FnOnce() -> Result<i32, CallError>) -> i32 {
    let done = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let words =
            panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
        Err(CallError::new(BROKEN, format!("a fault in glapp: {}", words.unwrap_or("of unknown kind"))))
    });
    done.unwrap_or_else(|error| {
        let text = CString::new(error.text.replace('\0', " ")).unwrap_or_default();
        let _ = TEXT.try_with(|last| last.replace(text));
        error.code
    })
}
