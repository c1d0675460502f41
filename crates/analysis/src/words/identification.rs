//! Why the controller's law cannot be used unasked, and how it was found.

use super::{Numbers, Subject};

pub(super) const SUBJECT: Subject = Subject { name: "identification", sentences: SENTENCES, variants };

const SENTENCES: &[(&str, &str)] = sentences! {
    "no_op": "the recording has no OP, so K and Ti must be given";
    "no_sp": "the recording has no SP, so K and Ti must be given";
    "no_value": "{signal} has no value in any row, so K and Ti must be given: check the column or tag";
    "few_steps none": "no step between samples is in auto, good, off the limits and without a gap: give K and Ti, or a \
         recording in auto";
    "few_steps": "only {samples} steps between samples are in auto, good, off the limits and without a gap; at \
         least 50 are needed: give K and Ti, or a longer recording in auto";
    "op_still": "OP never moves in automatic, so K and Ti cannot be found: give them";
    "pv_still": "PV never moves in automatic, so K and Ti cannot be found: give them";
    "unshown":
        "proportional and integral action cannot be told apart in OP (a single step, a ramp?): give K and Ti";
    "little_explained": "no PI or PID law explains enough of OP's moves (R² {r2:.3g}, needed 0.9): give K and Ti, \
         or take a recording in auto that is neither compressed nor averaged";
    "no_gain": "K may be 0 ({k:.3g} +- {error:.2g} OP units per PV unit): give K and Ti";
    "gain_may_be_none": "K may be 0 ({size:.3g}, {k_low:.3g} to {k_high:.3g}): give K and Ti";
    "no_integral": "there may be no integral action: give K and Ti";
    "opposite_signs": "K and K/Ti have opposite signs (Ti {ti:.3g} s), so this is no PI controller: give K and Ti";
    "contradictory": "laws that explain OP equally well contradict each other even in the sign of K: give K and Ti";
    "wide": "K may be {k_low:.3g} to {k_high:.3g} and Ti {ti_low:.3g} to {ti_high:.3g} s, since laws with and \
         without filter, D part and delay explain OP as well: give K and Ti, or record more often than every \
         {h:.3g} s, with more digits, or while the setpoint moves";
    "no_fit": "no fit";
    "law": "robust fit of a PI law to means of {m} samples ({span:.4g} s)";
    "law derivative": "robust fit of a PID law to means of {m} samples ({span:.4g} s)";
    "filter": "the controller filters PV, which is recorded unfiltered ({order} x Tf {tf:.3g} s)";
    "derivative_filter": "its D part is filtered (Tf {tfd:.3g} s)";
    "late": "OP recorded one sample late";
    "early": "OP recorded one sample early";
    "derivative_open": "lengths of the means disagree whether there is a D part";
    "derivative_hidden": "a D part of up to {td_high:.3g} s behind a filter would explain OP as well";
    "weight": "setpoint weight {fitted:.2f} ({low:.2f} to {high:.2f}) fitted";
};

fn variants(code: &str, n: &dyn Numbers) -> Vec<String> {
    let variant = match code {
        "law" if n.flag("derivative") => "derivative",
        "few_steps" if n.number("samples") == Some(0.0) => "none",
        _ => "",
    };
    vec![variant.into()]
}
