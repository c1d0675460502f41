//! Formats and wordings compared with those of Python before the words were here, and the catalogue with its own rules.

use super::template::{self, Part};
use super::*;
use serde_json::Value as Json;
use std::collections::BTreeMap;

/// Numbers on random values, and findings on random numbers, as Python's own formats wrote them.
const VECTORS: &str = include_str!("vectors.json");

#[test]
fn numbers_are_written_as_python_wrote_them() {
    let all: Json = serde_json::from_str(VECTORS).unwrap();
    let vectors: Vec<(String, Vec<Json>, String)> = serde_json::from_value(all["numbers"].clone()).unwrap();
    assert!(vectors.len() > 500);
    for (kind, of, wanted) in &vectors {
        let (x, word) = (|i: usize| of[i].as_f64(), |i: usize| of[i].as_str().unwrap());
        let shown = match kind.as_str() {
            "number" => number(x(0), of[1].as_u64().unwrap() as usize),
            "quantity" => quantity(x(0), word(1), of[2].as_u64().unwrap() as usize),
            "duration" => duration(x(0).unwrap()),
            "clock" => clock(of[0].as_i64(), x(1).unwrap()),
            "sentence" => sentence(word(0)),
            "count" => count(of[0].as_i64().unwrap(), word(1)),
            _ => {
                let numbers = BTreeMap::from([("x".to_string(), Value::Number(x(0).unwrap()))]);
                template::filled("test.x", &format!("{{x:{}}}", word(1)), &numbers, &Reader::default()).unwrap()
            }
        };
        assert_eq!(shown, *wanted, "{kind} of {of:?}");
    }
}

#[test]
fn findings_are_worded_as_python_worded_them() {
    let all: Json = serde_json::from_str(VECTORS).unwrap();
    let vectors: Vec<(String, BTreeMap<String, Value>, String)> =
        serde_json::from_value(all["quality"].clone()).unwrap();
    let reader = Reader { pv_unit: "bar".into(), op_unit: "%".into(), ..Reader::default() };
    for (code, numbers, wanted) in &vectors {
        assert_eq!(text(&format!("quality.{code}"), numbers, &reader).as_ref(), Ok(wanted), "{code}");
    }
    assert!(vectors.len() > 20);
    let worded = |fault: &crate::quality::Fault| {
        catalogue().any(|(code, _)| code.starts_with(&format!("quality.{}", fault.name())))
    };
    assert!(crate::quality::Fault::ALL.iter().all(worded));
}

#[test]
fn a_field_of_a_sentence_has_a_format_that_there_is() {
    let known =
        ["", "op", "pv", "about", "of span", "number", "seconds", "duration", "time", "share", "size", "row", "rows"];
    let known = [&known[..], &["times", "and", "list", "steps", "d"]].concat();
    for (code, sentence) in catalogue() {
        for part in template::parts(sentence) {
            if let Part::Field(name, format) = part {
                let number = format.starts_with('.') && format.ends_with(['f', 'g', 'e', '%']);
                assert!(
                    !name.is_empty() && (number || known.contains(&format) || format.starts_with("count ")),
                    "{code}"
                );
            }
        }
    }
}

#[test]
fn a_code_stands_once_and_no_word_is_one_that_only_this_code_knows() {
    let all: Vec<_> = catalogue().collect();
    let codes: std::collections::BTreeSet<_> = all.iter().map(|(code, _)| code).collect();
    assert_eq!(codes.len(), all.len());
    for (code, sentence) in &all {
        for word in ["struck", "foreseen", "foresee", "drill", "lost motion", "units of 2"] {
            assert!(!sentence.contains(word), "{code}: {word}");
        }
    }
}

#[test]
fn what_is_missing_is_named() {
    let none = BTreeMap::new();
    let reader = Reader::default();
    assert_eq!(text("quality.nothing", &none, &reader), Err(TextError::Code("quality.nothing".into())));
    let missing = text("crossings.noise", &none, &reader).unwrap_err();
    assert_eq!(missing.to_string(), "message 'crossings.noise' has no 'd'");
    let wrong = Message::new("crossings.noise").with("d", "wide").with("floor", 1.0);
    let wrong = text(&wrong.code, &wrong.numbers, &reader).unwrap_err();
    assert_eq!(wrong.to_string(), "message 'crossings.noise': 'd' cannot be written as 'op'");
}

