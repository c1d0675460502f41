//! Texts on the source of a detector's setting.

use super::{Numbers, Subject};

pub(super) const SUBJECT: Subject = Subject { name: "setting", sentences: SENTENCES, variants };

const SENTENCES: &[(&str, &str)] = sentences! {
    "delta_u integral": "K/Ti·∫|e|dt (7.5)";
    "delta_u derivative": "K/Ti·∫|e|dt with the derivative part (7.6)";
    "delta_u op": "OP's own travel";
    "tf chosen": "smallest of {tried} that serves";
    "td no_derivative": "PI law identified";
    "b assumed": "no setpoint change to tell it by";
    "kp assumed": "not given, taken as {kp} %/%";
    "kp fitted": "fitted from OP and PV ({low:.3g} to {high:.3g})";
    "kp integrating": "integrating process: no static gain, its term is dropped";
    "kp unknown": "not known: its term is dropped, the estimate is high by Δy/Kp";
    "identified": "identified (R² {r2:.3f})";
    "given": "given";
};

fn variants(_: &str, n: &dyn Numbers) -> Vec<String> {
    vec![n.word("origin")]
}
