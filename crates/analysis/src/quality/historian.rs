//! Effects of a historian or transmitter on the signals: frozen, held or interpolated; spikes and shifts.

use super::Finding;
use super::finding::{Fault, Severity};
use super::look::{Look, count, span};
use crate::{FROZEN_STEPS, in_runs};

/// Fewer steps have no shares.
const FEWEST_STEPS: usize = 20;
/// Stretches that repeat are left out; a smaller share of them changes nothing.
const FROZEN: f64 = 0.02;
/// A PV at rest repeats its value too: only where it does so for most of the time was it held.
const HELD: f64 = 0.5;
/// Two of three samples on one line happen by chance; never so large a share.
const STRAIGHT: f64 = 0.2;
/// Two moves in a row are on a line where they differ by less than this share of the move, and by less than rounding.
const LINE: (f64, f64) = (1e-6, 4e-16);
/// A move below this share of PV itself is rounding, and has no shape.
const ROUNDING: f64 = 1e-12;
/// Samples in a row that continue a line.
const ON_A_LINE: usize = 2;

/// A larger share of spikes takes half-periods and moves OP.
const SPIKES: f64 = 0.001;
/// Rows that are named.
const NAMED: usize = 5;

/// Samples that stand alone; the fit leaves them out, the crossings do not.
pub(super) fn spikes(look: &Look<'_>, found: &mut Vec<Finding>) {
    let spikes = glapp_fit::spikes(look.rows.pv);
    let Some(first) = spikes.first() else { return };
    let share = spikes.len() as f64 / look.rows.pv.len() as f64;
    let severity = if share > SPIKES { Severity::Warning } else { Severity::Info };
    found.push(
        Finding::new(Fault::Spikes, severity)
            .with("count", spikes.len() as u64)
            .with("share", share)
            .with("first_row", *first as u64)
            .with("rows", named(&spikes)),
    );
}

/// Rows from which PV stands on another level; the fit begins anew there, the crossings do not.
pub(super) fn shifts(look: &Look<'_>, found: &mut Vec<Finding>) {
    let Some(op) = look.rows.op else { return };
    let shifts = glapp_fit::shifts(look.rows.pv, op);
    let Some(first) = shifts.first() else { return };
    found.push(
        Finding::new(Fault::Shifts, Severity::Warning)
            .with("count", shifts.len() as u64)
            .with("first_row", *first as u64)
            .with("rows", named(&shifts)),
    );
}

/// The first of these rows.
fn named(rows: &[usize]) -> String {
    rows.iter().take(NAMED).map(usize::to_string).collect::<Vec<_>>().join(" ")
}

/// Findings on frozen, held and interpolated signals, spikes and shifts.
pub(super) fn historian(look: &Look<'_>, found: &mut Vec<Finding>) {
    let (t, pv) = (look.rows.t, look.rows.pv);
    let steps = count(look.step.iter().copied());
    if steps < FEWEST_STEPS {
        return;
    }
    let share = |count: usize| count as f64 / steps as f64;
    let frozen = share(count(look.step.iter().zip(&look.frozen).map(|(step, frozen)| *step && *frozen)));
    if frozen > FROZEN {
        found.push(Finding::new(Fault::Frozen, Severity::Warning).with("share", frozen));
    }
    let good = pv.iter().zip(&look.good).filter(|(_, good)| **good).map(|(pv, _)| *pv);
    // Equal steps on a coarse grid look like straight lines and like holds.
    if look.pv_grid.is_some() || span(good) == 0.0 {
        return;
    }
    let moved = |k: usize| pv[k + 1] - pv[k];
    let slope = |k: usize| moved(k) / (t[k + 1] - t[k]);
    let flat: Vec<bool> = (0..look.step.len())
        .map(|k| look.live(k) && moved(k) == 0.0 && look.rows.op.is_none_or(|op| op[k + 1] != op[k]))
        .collect();
    let straight: Vec<bool> = (1..look.step.len())
        .map(|k| {
            let (size, dpv) = (pv[k + 1].abs() + pv[k - 1].abs(), moved(k).abs());
            look.live(k)
                && look.live(k - 1)
                && dpv > ROUNDING * size
                && (slope(k) - slope(k - 1)).abs() * look.h <= LINE.0 * dpv + LINE.1 * size
        })
        .collect();
    let held = share(count(in_runs(&flat, FROZEN_STEPS)));
    let lines = share(count(in_runs(&straight, ON_A_LINE)));
    if held > HELD || lines > STRAIGHT {
        found.push(
            Finding::new(Fault::CompressedPv, Severity::Warning)
                .with("held", held)
                .with("straight", lines)
                .telling("looks_like", if held > HELD { "held" } else { "interpolated" }),
        );
    }
}
