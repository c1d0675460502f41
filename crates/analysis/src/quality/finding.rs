//! One fault or peculiarity of a recording.

use crate::words::Value;
use glapp_core::named;
use serde::ser::{Serialize, SerializeStruct, Serializer};

named! {
    /// Severity of a finding.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Severity {
        /// Good to know.
        Info => "info",
        /// The estimate may be off, or few half-periods are left.
        Warning => "warning",
        /// No estimate from this recording can be right.
        Refuse => "refuse",
    }
}

macro_rules! faults {
    ($($(#[$meaning:meta])* $fault:ident = $name:literal: $($severity:ident)+;)*) => {
        /// Kind of a finding, in the order of the checks.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Fault {
            $($(#[$meaning])* $fault),*
        }

        impl Fault {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$fault),*];

            /// Stable name, the code in every interface.
            pub fn name(self) -> &'static str {
                match self { $(Self::$fault => $name),* }
            }

            /// The severities that it can have, the least grave first.
            pub fn severities(self) -> &'static [Severity] {
                match self { $(Self::$fault => &[$(Severity::$severity),+]),* }
            }
        }
    };
}

faults! {
    /// The unit of the time column was not plain.
    TimeAssumed = "time_assumed": Info Warning;
    /// Signals were recorded each at times of its own, and were brought to common rows.
    OwnTimes = "own_times": Info;
    /// The newest row comes first, so the rows are taken from the last to the first.
    NewestFirst = "newest_first": Info;
    /// A given setting that this recording has no use for.
    SettingUnused = "setting_unused": Warning;
    /// Too few rows for any statement.
    TooFewRows = "too_few_rows": Refuse;
    /// Rows whose time is not a number.
    TimeMissing = "time_missing": Warning Refuse;
    /// A row is earlier than the one before it.
    TimeReversed = "time_reversed": Refuse;
    /// A row has the time of the one before it.
    TimeRepeated = "time_repeated": Warning Refuse;
    /// Steps much longer than the ordinary one.
    Gaps = "gaps": Warning;
    /// A signal is empty, text, NaN or infinite.
    NotANumber = "not_a_number": Info Warning Refuse;
    /// The quality column says not good.
    BadQuality = "bad_quality": Info Warning Refuse;
    /// A signal leaves the span that it is said to have, or OP looks as if it had another one.
    Span = "span": Warning Refuse;
    /// The loop is in manual.
    NotAuto = "not_auto": Info Warning Refuse;
    /// OP is at a limit.
    AtLimit = "at_limit": Info Warning Refuse;
    /// SP is not recorded.
    NoSp = "no_sp": Info;
    /// OP is not recorded.
    NoOp = "no_op": Info;
    /// OP has one value only.
    OpConstant = "op_constant": Refuse;
    /// PV has one value only.
    PvConstant = "pv_constant": Refuse;
    /// Two of the signals are one.
    SameSignal = "same_signal": Refuse;
    /// OP goes one way all along, and PV does not answer.
    WindingUp = "winding_up": Refuse;
    /// SP moves all the time.
    CascadeSlave = "cascade_slave": Warning;
    /// Samples are far apart against Ti.
    Sampling = "sampling": Warning;
    /// The historian stood still, not the loop.
    Frozen = "frozen": Warning;
    /// PV is held or interpolated between a historian's compressed values.
    CompressedPv = "compressed_pv": Warning;
    /// Samples of PV that stand alone.
    Spikes = "spikes": Info Warning;
    /// PV goes to another level from one row to the next.
    Shifts = "shifts": Warning;
    /// PV lies on a coarse grid.
    QuantisedPv = "quantised_pv": Info Warning;
    /// OP lies on a coarse grid.
    QuantisedOp = "quantised_op": Info Warning;
    /// OP moves with the other sign than the settings say.
    Sign = "sign": Warning;
    /// OP moves with another K, Ti or Td than the settings say.
    Settings = "settings": Warning;
    /// A controller's law shows in what PV does when OP moves, and none in what OP does.
    Exchanged = "exchanged": Refuse;
    /// OP rests while the error is small and moves beyond.
    ErrorGap = "error_gap": Warning;
    /// OP rests, and otherwise jumps by no less than some size.
    OutputDeadBand = "output_dead_band": Warning;
    /// The error is one clean sinusoid.
    Sinusoidal = "sinusoidal": Warning;
    /// Much of the width depends on a process gain that nobody gave.
    KpAssumed = "kp_assumed": Warning;
}

/// One fault or peculiarity of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Kind.
    pub fault: Fault,
    /// Severity.
    pub severity: Severity,
    /// Numbers of the evidence by name, in order.
    pub evidence: Vec<(&'static str, Value)>,
    /// Further numbers for its sentence.
    pub numbers: Vec<(&'static str, Value)>,
}

impl Finding {
    pub(crate) fn new(fault: Fault, severity: Severity) -> Self {
        Self { fault, severity, evidence: Vec::new(), numbers: Vec::new() }
    }

    /// Adds a number as evidence.
    pub(super) fn with(mut self, name: &'static str, value: impl Into<Value>) -> Self {
        self.evidence.push((name, value.into()));
        self
    }

    /// Adds a number for the sentence alone.
    pub(super) fn telling(mut self, name: &'static str, value: impl Into<Value>) -> Self {
        self.numbers.push((name, value.into()));
        self
    }
}

impl Serialize for Finding {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut out = serializer.serialize_struct("Finding", 4)?;
        out.serialize_field("code", self.fault.name())?;
        out.serialize_field("severity", &self.severity)?;
        out.serialize_field("evidence", &InOrder(&self.evidence))?;
        out.serialize_field("numbers", &InOrder(&self.numbers))?;
        out.end()
    }
}

/// Pairs of a name and its value, as a map that keeps their order.
pub(crate) struct InOrder<'a, T>(pub &'a [(&'static str, T)]);

impl<T: Serialize> Serialize for InOrder<'_, T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(name, value)| (name, value)))
    }
}
