//! The saturation block.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A signal kept within low and high.
#[pyclass(module = "glapp.blocks")]
pub struct Saturation {
    block: glapp_core::Saturation<f64>,
}

#[pymethods]
impl Saturation {
    #[new]
    fn new(low: f64, high: f64) -> PyResult<Self> {
        let block = glapp_core::Saturation::new(low, high).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(Self { block })
    }

    fn update(&self, x: f64) -> f64 {
        self.block.update(x)
    }
}
