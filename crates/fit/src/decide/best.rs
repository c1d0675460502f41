//! The most likely model of a segment, and what follows from its likelihood: whether there is a gap, how wide it is, and the process.

use crate::data::cells::{Cells, Positions};
use crate::decide::bootstrap::bootstrap_threshold;
use crate::decide::evidence::{lr_asked, lr_asked_of_changes};
use crate::decide::thresholds::*;
use crate::loads::cycle::lr_beside_cycle;
use crate::search::likelihood::{Point, Search};
use crate::search::linear::{dot, solve};
use crate::search::profile::{Profile, information_ratio};
use glapp_model::structure::{MOST, Structure, Theta};
use rayon::prelude::*;

/// The most likely model of a segment: a gap, or a valve that sticks where its slip jump pays.
pub(crate) struct Best<'r> {
    pub(crate) search: Search<'r>,
    pub(crate) point: Point,
    /// Cost of a valve that sticks where it is as likely [−2·ln L].
    as_likely: f64,
    /// Likelihood ratio of J = 0 against the best J: what a slip jump explains beyond a gap.
    pub(crate) lr_no_jump: f64,
    /// See [`information_ratio`].
    pub(crate) information_ratio: f64,
    /// Times that OP goes through the whole width, up and down.
    pub(crate) traversals: [usize; 2],
}

impl<'r> Best<'r> {
    /// Made of the best family with a gap, and the nearest valve that sticks.
    pub(crate) fn new(record: &'r Cells, sign: f64, gap: &Profile, stuck: Option<&Profile>) -> Self {
        let lr_no_jump = stuck.map_or(0.0, |stuck| (gap.penalised() - stuck.penalised()).max(0.0));
        let profile = stuck.filter(|_| lr_no_jump > JUMP_PRICE).unwrap_or(gap);
        let point = profile.points[profile.best].clone();
        let as_likely = stuck.map_or(gap.least(), |stuck| as_likely(gap, stuck));
        let search = Search { record, structure: profile.structure, sign };
        let ratio = information_ratio(&search, &point, 0.005 * record.range).max(LEAST_INFORMATION_RATIO);
        let traversals = record.traversals(point.lost.d);
        Self { search, point, as_likely, lr_no_jump, information_ratio: ratio, traversals }
    }

    fn of(&self, structure: Structure) -> Search<'r> {
        Search { structure, ..self.search }
    }

    /// Whether the valve slips.
    pub(crate) fn slips(&self) -> bool {
        self.lr_no_jump > LR_JUMP
    }

    /// Settling time of PV [steps].
    pub(crate) fn settles(&self) -> f64 {
        self.search.structure.settles(&self.point.theta) * self.search.record.cell as f64
    }

    /// Lags of the process [steps], infinite where it integrates.
    pub(crate) fn lag_steps(&self) -> f64 {
        let Search { record, structure, .. } = &self.search;
        if structure.integrating { f64::INFINITY } else { structure.lag(&self.point.theta) * record.cell as f64 }
    }

    /// The likelihood ratio that the marked changes of the load ask for.
    fn asked_of_changes(&self) -> f64 {
        lr_asked_of_changes(self.traversals, self.search.record.changes())
    }

    /// Ratio of the allowed rise within an interval to that of a likelihood with full information.
    pub(crate) fn widened(&self) -> f64 {
        let beside_changes = self.asked_of_changes() > 0.0;
        (if beside_changes { RISE_BESIDE_CHANGES } else { 1.0 }) / self.information_ratio
    }
}

/// Cost at which a valve that sticks is as likely as a gap: its least where it is believed [−2·ln L].
pub(crate) fn as_likely(gap: &Profile, stuck: &Profile) -> f64 {
    let believed = gap.penalised() - stuck.penalised() > JUMP_PRICE;
    if believed { stuck.least() } else { gap.penalised() - 2.0 * stuck.structure.parameters() as f64 }
}

/// The test of no gap.
pub(crate) struct NoGap {
    /// Likelihood ratio of no gap: the least over all families and loads, times the information ratio.
    pub(crate) lr: f64,
    /// Ratio that a gap needs, and the same before the bootstrap.
    pub(crate) needed: f64,
    pub(crate) asked: f64,
    /// Likelihood ratio that remains after the loads that were looked for.
    pub(crate) lr_of_loads: f64,
    /// Whether a load that repeats itself was looked for, and whether it leaves less than others do.
    pub(crate) cycle_known: bool,
    pub(crate) periodic_load: bool,
}

