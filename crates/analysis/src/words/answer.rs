//! The answer in three parts: state, next step, and reasons.

use super::facts::{AnswerFacts, Corrected, Limit};
use super::{Message, Numbers, Reader, Subject, TextError, Value, sentence, text};
use serde::{Deserialize, Serialize};

pub(super) const SUBJECT: Subject = Subject { name: "answer", sentences: SENTENCES, variants };

/// Number of readings of the zero crossings below which none can be checked against another: no statement on the valve.
const FEW: i64 = 3;

/// Share of the upper limit below which a most likely width is next to none, and not called probable.
const NEXT_TO_NONE: f64 = 0.1;

/// Whether the most likely width is next to none, for an upper limit.
pub(super) fn next_to_none(most: Option<f64>, high: Option<f64>) -> bool {
    most.zip(high).is_some_and(|(most, high)| most < NEXT_TO_NONE * high)
}

macro_rules! interval {
    () => {
        " ({low:number} to {high:number}, 95 %)"
    };
}
macro_rules! confirm {
    () => {
        "; confirm with a step test before work is ordered."
    };
}
macro_rules! or_test {
    () => {
        ", or make a step test in manual."
    };
}
macro_rules! closer {
    () => {
        "Record rows closer together than {apart:seconds}"
    };
}
macro_rules! calmer {
    () => {
        "Record while the setpoint moves or on a calmer day"
    };
}

