//! The noise block.

use glapp_core::NoiseState;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Uniform noise of ± amplitude (thesis 6.2).
#[pyclass(module = "glapp.blocks")]
pub struct Noise {
    block: glapp_core::Noise<f64>,
    state: NoiseState,
}

#[pymethods]
impl Noise {
    #[new]
    #[pyo3(signature = (amplitude, integer=1))]
    fn new(amplitude: f64, integer: i32) -> PyResult<Self> {
        let block = glapp_core::Noise::new(amplitude).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(Self { block, state: NoiseState { integer } })
    }

    fn update(&mut self, x: f64) -> f64 {
        self.block.update(&mut self.state, x)
    }
}
