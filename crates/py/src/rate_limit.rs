//! The rate limit block.

use glapp_core::RateLimitState;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A signal that moves by at most rate a second.
#[pyclass(module = "glapp.blocks")]
pub struct RateLimit {
    block: glapp_core::RateLimit<f64>,
    state: RateLimitState<f64>,
}

#[pymethods]
impl RateLimit {
    #[new]
    fn new(rate: f64) -> PyResult<Self> {
        let block = glapp_core::RateLimit::new(rate).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(Self { block, state: RateLimitState::default() })
    }

    fn update(&mut self, x: f64, h: f64) -> f64 {
        self.block.update(&mut self.state, x, h)
    }
}
