//! The blocks that the detector is made of.

use crate::refused;
use glapp_core::{
    Conditions, CorrectionState, Derivative as Slope, Doubt, HalfPeriod, HalfPeriodResult, HalfPeriodState,
    MedianMeanState, Reason, SecondOrderFilterState, Status, SwingState, WidthParts, ZeroCrossing as Crossing,
};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;

/// Second-order low-pass filter 1/(1 + s·Tf)² (thesis 2.1): twice y += (x − y)·(h/(Tf + h)).
///
/// Known bias: a signal of period T is delayed by about 2·Tf and, at T = 10·Tf, reduced to 72 % of its amplitude.
///
/// Parameters
/// ----------
/// tf : float
///     Time constant Tf [s], ≥ 0; 0 passes the signal through.
///
/// Examples
/// --------
/// >>> smooth = SecondOrderFilter(1.0)
/// >>> [smooth.update(x, 1.0) for x in (4.0, 8.0)]
/// [4.0, 5.0]
#[pyclass(module = "glapp.blocks")]
pub struct SecondOrderFilter {
    block: glapp_core::SecondOrderFilter<f64>,
    state: SecondOrderFilterState<f64>,
}

#[pymethods]
impl SecondOrderFilter {
    #[new]
    fn new(tf: f64) -> PyResult<Self> {
        let block = glapp_core::SecondOrderFilter::new(tf).map_err(refused)?;
        Ok(Self { block, state: SecondOrderFilterState::default() })
    }

    /// A value and the time since the one before [s] in, the filtered value out.
    fn update(&mut self, x: f64, h: f64) -> f64 {
        self.block.update(&mut self.state, x, h)
    }
}

/// Zero crossings of the control error (thesis (2.1)); an error of exactly zero keeps the sign before it.
///
/// Examples
/// --------
/// >>> crossing = ZeroCrossing()
/// >>> [crossing.update(e) for e in (0.5, 0.0, -0.1)], crossing.sign
/// ([False, False, True], -1)
#[pyclass(module = "glapp.blocks")]
#[derive(Default)]
pub struct ZeroCrossing {
    state: Crossing,
}

#[pymethods]
impl ZeroCrossing {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Whether the error changed its sign.
    fn update(&mut self, e: f64) -> bool {
        self.state.update(e)
    }

    /// +1 or −1; 0 until an error other than zero was seen.
    #[getter]
    fn sign(&self) -> i8 {
        self.state.sign
    }
}

/// Backward difference (x − x_before)/h; 0 for the first value.
///
/// Examples
/// --------
/// >>> slope = Derivative()
/// >>> [slope.update(x, 0.5) for x in (2.0, 3.0)]
/// [0.0, 2.0]
#[pyclass(module = "glapp.blocks")]
#[derive(Default)]
pub struct Derivative {
    state: Slope<f64>,
}

#[pymethods]
impl Derivative {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// A value and the time since the one before [s] in, the slope out.
    fn update(&mut self, x: f64, h: f64) -> f64 {
        self.state.update(x, h)
    }
}

type Measured = (Status, u32, f64, f64, f64, f64, f64, f64, f64);

/// Signals between two zero crossings.
///
/// Examples
/// --------
/// Three samples, then the crossing: flags, samples, Δt, Δy, e_max, Δysp, and how far setpoint, slope of PV and OP
/// moved from one crossing to the other.
///
/// >>> half = HalfPeriod()
/// >>> for e in (1.0, 2.0, 3.0):
/// ...     half.update(e, 0.5, 10.0)
/// >>> half.update(-1.0, 0.5, 10.0, crossed=True)
/// (0, 3, 1.5, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0)
#[pyclass(module = "glapp.blocks", name = "HalfPeriodBlock")]
#[derive(Default)]
pub struct HalfPeriodBlock {
    state: Option<HalfPeriodState<f64>>,
}

