//! The Python face of glapp: one file per exposed module, no logic of its own.

use pyo3::prelude::*;

#[pymodule]
mod _glapp {}