impl NoGap {
    /// `costs`: the least without a gap under any load, and the least of all [−2·ln L]; `bootstrap`: draws at most.
    pub(crate) fn new(best: &Best, profiles: &[Profile], costs: [f64; 2], bootstrap: usize) -> Self {
        let ([without, with], ratio, gap) = (costs, best.information_ratio, &profiles[0]);
        let Search { record, structure, sign } = best.search;
        // The gain of a gap over nothing is at least the gain of a slip jump over a gap.
        let of_families = profiles.iter().map(Profile::lr_no_gap).fold(f64::INFINITY, f64::min)
            + (best.lr_no_jump - LR_JUMP).max(0.0);
        let asked = lr_asked(best.traversals).max(best.asked_of_changes());
        let of_aperiodic_loads = without - with;
        let cycle_known = of_families.min(of_aperiodic_loads) * ratio > asked;
        let mut lr_of_loads = of_aperiodic_loads;
        if cycle_known {
            let points = [(structure, &best.point), (gap.structure, &gap.points[0])];
            let beside = lr_beside_cycle(record, sign, &points, &best.point.lost, without);
            lr_of_loads = beside.map_or(lr_of_loads, |beside| beside.min(lr_of_loads));
        }
        let lr = of_families.min(lr_of_loads) * ratio;
        let mut needed = asked;
        if bootstrap > 0 && lr > asked && lr < LR_IF_CLEAR {
            // Drawn innovations are alike everywhere: their ratio is to be held against the one before the information ratio.
            let threshold = bootstrap_threshold(&best.of(gap.structure), &gap.points[0], lr / ratio, bootstrap);
            needed = asked.max(threshold * ratio);
        }
        let periodic_load = lr_of_loads < of_aperiodic_loads;
        Self { lr, needed, asked, lr_of_loads, cycle_known, periodic_load }
    }
}

/// Limits of the width, 95 %.
pub(crate) struct WidthLimits {
    pub(crate) low: f64,
    /// None where the record gives none.
    pub(crate) high: Option<f64>,
    /// Whether every family of a gap allows none.
    pub(crate) certain: bool,
    /// Whether a slip jump may be all of the width.
    pub(crate) slips_wholly: bool,
}

impl WidthLimits {
    /// Made of all believed models; their profiles get the widths that were looked at.
    pub(crate) fn new(best: &Best, profiles: &mut [Profile], sticking: &mut [Profile]) -> Self {
        let (record, wider) = (best.search.record, best.widened());
        let fine = 0.001 * record.range;
        let mut limits: Vec<(f64, Option<f64>)> = Vec::new();
        if !best.slips() {
            limits.par_extend(profiles.par_iter_mut().filter_map(|profile| {
                let from = profile.least();
                profile.within(&best.of(profile.structure), from, RISE * wider, fine)
            }));
        }
        let certain = limits.iter().all(|(low, _)| *low <= 0.0);
        // A valve with another slip jump has another width, and may be as likely.
        limits.par_extend(sticking.par_iter_mut().filter_map(|profile| {
            let beyond = profile.points.last().map(|p| p.lost.d);
            let search = best.of(profile.structure);
            let limits = profile.within(&search, best.as_likely, RISE_OF_STICKING * wider, fine);
            limits.map(|(low, high)| (low, high.or(beyond)))
        }));
        let sticks_only = |p: &&Profile| p.points[p.best].lost.share >= 1.0;
        let slips_wholly = sticking.iter().filter(sticks_only).any(|p| p.least() < best.as_likely + JUMP_PRICE);
        let low = limits.iter().map(|(low, _)| *low).fold(f64::INFINITY, f64::min);
        let high =
            limits.iter().map(|(_, high)| *high).try_fold(0.0, |most, high| high.map(|high| f64::max(most, high)));
        Self { low: (low - record.resolution()).max(0.0), high, certain, slips_wholly }
    }

    /// The upper limit with the turns of OP that no sample shows.
    pub(crate) fn upper_limit(&self, record: &Cells) -> Option<f64> {
        self.high.map(|high| high + MISSED_TURNS * record.resolution())
    }
}

/// PV under the most likely model.
pub(crate) struct Filtered {
    pub(crate) positions: Positions,
    /// Innovations over their standard deviations, times one size.
    pub(crate) residual: Vec<f64>,
    /// Variance of what the model does not foresee of PV, a cell ahead [PV unit²], and standard deviation of the white noise [PV unit].
    pub(crate) variance: f64,
    pub(crate) noise: f64,
    /// Decrease of the sum of squares by the answer to OP.
    answered: f64,
}

impl Filtered {
    pub(crate) fn new(best: &Best) -> Self {
        let record = best.search.record;
        let positions = record.positions(&best.point.lost);
        let found = best.search.at(&best.point.theta, &positions);
        let variance = found.sum[0] / record.freedom();
        Self {
            residual: found.lane(0),
            variance,
            noise: variance.sqrt() / found.scale[0],
            answered: found.sum_without[0] - found.sum[0],
            positions,
        }
    }
}

/// A quantity with its standard error.
pub(crate) struct Estimated {
    pub(crate) value: f64,
    pub(crate) error: f64,
}

/// The process of the most likely model.
pub(crate) struct Process {
    /// Length of a cell [s].
    pub(crate) h: f64,
    /// Static gain [PV unit/OP unit]; velocity gain [PV unit/(OP unit·s)] of an integrating process.
    pub(crate) kp: Estimated,
    /// Dead time, and lags together [s].
    pub(crate) dead_time: Estimated,
    pub(crate) lag: Estimated,
}

