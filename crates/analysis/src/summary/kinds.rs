//! The words of the one answer, each with a fixed set of values.

use crate::crossings::Verdict;
use crate::fitted::FitVerdict;
use crate::trend::WidthTrend;
use glapp_core::Reason;
use serde::ser::SerializeStruct;
use serde::{Serialize, Serializer};

/// Confidence that there is a dead band.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Confidence {
    /// A dead band is certain.
    Found,
    /// A dead band is probable: a step test would settle it.
    Likely,
    /// The data can be explained with a dead band and without.
    CannotTell,
    /// One wider than the acceptable limit is improbable; whether there is a narrower one the data do not tell.
    LikelySound,
    /// None shows above the bound that is given.
    NoneSeen,
    /// No dead band wider than the acceptable limit.
    Sound,
    /// Data or settings allow no answer.
    Refused,
    /// OP and PV were not fitted: zero crossings alone do not judge a valve.
    NotJudged,
}

/// Source of the acceptable limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LimitOrigin {
    /// A person, for this loop.
    Given,
    /// The default [`NOMINAL_LIMIT`].
    Nominal,
}

/// Widest dead band that is acceptable.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Limit {
    /// [% of OP's span].
    pub percent_span: f64,
    /// Width [OP unit], where the span is known.
    pub width: Option<f64>,
    /// Source of the limit.
    pub origin: LimitOrigin,
}

/// Health of the valve by NAMUR NE 107, in the names of OPC UA's DeviceHealthEnumeration. Faults of signals come on top, where
/// they are seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Health {
    /// No work needed.
    Normal,
    /// A dead band was found, and not all of it is acceptable.
    MaintenanceRequired,
}

/// Trend of the width [OP unit, days].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Moves {
    /// The change.
    #[serde(flatten)]
    pub trend: WidthTrend,
    /// Days until the width reaches the acceptable limit, from the newest width on; none where it does not grow
    /// plainly, is there already, or no limit is known.
    pub days_to_limit: Option<f64>,
}

/// Next step, and whether a step test in the recording already gives the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NextStep {
    /// Next step.
    pub step: Next,
    /// The recording holds a step test: its result is used, and no further one is asked for.
    pub tested: bool,
}

/// Whose verdict it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum One {
    /// The fit's.
    Fit(FitVerdict),
    /// The crossings', where nothing was fitted.
    Crossings(Verdict),
}

/// State of the valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Valve {
    /// The valve has a gap.
    Gap,
    /// The valve shows no gap.
    NoGap,
    /// No statement on the valve is possible.
    Unknown,
    /// Data or settings allow no answer.
    Refused,
}

/// Strength of the recording's evidence for a gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Evidence {
    /// Next to not at all.
    None,
    /// Less than it takes.
    Weak,
    /// More than it takes.
    Strong,
    /// Much more.
    VeryStrong,
}

/// The width compared with the acceptable limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Acceptable {
    /// All of its interval is acceptable.
    Within,
    /// All of it is too wide.
    Beyond,
    /// The interval holds the limit.
    Open,
}

/// Part to look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Play in linkage, keys and actuator.
    Play,
    /// Packing, seat and air supply.
    Packing,
    /// Valve and controller.
    Both,
}

/// Next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Correct the named fault.
    Correct,
    /// Look at the valve, and confirm with a step test before work is ordered.
    Inspect(Part),
    /// Record while OP moves further, to learn how much it is.
    Further,
    /// Record for longer, while OP moves further, or make a step test.
    RecordMore,
    /// Look at the tuning, or for a disturbance; where the loop swings through an acceptable gap, at the tuning or a compensation.
    Tuning,
    /// No step now.
    Nothing,
    /// No step now: the whole interval of the width is acceptable.
    Review,
    /// Confirm the crossings' width with a step test, then plan work.
    Confirm,
    /// Compare the crossings' width with the acceptable limit.
    Compare,
    /// Record for longer: the crossings' width is provisional.
    RecordLonger,
    /// The crossings' width is provisional and would be too wide.
    ProbablyTooWide,
    /// Only a step test tells.
    StepTest,
    /// Remedy of the most common reason of rejection.
    Remedy(Reason),
}

/// Urgency of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Urgency {
    /// No work waits.
    None,
    /// The answer is not yet one; when there is time.
    Low,
    /// At the next round.
    Medium,
    /// First: the valve is worse than is acceptable.
    High,
}

/// Why the crossings' width is struck.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Struck {
    /// Kind of contradiction to the fit.
    pub code: Contradiction,
    /// The fit's limit [OP unit].
    pub limit: f64,
}

/// Kind of contradiction between crossings and fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Contradiction {
    /// Wider than the fit allows: a load that moves looks so.
    Above,
    /// Narrower than the fit allows: the half-periods do not cross the whole gap.
    Below,
    /// A width of a valve that shows no gap.
    Sound,
}
impl Serialize for NextStep {
    /// A code, its subject (none where it has none), and whether it was tested: always all three.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_struct("NextStep", 3)?;
        fields.serialize_field("code", self.step.code())?;
        match self.step {
            Next::Inspect(part) => fields.serialize_field("of", &part)?,
            Next::Remedy(reason) => fields.serialize_field("of", &reason)?,
            _ => fields.serialize_field("of", &None::<()>)?,
        }
        fields.serialize_field("tested", &self.tested)?;
        fields.end()
    }
}

impl Next {
    /// The name used in every face of glapp.
    pub const fn code(self) -> &'static str {
        match self {
            Self::Correct => "correct",
            Self::Inspect(_) => "inspect",
            Self::Further => "further",
            Self::RecordMore => "record_more",
            Self::Tuning => "tuning",
            Self::Nothing => "nothing",
            Self::Review => "review",
            Self::Confirm => "confirm",
            Self::Compare => "compare",
            Self::RecordLonger => "record_longer",
            Self::ProbablyTooWide => "probably_too_wide",
            Self::StepTest => "step_test",
            Self::Remedy(_) => "remedy",
        }
    }

    /// Whether it asks for a step test, or its result.
    pub(super) const fn asks_for_a_test(self) -> bool {
        !matches!(self, Self::Tuning | Self::Nothing | Self::Review | Self::RecordLonger)
    }
}
