//! From profiles to an answer: width, interval, and whether there is a gap at all.

use crate::jumps::with_jumps;
use crate::profile::{Profile, RISE, RISE_OF_STICKING, trust};
use crate::record::{Lost, Positions, Record};
use crate::search::{Point, Search, dot, solve};
use crate::structure::{MOST, Noise, Structure, Theta};
use glapp_sim::Model;
use rayon::prelude::*;

/// What is asked.
#[derive(Clone, Debug)]
pub struct Question {
    /// Time between two steps of the record [s].
    pub h: f64,
    /// Sign of the process gain where it is known, else 0.
    pub sign: f64,
    /// Records invented without a gap to find how large the likelihood ratio gets by chance; 0 for none.
    pub bootstrap: usize,
    /// Seed of those.
    pub seed: u64,
}

/// What the record says about the valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// A gap.
    Backlash,
    /// A valve that sticks and jumps, no gap beside it.
    Stiction,
    /// Both.
    Both,
    /// No gap wider than the upper limit.
    Sound,
    /// A gap, wider than the lower limit; OP never went through the whole of it often enough.
    AtLeast,
    /// The record cannot tell.
    CannotTell,
}

/// One family's view.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The family.
    pub structure: Structure,
    /// −2·ln L over that of the best family.
    pub behind: f64,
    /// Best width [OP unit].
    pub d: f64,
    /// Likelihood ratio −2·Δln L of no gap against the best width.
    pub lr_no_gap: f64,
    /// The profile: width [OP unit] and −2·Δln L over this family's best.
    pub profile: Vec<(f64, f64)>,
}

/// A cell of PV beside the best model.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Part of the record, in the order given.
    pub part: usize,
    /// First step of the cell within it.
    pub step: usize,
    /// Mean of PV [PV unit].
    pub pv: f64,
    /// The model's foresight of it, from all that was before [PV unit].
    pub foreseen: f64,
    /// Position of the valve [OP unit].
    pub position: f64,
}

/// The answer.
#[derive(Clone, Debug)]
pub struct Answer {
    /// What the record says.
    pub verdict: Verdict,
    /// Most likely total width [OP unit].
    pub d: f64,
    /// Lower limit, 95 % [OP unit].
    pub low: f64,
    /// Upper limit, 95 % [OP unit]; None where the record gives none.
    pub high: Option<f64>,
    /// Slip jump J [OP unit], 0 for mere backlash.
    pub jump: f64,
    /// Likelihood ratio of no gap: the least over all families that predict PV nearly as well as the best, times `trust`.
    pub lr_no_gap: f64,
    /// What `lr_no_gap` must exceed for a gap, 1 % of records without one do.
    pub lr_needed: f64,
    /// Likelihood ratio of J = 0 against the best J.
    pub lr_no_jump: f64,
    /// Likelihood ratio of a process that does not answer at all.
    pub lr_no_answer: f64,
    /// Share of the likelihood's own information on d that the innovations support, 0 to 1.
    pub trust: f64,
    /// How far −2·ln L may rise within the interval.
    pub rise: f64,
    /// Times that OP goes through the whole width up and down.
    pub traversals: [usize; 2],
    /// Static gain [PV unit/OP unit]; velocity gain [PV unit/(OP unit·s)] of an integrating process.
    pub kp: f64,
    /// The same with its 95 % limits.
    pub kp_limits: (f64, f64),
    /// Dead time [s].
    pub dead_time: f64,
    /// The same with its 95 % limits.
    pub dead_time_limits: (f64, f64),
    /// Lags together: the first-order coefficient of the denominator, behind an integrator if there is one [s].
    pub lag: f64,
    /// The same with its 95 % limits.
    pub lag_limits: (f64, f64),
    /// Whether the process integrates.
    pub integrating: bool,
    /// Standard deviation of what the model does not foresee of PV, a cell ahead [PV unit].
    pub sigma: f64,
    /// Correlation of that with the same a cell before: far from 0 where the model is not of this record.
    pub echo: f64,
    /// Cells of PV that were used, and their length [s].
    pub cells: usize,
    /// Length of a cell [s].
    pub cell: f64,
    /// Widest move of OP within one stretch [OP unit].
    pub range: f64,
    /// Steps of the load that were found and taken out.
    pub load_steps: usize,
    /// The families, best first.
    pub candidates: Vec<Candidate>,
    /// What the best model made of each cell of PV.
    pub seen: Vec<Seen>,
    /// Why the verdict is what it is, a word that `glapp` turns into a sentence.
    pub reason: &'static str,
}

