//! Why the known bias of the crossings' width cannot be taken out.

use super::{Numbers, Subject};

pub(super) const SUBJECT: Subject = Subject { name: "not_corrected", sentences: SENTENCES, variants };

macro_rules! few {
    () => {
        "{pairs} pairs of half-periods in which PV came to rest off SP, where 3 are needed"
    };
}

const SENTENCES: &[(&str, &str)] = sentences! {
    "no_estimate": "there is no estimate to correct";
    "doubt too_few": few!();
    "doubt too_few no_gain": few!(), ", and 4 without the process gain";
    "doubt alike": "PV's half-periods are too much alike to tell the process gain and the width apart: give kp";
    "doubt wrong_slope": "OP travels less where PV swings further: not a gap in front of a process at rest";
    "doubt scattered": "the {pairs} pairs of half-periods do not agree: the load moves, or PV does not come to rest";
    "doubt": "the valve moves further than the gap is wide";
    "noise": "{d:op} is less than the {noise:.3g} that noise moves OP by";
    "smooth": "OP is not recorded, and PV filtered with {tf:.3g} s is too smooth to work out its turns by (4.1)";
    "integrating": "an integrating process does not come to rest off SP";
};

fn variants(code: &str, n: &dyn Numbers) -> Vec<String> {
    let doubt = n.word("doubt");
    match code {
        "doubt" if !n.has("kp") => vec![format!("{doubt} no_gain"), doubt],
        _ => vec![doubt],
    }
}