const SENTENCES: &[(&str, &str)] = sentences! {
    // State of the valve.
    "so backlash": "The valve of {name} has a dead band of {width:op}{span}", interval!(), "{beside}.";
    "so backlash dead_band": "The valve of {name} has a dead band of {width:op}{span}", interval!(),
        " from packing or play{beside}.";
    "so backlash unsure":
        "The valve of {name} has a dead band of about {width:about}, but its width is uncertain{beside}.";
    "so stiction": "The valve of {name} sticks, then jumps by {jump:op}{beside}.";
    "so both": "The valve of {name} has a dead band of {width:op}{span}", interval!(),
        " and jumps by {jump:op}{beside}.";
    "so at_least": "The valve of {name} has a dead band of at least {low:op}{beside}.";
    "so likely":
        "The valve of {name} probably has a dead band of about {width:about} ({low:number} to {high:number}){beside}.";
    "so likely bound": "The valve of {name} probably has a dead band of at least {low:about}{beside}.";
    "so likely unsure": "The valve of {name} probably has a dead band, perhaps of about {width:about}, but its \
         width is uncertain{beside}.";
    "so likely dead_band": "The valve of {name} probably has a dead band of about {width:about} ({low:number} to \
         {high:number}) from packing or play{beside}.";
    "so likely stiction": "The valve of {name} probably sticks, then jumps by about {jump:about}{beside}.";
    "so sound": "The valve of {name} has no dead band wider than {high:op}.";
    "so none_seen": "{name} shows no dead band, but one of up to {high:about} would not show.";
    "so likely_sound": "The valve of {name} probably has no dead band wider than {percent:number}\u{a0}% of span.";
    "so oscillation": "{name} oscillates as a sine wave, and its valve is not the cause.";
    "so cannot_tell": "OP and PV of {name} do not show whether the valve has a dead band.";
    "so cannot_tell contradicts": "The valve position and PV of {name} contradict each other.";
    "so cannot_tell open": "The dead band of {name}, if it has one, is about {d:about}.";
    "so cannot_tell open bound":
        "The dead band of {name}, if it has one, is about {d:about}, at most {high:about}.";
    "so cannot_tell open weak":
        "The dead band of {name}, if it has one, is about {d:about} ({low:number} to {high:number}).";
    "so cannot_tell open up_to": "{name} shows no dead band, but one of up to {high:about} is not ruled out.";
    "so cannot_tell misfit": "No model of the loop explains PV of {name}.";
    "so cannot_tell coarse": "{name} may have a dead band of about {d:about}, but it is recorded too seldom to tell.";
    "so cannot_tell windows_disagree":
        "{name} may have a dead band of about {d:about}, but parts of the recording disagree.";
    "so cannot_tell windows_silent":
        "{name} may have a dead band of about {d:about}, but too few parts of the recording prove it.";
    "so cannot_tell cancelled":
        "A load that undoes what the valve of {name} does hides whether it has a dead band.";
    "so cannot_tell outweighed":
        "{name} may have a dead band of about {d:about}, but other evidence speaks against one.";
    "so cannot_tell recordings_disagree":
        "{name} may have a dead band of about {d:about}, but the recordings disagree.";
    "so cannot_tell still": "{name} may have a dead band of about {d:about}, but OP moves too little to tell.";
    "so cannot_tell once": "{name} may have a dead band of about {d:about}, but OP crosses it only once.";
    "so cannot_tell repeats":
        "{name} may have a dead band of about {d:about}, or a disturbance that comes with every swing.";
    "so cannot_tell swings": "{name} may have a dead band of about {d:about}, or a disturbance that swings.";
    "so cannot_tell lined": "{name} may have a dead band of about {d:about}, but the historian's compression hides it.";
    "so cannot_tell hidden_by_samples": "{name} shows no dead band, but it is recorded too seldom to show one.";
    "so cannot_tell hidden_by_lag": "{name} shows no dead band, but the recording is too short to be sure.";
    "so cannot_tell hidden_by_changes": "{name} shows no dead band, but changes of the load may hide one.";
    "so cannot_tell no_answer": "PV of {name} does not follow OP.";
    "so cannot_tell no_answer seldom": "PV of {name} does not follow OP, or is recorded too seldom to show it.";
    "so estimate": "The simple method reads a dead band of {width:op}{span} for {name}{beside}.";
    "so provisional": "The simple method reads {width:op}{span} for {name} so far{beside}.";
    "so provisional few":
        "The simple method has too few detections to judge the valve of {name}: they read {width:op}{span}.";
    "so no_estimate": "No dead band could be measured for {name}.";
    "so refused": "{name} was not analysed: {reason}.";
    // Clauses of it.
    "of_span": " ({percent:number}\u{a0}% of span)";
    "more_than_given": ", more than the {percent:number}\u{a0}% of span allowed";
    "more_than_nominal": ", more than the usual {percent:number}\u{a0}% of span";
    "up_from": ", up from {from:number} in {lasted:duration}";
    "down_from": ", down from {from:number} in {lasted:duration}";
    // Replace the verdict where a gap is likely, or one that matters is improbable.
    "likely": "Likely a gap";
    "likely_sound": "Likely sound";
    // The one width that a list shows, in OP units and in % of span.
    "headline": "{width:op}";
    "headline unsure": "about {width:about}";
    "headline at_least": "> {low:op}";
    "headline sound": "< {high:op}";
    "headline limits": "{low:number} to {high:op}";
    "headline interval": "{width:op} ({low:number} to {high:number})";
    // Width that a PLC would show.
    "plc": "{d_hat:op}";
    "plc above": "{d_hat:op}, too high";
    "plc below": "{d_hat:op}, too low";
    "plc sound": "{d_hat:op}, from noise or load";
    // Next step.
    "do correct": "Correct what is named, then analyse again.";
    "do inspect play": "Check linkage, keys and actuator for play", confirm!();
    "do inspect play tested": "Check linkage, keys and actuator for play.";
    "do inspect packing": "Check packing, seat and air supply", confirm!();
    "do inspect packing tested": "Check packing, seat and air supply.";
    "do inspect both": "Check the linkage for play, and the packing", confirm!();
    "do inspect both tested": "Check the linkage for play, and the packing.";
    "do inspect": "Check the valve, its linkage and its packing", confirm!();
    "do inspect likely": "Confirm with a step test.";
    "do further": "Record while OP moves further, or make a step test, to learn how wide it is.";
    "do record_more": "Record for longer while OP moves further", or_test!();
    "do record_more seldom": "Record a row every {enough:.3g} s or faster while OP moves", or_test!();
    "do record_more apart": closer!(), ", for longer and while OP moves further", or_test!();
    "do record_more coarse apart": closer!(), or_test!();
    "do record_more hidden_by_samples apart": closer!(), or_test!();
    "do record_more swings": calmer!(), or_test!();
    "do record_more repeats": calmer!(), or_test!();
    "do record_more hidden_by_changes": calmer!(), or_test!();
    "do record_more cancelled": "Record while the setpoint moves", or_test!();
    "do record_more windows_disagree": "Record while nothing is changed", or_test!();
    "do record_more recordings_disagree": "Leave out recordings from before work on the valve", or_test!();
    "do record_more misfit": "Check that this OP moves this PV and that PV is recorded unfiltered", or_test!();
    "do record_more lined": "Record PV without compression", or_test!();
    "do record_more outweighed": "Make a step test in manual, or record the valve's position.";
    "do record_more windows_silent": "Make a step test in manual, or record the valve's position.";
    "do left_out": "The fit of OP and PV was left out (--no-fit, fit=False), and may judge the valve: analyse again \
         with it.";
    "do tuning": "Check the tuning, or look for a disturbance from elsewhere.";
    "do tuning found":
        "The valve needs no work: all of it is within {percent:number}\u{a0}% of span. But the loop swings, as a dead \
         band can make it: check the tuning, or compensate the dead band.";
    "do nothing": "Nothing now.";
    "do review": "Nothing now; analyse again at the next review.";
    "do review likely_sound": "Nothing now; analyse again at the next review.";
    "do review given": "Nothing now: all of it is within the {percent:number}\u{a0}% of span allowed. Analyse again \
         at the next review.";
    "do review nominal":
        "Nothing now: all of it is within the usual {percent:number}\u{a0}% of span. Analyse again at the next review.";
    "do confirm": "Confirm with a step test in manual, then plan work on valve, linkage and positioner.";
    "do confirm tested": "Where it agrees, plan work on valve, linkage and positioner.";
    "do compare": "Compare with the acceptable limit of this valve; confirm with a step test before work is ordered.";
    "do compare tested": "Compare with the acceptable limit of this valve.";
    "do record_longer": "Record for longer, then analyse again.";
    "do probably_too_wide": "Probably too wide: record for longer, or confirm with a step test in manual.";
    "do step_test": "A step test in manual can judge the valve; this recording cannot.";
    "do tested": "Use the step test in this recording: it gives {d:op} ({low:number} to {high:number}).";
    // Next step, in a word or two.
    "short correct": "correct";
    "short inspect": "inspect";
    "short inspect likely": "step test";
    "short further": "record";
    "short record_more": "record";
    "short left_out": "fit";
    "short tuning": "tuning";
    "short nothing": "nothing";
    "short review": "nothing";
    "short confirm": "step test";
    "short compare": "compare";
    "short record_longer": "record";
    "short probably_too_wide": "record";
    "short step_test": "step test";
    "short remedy": "step test";
    "short tested": "read test";
    // Probability of a dead band.
    "probable": "gap probability {p_gap:share}";
    "probable beyond": "gap probability {p_gap:share}, wider than {percent:number}\u{a0}% of span {p_beyond:share}";
    "so probable": "{so} (gap probability {p_gap:share}).";
    // Why.
    "why counted": "{counted} of {all} recordings count.";
    "why crossings": "The simple method reads {d_hat:about}.";
    "why crossings above": "The simple method reads {d_hat:about}, too high; ignore it.";
    "why crossings below": "The simple method reads {d_hat:about}, too low; ignore it.";
    "why crossings sound": "The simple method reads {d_hat:about}, from noise or load; ignore it.";
    "why crossings none": "The simple method gives no width: {reason}.";
    "why probable": "The probability of a dead band is {p_gap:share}{beyond}, if {prior:share} of the plant's valves have one.";
    "why beyond": ", of one wider than {percent:number}\u{a0}% of span {p_beyond:share}";
    "why for": "For a dead band: {terms}.";
    "why against": "Against it: {terms}.";
    "why term": "{label} (odds × {times:number})";
    "why to_limit": "At this rate it reaches the limit in {days:.0f} days.";
    "why decided gap":
        "A step test made for this question shows a dead band of {d:op} ({low:number} to {high:number}).";
    "why decided at_least": "A step test made for this question shows a dead band of at least {low:op}.";
    "why decided no_gap": "A step test made for this question shows that there is none wider than {high:op}.";
    "why step_test": "The step test in this recording gives {d:op} ({low:number} to {high:number}).";
    // Evidence of a width by zero crossings.
    "crossed from": "This comes from {detections:count detection} in {half_periods:count half-period}.";
    "crossed provisional": "It is provisional: fewer than {n} detections stand behind it, and it may still move.";
    "crossed repeat": "The detections kept lie between {low:number} and {high:op}: that is how well they repeat, \
         not how near they are to the truth.";
    "crossed not_corrected": "Its known bias cannot be taken out: {reason}.";
    "crossed corrected": "With its known bias taken out it reads {d:op} ({low:number} to {high:number}){gain}: from \
         OP's travel from turn to turn{by} in {pairs:count pair} of half-periods.";
    "crossed gain": ", and with it a process gain of {kp:number} ({low:number} to {high:number})";
    "crossed worked_out": ", worked out by (4.1)";
    "crossed noise": "The noise limit is {floor:op}.";
    "crossed positioner": "The positioner's own dead band is set to {percent:number}\u{a0}%, which is part of it.";
    "crossed rejected": "The most frequent reason for rejection was “{label}” ({count} of {half_periods:count \
         half-period}): {meaning}.";
    "crossed no_proof": "This does not show that the valve is sound.";
    "crossed doubt": "Load changes can make the width read too high, so that even a sound valve shows a per cent or \
         two; small movements can make it read too low; stiction looks the same.";
    "crossed settle": "A step test in manual settles it.";
    // All loops in short.
    "run high": "{n:count valve}: act now.";
    "run tuning": "{n:count loop}: check the tuning.";
    "run medium": "{n:count valve}: check at the next round.";
    "run likely": "{n:count valve}: probably a dead band; a step test settles it.";
    "run within": "{n:count valve}: within the limit.";
    "run likely_within": "{n:count valve}: probably within the limit.";
    "run simple": "{n:count valve}: a width by the simple method alone, to be confirmed.";
    "run no_gap": "{n:count valve}: no dead band seen.";
    "run unknown": "{n:count loop}: cannot tell yet.";
    "run refused": "{n:count loop}: not analysed.";
    "run signal": "{n:count loop}: bad or missing signal.";
    "run calm": "Nothing is urgent.";
    "days": "Data of {first} to {last}.";
    "days one": "Data of {first}.";
    "basis": "{evidence} evidence";
    "basis none": "no evidence of a gap";
    "basis simple": "simple method alone";
};