/// Texts of an answer in a document.
fn texts_for(facts: Json) -> AnswerTexts {
    let reader = Reader { name: "FIC1".into(), op_unit: "%".into(), ..Reader::default() };
    texts_of(&serde_json::from_value(facts).unwrap(), &reader).unwrap()
}

fn gap() -> Json {
    serde_json::json!({
        "verdict": "backlash", "valve": "gap", "width": 4.01, "low": 3.1, "high": 5.2, "evidence": "strong", "urgency": "medium",
        "next": {"code": "inspect", "of": "play"}, "struck": {"code": "below", "limit": 3.1},
        "fit": {"why": "gap", "d": 4.01, "jump": 0.0, "reason": "dead band of 4.01 %OP: likelihood ratio 116, 85 needed"},
        "crossings": {"verdict": "estimate", "d_hat": 0.434, "detections": 9, "half_periods": 20, "n": 9},
    })
}

fn with(mut facts: Json, more: Json) -> Json {
    for (name, value) in more.as_object().unwrap() {
        facts[name] = value.clone();
    }
    facts
}

#[test]
fn how_probable_a_gap_is_ends_a_sentence_that_leaves_it_open() {
    use serde_json::json;
    let weighed = json!({
        "p_gap": 0.84, "p_beyond": 0.6, "prior": 0.25, "limit": {"percent_span": 1.0, "origin": "nominal"},
        "terms": {"noise": 0.69, "likelihood": 1.4, "limit": 0.01, "plateau": -0.7},
    });
    let likely = texts_for(with(with(gap(), json!({"confidence": "likely", "width_kind": "bound"})), weighed.clone()));
    assert_eq!(
        likely.so,
        "The valve of FIC1 probably has a dead band of at least 3.1\u{a0}% (gap probability 84\u{a0}%)."
    );
    assert_eq!(likely.probable, "gap probability 84\u{a0}%, wider than 1\u{a0}% of span 60\u{a0}%");
    assert_eq!(
        likely.why[1..4],
        [
            "The probability of a dead band is 84\u{a0}%, of one wider than 1\u{a0}% of span 60\u{a0}%, if 25\u{a0}% of the plant's valves have one.",
            "For a dead band: how much better a gap explains PV than none (odds × 4.06), how far the gap moves PV compared with its \
             noise (odds × 1.99).",
            "Against it: whether PV stands still while OP crosses the gap (odds × 0.497).",
        ]
    );
    let found = texts_for(with(with(gap(), json!({"confidence": "found"})), weighed));
    assert_eq!(found.so, texts_for(gap()).so, "what is found needs no probability");
    assert!(found.why.iter().all(|text| !text.contains("probability")));
    assert_eq!((texts_for(gap()).probable.as_str(), texts_for(gap()).why.len()), ("", 2));
}

