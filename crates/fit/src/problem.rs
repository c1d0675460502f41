//! The one question: how wide is the lost motion that all of these records share?

use crate::data::cells::Cells;
use crate::data::record::{Record, Signals, Stretch};
use crate::data::repeated::{Once, once};
use crate::data::samples::{SHORTEST, Samples, Unfit};
use crate::data::signal::{Unit, bow, shifts, without_spikes};
use crate::decide::joint::{Curve, JointAnswer, joint};
use crate::decide::record::{Fitted, fit_record};
use crate::decide::valve::{Recording, ValveAnswer, valve};
use crate::model::structure::Theta;
use crate::search::decimation::{FEWEST, MOST_CELLS, cell, look};
use crate::search::screen::rescaled;
use rayon::prelude::*;

/// Records of one valve, whether windows of one history or recordings of different days: they share the lost motion, and
/// everything else (process, noise, load, step, cells) is each one's own.
#[derive(Clone, Debug)]
pub struct Problem<'a> {
    /// The records, in the order of time.
    pub records: Vec<Record<'a>>,
    /// Sign of the process gain where it is known, else 0.
    pub sign: f64,
    /// Records simulated without a gap at most, to find how large the likelihood ratio gets by chance; 0 for none.
    pub bootstrap: usize,
}

impl Problem<'_> {
    /// The problem of all samples that can be fitted, `bootstrap` as is usual.
    ///
    /// # Errors
    ///
    /// Why the first cannot, where none can.
    pub fn of(samples: &[Samples], sign: f64) -> Result<Self, Unfit> {
        Ok(Self { records: records(samples)?, sign, bootstrap: BOOTSTRAP })
    }
}

/// The records of all samples that can be fitted, else why the first cannot.
pub(crate) fn records(samples: &[Samples]) -> Result<Vec<Record<'static>>, Unfit> {
    let all: Vec<Result<Record, Unfit>> = samples.iter().map(Samples::record).collect();
    let why = all.iter().find_map(|record| record.as_ref().err().copied()).unwrap_or(Unfit::Few);
    let fit: Vec<Record> = all.into_iter().flatten().collect();
    if fit.is_empty() { Err(why) } else { Ok(fit) }
}

/// Records that are simulated at most.
const BOOTSTRAP: usize = 400;

/// Answers the problem: each record by itself, and all together. A single long record is cut into windows first.
///
/// # Errors
///
/// Where no record has 50 samples together in which OP moves.
pub fn fit(problem: &Problem) -> Result<JointAnswer, Unfit> {
    let (mut curves, op, pv) = fitted(problem)?;
    joint(&mut curves, op, pv).ok_or(Unfit::Few)
}

/// Each record by itself, and the units in which its OP and PV are 0 to 1.
fn fitted(problem: &Problem) -> Result<(Vec<Curve>, Unit, Unit), Unfit> {
    let stretches = || problem.records.iter().flat_map(|record| &record.stretches);
    let (op, pv) = (Unit::of(stretches().map(|s| &*s.op)), Unit::of(stretches().map(|s| &*s.pv)));
    let scaled = |s: &Stretch| Stretch {
        start: s.start,
        sp: pv.scaled(&s.sp).into(),
        pv: without_spikes(pv.scaled(&s.pv)).into(),
        op: op.scaled(&s.op).into(),
    };
    let scaled: Vec<Record> = problem
        .records
        .iter()
        .map(|record| Record {
            h: record.h,
            stretches: record.stretches.iter().flat_map(|s| between_shifts(scaled(s), record.h)).collect(),
        })
        .collect();
    let signals: Vec<Signals> = scaled.iter().flat_map(Record::signals).collect();
    let cell = cell(&signals, problem.sign).ok_or(Unfit::Few)?;
    let records = if let [one] = scaled.as_slice() { one.windows(cell * MOST_CELLS) } else { scaled };
    let of = |record: &Record| Some(Curve::new(record, alone(record, cell, problem)?, problem.sign));
    Ok((records.par_iter().filter_map(of).collect(), op, pv))
}

/// A stretch, ended where PV is shifted: what PV was before tells nothing of what it is then.
fn between_shifts<'a>(stretch: Stretch<'a>, h: f64) -> Vec<Stretch<'a>> {
    let shifts = shifts(&stretch.pv, &stretch.op);
    if shifts.is_empty() {
        return vec![stretch];
    }
    let ends: Vec<usize> = [0].into_iter().chain(shifts).chain([stretch.pv.len()]).collect();
    let piece = |ends: &[usize]| {
        let of = |x: &[f64]| x.get(ends[0]..ends[1]).unwrap_or_default().to_vec().into();
        let start = stretch.start + h * ends[0] as f64;
        Stretch { start, sp: of(&stretch.sp), pv: of(&stretch.pv), op: of(&stretch.op) }
    };
    ends.windows(2).filter(|ends| ends[1] - ends[0] >= SHORTEST).map(piece).collect()
}

/// One recording of a valve: its rows, or those of its windows.
#[derive(Clone, Debug)]
pub struct Recorded<'a> {
    /// When its time is 0, on a clock that all recordings share [s]; NaN where that is not known.
    pub since: f64,
    /// Its rows, in one piece, or the windows that were kept of a long history.
    pub samples: Vec<Samples<'a>>,
}

/// One answer of several recordings of one valve, in the order of time: they share the lost motion. What a recording repeats of one
/// before it counts once.
///
/// # Errors
///
/// Why the first recording cannot be fitted, where none can.
pub fn fit_valve(recordings: &[Recorded], sign: f64) -> Result<ValveAnswer, Unfit> {
    let alone = |(recorded, once): (&Recorded, Once)| {
        let samples: Vec<Samples> =
            recorded.samples.iter().zip(&once.pv).map(|(samples, pv)| Samples { pv, ..*samples }).collect();
        let (mut curves, op, pv) = match Problem::of(&samples, sign).and_then(|problem| fitted(&problem)) {
            Ok(fitted) => fitted,
            Err(why) => return Recording::unfit(once.repeated, why),
        };
        match joint(&mut curves, op, pv) {
            Some(own) => Recording::new(recorded.since, once.repeated, own, curves, op),
            None => Recording::unfit(once.repeated, Unfit::Few),
        }
    };
    let once = once(recordings);
    let recordings: Vec<Recording> = recordings.par_iter().zip(once).map(alone).collect();
    valve(recordings)
}

/// One record by itself, in cells of at most so many steps.
fn alone(record: &Record, cell: usize, problem: &Problem) -> Option<Fitted> {
    let signals = record.signals();
    let (seeds, looked) = look(&signals, problem.sign)?;
    let finest = ((record.steps() + MOST_CELLS / 2) / MOST_CELLS).clamp(1, cell);
    let times = looked as f64 / finest as f64;
    let cells = Cells::new(&signals, finest);
    let seeds: Vec<Theta> = seeds.iter().map(|theta| rescaled(theta, times)).collect();
    let bow = signals.iter().map(|(pv, _)| bow(pv)).fold(0.0, f64::max);
    (cells.count >= FEWEST).then(|| fit_record(&cells, &seeds, record, bow, problem))
}
