//! The one question: how wide is the lost motion that all of these records share?

use crate::data::cells::Cells;
use crate::data::repeated::{Once, Recorded, once};
use crate::data::samples::{SHORTEST, Samples, Unfit};
use crate::data::segment::{OpAndPv, Segment, Stretch};
use crate::data::signal::{Unit, bow, shifts, without_spikes};
use crate::decide::joint::{Curve, JointAnswer, joint};
use crate::decide::segment::{Fitted, fit_segment};
use crate::decide::valve::{Recording, ValveAnswer, valve};
use crate::decide::verdict::judge;
use crate::progress::{Tell, Windows};
use crate::search::decimation::{FEWEST, MOST_CELLS, cell, look};
use crate::search::screen::rescaled;
use glapp_model::structure::Theta;
use rayon::prelude::*;
use serde::{Deserialize, Deserializer, Serialize};

/// Records of one valve, whether windows of one history or recordings of different days: they share the lost motion, and
/// everything else (process, noise, load, step, cells) is each one's own.
#[derive(Clone, Debug)]
pub struct FitProblem<'a> {
    /// The records, in the order of time.
    pub records: Vec<Segment<'a>>,
    /// Sign of the process gain where it is known, else 0.
    pub sign: f64,
    /// Draws at most, to find how large the likelihood ratio of a record without a gap gets by chance; 0 for none.
    pub bootstrap: usize,
}

impl FitProblem<'_> {
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
pub(crate) fn records(samples: &[Samples]) -> Result<Vec<Segment<'static>>, Unfit> {
    let all: Vec<Result<Segment, Unfit>> = samples.iter().map(Samples::record).collect();
    let why = all.iter().find_map(|record| record.as_ref().err().copied()).unwrap_or(Unfit::Few);
    let fit: Vec<Segment> = all.into_iter().flatten().collect();
    if fit.is_empty() { Err(why) } else { Ok(fit) }
}

/// Draws at most.
const BOOTSTRAP: usize = 400;

/// Answers the problem: each record by itself, and all together. A single long record is cut into windows first. `tell` takes the
/// share that is done.
///
/// # Errors
///
/// Where no record has 50 samples together in which OP moves.
pub fn fit(problem: &FitProblem, tell: Tell) -> Result<JointAnswer, Unfit> {
    let divided = Divided::of(problem)?;
    let progress = Windows::new(divided.windows.len(), tell);
    let alone = divided.windows.par_iter().map(|window| WindowFit(window.fitted(&progress.one()))).collect();
    let joint = divided.combine(alone);
    tell(1.0);
    joint
}

/// A problem cut into windows. Each can be fitted by itself, elsewhere as well; what they say is then joined.
///
/// ```
/// use glapp_fit::{Divided, FitProblem, Segment, Stretch};
/// let op: Vec<f64> = (0..60).map(|k| f64::from(k % 20)).collect();
/// let stretch = Stretch { start: 0.0, sp: vec![].into(), pv: op.clone().into(), op: op.into() };
/// let records = vec![Segment { h: 1.0, stretches: vec![stretch] }];
/// let divided = Divided::of(&FitProblem { records, sign: 0.0, bootstrap: 0 })?;
/// assert_eq!(divided.windows.len(), 1);
/// // Of each `window.fit()`, and of all that these say `divided.combine(alone)`: what `fit` gives.
/// # Ok::<(), glapp_fit::Unfit>(())
/// ```
#[derive(Clone, Debug)]
pub struct Divided {
    /// The windows, in the order of time.
    pub windows: Vec<Window>,
    op: Unit,
    pv: Unit,
}

/// A window with all that its fit asks for.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Window {
    pub(crate) record: Segment<'static>,
    /// Steps that a cell has at most.
    cell: usize,
    pub(crate) sign: f64,
    pub(crate) bootstrap: usize,
}

/// Fit of one window, to be joined with the others; empty where the window cannot be fitted, or is not yet.
#[derive(Clone, Debug, Default, Serialize)]
pub struct WindowFit(Option<Fitted>);

impl<'de> Deserialize<'de> for WindowFit {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let mut fitted: Option<Fitted> = Deserialize::deserialize(from)?;
        if let Some(Fitted { answer, .. }) = &mut fitted {
            answer.reason = judge(&answer.evidence).1;
        }
        Ok(Self(fitted))
    }
}

impl Divided {
    /// The windows of a problem: its records, or those into which its only one is cut.
    ///
    /// # Errors
    ///
    /// Where no record has 50 samples together in which OP moves.
    pub fn of(problem: &FitProblem) -> Result<Self, Unfit> {
        let stretches = || problem.records.iter().flat_map(|record| &record.stretches);
        let (op, pv) = (Unit::of(stretches().map(|s| &*s.op)), Unit::of(stretches().map(|s| &*s.pv)));
        let scaled = |s: &Stretch| Stretch {
            start: s.start,
            sp: pv.scaled(&s.sp).into(),
            pv: without_spikes(pv.scaled(&s.pv)).into(),
            op: op.scaled(&s.op).into(),
        };
        let scaled: Vec<Segment> = problem
            .records
            .iter()
            .map(|record| Segment {
                h: record.h,
                stretches: record.stretches.iter().flat_map(|s| between_shifts(scaled(s), record.h)).collect(),
            })
            .collect();
        let signals: Vec<OpAndPv> = scaled.iter().flat_map(Segment::signals).collect();
        let cell = cell(&signals, problem.sign).ok_or(Unfit::Few)?;
        let records = if let [one] = scaled.as_slice() { one.windows(cell * MOST_CELLS) } else { scaled };
        let window =
            |record: Segment| Window { record: record.owned(), cell, sign: problem.sign, bootstrap: problem.bootstrap };
        Ok(Self { windows: records.into_iter().map(window).collect(), op, pv })
    }

