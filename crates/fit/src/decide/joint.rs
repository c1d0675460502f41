//! One answer from all records: one width, everything else free in each.

use crate::data::segment::Segment;
use crate::data::signal::Unit;
use crate::decide::best::as_likely;
use crate::decide::combine::Reading;
use crate::decide::evidence::{Evidence, lr_asked, lr_asked_of_changes};
use crate::decide::judgement::{Judgement, Verdict};
use crate::decide::pooled::pooled;
use crate::decide::segment::Fitted;
use crate::decide::segment_fit::SegmentFit;
use crate::decide::thresholds::*;
use crate::decide::trend::Trend;
use crate::decide::verdict::judge;
use crate::search::likelihood::Search;
use crate::search::profile::Profile;
use rayon::prelude::*;

/// Joint result of several records on the width that they share.
#[derive(Clone, Debug)]
pub struct Together {
    /// Judgement of all records.
    pub judgement: Judgement,
    /// Verdict in one word, which claims only what is found.
    pub verdict: Verdict,
    /// Width [OP unit].
    pub d: f64,
    /// Lower limit, 95 % [OP unit].
    pub low: f64,
    /// Upper limit, 95 % [OP unit]; None where there is none.
    pub high: Option<f64>,
    /// Likelihood ratio of no gap, over all records, and what it must exceed.
    pub lr_no_gap: f64,
    /// See `lr_no_gap`.
    pub lr_needed: f64,
    /// Times that OP goes through the whole width up and down.
    pub traversals: [usize; 2],
    /// Ratio of the records' differences to their intervals, 1 where the intervals allow them.
    pub dispersion: f64,
    /// Evidence of the judgement.
    pub evidence: Evidence,
    /// Why the verdict is what it is, a word that `glapp` turns into a sentence.
    pub reason: &'static str,
    /// Change of the width, where three records or more give one. Where it is plain that the width changes, all the rest is what
    /// the newest record says that gives a width.
    pub trend: Option<Trend>,
}

/// The records of one recording, and what they say together.
#[derive(Clone, Debug)]
pub struct JointAnswer {
    /// Joint result of all records.
    pub whole: Together,
    /// The records, in the order of time.
    pub records: Vec<SegmentAnswer<SegmentFit>>,
    /// Place of the record that shows best what all say.
    pub shown: usize,
}

/// Result of one record, and its time.
#[derive(Clone, Debug)]
pub struct SegmentAnswer<A> {
    /// Time of its first step [s].
    pub start: f64,
    /// Time of its last step [s].
    pub end: f64,
    /// Start of each of its stretches [s].
    pub starts: Vec<f64>,
    /// Time between two steps [s].
    pub h: f64,
    /// Result of the record.
    pub answer: A,
}

impl<A> SegmentAnswer<A> {
    pub(crate) fn of(record: &Segment, answer: A) -> Self {
        let (start, end) = record.span();
        Self { start, end, starts: record.starts(), h: record.h, answer }
    }

    /// Another result of the same record.
    fn with<B>(&self, answer: B) -> SegmentAnswer<B> {
        SegmentAnswer { start: self.start, end: self.end, starts: self.starts.clone(), h: self.h, answer }
    }

    /// The middle of its time [s].
    pub(crate) fn middle(&self) -> f64 {
        0.5 * (self.start + self.end)
    }
}

impl SegmentAnswer<SegmentFit> {
    pub(crate) fn reading(&self) -> Reading {
        let SegmentFit { verdict, d, low, high, lr_no_gap, .. } = self.answer;
        Reading { verdict, d, low, high, lr_no_gap, t: self.middle() }
    }
}

/// One record with its likelihood over the width.
pub(crate) struct Curve {
    /// Time of the record.
    when: SegmentAnswer<()>,
    pub(crate) fitted: Fitted,
    pub(crate) sign: f64,
    /// Weight of a unit of its likelihood: the innovations' information ratio over the scatter by chance in records
    /// without a gap.
    pub(crate) worth: f64,
}

