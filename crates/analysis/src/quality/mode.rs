//! Mode, limits and a setpoint that moves.

use super::Finding;
use super::finding::{Fault, Severity};
use super::look::Look;

/// Share in manual beyond which a recording is mostly lost.
const MOSTLY_MANUAL: f64 = 0.5;
/// Shares at a limit: beyond the first many half-periods end there, beyond the second hardly one is left.
const LIMITED: (f64, f64) = (0.05, 0.95);
/// An operator moves SP now and then, a master controller at most samples.
const SLAVE: f64 = 0.5;

/// Findings on rows in manual.
pub(super) fn mode(look: &Look<'_>, found: &mut Vec<Finding>) {
    let c = look.statistics;
    if c.not_auto > 0 {
        let share = look.share(c.not_auto);
        let severity = if c.not_auto == c.rows {
            Severity::Refuse
        } else if share > MOSTLY_MANUAL {
            Severity::Warning
        } else {
            Severity::Info
        };
        found.push(Finding::new(Fault::NotAuto, severity).with("rows", c.not_auto).with("share", share));
    }
    let limited = c.at_low + c.at_high;
    if limited > 0 {
        let share = look.share(limited);
        let severity = if share > LIMITED.1 {
            Severity::Refuse
        } else if share > LIMITED.0 {
            Severity::Warning
        } else {
            Severity::Info
        };
        found.push(
            Finding::new(Fault::AtLimit, severity)
                .with("at_low", look.share(c.at_low))
                .with("at_high", look.share(c.at_high)),
        );
    }
}

/// Finding on a setpoint that another controller moves.
pub(super) fn setpoint(look: &Look<'_>, found: &mut Vec<Finding>) {
    if look.rows.sp.is_none() {
        return;
    }
    // Pairs that a historian repeated say nothing of SP.
    let pairs = look.statistics.rows as f64 - 1.0 - look.statistics.still as f64;
    let moved = look.statistics.sp.changed;
    let share = if pairs > 0.0 { moved as f64 / pairs } else { 0.0 };
    if share > SLAVE {
        found.push(Finding::new(Fault::CascadeSlave, Severity::Warning).with("sp_changes", moved).with("share", share));
    }
}