/// Families whose innovations are no more than this larger than the best's (and a −2·ln L of 6) are believed: a gap must
/// show in all of them, and the interval holds all of theirs.
const AS_GOOD: f64 = 0.0035;
/// The same after a coarse look, which may sit beside a narrow valley.
const NEARLY_AS_GOOD: f64 = 0.05;
/// Least cells for an answer.
pub const FEWEST: usize = 50;

/// Fits a record of moderate length: PV and OP at even steps of `question.h`, one pair for each unbroken stretch; NaN in PV
/// is a sample that is missing, OP is without NaN. None where there are fewer than 50 samples or OP never moves.
pub fn fit(parts: &[(&[f64], &[f64])], question: &Question) -> Option<Answer> {
    let (seeds, cell) = look(parts, question.sign)?;
    let raw: usize = parts.iter().map(|(y, _)| y.len()).sum();
    let coarser = raw.div_ceil(MOST_CELLS);
    let times = cell as f64 / coarser as f64;
    let record = Record::new(parts, coarser);
    let seeds: Vec<Theta> = seeds.iter().map(|theta| rescaled(theta, times)).collect();
    (record.count >= FEWEST).then(|| answer(&record, &seeds, question))
}

/// Steps that one fit should hold at most, for its cells to be fine enough for the process: longer records are best cut.
pub fn window(parts: &[(&[f64], &[f64])], sign: f64) -> Option<usize> {
    look(parts, sign).map(|(_, cell)| cell * MOST_CELLS)
}

/// Cells that one fit takes at most.
const MOST_CELLS: usize = 2000;
/// Cells of the first look.
const LOOK_CELLS: usize = 600;

/// How slow the process is: good beginnings, and steps in a cell that is fine enough. Where a look at the whole record is
/// too coarse to see the process, a nearer look at the part in which OP moves most.
fn look(parts: &[(&[f64], &[f64])], sign: f64) -> Option<(Vec<Theta>, usize)> {
    let mut parts = parts.to_vec();
    loop {
        let raw: usize = parts.iter().map(|(y, _)| y.len()).sum();
        let cell = raw.div_ceil(LOOK_CELLS).max(1);
        let record = Record::new(&parts, cell);
        if record.count < FEWEST || record.range.is_nan() || record.range <= 0.0 {
            return None;
        }
        let (mut seeds, slow) = pilot(&record, sign);
        if cell == 1 || slow > 4.0 {
            let fine = ((cell as f64 * slow / 12.0) as usize).clamp(1, cell);
            seeds.iter_mut().for_each(|theta| *theta = rescaled(theta, cell as f64 / fine as f64));
            return Some((seeds, fine));
        }
        let steps = LOOK_CELLS * (cell / 4).max(1);
        let pieces = parts.iter().flat_map(|(y, u)| y.chunks(steps).zip(u.chunks(steps)));
        let busiest = pieces.max_by(|a, b| moved(a.1).total_cmp(&moved(b.1)))?;
        parts = vec![busiest];
    }
}

/// How far OP goes up and down in all, counted in steps that are large for it.
fn moved(u: &[f64]) -> f64 {
    let every = u.len().div_ceil(60).max(1);
    let coarse: Vec<f64> = u.iter().step_by(every).copied().collect();
    coarse.windows(2).map(|w| (w[1] - w[0]).abs()).sum()
}

const PILOT: Structure = Structure { lags: 2, integrating: false, noise: Noise::Input };

/// Less than this gained by a step ends a descent of a coarse look, of a whole profile [−2·ln L].
const COARSELY: f64 = 0.3;
const FINELY: f64 = 0.03;
/// Families of which the whole profile is worked out.
const MOST_FAMILIES: usize = 7;
/// Beginnings that are followed.
const MOST_SEEDS: usize = 4;

