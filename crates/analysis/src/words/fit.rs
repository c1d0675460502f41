//! Texts on the valve by OP and PV: `fit.` and the verdict, worded by the reason; `unfit.` why nothing was fitted;
//! `left_out.` why a recording does not count in the joint answer.

use super::answer::next_to_none;
use super::{Numbers, Subject, plain};

pub(super) const SUBJECT: Subject = Subject { name: "fit", sentences: SENTENCES, variants };
pub(super) const UNFIT: Subject = Subject { name: "unfit", sentences: UNFIT_SENTENCES, variants: of_position };
pub(super) const LEFT_OUT: Subject = Subject { name: "left_out", sentences: LEFT_OUT_SENTENCES, variants: plain };

/// The position is that of no sensor.
macro_rules! copy {
    () => {
        "the position equals OP in every row to the last digit, as no sensor's does: it is what was demanded of the valve, not \
         where it stands. Record the positioner's feedback"
    };
}
pub(super) use copy;

macro_rules! evidence {
    () => {
        "a gap explains the data clearly better (likelihood ratio {lr_no_gap:.0f}, {lr_needed:.0f} needed)"
    };
}
macro_rules! often {
    () => {
        "; OP crossed it {up:times} up and {down:times} down"
    };
}
macro_rules! would {
    () => {
        "a gap of {d:op} fits best, but "
    };
}
macro_rules! weak {
    () => {
        "the evidence for it is too weak (likelihood ratio {lr_no_gap:.0f}, {lr_needed:.0f} needed)"
    };
}
macro_rules! longer {
    () => {
        ". Record for longer, or while OP moves further"
    };
}
macro_rules! serviced {
    () => {
        ". Was the valve serviced between them, or are they of more than one valve?"
    };
}

const SENTENCES: &[(&str, &str)] = sentences! {
    "backlash": "dead band of {d:op}: ", evidence!(), often!();
    "backlash gap_and_more": "dead band of {d:op}: ", evidence!(), often!(),
        "; where the valve turns, PV strays from what a gap alone would do";
    "stiction": "the valve sticks and jumps by {jump:op}, without a gap: ", evidence!(), often!();
    "both": "dead band of {d:op}, and jumps of {jump:op}: ", evidence!(),
        ", and a gap without jumps less well (by {lr_no_jump:.0f})", often!();
    "at_least": "dead band of at least {low:op}: ", evidence!(), often!(),
        ", not far enough to tell how much wider it is. Record while OP moves further";
    "sound": "no dead band wider than {high:op} (95 %): PV answers each turn of OP";
    "cannot_tell misfit": "no model of the loop fits PV: its errors follow each other (correlation {echo:.2f}). Is \
         PV what this OP moves, and recorded as it was measured?";
    "cannot_tell coarse": would!(), "samples {h:.3g} s apart do not show what OP does between them: the process \
         lags by {settles:.3g} s, and 5 samples are needed in that. Record faster";
    "cannot_tell windows_disagree": would!(), "parts of the recording differ {dispersion:.0f} times more than \
         chance allows. Take a time in which nothing was changed";
    "cannot_tell windows_silent": would!(),
        "too few parts of the recording prove it by themselves. Make a step test, or record the valve's position";
    "cannot_tell outweighed": would!(), "all evidence together makes a gap less probable than its likelihood ratio \
         says ({lr_no_gap:.0f}, {lr_needed:.0f} needed). Make a step test, or record the valve's position";
    "cannot_tell recordings_disagree": would!(), "the recordings disagree", serviced!();
    "cannot_tell recordings_disagree shared": would!(),
        "the recordings disagree {dispersion:.0f} times more than chance allows", serviced!();
    "cannot_tell still": would!(), "the valve would hardly move then, and a few steps of PV explain the data as \
         well. Record while OP moves further";
    "cannot_tell cancelled": "a load that undoes what the valve does hides whether it has a gap. Record while the setpoint \
         moves, or make a step test";
    "cannot_tell once": would!(), "OP crosses it in one direction only, once", longer!();
    "cannot_tell repeats": would!(), "a disturbance with the period of this loop explains the data as well. Look \
         for what else swings there, or record while the setpoint moves, on calmer days, or with the valve's \
         position";
    "cannot_tell swings": would!(), "OP swings almost evenly, as a swinging disturbance makes it and this gap does \
         not. Record while the setpoint moves or on calmer days, make a step test, or record the valve's position";
    "cannot_tell opposed": "a gap of {d:op} fits best, and PV moves against OP while OP crosses it, as where the valve \
         stands. But a disturbance that swings explains the data nearly as well, and part of the width may be its. Make \
         a step test, or record the valve's position";
    "cannot_tell lined": would!(), "the historian kept only corners of PV and joined them by lines, which looks the \
         same. Record without compression";
    "cannot_tell hidden_by_samples": "no gap shows, but samples {h:.3g} s apart would not show one: the process \
         settles in {settles:.3g} s, and 4 samples are needed in that. Record faster, and PV before any filter";
    "cannot_tell hidden_by_lag":
        "no gap shows, but only with a lag of {lag:.3g} s, which is longer than the recording. Record for longer";
    "cannot_tell hidden_by_changes": "no gap shows, but {load_steps:count change} of the load may hide one: OP \
         turned no more often than the load. Record while the setpoint moves, or on calmer days";
    "cannot_tell no_answer": "PV does not follow OP: a process at rest explains PV as well (likelihood ratio \
         {lr_no_answer:.0f}). Record while OP moves";
    "cannot_tell no_answer seldom": "PV does not follow OP: a process at rest explains PV as well (likelihood ratio \
         {lr_no_answer:.0f}). Rows {h:.3g} s apart may be why: the error is another one at each row, as where the \
         process settles between two of them. Record a row every {enough:.3g} s or faster, while OP moves";
    "cannot_tell may_be": would!(), weak!(), longer!();
    "cannot_tell may_be bound": "a gap of {d:op} fits best (at most {high:op}), but ", weak!(), longer!();
    "cannot_tell families_disagree": would!(), "other models of the loop explain the data nearly as well with a far \
         narrower one", longer!();
    "cannot_tell as_well": "a valve without a gap explains the data as well as one with {d:op}", longer!();
    "cannot_tell as_well none": "a valve without a gap explains the data best, and one of up to {high:op} is not ruled out",
        longer!();
    "cannot_tell as_well bound":
        "a valve without a gap explains the data as well as one with {d:op}; at most {high:.3g}",
        longer!();
    "op_rests": "OP stands still all the time, and only an OP that moves shows a gap";
    "sinusoidal": "{finding}";
    // Texts on the valve's own position.
    "silent": "{pv}. The valve's position tells nothing: {position}";
    "bounds": "{pv}. By the valve's position {position}";
    "settles": "read from the valve's position: {position}";
    "settles positioner": "read from the valve's position: {position}; the positioner's own part of it, by its \
         settings: {own:.3g} % of travel";
    "contradicts": "the valve's position and PV contradict each other. The position: {position}. PV: {pv}";
    "contradicts cannot_tell": "the valve's position and PV contradict each other. The position: {position}. PV: \
         {pv}. Is the sensor coupled firmly to the valve, and the valve to what it moves?";
    "changed": "{said}; {trend}";
    // Texts on several recordings.
    "recordings all": "by {counted} recordings together: {said}";
    "recordings alone": "by {alone} alone, of {all} recordings: {said}";
    "recordings": "by {counted} of {all} recordings together: {said}";
    "not_counted": "Not counted, since {why}: {names}";
    "repeated": "{share:share} of {name} is in an earlier recording too, and counts there";
    "no_recording": "none of {all} recordings tells: {said}";
    "more": "Where the valve turns, PV strays from what a gap alone would do: the valve may stick as well.";
};

