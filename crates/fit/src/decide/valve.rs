//! One answer of several recordings of one valve: the width is shared, everything else is free in each.
//!
//! Windows of one recording answer in [`joint`]. Recordings of other days differ in more. A record that alone would be refused
//! because a load or a recorder may have looked like its gap ([`Member::refused`]) says nothing here either, neither for a gap nor
//! against one: its model is not to be believed, and ten of its kind would be sure of something wrong. What is merely too little
//! alone, few moves of OP or a likelihood ratio below what is asked, adds up; and a gap has to show without any one recording.
//!
//! [`joint`]: crate::decide::joint

use crate::data::backlash_model::BacklashModel;
use crate::data::samples::Unfit;
use crate::data::signal::Unit;
use crate::decide::combine::Reading;
use crate::decide::evidence::{Evidence, lr_asked_of_changes, lr_asked_of_passes};
use crate::decide::joint::{Curve, JointAnswer, Together, ends, newest};
use crate::decide::judgement::{Confidence, Judgement, Verdict};
use crate::decide::pooled::pooled;
use crate::decide::segment::swings_evenly;
use crate::decide::thresholds::*;
use crate::decide::trend::Trend;
use crate::loads::cycle::lr_beside_cycle;
use rayon::prelude::*;
use std::cmp::Ordering;

/// One answer of all recordings of a valve.
#[derive(Clone, Debug)]
pub struct ValveAnswer {
    /// Result of all recordings.
    pub whole: Together,
    /// The recordings, in the order given.
    pub recordings: Vec<RecordingAnswer>,
    /// Place of the recording that shows best what all say.
    pub shown: usize,
    /// Whether the width is that of all that count; else it is that of the recording shown.
    pub shared: bool,
}

/// Result of one recording, and its contribution to the whole.
#[derive(Clone, Debug)]
pub struct RecordingAnswer {
    /// Result of the recording alone; the reason where it cannot be fitted.
    pub own: Result<JointAnswer, Unfit>,
    /// Share of its rows that stand in an earlier recording; their PV counts there.
    pub repeated: f64,
    /// Why it does not count in the joint answer, a word that `glapp` turns into a sentence; None where it does.
    pub left_out: Option<&'static str>,
    /// Likelihood ratio of no gap that it adds.
    pub lr_no_gap: f64,
}

/// A recording with all that the likelihood says there of another width.
pub(crate) struct Recording {
    own: Result<JointAnswer, Unfit>,
    repeated: f64,
    /// Time 0 of the recording [s].
    since: f64,
    curves: Vec<Curve>,
    /// A width of its curves is so much [OP unit].
    size: f64,
}

impl Recording {
    pub(crate) fn new(since: f64, repeated: f64, own: JointAnswer, curves: Vec<Curve>, op: Unit) -> Self {
        Self { own: Ok(own), repeated, since, curves, size: op.size }
    }

    pub(crate) fn unfit(repeated: f64, why: Unfit) -> Self {
        Self { own: Err(why), repeated, since: f64::NAN, curves: Vec::new(), size: 1.0 }
    }

    /// Why none of its records can count, whatever the width is.
    fn useless(&self) -> Option<&'static str> {
        match &self.own {
            Err(_) => Some("unfit"),
            Ok(_) if self.usable().next().is_some() => None,
            Ok(own) => Some(own.whole.reason),
        }
    }

    /// Curves of the windows whose fit can be believed.
    fn usable(&self) -> impl Iterator<Item = &Curve> {
        self.curves.iter().filter(|curve| curve.fitted.answer.usable())
    }

    /// The width with its limits and its time, for the trend.
    fn reading(&self) -> Option<Reading> {
        let own = self.own.as_ref().ok()?;
        let (first, last) = (own.records.first()?, own.records.last()?);
        let Together { verdict, d, low, high, lr_no_gap, .. } = own.whole;
        let t = self.since + 0.5 * (first.start + last.end);
        Some(Reading { verdict, d, low, high, lr_no_gap, t })
    }
}

