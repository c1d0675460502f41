//! Marks under one model: steps of the load, or bends where it goes along lines, found, taken out and moved.
//!
//! All changes of a load that stands still between them, or nearly so, are found by a bank of filters (`glapp_model::kalman`).
//!
//! The few large steps of a load that walks are found by a matched filter. Under a Kalman gain that stands still a step of the load at cell k
//! leaves one shape a in the innovations, shifted to k and as large as the step. What it would explain of white innovations ε is
//! (Σ ε(k+i)·a(i))²/Σ a(i)², one correlation for all cells.
//!
//! What a mark that is taken out or moved is worth is then told by the filter itself, by the cells around the mark.

use crate::data::backlash_model::BacklashModel;
use crate::data::cells::Cells;
use crate::decide::thresholds::{CELLS_A_CHANGE, FEWEST_BENDS, FEWEST_STEPS};
use crate::search::elsewhere::Elsewhere;
use crate::search::likelihood::{Point, Search, delayed};
use glapp_model::kalman::{Found, Sought};
use glapp_model::lanes::{LANES, Wide, Work, widest};
use glapp_model::structure::{Load, Structure, Theta};
use pulp::Simd;
use std::f64::consts::PI;

/// Cells over which the answer to a step is looked for.
pub(super) const ANSWER: usize = 100;

/// Rounds in which steps are marked; in each all that lie well apart are taken.
const ROUNDS: usize = 25;

/// Part of what the record tells of the gain that a bank is told before.
const GAIN_KNOWN: f64 = 0.1;

/// While they are sought twice as many may be marked: some are taken out again. Where more would be, the load does not step.
const MARKED_AT_MOST: usize = 2;

/// Fewest steps or bends.
pub(super) fn fewest(load: Load) -> usize {
    if load == Load::Levels { FEWEST_STEPS } else { FEWEST_BENDS }
}

/// Fewest cells between two steps: when they are marked, and when they are moved. Two bends beside each other are a
/// step, which a wrong process needs.
fn apart(load: Load) -> [f64; 2] {
    if load == Load::Levels { [4.0, 2.0] } else { [15.0, 15.0] }
}

/// ln of the variance by which the load, or its slope, walks in a cell while its steps are not known [ln of the noise's variance].
fn calm(load: Load) -> f64 {
    if load == Load::Levels { -5.0 } else { -12.0 }
}

/// Whether so many steps are marked that more would be if they might.
pub(super) fn too_many(record: &Cells) -> bool {
    record.changes() + record.stretches.len() >= MARKED_AT_MOST * record.count / CELLS_A_CHANGE
}

/// The process under a load that hardly walks.
pub(super) fn calm_theta(structure: Structure, theta: &Theta) -> Theta {
    let mut theta = *theta;
    theta[structure.lags + 1] = calm(Load::of(structure));
    theta
}

/// The record with the steps that the innovations at θ tell, largest first: of a likelihood ratio above `clear`, larger than
/// `least` [PV unit].
pub(super) fn mark(search: &Search, theta: &Theta, lost: &BacklashModel, clear: f64, least: f64) -> Cells {
    let mut record = search.record.clone();
    let [apart, _] = apart(Load::of(search.structure));
    let answer = search.answer(theta, ANSWER);
    let energy: f64 = answer.iter().map(|a| a * a).sum();
    if energy < 1e-12 {
        return record;
    }
    let positions = record.positions(lost);
    for _ in 0..ROUNDS {
        let here = Search { record: &record, ..*search }.at(theta, &positions);
        let residual = here.lane(0);
        let spread = spread(&residual);
        let clear = (clear * energy * spread * spread).max((least * here.scale[0] * energy).powi(2));
        let known = record.changes();
        let all_left = record.by_stretch(&residual);
        for (stretch, left) in record.stretches.iter_mut().zip(all_left) {
            let free = |k: &usize| stretch.changes.iter().all(|j| (j - *k as f64).abs() > apart);
            let statistic = step_statistic(&left, &stretch.changes, &answer);
            let mut sizes: Vec<(usize, f64)> = (10..left.len().saturating_sub(5))
                .map(|k| (k, statistic[k]))
                .filter(|(k, s)| *s > clear && free(k))
                .collect();
            sizes.sort_by(|a, b| b.1.total_cmp(&a.1));
            let mut found: Vec<f64> = Vec::new();
            for (k, here) in sizes {
                let most = MARKED_AT_MOST * left.len() / CELLS_A_CHANGE;
                let apart = found.iter().all(|j| (j - k as f64).abs() > ANSWER as f64);
                if apart && stretch.changes.len() + found.len() < most {
                    // A step out of its place by half a cell would draw others around it.
                    let (before, after) = (statistic[k - 1], statistic[k + 1]);
                    let off = 0.5 * (after - before) / (2.0 * here - before - after).max(here * 1e-9);
                    found.push(k as f64 + off.clamp(-0.5, 0.5));
                }
            }
            stretch.changes.extend(found);
        }
        if record.changes() == known {
            break;
        }
    }
    record
}