    /// Joint result of the windows, and the result of each alone, in the same order.
    ///
    /// # Errors
    ///
    /// Where none of them can be fitted.
    pub fn combine(&self, alone: Vec<WindowFit>) -> Result<JointAnswer, Unfit> {
        joint(&mut self.curves(alone), self.op, self.pv).ok_or(Unfit::Few)
    }

    /// Cost curves of the windows that could be fitted.
    fn curves(&self, alone: Vec<WindowFit>) -> Vec<Curve> {
        let of = |(window, alone): (&Window, WindowFit)| Some(Curve::new(&window.record, alone.0?, window.sign));
        self.windows.iter().zip(alone).filter_map(of).collect()
    }
}

impl Window {
    /// Fit of this window alone.
    pub fn fit(&self) -> WindowFit {
        WindowFit(self.fitted(&|_| ()))
    }

    /// `done` takes the share that is done.
    fn fitted(&self, done: &dyn Fn(f64)) -> Option<Fitted> {
        let Self { record, cell, sign, .. } = self;
        let signals = record.signals();
        let (seeds, looked) = look(&signals, *sign)?;
        let finest = ((record.steps() + MOST_CELLS / 2) / MOST_CELLS).clamp(1, *cell);
        let times = looked as f64 / finest as f64;
        let cells = Cells::new(&signals, finest);
        let seeds: Vec<Theta> = seeds.iter().map(|theta| rescaled(theta, times)).collect();
        let bow = signals.iter().map(|(pv, _)| bow(pv)).fold(0.0, f64::max);
        let fitted = (cells.count >= FEWEST)
            .then(|| fit_segment(&cells, &seeds, bow, (&self.record, self.sign, self.bootstrap), done));
        done(1.0);
        fitted
    }
}

/// A stretch, ended where PV is shifted: PV before the shift is no information on PV after it.
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

/// One answer of several recordings of one valve, in the order of time: they share the lost motion. What a recording repeats of one
/// before it counts once. `tell` takes the share that is done.
///
/// # Errors
///
/// Why the first recording cannot be fitted, where none can.
pub fn fit_valve(recordings: &[Recorded], sign: f64, tell: Tell) -> Result<ValveAnswer, Unfit> {
    let progress = Windows::new(recordings.len(), tell);
    let alone = |(recorded, once): (&Recorded, Once)| {
        let samples: Vec<Samples> =
            recorded.samples.iter().zip(&once.pv).map(|(samples, pv)| Samples { pv, ..*samples }).collect();
        let divided = match FitProblem::of(&samples, sign).and_then(|problem| Divided::of(&problem)) {
            Ok(divided) => divided,
            Err(why) => {
                progress.one()(1.0);
                return Recording::unfit(once.repeated, why);
            }
        };
        let windows = divided.windows.len() as f64;
        let fitted = |window: &Window| {
            let fitted = window.fitted(&|_| ());
            progress.add(1.0 / windows);
            WindowFit(fitted)
        };
        let mut curves = divided.curves(divided.windows.par_iter().map(fitted).collect());
        match joint(&mut curves, divided.op, divided.pv) {
            Some(own) => Recording::new(recorded.since, once.repeated, own, curves, divided.op),
            None => Recording::unfit(once.repeated, Unfit::Few),
        }
    };
    let once = once(recordings);
    let recordings: Vec<Recording> = recordings.par_iter().zip(once).map(alone).collect();
    let answer = valve(recordings);
    tell(1.0);
    answer
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_and_what_it_says_are_handed_over_to_the_last_bit() {
        let (mut valve, mut x, mut signals) = (0.0, 0.0, (Vec::new(), Vec::new()));
        for k in 0..52 {
            let u = (0.4 * f64::from(k)).sin() + 0.2 * (1.7 * f64::from(k)).sin();
            valve = f64::clamp(valve, u - 0.3, u + 0.3);
            x += 0.3 * (valve - x);
            signals.0.push(if k == 30 { f64::NAN } else { x + 0.01 * (11.0 * f64::from(k)).sin() });
            signals.1.push(u);
        }
        let stretch = Stretch { start: 7.0, sp: vec![].into(), pv: signals.0.into(), op: signals.1.into() };
        let records = vec![Segment { h: 1.0, stretches: vec![stretch] }];
        let divided = Divided::of(&FitProblem { records, sign: 0.0, bootstrap: 0 }).unwrap();
        let window = &divided.windows[0];
        let handed: Window = postcard::from_bytes(&postcard::to_allocvec(window).unwrap()).unwrap();
        // Rust writes as many digits of a number as it takes to tell it from all others.
        assert_eq!(format!("{handed:?}"), format!("{window:?}"));
        let alone = handed.fit();
        assert!(alone.0.as_ref().is_some_and(|fitted| !fitted.answer.reason.is_empty()));
        let handed: WindowFit = postcard::from_bytes(&postcard::to_allocvec(&alone).unwrap()).unwrap();
        assert_eq!(format!("{handed:?}"), format!("{alone:?}"));
        // One of two windows gives its result while the other is not fitted yet, and none while neither is.
        let two = Divided { windows: vec![window.clone(), window.clone()], ..divided };
        assert_eq!(two.combine(vec![handed, WindowFit::default()]).unwrap().records.len(), 1);
        assert!(two.combine(vec![WindowFit::default(), WindowFit::default()]).is_err());
    }
}
