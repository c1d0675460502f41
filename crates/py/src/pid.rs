//! The PID block.

use glapp_core::{ParameterError, PidState, Saturation};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// PI or PID controller (thesis (4.1)).
#[pyclass(module = "glapp.blocks")]
pub struct Pid {
    block: glapp_core::Pid<f64>,
    state: PidState<f64>,
}

#[pymethods]
impl Pid {
    #[new]
    #[pyo3(signature = (k, ti, td=0.0, b=0.0, limits=None))]
    fn new(k: f64, ti: f64, td: f64, b: f64, limits: Option<(f64, f64)>) -> PyResult<Self> {
        let block = || -> Result<_, ParameterError> {
            let limits = limits.map_or(Ok(Saturation::none()), |(low, high)| Saturation::new(low, high))?;
            glapp_core::Pid::new(k, ti, td, b, limits)
        };
        Ok(Self { block: block().map_err(|e| PyValueError::new_err(e.to_string()))?, state: PidState::default() })
    }

    fn update(&mut self, ysp: f64, yf: f64, h: f64) -> f64 {
        self.block.update(&mut self.state, ysp, yf, h)
    }

    fn track(&mut self, ysp: f64, yf: f64, u: f64, h: f64) -> f64 {
        self.block.track(&mut self.state, ysp, yf, u, h)
    }
}
