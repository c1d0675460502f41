//! First looks at a record: which processes and which loads may have made it.

use crate::data::backlash_model::BacklashModel;
use crate::data::cells::Cells;
use crate::search::likelihood::{Point, Search};
use crate::search::profile::{FINE_TOLERANCE, Profile, Seed};
use glapp_model::structure::{Load, Noise, Structure, Theta};
use rayon::prelude::*;

/// Relative excess of the innovations allowed after a coarse look, which may miss a narrow valley.
const NEARLY_AS_GOOD: f64 = 0.05;

pub(crate) const PILOT: Structure = Structure { lags: 2, integrating: false, noise: Noise::Input };

/// Gain of a step below which a descent of a coarse look ends [−2·ln L].
const COARSE_TOLERANCE: f64 = 0.3;
/// Accuracy of a coarse look's best width, as a fraction of OP's range.
const NARROW: f64 = 0.003;
/// Families of which more widths are tried around the best.
const FOLLOWED: usize = 4;
/// Families of which the whole profile is worked out.
pub(crate) const MOST_FAMILIES: usize = 7;
/// Part of OP's range from which on a gap is wide.
const WIDE: f64 = 0.6;
/// Beginnings that are followed.
const MOST_SEEDS: usize = 4;

/// Results of the first look at a record.
pub(crate) struct Pilot {
    /// Good beginnings of [`PILOT`], best first.
    pub(crate) seeds: Vec<Theta>,
    /// Lags and half the dead time of the best together [cells].
    pub(crate) slow: f64,
    /// Likelihood ratio of a process that does not answer.
    pub(crate) answers: f64,
}

/// Good beginnings from one family at a few widths.
pub(crate) fn pilot(record: &Cells, sign: f64) -> Pilot {
    multistart(record, sign, PILOT)
}

fn multistart(record: &Cells, sign: f64, structure: Structure) -> Pilot {
    let search = Search { record, structure, sign };
    let n = record.count as f64;
    let begin = |part: f64, t: f64, dead: f64| {
        let lost = BacklashModel::gap(part * record.range, record.stretches.len());
        search.descend(
            search.with_best_load_variance(structure.beginning(t, dead), &lost),
            &lost,
            8,
            0.1,
            f64::INFINITY,
        )
    };
    // A gap nearly as wide as OP's swing leaves the valve little, and its valley is narrow; a loop that it makes swing lags by much beside
    // its dead time.
    let starts = [(1.5, 0.5), (1.5, 5.0), (10.0, 0.5), (10.0, 5.0), (40.0, 15.0), (40.0, 1.0)];
    let mut points: Vec<Point> = [0.0, 0.3, 0.6, 0.75, 0.85]
        .into_par_iter()
        .flat_map_iter(|part| starts.map(|(t, dead)| (part, t, dead)))
        .filter(|(part, _, dead)| *part >= WIDE || *dead != 1.0)
        .filter(|(_, t, dead)| *t < n / 8.0 && *dead < n / 12.0)
        .map(|(part, t, dead)| begin(part, t, dead))
        .collect();
    points.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    // The best, then the best with a wide gap: where the search begins without one it stays there.
    let with_wide = points.iter().filter(|p| p.lost.d >= WIDE * record.range).take(1);
    let mut seeds: Vec<Theta> = Vec::new();
    for point in points.iter().take(1).chain(with_wide).chain(&points) {
        if seeds.len() < MOST_SEEDS && !seeds.iter().any(|s| structure.alike(s, &point.theta)) {
            seeds.push(point.theta);
        }
    }
    let best = &points[0];
    let without = search.at(&best.theta, &record.positions(&best.lost)).sum_without[0];
    let theta = &best.theta;
    let slow = 2.0 * theta[0].exp() * theta[1].exp().max(1.0) + 0.5 * theta[2];
    Pilot { seeds, slow, answers: search.cost(without) - best.cost }
}

/// The pilot's parameters for cells `finer` times shorter.
pub(crate) fn rescaled(theta: &Theta, finer: f64) -> Theta {
    let mut scaled = *theta;
    scaled[0] += finer.ln();
    scaled[2] *= finer;
    // Variance of the load a cell falls with the cell, that of the noise rises.
    scaled[3] -= 2.0 * finer.ln();
    scaled
}

