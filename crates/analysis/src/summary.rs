//! The one answer of a loop: one verdict, one width, one next step, one urgency, from all that is known of its valve.
//!
//! Where OP and PV were fitted, the fit answers; else the zero crossings do. Beside a fit the crossings are a footnote, what a PLC
//! would show, and where they contradict it they are struck.

use crate::crossings::Verdict;
use crate::fitted::LostMotion;
use glapp_core::Reason;
use serde::{Deserialize, Serialize};

/// The crossings contradict the fit where they lie beyond a limit of its interval by more than this factor: in every case
/// tried they were the ones that were wrong.
const BEYOND: f64 = 1.25;
/// Evidence is very strong where the likelihood ratio exceeds what it must by this factor, and weak above its inverse.
const VERY: f64 = 2.0;

/// Words of a fit that cannot tell, and whose upper limit stands: none and a gap up to it fit alike.
const OPEN: [&str; 2] = ["may_be_a_gap", "families_disagree"];

/// Word of a fit that found a gap which is not all: where the valve turns PV strays from the model, as one that sticks makes it.
const MORE: &str = "gap_and_more";

/// All that the one answer is made of.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Facts {
    /// What the crossings allow to be said.
    pub crossings: Verdict,
    /// Their width [OP unit].
    pub d_hat: Option<f64>,
    /// Accepted half-periods.
    pub detections: u64,
    /// The most frequent reason of rejection, where any was rejected.
    pub rejected: Option<Reason>,
    /// What OP and PV say; none where they were not fitted.
    pub fit: Option<FitFacts>,
    /// Width of OP's span, where it is known [OP unit].
    pub span: Option<f64>,
    /// Widest dead band that is acceptable, where that is said [% of span].
    pub acceptable: Option<f64>,
}

/// What the fit says, as far as the answer hangs on it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FitFacts {
    /// What it is.
    pub verdict: LostMotion,
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
    /// What it must exceed.
    pub lr_needed: Option<f64>,
}

/// Whose verdict it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum One {
    /// The fit's.
    Fit(LostMotion),
    /// The crossings', where nothing was fitted.
    Crossings(Verdict),
}

/// What is known of the valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Valve {
    /// It has a gap.
    Gap,
    /// It shows none.
    NoGap,
    /// It cannot be told.
    Unknown,
    /// Data or settings allow no answer.
    Refused,
}

/// How strongly the recording speaks for a gap.
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

/// How the width stands to what is acceptable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Acceptable {
    /// All of its interval is acceptable.
    Within,
    /// All of it is too wide.
    Beyond,
    /// It may be either.
    Open,
}

/// What to look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Play in linkage, keys and actuator.
    Play,
    /// Packing, seat and air supply.
    Packing,
    /// Both.
    Both,
}

/// What to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "code", content = "of", rename_all = "snake_case")]
pub enum Next {
    /// Correct what is named.
    Correct,
    /// Look at the valve, and confirm with a step test before work is ordered.
    Inspect(Part),
    /// Record while OP moves further, to learn how much it is.
    Further,
    /// Record for longer, while OP moves further, or make a step test.
    RecordMore,
    /// Look at the tuning, or for a disturbance.
    Tuning,
    /// Nothing now.
    Nothing,
    /// Nothing now: all of the width is acceptable.
    Review,
    /// Confirm the crossings' width with a step test, then plan work.
    Confirm,
    /// Compare the crossings' width with what the valve may have.
    Compare,
    /// Record for longer: the crossings' width is provisional.
    RecordLonger,
    /// The crossings' width is provisional and would be too wide.
    ProbablyTooWide,
    /// Only a step test tells.
    StepTest,
    /// What remedies the usual reason of rejection.
    Remedy(Reason),
}

/// How soon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Urgency {
    /// Nothing waits.
    None,
    /// When there is time: the answer is not yet one.
    Low,
    /// At the next round.
    Medium,
    /// First: the valve is worse than is acceptable.
    High,
}

/// Why the crossings' width is struck.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Struck {
    /// How it contradicts the fit.
    pub code: Contradiction,
    /// The fit's limit [OP unit].
    pub limit: f64,
}

/// How the crossings contradict the fit.
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

