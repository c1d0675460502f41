//! A recording of any length, cut into windows whose cells are fine enough for the process, and fitted.

use crate::data::cells::Cells;
use crate::decide::joint::{JointAnswer, joint};
use crate::decide::verdict::{Answer, Fitted, Question, fit_record};
use crate::model::structure::Theta;
use crate::search::screen::{Pilot, pilot, rescaled};
use rayon::prelude::*;

/// One unbroken stretch of a recording at even steps; NaN in PV is a sample that is missing, OP is without NaN.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a> {
    /// When it starts [s].
    pub start: f64,
    /// [PV unit]
    pub pv: &'a [f64],
    /// [OP unit]
    pub op: &'a [f64],
}

/// A recording, or a window of a long one, at steps of `h` [s].
#[derive(Clone, Debug)]
pub struct Batch<'a> {
    /// Time between two steps [s].
    pub h: f64,
    /// Its stretches in the order of time.
    pub parts: Vec<Part<'a>>,
}

/// A window's answer, from when to when [s].
#[derive(Clone, Debug)]
pub struct Window {
    /// When its first step is [s].
    pub start: f64,
    /// When its last step is [s].
    pub end: f64,
    /// Starts of its parts [s].
    pub starts: Vec<f64>,
    /// Time between two steps [s].
    pub h: f64,
    /// What it says.
    pub answer: Answer,
}

/// Least cells for an answer.
const FEWEST: usize = 50;
/// Cells that one fit takes, and by how many times as many a recording is still fitted as one.
const MOST_CELLS: usize = 3000;
const UNCUT: f64 = 1.5;
/// Windows of one recording that are fitted.
const MOST_WINDOWS: usize = 6;
/// Cells of the first look.
const LOOK_CELLS: usize = 600;
/// Cells in the lags of a process.
const FINE: f64 = 12.0;
/// Lags of a process that are seen [cells].
const SEEN: f64 = 4.0;
/// Lags of a process that a first look can hold [cells], and the likelihood ratio that PV answers OP there.
const HOLDS: f64 = 40.0;
const ANSWERS: f64 = 30.0;
/// Pieces of the recording that are looked at for how slow the process is.
const PIECES: usize = 3;

/// Where the numbers of a signal lie: value = zero + size·(what the fit sees).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unit {
    pub(crate) zero: f64,
    pub(crate) size: f64,
}

/// Steps of a signal's whole range: rounding that hangs on the unit of a file is far below, noise far above.
const GRID: f64 = (1u64 << 20) as f64;

impl Unit {
    fn of<'a>(signals: impl Iterator<Item = &'a [f64]>) -> Self {
        let (low, high) = signals
            .flatten()
            .filter(|x| !x.is_nan())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)));
        Self { zero: low, size: if high > low { high - low } else { 1.0 } }
    }

    /// The same signal from 0 to 1: what is found does not hang on units.
    fn seen(self, signal: &[f64]) -> Vec<f64> {
        signal.iter().map(|x| ((x - self.zero) / self.size * GRID).round() / GRID).collect()
    }
}

/// Steps of PV, in its usual step (median), by which a sample must stand out from the two before and the two after it.
const SPIKE: f64 = 12.0;

/// The signal without samples that stand alone: no process goes and comes back in one step, and OP answers them as if they
/// were real.
fn without_spikes(mut pv: Vec<f64>) -> Vec<f64> {
    let mut steps: Vec<f64> = pv.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|step| *step > 0.0).collect();
    if steps.is_empty() {
        return pv;
    }
    let middle = steps.len() / 2;
    let usual = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    let alone = |w: &[f64]| {
        let beside = [w[0], w[1], w[3], w[4]];
        let (low, high) = beside.iter().fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(*x), high.max(*x)));
        let out = (w[2] - high).max(low - w[2]);
        // Beside a jump of PV the last sample before it stands out by nothing.
        w.iter().all(|x| !x.is_nan()) && out > SPIKE * usual && out > high - low
    };
    let spikes: Vec<usize> = pv.windows(5).enumerate().filter(|(_, w)| alone(w)).map(|(k, _)| k + 2).collect();
    spikes.into_iter().for_each(|k| pv[k] = f64::NAN);
    pv
}

/// Share of the corners between lines among the samples of a PV above which it was measured, and not drawn.
const CORNERS: f64 = 0.4;

