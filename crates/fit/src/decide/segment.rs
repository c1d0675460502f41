//! What one record says: width, interval, and whether there is a gap at all.

use crate::data::cells::{Cells, Positions};
use crate::data::signal::Unit;
use crate::decide::bootstrap::bootstrap_threshold;
use crate::decide::judgement::{Confidence, Judgement};
use crate::decide::thresholds::*;
use crate::decide::verdict::*;
use crate::decide::witness::cycle::{Cycle, cycle};
use crate::decide::witness::plateau::plateau;
use crate::loads::cycle::lr_beside_cycle;
use crate::loads::hypothesis::{Hypothesis, hypotheses};
use crate::model::backlash_model::BacklashModel;
use crate::model::structure::{MOST, Structure, Theta};
use crate::problem::Window;
use crate::search::likelihood::{Point, Search, dot, solve};
use crate::search::profile::{Profile, information_ratio};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// One family's view.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Candidate {
    /// The family.
    pub structure: Structure,
    /// −2·ln L over that of the best family.
    pub delta_deviance: f64,
    /// Best width [OP unit].
    pub d: f64,
    /// Likelihood ratio −2·Δln L of no gap against the best width.
    pub lr_no_gap: f64,
    /// The profile: width [OP unit] and −2·Δln L over this family's best.
    pub profile: Vec<(f64, f64)>,
}

/// A cell of PV beside the best model.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Prediction {
    /// Part of the record, in the order given.
    pub part: usize,
    /// First step of the cell within it.
    pub step: usize,
    /// Mean of PV [PV unit].
    pub pv: f64,
    /// The model's foresight of it, from all that was before [PV unit].
    pub predicted: f64,
    /// Position of the valve [OP unit].
    pub position: f64,
}

/// What the fit finds in one segment.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SegmentFit {
    /// What the record says.
    pub judgement: Judgement,
    /// The same in one word, which claims only what is found.
    pub verdict: Verdict,
    /// Most likely total width [OP unit].
    pub d: f64,
    /// Lower limit, 95 % [OP unit].
    pub low: f64,
    /// Upper limit, 95 % [OP unit]; None where the record gives none.
    pub high: Option<f64>,
    /// Slip jump J [OP unit], 0 for mere backlash.
    pub jump: f64,
    /// Likelihood ratio of no gap: the least over all families that predict PV nearly as well as the best, times `information_ratio`.
    pub lr_no_gap: f64,
    /// What `lr_no_gap` must exceed for a gap, 1 % of records without one do.
    pub lr_needed: f64,
    /// Likelihood ratio of J = 0 against the best J.
    pub lr_no_jump: f64,
    /// Likelihood ratio of a process that does not answer at all.
    pub lr_no_answer: f64,
    /// Share of the likelihood's own information on d that the innovations support, 0 to 1.
    pub information_ratio: f64,
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
    /// Coefficients of 1, s, s², s³ in the denominator of the process [1, s, s², s³]; behind an integrator the first is 0, the
    /// second 1, and the units are [s⁻¹, 1, s, s²].
    pub denominator: [f64; 4],
    /// What PV takes to answer OP: the lags; behind an integrator with the dead time [s].
    pub settles: f64,
    /// Standard deviation of what the model does not foresee of PV, a cell ahead [PV unit].
    pub sigma: f64,
    /// Correlation of that with the same a cell before: far from 0 where the model is not of this record.
    pub autocorrelation: f64,
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
    /// What all that rests on.
    pub evidence: Evidence,
    /// Why the verdict is what it is, a word that `glapp` turns into a sentence; not handed over, for the evidence tells it.
    #[serde(skip)]
    pub reason: &'static str,
}

impl SegmentFit {
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
        self.evidence.in_units(op);
        let gain = pv.size / op.size;
        self.kp *= gain;
        self.kp_limits = (self.kp_limits.0 * gain, self.kp_limits.1 * gain);
        self.sigma *= pv.size;
        for candidate in &mut self.candidates {
            candidate.d *= op.size;
            candidate.profile.iter_mut().for_each(|(d, _)| *d *= op.size);
        }
        for seen in &mut self.predictions {
            (seen.pv, seen.predicted) = (pv.zero + seen.pv * pv.size, pv.zero + seen.predicted * pv.size);
            seen.position = op.zero + seen.position * op.size;
        }
    }
}

