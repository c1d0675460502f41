//! Findings on a recording, made before anything is estimated from it.
//!
//! Two sources of evidence: the [`DataStatistics`], counts over every row, and the rows that are kept in memory. Each [`Finding`]
//! names one fault and its numbers; `docs/quality.md` lists them all. Every threshold stands beside the finding it
//! belongs to.

mod controller;
mod finding;
mod grids;
mod historian;
mod look;
mod mode;
mod numbers;
mod oscillation;
mod settings;
mod spans;
mod times;

pub use crate::words::Value;
pub(crate) use finding::InOrder;
pub use finding::{Fault, Finding, Severity};
pub use settings::assumed_gain;
pub use spans::{PERCENT, op_unit};
pub use times::{assumed_time, newest_first, own_times, setting_unused};

use crate::identify::{self, Identification, Settings, Values};
use crate::{DataStatistics, Inspected};
use look::Look;

/// Facts on the loop that its recording does not hold.
#[derive(Clone, Copy, Debug, Default)]
pub struct Known {
    /// Controller gain used, signed [OP unit/PV unit].
    pub k: Option<f64>,
    /// Integral time used \[s\].
    pub ti: Option<f64>,
    /// Derivative time used \[s\]; 0 of a PI controller.
    pub td: Option<f64>,
    /// Law identified from the recording itself.
    pub law: Option<Law>,
    /// Process gain that the settings say, signed [PV unit/OP unit].
    pub kp: Option<f64>,
    /// Span of PV, where it is known [PV unit].
    pub pv_span: Option<(f64, f64)>,
    /// Span of OP, where it is known or OP is a percentage [OP unit].
    pub op_span: Option<(f64, f64)>,
}

/// The controller's law as the recording shows it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Law {
    /// K and Ti may be used unasked.
    pub usable: bool,
    /// Share of the variance of OP's moves that is explained.
    pub r2: Option<f64>,
    /// Gain [OP unit/PV unit].
    pub k: Interval,
    /// Integral time \[s\].
    pub ti: Interval,
    /// Derivative time \[s\].
    pub td: Interval,
}

impl Law {
    /// The law of an identification.
    pub fn of(found: &Identification) -> Self {
        let values = found.values.as_ref();
        let interval = |value: fn(&Values) -> f64, of: fn(&Settings) -> identify::Interval| {
            let interval = found.settings.as_ref().map(of);
            Interval { value: values.map(value), low: interval.map(|i| i.low), high: interval.map(|i| i.high) }
        };
        Self {
            usable: found.reason.is_none(),
            r2: values.map(|values| values.r2),
            k: interval(|values| values.k, |settings| settings.k_interval),
            ti: interval(|values| values.ti, |settings| settings.ti_interval),
            td: Interval {
                value: found.settings.map(|settings| settings.td),
                low: found.settings.map(|settings| settings.td_interval.low),
                high: found.settings.map(|settings| settings.td_interval.high),
            },
        }
    }
}

impl Law {
    /// Whether it explains this share of OP's moves, and neither K nor the integral action may be none.
    fn shows(&self, r2: f64) -> bool {
        let (Some(low), Some(high), Some(longest)) = (self.k.low, self.k.high, self.ti.high) else { return false };
        low * high > 0.0 && longest.is_finite() && self.r2.is_some_and(|explained| explained >= r2)
    }
}

/// A value with its 95 % interval, as far as they are known.
#[derive(Clone, Copy, Debug, Default)]
pub struct Interval {
    /// The value.
    pub value: Option<f64>,
    /// Lower end.
    pub low: Option<f64>,
    /// Upper end.
    pub high: Option<f64>,
}

/// Everything that is looked for, in the order of [`Fault::ALL`].
const TESTS: [fn(&Look<'_>, &mut Vec<Finding>); 17] = [
    times::rows,
    times::times,
    numbers::numbers,
    spans::spans,
    mode::mode,
    numbers::constants,
    controller::winding_up,
    mode::setpoint,
    times::sampling,
    historian::historian,
    historian::spikes,
    historian::shifts,
    grids::grids,
    settings::settings,
    settings::exchanged,
    controller::rests,
    oscillation::sinusoid,
];

/// Findings on a recording, in the order of [`Fault::ALL`]; none for a healthy one.
///
/// `rows` are the first of the recording, `statistics` counts all of them.
///
/// ```
/// use glapp_analysis::quality::{Fault, Known, Severity, inspect};
/// use glapp_analysis::{Counter, Inspected};
/// let t: Vec<f64> = (0..50).map(f64::from).collect();
/// let rows = Inspected { t: &t, sp: Some(&[21.0; 50]), pv: &[20.0; 50], op: Some(&[20.0; 50]), flags: None };
/// let mut counter = Counter::new(3.0, None)?;
/// counter.run(&rows);
/// let found = inspect(&rows, &counter.statistics, &Known::default());
/// assert_eq!((found[0].fault, found[0].severity), (Fault::OpConstant, Severity::Refuse));
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
pub fn inspect(rows: &Inspected<'_>, statistics: &DataStatistics, known: &Known) -> Vec<Finding> {
    let look = Look::new(rows, statistics, known);
    let mut found = Vec::new();
    for test in TESTS {
        test(&look, &mut found);
    }
    found
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod threshold_tests;
