//! One answer from all records: one width, everything else free in each.

use crate::data::record::Record;
use crate::data::signal::Unit;
use crate::decide::combine::Reading;
use crate::decide::record::{Answer, Fitted};
use crate::decide::thresholds::*;
use crate::decide::trend::Trend;
use crate::decide::verdict::{Evidence, Verdict, judge, lr_asked, lr_asked_of_changes, often};
use crate::problem::Problem;
use crate::search::likelihood::Search;
use crate::search::profile::Profile;
use rayon::prelude::*;

/// What the records say together.
#[derive(Clone, Debug)]
pub struct JointAnswer {
    /// The verdict.
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
    /// By how much the records differ more than their intervals allow, 1 where they do not.
    pub dispersion: f64,
    /// Why the verdict is what it is, a word that `glapp` turns into a sentence.
    pub reason: &'static str,
    /// Change of the width, where three records or more give one. Where it is plain that the width changes, all the rest is what
    /// the newest record says that gives a width.
    pub trend: Option<Trend>,
    /// The records, in the order of time.
    pub records: Vec<RecordAnswer<Answer>>,
    /// Place of the record that shows best what all say.
    pub shown: usize,
}

/// What one record says, and when that was.
#[derive(Clone, Debug)]
pub struct RecordAnswer<A> {
    /// When its first step is [s].
    pub start: f64,
    /// When its last step is [s].
    pub end: f64,
    /// When each of its stretches starts [s].
    pub starts: Vec<f64>,
    /// Time between two steps [s].
    pub h: f64,
    /// What it says.
    pub answer: A,
}

impl<A> RecordAnswer<A> {
    pub(crate) fn of(record: &Record, answer: A) -> Self {
        let (start, end) = record.span();
        Self { start, end, starts: record.starts(), h: record.h, answer }
    }

    /// The middle of its time [s].
    pub(crate) fn middle(&self) -> f64 {
        0.5 * (self.start + self.end)
    }
}

impl RecordAnswer<Answer> {
    fn reading(&self) -> Reading {
        let Answer { verdict, d, low, high, lr_no_gap, .. } = self.answer;
        Reading { verdict, d, low, high, lr_no_gap, t: self.middle() }
    }
}

/// One record, and all that the likelihood says there of another width.
struct Curve<'a> {
    record: Record<'a>,
    fitted: Fitted,
    sign: f64,
    /// What a unit of its likelihood is worth: the innovations' trust over what chance makes of records without a gap.
    worth: f64,
}

impl Curve<'_> {
    /// −2·ln L at a width, of the families of a gap and of the valves that stick; beyond OP's range what it is there, infinite
    /// where a valve was not looked at.
    fn costs(&mut self, d: f64) -> Vec<f64> {
        let Fitted { record, profiles, sticking, sticks_in, .. } = &mut self.fitted;
        let of = |structure| Search { record, structure, sign: self.sign };
        let last = |p: &Profile| p.points.last().map_or(0.0, |p| p.lost.d);
        let gaps = profiles.iter_mut().map(|p| p.insert(&of(p.structure), d.min(last(p)), ROUNDS));
        let mut costs: Vec<f64> = gaps.collect();
        costs.extend(sticking.iter_mut().map(|p| {
            let there = (p.points[0].lost.d..=last(p)).contains(&d);
            if there { p.insert(&of(*sticks_in), d, ROUNDS) } else { f64::INFINITY }
        }));
        costs
    }

    /// How much each of the [`Curve::costs`] counts, its parameters' price, and its least.
    fn weights(&self) -> Vec<(f64, f64, f64)> {
        let Fitted { profiles, sticking, sticks_in, .. } = &self.fitted;
        let gaps = profiles.iter().map(|p| (1.0, 2.0 * p.structure.parameters() as f64, p.least()));
        let sticks = 2.0 * sticks_in.parameters() as f64 + JUMP_PRICE;
        gaps.chain(sticking.iter().map(|p| (RISE / RISE_OF_STICKING, sticks, p.least()))).collect()
    }
}