#[pymethods]
impl HalfPeriodBlock {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// One sample; where `crossed`, it closes the half-period under way, whose numbers are given, and begins the next.
    #[pyo3(signature = (e, h, sp, slope=0.0, op=0.0, flags=0, crossed=false))]
    #[allow(clippy::too_many_arguments)]
    fn update(
        &mut self,
        e: f64,
        h: f64,
        sp: f64,
        slope: f64,
        op: f64,
        flags: Status,
        crossed: bool,
    ) -> Option<Measured> {
        let fresh = || HalfPeriodState::start(sp, slope, op, 0);
        let state = self.state.get_or_insert_with(fresh);
        let ended = (crossed && !state.is_empty()).then(|| state.close(0, sp, slope, op));
        if ended.is_some() {
            *state = fresh();
        }
        state.add(e, h, flags);
        state.widen(sp);
        ended.map(|half| {
            let HalfPeriod { flags, n, delta_t, delta_y, e_max, delta_sp, sp_change, slope_change, op_change, .. } =
                half;
            (flags, n, delta_t, delta_y, e_max, delta_sp, sp_change, slope_change, op_change)
        })
    }
}

/// Width of the gap from one half-period, d̂ = Δu − Δy/Kp (thesis (2.4)).
///
/// Parameters
/// ----------
/// k : float
///     Gain K of the controller [OP per PV], ≠ 0.
/// ti : float
///     Integral time Ti [s], > 0.
/// td : float, optional
///     Derivative time Td [s], ≥ 0, for the derivative part of (7.6).
/// b : float
///     Setpoint weight, 0 to 1.
/// kp : float, optional
///     Process gain Kp [PV per OP], ≠ 0; without it Δy/Kp is left out.
///
/// Examples
/// --------
/// >>> width = Width(0.5, 10.0, kp=2.0)
/// >>> delta_u, *_, kp_part, d = width.of(sign=1, delta_t=100.0, delta_y=1.0)
/// >>> delta_u, kp_part, d
/// (5.0, 0.5, 4.5)
#[pyclass(frozen, module = "glapp.blocks")]
pub struct Width {
    block: glapp_core::Width<f64>,
}

#[pymethods]
impl Width {
    #[new]
    #[pyo3(signature = (k, ti, td=None, b=1.0, kp=None))]
    fn new(k: f64, ti: f64, td: Option<f64>, b: f64, kp: Option<f64>) -> PyResult<Self> {
        Ok(Self { block: glapp_core::Width::new(k, ti, td, b, kp).map_err(refused)? })
    }

    /// (delta_u, delta_u_d, delta_u_sp, op_travel, free, kp_part, d).
    #[pyo3(signature = (sign, delta_t, delta_y, sp_change=0.0, slope_change=0.0, op_change=None))]
    fn of(
        &self,
        sign: i8,
        delta_t: f64,
        delta_y: f64,
        sp_change: f64,
        slope_change: f64,
        op_change: Option<f64>,
    ) -> (f64, f64, f64, f64, f64, f64, f64) {
        let change = op_change.unwrap_or(0.0);
        let half =
            HalfPeriod { sign, delta_t, delta_y, sp_change, slope_change, op_change: change, ..HalfPeriod::default() };
        let parts = self.block.of(&half, op_change.is_some());
        let WidthParts { delta_u, delta_u_d, delta_u_sp, op_travel, free, kp_part, d } = parts;
        (delta_u, delta_u_d, delta_u_sp, op_travel, free, kp_part, d)
    }
}

/// OP's travel between its furthest points, and the height of PV's plateau, from half-period to half-period.
///
/// Parameters
/// ----------
/// k, ti : float
///     Gain K [OP per PV], ≠ 0, and integral time Ti [s], > 0, of the controller.
/// td : float, optional
///     Derivative time Td [s], ≥ 0.
/// b : float
///     Setpoint weight, 0 to 1.
///
/// Examples
/// --------
/// OP rises to 3 while PV is low, then falls to −2 while it is high.
///
/// >>> swing = Swing(1.0, 10.0)
/// >>> for op in (0.0, 3.0, 2.5):
/// ...     swing.add(0.0, -1.0, 1.0, op)
/// >>> swing.end(1)
/// (None, 1.0)
/// >>> for op in (2.0, -2.0, -1.5):
/// ...     swing.add(0.0, 2.0, 1.0, op)
/// >>> swing.end(-1)
/// (5.0, 2.0)
#[pyclass(module = "glapp.blocks")]
pub struct Swing {
    block: glapp_core::Swing<f64>,
    state: SwingState<f64>,
}

