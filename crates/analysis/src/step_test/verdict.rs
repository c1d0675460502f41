//! From holds to the dead band, the process gain and their intervals, or the reason why there are none.

use super::asked::Asked;
use super::blocks::{Blocks, matrix};
use super::holds::{Node, holds};
use super::moves::{Move, difference, moves};
use super::posterior::{Axes, Limits, Posterior};
use super::response::response;
use super::settling::{TAILS, TestSignals};
use super::{Evidence, Hold, Kind, LEAST_ROWS, Note, Reading, Reason, StepTest, range};
use crate::{median, resolution};
use std::ops::Range;

/// Settled holds that are read: the time to read them grows with the third power of their number.
const MOST_HOLDS: usize = 60;
/// Least degrees of freedom behind an interval: below, Student's distribution is wider than a person takes an interval for.
const FREEDOM: usize = 5;
/// F ratio from which holds that lie off the model widen the interval: one test in a few hundred reaches it by chance.
const MISFIT: f64 = 4.0;
/// Part of its settling time that a hold must go on for after PV has settled.
const STAYS: f64 = 0.2;
/// Part of PV's range that a response leaves when it is not quite over.
const NOT_OVER: f64 = 1e-3;

/// Reads one signal's answer (PV's or the position's) to the moves of OP.
pub(super) fn read(
    t: &[f64],
    op: &[f64],
    y: &[f64],
    stretches: &[Range<usize>],
    integrating: bool,
    width: Option<f64>,
) -> StepTest {
    let mut steps: Vec<f64> =
        stretches.iter().flat_map(|part| t[part.clone()].windows(2).map(|pair| pair[1] - pair[0])).collect();
    let signals = TestSignals { t, op, y, h: median(&mut steps) };
    let (nodes, tolerance) = holds(op, y, stretches);
    Test { signals, nodes, tolerance, integrating, width }.answer()
}

struct Test<'a> {
    signals: TestSignals<'a>,
    nodes: Vec<Node>,
    tolerance: f64,
    integrating: bool,
    /// Width in question.
    width: Option<f64>,
}