/// Good beginnings from one family at a few widths, and lags and half the dead time of the best of them
/// together [cells].
fn pilot(record: &Record, sign: f64) -> (Vec<Theta>, f64) {
    let search = Search { record, structure: PILOT, sign };
    let n = record.count as f64;
    let begin = |part: f64, t: f64, dead: f64| {
        let lost = Lost::gap(part * record.range, record.stretches.len());
        search.descend(PILOT.beginning(t, dead), &lost, 8, 0.1, f64::INFINITY)
    };
    let starts = [(1.5, 0.5), (1.5, 5.0), (10.0, 0.5), (10.0, 5.0), (40.0, 15.0)];
    let mut points: Vec<Point> = [0.0, 0.3, 0.6, 0.85]
        .into_par_iter()
        .flat_map_iter(|part| starts.map(|(t, dead)| (part, t, dead)))
        .filter(|(_, t, dead)| *t < n / 8.0 && *dead < n / 12.0)
        .map(|(part, t, dead)| begin(part, t, dead))
        .collect();
    points.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut seeds: Vec<Theta> = Vec::new();
    for point in &points {
        if seeds.len() < MOST_SEEDS && !seeds.iter().any(|s| PILOT.alike(s, &point.theta)) {
            seeds.push(point.theta);
        }
    }
    let theta = points[0].theta;
    (seeds, 2.0 * theta[0].exp() * theta[1].exp().max(1.0) + 0.5 * theta[2])
}

/// The pilot's parameters for cells `finer` times shorter.
fn rescaled(theta: &Theta, finer: f64) -> Theta {
    let mut scaled = *theta;
    scaled[0] += finer.ln();
    scaled[2] *= finer;
    // Variance of the load a cell falls with the cell, that of the noise rises.
    scaled[3] -= 2.0 * finer.ln();
    scaled
}

/// A beginning for `structure` from the pilot's parameters.
fn adapted(structure: Structure, pilot: &Theta) -> Theta {
    let (t, zeta, dead, q) = (pilot[0].exp(), pilot[1].exp(), pilot[2], pilot[3]);
    let mut theta = structure.beginning((2.0 * t * zeta).max(0.1), dead);
    if structure.lags > 1 {
        (theta[0], theta[1]) = (pilot[0], pilot[1]);
    }
    if structure.lags == 3 {
        theta[2] = pilot[0] - 2.0;
    }
    let noise = structure.lags + 1;
    match structure.noise {
        Noise::Input => theta[noise] = q,
        Noise::Output => theta[noise] = q.clamp(-6.0, 6.0),
        Noise::Both => (theta[noise], theta[noise + 1]) = (q, -4.0),
    }
    theta
}

