//! Result of one record: width, interval, and whether there is a gap at all.

use crate::data::backlash_model::BacklashModel;
use crate::data::cells::{Cells, Positions};
use crate::data::segment::Segment;
use crate::decide::best::{Best, Filtered, NoGap, Process, ProcessLimits, WidthLimits};
use crate::decide::evidence::{Evidence, hidden};
use crate::decide::judgement::Confidence;
use crate::decide::segment_fit::{Candidate, Prediction, SegmentFit};
use crate::decide::thresholds::*;
use crate::decide::verdict::judge;
use crate::decide::witness::cycle::{Cycle, cycle};
use crate::decide::witness::plateau::plateau;
use crate::loads::hypothesis::{Hypothesis, hypotheses};
use crate::search::likelihood::{Point, Search};
use crate::search::linear::dot;
use crate::search::profile::Profile;
use glapp_model::structure::{Structure, Theta};
use serde::{Deserialize, Serialize};

/// Fit of one window, with all that is needed to evaluate another width.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Fitted {
    pub(crate) answer: SegmentFit,
    pub(crate) record: Cells,
    /// The believed families of a gap, best first, and the valves that stick, nearest first.
    pub(crate) profiles: Vec<Profile>,
    pub(crate) sticking: Vec<Profile>,
    pub(crate) sticks_in: Structure,
    /// Likelihood ratio of no gap that remains after the loads that were looked for.
    pub(crate) lr_of_loads: f64,
    /// The least that was found to cost without a gap [−2·ln L], and whether a load that repeats itself was looked for.
    pub(crate) without: f64,
    pub(crate) cycle_known: bool,
    /// Lags of the process [steps], infinite where it integrates.
    pub(crate) lag: f64,
    /// Whether an even swing of OP is explained: PV stands still while OP goes through the gap, or the setpoint leads PV.
    pub(crate) explained: bool,
    /// Excess over 1 of the scatter of the ratios of records without a gap.
    pub(crate) by_chance: f64,
}

/// Share of a window's fit that goes into its hypotheses of the load; the rest into the interval and what else is known.
const OF_LOADS: f64 = 0.8;

/// Answers for one window in cells, whose PV a historian may have bent by `bow` [PV unit]. `window` has its rows, the sign of
/// the process gain and the number of simulations for the bootstrap; `done` takes the share that is done.
pub(crate) fn fit_segment(
    cells: &Cells,
    seeds: &[Theta],
    bow: f64,
    window: (&Segment<'static>, f64, usize),
    done: &dyn Fn(f64),
) -> Fitted {
    let (rows, sign, bootstrap) = window;
    let (hypothesis, without) = hypotheses(cells, seeds, sign, &|share| done(OF_LOADS * share));
    let lr_no_answer = hypothesis.answers(sign);
    let Hypothesis { record, mut profiles, dissent, mut sticking, sticks_in, cost, .. } = hypothesis;
    let best = Best::new(&record, sign, &profiles[0], sticking.first());
    let no_gap = NoGap::new(&best, &profiles, [without, cost], bootstrap);
    let limits = WidthLimits::new(&best, &mut profiles, &mut sticking);
    let filtered = Filtered::new(&best);
    let process = Process::new(&best, &filtered, rows.h * record.cell as f64);
    let near = process.near(&best, &profiles, &sticking);
    let view = View { rows, best, no_gap, limits, filtered, process, near, profiles: &profiles, sticking: &sticking };
    let evidence = view.evidence(lr_no_answer, dissent, bow);
    let (lag, explained) = (view.best.lag_steps(), view.explained());
    let NoGap { lr_of_loads, cycle_known, needed, asked, .. } = view.no_gap;
    let answer = view.answer(evidence);
    let by_chance = needed / asked;
    Fitted {
        answer,
        record,
        profiles,
        sticking,
        sticks_in,
        lr_of_loads,
        without,
        cycle_known,
        lag,
        explained,
        by_chance,
    }
}

/// All that a segment says, from which evidence and answer are put together.
struct View<'r> {
    rows: &'r Segment<'static>,
    best: Best<'r>,
    no_gap: NoGap,
    limits: WidthLimits,
    filtered: Filtered,
    process: Process,
    near: ProcessLimits,
    /// The believed families of a gap, best first, and the valves that stick, nearest first.
    profiles: &'r [Profile],
    sticking: &'r [Profile],
}