/// What one window says, with all that is needed to ask it about another width.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Fitted {
    pub(crate) answer: SegmentFit,
    pub(crate) record: Cells,
    /// The believed families of a gap, best first, and the valves that stick, nearest first.
    pub(crate) profiles: Vec<Profile>,
    pub(crate) sticking: Vec<Profile>,
    pub(crate) sticks_in: Structure,
    /// What the loads that were looked for leave of the likelihood ratio of no gap.
    pub(crate) lr_of_loads: f64,
    /// The least that was found to cost without a gap [−2·ln L], and whether a load that repeats itself was looked for.
    pub(crate) without: f64,
    pub(crate) cycle_known: bool,
    /// Lags of the process [steps], infinite where it integrates.
    pub(crate) lag: f64,
    /// Whether an even swing of OP is explained: PV stands still while OP goes through the gap, or the setpoint leads PV.
    pub(crate) explained: bool,
    /// By how much more than 1 the ratios of records without a gap scatter.
    pub(crate) by_chance: f64,
}

/// Share of a window's fit that goes into its hypotheses of the load; the rest into the interval and what else is known.
const OF_LOADS: f64 = 0.8;

/// Answers for one window in cells, whose PV a historian may have bent by `bow` [PV unit]; `done` takes the share that is done.
pub(crate) fn fit_segment(cells: &Cells, seeds: &[Theta], bow: f64, window: &Window, done: &dyn Fn(f64)) -> Fitted {
    let Window { record: rows, sign, bootstrap, .. } = window;
    let (sign, bootstrap) = (*sign, *bootstrap);
    let (view, without) = hypotheses(cells, seeds, sign, &|share| done(OF_LOADS * share));
    let lr_no_answer = view.answers(sign);
    let Hypothesis { record, mut profiles, dissent, mut sticking, sticks_in, cost, .. } = view;
    let lr_of_loads = without - cost;
    let n = record.freedom();
    let of = |structure| Search { record: &record, structure, sign };
    let least = profiles[0].penalised();
    let mut search = of(profiles[0].structure);
    let mut best = profiles[0].points[profiles[0].best].clone();
    // What a slip jump explains beyond a gap; what a gap explains beyond nothing is at least as much.
    let lr_no_jump = sticking.first().map_or(0.0, |stuck| (least - stuck.penalised()).max(0.0));
    let slips = lr_no_jump > JUMP;
    // What a valve that sticks costs where it is as likely as the most likely.
    let mut as_likely = least - 2.0 * sticks_in.parameters() as f64;
    if lr_no_jump > JUMP_PRICE {
        best = sticking[0].points[sticking[0].best].clone();
        search = of(sticks_in);
        as_likely = best.cost;
    }
    let ratio = information_ratio(&search, &best, 0.005 * record.range).max(LEAST_INFORMATION_RATIO);
    let lr_no_gap =
        profiles.iter().map(Profile::lr_no_gap).fold(f64::INFINITY, f64::min) + (lr_no_jump - JUMP).max(0.0);
    let mut lr_of_loads = lr_of_loads;
    let traversals = record.traversals(best.lost.d);
    let known = record.changes() > 0;
    let asked_of_changes = lr_asked_of_changes(traversals, record.changes());
    let asked = lr_asked(traversals, known).max(asked_of_changes);
    let lr_aperiodic = lr_no_gap.min(lr_of_loads) * ratio;
    let cycle_known = lr_no_gap.min(lr_of_loads) * ratio > asked;
    if cycle_known {
        let family = &profiles[0];
        let points = [(search.structure, &best), (family.structure, &family.points[0])];
        let beside = lr_beside_cycle(&record, sign, &points, &best.lost, without);
        lr_of_loads = beside.map_or(lr_of_loads, |beside| beside.min(lr_of_loads));
    }
    let repeats = lr_of_loads < without - cost;
    let lr_no_gap = lr_no_gap.min(lr_of_loads) * ratio;
    let lr_needed = if bootstrap > 0 && lr_no_gap > asked && lr_no_gap < GAP_PLAIN {
        // The invented records' innovations are alike everywhere: their ratio is to be held against the one before τ.
        let without = &profiles[0].points[0];
        asked.max(bootstrap_threshold(&of(profiles[0].structure), without, lr_no_gap / ratio, bootstrap) * ratio)
    } else {
        asked
    };
    let fine = 0.001 * record.range;
    let wider = if asked_of_changes > 0.0 { RISE_BESIDE_CHANGES } else { 1.0 } / ratio;
    let mut spread: Vec<(f64, Option<f64>)> = Vec::new();
    if !slips {
        spread.par_extend(profiles.par_iter_mut().filter_map(|profile| {
            let from = profile.least();
            profile.within(&of(profile.structure), from, RISE * wider, fine)
        }));
    }
    let certain = spread.iter().all(|s| s.0 <= 0.0);
    // A valve with another slip jump has another width, and may be as likely.
    spread.par_extend(sticking.par_iter_mut().filter_map(|profile| {
        let beyond = profile.points.last().map(|p| p.lost.d);
        let limits = profile.within(&of(sticks_in), as_likely, RISE_OF_STICKING * wider, fine);
        limits.map(|(low, high)| (low, high.or(beyond)))
    }));
    let sticks_only = |p: &&Profile| p.points[p.best].lost.share >= 1.0;
    let slips_wholly = sticking.iter().filter(sticks_only).any(|p| p.least() < as_likely + JUMP_PRICE);
    let low = (spread.iter().map(|s| s.0).fold(f64::INFINITY, f64::min) - record.resolution()).max(0.0);
    let high = spread.iter().map(|s| s.1).try_fold(0.0, |high, h| h.map(|h| f64::max(high, h)));
    let positions = record.positions(&best.lost);
    let final_state = search.at(&best.theta, &positions);
    let residual = final_state.lane(0);
    let noise = (final_state.sum[0] / n).sqrt() / final_state.scale[0];
    let autocorrelation = autocorrelation(&residual);
    let reaches = |lost: &BacklashModel| record.reach(lost);
    let at_low = if low > 0.0 { reaches(&BacklashModel { d: low, ..best.lost.clone() }) / low } else { 1.0 };
    let settles = search.structure.settles(&best.theta) * (record.cell as f64);
    let fast = settles < SAMPLES_IN_LAG;
    let slowly = best.lost.d >= SAMPLES_IN_GAP * record.travel();
    // PV stands still while OP goes through the gap: no load follows OP so closely, unless most of each swing is lost.
    let dwells = fast && slowly && lr_no_gap > GAP_IF_SELDOM && 2.0 * best.lost.d < record.range;
    let lag_steps = match search.structure.integrating {
        true => f64::INFINITY,
        false => search.structure.lag(&best.theta) * (record.cell as f64),
    };
    // What leads PV may make OP swing as well.
    let explained = dwells || rows.is_led();
    let h = rows.h * record.cell as f64;
    let variance = final_state.sum[0] / n / ratio;
    let errors = StandardErrors::new(&search, &best.theta, &positions, variance);
    let (dead_time, dead_error) = errors.of(|theta| theta[search.structure.dead_time_at()] * h);
    let (lag, lag_error) = errors.of(|theta| search.structure.lag(theta) * h);
    let late = (best.theta[search.structure.dead_time_at()] + search.structure.lag(&best.theta)) * record.cell as f64;
    let cycle_of =
        |structure, point: &Point| cycle(rows, &record, structure, &point.theta, point.kp, noise, &point.lost);
    // A valve that sticks may make the loop swing where a gap does not, though PV hardly tells the two apart.
    let own = cycle_of(search.structure, &best);
    let stuck = sticking.first().filter(|p| p.penalised() < least + BELIEVED && !own.is_some_and(|own| own.is_own()));
    let other = stuck.and_then(|p| cycle_of(sticks_in, &p.points[p.best])).filter(Cycle::is_own);
    let told_high = high.map(|high| high + MISSED_TURNS * record.resolution());
    let evidence = Evidence {
        autocorrelation,
        d: best.lost.d,
        // A model whose valve hardly moves is a step of PV at a time and of a size that are free.
        immobile: (reaches(&best.lost) / best.lost.d.max(1e-300)).min(at_low) < MOVES,
        coarse: fast && (slips || !slowly),
        at_once: settles < SAMPLES_IN_LAG_AT_LEAST,
        noisy_below: if search.structure.integrating { 0.0 } else { NOISY * noise / best.kp.abs().max(1e-300) },
        traversed: often(lr_no_gap, record.traversals(low), traversals),
        one_way: traversals.contains(&0),
        changes_known: known,
        lr_no_gap,
        lr_aperiodic,
        lr_needed,
        lr_no_answer,
        low,
        high,
        range: record.range,
        slips,
        slips_wholly,
        misfit_at_turns: ratio < MISFIT_AT_TURNS,
        dissent: dissent || !certain,
        periodic_load: repeats,
        even_swing: lr_no_gap < GAP_IF_EVEN_SWING && !explained && swings_evenly(&record, best.lost.d, lag_steps),
        hidden: hidden(settles, search.structure.lag(&best.theta), record.count as f64, traversals, record.changes()),
        unsampled_below: UNSAMPLED_BELOW * record.travel(),
        lined_below: LINED_BELOW * bow / best.kp.abs().max(1e-300),
        passes: traversals,
        passes_high: told_high.map_or([0; 2], |high| record.traversals(high.max(UNSAMPLED_BELOW * record.travel()))),
        oscillates: record.swing(OSCILLATES * record.range).is_some_and(|(_, spread)| spread < EVEN_SWING),
        cycle: other.or(own),
        plateau: plateau(&record, best.lost.d, best.kp, late),
        cancels: if search.structure.integrating { 0.0 } else { record.cancels(best.kp) },
        lag_error: lag_error / lag.max(1e-300),
        settles,
        agree: [1; 2],
        dispersion: 1.0,
        shows: None,
    };
    let (judgement, reason) = judge(&evidence);
    let verdict = judgement.verdict(evidence.low);
    let told = evidence.limits(&judgement, told_high);
    let per_cell = if search.structure.integrating { 1.0 / h } else { 1.0 };
    let kp = best.kp * per_cell;
    // The gain is at its best for each process: its variance there, and what the process may be.
    let information = (final_state.sum_without[0] - final_state.sum[0]).max(1e-300) / (best.kp * best.kp).max(1e-300);
    let (_, of_process) = errors.of(|theta| search.at(theta, &positions).kp[0]);
    let kp_error = per_cell * (variance / information + of_process * of_process).sqrt();
    // Where the likelihood stays near its best, with another width or in another family.
    let near: Vec<(Structure, &Point)> = {
        let families = profiles.iter().map(|p| (p.structure, p, p.least()));
        let sticking = sticking.iter().map(|p| (sticks_in, p, as_likely));
        let alike = families.chain(sticking).filter(|(of, ..)| of.integrating == search.structure.integrating);
        let points = alike.flat_map(|(of, p, from)| p.points.iter().map(move |point| (of, point, from)));
        points
            .filter(|(_, point, from)| point.cost <= from + RISE_OF_PROCESS * wider)
            .map(|(of, point, _)| (of, point))
            .collect()
    };
    let around = |x: f64, error: f64, of: &dyn Fn(Structure, &Point) -> f64| {
        let each = near.iter().map(|(structure, point)| of(*structure, point));
        let (low, high) = each.fold((x, x), |(low, high), x| (low.min(x), high.max(x)));
        (low - 1.96 * error, high + 1.96 * error)
    };
    // The model is a little off, and where no gap is found the load of the model may stand for much of what its process does.
    let off = if judgement.confidence == Confidence::Found { PROCESS_OFF } else { PROCESS_OFF_IF_NOT_FOUND };
    let further = |x: f64, away: f64| if x * away > 0.0 { x * off } else { x / off };
    let widened = |(low, high): (f64, f64)| (further(low, -1.0), further(high, 1.0));
    let positive = |(low, high): (f64, f64)| (low.max(0.0), high);
    let kp_limits = widened(around(kp, kp_error, &|_, point| point.kp * per_cell));
    let lag_limits = positive(widened(around(lag, lag_error, &|structure, point| structure.lag(&point.theta) * h)));
    let late = (off - 1.0).min(1.0) * (dead_time + lag);
    let (low_dead, high_dead) =
        around(dead_time, dead_error, &|structure, point| point.theta[structure.dead_time_at()] * h);
    let dead_time_limits = positive((low_dead - late, high_dead + late));
    let sigma = (final_state.sum[0] / n).sqrt();
    let by_chance = lr_needed / asked;
    let answer = SegmentFit {
        judgement,
        verdict,
        d: best.lost.d,
        low: told.0,
        high: told.1,
        jump: best.lost.jump(),
        lr_no_gap,
        lr_needed: evidence.needed(),
        lr_no_jump,
        lr_no_answer,
        information_ratio: ratio,
        rise: RISE * wider,
        traversals,
        kp,
        kp_limits,
        dead_time,
        dead_time_limits,
        lag,
        lag_limits,
        integrating: search.structure.integrating,
        denominator: search.structure.denominator_in(&best.theta, h),
        settles: search.structure.settles(&best.theta) * h,
        sigma,
        autocorrelation,
        cells: record.count,
        cell: h,
        range: record.range,
        load_steps: record.changes(),
        candidates: profiles
            .iter()
            .map(|p| Candidate {
                structure: p.structure,
                delta_deviance: p.penalised() - least,
                d: p.points[p.best].lost.d,
                lr_no_gap: p.lr_no_gap(),
                profile: p.points.iter().map(|point| (point.lost.d, point.cost - p.least())).collect(),
            })
            .collect(),
        predictions: predictions(&record, &positions, &residual),
        evidence,
        reason,
    };
    Fitted {
        answer,
        record,
        profiles,
        sticking,
        sticks_in,
        lr_of_loads,
        without,
        cycle_known,
        lag: lag_steps,
        explained,
        by_chance,
    }
}

