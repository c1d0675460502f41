//! The noise block, and the one that tells how much noise there is.

use glapp_core::{NoiseLevel as Level, NoiseState};
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

/// Standard deviation of a signal's fast noise, sample by sample: the median size of the fourth difference, which takes away any movement
/// that is a cubic over five samples. About the last thousand samples count.
///
/// Known bias: an upper bound where the signal's own movement fills only a few samples; too low for noise that a filter has
/// smoothed.
///
/// Examples
/// --------
/// >>> noise, level = Noise(0.3), NoiseLevel()
/// >>> for k in range(4000):
/// ...     level.update(noise.update(50.0 + 0.01 * k))
/// >>> abs(level.sigma / (0.3 / 3**0.5) - 1) < 0.1  # of uniform noise: 0.3/√3
/// True
#[pyclass(module = "glapp.blocks")]
#[derive(Default)]
pub struct NoiseLevel {
    state: Level<f64>,
}

#[pymethods]
impl NoiseLevel {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Takes a sample; one that is no number begins the differences anew.
    fn update(&mut self, x: f64) {
        if x.is_finite() { self.state.update(x) } else { self.state.interrupt() }
    }

    /// [unit of the signal]; None before there were twenty differences.
    #[getter]
    fn sigma(&self) -> Option<f64> {
        self.state.sigma()
    }
}