/// The one answer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The verdict.
    pub verdict: One,
    /// What that means of the valve.
    pub valve: Valve,
    /// The width that lists rank by: the most likely one, or the bound where that is all; none where no gap was found [OP unit].
    pub width: Option<f64>,
    /// The same [% of span], where that is known.
    pub width_percent_span: Option<f64>,
    /// Narrowest width that is not excluded [OP unit]; none where nothing is, as with crossings alone.
    pub low: Option<f64>,
    /// Widest one.
    pub high: Option<f64>,
    /// How strongly the recording speaks for a gap; none without a fit.
    pub evidence: Option<Evidence>,
    /// How the width stands to what is acceptable; none where either is not known.
    pub acceptable: Option<Acceptable>,
    /// What to do next.
    pub next: Next,
    /// How soon.
    pub urgency: Urgency,
    /// Why the crossings' width is struck; none where it stands or there is none.
    pub struck: Option<Struck>,
}

impl Summary {
    /// The one answer of these facts.
    pub fn of(facts: &Facts) -> Self {
        match facts.fit.as_ref().filter(|fit| fit.d.is_some()) {
            Some(fit) => Self::of_fit(facts, fit),
            None => Self::of_crossings(facts),
        }
    }

    fn of_fit(facts: &Facts, fit: &FitFacts) -> Self {
        let (low, high) = fit.interval();
        let width = match fit.verdict {
            LostMotion::AtLeast => low,
            verdict if verdict.found() => fit.d,
            _ => None,
        };
        let acceptable = facts.judged(width.and(low), high);
        let next = match fit.verdict {
            _ if acceptable == Some(Acceptable::Within) => Next::Review,
            LostMotion::Backlash if fit.why == MORE => Next::Inspect(Part::Both),
            LostMotion::Backlash => Next::Inspect(Part::Play),
            LostMotion::Stiction => Next::Inspect(Part::Packing),
            LostMotion::Both => Next::Inspect(Part::Both),
            LostMotion::AtLeast => Next::Further,
            // A gap that is too wide would not show either.
            LostMotion::Sound if facts.judged(low, high) == Some(Acceptable::Open) => Next::RecordMore,
            LostMotion::Sound => Next::Nothing,
            LostMotion::Oscillation => Next::Tuning,
            LostMotion::CannotTell => Next::RecordMore,
        };
        let valve = match fit.verdict {
            verdict if verdict.found() => Valve::Gap,
            LostMotion::CannotTell => Valve::Unknown,
            _ => Valve::NoGap,
        };
        let urgency = match (valve, acceptable) {
            (Valve::Gap, Some(Acceptable::Within)) => Urgency::None,
            (Valve::Gap, Some(Acceptable::Beyond)) => Urgency::High,
            (Valve::Gap, _) => Urgency::Medium,
            _ if fit.verdict == LostMotion::Oscillation => Urgency::Medium,
            (Valve::NoGap, _) if next == Next::Nothing => Urgency::None,
            _ => Urgency::Low,
        };
        Self {
            verdict: One::Fit(fit.verdict),
            valve,
            width,
            width_percent_span: width.and_then(|width| facts.percent(width)),
            low,
            high,
            evidence: Some(fit.evidence()),
            acceptable,
            next,
            urgency,
            struck: facts.d_hat.and_then(|d_hat| fit.strikes(d_hat)),
        }
    }

    fn of_crossings(facts: &Facts) -> Self {
        let acceptable = facts.d_hat.and_then(|d_hat| facts.judged(Some(d_hat), Some(d_hat)));
        let beyond = acceptable.map(|acceptable| acceptable == Acceptable::Beyond);
        let (next, urgency) = match (facts.crossings, beyond) {
            (Verdict::Refused, _) => (Next::Correct, Urgency::Low),
            (Verdict::NoEstimate, _) if facts.detections > 0 => (Next::StepTest, Urgency::Low),
            (Verdict::NoEstimate, _) => (facts.rejected.map_or(Next::RecordMore, Next::Remedy), Urgency::Low),
            (Verdict::Provisional, Some(true)) => (Next::ProbablyTooWide, Urgency::Medium),
            (Verdict::Provisional, _) => (Next::RecordLonger, Urgency::Low),
            (Verdict::Estimate, Some(true)) => (Next::Confirm, Urgency::Medium),
            (Verdict::Estimate, None) => (Next::Compare, Urgency::Low),
            (Verdict::Estimate, Some(false)) => (Next::Review, Urgency::None),
        };
        let valve = match facts.crossings {
            Verdict::Refused => Valve::Refused,
            _ if facts.d_hat.is_some() => Valve::Gap,
            _ => Valve::Unknown,
        };
        Self {
            verdict: One::Crossings(facts.crossings),
            valve,
            width: facts.d_hat,
            width_percent_span: facts.d_hat.and_then(|d_hat| facts.percent(d_hat)),
            low: None,
            high: None,
            evidence: None,
            acceptable,
            next,
            urgency,
            struck: None,
        }
    }
}