impl Curve {
    pub(crate) fn new(record: &Segment, fitted: Fitted, sign: f64) -> Self {
        let worth = fitted.answer.information_ratio / fitted.by_chance;
        Self { when: SegmentAnswer::of(record, ()), fitted, sign, worth }
    }

    fn answered(&self) -> SegmentAnswer<SegmentFit> {
        self.when.with(self.fitted.answer.clone())
    }

    /// −2·ln L at a width, of the families of a gap and of the valves that stick; beyond OP's range what it is there, infinite
    /// where a valve was not looked at.
    pub(crate) fn costs(&mut self, d: f64) -> Vec<f64> {
        let Fitted { record, profiles, sticking, sticks_in, .. } = &mut self.fitted;
        let of = |structure| Search { record, structure, sign: self.sign };
        let last = |p: &Profile| p.points.last().map_or(0.0, |p| p.lost.d);
        let gaps = profiles.par_iter_mut().map(|p| p.insert(&of(p.structure), d.min(last(p)), ROUNDS));
        let mut costs: Vec<f64> = gaps.collect();
        costs.par_extend(sticking.par_iter_mut().map(|p| {
            let there = (p.points[0].lost.d..=last(p)).contains(&d);
            if there { p.insert(&of(*sticks_in), d, ROUNDS) } else { f64::INFINITY }
        }));
        costs
    }

    /// Cost at a width, on a line between the computed widths.
    pub(crate) fn interpolated_cost(&self, d: f64) -> Vec<f64> {
        let Fitted { profiles, sticking, .. } = &self.fitted;
        let gaps = profiles.iter().map(|p| p.interpolated_cost(d.min(p.points[p.points.len() - 1].lost.d)));
        let sticks = sticking.iter().map(|p| p.interpolated_cost(d));
        gaps.chain(sticks).map(|cost| cost.unwrap_or(f64::INFINITY)).collect()
    }

    /// Widths that were looked at in the best family.
    pub(crate) fn widths(&self) -> impl Iterator<Item = f64> {
        self.fitted.profiles[0].points.iter().map(|p| p.lost.d)
    }

    /// Smallest rise of −2·ln L over its minimum between two widths.
    pub(crate) fn least_off(&self, low: f64, high: f64) -> f64 {
        let between = self.widths().filter(|d| (low..=high).contains(d));
        let high = high.min(self.fitted.record.range);
        between.chain([low, high]).map(|d| self.off(&self.interpolated_cost(d))).fold(f64::INFINITY, f64::min)
    }

    /// Gain of a slip jump; less than 0 where its price is higher.
    pub(crate) fn jumps(&self) -> f64 {
        let Fitted { profiles, sticking, .. } = &self.fitted;
        sticking.first().map_or(0.0, |p| profiles[0].penalised() - p.penalised())
    }

    /// Weight of each of the [`Curve::costs`], its parameters' price, and the cost from which it rises: the least; of a
    /// valve that sticks the one at which it is as likely as a gap, as for the record's own limits.
    fn weights(&self) -> Vec<(f64, f64, f64)> {
        let Fitted { profiles, sticking, sticks_in, .. } = &self.fitted;
        let gaps = profiles.iter().map(|p| (1.0, 2.0 * p.structure.parameters() as f64, p.least()));
        let price = 2.0 * sticks_in.parameters() as f64 + JUMP_PRICE;
        let sticks = |_: &Profile| (RISE / RISE_OF_STICKING, price, as_likely(&profiles[0], &sticking[0]));
        gaps.chain(sticking.iter().map(sticks)).collect()
    }

    /// The least of costs with the parameters' price.
    pub(crate) fn least(&self, costs: &[f64]) -> f64 {
        let all = costs.iter().zip(self.weights()).map(|(cost, (_, price, _))| cost + price);
        all.fold(f64::INFINITY, f64::min)
    }