/// A beginning for `structure` from the pilot's parameters.
pub(crate) fn theta_for(structure: Structure, pilot: &Theta) -> Theta {
    let (t, zeta, dead, q) = (pilot[0].exp(), pilot[1].exp(), pilot[2], pilot[3]);
    // The integrator takes the place of the longer of two lags.
    let shorter = t * (zeta - (zeta * zeta - 1.0).max(0.0).sqrt());
    let lags = if structure.integrating { shorter } else { 2.0 * t * zeta };
    let mut theta = structure.beginning(lags.max(0.1), dead);
    if structure.lags > 1 {
        (theta[0], theta[1]) = (pilot[0], pilot[1]);
    }
    if structure.lags == 3 {
        theta[2] = pilot[0] - 2.0;
    }
    let noise = structure.lags + 1;
    match structure.noise {
        Noise::Still | Noise::Lines => {}
        Noise::Input => theta[noise] = q,
        Noise::Bends => theta[noise] = -10.0,
        Noise::Output => theta[noise] = q.clamp(-6.0, 6.0),
        // The slope of a load that walked as far in ten cells.
        Noise::Slope => theta[noise] = q.clamp(-6.0, 8.0) - 4.6,
        Noise::Both => (theta[noise], theta[noise + 1]) = (q, -4.0),
    }
    theta
}

/// The parameters of a simple family's best point for the family of the same process with both disturbances.
fn theta_for_both(structure: Structure, simple: &Profile) -> Theta {
    let mut theta = simple.points[simple.best].theta;
    let noise = structure.lags + 1;
    match simple.structure.noise {
        Noise::Input => (theta[noise + 1], theta[noise + 2]) = (-4.0, 2.0),
        _ => (theta[noise], theta[noise + 1], theta[noise + 2]) = (-6.0, theta[noise], theta[noise + 1]),
    }
    theta
}

/// A coarse look with the simple disturbances, then with both together from where those ended: a profile for each family
/// and each of the `seeds` that leads it somewhere else. In a closed loop a process with another dead time may explain PV
/// nearly as well, and it is a family of its own.
pub(crate) fn screen(record: &Cells, seeds: &[Theta], sign: f64, near: f64, load: Load) -> Vec<Profile> {
    let of = |structure| Search { record, structure, sign };
    let coarse = [0.0, 0.015, 0.05, 0.15, 0.3, 0.45, 0.6, 0.75, 0.88, 1.0].map(|part| part * record.range);
    let coarse = with_width(&coarse, near);
    let gap = BacklashModel::gap(0.0, record.stretches.len());
    let begin = |structure: Structure| {
        // The seeds are of two lags; the other families start from the best of them.
        let most = if structure.lags == PILOT.lags { MOST_SEEDS } else { 2 - usize::from(structure.integrating) };
        seeds.iter().take(most).map(move |seed| (structure, theta_for(structure, seed)))
    };
    let families: &[Noise] = if load == Load::Lines { &[Noise::Bends] } else { &[Noise::Input, Noise::Output] };
    let families: Vec<Structure> = families.iter().flat_map(|noise| Structure::with(*noise)).collect();
    // A load that goes along lines hides another process than one that walks.
    let slope = Structure { noise: Noise::Slope, ..PILOT };
    let slopes = if load == Load::Lines { Vec::new() } else { multistart(record, sign, slope).seeds };
    let sloping = |structure: Structure| {
        let most = if structure == slope { MOST_SEEDS } else { 2 - usize::from(structure.integrating) };
        slopes.iter().take(most).map(move |seed| {
            let mut theta = theta_for(structure, &slope.as_pilot(seed));
            theta[structure.lags + 1..structure.lags + 3].copy_from_slice(&seed[slope.lags + 1..slope.lags + 3]);
            (structure, theta)
        })
    };
    let simple: Vec<Profile> = families
        .into_iter()
        .flat_map(begin)
        .chain(Structure::with(Noise::Slope).into_iter().flat_map(sloping))
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|(structure, theta)| {
            Profile::over(&of(structure), &coarse, &gap, &[Seed { theta, d: near }], 4, COARSE_TOLERANCE)
        })
        .collect();
    let mut simple = distinct(simple);
    // A gap that is narrow against all that OP does has a valley between two of the widths, which a family that is right
    // may miss where it began badly: the width and the process that the best family finds are tried in all of them.
    let d = best_of(&simple).points[best_of(&simple).best].lost.d;
    let followed = simple.len().min(FOLLOWED);
    simple[..followed].par_iter_mut().for_each(|p| {
        for near in [0.9, 0.8, 1.1, 1.25] {
            p.insert(&of(p.structure), (near * d).min(record.range), 8);
        }
    });
    for _ in 0..2 {
        let mut best = best_of(&simple).clone();
        best.refine(&of(best.structure), 1, NARROW * record.range);
        let best = &best.points[best.best];
        let pilot = best_of(&simple).structure.as_pilot(&best.theta);
        simple.par_iter_mut().for_each(|p| p.also(&of(p.structure), theta_for(p.structure, &pilot), best.lost.d, 8));
        simple = distinct(simple);
    }
    let promising = best_of(&simple).least() + screening_margin(record.count);
    let both: Vec<Profile> = simple
        .par_iter()
        .filter(|p| p.least() < promising && matches!(p.structure.noise, Noise::Input | Noise::Output))
        .filter_map(|p| {
            let structure = Structure { noise: Noise::Both, ..p.structure };
            let seed = Seed { theta: theta_for_both(structure, p), d: p.points[p.best].lost.d };
            let both = Profile::over(&of(structure), &coarse, &gap, &[seed], 3, COARSE_TOLERANCE);
            // A second disturbance without effect gives the same family once more.
            (both.penalised() < p.penalised()).then_some(both)
        })
        .collect();
    [simple, distinct(both)].concat()
}