/// A record of one of the recordings; widths in OP's unit.
struct Member<'a> {
    curve: &'a mut Curve,
    size: f64,
    recording: usize,
    /// Weight of a unit of its likelihood.
    worth: f64,
}

impl Member<'_> {
    /// Cost of the width `d` in each family.
    fn costs(&mut self, d: f64) -> Vec<f64> {
        self.curve.costs(d / self.size)
    }

    /// Cost at a width, on a line between the computed widths.
    fn interpolated_cost(&self, d: f64) -> Vec<f64> {
        self.curve.interpolated_cost(d / self.size)
    }

    /// Lowers its weight where many changes of its load are marked. They lie where they suit the best width, `d`, and make the others look
    /// worse than they are: the ratio that is asked of so many counts as what is asked of none.
    fn trust_less(&mut self, d: f64) {
        let record = &self.curve.fitted.record;
        let asked = lr_asked_of_changes(record.traversals(d / self.size), record.changes());
        if asked > 0.0 {
            self.worth /= (asked / LR_MIN).max(RISE_BESIDE_CHANGES);
        }
    }

    /// Why it must not speak for a gap of this width; `agreed`: whether enough of all have this width by themselves.
    fn refused(&self, d: f64, lr_no_gap: f64, agreed: bool) -> Option<&'static str> {
        let fitted = &self.curve.fitted;
        let Evidence { coarse, lined_below, .. } = fitted.answer.evidence;
        let d = d / self.size;
        if d <= 0.0 {
            return None;
        }
        let lost = &fitted.profiles[0].near(d).lost;
        if coarse && !agreed {
            Some("coarse")
        } else if lr_no_gap < LR_IF_EVEN_SWING && !fitted.explained && swings_evenly(&fitted.record, d, fitted.lag) {
            Some("swings")
        } else if d < lined_below {
            Some("lined")
        } else if fitted.record.reach(lost) < MOVES * d {
            Some("still")
        } else {
            None
        }
    }
}

/// All members at one width.
fn costs_at(members: &mut [Member], d: f64) -> Vec<Vec<f64>> {
    members.par_iter_mut().map(|member| member.costs(d)).collect()
}

fn interpolated_costs(members: &[Member], d: f64) -> Vec<Vec<f64>> {
    members.iter().map(|member| member.interpolated_cost(d)).collect()
}

fn total_cost(members: &[Member], costs: &[Vec<f64>]) -> f64 {
    members.iter().zip(costs).map(|(member, costs)| member.worth * member.curve.least(costs)).sum()
}

/// Rise of the likelihood in each from costs to others.
fn rises(members: &[Member], from: &[Vec<f64>], to: &[Vec<f64>]) -> Vec<f64> {
    members.iter().zip(from).zip(to).map(|((member, from), to)| member.worth * member.curve.rise(from, to)).collect()
}

/// What all records together make of how far the likelihood rises in each.
///
/// The models of all days lack the same, so part of the error of their widths is common to them ([`SHARED_ERROR`], ρ). The variance
/// of the mean of n such widths is that of one times (1 + (n - 1)·ρ)/n (Kish's design effect), n = (Σ|r|)²/Σr² the number of records
/// that rise by as much. A record that says nothing does not count.
fn total_rise(each: &[f64]) -> f64 {
    let size: f64 = each.iter().map(|rise| rise.abs()).sum();
    let squares: f64 = each.iter().map(|rise| rise * rise).sum();
    let records = if squares > 0.0 { size * size / squares } else { 1.0 };
    each.iter().sum::<f64>() / (1.0 + SHARED_ERROR * (records - 1.0))
}

/// Every width that was looked at in one of them, in rising order [OP unit].
fn widths(members: &[Member]) -> Vec<f64> {
    let mut all: Vec<f64> =
        members.iter().flat_map(|member| member.curve.widths().map(move |d| d * member.size)).collect();
    all.sort_by(f64::total_cmp);
    all.dedup();
    all
}

