//! The controller's own law, read out of the recording.
//!
//! A PID controller moves its output by
//!
//! ```text
//! dOP = K (b dSP − dPV) + K/Ti e dt − K Td d(dPV/dt),      e = SP − PV                            (velocity form)
//! ```
//!
//! with PV filtered or not, and this sum over any stretch of time holds too: K, Ti, Td and (where the setpoint moves) b
//! follow from a regression of OP's moves on those of SP and PV and on the area of the error. Which filter stands before
//! it, whether it has a D part and when it runs, the recording must tell as well, and often does not: then the interval
//! holds what every law says that explains OP as well. `docs/identify.md` tells how the choices were made.

mod band;
mod filter;
mod interval;
mod judge;
mod law;
mod linear;
mod parts;
mod rows;
mod search;

pub use filter::Filter;

use crate::Inspected;
use serde::Serialize;

/// Least share of OP's moves that the law must explain before its K and Ti are used unasked.
pub const R2_USABLE: f64 = 0.9;
/// Largest ratio of the ends of the interval of K, or of Ti, with which they are used unasked.
pub const WIDEST: f64 = 4.0;
/// Fewest usable steps between samples; below it an interval means nothing.
pub const MIN_STEPS: usize = 50;

/// K, Ti and Td of a PID controller as its recording shows them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identification {
    /// Steps between consecutive samples that could be used.
    pub samples: usize,
    /// Best fit; none where no fit was possible.
    pub values: Option<Values>,
    /// The rest of it; none where no law comes out with values that a controller could have.
    pub settings: Option<Settings>,
    /// Why it must not be used unasked; none where it may.
    pub reason: Option<Reason>,
}

/// The law that fits best.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Values {
    /// Gain [OP unit/PV unit], negative for a direct acting controller.
    pub k: f64,
    /// Integral time [s].
    pub ti: f64,
    /// Share of the variance of OP's *moves* (not of its level) explained, outliers included; at most 1, negative when worse
    /// than nothing.
    pub r2: f64,
}

/// Settings that the recording shows, with 95 % intervals: of the scatter, of every law that explains OP as well, and
/// of what one sampling step leaves open.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// Interval of the gain [OP unit/PV unit].
    pub k_interval: Interval,
    /// Interval of the integral time [s]; without end where integral action may be none.
    pub ti_interval: Interval,
    /// Derivative time [s]; 0 where a law without D part explains OP as well as any.
    pub td: f64,
    /// Interval of the derivative time [s].
    pub td_interval: Interval,
    /// b, as given or as found, 0 to 1; none where SP moved too little to tell.
    pub setpoint_weight: Option<f64>,
    /// Description of the fit.
    pub note: Note,
}

/// An interval from low to high; either may be infinite.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Description of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Note {
    /// Samples in each mean.
    pub m: usize,
    /// Usual step [s].
    pub h: f64,
    /// The law has a D part.
    pub derivative: bool,
    /// Filter of PV before the law.
    pub filter: Filter,
    /// Rows by which OP was recorded late; negative when early.
    pub lag: isize,
    /// The setpoint weight, where it was fitted.
    pub weight: Option<Weight>,
}

/// A setpoint weight as it was fitted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Weight {
    /// b, which may lie outside 0 to 1.
    pub fitted: f64,
    /// 95 % interval of it.
    pub interval: Interval,
}

/// Why an identification must not be used unasked.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "code", content = "of", rename_all = "snake_case")]
pub enum Reason {
    /// OP is not recorded.
    NoOp,
    /// SP is not recorded.
    NoSp,
    /// A signal that is recorded has no value in any row.
    NoValue {
        /// Its name.
        signal: &'static str,
    },
    /// Fewer than [`MIN_STEPS`] steps can be used.
    FewSteps,
    /// OP never moves while in auto.
    OpStill,
    /// PV never moves while in auto.
    PvStill,
    /// Proportional and integral action cannot be separated in OP.
    Unshown,
    /// R² is below [`R2_USABLE`].
    LittleExplained,
    /// No controller has such values, and K may be 0.
    NoGain {
        /// 95 % of K [OP unit/PV unit].
        error: f64,
    },
    /// K may be 0.
    GainMayBeNone {
        /// |K| [OP unit/PV unit].
        size: f64,
        /// Interval of |K| [OP unit/PV unit].
        k: Interval,
    },
    /// Integral action may be missing.
    NoIntegral,
    /// K and K/Ti have opposite signs.
    OppositeSigns,
    /// Laws that explain OP equally well contradict each other even in the sign of K.
    Contradictory,
    /// An interval is wider than [`WIDEST`].
    Wide {
        /// Interval of |K| [OP unit/PV unit].
        k: Interval,
        /// Interval of Ti [s].
        ti: Interval,
        /// Usual step [s].
        h: f64,
    },
}