impl Test<'_> {
    /// Finds the settled holds, the reading of each move, and their joint result.
    fn answer(mut self) -> StepTest {
        let integrating = self.integrating;
        let asked = self.width.map(Asked::open);
        let refused = |reason| StepTest { integrating, asked, ..StepTest::refused(reason) };
        if self.nodes.is_empty() {
            return refused(Reason::NeverHeld { rows: LEAST_ROWS });
        }
        if self.at_one_value(&self.nodes) {
            return refused(Reason::OneValue);
        }
        let settle = self.signals.settling(&self.nodes);
        self.settled(settle);
        let settled: Vec<Node> = self.nodes.iter().copied().filter(|node| node.settled.is_some()).collect();
        let so_far = StepTest {
            integrating,
            holds: self.holds(&[], &[]),
            settle: (!integrating).then_some(settle),
            asked,
            ..StepTest::default()
        };
        if settled.len() < 3 {
            let reason = if integrating {
                Reason::TooFewHolds { settled: settled.len(), rows: 2 * LEAST_ROWS }
            } else {
                let needed = settle * (1.0 + STAYS);
                Reason::NotSettled { settled: settled.len(), holds: self.nodes.len(), needed }
            };
            return StepTest { reason: Some(reason), ..so_far };
        }
        let in_a_row = |node: &&Node| settled.iter().filter(|other| other.stretch == node.stretch).count() > 1;
        self.together(settled.iter().filter(in_a_row).copied().collect(), settle, so_far)
    }

    /// Whether all holds are at one OP, so that no gap shows.
    fn at_one_value(&self, nodes: &[Node]) -> bool {
        range(&nodes.iter().map(|node| node.op).collect::<Vec<_>>()) <= self.tolerance
    }

    /// Marks from which row on each hold is settled; of an integrating process the second half of each.
    fn settled(&mut self, settle: f64) {
        let TestSignals { t, y, h, .. } = self.signals;
        for node in &mut self.nodes {
            let (start, end) = (t[node.first], t[node.end - 1]);
            let wait = if self.integrating { (end - start) / 2.0 } else { settle };
            let least = wait + (LEAST_ROWS as f64 * h).max(STAYS * wait) - 1e-9 * h;
            if end - start < least && !self.integrating {
                continue;
            }
            let first = node.first + t[node.first..node.end].partition_point(|t| *t < start + wait);
            if y[first..node.end].iter().filter(|y| y.is_finite()).count() >= LEAST_ROWS {
                node.settled = Some(first);
            }
        }
    }

    /// Fits one dead band and one gain to all settled holds.
    fn together(&self, mut nodes: Vec<Node>, settle: f64, mut outcome: StepTest) -> StepTest {
        let refused = |outcome: StepTest, reason| StepTest { reason: Some(reason), ..outcome };
        if nodes.len() < 3 || self.at_one_value(&nodes) {
            return refused(outcome, Reason::NotInARow);
        }
        let more = nodes.len().saturating_sub(MOST_HOLDS);
        nodes.truncate(MOST_HOLDS);
        let TestSignals { t, op, y, h } = self.signals;
        let lag = if self.integrating { 0.0 } else { settle / (1.0 + TAILS) };
        let blocks = Blocks::of(t, y, h, &nodes, lag, self.integrating);
        let extra = self.coarse();
        let Some(each) = EachHold::of(&blocks, nodes.len(), extra) else {
            return refused(outcome, Reason::TooShort);
        };
        let sign = each.sign(&nodes);
        let moves = moves(&mut nodes, op, self.tolerance, &each.fit, &each.ends, sign);
        let levels = levels(&blocks, nodes.len());
        outcome.holds = self.holds(&nodes, &levels);
        outcome.readings = moves.iter().map(|one| self.plain(one, &nodes, &levels)).collect();
        if let Some(reason) = self.without_gain(&moves, &nodes) {
            return refused(outcome, reason);
        }
        let reversed = moves.iter().any(|one| one.kind == Kind::Gap);
        let Some(all) = AllHolds::of(&blocks, &nodes, sign, reversed, extra) else {
            return refused(outcome, Reason::TooShort);
        };
        let kp = all.fit.interval(&all.gain);
        if kp.low <= 0.0 {
            return refused(outcome, all.misfit.map_or(Reason::GainNearZero, |f| Reason::GainNearZeroDisagree { f }));
        }
        for (one, reading) in moves.iter().zip(&mut outcome.readings) {
            valued(one, reading, each.change(one.origin, one.to), kp);
        }
        let answered = outcome.readings.iter().filter(|one| {
            let sure = |(low, high): (f64, f64)| low * high > 0.0;
            one.kind == Kind::Gain && one.low.zip(one.high).is_some_and(sure)
        });
        outcome.resolution = answered.map(|one| (one.op.1 - one.op.0).abs()).reduce(f64::min);
        let signed = kp.map(|kp| sign * kp);
        outcome.kp = Some(signed.median);
        outcome.kp_low = Some(signed.low.min(signed.high));
        outcome.kp_high = Some(signed.low.max(signed.high));
        let Some(at_gap) = &all.gap else {
            return self.bounded(&moves, &each, kp, outcome);
        };
        let d = all.fit.ratio(at_gap, &all.gain).map(|d| d.max(0.0));
        outcome.asked = self.width.map(|width| Asked::by(width, |x| all.fit.ratio_below(x, at_gap, &all.gain)));
        let notes = [
            (more > 0).then_some(Note::FirstHolds { read: MOST_HOLDS, left: more }),
            all.misfit.map(|f| Note::Disagree { f }),
            (d.low == 0.0).then_some(Note::ReachesZero { high: d.high }),
        ];
        let notes = notes.into_iter().flatten().collect();
        StepTest { reason: None, d: Some(d.median), low: Some(d.low), high: Some(d.high), notes, ..outcome }
    }

    /// Why the moves give no process gain; None where they do.
    fn without_gain(&self, moves: &[Move], nodes: &[Node]) -> Option<Reason> {
        if moves.iter().all(Move::unanswered) && nodes.iter().all(|node| node.side == 0) {
            let largest = nodes.windows(2).map(|pair| (pair[1].op - pair[0].op).abs()).fold(0.0, f64::max);
            return Some(Reason::UnansweredMoves { largest });
        }
        if moves.iter().any(|one| one.kind == Kind::Gain) {
            return None;
        }
        let unsettled = self.nodes.iter().filter(|node| node.settled.is_none()).count();
        Some(match unsettled {
            0 => Reason::NoGain,
            _ => Reason::NoGainUnsettled { unsettled, holds: self.nodes.len() },
        })
    }

    /// The bound that the largest reversal without an answer gives, where no reversal came through the gap.
    fn bounded(&self, moves: &[Move], each: &EachHold, kp: Limits, outcome: StepTest) -> StepTest {
        let silent = moves.iter().filter_map(|one| Some((one, one.since.filter(|_| one.unanswered())?)));
        // The first of the largest.
        let largest = silent.reduce(|a, b| if b.0.travel.abs() > a.0.travel.abs() { b } else { a });
        let Some((one, since)) = largest else {
            return StepTest { reason: Some(Reason::NoReversal), ..outcome };
        };
        let answer = each.change(since, one.to);
        let most = answer.low.abs().max(answer.high.abs());
        let at_least = (one.travel.abs() - most / kp.low).max(0.0);
        StepTest {
            reason: Some(Reason::AtLeast { reversal: one.travel.abs(), at_least }),
            low: Some(at_least),
            asked: self.width.map(|width| Asked::at_least(width, at_least)),
            ..outcome
        }
    }

    /// Variance that a coarse signal adds to a level.
    fn coarse(&self) -> f64 {
        let mut values: Vec<f64> = self.signals.y.iter().filter(|y| !y.is_nan()).map(|y| y + 0.0).collect();
        let bad = values.len() < self.signals.y.len();
        values.sort_unstable_by(f64::total_cmp);
        values.dedup();
        // A value a hold makes no grid.
        if self.integrating || values.len() + usize::from(bad) <= self.nodes.len() {
            return 0.0;
        }
        resolution(self.signals.y).map_or(0.0, |(step, _)| step * step / 12.0)
    }

    /// A move before the process gain is known.
    fn plain(&self, one: &Move, nodes: &[Node], levels: &[f64]) -> Reading {
        let (a, b) = (&nodes[one.origin], &nodes[one.to]);
        let moved = one.kind != Kind::None && one.to == one.origin + 1 && !self.integrating;
        let levels_of = (levels[one.origin], levels[one.to]);
        let (t86, overshoot) = if moved { response(&self.signals, a, b, levels_of) } else { (None, None) };
        Reading {
            kind: one.kind,
            start: self.signals.t[a.end - 1],
            end: self.signals.t[b.end - 1],
            op: (a.op, b.op),
            pv: levels_of,
            value: None,
            low: None,
            high: None,
            t86,
            overshoot,
            evidence: one.why,
        }
    }

    /// All holds, with level and side of those that were read.
    fn holds(&self, read: &[Node], levels: &[f64]) -> Vec<Hold> {
        let t = self.signals.t;
        let hold = |node: &Node| {
            let at = read.iter().position(|other| other.first == node.first);
            Hold {
                start: t[node.first],
                end: t[node.end - 1],
                settled: node.settled.map(|settled| t[settled]),
                op: node.op,
                level: at.map(|at| levels[at]),
                side: at.map_or(0, |at| read[at].side),
            }
        };
        self.nodes.iter().map(hold).collect()
    }
}

