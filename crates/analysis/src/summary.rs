//! The one answer of a loop: one verdict, one width, one next step, one urgency, from all that is known of its valve.
//!
//! Where OP and PV were fitted, the fit answers; else the zero crossings do. Beside a fit the crossings are a footnote, what a PLC
//! would show, and where they contradict it they are struck.
//!
//! Nothing else decides. Every face shows this answer, and what is stored is this answer.

mod by_fit;
mod facts;
mod kinds;
#[cfg(test)]
mod tests;

pub use facts::{Facts, FitFacts, NOMINAL_LIMIT, StepTestWidth};
pub use kinds::*;

use crate::crossings::Verdict;
use crate::fitted::FitVerdict;
use crate::harm::Harm;
use glapp_fit::{Cause, Terms, WidthKind};
use serde::Serialize;

/// The one answer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The verdict.
    pub verdict: One,
    /// State of the valve.
    pub valve: Valve,
    /// Confidence that there is a dead band.
    pub confidence: Confidence,
    /// Cause; none where none is found or likely.
    pub cause: Option<Cause>,
    /// Kind of the width; none where there is neither width nor bound.
    pub width_kind: Option<WidthKind>,
    /// Whether the loop swings back and forth in almost even time, whatever the cause.
    pub oscillates: bool,
    /// The width that lists rank by: the most likely one, or the bound where that is all; none where no gap was found [OP unit].
    pub width: Option<f64>,
    /// Width [% of span], where the span is known.
    pub width_percent_span: Option<f64>,
    /// Narrowest width that is not excluded [OP unit]; none where nothing is, as with crossings alone.
    pub low: Option<f64>,
    /// Lower limit [% of span].
    pub low_percent_span: Option<f64>,
    /// Widest one.
    pub high: Option<f64>,
    /// Upper limit [% of span].
    pub high_percent_span: Option<f64>,
    /// Strength of the recording's evidence for a gap; none without a fit.
    pub evidence: Option<Evidence>,
    /// Probability of a dead band, never nearer to 0 or 1 than [`LEAST_DOUBT`]; none where no evidence was weighed.
    pub p_gap: Option<f64>,
    /// Probability of one beyond the limit; none where no limit in OP units is known either.
    pub p_beyond: Option<f64>,
    /// Contribution of each kind of evidence to the log-odds of a dead band.
    pub terms: Option<Terms>,
    /// Logarithm of the Bayes factor: how many times likelier the evidence is with a dead band than without.
    pub log_bayes_factor: Option<f64>,
    /// Share of valves with a dead band that `p_gap` starts from.
    pub prior: Option<f64>,
    /// Acceptable limit; none where nobody stated it and the span is not known.
    pub limit: Option<Limit>,
    /// The width compared with the acceptable limit; none where either is not known.
    pub acceptable: Option<Acceptable>,
    /// Next step.
    pub next: NextStep,
    /// Urgency.
    pub urgency: Urgency,
    /// Health of the valve by NE 107.
    pub health: Health,
    /// Trend of the width; none where there are too few widths.
    pub trend: Option<Moves>,
    /// Width by a step test in the recording.
    pub step_test: Option<StepTestWidth>,
    /// Harm of the gap to the loop.
    pub harm: Option<Harm>,
    /// The width that a compensation may trust [OP unit]: the lower limit of a gap that was found, with backlash and no other
    /// verdict; 0 of a valve that shows none. None: only a person may type one.
    pub compensable: Option<f64>,
    /// Rank of a valve within its urgency: the lower limit of the gap divided by the acceptable limit, times its harm.
    /// None where no gap was fitted or the span is not known.
    pub score: Option<f64>,
    /// The place of the loop in every list: the most urgent first, among equals gaps first, those with a score by it, then by the
    /// probability of a dead band beyond the limit, then the widest in % of span, then those whose widths cannot be compared. Smaller
    /// comes first, number by number.
    pub rank: (u8, u8, u8, f64),
    /// Reason why the crossings' width is contradicted; none where it is not, or there is none.
    pub struck: Option<Struck>,
}