/// All records at one width.
fn costs_at(curves: &mut [Curve], d: f64) -> Vec<Vec<f64>> {
    curves.par_iter_mut().map(|curve| curve.costs(d)).collect()
}

/// What all records cost at best.
fn total_cost(curves: &[Curve], costs: &[Vec<f64>]) -> f64 {
    let least = |(curve, costs): (&Curve, &Vec<f64>)| {
        let prices = curve.weights();
        let all = costs.iter().zip(prices).map(|(cost, (_, price, _))| cost + price);
        curve.worth * all.fold(f64::INFINITY, f64::min)
    };
    curves.iter().zip(costs).map(least).sum()
}

/// How far the likelihood rises in each record from costs to others in the family that rises least.
fn rises(curves: &[Curve], from: &[Vec<f64>], to: &[Vec<f64>]) -> Vec<f64> {
    let rise = |((curve, from), to): ((&Curve, &Vec<f64>), &Vec<f64>)| {
        let pairs = from.iter().zip(to).zip(curve.weights());
        let known = pairs.filter(|((from, to), _)| from.is_finite() && to.is_finite());
        curve.worth * known.map(|((from, to), (weight, ..))| weight * (to - from)).fold(f64::INFINITY, f64::min)
    };
    curves.iter().zip(from).zip(to).map(rise).collect()
}

/// Steps of the descent at one more width.
const ROUNDS: usize = 4;
/// Halvings of a border of the interval.
const HALVINGS: usize = 7;

/// The answer of all records.
pub(crate) fn joint(fitted: Vec<(Record, Fitted)>, problem: &Problem, op: Unit, pv: Unit) -> Option<JointAnswer> {
    let fits = |fitted: &Fitted| fitted.answer.usable();
    let sound = fitted.iter().filter(|(_, fitted)| fits(fitted)).count();
    let all = fitted.len();
    let worth = |fitted: &Fitted| fitted.answer.trust / fitted.by_chance;
    let curves =
        fitted.into_iter().map(|(record, fitted)| Curve { worth: worth(&fitted), record, fitted, sign: problem.sign });
    let answered = |curve: Curve| RecordAnswer::of(&curve.record, curve.fitted.answer);
    let mut joint = if all > 1 && 2 * sound > all && sound > 1 {
        let (mut fit, unfit): (Vec<Curve>, Vec<Curve>) = curves.partition(|curve| fits(&curve.fitted));
        let mut joint = joint_width(&mut fit);
        joint.records = fit.into_iter().chain(unfit).map(answered).collect();
        joint
    } else {
        // One record, or none but one that can be used: where most cannot, neither does that.
        let mut records: Vec<RecordAnswer<Answer>> = curves.map(answered).collect();
        let usable = |r: &RecordAnswer<Answer>| 2 * sound > all || !r.answer.usable();
        let best = (0..records.len())
            .filter(|i| usable(&records[*i]))
            .max_by(|a, b| records[*a].answer.lr_no_gap.total_cmp(&records[*b].answer.lr_no_gap))?;
        records.swap(0, best);
        let mut joint = JointAnswer::from(&records[0].answer);
        joint.records = records;
        joint
    };
    joint.shown = joint.clearest();
    joint.in_units(op, pv);
    // In the order of time, with the place of the one that is shown.
    let start = joint.records[joint.shown].start;
    joint.records.sort_by(|a, b| a.start.total_cmp(&b.start));
    joint.shown = joint.records.iter().position(|r| r.start == start)?;
    let readings: Vec<Reading> = joint.records.iter().map(RecordAnswer::reading).collect();
    let trend = Trend::of(&readings);
    if let Some(newest) = newest(trend, &readings) {
        let todays = JointAnswer::from(&joint.records[newest].answer);
        joint = JointAnswer { records: joint.records, shown: newest, ..todays };
    }
    Some(JointAnswer { trend, ..joint })
}

/// The newest reading with a width, where it is plain that the width changes.
pub(crate) fn newest(trend: Option<Trend>, readings: &[Reading]) -> Option<usize> {
    trend.filter(Trend::changes).and_then(|_| readings.iter().rposition(|r| r.standard_error().is_some()))
}