/// Whether OP goes through a gap of width `d` to and fro in almost even time, though no gap makes a process with lags of so many
/// steps do that. Steps and bends of the load that were found tell what drives OP, where there are enough of them. A process
/// slower than the swing nearly integrates, and swings with a gap; not under a load that steps.
pub(crate) fn swings_evenly(record: &Cells, d: f64, lag: f64) -> bool {
    let [up, down] = record.traversals(d);
    let known = record.changes() > 0;
    2 * record.changes() < up + down
        && record.swing(d).is_some_and(|(mean, spread)| spread < EVEN_SWING && (known || lag < mean))
}

/// The cells of PV with what the model left of each.
fn predictions(record: &Cells, positions: &Positions, residual: &[f64]) -> Vec<Prediction> {
    let cells = record.stretches.iter().zip(positions).flat_map(|(stretch, v)| {
        let there = stretch.y.iter().zip(v).enumerate().filter(|(_, (y, _))| !y.is_nan());
        there.map(|(k, (y, v))| (stretch.part, k * record.cell, *y, *v))
    });
    cells
        .zip(residual)
        .map(|((part, step, pv, position), r)| Prediction { part, step, pv, predicted: pv - r, position })
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

/// Correlation of innovations with those a cell before. What is larger than [`ECHO_OF_ONE`] times their mean size counts as so large: a
/// sample that is far off leaves one innovation as large and another against it, which is no fault of the model. (Not their
/// median: where PV is held most of them are nothing.)
fn autocorrelation(innovations: &[f64]) -> f64 {
    let most = ECHO_OF_ONE * innovations.iter().map(|e| e.abs()).sum::<f64>() / innovations.len() as f64;
    let tame: Vec<f64> = innovations.iter().map(|e| e.clamp(-most, most)).collect();
    dot(&tame[1..], &tame[..tame.len() - 1]) / dot(&tame, &tame).max(1e-300)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decide::bootstrap::Draws;

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
        assert!(autocorrelation(&alone).abs() < MAX_AUTOCORRELATION, "{}", autocorrelation(&alone));
        assert!((autocorrelation(&moving) - 0.5).abs() < 0.05, "{}", autocorrelation(&moving));
        assert_eq!(autocorrelation(&[0.0; 10]), 0.0);
    }
}
