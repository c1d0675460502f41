//! Pushes for a valve that sticks.

use crate::refused;
use glapp_core::{Push, Saturation, Status, StictionSample, StictionSettings, StictionState};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Pushes against the stiction of a valve (`docs/compensation.md`).
///
/// Parameters
/// ----------
/// push : {"knocker", "reinforcement", "two_moves"}
///     How it is pushed.
/// k : float
///     Gain K ≠ 0 of the controller, negative for direct action; its sign counts for "two_moves".
/// ti : float
///     Integral time Ti of the controller [s], 0 < Ti ≤ 1e9.
/// size : float
///     Height of a push [unit of OP], ≥ 0.
/// limit : float, optional
///     Greatest height [unit of OP], ≥ size; the size where not given.
/// hold : float, optional
///     Length of a pulse, or of each of two moves [s], > 0, ≤ 10 Ti; where not given Ti/10, of two moves Ti.
/// period : float, optional
///     Time from one push to the next [s], ≥ 2 hold, ≤ 1000 Ti; where not given Ti/5, of two moves 10 Ti.
/// band : float, optional
///     How far OP must go before that is a direction [unit of OP], ≥ 0; size/10 where not given.
/// far : float
///     Two moves: how far PV must be off SP [unit of PV], ≥ 0.
/// rate : float, optional
///     Greatest rate of u_FF [unit of OP per s], > 0; none where not given.
/// release : float, optional
///     Time in which it is taken away [s], > 0, ≤ 10 Ti and ≤ 300; Ti where not given, or 300 where that is shorter.
/// travel : float, optional
///     Budget of u_FF in any hour [unit of OP], > 0; none where not given.
/// watch : float, optional
///     Time over which the loop is compared with what it was before [s], > 0, ≤ 1e5 Ti; 300 Ti where not given.
/// withdraw : bool
///     Whether a loop that is worse than before withdraws it.
/// limits : (low, high), optional
///     Limits of OP.
///
/// Examples
/// --------
/// >>> knocker = Stiction("knocker", k=1.0, ti=10.0, size=2.0, hold=1.0, period=3.0, band=0.0)
/// >>> [knocker.update(0.0, u, 1.0, enable=True) for u in (50.0, 50.1, 50.2, 50.3, 50.4, 50.5, 50.0)]
/// [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, -2.0]
/// >>> knocker.standing, knocker.direction
/// ('active', -1)
#[pyclass(module = "glapp.blocks")]
pub struct Stiction {
    block: glapp_core::Stiction<f64>,
    state: StictionState<f64>,
}

#[pymethods]
impl Stiction {
    #[new]
    #[pyo3(signature = (
        push, *, k, ti, size, limit=None, hold=None, period=None, band=None, far=0.0, rate=None, release=None, travel=None,
        watch=None, withdraw=true, limits=None,
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        push: &str,
        k: f64,
        ti: f64,
        size: f64,
        limit: Option<f64>,
        hold: Option<f64>,
        period: Option<f64>,
        band: Option<f64>,
        far: f64,
        rate: Option<f64>,
        release: Option<f64>,
        travel: Option<f64>,
        watch: Option<f64>,
        withdraw: bool,
        limits: Option<(f64, f64)>,
    ) -> PyResult<Self> {
        let unknown = || PyValueError::new_err(format!("push = {push}: must be knocker, reinforcement or two_moves"));
        let named = Push::ALL.into_iter().find(|one| one.name() == push).ok_or_else(unknown)?;
        let usual = StictionSettings::new(named, k, ti, size);
        let limits = match limits {
            Some((low, high)) => Saturation::new(low, high).map_err(refused)?,
            None => usual.limits,
        };
        let settings = StictionSettings {
            limit: limit.unwrap_or(usual.limit),
            hold: hold.unwrap_or(usual.hold),
            period: period.unwrap_or(usual.period),
            band: band.unwrap_or(usual.band),
            far,
            rate: rate.unwrap_or(usual.rate),
            release: release.unwrap_or(usual.release),
            travel: travel.unwrap_or(usual.travel),
            watch: watch.unwrap_or(usual.watch),
            withdraw,
            limits,
            ..usual
        };
        let block = glapp_core::Stiction::new(settings).map_err(refused)?;
        Ok(Self { block, state: StictionState::default() })
    }

    /// The control error, the output without u_FF and the time since the sample before [s] in, u_FF out.
    #[pyo3(signature = (e, u, h, *, enable, flags=0))]
    fn update(&mut self, e: f64, u: f64, h: f64, enable: bool, flags: Status) -> f64 {
        self.block.update(&mut self.state, &StictionSample { e, u, h, enable, flags })
    }

    /// Name of the state: active, or the reason why it is not.
    #[getter]
    fn standing(&self) -> &'static str {
        self.state.standing.name()
    }

    /// Direction of the push, +1 or -1; 0 while it is not known.
    #[getter]
    fn direction(&self) -> i8 {
        self.state.direction
    }
}