/// The most likely width, and what each family costs there.
fn most_likely(members: &mut [Member]) -> (f64, Vec<Vec<f64>>) {
    let range = range(members);
    let least = |members: &[Member]| {
        let predicted = widths(members).into_iter().map(|d| (total_cost(members, &interpolated_costs(members, d)), d));
        predicted.min_by(|a, b| a.0.total_cmp(&b.0)).expect("0 at least").1
    };
    let exactly = |members: &mut [Member], d: f64| {
        let costs = costs_at(members, d);
        (total_cost(members, &costs), d, costs)
    };
    // Between the widths that were looked at the likelihood is a line: what it promises is looked at, until nothing promises more.
    let mut best = exactly(members, 0.0);
    for _ in 0..LOOKS {
        let d = least(members);
        if d == best.1 {
            break;
        }
        let there = exactly(members, d);
        if there.0 < best.0 {
            best = there;
        }
    }
    let near = |d: f64| d.max(0.02 * range);
    let mut step = 8.0 * NEAR * near(best.1);
    while step > 0.5 * NEAR * near(best.1) {
        let beside = [best.1 - step, best.1 + step].map(|d| exactly(members, d.clamp(0.0, range)));
        match beside.into_iter().find(|there| there.0 < best.0) {
            Some(there) => best = there,
            None => step /= 2.0,
        }
    }
    (best.1, best.2)
}

/// Number of members whose own width is that.
fn agreeing(members: &[Member], d: f64) -> usize {
    members.iter().filter(|m| (m.curve.fitted.answer.d * m.size - d).abs() <= AGREES_WITH * d).count()
}

/// Widest move of OP within one stretch [OP unit].
fn range(members: &[Member]) -> f64 {
    members.iter().map(|member| member.curve.fitted.record.range * member.size).fold(0.0, f64::max)
}

/// The word for recordings that disagree.
const DISAGREES: &str = "recordings_disagree";
/// Widths that are looked at because they promise more.
const LOOKS: usize = 8;
/// Relative accuracy of the most likely width.
const NEAR: f64 = 0.01;
/// Relative accuracy of the rise at a limit of the interval.
const NEAR_LIMIT: f64 = 0.03;

/// One answer from the recordings; the error is why the first of them cannot be fitted, where none can.
pub(crate) fn valve(mut recordings: Vec<Recording>) -> Result<ValveAnswer, Unfit> {
    let readings: Vec<(usize, Reading)> =
        recordings.iter().enumerate().filter_map(|(i, r)| Some((i, r.reading()?))).collect();
    if readings.is_empty() {
        return Err(recordings.into_iter().find_map(|r| r.own.err()).unwrap_or(Unfit::Few));
    }
    let mut left_out: Vec<Option<&'static str>> = recordings.iter().map(Recording::useless).collect();
    let mut adds = vec![0.0; recordings.len()];
    let (mut members, d, here) = who_counts(&mut recordings, &mut left_out);
    let counted = left_out.iter().filter(|why| why.is_none()).count();
    let shared = (counted >= FEWEST_RECORDINGS).then(|| shared_width(&mut members, d, &here, &mut adds));
    let each: Vec<Reading> = readings.iter().map(|(_, reading)| *reading).collect();
    let trend = if each.iter().all(|r| r.t.is_finite()) { Trend::of_readings(&each) } else { None };
    // A width that plainly changes: the newest is today's.
    let silent = |whole: &Together| whole.verdict == Verdict::CannotTell && whole.reason != DISAGREES;
    let alone = match (newest(trend, &each), &shared) {
        (Some(newest), _) => Some((readings[newest].0, false)),
        (None, None) => Some(best_alone(&recordings, &readings, &left_out)),
        // More recordings take nothing from one that tells by itself.
        (None, Some(whole)) if silent(whole) => Some(best_alone(&recordings, &readings, &left_out))
            .filter(|(i, excluded)| !excluded && own_claim(&recordings[*i])),
        _ => None,
    };
    let own = |i: usize| recordings[i].own.as_ref().ok().map(|own| &own.whole);
    let mut whole = alone.and_then(|(i, _)| own(i)).cloned().or(shared).ok_or(Unfit::Few)?;
    if alone.is_some_and(|(_, excluded)| excluded) {
        whole.judgement = Judgement::without(Confidence::CannotTell, whole.judgement.oscillates);
        (whole.verdict, whole.reason) = (Verdict::CannotTell, DISAGREES);
    }
    whole.trend = trend;
    let rank = |i: &usize| own(*i).map(|o| (o.verdict == whole.verdict, left_out[*i].is_none(), adds[*i], o.lr_no_gap));
    let order = |a: &usize, b: &usize| rank(a).partial_cmp(&rank(b)).unwrap_or(Ordering::Equal);
    let shown = alone.map(|(i, _)| i).or((0..recordings.len()).max_by(order)).unwrap_or(0);
    let answered = |((recording, left_out), lr_no_gap): ((Recording, _), _)| {
        let Recording { own, repeated, .. } = recording;
        RecordingAnswer { own, repeated, left_out, lr_no_gap }
    };
    let recordings = recordings.into_iter().zip(left_out).zip(adds).map(answered).collect();
    Ok(ValveAnswer { whole, recordings, shown, shared: alone.is_none() })
}

