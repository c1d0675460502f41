//! Texts on a fleet: reasons why a loop has no answer, remedies, and the summary.

use super::{Numbers, Subject, plain};

pub(super) const HINDRANCE: Subject = Subject { name: "hindrance", sentences: HINDRANCES, variants: plain };
pub(super) const HELP: Subject = Subject { name: "help", sentences: HELPS, variants: plain };
pub(super) const SUBJECT: Subject = Subject { name: "fleet", sentences: SENTENCES, variants };

const HINDRANCES: &[(&str, &str)] = sentences! {
    "no_op": "OP is not recorded";
    "compression": "The historian compresses PV or OP";
    "sampling": "Samples lie too far apart";
    "resolution": "PV or OP is recorded too coarsely";
    "manual": "The loop is not in automatic";
    "op_rests": "OP hardly moves";
    "load": "The load swings or steps as a gap would make it";
    "data": "The data cannot be used";
    "evidence": "A gap explains the data, and no gap would too";
};

const HELPS: &[(&str, &str)] = sentences! {
    "no_op": "Record OP as well as PV: without it only a step test can judge the valve.";
    "compression":
        "Switch compression and exception reporting off for these tags, or set their band to the last digit.";
    "sampling": "Record faster: five samples at least while PV answers OP.";
    "resolution": "Record with more digits, and narrow the collector's dead band.";
    "manual": "Make a step test, or ask why it is in manual.";
    "op_rests": "Keep a day with setpoint changes, or make a step test.";
    "load": "Keep calmer days or days with setpoint changes, make a step test, or record the valve's position.";
    "data": "See the problems of the lake, and the reason of each loop in the table loops.";
    "evidence": "Keep more days; a step test in manual settles it.";
};

const SENTENCES: &[(&str, &str)] = sentences! {
    "gaps": "{gaps} of {all:count valve} have a dead band, {beyond} of them wider than the limit.";
    "gaps within": "{gaps} of {all:count valve} have a dead band, none of them surely wider than the limit.";
    "gaps one": "1 of {all:count valve} has a dead band, wider than the limit.";
    "gaps one within": "1 of {all:count valve} has a dead band, not surely wider than the limit.";
    "gaps none": "No dead band was found in {all:count valve}.";
    "likely": "{n:count valve} probably have one.";
    "likely one": "1 valve probably has one.";
    "likely_sound": "{n} probably have none wider than the limit.";
    "likely_sound one": "1 probably has none wider than the limit.";
    "none": "{n} show none.";
    "none one": "1 shows none.";
    "unjudged": "{n} cannot be judged.";
    "first": "First: {names}.";
    "grows": "{n:count dead band} plainly grow.";
    "grows one": "1 dead band plainly grows.";
};

fn variants(code: &str, n: &dyn Numbers) -> Vec<String> {
    let [gaps, beyond, counted] = ["gaps", "beyond", "n"].map(|name| n.number(name));
    let variant = match (code, gaps, beyond) {
        ("gaps", Some(0.0), _) => "none",
        ("gaps", Some(1.0), Some(0.0)) => "one within",
        ("gaps", Some(1.0), _) => "one",
        ("gaps", _, Some(0.0)) => "within",
        _ if counted == Some(1.0) => "one",
        _ => "",
    };
    vec![variant.into()]
}
