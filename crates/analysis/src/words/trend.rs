//! Texts on the trend of the width.

use super::{Subject, plain};

pub(super) const SUBJECT: Subject = Subject { name: "trend", sentences: SENTENCES, variants: plain };

macro_rules! changed {
    ($verb:literal) => {
        concat!(
            "it ",
            $verb,
            " from {from:.3g} to {to:.3g} {unit} in {days:.3g} days, by {week:.2g} a week ({week_low:.2g} to {week_high:.2g})"
        )
    };
}

const SENTENCES: &[(&str, &str)] = sentences! {
    "grows": changed!("grew");
    "shrinks": changed!("shrank");
    "has_grown": "It has grown to this in {lasted:duration}.";
    "has_shrunk": "It has shrunk to this in {lasted:duration}.";
    "to_limit": "At this rate it reaches {limit:about} in {days:.0f} days.";
};