impl JointAnswer {
    /// What one record says.
    fn from(answer: &Answer) -> Self {
        let Answer { verdict, d, low, high, lr_no_gap, lr_needed, traversals, reason, .. } = *answer;
        let (trend, dispersion, records) = (None, 1.0, Vec::new());
        Self { verdict, d, low, high, lr_no_gap, lr_needed, traversals, dispersion, reason, trend, records, shown: 0 }
    }

    /// The record that shows best what all say.
    fn clearest(&self) -> usize {
        let rank = |i: &usize| {
            let Answer { verdict, lr_no_gap, .. } = self.records[*i].answer;
            (verdict == self.verdict, lr_no_gap)
        };
        let order = |a: &usize, b: &usize| rank(a).0.cmp(&rank(b).0).then(rank(a).1.total_cmp(&rank(b).1));
        (0..self.records.len()).max_by(order).unwrap_or(0)
    }

    /// See [`Answer::in_units`].
    fn in_units(&mut self, op: Unit, pv: Unit) {
        self.records.iter_mut().for_each(|r| r.answer.in_units(op, pv));
        for width in [&mut self.d, &mut self.low] {
            *width *= op.size;
        }
        self.high = self.high.map(|high| high * op.size);
    }
}

/// One width of two records or more.
fn joint_width(curves: &mut [Curve]) -> JointAnswer {
    let n = curves.len() as f64;
    let range = curves.iter().map(|c| c.fitted.record.range).fold(0.0, f64::max);
    let mut tried: Vec<f64> = curves.iter().map(|c| c.fitted.answer.d).chain([0.0, range]).collect();
    tried.sort_by(f64::total_cmp);
    tried.dedup();
    let mut known: Vec<(f64, Vec<Vec<f64>>)> = tried.into_iter().map(|d| (d, costs_at(curves, d))).collect();
    // The most likely width, narrowed down between its neighbours.
    let best = loop {
        let costs: Vec<f64> = known.iter().map(|(_, costs)| total_cost(curves, costs)).collect();
        let best = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).expect("0 at least");
        let room =
            |beside: Option<usize>| beside.and_then(|i| known.get(i)).map_or(0.0, |(d, _)| (d - known[best].0).abs());
        let (below, above) = (room(best.checked_sub(1)), room(Some(best + 1)));
        if below.max(above) < NEAR * known[best].0.max(0.02 * range) {
            break best;
        }
        let d = if below > above { known[best].0 - below / 2.0 } else { known[best].0 + above / 2.0 };
        let costs = costs_at(curves, d);
        known.insert(known.partition_point(|(at, _)| *at < d), (d, costs));
    };
    let (d, here) = known[best].clone();
    // How far each record's own optimum lies off.
    let own = |(curve, costs): (&Curve, &Vec<f64>)| {
        let above = costs.iter().zip(curve.weights()).map(|(cost, (weight, _, least))| weight * (cost - least));
        curve.worth * above.fold(f64::INFINITY, f64::min).max(0.0)
    };
    let off: f64 = curves.iter().zip(&here).map(own).sum();
    let dispersion = (off / (n - 1.0) / AGREES).max(1.0);
    let rise = |curves: &[Curve], costs: &[Vec<f64>]| rises(curves, &here, costs).iter().sum::<f64>();
    let limit = RISE * dispersion;
    let inside: Vec<bool> = known.iter().map(|(_, costs)| rise(curves, costs) <= limit).collect();
    let (first, last) = (inside.iter().position(|i| *i), inside.iter().rposition(|i| *i));
    let (first, last) = (first.expect("the best is inside"), last.expect("the best is inside"));
    let mut border = |mut within: f64, mut beyond: f64| {
        for _ in 0..HALVINGS {
            let middle = 0.5 * (within + beyond);
            let costs = costs_at(curves, middle);
            *(if rise(curves, &costs) <= limit { &mut within } else { &mut beyond }) = middle;
        }
        0.5 * (within + beyond)
    };
    let low = if first == 0 { 0.0 } else { border(known[first].0, known[first - 1].0) };
    let high = (last + 1 < known.len()).then(|| border(known[last].0, known[last + 1].0));
    let resolution = curves.iter().map(|c| c.fitted.record.resolution()).sum::<f64>() / n;
    let low = (low - resolution).max(0.0);
    // No gap: what each record leaves of it, the loads that were looked for counted in.
    let none = &known[0].1;
    let mut against: Vec<f64> = rises(curves, &here, none);
    for (curve, lr) in curves.iter().zip(&mut against) {
        let Fitted { answer, lr_of_loads, .. } = &curve.fitted;
        let jumps = (answer.lr_no_jump - JUMP).max(0.0);
        *lr = (*lr + curve.worth * jumps).min(curve.worth * lr_of_loads);
    }
    let lr_no_gap: f64 = against.iter().sum();
    let most = against.iter().copied().fold(0.0, f64::max);
    let times = |d: f64| {
        let each = curves.iter().map(|c| c.fitted.record.traversals(d));
        each.fold([0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
    };
    let traversals = times(d);
    let many = |of: fn(&Evidence) -> bool| 2 * curves.iter().filter(|c| of(&c.fitted.evidence)).count() > curves.len();
    let known = many(|e| e.changes_known);
    let marks = curves.iter().map(|c| c.fitted.record.changes()).sum();
    let asked = GAP_JOINT.max(lr_asked(traversals, known)).max(lr_asked_of_changes(traversals, marks));
    let lr_needed = (dispersion * asked).max(most + dispersion * GAP_WITHOUT_ONE);
    // What a slip jump brings over all, where it brings nothing it counts against it.
    let jumps =
        |fitted: &Fitted| fitted.sticking.first().map_or(0.0, |p| fitted.profiles[0].penalised() - p.penalised());
    let lr_no_jump: f64 = curves.iter().map(|c| c.worth * jumps(&c.fitted)).sum();
    let jumping = curves.iter().filter(|c| jumps(&c.fitted) > 0.0).count();
    let mean = |of: fn(&Evidence) -> f64| curves.iter().map(|c| of(&c.fitted.evidence)).sum::<f64>() / n;
    let high = high.map(|high| high + 3.0 * resolution);
    let mut hidden: Vec<f64> = curves.iter().map(|c| c.fitted.evidence.drawn).collect();
    hidden.sort_by(f64::total_cmp);
    let evidence = Evidence {
        echo: mean(|e| e.echo),
        d,
        changes_known: known,
        lr_no_gap,
        lr_needed,
        lr_no_answer: mean(|e| e.lr_no_answer),
        low,
        high,
        range,
        immobile: many(|e| e.immobile),
        traversed: often(lr_no_gap / dispersion, times(low), traversals),
        one_way: traversals.contains(&0),
        coarse: many(|e| e.coarse),
        noisy: many(|e| e.noisy),
        slips: lr_no_jump > JUMP && 2 * jumping > curves.len(),
        slips_wholly: many(|e| e.slips_wholly),
        periodic_load: many(|e| e.periodic_load),
        even_swing: many(|e| e.even_swing),
        drawn: hidden[hidden.len() / 2],
        hidden: curves.iter().find_map(|c| c.fitted.evidence.hidden).filter(|_| many(|e| e.hidden.is_some())),
        dissent: 3 * curves.iter().filter(|c| c.fitted.evidence.dissent).count() > curves.len(),
    };
    let (verdict, reason) =
        if dispersion > DISAGREE { (Verdict::CannotTell, "windows_disagree") } else { judge(&evidence) };
    let high = high.filter(|_| verdict != Verdict::AtLeast);
    let (trend, records, shown, lr_needed) = (None, Vec::new(), 0, evidence.needed());
    JointAnswer { verdict, d, low, high, lr_no_gap, lr_needed, traversals, dispersion, reason, trend, records, shown }
}

/// How near the most likely width is found, part of itself.
const NEAR: f64 = 0.01;