#[test]
fn an_answer_has_three_parts() {
    use serde_json::json;
    let found = texts_for(gap());
    assert_eq!(found.so, "The valve of FIC1 has a dead band of 4.01\u{a0}%OP (3.10 to 5.20, 95 %).");
    assert_eq!(
        found.doing,
        "Check linkage, keys and actuator for play; confirm with a step test before work is ordered."
    );
    assert_eq!(found.why[0], "dead band of 4.01 %OP: likelihood ratio 116, 85 needed.".replacen('d', "D", 1));
    assert_eq!(found.why[1], "The simple method reads 0.43\u{a0}%, too low; ignore it.");
    // The likelihood stands in the fold alone.
    assert!(!found.so.contains("likelihood") && !found.doing.contains("likelihood"));

    let likely = texts_for(with(gap(), json!({"confidence": "likely", "width_kind": "interval"})));
    assert_eq!(likely.so, "The valve of FIC1 probably has a dead band of about 4.0\u{a0}% (3.10 to 5.20).");
    assert_eq!(likely.doing, "Confirm with a step test.");
    let bound = texts_for(with(gap(), json!({"confidence": "likely", "width_kind": "bound"})));
    assert_eq!(bound.so, "The valve of FIC1 probably has a dead band of at least 3.1\u{a0}%.");
    let unsure = texts_for(with(gap(), json!({"width_kind": "unsure"})));
    assert_eq!(unsure.so, "The valve of FIC1 has a dead band of about 4.0\u{a0}%, but its width is uncertain.");
    let either = texts_for(with(gap(), json!({"cause": "dead_band"})));
    assert!(either.so.contains("from packing or play"));
    let none = texts_for(with(gap(), json!({"confidence": "none_seen", "width": null, "high": 2.0})));
    assert_eq!(none.so, "FIC1 shows no dead band, but one of up to 2\u{a0}% would not show.");

    let sound = texts_for(with(
        gap(),
        json!({"confidence": "likely_sound", "verdict": "cannot_tell", "width": null, "low": 0.0, "high": 0.4, "p_gap": 0.17,
        "limit": {"percent_span": 1.0, "origin": "nominal"}, "next": {"code": "review"}}),
    ));
    assert_eq!(sound.so, "The valve of FIC1 probably has no dead band wider than 1\u{a0}% of span.");
    assert_eq!(sound.doing, "Nothing now; analyse again at the next review.");

    let swings =
        json!({"acceptable": "within", "limit": {"percent_span": 5.0, "origin": "given"}, "next": {"code": "tuning"}});
    assert_eq!(
        texts_for(with(gap(), with(json!({"confidence": "found"}), swings))).doing,
        "The valve needs no work: all of it is within 5\u{a0}% of span. But the loop swings, as a dead band can make it: \
         check the tuning, or compensate the dead band."
    );

    let beyond = json!({"acceptable": "beyond", "limit": {"percent_span": 1.0, "origin": "nominal"}});
    assert!(texts_for(with(gap(), beyond)).so.ends_with(", 95 %), more than the usual 1\u{a0}% of span."));
    let grown = json!({"trend": {"code": "grows", "t": [0.0, 864_000.0], "d": [2.0, 4.0]}});
    assert!(texts_for(with(gap(), grown)).so.ends_with(", 95 %), up from 2 in 10 d."));
    let tested = texts_for(with(
        gap(),
        json!({"step_test": {"d": 3.9, "low": 3.5, "high": 4.2},
        "next": {"code": "inspect", "of": "play", "tested": true}}),
    ));
    assert_eq!(
        tested.doing,
        "Use the step test in this recording: it gives 3.90\u{a0}%OP (3.50 to 4.20). Check linkage, keys and actuator \
         for play."
    );
}

#[test]
fn a_list_does_not_show_an_uncertain_width_as_a_sure_one() {
    use serde_json::json;
    let none = json!({"low": null, "high": null, "confidence": "likely", "width_kind": "unsure"});
    assert_eq!(texts_for(with(gap(), none)).headline, "about 4.0\u{a0}%");
}

#[test]
fn what_cannot_be_told_says_what_is_probable() {
    use serde_json::json;
    let open = json!({
        "verdict": "cannot_tell", "valve": "unknown", "evidence": "weak", "next": {"code": "record_more"},
        "fit": {"why": "may_be_a_gap", "d": 4.01, "reason": "x"}, "crossings": {"verdict": "no_estimate"},
    });
    assert_eq!(texts_for(open.clone()).so, "The dead band of FIC1, if it has one, is about 4.0\u{a0}%.");
    let bound = texts_for(with(open.clone(), json!({"high": 5.0})));
    assert_eq!(bound.so, "The dead band of FIC1, if it has one, is about 4.0\u{a0}%, at most 5\u{a0}%.");
    let next_to_none = texts_for(with(open, json!({"high": 50.0})));
    assert_eq!(next_to_none.so, "FIC1 shows no dead band, but one of up to 50\u{a0}% is not ruled out.");
    let refused = json!({
        "verdict": "refused", "valve": "refused", "next": {"code": "correct"},
        "crossings": {"verdict": "refused", "reason": "OP stays at 20 % over the whole recording."},
    });
    let refused = texts_for(refused);
    assert_eq!(refused.so, "FIC1 was not analysed: OP stays at 20 % over the whole recording.");
    assert!(refused.why.is_empty(), "it is said already");
    assert_eq!(refused.doing, "Correct what is named, then analyse again.");
}