    /// Rise of the likelihood from costs to others in the family that rises least.
    pub(crate) fn rise(&self, from: &[f64], to: &[f64]) -> f64 {
        let pairs = from.iter().zip(to).zip(self.weights());
        let known = pairs.filter(|((from, to), _)| from.is_finite() && to.is_finite());
        known.map(|((from, to), (weight, ..))| weight * (to - from)).fold(f64::INFINITY, f64::min)
    }

    /// Distance of costs above those from which each family rises, in the family where it is least.
    pub(crate) fn off(&self, costs: &[f64]) -> f64 {
        let above = costs.iter().zip(self.weights()).map(|(cost, (weight, _, least))| weight * (cost - least));
        above.fold(f64::INFINITY, f64::min).max(0.0)
    }

    /// [`Self::off`] in units of which the record's own limits allow [`RISE`].
    pub(crate) fn off_within_limits(&self, costs: &[f64]) -> f64 {
        RISE / self.fitted.answer.rise * self.off(costs)
    }
}

/// All records at one width.
fn costs_at(curves: &mut [Curve], d: f64) -> Vec<Vec<f64>> {
    curves.par_iter_mut().map(|curve| curve.costs(d)).collect()
}

/// Least cost of all records.
fn total_cost(curves: &[Curve], costs: &[Vec<f64>]) -> f64 {
    curves.iter().zip(costs).map(|(curve, costs)| curve.worth * curve.least(costs)).sum()
}

/// Rise of the likelihood in each record from costs to others.
fn rises(curves: &[Curve], from: &[Vec<f64>], to: &[Vec<f64>]) -> Vec<f64> {
    curves.iter().zip(from).zip(to).map(|((curve, from), to)| curve.worth * curve.rise(from, to)).collect()
}

/// Steps of the descent at one more width.
const ROUNDS: usize = 4;
/// Halvings of a border of the interval.
const HALVINGS: usize = 7;

/// The answer of all records of one recording, whose OP and PV were scaled by these units.
pub(crate) fn joint(curves: &mut [Curve], op: Unit, pv: Unit) -> Option<JointAnswer> {
    let fits = |curve: &Curve| curve.fitted.answer.usable();
    let sound = curves.iter().filter(|curve| fits(curve)).count();
    let all = curves.len();
    let mut joint = if all > 1 && 2 * sound > all && sound > 1 {
        curves.sort_by_key(|curve| !fits(curve));
        let whole = joint_width(&mut curves[..sound]);
        JointAnswer { whole, records: curves.iter().map(Curve::answered).collect(), shown: 0 }
    } else {
        // One record, or none but one that can be used: where most cannot, neither does that.
        let records: Vec<SegmentAnswer<SegmentFit>> = curves.iter().map(Curve::answered).collect();
        let usable = |r: &SegmentAnswer<SegmentFit>| 2 * sound > all || !r.answer.usable();
        let best =
            records.iter().filter(|r| usable(r)).max_by(|a, b| a.answer.lr_no_gap.total_cmp(&b.answer.lr_no_gap))?;
        JointAnswer { whole: Together::from(&best.answer), records, shown: 0 }
    };
    joint.shown = joint.clearest();
    joint.in_units(op, pv);
    // Records in the order of time, with the index of the one that is shown.
    let start = joint.records[joint.shown].start;
    joint.records.sort_by(|a, b| a.start.total_cmp(&b.start));
    joint.shown = joint.records.iter().position(|r| r.start == start)?;
    let readings: Vec<Reading> = joint.records.iter().map(SegmentAnswer::reading).collect();
    let trend = Trend::of_readings(&readings);
    if let Some(newest) = newest(trend, &readings) {
        joint.whole = Together::from(&joint.records[newest].answer);
        joint.shown = newest;
    }
    joint.whole.trend = trend;
    Some(joint)
}

/// The newest reading with a width, where it is plain that the width changes.
pub(crate) fn newest(trend: Option<Trend>, readings: &[Reading]) -> Option<usize> {
    trend.filter(Trend::changes).and_then(|_| readings.iter().rposition(|r| r.standard_error().is_some()))
}

