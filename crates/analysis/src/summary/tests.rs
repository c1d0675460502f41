use super::by_fit::MORE;
use super::*;
use crate::step_test::Found;
use glapp_core::Reason;
use glapp_fit::Width;
use glapp_fit::{Confidence as FitConfidence, Judgement, Terms, USUAL_PRIOR, Weighed};

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
fn a_valve_is_probably_sound_where_a_dead_band_that_matters_is_improbable() {
    // A dead band is wider than 0.5 in half of all cases, and than 1 in one of a hundred.
    let weighed = |p: f64| {
        let log_bayes_factor = (p / (1.0 - p)).ln() - (USUAL_PRIOR / (1.0 - USUAL_PRIOR)).ln();
        Some(Weighed { log_bayes_factor, terms: Terms::default(), wider: vec![(0.5, 0.5), (1.0, 0.01), (2.0, 0.0)] })
    };
    let open = |why: &str, p, acceptable, span| {
        let fit = FitFacts { why: why.into(), weighed: weighed(p), ..fit(FitVerdict::CannotTell, 0.0, Some(1.4)) };
        Summary::of(&Facts { fit: Some(fit), span, acceptable, ..Facts::default() })
    };
    let likely = open("may_be_a_gap", 0.2, None, Some(100.0));
    assert_eq!((likely.confidence, likely.valve), (Confidence::LikelySound, Valve::Unknown));
    assert_eq!((likely.low, likely.high, likely.width), (Some(0.0), Some(1.0), None));
    assert_eq!((likely.acceptable, likely.width_kind), (None, Some(WidthKind::Bound)));
    assert_eq!((likely.next.step, likely.urgency), (Next::Review, Urgency::None));
    assert_eq!((likely.compensable, likely.health), (None, Health::Normal));
    let wider = open("may_be_a_gap", 0.2, Some(2.0), Some(100.0));
    assert_eq!(
        (wider.confidence, wider.high),
        (Confidence::LikelySound, Some(1.4)),
        "the limit of the fit is the lower one"
    );
    for silent in [
        open("may_be_a_gap", 0.2, Some(0.9), Some(100.0)),
        open("may_be_a_gap", 0.2, None, None),
        // All evidence makes a dead band more probable than usual, however narrow it may be.
        open("may_be_a_gap", 0.26, None, Some(100.0)),
        // The limits are those of a rejected model, or a load that swings hides a wider one.
        open("misfit", 0.2, None, Some(100.0)),
        open("repeats", 0.2, None, Some(100.0)),
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
    let weak =
        FitFacts { lr_no_gap: Some(16.0), lr_needed: Some(100.0), ..judged(FitConfidence::Likely, None, 3.0, None) };
    assert_eq!(
        of(Verdict::Refused, None, Some(weak)).evidence,
        Some(Evidence::Weak),
        "likely by all evidence together"
    );
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