/// Records that count for a gap, the most likely width of all, and its cost in each. The choice of records depends on the width,
/// and the width on the choice: both are repeated until they agree. `left_out` gets the reason of recordings without one.
fn who_counts<'a>(
    recordings: &'a mut [Recording],
    left_out: &mut [Option<&'static str>],
) -> (Vec<Member<'a>>, f64, Vec<Vec<f64>>) {
    let mut members: Vec<Member> = Vec::new();
    for (i, recording) in recordings.iter_mut().enumerate() {
        let usable = recording.curves.iter_mut().filter(|c| c.fitted.answer.usable());
        let size = recording.size;
        members.extend(usable.map(|curve| Member { worth: curve.worth, curve, size, recording: i }));
    }
    while !members.is_empty() {
        let (d, here) = most_likely(&mut members);
        let mut against = rises(&members, &here, &interpolated_costs(&members, 0.0)).into_iter();
        let mut refused = Vec::new();
        let agreed = agreeing(&members, d);
        let agreed = agreed >= FEWEST_RECORDINGS && agreed as f64 >= AGREE * members.len() as f64;
        members.retain(|member| {
            let why = against.next().and_then(|lr| member.refused(d, lr, agreed));
            refused.extend(why.map(|why| (member.recording, why)));
            why.is_none()
        });
        if refused.is_empty() {
            return (members, d, here);
        }
        for (i, why) in refused {
            if !members.iter().any(|member| member.recording == i) {
                left_out[i] = Some(why);
            }
        }
    }
    (members, 0.0, Vec::new())
}