impl Facts {
    fn percent(&self, width: f64) -> Option<f64> {
        self.span.map(|span| 100.0 * width / span)
    }

    fn judged(&self, low: Option<f64>, high: Option<f64>) -> Option<Acceptable> {
        let (limit, low) = (self.acceptable?, self.percent(low?)?);
        let high = high.and_then(|high| self.percent(high));
        Some(match high {
            _ if low > limit => Acceptable::Beyond,
            Some(high) if high <= limit => Acceptable::Within,
            _ => Acceptable::Open,
        })
    }
}

impl FitFacts {
    /// The widths that are not excluded.
    fn interval(&self) -> (Option<f64>, Option<f64>) {
        match self.verdict {
            LostMotion::AtLeast => (self.low, None),
            LostMotion::Sound => (Some(0.0), self.high),
            // With any other word the interval is that of a model nobody believes.
            LostMotion::CannotTell if OPEN.contains(&&*self.why) => (self.high.and(Some(0.0)), self.high),
            verdict if verdict.found() => (self.low, self.high),
            _ => (None, None),
        }
    }

    fn evidence(&self) -> Evidence {
        let over = self.lr_no_gap.unwrap_or(0.0) / self.lr_needed.unwrap_or(f64::INFINITY);
        match self.verdict {
            verdict if verdict.found() && over > VERY => Evidence::VeryStrong,
            verdict if verdict.found() => Evidence::Strong,
            LostMotion::CannotTell if over * VERY > 1.0 => Evidence::Weak,
            _ => Evidence::None,
        }
    }