/// Spread of innovations by their median, which steps do not move.
fn spread(residual: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = residual.iter().map(|r| r.abs()).collect();
    let middle = sizes.len() / 2;
    *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / 0.6745
}

/// The record with the changes of its load that a bank of filters finds, its gain and its noise those of `point`. Each must pay `times`
/// its price.
pub(super) fn find(search: &Search, point: &Point, times: f64) -> Cells {
    let Search { record, structure, sign } = *search;
    let [apart, _] = apart(Load::of(structure));
    let variance = search.largest_change(point.kp).powi(2) / (2.0 * PI * point.noise);
    // What its size costs is in the likelihood of a filter, which does not know it.
    let price = |known| times * search.price_of_place(known) + (times - 1.0) * variance.ln();
    let most = MARKED_AT_MOST * record.count / CELLS_A_CHANGE;
    let prices: Vec<f64> =
        (0..most).scan(0.0, |sum, known| Some(std::mem::replace(sum, *sum + price(known)))).collect();
    let (positions, delay) = (record.positions(&point.lost), search.delay(&point.theta));
    let vv = GAIN_KNOWN * point.products.1;
    // A load that may walk far needs no changes.
    let mut theta = point.theta;
    theta[structure.lags + 1] = theta[structure.lags + 1].min(calm(Load::of(structure)));
    let mut found = Found { sums: [point.kp * point.kp * vv, point.kp * vv, vv], ..Found::default() };
    let mut prices = prices.as_slice();
    let mut changes = Vec::new();
    for (stretch, positions) in record.stretches.iter().zip(&positions) {
        let v = delayed(positions, delay);
        let sought = Sought {
            theta: &theta,
            y: &stretch.y,
            v: &v,
            variance,
            noise: point.noise,
            sign,
            sums: found.sums,
            prices,
            apart: apart as usize,
        };
        found = structure.bank(&sought);
        prices = &prices[found.changes.len()..];
        changes.push(std::mem::take(&mut found.changes));
    }
    record.with_changes(changes)
}

/// What an unmarked record tells of gain and noise under a load that hardly walks.
pub(super) fn first_sight(search: &Search, theta: &Theta, lost: &BacklashModel) -> Point {
    let theta = calm_theta(search.structure, theta);
    let here = search.at(&theta, &search.record.positions(lost));
    let spread = spread(&here.lane(0)) / here.scale[0];
    let products = (here.sums.yv[0], here.sums.vv[0]);
    Point {
        theta,
        cost: search.cost(here.sum[0]),
        kp: here.kp[0],
        lost: lost.clone(),
        noise: spread * spread,
        products,
    }
}