#[test]
fn a_width_next_to_none_is_not_compared_with_none() {
    let numbers = |d: f64| {
        let all = [("d", d), ("high", 0.482), ("lr_no_gap", 0.5), ("lr_needed", 15.0)];
        let mut all: BTreeMap<String, Value> = all.map(|(name, x)| (name.into(), Value::Number(x))).into();
        all.insert("reason".into(), Value::Word("may_be_a_gap".into()));
        text("fit.cannot_tell", &all, &Reader { op_unit: "%".into(), ..Reader::default() }).unwrap()
    };
    let longer = ". Record for longer, or while OP moves further";
    assert_eq!(
        numbers(0.0),
        format!(
            "a valve without a gap explains the data best, and one of up to 0.482\u{a0}%OP is not ruled out{longer}"
        )
    );
    assert_eq!(
        numbers(0.2),
        format!("a valve without a gap explains the data as well as one with 0.200\u{a0}%OP; at most 0.482{longer}")
    );
}

#[test]
fn what_to_record_follows_from_why_it_cannot_be_told() {
    use serde_json::json;
    let open = |why: &str, more: serde_json::Value| {
        let fit = json!({"why": why, "d": 4.01, "reason": "x"});
        let answer = json!({
            "verdict": "cannot_tell", "valve": "unknown", "evidence": "weak", "next": {"code": "record_more"},
            "crossings": {"verdict": "no_estimate"}, "fit": fit,
        });
        texts_for(with(answer, more)).doing
    };
    let test = "make a step test in manual.";
    let longer = format!("Record for longer while OP moves further, or {test}");
    assert_eq!(open("may_be_a_gap", json!({})), longer);
    let apart = || json!({"apart": 30.0});
    let closer = "Record rows closer together than 30 s";
    for why in ["coarse", "hidden_by_samples"] {
        assert_eq!(open(why, apart()), format!("{closer}, or {test}"));
    }
    let longer = format!("{closer}, for longer and while OP moves further, or {test}");
    assert_eq!(open("may_be_a_gap", apart()), longer);
    assert_eq!(open("no_answer", apart()), longer);
    let calmer = format!("Record while the setpoint moves or on a calmer day, or {test}");
    for why in ["swings", "repeats", "hidden_by_changes"] {
        assert_eq!(open(why, apart()), calmer);
    }
    assert_eq!(open("windows_disagree", json!({})), format!("Record while nothing is changed, or {test}"));
    assert_eq!(open("lined", json!({})), format!("Record PV without compression, or {test}"));
}

#[test]
fn a_run_is_told_by_what_is_to_be_done() {
    let one = |valve: &str, urgency: &str, next: &str| Headline {
        valve: valve.into(),
        urgency: urgency.into(),
        next: next.into(),
        acceptable: None,
    };
    let mut run = vec![one("gap", "high", "inspect"); 4];
    run.push(one("no_gap", "medium", "tuning"));
    run.push(one("unknown", "low", "record_more"));
    let found = overview(&run, &Reader::default()).unwrap();
    assert_eq!(found, "4 valves: act now. 1 loop: check the tuning. 1 loop: cannot tell yet.");
    let likely = [one("unknown", "none", "review"), one("unknown", "medium", "confirm")];
    let likely = overview(&likely, &Reader::default()).unwrap();
    assert_eq!(likely, "1 valve: probably a dead band; a step test settles it. 1 valve: probably within the limit.");
    let calm = overview(&[one("no_gap", "none", "nothing")], &Reader::default()).unwrap();
    assert_eq!(calm, "Nothing is urgent. 1 valve: no dead band seen.");
}