/// The parameters of a simple family's best point for the family of the same process with both disturbances.
fn widened(structure: Structure, simple: &Profile) -> Theta {
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
fn looks(record: &Record, seeds: &[Theta], sign: f64) -> Vec<Profile> {
    let of = |structure| Search { record, structure, sign };
    let coarse = [0.0, 0.015, 0.05, 0.15, 0.3, 0.45, 0.6, 0.75, 0.88, 1.0].map(|part| part * record.range);
    let gap = Lost::gap(0.0, record.stretches.len());
    let begin = |structure: Structure| {
        // The seeds are of two lags; the other families start from the best of them.
        let most = if structure == PILOT { MOST_SEEDS } else { 2 - usize::from(structure.integrating) };
        seeds.iter().take(most).map(move |seed| (structure, adapted(structure, seed)))
    };
    let families = [Structure::with(Noise::Input), Structure::with(Noise::Output)].concat();
    let simple: Vec<Profile> = families
        .into_iter()
        .flat_map(begin)
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|(structure, begin)| Profile::over(&of(structure), &coarse, &gap, &[begin], 4, COARSELY))
        .collect();
    let simple = distinct(simple);
    let promising = leading(&simple).least() + room(record.count);
    let both: Vec<Profile> = simple
        .par_iter()
        .filter(|p| p.least() < promising)
        .filter_map(|p| {
            let structure = Structure { noise: Noise::Both, ..p.structure };
            let both = Profile::over(&of(structure), &coarse, &gap, &[widened(structure, p)], 3, COARSELY);
            // Where the second disturbance is worth nothing it is the same family once more.
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

/// The whole profile of a family, from a coarse look.
fn whole(search: &Search, look: &Profile) -> Profile {
    let range = search.record.range;
    let fine = [0.0, 0.01, 0.02, 0.05, 0.1, 0.17, 0.25, 0.33, 0.41, 0.5, 0.58, 0.66, 0.74, 0.82, 0.88, 0.94, 1.0];
    let mut seeds = vec![look.points[look.best].theta, look.points[0].theta];
    seeds.dedup();
    let gap = Lost::gap(0.0, search.record.stretches.len());
    let mut profile = Profile::over(search, &fine.map(|part| part * range), &gap, &seeds, 4, FINELY);
    // A gap that is narrow against all that OP does has a narrow valley.
    let fine = (0.05 * profile.points[profile.best].lost.d).clamp(0.0005 * range, 0.004 * range);
    profile.refine(search, 2, fine);
    profile
}

/// How far a family may lie behind the best after a coarse look [−2·ln L].
fn room(count: usize) -> f64 {
    2.0 * (NEARLY_AS_GOOD * count as f64).min(100.0) + 20.0
}

/// The best of profiles.
fn leading(profiles: &[Profile]) -> &Profile {
    profiles.iter().min_by(|a, b| a.least().total_cmp(&b.least())).expect("there are families")
}

/// Marks where the load jumped. What is left of a jump widens the walk of the load for all the record, and with it the
/// interval of d: so when jumps were found it is looked again. With the last look at all families the whole profile of the
/// best.
fn without_jumps(record: &Record, seeds: &[Theta], sign: f64) -> (Record, Vec<Profile>, Profile) {
    let mut record = record.clone();
    let mut looked = looks(&record, seeds, sign);
    let mut least = f64::INFINITY;
    for round in 0.. {
        let leading = leading(&looked);
        let search = Search { record: &record, structure: leading.structure, sign };
        let best = whole(&search, leading);
        least = least.min(best.least() + search.surprise(&best.points[best.best]));
        let (marked, point, cost) = with_jumps(&search, &best.points[best.best]);
        if round == 3 || marked.same_jumps(&record) || cost > least - 1.0 {
            return (record, looked, best);
        }
        least = cost;
        let mut seeds = pilot(&marked, sign).0;
        seeds.insert(0, leading.structure.as_pilot(&point.theta));
        looked = looks(&marked, &seeds, sign);
        record = marked;
    }
    unreachable!("the rounds end")
}

fn answer(record: &Record, seeds: &[Theta], question: &Question) -> Answer {
    let (record, mut looks, first) = without_jumps(record, seeds, question.sign);
    let record = &record;
    let n = record.freedom();
    let of = |structure| Search { record, structure, sign: question.sign };
    let least = leading(&looks).least();
    // The whole profile for the families that predict nearly as well as the best.
    looks.retain(|p| p.least() < least + room(record.count));
    looks.sort_by(|a, b| a.penalised().total_cmp(&b.penalised()));
    looks.truncate(MOST_FAMILIES);
    let known = leading(&looks).least();
    let mut profiles: Vec<Profile> = looks
        .par_iter()
        .map(|look| if look.least() == known { first.clone() } else { whole(&of(look.structure), look) })
        .collect();
    profiles.sort_by(|a, b| a.penalised().total_cmp(&b.penalised()));
    let least = profiles[0].penalised();
    let raw_lr = |p: &Profile| p.points[0].cost - p.least();
    let dissent = profiles.iter().any(|p| raw_lr(p) > PLAIN);
    profiles.retain(|p| p.penalised() < least + 6.0 + 2.0 * AS_GOOD * n);

    let search = of(profiles[0].structure);
    let mut best = profiles[0].points[profiles[0].best].clone();
    let here = search.at(&best.theta, &record.positions(&best.lost));
    let lr_no_answer = search.cost(here.sum_without[0]) - best.cost;
    let mut sticking = sticking(&search, &profiles[0]);
    // What a slip jump explains beyond a gap; what a gap explains beyond nothing is at least as much.
    let stuck = sticking.first().map(|p| p.points[p.best].clone());
    let lr_no_jump = stuck.as_ref().map_or(0.0, |stuck| (best.cost - stuck.cost).max(0.0));
    let tells = lr_no_jump > JUMP;
    if let Some(stuck) = stuck
        && lr_no_jump > SLIPS
    {
        best = stuck;
    }
    let trusted = trust(&search, &best, 0.005 * record.range).max(LEAST_TRUST);
    let lr_no_gap = profiles.iter().map(raw_lr).fold(f64::INFINITY, f64::min) + (lr_no_jump - JUMP).max(0.0);
    let lr_no_gap = lr_no_gap * trusted;
    let traversals = record.traversals(best.lost.d);
    let plain = if traversals.iter().all(|n| *n >= CYCLES) { PLAIN } else { PLAIN_IF_SELDOM };
    let lr_needed = if question.bootstrap > 0 && lr_no_gap > plain && lr_no_gap < 100.0 {
        // The invented records' innovations are alike everywhere: their ratio is to be held against the one before τ.
        plain.max(by_chance(&search, &profiles[0].points[0], question) * trusted)
    } else {
        plain
    };
    let fine = 0.001 * record.range;
    let mut spread = Vec::new();
    if !tells {
        for profile in &mut profiles {
            let from = profile.least();
            spread.extend(profile.within(&of(profile.structure), from, RISE / trusted, fine));
        }
    }
    let certain = spread.iter().all(|s| s.0 <= 0.0);
    // A valve with another slip jump has another width, and may be as likely.
    for profile in &mut sticking {
        let beyond = profile.points.last().map(|p| p.lost.d);
        let limits = profile.within(&search, best.cost, RISE_OF_STICKING / trusted, fine);
        spread.extend(limits.map(|(low, high)| (low, high.or(beyond))));
    }
    let sticks_only = |p: &&Profile| p.points[p.best].lost.share >= 1.0;
    let jumps_whole = sticking.iter().filter(sticks_only).any(|p| p.least() < best.cost + SLIPS);
    let low = (spread.iter().map(|s| s.0).fold(f64::INFINITY, f64::min) - record.resolution()).max(0.0);
    let high = spread.iter().map(|s| s.1).try_fold(0.0, |high, h| h.map(|h| f64::max(high, h)));
    let positions = record.positions(&best.lost);
    let final_state = search.at(&best.theta, &positions);
    let residual = final_state.lane(0);
    let echo = dot(&residual[1..], &residual[..residual.len() - 1]) / final_state.sum[0].max(1e-300);
    let (verdict, reason) = judge(&Evidence {
        echo,
        d: best.lost.d,
        often: {
            let least = if lr_no_gap > PLAIN_IF_TWICE { 2 } else { CYCLES };
            record.traversals(low).iter().all(|n| *n >= least)
        },
        lr_no_gap,
        lr_needed,
        lr_no_answer,
        low,
        high,
        range: record.range,
        tells,
        jumps_whole,
        dissent: dissent || !certain,
    });
    let h = question.h * record.cell as f64;
    let per_cell = if search.structure.integrating { 1.0 / h } else { 1.0 };
    let kp = best.kp * per_cell;
    let spread = 1.96 * kp.abs() / (lr_no_answer * trusted).max(1e-9).sqrt();
    let variance = final_state.sum[0] / n / trusted;
    let errors = Errors::new(&search, &best.theta, &positions, variance);
    let (dead_time, dead_error) = errors.of(|theta| theta[search.structure.dead_time_at()] * h);
    let (lag, lag_error) = errors.of(|theta| search.structure.lag(theta) * h);
    let around = |x: f64, error: f64| ((x - 1.96 * error).max(0.0), x + 1.96 * error);
    let sigma = (final_state.sum[0] / n).sqrt();
    Answer {
        verdict,
        d: best.lost.d,
        low,
        high: high.map(|high| high + 3.0 * record.resolution()),
        jump: best.lost.jump(),
        lr_no_gap,
        lr_needed,
        lr_no_jump,
        lr_no_answer,
        trust: trusted,
        rise: RISE / trusted,
        traversals,
        kp,
        kp_limits: (kp - spread, kp + spread),
        dead_time,
        dead_time_limits: around(dead_time, dead_error),
        lag,
        lag_limits: around(lag, lag_error),
        integrating: search.structure.integrating,
        sigma,
        echo,
        cells: record.count,
        cell: h,
        range: record.range,
        load_steps: record.jumps(),
        candidates: profiles
            .iter()
            .map(|p| Candidate {
                structure: p.structure,
                behind: p.penalised() - least,
                d: p.points[p.best].lost.d,
                lr_no_gap: raw_lr(p),
                profile: p.points.iter().map(|point| (point.lost.d, point.cost - p.least())).collect(),
            })
            .collect(),
        seen: seen(record, &positions, &residual),
        reason,
    }
}

/// What the likelihood ratio of no gap must exceed at least. Half a chi-square with one degree of freedom (d = 0 lies at the
/// border of what d can be) exceeds 20 once in 200 000 records; loads that are no random walk and real innovations are not
/// that tame.
const PLAIN: f64 = 12.0;
/// The same where OP went through the width fewer than [`CYCLES`] times each way: few break-aways may look like anything.
const PLAIN_IF_SELDOM: f64 = 25.0;
/// The same where twice each way is often enough for a width with two limits.
const PLAIN_IF_TWICE: f64 = 100.0;
/// The same for the slip jump.
const JUMP: f64 = 20.0;
/// What a slip jump must bring to be taken into the most likely width: it has a size, a kind and a width of its own.
const SLIPS: f64 = 4.0;
/// A lower limit less than this part of the most likely width is none.
const LEAST_LOW: f64 = 0.1;
/// Greatest correlation of innovations with those a cell before: no model that leaves more of PV unexplained is believed.
const MOST_ECHO: f64 = 0.4;
/// Kinds of sticking that are followed.
const MOST_KINDS: usize = 3;
/// Traversals each way of a width without which no slip jump is looked for.
const CYCLES: usize = 5;
/// Less trust than this is not believed: it rests on the few cells that matter for d.
const LEAST_TRUST: f64 = 0.4;

/// The threshold of the likelihood ratio from records that the best model without a gap invents: innovations drawn
/// from its own, OP as recorded.
fn by_chance(search: &Search, without: &Point, question: &Question) -> f64 {
    let record = search.record;
    let positions = record.positions(&without.lost);
    let here = search.at(&without.theta, &positions);
    let residual = here.lane(0);
    // Innovations over √S: the record's own, in units of which S is told.
    let scale = 1.0 / here.scale[0];
    let widths: Vec<f64> =
        [0.0, 0.03, 0.08, 0.15, 0.25, 0.35, 0.5, 0.65, 0.8, 0.95].map(|part| part * record.range).to_vec();
    let mut ratios: Vec<f64> = (0..question.bootstrap)
        .into_par_iter()
        .map(|i| {
            let mut state = question.seed.wrapping_add(0x9e37_79b9_7f4a_7c15u64.wrapping_mul(i as u64 + 1));
            let mut draw = || {
                state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
                let mut z = state;
                z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
                z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
                let at = ((z ^ (z >> 31)) % residual.len() as u64) as usize;
                residual[at] * scale
            };
            let invented: Vec<Vec<f64>> = record
                .stretches
                .iter()
                .zip(&positions)
                .map(|(s, v)| {
                    let kp_v: Vec<f64> = v.iter().map(|v| v * without.kp).collect();
                    search.structure.invent(&without.theta, &s.y, &s.jumps, &kp_v, &mut draw)
                })
                .collect();
            let record = record.with(invented);
            let search = Search { record: &record, ..*search };
            let profile = Profile::over(&search, &widths, &without.lost, &[without.theta], 6, FINELY);
            (profile.points[0].cost - profile.least()).max(0.0)
        })
        .collect();
    ratios.sort_by(f64::total_cmp);
    let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
    let tail = ratios[(ratios.len() * 99 / 100).min(ratios.len() - 1)];
    // Half a chi-square with one degree of freedom has the mean 1/2 and exceeds 5.41 once in a hundred records.
    tail.max(5.41 * mean / 0.5)
}

/// The likelihood over d for the valves that stick that come nearest, best first; none where OP goes through no width often
/// enough.
fn sticking(search: &Search, gap: &Profile) -> Vec<Profile> {
    let record = search.record;
    let often = |d: &f64| record.traversals(*d).iter().all(|n| *n >= CYCLES);
    let parts = [0.02, 0.03, 0.045, 0.07, 0.1, 0.14, 0.2, 0.27, 0.35, 0.45, 0.6, 0.8];
    let widths: Vec<f64> = parts.iter().map(|part| part * record.range).filter(often).collect();
    let shares = [0.15, 0.3, 0.5, 0.75, 1.0];
    let kinds = [Model::Kano, Model::He].into_iter().flat_map(|model| shares.map(|share| (model, share)));
    let mut probed: Vec<Point> = kinds
        .collect::<Vec<_>>()
        .into_par_iter()
        .filter_map(|(model, share)| {
            let probe = |d: f64| {
                let near = gap.near(d);
                search.descend(near.theta, &Lost { d, share, model, ..near.lost.clone() }, 1, 0.1, f64::INFINITY)
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
            let mut profile = Profile::over(search, &widths, &point.lost, &[point.theta], 4, FINELY);
            profile.refine(search, 1, 0.02 * point.lost.d);
            profile
        })
        .collect();
    found.sort_by(|a, b| a.least().total_cmp(&b.least()));
    found
}

/// The cells of PV with what the model left of each.
fn seen(record: &Record, positions: &Positions, residual: &[f64]) -> Vec<Seen> {
    let cells = record.stretches.iter().zip(positions).flat_map(|(stretch, v)| {
        let there = stretch.y.iter().zip(v).enumerate().filter(|(_, (y, _))| !y.is_nan());
        there.map(|(k, (y, v))| (stretch.part, k * record.cell, *y, *v))
    });
    cells
        .zip(residual)
        .map(|((part, step, pv, position), r)| Seen { part, step, pv, foreseen: pv - r, position })
        .collect()
}

/// Standard errors of the search's parameters, from the curvature of the likelihood.
struct Errors {
    theta: Theta,
    covariance: Vec<Theta>,
}

impl Errors {
    fn new(search: &Search, theta: &Theta, positions: &Positions, variance: f64) -> Self {
        let (_, slopes) = search.slopes(theta, positions);
        let k = slopes.len();
        let mut normal = [[0.0; MOST]; MOST];
        for i in 0..k {
            for j in 0..k {
                normal[i][j] = dot(&slopes[i], &slopes[j]);
            }
            normal[i][i] = normal[i][i] * (1.0 + 1e-9) + 1e-300;
        }
        let column = |j: usize| {
            let mut unit = [0.0; MOST];
            unit[j] = variance;
            solve(normal, unit, k)
        };
        Self { theta: *theta, covariance: (0..k).map(column).collect() }
    }

    /// A quantity of the parameters and its standard error.
    fn of(&self, quantity: impl Fn(&Theta) -> f64) -> (f64, f64) {
        let here = quantity(&self.theta);
        let k = self.covariance.len();
        let slope: Vec<f64> = (0..k)
            .map(|j| {
                let mut moved = self.theta;
                moved[j] += 1e-5;
                (quantity(&moved) - here) / 1e-5
            })
            .collect();
        let variance: f64 =
            (0..k).map(|i| (0..k).map(|j| slope[i] * self.covariance[i][j] * slope[j]).sum::<f64>()).sum();
        (here, variance.max(0.0).sqrt())
    }
}

/// What the verdict rests on.
struct Evidence {
    echo: f64,
    d: f64,
    lr_no_gap: f64,
    lr_needed: f64,
    lr_no_answer: f64,
    low: f64,
    high: Option<f64>,
    range: f64,
    /// Whether OP went through the lower limit often enough for a width.
    often: bool,
    /// Whether a slip jump shows, and whether it may be all of the width.
    tells: bool,
    jumps_whole: bool,
    /// Whether a family that predicts nearly as well as the best sees a gap.
    dissent: bool,
}

fn judge(e: &Evidence) -> (Verdict, &'static str) {
    if e.echo.abs() > MOST_ECHO {
        return (Verdict::CannotTell, "misfit");
    }
    if e.lr_no_answer < 15.0 {
        return (Verdict::CannotTell, "no_answer");
    }
    if e.lr_no_gap <= e.lr_needed {
        return match e.high {
            Some(high) if e.low <= 0.0 && high < 0.25 * e.range && !e.dissent => (Verdict::Sound, "no_gap"),
            _ => (Verdict::CannotTell, "may_be_a_gap"),
        };
    }
    if e.low < LEAST_LOW * e.d {
        return (Verdict::CannotTell, "families_disagree");
    }
    if e.high.is_none() || !e.often {
        return (Verdict::AtLeast, "not_traversed");
    }
    if e.tells {
        return match e.jumps_whole {
            true => (Verdict::Stiction, "jumps"),
            false => (Verdict::Both, "jumps_in_a_gap"),
        };
    }
    (Verdict::Backlash, "gap")
}