    /// How the crossings' width contradicts the fit, if it does.
    fn strikes(&self, d_hat: f64) -> Option<Struck> {
        let struck = |code, limit| Some(Struck { code, limit });
        match self.interval() {
            (_, Some(high)) if self.verdict == LostMotion::Sound => struck(Contradiction::Sound, high),
            (_, Some(high)) if d_hat > BEYOND * high => struck(Contradiction::Above, high),
            (Some(low), _) if d_hat < low / BEYOND => struck(Contradiction::Below, low),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit(verdict: LostMotion, low: f64, high: Option<f64>) -> FitFacts {
        let (lr_no_gap, lr_needed) = (Some(100.0), Some(40.0));
        FitFacts { verdict, why: "gap".into(), d: Some(low), low: Some(low), high, lr_no_gap, lr_needed }
    }

    /// Of a span of 200 OP units, of which 2 % are acceptable.
    fn of(crossings: Verdict, d_hat: Option<f64>, fit: Option<FitFacts>) -> Summary {
        let facts = Facts { crossings, d_hat, fit, span: Some(200.0), acceptable: Some(2.0), ..Facts::default() };
        Summary::of(&facts)
    }

    #[test]
    fn the_fit_answers_and_the_crossings_are_its_footnote() {
        let gap = of(Verdict::Refused, None, Some(fit(LostMotion::Backlash, 5.0, Some(6.0))));
        assert_eq!((gap.verdict, gap.valve), (One::Fit(LostMotion::Backlash), Valve::Gap));
        assert_eq!((gap.width, gap.width_percent_span, gap.struck), (Some(5.0), Some(2.5), None));
        assert_eq!((gap.next, gap.urgency), (Next::Inspect(Part::Play), Urgency::High));
        assert_eq!((gap.evidence, gap.acceptable), (Some(Evidence::VeryStrong), Some(Acceptable::Beyond)));
        let unsure = of(Verdict::Estimate, Some(3.0), Some(fit(LostMotion::CannotTell, 1.0, None)));
        assert_eq!((unsure.valve, unsure.width, unsure.low, unsure.struck), (Valve::Unknown, None, None, None));
        assert_eq!((unsure.next, unsure.urgency), (Next::RecordMore, Urgency::Low));
    }

    #[test]
    fn where_pv_strays_at_the_turns_the_packing_is_looked_at_too() {
        let more = FitFacts { why: MORE.into(), ..fit(LostMotion::Backlash, 5.0, Some(6.0)) };
        assert_eq!(of(Verdict::Refused, None, Some(more)).next, Next::Inspect(Part::Both));
    }

    #[test]
    fn what_could_not_be_fitted_leaves_the_answer_to_the_crossings() {
        let none = FitFacts { d: None, low: None, ..fit(LostMotion::CannotTell, 0.0, None) };
        let refused = of(Verdict::Refused, None, Some(none.clone()));
        assert_eq!((refused.verdict, refused.valve), (One::Crossings(Verdict::Refused), Valve::Refused));
        let estimate = of(Verdict::Estimate, Some(5.0), Some(none));
        assert_eq!((estimate.width, estimate.next, estimate.urgency), (Some(5.0), Next::Confirm, Urgency::Medium));
        assert_eq!(of(Verdict::Estimate, Some(3.0), None).next, Next::Review);
        assert_eq!(of(Verdict::Provisional, Some(5.0), None).next, Next::ProbablyTooWide);
        assert_eq!(of(Verdict::Provisional, Some(3.0), None).next, Next::RecordLonger);
        assert_eq!(of(Verdict::NoEstimate, None, None).next, Next::RecordMore);
        let rejected = Some(Reason::TooShort);
        let silent = Facts { crossings: Verdict::NoEstimate, rejected, ..Facts::default() };
        assert_eq!(Summary::of(&silent).next, Next::Remedy(Reason::TooShort));
        assert_eq!(Summary::of(&Facts { detections: 1, ..silent }).next, Next::StepTest);
        let unlimited = Facts { crossings: Verdict::Estimate, d_hat: Some(5.0), ..Facts::default() };
        assert_eq!(Summary::of(&unlimited).next, Next::Compare);
    }

    #[test]
    fn crossings_that_contradict_the_fit_are_struck() {
        let struck = |d_hat, fit| of(Verdict::Estimate, Some(d_hat), Some(fit)).struck.map(|s| (s.code, s.limit));
        let gap = || fit(LostMotion::Backlash, 2.0, Some(4.0));
        assert_eq!(struck(4.9, gap()), None);
        assert_eq!(struck(5.1, gap()), Some((Contradiction::Above, 4.0)));
        assert_eq!(struck(1.7, gap()), None);
        assert_eq!(struck(1.5, gap()), Some((Contradiction::Below, 2.0)));
        assert_eq!(struck(9.0, fit(LostMotion::AtLeast, 2.0, None)), None);
        assert_eq!(struck(0.3, fit(LostMotion::Sound, 0.0, Some(0.4))), Some((Contradiction::Sound, 0.4)));
        let may = FitFacts { why: "may_be_a_gap".into(), ..fit(LostMotion::CannotTell, 0.0, Some(1.0)) };
        assert_eq!(struck(1.3, may), Some((Contradiction::Above, 1.0)));
        assert_eq!(struck(1.3, fit(LostMotion::CannotTell, 0.0, Some(1.0))), None, "nobody believes that limit");
    }

    #[test]
    fn a_width_is_judged_by_its_whole_interval() {
        let judged = |low, high| {
            let answer = of(Verdict::Estimate, None, Some(fit(LostMotion::Backlash, low, high)));
            (answer.acceptable, answer.next, answer.urgency)
        };
        let play = Next::Inspect(Part::Play);
        assert_eq!(judged(5.0, Some(6.0)), (Some(Acceptable::Beyond), play, Urgency::High));
        assert_eq!(judged(2.0, Some(3.9)), (Some(Acceptable::Within), Next::Review, Urgency::None));
        assert_eq!(judged(3.0, Some(5.0)), (Some(Acceptable::Open), play, Urgency::Medium));
        assert_eq!(judged(3.0, None), (Some(Acceptable::Open), play, Urgency::Medium));
    }

    #[test]
    fn a_valve_without_a_gap_waits_for_more_where_one_too_wide_would_not_show() {
        let up_to = |high| {
            let answer = of(Verdict::NoEstimate, None, Some(fit(LostMotion::Sound, 0.0, high)));
            (answer.valve, answer.next, answer.urgency)
        };
        assert_eq!(up_to(Some(4.0)), (Valve::NoGap, Next::Nothing, Urgency::None));
        assert_eq!(up_to(Some(4.1)), (Valve::NoGap, Next::RecordMore, Urgency::Low));
    }
}
