//! The saturation block.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A signal kept within limits; without memory.
///
/// Parameters
/// ----------
/// low, high : float
///     Limits [unit of the signal], low < high.
///
/// Examples
/// --------
/// >>> valve = Saturation(0.0, 100.0)
/// >>> [valve.update(x) for x in (-3.0, 42.0, 120.0)]
/// [0.0, 42.0, 100.0]
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

    /// A value in, the same within the limits out.
    fn update(&self, x: f64) -> f64 {
        self.block.update(x)
    }
}
