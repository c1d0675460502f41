//! All that the one answer is made of.

use super::kinds::{Acceptable, Contradiction, Evidence, Limit, LimitOrigin, Moves, Struck};
use crate::crossings::Verdict;
use crate::fitted::FitVerdict;
use crate::harm::Harm;
use crate::step_test::Found;
use crate::trend::{Change, WidthTrend};
use glapp_core::Reason;
use glapp_fit::{Cause, Confidence as FitConfidence, Judgement, USUAL_PRIOR, Weighed, WidthKind};
use serde::{Deserialize, Serialize};

/// The crossings contradict the fit where they lie beyond a limit of its interval by more than this factor: in every case
/// tried they were the ones that were wrong.
const BEYOND: f64 = 1.25;
/// Evidence is very strong where the likelihood ratio exceeds the needed one by this factor, and weak above its
/// inverse.
const VERY: f64 = 2.0;

/// Acceptable dead band where nobody stated one [% of OP's span]: the nominal one of EnTech's Control Valve Dynamic
/// Specification.
pub const NOMINAL_LIMIT: f64 = 1.0;

/// Words of a fit that cannot tell, and whose upper limit stands: none and a gap up to it fit alike.
const OPEN: [&str; 2] = ["may_be_a_gap", "families_disagree"];
/// Words of a fit that cannot tell, and whose evidence may make a dead band that matters improbable (ADR 38).
const NARROW_IF_ANY: [&str; 3] = ["may_be_a_gap", "hidden_by_samples", "swings"];

/// Probability of a dead band wider than is acceptable, where as many valves have one as usual, up to which a valve is likely sound.
/// Of 837 loops without a dead band 259 are then, of 461 with one wider than 1 % of span 19 (ADR 38).
const IMPROBABLE_BEYOND: f64 = 0.003;

/// Code for the decision of a step test.
const TEST: &str = "step_test";

/// All that the one answer is made of.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Facts {
    /// Verdict of the crossings.
    pub crossings: Verdict,
    /// Width by the crossings [OP unit].
    pub d_hat: Option<f64>,
    /// Accepted half-periods.
    pub detections: u64,
    /// The most frequent reason of rejection, where any was rejected.
    pub rejected: Option<Reason>,
    /// Facts of the fit; none where OP and PV were not fitted.
    pub fit: Option<FitFacts>,
    /// Width of OP's span, where it is known [OP unit].
    pub span: Option<f64>,
    /// Widest acceptable dead band, where it is stated [% of span].
    pub acceptable: Option<f64>,
    /// Share of the plant's valves that have a dead band, where it is stated; it changes probability and ranking, and
    /// no rung.
    #[serde(default)]
    pub prior: Option<f64>,
    /// Total width that a step test in the recording gives, where it gives one.
    #[serde(default)]
    pub step_test: Option<StepTestWidth>,
    /// Harm of the gap to the loop, in each window where it was computed.
    #[serde(default)]
    pub harm: Vec<Harm>,
}

/// Facts of the fit that the answer depends on.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FitFacts {
    /// Kind of lost motion.
    pub verdict: FitVerdict,
    /// The word for why.
    pub why: String,
    /// Most likely width; none where nothing could be fitted [OP unit].
    pub d: Option<f64>,
    /// Lower 95 % limit [OP unit].
    pub low: Option<f64>,
    /// Upper one, where there is one [OP unit].
    pub high: Option<f64>,
    /// Likelihood ratio of no gap.
    pub lr_no_gap: Option<f64>,
    /// Likelihood ratio that a gap needs.
    pub lr_needed: Option<f64>,
    /// Judgement of the ladder; none: it follows from the verdict.
    #[serde(default)]
    pub judgement: Option<Judgement>,
    /// The evidence weighed; none where there is none to weigh.
    #[serde(default)]
    pub weighed: Option<Weighed>,
    /// Trend of the width, where the fit has widths of several times.
    #[serde(default)]
    pub trend: Option<WidthTrend>,
}

/// The width that a step test gives, with its 95 % interval [OP unit].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepTestWidth {
    /// Total width; its lower limit where a reversal that PV did not answer gives no more.
    pub d: f64,
    /// Lower limit.
    pub low: Option<f64>,
    /// Upper limit; none where the test gives no more than a lower one.
    pub high: Option<f64>,
    /// Decision of a test that was made for a question; none for any other test.
    #[serde(default)]
    pub decided: Option<Found>,
}

impl StepTestWidth {
    /// Whether it has decided for a gap by a lower limit alone.
    pub(super) fn is_bound(&self) -> bool {
        self.decided == Some(Found::Gap) && self.high.is_none()
    }
}
impl Facts {
    /// A width in percent of span, where the span is known.
    pub(super) fn percent(&self, width: f64) -> Option<f64> {
        self.span.map(|span| 100.0 * width / span)
    }

    /// Acceptable limit: as given, else the nominal limit where OP's span is known.
    pub(super) fn limit(&self) -> Option<Limit> {
        let of = |percent_span: f64, origin| {
            let width = self.span.map(|span| 0.01 * percent_span * span);
            Limit { percent_span, width, origin }
        };
        match (self.acceptable, self.span) {
            (Some(given), _) => Some(of(given, LimitOrigin::Given)),
            (None, Some(_)) => Some(of(NOMINAL_LIMIT, LimitOrigin::Nominal)),
            (None, None) => None,
        }
    }