/// Without the steps that do not pay.
pub(super) fn prune(search: &Search, point: &Point) -> Cells {
    let mut record = search.record.clone();
    let mut cost = point.cost + search.price_of_changes(point.kp);
    let positions = record.positions(&point.lost);
    while record.changes() > 0 {
        // Step by step: what the record costs without it.
        let mut elsewhere = Elsewhere::new(&Search { record: &record, ..*search }, &point.theta, &positions);
        let mut without: Vec<(f64, usize, usize)> = Vec::new();
        for (i, stretch) in record.stretches.iter().enumerate() {
            let changes = &stretch.changes;
            if changes.is_empty() {
                continue;
            }
            let mut fewer = record.clone();
            fewer.stretches[i].changes.pop();
            let search = Search { record: &fewer, ..*search };
            let price_of_changes = search.price_of_changes(point.kp);
            for j in 0..changes.len() {
                let fewer = [&changes[..j], &changes[j + 1..]].concat();
                let sums = elsewhere.with(i, &[fewer.as_slice()]);
                without.push((search.cost(sums[0]) + price_of_changes, i, j));
            }
        }
        without.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Changes that do not pay and lie so far apart that they are independent, the worst alone if need be.
        let mut out: Vec<(usize, usize)> = Vec::new();
        for (there, i, j) in without {
            let time = |j: usize| record.stretches[i].changes[j];
            let apart = out.iter().all(|(of, other)| *of != i || (time(*other) - time(j)).abs() > ANSWER as f64);
            if there < cost && apart {
                out.push((i, j));
            }
        }
        if out.is_empty() {
            break;
        }
        out.sort_by_key(|(_, j)| std::cmp::Reverse(*j));
        for (i, j) in out {
            record.stretches[i].changes.remove(j);
        }
        cost = Search { record: &record, ..*search }.cost_at(point, &positions);
    }
    record
}

/// Each step at the time near by when it explains most.
pub(super) fn relocate(search: &Search, point: &Point) -> Cells {
    let Point { theta, lost, .. } = point;
    let [_, beside] = apart(Load::of(search.structure));
    let mut record = search.record.clone();
    let positions = record.positions(lost);
    let mut elsewhere = Elsewhere::new(search, theta, &positions);
    let mut least = elsewhere.as_it_stands();
    for i in 0..record.stretches.len() {
        let last = record.stretches[i].y.len() as f64 - 5.0;
        for j in 0..record.stretches[i].changes.len() {
            for near in [1.0, 0.125] {
                let tried = [-6.0, -4.0, -2.0, -1.0, 1.0, 2.0, 4.0, 6.0].map(|by| {
                    let mut changes = record.stretches[i].changes.clone();
                    let time = (changes[j] + by * near).clamp(5.0, last);
                    // Two in one cell are one, but would count as two.
                    let alone = changes.iter().enumerate().all(|(other, t)| other == j || (t - time).abs() >= beside);
                    if alone {
                        changes[j] = time;
                    }
                    changes
                });
                let sums = elsewhere.with(i, &tried.each_ref().map(Vec::as_slice));
                let best = (0..LANES).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).expect("eight lanes");
                if sums[best] < least {
                    least = sums[best];
                    elsewhere.take(i, &tried[best]);
                    record.stretches[i].changes.clone_from(&tried[best]);
                }
            }
        }
    }
    record
}

/// Test statistic of a step before each cell: the square of the innovations' product with the answer to it, which ends
/// where the load is unknown again.
fn step_statistic(left: &[f64], changes: &[f64], answer: &[f64]) -> Vec<f64> {
    let mut ends: Vec<usize> = changes.iter().map(|j| j.ceil() as usize).chain([left.len()]).collect();
    ends.sort_unstable();
    let mut statistic = Vec::with_capacity(left.len() + TOGETHER * LANES);
    let mut from = 0;
    for end in ends {
        let padded = [&left[from..end], &vec![0.0; answer.len() + TOGETHER * LANES]].concat();
        widest(Statistic { left: &padded, answer, statistic: &mut statistic, end });
        from = end;
    }
    statistic
}

/// Registers of cells that are looked at together for a step.
const TOGETHER: usize = 4;

/// [`step_statistic`] of all cells up to `end` that have none yet.
struct Statistic<'s> {
    left: &'s [f64],
    answer: &'s [f64],
    statistic: &'s mut Vec<f64>,
    end: usize,
}

impl Work for Statistic<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, simd: S) {
        let Self { left, answer, statistic, end } = self;
        let mut from = 0;
        while statistic.len() < end {
            let mut sums = [Wide::<S, R>::all(simd, 0.0); TOGETHER];
            for (later, answer) in answer.iter().enumerate() {
                let (left, answer) = (&left[from + later..], Wide::all(simd, *answer));
                for (i, sum) in sums.iter_mut().enumerate() {
                    *sum += answer * Wide::begin(simd, &left[i * LANES..]);
                }
            }
            for sum in sums {
                statistic.extend_from_slice((sum * sum).lanes().as_slice());
            }
            from += TOGETHER * LANES;
        }
        statistic.truncate(end);
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::search::screen::PILOT;
    use glapp_model::structure::Noise;

