//! The record as one whose load walks, as one whose load steps, and as one whose load goes along lines.

use crate::data::backlash_model::BacklashModel;
use crate::data::cells::Cells;
use crate::decide::thresholds::{ALONG_OP, ALONG_OP_WITHOUT, AS_GOOD, BELIEVED, CYCLES, LR_MIN, LR_SEEN};
use crate::loads::changes::{Marked, choose_family, detect_changes, marked_anew, with_large_steps, without_a_gap};
use crate::loads::plausible::{all_large, beside_many_traversals, few, plausible};
use crate::search::likelihood::{Point, Search};
use crate::search::profile::{FINE_TOLERANCE, Profile, Seed};
use crate::search::screen::{MOST_FAMILIES, PILOT, best_of, full_profile, pilot, screen, screening_margin};
use glapp_core::Model;
use glapp_model::structure::{Load, Noise, Structure, Theta};
use rayon::prelude::*;

/// Kinds of sticking that are followed.
const MOST_KINDS: usize = 3;
/// Model of a record under one belief about the load.
pub(crate) struct Hypothesis {
    /// The record, with the steps of the load that are believed in.
    pub(crate) record: Cells,
    /// The whole profiles of a gap in the families that predict nearly as well as the best, best first.
    pub(crate) profiles: Vec<Profile>,
    /// Whether a family that was looked at sees a gap.
    pub(crate) dissent: bool,
    /// The likelihood over d for valves that stick, nearest first, and their family.
    pub(crate) sticking: Vec<Profile>,
    pub(crate) sticks_in: Structure,
    /// Cost of the best of all, and of the best without a gap, with parameters and steps [−2·ln L].
    pub(crate) cost: f64,
    pub(crate) without: f64,
}

impl Hypothesis {
    /// Made from a screening of the record; `whole`: the whole profile of its best look, where it is known; `clue` as
    /// in [`sticking_profiles`].
    fn new(
        record: Cells,
        mut looks: Vec<Profile>,
        whole: Option<Profile>,
        clue: Option<&(Structure, Point)>,
        sign: f64,
    ) -> Self {
        let of = |structure| Search { record: &record, structure, sign };
        let leading = best_of(&looks);
        let (least, leads) = (leading.least(), leading.structure);
        // No gap in any family, also in one that a gap fits badly: it costs what it costs.
        let plain = looks.iter().map(|p| p.penalised() + p.lr_no_gap()).fold(f64::INFINITY, f64::min);
        looks.retain(|p| p.least() < least + screening_margin(record.count));
        looks.sort_by(|a, b| a.penalised().total_cmp(&b.penalised()));
        looks.truncate(MOST_FAMILIES);
        let wholly = |look: &Profile| {
            let known = whole.clone().filter(|_| look.structure == leads && look.least() == least);
            known.unwrap_or_else(|| full_profile(&of(look.structure), look))
        };
        let mut profiles: Vec<Profile> = looks.par_iter().map(wholly).collect();
        profiles.sort_by(|a, b| a.penalised().total_cmp(&b.penalised()));
        let dissent = profiles.iter().any(|p| p.lr_no_gap() > LR_SEEN);
        let least = profiles[0].penalised();
        profiles.retain(|p| p.penalised() < least + BELIEVED + 2.0 * AS_GOOD * record.freedom());
        let sticks_in = clue.map_or(profiles[0].structure, |(structure, _)| *structure);
        let sticking = sticking_profiles(&of(sticks_in), &profiles[0], clue);
        let best = &profiles[0].points[profiles[0].best];
        let stuck = sticking.first().map_or(f64::INFINITY, Profile::penalised);
        let price = of(profiles[0].structure).price_of_changes(best.kp);
        let cost = least.min(stuck) + price;
        let none = profiles.iter().map(|p| p.penalised() + p.lr_no_gap()).fold(plain, f64::min);
        Self { record, dissent, sticking, sticks_in, cost, without: none + price, profiles }
    }

    /// Made from marked steps and the family that goes with them; None where they are not those of a load, or cost more
    /// than `rival`. Steps too few to tell that the load stands still between them are those of a load that walks.
    fn with_marks(with: Marked, structure: Structure, seeds: &[Theta], sign: f64, rival: f64) -> Option<Self> {
        if few(&with.record, Load::of(structure)) {
            Self::with_changes(with, structure, seeds, sign, rival)
        } else {
            Self::with_few_steps(with, structure, seeds, sign, rival)
        }
    }

