//! Step test in manual: OP is stepped, held, stepped on and stepped back; the dead band and the process gain are read off PV.
//!
//! A dead band of total width d lets the valve follow OP only at its edges. Where OP last drove the valve in direction s (+1 up,
//! −1 down) and is held, a self-regulating process settles at
//!
//! ```text
//! PV = a + Kp (OP − s d/2).
//! ```
//!
//! A move in the same direction as the last one therefore gives the process gain, (8.1) and (8.2) of the thesis,
//!
//! ```text
//! Kp = ΔPV/ΔOP,
//! ```
//!
//! and a reversal gives the dead band, the part of OP's move that PV does not answer,
//!
//! ```text
//! d = |ΔOP| − |ΔPV|/|Kp|.
//! ```
//!
//! All settled holds together are one regression on OP and s, with noise and drift of unknown size ([`posterior`]). Of an
//! integrating process slopes stand for levels. What is said beside the numbers is a code with its numbers: [`Reason`],
//! [`Note`], [`Evidence`]. `docs/step-test.md` has how often the interval held the truth.

mod asked;
mod blocks;
mod holds;
mod moves;
mod posterior;
mod response;
mod rows;
mod settling;
mod verdict;

pub use asked::{Asked, Found};
pub use rows::{ManualRows, ManualStretch};

use serde::{Deserialize, Serialize};

/// Rows that a hold, and the settled part of one, must have: fewer do not tell noise from drift.
pub const LEAST_ROWS: usize = 10;

/// Rows of a recording made in manual.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Manual {
    /// Rows whose flags say so.
    #[default]
    Flagged,
    /// All of them: the recording has no mode.
    All,
    /// No information.
    Unknown,
}

/// Facts known of the loop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StepTestSettings {
    /// The process integrates: slopes of PV are read in place of levels.
    pub integrating: bool,
    /// Width of OP's span [OP unit], where it is known.
    pub op_span: Option<f64>,
    /// Dead band that the positioner is set to [% of travel], where it is known.
    pub positioner_dead_band: Option<f64>,
    /// Width in question, > 0 [OP unit]: [`StepTest::asked`] says whether the test has decided it.
    pub width: Option<f64>,
}

/// Dead band and process gain as a step test shows them, or why it shows none.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StepTest {
    /// Why there is no width; none where there is one.
    pub reason: Option<Reason>,
    /// Total width of the dead band at the valve's input [OP unit].
    pub d: Option<f64>,
    /// Lower limit of its 95 % interval, at least 0 [OP unit]; without `d` a lower bound, where PV did not answer a reversal.
    pub low: Option<f64>,
    /// Upper limit [OP unit].
    pub high: Option<f64>,
    /// `d` [% of OP's span], where the span is known.
    pub d_percent_span: Option<f64>,
    /// Process gain [PV unit/OP unit]; of an integrating process the velocity gain [PV unit/(OP unit·s)].
    pub kp: Option<f64>,
    /// Lower limit of its 95 % interval.
    pub kp_low: Option<f64>,
    /// Upper limit.
    pub kp_high: Option<f64>,
    /// Smallest move in the direction of the one before that PV surely answered [OP unit]: the resolution is no coarser.
    pub resolution: Option<f64>,
    /// Whether slopes were read in place of levels.
    pub integrating: bool,
    /// Time that PV was given to settle after each move \[s\]; none of an integrating process.
    pub settle: Option<f64>,
    /// Holds of OP.
    pub holds: Vec<Hold>,
    /// Reading of each move.
    pub readings: Vec<Reading>,
    /// Notes for a person, beyond the numbers.
    pub notes: Vec<Note>,
    /// Whether the test has decided the width in question; none where none was asked for.
    pub asked: Option<Asked>,
    /// The test as read from the valve's position, where it was recorded, with travel \[%\] in place of PV.
    pub travel: Option<Box<StepTest>>,
}

/// One stretch in which OP was held.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Hold {
    /// First row \[s\].
    pub start: f64,
    /// Last row \[s\].
    pub end: f64,
    /// Time from which PV is taken as settled \[s\]; none where the hold ended before that.
    pub settled: Option<f64>,
    /// OP [OP unit].
    pub op: f64,
    /// Mean of settled PV [PV unit]; of an integrating process its slope [PV unit/s]. None where PV was not settled.
    pub level: Option<f64>,
    /// +1 where OP then pressed the valve upwards, −1 downwards, 0 where that is not known or the hold is not used.
    pub side: i8,
}

