//! The PID block.

use glapp_core::{ParameterError, PidState, Saturation};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// PI or PID controller in ideal form (thesis (4.1)), with anti-windup by tracking.
///
/// Parameters
/// ----------
/// k : float
///     Gain K [output per process value], ≠ 0, negative for a direct-acting controller.
/// ti : float
///     Integral time Ti [s], > 0.
/// td : float
///     Derivative time Td [s], ≥ 0.
/// b : float
///     Setpoint weight, 0 to 1.
/// limits : (low, high), optional
///     Limits of the output, low < high.
///
/// Examples
/// --------
/// >>> pi = Pid(2.0, 10.0, b=1.0, limits=(0.0, 100.0))
/// >>> pi.track(50.0, 50.0, 40.0, 1.0)  # in manual at 40
/// 40.0
/// >>> [pi.update(ysp, 50.0, 1.0) for ysp in (50.0, 51.0)]  # to auto without a bump
/// [40.0, 42.2]
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

    /// Setpoint, filtered process value and time step [s] in, output in auto out.
    fn update(&mut self, ysp: f64, yf: f64, h: f64) -> f64 {
        self.block.update(&mut self.state, ysp, yf, h)
    }

    /// Takes one sample in manual, at the output `u`; gives it within the limits.
    fn track(&mut self, ysp: f64, yf: f64, u: f64, h: f64) -> f64 {
        self.block.track(&mut self.state, ysp, yf, u, h)
    }
}