impl View<'_> {
    /// Whether rows are too far apart for the process.
    fn fast(&self) -> bool {
        self.best.settles() < SAMPLES_IN_LAG
    }

    /// Whether OP goes through the gap in rows enough.
    fn slowly(&self) -> bool {
        self.best.point.lost.d >= SAMPLES_IN_GAP * self.best.search.record.travel()
    }

    /// See [`Fitted::explained`]. What leads PV may make OP swing as well.
    fn explained(&self) -> bool {
        let wide = 2.0 * self.best.point.lost.d;
        // No load follows OP so closely, unless most of each swing is lost.
        let dwells =
            self.fast() && self.slowly() && self.no_gap.lr > LR_IF_SELDOM && wide < self.best.search.record.range;
        dwells || self.rows.is_led()
    }

    /// The cycle of the fitted loop. A valve that sticks may make the loop swing where a gap does not, though PV hardly tells the two
    /// apart.
    fn cycle(&self) -> Option<Cycle> {
        let of = |structure, point: &Point| {
            let Point { theta, kp, lost, .. } = point;
            cycle(self.rows, self.best.search.record, structure, theta, *kp, self.filtered.noise, lost)
        };
        let own = of(self.best.search.structure, &self.best.point);
        if own.is_some_and(|own| own.is_own()) {
            return own;
        }
        let stuck = self.sticking.first().filter(|p| p.penalised() < self.profiles[0].penalised() + BELIEVED);
        stuck.and_then(|p| of(p.structure, &p.points[p.best])).filter(Cycle::is_own).or(own)
    }

    /// Evidence of the judgement; `bow` as in [`fit_segment`].
    fn evidence(&self, lr_no_answer: f64, dissent: bool, bow: f64) -> Evidence {
        let Self { best, no_gap, limits, filtered, .. } = self;
        let (Search { record, structure, .. }, point) = (&best.search, &best.point);
        let (d, low, kp) = (point.lost.d, limits.low, point.kp.abs().max(1e-300));
        let (settles, lag, changes) = (best.settles(), structure.lag(&point.theta), record.changes());
        let reaches = |lost: &BacklashModel| record.reach(lost);
        let at_low = if low > 0.0 { reaches(&BacklashModel { d: low, ..point.lost.clone() }) / low } else { 1.0 };
        let late = (point.theta[structure.dead_time_at()] + lag) * record.cell as f64;
        let even = || swings_evenly(record, d, best.lag_steps());
        let unsampled_below = UNSAMPLED_BELOW * record.travel();
        let passes_high = limits.upper_limit(record).map(|high| record.traversals(high.max(unsampled_below)));
        let oscillates = record.swing(OSCILLATES * record.range).is_some_and(|(_, spread)| spread < EVEN_SWING);
        // A step of the load in each half-period of a cycle may be a gap as wide as the cycle, so the bound's passes count there.
        let passes = passes_high.filter(|_| oscillates).unwrap_or(best.traversals);
        Evidence {
            autocorrelation: autocorrelation(&filtered.residual),
            d,
            // A model whose valve hardly moves is a step of PV at a time and of a size that are free.
            immobile: (reaches(&point.lost) / d.max(1e-300)).min(at_low) < MOVES,
            coarse: self.fast() && (best.slips() || !self.slowly()),
            at_once: settles < SAMPLES_IN_LAG_AT_LEAST,
            noisy_below: if structure.integrating { 0.0 } else { NOISY * filtered.noise / kp },
            one_way: best.traversals.contains(&0),
            cells: record.count,
            lr_no_gap: no_gap.lr,
            lr_needed: no_gap.needed,
            lr_no_answer,
            low,
            high: limits.high,
            range: record.range,
            slips: best.slips(),
            slips_wholly: limits.slips_wholly,
            information_ratio: best.information_ratio,
            dissent: dissent || !limits.certain,
            periodic_load: no_gap.periodic_load,
            even_swing: no_gap.lr < LR_IF_EVEN_SWING && !self.explained() && even(),
            hidden: hidden(settles, lag, record.count as f64, passes, changes),
            unsampled_below,
            lined_below: LINED_BELOW * bow / kp,
            passes: best.traversals,
            passes_high: passes_high.unwrap_or_default(),
            oscillates,
            cycle: self.cycle(),
            plateau: plateau(record, d, point.kp, late),
            cancels: if structure.integrating { 0.0 } else { record.cancels(point.kp) },
            lag_up_to: self.near.lag.1 / self.process.lag.value.max(1e-300),
            agree: [1; 2],
            dispersion: 1.0,
            shows: None,
        }
    }

    /// Answer of the window.
    fn answer(self, evidence: Evidence) -> SegmentFit {
        let Self { best, no_gap, limits, filtered, process, near, profiles, .. } = self;
        let (Search { record, structure, .. }, point) = (best.search, &best.point);
        let (judgement, reason) = judge(&evidence);
        let verdict = judgement.verdict(evidence.low);
        let (low, high) = evidence.limits(&judgement, limits.upper_limit(record));
        let of_process = process.limits(&best, &near, judgement.confidence == Confidence::Found);
        let least = profiles[0].penalised();
        let candidate = |p: &Profile| Candidate {
            structure: p.structure,
            delta_deviance: p.penalised() - least,
            d: p.points[p.best].lost.d,
            lr_no_gap: p.lr_no_gap(),
            profile: p.points.iter().map(|point| (point.lost.d, point.cost - p.least())).collect(),
        };
        SegmentFit {
            judgement,
            verdict,
            d: point.lost.d,
            low,
            high,
            jump: point.lost.jump(),
            lr_no_gap: no_gap.lr,
            lr_needed: evidence.needed(),
            lr_no_jump: best.lr_no_jump,
            lr_no_answer: evidence.lr_no_answer,
            information_ratio: best.information_ratio,
            rise: RISE * best.widened(),
            traversals: best.traversals,
            kp: process.kp.value,
            kp_limits: of_process.kp,
            kp_near: near.kp,
            dead_time: process.dead_time.value,
            dead_time_limits: of_process.dead_time,
            lag: process.lag.value,
            lag_limits: of_process.lag,
            lag_near: near.lag,
            integrating: structure.integrating,
            denominator: structure.denominator_in(&point.theta, process.h),
            settles: structure.settles(&point.theta) * process.h,
            sigma: filtered.variance.sqrt(),
            autocorrelation: evidence.autocorrelation,
            cells: record.count,
            cell: process.h,
            range: record.range,
            load_steps: record.changes(),
            candidates: profiles.iter().map(candidate).collect(),
            predictions: predictions(record, &filtered.positions, &filtered.residual),
            evidence,
            reason,
        }
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

/// The cells of PV with the model's residual of each.
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
