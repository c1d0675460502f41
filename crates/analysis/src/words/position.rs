//! Texts on the valve's own position: `position.` and the verdict.

use super::fit::copy;
use super::{Numbers, Subject};

pub(super) const SUBJECT: Subject = Subject { name: "position", sentences: SENTENCES, variants };

macro_rules! evidence {
    () => {
        "a gap explains the position clearly better (likelihood ratio {lr_no_gap:.0f}, {lr_needed:.0f} needed); the valve turned \
         {up} times up and {down} down"
    };
}
macro_rules! kept {
    () => {
        "; it was recorded only once it had moved by {step:.3g}, which may hide as much more. Record it as it is, without an \
         exception band"
    };
}
macro_rules! told {
    ($($name:literal, $text:expr;)*) => {
        &[
            $(($name, $text), (concat!($name, " kept"), concat!($text, kept!())),)*
            ("cannot_tell copy", copy!()),
            (
                "cannot_tell no_answer",
                "the position does not follow OP, which explains {explained:share} of it: is it that of the valve that this OP moves?",
            ),
        ]
    };
}

const SENTENCES: &[(&str, &str)] = told! {
    "backlash", concat!("dead band of {d:op}: ", evidence!());
    "stiction", concat!("the valve sticks and jumps by {jump:op}, without a gap: ", evidence!());
    "both", concat!("dead band of {d:op}, and jumps of {jump:op}: ", evidence!());
    "at_least", concat!("dead band of at least {low:op}: ", evidence!(), ", too seldom to tell how much wider it is");
    "sound", "no dead band wider than {high:op} (95 %): the position follows each turn of OP";
    "cannot_tell", "any gap explains the position, and none would too";
    "cannot_tell bound", "a gap of up to {high:op} explains the position, and none would too";
};

fn variants(code: &str, n: &dyn Numbers) -> Vec<String> {
    let kept = if n.word("recorder") == "kept" { "kept" } else { "" };
    let bound = if n.has("high") { "bound" } else { "" };
    match code {
        "cannot_tell" => vec![n.word("reason"), format!("{bound} {kept}").trim().into(), bound.into()],
        _ => vec![kept.into()],
    }
}
