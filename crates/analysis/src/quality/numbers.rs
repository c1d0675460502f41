//! Values that are none, and signals that say nothing.

use super::Finding;
use super::finding::{Fault, Severity};
use super::look::{Look, count, span};

/// Share of missing values beyond which many half-periods end.
const MANY: f64 = 0.01;
/// Fewer rows are equal by chance, as when PV rests on SP.
const FEWEST_COMPARED: usize = 10;
/// Two signals that agree to the bit in more of their rows are one; a few rows that differ do not hide it.
const SAME: f64 = 0.99;

/// Findings on values that are missing, bad or no numbers.
pub(super) fn numbers(look: &Look<'_>, found: &mut Vec<Finding>) {
    let c = look.statistics;
    if c.rows == 0 {
        return;
    }
    let sp = look.rows.sp.map(|_| ("SP", c.sp));
    for (name, values) in sp.into_iter().chain([("PV", c.pv), ("OP", c.op)]).filter(|(_, values)| values.bad > 0) {
        let share = look.share(values.bad);
        // Without OP much can still be told.
        let severity = match (values.bad == c.rows, name) {
            (true, "OP") => Severity::Warning,
            (true, _) => Severity::Refuse,
            (false, _) => many(share),
        };
        found.push(
            Finding::new(Fault::NotANumber, severity)
                .with("signal", name)
                .with("rows", values.bad)
                .with("share", share)
                .with("first_row", values.bad_first)
                .telling("of", c.rows),
        );
    }
    if c.bad_quality > 0 {
        let share = look.share(c.bad_quality);
        let severity = if c.bad_quality == c.rows { Severity::Refuse } else { many(share) };
        found.push(Finding::new(Fault::BadQuality, severity).with("rows", c.bad_quality).with("share", share));
    }
}

/// Severity of a share of bad values.
fn many(share: f64) -> Severity {
    if share > MANY { Severity::Warning } else { Severity::Info }
}

/// Findings on a missing SP or OP, and on signals that do not move.
pub(super) fn constants(look: &Look<'_>, found: &mut Vec<Finding>) {
    let c = look.statistics;
    if look.rows.sp.is_none() {
        found.push(Finding::new(Fault::NoSp, Severity::Info));
    }
    if look.rows.op.is_none() {
        found.push(Finding::new(Fault::NoOp, Severity::Info));
    }
    for (fault, name, values) in [(Fault::OpConstant, "op", c.op), (Fault::PvConstant, "pv", c.pv)] {
        if c.rows >= 2 && values.low == values.high {
            found.push(Finding::new(fault, Severity::Refuse).with(name, values.low));
        }
    }
    for (signals, other) in [("PV, OP", look.rows.op), ("PV, SP", look.rows.sp)] {
        let Some(other) = other else { continue };
        let both = other.iter().zip(look.rows.pv).filter(|(other, pv)| other.is_finite() && pv.is_finite());
        let (all, same) = (both.clone().count(), count(both.clone().map(|(other, pv)| other == pv)));
        if all >= FEWEST_COMPARED && same as f64 / all as f64 > SAME && span(both.map(|(_, pv)| *pv)) > 0.0 {
            found.push(Finding::new(Fault::SameSignal, Severity::Refuse).with("signals", signals));
        }
    }
}
