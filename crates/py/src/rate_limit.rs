//! The rate limit block.

use glapp_core::RateLimitState;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A signal that moves by at most `rate` a second, from the first value on.
///
/// Parameters
/// ----------
/// rate : float
///     [unit of the signal per second], > 0.
///
/// Examples
/// --------
/// >>> actuator = RateLimit(2.0)
/// >>> [actuator.update(x, 1.0) for x in (5.0, 9.0, 9.0, 8.5)]
/// [5.0, 7.0, 9.0, 8.5]
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

    /// A value and the time since the one before [s] in, the limited value out.
    fn update(&mut self, x: f64, h: f64) -> f64 {
        self.block.update(&mut self.state, x, h)
    }
}
