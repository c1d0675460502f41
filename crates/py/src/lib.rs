//! The Python face of glapp: one file per exposed module, no logic of its own.

mod detector;

use pyo3::prelude::*;

#[pymodule]
mod _glapp {
    #[pymodule_export]
    use crate::detector::{PyDetector, PyHalfPeriod};
}
