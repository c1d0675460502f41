//! Whether marked changes may be those of a load: few, and knowing nothing of OP.

use crate::data::cells::Cells;
use crate::decide::thresholds::*;
use crate::loads::changes::Marked;
use crate::loads::marks::{ANSWER, calm_theta, fewest};
use crate::search::likelihood::{Point, Search};
use glapp_model::structure::{Load, Structure};

/// Whether so many steps can be those of a load.
pub(crate) fn few(record: &Cells, load: Load) -> bool {
    (fewest(load)..=record.count / CELLS_A_CHANGE).contains(&record.changes())
}

/// Whether the marked steps may be load steps: they are few, and of n no more than n/2 + `chance`·√n follow OP.
/// A load knows nothing of OP; a valve that breaks loose goes where OP has gone.
pub(crate) fn plausible(marked: &Marked, structure: Structure, sign: f64, chance: f64) -> bool {
    let load = Load::of(structure);
    if !few(&marked.record, load) || load == Load::Lines {
        // OP goes along the same lines: where they bend tells nothing.
        return load == Load::Lines && few(&marked.record, load);
    }
    let (along, all) = along_op(marked, structure, sign);
    let (along, all) = (along as f64, all as f64);
    along <= 0.5 * all + chance * all.sqrt()
}

/// Whether each step is clear and wider than the gap, as those of a load that walks must be: what is smaller may be the valve.
pub(crate) fn all_large(marked: &Marked, structure: Structure, sign: f64) -> bool {
    let Point { lost, kp, .. } = &marked.point;
    let (pushes, [variance, scale]) = pushes(marked, structure, sign);
    let least = WIDER_THAN_GAP * lost.d * kp.abs() * scale;
    let large = |push: &Push| push.size.abs() > least && push.size * push.size * push.energy > LARGE_STEP * variance;
    Load::of(structure) == Load::Levels && !pushes.is_empty() && pushes.iter().all(large)
}

/// Whether the steps are so few beside the gap's traversals that these tell enough, were each of them the valve that breaks loose.
pub(crate) fn beside_many_traversals(marked: &Marked, structure: Structure) -> bool {
    let least = marked.record.traversals(marked.point.lost.d).into_iter().min().unwrap_or(0);
    let changes = marked.record.changes();
    Load::of(structure) == Load::Levels
        && marked.point.lost.d > 0.0
        && changes > 0
        && TRAVERSALS_A_STEP * changes <= least
}

/// Steps that push PV the way in which OP has been pushing it, and all before which OP moved.
fn along_op(marked: &Marked, structure: Structure, sign: f64) -> (usize, usize) {
    let (pushes, _) = pushes(marked, structure, sign);
    let after_op = pushes.iter().filter(|push| push.moved != 0.0);
    (after_op.clone().filter(|push| push.size * push.moved > 0.0).count(), after_op.count())
}

/// Effect of a marked step on PV that nothing else explains.
struct Push {
    /// Size in the scale of the innovations.
    size: f64,
    /// The squares of the answer to a step of 1.
    energy: f64,
    /// Move of OP before the step, times the process gain.
    moved: f64,
}

/// Effect of each marked step, the variance of the innovations and their scale [1/PV unit].
fn pushes(marked: &Marked, structure: Structure, sign: f64) -> (Vec<Push>, [f64; 2]) {
    let Marked { record, point, .. } = marked;
    let calm = Structure { noise: Load::of(structure).noise(), ..structure };
    let theta = calm_theta(structure, &point.theta);
    let positions = record.positions(&point.lost);
    let answer = Search { record, structure: calm, sign }.answer(&theta, ANSWER);
    let back = (structure.lag(&theta) + theta[structure.dead_time_at()]).clamp(3.0, 30.0) as usize;
    let all = Search { record, structure: calm, sign }.at(&theta, &positions);
    let mut pushes = Vec::new();
    for (i, stretch) in record.stretches.iter().enumerate() {
        for (j, time) in stretch.changes.iter().enumerate() {
            let time = time.ceil() as usize;
            let moved = stretch.moved(time.saturating_sub(back), time, record.cell) * point.kp;
            let mut fewer = record.clone();
            fewer.stretches[i].changes.remove(j);
            let residual = Search { record: &fewer, structure: calm, sign }.at(&theta, &positions).lane(0);
            let left = fewer.by_stretch(&residual).swap_remove(i);
            let end = next(&stretch.changes, time).min(time + ANSWER).min(left.len());
            let pushed: f64 = left[time..end].iter().zip(&answer).map(|(r, a)| r * a).sum();
            let energy: f64 = answer[..end - time].iter().map(|a| a * a).sum();
            pushes.push(Push { size: pushed / energy.max(1e-300), energy, moved });
        }
    }
    (pushes, [all.sum[0] / record.freedom(), all.scale[0]])
}

/// The cell of the next step after `cell`.
fn next(changes: &[f64], cell: usize) -> usize {
    changes.iter().map(|j| j.ceil() as usize).filter(|j| *j > cell).min().unwrap_or(usize::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loads::marks::tests::{TIMES, record, still};
    use crate::search::screen::PILOT;

    #[test]
    fn steps_that_go_where_op_goes_are_not_the_loads() {
        let (record, point) = record();
        let truth =
            Marked::new(record.with_changes(vec![TIMES.to_vec()]), still(&record).structure, 1.0, point.clone());
        assert!(plausible(&truth, PILOT, 1.0, ALONG_OP));
        // OP moves up before each step up, and down before each step down.
        let (y, mut u) = (record.stretches[0].y.clone(), Vec::new());
        let mut op = 0.0;
        for k in 0..y.len() {
            let next = TIMES.iter().position(|t| (k as f64) < *t).unwrap_or(TIMES.len());
            op += if next % 2 == 0 { 0.01 } else { -0.01 };
            u.push(op);
        }
        let other = Cells::new(&[(&y, &u)], 1).with_changes(vec![TIMES.to_vec()]);
        let along = Marked::new(other, still(&record).structure, 1.0, point);
        assert!(!plausible(&along, PILOT, 1.0, ALONG_OP));
    }
}