/// Likelihood ratio from which a valve without a gap lies outside of a 95 % interval, if the model is right.
const EXCLUDED: f64 = 3.84;

fn variants(code: &str, n: &dyn Numbers) -> Vec<String> {
    let reason = n.word("reason");
    match code {
        "cannot_tell" => {
            let shared = if n.flag("shared") { "shared" } else { "" };
            let none_fits = n.number("lr_no_gap").is_some_and(|ratio| ratio < EXCLUDED);
            let open = if none_fits { "as_well" } else { "may_be" };
            let bound = match () {
                _ if none_fits && next_to_none(n.number("d"), n.number("high")) => " none",
                _ if n.has("high") => " bound",
                _ => "",
            };
            let seldom = if n.has("enough") { "seldom" } else { "" };
            vec![
                format!("{reason} {seldom}"),
                format!("{reason} {shared}"),
                reason,
                format!("{open}{bound}"),
                open.into(),
            ]
        }
        "settles" if n.has("own") => vec!["positioner".into()],
        "contradicts" => vec![n.word("verdict")],
        "recordings" if n.has("alone") => vec!["alone".into()],
        "recordings" if n.number("counted") == n.number("all") => vec!["all".into()],
        _ => vec![reason],
    }
}

const UNFIT_SENTENCES: &[(&str, &str)] = sentences! {
    "no_op": "there is no OP, and the width cannot be fitted without it";
    "few_rows": "{number:.0f} rows are too few: a fit needs 50 samples at least";
    "op_missing": "OP has a value in fewer than 50 rows, and the width cannot be fitted without it";
    "op_still": "OP stands still at {number:.4g} all the time, and only an OP that moves shows a gap";
    "same": "OP and {signal} are the same signal: check which columns were taken";
    "pv_still": "{signal} stands still at {number:.4g} all the time";
    "coarse": "OP takes only {number:.0f} values: it is recorded too coarsely";
    "broken": "there are no 20 samples in a row without a gap in time";
    "copy": copy!();
    "few position": "fewer than 50 rows have a position";
    "few": "there are no 50 samples in a row in which OP moves";
};

fn of_position(_: &str, n: &dyn Numbers) -> Vec<String> {
    vec![if n.word("signal") == "PV" { String::new() } else { "position".into() }]
}

const LEFT_OUT_SENTENCES: &[(&str, &str)] = sentences! {
    "misfit": "no model fits it";
    "no_answer": "PV does not follow OP";
    "coarse": "it is sampled too seldom";
    "swings": "OP swings almost evenly, as a disturbance may make it";
    "lined": "the historian joined PV by lines, which bend as much as a gap would make them";
    "still": "the valve would hardly move";
    "windows_disagree": "its parts disagree";
    "windows_silent": "too few of its parts prove a gap by themselves";
};
