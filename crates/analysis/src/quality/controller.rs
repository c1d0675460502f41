//! A controller that rests although its law would move OP, and one whose OP moves nothing.

use super::Finding;
use super::finding::{Fault, Severity};
use super::look::{Look, count, longest_run};
use crate::{median, quantile};

/// Fewer steps, or rows, have no shares.
const FEWEST: usize = 100;
/// OP of a controller with a gap rests for a share of its steps between these: else there is nothing to split.
const RESTS: (f64, f64) = (0.05, 0.98);
/// Inside an error gap OP rests in more than the first share of the steps, outside in less than the second.
const SPLIT: (f64, f64) = (0.9, 0.1);
/// Least fall of the share of rest across the edge of an error gap: the edge is sharp.
const SHARP: f64 = 0.7;
/// Steps next to the edge: one in `EDGE.0` of all, at least `EDGE.1`, and `EDGE.2` must be on either side.
const EDGE: (usize, usize, usize) = (50, 10, 30);
/// OP behind an output dead band rests for more than this share of the steps.
const BAND_RESTS: f64 = 0.3;
/// Quantile of OP's jumps that counts as its least, and the share of the median jump that it must exceed.
const JUMPS: (f64, f64) = (0.02, 0.3);

/// Share of the recording for which the error keeps one sign.
const ONE_SIGN: f64 = 0.8;
/// OP goes one way: from end to end by more than this share of its whole travel.
const ONE_WAY: f64 = 0.8;
/// Least mean error of the second half, as a share of that of the first: PV comes no nearer.
const NO_NEARER: f64 = 0.8;
/// A slow controller takes its time: so many Ti.
const TI_LASTED: f64 = 10.0;

/// Error gap and output dead band: OP rests although the law would move it.
pub(super) fn rests(look: &Look<'_>, found: &mut Vec<Finding>) {
    let (Some(op), Some(_)) = (look.rows.op, look.rows.sp) else { return };
    let live = || (0..look.step.len()).filter(|k| look.live(*k));
    let moved = |k: usize| (op[k + 1] - op[k]).abs();
    let (steps, resting) = (live().count(), count(live().map(|k| moved(k) == 0.0)));
    let share = resting as f64 / steps as f64;
    if steps < FEWEST || !(share > RESTS.0 && share < RESTS.1) {
        return;
    }
    // Sorted by |e|, as bits of positive numbers; of equal ones those that move first, so that no split between equal
    // ones is the best.
    let mut by_error: Vec<u64> =
        live().map(|k| look.e[k + 1].abs().to_bits() << 1 | u64::from(moved(k) == 0.0)).collect();
    by_error.sort_unstable();
    if let Some(finding) = error_gap(&by_error, resting) {
        found.push(finding);
    } else if share > BAND_RESTS && look.op_grid.is_none() {
        let mut jumps: Vec<f64> = live().map(moved).filter(|moved| *moved != 0.0).collect();
        jumps.sort_unstable_by(f64::total_cmp);
        let least = quantile(&jumps, JUMPS.0);
        if least > JUMPS.1 * quantile(&jumps, 0.5) {
            found.push(Finding::new(Fault::OutputDeadBand, Severity::Warning).with("rests", share).with("jump", least));
        }
    }
}

/// The finding of an error gap, from the steps in the order of |e|, the last bit whether OP rests; `resting` of them do.
fn error_gap(steps: &[u64], resting: usize) -> Option<Finding> {
    let n = steps.len();
    let rests = |step: &u64| (step & 1) as usize;
    // The split by |e| with the fewest steps on the wrong side: rest inside the gap, movement outside.
    let (mut least, mut cut, mut cut_below, mut below) = (usize::MAX, 0, 0, 0);
    for (k, step) in steps.iter().enumerate() {
        below += rests(step);
        let wrong = (k + 1 - below) + (resting - below);
        if wrong < least {
            (least, cut, cut_below) = (wrong, k, below);
        }
    }
    let share = |steps: &[u64]| steps.iter().map(rests).sum::<usize>() as f64 / steps.len() as f64;
    let inside = cut_below as f64 / (cut + 1) as f64;
    let outside = if cut + 1 < n { (resting - cut_below) as f64 / (n - 1 - cut) as f64 } else { 0.0 };
    // The step is sharp: just below the edge OP rests, just above it moves.
    let near = cut.min((n / EDGE.0).max(EDGE.1));
    let sharp = cut.min(n - cut) >= EDGE.2
        && share(&steps[cut + 1 - near..=cut]) - share(&steps[cut + 1..n.min(cut + 1 + near)]) > SHARP;
    (inside > SPLIT.0 && outside < SPLIT.1 && sharp).then(|| {
        Finding::new(Fault::ErrorGap, Severity::Warning)
            .with("gap", f64::from_bits(steps[cut] >> 1))
            .with("rests_inside", inside)
            .with("rests_outside", outside)
    })
}

/// One sign of the error for most of the recording, OP going one way all along, PV coming no nearer.
pub(super) fn winding_up(look: &Look<'_>, found: &mut Vec<Finding>) {
    let (Some(op), Some(_)) = (look.rows.op, look.rows.sp) else { return };
    let rows: Vec<usize> = (0..look.good.len()).filter(|k| look.good[*k]).collect();
    if rows.len() < FEWEST {
        return;
    }
    let side = |k: &usize| (look.e[*k] > 0.0, look.e[*k] < 0.0);
    let sides: Vec<(bool, bool)> = rows.iter().map(side).collect();
    let run = longest_run(&sides, |side| side.0 || side.1);
    if run.is_empty() || (run.len() as f64) < ONE_SIGN * rows.len() as f64 {
        return;
    }
    let rows = &rows[run];
    let (first, last) = (rows[0], rows[rows.len() - 1]);
    let travel: f64 = rows.windows(2).map(|pair| (op[pair[1]] - op[pair[0]]).abs()).sum();
    let went = op[last] - op[first];
    let mean = |rows: &[usize]| rows.iter().map(|k| look.e[*k].abs()).sum::<f64>() / rows.len() as f64;
    let (earlier, later) = rows.split_at(rows.len() / 2);
    let nearer = mean(later) / mean(earlier);
    let lasted = look.rows.t[last] - look.rows.t[first];
    let short = lasted < TI_LASTED * look.known.ti.unwrap_or(0.0);
    if travel > 0.0 && went.abs() > ONE_WAY * travel && nearer > NO_NEARER && !short {
        let mut e: Vec<f64> = rows.iter().map(|k| look.e[*k]).collect();
        found.push(
            Finding::new(Fault::WindingUp, Severity::Refuse)
                .with("error", median(&mut e))
                .with("lasted_s", lasted)
                .with("op_from", op[first])
                .with("op_to", op[last]),
        );
    }
}
