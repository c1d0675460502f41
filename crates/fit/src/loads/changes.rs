//! Steps of the load, and bends where it goes along lines: each costs what a new level, or slope, at any time of the record is
//! worth, and is kept where it pays.

use crate::data::backlash_model::BacklashModel;
use crate::data::cells::Cells;
use crate::decide::thresholds::*;
use crate::loads::marks::{find, first_sight, mark, prune, relocate, too_many};
use crate::search::likelihood::{Point, Search};
use crate::search::screen::{PILOT, theta_for};
use glapp_model::structure::{Load, Noise, Structure, Theta};
use rayon::prelude::*;

/// Beginnings that are followed.
const FOLLOWED: usize = 6;
/// Times that a step must pay its price while the process is not known.
const FIRST_TIMES: f64 = 2.0;
/// Turns in which steps are found again at most.
const MOST_TURNS: usize = 4;

/// A record with marked steps, the point that fits them, and the cost of both [−2·ln L].
#[derive(Clone)]
pub(crate) struct Marked {
    pub(crate) record: Cells,
    pub(crate) point: Point,
    pub(crate) cost: f64,
}

impl Marked {
    pub(super) fn new(record: Cells, structure: Structure, sign: f64, point: Point) -> Self {
        let cost = point.cost + Search { record: &record, structure, sign }.price_of_changes(point.kp);
        Self { record, point, cost }
    }

    /// Whether both have the same changes and the same process: a search from one ends as from the other.
    fn same(&self, other: &Self) -> bool {
        let (here, there) = (&self.point, &other.point);
        self.cost == other.cost
            && here.theta == there.theta
            && here.lost == there.lost
            && marked_alike(&self.record, &other.record)
    }
}

/// Whether the same changes of a record are marked, in the same order.
fn marked_alike(a: &Cells, b: &Cells) -> bool {
    a.stretches.iter().map(|s| &s.changes).eq(b.stretches.iter().map(|s| &s.changes))
}

/// Results of `becomes` for all. It is called once for those that are the `same`.
fn each<T: Sync, R: Clone + Send>(
    all: &[T],
    same: impl Fn(&T, &T) -> bool,
    becomes: impl Fn(&T) -> R + Sync,
) -> Vec<R> {
    let first = |i: usize| (0..i).find(|j| same(&all[*j], &all[i])).unwrap_or(i);
    let first: Vec<usize> = (0..all.len()).map(first).collect();
    let once = |(i, one): (usize, &T)| (first[i] == i).then(|| becomes(one));
    let once: Vec<Option<R>> = all.par_iter().enumerate().map(once).collect();
    first.iter().map(|i| once[*i].clone().expect("it is worked out for the first of those that are the same")).collect()
}

/// The one with the least cost.
fn cheapest(marked: impl IntoIterator<Item = Marked>) -> Marked {
    marked.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("one at least")
}

/// `point` with the large steps of a load that walks, where they pay; the marks that the record already has are ignored.
pub(crate) fn with_large_steps(search: &Search, point: &Point) -> Marked {
    let (structure, sign) = (search.structure, search.sign);
    let ended = |record: Cells| {
        let search = Search { record: &record, structure, sign };
        let point = search.descend(point.theta, &point.lost, 10, 1e-2, f64::INFINITY);
        Marked::new(record, structure, sign, point)
    };
    let plain = search.record.unmarked();
    let least_size = WIDER_THAN_GAP * point.lost.d * point.kp;
    let record = mark(&Search { record: &plain, ..*search }, &point.theta, &point.lost, LARGE_STEP, least_size);
    if record.changes() == 0 { ended(plain) } else { cheapest([ended(plain), ended(record)]) }
}