fn variants(code: &str, n: &dyn Numbers) -> Vec<String> {
    match code {
        "days" if n.value("first") == n.value("last") => vec!["one".into()],
        "basis" if !n.has("evidence") => vec!["simple".into()],
        "basis" if n.word("evidence") == "none" => vec!["none".into()],
        _ => Vec::new(),
    }
}

/// The first of these codes that has a sentence.
fn first<'a>(codes: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    codes.into_iter().find(|code| SENTENCES.iter().any(|(known, _)| known == code))
}

/// State of the valve, in one sentence.
///
/// # Errors
/// Where the answer has a verdict that the catalogue does not know.
pub fn so(facts: &AnswerFacts, reader: &Reader) -> Result<String, TextError> {
    let (cause, kind) = (facts.cause.as_deref().unwrap_or_default(), facts.width_kind.as_deref().unwrap_or_default());
    let confidence = facts.confidence.as_deref().unwrap_or_default();
    let verdict = match confidence {
        "likely" | "likely_sound" | "none_seen" => confidence,
        _ => &facts.verdict,
    };
    let reason = facts.fit.as_ref().map_or("", |fit| &fit.why);
    let open = ["may_be_a_gap", "families_disagree"].contains(&reason);
    let contradicts = facts.fit.as_ref().and_then(|fit| fit.position.as_deref()) == Some("contradicts");
    let few = facts.crossings.detections < FEW;
    let most = facts.fit.as_ref().and_then(|fit| fit.d);
    let more = match verdict {
        "cannot_tell" if contradicts => vec!["contradicts"],
        "cannot_tell" if open && next_to_none(most, facts.high) => vec!["open up_to"],
        "cannot_tell" if open && facts.high.is_some() && facts.low > Some(0.0) => vec!["open weak"],
        "cannot_tell" if open && facts.high.is_some() => vec!["open bound"],
        "cannot_tell" if open => vec!["open"],
        "cannot_tell" if facts.enough.is_some() => vec!["no_answer seldom"],
        "cannot_tell" => vec![reason],
        "provisional" | "estimate" if few => vec!["few"],
        _ => vec![kind, cause],
    };
    let codes: Vec<String> =
        more.iter().filter(|word| !word.is_empty()).map(|word| format!("so {verdict} {word}")).collect();
    let plain = format!("so {verdict}");
    let code = first(codes.iter().map(String::as_str)).unwrap_or(&plain);
    let span = facts.width_percent_span.filter(|_| reader.op_unit != "%");
    let span = clause(span.map(|percent| Message::new("answer.of_span").with("percent", percent)));
    let reason = facts.crossings.reason.clone().unwrap_or_default();
    let message = facts.message(code).with("span", span).with("beside", beside(facts)).with("reason", bare(&reason));
    let message = text(&message.code, &message.numbers, reader)?;
    // A certain answer states itself; for an open one the planner chooses by the probability of a gap.
    match facts.p_gap.filter(|_| ["likely", "cannot_tell"].contains(&confidence)) {
        Some(p_gap) => {
            let more = Message::new("answer.so probable").with("so", bare(&message)).with("p_gap", p_gap);
            text(&more.code, &more.numbers, reader)
        }
        None => Ok(message),
    }
}

