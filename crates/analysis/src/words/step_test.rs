//! Texts on a step test in the recording.

use super::{Subject, plain};

pub(super) const SUBJECT: Subject = Subject { name: "step_test", sentences: SENTENCES, variants: plain };

macro_rules! no_gain {
    () => {
        "no move goes on in the direction of one that {subject} answered, so the gain is not known; "
    };
}
macro_rules! twice {
    () => {
        "step twice one way, then back, beyond the gap each time"
    };
}
macro_rules! disagree {
    () => {
        "the readings disagree by more than noise and drift explain (F = {f:.3g}), and the interval is widened: the load moved \
         between holds, the process gain varies with OP, or the valve sticks and slips"
    };
}
macro_rules! larger {
    () => {
        "the gain may be 0; make larger steps, or hold for longer"
    };
}

const SENTENCES: &[(&str, &str)] = sentences! {
    // Why there is no width.
    "no_op": "OP was not recorded; the test is read off OP and PV";
    "no_mode": "no mode column tells when the loop was in manual; if it always was, say --manual";
    "never_manual": "the loop was never in manual; put it in manual, step OP twice one way and once back";
    "no_stretch": "no manual stretch of {rows} rows without gaps in time or in OP";
    "never_held": "OP was never held for {rows} rows in manual with a good {subject}";
    "one_value": "OP was held at one value only: in manual, step it twice one way and once back";
    "not_settled": "{subject} did not settle before the next step: only {settled} of {holds} holds last long enough \
         for it ({needed:.3g} s); hold OP for longer, or, if the process integrates (a level), say so: process = {{ \
         type = 'integrating' }}";
    "too_few_holds": "only {settled} holds last {rows} rows; hold OP for longer";
    "not_in_a_row": "fewer than three settled holds follow each other at different OP";
    "too_short": "the holds are too short to tell noise from drift; hold OP for longer";
    "unanswered_moves": "{subject} did not answer any move of OP, the largest of {largest:.3g} {unit}: make larger \
         ones, beyond the gap and {subject}'s noise";
    "no_gain": no_gain!(), twice!();
    "no_gain_unsettled": no_gain!(), "{unsettled} of {holds} holds ended before {subject} had settled; ", twice!();
    "gain_near_zero": "{subject} did not answer a second move in the same direction: ", larger!();
    "gain_near_zero_disagree": disagree!(), ": ", larger!();
    "no_reversal": "OP never reverses after a move that PV answered; step it back";
    "at_least": "{subject} did not answer the reversal of {reversal:.3g} {unit}: the gap is at least {at_least:.3g} \
         {unit}; step back further";
    // Notes.
    "first_holds": "the first {read} holds are used; {left} more follow";
    "disagree": disagree!();
    "reaches_zero": "the interval reaches 0: there may be no gap, or one of up to {high:.3g} {unit}";
    "positioner": "the positioner's own part of it, by its settings: {percent:.3g} % of travel";
    "positioner_of_span":
        "the positioner's own part of it, by its settings: {percent:.3g} % of travel, {width:.3g} {op_unit}";
    // Evidence of a reading, or the reason why there is none.
    "gain": "Δ{symbol}/ΔOP = {delta_pv:.3g} {pv_unit} / {delta_op:.3g} {unit}";
    "gap": "|ΔOP| − |Δ{symbol}|/|Kp| = {delta_op:.3g} − {delta_pv:.3g}/{kp:.3g} {unit}";
    "first_move": "first move: where in its gap the valve stood before it is not known";
    "turned": "OP turned between two holds without being held";
    "unanswered": "{subject} did not answer";
    "opposite": "{subject} went the other way: the load moved";
};