#[test]
fn every_verdict_and_every_next_step_has_its_sentence() {
    use crate::crossings::Verdict;
    use crate::fitted::FitVerdict;
    let verdicts = FitVerdict::ALL.map(FitVerdict::name).into_iter().chain(Verdict::ALL.map(Verdict::name));
    let steps = ["correct", "inspect", "further", "record_more", "tuning", "nothing", "review", "confirm", "compare"];
    let steps = steps.into_iter().chain(["record_longer", "probably_too_wide", "step_test", "remedy"]);
    for (verdict, step) in verdicts.flat_map(|verdict| steps.clone().map(move |step| (verdict, step))) {
        let of = if step == "remedy" { serde_json::json!("too_short") } else { Json::Null };
        let facts = with(gap(), serde_json::json!({"verdict": verdict, "next": {"code": step, "of": of}}));
        let texts = texts_for(facts);
        assert!(texts.so.ends_with('.') && texts.doing.ends_with('.') && !texts.short.is_empty(), "{verdict}, {step}");
    }
    for reason in glapp_core::Reason::ALL {
        for of in ["half_period", "half_period_meaning", "half_period_remedy"] {
            assert!(text(&format!("{of}.{}", reason.name()), &BTreeMap::new(), &Reader::default()).is_ok());
        }
    }
}

#[test]
fn every_sentence_can_be_told() {
    for (code, sentence) in catalogue() {
        let value = |format: &str| match format {
            "" | "and" | "list" => Value::from("a, b"),
            "rows" => Value::from("3 7"),
            "row" | "times" | "d" => Value::Count(2),
            format if format.starts_with("count ") => Value::Count(2),
            _ => Value::Number(0.25),
        };
        let numbers: BTreeMap<String, Value> = template::parts(sentence)
            .iter()
            .filter_map(|part| match part {
                Part::Field(name, format) => Some(((*name).to_string(), value(format))),
                Part::Text(_) => None,
            })
            .collect();
        let filled = template::filled(&code, sentence, &numbers, &Reader::default());
        assert!(filled.is_ok_and(|filled| !filled.contains(['{', '}']) || code == "step_test.not_settled"), "{code}");
    }
}

#[test]
fn what_an_analysis_found_is_told_without_a_number_missing() {
    use crate::crossings::NotCorrected;
    use crate::identify::{Identification, Interval, Reason, Values};
    use glapp_core::Doubt;
    let k = Interval { low: 0.1, high: f64::INFINITY };
    let reasons = [
        Reason::NoOp,
        Reason::NoSp,
        Reason::NoValue { signal: "OP" },
        Reason::FewSteps,
        Reason::OpStill,
        Reason::PvStill,
        Reason::Unshown,
        Reason::LittleExplained,
        Reason::NoGain { error: 0.1 },
        Reason::GainMayBeNone { size: 0.1, k },
        Reason::NoIntegral,
        Reason::OppositeSigns,
        Reason::Contradictory,
        Reason::Wide { k, ti: k, h: 1.0 },
    ];
    let reader = Reader::default();
    for reason in reasons {
        let values = Some(Values { k: 1.0, ti: 10.0, r2: 0.5 });
        let message =
            of_identification(&Identification { samples: 9, values, settings: None, reason: Some(reason) }).unwrap();
        assert!(text(&message.code, &message.numbers, &reader).is_ok(), "{message:?}");
        // A stored message renders to the same text.
        let stored = serde_json::to_string(&message).unwrap();
        let read: Message = serde_json::from_str(&stored).unwrap();
        assert!(text(&read.code, &read.numbers, &reader).is_ok(), "{stored}");
    }
    let whys = [
        NotCorrected::Doubt(Doubt::TooFew),
        NotCorrected::Doubt(Doubt::Swamped),
        NotCorrected::Noise { d: 0.1, noise: 0.2 },
        NotCorrected::Smooth { tf: 3.0 },
        NotCorrected::Integrating,
        NotCorrected::NoEstimate,
    ];
    for why in whys {
        let of = crate::CorrectedAnswer {
            d: None,
            low: None,
            high: None,
            kp: None,
            kp_range: None,
            pairs: 2,
            travel: crate::crossings::Travel::Op,
            why: Some(why),
        };
        let message = of_correction(&of).unwrap();
        assert!(text(&message.code, &message.numbers, &reader).is_ok(), "{message:?}");
    }
}
