//! The phase lead block.

use crate::refused;
use glapp_core::PhaseLeadState;
use pyo3::prelude::*;

/// Phase-lead compensator (1 + s·lead)/(1 + s·lag) with static gain 1 (thesis 2.2); begins at rest at the first value.
///
/// `glapp.nonlinear.phase_lead` designs it. A step shows (lead + h)/(lag + h) times as high.
///
/// Parameters
/// ----------
/// lead, lag : float
///     Time constants [s], lead ≥ lag > 0.
///
/// Raises
/// ------
/// ValueError
///     Where one is out of its bounds.
///
/// Examples
/// --------
/// >>> lead = PhaseLead(3.0, 1.0)
/// >>> [lead.update(x, 1.0) for x in (2.0, 3.0, 3.0, 3.0)]
/// [2.0, 4.0, 3.5, 3.25]
#[pyclass(module = "glapp.blocks")]
pub struct PhaseLead {
    block: glapp_core::PhaseLead<f64>,
    state: PhaseLeadState<f64>,
}

#[pymethods]
impl PhaseLead {
    #[new]
    fn new(lead: f64, lag: f64) -> PyResult<Self> {
        let block = glapp_core::PhaseLead::new(lead, lag).map_err(refused)?;
        Ok(Self { block, state: PhaseLeadState::default() })
    }

    /// A value and the time since the one before [s] in, the value with its lead out.
    fn update(&mut self, x: f64, h: f64) -> f64 {
        self.block.update(&mut self.state, x, h)
    }
}