impl Identification {
    /// An identification without values, with its reason.
    fn nothing(reason: Reason, samples: usize) -> Self {
        Self { samples, values: None, settings: None, reason: Some(reason) }
    }
}

/// Finds K, Ti and Td of the controller that produced OP from SP and PV.
///
/// Summed up, with e = SP − PV and all PV filtered as the controller filters it, the law reads at every sample
///
/// ```text
/// OP = const + K (b SP − PV) + K/Ti Σ e h − K Td dPV/dt.
/// ```
///
/// The move from the mean of m samples to the mean of the next m obeys it too, without the constant. It is fitted by
/// iteratively reweighted least squares (Huber, then Tukey's biweight; scale from the median absolute residual) over
/// all stretches of 2m consecutive usable steps: in auto, good, finite, off the limits, no gap; m = 1, 2, 4 … up to
/// two Ti. Short means show the filter and the D part, long ones what noise and the time between samples hide.
///
/// The laws: PI and PID; PV as recorded, through one lag, or through two equal ones; or a D part with a filter of its
/// own; of a controller that runs once a sample, and of one that runs much faster. The filter's time is fitted too.
/// Every law that predicts no worse than the best in 8 to 30 blocks of time takes part in the interval, once as fitted
/// and once as if the controller had never seen the noise of the recorded PV. So does every m whose interval is at
/// most twice as wide as the narrowest. The scatter is the sandwich of the robust fit with scores summed by block,
/// and Student's t.
///
/// `setpoint_weight`: b where it is known; else found where SP moves enough, and its effect kept apart in any case.
/// `limits`: OP's lower and upper limit [OP unit]; samples at or beyond them are not used.
///
/// Bias: a recording at step h cannot tell which error the controller integrated within the step. Where all samples
/// fit to within OP's resolution, the controller ran once a sample, and is taken to have used the current error; else
/// it is taken to be much faster. The interval is wide enough for Ti − h/2 or Ti + h/2, K in proportion. A filter
/// whose lags add up to more than Td hides the derivative: such a controller is taken for a PI with less gain.
///
/// ```
/// use glapp_analysis::Inspected;
/// use glapp_analysis::identify::identified;
///
/// let t: Vec<f64> = (0..400).map(f64::from).collect();
/// let pv: Vec<f64> = t.iter().map(|t| 50.0 + (t / 17.0).sin() + 0.3 * (t / 5.0).sin()).collect();
/// let mut area = 0.0;
/// let op: Vec<f64> = pv
///     .iter()
///     .map(|pv| {
///         area += 50.0 - pv;
///         2.0 * (50.0 - pv) + 2.0 / 30.0 * area
///     })
///     .collect();
/// let rows = Inspected { t: &t, sp: Some(&[50.0; 400]), pv: &pv, op: Some(&op), flags: None };
/// let found = identified(&rows, None, None);
/// let law = found.values.unwrap();
/// assert!((law.k - 2.0).abs() < 1e-6 && (law.ti - 30.0).abs() < 1e-4 && found.reason.is_none());
/// ```
pub fn identified(rows: &Inspected, setpoint_weight: Option<f64>, limits: Option<(f64, f64)>) -> Identification {
    let rows = rows.even();
    let Inspected { t, pv, .. } = rows;
    let Some(op) = rows.op else { return Identification::nothing(Reason::NoOp, 0) };
    let Some(sp) = rows.sp else { return Identification::nothing(Reason::NoSp, 0) };
    for (signal, values) in [("OP", op), ("SP", sp), ("PV", pv)] {
        if !values.iter().any(|value| value.is_finite()) {
            return Identification::nothing(Reason::NoValue { signal }, 0);
        }
    }
    let (step, h) = rows::usable_steps(&rows, sp, op, limits);
    let count = step.iter().filter(|step| **step).count();
    if count < MIN_STEPS {
        return Identification::nothing(Reason::FewSteps, count);
    }
    if !rows::moves(op, &step) {
        return Identification::nothing(Reason::OpStill, count);
    }
    if !rows::moves(pv, &step) {
        return Identification::nothing(Reason::PvStill, count);
    }
    judge::judged(&rows::liveliest(t, sp, pv, op, &step), h, count, setpoint_weight)
}