/// Limit that the width exceeds, or its change; empty where there is neither.
fn beside(facts: &AnswerFacts) -> Value {
    // The crossings alone also give sound valves more than the usual limit.
    let tells = |limit: &&Limit| facts.fitted() || limit.origin == "given";
    let beyond = facts.limit.as_ref().filter(|_| facts.acceptable.as_deref() == Some("beyond")).filter(tells);
    let percent = beyond.and_then(|limit| Some((limit.percent_span?, limit)));
    let beyond = percent.map(|(percent, limit)| {
        let code = if limit.origin == "nominal" { "answer.more_than_nominal" } else { "answer.more_than_given" };
        Message::new(code).with("percent", percent)
    });
    let changed = facts.trend.as_ref().and_then(|trend| {
        let code = match trend.code.as_str() {
            "grows" => "answer.up_from",
            "shrinks" => "answer.down_from",
            _ => return None,
        };
        let ((from, _), (first, last)) = (trend.d?, trend.t?);
        Some(Message::new(code).with("from", from).with("lasted", last - first))
    });
    Value::List([changed, beyond].into_iter().flatten().map(Value::from).collect())
}

/// A message as a clause of a sentence, empty where there is none.
fn clause(message: Option<Message>) -> Value {
    message.map_or(Value::Word("".into()), Value::from)
}