impl Together {
    /// Joint result by the evidence of several records.
    pub(crate) fn judged(evidence: Evidence) -> Self {
        let (judgement, reason) = judge(&evidence);
        let verdict = judgement.verdict(evidence.low);
        let (low, high) = evidence.limits(&judgement, evidence.high);
        let Evidence { d, lr_no_gap, passes: traversals, dispersion, .. } = evidence;
        let lr_needed = evidence.needed();
        Self {
            judgement,
            verdict,
            d,
            low,
            high,
            lr_no_gap,
            lr_needed,
            traversals,
            dispersion,
            evidence,
            reason,
            trend: None,
        }
    }

    /// Joint result of one record.
    fn from(answer: &SegmentFit) -> Self {
        let SegmentFit { judgement, verdict, d, low, high, lr_no_gap, lr_needed, traversals, reason, .. } = *answer;
        let evidence = answer.evidence.clone();
        let dispersion = 1.0;
        Self {
            judgement,
            verdict,
            d,
            low,
            high,
            lr_no_gap,
            lr_needed,
            traversals,
            dispersion,
            evidence,
            reason,
            trend: None,
        }
    }
}

impl JointAnswer {
    /// The record that shows the joint result best.
    fn clearest(&self) -> usize {
        let rank = |i: &usize| {
            let SegmentFit { verdict, lr_no_gap, .. } = self.records[*i].answer;
            (verdict == self.whole.verdict, lr_no_gap)
        };
        let order = |a: &usize, b: &usize| rank(a).0.cmp(&rank(b).0).then(rank(a).1.total_cmp(&rank(b).1));
        (0..self.records.len()).max_by(order).unwrap_or(0)
    }

    /// See [`SegmentFit::in_units`].
    fn in_units(&mut self, op: Unit, pv: Unit) {
        self.records.iter_mut().for_each(|r| r.answer.in_units(op, pv));
        for width in [&mut self.whole.d, &mut self.whole.low] {
            *width *= op.size;
        }
        self.whole.high = self.whole.high.map(|high| high * op.size);
        self.whole.evidence.in_units(op);
    }
}

