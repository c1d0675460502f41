//! Signals that lie on a coarse grid.

use super::Finding;
use super::finding::{Fault, Severity};
use super::look::Look;

/// Steps in a signal's range: from the first on it is fine enough; below the second its steps dominate.
const LEVELS: (u64, u64) = (100, 20);

/// Findings on coarse steps of the signals.
pub(super) fn grids(look: &Look<'_>, found: &mut Vec<Finding>) {
    for (fault, grid) in [(Fault::QuantisedPv, look.pv_grid), (Fault::QuantisedOp, look.op_grid)] {
        let Some((step, levels)) = grid.filter(|(_, levels)| *levels < LEVELS.0) else { continue };
        let severity = if levels < LEVELS.1 { Severity::Warning } else { Severity::Info };
        found.push(Finding::new(fault, severity).with("step", step).with("levels", levels));
    }
}
