//! The noise block.

use glapp_core::NoiseState;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Uniform noise of ± amplitude added to a signal (thesis 6.2), the same bits on every machine.
///
/// Parameters
/// ----------
/// amplitude : float
///     [unit of the signal], ≥ 0; the variance is amplitude²/3.
/// integer : int
///     Where the generator starts, 1 to 2³¹ − 2.
///
/// Examples
/// --------
/// >>> noise = Noise(0.1)
/// >>> [round(noise.update(5.0), 4) for _ in range(3)]
/// [4.9, 4.917, 5.0203]
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

    /// A sample in, with noise out.
    fn update(&mut self, x: f64) -> f64 {
        self.block.update(&mut self.state, x)
    }
}