/// Reading of one move from hold to hold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Reading {
    /// Kind of reading.
    pub kind: Kind,
    /// Last row of the hold before \[s\].
    pub start: f64,
    /// Last row of the hold after \[s\].
    pub end: f64,
    /// OP before and after [OP unit].
    pub op: (f64, f64),
    /// Settled PV, or its slope, before and after [PV unit, PV unit/s].
    pub pv: (f64, f64),
    /// Kp [PV unit/OP unit] or d [OP unit]; none where it gives neither.
    pub value: Option<f64>,
    /// Lower limit of its 95 % interval.
    pub low: Option<f64>,
    /// Upper limit.
    pub high: Option<f64>,
    /// Time from OP's step until 86.5 % of PV's way is gone \[s\]; none where OP was not stepped at once or noise hides it.
    pub t86: Option<f64>,
    /// Overshoot of PV beyond its new level, as a fraction of its way; 0 where it is within the noise.
    pub overshoot: Option<f64>,
    /// Evidence of the reading, or the reason why there is none; none where the gain was not known.
    pub evidence: Option<Evidence>,
}

/// Kind of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The process gain: it goes on in the direction of the move before.
    Gain,
    /// The dead band: it is a reversal.
    Gap,
    /// No reading.
    None,
}

/// Evidence of a reading, or the reason why there is none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
pub enum Evidence {
    /// Kp = ΔPV/ΔOP.
    Gain {
        /// ΔPV [PV unit], of an integrating process the change of its slope [PV unit/s].
        delta_pv: f64,
        /// ΔOP [OP unit].
        delta_op: f64,
    },
    /// d = |ΔOP| − |ΔPV|/|Kp|.
    Gap {
        /// |ΔOP| [OP unit].
        delta_op: f64,
        /// |ΔPV| [PV unit].
        delta_pv: f64,
        /// |Kp| [PV unit/OP unit].
        kp: f64,
    },
    /// The first move: where in its dead band the valve stood before is not known.
    FirstMove,
    /// OP turned between two holds without being held.
    Turned,
    /// PV did not answer.
    Unanswered,
    /// PV went the other way: the load moved.
    Opposite,
}

/// Why a recording gives no width.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
pub enum Reason {
    /// OP was not recorded.
    NoOp,
    /// No column tells when the loop was in manual.
    NoMode,
    /// The loop was never in manual.
    NeverManual,
    /// No manual stretch is long enough without a gap in time or in OP.
    NoStretch {
        /// Rows that it must have.
        rows: usize,
    },
    /// OP was never held for long enough with a good PV.
    NeverHeld {
        /// Rows that a hold must have.
        rows: usize,
    },
    /// OP was held at one value only.
    OneValue,
    /// PV did not settle before the next step.
    NotSettled {
        /// Holds that last long enough.
        settled: usize,
        /// All holds.
        holds: usize,
        /// Time that a hold must last \[s\].
        needed: f64,
    },
    /// An integrating process: too few holds are long enough for a slope.
    TooFewHolds {
        /// Holds that last long enough.
        settled: usize,
        /// Rows that a hold must have.
        rows: usize,
    },
    /// Fewer than three settled holds follow each other at different OP.
    NotInARow,
    /// The holds are too short to tell noise from drift.
    TooShort,
    /// PV did not answer any move.
    UnansweredMoves {
        /// The largest [OP unit].
        largest: f64,
    },
    /// No move goes on in the direction of one that PV answered: the gain is not known.
    NoGain,
    /// The gain is not known, and holds ended before PV had settled.
    NoGainUnsettled {
        /// Number of such holds.
        unsettled: usize,
        /// All holds.
        holds: usize,
    },
    /// PV did not answer a second move in the same direction: the gain may be 0.
    GainNearZero,
    /// The readings disagree by so much that the gain may be 0.
    GainNearZeroDisagree {
        /// F ratio.
        f: f64,
    },
    /// OP never reverses after a move that PV answered.
    NoReversal,
    /// PV did not answer the reversal: the dead band is at least so wide.
    AtLeast {
        /// Size of the reversal [OP unit].
        reversal: f64,
        /// Lower bound of d [OP unit].
        at_least: f64,
    },
}

/// Note for a person, beyond the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
pub enum Note {
    /// Only the first holds are read.
    FirstHolds {
        /// Number of readings.
        read: usize,
        /// Number that follow.
        left: usize,
    },
    /// The readings disagree by more than noise and drift explain, and the interval is widened by the F ratio.
    Disagree {
        /// F ratio.
        f: f64,
    },
    /// The interval reaches 0.
    ReachesZero {
        /// Upper limit of d [OP unit].
        high: f64,
    },
    /// The positioner's own part of the dead band, by its settings.
    Positioner {
        /// [% of travel].
        percent: f64,
    },
    /// The positioner's own part of the dead band, where OP's span is known.
    PositionerOfSpan {
        /// [% of travel].
        percent: f64,
        /// Width of that part [OP unit].
        width: f64,
    },
}

impl StepTest {
    fn refused(reason: Reason) -> Self {
        Self { reason: Some(reason), ..Self::default() }
    }
}

/// Distance from the least to the greatest.
fn range(x: &[f64]) -> f64 {
    let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)));
    high - low
}
