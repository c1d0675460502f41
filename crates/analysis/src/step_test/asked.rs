//! A width in question, and whether the test has decided it.
//!
//! The test decides for a gap where it is narrower than a fifth of the width with a probability of 2.5 % at most, and for no gap
//! so wide where it is wider than four fifths with that probability: where the 95 % interval begins above the one, or ends below
//! the other. That holds for a test that is over. Whoever looks at it while it goes on, and ends it as soon as it has decided,
//! looks many times, and each look may be the wrong one. Such a look decides at 0.1 % only (Haybittle 1971, Peto et al. 1976:
//! stopping clinical trials early). The look at the end then keeps its 2.5 %.

use serde::{Deserialize, Serialize};

/// Part of the width at whose either end nothing is decided.
///
/// Where the load wanders, the 95 % interval holds the width in 91 to 95 of 100 tests: at 0 and at the width itself one in twenty
/// would decide wrongly.
const MARGIN: f64 = 0.2;
/// Probability of the contrary at which a test that is over decides: the tail of the 95 % interval on either side.
const AT_END: f64 = 0.025;
/// Probability of error while the test goes on.
const EARLY: f64 = 0.001;
/// A reversal that PV did not answer decides early where the gap is surely wider than so much of the width.
const UNANSWERED: f64 = 0.5;

/// Decision of the test.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Found {
    /// The gap exists.
    Gap,
    /// No gap of that width exists.
    NoGap,
}

/// Answer of the test on a width in question.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Asked {
    /// The width [OP unit].
    pub width: f64,
    /// Probability that the gap is narrower than a fifth of it; none where the test gives no width.
    pub narrower: Option<f64>,
    /// Probability that the gap is wider than four fifths of it.
    pub wider: Option<f64>,
    /// Decision if the test is over; none where it is open.
    pub found: Option<Found>,
    /// Decision while the test goes on: it may then be ended.
    pub early: Option<Found>,
}

impl Asked {
    /// An answer with nothing decided.
    pub(super) fn open(width: f64) -> Self {
        Self { width, narrower: None, wider: None, found: None, early: None }
    }

    /// Answer by the probability that the gap is below x.
    pub(super) fn by(width: f64, below: impl Fn(f64) -> f64) -> Self {
        let (narrower, wider) = (below(MARGIN * width), 1.0 - below((1.0 - MARGIN) * width));
        let decided = |at: f64| match () {
            () if narrower < at => Some(Found::Gap),
            () if wider < at => Some(Found::NoGap),
            () => None,
        };
        Self {
            narrower: Some(narrower),
            wider: Some(wider),
            found: decided(AT_END),
            early: decided(EARLY),
            ..Self::open(width)
        }
    }

    /// Answer by a lower bound alone.
    pub(super) fn at_least(width: f64, bound: f64) -> Self {
        let gap = |share: f64| (bound > share * width).then_some(Found::Gap);
        Self { found: gap(MARGIN), early: gap(UNANSWERED), ..Self::open(width) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_look_while_the_test_goes_on_decides_later_than_the_last() {
        let sure = |narrower: f64, wider: f64| Asked::by(1.0, |x| if x < 0.5 { narrower } else { 1.0 - wider });
        let outcome = |asked: Asked| (asked.found, asked.early);
        assert_eq!(outcome(sure(0.026, 1.0)), (None, None));
        assert_eq!(outcome(sure(0.024, 1.0)), (Some(Found::Gap), None));
        assert_eq!(outcome(sure(0.0009, 1.0)), (Some(Found::Gap), Some(Found::Gap)));
        assert_eq!(outcome(sure(1.0, 0.024)), (Some(Found::NoGap), None));
        assert_eq!(outcome(sure(1.0, 0.0009)), (Some(Found::NoGap), Some(Found::NoGap)));
    }

    #[test]
    fn a_lower_bound_shows_a_gap_and_never_that_there_is_none() {
        let outcome = |bound| (Asked::at_least(2.0, bound).found, Asked::at_least(2.0, bound).early);
        assert_eq!(outcome(0.3), (None, None));
        assert_eq!(outcome(0.5), (Some(Found::Gap), None));
        assert_eq!(outcome(1.1), (Some(Found::Gap), Some(Found::Gap)));
    }
}
