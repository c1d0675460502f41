//! From profiles to an answer: width, interval, and whether there is a gap at all.

use crate::data::cells::{Cells, LostMotion, Positions};
use crate::data::windows::Unit;
use crate::loads::cycle::lr_beside_cycle;
use crate::loads::hypothesis::{CYCLES, Hypothesis, hypotheses};
use crate::model::structure::{MOST, Structure, Theta};
use crate::search::likelihood::{Point, Search, dot, solve};
use crate::search::profile::{Profile, RISE, RISE_OF_STICKING, trust};
use crate::search::screen::FINE_TOLERANCE;
use rayon::prelude::*;

/// What is asked.
#[derive(Clone, Debug)]
pub struct Question {
    /// Sign of the process gain where it is known, else 0.
    pub sign: f64,
    /// Records invented without a gap at most, to find how large the likelihood ratio gets by chance; 0 for none.
    pub bootstrap: usize,
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
pub struct Prediction {
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
    pub predictions: Vec<Prediction>,
    /// Why the verdict is what it is, a word that `glapp` turns into a sentence.
    pub reason: &'static str,
}

impl Answer {
    /// Whether a model of this kind made the record, and PV answers OP in it.
    pub(crate) fn usable(&self) -> bool {
        !matches!(self.reason, "misfit" | "no_answer")
    }