/// A level of PV for each hold, without a model of what leads from one to the next: only the slopes of the drift are common.
struct EachHold {
    fit: Posterior,
    /// The columns of the levels.
    ends: Vec<Vec<f64>>,
}

impl EachHold {
    /// None where the holds have too few rows.
    fn of(blocks: &Blocks, holds: usize, extra: f64) -> Option<Self> {
        let mut columns = blocks.levels();
        columns.extend(blocks.drift(false));
        if blocks.len() < columns.len() + FREEDOM {
            return None;
        }
        let fit = Posterior::of(&columns, &Axes::of(blocks)?, extra, 1.0)?;
        let ends = (0..holds).map(|i| unit(i, columns.len())).collect();
        Some(Self { fit, ends })
    }

    /// Change of PV from one hold to another.
    fn change(&self, from: usize, to: usize) -> Limits {
        self.fit.interval(&difference(&self.ends[to], &self.ends[from], 1.0))
    }

    /// Sign of the process gain: whether PV mostly went the way of OP.
    fn sign(&self, nodes: &[Node]) -> f64 {
        // `below` is small where PV rose.
        let against = |i: usize| {
            let fell = self.fit.below(0.0, &difference(&self.ends[i + 1], &self.ends[i], 1.0)) - 0.5;
            (nodes[i + 1].op - nodes[i].op) * fell
        };
        if (0..nodes.len() - 1).map(against).sum::<f64>() > 0.0 { -1.0 } else { 1.0 }
    }
}

/// One process gain for all holds whose side of the gap is known, and one dead band where OP reversed through it.
struct AllHolds {
    fit: Posterior,
    /// The column of the gain [PV unit / OP unit], and that of the dead band times the gain.
    gain: Vec<f64>,
    gap: Option<Vec<f64>>,
    /// F ratio by which the holds lie off the model, where it widens the interval.
    misfit: Option<f64>,
}