/// A text without its full stop: the sentence around it has its own.
fn bare(text: &str) -> String {
    text.strip_suffix('.').unwrap_or(text).into()
}

/// Next step, in one or two sentences: a step test that the recording holds is used, not advised.
///
/// # Errors
/// Where the answer has a next step that the catalogue does not know.
pub fn doing(facts: &AnswerFacts, reader: &Reader) -> Result<String, TextError> {
    let code = &facts.next.code;
    let of = facts.next.of.as_deref().unwrap_or_default();
    let test = facts.step_test.as_ref().filter(|test| test.d.is_some());
    let mut sentences = Vec::new();
    if let Some(test) = test.filter(|_| facts.next.tested) {
        let gives = Message::new("answer.do tested").with("d", test.d).with("low", test.low).with("high", test.high);
        sentences.push(text(&gives.code, &gives.numbers, reader)?);
        let left = [format!("do {code} {of} tested"), format!("do {code} tested")];
        if let Some(left) = first(left.iter().map(String::as_str)) {
            sentences.push(text(&format!("answer.{left}"), &facts.message("").numbers, reader)?);
        }
        return Ok(sentences.join(" "));
    }
    if left_out(facts) {
        return text("answer.do left_out", &facts.message("").numbers, reader);
    }
    if code == "remedy" {
        return text(&format!("half_period_remedy.{of}"), &facts.message("").numbers, reader);
    }
    let confidence = facts.confidence.as_deref().unwrap_or_default();
    let origin = facts.limit.as_ref().map_or("", |limit| &limit.origin);
    let why = facts.fit.as_ref().map_or("", |fit| &fit.why);
    let seldom = if facts.enough.is_some() { "seldom" } else { "" };
    let apart = if facts.apart.is_some() { "apart" } else { "" };
    let codes = [
        format!("do {code} {seldom}"),
        format!("do {code} {why} {apart}"),
        format!("do {code} {why}"),
        format!("do {code} {apart}"),
        format!("do {code} {confidence}"),
        format!("do {code} {of}"),
        format!("do {code} {origin}"),
        format!("do {code}"),
    ];
    let code = first(codes.iter().map(String::as_str)).unwrap_or(code);
    let message = facts.message(code);
    text(&message.code, &message.numbers, reader)
}

/// Whether the next step is the fit that nobody asked for: it costs less than what the crossings alone lead to.
fn left_out(facts: &AnswerFacts) -> bool {
    facts.fit_left_out && facts.fit.is_none() && !["correct", "review"].contains(&facts.next.code.as_str())
}

/// Next step, in a word or two.
fn short(facts: &AnswerFacts, reader: &Reader) -> Result<String, TextError> {
    let code = &facts.next.code;
    let asks = ["further", "record_more", "probably_too_wide", "step_test", "remedy"].contains(&code.as_str());
    let tested = asks && facts.next.tested;
    let confidence = facts.confidence.as_deref().unwrap_or_default();
    let codes = [format!("short {code} {confidence}"), format!("short {code}")];
    let code = if tested {
        "short tested"
    } else if left_out(facts) {
        "short left_out"
    } else {
        first(codes.iter().map(String::as_str)).unwrap_or(code)
    };
    text(&format!("answer.{code}"), &facts.message("").numbers, reader)
}