    /// The same where OP's and PV's units were `op` and `pv`, and their zeros lay elsewhere.
    pub(crate) fn in_units(&mut self, op: Unit, pv: Unit) {
        for width in [&mut self.d, &mut self.low, &mut self.jump, &mut self.range] {
            *width *= op.size;
        }
        self.high = self.high.map(|high| high * op.size);
        let gain = pv.size / op.size;
        self.kp *= gain;
        self.kp_limits = (self.kp_limits.0 * gain, self.kp_limits.1 * gain);
        self.sigma *= pv.size;
        for candidate in &mut self.candidates {
            candidate.d *= op.size;
            candidate.profile.iter_mut().for_each(|(d, _)| *d *= op.size);
        }
        for seen in &mut self.predictions {
            (seen.pv, seen.foreseen) = (pv.zero + seen.pv * pv.size, pv.zero + seen.foreseen * pv.size);
            seen.position = op.zero + seen.position * op.size;
        }
    }
}

/// What one window says, with all that is needed to ask it about another width.
pub(crate) struct Fitted {
    pub(crate) answer: Answer,
    pub(crate) record: Cells,
    /// The believed families of a gap, best first, and the valves that stick, nearest first.
    pub(crate) profiles: Vec<Profile>,
    pub(crate) sticking: Vec<Profile>,
    pub(crate) sticks_in: Structure,
    /// What the loads that were looked for leave of the likelihood ratio of no gap.
    pub(crate) lr_of_loads: f64,
    /// By how much more than 1 the ratios of records without a gap scatter.
    pub(crate) by_chance: f64,
    pub(crate) evidence: Evidence,
}

/// Answers for a record of one window, whose steps lie `h` [s] apart, and whose PV a historian may have bent by `bow` [PV unit].
pub(crate) fn fit_record(record: &Cells, seeds: &[Theta], h: f64, bow: f64, question: &Question) -> Fitted {
    let (view, without) = hypotheses(record, seeds, question.sign);
    let lr_no_answer = view.answers(question.sign);
    let Hypothesis { record, mut profiles, dissent, mut sticking, sticks_in, cost, .. } = view;
    let lr_of_loads = without - cost;
    let n = record.freedom();
    let of = |structure| Search { record: &record, structure, sign: question.sign };
    let least = profiles[0].penalised();
    let mut search = of(profiles[0].structure);
    let mut best = profiles[0].points[profiles[0].best].clone();
    // What a slip jump explains beyond a gap; what a gap explains beyond nothing is at least as much.
    let lr_no_jump = sticking.first().map_or(0.0, |stuck| (least - stuck.penalised()).max(0.0));
    let slips = lr_no_jump > JUMP;
    // What a valve that sticks costs where it is as likely as the most likely.
    let mut as_likely = least - 2.0 * sticks_in.parameters() as f64;
    if lr_no_jump > SLIPS {
        best = sticking[0].points[sticking[0].best].clone();
        search = of(sticks_in);
        as_likely = best.cost;
    }
    let trusted = trust(&search, &best, 0.005 * record.range).max(LEAST_TRUST);
    let lr_no_gap =
        profiles.iter().map(Profile::lr_no_gap).fold(f64::INFINITY, f64::min) + (lr_no_jump - JUMP).max(0.0);
    let mut lr_of_loads = lr_of_loads;
    let traversals = record.traversals(best.lost.d);
    let known = record.changes() > 0;
    let asked_of_changes = lr_asked_of_changes(traversals, record.changes());
    let asked = lr_asked(traversals, known).max(asked_of_changes);
    if lr_no_gap.min(lr_of_loads) * trusted > asked {
        let family = &profiles[0];
        let points = [(search.structure, &best), (family.structure, &family.points[0])];
        let beside = lr_beside_cycle(&record, question.sign, &points, &best.lost, without);
        lr_of_loads = beside.map_or(lr_of_loads, |beside| beside.min(lr_of_loads));
    }
    let repeats = lr_of_loads < without - cost;
    let lr_no_gap = lr_no_gap.min(lr_of_loads) * trusted;
    let lr_needed = if question.bootstrap > 0 && lr_no_gap > asked && lr_no_gap < 100.0 {
        // The invented records' innovations are alike everywhere: their ratio is to be held against the one before τ.
        let without = &profiles[0].points[0];
        asked.max(bootstrap_threshold(&of(profiles[0].structure), without, lr_no_gap / trusted, question) * trusted)
    } else {
        asked
    };
    let fine = 0.001 * record.range;
    let wider = if asked_of_changes > 0.0 { BESIDE_MARKS } else { 1.0 } / trusted;
    let mut spread = Vec::new();
    if !slips {
        for profile in &mut profiles {
            let from = profile.least();
            spread.extend(profile.within(&of(profile.structure), from, RISE * wider, fine));
        }
    }
    let certain = spread.iter().all(|s| s.0 <= 0.0);
    // A valve with another slip jump has another width, and may be as likely.
    for profile in &mut sticking {
        let beyond = profile.points.last().map(|p| p.lost.d);
        let limits = profile.within(&of(sticks_in), as_likely, RISE_OF_STICKING * wider, fine);
        spread.extend(limits.map(|(low, high)| (low, high.or(beyond))));
    }
    let sticks_only = |p: &&Profile| p.points[p.best].lost.share >= 1.0;
    let slips_wholly = sticking.iter().filter(sticks_only).any(|p| p.least() < as_likely + SLIPS);
    let low = (spread.iter().map(|s| s.0).fold(f64::INFINITY, f64::min) - record.resolution()).max(0.0);
    let high = spread.iter().map(|s| s.1).try_fold(0.0, |high, h| h.map(|h| f64::max(high, h)));
    let positions = record.positions(&best.lost);
    let final_state = search.at(&best.theta, &positions);
    let residual = final_state.lane(0);
    let noise = (final_state.sum[0] / n).sqrt() / final_state.scale[0];
    let echo = echo(&residual);
    let reaches = |lost: &LostMotion| record.reach(lost);
    let at_low = if low > 0.0 { reaches(&LostMotion { d: low, ..best.lost.clone() }) / low } else { 1.0 };
    let fast = search.structure.settles(&best.theta) * (record.cell as f64) < COARSE;
    let slowly = best.lost.d >= SLOWLY * record.travel();
    // PV stands still while OP goes through the gap: no load follows OP so closely, unless most of each swing is lost.
    let dwells = fast && slowly && lr_no_gap > PLAIN_IF_SELDOM && 2.0 * best.lost.d < record.range;
    let evidence = Evidence {
        echo,
        d: best.lost.d,
        // A model whose valve hardly moves is a step of PV at a time and of a size that are free.
        immobile: (reaches(&best.lost) / best.lost.d.max(1e-300)).min(at_low) < STIRS,
        coarse: fast && (slips || !slowly),
        noisy: !search.structure.integrating && (best.kp * best.lost.d).abs() < NOISY * noise,
        traversed: often(lr_no_gap, record.traversals(low), traversals),
        one_way: traversals.contains(&0),
        changes_known: known,
        lr_no_gap,
        lr_needed,
        lr_no_answer,
        low,
        high,
        range: record.range,
        slips,
        slips_wholly,
        dissent: dissent || !certain,
        periodic_load: repeats,
        // Steps and bends of the load that were found tell what drives OP, where there are enough of them. A process slower than
        // the swing nearly integrates, and swings with a gap; not under a load that steps.
        even_swing: lr_no_gap < PLAIN_IF_SWINGS
            && 2 * record.changes() < traversals[0] + traversals[1]
            && !dwells
            && record.swing(best.lost.d).is_some_and(|(mean, spread)| {
                let quick = search.structure.lag(&best.theta) * (record.cell as f64) < mean;
                spread < EVEN && (known || quick && !search.structure.integrating)
            }),
        drawn: LINED * bow / best.kp.abs().max(1e-300),
    };
    let (verdict, reason) = judge(&evidence);
    let h = h * record.cell as f64;
    let per_cell = if search.structure.integrating { 1.0 / h } else { 1.0 };
    let kp = best.kp * per_cell;
    let spread = 1.96 * kp.abs() / (lr_no_answer * trusted).max(1e-9).sqrt();
    let variance = final_state.sum[0] / n / trusted;
    let errors = StandardErrors::new(&search, &best.theta, &positions, variance);
    let (dead_time, dead_error) = errors.of(|theta| theta[search.structure.dead_time_at()] * h);
    let (lag, lag_error) = errors.of(|theta| search.structure.lag(theta) * h);
    let around = |x: f64, error: f64| ((x - 1.96 * error).max(0.0), x + 1.96 * error);
    let sigma = (final_state.sum[0] / n).sqrt();
    let answer = Answer {
        verdict,
        d: best.lost.d,
        low,
        high: high.map(|high| high + 3.0 * record.resolution()).filter(|_| verdict != Verdict::AtLeast),
        jump: best.lost.jump(),
        lr_no_gap,
        lr_needed: evidence.needed(),
        lr_no_jump,
        lr_no_answer,
        trust: trusted,
        rise: RISE * wider,
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
        load_steps: record.changes(),
        candidates: profiles
            .iter()
            .map(|p| Candidate {
                structure: p.structure,
                behind: p.penalised() - least,
                d: p.points[p.best].lost.d,
                lr_no_gap: p.lr_no_gap(),
                profile: p.points.iter().map(|point| (point.lost.d, point.cost - p.least())).collect(),
            })
            .collect(),
        predictions: predictions(&record, &positions, &residual),
        reason,
    };
    let by_chance = lr_needed / asked;
    Fitted { answer, record, profiles, sticking, sticks_in, lr_of_loads, by_chance, evidence }
}

/// Whether OP went often enough through the lower limit and the most likely width for a width with two limits.
pub(crate) fn often(lr_no_gap: f64, low: [usize; 2], d: [usize; 2]) -> bool {
    let least = if lr_no_gap > PLAIN_IF_TWICE { 2 } else { CYCLES };
    // At the most likely width the count may be one too many.
    low.iter().all(|n| *n >= least) && d.iter().all(|n| *n > least)
}

/// What OP's way through a width asks of the likelihood ratio of no gap; `known`: where a load was found that steps or bends.
pub(crate) fn lr_asked([up, down]: [usize; 2], known: bool) -> f64 {
    if up.min(down) >= CYCLES { PLAIN } else { lr_asked_if_seldom(known) }
}

/// The same where OP went through it too seldom.
fn lr_asked_if_seldom(known: bool) -> f64 {
    if known { PLAIN_IF_SELDOM } else { PLAIN_IF_SELDOM_AND_UNKNOWN }
}

/// What steps and bends of the load ask of it that were marked where there are as many of them as OP went through the width, else
/// 0: they lie where they suit the best width, and make the others look worse than they are.
pub(crate) fn lr_asked_of_changes([up, down]: [usize; 2], marks: usize) -> f64 {
    if marks < up + down { 0.0 } else { PLAIN_OF_A_MARK * marks as f64 }
}

/// What the likelihood ratio of no gap must exceed at least. Half a chi-square with one degree of freedom (d = 0 lies at the
/// border of what d can be) exceeds 20 once in 200 000 records; loads that are no random walk and real innovations are not
/// that tame.
const PLAIN: f64 = 15.0;
/// The same for a bound, and where OP went through the width fewer than [`CYCLES`] times each way: few break-aways may look
/// like anything.
const PLAIN_IF_SELDOM: f64 = 45.0;
/// The same where what the load does is not known either: a step or a bend of it at the right moment looks like a valve that
/// follows late.
const PLAIN_IF_SELDOM_AND_UNKNOWN: f64 = 80.0;
/// The same for each of as many steps or bends of the load as OP went through the width.
const PLAIN_OF_A_MARK: f64 = 8.0;
/// The same where twice each way is often enough for a width with two limits.
const PLAIN_IF_TWICE: f64 = 100.0;
/// The same for the slip jump.
pub(crate) const JUMP: f64 = 20.0;
/// What a slip jump must bring to be taken into the most likely width: it has a size, a kind and a width of its own.
const SLIPS: f64 = 4.0;
/// A lower limit less than this part of the most likely width is none.
const LEAST_LOW: f64 = 0.2;
/// Greatest correlation of innovations with those a cell before: no model that leaves more of PV unexplained is believed.
const MOST_ECHO: f64 = 0.25;
/// Mean sizes of an innovation that it counts as at most there.
const TAME: f64 = 3.0;
/// Where the process settles in fewer steps than this, PV is sampled too seldom to tell a gap from what OP did between them;
const COARSE: f64 = 5.0;
/// unless OP takes as many steps as this to go through the gap.
const SLOWLY: f64 = 25.0;
/// Likelihood ratio of a process that does not answer that a record must have.
pub(crate) const ANSWERS: f64 = 15.0;
/// Spread of the times from one traversal to the next the same way, part of their mean, below which OP swings evenly.
const EVEN: f64 = 0.3;
/// Likelihood ratio of no gap above which OP may swing evenly: three times what loads without a gap have reached.
const PLAIN_IF_SWINGS: f64 = 1000.0;
/// How much more than the bow of its lines a gap must make of a PV that is recorded as lines.
const LINED: f64 = 10.0;
/// Part of the width that the model's valve must move for a width or a bound.
const STIRS: f64 = 0.1;
/// Standard deviations of PV's noise that a gap must make of PV for a width with two limits.
const NOISY: f64 = 3.0;
/// How much further −2·ln L may rise within the interval where as many steps or bends were marked as OP went through the width.
const BESIDE_MARKS: f64 = 3.0;
/// Less trust than this is not believed: it rests on the few cells that matter for d.
const LEAST_TRUST: f64 = 0.4;

/// Where the numbers by chance begin: the same record gets the same answer, in any unit.
const SEED: u64 = 1;
/// Records that are invented at first, and at each further turn.
const INVENTED: usize = 100;

/// The threshold of the likelihood ratio from records that the best model without a gap invents: innovations drawn
/// from its own, OP as recorded. So many that chance does not decide on which side of it `ratio` lies, at most
/// `question.bootstrap`.
fn bootstrap_threshold(search: &Search, without: &Point, ratio: f64, question: &Question) -> f64 {
    let here = search.at(&without.theta, &search.record.positions(&without.lost));
    // Innovations over √S: the record's own, in units of which S is told.
    let scale = 1.0 / here.scale[0];
    let innovations: Vec<f64> = here.lane(0).iter().map(|r| r * scale).collect();
    let mut ratios: Vec<f64> = Vec::new();
    loop {
        let turn = ratios.len()..(ratios.len() + INVENTED).min(question.bootstrap);
        let draw = |i: usize| simulated_lr(search, without, &innovations, Draws::new(SEED, i as u64));
        ratios.par_extend(turn.into_par_iter().map(draw));
        let (threshold, error) = upper_percentile(&mut ratios);
        if ratios.len() >= question.bootstrap || (ratio - threshold).abs() > 3.0 * error {
            return threshold;
        }
    }
}

/// The likelihood ratio of no gap in one record that the model without a gap invents.
fn simulated_lr(search: &Search, without: &Point, innovations: &[f64], mut draws: Draws) -> f64 {
    let positions = search.record.positions(&without.lost);
    let mut draw = || innovations[(draws.next() % innovations.len() as u64) as usize];
    let ys = search.record.stretches.iter().zip(&positions).map(|(s, v)| {
        let kp_v: Vec<f64> = v.iter().map(|v| v * without.kp).collect();
        search.structure.simulate(&without.theta, &s.y, &s.changes, &kp_v, &mut draw)
    });
    let record = search.record.with(ys.collect());
    let search = Search { record: &record, ..*search };
    let with = |theta: Theta, part: f64, unless: f64| {
        let lost = LostMotion { d: part * record.range, ..without.lost.clone() };
        search.from(&[(theta, lost)], 6, FINE_TOLERANCE, unless)
    };
    // The model that made the record is near the best for each width, and most widths are soon plainly worse.
    let mut none = with(without.theta, 0.0, f64::INFINITY);
    loop {
        let mut best = none.clone();
        for part in [0.03, 0.08, 0.15, 0.25, 0.35, 0.5, 0.65, 0.8, 0.95] {
            let point = with(none.theta, part, best.cost);
            if point.cost < best.cost {
                best = point;
            }
        }
        if best.lost.d == 0.0 {
            return 0.0;
        }
        // A better process found with a gap may be the better without one, too.
        let again = with(best.theta, 0.0, none.cost);
        if again.cost > none.cost - FINE_TOLERANCE {
            return none.cost - best.cost;
        }
        none = again;
    }
}

/// What one in a hundred of `ratios` exceeds, and its standard error; their order is lost. Few lie so high: so the fifth
/// of them that is largest, or all above 0 where these are fewer, is taken for the beginning of an exponential tail, as that of a
/// chi-square is. Nor is it less than what a scaled half of a chi-square with the same mean has there.
fn upper_percentile(ratios: &mut [f64]) -> (f64, f64) {
    ratios.sort_by(|a, b| b.total_cmp(a));
    let n = ratios.len() as f64;
    let most = ratios.len() / 5;
    let tail = &ratios[..ratios[..most].iter().filter(|r| **r > 0.0).count()];
    if tail.is_empty() {
        return (0.0, 0.0);
    }
    let (count, from) = (tail.len() as f64, if tail.len() == most { ratios[most] } else { 0.0 });
    let excess = tail.iter().map(|r| r - from).sum::<f64>() / count;
    let quantile = from + excess * (100.0 * count / n).ln().max(0.0);
    // Half a chi-square with one degree of freedom has the mean 1/2 and exceeds 5.41 once in a hundred records.
    let mean = ratios.iter().sum::<f64>() / n;
    let threshold = quantile.max(5.41 * mean / 0.5);
    (threshold, threshold / count.sqrt())
}

/// Numbers by chance, another row of them for each record (SplitMix64: Steele, Lea and Flood 2014).
struct Draws(u64);

impl Draws {
    fn new(seed: u64, record: u64) -> Self {
        // Begun beside each other, two rows would be the same numbers moved by one: where one begins is drawn, too.
        let mut draws = Self(seed);
        let mut begin = Self(draws.next() ^ record);
        Self(begin.next())
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

/// The cells of PV with what the model left of each.
fn predictions(record: &Cells, positions: &Positions, residual: &[f64]) -> Vec<Prediction> {
    let cells = record.stretches.iter().zip(positions).flat_map(|(stretch, v)| {
        let there = stretch.y.iter().zip(v).enumerate().filter(|(_, (y, _))| !y.is_nan());
        there.map(|(k, (y, v))| (stretch.part, k * record.cell, *y, *v))
    });
    cells
        .zip(residual)
        .map(|((part, step, pv, position), r)| Prediction { part, step, pv, foreseen: pv - r, position })
        .collect()
}

/// Standard errors of the search's parameters, from the curvature of the likelihood.
struct StandardErrors {
    theta: Theta,
    covariance: Vec<Theta>,
}

impl StandardErrors {
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

/// Correlation of innovations with those a cell before. What is larger than [`TAME`] times their mean size counts as so large: a
/// sample that is far off leaves one innovation as large and another against it, which is no fault of the model. (Not their
/// median: where PV is held most of them are nothing.)
fn echo(innovations: &[f64]) -> f64 {
    let most = TAME * innovations.iter().map(|e| e.abs()).sum::<f64>() / innovations.len() as f64;
    let tame: Vec<f64> = innovations.iter().map(|e| e.clamp(-most, most)).collect();
    dot(&tame[1..], &tame[..tame.len() - 1]) / dot(&tame, &tame).max(1e-300)
}

/// What the verdict rests on.
#[derive(Clone, Debug)]
pub(crate) struct Evidence {
    pub(crate) echo: f64,
    pub(crate) d: f64,
    pub(crate) lr_no_gap: f64,
    pub(crate) lr_needed: f64,
    pub(crate) lr_no_answer: f64,
    pub(crate) low: f64,
    pub(crate) high: Option<f64>,
    pub(crate) range: f64,
    /// Whether the valve of the best model hardly moves.
    pub(crate) immobile: bool,
    /// Whether OP went through the lower limit often enough for a width.
    pub(crate) traversed: bool,
    /// Whether a load was found that steps or bends.
    pub(crate) changes_known: bool,
    /// Whether OP went through the width one way only.
    pub(crate) one_way: bool,
    /// Whether the samples are too far apart for the process, and for how fast OP goes through the gap or for a jump in it.
    pub(crate) coarse: bool,
    /// Whether PV's noise hides what the gap makes.
    pub(crate) noisy: bool,
    /// Whether a slip jump shows, and whether it may be all of the width.
    pub(crate) slips: bool,
    pub(crate) slips_wholly: bool,
    /// Whether a load that repeats itself leaves the gap less than others do.
    pub(crate) periodic_load: bool,
    /// Whether OP swings to and fro in almost even time, though no gap makes this process do that.
    pub(crate) even_swing: bool,
    /// Width that makes too little of PV for how coarsely the lines bend that PV is recorded as.
    pub(crate) drawn: f64,
    /// Whether a family that predicts nearly as well as the best sees a gap.
    pub(crate) dissent: bool,
}

impl Evidence {
    /// What the likelihood ratio of no gap must exceed: more for a bound.
    pub(crate) fn needed(&self) -> f64 {
        let bound = self.high.is_none() || !self.traversed || self.noisy;
        if bound { self.lr_needed.max(lr_asked_if_seldom(self.changes_known)) } else { self.lr_needed }
    }
}

pub(crate) fn judge(e: &Evidence) -> (Verdict, &'static str) {
    if e.echo.abs() > MOST_ECHO {
        return (Verdict::CannotTell, "misfit");
    }
    if e.lr_no_answer < ANSWERS {
        return (Verdict::CannotTell, "no_answer");
    }
    if e.lr_no_gap <= e.needed() {
        if e.periodic_load {
            return (Verdict::CannotTell, "repeats");
        }
        return match e.high {
            Some(high) if e.low <= 0.0 && high < 0.25 * e.range && !e.dissent => match high < e.drawn {
                true => (Verdict::CannotTell, "lined"),
                false => (Verdict::Sound, "no_gap"),
            },
            _ => (Verdict::CannotTell, "may_be_a_gap"),
        };
    }
    if e.low < LEAST_LOW * e.d {
        return (Verdict::CannotTell, "families_disagree");
    }
    if e.coarse {
        return (Verdict::CannotTell, "coarse");
    }
    if e.even_swing {
        return (Verdict::CannotTell, "swings");
    }
    if e.d < e.drawn {
        return (Verdict::CannotTell, "lined");
    }
    if e.immobile {
        return (Verdict::CannotTell, "still");
    }
    if e.one_way {
        return (Verdict::CannotTell, "once");
    }
    if e.high.is_none() || !e.traversed {
        return (Verdict::AtLeast, "not_traversed");
    }
    if e.noisy {
        return (Verdict::AtLeast, "noisy");
    }
    if e.slips {
        return match e.slips_wholly {
            true => (Verdict::Stiction, "jumps"),
            false => (Verdict::Both, "jumps_in_a_gap"),
        };
    }
    (Verdict::Backlash, "gap")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_that_are_off_are_no_echo() {
        let mut draws = Draws::new(1, 0);
        let mut uniform = || (draws.next() >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
        let mut alone: Vec<f64> = (0..1000).map(|_| uniform()).collect();
        let mut moving = vec![0.0; 1000];
        for i in 1..1000 {
            moving[i] = 0.5 * moving[i - 1] + uniform();
        }
        for i in (10..1000).step_by(100) {
            (alone[i], alone[i + 1]) = (20.0, -15.0);
        }
        assert!(echo(&alone).abs() < MOST_ECHO, "{}", echo(&alone));
        assert!((echo(&moving) - 0.5).abs() < 0.05, "{}", echo(&moving));
        assert_eq!(echo(&[0.0; 10]), 0.0);
    }

    #[test]
    fn invented_records_share_no_noise() {
        let row = |record| {
            let mut draws = Draws::new(1, record);
            (0..50).map(|_| draws.next()).collect::<Vec<_>>()
        };
        let first = row(0);
        // Each was the one before, moved by a cell.
        for record in 1..40 {
            assert!(row(record).iter().all(|z| !first.contains(z)), "record {record}");
        }
    }

    #[test]
    fn what_one_in_a_hundred_exceeds_is_found_from_two_hundred() {
        let thresholds: Vec<f64> = (0..30)
            .map(|seed| {
                let mut draws = Draws::new(seed, 0);
                let mut ratios: Vec<f64> = (0..200).map(|_| half_chi_square(&mut draws)).collect();
                upper_percentile(&mut ratios).0
            })
            .collect();
        let mean = thresholds.iter().sum::<f64>() / 30.0;
        let spread = thresholds.iter().map(|t| (t - mean).powi(2)).sum::<f64>().sqrt() / 29f64.sqrt();
        assert!((5.0..6.5).contains(&mean), "{mean}");
        assert!(spread < 0.2 * mean, "{spread}");
    }

    /// A draw of half a chi-square with one degree of freedom: the square of a normal one where that is above 0.
    fn half_chi_square(draws: &mut Draws) -> f64 {
        let mut uniform = || (draws.next() >> 11) as f64 / (1u64 << 53) as f64;
        let normal = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        normal.max(0.0).powi(2)
    }
}