/// Steps of a load that is constant between them, with the lost motion that fits them best; and those without a lost
/// motion. None where there are more of them than the record can tell. `hints`: the record with marks near which others may lie.
pub(crate) fn detect_changes(
    record: &Cells,
    seeds: &[Theta],
    sign: f64,
    load: Load,
    hints: &[Cells],
) -> Option<(Marked, Marked)> {
    let pilot = Structure { noise: load.noise(), ..PILOT };
    let n = record.count as f64;
    let lost = |part: f64, share: f64| BacklashModel {
        share,
        ..BacklashModel::gap(part * record.range, record.stretches.len())
    };
    let from = |theta: Theta, part: f64, share: f64| detect(record, pilot, sign, theta, &lost(part, share));
    let grid = [(4.0, 0.5), (10.0, 2.0), (20.0, 2.0), (20.0, 8.0), (40.0, 10.0)];
    let grid = grid.into_iter().filter(|(t, dead)| *t < n / 8.0 && *dead < n / 12.0);
    let grid = grid.map(|(t, dead)| PILOT.beginning(t, dead)).chain(seeds.iter().copied());
    let kinds = [(0.0, 0.0), (0.1, 0.0), (0.35, 0.0), (0.15, 1.0)];
    let begun: Vec<_> = grid.flat_map(|theta| kinds.map(|(part, share)| (theta, part, share))).collect();
    // A load along lines hides no jump: whether the valve sticks is seen once its bends are known.
    let begun: Vec<_> = begun.into_iter().filter(|(.., share)| *share == 0.0 || load == Load::Levels).collect();
    // PV in a loop tuned for its lag looks under a load along lines as under one that steps where those bend.
    let hinted = |hint: &Cells| {
        let near = |(theta, part, share): &(Theta, f64, f64)| {
            let search = Search { record: hint, structure: pilot, sign };
            let lost = lost(*part, *share);
            let theta = search.with_best_load_variance(*theta, &lost);
            let point = search.descend(theta, &lost, 10, 0.1, f64::INFINITY);
            Marked::new(hint.clone(), pilot, sign, point)
        };
        begun.par_iter().map(near).collect::<Vec<Marked>>()
    };
    // Fits with a dead band and without one may mark the same changes.
    let near = each(hints, marked_alike, hinted);
    let mut begun: Vec<Marked> = begun.into_par_iter().map(|(theta, part, share)| from(theta, part, share)).collect();
    begun.extend(near.into_iter().flatten());
    let begun = if load == Load::Lines { shortlist(pilot, sign, begun) } else { begun };
    let known = begun.iter().find(|m| load == Load::Lines && m.point.lost.d == 0.0).cloned();
    let begun = cheapest(begun);
    if too_many(&begun.record) {
        return None;
    }
    // Every width from the best beginning: as a gap, as a gap with a jump in it, and as a jump alone.
    let widths = [0.0, 0.015, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8];
    let often = |part: f64| record.traversals(part * record.range).iter().all(|n| *n >= CYCLES);
    let kinds = widths.into_iter().flat_map(|part| [0.0, 0.4, 1.0].map(|share| (part, share)));
    let sticks = |part: f64| load == Load::Levels && part > 0.0 && often(part);
    let kinds: Vec<_> = kinds.filter(|(part, share)| *share == 0.0 || sticks(*part)).collect();
    let mut tried: Vec<Marked> =
        kinds.into_par_iter().map(|(part, share)| from(begun.point.theta, part, share)).collect();
    let none = tried[0].clone();
    tried.push(begun);
    tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    tried.truncate(FOLLOWED);
    tried.push(none);
    let mut tried = each(&tried, Marked::same, |marked| refine(pilot, sign, marked.clone()));
    let none = cheapest(tried.pop().into_iter().chain(known));
    // Nearer widths and jumps with the steps as they are, then the steps once more.
    let best = nearer(pilot, sign, cheapest(tried), [0.2, 0.1, 0.05]);
    let again = refine(pilot, sign, detect(record, pilot, sign, best.point.theta, &best.point.lost));
    Some((cheapest([best, again]), none))
}

/// A candidate with the width and the jump that cost least with its steps, `by` which part they are moved in turn.
fn nearer(structure: Structure, sign: f64, marked: Marked, by: [f64; 3]) -> Marked {
    let mut best = marked;
    for by in by {
        let BacklashModel { d, share, .. } = best.point.lost;
        let nearer = [(1.0 - by, 1.0), (1.0 + by, 1.0), (1.0, 0.75), (1.0, 1.3)].map(|(wider, more)| {
            let lost = BacklashModel { d: d * wider, share: (share * more).min(1.0), ..best.point.lost.clone() };
            let search = Search { record: &best.record, structure, sign };
            let point = search.descend(best.point.theta, &lost, 6, 0.1, f64::INFINITY);
            Marked::new(best.record.clone(), structure, sign, point)
        });
        best = cheapest(nearer.into_iter().chain([best]));
    }
    best
}

