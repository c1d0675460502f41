//! Steps of the load: rare, large, and nothing that a random walk could be.

use crate::kalman::{LANES, White};
use crate::record::Record;
use crate::search::{Point, Search};

/// Likelihood ratio that a jump must bring to be tried.
const CLEAR: f64 = 50.0;
/// Cells over which the answer to a jump is looked for.
const ANSWER: usize = 60;
/// Rounds of search; in each all jumps that lie well apart are taken.
const ROUNDS: usize = 8;

/// `point` with the load's jumps that make it most likely, counted with what they cost, and that cost; the record's own
/// marks are left aside. What jumps by less than the gap is wide may be the valve, and is left alone.
pub(crate) fn with_jumps(search: &Search, point: &Point) -> (Record, Point, f64) {
    let plain = search.record.with_jumps(vec![Vec::new(); search.record.stretches.len()]);
    let unmarked = Search { record: &plain, ..*search };
    let without = unmarked.descend(point.theta, &point.lost, 10, 1e-2, f64::INFINITY);
    let record = marked(&unmarked, point);
    if record.jumps() > 0 {
        let search = Search { record: &record, ..*search };
        let with = search.descend(point.theta, &point.lost, 10, 1e-2, f64::INFINITY);
        let cost = with.cost + search.surprise(&with);
        if cost < without.cost {
            return (record, with, cost);
        }
    }
    let cost = without.cost;
    (plain, without, cost)
}

/// The record with the jumps that the innovations of `point` tell, largest first.
fn marked(search: &Search, point: &Point) -> Record {
    let mut record = search.record.clone();
    // What a unit step of the load leaves in the innovations once the filter has settled.
    let before = 400;
    let step: Vec<_> = (0..before + ANSWER).map(|k| [if k < before { 0.0 } else { 1.0 }; LANES]).collect();
    let mut white = White::default();
    let nothing = vec![0.0; step.len()];
    let alone = [(nothing.as_slice(), [].as_slice(), step.as_slice())];
    search.structure.whiten(&[point.theta; LANES], alone.into_iter(), &mut white);
    let answer: Vec<f64> = white.of_v[before..].iter().map(|v| v[0]).collect();
    let energy: f64 = answer.iter().map(|a| a * a).sum();
    if energy < 1e-12 {
        return record;
    }
    let positions = record.positions(&point.lost);
    for _ in 0..ROUNDS {
        let here = Search { record: &record, ..*search }.at(&point.theta, &positions);
        // Innovations over √S, whatever the jumps that are marked do to the scale.
        let mut sizes: Vec<f64> = here.residual.iter().map(|r| r[0].abs()).collect();
        sizes.sort_by(f64::total_cmp);
        // Spread of the innovations by their median, which jumps do not move.
        let spread = sizes[sizes.len() / 2] / 0.6745;
        let least =
            (1.2 * point.lost.d * point.kp * here.scale[0] * energy).powi(2).max(CLEAR * energy * spread * spread);
        let mut next = here.residual.iter().map(|r| r[0]);
        let mut found_any = false;
        for stretch in &mut record.stretches {
            let residual: Vec<f64> =
                stretch.y.iter().map(|y| if y.is_nan() { 0.0 } else { next.next().unwrap_or(0.0) }).collect();
            let free = |k: &usize| stretch.jumps.iter().all(|j| j.abs_diff(*k) > 4);
            let mut sizes: Vec<(usize, f64)> = (10..residual.len().saturating_sub(5))
                .filter(free)
                .map(|k| (k, residual[k..].iter().zip(&answer).map(|(r, a)| r * a).sum::<f64>()))
                .filter(|(_, s)| s * s > least)
                .collect();
            sizes.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
            let mut found: Vec<usize> = Vec::new();
            for (k, _) in sizes {
                if stretch.jumps.len() + found.len() < residual.len() / 20
                    && found.iter().all(|j| j.abs_diff(k) > ANSWER)
                {
                    found.push(k);
                }
            }
            found_any |= !found.is_empty();
            stretch.jumps.extend(found);
        }
        if !found_any {
            break;
        }
    }
    record
}
