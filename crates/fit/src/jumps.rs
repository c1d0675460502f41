//! Steps of the load: rare, large, and nothing that a random walk could be.

use crate::kalman::{LANES, White};
use crate::search::{Point, Search};

/// Likelihood ratio that a jump must bring.
const CLEAR: f64 = 50.0;
/// Cells over which the answer to a jump is looked for.
const ANSWER: usize = 60;

/// Cells of each stretch before which the load jumped by more than the gap is wide, as far as the innovations of `point`
/// tell. A gap of which d is not yet quite right leaves innovations too, but never larger than the gap: those are left alone.
pub(crate) fn jumps(search: &Search, point: &Point) -> Vec<Vec<usize>> {
    let record = search.record;
    // What a unit step of the load leaves in the innovations once the filter has settled.
    let before = 400;
    let step: Vec<_> = (0..before + ANSWER).map(|k| [if k < before { 0.0 } else { 1.0 }; LANES]).collect();
    let mut white = White::default();
    search.structure.whiten(&[point.theta; LANES], &vec![0.0; step.len()], &[], &step, &mut white);
    let answer: Vec<f64> = white.of_v[before..].iter().map(|v| v[0]).collect();
    let energy: f64 = answer.iter().map(|a| a * a).sum();
    let here = search.at(&point.theta, &record.positions(&point.lost));
    let mut sizes: Vec<f64> = here.residual.iter().map(|r| r[0].abs()).collect();
    sizes.sort_by(f64::total_cmp);
    // Spread of the innovations by their median, which jumps do not move.
    let spread = sizes[sizes.len() / 2] / 0.6745;
    let least = 1.2 * point.lost.d * point.kp.abs() * here.scale[0];
    if energy < 1e-12 || spread <= 0.0 {
        return vec![Vec::new(); record.stretches.len()];
    }
    let mut next = here.residual.iter().map(|r| r[0]);
    record
        .stretches
        .iter()
        .map(|stretch| {
            let mut residual: Vec<f64> =
                stretch.y.iter().map(|y| if y.is_nan() { 0.0 } else { next.next().unwrap_or(0.0) }).collect();
            let mut found: Vec<usize> = Vec::new();
            let size = |residual: &[f64], k: usize| -> f64 {
                residual[k..].iter().zip(&answer).map(|(r, a)| r * a).sum::<f64>() / energy
            };
            for _ in 0..stretch.y.len() / 50 {
                let free = |k: &usize| stretch.jumps.iter().chain(&found).all(|j| j.abs_diff(*k) > 4);
                let sizes = (10..stretch.y.len().saturating_sub(5)).filter(free).map(|k| (k, size(&residual, k)));
                let Some((k, a)) = sizes.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())) else { break };
                if a * a * energy < CLEAR * spread * spread || a.abs() < least {
                    break;
                }
                for (r, g) in residual[k..].iter_mut().zip(&answer) {
                    *r -= a * g;
                }
                found.push(k);
            }
            found
        })
        .collect()
}
