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
    for (name, values) in sp.into_iter().chain([("PV", c.pv), ("OP", c.op)]) {
        let none_left = values.bad + values.marked.count == c.rows;
        let marked = (Fault::BadQuality, values.marked.count, values.marked.first);
        for (fault, rows, first) in [(Fault::NotANumber, values.bad, values.bad_first), marked] {
            if rows == 0 {
                continue;
            }
            let share = look.share(rows);
            // Without OP much can still be told.
            let severity = match (none_left, name) {
                (true, "OP") => Severity::Warning,
                (true, _) => Severity::Refuse,
                (false, _) => many(share),
            };
            found.push(
                Finding::new(fault, severity)
                    .with("signal", name)
                    .with("rows", rows)
                    .with("share", share)
                    .with("first_row", first)
                    .telling("of", c.rows),
            );
        }
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
