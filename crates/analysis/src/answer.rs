//! The answer of one loop as it is shown, stored and sent: numbers and names, no sentences.

use crate::crossings::{NotCorrected, Travel, Verdict, Why};
use crate::fitted::FitAnswer;
use crate::harm::Harm;
use crate::identify::Identification;
use crate::origin::Origin;
use crate::quality::{Finding, InOrder};
use crate::step_test::StepTest;
use crate::summary::{Facts, FitFacts, StepTestWidth, Summary};
use crate::words::Message;
use glapp_core::{Corrected, Reason, TravelSource};
use serde::{Serialize, Serializer};

/// Everything the crates know of one loop's valve, and its evidence. Every face shows this; `glapp.document` declares
/// its JSON.
#[derive(Clone, Debug, Serialize)]
pub struct AnalysisResult {
    /// Layout, [`AnalysisResult::VERSION`].
    pub version: u32,
    /// The one answer, of all that follows.
    pub answer: Summary,
    /// Verdict of the zero crossings.
    pub crossings: Verdict,
    /// Why not more; none only with an estimate.
    pub why: Option<Why>,
    /// Estimated total width [OP unit].
    pub d_hat: Option<f64>,
    /// Estimated total width [% of OP's span], where that is known.
    pub d_hat_percent_span: Option<f64>,
    /// Smallest and largest detection behind it [OP unit]: repeatability, not an interval of confidence.
    pub repeatability: Option<(f64, f64)>,
    /// The noise limit [OP unit].
    pub noise_floor: Option<f64>,
    /// The width with its known bias taken out; none without detections.
    pub corrected: Option<CorrectedAnswer>,
    /// Accepted half-periods.
    pub detections: u64,
    /// Accepted and rejected ones.
    pub half_periods: u64,
    /// First reason of rejection, to how many half-periods.
    #[serde(serialize_with = "in_order")]
    pub reasons: Vec<(&'static str, u64)>,
    /// Findings on the recording, gravest first.
    pub quality: Vec<Finding>,
    /// Settings that the detector used.
    pub controller: Settings,
    /// The controller's law as the recording shows it; none where it was not asked for.
    pub identification: Option<Identification>,
    /// The width by OP and PV; none where that was not asked or there is no OP.
    pub fit: Option<FitAnswer>,
    /// The step test in the beginning of the recording; none where it gives no width.
    pub step_test: Option<StepTest>,
    /// Reasons of the fit's and the crossings' verdicts: codes with their numbers, which [`crate::words::text`] puts
    /// into sentences.
    pub messages: Vec<Message>,
}

impl AnalysisResult {
    /// The layout of this release.
    pub const VERSION: u32 = 3;

    /// Facts that the answer's sentences need; `span` is the width of OP's [OP unit]; the two numbers as in [`Facts`].
    pub(crate) fn facts(&self, span: Option<f64>, [acceptable, prior]: [Option<f64>; 2], harm: Option<Harm>) -> Facts {
        let most = self.reasons.iter().rev().max_by_key(|(_, count)| *count);
        Facts {
            crossings: self.crossings,
            d_hat: self.d_hat,
            detections: self.detections,
            rejected: most.and_then(|(name, _)| Reason::ALL.into_iter().find(|reason| reason.name() == *name)),
            fit: self.fit.as_ref().map(|fit| FitFacts {
                verdict: fit.verdict,
                why: fit.word().into(),
                d: fit.d,
                low: fit.low,
                high: fit.high,
                lr_no_gap: fit.lr_no_gap,
                lr_needed: fit.lr_needed,
                judgement: fit.judgement,
                weighed: fit.weighed.clone(),
                trend: fit.change,
            }),
            span,
            acceptable,
            prior,
            step_test: self.step_test.as_ref().and_then(|test| {
                let width = |d| StepTestWidth {
                    d,
                    low: test.low,
                    high: test.high,
                    decided: test.asked.and_then(|asked| asked.found),
                };
                test.d.map(width)
            }),
            harm: harm.into_iter().collect(),
        }
    }
}

/// The width from zero crossings with the known bias of (2.4) taken out, beside it and never in its place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CorrectedAnswer {
    /// Total width [OP unit]; none: `why` tells.
    pub d: Option<f64>,
    /// Lower end of its range [OP unit].
    pub low: Option<f64>,
    /// Upper end.
    pub high: Option<f64>,
    /// |Kp| that it stands on [PV unit/OP unit].
    pub kp: Option<f64>,
    /// Range of it with any one pair left out; none where it was known.
    pub kp_range: Option<(f64, f64)>,
    /// Pairs of half-periods.
    pub pairs: usize,
    /// Source of OP's travel.
    pub travel: Travel,
    /// Why there is no width.
    pub why: Option<NotCorrected>,
}

impl CorrectedAnswer {
    pub(crate) fn of(
        found: Result<Corrected<f64>, NotCorrected>,
        kp: Option<f64>,
        pairs: usize,
        travel: Travel,
    ) -> Self {
        let none = Self { d: None, low: None, high: None, kp, kp_range: None, pairs, travel, why: None };
        match found {
            Ok(Corrected { d, low, high, kp, kp_range }) => {
                Self { d: Some(d), low: Some(low), high: Some(high), kp: Some(kp), kp_range, ..none }
            }
            Err(why) => Self { why: Some(why), ..none },
        }
    }
}

/// Settings that the detector used, in ideal form, in seconds and the signals' units; none where unknown.
#[derive(Clone, Debug, Serialize)]
pub struct Settings {
    /// Gain K [OP unit/PV unit].
    pub k: Option<f64>,
    /// Integral time \[s\].
    pub ti: Option<f64>,
    /// Derivative time \[s\].
    pub td: Option<f64>,
    /// Setpoint weight b.
    pub setpoint_weight: Option<f64>,
    /// Process gain [PV unit/OP unit]; none: its term is dropped.
    pub kp_process: Option<f64>,
    /// Filter time \[s\].
    pub tf: Option<f64>,
    /// Filter times that were tried.
    pub tried: usize,
    /// Detections behind one estimate.
    pub n: u32,
    /// A longer step is a gap \[s\].
    pub max_h: f64,
    /// Source of Δu.
    pub delta_u: Option<TravelSource>,
    /// Source of each setting.
    #[serde(serialize_with = "in_order")]
    pub origins: Vec<(&'static str, Origin)>,
}

/// Serializes pairs as a map in their own order.
fn in_order<T: Serialize, S: Serializer>(pairs: &[(&'static str, T)], serializer: S) -> Result<S::Ok, S::Error> {
    InOrder(pairs).serialize(serializer)
}
