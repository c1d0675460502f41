//! The backlash block.

use glapp_core::BacklashState;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Backlash of total width d (thesis 6.3).
#[pyclass(module = "glapp.blocks")]
pub struct Backlash {
    block: glapp_core::Backlash<f64>,
    state: BacklashState<f64>,
}

#[pymethods]
impl Backlash {
    #[new]
    #[pyo3(signature = (d, output=None))]
    fn new(d: f64, output: Option<f64>) -> PyResult<Self> {
        let block = glapp_core::Backlash::new(d).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(Self { block, state: output.map_or_else(BacklashState::default, BacklashState::at) })
    }

    fn update(&mut self, x: f64) -> f64 {
        self.block.update(&mut self.state, x)
    }
}
