//! Notices a process of the wrong sign.

use crate::refused;
use glapp_core::{Saturation, Status, WrongSignState};
use pyo3::prelude::*;

/// Notices that K has the wrong sign for its process: OP has gone to its limit and PV runs away from SP all the same.
///
/// Parameters
/// ----------
/// k, ti : float
///     Gain ≠ 0, whose sign counts, and integral time > 0 [s] of the controller.
/// low, high : float
///     Limits of its output, low < high.
///
/// Examples
/// --------
/// >>> block = WrongSign(2.0, 3.0, 0.0, 100.0)
/// >>> signals = [(50.2, 50.0), (46.0, 60.0), (38.0, 80.0)] + [(30.0 - i, 100.0) for i in range(20)]
/// >>> found = [block.update(50.0, yf, op, 1.0, 8 if op == 100.0 else 0) for yf, op in signals]
/// >>> found.index(True)  # 5 Ti after it has come to its limit
/// 18
#[pyclass(module = "glapp.blocks")]
pub struct WrongSign {
    block: glapp_core::WrongSign<f64>,
    state: WrongSignState<f64>,
}

#[pymethods]
impl WrongSign {
    #[new]
    fn new(k: f64, ti: f64, low: f64, high: f64) -> PyResult<Self> {
        let block = glapp_core::WrongSign::new(k, ti, Saturation { low, high }).map_err(refused)?;
        Ok(Self { block, state: WrongSignState::default() })
    }

    /// Take setpoint, filtered process value, output and the time since the last sample [s]; tell whether the sign is wrong.
    ///
    /// flags: 1 not in automatic, 2 bad, 4 at the lower limit, 8 at the upper one, 16 after a gap.
    #[pyo3(signature = (sp, yf, op, h, flags=0))]
    fn update(&mut self, sp: f64, yf: f64, op: f64, h: f64, flags: Status) -> bool {
        self.block.update(&mut self.state, sp, yf, op, h, flags)
    }
}