/// Reasons, a sentence each, with the numbers of the likelihood.
///
/// # Errors
/// Where the answer has a code that the catalogue does not know.
pub fn why(facts: &AnswerFacts, reader: &Reader) -> Result<Vec<String>, TextError> {
    // The sentence on the valve's state says it already.
    if facts.verdict == "refused" {
        return Ok(Vec::new());
    }
    let Some(fit) = facts.fit.as_ref().filter(|_| facts.fitted()) else {
        return crossed(facts, reader);
    };
    let tell = |message: Message| text(&message.code, &message.numbers, reader);
    let mut sentences = Vec::new();
    let decided = facts.step_test.as_ref().and_then(|test| Some((test, test.decided.as_ref()?)));
    if let Some((test, found)) = decided {
        let found = if found == "gap" && test.high.is_none() { "at_least" } else { found };
        let gives = facts.message(&format!("why decided {found}"));
        sentences.push(tell(gives.with("d", test.d).with("low", test.low).with("high", test.high))?);
    }
    sentences.push(sentence(&fit.reason));
    // After a test's decision the probability no longer matters.
    if decided.is_none() {
        sentences.extend(weighed(facts, reader)?);
    }
    if let Some((counted, all)) = fit.recordings.filter(|(_, all)| *all > 0) {
        let counts = facts.message("why counted").with("counted", Value::Count(counted)).with("all", Value::Count(all));
        sentences.push(tell(counts)?);
    }
    if let Some(days) = facts.trend.as_ref().and_then(|trend| trend.days_to_limit) {
        sentences.push(tell(facts.message("why to_limit").with("days", days))?);
    }
    if let Some(test) =
        facts.step_test.as_ref().filter(|test| test.d.is_some() && !facts.next.tested && test.decided.is_none())
    {
        let gives = facts.message("why step_test").with("d", test.d).with("low", test.low).with("high", test.high);
        sentences.push(tell(gives)?);
    }
    if facts.crossings.reason.as_ref() != Some(&fit.reason) {
        sentences.push(crossing(facts, reader)?);
    }
    Ok(sentences.into_iter().filter(|text| !text.is_empty()).collect())
}

/// Terms that move the odds by less than this factor are not named, nor more than so many on either side.
const SAYS_LITTLE: f64 = 1.15;
const MOST_TERMS: usize = 4;

/// Probability of a dead band, with the evidence for it and against it; nothing where no evidence was weighed.
fn weighed(facts: &AnswerFacts, reader: &Reader) -> Result<Vec<String>, TextError> {
    let (Some(p_gap), Some(prior)) = (facts.p_gap, facts.prior) else { return Ok(Vec::new()) };
    let tell = |message: Message| text(&message.code, &message.numbers, reader);
    let beyond = beyond(facts)
        .map(|(percent, p)| Message::new("answer.why beyond").with("percent", percent).with("p_beyond", p));
    let mut all = Vec::new();
    // For a certain dead band the ladder has answered; the evidence for it and against it still follows.
    if facts.confidence.as_deref() != Some("found") {
        let message = Message::new("answer.why probable").with("p_gap", p_gap).with("prior", prior);
        all.push(tell(message.with("beyond", clause(beyond)))?);
    }
    let mut terms: Vec<(&String, f64)> = facts.terms.iter().flatten().map(|(name, worth)| (name, *worth)).collect();
    terms.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    for (code, way) in [("answer.why for", 1.0), ("answer.why against", -1.0)] {
        let counts = terms.iter().filter(|(_, worth)| way * worth > SAYS_LITTLE.ln()).take(MOST_TERMS);
        let each = counts.map(|(name, worth)| {
            let label = text(&format!("term.{name}"), &Message::new("").numbers, reader)?;
            tell(Message::new("answer.why term").with("label", label).with("times", worth.exp()))
        });
        let each = each.collect::<Result<Vec<_>, _>>()?;
        if !each.is_empty() {
            all.push(tell(Message::new(code).with("terms", each.join(", ")))?);
        }
    }
    Ok(all)
}

/// The limit [% of span] and the probability of a dead band that is wider.
fn beyond(facts: &AnswerFacts) -> Option<(f64, f64)> {
    facts.limit_percent().zip(facts.p_beyond)
}

/// Probability of a dead band, in a few words; empty where no evidence was weighed.
fn probable(facts: &AnswerFacts, reader: &Reader) -> Result<String, TextError> {
    let Some(p_gap) = facts.p_gap else { return Ok(String::new()) };
    let message = match beyond(facts) {
        Some((percent, p)) => Message::new("answer.probable beyond").with("percent", percent).with("p_beyond", p),
        None => Message::new("answer.probable"),
    };
    let message = message.with("p_gap", p_gap);
    text(&message.code, &message.numbers, reader)
}

