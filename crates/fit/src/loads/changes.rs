//! Steps of the load, and bends where it goes along lines: each costs what a new level, or slope, at any time of the record is
//! worth, and is kept where it pays.

use crate::data::cells::{Cells, Strip};
use crate::decide::thresholds::*;
use crate::model::backlash_model::BacklashModel;
use crate::model::lanes::{LANES, Wide, Work, widest};
use crate::model::structure::{Noise, Structure, Theta};
use crate::search::elsewhere::Elsewhere;
use crate::search::likelihood::{Point, Search};
use crate::search::screen::{PILOT, theta_for};
use pulp::Simd;
use rayon::prelude::*;

/// What a load does between its marks.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Load {
    /// It stands still, and steps.
    Levels,
    /// It goes along lines, and bends.
    Lines,
}

impl Load {
    /// The disturbance of a load that does nothing but that, and of one that walks as well.
    pub(crate) fn noises(self) -> [Noise; 2] {
        match self {
            Self::Levels => [Noise::Still, Noise::Input],
            Self::Lines => [Noise::Lines, Noise::Bends],
        }
    }

    pub(crate) fn of(structure: Structure) -> Self {
        if matches!(structure.noise, Noise::Lines | Noise::Bends) { Self::Lines } else { Self::Levels }
    }

    /// Fewest steps or bends.
    fn fewest(self) -> usize {
        if self == Self::Levels { FEWEST_STEPS } else { FEWEST_BENDS }
    }

    /// Cells that lie between two steps at least, when they are marked and when they are moved. Two bends beside each other are a
    /// step, which a wrong process needs.
    fn apart(self) -> [f64; 2] {
        if self == Self::Levels { [4.0, 2.0] } else { [15.0, 15.0] }
    }

    /// ln of the variance by which the load, or its slope, walks in a cell, in units of the noise: while steps are looked
    /// for, and where the search begins once they are known and while they are not.
    fn walks(self) -> [f64; 3] {
        if self == Self::Levels { [-5.0, -8.0, -4.0] } else { [-12.0, -20.0, -12.0] }
    }
}

/// While they are sought twice as many may be marked: some are taken out again. Where more would be, the load does not step.
const MARKED_AT_MOST: usize = 2;
/// Cells over which the answer to a step is looked for.
const ANSWER: usize = 100;
/// Beginnings with bends that are looked at nearer, and followed, with a lost motion and without.
const LOOKED_AT: usize = 6;
const FOLLOWED: usize = 2;
/// Rounds in which steps are marked; in each all that lie well apart are taken.
const ROUNDS: usize = 25;

/// A record with steps marked, the point that goes with them, and what it costs with them [−2·ln L].
#[derive(Clone)]
pub(crate) struct Marked {
    pub(crate) record: Cells,
    pub(crate) point: Point,
    pub(crate) cost: f64,
}

impl Marked {
    fn new(record: Cells, structure: Structure, sign: f64, point: Point) -> Self {
        let cost = point.cost + Search { record: &record, structure, sign }.price_of_changes(&point);
        Self { record, point, cost }
    }
}

/// That which costs least.
fn cheapest(marked: impl IntoIterator<Item = Marked>) -> Marked {
    marked.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("one at least")
}

/// `point` with the large steps of a load that walks, where they pay; the record's own are left aside.
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

/// The steps of a load that stands still between them, with the lost motion that goes with them best; and those without a
/// lost motion. None where there are more of them than can be told. `hints`: the record with marks near which others may lie.
pub(crate) fn detect_changes(
    record: &Cells,
    seeds: &[Theta],
    sign: f64,
    load: Load,
    hints: &[Cells],
) -> Option<(Marked, Marked)> {
    let pilot = Structure { noise: load.noises()[1], ..PILOT };
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
    let still = Structure { noise: load.noises()[0], ..PILOT };
    let hinted = |(hint, (theta, part, share)): (&Cells, (Theta, f64, f64))| {
        let search = Search { record: hint, structure: still, sign };
        let point = search.descend(theta, &lost(part, share), 10, 0.1, f64::INFINITY);
        Marked::new(hint.clone(), still, sign, point)
    };
    let near: Vec<_> = hints.iter().flat_map(|hint| begun.iter().map(move |begun| (hint, *begun))).collect();
    let mut begun: Vec<Marked> = begun.into_par_iter().map(|(theta, part, share)| from(theta, part, share)).collect();
    begun.par_extend(near.into_par_iter().map(hinted));
    let begun = if load == Load::Lines { shortlist(pilot, sign, begun) } else { begun };
    let known = begun.iter().find(|m| load == Load::Lines && m.point.lost.d == 0.0).cloned();
    let begun = cheapest(begun);
    if too_many(&begun.record) {
        return None;
    }
    // From the best beginning every width, as a gap, a gap with a jump in it, and a jump alone.
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
    tried.truncate(3);
    tried.push(none);
    let mut tried: Vec<Marked> = tried.into_par_iter().map(|marked| refine(pilot, sign, marked)).collect();
    let none = cheapest(tried.pop().into_iter().chain(known));
    // Nearer widths and jumps with the steps as they are, then the steps once more.
    let best = nearer(pilot, sign, cheapest(tried), [0.2, 0.1, 0.05]);
    let again = refine(pilot, sign, detect(record, pilot, sign, best.point.theta, &best.point.lost));
    Some((cheapest([best, again]), none))
}