/// How far PV bends between the points that a historian kept and drew lines between, in the mean (median); 0 where it kept
/// every sample.
fn bow(pv: &[f64]) -> f64 {
    let bend = |w: &[f64]| w[2] - 2.0 * w[1] + w[0];
    // Where PV stands still nothing is drawn.
    let moving = |w: &&[f64]| (w[2] - w[1]).abs() + (w[1] - w[0]).abs() > 8.0 / GRID;
    let corner = |w: &[f64]| bend(w).abs() > 8.0 / GRID;
    let all = pv.windows(3).filter(moving).count();
    let corners: Vec<(usize, f64)> =
        pv.windows(3).enumerate().filter(|(_, w)| corner(w)).map(|(k, w)| (k, bend(w).abs())).collect();
    if corners.len() < 3 || corners.len() as f64 > CORNERS * all as f64 {
        return 0.0;
    }
    let beside = |w: &[(usize, f64)]| {
        let (left, right) = ((w[1].0 - w[0].0) as f64, (w[2].0 - w[1].0) as f64);
        w[1].1 * left * right / (left + right)
    };
    let mut bows: Vec<f64> = corners.windows(3).map(beside).collect();
    let middle = bows.len() / 2;
    *bows.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Fits a recording, or windows of a longer one: each window alone and all together. None where no window has 50 samples
/// in which OP moves.
pub fn fit(batches: &[Batch], question: &Question) -> Option<JointAnswer> {
    let parts = || batches.iter().flat_map(|batch| &batch.parts);
    let (op, pv) = (Unit::of(parts().map(|p| p.op)), Unit::of(parts().map(|p| p.pv)));
    let seen: Vec<Vec<(Vec<f64>, Vec<f64>)>> = batches
        .iter()
        .map(|batch| batch.parts.iter().map(|part| (without_spikes(pv.seen(part.pv)), op.seen(part.op))).collect())
        .collect();
    let scaled: Vec<Batch> = batches
        .iter()
        .zip(&seen)
        .map(|(batch, seen)| {
            let parts = batch.parts.iter().zip(seen);
            Batch { h: batch.h, parts: parts.map(|(p, (pv, op))| Part { start: p.start, pv, op }).collect() }
        })
        .collect();
    let all: Vec<Signals> = scaled.iter().flat_map(Batch::signals).collect();
    let cell = cell(&all, question.sign)?;
    let windows = if let [one] = scaled.as_slice() { cut(one, cell * MOST_CELLS) } else { scaled };
    let told: Vec<(Batch, Fitted)> = windows
        .into_par_iter()
        .filter_map(|window| {
            let told = window.told(cell, question)?;
            Some((window, told))
        })
        .collect();
    joint(told, question, op, pv)
}

/// Steps that one window should hold, for its cells to be fine enough for the process; None where `fit` gives none.
pub fn window(batch: &Batch, sign: f64) -> Option<usize> {
    cell(&batch.signals(), sign).map(|cell| cell * MOST_CELLS)
}

/// PV and OP of a stretch.
type Signals<'a> = (&'a [f64], &'a [f64]);

impl<'a> Batch<'a> {
    fn signals(&self) -> Vec<Signals<'a>> {
        self.parts.iter().map(|part| (part.pv, part.op)).collect()
    }

    fn steps(&self) -> usize {
        self.parts.iter().map(|part| part.pv.len()).sum()
    }

    pub(crate) fn window(&self, answer: Answer) -> Window {
        let (first, last) = (&self.parts[0], &self.parts[self.parts.len() - 1]);
        let end = last.start + self.h * (last.pv.len() - 1) as f64;
        Window { start: first.start, end, starts: self.parts.iter().map(|p| p.start).collect(), h: self.h, answer }
    }

    fn told(&self, cell: usize, question: &Question) -> Option<Fitted> {
        let parts = self.signals();
        let (seeds, looked) = look(&parts, question.sign)?;
        let finest = ((self.steps() + MOST_CELLS / 2) / MOST_CELLS).clamp(1, cell);
        let times = looked as f64 / finest as f64;
        let record = Cells::new(&parts, finest);
        let seeds: Vec<Theta> = seeds.iter().map(|theta| rescaled(theta, times)).collect();
        let bow = parts.iter().map(|(pv, _)| bow(pv)).fold(0.0, f64::max);
        (record.count >= FEWEST).then(|| fit_record(&record, &seeds, self.h, bow, question))
    }
}