    /// As [`Self::with_marks`], of steps of a load that stands still between them, or of bends.
    fn with_changes(with: Marked, structure: Structure, seeds: &[Theta], sign: f64, rival: f64) -> Option<Self> {
        // The whole profiles may bring a little more.
        if with.cost > rival + 10.0 {
            return None;
        }
        let clue = (structure, with.point);
        let seeds = [&[structure.as_pilot(&clue.1.theta)], seeds].concat();
        let looked = screen(&with.record, &seeds, sign, clue.1.lost.d, Load::of(structure));
        let marked = Self::new(with.record, looked, None, Some(&clue), sign);
        let (structure, point) = marked.best();
        let best = Marked { record: marked.record.clone(), point: point.clone(), cost: marked.cost };
        (marked.cost <= rival && plausible(&best, structure, sign, ALONG_OP)).then_some(marked)
    }

    /// Made from so few marked steps that each may be the valve, under a load that walks; None where they are neither larger than the
    /// gap nor few beside its traversals.
    fn with_few_steps(with: Marked, structure: Structure, seeds: &[Theta], sign: f64, rival: f64) -> Option<Self> {
        let may_be = || all_large(&with, structure, sign) || beside_many_traversals(&with, structure);
        if with.cost > rival + 10.0 || !may_be() {
            return None;
        }
        let seeds = [&[structure.as_pilot(&with.point.theta)], seeds].concat();
        let looked = screen(&with.record, &seeds, sign, with.point.lost.d, Load::Levels);
        Some(Self::new(with.record, looked, None, None, sign)).filter(|marked| marked.cost <= rival)
    }

    /// Cost of no gap, begun anew from the process that suits it best beside the steps that are believed in: with steps of its own where
    /// they may be those of a load, and with those [−2·ln L].
    fn without_anew(&self, sign: f64) -> f64 {
        let Profile { structure, points, .. } = &self.profiles[0];
        if !few(&self.record, Load::of(*structure)) {
            return f64::INFINITY;
        }
        let ([own, believed], family) = without_a_gap(&self.record, *structure, sign, &points[0]);
        let cost =
            if plausible(&own, family, sign, ALONG_OP_WITHOUT) { own.cost.min(believed.cost) } else { believed.cost };
        cost + 2.0 * family.parameters() as f64
    }

    /// Likelihood ratio of a process that does not answer, in the best family of a gap.
    pub(crate) fn answers(&self, sign: f64) -> f64 {
        let Profile { structure, points, best } = &self.profiles[0];
        let Point { theta, lost, cost, .. } = &points[*best];
        let search = Search { record: &self.record, structure: *structure, sign };
        search.cost(search.at(theta, &self.record.positions(lost)).sum_without[0]) - cost
    }

    /// The best of all points, and its family.
    fn best(&self) -> (Structure, &Point) {
        let gap = &self.profiles[0];
        match self.sticking.first() {
            Some(stuck) if stuck.penalised() < gap.penalised() => (self.sticks_in, &stuck.points[stuck.best]),
            _ => (gap.structure, &gap.points[gap.best]),
        }
    }
}

/// Looks at the record as one whose load walks, with its large steps marked. What is left of a step widens the walk for all
/// the record, and with it the interval of d: so where steps were found it is looked again. With the whole profile of the best look,
/// where it is known.
fn with_walking_load(record: &Cells, seeds: &[Theta], sign: f64) -> (Cells, Vec<Profile>, Option<Profile>) {
    let mut record = record.clone();
    let mut looked = screen(&record, seeds, sign, 0.0, Load::Levels);
    let mut least = f64::INFINITY;
    for _ in 0..3 {
        let leading = best_of(&looked);
        let search = Search { record: &record, structure: leading.structure, sign };
        let whole = full_profile(&search, leading);
        let best = &whole.points[whole.best];
        least = least.min(best.cost + search.price_of_changes(best.kp));
        let marked = with_large_steps(&search, best);
        if marked.record.same_changes(&record) || marked.cost > least - 1.0 {
            return (record, looked, Some(whole));
        }
        least = marked.cost;
        let mut seeds = pilot(&marked.record, sign).seeds;
        seeds.insert(0, leading.structure.as_pilot(&marked.point.theta));
        looked = screen(&marked.record, &seeds, sign, 0.0, Load::Levels);
        record = marked.record;
    }
    (record, looked, None)
}

