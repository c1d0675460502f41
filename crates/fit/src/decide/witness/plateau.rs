//! The plateau: OP travels after a turn and PV does not answer, then it does.
//!
//! It is counted without a model of process or load. The rows in the gap are those from a turn of OP until OP has travelled
//! d, later by the time that PV takes to answer. A way counts where OP travels on in the same direction by half of d at
//! least. With a gap PV does not follow OP within it; a valve without a gap answers all the way.

use crate::data::cells::{Cells, crossings};
use serde::{Deserialize, Serialize};

/// Rows within the gap, fewest for one to count.
const FEWEST: usize = 3;

/// Response of PV to OP within the gap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Plateau {
    /// Ways through the gap that were long enough on both sides of its end, up and down.
    pub ways: [usize; 2],
    /// Travel of PV with OP within the gap, as a fraction of |Kp| times OP's travel: 0 with a gap.
    pub within: f64,
}

/// Response of PV to OP within a gap of width `d` and after it; PV is taken `late` steps later.
pub(crate) fn plateau(cells: &Cells, d: f64, kp: f64, late: f64) -> Plateau {
    let mut found = Plateau::default();
    if d <= 0.0 || kp == 0.0 {
        return found;
    }
    let mut within = Vec::new();
    for strip in &cells.stretches {
        let op = strip.op();
        let pv = |k: usize| strip.y.get(((k as f64 + late) / cells.cell as f64) as usize).copied().unwrap_or(f64::NAN);
        let ends = crossings(op, d);
        let mut all: Vec<(usize, usize)> =
            ends.iter().enumerate().flat_map(|(way, steps)| steps.iter().map(move |k| (*k, way))).collect();
        all.sort_unstable();
        for (i, &(end, way)) in all.iter().enumerate() {
            let sign = if way == 0 { 1.0 } else { -1.0 };
            let after = all.get(i + 1).map_or(op.len(), |next| next.0);
            // OP turned where it stood furthest the other way since the traversal before.
            let before = if i > 0 { all[i - 1].0 } else { 0 };
            let turn = (before..end).max_by(|a, b| (-sign * op[*a]).total_cmp(&(-sign * op[*b]))).unwrap_or(end);
            let last = (end..after).max_by(|a, b| (sign * op[*a]).total_cmp(&(sign * op[*b]))).unwrap_or(end);
            let on = (end..=last).find(|k| sign * (op[*k] - op[end]) >= d).unwrap_or(last);
            let (gone, further) = (sign * (op[end] - op[turn]), sign * (op[on] - op[end]));
            if end - turn < FEWEST || further < 0.5 * d {
                continue;
            }
            let along = sign * (pv(end) - pv(turn)) / (kp * gone);
            if along.is_nan() || pv(on).is_nan() {
                continue;
            }
            found.ways[way] += 1;
            within.push(along);
        }
    }
    within.sort_by(f64::total_cmp);
    Plateau { within: within.get(within.len() / 2).copied().unwrap_or(0.0), ..found }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// OP to and fro by 4 in 80 rows; PV goes with the valve at once.
    fn record(d: f64) -> Cells {
        let triangle = |k: usize| ((k % 160) as f64 - 80.0).abs() / 20.0;
        let op: Vec<f64> = (0..1600).map(triangle).collect();
        let mut v = op[0];
        let pv = op.iter().map(|u| {
            v = f64::clamp(v, u - d / 2.0, u + d / 2.0);
            2.0 * v
        });
        Cells::new(&[(&pv.collect::<Vec<_>>(), &op)], 1)
    }

    #[test]
    fn pv_stands_within_a_gap() {
        let found = plateau(&record(1.0), 1.0, 2.0, 0.0);
        assert!(found.ways.iter().all(|n| *n >= 9), "{found:?}");
        assert!(found.within.abs() < 0.01, "{found:?}");
    }

    #[test]
    fn without_one_it_follows_all_the_way() {
        let found = plateau(&record(0.0), 1.0, 2.0, 0.0);
        assert!(found.ways.iter().all(|n| *n >= 9), "{found:?}");
        assert!(found.within > 0.9, "{found:?}");
    }
}