#[pymethods]
impl Swing {
    #[new]
    #[pyo3(signature = (k, ti, td=None, b=1.0))]
    fn new(k: f64, ti: f64, td: Option<f64>, b: f64) -> PyResult<Self> {
        let block = glapp_core::Swing::new(k, ti, td, b).map_err(refused)?;
        Ok(Self { block, state: SwingState::default() })
    }

    /// A sample: setpoint, filtered PV, the time since the sample before [s], and OP where it is recorded.
    #[pyo3(signature = (sp, yf, h, op=None))]
    fn add(&mut self, sp: f64, yf: f64, h: f64, op: Option<f64>) {
        self.block.add(&mut self.state, h, sp, yf, op);
    }

    /// Ends the half-period of this sign and these flags: OP's travel, None where there is none, and PV's plateau.
    #[pyo3(signature = (sign, flags=0))]
    fn end(&mut self, sign: i8, flags: Status) -> (Option<f64>, f64) {
        let parts = self.block.end(&mut self.state, sign, flags);
        (parts.travel, parts.plateau)
    }
}

/// The width with the bias of (2.4) taken out, on line, by the last nine pairs of half-periods (`docs/estimator.md`).
///
/// Parameters
/// ----------
/// k, ti : float
///     Gain K [OP per PV], ≠ 0, and integral time Ti [s], > 0, of the controller.
/// b : float
///     Setpoint weight, 0 to 1.
/// kp : float, optional
///     Process gain [PV per OP], ≠ 0, where it is known; a default is not.
/// integrating : bool
///     The process integrates: no width is given.
///
/// Examples
/// --------
/// OP goes 6 from turn to turn, PV rests 0.5 off SP; Kp = 2 makes (0.5 + 0.5)/2 of the travel.
///
/// >>> width = Correction(1.0, 10.0, kp=2.0)
/// >>> for half in range(12):
/// ...     sign = 1 - 2 * (half % 2)
/// ...     for op in (-1.0, 1.0, 3.0):
/// ...         width.conclude()
/// ...         width.add(0.0, -0.5 * sign, 1.0, sign * op)
/// ...     width.end(sign, 0.5)
/// >>> width.width()
/// (5.5, 5.5, 5.5, 2.0)
#[pyclass(module = "glapp.blocks")]
pub struct Correction {
    block: glapp_core::Correction<f64>,
    state: CorrectionState<f64>,
}

#[pymethods]
impl Correction {
    #[new]
    #[pyo3(signature = (k, ti, b=1.0, kp=None, integrating=false))]
    fn new(k: f64, ti: f64, b: f64, kp: Option<f64>, integrating: bool) -> PyResult<Self> {
        let block = glapp_core::Correction::new(k, ti, b, kp, integrating).map_err(refused)?;
        Ok(Self { block, state: CorrectionState::default() })
    }

    /// Begins a scan: finishes the work that the scan before has left.
    fn conclude(&mut self) {
        self.block.conclude(&mut self.state);
    }

    /// Ends the half-period of this sign, Δy [PV unit], mask of reasons and flags, before the sample that ended it is added.
    #[pyo3(signature = (sign, delta_y, mask=0, flags=0))]
    fn end(&mut self, sign: i8, delta_y: f64, mask: u16, flags: Status) {
        let half = HalfPeriod { sign, flags, delta_y, ..HalfPeriod::default() };
        self.block.end(&mut self.state, &HalfPeriodResult { half, mask, ..HalfPeriodResult::default() });
    }

    /// A sample: setpoint, filtered PV, the time since the sample before [s], and OP.
    fn add(&mut self, sp: f64, yf: f64, h: f64, op: f64) {
        self.block.add(&mut self.state, h, sp, yf, op);
    }

    /// Width, smallest, largest, and |Kp|; or the name of the doubt.
    fn width<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        match self.block.width(&self.state, true) {
            Ok(found) => (found.d, found.low, found.high, found.kp).into_bound_py_any(py),
            Err(doubt) => doubt.name().into_bound_py_any(py),
        }
    }
}

