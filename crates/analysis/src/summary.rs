//! The one answer of a loop: one verdict, one width, one next step, one urgency, from all that is known of its valve.
//!
//! Where OP and PV were fitted, the fit answers; else the zero crossings do. Beside a fit the crossings are a footnote, what a PLC
//! would show, and where they contradict it they are struck.
//!
//! Nothing else decides. Every face shows this answer, and what is stored is this answer.

use crate::crossings::Verdict;
use crate::fitted::FitVerdict;
use crate::harm::Harm;
use crate::step_test::Found;
use crate::trend::{Change, WidthTrend};
use glapp_core::Reason;
use glapp_fit::{Cause, Confidence as FitConfidence, Judgement, LEAST_DOUBT, Terms, USUAL_PRIOR, Weighed, WidthKind};
use serde::ser::SerializeStruct;
use serde::{Deserialize, Serialize, Serializer};

/// The crossings contradict the fit where they lie beyond a limit of its interval by more than this factor: in every case
/// tried they were the ones that were wrong.
const BEYOND: f64 = 1.25;
/// Evidence is very strong where the likelihood ratio exceeds the needed one by this factor, and weak above its
/// inverse.
const VERY: f64 = 2.0;

/// Acceptable dead band where nobody stated one [% of OP's span]: the nominal one of EnTech's Control Valve Dynamic
/// Specification.
pub const NOMINAL_LIMIT: f64 = 1.0;
/// Harm that a gap is ranked by where it is not known: half of what there can be.
const HARM_UNKNOWN: f64 = 0.5;

/// Words of a fit that cannot tell, and whose upper limit stands: none and a gap up to it fit alike.
const OPEN: [&str; 2] = ["may_be_a_gap", "families_disagree"];
/// Words of a fit that cannot tell, and whose upper limit, where it is acceptable, makes a wider dead band improbable (ADR 33).
const NARROW_IF_ANY: [&str; 3] = ["may_be_a_gap", "hidden_by_samples", "swings"];

/// Code for the decision of a step test.
const TEST: &str = "step_test";