/// The profiles of which no better one of the same family ends at the same process.
fn distinct(mut profiles: Vec<Profile>) -> Vec<Profile> {
    profiles.sort_by(|a, b| a.least().total_cmp(&b.least()));
    let mut kept: Vec<Profile> = Vec::new();
    for profile in profiles {
        if !kept.iter().any(|p| p.structure == profile.structure && p.alike(&profile)) {
            kept.push(profile);
        }
    }
    kept
}

/// Rising widths with one more among them.
fn with_width(widths: &[f64], d: f64) -> Vec<f64> {
    let mut widths = widths.to_vec();
    let place = widths.partition_point(|w| *w < d);
    if widths.get(place) != Some(&d) {
        widths.insert(place, d);
    }
    widths
}

/// The whole profile of a family, from a coarse look.
pub(crate) fn full_profile(search: &Search, look: &Profile) -> Profile {
    let range = search.record.range;
    let fine = [0.0, 0.01, 0.02, 0.05, 0.1, 0.17, 0.25, 0.33, 0.41, 0.5, 0.58, 0.66, 0.74, 0.82, 0.88, 0.94, 1.0];
    let mut seeds: Vec<Seed> =
        [look.best, 0].map(|i| &look.points[i]).map(|p| Seed { theta: p.theta, d: p.lost.d }).to_vec();
    seeds.dedup();
    let gap = BacklashModel::gap(0.0, search.record.stretches.len());
    let widths = with_width(&fine.map(|part| part * range), look.points[look.best].lost.d);
    let mut profile = Profile::over(search, &widths, &gap, &seeds, 4, FINE_TOLERANCE);
    // A gap that is narrow against all that OP does has a narrow valley.
    let fine = (0.05 * profile.points[profile.best].lost.d).clamp(0.0005 * range, 0.004 * range);
    profile.refine(search, 2, fine);
    profile
}

/// Allowed distance of a family behind the best after a coarse look [−2·ln L].
pub(crate) fn screening_margin(count: usize) -> f64 {
    2.0 * (NEARLY_AS_GOOD * count as f64).min(100.0) + 20.0
}

/// The best of profiles.
pub(crate) fn best_of(profiles: &[Profile]) -> &Profile {
    profiles.iter().min_by(|a, b| a.least().total_cmp(&b.least())).expect("there are families")
}