/// Names of the doubts about a corrected width, by their numbers from 1.
#[pyfunction]
pub fn doubts() -> Vec<&'static str> {
    Doubt::ALL.iter().map(|doubt| doubt.name()).collect()
}

/// The conditions that a half-period must meet (thesis chapter 5 and 7.1); `docs/estimator.md` lists them.
///
/// Parameters
/// ----------
/// k, ti : float
///     Gain K [OP per PV], ≠ 0, and integral time Ti [s], > 0, of the controller.
/// op_span : float, optional
///     Span of OP, > 0: a Δu of that size or more is refused.
/// limits, too_short, not_square, decaying, growing, sp_moved, too_small : bool
///     Which conditions are asked.
///
/// Examples
/// --------
/// A half-period as short as 5 Ti fails one of them, the bit of reason 5.
///
/// >>> net = SafetyNet(0.5, 10.0)
/// >>> net.check(flags=0, delta_t=50.0, delta_y=1.0, e_max=1.2, delta_sp=0.0, free=2.5, previous=1.0)
/// (16, 5)
#[pyclass(frozen, module = "glapp.blocks")]
pub struct SafetyNet {
    net: glapp_core::SafetyNet<f64>,
    width: glapp_core::Width<f64>,
}

#[pymethods]
impl SafetyNet {
    #[new]
    #[pyo3(signature = (
        k, ti, op_span=None, *, limits=true, too_short=true, not_square=true, decaying=true, growing=true,
        sp_moved=true, too_small=true,
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        k: f64,
        ti: f64,
        op_span: Option<f64>,
        limits: bool,
        too_short: bool,
        not_square: bool,
        decaying: bool,
        growing: bool,
        sp_moved: bool,
        too_small: bool,
    ) -> PyResult<Self> {
        let conditions = Conditions { limits, too_short, not_square, decaying, growing, sp_moved, too_small };
        let net = glapp_core::SafetyNet { conditions, ..glapp_core::SafetyNet::new(op_span).map_err(refused)? };
        Ok(Self { net, width: glapp_core::Width::new(k, ti, None, 1.0, None).map_err(refused)? })
    }

    /// Mask of the conditions it fails, and the first of them; `previous` (Δy) and `d_hat` None where there are none.
    #[pyo3(signature = (flags, delta_t, delta_y, e_max, delta_sp, free, previous=None, d_hat=None))]
    #[allow(clippy::too_many_arguments)]
    fn check(
        &self,
        flags: Status,
        delta_t: f64,
        delta_y: f64,
        e_max: f64,
        delta_sp: f64,
        free: f64,
        previous: Option<f64>,
        d_hat: Option<f64>,
    ) -> (u16, u8) {
        let half = HalfPeriod { flags, delta_t, delta_y, e_max, delta_sp, ..HalfPeriod::default() };
        let parts = WidthParts { free, ..WidthParts::default() };
        let mask = self.net.check(&half, &parts, &self.width, previous, d_hat);
        (mask, Reason::first(mask) as u8)
    }
}

/// Median/mean filter of detections (thesis 7.3): the mean of those within 80 to 120 % of the median of the last n.
///
/// Parameters
/// ----------
/// n : int
///     Length of the window, odd; while there are fewer, the same over those there are.
///
/// Examples
/// --------
/// >>> shown = MedianMean(n=3)
/// >>> [shown.update(d)[0] for d in (5.0, 40.0, 5.5)]
/// [5.0, 22.5, 5.25]
#[pyclass(module = "glapp.blocks")]
pub struct MedianMean {
    block: glapp_core::MedianMean,
    state: MedianMeanState<f64>,
}

#[pymethods]
impl MedianMean {
    #[new]
    #[pyo3(signature = (n=9))]
    fn new(n: u32) -> PyResult<Self> {
        let block = glapp_core::MedianMean::new(n).map_err(refused)?;
        Ok(Self { block, state: MedianMeanState::default() })
    }

    /// A detection in; estimate, range of the detections kept, their number and that in the window out.
    fn update(&mut self, d: f64) -> (f64, f64, f64, u8, u8) {
        let shown = self.block.update(&mut self.state, d);
        (shown.value, shown.low, shown.high, shown.kept, shown.count)
    }
}
