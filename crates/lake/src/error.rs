//! Error of a file.

use std::path::{Path, PathBuf};

/// A file that cannot be read, or a row that breaks the promised order.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}{}: {what}", .file.display(), .row.map_or_else(String::new, |row| format!(", row {row}")))]
pub struct LakeError {
    /// The file.
    pub file: PathBuf,
    /// Row of the error, the first one is 1.
    pub row: Option<u64>,
    /// Error in words, and its remedy.
    pub what: String,
}

impl LakeError {
    pub(crate) fn of(file: &Path, what: impl Into<String>) -> Self {
        Self { file: file.into(), row: None, what: what.into() }
    }

    pub(crate) fn at(self, row: u64) -> Self {
        Self { row: Some(row), ..self }
    }

    /// The error of a loop whose thread ended before it came to it.
    pub(crate) fn abandoned() -> Self {
        Self::of(Path::new(""), "was not read: a thread ended")
    }
}
