//! The input of the three parts of an answer.

use super::Message;
use serde::Deserialize;
use std::collections::BTreeMap;

/// The one answer of a loop under the names of its document, and beside it what its sentences need more. All of it may be absent.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct AnswerFacts {
    /// The verdict.
    pub verdict: String,
    /// State of the valve.
    pub valve: String,
    /// *found*, *likely*, *cannot_tell*, *likely_sound*, *none_seen*, *sound*, *refused*, *not_judged*.
    pub confidence: Option<String>,
    /// *backlash*, *stiction*, *both*, *dead_band*.
    pub cause: Option<String>,
    /// *interval*, *bound*, *unsure*.
    pub width_kind: Option<String>,
    /// The width [OP unit].
    pub width: Option<f64>,
    /// Width [% of span].
    pub width_percent_span: Option<f64>,
    /// Limits of the width [OP unit].
    pub low: Option<f64>,
    /// Upper one.
    pub high: Option<f64>,
    /// Strength of the recording's evidence for a gap.
    pub evidence: Option<String>,
    /// Probability of a dead band, and of one beyond the limit.
    pub p_gap: Option<f64>,
    /// See `p_gap`.
    pub p_beyond: Option<f64>,
    /// Share of valves with a dead band that `p_gap` starts from.
    pub prior: Option<f64>,
    /// Contribution of each kind of evidence to the log-odds of a dead band.
    pub terms: Option<BTreeMap<String, f64>>,
    /// The width compared with the limit.
    pub acceptable: Option<String>,
    /// Next step.
    pub next: Next,
    /// Urgency.
    pub urgency: String,
    /// Why the crossings' width does not stand.
    pub struck: Option<Struck>,
    /// The widest dead band that is allowed.
    pub limit: Option<Limit>,
    /// Trend of the width.
    pub trend: Option<Trend>,
    /// Width of OP's span [OP unit], where it is known.
    pub span: Option<f64>,
    /// Width by a step test in the recording.
    pub step_test: Option<Tested>,
    /// Result of the fit; none where nothing was fitted.
    pub fit: Option<Fit>,
    /// OP is recorded, and nobody asked for the fit.
    pub fit_left_out: bool,
    /// Time between rows that the loop needs \[s\], where PV does not follow OP and rows too far apart may be why.
    pub enough: Option<f64>,
    /// Time between rows \[s\], where the fit finds it too long for the process.
    pub apart: Option<f64>,
    /// Result of the zero crossings.
    pub crossings: Crossings,
}

/// A next step.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Next {
    /// Code of the step.
    pub code: String,
    /// Subject of the step.
    pub of: Option<String>,
    /// The recording holds a step test: its result is used, and no further one is asked for.
    pub tested: bool,
}

/// Contradiction of the crossings to the fit.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Struck {
    /// *above*, *below*, *sound*.
    pub code: String,
    /// The fit's limit [OP unit].
    pub limit: f64,
}

/// The widest dead band that is allowed.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Limit {
    /// [% of span]
    pub percent_span: Option<f64>,
    /// *given* or *nominal*.
    pub origin: String,
}

/// Trend of the width.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Trend {
    /// *steady*, *grows*, *shrinks*.
    pub code: String,
    /// First and last moment \[s\].
    pub t: Option<(f64, f64)>,
    /// The line's width there [OP unit].
    pub d: Option<(f64, f64)>,
    /// Days until the limit is reached.
    pub days_to_limit: Option<f64>,
}

/// The width of a step test with its limits [OP unit].
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Tested {
    /// [OP unit]
    pub d: Option<f64>,
    /// [OP unit]
    pub low: Option<f64>,
    /// [OP unit]
    pub high: Option<f64>,
    /// *gap* or *no_gap* where the test was made for that question and has decided it.
    pub decided: Option<String>,
}

/// Facts of the fit beyond those of the answer.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Fit {
    /// The word for why.
    pub why: String,
    /// The most likely width [OP unit], whether it counts or not.
    pub d: Option<f64>,
    /// Slip jump [OP unit].
    pub jump: Option<f64>,
    /// Effect of a recorded position.
    pub position: Option<String>,
    /// Sentence of the verdict, with the evidence.
    pub reason: String,
    /// Recordings that count, of so many.
    pub recordings: Option<(i64, i64)>,
}

/// Result of the zero crossings.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Crossings {
    /// *estimate*, *provisional*, *no_estimate*, *refused*.
    pub verdict: String,
    /// Why not more, in a sentence.
    pub reason: Option<String>,
    /// Width by the crossings [OP unit].
    pub d_hat: Option<f64>,
    /// Width by the crossings [% of span].
    pub d_hat_percent_span: Option<f64>,
    /// Accepted half-periods.
    pub detections: i64,
    /// Accepted and rejected ones.
    pub half_periods: i64,
    /// Detections behind one estimate.
    pub n: i64,
    /// Smallest and largest detection [OP unit].
    pub repeatability: Option<(f64, f64)>,
    /// The noise limit [OP unit].
    pub noise_floor: Option<f64>,
    /// The width with its known bias taken out.
    pub corrected: Option<Corrected>,
    /// The most frequent reason of rejection, and how often it was.
    pub rejected: Option<(String, i64)>,
    /// The positioner's own dead band [% of travel].
    pub positioner: Option<f64>,
}

/// The crossings' width with its known bias taken out.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Corrected {
    /// [OP unit]; none: `reason` tells why.
    pub d: Option<f64>,
    /// [OP unit]
    pub low: Option<f64>,
    /// [OP unit]
    pub high: Option<f64>,
    /// [PV unit/OP unit]
    pub kp: Option<f64>,
    /// Range of Kp; none where it was known.
    pub kp_range: Option<(f64, f64)>,
    /// Pairs of half-periods.
    pub pairs: i64,
    /// *op* or *(4.1)*.
    pub travel: String,
    /// Why there is no width.
    pub reason: Option<String>,
}

impl AnswerFacts {
    /// Whether the fit has answered.
    pub(super) fn fitted(&self) -> bool {
        self.evidence.is_some()
    }

    /// Acceptable limit [% of span].
    pub(super) fn limit_percent(&self) -> Option<f64> {
        self.limit.as_ref().and_then(|limit| limit.percent_span)
    }

    /// A message with the numbers that the answer's sentences share.
    pub(super) fn message(&self, code: &str) -> Message {
        let fit = self.fit.clone().unwrap_or_default();
        Message::new(format!("answer.{code}"))
            .with("width", self.width)
            .with("low", self.low)
            .with("high", self.high)
            .with("percent", self.limit_percent())
            .with("jump", fit.jump)
            .with("d", fit.d)
            .with("enough", self.enough)
            .with("apart", self.apart)
            .with("d_hat", self.crossings.d_hat)
            .with("detections", super::Value::Count(self.crossings.detections))
    }
}