/// `point` with steps that are marked anew beside other widths: steps that were marked beside a wrong width make up for
/// it, and hold it.
pub(crate) fn marked_anew(record: &Cells, structure: Structure, sign: f64, point: &Point) -> (Marked, Structure) {
    let family = Structure { noise: Load::of(structure).noise(), ..structure };
    let theta = in_family(family, &point.theta);
    let beside = [0.6, 0.7, 0.8, 0.87, 0.94, 1.06, 1.15, 1.25, 1.4, 1.6];
    let mut tried: Vec<Marked> = beside
        .into_par_iter()
        .map(|part| {
            let lost = BacklashModel { d: part * point.lost.d, ..point.lost.clone() };
            detect(record, family, sign, theta, &lost)
        })
        .collect();
    tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    tried.truncate(3);
    let followed = tried.into_par_iter().map(|marked| {
        let best = nearer(family, sign, refine(family, sign, marked), [0.05, 0.025, 0.0125]);
        let again = refine(family, sign, detect(record, family, sign, best.point.theta, &best.point.lost));
        cheapest([best, again])
    });
    (cheapest(followed.collect::<Vec<_>>()), family)
}

/// `point`, which has no gap, with steps that are marked anew, and the process of these with the steps of `record`; the family is that of a
/// load which may walk between them.
pub(crate) fn without_a_gap(
    record: &Cells,
    structure: Structure,
    sign: f64,
    point: &Point,
) -> ([Marked; 2], Structure) {
    let family = Structure { noise: Load::of(structure).noise(), ..structure };
    let theta = in_family(family, &point.theta);
    let own = refine(family, sign, detect(record, family, sign, theta, &point.lost));
    let believed = fitted(family, sign, record.clone(), &own.point, 10, 1e-2);
    ([own, believed], family)
}

/// The best without a lost motion and the best with one, after the bends of a few beginnings were refined: bends beside a process that is
/// not yet good hide which beginning is.
fn shortlist(structure: Structure, sign: f64, mut begun: Vec<Marked>) -> Vec<Marked> {
    begun.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let (none, some): (Vec<Marked>, Vec<Marked>) = begun.into_iter().partition(|m| m.point.lost.d == 0.0);
    let best = |marked: Vec<Marked>| {
        let followed = &marked[..FOLLOWED.min(marked.len())];
        cheapest(each(followed, Marked::same, |marked| refine(structure, sign, marked.clone())))
    };
    vec![best(none), best(some)]
}

/// Steps found with two lags, and the family of processes that fits them best.
pub(crate) fn choose_family(record: &Cells, marked: Marked, sign: f64, load: Load) -> (Marked, Structure) {
    let of = |record: &Cells, structure: Structure, theta: Theta, lost: &BacklashModel| {
        let point = Search { record, structure, sign }.descend(theta, lost, 12, 1e-2, f64::INFINITY);
        Marked::new(record.clone(), structure, sign, point)
    };
    let walks = load.noise();
    let (mut best, mut family) = (marked, Structure { noise: walks, ..PILOT });
    for structure in Structure::with(walks).into_iter().skip(1) {
        let Point { theta, lost, .. } = &best.point;
        let mut other = of(&best.record, structure, theta_for(structure, &family.as_pilot(theta)), lost);
        if other.cost < best.cost + 30.0 {
            let again = detect(record, structure, sign, other.point.theta, &other.point.lost);
            other = refine(structure, sign, cheapest([other, again]));
        }
        // A parameter more costs 2.
        if other.cost < best.cost - 2.0 {
            (best, family) = (other, structure);
        }
    }
    if load == Load::Lines {
        return (best, family);
    }
    // What remains may be a drift at the output instead.
    let drifts = Structure { noise: Noise::Output, ..family };
    let other = of(&best.record, drifts, in_family(drifts, &best.point.theta), &best.point.lost);
    if other.cost < best.cost - 2.0 { (other, drifts) } else { (best, family) }
}

/// The process in a family with another disturbance.
fn in_family(family: Structure, theta: &Theta) -> Theta {
    let mut other = family.beginning(1.0, 0.0);
    other[..=family.lags].copy_from_slice(&theta[..=family.lags]);
    other
}

/// Steps, and the process under a load that may walk between them, estimated in turns from a beginning.
fn detect(record: &Cells, structure: Structure, sign: f64, theta: Theta, lost: &BacklashModel) -> Marked {
    let plain = record.unmarked();
    let search = Search { record: &plain, structure, sign };
    let turn = |point: &Point, times: f64| {
        let record = find(&search, point, times);
        let rounds = if too_many(&record) { 1 } else { 8 };
        fitted(structure, sign, record, point, rounds, 0.1)
    };
    let first = turn(&first_sight(&search, &theta, lost), FIRST_TIMES);
    if too_many(&first.record) {
        return first;
    }
    let second = turn(&first.point, 1.0);
    cheapest([first, second])
}

