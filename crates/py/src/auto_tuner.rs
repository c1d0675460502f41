//! The autotuner block.

use crate::refused;
use glapp_core::auto_tuner::{Found, Stop};
use glapp_core::tuning::{Kind, Table};
use glapp_core::{AutoTunerSettings, AutoTunerState, Status};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Relay experiment with hysteresis: ultimate gain and period, static gain, and a controller from them.
///
/// OP is held for `wait` seconds, then switched between two levels around where it was: balanced, until four cycles are
/// alike, then with a bias, until four are again. Whatever goes wrong ends it at once with OP where it was; `stop` says why.
/// `docs/auto_tuner.md` has the equations and the errors that remain.
///
/// Parameters
/// ----------
/// amplitude : float
///     The greatest distance of OP from where it was [unit of OP], ≠ 0; negative where PV falls when OP rises.
/// wait : float
///     Length of the waiting phase [s], > 0: a period of the process.
/// longest : float
///     The experiment ends within this time [s], > wait.
/// max_h : float
///     A longer time between two samples ends it [s], > 0.
/// pv_limits, op_limits : (low, high)
///     PV outside ends it; OP stays within, and it does not begin nearer than the amplitude to one.
/// relay_hysteresis : float, optional
///     Half width of the relay's hysteresis [unit of PV], ≥ 0; half of PV's range in the waiting phase where not given.
/// d : float
///     Total width of the gap that the valve is known to have [unit of OP], ≥ 0 and less than 4/3 of the amplitude.
///
/// Examples
/// --------
/// Three lags of 1 s: Ku = 8, Tu = 3.63 s, Kp = 1.
///
/// >>> tuner = AutoTuner(5.0, wait=4, longest=120, max_h=0.5, pv_limits=(0, 100), op_limits=(0, 100))
/// >>> tuner.start(op=40.0)
/// >>> x, op = [40.0] * 3, 40.0
/// >>> while tuner.running:
/// ...     op = tuner.update(x[2], h=0.05)
/// ...     for _ in range(10):
/// ...         x = [v + (u - v) * 0.005 for u, v in zip((op, *x), x)]
/// >>> tuner.phase, op, [round(number, 2) for number in tuner.found]
/// ('done', 40.0, [7.74, 3.64, 1.0, 0.13])
/// >>> [round(number, 2) for number in tuner.tuned("point_placement")]
/// [2.73, 4.13, 0.66]
#[pyclass(module = "glapp.blocks")]
pub struct AutoTuner {
    block: glapp_core::AutoTuner<f64>,
    state: AutoTunerState<f64>,
}

#[pymethods]
impl AutoTuner {
    #[new]
    #[pyo3(signature = (amplitude, *, wait, longest, max_h, pv_limits, op_limits, relay_hysteresis=None, d=0.0))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        amplitude: f64,
        wait: f64,
        longest: f64,
        max_h: f64,
        pv_limits: (f64, f64),
        op_limits: (f64, f64),
        relay_hysteresis: Option<f64>,
        d: f64,
    ) -> PyResult<Self> {
        let settings =
            AutoTunerSettings { amplitude, relay_hysteresis, d, wait, longest, max_h, pv: pv_limits, op: op_limits };
        let block = glapp_core::AutoTuner::new(settings).map_err(refused)?;
        Ok(Self { block, state: AutoTunerState::default() })
    }

    /// Begin an experiment with OP where it stands; one that is under way is forgotten.
    fn start(&mut self, op: f64) {
        self.block.start(&mut self.state, op);
    }

    /// PV, the time since the sample before [s] and the sample's flags in (1 not in auto, 2 bad, 4 and 8 OP at its lower,
    /// upper limit, 16 gap), OP out.
    #[pyo3(signature = (pv, h, flags=0))]
    fn update(&mut self, pv: f64, h: f64, flags: Status) -> f64 {
        self.block.update(&mut self.state, pv, h, flags)
    }

    /// Whether the relay has the output.
    #[getter]
    fn running(&self) -> bool {
        self.state.phase.is_running()
    }

    /// "idle", "waiting", "balanced", "biased", "done" or "aborted".
    #[getter]
    fn phase(&self) -> &'static str {
        self.state.phase.name()
    }

    /// Why it was broken off, the first reason that held: "bad_quality", "sample_time", "not_auto", "op_limit", "pv_bounds",
    /// "wrong_sign", "dead_loop", "not_regular", "time_budget", "off_point"; None where it was not.
    #[getter]
    fn stop(&self) -> Option<&'static str> {
        (self.state.stop != Stop::None).then(|| self.state.stop.name())
    }

    /// (ku, tu, kp, kappa), or None before the balanced phase is over. kp is None for an integrating process, whose kappa
    /// is 0, and where it could not be measured; then kappa is None too and ku and tu are not corrected.
    #[getter]
    fn found(&self) -> Option<(f64, f64, Option<f64>, Option<f64>)> {
        self.state.found.map(|Found { ku, tu, kp, kappa }| (ku, tu, kp, kappa))
    }

    /// Half width of the hysteresis in use [unit of PV].
    #[getter]
    fn relay_hysteresis(&self) -> f64 {
        self.state.relay_hysteresis
    }

    /// Middle of the relay's two levels, from where OP was.
    #[getter]
    fn bias(&self) -> f64 {
        self.state.bias
    }

    /// (k, ti, td) of "point_placement" (Ti = 6.25Td, PID only), "ziegler_nichols" or "amigo", "PI" or "PID".
    #[pyo3(signature = (rule, kind="PID"))]
    fn tuned(&self, rule: &str, kind: &str) -> PyResult<(f64, f64, f64)> {
        let found = self.state.found.ok_or_else(|| PyValueError::new_err("nothing is found yet to tune by"))?;
        tuned(&found, rule, kind)
    }
}

/// Gains by a rule from an experiment's result.
fn tuned(found: &Found<f64>, rule: &str, kind: &str) -> PyResult<(f64, f64, f64)> {
    let kind = match kind {
        "PI" => Kind::Pi,
        "PID" => Kind::Pid,
        _ => return Err(PyValueError::new_err(format!("kind is '{kind}', must be 'PI' or 'PID'"))),
    };
    let gains = match (rule, kind) {
        ("point_placement", Kind::Pid) => found.point_placement(),
        ("ziegler_nichols", kind) => found.ziegler_nichols(kind, Table::Textbook),
        ("amigo", kind) => found.amigo(kind),
        _ => {
            let rules = "'point_placement' (PID), 'ziegler_nichols' or 'amigo'";
            return Err(PyValueError::new_err(format!("rule is '{rule}', must be {rules}")));
        }
    };
    gains.map(|g| (g.k, g.ti, g.td)).map_err(refused)
}

/// Names of the reasons why an experiment is broken off, by their numbers.
#[pyfunction]
pub fn stops() -> Vec<&'static str> {
    Stop::ALL.map(Stop::name).to_vec()
}

/// (k, ti, td) by a rule from ku, tu, kp and kappa.
#[pyfunction]
pub fn tuned_by(found: (f64, f64, Option<f64>, Option<f64>), rule: &str, kind: &str) -> PyResult<(f64, f64, f64)> {
    let (ku, tu, kp, kappa) = found;
    tuned(&Found { ku, tu, kp, kappa }, rule, kind)
}