/// The record as one whose load walks, as one whose load stands still between many small steps, and as one whose load goes along
/// lines: the likeliest, and what no gap costs in any. `done` takes the share that is done.
pub(crate) fn hypotheses(record: &Cells, seeds: &[Theta], sign: f64, done: &dyn Fn(f64)) -> (Hypothesis, f64) {
    let (walking, looked, whole) = with_walking_load(record, seeds, sign);
    done(0.2);
    let mut believed = Hypothesis::new(walking, looked, whole, None, sign);
    let point = &believed.profiles[0].points[believed.profiles[0].best];
    let starts = [&[believed.profiles[0].structure.as_pilot(&point.theta)], seeds].concat();
    let mut without = believed.without;
    // The least that anything with a gap was found to cost, whether it is believed or not.
    let mut least = believed.cost;
    let mut hints = Vec::new();
    for (load, begins) in [(Load::Levels, 0.3), (Load::Lines, 0.6)] {
        done(begins);
        // A load that steps does not go along lines; unless those steps are all that PV answers, as under lines in a loop that is
        // tuned for its lag.
        let bends = || {
            let explained = least < believed.cost - 10.0;
            believed.profiles[0].structure.noise == Noise::Slope
                || !few(&believed.record, Load::Levels) && (explained || without - believed.cost > LR_SEEN)
                || believed.answers(sign) < LR_MIN
        };
        if load == Load::Lines && !bends() {
            continue;
        }
        let Some((with, none)) = detect_changes(record, &starts, sign, load, &hints) else {
            continue;
        };
        if load == Load::Levels {
            hints = vec![with.record.clone(), none.record.clone()];
        }
        let rival = least;
        let pilot = Structure { noise: load.noise(), ..PILOT };
        let price = 2.0 * pilot.parameters() as f64;
        let none = plausible(&none, pilot, sign, ALONG_OP_WITHOUT).then_some(none.cost + price);
        if load == Load::Lines {
            // A load along lines is one that any gap has to beat, with the steps that suit it best.
            least = least.min(with.cost + price);
            without = none.map_or(without, |none| without.min(believed.cost + none - least));
        }
        let (with, structure) = choose_family(record, with, sign, load);
        if load == Load::Levels {
            least = least.min(with.cost + price);
        }
        let Some(marked) = Hypothesis::with_marks(with, structure, seeds, sign, rival) else {
            continue;
        };
        without = without.min(marked.without).min(none.unwrap_or(without));
        least = least.min(marked.cost);
        believed = marked;
    }
    done(0.9);
    // A width that was looked at early keeps the steps that make up for it; so does no gap.
    while believed.record.changes() > 0 && without - believed.cost > LR_SEEN {
        without = without.min(believed.without_anew(sign));
        if without - believed.cost <= LR_SEEN {
            break;
        }
        let (structure, point) = believed.best();
        let (with, structure) = marked_anew(&believed.record, structure, sign, point);
        let rival = believed.cost - 2.0;
        let Some(marked) = Hypothesis::with_marks(with, structure, seeds, sign, rival) else { break };
        without = without.min(marked.without);
        believed = marked;
    }
    (believed, without)
}

/// The likelihood over d for the valves that stick that come nearest, best first; none where OP goes through no width often
/// enough. `clue`: a family and its point that are known to be good.
fn sticking_profiles(search: &Search, gap: &Profile, clue: Option<&(Structure, Point)>) -> Vec<Profile> {
    let record = search.record;
    let often = |d: &f64| record.traversals(*d).iter().all(|n| *n >= CYCLES);
    let parts = [0.02, 0.03, 0.045, 0.07, 0.1, 0.14, 0.2, 0.27, 0.35, 0.45, 0.6, 0.8];
    let known = clue.map(|(_, point)| point.lost.d);
    let near = known.into_iter().flat_map(|d| [0.8 * d, d, 1.2 * d]);
    let widths: Vec<f64> = parts.iter().map(|part| part * record.range).chain(near).filter(often).collect();
    let shares = [0.15, 0.3, 0.5, 0.75, 1.0];
    let kinds = [Model::Kano, Model::He].into_iter().flat_map(|model| shares.map(|share| (model, share)));
    let mut probed: Vec<Point> = kinds
        .collect::<Vec<_>>()
        .into_par_iter()
        .filter_map(|(model, share)| {
            let probe = |d: f64| {
                let near = clue.map_or_else(|| gap.near(d), |(_, point)| point);
                search.descend(
                    near.theta,
                    &BacklashModel { d, share, model, ..near.lost.clone() },
                    1,
                    0.1,
                    f64::INFINITY,
                )
            };
            widths.iter().map(|d| probe(*d)).min_by(|a, b| a.cost.total_cmp(&b.cost))
        })
        .collect();
    probed.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    // A valve that only sticks is a verdict of its own: its best kind is always followed.
    let sticks_only = probed.iter().position(|p| p.lost.share >= 1.0);
    let mut place = 0;
    probed.retain(|_| {
        place += 1;
        place <= MOST_KINDS || Some(place - 1) == sticks_only
    });
    let around = [0.5, 0.65, 0.8, 0.9, 1.0, 1.1, 1.2, 1.4, 1.7, 2.1];
    let mut found: Vec<Profile> = probed
        .par_iter()
        .map(|point| {
            let widths: Vec<f64> =
                around.iter().map(|part| part * point.lost.d).filter(|d| *d < record.range).collect();
            let mut profile = Profile::over(
                search,
                &widths,
                &point.lost,
                &[Seed { theta: point.theta, d: point.lost.d }],
                4,
                FINE_TOLERANCE,
            );
            profile.refine(search, 1, 0.02 * point.lost.d);
            profile
        })
        .collect();
    found.sort_by(|a, b| a.least().total_cmp(&b.least()));
    found
}
