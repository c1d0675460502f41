//! Words that stand alone: verdicts, state of the valve, urgency, strength of the evidence.

use super::{Subject, plain};

pub(super) const VERDICT: Subject = Subject { name: "verdict", sentences: VERDICTS, variants: plain };
pub(super) const VALVE: Subject = Subject { name: "valve", sentences: VALVES, variants: plain };
pub(super) const URGENCY: Subject = Subject { name: "urgency", sentences: URGENCIES, variants: plain };
pub(super) const EVIDENCE: Subject = Subject { name: "evidence", sentences: STRENGTHS, variants: plain };
pub(super) const MEANING: Subject = Subject { name: "meaning", sentences: MEANINGS, variants: plain };

pub(super) const TERM: Subject = Subject { name: "term", sentences: TERMS, variants: plain };

/// Names of the evidence for a dead band or against it.
const TERMS: &[(&str, &str)] = sentences! {
    "likelihood": "how much better a gap explains PV than none";
    "traversals": "how often OP crossed the gap";
    "width": "how wide the gap is compared with OP's range";
    "noise": "how far the gap moves PV compared with its noise";
    "limit": "how closely the width is known";
    "plateau": "whether PV stands still while OP crosses the gap";
    "process": "how far a load undoes what the valve does";
    "rules": "the fixed tests of the fit";
};

/// The one verdict of a loop. The last four are those of the zero crossings, where nothing was fitted.
const VERDICTS: &[(&str, &str)] = sentences! {
    "backlash": "Backlash";
    "stiction": "Stiction";
    "both": "Backlash and stiction";
    "at_least": "At least";
    "oscillation": "Oscillation";
    "sound": "Sound";
    "cannot_tell": "Cannot tell";
    "estimate": "Estimate";
    "provisional": "Provisional";
    "no_estimate": "No estimate";
    "refused": "Refused";
};

const VALVES: &[(&str, &str)] =
    &[("gap", "Gap found"), ("no_gap", "No gap shown"), ("unknown", "Cannot tell"), ("refused", "Refused")];

const URGENCIES: &[(&str, &str)] = &[("high", "Now"), ("medium", "Next round"), ("low", "Later"), ("none", "Not now")];

const STRENGTHS: &[(&str, &str)] =
    &[("none", "none"), ("weak", "weak"), ("strong", "strong"), ("very_strong", "very strong")];

/// Meaning of each verdict, and of what is shown in its place.
const MEANINGS: &[(&str, &str)] = sentences! {
    "backlash": "OP and PV show a gap and its width. The valve does not follow OP until OP has crossed it.";
    "stiction": "The valve sticks and then jumps. It has no gap.";
    "both": "There is a gap, and the valve jumps when it breaks loose.";
    "at_least": "There is a gap, and only a lower limit of its width: OP did not move far enough.";
    "likely": "There is probably a gap. A step test confirms it before work is planned.";
    "likely_sound": "A gap wider than is acceptable is improbable.";
    "sound": "No gap wider than the limit that is given. A narrower one may be there.";
    "oscillation": "The loop oscillates as a sine wave, and its valve is not the cause. A gap, if there is one, does not show.";
    "cannot_tell":
        "A valve with a gap explains the data, and one without a gap does too; or no model does. It does not mean \
         that all is well.";
    "estimate": "Nothing was fitted. At least N detections of the zero crossings stand behind the width.";
    "provisional": "Nothing was fitted. Fewer than N detections stand behind the width, and it may still move.";
    "no_estimate": "Nothing was fitted, and no half-period could be measured.";
    "refused": "Data or settings do not allow an analysis. The reason is named.";
};
