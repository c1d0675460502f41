//! The one answer by the fit.

use super::Summary;
use super::facts::{Facts, FitFacts};
use super::kinds::{Acceptable, Confidence, Health, LimitOrigin, Next, One, Part, Urgency, Valve};
use crate::fitted::FitVerdict;
use crate::harm::Harm;
use glapp_fit::{Cause, Confidence as FitConfidence, LEAST_DOUBT, USUAL_PRIOR, Weighed, WidthKind};

/// Harm that a gap is ranked by where it is not known: half of what there can be.
const HARM_UNKNOWN: f64 = 0.5;

/// Word of a fit that found a gap which is not all: where the valve turns PV strays from the model, as one that sticks makes it.
pub(super) const MORE: &str = "gap_and_more";

impl Summary {
    /// The answer by the fit.
    pub(super) fn of_fit(facts: &Facts, fit: &FitFacts) -> Self {
        let judged = fit.judged();
        let limit = facts.limit();
        let improbable_above = limit.and_then(|limit| limit.width).filter(|width| fit.likely_sound(*width));
        let likely_sound = improbable_above.is_some();
        let (low, high) = match improbable_above {
            Some(width) => (Some(0.0), Some(fit.high.map_or(width, |high| high.min(width)))),
            None => fit.interval(),
        };
        let width = match (judged.confidence, judged.width_kind) {
            _ if fit.verdict == FitVerdict::Oscillation => None,
            (FitConfidence::Found | FitConfidence::Likely, Some(WidthKind::Bound)) => low,
            (FitConfidence::Found | FitConfidence::Likely, _) => fit.d,
            _ => None,
        };
        let acceptable = facts.judged(width.and(low), high);
        let open = facts.judged(low, high);
        let confidence = fit.confidence(likely_sound, open == Some(Acceptable::Within));
        let claims = confidence != Confidence::CannotTell;
        let bound = matches!(confidence, Confidence::NoneSeen | Confidence::Sound | Confidence::LikelySound);
        let next = fit.next(acceptable, likely_sound, open);
        let valve = fit.valve();
        let urgency = fit.urgency(valve, acceptable, likely_sound, next);
        let nominal = limit.is_some_and(|limit| limit.origin == LimitOrigin::Nominal);
        let prior = facts.prior.unwrap_or(USUAL_PRIOR);
        let weighed = fit.weighed.as_ref();
        let shown = |p: f64| p.clamp(LEAST_DOUBT, 1.0 - LEAST_DOUBT);
        let beyond = |weighed: &Weighed, width| weighed.probability_beyond(width, prior);
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
}

impl FitFacts {
    /// Confidence that there is a dead band; `none_too_wide`: whether the widths that are not excluded are acceptable.
    fn confidence(&self, likely_sound: bool, none_too_wide: bool) -> Confidence {
        match self.judged().confidence {
            _ if self.verdict == FitVerdict::Oscillation => Confidence::CannotTell,
            FitConfidence::Found => Confidence::Found,
            FitConfidence::Likely => Confidence::Likely,
            FitConfidence::NoneSeen if none_too_wide => Confidence::Sound,
            FitConfidence::NoneSeen => Confidence::NoneSeen,
            FitConfidence::CannotTell if likely_sound => Confidence::LikelySound,
            FitConfidence::CannotTell => Confidence::CannotTell,
        }
    }

    /// State of the valve.
    fn valve(&self) -> Valve {
        match self.verdict {
            verdict if verdict.found() => Valve::Gap,
            // A gap is certain, of any width.
            FitVerdict::CannotTell if self.judged().confidence == FitConfidence::Found => Valve::Gap,
            FitVerdict::CannotTell => Valve::Unknown,
            _ => Valve::NoGap,
        }
    }

    /// Whether the loop swings through a gap that was found. No work on the valve helps such a loop where the gap is narrow; its tuning does,
    /// or a compensation.
    fn swings(&self) -> bool {
        let judged = self.judged();
        judged.oscillates && judged.confidence == FitConfidence::Found
    }

    /// Next step. `acceptable`: the width against the limit; `open`: the widths that are not excluded against it.
    fn next(&self, acceptable: Option<Acceptable>, likely_sound: bool, open: Option<Acceptable>) -> Next {
        let judged = self.judged();
        let acceptable = acceptable == Some(Acceptable::Within);
        match self.verdict {
            _ if acceptable && self.swings() => Next::Tuning,
            _ if acceptable || likely_sound => Next::Review,
            FitVerdict::Backlash if judged.cause == Some(Cause::Backlash) && self.why != MORE => {
                Next::Inspect(Part::Play)
            }
            // PV alone does not tell play from packing.
            FitVerdict::Backlash => Next::Inspect(Part::Both),
            FitVerdict::Stiction => Next::Inspect(Part::Packing),
            FitVerdict::Both => Next::Inspect(Part::Both),
            FitVerdict::AtLeast => Next::Further,
            // A gap that is too wide would not show either.
            FitVerdict::Sound if open == Some(Acceptable::Open) => Next::RecordMore,
            FitVerdict::Sound => Next::Nothing,
            FitVerdict::Oscillation => Next::Tuning,
            FitVerdict::CannotTell if judged.tells() => Next::Confirm,
            FitVerdict::CannotTell => Next::RecordMore,
        }
    }

    /// Urgency by the limit, as if a person had stated it.
    fn urgency(&self, valve: Valve, acceptable: Option<Acceptable>, likely_sound: bool, next: Next) -> Urgency {
        match (valve, acceptable) {
            (Valve::Gap, Some(Acceptable::Within)) if self.swings() => Urgency::Low,
            (Valve::Gap, Some(Acceptable::Within)) => Urgency::None,
            (Valve::Gap, Some(Acceptable::Beyond)) => Urgency::High,
            (Valve::Gap, _) => Urgency::Medium,
            (Valve::Unknown, Some(Acceptable::Within)) => Urgency::None,
            (Valve::Unknown, _) if likely_sound => Urgency::None,
            // No more than likely: a step test at the next round.
            (Valve::Unknown, Some(Acceptable::Beyond)) => Urgency::Medium,
            _ if self.verdict == FitVerdict::Oscillation => Urgency::Medium,
            (Valve::NoGap, _) if next == Next::Nothing => Urgency::None,
            _ => Urgency::Low,
        }
    }
}