impl Summary {
    /// The one answer of these facts. Where normal operation leaves it open and a step test was made for the question and has
    /// decided it, the test answers.
    pub fn of(facts: &Facts) -> Self {
        if let Some(fit) = facts.fit.as_ref().and_then(|fit| fit.decided_by(facts.step_test?)) {
            let decided = Self { evidence: Some(Evidence::Strong), ..Self::of_fit(facts, &fit) };
            return Self { rank: decided.ranked(), ..decided };
        }
        let answers = |fit: &&FitFacts| fit.d.is_some() || fit.verdict == FitVerdict::Oscillation;
        let decided = match facts.fit.as_ref().filter(answers) {
            Some(fit) => Self::of_fit(facts, fit),
            None => Self::of_crossings(facts),
        };
        Self { rank: decided.ranked(), ..decided }
    }

    /// The answer by the crossings alone.
    fn of_crossings(facts: &Facts) -> Self {
        let acceptable = facts.d_hat.and_then(|d_hat| facts.judged(Some(d_hat), Some(d_hat)));
        // The crossings alone also give sound valves more than the nominal limit: no work follows from that.
        let given = facts.acceptable.is_some();
        let (next, urgency) = match (facts.crossings, acceptable) {
            (Verdict::Refused, _) => (Next::Correct, Urgency::Low),
            (Verdict::NoEstimate, _) if facts.detections > 0 => (Next::StepTest, Urgency::Low),
            (Verdict::NoEstimate, _) => (facts.rejected.map_or(Next::RecordMore, Next::Remedy), Urgency::Low),
            (Verdict::Provisional, Some(Acceptable::Beyond)) if given => (Next::ProbablyTooWide, Urgency::Medium),
            (Verdict::Provisional, _) => (Next::RecordLonger, Urgency::Low),
            (Verdict::Estimate, Some(Acceptable::Beyond)) if given => (Next::Confirm, Urgency::Medium),
            (Verdict::Estimate, Some(Acceptable::Within)) => (Next::Review, Urgency::None),
            (Verdict::Estimate, _) => (Next::Compare, Urgency::Low),
        };
        let valve = match facts.crossings {
            Verdict::Refused => Valve::Refused,
            _ if facts.d_hat.is_some() => Valve::Gap,
            _ => Valve::Unknown,
        };
        let confidence = match facts.crossings {
            Verdict::Refused => Confidence::Refused,
            _ => Confidence::NotJudged,
        };
        let width = (facts.d_hat, None, None);
        let verdict = One::Crossings(facts.crossings);
        Self { urgency, ..Self::plain(facts, verdict, (valve, confidence), width, (acceptable, next)) }
    }

    /// Answer by the verdict of any method, without the facts of the fit.
    fn plain(
        facts: &Facts,
        verdict: One,
        (valve, confidence): (Valve, Confidence),
        (width, low, high): (Option<f64>, Option<f64>, Option<f64>),
        (acceptable, next): (Option<Acceptable>, Next),
    ) -> Self {
        let percent = |width: Option<f64>| width.and_then(|width| facts.percent(width));
        Self {
            verdict,
            valve,
            confidence,
            cause: None,
            width_kind: None,
            oscillates: false,
            width,
            width_percent_span: percent(width),
            low,
            low_percent_span: percent(low),
            high,
            high_percent_span: percent(high),
            evidence: None,
            p_gap: None,
            p_beyond: None,
            terms: None,
            log_bayes_factor: None,
            prior: None,
            limit: facts.limit(),
            acceptable,
            next: NextStep {
                step: next,
                tested: facts.step_test.is_some_and(|test| !test.is_bound()) && next.asks_for_a_test(),
            },
            urgency: Urgency::Low,
            health: Health::Normal,
            trend: None,
            step_test: facts.step_test,
            harm: None,
            compensable: None,
            score: None,
            rank: (0, 0, 0, 0.0),
            struck: None,
        }
    }

    /// Sort key: the most urgent first.
    fn ranked(&self) -> (u8, u8, u8, f64) {
        let urgency = match self.urgency {
            Urgency::High => 0,
            Urgency::Medium => 1,
            Urgency::Low => 2,
            Urgency::None => 3,
        };
        let valve = match self.valve {
            Valve::Gap => 0,
            Valve::Unknown => 1,
            Valve::NoGap => 2,
            Valve::Refused => 3,
        };
        let beyond = self.p_beyond.filter(|_| self.valve == Valve::Unknown);
        let (comparable, width) = match (self.score, beyond, self.width_percent_span, self.width) {
            (Some(score), ..) => (0, -score),
            (None, Some(probability), ..) => (1, -probability),
            (None, None, Some(percent), _) => (2, -percent),
            (None, None, None, Some(width)) => (3, -width),
            _ => (4, 0.0),
        };
        (urgency, valve, comparable, width)
    }
}