impl AllHolds {
    /// None where the holds have too few rows, or do not tell gain and dead band from the drift.
    fn of(blocks: &Blocks, nodes: &[Node], sign: f64, reversed: bool, extra: f64) -> Option<Self> {
        let used: Vec<usize> = (0..nodes.len()).filter(|i| nodes[*i].side != 0).collect();
        let part = blocks.of_holds(&used);
        let mut columns = part.drift(true);
        let at = columns.len();
        let middle = part.hold.iter().map(|i| nodes[*i].op).sum::<f64>() / part.len() as f64;
        columns.push(part.hold.iter().map(|i| sign * (nodes[*i].op - middle)).collect());
        if reversed {
            columns.push(part.hold.iter().map(|i| -sign * f64::from(nodes[*i].side) / 2.0).collect());
        }
        if part.len() < columns.len() + FREEDOM || !independent(&columns) {
            return None;
        }
        let axes = Axes::of(&part)?;
        let fit = Posterior::of(&columns, &axes, extra, 1.0)?;
        let misfit = misfit(&part, &axes, &fit, extra);
        let fit = misfit.map_or(Some(fit), |f| Posterior::of(&columns, &axes, extra, f))?;
        let gap = reversed.then(|| unit(at + 1, columns.len()));
        Some(Self { fit, gain: unit(at, columns.len()), gap, misfit })
    }
}

/// One of so many columns alone.
fn unit(at: usize, of: usize) -> Vec<f64> {
    (0..of).map(|i| f64::from(u8::from(i == at))).collect()
}

/// Weighted mean of each hold's blocks.
fn levels(blocks: &Blocks, holds: usize) -> Vec<f64> {
    let (mut sum, mut rows) = (vec![0.0; holds], vec![0.0; holds]);
    for (i, hold) in blocks.hold.iter().enumerate() {
        sum[*hold] += blocks.y[i] * blocks.rows[i];
        rows[*hold] += blocks.rows[i];
    }
    sum.iter().zip(rows).map(|(sum, rows)| sum / rows).collect()
}

/// Whether no column is a sum of others: no singular value is below the rounding of the largest.
fn independent(columns: &[Vec<f64>]) -> bool {
    if columns.iter().flatten().any(|x| !x.is_finite()) {
        return false;
    }
    let values = matrix(columns).singular_values();
    let n = columns[0].len().max(columns.len()) as f64;
    values.min() > values.max() * n * f64::EPSILON
}

/// F ratio of a fit with a free level for each hold against the model; None where it is too small to show a misfit.
fn misfit(blocks: &Blocks, axes: &Axes, tight: &Posterior, extra: f64) -> Option<f64> {
    let mut columns = blocks.levels();
    columns.extend(blocks.drift(false));
    let model = blocks.len() - tight.freedom;
    if columns.len() <= model || blocks.len() <= columns.len() {
        return None;
    }
    let more = columns.len() - model;
    let loose = Posterior::of(&columns, axes, extra, 1.0)?;
    let at = loose.best;
    let rest = loose.rss[at] / loose.freedom as f64;
    // Errors that the noise does not show: the steps of a coarse PV, and the tail of an unfinished response.
    let known = extra + (NOT_OVER * range(&blocks.y)).powi(2);
    let beside = (rest + known * super::blocks::MEANS as f64).max(1e-300);
    let ratio = (tight.rss[at] - loose.rss[at]) / more as f64 / beside;
    (ratio > MISFIT).then_some(ratio)
}

/// Gives a move its value: intervals to first order, from those of PV's answer and of Kp.
fn valued(one: &Move, reading: &mut Reading, answer: Limits, kp: Limits) {
    let (change, error) = (answer.median, (answer.high - answer.low) / 2.0);
    let travel = one.travel.abs();
    let (value, error, evidence) = match one.kind {
        Kind::None => return,
        Kind::Gain => {
            let evidence = Evidence::Gain { delta_pv: change, delta_op: one.travel };
            (change / one.travel, error / travel, evidence)
        }
        Kind::Gap => {
            let of_gain = change / kp.median.powi(2) * (kp.high - kp.low) / 2.0;
            let evidence = Evidence::Gap { delta_op: travel, delta_pv: change.abs(), kp: kp.median };
            (travel - change.abs() / kp.median, (error / kp.median).hypot(of_gain), evidence)
        }
    };
    reading.value = Some(value);
    reading.low = Some(value - error);
    reading.high = Some(value + error);
    reading.evidence = Some(evidence);
}