/// The same with the width and the jump that cost least with its steps, `by` which part they are moved in turn.
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

/// `point` of a record in which steps are marked, with those that go with other widths: steps that were marked beside a wrong
/// width make up for it, and hold it.
pub(crate) fn marked_anew(record: &Cells, structure: Structure, sign: f64, point: &Point) -> (Marked, Structure) {
    let walks = Load::of(structure).noises()[1];
    let family = Structure { noise: walks, ..structure };
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

/// The best without a lost motion and the best with one, after the bends of a few beginnings were put where they pay most: bends
/// that are marked late are marked twice, and hide which beginning is good.
fn shortlist(structure: Structure, sign: f64, mut begun: Vec<Marked>) -> Vec<Marked> {
    begun.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let (none, some): (Vec<Marked>, Vec<Marked>) = begun.into_iter().partition(|m| m.point.lost.d == 0.0);
    let [still, _] = Load::of(structure).noises().map(|noise| Structure { noise, ..structure });
    let fewer = |marked: Marked| {
        let record = prune(&Search { record: &marked.record, structure: still, sign }, &marked.point);
        let search = Search { record: &record, structure: still, sign };
        let point = search.descend(marked.point.theta, &marked.point.lost, 8, 0.1, f64::INFINITY);
        Marked::new(record, still, sign, point)
    };
    let best = |marked: Vec<Marked>| {
        let mut fewer: Vec<Marked> = marked.into_par_iter().take(LOOKED_AT).map(fewer).collect();
        fewer.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let refined = fewer.into_par_iter().take(FOLLOWED).map(|marked| refine(structure, sign, marked));
        cheapest(refined.collect::<Vec<_>>())
    };
    vec![best(none), best(some)]
}

/// Steps found with two lags, for the family that goes with them best.
pub(crate) fn choose_family(record: &Cells, marked: Marked, sign: f64, load: Load) -> (Marked, Structure) {
    let of = |record: &Cells, structure: Structure, theta: Theta, lost: &BacklashModel| {
        let point = Search { record, structure, sign }.descend(theta, lost, 12, 1e-2, f64::INFINITY);
        Marked::new(record.clone(), structure, sign, point)
    };
    let [_, walks] = load.noises();
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
    // What is left may drift at the output instead.
    let drifts = Structure { noise: Noise::Output, ..family };
    let other = of(&best.record, drifts, in_family(drifts, &best.point.theta), &best.point.lost);
    if other.cost < best.cost - 2.0 { (other, drifts) } else { (best, family) }
}

/// The same process in a family with another disturbance.
fn in_family(family: Structure, theta: &Theta) -> Theta {
    let mut other = family.beginning(1.0, 0.0);
    other[..=family.lags].copy_from_slice(&theta[..=family.lags]);
    other
}

/// Whether so many steps are marked that more would be if they might.
fn too_many(record: &Cells) -> bool {
    record.changes() + record.stretches.len() >= MARKED_AT_MOST * record.count / CELLS_A_CHANGE
}

/// Whether so many steps can be those of a load.
pub(crate) fn few(record: &Cells, load: Load) -> bool {
    (load.fewest()..=record.count / CELLS_A_CHANGE).contains(&record.changes())
}

/// Whether the marked steps may be load steps: they are few, and follow OP no more often than by chance (5 %).
/// A load knows nothing of OP; a valve that breaks loose goes where OP has gone.
pub(crate) fn plausible(marked: &Marked, structure: Structure, sign: f64) -> bool {
    let load = Load::of(structure);
    if !few(&marked.record, load) || load == Load::Lines {
        // OP goes along the same lines: where they bend tells nothing.
        return load == Load::Lines && few(&marked.record, load);
    }
    let (along, all) = along_op(marked, structure, sign);
    let (along, all) = (along as f64, all as f64);
    along <= 0.5 * all + ALONG_OP * all.sqrt()
}

/// Whether each step is clear and wider than the gap, as those of a load that walks must be: what is smaller may be the valve.
pub(crate) fn all_large(marked: &Marked, structure: Structure, sign: f64) -> bool {
    let Point { lost, kp, .. } = &marked.point;
    let (pushes, [variance, scale]) = pushes(marked, structure, sign);
    let least = WIDER_THAN_GAP * lost.d * kp.abs() * scale;
    let large = |push: &Push| push.size.abs() > least && push.size * push.size * push.energy > LARGE_STEP * variance;
    Load::of(structure) == Load::Levels && !pushes.is_empty() && pushes.iter().all(large)
}

/// Steps that push PV the way in which OP has been pushing it, and all before which OP moved.
fn along_op(marked: &Marked, structure: Structure, sign: f64) -> (usize, usize) {
    let (pushes, _) = pushes(marked, structure, sign);
    let after_op = pushes.iter().filter(|push| push.moved != 0.0);
    (after_op.clone().filter(|push| push.size * push.moved > 0.0).count(), after_op.count())
}

/// What a marked step does to PV that nothing else explains.
struct Push {
    /// Its size, in the scale of the innovations.
    size: f64,
    /// The squares of the answer to a step of 1.
    energy: f64,
    /// What OP moved before it, times the process gain.
    moved: f64,
}

/// What each marked step does, the variance of the innovations and their scale [1/PV unit].
fn pushes(marked: &Marked, structure: Structure, sign: f64) -> (Vec<Push>, [f64; 2]) {
    let Marked { record, point, .. } = marked;
    let calm = Structure { noise: Load::of(structure).noises()[1], ..structure };
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

/// The same process under a load that hardly walks.
fn calm_theta(structure: Structure, theta: &Theta) -> Theta {
    let mut calm = *theta;
    calm[structure.lags + 1] = Load::of(structure).walks()[0];
    calm
}

/// From a beginning to a process whose load stands still between steps: steps and process in turns.
fn detect(record: &Cells, structure: Structure, sign: f64, theta: Theta, lost: &BacklashModel) -> Marked {
    let plain = record.unmarked();
    let [still, walks] = Load::of(structure).noises().map(|noise| Structure { noise, ..structure });
    let watch = Search { record: &plain, structure: walks, sign };
    let turn = |theta: Theta| {
        let record = mark(&watch, &calm_theta(structure, &theta), lost, CLEAR_CHANGE, 0.0);
        let rounds = if too_many(&record) { 1 } else { 8 };
        let point = Search { record: &record, structure: still, sign }.descend(theta, lost, rounds, 0.1, f64::INFINITY);
        Marked::new(record, still, sign, point)
    };
    let mut best = turn(theta);
    for _ in 1..3 {
        if too_many(&best.record) {
            break;
        }
        let next = turn(best.point.theta);
        if next.cost > best.cost - 1.0 {
            break;
        }
        best = next;
    }
    best
}

/// Steps that do not pay taken out, the others moved to where they pay most, and a load that may walk between them.
fn refine(structure: Structure, sign: f64, marked: Marked) -> Marked {
    let [still, walks] = Load::of(structure).noises().map(|noise| Structure { noise, ..structure });
    let [_, known, unknown] = Load::of(structure).walks();
    let walking = |marked: Marked, q: f64| {
        let mut theta = marked.point.theta;
        theta[structure.lags + 1] = q;
        let search = Search { record: &marked.record, structure: walks, sign };
        let point = search.descend(theta, &marked.point.lost, 10, 1e-2, f64::INFINITY);
        prune_and_relocate(walks, sign, Marked::new(marked.record, walks, sign, point))
    };
    // Where the model is not quite that of the record, a load that walks needs fewer steps from the first.
    cheapest([walking(prune_and_relocate(still, sign, marked.clone()), known), walking(marked, unknown)])
}

fn prune_and_relocate(structure: Structure, sign: f64, mut marked: Marked) -> Marked {
    for _ in 0..4 {
        let record = prune(&Search { record: &marked.record, structure, sign }, &marked.point);
        let record = relocate(&Search { record: &record, structure, sign }, &marked.point);
        let search = Search { record: &record, structure, sign };
        let point = search.descend(marked.point.theta, &marked.point.lost, 10, 1e-2, f64::INFINITY);
        let before = std::mem::replace(&mut marked, Marked::new(record, structure, sign, point)).cost;
        if Load::of(structure) == Load::Lines {
            marked = shift_all(structure, sign, marked);
        }
        if marked.cost > before - 1.0 {
            break;
        }
    }
    marked
}

/// All bends earlier or later at once: PV shows a bend as late where it comes earlier and the process lags more, and OP's own
/// moves where its dead time is shorter by as much.
fn shift_all(structure: Structure, sign: f64, marked: Marked) -> Marked {
    let last = |y: &[f64]| y.len() as f64 - 5.0;
    let tried = [-8.0, -4.0, -2.0, 2.0, 4.0, 8.0].map(|by| {
        let later = |s: &Strip| s.changes.iter().map(|t| (t + by).clamp(5.0, last(&s.y))).collect();
        let record = marked.record.with_changes(marked.record.stretches.iter().map(later).collect());
        let mut theta = marked.point.theta;
        let lag = structure.lag(&theta);
        theta[0] += ((lag - by) / lag).max(0.2).ln();
        theta[structure.dead_time_at()] += by;
        let search = Search { record: &record, structure, sign };
        let point = search.descend(theta, &marked.point.lost, 6, 0.1, marked.point.cost);
        Marked::new(record, structure, sign, point)
    });
    cheapest(tried.into_iter().chain([marked]))
}

/// Each step at the time near by when it explains most.
fn relocate(search: &Search, point: &Point) -> Cells {
    let Point { theta, lost, .. } = point;
    let [_, beside] = Load::of(search.structure).apart();
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

/// Without the steps that do not pay.
fn prune(search: &Search, point: &Point) -> Cells {
    let mut record = search.record.clone();
    let mut cost = point.cost + search.price_at(point);
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
            let price_of_changes = search.price_at(point);
            for j in 0..changes.len() {
                let fewer = [&changes[..j], &changes[j + 1..]].concat();
                let sums = elsewhere.with(i, &[fewer.as_slice()]);
                without.push((search.cost(sums[0]) + price_of_changes, i, j));
            }
        }
        without.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Those that do not pay and lie so far apart that one says nothing of the other, the worst alone if need be.
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
        let search = Search { record: &record, ..*search };
        cost = search.cost(search.at(&point.theta, &positions).sum[0]) + search.price_at(point);
    }
    record
}

/// The record with the steps that the innovations at θ tell, largest first: of a likelihood ratio above `clear`, larger than
/// `least` [PV unit].
fn mark(search: &Search, theta: &Theta, lost: &BacklashModel, clear: f64, least: f64) -> Cells {
    let mut record = search.record.clone();
    let [apart, _] = Load::of(search.structure).apart();
    let answer = search.answer(theta, ANSWER);
    let energy: f64 = answer.iter().map(|a| a * a).sum();
    if energy < 1e-12 {
        return record;
    }
    let positions = record.positions(lost);
    for _ in 0..ROUNDS {
        let here = Search { record: &record, ..*search }.at(theta, &positions);
        let residual = here.lane(0);
        // Spread of the innovations by their median, which steps do not move.
        let mut sizes: Vec<f64> = residual.iter().map(|r| r.abs()).collect();
        let middle = sizes.len() / 2;
        let spread = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / 0.6745;
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

/// What the innovations tell of a step before each cell: the square of their product with the answer to it, which ends where
/// the load is unknown again.
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
mod tests {
    use super::*;

    const TIMES: [f64; 6] = [60.4, 130.75, 210.1, 280.5, 350.9, 430.25];

    /// A lag of six cells behind OP and a load that steps at [`TIMES`], 500 cells, noise of ± 0.01.
    fn record() -> (Cells, Point) {
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

    fn still(record: &Cells) -> Search<'_> {
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
    fn steps_are_marked_and_moved_to_their_times() {
        let (record, point) = record();
        let found =
            prune_and_relocate(still(&record).structure, 1.0, detect(&record, PILOT, 1.0, point.theta, &point.lost));
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
        let structure = Structure { noise: Noise::Lines, ..PILOT };
        let mut theta = structure.beginning(6.0, 0.0);
        (theta[0], theta[1]) = ((6.0_f64 * 0.06).sqrt().ln(), (6.06 / 2.0 / (6.0_f64 * 0.06).sqrt()).ln());
        let found =
            prune_and_relocate(structure, 1.0, detect(&record, structure, 1.0, theta, &BacklashModel::gap(0.0, 1)))
                .record;
        let mut times = found.stretches[0].changes.clone();
        times.sort_by(f64::total_cmp);
        assert_eq!(times.len(), TIMES.len(), "{times:?}");
        for (found, truth) in times.iter().zip(TIMES) {
            assert!((found - truth).abs() < 6.0, "{times:?}");
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

    #[test]
    fn steps_that_go_where_op_goes_are_not_the_loads() {
        let (record, point) = record();
        let truth =
            Marked::new(record.with_changes(vec![TIMES.to_vec()]), still(&record).structure, 1.0, point.clone());
        assert!(plausible(&truth, PILOT, 1.0));
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
        assert!(!plausible(&along, PILOT, 1.0));
    }
}