/// Word of a fit that found a gap which is not all: where the valve turns PV strays from the model, as one that sticks makes it.
const MORE: &str = "gap_and_more";

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
    fn is_bound(&self) -> bool {
        self.decided == Some(Found::Gap) && self.high.is_none()
    }
}

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

    /// The answer by the fit.
    fn of_fit(facts: &Facts, fit: &FitFacts) -> Self {
        let judged = fit.judged();
        let likely_sound = facts.judged(Some(0.0), fit.narrow_if_any()) == Some(Acceptable::Within);
        let (low, high) = if likely_sound { (Some(0.0), fit.high) } else { fit.interval() };
        let width = match (judged.confidence, judged.width_kind) {
            _ if fit.verdict == FitVerdict::Oscillation => None,
            (FitConfidence::Found | FitConfidence::Likely, Some(WidthKind::Bound)) => low,
            (FitConfidence::Found | FitConfidence::Likely, _) => fit.d,
            _ => None,
        };
        let limit = facts.limit();
        let acceptable = facts.judged(width.and(low), high);
        // No work on the valve helps a loop that swings through a narrow gap; its tuning does, or a compensation.
        let swings = judged.oscillates && judged.confidence == FitConfidence::Found;
        let next = match fit.verdict {
            _ if acceptable == Some(Acceptable::Within) && swings => Next::Tuning,
            _ if acceptable == Some(Acceptable::Within) || likely_sound => Next::Review,
            FitVerdict::Backlash if judged.cause == Some(Cause::Backlash) && fit.why != MORE => {
                Next::Inspect(Part::Play)
            }
            // PV alone does not tell play from packing.
            FitVerdict::Backlash => Next::Inspect(Part::Both),
            FitVerdict::Stiction => Next::Inspect(Part::Packing),
            FitVerdict::Both => Next::Inspect(Part::Both),
            FitVerdict::AtLeast => Next::Further,
            // A gap that is too wide would not show either.
            FitVerdict::Sound if facts.judged(low, high) == Some(Acceptable::Open) => Next::RecordMore,
            FitVerdict::Sound => Next::Nothing,
            FitVerdict::Oscillation => Next::Tuning,
            FitVerdict::CannotTell if judged.tells() => Next::Confirm,
            FitVerdict::CannotTell => Next::RecordMore,
        };
        let valve = match fit.verdict {
            verdict if verdict.found() => Valve::Gap,
            // A gap is certain, of any width.
            FitVerdict::CannotTell if judged.confidence == FitConfidence::Found => Valve::Gap,
            FitVerdict::CannotTell => Valve::Unknown,
            _ => Valve::NoGap,
        };
        let confidence = match judged.confidence {
            _ if fit.verdict == FitVerdict::Oscillation => Confidence::CannotTell,
            FitConfidence::Found => Confidence::Found,
            FitConfidence::Likely => Confidence::Likely,
            FitConfidence::NoneSeen if facts.judged(low, high) == Some(Acceptable::Within) => Confidence::Sound,
            FitConfidence::NoneSeen => Confidence::NoneSeen,
            FitConfidence::CannotTell if likely_sound => Confidence::LikelySound,
            FitConfidence::CannotTell => Confidence::CannotTell,
        };
        let claims = confidence != Confidence::CannotTell;
        let bound = matches!(confidence, Confidence::NoneSeen | Confidence::Sound | Confidence::LikelySound);
        let urgency = match (valve, acceptable) {
            (Valve::Gap, Some(Acceptable::Within)) if swings => Urgency::Low,
            (Valve::Gap, Some(Acceptable::Within)) => Urgency::None,
            (Valve::Gap, Some(Acceptable::Beyond)) => Urgency::High,
            (Valve::Gap, _) => Urgency::Medium,
            (Valve::Unknown, Some(Acceptable::Within)) => Urgency::None,
            (Valve::Unknown, _) if likely_sound => Urgency::None,
            // No more than likely: a step test at the next round.
            (Valve::Unknown, Some(Acceptable::Beyond)) => Urgency::Medium,
            _ if fit.verdict == FitVerdict::Oscillation => Urgency::Medium,
            (Valve::NoGap, _) if next == Next::Nothing => Urgency::None,
            _ => Urgency::Low,
        };
        let nominal = limit.is_some_and(|limit| limit.origin == LimitOrigin::Nominal);
        let prior = facts.prior.unwrap_or(USUAL_PRIOR);
        let weighed = fit.weighed.as_ref();
        let shown = |p: f64| p.clamp(LEAST_DOUBT, 1.0 - LEAST_DOUBT);
        let beyond = |weighed: &Weighed, width| weighed.probability(prior) * weighed.is_wider(width);
        let work = valve == Valve::Gap && acceptable != Some(Acceptable::Within);
        let harm = (valve == Valve::Gap && !facts.harm.is_empty()).then(|| Harm::mean(&facts.harm));
        let surely = low.filter(|_| valve == Valve::Gap).and_then(|low| facts.percent(low));
        let score = surely.zip(limit).map(|(surely, limit)| {
            let harm = harm.and_then(|harm| harm.worst).unwrap_or(HARM_UNKNOWN);
            surely / limit.percent_span * harm
        });
        Self {
            cause: judged.cause.filter(|_| claims),
            width_kind: if bound { Some(WidthKind::Bound) } else { judged.width_kind.filter(|_| claims) },
            oscillates: judged.oscillates || fit.verdict == FitVerdict::Oscillation,
            evidence: Some(fit.evidence()),
            p_gap: weighed.map(|weighed| shown(weighed.probability(prior))),
            p_beyond: weighed.zip(limit.and_then(|limit| limit.width)).map(|(of, width)| shown(beyond(of, width))),
            terms: weighed.map(|weighed| weighed.terms),
            log_bayes_factor: weighed.map(|weighed| weighed.log_bayes_factor),
            prior: weighed.map(|_| prior),
            // Limits that a person stated come first; the nominal one can wait for the next round.
            urgency: if nominal { urgency.min(Urgency::Medium) } else { urgency },
            health: if work { Health::MaintenanceRequired } else { Health::Normal },
            trend: fit.trend.and_then(|trend| facts.moves(trend)),
            harm,
            compensable: match fit.verdict {
                FitVerdict::Backlash => low,
                FitVerdict::Sound => Some(0.0),
                _ => None,
            },
            score,
            struck: facts.d_hat.and_then(|d_hat| fit.contradicted_by(d_hat)),
            ..Self::plain(facts, One::Fit(fit.verdict), (valve, confidence), (width, low, high), (acceptable, next))
        }
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
    const fn asks_for_a_test(self) -> bool {
        !matches!(self, Self::Tuning | Self::Nothing | Self::Review | Self::RecordLonger)
    }
}

