//! The backlash block.

use glapp_core::BacklashState;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Backlash of total width d (thesis 6.3): y = x − d/2 pushed up, x + d/2 pushed down, else where it was.
///
/// Parameters
/// ----------
/// d : float
///     Total width [unit of x], ≥ 0.
/// output : float, optional
///     Where y stands at the start; without it y begins at the first x, in the middle of the gap.
///
/// Examples
/// --------
/// >>> gap = Backlash(2.0)
/// >>> [gap.update(x) for x in (0.0, 0.9, 3.0, 2.0, 0.5)]
/// [0.0, 0.0, 2.0, 2.0, 1.5]
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

    /// Position x of the driving side in, that of the driven side out.
    fn update(&mut self, x: f64) -> f64 {
        self.block.update(&mut self.state, x)
    }
}
