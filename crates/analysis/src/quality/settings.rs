//! Settings against what OP does, signals under each other's name, and a gain that nobody gave.

use super::finding::{Fault, Severity};
use super::look::Look;
use super::{Finding, Law};
use crate::Inspected;
use crate::identify::{R2_USABLE, identified};

/// Outside the interval by more than this factor, a setting is another one: units and forms differ by more.
const FACTOR: f64 = 1.5;
/// OP and PV are exchanged where a law explains this share of PV's moves by OP, and none shows in OP's by PV.
const EXCHANGED: f64 = 0.95;
/// Rows that are enough to see that.
const EXCHANGED_ROWS: usize = 20_000;
/// Share of the width that may depend on an assumed gain without a finding.
const HANGS: f64 = 0.1;

/// Findings on the controller's settings compared with the recording.
pub(super) fn settings(look: &Look<'_>, found: &mut Vec<Finding>) {
    let seen = look.known.law.filter(|law| law.usable).and_then(|law| law.k.value).or(look.known.k);
    if let (Some(kp), Some(k)) = (look.known.kp, seen)
        && kp * k < 0.0
    {
        found.push(Finding::new(Fault::Sign, Severity::Warning).with("kp", kp).with("k_seen", k));
    }
    let Some(law) = look.known.law.filter(|law| law.usable) else { return };
    let (Some(k_seen), Some(_)) = (law.k.value, law.ti.value) else { return };
    if let Some(k) = look.known.k.filter(|k| k * k_seen < 0.0) {
        found.push(
            Finding::new(Fault::Sign, Severity::Warning)
                .with("k_given", k)
                .with("k_seen", k_seen)
                .with("r2", law.r2.unwrap_or(0.0)),
        );
    }
    for (name, given, seen) in
        [("K", look.known.k, law.k), ("Ti", look.known.ti, law.ti), ("Td", look.known.td, law.td)]
    {
        let (Some(given), Some(value), Some(low), Some(high)) = (given, seen.value, seen.low, seen.high) else {
            continue;
        };
        let (low, high) = (low.abs().min(high.abs()), low.abs().max(high.abs()));
        if !(low / FACTOR <= given.abs() && given.abs() <= high * FACTOR) {
            found.push(
                Finding::new(Fault::Settings, Severity::Warning)
                    .with("parameter", name)
                    .with("given", given)
                    .with("seen", value)
                    .with("low", low)
                    .with("high", high),
            );
        }
    }
}

/// The law of a controller in what PV does when OP moves, and none in what OP does.
pub(super) fn exchanged(look: &Look<'_>, found: &mut Vec<Finding>) {
    let (Some(law), Some(op)) = (look.known.law, look.rows.op) else { return };
    if law.shows(R2_USABLE) {
        return;
    }
    let rows = Inspected { pv: op, op: Some(look.rows.pv), ..look.rows }.first(EXCHANGED_ROWS);
    let other = Law::of(&identified(&rows, None, None));
    let (Some(k), Some(ti), Some(r2)) = (other.k.value, other.ti.value, other.r2) else { return };
    if other.shows(EXCHANGED) {
        found.push(
            Finding::new(Fault::Exchanged, Severity::Refuse)
                .with("r2_as_filed", law.r2.unwrap_or(0.0))
                .with("r2_exchanged", r2)
                .with("k", k)
                .with("ti_s", ti),
        );
    }
}

/// Finding that much of the width depends on a process gain `kp` [PV unit/OP unit] that nobody gave; none where it is
/// little.
///
/// `free` is the part of the width without it, `kp_part` what it takes off \[OP unit\].
pub fn assumed_gain(kp: f64, free: f64, kp_part: f64) -> Option<Finding> {
    (kp_part > HANGS * free).then(|| {
        Finding::new(Fault::KpAssumed, Severity::Warning).with("kp", kp).with("free", free).with("kp_part", kp_part)
    })
}