/// One width of two records or more.
fn joint_width(curves: &mut [Curve]) -> Together {
    let n = curves.len() as f64;
    let range = curves.iter().map(|c| c.fitted.record.range).fold(0.0, f64::max);
    let (known, best) = around_most_likely(curves, range);
    let (d, here) = known[best].clone();
    // Distance of the joint width from the optimum of each record alone.
    let off: f64 = curves.iter().zip(&here).map(|(curve, costs)| curve.worth * curve.off(costs)).sum();
    let dispersion = (off / (n - 1.0) / AGREES).max(1.0);
    let (low, high) = interval(curves, &known, &here, RISE * dispersion);
    let resolution = curves.iter().map(|c| c.fitted.record.resolution()).sum::<f64>() / n;
    let low = (low - resolution).max(0.0);
    let high = high.map(|high| high + MISSED_TURNS * resolution);
    let against = against(curves, &here, &known[0].1);
    let lr_no_gap: f64 = against.iter().sum();
    let most = against.iter().copied().fold(0.0, f64::max);
    let times = |d: f64| {
        let each = curves.iter().map(|c| c.fitted.record.traversals(d));
        each.fold([0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
    };
    let traversals = times(d);
    let marks = curves.iter().map(|c| c.fitted.record.changes()).sum();
    let asked = LR_JOINT.max(lr_asked(traversals)).max(lr_asked_of_changes(traversals, marks));
    // Gain of a slip jump over all; where it gains nothing it counts against it.
    let lr_no_jump: f64 = curves.iter().map(|c| c.worth * c.jumps()).sum();
    let jumping = curves.iter().filter(|c| c.jumps() > 0.0).count();
    let agree = curves.iter().filter(|c| (c.fitted.answer.d - d).abs() <= AGREES_WITH * d).count();
    let records: Vec<_> = curves.iter().map(|c| (&c.fitted.answer.evidence, 1.0)).collect();
    Together::judged(Evidence {
        d,
        lr_no_gap,
        lr_needed: (dispersion * asked).max(most + dispersion * LR_MIN),
        low,
        high,
        range,
        one_way: traversals.contains(&0),
        slips: lr_no_jump > LR_JUMP && 2 * jumping > curves.len(),
        passes: traversals,
        passes_high: high.map_or([0; 2], times),
        agree: [agree, curves.len()],
        dispersion,
        shows: Some(records.iter().filter(|(e, _)| e.shows_alone()).count()),
        ..pooled(&records)
    })
}

/// A width, and what it costs in each family of each record.
type Known = (f64, Vec<Vec<f64>>);

/// Widths from 0 to `range` in rising order with their costs, and the index of the most likely one, narrowed down between its neighbours.
fn around_most_likely(curves: &mut [Curve], range: f64) -> (Vec<Known>, usize) {
    let mut tried: Vec<f64> = curves.iter().map(|c| c.fitted.answer.d).chain([0.0, range]).collect();
    tried.sort_by(f64::total_cmp);
    tried.dedup();
    let mut known: Vec<Known> = tried.into_iter().map(|d| (d, costs_at(curves, d))).collect();
    loop {
        let costs: Vec<f64> = known.iter().map(|(_, costs)| total_cost(curves, costs)).collect();
        let best = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).expect("0 at least");
        let room =
            |beside: Option<usize>| beside.and_then(|i| known.get(i)).map_or(0.0, |(d, _)| (d - known[best].0).abs());
        let (below, above) = (room(best.checked_sub(1)), room(Some(best + 1)));
        if below.max(above) < NEAR * known[best].0.max(0.02 * range) {
            return (known, best);
        }
        let d = if below > above { known[best].0 - below / 2.0 } else { known[best].0 + above / 2.0 };
        let costs = costs_at(curves, d);
        known.insert(known.partition_point(|(at, _)| *at < d), (d, costs));
    }
}

/// The first and the last of the widths that lie inside, of which the best is one.
pub(crate) fn ends(inside: &[bool]) -> (usize, usize) {
    let first = inside.iter().position(|i| *i).expect("the best is inside");
    let last = inside.iter().rposition(|i| *i).expect("the best is inside");
    (first, last)
}

/// The widths at which the likelihood has risen by `limit` over the costs `here`; None where the highest of the `known` widths has not
/// risen as far.
fn interval(curves: &mut [Curve], known: &[Known], here: &[Vec<f64>], limit: f64) -> (f64, Option<f64>) {
    let inside = |curves: &[Curve], costs: &[Vec<f64>]| rises(curves, here, costs).iter().sum::<f64>() <= limit;
    let near: Vec<bool> = known.iter().map(|(_, costs)| inside(curves, costs)).collect();
    let (first, last) = ends(&near);
    let mut border = |mut within: f64, mut beyond: f64| {
        for _ in 0..HALVINGS {
            let middle = 0.5 * (within + beyond);
            let costs = costs_at(curves, middle);
            *(if inside(curves, &costs) { &mut within } else { &mut beyond }) = middle;
        }
        0.5 * (within + beyond)
    };
    let low = if first == 0 { 0.0 } else { border(known[first].0, known[first - 1].0) };
    let high = (last + 1 < known.len()).then(|| border(known[last].0, known[last + 1].0));
    (low, high)
}

/// Likelihood ratio of no gap that each record leaves, from the costs `here` to those of `none`: the loads that were looked for take their
/// part of it.
fn against(curves: &[Curve], here: &[Vec<f64>], none: &[Vec<f64>]) -> Vec<f64> {
    let mut against = rises(curves, here, none);
    for (curve, lr) in curves.iter().zip(&mut against) {
        let Fitted { answer, lr_of_loads, .. } = &curve.fitted;
        let jumps = (answer.lr_no_jump - LR_JUMP).max(0.0);
        *lr = (*lr + curve.worth * jumps).min(curve.worth * lr_of_loads);
    }
    against
}

/// Relative accuracy of the most likely width.
const NEAR: f64 = 0.01;