    pub(in crate::loads) const TIMES: [f64; 6] = [60.4, 130.75, 210.1, 280.5, 350.9, 430.25];

    /// A lag of six cells behind OP and a load that steps at [`TIMES`], 500 cells, noise of ± 0.01.
    pub(in crate::loads) fn record() -> (Cells, Point) {
        let mut x = 7_u32;
        let mut uniform = || {
            x ^= x << 13;
            x ^= x >> 17;
            x ^= x << 5;
            f64::from(x) / f64::from(u32::MAX) * 2.0 - 1.0
        };
        let (mut level, mut op) = (0.0, 0.0);
        let (mut y, mut u) = (Vec::new(), Vec::new());
        for k in 0..500 {
            y.push(level + 0.01 * uniform());
            op += 0.1 * uniform();
            u.push(op);
            // A twentieth of a cell at a time; OP is held.
            for part in 0..20 {
                let now = f64::from(k) + f64::from(part) / 20.0;
                let load: f64 =
                    TIMES.iter().zip([1.0, -1.0].iter().cycle()).filter(|(t, _)| **t <= now).map(|(_, way)| way).sum();
                level += (op + load - level) / 6.0 / 20.0;
            }
        }
        let record = Cells::new(&[(&y, &u)], 1);
        let structure = Structure { noise: Noise::Still, ..PILOT };
        let plain = Search { record: &record, structure, sign: 1.0 };
        let mut theta = structure.beginning(6.0, 0.0);
        (theta[0], theta[1]) = ((6.0_f64 * 0.06).sqrt().ln(), (6.06 / 2.0 / (6.0_f64 * 0.06).sqrt()).ln());
        let point = plain.descend(theta, &BacklashModel::gap(0.0, 1), 0, 0.1, f64::INFINITY);
        (record, point)
    }

    pub(in crate::loads) fn still(record: &Cells) -> Search<'_> {
        Search { record, structure: Structure { noise: Noise::Still, ..PILOT }, sign: 1.0 }
    }

    #[test]
    fn what_tells_of_a_step_is_summed_up_in_order() {
        let left: Vec<f64> = (0..150).map(|k| f64::from(k * 7919 % 13) - 6.1).collect();
        let answer: Vec<f64> = (0..ANSWER).map(|k| 0.93_f64.powi(k as i32)).collect();
        let found = step_statistic(&left, &[97.5, 33.0], &answer);
        let sum = |k: usize| {
            let end = if k < 33 {
                33
            } else if k < 98 {
                98
            } else {
                150
            };
            let sum = left[k..end].iter().zip(&answer).fold(0.0, |sum, (left, answer)| sum + answer * left);
            sum * sum
        };
        let plain: Vec<f64> = (0..150).map(sum).collect();
        assert_eq!(found, plain);
    }

    #[test]
    fn eight_sets_of_steps_at_once_are_each_what_one_is() {
        let (record, point) = record();
        let positions = record.positions(&point.lost);
        let sets: [Vec<f64>; LANES] = std::array::from_fn(|l| vec![40.0 + 7.3 * l as f64, 200.0 + 0.2 * l as f64]);
        let marked = record.with_changes(vec![sets[0].clone()]);
        let many =
            Elsewhere::new(&still(&marked), &point.theta, &positions).with(0, &sets.each_ref().map(Vec::as_slice));
        for (set, sum) in sets.into_iter().zip(*many) {
            let alone = record.with_changes(vec![set]);
            let one = still(&alone).at(&point.theta, &positions).sum[0];
            assert!((one - sum).abs() < 1e-9 * one, "{one} for {sum}");
        }
    }

    #[test]
    fn a_step_that_is_none_is_taken_out() {
        let (record, point) = record();
        let marked = record.with_changes(vec![[TIMES.as_slice(), &[100.0, 390.0]].concat()]);
        let search = still(&marked);
        let point = search.descend(point.theta, &point.lost, 8, 0.1, f64::INFINITY);
        assert_eq!(prune(&search, &point).stretches[0].changes, TIMES);
    }
}
