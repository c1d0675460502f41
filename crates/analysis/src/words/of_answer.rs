//! Result of an analysis as messages, and as the input of the three parts of an answer.

use super::facts::{Corrected, Crossings, Fit};
use super::{AnswerFacts, Message, Reader, TextError, Value, of_fit, text};
use crate::answer::{AnalysisResult, CorrectedAnswer};
use crate::crossings::{NotCorrected, Travel, Why};
use crate::fitted::{FitWhy, Fitted, Position};
use crate::identify::{self, Identification};
use crate::quality::Finding;
use serde_json::json;

/// A finding on a recording.
pub fn of_finding(finding: &Finding) -> Message {
    let mut message = Message::new(format!("quality.{}", finding.fault.name()));
    for (name, value) in finding.evidence.iter().chain(&finding.numbers) {
        message.numbers.insert((*name).into(), value.clone());
    }
    message.with("severity", finding.severity.name())
}

/// Why the controller's law must not be used unasked; none where it may.
pub fn of_identification(found: &Identification) -> Option<Message> {
    use identify::Reason::{
        Contradictory, FewSteps, GainMayBeNone, LittleExplained, NoGain, NoIntegral, NoOp, NoSp, NoValue, OpStill,
        OppositeSigns, PvStill, Unshown, Wide,
    };
    let code = match found.reason? {
        NoOp => "no_op",
        NoSp => "no_sp",
        NoValue { .. } => "no_value",
        FewSteps => "few_steps",
        OpStill => "op_still",
        PvStill => "pv_still",
        Unshown => "unshown",
        LittleExplained => "little_explained",
        NoGain { .. } => "no_gain",
        GainMayBeNone { .. } => "gain_may_be_none",
        NoIntegral => "no_integral",
        OppositeSigns => "opposite_signs",
        Contradictory => "contradictory",
        Wide { .. } => "wide",
    };
    let mut message = Message::new(format!("identification.{code}")).with("samples", found.samples);
    if let Some(values) = found.values {
        message = message.with("k", values.k).with("ti", values.ti).with("r2", values.r2);
    }
    let interval = |message: Message, name: &str, of: identify::Interval| {
        message.with(&format!("{name}_low"), of.low).with(&format!("{name}_high"), of.high)
    };
    Some(match found.reason? {
        NoGain { error } => message.with("error", error),
        NoValue { signal } => message.with("signal", signal),
        GainMayBeNone { size, k } => interval(message.with("size", size), "k", k),
        Wide { k, ti, h } => interval(interval(message.with("h", h), "k", k), "ti", ti),
        _ => message,
    })
}