/// Good beginnings for a window, and the steps of the cells in which they were found: few, unless the process is not seen in
/// them.
fn look(parts: &[Signals], sign: f64) -> Option<(Vec<Theta>, usize)> {
    let mut cell = steps(parts).div_ceil(LOOK_CELLS).max(1);
    loop {
        let record = Cells::new(parts, cell);
        if !moves(&record) {
            return None;
        }
        let Pilot { seeds, slow, .. } = pilot(&record, sign);
        if cell == 1 || slow > SEEN {
            return Some((seeds, cell));
        }
        cell = (cell / 4).max(1);
    }
}

/// Steps in a cell that is fine enough for the process. From the finest on: coarse cells take steps of the load for the
/// process.
fn cell(parts: &[Signals], sign: f64) -> Option<usize> {
    let all = steps(parts);
    if all <= MOST_CELLS {
        return Some(1);
    }
    let mut cell = 1;
    loop {
        let last = LOOK_CELLS * cell >= all;
        let mut pieces: Vec<Vec<Signals>> = vec![parts.to_vec()];
        if last {
            cell = all.div_ceil(LOOK_CELLS).max(1);
        } else {
            let chunk = LOOK_CELLS * cell;
            let chunks = parts.iter().flat_map(|(y, u)| y.chunks(chunk).zip(u.chunks(chunk)));
            let mut chunks: Vec<Signals> = chunks.collect();
            chunks.sort_by(|a, b| turns(b.1).total_cmp(&turns(a.1)));
            pieces = chunks.into_iter().take(PIECES).map(|chunk| vec![chunk]).collect();
        }
        let records = pieces.iter().map(|piece| Cells::new(piece, cell)).filter(moves);
        let looked: Vec<Pilot> = records.collect::<Vec<_>>().par_iter().map(|record| pilot(record, sign)).collect();
        let mut slow: Vec<f64> = looked.iter().filter(|p| last || p.answers > ANSWERS).map(|p| p.slow).collect();
        slow.sort_by(f64::total_cmp);
        match slow.get(slow.len() / 2) {
            Some(slow) if last || *slow < HOLDS => return Some(((cell as f64 * slow / FINE) as usize).max(1)),
            None if last => return None,
            _ => cell *= 4,
        }
    }
}

fn steps(parts: &[Signals]) -> usize {
    parts.iter().map(|(y, _)| y.len()).sum()
}

/// Whether there is something to fit.
fn moves(record: &Cells) -> bool {
    record.count >= FEWEST && record.range > 0.0
}

/// How far OP goes up and down in all, counted in steps that are large for it.
fn turns(u: &[f64]) -> f64 {
    let every = u.len().div_ceil(60).max(1);
    let coarse: Vec<f64> = u.iter().step_by(every).copied().collect();
    coarse.windows(2).map(|w| (w[1] - w[0]).abs()).sum()
}

/// Windows of as many steps at most; of many, one of each epoch, that in which OP turns most.
fn cut<'a>(batch: &Batch<'a>, most: usize) -> Vec<Batch<'a>> {
    let all = batch.steps();
    if all as f64 <= UNCUT * most as f64 {
        return vec![batch.clone()];
    }
    let size = all.div_ceil(all.div_ceil(most));
    let pieces = batch.parts.iter().flat_map(|part| {
        part.pv.chunks(size).zip(part.op.chunks(size)).enumerate().map(move |(i, (pv, op))| Part {
            start: part.start + batch.h * (i * size) as f64,
            pv,
            op,
        })
    });
    let mut windows: Vec<Batch> = Vec::new();
    for piece in pieces {
        match windows.last_mut() {
            Some(window) if window.steps() + piece.pv.len() <= size => window.parts.push(piece),
            _ => windows.push(Batch { h: batch.h, parts: vec![piece] }),
        }
    }
    windows.retain(|window| 3 * window.steps() >= size);
    let told = |window: &Batch| window.parts.iter().map(|part| turns(part.op)).sum::<f64>();
    let count = windows.len();
    let epoch = |e: usize| &windows[e * count / MOST_WINDOWS..(e + 1) * count / MOST_WINDOWS];
    if count <= MOST_WINDOWS {
        return windows;
    }
    let best = |e: usize| epoch(e).iter().max_by(|a, b| told(a).total_cmp(&told(b))).cloned();
    (0..MOST_WINDOWS).filter_map(best).collect()
}