/// The width that the members share, `d` with the costs `here`; `gives` is told what each recording adds to the likelihood ratio of
/// no gap.
fn shared_width(members: &mut [Member], d: f64, here: &[Vec<f64>], gives: &mut [f64]) -> Together {
    let n = members.len() as f64;
    members.iter_mut().for_each(|member| member.trust_less(d));
    let least = above(members, here);
    // A record that is not believed to exclude that there is none is not believed to exclude this width either.
    let off = members.iter().zip(&least).map(|(member, off)| {
        if member.curve.fitted.answer.verdict == Verdict::CannotTell { off.min(LR_MIN) } else { *off }
    });
    let dispersion = (off.sum::<f64>() / (n - 1.0) / AGREES).max(1.0);
    let limit = RISE * dispersion;
    let (low, high) = interval(members, d, &least, limit);
    let resolution = members.iter().map(|m| m.curve.fitted.record.resolution() * m.size).sum::<f64>() / n;
    let against = against(members, d, here, dispersion);
    for (member, lr) in members.iter().zip(&against) {
        gives[member.recording] += lr;
    }
    let lr_no_gap: f64 = gives.iter().sum();
    // No gap is heard in the family that believes least: where that does not exclude it, neither does the interval.
    let low = if lr_no_gap > limit { (low - resolution).max(0.0) } else { 0.0 };
    let high = high.map(|high| high + MISSED_TURNS * resolution);
    let most = gives.iter().copied().fold(0.0, f64::max);
    let times = |d: f64| {
        let each = members.iter().map(|m| m.curve.fitted.record.traversals(d / m.size));
        each.fold([0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
    };
    let traversals = times(d);
    let lr_no_jump: f64 = members.iter().map(|m| m.worth * m.curve.jumps()).sum();
    let jumping = members.iter().filter(|m| m.curve.jumps() > 0.0).count();
    let records: Vec<_> = members.iter().map(|m| (&m.curve.fitted.answer.evidence, m.size)).collect();
    Together::judged(Evidence {
        d,
        lr_no_gap,
        lr_needed: (dispersion * LR_JOINT.max(lr_asked_of_passes(traversals))).max(most + dispersion * LR_MIN),
        low,
        high,
        range: range(members),
        one_way: traversals.contains(&0),
        slips: lr_no_jump > LR_JUMP && 2 * jumping > members.len(),
        // Such records do not count here.
        immobile: false,
        even_swing: false,
        passes: traversals,
        passes_high: high.map_or([0; 2], times),
        agree: [agreeing(members, d), members.len()],
        dispersion,
        shows: None,
        ..pooled(&records)
    })
}

/// How far each member lies above its own best, as for its own limits.
fn above(members: &[Member], costs: &[Vec<f64>]) -> Vec<f64> {
    members.iter().zip(costs).map(|(member, costs)| member.curve.off_within_limits(costs)).collect()
}

/// The widths at which the likelihood of all has risen by `limit` from the width `d`, where each member lies `least` above its own best;
/// None where the highest width that was looked at has not risen as far.
fn interval(members: &mut [Member], d: f64, least: &[f64], limit: f64) -> (f64, Option<f64>) {
    let rise = |members: &[Member], costs: &[Vec<f64>]| {
        let each: Vec<f64> = above(members, costs).iter().zip(least).map(|(there, here)| there - here).collect();
        total_rise(&each)
    };
    let predicted = |members: &[Member], d: f64| rise(members, &interpolated_costs(members, d));
    let widths: Vec<f64> = widths(members);
    let inside: Vec<bool> = widths.iter().map(|w| *w == d || predicted(members, *w) <= limit).collect();
    let (first, last) = ends(&inside);
    let mut border = |mut within: f64, mut beyond: f64| {
        for _ in 0..LOOKS {
            let (mut low, mut high) = (within, beyond);
            for _ in 0..20 {
                let middle = 0.5 * (low + high);
                *(if predicted(members, middle) <= limit { &mut low } else { &mut high }) = middle;
            }
            let middle = 0.5 * (low + high);
            let costs = costs_at(members, middle);
            let rise = rise(members, &costs);
            *(if rise <= limit { &mut within } else { &mut beyond }) = middle;
            if (rise - limit).abs() < NEAR_LIMIT * limit || (beyond - within).abs() < 0.5 * NEAR * d {
                break;
            }
        }
        0.5 * (within + beyond)
    };
    let low = if first == 0 { 0.0 } else { border(widths[first], widths[first - 1]) };
    let high = (last + 1 < widths.len()).then(|| border(widths[last], widths[last + 1]));
    (low, high)
}

/// Likelihood ratio of no gap that each member leaves, with the loads that were looked for. Where all of it would show
/// a gap, a load that repeats itself is looked for as well.
fn against(members: &mut [Member], d: f64, here: &[Vec<f64>], dispersion: f64) -> Vec<f64> {
    let none = interpolated_costs(members, 0.0);
    let mut against = rises(members, here, &none);
    for (member, lr) in members.iter().zip(&mut against) {
        let fitted = &member.curve.fitted;
        let jumps = (fitted.answer.lr_no_jump - LR_JUMP).max(0.0);
        // A load without a gap takes from what a gap brings; what a gap would bring beside that load is not known.
        *lr = (*lr + member.worth * jumps).min(member.worth * fitted.lr_of_loads.max(0.0));
    }
    if against.iter().sum::<f64>() > dispersion * LR_JOINT {
        against.par_iter_mut().zip(members).for_each(|(lr, member)| {
            let fitted = &member.curve.fitted;
            if fitted.cycle_known || *lr <= 0.0 {
                return;
            }
            let family = &fitted.profiles[0];
            let near = family.near(d / member.size);
            let points = [(family.structure, near), (family.structure, &family.points[0])];
            let lost = BacklashModel { d: d / member.size, ..near.lost.clone() };
            let beside = lr_beside_cycle(&fitted.record, member.curve.sign, &points, &lost, fitted.without);
            *lr = lr.min(beside.map_or(f64::INFINITY, |beside| member.worth * beside.max(0.0)));
        });
    }
    against
}

/// Whether a recording shows a gap alone.
fn own_claim(recording: &Recording) -> bool {
    let found = |own: &JointAnswer| !matches!(own.whole.verdict, Verdict::Sound | Verdict::CannotTell);
    recording.own.as_ref().is_ok_and(found)
}

/// The most informative recording, where all together show no width, and whether another excludes its result.
fn best_alone(
    recordings: &[Recording],
    readings: &[(usize, Reading)],
    left_out: &[Option<&'static str>],
) -> (usize, bool) {
    let rank = |reading: &Reading| match reading.verdict {
        Verdict::Backlash | Verdict::Stiction | Verdict::Both => (3, reading.lr_no_gap),
        Verdict::AtLeast => (2, reading.lr_no_gap),
        Verdict::Sound => (1, -reading.high.unwrap_or(f64::INFINITY)),
        Verdict::CannotTell => (0, reading.lr_no_gap),
    };
    let order = |a: &&(usize, Reading), b: &&(usize, Reading)| {
        let counts = |of: &(usize, Reading)| left_out[of.0].is_none();
        let ((kind, lr), (other, less)) = (rank(&a.1), rank(&b.1));
        kind.cmp(&other).then(counts(a).cmp(&counts(b))).then(lr.total_cmp(&less))
    };
    let &(best, reading) = readings.iter().max_by(order).expect("one was fitted");
    let (low, high) = match reading.verdict {
        Verdict::CannotTell => return (best, false),
        Verdict::Sound => (0.0, reading.high),
        Verdict::AtLeast => (reading.low, None),
        _ => (reading.low, reading.high),
    };
    let high = high.unwrap_or(f64::INFINITY);
    let off = |recording: &Recording| {
        let each = recording.usable().map(|c| c.worth * c.least_off(low / recording.size, high / recording.size));
        each.fold(f64::INFINITY, f64::min)
    };
    let others = recordings.iter().enumerate().filter(|(i, _)| *i != best && left_out[*i].is_none());
    (best, others.into_iter().any(|(_, recording)| off(recording) > RISE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_records_tell_more_but_share_an_error() {
        // One record counts whole, and so it does beside seven that say nothing.
        assert_eq!(total_rise(&[3.0]), 3.0);
        assert!((total_rise(&[3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]) - 3.0).abs() < 1e-12);
        // Eight alike tell less than eight times as much, and no number more than one over the shared part.
        assert!((total_rise(&[1.0; 8]) - 8.0 / (1.0 + 7.0 * SHARED_ERROR)).abs() < 1e-12);
        assert!(total_rise(&[1.0; 10_000]) < 1.0 / SHARED_ERROR);
        // What one takes another gives back.
        assert_eq!(total_rise(&[2.0, -2.0]), 0.0);
        assert_eq!(total_rise(&[0.0; 3]), 0.0);
    }
}