/// Why no half-period was accepted: the two most frequent reasons.
fn of_rejected(reasons: &[(&'static str, u64)]) -> Message {
    let total: u64 = reasons.iter().map(|(_, count)| count).sum();
    if total == 0 {
        return Message::new("crossings.never_crossed");
    }
    let mut ranked: Vec<_> = reasons.iter().filter(|(_, count)| *count > 0).collect();
    ranked.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let cause = |(name, count): &&(&'static str, u64)| {
        let label = Message::new(format!("half_period.{name}"));
        Value::from(Message::new("crossings.cause").with("count", *count).with("label", label))
    };
    let causes = ranked.iter().take(2).map(cause).collect();
    Message::new("crossings.nothing_accepted").with("total", total).with("causes", Value::List(causes))
}

/// Why the crossings say no more; none where nothing is against their estimate.
pub fn of_crossings(answer: &AnalysisResult) -> Option<Message> {
    let message = |code: &str| Message::new(format!("crossings.{code}"));
    Some(match answer.why? {
        Why::Exclusion(exclusion) => message("place").with("place", exclusion.name()).with("partner", "another loop"),
        Why::NoSp => message("no_sp"),
        Why::Finding(i) => of_finding(&answer.quality[i]),
        Why::NoLaw => message("no_law"),
        Why::NotIdentified => {
            let reason = answer.identification.as_ref().and_then(of_identification);
            message("not_identified").with("reason", reason.map_or(Value::Word("".into()), Value::from))
        }
        Why::NothingAccepted => of_rejected(&answer.reasons),
        Why::Coarse { samples } => message("coarse").with("samples", samples),
        Why::Disagree { kept, count } => {
            message("disagree").with("kept", u64::from(kept)).with("count", u64::from(count))
        }
        Why::GainTooLow => {
            let kp = answer.controller.origins.iter().find(|(name, _)| *name == "kp");
            message("gain_too_low").with("kp_origin", kp.map_or("unknown", |(_, origin)| origin.name()))
        }
        Why::Noise { d, floor } => message("noise").with("d", d).with("floor", floor),
        Why::Few => message("few").with("detections", answer.detections).with("n", u64::from(answer.controller.n)),
    })
}

/// Why the known bias of the crossings' width is not taken out; none where it is.
pub fn of_correction(of: &CorrectedAnswer) -> Option<Message> {
    let message = |code: &str| Message::new(format!("not_corrected.{code}"));
    let message = match of.why? {
        NotCorrected::Doubt(doubt) => message("doubt").with("doubt", doubt.name()).with("kp", of.kp),
        NotCorrected::Noise { d, noise } => message("noise").with("d", d).with("noise", noise),
        NotCorrected::Smooth { tf } => message("smooth").with("tf", tf),
        NotCorrected::Integrating => message("integrating"),
        NotCorrected::NoEstimate => message("no_estimate"),
    };
    Some(message.with("pairs", of.pairs))
}

/// Message of the fit with its evidence; none where nothing was asked.
pub fn of_fitted(answer: &AnalysisResult, fitted: &Fitted) -> Option<Message> {
    let through_pv = match (&fitted.answer.why, &fitted.pv) {
        (FitWhy::Exclusion(exclusion), _) => {
            Message::new("crossings.place").with("place", exclusion.name()).with("partner", "another loop")
        }
        (FitWhy::Finding(i), _) => of_finding(answer.quality.get(*i)?),
        (_, None) => Message::new("fit.op_rests"),
        (_, Some(Err(why))) => of_fit::of_unfit(*why, "PV"),
        (_, Some(Ok(joint))) => {
            let trend = joint.whole.trend.as_ref().and_then(of_fit::of_trend);
            changed(of_fit::of_pv(&joint.whole, &joint.records[joint.shown], false), trend)
        }
    };
    let Some(position) = &fitted.position else { return Some(through_pv) };
    let at_valve = match position {
        Err(why) => of_fit::of_unfit(*why, "the position"),
        Ok(joint) => changed(of_fit::of_position(joint), joint.trend.as_ref().and_then(of_fit::of_trend)),
    };
    let code = match fitted.answer.position? {
        Position::Silent => "fit.silent",
        Position::Settles => "fit.settles",
        Position::Bounds => "fit.bounds",
        Position::Contradicts => "fit.contradicts",
    };
    let verdict = fitted.answer.verdict.name();
    Some(Message::new(code).with("pv", through_pv).with("position", at_valve).with("verdict", verdict))
}

fn changed(facts: Message, trend: Option<Message>) -> Message {
    match trend {
        None => facts,
        Some(trend) => Message::new("fit.changed").with("said", facts).with("trend", trend),
    }
}

impl AnswerFacts {
    /// Messages of an analysis; `span` is the width of OP's [OP unit].
    ///
    /// # Errors
    /// Where a reason has no sentence.
    pub fn of(
        answer: &AnalysisResult,
        fitted: Option<&Fitted>,
        span: Option<f64>,
        reader: &Reader,
    ) -> Result<Self, TextError> {
        let tell =
            |message: Option<Message>| message.map(|message| text(&message.code, &message.numbers, reader)).transpose();
        // The document and the sentences made of it have one set of names.
        let document: Self = serde_json::from_value(json!(answer.answer)).unwrap_or_default();
        let fit = match (&answer.fit, fitted) {
            (Some(fit), Some(fitted)) => Some(Fit {
                why: if matches!(fit.why, FitWhy::Finding(_)) { "sinusoidal".into() } else { fit.word().into() },
                d: fit.d,
                jump: Some(fit.jump),
                position: fit.position.filter(|of| *of == Position::Contradicts).map(|_| "contradicts".into()),
                reason: tell(of_fitted(answer, fitted))?.unwrap_or_default(),
                recordings: None,
            }),
            _ => None,
        };
        let most = answer.reasons.iter().rev().filter(|(_, count)| *count > 0).max_by_key(|(_, count)| *count);
        let whole = |n: u64| i64::try_from(n).unwrap_or(i64::MAX);
        let corrected = answer.corrected.as_ref().map(|of| -> Result<_, TextError> {
            Ok(Corrected {
                d: of.d,
                low: of.low,
                high: of.high,
                kp: of.kp,
                kp_range: of.kp_range,
                pairs: whole(of.pairs as u64),
                travel: if of.travel == Travel::Op { "op".into() } else { "(4.1)".into() },
                reason: tell(of_correction(of))?,
            })
        });
        let crossings = Crossings {
            verdict: answer.crossings.name().into(),
            reason: tell(of_crossings(answer))?,
            d_hat: answer.d_hat,
            d_hat_percent_span: answer.d_hat_percent_span,
            detections: whole(answer.detections),
            half_periods: whole(answer.half_periods),
            n: i64::from(answer.controller.n),
            repeatability: answer.repeatability,
            noise_floor: answer.noise_floor,
            corrected: corrected.transpose()?,
            rejected: most.map(|(name, count)| ((*name).into(), whole(*count))),
            positioner: None,
        };
        let number = |name| answer.messages.iter().find_map(|message| message.numbers.get(name)?.number());
        Ok(Self { span, fit, crossings, enough: number("enough"), apart: number("apart"), ..document })
    }
}