impl Facts {
    /// A width in percent of span, where the span is known.
    fn percent(&self, width: f64) -> Option<f64> {
        self.span.map(|span| 100.0 * width / span)
    }

    /// Acceptable limit: as given, else the nominal limit where OP's span is known.
    fn limit(&self) -> Option<Limit> {
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

    fn judged(&self, low: Option<f64>, high: Option<f64>) -> Option<Acceptable> {
        let (limit, low) = (self.limit()?.percent_span, self.percent(low?)?);
        let high = high.and_then(|high| self.percent(high));
        Some(match high {
            _ if low > limit => Acceptable::Beyond,
            Some(high) if high <= limit => Acceptable::Within,
            _ => Acceptable::Open,
        })
    }

    /// The trend, and when it will have reached the acceptable limit; none where there are too few widths for one.
    fn moves(&self, trend: WidthTrend) -> Option<Moves> {
        let (per_day, (_, newest)) = (trend.per_day?, trend.d?);
        let limit = self.limit().and_then(|limit| limit.width);
        let ahead = limit.filter(|limit| trend.code == Change::Grows && newest < *limit);
        Some(Moves { trend, days_to_limit: ahead.map(|limit| (limit - newest) / per_day) })
    }
}

impl FitFacts {
    /// Answer after a step test has decided an open question; none where the fit has found a gap itself, or nothing is
    /// decided.
    fn decided_by(&self, test: StepTestWidth) -> Option<Self> {
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
    fn judged(&self) -> Judgement {
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
    fn interval(&self) -> (Option<f64>, Option<f64>) {
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

    /// Upper limit of a dead band that the fit leaves open; none where it says more, or the limit is that of a rejected model.
    fn narrow_if_any(&self) -> Option<f64> {
        let open = self.verdict == FitVerdict::CannotTell && self.judged().confidence == FitConfidence::CannotTell;
        self.high.filter(|_| open && NARROW_IF_ANY.contains(&&*self.why))
    }

    fn evidence(&self) -> Evidence {
        let over = self.lr_no_gap.unwrap_or(0.0) / self.lr_needed.unwrap_or(f64::INFINITY);
        match self.verdict {
            verdict if verdict.found() && over > VERY => Evidence::VeryStrong,
            verdict if verdict.found() => Evidence::Strong,
            FitVerdict::CannotTell if over * VERY > 1.0 => Evidence::Weak,
            _ => Evidence::None,
        }
    }

    /// Contradiction of the crossings' width to the fit, if there is one.
    fn contradicted_by(&self, d_hat: f64) -> Option<Struck> {
        let struck = |code, limit| Some(Struck { code, limit });
        match self.interval() {
            (_, Some(high)) if self.verdict == FitVerdict::Sound => struck(Contradiction::Sound, high),
            (_, Some(high)) if d_hat > BEYOND * high => struck(Contradiction::Above, high),
            (Some(low), _) if d_hat < low / BEYOND => struck(Contradiction::Below, low),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glapp_fit::Width;

    fn fit(verdict: FitVerdict, low: f64, high: Option<f64>) -> FitFacts {
        let (lr_no_gap, lr_needed) = (Some(100.0), Some(40.0));
        FitFacts {
            verdict,
            why: "gap".into(),
            d: Some(low),
            low: Some(low),
            high,
            lr_no_gap,
            lr_needed,
            judgement: None,
            weighed: None,
            trend: None,
        }
    }

    /// Facts for a span of 200 OP units, with 2 % acceptable.
    fn of(crossings: Verdict, d_hat: Option<f64>, fit: Option<FitFacts>) -> Summary {
        let facts = Facts { crossings, d_hat, fit, span: Some(200.0), acceptable: Some(2.0), ..Facts::default() };
        Summary::of(&facts)
    }

    #[test]
    fn the_fit_answers_and_the_crossings_are_its_footnote() {
        let gap = of(Verdict::Refused, None, Some(fit(FitVerdict::Backlash, 5.0, Some(6.0))));
        assert_eq!((gap.verdict, gap.valve), (One::Fit(FitVerdict::Backlash), Valve::Gap));
        assert_eq!((gap.width, gap.width_percent_span, gap.struck), (Some(5.0), Some(2.5), None));
        assert_eq!((gap.next.step, gap.urgency), (Next::Inspect(Part::Both), Urgency::High));
        assert_eq!((gap.evidence, gap.acceptable), (Some(Evidence::VeryStrong), Some(Acceptable::Beyond)));
        let unsure = of(Verdict::Estimate, Some(3.0), Some(fit(FitVerdict::CannotTell, 1.0, None)));
        assert_eq!((unsure.valve, unsure.width, unsure.low, unsure.struck), (Valve::Unknown, None, None, None));
        assert_eq!((unsure.next.step, unsure.urgency), (Next::RecordMore, Urgency::Low));
    }

    #[test]
    fn play_is_looked_for_where_the_position_tells_it_from_packing() {
        let at_valve = Some(Judgement::at_valve(glapp_fit::Verdict::Backlash));
        let play = FitFacts { judgement: at_valve, ..fit(FitVerdict::Backlash, 5.0, Some(6.0)) };
        let answer = of(Verdict::Refused, None, Some(play));
        assert_eq!((answer.next.step, answer.cause), (Next::Inspect(Part::Play), Some(Cause::Backlash)));
    }

    #[test]
    fn where_pv_strays_at_the_turns_the_packing_is_looked_at_too() {
        let more = FitFacts { why: MORE.into(), ..fit(FitVerdict::Backlash, 5.0, Some(6.0)) };
        assert_eq!(of(Verdict::Refused, None, Some(more)).next.step, Next::Inspect(Part::Both));
    }

    #[test]
    fn what_could_not_be_fitted_leaves_the_answer_to_the_crossings() {
        let none = FitFacts { d: None, low: None, ..fit(FitVerdict::CannotTell, 0.0, None) };
        let refused = of(Verdict::Refused, None, Some(none.clone()));
        assert_eq!((refused.verdict, refused.valve), (One::Crossings(Verdict::Refused), Valve::Refused));
        let estimate = of(Verdict::Estimate, Some(5.0), Some(none));
        assert_eq!((estimate.width, estimate.next.step, estimate.urgency), (Some(5.0), Next::Confirm, Urgency::Medium));
        assert_eq!(of(Verdict::Estimate, Some(3.0), None).next.step, Next::Review);
        assert_eq!(of(Verdict::Provisional, Some(5.0), None).next.step, Next::ProbablyTooWide);
        assert_eq!(of(Verdict::Provisional, Some(3.0), None).next.step, Next::RecordLonger);
        assert_eq!(of(Verdict::NoEstimate, None, None).next.step, Next::RecordMore);
        let rejected = Some(Reason::TooShort);
        let silent = Facts { crossings: Verdict::NoEstimate, rejected, ..Facts::default() };
        assert_eq!(Summary::of(&silent).next.step, Next::Remedy(Reason::TooShort));
        assert_eq!(Summary::of(&Facts { detections: 1, ..silent }).next.step, Next::StepTest);
        let unlimited = Facts { crossings: Verdict::Estimate, d_hat: Some(5.0), ..Facts::default() };
        assert_eq!(Summary::of(&unlimited).next.step, Next::Compare);
    }

    #[test]
    fn a_limit_that_nobody_gave_is_the_nominal_one_and_never_first() {
        let facts = |span, acceptable, fit| Facts { fit: Some(fit), span, acceptable, ..Facts::default() };
        let wide = || fit(FitVerdict::Backlash, 5.0, Some(6.0));
        let answer = |span, acceptable| Summary::of(&facts(span, acceptable, wide()));
        let nominal = answer(Some(200.0), None);
        let limit = Limit { percent_span: NOMINAL_LIMIT, width: Some(2.0), origin: LimitOrigin::Nominal };
        assert_eq!((nominal.limit, nominal.acceptable), (Some(limit), Some(Acceptable::Beyond)));
        assert_eq!((nominal.urgency, nominal.health), (Urgency::Medium, Health::MaintenanceRequired));
        let given = answer(Some(200.0), Some(1.0));
        assert_eq!((given.urgency, given.limit.map(|l| l.origin)), (Urgency::High, Some(LimitOrigin::Given)));
        // Narrower than the nominal limit: nothing to do, whoever set it.
        let narrow = Summary::of(&facts(Some(1000.0), None, wide()));
        assert_eq!((narrow.next.step, narrow.health), (Next::Review, Health::Normal));
        // No span and no limit: no comparison is possible.
        let bare = answer(None, None);
        assert_eq!((bare.limit, bare.acceptable, bare.urgency), (None, None, Urgency::Medium));
        assert_eq!((bare.health, bare.score), (Health::MaintenanceRequired, None));
        let unknown = answer(None, Some(2.0));
        assert_eq!((unknown.acceptable, unknown.limit.and_then(|limit| limit.width)), (None, None));
        // Crossings alone are no reason for work by a limit that nobody gave.
        let crossings = Facts { crossings: Verdict::Estimate, d_hat: Some(3.0), span: Some(100.0), ..Facts::default() };
        let read = Summary::of(&crossings);
        assert_eq!(
            (read.acceptable, read.next.step, read.urgency),
            (Some(Acceptable::Beyond), Next::Compare, Urgency::Low)
        );
        assert_eq!((read.confidence, read.health), (Confidence::NotJudged, Health::Normal));
    }

    #[test]
    fn a_valve_is_sound_by_a_limit_and_else_none_is_seen() {
        let up_to = |high, span| {
            Summary::of(&Facts { fit: Some(fit(FitVerdict::Sound, 0.0, high)), span, ..Facts::default() }).confidence
        };
        assert_eq!(up_to(Some(0.9), Some(100.0)), Confidence::Sound);
        assert_eq!(up_to(Some(1.1), Some(100.0)), Confidence::NoneSeen);
        assert_eq!(up_to(Some(0.9), None), Confidence::NoneSeen);
    }

    #[test]
    fn a_valve_is_probably_sound_where_all_that_stays_open_is_acceptable() {
        let open = |why: &str, high, span| {
            let fit = FitFacts { why: why.into(), ..fit(FitVerdict::CannotTell, 0.0, high) };
            Summary::of(&Facts { fit: Some(fit), span, ..Facts::default() })
        };
        let likely = open("may_be_a_gap", Some(0.9), Some(100.0));
        assert_eq!((likely.confidence, likely.valve), (Confidence::LikelySound, Valve::Unknown));
        assert_eq!((likely.low, likely.high, likely.width), (Some(0.0), Some(0.9), None));
        assert_eq!((likely.acceptable, likely.width_kind), (None, Some(WidthKind::Bound)));
        assert_eq!((likely.next.step, likely.urgency), (Next::Review, Urgency::None));
        assert_eq!((likely.compensable, likely.health), (None, Health::Normal));
        for silent in [
            open("may_be_a_gap", Some(1.1), Some(100.0)),
            open("may_be_a_gap", Some(0.9), None),
            open("may_be_a_gap", None, Some(100.0)),
            // The limits are those of a rejected model, or a load that swings hides a wider one.
            open("misfit", Some(0.9), Some(100.0)),
            open("repeats", Some(0.9), Some(100.0)),
        ] {
            assert_eq!((silent.confidence, silent.next.step), (Confidence::CannotTell, Next::RecordMore));
        }
    }

    #[test]
    fn a_step_test_in_the_recording_is_used_where_one_would_be_asked_for() {
        let test = StepTestWidth { d: 2.0, low: Some(1.8), high: Some(2.2), decided: None };
        let with = |fit| Summary::of(&Facts { fit: Some(fit), step_test: Some(test), ..Facts::default() });
        let unsure = with(fit(FitVerdict::CannotTell, 1.0, None));
        assert_eq!((unsure.next.step, unsure.next.tested, unsure.step_test), (Next::RecordMore, true, Some(test)));
        assert!(!with(fit(FitVerdict::Sound, 0.0, Some(1.0))).next.tested);
    }

    #[test]
    fn a_step_test_that_was_made_for_it_decides_what_the_fit_leaves_open() {
        let with = |fit, (d, low, high), decided| {
            let test = StepTestWidth { d, low: Some(low), high: Some(high), decided };
            Summary::of(&Facts { fit: Some(fit), step_test: Some(test), span: Some(100.0), ..Facts::default() })
        };
        let likely = || judged(FitConfidence::Likely, Some(WidthKind::Interval), 1.2, Some(4.0));
        let gap = with(likely(), (2.0, 1.8, 2.2), Some(Found::Gap));
        assert_eq!((gap.confidence, gap.valve), (Confidence::Found, Valve::Gap));
        assert_eq!((gap.width, gap.low, gap.high), (Some(2.0), Some(1.8), Some(2.2)));
        assert_eq!((gap.acceptable, gap.next.tested), (Some(Acceptable::Beyond), true));
        let test = StepTestWidth { d: 1.5, low: Some(1.5), high: None, decided: Some(Found::Gap) };
        let facts = Facts { fit: Some(likely()), step_test: Some(test), span: Some(100.0), ..Facts::default() };
        let bound = Summary::of(&facts);
        assert_eq!((bound.confidence, bound.verdict), (Confidence::Found, One::Fit(FitVerdict::AtLeast)));
        assert_eq!((bound.width, bound.low, bound.high), (Some(1.5), Some(1.5), None));
        assert_eq!((bound.width_kind, bound.acceptable), (Some(WidthKind::Bound), Some(Acceptable::Beyond)));
        assert_eq!((bound.next.step, bound.next.tested), (Next::Further, false), "how wide it is it does not tell");
        let none = with(likely(), (0.1, 0.0, 0.4), Some(Found::NoGap));
        assert_eq!((none.confidence, none.width, none.high), (Confidence::Sound, None, Some(0.4)));
        assert_eq!(none.next.step, Next::Nothing);
        assert_eq!(with(likely(), (2.0, 0.0, 4.0), None).confidence, Confidence::Likely);
        let found = with(fit(FitVerdict::Backlash, 5.0, Some(6.0)), (0.1, 0.0, 0.4), Some(Found::NoGap));
        assert_eq!((found.confidence, found.low), (Confidence::Found, Some(5.0)), "no test takes away what was found");
    }

    /// A fit that the ladder has judged.
    fn judged(confidence: FitConfidence, kind: Option<WidthKind>, low: f64, high: Option<f64>) -> FitFacts {
        let cause = kind.map(|_| Cause::DeadBand);
        let judgement = Judgement { confidence, cause, width_kind: kind, oscillates: true };
        let verdict = judgement.verdict(low).into();
        FitFacts { judgement: Some(judgement), ..fit(verdict, low, high) }
    }

    #[test]
    fn what_is_likely_has_its_width_and_asks_for_a_step_test() {
        let likely = |low, high| {
            let fit = judged(FitConfidence::Likely, Some(WidthKind::Interval), low, high);
            of(Verdict::NoEstimate, None, Some(fit))
        };
        let wide = likely(5.0, Some(6.0));
        assert_eq!((wide.verdict, wide.valve), (One::Fit(FitVerdict::CannotTell), Valve::Unknown));
        assert_eq!((wide.confidence, wide.cause), (Confidence::Likely, Some(Cause::DeadBand)));
        assert_eq!((wide.width, wide.low, wide.high), (Some(5.0), Some(5.0), Some(6.0)));
        assert_eq!((wide.next.step, wide.urgency, wide.health), (Next::Confirm, Urgency::Medium, Health::Normal));
        assert_eq!((wide.compensable, wide.oscillates), (None, true), "nobody compensates what is only likely");
        let narrow = likely(1.0, Some(3.0));
        assert_eq!((narrow.next.step, narrow.urgency), (Next::Review, Urgency::None));
        assert_eq!(likely(3.0, Some(5.0)).urgency, Urgency::Low);
    }

    #[test]
    fn a_loop_that_swings_through_an_acceptable_gap_is_not_left_alone() {
        let found = |oscillates| {
            let fit = judged(FitConfidence::Found, Some(WidthKind::Interval), 0.5, Some(1.0));
            let judgement = fit.judgement.map(|of| Judgement { oscillates, ..of });
            of(Verdict::NoEstimate, None, Some(FitFacts { judgement, ..fit }))
        };
        let (swings, rests) = (found(true), found(false));
        assert_eq!((swings.acceptable, rests.acceptable), (Some(Acceptable::Within), Some(Acceptable::Within)));
        assert_eq!((swings.next.step, swings.urgency, swings.health), (Next::Tuning, Urgency::Low, Health::Normal));
        assert_eq!((rests.next.step, rests.urgency), (Next::Review, Urgency::None));
    }

    #[test]
    fn the_prior_changes_probability_and_rank_and_no_rung() {
        let with = |log_bayes_factor: f64, prior| {
            let wider = vec![(1.0, 1.0), (4.0, 0.5), (7.0, 0.0)];
            let weighed = Some(Weighed { log_bayes_factor, terms: Terms::default(), wider });
            let fit = FitFacts { weighed, ..judged(FitConfidence::Likely, Some(WidthKind::Interval), 3.0, Some(6.0)) };
            // 2 % of 200 are 4.
            Summary::of(&Facts { fit: Some(fit), span: Some(200.0), acceptable: Some(2.0), prior, ..Facts::default() })
        };
        let usual = with(3.0_f64.ln(), None);
        assert_eq!((usual.p_gap.map(|p| (1e9 * p).round() / 1e9), usual.prior), (Some(0.5), Some(USUAL_PRIOR)));
        assert!((usual.p_beyond.unwrap() - 0.25).abs() < 1e-9);
        let worn = with(3.0_f64.ln(), Some(0.5));
        assert!((worn.p_gap.unwrap() - 0.75).abs() < 1e-9);
        assert!(worn.rank < usual.rank, "likelier comes first");
        assert_eq!((worn.confidence, worn.urgency, worn.next), (usual.confidence, usual.urgency, usual.next));
        assert_eq!((with(99.0, None).p_gap, with(-99.0, None).p_gap), (Some(0.98), Some(0.02)));
        let none = of(Verdict::NoEstimate, None, Some(fit(FitVerdict::Backlash, 5.0, Some(6.0))));
        assert_eq!((none.p_gap, none.p_beyond, none.terms, none.prior), (None, None, None, None));
    }

    #[test]
    fn a_gap_that_is_there_may_have_no_known_width() {
        let unsure =
            of(Verdict::NoEstimate, None, Some(judged(FitConfidence::Found, Some(WidthKind::Unsure), 0.0, Some(9.0))));
        assert_eq!((unsure.confidence, unsure.width_kind), (Confidence::Found, Some(WidthKind::Unsure)));
        assert_eq!((unsure.valve, unsure.width, unsure.low, unsure.high), (Valve::Gap, Some(0.0), None, None));
        assert_eq!((unsure.next.step, unsure.compensable), (Next::Confirm, None));
        let none = of(Verdict::NoEstimate, None, Some(judged(FitConfidence::CannotTell, None, 1.0, Some(2.0))));
        assert_eq!((none.confidence, none.width, none.cause), (Confidence::CannotTell, None, None));
    }

    #[test]
    fn a_compensation_may_trust_the_lower_limit_of_backlash_alone() {
        let compensable = |verdict| {
            let fit = fit(verdict, 1.5, Some(2.0));
            Summary::of(&Facts { fit: Some(fit), ..Facts::default() }).compensable
        };
        assert_eq!(compensable(FitVerdict::Backlash), Some(1.5));
        assert_eq!(compensable(FitVerdict::Sound), Some(0.0));
        for none in [FitVerdict::Stiction, FitVerdict::Both, FitVerdict::AtLeast, FitVerdict::CannotTell] {
            assert_eq!(compensable(none), None);
        }
        assert_eq!(of(Verdict::Estimate, Some(3.0), None).compensable, None);
    }

    #[test]
    fn a_clean_sinusoid_is_an_answer_without_a_width_too() {
        let swings = FitFacts { d: None, low: None, ..fit(FitVerdict::Oscillation, 0.0, None) };
        let answer = of(Verdict::NoEstimate, None, Some(swings));
        assert_eq!((answer.next.step, answer.oscillates, answer.valve), (Next::Tuning, true, Valve::NoGap));
        assert_eq!((answer.confidence, answer.width), (Confidence::CannotTell, None));
    }

    #[test]
    fn loops_are_ranked_by_how_surely_they_are_too_wide_and_what_that_does() {
        let gap = |low, harm| {
            let harm = vec![Harm::of(harm, None)];
            let fit = Some(fit(FitVerdict::Backlash, low, Some(low + 1.0)));
            Summary::of(&Facts { fit, harm, span: Some(100.0), acceptable: Some(2.0), ..Facts::default() })
        };
        let (harmless, harmful, unknown) = (gap(6.0, Some(0.1)), gap(4.0, Some(0.8)), gap(4.0, None));
        assert_eq!(harmful.score, Some(4.0 / 2.0 * 0.8));
        assert_eq!(unknown.score, Some(4.0 / 2.0 * 0.5));
        assert!(harmful.rank < unknown.rank && unknown.rank < harmless.rank);
        let sound = of(Verdict::NoEstimate, None, Some(fit(FitVerdict::Sound, 0.0, Some(1.0))));
        assert!(harmless.rank < sound.rank);
    }

    #[test]
    fn a_growing_gap_says_when_it_reaches_the_limit() {
        let trend = |slope: f64| {
            let widths: Vec<Width> = (0..10)
                .map(|i| Width { t: 86_400.0 * f64::from(i), d: 1.0 + slope * f64::from(i), error: Some(0.01) })
                .collect();
            crate::trend(&widths)
        };
        let moves = |slope, acceptable| {
            let fit = FitFacts { trend: Some(trend(slope)), ..fit(FitVerdict::Backlash, 1.0, Some(2.0)) };
            Summary::of(&Facts { fit: Some(fit), span: Some(100.0), acceptable: Some(acceptable), ..Facts::default() })
                .trend
        };
        let days = moves(0.1, 3.0).and_then(|moves| moves.days_to_limit).unwrap();
        assert!((days - (3.0 - 1.9) / 0.1).abs() < 1e-9, "{days}");
        assert_eq!(moves(0.1, 1.5).unwrap().days_to_limit, None, "it is there already");
        assert_eq!(moves(-0.1, 3.0).unwrap().days_to_limit, None);
    }

    #[test]
    fn crossings_that_contradict_the_fit_are_struck() {
        let struck = |d_hat, fit| of(Verdict::Estimate, Some(d_hat), Some(fit)).struck.map(|s| (s.code, s.limit));
        let gap = || fit(FitVerdict::Backlash, 2.0, Some(4.0));
        assert_eq!(struck(4.9, gap()), None);
        assert_eq!(struck(5.1, gap()), Some((Contradiction::Above, 4.0)));
        assert_eq!(struck(1.7, gap()), None);
        assert_eq!(struck(1.5, gap()), Some((Contradiction::Below, 2.0)));
        assert_eq!(struck(9.0, fit(FitVerdict::AtLeast, 2.0, None)), None);
        assert_eq!(struck(0.3, fit(FitVerdict::Sound, 0.0, Some(0.4))), Some((Contradiction::Sound, 0.4)));
        let may = FitFacts { why: "may_be_a_gap".into(), ..fit(FitVerdict::CannotTell, 0.0, Some(1.0)) };
        assert_eq!(struck(1.3, may), Some((Contradiction::Above, 1.0)));
        assert_eq!(struck(1.3, fit(FitVerdict::CannotTell, 0.0, Some(1.0))), None, "nobody believes that limit");
    }

    #[test]
    fn a_width_is_judged_by_its_whole_interval() {
        let judged = |low, high| {
            let answer = of(Verdict::Estimate, None, Some(fit(FitVerdict::Backlash, low, high)));
            (answer.acceptable, answer.next.step, answer.urgency)
        };
        let play = Next::Inspect(Part::Both);
        assert_eq!(judged(5.0, Some(6.0)), (Some(Acceptable::Beyond), play, Urgency::High));
        assert_eq!(judged(2.0, Some(3.9)), (Some(Acceptable::Within), Next::Review, Urgency::None));
        assert_eq!(judged(3.0, Some(5.0)), (Some(Acceptable::Open), play, Urgency::Medium));
        assert_eq!(judged(3.0, None), (Some(Acceptable::Open), play, Urgency::Medium));
    }

    #[test]
    fn a_valve_without_a_gap_waits_for_more_where_one_too_wide_would_not_show() {
        let up_to = |high| {
            let answer = of(Verdict::NoEstimate, None, Some(fit(FitVerdict::Sound, 0.0, high)));
            (answer.valve, answer.next.step, answer.urgency)
        };
        assert_eq!(up_to(Some(4.0)), (Valve::NoGap, Next::Nothing, Urgency::None));
        assert_eq!(up_to(Some(4.1)), (Valve::NoGap, Next::RecordMore, Urgency::Low));
    }
}