/// Result of the zero crossings next to a fit, in one line.
fn crossing(facts: &AnswerFacts, reader: &Reader) -> Result<String, TextError> {
    let code = match (&facts.struck, facts.crossings.d_hat, &facts.crossings.reason) {
        (Some(struck), _, _) => format!("why crossings {}", struck.code),
        (None, Some(_), _) => "why crossings".into(),
        (None, None, Some(_)) => "why crossings none".into(),
        (None, None, None) => return Ok(String::new()),
    };
    let message = facts.message(&code).with("reason", bare(facts.crossings.reason.as_deref().unwrap_or_default()));
    text(&message.code, &message.numbers, reader)
}

/// Evidence of a width by zero crossings, or the reason why there is none; paragraphs.
fn crossed(facts: &AnswerFacts, reader: &Reader) -> Result<Vec<String>, TextError> {
    let of = &facts.crossings;
    let halves = || Value::Count(of.half_periods);
    let tell = |message: Message| text(&message.code, &message.numbers, reader);
    let mut basis = Vec::new();
    if of.d_hat.is_none() {
        basis.push(sentence(of.reason.as_deref().unwrap_or_default()));
        if of.verdict == "refused" {
            return Ok(basis);
        }
        if of.detections == 0 {
            basis.push(tell(facts.message("crossed no_proof"))?);
        }
    } else {
        basis.push(tell(facts.message("crossed from").with("half_periods", halves()))?);
        if facts.struck.is_none() {
            if of.verdict == "provisional" {
                basis.push(tell(facts.message("crossed provisional").with("n", Value::Count(of.n)))?);
            }
            if let Some((low, high)) = of.repeatability.filter(|_| of.detections > 1) {
                basis.push(tell(facts.message("crossed repeat").with("low", low).with("high", high))?);
            }
            if let Some(corrected) = &of.corrected {
                basis.push(tell(unbiased(facts, corrected))?);
            }
            if let Some(floor) = of.noise_floor {
                basis.push(tell(facts.message("crossed noise").with("floor", floor))?);
            }
            if let Some(percent) = of.positioner {
                basis.push(tell(facts.message("crossed positioner").with("percent", percent))?);
            }
        }
    }
    let mut paragraphs = vec![basis.join(" ")];
    if let Some((reason, count)) = &of.rejected {
        let [label, meaning] = ["half_period", "half_period_meaning"].map(|of| Message::new(format!("{of}.{reason}")));
        let rejected = facts.message("crossed rejected").with("label", label).with("meaning", meaning);
        paragraphs.push(tell(rejected.with("count", Value::Count(*count)).with("half_periods", halves()))?);
    }
    if of.d_hat.is_some() && facts.struck.is_none() {
        let settle = if facts.step_test.is_some() { "why step_test" } else { "crossed settle" };
        let test = facts.step_test.clone().unwrap_or_default();
        let settle = facts.message(settle).with("d", test.d).with("low", test.low).with("high", test.high);
        paragraphs.push(format!("{} {}", tell(facts.message("crossed doubt"))?, tell(settle)?));
    }
    Ok(paragraphs.into_iter().filter(|text| !text.is_empty()).collect())
}

/// The crossings' width with its known bias taken out, or why it is not.
fn unbiased(facts: &AnswerFacts, of: &Corrected) -> Message {
    if of.d.is_none() {
        return facts.message("crossed not_corrected").with("reason", of.reason.clone().unwrap_or_default());
    }
    let gain = of
        .kp_range
        .map(|(low, high)| Message::new("answer.crossed gain").with("kp", of.kp).with("low", low).with("high", high));
    let by = (of.travel != "op").then(|| Message::new("answer.crossed worked_out"));
    facts
        .message("crossed corrected")
        .with("d", of.d)
        .with("low", of.low)
        .with("high", of.high)
        .with("pairs", Value::Count(of.pairs))
        .with("gain", clause(gain))
        .with("by", clause(by))
}

/// An answer in words.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AnswerTexts {
    /// State of the valve, in one sentence.
    pub so: String,
    /// Next step, in a sentence.
    #[serde(rename = "do")]
    pub doing: String,
    /// Next step, in a word or two.
    pub short: String,
    /// Why, a sentence each.
    pub why: Vec<String>,
    /// The one width that a list shows, with its interval; empty where nothing is known of it.
    pub headline: String,
    /// Probability of a dead band, in a few words; empty where no evidence was weighed.
    pub probable: String,
    /// Width in % of OP's span; empty where the span is not known, or the headline says it already.
    pub of_span: String,
    /// Width that a PLC would show.
    pub plc: String,
    /// Result of the zero crossings next to a fit, in one line.
    pub crossing: String,
    /// Evidence of the crossings, in paragraphs.
    pub crossed: Vec<String>,
}