    pub(super) fn judged(&self, low: Option<f64>, high: Option<f64>) -> Option<Acceptable> {
        let (limit, low) = (self.limit()?.percent_span, self.percent(low?)?);
        let high = high.and_then(|high| self.percent(high));
        Some(match high {
            _ if low > limit => Acceptable::Beyond,
            Some(high) if high <= limit => Acceptable::Within,
            _ => Acceptable::Open,
        })
    }

    /// The trend, and when it will have reached the acceptable limit; none where there are too few widths for one.
    pub(super) fn moves(&self, trend: WidthTrend) -> Option<Moves> {
        let (per_day, (_, newest)) = (trend.per_day?, trend.d?);
        let limit = self.limit().and_then(|limit| limit.width);
        let ahead = limit.filter(|limit| trend.code == Change::Grows && newest < *limit);
        Some(Moves { trend, days_to_limit: ahead.map(|limit| (limit - newest) / per_day) })
    }
}

impl FitFacts {
    /// Answer after a step test has decided an open question; none where the fit has found a gap itself, or nothing is
    /// decided.
    pub(super) fn decided_by(&self, test: StepTestWidth) -> Option<Self> {
        let before = self.judged();
        let found = test.decided.filter(|_| before.confidence != FitConfidence::Found)?;
        let low = test.low.unwrap_or(0.0);
        let (confidence, cause, width_kind, verdict) = match found {
            Found::Gap if test.is_bound() => {
                (FitConfidence::Found, Some(Cause::DeadBand), Some(WidthKind::Bound), FitVerdict::AtLeast)
            }
            Found::Gap => {
                (FitConfidence::Found, Some(Cause::DeadBand), Some(WidthKind::Interval), FitVerdict::Backlash)
            }
            Found::NoGap => (FitConfidence::NoneSeen, None, None, FitVerdict::Sound),
        };
        let judgement = Some(Judgement { confidence, cause, width_kind, ..before });
        let d = Some(test.d);
        Some(Self { verdict, why: TEST.into(), d, low: Some(low), high: test.high, judgement, ..self.clone() })
    }

    /// Judgement of the ladder; where it was not asked, that of the verdict.
    pub(super) fn judged(&self) -> Judgement {
        self.judgement.unwrap_or_else(|| {
            let (confidence, cause, width_kind) = match self.verdict {
                FitVerdict::Backlash => (FitConfidence::Found, Some(Cause::DeadBand), Some(WidthKind::Interval)),
                FitVerdict::Stiction => (FitConfidence::Found, Some(Cause::Stiction), Some(WidthKind::Interval)),
                FitVerdict::Both => (FitConfidence::Found, Some(Cause::Both), Some(WidthKind::Interval)),
                FitVerdict::AtLeast => (FitConfidence::Found, Some(Cause::DeadBand), Some(WidthKind::Bound)),
                FitVerdict::Sound => (FitConfidence::NoneSeen, None, None),
                FitVerdict::Oscillation | FitVerdict::CannotTell => (FitConfidence::CannotTell, None, None),
            };
            Judgement { confidence, cause, width_kind, oscillates: false }
        })
    }

    /// The widths that are not excluded.
    pub(super) fn interval(&self) -> (Option<f64>, Option<f64>) {
        let judged = self.judged();
        match self.verdict {
            FitVerdict::CannotTell if judged.tells() => match judged.width_kind {
                Some(WidthKind::Interval) => (self.low, self.high),
                Some(WidthKind::Bound) => (self.low, None),
                _ => (None, None),
            },
            FitVerdict::AtLeast => (self.low, None),
            FitVerdict::Sound => (Some(0.0), self.high),
            // For every other code the interval is that of a rejected model.
            FitVerdict::CannotTell if OPEN.contains(&&*self.why) => (self.high.and(Some(0.0)), self.high),
            verdict if verdict.found() => (self.low, self.high),
            _ => (None, None),
        }
    }

    /// Whether a dead band wider than `limit` [OP unit] is improbable, where the fit leaves open whether there is one: all evidence makes
    /// one no more probable than usual, and of one the likelihood says that it is narrower. The plant's own prior moves no rung.
    pub(super) fn likely_sound(&self, limit: f64) -> bool {
        let open = self.verdict == FitVerdict::CannotTell && self.judged().confidence == FitConfidence::CannotTell;
        let improbable = |weighed: &Weighed| {
            let beyond = weighed.probability_beyond(limit, USUAL_PRIOR);
            weighed.probability(USUAL_PRIOR) <= USUAL_PRIOR && beyond <= IMPROBABLE_BEYOND
        };
        open && NARROW_IF_ANY.contains(&&*self.why) && self.weighed.as_ref().is_some_and(improbable)
    }

    pub(super) fn evidence(&self) -> Evidence {
        let over = self.lr_no_gap.unwrap_or(0.0) / self.lr_needed.unwrap_or(f64::INFINITY);
        match self.verdict {
            verdict if verdict.found() && over > VERY => Evidence::VeryStrong,
            verdict if verdict.found() => Evidence::Strong,
            FitVerdict::CannotTell if over * VERY > 1.0 || self.judged().tells() => Evidence::Weak,
            _ => Evidence::None,
        }
    }

    /// Contradiction of the crossings' width to the fit, if there is one.
    pub(super) fn contradicted_by(&self, d_hat: f64) -> Option<Struck> {
        let struck = |code, limit| Some(Struck { code, limit });
        match self.interval() {
            (_, Some(high)) if self.verdict == FitVerdict::Sound => struck(Contradiction::Sound, high),
            (_, Some(high)) if d_hat > BEYOND * high => struck(Contradiction::Above, high),
            (Some(low), _) if d_hat < low / BEYOND => struck(Contradiction::Below, low),
            _ => None,
        }
    }
}