/// The process fitted to marked steps from `point`, begun at the variance by which the load walks between them that explains most.
fn fitted(structure: Structure, sign: f64, record: Cells, point: &Point, rounds: usize, enough: f64) -> Marked {
    let search = Search { record: &record, structure, sign };
    let theta = search.with_best_load_variance(point.theta, &point.lost);
    let point = search.descend(theta, &point.lost, rounds, enough, f64::INFINITY);
    Marked::new(record, structure, sign, point)
}

/// Steps found again, put to their times and fitted in turns, until a turn gains less than 1 [−2·ln L].
fn refine(structure: Structure, sign: f64, marked: Marked) -> Marked {
    let settled = |Marked { record, point, .. }: Marked| {
        let record = prune(&Search { record: &record, structure, sign }, &point);
        let record = relocate(&Search { record: &record, structure, sign }, &point);
        fitted(structure, sign, record, &point, 10, 1e-2)
    };
    let mut best = settled(marked);
    for _ in 0..MOST_TURNS {
        let again = find(&Search { record: &best.record.unmarked(), structure, sign }, &best.point, 1.0);
        let next = settled(fitted(structure, sign, again, &best.point, 8, 0.1));
        if next.cost > best.cost - 1.0 {
            break;
        }
        best = next;
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loads::marks::tests::{TIMES, record};
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn steps_are_marked_and_moved_to_their_times() {
        let (record, point) = record();
        let found = refine(PILOT, 1.0, detect(&record, PILOT, 1.0, point.theta, &point.lost));
        let mut times = found.record.stretches[0].changes.clone();
        times.sort_by(f64::total_cmp);
        assert_eq!(times.len(), TIMES.len(), "{times:?}");
        for (found, truth) in times.iter().zip(TIMES) {
            assert!((found - truth).abs() < 0.3, "{times:?}");
        }
    }

    #[test]
    fn bends_are_marked_and_moved_to_their_times() {
        let (plain, _) = record();
        // The load goes up and down along lines, and so does a lag of six cells behind it.
        let (mut level, mut load, mut y) = (0.0, 0.0, Vec::new());
        for k in 0..plain.stretches[0].y.len() {
            y.push(level + 0.1 * ((k * 7919 % 13) as f64 / 6.0 - 1.0));
            let up = TIMES.iter().filter(|t| **t <= k as f64).count() % 2 == 0;
            load += if up { 0.05 } else { -0.05 };
            level += (load - level) / 6.0;
        }
        let u: Vec<f64> = (0..y.len()).map(|k| (k as f64 * 0.7).sin() * 0.01).collect();
        let record = Cells::new(&[(&y, &u)], 1);
        let structure = Structure { noise: Noise::Bends, ..PILOT };
        let mut theta = structure.beginning(6.0, 0.0);
        (theta[0], theta[1]) = ((6.0_f64 * 0.06).sqrt().ln(), (6.06 / 2.0 / (6.0_f64 * 0.06).sqrt()).ln());
        let found = refine(structure, 1.0, detect(&record, structure, 1.0, theta, &BacklashModel::gap(0.0, 1))).record;
        let mut times = found.stretches[0].changes.clone();
        times.sort_by(f64::total_cmp);
        assert_eq!(times.len(), TIMES.len(), "{times:?}");
        for (found, truth) in times.iter().zip(TIMES) {
            assert!((found - truth).abs() < 6.0, "{times:?}");
        }
    }

    #[test]
    fn what_begins_alike_is_worked_out_once() {
        let (record, point) = record();
        let of = |times: &[f64], cost: f64| {
            let record = record.with_changes(vec![times.to_vec()]);
            Marked { record, point: point.clone(), cost }
        };
        let all = [of(&[60.0], 1.0), of(&[60.0], 1.0), of(&[70.0], 1.0), of(&[60.0], 2.0), of(&[70.0], 1.0)];
        let count = AtomicUsize::new(0);
        let dearer = each(&all, Marked::same, |marked| {
            count.fetch_add(1, Ordering::Relaxed);
            Marked { cost: marked.cost + 10.0, ..marked.clone() }
        });
        assert_eq!(count.into_inner(), 3);
        let told = |marked: &Marked| (marked.cost, marked.record.stretches[0].changes.clone());
        let expected = all.iter().map(|marked| (marked.cost + 10.0, told(marked).1));
        assert!(dearer.iter().map(told).eq(expected));
    }
}