/// Limits of gain, dead time and lags, in the units of [`Process`].
pub(crate) struct ProcessLimits {
    pub(crate) kp: (f64, f64),
    pub(crate) dead_time: (f64, f64),
    pub(crate) lag: (f64, f64),
}

/// Limits of what is not below 0.
fn positive((low, high): (f64, f64)) -> (f64, f64) {
    (low.max(0.0), high)
}

/// Cells a second for the gain of an integrating process, else 1.
fn per_cell(structure: Structure, h: f64) -> f64 {
    if structure.integrating { 1.0 / h } else { 1.0 }
}

impl Process {
    /// `h`: length of a cell [s].
    pub(crate) fn new(best: &Best, filtered: &Filtered, h: f64) -> Self {
        let Best { search, point, .. } = best;
        let structure = search.structure;
        let variance = filtered.variance / best.information_ratio;
        let errors = StandardErrors::new(search, &point.theta, &filtered.positions, variance);
        // The gain is at its best for each process: its variance there, and what the process may be.
        let information = filtered.answered.max(1e-300) / (point.kp * point.kp).max(1e-300);
        let of_process = errors.of(|theta| search.at(theta, &filtered.positions).kp[0]).error;
        let per_cell = per_cell(structure, h);
        let error = per_cell * (variance / information + of_process * of_process).sqrt();
        Self {
            h,
            kp: Estimated { value: point.kp * per_cell, error },
            dead_time: errors.of(|theta| theta[structure.dead_time_at()] * h),
            lag: errors.of(|theta| structure.lag(theta) * h),
        }
    }

    /// The 95 % limits by the likelihood of all believed models.
    pub(crate) fn near(&self, best: &Best, profiles: &[Profile], sticking: &[Profile]) -> ProcessLimits {
        let (h, rise) = (self.h, RISE_OF_PROCESS * best.widened());
        // Widths or families where the likelihood stays near its best.
        let of_gap = profiles.iter().map(|p| (p, p.least()));
        let of_sticking = sticking.iter().map(|p| (p, best.as_likely));
        let alike = |p: &&Profile| p.structure.integrating == best.search.structure.integrating;
        let families = of_gap.chain(of_sticking).filter(|(p, _)| alike(p));
        let near: Vec<(Structure, &Point)> = families
            .flat_map(|(p, from)| {
                p.points.iter().filter(move |point| point.cost <= from + rise).map(|point| (p.structure, point))
            })
            .collect();
        let around = |at: &Estimated, of: &dyn Fn(Structure, &Point) -> f64| {
            let each = near.iter().map(|(structure, point)| of(*structure, point));
            let (low, high) = each.fold((at.value, at.value), |(low, high), x| (low.min(x), high.max(x)));
            (low - 1.96 * at.error, high + 1.96 * at.error)
        };
        let dead_time = |structure: Structure, point: &Point| point.theta[structure.dead_time_at()] * h;
        ProcessLimits {
            kp: around(&self.kp, &|structure, point| point.kp * per_cell(structure, h)),
            dead_time: positive(around(&self.dead_time, &dead_time)),
            lag: positive(around(&self.lag, &|structure, point| structure.lag(&point.theta) * h)),
        }
    }

    /// The 95 % limits, further out than those [`near`](Self::near) by what the model lacks. `found`: whether a gap is.
    pub(crate) fn limits(&self, best: &Best, near: &ProcessLimits, found: bool) -> ProcessLimits {
        // The model is a little off. Where no gap is found its load may stand for much of what the process does: the controller undoes that load,
        // and a process that hardly answers explains the recording nearly as well.
        let off = if found { PROCESS_OFF } else { PROCESS_OFF_IF_NOT_FOUND };
        let beyond = if found { 1.0 } else { self.may_be_greater(best) };
        let further = |x: f64, away: f64| if x * away > 0.0 { x * off } else { x / off };
        let widened = |at: f64, (low, high): (f64, f64)| {
            let most = at * beyond;
            (further(low, -1.0).min(most), further(high, 1.0).max(most))
        };
        let late = (off - 1.0).min(1.0) * (self.dead_time.value + self.lag.value);
        let (low, high) = near.dead_time;
        ProcessLimits {
            kp: widened(self.kp.value, near.kp),
            dead_time: positive((low - late, high + late)),
            lag: positive(widened(self.lag.value, near.lag)),
        }
    }

    /// Largest ratio by which the gain may be greater before a load would have to undo more of the valve's effect than
    /// any does, and with it the lags: their ratio is known better than either.
    fn may_be_greater(&self, best: &Best) -> f64 {
        let cancels = best.search.record.cancels(best.point.kp);
        if best.search.structure.integrating || cancels <= 0.0 { 1.0 } else { (CANCELS / cancels).max(1.0) }
    }
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

    /// A quantity of the parameters.
    fn of(&self, quantity: impl Fn(&Theta) -> f64) -> Estimated {
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
        Estimated { value: here, error: variance.max(0.0).sqrt() }
    }
}
