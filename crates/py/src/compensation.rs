//! Compensation of the gap, and the warning of over-compensation.

use glapp_core::{
    CompensationSample, CompensationSettings, CompensationState, HalfPeriod, OverCompensationState, ParameterError,
    Saturation, Standing, Way,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

fn refused(error: ParameterError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Settings as Python has them; without limits: none.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PySettings {
    way: String,
    k: f64,
    size: f64,
    share: f64,
    limit: f64,
    band: f64,
    tf: f64,
    rate: f64,
    release: f64,
    travel: f64,
    reversals: f64,
    withdraw: bool,
    limits: Option<(f64, f64)>,
}

impl TryFrom<PySettings> for CompensationSettings<f64> {
    type Error = PyErr;

    fn try_from(s: PySettings) -> PyResult<Self> {
        let PySettings { way, k, size, share, limit, band, tf, rate, release, travel, reversals, withdraw, limits } = s;
        let named = Way::ALL.into_iter().find(|one| one.name() == way);
        let unknown = || PyValueError::new_err(format!("way = {way}: must be error, derivative or inverse"));
        let limits = limits.map_or(Ok(Saturation::none()), |(low, high)| Saturation::new(low, high));
        Ok(Self {
            way: named.ok_or_else(unknown)?,
            limits: limits.map_err(refused)?,
            k,
            size,
            share,
            limit,
            band,
            tf,
            rate,
            release,
            travel,
            reversals,
            withdraw,
        })
    }
}

/// Feed-forward that carries the valve through its gap.
#[pyclass(module = "glapp.blocks")]
pub struct Compensation {
    block: glapp_core::Compensation<f64>,
    state: CompensationState<f64>,
}

#[pymethods]
impl Compensation {
    #[new]
    #[pyo3(signature = (
        way, *, k, size, share, limit, band, tf, rate, release, travel, reversals, withdraw, limits=None,
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        way: String,
        k: f64,
        size: f64,
        share: f64,
        limit: f64,
        band: f64,
        tf: f64,
        rate: f64,
        release: f64,
        travel: f64,
        reversals: f64,
        withdraw: bool,
        limits: Option<(f64, f64)>,
    ) -> PyResult<Self> {
        let settings =
            PySettings { way, k, size, share, limit, band, tf, rate, release, travel, reversals, withdraw, limits };
        let block = glapp_core::Compensation::new(settings.try_into()?).map_err(refused)?;
        Ok(Self { block, state: CompensationState::default() })
    }

    #[pyo3(signature = (e, u, h, *, enable, d_hat=None, over=false, flags=0))]
    #[allow(clippy::too_many_arguments)]
    fn update(&mut self, e: f64, u: f64, h: f64, enable: bool, d_hat: Option<f64>, over: bool, flags: u8) -> f64 {
        self.block.update(&mut self.state, &CompensationSample { e, u, h, d_hat, over, enable, flags })
    }

    /// What it does, or why it does nothing.
    #[getter]
    fn standing(&self) -> &'static str {
        self.state.standing.name()
    }

    /// Width in force now.
    #[getter]
    fn size(&self) -> f64 {
        2.0 * self.state.half
    }

    /// Travel and reversals that count against the budgets.
    #[getter]
    fn spent(&self) -> (f64, f64) {
        (self.state.travel, self.state.reversals)
    }
}

/// Names of how a compensation stands, in the order of their numbers.
#[pyfunction]
pub fn standings() -> Vec<&'static str> {
    Standing::ALL.iter().map(|standing| standing.name()).collect()
}

/// The two warnings of over-compensation.
#[pyclass(module = "glapp.blocks")]
pub struct OverCompensation {
    block: glapp_core::OverCompensation<f64>,
    state: OverCompensationState<f64>,
}

#[pymethods]
impl OverCompensation {
    #[new]
    fn new(k: f64, ti: f64) -> PyResult<Self> {
        let block = glapp_core::OverCompensation::new(k, ti).map_err(refused)?;
        Ok(Self { block, state: OverCompensationState::default() })
    }

    /// (even, relay).
    #[pyo3(signature = (delta_t, delta_y, h, size, delta_sp=0.0, flags=0))]
    fn update(&mut self, delta_t: f64, delta_y: f64, h: f64, size: f64, delta_sp: f64, flags: u8) -> (bool, bool) {
        let half = HalfPeriod { flags, delta_t, delta_y, delta_sp, ..HalfPeriod::default() };
        let warning = self.block.update(&mut self.state, &half, h, size);
        (warning.even, warning.relay)
    }
}
