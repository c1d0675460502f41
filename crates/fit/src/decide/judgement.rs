//! The ladder: the judgement on a valve, in fields that do not mix questions.

use serde::{Deserialize, Serialize};

/// Confidence that there is a gap, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Confidence {
    /// A gap is certain: at most one in a hundred records without one gets this.
    Found,
    /// A gap is probable: a step test should confirm it.
    Likely,
    /// The record does not tell.
    CannotTell,
    /// No gap wider than the upper limit.
    NoneSeen,
}

/// Cause of the lost motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// Play between OP and the valve: the valve's own position shows that it does not stick.
    Backlash,
    /// A valve that sticks and jumps, no gap beside it.
    Stiction,
    /// Backlash and stiction.
    Both,
    /// OP must move by so much after a reversal before PV answers, without a jump that shows: packing or play. PV does not tell them apart.
    DeadBand,
}

/// Kind of the width.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WidthKind {
    /// A width with two limits.
    Interval,
    /// A lower limit.
    Bound,
    /// The most likely width only: the gap is there, its limits are not to be trusted.
    Unsure,
}

/// Verdict of the record on the valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// A gap.
    Backlash,
    /// A valve that sticks and jumps, no gap beside it.
    Stiction,
    /// Backlash and stiction.
    Both,
    /// No gap wider than the upper limit.
    Sound,
    /// A gap, wider than the lower limit; OP did not move far enough to show how much.
    AtLeast,
    /// The record cannot tell.
    CannotTell,
}

impl Verdict {
    /// Whether it says that there is a gap, or a valve that sticks.
    pub fn claims(self) -> bool {
        !matches!(self, Self::Sound | Self::CannotTell)
    }
}

/// Judgement on a valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Judgement {
    /// Confidence that there is a gap.
    pub confidence: Confidence,
    /// Cause of the lost motion; None where none is found or likely.
    pub cause: Option<Cause>,
    /// Kind of the width; none where there is no width.
    pub width_kind: Option<WidthKind>,
    /// Whether OP swings to and fro in almost even time, whatever makes it.
    pub oscillates: bool,
}

impl Judgement {
    /// Judgement without a gap.
    pub(crate) const fn without(confidence: Confidence, oscillates: bool) -> Self {
        Self { confidence, cause: None, width_kind: None, oscillates }
    }

    /// The verdict: it claims a found gap, and no likely one. `low`: the lower limit of the width.
    pub fn verdict(&self, low: f64) -> Verdict {
        match (self.confidence, self.width_kind, self.cause) {
            (Confidence::NoneSeen, ..) => Verdict::Sound,
            (Confidence::Found, Some(WidthKind::Bound), _) => Verdict::AtLeast,
            (Confidence::Found, Some(WidthKind::Unsure), _) if low > 0.0 => Verdict::AtLeast,
            (Confidence::Found, Some(WidthKind::Interval), Some(Cause::Stiction)) => Verdict::Stiction,
            (Confidence::Found, Some(WidthKind::Interval), Some(Cause::Both)) => Verdict::Both,
            (Confidence::Found, Some(WidthKind::Interval), _) => Verdict::Backlash,
            _ => Verdict::CannotTell,
        }
    }

    /// Whether a gap is found or likely.
    pub fn tells(&self) -> bool {
        matches!(self.confidence, Confidence::Found | Confidence::Likely)
    }

    /// Judgement by a verdict on a valve's own position, which distinguishes play from sticking.
    pub fn at_valve(verdict: Verdict) -> Self {
        let (confidence, cause, width_kind) = match verdict {
            Verdict::Backlash => (Confidence::Found, Some(Cause::Backlash), Some(WidthKind::Interval)),
            Verdict::Stiction => (Confidence::Found, Some(Cause::Stiction), Some(WidthKind::Interval)),
            Verdict::Both => (Confidence::Found, Some(Cause::Both), Some(WidthKind::Interval)),
            Verdict::AtLeast => (Confidence::Found, Some(Cause::DeadBand), Some(WidthKind::Bound)),
            Verdict::Sound => (Confidence::NoneSeen, None, None),
            Verdict::CannotTell => (Confidence::CannotTell, None, None),
        };
        Self { confidence, cause, width_kind, oscillates: false }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gap(confidence: Confidence, cause: Cause, kind: WidthKind) -> Judgement {
        Judgement { confidence, cause: Some(cause), width_kind: Some(kind), oscillates: false }
    }

    #[test]
    fn a_verdict_claims_only_what_is_found() {
        use {Cause::*, Confidence::*, WidthKind::*};
        assert_eq!(gap(Found, DeadBand, Interval).verdict(0.5), Verdict::Backlash);
        assert_eq!(gap(Found, Cause::Stiction, Interval).verdict(0.5), Verdict::Stiction);
        assert_eq!(gap(Found, DeadBand, Bound).verdict(0.5), Verdict::AtLeast);
        assert_eq!(gap(Found, DeadBand, Unsure).verdict(0.5), Verdict::AtLeast);
        assert_eq!(gap(Found, DeadBand, Unsure).verdict(0.0), Verdict::CannotTell);
        assert_eq!(gap(Likely, Cause::Both, Interval).verdict(0.5), Verdict::CannotTell);
        assert_eq!(Judgement::without(NoneSeen, true).verdict(0.0), Verdict::Sound);
    }
}