/// All parts of an answer.
///
/// # Errors
/// Where the answer has a code that the catalogue does not know.
pub fn texts_of(facts: &AnswerFacts, reader: &Reader) -> Result<AnswerTexts, TextError> {
    Ok(AnswerTexts {
        so: so(facts, reader)?,
        doing: doing(facts, reader)?,
        short: short(facts, reader)?,
        why: why(facts, reader)?,
        headline: headline(facts, 1.0, reader)?,
        probable: probable(facts, reader)?,
        of_span: of_span(facts, reader)?,
        plc: plc(facts, reader)?,
        crossing: crossing(facts, reader)?,
        crossed: crossed(facts, reader)?,
    })
}

fn headline(facts: &AnswerFacts, scale: f64, reader: &Reader) -> Result<String, TextError> {
    let code = match (facts.verdict.as_str(), facts.width, facts.low, facts.high) {
        (_, None, None, None) => return Ok(String::new()),
        (_, Some(_), None, None) if facts.width_kind.as_deref() == Some("unsure") => "headline unsure",
        (_, _, None, None) => "headline",
        ("at_least", ..) | (_, Some(_), Some(_), None) => "headline at_least",
        ("sound", ..) => "headline sound",
        (_, None, ..) => "headline limits",
        _ => "headline interval",
    };
    let scaled = |x: Option<f64>| x.map(|x| scale * x);
    let message = facts.message(code).with("width", scaled(facts.width));
    let message = message.with("low", scaled(facts.low)).with("high", scaled(facts.high));
    text(&message.code, &message.numbers, reader)
}

fn of_span(facts: &AnswerFacts, reader: &Reader) -> Result<String, TextError> {
    let Some(span) = facts.span.filter(|span| !(reader.op_unit == "%" && *span == 100.0)) else {
        return Ok(String::new());
    };
    if facts.low.is_none() && facts.high.is_none() {
        return Ok(String::new());
    }
    headline(facts, 100.0 / span, &Reader { op_unit: "% of span".into(), ..reader.clone() })
}

fn plc(facts: &AnswerFacts, reader: &Reader) -> Result<String, TextError> {
    let code = facts.struck.as_ref().map_or("plc".into(), |struck| format!("plc {}", struck.code));
    let message = facts.message(&code);
    text(&message.code, &message.numbers, reader)
}

/// Facts of a loop that a run over many loops counts.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Headline {
    /// State of the valve.
    pub valve: String,
    /// Urgency.
    pub urgency: String,
    /// Next step.
    pub next: String,
    /// The width compared with the limit.
    pub acceptable: Option<String>,
}

/// Groups in which a run counts its loops, in the order in which they are shown.
const RUN: [&str; 10] =
    ["high", "tuning", "medium", "likely", "within", "simple", "no_gap", "likely_within", "unknown", "refused"];

impl Headline {
    /// The group of [`RUN`] in which the loop is counted.
    fn counts_as(&self) -> &'static str {
        match (self.valve.as_str(), self.urgency.as_str()) {
            ("refused", _) => "refused",
            (_, "high") => "high",
            _ if self.next == "tuning" => "tuning",
            ("gap", "medium") => "medium",
            ("gap", _) if self.acceptable.as_deref() == Some("within") => "within",
            ("gap", _) => "simple",
            ("no_gap", _) => "no_gap",
            ("unknown", "none") => "likely_within",
            ("unknown", _) if self.next == "confirm" => "likely",
            _ => "unknown",
        }
    }
}

/// Summary of a run: how many loops need which next step.
///
/// # Errors
/// None but a fault of the catalogue.
pub fn overview(run: &[Headline], reader: &Reader) -> Result<String, TextError> {
    let counted = RUN.map(|kind| (kind, run.iter().filter(|one| one.counts_as() == kind).count()));
    let tell =
        |code: &str, n: usize| text(&format!("answer.run {code}"), &Message::new("").with("n", n).numbers, reader);
    let mut sentences = Vec::new();
    if counted[..4].iter().all(|(_, n)| *n == 0) {
        sentences.push(tell("calm", 0)?);
    }
    for (kind, n) in counted.into_iter().filter(|(_, n)| *n > 0) {
        sentences.push(tell(kind, n)?);
    }
    Ok(sentences.join(" "))
}
